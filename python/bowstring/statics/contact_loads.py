"""Loads of a contact as arrays: those of each row, and dead loads."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.statics import actuation
from bowstring.statics.load import Load
from bowstring.statics.load_tables import ON_DISKS, per_disk, with_arrays, without_wrenches

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_VECTORS: Final = {"gravity": "m/s^2", "tip_force": "N", "tip_moment": "N m"}


def load_rows(robot: Robot, load: Load) -> list[Load]:
    """Return the load of each row."""
    load = with_arrays(load, " or (n, N, 3)")
    count = len(actuation.commands(robot, load, rows=True)[1])
    values: dict[str, Any] = {}
    for name in (*actuation.KINDS, *_VECTORS, *ON_DISKS):
        given = getattr(load, name)
        if given is None:
            continue
        array = validation.read(name, given, "numbers")
        array = per_disk(name, array, robot.core.disk_count)
        once = 2 if name in ON_DISKS else 1
        if array.ndim == once:
            array = np.broadcast_to(array, (count, *array.shape))
        if array.ndim != once + 1 or len(array) != count:
            raise InputError(
                f"{name} has shape {array.shape}, it must have {count} rows, as others"
            )
        values[name] = array
    points = load.point_loads
    return [
        Load(point_loads=points, **{name: array[k] for name, array in values.items()})
        for k in range(count)
    ]


def unloaded(dead: dict[str, Floats]) -> dict[str, Floats]:
    """Return the gravity, with all other loads zero and on the same points."""
    none = {name: np.zeros_like(value) for name, value in dead.items()}
    none["gravity"] = dead["gravity"]
    if "point_loads" in dead:
        none["point_loads"] = without_wrenches(dead["point_loads"])
    return none


def dead_loads(robot: Robot, load: Load) -> dict[str, Floats]:
    """Dead loads as arrays: gravity, tip force and moment, and those on disks if given."""
    load = with_arrays(load)
    found: dict[str, Floats] = {}
    for name, unit in _VECTORS.items():
        value = getattr(load, name)
        if value is None:
            found[name] = np.array(robot.gravity) if name == "gravity" else np.zeros(3)
        else:
            found[name] = validation.numbers(name, value, (3,), unit)
    count = robot.core.disk_count
    if load.point_loads is not None:
        found["point_loads"] = load.point_loads.copy()
        found["point_loads"][:, 0] %= count  # below zero they count from the tip
    for name, unit in ON_DISKS.items():
        value = getattr(load, name)
        if value is not None:
            value = per_disk(name, value, count)
            found[name] = validation.numbers(name, value, (count, 3), unit)
    return found
