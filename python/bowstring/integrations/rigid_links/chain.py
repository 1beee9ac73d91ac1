"""A robot as a chain of rigid links with springs in the joints, and its equilibrium.

A joint is three hinges at one point, about both principal axes of the section and along the
backbone, with springs of its part's bending and torsional stiffness. Shear and extension are left
out.

Where the joints are decides how exact the chain is. A straight tendon at the distance r from an arc
of length h that bends by theta has the mean distance r + h theta / 12 from it, since the arc bows.
From a joint in the middle it has r + h theta / 4, from two joints at a and h - a it has
r + a theta / 2: so joints at one sixth and five sixths of the length have the moment of the arc.
The tip error of a chain with two joints a module is then up to 70 times smaller than with joints at
one and three quarters. The hinges of every second joint come in reverse order, so that the twist
by which turns about x and y differ from one turn cancels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from bowstring.aliases import Floats, Ints
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import Robot, check_robot, check_without_laws
from bowstring.statics.load import Load
from bowstring.statics.solution import Solution

__all__ = ["MAX_JOINTS", "Body", "ChainPose", "LinkChain"]

MAX_JOINTS: Final = 32
"""Most joints of a module."""
_MOST_JOINTS: Final = 400
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(3)
_STEPS: Final = 8  # steps of the load at first
_MOST_HALVINGS: Final = 10
_NEWTON: Final = 30
_PLACES: Final = (1.0 / 6.0, 5.0 / 6.0)  # positions of the two joints in their part of a module
_TOLERANCE: Final = 1e-9  # tolerance of the imbalance over the moments of the springs
_DIFFERENCE: Final = 1e-6  # rad


class Body(NamedTuple):
    """Rigid link in the axes of its joint, z along the straight backbone."""

    start: Floats
    """Position of its joint (3,) in the body before, or in the base, m."""
    length: float
    """Distance to the next joint, or to the tip, m."""
    mass: float
    centre: Floats
    """Centre of mass (3,), m."""
    inertia: Floats
    """Moments of inertia (3, 3) about the centre of mass, kg m^2."""
    disk: int | None
    """Disk that it carries, from 0."""
    disk_centre: float
    """Position of that disk along z, m; NaN without one."""


class ChainPose(NamedTuple):
    """Poses of the bodies of a chain, in the base frame; leading dimensions are those given."""

    joint: Floats
    """Positions of the joints (..., B, 3), m."""
    rotation: Floats
    """Rotations of the bodies (..., B, 3, 3)."""
    hinge: Floats
    """Directions of the hinges (..., B, 3, 3), one in each row."""
    tip: Floats
    """Tip (..., 3), m."""


@short_repr
@dataclass(frozen=True, eq=False)
class LinkChain:
    """Chain of rigid links of a robot.

    Parameters
    ----------
    robot : Robot
        With tendons that are straight between disks, without friction or another law.
    joints : int
        Joints of each module, the backbone between two disks: 1, or an even number up to 32.

    Raises
    ------
    InputError
        If such a chain cannot express the robot; the message says why.
    """

    robot: Robot
    joints: int = 2

    def __post_init__(self) -> None:
        robot = self.robot
        check_robot(robot)
        n = self.joints
        if not isinstance(n, int) or not 1 <= n <= MAX_JOINTS or (n > 1 and n % 2):
            raise InputError(f"joints is {n!r}, it must be 1 or an even number up to {MAX_JOINTS}")
        modules = len(robot.disks.station_m)
        if n * modules > _MOST_JOINTS:
            raise InputError(
                f"{n} joints in each of {modules} modules are {n * modules}; up to {_MOST_JOINTS} "
                "are possible"
            )
        what = f"rigid links cannot express {robot.name}: "
        if robot.is_embedded:
            raise InputError(f"{what}its tendons run in the body and touch it everywhere")
        if not np.isnan(robot.section_stiffness).all():
            raise InputError(f"{what}its section has couplings, or a stiffness matrix")
        if robot.rest_curvature.any():
            raise InputError(f"{what}its backbone is bent without load")
        check_without_laws(
            robot, ", which rigid links with springs cannot express", but=OF_COMMANDS
        )

    # -- bodies and hinges -------------------------------------------------------------------------

    @cached_property
    def _parts(self) -> list[tuple[float, float, float]]:
        """Start and end of the backbone of each joint, and the joint's arc length, m."""
        disks = self.robot.disks
        end = disks.station_m - 0.5 * disks.clamped_length_m
        start = np.concatenate([[0.0], (disks.station_m + 0.5 * disks.clamped_length_m)[:-1]])
        found = []
        for a, b in zip(start, end, strict=True):
            if self.joints == 1:
                found.append((float(a), float(b), 0.5 * float(a + b)))
                continue
            edges = np.linspace(a, b, self.joints // 2 + 1)
            for c, d in pairwise(edges):
                middle = 0.5 * (c + d)
                first, second = (float(c + place * (d - c)) for place in _PLACES)
                found += [(float(c), middle, first), (middle, float(d), second)]
        return found

    @cached_property
    def stations(self) -> Floats:
        """Arc lengths of the joints (B,), m."""
        return np.array([place for *_, place in self._parts])

    @cached_property
    def _segment(self) -> list[int]:
        return [int(k) for k in np.repeat(self.robot.disks.segment, self.joints)]

    def _sections(self, segment: int, station: ArrayLike) -> Floats:
        """Numbers of the sections (..., 11) at arc lengths."""
        rows = self.robot.sections[segment]
        if len(rows) == 1:
            return np.broadcast_to(rows[0], (*np.shape(station), rows.shape[1]))
        begin = sum(s.length for s in self.robot.segments[:segment])
        x = (np.asarray(station) - begin) / self.robot.segments[segment].length
        nodes = np.linspace(0.0, 1.0, len(rows))
        weights = np.ones((*x.shape, len(rows)))
        for i, at in enumerate(nodes):
            for j, other in enumerate(nodes):
                if i != j:
                    weights[..., i] *= (x - other) / (at - other)
        return np.asarray(weights @ rows)

    @cached_property
    def order(self) -> Ints:
        """Hinges (B, 3) in the order in which they turn: 0 and 1 bend, 2 twists."""
        forth = np.arange(len(self._parts)) % 2 == 0
        return np.where(forth[:, None], [0, 1, 2], [2, 1, 0])

    @cached_property
    def _principal(self) -> Floats:
        """Principal axes of the sections (B, 3, 3), one in each row, the last along z."""
        found = []
        for (*_, place), segment in zip(self._parts, self._segment, strict=True):
            angle = float(self._sections(segment, place)[2])
            c, s = math.cos(angle), math.sin(angle)
            found.append([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        return np.array(found)

    @cached_property
    def _springs(self) -> Floats:
        found = []
        for (a, b, _), segment in zip(self._parts, self._segment, strict=True):
            at = 0.5 * (a + b) + 0.5 * (b - a) * _NODES
            flexibility = 1.0 / self._sections(segment, at)[:, [0, 1, 3]]
            found.append(1.0 / (0.5 * (b - a) * _WEIGHTS @ flexibility))
        return np.array(found)

    @cached_property
    def axes(self) -> Floats:
        """Directions of the hinges (B, 3, 3) on the straight chain, one in each row, in order."""
        return np.take_along_axis(self._principal, self.order[:, :, None], axis=1)

    @cached_property
    def stiffness(self) -> Floats:
        """Stiffness of the hinges (B, 3) in order, N m/rad: of the flexibility of their parts."""
        return np.take_along_axis(self._springs, self.order, axis=1)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """Rigid bodies from base to tip, one for each joint."""
        robot = self.robot
        stations, edges = self.stations, [*self.stations[1:], robot.length]
        found = []
        for b, (here, end) in enumerate(zip(stations, edges, strict=True)):
            parts = self._backbone_parts(here, end)
            disk, centre = None, math.nan
            if (b + 1) % self.joints == 0:
                disk = b // self.joints
                centre = float(robot.disks.station_m[disk] - here)
                parts += self._disk_parts(disk, centre)
            before = stations[b - 1] if b else 0.0
            start = np.array([0.0, 0.0, here - before])
            found.append(Body(start, end - here, *_together(parts), disk, centre))
        return tuple(found)

    def _backbone_parts(self, start: float, end: float) -> list[_Part]:
        """Backbone from a joint to the next one, cut where the section changes."""
        begins = np.cumsum([0.0, *(s.length for s in self.robot.segments)])
        cuts = [start, *(c for c in begins if start < c < end), end]
        parts = []
        for a, b in pairwise(cuts):
            segment = min(int(np.searchsorted(begins, 0.5 * (a + b))) - 1, len(begins) - 2)
            numbers = self._sections(segment, 0.5 * (a + b))
            mass, rotary = float(numbers[6] * (b - a)), float(numbers[7] * (b - a))
            across = rotary + mass * (b - a) ** 2 / 12.0
            centre = np.array([0.0, 0.0, 0.5 * (a + b) - start])
            parts.append((mass, centre, np.diag([across, across, 2.0 * rotary])))
        return parts

    def _disk_parts(self, disk: int, centre: float) -> list[_Part]:
        disks = self.robot.disks
        across, along = disks.inertia_kg_m2[disk]
        place = np.array([0.0, 0.0, centre])
        parts = [(float(disks.mass_kg[disk]), place, np.diag([across, across, along]))]
        for row in self.robot.payload_numbers:
            if int(row[0]) == disk:
                parts.append((float(row[1]), place + row[2:5], np.diag(row[5:8])))
        return parts

    @cached_property
    def tendon_points(self) -> list[list[tuple[int, Floats]]]:
        """Points of each tendon: its body (-1 the base) and its position (3,) there, m."""
        disks = self.robot.disks
        straight = disks.station_m[:, None] * [0.0, 0.0, 1.0]
        turns = np.broadcast_to(np.eye(3), (len(straight), 3, 3))
        holes = 2 if disks.hole_length_m.any() else 1
        found = []
        for points in self.robot.tendon_points(straight, turns):
            own = []
            for i, point in enumerate(points):
                body = -1 if i == 0 else ((i - 1) // holes + 1) * self.joints - 1
                at = 0.0 if body < 0 else self.stations[body]
                own.append((body, point - [0.0, 0.0, at]))
            found.append(own)
        return found

    # -- poses ------------------------------------------------------------------------------

    def pose(self, angles: ArrayLike) -> ChainPose:
        """Poses of the bodies at angles of the hinges.

        Parameters
        ----------
        angles : array_like (..., B, 3)
            Angles of the three hinges of each joint in `order`, rad; each turns those after it.
        """
        q = np.asarray(angles, dtype=float)
        lead = q.shape[:-2]
        count = len(self.bodies)
        if q.shape[-2:] != (count, 3):
            raise InputError(f"angles has shape {q.shape}, it must end in ({count}, 3)")
        joint = np.empty((*lead, count, 3))
        rotation = np.empty((*lead, count, 3, 3))
        hinge = np.empty((*lead, count, 3, 3))
        here = np.zeros((*lead, 3))
        turned = np.broadcast_to(np.eye(3), (*lead, 3, 3))
        for b, body in enumerate(self.bodies):
            here = here + turned @ body.start
            for k, axis in enumerate(self.axes[b]):
                hinge[..., b, k, :] = turned @ axis
                turned = turned @ _turn(axis, q[..., b, k])
            joint[..., b, :], rotation[..., b, :, :] = here, turned
        tip = here + turned[..., :, 2] * self.bodies[-1].length
        return ChainPose(joint, rotation, hinge, tip)

    def angles_of(self, solution: Solution) -> Floats:
        """Angles of the hinges (B, 3), rad, with which the disks turn as in a solution of the rod.

        Parameters
        ----------
        solution : Solution
            Of this robot, with a pose.

        Returns
        -------
        ndarray (B, 3)
            The turn of a module is shared equally between its joints.
        """
        if solution.disk_rotations is None or solution.robot.hash != self.robot.hash:
            raise InputError(f"solution must be one of {self.robot.name} with a pose")
        before = np.concatenate([np.eye(3)[None], solution.disk_rotations[:-1]])
        relative = np.einsum("kji,kjl->kil", before, solution.disk_rotations)
        vector = Rotation.from_matrix(relative).as_rotvec() / self.joints
        share = np.repeat(Rotation.from_rotvec(vector).as_matrix(), self.joints, axis=0)
        own = np.einsum("bij,bjk,blk->bil", self._principal, share, self._principal)
        turns = Rotation.from_matrix(own)
        forth = self.order[:, :1] == 0
        return np.asarray(np.where(forth, turns.as_euler("XYZ"), turns.as_euler("ZYX")))

    # -- equilibrium ------------------------------------------------------------------------

    def solve(self, load: Load) -> Floats:
        """Find the equilibrium that the straight chain reaches as the load grows.

        Parameters
        ----------
        load : Load
            Tensions, gravity, and force and moment at the tip.

        Returns
        -------
        ndarray (B, 3)
            Angles of the hinges, rad.

        Raises
        ------
        InputError
            If the load has other parts.
        NoSolutionError
            If no stable equilibrium was found.
        """
        forces = self._forces(load)
        q, done, step, halved = np.zeros((len(self.bodies), 3)), 0.0, 1.0 / _STEPS, 0
        while done < 1.0:
            share = min(done + step, 1.0)
            found = self._newton(q, forces, share)
            if found is None:
                halved += 1
                step *= 0.5
                if halved > _MOST_HALVINGS:
                    raise NoSolutionError(
                        f"the chain of {self.robot.name} was followed to "
                        f"{100.0 * done:.3g} % of the load and has no equilibrium near there"
                    )
                continue
            q, done = found, share
        _, slope = self._linearised(q, forces, 1.0)
        if np.linalg.eigvalsh(0.5 * (slope + slope.T))[0] <= 0.0:
            raise NoSolutionError(
                f"the chain of {self.robot.name} is unstable under the load: it buckles"
            )
        return q

    def _forces(self, load: Load) -> _Forces:
        tendons = len(self.robot.tendons.segment)
        if load.given - {"tensions", "gravity", "tip_force", "tip_moment"}:
            raise InputError("a chain of links takes tensions, gravity, and loads at the tip")
        given = np.zeros(tendons) if load.tensions is None else load.tensions
        tensions = np.asarray(given, dtype=float)
        if tensions.shape != (tendons,) or not (np.isfinite(tensions) & (tensions >= 0.0)).all():
            raise InputError(f"tensions must be {tendons} finite numbers, none negative")

        def vector(value: object, default: ArrayLike = (0.0, 0.0, 0.0)) -> Floats:
            return np.asarray(default if value is None else value, dtype=float)

        gravity = vector(load.gravity, self.robot.gravity)
        return _Forces(tensions, gravity, vector(load.tip_force), vector(load.tip_moment))

    def _newton(self, q: Floats, forces: _Forces, share: float) -> Floats | None:
        """Equilibrium near a pose under a share of the load."""
        small = _TOLERANCE * float(self.stiffness.min())
        for _ in range(_NEWTON):
            residual, slope = self._linearised(q, forces, share)
            if np.abs(residual).max() < small:
                return q
            try:
                change = np.linalg.solve(slope, -residual)
            except np.linalg.LinAlgError:
                return None
            largest = float(np.abs(change).max())
            if not np.isfinite(largest):
                return None
            q = q + (change * min(1.0, 0.5 / max(largest, 1e-300))).reshape(q.shape)
            if np.abs(q).max() > math.pi:
                return None
        return None

    def _linearised(self, q: Floats, forces: _Forces, share: float) -> tuple[Floats, Floats]:
        """Moments (3 B,) of `_moments`, and their slopes (3 B, 3 B)."""
        n = q.size
        steps = np.concatenate([np.zeros((1, n)), _DIFFERENCE * np.eye(n)])
        moments = self._moments(q + steps.reshape(n + 1, *q.shape), forces, share)
        residual = moments[0].ravel()
        return residual, (moments[1:].reshape(n, n) - residual).T / _DIFFERENCE

    def _moments(self, q: Floats, forces: _Forces, share: float) -> Floats:
        """Moments (..., B, 3) that the hinges' springs lack for equilibrium, N m."""
        pose = self.pose(q)
        count = len(self.bodies)
        force = np.zeros((*q.shape[:-2], count, 3))
        moment = np.zeros_like(force)  # about the origin

        def push(body: int, point: Floats, value: Floats) -> None:
            force[..., body, :] += value
            moment[..., body, :] += np.cross(point, value)

        for b, body in enumerate(self.bodies):
            centre = pose.joint[..., b, :] + pose.rotation[..., b, :, :] @ body.centre
            push(b, centre, body.mass * forces.gravity * share)
        push(count - 1, pose.tip, np.broadcast_to(forces.tip * share, pose.tip.shape))
        moment[..., -1, :] += forces.tip_moment * share
        for tension, path in zip(forces.tensions, self.tendon_points, strict=True):
            if tension == 0.0:
                continue
            places = [
                np.broadcast_to(at, pose.tip.shape)
                if b < 0
                else pose.joint[..., b, :] + pose.rotation[..., b, :, :] @ at
                for b, at in path
            ]
            ends = [(b, place) for (b, _), place in zip(path, places, strict=True)]
            for (first, start), (second, end) in pairwise(ends):
                span = end - start
                pull = tension * share * span / np.linalg.norm(span, axis=-1, keepdims=True)
                if first >= 0:
                    push(first, start, pull)
                push(second, end, -pull)
        after_force = np.cumsum(force[..., ::-1, :], axis=-2)[..., ::-1, :]
        after_moment = np.cumsum(moment[..., ::-1, :], axis=-2)[..., ::-1, :]
        about = after_moment - np.cross(pose.joint, after_force)
        return np.asarray(self.stiffness * q - np.einsum("...bki,...bi->...bk", pose.hinge, about))


class _Forces(NamedTuple):
    tensions: Floats
    gravity: Floats
    tip: Floats
    tip_moment: Floats


_Part = tuple[float, Floats, Floats]
"""Mass, centre of mass (3,), and moments of inertia (3, 3) about it."""


def _together(parts: list[_Part]) -> _Part:
    """Mass, centre of mass and moments of inertia of several bodies."""
    mass = sum(part[0] for part in parts)
    if mass == 0.0:
        return 0.0, np.mean([p[1] for p in parts], axis=0), np.sum([p[2] for p in parts], axis=0)
    centre = np.sum([m * c for m, c, _ in parts], axis=0) / mass
    inertia = np.zeros((3, 3))
    for m, c, own in parts:
        arm = c - centre
        inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return float(mass), np.asarray(centre), inertia


def _turn(axis: Floats, angle: Floats) -> Floats:
    """Rotations (..., 3, 3) about a direction by angles (...), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.asarray(np.eye(3) + s * cross + (1.0 - c) * (cross @ cross))
