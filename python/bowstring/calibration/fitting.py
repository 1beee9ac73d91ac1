"""Calibration: the parameters of a robot, its drive and its frames from measurements.

Robust nonlinear least squares (scipy) on the measured tip, with what the data say of each
parameter and what they do not. Inside all is SI; K is the number of rows, P that of parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring import formatting
from bowstring.calibration import observations
from bowstring.calibration.bootstrap import Linear
from bowstring.calibration.observations import Measured, Score, score
from bowstring.calibration.parameters import Unknown, Unknowns
from bowstring.calibration.pieces import Landscape, Minimum, Pieces
from bowstring.calibration.residual_tests import autocorrelation
from bowstring.calibration.tip_model import Prediction, TipModel
from bowstring.data.rigid import align
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.formatting import plain
from bowstring.robot.model import Robot, check_robot
from bowstring.significance import NOISE, chi_square_p, explained_p
from bowstring.statics.model import RodModel, as_model
from bowstring.validation import is_whole, shown

__all__ = [
    "CrossValidation",
    "Estimate",
    "Fit",
    "Loss",
    "cross_validate",
    "fit",
    "hold_out",
]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Loss = Literal["linear", "soft_l1", "huber"]

#: A robust loss turns from squares to absolute values at so many standard deviations.
_TURN: Final = 2.0
#: Directions of the scaled parameters that move the tip by less than this share are not told apart.
_SAME: Final = 1e-5
#: Members of such a direction are those with at least this share of it.
_MEMBER: Final = 0.1
#: Residuals that are so many times the stated uncertainty are more than that, if not by chance.
_EXCESS: Final = 1.5
#: Neighbours that correlate by so much err alike, if not by chance.
_ALIKE: Final = 0.3
#: Residuals of data without noise, m: no device measures so well.
_EXACT: Final = 1e-8
#: Rows of statics that a fit takes; each holds its solution and derivatives, up to 0.25 MB.
_MOST_ROWS: Final = 10_000
_EVALUATIONS: Final = 100
_RESCALES: Final = 10
#: Rows without an equilibrium, as a share: at the start to refuse, and at the end to distrust.
_MOST_LOST_AT_START: Final = 0.5
_MOST_LOST: Final = 0.05
#: Compliances that a fit begins from where stiffer tendons have no equilibrium, m/N.
_SOFTER: Final = (1e-5, 1e-4, 1e-3)
#: Variances of a residual, for each parameter, by which one more step may promise to lower the
#: cost of a fit that has converged (Bates and Watts, Technometrics 23, 1981).
_OFFSET: Final = 0.5
#: The same, at which a fit with friction is not continued by new derivatives.
_SETTLED: Final = 0.01
#: Share of a step's change of the residuals that derivatives with friction may miss and be kept.
_FORETOLD: Final = 0.2
#: Tolerance of a descent that ended although its derivatives promise more.
_TIGHT: Final = 1e-9
#: A friction to begin with, in natural steps, where it begins from none.
_LITTLE: Final = 0.2
#: Share of the squares that a rigid motion leaves, below which residuals are mostly one.
_RIGID: Final = 0.25
#: Times that a fit goes on from a minimum beyond a tendon that becomes taut or slack.
_PASSES: Final = 10
#: Such minima that are tried before a fit stays where it is.
_TRIED: Final = 3
#: What a lower minimum gains at least: share of the cost, and of the variance of a residual.
_GAIN: Final = (1e-6, 5e-3)
#: Increase of the cost at the edge of an interval, over that by the derivatives, that is usual.
_REGULAR: Final = (0.6, 1.7)
#: Size of a fit times parameters up to which irregular intervals are profiled.
_LARGE: Final = 300_000
#: Minima from which a profile begins.
_STARTS: Final = 4


@dataclass(frozen=True)
class Estimate:
    """What the data say of one parameter, in the unit that people use for it.

    Attributes
    ----------
    name, unit : str
    value, standard_error, low, high : float
        The last two bound the 95 % interval; infinite where the data cannot tell. Where tendons
        become slack or taut inside it, it is that of the profile likelihood, and the standard error
        a part of its width.
    start : float
    at_limit : bool
    cut : bool
        Whether the interval would go beyond what the parameter may be, and ends there.
    """

    name: str
    unit: str
    value: float
    standard_error: float
    low: float
    high: float
    start: float
    at_limit: bool
    cut: bool = False

    def __str__(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if not np.isfinite(self.standard_error):
            return f"{self.name} = {self.value:.5g}{unit} (not determined)"
        return f"{self.name} = {formatting.with_error(self.value, self.standard_error)}{unit}"


@dataclass(frozen=True, eq=False)
class Fit:
    """Calibrated parameters; made by `fit`.

    Attributes
    ----------
    model : {"rod", "arc"}
    robot : Robot
        With the calibrated numbers of the robot file, and the holes as fitted.
    estimates : tuple of Estimate
    correlation : ndarray (P, P)
        Of the estimates; NaN for those that the data cannot tell.
    confused : tuple of tuples of str
        Parameters that the data cannot tell apart; a tuple of one names one they say nothing of:
        its standard error is as wide as all that it may be, or infinite.
    residuals : ndarray (K, 3)
        Predicted less measured, m, of all rows; NaN where there is no measurement.
    used : ndarray of bool (K,)
        Rows that were fitted: those asked for that have an equilibrium.
    before : ndarray (K, 3)
        The same before the fit, where the parameters begin; a base that is fitted whole is already
        put where it fits best.
    score, score_before : Score
        Of the fitted rows.
    noise : float
        Robust standard deviation of a coordinate, m: 1.48 times the median of its error's size, so
        that rows that err by far more than most hardly count.
    excess : float
        Residuals over what the stated uncertainties let expect, root mean square: about 1 if the
        model lacks nothing. NaN where none are stated.
    autocorrelation : float
        Of the residuals of neighbouring rows in a group; above 0.3, and by more than chance, they
        are not noise, and intervals and correlations allow for rows that err alike. NaN with too
        few rows.
    converged : bool
    message : str
    evaluations : int
        Passes over all rows.
    unsolved : int
        Rows that should have been fitted and have no equilibrium; they are left out of `used`.
    linear : Linear
        The fit near its end, for `bowstring.calibration.bootstrap.refitted`.
    """

    model: Literal["rod", "arc"]
    robot: Robot
    estimates: tuple[Estimate, ...]
    correlation: Floats
    confused: tuple[tuple[str, ...], ...]
    residuals: Floats
    before: Floats
    used: Bools
    score: Score
    score_before: Score
    noise: float
    excess: float
    autocorrelation: float
    converged: bool
    message: str
    evaluations: int
    unsolved: int
    linear: Linear
    _unknowns: Unknowns
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
        return [estimate.name for estimate in self.estimates]

    @property
    def values(self) -> dict[str, float]:
        """The estimates in SI by name, as ``start`` of another fit takes them."""
        return dict(zip(self.names, self._values.tolist(), strict=True))

    def predict(self, data: Measured) -> Floats:
        """The measured point (K, 3) in m by the calibrated model, without any further alignment.

        Parameters
        ----------
        data : measurements
            Of which the commands (and the time, for a delay) are used, and the tool, where it was
            the fitted measurements that said it. With friction or backlash the rows are one path.

        Returns
        -------
        ndarray (K, 3)
            NaN where the model has no answer.
        """
        commands = observations.commands(data, self._unknowns.robot)
        model = TipModel(self._unknowns, commands, self._rod)
        found = model.predict(self._values)
        tool = np.where(
            self._tool_said, observations.tool(data, found.setting.tool), found.setting.tool
        )
        return replace(found, setting=replace(found.setting, tool=tool)).point

    def to_dict(self) -> dict[str, Any]:
        """All numbers of the fit, ready for `json.dumps`; None where there is no number."""
        from dataclasses import asdict

        return {
            "model": self.model,
            "converged": self.converged,
            "message": self.message,
            "parameters": plain([asdict(e) for e in self.estimates]),
            "correlation": plain(self.correlation),
            "cannot_tell_apart": [list(names) for names in self.confused],
            "rows": int(self.used.sum()),
            "rows_without_equilibrium": self.unsolved,
            "rmse_mm": 1e3 * self.score.rmse,
            "mean_mm": 1e3 * self.score.mean,
            "max_mm": 1e3 * self.score.largest,
            "rmse_centred_mm": 1e3 * self.score.rmse_centred,
            "mean_centred_mm": 1e3 * self.score.mean_centred,
            "rmse_before_mm": 1e3 * self.score_before.rmse,
            "mean_before_mm": 1e3 * self.score_before.mean,
            "noise_mm": 1e3 * self.noise,
            "residuals_over_stated_uncertainty": plain(self.excess),
            "autocorrelation": plain(self.autocorrelation),
            "evaluations": self.evaluations,
        }


@short_repr
@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Errors on rows that were left out; made by `cross_validate`.

    Attributes
    ----------
    folds : tuple of Score
        Each of the rows left out, by a fit to the others.
    labels : tuple of str
        What each fold left out.
    score : Score
        Of all rows, each predicted by the fit that had not seen it.
    residuals : ndarray (K, 3)
        NaN where there is no measurement, or the model has no answer.
    unanswered : int
        Rows left out to which the model has no answer; they are in no score.
    converged : bool
        Whether all fits did.
    """

    folds: tuple[Score, ...]
    labels: tuple[str, ...]
    score: Score
    residuals: Floats
    unanswered: int
    converged: bool


def fit(
    robot: Robot,
    data: Measured,
    parameters: Sequence[str],
    *,
    model: RodModel | Literal["arc"] | None = None,
    start: Mapping[str, float] | None = None,
    rows: ArrayLike | None = None,
    loss: Loss = "soft_l1",
) -> Fit:
    """Fit parameters of a robot, its drive and its frames to measured tips.

    Parameters
    ----------
    robot : Robot
        Where the numbers of the robot file begin.
    data : measurements
        Rows in the order in which they were taken: with friction or backlash they are one path.
        Where they state an uncertainty that differs from row to row, rows count by it; where they
        say where the tool is, it is held there unless it is fitted or `start` says otherwise.
    parameters : sequence of str
        Numbers of the robot file by path, ``*`` for one number shared by all:
        ``segments.0.backbone.E``, ``segments.*.tendons.compliance``. Further, for all, each
        segment or each tendon (``gain``, ``gain.segments``, ``gain.tendons``,
        ``gain.tendons.4``): ``gain`` of pulls or tensions; ``offset`` of pulls, positive where a
        tendon is shorter than it should be; ``backlash``, half the dead travel of a pull; for all
        or each segment: ``hole_angle``, turned by, ``pitch_radius``, times, ``bend_gain`` of
        constant curvature. ``delay`` of the tip behind the commands in s. ``base``: the robot's
        base in the measuring frame, ``base.x`` to ``base.rz`` (a rotation vector). ``tool``: the
        measured point in the frame of the end disk.
    model : RodModel or "arc", optional
        Of the statics of `bowstring.solve`, with one element if it does not say how many; or
        constant curvature from tendon lengths (from force where the rows have tensions), segments
        keeping their lengths.
    start : mapping from name to float, optional
        SI; where parameters begin, and what others are held at.
    rows : array_like of bool (K,), optional
        Rows to fit; the others only lead the path. All with a measured tip if left out.
    loss : {"linear", "soft_l1", "huber"}
        Robust losses turn at two standard deviations, found by the data.

    Returns
    -------
    Fit
        Look at `converged`, `message` and `confused` before its numbers.

    Raises
    ------
    InputError
        If an argument is wrong, there are fewer measured points than parameters, or a parameter
        has no effect.
    NoSolutionError
        If the model has no answer to more than half of the rows to begin with.

    Notes
    -----
    Where a tendon becomes taut or slack the error has a kink, and often a minimum on either side.
    A fit goes on from a minimum to lower ones that a model of its surroundings promises, in which
    each row is a linear complementarity problem (`bowstring.calibration.pieces`). Rows without
    an equilibrium are left out and counted.

    Standard errors are those of M-estimation (Huber, Robust Statistics, 1981, 7.6): they take the
    residuals for independent noise, as large in all rows (or as stated), and along each axis of the
    measuring frame as large as it is there.
    """
    check_robot(robot)
    if isinstance(model, str) and model != "arc":
        raise InputError.of("model", shown(model), 'a bowstring.RodModel or "arc"')
    rod = None if isinstance(model, str) else as_model(model)
    if loss not in ("linear", "soft_l1", "huber"):
        raise InputError(f'loss is {shown(loss)}, it must be "linear", "soft_l1" or "huber"')
    said = dict(zip(("tool.x", "tool.y", "tool.z"), observations.tool(data).tolist(), strict=True))
    begin = {name: value for name, value in said.items() if value} | dict(start or {})
    unknowns = Unknowns(robot, parameters, begin)
    if not unknowns.items:
        raise InputError("parameters is empty; name one at least, as segments.0.backbone.E")
    if rod is not None and any(name.startswith("bend_gain") for name in unknowns.names):
        raise InputError('bend_gain is of constant curvature; give model="arc"')
    commands = observations.commands(data, unknowns.robot)
    measured = observations.tips(data, len(commands))
    used = observations.fitted_rows(rows, measured)
    if rod is not None and len(commands) > _MOST_ROWS:
        raise InputError(
            f"{len(commands)} rows are too many to fit statics to, {_MOST_ROWS} are possible; keep "
            f"one row of {-(-len(commands) // _MOST_ROWS)}"
        )
    count = int(used.sum())
    if count < len(unknowns.items):
        what = "1 measured point is" if count == 1 else f"{count} measured points are"
        raise InputError(
            f"{what} too few for {len(unknowns.items)} parameters; measure at least as many, or "
            "fit fewer"
        )
    if any(name == "delay" for name in unknowns.names):
        commands.clock()
    sigma = observations.sigmas(data, len(commands))
    work = _Work(TipModel(unknowns, commands, rod), measured, used, sigma)
    first = work.begin(start or {})
    work.take(first)
    if rod is not None and commands.pulled.any() and work.has_friction(first):
        options: dict[str, Any] = {"rows": rows, "loss": loss, "model": rod}
        first = _from_frictionless(work, first, robot, data, parameters, start, options)
    work.refuse_without_effect(first)
    search = _Search(work, loss)
    found = search.run(first)
    own = {*unknowns.names, *(start or {})}
    tool_said = np.array([not own & {"tool", f"tool.{axis}"} for axis in "xyz"])
    group = observations.groups(data, len(commands))
    return _result(search, found, group, tool_said)


def _from_frictionless(
    work: _Work,
    first: Floats,
    robot: Robot,
    data: Measured,
    parameters: Sequence[str],
    start: Mapping[str, float] | None,
    options: Mapping[str, Any],
) -> Floats:
    """Scaled values to begin a fit with friction: those without it, where they are better."""
    smooth = {path: 0.0 for path in work.model.unknowns.friction_paths}
    others = [name for name in work.model.unknowns.names if not name.endswith(".friction")]
    held = {k: v for k, v in (start or {}).items() if not k.endswith(".friction")}
    try:
        plain = fit(robot.with_(smooth), data, others, start=held, **options)
    except BowstringError:
        return first
    work.model.solves += plain.evaluations
    at = np.array([plain.values.get(item.name, np.nan) for item in work.items]) / work.step
    least = np.array([item.low for item in work.items]) / work.step + _LITTLE
    begins = [first, np.where(np.isnan(at), first, at), np.where(np.isnan(at), least, at)]
    costs = [float((work.residuals(each) ** 2).sum()) for each in begins]
    return np.array(begins[int(np.argmin(costs))])


class _Search:
    """The search for the lowest minimum of a fit; made once for it."""

    def __init__(self, work: _Work, loss: Loss) -> None:
        self.work, self.loss = work, loss
        #: Residual at which a robust loss turns, mm.
        self.turn = np.inf
        self.low = np.array([item.low for item in work.items]) / work.step
        self.high = np.array([item.high for item in work.items]) / work.step
        self.options: dict[str, Any] = {}
        self._land: tuple[Floats, dict[str, Any], Landscape | None] | None = None

    def run(self, first: Floats) -> Any:
        """The result of `scipy.optimize.least_squares` at the lowest minimum."""
        fine: dict[str, Any] = {"ftol": 1e-6, "xtol": 1e-6, "max_nfev": _EVALUATIONS}
        self.options = dict(fine)
        if self.loss == "linear":
            return self._settled(self._lowest(self._descend(first)))
        self.options.update(ftol=1e-3, xtol=1e-3, max_nfev=_EVALUATIONS // 2)
        found = self._settled(self._lowest(self._descend(first)))
        for _ in range(_RESCALES):  # outliers that drew the fit hide in a spread too wide
            spread = _TURN * max(_spread(found.fun, len(first)), 1e-9)
            if spread > 0.8 * self.turn:
                break
            self.turn = spread
            self.options = {**fine, "max_nfev": _EVALUATIONS // 2}
            self.options.update(loss=self.loss, f_scale=self.turn)
            found = self._descend(found.x)
        return self._settled(self._lowest(found))

    def landscape(self, scaled: Floats) -> Landscape | None:
        """The cost near a point as far as tendons become taut or slack; None without these."""
        last = self._land
        if last is None or not np.array_equal(last[0], scaled) or last[1] != self.options:
            land = self.work.landscape(scaled, self.low, self.high, self.options)
            last = self._land = scaled.copy(), dict(self.options), land
        return last[2]

    def decrease(self, found: Any) -> float:
        """Decrease of the cost that a step from a minimum promises."""
        free = np.asarray(found.active_mask) == 0
        return self.work.decrease(found.x, free, self.loss, self.turn) if free.any() else 0.0

    def _descend(self, begin: Floats) -> Any:
        from scipy.optimize import least_squares

        inside = np.clip(
            begin, np.nextafter(self.low, self.high), np.nextafter(self.high, self.low)
        )
        return least_squares(
            self.work.residuals,
            inside,
            # SciPy 1.11 writes the weights of a robust loss into the array that it gets
            jac=lambda scaled: self.work.jacobian(scaled).copy(),
            bounds=(self.low, self.high),
            x_scale="jac",
            gtol=1e-10,
            **self.options,
        )

    def _lowest(self, found: Any) -> Any:
        """Go on from a minimum to lower ones where other tendons are taut or slack."""
        for _ in range(_PASSES):
            land = self.landscape(found.x)
            if land is None:
                break
            lower = found.cost - self.work.gain(found.cost)
            better = None
            for each in [each for each in land.minima if each.cost < lower][:_TRIED]:
                other = self._descend(found.x + each.change)
                if other.cost < lower:
                    better = other
                    break
            if better is None:
                break
            found = better
        return found

    def _settled(self, found: Any) -> Any:
        """Go on while rows find or lose their equilibrium, or new derivatives lead farther."""
        options = dict(self.options)
        for _ in range(_PASSES):
            others = self.work.take(found.x)
            if others:
                found = self._descend(found.x)
                continue
            if not self.work.has_friction(found.x):
                break
            self.work.renew(found.x)
            if self.decrease(found) <= _SETTLED * len(found.x) * self.work.variance(found.cost):
                break
            better = self._descend(found.x)
            stuck = better.cost > found.cost - self.work.gain(found.cost)
            found = better if better.cost < found.cost else found
            if stuck and self.options["xtol"] > _TIGHT:
                self.options.update(ftol=_TIGHT, xtol=_TIGHT)
            elif stuck and self.work.corrects:
                self.work.corrects = False  # what steps tell is too little here
            elif stuck:
                break
        self.work.take(found.x)
        self.options = options
        return found


@dataclass(frozen=True)
class _Tangent:
    """Residuals and their derivatives at a point."""

    scaled: Floats
    residuals: Floats
    jacobian: Floats
    corrected: bool = False


class _Work:
    """The residuals in mm of scaled parameters, with the last answer kept for its derivatives.

    Rows count by their uncertainty, the median of which counts once. Rows without an equilibrium
    where a descent begins are left out of it (`take`); of those that lose it on the way the
    residuals go on along their last derivatives.

    With friction a derivative costs a path over all rows for each parameter. After the first ones,
    those that are no frame's are corrected by what each step changed (Broyden, Math. Comp. 19,
    1965), until `renew` asks for new ones.
    """

    def __init__(
        self, model: TipModel, measured: Floats, asked: Bools, sigma: Floats | None
    ) -> None:
        self.model, self.measured, self.asked, self.sigma = model, measured, asked, sigma
        self._weights = np.ones(len(asked)) if sigma is None else np.median(sigma[asked]) / sigma
        self.used = asked
        self.before = np.full_like(measured, np.nan)
        self.items = model.unknowns.items
        self.step = np.array([item.step for item in self.items])
        self._last: tuple[Floats, Prediction] | None = None
        self._tangent: _Tangent | None = None
        self._fresh = False
        #: Whether derivatives with friction are corrected, not renewed, after a step.
        self.corrects = True

    @property
    def weight(self) -> Floats:
        """Of each residual (3 n,)."""
        return np.repeat(self._weights[self.used], 3)

    @property
    def unsolved(self) -> int:
        """Rows to fit that have no equilibrium and are left out."""
        return int((self.asked & ~self.used).sum())

    def begin(self, start: Mapping[str, float]) -> Floats:
        """Scaled values to begin with, the base put where it fits best."""
        values = self.model.unknowns.start.copy()
        at = self.model.predict(values)
        placed = values.copy()
        self._align(placed, at, start)
        self.before = replace(at, setting=self.model.unknowns.setting(placed)).point - self.measured
        inside = values.copy()
        for i, item in enumerate(self.items):
            if item.low > -np.inf and values[i] <= item.low:
                inside[i] = item.low + 0.5 * item.step
        if (inside != values).any():
            values, at = inside, self.model.predict(inside)
        values, at = self._softened(values, at)
        failed = np.flatnonzero(~at.solved & self.asked)
        if failed.size > _MOST_LOST_AT_START * self.asked.sum():
            raise NoSolutionError(
                f"{self.model.unknowns.robot.name}: {failed.size} of {self.asked.sum()} rows have "
                f"no solution to begin with, the first is row {failed[0]}; begin from other "
                "values, such as tendons with some compliance"
            )
        self._align(values, at, start)
        return np.asarray(values / self.step)

    def _softened(self, values: Floats, at: Prediction) -> tuple[Floats, Prediction]:
        """Compliances to begin with at which more rows have an equilibrium, where some have none.

        Tendons that give way hardly fight, and the fit makes them as stiff as they are.
        """
        soft = np.array([item.leaf == "compliance" for item in self.items])
        for least in _SOFTER if soft.any() else ():
            lost = int((~at.solved & self.asked).sum())
            if not lost:
                break
            tried = np.where(soft, np.maximum(values, least), values)
            found = self.model.predict(tried)
            if (~found.solved & self.asked).sum() < lost:
                values, at = tried, found
        return values, at

    def take(self, scaled: Floats) -> bool:
        """Descend with the rows that have an equilibrium here; whether these are others."""
        solved = self._at(scaled).solved
        used = self.asked & solved
        if 3 * used.sum() < len(self.items):
            raise NoSolutionError(
                f"{self.model.unknowns.robot.name}: {int((self.asked & ~solved).sum())} of "
                f"{self.asked.sum()} rows have no solution, too many for "
                f"{len(self.items)} parameters; begin from other values, such as tendons with "
                "some compliance"
            )
        changed = bool((used != self.used).any())
        self.used = used
        if changed:
            self._tangent = None
        return changed

    def _align(self, values: Floats, at: Prediction, start: Mapping[str, float]) -> None:
        base = [i for i, item in enumerate(self.items) if item.name.startswith("base.")]
        known = self.asked & at.solved
        if len(base) < 6 or any(name.startswith("base") for name in start) or not known.any():
            return
        local = at.position + at.rotation @ at.setting.tool
        motion = align(local[known], self.measured[known])
        values[base] = np.concatenate((motion.translation, motion.rotation_vector))

    def _at(self, scaled: Floats) -> Prediction:
        if self._last is None or not np.array_equal(self._last[0], scaled):
            at = self.model.predict(scaled * self.step, keep=self.model.rod is not None)
            self._last = scaled.copy(), at
        return self._last[1]

    def residuals(self, scaled: Floats) -> Floats:
        try:
            at = self._at(scaled)
        except InputError:  # no robot has these numbers
            return np.full(3 * int(self.used.sum()), 1e6)
        error = 1e3 * (at.point - self.measured)[self.used].ravel() * self.weight
        lost = np.repeat(~at.solved[self.used], 3)
        if lost.any():
            tangent = self._tangent
            error[lost] = 0.0
            if tangent is not None:
                along = tangent.residuals + tangent.jacobian @ (scaled - tangent.scaled)
                error[lost] = along[lost]
        return np.asarray(error)

    def jacobian(self, scaled: Floats) -> Floats:
        last = self._tangent
        if last is not None and np.array_equal(last.scaled, scaled):
            return last.jacobian
        residuals = self.residuals(scaled)
        at = self._at(scaled)
        corrected = False
        if at.setting.robot.has_friction and last is not None and self.corrects:
            step = residuals - last.residuals
            missed = step - last.jacobian @ (scaled - last.scaled)
            # where the last ones foretold the step
            corrected = not self._fresh and bool(
                np.linalg.norm(missed) < _FORETOLD * np.linalg.norm(step)
            )
        if corrected:
            assert last is not None
            jacobian = self._corrected(last, scaled, residuals, at)
        else:
            jacobian = self._columns(self.model.jacobian(scaled * self.step, at))
        self._fresh = False
        jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
        lost = np.repeat(~at.solved[self.used], 3)
        jacobian[lost] = 0.0 if last is None else last.jacobian[lost]
        self._tangent = _Tangent(scaled.copy(), residuals, jacobian, corrected)
        return jacobian

    def renew(self, scaled: Floats) -> Floats:
        """Derivatives by differences, whatever the steps so far have told."""
        last = self._tangent
        if last is not None and last.corrected and np.array_equal(last.scaled, scaled):
            self._tangent = replace(last, scaled=last.scaled + np.nan)
            self._fresh = True
        return self.jacobian(scaled)

    def _columns(self, derivatives: Floats) -> Floats:
        rows = derivatives[self.used].reshape(-1, len(self.items))
        return np.asarray(1e3 * rows * self.step * self.weight[:, None])

    def _corrected(
        self, last: _Tangent, scaled: Floats, residuals: Floats, at: Prediction
    ) -> Floats:
        frames = self.model.of_frames
        jacobian = np.array(last.jacobian)
        step = scaled - last.scaled
        rest = residuals - last.residuals - jacobian @ step
        others = np.where(frames, 0.0, step)
        if others.any():
            jacobian = jacobian + np.outer(rest, others) / (others @ others)
        if frames.any():
            exact = self._columns(self.model.frame_jacobian(scaled * self.step, at))
            jacobian[:, frames] = exact[:, frames]
        return jacobian

    def decrease(self, scaled: Floats, free: Bools, loss: str, turn: float) -> float:
        """Decrease of the cost that one more step of Gauss and Newton promises."""
        residuals, jacobian = self.residuals(scaled), self.jacobian(scaled)[:, free]
        force, slope = _pull(residuals, loss, turn)
        root = np.sqrt(np.maximum(slope, 1e-12))
        step = np.linalg.lstsq(root[:, None] * jacobian, force / root, rcond=_SAME)[0]
        return float(0.5 * (jacobian @ step) @ force)

    def gain(self, cost: float) -> float:
        """Decrease of a cost that counts."""
        return max(_GAIN[0] * cost, _GAIN[1] * self.variance(cost))

    def variance(self, cost: float) -> float:
        """Of a residual, mm^2, not below that of data without noise."""
        free = max(3 * int(self.used.sum()) - len(self.items), 1)
        return float(max(2.0 * cost / free, (1e3 * _EXACT) ** 2))

    def landscape(
        self, scaled: Floats, low: Floats, high: Floats, options: Mapping[str, Any]
    ) -> Landscape | None:
        """The cost nearby, beyond tendons that become taut or slack; None where there is none."""
        pieces = self._pieces(scaled)
        if pieces is None:
            return None
        residuals = self.residuals(scaled)
        count = np.repeat(self._at(scaled).solved[self.used], 3)
        return Landscape(
            pieces,
            residuals[count],
            1e3 * self.weight[count],
            low - scaled,
            high - scaled,
            {key: value for key, value in options.items() if key in ("loss", "f_scale")},
        )

    def has_friction(self, scaled: Floats) -> bool:
        return self._at(scaled).setting.robot.has_friction

    def refuse_without_effect(self, scaled: Floats) -> None:
        size = np.linalg.norm(self.jacobian(scaled), axis=0)
        idle = np.flatnonzero(size <= 1e-9 * np.sqrt(self.used.sum()))
        pieces = self._pieces(scaled) if idle.size else None
        for i in idle:
            # it may have one as soon as slack tendons are taut
            if pieces is None or not pieces.answers(int(i)):
                raise InputError(
                    f"parameter {self.items[i].name} has no effect on the tip in these rows; "
                    "leave it out"
                )

    def _pieces(self, scaled: Floats) -> Pieces | None:
        """The piecewise linear model of the rows that count, by scaled parameters."""
        at = self._at(scaled)
        pieces = self.model.pieces(scaled * self.step, at)
        return None if pieces is None else pieces.rows(at.solved & self.used).scaled(self.step)


# --------------------------------------------------------------------------------------
# Statistics
# --------------------------------------------------------------------------------------


def _spread(residuals: Floats, parameters: int) -> float:
    """Robust standard deviation: 1.4826 times the median absolute value, for the free ones."""
    share = max(len(residuals) - parameters, 1) / len(residuals)
    return float(1.4826 * np.median(np.abs(residuals)) / np.sqrt(share))


def _pull(residuals: Floats, loss: str, turn: float) -> tuple[Floats, Floats]:
    """Derivative of half the loss by each residual, and its own derivative."""
    if loss == "linear":
        return residuals, np.ones_like(residuals)
    z = (residuals / turn) ** 2
    if loss == "soft_l1":
        return residuals / np.sqrt(1 + z), (1 + z) ** -1.5
    inside = z <= 1
    return np.where(inside, residuals, turn * np.sign(residuals)), inside.astype(float)


def _covariance(
    residuals: Floats,
    rows: Floats,
    told: Floats,
    loss: str,
    turn: float,
    run: NDArray[np.int64],
    reach: int,
) -> tuple[Floats, float]:
    """Covariance (P, P) of the estimates, and half an interval of 95 % over the standard error.

    Noise may differ from axis to axis. `rows` (3 n, P) is the derivative, `told` (R, P) are the
    directions that the data tell. With a `reach`, rows of one `run` (n,) less than so many apart
    may err alike (Newey and West, Econometrica 55, 1987; the interval by Kiefer and Vogelsang,
    Econometric Theory 21, 2005).
    """
    from scipy.special import stdtrit

    force, slope = _pull(residuals, loss, turn)
    by = (rows @ told.T).reshape(-1, 3, len(told))
    count, parameters = len(by), len(told)
    square = np.einsum("kap,kaq->apq", by, by)
    mean = slope.reshape(-1, 3).mean(axis=0)
    inverse = np.linalg.inv(np.tensordot(mean, square, 1))
    taken = mean * np.einsum("apq,qp->a", square, inverse)  # of each axis' rows, by the parameters
    free = np.maximum(count - taken, 1.0)
    spread = (force.reshape(-1, 3) ** 2).sum(axis=0) / free
    correction = 1 + parameters / len(slope) * float(slope.var()) / float(slope.mean()) ** 2
    if reach:
        of_row = np.einsum("kap,ka->kp", by, force.reshape(-1, 3))
        scatter = of_row.T @ of_row
        for apart in range(1, reach):
            one_run = run[apart:] == run[:-apart]
            both = of_row[apart:][one_run].T @ of_row[:-apart][one_run]
            scatter += (1 - apart / reach) * (both + both.T)
        scatter *= count / float(free.min())
        half = float(np.polyval([-0.5324, 0.4160, 2.9694, 1.9600], reach / count))
    else:
        scatter = np.tensordot(spread, square, 1)
        half = float(stdtrit(free.min(), 0.975))
    back = told.T @ inverse
    return correction**2 * back @ scatter @ back.T, half


def _reach(correlation: float, count: int) -> int:
    """Rows over which neighbours that correlate so are summed (Andrews, Econometrica 59, 1991)."""
    square = min(correlation, 0.97) ** 2
    alpha = 4.0 * square / (1.0 - square) ** 2
    return min(math.ceil(1.1447 * math.pow(alpha * count, 1.0 / 3.0)), count // 2)


def _linear(work: _Work, residuals: Floats, jacobian: Floats, loss: str, turn: float) -> Linear:
    """The fit near its end, in m and scaled parameters; loss and weights of rows in it."""
    force, slope = _pull(residuals, loss, turn)
    weight = work.weight[:, None]
    return Linear(
        by_parameter=(1e-3 * jacobian / weight).reshape(-1, 3, len(work.items)),
        force=(1e-3 * force * work.weight).reshape(-1, 3),
        slope=(slope * work.weight**2).reshape(-1, 3),
    )


def _result(search: _Search, found: Any, group: NDArray[Any], tool_said: Bools) -> Fit:
    work, loss, turn = search.work, search.loss, search.turn
    items = work.items
    residuals = work.residuals(found.x)
    jacobian = work.jacobian(found.x)
    at = work._at(found.x)
    land = search.landscape(found.x)
    size = np.linalg.norm(jacobian, axis=0)
    size[size == 0] = 1.0
    _, singular, direction = np.linalg.svd(jacobian / size, full_matrices=False)
    told = singular > _SAME * singular[0]
    confused = tuple(
        tuple(items[i].name for i in np.flatnonzero(np.abs(row) >= _MEMBER * np.abs(row).max()))
        for row in direction[~told]
    )
    errors = at.point - work.measured
    alike, run = _alike(errors, work.used, group)
    reach = _reach(alike[0], len(run)) if _is_alike(alike) else 0
    covariance, half = _covariance(
        residuals, jacobian / size, direction[told], loss, turn, run, reach
    )
    covariance = covariance / np.outer(size, size)
    error = np.sqrt(np.diag(covariance))
    reaches, across = _reaches(land, covariance, half, jacobian, _pull(residuals, loss, turn)[1])
    error = np.where(across, (reaches[1] - reaches[0]) / (2.0 * half), error)
    untold = (np.abs(direction[~told]) >= 1e-3).any(axis=0) if (~told).any() else error < 0
    deviation = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(deviation, deviation)
    correlation[untold] = np.nan
    correlation[:, untold] = np.nan
    lowest, highest = np.array([(item.low, item.high) for item in items]).T
    # as wide as all that it may be
    one_sided = across & (np.isinf(reaches).sum(axis=0) == 1)
    idle = ~untold & ~one_sided & (error * work.step >= highest - lowest)
    correlation[idle] = np.nan
    correlation[:, idle] = np.nan
    confused = (*confused, *((items[i].name,) for i in np.flatnonzero(idle)))
    error[untold | idle] = np.inf
    values = found.x * work.step
    limit = np.asarray(found.active_mask) != 0
    estimates = tuple(
        Estimate(
            name=item.name,
            unit=item.unit,
            value=value / item.per_unit,
            standard_error=wide / item.per_unit,
            **_interval(item, value, *_ends(half * wide, ends * item.step, among)),
            start=item.start / item.per_unit,
            at_limit=bool(edge),
        )
        for item, value, wide, edge, ends, among in zip(
            items,
            values.tolist(),
            (error * work.step).tolist(),
            limit,
            reaches.T,
            across,
            strict=True,
        )
    )
    lost = work.unsolved > _MOST_LOST * work.asked.sum()
    promised = 0.0 if land is not None else search.decrease(found)
    stuck = promised > _OFFSET * len(items) * work.variance(found.cost)
    scored = score(errors[work.used], np.zeros_like(errors[work.used]))
    # a motion that is larger than the robot is not of it
    astray = scored.rmse_centred > at.setting.robot.length
    converged = found.status > 0 and not (lost or stuck or astray)
    excess, excess_chance = _excess(errors, work.used, work.sigma, len(items))
    return Fit(
        model="arc" if work.model.rod is None else "rod",
        robot=at.setting.robot,
        estimates=estimates,
        correlation=correlation,
        confused=confused,
        residuals=errors,
        before=work.before,
        used=work.used,
        score=scored,
        score_before=_score_before(work),
        noise=1e-3 * _spread(residuals, len(items)),
        excess=excess,
        autocorrelation=alike[0],
        converged=converged,
        message=_message(
            found,
            estimates,
            confused,
            stuck,
            astray,
            bool(across.any()),
            (work.unsolved, int(work.asked.sum()), lost),
            alike,
            (excess, excess_chance),
        )
        + ("" if astray else _rigid_offset(work, at)),
        evaluations=work.model.solves,
        unsolved=work.unsolved,
        _unknowns=work.model.unknowns,
        _values=values,
        linear=_linear(work, residuals, jacobian, loss, turn),
        _rod=work.model.rod,
        _tool_said=tool_said,
    )


def _reaches(
    land: Landscape | None, covariance: Floats, half: float, jacobian: Floats, slope: Floats
) -> tuple[Floats, Bools]:
    """Ends (2, P) of profile likelihood intervals, and which (P,) the derivatives do not give.

    Where tendons become taut or slack inside an interval, or another minimum is hardly higher,
    the derivatives at the minimum say too little. Half the decrease of the loss that bounds the
    profile is that by which the interval of the derivatives alone would be met.
    """
    parameters = len(covariance)
    none = np.full((2, parameters), np.nan), np.zeros(parameters, dtype=bool)
    if land is None or np.abs(land.residuals).max() < 1e3 * _EXACT:
        return none
    hessian = jacobian.T @ (slope[:, None] * jacobian)
    bread = np.diag(np.linalg.pinv(hessian, hermitian=True))
    spread = np.diag(covariance)
    least = land.cost(np.zeros(parameters))
    allowed = 0.5 * half**2 * float(np.median(spread / np.maximum(bread, 1e-300)))
    size, axes = np.linalg.eigh(covariance / np.sqrt(np.outer(spread, spread)))
    regular = True
    for length, axis in zip(np.sqrt(np.maximum(size, 0.0)), axes.T, strict=True):
        for sign in (half, -half):
            change = sign * length * axis * np.sqrt(spread)
            if (change < land.low).any() or (change > land.high).any():
                continue
            asked = 0.5 * float(change @ hessian @ change)
            regular &= _REGULAR[0] * asked < land.cost(change) - least < _REGULAR[1] * asked
    minima = [each for each in land.minima if each.cost < least + allowed]
    width = half * np.sqrt(spread)
    for each in minima:
        regular &= bool((np.abs(each.change) <= width).all())
    if regular or land.size * parameters > _LARGE:
        return none
    starts = [Minimum(np.zeros(parameters), least)]
    for each in minima:
        if all((np.abs(each.change - other.change) > 0.1 * width).any() for other in starts):
            starts.append(each)
    reaches = np.array(
        [
            [
                land.reach(i, sign, float(width[i]), least + allowed, starts[:_STARTS])
                for i in range(parameters)
            ]
            for sign in (-1.0, 1.0)
        ]
    )
    return reaches, np.ones(parameters, dtype=bool)


def _ends(half: float, reach: Floats, among: bool) -> tuple[float, float]:
    """How far an interval goes below and above the value."""
    return (-float(reach[0]), float(reach[1])) if among else (half, half)


def _interval(item: Unknown, value: float, below: float, above: float) -> dict[str, Any]:
    """Bounds of a parameter's interval in people's unit, and whether its limits cut it."""
    low, high = value - below, value + above
    cut = bool(np.isfinite(above + below)) and (low < item.low or high > item.high)
    if cut:
        low, high = max(low, item.low), min(high, item.high)
    return {"low": low / item.per_unit, "high": high / item.per_unit, "cut": cut}


def _message(
    found: Any,
    estimates: Sequence[Estimate],
    confused: Sequence[Sequence[str]],
    stuck: bool,
    astray: bool,
    across: bool,
    unsolved: tuple[int, int, bool],
    alike: tuple[float, float],
    excess: tuple[float, float],
) -> str:
    """How the fit ended and what its numbers are worth; the last two with their chance.

    `unsolved` counts rows without an equilibrium, all rows, and says whether these are too many.
    """
    count, rows, many = unsolved
    if many:
        said = [f"Not converged: {count} of {rows} rows have no equilibrium at the end."]
    elif stuck:
        said = [
            "Not converged: the derivatives promise a lower error, and no step has it: begin from "
            "better values, or with fewer parameters."
        ]
    elif astray:
        said = [
            "Not converged: the points move farther from those of the model than the robot is "
            "long. Check the unit of the tip's columns."
        ]
    elif found.status > 0:
        said = ["Converged."]
    else:
        said = [
            f"Not converged after {found.nfev} steps: begin from better values, or with fewer "
            "parameters."
        ]
    if count and not many:
        said.append(f"Left out, without an equilibrium: {count} of {rows} rows.")
    for names in confused:
        if len(names) == 1:
            said.append(f"The data say nothing of {names[0]}.")
        else:
            said.append(f"The data cannot tell {formatting.listed(list(names))} apart: hold one.")
    if across:
        said.append(
            "Tendons become slack or taut inside the intervals, or elsewhere the error is hardly "
            "larger: the rows determine the parameters badly, and the intervals are those of the "
            "profile likelihood, not symmetric."
        )
    edge = [estimate.name for estimate in estimates if estimate.at_limit]
    if edge:
        said.append(f"At the limit of what it may be: {formatting.listed(edge)}.")
    cut = [estimate.name for estimate in estimates if estimate.cut]
    if cut:
        said.append(f"Cut at what it may be: the interval of {formatting.listed(cut)}.")
    signs = []
    if _is_alike(alike):
        signs.append(f"neighbours correlate by {alike[0]:.2f}")
    if excess[0] > _EXCESS and excess[1] < NOISE:
        signs.append(
            f"they are {formatting.significant(excess[0], 2)} times the stated uncertainty"
        )
    if signs:
        said.append(
            f"The residuals are not noise ({formatting.listed(signs)}): something is missing in "
            "the model. The intervals "
            + ("allow for neighbours that err alike, but " if _is_alike(alike) else "")
            + "do not know how far that moves the parameters."
        )
    return " ".join(said)


def _alike(
    errors: Floats, used: Bools, group: NDArray[Any]
) -> tuple[tuple[float, float], NDArray[np.int64]]:
    """Autocorrelation of neighbouring rows of a group, and the chance of it from noise.

    Also the run (n,) of each row that is used: neighbours of a group are of one run.
    """
    at = np.flatnonzero(used)
    near = (np.diff(at) == 1) & (group[at[1:]] == group[at[:-1]])
    run = np.concatenate([[0], np.cumsum(~near)])
    if np.abs(errors[at]).max() < _EXACT:
        return (math.nan, math.nan), run
    return autocorrelation(errors[at], near), run


def _is_alike(alike: tuple[float, float]) -> bool:
    """Whether neighbours err more alike than noise does."""
    return alike[0] > _ALIKE and alike[1] < NOISE


def _excess(
    errors: Floats, used: Bools, sigma: Floats | None, parameters: int
) -> tuple[float, float]:
    """Root of the reduced chi squared, and the chance of one as large from noise."""
    free = 3 * int(used.sum()) - parameters
    if sigma is None or free < 1:
        return float("nan"), float("nan")
    square = float(((errors[used] / sigma[used, None]) ** 2).sum())
    return float(np.sqrt(square / free)), chi_square_p(square, free)


def _rigid_offset(work: _Work, at: Prediction) -> str:
    """A sentence where a rigid motion of the base would take most of the residuals away."""
    base = {f"base.{name}" for name in ("x", "y", "z", "rx", "ry", "rz")}
    free = 3 * int(work.used.sum()) - len(work.items) - 6
    if free < 1 or base <= {item.name for item in work.items}:
        return ""
    predicted, measured = at.point[work.used], work.measured[work.used]
    moved = align(predicted, measured).apply(predicted)
    before = float(((predicted - measured) ** 2).sum())
    after = float(((moved - measured) ** 2).sum())
    if before < len(measured) * _EXACT**2 or after * (free + 6) > _RIGID * before * free:
        return ""
    if explained_p(before, after, 6, free) > NOISE:
        return ""
    rms = [formatting.in_mm(math.sqrt(each / len(measured))) for each in (before, after)]
    return (
        f" The residuals are mostly a rigid offset: a motion of the base would leave {rms[1]} of "
        f"their RMSE of {rms[0]}. The measuring frame is not that of the robot's base: fit the "
        "parameter base as well, or register the data; until then the other parameters make up "
        "for it and are wrong."
    )


def _score_before(work: _Work) -> Score:
    known = work.before[work.used & np.isfinite(work.before).all(axis=1)]
    return score(known, np.zeros_like(known)) if len(known) else Score(0, *[np.nan] * 5)


# --------------------------------------------------------------------------------------
# Validation
# --------------------------------------------------------------------------------------


def cross_validate(
    robot: Robot,
    data: Measured,
    parameters: Sequence[str],
    *,
    folds: int = 5,
    model: RodModel | Literal["arc"] | None = None,
    start: Mapping[str, float] | None = None,
    rows: ArrayLike | None = None,
    loss: Loss = "soft_l1",
) -> CrossValidation:
    """Fit without a part of the rows and predict that part, for each part.

    Parts are blocks of neighbouring rows that never split a group: neighbours are alike, and
    single rows left out would be predicted by the rows beside them. Where loads come again, in
    repeats or, without groups, on the way back, a part has neighbouring loads with all their rows:
    else each row left out would be predicted by its twin.

    Parameters
    ----------
    robot, data, parameters, model, start, rows, loss
        As for `fit`.
    folds : int
        Number of parts.

    Returns
    -------
    CrossValidation
    """
    if not is_whole(folds) or folds < 2:
        raise InputError(f"folds is {shown(folds)}, it must be a whole number from 2")
    commands = observations.commands(data, robot)
    measured = observations.tips(data, len(commands))
    used = observations.fitted_rows(rows, measured)
    group = observations.groups(data, len(commands))
    load = observations.loads(commands.values)
    if observations.come_again(load[used]) and not _grouped_alone(data, group):
        group = np.array([f"load {number}" for number in (1 + load).tolist()])
    part = _blocks(group, used, int(folds))
    predicted = np.full_like(measured, np.nan)
    scores, labels, converged = [], [], True
    for k in range(int(folds)):
        out = used & (part == k)
        found = fit(
            robot,
            data,
            parameters,
            model=model,
            start=start,
            rows=used & ~out,
            loss=loss,
        )
        predicted[out] = found.predict(data)[out]
        scores.append(score(predicted[out], measured[out]))
        names = list(dict.fromkeys(group[out].tolist()))
        rows_of = 1 + np.flatnonzero(out)
        if len(names) > 1:
            labels.append(f"{names[0]} to {names[-1]}")
        elif not (group[used & ~out] == names[0]).any():
            labels.append(names[0])
        else:
            labels.append(f"rows {rows_of[0]} to {rows_of[-1]}")
        converged &= found.converged
    return CrossValidation(
        folds=tuple(scores),
        labels=tuple(labels),
        score=score(predicted[used], measured[used]),
        residuals=predicted - measured,
        unanswered=int(np.isnan(predicted[used]).any(axis=1).sum()),
        converged=converged,
    )


def hold_out(robot: Robot, data: Measured, share: float) -> Bools:
    """The last rows, for a check of a fit to the others by `Fit.predict`.

    Parameters
    ----------
    robot, data
        As for `fit`.
    share : float
        Of the rows with a measured tip, about: a run of a group is not split.

    Returns
    -------
    ndarray of bool (K,)
    """
    if not 0 < share < 1:
        raise InputError(f"share is {shown(share)}, it must lie between 0 and 1")
    count = len(observations.commands(data, robot))
    seen = np.isfinite(observations.tips(data, count)).all(axis=1)
    group = observations.groups(data, count)[seen]
    order = np.cumsum(seen)
    # the end of a run nearest to the share, so that something is left on either side
    ends = 1 + np.flatnonzero(group[1:] != group[:-1])
    if not len(ends):
        ends = np.arange(1, len(group))
    if not len(ends):
        raise InputError(f"{len(group)} rows with a measured tip are too few to hold any out")
    last = ends[np.argmin(np.abs(ends - (1 - share) * len(group)))]
    out: Bools = seen & (order > last)
    return out


def _grouped_alone(data: Measured, group: NDArray[Any]) -> bool:
    """Whether rows are in groups, and not because they are repeated."""
    repeat = getattr(data, "repeat", None)
    return len(np.unique(group)) > 1 and (repeat is None or len(np.unique(repeat)) < 2)


def _blocks(group: NDArray[Any], used: Bools, folds: int) -> NDArray[np.int64]:
    """Part (K,) of each row: neighbouring groups together, about as many rows in each part."""
    names = list(dict.fromkeys(group.tolist()))
    if len(names) == 1:
        order = np.cumsum(used) - 1
        return np.array(np.minimum(order * folds // max(int(used.sum()), 1), folds - 1))
    if len(names) < folds:
        raise InputError(
            f"folds is {folds}, there are only {len(names)} groups or loads to leave out"
        )
    counts = np.array([(used & (group == name)).sum() for name in names])
    middle = np.cumsum(counts) - counts / 2
    of_name = np.minimum((middle * folds / counts.sum()).astype(int), folds - 1)
    index = {name: int(k) for name, k in zip(names, of_name, strict=True)}
    part = np.array([index[name] for name in group.tolist()])
    if len(set(of_name.tolist())) < folds:
        raise InputError(
            f"folds is {folds}, but the groups or loads are too unequal for so many parts; take "
            "fewer"
        )
    return part
