"""Prediction of rows that were not fitted, with its uncertainty.

All values are in SI; K is the number of rows, P that of parameters.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.calibration.bootstrap import left_out
from bowstring.calibration.fitting import Fit
from bowstring.calibration.observations import Measured
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.significance import NORMAL, student
from bowstring.validation import floats_or_refuse


@short_repr
@dataclass(frozen=True, eq=False)
class Predicted:
    """Predicted tips and their uncertainty; made by `predict_with_interval`.

    Attributes
    ----------
    point : ndarray (K, 3)
        Predicted tip in the measuring frame, m; NaN where the model has no solution.
    by_parameters : ndarray (K, 3)
        Standard deviation of each coordinate by that of the parameters, m.
    scatter : ndarray (3,)
        Standard deviation of each coordinate of a measured tip about the model, m.
    quantile : float
        Standard deviations on either side of a 95 % interval: 1.96, or Student's with the number
        of blocks less one where the scatter is that of blocks.
    """

    point: Floats
    by_parameters: Floats
    scatter: Floats
    quantile: float = NORMAL

    @property
    def deviation(self) -> Floats:
        """Standard deviation (K, 3) of a measured coordinate about the prediction, m."""
        return np.asarray(np.hypot(self.by_parameters, self.scatter))

    @property
    def interval(self) -> tuple[Floats, Floats]:
        """Ends (K, 3) of the 95 % interval of each coordinate of a measured tip, m."""
        half = self.quantile * self.deviation
        return self.point - half, self.point + half

    @property
    def half_width(self) -> float:
        """Median half-width of the 95 % intervals, m."""
        return float(np.nanmedian(self.quantile * self.deviation))

    def coverage(self, measured: ArrayLike) -> float:
        """Share of measured coordinates inside their 95 % intervals.

        Parameters
        ----------
        measured : array_like (K, 3)
            Measured tips in m, NaN where not measured.

        Returns
        -------
        float
            Share of the coordinates that are measured and predicted; NaN without any.
        """
        error = np.abs(_table(measured, "measured", len(self.point)) - self.point)
        known = np.isfinite(error)
        inside = error[known] <= self.quantile * self.deviation[known]
        return float(inside.mean()) if known.any() else math.nan


def predict_with_interval(
    found: Fit, data: Measured, *, errors: ArrayLike | None = None
) -> Predicted:
    """Predict tips by a calibrated model, with the uncertainty of parameters and measurements.

    The variance of a coordinate is that by the parameters, to first order, and that of measured
    tips about the model (theory Eq. 7.10). The latter has the misfit of the model in it, as far as
    the rows show it from which it comes: rows of another kind than these may be further off.
    Where residuals of neighbouring rows depend on each other, the model does not fit, and further
    rows have another misfit than these: then it is that of five blocks of the fitted rows, each
    by a fit to the others.

    Parameters
    ----------
    found : Fit
        Calibrated model.
    data : measurements
        Rows to predict, as for `Fit.predict`.
    errors : array_like (K, 3), optional
        Predicted minus measured tips in m, NaN where unknown, from which the scatter is taken. By
        default those of the fitted rows, less the degrees of freedom of the fit, or by blocks.
        The interval then reaches 1.96 standard deviations: these errors count as independent.

    Returns
    -------
    Predicted
        Tips with their standard deviations and 95 % intervals.

    Raises
    ------
    InputError
        If a parameter is not identifiable, or there are fewer than two errors.

    Examples
    --------
    >>> import numpy as np
    >>> import bowstring as bs
    >>> from bowstring.calibration import Data, fit, predict_with_interval
    >>> robot = bs.load_robot("amouri2019")
    >>> tensions = np.random.default_rng(1).uniform(0, 40, (60, 3))
    >>> tips = bs.solve_batch(robot, tensions).tip_position  # synthetic
    >>> tips = tips + np.random.default_rng(2).normal(0, 1e-4, tips.shape)
    >>> rows = [Data(points=tips[k], tensions=tensions[k]) for k in (slice(40), slice(40, 60))]
    >>> predicted = predict_with_interval(fit(robot, rows[0], ["segments.0.backbone.E"]), rows[1])
    >>> bool(predicted.coverage(tips[40:]) > 0.85)
    True
    """
    jacobian = found.jacobian(data)
    by_parameters = np.sqrt(np.einsum("kap,pq,kaq->ka", jacobian, _covariance(found), jacobian))
    blocks = found.linear.block if errors is None else None
    quantile = NORMAL
    if blocks is not None and blocks.max() > 0:
        errors = left_out(found.linear, found.residuals[found.used_tips])
        quantile = float(student(blocks.max()))
    return Predicted(found.predict(data), by_parameters, _scatter(found, errors), quantile)


def _covariance(found: Fit) -> Floats:
    """Covariance (P, P) of the parameters in SI."""
    error = found.standard_errors
    lost = [e.name for e, size in zip(found.estimates, error, strict=True) if not np.isfinite(size)]
    if lost:
        raise InputError(
            f"{lost[0]} is not identifiable, so that no prediction has an interval; leave it out "
            "of the fit, or give it a prior"
        )
    return np.asarray(found.correlation * np.outer(error, error))


def _scatter(found: Fit, errors: ArrayLike | None) -> Floats:
    if errors is None:
        table, free = found.residuals[found.used_tips], len(found.estimates) / 3
    else:
        table, free = _table(errors, "errors"), 0.0
        table = table[np.isfinite(table).all(axis=1)]
    if len(table) < 2 or len(table) - free < 1:
        raise InputError(
            f"{len(table)} rows say no scatter beside {len(found.estimates)} parameters; measure "
            "more rows"
        )
    return np.asarray(np.sqrt((table**2).sum(axis=0) / (len(table) - free)))


def _table(given: ArrayLike, name: str, rows: int | None = None) -> Floats:
    """Numbers (K, 3) in m."""
    table = floats_or_refuse(given, f"{name} must be numbers of shape (K, 3) in m")
    if table.ndim != 2 or table.shape[1] != 3 or rows not in (None, len(table)):
        count = "K" if rows is None else str(rows)
        raise InputError(f"{name} has shape {table.shape}, it must have ({count}, 3), in m")
    return table
