"""CalculiX input deck for a mesh of bricks: model, steps, and restart.

Lengths are in mm, forces in N, stresses in MPa, masses in t and times in s: CalculiX has no units,
and these keep its numbers near 1.

A span of a tendon is a nonlinear spring whose force is independent of its elongation and
proportional to the temperature of its ends. The tension is thus a follower load between holes with
an exact tangent in CalculiX. Where a hole has a length, spans end in its entry plane and begin in
its exit plane; the piece between has no elongation. Each span begins at a separate node tied to the
hole, so that the printed force at that node is that of the span. A disk is a stiff layer of
backbone with stiff arms; the stiffness is a finite factor on Young's modulus. Its mass and inertia
are those of 12 point masses at the ends of four further arms. The weight of a payload is a dead
force at its centre of mass: forces on the ends of these arms, whose affine combination moves as the
centre does. Sliding disks have the axes of the unloaded backbone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from bowstring.aliases import Ints
from bowstring.fem.mass import disk_points, payload_centres
from bowstring.fem.mesh import BrickMesh
from bowstring.robot.model import Robot
from bowstring.robot.rest_shape import rest_frames

MM: Final = 1e3
"""Millimetres in a metre."""

_MPA: Final = 1e-6
_T: Final = 1e-3
_T_PER_MM3: Final = 1e-12
_LIGHT: Final = 1e-6  # density of arms over that of the backbone
_ACROSS: Final = 0.01  # transverse stiffness of a sliding disk over that of the backbone
_FAR: Final = 1e6  # mm, beyond any elongation
_LEAST: Final = 1e-4  # shortest increment over step


class Step(NamedTuple):
    """Step of the calculation, at the end of which its state is printed.

    Attributes
    ----------
    tensions : tuple of float (T,)
        Tensions at its end, in N.
    duration : float
        Duration in s; 0 for a static step, which takes a unit of CalculiX's time.
    first, longest : float
        First and longest increment over the step.
    """

    tensions: tuple[float, ...]
    duration: float = 0.0
    first: float = 1.0
    longest: float = 1.0

    @property
    def is_static(self) -> bool:
        """Whether the step solves statics, not a motion."""
        return self.duration == 0.0

    @property
    def span(self) -> float:
        """Duration in CalculiX's time."""
        return self.duration or 1.0


@dataclass(frozen=True)
class Loading:
    """Constants of all steps: dead loads (3,), grip of the disks, Newton criterion.

    ``damping`` is mass-proportional, in 1/s.
    """

    gravity: tuple[float, ...]
    """Gravitational acceleration (3,), m/s^2, base frame."""
    tip_force: tuple[float, ...]
    """Dead force at the tip (3,), N, base frame."""
    stiffness: float
    """Young's modulus of disks over that of the backbone."""
    bonded: bool
    """Whether disks and base also hold the backbone transversely."""
    residual: float
    """Force residual over mean force at which the Newton iteration ends."""
    damping: float = 0.0


class Spans(NamedTuple):
    """Springs of P spans: nodes ``first``, where the force is printed, and ``last``; disk, tendon.

    ``tied`` (P,) are the nodes of the holes to which the first nodes are tied, -1 at the base.
    """

    first: Ints
    last: Ints
    disk: Ints
    tendon: Ints
    tied: Ints


def spans(mesh: BrickMesh) -> Spans:
    """Spans of a mesh by tendon; tied nodes are numbered after those of the mesh."""
    rows = []
    new = len(mesh.nodes)
    for t in range(mesh.hole.shape[1]):
        for d in range(len(mesh.hole) - 1):
            here, there = int(mesh.hole_exit[d, t]), int(mesh.hole[d + 1, t])
            if there < 0:
                break
            if d == 0:
                rows.append((here, there, d, t, -1))
            else:
                rows.append((new, there, d, t, here))
                new += 1
    return Spans(*np.array(rows).T)


def model(robot: Robot, mesh: BrickMesh, loading: Loading, todo: Sequence[Step]) -> str:
    """Write the deck before its steps; disks have inertia if their mesh has arms for it.

    Parameters
    ----------
    robot : Robot
    mesh : BrickMesh
    loading : Loading
    todo : sequence of Step
        All steps: in motion the tensions over time are part of the model.
    """
    lines = [*_nodes(mesh), *_bricks(mesh), *_springs(mesh), *_masses(robot, mesh)]
    lines += _materials(robot, mesh, loading)
    if loading.damping > 0:  # for the whole model, although CalculiX expects it after a material
        lines += [f"*DAMPING, ALPHA={loading.damping:.10g}"]
    lines += _load_histories(todo)
    lines += [*_base(mesh, loading.bonded), "*BOUNDARY", "BASEHOLES,1,3"]
    lines += ["*INITIAL CONDITIONS, TYPE=TEMPERATURE", "NALL,0."]
    lines += ["*RESTART, WRITE, FREQUENCY=1"]
    return "\n".join(lines) + "\n"


def resume(done: int) -> str:
    """Write the restart after `done` steps, in place of the model."""
    return f"*RESTART, READ, STEP={done}\n*RESTART, WRITE, FREQUENCY=1\n"


def steps(robot: Robot, mesh: BrickMesh, loading: Loading, todo: Sequence[Step]) -> str:
    """Write the steps, each with tensions linear in time from those of the previous one.

    Steps in motion become a single one of CalculiX with several outputs, because it computes
    accelerations anew at the start of each step, which disturbs the motion.
    """
    lines: list[str] = []
    rest = list(todo)
    while rest and rest[0].is_static:
        lines += _step(robot, mesh, loading, [rest.pop(0)], then_motion=not todo[-1].is_static)
    if rest:
        lines += _step(robot, mesh, loading, rest)
    return "\n".join(lines) + "\n"


# -- model -------------------------------------------------------------------------------------


def _nodes(mesh: BrickMesh) -> Iterator[str]:
    tied = spans(mesh)
    own = tied.tied >= 0
    places = np.concatenate([mesh.nodes, mesh.nodes[tied.tied[own]]]) * MM
    yield "*NODE, NSET=NALL"
    for i, (x, y, z) in enumerate(places.tolist(), 1):
        yield f"{i},{x:.11g},{y:.11g},{z:.11g}"
    yield from _set("BASE", mesh.base)
    yield from _set("BASEHOLES", mesh.hole[0])
    yield from _set("BODY", np.arange(len(mesh.nodes)))
    yield from _set("SPANS", tied.first)
    for t in range(mesh.hole.shape[1]):
        here = tied.tendon == t
        yield from _set(f"TENDON{t + 1}", np.unique([*tied.first[here], *tied.last[here]]))


def _set(name: str, members: Ints, kind: str = "NSET") -> Iterator[str]:
    yield f"*{kind}, {kind}={name}"
    for i in range(0, len(members), 12):
        yield ",".join(str(v + 1) for v in members[i : i + 12].tolist()) + ","


def _parts(mesh: BrickMesh) -> Iterator[tuple[str, int, Ints]]:
    """Yield sets of bricks: name, segment, indices."""
    for k in range(int(mesh.part.max()) + 1):
        here = mesh.part == k
        yield f"FREE{k + 1}", k, np.flatnonzero(here & ~mesh.stiff)
        yield f"HELD{k + 1}", k, np.flatnonzero(here & mesh.stiff & ~mesh.arm)
        yield f"ARMS{k + 1}", k, np.flatnonzero(here & mesh.arm)


def _bricks(mesh: BrickMesh) -> Iterator[str]:
    for name, _, which in _parts(mesh):
        yield f"*ELEMENT, TYPE=C3D20R, ELSET={name}"
        for e in which.tolist():
            nodes = [str(v + 1) for v in mesh.bricks[e].tolist()]
            yield f"{e + 1}," + ",".join(nodes[:10]) + ","
            yield ",".join(nodes[10:])


def _springs(mesh: BrickMesh) -> Iterator[str]:
    found = spans(mesh)
    for t in range(mesh.hole.shape[1]):
        yield f"*ELEMENT, TYPE=SPRINGA, ELSET=LINE{t + 1}"
        for p in np.flatnonzero(found.tendon == t).tolist():
            yield f"{len(mesh.bricks) + 1 + p},{found.first[p] + 1},{found.last[p] + 1}"
    for node, hole in zip(found.first.tolist(), found.tied.tolist(), strict=True):
        if hole >= 0:
            for axis in (1, 2, 3):
                yield f"*EQUATION\n2\n{node + 1},{axis},1.,{hole + 1},{axis},-1."
    for t in range(mesh.hole.shape[1]):
        yield f"*SPRING, ELSET=LINE{t + 1}, NONLINEAR"
        yield ""
        yield f"0.,-{_FAR:.1f},0.\n0.,{_FAR:.1f},0."
        yield f"{_FAR:.1f},-{_FAR:.1f},{_FAR:.1f}\n{_FAR:.1f},{_FAR:.1f},{_FAR:.1f}"


def _masses(robot: Robot, mesh: BrickMesh) -> Iterator[str]:
    number = len(mesh.bricks) + len(spans(mesh).first)
    if mesh.mass_nodes.shape[1] == 0:
        return
    for i, masses in enumerate(disk_points(robot, mesh).tolist()):
        for k, mass in enumerate(masses):
            name = f"MASS{i + 1}_{k + 1}"
            if mass == 0:
                continue
            yield f"*ELEMENT, TYPE=MASS, ELSET={name}"
            for node in mesh.mass_nodes[i, :, k].tolist():
                number += 1
                yield f"{number},{node + 1}"
            yield f"*MASS, ELSET={name}"
            yield f"{_T * mass:.9g}"


def _base(mesh: BrickMesh, bonded: bool) -> Iterator[str]:
    """Write the constraints of the base: all displacements, or only the axial ones.

    In the latter case the mean transverse motion of its nodes is fixed (two displacements and a
    rotation), not the shape of the section. Fixing single nodes would deform and rotate it.
    """
    if bonded:
        yield "*BOUNDARY\nBASE,1,3"
        return
    yield "*BOUNDARY\nBASE,3,3"
    x, y = mesh.nodes[mesh.base, :2].T
    one, none = np.ones_like(x), np.zeros_like(x)
    means = np.concatenate([[one, none, -y], [none, one, x]], axis=1)
    # displacements of all nodes along x, then along y; one in each equation depends on the others
    count = len(x)
    decided = [int(y.argmax()), count + int(x.argmax()), count + int(x.argmin())]
    for place, row in zip(decided, np.linalg.solve(means[:, decided], means), strict=True):
        others = np.flatnonzero(np.abs(row) > 1e-9)
        terms = [place, *others[others != place].tolist()]
        yield f"*EQUATION\n{len(terms)}"
        for i in range(0, len(terms), 4):
            yield ",".join(
                f"{mesh.base[k % count] + 1},{k // count + 1},{row[k]:.12g}"
                for k in terms[i : i + 4]
            )


def _materials(robot: Robot, mesh: BrickMesh, loading: Loading) -> Iterator[str]:
    stiffness = loading.stiffness
    for name, k, which in _parts(mesh):
        rod = robot.segments[k].backbone
        young, poisson = rod.young * _MPA, rod.young / (2.0 * rod.shear_modulus) - 1.0
        density = (rod.density or 0.0) * _T_PER_MM3
        if not name.startswith("FREE"):
            young, poisson = stiffness * young, 0.0
        if name.startswith("ARMS"):
            density = _LIGHT * max(density, _T_PER_MM3)
        if len(which) == 0:
            continue
        yield f"*MATERIAL, NAME={name}"
        sliding = name.startswith("HELD") and not loading.bonded
        if sliding:
            # stiff axially and in shear, soft transversely
            soft = _ACROSS * rod.young * _MPA
            along = f"{soft:.10g},{soft:.10g},{young:.10g},0.,0.,0."
            yield f"*ELASTIC, TYPE=ENGINEERING CONSTANTS\n{along},{soft / 2:.10g},{young / 2:.10g}"
            yield f"{young / 2:.10g}"
        else:
            yield f"*ELASTIC\n{young:.10g},{poisson:.10g}"
        yield f"*DENSITY\n{density:.10g}"
        if sliding and robot.rest_curvature.any():
            yield from _turned_sections(robot, mesh, name, which)
        else:
            yield f"*SOLID SECTION, ELSET={name}, MATERIAL={name}"


def _turned_sections(robot: Robot, mesh: BrickMesh, name: str, which: Ints) -> Iterator[str]:
    """Write the sections of clamped bricks disk by disk, in the unloaded axes of each."""
    turned = rest_frames(robot, robot.disks.station_m)[1]
    below = np.flatnonzero(mesh.slice_module < 0)[::2]  # of the two stiff slices of each disk
    for d, (first, axes) in enumerate(zip(below.tolist(), turned, strict=True), 1):
        mine = np.intersect1d(mesh.slices[first : first + 2], which)
        if len(mine) == 0:
            continue
        x_and_y = ",".join(f"{v:.11g}" for v in axes[:, :2].T.ravel().tolist())
        yield f"*ORIENTATION, NAME={name}AXES{d}, SYSTEM=RECTANGULAR\n{x_and_y}"
        yield from _set(f"{name}DISK{d}", mine, "ELSET")
        yield f"*SOLID SECTION, ELSET={name}DISK{d}, MATERIAL={name}, ORIENTATION={name}AXES{d}"


def _load_histories(todo: Sequence[Step]) -> Iterator[str]:
    """Write tensions and outputs over CalculiX's total time; loads of a motion would jump."""
    if all(step.is_static for step in todo):
        return
    ends = np.cumsum([0.0] + [step.span for step in todo])
    for t in range(len(todo[0].tensions)):
        values = [0.0] + [step.tensions[t] for step in todo]
        yield f"*AMPLITUDE, NAME=COURSE{t + 1}, TIME=TOTAL TIME"
        for end, value in zip(ends.tolist(), values, strict=True):
            yield f"{end:.12g},{value:.10g}"
    yield "*TIME POINTS, NAME=OUTPUTS, TIME=TOTAL TIME"
    for end, step in zip(ends[1:].tolist(), todo, strict=True):
        if not step.is_static:
            yield f"{end:.12g}"


# -- steps -------------------------------------------------------------------------------------


def _step(
    robot: Robot,
    mesh: BrickMesh,
    loading: Loading,
    todo: Sequence[Step],
    *,
    then_motion: bool = False,
) -> Iterator[str]:
    step, period = todo[0], sum(one.span for one in todo)
    every = "FREQUENCY=1000000"  # only the last increment of a step
    if len(todo) > 1:
        every = "TIME POINTS=OUTPUTS"
    yield "*STEP, NLGEOM, INC=1000000"
    yield f"*CONTROLS, PARAMETERS=FIELD\n{loading.residual:.3g},1.,,,,,,"
    first, longest = step.first * step.span, step.longest * step.span
    times = (first, period, _LEAST * step.span, longest)
    yield "*STATIC" if step.is_static else "*DYNAMIC"
    yield ",".join(f"{t:.9g}" for t in times)
    for t, tension in enumerate(step.tensions, 1):
        if step.is_static:
            yield f"*TEMPERATURE\nTENDON{t},{tension:.10g}"
        else:
            yield f"*TEMPERATURE, AMPLITUDE=COURSE{t}\nTENDON{t},1."
    yield from _dead_loads(robot, mesh, loading)
    yield f"*NODE PRINT, NSET=BODY, {every}\n" + ("U" if step.is_static else "U,V")
    yield f"*NODE PRINT, NSET=SPANS, {every}\nRF"
    for name, _, which in _parts(mesh):
        if name.startswith("FREE") and len(which):
            # energies of a motion must be requested in the static step before it too
            yield f"*EL PRINT, ELSET={name}, {every}\n" + ("S,E,ENER" if then_motion else "S,E")
    yield "*END STEP"


def _dead_loads(robot: Robot, mesh: BrickMesh, loading: Loading) -> Iterator[str]:
    size = float(np.linalg.norm(loading.gravity))
    if size > 0:
        x, y, z = np.array(loading.gravity) / size
        yield "*DLOAD"
        for name, _, which in _parts(mesh):
            if len(which) and not name.startswith("ARMS"):
                yield f"{name},GRAV,{size * MM:.9g},{x:.9g},{y:.9g},{z:.9g}"
    forces = np.outer(robot.disks.mass_kg, loading.gravity)
    forces[-1] += loading.tip_force
    carried = np.zeros((len(mesh.nodes), 3))
    for mass, nodes, weight in payload_centres(robot, mesh):
        carried[nodes] += np.outer(weight, mass * np.array(loading.gravity))
    if not (forces.any() or carried.any()):
        return
    yield "*CLOAD"
    for node in np.flatnonzero(carried.any(axis=1)).tolist():
        for axis in np.flatnonzero(carried[node]).tolist():
            yield f"{node + 1},{axis + 1},{carried[node, axis]:.9g}"
    for row, force in zip(mesh.station_row, forces, strict=True):
        nodes = mesh.rows[row]
        for node in nodes.tolist():
            for axis in np.flatnonzero(force).tolist():
                yield f"{node + 1},{axis + 1},{force[axis] / len(nodes):.9g}"
