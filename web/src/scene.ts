/** The robot as a solid in 3-D, and constant curvature as a translucent ghost. */

import {
  AmbientLight, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DirectionalLight, DynamicDrawUsage, GridHelper,
  Group, InstancedMesh, Matrix4, Mesh, MeshBasicMaterial, MeshStandardMaterial, PerspectiveCamera, Plane, Quaternion,
  Raycaster, Scene, SphereGeometry, Vector2, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import type { Geometry } from "./model";

const AROUND = 14;
/** Pieces of a slack span. */
const PIECES = 8;
const RAMP = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"].map((c) => new Color(c));
const ROD = new Color("#0b5fa5");
const GHOST = new Color("#e8590c");
const ERROR = new Color("#c2185b");
/** Distance from the tip at which a pointer takes hold of it (px). */
const GRIP = 30;
const TAUT = new Color("#2b2f36");
const SLACK = new Color("#8a1c7c");
const UP = new Vector3(0, 1, 0);

/** Colour of a share from 0 to 1. */
function ramp(share: number, into: Color): Color {
  const at = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const i = Math.min(Math.floor(at), RAMP.length - 2);
  return into.copy(RAMP[i]).lerp(RAMP[i + 1], at - i);
}

/** A tube of a fixed number of points, whose shape changes without allocation. */
class Tube {
  readonly mesh: Mesh<BufferGeometry, MeshStandardMaterial>;
  private readonly position: BufferAttribute;
  private readonly normal: BufferAttribute;
  private readonly color: BufferAttribute;
  private readonly vectors = Array.from({ length: 5 }, () => new Vector3());

  constructor(readonly count: number, material: MeshStandardMaterial) {
    const geometry = new BufferGeometry();
    const attribute = () => new BufferAttribute(new Float32Array(3 * AROUND * count), 3).setUsage(DynamicDrawUsage);
    [this.position, this.normal, this.color] = [attribute(), attribute(), attribute()];
    geometry.setAttribute("position", this.position);
    geometry.setAttribute("normal", this.normal);
    geometry.setAttribute("color", this.color);
    const index: number[] = [];
    for (let i = 0; i + 1 < count; i++) {
      for (let k = 0; k < AROUND; k++) {
        const [a, b] = [i * AROUND + k, i * AROUND + ((k + 1) % AROUND)];
        index.push(a, b, a + AROUND, b, b + AROUND, a + AROUND);
      }
    }
    geometry.setIndex(index);
    this.mesh = new Mesh(geometry, material);
    this.mesh.frustumCulled = false;
  }

  /** Bends it through points, every `stride` numbers of `points` one. */
  bend(points: Float64Array, stride: number, radius: (i: number) => number, colour: (i: number, into: Color) => void): void {
    const [tangent, side, other, here, next] = this.vectors;
    const at = (i: number, into: Vector3) => into.fromArray(points as unknown as number[], i * stride);
    const tint = new Color();
    side.set(1, 0, 0);
    for (let i = 0; i < this.count; i++) {
      at(i, here);
      // ends of modules occur twice, so look for the next other point
      let ahead = i;
      do ahead++;
      while (ahead < this.count && at(ahead, next).distanceToSquared(here) === 0);
      if (ahead < this.count) tangent.subVectors(next, here).normalize();
      // the side is carried along without twist
      side.addScaledVector(tangent, -side.dot(tangent)).normalize();
      other.crossVectors(tangent, side);
      colour(i, tint);
      for (let k = 0; k < AROUND; k++) {
        const angle = (2 * Math.PI * k) / AROUND;
        const [c, s] = [Math.cos(angle), Math.sin(angle)];
        const n = i * AROUND + k;
        const [nx, ny, nz] = [c * side.x + s * other.x, c * side.y + s * other.y, c * side.z + s * other.z];
        const r = radius(i);
        this.normal.setXYZ(n, nx, ny, nz);
        this.position.setXYZ(n, here.x + r * nx, here.y + r * ny, here.z + r * nz);
        this.color.setXYZ(n, tint.r, tint.g, tint.b);
      }
    }
    for (const attribute of [this.position, this.normal, this.color]) attribute.needsUpdate = true;
  }

  free(): void {
    this.mesh.geometry.dispose();
    this.mesh.material.dispose();
  }
}

/** What is drawn in one pose. */
export interface Drawing {
  backbone: Float64Array;
  disks: Float64Array;
  slack: Float64Array;
  stress: Float64Array;
  /** Stress at the end of the colours (Pa); 0 for plain colour. */
  mostStress: number;
  /** Poses of constant curvature, `GHOST_STEPS` in each segment; empty without. */
  ghost: Float64Array;
  /** Length of the error vector over the tip error. */
  magnification: number;
}

/** What a pointer does at the tip. */
export interface Pull {
  /** Whether the tip can be taken. */
  isOn: () => boolean;
  /** The point to which the tip is pulled (m). */
  to: (point: number[]) => void;
  end: () => void;
}

export const GHOST_STEPS = 24;

export class RobotScene {
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new PerspectiveCamera(40, 1, 0.001, 1000);
  private readonly orbit: OrbitControls;
  private readonly resize: ResizeObserver;
  private parts: Parts | null = null;
  /** The robot before, kept until the next one is drawn, so that its shader programs are used again. */
  private before: Parts | null = null;
  /** Resolved when the shader programs are linked, which can take seconds without a GPU; nothing is drawn before. */
  private linking: Promise<void> | null = null;
  private linked = false;
  /** While the tip is pulled: the plane in which it moves. */
  private plane: Plane | null = null;

  /** @throws Error where the browser has no WebGL. */
  constructor(private readonly into: HTMLElement, private readonly pull: Pull) {
    this.renderer = new WebGLRenderer({ antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.scene.background = new Color("#f7f9fb");
    this.scene.add(new AmbientLight("#ffffff", 1.6));
    for (const [x, y, z] of [[2, -3, 4], [-3, 2, 1]]) {
      const light = new DirectionalLight("#ffffff", 1.5);
      light.position.set(x, y, z);
      this.scene.add(light);
    }
    this.camera.up.set(0, 0, 1);
    const canvas = this.renderer.domElement;
    canvas.tabIndex = 0;
    canvas.setAttribute("aria-label", "Robot in 3-D; drag or use the arrow keys to turn it, + and - to zoom");
    into.append(canvas);
    this.orbit = new OrbitControls(this.camera, canvas);
    this.orbit.addEventListener("change", () => this.render());
    canvas.addEventListener("keydown", (event) => this.turn(event));
    // before the listener that turns the view
    into.addEventListener("pointerdown", (event) => this.take(event), { capture: true });
    canvas.addEventListener("pointermove", (event) => this.move(event));
    for (const name of ["pointerup", "pointercancel"] as const) canvas.addEventListener(name, () => this.drop());
    this.resize = new ResizeObserver(() => this.fit());
    this.resize.observe(into);
  }

  /** Turns or zooms the view by a key. */
  private turn(event: KeyboardEvent): void {
    const step = 0.1;
    const [azimuth, polar, zoom] = {
      ArrowLeft: [-step, 0, 1], ArrowRight: [step, 0, 1], ArrowUp: [0, -step, 1], ArrowDown: [0, step, 1],
      "+": [0, 0, 0.9], "-": [0, 0, 1 / 0.9],
    }[event.key] ?? [0, 0, 0];
    if (zoom === 0) return;
    event.preventDefault();
    const offset = this.camera.position.clone().sub(this.orbit.target).multiplyScalar(zoom);
    offset.applyAxisAngle(this.camera.up, azimuth);
    const side = new Vector3().crossVectors(this.camera.up, offset).normalize();
    offset.applyAxisAngle(side, polar);
    this.camera.position.copy(this.orbit.target).add(offset);
    this.orbit.update();
    this.render();
  }

  /** Position of a pointer, from -1 to 1 across the picture. */
  private place({ clientX, clientY }: PointerEvent): Vector2 {
    const { left, top, width, height } = this.renderer.domElement.getBoundingClientRect();
    return new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
  }

  /** Where the tip of the rod is in the picture (px from its corner); null without a robot. */
  tipInPicture(): [number, number] | null {
    if (this.parts === null) return null;
    const at = this.parts.tip.clone().project(this.camera);
    return [((at.x + 1) * this.into.clientWidth) / 2, ((1 - at.y) * this.into.clientHeight) / 2];
  }

  /** Takes the tip where the pointer is near it. */
  private take(event: PointerEvent): void {
    const tip = this.tipInPicture();
    if (tip === null || this.parts === null || !event.isPrimary || !this.pull.isOn()) return;
    const { left, top } = this.renderer.domElement.getBoundingClientRect();
    if (Math.hypot(event.clientX - left - tip[0], event.clientY - top - tip[1]) > GRIP) return;
    this.orbit.enabled = false;
    const across = this.camera.getWorldDirection(new Vector3());
    this.plane = new Plane().setFromNormalAndCoplanarPoint(across, this.parts.tip);
    this.renderer.domElement.setPointerCapture(event.pointerId);
  }

  private move(event: PointerEvent): void {
    const canvas = this.renderer.domElement;
    if (this.plane === null) {
      const tip = this.pull.isOn() ? this.tipInPicture() : null;
      const near = tip !== null && Math.hypot(event.offsetX - tip[0], event.offsetY - tip[1]) <= GRIP;
      canvas.style.cursor = near ? "grab" : "";
      return;
    }
    const ray = new Raycaster();
    ray.setFromCamera(this.place(event), this.camera);
    const point = ray.ray.intersectPlane(this.plane, new Vector3());
    if (point !== null) this.pull.to(point.toArray());
  }

  private drop(): void {
    if (this.plane === null) return;
    this.plane = null;
    this.orbit.enabled = true;
    this.pull.end();
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.into;
    if (width === 0 || height === 0) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.render();
  }

  /** Shows another robot. */
  show(geometry: Geometry, keepView: boolean): void {
    this.before?.free();
    this.before = this.parts;
    if (this.before !== null) this.scene.remove(this.before.group);
    this.parts = new Parts(geometry);
    this.scene.add(this.parts.group);
    this.linking ??= this.link();
    const { length } = geometry;
    if (keepView) return;
    this.camera.near = length / 100;
    this.camera.far = length * 100;
    // near, but with room at both sides for a robot that bends into the horizontal
    const [half, aspect] = [Math.tan((this.camera.fov * Math.PI) / 360), this.into.clientWidth / this.into.clientHeight || 1];
    const far = Math.max(1, 0.85 / (1.76 * half * aspect)) * length;
    this.camera.position.set(0.47 * far, -1.64 * far, 0.45 * length + 0.43 * far);
    this.orbit.target.set(0, 0, 0.45 * length);
    this.camera.updateProjectionMatrix();
    this.orbit.update();
  }

  private async link(): Promise<void> {
    if (this.renderer.extensions.has("KHR_parallel_shader_compile")) {
      await this.renderer.compileAsync(this.scene, this.camera);
    } else {
      // the first drawing blocks until the programs are linked; let the browser show the numbers before it
      await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
    }
    this.linked = true;
    this.render();
  }

  draw(drawing: Drawing): void {
    this.parts?.bend(drawing);
    this.render();
  }

  render(): void {
    // meshes without a pose have empty triangles, at which a renderer in software stops for minutes
    if (!this.linked || this.parts?.isBent !== true) return;
    this.renderer.render(this.scene, this.camera);
    this.before?.free();
    this.before = null;
  }

  /** The picture as PNG. */
  async picture(): Promise<Blob | null> {
    await this.linking;
    this.render(); // the buffer is empty after a frame
    return new Promise((done) => this.renderer.domElement.toBlob(done, "image/png"));
  }
}

/** Meshes of one robot. */
class Parts {
  readonly group = new Group();
  private readonly rod: Tube;
  private readonly ghost: Tube;
  private readonly disks: InstancedMesh;
  private readonly ghostDisks: InstancedMesh;
  private readonly tendons: InstancedMesh;
  /** Markers of the tips and the error vector, which nothing hides. */
  private readonly marks: { rod: Mesh; ghost: Mesh; error: Mesh };
  /** Tip of the rod. */
  readonly tip = new Vector3();
  private readonly points: number;
  private readonly matrix = new Matrix4();

  constructor(private readonly geometry: Geometry) {
    const { disks, tendons, diameters, length } = geometry;
    this.points = 5;
    this.rod = new Tube(this.points * disks.length, new MeshStandardMaterial({ vertexColors: true, roughness: 0.45 }));
    const translucent = () =>
      new MeshStandardMaterial({ color: GHOST, transparent: true, opacity: 0.55, depthWrite: false });
    const segments = diameters.length;
    this.ghost = new Tube(GHOST_STEPS * segments + 1, translucent());
    const cylinder = new CylinderGeometry(1, 1, 1, 40).rotateX(Math.PI / 2); // along z
    const grey = new MeshStandardMaterial({ color: "#aab4c0", roughness: 0.7, transparent: true, opacity: 0.92 });
    this.disks = new InstancedMesh(cylinder, grey, disks.length);
    this.ghostDisks = new InstancedMesh(cylinder, translucent(), segments);
    const thread = new CylinderGeometry(1, 1, 1, 6);
    const spans = tendons.reduce((sum, tendon) => sum + tendon.endDisk + 1, 0);
    this.tendons = new InstancedMesh(thread, new MeshStandardMaterial({ roughness: 0.6 }), spans * PIECES);
    const base = new Mesh(cylinder, new MeshStandardMaterial({ color: "#5d6875" }));
    const widest = Math.max(...disks.map((disk) => disk.radius));
    base.scale.set(1.15 * widest, 1.15 * widest, 0.03 * length);
    base.position.z = -0.015 * length;
    const grid = new GridHelper(2 * length, 20, "#9aa5b1", "#d5dce4");
    grid.rotation.x = Math.PI / 2;
    grid.position.z = -0.03 * length;
    for (const mesh of [this.disks, this.ghostDisks, this.tendons]) mesh.frustumCulled = false;
    const mark = (shape: BufferGeometry, color: Color, order: number, opacity = 1) => {
      const mesh = new Mesh(shape, new MeshBasicMaterial({ color, opacity, transparent: true, depthTest: false }));
      mesh.renderOrder = order;
      mesh.frustumCulled = false;
      return mesh;
    };
    const ball = (share: number) => new SphereGeometry(share * length, 20, 12);
    // the ghost's marker is larger, so that it shows behind the rod's
    this.marks = { ghost: mark(ball(0.024), GHOST, 1, 0.9), error: mark(thread, ERROR, 2), rod: mark(ball(0.015), ROD, 3) };
    this.group.add(this.rod.mesh, this.ghost.mesh, this.disks, this.ghostDisks, this.tendons, base, grid);
    this.group.add(...Object.values(this.marks));
  }

  isBent = false;

  bend({ backbone, disks, slack, stress, mostStress, ghost, magnification }: Drawing): void {
    const { geometry } = this;
    this.isBent = true;
    const radius = (segment: number) => Math.max(geometry.diameters[segment][0] / 2, geometry.length * 2e-3);
    if (backbone.length === 3 * this.rod.count) {
      const colour = (i: number, into: Color) => {
        if (mostStress > 0 && stress.length === this.rod.count) ramp(stress[i] / mostStress, into);
        else into.copy(ROD);
      };
      const of = (i: number) => geometry.disks[Math.floor(i / this.points)].segment;
      this.rod.bend(backbone, 3, (i) => radius(of(i)), colour);
    }
    geometry.disks.forEach((disk, i) => {
      this.disks.setMatrixAt(i, this.place(disks, i, disk.radius, Math.max(disk.thickness, geometry.length * 1e-3)));
    });
    this.disks.instanceMatrix.needsUpdate = true;
    this.drawTendons(disks, slack);
    this.tip.fromArray(disks as unknown as number[], disks.length - 12);
    this.marks.rod.position.copy(this.tip);
    const shown = ghost.length === 12 * this.ghost.count;
    for (const mesh of [this.ghost.mesh, this.ghostDisks, this.marks.ghost, this.marks.error]) mesh.visible = shown;
    if (!shown) return;
    this.marks.ghost.position.fromArray(ghost as unknown as number[], ghost.length - 12);
    const error = this.marks.ghost.position.clone().sub(this.tip).multiplyScalar(magnification);
    this.marks.error.position.copy(this.tip).addScaledVector(error, 0.5);
    this.marks.error.scale.set(geometry.length * 4e-3, Math.max(error.length(), 1e-9), geometry.length * 4e-3);
    this.marks.error.quaternion.setFromUnitVectors(UP, error.normalize());
    const segmentOf = (i: number) => Math.min(Math.floor(i / GHOST_STEPS), geometry.diameters.length - 1);
    // wider than the rod, so that it shows from all sides
    this.ghost.bend(ghost, 12, (i) => 1.6 * radius(segmentOf(i)), (_, into) => into.copy(GHOST));
    geometry.diameters.forEach((_, segment) => {
      const own = geometry.disks.filter((disk) => disk.segment === segment);
      const last = own[own.length - 1];
      const thick = 1.05 * Math.max(last.thickness, geometry.length * 1e-3);
      this.ghostDisks.setMatrixAt(segment, this.place(ghost, (segment + 1) * GHOST_STEPS, 1.05 * last.radius, thick));
    });
    this.ghostDisks.instanceMatrix.needsUpdate = true;
  }

  /** Matrix of a cylinder in pose `i` of rows of position and rotation. */
  private place(poses: Float64Array, i: number, radius: number, thickness: number): Matrix4 {
    const p = poses.subarray(12 * i, 12 * i + 12);
    // prettier-ignore
    return this.matrix.set(
      p[3] * radius, p[4] * radius, p[5] * thickness, p[0],
      p[6] * radius, p[7] * radius, p[8] * thickness, p[1],
      p[9] * radius, p[10] * radius, p[11] * thickness, p[2],
      0, 0, 0, 1,
    );
  }

  private drawTendons(disks: Float64Array, slack: Float64Array): void {
    const { geometry, tendons } = this;
    const thin = geometry.length * 1.3e-3;
    const [a, b, from, to, out, along] = Array.from({ length: 6 }, () => new Vector3());
    const [turn, size] = [new Quaternion(), new Vector3()];
    let used = 0;
    const piece = (colour: Color) => {
      along.subVectors(to, from);
      const length = along.length();
      turn.setFromUnitVectors(UP, along.normalize());
      size.set(thin, length, thin);
      this.matrix.compose(from.clone().addScaledVector(along, length / 2), turn, size);
      tendons.setMatrixAt(used, this.matrix);
      tendons.setColorAt(used, colour);
      used++;
    };
    geometry.tendons.forEach((tendon, t) => {
      const loose = slack[t] > 1e-6 * geometry.length;
      const spans = tendon.endDisk + 1;
      const hole = (plane: number, into: Vector3) => {
        const [x, y] = tendon.holes[Math.min(plane, tendon.holes.length - 1)];
        if (plane === 0) return into.set(x, y, 0);
        const p = disks.subarray(12 * (plane - 1), 12 * plane);
        return into.set(p[0] + p[3] * x + p[4] * y, p[1] + p[6] * x + p[7] * y, p[2] + p[9] * x + p[10] * y);
      };
      for (let k = 0; k < spans; k++) {
        hole(k, a);
        hole(k + 1, b);
        if (!loose) {
          from.copy(a);
          to.copy(b);
          piece(TAUT);
          continue;
        }
        // a flat arc that is longer than its chord by its share of the slack
        const chord = a.distanceTo(b);
        const sag = Math.sqrt((3 / 8) * chord * (slack[t] / spans));
        const centre = k === 0 ? new Vector3() : new Vector3(...disks.subarray(12 * (k - 1), 12 * (k - 1) + 3));
        out.copy(a).sub(centre).normalize();
        to.copy(a);
        for (let q = 1; q <= PIECES; q++) {
          const x = q / PIECES;
          from.copy(to);
          to.lerpVectors(a, b, x).addScaledVector(out, 4 * sag * x * (1 - x));
          piece(SLACK);
        }
      }
    });
    tendons.count = used;
    tendons.instanceMatrix.needsUpdate = true;
    if (tendons.instanceColor !== null) tendons.instanceColor.needsUpdate = true;
  }

  free(): void {
    this.rod.free();
    this.ghost.free();
    for (const mesh of [this.disks, this.ghostDisks, this.tendons, ...Object.values(this.marks)]) {
      mesh.geometry.dispose();
      (mesh.material as MeshBasicMaterial | MeshStandardMaterial).dispose();
      if (mesh instanceof InstancedMesh) mesh.dispose();
    }
  }
}
