"""Dead forces and moments on disks, from Python and the command line."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring.dynamics import Table, modes, ramp
from bowstring.errors import InputError
from bowstring.fem import run as fem
from bowstring.robot.designs import Designs
from bowstring.statics.designs import sweep_designs
from shell import Shell

ROBOT = bs.load_robot("amouri2019")
TENSIONS = [40.0, 0.0, 10.0]
UP = (0, 0, -9.81)
LAW = ROBOT.with_({"segments.0.tendons.friction": 0.1})

Floats = NDArray[np.float64]


def only(disk: int, vector: Any) -> Floats:
    """No vector but that on one disk, counted from 1."""
    out = np.zeros((9, 3))
    out[disk - 1] = vector
    return out


FORCES = only(4, [0.0, 1.0, 0.2]) + only(7, [-0.5, 0.0, 0.0])
MOMENTS = only(3, [0.02, 0.0, 0.05])
BOTH: dict[str, Any] = {"disk_forces": FORCES, "disk_moments": MOMENTS}


def test_the_last_disk_is_the_tip() -> None:
    for model in (bs.RodModel(), bs.RodModel("kirchhoff"), bs.RodModel(tendon_path="continuous")):
        for tip, disk, vector in (
            ("tip_force", "disk_forces", [0.3, 0.8, -0.4]),
            ("tip_moment", "disk_moments", [0.1, -0.2, 0.05]),
        ):
            one = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=UP, **{tip: vector}), model=model)
            load = bs.Load(gravity=UP, **{disk: only(9, vector)})
            two = bs.solve(ROBOT, TENSIONS, load=load, model=model)
            assert one.converged and one.stable == two.stable
            assert np.abs(one.disk_positions - two.disk_positions).max() < 1e-13
    # both add up
    half = bs.Load(tip_force=[0, 0.5, 0], disk_forces=only(9, [0, 0.5, 0]))
    whole = bs.solve(ROBOT, TENSIONS, load=bs.Load(tip_force=[0, 1, 0]))
    off = bs.solve(ROBOT, TENSIONS, load=half).disk_positions - whole.disk_positions
    assert np.abs(off).max() < 1e-13


@pytest.mark.parametrize("disk", [1, 5, 9])
def test_a_cantilever_follows_the_beam(disk: int) -> None:
    rod = bs.RodModel("kirchhoff", elements=1)
    stations, bending = ROBOT.disks.station_m, float(ROBOT.bending_stiffness[0])
    a = stations[disk - 1]
    x = np.minimum(stations, a)
    force, moment = 1e-4, 1e-5
    for load, bent, slope in (
        (
            bs.Load(disk_forces=only(disk, [0, force, 0])),
            force * x**2 * (3 * a - x) / 6,
            force * x * (a - x / 2),
        ),
        (bs.Load(disk_moments=only(disk, [-moment, 0, 0])), moment * x**2 / 2, moment * x),
    ):
        found = bs.solve(ROBOT, [0, 0, 0], load=load, model=rod).disk_positions
        exact = (bent + slope * (stations - x)) / bending
        assert np.abs(found[:, 1] / exact - 1).max() < 1e-6


def test_a_robot_may_end_at_its_last_loaded_disk() -> None:
    light = {
        "segments.0.disks.mass": "0 g",
        "segments.0.backbone.density": "0 kg/m^3",
        "segments.0.disks.clamped_length": "2 mm",
    }
    whole = ROBOT.with_(light)
    length = f"{float(whole.disks.station_m[4])!r} m"
    cut = whole.with_({"segments.0.length": length, "segments.0.disks.count": 5})
    assert np.allclose(cut.disks.station_m, whole.disks.station_m[:5], rtol=0, atol=1e-12)
    force, moment = [8.0, -3.0, -5.0], [0.4, 0.6, 0.1]
    rod = bs.RodModel(elements=4)
    load = bs.Load(disk_forces=only(5, force), disk_moments=only(5, moment))
    long = bs.solve(whole, [0, 0, 0], load=load, model=rod)
    tip = bs.Load(tip_force=force, tip_moment=moment)
    short = bs.solve(cut, [0, 0, 0], load=tip, model=rod)
    assert long.converged and short.converged
    assert long.stable is short.stable is None and "a dead moment has no" in long.message
    assert np.abs(long.disk_positions[:5] - short.disk_positions).max() < 1e-9
    assert np.linalg.norm(short.tip.position[:2]) > 0.1


def test_rows_equal_single_solves() -> None:
    rng = np.random.default_rng(1)
    tensions = rng.uniform(0, 40, (12, 3))
    forces, moments = rng.uniform(-0.3, 0.3, (12, 9, 3)), rng.uniform(-0.03, 0.03, (12, 9, 3))
    for each in ({"disk_forces": forces}, {"disk_forces": forces, "disk_moments": moments}):
        load = bs.Load(tensions, gravity=UP, **each)
        for found in (
            bs.sweep(ROBOT, load=load),
            bs.sweep(ROBOT, load=load, warm=False),
            bs.solve_batch(ROBOT, load=load, threads=2),
        ):
            for i in range(12):
                row = bs.Load(tensions[i], gravity=UP, **{k: v[i] for k, v in each.items()})
                alone = bs.solve(ROBOT, load=row)
                assert np.abs(alone.disk_positions - found.disk_positions[i]).max() < 1e-9
    same = bs.solve_batch(ROBOT, load=bs.Load(tensions, disk_forces=FORCES))
    alone = bs.solve(ROBOT, load=bs.Load(tensions[7], disk_forces=FORCES))
    assert np.abs(alone.disk_positions - same.disk_positions[7]).max() < 1e-9
    designs = Designs(ROBOT, {"segments.*.backbone.E": [35e9, 40e9]})
    found = sweep_designs(designs, tensions[:3], load=bs.Load(**BOTH))
    alone = bs.solve(ROBOT, load=bs.Load(tensions[2], **BOTH))
    assert np.abs(alone.tip.position - found.tip_position[0, 2]).max() < 1e-9


@pytest.mark.parametrize("moments", [False, True])
def test_displacement_control(moments: bool) -> None:
    dead = BOTH if moments else {"disk_forces": FORCES}
    commanded = bs.Load(displacements=[0.03, -0.02, -0.012], gravity=UP, **dead)
    found = bs.solve(ROBOT, load=commanded)
    assert found.converged and found.stable is (None if moments else True)
    by_tensions = bs.Load(found.tensions, gravity=UP, **dead)
    again = bs.solve(ROBOT, load=by_tensions, model=found.model)
    assert np.abs(found.disk_positions - again.disk_positions).max() < 1e-8
    free = bs.solve(ROBOT, load=commanded.replace(disk_forces=None, disk_moments=None))
    assert np.abs(found.tip.position - free.tip.position).max() > 1e-3
    rows = bs.Load(displacements=np.tile(commanded.displacements, (2, 1)), gravity=UP, **dead)
    for some in (bs.sweep(ROBOT, load=rows), bs.solve_batch(ROBOT, load=rows)):
        assert np.abs(some.disk_positions[1] - found.disk_positions).max() < 1e-8


def test_a_history_keeps_the_loads() -> None:
    first = bs.solve(LAW, load=bs.Load(TENSIONS, **BOTH)).raise_for_status()
    history = json.loads(json.dumps(first.history()))
    assert np.array_equal(history["disk_forces_N"], FORCES)
    assert np.array_equal(history["disk_moments_Nm"], MOMENTS)
    same = bs.solve(LAW, load=bs.Load(TENSIONS, **BOTH), history=history)
    assert np.abs(same.disk_positions - first.disk_positions).max() < 1e-8
    # those of earlier versions have no loads on disks
    bare = bs.solve(LAW, TENSIONS).history()
    assert bare is not None and bare["disk_forces_N"] == []
    old = {name: value for name, value in bare.items() if not name.startswith("disk_")}
    assert bs.solve(LAW, TENSIONS, history=old).converged
    damaged = {**history, "disk_forces_N": [[1.0, 0.0, 0.0]]}
    with pytest.raises(InputError, match="dead force has 1 entries"):
        bs.solve(LAW, TENSIONS, history=damaged)


def test_a_solution_keeps_its_load() -> None:
    solution = bs.solve(ROBOT, load=bs.Load(TENSIONS, gravity=UP, **BOTH))
    assert np.array_equal(solution.load.disk_forces, FORCES)
    assert np.array_equal(solution.load.disk_moments, MOMENTS)
    assert bs.solve(ROBOT, TENSIONS).load.disk_forces is None
    copied = pickle.loads(pickle.dumps(solution))
    assert np.array_equal(copied.disk_positions, solution.disk_positions)
    data = solution.to_dataset()
    assert json.loads(data.attrs["settings"])["disk_forces"] == FORCES.tolist()
    # the internal force jumps by the force on the disk: statics of its two sides
    force = np.einsum("pij,pj->pi", data["rotation"][0], data["force"][0])
    by_module = force.reshape(9, -1, 3)
    light = ROBOT.with_({"segments.0.disks.mass": "0 g", "segments.0.backbone.density": "0"})
    data = bs.solve(light, [0, 0, 0], load=bs.Load(disk_forces=FORCES)).to_dataset()
    force = np.einsum("pij,pj->pi", data["rotation"][0], data["force"][0])
    by_module = force.reshape(9, -1, 3)
    beyond = np.cumsum(FORCES[::-1], axis=0)[::-1]
    assert np.abs(by_module - beyond[:, None]).max() < 1e-6


def test_derivatives_under_loads_on_disks() -> None:
    load = bs.Load([40.0, 5.0, 10.0], gravity=UP, tip_force=[0.1, 0, 0], **BOTH)
    rod = bs.RodModel(elements=1)
    by = bs.jacobians(bs.solve(ROBOT, load=load, model=rod))
    h = 1e-4
    for q in range(3):
        for name, columns in (
            ("tip_force", by.tip_position_by_tip_force),
            ("tensions", by.tip_position_by_tension),
        ):
            change = h * np.eye(3)[q]
            given = np.array(getattr(load, name))
            up, down = (
                bs.solve(ROBOT, load=load.replace(**{name: given + s}), model=rod).tip.position
                for s in (change, -change)
            )
            exact = (up - down) / (2 * h)
            assert np.abs(columns[:, q] - exact).max() < 1e-6 * np.linalg.norm(exact)


def test_a_motion_ends_in_the_equilibrium() -> None:
    exact = bs.solve(ROBOT, load=bs.Load(TENSIONS, **BOTH), model=bs.RodModel(elements=1))
    damped = bs.Integrator(mass_damping=15.0)
    raised = {name: ramp(value, 0.2) for name, value in BOTH.items()}
    table = Table([0.0, 0.2], np.stack([0 * FORCES, FORCES]))
    for dead in (
        raised,
        {"disk_forces": table, "disk_moments": lambda t: min(t / 0.2, 1.0) * MOMENTS},
    ):
        run = bs.simulate(
            ROBOT,
            ramp(TENSIONS, 0.2),
            4.0,
            load=bs.Load(**dead),
            integrator=damped,
            output=bs.Output(every=0.1, points=0),
        ).raise_for_status()
        assert np.linalg.norm(run.tip_position[-1] - exact.tip.position) < 1e-4
        assert np.linalg.norm(run.tip_position[1] - exact.tip.position) > 0.02
    # at rest from the start, with constant loads or those of the start
    still = bs.simulate(ROBOT, TENSIONS, 0.2, load=bs.Load(**BOTH))
    assert np.ptp(still.tip_position, axis=0).max() < 1e-7
    assert np.abs(still.tip_position[0] - exact.tip.position).max() < 1e-6
    released = bs.simulate(ROBOT, TENSIONS, 0.2, start=bs.Start(bs.Load(**BOTH)))
    assert np.abs(released.tip_position[0] - exact.tip.position).max() < 1e-6
    assert np.ptp(released.tip_position, axis=0).max() > 0.01
    assert released.settings["initial_load_disk_forces_N"] == FORCES.ravel().tolist()


@pytest.mark.filterwarnings("ignore::bowstring.errors.StabilityWarning")
def test_a_motion_under_displacement_control() -> None:
    load = bs.Load(displacements=[0.03, -0.03, -0.012], **BOTH)
    exact = bs.solve(ROBOT, load=load, model=bs.RodModel(elements=1))
    run = bs.simulate(ROBOT, duration=0.1, load=load)
    assert np.abs(run.tip_position - exact.tip.position).max() < 1e-5


def test_modes_under_forces_on_disks() -> None:
    tip = modes(ROBOT, TENSIONS, load=bs.Load(tip_force=[0, 0, -2.0]))
    disk = modes(ROBOT, TENSIONS, load=bs.Load(disk_forces=only(9, [0, 0, -2.0])))
    assert np.abs(disk.frequency_hz / tip.frequency_hz - 1).max() < 1e-9
    low = modes(ROBOT, TENSIONS, load=bs.Load(disk_forces=only(4, [0, 0, -2.0])))
    assert low.frequency_hz[0] > 1.02 * tip.frequency_hz[0]
    with pytest.raises(InputError, match="disk_moments has no modes"):
        modes(ROBOT, TENSIONS, load=bs.Load(disk_moments=MOMENTS))
    with pytest.raises(InputError, match="a moment leaves none"):
        damping = bs.Integrator(modal_damping=0.01)
        bs.simulate(ROBOT, TENSIONS, 0.1, load=bs.Load(disk_moments=MOMENTS), integrator=damping)


@pytest.mark.parametrize(
    ("value", "says"),
    [
        (FORCES[:4], r"shape \(4, 3\), it must have \(9, 3\)"),
        ([1.0, 2.0, 3.0], r"shape \(3,\), it must have \(9, 3\)"),
        ("x", "'x', it must be numbers of shape"),
        ({4: [0, 1, 0]}, "it must be numbers of shape"),
        (np.ones((9, 3), bool), "it must be numbers of shape"),
        ([[0.0, 0.0, 0.0]] * 8 + [[1.0]], "it must be numbers of shape"),
        (only(3, [0.0, np.nan, 0.0]), r"dead force of disk 3 is \[0\.0, [nN]a[nN], 0\.0\] N"),
    ],
)
def test_bad_loads_are_refused(value: Any, says: str) -> None:
    load = bs.Load(TENSIONS, disk_forces=value)
    with pytest.raises(InputError, match=says):
        bs.solve(ROBOT, load=load)
    with pytest.raises(InputError, match=says):
        bs.simulate(ROBOT, duration=0.1, load=load)
    rows = bs.Load([TENSIONS] * 2, disk_forces=value)
    with pytest.raises(InputError, match=says.replace(r"\(9, 3\)", r"\(9, 3\) or \(2, 9, 3\)")):
        bs.sweep(ROBOT, load=rows)


def test_bad_loads_over_time_are_refused() -> None:
    for value, says in (
        (ramp([1.0, 2.0], 0.1), "has 2 columns, it must have 27"),
        (lambda t: [1.0, 2.0], r"shape \(2,\) at 0 s, it must be \(9, 3\)"),
        (lambda t: FORCES * np.nan, "disk_forces"),
        (lambda t: "x", r"it must be numbers of shape \(9, 3\)"),
    ):
        with pytest.raises(InputError, match=says):
            bs.simulate(ROBOT, TENSIONS, 0.1, load=bs.Load(disk_forces=value))
    with pytest.raises(InputError, match=r"shape \(2, 3\), it must have \(9, 3\)"):
        start = bs.Start(bs.Load(disk_moments=FORCES[:2]))
        bs.simulate(ROBOT, TENSIONS, 0.1, start=start)


def test_loads_that_are_not_taken_are_refused() -> None:
    load = bs.Load(disk_forces=FORCES)
    with pytest.raises(InputError, match="a map takes gravity and tip force only"):
        bs.validity_map(ROBOT, load=load)
    with pytest.raises(InputError, match="a map takes gravity and tip force only"):
        bs.validity_grid(ROBOT, ["tension=0:80 N:3", "E=30:40 GPa:3"], load=load)
    with pytest.raises(InputError, match="tensions, gravity and a tip force only"):
        fem.sweep(ROBOT, [TENSIONS], load=load)
    designs = Designs(ROBOT, {"segments.*.backbone.E": [35e9]})
    with pytest.raises(InputError, match=r"shape \(1, 9, 3\), it must have \(9, 3\)"):
        sweep_designs(designs, [TENSIONS], load=bs.Load(disk_forces=FORCES[None]))


def test_flags_of_solve(shell: Shell) -> None:
    forces = ["--disk-force", "4:0,1,0.2", "--disk-force", "7:-500 mN,0,0"]
    both = [*forces, "--disk-moment", "3:0.02,0,50 N*mm"]
    out = shell.json("solve", "amouri2019", "--tension", "40,0,10", *both)
    exact = bs.solve(ROBOT, load=bs.Load(TENSIONS, **BOTH))
    assert np.allclose(out["tip"]["position_m"], exact.tip.position, rtol=0, atol=1e-12)
    settings = out["provenance"]["settings"]
    assert settings["disk_forces_N"] == FORCES.tolist()
    code, text, _ = shell("solve", "amouri2019", "--tension", "40,0,10", *forces)
    assert code == 0 and "A stable equilibrium" in text


def test_flags_of_simulate_and_modes(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "run.nc"
    run = ["simulate", "amouri2019", "--tension", "40,0,10", "--from", "40,0,10", "--rise", "0"]
    run += ["--hold", "0.05", "--disk-force", "4:0,1,0.2", "--disk-force", "7:-0.5,0,0"]
    out = shell.json(*run, "--disk-moment", "3:0.02,0,0.05", "--out", str(file))
    exact = bs.solve(ROBOT, load=bs.Load(TENSIONS, **BOTH), model=bs.RodModel(elements=1))
    tips = np.array(out["tip_position_m"])
    assert np.abs(tips - exact.tip.position).max() < 1e-6
    found = shell.json("modes", "amouri2019", "--disk-force", "4:0,0,-2", "--count", "2")
    load = bs.Load(disk_forces=only(4, [0, 0, -2.0]))
    frequency = modes(ROBOT, load=load, count=2).frequency_hz
    assert np.allclose([mode["frequency_hz"] for mode in found["modes"]], frequency)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("0,1,0", "must be a disk of amouri2019 from 1 to 9"),
        ("0:0,1,0", "must be a disk of amouri2019 from 1 to 9"),
        ("10:0,1,0", 'got "10:0,1,0"'),
        ("1.5:0,1,0", "must be a disk"),
        (f"{'9' * 5000}:0,1,0", "must be a disk"),
        ("4:0,1", "got 2 numbers; write x, y and z"),
        ("4:0,1,x", 'got "x", which is not a number'),
        ("4:0,1,1 m", "1 m"),
        ("4:0,1,0;4:1,0,0", "disk 4 is there twice"),
    ],
)
@pytest.mark.parametrize("flag", ["--disk-force", "--disk-moment"])
def test_bad_flags(shell: Shell, text: str, says: str, flag: str) -> None:
    given = [part for one in text.split(";") for part in (flag, one)]
    for command in (["solve"], ["simulate", "--rise", "0.1", "--hold", "0"]):
        error = shell.error(*command, "amouri2019", "--tension", "1,0,0", *given)
        assert error.startswith(flag) and says in error
