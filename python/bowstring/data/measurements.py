"""Measurements of a robot: commands and measured points, read from tables, in SI.

Data keep their source: measured, synthetic (simulated) or computed by others. Points are in the
measuring frame; `bowstring.data.registration` maps them to the base frame.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, Any, Final, TextIO, cast

import numpy as np
from numpy.typing import NDArray

from bowstring._core import __version__
from bowstring.aliases import Bools, Floats, Ints
from bowstring.data import channels, datasets
from bowstring.data.clock import ISO, times
from bowstring.data.columns import SOURCES, Column, Joined, Layout, Source, check_stations, tidy
from bowstring.data.header_detection import detected
from bowstring.data.mapping import Mapping, load_mapping
from bowstring.data.mapping_draft import draft
from bowstring.data.tables import (
    Row,
    Table,
    UnknownColumnsError,
    cell_number,
    is_missing,
    is_text,
    not_measured,
    open_table,
    with_point,
)
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.files import json_files
from bowstring.files.atomic_io import has_mark, not_overwritten, write_whole_file
from bowstring.files.json_files import parsed, structured
from bowstring.formatting import in_mm, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.model import Robot, check_robot
from bowstring.significance import NORMAL, student
from bowstring.units import printable, quote

STANDARD_GRAVITY: Final = 9.80665  # m/s^2, by definition
_MOST_ISSUES: Final = 1_000
_MOST_LABELS: Final = 100
_MOST_SHAPE_POINTS: Final = 1_000
_LONGEST_LABEL: Final = 200
_MOST_COORDINATES: Final = 100_000_000  # 0.8 GB
_NO_ROTATION: Final = 0.05  # deviation of the length of a quaternion from 1
_LARGEST: Final = 1e30  # larger numbers may overflow in the conversion to SI
_REACH: Final = 3.0  # distance of a tip from the mean tip over length; at most 1 + sqrt(3)
_DECIMAL_COMMA: Final = re.compile(r"\s*[+-]?[0-9]*,[0-9]+(?:[eE][+-]?[0-9]+)?\s*")
_WRITTEN: Final = "written by Bowstring"  # identifies our tables
_OUT: Final = "left out: "
_MANY: Final = 10  # rows in which a measured number varies
_FEW: Final = 0.05  # share of rows left out above which results are doubtful
_LOADED: Final = 0.1  # range of a tension over the largest, above which the tendon is loaded
_THOUSANDS: Final = re.compile(r"\s*[+-]?[1-9][0-9]{0,2},[0-9]{3}\s*")


@dataclass(frozen=True)
class MeasurementIssue(Result):
    """A line of a table of measurements that has something wrong."""

    line: Annotated[int, Key()]
    """Line of the file, from 1."""
    text: Annotated[str, Key()]
    """Fault, and whether the row is left out."""


@short_repr
@dataclass(frozen=True, eq=False)
class Measurements:
    """K rows of data of a robot with T tendons, and P measured points per row; read-only.

    Rows are in the order of the file, which is the load history where friction matters.
    """

    source: Source
    """"measured", "synthetic" or "computed"."""
    name: str
    """Name for reports; from a table that states none, the name of its file."""
    tensions: Floats
    """Tensions (K, T), N; NaN for tendons with another command."""
    displacements: Floats
    """Tendon displacements (K, T), m, positive where shortened; NaN for tendons with another
    command."""
    points: Floats
    """Measured points (K, P, 3), m, in the measuring frame, from base to tip; the last is the tip.
    NaN where a point was not measured: a row without a tip is only a step of the path. P is 0 for
    data with angles only."""
    line: Ints
    """Lines in the file (K,), from 1."""
    group: NDArray[np.str_]
    """Labels (K,) such as loading and unloading; empty text by default."""
    repeat: Ints
    """Numbers of repeated runs (K,); 1 by default."""
    stations: Floats | None = None
    """Arc lengths of the points (P,), as shares of the length."""
    sigma: Floats | None = None
    """Standard uncertainty of a measured coordinate (K,), m."""
    bend: Floats | None = None
    """Bend angle between base and tip (K,), rad."""
    direction: Floats | None = None
    """Direction of bending (K,), rad, from x counter-clockwise."""
    time: Floats | None = None
    """Time (K,), s."""
    recording: Ints | None = None
    """Number of the recording (K,), from 1: each is a separate path, which begins in the home pose
    without a history. None: all rows form one path."""
    scale: float | None = 1.0
    """Unit of `points` in m: 1, or None for pixels."""
    tool: Floats = field(default_factory=lambda: np.zeros(3))
    """Offset of the measured point from the tip (3,), in the tip's axes, m."""
    issues: tuple[tuple[int, str], ...] = ()
    """Line and message of each row that was left out or is implausible."""
    left_out: int = 0
    """Number of rows of the file that are not in the arrays."""
    filtered: int = 0
    """Number of rows that the mapping leaves out by ``keep``."""
    below_zero: int = 0
    """Number of rows left out for a tension below zero."""
    least_tension: float = 0.0
    """Least tension of these rows, N."""
    likely_zeros: tuple[tuple[str, float], ...] = ()
    """Columns of tensions and their likely zeros, in their own units, if rows are left out for a
    tension below zero."""
    negated: tuple[str, ...] = ()
    """Columns of tensions that look turned in sign, if rows are left out for a tension below
    zero."""
    zero_error: Floats | None = None
    """Standard errors (T,) of the zeros of tensions that the file has by rows, N; 0 for others."""
    columns: tuple[Column, ...] = ()
    """Columns of the T tendons in the file; empty for other data."""
    join: Joined | None = None
    """Clock of a joined table; None: no table is joined."""
    faults: tuple[str, ...] = ()
    """Sentences on readings that are probably wrong. Rows with a spike of a command are left out;
    those with a spike of a tip or a saturated sensor are kept."""
    path: Path | None = None
    """File from which the data were read; None for other data."""
    sha256: str | None = None
    """SHA-256 of the file."""
    truth: dict[str, Any] | None = None
    """True parameters of data from `bowstring.data.synthetic`, for all rows as generated."""

    def __post_init__(self) -> None:
        if self.source not in SOURCES:
            raise InputError(f"source is {quote(self.source)}, it must be {listed(SOURCES, 'or')}")
        for name in _ARRAYS:
            if (value := getattr(self, name)) is not None:
                array = np.asarray(value, dtype=_TYPES.get(name, float)).view()
                array.flags.writeable = False
                object.__setattr__(self, name, array)
        size = {"K": len(self.line), "3": 3}
        size["T"] = self.tensions.shape[-1] if self.tensions.ndim == 2 else -1
        size["P"] = self.points.shape[1] if self.points.ndim == 3 else -1
        for name, letters in _ARRAYS.items():
            array, expected = getattr(self, name), tuple(size[letter] for letter in letters)
            if array is not None and array.shape != expected:
                raise InputError(f"{name} has shape {array.shape}, it must be {expected}")

    def __len__(self) -> int:
        return len(self.line)

    @property
    def tip(self) -> Floats:
        """Measured tips (K, 3), m, in the measuring frame."""
        if self.points.shape[1] == 0:
            raise InputError(f"{self.name} has angles only, there is no measured tip")
        return np.asarray(self.points[:, -1])

    @property
    def seen(self) -> Bools:
        """Whether a row has a measured tip (K,); the others are only steps of the path."""
        return np.asarray(np.isfinite(self.tip).all(axis=1))

    @property
    def without_tip(self) -> int:
        """Number of rows without a tip, in data that have tips."""
        return int((~self.seen).sum()) if self.points.shape[1] else 0

    @property
    def doubt(self) -> str:
        """Warning of `faults` and if more than a twentieth of the rows is left out; else empty.

        Rows that the mapping leaves out do not count.
        """
        return " ".join([*([self._lost] if self._lost else []), *self.faults])

    @property
    def _lost(self) -> str:
        """Warning if more than a twentieth of the rows is left out."""
        lost = self.left_out - self.filtered
        count = len(self) + lost
        if lost <= _FEW * count:
            return ""
        said = f"{lost} of {count} rows are left out"
        if not self.is_biased:
            at = next((line for line, text in self.issues if text.startswith(_OUT)), 0)
            return f"{said}, the first in line {at}: results are of the other rows alone."
        every = "all" if self.below_zero == lost else f"{self.below_zero}"
        return (
            f"{said}, {every} for a tension below zero (down to "
            f"{significant(self.least_tension, 2)} N): results are of the rows alone in which all "
            "tendons read above zero, and are biased. "
            f"{channels.advice(self.likely_zeros, self.negated)}"
        )

    @property
    def is_biased(self) -> bool:
        """Whether rows are left out, as `doubt` says, mostly for a tension below zero."""
        lost = self.left_out - self.filtered
        return lost > _FEW * (len(self) + lost) and self.below_zero >= 0.5 * lost

    @property
    def tendon_count(self) -> int:
        """Number of tendons T."""
        return int(self.tensions.shape[1])

    def select(self, rows: Any) -> Measurements:
        """Select rows, in the given order; issues stay those of the whole file.

        Parameters
        ----------
        rows : array_like
            Booleans (K,), or indices.
        """
        index = np.arange(len(self))[rows]
        by_row = (name for name, letters in _ARRAYS.items() if letters.startswith("K"))
        given = {name: array for name in by_row if (array := getattr(self, name)) is not None}
        return replace(self, **{name: array[index] for name, array in given.items()})

    def split(self) -> dict[str, Measurements]:
        """Split rows by group label, in the order of first appearance."""
        labels = dict.fromkeys(self.group.tolist())
        return {label: self.select(self.group == label) for label in labels}


# shapes of the arrays: K rows, T tendons, P points
_ARRAYS: Final = {
    **{"tensions": "KT", "displacements": "KT", "points": "KP3", "stations": "P", "tool": "3"},
    "zero_error": "T",
    **dict.fromkeys(("line", "group", "repeat", "recording"), "K"),
    **dict.fromkeys(("sigma", "bend", "direction", "time"), "K"),
}
_TYPES: Final = {"line": np.int64, "repeat": np.int64, "recording": np.int64, "group": str}


# -- reading -----------------------------------------------------------------------------------


def load(name: str, part: str | None = None) -> Measurements:
    """Load a public data set with its built-in mapping.

    Parameters
    ----------
    name : str
        Name from `bowstring.data.datasets.available`.
    part : str, optional
        One of its tables; may be left out if there is only one.

    Returns
    -------
    Measurements

    Raises
    ------
    InputError
        If there is no such set or part, it is not available, or it is no table of measurements.
    """
    file = datasets.table(name, part)
    found = read_measurements(file, mapping=name)
    return replace(found, name=name if part is None else f"{name}, {part}")


def read_measurements(
    path: str | Path,
    robot: Robot | None = None,
    mapping: str | Path | Mapping | None = None,
    *,
    g: float = STANDARD_GRAVITY,
    keep_below_zero: bool = False,
) -> Measurements:
    """Read a table of measurements: CSV, TSV, Excel or MATLAB.

    Parameters
    ----------
    path : str or Path
        Table in the tidy format (docs/guide/measurements.md): a row for each measurement, columns
        with units such as ``mass_1_kg``, ``tension_1_N``, ``displacement_1_mm``, ``tip_x_mm``; or
        any other format with a mapping.
    robot : Robot, optional
        Robot, to check the number of tendons and the reach of the tips.
    mapping : str, Path or Mapping, optional
        Mapping file, or the name of a public data set.
    g : float
        Gravitational acceleration that converts masses to tensions, m/s^2.
    keep_below_zero : bool
        Whether rows with a tension below zero are kept as they are, for a fit of the offsets.

    Returns
    -------
    Measurements
        Commands and measured points in SI, with their lines in the table.

    Raises
    ------
    InputError
        If the table cannot be read; the message has file, line and advice. Single invalid rows are
        left out and listed in `Measurements.issues`; rows with a blank tip are kept and listed.
    """
    if robot is not None:
        check_robot(robot)
    if not 0 < g <= 10_000:
        raise InputError.of("g", f"{g:g} m/s^2", "above 0 and up to 10000")
    if mapping is None:
        try:
            table = open_table(path)
            layout = tidy(table, g)
        except UnknownColumnsError as error:
            tables = [error.table]
            if error.table.length_unit is None:
                tables = detected(error.table.path) or tables
            joint = " Or" if str(error).endswith("?") else "; or"
            raise InputError(
                f"{error}{joint} say what the columns are in a mapping file: save these lines as "
                "map.yaml, check them, and give --mapping map.yaml (in Python "
                f'mapping="map.yaml"):\n\n{draft(tables, robot)}'
            ) from None
    else:
        if not isinstance(mapping, Mapping):
            mapping = load_mapping(mapping)
        table = mapping.open(path)
        layout = mapping.layout(table, g)
    count = len(layout.tendons)
    if robot is not None and count != len(robot.tendons.angle_rad):
        raise _wrong_count(table, robot, count)
    found = _Reader(table, layout, robot, keep_below_zero).read()
    return found if robot is None else _within_reach(found, robot)


def _within_reach(found: Measurements, robot: Robot) -> Measurements:
    """List tips out of the robot's reach; refuse a table in which most of them are."""
    if found.points.shape[1] == 0 or found.scale is None:
        return found
    reach = _REACH * (robot.length + float(np.linalg.norm(found.tool)))
    tips = found.tip[found.seen]
    if not len(tips):
        return found
    distance = np.linalg.norm(found.tip - np.median(tips, axis=0), axis=1)
    far = distance > reach  # False for rows without a tip
    if far.sum() > 0.5 * len(tips):
        raise InputError(
            f"{found.path}: the tips lie up to {in_mm(float(np.ptp(tips, axis=0).max()))} "
            f"apart, and {robot.name} is {in_mm(robot.length)} long; check the unit of the tip's "
            "columns"
        )
    notes = [
        (
            int(found.line[i]),
            f"the tip is {in_mm(float(distance[i]))} from the middle of all, and {robot.name} is "
            f"{in_mm(robot.length)} long; it is kept",
        )
        for i in np.flatnonzero(far)[:_MOST_ISSUES]
    ]
    return replace(found, issues=tuple(sorted((*found.issues, *notes))))


def _wrong_count(table: Table, robot: Robot, count: int) -> InputError:
    needed = len(robot.tendons.angle_rad)
    what = f"{count} tendon" + ("" if count == 1 else "s")
    advice = (
        "give every tendon a column, with 0 where it has no load"
        if count < needed
        else "leave out those that are none, or name the right robot"
    )
    return InputError(f"{table.path}: the table has {what}, {robot.name} has {needed}; {advice}")


class _Reader:
    """Reader of rows into arrays; invalid rows are left out and listed."""

    def __init__(
        self, table: Table, layout: Layout, robot: Robot | None, keep_below_zero: bool
    ) -> None:
        self.table, self.layout, self.keep_below_zero = table, layout, keep_below_zero
        alike = [False] * len(layout.tendons)
        self.pushes = alike if robot is None else robot.tendons.pushes.tolist()
        self.issues: list[tuple[int, str]] = []
        self.left_out = self.filtered = self.below_zero = 0
        self.least_tension = 0.0
        self.likely_zeros: tuple[tuple[str, float], ...] = ()
        self.negated: tuple[str, ...] = ()
        self.faults: list[str] = []
        self.zero_error: dict[str, float] = {}
        self.unlisted = (0, 0)  # number of unlisted rows that were left out, and the last one
        self.comma: tuple[int, str] | None = None  # first line and column with a decimal comma
        self.point: tuple[int, str] | None = None  # with a decimal point
        self.doubled = (0, 0, "")  # rows, first of them, and column with two measured values
        self.comma_is_sure = table.separator == ";"  # where commas are decimal ones
        self.labels: dict[str, int] = {}
        self.recordings: dict[str, int] = {}
        self.width = len(table.header)
        self.point_count = len(layout.points)
        self.rows = 0

    def find_zeros(self) -> None:
        """Read the zeros of columns that are means of rows of the table, without spikes."""
        layout = self.layout
        columns = [column for _, column in layout.tendons]
        columns += [column for point in layout.points for column in point]
        last = max((c.zero[1] for c in columns if isinstance(c.zero, tuple)), default=0)
        if not last:
            return
        rows = list(islice(self.table.rows, last))
        self.table.rows = chain(rows, self.table.rows)

        def known(column: Column) -> Column:
            if not isinstance(column.zero, tuple):
                return column
            begin, end = column.zero
            which = f"number in row {end}" if begin == end else f"mean in rows {begin} to {end}"
            said = f"the zero of {column.name} is its {which}"
            if len(rows) < end:
                raise InputError(f"{self.table.path}: {said}, and the table has {len(rows)} rows")
            lines, cells = zip(*rows[begin - 1 : end], strict=True)
            given = [row[column.index] if column.index < len(row) else "" for row in cells]
            values = self.numbers(given, list(lines), column)
            if not np.isfinite(values).all():
                k = int(np.argmin(np.isfinite(values)))
                raise InputError(
                    f"{self.table.path}, line {lines[k]}: {said}, and here it is "
                    f"{quote(given[k])}; name other rows, or give the number"
                )
            kept = channels.steady(values)
            if not kept.all():
                spikes = [quote(given[k]) for k in np.flatnonzero(~kept)]
                said += f", without {listed(spikes)} far from the others"
            values = values[kept]
            zero = float(values.mean())
            if len(values) > 1:
                # 1.96 of these deviations are Student's interval
                wide = float(student(len(values) - 1)) / NORMAL
                error = wide * float(values.std(ddof=1)) / math.sqrt(len(values))
                self.zero_error[column.name] = abs(error * column.factor)
            else:  # by the scatter of other readings without load
                self.zero_error[column.name] = math.nan
            self.issues.append((lines[0], f"{said}: {significant(zero, 6)}"))
            return replace(column, zero=zero)

        layout.tendons = [(kind, known(column)) for kind, column in layout.tendons]
        layout.points = [tuple(map(known, point)) for point in layout.points]

    def read(self) -> Measurements:
        self.find_zeros()
        chunks = [found for each in self.table.chunks() if len((found := self.chunk(each))["line"])]
        if not chunks:
            raise self.nothing()
        arrays: dict[str, Any] = {
            name: np.concatenate([found[name] for found in chunks]) for name in chunks[0]
        }
        if self.layout.points:
            arrays["unseen"] = np.isnan(arrays["points"][:, -1]).all(axis=1)
        if not (good := self.find_faults(arrays)).all():
            arrays = {name: array[good] for name, array in arrays.items()}
        if not (good := self.judge_tensions(arrays["tensions"], arrays["line"])).all():
            arrays = {name: array[good] for name, array in arrays.items()}
        if not len(arrays["line"]):
            raise self.nothing()
        lines = arrays["line"]
        unseen = arrays.pop("unseen", np.zeros(len(lines), bool))
        text = "no tip was measured: the row leads the path, and counts in no number"
        self.note_rows(lines[unseen], lambda k: text, int(lines[-1]), "have no measured tip")
        self.issues += self.table.notes
        if self.comma is not None:
            if self.point is not None:
                (comma, name), (point, other) = self.comma, self.point
                raise InputError(
                    f"{self.table.path}: numbers have a decimal comma in line {comma} and a "
                    f"decimal point in line {point} (columns {name} and {other}); write all with a "
                    "point"
                )
            if not self.comma_is_sure:
                raise InputError(
                    f"{self.table.path}, line {self.comma[0]}: commas in numbers may stand before "
                    f"decimals or between thousands (column {self.comma[1]}); write numbers with a "
                    "decimal point, and no other"
                )
            self.issues.append((self.comma[0], "numbers have a decimal comma, and are read so"))
        if self.doubled[0]:
            count, line, name = self.doubled
            rows = "one row has" if count == 1 else f"{count} rows (this is the first) have"
            text = f"{rows} values in {name} and in a column that is read instead; {name} is read"
            self.issues.append((line, text))
        self.note_repeated_rows(arrays["line"], arrays.pop("key"))
        self.note_order(arrays)
        if self.unlisted[0]:
            count, last = self.unlisted
            rows = "one more row is" if count == 1 else f"{count} more rows are"
            self.issues.append((last, f"{rows} left out up to here, not listed"))
        if unseen.all() and "bend" not in arrays:
            raise InputError(f"{self.table.path}: no row has a measured tip")
        if self.layout.sigma_of_all is not None:
            arrays["sigma"] = np.full(len(arrays["line"]), self.layout.sigma_of_all)
        stations = self.layout.stations
        if stations is not None:
            check_stations(f"{self.table.path}: stations", stations, self.point_count)
        return Measurements(
            source=self.source(),
            name=printable(self.layout.name or self.table.path.stem),
            stations=stations,
            scale=self.layout.scale,
            tool=self.layout.tool,
            issues=tuple(sorted(self.issues)),
            left_out=self.left_out,
            filtered=self.filtered,
            below_zero=self.below_zero,
            least_tension=self.least_tension,
            likely_zeros=self.likely_zeros,
            negated=self.negated,
            zero_error=np.nan_to_num(
                [
                    self.zero_error.get(column.name, 0.0) if kind == "tension" else 0.0
                    for kind, column in self.layout.tendons
                ]
            ),
            columns=tuple(column for _, column in self.layout.tendons),
            join=self.layout.join,
            faults=tuple(self.faults),
            path=self.table.path,
            sha256=self.table.sha256,
            **arrays,
        )

    def nothing(self) -> InputError:
        if not self.issues:
            return InputError(
                f"{self.table.path}: there is no row of numbers below the header, which is in "
                f"line {self.table.line}"
            )
        line, text = min(self.issues)
        more = f" (rows left out in all: {self.left_out})" if self.left_out > 1 else ""
        cure = ""
        if self.below_zero:
            cure = f". {channels.advice(self.likely_zeros, self.negated)}"
        return InputError(f"{self.table.path}: no row can be read; line {line}: {text}{more}{cure}")

    def leave_out(self, line: int, why: str) -> None:
        self.left_out += 1
        if self.left_out <= _MOST_ISSUES:
            self.issues.append((line, f"{_OUT}{why}"))
        else:
            self.unlisted = (self.unlisted[0] + 1, max(self.unlisted[1], line))

    def source(self) -> Source:
        """Source of the data, from the table or else from the mapping."""
        said = self.table.about.get("source")
        labels = dict(self.labels)
        if not self.layout.own_label:  # a foreign table may use the word otherwise
            labels = {text: line for text, line in labels.items() if text.lower() in SOURCES}
            said = said if said is not None and said.lower() in SOURCES else None
        if len({text.lower() for text in labels}) > 1:
            first, second = list(labels)[:2]
            raise InputError(
                f"{self.table.path}, line {labels[second]}: the source is {quote(second)}, "
                f"before it was {quote(first)}; keep data of different origin in files of their own"
            )
        found = next(iter(labels), said if said is not None else self.layout.source) or "measured"
        if found.lower() not in SOURCES:
            raise InputError(
                f"{self.table.path}: the source is {quote(found)}; it must be measured, synthetic "
                "or computed"
            )
        if said is not None and said.lower() != found.lower():
            raise InputError(
                f"{self.table.path}: the column source says {quote(found)}, the comment "
                f"'# source:' says {quote(said)}"
            )
        return cast("Source", found.lower())

    # -- rows --

    def chunk(self, rows: list[Row]) -> dict[str, NDArray[Any]]:
        if self.layout.keep is not None or any(len(cells) != self.width for _, cells in rows):
            rows = [(line, cells[: self.width]) for line, cells in filter(self.is_whole, rows)]
        self.rows += len(rows)
        if self.rows * 3 * self.point_count > _MOST_COORDINATES:
            raise InputError(
                f"{self.table.path}: {self.rows} rows or more of {self.point_count} points are too "
                f"many; up to {_MOST_COORDINATES} coordinates are read, split the table"
            )
        lines = [line for line, _ in rows]
        columns = list(zip(*(cells for _, cells in rows), strict=True))
        good = np.ones(len(rows), bool)

        def numbers(
            column: Column,
            kind: str = "",
            blank: bool | Bools = False,
            read: tuple[Sequence[str], Floats] | None = None,
        ) -> Floats:
            if column.constant is not None:
                return np.full(len(rows), column.constant * column.factor)
            given, values = read or self.cells(column, columns, lines)
            bad = ~(np.abs(values) < _LARGEST)
            if blank is True and bad.any():
                bad &= [not is_missing(cell) for cell in given]
            elif blank is not False:
                bad &= ~np.asarray(blank)
            si = (values - column.zero if column.zero else values) * column.factor
            if kind == "time":
                si = self.times(column, columns, lines, (given, values))
                bad = ~(np.abs(si) < _LARGEST)
            if kind in _RULES and column.part == "all":
                bad |= ~_RULES[kind][0](si)
            for i in np.flatnonzero(bad & good).tolist():
                value = float(si[i] if kind == "time" else values[i])
                self.leave_out(lines[i], _reason(column, given[i], value, kind))
            good[bad] = False
            return _part(si, column)

        n, layout = len(rows), self.layout
        tensions = np.full((n, len(layout.tendons)), np.nan)
        displacements = tensions.copy()
        for k, (kind, column) in enumerate(layout.tendons):
            target = tensions if kind == "tension" else displacements
            target[:, k] = numbers(column, "" if self.pushes[k] else kind)
        if layout.shape is not None:
            points = self.shapes(columns[layout.shape.index] if rows else (), lines, good)
        else:
            points = np.empty((n, len(layout.points), 3))
            for p, point in enumerate(layout.points):
                found = [
                    None if c.constant is not None else self.cells(c, columns, lines) for c in point
                ]
                is_tip = p == len(layout.points) - 1
                blank = _without([each for each in found if each]) if is_tip else True
                for axis, (column, read) in enumerate(zip(point, found, strict=True)):
                    points[:, p, axis] = numbers(column, blank=blank, read=read)
        if layout.rotation is not None:
            points[~good] = 0.0
            points = points @ layout.rotation.T
        out: dict[str, NDArray[Any]] = {
            "tensions": tensions,
            "displacements": displacements,
            "points": points,
        }
        for name in ("bend", "direction", "sigma", "time"):
            if (one := getattr(layout, name)) is not None:
                out[name] = numbers(one, name)
        if layout.quaternion is not None:
            given = np.stack([numbers(each) for each in layout.quaternion], axis=1)
            size = np.linalg.norm(given, axis=1)
            no_rotation = good & ~(np.abs(size - 1.0) < _NO_ROTATION)
            for i in np.flatnonzero(no_rotation).tolist():
                why = f"the quaternion has the length {significant(float(size[i]))}, not 1"
                self.leave_out(lines[i], why)
            good &= ~no_rotation
            w, x, y, z = np.where(good, given.T / np.where(size > 0, size, 1.0), 0.0)
            across = 2.0 * (x * z + w * y), 2.0 * (y * z - w * x)
            out["bend"] = np.arctan2(np.hypot(*across), 1.0 - 2.0 * (x * x + y * y))
            out["direction"] = np.arctan2(across[1], across[0])
        repeat = numbers(layout.repeat, "repeat") if layout.repeat else np.ones(n)
        out["repeat"] = np.where(good, repeat, 0).astype(np.int64)
        label = layout.group or layout.recording
        labels = columns[label.index] if label and n else ()
        groups = [printable(cell.strip()) for cell in labels] or [""] * n
        for i, name in enumerate(groups):
            if len(name) > _LONGEST_LABEL:  # the array takes this for each row
                groups[i] = ""
                if good[i]:
                    why = f"its name of a group has {len(name)} characters"
                    self.leave_out(lines[i], f"{why}, up to {_LONGEST_LABEL} are read")
                good[i] = False
        out["group"] = np.array(groups, dtype=str)
        if layout.recording is not None:
            number = [self.recording(cell) for cell in columns[layout.recording.index]] if n else []
            out["recording"] = np.array(number, dtype=np.int64)
        if layout.label is not None and n:
            for line, cell in zip(lines, columns[layout.label.index], strict=True):
                if cell.strip() and len(self.labels) < _MOST_LABELS:
                    self.labels.setdefault(cell.strip(), line)
        out["line"] = np.array(lines, dtype=np.int64)
        out["key"] = np.fromiter(map(hash, zip(*columns, strict=True)), np.int64, n)
        return {name: array[good] for name, array in out.items()}

    def judge_tensions(self, tensions: Floats, lines: Ints) -> Bools:
        """Rows (K,) without a tension below zero; noise about zero is set to zero in place."""
        good = np.ones(len(lines), bool)
        zeros: list[tuple[str, float]] = []
        negated: list[str] = []
        most = float(np.ptp(np.nan_to_num(tensions), axis=0).max(initial=0.0))
        if not self.keep_below_zero and not (tensions < 0.0).any():
            return good
        for k, (kind, column) in enumerate(self.layout.tendons):
            readings = tensions[:, k]
            if kind != "tension" or column.constant is not None or column.part != "all":
                continue
            if self.pushes[k]:
                continue
            likely = channels.likely_zero(readings)
            zeros.append((column.name, column.reading(likely)))
            if np.ptp(readings) > _LOADED * most and channels.is_negated(readings):
                negated.append(column.name)
            # a fit finds the zero, not noise about it
            zero = likely if self.keep_below_zero and np.isfinite(likely) else 0.0
            if width := channels.noise_about_zero(readings - zero):
                # also those above zero, whose mean would be a bias
                noise = np.abs(readings - zero) <= width
                below = int((readings[noise] < zero).sum())
                text = (
                    f"{column.name}: {noise.sum()} readings within {significant(width, 2)} N of "
                    f"{column.reading(zero):.4g}, {below} of them below, are without load"
                )
                self.issues.append((int(lines[np.argmax(noise)]), text))
                if np.isnan(self.zero_error.get(column.name, 0.0)):
                    self.zero_error[column.name] = float(readings[noise].std())
                # to a fit without load, as long as the offset is within the noise
                tensions[noise, k] = zero - (width if self.keep_below_zero else 0.0)
            if self.keep_below_zero:
                continue
            bad = tensions[:, k] < 0.0
            self.below_zero += int((bad & good).sum())
            self.least_tension = min(self.least_tension, float(tensions[:, k].min()))
            for i in np.flatnonzero(bad & good):
                value = significant(column.reading(float(tensions[i, k])), 6)
                why = f"{column.name} is {value}; a tendon cannot push, give zero or more"
                self.leave_out(int(lines[i]), why)
            good &= ~bad
        if self.below_zero:
            self.likely_zeros, self.negated = tuple(zeros), tuple(negated)
        return good

    def find_faults(self, arrays: dict[str, Any]) -> Bools:
        """List spikes, saturated sensors and columns of a constant.

        Returns rows (K,) without a spike of a command. A point with a spike becomes NaN in place:
        the command of its row may be right, and is part of the path.
        """
        lines, layout = arrays["line"], self.layout
        good = np.ones(len(lines), bool)
        found: list[tuple[Column, str, Floats]] = [
            (column, kind, arrays[f"{kind}s"][:, k])
            for k, (kind, column) in enumerate(layout.tendons)
        ]
        points = arrays["points"]
        if layout.rotation is not None:  # back to the columns
            points = points @ layout.rotation
        found += [
            (column, "point", points[:, p, axis])
            for p, point in enumerate(layout.points)
            for axis, column in enumerate(point)
        ]
        alike = [
            [each for _, kind, each in found if kind == of] for of in {kind for _, kind, _ in found}
        ]
        for i, (column, kind, values) in enumerate(found):
            seen = np.isfinite(values)
            if column.constant is not None or column.part != "all" or not seen.any():
                continue
            seen_lines, readings = (lines, values) if seen.all() else (lines[seen], values[seen])
            if len(rows := channels.spikes(readings)):
                issues = [
                    (
                        int(seen_lines[i]),
                        f"{column.name} is {column.reading(float(readings[i])):.7g}, a spike",
                    )
                    for i in rows[:_MOST_ISSUES]
                ]
                line, text = issues[0]
                more = f" (the first of {len(rows)})" if len(rows) > 1 else ""
                if kind == "point":
                    self.issues += [(line, f"left out as a point: {text}") for line, text in issues]
                    point = (i - len(layout.tendons)) // 3
                    arrays["points"][np.flatnonzero(seen)[rows], point] = np.nan
                    cure = "the point is left out."
                else:
                    for where, what in issues:
                        if good[where == lines].all():
                            self.leave_out(where, what)
                    good[np.flatnonzero(seen)[rows]] = False
                    cure = "the row is left out."
                self.faults.append(f"In line {line} {text}{more} far from all other rows: {cure}")
            # a tendon without load stays at the least reading
            from_rest = kind == "tension" and not self.pushes[i]
            run = None if kind == "displacement" else channels.saturated(readings, from_rest)
            if run and not all(channels.rest([v[seen] for v in each], *run) for each in alike):
                begin, count = run
                value = column.reading(float(readings[begin]))
                line = int(seen_lines[begin])
                text = f"{column.name} stays at {value:.7g}, an end of its range, in {count} rows"
                self.issues.append((line, f"{text}; they are kept"))
                self.faults.append(
                    f"From line {line} {text} while others change: delete them if its sensor was "
                    "saturated."
                )
            value = float(readings[0])
            if value and len(readings) >= _MANY and (readings == value).all():
                text = f"{column.name} is {column.reading(value):.6g} in all rows: was it measured?"
                self.issues.append((int(lines[0]), text))
        return good

    def recording(self, cell: str) -> int:
        """Number of a recording, from 1, in the order of first appearance."""
        return self.recordings.setdefault(cell.strip(), len(self.recordings) + 1)

    def note_rows(self, lines: Ints, text: Callable[[int], str], last: int, more: str) -> None:
        """List the first of some rows by a text for each; line `last` has the number of others."""
        self.issues += [(line, text(k)) for k, line in enumerate(lines[:_MOST_ISSUES].tolist())]
        if len(lines) > _MOST_ISSUES:
            self.issues.append((last, f"{len(lines) - _MOST_ISSUES} more rows {more}"))

    def is_whole(self, row: Row) -> bool:
        """Whether a row has a cell for each column and fulfils `keep`."""
        line, cells = row
        if len(cells) < self.width or any(cell.strip() for cell in cells[self.width :]):
            text = f"it has {len(cells)} cells, the header has {self.width}"
            if self.table.separator == "," and len(cells) > self.width:
                text += "; with decimal commas, separate the cells by semicolons"
            self.leave_out(line, text)
            return False
        if self.layout.keep is not None:
            column, wanted = self.layout.keep
            cell = cells[column.index]
            if cell.strip() != wanted and cell_number(cell) != cell_number(wanted):  # 1 is 1.0
                self.filtered += 1
                self.leave_out(line, f"{column.name} is {quote(cell)}, not {quote(wanted)}")
                return False
        return True

    def cells(
        self, column: Column, columns: Sequence[Sequence[str]], lines: list[int]
    ) -> tuple[Sequence[str], Floats]:
        """Cells of a column, and their numbers: NaN for other text."""
        cells = columns[column.index] if columns else ()
        if column.instead:
            cells = self.first_measured(column, columns, lines)
        return cells, self.numbers(cells, lines, column)

    def first_measured(
        self, column: Column, columns: Sequence[Sequence[str]], lines: list[int]
    ) -> Sequence[str]:
        """First cell of each row that is not blank, of a column and those to be read instead."""
        out = []
        rows = zip(*(columns[each.index] for each in (column, *column.instead)), strict=True)
        for line, cells in zip(lines, rows, strict=bool(columns)):
            there = [cell for cell in cells if not is_missing(cell)]
            out.append(there[0] if there else cells[0])
            if len(there) > 1:
                count, first, name = self.doubled
                is_same = name == column.name
                if not count or is_same:
                    self.doubled = (count + 1, first or line, column.name)
        return out

    def times(
        self,
        column: Column,
        columns: Sequence[Sequence[str]],
        lines: list[int],
        read: tuple[Sequence[str], Floats],
    ) -> Floats:
        """Times of a column, and of those that are added to it, in s."""
        cells, values = read
        found = times(column, cells, None if column.dates else values, self.table.path, lines)
        if column.plus is None:
            return found
        more = self.cells(column.plus, columns, lines)
        return found + self.times(column.plus, columns, lines, more)

    def numbers(self, cells: Sequence[str], lines: list[int], column: Column) -> Floats:
        """Numbers of cells, NaN for other text and for what was not measured."""
        if column.dates:
            return np.full(len(cells), np.nan)
        if self.table.own is not None and column.index >= self.table.own:  # joined column
            return np.array([cell_number(cell) for cell in cells], dtype=float)
        text = "".join(cells)
        if "." in text and self.point is None:
            self.point = _first(cells, lines, ".", column.name)
        if "," in text and self.table.separator != ",":
            if self.comma is None:
                self.comma = _first(cells, lines, ",", column.name)
            if self.comma is not None and not self.comma_is_sure:
                self.comma_is_sure = any("," in c and not _THOUSANDS.fullmatch(c) for c in cells)
            cells = list(map(with_point, cells))
        if "_" not in text and text.isascii():  # float() accepts 1_000 and digits of other scripts
            try:
                values = np.array(list(map(float, cells)), dtype=float)
            except ValueError:
                pass
            else:
                values[not_measured(values)] = np.nan
                return values
        return np.array([cell_number(cell) for cell in cells], dtype=float)

    def shapes(self, cells: Sequence[str], lines: list[int], good: Bools) -> Floats:
        """Points (n, P, 3) from cells of JSON; the first valid row determines P."""
        column = self.layout.shape
        assert column is not None
        found: list[Floats | None] = []
        for i, cell in enumerate(cells):
            points = _shape(cell)
            count = 0 if points is None else len(points)
            if points is None:
                why = f"{column.name} is {quote(cell)}, it must be a list of points, [[x, y], ...]"
            elif count > _MOST_SHAPE_POINTS:
                why = f"{column.name} has {count} points, up to {_MOST_SHAPE_POINTS} are read"
                points = None
            elif not self.point_count:
                self.point_count = count
            elif count != self.point_count:
                why = f"{column.name} has {count} points, other rows {self.point_count}"
                points = None
            if points is None and good[i]:
                self.leave_out(lines[i], why)
            good[i] &= points is not None
            found.append(points)
        empty = np.full((self.point_count, 3), np.nan)
        stacked = np.array([empty if points is None else points for points in found])
        return column.factor * stacked.reshape(len(found), self.point_count, 3)

    def note_order(self, arrays: dict[str, Any]) -> None:
        """Warn if repeats or times show that the table was sorted, as rows form a path."""
        lines, runs = arrays["line"], arrays["repeat"]
        path = arrays.get("recording", np.ones_like(lines))
        anew = np.r_[True, path[1:] != path[:-1]]
        begins = anew | np.r_[True, runs[1:] != runs[:-1]]
        again = {
            "recording": _come_again(np.stack([path]), anew),
            "repeat": _come_again(np.stack([path, runs]), begins),
        }
        order = "rows must stand in the order in which they were measured"
        notes = [(rows, f"{what} comes again", order) for what, rows in again.items()]
        if "time" in arrays:
            assert self.layout.time is not None
            steps = np.r_[1.0, np.diff(arrays["time"])]
            name = self.layout.time.name
            back, same = (np.flatnonzero(found & ~anew) for found in (steps < 0, steps == 0))
            notes.append((back, f"time goes back in {name}", order))
            notes.append((same, f"{name} is the same as in the row before", "both are kept"))
        for rows, what, then in notes:
            if len(rows):
                times = f" (the first of {len(rows)} times)" if len(rows) > 1 else ""
                self.issues.append((int(lines[rows[0]]), f"{what}{times}: {then}"))

    def note_repeated_rows(self, lines: Ints, keys: Ints) -> None:
        _, first, place = np.unique(keys, return_index=True, return_inverse=True)
        first_of = first[place]
        again = np.flatnonzero(first_of != np.arange(len(keys)))
        if len(again):
            first_lines, last = lines[first_of[again]], int(lines[again[-1]])
            self.note_rows(
                lines[again],
                lambda k: f"the same, cell by cell, as line {first_lines[k]}; it is kept",
                last,
                "repeat earlier ones; they are kept",
            )


def _first(
    cells: Sequence[str], lines: Sequence[int], mark: str, name: str
) -> tuple[int, str] | None:
    """Line of the first number with a decimal mark, and the name of its column."""
    found = zip(lines, cells, strict=True)
    line = next((n for n, c in found if mark in c and not is_text(c)), None)
    return None if line is None else (line, name)


def _without(tip: Sequence[tuple[Sequence[str], Floats]]) -> Bools:
    """Rows without a measured tip: all coordinates blank, NaN or not measured."""
    out = np.asarray(np.isnan([values for _, values in tip]).all(axis=0))
    for i in np.flatnonzero(out).tolist():
        out[i] = all(is_missing(cells[i]) for cells, _ in tip)
    return out


def _come_again(labels: Ints, begins: Bools) -> Ints:
    """Rows that begin a block with the labels (of each kind, of each row) of an earlier block."""
    rows = np.flatnonzero(begins)
    _, first = np.unique(labels[:, rows], axis=1, return_index=True)
    return np.asarray(rows[np.setdiff1d(np.arange(len(rows)), first)])


# Rule for numbers of a kind, and end of the message if broken.
_RULES: Final[dict[str, tuple[Callable[[Floats], Bools], str]]] = {
    "sigma": (lambda si: si > 0, "; an uncertainty is above zero"),
    "repeat": (
        lambda si: (si == np.round(si)) & (np.abs(si) < 1e15),
        ", which is not a whole number",
    ),
}


def _part(values: Floats, column: Column) -> Floats:
    if column.part == "positive":
        return np.maximum(values, 0.0)
    return np.maximum(-values, 0.0) if column.part == "negative" else np.asarray(values)


def _reason(column: Column, cell: str, value: float, kind: str) -> str:
    if not cell.strip():
        return f"{column.name} is empty"
    if kind == "time" and not np.isfinite(value):
        plus = f", and {column.plus.name} is added" if column.plus else ""
        order = f" in the order {column.dates}" if column.dates not in ("", ISO) else ""
        return f"{column.name} is {quote(cell)}{plus}, which is no time{order}"
    if not np.isfinite(value) and is_missing(cell) and cell.strip()[-1].isdigit():
        return f"{column.name} is {quote(cell)}, which says that nothing was measured"
    if not np.isfinite(value):
        text = f"{column.name} is {quote(cell)}, which is not a finite number"
        if _DECIMAL_COMMA.fullmatch(cell):
            text += "; with decimal commas, separate the cells by semicolons"
        return text
    if abs(value) >= _LARGEST:
        return f"{column.name} is {quote(cell)}, which is too large"
    return f"{column.name} is {quote(cell)}{_RULES[kind][1]}"


def _shape(cell: str) -> Floats | None:
    """Points (n, 3) from a cell of JSON; points with two coordinates lie in z = 0."""
    try:
        array: Floats = structured(parsed(cell), json_files.Table)
    except ValueError:
        return None
    if len(array) < 2 or array.shape[1] not in (2, 3):
        return None
    points = np.zeros((len(array), 3))
    points[:, : array.shape[1]] = array
    return points


# -- writing -----------------------------------------------------------------------------------


def write_measurements(
    measurements: Measurements, path: str | Path, comments: Sequence[str] = ()
) -> Path:
    """Write measurements as CSV in the tidy format, with their source in the first line.

    Unless measured, the source is also in every row, because some programs drop comments.

    Parameters
    ----------
    measurements : Measurements
        Measurements to write.
    path : str or Path
        Path of the file, which is written whole or not at all. Only a file that this function
        wrote is replaced.
    comments : sequence of str
        Further lines above the header.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InputError
        If the format cannot represent the data, another file exists at the path, or it cannot be
        written.
    """
    path = Path(path)
    fill = partial(fill_table, m=measurements, comments=comments)
    write_whole_file(path, "table", fill, lambda: _check_table(path))
    return path


def fill_table(file: Path, m: Measurements, comments: Sequence[str]) -> None:
    """Write the content of a table as `write_measurements` does, over any other content.

    Raises
    ------
    OSError
        If it cannot be written.
    InputError
        If the format cannot represent the data.
    """
    both = ~(np.isnan(m.tensions).all(axis=0) | np.isnan(m.displacements).all(axis=0))
    if not m.tendon_count or both.any():
        why = "no tendon is actuated" if not m.tendon_count else "a tendon has two commands"
        raise InputError(f"{m.name} cannot be written as a table: {why}")
    with file.open("w", encoding="utf-8", newline="") as stream:
        _write_tidy(stream, m, comments)


def _check_table(path: Path) -> None:
    if path.exists() and not (path.is_file() and has_mark(path, f"# {_WRITTEN}".encode())):
        raise not_overwritten(f"cannot write the table to {path}")


def _write_tidy(file: TextIO, m: Measurements, comments: Sequence[str]) -> None:
    above = [f"source: {m.source}", f"name: {' '.join(m.name.split())}"]
    above.append(f"{_WRITTEN} {__version__}")
    if m.tool.any():
        above.append(f"tool: {' '.join(repr(round(1e3 * v, 9)) for v in m.tool.tolist())} mm")
    if m.stations is not None:
        above.append(f"stations: {' '.join(map(repr, m.stations.tolist()))}")
    above += [" ".join(line.split()) for line in comments]
    file.writelines(f"# {line}\n" for line in above)
    columns: dict[str, Any] = {}
    for k in range(m.tendon_count):
        if np.isnan(m.displacements[:, k]).all():
            columns[f"tension_{k + 1}_N"] = m.tensions[:, k]
        else:
            columns[f"displacement_{k + 1}_mm"] = _rounded(1e3 * m.displacements[:, k])
    unit, factor = ("px", 1.0) if m.scale is None else ("mm", 1e3)
    count = m.points.shape[1]
    for p in range(count):
        name = "tip" if p == count - 1 else f"point_{p + 1:02d}"
        for axis, letter in enumerate("xyz"):
            columns[f"{name}_{letter}_{unit}"] = _rounded(factor * m.points[:, p, axis])
    degrees = math.degrees(1)
    units = {"bend_deg": degrees, "direction_deg": degrees, "sigma_mm": 1e3, "time_s": 1.0}
    for name, factor in units.items():
        if (values := getattr(m, name.partition("_")[0])) is not None:
            columns[name] = _rounded(factor * values)
    columns["repeat"] = m.repeat
    if m.recording is not None:
        columns["recording"] = m.recording
    if (m.group != "").any():
        columns["group"] = m.group
    if m.source != "measured":
        columns["source"] = np.full(len(m), m.source)
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        writer.writerow("" if isinstance(v, float) and np.isnan(v) else v for v in row)


def _rounded(values: Floats) -> Floats:
    """Round to 1e-9, so that 0.1 + 0.2 mm is written as 0.3."""
    return np.round(values, 9)
