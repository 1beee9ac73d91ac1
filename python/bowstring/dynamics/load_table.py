"""Read the actuation of the tendons, or the motion of the base, over time from a CSV file."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import numpy as np

from bowstring.dynamics.base_motion import BaseMotion
from bowstring.dynamics.load_history import CLOSEST, Table
from bowstring.errors import InputError
from bowstring.files.atomic_io import readable
from bowstring.robot.model import Robot
from bowstring.units import quote, read_number

_Rows = Iterator[tuple[str, list[str]]]

_LARGEST: Final = 100_000_000  # bytes
_LONG: Final = 100  # characters of the name of a column
_KINDS: Final = {
    "tension": ("tensions", "N"),
    "displacement": ("displacements", "m"),
    "angle": ("angles", "rad"),
}
_POSES: Final = {"position": "m", "rotation": "rad"}
_POSE: Final = "t_s,position_x_mm,position_y_mm,position_z_mm,rotation_x_deg,..."


def read_actuation(path: str | Path, robot: Robot) -> dict[str, Table]:
    """Read a table of tensions, displacements and motor angles over time.

    Parameters
    ----------
    path : str or Path
        CSV file with a header: ``t_s`` and for each tendon, in any order, one of ``tension_1_N``,
        ``displacement_1_mm`` and ``angle_1_deg``, each with its unit at the end (``t_ms``,
        ``tension_2_mN``). One row per time follows; times do not decrease, and the same time twice
        is a jump. Empty lines and lines that begin with # are skipped.
    robot : Robot

    Returns
    -------
    dict from name to Table
        ``tensions``, ``displacements`` and ``angles`` for `bowstring.Load`; absent kinds are left
        out.

    Raises
    ------
    InputError
        If the file cannot be read or a value is wrong; the message names file and line.
    """
    count = len(robot.tendons.end_disk)
    here, header, rows = _opened(Path(path), _wanted(count))
    columns, kinds = _columns(here, header, count)
    times: list[float] = []
    values: list[list[float]] = []
    for here, (time, *given) in _numbers(header, rows, columns):
        for i, value in enumerate(given):
            if value < robot.tendons.least_tension_N[i] and kinds[i] == "tension":
                raise InputError(
                    f"{here}: the tension of tendon {i + 1} is {value:g} N; a tendon cannot push, "
                    "give zero or more"
                )
        if not times and time < 0:
            raise InputError(f"{here}: the first time is {time:g} s; a run begins at 0")
        if times and time < times[-1]:
            raise InputError(
                f"{here}: the time is {time:g} s after {times[-1]:g} s; times must not decrease"
            )
        if len(times) > 1 and time == times[-2]:
            raise InputError(f"{here}: the time {time:g} s is there three times; a jump takes two")
        if times and 0 < time - times[-1] < CLOSEST:
            raise InputError(
                f"{here}: the time {time:g} s is {time - times[-1]:.2g} s after the one before, "
                "which is below numerical resolution; give the same time twice for a jump, else "
                f"{CLOSEST:g} s or more"
            )
        times.append(time)
        values.append(given)
    if not times:
        raise InputError(f"{path}: there is no row of numbers below the header")
    if times[-1] == 0:
        raise InputError(f"{path}: the last time is 0 s; a run takes some time")
    table = np.array(values)
    found = {}
    for kind, (name, _) in _KINDS.items():
        mine = np.array([k == kind for k in kinds])
        if mine.any():
            found[name] = Table(times, np.where(mine, table, np.nan))
    return found


def read_base_motion(path: str | Path) -> BaseMotion:
    """Read a table of poses of the base over time.

    Parameters
    ----------
    path : str or Path
        CSV file with a header: ``t_s``; for the position of the base's origin ``position_x_mm``,
        ``position_y_mm`` and ``position_z_mm``; for its rotation vector, base to world,
        ``rotation_x_deg``, ``rotation_y_deg`` and ``rotation_z_deg``. The order is free, each
        column has its unit at the end (``t_ms``, ``rotation_x_rad``), and the three columns of
        position or rotation may be left out. One row per time follows; the first time is 0, and
        times increase. Empty lines and lines that begin with # are skipped.

    Returns
    -------
    BaseMotion
        Motion for ``base`` of `bowstring.Load`.

    Raises
    ------
    InputError
        If the file cannot be read or a value is wrong; the message names file and line.
    """
    here, header, rows = _opened(Path(path), f"write the header {_POSE}")
    columns = _pose_columns(here, header)
    times: list[float] = []
    values: list[list[float]] = []
    for here, (time, *pose) in _numbers(header, rows, columns.values()):
        if not times and time != 0:
            raise InputError(f"{here}: the first time is {time:g} s; a run begins at 0")
        if times and time < times[-1] + CLOSEST:
            raise InputError(
                f"{here}: the time is {time:g} s after {times[-1]:g} s; times must increase, as a "
                "base does not jump"
            )
        times.append(time)
        values.append(pose)
    if len(times) < 2:
        raise InputError(f"{path}: a motion needs poses at two times or more")
    poses = dict(zip(list(columns)[1:], np.array(values).T, strict=True))
    given = {
        kind: np.stack([poses[f"{kind}_{axis}"] for axis in "xyz"], axis=1)
        for kind in _POSES
        if f"{kind}_x" in poses
    }
    try:
        return BaseMotion(times, given.get("position"), given.get("rotation"))
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _pose_columns(here: str, header: list[str]) -> dict[str, tuple[int, float]]:
    """Index and factor to SI of the columns of time, position and rotation that are there."""
    if any(";" in name for name in header):
        raise InputError(f"{here}: columns are separated by commas, numbers have a point")
    found: dict[str, tuple[int, float]] = {}
    for i, name in enumerate(header):
        match = re.fullmatch(r"(t|(position|rotation)_[xyz])_(.+)", name)
        if match is None or len(name) > _LONG:
            raise InputError(
                f"{here}: {quote(name)} is no column of poses; write the header {_POSE}"
            )
        column, kind, unit = match.groups()
        if column in found:
            raise InputError(f"{here}: {name} is there twice, as {header[found[column][0]]}")
        try:
            found[column] = (i, read_number(f"1 {unit}", _POSES.get(kind, "s")))
        except ValueError as error:
            raise InputError(f"{here}: got {name}, {error}") from None
    if "t" not in found:
        raise InputError(f"{here}: there is no column t_s; write the header {_POSE}")
    for kind, unit in (("position", "mm"), ("rotation", "deg")):
        missing = [axis for axis in "xyz" if f"{kind}_{axis}" not in found]
        if 0 < len(missing) < 3:
            raise InputError(
                f"{here}: there is no column {kind}_{missing[0]}_{unit}; give x, y and z, or none"
            )
    if len(found) == 1:
        raise InputError(f"{here}: there is no position and no rotation; write the header {_POSE}")
    return {"t": found.pop("t"), **found}


def _opened(path: Path, wanted: str) -> tuple[str, list[str], _Rows]:
    """Place and cells of the header, and the rows below it."""
    rows = _rows(path)
    try:
        here, header = next(rows)
    except StopIteration:
        raise InputError(f"{path}: the file is empty; {wanted}") from None
    return here, header, rows


def _numbers(
    header: list[str], rows: _Rows, columns: Iterable[tuple[int, float]]
) -> Iterator[tuple[str, list[float]]]:
    """Yield the place of each row and its numbers in SI, in the order of the columns."""
    for here, cells in rows:
        if len(cells) != len(header):
            raise InputError(f"{here}: it has {len(cells)} cells, the header has {len(header)}")
        yield here, [_cell(here, header[i], cells[i], factor) for i, factor in columns]


def _rows(path: Path) -> _Rows:
    """Yield the place of each line, as file and number, and its cells."""
    try:
        # pipes are read too; a device such as /dev/zero has no end
        with readable(path) as file:
            data = file.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise InputError(f"{path}: the table is too large; {_LARGEST // 10**6} MB are read")
        reader = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        for cells in reader:
            text = [cell.strip() for cell in cells]
            if any(text) and not text[0].startswith("#"):
                yield f"{path}, line {reader.line_num}", text
    except OSError as error:
        why = "it is a folder" if path.is_dir() else error.strerror
        raise InputError(f"{path}: the table cannot be read: {why}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: the table is not text in UTF-8") from None
    except (csv.Error, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: the table cannot be read: {error}") from None


def _columns(here: str, header: list[str], count: int) -> tuple[list[tuple[int, float]], list[str]]:
    """Index and factor to SI of the columns of time and each tendon, and kinds of command."""
    if any(";" in name for name in header):
        raise InputError(f"{here}: columns are separated by commas, numbers have a point")
    found: dict[int, tuple[int, float]] = {}  # 0 is time
    kinds: dict[int, str] = {}
    for i, name in enumerate(header):
        pattern = r"t_(?P<t>.+)|(?P<kind>tension|displacement|angle)_(?P<k>[0-9]{1,4})_(?P<unit>.+)"
        match = re.fullmatch(pattern, name)
        if match is None or len(name) > _LONG:
            raise InputError(f"{here}: {quote(name)} is no column of a table; {_wanted(count)}")
        si = "s" if match["t"] else _KINDS[match["kind"]][1]
        k = int(match["k"] or 0)
        if match["k"] and not 1 <= k <= count:
            tendons = f"{count} tendon" + ("" if count == 1 else "s")
            raise InputError(f"{here}: got {name}; the robot has {tendons}")
        if k in found and kinds.get(k) == match["kind"]:
            raise InputError(f"{here}: {name} is there twice, as {header[found[k][0]]}")
        if k in found:
            raise InputError(
                f"{here}: tendon {k} has {header[found[k][0]]} and {name}; give it one of them"
            )
        try:
            found[k] = (i, read_number(f"1 {match['t'] or match['unit']}", si))
            kinds[k] = match["kind"]
        except ValueError as error:
            raise InputError(f"{here}: got {name}, {error}") from None
    missing = [k for k in range(count + 1) if k not in found]
    if missing:
        name = f"tension_{missing[0]}_N" if missing[0] else "t_s"
        raise InputError(f"{here}: there is no column {name}; {_wanted(count)}")
    order = range(count + 1)
    return [found[k] for k in order], [kinds[k] for k in order[1:]]


def _cell(here: str, name: str, text: str, factor: float) -> float:
    try:
        return read_number(text, "") * factor
    except ValueError as error:
        raise InputError(f"{here}: got {quote(text)} for {name}, {error}") from None


def _wanted(count: int) -> str:
    names = ["t_s", "tension_1_N"] + (["tension_2_N"] if count > 1 else [])
    if count > 2:
        names += (["..."] if count > 3 else []) + [f"tension_{count}_N"]
    text = f"write the header {','.join(names)}"
    return text + " (or displacement_1_mm, angle_1_deg for such a command)"
