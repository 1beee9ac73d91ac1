"""A large job in blocks on two Dask processes, killed twice, equals an uninterrupted run.

``python -m campaign.blocks N`` computes N points on a local cluster of two processes, each limited
to 1 GB, kills all of its processes by SIGKILL after a third and after two thirds of the blocks,
and starts it again. Then the same job runs in one process, and the files of all blocks are
compared. A cheap function stands in for the solver; ``--solve`` takes the solver.

It prints the largest memory of each process; the client's process contains the scheduler.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

import bowstring as bs
from bowstring.jobs import Job, Variable, run, threads

BLOCK: Final = 10_000
LIMIT: Final = "1 GB"  # memory of a worker, at which Dask ends it
PATIENCE: Final = 300.0  # s without a new block
_EVERY: Final = 0.2  # s between two looks

Arrays = dict[str, np.ndarray[Any, np.dtype[Any]]]


def stand_in(first: int, count: int) -> Arrays:
    """Two numbers of each point, as a solve gives for a planar tip."""
    point = np.arange(first, first + count, dtype=float)
    return {"tip_x": np.sin(point), "tip_z": np.sqrt(point)}


def solve(first: int, count: int) -> Arrays:
    """Tip of the built-in robot under two tensions, gravity and a tip force."""
    steps = np.array([0.7548776662466927, 0.5698402909980532])  # additive recurrence in the plane
    shares = (np.arange(first, first + count)[:, None] * steps) % 1.0
    tensions = np.column_stack([40.0 * shares, np.zeros(count)])
    load = bs.Load(gravity=(0, 0, -9.81), tip_force=(0.05, 0.02, -0.1))
    found = bs.solve_batch(
        bs.load_robot("amouri2019"), tensions, load=load, disks=False, threads=threads()
    )
    return {"tip_x": found.tip_position[:, 0], "tip_z": found.tip_position[:, 2]}


def job(points: int, evaluate: Callable[[int, int], Arrays]) -> Job:
    """The job, in blocks of `BLOCK` points."""
    return Job(
        evaluate,
        axes={"sample": points},
        variables={"tip_x": Variable("m", "x of the tip"), "tip_z": Variable("m", "z of the tip")},
        description={"campaign": evaluate.__name__},
        block=BLOCK,
    )


def on_cluster(points: int, evaluate: Callable[[int, int], Arrays], folder: Path) -> None:
    """Compute the job on a local cluster, which ends with this process."""
    from distributed import Client, LocalCluster

    options = {"n_workers": 2, "threads_per_worker": 1, "memory_limit": LIMIT}
    with LocalCluster(dashboard_address=":0", **options) as cluster, Client(cluster) as client:
        run(job(points, evaluate), folder, client)


@dataclass
class Outcome:
    """What the processes took: seconds of each start, and bytes of the largest of each kind."""

    seconds: list[float]
    memory: dict[str, int]


def killed_twice(points: int, evaluate: Callable[[int, int], Arrays], folder: Path) -> Outcome:
    """Compute the job on a cluster, killed after each third of its blocks but the last."""
    total = job(points, evaluate).blocks
    outcome = Outcome([], {"client": 0, "worker": 0})
    arguments = [str(points), "--folder", str(folder), "--child", evaluate.__name__]
    for target in (total // 3, 2 * total // 3, total + 1):
        began = time.monotonic()
        child = subprocess.Popen(
            [sys.executable, "-m", "campaign.blocks", *arguments], start_new_session=True
        )
        try:
            _watch(child, folder / "blocks", target, outcome.memory)
        finally:
            if os.name != "nt":
                os.killpg(child.pid, signal.SIGKILL)  # the workers too
            child.wait()
        outcome.seconds.append(time.monotonic() - began)
    assert child.returncode == 0, f"the last run ended with {child.returncode}"
    return outcome


def _watch(
    child: subprocess.Popen[bytes], blocks: Path, target: int, memory: dict[str, int]
) -> None:
    """Wait until so many blocks are there or the process ends; measure its memory."""
    import psutil

    before, changed = -1, time.monotonic()
    while child.poll() is None:
        count = len(list(blocks.iterdir())) if blocks.exists() else 0
        if count >= target:
            return
        if count != before:
            before, changed = count, time.monotonic()
        assert time.monotonic() - changed < PATIENCE, f"no block after {count}"
        try:
            process = psutil.Process(child.pid)
            memory["client"] = max(memory["client"], process.memory_info().rss)
            for each in process.children(recursive=True):
                memory["worker"] = max(memory["worker"], each.memory_info().rss)
        except psutil.NoSuchProcess:
            pass
        time.sleep(_EVERY)


def compare(one: Path, other: Path, count: int) -> None:
    """Refuse folders whose blocks are not the same files, each once."""
    names = sorted(file.name for file in (one / "blocks").iterdir())
    numbers = [int(name.split("-")[1]) for name in names]
    assert numbers == list(range(1, count + 1)), "a block is missing or there twice"
    assert names == sorted(file.name for file in (other / "blocks").iterdir()), "other results"
    for name in names:
        same = (one / "blocks" / name).read_bytes() == (other / "blocks" / name).read_bytes()
        assert same, f"{name} differs"


def campaign(points: int, evaluate: Callable[[int, int], Arrays], folder: Path) -> Outcome:
    """Both runs and their comparison; the times are those of the three starts and of the other."""
    outcome = killed_twice(points, evaluate, folder / "cluster")
    began = time.monotonic()
    store = run(job(points, evaluate), folder / "serial")
    outcome.seconds.append(time.monotonic() - began)
    compare(folder / "serial", folder / "cluster", store.job.blocks)
    return outcome


def main() -> None:
    functions = {each.__name__: each for each in (stand_in, solve)}
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("points", type=int, nargs="?", default=1_000_000)
    parser.add_argument("--solve", action="store_true", help="the solver, not its stand-in")
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--child", choices=functions, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        on_cluster(options.points, functions[options.child], options.folder)
        return
    with tempfile.TemporaryDirectory(prefix="bowstring-blocks-") as made:
        evaluate = solve if options.solve else stand_in
        outcome = campaign(options.points, evaluate, Path(made))
    *starts, alone = outcome.seconds
    print(f"{options.points:.3g} points, every block once, equal to the run of one process")
    print(f"  on two processes, killed twice  {' + '.join(f'{each:.1f}' for each in starts)} s")
    print(f"  one process                     {alone:.1f} s")
    for what, most in outcome.memory.items():
        print(f"  largest {what:24}{most / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
