"""Results that declare the keys of their JSON on their own members.

The annotation of a field or property declares a key, its docstring says the meaning, the shape of
an array and where values are missing; `bowstring.cli.schemas` makes the schema of them::

    difference: Annotated[Array, Key("difference_mm")]
    \"\"\"Distance of the tip from statics (n,), m; NaN without an equilibrium.\"\"\"

Members are in SI. The end of a key is the unit of its values.
"""

from __future__ import annotations

import ast
import inspect
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, Final

import numpy as np
from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

from bowstring.formatting import plain

#: Unit by the end of a key: in words, and how many make one SI unit.
UNITS: Final[dict[str, tuple[str, float]]] = {
    **{name: (name, 1.0) for name in ("m", "rad", "N", "Pa", "kg", "s")},
    **{"mm": ("mm", 1e3), "deg": ("deg", math.degrees(1.0)), "MPa": ("MPa", 1e-6)},
    **{"percent": ("%", 100.0), "m3": ("m³", 1.0), "Nm": ("N m", 1.0), "hz": ("Hz", 1.0)},
    **{"per_m": ("1/m", 1.0), "per_s": ("1/s", 1.0), "m_per_s2": ("m/s²", 1.0)},
    **{"m_per_N": ("m/N", 1.0), "kg_m2": ("kg m²", 1.0)},
}
_END: Final = re.compile(f"_({'|'.join(sorted(UNITS, key=len, reverse=True))})$")


#: No other keys, and no number that is not finite.
STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)

OrNull = float | None


@with_config(STRICT)
class Object(TypedDict):
    """Base of objects of the JSON that are no results, as their keys depend on the data."""


def about(text: str, unit: str | None = None) -> Any:
    """Describe a key of an `Object`; its unit where it does not follow from its end."""
    return Field(description=text, json_schema_extra=None if unit is None else {"unit": unit})


@dataclass(frozen=True)
class Key:
    """Mark of a member that is in the JSON."""

    name: str = ""
    """The key; by default the name of the member."""
    unit: str | None = None
    """Unit in words where the key does not end in it."""
    flat: bool = False
    """Whether the keys of the member, a result, stand beside those of its owner."""


class Result:
    """Base of results: the JSON of the members that declare a key."""

    __slots__ = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the values of all keys, ready for `json.dumps`; None for NaN and infinity."""
        out: dict[str, Any] = {}
        kind: Any = type(self)
        for name, (key, scale) in keys_of(kind).items():
            value = _plain(getattr(self, name), scale)
            out.update(value if key.flat else {key.name: value})
        return out


@cache
def keys_of(kind: Any) -> dict[str, tuple[Key, float]]:
    """Key and scale by member: flat ones first, then fields and properties in their order."""
    found: dict[str, tuple[Key, float]] = {}
    for each in (c for c in reversed(kind.__mro__) if issubclass(c, Result)):
        for name, annotation in _annotations(each):
            if annotation.startswith("Annotated[") and (key := _key(annotation, name)):
                found[name] = key, unit_of(key.name)[1] / unit_of(name)[1]
    return dict(sorted(found.items(), key=lambda item: not item[1][0].flat))


def unit_of(key: str) -> tuple[str, float]:
    """Unit at the end of a key: in words, and how many make one SI unit; "" and 1 without one."""
    end = _END.search(key)
    return UNITS[end[1]] if end else ("", 1.0)


def _annotations(kind: type) -> Iterable[tuple[str, str]]:
    yield from inspect.get_annotations(kind).items()
    for name, member in vars(kind).items():
        made = getattr(member, "fget", None) or getattr(member, "func", None)
        yield name, getattr(made, "__annotations__", {}).get("return", "")


def _key(annotation: str, name: str) -> Key | None:
    """Key in an annotation, whose types need not be known."""
    call: Any = ast.parse(annotation, mode="eval").body.slice.elts[-1]  # type: ignore[attr-defined]
    if getattr(getattr(call, "func", None), "id", "") != "Key":
        return None
    values = {each.arg: ast.literal_eval(each.value) for each in call.keywords}
    return Key(**{"name": ast.literal_eval(call.args[0]) if call.args else name, **values})


def _plain(value: Any, scale: float) -> Any:
    if isinstance(value, Result):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {str(key): _plain(item, scale) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, scale) for item in value]
    if scale != 1.0 and value is not None:
        value = value * scale
    if isinstance(value, np.ndarray) and (value.dtype.kind != "f" or np.isfinite(value).all()):
        return value.tolist()  # as one array: there may be millions of numbers
    return plain(value)
