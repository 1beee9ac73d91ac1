"""Detect where the tables of a file begin, where the file does not begin with a header.

Exports have lines about the recording above the header, headers of several rows, a row of units, or
several tables one below the other. A table begins where rows of numbers of one width do.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Any, Final

from bowstring.data.clock import is_time
from bowstring.data.tables import (
    MARKS,
    Form,
    Table,
    blocks_of,
    cell_number,
    default_separator,
    is_blank,
    is_comment,
    is_missing,
    is_name,
    is_text,
    joined_names,
    lines_of_table,
    open_table,
    title_of,
)
from bowstring.errors import InputError

_MOST_LINES: Final = 1_000  # lines in which a table begins
_ROWS: Final = 3  # rows of numbers with which it begins
#: Units of a row of units below a header.
UNITS: Final = {
    *("m", "cm", "mm", "um", "µm", "inch", "in", "N", "mN", "kN", "kgf", "lbf", "kg", "g", "mg"),
    *("s", "sec", "ms", "us", "ns", "min", "deg", "°", "rad", "V", "mV", "A", "mA", "Hz", "Pa"),
    *("kPa", "MPa", "bar", "Nm", "Nmm", "N*m", "N*mm", "N.m", "N.mm", "%", "-", "°C", "px", "1"),
    *("m/s", "mm/s", "deg/s", "rad/s", "m/s^2", "mm/s^2", "mm/s²", "counts"),
}
_RATE: Final = re.compile(
    r"(?:frequency|(?:frame|data|camera|sampl\w*|capture|measurement)[ _-]?(?:rate|frequency))"
    r"[^0-9\n]{0,20}?([0-9]+(?:\.[0-9]+)?)",
    re.IGNORECASE,
)

Cells = list[str]


def detected(path: Path) -> list[Table]:
    """Open the tables of a text file, the first sheet of a workbook, or the topics of a bag.

    Parameters
    ----------
    path : Path

    Returns
    -------
    list of Table
        Tables with their `Table.form`; empty if no row of numbers is found.
    """
    try:
        if topics := blocks_of(path):
            return [open_table(path, Form(block=topic)) for topic in topics]
        lines, is_sheet = lines_of_table(path)
    except InputError:
        return []
    starts = [
        i
        for i, line in enumerate(lines)
        if is_name(title_of(line)) and (i == 0 or is_blank(lines[i - 1]))
    ]
    found = []
    for i in starts:
        below = takewhile(lambda line: not is_blank(line), lines[i + 1 : i + 1 + _MOST_LINES])
        if form := _form(list(below)):
            found.append({**form, "block": title_of(lines[i])})
    titles = Counter(each["block"] for each in found)
    if len(found) < 2 or max(titles.values()) > 1 or is_sheet:
        whole = _form(lines[:_MOST_LINES])
        found = [whole] if whole else []
    tables = []
    for form in found:
        rate = form.pop("rate")
        if is_sheet:
            form.pop("separator", None)
        try:
            table = open_table(path, Form.model_validate(form))
        except InputError:
            continue
        table.rate = rate
        tables.append(table)
    return tables


def _form(lines: Sequence[str]) -> dict[str, Any] | None:
    """Fields of the form of a table in lines, and its rate; None without rows of numbers."""
    plain = [
        (i, line) for i, line in enumerate(lines) if not is_blank(line) and not is_comment(line)
    ]
    best: tuple[int, str, int, list[tuple[int, Cells]]] | None = None
    for mark in ("\t", ";", ",", " "):
        if best is not None and mark == " ":  # dates and names have blanks too
            break
        rows = [(i, _cells(line, mark)) for i, line in plain]
        start = _start(rows)
        if start is not None:
            count = sum(map(_values, (cells for _, cells in rows[start : start + 50])))
            if best is None or count > best[0]:
                best = (count, mark, start, rows)
    if best is None:
        return None
    _, mark, start, rows = best
    above, (first, numbers) = rows[:start], rows[start]
    width = len(numbers)
    names, count, below = _header([cells for _, cells in above], numbers, mark)
    if markers := _markers(above, width):
        names, count = markers, 0
    out: dict[str, Any] = {"rate": _rate(lines[:first], [cells for _, cells in above])}
    is_first = bool(count) and len(set(filter(None, names))) == len(list(filter(None, names)))
    if is_first and len(names) <= width:
        at = above[-below - count][0]
        out |= {"skip": at, "header_rows": count, "skip_below": below}
    else:
        at = first
        names = names or _commented(lines[:first], mark, width)
        out |= {"skip": at, "header": "none"}
        if names:
            out["names"] = _unique(names[:width])
    if default_separator(lines[at]) != mark:
        out["separator"] = MARKS[mark]
    return {key: value for key, value in out.items() if value not in (0, ())}


def _start(rows: Sequence[tuple[int, Cells]]) -> int | None:
    """First of the rows of numbers of nearly one width; None without them."""
    for i in range(len(rows)):
        few = [cells for _, cells in rows[i : i + _ROWS]]
        if all(map(_is_data, few)) and all(abs(len(c) - len(few[0])) <= 1 for c in few):
            return i
    return None


def _cells(line: str, mark: str) -> Cells:
    if mark == " ":
        return line.split()
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=mark))]
    except (csv.Error, StopIteration):
        return [line]


def _values(cells: Cells) -> int:
    """Number of cells with a number, a time or what says that nothing was measured."""
    return sum(
        bool(cell) and (not is_text(cell) or is_missing(cell) or is_time(cell)) for cell in cells
    )


def _is_data(cells: Cells) -> bool:
    return (count := _values(cells)) >= 2 and 2 * count >= sum(map(bool, cells))


def _header(above: list[Cells], numbers: Cells, mark: str) -> tuple[Cells, int, int]:
    """Names of the columns, number of rows of the header, and of rows below it."""
    width = len(numbers)
    below = int(len(above) > 1 and _is_units(above[-1]))
    if len(above) <= below:
        return [], 0, 0
    names = list(above[-1 - below])
    while names and not names[-1]:
        names.pop()
    filled = [name for name in names if name]
    texts = sum(map(is_text, filled))
    if len(names) < max(2, width - 3) or 2 * texts < len(filled) or not filled:
        return [], 0, 0
    upper = above[-2 - below] if len(above) > 1 + below else []
    joined = joined_names(upper, names)
    repeats = len(set(filled)) < len(filled)
    fills = any(up and not low for up, low in zip(upper, names, strict=False))
    if (repeats or fills) and len(upper) > 1 and len(joined) <= width + 1:
        return joined, 2, below
    return names, 1, below


def _is_units(cells: Cells) -> bool:
    filled = [cell.strip("[]() ") for cell in cells if cell]
    return bool(filled) and all(cell in UNITS for cell in filled) and any(map(str.isalpha, filled))


def _commented(above: Sequence[str], mark: str, width: int) -> Cells:
    """Names in a comment above the numbers, as TUM trajectories and savetxt of NumPy have them."""
    if not above or not above[-1].lstrip().startswith(("#", "%")):
        return []
    names = _cells(above[-1].lstrip("#% \t"), mark)
    return names if len(names) == width else []


def _markers(above: Sequence[tuple[int, Cells]], width: int) -> Cells:
    """Names from a line MARKER_NAMES, as Qualisys writes it above coordinates without a header."""
    for _, cells in above:
        names = [cell for cell in cells[1:] if cell]
        if cells[0].upper() == "MARKER_NAMES" and (more := width - 3 * len(names)) in (0, 1, 2):
            left = ["Frame", "Time"][:more]
            return left + [f"{name} {axis}" for name in names for axis in "XYZ"]
    return []


def _unique(names: Sequence[str]) -> tuple[str, ...]:
    out: list[str] = []
    for i, given in enumerate(names, 1):
        given = given if is_name(given) else f"column_{i}"
        name, count = given, 2
        while name in out:
            name, count = f"{given} {count}", count + 1
        out.append(name)
    return tuple(out)


def _rate(lines: Sequence[str], rows: Sequence[Cells]) -> float | None:
    """Samples per second, from lines above the header."""
    for i, cells in enumerate(rows):
        if len(list(filter(None, cells))) == 1 and cell_number(cells[0]) > 0:
            return cell_number(cells[0])  # Vicon: a number alone, below the title
        if "DataRate" in cells and i + 1 < len(rows):  # TRC: the values in the line below
            below = dict(zip(cells, rows[i + 1], strict=False))
            rate = cell_number(below.get("DataRate", ""))
            return rate if rate > 0 else None
    match = next(filter(None, map(_RATE.search, lines)), None)
    return float(match[1]) if match and float(match[1]) > 0 else None
