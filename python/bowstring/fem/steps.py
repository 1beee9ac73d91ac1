"""Steps of CalculiX, each cached when finished; a stopped run continues after the last one.

A folder of the cache contains ``step_0001.npz`` and so on and, until all exist, CalculiX's restart
file after the last. All files of a run are in a temporary folder, which is removed at its end.
"""

from __future__ import annotations

import contextlib
import errno
import shutil
import tempfile
import time
import zipfile
import zlib
from bisect import bisect_left
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from bowstring import interrupts
from bowstring.aliases import Floats, Progress
from bowstring.errors import InputError
from bowstring.fem import ccx, deck, output
from bowstring.fem.fields import State
from bowstring.fem.mesh import BrickMesh
from bowstring.files.atomic_io import check_place, folder_beside, write_whole_file
from bowstring.robot.model import Robot

_JOB: Final = "robot"
_PA: Final = 1e6  # Pa per MPa


class Job(NamedTuple):
    """Calculation to be done."""

    robot: Robot
    mesh: BrickMesh
    loading: deck.Loading
    steps: tuple[deck.Step, ...]

    def input(self, done: int = 0) -> str:
        """Input of CalculiX for all steps, or those after `done` finished ones."""
        todo = self.steps[done:]
        head = deck.resume(done) if done else deck.model(self.robot, self.mesh, self.loading, todo)
        return head + deck.steps(self.robot, self.mesh, self.loading, todo)


@dataclass
class Ended:
    """Result of a calculation; `share` is the converged share of the first missing step."""

    states: list[State] = field(default_factory=list)
    """States at the ends of the finished steps, from the first."""
    cached: int = 0
    """Number of steps read from the cache."""
    status: str = "converged"
    """"converged", or the reason for missing steps, as in `bowstring.fem.BrickRun`."""
    why: str = ""
    """Reason if it ended early, a clause; else empty."""
    share: float = 0.0
    iterations: int = 0
    """Newton iterations of this call."""
    wall_s: float = 0.0
    """Seconds that CalculiX took in this call; 0 if all steps were cached."""


def work(job: Job, program: Path, kept: Path, keep: Path | None, notify: Progress) -> Ended:
    """Calculate the steps that are not cached yet.

    Parameters
    ----------
    job : Job
    program : Path
    kept : Path
        Cache folder of this job.
    keep : Path, optional
        Folder for the files of CalculiX; with it all steps are calculated.
    notify : callable
        Progress callback.

    Returns
    -------
    Ended
        Result, with status ``"interrupted"`` after Ctrl-C.
    """
    ended = Ended(states=_load(kept, job))
    if len(ended.states) < len(job.steps):
        del ended.states[_restart_at(kept, len(ended.states)) :]
    if keep is not None:
        ended.states.clear()
    ended.cached = len(ended.states)
    if ended.cached == len(job.steps):
        _drop_restarts(kept)
        return ended
    try:
        check_place(kept, f"cannot write the kept results to {kept}")
    except InputError as error:
        raise InputError(f"{error}; name another place by XDG_CACHE_HOME") from None
    started = time.perf_counter()
    try:
        with _folder(keep) as folder:
            run = _Run(job, folder, kept, ended, notify)
            end = run.go(program, fleeting=keep is None)
        if ended.cached and end.status == "failed" and not ended.iterations:
            # a restart file that is damaged, or was removed by another process, would make every
            # further run fail
            _restart(kept, ended.cached).unlink(missing_ok=True)
            return work(job, program, kept, keep, notify)
        ended.status, ended.why = end
    except KeyboardInterrupt:
        interrupts.acknowledge()
        ended.status, ended.why = "interrupted", "it was interrupted"
    except OSError as error:
        full = error.errno in (errno.ENOSPC, errno.EDQUOT)
        ended.status = "no_space" if full else "failed"
        ended.why = f"files cannot be written: {error.strerror}"
    ended.wall_s = time.perf_counter() - started
    if len(ended.states) == len(job.steps):
        ended.status, ended.why, ended.share = "converged", "", 0.0
        _drop_restarts(kept)
    elif ended.status == "converged":
        ended.status, ended.why = "failed", "CalculiX ended early and printed too little"
    return ended


def _folder(keep: Path | None) -> contextlib.AbstractContextManager[Path]:
    if keep is None:
        return folder_beside(Path(tempfile.gettempdir(), "bowstring-fe"))
    keep.mkdir(parents=True, exist_ok=True)
    return contextlib.nullcontext(keep)


class _Run:
    """Run of CalculiX for the steps after `ended.cached`."""

    def __init__(self, job: Job, folder: Path, kept: Path, ended: Ended, notify: Progress) -> None:
        self.job, self.folder, self.kept, self.ended, self.notify = job, folder, kept, ended, notify
        self.first = ended.cached
        self.read = 0  # bytes of tables that are cached
        self.begun = 0  # present step of CalculiX; restart files of earlier ones are whole
        self.free = np.flatnonzero(~job.mesh.stiff)
        # total time of CalculiX
        self.ends = np.cumsum([step.span for step in job.steps]).tolist()

    def go(self, program: Path, *, fleeting: bool) -> ccx.End:
        if self.first:
            try:
                shutil.copyfile(_restart(self.kept, self.first), self.folder / f"{_JOB}.rin")
            except FileNotFoundError:
                return ccx.End("failed", "the file to go on from is gone")
        (self.folder / f"{_JOB}.inp").write_text(self.job.input(self.first), "ascii")
        self.look()
        try:
            return ccx.run(program, self.folder, _JOB, self.look, fleeting=fleeting)
        finally:
            with contextlib.suppress(OSError):  # report the original error
                self.look()
                self._take()
                self.look()

    def look(self) -> None:
        """Report progress and cache finished steps."""
        done = output.read_increments(self.folder / f"{_JOB}.sta")
        self.ended.iterations = sum(i.iterations for i in done)
        step, share = self._place(done[-1].total_time) if done else (self.first, 0.0)
        self.begun = step
        if step > len(self.ended.states):  # the tables of the previous step are whole
            self._take()
        steps = self.job.steps
        self.ended.share = share if step == len(self.ended.states) else 0.0
        self.notify(_where(steps, step, share), (step + share) / len(steps))

    def _place(self, now: float) -> tuple[int, float]:
        """Step of CalculiX at a total time, the earlier one at its end, and its finished share."""
        ends = self.ends
        step = min(bisect_left(ends, now - 1e-6 * self.job.steps[-1].span), len(ends) - 1)
        span = self.job.steps[step].span
        return step, min(1.0, 1.0 - (ends[step] - now) / span)

    def _take(self) -> None:
        """Cache the steps whose tables are whole."""
        tables = output.read_dat(self.folder / f"{_JOB}.dat", self.read)
        groups: dict[float, list[output.Table]] = {}
        for table in tables:
            groups.setdefault(table.time, []).append(table)
        for group in groups.values():
            done = len(self.ended.states)
            by_name = {(table.kind, table.set): table.rows for table in group}
            state = self._state(by_name, self.job.steps[done])
            if state is None:
                return
            self.ended.states.append(state)
            self.read = group[-1].end
            # a motion is one step of CalculiX, which can restart only after whole steps
            whole = self.job.steps[done].is_static and done < self.begun
            _save(self.kept, done + 1, state, self.folder / f"{_JOB}.rout" if whole else None)

    def _state(self, group: dict[tuple[str, str], Floats], step: deck.Step) -> State | None:
        """Assemble the state of a step; None if a table lacks rows."""
        mesh = self.job.mesh
        nodes, bricks = len(mesh.nodes), 8 * len(self.free)
        kinds = (("displacements", "BODY"), ("velocities", "BODY"), ("forces", "SPANS"))
        displacement, velocity, force = (group.get(kind, np.zeros((0, 4))) for kind in kinds)
        found = {}
        for kind in ("stresses", "strains"):
            parts = [rows for (what, _), rows in group.items() if what == kind and len(rows)]
            rows = np.concatenate(parts) if parts else np.zeros((0, 8))
            if len(rows) != bricks:
                return None
            order = np.lexsort((rows[:, 1], rows[:, 0]))
            found[kind] = rows[order, 2:].reshape(-1, 8, 6)
        spans = deck.spans(mesh).first
        if len(displacement) != nodes or len(force) != len(spans):
            return None
        if not step.is_static and len(velocity) != nodes:
            return None
        place = {int(node) - 1: row for row, node in enumerate(force[:, 0])}
        return State(
            displacement=displacement[np.argsort(displacement[:, 0]), 1:] / deck.MM,
            velocity=None if step.is_static else velocity[np.argsort(velocity[:, 0]), 1:] / deck.MM,
            stress=found["stresses"] * _PA,
            strain=found["strains"],
            span_force=np.array([force[place[int(node)], 1:] for node in spans]),
        )


def _where(steps: tuple[deck.Step, ...], step: int, share: float) -> str:
    """Describe the progress in words."""
    now = steps[step]
    if now.is_static:
        low = max(steps[step - 1].tensions) if step else 0.0
        return f"finite elements, {low + share * (max(now.tensions) - low):.3g} N"
    elapsed = sum(s.duration for s in steps[:step]) + share * now.duration
    return f"finite elements, {elapsed:.3g} s"


# -- cache -------------------------------------------------------------------------------------


def _file(kept: Path, number: int) -> Path:
    return kept / f"step_{number:04d}.npz"


def _restart(kept: Path, number: int) -> Path:
    return kept / f"restart_{number:04d}"


def _restart_at(kept: Path, done: int) -> int:
    """Last step, at most `done`, after which CalculiX can restart; 0 if there is none."""
    while done and not _restart(kept, done).exists():
        done -= 1
    return done


def _drop_restarts(kept: Path) -> None:
    """Remove the restart files once all steps exist, also those of killed processes."""
    for file in kept.glob("restart_*"):
        file.unlink(missing_ok=True)


def _load(kept: Path, job: Job) -> list[State]:
    states = []
    for number in range(1, len(job.steps) + 1):
        try:
            with np.load(_file(kept, number)) as held:
                parts = {name: held[name] for name in held.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile, zlib.error):
            break  # missing or damaged: calculated again
        parts.setdefault("velocity", None)
        states.append(State(**parts))
    return states


def _save(kept: Path, number: int, state: State, restart: Path | None) -> None:
    """Write a step whole or not at all, restart file first; runs restart from the last one."""
    what, advice = "kept results", "; make room there, or name another place by XDG_CACHE_HOME"
    arrays = {name: value for name, value in vars(state).items() if value is not None}
    try:
        kept.mkdir(parents=True, exist_ok=True)
        if restart is not None and restart.exists():
            write_whole_file(_restart(kept, number), what, partial(shutil.copyfile, restart))
        write_whole_file(_file(kept, number), what, lambda new: np.savez_compressed(new, **arrays))
        if restart is not None:  # not before, so that one always exists
            _restart(kept, number - 1).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot write the kept results to {kept}: {error.strerror}{advice}"
        ) from None
    except InputError as error:
        raise InputError(f"{error}{advice}") from None
