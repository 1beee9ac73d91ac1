"""Physical effects of a rod that constant curvature lacks, and rods without one of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from bowstring.display import short_repr
from bowstring.robot.designs import Designs
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel

__all__ = ["EFFECTS", "Rods", "acting", "without"]

EFFECTS: Final = {
    "straight_spans": "tendons straight between the disks",
    "clamps": "clamped lengths at the disks",
    "shear_extension": "shear and extension",
    "torsion": "torsion",
    "gravity": "gravity",
    "tip_force": "tip force",
}
"""Keys and labels of the effects."""

_CLAMP: Final = "clamped_length"


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


def acting(rods: Rods) -> list[str]:
    """Keys of the effects that act in any of the rods, in the order of `EFFECTS`."""
    gravity = rods.designs.gravity if rods.load.gravity is None else rods.load.gravity
    force = rods.load.tip_force
    acts = {
        "straight_spans": rods.model.tendon_path == "straight",
        "clamps": bool(np.any(rods.designs.arrays.disks.clamped_length_m)),
        "shear_extension": rods.model.theory == "cosserat",
        "torsion": rods.model.twist,
        "gravity": bool(np.any(gravity)),
        "tip_force": force is not None and bool(np.any(force)),
    }
    return [key for key in EFFECTS if acts[key]]


def without(rods: Rods, effect: str) -> Rods:
    """Return the same rods without one effect, all else the same."""
    zero = (0.0, 0.0, 0.0)
    if effect == "straight_spans":
        return replace(rods, model=rods.model.replace(tendon_path="continuous"))
    if effect == "shear_extension":
        return replace(rods, model=rods.model.replace(theory="kirchhoff"))
    if effect == "torsion":
        return replace(rods, model=rods.model.replace(twist=False))
    if effect == "gravity":
        return replace(rods, load=rods.load.replace(gravity=zero))
    if effect == "tip_force":
        return replace(rods, load=rods.load.replace(tip_force=zero))
    designs, clamps = rods.designs, {}
    for k in range(len(designs.robot.segments)):
        clamps[f"segments.{k}.disks.{_CLAMP}"] = 0.0
    kept = {path: v for path, v in designs.values.items() if path not in clamps}
    bare = Designs(designs.robot.with_(clamps), kept)
    if not kept:  # robots that differ in nothing else
        bare = Designs(bare.robot, {next(iter(clamps)): np.zeros(len(designs))})
    return replace(rods, designs=bare)
