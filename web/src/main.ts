/** The page: state to pose to pictures, and events to state. */

import { drawChart } from "./chart";
import { button, buttons, check, choice, download, field, fileButton, group, showValue, slider } from "./controls";
import {
  bench, constantCurvature, deadLoads, distance, lawOf, loadCore, solve, tipOf, type Loading, type Playground, type Point,
} from "./core";
import { advice, Curve, diagnose, type Diagnosis } from "./diagnosis";
import { modelOf, type Model } from "./model";
import { implausible } from "./plausibility";
import { FIRST, modelFrom, NAMES } from "./presets";
import { mainNumbers, withMainNumbers, writeRobotFile, type MainNumbers } from "./robot-file";
import { GHOST_STEPS, RobotScene, type Drawing } from "./scene";
import {
  applyHash, boundsOf, commandsOf, gravityOf, hasCommands, initial, sourceOf, stepFor, toHash, type Source, type State,
} from "./state";
import { short } from "./units";

const MOST_FILE_BYTES = 2_000_000;
/** Work on the error curve in a frame (ms), and the pause after which causes are sought. */
const CURVE_BUDGET = 4;
/** Longest search for the pose in which a robot is shown first (ms). */
const BEND_BUDGET = 400;
const PAUSE = 150;
/** Damping in proportion to mass of a motion (1/s), its longest time (s), and rise of displacements. */
const DAMPING = 3;
const MOST_TIME = 6;
const RISE = 0.1;
/** Length of the magnified error vector over the tip error. */
const MAGNIFIED = 10;
/** Step of a commanded bend (rad). */
const BEND_STEP = Math.PI / 360;

const find = <T extends HTMLElement>(id: string) => document.getElementById(id) as T;
const said = (error: unknown) => (error instanceof Error ? error.message : String(error));

class Page {
  private state!: State;
  /** Robot as it came, and with the numbers of the user. */
  private original!: Model;
  private model!: Model;
  private on: Playground | null = null;
  private readonly scene: RobotScene | null;
  private curve: Curve | null = null;
  private tip: Point | null = null;
  private tipError = NaN;
  private ghost: Float64Array = new Float64Array();
  private pending = 0;
  private pause = 0;
  private moving = 0;
  /** The point to which the tip is pulled next (m), and whether a pull goes on from tensions that it found. */
  private pulled: Point | null = null;
  private pulling = false;

  constructor() {
    this.scene = this.tryScene();
  }

  private tryScene(): RobotScene | null {
    try {
      return new RobotScene(find("scene"), {
        isOn: () => this.on !== null && !this.state.displacements,
        to: (point) => {
          this.pulled = point as Point;
          this.changed(false);
        },
        end: () => {
          this.pulling = false;
          this.changed(true);
        },
      });
    } catch {
      const note = find("no-scene");
      note.textContent =
        "This browser has no WebGL, so the robot is not drawn; all numbers and the curve are shown as usual.";
      note.hidden = false;
      find("scene").hidden = true;
      return null;
    }
  }

  /** Shows the robot of the address, or the first preset. */
  start(hash: string): void {
    this.alert("");
    let source: Source = { preset: FIRST };
    try {
      source = sourceOf(hash) ?? source;
      this.load(source, hasCommands(hash), (state) => applyHash(hash, state));
    } catch (error) {
      if (this.on === null) this.load({ preset: FIRST });
      this.alert(said(error));
    }
  }

  /** Takes another robot; throws and keeps the present one where it cannot be read. */
  private load(source: Source, hasCommands = false, adjust: (state: State) => void = () => {}): void {
    const original = modelFrom(source);
    const on = bench(original);
    const state = initial(source, original);
    let problem: unknown = null;
    try {
      adjust(state);
    } catch (error) {
      problem = error; // the robot of a link is shown although one of its numbers is damaged
    }
    this.stop();
    this.on?.free();
    [this.state, this.original, this.model, this.on] = [state, original, original, on];
    try {
      this.rebuild();
    } catch (error) {
      problem = error;
      state.numbers = null;
    }
    if (!hasCommands) this.bend();
    this.scene?.show(this.model.geometry, false);
    this.buildControls();
    this.changed(true, true);
    if (problem !== null) this.alert(said(problem));
  }

  /** Builds the robot with the numbers of the user. */
  private rebuild(): void {
    const { file } = this.original;
    if (file === null || this.state.numbers === null) return;
    const model = modelOf(withMainNumbers(file, this.state.numbers));
    const on = bench(model);
    this.on?.free();
    [this.model, this.on] = [model, on];
  }

  /** Bends the robot by its first tendon to where constant curvature leaves the tolerance. */
  private bend(): void {
    const { state, model } = this;
    const along = state.displacements ? state.bends : state.tensions;
    along[0] = 1;
    try {
      const unit = Math.max(...this.loading.commands.map(Math.abs));
      if (unit < 1e-6) throw new Error("the first tendon does not bend the robot this way");
      const bounds = boundsOf(this.original.geometry, state.displacements);
      const curve = new Curve(model, this.loading, bounds.command);
      const command = curve.outside(state.tolerance * model.geometry.length, BEND_BUDGET) / unit;
      curve.free();
      const step = state.displacements ? BEND_STEP : stepFor(bounds.tension);
      along[0] = Math.ceil(command / step) * step;
    } catch {
      along[0] = 0; // the pose says why
    }
  }

  private get loading(): Loading {
    const { state } = this;
    return {
      displacements: state.displacements,
      commands: commandsOf(state, this.model.geometry),
      gravity: gravityOf(state),
      force: state.force,
    };
  }

  /** Shows a sentence, after the name of the file that it is about; names and paths of fields stay as they are. */
  alert(sentence: string, file = ""): void {
    const ended = sentence === "" ? "" : sentence.replace(/\.?$/, ".");
    const isPlain = /^[a-z]+ /.test(ended) && file === "";
    find("alert").textContent = (file === "" ? "" : `${file}: `) + (isPlain ? ended[0].toUpperCase() + ended.slice(1) : ended);
  }

  /** After a change of state: at most one solve a frame. */
  private changed(curve: boolean, cold = false): void {
    this.stop();
    if (curve) {
      this.curve?.free();
      this.curve = null;
    }
    if (cold) this.update(true);
    else if (this.pending === 0) this.pending = requestAnimationFrame(() => this.update(false));
  }

  private update(cold: boolean): void {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    if (this.on === null) return;
    if (this.pulled !== null) this.reach(this.pulled);
    const { loading } = this;
    let found;
    try {
      found = solve(this.on, loading, cold);
    } catch (error) {
      found = said(error);
    }
    if (typeof found === "string") {
      this.alert(`${found}; the last pose stays`);
    } else {
      this.alert(found.sentence);
      this.tip = found.tip;
      const arcs = constantCurvature(this.on, lawOf(loading), loading.commands, GHOST_STEPS);
      this.ghost = typeof arcs === "string" ? new Float64Array() : arcs;
      this.tipError = typeof arcs === "string" ? NaN : distance(found.tip, tipOf(arcs));
      if (typeof arcs === "string") this.alert(`constant curvature has no answer here: ${arcs}`);
      this.showNumbers(found.error);
      this.draw();
    }
    if (!this.pulling) this.continueCurve();
    clearTimeout(this.pause);
    this.pause = window.setTimeout(() => this.settle(), PAUSE);
    if (performance.getEntriesByName("bowstring:first-pose").length === 0) performance.mark("bowstring:first-pose");
  }

  /** Takes the tensions that bring the tip nearest to a point. */
  private reach(point: Point): void {
    const { state } = this;
    this.pulled = null;
    const { tension } = boundsOf(this.original.geometry, false);
    const most = Float64Array.from(state.tensions, () => tension);
    try {
      const found = this.on!.reach(Float64Array.from(point), most, deadLoads(this.loading), this.pulling);
      this.pulling = true;
      if (found.length === 0) return;
      state.tensions = [...found];
      state.tensions.forEach((value, i) => showValue(`tension-${i}`, value));
    } catch (error) {
      this.alert(said(error));
    }
  }

  private draw(): void {
    if (this.on === null || this.scene === null) return;
    const stress = this.state.stressColours ? this.on.stress() : new Float64Array();
    const mostStress = stress.reduce((a, b) => Math.max(a, b), 0);
    const slack = this.on.slack();
    const drawing: Drawing = {
      backbone: this.on.backbone(), disks: this.on.disks(), slack, stress, mostStress, ghost: this.ghost,
      magnification: this.state.magnified ? MAGNIFIED : 1,
    };
    this.scene.draw(drawing);
    find("magnified").textContent = this.state.magnified ? `, ${MAGNIFIED} times as long` : "";
    find("slack-legend").hidden = !slack.some((s) => s > 1e-6 * this.model.geometry.length);
    const legend = find("stress-legend");
    legend.hidden = mostStress === 0;
    find("stress-most").textContent = `${short(mostStress / 1e6)} MPa (von Mises)`;
  }

  private showNumbers(discretisation: number): void {
    const { length } = this.model.geometry;
    const { tolerance, displacements } = this.state;
    const share = this.tipError / length;
    const verdict = find("verdict");
    const fails = !(share <= tolerance);
    verdict.className = fails ? "bad" : "good";
    const limit = `the tolerance of ${short(tolerance * length * 1e3)} mm (${short(tolerance * 100)} %)`;
    verdict.textContent = Number.isNaN(this.tipError)
      ? "Constant curvature has no answer for these commands."
      : `Constant curvature is wrong by ${short(this.tipError * 1e3)} mm at the tip, ${short(share * 100)} % of the length: ` +
        (fails ? `more than ${limit}.` : `within ${limit}.`);
    const rows: [string, string][] = [];
    const [x, y, z] = this.tip!.map((v) => (v * 1e3).toFixed(2));
    rows.push(["tip of the rod, x y z", `${x}  ${y}  ${z} mm`]);
    const estimate = discretisation * 1e6;
    rows.push(["estimated discretisation error", Number.isNaN(estimate) ? "–" : `${short(Math.max(estimate, 1e-3), 2)} µm`]);
    const on = this.on!;
    const list = (values: Float64Array, factor: number) => Array.from(values, (v) => short(v * factor, 3)).join(", ");
    if (displacements) rows.push(["tensions", `${list(on.tensions().slice(0, 12), 1)} N`]);
    else rows.push(["displacements", `${list(on.displacements().slice(0, 12), 1e3)} mm`]);
    find("numbers").replaceChildren(
      ...rows.flatMap(([name, value]) => {
        const [term, description] = [document.createElement("dt"), document.createElement("dd")];
        [term.textContent, description.textContent] = [name, value];
        return [term, description];
      }),
    );
  }

  /** Largest command of the curve. */
  private get mostCommand(): number {
    const now = Math.max(...this.loading.commands.map(Math.abs));
    return Math.max(boundsOf(this.original.geometry, this.state.displacements).command, now);
  }

  private continueCurve(): void {
    if (this.curve === null) {
      try {
        this.curve = new Curve(this.model, this.loading, this.mostCommand);
      } catch {
        return; // the pose says why
      }
    }
    const { curve } = this;
    const end = performance.now() + CURVE_BUDGET;
    while (!curve.isDone && performance.now() < end) curve.step();
    this.drawCurve();
    if (!curve.isDone && this.pending === 0) {
      requestAnimationFrame(() => {
        if (this.curve === curve && this.pending === 0) this.continueCurve();
      });
    }
  }

  private drawCurve(): void {
    const { curve, state, model } = this;
    if (curve === null) return;
    const { length } = model.geometry;
    const tolerance = state.tolerance * length;
    const [label, scale, unit] = state.displacements
      ? ["largest displacement, mm", 1e3, "mm"]
      : ["largest tension, N", 1, "N"];
    const command = Math.max(...this.loading.commands.map(Math.abs));
    const now = Number.isNaN(this.tipError) ? null : { command, error: this.tipError };
    drawChart(find("chart"), { points: curve.points, most: curve.most, tolerance, now, label: label as string, scale: scale as number });
    const crossing = curve.crossing(tolerance);
    const where = find("where");
    if (crossing !== null) {
      const at = short(crossing * (scale as number), 2);
      where.textContent = `In this direction constant curvature leaves the tolerance at ${at} ${unit}.`;
    } else if (curve.isDone) {
      const last = curve.points.at(-1)?.command ?? 0;
      where.textContent =
        `In this direction constant curvature stays within the tolerance up to ${short(last * (scale as number), 2)} ${unit}.`;
    } else where.textContent = "";
  }

  /** What waits for a pause: causes, doubts about the robot's numbers, and the address. */
  private settle(): void {
    const { file } = this.model;
    find("doubts").textContent = file === null ? "" : implausible(file).map((sentence) => `Check ${sentence}`).join("\n");
    const leftOut = file?.leftOut ?? [];
    find("left-out").hidden = leftOut.length === 0;
    find("left-out").textContent = leftOut.join(" ");
    const hash = `#${toHash(this.state)}`;
    if (location.hash !== hash) history.replaceState(null, "", hash);
    let found: Diagnosis = { error: NaN, causes: [] };
    try {
      found = diagnose(this.model, this.loading);
    } catch {
      // the pose says why
    }
    const rows = found.causes.map(({ name, without }) => {
      const row = document.createElement("tr");
      row.insertCell().textContent = name;
      row.insertCell().textContent = `${short((found.error - without) * 1e3)} mm`;
      return row;
    });
    const body = document.querySelector("#causes tbody") as HTMLElement;
    body.replaceChildren(...rows);
    find("advice").textContent = advice(found, this.model.geometry.length);
    performance.clearMarks("bowstring:settled");
    performance.mark("bowstring:settled");
  }

  // -- motion ---------------------------------------------------------------------------------

  private release(): void {
    this.stop();
    if (this.on === null) return;
    const zero = { ...this.loading, commands: this.loading.commands.map(() => 0), force: [0, 0, 0] };
    const commands = Float64Array.from(zero.commands);
    try {
      this.on.release(commands, deadLoads(zero), this.state.displacements ? RISE : 0, DAMPING);
    } catch (error) {
      this.alert(`no motion: ${said(error)}`);
      return;
    }
    this.ghost = new Float64Array();
    let last: number | null = null; // time of the first frame, which may be before the click
    let time = 0;
    const frame = (now: number) => {
      last ??= now;
      // a slow frame makes the motion slower, not the step longer
      const passed = Math.min((now - last) / 1e3, 1 / 30);
      last = now;
      time += passed;
      let stopped: string;
      try {
        stopped = this.on!.advance(passed);
      } catch (error) {
        stopped = said(error);
      }
      this.draw();
      const verdict = find("verdict");
      verdict.className = "";
      verdict.textContent = `Motion after release, ${time.toFixed(1)} s. Move a slider to go on.`;
      if (stopped !== "") this.alert(stopped);
      this.moving = stopped === "" && time < MOST_TIME ? requestAnimationFrame(frame) : 0;
    };
    this.moving = requestAnimationFrame(frame);
  }

  private stop(): void {
    cancelAnimationFrame(this.moving);
    this.moving = 0;
  }

  // -- controls -------------------------------------------------------------------------------

  private buildControls(): void {
    const { state, original, model } = this;
    const most = boundsOf(original.geometry, state.displacements);
    const set = (change: (value: number) => void, curve: boolean) => (value: number) => {
      change(value);
      this.changed(curve);
    };
    const preset = "preset" in state.source ? state.source.preset : "";
    const names = NAMES.map((name): [string, string] => [name, name]);
    if (preset === "") names.unshift(["", original.name]);
    const robots = buttons(
      choice("robot", "Robot", names, preset, (name) => name !== "" && this.tryLoad({ preset: name })),
      fileButton("file", "Open a file", ".yaml,.yml,.json", (file) => void this.open(file)),
    );
    const control = group(
      "Actuation",
      choice(
        "control", "control by",
        [["tension", "tensions"], ["displacement", "displacements"]],
        state.displacements ? "displacement" : "tension",
        (value) => {
          state.displacements = value === "displacement";
          if (this.loading.commands.every((command) => command === 0)) this.bend();
          this.buildControls();
          this.changed(true, true);
        },
      ),
    );
    if (state.displacements) {
      model.geometry.diameters.forEach((_, i) => {
        const segment = model.geometry.diameters.length > 1 ? ` of segment ${i + 1}` : "";
        const angle = (k: number, label: string, least: number, most: number) =>
          slider({
            id: `bend-${2 * i + k}`, label: label + segment, unit: "°", least, most, step: 0.5,
            value: (state.bends[2 * i + k] * 180) / Math.PI,
            onInput: set((x) => (state.bends[2 * i + k] = (x * Math.PI) / 180), k === 1),
          });
        control.append(angle(0, "commanded bend", 0, 120), angle(1, "direction", -180, 180));
      });
    } else {
      state.tensions.forEach((value, i) => {
        control.append(
          slider({
            id: `tension-${i}`, label: `tension ${i + 1}`, unit: "N", least: 0, most: most.tension,
            step: stepFor(most.tension), value,
            onInput: (x) => {
              // the curve is along the direction of the tensions, which a single one does not change
              const others = state.tensions.some((t, k) => k !== i && t > 0);
              const other = state.tensions[i] === 0 || x === 0;
              state.tensions[i] = x;
              this.changed(others || other);
            },
          }),
        );
      });
    }
    control.append(
      buttons(
        button("release", "Release", () => this.release()),
        button("home", "Home pose", () => {
          state.tensions.fill(0);
          state.bends.fill(0);
          state.force.fill(0);
          this.buildControls();
          this.changed(true, true);
        }),
      ),
    );
    const degrees = (id: string, label: string, least: number, most: number, key: "tilt" | "azimuth") =>
      slider({
        id, label, unit: "°", least, most, step: 1, value: (state[key] * 180) / Math.PI,
        onInput: set((x) => (state[key] = (x * Math.PI) / 180), true),
      });
    const loads = group("Loads", check("gravity", "gravity", state.gravityOn, (on) => {
      state.gravityOn = on;
      this.changed(true);
    }));
    loads.append(
      degrees("tilt", "gravity, angle from −z", 0, 180, "tilt"),
      degrees("azimuth", "gravity, direction from x", -180, 180, "azimuth"),
    );
    const mostForce = most.tension / 20;
    ["x", "y", "z"].forEach((axis, i) => {
      loads.append(
        slider({
          id: `force-${axis}`, label: `tip force along ${axis}`, unit: "N", least: -mostForce, most: mostForce,
          step: stepFor(mostForce), value: state.force[i], onInput: set((x) => (state.force[i] = x), true),
        }),
      );
    });
    const { length } = model.geometry;
    const showTolerance = () => {
      showValue("tolerance", state.tolerance * 100);
      showValue("tolerance-mm", Number(short(state.tolerance * this.model.geometry.length * 1e3, 4)));
    };
    const setTolerance = (share: number) => {
      state.tolerance = share;
      showTolerance();
      this.changed(false);
    };
    const view = group(
      "Verdict and view",
      slider({
        id: "tolerance", label: "tolerance, share of the length", unit: "%", least: 0.1, most: 10, step: 0.1,
        value: state.tolerance * 100, onInput: (x) => setTolerance(x / 100),
      }),
      field("tolerance-mm", "tolerance", "mm", Number(short(state.tolerance * length * 1e3, 4)), (x, text) => {
        const share = x / 1e3 / this.model.geometry.length;
        if (share >= 1e-5 && share <= 1) return setTolerance(share);
        showTolerance();
        const [least, most] = [1e-2, 1e3].map((part) => short(this.model.geometry.length * part, 4));
        this.alert(`tolerance: got "${text}" mm; must be from ${least} mm to the length, ${most} mm`);
      }),
      check("magnify", `error vector ${MAGNIFIED} times as long`, state.magnified, (on) => {
        state.magnified = on;
        this.changed(false);
      }),
    );
    if (model.geometry.known) {
      view.append(check("stress", "colour by stress", state.stressColours, (on) => {
        state.stressColours = on;
        this.changed(false);
      }));
    }
    view.append(
      buttons(
        button("share", "Copy link", () => void this.share()),
        button("png", "Save PNG", () => void this.savePicture()),
        ...(model.file === null ? [] : [button("save", "Save robot file", () => this.saveRobot())]),
      ),
    );
    find("controls").replaceChildren(robots, control, loads, ...this.numberControls(), view);
  }

  private numberControls(): HTMLElement[] {
    const { file } = this.original;
    if (file === null) return [];
    const of = mainNumbers(file);
    const now = this.state.numbers ?? of;
    const change = (key: keyof MainNumbers, value: number) => {
      const numbers = { ...(this.state.numbers ?? of), [key]: value };
      const before = this.state.numbers;
      this.state.numbers = numbers;
      try {
        this.rebuild();
        this.scene?.show(this.model.geometry, true);
        showValue("tolerance-mm", Number(short(this.state.tolerance * this.model.geometry.length * 1e3, 4)));
        this.changed(true, true);
      } catch (error) {
        this.state.numbers = before;
        this.alert(`${said(error)}; the last robot stays`);
      }
    };
    const scaled = (key: keyof MainNumbers, label: string, unit: string, factor: number) => {
      const shown = of[key] * factor;
      const step = 10 ** (Math.floor(Math.log10(shown)) - 2);
      const round = (x: number) => Math.max(step, Math.round(x / step) * step);
      return slider({
        id: `number-${key}`, label, unit, least: round(shown / 3), most: round(shown * 3), step,
        value: now[key] * factor, onInput: (x) => change(key, x / factor),
      });
    };
    return [
      group(
        file.segments.length > 1 ? "Robot's numbers (first segment, others in proportion)" : "Robot's numbers",
        slider({
          id: "number-disks", label: "disks in the segment", unit: "", least: 1, most: Math.max(30, 2 * of.disks), step: 1,
          value: now.disks, onInput: (x) => change("disks", x),
        }),
        scaled("length", "length", "mm", 1e3),
        scaled("diameter", "diameter of the backbone", "mm", 1e3),
        scaled("E", "Young's modulus", "GPa", 1e-9),
        scaled("pitchRadius", "pitch radius of the tendons", "mm", 1e3),
      ),
    ];
  }

  // -- files and links ------------------------------------------------------------------------

  tryLoad(source: Source): void {
    try {
      this.load(source);
    } catch (error) {
      this.alert(`${said(error)}; the last robot stays`);
    }
  }

  async open(file: File): Promise<void> {
    if (file.size > MOST_FILE_BYTES) {
      this.alert(`the file has ${file.size} bytes, which is no robot file; the last robot stays`, file.name);
      return;
    }
    try {
      const text = new TextDecoder("utf-8", { fatal: true }).decode(await file.arrayBuffer());
      this.load({ text, fileName: file.name.slice(0, 100) });
    } catch (error) {
      const why = error instanceof TypeError ? "it is no text" : said(error);
      this.alert(`${why}; the last robot stays`, file.name);
    }
  }

  private async share(): Promise<void> {
    this.settle();
    try {
      await navigator.clipboard.writeText(location.href);
      this.alert("the link is copied");
    } catch {
      this.alert("the browser does not allow copying; the link is in the address bar");
    }
  }

  private async savePicture(): Promise<void> {
    const blob = await this.scene?.picture();
    if (blob) download(blob, `${this.fileName}.png`);
    else this.alert("there is no picture to save: this browser has no WebGL");
  }

  private saveRobot(): void {
    const { file } = this.model;
    if (file === null) return;
    const text = writeRobotFile({ ...file, gravity: gravityOf(this.state) });
    download(new Blob([text], { type: "text/yaml" }), `${this.fileName}.yaml`);
  }

  private get fileName(): string {
    return this.model.name.replace(/[^\w.-]+/g, "_").replace(/^[._-]+|[._-]+$/g, "") || "robot";
  }
}

async function main(): Promise<void> {
  document.querySelector("main")!.hidden = false;
  find("controls").addEventListener("submit", (event) => event.preventDefault()); // Enter in a field
  const core = loadCore(); // beside the start of WebGL
  const page = new Page();
  try {
    await core;
  } catch (error) {
    page.alert(`the core could not start: ${said(error)}; the page needs WebAssembly`);
    return;
  }
  page.start(location.hash.slice(1));
  addEventListener("hashchange", () => page.start(location.hash.slice(1)));
  const over = (event: DragEvent, on: boolean) => {
    event.preventDefault();
    document.body.classList.toggle("drop", on);
  };
  addEventListener("dragover", (event) => over(event, true));
  addEventListener("dragleave", (event) => over(event, false));
  addEventListener("drop", (event) => {
    over(event, false);
    const file = event.dataTransfer?.files[0];
    if (file) void page.open(file);
  });
}

void main();
