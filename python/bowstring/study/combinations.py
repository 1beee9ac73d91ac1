"""Tendons that a study judges a robot by: the worst of each alone and of one a segment together."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.errors import BowstringError
from bowstring.formatting import significant
from bowstring.robot.model import Robot
from bowstring.statics.model import RodModel
from bowstring.study.comparison import MEANINGS, Model, Theory
from bowstring.validity.errors import LABELS
from bowstring.validity.loading import actuated, largest_load, whole_share

_MOST: Final = 128  # combinations that are tried, fewer of long robots
_DISKS: Final = 20_000  # disks of all combinations together
_POINTS: Final = 17  # loads of each
_ALIKE: Final = 1e-6  # relative difference of errors that is rounding

Shares = tuple[float, ...]


def combinations(robot: Robot) -> list[Shares]:
    """Combinations of actuated tendons: none or one of each segment, at the same tension.

    Parameters
    ----------
    robot : Robot
        Of more than 128, evenly spaced ones in this order are taken, each tendon alone first; of
        robots with more than 160 disks fewer.

    Returns
    -------
    list of tuple of float (T,)
        Share of the tension in each tendon. Combinations of fewer tendons come first, those of
        outer segments before those of inner ones.
    """
    of = robot.tendons.segment
    groups = [np.flatnonzero(of == k).tolist() for k in range(len(robot.segments) - 1, -1, -1)]
    groups = [group for group in groups if group]
    alone: list[tuple[int, ...]] = [(t,) for group in groups for t in group]
    found = alone
    for size in range(2, len(groups) + 1):
        several = [
            chosen
            for some in itertools.combinations(groups, size)
            for chosen in itertools.product(*some)
        ]
        found = [*found, *several]
        if len(found) > _MOST:
            break
    most = min(_MOST, max(8, _DISKS // len(robot.disks.station_m)))
    kept, more = _thinned(alone, most), found[len(alone) :]
    kept += _thinned(more, most - len(kept))
    share = whole_share(robot)
    each = range(len(of))
    return [tuple(share[t] if t in chosen else 0.0 for t in each) for chosen in kept]


def _thinned(found: list[tuple[int, ...]], most: int) -> list[tuple[int, ...]]:
    """At most so many, evenly spaced."""
    if len(found) <= most:
        return found
    return [found[i * len(found) // most] for i in range(most)]


@dataclass(frozen=True)
class _Severity:
    """How far the errors of a combination exceed the tolerance, by meaning."""

    shares: Shares
    top: float
    """End of the range of tension, N."""
    beyond: dict[str, float]
    """Share of the range beyond the first crossing of the tolerance; 0 without one."""
    largest: float
    """Largest error, m."""


def worst_combination(
    robot: Robot,
    tried: Sequence[Shares],
    theory: Theory,
    tolerance: float,
    max_tension: float | None,
) -> tuple[Shares, tuple[str, ...]]:
    """Find the combination in which constant curvature leaves the tolerance earliest.

    Parameters
    ----------
    robot : Robot
    tried : sequence of tuple of float (T,)
        Combinations; of those that are alike the first one counts.
    theory : {"cosserat", "kirchhoff"}
    tolerance : float
        Tolerated tip error as a share of the robot's length.
    max_tension : float or None
        End of the sweeps, N; by default that of a study of each combination.

    Returns
    -------
    shares : tuple of float (T,)
        The combination that leaves the tolerance at the smallest share of its range of tension,
        from lengths or from force; if none does, that of the largest error.
    earlier : tuple of str
        Sentences on other combinations that leave the tolerance clearly earlier from one of both.
    """
    found = []
    for shares in tried:
        try:
            found.append(_severity(robot, shares, theory, tolerance * robot.length, max_tension))
        except BowstringError:  # no range of tension
            continue
    if not found:
        return tried[0], ()
    worst = found[0]
    for each in found:
        beyond, most = (max(s.beyond.values()) for s in (each, worst))
        larger = each.largest > worst.largest * (1.0 + _ALIKE)
        if beyond > most * (1.0 + _ALIKE) or (larger and beyond >= most * (1.0 - _ALIKE)):
            worst = each
    earlier = []
    for name in MEANINGS:
        other = max(found, key=lambda each: each.beyond[name])
        if other.beyond[name] > worst.beyond[name] + 1.0 / (_POINTS - 1):
            limit = significant((1.0 - other.beyond[name]) * other.top, 2)
            ends = f"at about {limit} N of its range to {other.top:g} N"
            earlier.append(
                f"{LABELS[name]}, the error leaves the tolerance earlier with "
                f"{actuated(other.shares)}, {ends}; --tendon {_flag(other.shares)} judges it"
            )
    return worst.shares, tuple(earlier)


def _flag(shares: Shares) -> str:
    """Combination as the flag has it."""
    each = ((i, share) for i, share in enumerate(shares, 1) if share)
    return ",".join(f"{i}" if share == 1.0 else f"{i}:{share:g}" for i, share in each)


def _severity(
    robot: Robot, shares: Shares, theory: Theory, limit: float, top: float | None
) -> _Severity:
    if top is None:
        top = largest_load(robot, np.array(shares), RodModel(theory))
    model = Model(robot, int(np.argmax(np.abs(shares))), theory, shares)
    tension = np.linspace(0.0, top, _POINTS)
    case = model.case(model.main, tension)
    beyond, largest = dict.fromkeys(MEANINGS, 0.0), 0.0
    for name in MEANINGS:
        error = case.error(name)
        known = np.flatnonzero(np.isfinite(error))
        if not known.size:
            continue
        largest = max(largest, float(error[known].max()))
        above = known[error[known] > limit]
        if above.size:
            i = int(above[0])
            low = error[i - 1] if i and np.isfinite(error[i - 1]) else limit
            part = (limit - low) / (error[i] - low) if error[i] > low else 0.0
            beyond[name] = 1.0 - max(i - 1 + part, 0.0) / (_POINTS - 1)
    return _Severity(shares, top, beyond, largest)
