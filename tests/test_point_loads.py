"""Forces beside the centres of disks, followers, and forces per length of backbone."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics import Table, modes
from shell import Shell

ROBOT = bs.load_robot("amouri2019")
TENSIONS = [40.0, 0.0, 10.0]
UP = (0, 0, -9.81)

DEAD = bs.PointLoad(4, force=[0.0, 0.6, 0.2], moment=[0.02, 0.0, 0.03], point=[0.02, 0.0, 0.05])
FOLLOWER = bs.PointLoad(force=[0.3, 0.2, -0.5], point=[0.0, 0.03, 0.01], follower=True)
LINE = [0.3, -0.8, 0.5]
ALL: dict[str, Any] = {"point_loads": [DEAD, FOLLOWER], "line_forces": LINE}


def test_a_payload_hangs_below_its_disk() -> None:
    """A weight on a lever below the tip of an upright robot without tension turns nothing; beside
    the axis it bends the robot as its moment does."""
    weight = 0.05 * 9.81
    hanging = ROBOT.with_({"gravity": "0 0 9.81 m/s^2"})
    below = bs.PointLoad(force=[0, 0, weight], point=[0, 0, 0.05])
    straight = bs.solve(hanging, [0, 0, 0], load=bs.Load(point_loads=[below]))
    assert straight.stable and np.abs(straight.tip.position[:2]).max() < 1e-12
    beside = bs.PointLoad(force=[0, 0, 1e-3], point=[0.02, 0, 0])
    load = bs.Load(gravity=(0, 0, 0), point_loads=[beside])
    bent = bs.solve(ROBOT, [0, 0, 0], load=load, model=bs.RodModel("kirchhoff"))
    moment = 1e-3 * 0.02
    exact = -moment * ROBOT.length**2 / (2.0 * float(ROBOT.bending_stiffness[0]))
    assert bent.stable and bent.tip.position[0] == pytest.approx(exact, rel=1e-3)


def test_a_force_per_length_is_a_weight() -> None:
    light = ROBOT.with_({"segments.0.disks.mass": "0 g"})
    for gravity in (UP, (3.0, -4.0, 2.0)):
        weight = bs.solve(light, TENSIONS, load=bs.Load(gravity=gravity))
        line = float(light.mass_per_length[0]) * np.array(gravity)
        for given in (line, np.tile(line, (9, 1))):
            found = bs.solve(light, TENSIONS, load=bs.Load(gravity=(0, 0, 0), line_forces=given))
            assert np.abs(found.disk_positions - weight.disk_positions).max() < 1e-12


def test_functions_and_tables_of_time_are_the_same_load() -> None:
    """On points and on the centres of disks."""
    spread = np.outer(np.linspace(-1.0, 1.0, 9), [0.3, 0.8, 0.1])

    def load(of: Any) -> bs.Load:
        points = [replace(p, force=of(p.force), moment=of(p.moment)) for p in (DEAD, FOLLOWER)]
        own = {"disk_forces": of(spread), "disk_moments": of(0.05 * spread)}
        return bs.Load(point_loads=points, **own)

    rising = (
        lambda v: lambda t: min(t / 0.2, 1.0) * np.array(v),
        lambda v: Table([0.0, 0.2], np.stack([0.0 * np.array(v), v])),
    )
    runs = [bs.simulate(ROBOT, TENSIONS, 0.5, load=load(of)) for of in rising]
    assert np.abs(runs[0].tip_position - runs[1].tip_position).max() < 1e-5
    assert json.loads(json.dumps(runs[1].settings["point_loads"]))[0]["disk"] == 5


@pytest.mark.parametrize("points", [[], [DEAD, bs.PointLoad(point=FOLLOWER.point, follower=True)]])
def test_a_start_has_other_values_on_the_same_points(points: list[bs.PointLoad]) -> None:
    before = bs.Load(point_loads=points, line_forces=[0, 0, 0])
    rest = bs.solve(ROBOT, TENSIONS, load=before, model=bs.RodModel(elements=1)).tip.position
    let_go = bs.simulate(ROBOT, TENSIONS, 0.1, load=bs.Load(**ALL), start=bs.Start(before))
    assert np.abs(let_go.tip_position[0] - rest).max() < 1e-6
    assert np.ptp(let_go.tip_position, axis=0).max() > 0.01


def test_modes() -> None:
    """A dead force beyond the tip, away from the base, raises the lowest frequency as tension does,
    and the more the longer its lever."""
    free = modes(ROBOT, [0, 0, 0])
    hanging = bs.PointLoad(force=[0, 0, 2.0], point=[0, 0, 0.05])
    held = modes(ROBOT, [0, 0, 0], load=bs.Load(point_loads=[hanging]))
    centre = modes(ROBOT, [0, 0, 0], load=bs.Load(tip_force=[0, 0, 2.0]))
    assert held.frequency_hz[0] > centre.frequency_hz[0] > free.frequency_hz[0]
    along = modes(ROBOT, [0, 0, 0], load=bs.Load(line_forces=[0, 0, 1.0]))
    assert along.frequency_hz[0] > free.frequency_hz[0]


def test_branches_under_a_force_per_length() -> None:
    """Greenhill's column by a force per length instead of a weight."""
    light = ROBOT.with_({"segments.0.disks.mass": "0 g"})
    bending = float(light.bending_stiffness[0])
    line = 7.8373 * bending / light.length**3
    found = bs.critical_load(
        light,
        load=bs.Load([0, 0, 0], line_forces=[0, 0, -2 * line]),
        model=bs.RodModel("kirchhoff"),
    )
    assert found.factor == pytest.approx(0.5, rel=1e-3)
    assert "N/m along the backbone more" in " ".join(found.more)


def test_a_motion_takes_a_load_between_disks_by_default(shell: Shell) -> None:
    """It has as many elements between two disks as the load needs, as in Python."""
    run = ["simulate", "amouri2019", "--tension", "10,0,0", "--from", "10,0,0", "--rise", "0"]
    moved = shell.json(*run, "--hold", "0.02", "--point-force", "137 mm:0,1,0")
    load = bs.Load([10, 0, 0], point_loads=[bs.PointLoad(arc_length=0.137, force=[0, 1, 0])])
    same = bs.simulate(ROBOT, load=load, duration=0.02, start=bs.Start(bs.Load([10, 0, 0])))
    assert moved["provenance"]["settings"]["elements"] == same.settings["elements"] == 2
    assert moved["tip_position_m"][-1] == pytest.approx(same.tip_position[-1], abs=1e-6)
    assert shell.json(*run, "--hold", "0.02")["provenance"]["settings"]["elements"] == 1
    flags = ("--point-force", "137 mm:0,1,0", "--elements", "1")
    assert "needs 2 elements or more" in shell.error(*run, "--hold", "0.02", *flags)


def test_disks_that_collide_under_the_whole_load_are_named() -> None:
    """Load steps pass the load at which they touch; the solver gave up there."""
    robot = bs.load_robot("amouri2019").with_({"segments.0.disks.count": 3})
    follower = bs.PointLoad(force=[1, 20, -8], disk=2, follower=True)
    moment = [-2, 1.5, 1]
    load = bs.Load([150, 205, 0], gravity=[0, 0, 0], tip_moment=moment, point_loads=[follower])
    found = bs.solve(robot, load=load)
    assert found.status == "no_equilibrium"
    assert "the base and disk 1 collide" in found.message
