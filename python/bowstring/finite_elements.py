"""A robot by 3-D finite elements: what `bowstring.bricks` has for users, in one place."""

from __future__ import annotations

from bowstring.bricks.comparison import BesideRod, beside_rod
from bowstring.bricks.mesh import Fineness
from bowstring.bricks.run import (
    BrickRun,
    RunInterrupted,
    Settings,
    cache_folder,
    check,
    ramp,
    sweep,
)

__all__ = [
    "BesideRod",
    "BrickRun",
    "Fineness",
    "RunInterrupted",
    "Settings",
    "beside_rod",
    "cache_folder",
    "check",
    "ramp",
    "sweep",
]
