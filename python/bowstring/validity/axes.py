"""Axes of a map: numbers of the robot, its load or its actuation, with their ranges."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError
from bowstring.robot.designs import full_paths, numbers_of
from bowstring.robot.messages import units_of_field
from bowstring.robot.model import Robot
from bowstring.units import NUMBER, has_no_unit, quote, read_number

__all__ = ["LOADS", "MOST_POINTS", "RAMPS", "Axis", "read_axis"]

Floats = NDArray[np.float64]

LOADS: Final = {
    "tension": ("N", "N", "tension of the sweep"),
    "bend": ("rad", "deg", "commanded bend"),
    **{f"tip_force.{q}": ("N", "N", f"tip force along {q}") for q in "xyz"},
    **{f"gravity.{q}": ("m/s^2", "m/s^2", f"gravity along {q}") for q in "xyz"},
}
"""Axes that are not numbers of the robot file: SI unit, usual unit and label."""

RAMPS: Final = ("tension", "bend")
"""Axes along which a robot follows its ramp."""

MOST_POINTS: Final = 1001
"""Most points of an axis."""
_POINTS: Final = 21
_COUNT: Final = "count"
_LABELS: Final = {
    "E": "Young's modulus",
    "G": "shear modulus",
    "nu": "Poisson's ratio",
    "count": "number of disks",
    "clamped_length": "clamped length",
    "pitch_radius": "pitch radius",
    "length": "length",
    "diameter": "backbone diameter",
    "mass": "mass of a disk",
    "density": "density",
}


@dataclass(frozen=True)
class Axis:
    """One axis of a map.

    Parameters
    ----------
    path : str
        Number of the robot file, such as ``segments.*.backbone.E``, or one of `LOADS`.
    start, stop : float
        Range in SI.
    count : int
        Points in equal steps, at least 2.

    Raises
    ------
    InputError
        If the range or the number of points is not valid.
    """

    path: str
    start: float
    stop: float
    count: int = _POINTS

    def __post_init__(self) -> None:
        if not (np.isfinite(self.start) and np.isfinite(self.stop)) or self.start == self.stop:
            raise InputError(
                f"axis {self.path}: from {self.start:g} to {self.stop:g} is no range; give two "
                "different numbers"
            )
        if not 2 <= self.count <= MOST_POINTS:
            raise InputError(
                f"axis {self.path}: got {self.count} points; must be 2 to {MOST_POINTS}"
            )
        if self.is_whole:
            ends = (self.start, self.stop)
            if any(end != int(end) or end < 1 for end in ends):
                raise InputError(f"axis {self.path}: its ends must be whole numbers from 1")
        if self.path == "tension" and min(self.start, self.stop) < 0.0:
            raise InputError("axis tension: got a negative tension; a tendon can only pull")
        if self.path == "bend" and min(self.start, self.stop) < 0.0:
            raise InputError("axis bend: got a negative bend; actuate a tendon of the other side")

    @property
    def is_whole(self) -> bool:
        """Whether it has whole numbers only."""
        return self.path.rpartition(".")[2] == _COUNT

    @property
    def is_load(self) -> bool:
        """Whether it is a load or an actuation, not a number of the robot file."""
        return self.path in LOADS

    @property
    def values(self) -> Floats:
        """Points of the axis in SI, whole numbers without duplicates."""
        points = np.linspace(self.start, self.stop, self.count)
        return np.unique(np.round(points)) if self.is_whole else points

    @property
    def units(self) -> tuple[str, str]:
        """SI unit and usual unit; empty for a plain number."""
        if self.is_load:
            return LOADS[self.path][:2]
        return units_of_field(self.path) or ("", "")

    @property
    def factor(self) -> float:
        """Size of the usual unit in SI."""
        si, usual = self.units
        return read_number(f"1 {usual}", si) if usual else 1.0

    @property
    def label(self) -> str:
        """Label with the usual unit."""
        name = self.path.rpartition(".")[2]
        words = LOADS[self.path][2] if self.is_load else _LABELS.get(name, name.replace("_", " "))
        unit = self.units[1]
        return f"{words}, {unit}" if unit else words

    def own_value(self, robot: Robot) -> float | None:
        """The robot's own value in SI; None for a ramp, and where its parts differ."""
        name, _, along = self.path.partition(".")
        if self.path in RAMPS:
            return None
        if name == "tip_force":
            return 0.0
        if name == "gravity":
            return float(robot.gravity["xyz".index(along)])
        tree = dict(numbers_of(robot))
        found = {tree[path] for path in full_paths(robot, self.path)}
        return float(found.pop()) if len(found) == 1 else None


def read_axis(text: str, robot: Robot) -> Axis:
    """Read an axis such as ``"segments.*.backbone.E=20:50 GPa:21"``.

    Parameters
    ----------
    text : str
        PATH=from:to, or PATH=from:to:n. A start without a unit takes that of the end; without any
        unit both are SI.
    robot : Robot
        Robot that has the number.

    Returns
    -------
    Axis

    Raises
    ------
    InputError
        If the text or the path is wrong.
    """
    name, equals, rest = text.partition("=")
    parts = [part.strip() for part in rest.split(":")]
    if not (name.strip() and equals and len(parts) in (2, 3)):
        raise InputError(
            f'axis: got {quote(text)}; write PATH=from:to:n, for example "tension=0:80 N:41" or '
            '"segments.*.disks.clamped_length=0:6 mm:13".'
        )
    path = _canonical(name.strip(), robot)
    si, usual = Axis(path, 1.0, 2.0).units
    start, stop = parts[:2]
    if has_no_unit(start) and not has_no_unit(stop):
        start += f" {re.sub(f'^{NUMBER}', '', stop).strip()}"
    ends = []
    for item in (start, stop):
        try:
            ends.append(read_number(item, si))
        except ValueError as error:
            unit = f" {usual}" if usual else ""
            raise InputError(
                f"axis {path}: got {quote(item)}, {error}; write for example "
                f'"{path}=1:2{unit}:{_POINTS}".'
            ) from None
    axis = Axis(path, ends[0], ends[1])
    if len(parts) == 3:
        if not (parts[2].isdecimal() and len(parts[2]) <= 15):
            raise InputError(
                f"axis {path}: got {quote(parts[2])} points; write a whole number from 2."
            )
        axis = replace(axis, count=int(parts[2]))
    elif axis.is_whole:
        axis = replace(axis, count=min(MOST_POINTS, int(abs(ends[1] - ends[0])) + 1))
    return axis


def _canonical(path: str, robot: Robot) -> str:
    """The path with ``*`` for the indices of all numbers that it means."""
    if path in LOADS:
        return path
    try:
        paths = full_paths(robot, path)
    except InputError as error:
        raise InputError(f"axis: {error} Loads are {', '.join(LOADS)}.") from None
    if len(paths) == 1 or "*" in path:
        return paths[0] if len(paths) == 1 else path
    return ".".join("*" if key.isdecimal() else key for key in paths[0].split("."))
