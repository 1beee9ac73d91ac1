"""Tensions over time from a CSV file."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from bowstring.dynamics import Table
from bowstring.errors import InputError
from bowstring.robot import Robot
from bowstring.units import quote, read_number

__all__ = ["read_tensions"]

_LARGEST: Final = 100_000_000  # bytes


def read_tensions(path: str | Path, robot: Robot) -> Table:
    """Read a table of tensions over time.

    Parameters
    ----------
    path : str or Path
        CSV: a header, ``t_s`` and ``tension_1_N`` to the last tendon in any order, each with its
        unit at the end (``t_ms``, ``tension_2_mN``); then a row a time. Times do not decrease; the
        same time twice is a jump. Empty lines and lines that begin with # are skipped.
    robot : Robot

    Returns
    -------
    Table

    Raises
    ------
    InputError
        If it cannot be read, or is wrong; the text names file and row.
    """
    count = len(robot.tendons.end_disk)
    rows = _rows(Path(path))
    try:
        line, header = next(rows)
    except StopIteration:
        raise InputError(f"{path}: the file is empty; {_wanted(count)}") from None
    columns = _columns(f"{path}, row {line}", header, count)
    times: list[float] = []
    values: list[list[float]] = []
    for line, cells in rows:
        here = f"{path}, row {line}"
        if len(cells) != len(header):
            raise InputError(f"{here}: it has {len(cells)} cells, the header has {len(header)}")
        row = [_cell(here, header[i], cells[i], factor) for i, factor in columns]
        time, tensions = row[0], row[1:]
        for i, value in enumerate(tensions):
            if value < 0:
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
        times.append(time)
        values.append(tensions)
    if not times:
        raise InputError(f"{path}: there is no row of numbers below the header")
    if times[-1] == 0:
        raise InputError(f"{path}: the last time is 0 s; a run takes some time")
    return Table(times, values)


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Number of the line, from 1, and cells."""
    try:
        # a pipe is read as well; a device such as /dev/zero has no end
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
        if len(data) > _LARGEST:
            raise InputError(f"{path}: the table is too large; {_LARGEST // 10**6} MB are read")
        reader = csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True)
        for cells in reader:
            text = [cell.strip() for cell in cells]
            if any(text) and not text[0].startswith("#"):
                yield reader.line_num, text
    except OSError as error:
        why = "it is a folder" if path.is_dir() else error.strerror
        raise InputError(f"{path}: the table cannot be read: {why}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: the table is not text in UTF-8") from None
    except (csv.Error, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: the table cannot be read: {error}") from None


def _columns(here: str, header: list[str], count: int) -> list[tuple[int, float]]:
    """Place and factor to SI of time and each tension, in the robot's order."""
    if any(";" in name for name in header):
        raise InputError(f"{here}: columns are separated by commas, numbers have a point")
    found: dict[int, tuple[int, float]] = {}  # 0 is time
    for i, name in enumerate(header):
        match = re.fullmatch(r"t_(?P<t>.+)|tension_(?P<k>[0-9]{1,4})_(?P<N>.+)", name)
        if match is None:
            raise InputError(f"{here}: {quote(name)} is no column of a table; {_wanted(count)}")
        si = "s" if match["t"] else "N"
        k = int(match["k"] or 0)
        if match["k"] and not 1 <= k <= count:
            tendons = f"{count} tendon" + ("" if count == 1 else "s")
            raise InputError(f"{here}: got {name}; the robot has {tendons}")
        if k in found:
            raise InputError(f"{here}: {name} is there twice, as {header[found[k][0]]}")
        try:
            found[k] = (i, read_number(f"1 {match['t'] or match['N']}", si))
        except ValueError as error:
            raise InputError(f"{here}: got {name}, {error}") from None
    missing = [k for k in range(count + 1) if k not in found]
    if missing:
        name = f"tension_{missing[0]}_N" if missing[0] else "t_s"
        raise InputError(f"{here}: there is no column {name}; {_wanted(count)}")
    return [found[k] for k in range(count + 1)]


def _cell(here: str, name: str, text: str, factor: float) -> float:
    try:
        return read_number(text, "") * factor
    except ValueError as error:
        raise InputError(f"{here}: got {quote(text)} for {name}, {error}") from None


def _wanted(count: int) -> str:
    names = ["t_s", "tension_1_N"] + (["tension_2_N"] if count > 1 else [])
    if count > 2:
        names += (["..."] if count > 3 else []) + [f"tension_{count}_N"]
    return f"write the header {','.join(names)}"
