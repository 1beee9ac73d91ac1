"""Predictions of the models of a set, and fits of their parameters to other observables than tips.

K is the number of rows. All values are in SI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.calibration import fitting, observations
from bowstring.calibration.parameters import Setting, Unknowns
from bowstring.calibration.tip_model import rotation
from bowstring.constant_curvature import Arc, RobotArcs, fit_arcs
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import Robot
from bowstring.statics.load import Load
from bowstring.statics.rod import solve_batch, sweep
from bowstring.suite.metrics import Observable
from bowstring.suite.protocol import Model, SuiteSet, marker_disk
from bowstring.suite.tables import Table, rows_of

__all__ = ["Fitted", "arcs_of_shapes", "errors_of", "fitted", "observed"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_DIFFERENCE: Final = 1e-3  # step of differences over the natural step of a parameter


@dataclass(frozen=True)
class Fitted:
    """A model with fitted parameters, or as the robot file has it.

    Attributes
    ----------
    predict : callable
        Maps a table to predicted values of the observable (K, ...), NaN without a solution.
    values : dict
        Fitted values in SI by name.
    converged : bool
        Whether the fit converged; True without parameters.
    message : str
        Message of the fit; empty without parameters.
    """

    predict: Callable[[Table], Floats]
    values: Mapping[str, float]
    converged: bool = True
    message: str = ""


def observed(table: Table, observable: Observable) -> Floats:
    """Measured values (K, ...) of an observable.

    Parameters
    ----------
    table : Table
        Rows.
    observable : {"tip", "markers", "bend", "shape"}
        The observable.

    Returns
    -------
    ndarray (K, ...)
        Tips (K, 3) or points (K, P, 3) in m, angles (K,) in rad; shapes in the unit of the table.

    Raises
    ------
    InputError
        If the table has none.
    """
    data = table.data
    if observable == "bend":
        if data.bend is None:
            raise InputError(f"{data.name} has no bend angles; give angles in its mapping")
        return data.bend
    if observable != "shape" and data.scale is None:
        raise InputError(f"{data.name} is in pixels; only metrics of the shape have a meaning")
    return data.tip if observable == "tip" else data.points


def errors_of(predicted: Floats, measured: Floats, observable: Observable) -> Floats:
    """Errors (K, ...) of an observable: distances in m, angles in rad, or shares of the length."""
    if observable == "bend":
        return np.abs(predicted - measured)
    distance = np.asarray(np.linalg.norm(predicted - measured, axis=-1))
    if observable != "shape":
        return distance
    length = np.linalg.norm(np.diff(measured, axis=1), axis=-1).sum(axis=1)
    return np.asarray(distance / length[:, None])


def fitted(given: SuiteSet, model: Model, table: Table, rows: Bools | None = None) -> Fitted:
    """Fit the parameters of a model to rows of a table.

    Parameters
    ----------
    given : SuiteSet
        Set with the robot.
    model : Model
        Model of the set that predicts from commands.
    table : Table
        Table of training.
    rows : ndarray of bool (K,), optional
        Rows that are fitted; all by default.

    Returns
    -------
    Fitted
        The model with its fitted values; without parameters as the robot file has it.
    """
    assert given.robot is not None
    robot = given.robot.with_(model.changes) if model.changes else given.robot
    observable = next(iter(given.metrics.values())).observable
    if model.parameters and observable == "tip" and table.load is None:
        found = fitting.fit(
            robot,
            table.data,
            model.parameters,
            model=None if model.model == "rod" else "arc",
            start=model.start,
            rows=None if rows is None else rows & table.data.seen,
            loss=model.loss,
        )
        return Fitted(
            lambda other: found.predict(other.data), found.values, found.converged, found.message
        )
    return _fit(_Predictor(given, model, robot, observable), model, table, rows)


def arcs_of_shapes(table: Table, pieces: int) -> Floats:
    """Points (K, P, 3) of arcs fitted to each measured shape.

    Parameters
    ----------
    table : Table
        Table of shapes.
    pieces : int
        Number of arcs of equal length.

    Returns
    -------
    ndarray (K, P, 3)
        Points of the arcs at the same shares of the length, in the unit of the shapes.
    """
    points = table.data.points
    flat = np.ptp(points, axis=(0, 1)) == 0.0  # a camera sees a plane
    used = np.flatnonzero(~flat) if flat.sum() == 1 else np.arange(3)
    found = fit_arcs(points[:, :, used], pieces)
    out = points.copy()
    out[:, :, used] = points[:, :1, used] + found.length[:, None, None] * found.fitted
    return np.asarray(out)


# -- observables of any kind -----------------------------------------------------------------------


class _Predictor:
    """Observable of a table as a function of parameter values."""

    def __init__(self, given: SuiteSet, model: Model, robot: Robot, observable: Observable) -> None:
        if any(n.startswith("hole_clearance") for n in (*model.parameters, *model.start)):
            raise InputError(
                f"{model.name}: hole_clearance is for fits of a measured tip; leave it out"
            )
        self.model, self.observable = model, observable
        self.unknowns = Unknowns(robot, model.parameters, model.start)
        markers = given.protocol.markers
        self.disks = [marker_disk(robot, marker) for marker in markers]
        self.offsets = np.array([marker.offset for marker in markers]).reshape(-1, 3)

    def __call__(self, values: ArrayLike, table: Table) -> Floats:
        """Observable (K, ...) of parameter values (P,)."""
        setting = self.unknowns.setting(np.asarray(values, dtype=float))
        at = self._arcs if self.model.model == "constant_curvature" else self._rod
        position, turned = at(setting, table)
        if self.observable == "bend":
            tangent = turned[:, -1, :, 2]
            return np.asarray(np.arctan2(np.hypot(tangent[:, 0], tangent[:, 1]), tangent[:, 2]))
        if self.observable == "tip":
            tool = setting.tool if setting.tool.any() else table.data.tool
            local = position[:, -1] + turned[:, -1] @ tool
        else:
            local = position[:, self.disks]
            local = local + np.einsum("kpij,pj->kpi", turned[:, self.disks], self.offsets)
        return np.asarray(local @ rotation(setting.turn).T + setting.position)

    def _rod(self, setting: Setting, table: Table) -> tuple[Floats, Floats]:
        """Positions (K, N, 3) and rotations (K, N, 3, 3) of the disks by the rod."""
        commands = observations.commands(table.data, setting.robot)
        by_displacement, values = commands.by_displacement, commands.effective(setting)
        load = table.load or Load()
        if not by_displacement.all():
            tensions = np.where(by_displacement, np.nan, np.maximum(values, 0.0))
            load = replace(load, tensions=tensions)
        if by_displacement.any():
            load = replace(load, displacements=np.where(by_displacement, values, np.nan))
        if not setting.robot.has_memory:
            found = [solve_batch(setting.robot, load=load)]
            order = np.arange(len(commands))
        else:  # friction and hysteresis have a history
            found = [sweep(setting.robot, load=rows_of(load, path)) for path in commands.paths]
            order = np.argsort(np.concatenate(commands.paths))
        position, turned = (
            np.concatenate([np.asarray(getattr(each, name)) for each in found])[order]
            for name in ("disk_positions", "disk_rotations")
        )
        return position, turned

    def _arcs(self, setting: Setting, table: Table) -> tuple[Floats, Floats]:
        """The same by constant curvature."""
        robot = setting.robot
        commands = observations.commands(table.data, robot)
        by_displacement, values = commands.by_displacement, commands.effective(setting)
        if by_displacement.all():
            lengths = robot.disks.station_m[robot.tendons.end_disk] - values
            arcs = RobotArcs.from_lengths(robot, lengths, hold_length=True)
        elif not by_displacement.any():
            arcs = RobotArcs.from_tensions(robot, values)
        else:
            raise InputError("constant curvature needs all tendons by displacement or by tension")
        bent = Arc(arcs.kappa * setting.bend_gain, arcs.phi, arcs.length)
        arcs = RobotArcs(robot, bent)
        return arcs.disk_positions, arcs.disk_rotations


def _fit(predict: _Predictor, model: Model, table: Table, rows: Bools | None) -> Fitted:
    """Fit by least squares on the observable itself."""
    from scipy.optimize import least_squares

    items = predict.unknowns.items
    if not items:
        none = np.zeros(0)
        return Fitted(lambda other: predict(none, other), {})
    used = np.ones(len(table), dtype=bool) if rows is None else rows
    measured = observed(table, predict.observable)[used]
    step = np.array([item.step for item in items])
    begin = predict.unknowns.start
    # as in `bowstring.fit`, m and rad are scaled to about 1 for the tolerances
    scale = 1e-3

    first = (predict(begin, table)[used] - measured).ravel() / scale
    if not np.isfinite(first).any():
        raise NoSolutionError(f"{model.name}: no row has a solution at the initial parameters")
    lost = float(np.nanmax(np.abs(first)))  # no gain by losing equilibria

    def residuals(scaled: Floats) -> Floats:
        apart = (predict(scaled * step, table)[used] - measured).ravel() / scale
        return np.where(np.isfinite(apart), apart, lost)

    found = least_squares(
        residuals,
        begin / step,
        bounds=(
            np.array([item.low for item in items]) / step,
            np.array([item.high for item in items]) / step,
        ),
        diff_step=_DIFFERENCE,
        loss=model.loss,
    )
    values = found.x * step
    message = "Converged." if found.status > 0 else f"Not converged after {found.nfev} steps."
    return Fitted(
        lambda other: predict(values, other),
        dict(zip(predict.unknowns.names, values.tolist(), strict=True)),
        found.status > 0,
        message,
    )
