"""Predictions of the models of a set, and fits of their parameters.

Tips and markers are fitted by `bowstring.fit`. Bends, and rows with loads of their own, are fitted
here by least squares on these.

K is the number of rows. All values are in SI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Bools, Floats
from bowstring.calibration import fitting, observations
from bowstring.calibration.filtering import filtered, fit_slow_bias
from bowstring.calibration.fitting import Fit
from bowstring.calibration.observations import Measured
from bowstring.calibration.parameters import Setting, Unknowns
from bowstring.calibration.residual import fit_residual
from bowstring.calibration.tip_model import Commands, Prediction, TipModel
from bowstring.constant_curvature import fit_arcs
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import Robot
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.statics.rod import solve_batch, sweep
from bowstring.suite.metrics import Observable
from bowstring.suite.protocol import Model, SuiteSet, marker_disk
from bowstring.suite.tables import Table, rows_of

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
    markers = _Markers.of(given, robot)
    if model.parameters and observable in ("tip", "markers") and table.load is None:
        data = markers.placed(table)
        measured = np.isfinite(data.points).all(axis=2).any(axis=1)
        found = fitting.fit(
            robot,
            data,
            model.parameters,
            model=None if model.model == "rod" else "arc",
            start={**markers.offsets, **model.start},
            rows=None if rows is None else rows & measured,
            loss=model.loss,
        )

        def alone(other: Table) -> Floats:
            points = found.predict_points(markers.placed(other))
            return points if observable == "markers" else points[:, -1]

        predict = _corrected(model, found, table) if model.correction else alone
        return Fitted(predict, found.values, found.converged, found.whole_message)
    return _fit(_Predictor(model, robot, markers, observable), model, table, rows)


def _corrected(model: Model, found: Fit, table: Table) -> Callable[[Table], Floats]:
    """Tips of a table by a fitted model and its correction, learnt from the rows of training."""
    if model.correction == "residual":
        learnt = fit_residual(found, table.data)
        return lambda other: learnt.correct(other.data).point
    bias = fit_slow_bias(found, table.data)
    return lambda other: filtered(found, other.data, bias).point


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
    flat = np.ptp(points, axis=(0, 1)) == 0.0  # shapes of a camera are plane
    used = np.flatnonzero(~flat) if flat.sum() == 1 else np.arange(3)
    found = fit_arcs(points[:, :, used], pieces)
    out = points.copy()
    out[:, :, used] = points[:, :1, used] + found.length[:, None, None] * found.fitted
    return np.asarray(out)


# -- observables of any kind -----------------------------------------------------------------------


@dataclass(frozen=True)
class _Markers:
    """Disks of the markers of a set, and their offsets; none without markers.

    Attributes
    ----------
    disks : tuple of int
        Disk of each marker, from 0.
    stations : ndarray (M,)
        Arc lengths of these disks as shares of the length.
    offsets : dict
        Offsets of the markers below the tip, as parameters of `bowstring.fit`.
    tool : ndarray (3,) or None
        Offset of the last marker, m.
    """

    disks: tuple[int, ...]
    stations: Floats
    offsets: Mapping[str, float]
    tool: Floats | None

    @classmethod
    def of(cls, given: SuiteSet, robot: Robot) -> _Markers:
        """Markers of a set on the disks of its robot."""
        markers = given.protocol.markers
        disks = tuple(marker_disk(robot, marker) for marker in markers)
        offsets = {
            f"marker.{k}.{axis}": value
            for k, marker in enumerate(markers[:-1])
            for axis, value in zip("xyz", marker.offset, strict=True)
        }
        tool = np.array(markers[-1].offset) if markers else None
        return cls(disks, robot.disks.station_m[list(disks)] / robot.length, offsets, tool)

    def placed(self, table: Table) -> Measured:
        """Measurements of a table with the stations of the markers."""
        if self.tool is None:
            return table.data
        return replace(table.data, stations=self.stations, tool=self.tool)


class _Predictor:
    """Observable of a table as a function of parameter values."""

    def __init__(
        self, model: Model, robot: Robot, markers: _Markers, observable: Observable
    ) -> None:
        self.model, self.observable, self.markers = model, observable, markers
        self.unknowns = Unknowns(robot, model.parameters, {**markers.offsets, **model.start})

    def __call__(self, values: ArrayLike, table: Table) -> Floats:
        """Observable (K, ...) of parameter values (P,)."""
        at = self._prediction(np.asarray(values, dtype=float), table)
        if self.observable == "bend":
            tangent = at.rotation[:, -1, :, 2]
            return np.asarray(np.arctan2(np.hypot(tangent[:, 0], tangent[:, 1]), tangent[:, 2]))
        if not at.setting.tool.any():
            tool = observations.tool(self.markers.placed(table))
            at = replace(at, setting=replace(at.setting, tool=tool))
        return at.points if self.observable == "markers" else at.point

    def _prediction(self, values: Floats, table: Table) -> Prediction:
        """Poses of the disks of the markers, or of the end disk."""
        disks = self.markers.disks or None
        commands = observations.commands(table.data, self.unknowns.robot)
        if self.model.model == "constant_curvature":
            return TipModel(self.unknowns, commands, None, disks).predict(values)
        if (self.model.parameters or self.model.start) and table.load is None:
            return TipModel(self.unknowns, commands, RodModel(), disks).predict(values)
        setting = self.unknowns.setting(values)
        position, turned = _solved(setting, commands, table.load or Load())
        own = list(disks or (position.shape[1] - 1,))
        solved = np.array(np.isfinite(position[:, -1]).all(axis=1))
        return Prediction(position[:, own], turned[:, own], solved, setting)


def _solved(setting: Setting, commands: Commands, load: Load) -> tuple[Floats, Floats]:
    """Positions (K, N, 3) and rotations (K, N, 3, 3) of the disks by the rod, under any loads.

    The elements are as many as `bowstring.solve` takes.
    """
    by_displacement, values = commands.by_displacement, commands.effective(setting)
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
    lost = float(np.nanmax(np.abs(first)))  # fewer equilibria must not lower the cost

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
