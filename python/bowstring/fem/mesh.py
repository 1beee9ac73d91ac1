"""Mesh of a robot: backbone, stiff layers where disks clamp it, stiff arms to the holes.

The bricks have 20 nodes and quadratic edges. A section of a solid backbone is an O-grid, a square
core in rings; that of a tube has rings only. The edges on the outline are parabolas through three
points of a circle, which is slightly larger than the backbone (0.04 % with 8 edges) so that the
second moment of area is exact. The arm to the hole of the first tendon is at the middle of an edge;
beside it, it would rotate the section where a disk is transversely soft.

The mesh is made with the backbone straight. If the backbone is curved or twisted without load, its
nodes are then moved by the unloaded frames, and those of an arm by the frame of its disk. All
values are in SI and in the base frame. Nodes and bricks are counted from 0. The order in a brick is
that of VTK (type 25) and, except for the order of writing, of CalculiX: corners below, corners
above, edges below, edges above, upright edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from bowstring.aliases import Bools, Floats, Ints
from bowstring.errors import InputError
from bowstring.fem.elements import MASS_POINTS, POINTS, brick_shape, quad_shape
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import Robot, check_disks, check_round, check_without_laws
from bowstring.robot.rest_shape import check_rest_bend, rest_frames
from bowstring.validation import is_whole, shown

_CORE: Final = 0.55  # half diagonal of the square core over radius, before rounding
_ROUND: Final = 0.5  # shape of the core from square (0) to circle (1)
_GRADE: Final = 1.5  # exponent of length/diameter in the ratio of middle to end bricks
_NEAR_HALF: Final = 0.49  # Poisson's ratio above which bricks of this kind lock


@dataclass(frozen=True)
class Fineness:
    """Fineness of a mesh.

    Attributes
    ----------
    module : int
        Number of bricks along the free backbone of each module; even, shorter towards the disks.
    around : int
        Number of bricks around the outline; a multiple of 4.
    rings : int
        Number of rings of bricks around the core, or through the wall of a tube.
    """

    module: int = 8
    around: int = 8
    rings: int = 1

    def check(self) -> None:
        """Raise `InputError` if a number is out of range."""
        for name, count in vars(self).items():
            if not is_whole(count):
                raise InputError(f"{name} is {shown(count)}, it must be a whole number")
        if not (2 <= self.module <= 200 and self.module % 2 == 0):
            raise InputError(
                f"the mesh has {self.module} bricks a module; must be an even number from 2 to 200"
            )
        if not (4 <= self.around <= 64 and self.around % 4 == 0):
            raise InputError(
                f"the mesh has {self.around} bricks around; must be a multiple of 4 from 4 to 64"
            )
        if not 1 <= self.rings <= 16:
            raise InputError(f"the mesh has {self.rings} rings; must be from 1 to 16")

    def __str__(self) -> str:
        return f"{self.module} x {self.around} x {self.rings}"


@dataclass(frozen=True)
class BrickMesh:
    """Mesh of N disks, T tendons and S slices of backbone, base to tip; made by `brick_mesh`.

    Attributes
    ----------
    nodes : ndarray (n, 3)
        Nodes of the unloaded robot.
    straight : ndarray (n, 3)
        Nodes with the backbone straight: x and y in the section, z along the backbone.
    bricks : ndarray of int (m, 20)
    part : ndarray of int (m,)
        Segment of each brick's backbone, from 0; `stiff` marks bricks clamped by a disk.
    stiff, arm : ndarray of bool (m,)
        Stiff bricks, and arms, which are stiff too. Bricks beyond the last disk's station count as
        arms, not as backbone.
    slices : ndarray of int (S, q)
        Bricks of each slice of the backbone; ``slice_z`` (S + 1,) are the arc lengths between them
        and ``slice_module`` (S,) the module of a free slice, -1 of a stiff one.
    rows : ndarray of int (2 S + 1, c)
        Nodes at the corners of each section, between slices and in their middle.
    base : ndarray of int
        Nodes of the clamped end.
    station_row : ndarray of int (N,)
        Row of each disk's station.
    hole : ndarray of int (N + 1, T)
        Nodes of the holes, those of the base first; -1 beyond a tendon's end. Where a hole has a
        length, the node in its entry plane.
    hole_exit : ndarray of int (N + 1, T)
        The same in the exit planes; those of `hole` where a hole is a point.
    mass_nodes : ndarray of int (N, 4, 3)
        Ends of the arms that carry a disk's mass: at x, y, -x, -y; below, at and above the station.
        Empty (N, 0, 3) without such arms.
    mass_height : ndarray (N,)
        Distance of the lower of these nodes below the station, m.
    """

    nodes: Floats
    straight: Floats
    bricks: Ints
    part: Ints
    stiff: Bools
    arm: Bools
    slices: Ints
    slice_z: Floats
    slice_module: Ints
    rows: Ints
    base: Ints
    station_row: Ints
    hole: Ints
    hole_exit: Ints
    mass_nodes: Ints
    mass_height: Floats


def brick_mesh(robot: Robot, fineness: Fineness, *, mass_arms: bool = False) -> BrickMesh:
    """Mesh a robot.

    Parameters
    ----------
    robot : Robot
    fineness : Fineness
    mass_arms : bool
        Whether each disk has four further arms, whose ends can carry its mass and inertia.

    Returns
    -------
    BrickMesh

    Raises
    ------
    InputError
        If bricks cannot represent the robot: disks without clamped length, a solid backbone beyond
        a tube, a Poisson's ratio near 0.5, holes too near the backbone for an arm.
    """
    fineness.check()
    check_meshable(robot)
    mesh = _Builder(robot, fineness, mass_arms).mesh()
    _check_bricks(robot, mesh)
    return mesh


def check_meshable(robot: Robot) -> None:
    """Raise `InputError` where a robot cannot be meshed; see `brick_mesh`."""
    check_round(robot, f"{robot.name}: a mesh")
    check_disks(robot, f"{robot.name}: a mesh")
    check_rest_bend(robot, "a mesh")
    holes = robot.tendons.holes_m[:, 0 if robot.is_parallel else 1 :]
    if np.any(2.0 * np.hypot(holes[..., 0], holes[..., 1]) < robot.disks.bore_m):
        raise InputError(
            f"{robot.name}: a tendon runs in the bore of its backbone; finite elements take holes "
            "beside the backbone only"
        )
    loose = [k for k, s in enumerate(robot.segments) if s.disks.clamped_length == 0]
    if loose:
        flags = [
            f'--set segments.{k}.disks.clamped_length="{1e3 * _hold(robot, k):g} mm"' for k in loose
        ]
        raise InputError(
            f"{robot.name}: segments[{loose[0]}].disks.clamped_length is 0, and a solid needs a "
            f"piece of backbone by which a disk holds it; for a glued disk add {' '.join(flags)}"
        )
    for k, s in enumerate(robot.segments):
        here = f"{robot.name}: segments[{k}]"
        nu = s.backbone.young / (2.0 * s.backbone.shear_modulus) - 1.0
        if not -0.9 <= nu <= _NEAR_HALF:
            raise InputError(
                f"{here}.backbone: E and G make Poisson's ratio {nu:.3g}; for finite elements it "
                f"must be from -0.9 to {_NEAR_HALF:g}"
            )
        bored = [s.backbone.at(place).inner_diameter > 0 for place in (0.0, 1.0)]
        if bored != 2 * [robot.segments[0].backbone.inner_diameter > 0]:
            raise InputError(
                f"{here}.backbone.inner_diameter: some pieces are tubes and others solid; "
                "finite elements need all of one kind"
            )
    check_without_laws(robot, ", which the finite elements do not model", but=OF_COMMANDS)


def _hold(robot: Robot, segment: int) -> float:
    """Clamped length of glued disks of a segment: their thickness, if given."""
    thickness = robot.segments[segment].disks.thickness
    return thickness or 0.6 * robot.segments[segment].backbone.outer_diameter


# -- one section -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Section:
    """Section of radius 1: `corners` and `edges` are in the order of the nodes of a plane.

    ``quads`` (q, 8): corners counter-clockwise, then their edges. ``outer`` (around, 3): corner,
    corner and edge on the outline. ``second_moment`` is that of this shape, about x.
    """

    corners: Floats
    edges: Floats
    quads: Ints
    outer: Ints
    second_moment: float

    @property
    def points(self) -> Floats:
        return np.concatenate([self.corners, self.edges])


@lru_cache(maxsize=256)
def _section(fineness: Fineness, bore: float, towards: float) -> _Section:
    """Make a section with the middle of an outline edge at an angle from x towards y."""
    around, rings = fineness.around, fineness.rings
    n = around // 4
    # upright, its core is a square between corners of the outline at 45 degrees
    turn = towards + (math.pi / around if n % 2 == 0 else 0.0)
    points: list[tuple[float, float]] = []
    quads: list[tuple[int, ...]] = []
    if bore == 0:
        grid = np.linspace(-1.0, 1.0, n + 1)
        points += [_core_point(u, v) for v in grid for u in grid]
        at = np.arange(len(points)).reshape(n + 1, n + 1)  # rows along x
        corners_of = np.stack([at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]], axis=-1)
        quads += map(tuple, corners_of.reshape(-1, 4).tolist())
        # counter-clockwise from -45 degrees
        inner = [*at[:-1, n], *at[n, :0:-1], *at[:0:-1, 0], *at[0, :-1]]
    angle = math.tau * (np.arange(around) / around - 1.0 / 8.0)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if bore > 0:
        inner = list(range(around))
        points += [(x, y) for x, y in bore * circle]
    start = np.array([points[i] for i in inner])
    for ring in range(1, rings + 1):
        share = ring / rings
        new = list(range(len(points), len(points) + around))
        points += [(x, y) for x, y in (1.0 - share) * start + share * circle]
        quads += [
            (inner[j], new[j], new[(j + 1) % around], inner[(j + 1) % around])
            for j in range(around)
        ]
        inner = new
    corners = np.array(points)
    radius = np.hypot(*corners.T)
    middle: dict[tuple[int, int], int] = {}
    edges: list[Floats] = []
    full = []
    for quad in quads:
        ids = []
        for a, b in zip(quad, (*quad[1:], quad[0]), strict=True):
            key = (min(a, b), max(a, b))
            if key not in middle:
                middle[key] = len(corners) + len(edges)
                point = 0.5 * (corners[a] + corners[b])
                on_circle = [r for r in (1.0, bore) if r > 0]
                for r in on_circle:
                    if abs(radius[a] - r) < 1e-9 and abs(radius[b] - r) < 1e-9:
                        point *= r / math.hypot(*point)
                edges.append(point)
            ids.append(middle[key])
        full.append([*quad, *ids])
    outer = np.array([[q[1], q[2], q[5]] for q in full[-around:]])
    turned = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    made = _Section(corners @ turned, np.array(edges) @ turned, np.array(full), outer, 0.0)
    return replace(made, second_moment=_second_moment(made))


def _core_point(u: float, v: float) -> tuple[float, float]:
    half = _CORE / math.sqrt(2.0) * (1.0 + _ROUND * (math.sqrt(2.0) - 1.0))
    return (
        half * u * math.sqrt(1.0 - 0.5 * _ROUND * v * v),
        half * v * math.sqrt(1.0 - 0.5 * _ROUND * u * u),
    )


def _second_moment(section: _Section) -> float:
    """Second moment of area about x, by Gauss points that are exact for these shapes."""
    place, weight = np.polynomial.legendre.leggauss(5)
    xi, eta = (g.ravel() for g in np.meshgrid(place, place))
    w = np.outer(weight, weight).ravel()
    n, nx, ny = quad_shape(xi, eta)
    x = section.points[section.quads]  # (q, 8, 2)
    jx, jy = np.einsum("ga,qai->gqi", nx, x), np.einsum("ga,qai->gqi", ny, x)
    area = jx[..., 0] * jy[..., 1] - jx[..., 1] * jy[..., 0]
    y = np.einsum("ga,qa->gq", n, x[..., 1])
    return float(np.einsum("g,gq,gq->", w, area, y * y))


# -- the whole ---------------------------------------------------------------------------------


@dataclass
class _Builder:
    robot: Robot
    fineness: Fineness
    mass_arms: bool
    nodes: list[Floats] = field(default_factory=list)
    bricks: list[list[int]] = field(default_factory=list)
    marks: list[tuple[int, bool, bool]] = field(default_factory=list)
    """Segment of each brick, whether it is stiff, and whether it is an arm."""
    arm_nodes: list[slice] = field(default_factory=list)
    """Nodes of the arms of each disk."""

    def mesh(self) -> BrickMesh:
        robot = self.robot
        levels, module = self._levels()
        x, y = robot.tendons.hole_m[0]
        towards = math.atan2(y, x)
        one, _ = self._scaled(0, 0.0, towards)
        n_corner, n_plane = len(one.corners), len(one.points)
        start = []  # first node of each row
        ends = np.cumsum([s.length for s in robot.segments])
        for i in range(2 * len(levels) - 1):
            z = levels[i // 2] if i % 2 == 0 else 0.5 * (levels[i // 2] + levels[i // 2 + 1])
            k = min(int(np.searchsorted(ends * (1 + 1e-12), z)), len(ends) - 1)
            segment = robot.segments[k]
            section, scale = self._scaled(k, 1.0 + (z - ends[k]) / segment.length, towards)
            points = scale * (section.points if i % 2 == 0 else section.corners)
            start.append(len(self.nodes))
            self.nodes += [np.array([x, y, z]) for x, y in points]
        beyond = len(levels) - 2  # the slice beyond the last station
        slices = []
        for j in range(len(levels) - 1):
            low, middle, high = start[2 * j], start[2 * j + 1], start[2 * j + 2]
            row = []
            k = int(np.searchsorted(ends * (1 + 1e-12), 0.5 * (levels[j] + levels[j + 1])))
            for quad in one.quads.tolist():
                row.append(len(self.bricks))
                c, e = quad[:4], quad[4:]
                rows_of = ((low, c), (high, c), (low, e), (high, e), (middle, c))
                self.bricks.append([first + v for first, nodes in rows_of for v in nodes])
                self.marks.append((min(k, len(ends) - 1), module[j] < 0, j == beyond))
            slices.append(row)
        stations = robot.disks.station_m
        station_row: Ints = 2 * np.abs(levels[None] - stations[:, None]).argmin(axis=1)
        count = len(self.nodes)
        hole, hole_exit, mass_nodes, height = self._arms(one, start, station_row)
        rows = np.array(start)[:, None] + np.arange(n_corner)
        part, stiff, arm = map(np.array, zip(*self.marks, strict=True))
        straight = np.array(self.nodes)
        return BrickMesh(
            nodes=self._unloaded(straight, count),
            straight=straight,
            bricks=np.array(self.bricks),
            part=part,
            stiff=stiff,
            arm=arm,
            slices=np.array(slices),
            slice_z=levels,
            slice_module=np.array(module),
            rows=rows,
            base=np.arange(n_plane),
            station_row=station_row,
            hole=hole,
            hole_exit=hole_exit,
            mass_nodes=mass_nodes,
            mass_height=height,
        )

    def _scaled(self, k: int, fraction: float, towards: float) -> tuple[_Section, float]:
        """Section at a fraction of a segment, and its size: it has the backbone's second moment."""
        rod = self.robot.segments[k].backbone.at(fraction)
        assert rod.diameter is not None
        section = _section(self.fineness, float(rod.inner_diameter / rod.diameter), towards)
        return section, float(rod.second_moment / section.second_moment) ** 0.25

    def _levels(self) -> tuple[Floats, list[int]]:
        """Arc lengths between slices, and the module of each slice."""
        disks, segments = self.robot.disks, self.robot.segments
        levels, module = [0.0], []
        for i, (z, c) in enumerate(zip(disks.station_m, disks.clamped_length_m, strict=True)):
            diameter = segments[disks.segment[i]].backbone.outer_diameter
            free = z - c / 2 - levels[-1]
            levels += (levels[-1] + free * _graded(self.fineness.module, free / diameter)).tolist()
            levels += [z, z + c / 2]
            module += [i] * self.fineness.module + [-1, -1]
        return np.array(levels), module

    def _arms(
        self, one: _Section, start: list[int], station_row: Ints
    ) -> tuple[Ints, Ints, Ints, Floats]:
        robot = self.robot
        disks, tendons = robot.disks, robot.tendons
        n, m = len(disks.station_m), len(tendons.end_disk)
        hole = np.full((n + 1, m), -1)
        places = np.broadcast_to(tendons.holes_m, (m, n + 1, 2))
        for t in range(m):
            hole[0, t] = self._add(np.array([*places[t, 0], 0.0]))
        leaves = hole.copy()
        masses = np.full((n, 4 if self.mass_arms else 0, 3), -1)
        half = 0.5 * np.maximum(disks.clamped_length_m, disks.thickness_m)
        for i in range(n):
            first = len(self.nodes)
            arm = partial(self._one_arm, one, start, int(station_row[i]), i)
            bored = 0.5 * float(disks.hole_length_m[i])
            for t in np.flatnonzero(tendons.end_disk >= i).tolist():
                below, at, above = arm(bored or half[i], places[t, i + 1])
                hole[i + 1, t], leaves[i + 1, t] = (below, above) if bored else (at, at)
            for a in range(masses.shape[1]):
                # four point masses at this radius have the inertia of the disk
                axial, mass = disks.inertia_kg_m2[i, 1], disks.mass_kg[i]
                reach = math.sqrt(axial / mass) if mass > 0 else disks.radius_m[i]
                end = reach * np.array([math.cos(a * math.pi / 2), math.sin(a * math.pi / 2)])
                masses[i, a] = arm(half[i], end)
            self.arm_nodes.append(slice(first, len(self.nodes)))
        return hole, leaves, masses, half

    def _unloaded(self, straight: Floats, backbone: int) -> Floats:
        """Move nodes with the unloaded frames; the first `backbone` ones are those of sections."""
        robot = self.robot
        if not robot.rest_curvature.any():
            return straight
        nodes: Floats = straight.copy()
        place, turned = rest_frames(robot, straight[:backbone, 2])
        nodes[:backbone] = place + np.einsum("nij,nj->ni", turned[..., :2], straight[:backbone, :2])
        stations = robot.disks.station_m
        for here, z, centre, axes in zip(
            self.arm_nodes, stations, *rest_frames(robot, stations), strict=True
        ):
            nodes[here] = centre + (straight[here] - [0.0, 0.0, z]) @ axes.T
        return nodes

    def _one_arm(
        self, one: _Section, start: list[int], row: int, disk: int, half: float, end: Floats
    ) -> list[int]:
        """Two bricks from the outline to a point; its nodes below, at and above the station."""
        middle = one.points[one.outer[:, 2]]
        face = int(np.argmax(middle @ end))
        a, b, edge = one.outer[face].tolist()
        first, last = start[row] + a, start[row] + b
        width = 0.5 * float(np.linalg.norm(self.nodes[first] - self.nodes[last]))
        along = end / np.hypot(*end)
        across = width * np.array([-along[1], along[0]])
        z = self.nodes[start[row]][2]
        # rows two below to two above: corners of the inner edge, then nodes of the arm
        layers: list[tuple[list[int], list[int]]] = []
        for k, shift in zip(range(-2, 3), (-1.0, -0.5, 0.0, 0.5, 1.0), strict=True):
            base = start[row + k]
            inner = [base + a, base + b]
            height = z + shift * half
            out = [self._add(np.array([*(end + s * across), height])) for s in (-1, 1)]
            if k % 2:
                layers.append((inner, out))
                continue
            tip = self._add(np.array([*end, height]))
            side = [
                self._add(0.5 * (self.nodes[p] + self.nodes[q]))
                for p, q in zip(inner, out, strict=True)
            ]
            layers.append(([*inner, base + edge], [*out, tip, *side]))
        for k in (0, 2):
            (il, ol), (im, om), (ih, oh) = layers[k : k + 3]
            corners = [il[0], ol[0], ol[1], il[1], ih[0], oh[0], oh[1], ih[1]]
            edges = [ol[3], ol[2], ol[4], il[2], oh[3], oh[2], oh[4], ih[2]]
            self.bricks.append([*corners, *edges, im[0], om[0], om[1], im[1]])
            self.marks.append((int(self.robot.disks.segment[disk]), True, True))
        return [layers[k][1][2] for k in (0, 2, 4)]

    def _add(self, point: Floats) -> int:
        self.nodes.append(point)
        return len(self.nodes) - 1


def _check_bricks(robot: Robot, mesh: BrickMesh) -> None:
    """Raise `InputError` if an arm is inverted because it ends too near the backbone."""
    points = POINTS
    if mesh.mass_nodes.size:  # mass arms end further out
        points = MASS_POINTS
    _, slope = brick_shape(points)
    place = mesh.nodes[mesh.bricks]
    least = np.linalg.det(np.einsum("pnk,bni->bpki", slope, place)).min(axis=1)
    if least.min() > 0:
        return
    worst = int(np.argmax(least <= 0))
    if not mesh.arm[worst]:
        raise InputError(
            f"{robot.name}: rest_bend and rest_twist turn the backbone too far in one brick; "
            "finite elements need more bricks a module"
        )
    z = mesh.straight[mesh.bricks[worst], 2].mean()
    disk = int(np.abs(robot.disks.station_m - z).argmin()) + 1
    raise InputError(
        f"{robot.name}: disk {disk} has a hole so near the backbone, or for motion and payloads is "
        "so small, that no brick fits between; finite elements need holes further out, and for "
        "motion and payloads disks 1.5 times as wide as the backbone or more"
    )


def _graded(count: int, slenderness: float) -> Floats:
    """Ends (count,) of `count` pieces of total length 1, shorter towards both ends."""
    steep = max(_GRADE * math.log(max(slenderness, 1.0)), 1e-6)
    t = np.linspace(0.0, 1.0, count // 2 + 1)
    half = 0.5 * np.expm1(steep * t) / math.expm1(steep)
    return np.concatenate([half[1:], 1.0 - half[-2::-1]])
