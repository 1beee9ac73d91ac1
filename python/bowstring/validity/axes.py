"""Axes of a map: numbers of the robot, its load or its actuation, with their ranges."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.formatting import listed, significant
from bowstring.robot.fields import quantity_of
from bowstring.robot.messages import units_of_field
from bowstring.robot.model import Robot
from bowstring.robot.paths import find, full_paths, numbers_of
from bowstring.robot.stiffness import entry_of, mirrored
from bowstring.units import NUMBER, has_no_unit, quote, read_number
from bowstring.validation import shown

LOADS: Final = {
    "tension": ("N", "N", "tension of the sweep"),
    "bend": ("rad", "deg", "commanded bend"),
    **{f"tip_force.{q}": ("N", "N", f"tip force along {q}") for q in "xyz"},
    **{f"gravity.{q}": ("m/s^2", "m/s^2", f"gravity along {q}") for q in "xyz"},
    "tip_force": ("N", "N", "tip force"),
    "payload": ("kg", "g", "payload at the tip"),
    "tilt": ("rad", "deg", "tilt of the base"),
    "tilt_towards": ("rad", "deg", "direction of the tilt"),
}
"""Axes that are not numbers of the robot file: SI unit, usual unit and label."""

BY_DISPLACEMENT: Final = (
    *("axial_stiffness", "compliance", "free_length", "pretension"),
    *("backlash", "hole_clearance", "mount_compliance", "gain", "zero"),
)
"""Numbers of tendons that act under displacement control only."""
RAMPS: Final = ("tension", "bend")
"""Axes along which a robot follows its ramp."""

MOST_POINTS: Final = 1001
"""Most points of an axis."""
_POINTS: Final = 21
_WHOLE_POINTS: Final = 41
_COUNT: Final = "count"
_WHOLE: Final = ("tip_force", "payload", "tilt", "tilt_towards")  # loads without components
_ANGLES: Final = ("bend", "tilt", "tilt_towards")
_FAR: Final = 100.0  # ratio of a range to the robot's own value that suggests another unit
_MOST_RANGES: Final = 4  # in a sentence
_DIGITS: Final = 3
_FINE: Final = 0.01  # range of an axis over its numbers below which they have more digits
_LABELS: Final = {
    "E": "Young's modulus",
    "G": "shear modulus",
    "count": "number of disks",
    "clamped_length": "clamped length",
    "pitch_radius": "pitch radius",
    "length": "length",
    "diameter": "backbone diameter",
    "mass": "mass of a disk",
    "density": "density",
    "inner_diameter": "inner diameter of the backbone",
    "nu": "Poisson's ratio",
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
            raise InputError(f"axis {self.path}: its ends must be two different finite numbers")
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
        if self.path == "payload" and min(self.start, self.stop) < 0.0:
            raise InputError("axis payload: got a negative mass; a payload is 0 g or more")

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
    def words(self) -> str:
        """Name of the number, without its unit."""
        if (entry := entry_of(self.path)) is not None:
            return f"stiffness in row {entry[0] + 1}, column {entry[1] + 1} (SI)"
        name = self.path.rpartition(".")[2]
        return LOADS[self.path][2] if self.is_load else _LABELS.get(name, name.replace("_", " "))

    @property
    def label(self) -> str:
        """Label of a figure, with the usual unit."""
        unit = self.units[1]
        return f"{self.words} ({unit})" if unit else self.words

    def own_value(self, robot: Robot) -> float | None:
        """The robot's own value in SI; None for a ramp, and where its parts differ."""
        name, _, along = self.path.partition(".")
        if self.path in RAMPS:
            return None
        if name in _WHOLE:
            return 0.0
        if name == "gravity":
            return float(robot.gravity["xyz".index(along)])
        tree = dict(numbers_of(robot))
        found = {tree[path] for path in full_paths(robot, self.path)}
        return float(found.pop()) if len(found) == 1 else None

    def own_value_inside(self, robot: Robot) -> float | None:
        """The robot's own value in SI where it is on the axis."""
        own = self.own_value(robot)
        inside = own is not None and self.values.min() <= own <= self.values.max()
        return own if inside else None


def read_axis(text: str, robot: Robot) -> Axis:
    """Read an axis such as ``"segments.*.backbone.E=20:50 GPa:21"``.

    Parameters
    ----------
    text : str
        PATH=from:to, or PATH=from:to:n. A start without a unit takes that of the end; without any
        unit both are SI.
    robot : Robot
        Robot that has the number.

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
    path, _ = _place(name, robot)
    si, usual = Axis(path, 1.0, 2.0).units
    start, stop = parts[:2]
    number = re.match(NUMBER, stop)
    if has_no_unit(start) and number and not has_no_unit(stop):
        start += f" {stop[number.end() :].strip()}"
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
    if has_no_unit(stop) and _means_usual_unit(axis, robot):
        raise InputError(
            f"axis {path}: got {parts[0]} to {stop} without a unit, which is {si}; write "
            f'"{parts[0]}:{stop} {usual}" if that is meant, else "{parts[0]}:{stop} {si}"'
        )
    if len(parts) == 3:
        if not (parts[2].isdecimal() and len(parts[2]) <= 15):
            raise InputError(
                f"axis {path}: got {quote(parts[2])} points; write a whole number from 2."
            )
        axis = replace(axis, count=int(parts[2]))
    elif axis.is_whole:
        axis = replace(axis, count=min(_WHOLE_POINTS, int(abs(ends[1] - ends[0])) + 1))
    return axis


def _means_usual_unit(axis: Axis, robot: Robot) -> bool:
    """Whether numbers without a unit fit the robot's own value in usual units, but not in SI."""
    if axis.path in _ANGLES:
        return max(abs(axis.start), abs(axis.stop)) > 2.0 * np.pi
    own = axis.own_value(robot)
    if not own or axis.factor == 1.0:
        return False
    ends = np.abs([axis.start, axis.stop]) / abs(own)

    def near(values: Floats) -> bool:
        return bool(((values > 1.0 / _FAR) & (values < _FAR)).any())

    return not near(ends) and near(ends * axis.factor)


def axes_of(robot: Robot, over: Sequence[str | Axis]) -> tuple[Axis, ...]:
    """Read the axes of a map, and check that they are different numbers.

    Parameters
    ----------
    robot : Robot
        Robot that has the numbers.
    over : sequence of str or Axis

    Returns
    -------
    tuple of Axis
        Their paths in the usual form (`bowstring.robot.paths.find`).

    Raises
    ------
    InputError
        If an axis is wrong, or two of them are the same number.
    """
    axes = []
    seen: dict[str, str] = {}
    for one in over:
        if not isinstance(one, str | Axis):
            raise InputError(f"axis is {shown(one)}, it must be text or an Axis")
        axis = read_axis(one, robot) if isinstance(one, str) else one
        path, targets = _place(axis.path, robot)
        axes.append(replace(axis, path=path))
        _check_range(axes[-1], robot, targets[0])
        for target in targets:
            if seen.get(target) == path:
                raise InputError(f"two axes are {path}; give different ones")
            if target in seen and mirrored(target) is not None and seen[target] != path:
                raise InputError(
                    f"axes {seen[target]} and {path} are the same entry of the symmetric stiffness "
                    "matrix; leave one of them out"
                )
            if target in seen:
                raise InputError(
                    f"axes {seen[target]} and {path} both have {target}; leave one of them out"
                )
        mirrors = [mirror for target in targets if (mirror := mirrored(target)) is not None]
        seen.update(dict.fromkeys([*targets, *mirrors], path))
    return tuple(axes)


def _check_range(axis: Axis, robot: Robot, target: str) -> None:
    """Refuse an axis with values that the robot refuses."""
    if entry_of(target) is not None:
        _check_entry(axis, robot, target)
    quantity = None if axis.is_load else quantity_of(robot, target)
    if quantity is None:
        return
    low, high = (read_number(end, quantity.si) for end in (quantity.low, quantity.high))
    for end in (axis.start, axis.stop):
        if not low <= end <= high:
            raise InputError(
                f"axis {axis.path}: got {end / axis.factor:g} {axis.units[1]}".rstrip()
                + f"; must lie between {quantity.low} and {quantity.high}"
            )


def _check_entry(axis: Axis, robot: Robot, target: str) -> None:
    """Refuse an entry with which the stiffness matrix is not positive definite.

    Values with which it is positive definite form an interval: it suffices to try both ends.
    """
    for end in (axis.start, axis.stop):
        try:
            robot.with_({target: end})
        except InputError as error:
            why = str(error).partition("got a matrix ")[2].partition(";")[0]
            said = f"gives a matrix {why}" if why else f"is refused: {error}"
            raise InputError(f"axis {axis.path}: {end:g} {said}; give a smaller range") from None


def _place(path: str, robot: Robot) -> tuple[str, tuple[str, ...]]:
    """Usual form of the path of an axis, and the full paths of its numbers."""
    try:
        name, targets = find(robot, path, LOADS)
    except InputError as error:
        if path.rpartition(".")[2] == "axial_stiffness":
            raise InputError(
                f"axis {path}: the tendons of {robot.name} are inextensible; give them a stiffness "
                'first, such as --set segments.0.tendons.axial_stiffness="30 kN"'
            ) from None
        raise InputError(f"axis: {error}") from None
    if name.endswith("tendons.count"):
        raise InputError(
            f"axis {name}: a map keeps the number of tendons, which its tensions are for; make a "
            "map for each, with --set"
        )
    return name, targets


def in_words(axis: Axis, value: float) -> str:
    """A value of an axis, such as ``tip force along x 0.5 N``."""
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    return f"{axis.words} {significant(value / axis.factor)}{unit}"


def in_ranges(axis: Axis, ranges: Floats) -> str:
    """Ranges (n, 2) of an axis, such as ``from 0 to 56.1 N`` or ``from 4 disks on``."""
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    values = np.sort(axis.values)
    if axis.is_whole:
        parts = [_of_disks(int(low), int(high), values) for low, high in ranges]
    else:
        parts = []
        for low, high in ranges / axis.factor:
            first, last = (_text(end, axis) for end in (low, high))
            parts.append(f"at {first}{unit}" if low == high else f"from {first} to {last}{unit}")
    if len(parts) > _MOST_RANGES:
        return f"{', '.join(parts[:_MOST_RANGES])} and in {len(parts) - _MOST_RANGES} more ranges"
    return listed(parts)


def _of_disks(low: int, high: int, values: Floats) -> str:
    if low == high:
        return f"at {low} disks"
    if high == values[-1]:
        return f"from {low} disks on"
    return f"up to {high} disks" if low == values[0] else f"from {low} to {high} disks"


def _text(value: float, axis: Axis) -> str:
    """A value of an axis in its usual unit, with more digits where the axis is short."""
    span = abs(axis.stop - axis.start) / axis.factor
    if abs(value) < 1e-6 * span:
        return "0"
    more = math.log10(max(1.0, _FINE * abs(value) / span))
    return significant(value, _DIGITS + math.ceil(more))
