"""Pose: position and orientation in a frame."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

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
