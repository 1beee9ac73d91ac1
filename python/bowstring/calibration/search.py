"""Minimisation of a fit's cost: residuals with derivatives, and search for minima.

K is the number of rows, M that of measured points in a row, n that of points that are measured in
used rows, P that of parameters, Q that of priors. Scaled parameters are SI values over their
natural steps.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring import threads
from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration.intervals import EXACT, SAME, Dependence, Uncertainty
from bowstring.calibration.pieces import Landscape, Loss, Pieces, influence, rho
from bowstring.calibration.priors import Priors
from bowstring.calibration.tip_model import Prediction, TipModel
from bowstring.data.rigid import align
from bowstring.errors import InputError, NoSolutionError

#: Residual, in standard deviations, at which a robust loss turns from quadratic to linear.
_TURN: Final = 2.0
#: Such a residual over the last one at which a fit is repeated.
_LOWER: Final = 0.8
_EVALUATIONS: Final = 50
#: Relative tolerances of the cost until the scales are known, then, and of a fit that predicts rows
#: left out: 1e-4 of the cost is far below the standard error of their errors.
_ROUGH: Final = 1e-3
_FINE: Final = 1e-6
_NEAR: Final = 1e-4
_RESCALES: Final = 10
#: Relative change of the noise below which the weight of the priors is kept.
_SAME_NOISE: Final = 0.03
#: Share of rows without an equilibrium at the start above which a fit is refused.
_MOST_LOST: Final = 0.5
#: Initial compliances where stiffer tendons have no equilibrium, m/N.
_SOFTER: Final = (1e-5, 1e-4, 1e-3)
#: Predicted decrease of the cost, in variances of a residual per parameter, below which a fit with
#: updated derivatives is not continued with new ones.
_SETTLED: Final = 0.01
#: Relative error of the predicted residuals up to which derivatives are updated.
_FORETOLD: Final = 0.2
#: Tolerance of a descent that ended although its derivatives predict a lower cost.
_TIGHT: Final = 1e-9
#: Distance of points over the robot's length from which on two equilibria are not the same.
_APART: Final = 1e-6
#: Largest number of moves to a lower minimum with other tendons taut or slack.
_PASSES: Final = 10
#: Largest number of such minima that are tried.
_TRIED: Final = 3
#: Least gain of a lower minimum: share of the cost, and of the variance of a residual.
_GAIN: Final = (1e-6, 5e-3)


def spread(residuals: Floats, parameters: float) -> float:
    """Robust standard deviation, 1.4826 times the median absolute value, for the free residuals."""
    share = max(len(residuals) - parameters, 1.0) / len(residuals)
    return float(1.4826 * np.median(np.abs(residuals)) / np.sqrt(share))


def turn_of(residuals: Floats, parameters: float, last: float) -> float:
    """Residual at which a robust loss turns linear; the last one unless it is clearly below that.

    Outliers widen it until a fit has left them.
    """
    turn = _TURN * max(spread(residuals, parameters), 1e-9)
    return turn if turn <= _LOWER * last else last


def robust(loss: Loss, turn: float, count: int) -> dict[str, Any]:
    """Options of the loss for `scipy.optimize.least_squares`, of `count` data before the priors."""
    if not np.isfinite(turn):
        return {}
    return {"loss": partial(rho, loss=loss, count=count), "f_scale": turn}


@dataclass(frozen=True)
class Nearby:
    """A fit to nearly the same rows as other fits, such as those of a cross-validation.

    The others begin at the same values; those whose first residuals are as small as its noise
    begin near their end.
    """

    noise: float
    """Its noise, m."""
    shared: dict[bytes, Prediction] = field(default_factory=dict)
    """The first prediction of all of them, see `TipModel`."""


@dataclass(frozen=True)
class _Tangent:
    """Residuals and their Jacobian at a point."""

    scaled: Floats
    residuals: Floats
    jacobian: Floats
    corrected: bool = False


class Residuals:
    """Residuals in mm as a function of scaled parameters, with a cache for derivatives.

    `measured` (K, M, 3) is NaN where a point is not measured. Rows are weighted by their
    uncertainty, relative to its median. Rows without an equilibrium at the start of a descent are
    left out (`take`); where rows lose it later, their residuals are extrapolated by the last
    derivatives.

    With friction a derivative needs a path over all rows for each parameter, and a fit that begins
    near its end hardly changes them. Later derivatives, except by parameters of frames, are then
    Broyden updates (Math. Comp. 19, 1965), until they are renewed.
    """

    def __init__(
        self,
        model: TipModel,
        measured: Floats,
        asked: Bools,
        sigma: Floats | None,
        priors: Priors,
        line: Ints | None = None,
    ) -> None:
        self.model, self.measured, self.asked, self.sigma = model, measured, asked, sigma
        self.priors = priors
        self._weights = np.ones(len(asked)) if sigma is None else np.median(sigma[asked]) / sigma
        self.used = asked
        #: Whether a point (K, M) is measured.
        self.seen: Bools = np.array(np.isfinite(measured).all(axis=2))
        self._line = line
        self.before = np.full_like(measured, np.nan)
        self.items = model.unknowns.items
        self.step = np.array([item.step for item in self.items])
        #: Limits (P,) of the scaled parameters.
        self.low = np.array([item.low for item in self.items]) / self.step
        self.high = np.array([item.high for item in self.items]) / self.step
        self._last: tuple[Floats, Prediction] | None = None
        self._tangent: _Tangent | None = None
        #: Whether derivatives that take long are updated, not renewed, after a step.
        self.corrects = True
        #: Whether the search began near its end; derivatives of all memories then take long.
        self.near_end = False
        #: Why the robot refused a step of the last descent; empty if it refused none.
        self.refused = ""

    @property
    def weight(self) -> Floats:
        """Weight of each residual (3 n,)."""
        return self.of_rows(self._weights)

    @property
    def counted(self) -> Bools:
        """Points (K, M) that are measured, of the used rows."""
        return self.used[:, None] & self.seen

    @property
    def count(self) -> int:
        """Number of residuals."""
        return 3 * int(self.counted.sum())

    def of_rows(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values (K,) of rows for each residual (3 n,)."""
        return np.repeat(np.broadcast_to(values[:, None], self.seen.shape)[self.counted], 3)

    @property
    def unsolved(self) -> int:
        """Number of rows to fit that have no equilibrium and are left out."""
        return int((self.asked & ~self.used).sum())

    def begin(self, values: Floats, start: Mapping[str, float]) -> Floats:
        """Initial scaled values from those in SI, with a registered base."""
        self._tangent = None
        low = np.array([item.low for item in self.items])
        inside = np.where(values <= low, low + 0.5 * self.step, values)
        changes = bool((inside != values).any())
        keep = self.model.rod is not None
        at = self.model.predict(values, keep=keep and not changes)
        placed = values.copy()
        self._align(placed, at, start)
        placed_at = replace(at, setting=self.model.unknowns.setting(placed))
        self.before = placed_at.points - self.measured
        if changes:
            values, at = inside, self.model.predict(inside, keep=keep)
        values, at = self._softened(values, at)
        failed = np.flatnonzero(~at.solved & self.asked)
        if failed.size > _MOST_LOST * self.asked.sum():
            k = int(failed[0])
            first = f"row {k + 1}" if self._line is None else f"in line {self._line[k]}"
            raise NoSolutionError(
                f"{self.model.unknowns.robot.name}: {failed.size} of {self.asked.sum()} rows have "
                f"no solution to begin with, the first is {first}; begin from other "
                "values, such as tendons with some compliance"
            )
        self._align(values, at, start)
        return np.asarray(values / self.step)

    def _softened(self, values: Floats, at: Prediction) -> tuple[Floats, Prediction]:
        """Initial compliances with which more rows have an equilibrium, if some have none.

        The displacements of compliant tendons hardly conflict; the fit then finds their stiffness.
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
        """Select the rows that have an equilibrium here; return whether the selection changed."""
        solved = self.prediction(scaled).solved
        used = self.asked & solved
        if 3 * (used[:, None] & self.seen).sum() < max(self.priors.free, 1):
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
        known = (self.asked & at.solved)[:, None] & self.seen
        if len(base) < 6 or any(name.startswith("base") for name in start) or not known.any():
            return
        local = at.position + at.arms
        motion = align(local[known], self.measured[known])
        values[base] = np.concatenate((motion.translation, motion.rotation_vector))

    def prediction(self, scaled: Floats) -> Prediction:
        """Predict all rows, with a cache for derivatives."""
        threads.check()
        if self._last is None or not np.array_equal(self._last[0], scaled):
            at = self.model.predict(scaled * self.step, keep=self.model.rod is not None)
            self._last = scaled.copy(), at
        return self._last[1]

    def residuals(self, scaled: Floats) -> Floats:
        """Weighted residuals (3 n,) of the used rows, mm."""
        try:
            at = self.prediction(scaled)
        except InputError as refusal:  # invalid robot
            self.refused = str(refusal).partition("\n")[0].rstrip(".")
            return np.full(self.count, 1e6)
        error = 1e3 * (at.points - self.measured)[self.counted].ravel() * self.weight
        lost = self.of_rows(~at.solved)
        if lost.any():
            tangent = self._tangent
            error[lost] = 0.0
            if tangent is not None:
                along = tangent.residuals + tangent.jacobian @ (scaled - tangent.scaled)
                error[lost] = along[lost]
        return np.asarray(error)

    def jacobian(self, scaled: Floats, renew: bool = False) -> Floats:
        """Jacobian (3 n, P); `renew` computes anew one that was updated after a step."""
        last = self._tangent
        here = last is not None and np.array_equal(last.scaled, scaled)
        if here and last is not None and not (renew and last.corrected):
            return last.jacobian
        residuals, at = self.residuals(scaled), self.prediction(scaled)
        jacobian = None
        if last is not None and not here and self.corrects and self._take_long(at):
            step = residuals - last.residuals
            missed = step - last.jacobian @ (scaled - last.scaled)
            if np.linalg.norm(missed) < _FORETOLD * np.linalg.norm(step):
                jacobian = self._corrected(last, scaled, missed, at)
        corrected = jacobian is not None
        if jacobian is None:
            jacobian = self._columns(self.model.jacobian(scaled * self.step, at))
        jacobian = np.where(np.isfinite(jacobian), jacobian, 0.0)
        lost = self.of_rows(~at.solved)
        jacobian[lost] = 0.0 if last is None else last.jacobian[lost]
        self._tangent = _Tangent(scaled.copy(), residuals, jacobian, corrected)
        return jacobian

    def _columns(self, derivatives: Floats) -> Floats:
        of_points = derivatives.reshape(*self.measured.shape, len(self.items))
        rows = of_points[self.counted].reshape(-1, len(self.items))
        return np.asarray(1e3 * rows * self.step * self.weight[:, None])

    def _corrected(self, last: _Tangent, scaled: Floats, missed: Floats, at: Prediction) -> Floats:
        """Broyden update of the last derivatives by the error (3 n,) of their prediction."""
        frames = self.model.of_frames
        jacobian = np.array(last.jacobian)
        others = np.where(frames, 0.0, scaled - last.scaled)
        if others.any():
            jacobian += np.outer(missed, others) / (others @ others)
        exact = self._columns(self.model.frame_jacobian(scaled * self.step, at))
        jacobian[:, frames] = exact[:, frames]
        return jacobian

    def variance(self, cost: float) -> float:
        """Variance of a residual, mm^2, at least that of data without noise."""
        free = max(self.count - self.priors.free, 1)
        return float(max(2.0 * cost / free, (1e3 * EXACT) ** 2))

    def strayed(self, scaled: Floats) -> int:
        """Number of used rows that have another equilibrium on a path from home, or none.

        A search starts each row from its last solution, and may stay at another equilibrium. Fits
        that share their first prediction are not tested: they begin at the end of one that is.
        """
        at, model = self.prediction(scaled), self.model
        if model.shared is not None or not at.states:
            return 0
        home = model.from_home(scaled * self.step)
        apart = np.abs(home.points - at.points).max(axis=(1, 2)) > _APART * at.setting.robot.length
        return int((apart | (home.solved != at.solved))[self.used].sum())

    def has_friction(self, scaled: Floats) -> bool:
        """Whether the robot with these parameters has friction."""
        return self.prediction(scaled).setting.robot.has_friction

    def _take_long(self, at: Prediction) -> bool:
        """Whether new derivatives take longer than the steps that they save."""
        robot = at.setting.robot
        return robot.has_friction or (self.near_end and robot.has_memory)

    def refuse_without_effect(self, scaled: Floats) -> None:
        """Raise `InputError` for a parameter without prior and without effect in the used rows."""
        size = np.linalg.norm(self.jacobian(scaled), axis=0)
        idle = (size <= 1e-9 * np.sqrt(self.count / 3)) & ~self.priors.known
        idle = np.flatnonzero(idle)
        pieces = self.pieces(scaled) if idle.size else None
        for i in idle:
            # it may have an effect once slack tendons become taut
            if pieces is None or not pieces.answers(int(i)):
                name, arcs = self.items[i].name, self.model.rod is None
                self.model.unknowns.refuse_without_effect(name, arcs=arcs)
                what = "the tip" if self.seen.shape[1] == 1 else "the measured points"
                raise InputError(
                    f"parameter {name} has no effect on {what} in these rows; leave it out"
                )

    def pieces(self, scaled: Floats) -> Pieces | None:
        """Piecewise linear model of the used rows, in scaled parameters."""
        at = self.prediction(scaled)
        pieces = self.model.pieces(scaled * self.step, at)
        if pieces is None:
            return None
        rows = at.solved & self.used
        seen = np.repeat(self.seen[rows], 3, axis=1)
        return pieces.rows(rows).seen(seen).scaled(self.step)

    def in_rows(self, scaled: Floats) -> tuple[Floats, Floats]:
        """Residuals and their weights (C K,) of the rows of `pieces`, zero where not measured."""
        rows = self.prediction(scaled).solved & self.used
        table = np.zeros(self.measured.shape)
        table[self.counted] = self.residuals(scaled).reshape(-1, 3)
        weight = np.repeat(self._weights[rows], table[0].size)
        return table[rows].ravel(), weight


class Search:
    """Search for the lowest minimum of a fit, with the scales of loss and priors.

    Residuals of the priors stand behind those of the data. A search that begins near its end takes
    the scale of the loss from its first residuals, and ends at a larger tolerance of the cost.
    """

    def __init__(
        self, work: Residuals, loss: Loss, group: NDArray[Any], near: Nearby | None = None
    ) -> None:
        self.work, self.loss, self.group, self.near = work, loss, group, near
        #: Residual at which a robust loss turns linear, mm; infinite for the quadratic loss.
        self.turn = np.inf
        #: Standard deviation of a residual by which the priors are weighted, mm.
        self.noise = 0.0
        self.options: dict[str, Any] = {}
        self._land: tuple[object, Landscape | None] | None = None

    def begin(self, first: Floats) -> Any:
        """Descend roughly, with scales of the start, which come down."""
        now = max(spread(self.work.residuals(first), 0), 1e3 * EXACT)
        if self.work.priors.known.any():
            self.noise = now
        self.work.near_end = self.near is not None and now < 1e3 * self.near.noise / _LOWER
        if self.loss != "linear" and self.work.near_end:
            self.turn = _TURN * now
        self.options = {"ftol": _ROUGH, "xtol": _FINE, "max_nfev": _EVALUATIONS}
        rough = self._descend(first)
        return self._descend(rough.x) if self.work.take(rough.x) else rough

    def mean_square(self, scaled: Floats, noise: float) -> float:
        """Mean square of the residuals of data and priors, these with a noise (mm)."""
        own = self.work.priors.residuals(scaled, noise)
        return float((np.concatenate([self.work.residuals(scaled), own]) ** 2).mean())

    def run(self, found: Any) -> Any:
        """Return the result of `scipy.optimize.least_squares` at the lowest minimum."""
        fine = {**self.options, "ftol": _NEAR if self.work.near_end else _FINE}
        if not self.work.near_end:
            found = self._settled(self._lowest(found))
        elif not self.work.has_friction(found.x):
            self.work.corrects = False  # a search that has not ended yet needs new derivatives
            self.work.jacobian(found.x, renew=True)
        for _ in range(_RESCALES):  # outliers may widen the scale at first
            if not self._rescale(found) and (self.options is fine or self._has_ended(found)):
                break
            self.options = fine
            found = self._descend(found.x)
        return self._settled(self._lowest(found))

    def _has_ended(self, found: Any) -> bool:
        """Whether a search that began near its end has ended, by new derivatives."""
        if not self.work.near_end:
            return False
        self.work.jacobian(found.x, renew=True)
        return bool(self.decrease(found) <= _NEAR * found.cost)

    def _rescale(self, found: Any) -> bool:
        """Estimate the scales of loss and priors anew; return whether they changed by much."""
        changed, determined = False, float(len(found.x))
        if self.work.priors.known.any():
            now = self.uncertainty(found.x)
            changed, determined = abs(now.noise / self.noise - 1.0) > _SAME_NOISE, now.determined
            if changed:
                self.noise = now.noise
        if self.loss != "linear":
            turn = turn_of(found.fun[: self.work.count], determined, self.turn)
            self.turn, changed = turn, changed or turn < self.turn
        return changed

    def uncertainty(self, scaled: Floats) -> Uncertainty:
        """Uncertainty of the estimates if they were these."""
        work = self.work
        errors = work.prediction(scaled).points - work.measured
        return Uncertainty.of(
            self.force(work.residuals(scaled)),
            work.jacobian(scaled),
            work.priors.jacobian(self.noise),
            self.noise,
            Dependence.of(errors, work.counted, self.group),
        )

    def force(self, residuals: Floats) -> tuple[Floats, Floats]:
        """First and second derivative of half the loss by residuals of the data."""
        return influence(residuals, self.loss, self.turn)

    def residuals(self, scaled: Floats) -> Floats:
        """Residuals of data and priors (3 n + Q,)."""
        own = self.work.priors.residuals(scaled, self.noise)
        return np.concatenate([self.work.residuals(scaled), own])

    def jacobian(self, scaled: Floats) -> Floats:
        """Jacobian (3 n + Q, P) of the residuals."""
        return np.concatenate([self.work.jacobian(scaled), self.work.priors.jacobian(self.noise)])

    def landscape(self, scaled: Floats) -> Landscape | None:
        """Piecewise model of the cost near a point; None if no tendon can become taut or slack."""
        work = self.work
        key = scaled.tobytes(), work.used.tobytes(), self.turn, self.noise
        if self._land is None or self._land[0] != key:
            land, pieces = None, work.pieces(scaled)
            if pieces is not None:
                residuals, weight = work.in_rows(scaled)
                own = work.priors.residuals(scaled, self.noise)
                land = Landscape(
                    pieces,
                    np.concatenate([residuals, own]),
                    1e3 * weight,
                    work.low - scaled,
                    work.high - scaled,
                    work.priors.jacobian(self.noise),
                    robust(self.loss, self.turn, len(residuals)),
                )
            self._land = key, land
        return self._land[1]

    def decrease(self, found: Any) -> float:
        """Decrease of the cost that one more Gauss-Newton step predicts."""
        free = np.asarray(found.active_mask) == 0
        if not free.any():
            return 0.0
        by, slope = self.force(self.work.residuals(found.x))
        own = self.work.priors.residuals(found.x, self.noise)
        by, slope = np.concatenate([by, own]), np.concatenate([slope, np.ones_like(own)])
        jacobian = self.jacobian(found.x)[:, free]
        root = np.sqrt(np.maximum(slope, 1e-12))
        step = np.linalg.lstsq(root[:, None] * jacobian, by / root, rcond=SAME)[0]
        return float(0.5 * (jacobian @ step) @ by)

    def _clearly_below(self, cost: float) -> float:
        """Cost below which a minimum counts as lower."""
        if self.work.near_end:
            return cost - _NEAR * cost
        return cost - max(_GAIN[0] * cost, _GAIN[1] * self.work.variance(cost))

    def _descend(self, begin: Floats) -> Any:
        from scipy.optimize import least_squares

        self.work.refused = ""
        low, high = self.work.low, self.work.high
        return least_squares(
            self.residuals,
            np.clip(begin, np.nextafter(low, high), np.nextafter(high, low)),
            jac=self.jacobian,  # a new array each time: SciPy 1.11 overwrites it
            bounds=(low, high),
            x_scale="jac",
            gtol=1e-10,
            **self.options,
            **robust(self.loss, self.turn, self.work.count),
        )

    def _lowest(self, found: Any) -> Any:
        """Continue from a minimum to lower ones with other tendons taut or slack."""
        for _ in range(_PASSES):
            land, lower = self.landscape(found.x), self._clearly_below(found.cost)
            minima = [] if land is None else [each for each in land.minima if each.cost < lower]
            ends = (self._descend(found.x + each.change) for each in minima[:_TRIED])
            better = next((end for end in ends if end.cost < lower), None)
            if better is None:
                break
            found = better
        return found

    def _settled(self, found: Any) -> Any:
        """Continue while rows gain or lose their equilibrium, or new derivatives lower the cost."""
        options = self.options
        for _ in range(_PASSES):
            if self.work.take(found.x):
                found = self._descend(found.x)
                continue
            if not self.work.has_friction(found.x):
                break
            self.work.jacobian(found.x, renew=True)
            least = _SETTLED * len(found.x) * self.work.variance(found.cost)
            if self.decrease(found) <= least or self._has_ended(found):
                break
            better = self._descend(found.x)
            stuck = better.cost > self._clearly_below(found.cost)
            found = better if better.cost < found.cost else found
            if stuck and self.options["xtol"] > _TIGHT:
                self.options = {**self.options, "ftol": _TIGHT, "xtol": _TIGHT}
            elif stuck and self.work.corrects:
                self.work.corrects = False  # updates are too inaccurate here
            elif stuck:
                break
        self.work.take(found.x)
        self.options = options
        return found
