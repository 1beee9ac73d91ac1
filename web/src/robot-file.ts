/**
 * Robot files in the page: what they may contain here, and the numbers that the core takes.
 *
 * The page reads robots with straight round segments and tendons parallel to the backbone. All other
 * robots come compiled, by `bowstring export`.
 */

import { parseDocument, stringify } from "yaml";
import { quote, readQuantities, shortened } from "./units";

/** All numbers in SI. */
export interface Backbone {
  diameter: number;
  innerDiameter: number;
  E: number;
  /** Shear modulus. */
  G: number;
  density: number;
}

export interface Disks {
  /** Distances from the segment's start; the last is its length. */
  positions: number[];
  /** Whether the file gives their count, and not their positions. */
  even: boolean;
  mass: number;
  radius: number;
  thickness: number;
  clampedLength: number;
  holeLength: number;
}

export interface Tendon {
  angle: number;
  pitchRadius: number;
  pretension: number;
  /** Compliance of the transmission (m/N), without the tendon's own. */
  compliance: number;
  /** E A of the tendon (N); infinite for an inextensible one. */
  axialStiffness: number;
  freeLength: number;
}

export interface Segment {
  name: string;
  length: number;
  backbone: Backbone;
  disks: Disks;
  tendons: Tendon[];
}

export interface Payload {
  /** Counted from 0; the tip's disk where the file names none. */
  disk: number | null;
  mass: number;
  centre: number[];
  inertia: number[];
}

export interface RobotFile {
  name: string;
  description: string;
  gravity: number[];
  segments: Segment[];
  payloads: Payload[];
  /** A sentence of each law of the file that the page leaves out. */
  leftOut: string[];
}

/** The text was read, but is no robot of the page; the message is one sentence. */
export class RobotFileError extends Error {
  constructor(sentence: string) {
    super(sentence.replace(/\p{Cc}/gu, " ")); // a name or a value of the file may have line breaks
  }
}

const MOST_BYTES = 2_000_000;
/** Bounds of the work on a robot, of whatever file or link. */
export const MOST_DISKS = 300;
export const MOST_TENDONS = 100;
const COMPILE = "write it with \"bowstring export ROBOT --out robot.json\" and drop that file here";

const RELAXATION = "Relaxation of the backbone is left out.";
const CREEP = "Creep of the tendons is left out.";
const COMMANDS = "Gain and zero of the drives are left out: displacements are those of the tendons themselves.";
/**
 * Fields of laws that the page leaves out, memories and losses of displacement, with their size in a robot without the
 * law and the sentence of a robot with it.
 */
export const LAWS: Record<string, [number, string]> = {
  friction: [0, "Friction of the tendons is left out."],
  backlash: [0, "Backlash of the drives is left out."],
  hysteresis: [0, "Hysteresis of the backbone is left out."],
  relaxation: [0, RELAXATION],
  second_relaxation: [0, RELAXATION],
  creep_compliance: [0, CREEP],
  second_creep_compliance: [0, CREEP],
  hole_clearance: [0, "Clearance of the tendons in their holes is left out."],
  mount_compliance: [0, "Compliance of the drives' mount is left out."],
  gain: [1, COMMANDS],
  zero: [0, COMMANDS],
  decoupling: [0, "Decoupling of the drives is left out: displacements are those of whole tendons."],
  delay: [0, "Delay of the drives has no effect at rest."],
};
/** Fields of robots that come compiled; zero is as if they were left out. */
const COMPILED_ONLY = new Set(["rest_bend", "rest_twist", "turns"]);
/** Fields without an effect on the page. */
const WITHOUT_EFFECT = new Set([
  "width_direction", "rest_direction", // those of rectangular and of curved backbones
  "yield_strength", "strain_limit", "spool_radius", "diameter", "material", "hole_diameter",
  "hysteresis_play", "relaxation_time", "second_relaxation_time", "creep_time", "second_creep_time",
  "wrap_angle",
]);

/** Lengths along the robot; all others are across it, and less than 0.1 where they are in metres. */
const ALONG = new Set(["length", "positions", "free_length", "centre"]);

/** The number of a value, whatever its unit; NaN where it is none. */
function numberOf(value: unknown): number {
  return Number(/^([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)\s*[a-z/*^]*$/i.exec(String(value).trim())?.[1]);
}

/** A mapping of the file, read field by field; what is left at the end is refused. */
class Fields {
  private readonly left: Map<string, unknown>;

  /** @param leftOut Takes a sentence of each law that the page leaves out. */
  constructor(value: unknown, private readonly path: string, readonly leftOut: Set<string>) {
    if (typeof value !== "object" || value === null || Array.isArray(value)) {
      throw new RobotFileError(`${path || "the file"}: got ${quote(value)}; must be a mapping of fields`);
    }
    this.left = new Map(Object.entries(value));
  }

  private at(name: string): string {
    return this.path === "" ? shortened(name) : `${this.path}.${shortened(name)}`;
  }

  fail(name: string, what: string): never {
    throw new RobotFileError(`${this.at(name)}: ${what}`);
  }

  has(name: string): boolean {
    return this.left.has(name);
  }

  /** The value as it stands in the file. */
  take(name: string): unknown {
    const value = this.left.get(name);
    this.left.delete(name);
    return value;
  }

  text(name: string, otherwise: string): string {
    const value = this.take(name);
    return value === undefined || value === null ? otherwise : String(value).slice(0, 2000);
  }

  numbers(name: string, si: string, otherwise?: number[]): number[] {
    const value = this.take(name);
    if (value === undefined || value === null) {
      return otherwise ?? this.fail(name, "missing");
    }
    try {
      const found = readQuantities(value, si, ALONG.has(name) ? 3 : 0.1);
      if (found.every(Number.isFinite)) return found;
      this.fail(name, `got ${quote(value)}; must be finite`);
    } catch (error) {
      if (error instanceof RobotFileError) throw error;
      this.fail(name, (error as Error).message);
    }
  }

  /** A number from `least` to `most`, both allowed. */
  number(name: string, si: string, [least, most]: [number, number], otherwise?: number): number {
    const found = this.numbers(name, si, otherwise === undefined ? undefined : [otherwise]);
    if (found.length !== 1) this.fail(name, `got ${found.length} numbers; must be one`);
    // an infinite default is allowed
    if (!(found[0] >= least && (found[0] <= most || found[0] === otherwise))) {
      this.fail(name, `got ${found[0]} ${si}; must be from ${least} to ${most} ${si}`.replaceAll(" ;", ";"));
    }
    return found[0];
  }

  count(name: string, most: number): number {
    const value = this.take(name);
    if (typeof value !== "number" || !Number.isInteger(value) || value < 1 || value > most) {
      this.fail(name, `got ${quote(value)}; must be a whole number from 1 to ${most}`);
    }
    return value;
  }

  /** Refuses what was not read. */
  end(): void {
    for (const [name, value] of this.left) {
      if (COMPILED_ONLY.has(name) && numberOf(value) === 0) continue;
      if (name === "tendons_in" && value === "disks") continue;
      if (name === "kind" && value === "tendon") continue;
      if (WITHOUT_EFFECT.has(name)) continue;
      if (Object.hasOwn(LAWS, name)) {
        const [without, sentence] = LAWS[name];
        const size = numberOf(value);
        if (Number.isNaN(size)) this.fail(name, `got ${quote(value)}; must be a number`);
        if (size !== without) this.leftOut.add(sentence);
        continue;
      }
      this.fail(name, `the page does not read this field; ${COMPILE}`);
    }
  }
}

const SIZE: [number, number] = [1e-6, 100];

function readBackbone(value: unknown, path: string, leftOut: Set<string>): Backbone {
  const fields = new Fields(value, path, leftOut);
  const found = {
    diameter: fields.has("diameter")
      ? fields.number("diameter", "m", [1e-6, 10])
      : fields.fail("diameter", `missing: the page shows round backbones; of another one ${COMPILE}`),
    innerDiameter: fields.number("inner_diameter", "m", [0, 10], 0),
    E: fields.number("E", "Pa", [1, 1e13]),
    density: fields.number("density", "kg/m^3", [0, 1e5]),
  };
  if (fields.has("G") === fields.has("nu")) fields.fail("G", "write exactly one of G and nu");
  const G = fields.has("G")
    ? fields.number("G", "Pa", [0.1, 1e13])
    : found.E / (2 * (1 + fields.number("nu", "", [-0.99, 0.5])));
  fields.end();
  if (found.innerDiameter >= found.diameter) {
    fields.fail("inner_diameter", "must be less than diameter");
  }
  return { ...found, G };
}

function readDisks(value: unknown, length: number, path: string, leftOut: Set<string>): Disks {
  const fields = new Fields(value, path, leftOut);
  if (fields.has("count") === fields.has("positions")) {
    fields.fail("count", "write exactly one of count and positions");
  }
  const even = fields.has("count");
  const positions = even
    ? evenly(fields.count("count", MOST_DISKS), length)
    : fields.numbers("positions", "m");
  if (!even) {
    positions.forEach((x, i) => {
      if (x <= (i === 0 ? 0 : positions[i - 1])) fields.fail("positions", "must increase from above 0");
    });
    const last = positions.length - 1;
    if (Math.abs(positions[last] - length) > 1e-6 * length) {
      fields.fail("positions", "the last must be the segment's length");
    }
    positions[last] = length;
  }
  if (!fields.has("mass") && fields.has("density")) {
    fields.fail("density", `the page takes the mass of a disk; ${COMPILE}`);
  }
  const disks = {
    positions,
    even,
    mass: fields.number("mass", "kg", [0, 1e4]),
    radius: fields.number("radius", "m", SIZE),
    thickness: fields.number("thickness", "m", [0, 100]),
    clampedLength: fields.number("clamped_length", "m", [0, 100], 0),
    holeLength: fields.number("hole_length", "m", [0, 100], 0),
  };
  fields.end();
  return disks;
}

function evenly(count: number, length: number): number[] {
  return Array.from({ length: count }, (_, i) => (i + 1 === count ? length : (length * (i + 1)) / count));
}

function readTendon(fields: Fields, angle: number): Tendon {
  return {
    angle,
    pitchRadius: fields.number("pitch_radius", "m", [0, 100]),
    pretension: fields.number("pretension", "N", [0, 1e9], 0),
    compliance: fields.number("compliance", "m/N", [0, 1000], 0),
    axialStiffness: fields.number("axial_stiffness", "N", [1e-3, 1e12], Infinity),
    freeLength: fields.number("free_length", "m", [0, 1000], 0),
  };
}

const TURN: [number, number] = [-2 * Math.PI, 2 * Math.PI];

function readTendons(value: unknown, path: string, leftOut: Set<string>): Tendon[] {
  if (Array.isArray(value)) {
    return value.map((row, i) => {
      const fields = new Fields(row, `${path}[${i}]`, leftOut);
      const tendon = readTendon(fields, fields.number("angle", "rad", TURN));
      fields.end();
      return tendon;
    });
  }
  const fields = new Fields(value, path, leftOut);
  const count = fields.count("count", 100);
  const first = fields.number("first_angle", "rad", TURN, 0);
  const tendon = readTendon(fields, first);
  fields.end();
  const step = (2 * Math.PI) / count;
  return Array.from({ length: count }, (_, i) => ({ ...tendon, angle: first + i * step }));
}

function readSegment(value: unknown, path: string, leftOut: Set<string>): Segment {
  const fields = new Fields(value, path, leftOut);
  const length = fields.number("length", "m", [1e-6, 1000]);
  const segment = {
    name: fields.text("name", ""),
    length,
    backbone: readBackbone(fields.take("backbone"), `${path}.backbone`, leftOut),
    disks: readDisks(fields.take("disks"), length, `${path}.disks`, leftOut),
    tendons: readTendons(fields.take("tendons"), `${path}.tendons`, leftOut),
  };
  fields.end();
  const { backbone, disks, tendons } = segment;
  for (const { pitchRadius } of tendons) {
    const beside = pitchRadius > backbone.diameter / 2 && pitchRadius < disks.radius;
    if (!beside && pitchRadius >= backbone.innerDiameter / 2) {
      fields.fail(
        "tendons",
        "pitch_radius must lie between the backbone's surface and the radius of the disks, or in the bore of a tube",
      );
    }
  }
  let start = 0;
  for (const x of disks.positions) {
    if (x - start <= disks.clampedLength) fields.fail("disks", "clamped_length leaves no free backbone between disks");
    start = x;
  }
  return segment;
}

/**
 * A robot from the text of a robot file.
 *
 * @throws RobotFileError with one sentence.
 */
export function readRobotFile(text: string, fallbackName: string): RobotFile {
  if (text.length > MOST_BYTES) throw new RobotFileError(`the file has ${text.length} characters, which is no robot file`);
  let content: unknown;
  try {
    const document = parseDocument(text, { uniqueKeys: true, logLevel: "error" });
    const [fault] = [...document.errors, ...document.warnings]; // a tag that YAML does not know is a warning
    if (fault !== undefined) throw fault;
    content = document.toJS({ maxAliasCount: 0 });
  } catch (error) {
    const first = (error as Error).message.split("\n")[0].slice(0, 200);
    throw new RobotFileError(`the file is no YAML: ${first}`);
  }
  const leftOut = new Set<string>();
  const fields: Fields = new Fields(content, "", leftOut);
  const segments = fields.take("segments");
  if (!Array.isArray(segments) || segments.length === 0 || segments.length > 20) {
    fields.fail("segments", "must be a list of 1 to 20 segments");
  }
  const payloads = fields.take("payloads") ?? [];
  if (!Array.isArray(payloads)) fields.fail("payloads", "must be a list");
  const robot: RobotFile = {
    name: fields.text("name", fallbackName).slice(0, 100),
    description: fields.text("description", ""),
    gravity: fields.numbers("gravity", "m/s^2", [0, 0, 0]),
    leftOut: [],
    segments: segments.map((segment, i) => readSegment(segment, `segments[${i}]`, leftOut)),
    payloads: payloads.map((row, i) => {
      const each = new Fields(row, `payloads[${i}]`, leftOut);
      const payload = {
        disk: each.has("disk") ? each.count("disk", MOST_DISKS) - 1 : null,
        mass: each.number("mass", "kg", [0, 1e4]),
        centre: each.numbers("centre", "m", [0, 0, 0]),
        inertia: each.numbers("inertia", "kg*m^2", [0, 0, 0]),
      };
      each.end();
      return payload;
    }),
  };
  fields.end();
  robot.leftOut.push(...leftOut);
  if (robot.gravity.length !== 3) fields.fail("gravity", "must be three numbers, x y z");
  checkSize(robot);
  if (mainNumbers(robot).pitchRadius === 0) fields.fail("segments", "have no tendon beside the axis");
  return robot;
}

/** @throws RobotFileError where the work on the robot would be too much. */
function checkSize({ segments }: RobotFile): void {
  const [disks, tendons] = [
    segments.reduce((sum, segment) => sum + segment.disks.positions.length, 0),
    segments.reduce((sum, segment) => sum + segment.tendons.length, 0),
  ];
  if (disks > MOST_DISKS) throw new RobotFileError(`segments: have ${disks} disks; the page takes up to ${MOST_DISKS}`);
  if (tendons > MOST_TENDONS) {
    throw new RobotFileError(`segments: have ${tendons} tendons; the page takes up to ${MOST_TENDONS}`);
  }
}

/** The robot with other numbers in all its segments; disks stay evenly spaced. */
export interface MainNumbers {
  /** Length of the whole robot (m). */
  length: number;
  diameter: number;
  E: number;
  pitchRadius: number;
  /** Disks in each segment. */
  disks: number;
}

export function mainNumbers(robot: RobotFile): MainNumbers {
  const [first] = robot.segments;
  const tendons = robot.segments.flatMap((segment) => segment.tendons);
  return {
    length: robot.segments.reduce((sum, segment) => sum + segment.length, 0),
    diameter: first.backbone.diameter,
    E: first.backbone.E,
    pitchRadius: tendons.find((tendon) => tendon.pitchRadius > 0)?.pitchRadius ?? 0,
    disks: first.disks.positions.length,
  };
}

/**
 * A robot whose segments change in proportion, so that the first one has these numbers.
 *
 * @throws RobotFileError where that makes too many disks.
 */
export function withMainNumbers(robot: RobotFile, wanted: MainNumbers): RobotFile {
  const now = mainNumbers(robot);
  const factor = (name: Exclude<keyof MainNumbers, "disks">) => wanted[name] / now[name];
  const [long, thick, stiff, wide] = [factor("length"), factor("diameter"), factor("E"), factor("pitchRadius")];
  const segments = robot.segments.map((segment): Segment => {
    const { backbone, disks } = segment;
    const length = segment.length * long;
    const same = wanted.disks === now.disks;
    const positions = same
      ? disks.positions.map((x) => x * long)
      : evenly(Math.max(1, Math.round((disks.positions.length * wanted.disks) / now.disks)), length);
    positions[positions.length - 1] = length;
    return {
      ...segment,
      length,
      backbone: {
        ...backbone,
        diameter: backbone.diameter * thick,
        innerDiameter: backbone.innerDiameter * thick,
        E: backbone.E * stiff,
        G: backbone.G * stiff,
      },
      disks: { ...disks, positions, even: disks.even || !same, radius: disks.radius * wide },
      tendons: segment.tendons.map((t) => ({ ...t, pitchRadius: t.pitchRadius * wide })),
    };
  });
  const changed = { ...robot, segments };
  checkSize(changed);
  return changed;
}

/** Bending stiffness E I (N m^2). */
export function bendingStiffness({ E, diameter, innerDiameter }: Backbone): number {
  return E * (Math.PI / 64) * (diameter ** 4 - innerDiameter ** 4);
}

/** Text of the compiled robot, the layout of `bowstring export`. */
export function compiled(robot: RobotFile): string {
  let start = 0;
  let disksBefore = 0;
  const shortestArm = 1e-3 * robot.segments.reduce((sum, segment) => sum + segment.length, 0);
  const rows = robot.segments.map((segment, index) => {
    const { backbone, disks } = segment;
    const square = (d: number) => d * d;
    const area = (Math.PI / 4) * (square(backbone.diameter) - square(backbone.innerDiameter));
    const second = (Math.PI / 64) * (backbone.diameter ** 4 - backbone.innerDiameter ** 4);
    const from = start;
    start += segment.length;
    disksBefore += disks.positions.length;
    const [bending, end] = [bendingStiffness(backbone), disksBefore - 1];
    return {
      segment: {
        sections: [[
          bending, bending, 0, backbone.G * 2 * second, backbone.E * area, backbone.G * area,
          backbone.density * area, backbone.density * second, 0, 0, 0,
        ]],
        stiffness: null,
      },
      disks: disks.positions.map((x) => ({
        station_m: from + x,
        clamped_length_m: disks.clampedLength,
        hole_length_m: disks.holeLength,
        mass_kg: disks.mass,
        inertia_kg_m2: [
          (disks.mass * (3 * square(disks.radius) + square(disks.thickness))) / 12,
          (disks.mass * square(disks.radius)) / 2,
        ],
        segment: index,
      })),
      tendons: segment.tendons.map((t) => ({
        holes_m: [[t.pitchRadius * Math.cos(t.angle), t.pitchRadius * Math.sin(t.angle)]],
        end_disk: end,
        compliance_m_per_N: t.compliance + (t.freeLength + from + segment.length) / t.axialStiffness,
        pretension_N: t.pretension,
        max_tension_N: (Math.PI * bending) / (segment.length * Math.max(t.pitchRadius, shortestArm)),
      })),
    };
  });
  return JSON.stringify({
    format: "bowstring compiled robot",
    format_version: 1,
    tendon_path: "straight",
    segments: rows.map((row) => row.segment),
    disks: rows.flatMap((row) => row.disks),
    tendons: rows.flatMap((row) => row.tendons),
    payloads: robot.payloads.map((p) => ({
      disk: p.disk ?? disksBefore - 1,
      mass_kg: p.mass,
      centre_m: p.centre,
      inertia_kg_m2: p.inertia,
    })),
    gravity_m_per_s2: robot.gravity,
  });
}

/** Text of a robot file with these numbers. */
export function writeRobotFile(robot: RobotFile): string {
  const digits = (x: number) => String(Number(x.toPrecision(12)));
  const mm = (x: number) => `${digits(x * 1e3)} mm`;
  const optional = (name: string, value: number, none: number, text: string) =>
    value === none ? {} : { [name]: text };
  const content = {
    name: robot.name,
    ...(robot.description === "" ? {} : { description: robot.description }),
    ...(robot.gravity.some((g) => g !== 0) ? { gravity: `${robot.gravity.map(digits).join(" ")} m/s^2` } : {}),
    segments: robot.segments.map(({ name, length, backbone, disks, tendons }) => ({
      ...(name === "" ? {} : { name }),
      length: mm(length),
      backbone: {
        diameter: mm(backbone.diameter),
        ...optional("inner_diameter", backbone.innerDiameter, 0, mm(backbone.innerDiameter)),
        E: `${digits(backbone.E * 1e-9)} GPa`,
        G: `${digits(backbone.G * 1e-9)} GPa`,
        density: `${digits(backbone.density)} kg/m^3`,
      },
      disks: {
        ...(disks.even
          ? { count: disks.positions.length }
          : { positions: `${disks.positions.map((x) => digits(x * 1e3)).join(" ")} mm` }),
        mass: `${digits(disks.mass * 1e3)} g`,
        radius: mm(disks.radius),
        thickness: mm(disks.thickness),
        ...optional("clamped_length", disks.clampedLength, 0, mm(disks.clampedLength)),
        ...optional("hole_length", disks.holeLength, 0, mm(disks.holeLength)),
      },
      tendons: tendons.map((t) => ({
        angle: `${digits(((t.angle * 180) / Math.PI) % 360)} deg`, // a ring may go beyond a turn
        pitch_radius: mm(t.pitchRadius),
        ...optional("pretension", t.pretension, 0, `${digits(t.pretension)} N`),
        ...optional("compliance", t.compliance, 0, `${digits(t.compliance * 1e3)} mm/N`),
        ...optional("axial_stiffness", t.axialStiffness, Infinity, `${digits(t.axialStiffness)} N`),
        ...optional("free_length", t.freeLength, 0, mm(t.freeLength)),
      })),
    })),
    ...(robot.payloads.length === 0
      ? {}
      : {
          payloads: robot.payloads.map((p) => ({
            ...(p.disk === null ? {} : { disk: p.disk + 1 }),
            mass: `${digits(p.mass * 1e3)} g`,
            centre: `${p.centre.map((x) => digits(x * 1e3)).join(" ")} mm`,
            inertia: `${p.inertia.map((x) => digits(x * 1e6)).join(" ")} kg*mm^2`,
          })),
        }),
  };
  const head = ["Written by the Bowstring playground; all numbers are those of the page.", ...robot.leftOut];
  return `${head.map((line) => `# ${line}\n`).join("")}${stringify(content)}`;
}
