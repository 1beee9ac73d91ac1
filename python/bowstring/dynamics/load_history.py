"""Load histories: tables, ramps and functions of time, and the intervals between their knots.

All values are in SI. T is the number of tendons.
"""

from __future__ import annotations

import copy
import time as clock
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Bools, Floats
from bowstring.dynamics.base_motion import BaseHistory, BaseMotion
from bowstring.errors import InputError
from bowstring.formatting import plain
from bowstring.statics import actuation
from bowstring.statics.load import Load, PointLoad, point_loads
from bowstring.statics.load_tables import (
    FORCE,
    MOMENT,
    ON_DISKS,
    InstantLoad,
    disk_shape,
    per_disk,
)

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_LOOK: Final = 0.1  # s of work between two checks for interrupts
_WORK: Final = 3e-6  # s of work per step and module, estimated for the first chunk
_MOST_AT_FIRST: Final = 250  # output times in the first chunk, in case the estimate is wrong
_LONGEST_WHY: Final = 300  # characters of the error of a user's function
_WORDS: Final = {
    "disk_forces": "dead force of disk",
    "disk_moments": "dead moment of disk",
    "line_forces": "force per length before disk",
}
CLOSEST: Final = 1e-11  # s between two times; a step of 1e-13 is below numerical resolution


class Table:
    """Values over time: linear between the given times, constant before and after them.

    Parameters
    ----------
    times : array_like (K,)
        Times in s, not decreasing; the same time twice is a jump.
    values : array_like (K, C)
        One row per time: the tension of each tendon in N, its displacement in m, or a vector. A
        column of NaN is a tendon with a command of another kind. Vectors on disks are (K, N, 3).

    Raises
    ------
    InputError
        If times decrease, three are equal, two differ by rounding errors only, or numbers are not
        finite.
    """

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        rule = "a table over time takes numbers: times (K,), values (K, C)"
        self.times, self.values = (
            validation.floats_or_refuse(given, rule) for given in (times, values)
        )
        if self.values.ndim == 3:
            self.values = self.values.reshape(len(self.values), -1)
        if self.times.ndim != 1 or self.values.ndim != 2 or len(self.times) == 0:
            raise InputError(
                f"a table over time takes times (K,) and values (K, C), got shapes "
                f"{self.times.shape} and {self.values.shape}"
            )
        if len(self.times) != len(self.values):
            raise InputError(
                f"a table over time has {len(self.times)} times but {len(self.values)} rows"
            )
        said = ~np.isnan(self.values).all(axis=0)
        for name, array in (("times", self.times), ("values", self.values[:, said])):
            if not np.isfinite(array).all():
                row = int(np.argwhere(~np.isfinite(array))[0][0])
                text = f"the {name} of a table over time are not finite in row {row + 1}"
                if name == "values" and not np.isinf(array).any():
                    text += "; a tendon with a command of another kind has NaN in all rows"
                raise InputError(text)
        gaps = np.diff(self.times)
        if (gaps < 0).any():
            row = int(np.argmax(gaps < 0)) + 1
            raise InputError(
                f"the times of a table must not decrease: {self.times[row]:g} s in row {row + 1} "
                f"comes after {self.times[row - 1]:g} s"
            )
        if ((gaps[1:] == 0) & (gaps[:-1] == 0)).any():
            raise InputError("a table over time has the same time three times; a jump takes two")
        near = (gaps > 0) & (gaps < CLOSEST)
        if near.any():
            row = int(np.argmax(near)) + 1
            raise InputError(
                f"the times of a table are {gaps[row - 1]:.2g} s apart in rows {row} and {row + 1} "
                f"({self.times[row]:g} s), which is below numerical resolution; give the same time "
                f"twice for a jump, else {CLOSEST:g} s or more"
            )

    def at(self, time: float, *, before: bool = False) -> Floats:
        """Values at a time; at a jump, those after it or, with `before`, those before it."""
        return np.asarray(self.rows(np.array([time]), before=before)[0])

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        """Values (K, C) at several times (K,)."""
        if len(self.times) == 1:
            return np.repeat(self.values, len(times), axis=0)
        side: Literal["left", "right"] = "left" if before else "right"
        i = np.searchsorted(self.times, times, side=side)
        a, b = np.clip(i - 1, 0, None), np.clip(i, None, len(self.times) - 1)
        gap = self.times[b] - self.times[a]
        share = np.where(gap > 0, (times - self.times[a]) / np.where(gap > 0, gap, 1.0), 0.0)
        low, high = self.values[a], self.values[b]
        between = low + share[:, None] * (high - low)
        return np.asarray(np.where(share[:, None] >= 1.0, high, between))  # exact at the end

    def later(self, delay: float) -> Table:
        """Return the table with all times later by a delay, s."""
        return Table(self.times + delay, self.values) if len(self.times) > 1 else self

    def knots(self) -> set[float]:
        """Times of its knots, including jumps."""
        return set(self.times.tolist())

    def jumps(self) -> set[float]:
        """Times of its jumps."""
        return set(self.times[1:][np.diff(self.times) == 0].tolist())

    @property
    def is_sampled(self) -> bool:
        """Whether values are computed before each step: not for a table."""
        return False

    def to_dict(self) -> Any:
        """Times and values for a file; None where a tendon has a command of another kind."""
        return {"times_s": self.times.tolist(), "values": plain(self.values)}


_NONE: Final = Table([0.0], np.zeros((1, 0)))
"""History of a load that does not act: it has no columns."""


def ramp(values: ArrayLike, rise: float, start: float = 0.0) -> Table:
    """Raise values from zero in a straight line, then hold them.

    Parameters
    ----------
    values : array_like (T,) or (N, 3)
        Values after the rise, for example tensions in N, or vectors on disks.
    rise : float
        Duration of the rise, s; 0 is a jump.
    start : float
        Time at which it starts, s.

    Returns
    -------
    Table
        A load over time for `bowstring.simulate`.
    """
    try:
        end = np.atleast_1d(validation.floats(values))
    except TypeError:
        raise InputError(
            f"the values of a ramp are {validation.shown(values)}, they must be numbers"
        ) from None
    rise = validation.number("rise", rise, "s", zero=True)
    start = validation.number("start", start, "s", zero=True)
    if end.ndim == 2:
        end = end.ravel()
    return Table([start, start + rise], [0.0 * end, end])


def step(values: ArrayLike, start: float = 0.0) -> Table:
    """Jump from zero to values.

    Parameters
    ----------
    values : array_like (T,) or (N, 3)
        Values after the jump, for example tensions in N, or vectors on disks.
    start : float
        Time of the jump, s.

    Returns
    -------
    Table
        A load over time for `bowstring.simulate`.
    """
    return ramp(values, 0.0, start)


OverTime = Table | Callable[[float], ArrayLike] | ArrayLike


class _Function:
    """User's function of time with checked values."""

    is_sampled = True

    def __init__(
        self,
        name: str,
        function: Callable[[float], ArrayLike],
        shape: tuple[int, ...],
        *,
        loose: bool = False,
        least: Floats | float = 0.0,
    ) -> None:
        self.name, self.function, self.shape, self.loose = name, function, shape, loose
        self.least = np.broadcast_to(least, shape)

    def later(self, delay: float) -> _Function:
        """Return the function later by a delay, s; before the delay it has its value at time 0."""
        late = copy.copy(self)
        late.function = lambda time: self.function(max(time - delay, 0.0))
        return late

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        return np.array([self.at(t) for t in times.tolist()])

    def at(self, time: float, *, before: bool = False) -> Floats:
        try:
            given = self.function(time)
        except Exception as error:
            why = " ".join(f"{type(error).__name__}: {error}".split())[:_LONGEST_WHY]
            raise InputError(
                f"the function for {self.name} failed at {time:.6g} s: {why.rstrip(': ')}"
            ) from error
        try:
            value = validation.floats(given)
        except TypeError:
            raise InputError(
                f"the function for {self.name} returned {validation.shown(given)} at {time:.6g} s, "
                f"it must be {_numbers_of(self.shape)}"
            ) from None
        if value.shape != self.shape:
            raise InputError(
                f"the function for {self.name} returned shape {value.shape} at {time:.6g} s, "
                f"it must be {self.shape}"
            )
        value = value.ravel()
        known = ~np.isnan(value) if self.loose else np.full(value.shape, True)
        least = self.least.ravel()[known]
        validation.check_values(self.name, value[known], f" at {time:.6g} s", least)
        return value

    def knots(self) -> set[float]:
        return set()

    def jumps(self) -> set[float]:
        return set()

    def to_dict(self) -> Any:
        return "function of time"


class _Delayed:
    """Commands of the tendons over time after the delays (T,) of their drives, s."""

    def __init__(self, given: Table | _Function, delay: Floats) -> None:
        self.given, self.is_sampled = given, given.is_sampled
        self._parts = [(delay == each, given.later(each)) for each in np.unique(delay).tolist()]

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        out = np.empty((len(times), len(self._parts[0][0])))
        for own, history in self._parts:
            out[:, own] = history.rows(times, before=before)[:, own]
        return out

    def at(self, time: float, *, before: bool = False) -> Floats:
        return np.asarray(self.rows(np.array([time]), before=before)[0])

    def knots(self) -> set[float]:
        return set().union(*(history.knots() for _, history in self._parts))

    def jumps(self) -> set[float]:
        return set().union(*(history.jumps() for _, history in self._parts))

    def to_dict(self) -> Any:
        return self.given.to_dict()


class Actuation:
    """Actuation of the tendons over time, by tension, displacement or motor angle.

    Commands reach the tendons after the delays of the drives. Before time 0 they are those at time
    0.

    Attributes
    ----------
    by_displacement : ndarray of bool (T,)
        Whether a tendon is displacement-controlled, which does not change.

    Parameters
    ----------
    load : Load
        Load with tensions, displacements and angles, each a table, a function or constant.
    until : float
        End of the run, s; later values are not checked.
    """

    def __init__(self, robot: Robot, load: Load, until: float) -> None:
        self._robot = robot
        count = robot.core.tendon_count
        alone = load.is_tension_controlled and load.tensions is not None
        least, delay = robot.tendons.least_tension_N, robot.tendons.delay_s
        self._histories: dict[str, _Commands] = {}
        for name, unit in actuation.KINDS.items():
            if (value := getattr(load, name)) is not None:
                given = over_time(name, value, count, unit, loose=not alone, least=least)
                self._histories[name] = _Delayed(given, delay) if delay.any() else given
        self._alone = self._histories["tensions"] if alone else None
        self._longest = robot.disks.station_m[robot.tendons.end_disk]
        self.by_displacement: Bools = np.zeros(count, bool)
        if not alone:
            self.by_displacement, _ = self._commands(0.0, before=True)
            if not self.is_sampled:  # find errors at later times before the work begins
                inside = sorted({0.0, *(t for t in self.knots() if t < until)})
                self.rows(np.array([*inside, until]), before=True)
                self.rows(np.array(inside))

    def _commands(self, time: float, *, before: bool) -> tuple[Bools, Floats]:
        rows = {name: c.at(time, before=before) for name, c in self._histories.items()}
        try:
            return actuation.commands(self._robot, Load(**rows))
        except InputError as error:
            if not self.is_sampled:
                raise
            raise InputError(f"at {time:.6g} s: {error}") from None

    def _check_lengths(self, times: Floats, values: Floats) -> None:
        long = self.by_displacement & (values >= self._longest)
        if long.any():
            k, i = np.argwhere(long)[0]
            raise InputError(
                f"the displacement of tendon {i + 1} is {values[k, i]:g} m at {times[k]:.6g} s, "
                f"it must be less than the tendon's length, {self._longest[i]:g} m",
                argument="displacements",
                index=int(i),
            )

    def at(self, time: float, *, before: bool = False) -> Floats:
        """Tension in N or displacement in m of each tendon (T,), after a jump or before it."""
        if self._alone is not None:
            return self._alone.at(time, before=before)
        by_displacement, values = self._commands(time, before=before)
        differs = by_displacement != self.by_displacement
        if differs.any():
            raise InputError(
                f"tendon {int(np.argmax(differs)) + 1} changes between a tension and a "
                f"displacement at {time:.6g} s; in a motion each stays what it is"
            )
        self._check_lengths(np.array([time]), values[None, :])
        return values

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        """Actuation (K, T) at several times (K,)."""
        if self._alone is not None:
            return self._alone.rows(times, before=before)
        if self.is_sampled:
            return np.array([self.at(t, before=before) for t in times.tolist()])
        rows = {name: c.rows(times, before=before) for name, c in self._histories.items()}
        _, values = actuation.commands(self._robot, Load(**rows), rows=True)
        self._check_lengths(times, values)
        return values

    def knots(self) -> set[float]:
        """Times of knots, including jumps."""
        return set().union(*(c.knots() for c in self._histories.values()))

    def jumps(self) -> set[float]:
        """The times of jumps."""
        return set().union(*(c.jumps() for c in self._histories.values()))

    @property
    def is_sampled(self) -> bool:
        """Whether values are computed before each step, by a user's function."""
        return any(c.is_sampled for c in self._histories.values())

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a file: ``tensions_N``, ``displacements_m`` and ``angles_rad``."""
        keys = {
            "tensions": "tensions_N",
            "displacements": "displacements_m",
            "angles": "angles_rad",
        }
        return {keys[name]: c.to_dict() for name, c in self._histories.items()}


_History = Table | _Function
_Commands = Table | _Function | _Delayed


class _PointHistory:
    """Point loads over time: their numbers side by side, 12 columns each."""

    def __init__(self, loads: tuple[PointLoad, ...]) -> None:
        self.loads = loads
        self.wrenches = [
            (
                over_time(f"the force of point load {i}", load.force, 3, "N"),
                over_time(f"the moment of point load {i}", load.moment, 3, "N m"),
            )
            for i, load in enumerate(loads, 1)
        ]
        self._each = [history for pair in self.wrenches for history in pair]

    @property
    def is_sampled(self) -> bool:
        return any(history.is_sampled for history in self._each)

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        parts = []
        for load, (force, moment) in zip(self.loads, self.wrenches, strict=True):
            columns = np.tile(load.numbers((0, 0, 0), (0, 0, 0)), (len(times), 1))
            columns[:, FORCE] = force.rows(times, before=before)
            columns[:, MOMENT] = moment.rows(times, before=before)
            parts.append(columns)
        return np.concatenate(parts, axis=1)

    def at(self, time: float, *, before: bool = False) -> Floats:
        return np.concatenate(
            [
                load.numbers(force.at(time, before=before), moment.at(time, before=before))
                for load, (force, moment) in zip(self.loads, self.wrenches, strict=True)
            ]
        )

    def knots(self) -> set[float]:
        return set().union(*(history.knots() for history in self._each))

    def jumps(self) -> set[float]:
        return set().union(*(history.jumps() for history in self._each))

    def to_dict(self) -> Any:
        return [load.to_dict() for load in self.loads]


class Loads(NamedTuple):
    """All loads over time; those on disks have 3 N columns, or none."""

    actuation: Actuation
    tip_force: _History
    tip_moment: _History
    disk_forces: _History
    disk_moments: _History
    point_loads: _History | _PointHistory
    line_forces: _History
    base: _History | BaseHistory

    def at(self, time: float, *, before: bool = False) -> InstantLoad:
        """Loads at a time; at a jump, those after it or, with `before`, those before it."""
        return InstantLoad(*(c.at(time, before=before) for c in self))

    def ramps(self, starts: Floats, ends: Floats) -> InstantLoad:
        """Loads at the ends of intervals, row by row; of the base also within them."""
        rows = InstantLoad(*(c.rows(ends, before=True) for c in self))
        if isinstance(self.base, BaseHistory):
            return rows._replace(base=self.base.inside(starts, ends))
        return rows

    @property
    def misfit(self) -> float:
        """Misfit of the motion of the base, over its largest acceleration."""
        return self.base.misfit if isinstance(self.base, BaseHistory) else 0.0

    def jumps(self) -> set[float]:
        """The times of jumps."""
        return set().union(*(c.jumps() for c in self))

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a file."""
        return {
            **self.actuation.to_dict(),
            "tip_force_N": self.tip_force.to_dict(),
            "tip_moment_Nm": self.tip_moment.to_dict(),
            "disk_forces_N": _given(self.disk_forces),
            "disk_moments_Nm": _given(self.disk_moments),
            "point_loads": _given(self.point_loads),
            "line_forces_N_per_m": _given(self.line_forces),
            "base": _given(self.base),
        }

    def chunks(
        self, simulator: Any, times: Floats, longest: float, modules: int
    ) -> Iterator[Stretches]:
        """Yield chunks of time intervals, of about `_LOOK` seconds of work each.

        `modules` is the number of modules of the robot times elements per module.
        """
        # a knot that differs from an output time by rounding is that time
        near = max(1e-6 * longest, CLOSEST)
        inside: list[float] = []
        for knot in sorted(set().union(*(c.knots() for c in self))):
            i = int(np.abs(times - knot).argmin())
            if inside and knot - inside[-1] < CLOSEST:
                continue  # the same knot of another table: 0.1 + 0.2 s is 0.3 s
            if near < knot < times[-1] - near:
                inside.append(knot)
                if abs(times[i] - knot) <= near:
                    times[i] = knot
        outputs = set(times[1:].tolist())
        # np.unique would import a fifth of NumPy first
        ends = np.array(sorted(outputs | set(inside)))
        record = np.array([end in outputs for end in ends.tolist()], dtype=bool)
        if any(c.is_sampled for c in self):
            yield from self._sampled(simulator, ends, record, longest)
            return
        durations = np.diff(ends, prepend=0.0)
        rows = self.ramps(np.concatenate([[0.0], ends[:-1]]), ends)
        jumps = np.array(sorted(self.jumps()))
        jumped = np.searchsorted(jumps, ends + CLOSEST) > np.searchsorted(jumps, ends - CLOSEST)
        stops = np.flatnonzero(jumped) + 1
        steps = max(float(durations.max(initial=0.0)) / longest, 1.0)
        first, size = 0, int(np.clip(_LOOK / (_WORK * modules * steps), 1, _MOST_AT_FIRST))
        while first < len(ends):
            begun = clock.perf_counter()
            next_stop = stops[np.searchsorted(stops, first, side="right") :]
            last = min([first + size, len(ends), *next_stop[:1].tolist()])
            part = slice(first, last)
            yield durations[part], InstantLoad(*(row[part] for row in rows)), record[part]
            spent = max(clock.perf_counter() - begun, 1e-9)
            size = int(np.clip((last - first) * _LOOK / spent, 1, min(4 * size, 1000)))
            first = last

    def _sampled(
        self, simulator: Any, ends: Floats, record: Bools, longest: float
    ) -> Iterator[Stretches]:
        # one step at a time, because the function is called before each
        now = 0.0
        for end, wanted in zip(ends.tolist(), record.tolist(), strict=True):
            while now < end:
                reach = min(simulator.next_step, longest)
                left = max(1, int(np.ceil((end - now) / reach - 1e-6)))
                then = end if left == 1 else now + (end - now) / left
                recorded = np.array([wanted and left == 1])
                loads = self.ramps(np.array([now]), np.array([then]))
                yield np.array([then - now]), loads, recorded
                now = then


Stretches = tuple[Floats, InstantLoad, Bools]
"""Durations, loads at their ends (rows of each), and whether each end is recorded."""


def _given(history: _History | _PointHistory | BaseHistory) -> Any:
    """Values of a load on disks for a file; None if there is none."""
    return None if isinstance(history, Table) and not history.values.size else history.to_dict()


def _numbers_of(shape: tuple[int, ...]) -> str:
    return f"{shape[0]} numbers" if len(shape) == 1 else f"numbers of shape {shape}"


def on_disks(name: str, value: Any, disks: int) -> _History:
    """Convert a user's load on disks to a load history, of no columns if it is None."""
    if value is None:
        return _NONE
    if callable(value):
        return _Function(name, value, (disks, 3))
    if isinstance(value, Table):
        if name == "line_forces" and value.values.shape[1] == 3:
            value = Table(value.times, np.tile(value.values, (1, disks)))
        if value.values.shape[1] != 3 * disks:
            raise InputError(
                f"the table for {name} has {value.values.shape[1]} columns, it must have "
                f"{3 * disks}: x, y and z of each of {disks} disks"
            )
        return over_time(name, value, 3 * disks, ON_DISKS[name])
    return Table([0.0], disk_row(name, value, disks)[None, :])


def on_points(given: Any, disks: int) -> _History | _PointHistory:
    """Convert a user's point loads to load histories, of no columns if there are none."""
    loads = tuple(load.on(disks) for load in point_loads(given))
    return _PointHistory(loads) if loads else _NONE


def of_base(given: Any, gravity: ArrayLike, duration: float) -> _History | BaseHistory:
    """Convert a motion of the base to a load history, without columns where it does not move."""
    if given is None:
        return _NONE
    if not isinstance(given, BaseMotion):
        raise InputError(f"base is {validation.shown(given)}, it must be a BaseMotion")
    if duration > given.duration * (1.0 + 1e-9):
        raise InputError(
            f"the base moves up to {given.duration:g} s and the run lasts {duration:g} s; give "
            "poses of the base up to its end"
        )
    return BaseHistory(given, gravity, duration)


def disk_row(name: str, value: Any, disks: int) -> Floats:
    """Check a load on disks (N, 3); components of all disks (3 N,)."""
    what = f"{disk_shape(name, disks)}, a table or a function"
    array = validation.read(name, value, f"numbers of shape {what}")
    array = per_disk(name, array, disks)
    if array.shape != (disks, 3):
        raise InputError(f"{name} has shape {array.shape}, it must have {what}")
    if not np.isfinite(array).all():
        k = int(np.argwhere(~np.isfinite(array))[0][0])
        raise InputError(
            f"{_WORDS[name]} {k + 1} is {array[k].tolist()} {ON_DISKS[name]}, it must be finite",
            argument=name,
            index=k,
        )
    return array.ravel()


def over_time(
    name: str,
    value: Any,
    count: int,
    unit: str,
    *,
    loose: bool = False,
    least: Floats | float = 0.0,
) -> _History:
    """Convert a user's value to a load history; ``loose`` allows NaN and None.

    `least` are the least possible tensions (count,) in N.
    """
    lowest = np.broadcast_to(least, (count,))
    if isinstance(value, Table):
        if value.values.shape[1] != count:
            raise InputError(
                f"the table for {name} has {value.values.shape[1]} columns, it must have {count}"
            )
        for row in value.values:
            known = ~np.isnan(row) if loose else np.full(count, True)
            validation.check_values(name, row[known], least=lowest[known])
        return value
    if callable(value):
        return _Function(name, value, (count,), loose=loose, least=least)
    if loose:
        what = (
            f"{count} numbers in {unit} (None where a tendon has a command of another kind), "
            "a table or a function"
        )
        row = validation.read(name, value, what)
        if row.shape != (count,):
            raise InputError(f"{name} is {validation.shown(value)}, it must be {what}")
        known = ~np.isnan(row)
        validation.check_values(name, row[known], least=lowest[known])
        return Table([0.0], row[None, :])
    row = validation.row(name, value, count, unit, ", a table or a function", least)
    return Table([0.0], row[None, :])
