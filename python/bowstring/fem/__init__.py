"""3-D finite elements of a robot, solved by the separate program CalculiX."""

from bowstring.fem.comparison import RodComparison, compare_with_rod
from bowstring.fem.mesh import Fineness
from bowstring.fem.run import (
    BrickRun,
    Motion,
    RunInterrupted,
    Settings,
    cache_folder,
    check,
    ramp,
    sweep,
)

__all__ = [
    "BrickRun",
    "Fineness",
    "Motion",
    "RodComparison",
    "RunInterrupted",
    "Settings",
    "cache_folder",
    "check",
    "compare_with_rod",
    "ramp",
    "sweep",
]
