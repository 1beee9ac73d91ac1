"""Prediction of the next tip from the measured tips of the rows before it.

What a calibrated model leaves is not noise: it changes slowly from row to row. A Kalman filter
follows it as a bias of the measured point. Predictions without measured tips are called open loop,
those of this module filtered. docs/theory/calibration.md (One row ahead) has the equations.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.calibration import observations
from bowstring.calibration.fitting import Fit
from bowstring.calibration.observations import Measured, Score, score
from bowstring.calibration.tip_model import Commands
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.validation import instance

_FEWEST = 20  # measured rows for three numbers


@dataclass(frozen=True)
class SlowBias(Result):
    """Slow bias of a model's point, in each coordinate alike; made by `fit_slow_bias`."""

    spread: Annotated[float, Key("bias_spread_mm")]
    """Standard deviation of a coordinate of the bias over a long time, m."""
    duration: Annotated[float, Key("bias_duration")]
    """Time in which the bias forgets its value (by the factor 1/e), in s, or in rows without times.
    """
    noise: Annotated[float, Key("noise_mm")]
    """Standard deviation of a coordinate of the part that differs from row to row, m."""
    timed: bool
    """Whether the duration is in s."""


@short_repr
@dataclass(frozen=True, eq=False)
class Filtered:
    """Predictions of K rows, each from the measured tips before it; made by `filtered`.

    Attributes
    ----------
    point : ndarray (K, 3)
        Predicted points in the measuring frame, m; NaN where the model has no solution.
    standard_deviation : ndarray (K,)
        Standard deviation of a coordinate of measured minus predicted point, m.
    open_loop : ndarray (K, 3)
        Predicted points without measured tips, m.
    score, open_loop_score : Score
        Scores of both over the measured rows.
    """

    point: Floats
    standard_deviation: Floats
    open_loop: Floats
    score: Score
    open_loop_score: Score


def fit_slow_bias(found: Fit, data: Measured) -> SlowBias:
    """Estimate the slow bias of a fit from its residuals, by maximum likelihood.

    Parameters
    ----------
    found : Fit
        Fit of a model to `data`.
    data : Measurements or Data
        The fitted rows, in the order of measurement.

    Returns
    -------
    SlowBias
        Spread, duration and noise.

    Raises
    ------
    InputError
        If fewer than 20 rows are fitted, or times do not increase along a path.
    """
    from scipy.optimize import minimize

    instance("found", found, Fit)
    gaps, starts, timed = _gaps(observations.commands(data, found.robot), None)
    residuals = np.where(found.used[:, None], -found.residuals, np.nan)
    _refuse_few(residuals, "fitted")
    size = max(float(np.sqrt(np.nanmean(residuals**2))), np.finfo(float).tiny)
    usual = float(np.median(gaps[~starts])) if (~starts).any() else 1.0

    def bias(logs: Floats) -> SlowBias:
        spread, duration, noise = np.exp(np.clip(logs, -20.0, 20.0)) * [size, usual, size]
        return SlowBias(float(spread), float(duration), float(noise), timed)

    def cost(logs: Floats) -> float:
        biases, deviation = _follow(bias(logs), residuals, gaps, starts)
        innovation = residuals - biases
        seen = np.isfinite(innovation).all(axis=1)
        square = (innovation[seen] / deviation[seen, None]) ** 2
        # a faint prior keeps numbers without effect finite
        return float(
            0.5 * square.sum() + 3.0 * np.log(deviation[seen] / size).sum()
        ) + 1e-3 * float(logs @ logs)

    starts_at = [np.array([0.0, np.log(n), np.log(0.3)]) for n in (3.0, 30.0)]
    options = {"xatol": 1e-3, "fatol": 1e-3}
    best = min(
        (minimize(cost, at, method="Nelder-Mead", options=options) for at in starts_at),
        key=lambda each: float(each.fun),
    )
    return bias(best.x)


def check_order(data: Measured, robot: Robot) -> None:
    """Refuse rows that are not in the order of measurement, or too few for a slow bias."""
    commands = observations.commands(data, robot)
    _gaps(commands, None)
    _refuse_few(observations.tips(data, len(commands)), "measured")


def _refuse_few(points: Floats, what: str) -> None:
    count = int(np.isfinite(points).all(axis=1).sum())
    if count < _FEWEST:
        raise InputError(
            f"{count} {what} rows are too few for a slow bias; {_FEWEST} are needed at least"
        )


def filtered(found: Fit, data: Measured, bias: SlowBias) -> Filtered:
    """Predict each row from the calibrated model and the measured tips of the rows before.

    Parameters
    ----------
    found : Fit
        Fit of the model.
    data : Measurements or Data
        Rows in the order of measurement, fitted or not. Rows without a measured tip are predicted
        too.
    bias : SlowBias
        Slow bias of the model.

    Returns
    -------
    Filtered
        Predictions with and without the filter, and their scores.

    Raises
    ------
    InputError
        If times are missing or do not increase along a path, or no row has a measured tip.
    """
    instance("found", found, Fit)
    instance("bias", bias, SlowBias)
    gaps, starts, _ = _gaps(observations.commands(data, found.robot), bias.timed)
    open_loop = found.predict(data)
    measured = observations.tips(data, len(open_loop))
    biases, deviation = _follow(bias, measured - open_loop, gaps, starts)
    point = open_loop + biases
    return Filtered(point, deviation, open_loop, score(point, measured), score(open_loop, measured))


def _gaps(commands: Commands, timed: bool | None) -> tuple[Floats, Bools, bool]:
    """Time or rows since the row before (K,), where paths start (K,), and whether it is in s."""
    time, count = commands.time, len(commands)
    if timed and time is None:
        raise InputError("the slow bias was fitted with times, and the rows have none")
    starts = np.zeros(count, dtype=bool)
    gaps = np.ones(count)
    if timed is False:
        time = None
    for rows in commands.paths:
        starts[rows[0]] = True
        if time is not None:
            gaps[rows[1:]] = np.diff(time[rows])
    if not (gaps[~starts] > 0).all():
        row = 1 + int(np.flatnonzero(~starts & ~(gaps > 0))[0])
        raise InputError(
            f"row {row} is not later than the row before: give the rows in the order of "
            "measurement, and a recording to those of another path"
        )
    return gaps, starts, time is not None


def _follow(
    bias: SlowBias, residuals: Floats, gaps: Floats, starts: Bools
) -> tuple[Floats, Floats]:
    """Predicted biases (K, 3), and standard deviations (K,) of the residuals about them.

    By a Kalman filter, theory Eq. 7.6. Residuals are measured minus predicted, NaN where a row is
    not measured.
    """
    whole, noise = bias.spread**2, bias.noise**2
    kept = np.exp(-gaps / bias.duration).tolist()
    seen = np.asarray(np.isfinite(residuals).all(axis=1)).tolist()
    gains, totals, variance = [], [], 0.0
    for first, share, measured in zip(starts.tolist(), kept, seen, strict=True):
        variance = whole if first else whole + share**2 * (variance - whole)
        totals.append(variance + noise)
        gain = variance / totals[-1] if measured and totals[-1] > 0.0 else 0.0
        gains.append(gain)
        variance *= 1.0 - gain
    means = []
    for column in np.nan_to_num(residuals).T.tolist():
        mean, ahead = 0.0, []
        for first, share, gain, residual in zip(starts.tolist(), kept, gains, column, strict=True):
            mean = 0.0 if first else share * mean
            ahead.append(mean)
            mean += gain * (residual - mean)
        means.append(ahead)
    return np.array(means).T, np.sqrt(totals)
