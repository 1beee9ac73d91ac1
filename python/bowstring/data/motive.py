"""Header of a CSV export of OptiTrack's Motive: column names from seven or eight lines.

A take has columns of rigid bodies, of their markers, and of single markers. The lines of its header
are, for each column: Type, Name, ID, (Parent), quantity (Rotation, Position), axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Final

from bowstring.errors import InputError
from bowstring.units import quote

FRAME: Final = "Frame"
TIME: Final = "Time (Seconds)"
_FIRST: Final = "Format Version"
_UNITS: Final = {"Meters": "m", "Centimeters": "cm", "Millimeters": "mm"}
_MOST_LINES: Final = 12
_LABELS: Final = ("Type", "Name", "ID", "Parent")


@dataclass(frozen=True)
class Export:
    """Content of the header.

    Attributes
    ----------
    columns : list of str
        Names: ``Frame``, ``Time (Seconds)``, then for example ``tip Position X``.
    line : int
        Number of the last line of the header, from 1.
    unit : str
        Unit of all positions: m, cm or mm.
    take : str
        Name of the recording.
    """

    columns: list[str]
    line: int
    unit: str
    take: str


def is_export(line: str) -> bool:
    """Whether a file with this first line is a Motive export."""
    return line.lstrip('"').startswith(_FIRST)


def read_header(path: Path, rows: Iterator[tuple[int, list[str]]]) -> Export:
    """Read the header, and advance the rows to the first one with numbers.

    Parameters
    ----------
    path : Path
        Path in messages.
    rows : iterator of (int, list of str)
        Line numbers and cells from the first line of the file, without blank lines.

    Returns
    -------
    Export

    Raises
    ------
    InputError
        If the header has no column names, no positions, or an unknown unit.
    """
    _, cells = next(rows)
    about = dict(zip(cells[::2], cells[1::2], strict=False))
    unit = _UNITS.get(about.get("Length Units", "Meters").strip().capitalize())
    if unit is None:
        raise InputError(
            f"{path}: this Motive export has lengths in {quote(about['Length Units'])}; must be "
            f"{', '.join(_UNITS)}"
        )
    lines: list[list[str]] = []
    for line, cells in rows:
        if cells[0].strip() == FRAME:
            columns = _columns(cells, lines)
            if not any(" Position " in name for name in columns):
                raise InputError(
                    f"{path}: this Motive export has no position of a rigid body or a marker; "
                    "export them, and the header"
                )
            return Export(columns, line, unit, about.get("Take Name", "").strip())
        lines.append(cells)
        if len(lines) > _MOST_LINES:
            break
    raise InputError(
        f"{path}: this begins as a Motive export, but the line that begins with {FRAME} is not "
        "among the first of it; export it with its header"
    )


def _columns(axes: list[str], lines: list[list[str]]) -> list[str]:
    """Unique column names: name, quantity and axis; with the type if they are not unique."""
    width = len(axes)
    padded = [[cell.strip() for cell in cells] + [""] * (width - len(cells)) for cells in lines]
    labelled = {cells[1]: cells for cells in padded if cells[1] in _LABELS}
    if not labelled:  # before version 1.24 the lines may stand without their labels
        labelled = dict(zip(_LABELS, padded[:-1], strict=False))
    # the line above the axes has no label
    what = next((cells for cells in padded[::-1] if cells[1] not in _LABELS), [""] * width)
    names = labelled.get("Name", [""] * width)
    types = labelled.get("Type", [""] * width)
    out: list[str] = []
    for i, axis in enumerate(axes):
        parts = [FRAME] if i == 0 else [TIME] if i == 1 else [names[i], what[i], axis.strip()]
        plain = name = " ".join(part for part in parts if part)
        if name in out and types[i]:
            name = f"{plain} ({types[i]})"
        again = count(2)
        while name in out:
            name = f"{plain} {next(again)}"
        out.append(name)
    while out and not out[-1]:
        out.pop()
    return out
