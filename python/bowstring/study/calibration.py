"""Calibration of the robot and its base frame in a study.

A study calibrates few parameters, the same for every robot: stiffness (or the gain of the
displacements), friction and the base frame, by `bowstring.fit`. A robot whose file has no gravity
was still measured on Earth, and a tilted base changes the direction of gravity. Gravity is
therefore fitted as well, and accepted only if it explains clearly more and is plausible.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.calibration import observations
from bowstring.calibration.fitting import EndOfFit, Fit, fit
from bowstring.calibration.tip_model import paths_of
from bowstring.data.measurements import STANDARD_GRAVITY, Measurements
from bowstring.data.rigid import Rigid
from bowstring.display import short_repr
from bowstring.errors import BowstringError
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.significance import EXTRA_LOAD, explained_p
from bowstring.statics import rod
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.statics.solution import Sweep, joined
from bowstring.study.comparison import Theory

GravityFrom = Literal["file", "assumed", "calibrated"]

_EARTHLY: Final = 0.03  # deviation over standard gravity, in addition to four standard errors
_MOST_SLOW: Final = 1200  # rows times tendons up to which friction and gravity are fitted
_ASKEW: Final = 2.0  # deg; plausible tilt of a base
_BASE: Final = ("x", "y", "z", "rx", "ry", "rz")
_GAINS: Final = (1.0, 0.3, 0.1)  # initial gains of the fit of constant curvature


@short_repr
@dataclass(frozen=True, eq=False)
class StudyCalibration(Result):
    """Calibrated robot, actuation and base frame."""

    robot: Robot
    """Calibrated robot."""
    gain: float
    """Gain of the commands; 1 if not calibrated."""
    frame: Rigid
    """Measuring frame to base frame."""
    point: Floats
    """Measured point by the calibrated robot (K, 3), m, base frame."""
    fit: Fit
    """Fit of the parameters of `robot`, gain and base frame."""
    gravity: Annotated[GravityFrom, Key("gravity_origin")] = "file"
    """Source of the gravity of the robot."""
    other_load: Annotated[bool, Key()] = False
    """Whether a constant load other than gravity would explain the data clearly better."""
    notes: Annotated[tuple[str, ...], Key()] = field(default=())
    """Choices of the calibration in sentences, such as parameters that are not identifiable."""

    @property
    def end(self) -> Annotated[EndOfFit, Key(flat=True)]:
        """Estimates, and how the fit ended."""
        return EndOfFit(**{each.name: getattr(self.fit, each.name) for each in fields(EndOfFit)})

    @property
    def gain_outside(self) -> float:
        """Gain of the commands that is not in `robot`."""
        return 1.0 if "gain" in self.fit.drives else self.gain

    @property
    def gravity_in_base(self) -> Annotated[Floats, Key("gravity_m_per_s2")]:
        """Gravity in base axes (3,), m/s^2."""
        return np.array(self.robot.gravity) + 0.0


def predicted(robot: Robot, data: Measurements, theory: Theory, gain: float = 1.0) -> Sweep:
    """Solve the commands of all rows; with friction each recording is a path.

    Parameters
    ----------
    robot : Robot
    data : Measurements
    theory : {"cosserat", "kirchhoff"}
    gain : float
        Gain of the commands beside those of the robot's drives.
    """
    tables = (data.tensions, data.displacements)
    given = [None if np.isnan(values).all() else gain * values for values in tables]
    model = RodModel(theory)
    commands = observations.commands(data, robot)
    late = robot.tendons.delay_s.any() and commands.time is not None
    if not (robot.has_memory or late):
        return rod.solve_batch(robot, load=Load(*given), model=model, disks=False)

    timed = late or robot.is_viscoelastic
    times = commands.clock("relaxation, creep or delay") if timed else None

    def path(rows: Ints) -> Sweep:
        load = Load(*(None if table is None else table[rows] for table in given))
        late = None if times is None else times[rows] - times[rows[0]]
        return rod.sweep(robot, load=load, model=model, times=late, disks=False)

    paths = paths_of(data.recording, len(data))
    if len(paths) == 1:
        return path(paths[0])
    return joined([(rows, path(rows)) for rows in paths])


def calibrate(robot: Robot, data: Measurements, theory: Theory) -> StudyCalibration:
    """Calibrate a robot and its base frame.

    Parameters
    ----------
    robot : Robot
    data : Measurements
        Measurements with tips; rows in the order of measurement.
    theory : {"cosserat", "kirchhoff"}

    Returns
    -------
    StudyCalibration

    Raises
    ------
    InputError, NoSolutionError
        If the data do not suffice, or the robot has no equilibrium at some rows.
    """
    names = rod_parameters(robot, data)
    few = len(data) * data.tendon_count <= _MOST_SLOW
    friction = ["segments.*.tendons.friction"] if few else []
    found, notes = _identifiable(robot, data, [*names, *friction, "base"], theory, friction)
    if names != ["gain"] and robot.has_matrix:
        notes.append(
            "A stiffness matrix is no single number and stays as in the robot file; bowstring.fit "
            "fits its entries."
        )
    if not few:
        notes.append(
            f"With more than {_MOST_SLOW} commands (rows times tendons) a study holds friction and "
            "gravity at what the robot file has; bowstring.fit fits them in its time."
        )
    richer = _with_gravity(robot, data, found, theory) if few else None
    gravity: GravityFrom = "file"
    other_load = False
    if richer is not None:
        found, gravity, other_load, said = _weighed(robot, data, found, richer, theory)
        notes += said
    frame = _frame(found)
    return StudyCalibration(
        robot=found.robot,
        gain=found.values.get("gain", 1.0),
        frame=frame,
        point=frame.apply(found.predict(data)),
        fit=found,
        gravity=gravity,
        other_load=other_load,
        notes=tuple(notes),
    )


@dataclass(frozen=True, eq=False)
class ArcCalibration:
    """Calibrated constant curvature: gains on the bend, with their base frame."""

    gains: dict[str, float]
    """Gains on the bend of the robot or of each segment, by name."""
    frame: Rigid
    """Measuring frame to base frame."""
    point: Floats
    """Measured point by the model (K, 3), m, base frame."""
    converged: bool
    """Whether the fit converged."""
    message: str
    """Message of the fit."""


def calibrate_arc(robot: Robot, data: Measurements, frame: Rigid | None = None) -> ArcCalibration:
    """Calibrate constant curvature: a gain on the bend of each segment.

    From force where tendons are tension-controlled, from lengths where they are
    displacement-controlled. In gravity the linear law can bend the robot ten times too much, and
    the least-squares problem has local minima: the fit starts from several gains and returns the
    best.

    Parameters
    ----------
    robot : Robot
    data : Measurements
    frame : Rigid, optional
        Fixed motion from measuring frame to base frame; by default it is fitted with the gains.

    Raises
    ------
    InputError, NoSolutionError
        If the data do not suffice, or constant curvature has no arcs for them.
    """
    names = arc_gains(robot)
    held: dict[str, float] = {}
    if frame is None:
        names.append("base")
    else:
        back = frame.inverse()
        place = (*back.translation.tolist(), *back.rotation_vector.tolist())
        held = {f"base.{axis}": value for axis, value in zip(_BASE, place, strict=True)}
    fits = [fit(robot, data, names, model="arc", start={**held, names[0]: gain}) for gain in _GAINS]
    found = min(fits, key=lambda each: each.score.mean)
    gains = {name: v for name, v in found.values.items() if name.startswith("bend_gain")}
    frame = frame or _frame(found)
    return ArcCalibration(
        gains=gains,
        frame=frame,
        point=frame.apply(found.predict(data)),
        converged=found.converged,
        message=found.whole_message,
    )


def _frame(found: Fit) -> Rigid:
    """Measuring frame to base frame."""
    place = np.array([found.values[f"base.{axis}"] for axis in _BASE])
    return Rigid.from_rotation_vector(place[3:], place[:3]).inverse()


# -- which parameters --------------------------------------------------------------------------


def arc_gains(robot: Robot) -> list[str]:
    """Names of the parameters of calibrated constant curvature."""
    return ["bend_gain.segments" if len(robot.segments) > 1 else "bend_gain"]


def rod_parameters(robot: Robot, data: Measurements) -> list[str]:
    """Names of the parameters of the calibrated rod: gain of displacements, or stiffness.

    One stiffness if all segments have the same value. A stiffness matrix has no single number to
    fit.
    """
    if not np.isnan(data.displacements).all():
        return ["gain"]
    values = [segment.backbone.E for segment in robot.segments]
    if len(set(values)) == 1 and values[0] is not None:
        return ["segments.*.backbone.E"]
    return [f"segments.{k}.backbone.E" for k, value in enumerate(values) if value is not None]


def _fit(robot: Robot, data: Measurements, names: list[str], theory: Theory) -> Fit:
    return fit(robot, data, names, model=RodModel(theory))


def _identifiable(
    robot: Robot, data: Measurements, names: list[str], theory: Theory, optional: list[str]
) -> tuple[Fit, list[str]]:
    """Fit, without friction if it is correlated with other parameters."""
    found = _fit(robot, data, names, theory)
    not_identifiable = {name for group in found.not_identifiable for name in group}
    drop = [name for name in optional if name in not_identifiable]
    if not drop:
        return found, []
    kept = [name for name in names if name not in drop]
    note = (
        "Friction is not identifiable from these data: it is correlated with other parameters and "
        "is held at the value of the robot file. Data of loading and unloading would identify it."
    )
    return _fit(robot, data, kept, theory), [note]


def _with_gravity(robot: Robot, data: Measurements, plain: Fit, theory: Theory) -> Fit | None:
    """Fit with gravity, if that explains clearly more."""
    names = [*plain.names, *(f"gravity.{i}" for i in range(3))]
    try:
        richer = _fit(robot, data, names, theory)
    except BowstringError:
        return None
    return richer if _clearly_better(plain, richer) else None


def _weighed(
    robot: Robot, data: Measurements, plain: Fit, richer: Fit, theory: Theory
) -> tuple[Fit, GravityFrom, bool, list[str]]:
    """Select a fit where gravity explains more; also whether another load acts, and notes."""
    real, like = _is_gravity(robot, richer)
    if any(robot.gravity):
        if real:
            note = (
                f"Gravity of {like}, explains the data clearly better, as where the base stands "
                "askew; it was taken over. A small load to one side looks alike."
            )
            return richer, "calibrated", False, [note]
        note = (
            f"A load like a gravity of {like}, would explain the data clearly better, but that is "
            "not how gravity can be: another load acts. The gravity of the robot file was kept."
        )
        return plain, "file", True, [note]
    held = _standing(robot, data, plain, _gravity(richer)[0], theory)
    earth = ""
    if held is not None:
        earth = f"({', '.join(f'{g + 0.0:.6g}' for g in held.robot.gravity)}) m/s2"
    if held is not None and not _clearly_better(held, richer):
        note = (
            f"The robot file has no gravity, the data do: like {like}. Earth's, {earth}, explains "
            "them as well and is held: assumed, not calibrated. Give gravity in the robot file."
        )
        return held, "assumed", False, [note]
    if real:
        note = (
            f"The robot file has no gravity, the data do: {like}, explains them clearly better "
            "than none and was taken over. A small load to one side looks alike. Give gravity in "
            "the robot file to hold it."
        )
        return richer, "calibrated", False, [note]
    note = (
        f"A load like a gravity of {like}, would explain the data clearly better, but that is not "
        "how gravity can be: another load acts. If the robot does stand so, give gravity in its "
        "file."
    )
    if held is None:
        return plain, "file", True, [note]
    why = f"Earth's gravity, {earth}, explains most of that and is held: assumed, not calibrated."
    return held, "assumed", True, [note, why]


def _is_gravity(robot: Robot, richer: Fit) -> tuple[bool, str]:
    """Whether the fitted gravity is plausible, and its description."""
    vector, covariance = _gravity(richer)
    size = max(float(np.linalg.norm(vector)), 1e-9)
    error = _spread(covariance, vector)
    said = np.array(robot.gravity)
    whole = float(np.linalg.norm(said))
    wanted = whole if whole > 0.0 else STANDARD_GRAVITY
    real = abs(size - wanted) <= 4.0 * error + _EARTHLY * wanted
    if whole > 0.0:
        beside = vector - said * float(vector @ said) / whole**2
        whose = "the robot file"
    elif abs(vector[2]) > math.sqrt(0.5) * size:
        beside = vector * [1.0, 1.0, 0.0]
        whose = "a robot hanging" if vector[2] > 0.0 else "a robot upright"
    else:
        beside = vector * [0.0, 0.0, 1.0]
        whose = "a robot lying"
    askew = math.degrees(math.asin(min(1.0, float(np.linalg.norm(beside)) / size)))
    if whole > 0.0 and float(vector @ said) < 0.0:
        askew = 180.0 - askew
    turned = math.degrees(_spread(covariance, beside) / size)
    like = f"{size:.2f} +- {error:.1g} m/s2, {askew:.2g} deg from that of {whose}"
    return real and askew <= _ASKEW + 3.0 * turned, like


def _standing(
    robot: Robot, data: Measurements, plain: Fit, like: Floats, theory: Theory
) -> Fit | None:
    """Fit in Earth's gravity, upright, hanging or horizontal; None if squares do not halve."""
    axis = np.array([0.0, 0.0, 1.0])
    upright = abs(like[2]) > math.sqrt(0.5) * float(np.linalg.norm(like))
    way = like * (axis if upright else 1.0 - axis)
    gravity = way * (STANDARD_GRAVITY / float(np.linalg.norm(way)))
    try:
        held = _fit(robot.with_({"gravity": gravity.tolist()}), data, plain.names, theory)
    except BowstringError:
        return None
    return held if held.converged and _squares(held) < 0.5 * _squares(plain) else None


def _clearly_better(plain: Fit, richer: Fit) -> bool:
    """Whether more parameters explain significantly more, by the F test."""
    if not richer.converged or richer.not_identifiable:
        return False
    before, after = _squares(plain), _squares(richer)
    more = len(richer.estimates) - len(plain.estimates)
    dof = 3 * richer.score_of_points.count - len(richer.estimates)
    if dof <= 0 or after >= before:
        return False
    return explained_p(before, after, more, dof) < EXTRA_LOAD


def _squares(found: Fit) -> float:
    return float(np.nansum(found.point_residuals[found.used] ** 2))


def _gravity(found: Fit) -> tuple[Floats, Floats]:
    """Fitted gravity (3,), m/s^2, and its covariance (3, 3)."""
    place = [found.names.index(f"gravity.{i}") for i in range(3)]
    vector = np.array([found.estimates[i].value for i in place])
    errors = np.array([found.estimates[i].standard_error for i in place])
    return vector, found.correlation[np.ix_(place, place)] * np.outer(errors, errors)


def _spread(covariance: Floats, direction: Floats) -> float:
    """Standard error along a direction."""
    size = float(np.linalg.norm(direction))
    return (
        math.sqrt(max(float(direction @ covariance @ direction), 0.0)) / size if size > 0.0 else 0.0
    )
