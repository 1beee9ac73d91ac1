"""Loads on a robot: actuation, gravity, forces and moments on the tip and on disks."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.validation import read, shown

__all__ = ["ON_DISKS", "InstantLoad", "Load", "as_load", "disk_shape", "with_arrays"]

Floats = NDArray[np.float64]


@short_repr
@dataclass(frozen=True, eq=False)
class Load:
    """Actuation of the tendons, gravity, and forces and moments at the tip and on disks.

    Each tendon has exactly one of tension, displacement and angle, and None (or NaN) in the others.
    Values are checked against the robot where the load is used.

    Parameters
    ----------
    tensions : array_like (T,), optional
        Tension of each tendon before its base hole in N, none negative.
    displacements : array_like (T,), optional
        Tendon displacement since the home pose in m, positive where the tendon is shortened.
    angles : array_like (T,), optional
        Motor angles in rad, of tendons with a ``spool_radius``: the displacement is the radius
        times the angle.
    gravity : array_like (3,), optional
        Gravity in base axes in m/s^2; that of the robot if left out.
    tip_force, tip_moment : array_like (3,), optional
        Dead loads at the tip in base axes, N and N m: they keep their direction. None if left out.
    disk_forces, disk_moments : array_like (N, 3), optional
        Dead loads on the N disks from base to tip in base axes, N and N m. The last disk is the
        tip, and its row adds to the load there. A force acts at the centre of its disk. None if
        left out.

    Notes
    -----
    `bowstring.sweep` and `bowstring.solve_batch` take rows: actuation (n, T), loads on disks (N, 3)
    or (n, N, 3), the others (3,) or (n, 3). In `bowstring.simulate` all but gravity may depend on
    time: a table (`bowstring.dynamics.ramp`, ``step``, ``Table``) or a function of time in s.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> load = bs.Load(displacements=[0.02, -0.03, -0.03], tip_force=[0, 0, -0.5])
    >>> bs.solve(robot, load=load).status
    'converged'

    A force of 1 N along y on the fourth of nine disks:

    >>> forces = [[0, 0, 0]] * 9
    >>> forces[3] = [0, 1, 0]
    >>> pushed = bs.solve(robot, load=bs.Load([40, 0, 0], disk_forces=forces))
    >>> pushed.disk_positions[3].round(4)
    array([0.0441, 0.0073, 0.2801])
    """

    tensions: Any = None
    displacements: Any = None
    angles: Any = None
    gravity: Any = None
    tip_force: Any = None
    tip_moment: Any = None
    disk_forces: Any = None
    disk_moments: Any = None

    @property
    def is_tension_controlled(self) -> bool:
        """Whether no tendon has a displacement or an angle."""
        return self.displacements is None and self.angles is None

    def replace(self, **changes: Any) -> Load:
        """Return a copy with other values."""
        unknown = sorted(set(changes) - {field.name for field in fields(self)})
        if unknown:
            raise InputError(f"a load has no {unknown[0]}")
        return replace(self, **changes)


_NO_LOAD = Load()
ON_DISKS: Final = {"disk_forces": "N", "disk_moments": "N m"}
"""Loads on disks, with their units."""


def as_load(tensions: object, load: Load | None) -> Load:
    """Merge the arguments `tensions` and `load` of a solve into one load."""
    if load is None:
        return _NO_LOAD if tensions is None else Load(tensions)
    if not isinstance(load, Load):
        raise InputError(f"load is {shown(load)}, it must be a bowstring.Load")
    if tensions is None:
        return load
    if load.tensions is not None:
        raise InputError("tensions and load.tensions are both given; give one of them")
    return replace(load, tensions=tensions)


def disk_shape(name: str, disks: int | str = "N", rows: str = "") -> str:
    """Write the shape of a load on disks for a message; `rows` is a further one."""
    return f"({disks}, 3){rows}: one vector for each disk, in {ON_DISKS[name]}"


def with_arrays(load: Load, rows: str = "") -> Load:
    """Return a load with the loads on its disks as arrays, whose shapes the core checks.

    `rows` is a shape beside (N, 3) for messages.
    """
    given = {name: getattr(load, name) for name in ON_DISKS}
    arrays = {
        name: read(name, value, f"numbers of shape {disk_shape(name, rows=rows)}")
        for name, value in given.items()
        if value is not None and not _is_array(value)
    }
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

    @property
    def dead(self) -> Load:
        """Forces and moments as a load with the robot's gravity."""
        return Load(
            tip_force=self.tip_force,
            tip_moment=self.tip_moment,
            disk_forces=_by_disks(self.disk_forces),
            disk_moments=_by_disks(self.disk_moments),
        )

    @property
    def has_moment(self) -> bool:
        """Whether a moment acts on the tip or on a disk."""
        return bool(self.tip_moment.any() or self.disk_moments.any())

    @property
    def row(self) -> InstantLoad:
        """Each array as one row of a table."""
        return InstantLoad(*(array[None] for array in self))


def _by_disks(components: Floats) -> Floats | None:
    return components.reshape(-1, 3) if len(components) else None
