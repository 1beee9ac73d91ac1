"""Results declare the keys of their JSON: the values of `to_dict`, and the schema."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from bowstring.aliases import Floats
from bowstring.cli.schemas.results import object_of
from bowstring.results import Key, Result, keys_of, unit_of


@dataclass(frozen=True)
class Ends(Result):
    """Ends of a range."""

    low: Annotated[float, Key("low_mm")]
    """Lower end, m."""
    high: Annotated[float, Key("high_mm")]
    """Upper end, m; infinite without one."""


@dataclass(frozen=True, eq=False)
class Whole(Result):
    """A result of every kind of member.

    The second paragraph is for readers of the code.
    """

    ends: Annotated[Ends, Key(flat=True)]
    """Ends."""
    tip: Annotated[Floats, Key("tip_position_mm")]
    """Tip (n, 3), m; NaN without an equilibrium."""
    share: Annotated[float, Key("valid_percent")]
    """Share of the loads."""
    bend: Annotated[tuple[float, float], Key("bend_deg")]
    """Bend in both planes, rad."""
    kept_mm: Annotated[float, Key("rest_mm")]
    """What is left, in mm already."""
    kind: Annotated[Literal["a", "b"], Key()]
    """Kind: ``a`` or ``b``."""
    parts: Annotated[Mapping[str, Ends], Key()]
    """Ends by name."""
    status: Annotated[bool | None, Key(unit="1 or Pa")]
    """Whether it holds; None if that is not known."""
    hidden: int = 0
    """No key."""

    @property
    def count(self) -> Annotated[int, Key("n")]:
        """Number of loads."""
        return len(self.tip)

    @cached_property
    def names(self) -> Annotated[tuple[str, ...], Key()]:
        """Names of the parts."""
        return tuple(self.parts)


def whole(**changes: Any) -> Whole:
    given: dict[str, Any] = {
        "ends": Ends(0.001, np.inf),
        "tip": np.array([[0.1, 0.2, 0.3], [np.nan] * 3]),
        "share": 0.25,
        "bend": (np.pi, 0.0),
        "kept_mm": 7.0,
        "kind": "a",
        "parts": {"one": Ends(0.0, 2.0)},
        "status": None,
    }
    return Whole(**{**given, **changes})


def test_values_are_plain_and_in_the_units_of_their_keys() -> None:
    found = whole().to_dict()
    assert json.loads(json.dumps(found, allow_nan=False)) == {
        **{"low_mm": 1.0, "high_mm": None, "tip_position_mm": [[100.0, 200.0, 300.0], [None] * 3]},
        **{"valid_percent": 25.0, "bend_deg": [180.0, 0.0], "rest_mm": 7.0, "kind": "a"},
        **{"parts": {"one": {"low_mm": 0.0, "high_mm": 2000.0}}, "status": None},
        **{"n": 2, "names": ["one"]},
    }


def test_a_subclass_adds_keys_and_replaces_those_of_a_flat_result() -> None:
    @dataclass(frozen=True)
    class More(Ends):
        count: Annotated[int, Key("high_mm", unit="")]

    @dataclass(frozen=True)
    class Own(Result):
        ends: Annotated[Ends, Key(flat=True)]
        low: Annotated[float, Key("low_mm")]

    assert More(1.0, 2.0, 3).to_dict() == {"low_mm": 1000.0, "high_mm": 3000}
    assert Own(Ends(1.0, 2.0), 5.0).to_dict() == {"low_mm": 5000.0, "high_mm": 2000.0}
    assert list(keys_of(Own)) == ["ends", "low"]  # flat ones first


@pytest.mark.parametrize(
    ("key", "unit"),
    [
        ("tip_position_mm", ("mm", 1e3)),
        ("compliance_m_per_N", ("m/N", 1.0)),
        ("damping_per_s", ("1/s", 1.0)),
        ("count", ("", 1.0)),
        ("mm", ("", 1.0)),
    ],
)
def test_the_end_of_a_key_is_its_unit(key: str, unit: tuple[str, float]) -> None:
    assert unit_of(key) == unit


def test_the_schema_follows_from_annotations_and_docstrings() -> None:
    schema = TypeAdapter(object_of(Whole)).json_schema()
    assert (schema["title"], schema["description"]) == (
        "Whole",
        "A result of every kind of member.",
    )
    assert sorted(schema["required"]) == sorted(whole().to_dict())
    keys = schema["properties"]
    assert {key: about["description"] for key, about in keys.items()} == {
        **{"low_mm": "Lower end.", "high_mm": "Upper end; `null` without one."},
        **{"tip_position_mm": "Tip; `null` without an equilibrium."},
        **{"valid_percent": "Share of the loads.", "bend_deg": "Bend in both planes."},
        **{"rest_mm": "What is left, in mm already.", "kind": "Kind: `a` or `b`."},
        **{"parts": "Ends by name.", "status": "Whether it holds; `null` if that is not known."},
        **{"n": "Number of loads.", "names": "Names of the parts."},
    }
    row = keys["tip_position_mm"]["items"]
    assert (row["minItems"], row["maxItems"]) == (3, 3)
    assert row["items"] == {"anyOf": [{"type": "number"}, {"type": "null"}]}
    assert keys["low_mm"]["type"] == "number" and keys["status"]["unit"] == "1 or Pa"
    assert keys["kind"]["enum"] == ["a", "b"] and keys["bend_deg"]["maxItems"] == 2
    assert keys["parts"]["additionalProperties"] == {"$ref": "#/$defs/Ends"}


@pytest.mark.parametrize(
    "changes",
    [
        {"ends": Ends(np.nan, 1.0)},  # its docstring names no NaN
        {"tip": np.zeros((2, 2))},
        {"kind": "c"},
        {"kept_mm": "much"},
        {"parts": {"one": 1.0}},
    ],
)
def test_the_schema_is_strict(changes: dict[str, Any]) -> None:
    check = TypeAdapter(object_of(Whole)).validate_python
    check(whole().to_dict(), strict=True)
    with pytest.raises(ValidationError):
        check(whole(**changes).to_dict(), strict=True)
    for wrong in ({"more": 1}, {"n": None}):
        with pytest.raises(ValidationError):
            check({**whole().to_dict(), **wrong}, strict=True)


def test_an_array_without_a_shape_in_its_docstring_has_no_schema() -> None:
    with pytest.raises(ValueError, match="has no shape of its array: Tip, m"):
        object_of(Shapeless)


@dataclass(frozen=True, eq=False)
class Shapeless(Result):
    """A result whose docstring lacks the shape of its array."""

    tip: Annotated[Floats, Key("tip_m")]
    """Tip, m."""
