"""Mapping file: meaning of the columns of a table of measurements in another format.

A YAML file, checked as a whole: columns, units, order and sign of the tendons, axes of the frame.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BeforeValidator, Field, model_validator

from bowstring.aliases import Floats
from bowstring.data.clock import DATES
from bowstring.data.columns import (
    PIXELS,
    SIGMA,
    TOOL,
    Column,
    Joined,
    Layout,
    Part,
    Zero,
    check_stations,
    did_you_mean,
    factor_of,
    read_zero,
)
from bowstring.data.field_messages import Fields, checked
from bowstring.data.joining import How, join
from bowstring.data.motive import TIME
from bowstring.data.tables import COLUMN, Form, Name, Table, open_table
from bowstring.errors import InputError
from bowstring.robot.safe_yaml import read_yaml, reading, text_of
from bowstring.units import NUMBER, Quantity, Text, quote, read_number, wrong

_BUILT_IN: Final = Path(__file__).with_name("mappings")
_MOST_POINTS: Final = 1_000


def _scale_of(unit: str, si: str) -> float:
    """Factor to SI of "mm" or of "0.1 mm"; ValueError continues the sentence 'got "...", '."""
    if not re.match(rf"\s*{NUMBER}", unit):
        return factor_of(unit, si)
    if re.fullmatch(rf"\s*{NUMBER}\s*", unit):
        raise ValueError("which has no unit")
    factor = read_number(unit, si)
    if not factor > 0:
        raise ValueError("which must be above zero; for the sign of a column write sign: -1")
    return factor


def _check_unit(unit: str, si: str, where: str = "") -> None:
    try:
        _scale_of(unit, si)
    except ValueError as error:
        raise wrong(f"{where}got {quote(unit)}, {error}") from None


def _unit(si: str, *besides: str) -> BeforeValidator:
    def check(value: object) -> object:
        if not isinstance(value, str):
            raise wrong(f"got {quote(value)}; must be a unit")
        if value not in besides:
            _check_unit(value, si)
        return value

    return BeforeValidator(check)


#: Spellings of an empty value in YAML.
_NOTHING: Final = ("", "~", "null", "Null", "NULL")


def _name_or_number(value: object) -> object:
    if value is None or (isinstance(value, str) and value.strip() in _NOTHING):
        return None
    if isinstance(value, int | float) and not isinstance(value, bool):
        return repr(value)
    return COLUMN.read(value)


ZeroField = Annotated[
    Zero | None,
    BeforeValidator(lambda value: None if value is None else read_zero(value)),
    Field(description="A number in the unit of the column, first, or rows such as rows 1-10."),
]


class Source(Fields):
    """Column, or a constant for every row; may be written as its bare name.

    Attributes
    ----------
    column : str or None
        Name, or a number if no column has that name; None (``null``) is zero.
    unit : str or None
        Own unit, such as ``0.1 mm``, in place of the common one.
    sign : {1, -1}
        Sign of its numbers.
    zero : float, (int, int) or None
        Number in its unit that means zero, or the first and last row whose mean it is; in the file
        ``first`` is the first row, ``rows 1-10`` are several. None: the common one.
    part : {"all", "positive", "negative"}
        Part of its numbers that is used; the negative part without its sign.
    """

    column: Annotated[str | None, BeforeValidator(_name_or_number)] = None
    unit: str | None = None
    sign: Literal["1", "-1", "+", "-"] = "1"
    zero: ZeroField = None
    part: Part = "all"

    @model_validator(mode="before")
    @classmethod
    def _short(cls, value: object) -> object:
        if isinstance(value, bool | list | tuple):
            raise wrong(f"got {quote(value)}; must be a column, a number or null")
        if isinstance(value, dict):
            sign = value.get("sign")
            return {**value, "sign": str(sign)} if isinstance(sign, int) else value
        return value if isinstance(value, Source) else {"column": value}

    @property
    def is_number(self) -> bool:
        """Whether the name is a number; a column of that name takes precedence."""
        return self.column is None or re.fullmatch(NUMBER, self.column) is not None

    def factor(self, unit: str, si: str) -> float:
        """Factor to SI with sign; `unit` is the common unit."""
        scale = 1.0 if unit == PIXELS else _scale_of(self.unit or unit, si)
        return -scale if self.sign in ("-1", "-") else scale


class Coordinate(Source):
    """Column of a coordinate; a list of columns is read as the first one that is not blank.

    Attributes
    ----------
    instead : tuple of str
        Columns that are read, in this order, where the column is blank.
    """

    instead: tuple[Name, ...] = ()

    @model_validator(mode="before")
    @classmethod
    def _list(cls, value: object) -> object:
        if isinstance(value, list | tuple) and value and not isinstance(value[0], list | dict):
            return {"column": value[0], "instead": value[1:]}
        return value


Triple = Annotated[
    tuple[Coordinate, Coordinate, Coordinate], Field(description="Columns of x, y and z.")
]
LengthUnit = Annotated[str, _unit("m", PIXELS)]


class Time(Fields):
    """Column of the time.

    Attributes
    ----------
    column : str
    unit : str
        Unit, or how dates are written: ``iso``, ``d/m/y`` or ``m/d/y`` (`bowstring.data.clock`).
    plus : Time or None
        Column that is added: a clock time to a date, nanoseconds to seconds.
    """

    column: Name
    unit: Annotated[str, _unit("s", *DATES)]
    plus: Time | None = None

    def layout(self, find: _Finder, field: str = "time") -> Column:
        """Find the column in a table, with the factor to s."""
        dates = self.unit if self.unit in DATES else ""
        factor = 1.0 if dates else _scale_of(self.unit, "s")
        found = find.column(f"{field}.column", self.column, factor)
        plus = None if self.plus is None else self.plus.layout(find, f"{field}.plus")
        return replace(found, dates=dates, plus=plus)


class Join(Fields):
    """Another table of the same experiment, joined by time.

    Attributes
    ----------
    file : str
        Path relative to the folder of the table.
    time : Time or None
        Column of its time; optional for an export of Motive.
    shift : float
        Offset added to its times, s.
    how : {"linear", "nearest", "previous"}
        Interpolation between its samples.
    within : float or None
        Largest distance of a row from a sample, s; farther rows get no value.
    table : Form or None
        Layout of its file.
    """

    file: Annotated[str, Text(1000, "forces.csv")]
    time: Time | None = None
    shift: Annotated[float, Quantity("s", "0.12 s", "-1e10 s", "1e10 s")] = 0.0
    how: How = "linear"
    within: Annotated[float | None, Quantity("s", "0.05 s", "0 s", "1e10 s")] = None
    table: Form | None = None


class Tendons(Fields):
    """Actuation of the tendons, in the robot's order."""

    quantity: Literal["mass", "tension", "displacement"]
    unit: str
    columns: tuple[Source, ...] = Field(min_length=1, max_length=1_000)
    zero: ZeroField = None
    positive: Literal["shortened", "lengthened"] = "shortened"

    @model_validator(mode="after")
    def _check(self) -> Tendons:
        _check_unit(self.unit, self.si, "unit: ")
        for i, each in enumerate(self.columns):
            if each.unit is not None:
                _check_unit(each.unit, self.si, f"columns[{i}].unit: ")
        if self.positive == "lengthened" and self.quantity != "displacement":
            raise wrong(f"positive: lengthened is for displacements, a {self.quantity} pulls")
        named = [(s.column, s.sign in ("-1", "-"), s.part) for s in self.columns if not s.is_number]
        if len(set(named)) < len(named):
            raise wrong(
                "columns: one is there twice; each tendon has its own, or of one column for a pair "
                "one the part: positive and one the part: negative"
            )
        return self

    @property
    def si(self) -> str:
        """SI unit of the quantity."""
        return {"mass": "kg", "tension": "N", "displacement": "m"}[self.quantity]

    def layout(
        self, find: _Finder, g: float
    ) -> list[tuple[Literal["tension", "displacement"], Column]]:
        """Kind and column of each tendon, with signed factors to SI."""
        kind: Literal["tension", "displacement"] = (
            "displacement" if self.quantity == "displacement" else "tension"
        )
        lengthened = -1.0 if self.positive == "lengthened" else 1.0
        factor = g if self.quantity == "mass" else lengthened
        return [
            (
                kind,
                find.source(f"tendons.columns[{i}]", each, self.unit, self.si, factor, self.zero),
            )
            for i, each in enumerate(self.columns)
        ]


#: Name of a body or marker, or a list of the names that it has one after another.
Names = Annotated[
    tuple[Name, ...],
    BeforeValidator(lambda value: value if isinstance(value, list | tuple) else [value]),
    Field(min_length=1, max_length=1_000),
]


class Tip(Fields):
    """Columns of the measured tip, or the name of a body or marker of a Motive export."""

    columns: Triple | None = None
    name: Names | None = None
    unit: LengthUnit | None = None

    @model_validator(mode="after")
    def _check(self) -> Tip:
        if (self.columns is None) == (self.name is None):
            raise wrong(
                "give either columns, those of x, y and z, or name, a rigid body or a marker of a "
                "Motive export"
            )
        _check_units(self.columns or (), self.unit)
        return self

    def points(self, find: _Finder) -> Sequence[Sequence[Source]]:
        """Columns of x, y and z of the tip, as a single point."""
        return (self.columns or find.body("tip.name", self.name or ()),)


class Points(Fields):
    """Columns of measured points from base to tip; the last is the tip."""

    columns: tuple[Triple, ...] | None = Field(default=None, min_length=1, max_length=_MOST_POINTS)
    names: tuple[Names, ...] | None = Field(default=None, min_length=1, max_length=_MOST_POINTS)
    unit: LengthUnit | None = None

    @model_validator(mode="after")
    def _check(self) -> Points:
        if (self.columns is None) == (self.names is None):
            raise wrong(
                "give either columns, a list of those of x, y and z, or names, rigid bodies or "
                "markers of a Motive export"
            )
        _check_units(chain.from_iterable(self.columns or ()), self.unit)
        return self

    def points(self, find: _Finder) -> Sequence[Sequence[Source]]:
        """Columns of x, y and z of each point."""
        return self.columns or [find.body("points.names", name) for name in self.names or ()]


def _check_units(columns: Iterable[Source], unit: str | None) -> None:
    for each in columns:
        if each.unit is None:
            continue
        if unit == PIXELS:
            raise wrong("columns: a unit of its own has no meaning beside px")
        _check_unit(each.unit, "m", "columns: unit: ")


class Shape(Fields):
    """One column with whole shapes, as JSON: [[x, y], ...] or [[x, y, z], ...], base to tip."""

    column: Name
    unit: LengthUnit


class Angles(Fields):
    """Columns of angle and direction of bending, or of the quaternion of the tip's rotation."""

    bend: Annotated[str | None, COLUMN] = None
    direction: Annotated[str | None, COLUMN] = None
    unit: Annotated[str | None, _unit("rad")] = None
    quaternion: tuple[Name, Name, Name, Name] | None = None
    order: Literal["wxyz", "xyzw"] = "wxyz"

    @model_validator(mode="after")
    def _check(self) -> Angles:
        if (self.bend is None) == (self.quaternion is None):
            raise wrong(
                "give either bend, a column, or quaternion, the columns [w, x, y, z] of the "
                "rotation of the tip (with order: xyzw [x, y, z, w])"
            )
        if self.quaternion is not None and (self.direction or self.unit):
            raise wrong("quaternion: it has the direction and no unit; leave both out")
        if self.bend is not None and self.unit is None:
            raise wrong("unit: missing; write for example unit: deg")
        return self

    def find(self, found: Layout, finder: _Finder) -> None:
        """Find the columns in a table."""
        if self.quaternion is not None:
            columns = [finder.column("angles.quaternion", name) for name in self.quaternion]
            first = self.order.index("w")
            found.quaternion = tuple([columns.pop(first), *columns])
            return
        factor = _scale_of(self.unit or "rad", "rad")
        found.bend = finder.column("angles.bend", self.bend or "", factor)
        if self.direction is not None:
            found.direction = finder.column("angles.direction", self.direction, factor)


class Sigma(Fields):
    """Column of the standard uncertainty of a coordinate."""

    column: Name
    unit: Annotated[str, _unit("m")]


class Keep(Fields):
    """Column and the value that a row must have to be read."""

    column: Name
    value: Annotated[str, Text(200, "1")]


class Frame(Fields):
    """Axes of the measuring frame in those of the file: named, or as a rotation matrix."""

    axes: tuple[str, str, str] | None = None
    rotation: tuple[tuple[float, float, float], ...] | None = None
    handed: Literal["right", "left"] = "right"

    @model_validator(mode="after")
    def _check(self) -> Frame:
        if self.axes is None and self.rotation is None and self.handed == "left":
            raise wrong(
                "handed: left does not say which axis is mirrored; give axes as well, the "
                "measuring frame's x, y and z in the file's axes, such as axes: [x, z, y] where "
                "the file's y points up (as in Unity), [x, -y, z] or [x, y, -z] where its y or z "
                "points the other way"
            )
        if (self.axes is None) == (self.rotation is None):
            raise wrong("give either axes, such as [x, z, -y], or rotation, three rows")
        self.matrix  # noqa: B018
        return self

    @property
    def matrix(self) -> Floats:
        """Matrix (3, 3) from the axes of the file to those of the measuring frame."""
        if self.axes is not None:
            matrix = np.zeros((3, 3))
            for row, text in zip(matrix, self.axes, strict=True):
                if not re.fullmatch(r"[+-]?[xyz]", text.strip()):
                    raise wrong(f"axes: got {quote(text)}; must be x, y or z, or one with a minus")
                row["xyz".index(text.strip()[-1])] = -1.0 if "-" in text else 1.0
        else:
            matrix = np.array(self.rotation, dtype=float)
            if matrix.shape != (3, 3):
                raise wrong(f"rotation: got {len(matrix)} rows; must be three of three numbers")
        what = "axes" if self.axes is not None else "rotation"
        if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6):
            raise wrong(f"{what}: these are not three directions at right angles of length 1")
        if np.linalg.det(matrix) < 0 and self.handed == "right":
            raise wrong(
                f"{what}: this frame is left-handed, it mirrors the robot; change the sign of one "
                "axis or exchange two, or, if the file's own axes are left-handed, say "
                "handed: left"
            )
        if np.linalg.det(matrix) > 0 and self.handed == "left":
            raise wrong(
                f"{what}: the file's axes are said to be left-handed, so these must mirror them; "
                "this is a rotation, which leaves them left-handed; exchange two axes, as in "
                "[x, z, y], or change the sign of one, as in [x, y, -z]"
            )
        return matrix


class Mapping(Fields):
    """Meaning of the columns of a table.

    Attributes
    ----------
    name, source, description
        Texts; ``source`` is measured, synthetic or computed.
    table : Form or None
        Layout of the table's file.
    join : Join or None
        Another table, joined by time.
    tendons, tip, points, shape, angles, time, sigma, group, repeat, recording, keep
        Columns and their units.
    stations : tuple of float
        Arc lengths of the points as shares of the length.
    frame : Frame
        Axes of the measuring frame in the file's axes.
    tool : tuple of 3 floats
        Offset of the measured point from the tip, in the tip's axes, m.
    """

    name: Annotated[str | None, Text(100, "my bench")] = None
    description: Annotated[str, Text(2000, "Tips by motion capture", lines=True)] = ""
    source: Literal["measured", "synthetic", "computed"]
    table: Form | None = None
    join: Join | None = None
    tendons: Tendons | None = None
    tip: Tip | None = None
    points: Points | None = None
    shape: Shape | None = None
    angles: Angles | None = None
    stations: tuple[float, ...] | None = None
    frame: Frame | None = None
    tool: Annotated[tuple[float, float, float], TOOL] = (0.0, 0.0, 0.0)
    sigma: Annotated[
        Sigma | float | None,
        BeforeValidator(lambda value: value if isinstance(value, dict) else SIGMA.read(value)),
    ] = None
    time: Time | None = None
    group: Annotated[str | None, COLUMN] = None
    repeat: Annotated[str | None, COLUMN] = None
    recording: Annotated[str | None, COLUMN] = None
    keep: Keep | None = None

    @model_validator(mode="after")
    def _check(self) -> Mapping:
        given = [name for name in ("tip", "points", "shape") if getattr(self, name) is not None]
        if len(given) > 1:
            raise wrong(f"{given[0]} and {given[1]}: write one of them; a tip is the last point")
        if not given and self.angles is None:
            raise wrong("nothing is measured; write tip, points, shape or angles")
        if self.frame is not None and not given:
            raise wrong("frame: it turns points, and there are none")
        return self

    def open(self, path: str | Path) -> Table:
        """Open a table, and join the other one.

        Raises
        ------
        InputError
            If a table cannot be read, or its column of time is missing.
        """
        table = open_table(path, self.table)
        if self.join is None:
            return table
        log = open_table(Path(path).parent / self.join.file, self.join.table)
        clocks = []
        for time, of, field in (self.time, table, "time"), (self.join.time, log, "join.time"):
            if time is None and TIME in of.header:
                time = Time(column=TIME, unit="s")
            if time is None:
                raise InputError(
                    f"mapping: {field}: missing; tables are joined by time, give the column of the "
                    f"time in {of.path} and its unit"
                )
            clocks.append(time.layout(_Finder(of), field))
        how, within, shift = self.join.how, self.join.within, self.join.shift
        return join(table, clocks[0], log, clocks[1], how, within, shift)

    def layout(self, table: Table, g: float) -> Layout:
        """Find the columns in a table.

        Raises
        ------
        InputError
            If a column is missing.
        """
        finder = _Finder(table)
        find = finder.column
        found = Layout(
            source=self.source,
            name=self.name or (table.about.get("name") if table.length_unit else None),
            tool=np.array(self.tool),
            own_label=False,
        )
        if self.tendons is not None:
            found.tendons = self.tendons.layout(finder, g)
        if self.tip is not None or self.points is not None:
            found.scale, found.points = self._points(finder)
        if self.shape is not None:
            in_pixels = self.shape.unit == PIXELS
            found.scale = None if in_pixels else 1.0
            factor = 1.0 if in_pixels else _scale_of(self.shape.unit, "m")
            found.shape = find("shape.column", self.shape.column, factor)
        if self.angles is not None:
            self.angles.find(found, finder)
        if self.join is not None and table.own is not None and found.tendons:
            later = [column.index >= table.own for _, column in found.tendons]
            found.join = Joined(self.join.shift, any(later))
        if self.stations is not None:
            count = len(found.points) or len(self.stations)
            found.stations = check_stations("mapping: stations", self.stations, count)
        if self.frame is not None:
            found.rotation = self.frame.matrix
        if isinstance(self.sigma, Sigma):
            found.sigma = find("sigma.column", self.sigma.column, _scale_of(self.sigma.unit, "m"))
        else:
            found.sigma_of_all = self.sigma
        if self.time is not None:
            found.time = self.time.layout(finder)
        elif table.length_unit and TIME in table.header:
            found.time = find("time", TIME)
        if self.group is not None:
            found.group = find("group", self.group)
        if self.repeat is not None:
            found.repeat = find("repeat", self.repeat)
        if self.recording is not None:  # another field may use the same column
            found.recording = _Finder(table).column("recording", self.recording)
        if self.keep is not None:
            found.keep = (find("keep.column", self.keep.column), self.keep.value)
        if "source" in table.header and "source" not in finder.used:
            found.label = find("source", "source")  # the data's own label takes precedence
        return found

    def _points(self, find: _Finder) -> tuple[float | None, list[tuple[Column, ...]]]:
        """Scale, and columns of all points from base to tip."""
        part = self.tip or self.points
        assert part is not None
        what = "points" if self.tip is None else "tip"
        points = part.points(find)
        said = find.table.length_unit
        unit = part.unit or said
        if unit is None:
            raise InputError(
                f"mapping: {what}.unit: missing; {find.table.path} does not say the unit of its "
                "coordinates, write for example unit: mm"
            )
        if said is not None and unit != said:
            raise InputError(
                f"mapping: {what}.unit: got {quote(unit)}; {find.table.path} says that its lengths "
                f"are in {said}, leave the unit out"
            )
        where = f"{what}.columns"
        columns = [tuple(find.source(where, axis, unit, "m") for axis in p) for p in points]
        if any(all(axis.constant is not None for axis in point) for point in columns):
            raise InputError(
                f"mapping: {where}: of each point at least one coordinate must be a column of "
                f"{find.table.path}"
            )
        return (None if unit == PIXELS else 1.0), columns


class _Finder:
    """Finder of columns by name, each for one field only."""

    def __init__(self, table: Table) -> None:
        self.table = table
        self.used: dict[str, str] = {}

    def column(self, field: str, name: str, factor: float = 1.0) -> Column:
        """Find a column by name; raise InputError if it is missing or used by another field."""
        header = self.table.header
        if name not in header:
            raise InputError(
                f"{self.table.path}, line {self.table.line}: there is no column {quote(name)}, "
                f"which the mapping names at {field}; {did_you_mean(name, header)}the columns are "
                f"{_listed(header)}"
            )
        if (of := self.used.get(name)) and not (
            of.startswith("tendons.") and field.startswith("tendons.")  # checked by the mapping
        ):
            raise InputError(f"mapping: {field}: the column {quote(name)} is used for {of} already")
        self.used[name] = field
        return Column(header.index(name), name, factor)

    def source(
        self,
        field: str,
        source: Source,
        unit: str,
        si: str,
        factor: float = 1.0,
        zero: Zero | None = None,
    ) -> Column:
        """Column with unit, sign, zero and part, or a constant in its place."""
        factor *= source.factor(unit, si)
        name = source.column
        if name is None or (source.is_number and name not in self.table.header):
            if source.zero is not None:
                raise InputError(f"mapping: {field}: a constant has no zero, only a column has")
            value = float(name or 0)
            return Column(-1, name or "null", factor, source.part, constant=value)
        given = next((each for each in (source.zero, zero) if each is not None), 0.0)
        more = source.instead if isinstance(source, Coordinate) else ()
        instead = tuple(self.column(field, other, factor) for other in more)
        found = self.column(field, name, factor)
        return replace(found, part=source.part, zero=given, instead=instead)

    def body(self, field: str, names: Sequence[str]) -> Sequence[Coordinate]:
        """Columns of a rigid body or a marker of a Motive export, which may change its name."""
        header = self.table.header
        for name in names:
            if f"{name} Position X" not in header:
                mark = " Position X"
                known = [item.removesuffix(mark) for item in header if item.endswith(mark)]
                have = (
                    f"it has {_listed(known)}" if known else "it is no Motive export, give columns"
                )
                raise InputError(
                    f"{self.table.path}: there is no rigid body or marker {quote(name)}, which the "
                    f"mapping names at {field}; {did_you_mean(name, known)}{have}"
                )
        columns = [[f"{name} Position {axis}" for name in names] for axis in "XYZ"]
        return [Coordinate(column=first, instead=tuple(rest)) for first, *rest in columns]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(quote, names[:12])) + (", ..." if len(names) > 12 else "")


# -- reading -----------------------------------------------------------------------------------


def mapping_names() -> list[str]:
    """List the names of the built-in mappings, one per public data set (`datasets`)."""
    return sorted(path.stem for path in _BUILT_IN.glob("*.yaml"))


def load_mapping(source: str | Path) -> Mapping:
    """Load a mapping file, or a built-in one by its name.

    Parameters
    ----------
    source : str or Path

    Returns
    -------
    Mapping

    Raises
    ------
    InputError
        If it does not exist or is not valid; the message lists all problems with their fields.
    """
    names = mapping_names()
    path = _BUILT_IN / f"{source}.yaml" if str(source) in names else Path(source)
    label = f"Mapping {source}" if str(source).isprintable() else f"Mapping {quote(str(source))}"
    tree = read_yaml(_text(path, label, names), label, "mapping", "tip")
    return checked(Mapping, tree, label)


def _text(path: Path, label: str, names: Sequence[str]) -> str:
    with reading(label):
        if path.is_dir():
            raise InputError(f"{label} is a folder; give a mapping file (YAML).")
        if not path.exists():
            raise InputError(
                f"{label} is neither a file nor the name of one that comes with Bowstring; "
                f"{did_you_mean(str(path), names)}these are {', '.join(names)}."
            )
        return text_of(path, label, "mapping")
