"""Requests that exceed the memory are rejected with a sentence; a failed allocation aborts."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest

import bowstring as bs
from bowstring import RodModel
from bowstring.errors import InputError
from objects import objects

HUGE = np.broadcast_to(0.0, (10**13, 3))
ROW = np.broadcast_to(0.0, 10**13)


@pytest.mark.parametrize("values", [HUGE, ROW, HUGE.T])
@pytest.mark.parametrize(
    "name", ["tensions", "tip_force", "tip_moment", "gravity", "displacements"]
)
def test_shapes_are_checked_first(robot: bs.Robot, name: str, values: np.ndarray) -> None:
    given = {} if name in ("tensions", "displacements") else {"tensions": [1, 0, 0]}
    with pytest.raises(InputError, match=rf"^{name} has .*3.*, in "):
        bs.solve(robot, **objects(**given, **{name: values}))
    if name == "tip_moment":
        return
    with pytest.raises(InputError, match=rf"^{name} has .*3.*, in "):
        bs.modes(robot, **objects(**given, **{name: values}))


@pytest.mark.parametrize("function", [bs.sweep, bs.solve_batch])
@pytest.mark.parametrize("name", ["tensions", "displacements", "angles"])
def test_more_loads_than_fit(robot: bs.Robot, function, name: str) -> None:
    with pytest.raises(InputError, match="GB of memory, more than is available; give"):
        function(robot, **objects(**{name: HUGE}))
    with pytest.raises(InputError, match=r"gravity has shape \(10000000000000, 3\), it must be"):
        function(robot, np.zeros((2, 3)), load=bs.Load(gravity=HUGE))


def test_the_length_of_an_invalid_sequence_is_reported(robot: bs.Robot) -> None:
    for wrong in ([0.0] * 5000, tuple([0.0] * 5000), np.zeros(5000)):
        with pytest.raises(InputError, match="tensions has 5000 numbers, it must have 3, in N"):
            bs.solve(robot, wrong)


#: Work that needs more than the given address space, and its error message.
LIMITED = {
    "bs.solve_batch(robot, load=bs.Load(None, np.broadcast_to(1e-3, (10**7, 3))))": "the solutions",
    "bs.solve_batch(robot, np.broadcast_to(1.0, (10**7, 3)))": "the solutions of 10000000 loads",
    "bs.sweep(with_friction, np.broadcast_to(1.0, (10**7, 3)), disks=False)": "the solutions of",
    "bs.solve(many(2_000, 1000), load=bs.Load(displacements=[1e-3] * 1000))": "1000 tendons",
    "bs.modes(many(20_000, 3), count=50_000)": "50000 modes of a robot with 20000 disks",
    "bs.simulate(many(20_000, 3), [0, 0, 0], 1.0)": "fields at 101 times",
}
CHILD = """
import json, resource, sys
import numpy as np
import bowstring as bs
from bowstring.errors import InputError

def many(disks, tendons):
    return bs.load_robot("amouri2019").with_({
        "segments.0.disks.count": disks,
        "segments.0.disks.thickness": 1e-9,
        "segments.0.tendons.count": tendons,
    })

robot = bs.load_robot("amouri2019")
with_friction = robot.with_({"segments.0.tendons.friction": 0.1})
bs.solve_batch(robot, np.zeros((200, 3)))
resource.setrlimit(resource.RLIMIT_AS, (4 * 10**9, 4 * 10**9))
for work in json.load(sys.stdin):
    try:
        eval(work)
    except InputError as error:
        print(error)
    else:
        print("it fits")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs a limit of the address space")
@pytest.mark.slow
def test_work_beyond_a_limit_of_memory_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", CHILD],
        input=json.dumps([*LIMITED]),
        capture_output=True,
        text=True,
        timeout=120,
        env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.returncode == 0, done.stderr
    for said, expected in zip(done.stdout.splitlines(), LIMITED.values(), strict=True):
        assert expected in said and said.count("GB of memory, more than is available; ") == 1


def test_fields_of_many_disks() -> None:
    """Sections next to clamps are found without a table of all disks and stations."""
    from bowstring.statics.fields import Section
    from bowstring.statics.simulator import stations

    robot = bs.load_robot("amouri2019").with_({"segments.0.disks.clamped_length": "3 mm"})
    station, module = stations(robot, 5)
    free = Section(robot, station, module, RodModel()).bending_compliance.any(axis=1)
    assert free.all()
    # within a clamp, at its ends, and outside
    disk = robot.disks.station_m[3]
    station = disk + np.array([-2e-3, -1.5e-3, -1e-3, 0.0, 1e-3, 1.5e-3, 2e-3])
    free = Section(robot, station, np.full(7, 3), RodModel()).bending_compliance.any(axis=1)
    assert free.tolist() == [True, True, False, False, False, True, True]
    many = bs.load_robot("amouri2019").with_(
        {"segments.0.disks.count": 50_000, "segments.0.disks.thickness": 1e-9}
    )
    station, module = stations(many, 5)  # a table of both would take 100 GB
    assert Section(many, station, module, RodModel()).bending_compliance.all()


def test_modes_of_many_disks_match_those_of_few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Iterative and direct solution, with equal frequencies, locked tendons and light disks."""
    from bowstring.dynamics import modal

    robot = bs.load_robot("amouri2019").with_({"segments.0.disks.clamped_length": "1 mm"})
    with_friction = robot.with_({"segments.0.tendons.friction": 0.2})
    cases = [
        (robot, {}),
        (robot, {"tensions": [30, 5, 0], "gravity": (0, 0, -9.81)}),
        (robot, {"displacements": [0.02, -0.03, -0.01], "theory": "kirchhoff"}),
        (with_friction, {"tensions": [20, 0, 0], "elements": 2}),
    ]
    for made, given in cases:
        dense = bs.modes(made, count=8, **objects(**given))
        with monkeypatch.context() as patch:
            patch.setattr(modal, "_DENSE", 0)
            patch.setattr(modal, "_SHARE", 1.0)
            iterated = bs.modes(made, count=8, **objects(**given))
        np.testing.assert_allclose(iterated.frequency_hz, dense.frequency_hz, rtol=1e-9)
        assert iterated.kind == dense.kind
        # a pair of equal frequencies may lie in any two planes, and the last may be half of one
        apart = np.abs(np.diff(np.log(dense.frequency_hz), prepend=-9)) > 1e-4
        for k in np.flatnonzero(apart[:-1] & apart[1:]):
            np.testing.assert_allclose(iterated.displacement[k], dense.displacement[k], atol=1e-6)


def test_modes_of_very_many_disks() -> None:
    robot = bs.load_robot("amouri2019")
    share = {"segments.0.disks.mass": "20 g"}
    found = {}
    for disks in (20, 2000):
        changed = {"segments.0.disks.count": disks, "segments.0.disks.thickness": 1e-9}
        share["segments.0.disks.mass"] = 0.18 / disks
        found[disks] = bs.modes(robot.with_({**changed, **share}), count=4).frequency_hz
    assert found[2000][0] == pytest.approx(found[2000][1], rel=1e-9)  # in two planes
    # distributed mass, and lumped mass that is closer to the tip
    np.testing.assert_allclose(found[2000], found[20], rtol=0.08)
    assert (found[2000] > found[20]).all()
