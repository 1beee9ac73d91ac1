"""Loads on a robot: actuation, gravity, tip force and tip moment."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.validation import shown

__all__ = ["InstantLoad", "Load", "as_load"]

Floats = NDArray[np.float64]


@short_repr
@dataclass(frozen=True, eq=False)
class Load:
    """Actuation of the tendons, gravity, and force and moment at the tip.

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

    Notes
    -----
    `bowstring.sweep` and `bowstring.solve_batch` take rows: actuation (n, T), the others (3,) or
    (n, 3). In `bowstring.simulate` all but gravity may depend on time: a table
    (`bowstring.dynamics.ramp`, ``step``, ``Table``) or a function of time in s.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> load = bs.Load(displacements=[0.02, -0.03, -0.03], tip_force=[0, 0, -0.5])
    >>> bs.solve(robot, load=load).status
    'converged'
    """

    tensions: Any = None
    displacements: Any = None
    angles: Any = None
    gravity: Any = None
    tip_force: Any = None
    tip_moment: Any = None

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
    return replace(load, tensions=tensions)


class InstantLoad(NamedTuple):
    """Checked loads at one time: actuation of each tendon, force and moment at the tip."""

    actuation: Floats
    """Tension in N or displacement in m of each tendon (T,)."""
    tip_force: Floats
    tip_moment: Floats

    @property
    def at_tip(self) -> Load:
        """Force and moment at the tip as a load with the robot's gravity."""
        return Load(tip_force=self.tip_force, tip_moment=self.tip_moment)
