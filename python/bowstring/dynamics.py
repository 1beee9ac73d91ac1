"""Dynamics of a robot: tensions and loads over time to motion, fields and energies.

Everything is SI, in the base frame (z along the straight backbone) unless said otherwise.
N is the number of disks, T the number of tendons.
"""

from __future__ import annotations

import os
import signal
import threading
import time as clock
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring import arguments
from bowstring.drive import refuse_friction
from bowstring.errors import InputError, NoSolutionError
from bowstring.oscillations import Modes, modes
from bowstring.rod import TendonPath, Theory

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

    from bowstring.fields import Frames
    from bowstring.robot import Robot

__all__ = [
    "Modes",
    "NoStart",
    "Run",
    "RunInterrupted",
    "Table",
    "modes",
    "ramp",
    "simulate",
    "step",
]

Floats = NDArray[np.float64]
Status = Literal["converged", "step_failed", "collision", "interrupted", "failed"]

DEFAULT_INTERVAL: Final = 0.01
DEFAULT_SPECTRAL_RADIUS: Final = 0.8
DEFAULT_POINTS: Final = 5
_TOLERANCE_SHARE: Final = 2e-6  # of the length, in each step
_SHORTEST: Final = 1e-6  # s, between two outputs
_LOOK: Final = 0.1  # seconds between two looks at the keyboard
_MOST_OUTPUTS: Final = 1_000_000
_LONGEST_WHY: Final = 300  # letters of an error of a user's function
_INCREMENTS: Final = 20  # in which forces on disks are put on
_NONE: Final = (0.0, 0.0, 0.0)


class Table:
    """Values over time, straight between the times given, constant before and after them.

    Parameters
    ----------
    times : array_like (K,)
        In s, never decreasing; the same time twice is a jump.
    values : array_like (K, C)
        One row a time: a tension for each tendon in N, or a vector.

    Raises
    ------
    InputError
        If times decrease, three are the same, or numbers are not finite.
    """

    def __init__(self, times: ArrayLike, values: ArrayLike) -> None:
        try:
            self.times = arguments.floats(times)
            self.values = arguments.floats(values)
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
        for name, array in (("times", self.times), ("values", self.values)):
            if not np.isfinite(array).all():
                row = int(np.argwhere(~np.isfinite(array))[0][0])
                raise InputError(f"the {name} of a table over time are not finite in row {row}")
        gaps = np.diff(self.times)
        if (gaps < 0).any():
            row = int(np.argmax(gaps < 0)) + 1
            raise InputError(
                f"the times of a table must not decrease: {self.times[row]:g} s in row {row} "
                f"comes after {self.times[row - 1]:g} s"
            )
        if ((gaps[1:] == 0) & (gaps[:-1] == 0)).any():
            raise InputError("a table over time has the same time three times; a jump takes two")

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
        return np.asarray(low + np.clip(share, 0.0, 1.0)[:, None] * (high - low))

    def jumps(self) -> Floats:
        """The times of its jumps."""
        return np.asarray(self.times[1:][np.diff(self.times) == 0])


def ramp(values: ArrayLike, rise: float, start: float = 0.0) -> Table:
    """A rise in a straight line from zero to `values`, which takes `rise` seconds; then hold."""
    try:
        end = np.atleast_1d(arguments.floats(values))
    except TypeError:
        raise InputError(
            f"the values of a ramp are {arguments.shown(values)}, they must be numbers"
        ) from None
    rise = arguments.number("rise", rise, "s", zero=True)
    start = arguments.number("start", start, "s", zero=True)
    return Table([start, start + rise], [np.zeros_like(end), end])


def step(values: ArrayLike, start: float = 0.0) -> Table:
    """A jump from zero to `values` at `start`."""
    return ramp(values, 0.0, start)


OverTime = Table | Callable[[float], ArrayLike] | ArrayLike


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during `simulate`; `run` holds everything up to there."""

    def __init__(self, run: Run) -> None:
        super().__init__(run.message)
        self.run = run


class NoStart(NoSolutionError):
    """No equilibrium to start `simulate` from; `run` has no times, but what was asked for."""

    def __init__(self, message: str, run: Run) -> None:
        super().__init__(message, status="no_equilibrium")
        self.run = run

    def __reduce__(self) -> tuple[type[NoStart], tuple[str, Run]]:
        return NoStart, (str(self), self.run)  # out of a pool of processes


@dataclass(eq=False)
class Run:
    """A simulated motion; made by `simulate`.

    Attributes
    ----------
    robot : Robot
    status : str
        ``"converged"``: every step did, to the end. Else the run holds what came before:
        ``"step_failed"`` (the shortest step did not converge), ``"collision"`` (two disks met),
        ``"interrupted"`` (Ctrl-C), ``"failed"`` (a function of time gave no number).
    reason : str
        A sentence where it did not reach its end.
    settings : dict
        What was simulated, as kept in the file.
    time : ndarray (K,)
        Output times in s, from 0.
    tip_position, tip_velocity : ndarray (K, 3)
        In m and m/s.
    steps, iterations, repeated : int
        Accepted steps, Newton iterations, and steps done again shorter or without numerical
        damping.
    wall_s : float
        Seconds that the motion took to compute, output to files left out.
    path : Path or None
        File of the run.
    """

    robot: Robot
    settings: dict[str, Any]
    status: Status = "converged"
    reason: str = ""
    time: Floats = field(default_factory=lambda: np.zeros(0))
    tip_position: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    tip_velocity: Floats = field(default_factory=lambda: np.zeros((0, 3)))
    steps: int = 0
    iterations: int = 0
    repeated: int = 0
    wall_s: float = 0.0
    path: Path | None = None
    frames: Frames | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        return f"<Run of {self.robot.name}: {self.message}>"

    @property
    def converged(self) -> bool:
        """Whether every step converged, to the end."""
        return self.status == "converged"

    @property
    def end(self) -> float:
        """Time reached, s."""
        return float(self.time[-1]) if len(self.time) else 0.0

    @property
    def real_time_factor(self) -> float:
        """Seconds of motion for one second of computing."""
        return self.end / self.wall_s if self.wall_s > 0 else float("inf")

    @property
    def message(self) -> str:
        """One sentence on how the run ended."""
        if self.converged:
            return f"{self.end:g} s in {self.steps} steps"
        return f"stopped at {self.end:.6g} s: {self.reason}"

    @cached_property
    def dataset(self) -> xr.Dataset:
        """All fields with units and frames, see `bowstring.fields`; from the file if it has one."""
        from bowstring import fields as labelled
        from bowstring.runfile import read_run

        if self.path is not None:
            return read_run(self.path)
        if self.frames is None:
            raise InputError("the run kept no fields: simulate with points of 2 or more")
        return labelled.to_dataset(
            self.robot, self.frames, self.settings, status=self.status, reason=self.reason
        )

    def tip_at(self, times: ArrayLike) -> Floats:
        """Tip position (K, 3) at any times (K,) of the run, from positions and velocities.

        Raises
        ------
        InputError
            If a time lies outside the run.
        """
        try:
            t = np.atleast_1d(arguments.floats(times))
        except TypeError:
            raise InputError(
                f"times is {arguments.shown(times)}, they must be numbers in s"
            ) from None
        if t.ndim != 1:
            raise InputError(f"times has shape {t.shape}, it must be (K,), in s")
        slack = 1e-9 * (1.0 + self.end)
        if len(self.time) == 0 or not ((t >= -slack) & (t <= self.end + slack)).all():
            raise InputError(f"times of a run lie from 0 to {self.end:g} s")
        if len(self.time) == 1:
            return np.repeat(self.tip_position, len(t), axis=0)
        i = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[i + 1] - self.time[i])[:, None]
        s = (t[:, None] - self.time[i][:, None]) / h
        a, b = self.tip_position[i], self.tip_position[i + 1]
        va, vb = h * self.tip_velocity[i], h * self.tip_velocity[i + 1]
        # cubic Hermite
        rest = 1.0 - s
        result: Floats = rest**2 * (a * (1 + 2 * s) + va * s) + s**2 * (b * (3 - 2 * s) - vb * rest)
        return result

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise.

        Raises
        ------
        NoSolutionError
            The text says when it stopped, and why.
        """
        if not self.converged:
            raise NoSolutionError(f"{self.robot.name}: {self.message}", status=self.status)
        return self


def simulate(
    robot: Robot,
    tensions: OverTime,
    duration: float,
    *,
    tip_force: OverTime = _NONE,
    tip_moment: OverTime = _NONE,
    initial_tensions: ArrayLike | None = None,
    initial_tip_force: ArrayLike | None = None,
    initial_tip_moment: ArrayLike | None = None,
    initial_disk_forces: ArrayLike | None = None,
    theory: Theory = "cosserat",
    gravity: Sequence[float] | None = None,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int = 1,
    mass_damping: float = 0.0,
    material_damping: float = 0.0,
    modal_damping: float | None = None,
    spectral_radius: float = DEFAULT_SPECTRAL_RADIUS,
    dt: float | None = None,
    tolerance: float | None = None,
    every: float = DEFAULT_INTERVAL,
    points: int = DEFAULT_POINTS,
    out: str | Path | None = None,
    progress: Callable[[float], None] | None = None,
) -> Run:
    """Simulate the motion from rest in an equilibrium.

    Implicit and of second order; see ``bowstring-core/src/motion.rs`` for the scheme. Each output
    time is the end of a step.

    Parameters
    ----------
    robot : Robot
    tensions : Table, callable or array_like (T,)
        Tension of each tendon over time in N: a table (`ramp`, `step`, `Table`), a function of
        time that is called once before each step, for the step's end, or constant.
    duration : float
        In s.
    tip_force, tip_moment : Table, callable or array_like (3,)
        Dead loads at the tip over time, base axes, N and N m.
    initial_tensions, initial_tip_force, initial_tip_moment : array_like, optional
        Loads of the equilibrium at the start; those of time 0 if not given, before a jump there.
        With other loads at time 0 the robot is released.
    initial_disk_forces : array_like (N, 3), optional
        Dead forces on the disks beside these, which hold the robot at the start and are let go at
        time 0.
    theory, gravity, tendon, twist, elements
        As in `bowstring.rod.solve`.
    mass_damping : float
        Force per mass and velocity, on all mass and inertia, in 1/s.
    material_damping : float
        Kelvin-Voigt: the stress of the strain's rate over that of the strain, in s.
    modal_damping : float, optional
        Instead of these two: a ratio of critical damping (0.01 is 1 %) that the slowest mode has,
        and the first that is at least twice as fast, about the equilibrium at the start (forces on
        disks left out).
    spectral_radius : float
        Numerical damping: what a long step leaves of the fastest oscillation, 0 to 1. At 1 there
        is none, and energy is conserved.
    dt : float, optional
        Longest step in s. If not given, steps adapt to `tolerance`.
    tolerance : float, optional
        Error of a disk's position in one step to aim for, m; 2e-6 of the length if not given. Steps
        are 10 ms at most.
    every : float
        Time between two outputs in s; `dt` if that is longer.
    points : int
        Stations in each module at which fields are given; 0 keeps none, only the tip's motion.
    out : path, optional
        Writes all fields to this NetCDF file while the run goes on; the file is whole at every
        moment. The fields are then not kept in memory.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    Run
        A run that stops early is returned as well: look at `Run.status`, or call
        `Run.raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong, the drive is full, or a function of time fails; what was written
        before stays.
    NoStart
        A `NoSolutionError`: there is no equilibrium to start from.
    RunInterrupted
        On Ctrl-C.
    """
    arguments.check_robot(robot)
    refuse_friction(robot, "simulate")
    arguments.check_choices(theory, tendon, twist, elements)
    duration = arguments.number("duration", duration, "s", zero=True)
    every = arguments.number("every", every, "s")
    for name, value in (("duration", duration), ("every", every)):
        if 0 < value < _SHORTEST:
            raise InputError(
                f"{name} is {value:g} s, it must be {_SHORTEST:g} s or more: shorter steps drown "
                "in rounding"
            )
    if dt is not None:
        dt = arguments.number("dt", dt, "s")
        every = max(every, dt)
    if tolerance is not None and dt is not None:
        raise InputError("give dt or tolerance, not both: a fixed step has no tolerance")
    if tolerance is None:
        tolerance = _TOLERANCE_SHARE * robot.length
    tolerance = arguments.number("tolerance", tolerance, "m")
    mass_damping = arguments.number("mass_damping", mass_damping, "1/s", zero=True)
    material_damping = arguments.number("material_damping", material_damping, "s", zero=True)
    spectral_radius = arguments.number("spectral_radius", spectral_radius, "", zero=True)
    if not arguments.is_whole(points) or not (points == 0 or 2 <= points <= 1000):
        raise InputError(
            f"points is {arguments.shown(points)}, it must be a whole number from 2 to 1000, or 0"
        )
    if gravity is not None:
        gravity = arguments.row("gravity", gravity, 3, "m/s^2").tolist()
    if points == 0 and out is not None:
        raise InputError("points is 0, a file needs fields: give 2 or more")
    if out is not None and not isinstance(out, str | os.PathLike):
        raise InputError(f"out is {arguments.shown(out)}, it must be the path of a file")
    if progress is not None and not callable(progress):
        raise InputError(f"progress is {arguments.shown(progress)}, it must be a function")
    points, elements = int(points), int(elements)  # numpy's are not for files
    count = len(robot.tendons.end_disk)
    loads = _Loads(
        _over_time("tensions", tensions, count, "N"),
        _over_time("tip_force", tip_force, 3, "N"),
        _over_time("tip_moment", tip_moment, 3, "N m"),
    )
    start = loads.at(0.0, before=True)
    initial = _Load(
        _given("initial_tensions", initial_tensions, start.tensions),
        _given("initial_tip_force", initial_tip_force, start.tip_force),
        _given("initial_tip_moment", initial_tip_moment, start.tip_moment),
    )
    holding = None
    if initial_disk_forces is not None:
        try:
            holding = arguments.floats(initial_disk_forces)
        except TypeError:
            raise InputError("initial_disk_forces must be numbers, one row a disk, in N") from None
        if holding.shape != (len(robot.disks.station_m), 3) or not np.isfinite(holding).all():
            raise InputError(
                f"initial_disk_forces must be finite, of shape ({len(robot.disks.station_m)}, 3) "
                f"in N; got shape {holding.shape}"
            )
    settings: dict[str, Any] = {
        "theory": theory,
        "gravity_m_per_s2": [float(g) for g in (robot.gravity if gravity is None else gravity)],
        "tendon": tendon,
        "twist": twist,
        "elements": elements,
        "duration_s": duration,
        "mass_damping_per_s": mass_damping,
        "material_damping_s": material_damping,
        "spectral_radius": spectral_radius,
        "dt_s": dt,
        "tolerance_m": None if dt is not None else tolerance,
        "every_s": every,
        **loads.to_dict(),
        **initial.to_dict("initial_"),
        "initial_disk_forces_N": None if holding is None else holding.tolist(),
    }
    run = Run(robot, settings)
    if modal_damping is not None:
        if mass_damping or material_damping:
            raise InputError("give modal_damping, or mass and material damping, not both")
        ratio = arguments.number("modal_damping", modal_damping, zero=True)
        physics = {"theory": theory, "gravity": gravity, "tendon": tendon}
        try:
            mass_damping, material_damping = _rayleigh(
                robot, ratio, initial, twist=twist, elements=elements, **physics
            )
        except NoSolutionError as error:
            settings["mass_damping_per_s"] = settings["material_damping_s"] = None
            raise NoStart(str(error), run) from None
        settings["mass_damping_per_s"] = mass_damping
        settings["material_damping_s"] = material_damping
    from bowstring import _core

    simulator = _core.Simulator(
        robot.core,
        theory,
        tendon,
        twist,
        elements,
        gravity,
        float(mass_damping),
        float(material_damping),
        float(spectral_radius),
        dt,
        tolerance,
        min(every, DEFAULT_INTERVAL),
    )
    times = _output_times(duration, every)
    stations = _stations(robot, points)
    keep: list[Frames] = []
    tips: list[tuple[Floats, Floats, Floats]] = []
    from bowstring.runfile import RunFile, check_file

    if out is not None:
        check_file(out)
    file: RunFile | None = None

    last = -1.0

    def take(result: dict[str, Any]) -> None:
        nonlocal last
        # where a motion stops, the core gives the last output time again
        new = np.diff(result["time"], prepend=last) > 0
        if not new.all():
            rows = {k: v[new] for k, v in result.items() if np.shape(v)[:1] == new.shape}
            result = {**result, **rows}
        if len(result["time"]):
            last = float(result["time"][-1])
            tip = result["disk_position"][:, -1], result["disk_velocity"][:, -1]
            tips.append((result["time"], *tip))
            if points:
                frames = _frames(result, stations)
                if file is not None:
                    file.append(frames)
                else:
                    keep.append(frames)
        run.steps += result["steps"]
        run.iterations += result["iterations"]
        run.repeated += result["repeated"]

    def finish(status: Status, reason: str = "") -> None:
        run.status, run.reason = status, reason
        if keep:
            run.frames = _joined(keep)
        if file is not None:
            with _deaf():
                file.finish(status, reason)
        if tips:
            time, position, velocity = (np.concatenate(parts) for parts in zip(*tips, strict=True))
            # an interrupt may have fallen between two of these places: go by what is kept
            if file is not None:
                time = time[time <= file.complete_to]
            elif run.frames is not None:
                time = time[time <= run.frames.time[-1]]
            run.time = time
            run.tip_position, run.tip_velocity = position[: len(time)], velocity[: len(time)]

    try:
        begun = clock.perf_counter()
        status = simulator.rest(*initial)
        if status != "converged":
            raise NoStart(
                f"{robot.name}: there is no equilibrium to start from ({status}); "
                "bowstring.solve with the loads at the start tells more",
                run,
            )
        if holding is not None and not simulator.hold(holding, _INCREMENTS):
            raise NoStart(
                f"{robot.name}: there is no stable equilibrium to start from under the forces on "
                "its disks",
                run,
            )
        first = simulator.run(*_rows([0.0], [initial]), np.array([True]), points)
        if holding is not None:
            simulator.release()
        simulator.jump(*loads.at(0.0))
        run.wall_s += clock.perf_counter() - begun
        # a former run in its place is given up only for one that has begun
        if out is not None:
            file = RunFile.open(out, robot, settings, points=len(times) * len(stations[0]))
            run.path = file.path
        take(first)
        jumps = loads.jumps()
        begun = clock.perf_counter()
        reached = 0.0
        for stretches in loads.chunks(
            simulator, times.copy(), dt if dt is not None else min(every, DEFAULT_INTERVAL)
        ):
            result = simulator.run(*stretches, points)
            run.wall_s += clock.perf_counter() - begun
            take(result)
            if result["stop"] is not None:
                finish(result["stop"], _WHY[result["stop"]])
                return run
            reached += float(stretches[0].sum())
            for jump in jumps:
                if abs(jump - reached) <= 1e-9 * (1 + reached) and jump < duration:
                    simulator.jump(*loads.at(jump))
            if progress is not None and duration > 0:
                progress(min(simulator.time / duration, 1.0))
            begun = clock.perf_counter()
        finish("converged")
    except KeyboardInterrupt:
        ended = False
        while not ended:
            try:
                finish("interrupted", "stopped by the user")
                ended = True
            except KeyboardInterrupt:  # one more, which waited with the first
                continue
        raise RunInterrupted(run) from None
    except BaseException as error:
        finish("failed", str(error) or type(error).__name__)
        raise
    return run


@contextmanager
def _deaf() -> Iterator[None]:
    """A second Ctrl-C within is not heard: how a run ended is written whole."""
    heard = []
    if threading.current_thread() is threading.main_thread():  # the only one that hears any
        heard = [
            number
            for number in (signal.SIGINT, signal.SIGTERM)
            if signal.getsignal(number) is signal.default_int_handler
        ]
    try:
        for number in heard:
            signal.signal(number, signal.SIG_IGN)
        yield
    finally:
        for number in heard:
            signal.signal(number, signal.default_int_handler)


_WHY: Final[dict[str, str]] = {
    "step_failed": "even the shortest step did not converge; change the load more slowly, damp the "
    "motion (a little), or give a larger tolerance",
    "collision": "two neighbouring disks met: the load closes the gap between them",
}


# --------------------------------------------------------------------------------------
# Loads over time
# --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Load:
    tensions: Floats
    tip_force: Floats
    tip_moment: Floats

    def __iter__(self) -> Iterator[Floats]:
        return iter((self.tensions, self.tip_force, self.tip_moment))

    def to_dict(self, prefix: str) -> dict[str, Any]:
        names = ("tensions_N", "tip_force_N", "tip_moment_Nm")
        return {prefix + n: v.tolist() for n, v in zip(names, self, strict=True)}


class _Function:
    """A user's function of time, whose values are checked."""

    def __init__(self, name: str, function: Callable[[float], ArrayLike], count: int) -> None:
        self.name, self.function, self.count = name, function, count

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
            value = arguments.floats(given)
        except TypeError:
            raise InputError(
                f"the function for {self.name} returned {arguments.shown(given)} at {time:.6g} s, "
                f"it must be {self.count} numbers"
            ) from None
        if value.shape != (self.count,):
            raise InputError(
                f"the function for {self.name} returned shape {value.shape} at {time:.6g} s, "
                f"it must be ({self.count},)"
            )
        arguments.check_values(self.name, value, f" at {time:.6g} s")
        return value


_Course = Table | _Function


@dataclass(frozen=True)
class _Loads:
    """All loads over time."""

    tensions: _Course
    tip_force: _Course
    tip_moment: _Course

    @property
    def _all(self) -> tuple[_Course, _Course, _Course]:
        return self.tensions, self.tip_force, self.tip_moment

    def at(self, time: float, *, before: bool = False) -> _Load:
        return _Load(*(c.at(time, before=before) for c in self._all))

    def _knots(self) -> list[float]:
        return sorted({t for c in self._all if isinstance(c, Table) for t in c.times.tolist()})

    def jumps(self) -> set[float]:
        return {float(t) for c in self._all if isinstance(c, Table) for t in c.jumps()}

    def to_dict(self) -> dict[str, Any]:
        def text(course: _Course) -> Any:
            if isinstance(course, _Function):
                return "function of time"
            return {"times_s": course.times.tolist(), "values": course.values.tolist()}

        return {
            "tensions_N": text(self.tensions),
            "tip_force_N": text(self.tip_force),
            "tip_moment_Nm": text(self.tip_moment),
        }

    def chunks(self, simulator: Any, times: Floats, longest: float) -> Iterator[_Stretches]:
        """Stretches of time to run through at once, some `_LOOK` seconds of work each."""
        # a knot that an output time misses by next to nothing is that time
        near = 1e-6 * longest
        inside = []
        for knot in self._knots():
            i = int(np.abs(times - knot).argmin())
            if near < knot < times[-1] - near:
                inside.append(knot)
                if abs(times[i] - knot) <= near:
                    times[i] = knot
        outputs = set(times[1:].tolist())
        # numpy's own sets would import a fifth of numpy first
        ends = np.array(sorted(outputs | set(inside)))
        record = np.array([end in outputs for end in ends.tolist()], dtype=bool)
        if any(isinstance(c, _Function) for c in self._all):
            yield from self._sampled(simulator, ends, record, longest)
            return
        durations = np.diff(ends, prepend=0.0)
        tensions, force, moment = (c.rows(ends, before=True) for c in self._all)
        jumps = self.jumps()
        stops = np.flatnonzero([end in jumps for end in ends.tolist()]) + 1
        steps = float(durations.max(initial=0.0)) / longest
        first, size = 0, max(1, int(min(50.0, 2000.0 / max(steps, 1.0))))
        while first < len(ends):
            begun = clock.perf_counter()
            next_stop = stops[np.searchsorted(stops, first, side="right") :]
            last = min([first + size, len(ends), *next_stop[:1].tolist()])
            part = slice(first, last)
            yield durations[part], tensions[part], force[part], moment[part], record[part]
            spent = max(clock.perf_counter() - begun, 1e-9)
            size = int(np.clip((last - first) * _LOOK / spent, 1, min(4 * size, 1000)))
            first = last

    def _sampled(
        self, simulator: Any, ends: Floats, record: NDArray[np.bool_], longest: float
    ) -> Iterator[_Stretches]:
        # a step at a time, for the function is asked before each
        now = 0.0
        for end, wanted in zip(ends.tolist(), record.tolist(), strict=True):
            while now < end:
                reach = min(simulator.next_step, longest)
                left = max(1, int(np.ceil((end - now) / reach - 1e-6)))
                then = end if left == 1 else now + (end - now) / left
                tensions, force, moment = (row[None, :] for row in self.at(then, before=True))
                recorded = np.array([wanted and left == 1])
                yield np.array([then - now]), tensions, force, moment, recorded
                now = then


_Stretches = tuple[Floats, Floats, Floats, Floats, NDArray[np.bool_]]
"""Durations, loads at their ends (three arrays of rows), and where to record."""


def _over_time(name: str, value: Any, count: int, unit: str) -> _Course:
    if isinstance(value, Table):
        if value.values.shape[1] != count:
            raise InputError(
                f"the table for {name} has {value.values.shape[1]} columns, it must have {count}"
            )
        for row in value.values:
            arguments.check_values(name, row)
        return value
    if callable(value):
        return _Function(name, value, count)
    row = arguments.row(name, value, count, unit, ", a table or a function")
    return Table([0.0], row[None, :])


def _given(name: str, value: ArrayLike | None, otherwise: Floats) -> Floats:
    unit = "N m" if "moment" in name else "N"
    return otherwise if value is None else arguments.row(name, value, len(otherwise), unit)


def _output_times(duration: float, every: float) -> Floats:
    if duration / every > _MOST_OUTPUTS:
        raise InputError(
            f"{duration:g} s at an output every {every:g} s are more than {_MOST_OUTPUTS} outputs; "
            "give a longer every"
        )
    count = int(np.floor(duration / every + 1e-9))
    times = np.asarray(np.arange(count + 1) * every, dtype=np.float64)
    if duration - times[-1] > 1e-9 * duration:
        return np.concatenate([times, [duration]])
    times[-1] = duration
    return times


def _rayleigh(robot: Robot, ratio: float, load: _Load, **physics: Any) -> tuple[float, float]:
    """Mass damping in 1/s and material damping in s that give two modes a damping ratio."""
    if load.tip_moment.any():
        raise InputError("modal_damping needs modes, and a tip moment leaves none: give the others")
    found = modes(robot, load.tensions, tip_force=load.tip_force, count=12, **physics)
    slow = 2.0 * np.pi * float(found.frequency_hz[0])
    faster = found.frequency_hz[found.frequency_hz >= 2.0 * found.frequency_hz[0]]
    fast = 2.0 * np.pi * float(faster[0]) if len(faster) else 10.0 * slow
    return 2.0 * ratio * slow * fast / (slow + fast), 2.0 * ratio / (slow + fast)


# --------------------------------------------------------------------------------------
# Raw output
# --------------------------------------------------------------------------------------


def _stations(robot: Robot, points: int) -> tuple[Floats, NDArray[np.int64]]:
    """Arc length and module of every point, both ends of each flexible part among them."""
    disks = robot.disks
    held = disks.clamped_length_m / 2.0
    end = disks.station_m - held
    start = np.concatenate([[0.0], disks.station_m[:-1] + held[:-1]])
    share = np.linspace(0.0, 1.0, points)
    station = start[:, None] + share * (end - start)[:, None]
    return station.ravel(), np.repeat(np.arange(len(start)), points)


def _frames(result: dict[str, Any], stations: tuple[Floats, NDArray[np.int64]]) -> Frames:
    from bowstring.fields import Frames

    names = [f.name for f in fields(Frames) if f.name not in ("station", "module")]
    return Frames(station=stations[0], module=stations[1], **{n: result[n] for n in names})


def _joined(parts: Sequence[Frames]) -> Frames:
    first = parts[0]
    names = [f.name for f in fields(first) if f.name not in ("station", "module")]
    return replace(first, **{n: np.concatenate([getattr(p, n) for p in parts]) for n in names})


def _rows(
    durations: Iterable[float], loads: Sequence[_Load]
) -> tuple[Floats, Floats, Floats, Floats]:
    return (
        np.array(list(durations)),
        np.array([load.tensions for load in loads]).reshape(len(loads), -1),
        np.array([load.tip_force for load in loads]),
        np.array([load.tip_moment for load in loads]),
    )


def at_rest(
    robot: Robot,
    tensions: ArrayLike,
    *,
    tip_force: ArrayLike,
    tip_moment: ArrayLike,
    gravity: Sequence[float],
    theory: Theory,
    tendon: TendonPath,
    twist: bool,
    elements: int,
    points: int,
) -> Frames:
    """Raw fields of an equilibrium, as of a run that has not begun; see `Solution.fields`."""
    from bowstring import _core

    refuse_friction(robot, "the fields of an equilibrium")
    simulator = _core.Simulator(
        robot.core, theory, tendon, twist, elements, gravity, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0
    )
    load = _Load(*(np.asarray(v, dtype=float) for v in (tensions, tip_force, tip_moment)))
    status = simulator.rest(*load)
    if status != "converged":
        raise NoSolutionError(
            f"{robot.name}: there is no equilibrium to take fields of ({status})",
            status="no_equilibrium",
        )
    result = simulator.run(*_rows([0.0], [load]), np.array([True]), points)
    return _frames(result, _stations(robot, points))
