"""Dynamics of a robot: motion, fields and energies under loads over time.

All values are in SI and in the base frame (z along the straight backbone) by default.
N is the number of disks, T the number of tendons. docs/theory/dynamics.md has the equations.
"""

from __future__ import annotations

import os
import time as clock
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from bowstring import interrupts, validation
from bowstring._core import check_memory
from bowstring.aliases import Bools, Floats
from bowstring.display import html_table, millimetres, sampled_rows
from bowstring.dynamics.integrator import DEFAULT_INTERVAL, Integrator, with_ratio
from bowstring.dynamics.load_history import (
    Actuation,
    Loads,
    OverTime,
    disk_row,
    of_base,
    on_disks,
    on_points,
    over_time,
)
from bowstring.dynamics.modal import about
from bowstring.dynamics.start_stability import judged_start
from bowstring.errors import InputError, NoSolutionError, StabilityWarning
from bowstring.formatting import in_mm, in_percent
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.robot.picture import picture
from bowstring.statics import actuation, limits
from bowstring.statics.fields import Frames, Section, completing, to_dataset
from bowstring.statics.load import Load, PointLoad, as_load, point_loads
from bowstring.statics.load_tables import (
    InstantLoad,
    least_elements,
    same_points,
    table_of,
    with_arrays,
    without_wrenches,
)
from bowstring.statics.model import as_model
from bowstring.statics.simulator import Scheme, frames, keep_start, make, stations

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

Status = Literal["converged", "step_failed", "collision", "interrupted", "failed"]

DEFAULT_POINTS: Final = 5
_SHORTEST: Final = 1e-6  # s between two outputs
_LOOK: Final = 0.1  # s of work between two checks for interrupts
_MOST_OUTPUTS: Final = 1_000_000
_LONGEST_WHY: Final = 300  # characters of the error of a user's function
_STILL: Final = 1e-11  # change of a displacement over length that is no jump
_INCREMENTS: Final = 20  # load increments of the forces on disks
_MARGIN: Final = 3.0  # factor on the error by the motion of the base, as the core has for steps
_COARSE: Final = 0.01  # error of the time steps over length that gets advice


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C during `simulate`; `run` contains the motion up to there."""

    def __init__(self, run: Run) -> None:
        super().__init__(run.message)
        self.run = run

    def __reduce__(self) -> tuple[type[RunInterrupted], tuple[Run]]:
        return RunInterrupted, (self.run,)  # pickled in a pool of processes


class NoStart(NoSolutionError):
    """No initial equilibrium for `simulate`; `run` has no times, but the settings."""

    def __init__(self, message: str, run: Run) -> None:
        super().__init__(message, status="no_equilibrium")
        self.run = run

    def __reduce__(self) -> tuple[type[NoStart], tuple[str, Run]]:
        return NoStart, (str(self), self.run)  # pickled in a pool of processes


@dataclass(eq=False)
class Run:
    """Simulated motion; made by `simulate`.

    Attributes
    ----------
    robot : Robot
    status : str
        ``"converged"`` if every step converged. Otherwise the run ends early:
        ``"step_failed"`` (the shortest step did not converge), ``"collision"`` (two disks met),
        ``"interrupted"`` (Ctrl-C), ``"failed"`` (a function of time gave no number).
    reason : str
        Reason if the run ended early, a sentence.
    settings : dict
        Settings of the simulation, as stored in the file.
    time : ndarray (K,)
        Output times in s, from 0.
    tip_position, tip_velocity : ndarray (K, 3)
        Position of the tip in m and its velocity in m/s.
    steps, iterations, repeated : int
        Accepted steps, Newton iterations, and steps repeated shorter or without numerical
        damping.
    error_estimate : float or None
        Estimated bound of the tip's error by time integration, m: three times the sum of the errors
        of all steps and of the curves that join the accelerations of a base that moves, at most the
        distance that the tip moved. Errors that damping has removed since
        are included, so the bound is large where fast oscillations decay. Errors of the elements
        are not included. None if unknown (a run of one or two steps).
    wall_s : float
        Computing time in s without output to files.
    path : Path or None
        File of the run.
    frames : Frames or None
        Raw fields at the output times; None if they are in a file or none were recorded.
    warnings : tuple of str
        Sentences on the start: an equilibrium that is not known to be stable.
    exceeded : tuple of str
        Sentences on what tensions exceed (`bowstring.statics.limits`): those of the fields that are
        kept in memory, else those of tables and constants that give all tendons tensions.
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
    error_estimate: float | None = None
    wall_s: float = 0.0
    path: Path | None = None
    frames: Frames | None = field(default=None, repr=False)
    warnings: tuple[str, ...] = ()
    exceeded: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<Run of {self.robot.name}: {self.message}>"

    def _repr_html_(self) -> str:
        def row(k: int) -> tuple[object, ...]:
            return f"{self.time[k]:.6g} s", millimetres(self.tip_position[k])

        title, drawn = repr(self).strip("<>"), ""
        if self.frames is not None:
            poses = self.frames.disk_position, self.frames.disk_rotation
            drawn = picture(self.robot, *poses, title=title)
        return drawn + html_table(title, sampled_rows(len(self.time), row), ("time", "tip"))

    @property
    def converged(self) -> bool:
        """Whether every step converged."""
        return self.status == "converged"

    @property
    def end(self) -> float:
        """Time reached, s."""
        return float(self.time[-1]) if len(self.time) else 0.0

    @property
    def real_time_factor(self) -> float:
        """Seconds of motion per second of computing."""
        return self.end / self.wall_s if self.wall_s > 0 else float("inf")

    @property
    def message(self) -> str:
        """Message on the end of the run, one sentence."""
        if self.converged:
            error = f"; {self.error_text}" if self.error_text else ""
            steps = "1 step" if self.steps == 1 else f"{self.steps} steps"
            return f"{self.end:g} s in {steps}{error}"
        return f"stopped at {self.end:.6g} s: {self.reason}"

    @property
    def error_text(self) -> str:
        """Estimated error of the time steps, with advice if large; without a full stop."""
        error = self.error_estimate
        if error is None:
            return "too few steps to estimate their error" if self.steps else ""
        said = f"the time steps cause a tip error of {in_mm(error)} at most"
        if error > _COARSE * self.robot.length:
            share = in_percent(error / self.robot.length)
            smaller = "dt" if self.settings.get("dt_s") is not None else "tolerance"
            said += f", {share} of the length: give a smaller {smaller}"
        return said

    def to_dataset(self) -> xr.Dataset:
        """Return all fields with units and frames (`bowstring.statics.fields`).

        Raises
        ------
        InputError
            If the run recorded no fields, or its file was removed or replaced.
        """
        from bowstring.dynamics.run_file import read_run

        if self.path is not None:
            data = read_run(self.path)
            tip = np.zeros((0, 3))
            if "disk_position" in data:
                tip = data["disk_position"].to_numpy()[:, -1]
            if not np.array_equal(tip, self.tip_position):
                raise InputError(
                    f"the file {self.path} holds another run by now; give each run one of its own"
                )
            return data
        if self.frames is None:
            raise InputError("the run kept no fields: simulate with points of 2 or more")
        return to_dataset(
            self.robot, self.frames, self.settings, status=self.status, reason=self.reason
        )

    def tip_at(self, times: ArrayLike) -> Floats:
        """Interpolate the tip position (K, 3) at times (K,), from positions and velocities.

        Raises
        ------
        InputError
            If a time lies outside the run.
        """
        try:
            t = np.atleast_1d(validation.floats(times))
        except TypeError:
            raise InputError(
                f"times is {validation.shown(times)}, they must be numbers in s"
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
            The message has the time reached and the reason.
        """
        if not self.converged:
            raise NoSolutionError(f"{self.robot.name}: {self.message}", status=self.status)
        return self


@dataclass(frozen=True, eq=False)
class Start:
    """Initial state of a motion: rest in the equilibrium of a load.

    Parameters
    ----------
    load : Load, optional
        Initial load; values that it leaves out are those at time 0, before a jump there. A
        different load at time 0 releases the robot. Gravity is that of the motion. Its point loads
        act on the points of those of the motion, in the same order; one that only acts before
        time 0 has a force of zero in the motion.
    disk_forces : array_like (N, 3), optional
        Further dead forces on the disks in N, which are released at time 0.
    history : mapping, optional
        State of a path of `bowstring.solve` or `bowstring.sweep` (their ``history()``), from which
        friction continues. By default the path begins in the home pose.
    """

    load: Load | None = None
    disk_forces: ArrayLike | None = None
    history: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Output:
    """Output of a simulation.

    Parameters
    ----------
    every : float
        Time between two outputs in s; the integrator's ``dt`` if that is longer.
    points : int
        Stations per module at which fields are recorded; 0 records the tip's motion only.
    path : path, optional
        NetCDF file to which all fields are written during the run; it is valid at every moment.
        The fields are then not kept in memory.
    progress : callable, optional
        Progress callback, called with the finished share from 0 to 1.

    Raises
    ------
    InputError
        If a value is wrong.
    """

    every: float = DEFAULT_INTERVAL
    points: int = DEFAULT_POINTS
    path: str | Path | None = None
    progress: Callable[[float], None] | None = None

    def __post_init__(self) -> None:
        _check_time("every", validation.number("every", self.every, "s"))
        points, path = self.points, self.path
        if not validation.is_whole(points) or not (points == 0 or 2 <= points <= 1000):
            raise InputError(
                f"points is {validation.shown(points)}, it must be a whole number from 2 to 1000, "
                "or 0"
            )
        if points == 0 and path is not None:
            raise InputError("points is 0, a file needs fields: give 2 or more")
        if path is not None and not isinstance(path, str | os.PathLike):
            raise InputError(f"path is {validation.shown(path)}, it must be the path of a file")
        if self.progress is not None and not callable(self.progress):
            raise InputError(
                f"progress is {validation.shown(self.progress)}, it must be a function"
            )


def simulate(
    robot: Robot,
    tensions: OverTime | None = None,
    duration: float | None = None,
    *,
    load: Load | None = None,
    start: Start | None = None,
    model: RodModel | None = None,
    integrator: Integrator | None = None,
    output: Output | None = None,
) -> Run:
    """Simulate the motion from rest in an equilibrium.

    The time integration is implicit and of second order (theory Eq. 5.1 and 5.2). Each
    output time is the end of a step.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : Table, callable or array_like (T,)
        Tension of each tendon over time in N: a table (`ramp`, `step`, `Table`), a function of
        time that is called once before each step with the time of its end, or constant. Short for
        ``load=Load(tensions)``.
    duration : float
        Duration of the motion in s.
    load : Load, optional
        All loads; each value except gravity may be a table or a function of time. The kind of
        actuation of a tendon does not change; in a table of another kind it has a column of NaN.
        A displacement may jump only if the tendon is elastic or its transmission compliant
        (``axial_stiffness``, ``compliance``).
    start : Start, optional
        Initial load, forces on disks, or history.
    model : RodModel, optional
        Model of the rod, by default with one element per module.
    integrator : Integrator, optional
        Step or tolerance, and damping.
    output : Output, optional
        Output times, stations, file and progress callback.

    Returns
    -------
    Run
        Run, also one that stopped early: check `Run.status`, or call `Run.raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong, the drive is full, or a function of time fails; output written
        before stays.
    NoStart
        If there is no initial equilibrium; a `NoSolutionError`.
    RunInterrupted
        On Ctrl-C.

    Warns
    -----
    StabilityWarning
        If the motion starts from an equilibrium that `bowstring.solve` does not call stable, with
        flutter or buckling where statics tell them apart. Not with friction, where stability is
        never known.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> run = bs.simulate(robot, bs.dynamics.ramp([80, 0, 0], rise=0.5), 1.0)
    >>> run.converged
    True
    """
    check_robot(robot)
    check_without_laws(robot, ", which dynamics does not model", but=("friction", *OF_COMMANDS))
    if duration is None:
        raise InputError("simulate needs a duration, in s")
    duration = _check_time("duration", validation.number("duration", duration, "s", zero=True))
    load, model = as_load(tensions, load), as_model(model)
    elements = model.elements or least_elements(robot, load)
    model = model.replace(elements=elements)
    start = validation.instance("start", start, Start)
    integrator = validation.instance("integrator", integrator, Integrator)
    output = validation.instance("output", output, Output)
    every = max(float(output.every), integrator.dt or 0.0)
    points = int(output.points)  # a NumPy integer cannot be written to the file
    given, history = validation.instance("start.load", start.load, Load), start.history
    if given.base is not None:
        raise InputError("start.load has a motion of the base; a run starts at rest on its base")
    if given.gravity is not None:
        raise InputError("start.load has gravity, which is that of load from the start on")
    world = robot.gravity
    if load.gravity is not None:
        world = validation.row("gravity", load.gravity, 3, "m/s^2").tolist()
    disks = robot.core.disk_count
    loads = Loads(
        Actuation(robot, load, duration),
        over_time("tip_force", _or_zero(load.tip_force), 3, "N"),
        over_time("tip_moment", _or_zero(load.tip_moment), 3, "N m"),
        on_disks("disk_forces", load.disk_forces, disks),
        on_disks("disk_moments", load.disk_moments, disks),
        on_points(load.point_loads, disks),
        on_disks("line_forces", load.line_forces, disks),
        of_base(load.base, world, duration),
    )
    gravity = world if load.base is None else load.base.gravity([0.0], world)[0].tolist()
    actuated = loads.actuation
    before = loads.at(0.0, before=True)
    initial = InstantLoad(
        _initial(robot, actuated, before.actuation, given),
        _tip_load("tip_force", start.load, before.tip_force),
        _tip_load("tip_moment", start.load, before.tip_moment),
        _disk_load("disk_forces", start.load, before.disk_forces, disks),
        _disk_load("disk_moments", start.load, before.disk_moments, disks),
        _point_loads(start.load, before.point_loads, disks),
        _disk_load("line_forces", start.load, before.line_forces, disks),
        np.zeros(0),
    )
    holding = None
    if start.disk_forces is not None:
        holding = validation.floats_or_refuse(
            start.disk_forces, "disk_forces must be numbers, one row a disk, in N"
        )
        if holding.shape != (len(robot.disks.station_m), 3) or not np.isfinite(holding).all():
            raise InputError(
                f"disk_forces must be finite, of shape ({len(robot.disks.station_m)}, 3) "
                f"in N; got shape {holding.shape}"
            )
    _check_jumps(robot, actuated, initial.actuation, duration)
    dt = integrator.dt
    scheme = integrator.scheme(robot.length, longest_step=min(every, DEFAULT_INTERVAL))
    settings: dict[str, Any] = {
        "theory": model.theory,
        "gravity_m_per_s2": [float(g) for g in world],
        "tendon": model.tendon_path,
        "twist": model.twist,
        "elements": model.elements,
        "duration_s": duration,
        "mass_damping_per_s": scheme.mass_damping,
        "material_damping_s": scheme.material_damping,
        "spectral_radius": scheme.spectral_radius,
        "dt_s": dt,
        "tolerance_m": None if dt is not None else scheme.tolerance,
        "every_s": every,
        **loads.to_dict(),
        **_by_kind(actuated.by_displacement, initial.actuation),
        "initial_tip_force_N": initial.tip_force.tolist(),
        "initial_tip_moment_Nm": initial.tip_moment.tolist(),
        "initial_disk_forces_N": None if holding is None else holding.tolist(),
        "initial_load_disk_forces_N": initial.disk_forces.tolist() or None,
        "initial_load_disk_moments_Nm": initial.disk_moments.tolist() or None,
        "initial_load_point_loads": [
            PointLoad.of_numbers(row).to_dict() for row in table_of(initial.point_loads).tolist()
        ]
        or None,
        "initial_load_line_forces_N_per_m": initial.line_forces.tolist() or None,
        "modal_damping": integrator.modal_damping,
        "history": None,
        "initial_stable": None,
    }
    run = Run(robot, settings)
    if integrator.modal_damping is not None:
        try:
            scheme = _with_modal_damping(
                scheme, integrator.modal_damping, robot, actuated, initial, model, gravity
            )
        except NoSolutionError as error:
            settings["mass_damping_per_s"] = settings["material_damping_s"] = None
            raise NoStart(str(error), run) from None
        settings["mass_damping_per_s"] = scheme.mass_damping
        settings["material_damping_s"] = scheme.material_damping
    simulator = make(robot, model, gravity, points, scheme)
    path = None
    if actuated.by_displacement.any() or robot.has_friction or history is not None:
        path = actuation.Path(robot, model, history)
        settings["history"] = None if history is None else dict(history)
    settings["initial_stable"], doubt = judged_start(
        robot, initial, _held(initial, holding, gravity), model, on_path=path is not None
    )
    times = _output_times(duration, every)
    places = stations(robot, points)
    _check_size(robot, points, len(times), kept=output.path is None)
    planned = None
    if output.path is not None:
        from bowstring.dynamics.run_file import RunFile

        planned = RunFile.open(output.path, robot, settings, *places, times=len(times))
        # a stiffness matrix gives strain, but no stress
        sections = Section(robot, *places, model, partly=robot.has_matrix)
        append = completing(robot, sections, places[0], planned.append)
        simulator.write_to(sections.columns, places[0], planned.room, append)
    file: RunFile | None = None
    aside = 0.0  # s of output to files
    begun = clock.perf_counter()

    @interrupts.ignored()
    def finish(status: Status, reason: str = "") -> None:
        run.wall_s = clock.perf_counter() - begun - aside - simulator.output_s
        run.status, run.reason = status, reason
        run.steps, run.iterations = simulator.steps, simulator.iterations
        run.repeated = simulator.repeated
        time, position, velocity = simulator.tip()
        if file is not None:
            file.finish(status, reason)
            written = time <= file.complete_to  # an interrupt may have prevented the last chunk
            time, position, velocity = time[written], position[written], velocity[written]
        elif points and len(time) and run.frames is None:
            run.frames = frames(simulator, places)
        run.time, run.tip_position, run.tip_velocity = time, position, velocity
        run.error_estimate = _estimate(simulator.error, position, loads.misfit)
        run.exceeded = tuple(limits.buckled_or_stretched(robot, _tensions_of(run, actuated), model))

    try:
        status = "converged"
        if path is None:
            status = simulator.rest(initial)
        else:
            dead = initial.dead.replace(gravity=gravity)
            status = path.core.step(actuated.by_displacement, initial.actuation, dead).status
            if status == "converged" and not simulator.rest_at(path.core):
                status = "unsettled"
        if status != "converged":
            raise NoStart(f"{robot.name}: {_why_no_start(status)}", run)
        if holding is not None and not simulator.hold(holding, _INCREMENTS):
            raise NoStart(
                f"{robot.name}: there is no stable equilibrium to start from under the forces on "
                "its disks",
                run,
            )
        if doubt:
            run.warnings = (f"{doubt}.",)
            warnings.warn(f"{robot.name}: {doubt}.", StabilityWarning, stacklevel=2)
        after = loads.at(0.0)
        # a former file is replaced only once the run has begun
        if planned is not None:
            file, run.path = planned, planned.path
        keep_start(simulator, initial)
        if holding is not None:
            simulator.release()
        simulator.jump(after)
        jumps = sorted(loads.jumps())
        reached = 0.0
        longest = dt if dt is not None else min(every, DEFAULT_INTERVAL)
        modules = elements * len(robot.disks.station_m)
        stop = None
        for stretches in loads.chunks(simulator, times.copy(), longest, modules):
            stop = simulator.run(*stretches)
            if stop is not None:
                break
            reached += float(stretches[0].sum())
            for jump in jumps:
                if abs(jump - reached) <= 1e-9 * (1 + reached) and jump < duration:
                    simulator.jump(loads.at(jump))
            if output.progress is not None and duration > 0:
                asked = clock.perf_counter()
                try:
                    output.progress(min(simulator.time / duration, 1.0))
                finally:
                    aside += clock.perf_counter() - asked
        if stop is None:
            finish("converged")
        else:
            failed = stop == "step_failed" and actuated.by_displacement.any()
            advice = _CONFLICT if failed else ""
            finish(stop, _WHY[stop] + advice)
    except KeyboardInterrupt:
        ended = False
        while not ended:
            try:
                finish("interrupted", "stopped by the user")
                ended = True
            except KeyboardInterrupt:  # a second interrupt that was pending with the first
                continue
        interrupts.acknowledge()
        raise RunInterrupted(run) from None
    except BaseException as error:
        finish("failed", str(error) or type(error).__name__)
        raise
    return run


_WHY: Final[dict[str, str]] = {
    "step_failed": "even the shortest step did not converge; change the load more slowly, damp the "
    "motion (a little), or give a larger tolerance",
    "collision": "two neighbouring disks met: the load closes the gap between them",
}
_CONFLICT: Final = (
    "; run bowstring solve with the displacements of that time to see whether they conflict"
)


def _tensions_of(run: Run, actuated: Actuation) -> Floats:
    """Tensions (K, T) of a run in N, as far as they are known without its file."""
    if run.frames is not None:
        return run.frames.tension
    if actuated.is_sampled or actuated.by_displacement.any():
        return np.zeros((0, len(actuated.by_displacement)))
    # between its knots a table is linear
    times = np.array([0.0, *(t for t in actuated.knots() if 0 < t < run.end), run.end])
    return np.vstack([actuated.rows(times, before=True), actuated.rows(times)])


def _estimate(error: float | None, tip: Floats, misfit: float) -> float | None:
    """Estimated error of the tip, m, from that of the steps and the misfit of the base's motion.

    Both are limited by the diagonal of the box in which the tip moved.
    """
    if error is None or len(tip) == 0:
        return None
    moved = float(np.linalg.norm(np.ptp(tip, axis=0)))
    return min(error + _MARGIN * misfit * moved, moved)


def _why_no_start(status: str) -> str:
    if status == "unsettled":
        return (
            "statics find an equilibrium at the start, but the robot in motion, whose mass sits in "
            "points, finds no rest near it; give another number of elements (1, 2, 4 or 8)"
        )
    return (
        f"there is no equilibrium to start from ({status}); run bowstring solve with the loads at "
        "the start for the reason"
    )


def _held(initial: InstantLoad, holding: Floats | None, gravity: Sequence[float]) -> Load:
    """Load at the start without its actuation, with the forces that hold the disks."""
    load = initial.dead.replace(gravity=gravity)
    if holding is None:
        return load
    own = 0.0 if load.disk_forces is None else load.disk_forces
    return load.replace(disk_forces=own + holding)


def _or_zero(value: OverTime | None) -> OverTime:
    return (0.0, 0.0, 0.0) if value is None else value


def _check_time(name: str, value: float) -> float:
    if 0 < value < _SHORTEST:
        raise InputError(
            f"{name} is {value:g} s, it must be {_SHORTEST:g} s or more: shorter steps are below "
            "numerical resolution"
        )
    return value


def _tip_load(name: str, given: Load | None, otherwise: Floats) -> Floats:
    unit = "N m" if "moment" in name else "N"
    value = None if given is None else getattr(given, name)
    if value is None:
        return otherwise
    return validation.row(f"start.load.{name}", value, len(otherwise), unit)


def _disk_load(name: str, given: Load | None, otherwise: Floats, disks: int) -> Floats:
    value = None if given is None else getattr(given, name)
    return otherwise if value is None else disk_row(name, value, disks)


def _point_loads(given: Load | None, otherwise: Floats, disks: int) -> Floats:
    """Numbers of the point loads at the start: on the points of the load, with other values."""
    if given is None or given.point_loads is None:
        return otherwise
    loads = tuple(load.on(disks) for load in point_loads(given.point_loads))
    numbers = with_arrays(given.replace(point_loads=loads)).point_loads
    own = table_of(otherwise)
    if numbers is None:
        return without_wrenches(own).ravel()
    if not same_points(numbers, own):
        raise InputError(
            "the point loads of the start must act on the same disks and points as those of the "
            "load, in the same order; give one that does not act a force of zero"
        )
    return np.asarray(numbers).ravel()


def _initial(robot: Robot, actuated: Actuation, otherwise: Floats, given: Load) -> Floats:
    """Initial actuation of the tendons (T,)."""
    if given.is_tension_controlled:
        if given.tensions is None:
            return otherwise
        if not actuated.by_displacement.any():
            least = robot.tendons.least_tension_N
            count = len(otherwise)
            return validation.row("start.load.tensions", given.tensions, count, "N", least=least)
    by_displacement, values = actuation.commands(robot, given)
    if np.isnan(values).any():
        raise InputError(
            f"tendon {int(np.argmax(np.isnan(values))) + 1} has no start; give its tension, "
            "displacement or angle in the load of the start"
        )
    differs = by_displacement != actuated.by_displacement
    if differs.any():
        i = int(np.argmax(differs))
        kinds = ("a tension", "a displacement")
        raise InputError(
            f"tendon {i + 1} starts with {kinds[int(by_displacement[i])]} but moves by "
            f"{kinds[int(actuated.by_displacement[i])]}; give it the same in both"
        )
    return values


def _by_kind(by_displacement: Bools, row: Floats) -> dict[str, list[float | None]]:
    """Initial actuation by kind for a file; None where a tendon has the other kind."""
    kinds = {"initial_tensions_N": ~by_displacement, "initial_displacements_m": by_displacement}
    return {
        name: [v if own else None for v, own in zip(row.tolist(), mine.tolist(), strict=True)]
        for name, mine in kinds.items()
        if mine.any()
    }


def _check_jumps(robot: Robot, actuated: Actuation, initial: Floats, duration: float) -> None:
    """Refuse a jump of displacement of an inextensible tendon with a rigid transmission."""
    stiff = actuated.by_displacement & (actuation.compliances(robot) == 0)
    if not stiff.any():
        return
    jumps = sorted(time for time in actuated.jumps() if 0 < time < duration)
    for time in (0.0, *jumps):
        old = actuated.at(time, before=True) if time else initial
        new = actuated.at(time)
        for i in np.flatnonzero(stiff & (abs(new - old) > _STILL * robot.length))[:1].tolist():
            raise InputError(
                f"the displacement of tendon {i + 1} jumps from {old[i]:g} m to {new[i]:g} m at "
                f"{time:g} s, but the tendon is inextensible; give a rise time (--rise), or "
                "give the tendon an axial_stiffness or a compliance"
            )


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


def _check_size(robot: Robot, points: int, times: int, *, kept: bool) -> None:
    """Refuse fields that do not fit into memory: all times if `kept`, else a single one."""
    if points == 0:
        return
    disks, tendons = len(robot.disks.station_m), len(robot.tendons.end_disk)
    numbers = 34.0 * disks * points + 18.0 * disks + 2.0 * disks * tendons
    if kept:
        cure = "name a file for them (out), or give a longer every or fewer points"
        # a growing array takes twice its size
        check_memory(16.0 * times * numbers, f"fields at {times} times", cure)
    else:
        check_memory(48.0 * numbers, "fields at one time", "give fewer points")


def _with_modal_damping(
    scheme: Scheme,
    ratio: float,
    robot: Robot,
    actuated: Actuation,
    initial: InstantLoad,
    model: RodModel,
    gravity: Sequence[float],
) -> Scheme:
    """Return the scheme with mass and material damping for a modal damping ratio."""
    if not initial.has_potential:
        raise InputError(
            "modal_damping needs modes, and a moment leaves none, nor does a follower: give the "
            "others"
        )
    # sticking holes would lock spans that slip as soon as the robot moves
    by_displacement = actuated.by_displacement
    path = actuation.Path(robot, model, has_memory=False) if by_displacement.any() else None
    load = initial.dead.replace(gravity=gravity)
    found = about(robot, (by_displacement, initial.actuation), load, model, path, count=12)
    return with_ratio(scheme, ratio, found.frequency_hz)
