"""Physical effects of a rod that constant curvature lacks, and rods with or without one of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from bowstring.display import short_repr
from bowstring.robot.designs import Designs
from bowstring.robot.model import with_fields
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel

Part = Literal["model", "load", "disks", "backbone", "tendons"]

DOMINANT: Final = 0.5
"""Share of the error above which an effect is its dominant cause."""
_NONE: Final = (0.0, 0.0, 0.0)


@short_repr
@dataclass(frozen=True)
class Rods:
    """Robots, and what acts on them beside their tendons: the rods of a comparison."""

    designs: Designs
    """The robots."""
    model: RodModel
    """Theory and tendon path."""
    load: Load
    """Gravity (that of the robots if None) and tip force."""
    by_displacement: bool = False
    """Whether motors command displacements, not tensions."""


@dataclass(frozen=True)
class Effect:
    """A physical effect of a rod that constant curvature lacks."""

    label: str
    """Effect in words."""
    part: Part
    """Part of the rods that has it."""
    absent: Mapping[str, Any]
    """Values of the fields of this part with which there is no such effect."""
    acts: Callable[[Rods], bool]
    """Whether it acts in any of the rods."""
    because: str = ""
    """Clause on what constant curvature ignores."""


def _spans(rods: Rods) -> bool:
    # a continuous tendon has no displacement control, and none runs beside coupled strains
    other = rods.by_displacement or rods.designs.arrays.is_coupled
    return rods.model.tendon_path == "straight" and not other


def _gravity(rods: Rods) -> bool:
    given = rods.load.gravity
    return bool(np.any(rods.designs.gravity if given is None else given))


def _stretch(rods: Rods) -> bool:
    tendons = rods.designs.arrays.tendons
    stretch = 1.0 / tendons.axial_stiffness_N + tendons.compliance_m_per_N
    return rods.by_displacement and bool(np.any(stretch))


EFFECTS: Final = {
    "straight_spans": Effect(
        "tendons straight between the disks",
        "model",
        {"tendon_path": "continuous"},
        _spans,
        "tendons run straight between the disks",
    ),
    "clamps": Effect(
        "clamped lengths at the disks",
        "disks",
        {"clamped_length": 0.0},
        lambda rods: bool(np.any(rods.designs.arrays.disks.clamped_length_m)),
        "the disks clamp parts of the backbone",
    ),
    "hole_planes": Effect(
        "entry and exit planes of the holes",
        "disks",
        {"hole_length": 0.0},
        lambda rods: bool(np.any(rods.designs.arrays.disks.hole_length_m)),
        "the tendons bend at the planes of the holes",
    ),
    "shear_extension": Effect(
        "shear and extension",
        "model",
        {"theory": "kirchhoff"},
        lambda rods: rods.model.theory == "cosserat",
        "the backbone shears and shortens",
    ),
    "torsion": Effect(
        "torsion",
        "model",
        {"twist": False},
        lambda rods: rods.model.twist,
        "the backbone twists",
    ),
    "gravity": Effect(
        "gravity",
        "load",
        {"gravity": _NONE},
        _gravity,
        "gravity acts on the robot",
    ),
    "tip_force": Effect(
        "tip force",
        "load",
        {"tip_force": _NONE},
        lambda rods: rods.load.tip_force is not None and bool(np.any(rods.load.tip_force)),
        "the tip force bends the robot",
    ),
    "friction": Effect(
        "friction",
        "tendons",
        {"friction": 0.0},
        lambda rods: bool(np.any(rods.designs.arrays.tendons.friction)),
        "friction at the holes lowers the tension",
    ),
    "tendon_stretch": Effect(
        "stretch of tendons and transmission",
        "tendons",
        {"axial_stiffness": None, "free_length": 0.0, "compliance": 0.0},
        _stretch,
        "tendons and transmission stretch",
    ),
}
"""The effects by their keys."""


def acting(rods: Rods) -> list[str]:
    """Keys of the effects that act in any of the rods, in the order of `EFFECTS`."""
    return [key for key, effect in EFFECTS.items() if effect.acts(rods)]


def without(rods: Rods, *effects: str) -> Rods:
    """Return the same rods without some effects, all else the same.

    Without ``straight_spans`` they have no ``friction`` either: a continuous tendon has none.
    """
    for key in effects:
        effect = EFFECTS[key]
        if key == "straight_spans" and EFFECTS["friction"].acts(rods):
            rods = without(rods, "friction")
        rods = with_values(rods, effect.part, effect.absent)
    return rods


def with_values(rods: Rods, part: Part, values: Mapping[str, Any]) -> Rods:
    """Return the same rods with other values of one part.

    Parameters
    ----------
    rods : Rods
    part : {"model", "load", "disks", "backbone", "tendons"}
        Theory and tendon path, loads, or a part of all segments.
    values : mapping from str to object
        Values by field; for a part of the segments, a list has a value for each segment.
    """
    if part == "model":
        return replace(rods, model=rods.model.replace(**values))
    if part == "load":
        return replace(rods, load=rods.load.replace(**values))
    designs = rods.designs
    kept = {
        path: v
        for path, v in designs.values.items()
        if not (f".{part}." in path and path.rpartition(".")[2] in values)
    }
    if designs.values and not kept:  # one array of numbers keeps the number of robots
        kept = {"segments.0.length": np.full(len(designs), designs.robot.segments[0].length)}
    return replace(rods, designs=Designs(with_fields(designs.robot, part, values), kept))
