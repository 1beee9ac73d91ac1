"""3-D finite elements of a robot, solved by the separate program CalculiX."""

from bowstring.fem.comparison import BesideRod, beside_rod
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
    "BesideRod",
    "BrickRun",
    "Fineness",
    "Motion",
    "RunInterrupted",
    "Settings",
    "beside_rod",
    "cache_folder",
    "check",
    "ramp",
    "sweep",
]
