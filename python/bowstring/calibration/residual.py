"""Guarded residual: correction of a calibrated model by a Gaussian process.

The process predicts measured minus predicted point from commands, predicted point and memory
states (docs/theory/calibration.md). Away from its data it tends to zero, and the calibrated model
alone remains. All values are in SI; K is the number of rows, T that of tendons.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration import observations
from bowstring.calibration.fitting import Fit
from bowstring.calibration.folds import parts
from bowstring.calibration.gaussian_process import GaussianProcess
from bowstring.calibration.observations import Measured, Score, score
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import Commands, TipModel
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics.model import RodModel

Progress = Callable[[float], None]

#: Least number of measured rows: four for each of five parts.
LEAST_ROWS: Final = 20
#: Explained share of the variance below which a row is beyond the data.
LEAST_KEPT: Final = 0.5
#: Largest number of rows of a process; a larger table is thinned evenly.
MOST_ROWS: Final = 4_000
#: Largest number of rows that a process of the search is fitted to.
_MOST_SEARCHED: Final = 600
_FOLDS: Final = 5
_PASSES: Final = 2


@dataclass(frozen=True)
class Hyperparameters(Result):
    """Length scales of the inputs of a residual, radius of its memory, and noise."""

    commands: Annotated[float, Key()] = 1.4
    """Length scale of the commands over their spread; infinite if they are not used."""
    point: Annotated[float, Key()] = math.inf
    """Length scale of the predicted point over the robot's length; infinite if it is not used."""
    memory: Annotated[float, Key()] = 2.0
    """Length scale of the memory state over its radius; infinite if it is not used."""
    radius: float = 0.02
    """Radius of the memory state over the robot's length."""
    noise: float = 0.2
    """Variance of the noise over that of the residual."""


#: Values that the search tries, one hyper-parameter after the other.
_TRIED: Final[dict[str, tuple[float, ...]]] = {
    "commands": (0.7, 1.4, 2.8, math.inf),
    "memory": (1.0, 2.0, 4.0, math.inf),
    "radius": (0.01, 0.02, 0.04),
    "point": (0.25, 0.5, 1.0, math.inf),
    "noise": (0.05, 0.2, 0.8),
}


@dataclass(frozen=True)
class Scales:
    """Units of the inputs.

    Attributes
    ----------
    command : ndarray (T,)
        Spread of the fitted commands, m or N: the root of the summed variances of all tendons with
        the same kind of command.
    length : float
        Length of the robot, m.
    """

    command: Floats
    length: float


@dataclass(frozen=True, eq=False)
class Table:
    """Commands and predicted points of rows, from which inputs are made.

    Attributes
    ----------
    commands : ndarray (K, T)
        Displacements in m and tensions in N.
    point : ndarray (K, 3)
        Predicted points, m; NaN without a solution.
    paths : list of ndarray
        Rows of each path, in order.
    """

    commands: Floats
    point: Floats
    paths: list[Ints]

    @cached_property
    def _memory(self) -> dict[float, Floats]:
        return {}

    def memory(self, radius: float) -> Floats:
        """Memory state (K, 3) relative to the predicted point, at most the radius away, m."""
        if radius not in self._memory:
            state = np.zeros_like(self.point)
            for rows in self.paths:
                state[rows] = _follow(self.point[rows], radius) - self.point[rows]
            self._memory[radius] = state
        return self._memory[radius]

    def with_memory(self, radius: float, memory: Floats) -> Table:
        """Copy of the table with a known memory state (K, 3)."""
        out = replace(self)
        out._memory[radius] = memory
        return out

    def select(self, rows: Ints, radius: float) -> Table:
        """Some rows, with their memory state on the whole path."""
        own = Table(self.commands[rows], self.point[rows], [np.arange(len(rows))])
        return own.with_memory(radius, self.memory(radius)[rows])

    def inputs(self, at: Hyperparameters, scales: Scales) -> Floats:
        """Inputs (K, d) in units of their length scales."""
        found = []
        if math.isfinite(at.commands):
            found.append(self.commands / (at.commands * scales.command))
        if math.isfinite(at.point):
            found.append(self.point / (at.point * scales.length))
        if math.isfinite(at.memory):
            radius = at.radius * scales.length
            found.append(self.memory(radius) / (at.memory * radius))
        return np.concatenate(found, axis=1)


def _follow(points: Floats, radius: float) -> Floats:
    """Vector play operator: state that follows points (K, 3) at most a radius behind.

    Other than a play of each coordinate, it does not depend on the axes. A row without a point
    leaves the state where it is.
    """
    out = np.empty_like(points)
    state = None
    for k, point in enumerate(points):
        if np.isfinite(point).all():
            if state is None:
                state = point
            behind = state - point
            distance = math.sqrt(float(behind @ behind))
            if distance > radius:
                state = point + behind * (radius / distance)
        out[k] = np.nan if state is None else state
    return out


@short_repr
@dataclass(frozen=True, eq=False)
class Corrected:
    """Points of the calibrated model with the residual; made by `Residual.correct`.

    Attributes
    ----------
    point : ndarray (K, 3)
        Corrected point in the measuring frame, m; NaN where the model has no solution.
    model_point : ndarray (K, 3)
        Point of the calibrated model alone, m.
    kept : ndarray (K,)
        Share of the variance of the residual that the data explain: near 1 among the data; where it
        is 0, the correction is zero too.
    """

    point: Floats
    model_point: Floats
    kept: Floats

    @property
    def beyond(self) -> Bools:
        """Rows (K,) beyond the data, of which less than half of the variance is explained."""
        return np.asarray(~(self.kept >= LEAST_KEPT))


@short_repr
@dataclass(frozen=True, eq=False)
class Residual(Result):
    """Calibrated model and the Gaussian process of its residual; made by `fit_residual`.

    Attributes
    ----------
    robot : Robot
        Calibrated robot.
    rod : RodModel or None
        Model of the rod; None for constant curvature.
    values : dict from name to float
        Base, tool and actuation of the calibration, in SI.
    tool : ndarray (3,)
        Offset of the measured point from the tip that the fitted rows stated, m; the calibration
        may have fitted another one.
    hyperparameters : Hyperparameters
        Chosen by cross-validation.
    scales : Scales
        Units of the inputs.
    by_displacement : ndarray of bool (T,)
        Kind of command of each tendon.
    table : Table
        Inputs of the fitted rows.
    residuals : ndarray (n, 3)
        Measured minus predicted points of these rows, m.
    validated : tuple of Score
        Scores of rows that were left out by blocks, of the calibrated model (which is fitted to all
        rows) and with the residual.
    """

    robot: Robot
    rod: RodModel | None
    values: Mapping[str, float]
    tool: Floats
    hyperparameters: Hyperparameters
    scales: Scales
    by_displacement: Bools
    table: Table
    residuals: Floats
    validated: tuple[Score, Score]

    @cached_property
    def _process(self) -> GaussianProcess:
        at = self.hyperparameters
        return GaussianProcess(self.table.inputs(at, self.scales), self.residuals, at.noise)

    def correct(self, data: Any) -> Corrected:
        """Predict points by the calibrated model and correct them.

        Parameters
        ----------
        data : measurements or Load
            Rows, of which the commands and, for a delay, the times are used. They form one path, or
            one for each recording: memory states begin at its first row.

        Returns
        -------
        Corrected
            Points with and without the residual, and the share that the data explain.

        Raises
        ------
        InputError
            If commands are of another kind than in the fit, or times do not increase.
        """
        commands = observations.commands(data, self.robot)
        if not (commands.by_displacement == self.by_displacement).all():
            t = int(np.flatnonzero((commands.by_displacement != self.by_displacement).any(0))[0])
            kind = "displacements" if self.by_displacement[t] else "tensions"
            raise InputError(f"the residual was fitted to {kind} of tendon {t + 1}; give these")
        _check_order(commands, self.hyperparameters)
        self._check_tool(data)
        point = model_points(self.robot, self.values, commands, self.rod)
        table = Table(commands.values, point, commands.paths)
        inputs = table.inputs(self.hyperparameters, self.scales)
        solved = np.isfinite(point).all(axis=1)
        shift, kept = np.full_like(point, np.nan), np.full(len(point), np.nan)
        shift[solved] = self._process.mean(inputs[solved])
        kept[solved] = self._process.explained(inputs[solved])
        return Corrected(point + shift, point, kept)

    def _check_tool(self, data: Any) -> None:
        """Refuse rows that state another measured point than the fitted ones."""
        stated = observations.tool(data)
        fitted = np.array([self.values.get(f"tool.{axis}", 0.0) for axis in "xyz"])
        known = [np.allclose(stated, own, rtol=0.0, atol=1e-9) for own in (self.tool, fitted)]
        if stated.any() and not any(known):
            said = ", ".join(f"{1e3 * x:g}" for x in stated.tolist())
            raise InputError(
                f"the rows state the tool {said} mm, the residual was fitted to another measured "
                "point; fit it again to rows with this tool"
            )

    @property
    def length_scales(self) -> Annotated[Hyperparameters, Key()]:
        """Length scales of the inputs."""
        return self.hyperparameters

    @property
    def memory_radius(self) -> Annotated[float | None, Key("memory_radius_mm")]:
        """Radius of the memory state, m; None if it is not used."""
        at = self.hyperparameters
        return at.radius * self.scales.length if math.isfinite(at.memory) else None

    @property
    def noise(self) -> Annotated[float, Key()]:
        """Variance of the noise over that of the residual."""
        return self.hyperparameters.noise

    @property
    def rows(self) -> Annotated[int, Key()]:
        """Number of rows of the Gaussian process."""
        return len(self.residuals)

    @property
    def folds_model(self) -> Annotated[Score, Key()]:
        """Tip errors of the calibrated model alone, which is fitted to all rows, at these rows."""
        return self.validated[0]

    @property
    def folds_residual(self) -> Annotated[Score, Key()]:
        """Tip errors of the same rows, each predicted by a residual without its block of rows."""
        return self.validated[1]


def fit_residual(
    found: Fit, data: Measured, *, rows: ArrayLike | None = None, progress: Progress | None = None
) -> Residual:
    """Fit a Gaussian process to what a calibrated model leaves.

    Parameters
    ----------
    found : Fit
        Calibrated model.
    data : measurements
        Rows in the order of measurement, as for the fit.
    rows : array_like of bool (K,), optional
        Rows to fit, by default those of `found`.
    progress : callable, optional
        Progress callback, called with the finished share from 0 to 1.

    Returns
    -------
    Residual
        Calibrated model with residual.

    Raises
    ------
    InputError
        If there are too few rows, their times do not increase, or a tendon changes its kind of
        command.
    """
    commands = observations.commands(data, found.robot)
    kinds = commands.by_displacement
    if (kinds != kinds[0]).any():
        t = int(np.flatnonzero((kinds != kinds[0]).any(axis=0))[0])
        raise InputError(
            f"tendon {t + 1} has tensions in some rows and displacements in others; a residual "
            "needs one kind of command for each tendon"
        )
    _check_order(commands, Hyperparameters())
    end = len(found.robot.disks.station_m)
    if found.points[-1].disk != end:
        raise InputError(
            f"the last point is on disk {found.points[-1].disk}; a residual is of a tip on the end "
            f"disk, disk {end}"
        )
    measured = observations.tips(data, len(commands))
    used = observations.fitted_rows(found.used_tips if rows is None else rows, measured)
    values = found.outside_robot
    points = model_points(found.robot, values, commands, found.rod)
    table = Table(commands.values, points, commands.paths)
    used = used & np.isfinite(table.point).all(axis=1)
    at, scales, left_out = learn(
        table, measured, found.robot, data, used, kinds[0], progress=progress
    )
    kept = np.flatnonzero(used)
    kept = kept[np.linspace(0, len(kept) - 1, min(len(kept), MOST_ROWS)).round().astype(int)]
    return Residual(
        robot=found.robot,
        rod=found.rod,
        values=values,
        tool=observations.tool(data),
        hyperparameters=at,
        scales=scales,
        by_displacement=kinds[0],
        table=table.select(kept, at.radius * scales.length),
        residuals=measured[kept] - table.point[kept],
        validated=(
            score(table.point[used], measured[used]),
            score(left_out[used], measured[used]),
        ),
    )


def learn(
    table: Table,
    measured: Floats,
    robot: Robot,
    data: Measured,
    used: Bools,
    by_displacement: Bools,
    *,
    fixed: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> tuple[Hyperparameters, Scales, Floats]:
    """Choose hyper-parameters by cross-validation over blocks of rows.

    Parameters
    ----------
    table : Table
        Commands and predicted points.
    measured : ndarray (K, 3)
        Measured points, m.
    robot : Robot
        Robot, for its length.
    data : measurements
        Rows, for the blocks.
    used : ndarray of bool (K,)
        Rows to fit.
    by_displacement : ndarray of bool (T,)
        Kind of command of each tendon.
    fixed : mapping from name to float, optional
        Hyper-parameters that are held.
    progress : callable, optional
        Progress callback.

    Returns
    -------
    tuple of Hyperparameters, Scales and ndarray (K, 3)
        Chosen values, units of the inputs, and points of the left-out rows, m.
    """
    count = int(used.sum())
    if count < LEAST_ROWS:
        raise InputError(
            f"{count} measured rows are too few for a residual; measure {LEAST_ROWS} at least"
        )
    part = parts(data, table.commands, used, _FOLDS)
    scales = Scales(_spread(table.commands[used], by_displacement), robot.length)
    notify = progress or (lambda share: None)
    tried: dict[Hyperparameters, float] = {}

    def error(at: Hyperparameters) -> float:
        if math.isinf(at.commands) and math.isinf(at.point):
            return math.inf  # the correction would not end with the data
        if at not in tried:
            left_out = _left_out(table, measured, used, part, at, scales, _MOST_SEARCHED)
            tried[at] = float(np.sqrt(((left_out - measured)[used] ** 2).sum(axis=1).mean()))
        return tried[at]

    held = dict(fixed or {})
    best = replace(Hyperparameters(), **held)
    names = [name for name in _TRIED if name not in held]
    steps = _PASSES * len(names)
    for step in range(steps):
        name = names[step % len(names)]
        options = [replace(best, **{name: value}) for value in _TRIED[name]]
        best = min([best, *options], key=error)
        notify((step + 1) / steps)
    left_out = _left_out(table, measured, used, part, best, scales, MOST_ROWS)
    return best, scales, left_out


def model_points(
    robot: Robot, values: Mapping[str, float], commands: Commands, rod: RodModel | None
) -> Floats:
    """Points (K, 3) in m of a model of known values; NaN without a solution."""
    return TipModel(Unknowns(robot, [], values), commands, rod).predict(np.zeros(0)).point


def _left_out(
    table: Table,
    measured: Floats,
    used: Bools,
    part: Ints,
    at: Hyperparameters,
    scales: Scales,
    most: int,
) -> Floats:
    """Points (K, 3) of each part, corrected by a process of other rows, up to a number of them."""
    inputs = table.inputs(at, scales)
    out = np.full_like(measured, np.nan)
    for k in np.unique(part[used]):
        others, own = np.flatnonzero(used & (part != k)), used & (part == k)
        others = others[np.linspace(0, len(others) - 1, min(len(others), most)).astype(int)]
        residuals = measured[others] - table.point[others]
        process = GaussianProcess(inputs[others], residuals, at.noise)
        out[own] = table.point[own] + process.mean(inputs[own])
    return out


def _spread(commands: Floats, by_displacement: Bools) -> Floats:
    """Spread (T,) of commands over all tendons with the same kind of command."""
    variance = commands.var(axis=0)
    out = np.ones(commands.shape[1])
    for kind in (True, False):
        own = by_displacement == kind
        total = float(np.sqrt(variance[own].sum()))
        out[own] = total if total > 0 else 1.0
    return out


def _check_order(commands: Commands, at: Hyperparameters) -> None:
    """Refuse rows that are not in the order of measurement, if there are memory states."""
    if math.isfinite(at.memory):
        refuse_disorder(commands, "memory states need")


def refuse_disorder(commands: Commands, what: str) -> None:
    """Raise `InputError` if times decrease along a path; `what` needs the order of measurement."""
    if commands.time is None:
        return
    for rows in commands.paths:
        back = np.flatnonzero(np.diff(commands.time[rows]) < 0)
        if len(back):
            raise InputError(
                f"row {rows[back[0] + 1] + 1} is earlier than the row before it; {what} "
                "rows in the order of measurement: sort them by time"
            )
