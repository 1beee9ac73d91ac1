"""Sweeps of many robots in one call against one robot at a time."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.errors import InputError
from bowstring.robot.designs import Designs
from bowstring.statics.design_sweeps import sweep_designs

ROBOT = bs.load_robot("amouri2019")
ELASTIC = ROBOT.with_(
    {"segments.0.tendons.axial_stiffness": 3e4, "segments.0.tendons.pretension": 1.0}
)
FRICTION = "segments.*.tendons.friction"
STIFFNESS = "segments.*.tendons.axial_stiffness"
RAMP = np.outer(np.linspace(0.0, 1.0, 9), [1.0, -0.5, -0.5])


def test_displacements_of_each_robot() -> None:
    """Eleven robots are more than the lanes of a register, and not a multiple of them."""
    designs = Designs(ELASTIC, {STIFFNESS: np.geomspace(1e3, 1e6, 11)})
    displacements = np.linspace(0.01, 0.05, 11)[:, None, None] * RAMP
    load = bs.Load(tip_force=(0.0, 0.2, 0.0))
    found = sweep_designs(designs, displacements=displacements, load=load)
    for i in range(len(designs)):
        alone = bs.sweep(designs.robot_at(i), load=load.replace(displacements=displacements[i]))
        np.testing.assert_allclose(found.tip_position[i], alone.tip_position, atol=1e-11)
        np.testing.assert_allclose(found.slack_lengths[i], alone.slack_lengths, atol=1e-12)
        np.testing.assert_allclose(found.tensions[i], alone.tensions, rtol=1e-8, atol=1e-9)
    assert (found.slack_lengths[:, -1] > 0.0).any()


def test_both_kinds_of_command() -> None:
    designs = Designs(ELASTIC, {STIFFNESS: [1e4, 1e5]})
    displacements, tensions = 0.03 * RAMP, np.full(RAMP.shape, np.nan)
    displacements[:, 2], tensions[:, 2] = np.nan, 2.0
    found = sweep_designs(designs, tensions, displacements=displacements)
    load = bs.Load(tensions=tensions, displacements=displacements)
    alone = bs.sweep(designs.robot_at(1), load=load)
    np.testing.assert_allclose(found.tip_position[1], alone.tip_position, atol=1e-11)
    np.testing.assert_allclose(found.tensions[..., 2], 2.0)


def test_threads_do_not_change_the_solutions() -> None:
    designs = Designs(ELASTIC, {FRICTION: np.linspace(0.0, 0.2, 19)})
    one, two = (sweep_designs(designs, displacements=0.03 * RAMP, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.tip_position, two.tip_position)
    designs = Designs(ROBOT, {"segments.0.backbone.E": np.linspace(30e9, 40e9, 30)})
    one, two = (sweep_designs(designs, 80.0 * np.maximum(RAMP, 0.0), threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.tip_position, two.tip_position)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({}, "give one of them"),
        ({"displacements": np.zeros((3, 2))}, r"displacements has shape \(3, 2\)"),
        ({"displacements": np.full((3, 3), 0.7)}, "less than the tendon's length"),
        ({"displacements": np.full((3, 3), np.nan)}, "robot 0, load 0"),
        ({"tensions": np.zeros((2, 3)), "displacements": np.zeros((3, 3))}, "2 and 3 loads"),
        ({"tensions": np.zeros((3, 3)), "displacements": np.zeros((3, 3))}, "NaN in the other"),
        ({"tensions": np.full((3, 3), -1.0)}, "robot 0, load 0"),
    ],
)
def test_wrong_commands_are_refused(arguments: dict[str, np.ndarray], message: str) -> None:
    with pytest.raises(InputError, match=message):
        sweep_designs(Designs(ELASTIC, {FRICTION: [0.0, 0.1]}), **arguments)


def test_loads_that_need_two_elements_agree_with_one_robot_at_a_time() -> None:
    """Soft robots bend so far that one element in a module is too coarse for the last loads."""
    designs = Designs(ROBOT, {"segments.*.backbone.E": np.linspace(12e9, 24e9, 11)})
    tensions = np.outer(np.linspace(0.0, 80.0, 17), [1.0, 0.1, 0.0])
    load = bs.Load(tip_force=(0.0, 0.1, 0.0), gravity=(0.0, 0.0, -9.81))
    found = sweep_designs(designs, tensions, load=load)
    refined = 0
    for i in range(len(designs)):
        robot = designs.robot_at(i)
        alone = bs.sweep(robot, load=load.replace(tensions=tensions))
        np.testing.assert_array_equal(found.converged[i], alone.converged)
        np.testing.assert_allclose(found.tip_position[i], alone.tip_position, atol=1e-10)
        np.testing.assert_allclose(found.tip_error[i], alone.tip_error, rtol=0.02, atol=1e-9)
        coarse = bs.sweep(
            robot, load=load.replace(tensions=tensions), model=bs.RodModel(elements=1)
        )
        refined += int((coarse.tip_error > 1.01 * alone.tip_error).sum())
    assert refined > 50


def test_a_batch_of_loads_that_need_two_elements() -> None:
    soft = ROBOT.with_({"segments.0.backbone.E": 15e9})
    tensions = np.random.default_rng(3).uniform(0.0, [80.0, 20.0, 20.0], (200, 3))
    many = bs.solve_batch(soft, tensions)
    for i in range(0, 200, 7):
        one = bs.solve(soft, tensions[i])
        assert one.converged == many.converged[i]
        np.testing.assert_allclose(many.tip_position[i], one.tip.position, atol=1e-10)
        np.testing.assert_allclose(many.tip_error[i], one.error_estimate.tip, rtol=0.02, atol=1e-9)
    coarse = bs.solve_batch(soft, tensions, model=bs.RodModel(elements=1))
    assert (coarse.tip_error > 1.01 * many.tip_error).sum() > 20
