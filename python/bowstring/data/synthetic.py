"""The virtual bench: synthetic measurements of any robot, with known truth.

The *actual* robot, which differs from the one that the user knows (friction, stiffness), is
actuated along a path of loads by `bowstring.sweep`; its tips are seen from a misplaced measuring
frame, with noise. The path is solved once, after which noise is drawn as often as wanted. What
comes out is synthetic, and says so. SI and radians.
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
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bowstring._core as _core
from bowstring.atomic_io import check_parent, folder_beside, readable, resolved
from bowstring.data.measurements import STANDARD_GRAVITY, Measurements, write_measurements
from bowstring.data.rigid import Rigid
from bowstring.errors import InputError
from bowstring.robot.model import Robot, check_robot, with_tendons
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

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
GravityFrame = Literal["base", "measuring"]
Seed = int | np.random.Generator | None

TRUTH_SCHEMA_VERSION: Final = 1
NOISE: Final = 0.02e-3
"""m, of each coordinate: the study's arm is accurate to 0.020 mm; it does not say whether this is
one standard deviation, which is how it is taken here."""
NOISE_IS: Final = "standard deviation of each coordinate; normal, independent"
_MOST_ROWS: Final = 1_000_000
_AT_ONCE: Final = 100  # rows between two reports of progress
_FAR: Final = 1e6  # m
_HEAVY: Final = 1e9  # kg
_SHARE: Final = re.compile(rf"({NUMBER})\s*%")
_MOST_TRUTH: Final = 500_000_000  # bytes
_HEAD: Final = 2000  # bytes in which a file of ours is known
_MADE: Final = "Made by the virtual bench of Bowstring"


# -- the bench ---------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Bench:
    """A path of loads that is solved, ready to be measured; made by `set_up`.

    n rows in the order of the path, T tendons.
    """

    robot: Robot
    """As its user knows it."""
    actual: Robot
    """As it is."""
    tensions: Floats
    """(n, T), N; NaN where a tendon is displacement-controlled."""
    displacements: Floats
    """(n, T), m; NaN where a tendon is tension-controlled."""
    group: NDArray[np.str_]
    """(n,), loading and unloading; empty if nothing is unloaded."""
    repeat: Ints
    """(n,), from 1."""
    tip_position: Floats
    """(n, 3), m, of the actual robot, base frame."""
    tip_rotation: Floats
    """(n, 3, 3), body to base."""
    points: Floats
    """(n, 3), m, what would be measured without noise, measuring frame."""
    frame: Rigid
    """Measuring frame to base frame, as `bowstring.data.registration` finds it."""
    tool: Floats
    """(3,), m, where the measured point is said to be, seen from the tip, in its axes."""
    noise: float
    """m, standard deviation of each coordinate."""
    truth: dict[str, Any]
    """All of it for JSON, but the seed; see `write`."""

    def __len__(self) -> int:
        return len(self.points)

    def __repr__(self) -> str:
        return f"<Bench of {self.robot.name}: {len(self)} rows, synthetic>"

    @property
    def hysteresis(self) -> float | None:
        """Largest distance of the tip between loading and unloading under one load, m.

        None if nothing is unloaded.
        """
        if not (self.group == "unloading").any():
            return None
        first = self.tip_position[self.repeat == 1]
        count = (len(first) + 1) // 2
        return float(np.linalg.norm(first[:count] - first[: -count - 1 : -1], axis=1).max())

    def measure(self, seed: Seed = 0) -> Measurements:
        """Measure all rows once, with noise of its own.

        Parameters
        ----------
        seed : int, Generator or None
            A number gives the same noise every time, None another one each time.

        Returns
        -------
        Measurements
            Synthetic, with `truth`.

        Raises
        ------
        InputError
            If the seed is none.
        """
        if isinstance(seed, np.random.Generator):
            rng, told = seed, None
        elif seed is None or (is_whole(seed) and seed >= 0):
            rng, told = np.random.default_rng(seed), None if seed is None else int(seed)
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
            tool=self.tool,
            truth={**self.truth, "seed": told},
        )


@dataclass(frozen=True, eq=False)
class Loads:
    """The loads of a bench in order, and how often they are run through.

    Parameters
    ----------
    tensions, displacements : array_like (K, T), optional
        In N or m, as of `bowstring.Load`; NaN where a tendon has the other.
    masses : array_like (K,), optional
        Instead of these: kg hung on one tendon, nothing on the others.
    tendon : int
        On which, from 1.
    g : float
        Gravity that makes tensions of masses, m/s^2.
    repeats : int
        How often the loads are run through; the path goes on, and so does the history of friction.
    unload : bool
        Each time also back to the first load; the last one is measured once.
    """

    tensions: actuation.Given | None = None
    displacements: actuation.Given | None = None
    masses: ArrayLike | None = None
    tendon: int = 1
    g: float = STANDARD_GRAVITY
    repeats: int = 1
    unload: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.unload, bool):
            raise InputError.of("unload", shown(self.unload), "True or False")
        whole("repeats", self.repeats, 1, _MOST_ROWS)


@dataclass(frozen=True, eq=False)
class Actual:
    """In what the actual robot and its surroundings differ from what the user knows.

    Parameters
    ----------
    friction : float, optional
        Of all tendons of the actual robot, in place of the robot's own.
    changes : mapping from path to value, optional
        In what else the actual robot differs, as for `Robot.with_`; a text such as ``"+5 %"`` is a
        share of the robot's own number: ``{"segments.0.backbone.E": "+5 %"}``.
    gravity : array_like (3,), optional
        m/s^2; the robot's own if left out.
    gravity_frame : {"base", "measuring"}
        In whose axes gravity is given: turns with the robot when the base is tilted, or stays plumb
        on a levelled measuring device, so that a tilted robot feels it aslant.
    tip_force : array_like (3,)
        A disturbance that no model has: a dead force at the tip, base axes, N.
    theory : {"cosserat", "kirchhoff"}
        Of the rod that is solved.
    """

    friction: float | None = None
    changes: Mapping[str, Any] | None = None
    gravity: ArrayLike | None = None
    gravity_frame: GravityFrame = "base"
    tip_force: ArrayLike = (0.0, 0.0, 0.0)
    theory: Literal["cosserat", "kirchhoff"] = "cosserat"


@dataclass(frozen=True, eq=False)
class Mounting:
    """Where the base is in the measuring frame.

    Parameters
    ----------
    base : Rigid, optional
        The robot's base in the measuring frame (base to measuring); instead of the next three.
    tilt, tilt_towards : float
        Angle by which the base leans, and where to, from x counter-clockwise, rad.
    shift : array_like (3,)
        Of the base in the measuring frame, m.
    drift : array_like (3,)
        A disturbance that no model has: how far the base has moved at the last row, evenly over
        the rows, measuring frame, m.
    """

    base: Rigid | None = None
    tilt: float = 0.0
    tilt_towards: float = 0.0
    shift: ArrayLike = (0.0, 0.0, 0.0)
    drift: ArrayLike = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Instrument:
    """What measures the tip.

    Parameters
    ----------
    noise : float
        Standard deviation of each measured coordinate, m; normal, the same to all sides.
    tool : array_like (3,)
        Measured point seen from the tip, in its axes, m; the data say so.
    tool_error : array_like (3,)
        By how much it is elsewhere, which the data do not say, m.
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
"""The loads of the study, 0:0.5:8 kg on cable 1, as a bench with all that disturbs one:
``simulate(robot, **STUDY)``. Friction, gravity and tilt are assumed, the study gives none."""


def set_up(
    robot: Robot,
    loads: Loads,
    *,
    actual: Actual | None = None,
    mounting: Mounting | None = None,
    instrument: Instrument | None = None,
    progress: Callable[[float], None] | None = None,
) -> Bench:
    """Solve the actual robot along the loads, and see it from the measuring frame.

    Parameters
    ----------
    robot : Robot
        As its user knows it.
    loads : Loads
    actual : Actual, optional
    mounting : Mounting, optional
    instrument : Instrument, optional
    progress : callable, optional
        Called with the share of the loads that is solved, where each load is a step from the one
        before; else nobody knows it.

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
    by_tension, by_displacement, told = _loads(robot, loads)
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
    tip_position, tip_rotation = _tips(other, load, RodModel(theory), len(rows), progress)
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
        "loads": {**told, "repeats": int(loads.repeats), "unload": loads.unload},
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
        "noise_is": NOISE_IS,
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
    count: int,
    progress: Callable[[float], None] | None,
) -> tuple[Floats, Floats]:
    """Positions and rotations of the tip along the loads.

    With progress a path is solved in pieces, which changes no number.
    """
    found: list[Sweep] = []
    if progress is not None and not actuation.is_by_tensions(robot, load):
        for first in range(0, count, _AT_ONCE):
            progress(first / count)
            rows = slice(first, first + _AT_ONCE)
            piece = load.replace(
                tensions=None if load.tensions is None else load.tensions[rows],
                displacements=None if load.displacements is None else load.displacements[rows],
            )
            before = found[-1].history() if found else None
            found.append(rod.sweep(robot, load=piece, model=model, history=before, disks=False))
            stable = robot.has_friction or all(found[-1].stable)
            if not (found[-1].converged.all() and stable):  # which is said of the whole
                found.clear()
                break
    if not found:
        found = [rod.sweep(robot, load=load, model=model, disks=False).raise_for_status()]
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
        Source "synthetic", points in the measuring frame; `Measurements.truth` says with what they
        were made.

    Raises
    ------
    InputError
        If an argument is wrong; nothing is solved then.
    NoSolutionError
        If a load has no solution.

    Examples
    --------
    The study's bench, but with all that disturbs one:

    >>> import bowstring as bs
    >>> from bowstring.data import synthetic
    >>> data = synthetic.simulate(bs.load_robot("amouri2019"), **synthetic.STUDY)
    >>> data.source, len(data), data.truth["differences"][0]["actual"]
    ('synthetic', 99, 0.1)
    """
    made = set_up(robot, loads, actual=actual, mounting=mounting, instrument=instrument)
    return made.measure(seed)


# -- what is actuated, and from where it is seen ---------------------------------------------------


def _loads(robot: Robot, given: Loads) -> tuple[Floats, Floats, dict[str, Any]]:
    """Tensions and displacements (K, T), NaN where there is none, and what the truth says of it."""
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
        by_displacement, values = actuation.commands(
            robot, Load(tensions, displacements), rows=True
        )
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
    """Which load each row has, its group, and its repeat."""
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
    """The base in the measuring frame."""
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
        raise InputError("base says where the base stands: leave out tilt and shift, or base")
    return base


def _lengths(name: str, value: ArrayLike) -> Floats:
    """A vector in m, near enough for all that is made of it to be finite."""
    found = numbers(name, value, (3,), "m")
    if np.abs(found).max() > _FAR:
        raise InputError.of(name, f"{np.abs(found).max():g} m", f"up to {_FAR:g} m")
    return found


# -- the actual robot ----------------------------------------------------------------------------


def _actual(robot: Robot, friction: float | None, changes: Mapping[str, Any] | None) -> Robot:
    """The robot with what it differs in."""
    found = robot
    if friction is not None:
        found = with_tendons(robot, {"friction": number("friction", friction, zero=True)})
    if changes is None:
        return found
    if not isinstance(changes, Mapping):
        raise InputError(f"actual is {shown(changes)}, it must be a mapping from path to value")
    tree = _tree(found)
    try:
        values = {path: _share_of(tree, path, value, robot) for path, value in changes.items()}
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
    """A value as `Robot.with_` takes it; "+5 %" is a share of the robot's own."""
    match = _SHARE.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is None:
        return value
    if match[1][0] not in "+-":
        raise InputError(
            f"actual: {path} is {quote(value)}; write by how much it differs, with its sign, as in "
            '"+5 %", or the value'
        )
    here = tree
    for key in re.sub(r"\[([0-9]+)\]", r".\1", str(path)).split("."):
        try:
            here = here[int(key) if isinstance(here, list) else key]
        except (KeyError, IndexError, ValueError, TypeError):
            here = None
    if isinstance(here, bool) or not isinstance(here, (int, float)):
        raise InputError(
            f"actual: {path} is {quote(value)}, but {robot.name} has no number there to take a "
            "share of; write the value"
        )
    return here * (1.0 + float(match[1]) / 100.0)


def _tree(robot: Robot) -> dict[str, Any]:
    """The robot as `Robot.with_` changes it, in SI."""
    return robot.model_dump(mode="json", exclude_none=True)


def _differences(told: Any, actual: Any, path: str = "") -> Iterator[dict[str, Any]]:
    """Every field in which two robots differ."""
    if isinstance(told, dict) and isinstance(actual, dict):
        keys: Sequence[Any] = sorted({*told, *actual})
        pairs = [(key, told.get(key), actual.get(key)) for key in keys]
    elif isinstance(told, list) and isinstance(actual, list) and len(told) == len(actual):
        pairs = list(zip(range(len(told)), told, actual, strict=True))
    else:
        if told != actual:
            yield {"path": path, "told": told, "actual": actual}
        return
    for key, mine, its in pairs:
        yield from _differences(mine, its, f"{path}.{key}" if path else str(key))


# -- files ---------------------------------------------------------------------------------------


def truth_file(path: str | Path) -> Path:
    """The file of the truth that stands beside a table: bench.truth.json beside bench.csv."""
    return Path(path).with_suffix(".truth.json")


def check_table(path: str | Path) -> Path:
    """Say before any work whether a bench may be written to a table.

    Parameters
    ----------
    path : str or Path
        A .csv in a folder that exists. A former synthetic table in its place will be replaced.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If something else is in its place, or in that of the truth, such as measured data.
    """
    try:
        file = resolved(path, f"cannot write the bench to {quote(str(path))}")
        why = f"cannot write the bench to {file}"
        if file.suffix.lower() != ".csv":
            raise InputError(f"{why}: a table ends in .csv; name for example bench.csv")
        check_parent(file, why)
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
    """Write a bench as a table in the tidy format, and its truth as JSON beside it.

    The label *synthetic* stands in the table's first line and in every row; a comment holds the
    truth as well, so that it stays with the data.

    Parameters
    ----------
    measurements : Measurements
        As `simulate` or `Bench.measure` made them.
    path : str or Path
        Of the table, .csv. Table and truth are written whole or not at all.

    Returns
    -------
    tuple of Path
        Table and truth.

    Raises
    ------
    InputError
        If the measurements are not those of a virtual bench, or as `check_table`.
    """
    truth = measurements.truth
    if measurements.source != "synthetic" or truth is None:
        raise InputError(f"{measurements.name} is not of a virtual bench, it has no known truth")
    file = check_table(path)
    beside = truth_file(file)
    short = {k: v for k, v in truth.items() if k not in ("rows", "actual_robot")}
    comments = [
        f"{_MADE} {truth['bowstring_version']}; nothing here was measured.",
        f"sigma_mm is one {NOISE_IS}." if measurements.sigma is not None else "There is no noise.",
        f"truth: {json.dumps(short, allow_nan=False)}",
    ]
    try:
        with folder_beside(file) as work:
            new = write_measurements(measurements, work / file.name, comments)
            data = {"file": file.name, "sha256": hashlib.sha256(new.read_bytes()).hexdigest()}
            text = json.dumps({**truth, "data": data}, allow_nan=False)
            (work / beside.name).write_text(text + "\n", "utf-8")
            check_table(file)
            former, had = work / "old" / beside.name, beside.exists()
            try:
                if had:  # where `folder_beside` gives it back if the process is killed
                    former.parent.mkdir()
                    os.replace(beside, former)
                os.replace(work / beside.name, beside)
                os.replace(new, file)
            except BaseException:  # without its table no truth is left there either
                if former.exists():
                    os.replace(former, beside)
                elif not had:
                    beside.unlink(missing_ok=True)
                raise
    except OSError as error:
        raise InputError(f"cannot write the bench to {file}: {error.strerror}") from None
    return file, beside


def read_truth(path: str | Path) -> dict[str, Any]:
    """Read the truth that stands beside the table of a virtual bench.

    Parameters
    ----------
    path : str or Path
        Of the table.

    Returns
    -------
    dict

    Raises
    ------
    InputError
        If there is none, or it is that of another table.
    """
    table, file = Path(path), truth_file(path)
    try:
        with readable(file) as stream:
            truth = json.loads(stream.read(_MOST_TRUTH))
        digest = hashlib.sha256(table.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{error.filename} cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError):
        raise InputError(f"{file} is no JSON, hence no truth of a virtual bench") from None
    if not isinstance(truth, dict) or truth.get("source") != "synthetic":
        raise InputError(f"{file} is no truth of a virtual bench")
    if truth.get("schema_version") != TRUTH_SCHEMA_VERSION:
        raise InputError(
            f"{file} has schema_version {quote(truth.get('schema_version'))}, this version of "
            f"Bowstring reads {TRUTH_SCHEMA_VERSION}"
        )
    data = truth.get("data")
    if not isinstance(data, dict) or data.get("sha256") != digest:
        raise InputError(f"{file} is the truth of another table than {table}, or it was changed")
    return truth
