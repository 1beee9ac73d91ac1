/** A robot of the page: what the core takes, and the shape that is drawn. */

import { compiled, MOST_DISKS, MOST_TENDONS, readRobotFile, RobotFileError, type RobotFile } from "./robot-file";
import { quote } from "./units";

export interface Geometry {
  length: number;
  disks: { station: number; radius: number; thickness: number; segment: number }[];
  /** Outer and inner diameter of each segment's backbone (m). */
  diameters: [number, number][];
  /** Whether these are from the file; otherwise they are guessed for the picture. */
  known: boolean;
  tendons: { holes: number[][]; endDisk: number; mostTension: number }[];
}

export interface Model {
  name: string;
  /** The robot file; null for a compiled robot. */
  file: RobotFile | null;
  /** Text of the compiled robot. */
  text: string;
  geometry: Geometry;
  gravity: number[];
}

interface CompiledContent {
  segments: { sections: number[][] }[];
  disks: { station_m: number; segment: number; clamped_length_m: number }[];
  tendons: { holes_m: number[][]; end_disk: number; max_tension_N: number }[];
  gravity_m_per_s2: number[];
}

/** Robot of a robot file. */
export function modelOf(file: RobotFile): Model {
  const text = compiled(file);
  const content = JSON.parse(text) as CompiledContent;
  const segments = file.segments;
  return {
    name: file.name,
    file,
    text,
    gravity: file.gravity,
    geometry: {
      ...geometryOf(content),
      diameters: segments.map(({ backbone }) => [backbone.diameter, backbone.innerDiameter]),
      disks: content.disks.map((disk) => ({
        station: disk.station_m,
        segment: disk.segment,
        radius: segments[disk.segment].disks.radius,
        thickness: segments[disk.segment].disks.thickness,
      })),
      known: true,
    },
  };
}

function geometryOf(content: CompiledContent): Geometry {
  const { disks, tendons } = content;
  const widest = Math.max(...tendons.flatMap((t) => t.holes_m.map(([x, y]) => Math.hypot(x, y))), 0);
  const length = disks[disks.length - 1].station_m;
  return {
    length,
    disks: disks.map((disk) => ({
      station: disk.station_m,
      segment: disk.segment,
      radius: 1.15 * widest,
      thickness: Math.max(disk.clamped_length_m, (0.05 * length) / disks.length),
    })),
    // of a full circle with this ratio of bending to axial stiffness
    diameters: content.segments.map(({ sections: [[bending, , , , axial]] }) => [4 * Math.sqrt(bending / axial), 0]),
    known: false,
    tendons: tendons.map((t) => ({ holes: t.holes_m, endDisk: t.end_disk, mostTension: t.max_tension_N })),
  };
}

/**
 * Robot from the text of a robot file or of a compiled robot.
 *
 * @throws RobotFileError with one sentence.
 */
export function readModel(text: string, fileName: string): Model {
  const plain = fileName.replace(/\.[^.]*$/, "") || "robot";
  if (!text.trimStart().startsWith("{")) return modelOf(readRobotFile(text, plain));
  let content: Partial<CompiledContent> & { format?: unknown };
  try {
    content = JSON.parse(text);
  } catch {
    return modelOf(readRobotFile(text, plain)); // YAML may begin with a brace, too
  }
  if (content.format === undefined) return modelOf(readRobotFile(text, plain));
  if (content.format !== "bowstring compiled robot") {
    throw new RobotFileError(`format: got ${quote(content.format)}; must be "bowstring compiled robot"`);
  }
  const { disks, tendons, segments } = content;
  if (!disks?.length || !segments?.length || !tendons?.length) {
    throw new RobotFileError("the compiled robot has no segments, disks or tendons");
  }
  for (const [name, { length }, most] of [["segments", segments, MOST_DISKS], ["disks", disks, MOST_DISKS], ["tendons", tendons, MOST_TENDONS]] as const) {
    if (length > most) throw new RobotFileError(`${name}: the compiled robot has ${length}; the page takes up to ${most}`);
  }
  try {
    const geometry = geometryOf(content as CompiledContent);
    return { name: plain, file: null, text, geometry, gravity: content.gravity_m_per_s2 ?? [0, 0, 0] };
  } catch {
    throw new RobotFileError("the compiled robot is damaged; write it again with bowstring export");
  }
}
