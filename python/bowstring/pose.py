"""Pose: position and orientation in a frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from bowstring.results import Key, Result

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Pose(Result):
    """Position and orientation in the base frame.

    Of many poses, both have the same leading dimensions. ``position, rotation = pose`` takes a
    pose apart, and ``a @ b`` composes two: `b` is given in the frame of `a`.
    """

    position: Annotated[Array, Key("position_m")]
    """Position (3,), m."""
    rotation: Annotated[Array, Key()]
    """Rotation matrix by rows (3, 3); it maps body axes to base axes."""

    def __iter__(self) -> Iterator[Array]:
        return iter((self.position, self.rotation))

    def __matmul__(self, other: Pose) -> Pose:
        """Compose with `other`; leading dimensions broadcast."""
        moved = (self.rotation @ other.position[..., None])[..., 0]
        return Pose(self.position + moved, self.rotation @ other.rotation)
