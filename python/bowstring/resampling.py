"""Bootstrap intervals of tip errors: how far a mean depends on which loads were measured.

Whole units are resampled, with all their rows: the repeats of one load are hardly independent of
each other, and resampling single rows would make an interval too narrow. All models share the same
resamples, so that differences between them have intervals as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["LEVEL", "RESAMPLES", "Intervals", "bootstrap"]

Array = NDArray[np.float64]

RESAMPLES: Final = 2000
LEVEL: Final = 0.95
_SEED: Final = 2019  # the same data give the same report
_AT_ONCE: Final = 4_000_000  # counts that are held at a time


@dataclass(frozen=True, eq=False)
class Intervals:
    """Intervals of one set of errors, each (2,) or (3, 2): lower and upper bound."""

    mean: Array
    """Of the mean Euclidean error, m."""
    rms: Array
    mean_by_axis: Array
    """(3, 2), of the mean absolute errors along the axes, m."""
    means: Array
    """(B,), the mean of each resample, m; for differences of models."""


def bootstrap(
    differences: list[Array], unit: NDArray[np.int64], *, resamples: int = RESAMPLES
) -> list[Intervals]:
    """Percentile intervals at 95 % of the errors of several models at the same rows.

    Parameters
    ----------
    differences : list of array (K, 3)
        Model minus measurement, m; rows with NaN count in no mean.
    unit : array of int (K,)
        Rows with the same number are resampled together.
    resamples : int

    Returns
    -------
    list of Intervals

    Notes
    -----
    Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapters 8 and 13. A resample is
    how often it draws each unit, so that all of them are one product of matrices.
    """
    _, place = np.unique(unit, return_inverse=True)
    units = int(place.max()) + 1
    columns = []
    for difference in differences:
        error = np.linalg.norm(difference, axis=1)
        rows = np.column_stack([np.ones(len(error)), error, error**2, np.abs(difference)])
        rows[~np.isfinite(error)] = 0.0
        columns.append(rows)
    width = columns[0].shape[1]
    stacked = np.concatenate(columns, axis=1)
    sums = np.stack([np.bincount(place, column, units) for column in stacked.T], axis=1)
    random = np.random.default_rng(_SEED)
    drawn = np.empty((resamples, sums.shape[1]))
    step = max(1, _AT_ONCE // units)
    for i in range(0, resamples, step):
        part = slice(i, min(i + step, resamples))
        counts = random.multinomial(units, np.full(units, 1.0 / units), part.stop - i)
        drawn[part] = counts @ sums
    found = []
    tails = [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL]
    for m in range(len(differences)):
        count, error, square, *axes = drawn[:, m * width : (m + 1) * width].T
        some = count > 0
        if not some.any():
            none = np.full(2, np.nan)
            found.append(Intervals(none, none, np.full((3, 2), np.nan), np.full(resamples, np.nan)))
            continue
        means = np.where(some, error / np.where(some, count, 1.0), np.nan)
        of = count[some]
        found.append(
            Intervals(
                mean=np.quantile(means[some], tails),
                rms=np.sqrt(np.quantile(square[some] / of, tails)),
                mean_by_axis=np.stack([np.quantile(axis[some] / of, tails) for axis in axes]),
                means=means,
            )
        )
    return found
