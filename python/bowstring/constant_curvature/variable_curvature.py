"""Backbones whose curvature varies along the arc length: polynomials in each segment.

The curvature vector of a segment is a polynomial of its arc length, without torsion, as in
`bowstring.constant_curvature.arc`: of degree 0 it is an arc, of degree 1 in a plane a clothoid. Its
coefficients are those of shifted Legendre polynomials, theory Eq. 1.12: the first is the mean
curvature, which the others do not change.

The frame is integrated by a commutator-free method of fourth order [1]_: two arcs in each step, so
that a polynomial of degree 0 is exact.

.. [1] S. Blanes and P. C. Moan, Applied Numerical Mathematics 56 (2006) 1519-1537.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bowstring._core as _core
from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.pose import Pose
from bowstring.validation import floats

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

Ints = NDArray[np.intp]

MAX_DEGREE: Final = 5
"""Highest degree of the polynomials."""

_STEPS: Final = 48  # least steps of a segment
_NODE: Final = math.sqrt(3.0) / 6.0  # node of Gauss' rule, from the middle of a step
_WEIGHTS: Final = (0.25 + _NODE, 0.25 - _NODE)  # weights of both nodes in the first arc of a step


def legendre(share: Floats, degree: int) -> Floats:
    """Shifted Legendre polynomials (n, degree + 1) at shares (n,) of a segment."""
    return np.asarray(np.polynomial.legendre.legvander(2.0 * share - 1.0, degree))


@dataclass(frozen=True)
class _Arcs:
    """Arcs of all steps of a robot, from base to tip."""

    length: Floats
    """Lengths (A,), m."""
    weight: Floats
    """Bend (A, degree + 1) of each arc by the coefficients of its segment."""
    first: list[int]
    """First arc of each segment, and the number of all."""
    disk: Ints
    """Number of arcs before each disk (N,)."""


@short_repr
@dataclass(frozen=True, eq=False)
class VariableCurvature:
    """Backbones of a robot with a polynomial curvature in each segment, or an array of them."""

    robot: Robot = field(repr=False)
    bend: Floats
    """Coefficients (..., S, degree + 1, 2) of the curvature times the length of the segment, rad:
    towards x and y of the frame without torsion. The first is the mean over the segment."""

    def __post_init__(self) -> None:
        shape, count = self.bend.shape, len(self.robot.segments)
        if len(shape) < 3 or shape[-3] != count or shape[-1] != 2 or shape[-2] > MAX_DEGREE + 1:
            raise InputError(
                f"bend has shape {shape}, it must be (..., {count}, degree + 1, 2) for the "
                f"segments of {self.robot.name}, with a degree from 0 to {MAX_DEGREE}"
            )

    @property
    def degree(self) -> int:
        """Degree of the polynomials: 0 for constant curvature."""
        return int(self.bend.shape[-2]) - 1

    def curvature(self, segment: int, share: ArrayLike) -> Floats:
        """Curvature vector of a segment at shares of its length.

        Parameters
        ----------
        segment : int
            Index of the segment, from 0.
        share : array_like (n,)
            Shares of the length of the segment, from 0 to 1.

        Returns
        -------
        ndarray (..., n, 2)
            Towards x and y of the frame without torsion, 1/m.
        """
        values = legendre(floats(share).reshape(-1), self.degree) @ self.bend[..., segment, :, :]
        return np.asarray(values / self.robot.segments[segment].length)

    @property
    def disk_positions(self) -> Floats:
        """Disk centres from base to tip, base excluded (..., N, 3), m."""
        return np.asarray(self._disks.position)

    @property
    def disk_rotations(self) -> Floats:
        """Disk rotations (..., N, 3, 3)."""
        return np.asarray(self._disks.rotation)

    @property
    def tip(self) -> Pose:
        """Pose of the tip: position (..., 3), m, and rotation (..., 3, 3)."""
        return Pose(self.disk_positions[..., -1, :], self.disk_rotations[..., -1, :, :])

    def centerline(self) -> Floats:
        """Points (..., n, 3) of the backbone from base to tip, at the ends of the steps, m."""
        position = self._chain[0]
        return np.moveaxis(position[::2], 0, 1).reshape(*self._lead, -1, 3)

    def disk_jacobian(self) -> Floats:
        """Derivative of the disk centres by the coefficients, shape (..., N, 3, S, degree + 1, 2).

        It is that of the integrated steps, without a further error.
        """
        arcs, (position, rotation) = self._arcs, self._chain
        count = position.shape[1]
        local = _core.arc_pose_jacobian(self._bends.reshape(-1, 3)).reshape(-1, count, 6, 3)
        turn = rotation[:-1] @ local[..., 3:, :2]
        # an arc turns all beyond its end: dp_i = dp + w x (p_i - p), as X + Y x p_i
        shift = rotation[:-1] @ local[..., :3, :2]
        shift = shift + np.cross(position[1:, :, :, None], turn, axis=-2)
        disks = np.moveaxis(position[arcs.disk], 0, 1)
        out = np.zeros((*disks.shape, len(self.robot.segments), self.degree + 1, 2))
        for k, (first, end) in enumerate(zip(arcs.first, arcs.first[1:], strict=False)):
            at = np.clip(arcs.disk, first, end) - first
            sums = []
            for part in (shift, turn):
                each = part[first:end, :, :, None, :] * arcs.weight[first:end, None, None, :, None]
                total = np.concatenate([np.zeros((1, *each.shape[1:])), np.cumsum(each, axis=0)])
                sums.append(np.moveaxis(total[at], 0, 1))
            out[..., k, :, :] = sums[0] + np.cross(sums[1], disks[..., None, None], axis=2)
        return out.reshape(*self._lead, *out.shape[1:])

    # -- integration ---------------------------------------------------------------------------

    @property
    def _lead(self) -> tuple[int, ...]:
        return self.bend.shape[:-3]

    @cached_property
    def _arcs(self) -> _Arcs:
        robot = self.robot
        stations, lengths, weights = np.asarray(robot.disks.station_m), [], []
        first, ends = [0], []
        start = 0.0
        for k, segment in enumerate(robot.segments):
            inside = np.clip((stations[robot.disks.segment == k] - start) / segment.length, 0, 1)
            edges = [0.0]
            for place in inside.tolist():
                steps = max(1, math.ceil(_STEPS * (place - edges[-1]) - 1e-9))
                edges += np.linspace(edges[-1], place, steps + 1)[1:].tolist()
                ends.append(first[-1] + 2 * (len(edges) - 1))
            steps_of = np.diff(edges)
            middle = np.array(edges[:-1]) + 0.5 * steps_of
            low, high = (legendre(middle + q * _NODE * steps_of, self.degree) for q in (-1.0, 1.0))
            a, b = _WEIGHTS
            pairs = np.stack([a * low + b * high, b * low + a * high], axis=1)
            weights.append((steps_of[:, None, None] * pairs).reshape(-1, self.degree + 1))
            lengths.append(np.repeat(0.5 * steps_of, 2) * segment.length)
            first.append(first[-1] + 2 * len(steps_of))
            start += segment.length
        return _Arcs(np.concatenate(lengths), np.concatenate(weights), first, np.array(ends))

    @cached_property
    def _bends(self) -> Floats:
        """Bend coordinates (A, K, 3) of all arcs of K backbones."""
        arcs, bend = self._arcs, self.bend.reshape(-1, *self.bend.shape[-3:])
        parts = [
            np.einsum("aj,kjq->akq", arcs.weight[first:end], bend[:, k])
            for k, (first, end) in enumerate(zip(arcs.first, arcs.first[1:], strict=False))
        ]
        whole = np.concatenate(parts)
        length = np.broadcast_to(arcs.length[:, None, None], (*whole.shape[:2], 1))
        return np.concatenate([whole, length], axis=-1)

    @cached_property
    def _chain(self) -> tuple[Floats, Floats]:
        """Positions (A + 1, K, 3) and rotations (A + 1, K, 3, 3) at the ends of the arcs."""
        bends = self._bends
        steps, turns = _core.arc_pose(bends.reshape(-1, 3))
        steps, turns = steps.reshape(bends.shape), turns.reshape(*bends.shape, 3)
        position, rotation = (np.zeros((len(bends) + 1, *a.shape[1:])) for a in (steps, turns))
        rotation[0] = np.eye(3)
        for i, (step, turn) in enumerate(zip(steps, turns, strict=True)):
            position[i + 1] = position[i] + (rotation[i] @ step[..., None])[..., 0]
            rotation[i + 1] = rotation[i] @ turn
        return position, rotation

    @cached_property
    def _disks(self) -> Pose:
        position, rotation = (np.moveaxis(a[self._arcs.disk], 0, 1) for a in self._chain)
        return Pose(
            position.reshape(*self._lead, *position.shape[1:]),
            rotation.reshape(*self._lead, *rotation.shape[1:]),
        )
