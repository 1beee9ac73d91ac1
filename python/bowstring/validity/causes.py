"""Main cause of the error of constant curvature at points of a map."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Floats
from bowstring.validity.effects import DOMINANT
from bowstring.validity.map_settings import MapSettings

_ROUNDING: Final = 1e-9  # metric below numerical resolution
_MOST_CAUSES: Final = 1681  # points at which the causes are computed: 41 x 41


def causes_of(
    settings: MapSettings, points: Floats, total: Mapping[str, Floats]
) -> dict[str, NDArray[np.str_]]:
    """Main cause at points (P, A), by model: the effect with more than half of the metric.

    Parameters
    ----------
    settings : MapSettings
    points : ndarray (P, A)
        Values of the axes in SI.
    total : mapping from str to ndarray (P,)
        Metric there by model.

    Returns
    -------
    dict from str to ndarray (P,)
        Keys of `bowstring.validity.effects.EFFECTS`; empty text where no effect has more than half.
    """
    cause = {name: np.full(len(points), "", dtype="U16") for name in total}
    # a point without any value, such as one without equilibrium, has no cause
    some = np.flatnonzero(np.any([np.isfinite(value) for value in total.values()], axis=0))
    if not some.size:
        return cause
    rest: dict[str, dict[str, Floats]] = {name: {} for name in total}
    for effect, errors in settings.space.errors_without(points[some], settings.models).items():
        for name, value in settings.measure(errors).items():
            rest[name][effect] = value
    for name, value in total.items():
        cause[name][some] = main_cause(value[some], rest[name])
    return cause


def main_cause(total: Floats, rest: Mapping[str, Floats]) -> NDArray[np.str_]:
    """Main cause of an error: the effect with more than half of it.

    Parameters
    ----------
    total : ndarray (P,)
        Error, as a share of the length or in N.
    rest : mapping from str to ndarray (P,)
        Error without each effect.

    Returns
    -------
    ndarray (P,)
        Keys of `bowstring.validity.effects.EFFECTS`; empty text where no effect has more than half.
    """
    best, cause = np.zeros(len(total)), np.full(len(total), "", dtype="U16")
    for effect, value in rest.items():
        with np.errstate(divide="ignore", invalid="ignore"):
            share = (total - value) / total
        more = (total > _ROUNDING) & (share > DOMINANT) & (share > best)
        best = np.where(more, share, best)
        cause = np.where(more, effect, cause)
    return cause


def coarser(shape: tuple[int, ...], axes: int) -> NDArray[np.intp]:
    """Indices of the points at which causes and second equilibria are computed."""
    index = np.arange(int(np.prod(shape))).reshape(shape)
    step = coarse_step(shape, axes)
    return index[(slice(None, None, step),) * axes]


def coarse_step(shape: tuple[int, ...], axes: int) -> int:
    """Step along each axis between the points of `coarser`."""
    return max(1, int(np.ceil((np.prod(shape) / _MOST_CAUSES) ** (1.0 / axes))))
