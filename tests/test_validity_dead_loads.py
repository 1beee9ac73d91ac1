"""Axes of a map that are loads: payload, tilt of the base, and tip force along a direction."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.data.synthetic import Loads, Mounting, simulate
from bowstring.errors import InputError
from bowstring.validity.axes import axes_of
from bowstring.validity.dead_loads import dead_loads, tilted
from bowstring.validity.loading import Loading
from bowstring.validity.map_settings import space_of

ROBOT = bs.load_robot("amouri2019", {"gravity": "0 0 9.81 m/s^2"})  # hanging
WITHOUT = bs.load_robot("amouri2019")
MODELS = ["cc_from_lengths", "cc_from_force"]


def tips(robot: bs.Robot, over: list[str], points: list[list[float]], load: bs.Load) -> np.ndarray:
    """Tips by statics at the end of a sweep to 40 N, at points of a map."""
    space = space_of(robot, axes_of(robot, over), Loading(40.0, 9), load)
    return space.errors(np.array(points), MODELS).tip[:, -1]


def solved(robot: bs.Robot, load: bs.Load) -> np.ndarray:
    return np.asarray(bs.solve(robot, tensions=[40.0, 0.0, 0.0], load=load).tip.position)


def test_a_payload_is_its_weight_at_the_tip() -> None:
    load = bs.Load(tip_force=[0.0, 0.1, 0.0])
    got = tips(ROBOT, ["payload=0:50 g"], [[0.0], [0.03]], load)
    for mass, tip in zip((0.0, 0.03), got, strict=True):
        weight = [0.0, 0.1, 9.81 * mass]
        assert tip == pytest.approx(solved(ROBOT, bs.Load(tip_force=weight)), abs=1e-7)


def test_a_tilt_turns_the_gravity_and_the_weight_of_a_payload() -> None:
    over = ["payload=0:50 g", "tilt=0:90 deg", "tilt_towards=0:180 deg"]
    tilt, towards = math.radians(30.0), math.radians(70.0)
    (tip,) = tips(ROBOT, over, [[0.02, tilt, towards]], bs.Load())
    # the base leans to `towards`: in its axes gravity, along z before, points away from there
    lean = math.sin(tilt)
    gravity = 9.81 * np.array(
        [-lean * math.cos(towards), -lean * math.sin(towards), math.cos(tilt)]
    )
    load = bs.Load(gravity=gravity, tip_force=0.02 * gravity)
    assert tip == pytest.approx(solved(ROBOT, load), abs=1e-7)


def test_a_tilt_is_that_of_a_synthetic_bench() -> None:
    level = np.array([0.3, -2.0, -9.4])
    tilt, towards = 0.4, 2.0
    bench = simulate(
        WITHOUT,
        Loads(tensions=[[10.0, 0.0, 0.0]]),
        actual=bs.data.synthetic.Actual(gravity=level, gravity_frame="measuring"),
        mounting=Mounting(tilt=tilt, tilt_towards=towards),
    )
    ours = tilted(level[None], np.array([tilt]), np.array([towards]))
    assert ours[0] == pytest.approx(bench.truth["gravity_in_base_m_per_s2"], abs=1e-12)
    assert np.linalg.norm(ours) == pytest.approx(np.linalg.norm(level))


def test_a_tip_force_has_the_direction_of_the_load() -> None:
    load = bs.Load(tip_force=[0.0, 3.0, 4.0])
    (tip,) = tips(WITHOUT, ["tip_force=0:1 N"], [[0.2]], load)
    assert tip == pytest.approx(solved(WITHOUT, bs.Load(tip_force=[0.0, 0.12, 0.16])), abs=1e-7)
    found = bs.validity_map(
        WITHOUT, ["tension=0:40 N:2", "tip_force=0:0.1 N:2"], load=load, loading=Loading(40.0, 3)
    )
    assert found.label(1) == "tip force along (0, 0.6, 0.8) (N)"
    assert found.to_dict()["axes"][1]["label"] == "tip force along (0, 0.6, 0.8)"


def test_components_of_gravity_are_those_before_the_tilt() -> None:
    values = {"gravity.x": np.array([1.0]), "tilt": np.array([np.pi]), "payload": np.array([2.0])}
    vectors = dead_loads(ROBOT, bs.Load(), values, 1)
    assert vectors["gravity"][0] == pytest.approx([-1.0, 0.0, -9.81])
    assert vectors["tip_force"][0] == pytest.approx([-2.0, 0.0, -19.62])
    assert dead_loads(ROBOT, bs.Load(), {}, 1) == {}  # what no axis changes is left alone


@pytest.mark.parametrize(
    ("robot", "over", "load", "message"),
    [
        (WITHOUT, ["payload=0:1 kg"], {}, "axis payload: without gravity it changes nothing"),
        (WITHOUT, ["tilt=0:9 deg"], {}, "axis tilt: without gravity it changes nothing"),
        (ROBOT, ["payload=0:1 kg"], {"gravity": [0, 0, 0]}, "axis payload: without gravity"),
        (ROBOT, ["payload=-1:1 kg"], {}, "axis payload: got a negative mass"),
        (ROBOT, ["tilt=0:90"], {}, "axis tilt: got 0 to 90 without a unit, which is rad"),
        (ROBOT, ["tilt_towards=0:9 deg"], {}, "add an axis tilt"),
        (ROBOT, ["tip_force=0:1 N"], {}, "axis tip_force: it has the direction of the tip force"),
        (
            ROBOT,
            ["tip_force=0:1 N", "tip_force.x=0:1 N"],
            {"tip_force": [1, 0, 0]},
            "over has tip_force and tip_force.x",
        ),
    ],
)
def test_axes_that_change_nothing_are_refused(
    robot: bs.Robot, over: list[str], load: dict[str, Any], message: str
) -> None:
    with pytest.raises(InputError, match=message.split(" (")[0]):
        bs.validity_map(robot, over, load=bs.Load(**load), loading=Loading(10.0, 3))


def test_an_axis_of_gravity_gives_a_payload_its_weight() -> None:
    over = ["payload=0:50 g", "gravity.y=-9:9"]
    (tip,) = tips(WITHOUT, over, [[0.03, 9.0]], bs.Load())
    load = bs.Load(gravity=[0.0, 9.0, 0.0], tip_force=[0.0, 0.27, 0.0])
    assert tip == pytest.approx(solved(WITHOUT, load), abs=1e-7)
