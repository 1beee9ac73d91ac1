"""Robots of opencr-mujoco: its JSON configurations."""

from __future__ import annotations

import json
import math
from typing import Any

from bowstring.errors import InputError
from bowstring.robot.draft import Draft, Field, quantity, tendon, vector
from bowstring.units import quote

__all__ = ["draft"]

_LEFT_OUT = "Not converted: actuator_properties (gain, pretension, limits), damping and mounting."


def draft(text: str, label: str) -> Draft:
    """Draft a robot from a configuration, or from ``generator_config`` in one of an evaluation.

    The rigid links become disks without mass, as the links' mass is that of the backbone.
    """
    try:
        tree = json.loads(text, parse_int=float)
    except (ValueError, RecursionError):
        raise InputError(f"{label}: not valid JSON.") from None
    given = _Fields(tree, label)
    if isinstance(tree, dict) and isinstance(tree.get("generator_config"), dict):
        given = _Fields(tree["generator_config"], label, "generator_config.")
    mode = given.get("joint_config_mode", "direct")
    if not given.get("modular", False) and mode != "material":
        raise InputError(
            f"{label}: joint_config_mode: got {quote(mode)}; must be material, as a stiffness of "
            "joints states no modulus and no diameter."
        )
    if given.get("independent_segments", False):
        raise InputError(
            f"{label}: independent_segments: tendons that skip inner segments are not modelled."
        )
    routed = given.get("actuation_mode", "direct_torque") == "parallel_tendons"
    segments: list[dict[str, Any]] = []
    for k, (modules, ring) in enumerate(_parts(given)):
        segments += [{**module, "tendons": "[]"} for module in modules]
        if routed:
            segments[-1]["tendons"] = _tendons(given, ring, k)
    if not routed:
        segments = [{**segment, "tendons_in": "body"} for segment in segments]
        for segment in segments:
            del segment["disks"]
    down = given.get("gravity", "0 0 -9.81")
    try:
        gravity = [float(word) for word in down.split()]
        assert len(gravity) == 3 and all(map(math.isfinite, gravity))
    except (AttributeError, ValueError, AssertionError):
        raise InputError(
            f'{label}: gravity: got {quote(down)}; must be three numbers such as "0 0 -9.81".'
        ) from None
    fields = {
        "gravity": Field(vector(gravity, "m/s^2"), "in the robot's own frame: mounting is not read")
        if any(gravity)
        else vector(gravity, "m/s^2"),
        "segments": segments,
    }
    return Draft(fields, notes=(_LEFT_OUT,))


class _Fields:
    """Fields of a set of the configuration, checked where they are read."""

    def __init__(self, tree: Any, label: str, path: str = "") -> None:
        self.label, self.path = label, path
        if not isinstance(tree, dict):
            where = f"{path.rstrip('.')}: " if path else ""
            raise InputError(f"{label}: {where}got {quote(tree)}; must be a set of fields.")
        self.tree = tree

    def get(self, name: str, default: Any) -> Any:
        return self.tree.get(name, default)

    def inner(self, name: str) -> _Fields:
        return _Fields(self.tree.get(name), self.label, f"{self.path}{name}.")

    def entries(self, name: str) -> list[_Fields]:
        found = self.tree.get(name)
        if not isinstance(found, list) or not found:
            raise InputError(
                f"{self.label}: {self.path}{name}: got {quote(found)}; must be a list."
            )
        return [_Fields(e, self.label, f"{self.path}{name}[{i}].") for i, e in enumerate(found)]

    def count(self, name: str, default: float | None = None) -> int:
        value = self.number(name, default)
        if not 1 <= value <= 1000 or value % 1:
            raise InputError(
                f"{self.label}: {self.path}{name}: got {value:g}; must be a whole number from 1 to "
                "1000."
            )
        return int(value)

    def number(self, name: str, default: float | None = None) -> float:
        value = self.tree.get(name, default)
        if isinstance(value, bool) or not isinstance(value, float) or not math.isfinite(value):
            got = "missing" if value is None else f"got {quote(value)}"
            raise InputError(f"{self.label}: {self.path}{name}: {got}; must be a number.")
        return value


def _parts(given: _Fields) -> list[tuple[list[dict[str, Any]], _Fields | None]]:
    """Modules of each segment from base to tip, and its tendons."""
    if given.get("modular", False):
        library = given.inner("module_library")
        found = []
        for segment in given.entries("segments"):
            names = segment.get("modules", None)
            if not isinstance(names, list) or not names:
                raise InputError(f"{given.label}: {segment.path}modules: must name modules.")
            modules = [_module(library.inner(str(name))) for name in names]
            rings = segment.tree.get("actuation")
            found.append((modules, segment.inner("actuation") if rings else None))
        return found
    count = given.count("num_segments", 1.0)
    own = given.get("material_properties_per_segment", None)
    materials = given.entries("material_properties_per_segment") if own else []
    rings = []
    if given.get("actuation_mode", "") == "parallel_tendons":
        rings = given.inner("actuation_details").entries("segments")
    for name, listed in (("material_properties_per_segment", materials), ("segments", rings)):
        if listed and len(listed) < count:
            raise InputError(
                f"{given.label}: {name}: got {len(listed)} entries for {count} segments."
            )
    parts = []
    for k in range(count):
        material = materials[k] if materials else given.inner("material_properties")
        if count == 1 and "segment_lengths" not in given.tree:
            length, links = given.number("total_length"), given.number("total_links", 10.0)
        else:
            length = given.inner("segment_lengths").number(str(k + 1))
            links = given.inner("links_per_segment").number(str(k + 1))
        parts.append(([_sizes(given, material, length, links)], rings[k] if rings else None))
    return parts


def _module(module: _Fields) -> dict[str, Any]:
    length, links = module.number("length"), module.number("num_links")
    return _sizes(module, module.inner("material_properties"), length, links)


def _sizes(owner: _Fields, material: _Fields, length: float, links: float) -> dict[str, Any]:
    radius = owner.number("radius", 0.035)  # its default
    inner = material.number("inner_radius", 0.0)
    bore = {"inner_diameter": quantity(2 * inner, "m")} if inner else {}
    return {
        "length": quantity(length, "m"),
        "backbone": {
            "diameter": quantity(2 * material.number("outer_radius", radius), "m"),
            **bore,
            "E": quantity(material.number("youngs_modulus"), "Pa"),
            "nu": quantity(material.number("poisson_ratio"), ""),
            "density": quantity(material.number("density"), "kg/m^3"),
        },
        "disks": {
            "count": Field(quantity(links, ""), "its rigid links"),
            "mass": Field("0 g", "all mass is in the backbone, as there"),
            "radius": Field(quantity(radius, "m"), "with which it draws the links"),
            "thickness": Field("0 mm", assumed="disk thickness"),
            "clamped_length": Field("0 mm", assumed="clamped length"),
        },
    }


def _tendons(given: _Fields, ring: _Fields | None, k: int) -> list[str]:
    """Tendons of segment k, at equal angles and turned by the segment's and each one's offset."""
    if ring is None:
        raise InputError(f"{given.label}: segments[{k}].actuation: missing.")
    count, radius = ring.count("number_of_tendons"), ring.number("distance_to_backbone")
    offset = _entry(given, "seg_offsets", given.get("seg_offsets", None), k)
    every = given.get("tendon_angle_deltas", None) or []
    own = every[k] if isinstance(every, list) and k < len(every) else []
    turns = [_entry(given, f"tendon_angle_deltas[{k}]", own, i) for i in range(count)]
    angles = [offset + math.tau * i / count + turn for i, turn in enumerate(turns)]
    return [tendon(math.remainder(each, math.tau), radius) for each in angles]


def _entry(given: _Fields, name: str, row: Any, index: int) -> float:
    """An entry of a list of numbers; 0 without the list."""
    if row is None or row == []:
        return 0.0
    entries = {str(i): each for i, each in enumerate(row)} if isinstance(row, list) else {}
    return _Fields(entries, given.label, f"{given.path}{name}.").number(str(index))
