"""Constant curvature of a robot: one arc per segment, in series, with tendon lengths.

Frames, units and terms are those of `bowstring.constant_curvature.arc`; poses are in the robot's
base frame.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.constant_curvature.arc import Arc, Routing, broadcast, check_option, to_array
from bowstring.constant_curvature.series import Pose, series_jacobian, series_pose
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

__all__ = ["RobotArcs"]

Array = NDArray[np.float64]
Correction = Literal["chord"]
Law = Literal["linear", "arm"]

_FAR: Final = 10.0  # factor from a straight tendon's length beyond which the unit is wrong


@short_repr
@dataclass(frozen=True, eq=False)
class RobotArcs:
    """Backbone of a robot as one arc per segment, or an array of any shape of them.

    ``arcs[index]`` indexes the leading dimensions as NumPy does.
    """

    robot: Robot = field(repr=False)
    arc: Arc
    """Arcs (..., S), each in the frame of its segment's start."""
    correction: Correction | None = None
    """Tendon path. None: parallel to the backbone, theory Eq. 1.3 (Amouri 2019, Eq. 2-5).
    "chord": straight between disks at the robot's disk positions, theory Eq. 1.5."""
    hold_length: bool = False
    """Whether segments keep their lengths where arcs are fitted to tendon lengths."""

    def __post_init__(self) -> None:
        check_option("correction", self.correction, (None, "chord"))
        count, shape = len(_check_robot(self.robot).segments), self.kappa.shape
        if shape[-1:] != (count,):
            raise InputError(
                f"arc has shape {shape}, its last dimension must be the {count} segments of robot"
            )

    @property
    def kappa(self) -> Array:
        """Curvatures (..., S), 1/m."""
        return self.arc.kappa

    @property
    def phi(self) -> Array:
        """Directions of bending (..., S), rad, in the frame of each segment's start."""
        return self.arc.phi

    @property
    def length(self) -> Array:
        """Lengths (..., S), m."""
        return self.arc.length

    @property
    def theta(self) -> Array:
        """Bend angles (..., S), rad."""
        return self.arc.theta

    @property
    def misfit(self) -> Array:
        """Residual of the fit of each arc (..., S), m; see `Arc.misfit`."""
        return self.arc.misfit

    def __getitem__(self, index: Any) -> RobotArcs:
        index = (*index, slice(None)) if isinstance(index, tuple) else (index, slice(None))
        return RobotArcs(self.robot, self.arc[index], self.correction, self.hold_length)

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
        tendon passes has its arc without load.

        Parameters
        ----------
        robot : Robot
            The robot.
        lengths : array_like (..., T)
            Tendon lengths from the base to each tendon's end disk, m.
        correction : {None, "chord"}
            None: tendons parallel to the backbone. "chord": straight between disks.
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
        segments = _segments(robot, correction)
        rest = np.array(to_array("lengths", lengths, len(robot.tendons.segment)))
        straight = np.cumsum([s.length for s in segments])[robot.tendons.segment]
        bad = ~((rest >= straight / _FAR) & (rest <= straight * _FAR))
        if bad.any():
            at = tuple(np.argwhere(bad)[0])
            whole = straight[at[-1]]
            raise InputError(
                f"tendon {at[-1] + 1} is {rest[at]:g} m long, its straight length is {whole:g} m; "
                f"lengths must be {whole / _FAR:g} m to {whole * _FAR:g} m: check their unit"
            )
        arcs = []
        for segment in segments:
            if not segment.own.size:
                arcs.append(_unactuated(robot, segment, rest.shape[:-1]))
                continue
            own = rest[..., segment.own]
            if np.any(own <= 0):
                t = segment.own[np.argwhere(own <= 0)[0, -1]]
                raise InputError(
                    f"segment {segment.index + 1}: tendon {t + 1} is shorter than the bent "
                    "segments before it, so nothing is left of it for its own"
                )
            with segment.named():
                held = segment.length if hold_length else None
                arcs.append(Arc.from_lengths(own, segment.routing[segment.own], held))
                rest[..., segment.further] -= arcs[-1].lengths(segment.routing[segment.further])
        return cls(robot, _stacked(arcs), correction, hold_length)

    @classmethod
    def from_tensions(cls, robot: Robot, tensions: ArrayLike, law: Law = "linear") -> RobotArcs:
        """Make arcs from a robot's tensions; segments keep their lengths.

        Every tendon bends all segments that it passes, not only the one of its end disk.

        Parameters
        ----------
        robot : Robot
            The robot.
        tensions : array_like (..., T)
            Tensions, N, not negative.
        law : {"linear", "arm"}
            Linear law of tendons parallel to the backbone, or law with the mean lever arm of
            straight spans, see `Arc.from_tensions`; the latter assumes equally spaced disks and
            sets `correction` to "chord".

        Returns
        -------
        RobotArcs
        """
        check_option("law", law, ("linear", "arm"))
        segments = _segments(robot)
        given = to_array("tensions", tensions, len(robot.tendons.segment))
        bad = ~((given >= 0) & np.isfinite(given))
        if bad.any():
            at = tuple(np.argwhere(bad)[0])
            raise InputError(f"tension {at[-1] + 1} is {given[at]:g} N; tensions must be >= 0 N")
        rest = robot.rest_curvature
        if law == "arm" and rest[:, :2].any():
            raise InputError(
                "the lever-arm law is for a backbone that is straight without load; use linear"
            )
        if law == "arm" and not robot.bends_alike:
            raise InputError(
                "the lever-arm law is for backbones with equal bending stiffness about all axes; "
                "use linear"
            )
        arcs = []
        for segment in segments:
            passing = np.union1d(segment.own, segment.further)
            modules = segment.places.size if law == "arm" else None
            if not passing.size:
                arcs.append(_unactuated(robot, segment, given.shape[:-1]))
                continue
            # tensions bend by their moments about the tension centre
            holes = robot.tendons.mean_hole_m[segment.index, passing]
            routing = Routing.from_holes(holes - robot.tension_centre_m[segment.index], modules)
            with segment.named():
                arc = Arc.from_tensions(
                    given[..., passing], routing, segment.length, segment.bending_stiffness
                )
            if law == "linear":
                arc = _general(robot, segment, arc)
            arcs.append(arc)
        return cls(robot, _stacked(arcs), "chord" if law == "arm" else None)

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
        """
        lengths = [segment.length for segment in _check_robot(robot).segments]
        if len(lengths) != 1:
            raise InputError(
                f"the inverse is for one segment, this robot has {len(lengths)}; "
                "iterate with RobotArcs.jacobian"
            )
        points = to_array("position", position, 3)[..., None, :]
        return cls(robot, Arc.ik(points, None if free_length else lengths), correction)

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
        if s is None:
            return series_pose(self.arc.bend, np.ones(self.length.shape))
        shape, (place, ends) = broadcast({"s": s}, np.cumsum(self.length, axis=-1))
        bad = ~((place >= 0) & (place <= ends[:, -1] * (1 + 1e-14)))
        if bad.any():
            raise InputError(f"s is {place[bad][0]:g} m; it must be 0 to {ends[bad][0, -1]:g} m")
        place, ends = place.reshape(shape), ends.reshape(*shape, -1)
        share = (place[..., None] - (ends - self.length)) / self.length
        return series_pose(self.arc.bend, np.clip(share, 0.0, 1.0))

    @cached_property
    def tip(self) -> Pose:
        """Pose of the tip: position (..., 3), m, and rotation (..., 3, 3)."""
        return self.fk()

    @cached_property
    def _disks(self) -> Pose:
        return self._at(np.concatenate([s.index + s.places for s in _segments(self.robot)]))

    @property
    def disk_positions(self) -> Array:
        """Disk centres from base to tip, base excluded (..., N, 3), m."""
        return self._disks.position

    @property
    def disk_rotations(self) -> Array:
        """Disk rotations (..., N, 3, 3)."""
        return self._disks.rotation

    def centerline(self, points_per_segment: int = 65) -> Array:
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
        count = self.kappa.shape[-1]
        return self._at(np.linspace(0.0, count, count * (points_per_segment - 1) + 1)).position

    def _at(self, places: Array) -> Pose:
        """Poses (..., n) at coordinates (n,) that grow by 1 in each segment."""
        share = np.clip(places[:, None] - np.arange(self.kappa.shape[-1]), 0.0, 1.0)
        return series_pose(self.arc.bend[..., None, :, :], share)

    def lengths(self) -> Array:
        """Tendon lengths (..., T) from the base to each tendon's end disk, m."""
        out = np.zeros((*self.kappa.shape[:-1], len(self.robot.tendons.segment)))
        for segment in _segments(self.robot, self.correction):
            passing = np.union1d(segment.own, segment.further)
            if not passing.size:
                continue
            with segment.named():
                out[..., passing] += self.arc[..., segment.index].lengths(segment.routing[passing])
        return out

    def jacobian(self) -> Array:
        """Derivative of the tip pose by the tendon lengths through `from_lengths`.

        Returns
        -------
        ndarray (..., 6, T)
            Rows 0 to 2: tip position, m. Rows 3 to 5: rotation vector in base axes, rad.
        """
        shape, count = self.kappa.shape, len(self.robot.tendons.segment)
        # derivative of the tendon lengths within a segment by all tendon lengths
        rest = np.broadcast_to(np.eye(count), (*shape[:-1], count, count)).copy()
        by_length = np.zeros((*shape, 3, count))
        for segment in _segments(self.robot, self.correction):
            arc, routing = self.arc[..., segment.index], segment.routing
            if not segment.own.size:
                continue
            with segment.named():
                own = routing[segment.own]
                fitted = arc.from_lengths_jacobian(own, hold_length=self.hold_length)
            by_length[..., segment.index, :, :] = fitted @ rest[..., segment.own, :]
            spent = arc.lengths_jacobian(routing[segment.further])
            rest[..., segment.further, :] -= spent @ by_length[..., segment.index, :, :]
        _, by_arcs = series_jacobian(self.arc.bend, np.ones(shape))
        return np.asarray(by_arcs @ by_length.reshape(*shape[:-1], 3 * shape[-1], count))


def _unactuated(robot: Robot, segment: _Segment, shape: tuple[int, ...]) -> Arc:
    """Arc (...) of a segment that no tendon passes: its arc without load."""
    if segment.further.size:
        raise InputError(
            f"segment {segment.index + 1} has no tendon that ends at it, so tendon lengths do not "
            "determine its arc; use tensions, or make it one segment with the next one"
        )
    x, y = robot.rest_curvature[segment.index, 1], -robot.rest_curvature[segment.index, 0]
    every = np.ones(shape)
    return Arc(np.hypot(x, y) * every, np.arctan2(y, x) * every, segment.length * every)


def _general(robot: Robot, segment: _Segment, arc: Arc) -> Arc:
    """Arc by the linear law of any backbone, from that of a straight isotropic one.

    The law adds to the curvature without load (theory Eq. 1.7).
    """
    rest = robot.rest_curvature[segment.index, 1::-1] * (1.0, -1.0)
    x, y = arc.kappa * np.cos(arc.phi), arc.kappa * np.sin(arc.phi)
    if not robot.is_round:
        by_moment = robot.bend_by_moment[segment.index]
        bend = np.stack([x, y], axis=-1) @ by_moment * (segment.bending_stiffness / segment.length)
        x, y = bend[..., 0], bend[..., 1]
    elif not rest.any():
        return arc
    x, y = x + rest[0], y + rest[1]
    return Arc(np.hypot(x, y), np.arctan2(y, x), arc.length)


@dataclass(frozen=True)
class _Segment:
    """One segment and its tendons."""

    index: int
    length: float
    bending_stiffness: float
    routing: Routing
    """Routing of all tendons of the robot in this segment."""
    own: NDArray[np.intp]
    """Indices of the tendons anchored to its end disk."""
    further: NDArray[np.intp]
    """Indices of the tendons that pass it."""
    places: Array
    """Disk positions over the length."""

    @contextmanager
    def named(self) -> Iterator[None]:
        """Context manager that names the segment in errors."""
        try:
            yield
        except BowstringError as error:
            raise type(error)(f"segment {self.index + 1}: {error}") from None


def _segments(robot: Robot, correction: Correction | None = None) -> list[_Segment]:
    check_option("correction", correction, (None, "chord"))
    out, start = [], 0.0
    stations, ends = np.asarray(_check_robot(robot).disks.station_m), robot.tendons.segment
    for j, segment in enumerate(robot.segments):
        # The stations are sums of lengths with rounding errors.
        here = (stations[robot.disks.segment == j] - start) / segment.length
        places = np.clip(here, 0.0, 1.0)
        if correction is not None and abs(places[-1] - 1.0) > 1e-9:
            raise InputError(
                f"segment {j + 1}: the chord correction needs a disk at the segment's end"
            )
        modules = None if correction is None else np.diff(places, prepend=0.0)
        routing = Routing.from_holes(robot.tendons.mean_hole_m[j], modules)
        own, further = np.flatnonzero(ends == j), np.flatnonzero(ends > j)
        stiffness = float(robot.bending_stiffness[j])
        out.append(_Segment(j, segment.length, stiffness, routing, own, further, places))
        start += segment.length
    return out


def _check_robot(robot: Robot) -> Robot:
    if not hasattr(robot, "segments"):
        raise InputError(
            f"robot is {robot!r:.60}, it must be a Robot, as bowstring.load_robot gives it"
        )
    return robot


def _stacked(arcs: list[Arc]) -> Arc:
    """Stack the arcs (...) of each segment to arcs (..., S)."""
    bend = np.stack([arc.bend for arc in arcs], axis=-2)
    return Arc._of(bend, bend.shape[:-1], np.stack([arc.misfit for arc in arcs], axis=-1))
