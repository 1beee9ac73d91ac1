"""Columns of a table of measurements, from the tidy format or a mapping.

Both give a `Layout`, by which `bowstring.data.measurements` reads rows.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, get_args

import numpy as np
from pydantic_core import PydanticCustomError

from bowstring.aliases import Floats
from bowstring.data.tables import Table, UnknownColumnsError
from bowstring.errors import InputError
from bowstring.units import NUMBER, Quantity, quote, read_number, wrong

#: Allowed sources of data.
Source = Literal["measured", "synthetic", "computed"]
SOURCES: Final = get_args(Source)
PIXELS: Final = "px"
TOOL: Final = Quantity("m", "0 0 8 mm", "-10 m", "10 m", vector=3)
SIGMA: Final = Quantity("m", "0.02 mm", "1e-12 m", "10 m")

Kind = Literal["tension", "displacement"]
Part = Literal["all", "positive", "negative"]
#: Zero of a column: a number in its unit, or the first and the last row whose mean it is.
Zero = float | tuple[int, int]

_SI: Final = {
    "mass": "kg",
    "tension": "N",
    "displacement": "m",
    "point": "m",
    "sigma": "m",
    "time": "s",
    "bend": "rad",
    "direction": "rad",
}
_EXAMPLE: Final = {"kg": "kg", "N": "N", "m": "mm", "s": "s", "rad": "deg"}
_PATTERN: Final = re.compile(
    r"(?:(?P<tendon>mass|tension|displacement)_(?P<k>[0-9]{1,4})"
    r"|(?:tip|point_(?P<p>[0-9]{1,4}))_(?P<axis>[xyz])"
    r"|(?P<one>sigma|time|bend|direction))(?:_(?P<unit>.+))?"
    r"|(?P<plain>repeat|group|recording|source)"
)
_SYNONYMS: Final = {
    "force": "tension",
    "load": "mass",
    "weight": "mass",
    "pull": "displacement",
    "x": "tip_x",
    "y": "tip_y",
    "z": "tip_z",
    "t": "time",
    "std": "sigma",
    "uncertainty": "sigma",
}


@dataclass(frozen=True)
class Column:
    """Column of numbers: index, name, and conversion to SI.

    Attributes
    ----------
    index : int
        Index from 0.
    name : str
    factor : float
        Factor to SI, with sign.
    part : {"all", "positive", "negative"}
        Part of its numbers that is used, after the factor. Other numbers become zero; the negative
        part is used without its sign.
    constant : float or None
        Number for every row, before the factor, in place of a column.
    zero : float or tuple of 2 int
        Number that means zero, before the factor; or rows of the table, from 1, whose mean it is.
    dates : str
        For a column of dates, clock times or durations in words, the order of day and month of
        `bowstring.data.clock.DATES`; empty for numbers.
    instead : tuple of Column
        Columns that are used, in this order, where its cell is blank.
    plus : Column or None
        Column of times that are added.
    """

    index: int
    name: str
    factor: float = 1.0
    part: Part = "all"
    constant: float | None = None
    zero: Zero = 0.0
    dates: str = ""
    instead: tuple[Column, ...] = ()
    plus: Column | None = None

    def reading(self, si: float) -> float:
        """Number in its unit that gives a number in SI."""
        assert isinstance(self.zero, float)  # once the reader has its rows
        return si / self.factor + self.zero


@dataclass(frozen=True)
class Joined:
    """Clock of a joined table."""

    shift: float
    """Offset added to its times, s."""
    has_commands: bool
    """Whether it has the commands, and the other table the tips."""


@dataclass
class Layout:
    """Columns of a table by quantity.

    `tendons` are in the robot's order; the last of `points` is the tip. `shape` is a column of JSON
    lists of points. `rotation` maps the axes of the file to those of the measuring frame. `keep` is
    a column and the value that a row must have to be read. `scale` is None where points are in
    pixels. `label` is a column with the source of the data; without `own_label` it may have another
    meaning. Rows with the same text in `recording` form one path.
    """

    tendons: list[tuple[Kind, Column]] = field(default_factory=list)
    points: list[tuple[Column, ...]] = field(default_factory=list)
    shape: Column | None = None
    scale: float | None = 1.0
    bend: Column | None = None
    """Column of the bend angle, rad; None without one."""
    direction: Column | None = None
    """Column of the direction of bending, rad; None without one."""
    quaternion: tuple[Column, ...] | None = None
    """Columns w, x, y, z of the rotation of the tip, in place of these; None without any."""
    sigma: Column | None = None
    """Column of the standard uncertainty of a coordinate, m; None without one."""
    time: Column | None = None
    """Column of the time, s; None without one."""
    repeat: Column | None = None
    """Column of the number of the repeated run; None without one."""
    group: Column | None = None
    """Column of the group label; None without one."""
    recording: Column | None = None
    label: Column | None = None
    own_label: bool = True
    keep: tuple[Column, str] | None = None
    rotation: Floats | None = None
    stations: Floats | None = None
    """Arc lengths of the points (P,), as shares of the length; None if not given."""
    tool: Floats = field(default_factory=lambda: np.zeros(3))
    """Offset of the measured point from the tip (3,), in the tip's axes, m."""
    sigma_of_all: float | None = None
    """Standard uncertainty of every coordinate, m; None if not given."""
    join: Joined | None = None
    """Clock of a joined table; None if none is joined."""
    source: str | None = None
    """Source of data that do not state their own; None if not given."""
    name: str | None = None
    """Name of the data; None for the name of the file."""


def factor_of(unit: str, si: str) -> float:
    """Factor from a unit to SI; ValueError continues the sentence 'got "...", '."""
    return read_number(f"1 {unit}", si)


def nearest(name: str, known: Sequence[str]) -> str | None:
    """Known name that is closest to a mistyped one."""
    lower = {item.lower(): item for item in reversed(known)}
    near = difflib.get_close_matches(name.lower(), list(lower), n=1, cutoff=0.6)
    return lower[near[0]] if near else None


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """Question "did you mean ...", empty if no known name is close."""
    near = nearest(name, known)
    return f"did you mean {near}? " if near else ""


def read_zero(value: object) -> Zero:
    """Zero of a column: a number in its unit, ``first`` or ``rows 1-10``."""
    text = str(value).strip()
    if text == "first":
        return 1, 1
    if re.fullmatch(NUMBER, text) and not isinstance(value, bool):
        return float(text)
    rows = re.fullmatch(r"rows +([1-9][0-9]{0,6}) *- *([1-9][0-9]{0,6})", text)
    if rows is None or int(rows[1]) > int(rows[2]):
        raise wrong(
            f"got {quote(text)}; must be a number in the unit of the column, first (its number in "
            "the first row), or rows such as rows 1-10 (their mean)"
        )
    return int(rows[1]), int(rows[2])


# -- the tidy format ---------------------------------------------------------------------------


def tidy(table: Table, g: float) -> Layout:
    """Read the header of the tidy format.

    Parameters
    ----------
    table : Table
    g : float
        Gravitational acceleration that converts masses to tensions, m/s^2.

    Raises
    ------
    InputError
        If a column is missing or given twice, or its unit is missing or wrong.
    """
    return _Header(table, g).layout()


class _Header:
    def __init__(self, table: Table, g: float) -> None:
        self.table, self.g = table, g
        self.here = f"{table.path}, line {table.line}"
        self.units: dict[str, tuple[str, str]] = {}  # unit of each kind, and its column

    def fail(self, sentence: str) -> InputError:
        return InputError(f"{self.here}: {sentence}")

    def layout(self) -> Layout:
        found = Layout()
        tendons: dict[int, tuple[Kind, Column]] = {}
        points: dict[int, dict[str, Column]] = {}
        strangers = []
        for index, name in enumerate(self.table.header):
            match = _PATTERN.fullmatch(name)
            if not name:
                text = f"column {index + 1} has no name and is not read"
                self.table.notes.append((self.table.line, text))
            elif match is None:
                strangers.append(name)
            elif match["tendon"]:
                kind: Kind = "displacement" if match["tendon"] == "displacement" else "tension"
                column = self.column(index, name, match["tendon"], match["unit"])
                k = int(match["k"])
                if k in tendons:
                    raise self.fail(
                        f"{tendons[k][1].name} and {name} both command tendon {k}; give each "
                        "tendon one of mass, tension and displacement"
                    )
                tendons[k] = (kind, column)
            elif axis := match["axis"]:
                place = int(match["p"] or 0)
                if match["p"] and place == 0:
                    raise self.fail(f"got {name}; points are numbered from 1, base to tip")
                column = self.column(index, name, "point", match["unit"])
                if axis in points.setdefault(place, {}):
                    raise self.fail(f"{points[place][axis].name} and {name} say the same")
                points[place][axis] = column
            else:
                what = match["one"] or match["plain"]
                target = "label" if what == "source" else what
                column = Column(index, name)
                if match["one"]:
                    column = self.column(index, name, what, match["unit"])
                if (before := getattr(found, target)) is not None:
                    raise self.fail(f"{before.name} and {name} say the same")
                setattr(found, target, column)
        self.strangers = strangers
        found.tendons = self.with_zeros(self.tendons(tendons))
        found.points = self.points(points, found)
        found.scale = None if PIXELS in (u for u, _ in self.units.values()) else 1.0
        found.stations = self.stations(len(found.points))
        found.name = self.table.about.get("name")
        found.recording = self.recording(found)
        if (tool := self.table.about.get("tool")) is not None:
            found.tool = np.array(self.comment("tool", TOOL.read, tool))
        if (sigma := self.table.about.get("sigma")) is not None:
            if found.sigma is not None:
                raise self.fail(f"{found.sigma.name} and the comment '# sigma:' say the same")
            found.sigma_of_all = self.comment("sigma", SIGMA.read, sigma)
        for name in self.strangers:
            near = self.guess(name)
            hint = f"; did you mean {near}?" if near else ""
            self.table.notes.append(
                (self.table.line, f"the column {quote(name)} is not read{hint}")
            )
        return found

    def recording(self, found: Layout) -> Column | None:
        """Column of the recordings: its own, or the one that a comment names."""
        text = self.table.about.get("recording")
        if text is None:
            return found.recording
        column = {"group": found.group, "repeat": found.repeat}.get(text)
        if column is None or found.recording is not None:
            raise InputError(
                f"{self.table.path}: the comment '# recording:' is {quote(text)}; must be group or "
                "repeat, a column of the table, where there is no column recording"
            )
        return column

    def column(self, index: int, name: str, kind: str, unit: str | None) -> Column:
        si = _SI[kind]
        if not unit:
            raise UnknownColumnsError(
                f"{self.here}: {name} has no unit; write for example {name}_{_EXAMPLE[si]}",
                self.table,
            )
        before, where = self.units.setdefault(kind, (unit, name))
        if before != unit:
            raise self.fail(
                f"mixed units: {where} is in {before} and {name} in {unit}; give both in one unit"
            )
        if unit == PIXELS and kind == "point":
            return Column(index, name)
        try:
            factor = factor_of(unit, si)
        except ValueError as error:
            raise self.fail(f"got {name}, {error}") from None
        return Column(index, name, factor * (self.g if kind == "mass" else 1.0))

    def with_zeros(self, tendons: list[tuple[Kind, Column]]) -> list[tuple[Kind, Column]]:
        """Columns with the zeros of a comment: one for all, or a number for each."""
        text = self.table.about.get("zero")
        if text is None:
            return tendons
        each = re.split(r"[,;\s]+", text)
        if not all(re.fullmatch(NUMBER, item) for item in each):
            each = [text]
        if len(each) not in (1, len(tendons)):
            raise InputError(
                f"{self.table.path}: the comment '# zero:' has {len(each)} numbers; give one for "
                f"all, or one for each of {len(tendons)} tendons"
            )
        zeros = [self.comment("zero", read_zero, item) for item in each] * len(tendons)
        return [
            (kind, replace(column, zero=zero))
            for (kind, column), zero in zip(tendons, zeros[: len(tendons)], strict=True)
        ]

    def comment(self, name: str, read: Callable[[str], Any], text: str) -> Any:
        try:
            return read(text)
        except PydanticCustomError as error:
            raise InputError(
                f"{self.table.path}: the comment '# {name}:' {error.message()}"
            ) from None

    def guess(self, name: str) -> str | None:
        """Missing column that an unknown one is probably meant to be."""
        unit = self.units.get("point", ("mm", ""))[0]
        digits = (re.findall(r"[0-9]+", name) or ["1"])[0]
        known = [
            f"{kind}_{digits}_{_EXAMPLE[_SI[kind]]}" for kind in ("mass", "tension", "displacement")
        ]
        known += [f"tip_{axis}_{unit}" for axis in "xyz"]
        known += ["sigma_mm", "time_s", "bend_deg", "direction_deg"]
        known += ["repeat", "group", "recording"]
        word = re.match(r"[A-Za-z]+", name)
        synonym = _SYNONYMS.get(word[0].lower()) if word else None
        if synonym:
            near = next((item for item in known if item.startswith(synonym)), None)
        else:
            near = nearest(name, known)
        return None if near in self.table.header else near

    def missing(self, what: str, like: str | tuple[str, ...], whole: bool = False) -> InputError:
        """Error for a missing column, with a hint; `whole`: there is no column of that kind."""
        hints = ((name, self.guess(name)) for name in self.strangers)
        hint = next(
            (f"; did you mean {near} by {quote(name)}?" for name, near in hints
             if near and near.startswith(like)),
            "",
        )  # fmt: skip
        notes = "".join(f"; {text}" for _, text in self.table.notes)  # of another sheet
        if whole and self.strangers:
            return UnknownColumnsError(f"{self.here}: {what}{hint}{notes}", self.table)
        return self.fail(f"{what}{hint}{notes}")

    def tendons(self, found: dict[int, tuple[Kind, Column]]) -> list[tuple[Kind, Column]]:
        if 0 in found:
            raise self.fail(f"got {found[0][1].name}; tendons are numbered from 1")
        if not found:
            raise self.missing(
                "no column has the command of a tendon; give each tendon a column such as "
                "mass_1_kg, tension_1_N or displacement_1_mm",
                ("mass", "tension", "displacement"),
                whole=True,
            )
        for k in range(1, max(found)):
            if k not in found:
                last = found[max(found)][1].name
                raise self.missing(
                    f"tendon {k} has no column, but there is {last}; give one for each tendon, "
                    "with 0 where it has no load",
                    ("mass", "tension", "displacement"),
                )
        return [found[k] for k in sorted(found)]

    def points(
        self, found: dict[int, dict[str, Column]], layout: Layout
    ) -> list[tuple[Column, ...]]:
        if not found:
            if layout.bend is not None:
                return []
            raise self.missing(
                "there is no measured point; give columns tip_x_mm, tip_y_mm and tip_z_mm",
                "tip",
                whole=True,
            )
        for k, axes in found.items():
            for axis in "xyz":
                if axis not in axes:
                    there = next(iter(axes.values())).name
                    name = f"tip_{axis}" if k == 0 else f"point_{k:02d}_{axis}"
                    raise self.missing(f"there is {there} but no column {name}", name)
        order = sorted(k for k in found if k) + ([0] if 0 in found else [])
        return [(found[k]["x"], found[k]["y"], found[k]["z"]) for k in order]

    def stations(self, count: int) -> Floats | None:
        text = self.table.about.get("stations")
        if text is None:
            return None
        try:
            values = [read_number(item, "") for item in re.split(r"[,;\s]+", text.strip())]
        except ValueError:
            raise InputError(
                f"{self.table.path}: the comment '# stations:' is {quote(text)}; write a share of "
                "the length for each point, as in # stations: 0.25 0.5 0.75 1"
            ) from None
        if len(values) == count - 1:
            values.append(1.0)
        return check_stations(f"{self.table.path}: the comment '# stations:'", values, count)


def check_stations(what: str, values: Sequence[float] | Floats, count: int) -> Floats:
    """Check shares of the length: increasing, within 0 to 1, one for each point."""
    if len(values) != count:
        raise InputError(f"{what} has {len(values)} numbers; there are {count} points")
    array = np.array(values)
    if not (array[0] >= 0 and array[-1] <= 1 and (np.diff(array) > 0).all()):
        raise InputError(f"{what}: shares of the length rise from base to tip, within 0 to 1")
    return array
