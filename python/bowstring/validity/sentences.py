"""What a map says, in sentences."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bowstring.formatting import in_newtons, listed
from bowstring.validity.causes import coarse_step
from bowstring.validity.effects import EFFECTS
from bowstring.validity.errors import LABELS
from bowstring.validity.maps import STATES, ValidityMap

__all__ = ["described", "in_causes", "limits_in_words"]

Floats = NDArray[np.float64]


def described(found: ValidityMap) -> list[str]:
    """What a map says, in sentences."""
    out = list(found.notes)
    percent = f"{100 * found.tolerance:g} % of length"
    for name, value in found.value.items():
        label = LABELS[name]
        known = np.isfinite(value)
        if not known.any():
            out.append(f"Constant curvature {label} has no arc anywhere on the map.")
            continue
        first = f"Constant curvature {label} holds to {percent}"
        if found.metric == "valid_to":
            out.append(f"{first} up to {limits_in_words(value, found.max_tension)}.")
            continue
        inside = (value <= found.tolerance) & known
        lines = found.contour[name]
        solved = bool((found.state != 2).all())
        where = "everywhere" if solved else "at all loads with an equilibrium"
        if not inside[known].all() or lines:
            where = "nowhere" if not inside.any() and not lines else "on a part of the map"
        words = f"{first} {where}"
        if len(found.axes) == 1 and lines:
            axis = found.axes[0]
            unit = f" {axis.units[1]}" if axis.units[1] else ""
            marks = [f"{mark:.4g}{unit}" for mark in sorted(x[0, 0] / axis.factor for x in lines)]
            words = f"{first} at some values: it crosses at {listed(marks)}"
        step = coarse_step(value.shape, value.ndim)
        out.append(words + in_causes(value, found.cause[name], step, found.tolerance) + ".")
    counts = {STATES[i]: int((found.state == i).sum()) for i in (1, 2, 3)}
    for state, count in counts.items():
        if count:
            out.append(f"{count} of {found.state.size} points: {state}.")
    return out


def limits_in_words(limit: Floats, end: float) -> str:
    """Range of the validity limits of a map (N), some of them known; `end` is that of the sweep."""
    known = limit[np.isfinite(limit)]
    low, high = float(known.min()), float(known.max())
    return f"{in_newtons(low, high)} on this map; the sweep ends at {end:.4g} N"


def in_causes(value: Floats, cause: NDArray[np.str_], step: int, tolerance: float) -> str:
    """Main causes of a map where its error is above the tolerance, as the end of a sentence."""
    coarse = value[(slice(None, None, step),) * value.ndim]
    effects = cause[coarse > tolerance]
    counts = {effect: int((effects == effect).sum()) for effect in EFFECTS}
    acting = sorted((e for e in EFFECTS if counts[e]), key=lambda e: -counts[e])
    if not acting:
        return ""
    many = ", each in its part of the map" if len(acting) > 1 else ""
    return f"; main cause of the error: {listed([EFFECTS[e] for e in acting])}{many}"
