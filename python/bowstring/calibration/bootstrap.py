"""Bootstrap intervals of tip errors: uncertainty of a mean from the choice of measured loads.

Whole units are resampled with all their rows, because repeats of a load are hardly independent and
resampling of single rows would make intervals too narrow. All models share the same resamples, so
that differences between them have intervals too. A model fitted to the same rows is refitted to
each resample, approximately by its derivatives, to estimate its error at unseen rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Ints
from bowstring.results import Key, Result

RESAMPLES: Final = 2000
LEVEL: Final = 0.95
_TAILS: Final = (0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL)
_SEED: Final = 2019  # equal data give an equal report
_AT_ONCE: Final = 4_000_000  # counts in memory at a time
_FEWEST: Final = 6  # units; resamples of fewer often do not determine a fit
_LOST: Final = 1e-8  # eigenvalue over the largest, below which a direction is not identifiable


@dataclass(frozen=True, eq=False)
class Intervals(Result):
    """95 % intervals of one set of errors by bootstrap: lower and upper bound."""

    mean: Annotated[Floats, Key("mean_mm")]
    """Interval (2,) of the mean Euclidean error, m; NaN without rows."""
    rms: Annotated[Floats, Key("rms_mm")]
    """Interval (2,) of the RMS Euclidean error, m; NaN without rows."""
    mean_by_axis: Annotated[Floats, Key("mean_by_axis_mm")]
    """Intervals (3, 2) of the mean absolute errors along x, y and z, m; NaN without rows."""
    means: Floats
    """Mean of each resample (B,), m; for differences of models."""


def bootstrap(
    differences: list[Floats], unit: Ints, *, resamples: int = RESAMPLES
) -> list[Intervals]:
    """Compute 95 % percentile intervals of the errors of several models at the same rows.

    Parameters
    ----------
    differences : list of array (K, 3)
        Model minus measurement, m; rows with NaN are ignored, and so are units with only such rows.
    unit : array of int (K,)
        Rows with the same number are resampled together.
    resamples : int

    Returns
    -------
    list of Intervals

    Notes
    -----
    Efron and Tibshirani, An Introduction to the Bootstrap, 1993, chapters 8 and 13. A resample is
    stored as the number of draws of each unit, so that all means are one matrix product.
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


def _draws(units: int, resamples: int, size: int) -> Iterator[tuple[slice, Ints]]:
    """Yield the number of draws of each unit in parts; `size` is the memory per resample."""
    random = np.random.default_rng(_SEED)
    step = max(1, _AT_ONCE // size)
    for i in range(0, resamples, step):
        part = slice(i, min(i + step, resamples))
        yield part, random.multinomial(units, np.full(units, 1.0 / units), part.stop - i)


@dataclass(frozen=True, eq=False)
class Linear:
    """Linearised least-squares fit at its minimum, of n points, P scaled parameters, Q priors."""

    by_parameter: Floats
    """Derivative (n, 3, P) of the residuals, m."""
    force: Floats
    """Derivative of half the loss by the residuals (n, 3), including weights of rows, m."""
    slope: Floats
    """Second derivative of half the loss by the residuals (n, 3)."""
    of_priors: Floats
    """Derivative (Q, P) of the residuals of the priors, m."""
    force_of_priors: Floats
    """Residuals (Q,) of the priors, m."""
    row: Ints | None = None
    """Row (n,) of each point among the fitted rows, from 0; None: each row has one point."""
    tip: Bools | None = None
    """Points (n,) that are tips; None: all are."""
    block: Ints | None = None
    """Block (N,) of neighbouring rows of each fitted row, from 0; None: rows are independent."""

    @property
    def by_tip(self) -> Floats:
        """Derivative (T, 3, P) of the residuals of the tips, m."""
        return self.by_parameter if self.tip is None else self.by_parameter[self.tip]

    def changes(self, place: Ints, counts: NDArray[Any]) -> Floats:
        """Changes (B, P) of the scaled parameters if units of rows have other weights.

        `place` (N,) is the unit of each row, `counts` (B, U) how often each unit counts. By one
        Newton step.
        """
        jacobian, units = self.by_parameter, counts.shape[1]
        parameters = jacobian.shape[2]
        normal = np.zeros((units, parameters, parameters))
        of_point = place if self.row is None else place[self.row]
        np.add.at(normal, of_point, np.einsum("kip,ki,kiq->kpq", jacobian, self.slope, jacobian))
        force = np.zeros((units, parameters))
        np.add.at(force, of_point, np.einsum("kip,ki->kp", jacobian, self.force))
        of_priors = self.of_priors.T @ self.of_priors
        held = self.of_priors.T @ self.force_of_priors
        size = np.sqrt(np.einsum("upp->p", normal) + np.diag(of_priors))
        scale = 1.0 / np.where(size > 0.0, size, 1.0)
        matrix = (np.tensordot(counts, normal, 1) + of_priors) * scale[:, None] * scale
        inverse = np.linalg.pinv(matrix, rcond=_LOST, hermitian=True)
        return np.asarray(-(inverse @ ((counts @ force + held) * scale)[..., None])[..., 0] * scale)


@dataclass(frozen=True, eq=False)
class Expected(Result):
    """Expected error of a fitted model at unseen rows of the same kind."""

    mean: Annotated[float, Key("mean_mm")]
    """Mean Euclidean error at unseen rows, m."""
    interval: Annotated[Floats, Key("interval_95_mm")]
    """95 % interval (2,), m."""


def refitted(
    residual: Floats, fit: Linear, unit: Ints, *, resamples: int = RESAMPLES
) -> Expected | None:
    """Estimate the mean error of a fitted model at unseen rows, with an interval.

    Parameters
    ----------
    residual : array (N, 3)
        Tip of the model minus measurement at the fitted rows, m.
    fit : Linear
        Fit, with a tip in each row.
    unit : array of int (N,)
        Rows with the same number are resampled together.
    resamples : int

    Returns
    -------
    Expected or None
        None with fewer than six units.

    Notes
    -----
    Each resample is fitted by one Newton step from the fit to all rows. The mean of its error on
    all rows minus that on its own resample is the optimism, which is added to the error of the fit
    (Efron and Tibshirani, 1993, 17.6). The interval is that of the errors on the resamples, shifted
    to the corrected error (Noma et al., Statistics in Medicine 40, 2021).
    """
    _, place = np.unique(unit, return_inverse=True)
    units = int(place.max()) + 1
    if units < _FEWEST:
        return None
    jacobian, rows = fit.by_tip, np.bincount(place, minlength=units)
    own, whole = np.empty(resamples), np.empty(resamples)
    for part, counts in _draws(units, resamples, jacobian[..., 0].size):
        change = fit.changes(place, counts)
        moved = residual + np.einsum("kip,bp->bki", jacobian, change, optimize=True)
        error = np.linalg.norm(moved, axis=2)
        whole[part] = error.mean(axis=1)
        drawn = counts[:, place]
        own[part] = np.sum(drawn * error, axis=1) / (counts @ rows)
    mean = float(np.linalg.norm(residual, axis=1).mean() + np.mean(whole - own))
    tails = np.quantile(own, _TAILS)
    return Expected(mean, np.maximum(tails - own.mean() + mean, 0.0))


def left_out(fit: Linear, residual: Floats) -> Floats:
    """Residuals (T, 3) of the fitted tips by a fit to the other blocks, by one Newton step.

    `residual` are those of the fit to all rows, m. Exact for models linear in the parameters and a
    linear loss (Efron and Tibshirani, 1993, 17.2, with blocks for rows); a parameter that one block
    alone determines keeps its value.
    """
    assert fit.block is not None
    count = int(fit.block.max()) + 1
    change = fit.changes(fit.block, 1.0 - np.eye(count))
    row = np.arange(len(fit.block)) if fit.row is None else fit.row
    block = fit.block[row if fit.tip is None else row[fit.tip]]
    return np.asarray(residual + np.einsum("kip,kp->ki", fit.by_tip, change[block]))
