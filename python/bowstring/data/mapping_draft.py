"""Draft of a mapping file with the probable meaning of a table's columns.

A set of columns gets a meaning if at least two of its name, its unit and its numbers say so,
nothing contradicts and no other set fits as well. What is not decided is left out, with the reason
in a comment, so that reading by the draft asks for it.
"""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import islice, pairwise
from typing import Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.clock import DATES, ISO, AmbiguousDateError, is_time, seconds_of
from bowstring.data.header_detection import UNITS
from bowstring.data.tables import Form, Table, cell_number, is_name, with_point
from bowstring.robot.model import Robot
from bowstring.units import quote

_ENOUGH: Final = 2  # of name, unit and numbers
_CLEARLY: Final = 1.5  # ratio of the motion of two points of which one is the tip
_DAY: Final = 86_400  # s
_LARGEST: Final = 1e30  # larger numbers are none
#: Units of a tip, their scales, and the least motion over the robot's length that speaks for them:
#: small motions are measured in mm, and cm are seldom left unsaid.
_REACHES: Final = (("mm", 1e-3, 0.005), ("cm", 1e-2, 0.05), ("m", 1.0, 0.02))
_MOST_ROWS: Final = 3_000  # rows that are read
_MOST_COLUMNS: Final = 24  # of the others that are listed
_KINDS: Final = {
    "tension": ("tension", "force", "kraft", "newton", "loadcell"),
    "mass": ("mass", "load", "weight"),
    "displacement": (
        *("displacement", "disp", "pull", "servo", "motor", "tendon", "cable", "spool", "wire"),
        *("joint", "encoder"),
    ),
}
_SYMBOLS: Final = {"f": "tension", "l": "displacement", "dl": "displacement"}
_UNITS_OF: Final = {
    "tension": ("N", "mN", "kN", "kgf", "lbf"),
    "mass": ("kg", "g", "mg"),
    "displacement": ("mm", "cm", "m", "um", "inch"),
}
_LENGTHS: Final = _UNITS_OF["displacement"]
_TIMES: Final = ("s", "ms", "us", "ns", "min")
_OTHER_UNITS: Final = {
    **dict.fromkeys(("seconds", "second", "secs", "sec"), "s"),
    **dict.fromkeys(("milliseconds", "millis", "msec"), "ms"),
    **dict.fromkeys(("microseconds", "micros", "usec"), "us"),
    **dict.fromkeys(("nanoseconds", "nanosecs", "nanosec", "nsecs", "nsec"), "ns"),
    **{"µs": "us", "µm": "um", "in": "inch", "meters": "m", "millimeters": "mm", "°": "deg"},
}
_EPOCHS: Final = {"s": 1e9, "ms": 1e12, "us": 1e15, "ns": 1e18}  # 2001; fourfold, 2096
_CLOCKS: Final = (
    *("stamp", "timestamp", "time", "zeit", "t", "date", "datetime", "clock", "datum", "elapsed"),
    *("seconds", "secs", "sec", "millis", "micros", "milliseconds", "uhrzeit", "x_value"),
)
_TIP: Final = {"tip", "end", "ee", "effector", "tcp", "distal", "endeffector", "spitze"}
_POSITION: Final = {
    *("position", "pos", "translation", "marker", "coord", "pose", "point", "xyz", "tx", "px"),
}
_NO_POINT: Final = "fmavwrgbhuq"  # force, moment, velocity and others, with a letter of an axis
_NO_TIP: Final = {
    *("orientation", "rotation", "rot", "quat", "quaternion", "q", "angle", "euler", "roll", "yaw"),
    *("velocity", "vel", "linear", "angular", "twist", "acc", "accel", "acceleration", "gyro"),
    *("mag", "magnetic", "force", "torque", "moment", "wrench", "error", "base", "target", "goal"),
    *("reference", "ref", "desired", "des", "setpoint", "command", "commanded", "cmd"),
    *("covariance", "std", "sigma", "likelihood"),
}
_QUATERNION: Final = {
    *("q", "qw", "qx", "qy", "qz", "quat", "quaternion", "orientation", "rotation"),
}
_NO_COMMAND: Final = {
    *_NO_TIP
    - {"force", "target", "goal", "reference", "ref", "desired", "des", "setpoint"}
    - {"command", "commanded", "cmd", "linear"},
    *("seq", "frame", "face", "port", "state", "status", "index", "id", "tools", "markers"),
    *("valid", "quality", "temperature", "temp", "current", "voltage", "residual"),
    *("tip", "x", "y", "z"),
}
_ANGLES: Final = {"bend": ("bend", "theta"), "direction": ("direction", "phi", "plane")}


@dataclass
class _Column:
    """Column of a table with what its name, its unit and its cells say."""

    index: int
    name: str
    cells: list[str]
    below: list[str]
    has_comma: bool

    @cached_property
    def values(self) -> Floats:
        """Numbers of the cells, NaN for others."""
        cells = map(with_point, self.cells) if self.has_comma else self.cells
        values = np.array(list(map(cell_number, cells)), dtype=float)
        values[~(np.abs(values) < _LARGEST)] = np.nan
        return values

    @cached_property
    def words(self) -> list[str]:
        """Words of the name, without its unit."""
        if self.name == "X_Value":  # the time in files of LabVIEW
            return ["x_value"]
        text = re.sub(r"[\[(].*?[\])]", " ", self.name)
        parts = re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[äöüß]+", text)
        return [part.lower() for part in parts]

    @cached_property
    def unit(self) -> str | None:
        """Unit in brackets or at the end of the name, or from a row of units."""
        inside = re.findall(r"[\[(]\s*([^\[\]()]+?)\s*[\])]", self.name)
        end = re.findall(r"(?<=[_ ./])([A-Za-zµ°]+)$", self.name)
        for text in (*inside, *self.below, *end):
            unit = _OTHER_UNITS.get(text.lower(), _OTHER_UNITS.get(text, text))
            if unit in UNITS and not unit.isdigit() and unit != "-":
                return str(unit)
        return None

    @property
    def known(self) -> Floats:
        return self.values[np.isfinite(self.values)]

    @property
    def is_constant(self) -> bool:
        """Whether it has several numbers, all equal."""
        return len(self.known) > 1 and bool(np.ptp(self.known) == 0)

    @property
    def is_counter(self) -> bool:
        """Whether it counts rows."""
        return len(self.known) > 2 and bool((np.diff(self.known) == 1).all())


@dataclass
class _Point:
    """Three columns that may be coordinates of the tip."""

    columns: tuple[_Column, _Column, _Column]
    score: int
    words: list[str] = field(default_factory=list)

    @cached_property
    def values(self) -> Floats:
        return np.stack([column.values for column in self.columns], axis=1)

    @cached_property
    def motion(self) -> float:
        """Largest range of a coordinate."""
        seen = self.values[np.isfinite(self.values).all(axis=1)]
        return float(np.ptp(seen, axis=0).max()) if len(seen) else 0.0

    @property
    def unit(self) -> str | None:
        return next((column.unit for column in self.columns if column.unit), None)


def draft(tables: Sequence[Table], robot: Robot | None = None) -> str:
    """Write a mapping file for a table.

    Parameters
    ----------
    tables : sequence of Table
        Table with its header; of several tables of one file, the first one with a tip is the table
        of the mapping, and one with commands is joined. Their rows are used up.
    robot : Robot, optional
        Robot, of which the numbers of a table tell its units.

    Returns
    -------
    str
        YAML with comments at lines to be checked, and on what is not decided.
    """
    found = [_Draft(table, robot) for table in tables]
    main = next((each for each in found if each.tip), found[0])
    others = [each for each in found if each is not main and each.commands]
    return main.text(others[0] if others and not main.commands else None)


class _Draft:
    """Meaning of the columns of one table."""

    def __init__(self, table: Table, robot: Robot | None) -> None:
        self.table, self.robot = table, robot
        self.remarks: list[tuple[str, str]] = []  # subject, and what is not decided of it
        rows = [cells for _, cells in islice(table.rows, _MOST_ROWS)]
        cells = list(zip(*(_padded(row, len(table.header)) for row in rows), strict=True))
        below = [_padded(row, len(table.header)) for row in table.below]
        self.columns = [
            _Column(
                i,
                name,
                list(cells[i]) if cells else [],
                [row[i].strip("[]() ") for row in below],
                table.separator != ",",
            )
            for i, name in enumerate(table.header)
            if is_name(name) and name.lower() not in ("~", "null")
        ]
        self.used: dict[str, str] = {}
        self.is_motive = table.length_unit is not None
        self.time = "" if self.is_motive else self.clock()
        self.rotation: list[_Column] = []
        self.quaternions()
        self.tip = self.find_tip()
        self.tip_unit = table.length_unit or (self.length_unit(self.tip) if self.tip else None)
        self.angles = {} if self.tip or self.is_motive else self.find_angles()
        if self.angles or self.rotation:
            self.remarks = [item for item in self.remarks if item[0] != "tip"]
        self.quantity, self.command_unit = "tension", ""
        self.commands: list[_Column] = [] if self.is_motive else self.find_commands()

    # -- output --

    def text(self, log: _Draft | None) -> str:
        """Mapping file; `log` is a table of the same file with the commands."""
        lines = ["source: measured        # measured, synthetic or computed"]
        if form := _form(self.table.form):
            lines.append(f"table: {form}")
        commands, remarks = log or self, self.remarks
        lines += commands.tendon_lines()
        lines += self.tip_lines()
        if self.time:
            lines.append(f"time: {self.time}")
        if self.is_motive:
            lines += [
                "frame: {axes: [z, x, y]}   # the measuring frame's x, y and z in the file's axes",
                "join:                      # the log of the tendons' actuation, by time",
                "  file: forces.csv         # beside the export",
                "  time: {column: time, unit: s}",
                "  shift: 0 s               # added to its times",
            ]
        elif log is not None:
            lines += [
                f"join:                      # {log.table.form.block} of the same file, by time",
                f"  file: {_text(self.table.path.name)}",
                f"  table: {_form(log.table.form)}",
                *([f"  time: {log.time}"] if log.time else []),
            ]
            remarks = [item for item in self.remarks if item[0] != "commands"]
            remarks += [item for item in log.remarks if item[0] != "tip"]
        elif not self.commands:
            lines += [
                "# join: {file: log.csv, time: {column: time, unit: s}}   # where a log has them",
            ]
        lines += [f"# not decided: {text}" for _, text in remarks]
        unused = [_text(c.name) for c in self.columns if c.name not in self.used]
        if unused and not self.is_motive:
            more = ", ..." if len(unused) > _MOST_COLUMNS else ""
            lines.append(f"# other columns: {', '.join(unused[:_MOST_COLUMNS])}{more}")
        return "\n".join(lines) + "\n"

    def tendon_lines(self) -> list[str]:
        count = self.tendon_count
        if self.is_motive:  # they are in the joined log
            cells = [_text(f"tension_{i}") for i in range(1, 1 + (count or 3))]
            unit = "N"
        else:
            cells, unit = self.command_cells(), self.command_unit
        if not cells:
            return []
        said = f"  unit: {unit:<14}   # or a scale, such as 0.1 N"
        return [
            "tendons:",
            f"  quantity: {self.quantity:<10}   # mass, tension or displacement",
            *([said] if unit else []),
            f"  columns: [{', '.join(cells)}]   # in the order of the robot's tendons; 0: no load",
        ]

    def command_cells(self) -> list[str]:
        """Columns in the order of the robot's tendons, with 0 for tendons without one."""
        cells = [_text(column.name) for column in self.commands]
        count = self.tendon_count
        if not cells or count is None or len(cells) >= count:
            return cells
        numbers = [_number(column.name)[1] for column in self.commands]
        places = [number - 1 if number else -1 for number in numbers]
        if len(set(places)) < len(cells) or not all(0 <= place < count for place in places):
            places = list(range(len(cells)))
        out = ["0"] * count
        for place, cell in zip(places, cells, strict=True):
            out[place] = cell
        return out

    def tip_lines(self) -> list[str]:
        if self.angles:
            fields = ", ".join(f"{key}: {_text(c.name)}" for key, c in self.angles.items())
            unit = next(c.unit or "deg" for c in self.angles.values())
            return [f"angles: {{{fields}, unit: {unit}}}   # and of what tips there are: tip"]
        if self.tip is None and self.rotation:
            cells = ", ".join(_text(c.name) for c in self.rotation)
            return [f"angles: {{quaternion: [{cells}]}}   # w, x, y and z"]
        if self.tip is None:
            return []
        if self.is_motive:
            names = [_body(point) for point in self.tip]
            cells = ", ".join(map(_text, names))
            others = ", ".join(quote(_body(point)) for point in self.points[:12])
            shown = cells if len(names) == 1 else f"[{cells}]"
            return [f"tip: {{name: {shown}}}   # of {others}"]
        cells = ", ".join(_text(column.name) for column in self.tip[0].columns)
        unit = f", unit: {self.tip_unit}" if self.tip_unit else ""
        return [f"tip: {{columns: [{cells}]{unit}}}   # of x, y and z"]

    def remark(self, subject: str, text: str) -> None:
        self.remarks.append((subject, text))

    @property
    def tendon_count(self) -> int | None:
        return None if self.robot is None else len(self.robot.tendons.angle_rad)

    @property
    def free(self) -> list[_Column]:
        """Columns without a meaning as yet."""
        return [column for column in self.columns if column.name not in self.used]

    def use(self, columns: Sequence[_Column], meaning: str) -> None:
        self.used.update((column.name, meaning) for column in columns)

    # -- time --

    def clock(self) -> str:
        """Fields of the time, in YAML; empty if there is none."""
        dates = [c for c in self.columns if _times_in(c)]
        named = [
            c
            for c in self.columns
            if set(c.words) & set(_CLOCKS) and len(c.known) and not c.is_constant
        ]  # fmt: skip
        named.sort(key=lambda c: (not {"stamp", "timestamp"} & set(c.words), c.index))
        if dates and (found := self.dates(dates)):
            return found
        for column in named:
            if (np.diff(column.known) < 0).any() and len(named) > 1:
                continue
            if unit := self.time_unit(column):
                fraction = next(
                    (c for c in self.columns if c.unit == "ns" and c is not column), None
                )
                self.use([column], "time")
                plus = ""
                if fraction is not None and unit == "s" and (fraction.known < 1e9).all():
                    self.use([fraction], "time")
                    plus = f", plus: {{column: {_text(fraction.name)}, unit: ns}}"
                return f"{{column: {_text(column.name)}, unit: {unit}{plus}}}"
            self.use([column], "time")
            self.remark(
                "time",
                f"the unit of {quote(column.name)}; if it is the time, write for example time: "
                f"{{column: {_text(column.name)}, unit: ms}}",
            )
            return ""
        named_all = [c for c in self.columns if set(c.words) & set(_CLOCKS) and c.cells]
        if found := self.frames():
            return found
        if named_all and not self.remarks:
            name = quote(named_all[0].name)
            self.remark("time", f"the time: {name} does not advance, or is no time that is read")
        return ""

    def dates(self, columns: Sequence[_Column]) -> str:
        """Time from text: dates with a time of day, a date and a clock, clocks, or durations."""
        self.use(columns, "time")
        orders = [_order(_times_in(column)) for column in columns]
        if "" in orders:
            name = columns[orders.index("")].name
            self.remark(
                "time",
                f"whether the day or the month is first in {quote(name)}; write time: {{column: "
                f"{_text(name)}, unit: d/m/y}} or unit: m/d/y",
            )
            return ""
        days, clock = "", ""
        for column, order in zip(columns, orders, strict=True):
            said = f"column: {_text(column.name)}, unit: {order}"
            seconds = [seconds_of(cell, order) for cell in _times_in(column)]
            if any(":" in cell for cell in column.cells) or any(t % _DAY for t in seconds):
                if not clock:
                    clock, has_date = said, max(seconds) >= _DAY
            else:
                days = days or said
        if not clock:
            return ""
        return f"{{{days}, plus: {{{clock}}}}}" if days and not has_date else f"{{{clock}}}"

    def time_unit(self, column: _Column) -> str | None:
        """Unit of a column of times: stated, or from size, rate and resolution of its numbers."""
        if column.unit in _TIMES:
            return column.unit
        for word in column.words:
            if (found := _OTHER_UNITS.get(word)) in _TIMES:
                return found
        if column.words == ["x_value"]:
            return "s"
        size = float(np.median(np.abs(column.known)))
        steps = np.diff(column.known)
        step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
        for unit, least in _EPOCHS.items():
            if least <= size < 4 * least:
                return unit
        if (4e4 < size < 6e4 or 7.2e5 < size < 7.6e5) and 0 < step < 0.5:
            return "day"  # serial dates of spreadsheets and MATLAB
        if self.table.rate and step:
            scales = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
            for unit, scale in scales.items():
                if abs(step * scale * self.table.rate - 1) < 0.02:
                    return unit
        return "s" if 0 < step <= 0.5 else None

    def frames(self) -> str:
        """Time from the numbers of frames, and sub-frames, of a known rate."""
        frame = next((c for c in self.columns if c.words[:1] == ["frame"] and len(c.known)), None)
        if frame is None:
            return ""
        self.use([frame], "time")
        sub = next((c for c in self.columns if c.words[:2] == ["sub", "frame"]), None)
        if not self.table.rate:
            self.remark(
                "time",
                f"the rate of {quote(frame.name)}; at 40 frames a second write time: {{column: "
                f"{_text(frame.name)}, unit: 25 ms}}",
            )
            return ""
        count, plus = 1, ""
        if sub is not None and len(sub.known):
            self.use([sub], "time")
            count = 1 + int(sub.known.max())
        if count > 1 and sub is not None:
            unit = f"{1e3 / self.table.rate:.10g} ms"
            plus = f", plus: {{column: {_text(sub.name)}, unit: {unit}}}"
        unit = f"{1e3 * count / self.table.rate:.10g} ms"
        return f"{{column: {_text(frame.name)}, unit: {unit}{plus}}}"

    # -- tip --

    def quaternions(self) -> None:
        """Set aside columns that are a unit quaternion, by their norm."""
        free = self.free
        for i in range(len(free) - 3):
            four = free[i : i + 4]
            if any(column.name in self.used for column in four):
                continue
            values = np.stack([column.values for column in four], axis=1)
            norms = np.linalg.norm(values[np.isfinite(values).all(axis=1)], axis=1)
            ordered = _w_first(four)
            is_named = bool(ordered) or all(_QUATERNION & set(column.words) for column in four)
            moves = any(len(c.known) > 4 and not c.is_constant for c in four)
            enough = len(norms) and (is_named or moves)
            if enough and (np.abs(norms - 1) < (0.05 if ordered else 5e-3)).mean() > 0.9:
                self.use(four, "quaternion")
                self.rotation = self.rotation or ordered

    def find_tip(self) -> list[_Point] | None:
        """Point that is the tip; several where a marker changes its name."""
        self.points = [p for p in self.all_points() if p.score > 0]
        best = max((p.score for p in self.points), default=0)
        if best < _ENOUGH:
            if self.points:
                names = ", ".join(quote(c.name) for c in self.points[0].columns)
                self.remark(
                    "tip", f"the tip: {names} may be it, but neither unit nor range says so"
                )
            else:
                self.remark("tip", "the tip: no three columns look like coordinates that move")
            return None
        first = [p for p in self.points if p.score == best]
        chain = _chain(first)
        if len(first) > 1 and not chain:
            by_motion = sorted(first, key=lambda p: -p.motion)
            if by_motion[0].motion >= _CLEARLY * by_motion[1].motion > 0:
                first = by_motion[:1]
        if len(first) > 1 and not chain:
            names = ", ".join(quote(p.columns[0].name) for p in first[:6])
            self.remark("tip", f"which point is the tip, of those of {names}")
            return None
        for point in first:
            self.use(point.columns, "tip")
        return chain or first

    def all_points(self) -> Iterator[_Point]:
        by_name = {column.name: column for column in self.free}
        seen: set[str] = set()
        for column in self.free:
            for match in re.finditer("[xX]", column.name):
                names = [
                    column.name[: match.start()] + letter + column.name[match.end() :]
                    for letter in ("xyz" if match[0] == "x" else "XYZ")
                ]
                if all(name in by_name for name in names):
                    three = [by_name[name] for name in names]
                    if not seen & {c.name for c in three}:
                        seen |= {c.name for c in three}
                        yield self.point(three)
        for stem, numbered in _families(self.free).items():
            words = {word for _, column in numbered for word in column.words}
            if len(numbered) == 3 and words & (_TIP | _POSITION) and stem:
                three = [column for _, column in numbered]
                if not _sums_to_zero(np.stack([c.values for c in three], axis=1)):
                    yield self.point(three)

    def point(self, columns: Sequence[_Column]) -> _Point:
        """Coordinates with the number of reasons for them: 0 if something contradicts."""
        x, y, z = columns
        words = [word for column in columns for word in column.words]
        found = _Point((x, y, z), 0, words)
        units = {column.unit for column in columns} - {None}
        seen = np.atleast_1d(np.isfinite(found.values).all(axis=1))
        moves = found.motion > 0
        if self.is_motive:
            is_marker = ":" in x.name and any(
                other.name.startswith(x.name.split(":")[0] + " Position") for other in self.columns
            )
            if "rotation" in words or is_marker or not seen.any():
                return found
            found.score = 2 + ("tip" in words) + ("unlabeled" not in words)
            return found
        letters = next((word for word in words if "x" in word), "")
        if len(letters) == 2 and letters[0] in _NO_POINT:
            return found
        if set(words) & _NO_TIP or (units and not units & set(_LENGTHS)):
            return found
        if len(seen) and (not seen.any() or (seen.sum() > 1 and not moves)):
            return found
        name = 3 if set(words) & _TIP else 1 + bool({*words, letters} & _POSITION)
        reach = not units and moves and self.fitting_units(found) != []
        found.score = name + bool(units) + int(moves and (bool(units) or reach))
        return found

    def fitting_units(self, point: _Point) -> list[str]:
        """Units in which the motion of a point is that of the robot's tip."""
        if self.robot is None:
            return ["mm"] if point.motion > 5 else ["m", "mm"]
        length, fits = self.robot.length, []
        for unit, scale, least in _REACHES:
            if least <= point.motion * scale / length <= 2.2:
                fits.append((unit, scale))
        middle = float(np.nanmedian(np.linalg.norm(point.values, axis=1)))
        near = [unit for unit, scale in fits if 0.5 < middle * scale / length < 1.1]
        return near if len(near) == 1 else [unit for unit, _ in fits]

    def length_unit(self, points: Sequence[_Point]) -> str | None:
        """Unit of the tip: stated, that of ROS, or the only one in which its motion fits."""
        point = points[0]
        if point.unit:
            return point.unit
        fits = self.fitting_units(point) if point.motion else []
        if re.search(r"(position|translation)[._/]x$", point.columns[0].name):
            return "m"
        if len(fits) == 1:
            return fits[0]
        self.remark(
            "tip",
            "the unit of the tip: the table does not state it, and its motion fits "
            f"{' and '.join(fits) or 'none'}; write unit: mm, or what it is, beside columns",
        )
        return None

    def find_angles(self) -> dict[str, _Column]:
        """Columns of angle and direction of bending; empty without the former."""
        found: dict[str, _Column] = {}
        for key, words in _ANGLES.items():
            column = next(
                (c for c in self.free if any(w.startswith(words) for w in c.words)
                 and (c.unit in ("deg", "rad") or (np.abs(c.known) > 7).any())),
                None,
            )  # fmt: skip
            if column is not None:
                found[key] = column
        found = found if "bend" in found else {}
        self.use(list(found.values()), "angles")
        return found

    # -- commands --

    def find_commands(self) -> list[_Column]:
        """Columns of the tendons' commands, and their quantity and unit."""
        ranked = []
        for numbered in _families(self.free).values():
            columns = [column for _, column in numbered]
            if kind := self.kind(columns):
                ranked.append((kind[1], -list(_KINDS).index(kind[0]), kind[0], columns))
        ranked.sort(key=lambda item: item[:2], reverse=True)
        if not ranked or ranked[0][0] < _ENOUGH:
            self.remark("commands", "the commands of the tendons: no columns look like them")
            return []
        score, _, self.quantity, columns = ranked[0]
        again = [item for item in ranked[1:] if item[0] == score and item[2] == self.quantity]
        alone = all(len(each) == 1 for each in (columns, *(item[3] for item in again)))
        if again and alone:  # without numbers in their names
            columns = sorted(
                columns + [c for item in again for c in item[3]], key=lambda c: c.index
            )
        elif again:
            names = ", ".join(quote(item[3][0].name) for item in ranked[: 1 + len(again)])
            self.remark("commands", f"which columns command the tendons: those of {names}")
            return []
        count = self.tendon_count
        if count is not None and len(columns) > count:
            names = ", ".join(quote(column.name) for column in columns[:6])
            self.remark(
                "commands",
                f"which of {names} command the {count} tendons: there are {len(columns)}",
            )
            return []
        by_file = sorted(columns, key=lambda c: c.index)
        # programs write the order of the alphabet, 10 before 2; any other was somebody's choice
        if by_file not in (columns, sorted(columns, key=lambda c: c.name)):
            columns = by_file
            self.remark(
                "commands",
                "the order of the tendons: the columns stand in another order than their numbers; "
                "write them in the order of the robot's tendons",
            )
        self.use(columns, "command")
        self.command_unit = self.unit_of_commands(columns) or ""
        if not self.command_unit:
            self.remark(
                "commands",
                f"the unit of {quote(columns[0].name)}; write it as unit: below quantity",
            )
        values = np.stack([column.values for column in columns], axis=1)
        if self.quantity != "displacement" and np.nanmin(values, initial=0.0) < 0:
            self.remark(
                "commands",
                f"what a {self.quantity} below zero means: sign: -1, part: positive or a zero",
            )
        return columns

    def kind(self, columns: Sequence[_Column]) -> tuple[str, int] | None:
        """Quantity of columns and the number of reasons for it; None if something contradicts."""
        words = {word for column in columns for word in column.words}
        units = {column.unit for column in columns} - {None}
        has_rows = any(len(column.cells) for column in columns)
        if words & _NO_COMMAND:
            return None
        if has_rows and not all(len(c.known) for c in columns):
            return None
        of_unit = next((k for k, us in _UNITS_OF.items() if units & set(us)), None)
        if units and of_unit is None:
            return None
        by_word = {
            k: any(word.startswith(starts) or _SYMBOLS.get(word) == k for word in words)
            for k, starts in _KINDS.items()
        }
        values = np.stack([column.values for column in columns], axis=1)
        is_all = self.tendon_count == len(columns) > 1
        zero_sum = is_all and self.sums_to_zero(values)
        kind = of_unit or next((k for k, said in by_word.items() if said), None)
        if kind is None and zero_sum and not any(column.is_counter for column in columns):
            kind = "displacement"
        if kind is None:
            return None
        score = 2 * (of_unit in ("tension", "mass")) + (of_unit == "displacement")
        score += any(by_word.values()) + is_all + (zero_sum and kind == "displacement")
        return kind, score

    def sums_to_zero(self, values: Floats) -> bool:
        """Whether the numbers sum to zero in each segment, as displacements of tendons do."""
        assert self.robot is not None
        segments = self.robot.tendons.segment
        return all(_sums_to_zero(values[:, segments == s]) for s in np.unique(segments))

    def unit_of_commands(self, columns: Sequence[_Column]) -> str | None:
        """Unit: stated, or the only one in which displacements bend the robot as its tip moves."""
        stated = next((column.unit for column in columns if column.unit), None)
        if stated or self.quantity != "displacement" or self.robot is None:
            return stated
        values = np.stack([column.values for column in columns], axis=1)
        arm = float(np.median(self.robot.tendons.pitch_radius_m))
        bend = float(np.nanmax(np.abs(values), initial=0.0)) / arm
        scales = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
        if self.tip and self.tip_unit in scales:
            moved = self.tip[0].motion * scales[self.tip_unit] / self.robot.length
            fits = [u for u, s in scales.items() if 0.25 * moved < bend * s < 3 * moved]
        else:
            fits = [u for u, s in scales.items() if 0.02 < bend * s < 2 * math.pi]
        return fits[0] if len(fits) == 1 else None


def _padded(cells: Sequence[str], width: int) -> list[str]:
    return [*cells[:width], *[""] * (width - len(cells))]


def _form(form: Form) -> str:
    """Form in YAML, without what is usual."""
    fields: dict[str, Any] = form.model_dump(exclude_defaults=True)
    parts = []
    for key, value in fields.items():
        if isinstance(value, tuple):
            parts.append(f"{key}: [{', '.join(map(_text, value))}]")
        else:
            parts.append(f"{key}: {_text(value) if key == 'block' else value}")
    return f"{{{', '.join(parts)}}}" if parts else ""


def _text(name: str) -> str:
    return json.dumps(name, ensure_ascii=False)


def _body(point: _Point) -> str:
    return point.columns[0].name.removesuffix(" Position X")


def _number(name: str) -> tuple[str, int | None]:
    """Name with its last number replaced, and the number."""
    plain = re.sub(r"[\[(].*?[\])]", "", name)
    found = list(re.finditer(r"[0-9]+", plain))
    if not found:
        return name, None
    last = found[-1]
    return plain[: last.start()] + "#" + plain[last.end() :], int(last[0])


def _families(columns: Sequence[_Column]) -> dict[str, list[tuple[int, _Column]]]:
    """Columns whose names differ in their last number only, in the order of these numbers."""
    out: dict[str, list[tuple[int, _Column]]] = defaultdict(list)
    for column in columns:
        stem, number = _number(column.name)
        out[stem].append((number or 0, column))
    return {stem: sorted(each, key=lambda item: item[0]) for stem, each in out.items()}


def _sums_to_zero(values: Floats) -> bool:
    if values.shape[1] < 2:
        return False
    sums, sizes = np.abs(values.sum(axis=1)), np.abs(values).max(axis=1)
    known = np.isfinite(sums) & (sizes > 0)
    return bool(known.sum() >= 3 and (sums[known] < 0.02 * sizes[known].max()).mean() > 0.95)


def _w_first(four: Sequence[_Column]) -> list[_Column]:
    """Columns of a quaternion as w, x, y and z, by the letter in which their names differ."""
    for column in four:
        for match in re.finditer(r"[wW](?![A-Za-z])", column.name):
            letters = "wxyz" if match[0] == "w" else "WXYZ"
            names = [column.name[: match.start()] + x + column.name[match.end() :] for x in letters]
            by_name = {each.name: each for each in four}
            if set(names) == set(by_name):
                return [by_name[name] for name in names]
    return []


def _chain(points: Sequence[_Point]) -> list[_Point]:
    """Points of which each is seen only after the one before; empty if two are seen at once."""
    seen = [np.flatnonzero(np.isfinite(point.values).all(axis=1)) for point in points]
    if len(points) < 2 or not all(len(rows) for rows in seen):
        return []
    order = sorted(range(len(points)), key=lambda i: int(seen[i][0]))
    apart = all(seen[a][-1] < seen[b][0] for a, b in pairwise(order))
    return [points[i] for i in order] if apart else []


def _times_in(column: _Column) -> list[str]:
    """Cells with dates, clock times or durations; empty if they are less than most."""
    cells = [cell for cell in column.cells if cell.strip()]
    if len(column.known) or not cells:
        return []
    found = list(filter(is_time, cells))
    return found if len(found) > 0.8 * len(cells) else []


def _order(cells: Sequence[str]) -> str:
    """Unit of dates; empty if day and month may be exchanged in all of them."""
    fits = []
    for order in DATES:
        try:
            if all(math.isfinite(seconds_of(cell, order)) for cell in cells):
                fits.append(order)
        except AmbiguousDateError:
            continue
    return fits[0] if fits and (fits[0] == ISO or len(fits) == 1) else ""
