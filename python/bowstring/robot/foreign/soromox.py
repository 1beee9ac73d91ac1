"""Robots of soromox: scripts that make links (LinkSpec, PCSParams) and tendons (ThreadlikeRouting).

Its material frame has x along the backbone: its y and z are Bowstring's x and y.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError
from bowstring.robot.draft import Draft, Field, quantity, tendon, vector
from bowstring.robot.foreign.values import Call, Unreadable, Values, number, numbers, python

__all__ = ["draft"]

Floats = NDArray[np.float64]

_NAMES: Final = {
    "length": ("length", "L"),
    "E": ("young_modulus", "E"),
    "G": ("shear_modulus",),
    "nu": ("nu",),
    "density": ("density", "rho"),
}
_PCS: Final = ("length", "radius", "density", "young_modulus", "shear_modulus")
_INDICES: Final = ("start_segment_index", "end_segment_index")
_UPRIGHT: Final = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0)  # its default


def draft(text: str, label: str) -> Draft:
    """Draft a soft robot, whose tendons run in its body, from the last one that a script makes."""
    values = python(text)
    if values is None:
        raise InputError(f"{label}: not valid Python.")
    links = list(_links(values, label))
    if not links:
        raise InputError(
            f"{label}: no link with numbers that stand in the script outside functions; it must "
            "call LinkSpec, LinkSpec.circular, LinkSpec.rectangular or PCSParams."
        )
    ends = np.cumsum([length for length, *_ in links])
    tendons = list(_tendons(values, ends, label))
    around: dict[str, Any] = {}
    widest = max((radius for *_, radius in tendons), default=0.0)
    if widest >= min(radius for *_, radius in links):  # what has no mass holds the tendons' paths
        around["disks"] = {"radius": Field(quantity(1.2 * widest, "m"), "holds the tendons' paths")}
    segments = [
        {
            "length": quantity(length, "m"),
            "backbone": backbone,
            "tendons_in": "body",
            **around,
            "tendons": [line for k, line, _ in tendons if k == i] or "[]",
        }
        for i, (length, backbone, _) in enumerate(links)
    ]
    fields = {"gravity": _gravity(values, label), "segments": segments}
    notes = ["Not converted: damping and joints."]
    order = sorted(range(len(tendons)), key=lambda i: tendons[i][0])
    if order != list(range(len(tendons))):
        theirs = ", ".join(str(i + 1) for i in order)
        notes.append(f"Tendons 1 to {len(order)} are tendons {theirs} of the script.")
    return Draft(fields, notes=notes)


def _links(values: Values, label: str) -> Iterator[tuple[float, dict[str, Any], float]]:
    """Length, backbone and largest radius of each link from base to tip."""
    bodies = [call for call in values.calls if call.name.rpartition(".")[2] == "PCSParams"]
    if bodies:
        given = bodies[-1].keywords
        try:
            arrays = {k: numbers(v) for k, v in given.items() if k in _PCS}
            count = arrays["length"].size
            arrays = {k: np.broadcast_to(v, count) for k, v in arrays.items()}
            rows = [{k: float(v[i]) for k, v in arrays.items()} for i in range(count)]
        except (Unreadable, KeyError, ValueError):
            raise InputError(
                f"{label}: PCSParams: its numbers do not stand in the script."
            ) from None
        calls = [Call("LinkSpec.circular", (), row) for row in rows]
    else:
        made = [call for call in values.calls if call.name.endswith("GVSSegment")]
        held = [call.keywords.get("link") for call in made]
        specs = [c for c in values.calls if c.name.partition(".")[0] == "LinkSpec"]
        calls = [each for each in held if isinstance(each, Call)] if made else specs
        if len(calls) != len(held or calls):
            raise InputError(f"{label}: GVSSegment: its link does not stand in the script.")
    for k, call in enumerate(calls, 1):
        yield _link(call, f"{label}: link {k}")


def _link(call: Call, where: str) -> tuple[float, dict[str, Any], float]:
    found: dict[str, float] = {}
    for name, others in _NAMES.items():
        for other in others:
            if call.keywords.get(other) is not None:
                found[name] = number(call.keywords[other], f"{where}: {other}")
    for name in ("length", "E", "density"):
        if name not in found:
            raise InputError(f"{where}: no number for {' or '.join(_NAMES[name])}.")
    backbone: dict[str, Any] = {}
    sizes = _sizes(call, where)
    for name, (base, tip) in sizes.items():
        field, times = ("diameter", 2.0) if name == "radius" else (name, 1.0)
        backbone[field] = quantity(times * base, "m")
        if tip != base:
            backbone[f"end_{field}"] = quantity(times * tip, "m")
    if "width" in backbone:
        backbone["width_direction"] = Field("90 deg", "its width is along its z, which is y here")
    backbone["E"] = quantity(found["E"], "Pa")
    if "G" in found:
        backbone["G"] = quantity(found["G"], "Pa")
    else:
        nu = found.get("nu")
        backbone["nu"] = Field("0.5", assumed="nu") if nu is None else quantity(nu, "")
    backbone["density"] = quantity(found["density"], "kg/m^3")
    largest = max(max(ends) for ends in sizes.values())
    return found["length"], backbone, largest if "radius" in sizes else largest / 2


def _sizes(call: Call, where: str) -> dict[str, tuple[float, float]]:
    """Sizes of the section at base and tip; a profile has both."""
    given = call.keywords
    sizes = {}
    for name, short in (("radius", "r"), ("height", "h"), ("width", "w")):
        ends = [given.get(f"{short}_{end}") for end in "if"]
        one = given.get(name, given.get(short))
        if isinstance(one, Call) and one.name.endswith("LinearProfile"):
            ends = [one.keywords.get("base"), one.keywords.get("tip")]
            ends = list(one.arguments) or ends
        elif one is not None:
            ends = [one if end is None else end for end in ends]
        if len(ends) == 2 and ends[0] is not None and ends[1] is not None:
            first, last = (number(end, f"{where}: {name}") for end in ends)
            sizes[name] = (first, last)
    if set(sizes) not in ({"radius"}, {"height", "width"}):
        raise InputError(f"{where}: its section must be circular or rectangular, with numbers.")
    return sizes


def _tendons(values: Values, ends: Floats, label: str) -> Iterator[tuple[int, str, float]]:
    """Segment, line and largest radius of each tendon, whose offset is linear in arc length."""
    actuators = [c for c in values.calls if c.name.startswith("ThreadlikeActuator.")]
    other = next((c.name for c in actuators if c.name != "ThreadlikeActuator.tendons"), "")
    if other:
        raise InputError(f"{label}: {other}: only ThreadlikeActuator.tendons is converted.")
    for actuator in actuators:
        routing = actuator.arguments[0] if actuator.arguments else actuator.keywords.get("routing")
        if not isinstance(routing, Call) or routing.name != "ThreadlikeRouting.linear":
            raise InputError(f"{label}: the routing of tendons must be ThreadlikeRouting.linear.")
        try:
            start = np.atleast_2d(numbers(routing.keywords["intercept"]))
            given = [routing.keywords.get(name, 0.0) for name in ("slope", *_INDICES)]
            slope, first, last = (numbers(each) for each in given)
            slope = np.broadcast_to(slope, start.shape)
            first, last = (np.broadcast_to(each, len(start)).astype(int) for each in (first, last))
            if start.shape[1:] != (3,) or not (0 <= last.min() <= last.max() < len(ends)):
                raise Unreadable
        except (Unreadable, KeyError, ValueError):
            raise InputError(
                f"{label}: ThreadlikeRouting.linear: its numbers do not stand in the script, or do "
                "not fit its links."
            ) from None
        for i, (a, b, k) in enumerate(zip(start[:, 1:], slope[:, 1:], last, strict=True), 1):
            end = a + b * ends[k]
            turned = abs(a[0] * b[1] - a[1] * b[0]) > 1e-9 * np.hypot(*a) * np.hypot(*b)
            if first[i - 1] or turned or a @ end < 0 or not a.any():
                raise InputError(
                    f"{label}: tendon {i} of ThreadlikeRouting.linear begins beyond the base, "
                    "crosses the axis or turns about it, which is not converted."
                )
            radii = float(np.hypot(*a)), float(np.hypot(*end))
            more = {"end_pitch_radius": quantity(radii[1], "m")} if b.any() else {}
            yield int(k), tendon(math.atan2(a[1], a[0]), radii[0], **more), max(radii)


def _gravity(values: Values, label: str) -> Field:
    """Gravity in the frame of the base, from both in the frame of the world."""
    given = [c.keywords for c in values.calls if {"base_pose", "gravity"} & c.keywords.keys()]
    stated = given[-1] if given else {}
    try:
        w, x, y, z = numbers(stated.get("base_pose", _UPRIGHT))[:4]
        world = numbers(stated.get("gravity", (0.0, 0.0, -9.81))).reshape(3)
    except (Unreadable, ValueError):
        raise InputError(
            f"{label}: base_pose and gravity: their numbers do not stand in the script."
        ) from None
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    along, first, second = np.round(turn.T @ world, 12)
    comment = "turned into the frame of the base"
    if "gravity" not in stated:
        return Field(vector((first, second, along), "m/s^2"), "", "gravity")
    return Field(vector((first, second, along), "m/s^2"), comment)
