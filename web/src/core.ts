/** The core in WebAssembly. */

import { decompress } from "fzstd";
import init, { CurvatureLaw, Effect, Playground } from "../generated/bowstring_wasm.js";
import packed from "../generated/core.bin?url";
import type { Model } from "./model";

export { CurvatureLaw, Effect, Playground };

/** Loads the core; it comes compressed, whatever the server does. */
export async function loadCore(): Promise<void> {
  const response = await fetch(packed);
  if (!response.ok) throw new Error(`its file was not found (${response.status})`);
  const module = decompress(new Uint8Array(await response.arrayBuffer()));
  await init({ module_or_path: module as Uint8Array<ArrayBuffer> });
}

/** A robot in its home pose; the caller frees it. */
export function bench(model: Model): Playground {
  const found = new Playground(model.text);
  if (model.geometry.known) {
    const radii = (which: 0 | 1) => Float64Array.from(model.geometry.diameters, (pair) => pair[which] / 2);
    found.setRadii(radii(0), radii(1));
  }
  return found;
}

/** Commands and dead loads of a solve. */
export interface Loading {
  displacements: boolean;
  commands: number[];
  gravity: number[];
  force: number[];
}

export function deadLoads({ gravity, force }: Loading): Float64Array {
  return Float64Array.from([...gravity, ...force, 0, 0, 0]);
}

export type Point = [number, number, number];

export interface Pose {
  tip: Point;
  sentence: string;
  /** Estimated discretisation error of the tip (m). */
  error: number;
}

/** Solves; null with the reason where there is no equilibrium. From home where the path fails. */
export function solve(on: Playground, loading: Loading, cold = false): Pose | string {
  const commands = Float64Array.from(loading.commands);
  const loads = deadLoads(loading);
  let solved = on.solve(loading.displacements, commands, loads, cold);
  if (!solved.converged && !cold) {
    const again = on.solve(loading.displacements, commands, loads, true);
    if (again.converged) solved = again;
  }
  if (!solved.converged) return solved.sentence;
  return { tip: tipOf(on.disks()), sentence: solved.sentence, error: solved.error };
}

export function tipOf(poses: Float64Array): Point {
  const at = poses.length - 12;
  return [poses[at], poses[at + 1], poses[at + 2]];
}

/** Poses of constant curvature, or the reason why there are none. */
export function constantCurvature(on: Playground, law: CurvatureLaw, commands: number[], steps: number): Float64Array | string {
  try {
    return on.constantCurvature(law, Float64Array.from(commands), steps);
  } catch (error) {
    return (error as Error).message;
  }
}

export function lawOf(loading: Loading): CurvatureLaw {
  return loading.displacements ? CurvatureLaw.Lengths : CurvatureLaw.Linear;
}

export function distance(a: Point, b: Point): number {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}
