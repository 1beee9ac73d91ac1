"""Checks of arguments; messages name the argument, its value and the allowed range."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from os import PathLike
from typing import Any, TypeVar

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.units import has_no_unit, quote, read_number, read_share

_LONGEST = 60  # characters of a value in a message


def shown(value: object) -> str:
    """Write a value as Python does, shortened to one line."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # a whole number of thousands of digits
        text = "a huge number"
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4] + " ..."


def floats(value: Any) -> Floats:
    """Convert to a new array of floats.

    Raises
    ------
    TypeError
        For text, booleans, complex numbers and other objects that are not real numbers.
    InputError
        If the array does not fit into memory.
    """
    if _has_truth(value):
        raise TypeError("a boolean is no number")
    if isinstance(value, np.ma.MaskedArray):
        value = np.ma.filled(value.astype(float), np.nan)
    try:
        array = np.array(value)
        if array.dtype.kind not in "iufO":
            raise TypeError("not numbers")
        return array.astype(float)
    except (ValueError, OverflowError) as error:
        raise TypeError(str(error)) from None
    except MemoryError:
        raise too_large(value) from None


def too_large(value: Any) -> InputError:
    """Error for an array that does not fit into memory."""
    return InputError(
        f"an array of shape {np.shape(value)} does not fit into memory; give fewer numbers at once"
    )


def _has_truth(value: Any) -> bool:
    # an array has a single type
    if isinstance(value, (list, tuple)):
        return any(map(_has_truth, value))
    return isinstance(value, (bool, np.bool_))


def floats_or_refuse(value: Any, message: str) -> Floats:
    """Convert to a new array of floats; `message` is that of the error for what are no numbers."""
    try:
        return floats(value)
    except TypeError:
        raise InputError(message) from None


def read(name: str, value: Any, what: str) -> Floats:
    """Convert to a new array of floats; `what` is the allowed value in the error."""
    try:
        return floats(value)
    except TypeError:
        raise InputError(f"{name} is {shown(value)}, it must be {what}") from None


def number(name: str, value: Any, unit: str = "", *, zero: bool = False) -> float:
    """Check a finite positive number; `zero` allows zero too."""
    right = isinstance(value, (float, int, np.floating, np.integer)) and not _has_truth(value)
    try:
        found = float(value) if right else math.nan
    except OverflowError:
        found = math.inf
    text = f"{found:g} {unit}".strip() if right else shown(value)
    if not math.isfinite(found):
        raise InputError.of(name, text, "a finite number")
    if found < 0 or (found == 0 and not zero):
        raise InputError.of(name, text, "zero or more" if zero else "positive")
    return found


def share_of_length(name: str, value: Any, length: float | None) -> float:
    """Check a share of a length in m: a number above 0 and below 1, or text such as "1 %".

    Text may also be a length such as "0.5 mm", unless the length is None.
    """
    found, text = math.nan, shown(value)
    if isinstance(value, str):
        text = quote(value)
        with suppress(ValueError):
            if length is None or has_no_unit(value) or value.strip().endswith("%"):
                found = read_share(value)
            else:
                found = read_number(value, "m") / length
    else:
        found = number(name, value)
        text = f"{found:g}"
    if not 0.0 < found < 1.0:
        rule = 'a share of the length above 0 and below 1, such as 0.01 or "1 %"'
        if length is not None:
            rule += ', or a length such as "0.5 mm"'
        raise InputError.of(name, text, rule)
    return found


def whole(name: str, value: Any, low: int, high: int) -> int:
    """Check a whole number from `low` to `high`."""
    if not is_whole(value) or not low <= value <= high:
        raise InputError.of(name, shown(value), f"a whole number from {low} to {high}")
    return int(value)


Object = TypeVar("Object")


def instance(name: str, value: Object | None, kind: type[Object]) -> Object:
    """Check an object's class; None gives the class's default."""
    if value is None:
        return kind()
    if not isinstance(value, kind):
        article = "an" if kind.__name__[0] in "AEIOU" else "a"
        raise InputError.of(name, shown(value), f"{article} {kind.__name__}")
    return value


def truth(name: str, value: Any) -> bool:
    """Check a boolean."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError.of(name, shown(value), "True or False")
    return bool(value)


def choice(name: str, value: Any, words: Sequence[str]) -> None:
    """Refuse a value that is not one of `words`."""
    if not isinstance(value, str) or value not in words:
        listed = " or ".join(f'"{word}"' for word in words)
        raise InputError.of(name, shown(value), listed)


def is_whole(value: object) -> bool:
    """Whether a value is a whole number."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool)


def row(
    name: str,
    value: Any,
    count: int,
    unit: str,
    or_else: str = "",
    least: Floats | float = 0.0,
) -> Floats:
    """Check finite numbers (count,); `or_else` names further allowed values in the error.

    `least` are the least possible tensions in N.
    """
    if isinstance(value, np.ndarray) and value.shape != (count,):
        raise InputError(f"{name} has shape {value.shape}, it must be ({count},), in {unit}")
    found = read(name, value, f"{count} numbers in {unit}{or_else}")
    if found.shape != (count,):
        raise InputError(f"{name} has shape {found.shape}, it must be ({count},), in {unit}")
    check_values(name, found, least=least)
    return found


def numbers(name: str, value: Any, shape: tuple[int, ...], unit: str = "") -> Floats:
    """Convert to a new array of finite numbers of a given shape."""
    found = read(name, value, f"numbers of shape {shape}")
    if found.shape != shape:
        raise InputError(
            f"{name} has shape {found.shape}, it must be {shape}" + (f", in {unit}" if unit else "")
        )
    if not np.isfinite(found).all():
        raise InputError(f"{name} is {found.tolist()}, all must be finite numbers")
    return found


def vectors(name: str, value: Any) -> Floats:
    """Convert to a new array of points (..., 3) in m; NaN is allowed."""
    found = read(name, value, "points (..., 3) in m")
    if found.ndim == 0 or found.shape[-1] != 3:
        raise InputError(f"{name} has shape {found.shape}, it must be points (..., 3) in m")
    return found


def check_values(name: str, row: Floats, when: str = "", least: Floats | float = 0.0) -> None:
    """Refuse values that are not finite, and tensions below the least possible ones in N."""
    if not np.isfinite(row).all():
        raise InputError(f"{name} is {row.tolist()}{when}, all must be finite numbers")
    if "tensions" in name and (row < least).any():
        i = int(np.argmax(row < least))
        raise InputError(
            f"tension of tendon {i + 1} is {row[i]:g} N{when}, a tendon can only pull: "
            "give zero or more"
        )


def check_is_read(data: object) -> None:
    """Refuse the path of a table where its measurements are asked for."""
    if isinstance(data, (str, PathLike)):
        path = str(data)[:100]
        raise InputError(
            f"data is {path!r}, it must be measurements; read them by "
            f"bowstring.read_measurements({path!r}, robot)"
        )
