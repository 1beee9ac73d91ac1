"""Validation with angles alone: constant curvature and rod against measured tip directions.

An inertial sensor or a bend sensor measures no position. The models are those of
`bowstring.study.data_validation`; the error is the angle between the predicted and the measured
direction of the tip, or the error of the bend angle where no direction was measured. A model is
compared in up to two frames:

- ``calibrated``: the frame of the sensor is turned as the fit of the calibrated rod has it
  (calibrated constant curvature: as its own fit has it). Only with measured directions.
- ``as_measured``: the frame of the sensor is the base frame.

Values are in SI and radians; K is the number of rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Final, Literal, cast

import numpy as np

from bowstring.aliases import Floats
from bowstring.calibration.bootstrap import RESAMPLES, bootstrap
from bowstring.calibration.orientation_fit import (
    AngleScore,
    OrientationFit,
    angle_errors,
    fit_orientation,
)
from bowstring.calibration.tip_model import rotation
from bowstring.data.columns import Source
from bowstring.data.measurements import MeasurementIssue, Measurements
from bowstring.data.tendon_check import check_tendons
from bowstring.data.tip_errors import ModelName
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError
from bowstring.formatting import in_mm, in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics.model import RodModel
from bowstring.study.calibration import arc_gains, rod_parameters
from bowstring.study.comparison import Theory
from bowstring.study.data_validation import (
    DATA_MODELS,
    SUBJECTS,
    Against,
    Loads,
    check_measurements,
    estimate_in_words,
    loads_of,
    rows_in_words,
    tip_poses,
)

Frame = Literal["calibrated", "as_measured"]

FRAMES: Final[dict[Frame, str]] = {
    "calibrated": "turned as fitted",
    "as_measured": "as measured",
}
"""Frames of the sensor and their labels; the first that is there is the default."""

_TURN: Final = ("base.rx", "base.ry", "base.rz")


@short_repr
@dataclass(frozen=True, eq=False)
class AngleComparison(Result):
    """Comparison of a model with measured angles in one frame."""

    name: str
    """Name of the model."""
    frame: Annotated[Frame, Key()]
    """``calibrated``: the sensor's frame is turned as fitted. ``as_measured``: it is the base
    frame."""
    error: Floats
    """Absolute errors (K,), rad; NaN without a solution."""
    apart: Floats
    """Distance (K,) between the tips of two arcs, one with the measured angles and one with those
    of the model, m; NaN for several segments."""
    length: float
    """Length of the robot, m."""
    interval: Annotated[Floats, Key("interval_95_mean_deg")] = field(
        default_factory=lambda: np.full(2, np.nan)
    )
    """95 % bootstrap interval (2,) of the mean error, rad."""

    @property
    def model(self) -> Annotated[ModelName, Key("name")]:
        """Model, as in a comparison with measured tips."""
        return cast("ModelName", self.name)

    @property
    def n(self) -> Annotated[int, Key()]:
        """Number of rows with a solution."""
        return int(np.isfinite(self.error).sum())

    @property
    def score(self) -> Annotated[AngleScore, Key(flat=True)]:
        """Errors over these rows."""
        return AngleScore.of(self.error[np.isfinite(self.error)])

    @property
    def mean_apart(self) -> Annotated[float, Key("arc_tip_mean_mm")]:
        """Mean distance between the tips of two arcs, one with the measured angles and one with
        those of the model, m; NaN for several segments."""
        return float(np.nanmean(self.apart)) if np.isfinite(self.apart).any() else math.nan


@short_repr
@dataclass(frozen=True, eq=False)
class AgainstAngles(Against, Result):
    """Comparison of all models with measured angles of the tip."""

    data: Measurements
    """Measurements."""
    loads: Loads
    """Commands of the K rows."""
    comparisons: Annotated[tuple[AngleComparison, ...], Key()]
    """Comparisons by model, each in its frames."""
    calibrations: Annotated[tuple[OrientationFit, ...], Key()]
    """Fits of the calibrated rod and of calibrated constant curvature, as far as they are
    possible."""
    lengths_of: str
    """Source of the tendon lengths for constant curvature: measurement, rod_calibrated or rod."""
    text: Annotated[tuple[str, ...], Key()] = ()
    """Results in sentences."""
    notes: Annotated[tuple[str, ...], Key()] = ()
    """Data, methods and left-out models in sentences."""
    doubts: tuple[str, ...] = ()
    """Warnings of rows that are left out and of commands that do not match the motion."""

    @property
    def source(self) -> Annotated[Source, Key()]:
        """Origin of the numbers."""
        return self.data.source

    @property
    def file(self) -> Annotated[Path | None, Key()]:
        """Path of the table."""
        return self.data.path

    @property
    def sha256(self) -> Annotated[str | None, Key()]:
        """SHA-256 of the table."""
        return self.data.sha256

    @property
    def rows(self) -> Annotated[int, Key()]:
        """Number of rows, without those left out."""
        return len(self.data)

    @property
    def left_out(self) -> Annotated[int, Key()]:
        """Rows left out; `issues` has the reasons."""
        return self.data.left_out

    @property
    def issues(self) -> Annotated[list[MeasurementIssue], Key()]:
        """Faults of the table."""
        return [MeasurementIssue(*issue) for issue in self.data.issues]

    @property
    def load_count(self) -> Annotated[int, Key("loads")]:
        """Number of different loads."""
        return self.loads.count

    def comparison(self, name: str, frame: Frame | None = None) -> AngleComparison:
        """Return the comparison of a model in a frame, by default the first it has."""
        return next(c for c in self.comparisons if c.name == name and frame in (None, c.frame))


def judge_angles(
    robot: Robot,
    data: Measurements,
    tolerance: float,
    theory: Theory = "cosserat",
    progress: Callable[[float], None] | None = None,
) -> AgainstAngles:
    """Compare all models with measured angles.

    Parameters
    ----------
    robot : Robot
        Robot of the file.
    data : Measurements
        Measurements with bend angles, and their directions or not, that `check_measurements`
        accepts. Measured tips are ignored.
    tolerance : float
        Tolerated error of the tip's position, a share of the length; angles do not judge it.
    theory : {"cosserat", "kirchhoff"}
    progress : callable, optional
        Progress callback, called with the finished share from 0 to 1.

    Raises
    ------
    InputError
        If the data cannot be judged.
    """
    if data.bend is None:
        raise InputError(f"{data.name} has no bend angles; judge_data compares tips")
    notify = progress or (lambda share: None)
    check_measurements(robot, data)
    loads = loads_of(data)
    notes: list[str] = []
    if data.direction is None:
        notes.append("No direction was measured: the turn of the sensor's frame is not fitted.")

    rod = _calibrated(robot, data, rod_parameters(robot, data), RodModel(theory), notes)
    notify(0.5)
    poses, lengths_of, why = tip_poses(
        robot, data, theory, None if rod is None else (rod.robot, 1.0)
    )
    notes += why
    directions = {name: turned[..., 2] for name, (_, turned) in poses.items()}
    turns = dict.fromkeys(directions, np.zeros(3))
    arc = _calibrated(robot, data, arc_gains(robot), "arc", notes)
    common = rod or arc
    if common is not None:
        turns = dict.fromkeys(directions, common.turn)
    for name, fitted in (("rod_calibrated", rod), ("cc_calibrated", arc)):
        if fitted is not None:
            directions[name], turns[name] = fitted.tip_direction, fitted.turn
    if not directions:
        raise InputError(
            f"{data.name}: no model has a solution for these commands. {' '.join(notes)}"
        )
    notify(0.9)

    made: list[AngleComparison] = []
    for name in (name for name in DATA_MODELS if name in directions):
        lost = int((~np.isfinite(directions[name]).all(axis=1)).sum())
        if lost:
            notes.append(
                f"{DATA_MODELS[name]} has no solution for {lost} of {len(data)} rows; its numbers "
                "are over the others."
            )
        frames: dict[Frame, Floats] = {"calibrated": turns[name], "as_measured": np.zeros(3)}
        if not turns[name].any():
            del frames["calibrated"]
        elif name == "cc_calibrated":  # its gain belongs to its frame
            del frames["as_measured"]
        for frame, turn in frames.items():
            predicted = directions[name] @ rotation(turn).T
            error = np.linalg.norm(angle_errors(predicted, data.bend, data.direction), axis=1)
            apart = _arcs_apart(robot, data, predicted)
            made.append(AngleComparison(name, frame, error, apart, robot.length))
    vectors = [np.pad(c.error[:, None], ((0, 0), (0, 2))) for c in made]
    intervals = bootstrap(vectors, loads.resampled[0])
    compared = [replace(c, interval=i.mean) for c, i in zip(made, intervals, strict=True)]
    out = AgainstAngles(
        data=data,
        loads=loads,
        comparisons=tuple(compared),
        calibrations=tuple(each for each in (rod, arc) if each is not None),
        lengths_of=lengths_of,
        notes=(*_notes(loads), *notes),
    )
    order = check_tendons(robot, data)
    is_open = order.alarm or order.found == "turned"  # the fitted frame would hide this
    doubts = [data.doubt, order.sentence if is_open else order.remark]
    notify(1.0)
    return replace(
        out, text=_in_words(out, robot, tolerance), doubts=tuple(each for each in doubts if each)
    )


def _calibrated(
    robot: Robot,
    data: Measurements,
    names: Sequence[str],
    model: RodModel | Literal["arc"],
    notes: list[str],
) -> OrientationFit | None:
    """Fit to the angles with the turn of the sensor's frame, or without where that is not possible.

    Adds to `notes` what is not fitted.
    """
    label = DATA_MODELS["cc_calibrated" if model == "arc" else "rod_calibrated"]
    tries = [(names, f"{label} is left out: {{}}.")]
    if data.direction is not None:
        without = f"{label}: the turn of the sensor's frame is not fitted, because {{}}."
        tries.insert(0, ([*names, *_TURN], without))
    for asked, note in tries:
        try:
            found = fit_orientation(robot, data, asked, model=model)
            if found.converged:
                return found
            why = "the fit did not converge"
        except BowstringError as error:
            why = str(error).rstrip(".")
        notes.append(note.format(why))
    return None


def _arcs_apart(robot: Robot, data: Measurements, predicted: Floats) -> Floats:
    """Distance (K,) between arcs with the measured and the predicted (K, 3) end, m; or NaN."""
    if len(robot.segments) > 1:
        return np.full(len(data), math.nan)
    assert data.bend is not None
    x, y, z = predicted.T
    by_model, measured = np.arctan2(np.hypot(x, y), z), np.arccos(np.cos(data.bend))
    towards = np.zeros(len(data)), np.zeros(len(data))
    if data.direction is not None:
        measured = data.bend
        towards = np.arctan2(y, x), data.direction

    def tip(bend: Floats, direction: Floats) -> Floats:
        aside = 0.5 * bend * np.sinc(bend / math.tau) ** 2  # (1 - cos b) / b
        along = np.sinc(bend / math.pi)
        return robot.length * np.stack(
            [aside * np.cos(direction), aside * np.sin(direction), along], axis=-1
        )

    return np.asarray(np.linalg.norm(tip(by_model, towards[0]) - tip(measured, towards[1]), axis=1))


# -- in words ----------------------------------------------------------------------------------


def _degrees(value: float) -> str:
    return significant(math.degrees(value))


def _mean(c: AngleComparison) -> str:
    low, high = (_degrees(end) for end in c.interval)
    return f"{_degrees(c.score.mean)} deg [{low}, {high}]"


def _in_words(found: AgainstAngles, robot: Robot, tolerance: float) -> tuple[str, ...]:
    out = [
        f"{rows_in_words(found.data, found.loads)} Angles alone do not show the tip's position, "
        f"and do not judge the tolerance of {in_percent(tolerance)}."
    ]
    for name in (name for name in SUBJECTS if name in found.models):
        c = found.comparison(name)
        sentence = (
            f"{found.subject(name)} has a mean angle error of {_mean(c)} and a largest of "
            f"{_degrees(c.score.largest)} deg"
        )
        if c.frame == "calibrated" and name != "cc_calibrated":
            plain = _mean(found.comparison(name, "as_measured"))
            sentence += f"; {plain} in the mean if the sensor's frame is not turned as fitted"
        if math.isfinite(c.mean_apart):
            share = c.mean_apart / c.length
            sentence += (
                f". If both were arcs, that would be a mean tip error of {in_mm(c.mean_apart)}, "
                f"{in_percent(share)} of length"
            )
        out.append(f"{sentence}.")
    rods = [
        f"{_mean(found.comparison(name))} {what}"
        for name, what in (("rod", "as the robot file has it"), ("rod_calibrated", "calibrated"))
        if name in found.models
    ]
    if rods:
        out.append(f"The rod model has a mean angle error of {' and of '.join(rods)}.")
    for fitted in found.calibrations:
        estimates = [estimate_in_words(e) for e in fitted.estimates if e.name not in _TURN]
        turn = float(np.linalg.norm(fitted.turn))
        turned = f"; the sensor's frame is turned by {_degrees(turn)} deg" if turn else ""
        which = "the rod" if fitted.model == "rod" else "constant curvature"
        out.append(f"Calibrated for {which} are {listed(estimates)}{turned}.")
    if len(robot.segments) == 1:
        apart = 0.5 * robot.length * math.radians(1.0)
        out.append(
            f"One degree of bend moves the tip of an arc by up to {in_mm(apart)}, "
            f"{in_percent(apart / robot.length)} of length."
        )
    return tuple(out)


def _notes(loads: Loads) -> tuple[str, ...]:
    return (
        "The error is the angle between the measured and the predicted direction of the tip; "
        "without measured directions, the error of the bend angle.",
        f"Intervals are bootstrap intervals at 95 % ({RESAMPLES} resamples) of the "
        f"{loads.resampled[1]}; the calibration is fixed.",
        "The calibrated models are judged on the rows that they were fitted to; nothing was held "
        "out.",
    )
