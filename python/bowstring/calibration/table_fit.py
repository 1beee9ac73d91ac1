"""Calibration from a table of measurements: fit, validation, and diagnostics.

`bowstring.fit` does the fit; this module adds provenance, checks of the data and validation.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import Field

from bowstring.aliases import Bools, Floats, Ints, Progress
from bowstring.calibration import observations
from bowstring.calibration.cross_validation import CrossValidation, cross_validate, hold_out
from bowstring.calibration.filtering import (
    Filtered,
    SlowBias,
    check_order,
    filtered,
    fit_slow_bias,
)
from bowstring.calibration.fitting import Fit, fit
from bowstring.calibration.observations import Score, score
from bowstring.calibration.parameters import zero_is_fitted
from bowstring.calibration.pieces import Loss
from bowstring.calibration.prediction import Predicted, predict_with_interval
from bowstring.calibration.priors import Prior, names_of
from bowstring.data.columns import Source
from bowstring.data.measurements import Measurements
from bowstring.data.tendon_check import Found, TendonCheck, check_tendons, likely_zeros
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.files.json_files import Content, read_json, structured
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics.model import RodModel
from bowstring.validation import check_is_read

#: Correlation of estimates above which they are hardly separable.
_STRONG: Final = 0.9
#: Standard deviations of a coordinate that noise exceeds in one table of a million.
_FAR: Final = 8.0
_FEW_ROWS: Final = 0.05  # largest share of outliers
_NOTHING: Final = 1e-8  # m; smaller residuals mean data without noise
_UNLOADED: Final = 10.0  # standard errors of a zero
#: File beside the calibrated robot file with parameters outside the robot file.
BESIDE: Final = "calibration.json"
_MOST_BYTES: Final = 1_000_000
_MOST_VALUES: Final = 1_000


@dataclass(frozen=True)
class Holdout(Result):
    """Validation with rows that were kept from the fit."""

    score: Annotated[Score, Key(flat=True)]
    """Score of these rows."""
    rows_without_solution: Annotated[int, Key()]
    """Rows without a solution of the calibrated model; no score includes them."""
    kind: Annotated[Literal["holdout"], Key()] = "holdout"
    """Kind of validation."""


@dataclass(frozen=True)
class IntervalCheck(Result):
    """95 % intervals of the coordinates, from the uncertainty of parameters and the scatter."""

    coverage_95: Annotated[float, Key()]
    """Share of the measured coordinates inside; NaN without any."""
    half_width: Annotated[float, Key("half_width_mm")]
    """Median half-width, m; NaN without a prediction."""


@dataclass(frozen=True)
class OneRowAhead(Result):
    """Errors of predictions that know the measured tips of the rows before, and the slow bias."""

    score: Annotated[Score, Key(flat=True)]
    """Score of the rows."""
    bias: Annotated[SlowBias, Key(flat=True)]
    """Slow bias."""


@dataclass(frozen=True)
class OtherTable(Result):
    """Validation with another table, by the fit without registration to it."""

    score: Annotated[Score, Key(flat=True)]
    """Score of its rows."""
    rows_without_solution: Annotated[int, Key()]
    """Rows without a solution of the calibrated model; no score includes them."""
    name: Annotated[str, Key()]
    """Name of the table."""
    source: Annotated[Source, Key()]
    """Origin of its numbers."""
    rows_left_out: Annotated[int, Key()]
    """Rows left out; ``bench check`` has the reasons."""
    sha256: Annotated[str | None, Key()]
    """SHA-256 of the table."""
    intervals: Annotated[IntervalCheck | None, Key()]
    """Intervals of the predictions; None where a parameter is not identifiable."""
    filtered: Annotated[OneRowAhead | None, Key()]
    """The same rows, each predicted from those before; None if not requested."""
    kind: Annotated[Literal["file"], Key()] = "file"
    """Kind of validation."""


@dataclass(frozen=True)
class FittedTable(Result):
    """The fitted table."""

    name: Annotated[str, Key()]
    """Name of the table."""
    source: Annotated[Source, Key()]
    """Origin of its numbers."""
    rows: Annotated[int, Key()]
    """Number of rows, without those left out."""
    rows_left_out: Annotated[int, Key()]
    """Rows left out; ``bench check`` has the reasons."""
    rows_without_tip: Annotated[int, Key()]
    """Rows without a measured tip."""
    sigma: Annotated[float | None, Key("sigma_mm")]
    """Median stated standard uncertainty of a coordinate, m; None if not stated."""
    sha256: Annotated[str | None, Key()]
    """SHA-256 of the table."""


@dataclass(frozen=True)
class TendonAlarm(Result):
    """Comparison of the order of the tendons with the motion of the tip."""

    found: Annotated[Found, Key()]
    """As in ``bench check``."""
    alarm: Annotated[bool, Key()]
    """Whether something is probably wrong."""
    sentence: Annotated[str, Key()]
    """Result as a sentence."""


@dataclass(frozen=True)
class CorrelatedPair(Result):
    """Two correlated parameters."""

    names: Annotated[tuple[str, str], Key()]
    """The two names."""
    correlation: Annotated[float, Key()]
    """Correlation of their estimates."""

    @property
    def pair(self) -> str:
        """The two names in words."""
        return " and ".join(self.names)


@dataclass(frozen=True)
class OutlierRow(Result):
    """A row far beyond the scatter of the others."""

    line: Annotated[int, Key()]
    """Line of the table, from 1."""
    distance: Annotated[float, Key("distance_mm")]
    """Tip error, m."""


@short_repr
@dataclass(frozen=True, eq=False)
class Calibration(Result):
    """Fit to K rows of measurements, with validation and diagnostics; made by `calibrate`.

    Validation, filter and outliers are of the tip, whichever points are fitted.
    """

    data: Measurements
    """The table."""
    fit: Annotated[Fit, Key(flat=True)]
    """The fit to the rows that are not held out."""
    loss: Annotated[Loss, Key()]
    """Loss of the fit."""
    tendons: TendonCheck
    """Check of the tendon order."""
    held_out: Bools
    """Held-out rows (K,); all False without hold-out."""
    held_out_score: Score | None
    """Score of the held-out rows, predicted by the fit without them."""
    folds: CrossValidation | None
    """Cross-validation, if folds were requested."""
    start: Mapping[str, float]
    """Given initial and fixed values in SI by name."""
    parameters: Sequence[str | Prior]
    """Fitted parameters, with their priors."""
    other: Measurements | None = None
    """Another table, for validation only."""
    other_score: Score | None = None
    """Score of its rows, predicted by the fit without registration to them (open loop)."""
    other_predicted: Predicted | None = None
    """Its predicted tips with their intervals; None where a parameter is not identifiable."""
    ahead: Filtered | None = None
    """Its rows, each predicted from the measured tips before it, if requested."""
    bias: SlowBias | None = None
    """Slow bias of these predictions."""

    @property
    def predicted(self) -> Floats:
        """Predicted points (K, 3) by the calibrated model, m, measuring frame."""
        return np.asarray(self.fit.residuals + self.data.tip)

    @property
    def without_solution(self) -> int:
        """Number of validation rows without a solution of the model; no score includes them."""
        if self.folds is not None:
            return self.folds.without_solution
        if self.other is not None and self.other_score is not None:
            return int(self.other.seen.sum()) - self.other_score.count
        return int(np.isnan(self.fit.residuals[self.held_out]).any(axis=1).sum())

    @property
    def correlated(self) -> Annotated[list[CorrelatedPair], Key()]:
        """Pairs of parameters whose estimates correlate by 0.9 or more, strongest first."""
        found = combinations(enumerate(self.fit.names), 2)
        table = self.fit.correlation
        pairs = (CorrelatedPair((a, b), float(table[i, j])) for (i, a), (j, b) in found)
        strong = (pair for pair in pairs if abs(pair.correlation) >= _STRONG)
        return sorted(strong, key=lambda pair: -abs(pair.correlation))

    @property
    def outliers(self) -> Annotated[list[OutlierRow], Key()]:
        """Few fitted rows far beyond the scatter of the others, farthest first.

        Empty if there are many, which indicates an error of the model, not of rows.
        """
        distance = np.linalg.norm(self.fit.residuals, axis=1)
        rows = np.flatnonzero(self.fit.used & (distance > _FAR * self.fit.noise))
        if self.fit.noise < _NOTHING or len(rows) > max(1, _FEW_ROWS * self.fit.used.sum()):
            return []
        rows = rows[np.argsort(-distance[rows])]
        return [OutlierRow(int(self.data.line[i]), float(distance[i])) for i in rows]

    @property
    def broken_path(self) -> str:
        """Warning if rows were left out of a path whose history matters; else empty."""
        remember = any(name.startswith("backlash") for name in self.beside)
        if not self.data.left_out or not (self.fit.robot.has_memory or remember):
            return ""
        rows = "a row was" if self.data.left_out == 1 else f"{self.data.left_out} rows were"
        robot = self.fit.robot
        what = "relaxation or creep" if robot.is_viscoelastic else "hysteresis"
        what = "friction" if robot.has_friction else what
        if remember:
            what = "backlash"
        return (
            f"with {what} the rows are one path, and {rows} left out of it: the prediction after "
            "these may be far off; correct them, or leave only their tip blank."
        )

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to believe the result: those of tendons, table and fit."""
        found = [self.tendons.sentence] if self.tendons.alarm else []
        found += [self.data.doubt] if self.data.is_biased else []
        return (*found, *self.fit.doubts)

    @property
    def elsewhere(self) -> list[str]:
        """Estimates that are not part of a robot file, as text."""
        return [str(e) for e in self.fit.estimates if not self.fit.is_in_robot(e.name)]

    @property
    def beside(self) -> dict[str, float]:
        """Fitted and fixed parameters outside the robot file, in SI by name."""
        known = {**self.start, **self.fit.values}
        return {name: value for name, value in known.items() if not self.fit.is_in_robot(name)}

    def beside_to_dict(self) -> dict[str, Any]:
        """Return `beside` in the form of `read_start`, ready for `json.dumps`."""
        return {
            "robot": self.fit.robot.name,
            "robot_hash": self.fit.robot.hash,
            "data": {
                "name": self.data.name,
                "source": self.data.source,
                "sha256": self.data.sha256,
            },
            "units": "SI: m, N, rad, s",
            "values": self.beside,
        }

    @property
    def validation(self) -> Annotated[Holdout | CrossValidation | OtherTable | None, Key()]:
        """Validation on rows that were not fitted; None without any."""
        if self.held_out_score is not None:
            return Holdout(self.held_out_score, self.without_solution)
        if self.folds is not None:
            return self.folds
        other, found = self.other, self.other_predicted
        if other is None or self.other_score is None:
            return None
        return OtherTable(
            self.other_score,
            self.without_solution,
            other.name,
            other.source,
            other.left_out,
            other.sha256,
            intervals=None
            if found is None
            else IntervalCheck(found.coverage(other.tip), found.half_width),
            filtered=None
            if self.ahead is None or self.bias is None
            else OneRowAhead(self.ahead.score, self.bias),
        )

    @property
    def alarm(self) -> Annotated[TendonAlarm, Key("tendon_check")]:
        """Check of the order of the tendons."""
        return TendonAlarm(self.tendons.found, self.tendons.alarm, self.tendons.sentence)

    @property
    def table(self) -> Annotated[FittedTable, Key("data")]:
        """The fitted table."""
        data = self.data
        sigma = None if data.sigma is None else float(np.median(data.sigma))
        counts = len(data), data.left_out, data.without_tip
        return FittedTable(data.name, data.source, *counts, sigma, data.sha256)

    @property
    def lines(self) -> Annotated[Ints, Key()]:
        """Line of each row in the table (K,)."""
        return self.data.line

    @property
    def residuals(self) -> Annotated[Floats, Key("residuals_mm")]:
        """Predicted minus measured tip of each row (K, 3), m; NaN where nothing was measured."""
        return self.fit.residuals


@dataclass(frozen=True, eq=False)
class Validation:
    """Validation of a calibration on unseen rows, by one of three methods.

    Parameters
    ----------
    holdout : float, optional
        Share of the last rows that is held out of the fit and predicted by it, as selected by
        `bowstring.calibration.cross_validation.hold_out`.
    folds : int, optional
        Number of folds of a cross-validation, in addition to the fit to all rows.
    other : Measurements, optional
        Another table of the same bench, predicted by the fit without registration to it. Its rows
        form a separate path.
    filter : bool
        Whether each row of `other` is also predicted from the measured tips of the rows before it,
        by `bowstring.calibration.filtered`.

    Raises
    ------
    InputError
        If more than one is given, or `filter` without `other`.
    """

    holdout: float | None = None
    folds: int | None = None
    other: Measurements | None = None
    filter: bool = False

    def __post_init__(self) -> None:
        if sum(way is not None for way in (self.holdout, self.folds, self.other)) > 1:
            raise InputError("holdout, folds and other are ways to validate; give one")
        if self.filter and self.other is None:
            raise InputError("filter needs another table to predict; give other")


def calibrate(
    robot: Robot,
    data: Measurements,
    parameters: Sequence[str | Prior],
    *,
    model: RodModel | Literal["arc"] | None = None,
    loss: Loss = "soft_l1",
    start: Mapping[str, float] | None = None,
    validation: Validation | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Fit parameters to measurements, and validate the fit on unseen rows.

    Parameters
    ----------
    robot : Robot
        As for `bowstring.fit`.
    data : Measurements
        As for `bowstring.fit`.
    parameters : sequence of str or Prior
        As for `bowstring.fit`.
    model : RodModel or "arc", optional
        As for `bowstring.fit`.
    loss : {"linear", "soft_l1", "huber"}
        As for `bowstring.fit`.
    start : mapping of str to float, optional
        As for `bowstring.fit`.
    validation : Validation, optional
        Method of validation; none by default.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Calibration
        Fit, validation, and check of the tendon order.

    Raises
    ------
    InputError
        As for `bowstring.fit`.
    NoSolutionError
        If the initial model has too few solutions.
    """
    check_is_read(data)
    check = validation or Validation()
    holdout, folds, validate = check.holdout, check.folds, check.other
    if validate is not None and data.sha256 is not None and validate.sha256 == data.sha256:
        raise InputError(
            f"{validate.name} is the table that is fitted, and validates nothing; name another"
        )
    if validate is not None:
        observations.check_validation(data, data.seen, validate)
    if check.filter and validate is not None:
        check_order(data, robot)
        check_order(validate, robot)
    notify = progress or (lambda what, share: None)
    out = np.zeros(len(data), dtype=bool)
    rows = None
    if holdout is not None:
        out = hold_out(robot, data, holdout)
        points = observations.measured_points(data, robot, len(data))
        rows = points.seen.any(axis=1) & (np.cumsum(out) == 0)  # the last rows are held out
    notify("fit", 0.0)
    names = names_of(parameters)
    of_zero = zero_is_fitted(names)
    by_tension = observations.commands(data, robot).are_tensions
    order = check_tendons(robot, data, zero_is_fitted=of_zero, delay_is_fitted="delay" in names)
    begin = dict(start or {})
    if of_zero and by_tension:
        begin = _likely_offsets(robot, data, names) | begin
    rows_of_fit = data
    of_zeros = data.zero_error
    if by_tension and not of_zero and of_zeros is not None and of_zeros.any():
        tendons = np.flatnonzero(of_zeros)
        zeros = [Prior(f"offset.tendons.{k}", float(of_zeros[k])) for k in tendons]
        parameters = [*parameters, *zeros]
        # no error of the zero loads a tendon that has no load
        is_unloaded = (data.tensions == 0.0) & ~robot.tendons.pushes
        loads = np.where(is_unloaded, -_UNLOADED * of_zeros, data.tensions)
        rows_of_fit = replace(data, tensions=loads)
    try:
        found = fit(
            robot,
            rows_of_fit,
            parameters,
            model=model,
            loss=loss,
            rows=rows,
            start=begin,
        )
    except NoSolutionError as error:
        if order.alarm:  # the more probable cause
            raise NoSolutionError(f"{str(error).rstrip('.')}. {order.sentence}") from None
        raise
    held = None
    if holdout is not None:  # all rows form one path, so all are predicted
        held = score(data.tip[out] + found.residuals[out], data.tip[out])
    validated = None
    if folds is not None:
        notify("validation", 1 / (1 + folds))
        validated = cross_validate(found, data, folds=folds)
    other = predicted = None
    if validate is not None:
        notify("validation", 0.9)
        other, predicted = _judged(found, validate)
    ahead = bias = None
    if validate is not None and check.filter:
        notify("filter", 0.95)
        bias = fit_slow_bias(found, data)
        ahead = filtered(found, validate, bias)
    notify("done", 1.0)
    return Calibration(
        data,
        found,
        loss,
        order,
        out,
        held,
        validated,
        dict(start or {}),
        parameters,
        other=validate,
        other_score=other,
        other_predicted=predicted,
        ahead=ahead,
        bias=bias,
    )


def _likely_offsets(
    robot: Robot, data: Measurements, parameters: Sequence[str]
) -> dict[str, float]:
    """Initial values of fitted offsets, by the likely zeros of the tensions."""
    names = [f"offset.tendons.{k}" for k in range(data.tendon_count)]
    zeros = likely_zeros(data.tensions, robot)
    return {
        name: -zero
        for name, zero in zip(names, zeros.tolist(), strict=True)
        if np.isfinite(zero) and {name, "offset.tendons"} & set(parameters)
    }


def _judged(found: Fit, data: Measurements) -> tuple[Score, Predicted | None]:
    """Score of a table that was not fitted, and its intervals if all parameters have one."""
    interval = None
    if np.isfinite(found.standard_errors).all():
        interval = predict_with_interval(found, data)
    predicted = found.predict(data) if interval is None else interval.point
    if not np.isfinite(predicted + data.tip).all(axis=1).any():
        raise NoSolutionError(f"the calibrated model has no solution for any row of {data.name}")
    return score(predicted, data.tip), interval


class _Beside(Content):
    values: Annotated[dict[str, float], Field(max_length=_MOST_VALUES)]


def read_start(path: str | Path) -> dict[str, float]:
    """Read the parameters of a calibrated model outside its robot file.

    Parameters
    ----------
    path : str or Path
        Path of ``calibration.json`` beside a calibrated robot file.

    Returns
    -------
    dict from name to float
        Values in SI for ``start`` of `bowstring.fit`.

    Raises
    ------
    InputError
        If the file cannot be read or has another content.
    """
    try:
        found: dict[str, float] = structured(read_json(path, _MOST_BYTES), _Beside)["values"]
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
        raise InputError(
            f"{path} is no {BESIDE} of bowstring fit: {error}; name the file beside the calibrated "
            "robot.yaml"
        ) from None
    return found
