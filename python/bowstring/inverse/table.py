"""Paths of the tip: table of positions in, table of commands out."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from bowstring._core import __version__
from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.files.atomic_io import check_file, readable, write_whole_file
from bowstring.inverse.solution import InverseSolution
from bowstring.units import quote

_MARK: Final = b"# commands by Bowstring"
_MOST_BYTES: Final = 200_000_000
_UNITS: Final = {"_mm": 1e-3, "_m": 1.0}
_DIRECTION: Final = ("direction_x", "direction_y", "direction_z")


class Tips(NamedTuple):
    """Wanted positions (n, 3) in m, and directions (n, 3) if the table has them."""

    positions: Floats
    directions: Floats | None


class Landing(NamedTuple):
    """Tensions (n, T) in N of another model, and the tips (n, 3) in m under them by physics."""

    tensions: Floats
    tip_position: Floats


def read_tips(path: str | Path) -> Tips:
    """Read a table of positions of the tip.

    Parameters
    ----------
    path : str or Path
        CSV in UTF-8 with the columns ``tip_x_mm``, ``tip_y_mm``, ``tip_z_mm`` (or ``tip_x_m`` and
        so on), and ``direction_x``, ``direction_y``, ``direction_z`` if directions are wanted.
        Further columns are not read; blank lines and lines that begin with ``#`` are skipped.

    Returns
    -------
    Tips

    Raises
    ------
    InputError
        If the table cannot be read, lacks columns, or has blanks or other entries that are not
        finite numbers; the line is named.
    """
    file = Path(path)
    lines = _lines(file)
    rows = _cells(file, lines)
    header = [name.strip() for name in next(rows, (0, []))[1]]
    if not header:
        raise InputError(f"{file}: the table is empty")
    columns, factor = _columns(file, header)
    found = []
    for line, cells in rows:
        values = []
        for column in columns:
            cell = cells[column].strip() if column < len(cells) else ""
            try:
                value = float(cell)
            except ValueError:
                value = math.nan
            if not math.isfinite(value):
                what = quote(cell) if cell else "nothing"
                raise InputError(
                    f"{file}, line {line}: {header[column]} is {what}; it must be a finite number"
                )
            values.append(value)
        found.append(values)
    if not found:
        raise InputError(f"{file}: the table has no rows below its header")
    table = np.array(found)
    return Tips(table[:, :3] * factor, table[:, 3:] if table.shape[1] == 6 else None)


def _lines(file: Path) -> list[tuple[int, str]]:
    try:
        with readable(file) as stream:
            data = stream.read(_MOST_BYTES + 1)
        text = data.decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"{file}: the table cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{file}: the table is no text in UTF-8; save it as CSV") from None
    if len(data) > _MOST_BYTES:
        raise InputError(f"{file}: the table is too large; split it")
    numbered = enumerate(text.splitlines(), 1)
    return [(k, line) for k, line in numbered if line.strip() and not line.lstrip().startswith("#")]


def _cells(file: Path, lines: list[tuple[int, str]]) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and cells of each line."""
    for line, text in lines:
        try:
            yield line, next(csv.reader([text]))
        except csv.Error as error:
            raise InputError(f"{file}, line {line}: the table cannot be read: {error}") from None


def _columns(file: Path, header: list[str]) -> tuple[list[int], float]:
    for unit, factor in _UNITS.items():
        names = [f"tip_{axis}{unit}" for axis in "xyz"]
        if all(name in header for name in names):
            there = [name for name in _DIRECTION if name in header]
            if there and len(there) < 3:
                missing = next(name for name in _DIRECTION if name not in header)
                raise InputError(f"{file}: there is a column {there[0]}, but none {missing}")
            return [header.index(name) for name in (*names, *there)], factor
    raise InputError(
        f"{file}: the columns are {', '.join(map(quote, header[:8]))}; they must include tip_x_mm, "
        "tip_y_mm and tip_z_mm, or tip_x_m, tip_y_m and tip_z_m"
    )


def check_commands(path: str | Path) -> Path:
    """Check before any work that a table may be written to a ``.csv`` file; return its path."""
    return check_file(Path(path), "table of commands", (".csv",), _MARK)


def write_commands(
    found: InverseSolution, path: str | Path, landing: Landing | None = None
) -> Path:
    """Write the commands for a path as CSV.

    The columns are ``tip_x_mm`` and so on, the wanted position; ``status``; ``distance_mm`` of the
    tip under the tensions from it; ``nearest_distance_mm`` of the nearest tip that was found, which
    is smaller where a margin was used for smaller tensions; ``restarted``; for each tendon
    ``tension_1_N`` and ``displacement_1_mm``; and with a landing ``other_tension_1_N`` and so on,
    the landed tip ``other_tip_x_mm`` and so on, and its distance ``other_distance_mm`` from the
    wanted position. Cells without a number are blank.

    Parameters
    ----------
    found : InverseSolution
        Of n positions.
    path : str or Path
        Ends in ``.csv``. It is written whole or not at all; a former table of commands is replaced,
        no other file.
    landing : Landing, optional
        Commands by another model, and the tips under them.

    Returns
    -------
    Path
        The file, absolute.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    file = check_commands(path)
    each = range(1, found.tensions.shape[1] + 1)
    header = ["tip_x_mm", "tip_y_mm", "tip_z_mm", "status"]
    header += ["distance_mm", "nearest_distance_mm", "restarted"]
    header += [f"tension_{i}_N" for i in each] + [f"displacement_{i}_mm" for i in each]
    displacements = found.displacements()
    if displacements is None:
        displacements = np.full_like(found.tensions, np.nan)
    parts = [found.tensions, 1e3 * displacements]
    if landing is not None:
        header += [f"other_tension_{i}_N" for i in each]
        header += ["other_tip_x_mm", "other_tip_y_mm", "other_tip_z_mm", "other_distance_mm"]
        miss = np.linalg.norm(landing.tip_position - found.position, axis=1)
        parts += [landing.tensions, 1e3 * landing.tip_position, 1e3 * miss[:, None]]
    numbers = np.column_stack(parts) + 0.0  # no -0
    model = found.model if isinstance(found.model, str) else f"physics, {found.model.theory}"

    rows = [
        [
            *(1e3 * found.position[k]).tolist(),
            found.status[k],
            1e3 * float(found.distance[k]),
            1e3 * float(found.nearest_distance[k]),
            int(found.restarted[k]),
            *row,
        ]
        for k, row in enumerate(numbers.tolist())
    ]
    return write_rows(file, f"{found.robot.name}, {model}", header, rows)


def _text(cell: object) -> object:
    """Cell of a number with nine digits, blank where there is none; other cells as they are."""
    if not isinstance(cell, float):
        return cell
    return f"{cell:.9g}" if math.isfinite(cell) else ""


def write_rows(
    path: str | Path, about: str, header: Sequence[str], rows: Iterable[Sequence[object]]
) -> Path:
    """Write a table of commands as CSV, whole or not at all.

    Parameters
    ----------
    path : str or Path
        As for `write_commands`.
    about : str
        Robot and model, for the first line.
    header : sequence of str
        Names of the columns with their units.
    rows : iterable of sequences
        Cells: texts as they are, numbers with nine digits, blank where not finite.

    Returns
    -------
    Path
        The file, absolute.
    """
    file = check_commands(path)

    def fill(new: Path) -> None:
        with new.open("w", newline="", encoding="utf-8") as stream:
            stream.write(f"{_MARK.decode()} {__version__}: {' '.join(about.split())}\n")
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(header)
            writer.writerows([_text(cell) for cell in row] for row in rows)

    write_whole_file(file, "table of commands", fill, lambda: check_commands(file))
    return file
