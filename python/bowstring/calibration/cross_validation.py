"""Validation of a fit on unseen rows: cross-validation and hold-out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Literal

import numpy as np
from numpy.typing import ArrayLike

from bowstring import threads
from bowstring.aliases import Bools, Floats
from bowstring.calibration import observations
from bowstring.calibration.fitting import Fit
from bowstring.calibration.folds import part_of_rows
from bowstring.calibration.observations import Measured, Score, score_of_errors
from bowstring.calibration.search import Nearby
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.validation import shown


@dataclass(frozen=True)
class Fold(Result):
    """A part of a cross-validation."""

    left_out: Annotated[str, Key()]
    """What this part leaves out of the fit and predicts."""
    score: Annotated[Score, Key(flat=True)]
    """Score of its rows."""


@short_repr
@dataclass(frozen=True, eq=False)
class CrossValidation(Result):
    """Errors on rows that were left out; made by `cross_validate`."""

    folds: tuple[Score, ...]
    """Score of each left-out part, by a fit to the others."""
    labels: tuple[str, ...]
    """Left-out part of each fold in words."""
    score: Annotated[Score, Key(flat=True)]
    """Score of all rows, each predicted by the fit without it."""
    residuals: Floats
    """Predicted minus measured tip (K, 3), m; NaN without a measurement or a prediction."""
    without_solution: Annotated[int, Key("rows_without_solution")]
    """Number of left-out rows without a solution of the model; no score includes them."""
    converged: Annotated[bool, Key()]
    """Whether all fits converged."""
    kind: Annotated[Literal["folds"], Key()] = "folds"
    """Kind of validation."""

    @property
    def parts(self) -> Annotated[tuple[Fold, ...], Key("folds")]:
        """Parts of the rows, each with its score."""
        return tuple(map(Fold, self.labels, self.folds))


def cross_validate(
    found: Fit,
    data: Measured,
    *,
    folds: int = 5,
    rows: ArrayLike | None = None,
    start: Mapping[str, float] | None = None,
    progress: Callable[[float], None] | None = None,
) -> CrossValidation:
    """Repeat a fit without a part of the rows and predict the tips of that part, for each part.

    Parts are blocks of neighbouring rows that do not split a group, because single left-out rows
    would be predicted by their neighbours. Where loads repeat, or recur in unloading without
    groups, a part has neighbouring loads with all their rows, because a left-out row would
    otherwise be predicted by its repeat.

    Parameters
    ----------
    found : Fit
        Fit to the measurements, or to some of their rows.
    data : Measurements or Data
        The measurements.
    folds : int
        Number of parts.
    rows : array_like, optional
        Rows to divide into parts, as for `fit`; all by default.
    start : mapping of str to float, optional
        Initial values of the fits, as for `fit`; by default those of `found`.
    progress : callable, optional
        Progress callback, called before the first fit and after each one with the finished share.

    Returns
    -------
    CrossValidation
        Errors of the predicted rows, by part and in total.

    Notes
    -----
    The fits end where the cost changes by less than a part in 10 000, which changes the errors of
    the rows left out by far less than their standard error. Fits with a memory begin with the
    same derivatives, update them, and compute new ones at the end; they run at the same time on
    several cores.
    """
    robot, again = found.robot, found.again
    if start is not None:
        again = partial(again, starts=[start])
    commands = observations.commands(data, robot)
    measured = observations.tips(data, len(commands))
    points = observations.measured_points(data, robot, len(commands)).measured
    fitted = observations.fitted_rows(rows, points)
    used = fitted & np.isfinite(measured).all(axis=1)
    part, group = part_of_rows(data, commands.values, used, folds)
    residuals = np.full_like(measured, np.nan)
    near = Nearby(found.noise)
    notify = progress or (lambda share: None)

    def without(k: int) -> Fit:
        return again(data=data, rows=fitted & (part != k), near=near)

    notify(0.0)
    first_fold = without(0)  # makes what the others share
    notify(1 / folds)
    # a path with a memory uses one core; statics of independent rows use all, and store much
    at_once = int(folds) if robot.has_memory else 1
    fits = threads.results(
        without, range(1, int(folds)), lambda done: notify((1 + done) / folds), at_once
    )
    scores, labels, converged = [], [], True
    for k, alone in enumerate([first_fold, *fits]):
        out, others = used & (part == k), fitted & (part != k)
        residuals[out] = alone.residuals[out]
        scores.append(score_of_errors(residuals[out]))
        names = list(dict.fromkeys(group[out].tolist()))
        first, last = 1 + np.flatnonzero(out)[[0, -1]]
        if len(names) > 1:
            labels.append(f"{names[0]} to {names[-1]}")
        elif names[0] in group[others]:
            labels.append(f"rows {first} to {last}")
        else:
            labels.append(names[0])
        converged &= alone.converged
    return CrossValidation(
        folds=tuple(scores),
        labels=tuple(labels),
        score=score_of_errors(residuals[used]),
        residuals=residuals,
        without_solution=int(np.isnan(residuals[used]).any(axis=1).sum()),
        converged=converged,
    )


def hold_out(robot: Robot, data: Measured, share: float) -> Bools:
    """Select the last rows, to validate a fit to the others by `Fit.predict`.

    Parameters
    ----------
    robot : Robot
        As for `fit`.
    data : Measurements or Data
        As for `fit`.
    share : float
        Approximate share of the rows with a measured tip; a run of a group is not split.

    Returns
    -------
    ndarray of bool (K,)
        True for the rows that are held out.
    """
    if not 0 < share < 1:
        raise InputError(f"share is {shown(share)}, it must lie between 0 and 1")
    count = len(observations.commands(data, robot))
    seen = np.isfinite(observations.tips(data, count)).all(axis=1)
    group = observations.groups(data, count)[seen]
    order = np.cumsum(seen)
    # the end of a run nearest to the share, with rows left on either side
    ends = 1 + np.flatnonzero(group[1:] != group[:-1])
    if not len(ends):
        ends = np.arange(1, len(group))
    if not len(ends):
        raise InputError(f"{len(group)} rows with a measured tip are too few to hold any out")
    last = ends[np.argmin(np.abs(ends - (1 - share) * len(group)))]
    out: Bools = seen & (order > last)
    return out
