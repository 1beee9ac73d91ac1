"""A mapping file: what the columns of somebody else's table of measurements mean.

YAML, checked as a whole: columns, units, order and sign of the tendons, axes of the frame.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator

from bowstring.columns import (
    PIXELS,
    SIGMA,
    TOOL,
    Column,
    Layout,
    check_stations,
    factor_of,
    nearest,
)
from bowstring.errors import InputError
from bowstring.safe_yaml import read_yaml, reading, text_of
from bowstring.tables import Table
from bowstring.units import Text, quote, wrong

__all__ = ["Mapping", "load_mapping", "mapping_names"]

_BUILT_IN: Final = Path(__file__).with_name("mappings")
_MOST_POINTS: Final = 1_000

Floats = NDArray[np.float64]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _unit(si: str, pixels: bool = False) -> BeforeValidator:
    def check(value: object) -> object:
        if not isinstance(value, str):
            raise wrong(f"got {quote(value)}; must be a unit")
        if pixels and value == PIXELS:
            return value
        try:
            factor_of(value, si)
        except ValueError as error:
            raise wrong(f"got {quote(value)}, {error}") from None
        return value

    return BeforeValidator(check)


_COLUMN = Text(200, "tip_x")
Name = Annotated[str, _COLUMN]
Triple = Annotated[tuple[Name, Name, Name], Field(description="Columns of x, y and z.")]
LengthUnit = Annotated[str, _unit("m", pixels=True)]


class Tendons(_Part):
    """How the tendons are driven, in the robot's order."""

    quantity: Literal["mass", "tension", "pull"]
    unit: str
    columns: tuple[Name, ...] = Field(min_length=1, max_length=1_000)
    positive: Literal["pulled", "paid_out"] = "pulled"

    @model_validator(mode="after")
    def _check(self) -> Tendons:
        si = {"mass": "kg", "tension": "N", "pull": "m"}[self.quantity]
        try:
            factor_of(self.unit, si)
        except ValueError as error:
            raise wrong(f"unit: got {quote(self.unit)}, {error}") from None
        if self.positive == "paid_out" and self.quantity != "pull":
            raise wrong(f"positive: paid_out is for pulls, a {self.quantity} pulls")
        if len(set(self.columns)) < len(self.columns):
            raise wrong("columns: one is there twice; each tendon has its own")
        return self

    def layout(self, g: float) -> tuple[Literal["tension", "pull"], float]:
        """Kind, and factor to SI with its sign."""
        if self.quantity == "pull":
            sign = -1.0 if self.positive == "paid_out" else 1.0
            return "pull", sign * factor_of(self.unit, "m")
        if self.quantity == "mass":
            return "tension", g * factor_of(self.unit, "kg")
        return "tension", factor_of(self.unit, "N")


class Tip(_Part):
    """Columns of the measured tip."""

    columns: Triple
    unit: LengthUnit


class Points(_Part):
    """Columns of measured points from base to tip; the last is the tip."""

    columns: tuple[Triple, ...] = Field(min_length=1, max_length=_MOST_POINTS)
    unit: LengthUnit


class Shape(_Part):
    """One column with whole shapes, as JSON: [[x, y], ...] or [[x, y, z], ...], base to tip."""

    column: Name
    unit: LengthUnit


class Angles(_Part):
    """Columns of angle and direction of bending."""

    bend: Name
    direction: Annotated[str | None, _COLUMN] = None
    unit: Annotated[str, _unit("rad")]


class Time(_Part):
    """The column of the time."""

    column: Name
    unit: Annotated[str, _unit("s")]


class Sigma(_Part):
    """The column of the standard uncertainty of a coordinate."""

    column: Name
    unit: Annotated[str, _unit("m")]


class Keep(_Part):
    """A column and what it must say for a row to be read."""

    column: Name
    value: Annotated[str, Text(200, "1")]


class Frame(_Part):
    """How the axes of the measuring frame lie in the file's: named, or as a rotation matrix."""

    axes: tuple[str, str, str] | None = None
    rotation: tuple[tuple[float, float, float], ...] | None = None
    handed: Literal["right", "left"] = "right"

    @model_validator(mode="after")
    def _check(self) -> Frame:
        if (self.axes is None) == (self.rotation is None):
            raise wrong("give either axes, such as [x, z, -y], or rotation, three rows")
        self.matrix  # noqa: B018
        return self

    @property
    def matrix(self) -> Floats:
        """(3, 3), from the file's axes to those of the measuring frame."""
        if self.axes is not None:
            matrix = np.zeros((3, 3))
            for row, text in zip(matrix, self.axes, strict=True):
                match = re.fullmatch(r"([+-]?)([xyz])", text.strip())
                if match is None:
                    raise wrong(f"axes: got {quote(text)}; must be x, y or z, or one with a minus")
                row["xyz".index(match[2])] = -1.0 if match[1] == "-" else 1.0
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
                "this is a rotation, which leaves them left-handed"
            )
        return matrix


def _sigma_form(value: object) -> object:
    return value if isinstance(value, dict) else SIGMA.read(value)


class Mapping(_Part):
    """What the columns of a table mean.

    Attributes
    ----------
    name, source, description
        ``source`` is measured, synthetic or computed.
    tendons, tip, points, shape, angles, time, sigma, group, repeat, keep
        Columns and their units.
    stations : tuple of float
        Where points are, as shares of the length.
    frame : Frame
        Axes of the measuring frame in the file's axes.
    tool : tuple of 3 floats
        What was measured at the tip, seen from the tip in its axes, m.
    """

    name: Annotated[str | None, Text(100, "my bench")] = None
    description: Annotated[str, Text(2000, "Tips by motion capture", lines=True)] = ""
    source: Literal["measured", "synthetic", "computed"]
    tendons: Tendons | None = None
    tip: Tip | None = None
    points: Points | None = None
    shape: Shape | None = None
    angles: Angles | None = None
    stations: tuple[float, ...] | None = None
    frame: Frame | None = None
    tool: Annotated[tuple[float, float, float], TOOL] = (0.0, 0.0, 0.0)
    sigma: Annotated[Sigma | float | None, BeforeValidator(_sigma_form)] = None
    time: Time | None = None
    group: Annotated[str | None, _COLUMN] = None
    repeat: Annotated[str | None, _COLUMN] = None
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

    def layout(self, table: Table, g: float) -> Layout:
        """Find the columns in a table.

        Raises
        ------
        InputError
            If one is not there.
        """
        finder = _Finder(table)
        find = finder.column
        found = Layout(
            source=self.source, name=self.name, tool=np.array(self.tool), own_label=False
        )
        if self.tendons is not None:
            kind, factor = self.tendons.layout(g)
            found.tendons = [
                (kind, find(f"tendons.columns[{i}]", name, factor))
                for i, name in enumerate(self.tendons.columns)
            ]
        points = self.points
        if self.tip is not None:
            points = Points(columns=(self.tip.columns,), unit=self.tip.unit)
        if points is not None:
            found.scale, factor = _scale(points.unit)
            where = "tip.columns" if self.tip is not None else "points.columns"
            for x, y, z in points.columns:
                found.points.append(
                    (find(where, x, factor), find(where, y, factor), find(where, z, factor))
                )
        if self.shape is not None:
            found.scale, factor = _scale(self.shape.unit)
            found.shape = find("shape.column", self.shape.column, factor)
        if self.angles is not None:
            factor = factor_of(self.angles.unit, "rad")
            found.bend = find("angles.bend", self.angles.bend, factor)
            if self.angles.direction is not None:
                found.direction = find("angles.direction", self.angles.direction, factor)
        if self.stations is not None:
            values = list(self.stations)
            count = len(found.points) or len(values)
            found.stations = check_stations("mapping: stations", values, count)
        if self.frame is not None:
            found.rotation = self.frame.matrix
        if isinstance(self.sigma, Sigma):
            found.sigma = find("sigma.column", self.sigma.column, factor_of(self.sigma.unit, "m"))
        else:
            found.sigma_of_all = self.sigma
        if self.time is not None:
            found.time = find("time.column", self.time.column, factor_of(self.time.unit, "s"))
        if self.group is not None:
            found.group = find("group", self.group)
        if self.repeat is not None:
            found.repeat = find("repeat", self.repeat)
        if self.keep is not None:
            found.keep = (find("keep.column", self.keep.column), self.keep.value)
        if "source" in table.header and "source" not in finder.used:
            found.label = find("source", "source")  # what data say of themselves stays
        return found


def _scale(unit: str) -> tuple[float | None, float]:
    return (None, 1.0) if unit == PIXELS else (1.0, factor_of(unit, "m"))


class _Finder:
    def __init__(self, table: Table) -> None:
        self.table = table
        self.used: dict[str, str] = {}

    def column(self, field: str, name: str, factor: float = 1.0) -> Column:
        header = self.table.header
        if name not in header:
            near = nearest(name, header)
            hint = f"did you mean {near}? " if near else ""
            listed = ", ".join(map(quote, header[:12])) + (", ..." if len(header) > 12 else "")
            raise InputError(
                f"{self.table.path}, line {self.table.line}: there is no column {quote(name)}, "
                f"which the mapping names at {field}; {hint}the columns are {listed}"
            )
        if name in self.used:
            raise InputError(
                f"mapping: {field}: the column {quote(name)} is used for {self.used[name]} already"
            )
        self.used[name] = field
        return Column(header.index(name), name, factor)


# -- reading -----------------------------------------------------------------------------------


def mapping_names() -> list[str]:
    """Names of the mappings that come with Bowstring: public data sets, see `datasets`."""
    return sorted(path.stem for path in _BUILT_IN.glob("*.yaml"))


def load_mapping(source: str | Path) -> Mapping:
    """Load a mapping file, or one that comes with Bowstring by its name.

    Parameters
    ----------
    source : str or Path

    Returns
    -------
    Mapping

    Raises
    ------
    InputError
        If there is none, or it is not valid; every problem is named by its field.
    """
    names = mapping_names()
    path = _BUILT_IN / f"{source}.yaml" if str(source) in names else Path(source)
    label = f"Mapping {source}" if str(source).isprintable() else f"Mapping {quote(str(source))}"
    tree = read_yaml(_text(path, label, names), label, "mapping", "tip")
    try:
        return Mapping.model_validate(tree)
    except ValidationError as error:
        problems = [_sentence(item) for item in error.errors()]
    first, *others = dict.fromkeys(problems)
    more = f" (and {len(others)} more)" if others else ""
    raise InputError("\n".join([f"{label}: {first}{more}.", *(f"  {o}." for o in others[:20])]))


def _text(path: Path, label: str, names: Sequence[str]) -> str:
    with reading(label):
        if path.is_dir():
            raise InputError(f"{label} is a folder; give a mapping file (YAML).")
        if not path.exists():
            near = nearest(str(path), names)
            hint = f"did you mean {near}? " if near else ""
            raise InputError(
                f"{label} is neither a file nor the name of one that comes with Bowstring; {hint}"
                f"these are {', '.join(names)}."
            )
        return text_of(path, label, "mapping")


_MODELS: Final[dict[tuple[str, ...], type[BaseModel]]] = {
    (): Mapping,
    ("tendons",): Tendons,
    ("tip",): Tip,
    ("points",): Points,
    ("shape",): Shape,
    ("angles",): Angles,
    ("frame",): Frame,
    ("sigma",): Sigma,
    ("time",): Time,
    ("keep",): Keep,
}


def _sentence(error: Any) -> str:
    """One of pydantic's errors as "field: sentence"."""
    kind, given = error["type"], error["input"]
    loc = tuple(step for step in error["loc"] if step not in ("Sigma", "float"))
    path = "".join(f"[{s}]" if isinstance(s, int) else f".{s}" for s in loc).lstrip(".")
    if kind == "bowstring":
        sentence = error["ctx"]["sentence"]
        return f"{path}: {sentence}" if path else sentence
    names = tuple(step for step in loc if isinstance(step, str))
    if kind == "extra_forbidden":
        known = list(_MODELS[names[:-1]].model_fields)
        near = nearest(names[-1], known)
        hint = f"; did you mean {near}?" if near else "."
        return f"{path}: unknown field{hint} Known here: {', '.join(known)}"
    if kind == "missing":
        return f"{path}: missing"
    if kind == "literal_error":
        return f"{path}: got {quote(given)}; must be {error['ctx']['expected']}"
    if kind in ("model_type", "model_attributes_type"):
        fields = ", ".join(_MODELS[names].model_fields)
        return f"{path}: got {quote(given)}; must be a set of fields: {fields}"
    if kind in ("too_short", "too_long", "tuple_type"):
        return f"{path}: got {quote(given)}; must be a list of columns or numbers of right length"
    if kind in ("float_parsing", "float_type"):
        return f"{path}: got {quote(given)}; must be a number"
    return f"{path}: got {quote(given)}; {error['msg'][:1].lower()}{error['msg'][1:]}"
