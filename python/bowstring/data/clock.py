"""Times of cells: numbers of a unit, and the dates, clock times and durations of other programs.

Dates are those of ISO 8601, of MATLAB (``29-Feb-2024 13:00:01.250``) and of spreadsheets
(``29.02.2024 13:00``, ``2/29/2024 1:00 PM``); durations are ``0.25 sec`` and ``00:00:01.25``.
"""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.columns import Column
from bowstring.data.tables import with_point
from bowstring.errors import InputError
from bowstring.units import NUMBER, quote

#: Unit of a time given as date, clock time or duration in words.
ISO: Final = "iso"
#: Such units that also state the order of day and month.
DATES: Final = (ISO, "d/m/y", "m/d/y")

_NAN: Final = float("nan")
_DAY: Final = 86_400.0
_WORDS: Final = {
    **dict.fromkeys(("ns", "nsec", "nanoseconds"), 1e-9),
    **dict.fromkeys(("us", "µs", "usec", "microseconds"), 1e-6),
    **dict.fromkeys(("ms", "msec", "milliseconds"), 1e-3),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hr", "hrs", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), _DAY),
}
_MONTHS: Final = "janfebmaraprmayjunjulaugsepoctnovdec"
_DURATION: Final = re.compile(rf"({NUMBER})\s*([a-zµ]+)", re.IGNORECASE)
_CLOCK: Final = re.compile(
    r"(?P<sign>-?)(?:(?P<days>[0-9]{1,6}) days?,? \+?)?"
    r"(?:(?P<h>[0-9]{1,6}):(?P<m>[0-5]?[0-9])(?::(?P<s>[0-5]?[0-9](?:[.,][0-9]{1,12})?))?"
    r"|(?P<m_only>[0-9]{1,6}):(?P<s_only>[0-5]?[0-9][.,][0-9]{1,12}))"
    r"(?:\s?(?P<half>[AaPp])\.?[Mm]\.?)?"
)
#: Hours and minutes, or minutes and seconds.
_NO_CLOCK: Final = re.compile(r"[0-9]+:[0-9]+")
_ZONE: Final = re.compile(r"(.*?)\s*(?:[zZ]|UTC|GMT|([+-][0-9]{2}):?([0-9]{2}))")
_DATE: Final = re.compile(
    r"(?P<a>[0-9]{1,4})(?P<mark>[-/.])(?P<b>[0-9]{1,2})(?P=mark)(?P<c>[0-9]{1,4})\.?"
    r"|(?P<day>[0-9]{1,2})[- ./](?P<name>[A-Za-z]{3,9})\.?[- ,/]+(?P<year>[0-9]{4})"
    r"|(?P<name_first>[A-Za-z]{3,9})\.? (?P<day_2>[0-9]{1,2}),? (?P<year_2>[0-9]{4})"
)


class AmbiguousDateError(ValueError):
    """Error for a date such as 03/04/2024 where the order of day and month is not stated."""


def seconds_of(cell: str, order: str = ISO) -> float:
    """Seconds of a date with a time of day (since 1970), a clock time or a duration.

    Parameters
    ----------
    cell : str
    order : {"iso", "d/m/y", "m/d/y"}
        Order of day and month of dates such as 03/04/2024.

    Returns
    -------
    float
        NaN for other text. A date without a time zone counts as UTC, because only differences
        within a table matter.

    Raises
    ------
    AmbiguousDateError
        If day and month could be exchanged and `order` does not state which is first.
    """
    text = cell.strip()
    if math.isfinite(found := _iso(text)):
        return found
    if match := _DURATION.fullmatch(with_point(text)):
        return float(match[1]) * _WORDS.get(match[2].lower(), _NAN)
    if not _NO_CLOCK.fullmatch(text) and math.isfinite(found := _clock(text)):
        return found
    date = _DATE.match(text)
    if date is None:
        return _NAN
    rest, shift = text[date.end() :].lstrip(" T,"), 0.0
    if zone := _ZONE.fullmatch(rest):
        rest = zone[1]
        if zone[2]:
            shift = 60.0 * (60.0 * int(zone[2]) + int(zone[2][0] + zone[3]))
    return _midnight(date, order) + (_clock(rest) if rest else 0.0) - shift


def is_time(cell: str) -> bool:
    """Whether a cell has a time as `seconds_of` reads it, in some order of day and month."""
    try:
        return math.isfinite(seconds_of(cell))
    except AmbiguousDateError:
        return True


def _iso(text: str) -> float:
    text = re.sub(r"[zZ]$", "+00:00", text)
    match = re.fullmatch(r"(.*:[0-9]{2})[.,]([0-9]{1,12})(.*)", text)
    share = 0.0
    if match:  # older Pythons accept only three or six decimals
        text, share = match[1] + match[3], float(f"0.{match[2]}")
    try:
        found = datetime.datetime.fromisoformat(text)
    except ValueError:
        return _NAN
    if found.tzinfo is None:
        found = found.replace(tzinfo=datetime.timezone.utc)
    return found.timestamp() + share


def _clock(text: str) -> float:
    """Seconds of 13:00:01.25, 1:00:01 PM, 2 days 03:00:00 and 01:30.5 (minutes and seconds)."""
    match = _CLOCK.fullmatch(text)
    if match is None:
        return _NAN
    hours = int(match["h"] or 0)
    if match["half"]:
        if not 1 <= hours <= 12:
            return _NAN
        hours = hours % 12 + (12 if match["half"] in "Pp" else 0)
    minutes = int(match["m"] or match["m_only"])
    seconds = float((match["s"] or match["s_only"] or "0").replace(",", "."))
    found = _DAY * int(match["days"] or 0) + 3600.0 * hours + 60.0 * minutes + seconds
    return -found if match["sign"] else found


def _midnight(date: re.Match[str], order: str) -> float:
    """Seconds since 1970 at the beginning of a day; NaN if there is no such day."""
    if name := date["name"] or date["name_first"]:
        word = name[:3].lower()
        place = _MONTHS.find(word)
        if place % 3:  # also where it is not found
            return _NAN
        month, day = 1 + place // 3, int(date["day"] or date["day_2"])
        year = int(date["year"] or date["year_2"])
    else:
        a, b, c = (int(date[key]) for key in "abc")
        if len(date["a"]) == 4:
            year, month, day = a, b, c
        else:
            if date["mark"] == "." or order == "d/m/y":  # points are written for day.month only
                day, month = a, b
            elif order == "m/d/y":
                month, day = a, b
            elif len(date["c"]) < 4:  # the year may be first as well
                raise AmbiguousDateError(date[0])
            elif b > 12:
                month, day = a, b
            elif a > 12 or a == b:
                day, month = a, b
            else:
                raise AmbiguousDateError(date[0])
            year = c if len(date["c"]) == 4 else 2000 + c
    try:
        found = datetime.datetime(year, month, day, tzinfo=datetime.timezone.utc)
    except ValueError:
        return _NAN
    return found.timestamp()


def times(
    column: Column, cells: Sequence[str], numbers: Floats | None, path: Path, lines: Sequence[int]
) -> Floats:
    """Times of a column's cells, s; NaN where a cell has none.

    Parameters
    ----------
    column : Column
    cells : sequence of str
    numbers : ndarray or None
        The cells as numbers, NaN where they are none; None: all are dates and the like.
    path, lines : Path, sequence of int
        File, and line of each cell, for messages.

    Raises
    ------
    InputError
        If the order of day and month of a date is not known.
    """
    out = np.full(len(cells), _NAN) if numbers is None else column.factor * numbers
    for i in np.flatnonzero(np.isnan(out)).tolist():
        try:
            out[i] = seconds_of(cells[i], column.dates or ISO)
        except AmbiguousDateError:
            raise InputError(
                f"{path}, line {lines[i]}: {column.name} is {quote(cells[i])}, in which day and "
                "month may be exchanged; write in the mapping's time unit: d/m/y where the day is "
                "first, or unit: m/d/y where the month is"
            ) from None
    return out
