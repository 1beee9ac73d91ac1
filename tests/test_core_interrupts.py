"""Ctrl-C during work of the core: prompt KeyboardInterrupt, with all objects still usable."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics.load_history import ramp
from bowstring.dynamics.simulation import RunInterrupted

pytestmark = pytest.mark.skipif(os.name == "nt", reason="POSIX signals")

#: Preparation, and work that would take minutes to hours without an interrupt.
LONG = {
    "one solve": (
        "r = robot(30_000)",
        "bs.solve(r, [1e3, 0, 0], load=bs.Load(tip_force=(50, 3, -800)))",
    ),
    "one solve with a tip moment": (
        "r = robot(30_000)",
        "bs.solve(r, [900, 0, 0], load=bs.Load(tip_moment=(5, 3, 8)))",
    ),
    "batch on all cores": (
        "r = robot(300); t = np.broadcast_to([30.0, 9, 0], (1_000_000, 3))",
        "bs.solve_batch(r, t, model=bs.RodModel(elements=8), disks=False)",
    ),
    "batch in lanes": (
        "r = robot(300); t = np.broadcast_to([30.0, 9, 0], (3_000_000, 3))",
        "bs.solve_batch(r, t, disks=False, threads=2)",
    ),
    "batch on one core": (
        "r = robot(300); t = np.broadcast_to([30.0, 9, 0], (1_000_000, 3))",
        "bs.solve_batch(r, t, model=bs.RodModel(elements=8), disks=False, threads=1)",
    ),
    "batch of displacements": (
        "r = robot(50); t = np.broadcast_to([0.02, -0.03, -0.03], (1_000_000, 3))",
        "bs.solve_batch(r, load=bs.Load(displacements=t), disks=False)",
    ),
    "sweep": (
        "r = robot(300); t = np.broadcast_to([30.0, 9, 0], (1_000_000, 3))",
        "bs.sweep(r, t, model=bs.RodModel(elements=8), warm=False, disks=False)",
    ),
    "path with friction": (
        "r = robot(500, friction=0.2)",
        "bs.sweep(r, np.outer(np.sin(np.arange(100_000.0)) ** 2, [40, 20, 30]), disks=False)",
    ),
    "derivatives": (
        "r = robot(2000, count=600); s = bs.solve(r, np.zeros(600))",
        "bs.jacobians(s)",
    ),
    "motion": (
        "r = bs.load_robot('amouri2019')",
        "bs.simulate(r, [10, 0, 0], 1e3, integrator=bs.Integrator(dt=1e-5), "
        "output=bs.Output(every=1e3, points=0))",
    ),
    "start of a motion": (
        "r = robot(30_000)",
        "bs.simulate(r, [1e3, 0, 0], 1.0, load=bs.Load(tip_force=(50, 3, -800)), "
        "output=bs.Output(points=0))",
    ),
    "modes": (
        "r = robot(2000)",
        "bs.modes(r, count=4000)",
    ),
    "modes by iteration": (
        "r = robot(20_000)",
        "bs.modes(r, count=2000)",
    ),
    "arcs": (
        "a = np.broadcast_to([0.029, 0, 0.6], (30_000_000, 3))",
        "[_core.arc_pose(a) for _ in range(100)]",
    ),
}

CHILD = """
import json, signal, sys, time
import numpy as np
import bowstring as bs
from bowstring.dynamics import RunInterrupted, ramp
from bowstring import _core

def robot(disks, **tendons):
    return bs.load_robot("amouri2019").with_({
        "segments.0.disks.count": disks,
        "segments.0.disks.thickness": 1e-9,
        "segments.0.disks.mass": 1e-6,
        **{f"segments.0.tendons.{name}": value for name, value in tendons.items()},
    })

signal.signal(signal.SIGALRM, signal.default_int_handler)
for name, (prepare, work) in json.load(sys.stdin).items():
    exec(prepare)
    print(name, end=": ", flush=True)
    begun = time.perf_counter()
    signal.setitimer(signal.ITIMER_REAL, 0.2)
    try:
        exec(work)
    except KeyboardInterrupt:
        print("interrupted", flush=True)
    print(time.perf_counter() - begun - 0.2, file=sys.stderr)
    # and all works as before
    assert bs.solve(bs.load_robot("amouri2019"), [40, 0, 0]).converged
"""


@pytest.mark.slow
def test_long_work_is_interrupted() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CHILD],
        input=json.dumps(LONG),
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.stdout.splitlines() == [f"{case}: interrupted" for case in LONG], done.stderr


def test_a_path_continues_after_an_interruption() -> None:
    """An interrupted step is discarded."""
    robot = bs.load_robot("amouri2019").with_({"segments.0.tendons.friction": 0.1})
    calm = bs.sweep(robot, [[5, 0, 0], [10, 0, 0]])
    path = bs.sweep(robot, [[5, 0, 0]])
    rows = np.broadcast_to([10.0, 3, 1], (1_000_000, 3))
    with interrupted_after(0.2), pytest.raises(KeyboardInterrupt):
        bs.sweep(robot, rows, history=path.history(), disks=False)
    onward = bs.sweep(robot, [[10, 0, 0]], history=path.history())
    np.testing.assert_allclose(onward.tip_position[-1], calm.tip_position[-1], atol=1e-9)


def test_an_interrupted_motion_keeps_its_records() -> None:
    robot = bs.load_robot("amouri2019")
    whole = bs.simulate(
        robot,
        ramp([10, 0, 0], 0.1),
        0.02,
        integrator=bs.Integrator(dt=1e-5),
        output=bs.Output(points=0),
    )
    with interrupted_after(0.3), pytest.raises(RunInterrupted) as caught:
        # one interval of hours
        bs.simulate(
            robot,
            ramp([10, 0, 0], 0.1),
            1e3,
            integrator=bs.Integrator(dt=1e-5),
            output=bs.Output(every=1e3, points=0),
        )
    run = caught.value.run
    assert run.status == "interrupted" and 0 < run.time[-1] < 1e3
    if run.end <= whole.end:
        np.testing.assert_allclose(run.tip_position[-1], whole.tip_at([run.end])[0], atol=1e-6)


def test_another_exception_of_a_handler_is_passed_on() -> None:
    class Enough(Exception):
        pass

    def handler(number: int, frame: object) -> None:
        raise Enough

    robot = bs.load_robot("amouri2019")
    rows = np.broadcast_to([30.0, 9, 0], (1_000_000, 3))
    with interrupted_after(0.2, handler), pytest.raises(Enough):
        bs.solve_batch(robot, rows, disks=False, model=bs.RodModel(elements=8))


def test_a_handler_that_returns_does_not_interrupt() -> None:
    heard = []
    robot = bs.load_robot("amouri2019")
    rows = np.broadcast_to([30.0, 9, 0], (2000, 3))

    def handler(number: int, frame: object) -> None:
        # nested work
        heard.append(bs.solve(robot, [40, 0, 0]).converged)

    with interrupted_after(0.05, handler):
        while not heard:
            found = bs.solve_batch(robot, rows, disks=False, model=bs.RodModel(elements=8))
            assert found.converged.all()
    assert heard == [True]


@contextmanager
def interrupted_after(
    seconds: float, handler: Callable[[int, object], None] = signal.default_int_handler
) -> Iterator[None]:
    former = signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, former)
