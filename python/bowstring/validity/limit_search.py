"""Ramps of tension of many robots, some of which end beyond their last equilibrium."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Bools, Floats
from bowstring.jobs import threads
from bowstring.statics.design_sweeps import sweep_designs
from bowstring.validity.effects import Rods

Ints = NDArray[np.intp]

_SAMPLE: Final = 16  # robots for each one of the sample
_FEWEST: Final = 4  # loads of a ramp that is searched


class Solved(NamedTuple):
    """Results of D robots at L loads each; NaN without an equilibrium.

    `gave_up` is where the solver found no equilibrium, which does not prove that there is none; it
    is false at loads that were not tried.
    """

    converged: Bools
    tip: Floats
    tendon_lengths: Floats
    tip_error: Floats
    gave_up: Bools


def gave_up(status: ArrayLike) -> Bools:
    """Where the solver gave up, by the status of solutions."""
    return np.asarray(np.asarray(status) == "max_iterations")


def solve_ramps(rods: Rods, tensions: Floats) -> Solved:
    """Solve ramps of tension, each load from the one before, up to the first without equilibrium.

    A load that has none takes as long as a hundred others, because the solver tries several ways to
    it. So where a ramp has a load and its end without equilibrium, the loads between count as
    without. For this, robots whose end a quick solve does not reach are taken apart: by bisection
    with such solves the search finds about the last load with an equilibrium, and follows the ramp
    from its start to the first load without one.

    Parameters
    ----------
    rods : Rods
        Robots with given tensions.
    tensions : ndarray (D, L, T)
        Tensions in N.

    Returns
    -------
    Solved
        The same as if all loads were solved, except for loads between one without equilibrium and
        an end without one.
    """
    count, loads, tendons = tensions.shape
    rows = np.arange(count)
    if loads < _FEWEST or rods.designs.arrays.tendons.friction.any():
        return _solve(rods, tensions)  # with friction a path ends at its first such load
    order = np.argsort(tensions[:, -1].sum(axis=-1))
    sample = np.sort(order[::-_SAMPLE])
    if _reached(rods, tensions, sample, np.full(len(sample), loads - 1)).all():
        return _solve(rods, tensions)
    ends = _reached(rods, tensions, rows, np.full(count, loads - 1))
    out = Solved(
        np.zeros((count, loads), bool),
        np.full((count, loads, 3), np.nan),
        np.full((count, loads, tendons), np.nan),
        np.full((count, loads), np.nan),
        np.zeros((count, loads), bool),
    )
    whole, beyond = [rows[ends]], rows[~ends]
    stop, step = _last_reached(rods, tensions, beyond), 1
    first = np.full(count, loads)  # loads before the first without equilibrium
    while beyond.size:
        found = _start(rods, tensions, beyond, stop + 1)
        for i, (row, last) in enumerate(zip(beyond, stop + 1, strict=True)):
            for to, values in zip(out, found, strict=True):
                to[row, :last] = values[i, -last:]
            fails = ~out.converged[row, :last]
            first[row] = fails.argmax() if fails.any() else loads
        left = (first[beyond] == loads) & (stop < loads - 1)
        beyond, stop = beyond[left], np.minimum(stop[left] + step, loads - 1)
        step *= 2
    beyond = np.flatnonzero(first < loads - 1)
    if beyond.size:
        found = _start(rods, tensions, beyond, first[beyond], end=True)
        whole.append(beyond[found.converged[:, -1]])
    at = np.concatenate(whole)
    if at.size:
        for to, values in zip(out, _solve(_some(rods, at), tensions[at]), strict=True):
            to[at] = values
    return out


def reach(rods: Rods, tensions: Floats) -> int:
    """Estimate how far a ramp of one robot is solved, by a few quick solves.

    Parameters
    ----------
    rods : Rods
        One robot with given tensions.
    tensions : ndarray (L, T)
        Ramp from a load with an equilibrium on, N.

    Returns
    -------
    int
        Index of the last load with an equilibrium, by these solves.
    """
    ramp, row = tensions[None], np.zeros(1, dtype=int)
    last = len(tensions) - 1
    if _reached(rods, ramp, row, np.array([last]))[0]:
        return last
    return int(_last_reached(rods, ramp, row)[0])


def _start(rods: Rods, tensions: Floats, rows: Ints, count: Ints, *, end: bool = False) -> Solved:
    """Solve the first `count` loads of some ramps, and with `end` their ends.

    The first load is repeated before ramps with fewer, so that all are one call.
    """
    places = np.arange(count.max()) - (count.max() - count)[:, None]
    path = np.maximum(places, 0)
    if end:
        path = np.column_stack([path, np.full(len(rows), tensions.shape[1] - 1)])
    return _solve(_some(rods, rows), tensions[rows[:, None], path])


def _last_reached(rods: Rods, tensions: Floats, rows: Ints) -> Ints:
    """Index of the last load of some ramps that a quick solve reaches, found by bisection."""
    low = np.zeros(len(rows), int)
    high = np.full(len(rows), tensions.shape[1] - 1)
    while (open_ := np.flatnonzero(high - low > 1)).size:
        middle = (low[open_] + high[open_]) // 2
        reached = _reached(rods, tensions, rows[open_], middle)
        low[open_[reached]], high[open_[~reached]] = middle[reached], middle[~reached]
    return low


def _reached(rods: Rods, tensions: Floats, rows: Ints, load: Ints) -> Bools:
    """Whether a solve with one element reaches a load of each ramp from the straight robot."""
    quick = replace(_some(rods, rows), model=rods.model.replace(elements=1))
    return _solve(quick, tensions[rows, load][:, None]).converged[:, 0]


def _some(rods: Rods, rows: Ints) -> Rods:
    """The rods of some rows, with their gravity and tip force."""
    wide: dict[str, Any] = {}
    for name in ("gravity", "tip_force"):
        value = getattr(rods.load, name)
        if value is not None and np.ndim(value) > 1:
            wide[name] = np.asarray(value)[rows]
    return replace(rods, designs=rods.designs[rows], load=rods.load.replace(**wide))


def _solve(rods: Rods, tensions: Floats) -> Solved:
    found = sweep_designs(
        rods.designs, tensions, load=rods.load, model=rods.model, threads=threads()
    )
    return Solved(
        found.converged,
        found.tip_position,
        found.tendon_lengths,
        found.tip_error,
        gave_up(found.status),
    )
