"""Calibration of a robot, its actuation and its frames from measurements.

Robust nonlinear least squares (SciPy) on the measured points, with standard errors and
identifiability of the parameters; docs/theory/calibration.md has the equations. All values are in
SI; K is the number of rows, M that of measured points in a row, P that of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from bowstring import threads
from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration import observations
from bowstring.calibration.bootstrap import Linear
from bowstring.calibration.folds import parts
from bowstring.calibration.intervals import EXACT, SAME, Dependence, Uncertainty, profile_ends
from bowstring.calibration.observations import (
    AllPoints,
    Measured,
    Points,
    PointScore,
    Score,
    score_of_errors,
)
from bowstring.calibration.parameters import Unknowns, initial_of, marker_of
from bowstring.calibration.pieces import Loss
from bowstring.calibration.priors import Prior, Priors, deviations_of, names_of, with_priors
from bowstring.calibration.search import Nearby, Residuals, Search, spread
from bowstring.calibration.tip_model import Commands, Prediction, TipModel
from bowstring.data.rigid import align
from bowstring.errors import BowstringError, InputError
from bowstring.formatting import in_mm, listed, significant, with_error
from bowstring.results import Key, Result
from bowstring.robot.model import Robot, check_robot
from bowstring.robot.paths import example_path
from bowstring.significance import NOISE, chi_square_p, explained_p
from bowstring.statics.model import RodModel, as_model
from bowstring.validation import shown

#: Least share of a parameter in a direction that is not identifiable, to be named with it.
_MEMBER: Final = 0.1
#: Ratio of residuals to the stated uncertainty that indicates a lack of fit, if significant.
_EXCESS: Final = 1.5
#: Blocks of rows with dependent residuals, each of which a fit to the others predicts.
_BLOCKS: Final = 5
#: Largest number of rows of statics; each stores its solution and derivatives, with 30 modules 0.5
#: MB.
_MOST_ROWS: Final = 10_000
#: Share of rows without an equilibrium at the end above which a fit has not converged.
_MOST_LOST: Final = 0.05
#: Largest decrease of the cost by one more step in a converged fit, in variances of a residual per
#: parameter (Bates and Watts, Technometrics 23, 1981).
_OFFSET: Final = 0.5
#: Correlation of two parameters above which they can prevent convergence.
_HELD_UP: Final = 0.99
#: Standard error over that of the prior above which the prior determines a parameter.
_BY_PRIOR: Final = 0.95
#: Standard deviations between prior and data beyond which they contradict each other.
_CONFLICT: Final = 3.0
#: Reweighted least squares of a linearised robust fit.
_REWEIGHTINGS: Final = 10
#: Initial friction, in natural steps, in place of zero.
_LITTLE: Final = 0.2
#: Parameters of frames and offsets, which are no fields of the robot file.
_OF_FRAMES: Final = ("base", "tool", "marker")
#: Share of the squares left by a rigid motion below which the residuals are a rigid offset.
_RIGID: Final = 0.25


@dataclass(frozen=True)
class Estimate(Result):
    """Estimate of one parameter, in its usual unit.

    Where tendons become slack or taut inside the interval, it is that of the profile likelihood,
    and the standard error is a part of its width.
    """

    name: Annotated[str, Key()]
    """Name of the parameter."""
    unit: Annotated[str, Key()]
    """Unit of the numbers."""
    value: Annotated[float, Key(unit="`unit`")]
    """Estimate."""
    standard_error: Annotated[float, Key(unit="`unit`")]
    """Standard error; infinite, as are the bounds, if the parameter is not identifiable or the
    standard error as wide as its range."""
    low: Annotated[float, Key(unit="`unit`")]
    """Lower bound of the 95 % interval, which may be infinite."""
    high: Annotated[float, Key(unit="`unit`")]
    """Upper bound, which may be infinite."""
    start: Annotated[float, Key(unit="`unit`")]
    """Value at which the fit begins."""
    at_limit: Annotated[bool, Key()]
    """Whether the estimate is at a limit of the parameter."""
    cut: Annotated[bool, Key()] = False
    """Whether the interval is truncated at a limit of the parameter."""
    prior_mean: Annotated[float | None, Key(unit="`unit`")] = None
    """Mean of the prior; None without one."""
    prior_sd: Annotated[float | None, Key(unit="`unit`")] = None
    """Standard deviation of the prior; None without one."""

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if not np.isfinite(self.standard_error):
            return f"{self.name} = {self.value:.5g}{unit} (not determined)"
        return f"{self.name} = {with_error(self.value, self.standard_error)}{unit}"


@dataclass(frozen=True, eq=False)
class EndOfFit(Result):
    """Estimates, and how the fit ended."""

    estimates: Annotated[tuple[Estimate, ...], Key("parameters")]
    """Fitted parameters."""
    correlation: Annotated[Floats, Key()]
    """Correlation of the estimates (P, P); NaN where not identifiable."""
    not_identifiable: Annotated[tuple[tuple[str, ...], ...], Key()]
    """Groups of correlated parameters that the data cannot separate. A group of one is a parameter
    that is not identifiable: its standard error spans its whole range, or is infinite."""
    used: Bools
    """Fitted rows (K,): the selected ones that have an equilibrium."""
    converged: Annotated[bool, Key()]
    """Whether the fit converged."""
    message: Annotated[str, Key()]
    """How the fit ended, and how reliable its numbers are."""

    @property
    def rows(self) -> Annotated[int, Key()]:
        """Number of fitted rows."""
        return int(self.used.sum())


@dataclass(frozen=True, eq=False)
class Fit(EndOfFit):
    """Calibrated parameters; made by `fit`."""

    model: Annotated[Literal["rod", "arc"], Key()]
    """Statics of the rod, or constant curvature (``arc``)."""
    robot: Robot
    """Calibrated robot, with fitted holes."""
    point_residuals: Floats
    """Predicted minus measured points (K, M, 3) of all rows, m; NaN without a measurement. The last
    point is the tip."""
    points_before: Floats
    """The same at the initial parameters; a base of which all parameters are fitted is already
    registered."""
    points: Annotated[tuple[PointScore, ...], Key()]
    """Disk and scores of each measured point, from base to tip; the last is the tip."""
    score: Annotated[Score, Key(flat=True)]
    """Score of the tips of the fitted rows after the fit."""
    score_before: Score
    """The same before the fit."""
    score_of_points: Score
    """Score of all measured points of the fitted rows after the fit."""
    score_of_points_before: Score
    """The same before the fit."""
    noise: Annotated[float, Key("noise_mm")]
    """Robust standard deviation of a coordinate, m: 1.48 times the median absolute residual, on
    which outliers have little influence."""
    excess: Annotated[float, Key("residuals_over_stated_uncertainty")]
    """RMS of the residuals over the stated uncertainties: about 1 for a model without lack of fit;
    NaN where none are stated."""
    autocorrelation: Annotated[float, Key()]
    """Autocorrelation of the residuals of neighbouring rows in a group; NaN with too few rows.
    Above 0.3, if significant, they are not noise, and intervals and correlations allow for it."""
    doubts: Annotated[tuple[str, ...], Key()]
    """Reasons not to believe the result: parameters without a prior that are not physically
    possible, and a base that is missing. Empty without a doubt."""
    evaluations: Annotated[int, Key()]
    """Passes over all rows."""
    unsolved: Annotated[int, Key("rows_without_equilibrium")]
    """Number of selected rows without an equilibrium, which are not fitted."""
    drives: tuple[str, ...]
    """Parameters that the drives of `robot` have: the delay, and gains, and offsets as zeros, if
    all commands are displacements; each if a robot file can have its values."""
    linear: Linear
    """Linearised fit at its minimum, for `bowstring.calibration.bootstrap.refitted`."""
    again: Callable[..., Fit]
    """Fits the same to other measurements: ``again(data=..., rows=...)`` is `fit_from` with all
    other arguments as they were given, unless they are given anew."""
    _unknowns: Unknowns
    _commands: Commands
    _values: Floats
    _rod: RodModel | None
    _tool_said: Bools

    def __repr__(self) -> str:
        return f"<Fit of {self.robot.name}: {len(self.estimates)} parameters, {self.score}>"

    def __getitem__(self, name: str) -> Estimate:
        for estimate in self.estimates:
            if estimate.name == name:
                return estimate
        raise InputError(f"{shown(name)} was not fitted; fitted are {', '.join(self.names)}")

    @property
    def names(self) -> list[str]:
        """Names of the fitted parameters, in the order of the estimates."""
        return [estimate.name for estimate in self.estimates]

    @property
    def values(self) -> dict[str, float]:
        """Return the estimates in SI by name, for ``start`` of another fit."""
        return dict(zip(self.names, self._values.tolist(), strict=True))

    @property
    def rmse_before(self) -> Annotated[float, Key("rmse_before_mm")]:
        """Root mean square of the tip error of the given robot, m; NaN without a measured tip.

        A base of which all six parameters are fitted is first put where it fits best.
        """
        return self.score_before.rmse

    @property
    def mean_before(self) -> Annotated[float, Key("mean_before_mm")]:
        """Mean of the same, m; NaN without a measured tip."""
        return self.score_before.mean

    @property
    def all_points(self) -> Annotated[AllPoints, Key()]:
        """Errors over all measured points of the fitted rows."""
        before = self.score_of_points_before.rmse
        return AllPoints(**vars(self.score_of_points), rmse_before=before)

    @property
    def whole_message(self) -> str:
        """Doubts and message; the message first where the fit has not converged."""
        said = [*self.doubts, self.message] if self.converged else [self.message, *self.doubts]
        return " ".join(said)

    @property
    def outside_robot(self) -> dict[str, float]:
        """Values of base, tool and actuation, fitted and fixed, in SI by name.

        With `robot` and `rod` they are the calibrated model.
        """
        return self._unknowns.outside_file(self._values, drives=self.drives)

    def is_in_robot(self, name: str) -> bool:
        """Whether `robot` has a parameter, or a group of them."""
        return self._unknowns.is_in_file(name, drives=self.drives)

    @property
    def rod(self) -> RodModel | None:
        """Model of the rod; None for constant curvature."""
        return self._rod

    @property
    def residuals(self) -> Floats:
        """Predicted minus measured tip (K, 3) of all rows, m; NaN without a measurement."""
        return self.point_residuals[:, -1]

    @property
    def used_tips(self) -> Bools:
        """Fitted rows (K,) with a measured tip."""
        return self.used & np.isfinite(self.residuals).all(axis=1)

    @property
    def before(self) -> Floats:
        """Residuals of the tip (K, 3) at the initial parameters, m."""
        return self.points_before[:, -1]

    @property
    def disks(self) -> tuple[int, ...]:
        """Disk of each measured point, from 0."""
        return tuple(each.disk - 1 for each in self.points)

    def predict(self, data: Measured) -> Floats:
        """Predict the measured tip (K, 3) in m by the calibrated model, without registration.

        Parameters
        ----------
        data : measurements
            Measurements, of which the commands are used, the time for a delay, and the tool if the
            fit took it from its measurements. With a memory or backlash the rows form one path.

        Returns
        -------
        ndarray (K, 3)
            Predicted tips, NaN where the model has no solution.
        """
        return self._predicted(data, self.disks[-1:])[:, -1]

    def predict_points(self, data: Measured) -> Floats:
        """Predict all points of the fit by the calibrated model, without registration.

        Parameters
        ----------
        data : measurements
            As for `predict`.

        Returns
        -------
        ndarray (K, M, 3)
            Predicted points on the disks of the fitted ones, m, the last of them the tip; NaN where
            the model has no solution.
        """
        return self._predicted(data, self.disks)

    def jacobian(self, data: Measured) -> Floats:
        """Derivatives (K, 3, P) of the predicted tip by the parameters, in SI.

        Parameters
        ----------
        data : measurements
            As for `predict`.

        Returns
        -------
        ndarray (K, 3, P)
            In the order of `estimates`; NaN or zero where the model has no solution.
        """
        model = self._model(data, self.disks[-1:])
        return model.jacobian(self._values, model.predict(self._values, keep=True))

    @property
    def standard_errors(self) -> Floats:
        """Standard errors (P,) of the estimates in SI."""
        units = [item.per_unit for item in self._unknowns.items]
        return np.array([e.standard_error for e in self.estimates]) * units

    def _model(self, data: Measured, disks: Sequence[int]) -> TipModel:
        commands = observations.commands(data, self._unknowns.robot)
        unknowns = self._unknowns
        if not commands.is_same(self._commands):  # the fitted initial state is not theirs
            unknowns = unknowns.from_home()
        return TipModel(unknowns, commands, self._rod, disks)

    def _predicted(self, data: Measured, disks: Sequence[int]) -> Floats:
        found = self._model(data, disks).predict(self._values)
        held = found.setting.tool
        tool = np.where(self._tool_said, observations.tool(data, held), held)
        return replace(found, setting=replace(found.setting, tool=tool)).points


def fit(
    robot: Robot,
    data: Measured,
    parameters: Sequence[str | Prior],
    *,
    model: RodModel | Literal["arc"] | None = None,
    start: Mapping[str, float] | None = None,
    rows: ArrayLike | None = None,
    loss: Loss = "soft_l1",
) -> Fit:
    """Fit parameters of a robot, its actuation and its frames to measured points.

    Parameters
    ----------
    robot : Robot
        Robot with the initial values of its file's parameters.
    data : measurements
        Rows in the order of measurement; with a memory or backlash they form one path. Rows are
        weighted by their uncertainty where it varies. A stated tool is kept unless it is fitted or
        given in `start`. All points with stations are fitted, each where it is measured, on the
        disk at its station; without stations the tip alone is.
    parameters : sequence of str or Prior
        Names of parameters, or `bowstring.Prior` of those whose values are known approximately.
        Fields of the robot file by path, with ``*`` or as a short name for one value shared by all,
        also of a list of tendons: ``segments.0.backbone.E``, ``E``,
        ``segments.*.tendons.compliance``. For all, each segment or each tendon (``gain``,
        ``gain.segments``, ``gain.tendons``, ``gain.tendons.4``): ``gain`` of displacements or
        tensions; ``offset`` of displacements, positive where a tendon is too short, or of tensions,
        if all commands are; ``backlash``, half the dead travel of a displacement. For all or each
        segment: the field ``hole_clearance`` (``hole_clearance.segments``); ``hole_angle``, an
        added angle; ``pitch_radius``, a factor; ``bend_gain`` of constant curvature. ``delay`` of
        the tip behind the commands in s. ``base``: the robot's base in the measuring frame,
        ``base.x`` to ``base.rz`` (a rotation vector). ``tool``: the last measured point, the tip,
        in the frame of its disk. ``marker.0``, ``marker.1`` and so on: the points below it in the
        frames of their disks, from base to tip, ``marker.0.x`` to ``marker.0.z``; zero by default.
        ``initial_displacement`` (of path 0, with a number that of another path;
        ``initial_displacement.0.4`` of one tendon) and ``initial_tension``: the commands at which
        the robot rested before the first row of a path, less those of the first row, for a memory
        whose state there is not known. The tension of a tendon with a displacement there is that at
        rest; creep needs it. Other tables begin in the home pose. The prior is half the range of
        the tendon's commands, unless a `Prior` has another.
    model : RodModel or "arc", optional
        Statics of `bowstring.solve`, by default with one element; or constant curvature from tendon
        lengths (from tensions where the rows have them), with segments of constant length.
    start : mapping from name to float, optional
        Initial values of fitted parameters and fixed values of others, in SI.
    rows : array_like of bool (K,), optional
        Rows to fit; the others are only steps of the path. By default all with a measured tip.
    loss : {"linear", "soft_l1", "huber"}
        Loss function; robust ones become linear beyond two standard deviations, which are
        estimated from the data.

    Returns
    -------
    Fit
        Result; check `converged`, `doubts`, `message` and `not_identifiable` first.

    Raises
    ------
    InputError
        If an argument is wrong, there are fewer measured points than parameters without a prior, or
        such a parameter has no effect.
    NoSolutionError
        If the initial model has no solution for more than half of the rows.

    Notes
    -----
    The cost is theory Eq. 7.1. Where a tendon becomes taut or slack, the cost has a kink
    and often a minimum on either side. The fit continues from a minimum to lower ones predicted by
    a piecewise linear model, in which each row is a linear complementarity problem
    (`bowstring.calibration.pieces`). Rows without an equilibrium are left out and counted.

    Standard errors are those of M-estimation, theory Eq. 7.2 (Huber, Robust Statistics,
    1981, 7.6), with any errors within a row, and independent rows. The estimates weight all points
    of a row alike. With priors they are those of the posterior, theory Eqs 7.3 to 7.5.
    """
    return fit_from([start or {}], robot, data, parameters, model=model, rows=rows, loss=loss)


def fit_from(
    starts: Sequence[Mapping[str, float]],
    robot: Robot,
    data: Measured,
    parameters: Sequence[str | Prior],
    *,
    model: RodModel | Literal["arc"] | None = None,
    rows: ArrayLike | None = None,
    loss: Loss = "soft_l1",
    near: Nearby | None = None,
) -> Fit:
    """Fit as `fit`, from the best of several starts after a rough descent from each.

    The starts have the same names, and differ in values of fitted parameters only. Some may fail,
    as a play larger than all bends has no effect; the last error is raised if all do.
    """
    start = starts[0]
    rod = checked_model(robot, model, loss)
    said = dict(zip(("tool.x", "tool.y", "tool.z"), observations.tool(data).tolist(), strict=True))
    begin = {name: value for name, value in said.items() if value} | dict(start)
    by_tension = observations.commands(data, robot).are_tensions
    unknowns = Unknowns(robot, names_of(parameters), begin, by_tension=by_tension)
    if not unknowns.items:
        raise InputError(f"parameters is empty; name one at least, as {example_path(robot)}")
    refuse_bend_gain(unknowns, rod)
    commands = observations.commands(data, unknowns.robot)
    points = observations.measured_points(data, unknowns.robot, len(commands))
    _check_markers(unknowns, points)
    _check_initial(unknowns, commands, arcs=rod is None)
    used = observations.fitted_rows(rows, points.measured)
    if rod is not None and len(commands) > _MOST_ROWS:
        raise InputError(
            f"{len(commands)} rows are too many to fit statics to, {_MOST_ROWS} are possible; keep "
            f"one row of {-(-len(commands) // _MOST_ROWS)}"
        )
    deviations = _initial_priors(unknowns, commands)
    deviations |= deviations_of(robot, parameters, by_tension=by_tension)
    frames = {k: v for k, v in begin.items() if k.partition(".")[0] in _OF_FRAMES}
    nominal = Unknowns(robot, unknowns.names, frames, by_tension=by_tension)
    free = Priors.of(unknowns, nominal, deviations).free
    count = int((used[:, None] & points.seen).sum())
    if count < free:
        what = "1 measured point is" if count == 1 else f"{count} measured points are"
        raise InputError(
            f"{what} too few for {free} parameters; measure at least as many, or fit fewer"
        )
    sigma = observations.sigmas(data, len(commands))
    group = observations.groups(data, len(commands))
    line, shared = getattr(data, "line", None), near.shared if near else None
    others = with_priors([n for n in unknowns.names if not _is_friction(n)], deviations)
    again = partial(fit, data=data, parameters=others, rows=rows, loss=loss, model=rod)
    passes: list[int] = []

    def attempt(start: Mapping[str, float]) -> tuple[Search, Any] | BowstringError:
        """Rough descent from a start."""
        own = Unknowns(robot, unknowns.names, begin | dict(start), by_tension=by_tension)
        of_points = TipModel(own, commands, rod, points.disks, shared)
        prior = Priors.of(own, nominal, deviations)
        work = Residuals(of_points, points.measured, used, sigma, prior, line)
        search = Search(work, loss, group, near)
        try:
            first = work.begin(own.start, start)
            base = np.array([name.startswith("base.") for name in own.names])
            own.start_at(np.where(base, first * work.step, own.start))  # as registered
            work.take(first)
            if rod is not None and commands.by_displacement.any() and work.has_friction(first):
                first = _from_frictionless(work, first, robot, start, again)
            work.refuse_without_effect(first)
            return search, search.begin(first)
        except BowstringError as error:
            return error
        finally:
            passes.append(of_points.solves)

    search, rough, start = _best(threads.results(attempt, starts), starts)
    search.work.model.solves = sum(passes)
    found = search.run(rough)
    own = {*unknowns.names, *start}
    tool_said = np.array([not own & {"tool", f"tool.{axis}"} for axis in "xyz"])
    part = parts(data, commands.values, used, _BLOCKS)
    given: dict[str, Any] = {"parameters": parameters, "model": model, "loss": loss}
    same = partial(fit_from, starts=[start], robot=robot, **given)
    return _result(search, found, tool_said, points, part, same)


def _best(
    tried: Sequence[tuple[Search, Any] | BowstringError], starts: Sequence[Mapping[str, float]]
) -> tuple[Search, Any, Mapping[str, float]]:
    """Search whose rough descent has the least mean square, its end and its start."""
    ends = [
        (*end, start) for end, start in zip(tried, starts, strict=True) if isinstance(end, tuple)
    ]
    if not ends:
        raise next(error for error in reversed(tried) if isinstance(error, BowstringError))
    noise = min(search.noise for search, _, _ in ends)
    return min(ends, key=lambda end: end[0].mean_square(end[1].x, noise))


def checked_model(
    robot: Robot, model: RodModel | Literal["arc"] | None, loss: Loss
) -> RodModel | None:
    """Check the robot, model and loss of a fit; model of the rod, None for constant curvature."""
    check_robot(robot)
    if isinstance(model, str) and model != "arc":
        raise InputError.of("model", shown(model), 'a bowstring.RodModel or "arc"')
    if loss not in ("linear", "soft_l1", "huber"):
        raise InputError(f'loss is {shown(loss)}, it must be "linear", "soft_l1" or "huber"')
    return None if isinstance(model, str) else as_model(model)


def refuse_bend_gain(unknowns: Unknowns, rod: RodModel | None) -> None:
    """Refuse a parameter of constant curvature for the rod."""
    if rod is not None and any(name.startswith("bend_gain") for name in unknowns.names):
        raise InputError('bend_gain belongs to constant curvature; give model="arc"')


def _check_markers(unknowns: Unknowns, points: Points) -> None:
    """Refuse the offset of a point that is not measured below the tip."""
    below = len(points.disks) - 1
    for name in unknowns.names:
        number = marker_of(name)
        if number is None or number < below:
            continue
        if points.left_out:
            why = "the points have no stations, so that the tip alone is fitted: give stations"
        elif not below:
            why = "the rows have no point below the tip; the offset of the tip is tool"
        else:
            last = f"marker.0 to marker.{below - 1}" if below > 1 else "marker.0"
            why = f"the rows have the points {last} below the tip; the offset of the tip is tool"
        raise InputError(f"parameter {name} is not identifiable: {why}", argument="parameters")


def _check_initial(unknowns: Unknowns, commands: Commands, *, arcs: bool) -> None:
    """Refuse the initial command of a path or of a kind that the rows do not have.

    And one without a memory; `arcs` is True for constant curvature.
    """
    paths = commands.paths
    for name in unknowns.names:
        initial = initial_of(name)
        if initial is None:
            continue
        path, tendon, by_displacement = initial
        unknowns.refuse_without_effect(name, arcs=arcs)
        if path >= len(paths):
            own = "path 0 only" if len(paths) == 1 else f"paths 0 to {len(paths) - 1}"
            raise InputError(
                f"parameter {name} is of path {path}; the rows have {own}", argument="parameters"
            )
        if by_displacement and not commands.by_displacement[paths[path][0], tendon]:
            raise InputError(
                f"parameter {name} has no effect: tendon {tendon} has a tension in the first row "
                f"of path {path}",
                argument="parameters",
            )
        other = name.replace("displacement", "tension")
        if by_displacement and other in unknowns.names:
            raise InputError(
                f"parameters {name} and {other} are of the same tendon; fit one of them",
                argument="parameters",
            )


def _initial_priors(unknowns: Unknowns, commands: Commands) -> dict[str, float]:
    """Prior standard deviations of initial commands: half the range of the tendon's commands.

    Without them a command is undetermined once a memory has followed it as far as it can. Where
    displacements do not tell the range of tensions, it is the tension that bends the robot by 1
    rad.
    """
    robot = unknowns.robot
    found = {}
    for name in unknowns.names:
        if initial := initial_of(name):
            path, tendon, by_displacement = initial
            rows = commands.paths[path]
            values = commands.values[rows, tendon]
            if commands.by_displacement[rows[0], tendon] and not by_displacement:
                arms = robot.tendons.arm_m
                arm = float(arms[tendon] or arms.max())
                found[name] = float(robot.bending_stiffness.min()) / (arm * robot.length)
            elif size := 0.5 * float(np.ptp(values)):
                found[name] = size
    return found


def _is_friction(name: str) -> bool:
    return name.rpartition(".")[2] == "friction"


def _from_frictionless(
    work: Residuals,
    first: Floats,
    robot: Robot,
    start: Mapping[str, float],
    again: Callable[..., Fit],
) -> Floats:
    """Initial scaled values of a fit with friction: those without friction, if better."""
    smooth = {path: 0.0 for path in work.model.unknowns.friction_paths}
    held = {k: v for k, v in start.items() if not _is_friction(k)}
    try:
        plain = again(robot.with_(smooth), start=held)
    except BowstringError:
        return first
    work.model.solves += plain.evaluations
    at = np.array([plain.values.get(item.name, np.nan) for item in work.items]) / work.step
    others_at = (first, work.low + _LITTLE)
    begins = [first, *(np.where(np.isnan(at), each, at) for each in others_at)]
    costs = [float((work.residuals(each) ** 2).sum()) for each in begins]
    return np.array(begins[int(np.argmin(costs))])


# -- results of a fit ---------------------------------------------------------------------------


def _result(
    search: Search,
    found: Any,
    tool_said: Bools,
    points: Points,
    part: Ints,
    again: Callable[..., Fit],
) -> Fit:
    work, items = search.work, search.work.items
    residuals, jacobian = work.residuals(found.x), work.jacobian(found.x)
    at = work.prediction(found.x)
    land = search.landscape(found.x)
    weighted, slope = search.force(residuals)
    errors = at.points - work.measured
    dependence = Dependence.of(errors, work.counted, search.group)
    of_priors = work.priors.jacobian(search.noise)
    known = Uncertainty.of((weighted, slope), jacobian, of_priors, search.noise, dependence)
    fitted = known.determined if len(of_priors) else len(items)
    not_identifiable = [
        tuple(items[i].name for i in np.flatnonzero(np.abs(row) >= _MEMBER * np.abs(row).max()))
        for row in known.lost
    ]
    half = known.half
    error = np.sqrt(np.diag(known.covariance))
    with np.errstate(invalid="ignore"):  # zero for parameters that are not identifiable
        correlation = known.covariance / np.outer(error, error)
    hessian = jacobian.T @ (slope[:, None] * jacobian) + of_priors.T @ of_priors
    try:
        ends = profile_ends(land, known, hessian)
        profiled: bool | None = ends is not None
    except ValueError:  # LinAlgError, and residuals that are not finite
        ends = profiled = None
    undetermined = known.undetermined
    one_sided = np.zeros(len(items), dtype=bool)
    if ends is not None:
        error = (ends[1] - ends[0]) / (2.0 * half)
        one_sided = np.isinf(ends).sum(axis=0) == 1
    # not identifiable: as wide as the allowed range
    idle = ~undetermined & ~one_sided & (error >= work.high - work.low)
    not_identifiable += [(items[i].name,) for i in np.flatnonzero(idle)]
    none = undetermined | idle
    correlation[none] = correlation[:, none] = np.nan
    error[none] = np.inf
    if ends is None:
        ends = np.array([-half * error, half * error])
    lost = work.unsolved > _MOST_LOST * work.asked.sum()
    promised = 0.0 if land is not None else search.decrease(found)
    stuck = promised > _OFFSET * len(items) * work.variance(found.cost)
    used = work.used
    scored = _score_of(errors[used])
    # a motion larger than the robot is none of the robot
    astray = scored.rmse_centred > at.setting.robot.length
    strayed = work.strayed(found.x)
    excess, excess_p = _excess(work, errors, round(fitted))
    estimates = _estimates(work, found, error, ends)
    message = _message(
        work,
        found,
        (lost, stuck, astray, strayed),
        estimates,
        not_identifiable,
        _contradicted(search, found, errors),
        profiled,
        dependence.correlation if dependence.is_significant else None,
        excess if excess > _EXCESS and excess_p < NOISE else None,
        _correlated_pair([item.name for item in items], correlation),
    )
    converged = found.status > 0 and not (lost or stuck or astray or strayed)
    doubts = () if astray else _doubts(work, found, at)
    unknowns, values = work.model.unknowns, found.x * work.step
    by_displacement = work.model.commands.are_displacements
    robot, drives = unknowns.calibrated(values, by_displacement=by_displacement)
    return Fit(
        model="arc" if work.model.rod is None else "rod",
        robot=robot,
        estimates=tuple(estimates),
        correlation=correlation,
        not_identifiable=tuple(not_identifiable),
        point_residuals=errors,
        points_before=work.before,
        used=used,
        points=_points(at.setting.robot, points.disks, errors[used], work.before[used]),
        score=_score_of(errors[used, -1]),
        score_before=_score_of(work.before[used, -1]),
        score_of_points=scored,
        score_of_points_before=_score_of(work.before[used]),
        noise=1e-3 * spread(residuals, fitted),
        excess=excess,
        autocorrelation=dependence.correlation,
        converged=converged,
        message=message + _left_out(points),
        doubts=doubts,
        evaluations=work.model.solves,
        unsolved=work.unsolved,
        # in m, including loss and weights of rows
        linear=Linear(
            by_parameter=(1e-3 * jacobian / work.weight[:, None]).reshape(-1, 3, len(items)),
            force=(1e-3 * weighted * work.weight).reshape(-1, 3),
            slope=(slope * work.weight**2).reshape(-1, 3),
            of_priors=1e-3 * of_priors,
            force_of_priors=1e-3 * work.priors.residuals(found.x, search.noise),
            row=dependence.row,
            tip=dependence.point == len(points.disks) - 1,
            block=observations.numbered(part[used]) if dependence.is_significant else None,
        ),
        drives=drives,
        again=again,
        _unknowns=unknowns,
        _commands=work.model.commands,
        _values=values,
        _rod=work.model.rod,
        _tool_said=tool_said,
    )


def _score_of(errors: Floats) -> Score:
    """Score of errors (..., 3); of NaN if all are."""
    flat = errors.reshape(-1, 3)
    if not np.isfinite(flat).all(axis=1).any():
        return Score(0, *[np.nan] * 5)
    return score_of_errors(flat)


def _points(
    robot: Robot, disks: Sequence[int], errors: Floats, before: Floats
) -> tuple[PointScore, ...]:
    """Scores of the measured points from their errors (N, M, 3) in the fitted rows."""
    stations = robot.disks.station_m / robot.length
    return tuple(
        PointScore(
            disk=disk + 1,
            station=float(stations[disk]),
            score=_score_of(errors[:, m]),
            before=_score_of(before[:, m]),
        )
        for m, disk in enumerate(disks)
    )


def _left_out(points: Points) -> str:
    """Note on points that are not fitted; empty without any."""
    if not points.left_out:
        return ""
    which = "point below the tip has" if points.left_out == 1 else "points below the tip have"
    return (
        f" The {points.left_out} {which} no station, and the tip alone is fitted: give stations "
        "to fit all points."
    )


def _estimates(work: Residuals, found: Any, error: Floats, ends: Floats) -> list[Estimate]:
    """Make estimates in usual units from scaled standard errors (P,) and intervals (2, P)."""
    estimates, priors = [], work.priors
    for i, item in enumerate(work.items):
        value = found.x[i] * item.step
        low, high = value + ends[:, i] * item.step
        cut = bool(np.isfinite(high - low) and (low < item.low or high > item.high))
        if cut:
            low, high = max(low, item.low), min(high, item.high)
        of_people = np.array([value, error[i] * item.step, low, high, item.start]) / item.per_unit
        edge = bool(found.active_mask[i] != 0)
        value, wide, low, high, start = of_people.tolist()
        one = Estimate(item.name, item.unit, value, wide, low, high, start, edge, cut)
        if priors.known[i]:
            mean, sd = np.array([priors.mean[i], priors.deviation[i]]) * item.step / item.per_unit
            one = replace(one, prior_mean=float(mean), prior_sd=float(sd))
        estimates.append(one)
    return estimates


def _correlated_pair(names: Sequence[str], correlation: Floats) -> tuple[str, ...]:
    """The two most strongly correlated parameters, unless both are of one frame; empty if none."""
    size = np.triu(np.nan_to_num(np.abs(correlation)), 1)
    frame = [n.rpartition(".")[0] if n.partition(".")[0] in _OF_FRAMES else n for n in names]
    size[np.array(frame)[:, None] == np.array(frame)] = 0.0
    i, j = divmod(int(np.argmax(size)), len(names))
    return (names[i], names[j]) if size[i, j] >= _HELD_UP else ()


def _message(
    work: Residuals,
    found: Any,
    failures: tuple[bool, bool, bool, int],
    estimates: Sequence[Estimate],
    not_identifiable: Sequence[Sequence[str]],
    contradicted: Sequence[str],
    profiled: bool | None,
    alike: float | None,
    excess: float | None,
    pair: tuple[str, ...],
) -> str:
    """Message on the end of the fit and the reliability of its numbers.

    `failures`: whether too many rows have no equilibrium, the derivatives predict a lower cost, and
    the points move farther than the robot is long; and the number of rows that have another
    equilibrium on a path from home. `contradicted`: parameters whose priors contradict the data.
    `profiled`: whether intervals are those of the profile likelihood; None if it cannot be
    followed. `alike` (autocorrelation) and `excess` are given if they are significant.
    `pair`: two correlated parameters that prevent convergence, or empty.
    """
    lost, stuck, astray, strayed = failures
    unsolved = f"{work.unsolved} of {work.asked.sum()} rows"
    if lost:
        said = [f"Not converged: {unsolved} have no equilibrium at the end."]
    elif stuck and work.refused:
        said = [
            "Not converged: the error falls towards values that the robot refuses "
            f"({work.refused}). Check the robot file, or fit other parameters."
        ]
    elif stuck and found.status > 0:
        said = [
            "Not converged: the derivatives promise a lower error, and no step has it: begin from "
            "better values, or with fewer parameters."
        ]
    elif astray:
        said = [
            "Not converged: the points move farther from those of the model than the robot is "
            "long. Check the unit of the tip's columns."
        ]
    elif strayed:
        said = [
            f"Not converged: {strayed} of {work.asked.sum()} rows have another equilibrium on a "
            "path from the home pose, or none: begin from better values."
        ]
    elif found.status > 0:
        said = ["Converged."]
    else:
        advice = "begin from better values, or with fewer parameters"
        if pair:
            advice = f"{listed(pair)} are strongly correlated; hold one of them"
        said = [f"Not converged after {found.nfev} steps: {advice}."]
    if work.unsolved and not lost:
        said.append(f"Left out, without an equilibrium: {unsolved}.")
    for names in not_identifiable:
        if len(names) == 1:
            said.append(f"{names[0]} is not identifiable from these data.")
        else:
            said.append(
                f"The data cannot separate {listed(names)}, which are correlated: hold one of them."
            )
    if contradicted:
        said.append(
            f"The data contradict the priors of {listed(contradicted)}: without priors these would "
            f"be more than {_CONFLICT:g} standard deviations from their means. The priors are too "
            "narrow, or something is missing in the model."
        )
    elif by_prior := [
        e.name for e in estimates if e.prior_sd and e.standard_error > _BY_PRIOR * e.prior_sd
    ]:
        said.append(f"Determined by their priors, not by these data: {listed(by_prior)}.")
    if profiled is None:
        said.append(
            "The profile likelihood cannot be followed to the ends of the intervals, where tendons "
            "may become slack or taut: the intervals are those of the derivatives, and can be too "
            "narrow."
        )
    elif profiled:
        said.append(
            "Tendons become slack or taut inside the intervals, or elsewhere the error is hardly "
            "larger: the rows determine the parameters badly, and the intervals are those of the "
            "profile likelihood, not symmetric."
        )
    if edge := [estimate.name for estimate in estimates if estimate.at_limit]:
        said.append(f"At the end of the allowed range: {listed(edge)}.")
    if cut := [estimate.name for estimate in estimates if estimate.cut]:
        which = "interval of {} is" if len(cut) == 1 else "intervals of {} are"
        said.append(f"The {which.format(listed(cut))} limited by the allowed range.")
    signs = [f"neighbours correlate by {alike:.2f}"] if alike is not None else []
    if excess is not None:
        signs.append(f"they are {significant(excess, 2)} times the stated uncertainty")
    if signs:
        allowed = "do not allow"
        if alike is not None:
            allowed = "allow for autocorrelated residuals, but not"
        said.append(
            f"The residuals are not noise ({listed(signs)}): something is missing in the model. "
            f"The intervals {allowed} for the resulting bias."
        )
    return " ".join(said)


def _contradicted(search: Search, found: Any, errors: Floats) -> list[str]:
    """Parameters whose priors contradict the data, by the linearised fit without priors."""
    work, priors = search.work, search.work.priors
    residuals, jacobian = work.residuals(found.x), work.jacobian(found.x)
    if not priors.known.any() or len(residuals) <= len(found.x):
        return []
    step, left = np.zeros_like(found.x), residuals
    for _ in range(_REWEIGHTINGS):
        root = np.sqrt(np.divide(search.force(left)[0], left, where=left != 0.0, out=left * 0 + 1))
        step -= np.linalg.lstsq(root[:, None] * jacobian, root * left, rcond=SAME)[0]
        left = residuals + jacobian @ step
    moved = errors.copy()
    moved[work.counted] += (1e-3 * (jacobian @ step) / work.weight).reshape(-1, 3)
    dependence = Dependence.of(moved, work.counted, search.group)
    alone = Uncertainty.of(search.force(left), jacobian, np.empty((0, len(step))), 0.0, dependence)
    variance = np.diag(alone.covariance) + priors.deviation**2
    apart = np.abs(found.x + step - priors.mean) > _CONFLICT * np.sqrt(variance)
    return [work.items[i].name for i in np.flatnonzero(apart)]


def _excess(work: Residuals, errors: Floats, parameters: int) -> tuple[float, float]:
    """Square root of the reduced chi-square of errors (K, M, 3), and its p-value."""
    free = work.count - parameters
    if work.sigma is None or free < 1:
        return math.nan, math.nan
    sigma = np.broadcast_to(work.sigma[:, None], work.seen.shape)[work.counted]
    square = float(((errors[work.counted] / sigma[:, None]) ** 2).sum())
    return math.sqrt(square / free), chi_square_p(square, free)


def _doubts(work: Residuals, found: Any, at: Prediction) -> tuple[str, ...]:
    """Reasons not to believe the result."""
    values = found.x * work.step
    beyond = work.model.unknowns.impossible(values, ~work.priors.known)
    doubts = [_rigid_offset(work, at)]
    if beyond:
        doubts.insert(
            0,
            f"Beyond what is physically possible: {listed(beyond)}. The model lacks "
            "something for which these make up, or the rows do not determine them: hold them, or "
            "give them a prior.",
        )
    return tuple(doubt for doubt in doubts if doubt)


def _rigid_offset(work: Residuals, at: Prediction) -> str:
    """Warn if a rigid motion of the base would remove most of the residuals."""
    base = {f"base.{name}" for name in ("x", "y", "z", "rx", "ry", "rz")}
    free = work.count - len(work.items) - 6
    if free < 1 or base <= {item.name for item in work.items}:
        return ""
    predicted, measured = at.points[work.counted], work.measured[work.counted]
    moved = align(predicted, measured).apply(predicted)
    before = float(((predicted - measured) ** 2).sum())
    after = float(((moved - measured) ** 2).sum())
    if before < len(measured) * EXACT**2 or after * (free + 6) > _RIGID * before * free:
        return ""
    if explained_p(before, after, 6, free) > NOISE:
        return ""
    rms = [in_mm(math.sqrt(each / len(measured))) for each in (before, after)]
    return (
        f"The residuals are mostly a rigid offset: a motion of the base would leave {rms[1]} of "
        f"their RMSE of {rms[0]}. The measuring frame is not that of the robot's base: fit the "
        "parameter base as well, or register the data; until then the other parameters make up "
        "for it and are wrong."
    )
