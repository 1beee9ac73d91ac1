"""Reader of the JSON files that Bowstring wrote: one parser, and a declared structure for each."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import ConfigDict, Field, PlainValidator, TypeAdapter, ValidationError, with_config
from pydantic_core import from_json
from typing_extensions import TypedDict

from bowstring.files.atomic_io import readable

_LONGEST: Final = 100  # characters of a place in a message


@with_config(ConfigDict(strict=True, allow_inf_nan=False))
class Content(TypedDict):
    """Base of the structures: numbers are finite, and keys that are not declared are left out."""


def _row(value: Any) -> Any:
    if not (isinstance(value, list) and {int, float}.issuperset(map(type, value))):
        raise ValueError("must be a list of numbers")
    return _finite(value, (len(value),))


def _table(value: Any) -> Any:
    if not (isinstance(value, list) and {list}.issuperset(map(type, value))):
        raise ValueError("must be rows of numbers")
    if not all({int, float}.issuperset(map(type, row)) for row in value):
        raise ValueError("must be rows of numbers")
    if len(set(map(len, value))) > 1:
        raise ValueError("must be rows of the same length")
    return _finite(value, (len(value), len(value[0]) if value else 0))


def _finite(value: Any, shape: tuple[int, ...]) -> Any:
    try:
        found = np.array(value, dtype=float).reshape(shape)
    except OverflowError:  # a whole number of more than 308 digits
        raise ValueError("must be finite numbers") from None
    if not np.isfinite(found).all():
        raise ValueError("must be finite numbers")
    return found


#: Arrays (n,) and (n, m) of finite numbers, from lists of any length; a table without rows is
#: (0, 0). All wrong numbers together give one error.
Row = Annotated[Any, PlainValidator(_row)]
Table = Annotated[Any, PlainValidator(_table)]
Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


def read_json(path: str | Path, most_bytes: int) -> dict[str, Any]:
    """Read a JSON file that holds an object.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If the file has another content; the text says what it is.
    """
    with readable(path) as file:
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise ValueError(f"it is larger than {most_bytes / 1e6:g} MB")
    content = parsed(data)
    if not isinstance(content, dict):
        raise ValueError("it is no object of JSON")
    return content


def parsed(data: str | bytes) -> Any:
    """Parse JSON.

    Raises
    ------
    ValueError
        If it is not valid JSON, is not in UTF-8, or has more than 200 levels.
    """
    try:
        return from_json(data)
    except (TypeError, ValueError):
        raise ValueError("it is no JSON") from None


@cache
def _adapter(form: Any) -> TypeAdapter[Any]:
    return TypeAdapter(form)


def structured(content: object, form: Any) -> Any:
    """Return content of a declared structure, with its numbers as declared.

    Raises
    ------
    ValueError
        If the structure is another one; the text says where.
    """
    try:
        return _adapter(form).validate_python(content)
    except ValidationError as error:
        wrong = error.errors(include_input=False, include_url=False)[0]
    *above, last = wrong["loc"] or ("",)
    if wrong["type"] == "missing":
        raise ValueError(f"{_place(above) or 'it'} has no {last}")
    sentence = wrong["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    sentence = sentence[:1].lower() + sentence[1:]
    raise ValueError(f"{_place([*above, last])} {sentence}".strip())


def _place(steps: Any) -> str:
    names = [f"[{step}]" if isinstance(step, int) else f".{step}" for step in steps]
    return "".join(names).lstrip(".")[:_LONGEST]
