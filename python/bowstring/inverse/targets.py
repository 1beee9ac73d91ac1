"""Wanted poses of the tip."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Targets", "across", "angle_between"]

Floats = NDArray[np.float64]


class Targets(NamedTuple):
    """Wanted poses of the tip, and how near the nearest one has to be."""

    positions: Floats
    """Positions (n, 3), m."""
    directions: Floats | None
    """Directions (n, 3) of the tangent, of length one."""
    margin: float
    """As `distance_margin` of `bowstring.inverse_kinematics`."""

    def row(self, k: int) -> tuple[Floats, Floats | None]:
        """Position and direction of a row."""
        return self.positions[k], None if self.directions is None else self.directions[k]


def across(direction: Floats | None) -> Floats:
    """Two directions (2, 3) across one; none (0, 3) without one."""
    if direction is None:
        return np.zeros((0, 3))
    return np.asarray(np.linalg.svd(direction[None])[2][1:])


def angle_between(a: Floats, b: Floats) -> Floats:
    """Angle between directions (..., 3) of length one, rad; exact also for small angles."""
    chord = np.linalg.norm(a - b, axis=-1)
    return np.asarray(2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0)))
