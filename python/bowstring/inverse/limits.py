"""Limits of tensions and displacements in inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError

if TYPE_CHECKING:
    from bowstring.robot.model import Robot


@short_repr
@dataclass(frozen=True, eq=False)
class ActuationLimits:
    """Limits of tensions and displacements, of all tendons or of each.

    Parameters
    ----------
    min_tension, max_tension : array_like () or (T,), optional
        Least and largest tension in N. The default is 0 N, and for each tendon the tension that
        bends its segment by half a turn by the linear law; of rods and chambers minus that tension
        to it.
    displacement_limits : array_like (2,) or (2, T), optional
        Least and largest displacement in m from the home pose. None by default.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot, limits = bs.load_robot("rao2021"), bs.ActuationLimits(min_tension=0.5)
    >>> bs.inverse_kinematics(robot, [0.12, 0.05, 0.36], limits=limits).tensions.round(2)
    array([0.5 , 0.5 , 3.34, 4.2 , 4.46, 0.5 ])
    """

    min_tension: ArrayLike | None = None
    max_tension: ArrayLike | None = None
    displacement_limits: ArrayLike | None = None

    def tensions(self, robot: Robot) -> tuple[Floats, Floats]:
        """Least and largest tension (T,) of the tendons of a robot, N."""
        if self.min_tension is None:
            least = np.where(robot.tendons.pushes, -default_max_tension(robot), 0.0)
        else:
            least = _limit(robot, "min_tension", self.min_tension)
        if self.max_tension is None:
            most = np.maximum(default_max_tension(robot), least)
        else:
            most = _limit(robot, "max_tension", self.max_tension)
        for i in np.flatnonzero(least > most)[:1]:
            raise InputError(
                f"min_tension of tendon {i + 1} is {least[i]:g} N and its max_tension "
                f"{most[i]:g} N; the least must not be above the largest"
            )
        return least, most

    def displacements(self, robot: Robot) -> tuple[Floats, Floats] | None:
        """Least and largest displacement (T,) of the tendons of a robot, m; None without any."""
        if self.displacement_limits is None:
            return None
        count = robot.core.tendon_count
        what = f"two numbers in m, the least and the largest, or two rows of {count}"
        found = validation.read("displacement_limits", self.displacement_limits, what)
        if found.shape not in ((2,), (2, count)):
            raise InputError(
                f"displacement_limits has shape {found.shape}, it must be (2,) or (2, {count})"
            )
        least, most = (np.array(np.broadcast_to(row, (count,))) for row in found)
        for i in np.flatnonzero(~(np.isfinite(least) & np.isfinite(most) & (least < most)))[:1]:
            raise InputError(
                f"displacement_limits of tendon {i + 1} are {least[i]:g} m and {most[i]:g} m; they "
                "must be finite, and the least below the largest"
            )
        return least, most


def default_max_tension(robot: Robot) -> Floats:
    """Tension of each tendon that bends its segment by half a turn by the linear law.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    ndarray (T,)
        In N.
    """
    segments = robot.tendons.segment
    lengths = np.array([segment.length for segment in robot.segments])
    every = np.arange(len(segments))
    arms = np.linalg.norm(robot.tendons.mean_hole_m[segments, every], axis=-1)
    arms = np.maximum(arms, 1e-3 * robot.length)
    stiffness = np.asarray(robot.bending_stiffness)
    return np.asarray(np.pi * stiffness[segments] / (lengths[segments] * arms))


def _limit(robot: Robot, name: str, given: ArrayLike) -> Floats:
    count = robot.core.tendon_count
    found = validation.read(name, given, f"a number or {count} numbers in N")
    if found.shape not in ((), (count,)):
        raise InputError(f"{name} has shape {found.shape}, it must be one number or ({count},)")
    found = np.array(np.broadcast_to(found, (count,)))
    possible = np.isfinite(found) & (found >= robot.tendons.least_tension_N)
    for i in np.flatnonzero(~possible)[:1]:
        rule = "a finite number" + ("" if robot.tendons.pushes[i] else ", 0 N or more")
        raise InputError(f"{name} of tendon {i + 1} is {found[i]:g} N; it must be {rule}")
    return found
