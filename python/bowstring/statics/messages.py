"""Messages on the result of a solve, with advice if it failed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, Literal

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.formatting import listed

#: Status of an equilibrium.
StaticsStatus = Literal["converged", "max_iterations", "unstable", "no_equilibrium"]

NEEDED: Final = (
    *("status", "stable", "residual", "iterations"),
    *("left_unstable", "fraction", "collision"),
)
"""Attributes of a solution that a message needs."""
_CONVERGED: Final = 1e-10  # tolerance of the residual
_ANOTHER_BRANCH: Final = 1e-2  # error of a tip over the length, above which it is on another branch
_MUCH_FRICTION: Final = 1.0  # a failed solve with a larger coefficient gets a hint


def _tendons(indices: Sequence[int] | Ints) -> str:
    """Names of tendons, such as "tendon 2" or "tendons 1, 2 and 4"."""
    return f"tendon{'s' * (len(indices) > 1)} {listed([str(int(i) + 1) for i in indices])}"


def discretisation(
    error: tuple[float, float],
    tensions: Floats,
    length: float,
    elements: int | None,
    path: bool = False,
) -> str:
    """Warning of a discretisation error above the tolerance of adaptive elements, or "".

    ``error`` is that of the tip in m and of tensions in N; `path` says whether it is that of a
    path with a memory, which is followed with two numbers of elements.
    """
    largest = float(np.nanmax(np.abs(tensions), initial=0.0))
    of_tip, of_tension = error
    tip, tension = of_tip > 1e-5 * length, of_tension > 1e-4 * largest
    if not (tip or tension):
        return ""
    parts = [f"tip by up to {1e3 * of_tip:.2g} mm"] if tip else []
    parts += [f"tensions by up to {of_tension:.2g} N"] if tension else []
    what = " and ".join(parts)
    if path and of_tip > _ANOTHER_BRANCH * length:
        return (
            " The path may have turned to another branch: with another number of elements than "
            f"{elements} per module it is elsewhere, the {what}. Take smaller steps."
        )
    s = "" if elements == 1 else "s"
    cure = "" if elements == 8 else " Leave the number of elements out, or take more."
    return f" Discretisation error: the {what} ({elements} element{s} per module).{cure}"


def without_potential(found: Any, short: bool = False) -> str:
    """Name the load without a potential of a solution of the core."""
    moments = [getattr(found, name, None) for name in ("tip_moment", "disk_moments")]
    if any(v is not None and np.any(v) for v in moments) or found.point_loads is None:
        return "a dead moment" if short else "a dead moment, which keeps its direction,"
    return "a follower load" if short else "a follower load, which turns with its disk,"


def _has_potential(found: Any) -> bool:
    """Whether a solution is known to bear neither moments nor loads at points."""
    loads = [getattr(found, name, np.nan) for name in ("tip_moment", "disk_moments", "point_loads")]
    return not any(load is not None and np.any(load) for load in loads)


def of_solution(found: Any, advice: str = "") -> str:
    """Message on a solve by tensions, with advice if it failed.

    `found` is a solution of the core, or has the attributes `NEEDED`; ``advice`` is that of
    `bowstring.robot.plausibility.load_advice`.
    """
    stable = found.stable
    match found.status:
        case "converged":
            if found.left_unstable and stable:
                return (
                    "The robot buckled: the path from straight led to an unstable equilibrium; "
                    "one of several stable branches is returned. A small load to one side chooses "
                    "the branch."
                )
            if stable is False:
                return (
                    f"An equilibrium, but not a stable one: {without_potential(found)} leads to "
                    "it from a stable one, and small motions about it grow."
                )
            if stable is None:
                few = "there are too few elements to decide."
                if _has_potential(found):
                    return f"An equilibrium; whether it is stable is not known: {few}"
                return (
                    f"An equilibrium; whether it is stable is not known: "
                    f"{without_potential(found, short=True)} has no potential and lets small "
                    f"oscillations grow unless they are damped by more than 1 %, or {few}"
                )
            return "A stable equilibrium."
        case "no_equilibrium":
            k = max(found.collision or 0, 0)
            disks = "the base and disk 1" if k == 0 else f"disks {k} and {k + 1}"
            return (
                f"No equilibrium: {disks} collide, because the load closes the gap between them. "
                f"{advice}Check the tensions, or lower the load."
            )
        case "unstable":
            return (
                "Only an unstable equilibrium was found, and four attempts to leave it led back. "
                "Add a small load to one side, or approach this load by a sweep."
            )
        case _ if found.residual <= _CONVERGED and found.fraction == 1:
            return (
                "No equilibrium was resolved: the backbone bends too sharply between two disks for "
                "an error to be stated, with as many elements as there are. "
                f"{advice}Lower the load."
            )
        case _:
            share = found.fraction
            reached = "none of the load" if share == 0 else f"{100 * share:.3g} % of the load"
            return (
                f"No equilibrium was found: {reached} converged, then the solver gave up after "
                f"{_effort(found)}. An actuated tendon or the compressed backbone "
                f"between two disks is probably at its limit (buckling between disks). {advice}"
                "Lower the load."
            )


_WITHOUT_POTENTIAL: Final = "a dead moment, hysteresis or relaxation has"


def of_actuation(
    found: Any,
    slack: Sequence[int] | Ints,
    friction: float,
    advice: str = "",
    held: bool = False,
) -> str:
    """Message on a step of a path, with advice if it failed.

    ``slack`` are indices from 0; ``friction`` is the largest coefficient; ``held`` says whether
    tendons are held at their home length while others are shortened. The others are as in
    `of_solution`; `found` also has ``undetermined`` and ``conflict``.
    """
    opposing, nearest = found.conflict
    match found.status:
        case "converged":
            if found.stable:
                said = "A stable equilibrium."
            else:
                why = "friction has" if friction > 0 else _WITHOUT_POTENTIAL
                said = (
                    "An equilibrium; whether it is stable is not known, because "
                    f"{why} no potential."
                )
            if len(slack):
                verb = "is" if len(slack) == 1 else "are"
                said += f" {_tendons(slack).capitalize()} {verb} slack."
            if found.undetermined:
                said += " The displacements do not determine the tensions: these are the smallest."
            return said
        case "no_equilibrium" if nearest is not None:
            why = ""
            if len(opposing) == 1:
                why = f": {_tendons(opposing)} is displaced farther than the robot can follow"
            elif opposing:
                why = f": {_tendons(opposing)} have conflicting displacements"
            near = ", ".join(
                f"{round(1e3 * p, 4) + 0.0:g}" if np.isfinite(p) else "-" for p in nearest
            )
            return (
                f"No equilibrium for these displacements{why}. "
                f"The nearest that have one are {near} mm."
            )
        case "no_equilibrium":
            return (
                f"No equilibrium: two neighbouring disks collide. {advice}Lower displacements, "
                "tensions and loads."
            )
        case "unstable" if held:
            return (
                "Only an unstable equilibrium was found. 0 holds a tendon at its home length; give "
                "slack tendons a negative displacement or tension 0."
            )
        case "unstable":
            return (
                "Only an unstable equilibrium was found. Add a small load to one side, or approach "
                "this one by a sweep."
            )
        case _:
            doubt = ""
            if friction > _MUCH_FRICTION:
                doubt = (
                    f"Check the friction coefficient of {friction:g}: that of a tendon in a "
                    "smooth hole is 0.05 to 0.5. "
                )
            return (
                f"No equilibrium was found: the solver gave up after {_effort(found)}. "
                f"{advice}{doubt}Approach it by a sweep in smaller steps, or lower displacements, "
                "tensions and loads."
            )


def _effort(found: Any) -> str:
    left = f" (residual {found.residual:.2g})" if np.isfinite(found.residual) else ""
    return f"{found.iterations} iterations{left}"
