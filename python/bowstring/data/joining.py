"""Join two tables of one experiment by time: add columns of a log to the rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import islice
from typing import Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.clock import times
from bowstring.data.columns import Column
from bowstring.data.tables import Row, Table, cell_number, with_point
from bowstring.errors import InputError
from bowstring.units import quote

How = Literal["linear", "nearest", "previous"]

_CHUNK: Final = 5_000  # rows
_GAP: Final = 10.0  # time between samples over median step that counts as a gap
_SAME: Final = 1e-6  # time difference over median step that counts as zero


def _times(clock: Column, table: Table, rows: Sequence[Row]) -> Floats:
    """Times of rows in s; NaN where a cell has none."""
    cells = [row[clock.index] if clock.index < len(row) else "" for _, row in rows]
    numbers = None
    if not clock.dates:
        pointed = map(with_point, cells) if table.separator != "," else cells
        numbers = np.array(list(map(cell_number, pointed)))
    found = times(clock, cells, numbers, table.path, [line for line, _ in rows])
    return found if clock.plus is None else found + _times(clock.plus, table, rows)


def join(
    table: Table,
    clock: Column,
    log: Table,
    log_clock: Column,
    how: How,
    within: float | None,
    shift: float = 0.0,
) -> Table:
    """Add the columns of a log to the rows of a table, with the log's values at their times.

    Parameters
    ----------
    table, log : Table
        Table and log; the log is read as a whole.
    clock, log_clock : Column
        Their columns of time.
    how : {"linear", "nearest", "previous"}
        Interpolation between samples: linear, nearest sample, or previous sample. Text is not
        interpolated.
    within : float or None
        Largest distance of a row from a sample in s; farther rows get no value. None allows all
        times from the first to the last sample, and a median step beyond.
    shift : float
        Offset added to the times of the log, s.

    Returns
    -------
    Table
        Joined table with blank cells for missing values. A column whose name exists in both becomes
        ``log.NAME``.

    Raises
    ------
    InputError
        If the log has no times or they decrease, or no row lies within them.
    """
    samples = _Samples(log, log_clock, shift)
    names = [name if name not in table.header else f"log.{name}" for name in log.header]
    length_unit, own = table.length_unit or log.length_unit, len(table.header)
    out = replace(table, header=[*table.header, *names], length_unit=length_unit, own=own)
    if log.length_unit is not None and table.length_unit not in (None, log.length_unit):
        raise InputError(
            f"{table.path} is in {table.length_unit} and {log.path} in {log.length_unit}; export "
            "both in one unit"
        )
    out.notes += [(table.line, text) for _, text in log.notes]
    gap = samples.largest_gap
    if how == "linear" and within is None and gap > _GAP * samples.step:
        text = (
            f"{log.path.name} has no sample for up to {gap:.3g} s, and a step of "
            f"{samples.step:.3g} s elsewhere; values between are straight; write "
            "within: in the mapping's join to leave them out"
        )
        out.notes.append((table.line, text))
    out.rows = _joined(out, table.rows, clock, samples, how, within)
    return out


class _Samples:
    """Log in the order of its times, and its cells."""

    def __init__(self, log: Table, clock: Column, shift: float) -> None:
        self.path = log.path
        width = len(log.header)
        found: list[Floats] = []
        lines: list[int] = []
        self.cells: list[list[str]] = []
        without = 0
        for rows in log.chunks():
            each = _times(clock, log, rows) + shift
            found.append(each[np.isfinite(each)])
            for (line, cells), time in zip(rows, each, strict=True):
                if np.isnan(time):
                    without += 1
                    continue
                lines.append(line)
                self.cells.append((cells + [""] * width)[:width])
        if not lines:
            raise InputError(
                f"{log.path}: no row has a time in {quote(clock.name)}; give its unit, iso for "
                "dates and times"
            )
        if without:
            text = f"{without} rows of {log.path.name} have no time, and are not joined"
            log.notes.append((log.line, text))
        self.times = np.concatenate(found)
        steps = np.diff(self.times)
        if (steps < 0).any():
            before, line = lines[(k := int(np.argmax(steps < 0)))], lines[k + 1]
            other = (
                f"; where another table begins there, write last: {before} in the join's table"
                if line > before + 1
                else ""
            )
            raise InputError(
                f"{log.path}, line {line}: {clock.name} goes back; a log that is joined by time "
                f"stands in the order of its times{other}"
            )
        if (steps == 0).any():
            k, count = int(np.argmax(steps == 0)) + 1, int((steps == 0).sum())
            times = f" (the first of {count} times)" if count > 1 else ""
            text = (
                f"{clock.name} of {log.path.name} is the same in its lines {lines[k - 1]} and "
                f"{lines[k]}{times}; of samples at one time the last is joined"
            )
            log.notes.append((log.line, text))
        if log.separator != ",":
            for name, column in zip(log.header, zip(*self.cells, strict=True), strict=True):
                _check_decimals(log, name, column, lines)
            self.cells = [list(map(with_point, cells)) for cells in self.cells]
        steps = steps[steps > 0]
        self.step = float(np.median(steps)) if len(steps) else 0.0
        self.largest_gap = float(steps.max(initial=0.0))
        self.numbers: Floats = np.array([list(map(cell_number, cells)) for cells in self.cells])

    def at(self, times: Floats, how: How, within: float | None) -> list[list[str] | None]:
        """Cells at given times; None where there is no sample."""
        last = len(self.times) - 1
        known = np.nan_to_num(times, nan=self.times[0] - 1e9 * (1.0 + self.step))
        left = np.clip(np.searchsorted(self.times, known, side="right") - 1, 0, last)
        right = np.minimum(left + (self.times[left] < known), last)
        a, b = np.abs(known - self.times[left]), np.abs(self.times[right] - known)
        left = np.where(b <= _SAME * self.step, right, left)
        a = np.abs(known - self.times[left])
        nearest = np.where(b < a, right, left)
        if within is not None:
            far = (a if how == "previous" else np.minimum(a, b)) > within
        else:
            far = (known < self.times[0] - self.step) | (known > self.times[-1] + self.step)
        if how == "previous":
            far |= known < self.times[0]
        chosen = left if how == "previous" else nearest
        rows = [self.cells[k] for k in chosen]
        if how == "linear":
            # a time that differs from a sample by rounding is that sample's
            inside = ~far & (left < right) & (np.minimum(a, b) > _SAME * self.step)
            span = np.where(inside, self.times[right] - self.times[left], 1.0)
            share = ((known - self.times[left]) / span)[:, None]
            change = self.numbers[right] - self.numbers[left]
            values = self.numbers[left] + share * change
            for k in np.flatnonzero(inside):
                other = self.cells[left[k] + right[k] - chosen[k]]
                # no interpolation beside a missing number, such as an occluded marker's
                rows[k] = [
                    repr(float(value)) if np.isfinite(value) else _between(*cells)
                    for value, *cells in zip(values[k], rows[k], other, strict=True)
                ]
        return [None if lost else cells for lost, cells in zip(far, rows, strict=True)]


def _check_decimals(log: Table, name: str, cells: Sequence[str], lines: Sequence[int]) -> None:
    """Refuse a column with decimal commas in some cells and decimal points in others."""
    text = "".join(cells)
    if "," in text and "." in text:
        is_number = [np.isfinite(cell_number(with_point(cell))) for cell in cells]
        found = [
            next((i for i, cell in enumerate(cells) if is_number[i] and mark in cell), None)
            for mark in ",."
        ]
        if None not in found:
            comma, point = (lines[i] for i in found if i is not None)
            raise InputError(
                f"{log.path}: {name} has a decimal comma in line {comma} and a decimal point in "
                f"line {point}; write all with a point"
            )


def _between(nearest: str, other: str) -> str:
    """Text between two samples: that of the nearest one, unless only one is a number."""
    is_number = [np.isfinite(cell_number(cell)) for cell in (nearest, other)]
    return "" if any(is_number) else nearest


def _joined(
    out: Table,
    rows: Iterator[Row],
    clock: Column,
    samples: _Samples,
    how: How,
    within: float | None,
) -> Iterator[Row]:
    width = out.own or 0
    blank = [""] * (len(out.header) - width)
    first, last, found, lost = np.inf, -np.inf, 0, 0
    where = 0
    while chunk := list(islice(rows, _CHUNK)):
        array = _times(clock, out, chunk)
        if np.isfinite(array).any():
            first, last = min(first, np.nanmin(array)), max(last, np.nanmax(array))
        beside = samples.at(array, how, within)
        for (line, cells), more in zip(chunk, beside, strict=True):
            if more is None:
                lost, where = lost + 1, where or line
            else:
                found += 1
            if len(cells) < width or any(cell.strip() for cell in cells[width:]):
                yield line, cells  # refused later by its length
            else:
                yield line, [*cells[:width], *(blank if more is None else more)]
    begins, ends = float(samples.times[0]), float(samples.times[-1])
    if not found and lost:
        span = f"from {first:.10g} to {last:.10g} s" if np.isfinite(first) else "nowhere"
        raise InputError(
            f"{out.path}: no row lies within the times of {samples.path.name}: its times run "
            f"{span}, those of the log from {begins:.10g} to {ends:.10g} s; check the units of "
            "both times, and write shift: in the mapping's join for clocks that differ"
        )
    if lost:
        rows_ = "one row lies" if lost == 1 else f"{lost} rows lie"
        text = (
            f"{rows_} too far from the samples of {samples.path.name} (from here on), and have no "
            "values of it"
        )
        out.notes.append((where, text))
