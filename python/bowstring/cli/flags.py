"""Kinds of flags: how a text becomes numbers, vectors, shares, values of tendons or loads on disks.

Units are SI where the text has none.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final

from bowstring.cli.groups import Flag
from bowstring.cli.output import counted
from bowstring.errors import InputError
from bowstring.units import NUMBER, has_no_unit, number_with_unit, quote, read_number, read_share

if TYPE_CHECKING:
    from bowstring.robot.model import Robot
    from bowstring.statics.load import PointLoad

#: Coordinate over the robot's length above which a number without a unit is hardly in m.
FAR: Final = 10.0
MOST_LOADS: Final = 100_000  # loads of a range
_EARTH_IN_MM: Final = (9700.0, 9900.0)  # Earth's gravity in mm/s^2
_RULES: Final[dict[str, Callable[[float], bool]]] = {
    "": lambda value: True,
    "positive": lambda value: value > 0,
    "0 or more": lambda value: value >= 0,
}


class Numbers(Flag):
    """A flag of numbers of one SI unit.

    Parameters
    ----------
    si, example : str
        Unit, and an example for messages.
    text, name, default, values
        As of `Flag`; the form of the value is the unit if left out.
    must_be : str
        Rule for a single number: "positive" or "0 or more".
    far : float, optional
        Number of the robot's lengths above which a number without a unit is hardly in m.
    """

    form = ""

    def __init__(
        self,
        si: str,
        example: str,
        text: str,
        name: str = "",
        *,
        form: str = "",
        must_be: str = "",
        far: float | None = None,
        **more: Any,
    ) -> None:
        super().__init__(form or type(self).form or si, text, name, **more)
        self.si, self.example, self.must_be, self.far = si, example, must_be, far

    def numbers(self, flag: str, text: str, example: str = "") -> list[float]:
        """Read numbers that commas separate."""
        values = []
        for item in text.split(","):
            try:
                values.append(read_number(item, self.si))
            except ValueError as error:
                raise InputError(
                    f"{flag}: got {quote(item.strip())}, {error}; write for example {flag} "
                    f"{example or self.example}."
                ) from None
            low, high = _EARTH_IN_MM
            if self.si == "m/s^2" and has_no_unit(item) and low < abs(values[-1]) < high:
                raise without_unit(flag, item.strip(), self.si, "mm/s^2")
        return values

    def number(self, flag: str, text: str) -> float:
        """Read one number."""
        values = self.numbers(flag, text)
        if len(values) != 1:
            raise InputError(f"{flag}: got {len(values)} numbers; write one.")
        if not _RULES[self.must_be](values[0]):
            value = f"{values[0]:g} {self.si}".strip()
            raise InputError(f"{flag}: got {value}; must be {self.must_be}.")
        return values[0]

    def vector(self, flag: str, text: str) -> list[float]:
        """Read x, y and z."""
        values = self.numbers(flag, text)
        if len(values) != 3:
            raise InputError(
                f"{flag}: got {counted(len(values), 'number')}; write x, y and z, "
                f"for example {flag} {self.example}."
            )
        return values

    def check_far(self, flag: str, text: str, robot: Robot) -> None:
        if self.far is not None:
            check_bare(flag, text, self.si, robot, self.far * robot.length, "mm")


class Number(Numbers):
    """One number."""

    def read(self, flag: str, text: str, robot: Robot) -> float:
        self.check_far(flag, text, robot)
        return self.number(flag, text)


class Vector(Numbers):
    """A vector x,y,z."""

    form = "x,y,z"

    def read(self, flag: str, text: str, robot: Robot) -> list[float]:
        value = self.vector(flag, text)
        self.check_far(flag, text, robot)
        return value


class ZeroVector(Vector):
    """A vector x,y,z that is zero if it is not given."""

    def __init__(self, *texts: str, **more: Any) -> None:
        super().__init__(*texts, default="0,0,0", **more)


class Share(Flag):
    """A share such as "0.01" or "1 %"; ``rule`` has its meaning and range for the error."""

    def __init__(
        self,
        rule: str,
        accepts: Callable[[float], bool],
        example: str,
        text: str,
        *,
        form: str | None = None,
        **more: Any,
    ) -> None:
        super().__init__(form, text, **more)
        self.rule, self.accepts, self.example = rule, accepts, example

    def read(self, flag: str, text: str, robot: Robot) -> float:
        value = math.nan
        with suppress(ValueError):
            value = read_share(text)
        if not self.accepts(value):
            raise InputError(
                f"{flag}: got {quote(text.strip())}; must be {self.rule}, "
                f"write for example {flag} {self.example}."
            )
        return value


class TendonShares(Flag):
    """Numbers of tendons and their shares of the sweep's tension."""

    def read(self, flag: str, text: str, robot: Robot) -> dict[int, float]:
        out: dict[int, float] = {}
        count = tendon_count(robot)
        rule = "a tendon and, after a colon, its share of the sweep's tension"
        kind = Share(rule, math.isfinite, "1,2:0.5", "")
        for item in text.split(","):
            number, colon, share = item.strip().partition(":")
            if not (number.isdecimal() and 1 <= int(number) <= count):
                raise InputError(
                    f"{flag}: got {quote(item.strip())}; must be a tendon of {robot.name} from 1 "
                    f"to {count}, and its share after a colon, for example {flag} "
                    f"1,{min(count, 2)}:0.5."
                )
            if int(number) in out:
                raise InputError(f"{flag}: tendon {number} is there twice; name each one once.")
            out[int(number)] = kind.read(flag, share, robot) if colon else 1.0
        return out


class Range(Numbers):
    """A list of numbers, or first:step:last; ``rule`` is that of values below 0, for the error."""

    form = "FIRST:STEP:LAST"

    def __init__(self, si: str, *texts: str, rule: str = "", **more: Any) -> None:
        super().__init__(si, *texts, **more)
        self.rule = rule

    def read(self, flag: str, text: str, robot: Robot) -> list[float]:
        values = self._values(flag, text)
        if self.rule and min(values) < 0:
            raise InputError(f"{flag}: got {min(values):g} {self.si}; must be {self.rule}.")
        return values

    def _values(self, flag: str, text: str) -> list[float]:
        parts = text.split(":")
        if len(parts) == 1:
            return self.numbers(flag, text)
        if len(parts) != 3:
            raise InputError(
                f"{flag}: got {quote(text)}; write first:step:last, for example {flag} "
                f"{self.example}."
            )
        first, step, last = (self.number(flag, part) for part in parts)
        if step == 0 or (last - first) / step < 0:
            raise InputError(
                f"{flag}: steps of {step:g} {self.si} do not lead from {first:g} to {last:g}."
            )
        steps = (last - first) / step
        if steps > MOST_LOADS:
            raise InputError(f"{flag}: got {steps:.3g} steps; up to {MOST_LOADS} are possible.")
        if 0.0 < steps < 1.0 - 1e-6:
            raise InputError(
                f"{flag}: the step of {step:g} {self.si} from {first:g} leads beyond {last:g}; the "
                "order is first:step:last."
            )
        if abs(steps - round(steps)) > 1e-6:
            end = first + math.floor(steps) * step
            raise InputError(
                f"{flag}: steps of {step:g} {self.si} from {first:g} do not meet {last:g}; end for "
                f"example at {end:g}."
            )
        # 3 * 0.1 is 0.3
        return [float(f"{first + i * step:.12g}") for i in range(round(steps) + 1)]


class PerTendon(Numbers):
    """A number for each tendon, "positive" or, unless ``signed``, 0 or more.

    With ``dashes``, a dash or a blank gives None.
    """

    form = "T1,T2,..."

    def __init__(
        self, si: str, *texts: str, signed: bool = False, dashes: bool = False, **more: Any
    ) -> None:
        super().__init__(si, *texts, **more)
        self.signed, self.dashes = signed, dashes

    def read(self, flag: str, text: str, robot: Robot) -> Any:
        return self.entries(flag, text, robot, dashes=self.dashes)

    def entries(self, flag: str, text: str, robot: Robot, *, dashes: bool) -> list[Any]:
        items = [item.strip() for item in text.split(",")]
        wanted, above_zero = tendon_count(robot), self.must_be == "positive"
        first = self.example.partition(",")[0]
        example = ",".join([first, *[first if above_zero else "0"] * (wanted - 1)])
        values = [
            None if dashes and item in ("", "-") else self.numbers(flag, item, example)[0]
            for item in items
        ]
        if len(values) != wanted:
            kind = ("entry", "entries") if dashes else ("number", "numbers")
            rest = "a number or - for each" if dashes else "one number for each"
            raise InputError(
                f"{flag}: got {counted(len(values), *kind)}; {robot.name} has "
                f"{counted(wanted, 'tendon')}, write {rest}."
            )
        if self.signed:
            check_bare_command(flag, text, self.si, robot)
            return values
        least = robot.tendons.least_tension_N if self.si == "N" else [0.0] * wanted
        for i, value in enumerate(values, 1):
            if value is not None and (value < least[i - 1] or (above_zero and value == 0)):
                rule = "positive" if above_zero else "0 or more, a tendon cannot push"
                raise InputError(f"{flag}: got {value:g} {self.si} for tendon {i}; must be {rule}.")
        self.check_far(flag, text, robot)
        return values


class OneOrEach(PerTendon):
    """A number for all tendons, which follows the rule ``one``, or one for each, 0 or more.

    Tensions of a robot with rods or chambers have any sign.
    """

    form = "T or T1,T2,..."

    def __init__(self, si: str, *texts: str, one: str = "0 or more", **more: Any) -> None:
        super().__init__(si, *texts, **more)
        self.one = one

    def read(self, flag: str, text: str, robot: Robot) -> Any:
        if "," in text:
            return self.entries(flag, text, robot, dashes=False)
        signed = self.one == "0 or more" and self.si == "N" and robot.tendons.pushes.any()
        must_be = "" if signed else self.one
        return Number(self.si, self.example, "", must_be=must_be).number(flag, text)


class OnDisks(Numbers):
    """Vectors N:x,y,z of a repeatable flag: rows for all disks, or None."""

    kind = list[str]
    form = "N:x,y,z"

    def read(self, flag: str, texts: Sequence[str], robot: Robot) -> list[list[float]] | None:
        if not texts:
            return None
        vectors = [[0.0, 0.0, 0.0] for _ in robot.disks.station_m]
        seen = set()
        for text in texts:
            disk, components = self.disk(flag, text, robot)
            if disk in seen:
                raise InputError(f"{flag}: disk {disk} is there twice; name each one once.")
            seen.add(disk)
            vectors[disk - 1] = self.vector(flag, components)
        return vectors

    def disk(
        self, flag: str, text: str, robot: Robot, place: str = "", point: str = ""
    ) -> tuple[int, str]:
        """Disk, counted from 1, before a colon, and the text after it."""
        count = len(robot.disks.station_m)
        number, colon, components = text.partition(":")
        number = number.strip()
        short = number.isdecimal() and len(number) < 10
        if not (colon and short and 1 <= int(number) <= count):
            raise InputError(
                f"{flag}: got {quote(text)}; must be a disk of {robot.name} from 1 to {count}"
                f"{place} and, after a colon, x, y and z, for example {flag} {min(4, count)}:0,1,0"
                f"{point}."
            )
        return int(number), components


class AtPoints(OnDisks):
    """Forces at points of disks or of the backbone."""

    def __init__(self, *texts: str, follower: bool = False, **more: Any) -> None:
        super().__init__("N", *texts, **more)
        self.follower = follower

    def read(self, flag: str, texts: Sequence[str], robot: Robot) -> Any:
        return [self._load(flag, text, robot) for text in texts]

    def _load(self, flag: str, text: str, robot: Robot) -> PointLoad:
        from bowstring.statics.load import PointLoad

        place, _, components = text.partition(":")
        arc_length, disk = self._arc_length(flag, place), 0
        if arc_length is None:
            point = "" if self.follower else "@0,0,0"
            ways = " or an arc length with its unit"
            disk, components = self.disk(flag, text, robot, ways, point)
        force, at, point = components.partition("@")
        if not at and arc_length is None and not self.follower:
            raise InputError(
                f"{flag}: got {quote(text)}; a point of the disk must follow the force after "
                f"an @, for example {flag} {self.example}; --disk-force takes a force on "
                "the centre; for a force on the backbone give an arc length in place of the "
                'disk, such as "137 mm:0,1,0".'
            )
        offset: Sequence[float] = (0.0, 0.0, 0.0)
        if at:
            offset = Vector("m", self.example, "", far=FAR).read(flag, point, robot)
        values = self.vector(flag, force)
        try:
            return PointLoad(
                disk - 1, values, point=offset, follower=self.follower, arc_length=arc_length
            )
        except InputError as error:
            raise InputError(f"{flag}: {error}") from None

    def _arc_length(self, flag: str, text: str) -> float | None:
        """Read an arc length with its unit before a colon; None for a disk."""
        text = text.strip()
        if not text or has_no_unit(text) or not re.match(NUMBER, text, re.ASCII):
            return None
        return Number("m", self.example, "").number(flag, text)


def check_bare(
    flag: str, text: str, si: str, robot: Robot, most: float | Sequence[float], small: str
) -> None:
    """Refuse a number without a unit that is too large in SI but plausible in a smaller unit.

    ``most`` is a limit for each number, or one for all.
    """
    items = [item.strip() for item in text.split(",")]
    limits = [most] * len(items) if isinstance(most, (int, float)) else most
    for item, limit in zip(items, limits, strict=False):
        if not has_no_unit(item) or abs(float(item)) <= limit:
            continue
        if abs(read_number(f"{item} {small}", si)) <= limit:
            winds = " and more than all of a tendon" if si == "rad" else ""
            why = f"{winds}, and {robot.name} is {number_with_unit(robot.length, 'm')} long"
            raise without_unit(flag, item, si, small, why)


def without_unit(flag: str, item: str, si: str, small: str, why: str = "") -> InputError:
    return InputError(
        f"{flag}: got {item} without a unit, which is {item} {si}{why}; "
        f'write "{item} {small}" if that is meant, else "{item} {si}".'
    )


def check_bare_command(flag: str, text: str, si: str, robot: Robot) -> None:
    """Refuse displacements and angles without a unit that exceed the length of a tendon."""
    import numpy as np

    tendons = robot.tendons
    longest = robot.disks.station_m[tendons.end_disk] + tendons.free_length_m
    if si == "m":  # the solver has a better message for slightly too large displacements
        check_bare(flag, text, si, robot, (1.6 * longest).tolist(), "mm")
    if si == "rad":
        turns = longest / tendons.spool_radius_m  # NaN without a spool, refused elsewhere
        check_bare(flag, text, si, robot, np.nan_to_num(turns, nan=math.inf).tolist(), "deg")


def tendon_count(robot: Robot) -> int:
    return len(robot.tendons.angle_rad)


def of_flag(flag: str, check: Callable[[Any], Any], value: Any) -> Any:
    """Run a check, whose errors then name the flag."""
    try:
        return check(value)
    except InputError as error:
        if error.rule:  # its own flag is named at the end
            raise
        raise InputError(f"{flag}: {error}") from None
