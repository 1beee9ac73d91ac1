"""Comparison of the guarded residual with other models, and their need of data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats, Progress
from bowstring.calibration import observations
from bowstring.calibration.fitting import Fit, fit
from bowstring.calibration.gaussian_process import GaussianProcess
from bowstring.calibration.observations import Score, score
from bowstring.calibration.priors import Prior, names_of
from bowstring.calibration.residual import LEAST_ROWS, Corrected, Residual, Table, fit_residual
from bowstring.calibration.residual import learn as learn_residual
from bowstring.calibration.table_fit import Calibration
from bowstring.data.measurements import Measurements
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot

Kind = Literal["rod", "arc", "commands"]

#: Numbers of fitted rows that are compared, beside all.
_COUNTS: Final = (50, 100, 300)
#: Parameters that constant curvature shares with statics.
_OF_BOTH: Final = ("base", "tool", "marker", "gain", "offset", "backlash", "delay", "hole_angle")
_OF_ARCS: Final = ("bend_gain", "pitch_radius")


@dataclass(frozen=True)
class Compared(Result):
    """Errors of one model, fitted to some of the rows, on the validation rows."""

    model: Annotated[Kind, Key()]
    """Statics, constant curvature (``arc``), or the Gaussian process on commands alone."""
    rows: Annotated[int, Key("fitted_rows")]
    """Number of rows that model and residual are fitted to, evenly spread over the table."""
    alone: Annotated[Score | None, Key()]
    """Score of the calibrated model; None for commands alone."""
    corrected: Annotated[Score, Key("with_residual")]
    """Score with the residual, of the same rows."""


@short_repr
@dataclass(frozen=True, eq=False)
class ResidualStudy(Result):
    """Residual of a calibration, judged on validation rows; made by `study_residual`."""

    residual: Annotated[Residual, Key(flat=True)]
    """Residual on all fitted rows."""
    corrected: Corrected
    """Points of the validation rows."""
    compared: Annotated[tuple[Compared, ...], Key("comparison")]
    """Models by number of fitted rows; those that could not be fitted are missing."""
    judged: Bools
    """Validation rows with a measured tip (K,)."""

    @property
    def solved(self) -> Bools:
        """Validation rows with a measured and a predicted tip (K,)."""
        return np.asarray(self.judged & np.isfinite(self.corrected.kept))

    @property
    def rows_beyond_data(self) -> Annotated[int, Key()]:
        """Validation rows of which less than half of the variance is explained."""
        return int((self.corrected.beyond & self.solved).sum())

    @property
    def median_share_kept(self) -> Annotated[float, Key()]:
        """Median over the validation rows of the explained share of the variance."""
        return float(np.median(self.corrected.kept[self.solved]))


@dataclass(frozen=True, eq=False)
class _Rows:
    """Fitted rows, and validation rows of the same table or of another one."""

    data: Measurements
    used: Bools
    other: Measurements
    judged: Bools

    def thinned(self, count: int) -> Bools:
        at = np.flatnonzero(self.used)
        some = np.zeros_like(self.used)
        some[at[np.linspace(0, len(at) - 1, min(count, len(at))).round().astype(int)]] = True
        return some

    def score(self, point: Floats, where: Bools) -> Score:
        return score(point[self.judged & where], self.other.tip[self.judged & where])


def study_residual(
    calibration: Calibration, robot: Robot, *, progress: Progress | None = None
) -> ResidualStudy:
    """Fit a residual, and compare it with the same learner on other models and fewer rows.

    Every model is fitted again to 50, 100, 300 and all rows: statics (if that was calibrated) with
    the same parameters, constant curvature with those that it knows and one gain on the bend of
    each segment, and the Gaussian process on the commands alone. The commands of all rows remain
    known, as steps of the path.

    Parameters
    ----------
    calibration : Calibration
        Calibration with rows held out or another table for validation.
    robot : Robot
        Robot before the calibration, from which the other fits start.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    ResidualStudy
        Residual and comparison.

    Raises
    ------
    InputError
        If there are no validation rows, some of them are fitted, or there are too few rows.
    """
    rows = _rows_of(calibration)
    notify = progress or (lambda what, share: None)
    found = calibration.fit
    notify("residual", 0.0)
    residual = fit_residual(found, rows.data, progress=lambda share: notify("residual", share))
    total = int(rows.used.sum())
    counts = [count for count in _COUNTS if LEAST_ROWS <= count < total]
    kinds: list[Kind] = ["arc"] if found.model == "arc" else ["rod", "arc"]
    work = [(kind, count) for kind in kinds for count in [*counts, total]]
    compared = []
    for done, (kind, count) in enumerate(work):
        notify("comparison", done / (len(work) + 1))
        own = found if kind == found.model and count == total else None
        try:
            own = own or _refitted(calibration, robot, kind, rows.data, rows.thinned(count))
            learnt = residual if own is found else fit_residual(own, rows.data)
        except BowstringError:  # too few rows for the parameters, or no arcs for these commands
            continue
        got = learnt.correct(rows.other)
        solved: Bools = np.array(np.isfinite(got.point).all(axis=1))
        both = (rows.score(point, solved) for point in (got.model_point, got.point))
        compared.append(Compared(kind, count, *both))
    for count in [*counts, total]:
        point = _by_commands(found.robot, rows, rows.thinned(count))
        compared.append(Compared("commands", count, None, rows.score(point, rows.judged)))
    notify("done", 1.0)
    corrected = residual.correct(rows.other)
    return ResidualStudy(residual, corrected, tuple(compared), rows.judged)


def _rows_of(calibration: Calibration) -> _Rows:
    data, used = calibration.data, calibration.fit.used_tips
    other, judged = calibration.other, calibration.held_out
    if other is not None:
        judged = other.seen
    elif judged.any():
        other = data
    else:
        raise InputError(
            "a residual needs validation rows: give another table, or hold rows out of the fit"
        )
    return _Rows(data, used, other, judged)


def _refitted(
    calibration: Calibration, robot: Robot, kind: Kind, data: Measurements, rows: Bools
) -> Fit:
    found, parameters, start = calibration.fit, calibration.parameters, calibration.start
    if kind != found.model:
        parameters, start = of_arcs(parameters, start)
    return fit(
        robot,
        data,
        parameters,
        model=found.rod if kind == "rod" else "arc",
        loss=calibration.loss,
        start=start,
        rows=rows,
    )


def of_arcs(
    parameters: Sequence[str | Prior], start: Mapping[str, float]
) -> tuple[list[str | Prior], dict[str, float]]:
    """Parameters and start values of constant curvature, from those of statics."""
    named = zip(parameters, names_of(parameters), strict=True)
    own = [each for each, name in named if _head(name) in _OF_BOTH]
    held = {name: v for name, v in start.items() if _head(name) in (*_OF_BOTH, *_OF_ARCS)}
    return [*own, "bend_gain.segments"], held


def _head(name: str) -> str:
    return name.partition(".")[0]


def _by_commands(robot: Robot, rows: _Rows, used: Bools) -> Floats:
    """Points (K, 3) of the validation rows by a Gaussian process on the commands alone."""
    data: Any = rows.data
    commands = observations.commands(data, robot)
    kinds, measured = commands.by_displacement[0], observations.tips(data, len(commands))
    middle = np.broadcast_to(measured[used].mean(axis=0), measured.shape)
    table = Table(commands.values, middle, commands.paths)
    alone = {"point": math.inf, "memory": math.inf, "radius": 0.0}
    at, scales, _ = learn_residual(table, measured, robot, data, used, kinds, fixed=alone)
    inputs = table.inputs(at, scales)
    process = GaussianProcess(inputs[used], (measured - middle)[used], at.noise)
    asked = observations.commands(rows.other, robot)
    there = Table(asked.values, np.zeros((len(asked), 3)), asked.paths)
    return np.asarray(middle[:1] + process.mean(there.inputs(at, scales)))
