"""Dead forces and moments on disks: the tip, beams, histories and motions."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.dynamics import modes

ROBOT = bs.load_robot("amouri2019")
TENSIONS = [40.0, 0.0, 10.0]
UP = (0, 0, -9.81)
LAW = ROBOT.with_({"segments.0.tendons.friction": 0.1})


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
            # from different starts
            assert np.abs(one.disk_positions - two.disk_positions).max() < 1e-10
    # both add up
    half = bs.Load(tip_force=[0, 0.5, 0], disk_forces=only(9, [0, 0.5, 0]))
    whole = bs.solve(ROBOT, TENSIONS, load=bs.Load(tip_force=[0, 1, 0]))
    off = bs.solve(ROBOT, TENSIONS, load=half).disk_positions - whole.disk_positions
    assert np.abs(off).max() < 1e-10


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


def test_histories_of_earlier_versions_have_no_loads_on_disks() -> None:
    bare = bs.solve(LAW, TENSIONS).history()
    assert bare is not None and bare["disk_forces_N"] == []
    old = {name: value for name, value in bare.items() if not name.startswith("disk_")}
    assert bs.solve(LAW, TENSIONS, history=old).converged


def test_the_internal_force_jumps_by_the_force_on_a_disk() -> None:
    """Statics of its two sides."""
    light = ROBOT.with_({"segments.0.disks.mass": "0 g", "segments.0.backbone.density": "0"})
    data = bs.solve(light, [0, 0, 0], load=bs.Load(disk_forces=FORCES)).to_dataset()
    force = np.einsum("pij,pj->pi", data["rotation"][0], data["force"][0])
    by_module = force.reshape(9, -1, 3)
    beyond = np.cumsum(FORCES[::-1], axis=0)[::-1]
    assert np.abs(by_module - beyond[:, None]).max() < 1e-6


def test_a_start_under_loads_is_released() -> None:
    exact = bs.solve(ROBOT, load=bs.Load(TENSIONS, **BOTH), model=bs.RodModel(elements=1))
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
