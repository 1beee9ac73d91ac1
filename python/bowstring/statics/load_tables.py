"""Loads as arrays, as the core takes them: rows of disks and of point loads, loads at one time."""

from __future__ import annotations

from dataclasses import replace
from operator import attrgetter
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.statics.load import Load, PointLoad, depends_on_time, point_loads
from bowstring.validation import floats, read

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_BESIDE_TIP: Final = attrgetter("disk_forces", "disk_moments", "point_loads", "line_forces", "base")
_DEAD: Final = ("tip_force", "tip_moment", "disk_forces", "disk_moments", "line_forces")
ON_DISKS: Final = {"disk_forces": "N", "disk_moments": "N m", "line_forces": "N/m"}
"""Loads with a vector for each disk, with their units."""
POINT_NUMBERS: Final = 12
"""Numbers of a point load; see `PointLoad.numbers`."""
FORCE: Final = slice(4, 7)
MOMENT: Final = slice(7, 10)
WRENCH: Final = slice(4, 10)
FOLLOWER: Final = 10
"""Columns of force, moment, both, and 1 for a follower among the numbers of a point load."""


def disk_shape(name: str, disks: int | str = "N", rows: str = "") -> str:
    """Write the shape of a load on disks for a message; `rows` is a further one."""
    if name == "line_forces":
        rows = " or (3,)"
    return f"({disks}, 3){rows}: one vector for each disk, in {ON_DISKS[name]}"


def _numbers_of(loads: tuple[PointLoad, ...]) -> Floats:
    for i, load in enumerate(loads):
        for name in ("force", "moment"):
            if depends_on_time(getattr(load, name)):
                raise InputError(
                    f"the {name} of point load {i + 1} depends on time, which only "
                    "bowstring.simulate takes"
                )
    return np.array([load.numbers() for load in loads], dtype=float)


def with_arrays(load: Load, rows: str = "") -> Load:
    """Return a load with the loads on its disks as arrays, as the core takes them.

    `rows` is a shape beside (N, 3) for messages.
    """
    for value in _BESIDE_TIP(load):  # `all` of a generator takes four times as long
        if value is not None:
            break
    else:
        return load
    if load.base is not None:
        raise InputError("load has a motion of the base, which only bowstring.simulate takes")
    given = {name: getattr(load, name) for name in ON_DISKS}
    arrays = {
        name: read(name, value, f"numbers of shape {disk_shape(name, rows=rows)}")
        for name, value in given.items()
        if value is not None and not _is_array(value)
    }
    if load.point_loads is not None and not _is_array(load.point_loads):
        loads = point_loads(load.point_loads)
        load = replace(load, point_loads=_numbers_of(loads) if loads else None)
    return replace(load, **arrays) if arrays else load


def _is_array(value: object) -> bool:
    return type(value) is np.ndarray and value.dtype == np.float64


class InstantLoad(NamedTuple):
    """Checked loads at one time: actuation, and forces and moments at the tip and on disks."""

    actuation: Floats
    """Tension in N or displacement in m of each tendon (T,)."""
    tip_force: Floats
    tip_moment: Floats
    disk_forces: Floats
    """Components of all disks, one after the other (3 N,); empty if there are none."""
    disk_moments: Floats
    point_loads: Floats
    """Numbers of all point loads, one after the other (12 P,); empty if there are none."""
    line_forces: Floats
    """Components before all disks (3 N,); empty if there are none."""
    base: Floats
    """Accelerations of the base (9,); empty where it does not move. In rows for intervals those at
    one and two thirds and at the end, (K, 27)."""

    @property
    def dead(self) -> Load:
        """Forces and moments as a load with the robot's gravity."""
        return Load(
            tip_force=self.tip_force,
            tip_moment=self.tip_moment,
            disk_forces=_by_disks(self.disk_forces),
            disk_moments=_by_disks(self.disk_moments),
            point_loads=table_of(self.point_loads) if len(self.point_loads) else None,
            line_forces=_by_disks(self.line_forces),
        )

    @property
    def has_potential(self) -> bool:
        """Whether all loads have a potential: moments and followers have none."""
        return not (self.tip_moment.any() or self.disk_moments.any()) and points_have_potential(
            table_of(self.point_loads)
        )

    @property
    def row(self) -> InstantLoad:
        """Each array as one row of a table."""
        return InstantLoad(*(array[None] for array in self))


def least_elements(robot: Robot, load: Load) -> int:
    """Least number of elements between two disks for the arc lengths at which loads act."""
    places = (each.arc_length for each in point_loads(load.point_loads))
    count: int = robot.core.least_elements([place for place in places if place is not None])
    return count


def table_of(numbers: Floats) -> Floats:
    """Return the numbers of point loads, one after the other, as a table (P, 12)."""
    return numbers.reshape(-1, POINT_NUMBERS)


def same_points(a: Floats, b: Floats) -> bool:
    """Whether two tables of point loads (P, 12) act on the same points, whatever their sizes."""
    return a.shape == b.shape and bool(
        (np.delete(a, WRENCH, axis=1) == np.delete(b, WRENCH, axis=1)).all()
    )


def acts(load: Load) -> bool:
    """Whether a load with arrays has a force or a moment beside the tendons and the weight."""
    given = [getattr(load, name) for name in _DEAD]
    if load.point_loads is not None:
        given.append(load.point_loads[:, WRENCH])
    return any(value is not None and bool(np.any(value)) for value in given)


def scaled(load: Load, share: float) -> Load:
    """Return a load with arrays whose forces and moments, without the weight, have a share."""
    values = {
        name: share * floats(value)
        for name in _DEAD
        if (value := getattr(load, name, None)) is not None
    }
    if load.point_loads is not None:
        values["point_loads"] = load.point_loads.copy()
        values["point_loads"][:, WRENCH] *= share
    return load.replace(**values)


def without_wrenches(numbers: Floats) -> Floats:
    """Copy a table of point loads (P, 12) with forces and moments of zero."""
    none: Floats = np.array(numbers, dtype=float)
    none[:, WRENCH] = 0.0
    return none


def per_disk(name: str, value: Floats, disks: int) -> Floats:
    """Return a load of `ON_DISKS` with a row for each disk: one force per length is for all."""
    if name == "line_forces" and value.shape == (3,):
        return np.tile(value, (disks, 1))
    return value


def points_have_potential(numbers: Floats | None) -> bool:
    """Whether point loads, as numbers (P, 12), have a potential: no moment and no follower."""
    if numbers is None:
        return True
    follows = numbers[:, FOLLOWER] != 0
    return not (numbers[:, MOMENT].any() or numbers[follows, FORCE].any())


def _by_disks(components: Floats) -> Floats | None:
    return components.reshape(-1, 3) if len(components) else None


def row_of(load: Load, k: int, count: int) -> Load:
    """Dead loads of one row of `count`, of a load that may have rows."""
    rows = {}
    for name, dimensions in (
        ("gravity", 2),
        ("tip_force", 2),
        ("tip_moment", 2),
        ("disk_forces", 3),
        ("disk_moments", 3),
    ):
        value = getattr(load, name)
        if value is None or np.ndim(value) < dimensions:
            continue
        if len(value) != count:
            raise InputError(f"{name} has {len(value)} rows, it must have one or {count}")
        rows[name] = np.asarray(value)[k]
    return load.replace(**rows) if rows else load
