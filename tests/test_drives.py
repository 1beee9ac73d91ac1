"""Gain and zero of the drives, between commanded displacements and those of the tendons."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.data import synthetic
from bowstring.errors import InputError
from bowstring.robot.designs import Designs
from bowstring.robot.model import with_drives, without_laws
from bowstring.statics.design_sweeps import sweep_designs
from bowstring.study.calibration import calibrate, predicted

GAIN = np.array([1.03, 0.98, 1.01])
ZERO = np.array([3e-4, -2e-4, 1e-4])
PLAIN = bs.load_robot("amouri2019", {"segments.0.tendons.compliance": "0.05 mm/N"})
ROBOT = with_drives(PLAIN, gain=GAIN, zero=ZERO)
COMMANDS = np.array([[2e-3, -1e-3, -1e-3], [6e-3, -2e-3, -4e-3], [1e-3, 5e-3, -6e-3]])
DRIVEN = GAIN * COMMANDS + ZERO


def rows(displacements: np.ndarray) -> bs.Load:
    return bs.Load(displacements=displacements)


def test_a_ring_whose_drives_differ_becomes_a_list() -> None:
    assert ROBOT.tendons.gain.tolist() == GAIN.tolist()
    assert ROBOT.tendons.zero_m.tolist() == ZERO.tolist()
    assert ROBOT.laws == ("gain", "zero") and not ROBOT.has_memory
    assert without_laws(ROBOT).hash == PLAIN.hash
    alike = with_drives(PLAIN, gain=np.full(3, 1.02), zero=np.zeros(3))
    assert alike.segments[0].tendons.gain == 1.02
    assert with_drives(PLAIN, gain=np.ones(3), zero=np.zeros(3)) is PLAIN


def test_tendons_move_by_gain_and_zero() -> None:
    wanted = bs.sweep(PLAIN, load=rows(DRIVEN)).raise_for_status()
    for found in (
        bs.sweep(ROBOT, load=rows(COMMANDS)),
        bs.solve_batch(ROBOT, load=rows(COMMANDS)),
    ):
        np.testing.assert_allclose(found.tip_position, wanted.tip_position, atol=1e-9)
        np.testing.assert_allclose(found.displacements(), DRIVEN, atol=1e-12)
    single = bs.solve(ROBOT, load=rows(COMMANDS[0]))
    np.testing.assert_allclose(single.tip.position, wanted.tip_position[0], atol=1e-9)
    designs = Designs(ROBOT, {"segments.0.tendons.*.zero": [0.0, 1e-4]})
    moved = sweep_designs(designs, displacements=COMMANDS).tip_position[1]
    other = bs.sweep(PLAIN, load=rows(GAIN * COMMANDS + 1e-4)).tip_position
    np.testing.assert_allclose(moved, other, atol=1e-9)


def test_angles_of_a_spool_are_commands() -> None:
    spool = {"segments.0.tendons.spool_radius": "10 mm"}
    robot = with_drives(PLAIN.with_(spool), gain=GAIN, zero=ZERO)
    found = bs.solve(robot, load=bs.Load(angles=COMMANDS[1] / 0.01))
    wanted = bs.solve(PLAIN, load=rows(DRIVEN[1]))
    np.testing.assert_allclose(found.tip.position, wanted.tip.position, atol=1e-9)


def test_solutions_and_linear_models_of_tensions_have_neither() -> None:
    one, other = (bs.solve(robot, [20.0, 0.0, 5.0]).tip.position for robot in (ROBOT, PLAIN))
    assert one.tolist() == other.tolist()
    one, other = (bs.linearise(robot, [20.0, 1.0, 5.0], modes=2) for robot in (ROBOT, PLAIN))
    assert one.frequency_hz.tolist() == other.frequency_hz.tolist()
    assert one.D.tolist() == other.D.tolist()


def test_backlash_is_of_the_tendon() -> None:
    robot = with_drives(PLAIN.with_({"segments.0.tendons.backlash": 2e-4}), gain=GAIN, zero=ZERO)
    found = bs.sweep(robot, load=rows(COMMANDS)).displacements()
    state, wanted = np.zeros(3), []
    for row in DRIVEN:
        state = np.clip(state, row - 2e-4, row + 2e-4)
        wanted.append(state)
    np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize("model", ["constant_curvature", bs.RodModel()])
def test_the_inverse_commands_its_pose(model: bs.RodModel | str) -> None:
    point = bs.solve(PLAIN, [20.0, 0.0, 5.0]).tip.position
    found, plain = (bs.inverse_kinematics(r, point, model=model) for r in (ROBOT, PLAIN))
    commands = found.displacements()
    np.testing.assert_allclose(GAIN * commands + ZERO, plain.displacements(), atol=1e-9)
    if not isinstance(model, str):
        there = found.land(control="displacements").tip_position[0]
        np.testing.assert_allclose(there, point, atol=1e-6)


def test_limits_of_the_inverse_are_of_commands() -> None:
    point = bs.solve(PLAIN, [20.0, 0.0, 5.0]).tip.position
    free = bs.inverse_kinematics(ROBOT, point).displacements()
    most = float(free.max()) - 5e-5
    limits = bs.ActuationLimits(displacement_limits=[-1.0, most])
    found = bs.inverse_kinematics(ROBOT, point, limits=limits)
    assert found.displacements().max() == pytest.approx(most, abs=1e-7)


def test_a_motion_ends_where_its_commands_hold() -> None:
    end = bs.simulate(
        ROBOT,
        duration=0.02,
        load=bs.Load(displacements=COMMANDS[0]),
        start=bs.Start(bs.Load(displacements=COMMANDS[0])),
    )
    wanted = bs.solve(PLAIN, load=rows(DRIVEN[0])).tip.position
    np.testing.assert_allclose(end.tip_position[-1], wanted, atol=1e-6)


def test_a_fit_puts_them_into_the_robot() -> None:
    rng = np.random.default_rng(5)
    given = rng.uniform(-4e-3, 6e-3, (40, 3))
    tips = bs.solve_batch(ROBOT, load=rows(given)).tip_position
    data = Data(points=tips, displacements=given)
    found = fit(PLAIN, data, ["gain.tendons", "offset.tendons"], loss="linear")
    assert found.converged and found.outside_robot == {}
    np.testing.assert_allclose(found.robot.tendons.gain, GAIN, atol=1e-5)
    np.testing.assert_allclose(found.robot.tendons.zero_m, ZERO, atol=1e-7)
    reached = bs.solve_batch(found.robot, load=rows(given)).tip_position
    np.testing.assert_allclose(reached, tips, atol=1e-7)
    np.testing.assert_allclose(found.predict(data), reached, atol=1e-7)
    # a fit of a robot with drives finds what is beside them
    again = fit(ROBOT, data, ["gain", "offset"], loss="linear")
    assert again["gain"].value == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_allclose(again.robot.tendons.gain, GAIN, atol=1e-6)
    np.testing.assert_allclose(again.robot.tendons.zero_m, ZERO, atol=1e-8)


def test_tendons_without_tension_have_no_gain_of_their_own() -> None:
    ramp = np.linspace(0.0, 0.02, 9)
    given = np.column_stack([ramp, np.full((9, 2), np.nan)])
    loose = np.column_stack([np.full(9, np.nan), np.zeros((9, 2))])
    robot = PLAIN.with_({"segments.0.tendons.gain": 1.03})
    load = bs.Load(tensions=loose, displacements=given)
    tips = bs.solve_batch(robot, load=load).tip_position
    data = Data(points=tips, tensions=loose, displacements=given)
    found = fit(PLAIN, data, ["gain"], loss="linear")
    assert found.outside_robot == {}
    np.testing.assert_allclose(found.robot.tendons.gain, 1.03, atol=1e-6)


@pytest.mark.parametrize(("robot", "gain"), [(PLAIN, 1.05), (ROBOT, 1.0)])
def test_a_gain_of_tensions_stays_outside(robot: bs.Robot, gain: float) -> None:
    """And drives are left out of a fit to tensions."""
    tensions = np.random.default_rng(6).uniform(0.0, 30.0, (20, 3))
    tips = bs.solve_batch(robot, gain * tensions).tip_position
    found = fit(robot, Data(points=tips, tensions=tensions), ["gain"], loss="linear")
    assert found["gain"].value == pytest.approx(gain, abs=1e-5)
    assert found.outside_robot.keys() == {"gain"}
    assert found.robot.laws == robot.laws and found.robot.hash == robot.hash


@pytest.mark.parametrize(("factor", "start"), [(-1.0, 1.0), (1e-4, 9000.0)])
def test_a_gain_that_no_robot_file_has_stays_outside(factor: float, start: float) -> None:
    given = np.random.default_rng(5).uniform(-4e-3, 6e-3, (20, 3))
    tips = bs.solve_batch(PLAIN, load=rows(given)).tip_position
    data = Data(points=tips, displacements=factor * given)
    found = fit(PLAIN, data, ["gain"], loss="linear", start={"gain": start})
    assert not 1e-3 <= found["gain"].value <= 1e3
    assert found.outside_robot == {"gain": found["gain"].value}
    assert found.robot.laws == ()


@pytest.mark.parametrize("name", ["segments.0.tendons.0.gain", "segments.*.tendons.*.zero"])
def test_fits_have_one_name_for_each(name: str) -> None:
    data = Data(points=np.zeros((8, 3)), displacements=np.zeros((8, 3)))
    with pytest.raises(InputError, match="there is no parameter"):
        fit(ROBOT, data, [name])


def test_a_study_keeps_a_gain_of_both_kinds_of_commands() -> None:
    count, none = 8, np.nan
    given = np.column_stack([np.linspace(0.0, 8e-3, count), np.full((count, 2), none)])
    held = np.column_stack([np.full(count, none), np.full((count, 2), 3.0)])
    data = synthetic.simulate(
        PLAIN,
        synthetic.Loads(tensions=held, displacements=given),
        actual=synthetic.Actual(changes={"segments.0.tendons.gain": 1.1}),
    )
    data = data.select(np.arange(count))  # loading alone
    found = calibrate(PLAIN, data, "cosserat")
    assert "gain" not in found.fit.drives and found.gain > 1.05
    again = predicted(found.robot, data, "cosserat", found.gain_outside)
    np.testing.assert_allclose(again.tip_position, found.point, atol=1e-6)
