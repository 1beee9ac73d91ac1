"""Fit of parameters to measured orientations of the tip.

An inertial sensor or a bend sensor measures no position. The errors are angles: between the
measured and the predicted direction of the tip, or of the bend angle alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.calibration import observations
from bowstring.calibration.fitting import Estimate, checked_model, refuse_bend_gain
from bowstring.calibration.intervals import Dependence, Uncertainty
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.pieces import Loss, influence
from bowstring.calibration.search import robust, turn_of
from bowstring.calibration.tip_model import TipModel, rotation
from bowstring.errors import InputError, NoSolutionError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics.model import RodModel

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements

_SMALL: Final = 1e-6  # of a parameter's step
_SMALL_BY_STATICS: Final = 1e-3  # the equilibrium is less exact than an arc
_NO_EFFECT: Final = 1e-9  # rad per step of a parameter


@dataclass(frozen=True)
class AngleScore(Result):
    """Angles between predicted and measured directions of the tip, or errors of bend angles."""

    rmse: Annotated[float, Key("rmse_deg")]
    """Root mean square, rad."""
    mean: Annotated[float, Key("mean_deg")]
    """Mean, rad."""
    largest: Annotated[float, Key("max_deg")]
    """Largest, rad."""

    @classmethod
    def of(cls, size: Floats) -> AngleScore:
        """Score of absolute errors (K,), rad."""
        return cls(float(np.sqrt((size**2).mean())), float(size.mean()), float(size.max()))


@dataclass(frozen=True, eq=False)
class OrientationFit(Result):
    """Result of `fit_orientation`."""

    model: Annotated[Literal["rod", "arc"], Key()]
    """Fitted model: statics of the rod, or constant curvature."""
    estimates: Annotated[tuple[Estimate, ...], Key("parameters")]
    """Fitted parameters."""
    rows: Annotated[int, Key()]
    """Number of rows with an equilibrium, which are fitted."""
    score: Annotated[AngleScore, Key()]
    """Errors after the fit."""
    score_before: Annotated[AngleScore, Key()]
    """Errors before the fit."""
    noise: Annotated[float, Key("noise_deg")]
    """Scatter of a residual about the fit, rad."""
    converged: Annotated[bool, Key()]
    """Whether the fit converged."""
    robot: Robot
    """Calibrated robot."""
    tip_direction: Floats
    """Predicted direction of the tip (K, 3) in the base frame, a unit vector; NaN without an
    equilibrium."""
    turn: Floats
    """Rotation vector (3,) of the base in the measuring frame, rad."""


def fit_orientation(
    robot: Robot,
    data: Measurements,
    parameters: Sequence[str],
    *,
    model: RodModel | Literal["arc"] | None = None,
    start: Mapping[str, float] | None = None,
    loss: Loss = "soft_l1",
) -> OrientationFit:
    """Fit parameters to measured bend angles and directions of the tip.

    Parameters
    ----------
    robot : Robot
        Robot with the initial values of its file's parameters.
    data : Measurements
        Measurements with bend angles, and their directions or not; all rows are fitted.
    parameters : sequence of str
        Names of parameters as in `bowstring.calibration.fit`, such as ``bend_gain``.
    model : RodModel or "arc", optional
        Statics of `bowstring.solve`, by default with one element; or constant curvature.
    start : mapping from name to float, optional
        Initial values of fitted parameters and fixed values of others, in SI.
    loss : {"linear", "soft_l1", "huber"}
        Loss function; robust ones become linear beyond two standard deviations.

    Returns
    -------
    OrientationFit
        Estimates with 95 % intervals, and errors as angles.

    Raises
    ------
    InputError
        If an argument is wrong, or the angles do not determine a parameter.
    NoSolutionError
        If the initial model has no solution for more than half of the rows.

    Notes
    -----
    Standard errors are those of `fit`, theory Eq. 7.2. The residuals of a row are the errors along
    the bend, and perpendicular to it where the direction is measured.
    """
    from scipy.optimize import least_squares

    rod = checked_model(robot, model, loss)
    if data.bend is None:
        raise InputError(f"{data.name} has no bend angles; give angles in its mapping")
    commands = observations.commands(data, robot)
    unknowns = Unknowns(robot, parameters, start, by_tension=commands.are_tensions)
    items = unknowns.items
    if not items:
        raise InputError("parameters is empty; name one at least, as bend_gain")
    refuse_bend_gain(unknowns, rod)
    for name in unknowns.names:
        unknowns.refuse_without_effect(name, arcs=rod is None)
    of_tips = TipModel(unknowns, commands, rod)
    step = np.array([item.step for item in items])
    bounds = np.array([[item.low, item.high] for item in items]).T / step
    bend, direction = data.bend, data.direction

    small = _SMALL if rod is None else _SMALL_BY_STATICS

    def errors(scaled: Floats) -> Floats:
        """Residuals (K, D), rad."""
        at = of_tips.predict(scaled * step)
        predicted = at.rotation[:, -1, :, 2] @ rotation(at.setting.turn).T
        return angle_errors(predicted, bend, direction)[solved]

    def residuals(scaled: Floats) -> Floats:
        found = errors(scaled).ravel()
        # a row without an equilibrium counts as half a turn, so that steps avoid it
        return np.where(np.isnan(found), np.pi, found)

    def jacobian(scaled: Floats) -> Floats:
        columns = []
        for i in range(len(scaled)):
            ends = [np.clip(scaled[i] + side * small, *bounds[:, i]) for side in (-1, 1)]
            low, high = (residuals(np.where(np.arange(len(scaled)) == i, e, scaled)) for e in ends)
            columns.append((high - low) / (ends[1] - ends[0]))
        return np.stack(columns, axis=1)

    first = np.array([item.start for item in items]) / step
    solved: Bools = np.ones(len(data), bool)
    solved = np.asarray(np.isfinite(errors(first)).all(axis=1))
    if solved.mean() < 0.5:
        raise NoSolutionError(
            f"{robot.name}: {int((~solved).sum())} of {len(data)} rows have no equilibrium at the "
            "initial values"
        )
    before = errors(first)
    free = before.size - len(items)
    if free < 1:
        raise InputError(
            f"{before.size} measured angles are too few for {len(items)} parameters; measure more, "
            "or fit fewer"
        )
    effect = np.abs(jacobian(first)).max(axis=0)
    if (effect < _NO_EFFECT).any():
        name = unknowns.names[int(np.argmin(effect))]
        raise InputError(
            f"parameter {name} has no effect on the orientation of the tip; leave it out, or "
            "measure tips",
            argument="parameters",
        )
    solve = partial(least_squares, residuals, jac=jacobian, bounds=bounds, x_scale="jac")
    found, turn = solve(first), np.inf
    left = found.fun
    while loss != "linear":
        parts = left.reshape(before.shape).T  # a sensor that bends in one plane has no second one
        lower = max(turn_of(each, len(items) / len(parts), turn) for each in parts)
        if lower == turn:
            break
        turn = lower
        found = solve(found.x, **robust(loss, turn, left.size))
        left = residuals(found.x)
    force, curvature = influence(left, loss, turn)
    table = np.full((len(data), 1, before.shape[1]), np.nan)
    table[solved, 0] = left.reshape(before.shape)
    dependence = Dependence.of(table, solved[:, None], observations.groups(data, len(data)))
    none = np.empty((0, len(items)))
    known = Uncertainty.of((force, curvature), jacobian(found.x), none, 0.0, dependence)
    if len(known.lost):
        raise InputError(
            f"the angles cannot separate {', '.join(unknowns.names)}; fit fewer of them",
            argument="parameters",
        )
    error = np.sqrt(np.diag(known.covariance))
    half = known.half * error
    values = found.x * step
    at = of_tips.predict(values)
    estimates = []
    for i, item in enumerate(items):
        ends = found.x[i], error[i], found.x[i] - half[i], found.x[i] + half[i], first[i]
        value, wide, low, high, begin = (float(v) * item.step / item.per_unit for v in ends)
        edge = bool(found.active_mask[i])
        estimates.append(Estimate(item.name, item.unit, value, wide, low, high, begin, edge))
    return OrientationFit(
        "arc" if rod is None else "rod",
        tuple(estimates),
        int(solved.sum()),
        AngleScore.of(np.linalg.norm(errors(found.x), axis=1)),
        AngleScore.of(np.linalg.norm(before, axis=1)),
        float(np.sqrt((force**2).sum() / free) / curvature.mean()),
        found.status > 0,
        unknowns.calibrated(values, by_displacement=commands.are_displacements)[0],
        at.rotation[:, -1, :, 2],
        at.setting.turn,
    )


def angle_errors(predicted: Floats, bend: Floats, direction: Floats | None) -> Floats:
    """Errors (K, D) of predicted directions (K, 3): along the bend, and perpendicular to it."""
    x, y, z = predicted.T
    if direction is None:  # a bend angle alone has no sign
        return np.asarray(np.arctan2(np.hypot(x, y), z) - np.arccos(np.cos(bend)))[:, None]
    c, s = np.cos(direction), np.sin(direction)
    along = x * c + y * s
    by_bend = along * np.cos(bend) - z * np.sin(bend)
    across = y * c - x * s
    size = np.hypot(by_bend, across)
    angle = np.arctan2(size, along * np.sin(bend) + z * np.cos(bend))
    scale = np.where(size > 0, angle / np.where(size > 0, size, 1.0), 1.0)
    return np.stack([scale * by_bend, scale * across], axis=1)
