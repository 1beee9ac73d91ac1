"""Bootstrap intervals of tip errors: how far a mean depends on which loads were measured.

Whole units are resampled, with all their rows: the repeats of one load are hardly independent of
each other, and resampling single rows would make an interval too narrow. All models share the same
resamples, so that differences between them have intervals as well. A model that was fitted to the
same rows is refitted to each resample, near enough by its derivatives, to tell what it is worth at
rows that it never saw.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from bowstring.schemas import study as schema

__all__ = ["LEVEL", "RESAMPLES", "Expected", "Intervals", "Linear", "bootstrap", "refitted"]

Array = NDArray[np.float64]

RESAMPLES: Final = 2000
LEVEL: Final = 0.95
_TAILS: Final = (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL)
_SEED: Final = 2019  # the same data give the same report
_AT_ONCE: Final = 4_000_000  # counts that are held at a time
_FEWEST: Final = 6  # units; resamples of fewer often do not determine a fit
_LOST: Final = 1e-8  # of the largest eigenvalue: a direction that a resample does not identify


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
        Model minus measurement, m; rows with NaN count in no mean, units of such alone nowhere.
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
    known = np.any([np.isfinite(each).all(axis=1) for each in differences], axis=0)
    if known.any():
        unit, differences = unit[known], [each[known] for each in differences]
    _, place = np.unique(unit, return_inverse=True)
    units = int(place.max()) + 1
    columns = []
    for difference in differences:
        error = np.linalg.norm(difference, axis=1)
        rows = np.column_stack([np.ones(len(error)), error, error**2, np.abs(difference)])
        rows[~np.isfinite(error)] = 0.0
        columns.append(rows)
    stacked = np.concatenate(columns, axis=1)
    sums = np.stack([np.bincount(place, column, units) for column in stacked.T], axis=1)
    drawn = np.empty((resamples, sums.shape[1]))
    for part, counts in _draws(units, resamples, units):
        drawn[part] = counts @ sums
    found = []
    for of_model in np.split(drawn, len(differences), axis=1):
        count, error, square, *axes = of_model.T
        some = count > 0
        if not some.any():
            none = np.full(2, np.nan)
            found.append(Intervals(none, none, np.full((3, 2), np.nan), np.full(resamples, np.nan)))
            continue
        means = np.where(some, error / np.where(some, count, 1.0), np.nan)
        of = count[some]
        found.append(
            Intervals(
                mean=np.quantile(means[some], _TAILS),
                rms=np.sqrt(np.quantile(square[some] / of, _TAILS)),
                mean_by_axis=np.stack([np.quantile(axis[some] / of, _TAILS) for axis in axes]),
                means=means,
            )
        )
    return found


def _draws(units: int, resamples: int, size: int) -> Iterator[tuple[slice, NDArray[np.int64]]]:
    """How often resamples draw each unit, part by part; `size` are the numbers held for one."""
    random = np.random.default_rng(_SEED)
    step = max(1, _AT_ONCE // size)
    for i in range(0, resamples, step):
        part = slice(i, min(i + step, resamples))
        yield part, random.multinomial(units, np.full(units, 1.0 / units), part.stop - i)


@dataclass(frozen=True, eq=False)
class Linear:
    """A least-squares fit near its end, of n rows and P scaled parameters."""

    by_parameter: Array
    """Derivative (n, 3, P) of the residuals, m."""
    force: Array
    """(n, 3), derivative of half the loss by the residuals, weights of rows in it, m."""
    slope: Array
    """(n, 3), its derivative."""


@dataclass(frozen=True, eq=False)
class Expected:
    """What a fitted model is worth at rows like those that it was fitted to."""

    mean: float
    """Mean Euclidean error at rows that the fit has not seen, m."""
    interval: Array
    """(2,), at 95 %, m."""

    def to_dict(self) -> schema.ExpectedError:
        """In mm."""
        return {"mean_mm": self.mean * 1e3, "interval_95_mm": (self.interval * 1e3).tolist()}


def refitted(
    residual: Array, fit: Linear, unit: NDArray[np.int64], *, resamples: int = RESAMPLES
) -> Expected | None:
    """Mean error of a fitted model at other rows, with the uncertainty of the fit in its interval.

    Parameters
    ----------
    residual : array (n, 3)
        Model minus measurement at the fitted rows, m.
    fit : Linear
    unit : array of int (n,)
        Rows with the same number are resampled together.
    resamples : int

    Returns
    -------
    Expected or None
        None with fewer than six units.

    Notes
    -----
    A fit to each resample, by one Newton step from the fit to all. How much smaller its error is on
    its own resample than on all rows is the optimism by which the error of the fit to all is raised
    (Efron and Tibshirani, 1993, 17.6); the interval is that of the errors on the resamples, moved
    to the raised one (Noma et al., Statistics in Medicine 40, 2021).
    """
    _, place = np.unique(unit, return_inverse=True)
    units = int(place.max()) + 1
    if units < _FEWEST:
        return None
    jacobian, rows = fit.by_parameter, np.bincount(place, minlength=units)
    parameters = jacobian.shape[2]
    normal = np.zeros((units, parameters, parameters))
    np.add.at(normal, place, np.einsum("kip,ki,kiq->kpq", jacobian, fit.slope, jacobian))
    force = np.zeros((units, parameters))
    np.add.at(force, place, np.einsum("kip,ki->kp", jacobian, fit.force))
    size = np.sqrt(np.einsum("upp->p", normal))
    scale = 1.0 / np.where(size > 0.0, size, 1.0)
    own, whole = np.empty(resamples), np.empty(resamples)
    for part, counts in _draws(units, resamples, jacobian[..., 0].size):
        matrix = np.tensordot(counts, normal, 1) * scale[:, None] * scale
        inverse = np.linalg.pinv(matrix, rcond=_LOST, hermitian=True)
        change = -(inverse @ (counts @ force * scale)[..., None])[..., 0] * scale
        moved = residual + np.einsum("kip,bp->bki", jacobian, change, optimize=True)
        error = np.linalg.norm(moved, axis=2)
        whole[part] = error.mean(axis=1)
        drawn = counts[:, place]
        own[part] = np.sum(drawn * error, axis=1) / (counts @ rows)
    mean = float(np.linalg.norm(residual, axis=1).mean() + np.mean(whole - own))
    tails = np.quantile(own, _TAILS)
    return Expected(mean, np.maximum(tails - own.mean() + mean, 0.0))
