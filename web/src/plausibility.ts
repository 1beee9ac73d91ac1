/**
 * Valid numbers of a robot file that are probably mistakes: those of the package's
 * `bowstring.robot.plausibility` that a wrong unit makes, in the same words.
 */

import { bendingStiffness, type RobotFile, type Segment } from "./robot-file";
import { short } from "./units";

const STANDARD_GRAVITY = 9.80665;
/** Most turns by the robot's own weight as the tension of a tendon, and least bend by 1 kN (rad). */
const MOST_TURNS = 1;
const LEAST_BEND = Math.PI / 180;
const SLENDERNESS = [5, 5000];
const DENSITY = [100, 25_000];
const DISK_DENSITY = [20, 25_000];
/** Young's modulus of diamond (Pa). */
const MOST_E = 1.3e12;
const MOST_GRAVITY = 30;

const rounded = (x: number) => short(x, 2);

function metres(x: number): string {
  return Math.abs(x) >= 10 ? `${short(x, 4)} m` : `${short(x * 1e3, 4)} mm`;
}

function kilograms(x: number): string {
  return Math.abs(x) >= 1 ? `${short(x, 4)} kg` : `${short(x * 1e3, 4)} g`;
}

function pascals(x: number): string {
  const units: [string, number][] = [["GPa", 1e9], ["MPa", 1e6], ["kPa", 1e3]];
  const [unit, factor] = units.find(([, size]) => Math.abs(x) >= size) ?? ["Pa", 1];
  return `${short(x / factor, 4)} ${unit}`;
}

/** A warning for each implausible number. */
export function implausible(robot: RobotFile): string[] {
  const weight = STANDARD_GRAVITY * robot.segments.reduce((sum, segment) => sum + massOf(segment), 0);
  const found = robot.segments.flatMap((_, k) => [...inSegment(robot, k, weight)]);
  const size = Math.hypot(...robot.gravity);
  if (size > MOST_GRAVITY) {
    found.push(`gravity = ${short(size, 4)} m/s^2 in size: more than on any planet; is it in mm/s^2?`);
  }
  return found;
}

function massOf({ length, backbone, disks }: Segment): number {
  const area = (Math.PI / 4) * (backbone.diameter ** 2 - backbone.innerDiameter ** 2);
  return length * area * backbone.density + disks.positions.length * disks.mass;
}

function* inSegment(robot: RobotFile, k: number, weight: number): Generator<string> {
  const { length, backbone, disks } = robot.segments[k];
  const here = `segments[${k}]`;
  const arms = robot.segments.slice(k).flatMap(({ tendons }) => tendons.map((t) => t.pitchRadius));
  if (arms.length > 0) {
    const bend = (Math.max(...arms) * length) / bendingStiffness(backbone); // of 1 N (rad)
    yield* stiffness(here, backbone, (weight * bend) / (2 * Math.PI), bend, weight);
  }
  const slenderness = length / backbone.diameter;
  if (slenderness < SLENDERNESS[0] || slenderness > SLENDERNESS[1]) {
    const kind = slenderness < SLENDERNESS[0] ? "too thick for a rod" : "thinner than a hair";
    yield `${here}.length = ${metres(length)} with backbone.diameter = ${metres(backbone.diameter)}: ` +
      `length/diameter = ${rounded(slenderness)} is ${kind}; is one of the two in the wrong unit (m, mm)?`;
  }
  if (backbone.density !== 0 && (backbone.density < DENSITY[0] || backbone.density > DENSITY[1])) {
    yield `${here}.backbone.density = ${short(backbone.density, 4)} kg/m^3: no backbone material has it; ` +
      "is it in the wrong unit (kg/m^3, g/cm^3)?";
  }
  const mean = disks.mass / (Math.PI * disks.radius ** 2 * disks.thickness);
  if (Number.isFinite(mean) && mean !== 0 && (mean < DISK_DENSITY[0] || mean > DISK_DENSITY[1])) {
    yield `${here}.disks.mass = ${kilograms(disks.mass)}: a disk of this radius and thickness would have a ` +
      `density of ${rounded(mean)} kg/m^3; is the mass in ${mean > DISK_DENSITY[1] ? "g" : "kg"}?`;
  }
  const nu = backbone.E / (2 * backbone.G) - 1;
  if (!(nu > -1 && nu <= 0.5 + 1e-12)) {
    yield `${here}.backbone.G = ${pascals(backbone.G)} with E = ${pascals(backbone.E)} makes nu = ${rounded(nu)}, ` +
      "which no isotropic material has; is one of the two in the wrong unit (MPa, GPa)?";
  }
}

function* stiffness(
  here: string,
  { E, diameter }: { E: number; diameter: number },
  turns: number,
  bend: number,
  weight: number,
): Generator<string> {
  const where = `${here}.backbone.E = ${pascals(E)}`;
  if (E > MOST_E) {
    yield `${where}: stiffer than diamond; is the unit right (MPa, GPa)?`;
  } else if (turns > MOST_TURNS) {
    const meant = pascals(1000 * E);
    const guess = turns / 1000 <= MOST_TURNS && 1000 * E <= MOST_E
      ? `with ${meant} it would bend it by ${rounded((360 * turns) / 1000)} degrees: is ${meant} meant?`
      : `is the unit right (MPa, GPa), and diameter = ${metres(diameter)}?`;
    yield `${where} looks wrong: the robot's own weight (${rounded(weight)} N) as the tension of one tendon would ` +
      `wind the backbone ${rounded(turns)} times around; ${guess}`;
  } else if (1000 * bend < LEAST_BEND) {
    yield `${where} with diameter = ${metres(diameter)} looks wrong: 1 kN on one tendon would bend the segment by ` +
      "less than a degree; is one of the two in the wrong unit (GPa, MPa; mm, cm)?";
  }
}
