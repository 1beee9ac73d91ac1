"""Convergence study of the finite elements: meshes, stiffness of disks, time steps.

Each of these is varied separately in three levels. Richardson extrapolation of the three tips to
zero size and rigid disks gives its remaining change. The limit is the finest tip plus all these
changes, and its uncertainty the sum of theirs: the extrapolated part if the errors follow C h^p
with an observed order p, otherwise the last change as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq

from bowstring.aliases import Floats, Progress
from bowstring.errors import InputError
from bowstring.fem.run import BrickRun, Motion, Settings, ramp, sweep
from bowstring.results import Key, Result
from bowstring.robot.model import Robot

_STEEPEST: Final = 6.0  # largest plausible order
_FLATTEST: Final = 0.5
_ALONG: Final = 4  # bricks along a module while something else is varied


@dataclass(frozen=True)
class Refinement(Result):
    """Refinement of the mesh in one direction."""

    name: Annotated[str, Key()]
    """Refined size."""
    sizes: tuple[float, ...]
    """Sizes (3,), decreasing."""
    labels: Annotated[tuple[str, ...], Key("of")]
    """Meshes, coarse to fine."""
    tips: Annotated[Floats, Key("tip_position_m")]
    """Position of the tip by mesh and load (3, K, 3), m."""
    order: Annotated[float, Key()]
    """Observed order of convergence of the transverse tip displacement at the last load; NaN if
    there is none."""
    limit: Annotated[Floats, Key("limit_m")]
    """Extrapolated position of the tip at each load (K, 3), m."""
    uncertainty: Annotated[Floats, Key("uncertainty_m")]
    """Uncertainty of the extrapolation at each load (K, 3), m."""


@dataclass(frozen=True)
class Convergence:
    """Requested run, its refinements, and the limit (K, 3) of the tip in m.

    ``error`` (K,) is the uncertainty of the limit in m.
    """

    run: BrickRun
    refinements: tuple[Refinement, ...]
    limit: Floats
    error: Floats


def extrapolated(sizes: Sequence[float], values: Floats) -> tuple[Floats, Floats, float]:
    """Richardson limit of values (3, ...) at decreasing sizes, its uncertainty, and observed order.

    The order is that of the component that changes most. If it is not between 0.5 and 6, the limit
    is the last value and its uncertainty the larger of the two changes. The same holds for any
    other component that does not converge.
    """
    a, b, c = (float(h) for h in sizes)
    first, last = values[1] - values[0], values[2] - values[1]
    uncertainty: Floats = np.maximum(np.abs(first), np.abs(last))
    place = np.unravel_index(np.abs(last).argmax(), last.shape)
    ratio = float(first[place] / last[place]) if last[place] != 0 else np.nan

    def of_order(p: float) -> float:
        return float((a**p - b**p) / (b**p - c**p))

    slow = of_order(_FLATTEST)
    if not slow < ratio < of_order(_STEEPEST):
        return values[2], uncertainty, float("nan")
    order = float(brentq(lambda p: of_order(p) - ratio, _FLATTEST, _STEEPEST))
    rest = last * c**order / (b**order - c**order)
    settles = (first * last >= 0) & (np.abs(first) >= slow * np.abs(last))
    return (
        values[2] + np.where(settles, rest, 0.0),
        np.where(settles, np.abs(rest), uncertainty),
        order,
    )


def study(
    robot: Robot,
    tensions: ArrayLike,
    *,
    settings: Settings | None = None,
    motion: Motion | None = None,
    progress: Progress | None = None,
) -> Convergence:
    """Run the requested settings, and finer and coarser ones.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (K, T)
        Tensions of a sweep in N; for a motion (T,), after the rise.
    settings : Settings, optional
        Settings of the run; the levels are half, once and twice its bricks along a module, and
        likewise for the other sizes.
    motion : Motion, optional
        Ramp in place of a sweep.
    progress : callable, optional

    Returns
    -------
    Convergence

    Raises
    ------
    InputError
        If finer or coarser settings are not possible.
    NoSolutionError
        If one of the runs fails; finished runs are kept.
    """
    settings = settings or Settings()
    mesh = settings.fineness
    # fewer bricks along would hide the effect of bricks around
    along = min(mesh.module, max(_ALONG, mesh.module // 2))
    coarse = replace(settings, fineness=replace(mesh, module=along))
    # each of three levels: size, label, settings, step
    along_a_module = [
        (1.0 / n, str(n), replace(settings, fineness=replace(mesh, module=n)), 1.0)
        for n in (max(2, mesh.module // 2), mesh.module, 2 * mesh.module)
    ]
    around = [
        (1.0 / n, str(n), replace(coarse, fineness=replace(coarse.fineness, around=n)), 1.0)
        for n in (mesh.around, mesh.around + 4, mesh.around + 8)
    ]
    stiffness = [
        (1.0 / k, f"{k:g}", replace(coarse, stiffness=k), 1.0)
        for k in settings.stiffness * np.array([0.1, 0.3, 1.0])
    ]
    # name, index of the requested level, and the three levels
    plans = [
        ("bricks along a module", 1, along_a_module),
        ("bricks around", 0, around),
        ("stiffness of disks", 2, stiffness),  # stiffer ones lose digits
    ]
    if motion is not None:
        steps = [(s, f"{1e3 * s * motion.dt:g} ms", coarse, s) for s in (2.0, 1.0, 0.5)]
        plans.append(("time step", 1, steps))
    for name, _, plan in plans:  # checked before any work
        for _, label, chosen, _ in plan:
            try:
                chosen.check()
            except InputError as wrong:
                raise InputError(f"the study also takes {label} as {name}: {wrong}") from None
    notify = progress or (lambda what, share: None)
    count = 1 + sum(len(plan) for *_, plan in plans)
    done = 0

    def one(what: str, chosen: Settings, step: float) -> BrickRun:
        def part(text: str, share: float) -> None:
            notify(f"{what}: {text.removeprefix('finite elements, ')}", (done + share) / count)

        if motion is None:
            found = sweep(robot, tensions, settings=chosen, progress=part)
        else:
            stepped = replace(motion, dt=step * motion.dt)
            found = ramp(robot, tensions, stepped, settings=chosen, progress=part)
        return found.raise_for_status()

    run = one("as asked", settings, 1.0)
    done += 1
    refinements = []
    limit, error = run.tip_position.copy(), np.zeros(len(run.states))
    for name, at, plan in plans:
        rows = []
        for _, label, chosen, step in plan:
            rows.append(one(f"{name} {label}", chosen, step).tip_position)
            done += 1
        tips, (sizes, labels, *_) = np.array(rows), zip(*plan, strict=True)
        end, uncertainty, order = extrapolated(sizes, tips)
        refinements.append(Refinement(name, sizes, labels, tips, order, end, uncertainty))
        limit = limit + (end - tips[at])
        error = error + np.linalg.norm(uncertainty, axis=1)
    return Convergence(run, tuple(refinements), limit, error)
