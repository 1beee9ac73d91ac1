"""Error messages for a robot file: the field, the fault, and what to write."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeVar

from pydantic import BaseModel, ValidationError

from bowstring.errors import InputError
from bowstring.robot.parts import (
    MAX_SEGMENTS,
    Backbone,
    Disks,
    Payload,
    Segment,
    Tendon,
    TendonRing,
)
from bowstring.units import Quantity, has_no_unit, quote

Model = TypeVar("Model", bound=BaseModel)

SYNONYMS: Final = {
    "outer_diameter": "diameter",
    "young": "E",
    "youngs_modulus": "E",
    "elastic_modulus": "E",
    "shear_modulus": "G",
    "poisson": "nu",
    "poisson_ratio": "nu",
    "rho": "density",
    "cables": "tendons",
    "alpha": "angle",
    "ea": "axial_stiffness",
    "mu": "friction",
    "hole": "hole_diameter",
    "preload": "pretension",
}
"""Other names of fields."""


_PARTS: Final[dict[tuple[str, ...], type[BaseModel]]] = {
    ("segments",): Segment,
    ("segments", "backbone"): Backbone,
    ("segments", "disks"): Disks,
    ("segments", "tendons", "ring"): TendonRing,
    ("segments", "tendons", "list"): Tendon,
    ("payloads",): Payload,
}


_MAX_LISTED: Final = 20


def build(model: type[Model], tree: dict[str, Any], label: str) -> Model:
    """Build a robot from the tree of its file; one `InputError` lists all problems."""
    segments = tree.get("segments")
    if isinstance(segments, list) and len(segments) > MAX_SEGMENTS:  # before each one is validated
        most = f"must have at most {MAX_SEGMENTS}"
        raise InputError(f"{label}: segments: got a list of {len(segments)}; {most}.")
    try:
        return model.model_validate(tree)
    except ValidationError as error:
        problems = [line for item in error.errors() for line in _sentences(item, model)]
    first, *others = problems
    more = f" (and {len(others)} more)" if others else ""
    lines = [f"{label}: {first}{more}.", *(f"  {other}." for other in others[:_MAX_LISTED])]
    if len(others) > _MAX_LISTED:
        lines.append(f"  ... and {len(others) - _MAX_LISTED} more.")
    raise InputError("\n".join(lines))


def build_changed(
    make: Callable[[Mapping[str, Any]], Model], overrides: Mapping[str, Any]
) -> Model:
    """Build a robot with overrides; the error names a number that is valid in its usual unit only.

    ``make`` builds it with given overrides.
    """

    def valid(path: str, value: Any) -> bool:
        try:
            make({path: value})
        except InputError:
            return False
        return True

    try:
        return make(overrides)
    except InputError as error:
        for path, value in overrides.items():
            plain = isinstance(path, str) and isinstance(value, (str, float, int))
            units = units_of_field(path) if plain and has_no_unit(str(value)) else None
            if units is None or valid(path, value) or not valid(path, f"{value} {units[1]}"):
                continue
            raise InputError(
                f"{error}\n  {path}: got {value} without a unit, which is {value} {units[0]}; "
                f'write "{value} {units[1]}" if that is meant.'
            ) from None
        raise


def _path(loc: tuple[int | str, ...]) -> str:
    """Write a location as `segments[0].tendons[1].angle`."""
    text = ""
    for i, step in enumerate(loc):
        if isinstance(step, int):
            text += f"[{step}]"
        elif not (step in ("ring", "list") and i and loc[i - 1] == "tendons"):  # pydantic's tags
            shown = step if re.fullmatch(r"\w{1,40}", step) else quote(step)
            text += f".{shown}" if text else shown
    return text


def _sentences(error: Any, model: type[BaseModel]) -> list[str]:
    """Turn one of pydantic's errors into "path: sentence" (several for checks across fields)."""
    kind, loc, given = error["type"], error["loc"], error["input"]
    path = _path(loc)
    if kind == "bowstring_many":
        return list(error["ctx"]["problems"])
    if kind == "bowstring":
        return [f"{path}: {error['ctx']['sentence']}"]
    names = tuple(step for step in loc if isinstance(step, str))
    if kind == "missing":
        return [f"{path}: missing; {_advice(names, model)}"]
    if kind == "extra_forbidden":
        known = _fields_of(_PARTS.get(names[:-1], model))
        near = _nearest(names[-1], known)
        hint = f"; did you mean {near}?" if near else "."
        return [f"{path}: unknown field{hint} Known here: {', '.join(known)}"]
    if kind == "too_short" and given:
        return []  # errors of its entries are reported
    if kind == "too_short":
        return [f"{path}: got an empty list; must have at least one"]
    if kind == "too_long":
        return [f"{path}: got {quote(given)}; must have at most {error['ctx']['max_length']}"]
    return [f"{path}: got {quote(given)}; {_advice(names, model)}"]


def _advice(names: tuple[str, ...], model: type[BaseModel]) -> str:
    """Advice for a field: an example, or the names of its subfields."""
    if names in (("segments",), ("payloads",)):
        return f"must be a list of {names[0]}, each after a '-'"
    if names[-1:] == ("tendons",):
        names = (*names, "ring")
    part = _PARTS.get(names)
    if part is not None:
        return f"must be a set of fields: {', '.join(_fields_of(part))}"
    field = _PARTS.get(names[:-1], model).model_fields[names[-1]]
    example = next(mark.example for mark in field.metadata if hasattr(mark, "example"))
    return f'write for example "{names[-1]}: {example}"'


def units_of_field(path: str) -> tuple[str, str] | None:
    """SI unit and usual unit of the field at a path; None if it has no unit."""
    steps = re.split(r"[.\[\]]+", path)
    names = tuple(name for name in steps if name and name != "*" and not name.isdecimal())
    parts = [_PARTS.get((*names[:-1], *kind)) for kind in ((), ("ring",), ("list",))]
    for part in parts:
        field = part.model_fields.get(names[-1]) if part is not None else None
        for mark in field.metadata if field is not None else ():
            if isinstance(mark, Quantity) and mark.si and mark.vector is None:
                return mark.si, mark.example.partition(" ")[2]
    return None


def paths_of_field(name: str) -> list[str]:
    """Paths for `--set` of the fields of a segment with this name."""
    name = name if name in Backbone.model_fields else SYNONYMS.get(name.lower(), name)
    out = []
    for place, part in _PARTS.items():
        if name in part.model_fields and (*place, name) not in _PARTS and name != "tendons":
            steps = [step for step in place[1:] if step not in ("ring", "list")]
            out.append(".".join(["segments.0", *steps, name]))
    return list(dict.fromkeys(out))


def _fields_of(part: type[BaseModel]) -> list[str]:
    """Names of a part's fields, its own before the shared ones."""
    return sorted(part.model_fields, key=lambda name: name not in part.__annotations__)


def _nearest(name: str, known: list[str]) -> str | None:
    synonym = SYNONYMS.get(name.lower())
    if synonym in known:
        return synonym
    lower = {field.lower(): field for field in known}
    near = difflib.get_close_matches(name.lower(), list(lower), n=1, cutoff=0.5)
    return lower[near[0]] if near else None
