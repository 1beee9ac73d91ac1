"""Sweeps of many robots in one call of the core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring._core import follow_designs
from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.robot.designs import Designs
from bowstring.robot.laws import MEMORIES
from bowstring.statics.actuation import driven
from bowstring.statics.load import Load
from bowstring.statics.load_tables import ON_DISKS, disk_shape, per_disk, with_arrays
from bowstring.statics.model import RodModel, as_model
from bowstring.validation import floats, shown

__all__ = ["DesignSweep", "sweep_designs"]

_WIDE: Final = ("gravity", "tip_force", "tip_moment")
_FOUND: Final = (
    "tensions",
    "slack_lengths",
    "converged",
    "status",
    "tip_position",
    "tendon_lengths",
    "tip_error",
)


@short_repr
@dataclass(frozen=True)
class DesignSweep:
    """Equilibria of D robots at L loads each; made by `sweep_designs`.

    Loads that did not converge hold NaN.
    """

    designs: Designs
    """The robots."""
    tensions: Floats
    """Tensions (D, L, T), N: as given, or as they follow from displacements."""
    slack_lengths: Floats
    """Slack lengths of the tendons under displacement control (D, L, T), m; 0 of the others."""
    converged: Bools
    """Whether each load converged (D, L)."""
    status: NDArray[np.str_]
    """Status as of `bowstring.Solution`, (D, L)."""
    tip_position: Floats
    """Tips (D, L, 3), m."""
    tendon_lengths: Floats
    """Lengths of the tendons (D, L, T), m."""
    tip_error: Floats
    """Estimated discretisation error of the tip (D, L), m."""


def sweep_designs(
    designs: Designs,
    tensions: ArrayLike | None = None,
    *,
    displacements: ArrayLike | None = None,
    load: Load | None = None,
    model: RodModel | None = None,
    threads: int = 0,
) -> DesignSweep:
    """Solve the loads of many robots in sequence, each load from the one before, on all cores.

    With displacements or friction, the loads of a robot are a path from its home pose, as in
    `bowstring.sweep`; the path ends at its first load without a solution.

    Parameters
    ----------
    designs : Designs
        The robots.
    tensions : array_like (L, T) or (D, L, T), optional
        Tensions in N, the same for all robots or of each; NaN where a tendon has a displacement.
    displacements : array_like (L, T) or (D, L, T), optional
        Tendon displacements from the home pose in m; NaN where a tendon has a tension.
    load : Load, optional
        Gravity, tip force and tip moment, (3,) or (D, 3) or (D, L, 3); gravity is that of the
        robots if left out. Loads on disks (N, 3), the same for all.
    model : RodModel, optional
        As for `bowstring.solve`.
    threads : int
        Number of threads; 0 takes one for each core. The solutions do not depend on it.

    Returns
    -------
    DesignSweep
        Tips, lengths, tensions and status of all loads.

    Raises
    ------
    InputError
        If an argument is wrong; nothing is solved then.

    Examples
    --------
    >>> import numpy as np
    >>> import bowstring as bs
    >>> from bowstring.robot.designs import Designs
    >>> from bowstring.statics.design_sweeps import sweep_designs
    >>> robots = Designs(bs.load_robot("amouri2019"), {"segments.*.backbone.E": [30e9, 35e9, 40e9]})
    >>> found = sweep_designs(robots, np.outer([0, 40, 80], [1, 0, 0]))
    >>> found.tip_position.shape
    (3, 3, 3)
    """
    if not isinstance(designs, Designs):
        raise InputError(f"designs is {shown(designs)}, it must be Designs of robots")
    for key in designs.arrays.memories:
        if key not in ("friction", "backlash"):
            zero = f"set {listed(MEMORIES[key].sizes)} to 0"
            raise InputError(f"robots have {key}, which sweep_designs does not follow; {zero}")
    rows = _commands(designs, tensions, displacements)
    count, each, tendons = rows.values.shape
    load = Load() if load is None else load
    varies = any(path.startswith("gravity") for path in designs.values)
    dead = Load(
        gravity=_wide(rows, "gravity", load.gravity, designs.gravity if varies else None),
        tip_force=_wide(rows, "tip_force", load.tip_force, None),
        tip_moment=_wide(rows, "tip_moment", load.tip_moment, None),
        **_on_disks(designs, load),
    )
    if designs.varies_stiffness:
        found = _by_stiffness(designs, rows, dead, as_model(model), threads)
    else:
        found = _solved(designs, rows, dead, as_model(model), threads)
    shape = (count, each)
    return DesignSweep(
        designs,
        found["tensions"].reshape(*shape, tendons),
        found["slack_lengths"].reshape(*shape, tendons),
        found["converged"].reshape(shape),
        found["status"].reshape(shape),
        found["tip_position"].reshape(*shape, 3),
        found["tendon_lengths"].reshape(*shape, tendons),
        found["tip_error"].reshape(shape),
    )


def _solved(
    designs: Designs, rows: _Commands, dead: Load, model: RodModel, threads: int
) -> dict[str, NDArray[Any]]:
    """Arrays of all loads of robots with the same stiffness matrices."""
    tendons = rows.values.shape[-1]
    values = rows.values.reshape(-1, tendons)
    if rows.by_displacement.any() or designs.arrays.tendons.friction.any():
        by_displacement = np.ascontiguousarray(rows.by_displacement.reshape(-1, tendons))
        found = follow_designs(
            designs.robot.core, designs, (by_displacement, values), dead, model, threads
        )
    else:
        found = designs.robot.core.sweep_designs(designs, values, dead, model, threads)
        found |= {"tensions": values, "slack_lengths": np.zeros(values.shape)}
    return {name: np.asarray(found[name]) for name in _FOUND}


def _by_stiffness(
    designs: Designs, rows: _Commands, dead: Load, model: RodModel, threads: int
) -> dict[str, NDArray[Any]]:
    """`_solved` for robots that differ in stiffness matrices: the core takes one set at a time."""
    each = rows.values.shape[1]
    parts, places = [], []
    for index, same in designs.by_stiffness():
        at = (index[:, None] * each + np.arange(each)).ravel()
        wide = {name: getattr(dead, name) for name in _WIDE}
        own = {name: v[at] for name, v in wide.items() if v is not None and v.ndim == 2}
        some = _Commands(rows.values[index], rows.by_displacement[index])
        found = _solved(same, some, dead.replace(**own), model, threads)
        parts.append({name: v.reshape(len(at), -1) for name, v in found.items()})
        places.append(at)
    order = np.argsort(np.concatenate(places))
    return {name: np.concatenate([part[name] for part in parts])[order] for name in _FOUND}


@dataclass(frozen=True)
class _Commands:
    """Commands of all tendons (D, L, T), and which are displacements."""

    values: Floats
    by_displacement: Bools


def _commands(
    designs: Designs, tensions: ArrayLike | None, displacements: ArrayLike | None
) -> _Commands:
    count, tendons = len(designs), len(designs.robot.tendons.segment)
    given = {"tensions": tensions, "displacements": displacements}
    tables = {name: floats(value) for name, value in given.items() if value is not None}
    if not tables:
        raise InputError("got neither tensions nor displacements; give one of them")
    for name, table in tables.items():
        if table.ndim not in (2, 3) or table.shape[-1] != tendons:
            raise InputError(
                f"{name} has shape {table.shape}, it must be (L, {tendons}) or (D, L, {tendons})"
            )
        if table.ndim == 3 and table.shape[0] != count:
            raise InputError(f"{name} has {table.shape[0]} robots, the designs are {count}")
    loads = {table.shape[-2] for table in tables.values()}
    if len(loads) > 1:
        counts = " and ".join(str(table.shape[-2]) for table in tables.values())
        raise InputError(f"tensions and displacements have {counts} loads; give as many of each")
    shape = (count, loads.pop(), tendons)
    wide = {name: np.broadcast_to(table, shape) for name, table in tables.items()}
    if len(wide) == 1:
        (name, values), by_displacement = next(iter(wide.items())), np.zeros(shape, bool)
        if name == "displacements":
            by_displacement[...] = True
        return _driven(designs, values, by_displacement)
    by_displacement = ~np.isnan(wide["displacements"])
    if (by_displacement == ~np.isnan(wide["tensions"])).any():
        raise InputError("each tendon must have a tension or a displacement, NaN in the other")
    values = np.where(by_displacement, wide["displacements"], wide["tensions"])
    return _driven(designs, values, by_displacement)


def _driven(designs: Designs, values: Floats, by_displacement: Bools) -> _Commands:
    """Commands as they reach the tendons (theory Eq. 4.11)."""
    # loads first: arrays of tendons are (T,) or (D, T)
    moved = driven(designs.arrays, values.swapaxes(0, 1)).swapaxes(0, 1)
    reached = np.where(by_displacement, moved, values)
    return _Commands(np.ascontiguousarray(reached), by_displacement)


def _on_disks(designs: Designs, load: Load) -> dict[str, Floats]:
    """Loads on disks (N, 3) and numbers of point loads (P, 12)."""
    load = with_arrays(load)
    disks = designs.robot.core.disk_count
    given = {name: getattr(load, name) for name in ON_DISKS if getattr(load, name) is not None}
    given = {name: per_disk(name, value, disks) for name, value in given.items()}
    for name, value in given.items():
        if value.shape != (disks, 3):
            raise InputError(
                f"{name} has shape {value.shape}, it must have {disk_shape(name, disks)}"
            )
    if load.point_loads is not None:
        given["point_loads"] = load.point_loads
    return given


def _wide(
    rows: _Commands, name: str, value: ArrayLike | None, otherwise: Floats | None
) -> Floats | None:
    """A vector of the load, (3,) or (D L, 3)."""
    if value is None and otherwise is None:
        return None
    array = floats(otherwise if value is None else value)
    count, each = rows.values.shape[:2]
    if array.shape == (3,):
        return array
    if array.shape == (count, 3):
        array = array[:, None, :]
    if array.shape not in ((count, 1, 3), (count, each, 3)):
        raise InputError(
            f"{name} has shape {array.shape}, it must be (3,), ({count}, 3) or ({count}, {each}, 3)"
        )
    return np.ascontiguousarray(np.broadcast_to(array, (count, each, 3))).reshape(-1, 3)
