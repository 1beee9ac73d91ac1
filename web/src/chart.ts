/** Error curve of constant curvature over the command. */

import type { CurvePoint } from "./diagnosis";
import { short } from "./units";

const NAMESPACE = "http://www.w3.org/2000/svg";
const [WIDTH, HEIGHT] = [360, 190];
const [LEFT, RIGHT, TOP, BOTTOM] = [46, 8, 10, 40];

function element<K extends keyof SVGElementTagNameMap>(
  name: K,
  attributes: Record<string, string | number>,
  text = "",
): SVGElementTagNameMap[K] {
  const found = document.createElementNS(NAMESPACE, name);
  for (const [key, value] of Object.entries(attributes)) found.setAttribute(key, String(value));
  found.textContent = text;
  return found;
}

export interface ChartData {
  points: CurvePoint[];
  most: number;
  tolerance: number;
  /** The pose that is shown; null where its commands have no equilibrium. */
  now: CurvePoint | null;
  /** Name and unit of the command, and its factor from SI. */
  label: string;
  scale: number;
}

/** Tick distance of 1, 2 or 5 times a power of ten, for three to six ticks. */
function tick(most: number): number {
  const least = most / 6;
  const power = 10 ** Math.floor(Math.log10(least));
  return power * ([1, 2, 5].find((m) => m * power >= least) ?? 10);
}

export function drawChart(into: Element, data: ChartData): void {
  const { points, most, tolerance, now, label, scale } = data;
  const highest = 1.08e3 * Math.max(tolerance * 1.5, ...points.map((p) => p.error), now?.error ?? 0);
  const x = (command: number) => LEFT + ((WIDTH - LEFT - RIGHT) * command) / most;
  const y = (mm: number) => HEIGHT - BOTTOM - ((HEIGHT - TOP - BOTTOM) * mm) / highest;
  const svg = element("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", width: "100%" });
  svg.append(element("title", {}, `Tip error of constant curvature over ${label}`));
  const axis = { stroke: "#4a5564", "stroke-width": 1, fill: "none" };
  svg.append(element("path", { ...axis, d: `M${LEFT} ${TOP}V${HEIGHT - BOTTOM}H${WIDTH - RIGHT}` }));
  const stepX = tick(most * scale);
  for (let v = 0; v <= most * scale * 1.001; v += stepX) {
    const at = x(v / scale);
    svg.append(element("path", { ...axis, d: `M${at} ${HEIGHT - BOTTOM}v4` }));
    svg.append(element("text", { x: at, y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" }, short(v)));
  }
  const stepY = tick(highest);
  for (let v = 0; v <= highest; v += stepY) {
    svg.append(element("path", { ...axis, d: `M${LEFT - 4} ${y(v)}h4` }));
    svg.append(element("text", { x: LEFT - 7, y: y(v) + 4, "text-anchor": "end" }, short(v)));
  }
  svg.append(element("text", { x: (LEFT + WIDTH) / 2, y: HEIGHT - 6, "text-anchor": "middle" }, label));
  const up = `rotate(-90 11 ${HEIGHT / 2 - 15})`;
  svg.append(element("text", { x: 11, y: HEIGHT / 2 - 15, "text-anchor": "middle", transform: up }, "tip error, mm"));
  const limit = y(tolerance * 1e3);
  const red = { stroke: "#a3161a", "stroke-dasharray": "5 4", "stroke-width": 1.5 };
  svg.append(element("path", { ...red, d: `M${LEFT} ${limit}H${WIDTH - RIGHT}` }));
  svg.append(element("text", { x: WIDTH - RIGHT, y: limit - 4, "text-anchor": "end" }, "tolerance"));
  const path = points.map((p, i) => `${i === 0 ? "M" : "L"}${x(p.command).toFixed(2)} ${y(p.error * 1e3).toFixed(2)}`);
  svg.append(element("path", { d: path.join(""), stroke: "#0b5fa5", "stroke-width": 2, fill: "none" }));
  if (now !== null && now.command <= most * 1.001) {
    svg.append(element("circle", { cx: x(now.command), cy: y(now.error * 1e3), r: 5, fill: "#1b2430" }));
  }
  into.replaceChildren(svg);
}
