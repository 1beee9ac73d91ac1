/** Damaged links, robot files and compiled robots: each is read, or refused by a sentence. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, before, test } from "node:test";
import { fileURLToPath } from "node:url";
import { decompress } from "fzstd";
import { createServer } from "vite";

const at = (path) => fileURLToPath(new URL(path, import.meta.url));
const LINKS = Number(process.env.LINKS ?? 2000);
const FILES = Number(process.env.FILES ?? 500);

let server, core, files, models, plausibility, presets, states;

before(async () => {
  server = await createServer({ root: at(".."), server: { middlewareMode: true, ws: false }, appType: "custom", logLevel: "error" });
  const load = (path) => server.ssrLoadModule(path);
  const names = ["core", "robot-file", "model", "plausibility", "presets", "state"];
  [core, files, models, plausibility, presets, states] = await Promise.all(names.map((name) => load(`/src/${name}.ts`)));
  const packed = decompress(readFileSync(at("../generated/core.bin")));
  await (await load("/generated/bowstring_wasm.js")).default({ module_or_path: packed });
});
after(() => server.close());

/** Random numbers from 0 to 1 of a seed (mulberry32). */
function randomOf(seed) {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 4294967296;
  };
}

const pick = (random, list) => list[Math.floor(random() * list.length)];
const NUMBERS = ["0", "-0", "-1", "1e-320", "1e308", "1e400", "-1e400", "NaN", "Infinity", "0x10", "9".repeat(400),
  "1,5", "1_0", "--3", "1e", "", " ", "true", "null", ".nan", ".inf", "3 furlong", "1e-9", "7", "100", "5e13"];
const TOKENS = ["\0", "\ufeff", "\u001b[31m", "\r", "\n", "\t", '"', "'", "#", "{", "}", "[", "]", ": ", "- ", ",", "&", "=", "%", "%ff",
  "%E0%A4%A", "_", "__", "+", "*a", "&a ", "!!x ", "<<: *x", "\ud83c", "constructor", "__proto__", "[".repeat(500), "a".repeat(5000)];
const VALUES = [null, true, 0, -1, 1e308, -1e308, 5e-324, 1e-9, 0.5, 301, "", "x", "1", "nan", "a".repeat(5000), [], {}, [0], [[0]], [[]], { a: 1 },
  "1 m", "1e300 m", "1e-300 m", "1e308 Pa", "-1 N"];

/** A text with one to five kinds of damage. */
function damage(text, random) {
  for (let left = pick(random, [1, 1, 1, 2, 3, 5]); left > 0; left--) {
    const place = Math.floor(random() * (text.length + 1));
    const kind = Math.floor(random() * 6);
    if (kind <= 1) {
      const found = [...text.matchAll(/[-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?/gi)];
      if (found.length === 0) continue;
      const { index, 0: old } = pick(random, found);
      text = text.slice(0, index) + pick(random, NUMBERS) + text.slice(index + old.length);
    } else if (kind === 2) text = text.slice(0, place) + pick(random, TOKENS) + text.slice(place);
    else if (kind === 3) text = text.slice(0, place) + text.slice(place + pick(random, [1, 4, 16, 256]));
    else if (kind === 4) text = text.slice(0, place) + text.slice(place, place + 64).repeat(3) + text.slice(place + 64);
    else text = text.slice(0, place) + String.fromCharCode(Math.floor(random() * 256)) + text.slice(place + 1);
  }
  return text;
}

/** A copy of a tree with one to three nodes replaced, scaled, dropped, repeated or exchanged. */
function reshape(tree, random) {
  const holder = { tree: structuredClone(tree) };
  for (let left = pick(random, [1, 1, 2, 3]); left > 0; left--) {
    let [above, key] = [holder, "tree"];
    while (above[key] !== null && typeof above[key] === "object" && Object.keys(above[key]).length > 0 && random() < 0.9) {
      above = above[key];
      key = pick(random, Object.keys(above));
    }
    const value = above[key];
    const kind = pick(random, ["value", "value", "scale", "scale", "drop", "repeat", "exchange"]);
    if (kind === "value") above[key] = structuredClone(pick(random, VALUES));
    else if (kind === "scale" && typeof value === "number") above[key] = pick(random, [1, 1, -1]) * (value || 1) * 10 ** Math.round(30 * random() - 15);
    else if (kind === "drop") Array.isArray(above) ? above.splice(Number(key), 1) : delete above[key];
    else if (kind === "repeat" && Array.isArray(value)) above[key] = Array.from({ length: pick(random, [2, 50]) }, () => value).flat();
    else above[key] = structuredClone(above[pick(random, Object.keys(above))]);
  }
  return holder.tree;
}

/** Runs what may refuse its input: null where it does, by a sentence that the page can show. */
function tried(work, what) {
  try {
    return work();
  } catch (error) {
    assert.ok(error.constructor === Error || error instanceof files.RobotFileError, `${what}: ${error.stack}`);
    assert.ok(error.message.length > 0 && error.message.length < 500 && !/[\0-\x1f]/.test(error.message), `${what}: ${JSON.stringify(error.message.slice(0, 600))}`);
    return null;
  }
}

/** All numbers in a value, with their paths. */
function* numbersIn(value, path = "") {
  if (typeof value === "number") yield [path, value];
  else if (value !== null && typeof value === "object" && !ArrayBuffer.isView(value)) {
    for (const [key, inner] of Object.entries(value)) yield* numbersIn(inner, `${path}.${key}`);
  }
}

function checkNumbers(value, what) {
  for (const [path, x] of numbersIn(value)) {
    assert.ok(Number.isFinite(x) || (x === Infinity && path.endsWith(".axialStiffness")), `${what}: ${path} is ${x}`);
  }
}

/** Uses a model as the page does. */
function use(model, what) {
  const on = tried(() => core.bench(model), what);
  if (on === null) return false;
  checkNumbers({ ...model, text: "" }, what);
  const state = states.initial({ text: "", fileName: "" }, model);
  checkNumbers(state, what);
  for (const displacements of [false, true]) {
    const { tension, command } = states.boundsOf(model.geometry, displacements);
    assert.ok([tension, command, states.stepFor(tension)].every((x) => x > 0 && Number.isFinite(x)), `${what}: ${tension}, ${command}`);
  }
  for (const tensions of [state.tensions, state.tensions.map((_, i) => i + 1)]) {
    const loading = { displacements: false, commands: tensions, gravity: states.gravityOf(state), force: state.force };
    const pose = tried(() => core.solve(on, loading, true), what);
    if (pose === null || typeof pose === "string") continue;
    checkNumbers(pose.tip, what);
    for (const numbers of [on.disks(), on.tensions(), on.displacements(), on.slack(), on.backbone()]) checkNumbers([...numbers], what);
  }
  on.free();
  return true;
}

test("damaged links are read or refused", () => {
  const random = randomOf(1);
  let read = 0;
  const originals = presets.NAMES.map((name) => presets.modelFrom({ preset: name }));
  const links = originals.flatMap((model) => {
    const state = states.initial({ preset: model.name }, model);
    const numbers = files.mainNumbers(model.file);
    const other = { ...state, displacements: true, gravityOn: true, force: [1, -2, 0.5], numbers, stressColours: true };
    return [states.toHash(state), states.toHash(other)];
  });
  for (let trial = 0; trial < LINKS; trial++) {
    const hash = damage(pick(random, links), random);
    const source = tried(() => states.sourceOf(hash), `link ${trial}`);
    if (source === null) continue;
    const known = originals.find(({ name }) => name === source.preset);
    const model = known ?? tried(() => presets.modelFrom(source), `link ${trial}`);
    if (model === null) continue;
    const state = states.initial(source, model);
    tried(() => states.applyHash(hash, state), `link ${trial}`);
    checkNumbers(state, `link ${trial}, ${hash.slice(0, 300)}`);
    checkNumbers([states.gravityOf(state), states.commandsOf(state, model.geometry)], `link ${trial}`);
    if (state.numbers !== null) {
      const changed = tried(() => models.modelOf(files.withMainNumbers(model.file, state.numbers)), `link ${trial}`);
      if (changed !== null && trial % 8 === 0) use(changed, `link ${trial}, ${hash.slice(0, 300)}`);
    }
    const again = states.initial(source, model);
    states.applyHash(states.toHash(state), again);
    read++;
  }
  console.log(`  ${read} of ${LINKS} read`);
  assert.ok(read > LINKS / 4);
});

test("damaged robot files and compiled robots are read or refused", () => {
  const random = randomOf(2);
  let read = 0;
  const originals = presets.NAMES.map((name) => presets.modelFrom({ preset: name }));
  const texts = originals.map(({ file }) => files.writeRobotFile(file));
  const compiled = originals.map(({ text }) => JSON.parse(text));
  for (let trial = 0; trial < FILES; trial++) {
    const kind = random();
    const text = kind < 0.4 ? damage(pick(random, texts), random)
      : kind < 0.5 ? damage(JSON.stringify(pick(random, compiled)), random)
      : (JSON.stringify(reshape(pick(random, compiled), random)) ?? "");
    const model = tried(() => models.readModel(text, "robot.yaml"), `file ${trial}`);
    if (model === null) continue;
    if (model.file !== null) {
      checkNumbers(model.file, `file ${trial}`);
      plausibility.implausible(model.file);
    }
    if (use(model, `file ${trial}`)) read++;
  }
  console.log(`  ${read} of ${FILES} read`);
  assert.ok(read > FILES / 10);
});

test("sliders have bounds where tendons hold no tension and have no lever arm", () => {
  const model = presets.modelFrom({ preset: "amouri2019" });
  const tendons = model.geometry.tendons.map((t) => ({ ...t, mostTension: 0, holes: [[0, 0]] }));
  for (const displacements of [false, true]) {
    const { tension, command } = states.boundsOf({ ...model.geometry, tendons }, displacements);
    assert.ok(tension > 0 && command > 0 && states.stepFor(tension) > 0);
  }
});
