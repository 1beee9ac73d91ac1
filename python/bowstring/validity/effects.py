"""Physical effects of a rod that constant curvature lacks, and rods without one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bowstring.display import short_repr
from bowstring.robot.designs import Designs
from bowstring.robot.model import with_tendons
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel

__all__ = ["EFFECTS", "Rods", "acting", "without"]

EFFECTS: Final = {
    "straight_spans": "tendons straight between the disks",
    "clamps": "clamped lengths at the disks",
    "hole_planes": "entry and exit planes of the holes",
    "shear_extension": "shear and extension",
    "torsion": "torsion",
    "gravity": "gravity",
    "tip_force": "tip force",
    "friction": "friction",
    "tendon_stretch": "stretch of tendons and transmission",
}
"""Keys and labels of the effects."""

_INEXTENSIBLE: Final = {"axial_stiffness": None, "free_length": 0.0, "compliance": 0.0}


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


def acting(rods: Rods) -> list[str]:
    """Keys of the effects that act in any of the rods, in the order of `EFFECTS`."""
    gravity = rods.designs.gravity if rods.load.gravity is None else rods.load.gravity
    force = rods.load.tip_force
    tendons = rods.designs.arrays.tendons
    stretch = 1.0 / tendons.axial_stiffness_N + tendons.compliance_m_per_N
    acts = {
        # a continuous tendon has no displacement control, and none runs beside coupled strains
        "straight_spans": rods.model.tendon_path == "straight"
        and not (rods.by_displacement or rods.designs.arrays.is_coupled),
        "clamps": bool(np.any(rods.designs.arrays.disks.clamped_length_m)),
        "hole_planes": bool(np.any(rods.designs.arrays.disks.hole_length_m)),
        "shear_extension": rods.model.theory == "cosserat",
        "torsion": rods.model.twist,
        "gravity": bool(np.any(gravity)),
        "tip_force": force is not None and bool(np.any(force)),
        "friction": bool(np.any(tendons.friction)),
        "tendon_stretch": rods.by_displacement and bool(np.any(stretch)),
    }
    return [key for key in EFFECTS if acts[key]]


def without(rods: Rods, effect: str) -> Rods:
    """Return the same rods without one effect, all else the same.

    Without ``straight_spans`` they have no ``friction`` either: a continuous tendon has none.
    """
    zero = (0.0, 0.0, 0.0)
    if effect == "straight_spans":
        bare = without(rods, "friction") if "friction" in acting(rods) else rods
        return replace(bare, model=rods.model.replace(tendon_path="continuous"))
    if effect == "shear_extension":
        return replace(rods, model=rods.model.replace(theory="kirchhoff"))
    if effect == "torsion":
        return replace(rods, model=rods.model.replace(twist=False))
    if effect == "gravity":
        return replace(rods, load=rods.load.replace(gravity=zero))
    if effect == "tip_force":
        return replace(rods, load=rods.load.replace(tip_force=zero))
    if effect == "friction":
        return replace(rods, designs=_without(rods.designs, "tendons", {"friction": 0.0}))
    if effect == "tendon_stretch":
        return replace(rods, designs=_without(rods.designs, "tendons", _INEXTENSIBLE))
    field = "hole_length" if effect == "hole_planes" else "clamped_length"
    return replace(rods, designs=_without(rods.designs, "disks", {field: 0.0}))


def _without(designs: Designs, part: str, fields: Mapping[str, float | None]) -> Designs:
    """The same robots with other fields of the disks or tendons of all segments."""
    robot = designs.robot
    if part == "tendons":
        robot = with_tendons(robot, fields)
    else:
        changes = {
            f"segments.{k}.{part}.{field}": value
            for k in range(len(robot.segments))
            for field, value in fields.items()
        }
        robot = robot.with_(changes)
    kept = {
        path: v
        for path, v in designs.values.items()
        if not (f".{part}." in path and path.rpartition(".")[2] in fields)
    }
    if not kept:  # one number stands for all, so that there are as many robots
        kept = {"segments.0.length": np.full(len(designs), robot.segments[0].length)}
    return Designs(robot, kept)
