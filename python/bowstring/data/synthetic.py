"""Virtual bench: synthetic measurements of any robot, with known true parameters.

The *actual* robot, which differs from the nominal one (friction, stiffness), is actuated along a
path of loads by `bowstring.sweep`. Its tips are given in a misplaced measuring frame, with noise.
The path is solved once; noise can be drawn repeatedly. All results are labelled synthetic. All
values are in SI and radians.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field

import bowstring._core as _core
from bowstring.aliases import Floats, Ints
from bowstring.data.measurements import STANDARD_GRAVITY, Measurements, fill_table
from bowstring.data.rigid import Rigid
from bowstring.errors import InputError
from bowstring.files import json_files
from bowstring.files.atomic_io import check_parent, check_writable, folder_beside, resolved
from bowstring.files.json_files import Content, Triple, read_json, structured
from bowstring.robot.fields import numbers_in
from bowstring.robot.model import Robot, check_robot, with_tendons
from bowstring.robot.overrides import expand_all
from bowstring.statics import actuation, rod
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.statics.solution import Sweep
from bowstring.units import NUMBER, quote
from bowstring.validation import choice, floats, instance, is_whole, number, numbers, shown, whole

__all__ = [
    "NOISE",
    "STUDY",
    "TRUTH_SCHEMA_VERSION",
    "Actual",
    "Bench",
    "Instrument",
    "Loads",
    "Mounting",
    "check_table",
    "read_truth",
    "set_up",
    "simulate",
    "truth_file",
    "write",
]

GravityFrame = Literal["base", "measuring"]
Seed = int | np.random.Generator | None

TRUTH_SCHEMA_VERSION: Final = 1
NOISE: Final = 0.02e-3
"""Standard deviation of each coordinate, m. The study gives an accuracy of 0.020 mm for its arm,
without saying whether this is one standard deviation, which is assumed here."""
NOISE_DESCRIPTION: Final = "standard deviation of each coordinate; normal, independent"
_MOST_ROWS: Final = 1_000_000
_AT_ONCE: Final = 100  # rows between two reports of progress
_FAR: Final = 1e6  # m
_HEAVY: Final = 1e9  # kg
_SHARE: Final = re.compile(rf"({NUMBER})\s*%")
_MOST_DIFFERENCES: Final = 1_000_000
_MOST_TRUTH: Final = 500_000_000  # bytes
_HEAD: Final = 2000  # bytes at the beginning of a file that are searched for our mark
_MADE: Final = "Made by the virtual bench of Bowstring"


# -- the bench ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Bench:
    """Solved path of loads, ready to be measured; made by `set_up`.

    It has n rows in the order of the path and T tendons.
    """

    robot: Robot
    """Nominal robot, as the user knows it."""
    actual: Robot
    """Actual robot."""
    tensions: Floats
    """Tensions (n, T), N; NaN where a tendon is displacement-controlled."""
    displacements: Floats
    """Tendon displacements (n, T), m; NaN where a tendon is tension-controlled."""
    group: NDArray[np.str_]
    """Labels (n,), loading or unloading; empty without unloading."""
    repeat: Ints
    """Numbers of the repeats (n,), from 1."""
    time: Floats | None
    """Times (n,) since the first row, s; None without a period."""
    tip_position: Floats
    """Tips of the actual robot (n, 3), m, base frame."""
    tip_rotation: Floats
    """Rotations of the tips (n, 3, 3), body to base."""
    points: Floats
    """Measured points without noise (n, 3), m, measuring frame."""
    frame: Rigid
    """Motion from measuring frame to base frame, as `bowstring.data.registration` fits it."""
    tool: Floats
    """Stated offset of the measured point from the tip (3,), in the tip's axes, m."""
    noise: float
    """Standard deviation of each coordinate, m."""
    truth: dict[str, Any]
    """All parameters for JSON except the seed; see `write`."""

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"<Bench of {self.robot.name}: {len(self)} rows, synthetic>"

    @property
    def hysteresis(self) -> float | None:
        """Largest distance of the tip between loading and unloading under one load, m.

        None without unloading.
        """
        if not (self.group == "unloading").any():
            return None
        first = self.tip_position[self.repeat == 1]
        count = (len(first) + 1) // 2
        return float(np.linalg.norm(first[:count] - first[: -count - 1 : -1], axis=1).max())

    def measure(self, seed: Seed = 0) -> Measurements:
        """Measure all rows once, with new noise.

        Parameters
        ----------
        seed : int, Generator or None
            A number gives reproducible noise, None different noise each time.

        Returns
        -------
        Measurements
            Synthetic measurements with `truth`.

        Raises
        ------
        InputError
            If the seed is invalid.
        """
        if isinstance(seed, np.random.Generator):
            rng, recorded = seed, None
        elif seed is None or (is_whole(seed) and seed >= 0):
            rng, recorded = np.random.default_rng(seed), None if seed is None else int(seed)
        else:
            raise InputError(f"seed is {shown(seed)}, it must be a whole number from 0, or None")
        points, n = self.points, len(self)
        if self.noise:
            points = points + self.noise * rng.standard_normal((n, 3))
        return Measurements(
            source="synthetic",
            name=f"{self.robot.name}, virtual bench",
            tensions=self.tensions,
            displacements=self.displacements,
            points=points[:, None],
            line=np.arange(1, n + 1),
            group=self.group,
            repeat=self.repeat,
            sigma=np.full(n, self.noise) if self.noise else None,
            time=self.time,
            tool=self.tool,
            truth={**self.truth, "seed": recorded},
        )


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of a bench in order, and number of repeats.

    Parameters
    ----------
    tensions, displacements : array_like (K, T), optional
        Commands in N or m, as in `bowstring.Load`; NaN where a tendon has the other one.
    masses : array_like (K,), optional
        Instead of these: masses in kg hung on one tendon, none on the others.
    tendon : int
        Number of that tendon, from 1.
    g : float
        Gravitational acceleration that converts masses to tensions, m/s^2.
    repeats : int
        Number of passes through the loads; the path, and with it the state of friction, continues.
    unload : bool
        Whether each pass returns to the first load; the largest load is measured once.
    period : float, optional
        Time from row to row, s; rows have no times without it. Relaxation and creep need it.
        Commands are linear in time in between; the first row is at once after the home pose.
    """

    tensions: actuation.Given | None = None
    displacements: actuation.Given | None = None
    masses: ArrayLike | None = None
    tendon: int = 1
    g: float = STANDARD_GRAVITY
    repeats: int = 1
    unload: bool = True
    period: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.unload, bool):
            raise InputError.of("unload", shown(self.unload), "True or False")
        whole("repeats", self.repeats, 1, _MOST_ROWS)
        if self.period is not None:
            number("period", self.period, "s")


@dataclass(frozen=True, eq=False)
class Actual:
    """Differences of the actual robot and its surroundings from the nominal ones.

    Parameters
    ----------
    friction : float, optional
        Friction coefficient of all tendons of the actual robot.
    changes : mapping from path to value, optional
        Further differences, as for `Robot.with_`; text such as ``"+5 %"`` is relative to the
        nominal value: ``{"segments.0.backbone.E": "+5 %"}``.
    gravity : array_like (3,), optional
        Gravity in m/s^2; that of the robot if left out.
    gravity_frame : {"base", "measuring"}
        Axes in which gravity is given. In base axes it tilts with the base; in measuring axes,
        those of a levelled device, it acts obliquely on a tilted robot.
    tip_force : array_like (3,)
        Disturbance that no model contains: dead force at the tip, base axes, N.
    theory : {"cosserat", "kirchhoff"}
        Rod theory of the actual robot.
    """

    friction: float | None = None
    changes: Mapping[str, Any] | None = None
    gravity: ArrayLike | None = None
    gravity_frame: GravityFrame = "base"
    tip_force: ArrayLike = (0.0, 0.0, 0.0)
    theory: Literal["cosserat", "kirchhoff"] = "cosserat"


@dataclass(frozen=True, eq=False)
class Mounting:
    """Pose of the base in the measuring frame.

    Parameters
    ----------
    base : Rigid, optional
        Pose of the base in the measuring frame (base to measuring), instead of the next three.
    tilt, tilt_towards : float
        Tilt angle of the base, and its direction from x counter-clockwise, rad.
    shift : array_like (3,)
        Position of the base in the measuring frame, m.
    drift : array_like (3,)
        Disturbance that no model contains: displacement of the base at the last row, growing
        evenly over the rows, measuring frame, m.
    """

    base: Rigid | None = None
    tilt: float = 0.0
    tilt_towards: float = 0.0
    shift: ArrayLike = (0.0, 0.0, 0.0)
    drift: ArrayLike = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Instrument:
    """Instrument that measures the tip.

    Parameters
    ----------
    noise : float
        Standard deviation of each measured coordinate, m; normal and isotropic.
    tool : array_like (3,)
        Offset of the measured point from the tip, in the tip's axes, m; stated in the data.
    tool_error : array_like (3,)
        Error of that offset, which is not stated in the data, m.
    """

    noise: float = NOISE
    tool: ArrayLike = (0.0, 0.0, 0.0)
    tool_error: ArrayLike = (0.0, 0.0, 0.0)


STUDY: Final[dict[str, Any]] = {
    "loads": Loads(masses=tuple(0.5 * i for i in range(17)), repeats=3),
    "actual": Actual(friction=0.1, gravity=(0.0, 0.0, -9.81)),
    "mounting": Mounting(tilt=math.radians(0.3)),
    "instrument": Instrument(),
}
"""Bench with the loads of the study, 0:0.5:8 kg on cable 1, and usual disturbances:
``simulate(robot, **STUDY)``. Friction, gravity and tilt are assumed; the study gives none."""


def set_up(
    robot: Robot,
    loads: Loads,
    *,
    actual: Actual | None = None,
    mounting: Mounting | None = None,
    instrument: Instrument | None = None,
    progress: Callable[[float], None] | None = None,
) -> Bench:
    """Solve the actual robot along the loads, and map its tips to the measuring frame.

    Parameters
    ----------
    robot : Robot
        Nominal robot.
    loads : Loads
    actual : Actual, optional
    mounting : Mounting, optional
    instrument : Instrument, optional
    progress : callable, optional
        Progress callback, called with the solved share of a path; not called for independent loads.

    Returns
    -------
    Bench

    Raises
    ------
    InputError
        If an argument is wrong; nothing is solved then.
    NoSolutionError
        If a load has no solution.
    """
    check_robot(robot)
    actual, mounting = instance("actual", actual, Actual), instance("mounting", mounting, Mounting)
    instrument = instance("instrument", instrument, Instrument)
    theory, gravity_frame = actual.theory, actual.gravity_frame
    by_tension, by_displacement, record = _loads(robot, loads)
    rows, group, repeat = _path(len(by_tension), int(loads.repeats), loads.unload)
    sigma = number("noise", instrument.noise, "m", zero=True)
    _lengths("noise", (sigma, 0.0, 0.0))
    other = _actual(robot, actual.friction, actual.changes)
    gravity = other.gravity if actual.gravity is None else actual.gravity
    given = numbers("gravity", gravity, (3,), "m/s^2")
    pose = _pose(mounting)
    choice("gravity_frame", gravity_frame, ("base", "measuring"))
    felt = given if gravity_frame == "base" else pose.rotation.T @ given
    said = _lengths("tool", instrument.tool)
    there = said + _lengths("tool_error", instrument.tool_error)
    force = numbers("tip_force", actual.tip_force, (3,), "N")
    moves = _lengths("drift", mounting.drift)

    commands = by_tension[rows], by_displacement[rows]
    tensions, displacements = (None if np.isnan(table).all() else table for table in commands)
    load = Load(tensions, displacements, gravity=felt, tip_force=force)
    time = None if loads.period is None else loads.period * np.arange(len(rows), dtype=float)
    if other.is_viscoelastic and time is None:
        raise InputError(
            f"{other.name} has relaxation or creep, which need the time from row to row; give the "
            "loads a period",
            argument="period",
        )
    tip_position, tip_rotation = _tips(other, load, RodModel(theory), time, len(rows), progress)
    points = pose.apply(tip_position + tip_rotation @ there)
    points = points + np.linspace(0.0, 1.0, len(rows))[:, None] * moves
    x, y, z = pose.rotation[:, 2].tolist()
    lean = math.atan2(math.hypot(x, y), z)
    truth = {
        "schema_version": TRUTH_SCHEMA_VERSION,
        "source": "synthetic",
        "bowstring_version": str(_core.__version__),
        "robot": robot.name,
        "robot_hash": robot.hash,
        "actual_robot_hash": other.hash,
        "differences": list(_differences(_tree(robot), _tree(other))),
        "actual_robot": _tree(other),
        "theory": theory,
        "loads": {
            **record,
            "repeats": int(loads.repeats),
            "unload": loads.unload,
            "period_s": loads.period,
        },
        "gravity_m_per_s2": given.tolist(),
        "gravity_frame": gravity_frame,
        "gravity_in_base_m_per_s2": felt.tolist(),
        "base": pose.to_dict(),
        "frame": pose.inverse().to_dict(),
        "tilt_rad": lean,
        "tilt_towards_rad": math.atan2(y, x) if lean > 1e-12 else 0.0,
        "tool_m": said.tolist(),
        "actual_tool_m": there.tolist(),
        "noise_m": sigma,
        "noise_description": NOISE_DESCRIPTION,
        "disturbances": {"tip_force_N": force.tolist(), "drift_m": moves.tolist()},
        "rows": {"tip_position_m": tip_position.tolist(), "point_m": points.tolist()},
    }
    return Bench(
        robot=robot,
        actual=other,
        tensions=commands[0],
        displacements=commands[1],
        group=group,
        repeat=repeat,
        time=time,
        tip_position=tip_position,
        tip_rotation=tip_rotation,
        points=points,
        frame=pose.inverse(),
        tool=said,
        noise=sigma,
        truth=truth,
    )


def _tips(
    robot: Robot,
    load: Load,
    model: RodModel,
    time: Floats | None,
    count: int,
    progress: Callable[[float], None] | None,
) -> tuple[Floats, Floats]:
    """Positions and rotations of the tip along the loads.

    With progress a path is solved in pieces, with identical results; with delays of drives it is
    not divided.
    """
    found: list[Sweep] = []
    whole = actuation.is_by_tensions(robot, load) or robot.tendons.delay_s.any()
    if progress is not None and not whole:
        for first in range(0, count, _AT_ONCE):
            progress(first / count)
            rows = slice(first, first + _AT_ONCE)
            piece = load.replace(
                tensions=None if load.tensions is None else load.tensions[rows],
                displacements=None if load.displacements is None else load.displacements[rows],
            )
            before, since = (found[-1].history(), first - 1) if found else (None, None)
            own = None if time is None else time[rows] - (0.0 if since is None else time[since])
            found.append(
                rod.sweep(robot, load=piece, model=model, history=before, times=own, disks=False)
            )
            stable = robot.has_memory or all(found[-1].stable)
            if not (found[-1].converged.all() and stable):  # the warning is for the whole path
                found.clear()
                break
    if not found:
        whole_path = rod.sweep(robot, load=load, model=model, times=time, disks=False)
        found = [whole_path.raise_for_status()]
    return (
        np.concatenate([part.tip_position for part in found]),
        np.concatenate([part.tip_rotation for part in found]),
    )


def simulate(
    robot: Robot,
    loads: Loads,
    *,
    actual: Actual | None = None,
    mounting: Mounting | None = None,
    instrument: Instrument | None = None,
    seed: Seed = 0,
) -> Measurements:
    """Make synthetic measurements of a robot.

    Parameters
    ----------
    robot : Robot
        As for `set_up`.
    loads : Loads
        As for `set_up`.
    actual : Actual, optional
        As for `set_up`.
    mounting : Mounting, optional
        As for `set_up`.
    instrument : Instrument, optional
        As for `set_up`.
    seed : int, Generator or None
        As for `Bench.measure`.

    Returns
    -------
    Measurements
        Measurements with the source "synthetic" and points in the measuring frame;
        `Measurements.truth` has the true parameters.

    Raises
    ------
    InputError
        If an argument is wrong; nothing is solved then.
    NoSolutionError
        If a load has no solution.

    Examples
    --------
    The study's bench with usual disturbances:

    >>> import bowstring as bs
    >>> from bowstring.data import synthetic
    >>> data = synthetic.simulate(bs.load_robot("amouri2019"), **synthetic.STUDY)
    >>> data.source, len(data), data.truth["differences"][0]["actual"]
    ('synthetic', 99, 0.1)
    """
    made = set_up(robot, loads, actual=actual, mounting=mounting, instrument=instrument)
    return made.measure(seed)


# -- actuation and measuring frame -----------------------------------------------------------------


def _loads(robot: Robot, given: Loads) -> tuple[Floats, Floats, dict[str, Any]]:
    """Tensions and displacements (K, T), NaN where there is none, and their record for `truth`."""
    if not isinstance(given, Loads):
        raise InputError.of("loads", shown(given), "a Loads")
    tensions, displacements, masses = given.tensions, given.displacements, given.masses
    tendon, count = given.tendon, len(robot.tendons.angle_rad)
    gravity = number("g", given.g, "m/s^2")
    if not is_whole(tendon) or not 1 <= tendon <= count:
        raise InputError(
            f"tendon is {shown(tendon)}, it must be a whole number from 1 to {count}, the tendons "
            f"of {robot.name}"
        )
    if masses is None:
        said = {"tensions": tensions, "displacements": displacements}
        by = " and ".join(name for name, value in said.items() if value is not None)
        if not by:
            raise InputError(
                "there is no load: give tensions or displacements (K, T), or masses (K,) on a "
                "tendon"
            )
        by_displacement, values = actuation.given(robot, Load(tensions, displacements), rows=True)
        if not len(values):
            raise InputError("there is no load: the table has no row")
        return (
            np.where(by_displacement, np.nan, values),
            np.where(by_displacement, values, np.nan),
            {"by": by},
        )
    if tensions is not None or displacements is not None:
        raise InputError(
            "masses are given, and tensions or displacements as well; give one of them"
        )
    try:
        hung = floats(masses)
    except TypeError:
        hung = np.empty(0)
    if hung.ndim != 1 or not len(hung):
        raise InputError(f"masses is {shown(masses)}, it must be a list of numbers in kg")
    wrong = np.flatnonzero(~((hung >= 0) & (hung <= _HEAVY)))
    if len(wrong):
        raise InputError(
            f"masses: number {wrong[0] + 1} is {hung[wrong[0]]:g} kg, it must be from 0 to "
            f"{_HEAVY:g} kg"
        )
    table = np.zeros((len(hung), count))
    table[:, tendon - 1] = gravity * hung
    about = {"by": "masses", "masses_kg": hung.tolist(), "tendon": int(tendon)}
    return table, np.full_like(table, np.nan), {**about, "g_m_per_s2": gravity}


def _path(count: int, repeats: int, unload: bool) -> tuple[Ints, NDArray[np.str_], Ints]:
    """Load index, group and repeat of each row."""
    way = np.arange(count)
    label = np.full(count, "loading" if unload else "")
    if unload:
        way = np.concatenate([way, way[-2::-1]])
        label = np.concatenate([label, np.full(count - 1, "unloading")])
    if len(way) * repeats > _MOST_ROWS:
        raise InputError(
            f"{len(way)} loads {repeats} times are {len(way) * repeats} rows; up to {_MOST_ROWS} "
            "are possible"
        )
    run = np.repeat(np.arange(1, repeats + 1), len(way))
    return np.tile(way, repeats), np.tile(label, repeats), run


def _pose(mounting: Mounting) -> Rigid:
    """Pose of the base in the measuring frame."""
    base, towards = mounting.base, mounting.tilt_towards
    moved = _lengths("shift", mounting.shift)
    angle = number("tilt", mounting.tilt, "rad", zero=True)
    if angle > math.pi:
        raise InputError.of("tilt", f"{angle:g} rad", "up to pi")
    if not isinstance(towards, (float, int, np.number)) or not math.isfinite(towards):
        raise InputError(f"tilt_towards is {shown(towards)}, it must be a finite number in rad")
    direction = float(towards)
    if base is None:
        axis = [-math.sin(direction), math.cos(direction), 0.0]
        return Rigid.from_rotation_vector(np.multiply(angle, axis), moved)
    instance("base", base, Rigid)
    if angle or direction or moved.any():
        raise InputError("give either base, or tilt and shift, not both")
    return base


def _lengths(name: str, value: ArrayLike) -> Floats:
    """Check a vector in m, small enough for all results to be finite."""
    found = numbers(name, value, (3,), "m")
    if np.abs(found).max() > _FAR:
        raise InputError.of(name, f"{np.abs(found).max():g} m", f"up to {_FAR:g} m")
    return found


# -- the actual robot ----------------------------------------------------------------------------


def _actual(robot: Robot, friction: float | None, changes: Mapping[str, Any] | None) -> Robot:
    """Make the actual robot."""
    found = robot
    if friction is not None:
        found = with_tendons(robot, {"friction": number("friction", friction, zero=True)})
    if changes is None:
        return found
    if not isinstance(changes, Mapping):
        raise InputError(f"actual is {shown(changes)}, it must be a mapping from path to value")
    tree = _tree(found)
    try:
        each = expand_all(tree, changes)
        values = {path: _share_of(tree, path, value, robot) for path, value in each.items()}
        found = found.with_(values)
    except InputError as error:
        raise InputError(str(error), argument="actual") from None
    before, after = len(robot.tendons.angle_rad), len(found.tendons.angle_rad)
    if before != after:
        raise InputError(
            f"the actual robot has {after} tendons and {robot.name} {before}; their number cannot "
            "differ"
        )
    return found


def _share_of(tree: Any, path: Any, value: Any, robot: Robot) -> Any:
    """Convert a value for `Robot.with_`; "+5 %" is relative to the nominal value."""
    match = _SHARE.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        return value
    if match[1][0] not in "+-":
        raise InputError(
            f"actual: {path} is {quote(value)}; write by how much it differs, with its sign, as in "
            '"+5 %", or the value'
        )
    here = dict(numbers_in(tree)).get(re.sub(r"\[([0-9]+)\]", r".\1", str(path)))
    if here is None:
        raise InputError(
            f"actual: {path} is {quote(value)}, but {robot.name} has no number there to take a "
            "share of; write the value"
        )
    return here * (1.0 + float(match[1]) / 100.0)


def _tree(robot: Robot) -> dict[str, Any]:
    """Tree of a robot's fields for `Robot.with_`, in SI."""
    return robot.model_dump(mode="json", exclude_none=True)


def _differences(nominal: Any, actual: Any, path: str = "") -> Iterator[dict[str, Any]]:
    """Yield every field in which two robots differ."""
    if isinstance(nominal, dict) and isinstance(actual, dict):
        keys: Sequence[Any] = sorted({*nominal, *actual})
        pairs = [(key, nominal.get(key), actual.get(key)) for key in keys]
    elif isinstance(nominal, list) and isinstance(actual, list) and len(nominal) == len(actual):
        pairs = list(zip(range(len(nominal)), nominal, actual, strict=True))
    else:
        if nominal != actual:
            yield {"path": path, "nominal": nominal, "actual": actual}
        return
    for key, mine, its in pairs:
        yield from _differences(mine, its, f"{path}.{key}" if path else str(key))


# -- files ---------------------------------------------------------------------------------------


def truth_file(path: str | Path) -> Path:
    """Path of the true parameters of a table: bench.truth.json beside bench.csv."""
    return Path(path).with_suffix(".truth.json")


def check_table(path: str | Path) -> Path:
    """Check before any work that a bench may be written to a table.

    Parameters
    ----------
    path : str or Path
        A .csv file in an existing folder; a former synthetic table there will be replaced.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If its folder cannot be written, or another file, such as measured data, exists at its path
        or that of the truth.
    """
    try:
        file = resolved(path, f"cannot write the bench to {quote(str(path))}")
        why = f"cannot write the bench to {file}"
        if file.suffix.lower() != ".csv":
            raise InputError(f"{why}: a table ends in .csv; name for example bench.csv")
        check_parent(file, why)
        check_writable(file, why)
        marks = (f"# {_MADE}", '"source": "synthetic"')
        for place, mark in zip((file, truth_file(file)), marks, strict=True):
            if not place.exists():
                continue
            if not place.is_file():
                raise InputError(f"{why}: {place} is no file")
            with place.open("rb") as former:
                if mark.encode() not in former.read(_HEAD):
                    raise InputError(
                        f"{why}: {place.name} is there and was not made by a virtual bench, and "
                        "existing files are not overwritten; name another file"
                    )
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or "its name is not valid"
        raise InputError(f"cannot write the bench to {quote(str(path))}: {reason}") from None
    return file


def write(measurements: Measurements, path: str | Path) -> tuple[Path, Path]:
    """Write a bench as a table in the tidy format, and its true parameters as JSON beside it.

    The label *synthetic* is in the first line of the table and in every row; a comment contains the
    true parameters as well, so that they stay with the data.

    Parameters
    ----------
    measurements : Measurements
        Measurements from `simulate` or `Bench.measure`.
    path : str or Path
        Path of the table, .csv. Table and truth are written whole or not at all.

    Returns
    -------
    tuple of Path
        Paths of table and truth.

    Raises
    ------
    InputError
        If the measurements are not from a virtual bench, or as in `check_table`.
    """
    truth = measurements.truth
    if measurements.source != "synthetic" or truth is None:
        raise InputError(f"{measurements.name} is not of a virtual bench, it has no known truth")
    file = check_table(path)
    beside = truth_file(file)
    short = {k: v for k, v in truth.items() if k not in ("rows", "actual_robot")}
    comments = [
        f"{_MADE} {truth['bowstring_version']}; nothing here was measured.",
        f"sigma_mm is one {NOISE_DESCRIPTION}."
        if measurements.sigma is not None
        else "There is no noise.",
        f"truth: {json.dumps(short, allow_nan=False)}",
    ]
    try:
        with folder_beside(file) as work:
            new = work / file.name
            fill_table(new, measurements, comments)
            data = {"file": file.name, "sha256": hashlib.sha256(new.read_bytes()).hexdigest()}
            text = json.dumps({**truth, "data": data}, allow_nan=False)
            (work / beside.name).write_text(text + "\n", "utf-8")
            check_table(file)
            former, had = work / "old" / beside.name, beside.exists()
            try:
                if had:  # restored by `remove_leftovers` if the process is killed
                    former.parent.mkdir()
                    os.replace(beside, former)
                os.replace(work / beside.name, beside)
                os.replace(new, file)
            except BaseException:  # leave no truth without its table
                if former.exists():
                    os.replace(former, beside)
                elif not had:
                    beside.unlink(missing_ok=True)
                raise
    except OSError as error:
        raise InputError(f"cannot write the bench to {file}: {error.strerror}") from None
    return file, beside


class _Rows(Content):
    tip_position_m: json_files.Table
    point_m: json_files.Table


class _Motion(Content):
    rotation: Annotated[list[Triple], Field(min_length=3, max_length=3)]
    rotation_vector_rad: Triple
    translation_m: Triple


class _Difference(Content):
    path: str
    nominal: Any
    actual: Any


class _Disturbances(Content):
    tip_force_N: Triple
    drift_m: Triple


class _Table(Content):
    file: str
    sha256: str


class _Truth(Content):
    """Structure of the file of a truth."""

    robot: str
    robot_hash: str
    actual_robot_hash: str
    differences: Annotated[list[_Difference], Field(max_length=_MOST_DIFFERENCES)]
    actual_robot: dict[str, Any]
    theory: str
    loads: dict[str, Any]
    gravity_m_per_s2: Triple
    gravity_frame: Literal["base", "measuring"]
    gravity_in_base_m_per_s2: Triple
    base: _Motion
    frame: _Motion
    tilt_rad: float
    tilt_towards_rad: float
    tool_m: Triple
    actual_tool_m: Triple
    noise_m: Annotated[float, Field(ge=0.0)]
    seed: int
    disturbances: _Disturbances
    rows: _Rows
    data: _Table


def read_truth(path: str | Path) -> dict[str, Any]:
    """Read the true parameters beside the table of a virtual bench.

    Parameters
    ----------
    path : str or Path
        Path of the table.

    Returns
    -------
    dict

    Raises
    ------
    InputError
        If the file is missing, or belongs to another table.
    """
    table, file = Path(path), truth_file(path)
    try:
        truth = read_json(file, _MOST_TRUTH)
        digest = hashlib.sha256(table.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{error.filename} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InputError(f"{file} is no truth of a virtual bench: {error}") from None
    if truth.get("source") != "synthetic":
        raise InputError(f"{file} is no truth of a virtual bench")
    if truth.get("schema_version") != TRUTH_SCHEMA_VERSION:
        raise InputError(
            f"{file} has schema_version {quote(truth.get('schema_version'))}, this version of "
            f"Bowstring reads {TRUTH_SCHEMA_VERSION}"
        )
    try:
        structured(truth, _Truth)
    except ValueError as error:
        raise InputError(f"{file} is damaged: {error}") from None
    if truth["data"]["sha256"] != digest:
        raise InputError(f"{file} is the truth of another table than {table}, or it was changed")
    return truth
