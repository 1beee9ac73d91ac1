/** State of the page: the robot, its commands and loads; and its text in the address. */

import type { Geometry, Model } from "./model";
import type { MainNumbers } from "./robot-file";

/** A robot that came as text, or a preset by its name. */
export type Source = { preset: string } | { text: string; fileName: string };

export interface State {
  source: Source;
  /** Whether commands are displacements (m); otherwise tensions (N). */
  displacements: boolean;
  tensions: number[];
  /** Commanded bend of each segment and its direction from x (rad), from which displacements follow. */
  bends: number[];
  gravityOn: boolean;
  /** Size of gravity where it is on (m/s^2). */
  gravitySize: number;
  /** Angle of gravity from -z (rad), and its direction from x (rad). */
  tilt: number;
  azimuth: number;
  /** Force on the tip (N). */
  force: number[];
  /** Tolerated tip error over the length. */
  tolerance: number;
  /** Numbers changed by the user; null where the robot is as in its file. */
  numbers: MainNumbers | null;
  stressColours: boolean;
  /** Whether the error vector is drawn `MAGNIFIED` times as long. */
  magnified: boolean;
}

const GRAVITY = 9.80665;

export function gravityOf(state: State): number[] {
  if (!state.gravityOn) return [0, 0, 0];
  const side = Math.sin(state.tilt) * state.gravitySize;
  return [side * Math.cos(state.azimuth), side * Math.sin(state.azimuth), -Math.cos(state.tilt) * state.gravitySize];
}

/** Commands of the tendons: tensions (N), or displacements (m) by constant curvature. */
export function commandsOf(state: State, { tendons, disks }: Geometry): number[] {
  if (!state.displacements) return state.tensions;
  return tendons.map(({ holes: [[x, y]], endDisk }) => {
    let sum = 0;
    for (let segment = 0; segment <= disks[endDisk].segment; segment++) {
      const [bend, direction] = state.bends.slice(2 * segment);
      sum += bend * (x * Math.cos(direction) + y * Math.sin(direction));
    }
    return sum;
  });
}

/** The state in which a robot starts. */
export function initial(source: Source, { gravity: [x, y, z], geometry }: Model): State {
  const size = Math.hypot(x, y, z);
  return {
    source,
    displacements: false,
    tensions: geometry.tendons.map(() => 0),
    bends: geometry.diameters.flatMap(() => [0, 0]),
    gravityOn: size > 0,
    gravitySize: size > 0 ? size : GRAVITY,
    tilt: size > 0 ? Math.acos(-z / size) : 0,
    azimuth: Math.atan2(y, x),
    force: [0, 0, 0],
    tolerance: 0.01,
    numbers: null,
    stressColours: false,
    magnified: false,
  };
}

/** Least bounds of sliders, of robots whose tendons hold no tension or have no lever arm (N, m). */
const LEAST_BOUND = 1e-6;

/** Bounds of the sliders: largest tension (N), and largest command (N or m). */
export function boundsOf({ tendons }: Geometry, displacements: boolean): { tension: number; command: number } {
  const nice = (most: number) => {
    const x = Math.max(most, LEAST_BOUND);
    const power = 10 ** Math.floor(Math.log10(x));
    return Math.ceil((x / power) * 2) * power / 2;
  };
  const tension = nice(0.5 * Math.max(...tendons.map((t) => t.mostTension)));
  const arm = Math.max(...tendons.map((t) => Math.hypot(...t.holes[0])));
  return { tension, command: displacements ? nice((2 * Math.PI * arm) / 3) : tension };
}

/** Step of a slider: 1, 2 or 5 times a power of ten, some hundreds of them to its end. */
export function stepFor(most: number): number {
  const least = most / 500;
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find((m) => m * power >= least)!;
}

/** Whether a link states commands. */
export function hasCommands(hash: string): boolean {
  const given = new URLSearchParams(hash);
  return given.has("tensions") || given.has("bends");
}

const MOST_LINK = 200_000;

function toBase64(text: string): string {
  let bytes = "";
  for (const byte of new TextEncoder().encode(text)) bytes += String.fromCharCode(byte);
  return btoa(bytes).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

function fromBase64(text: string): string {
  const bytes = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
  return new TextDecoder("utf-8", { fatal: true }).decode(Uint8Array.from(bytes, (c) => c.charCodeAt(0)));
}

/** The part of the address after "#". */
export function toHash(state: State): string {
  const { source } = state;
  const found = new URLSearchParams();
  const numbers = (values: number[]) => values.map((x) => Number(x.toPrecision(7))).join("_");
  if ("preset" in source) found.set("robot", source.preset);
  else {
    found.set("name", source.fileName);
    found.set("file", toBase64(source.text));
  }
  if (state.displacements) found.set("control", "displacement");
  if (state.displacements) found.set("bends", numbers(state.bends));
  else found.set("tensions", numbers(state.tensions));
  found.set("gravity", state.gravityOn ? numbers([state.tilt, state.azimuth]) : "none");
  if (state.force.some((x) => x !== 0)) found.set("force", numbers(state.force));
  found.set("tolerance", numbers([state.tolerance]));
  if (state.numbers !== null) {
    const { length, diameter, E, pitchRadius, disks } = state.numbers;
    found.set("numbers", numbers([length, diameter, E, pitchRadius, disks]));
  }
  if (state.stressColours) found.set("stress", "1");
  if (state.magnified) found.set("magnified", "1");
  return found.toString();
}

/** The robot that a link names; null without one. Throws where it cannot be read. */
export function sourceOf(hash: string): Source | null {
  if (hash.length > MOST_LINK) throw new Error("the link is too long to be one of this page");
  const given = new URLSearchParams(hash);
  const file = given.get("file");
  if (file !== null) {
    try {
      return { text: fromBase64(file), fileName: given.get("name") ?? "robot" };
    } catch {
      throw new Error("the robot in the link is damaged; was the link cut off?");
    }
  }
  const preset = given.get("robot");
  return preset === null ? null : { preset };
}

/** Sets what the link states; a damaged entry is named by the error, and the others are kept. */
export function applyHash(hash: string, state: State): void {
  const given = new URLSearchParams(hash);
  const row = (name: string, count: number, least: number, most: number): number[] | null => {
    const text = given.get(name);
    if (text === null) return null;
    const found = text.split("_").map(Number);
    const sound = found.length === count && found.every((x) => x >= least && x <= most);
    if (!sound) throw new Error(`"${name}" in the link is damaged; it must be ${count} numbers`);
    return found;
  };
  state.displacements = given.get("control") === "displacement";
  state.tensions = row("tensions", state.tensions.length, 0, 1e6) ?? state.tensions;
  state.bends = row("bends", state.bends.length, -7, 7) ?? state.bends;
  const gravity = given.get("gravity");
  if (gravity === "none") state.gravityOn = false;
  else if (gravity !== null) {
    [state.tilt, state.azimuth] = row("gravity", 2, -7, 7)!;
    state.gravityOn = true;
  }
  state.force = row("force", 3, -1e6, 1e6) ?? state.force;
  [state.tolerance] = row("tolerance", 1, 1e-5, 1) ?? [state.tolerance];
  const numbers = row("numbers", 5, 1e-9, 1e14);
  if (numbers !== null) {
    const [length, diameter, E, pitchRadius, disks] = numbers;
    if (!Number.isInteger(disks) || disks > 100) throw new Error('"numbers" in the link has no whole count of disks');
    state.numbers = { length, diameter, E, pitchRadius, disks };
  }
  state.stressColours = given.get("stress") === "1";
  state.magnified = given.get("magnified") === "1";
}
