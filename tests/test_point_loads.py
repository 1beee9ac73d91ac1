"""Forces beside the centres of disks, followers, and forces per length of backbone."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics import modes, ramp
from bowstring.errors import InputError
from bowstring.fem import run as fem
from bowstring.robot.designs import Designs
from bowstring.statics.designs import sweep_designs
from shell import Shell

ROBOT = bs.load_robot("amouri2019")
TENSIONS = [40.0, 0.0, 10.0]
UP = (0, 0, -9.81)

DEAD = bs.PointLoad(4, force=[0.0, 0.6, 0.2], moment=[0.02, 0.0, 0.03], point=[0.02, 0.0, 0.05])
FOLLOWER = bs.PointLoad(force=[0.3, 0.2, -0.5], point=[0.0, 0.03, 0.01], follower=True)
LINE = [0.3, -0.8, 0.5]
ALL: dict[str, Any] = {"point_loads": [DEAD, FOLLOWER], "line_forces": LINE}


def as_disk_loads(solution: bs.Solution, loads: list[bs.PointLoad]) -> dict[str, Any]:
    """Forces on the centres of disks and moments that the loads are at the poses of a solution."""
    forces, moments = np.zeros((9, 3)), np.zeros((9, 3))
    for load in loads:
        turn = solution.disk_rotations[load.disk]
        force, moment = np.array(load.force), np.array(load.moment)
        if load.follower:
            force, moment = turn @ force, turn @ moment
        forces[load.disk] += force
        moments[load.disk] += np.cross(turn @ np.array(load.point), force) + moment
    return {"disk_forces": forces, "disk_moments": moments}


@pytest.mark.parametrize("loads", [[DEAD], [FOLLOWER], [DEAD, FOLLOWER]])
@pytest.mark.parametrize("path", ["straight", "continuous"])
def test_they_are_dead_loads_in_equilibrium(loads: list[bs.PointLoad], path: str) -> None:
    model = bs.RodModel(tendon_path=path)
    found = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=UP, point_loads=loads), model=model)
    assert found.converged
    dead = as_disk_loads(found, loads)
    same = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=UP, **dead), model=model)
    assert np.abs(same.disk_positions - found.disk_positions).max() < 1e-9


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


def test_rows_equal_single_solves() -> None:
    tensions = np.random.default_rng(1).uniform(0, 40, (12, 3))
    load = bs.Load(tensions, gravity=UP, **ALL)
    for found in (
        bs.sweep(ROBOT, load=load),
        bs.sweep(ROBOT, load=load, warm=False),
        bs.solve_batch(ROBOT, load=load, threads=2),
    ):
        for i in range(12):
            alone = bs.solve(ROBOT, load=bs.Load(tensions[i], gravity=UP, **ALL))
            assert alone.converged
            assert np.abs(alone.disk_positions - found.disk_positions[i]).max() < 1e-9
    designs = Designs(ROBOT, {"segments.*.backbone.E": [35e9, 40e9]})
    found = sweep_designs(designs, tensions[:3], load=bs.Load(**ALL))
    alone = bs.solve(ROBOT, load=bs.Load(tensions[2], **ALL))
    assert np.abs(alone.tip.position - found.tip_position[0, 2]).max() < 1e-9


def test_many_rows_equal_single_solves() -> None:
    """A batch long enough for a polynomial start."""
    tensions = np.random.default_rng(2).uniform(0, 40, (4000, 3))
    found = bs.solve_batch(ROBOT, load=bs.Load(tensions, **ALL))
    for i in (0, 1999, 3999):
        alone = bs.solve(ROBOT, load=bs.Load(tensions[i], **ALL))
        assert np.abs(alone.tip.position - found.tip_position[i]).max() < 1e-9


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_displacement_control_and_history(friction: float) -> None:
    robot = ROBOT.with_({"segments.0.tendons.friction": friction})
    commanded = bs.Load(displacements=[0.03, -0.02, -0.012], gravity=UP, **ALL)
    found = bs.solve(robot, load=commanded)
    assert found.converged
    if not friction:
        by_tension = bs.solve(robot, found.tensions, load=bs.Load(gravity=UP, **ALL))
        assert np.abs(by_tension.disk_positions - found.disk_positions).max() < 1e-8
    history = json.loads(json.dumps(found.history()))
    again = bs.solve(robot, load=commanded, history=history)
    assert np.abs(again.disk_positions - found.disk_positions).max() < 1e-9
    damaged = {**history, "point_loads": [{"disk": 1}]}
    with pytest.raises(InputError, match="the history is damaged"):
        bs.solve(robot, load=commanded, history=damaged)


def test_history_after_a_solve_by_tensions() -> None:
    found = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=UP, **ALL))
    history = json.loads(json.dumps(found.history()))
    again = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=UP, **ALL), history=history)
    assert np.abs(again.disk_positions - found.disk_positions).max() < 1e-9


def test_a_solution_keeps_its_load() -> None:
    found = bs.solve(ROBOT, TENSIONS, load=bs.Load(**ALL))
    kept = found.load
    tip = bs.PointLoad(8, FOLLOWER.force, FOLLOWER.moment, FOLLOWER.point, True)
    assert kept.point_loads == (DEAD, tip)
    assert np.array_equal(kept.line_forces, np.tile(LINE, (9, 1)))
    settings = json.loads(found.to_dataset().attrs["settings"])
    assert settings["point_loads"] == [DEAD.to_dict(), tip.to_dict()]
    again = bs.solve(ROBOT, load=kept)
    assert np.abs(again.disk_positions - found.disk_positions).max() < 1e-12


def test_derivatives_under_followers() -> None:
    by = bs.jacobians(bs.solve(ROBOT, TENSIONS, load=bs.Load(**ALL)))
    h = 1e-3
    for tendon in (0, 2):
        ends = []
        for sign in (1, -1):
            tensions = np.array(TENSIONS)
            tensions[tendon] += sign * h
            ends.append(bs.solve(ROBOT, tensions, load=bs.Load(**ALL)).tip.position)
        exact = (ends[0] - ends[1]) / (2 * h)
        off = np.abs(by.tip_position_by_tension[:, tendon] - exact).max()
        assert off < 1e-6 * np.linalg.norm(exact)


def test_a_motion_ends_in_the_equilibrium() -> None:
    exact = bs.solve(ROBOT, TENSIONS, load=bs.Load(**ALL), model=bs.RodModel(elements=1))
    rising = [
        bs.PointLoad(
            load.disk,
            ramp(load.force, 0.2),
            lambda t, moment=load.moment: min(t / 0.2, 1.0) * np.array(moment),
            load.point,
            load.follower,
        )
        for load in (DEAD, FOLLOWER)
    ]
    tables = [
        bs.PointLoad(
            load.disk,
            ramp(load.force, 0.2),
            ramp(load.moment, 0.2),
            load.point,
            load.follower,
        )
        for load in (DEAD, FOLLOWER)
    ]
    for loads in (rising, tables):
        run = bs.simulate(
            ROBOT,
            ramp(TENSIONS, 0.2),
            4.0,
            load=bs.Load(point_loads=loads, line_forces=ramp(LINE, 0.2)),
            integrator=bs.Integrator(mass_damping=15.0),
            output=bs.Output(every=0.1, points=0),
        ).raise_for_status()
        assert np.linalg.norm(run.tip_position[-1] - exact.tip.position) < 1e-4
        assert np.linalg.norm(run.tip_position[1] - exact.tip.position) > 0.02
    assert json.loads(json.dumps(run.settings["point_loads"]))[0]["disk"] == 5
    still = bs.simulate(ROBOT, TENSIONS, 0.2, load=bs.Load(**ALL))
    assert np.ptp(still.tip_position, axis=0).max() < 1e-7
    assert np.abs(still.tip_position[0] - exact.tip.position).max() < 1e-6
    # released from other values on the same points
    start = bs.Start(bs.Load(point_loads=[], line_forces=[0, 0, 0]))
    free = bs.solve(ROBOT, TENSIONS, model=bs.RodModel(elements=1)).tip.position
    let_go = bs.simulate(ROBOT, TENSIONS, 0.1, load=bs.Load(**ALL), start=start)
    assert np.abs(let_go.tip_position[0] - free).max() < 1e-6
    other = bs.Start(bs.Load(point_loads=[DEAD]))
    with pytest.raises(InputError, match="same disks and points"):
        bs.simulate(ROBOT, TENSIONS, 0.1, load=bs.Load(**ALL), start=other)


def test_a_motion_conserves_energy() -> None:
    run = bs.simulate(
        ROBOT,
        TENSIONS,
        0.5,
        load=bs.Load(**ALL),
        start=bs.Start(bs.Load(point_loads=[], line_forces=[0, 0, 0])),
        integrator=bs.Integrator(spectral_radius=1.0),
    ).raise_for_status()
    data = run.to_dataset()
    left = data.kinetic_energy + data.elastic_energy + data.gravity_energy - data.work
    scale = float(data.kinetic_energy.max())
    assert float(np.abs(left - left[0]).max()) < 1e-3 * scale


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
    for load in (FOLLOWER, DEAD):
        with pytest.raises(InputError, match="have no potential"):
            modes(ROBOT, TENSIONS, load=bs.Load(point_loads=[load]))


def test_a_follower_along_the_backbone_makes_it_flutter() -> None:
    """Beck's column: no static critical load, flutter near 20.05 E I / L^2."""
    tail = {
        "segments.0.disks.mass": "0 g",
        "segments.0.disks.count": 24,
        "segments.0.disks.thickness": "0 mm",
    }
    robot = ROBOT.with_(tail)
    critical = 20.05 * float(robot.bending_stiffness[0]) / robot.length**2
    for share, stable in ((0.5, True), (0.98, True), (1.05, False)):
        load = bs.PointLoad(force=[0, 0, -share * critical], follower=True)
        found = bs.solve(
            robot, [0, 0, 0], load=bs.Load(point_loads=[load]), model=bs.RodModel("kirchhoff")
        )
        assert (found.stable is True) == stable, share


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"disk": 1.5}, "disk is 1.5, it must be a whole number"),
        ({"force": [1.0, 2.0]}, r"force has shape \(2,\)"),
        ({"force": [np.nan, 0, 0]}, "all must be finite"),
        ({"moment": "x"}, "moment is 'x', it must be 3 numbers"),
        ({"point": ramp([0, 0, 1], 1.0)}, "point is"),
        ({"follower": 1}, "follower is 1, it must be True or False"),
    ],
)
def test_bad_point_loads_are_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        bs.PointLoad(**given)


@pytest.mark.parametrize(
    ("load", "says"),
    [
        ({"point_loads": [bs.PointLoad(9)]}, "point load 1 acts on disk 10, and the robot has 9"),
        ({"point_loads": [bs.PointLoad(-10)]}, "point load 1 acts on a disk before the base"),
        ({"point_loads": 3.0}, "point_loads is 3.0, it must be a sequence of PointLoad"),
        ({"point_loads": [[1, 2, 3]]}, "it must be a sequence of PointLoad"),
        ({"line_forces": [1.0, 2.0]}, r"line_forces has shape \(2,\), it must have \(9, 3\)"),
        ({"line_forces": [[0, 0, 1.0]] * 4}, r"line_forces has shape \(4, 3\)"),
        ({"line_forces": [0, 0, np.inf]}, "force per length"),
        ({"line_forces": "x"}, "it must be numbers of shape"),
    ],
)
def test_bad_loads_are_refused(load: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        bs.solve(ROBOT, TENSIONS, load=bs.Load(**load))
    with pytest.raises(InputError, match=says):
        bs.simulate(ROBOT, TENSIONS, 0.1, load=bs.Load(**load))
    with pytest.raises(InputError, match=says):
        bs.sweep(ROBOT, [TENSIONS] * 2, load=bs.Load(**load))


def test_loads_that_are_not_taken_are_refused() -> None:
    rising = bs.PointLoad(force=ramp([0, 0, 1.0], 1.0))
    with pytest.raises(InputError, match="depends on time, which only"):
        bs.solve(ROBOT, TENSIONS, load=bs.Load(point_loads=[rising]))
    for load in (bs.Load(point_loads=[DEAD]), bs.Load(line_forces=LINE)):
        with pytest.raises(InputError, match="a map takes gravity and tip force only"):
            bs.validity_map(ROBOT, load=load)
        with pytest.raises(InputError, match="tensions, gravity and a tip force only"):
            fem.sweep(ROBOT, [TENSIONS], load=load)


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


def test_flags(shell: Shell) -> None:
    point = "5:0,0.6,0.2@20 mm,0,0.05"
    follower = "9:0.3,0.2,-500 mN@0,30 mm,0.01"
    flags = ["--point-force", point, "--follower-force", follower, "--line-force", "0.3,-0.8,0.5"]
    out = shell.json("solve", "amouri2019", "--tension", "40,0,10", *flags)
    dead = bs.PointLoad(4, DEAD.force, point=DEAD.point)
    load = bs.Load(point_loads=[dead, FOLLOWER], line_forces=LINE)
    exact = bs.solve(ROBOT, TENSIONS, load=load)
    assert np.allclose(out["tip"]["position_m"], exact.tip.position, rtol=0, atol=1e-12)
    assert out["provenance"]["settings"]["point_loads"][0] == dead.to_dict()
    run = ["simulate", "amouri2019", "--tension", "40,0,10", "--from", "40,0,10", "--rise", "0"]
    moved = shell.json(*run, "--hold", "0.02", *flags)
    assert np.abs(np.array(moved["tip_position_m"]) - exact.tip.position).max() < 1e-5
    found = shell.json("modes", "amouri2019", "--point-force", "9:0,0,2@0,0,0.05", "--count", "1")
    hanging = bs.PointLoad(force=[0, 0, 2.0], point=[0, 0, 0.05])
    frequency = modes(ROBOT, [0, 0, 0], load=bs.Load(point_loads=[hanging]), count=1).frequency_hz
    assert found["modes"][0]["frequency_hz"] == pytest.approx(frequency[0])


@pytest.mark.parametrize(
    ("flag", "text", "says"),
    [
        ("--point-force", "9:0,1,0", "a point of the disk must follow the force after an @"),
        ("--point-force", "10:0,1,0@0,0,0", "must be a disk of amouri2019 from 1 to 9"),
        ("--point-force", "x:0,1,0", "from 1 to 9 or an arc length with its unit and, after"),
        ("--point-force", "9:0,1,0", 'in place of the disk, such as "137 mm:0,1,0"'),
        ("--point-force", "9:0,1,0@0,0", "got 2 numbers; write x, y and z"),
        ("--follower-force", "9:0,1,0@0,0,20", "20 mm"),
        ("--follower-force", "9:0,x,0", 'got "x", which is not a number'),
        ("--line-force", "0,1", "got 2 numbers"),
        ("--line-force", "0,0,1 N", "1 N"),
    ],
)
def test_bad_flags(shell: Shell, flag: str, text: str, says: str) -> None:
    error = shell.error("solve", "amouri2019", "--tension", "1,0,0", flag, text)
    assert error.startswith(flag) and says in error


def test_disks_that_collide_under_the_whole_load_are_named() -> None:
    """Load steps pass the load at which they touch; the solver gave up there."""
    robot = bs.load_robot("amouri2019").with_({"segments.0.disks.count": 3})
    follower = bs.PointLoad(force=[1, 20, -8], disk=2, follower=True)
    moment = [-2, 1.5, 1]
    load = bs.Load([150, 205, 0], gravity=[0, 0, 0], tip_moment=moment, point_loads=[follower])
    found = bs.solve(robot, load=load)
    assert found.status == "no_equilibrium"
    assert "the base and disk 1 collide" in found.message
