"""Loads over time: tables, ramps and functions, and the stretches of time between their corners.

Everything is SI. T is the number of tendons.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring import validation
from bowstring.errors import InputError
from bowstring.formatting import plain
from bowstring.statics import actuation
from bowstring.statics.load import InstantLoad, Load

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

__all__ = ["CLOSEST", "Actuation", "Loads", "OverTime", "Table", "over_time", "ramp", "step"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

_LOOK: Final = 0.1  # seconds between two looks at the keyboard
_WORK: Final = 3e-6  # seconds of a step and module, as guessed for the first stretch
_MOST_AT_FIRST: Final = 250  # times in the first stretch, should the guess be bad
_LONGEST_WHY: Final = 300  # letters of an error of a user's function
CLOSEST: Final = 1e-11  # s, between two times: a step of 1e-13 is below numerical resolution


class Table:
    """Values over time, straight between the times given, constant before and after them.

    Parameters
    ----------
    times : array_like (K,)
        In s, never decreasing; the same time twice is a jump.
    values : array_like (K, C)
        One row a time: a tension for each tendon in N, a displacement in m, or a vector. A column
        of NaN is a tendon with a command of another kind.

    Raises
    ------
    InputError
        If times decrease, three are the same, two are the same but for rounding, or numbers are
        not finite.
    """

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        try:
            self.times = validation.floats(times)
            self.values = validation.floats(values)
        except TypeError:
            raise InputError("a table over time takes numbers: times (K,), values (K, C)") from None
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
        """The row at a time, after a jump there, or before it."""
        return np.asarray(self.rows(np.array([time]), before=before)[0])

    def rows(self, times: Floats, *, before: bool = False) -> Floats:
        """The rows (K, C) at several times (K,)."""
        side: Literal["left", "right"] = "left" if before else "right"
        i = np.searchsorted(self.times, times, side=side)
        a, b = np.clip(i - 1, 0, None), np.clip(i, None, len(self.times) - 1)
        gap = self.times[b] - self.times[a]
        share = np.where(gap > 0, (times - self.times[a]) / np.where(gap > 0, gap, 1.0), 0.0)
        low, high = self.values[a], self.values[b]
        between = low + share[:, None] * (high - low)
        return np.asarray(np.where(share[:, None] >= 1.0, high, between))  # the end is met exactly

    def knots(self) -> set[float]:
        """The times of its corners and jumps."""
        return set(self.times.tolist())

    def jumps(self) -> set[float]:
        """The times of its jumps."""
        return set(self.times[1:][np.diff(self.times) == 0].tolist())

    @property
    def is_sampled(self) -> bool:
        """Whether it must be asked before each step."""
        return False

    def to_dict(self) -> Any:
        """Times and values, for a file; None where a tendon has a command of another kind."""
        return {"times_s": self.times.tolist(), "values": plain(self.values)}


def ramp(values: ArrayLike, rise: float, start: float = 0.0) -> Table:
    """Raise values from zero in a straight line, then hold them.

    Parameters
    ----------
    values : array_like (T,)
        After the rise, for example tensions in N.
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
    return Table([start, start + rise], [0.0 * end, end])


def step(values: ArrayLike, start: float = 0.0) -> Table:
    """Jump from zero to values.

    Parameters
    ----------
    values : array_like (T,)
        After the jump, for example tensions in N.
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
    """A user's function of time, whose values are checked."""

    is_sampled = True

    def __init__(
        self, name: str, function: Callable[[float], ArrayLike], count: int, *, loose: bool = False
    ) -> None:
        self.name, self.function, self.count, self.loose = name, function, count, loose

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
                f"it must be {self.count} numbers"
            ) from None
        if value.shape != (self.count,):
            raise InputError(
                f"the function for {self.name} returned shape {value.shape} at {time:.6g} s, "
                f"it must be ({self.count},)"
            )
        said = value[~np.isnan(value)] if self.loose else value
        validation.check_values(self.name, said, f" at {time:.6g} s")
        return value

    def knots(self) -> set[float]:
        return set()

    def jumps(self) -> set[float]:
        return set()

    def to_dict(self) -> Any:
        return "function of time"


class Actuation:
    """Actuation of the tendons over time: each by a tension, a displacement or a motor angle.

    Attributes
    ----------
    by_displacement : ndarray of bool (T,)
        Whether the displacement of each is given, which stays so.

    Parameters
    ----------
    load : Load
        Its tensions, displacements and angles, each a table, a function or constant.
    until : float
        Where the run ends, s: what is asked for after that is not looked at.
    """

    def __init__(self, robot: Robot, load: Load, until: float) -> None:
        self._robot = robot
        count = robot.core.tendon_count
        alone = load.is_tension_controlled and load.tensions is not None
        self._histories: dict[str, _History] = {
            name: over_time(name, getattr(load, name), count, unit, loose=not alone)
            for name, unit in actuation.KINDS.items()
            if getattr(load, name) is not None
        }
        self._alone = self._histories["tensions"] if alone else None
        self._longest = robot.disks.station_m[robot.tendons.end_disk]
        self.by_displacement: Bools = np.zeros(count, bool)
        if not alone:
            self.by_displacement, _ = self._commands(0.0, before=True)
            if not self.is_sampled:  # what is wrong later on is wrong before the work
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
        """The same at several times (K,): (K, T)."""
        if self._alone is not None:
            return self._alone.rows(times, before=before)
        if self.is_sampled:
            return np.array([self.at(t, before=before) for t in times.tolist()])
        rows = {name: c.rows(times, before=before) for name, c in self._histories.items()}
        _, values = actuation.commands(self._robot, Load(**rows), rows=True)
        self._check_lengths(times, values)
        return values

    def knots(self) -> set[float]:
        """The times of corners and jumps."""
        return set().union(*(c.knots() for c in self._histories.values()))

    def jumps(self) -> set[float]:
        """The times of jumps."""
        return set().union(*(c.jumps() for c in self._histories.values()))

    @property
    def is_sampled(self) -> bool:
        """Whether it must be asked before each step."""
        return any(c.is_sampled for c in self._histories.values())

    def to_dict(self) -> dict[str, Any]:
        """For a file, by ``tensions_N``, ``displacements_m`` and ``angles_rad``."""
        keys = {
            "tensions": "tensions_N",
            "displacements": "displacements_m",
            "angles": "angles_rad",
        }
        return {keys[name]: c.to_dict() for name, c in self._histories.items()}


_History = Table | _Function


class Loads(NamedTuple):
    """All loads over time."""

    actuation: Actuation
    tip_force: _History
    tip_moment: _History

    def at(self, time: float, *, before: bool = False) -> InstantLoad:
        """The loads at a time, after a jump there, or before it."""
        return InstantLoad(*(c.at(time, before=before) for c in self))

    def jumps(self) -> set[float]:
        """The times of jumps."""
        return set().union(*(c.jumps() for c in self))

    def to_dict(self) -> dict[str, Any]:
        """For a file."""
        return {
            **self.actuation.to_dict(),
            "tip_force_N": self.tip_force.to_dict(),
            "tip_moment_Nm": self.tip_moment.to_dict(),
        }

    def chunks(
        self, simulator: Any, times: Floats, longest: float, modules: int
    ) -> Iterator[Stretches]:
        """Stretches of time to run through at once, some `_LOOK` seconds of work each.

        `modules` are those of the robot, each counted as often as it has elements.
        """
        # a knot that an output time misses by next to nothing is that time
        near = max(1e-6 * longest, CLOSEST)
        inside: list[float] = []
        for knot in sorted(set().union(*(c.knots() for c in self))):
            i = int(np.abs(times - knot).argmin())
            if inside and knot - inside[-1] < CLOSEST:
                continue  # of another table: 0.1 + 0.2 s is 0.3 s
            if near < knot < times[-1] - near:
                inside.append(knot)
                if abs(times[i] - knot) <= near:
                    times[i] = knot
        outputs = set(times[1:].tolist())
        # numpy's own sets would import a fifth of numpy first
        ends = np.array(sorted(outputs | set(inside)))
        record = np.array([end in outputs for end in ends.tolist()], dtype=bool)
        if any(c.is_sampled for c in self):
            yield from self._sampled(simulator, ends, record, longest)
            return
        durations = np.diff(ends, prepend=0.0)
        commands, force, moment = (c.rows(ends, before=True) for c in self)
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
            yield durations[part], commands[part], force[part], moment[part], record[part]
            spent = max(clock.perf_counter() - begun, 1e-9)
            size = int(np.clip((last - first) * _LOOK / spent, 1, min(4 * size, 1000)))
            first = last

    def _sampled(
        self, simulator: Any, ends: Floats, record: NDArray[np.bool_], longest: float
    ) -> Iterator[Stretches]:
        # a step at a time, for the function is asked before each
        now = 0.0
        for end, wanted in zip(ends.tolist(), record.tolist(), strict=True):
            while now < end:
                reach = min(simulator.next_step, longest)
                left = max(1, int(np.ceil((end - now) / reach - 1e-6)))
                then = end if left == 1 else now + (end - now) / left
                commands, force, moment = (row[None, :] for row in self.at(then, before=True))
                recorded = np.array([wanted and left == 1])
                yield np.array([then - now]), commands, force, moment, recorded
                now = then


Stretches = tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]
"""Durations, loads at their ends (three arrays of rows), and where to record."""


def over_time(name: str, value: Any, count: int, unit: str, *, loose: bool = False) -> _History:
    """A course from what a user gave; ``loose``: with NaN or None where another one tells."""
    if isinstance(value, Table):
        if value.values.shape[1] != count:
            raise InputError(
                f"the table for {name} has {value.values.shape[1]} columns, it must have {count}"
            )
        for row in value.values:
            validation.check_values(name, row[~np.isnan(row)] if loose else row)
        return value
    if callable(value):
        return _Function(name, value, count, loose=loose)
    if loose:
        what = (
            f"{count} numbers in {unit} (None where a tendon has a command of another kind), "
            "a table or a function"
        )
        row = validation.read(name, value, what)
        if row.shape != (count,):
            raise InputError(f"{name} is {validation.shown(value)}, it must be {what}")
        validation.check_values(name, row[~np.isnan(row)])
        return Table([0.0], row[None, :])
    row = validation.row(name, value, count, unit, ", a table or a function")
    return Table([0.0], row[None, :])
