"""Pose: position and orientation in a frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from bowstring.aliases import Floats
from bowstring.results import Key, Result


@dataclass(frozen=True, eq=False)
class Pose(Result):
    """Position and orientation in the base frame.

    Of many poses, both have the same leading dimensions. ``position, rotation = pose`` takes a
    pose apart, and ``a @ b`` composes two: `b` is given in the frame of `a`.
    """

    position: Annotated[Floats, Key("position_m")]
    """Position (3,), m."""
    rotation: Annotated[Floats, Key()]
    """Rotation matrix by rows (3, 3); it maps body axes to base axes."""

    def __iter__(self) -> Iterator[Floats]:
        return iter((self.position, self.rotation))

    def __matmul__(self, other: Pose) -> Pose:
        """Compose with `other`; leading dimensions broadcast."""
        moved = (self.rotation @ other.position[..., None])[..., 0]
        return Pose(self.position + moved, self.rotation @ other.rotation)


def nearest_rotation(overlap: Floats) -> Floats:
    """Rotations (..., 3, 3) with the largest inner products with matrices.

    Least squares without reflection (Kabsch, Acta Cryst. A32, 1976; Umeyama 1991).
    """
    u, _, vt = np.linalg.svd(overlap)
    u[..., 2] *= np.linalg.det(u @ vt)[..., None]
    return np.asarray(u @ vt)
