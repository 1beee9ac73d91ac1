"""Loads on a robot: actuation, gravity, forces and moments on tip, disks and backbone.

`bowstring.statics.load_tables` has them as arrays.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.validation import is_whole, number, row, shown, truth


@short_repr
@dataclass(frozen=True)
class PointLoad:
    """A force and a moment on a point that is fixed to a disk, or to a section of the backbone.

    Parameters
    ----------
    disk : int
        Disk, index from 0 at the base; -1, the tip, if left out.
    force, moment : array_like (3,)
        Force in N and moment in N m. In `bowstring.simulate` they may depend on time as all loads.
    point : array_like (3,)
        Point at which the force acts, from the centre of the disk in the axes of the disk, in m;
        with an arc length, from the centre of the section in its axes.
    follower : bool
        Whether force and moment turn with the disk or section (follower loads): their components
        are then in its axes. Otherwise they are dead loads in base axes.
    arc_length : float, optional
        Arc length of the section of the straight backbone on which the load acts instead of a disk,
        in m from the base. Up to seven sections between two disks may be loaded.

    Raises
    ------
    InputError
        If a value is not one of these, or both a disk and an arc length are given.

    Examples
    --------
    A jet at the tip that pushes 0.5 N to the side of the last disk:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> jet = bs.PointLoad(force=[0.5, 0, 0], follower=True)
    >>> bs.solve(robot, [0, 0, 0], load=bs.Load(point_loads=[jet])).tip.position.round(4)
    array([0.0394, 0.    , 0.6395])

    A force of 1 N on the backbone between the first and the second disk:

    >>> touch = bs.PointLoad(arc_length=0.1, force=[0, 1, 0])
    >>> bs.solve(robot, [0, 0, 0], load=bs.Load(point_loads=touch)).tip.position.round(4)
    array([0.    , 0.0028, 0.641 ])
    """

    disk: int = -1
    force: Any = (0.0, 0.0, 0.0)
    moment: Any = (0.0, 0.0, 0.0)
    point: Any = (0.0, 0.0, 0.0)
    follower: bool = False
    arc_length: float | None = None

    def __post_init__(self) -> None:
        if not is_whole(self.disk):
            raise InputError.of("disk", shown(self.disk), "a whole number, the index of a disk")
        object.__setattr__(self, "disk", int(self.disk))
        for name, unit in (("force", "N"), ("moment", "N m"), ("point", "m")):
            value = getattr(self, name)
            if name != "point" and depends_on_time(value):
                continue
            numbers = row(name, value, 3, unit)
            object.__setattr__(self, name, tuple(numbers.tolist()))
        truth("follower", self.follower)
        if self.arc_length is None:
            return
        object.__setattr__(self, "arc_length", number("arc_length", self.arc_length, "m"))
        if self.disk != -1:
            raise InputError(
                f"disk is {self.disk} and arc_length is {self.arc_length:g} m; give one of them"
            )

    def on(self, disks: int) -> PointLoad:
        """Return the load with the index of its disk from the base, on a robot of so many."""
        if self.arc_length is not None or not -disks <= self.disk < 0:
            return self
        return replace(self, disk=self.disk + disks)

    def numbers(self, force: Any = None, moment: Any = None) -> list[float]:
        """Disk, point, force, moment, 1 for a follower, and arc length, -1 for a load on a disk.

        Force and moment may be replaced.
        """
        force = self.force if force is None else force
        moment = self.moment if moment is None else moment
        place = -1.0 if self.arc_length is None else self.arc_length
        return [float(self.disk), *self.point, *force, *moment, float(self.follower), place]

    @classmethod
    def of_numbers(cls, numbers: Iterable[float]) -> PointLoad:
        """Make a point load of its `numbers`."""
        disk, *rest, follower, place = numbers
        point, force, moment = (tuple(rest[at : at + 3]) for at in (0, 3, 6))
        if place >= 0:
            return cls(-1, force, moment, point, bool(follower), place)
        return cls(int(disk), force, moment, point, bool(follower))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a file, SI; the disk counts from 1, or is None for the tip.

        A load between two disks has an arc length instead.
        """
        on_disk = {"disk": None if self.disk == -1 else self.disk + 1}
        place = on_disk if self.arc_length is None else {"arc_length_m": self.arc_length}
        return {
            **place,
            "point_m": list(self.point),
            "force_N": _plain(self.force),
            "moment_Nm": _plain(self.moment),
            "follower": self.follower,
        }

    @classmethod
    def of_dict(cls, item: Mapping[str, Any]) -> PointLoad:
        """Make a point load of the plain values of `to_dict`."""
        place = item.get("arc_length_m")
        disk = -1 if place is not None or item["disk"] is None else item["disk"] - 1
        wrench = (item["force_N"], item["moment_Nm"])
        return cls(disk, *wrench, item["point_m"], item["follower"], place)


def depends_on_time(value: object) -> bool:
    """Whether a force or moment is a function of time."""
    return callable(value) or hasattr(value, "knots")


def _plain(value: Any) -> Any:
    if depends_on_time(value):
        return "function of time" if callable(value) else value.to_dict()
    return list(value)


@short_repr
@dataclass(frozen=True, eq=False)
class Load:
    """Actuation of the tendons, gravity, and loads at the tip, on disks and on the backbone.

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
    point_loads : PointLoad or sequence of PointLoad, optional
        Loads beside the centres of disks, loads between disks, and loads that turn with their disk
        or section (followers).
    line_forces : array_like (3,) or (N, 3), optional
        Dead force per length of backbone in base axes, N/m: on all of it, or on each of the N parts
        that end at a disk. None if left out.
    base : bowstring.BaseMotion, optional
        Motion of the base, for `bowstring.simulate` only; it does not move if left out.

    Notes
    -----
    `bowstring.sweep` and `bowstring.solve_batch` take rows: actuation (n, T), loads on disks (N, 3)
    or (n, N, 3), the others (3,) or (n, 3); point loads and forces per length are the same in all
    rows. In `bowstring.simulate` all but gravity may depend on
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
    point_loads: Any = None
    line_forces: Any = None
    base: Any = None

    def __post_init__(self) -> None:
        given = self.point_loads
        if given is not None and not isinstance(given, np.ndarray):
            object.__setattr__(self, "point_loads", point_loads(given))

    @property
    def given(self) -> set[str]:
        """Names of the loads that are not left out."""
        return {name for name, value in vars(self).items() if value is not None}

    @property
    def is_actuated(self) -> bool:
        """Whether any tendon has a tension, a displacement or an angle."""
        return not (self.tensions is None and self.is_tension_controlled)

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
    merged = object.__new__(Load)  # 0.6 us; dataclasses.replace takes 2.9 us
    merged.__dict__.update(load.__dict__, tensions=tensions)
    return merged


def point_loads(given: Any) -> tuple[PointLoad, ...]:
    """Check a sequence of point loads."""
    loads = () if given is None else given
    if isinstance(loads, PointLoad):
        loads = (loads,)
    try:
        loads = tuple(loads)
    except TypeError:
        loads = (None,)
    if not all(isinstance(load, PointLoad) for load in loads):
        raise InputError(f"point_loads is {shown(given)}, it must be a sequence of PointLoad")
    return loads
