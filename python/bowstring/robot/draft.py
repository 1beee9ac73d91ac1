"""Draft of a robot file: fields as text with comments, before anybody has measured the robot."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from bowstring.units import number_with_unit, printable, rounded

__all__ = ["MATERIALS", "MOUNTS", "Draft", "Field", "Material", "angle", "drafted", "tendon"]

_COLUMN: Final = 34  # of the comments
_EARTH: Final = 9.80665  # m/s^2


class Material(NamedTuple):
    """Typical properties of a material of backbones, as text with units."""

    E: str
    nu: str
    density: str


MATERIALS: Final = {
    "nitinol": Material("60 GPa", "0.33", "6450 kg/m^3"),
    "steel": Material("200 GPa", "0.29", "7850 kg/m^3"),
    "glass-fibre": Material("40 GPa", "0.3", "1900 kg/m^3"),
    "peek": Material("3.6 GPa", "0.38", "1300 kg/m^3"),
    "nylon": Material("2.8 GPa", "0.39", "1140 kg/m^3"),
}
"""Typical values: austenitic nitinol, spring steel, pultruded rods of glass fibre along the fibres,
unfilled PEEK, dry nylon 66. Those of a given rod differ, by 20 % and more for all but steel."""

MOUNTS: Final = {
    "down": (f"0 0 {_EARTH}", "along +z, from base to tip: the robot hangs down"),
    "up": (f"0 0 -{_EARTH}", "along -z, from tip to base: the robot stands"),
    "side": (f"{_EARTH} 0 0", "along x, across the backbone: the robot lies"),
    "none": ("0 0 0", "none"),
}
"""Gravity in the base frame in m/s^2, and its comment, by where the robot points."""


class Field(NamedTuple):
    """A value as text, its comment, and, where nobody stated it, the name of what is assumed."""

    text: str
    comment: str = ""
    assumed: str = ""


@dataclass
class Draft:
    """A robot file to be written.

    Attributes
    ----------
    fields : dict
        Fields of the file by name: a `Field`, text, a set of fields or a list of either.
    head : sequence of str
        Comment lines at the top.
    notes : sequence of str
        Sentences on what differs from a source; comment lines too.
    """

    fields: dict[str, Any]
    head: Sequence[str] = ()
    notes: Sequence[str] = ()

    @property
    def assumed(self) -> list[str]:
        """What nobody stated, each once, with the value that is assumed."""
        return list(dict.fromkeys(f"{f.assumed} {f.text}" for f in _all(self.fields) if f.assumed))

    @property
    def text(self) -> str:
        """Text of the file."""
        head = [f"# {printable(line)}".rstrip() for line in (*self.head, *self.notes)]
        return "\n".join([*head, *_lines(self.fields, 0)]) + "\n"


def _all(value: Any) -> Iterator[Field]:
    if isinstance(value, Field):
        yield value
    elif isinstance(value, (dict, list)):
        for each in value.values() if isinstance(value, dict) else value:
            yield from _all(each)


def _lines(fields: Mapping[str, Any], indent: int) -> Iterator[str]:
    blank = " " * indent
    for name, value in fields.items():
        if isinstance(value, list):
            yield f"{blank}{name}:"
            for each in value:
                lines = [f"{blank}    {each}"]
                if isinstance(each, dict):
                    lines = list(_lines(each, indent + 4))
                lines[0] = f"{blank}  - {lines[0].lstrip()}"
                yield from lines
        elif isinstance(value, dict):
            yield f"{blank}{name}:"
            yield from _lines(value, indent + 2)
        else:
            text, comment, assumed = value if isinstance(value, Field) else Field(value)
            line = f"{blank}{name}: {text}"
            if assumed and not comment:
                comment = "assumed: not in the file"
            yield f"{line:<{_COLUMN - 2}}  # {printable(comment)}" if comment else line


def plain_text(text: str) -> str:
    """Text as a value of YAML, quoted where it must be."""
    return text if re.fullmatch(r"[A-Za-z][\w.-]*", text, re.ASCII) else json.dumps(text)


def quantity(value: float, si: str) -> str:
    """Number of a file in its usual unit, exact to 12 digits."""
    return number_with_unit(float(value), si, 12)


def vector(values: Iterable[float], si: str) -> str:
    """Numbers of a vector with one unit."""
    return " ".join([*(rounded(float(value) + 0.0, 12) for value in values), si])


def angle(value: float) -> str:
    """Angle in degrees."""
    return f"{rounded(math.degrees(value) + 0.0, 12)} deg"


def tendon(at: float, radius: float, **more: str) -> str:
    """One tendon of a list: its angle (rad), its pitch radius (m), and more fields as text."""
    fields = {"angle": angle(at), "pitch_radius": quantity(radius, "m"), **more}
    return "{" + ", ".join(f"{name}: {value}" for name, value in fields.items()) + "}"


def drafted(
    name: str,
    *,
    material: str,
    E: str,
    diameter: Sequence[str],
    lengths: Sequence[str],
    disks: str,
    tendons: str,
    pitch_radius: tuple[str, float],
    disk: tuple[str, str],
    mount: str,
    defaults: Iterable[str] = (),
) -> Draft:
    """Draft the file of a robot with disks from what its builder knows of it.

    Parameters
    ----------
    name : str
    material : str
        One of `MATERIALS`.
    E : str
        Young's modulus; empty for the typical one.
    diameter : sequence of str
        Diameter of the backbone, and of its bore if it is a tube.
    lengths : sequence of str
        Length of each segment from base to tip.
    disks, tendons : str
        Numbers of disks and tendons of each segment.
    pitch_radius : tuple of str and float
        Pitch radius as text and in m.
    disk : tuple of str
        Mass and thickness of a disk.
    mount : str
        One of `MOUNTS`.
    defaults : iterable of str
        Names of arguments that nobody gave.

    Returns
    -------
    Draft
    """
    unknown = set(defaults)

    def stated(argument: str, text: str, comment: str, called: str = "") -> Field:
        if argument not in unknown:
            return Field(text, comment)
        return Field(text, f"{comment}; default, not yours", called or argument.replace("_", " "))

    typical = MATERIALS[material]
    gravity, direction = MOUNTS[mount]
    radius, turn = number_with_unit(1.2 * pitch_radius[1], "m"), 360.0 / int(tendons)
    segments = []
    for k, length in enumerate(lengths):
        backbone = {"diameter": stated("diameter", diameter[0], "outer diameter")}
        if len(diameter) > 1:
            backbone["inner_diameter"] = Field(diameter[1], "bore of the tube")
        of = f"typical of {material}: measure yours"
        backbone["E"] = Field(E, "Young's modulus") if E else Field(typical.E, of, "E")
        backbone["nu"] = Field(typical.nu, f"Poisson's ratio, typical of {material}", "nu")
        backbone["density"] = Field(typical.density, f"typical of {material}", "density")
        first = rounded(turn * k / len(lengths), 12)
        segments.append(
            {
                "length": stated("lengths", length, "straight backbone, base to end disk"),
                "backbone": backbone,
                "disks": {
                    "count": stated("disks", disks, "evenly spaced, the last at the end", "disks"),
                    "mass": stated("disk", disk[0], "each", "disk mass"),
                    "radius": Field(
                        radius, "assumed: 1.2 pitch radii; for the inertia", "disk radius"
                    ),
                    "thickness": stated("disk", disk[1], "for the inertia", "disk thickness"),
                    "clamped_length": Field(
                        disk[1], "assumed: held over its thickness; 0 mm if loose", "clamped length"
                    ),
                },
                "tendons": {
                    "count": stated("tendons", tendons, f"{rounded(turn, 4)} degrees apart"),
                    "pitch_radius": stated(
                        "pitch_radius", pitch_radius[0], "holes from the backbone's axis"
                    ),
                    "first_angle": Field(f"{first} deg", "of the first tendon, from x"),
                },
            }
        )
    fields = {
        "name": plain_text(name),
        "gravity": stated("mount", f"{gravity} m/s^2", direction, "gravity"),
        "segments": segments,
    }
    head = ("A robot file of Bowstring. Measure what is assumed, and change it here.",)
    return Draft(fields, head)
