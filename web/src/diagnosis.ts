/** Where constant curvature leaves the tolerance, and what it leaves out. */

import { bench, constantCurvature, CurvatureLaw, distance, lawOf, solve, tipOf } from "./core";
import type { Loading, Playground, Point } from "./core";
import type { Model } from "./model";

export interface CurvePoint {
  /** Largest command at this point (N or m). */
  command: number;
  /** Tip error of constant curvature (m). */
  error: number;
}

export const CURVE_POINTS = 24;

/** Error curve along the direction of the commands, computed point by point. */
export class Curve {
  readonly points: CurvePoint[] = [];
  /** Why it ends before the last point. */
  ended = "";
  private readonly on: Playground;
  private readonly unit: number[];

  constructor(model: Model, private readonly loading: Loading, readonly most: number) {
    this.on = bench(model);
    const size = Math.max(...loading.commands.map(Math.abs));
    this.unit = loading.commands.map((c, i) => (size > 0 ? c / size : Number(i === 0)));
  }

  get isDone(): boolean {
    return this.ended !== "" || this.points.length > CURVE_POINTS;
  }

  /** Adds a point. */
  step(): void {
    const command = (this.most * this.points.length) / CURVE_POINTS;
    const commands = this.unit.map((u) => u * command);
    const loading = { ...this.loading, commands };
    const found = solve(this.on, loading);
    if (typeof found === "string") {
      this.ended = found;
      return;
    }
    const arcs = constantCurvature(this.on, lawOf(loading), commands, 1);
    if (typeof arcs === "string") {
      this.ended = arcs;
      return;
    }
    this.points.push({ command, error: distance(found.tip, tipOf(arcs)) });
  }

  /** Command at which the error first exceeds the tolerance (m); null where it does not. */
  crossing(tolerance: number): number | null {
    const { points } = this;
    for (const [i, { command, error }] of points.entries()) {
      if (error <= tolerance) continue;
      if (i === 0) return 0;
      const before = points[i - 1];
      const share = (tolerance - before.error) / (error - before.error);
      return before.command + share * (command - before.command);
    }
    return null;
  }

  free(): void {
    this.on.free();
  }
}

export interface Cause {
  name: string;
  /** Distance by which it moves the tip (m). */
  moves: number;
  advice: string;
}

/**
 * Effects that constant curvature leaves out, each by the tips of two models that differ in it alone.
 * From the simple model to the whole one, in this order.
 */
export function causes(model: Model, loading: Loading): Cause[] {
  const on = bench(model);
  try {
    const tips: [string, Point | null, string][] = [];
    const add = (name: string, tip: Point | string | null, advice: string) => {
      tips.push([name, typeof tip === "string" ? null : tip, advice]);
    };
    const arcs = (law: CurvatureLaw) => {
      const found = constantCurvature(on, law, loading.commands, 1);
      return typeof found === "string" ? null : tipOf(found);
    };
    const rod = (gravity: number[], force: number[]) => {
      const found = solve(on, { ...loading, gravity, force }, true);
      return typeof found === "string" ? null : found.tip;
    };
    const none = [0, 0, 0];
    add("", arcs(lawOf(loading)), "");
    if (!loading.displacements) {
      add(
        "straight tendon spans",
        arcs(CurvatureLaw.LeverArm),
        "Tendons run straight between the disks, so their lever arm is shorter than constant curvature takes it. " +
          "More disks shrink this; so does the law with the mean lever arm.",
      );
    }
    add(
      loading.displacements ? "mechanics of rod and tendons" : "shear, extension and bend within the modules",
      rod(none, none),
      loading.displacements
        ? "Constant curvature takes the bend from tendon lengths alone; the rod balances the forces of all tendons."
        : "The bend is not the same everywhere along the backbone; use the rod.",
    );
    if (loading.gravity.some((g) => g !== 0)) {
      add("gravity", rod(loading.gravity, none), "Constant curvature has no weight; use the rod, or a stiffer or lighter robot.");
    }
    if (loading.force.some((f) => f !== 0)) {
      add("tip force", rod(loading.gravity, loading.force), "Constant curvature has no load on the tip; use the rod.");
    }
    const found: Cause[] = [];
    let last = tips[0][1];
    for (const [name, tip, advice] of tips.slice(1)) {
      if (tip === null) continue;
      if (last !== null) found.push({ name, moves: distance(tip, last), advice });
      last = tip;
    }
    return found;
  } finally {
    on.free();
  }
}
