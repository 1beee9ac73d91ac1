"""Wanted poses of the tip, and the results of a row."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bowstring.aliases import Floats

if TYPE_CHECKING:
    from bowstring._core import Solution


class Targets(NamedTuple):
    """Wanted poses of the tip, and how near the nearest one has to be."""

    positions: Floats
    """Positions (n, 3), m."""
    directions: Floats | None
    """Directions (n, 3) of the tangent, of length one."""
    margin: float
    """Margin for the distance, `distance_margin` of `bowstring.inverse_kinematics`."""

    def row(self, k: int) -> tuple[Floats, Floats | None]:
        """Position and direction of a row."""
        return self.positions[k], None if self.directions is None else self.directions[k]


def across(direction: Floats | None) -> Floats:
    """Two directions (2, 3) perpendicular to one; (0, 3) without one."""
    if direction is None:
        return np.zeros((0, 3))
    return np.asarray(np.linalg.svd(direction[None])[2][1:])


def angle_between(a: Floats, b: Floats) -> Floats:
    """Angle between directions (..., 3) of length one, rad; exact also for small angles."""
    chord = np.linalg.norm(a - b, axis=-1)
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))


def write_row(
    found: dict[str, Any],
    k: int,
    target: tuple[Floats, Floats | None],
    tensions: Floats,
    solution: Solution,
) -> None:
    """Write an equilibrium to row `k` of the fields of `InverseSolution`, without its status."""
    position, direction = target
    found["stable"][k] = solution.stable
    found["tensions"][k] = tensions
    found["tip_position"][k] = solution.tip_position
    found["tip_rotation"][k] = solution.tip_rotation
    found["tendon_lengths"][k] = solution.tendon_lengths
    distance = np.linalg.norm(found["tip_position"][k] - position)
    found["distance"][k] = found["nearest_distance"][k] = distance
    if solution.error_estimate is not None:
        found["tip_error"][k] = solution.error_estimate[0]
    if direction is not None:
        tangent = found["tip_rotation"][k][:, 2]
        found["direction_error"][k] = angle_between(tangent, direction)
