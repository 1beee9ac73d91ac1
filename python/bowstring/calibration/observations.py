"""Measurements for a fit, and scores of predictions.

Any object with the attributes of `Measured` is accepted. All values are in SI; K is the number of
rows, P that of measured points in a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration.tip_model import Commands
from bowstring.errors import InputError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics import actuation
from bowstring.statics.load import Load
from bowstring.validation import check_is_read, floats, floats_or_refuse, shown

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements

#: Largest distance between a station and its disk, as a share of the length.
_SAME_PLACE: Final = 1e-3


class Measured(Protocol):
    """Attributes of measurements that a fit reads: K rows, in the order of measurement.

    ``tensions`` and ``displacements`` are (K, T) in N and m, NaN where a tendon has the other
    command; either may be None. ``points`` is (K, P, 3) in m, the last point the tip (or ``tip``
    (K, 3)). ``group`` (K,) and ``time`` (K,) in s may be None. Optional, as in
    `bowstring.Measurements`: ``stations`` (P,) as shares of the length, ``sigma`` (K,) in m,
    ``repeat`` (K,), ``recording`` (K,), ``line`` (K,) of the table for messages, ``tool`` (3,)
    in m.
    """

    @property
    def tensions(self) -> Any:
        """Commanded tensions (K, T), N."""

    @property
    def displacements(self) -> Any:
        """Commanded displacements (K, T), m."""

    @property
    def points(self) -> Any:
        """Measured points (K, P, 3), m."""

    @property
    def group(self) -> Any:
        """Names (K,) of runs or patterns."""

    @property
    def time(self) -> Any:
        """Time (K,), s."""


@dataclass(frozen=True)
class Data:
    """Measurements as plain arrays, in SI; an alternative to `bowstring.Measurements`.

    Attributes
    ----------
    points : array_like (K, P, 3) or (K, 3)
        Measured points in m, the last one the tip; NaN where not measured.
    tensions, displacements : array_like (K, T) or None
        Commands in N and m, NaN where a tendon has the other one.
    group : array_like (K,) or None
        Names of runs or patterns, for validation.
    time : array_like (K,) or None
        Time in s.
    recording : array_like (K,) or None
        Rows with the same number or name form one path, which begins in the home pose without a
        history. None: all rows form one path.
    stations : array_like (P,) or None
        Arc lengths of the points as shares of the length, where each has a disk. None: the last
        point is on the end disk, and the others are not fitted.
    """

    points: ArrayLike
    tensions: ArrayLike | None = None
    displacements: ArrayLike | None = None
    group: Any = None
    time: ArrayLike | None = None
    recording: ArrayLike | None = None
    stations: ArrayLike | None = None


@dataclass(frozen=True, eq=False)
class Points:
    """Measured points of a fit and their disks; made by `measured_points`.

    Attributes
    ----------
    measured : ndarray (K, M, 3)
        Measured points in m, NaN where not measured; the last is the tip.
    disks : tuple of int
        Disk of each point, from 0.
    left_out : int
        Number of points in a row that have no station and are not fitted.
    """

    measured: Floats
    disks: tuple[int, ...]
    left_out: int

    @property
    def seen(self) -> Bools:
        """Points (K, M) that are measured."""
        return np.asarray(np.isfinite(self.measured).all(axis=2))


@dataclass(frozen=True)
class Score(Result):
    """Distances between predicted and measured points; by default the tip, by row."""

    count: Annotated[int, Key("rows")]
    """Number of rows."""
    rmse: Annotated[float, Key("rmse_mm")]
    """Root mean square of the distance, m; NaN without a row."""
    mean: Annotated[float, Key("mean_mm")]
    """Mean distance, m; NaN without a row."""
    largest: Annotated[float, Key("max_mm")]
    """Largest distance, m; NaN without a row."""
    rmse_centred: Annotated[float, Key("rmse_centred_mm")]
    """RMS without the mean error vector, m, which is often reported, but is no error of the model;
    NaN without a row."""
    mean_centred: Annotated[float, Key("mean_centred_mm")]
    """Mean distance without the mean error vector, m; NaN without a row."""

    def __str__(self) -> str:
        mm = 1e3
        return (
            f"RMSE {mm * self.rmse:.2f} mm, mean {mm * self.mean:.2f} mm, largest "
            f"{mm * self.largest:.1f} mm; without the mean offset RMSE "
            f"{mm * self.rmse_centred:.2f} mm, mean {mm * self.mean_centred:.2f} mm"
        )


@dataclass(frozen=True)
class AllPoints(Score):
    """Distances between predicted and measured points over all points of the rows."""

    count: Annotated[int, Key()]
    """Number of points over all rows."""
    rmse_before: Annotated[float, Key("rmse_before_mm")]
    """Root mean square of the distance before the fit, m."""


@dataclass(frozen=True)
class PointScore(Result):
    """Errors of one measured point over the fitted rows in which it is measured."""

    disk: Annotated[int, Key()]
    """Disk of the point, from 1."""
    station: Annotated[float, Key()]
    """Arc length of the disk as a share of the length."""
    score: Annotated[Score, Key(flat=True)]
    """After the fit."""
    before: Score
    """Before the fit."""

    @property
    def rmse_before(self) -> Annotated[float, Key("rmse_before_mm")]:
        """Root mean square of the distance before the fit, m; NaN without a row."""
        return self.before.rmse


def score(predicted: ArrayLike, measured: ArrayLike) -> Score:
    """Compare predicted with measured points.

    Parameters
    ----------
    predicted, measured : array_like (K, 3)
        Points in m; rows with NaN in either are left out.

    Returns
    -------
    Score
        Number of rows, RMS, mean and maximum distance, and RMS and mean about the mean error, m.

    Raises
    ------
    InputError
        If shapes differ or nothing is left.
    """
    a, b = np.asarray(predicted, dtype=float), np.asarray(measured, dtype=float)
    if a.shape != b.shape or a.ndim != 2 or a.shape[1] != 3:
        raise InputError(f"points have shapes {a.shape} and {b.shape}, both must be (K, 3)")
    return score_of_errors(a - b)


def score_of_errors(errors: Floats) -> Score:
    """Score of predicted minus measured points (K, 3) in m; rows with NaN are left out."""
    error = errors[np.isfinite(errors).all(axis=1)]
    if not len(error):
        raise InputError("there is no row with both a predicted and a measured point")
    plain = np.linalg.norm(error, axis=1)
    centred = np.linalg.norm(error - error.mean(axis=0), axis=1)
    rmse, rmse_centred = (float(np.sqrt(np.mean(each**2))) for each in (plain, centred))
    mean, mean_centred = float(plain.mean()), float(centred.mean())
    return Score(len(error), rmse, mean, float(plain.max()), rmse_centred, mean_centred)


def commands(data: Measured, robot: Robot) -> Commands:
    """Check and return displacements and tensions of all rows."""
    check_is_read(data)
    count = robot.core.tendon_count
    given = {}
    for name in ("tensions", "displacements"):
        table = getattr(data, name, None)
        if table is None:
            continue
        given[name] = floats_or_refuse(table, f"{name} must be numbers of shape (K, {count})")
        if given[name].ndim != 2 or given[name].shape[1] != count:
            raise InputError(
                f"{name} has shape {given[name].shape}, it must have one row for each measurement "
                f"and {count} columns, one for each tendon of {robot.name}"
            )
    if not given:
        raise InputError("the measurements have neither tensions nor displacements")
    if len({table.shape for table in given.values()}) > 1:
        raise InputError("tensions and displacements must have one row each for each measurement")
    load = Load(given.get("tensions"), given.get("displacements"))
    by_displacement, values = actuation.given(robot, load, rows=True)
    if not np.isfinite(values).all():
        k, t = np.argwhere(~np.isfinite(values))[0]
        raise InputError(f"row {k + 1}: the command of tendon {t + 1} is {values[k, t]}")
    time = _column(data, "time", len(values), "s")
    if time is not None and not np.isfinite(time).any():
        time = None
    recording = _column(data, "recording", len(values))
    if recording is not None:
        recording = np.unique(recording, return_inverse=True)[1].ravel().astype(np.int64)
    return Commands(by_displacement, values, time, recording)


def _column(data: Measured, name: str, count: int, unit: str = "") -> NDArray[Any] | None:
    """Values (K,) of an optional column, as numbers if it has a unit; None if missing."""
    given = getattr(data, name, None)
    if given is None:
        return None
    rule = f"{name} must be ({count},) numbers in {unit}"
    found = floats_or_refuse(given, rule) if unit else np.asarray(given)
    if found.shape != (count,):
        what = f", in {unit}" if unit else ""
        raise InputError(f"{name} has shape {found.shape}, it must be ({count},){what}")
    return found


def tips(data: Measured, count: int) -> Floats:
    """Measured tips (K, 3) in m, NaN where not measured."""
    points = getattr(data, "points", None)
    if points is None:
        points = getattr(data, "tip", None)
    if getattr(data, "scale", 1.0) is None:
        raise InputError("points are in pixels; a fit needs them in units of length")
    found = floats_or_refuse(points, "points must be numbers of shape (K, P, 3) in m")
    if found.ndim == 3:
        if not found.shape[1]:
            raise InputError(
                "the measurements have angles only, a fit needs a measured tip; fit_orientation "
                "fits angles"
            )
        found = found[:, -1, :]
    if found.shape != (count, 3):
        raise InputError(
            f"points give tips of shape {found.shape}, they must be ({count}, 3): one for each row"
        )
    if np.isinf(found).any():
        raise InputError(f"row {1 + int(np.argwhere(np.isinf(found))[0, 0])}: the tip is infinite")
    return found


def measured_points(data: Measured, robot: Robot, count: int) -> Points:
    """Check and return the measured points of all rows, each on the disk at its station.

    Without stations this is the tip alone.
    """
    tip = tips(data, count)
    points = getattr(data, "points", None)
    table = tip[:, None] if points is None else floats(points).reshape(count, -1, 3)
    number = table.shape[1]
    stations = getattr(data, "stations", None)
    if stations is None:
        return Points(tip[:, None], (len(robot.disks.station_m) - 1,), number - 1)
    disks = tuple(_disk_at(k, share, robot) for k, share in enumerate(_shares(stations, number)))
    if list(disks) != sorted(set(disks)):
        raise InputError("stations must rise from point to point, from the base to the tip")
    if np.isinf(table).any():
        k, m, _ = np.argwhere(np.isinf(table))[0]
        raise InputError(f"row {k + 1}: point {m + 1} is infinite")
    found = Points(table, disks, 0)
    missing = np.flatnonzero(~found.seen.any(axis=0))
    if missing.size and number > 1:
        raise InputError(
            f"point {missing[0] + 1} of {number} is measured in no row; leave out its columns and "
            "its station"
        )
    return found


def _shares(stations: ArrayLike, number: int) -> Floats:
    """Stations (P,) of `number` points."""
    try:
        found = floats(stations)
    except TypeError:
        found = np.empty(0)
    if found.shape != (number,) or not np.isfinite(found).all():
        raise InputError(
            f"stations is {shown(stations)}, it must be {number} numbers, one for each point"
        )
    return found


def _disk_at(point: int, share: float, robot: Robot) -> int:
    """Disk, from 0, at the station of a point."""
    stations = robot.disks.station_m / robot.length
    nearest = int(np.argmin(np.abs(stations - share)))
    if abs(stations[nearest] - share) > _SAME_PLACE:
        raise InputError(
            f"point {point + 1} is at station {share:.5g}, where {robot.name} has no disk; the "
            f"nearest is disk {nearest + 1} at {stations[nearest]:.5g}: give the robot a disk "
            "there, correct the station, or leave out all stations to fit the tip alone",
            argument="stations",
        )
    return nearest


def fitted_rows(rows: ArrayLike | None, measured: Floats) -> Bools:
    """Rows (K,) to fit: the selected ones, or all with a measured point.

    `measured` are tips (K, 3) or points (K, M, 3).
    """
    seen: Bools = np.array(
        np.isfinite(measured).all(axis=-1).reshape(len(measured), -1).any(axis=1)
    )
    used = seen if rows is None else np.asarray(rows)
    if used.dtype != bool or used.shape != seen.shape:
        raise InputError(f"rows must be {len(seen)} booleans, one for each measurement")
    if (used & ~seen).any():
        k = int(np.flatnonzero(used & ~seen)[0])
        raise InputError(f"row {k + 1} is to be fitted, and its tip is NaN")
    if not used.any():
        raise InputError("there is no measured tip to fit")
    return used


def groups(data: Measured, count: int) -> NDArray[Any]:
    """Group (K,) of each row, a separate one for each repeat; by default a single group."""
    group = _column(data, "group", count)
    found = np.full(count, "") if group is None else group.astype(str)
    repeat = getattr(data, "repeat", None)
    if repeat is None or len(np.unique(repeat)) < 2:
        return found
    named = [f"{g} repeat {r}".lstrip() for g, r in zip(found, np.asarray(repeat), strict=True)]
    return np.array(named)


def loads(values: Floats) -> Ints:
    """Number (K,) of the load of each row, equal for equal commands (K, T) within rounding.

    Numbers count from 0 in the order of first appearance.
    """
    span = np.ptp(values, axis=0)
    scale = np.where(span > 0.0, span, np.maximum(np.abs(values).max(axis=0), 1.0))
    return numbered(np.round(values / scale, 9))


def numbered(labels: NDArray[Any]) -> Ints:
    """Number (K,) of the label of each row, from 0 in the order of first appearance."""
    _, first, place = np.unique(labels, axis=0, return_index=True, return_inverse=True)
    return np.asarray(np.argsort(np.argsort(first))[place.ravel()], dtype=np.int64)


def repeats_loads(load: Ints) -> bool:
    """Whether most rows share their load with other rows."""
    return bool(np.mean(np.bincount(load)[load] > 1) > 0.5)


def sigmas(data: Measured, count: int) -> Floats | None:
    """Standard uncertainty (K,) of a measured coordinate in m; None where none is given."""
    found = _column(data, "sigma", count, "m")
    if found is not None and not (found > 0).all():
        raise InputError(f"row {1 + int(np.argmin(found > 0))}: sigma must be positive")
    return found


def tool(data: Measured, unsaid: Floats | None = None) -> Floats:
    """Offset of the measured point from the tip (3,) in m, as stated; zero by default."""
    none = np.zeros(3) if unsaid is None else unsaid
    return np.asarray(getattr(data, "tool", none), dtype=float)


def check_validation(data: Measurements, used: Bools, other: Measurements) -> None:
    """Refuse a validation table without a tip, or with commands and tip of a fitted row."""
    judged = other.seen
    if not judged.any():
        raise InputError(f"{other.name} has no measured tip to validate with")

    def keys(table: Measurements) -> list[bytes]:
        columns = (np.nan_to_num(table.tensions), np.nan_to_num(table.displacements), table.tip)
        return [row.tobytes() for row in np.concatenate(columns, axis=1)]

    fitted = {key for key, own in zip(keys(data), used, strict=True) if own}
    same = [k for k, key in enumerate(keys(other)) if judged[k] and key in fitted]
    if same:
        raise InputError(
            f"{len(same)} of {int(judged.sum())} validation rows are also fitted, the first in "
            f"line {other.line[same[0]]} of {other.name}; leave them out of one table"
        )
