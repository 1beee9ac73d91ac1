"""Numbers that a distribution can be on, by path: of the robot file, the actuation and the load."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.robot.fields import number_fields, quantity_of
from bowstring.robot.model import Robot, check_robot
from bowstring.robot.paths import example_path, find, no_such
from bowstring.robot.stiffness import entry_of
from bowstring.units import has_no_unit, quote, read_number, rounded, unit_of_size

#: Actuation and loads at the tip: SI unit, usual unit, least value, members.
LOADS: Final = {
    "tensions": ("N", "N", 0.0, None),
    "displacements": ("m", "mm", -math.inf, None),
    "angles": ("rad", "deg", -math.inf, None),
    "tip_force": ("N", "N", -math.inf, ("x", "y", "z")),
    "tip_moment": ("N*m", "N*m", -math.inf, ("x", "y", "z")),
}


@dataclass(frozen=True)
class NumberAtPath:
    """A number by its path, or several that share one value.

    Attributes
    ----------
    path : str
        Path in its usual form (`bowstring.robot.paths.find`), possibly with ``*``.
    targets : tuple of str
        Paths without ``*`` that it stands for.
    si, unit : str
        SI unit and usual unit; empty for plain numbers.
    nominal : tuple of float
        Nominal values of the targets in SI; empty if unknown.
    low, high : float
        Range that the robot allows, in SI.
    """

    path: str
    targets: tuple[str, ...]
    si: str
    unit: str
    nominal: tuple[float, ...]
    low: float
    high: float

    def read(self, name: str, value: object) -> float:
        """Read a number of a distribution: text with a unit, text in percent of nominal, or SI."""
        if isinstance(value, bool) or not isinstance(value, (str, int, float)):
            raise self.error(f"{name} is {quote(value)}, it must be {self._advice}")
        if not isinstance(value, str):
            return float(value)
        if value.strip().endswith("%"):
            return self._share(name, value)
        if self.si and has_no_unit(value):
            raise self.error(f"{name} is {quote(value)} without a unit, it must be {self._advice}")
        try:
            return read_number(value, self.si)
        except ValueError as error:
            raise self.error(f"{name} is {quote(value)}, {error}; write {self._advice}") from None

    def nominal_value(self, name: str) -> float:
        """Nominal value, for a distribution that leaves `name` out or has it in percent."""
        if not self.nominal:
            raise self.error(
                f"{name} needs a nominal value, and none is known; give {name} with "
                f"{'a unit' if self.si else 'a number'}"
            )
        if len(set(self.nominal)) > 1:
            values = listed([self.text(v) for v in self.nominal[:4]])
            raise self.error(
                f"{name} needs one nominal value, and the nominal values differ "
                f"({values}); give every number of the distribution in "
                f"{self.unit or 'numbers'}, or each path a distribution of its own"
            )
        return self.nominal[0]

    def text(self, value: float, digits: int = 4) -> str:
        """Write an SI value in the usual unit of its size."""
        if not self.si:
            return rounded(value, digits)
        unit = unit_of_size(value, self.si, self.unit) if math.isfinite(value) else self.unit
        return f"{rounded(value / read_number(f'1 {unit}', self.si), digits)} {unit}"

    def error(self, sentence: str) -> InputError:
        """Make an error that begins with the path."""
        return InputError(f"{self.path}: {sentence}", argument="distributions")

    def _share(self, name: str, text: str) -> float:
        try:
            share = read_number(text.strip()[:-1], "") / 100.0
        except ValueError:
            raise self.error(f"{name} is {quote(text)}, it must be {self._advice}") from None
        nominal = self.nominal_value(name)
        if nominal == 0.0:
            raise self.error(
                f"{name} is {quote(text)} of a nominal value of zero, it must be {self._example}"
            )
        return share * abs(nominal) if name == "sd" else share * nominal

    @property
    def _example(self) -> str:
        return f'a number with a unit, as "2 {self.unit}"' if self.si else "a plain number"

    @property
    def _advice(self) -> str:
        return f'{self._example}, or a share of the nominal value, as "5 %"'


class NumbersByPath:
    """Paths of one robot and its loads.

    Parameters
    ----------
    robot : Robot
    nominal : mapping from path to float, optional
        Nominal values of actuation and loads in SI, for shares such as ``5 %``.
    """

    def __init__(self, robot: Robot, nominal: Mapping[str, float] | None = None) -> None:
        check_robot(robot)
        self._robot = robot
        self._tree = robot.model_dump(mode="json", exclude_none=True)
        self._fields = {
            path: value
            for path, value in number_fields(self._tree)
            if quantity_of(robot, path) is not None
        }
        count = len(robot.tendons.segment)
        self._loads = {
            f"{name}.{member}": name
            for name, (*_, members) in LOADS.items()
            for member in members or range(count)
        }
        self._nominal = dict(nominal or {})
        for path in self._nominal:
            if path not in self._loads:
                raise no_such(robot, path, self._loads)

    def __getitem__(self, path: object) -> NumberAtPath:
        if not isinstance(path, str):
            raise InputError(f"path is {quote(path)}, it must be text, as segments.*.backbone.E")
        try:
            name, targets = find(self._robot, path, self._loads)
        except InputError as error:
            raise InputError(str(error), argument="distributions") from None
        if targets[0] in self._loads:
            return self._load(name, targets)
        if entry_of(targets[0]) is not None:
            raise InputError(
                f"{name} is an entry of a stiffness matrix, which takes no distribution; give one "
                "to another number, as pitch_radius",
                argument="distributions",
            )
        if targets[0] not in self._fields:
            raise InputError(
                f"{name} is a whole number or a share; a distribution is of a number that varies "
                f"continuously, as {example_path(self._robot)}",
                argument="distributions",
            )
        quantity = quantity_of(self._robot, targets[0])
        assert quantity is not None
        nominal = tuple(self._fields[p] for p in targets)
        usual = quantity.example.rpartition(" ")[2] if quantity.si else ""
        low, high = (read_number(end, quantity.si) for end in (quantity.low, quantity.high))
        unit = unit_of_size(nominal[0], quantity.si, usual)
        return NumberAtPath(name, targets, quantity.si, unit, nominal, low, high)

    def _load(self, name: str, targets: tuple[str, ...]) -> NumberAtPath:
        si, unit, low, _ = LOADS[self._loads[targets[0]]]
        known = [self._nominal[p] for p in targets if p in self._nominal]
        nominal = tuple(known) if len(known) == len(targets) else ()
        return NumberAtPath(name, targets, si, unit, nominal, low, math.inf)
