"""Draft of a robot file: fields as text with comments, and what in it is assumed."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from bowstring.units import number_with_unit, printable, rounded

_COLUMN: Final = 34  # of the comments
_DIGITS: Final = 12


class Field(NamedTuple):
    """A value as text, its comment, and, if it is assumed, its name in the list of assumptions."""

    text: str
    comment: str = ""
    assumed: str = ""


@dataclass
class Draft:
    """A robot file to be written.

    Attributes
    ----------
    fields : dict
        Fields of the file by name: a `Field`, text, a dict of fields or a list of either.
    notes : sequence of str
        Sentences for the user on what was left out; also comments of the file.
    head : str
        First line of the file, without ``#``.
    """

    fields: dict[str, Any]
    notes: Sequence[str] = ()
    head: str = ""

    @property
    def assumed(self) -> list[str]:
        """Name and value of each assumption, without repetitions."""
        return list(dict.fromkeys(f"{f.assumed} {f.text}" for f in _all(self.fields) if f.assumed))

    @property
    def text(self) -> str:
        """Text of the file."""
        head = [f"# {printable(line)}" for line in (self.head, *self.notes)]
        return "\n".join([*head, *_lines(self.fields, "")]) + "\n"


def _all(value: Any) -> Iterator[Field]:
    if isinstance(value, Field):
        yield value
    elif isinstance(value, (dict, list)):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _all(each)


def _lines(fields: Mapping[str, Any], blank: str) -> Iterator[str]:
    for name, value in fields.items():
        if isinstance(value, dict):
            yield f"{blank}{name}:"
            yield from _lines(value, f"{blank}  ")
        elif isinstance(value, list):
            yield f"{blank}{name}:"
            for each in value:
                lines = list(_lines(each, f"{blank}    ")) if isinstance(each, dict) else [each]
                yield f"{blank}  - {lines[0].lstrip()}"
                yield from lines[1:]
        else:
            text, comment, assumed = value if isinstance(value, Field) else Field(value)
            comment = comment or ("assumed: not in the file" if assumed else "")
            line = f"{blank}{name}: {text}"
            yield f"{line:<{_COLUMN - 2}}  # {comment}" if comment else line


def plain_text(text: str) -> str:
    """Text as a value of YAML, quoted where it must be."""
    return text if re.fullmatch(r"[A-Za-z][\w.-]*", text, re.ASCII) else json.dumps(text)


def quantity(value: float, si: str) -> str:
    """Number in its usual unit, to 12 digits."""
    return number_with_unit(float(value), si, _DIGITS)


def vector(values: Iterable[float], si: str) -> str:
    """Numbers of a vector with one unit."""
    return " ".join([*(rounded(float(value) + 0.0, _DIGITS) for value in values), si])


def tendon(x: float, y: float, **more: str) -> str:
    """One tendon of a list: its hole's position (m) as angle and radius, and more fields."""
    angle = rounded(math.degrees(math.atan2(y, x)) + 0.0, _DIGITS)
    fields = {"angle": f"{angle} deg", "pitch_radius": quantity(math.hypot(x, y), "m"), **more}
    return "{" + ", ".join(f"{name}: {text}" for name, text in fields.items()) + "}"
