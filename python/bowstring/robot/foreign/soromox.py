"""Robots of soromox: scripts that make links (LinkSpec, PCSParams) and tendons (ThreadlikeRouting).

Its material frame has x along the backbone: its y and z are Bowstring's x and y.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError
from bowstring.robot.draft import Draft, Field, quantity, tendon, vector
from bowstring.robot.foreign.values import Call, Values, numbers, python

#: Numbers of a link, and their names there.
_NAMES: Final = {
    "length": ("length", "L"),
    "E": ("young_modulus", "E"),
    "density": ("density", "rho"),
    "G": ("shear_modulus",),
    "nu": ("poisson_ratio", "nu"),
}
_ROBOTS: Final = ("PCSParams", "params_from_links", "from_links", "from_segments")
_UPRIGHT: Final = (math.sqrt(0.5), 0.0, -math.sqrt(0.5), 0.0, 0.0, 0.0, 0.0)  # its default


def draft(text: str, label: str) -> Draft:
    """Draft a soft robot, whose tendons run in its body, from the last one that a script makes."""
    values = python(text, label)
    made = [call for call in values.calls if call.name.rpartition(".")[2] in _ROBOTS]
    given = _links(made[-1]) if made else []
    if not given:
        raise InputError(
            f"{label}: no robot whose links stand in the script outside functions and loops; it "
            f"must call one of {', '.join(_ROBOTS)}."
        )
    links = [_sizes(link, f"{label}: link {k}") for k, link in enumerate(given, 1)]
    tendons = _tendons(values, np.cumsum([link["length"] for link in links]), label)
    around: dict[str, Any] = {}
    widest = max((radius for *_, radius in tendons), default=0.0)
    if widest >= min(min(link["base"], link["tip"]) for link in links):
        radius = quantity(1.2 * widest, "m")
        around["disks"] = {"radius": Field(radius, "without mass; holds the tendons' paths")}
    segments = [
        {
            "length": quantity(link["length"], "m"),
            "backbone": _backbone(link),
            "tendons_in": "body",
            **around,
            "tendons": [line for end, line, _ in tendons if end == k] or "[]",
        }
        for k, link in enumerate(links)
    ]
    fields = {"gravity": _gravity(made[-1].keywords, label), "segments": segments}
    notes = ["Not converted: damping and joints."]
    order = sorted(range(len(tendons)), key=lambda i: tendons[i][0])
    if order != list(range(len(tendons))):
        theirs = ", ".join(str(i + 1) for i in order)
        notes.append(f"Tendons 1 to {len(order)} are tendons {theirs} of the script.")
    return Draft(fields, notes)


def _links(robot: Call) -> list[dict[str, Any]]:
    """Arguments of each link from base to tip; none if they are unknown."""
    given = robot.keywords
    if robot.name.endswith("PCSParams"):
        names = ("radius", *(names[0] for names in _NAMES.values()))
        try:
            arrays = {name: numbers(given[name]) for name in names if name in given}
            rows = map(np.atleast_1d, np.broadcast_arrays(*arrays.values()))
        except ValueError:
            return []
        return [dict(zip(arrays, row, strict=True)) for row in zip(*rows, strict=True)]
    parts = robot.arguments[0] if robot.arguments else given.get("segments", given.get("links"))
    links = []
    for part in parts if isinstance(parts, list) else ():
        if isinstance(part, Call) and part.name.endswith("GVSSegment"):
            part = part.keywords.get("link")
        if not isinstance(part, Call) or part.name not in ("LinkSpec", "LinkSpec.circular"):
            return []
        links.append(part.keywords)
    return links


def _sizes(link: dict[str, Any], where: str) -> dict[str, float]:
    """Numbers of a link, with the radius at its base and tip."""
    given = {field: link[name] for field, names in _NAMES.items() for name in names if name in link}
    one = link.get("radius", link.get("r"))
    given |= {"base": link.get("r_i", one), "tip": link.get("r_f", one)}
    if isinstance(one, Call) and one.name.endswith("LinearProfile"):
        given |= dict(zip(("base", "tip"), one.arguments, strict=False)) | one.keywords
    found = {}
    for field in ("length", "E", "density", "base", "tip", *given):
        try:
            found[field] = float(numbers(given.get(field)).reshape(()))
        except ValueError:
            name = _NAMES.get(field, ("radius",))[0]
            raise InputError(f"{where}: {name}: no number that stands in the script.") from None
    return found


def _backbone(link: dict[str, float]) -> dict[str, Any]:
    backbone: dict[str, Any] = {"diameter": quantity(2 * link["base"], "m")}
    if link["tip"] != link["base"]:
        backbone["end_diameter"] = quantity(2 * link["tip"], "m")
    backbone["E"] = quantity(link["E"], "Pa")
    if "G" in link:
        backbone["G"] = quantity(link["G"], "Pa")
    else:
        nu = quantity(link["nu"], "") if "nu" in link else Field("0.5", assumed="nu")
        backbone["nu"] = nu
    return {**backbone, "density": quantity(link["density"], "kg/m^3")}


def _tendons(values: Values, ends: NDArray[Any], label: str) -> list[tuple[int, str, float]]:
    """Segment, line and largest radius of each tendon, whose offset is linear in arc length."""
    robots = [call.keywords["actuators"] for call in values.calls if "actuators" in call.keywords]
    actuators = robots[-1] if robots else []
    found = []
    for actuator in actuators if isinstance(actuators, list) else [actuators]:
        is_tendons = isinstance(actuator, Call) and actuator.name == "ThreadlikeActuator.tendons"
        routing = (actuator.arguments or [None])[0] if is_tendons else None
        if not isinstance(routing, Call) or routing.name != "ThreadlikeRouting.linear":
            raise InputError(
                f"{label}: actuators must be ThreadlikeActuator.tendons(routing) with a routing of "
                "ThreadlikeRouting.linear, which stand in the script outside functions and loops."
            )
        names = ("slope", "start_segment_index", "end_segment_index")
        try:
            start = np.atleast_2d(numbers(routing.keywords["intercept"]))
            slope, first, last = (numbers(routing.keywords.get(name, 0.0)) for name in names)
            slope = np.broadcast_to(slope, start.shape)
            first, last = (np.broadcast_to(each, len(start)).astype(int) for each in (first, last))
            if start.shape != (len(start), 3) or not (0 <= last.min() <= last.max() < len(ends)):
                raise ValueError
        except (KeyError, ValueError):
            raise InputError(
                f"{label}: ThreadlikeRouting.linear: its numbers do not stand in the script, or do "
                "not fit its links."
            ) from None
        for i, (a, b, k) in enumerate(zip(start[:, 1:], slope[:, 1:], last, strict=True)):
            end = a + b * ends[k]
            turned = abs(a[0] * b[1] - a[1] * b[0]) > 1e-9 * np.hypot(*a) * np.hypot(*b)
            if first[i] or turned or a @ end < 0 or not a.any():
                raise InputError(
                    f"{label}: tendon {i + 1} of ThreadlikeRouting.linear begins beyond the base, "
                    "crosses the axis or turns about it, which is not converted."
                )
            more = {"end_pitch_radius": quantity(np.hypot(*end), "m")} if b.any() else {}
            found.append((int(k), tendon(a[0], a[1], **more), max(np.hypot(*a), np.hypot(*end))))
    return found


def _gravity(robot: dict[str, Any], label: str) -> Field:
    """Gravity in the frame of the base, from both in the frame of the world."""
    try:
        w, x, y, z = numbers(robot.get("base_pose", _UPRIGHT)).reshape(7)[:4]
        world = numbers(robot.get("gravity", (0.0, 0.0, -9.81))).reshape(3)
    except ValueError:
        raise InputError(
            f"{label}: base_pose and gravity: their numbers do not stand in the script."
        ) from None
    axes = np.array(
        [
            [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
            [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
            [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        ]
    )
    text = vector(np.round(axes @ world, 12), "m/s^2")
    if "gravity" not in robot:
        return Field(text, assumed="gravity")
    return Field(text, "turned into the frame of the base")
