"""Faults of a channel of readings: noise about zero, its likely zero, spikes and saturation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bowstring.formatting import listed, significant

__all__ = ["advice", "likely_zero", "noise_about_zero", "saturation", "spikes"]

Floats = NDArray[np.float64]

_FEW: Final = 4  # readings below zero that do not tell their distribution
_SMALL: Final = 0.02  # share of the range below which readings below zero are noise by their size
_LARGE: Final = 0.25  # share of the range above which they are none
_WIDE: Final = 4.0  # standard deviations of a normal distribution that a large sample reaches
_MEDIAN: Final = 0.6745  # median over standard deviation of a half-normal distribution
_GATHERED: Final = 0.85  # mean^2 over mean square; 0.64 if half-normal, 1 for equal readings
_MORE: Final = 3.0  # standard deviations
_LOW: Final = 0.1  # share of the range in which the readings without load lie
_GATHER: Final = 0.2  # share of the rows there if they gather; 0.1 if readings are uniform
_OFTEN: Final = 0.02  # share of rows above which readings are no spikes
_FAR: Final = 3.0  # distance of a spike over the range of the others
_RUN: Final = 5  # rows
_DISTINCT: Final = 0.5  # share of different readings of a sensor; commands repeat


def noise_about_zero(readings: Floats) -> float:
    """Largest reading below zero, without sign, if these are noise about zero; else 0.

    Noise is as often above zero as below, and gathers at zero; readings with another zero gather
    away from it.
    """
    below = -readings[readings < 0.0]
    most = float(readings.max(initial=0.0))
    if not below.size or most <= 0.0:
        return 0.0
    if len(below) >= _FEW:  # without single readings far below
        below = below[below <= _WIDE / _MEDIAN * np.median(below)]
    width = float(below.max())
    if width <= _SMALL * most and len(below) < _FEW:
        return width
    above = int(((readings >= 0.0) & (readings <= width)).sum())
    is_even = len(below) - above <= _MORE * np.sqrt(len(below) + above)
    gathered = float(below.mean() ** 2 / (below**2).mean())
    is_small = width <= _SMALL * most
    is_noise = len(below) >= _FEW and width <= _LARGE * most and gathered < _GATHERED
    return width if is_even and (is_small or is_noise) else 0.0


def likely_zero(readings: Floats) -> float:
    """Reading without load: the middle of the lowest ones, NaN if they do not gather there."""
    low, high = np.quantile(readings, [_OFTEN / 2, 1.0 - _OFTEN / 2])
    near = readings[(readings >= low) & (readings <= low + _LOW * (high - low))]
    return float(np.median(near)) if len(near) > _GATHER * len(readings) else np.nan


def spikes(readings: Floats) -> NDArray[np.bool_]:
    """Few readings (K,) that lie several times the range of the others away from them."""
    few = max(1, int(_OFTEN * len(readings)))
    order = np.argsort(np.abs(readings - np.median(readings)), kind="stable")
    rest = readings[order[: len(readings) - few]]
    found = np.zeros(len(readings), bool)
    if len(np.unique(rest[:1000])) > _FEW:
        low, high = float(rest.min()), float(rest.max())
        apart = np.maximum(low - readings, readings - high)
        found = apart > _FAR * (high - low)
    return found


def saturation(readings: Floats) -> tuple[int, int] | None:
    """First row and number of rows of a run at the largest or least reading of a sensor."""
    for end in (readings.max(initial=0.0), readings.min(initial=0.0)):
        held = np.r_[False, (readings == end) & (end != 0.0), False]
        starts, stops = (np.flatnonzero(np.diff(held.astype(int)) == step) for step in (1, -1))
        if not len(starts):
            continue
        longest = int(np.argmax(stops - starts))
        count = int(stops[longest] - starts[longest])
        others = readings[readings != end]
        distinct = len(np.unique(others)) > _DISTINCT * len(others)
        if count >= _RUN and len(others) >= _RUN and distinct:
            return int(starts[longest]), count
    return None


def advice(zeros: Sequence[tuple[str, float]]) -> str:
    """Sentence on the likely zeros of columns, given in their units."""
    known = [f"{significant(zero)} of {name}" for name, zero in zeros if np.isfinite(zero)]
    numbers = " ".join(significant(zero) for _, zero in zeros) if len(known) == len(zeros) else ""
    likely = f"The likely zero is {listed(known)}: give" if known else "Give"
    return (
        f"{likely} the reading of each tendon without load as zero in the mapping, or in a comment "
        f"'# zero: {numbers or 'first'}' above the header (first: the first row is without load)."
    )
