"""Fields of a mesh of bricks: quantities of the rod at each section, and stress at nodes.

A section is a plane of integration points; its forces are integrals of stress, independent of rod
theory. Positions and axes are those of the best-fitting plane through the corners of the bricks.
All values are in SI and in the base frame by default.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.fem.deck import spans
from bowstring.fem.elements import GAUSS, POINTS, brick_shape
from bowstring.fem.mass import gravity_energy, kinetic_energy
from bowstring.fem.mesh import BrickMesh
from bowstring.robot.model import Robot
from bowstring.statics.actuation import compliances
from bowstring.statics.fields import Frames

_OVER_TIME: Final = set(Frames.__dataclass_fields__) - {"time", "station", "module"}
VOIGT: Final = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Index of each component of a tensor in xx, yy, zz, xy, xz, yz."""
_ROW, _COLUMN = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)  # row and column of these in a tensor


@dataclass(frozen=True)
class State:
    """Results of a step: n nodes, f free bricks in the order of the mesh, P spans.

    ``displacement, velocity`` (n, 3), the latter None at rest; ``stress`` in Pa and ``strain``
    (f, 8, 6) at integration points, x first, as xx, yy, zz, xy, xz, yz; ``span_force`` (P, 3) at
    the base side of each span. As in CalculiX, stress is Cauchy's, in base axes, and strain is
    Green's, in the axes of the unloaded robot: see `strain_in_base`.
    """

    displacement: Floats
    velocity: Floats | None
    stress: Floats
    strain: Floats
    span_force: Floats


class SectionStress(NamedTuple):
    """Normal stress along the backbone on the outline of M sections between slices, in Pa.

    Attributes
    ----------
    module, arc_length : ndarray (M,)
        Module from 0 and arc length in m; the two edges of a disk belong to two modules.
    largest : ndarray (M,)
        Largest magnitude of the plane fitted to the nodes of the outline, which is the part of
        bending and tension, as in a rod.
    peak : ndarray (M,)
        Largest magnitude at a node, at disk edges with the stress concentration, which grows with
        refinement because the stress at the corner of a rigid clamp is singular.
    """

    module: Ints
    arc_length: Floats
    largest: Floats
    peak: Floats


def _planes(mesh: BrickMesh) -> tuple[Ints, Ints, Floats]:
    """Free slices (F,), module and arc length (2 F,) of the planes of integration points."""
    free = np.flatnonzero(mesh.slice_module >= 0)
    low, high = mesh.slice_z[free], mesh.slice_z[free + 1]
    middle, half = 0.5 * (low + high), 0.5 * GAUSS * (high - low)
    z = np.stack([middle - half, middle + half], axis=1).ravel()
    return free, np.repeat(mesh.slice_module[free], 2), z


def _fit(mesh: BrickMesh, values: Floats) -> Floats:
    """Affine fit of nodal values (n, 3) in each row: (rows, 3, 3), at the centre and by x and y."""
    x = mesh.straight[mesh.rows][..., :2]
    basis = np.concatenate([np.ones((*x.shape[:2], 1)), x], axis=2)
    found: Floats = np.linalg.pinv(basis) @ values[mesh.rows]
    return found


def _axes(along_x: Floats, along_y: Floats) -> Floats:
    """Rotations (..., 3, 3) whose first two columns are nearest to these vectors."""
    u, _, vt = np.linalg.svd(np.stack([along_x, along_y], axis=-1), full_matrices=False)
    plane = u @ vt
    normal = np.cross(plane[..., 0], plane[..., 1])
    return np.concatenate([plane, normal[..., None]], axis=-1)


def _at_planes(fit: Floats, free: Ints) -> Floats:
    """Interpolate values at the rows below, in and above slices to their planes of points."""
    s = np.array([-GAUSS, GAUSS])
    weight = np.stack([0.5 * s * (s - 1.0), 1.0 - s**2, 0.5 * s * (s + 1.0)], axis=1)
    rows = 2 * free[:, None] + np.arange(3)
    found: Floats = np.einsum("pk,fk...->fp...", weight, fit[rows])
    return found.reshape(-1, *fit.shape[1:])


def _section_forces(
    mesh: BrickMesh, state: State, free: Ints, centre: Floats
) -> tuple[Floats, Floats]:
    """Force and moment (2 F, 3) about the centres of the distal part on each plane."""
    bricks = mesh.bricks[mesh.slices[free]]  # (F, q, 20)
    number = np.cumsum(~mesh.stiff) - 1
    stress = state.stress[number[mesh.slices[free]]][..., VOIGT]  # (F, q, 8, 3, 3)
    place = (mesh.nodes + state.displacement)[bricks]
    value, slope = brick_shape(POINTS)
    x = np.einsum("pn,fqni->fqpi", value, place)
    by = np.einsum("pnk,fqni->fqpki", slope, place)
    area = np.cross(by[..., 0, :], by[..., 1, :])
    push = np.einsum("fqpij,fqpj->fqpi", stress, area)
    shape = (len(free), -1, 2, 4, 3)  # planes below and above, each of four points of a brick
    push, x = push.reshape(shape), x.reshape(shape)
    arm = x - centre.reshape(len(free), 1, 2, 1, 3)
    force = push.sum(axis=(1, 3)).reshape(-1, 3)
    return force, np.cross(arm, push).sum(axis=(1, 3)).reshape(-1, 3)


def span_tension(mesh: BrickMesh, state: State) -> Floats:
    """Tension (N, T) of spans from the forces at their ends, NaN where there is no span."""
    found = np.full((len(mesh.hole) - 1, mesh.hole.shape[1]), np.nan)
    which = spans(mesh)
    found[which.disk, which.tendon] = np.linalg.norm(state.span_force, axis=1)
    return found


def _span_lengths(mesh: BrickMesh, nodes: Floats) -> Floats:
    """Lengths (N, T) of the spans with the nodes (n, 3) of a mesh, NaN where there is no span."""
    there = mesh.hole[1:]
    apart = nodes[there] - nodes[mesh.hole_exit[:-1]]
    found: Floats = np.where(there >= 0, np.linalg.norm(apart, axis=2), np.nan)
    return found


def _lengths_in_holes(robot: Robot) -> Floats:
    """Length (T,) of each tendon in its holes, half of the last one, in m."""
    passed = np.cumsum(robot.disks.hole_length_m) - 0.5 * robot.disks.hole_length_m
    return np.asarray(passed[robot.tendons.end_disk])


def frames(
    robot: Robot,
    mesh: BrickMesh,
    time: Floats,
    tensions: Floats,
    states: Sequence[State],
    gravity: Sequence[float],
) -> Frames:
    """Raw output of the rod's form from bricks; NaN for quantities without a counterpart.

    Parameters
    ----------
    robot : Robot
    mesh : BrickMesh
    time : ndarray (K,)
    tensions : ndarray (K, T)
    states : sequence of State (K,)
    gravity : sequence of 3 floats
        Gravity of the run, in m/s^2.
    """
    free, module, station = _planes(mesh)
    rows: dict[str, list[Floats]] = {name: [] for name in _OVER_TIME}
    ends = robot.tendons.end_disk
    # with pretension the home pose differs, which bricks have not computed
    known = not robot.tendons.pretension_N.any()
    home = (
        np.nansum(_span_lengths(mesh, mesh.nodes), axis=0) if known else np.full(len(ends), np.nan)
    ) + _lengths_in_holes(robot)
    stretch = compliances(robot)  # displacements include the stretch, bricks do not
    for i, state in enumerate(states):
        moved = mesh.nodes + state.displacement
        fit = _fit(mesh, moved)
        planes = _at_planes(fit, free)
        rotation = _axes(planes[:, 1], planes[:, 2])
        force, moment = _section_forces(mesh, state, free, planes[:, 0])
        disk = fit[mesh.station_row]
        disk_rotation = _axes(disk[:, 1], disk[:, 2])
        lengths = _span_lengths(mesh, moved)
        whole = np.nansum(lengths, axis=0) + _lengths_in_holes(robot)
        velocity, spin = _motion(mesh, state, disk_rotation)
        rate = state.velocity
        kinetic = 0.0 if rate is None else kinetic_energy(robot, mesh, rate)
        unknown = np.array(np.nan)  # outputs are too far apart for integration
        for name, value in {
            "position": planes[:, 0],
            "rotation": rotation,
            "force": np.einsum("pji,pj->pi", rotation, force),
            "moment": np.einsum("pji,pj->pi", rotation, moment),
            "disk_position": disk[:, 0],
            "disk_rotation": disk_rotation,
            "disk_velocity": velocity,
            "disk_angular_velocity": spin,
            "tension": tensions[i],
            "tendon_length": whole,
            "span_length": lengths,
            "tendon_displacement": home - whole + stretch * tensions[i],
            "slack": np.zeros(len(ends)),
            "span_tension": span_tension(mesh, state),
            "kinetic_energy": np.array(kinetic),
            "elastic_energy": np.array(_elastic_energy(mesh, state)),
            "gravity_energy": np.array(gravity_energy(robot, mesh, moved, disk[:, 0], gravity)),
            "work": unknown,
            "dissipated_energy": unknown,
        }.items():
            rows[name].append(value)
    arrays = {name: np.array(values) for name, values in rows.items()}
    return Frames(time=np.asarray(time, float), station=station, module=module, **arrays)


def without_times(found: Frames) -> Frames:
    """Frames without any time, at the same stations."""
    values = vars(found)
    return Frames(**{n: v if n in ("station", "module") else v[:0] for n, v in values.items()})


def _motion(mesh: BrickMesh, state: State, rotation: Floats) -> tuple[Floats, Floats]:
    """Velocity and angular velocity (N, 3) of the disks."""
    if state.velocity is None:
        return np.zeros((len(rotation), 3)), np.zeros((len(rotation), 3))
    rate = _fit(mesh, state.velocity)[mesh.station_row]
    x, y, z = (rotation[..., k] for k in range(3))
    turn_x, turn_y = rate[:, 1], rate[:, 2]
    turn_z = np.cross(turn_x, y) + np.cross(x, turn_y)
    spin = 0.5 * (np.cross(x, turn_x) + np.cross(y, turn_y) + np.cross(z, turn_z))
    return rate[:, 0], spin


def _gradient(mesh: BrickMesh, state: State) -> tuple[Floats, Floats]:
    """Deformation gradient (f, 8, 3, 3) and volume (f, 8) of the points of the free bricks."""
    _, slope = brick_shape(POINTS)
    bricks = mesh.bricks[~mesh.stiff]
    unloaded = np.einsum("pnk,bni->bpik", slope, mesh.nodes[bricks])
    moved = np.einsum("pnk,bni->bpik", slope, state.displacement[bricks])
    return np.eye(3) + moved @ np.linalg.inv(unloaded), np.linalg.det(unloaded)


def strain_in_base(mesh: BrickMesh, state: State) -> Floats:
    """Green's strain (f, 8, 6) rotated with the material to base axes, like the stress."""
    u, _, vt = np.linalg.svd(_gradient(mesh, state)[0])
    turn = u @ vt
    strain = turn @ state.strain[..., VOIGT] @ np.swapaxes(turn, -1, -2)
    found: Floats = strain[..., _ROW, _COLUMN]
    return found


def _elastic_energy(mesh: BrickMesh, state: State) -> float:
    """Elastic energy of the free bricks: half of Green's strain times its conjugate stress."""
    gradient, volume = _gradient(mesh, state)
    back = np.linalg.inv(gradient)
    stress = back @ state.stress[..., VOIGT] @ np.swapaxes(back, -1, -2)  # second Piola-Kirchhoff's
    volume = volume * np.linalg.det(gradient)
    return float(0.5 * np.einsum("bp,bpij,bpij->", volume, stress, state.strain[..., VOIGT]))


def at_nodes(mesh: BrickMesh, values: Floats) -> Floats:
    """Extrapolate values (f, 8, k) at integration points to nodes (n, k) and average them.

    Each brick is fitted by functions linear across and along the backbone, which is the form of
    bending, also for bricks with round sides. Only free bricks are used, so that a disk edge shows
    the stress of the backbone; NaN at nodes without a free brick.
    """
    free = np.flatnonzero(~mesh.stiff)
    place = mesh.straight[mesh.bricks[free]]  # (f, 20, 3)
    centre = place.mean(axis=1, keepdims=True)
    size = np.ptp(place, axis=1, keepdims=True)
    points, _ = brick_shape(POINTS)
    here = _plane((np.einsum("pn,fni->fpi", points, place) - centre) / size)
    there = _plane((place - centre) / size)
    whole = there @ (np.linalg.pinv(here) @ values)
    total = np.zeros((len(mesh.nodes), values.shape[2]))
    count = np.zeros(len(mesh.nodes))
    nodes = mesh.bricks[free].ravel()
    np.add.at(total, nodes, whole.reshape(-1, values.shape[2]))
    np.add.at(count, nodes, 1.0)
    with np.errstate(invalid="ignore"):
        found: Floats = np.where(count[:, None] > 0, total / count[:, None], np.nan)
    return found


def _plane(place: Floats) -> Floats:
    """Products of 1, x, y and 1, z at places (f, p, 3)."""
    x, y, z = place[..., 0], place[..., 1], place[..., 2]
    one = np.ones_like(x)
    return np.stack([one, x, y, z, x * z, y * z], axis=-1)


def section_stress(mesh: BrickMesh, state: State) -> SectionStress:
    """Largest normal stress on the outline of each section between slices, and at their ends."""
    stress = at_nodes(mesh, state.stress)[:, VOIGT]
    fit = _fit(mesh, mesh.nodes + state.displacement)
    normal = _axes(fit[:, 1], fit[:, 2])[..., 2]
    plane = mesh.nodes[mesh.base]  # each row between slices begins at its first corner
    reach = np.hypot(*plane.T[:2])
    outline = np.flatnonzero(reach > 0.999 * reach.max())
    angle = np.arctan2(*plane[outline, 1::-1].T)
    basis = np.linalg.pinv(np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle)], axis=1))
    found = []
    for j in np.flatnonzero(mesh.slice_module >= 0).tolist():
        last = j + 1 == len(mesh.slice_module) or mesh.slice_module[j + 1] < 0
        for row in (2 * j, 2 * j + 2) if last else (2 * j,):
            n = normal[row]
            along = np.einsum("i,aij,j->a", n, stress[mesh.rows[row, 0] + outline], n)
            mean, by_x, by_y = basis @ along
            largest = abs(mean) + math.hypot(by_x, by_y)
            found.append((mesh.slice_module[j], mesh.slice_z[row // 2], largest, abs(along).max()))
    module, z, largest, peak = map(np.array, zip(*found, strict=True))
    return SectionStress(module, z, largest, peak)
