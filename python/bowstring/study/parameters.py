"""The parameters of a robot as a table: value, unit, and whether the robot file gives it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from pydantic import BaseModel

from bowstring.errors import InputError
from bowstring.formatting import significant
from bowstring.robot.model import Robot
from bowstring.robot.parts import Backbone, TendonProperties, TendonRing
from bowstring.robot.sizes import sizes_of
from bowstring.units import Quantity, Share, number_with_unit, rounded

if TYPE_CHECKING:
    from bowstring.study.study import Study

GIVEN: Final = "robot file"
DEFAULT: Final = "left out of the file"
DERIVED: Final = "follows"


@dataclass(frozen=True)
class Parameter:
    """One value of a robot."""

    field: str
    """Field of the robot file, below its segment: ``"backbone.E"``; empty if derived."""
    meaning: str
    """Meaning in words, such as ``"Bending stiffness E I"``."""
    where: str
    """Which segments or tendons have it, counted from 1; empty where all have it."""
    value: str
    """Value with its unit."""
    origin: str
    """`GIVEN`, `DEFAULT` or `DERIVED`."""


@dataclass(frozen=True)
class AssumedValue:
    """A value that the robot file does not give and the report assumes."""

    value: str
    """Name and value with its unit, and its basis if stated."""
    used_for: str
    """Parts of the report that use it, in words."""


def parameters(robot: Robot) -> tuple[Parameter, ...]:
    """List every parameter of a robot; equal values of several segments or tendons once.

    Returns
    -------
    tuple of Parameter
        In the order of the robot file.
    """
    found: dict[tuple[str, str, str], dict[tuple[str, str], list[int]]] = {}
    for of, owners, field, meaning, value, origin in _values(robot):
        of_field = found.setdefault((of, field, meaning), {})
        of_field.setdefault((value, origin), []).extend(owners)
    everyone = {"segment": len(robot.segments), "tendon": len(robot.tendons.segment)}
    out = []
    for (of, field, meaning), values in found.items():
        for (value, origin), owners in values.items():
            where = "" if len(owners) in (0, everyone[of]) else _which(of, owners)
            out.append(Parameter(field, meaning, where, value, origin))
    return tuple(out)


def assumed(study: Study) -> tuple[AssumedValue, ...]:
    """List what the robot file does not give and the report assumes, and for what."""
    actuation = "the effects of friction and elastic tendons in the error budget"
    out = [AssumedValue(each, actuation) for each in study.budget.actuation.assumptions]
    try:
        sizes = sizes_of(study.robot).assumed
    except InputError:  # impossible sizes: there is no drawing
        sizes = ()
    drawing = "drawings" + (" and the solid" if study.solid else "")
    out += [
        AssumedValue(str(each), drawing)
        for each in sizes
        if study.solid or each.field.endswith("hole_diameter")
    ]
    return tuple(out)


_Value = tuple[str, list[int], str, str, str, str]


def _values(robot: Robot) -> Iterator[_Value]:
    """Kind of owner, owners from 1, field, meaning, value with unit, origin."""
    first = 1
    for k, segment in enumerate(robot.segments, 1):
        yield from _fields("segment", [k], segment, "")
        yield from _fields("segment", [k], segment.backbone, "backbone.")
        yield "segment", [k], "", "Bending stiffness E I", _bending(robot, k - 1), DERIVED
        yield from _fields("segment", [k], segment.disks, "disks.")
        tendons = segment.tendons
        parts = (tendons,) if isinstance(tendons, TendonRing) else tendons
        for part in parts:
            count = part.count if isinstance(part, TendonRing) else 1
            yield from _fields("tendon", [*range(first, first + count)], part, "tendons.")
            first += count
    text = " ".join(_text(g, "m/s^2").removesuffix(" m/s²") for g in robot.gravity) + " m/s²"
    origin = GIVEN if "gravity" in robot.model_fields_set else DEFAULT
    yield "segment", [], "gravity", "Gravity in the base frame", text, origin


def _fields(of: str, owners: list[int], part: BaseModel, prefix: str) -> Iterator[_Value]:
    fields = type(part).model_fields
    # of a tendon: where it is, before its other properties
    shared = TendonProperties.model_fields if isinstance(part, TendonProperties) else ()
    for name in sorted(fields, key=lambda name: name in shared):
        info = fields[name]
        value: Any = getattr(part, name)
        if value is None or isinstance(value, BaseModel) or name in ("name", "tendons"):
            continue
        if isinstance(part, Backbone) and name in part.replaced:
            continue
        mark = next((m for m in info.metadata if isinstance(m, (Quantity, Share))), None)
        si = mark.si if isinstance(mark, Quantity) else ""
        if isinstance(mark, Share):
            text = f"{rounded(100.0 * value, 4)} %"
        elif name == "stiffness":
            rows = ("  ".join(f"{entry:.6g}" for entry in row) for row in value)
            text = f"{'; '.join(rows)} (SI)"
        elif isinstance(value, tuple):
            text = ", ".join(_text(each, si) for each in value)
        else:
            text = value if isinstance(value, str) else _text(value, si)
        meaning = (info.description or "").split(";")[0].rstrip(".")
        origin = GIVEN if name in part.model_fields_set else DEFAULT
        yield of, owners, prefix + name, meaning, text, origin


def _bending(robot: Robot, segment: int) -> str:
    """Bending stiffness of a segment, or both where it depends on the axis."""
    both = 1.0 / np.linalg.eigvalsh(robot.bend_by_moment[segment] / robot.segments[segment].length)
    low, high = (significant(float(stiffness), 4) for stiffness in sorted(both))
    return f"{low} N m²" if low == high else f"{low} to {high} N m², by axis"


_UNITS: Final = {
    "rad": ("°", math.pi / 180.0),
    "m/N": (" mm/N", 1e-3),
    "kg/m^3": (" kg/m³", 1.0),
    "m/s^2": (" m/s²", 1.0),
}


def _text(value: float, si: str) -> str:
    if si in _UNITS:
        unit, factor = _UNITS[si]
        return f"{rounded(value / factor, 6)}{unit}"
    return number_with_unit(value, si).rstrip()


def _which(kind: str, owners: list[int]) -> str:
    """`segment 1`, `tendons 4 to 6`, `tendons 1, 2, 5`."""
    if len(owners) == 1:
        return f"{kind} {owners[0]}"
    if owners == [*range(owners[0], owners[-1] + 1)]:
        word = "and" if len(owners) == 2 else "to"
        return f"{kind}s {owners[0]} {word} {owners[-1]}"
    return f"{kind}s {', '.join(map(str, owners))}"
