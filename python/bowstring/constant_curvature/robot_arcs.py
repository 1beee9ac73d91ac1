"""Constant curvature of a robot: one arc per segment, in series, with tendon lengths.

Frames, units and terms are those of `bowstring.constant_curvature.arc`; poses are in the robot's
base frame. With the correction "chord" the tendons run straight between the holes of the disks,
and each module bends by an arc of its own between clamped lengths that stay straight: theory Eq.
1.5 to 1.11.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

import bowstring._core as _core
from bowstring.aliases import Floats
from bowstring.constant_curvature.arc import Arc, Routing, broadcast, check_option, to_array
from bowstring.constant_curvature.series import series_jacobian
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.pose import Pose
from bowstring.robot.arrays import frozen

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

Correction = Literal["chord"]
Law = Literal["linear", "arm"]

_FAR: Final = 10.0  # factor from a straight tendon's length beyond which the unit is wrong
_STEP: Final = 1e-6  # of central differences, over a straight tendon's length
_ROUNDS: Final = 30  # most Newton steps of the inverse


@short_repr
@dataclass(frozen=True, eq=False)
class RobotArcs:
    """Backbone of a robot as one arc per segment, or an array of any shape of them.

    ``arcs[index]`` indexes the leading dimensions as NumPy does.
    """

    robot: Robot = field(repr=False)
    arc: Arc
    """Arcs (..., S), each in the frame of its segment's start. With a correction the bend of the
    segment and the length of its backbone."""
    correction: Correction | None = None
    """Tendon path. None: parallel to the backbone, theory Eq. 1.3 (Amouri 2019, Eq. 2-5).
    "chord": straight between the holes of the disks, theory Eq. 1.5."""
    hold_length: bool = False
    """Whether segments keep their lengths where arcs are fitted to tendon lengths."""
    module_bends: Floats = field(init=False, repr=False)
    """Bends of the modules (..., N), rad, with a correction; by default in the proportion of theory
    Eq. 1.11. Without a correction N is 0."""

    def __post_init__(self) -> None:
        _check_correction(self.correction, self.hold_length)
        count, shape = len(_check_robot(self.robot).segments), self.kappa.shape
        if shape[-1:] != (count,):
            raise InputError(
                f"arc has shape {shape}, its last dimension must be the {count} segments of robot"
            )
        if self.correction is None:
            self._bend(np.empty((self.kappa[..., 0].size, 0)))
        else:
            self._bend(self._core.bends(self.arc.bend.reshape(-1, 3)))

    @classmethod
    def _with_bends(
        cls,
        robot: Robot,
        arc: Arc,
        correction: Correction | None,
        hold_length: bool,
        bends: Floats,
    ) -> RobotArcs:
        """Make checked arcs whose modules have bends of their own (n, N), rad."""
        made = cls.__new__(cls)
        for name, value in (
            ("robot", robot),
            ("arc", arc),
            ("correction", correction),
            ("hold_length", hold_length),
        ):
            object.__setattr__(made, name, value)
        return made._bend(bends)

    def _bend(self, bends: Floats) -> RobotArcs:
        """Set the bends of the modules (n, N), rad."""
        shape = self.kappa.shape[:-1]
        object.__setattr__(self, "module_bends", frozen(bends).reshape(*shape, bends.shape[-1]))
        return self

    @property
    def _core(self) -> _core.RobotArcs:
        law = "held" if self.hold_length else "lengths"
        return _core.RobotArcs(self.robot.core, "chords" if self.correction else law)

    def _rows(self, shape: tuple[int, ...]) -> tuple[Floats, Floats]:
        """Arcs (n S, 3) and bends of the modules (n, N), with leading dimensions broadcast."""
        arcs = np.broadcast_to(self.arc.bend, (*shape, *self.arc.bend.shape[-2:]))
        bends = np.broadcast_to(self.module_bends, (*shape, self.module_bends.shape[-1]))
        count = int(np.prod(shape, dtype=int))
        return arcs.reshape(-1, 3), np.ascontiguousarray(bends.reshape(count, bends.shape[-1]))

    @property
    def kappa(self) -> Floats:
        """Curvatures (..., S), 1/m."""
        return self.arc.kappa

    @property
    def phi(self) -> Floats:
        """Directions of bending (..., S), rad, in the frame of each segment's start."""
        return self.arc.phi

    @property
    def length(self) -> Floats:
        """Lengths (..., S), m."""
        return self.arc.length

    @property
    def theta(self) -> Floats:
        """Bend angles (..., S), rad."""
        return self.arc.theta

    @property
    def misfit(self) -> Floats:
        """Residual of the fit of each arc (..., S), m; see `Arc.misfit`."""
        return self.arc.misfit

    def __getitem__(self, index: Any) -> RobotArcs:
        index = (*index, slice(None)) if isinstance(index, tuple) else (index, slice(None))
        bends = self.module_bends[index]
        return self._with_bends(
            self.robot, self.arc[index], self.correction, self.hold_length, bends
        )

    @classmethod
    def _of(
        cls,
        robot: Robot,
        law: str,
        commands: Floats,
        correction: Correction | None,
        hold_length: bool = False,
    ) -> RobotArcs:
        """Make arcs from commands (..., T) by a law of the core."""
        shape, count = commands.shape[:-1], commands.shape[-1]
        rows = commands.reshape(int(np.prod(shape, dtype=int)), count)
        arcs, misfit, bends = _core.RobotArcs(robot.core, law).arcs(rows)
        arc = Arc._of(arcs.reshape(-1, 3), (*shape, arcs.shape[1]), misfit)
        return cls._with_bends(robot, arc, correction, hold_length, bends)

    # -- constructors --------------------------------------------------------------------------

    @classmethod
    def from_lengths(
        cls,
        robot: Robot,
        lengths: ArrayLike,
        correction: Correction | None = None,
        *,
        hold_length: bool = False,
    ) -> RobotArcs:
        """Fit arcs to a robot's tendon lengths.

        The arc of a segment follows from the tendons anchored to its end disk. Their lengths within
        the inner segments follow from the arcs of those and are subtracted first. A segment that no
        tendon passes has its arc without load. Where lengths alone leave the arc open, the tendons
        bend the backbone as their tensions do: an opposite pair in its plane, and a single tendon,
        or a pair beside the axis, one that keeps its length (theory, after Eq. 1.3).

        Parameters
        ----------
        robot : Robot
            The robot.
        lengths : array_like (..., T)
            Tendon lengths from the base to each tendon's end disk, m.
        correction : {None, "chord"}
            None: tendons parallel to the backbone. "chord": straight between the holes of the
            disks, with the clamped lengths straight. The modules then bend as under the least
            tensions that bend the segment in this direction.
        hold_length : bool
            Whether segments keep their lengths, so that only the bends are fitted; not with a
            correction.

        Returns
        -------
        RobotArcs

        Raises
        ------
        InputError
            For lengths that no arcs can have, and for lengths below a tenth or above ten times the
            straight tendon's.
        """
        rest = to_array("lengths", lengths, len(_check_robot(robot).tendons.segment))
        straight = np.cumsum([s.length for s in robot.segments])[robot.tendons.segment]
        bad = ~((rest >= straight / _FAR) & (rest <= straight * _FAR))
        if bad.any():
            at = tuple(np.argwhere(bad)[0])
            whole = straight[at[-1]]
            raise InputError(
                f"tendon {at[-1] + 1} is {rest[at]:g} m long, its straight length is {whole:g} m; "
                f"lengths must be {whole / _FAR:g} m to {whole * _FAR:g} m: check their unit"
            )
        _check_correction(correction, hold_length)
        law = "chords" if correction else "held" if hold_length else "lengths"
        return cls._of(robot, law, rest, correction, hold_length)

    @classmethod
    def from_tensions(cls, robot: Robot, tensions: ArrayLike, law: Law = "linear") -> RobotArcs:
        """Make arcs from a robot's tensions; segments keep their lengths.

        Every tendon bends all segments that it passes, not only the one of its end disk. By the
        linear law, segments of a robot with rods or chambers change their lengths by the sum of the
        tensions over E A.

        Parameters
        ----------
        robot : Robot
            The robot.
        tensions : array_like (..., T)
            Tensions, N; negative for rods and chambers that push only.
        law : {"linear", "arm"}
            "linear": theta = ``|m| l/(E I)`` with the moment m of the tensions about the tension
            centre (theory Eq. 1.7), added to the bend without load. "arm": the mean lever arm of
            straight spans with clamped lengths straight, theory Eq. 1.10; sets `correction` to
            "chord".

        Returns
        -------
        RobotArcs

        Raises
        ------
        InputError
            By the lever arm, for a backbone that is bent without load or that has two bending
            stiffnesses.
        NoSolutionError
            By the lever arm, if the tensions buckle the backbone between two disks: without clamped
            lengths at Euler's load, pi^2 E I n^2/l^2.
        """
        check_option("law", law, ("linear", "arm"))
        given = to_array("tensions", tensions, len(_check_robot(robot).tendons.segment))
        bad = ~((given >= robot.tendons.least_tension_N) & np.isfinite(given))
        if bad.any():
            at = tuple(np.argwhere(bad)[0])
            raise InputError(f"tension {at[-1] + 1} is {given[at]:g} N; tensions must be >= 0 N")
        return cls._of(robot, law, given, "chord" if law == "arm" else None)

    @classmethod
    def ik(
        cls,
        robot: Robot,
        position: ArrayLike,
        correction: Correction | None = None,
        *,
        free_length: bool = False,
    ) -> RobotArcs:
        """Find the arc that brings the tip of a robot with one segment nearest to a point.

        `lengths` of the result gives the tendon lengths.

        Parameters
        ----------
        robot : Robot
            Robot with one segment; with more segments the inverse is not unique.
        position : array_like (..., 3)
            Target position of the tip, m, base frame.
        correction : {None, "chord"}
            As in `from_lengths`.
        free_length : bool
            Whether the arc's length is free, so that its tip reaches the point.

        Returns
        -------
        RobotArcs
            Its misfit (..., 1) is the distance from the tip to the point, m.

        Raises
        ------
        NoSolutionError
            With a correction, if no arc below a full turn is found for a point.
        """
        lengths = [segment.length for segment in _check_robot(robot).segments]
        if len(lengths) != 1:
            raise InputError(
                f"the inverse is for one segment, this robot has {len(lengths)}; "
                "iterate with RobotArcs.jacobian"
            )
        points = to_array("position", position, 3)[..., None, :]
        arc = Arc.ik(points, None if free_length else lengths)
        if correction is None:
            return cls(robot, arc)
        try:
            return cls._corrected_ik(robot, points, arc, free_length)
        except (np.linalg.LinAlgError, InputError) as error:
            raise NoSolutionError(f"no corrected arc was found for the point: {error}") from None

    @classmethod
    def _corrected_ik(
        cls, robot: Robot, points: Floats, start: Arc, free_length: bool
    ) -> RobotArcs:
        """Newton's iteration from the arcs without correction, in the plane of the bend."""
        phi = np.arctan2(points[..., 1], points[..., 0])
        target = np.stack([np.hypot(points[..., 0], points[..., 1]), points[..., 2]], axis=-1)

        def arcs(theta: Floats, length: Floats) -> RobotArcs:
            return cls(robot, Arc(theta / length, phi, length), "chord")

        def tip(theta: Floats, length: Floats) -> Floats:
            x, y, z = np.moveaxis(arcs(theta, length).tip.position[..., None, :], -1, 0)
            return np.stack([np.cos(phi) * x + np.sin(phi) * y, z], axis=-1)

        theta, length, step = start.theta, start.length, 1e-4
        for _ in range(_ROUNDS):
            here, low, high = (tip(theta + k * step, length) for k in (0.0, -1.0, 1.0))
            away, by_theta = target - here, (high - low) / (2.0 * step)
            if free_length:
                longer, shorter = (tip(theta, length * (1.0 + k * step)) for k in (1.0, -1.0))
                by_length = (longer - shorter) / (2.0 * step * length[..., None])
                both = np.stack([by_theta, by_length], axis=-1)
                turn, stretch = np.moveaxis(np.linalg.solve(both, away[..., None])[..., 0], -1, 0)
                theta, length = theta + turn, length + stretch
            else:
                squares = (by_theta**2).sum(axis=-1)
                second = squares - (away * (high - 2.0 * here + low)).sum(axis=-1) / step**2
                bottom = np.where(second > 0.1 * squares, second, squares)
                turn = (away * by_theta).sum(axis=-1) / bottom
                theta = theta + turn
            if np.all(np.abs(turn) < 1e-12):
                break
        found = arcs(theta, length)
        misfit = np.linalg.norm(target - tip(theta, length), axis=-1)
        converged = np.abs(turn) < 1e-9
        if free_length:
            converged &= misfit < 1e-9 * robot.length
            misfit = np.zeros_like(misfit)
        if not np.all(converged & (np.abs(theta) <= 2.0 * np.pi)):
            raise NoSolutionError("no corrected arc was found for the point")
        arc = Arc._of(found.arc.bend, found.arc.kappa.shape, misfit)
        return cls._with_bends(robot, arc, "chord", False, found.module_bends)

    # -- maps ----------------------------------------------------------------------------------

    def fk(self, s: ArrayLike | None = None) -> Pose:
        """Pose at the tip, or at any arc length.

        Parameters
        ----------
        s : array_like (...), optional
            Arc length from the base, m, from 0 to the sum of the arcs' lengths; the tip if not
            given. Broadcasts with the robots: ``arcs[..., None].fk(s)`` gives several points of
            each.

        Returns
        -------
        Pose
            Position (..., 3), m, and rotation (..., 3, 3), base frame.
        """
        ends = np.cumsum(self.length, axis=-1)
        whole = ends[..., -1]
        shape, (place, ends) = broadcast({"s": whole if s is None else s}, ends)
        bad = ~((place >= 0) & (place <= ends[:, -1] * (1 + 1e-14)))
        if bad.any():
            raise InputError(f"s is {place[bad][0]:g} m; it must be 0 to {ends[bad][0, -1]:g} m")
        return self._poses(shape, place[:, None], shape)

    def _poses(
        self, lead: tuple[int, ...], arc_lengths: Floats | None, shape: tuple[int, ...]
    ) -> Pose:
        """Poses of the given shape at arc lengths (n, k), by default at the disks."""
        position, rotation = self._core.poses(*self._rows(lead), arc_lengths)
        return Pose(position.reshape(*shape, 3), rotation.reshape(*shape, 3, 3))

    @cached_property
    def tip(self) -> Pose:
        """Pose of the tip: position (..., 3), m, and rotation (..., 3, 3)."""
        return self.fk()

    @cached_property
    def _disks(self) -> Pose:
        lead = self.kappa.shape[:-1]
        return self._poses(lead, None, (*lead, len(self.robot.disks.station_m)))

    @property
    def disk_positions(self) -> Floats:
        """Disk centres from base to tip, base excluded (..., N, 3), m."""
        return self._disks.position

    @property
    def disk_rotations(self) -> Floats:
        """Disk rotations (..., N, 3, 3)."""
        return self._disks.rotation

    def centerline(self, points_per_segment: int = 65) -> Floats:
        """Points of the backbone from base to tip.

        Parameters
        ----------
        points_per_segment : int
            Points on each arc, both ends included; at least 2.

        Returns
        -------
        ndarray (..., S (points_per_segment - 1) + 1, 3)
            Positions, m.
        """
        if points_per_segment < 2:
            raise InputError(f"points_per_segment must be at least 2, got {points_per_segment}")
        lead, length = self.kappa.shape[:-1], self.length[..., None]
        share = np.linspace(0.0, 1.0, points_per_segment)[1:]
        starts = np.cumsum(length, axis=-2) - length
        inner = (starts + length * share).reshape(*lead, length.shape[-2] * share.size)
        at = np.concatenate([np.zeros((*lead, 1)), inner], axis=-1)
        return self._poses(lead, at.reshape(-1, at.shape[-1]), at.shape).position

    def lengths(self) -> Floats:
        """Tendon lengths (..., T) from the base to each tendon's end disk, m."""
        lead = self.kappa.shape[:-1]
        count = len(self.robot.tendons.segment)
        return self._core.tendon_lengths(*self._rows(lead)).reshape(*lead, count)

    def jacobian(self) -> Floats:
        """Derivative of the tip pose by the tendon lengths through `from_lengths`.

        Returns
        -------
        ndarray (..., 6, T)
            Rows 0 to 2: tip position, m. Rows 3 to 5: rotation vector in base axes, rad. With a
            correction by central differences, to about 1e-9; where a segment bends straight
            towards a tendon, whose derivatives on both sides differ, their mean.
        """
        if self.correction is not None:
            return self._differences()
        shape, count = self.kappa.shape, len(self.robot.tendons.segment)
        # derivative of the tendon lengths within a segment by all tendon lengths
        rest = np.broadcast_to(np.eye(count), (*shape[:-1], count, count)).copy()
        by_length = np.zeros((*shape, 3, count))
        ends = self.robot.tendons.segment
        for j in range(shape[-1]):
            own, further = np.flatnonzero(ends == j), np.flatnonzero(ends > j)
            if not own.size:
                continue
            arc, holes = self.arc[..., j], self.robot.tendons.mean_hole_m[j]
            fitted = self._core.fit_jacobian(j)
            by_length[..., j, :, :] = fitted @ rest[..., own, :]
            spent = arc.lengths_jacobian(Routing.from_holes(holes[further]))
            rest[..., further, :] -= spent @ by_length[..., j, :, :]
        _, by_arcs = series_jacobian(self.arc.bend, np.ones(shape))
        return np.asarray(by_arcs @ by_length.reshape(*shape[:-1], 3 * shape[-1], count))

    def _differences(self) -> Floats:
        lengths = self.lengths()
        step = _STEP * self.robot.length
        moved = lengths[..., None, :] + step * np.eye(lengths.shape[-1])
        back = 2.0 * lengths[..., None, :] - moved
        high, low = (
            RobotArcs.from_lengths(self.robot, each, self.correction).tip for each in (moved, back)
        )
        turn = high.rotation @ np.swapaxes(low.rotation, -1, -2)
        skew = 0.5 * (turn - np.swapaxes(turn, -1, -2))
        moved_by = high.position - low.position, skew[..., [2, 0, 1], [1, 2, 0]]
        return np.asarray(np.swapaxes(np.concatenate(moved_by, axis=-1), -1, -2) / (2.0 * step))


def _check_correction(correction: Correction | None, hold_length: bool) -> None:
    check_option("correction", correction, (None, "chord"))
    if correction is not None and hold_length:
        raise InputError(
            "the length can be held only for tendons parallel to the backbone, not with "
            "straight spans"
        )


def _check_robot(robot: Robot) -> Robot:
    if not hasattr(robot, "segments"):
        raise InputError(
            f"robot is {robot!r:.60}, it must be a Robot, as bowstring.load_robot gives it"
        )
    return robot
