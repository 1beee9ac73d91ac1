"""Validation with data: constant curvature and rod against the measured tip.

Seven models at the commands of the table: constant curvature from lengths and from force, plain and
corrected, with a fitted gain; the rod of the robot file, and the calibrated rod. Each is compared
in three frames, because a slightly tilted base looks like a model error:

- ``as_measured``: the measuring frame is the base frame, without registration.
- ``calibrated``: registered with one base frame for all, that of the calibrated rod; the default.
  Calibrated constant curvature keeps the base frame of its own calibration; without registration
  its gain is fitted in the measuring frame.
- ``own``: each model registered with its best base frame by least squares. This also removes model
  errors that look like a rigid motion and thus favours the model; the RMS error is the smallest
  possible, the mean error need not be.

Differences are model minus measurement at the measured point (the tip, or the tool stated in the
table), in base axes. All values are in SI; K is the number of rows.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration import observations
from bowstring.calibration.bootstrap import (
    LEVEL,
    RESAMPLES,
    Expected,
    Intervals,
    bootstrap,
    refitted,
)
from bowstring.calibration.fitting import Estimate
from bowstring.calibration.model_comparison import ModelComparison, compare_models
from bowstring.calibration.residual_tests import NoiseTest, noise_test
from bowstring.data.measurements import MeasurementIssue, Measurements
from bowstring.data.registration import fit_model
from bowstring.data.rigid import Rigid
from bowstring.data.tendon_check import TendonCheck, check_tendons
from bowstring.data.tip_errors import Comparison
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError
from bowstring.formatting import in_mm, in_percent, listed, significant, with_error
from bowstring.results import Key, Result
from bowstring.robot.model import Robot, with_drives, with_tendons
from bowstring.statics import actuation
from bowstring.study.calibration import (
    ArcCalibration,
    StudyCalibration,
    calibrate,
    calibrate_arc,
    predicted,
)
from bowstring.study.comparison import FROM_FORCE, Theory, poses_by_arcs

Frame = Literal["calibrated", "as_measured", "own"]

DATA_MODELS: Final = {
    "cc_from_lengths": "CC from lengths (Eq. 5)",
    "cc_from_force": "CC from force (linear law)",
    "cc_from_lengths_chord": "CC from lengths, chords",
    "cc_from_force_arm": "CC from force, mean arm",
    "cc_calibrated": "CC calibrated (fitted gain and base)",
    "rod": "rod, as the robot file has it",
    "rod_calibrated": "rod calibrated",
}
"""Names of the models and their labels; `AgainstData.labels` adds the source of lengths."""

FRAMES: Final = {
    "calibrated": "registered, one frame for all",
    "as_measured": "not registered",
    "own": "registered, each its own frame",
}
"""Names of the three frames and their labels; the first is the default."""

_FEWEST_ROWS: Final = 4
_FEWEST_LOADS: Final = 3
_MOST_ROWS: Final = 20_000
_LONG: Final = 100  # rows above which data without repeats are resampled in blocks
_AS_GOOD: Final = 1.01  # largest error of a calibrated model over that without calibration
_SAME: Final = 1e-9  # difference of equal loads over the largest command


# -- what is computed --------------------------------------------------------------------------


@dataclass(frozen=True)
class BaseEstimate(Result):
    """A coordinate of the base by calibration."""

    value: Annotated[float, Key(unit="`unit`")]
    """Estimate."""
    standard_error: Annotated[float, Key(unit="`unit`")]
    """Standard error, which may be infinite."""
    unit: Annotated[str, Key()]
    """Unit."""


@short_repr
@dataclass(frozen=True)
class Loads:
    """Commands as abscissa of figures, as groups, and in the order of the bench."""

    axis: Floats
    """Abscissa of figures (K,): the command that changes most, or the row number."""
    label: str
    """Label of the abscissa with its unit."""
    unit: Ints
    """Number of the load (K,), equal for equal commands."""
    loading: Bools
    """Whether the row is loading (K,): the command that changes most increases towards it."""
    run: Ints
    """Number of the repeated run (K,)."""

    @property
    def single(self) -> bool:
        """Whether a single command changes; otherwise rows are drawn in their order."""
        return self.label != "row"

    @property
    def count(self) -> int:
        """Number of different loads."""
        return int(self.unit.max()) + 1

    @property
    def resampled(self) -> tuple[Ints, str]:
        """Resampling unit (K,) of each row, and its description.

        Units are loads, or blocks of a long path without repeats, because the errors of neighbours
        are correlated.
        """
        rows = len(self.unit)
        if rows < _LONG or observations.repeats_loads(self.unit):
            return self.unit, f"load, with all its rows ({self.count} loads)"
        block = math.ceil(math.sqrt(rows))
        blocks = np.arange(rows) // block
        return blocks, f"block of {block} neighbouring rows ({int(blocks[-1]) + 1} blocks)"

    @property
    def cell(self) -> Ints:
        """Number (K,), equal for repeats: same load, both in loading or both in unloading."""
        return np.asarray(2 * self.unit + self.loading, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class ComparisonIntervals(Intervals):
    """95 % intervals of the errors of a comparison by bootstrap."""

    length: float
    """Length of the robot, m."""

    @property
    def mean_share(self) -> Annotated[Floats, Key("mean_percent")]:
        """Interval (2,) of the mean error as a share of the length; NaN without rows."""
        return self.mean / self.length


@short_repr
@dataclass(frozen=True)
class DataComparison(Comparison):
    """Comparison of a model with the measurement in one frame.

    The tip is the measured point by the model in the base frame, NaN without a solution.
    """

    frame: Annotated[Frame, Key()] = "calibrated"
    """``calibrated``: one base frame for all models, that of the calibrated rod (``cc_calibrated``
    keeps that of its own calibration). ``as_measured``: not registered. ``own``: the frame that
    fits the model best. They come in this order."""
    intervals: Intervals | None = field(default=None, compare=False)
    """95 % bootstrap intervals of the errors; None before they are computed."""

    @property
    def registered(self) -> Annotated[bool, Key()]:
        """Whether a base frame was fitted."""
        return self.frame != "as_measured"

    @property
    def max_by_axis(self) -> Annotated[Floats, Key("max_by_axis_mm")]:
        """Largest absolute error along x, y and z (3,), m; NaN without a point."""
        return super().max_by_axis

    @property
    def interval(self) -> Annotated[ComparisonIntervals, Key("interval_95")]:
        """95 % intervals of the errors."""
        assert self.intervals is not None
        return ComparisonIntervals(**vars(self.intervals), length=self.length)


@short_repr
@dataclass(frozen=True)
class Effect(Result):
    """One step of the decomposition of the rod's error; NaN without rows."""

    name: Annotated[str, Key("effect")]
    """Name: registration, gravity, friction, stiffness or gain."""
    label: Annotated[str, Key()]
    """Name in words for tables and figures."""
    cumulative_mean: Annotated[float, Key("cumulative_mean_mm")]
    """Mean error with this effect and all previous ones, m; NaN without rows."""
    explains: Annotated[float, Key("explains_mm")]
    """Decrease of the mean error by the step, m; negative for an increase; NaN without rows."""
    explains_interval: Annotated[Floats, Key("explains_interval_95_mm")]
    """Its 95 % interval (2,), m; NaN without rows."""
    without: Annotated[float, Key("mean_without_it_alone_mm")]
    """Mean error of the calibrated robot without this effect, m; NaN without rows."""
    increase_without: Annotated[float, Key("increase_without_mm")]
    """Increase of the mean error without this effect, m; NaN without rows."""
    increase_without_interval: Annotated[Floats, Key("increase_without_interval_95_mm")]
    """Its 95 % interval (2,), m; NaN without rows."""


@short_repr
class Against:
    """Names of the data and models of a comparison with measurements."""

    data: Measurements
    comparisons: Sequence[Any]
    lengths_of: str

    @property
    def label(self) -> str:
        """Source and name of the data."""
        return f"{self.data.source}: {self.data.name}"

    @property
    def title(self) -> str:
        """Label, capitalised."""
        return self.label[0].upper() + self.label[1:]

    @property
    def models(self) -> tuple[str, ...]:
        """Names of the available models."""
        return tuple(dict.fromkeys(c.name for c in self.comparisons))

    def subject(self, name: str) -> str:
        """Beginning of a sentence on a model of `SUBJECTS`."""
        if name != "cc_from_lengths" or self.lengths_of == "measurement":
            return SUBJECTS[name]
        rod = "the calibrated rod" if self.lengths_of == "rod_calibrated" else "the rod"
        return f"{SUBJECTS[name]} (those of {rod}, for none were measured)"

    @property
    def labels(self) -> dict[str, str]:
        """Labels of the models; they state tendon lengths that were not measured."""
        whose = {
            "rod_calibrated": "CC from lengths of the calibrated rod",
            "rod": "CC from lengths of the rod",
        }.get(self.lengths_of, "CC from lengths")
        return {name: DATA_MODELS[name].replace("CC from lengths", whose) for name in self.models}


@dataclass(frozen=True, eq=False)
class AgainstData(Against):
    """All results of a study on measurements."""

    data: Measurements
    """Measurements."""
    loads: Loads
    """Commands of the K rows."""
    frame: Rigid
    """Common motion from measuring frame to base frame."""
    frame_by: str
    """Model that determined it: ``rod_calibrated``, or another one without calibration."""
    point: Floats
    """Measured point in that frame (K, 3), m."""
    comparisons: tuple[DataComparison, ...]
    """Comparisons by model in the order of `DATA_MODELS`, each in the frames of `FRAMES`."""
    own_frames: dict[str, Rigid]
    """Best base frame of each model, by its name."""
    gains: dict[str, float]
    """Gains of calibrated constant curvature, fitted with its own base frame."""
    lengths_of: str
    """Source of the tendon lengths for constant curvature: measurement, rod_calibrated or rod."""
    calibration: StudyCalibration | None
    """Calibrated rod and base frame; None if the rod cannot be calibrated."""
    baseline_mean: float
    """Mean error of the baseline rod at the start of the decomposition, m."""
    effects: tuple[Effect, ...]
    """Steps of the decomposition in their order; empty without calibration or common rows."""
    residuals: NoiseTest | None
    """Test of the residuals of the calibrated rod."""
    expected: Expected | None
    """Expected error of the calibrated rod at unseen rows."""
    models_compared: ModelComparison | None = None
    """Models with memories on left-out rows, if asked for and possible."""
    text: tuple[str, ...] = ()
    """Results in sentences."""
    notes: tuple[str, ...] = ()
    """Data, methods and left-out models in sentences."""
    doubts: tuple[str, ...] = ()
    """Warnings of rows that are left out and of commands that do not match the motion."""

    @property
    def calibrated_friction(self) -> Robot | None:
        """Calibrated robot, if its friction was identifiable."""
        if self.calibration is None or not self.calibration.fit.converged:
            return None
        names = self.calibration.fit.names
        return self.calibration.robot if any(n.endswith(".friction") for n in names) else None

    def has(self, name: str, frame: Frame = "calibrated") -> bool:
        """Whether a model is available in a frame."""
        return any((c.name, c.frame) == (name, frame) for c in self.comparisons)

    def comparison(self, name: str, frame: Frame = "calibrated") -> DataComparison:
        """Return the comparison of a model in a frame."""
        return next(c for c in self.comparisons if (c.name, c.frame) == (name, frame))

    def to_dict(self) -> dict[str, Any]:
        """Return the block ``measurements`` of a study."""
        d, c = self.data, self.calibration
        base = None
        if c is not None:
            base = {
                e.name.removeprefix("base."): BaseEstimate(
                    e.value, e.standard_error, e.unit
                ).to_dict()
                for e in c.fit.estimates
                if e.name.startswith("base.")
            }
        return {
            "source": d.source,
            "name": d.name,
            "file": None if d.path is None else str(d.path),
            "sha256": d.sha256,
            "rows": len(d),
            "left_out": d.left_out,
            "without_tip": d.without_tip,
            "issues": [MeasurementIssue(*issue).to_dict() for issue in d.issues],
            "loads": self.loads.count,
            "repeats": len(np.unique(self.loads.run)),
            "unloading_rows": int((~self.loads.loading).sum()) if self.loads.single else None,
            "registration": {
                "by": self.frame_by,
                **_frame_to_dict(self.frame),
                "base_in_measuring_frame": base,
                "own_frames": {
                    name: _frame_to_dict(frame) for name, frame in self.own_frames.items()
                },
            },
            "calibration": None
            if c is None
            else {**c.to_dict(), "constant_curvature_gains": self.gains},
            "residuals": None if self.residuals is None else self.residuals.to_dict(),
            "decomposition": {
                "baseline_mm": self.baseline_mean * 1e3,
                "effects": [effect.to_dict() for effect in self.effects],
            },
            "bootstrap": {
                "resamples": RESAMPLES,
                "level": LEVEL,
                "unit": self.loads.resampled[1],
                "units": len(np.unique(self.loads.resampled[0])),
                "calibrated_rod_at_other_rows": None
                if self.expected is None
                else self.expected.to_dict(),
            },
            "comparison": None if self.models_compared is None else self.models_compared.to_dict(),
            "text": list(self.text),
            "notes": list(self.notes),
        }


def _turn(frame: Rigid) -> float:
    return math.degrees(float(np.linalg.norm(frame.rotation_vector)))


def _frame_to_dict(frame: Rigid) -> dict[str, Any]:
    return {**frame.to_dict(), "turned_deg": _turn(frame)}


# -- before the work ---------------------------------------------------------------------------


def check_measurements(robot: Robot, data: Measurements) -> None:
    """Check before any work that measurements suffice for a study.

    Raises
    ------
    InputError
        For data of another robot, without a scale, too few or too many rows, too few loads, and
        for swapped tendons or a reversed numbering.
    """
    name = data.name if data.path is None else str(data.path)
    count = len(robot.tendons.segment)
    if data.tendon_count != count:
        raise InputError(
            f"{name}: the measurements are of {data.tendon_count} "
            f"tendon{'s' * (data.tendon_count != 1)}, {robot.name} has {count}; name the robot "
            "that was measured"
        )
    if data.scale is None:
        raise InputError(
            f"{name}: the points are in pixels and have no scale; give tips in mm for a study"
        )
    seen = rows_seen(data)
    count = int(seen.sum())
    if count < _FEWEST_ROWS:
        rows = "there is one row" if count == 1 else f"there are {count} rows"
        raise InputError(
            f"{name}: {rows} of measurements; a study needs {_FEWEST_ROWS} or more, at "
            f"{_FEWEST_LOADS} different loads or more"
        )
    if len(data) > _MOST_ROWS:
        raise InputError(
            f"{name}: {len(data)} rows are too many for a study, which takes up to {_MOST_ROWS}; "
            "average neighbouring rows, or take every tenth"
        )
    measured = data.select(seen)
    loads = loads_of(measured).count
    if loads < _FEWEST_LOADS:
        at = "all rows are at one load" if loads == 1 else f"the rows are at {loads} loads only"
        raise InputError(
            f"{name}: {at}; how an error grows with the load needs {_FEWEST_LOADS} different "
            "loads or more"
        )
    if not measured.points.shape[1]:
        if measured.bend is None or float(np.ptp(measured.bend)) == 0.0:
            raise InputError(f"{name}: the bend angle is the same in all rows; it was not measured")
    elif float(np.ptp(measured.tip, axis=0).max()) == 0.0:
        raise InputError(f"{name}: the tip is in the same place in all rows; it was not measured")
    order = check_tendons(robot, data)
    # "unclear" is left to the comparison
    if order.found in ("swapped", "mirrored"):
        raise InputError(f"{name}: {order.sentence.rstrip('.')}; mend the table or its mapping")


def rows_seen(data: Measurements) -> Bools:
    """Whether a row has a measured tip (K,); of data with angles only all rows have an angle."""
    return data.seen if data.points.shape[1] else np.ones(len(data), bool)


def loads_of(data: Measurements) -> Loads:
    """Derive loads, loading and unloading, and repeats from the commands."""
    by_displacement = ~np.isnan(data.displacements)
    commands = np.where(by_displacement, data.displacements, data.tensions)
    span = np.ptp(commands, axis=0)
    kinds = [
        np.where(kind, span, 0.0)
        for kind in (~by_displacement.any(axis=0), by_displacement.any(axis=0))
    ]
    by_tension = float(kinds[0].max(initial=0.0)) > 0.0
    changing = kinds[0 if by_tension else 1]
    tendon = int(np.argmax(changing))
    scale = np.where(span > 0.0, span, np.maximum(np.abs(commands).max(axis=0), 1.0))
    main = commands[:, tendon]
    alone = not np.any(np.delete(span, tendon) > _SAME * np.delete(scale, tendon))
    anew = data.repeat[1:] != data.repeat[:-1]
    if data.recording is not None:
        anew = anew | (data.recording[1:] != data.recording[:-1])
    run = np.cumsum(np.r_[False, anew])
    loading = np.ones(len(data), bool)
    for k in range(1, len(data)):
        if run[k] != run[k - 1]:
            continue
        step = main[k] - main[k - 1]
        small = abs(step) <= _SAME * scale[tendon]
        loading[k] = loading[k - 1] if small else step > 0.0
    # a new run begins with a single step down to its first load
    falls = np.flatnonzero(~loading[:-1] & loading[1:])
    lowest = main <= main.min() + _SAME * scale[tendon]
    for k in falls.tolist():
        if lowest[k] and (k == 0 or loading[k - 1]):
            loading[k] = True
    what, axis = "row", np.arange(1.0, len(data) + 1)
    if alone and by_tension:
        what, axis = f"tension of tendon {tendon + 1} (N)", main
    elif alone:
        what, axis = f"displacement of tendon {tendon + 1} (mm)", main * 1e3
    return Loads(
        axis=axis,
        label=what,
        unit=observations.loads(commands),
        loading=loading,
        run=np.asarray(run, dtype=np.int64),
    )


# -- the verdict -------------------------------------------------------------------------------


def judge_data(
    robot: Robot,
    data: Measurements,
    tolerance: float,
    theory: Theory = "cosserat",
    progress: Callable[[float], None] | None = None,
    *,
    compare: bool = False,
) -> AgainstData:
    """Compare all models with measurements.

    Parameters
    ----------
    robot : Robot
        Robot of the file.
    data : Measurements
        Measurements that `check_measurements` accepts.
    tolerance : float
        Tolerated error, a share of the length.
    theory : {"cosserat", "kirchhoff"}
    progress : callable, optional
        Progress callback, called with the finished share from 0 to 1.
    compare : bool
        Whether models with memories are compared on left-out rows too.

    Raises
    ------
    InputError
        If the data cannot be judged.
    """
    if not data.points.shape[1]:
        raise InputError(f"{data.name} has angles only; judge_angles compares them")
    report = progress or (lambda share: None)
    own_share = 0.2 if compare else 1.0

    def notify(share: float) -> None:
        report(own_share * share)

    check_measurements(robot, data)
    loads = loads_of(data)
    notes: list[str] = []
    calibration: StudyCalibration | None = None
    try:
        calibration = calibrate(robot, data, theory)
        notes += calibration.notes
        if data.left_out and calibration.robot.has_memory:
            rows = "a row was" if data.left_out == 1 else f"{data.left_out} rows were"
            notes.append(
                f"With a memory the rows are one path, and {rows} left out of it: the rod's "
                "prediction after these may be far off. Correct them, or leave only their tip "
                "blank."
            )
        if not calibration.fit.converged:
            notes.append(f"The calibration did not settle. {calibration.fit.whole_message}")
    except BowstringError as error:
        notes.append(f"The rod is not calibrated: {str(error).rstrip('.')}.")
    notify(0.5)

    points, lengths_of, why = _points(robot, data, theory, calibration)
    notes += why
    if not points:
        raise InputError(
            f"{data.name}: no model has a solution for these commands. {' '.join(why)}"
        )
    frames = {name: _own_frame(data, found) for name, found in points.items()}
    own = {name: each for name, each in frames.items() if each is not None}
    if calibration is not None:
        frame_by, frame = "rod_calibrated", calibration.frame
        own["rod_calibrated"] = frame
    else:
        frame_by = next((n for n in ("rod", "cc_from_lengths", *points) if n in own), "")
        frame = own.get(frame_by, Rigid.identity())
        notes.append(
            f"The base frame for all models is registered to one alone: {DATA_MODELS[frame_by]}."
            if frame_by
            else "No model gives a base frame: nothing is registered."
        )
    notify(0.6)

    without = [DATA_MODELS[name] for name in points if name not in own]
    if without:
        notes.append(f"No base frame of its own was found for: {listed(without)}.")

    gains: dict[str, float] = {}
    raw: Floats | None = None
    try:
        calibrated = calibrate_arc(robot, data)
        problem = _is_worse(calibrated, points, own, data)
        if problem:
            notes.append(f"Calibrated constant curvature is left out: {problem}.")
        else:
            gains, own["cc_calibrated"] = calibrated.gains, calibrated.frame
            # given in the common base frame with an unchanged distance to the data
            points["cc_calibrated"] = frame.apply(
                calibrated.frame.inverse().apply(calibrated.point)
            )
            raw = calibrate_arc(robot, data, Rigid.identity()).point
    except BowstringError as error:
        of = " that is not registered" if "cc_calibrated" in points else ""
        notes.append(f"Calibrated constant curvature{of} is left out: {str(error).rstrip('.')}.")
    notify(0.7)

    measured = data.tip
    made: list[DataComparison] = []
    for name in (name for name in DATA_MODELS if name in points):
        placed: dict[Frame, tuple[Floats | None, Rigid]] = {
            "calibrated": (points[name], frame),
            "as_measured": (raw if name == "cc_calibrated" else points[name], Rigid.identity()),
        }
        if name in own:
            model = calibrated.point if name == "cc_calibrated" else points[name]
            placed["own"] = model, own[name]
        for kind, (point, place) in placed.items():
            if point is not None:
                off = point - place.apply(measured)
                made.append(DataComparison(name, "measurement", robot.length, point, off, kind))
    intervals = bootstrap([c.difference for c in made], loads.resampled[0])
    comparisons = tuple(replace(c, intervals=i) for c, i in zip(made, intervals, strict=True))
    notify(0.8)

    plain, effects = math.nan, tuple[Effect, ...]()
    residuals = expected = None
    if calibration is not None:
        plain, effects = _decomposition(robot, data, theory, calibration, loads)
        residuals = noise_test(
            calibration.point - calibration.frame.apply(measured),
            loads.run,
            loads.cell,
            len(calibration.fit.estimates),
            data.sigma,
            line=data.line,
            other_load=calibration.other_load,
        )
        used, unit = calibration.fit.used, loads.resampled[0]
        if np.isfinite(calibration.fit.residuals[used]).all():
            expected = refitted(calibration.fit.residuals[used], calibration.fit.linear, unit[used])
    notify(1.0)
    compared = None
    if compare and calibration is not None:
        # friction is one of the memories there
        names = [name for name in calibration.fit.names if not name.endswith(".friction")]
        try:
            compared = compare_models(
                robot, data, names, progress=lambda _, share: report(0.2 + 0.8 * share)
            )
        except BowstringError as error:
            notes.append(f"Models are not compared on left-out rows: {str(error).rstrip('.')}.")
    report(1.0)
    out = AgainstData(
        data=data,
        loads=loads,
        frame=frame,
        frame_by=frame_by,
        point=frame.apply(measured),
        comparisons=comparisons,
        own_frames=own,
        gains=gains,
        lengths_of=lengths_of,
        calibration=calibration,
        baseline_mean=plain,
        effects=effects,
        residuals=residuals,
        expected=expected,
        models_compared=compared,
        notes=(*_notes(data, loads, calibration), *notes),
    )
    order = check_tendons(robot, data)
    of_order = order.sentence if order.alarm else order.remark
    doubts = [each for each in (data.doubt, of_order) if each]
    return replace(out, text=_in_words(out, tolerance, order), doubts=tuple(doubts))


def _points(
    robot: Robot, data: Measurements, theory: Theory, calibration: StudyCalibration | None
) -> tuple[dict[str, Floats], str, list[str]]:
    """Measured point (K, 3) by each model except calibrated CC, m, base frame.

    Also the source of the tendon lengths, and reasons for missing models.
    """
    calibrated = None
    if calibration is not None:
        calibrated = calibration.robot, calibration.gain_outside
    poses, lengths_of, why = tip_poses(robot, data, theory, calibrated)
    out = {name: position + rotation @ data.tool for name, (position, rotation) in poses.items()}
    if calibration is not None:
        out["rod_calibrated"] = calibration.point
    for name, found in out.items():
        gaps = int((~np.isfinite(found).all(axis=1) & data.seen).sum())
        if gaps:
            why.append(
                f"{DATA_MODELS[name]} has no solution for {gaps} of {int(data.seen.sum())} rows; "
                "its numbers are over the others."
            )
    return out, lengths_of, why


def tip_poses(
    robot: Robot, data: Measurements, theory: Theory, calibrated: tuple[Robot, float] | None
) -> tuple[dict[str, tuple[Floats, Floats]], str, list[str]]:
    """Position (K, 3), m, and rotation (K, 3, 3) of the tip by each model without calibration.

    Also the source of the tendon lengths, and reasons for missing models. The calibrated robot,
    with the gain of its commands, has the lengths where none were measured.
    """
    why = []
    out: dict[str, tuple[Floats, Floats]] = {}
    file = predicted(robot, data, theory)
    if np.any(file.converged):
        out["rod"] = file.tip_position, file.tip_rotation
    else:
        why.append("The rod as the robot file has it has no equilibrium at any row.")
    commands = observations.commands(data, robot).late(robot.tendons.delay_s)
    if not np.isnan(data.displacements).any():
        lengths_of = "measurement"
        moved = actuation.driven(robot, commands)
        lengths = robot.disks.station_m[robot.tendons.end_disk] - moved
    else:
        lengths_of, whose, sweep = "rod", "the rod as the robot file has it", file
        if calibrated is not None:
            lengths_of, whose = "rod_calibrated", "the calibrated rod"
            sweep = predicted(calibrated[0], data, theory, calibrated[1])
        lengths = sweep.tendon_lengths
        why.append(
            "Tendon lengths were not measured: constant curvature from lengths gets those that "
            f"{whose} has at the same commands."
        )
    fed = {"cc_from_lengths": lengths, "cc_from_lengths_chord": lengths}
    if np.isnan(data.tensions).any():
        why.append("The tensions are not known, and constant curvature from force needs them.")
    else:
        fed |= dict.fromkeys(FROM_FORCE, commands)
    for name, values in fed.items():
        position, rotation, reason = poses_by_arcs(robot, name, values)
        if np.isfinite(position).any():
            out[name] = position, rotation
        else:
            reason = reason.rstrip(".") or "it has no arcs"
            why.append(f"{DATA_MODELS[name]} is left out: {reason}.")
    return out, lengths_of, why


def _is_worse(
    calibrated: ArcCalibration,
    points: dict[str, Floats],
    own: dict[str, Rigid],
    data: Measurements,
) -> str:
    """Reason to leave out calibrated constant curvature: not better than uncalibrated, or ""."""
    if not calibrated.converged:
        return f"its fit did not settle. {calibrated.message.rstrip('.')}"
    name = "cc_from_force" if "cc_from_force" in points else "cc_from_lengths"
    if name not in own:
        return ""
    placed = (calibrated.point, calibrated.frame), (points[name], own[name])
    differences = [point - frame.apply(data.tip) for point, frame in placed]
    sizes = np.linalg.norm(differences, axis=2)
    sizes = sizes[:, np.isfinite(sizes).all(axis=0)]
    if not sizes.size:
        return ""
    mean, square = sizes.mean(axis=1), (sizes**2).mean(axis=1)
    if mean[0] <= _AS_GOOD * mean[1] or square[0] <= _AS_GOOD**2 * square[1]:
        return ""
    return (
        f"its fit ended at a mean error of {in_mm(mean[0])}, more than the {in_mm(mean[1])} "
        "without calibration"
    )


def _own_frame(data: Measurements, points: Floats) -> Rigid | None:
    """Best base frame of a model; None if its rows do not determine one."""
    good = np.isfinite(points).all(axis=1) & data.seen
    try:
        return fit_model(data.tip[good], points[good]).frame
    except BowstringError:
        return None


# -- what explains the error -------------------------------------------------------------------


def _decomposition(
    robot: Robot, data: Measurements, theory: Theory, calibration: StudyCalibration, loads: Loads
) -> tuple[float, tuple[Effect, ...]]:
    """Decompose the rod's error into registration, gravity, friction and stiffness (or gain).

    Registration is the first step, because the effect of the others on the distance would depend
    on the error of the frame.
    """
    full = calibration.robot
    stiff = [s.backbone.E for s in full.segments] != [s.backbone.E for s in robot.segments]
    effects = {
        "registration": ("registration", True),
        "gravity": ("gravity", any(full.gravity)),
        "friction": ("friction at the holes", full.has_friction),
        "stiffness": ("stiffness as calibrated", stiff),
        "gain": ("gain of the commands", calibration.gain != 1.0),
    }
    names = [name for name, (_, acts) in effects.items() if acts]

    def difference(on: frozenset[str]) -> Floats:
        made = full
        if "gravity" not in on:
            made = made.with_({"gravity": [0.0, 0.0, 0.0]})
        if "friction" not in on:
            made = with_tendons(made, {"friction": 0.0})
        if "stiffness" not in on and stiff:
            made = made.with_(
                {
                    f"segments.{k}.backbone.E": s.backbone.E
                    for k, s in enumerate(robot.segments)
                    if s.backbone.E is not None
                }
            )
        gain = calibration.gain_outside
        if "gain" not in on:
            gain, own = 1.0, robot.tendons
            made = with_drives(made, gain=own.gain, zero=own.zero_m)
        sweep = predicted(made, data, theory, gain)
        point = sweep.tip_position + sweep.tip_rotation @ data.tool
        frame = calibration.frame if "registration" in on else Rigid.identity()
        return np.asarray(point - frame.apply(data.tip))

    everything = frozenset(names)
    steps = [frozenset(names[:i]) for i in range(len(names) + 1)]
    without = [everything - {name} for name in names]
    sets = list(dict.fromkeys([*steps, *without]))
    differences = [difference(on) for on in sets]
    # a change of the mean is over the rows with both errors
    known = np.all([np.isfinite(d).all(axis=1) for d in differences], axis=0)
    if not known.any():
        return math.nan, ()
    for d in differences:
        d[~known] = np.nan
    found = dict(zip(sets, bootstrap(differences, loads.resampled[0]), strict=True))
    means = {
        on: float(np.mean(np.linalg.norm(d[known], axis=1)))
        for on, d in zip(sets, differences, strict=True)
    }
    tails = [0.5 - 0.5 * LEVEL, 0.5 + 0.5 * LEVEL]

    def interval(more: frozenset[str], less: frozenset[str]) -> Floats:
        change = found[less].means - found[more].means
        return np.asarray(np.quantile(change[np.isfinite(change)], tails))

    out = tuple(
        Effect(
            name=name,
            label=effects[name][0],
            cumulative_mean=means[steps[i + 1]],
            explains=means[steps[i]] - means[steps[i + 1]],
            explains_interval=interval(steps[i + 1], steps[i]),
            without=means[without[i]],
            increase_without=means[without[i]] - means[everything],
            increase_without_interval=interval(everything, without[i]),
        )
        for i, name in enumerate(names)
    )
    return means[steps[0]], out


# -- in words ----------------------------------------------------------------------------------


def _in_words(found: AgainstData, tolerance: float, order: TendonCheck) -> tuple[str, ...]:
    out = [rows_in_words(found.data, found.loads)]
    out += [_sentence(found, name, tolerance) for name in SUBJECTS if name in found.models]
    out.append(_of_the_rod(found))
    if order.found in ("turned", "unclear"):  # a fitted base frame would hide this
        out.append(order.sentence)
    if found.effects:
        parts = [
            f"{e.name} {'lowers' if e.explains >= 0 else 'raises'} it by {in_mm(abs(e.explains))}"
            for e in found.effects
        ]
        worth = max(found.effects, key=lambda e: e.increase_without)
        out.append(
            "What explains the rod's error, switched on one after another: without any of them it "
            f"is {in_mm(found.baseline_mean)} on average; {listed(parts)}; "
            f"{in_mm(found.effects[-1].cumulative_mean)} remains."
        )
        if worth.increase_without > 0:
            out[-1] += (
                f" Removing {worth.name} alone from the calibrated rod raises the error most, by "
                f"{in_mm(worth.increase_without)}."
            )
    if found.residuals is not None:
        out.append(found.residuals.text)
    if found.models_compared is not None:
        out.append(
            f"On rows left out of the fits: {found.models_compared.verdict} Of the models with and "
            f"without a memory the {found.models_compared.chosen.called} is the one to use."
        )
    return tuple(out)


def rows_in_words(data: Measurements, loads: Loads) -> str:
    """Rows, loads and repeats of the data in a sentence."""
    repeats = len(np.unique(loads.run))
    ways = "loading only" if loads.loading.all() else "loading and unloading"
    if not loads.single:
        ways = "several commands change"
    left = f" {data.left_out} rows of the table are left out." if data.left_out else ""
    if data.without_tip:
        left += (
            f" {data.without_tip} of the rows have no measured tip; they lead the path, and count "
            "in no number."
        )
    return (
        f"{data.source.capitalize()} data, {data.name}: {len(data)} rows at {loads.count} loads, "
        f"{ways}{f', {repeats} runs' if repeats > 1 else ''}.{left}"
    )


SUBJECTS: Final = {
    "cc_from_force": "Constant curvature from force",
    "cc_from_lengths": "Constant curvature from lengths",
    "cc_calibrated": "Constant curvature calibrated to these data",
}
"""Models of constant curvature that the text has, and how a sentence on them begins."""


def _mean(c: DataComparison) -> str:
    if c.intervals is None or c.n == 0:
        return in_mm(c.mean)
    low, high = (significant(x * 1e3) for x in c.intervals.mean)
    return f"{in_mm(c.mean)} [{low}, {high}]"


def _over(c: DataComparison, found: AgainstData) -> str:
    """Number of rows of the mean, if the model has no solution for some rows."""
    rows = int(found.data.seen.sum())
    return f" over {c.n} of {rows} rows" if c.n < rows else ""


def _sentence(found: AgainstData, name: str, tolerance: float) -> str:
    registered = found.comparison(name)
    subject = found.subject(name)
    own = name == "cc_calibrated"
    if own and found.gains:
        gains = ", ".join(significant(g, 4) for g in found.gains.values())
        subject += f" (gain {gains}, with a base frame of its own)"
    out = (
        f"{subject} has a mean error of {_mean(registered)}{_over(registered, found)}, "
        f"{in_percent(registered.mean / registered.length)} of length, and a largest of "
        f"{in_mm(registered.maximum)}"
    )
    if found.has(name, "as_measured"):
        again = " (its gain fitted so)" if own else ""
        out += f"; not registered{again} a mean of {_mean(found.comparison(name, 'as_measured'))}"
    if name in found.own_frames and not own:
        out += f", registered to it alone {_mean(found.comparison(name, 'own'))}"
    share = registered.mean / registered.length
    limit = "exceeds" if share > tolerance else "is within"
    return f"{out}. The mean {limit} the tolerance of {in_percent(tolerance)}."


def _of_the_rod(found: AgainstData) -> str:
    out = []
    for name, what in (("rod", "as the robot file has it"), ("rod_calibrated", "calibrated")):
        if name in found.models:
            registered, raw = found.comparison(name), found.comparison(name, "as_measured")
            what += _over(registered, found)
            out.append(f"{_mean(registered)} {what} (not registered {_mean(raw)})")
    if not out:
        return "The rod model has no solution for these commands."
    text = f"The rod model has a mean error of {' and of '.join(out)}."
    if found.expected is not None:
        low, high = (significant(x * 1e3) for x in found.expected.interval)
        text += (
            f" Calibrated, its expected mean error is {in_mm(found.expected.mean)} [{low}, {high}]"
            " at rows of this kind that it was not fitted to."
        )
    if found.calibration is not None:
        estimates = [e for e in found.calibration.fit.estimates if "base." not in e.name]
        text += (
            f" Calibrated are {listed([estimate_in_words(e) for e in estimates])}; the base is "
            f"turned by {significant(_turn(found.frame))} deg against the measuring frame."
        )
    return text


def estimate_in_words(estimate: Estimate) -> str:
    """Name and value of a parameter with its standard error."""
    path, _, leaf = estimate.name.rpartition(".")
    if path == "gravity":
        name = f"gravity along {'xyz'[int(leaf)]}"
    elif path == "bend_gain.segments":
        name = f"bend gain of segment {int(leaf) + 1}"
    else:
        named = {"E": "Young's modulus", "gain": "gain of the commands", "bend_gain": "bend gain"}
        name = named.get(leaf, leaf)
        segment = path.split(".")[1] if path.startswith("segments.") else "*"
        if segment.isdecimal():
            name += f" of segment {int(segment) + 1}"
    unit = f" {estimate.unit}" if estimate.unit else ""
    if estimate.at_limit:
        return f"{name} {significant(round(estimate.value, 9), 4)}{unit} (its limit)"
    if not math.isfinite(estimate.standard_error):
        return f"{name} {significant(estimate.value, 4)}{unit} (not determined)"
    return f"{name} {with_error(estimate.value, estimate.standard_error)}{unit}"


def _notes(
    data: Measurements, loads: Loads, calibration: StudyCalibration | None
) -> tuple[str, ...]:
    out = [
        {
            "measured": "The data count as measured: their table says so, or says nothing.",
            "synthetic": "The data are synthetic: made by simulation, nothing was measured.",
            "computed": "The data are computed by another program, nothing was measured.",
        }[data.source],
        "Registered means: one base frame for all models, "
        + ("that of the calibrated rod" if calibration else "said below")
        + ". Calibrated constant curvature keeps the base frame that was fitted together with its "
        "gain. Each model is also shown registered to it alone, which removes the rigid part of "
        "its error, and not registered. Registration minimises the sum of squares; the mean error "
        "can be smaller in another frame.",
        f"Intervals are bootstrap intervals at 95 % ({RESAMPLES} resamples). What is resampled is "
        f"the {loads.resampled[1]}; the same resamples for all models. "
        "Calibration and registration are fixed, except for the expected error of the calibrated "
        "rod at other rows: there each resample is fitted anew, by derivatives.",
    ]
    if calibration is not None:
        out.append(
            "The calibrated models are judged on the rows that they were fitted to; nothing was "
            "held out. The expected error of the rod at other rows takes that into account."
        )
        out.append(
            "Effects of the decomposition interact: what one explains depends on those before it, "
            "and removing one alone, nothing refitted, can change the error by another amount."
        )
    if data.tool.any():
        tool = ", ".join(f"{1e3 * x:g}" for x in data.tool)
        out.append(f"Errors are those of the measured point, ({tool}) mm from the tip in its axes.")
    return tuple(out)
