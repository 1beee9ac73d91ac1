/** The core of the page and its reading of robot files, beside the Python package. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { decompress } from "fzstd";
import { createServer } from "vite";
import init, { Playground } from "../generated/bowstring_wasm.js";

const at = (path) => fileURLToPath(new URL(path, import.meta.url));
const { robots: cases, causes, implausible, written, laws, study } = JSON.parse(readFileSync(at("../../target/random-robots.json"), "utf8"));

let server, files, models, diagnosis, plausibility, presets;

before(async () => {
  const module = { module_or_path: decompress(readFileSync(at("../generated/core.bin"))) };
  await init(module);
  server = await createServer({ root: at(".."), server: { middlewareMode: true, ws: false }, appType: "custom", logLevel: "error" });
  const load = (path) => server.ssrLoadModule(path);
  const names = ["robot-file", "model", "diagnosis", "plausibility", "presets"];
  [files, models, diagnosis, plausibility, presets] = await Promise.all(names.map((name) => load(`/src/${name}.ts`)));
  await (await load("/generated/bowstring_wasm.js")).default(module); // the instance of these modules
});
after(() => server.close());

function tipOf(text, { tensions, gravity, force }) {
  const on = new Playground(text);
  const solved = on.solve(false, Float64Array.from(tensions), Float64Array.from([...gravity, ...force, 0, 0, 0]), true);
  const tip = solved.converged ? [...on.disks().slice(-12, -9)] : null;
  on.free();
  return tip;
}

const apart = (a, b) => Math.hypot(...a.map((x, i) => x - b[i]));

test("1000 random robots and loads: tips of the page within 1e-9 of Python's", () => {
  let solved = 0;
  let worst = 0;
  for (const robot of cases) {
    const tip = tipOf(robot.compiled, robot);
    assert.equal(tip === null, robot.tip === null);
    if (tip === null) continue;
    solved++;
    worst = Math.max(worst, apart(tip, robot.tip) / robot.length);
  }
  console.log(`  ${solved} of ${cases.length} solved; largest difference ${worst.toExponential(1)} of the length`);
  assert.equal(cases.length, 1000);
  assert.ok(solved > 900);
  assert.ok(worst < 1e-9);
});

test("the page compiles robot files as the Python package does", () => {
  let worst = 0;
  const compare = (page, python, path) => {
    if (typeof python === "number") {
      assert.ok(Math.abs(page - python) <= 1e-12 * Math.max(Math.abs(python), 1e-9), `${path}: ${page}, ${python}`);
      if (python !== 0) worst = Math.max(worst, Math.abs(page / python - 1));
    } else if (python !== null && typeof python === "object") {
      assert.deepEqual(Object.keys(page).sort(), Object.keys(python).sort(), path);
      for (const key of Object.keys(python)) compare(page[key], python[key], `${path}.${key}`);
    } else assert.equal(page, python, path);
  };
  for (const { file, compiled } of cases) {
    compare(JSON.parse(files.compiled(files.readRobotFile(file, "robot"))), JSON.parse(compiled), "robot");
  }
});

test("causes on robots with 3 mm clamps are those of a study", () => {
  const seen = new Set();
  let worst = 0;
  for (const { file, length, tensions, gravity, without, shares } of causes) {
    const loading = { displacements: false, commands: tensions, gravity, force: [0, 0, 0] };
    const found = diagnosis.diagnose(models.readModel(file, "robot"), loading);
    const names = found.causes.map(({ effect }) => effect);
    assert.deepEqual(names.toSorted(), Object.keys(without).sort());
    assert.ok("clamps" in without);
    for (const cause of found.causes) {
      worst = Math.max(worst, Math.abs(cause.without - without[cause.effect]) / length);
      assert.ok(Math.abs(cause.share - shares[cause.effect]) < 1e-6, `${cause.effect}: ${cause.share}, ${shares[cause.effect]}`);
    }
    seen.add(names[0]);
  }
  console.log(`  ${causes.length} robots; largest difference ${worst.toExponential(1)} of the length; first: ${[...seen].join(", ")}`);
  assert.ok(worst < 1e-9 && seen.has("clamps"));
});

test("causes of the built-in robot are those of its study", () => {
  const loading = { displacements: false, commands: [study.tension, 0, 0], gravity: [0, 0, 0], force: [0, 0, 0] };
  const { causes } = diagnosis.diagnose(presets.modelFrom({ preset: "amouri2019" }), loading);
  assert.deepEqual(causes.map(({ effect }) => effect).toSorted(), Object.keys(study.without).sort());
  for (const { effect, without } of causes) assert.ok(Math.abs(without - study.without[effect]) < 1e-9, effect);
  assert.equal(causes[0].effect, "straight_spans");
});

/** A backbone of 1 mm, 30 mm long, with three 3 mm clamps. */
const CLAMPED = `name: clamped
segments:
  - length: 30 mm
    backbone: {diameter: 1 mm, E: 60 GPa, nu: 0.3, density: 6450 kg/m^3}
    disks: {count: 3, mass: 1 g, radius: 6 mm, thickness: 3 mm, clamped_length: 3 mm}
    tendons: {count: 3, pitch_radius: 5 mm}
`;

test("clamps are named where they are the cause", () => {
  const model = models.readModel(CLAMPED, "robot");
  const at = (loading) => {
    const all = { displacements: false, commands: [10, 0, 0], gravity: [0, 0, 0], force: [0, 0, 0], ...loading };
    return diagnosis.advice(diagnosis.diagnose(model, all), model.geometry.length);
  };
  assert.match(at({}), /^Dominant cause: clamped lengths at the disks; without this effect the error would be 0\.\d+ mm\./);
  assert.match(at({ commands: [0, 0, 0], force: [2, 0, 0] }), /^Dominant cause: tip force; .* would be 0 mm\./);
  assert.equal(at({ commands: [0, 0, 0] }), "");
  // straight spans leave two of three displaced tendons slack
  const displaced = { displacements: true, commands: [5e-3, -2.5e-3, -2.5e-3] };
  const plain = models.readModel(CLAMPED.replace(", clamped_length: 3 mm", ""), "robot");
  const found = diagnosis.diagnose(plain, { ...displaced, gravity: [0, 0, 0], force: [0, 0, 0] });
  assert.match(diagnosis.advice(found, 0.03), /^Dominant cause: slack or elastic tendons/);
  assert.ok(found.causes.some(({ effect }) => effect === "straight_spans"));
});

test("a written robot file is read back as the same robot", () => {
  for (const { file } of cases.slice(0, 100)) {
    const robot = files.readRobotFile(file, "robot");
    const again = files.readRobotFile(files.writeRobotFile(robot), "robot");
    const [a, b] = [robot, again].map((r) => JSON.parse(files.compiled(r)));
    const numbers = (value) => (typeof value === "number" ? [value] : value && typeof value === "object" ? Object.values(value).flatMap(numbers) : []);
    numbers(a).forEach((x, i) => assert.ok(Math.abs(x - numbers(b)[i]) <= 1e-9 * Math.max(Math.abs(x), 1e-6)));
  }
});

const GOOD = () => readFileSync(at("../../python/bowstring/robot/builtin/amouri2019.yaml"), "utf8");
const REFUSED = [
  ["segments: 3", /segments: must be a list/],
  ["a: [", /the file is no YAML/],
  ["segments: !!x []", /the file is no YAML: Unresolved tag/],
  [`${GOOD()}\n"a\\nb${"a".repeat(500)}": 1`, /: a ba+\.\.\.: the page does not read this field/],
  ["just text", /must be a mapping/],
  ["segments: []", /1 to 20 segments/],
];
const CHANGED = [
  ["diameter: 5 mm", "diameter: 5", /backbone\.diameter: got 5 without a unit; write for example "5 mm"$/],
  ["diameter: 5 mm", "diameter: 0.005", /got 0\.005 without a unit; write for example "0\.005 m"$/],
  ["diameter: 5 mm", "diameter: 5 constructor", /the unit must be one of m, cm/],
  ["pitch_radius: 29 mm", "pitch_radius: 8", /pitch_radius: got 8 without a unit; write for example "8 mm"$/],
  ["pitch_radius: 29 mm", "pitch_radius: 0.5", /write for example "0\.5 mm"$/],
  ["diameter: 5 mm", "diameter: 1.2", /write for example "1\.2 mm"$/],
  ["length: 641 mm", "length: 0.641", /write for example "0\.641 m"$/],
  ["length: 641 mm", "length: 641", /write for example "641 mm"$/],
  ["E: 35 GPa", "E: 35", /write for example "35 GPa"$/],
  ["E: 35 GPa", "E: 35000", /write for example "35000 MPa"$/],
  ["segments:", "gravity: 0 0 -9.81\nsegments:", /got "0 0 -9\.81" without a unit; write for example "0 0 -9\.81 m\/s\^2"$/],
  ["diameter: 5 mm", "diameter: 5 furlong", /the unit must be one of m, cm/],
  ["E: 35 GPa", "E: -35 GPa", /backbone\.E: got -35000000000 Pa; must be from/],
  ["nu: 0.3", "nu: 0.3\n      G: 1 GPa", /exactly one of G and nu/],
  ["count: 9", "count: 0", /disks\.count: got "0"; must be a whole number/],
  ["count: 9", "count: 1e9", /must be a whole number from 1 to 300/],
  ["count: 3\n", "count: 3\n      friction: much\n", /friction: got "much"; must be a number/],
  ["count: 3\n", "count: 3\n      turns: 1\n", /turns: the page does not read this field; write it with "bowstring export/],
  ["pitch_radius: 29 mm", "pitch_radius: 40 mm", /pitch_radius must lie between/],
  ["length: 641 mm", "length: .nan m", /length: got/],
  ["clamped_length: 0 mm", "clamped_length: 80 mm", /leaves no free backbone/],
];

test("what is no robot of the page is refused in one sentence", () => {
  for (const [text, pattern] of REFUSED) assert.throws(() => files.readRobotFile(text, "x"), pattern);
  for (const [from, to, pattern] of CHANGED) {
    const text = GOOD().replace(from, to);
    assert.notEqual(text, GOOD(), from);
    assert.throws(() => files.readRobotFile(text, "x"), (error) => {
      assert.match(error.message, pattern);
      assert.ok(!error.message.includes("\n"));
      return true;
    });
  }
});

test("implausible numbers are named as the Python package names them", () => {
  for (const { file, warnings } of implausible) {
    assert.deepEqual(plausibility.implausible(files.readRobotFile(file, "x")), warnings);
  }
  assert.ok(implausible.filter(({ warnings }) => warnings.length > 0).length > 8);
});

test("robots that fit writes are read, and their laws are named as left out", () => {
  assert.deepEqual(Object.fromEntries(Object.entries(files.LAWS).map(([field, [none]]) => [field, none])), laws);
  const first = { friction: "Friction", backlash: "Backlash", hysteresis: "Hysteresis", clearance: "Clearance", "mount compliance": "Compliance", gain: "Gain", zero: "Gain" };
  const seen = new Set();
  for (const { file, laws } of written) {
    const { leftOut } = files.readRobotFile(file, "x");
    assert.deepEqual(leftOut.map((sentence) => sentence.split(" ")[0]).sort(), [...new Set(laws.map((law) => first[law]))].sort());
    for (const law of laws) seen.add(law);
  }
  assert.equal(seen.size, Object.keys(first).length, [...seen].join(", "));
});

test("fields at zero are as left out", () => {
  const zeros = "rest_bend: 0.0 rad\n      width_direction: 0.0 rad\n      hysteresis: 0.0\n      nu: 0.3";
  const more = "count: 3\n      kind: tendon\n      backlash: 0.0 m\n      turns: 0.0\n      friction: 0.0\n";
  const text = GOOD().replace("nu: 0.3", zeros).replace("count: 3\n", more);
  assert.equal(files.compiled(files.readRobotFile(text, "x")), files.compiled(files.readRobotFile(GOOD(), "x")));
});

test("a tendon on the axis of a tube is read, and others scale beside it", () => {
  const text = `segments:
  - length: 200 mm
    backbone: {diameter: 4 mm, inner_diameter: 3 mm, E: 1 GPa, nu: 0.3, density: 1000 kg/m^3}
    disks: {count: 5, mass: 1 g, radius: 10 mm, thickness: 1 mm}
    tendons: [{angle: 0 deg, pitch_radius: 0 mm}, {angle: 0 deg, pitch_radius: 5 mm}]
`;
  const robot = files.readRobotFile(text, "x");
  const most = JSON.parse(files.compiled(robot)).tendons.map((tendon) => tendon.max_tension_N);
  const exported = [674.6799883557179, 26.987199534228715]; // by bowstring export
  most.forEach((tension, i) => assert.ok(Math.abs(tension / exported[i] - 1) < 1e-12));
  const wider = files.withMainNumbers(robot, { ...files.mainNumbers(robot), pitchRadius: 6e-3 });
  assert.deepEqual(wider.segments[0].tendons.map((tendon) => tendon.pitchRadius), [0, 6e-3]);
  const alone = text.replace(", {angle: 0 deg, pitch_radius: 5 mm}", "");
  assert.throws(() => files.readRobotFile(alone, "x"), /segments: have no tendon beside the axis$/);
});

test("links name the page's own robots only", () => {
  for (const preset of ["constructor", "__proto__", "toString", "nobody", ""]) {
    assert.throws(() => presets.modelFrom({ preset }), /names a robot that this page does not have/);
  }
  assert.equal(presets.modelFrom({ preset: "rao2021" }).name, "rao2021");
});

test("the work on a robot is limited, of files, links and compiled robots", () => {
  const { segments: [segment] } = files.readRobotFile(GOOD(), "x");
  const list = (count, one) => Array.from({ length: count }, () => one);
  const all = { ...files.readRobotFile(GOOD(), "x"), segments: list(20, segment) };
  const few = files.mainNumbers(all);
  assert.throws(() => files.withMainNumbers(all, { ...few, disks: 100 }), /have 2000 disks; the page takes up to 300/);
  assert.equal(files.withMainNumbers(all, { ...few, disks: 15 }).segments.length, 20);
  const text = files.writeRobotFile({ ...all, segments: list(2, { ...segment, tendons: list(60, segment.tendons[0]) }) });
  assert.throws(() => files.readRobotFile(text, "x"), /have 120 tendons; the page takes up to 100/);
  for (const [name, count] of [["disks", 301], ["tendons", 101], ["segments", 301]]) {
    const content = JSON.parse(files.compiled(files.readRobotFile(GOOD(), "x")));
    content[name] = list(count, content[name][0]);
    assert.throws(() => models.readModel(JSON.stringify(content), "x"), new RegExp(`${name}: the compiled robot has ${count}`));
  }
});

test("bad numbers at the core are errors", () => {
  const { compiled } = cases[0];
  const on = new Playground(compiled);
  const count = on.tensions().length || cases[0].tensions.length;
  const zeros = new Float64Array(9);
  assert.throws(() => on.solve(false, new Float64Array(count + 1), zeros, false), /tendon|tension/);
  assert.throws(() => on.solve(false, new Float64Array(count).fill(NaN), zeros, false), /tension/);
  assert.throws(() => on.solve(false, new Float64Array(count).fill(-1), zeros, false), /tension/);
  assert.throws(() => on.solve(false, new Float64Array(count), new Float64Array(8), false), /8 numbers of loads/);
  assert.throws(() => on.advance(0.1), /release the robot first/);
  on.release(new Float64Array(count), zeros, 0, 3);
  for (const bad of [-0.02, NaN, Infinity]) assert.throws(() => on.advance(bad), /zero or more seconds/);
  assert.equal(on.advance(0), "");
  assert.throws(() => new Playground("{}"), /no compiled robot/);
  on.free();
});

test("a motion comes to rest where statics is", () => {
  const robot = cases.find((c) => c.tip !== null && c.tensions.some((t) => t > 0));
  const on = new Playground(robot.compiled);
  const loads = Float64Array.from([...robot.gravity, 0, 0, 0, 0, 0, 0]);
  const zeros = new Float64Array(robot.tensions.length);
  on.solve(false, zeros, loads, true);
  const rest = [...on.disks().slice(-12, -9)];
  on.solve(false, Float64Array.from(robot.tensions), loads, true);
  on.release(zeros, loads, 0, 20);
  const start = [...on.disks().slice(-12, -9)];
  for (let frame = 0; frame < 300; frame++) assert.equal(on.advance(1 / 60), "");
  const end = [...on.disks().slice(-12, -9)];
  assert.ok(apart(end, rest) < 1e-3 * apart(start, rest), `${apart(end, rest)} of ${apart(start, rest)}`);
  on.free();
});
