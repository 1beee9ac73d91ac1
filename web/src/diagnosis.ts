/** Where constant curvature leaves the tolerance, and the causes. */

import { bench, constantCurvature, CurvatureLaw, deadLoads, distance, Effect, lawOf, solve, tipOf } from "./core";
import type { Loading, Playground, Point } from "./core";
import type { Model } from "./model";
import { short } from "./units";

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
    const point = this.at((this.most * this.points.length) / CURVE_POINTS);
    if (typeof point === "string") this.ended = point;
    else this.points.push(point);
  }

  /** The point at a command, or the reason why there is none. */
  private at(command: number): CurvePoint | string {
    const commands = this.unit.map((u) => u * command);
    const loading = { ...this.loading, commands };
    const found = solve(this.on, loading);
    if (typeof found === "string") return found;
    const arcs = constantCurvature(this.on, lawOf(loading), commands, 1);
    return typeof arcs === "string" ? arcs : { command, error: distance(found.tip, tipOf(arcs)) };
  }

  /**
   * The least command found within `time` (ms) at which the error is more than the tolerance (m). Half of the largest
   * command with an equilibrium where the error is never more, and where it is more in the home pose.
   */
  outside(tolerance: number, time: number): number {
    const end = performance.now() + time;
    while (!this.isDone && performance.now() < end) this.step();
    const { points } = this;
    const first = points.findIndex(({ error }) => error > tolerance);
    if (first <= 0) return (points.at(-1)?.command ?? 0) / 2;
    let [within, outside] = [points[first - 1].command, points[first].command];
    while (outside - within > 1e-3 * outside && performance.now() < end) {
      const point = this.at((within + outside) / 2);
      if (typeof point === "string") break;
      if (point.error > tolerance) outside = point.command;
      else within = point.command;
    }
    return outside;
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

/** An effect that constant curvature leaves out. */
export interface Cause {
  /** The key of the package, such as "straight_spans". */
  effect: string;
  name: string;
  /** Error of constant curvature without this effect (m). */
  without: number;
  /** (error - without) / error; effects interact, so that shares need not add up to one. */
  share: number;
  advice: string;
}

/** Error of constant curvature (m), and its causes, the largest share first. */
export interface Diagnosis {
  error: number;
  causes: Cause[];
}

interface Removal {
  effect: string;
  name: string;
  /** Error without the effect (m); null where it does not act, and where there is no equilibrium. */
  without: () => number | null;
  advice: string;
}

/**
 * The causes of the error of constant curvature: each effect removed from the rod alone.
 *
 * Effects and shares are those of `bowstring.validity.effects`. Under displacements what concerns the lengths of
 * tendons is removed by giving constant curvature other lengths.
 */
export function diagnose(model: Model, loading: Loading): Diagnosis {
  const on = bench(model);
  try {
    const arcs = constantCurvature(on, lawOf(loading), loading.commands, 1);
    const whole = solve(on, loading, true);
    if (typeof arcs === "string" || typeof whole === "string") return { error: NaN, causes: [] };
    const given = tipOf(arcs);
    const error = distance(whole.tip, given);
    if (!(error > 1e-9 * model.geometry.length)) return { error, causes: [] };
    const causes: Cause[] = [];
    for (const { without: errorWithout, ...cause } of removals(on, loading, model.geometry.length, whole.tip, given)) {
      const without = errorWithout();
      if (without !== null) causes.push({ ...cause, without, share: (error - without) / error });
    }
    causes.sort((a, b) => b.share - a.share);
    return { error, causes };
  } finally {
    on.free();
  }
}

/** The effects, given the tips of the rod and of constant curvature. */
function removals(on: Playground, loading: Loading, length: number, ofRod: Point, ofArcs: Point): Removal[] {
  const { displacements, commands, gravity, force } = loading;
  const inRod = (effect: Effect) => () => {
    const tip = on.tipWithout(effect, displacements, Float64Array.from(commands), deadLoads(loading));
    return tip.length === 0 ? null : distance([tip[0], tip[1], tip[2]], ofArcs);
  };
  const byArcs = (law: CurvatureLaw, given: number[]) => {
    const arcs = constantCurvature(on, law, given, 1);
    return typeof arcs === "string" ? null : distance(tipOf(arcs), ofRod);
  };
  const displaced = [...on.pathDisplacements()]; // of the pose, which other solves replace
  const load = (acts: boolean, change: Partial<Loading>) => () => {
    const found = acts ? solve(on, { ...loading, ...change }, true) : "";
    return typeof found === "string" ? null : distance(found.tip, ofArcs);
  };
  const acts = (vector: number[]) => vector.some((x) => x !== 0);
  const none = [0, 0, 0];
  return [
    {
      effect: "straight_spans",
      name: "tendons straight between the disks",
      // a continuous tendon has no displacements: the arcs take the spans as they are
      without: displacements ? () => byArcs(CurvatureLaw.Chords, commands) : inRod(Effect.StraightSpans),
      advice: displacements
        ? "A straight span is shorter than the arc that constant curvature takes. More disks shrink this."
        : "The lever arm of a straight span is shorter than constant curvature takes it. " +
          "More disks shrink this; so does the law with the mean lever arm.",
    },
    {
      effect: "clamps",
      name: "clamped lengths at the disks",
      without: inRod(Effect.Clamps),
      advice: displacements
        ? "Within its clamps the backbone stays straight, and constant curvature bends all of it. " +
          "Shorter clamps shrink this; or use the rod."
        : "Within its clamps the backbone stays straight, and constant curvature bends all of it. " +
          "Multiply its bend by the share of the length that is not clamped; or use the rod.",
    },
    {
      effect: "hole_planes",
      name: "entry and exit planes of the holes",
      without: inRod(Effect.HolePlanes),
      advice: "Tendons bend at both ends of a hole and not in its middle. Shorter holes shrink this; or use the rod.",
    },
    {
      effect: "shear_extension",
      name: "shear and extension",
      without: inRod(Effect.ShearExtension),
      advice: "The backbone shears and changes its length under the tendons; use the rod.",
    },
    {
      effect: "torsion",
      name: "torsion",
      without: inRod(Effect.Torsion),
      advice: "The backbone twists, and constant curvature only bends; use the rod.",
    },
    {
      effect: "tendon_lengths",
      name: "slack or elastic tendons",
      without: () => {
        const apart = Math.max(...displaced.map((x, i) => Math.abs(x - commands[i])));
        return displacements && apart > 1e-6 * length ? byArcs(CurvatureLaw.Lengths, displaced) : null;
      },
      advice: "The lengths of the tendons' paths are not those commanded: slack tendons lie loose, elastic ones stretch. " +
        "Use the rod, or more pretension.",
    },
    {
      effect: "gravity",
      name: "gravity",
      without: load(acts(gravity), { gravity: none }),
      advice: "Constant curvature has no weight; use the rod, or a stiffer or lighter robot.",
    },
    {
      effect: "tip_force",
      name: "tip force",
      without: load(acts(force), { force: none }),
      advice: "Constant curvature has no load on the tip; use the rod.",
    },
  ];
}

/** The study's limits: of an effect that is named as a cause, and of the dominant cause. */
const WORTH_NAMING = 0.1;
const DOMINANT = 0.5;

/** The cause in sentences, as the study words it; empty where there is nothing to explain. */
export function advice({ error, causes }: Diagnosis, length: number): string {
  const [worst, ...others] = causes;
  if (worst === undefined || !(error > 1e-6 * length)) return "";
  const rest = `${short(worst.without * 1e3)} mm`;
  if (worst.share <= 0) {
    return "No effect is to blame alone: without any one of them the error is as large or larger.";
  }
  if (worst.share < WORTH_NAMING) {
    return `No single effect explains the error: without ${worst.name}, which has the largest share, it would still be ${rest}.`;
  }
  const label = worst.share > DOMINANT ? "Dominant cause" : "Largest contribution";
  const rivals = others.filter(({ share }) => share > 0.5 * worst.share).map(({ name }) => name);
  const more = rivals.length === 0 ? "" : ` Nearly as much: ${rivals.join(", ")}.`;
  return `${label}: ${worst.name}; without this effect the error would be ${rest}. ${worst.advice}${more}`;
}
