"""The loads of a robot at one instant."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Load"]

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Load:
    """Loads at one time: what drives each tendon, and forces at the tip."""

    drive: Floats
    """(T,): tension in N or, of a tendon that is pulled by a length, its pull in m."""
    tip_force: Floats
    tip_moment: Floats

    def __iter__(self) -> Iterator[Floats]:
        return iter((self.drive, self.tip_force, self.tip_moment))

    @property
    def tip(self) -> tuple[Floats, Floats]:
        """Force and moment at the tip."""
        return self.tip_force, self.tip_moment
