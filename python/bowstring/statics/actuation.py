"""Actuation: tensions, tendon displacements and motor angles; path and history.

A tendon displacement is counted from the home pose, in m, positive where the tendon is shortened.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field
from typing_extensions import NotRequired

from bowstring import validation
from bowstring._core import PathSolver, check_memory
from bowstring.aliases import Bools, Floats, Ints
from bowstring.errors import InputError
from bowstring.files.json_files import Content, Row, Table, Triple, structured
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.parts import MAX_TENDONS
from bowstring.statics.load import Load, PointLoad
from bowstring.statics.load_tables import table_of

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.arrays import RobotArrays
    from bowstring.robot.model import Robot

HISTORY_SCHEMA_VERSION: Final = 1
KINDS: Final = {"tensions": "N", "displacements": "m", "angles": "rad"}
"""Kinds of command of a tendon in a load, with their units."""

#: One number per tendon, None or NaN for a command of another kind; or rows of them.
Given = ArrayLike | Sequence[float | None] | Sequence[Sequence[float | None]]

_MOST_POINTS: Final = 100_000  # point loads of a history

_GIVE: Final = (
    "give each tendon a tension, a displacement or an angle, and None where it has another"
)


def compliances(robot: Robot) -> Floats:
    """Compliance of each tendon from motor to end disk (T,) in m/N, theory Eq. 4.3."""
    tendons = robot.tendons
    length = tendons.free_length_m + _routed_lengths(robot)
    return tendons.compliance_m_per_N + length / tendons.axial_stiffness_N


def _routed_lengths(robot: Robot) -> Floats:
    """Length of each tendon (T,) in the straight robot from its base hole to its end disk, in m."""
    station, tendons = robot.disks.station_m, robot.tendons
    if robot.is_parallel:
        return np.array(station[tendons.end_disk])
    across = np.diff(tendons.holes_m, axis=1)  # NaN beyond the end disk
    along = np.diff(station, prepend=0.0)
    spans = np.sqrt(along**2 + (across**2).sum(axis=-1))
    return np.asarray(np.nansum(spans, axis=1), dtype=np.float64)


def home_lengths(robot: Robot, model: RodModel) -> Floats | None:
    """Unstretched length of each tendon from its base hole at zero displacement, (T,) in m.

    This is l0 - C T0 in theory Eq. 4.1. None if the pretension has no stable equilibrium,
    hence no home pose.
    """
    tendons = robot.tendons
    straight = robot.is_parallel and not robot.rest_curvature.any()
    if straight and not tendons.pretension_N.any():
        return np.array(robot.disks.station_m[tendons.end_disk])
    home = robot.core.solve(tendons.pretension_N, Load(gravity=(0.0, 0.0, 0.0)), model)
    if home.tendon_lengths is None:
        return None
    lengths: Floats = home.tendon_lengths - compliances(robot) * tendons.pretension_N
    return lengths


def displacements(
    robot: Robot, model: RodModel, lengths: Floats, tensions: Floats
) -> Floats | None:
    """Displacements (..., T) in m from lengths and tensions (..., T); None without a home pose.

    theory Eq. 4.1 without slack.
    """
    home = home_lengths(robot, model)
    if home is None:
        return None
    found: Floats = home - lengths + compliances(robot) * tensions
    return found


def slack(robot: Robot, slack_lengths: Floats) -> Ints:
    """Indices of slack tendons; slack lengths within rounding errors do not count."""
    return np.flatnonzero(slack_lengths > 1e-12 * robot.length)


def is_by_tensions(robot: Robot, load: Load, history: Mapping[str, Any] | None = None) -> bool:
    """Whether a load has tensions only, without history or laws of tensions: no path matters."""
    if not load.is_tension_controlled or history is not None:
        return False
    return not robot.laws or {*robot.laws} <= {*OF_COMMANDS}


# --------------------------------------------------------------------------------------
# Commands
# --------------------------------------------------------------------------------------


def tensions_of_pressures(robot: Robot, pressures: Sequence[float | None]) -> list[float | None]:
    """Tensions -p A in N of chambers at pressures in Pa (theory Eq. 4.12); None stays None.

    Raises
    ------
    InputError
        For a tendon without an area.
    """
    out = []
    for i, (p, area) in enumerate(zip(pressures, robot.tendons.area_m2.tolist(), strict=True), 1):
        if p is not None and math.isnan(area):
            raise InputError(
                f"tendon {i} of {robot.name} has no area, so that a pressure does not say its "
                "force; give it kind chamber and area, or give tensions"
            )
        out.append(None if p is None else -p * area + 0.0)
    return out


def driven(robot: RobotArrays, displacements: Floats) -> Floats:
    """Displacements of the tendons at commanded ones (..., T), m (theory Eq. 4.11, 4.13)."""
    tendons, coupling = robot.tendons, robot.displacement_coupling
    found: Floats = tendons.gain * displacements + tendons.zero_m
    return found if coupling is None else found @ coupling.T


def commanded(robot: Robot, displacements: Floats) -> Floats:
    """Commands that give displacements of the tendons (..., T), m (theory Eq. 4.11, 4.13)."""
    tendons, coupling = robot.tendons, robot.displacement_coupling
    if coupling is not None:
        displacements = displacements @ np.linalg.inv(coupling).T
    found: Floats = (displacements - tendons.zero_m) / tendons.gain
    return found


def delayed(by_displacement: Bools, values: Floats, times: Floats, delay: Floats) -> Floats:
    """Commands (n, T) that drives follow at times (n,), s, after their delays (T,), s.

    Linear in time between the rows, and constant before the first row (theory Eq. 4.14).
    """
    out = np.array(values)
    for i in np.flatnonzero(delay) if len(values) else ():
        if (by_displacement[:, i] != by_displacement[0, i]).any():
            raise InputError(
                f"tendon {i + 1} has a delay and changes between tensions and displacements; give "
                "it one of them in all rows, or set delay to 0"
            )
        out[:, i] = np.interp(times - delay[i], times, values[:, i])
    return out


def commands(robot: Robot, load: Load, *, rows: bool = False) -> tuple[Bools, Floats]:
    """Commands of a load as they reach the tendons; otherwise as `given`."""
    by_displacement, values = given(robot, load, rows=rows)
    return by_displacement, through_drives(robot, by_displacement, values)


def through_drives(
    robot: Robot, by_displacement: Bools, values: Floats, times: Floats | None = None
) -> Floats:
    """Commands as they reach the tendons (..., T); of rows with times (n,), s, after the delays."""
    delay = robot.tendons.delay_s
    if times is not None and delay.any():
        least = np.where(by_displacement, -math.inf, robot.tendons.least_tension_N)
        if (np.isfinite(values) & (values >= least)).all():  # others are refused by their rows
            values = delayed(by_displacement, values, times, delay)
    if robot.laws and by_displacement.any():
        moved = np.where(by_displacement, values, 0.0)
        check_coupled(robot, by_displacement)
        values = np.where(by_displacement, driven(robot, moved), values)
    return values


def check_coupled(robot: Robot, by_displacement: Bools) -> None:
    """Refuse a displacement of a segment alone, beyond tendons that have none (..., T)."""
    coupling = robot.displacement_coupling
    if coupling is None or by_displacement.all():
        return
    lacks = by_displacement & (~by_displacement @ (coupling != 0.0).T)
    if lacks.any():
        place = tuple(np.argwhere(lacks)[0])
        needed = np.flatnonzero((coupling[place[-1]] != 0.0) & ~by_displacement[place[:-1]])
        raise InputError(
            f"tendon {place[-1] + 1} has the displacement of its own segment, as its decoupling is "
            f"above 0, and tendon {needed[0] + 1} of an inner segment has none; give both "
            "displacements, or set decoupling to 0"
        )


def given(robot: Robot, load: Load, *, rows: bool = False) -> tuple[Bools, Floats]:
    """Commands of a load: which are displacements, and their values, each (T,) or (n, T).

    Each tendon has exactly one of tension, displacement and angle, None or NaN in the others.
    """
    tables = {
        name: _table(robot, name, getattr(load, name), unit, rows)
        for name, unit in KINDS.items()
        if getattr(load, name) is not None
    }
    if not tables:
        raise InputError("tensions is None, and so are displacements and angles; " + _GIVE)
    if list(tables) == ["tensions"]:
        only = tables["tensions"]
        return np.zeros(only.shape, bool), only
    if list(tables) == ["displacements"] and not np.isnan(tables["displacements"]).any():
        only = tables["displacements"]
        return np.ones(only.shape, bool), only
    if len({table.shape for table in tables.values()}) > 1:
        counts = " and ".join(f"{len(table)} of {name}" for name, table in tables.items())
        raise InputError(f"got {counts}; each must have one row for each load")
    said = {name: ~np.isnan(table) for name, table in tables.items()}
    count = np.sum([*said.values()], axis=0)
    if (count != 1).any():
        raise _not_one(tables, count, said)
    by_displacement = np.zeros(count.shape, bool)
    values = np.zeros(count.shape)
    for name, table in tables.items():
        here = said[name]
        if name == "angles":
            radius = np.broadcast_to(robot.tendons.spool_radius_m, table.shape)
            missing = np.flatnonzero((here & np.isnan(radius)).reshape(-1, count.shape[-1]).any(0))
            if missing.size:
                raise InputError(
                    f"tendon {missing[0] + 1} of {robot.name} has no spool_radius, so that an "
                    "angle does not say its displacement; add spool_radius to the robot, or give "
                    "displacements",
                    argument="angles",
                    index=int(missing[0]),
                )
            table = table * radius
        values[here] = table[here]
        if name != "tensions":
            by_displacement |= here
    return by_displacement, values


def _table(robot: Robot, name: str, values: Given, unit: str, rows: bool) -> Floats:
    count = robot.core.tendon_count
    if isinstance(values, np.ndarray):
        # checked before the table is copied
        _check_shape(name, values, count, unit, rows)
        what = f"{name} of shape {values.shape}"
        check_memory(40.0 * values.size, what, "give fewer loads at a time")
    try:
        table = validation.floats(values)
    except TypeError:
        shape = f"(n, {count})" if rows else f"({count},)"
        raise InputError(
            f"{name} must be numbers of shape {shape} in {unit}, None where a tendon has a "
            "command of another kind"
        ) from None
    _check_shape(name, table, count, unit, rows)
    return table


def _check_shape(name: str, table: NDArray[Any], count: int, unit: str, rows: bool) -> None:
    if rows and (table.ndim != 2 or table.shape[1] != count):
        raise not_rows(name, table.shape, count)
    if not rows and table.ndim != 1:
        raise InputError(f"{name} has shape {table.shape}, it must have ({count},), in {unit}")
    if not rows and len(table) != count:
        raise InputError(f"{name} has {len(table)} numbers, it must have {count}, in {unit}")


def not_rows(name: str, shape: tuple[int, ...], count: int) -> InputError:
    """Error for a table that does not have one row for each load."""
    return InputError(
        f"{name} has shape {shape}, it must have one row for each load and {count} columns, one "
        "for each tendon"
    )


def _not_one(tables: Mapping[str, Floats], count: Ints, said: Mapping[str, Bools]) -> InputError:
    place = tuple(int(i) for i in np.argwhere(count != 1)[0])
    where = f"row {place[0] + 1}: " if len(place) == 2 else ""
    tendon = f"{where}tendon {place[-1] + 1}"
    if count[place] == 0:
        return InputError(f"{tendon} has no command; {_GIVE}")
    one = {"tensions": "a tension", "displacements": "a displacement", "angles": "an angle"}
    both = " and ".join(one[name] for name in tables if said[name][place])
    return InputError(f"{tendon} has {both}; it can have only one of them")


def checked_times(robot: Robot, times: ArrayLike | None, count: int) -> Floats | None:
    """Check and return the times of rows (n,), which count from the start of the path, s.

    Raises
    ------
    InputError
        If a viscoelastic robot has none, or they are not one for each row, or decrease.
    """
    if times is None:
        if robot.is_viscoelastic:
            raise InputError(
                f"{robot.name} has relaxation or creep, which need the time of each row: call "
                "bowstring.sweep with times, or set their shares and compliances to 0",
            )
        return None
    try:
        table = validation.floats(times)
    except TypeError:
        raise InputError("times must be numbers in s", argument="times") from None
    if table.shape != (count,):
        raise InputError(
            f"times has shape {table.shape}, it must have one for each of {count} rows"
        )
    steps = np.diff(table, prepend=0.0)
    if not np.isfinite(table).all() or (steps < 0).any():
        row = int(np.flatnonzero(~np.isfinite(table) | ~(steps >= 0))[0])
        raise InputError(
            f"times: row {row + 1} is {table[row]:g} s; times must be finite, count from the start "
            "of the path and not decrease"
        )
    return np.asarray(table)


# --------------------------------------------------------------------------------------
# The path and its history
# --------------------------------------------------------------------------------------


class Path:
    """Path of a robot, solved step by step by the core, with its history."""

    __slots__ = ("core", "model", "robot")

    def __init__(
        self,
        robot: Robot,
        model: RodModel,
        history: Mapping[str, Any] | None = None,
        *,
        has_memory: bool = True,
        alone: bool = False,
    ) -> None:
        self.robot, self.model = robot, model
        laws = robot.hysteresis, robot.relaxation, robot.tendons.creep
        self.core = PathSolver(robot.core, model, robot.tendons.lines, laws, has_memory, alone)
        if history is not None:
            try:
                self._resume(history)
            except InputError as error:
                raise InputError(str(error), argument="history") from None

    @property
    def _settings(self) -> dict[str, Any]:
        model = self.model
        return {"theory": model.theory, "twist": model.twist, "elements": model.elements}

    def history(self) -> dict[str, Any]:
        """State at the end of the path, with all that it remembers, for `json.dumps`."""
        now = self.core.history()
        orders = zip(now["by_displacement"].tolist(), now["commands"].tolist(), strict=True)
        return {
            "schema_version": HISTORY_SCHEMA_VERSION,
            "robot": self.robot.name,
            "robot_hash": self.robot.hash,
            **self._settings,
            "commands": [
                {"displacement_m" if by_displacement else "tension_N": v}
                for by_displacement, v in orders
            ],
            "gravity_m_per_s2": now["gravity"].tolist(),
            "tip_force_N": now["tip_force"].tolist(),
            "tip_moment_Nm": now["tip_moment"].tolist(),
            "disk_forces_N": now["disk_forces"].tolist(),
            "disk_moments_Nm": now["disk_moments"].tolist(),
            "point_loads": [PointLoad.of_numbers(row).to_dict() for row in now["point_loads"]],
            "line_forces_N_per_m": now["line_forces"].tolist(),
            "tensions_N": now["tensions"].tolist(),
            "log_tension_drops": now["drops"].tolist(),
            "unstretched_spans_m": now["spans"].tolist(),
            "slips": now["slips"].tolist(),
            "arcs_rad": now["strain"].tolist(),
            "plays_per_m": now["plays"].tolist(),
            "lags_per_m": now["lags"].tolist(),
            "creep_m": now["crept"].tolist(),
            "tip_error_m": _or_none(now["carried"][0]),
            "tension_error_N": _or_none(now["carried"][1]),
            "time_since_last_solution_s": float(now["carried"][2]),
        }

    def _resume(self, history: Mapping[str, Any]) -> None:
        """Continue from a history of the same robot and settings."""
        if not isinstance(history, Mapping) or "robot_hash" not in history:
            raise InputError(
                "this is no history: give what the method history() of a solution returned"
            )
        version = history.get("schema_version")
        if version != HISTORY_SCHEMA_VERSION:
            raise InputError(
                f"the history has schema_version {version!r:.40}, this version of Bowstring reads "
                f"{HISTORY_SCHEMA_VERSION}"
            )
        if history["robot_hash"] != self.robot.hash:
            raise InputError(
                f"the history is of another robot ({history.get('robot')!s:.100}), or of one with "
                f"other numbers than {self.robot.name} has now; give the robot that it was made "
                "with, or leave the history out"
            )
        for name, value in self._settings.items():
            if name == "elements" and (value is None or history.get(name, 1) is None):
                continue  # the number is chosen in each step
            if history.get(name) != value:
                raise InputError(
                    f"the history was made with {name} {history.get(name)!r:.40}, it cannot be "
                    f"continued with {name} {value!r}"
                )
        try:
            found = _arrays(structured(dict(history), _History))
        except ValueError as error:
            raise InputError(f"the history is damaged: {error}") from None
        try:
            self.core.resume(found)
        except InputError as error:
            said = str(error).removeprefix("the history is damaged: ")
            raise InputError(f"the history is damaged: {said}") from None
        except (TypeError, ValueError):
            raise InputError(
                "the history is damaged: its numbers do not belong to this robot"
            ) from None


def _in_rows(given: Any) -> Any:
    """A creep of one term, as earlier versions wrote it, in rows."""
    flat = isinstance(given, list) and list not in map(type, given)
    return [[value] for value in given] if flat else given


#: An error or a time; None is an infinite error.
_Size = Annotated[float, Field(ge=0.0)] | None
_Command = Annotated[
    dict[Literal["displacement_m", "tension_N"], float], Field(min_length=1, max_length=1)
]


class _PointLoad(Content):
    disk: NotRequired[int | None]
    arc_length_m: NotRequired[float | None]
    point_m: Triple
    force_N: Triple
    moment_Nm: Triple
    follower: bool


class _History(Content):
    """Structure of a history; earlier versions lack what is not required."""

    commands: Annotated[list[_Command], Field(max_length=MAX_TENDONS)]
    gravity_m_per_s2: Row
    tip_force_N: Row
    tip_moment_Nm: Row
    disk_forces_N: NotRequired[Table]
    disk_moments_Nm: NotRequired[Table]
    point_loads: NotRequired[Annotated[list[_PointLoad], Field(max_length=_MOST_POINTS)]]
    line_forces_N_per_m: NotRequired[Table]
    tensions_N: Row
    log_tension_drops: Table
    unstretched_spans_m: Table
    slips: Table
    arcs_rad: Table
    plays_per_m: NotRequired[Table]
    lags_per_m: NotRequired[Table]
    creep_m: NotRequired[Annotated[Table, BeforeValidator(_in_rows)]]
    tip_error_m: NotRequired[_Size]
    tension_error_N: NotRequired[_Size]
    time_since_last_solution_s: NotRequired[_Size]


def _arrays(history: Any) -> dict[str, Any]:
    """Arrays of a history, as the core takes them."""

    def rows(name: str, width: int) -> Floats:
        """Rows of numbers; earlier versions have none."""
        found: Floats = history.get(name, _NO_ROWS)
        return found if len(found) else np.zeros((0, width))

    def both_terms(name: str, width: int) -> Floats:
        """Both terms of relaxation or creep; earlier versions have the first only, or none."""
        found = rows(name, 2 * width)
        if found.shape[1] not in (width, 2 * width):
            raise ValueError(f"{name} has {found.shape[1]} numbers in a row")
        return np.pad(found, ((0, 0), (0, 2 * width - found.shape[1])))

    def at_points(found: Floats) -> Floats:
        """One row for each Gauss point; earlier versions have one for each module."""
        points, modules = len(history["arcs_rad"]), len(history["slips"])
        alike = len(found) == modules != points and points % max(modules, 1) == 0
        return np.repeat(found, points // modules, axis=0) if alike else found

    commands = [next(iter(item.items())) for item in history["commands"]]
    points = [PointLoad.of_dict(item).numbers() for item in history.get("point_loads", ())]
    carried = [history.get(name, 0.0) for name in _CARRIED]
    return {
        "tensions": history["tensions_N"],
        "drops": history["log_tension_drops"],
        "spans": history["unstretched_spans_m"],
        "by_displacement": np.array([name == "displacement_m" for name, _ in commands], dtype=bool),
        "commands": np.array([value for _, value in commands], dtype=float),
        "gravity": history["gravity_m_per_s2"],
        "tip_force": history["tip_force_N"],
        "tip_moment": history["tip_moment_Nm"],
        "disk_forces": rows("disk_forces_N", 3),
        "disk_moments": rows("disk_moments_Nm", 3),
        "point_loads": table_of(np.array(points, dtype=float)),
        "line_forces": rows("line_forces_N_per_m", 3),
        "strain": history["arcs_rad"],
        "slips": np.sign(history["slips"]).astype(np.int8),
        "plays": at_points(rows("plays_per_m", 2)),
        "lags": at_points(both_terms("lags_per_m", 2)),
        "crept": both_terms("creep_m", 1),
        "carried": np.array([math.inf if value is None else value for value in carried]),
    }


#: Largest errors so far, and time without a solution; earlier versions have none.
_CARRIED: Final = ("tip_error_m", "tension_error_N", "time_since_last_solution_s")
_NO_ROWS: Final[Floats] = np.zeros((0, 0))


def _or_none(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
