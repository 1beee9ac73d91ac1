"""Independent verification of the rod by 3-D finite elements: CalculiX on a mesh of bricks.

`sweep` solves statics over tensions, `ramp` a motion from rest. Results of steps are kept in the
user's cache folder under a hash of CalculiX's input: a repeated call reads them, and a stopped one
continues after its last step. All values are in SI and in the base frame.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Floats, Progress
from bowstring.errors import InputError, NoSolutionError
from bowstring.fem import ccx, deck
from bowstring.fem.fields import (
    SectionStress,
    State,
    at_nodes,
    frames,
    section_stress,
    span_tension,
    strain_in_base,
    without_times,
)
from bowstring.fem.mesh import BrickMesh, Fineness, brick_mesh, check_meshable
from bowstring.fem.steps import Job, work
from bowstring.files.atomic_io import check_place, resolved, user_cache
from bowstring.robot.model import Robot, check_robot
from bowstring.statics.load import Load, as_load

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

    from bowstring.statics.fields import Frames

#: Status of finite elements.
FeStatus = Literal["converged", "diverged", "killed", "out_of_memory", "no_space", "failed"]

_FORMAT: Final = 3  # version of the cache; a change invalidates old results
_TURN: Final = 0.12  # rad of tip rotation per static increment, by the linear law
_TIGHTEST, _LOOSEST = 1e-9, 1e-2  # range of the criterion of the Newton iteration
_SHORTEST: Final = 1e-6  # s; shorter motions are below numerical resolution
_MOST_STEPS: Final = 100_000  # steps of a motion; weeks of work
DEFAULT_DT: Final = 0.005  # s
DEFAULT_EVERY: Final = 0.05  # s


@dataclass(frozen=True)
class Settings:
    """Settings that determine the accuracy.

    Attributes
    ----------
    fineness : Fineness
    stiffness : float
        Young's modulus of disks over that of the backbone.
    grip : {"bonded", "sliding"}
        Whether disks and base also hold the backbone transversely, as glue does, or its section may
        contract freely, as rod theory assumes.
    residual : float
        Force residual over mean force at which the Newton iteration ends.
    """

    fineness: Fineness = field(default_factory=Fineness)
    stiffness: float = 1000.0
    grip: Literal["bonded", "sliding"] = "bonded"
    residual: float = 5e-4  # rounding causes 1.5e-4 with fine sliding disks

    def check(self) -> None:
        """Raise `InputError` for a value that is wrong or below numerical resolution."""
        if not isinstance(self.fineness, Fineness):
            raise InputError(
                f"fineness is {validation.shown(self.fineness)}, it must be a Fineness"
            )
        self.fineness.check()
        validation.number("stiffness", self.stiffness)
        validation.number("residual", self.residual)
        validation.choice("grip", self.grip, ("bonded", "sliding"))
        if not 10.0 <= self.stiffness <= 1e6:
            raise InputError(
                f"disks are {self.stiffness:g} times as stiff as the backbone; must be from 10 to "
                "1e6"
            )
        if not _TIGHTEST <= self.residual <= _LOOSEST:
            raise InputError(
                f"residual is {self.residual:g}, it must be from {_TIGHTEST:g} to {_LOOSEST:g}"
            )


class RunInterrupted(KeyboardInterrupt):
    """Ctrl-C; `run` contains the finished steps, and a repeated call continues after them."""

    def __init__(self, run: BrickRun) -> None:
        super().__init__(run.message)
        self.run = run

    def __reduce__(self) -> tuple[type[RunInterrupted], tuple[BrickRun]]:
        return RunInterrupted, (self.run,)  # pickled in a pool of processes


@dataclass(eq=False)
class BrickRun:
    """Result of finite elements; made by `sweep` and `ramp`.

    Attributes
    ----------
    robot : Robot
    mesh : BrickMesh
    settings : dict
        All settings of the call.
    wanted_time, wanted_tensions : ndarray (M,), (M, T)
        Like `time` and `tensions`, for all steps of the call.
    states : list of State
        Results of the finished steps.
    status : str
        ``"converged"``, or the reason for missing steps: ``"diverged"``, ``"killed"``,
        ``"out_of_memory"``, ``"no_space"``, ``"failed"``, ``"interrupted"``.
    reason : str
        Reason if it ended early, a clause.
    load_reached : float
        Converged share of the first missing step.
    cached : int
        Number of steps read from the cache.
    iterations : int
        Newton iterations of this call.
    wall_s : float
        Seconds that CalculiX took in this call.
    """

    robot: Robot
    mesh: BrickMesh
    settings: dict[str, Any]
    wanted_time: Floats
    wanted_tensions: Floats
    states: list[State] = field(default_factory=list, repr=False)
    status: str = "converged"
    reason: str = ""
    load_reached: float = 0.0
    cached: int = 0
    iterations: int = 0
    wall_s: float = 0.0

    def __repr__(self) -> str:
        return f"<BrickRun of {self.robot.name}: {self.message}>"

    @property
    def converged(self) -> bool:
        """Whether all steps converged."""
        return self.status == "converged"

    @property
    def is_motion(self) -> bool:
        """Whether the run is a motion by `ramp`, not a `sweep`."""
        return bool(self.settings["rise_s"] is not None)

    @property
    def load(self) -> Load:
        """Dead load of every step."""
        return Load(gravity=self.settings["gravity"], tip_force=self.settings["tip_force"])

    @property
    def time(self) -> Floats:
        """Times of the finished steps (K,), in s; in a sweep numbers of the loads from 0."""
        return self.wanted_time[: len(self.states)]

    @property
    def tensions(self) -> Floats:
        """Tensions at the end of the finished steps (K, T), in N."""
        return self.wanted_tensions[: len(self.states)]

    @property
    def message(self) -> str:
        """Message on the end of the run."""
        done, all_ = len(self.states), len(self.wanted_time)
        if self.converged:
            what = ("time" if self.is_motion else "load") + ("" if done == 1 else "s")
            return f"{done} {what}, {self.iterations} iterations"
        held = "done" if self.is_motion else "kept"  # a stopped motion starts again
        return f"stopped at {self._reached()}: {self.reason}; {done} of {all_} are {held}"

    def _reached(self) -> str:
        k, all_ = len(self.states), len(self.wanted_time)
        here = self.wanted_time if self.is_motion else self.wanted_tensions.max(axis=1)
        before = here[k - 1] if k else 0.0
        after = here[min(k, all_ - 1)]
        unit = "s" if self.is_motion else "N"
        return f"{before + self.load_reached * (after - before):.4g} {unit} of {here[-1]:g} {unit}"

    @cached_property
    def frames(self) -> Frames:
        """Raw output of the rod's form from bricks."""
        gravity = self.settings["gravity"]
        if self.states:
            return frames(self.robot, self.mesh, self.time, self.tensions, self.states, gravity)
        # frames without a time have the shapes of one
        rest, time, tensions = [_unloaded(self.mesh)], np.zeros(1), 0.0 * self.wanted_tensions[:1]
        return without_times(frames(self.robot, self.mesh, time, tensions, rest, gravity))

    @property
    def tip_position(self) -> Floats:
        """Position of the last disk (K, 3), in m."""
        return self.frames.disk_position[:, -1]

    @property
    def span_tensions(self) -> Floats:
        """Tensions (K, N, T) of the spans, from the forces at their ends; NaN without a span."""
        shape = (-1, len(self.mesh.hole) - 1, self.mesh.hole.shape[1])
        found = [span_tension(self.mesh, state) for state in self.states]
        return np.array(found).reshape(shape)

    @property
    def span_error(self) -> float:
        """Largest relative deviation of a span's force from its tendon's tension."""
        tensions = np.broadcast_to(self.tensions[:, None, :], self.span_tensions.shape)
        here = (tensions > 0) & np.isfinite(self.span_tensions)
        return float(np.max(np.abs(self.span_tensions[here] / tensions[here] - 1.0), initial=0.0))

    def section_stress(self, step: int = -1) -> SectionStress:
        """Largest normal stress of the sections between bricks at a step."""
        return section_stress(self.mesh, self.states[step])

    def nodal(self, step: int) -> tuple[Floats, Floats, Floats]:
        """Displacement (n, 3), stress and strain (n, 6) at the nodes of the mesh at a step.

        In base axes; stress is Cauchy's, strain Green's, rotated with the material.
        """
        state = self.states[step]
        return (
            state.displacement,
            at_nodes(self.mesh, state.stress),
            at_nodes(self.mesh, strain_in_base(self.mesh, state)),
        )

    def to_dataset(self) -> xr.Dataset:
        """Return fields of the rod's form from bricks, in the layout of `bowstring.statics.fields`.

        Stations are planes of integration points. The attribute ``data_origin`` names finite
        elements. In a sweep ``time`` is the number of the load.
        """
        return self._dataset

    @cached_property
    def _dataset(self) -> xr.Dataset:
        from bowstring.statics.fields import to_dataset

        found = to_dataset(
            self.robot, self.frames, self.settings, status=self.status, reason=self.reason
        )
        found.attrs["data_origin"] = "simulated by finite elements"
        found.attrs["title"] = f"Finite elements (CalculiX) of {self.robot.name}"
        if not self.is_motion:
            found["time"].attrs = {"units": "1", "long_name": "number of the load, at rest"}
            del found.attrs["complete_to_s"]  # a sweep has no time in s
        return found

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise `NoSolutionError` with the load reached."""
        if not self.converged:
            raise NoSolutionError(f"{self.robot.name}: {self.message}", status=self.status)
        return self


def check(robot: Robot) -> None:
    """Check before any work that finite elements of a robot are possible.

    Raises
    ------
    InputError
        If the robot cannot be meshed, or CalculiX is not installed.
    """
    check_robot(robot)
    check_meshable(robot)
    ccx.version(ccx.find())


def check_keep(folder: str | Path) -> Path:
    """Check the folder for the files of CalculiX, which must be new or empty.

    Other files in it could be mistaken for output of CalculiX.

    Raises
    ------
    InputError
    """
    why = f"cannot write the files of CalculiX to {folder}"
    folder = resolved(folder, why)
    check_place(folder, why)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError(f"{folder} is there and not an empty folder; name a new one")
    return folder


def sweep(
    robot: Robot,
    tensions: ArrayLike | None = None,
    *,
    load: Load | None = None,
    settings: Settings | None = None,
    keep: str | Path | None = None,
    progress: Progress | None = None,
) -> BrickRun:
    """Solve statics by finite elements, one load after the other.

    Parameters
    ----------
    robot : Robot
        Robot whose disks have a clamped length and whose tendons have no friction.
    tensions : array_like (K, T)
        Tensions in N in the order of loading, short for ``load=Load(tensions)``.
    load : Load, optional
        Tensions, gravity and tip force (3,); no other actuation and no moment, no load on disks.
    settings : Settings, optional
        Fineness of the mesh and solver settings.
    keep : str or Path, optional
        New or empty folder for the files of CalculiX; by default they are removed.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    BrickRun
        Run, also one that stopped early: check its status, or call `raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong, the robot cannot be meshed, CalculiX is not installed, or `keep` is
        not empty.
    RunInterrupted
        On Ctrl-C.
    """
    load = as_load(tensions, load)
    rows = _tension_rows(robot, load.tensions)
    turn = _turn(robot, np.diff(rows, axis=0, prepend=0.0 * rows[:1]))
    first = np.minimum(1.0, _TURN / np.maximum(turn, 1e-9)).tolist()
    steps = [
        deck.Step(tuple(row), first=share, longest=min(1.0, 2.0 * share))
        for row, share in zip(rows.tolist(), first, strict=True)
    ]
    asked = {"rise_s": None, "dt_s": None}
    time = np.arange(len(rows), dtype=float)
    return _run(robot, steps, time, asked, load, settings, keep, progress)


@dataclass(frozen=True)
class Motion:
    """Motion by finite elements: tensions rise linearly from zero and are then held.

    Parameters
    ----------
    rise, hold : float
        Durations of rise and hold in s.
    dt : float
        Longest time step in s.
    every : float
        Longest time between two outputs in s; rise and hold are divided into whole numbers of it.
    mass_damping : float
        Mass-proportional damping in 1/s, as in `bowstring.Integrator`.

    Raises
    ------
    InputError
        If a value is out of range, or the motion has too many steps.
    """

    rise: float
    hold: float = 0.0
    dt: float = DEFAULT_DT
    every: float = DEFAULT_EVERY
    mass_damping: float = 0.0

    def __post_init__(self) -> None:
        for name, unit, zero in (
            ("rise", "s", False),
            ("hold", "s", True),
            ("dt", "s", False),
            ("every", "s", False),
            ("mass_damping", "1/s", True),
        ):
            value = validation.number(name, getattr(self, name), unit, zero=zero)
            object.__setattr__(self, name, value)
        if self.rise < _SHORTEST:
            raise InputError.of("rise", f"{self.rise:g} s", f"{_SHORTEST:g} s or more")
        shortest, what = min((self.dt, "dt"), (self.every, "every"))
        if self.rise + self.hold > _MOST_STEPS * shortest:
            raise InputError(
                f"rise and hold are {self.rise + self.hold:g} s, which is more than {_MOST_STEPS} "
                f"times {what} ({shortest:g} s); choose a shorter motion"
            )


def ramp(
    robot: Robot,
    tensions: ArrayLike | None,
    motion: Motion,
    *,
    load: Load | None = None,
    settings: Settings | None = None,
    keep: str | Path | None = None,
    progress: Progress | None = None,
) -> BrickRun:
    """Simulate a motion by finite elements: tensions rise linearly from zero and are then held.

    The time integration (HHT, alpha = -0.05) has little numerical damping.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : array_like (T,)
        Tensions after the rise in N, short for ``load=Load(tensions)``.
    motion : Motion
        Rise, hold and output times.
    load : Load, optional
        Tensions and gravity. With gravity the motion starts from rest in equilibrium.
    settings : Settings, optional
        As for `sweep`.
    keep : str or Path, optional
        As for `sweep`.
    progress : callable, optional
        As for `sweep`.

    Returns
    -------
    BrickRun
        Run whose times begin with the first output after 0.
    """
    load = as_load(tensions, load)
    if not isinstance(motion, Motion):
        raise InputError.of("motion", validation.shown(motion), "a bowstring.fem.Motion")
    if load.tip_force is not None:
        raise InputError("a motion by finite elements takes tensions and gravity only")
    check_robot(robot)
    if robot.payloads:
        raise InputError(
            f"a motion by finite elements takes no payloads; leave out those of {robot.name}"
        )
    last = _tension_rows(robot, load.tensions, one=True)[0]
    lengths, shares = [], []
    for length, ends in ((motion.rise, (0.0, 1.0)), (motion.hold, (1.0, 1.0))):
        count = math.ceil(length / motion.every - 1e-9)
        lengths += [length / count] * count if count else []
        shares += np.linspace(*ends, count + 1)[1:].tolist()
    dt = motion.dt
    steps = [
        deck.Step(tuple(row), length, min(1.0, dt / length), min(1.0, dt / length))
        for row, length in zip(np.outer(shares, last).tolist(), lengths, strict=True)
    ]
    asked = {
        "rise_s": motion.rise,
        "hold_s": motion.hold,
        "dt_s": motion.dt,
        "every_s": motion.every,
        "mass_damping_per_s": motion.mass_damping,
    }
    time = np.cumsum(np.array(lengths, dtype=np.float64))
    return _run(robot, steps, time, asked, load, settings, keep, progress)


def _tension_rows(robot: Robot, tensions: ArrayLike, *, one: bool = False) -> Floats:
    """Check tensions (K, T), or a single row (1, T)."""
    check_robot(robot)
    count = len(robot.tendons.end_disk)
    given = validation.read("tensions", tensions, "numbers in N")
    rows = given[None] if one else np.atleast_2d(given)
    if rows.ndim != 2 or rows.shape[1] != count or len(rows) == 0:
        shape = f"({count},)" if one else f"(K, {count})"
        raise InputError(f"tensions has shape {given.shape}, it must be {shape}, in N")
    for i, row in enumerate(rows, 1):
        validation.check_values("tensions", row, "" if one else f" at load {i}")
    return rows


def _turn(robot: Robot, change: Floats) -> Floats:
    """Bound of the tip rotation by a change (K, T) of tensions (theory Eq. 1.7), rad."""
    lengths = np.array([s.length for s in robot.segments]) / robot.bending_stiffness
    inner = np.cumsum(lengths)[robot.tendons.segment]
    found: Floats = np.abs(change) @ (robot.tendons.arm_m * inner)
    return found


# -- one run -----------------------------------------------------------------------------------


def _run(
    robot: Robot,
    steps: list[deck.Step],
    time: Floats,
    asked: dict[str, Any],
    load: Load,
    settings: Settings | None,
    keep: str | Path | None,
    progress: Progress | None,
) -> BrickRun:
    settings = Settings() if settings is None else settings
    if not isinstance(settings, Settings):
        raise InputError(f"settings is {validation.shown(settings)}, it must be Settings")
    settings.check()
    if load.given - {"tensions", "gravity", "tip_force"}:
        raise InputError("finite elements take tensions, gravity and a tip force only")
    keep = None if keep is None else check_keep(keep)
    notify = progress or (lambda what, share: None)
    gravity = robot.gravity if load.gravity is None else load.gravity
    weight = validation.row("gravity", gravity, 3, "m/s^2")
    tip_force = np.zeros(3) if load.tip_force is None else load.tip_force
    force = validation.row("tip_force", tip_force, 3, "N")
    loading = deck.Loading(
        tuple(weight.tolist()),
        tuple(force.tolist()),
        settings.stiffness,
        settings.grip == "bonded",
        settings.residual,
        asked.get("mass_damping_per_s", 0.0),
    )
    motion = asked["rise_s"] is not None
    mesh = brick_mesh(robot, settings.fineness, mass_arms=motion or bool(robot.payloads))
    program = ccx.find()
    version = ccx.version(program)
    dead = bool(weight.any() or force.any())
    given = {
        "mesh": str(settings.fineness),
        "stiffness": settings.stiffness,
        "grip": settings.grip,
        "residual": settings.residual,
        "gravity": weight.tolist(),
        "tip_force": force.tolist(),
        "tensions_N": [list(step.tensions) for step in steps],
        "calculix_version": version,
        **asked,
    }
    tensions = np.array([step.tensions for step in steps])
    found = BrickRun(robot, mesh, given, time, tensions)
    # without load no solver is needed
    idle = 0
    while not dead and not motion and idle < len(steps) and not any(steps[idle].tensions):
        idle += 1
    found.states = [_unloaded(mesh) for _ in range(idle)]
    todo = steps[idle:]
    if motion and dead:  # a static step under gravity before the motion
        todo = [deck.Step((0.0,) * tensions.shape[1], first=0.1), *todo]
    lead = len(todo) + idle - len(steps)
    if not todo:
        return found
    job = Job(robot, mesh, loading, tuple(todo))
    ended = work(job, program, cache_folder() / _key(job, version), keep, notify)
    found.states += ended.states[lead:]
    found.cached = max(0, ended.cached - lead)
    found.status, found.reason = ended.status, ended.why
    found.load_reached, found.iterations = ended.share, ended.iterations
    found.wall_s = ended.wall_s
    if found.status == "interrupted":
        raise RunInterrupted(found)
    return found


def _unloaded(mesh: BrickMesh) -> State:
    free = int((~mesh.stiff).sum())
    nothing = np.zeros((free, 8, 6))
    spans = len(deck.spans(mesh).first)
    return State(np.zeros_like(mesh.nodes), None, nothing, nothing, np.zeros((spans, 3)))


def cache_folder() -> Path:
    """Return the cache folder of the results; it may be removed at any time.

    Returns
    -------
    Path
        Path, which need not exist.
    """
    return user_cache() / "finite-elements"


def _key(job: Job, version: str) -> str:
    """Hash of all that determines the numbers: input and version of CalculiX."""
    return hashlib.sha256(f"{_FORMAT}\n{version}\n{job.input()}".encode()).hexdigest()[:32]
