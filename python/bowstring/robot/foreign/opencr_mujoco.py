"""Robots of opencr-mujoco: its JSON configurations."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Final, Literal

from pydantic import Field as Limits
from typing_extensions import NotRequired

from bowstring.errors import InputError
from bowstring.files.json_files import Content, parsed, structured
from bowstring.robot.draft import Draft, Field, quantity, tendon, vector

_LEFT_OUT: Final = (
    "Not converted: actuator_properties (gain, pretension, limits), damping and mounting."
)
_Count = Annotated[int, Limits(ge=1, le=1000)]


class _Material(Content):
    density: float
    youngs_modulus: float
    poisson_ratio: float
    inner_radius: NotRequired[float]
    outer_radius: NotRequired[float]


class _Actuation(Content):
    number_of_tendons: _Count
    distance_to_backbone: float


class _Module(Content):
    length: float
    num_links: _Count
    radius: NotRequired[float]
    material_properties: _Material


class _Segment(Content):
    modules: Annotated[list[str], Limits(min_length=1)]
    actuation: NotRequired[_Actuation]


class _Robot(Content, total=False):
    modular: bool
    joint_config_mode: str
    independent_segments: bool
    actuation_mode: str
    gravity: str
    radius: float
    num_segments: _Count
    links_per_segment: dict[str, _Count]
    segment_lengths: dict[str, float]
    total_length: float
    total_links: _Count
    material_properties: _Material
    material_properties_per_segment: list[_Material]
    actuation_details: dict[Literal["segments"], list[_Actuation]]
    seg_offsets: list[float]
    tendon_angle_deltas: list[list[float]]
    module_library: dict[str, _Module]
    segments: list[_Segment]


def draft(text: str, label: str) -> Draft:
    """Draft a robot from a configuration, or from ``generator_config`` in one of an evaluation.

    The rigid links become disks without mass, as the links' mass is that of the backbone.
    """
    try:
        tree = parsed(text)
        if isinstance(tree, dict):
            tree = tree.get("generator_config", tree)
        return _drafted(structured(tree, _Robot))
    except KeyError as error:
        raise InputError(f"{label}: it has no {error.args[0]}.") from None
    except ValueError as error:
        raise InputError(f"{label}: {error}.") from None


def _drafted(given: Any) -> Draft:
    modular, mode = given.get("modular", False), given.get("joint_config_mode", "direct")
    if not modular and mode != "material":
        raise ValueError(f"joint_config_mode is {mode}, it must be material, which has a modulus")
    if given.get("independent_segments", False):
        raise ValueError("independent_segments: tendons that skip inner segments are not modelled")
    routed = given.get("actuation_mode") == "parallel_tendons"
    segments: list[dict[str, Any]] = []
    for k, (modules, ring) in enumerate(_modular(given) if modular else _plain(given, routed)):
        segments += map(_section, modules)
        if routed:
            if not ring:
                raise ValueError(f"segments[{k}] has no actuation")
            segments[-1]["tendons"] = _tendons(given, ring, k)
    if not routed:
        for segment in segments:
            del segment["disks"]
            segment["tendons_in"] = "body"
    down = given.get("gravity", "0 0 -9.81")
    try:
        x, y, z = map(float, down.split())
    except ValueError:
        raise ValueError('gravity must be three numbers such as "0 0 -9.81"') from None
    comment = "in the robot's own frame: mounting is not read"
    gravity = Field(vector((x, y, z), "m/s^2"), comment if x or y or z else "")
    return Draft({"gravity": gravity, "segments": segments}, notes=[_LEFT_OUT])


def _modular(given: Any) -> Iterator[tuple[list[Any], Any]]:
    """Modules of each segment from base to tip, and its tendons."""
    for segment in given["segments"]:
        modules = [given["module_library"][name] for name in segment["modules"]]
        yield modules, segment.get("actuation")


def _plain(given: Any, routed: bool) -> Iterator[tuple[list[Any], Any]]:
    """As `_modular`, for a configuration without modules."""
    lengths = given.get("segment_lengths") or {"1": given["total_length"]}
    links = given.get("links_per_segment") or {"1": given.get("total_links", 10)}
    own = given.get("material_properties_per_segment")
    rings = given["actuation_details"]["segments"] if routed else None
    for k in range(given.get("num_segments", 1)):
        module = {
            "length": _entry(lengths, str(k + 1), "segment_lengths"),
            "num_links": _entry(links, str(k + 1), "links_per_segment"),
            "material_properties": _entry(own, k, "material_properties_per_segment")
            or given["material_properties"],
        }
        same = {"radius": given["radius"]} if "radius" in given else {}
        yield [module | same], _entry(rings, k, "actuation_details.segments")


def _section(module: Any) -> dict[str, Any]:
    """Segment of a robot file without tendons."""
    material, radius = module["material_properties"], module.get("radius", 0.035)  # its default
    backbone = {"diameter": quantity(2 * material.get("outer_radius", radius), "m")}
    if inner := material.get("inner_radius", 0.0):
        backbone["inner_diameter"] = quantity(2 * inner, "m")
    backbone["E"] = quantity(material["youngs_modulus"], "Pa")
    backbone["nu"] = quantity(material["poisson_ratio"], "")
    backbone["density"] = quantity(material["density"], "kg/m^3")
    disks = {
        "count": Field(str(module["num_links"]), "its rigid links"),
        "mass": Field("0 g", "all mass is in the backbone, as there"),
        "radius": Field(quantity(radius, "m"), "with which it draws the links"),
        "thickness": Field("0 mm", assumed="disk thickness"),
        "clamped_length": Field("0 mm", assumed="clamped length"),
    }
    segment = {"length": quantity(module["length"], "m"), "backbone": backbone}
    return {**segment, "disks": disks, "tendons": "[]"}


def _tendons(given: Any, ring: Any, k: int) -> list[str]:
    """Tendons of segment k: equal angles, turned by offsets (rad) of the segment and of each."""
    count, radius = ring["number_of_tendons"], ring["distance_to_backbone"]
    offset = _entry(given.get("seg_offsets"), k, "seg_offsets") or 0.0
    turns = (given.get("tendon_angle_deltas", [])[k : k + 1] or [None])[0]
    found = []
    for i in range(count):
        turn = _entry(turns, i, f"tendon_angle_deltas[{k}]") or 0.0
        angle = offset + math.tau * i / count + turn
        found.append(tendon(radius * math.cos(angle), radius * math.sin(angle)))
    return found


def _entry(entries: Any, key: Any, name: str) -> Any:
    """An entry; None without entries."""
    try:
        return entries[key] if entries else None
    except LookupError:
        raise ValueError(f"{name} has no entry {key}") from None
