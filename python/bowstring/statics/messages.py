"""Sentences on how a solve ended and what to try."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["discretisation", "of_actuation", "of_tensions"]

Floats = NDArray[np.float64]

_MUCH_FRICTION: Final = 1.0  # coefficients beyond this are doubted where there is no answer


def _tendons(indices: Sequence[int] | NDArray[np.int64]) -> str:
    """The names of tendons, as "tendon 2" or "tendons 1, 2 and 4"."""
    numbers = [str(int(i) + 1) for i in indices]
    if len(numbers) == 1:
        return f"tendon {numbers[0]}"
    return f"tendons {', '.join(numbers[:-1])} and {numbers[-1]}"


def discretisation(
    error: tuple[float, float], tensions: Floats, length: float, elements: int | None
) -> str:
    """A sentence if an answer is less exact than elements are chosen for, else nothing.

    ``error`` is that of the tip in m and of tensions in N.
    """
    largest = float(np.nanmax(tensions, initial=0.0))
    of_tip, of_tension = error
    tip, tension = of_tip > 1e-5 * length, of_tension > 1e-4 * largest
    if not (tip or tension):
        return ""
    parts = [f"tip by up to {1e3 * of_tip:.2g} mm"] if tip else []
    parts += [f"tensions by up to {of_tension:.2g} N"] if tension else []
    what = " and ".join(parts)
    cure = "" if elements == 8 else " Leave the number of elements out, or take more."
    return f" Discretisation error: the {what} ({elements} per module).{cure}"


def of_tensions(
    status: str,
    stable: bool | None,
    left_unstable: bool,
    fraction: float,
    collision: int | None,
    residual: float,
    iterations: int,
    advice: str = "",
) -> str:
    match status:
        case "converged":
            if left_unstable and stable:
                return (
                    "The robot buckled: the way from straight led to an unstable equilibrium; "
                    "one of several stable branches is returned. A small load to one side chooses "
                    "the branch."
                )
            if stable is False:
                return (
                    "An equilibrium, but not a stable one: the tip moment, which keeps its "
                    "direction, leads to it from a stable one, and small motions about it grow."
                )
            if stable is None:
                return (
                    "An equilibrium; whether it is stable is not known: a tip moment has no "
                    "potential and lets small oscillations grow unless they are damped by more "
                    "than 1 %, or so few elements do not tell."
                )
            return "A stable equilibrium."
        case "no_equilibrium":
            k = collision if collision is not None else 0
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
        case _:
            reached = "none of the load" if fraction == 0 else f"{100 * fraction:.3g} % of the load"
            left = f" (residual {residual:.2g})" if np.isfinite(residual) else ""
            return (
                f"No equilibrium was found: {reached} converged, then the solver gave up after "
                f"{iterations} iterations{left}. A pulled tendon or the compressed backbone "
                f"between two disks is probably at its limit (buckling between disks). {advice}"
                "Lower the load."
            )


def of_actuation(
    status: str,
    stable: bool | None,
    slack: Sequence[int] | NDArray[np.int64],
    undetermined: bool,
    friction: float,
    conflict: tuple[Sequence[int], Sequence[float] | None],
    residual: float,
    iterations: int,
    advice: str = "",
) -> str:
    """How a step ended and, if it failed, what to try.

    ``slack`` counts from 0; ``friction`` is the largest coefficient; ``advice`` is that of
    `bowstring.robot.plausibility.load_advice`.
    """
    fighting, nearest = conflict
    match status:
        case "converged":
            if stable:
                said = "A stable equilibrium."
            else:
                why = "friction has" if friction > 0 else "a tip moment has"
                said = (
                    "An equilibrium; whether it is stable is not known, because "
                    f"{why} no potential."
                )
            if len(slack):
                hang = "hangs" if len(slack) == 1 else "hang"
                said += f" {_tendons(slack).capitalize()} {hang} slack."
            if undetermined:
                said += " The pulls do not determine the tensions: these are the smallest."
            return said
        case "no_equilibrium" if nearest is not None:
            fight = "" if len(fighting) < 2 else f": {_tendons(fighting)} pull against each other"
            if len(fighting) == 1:
                fight = f": {_tendons(fighting)} is pulled farther than the robot can follow"
            near = ", ".join(
                f"{round(1e3 * p, 4) + 0.0:g}" if np.isfinite(p) else "-" for p in nearest
            )
            return (
                f"No equilibrium for these pulls{fight}. The nearest that have one are {near} mm."
            )
        case "no_equilibrium":
            return (
                f"No equilibrium: two neighbouring disks collide. {advice}Lower pulls, tensions "
                "and loads."
            )
        case "unstable":
            return (
                "Only an unstable equilibrium was found. Add a small load to one side, or approach "
                "this one by a sweep."
            )
        case _:
            left = f" (residual {residual:.2g})" if np.isfinite(residual) else ""
            doubt = ""
            if friction > _MUCH_FRICTION:
                doubt = (
                    f"Check the friction coefficient of {friction:g}: that of a tendon in a "
                    "smooth hole is 0.05 to 0.5. "
                )
            return (
                f"No equilibrium was found: the solver gave up after {iterations} iterations"
                f"{left}. {advice}{doubt}Approach it by a sweep in smaller steps, or lower pulls, "
                "tensions and loads."
            )
