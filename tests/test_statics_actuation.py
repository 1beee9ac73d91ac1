"""Actuation by displacements, motor angles and tensions, with slack, elasticity and friction."""

import copy
import json
import pickle
from types import SimpleNamespace

import numpy as np
import pytest

import bowstring as bs
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import with_tendons
from bowstring.statics import messages
from objects import objects, refused

TENDONS = "segments.0.tendons."


@pytest.fixture(scope="module")
def elastic(robot):
    """Tendons as of steel wire, with a small pretension."""
    wire = {"axial_stiffness": 20e3, "free_length": 0.3, "compliance": 1e-5}
    return with_tendons(robot, {**wire, "pretension": 2.0, "spool_radius": 0.01})


@pytest.fixture(scope="module")
def with_friction(robot):
    return robot.with_({TENDONS + "friction": 0.1})


def tip(solution):
    return solution.raise_for_status().tip.position


def bends(solution, i):
    """Angles of a tendon at its holes, from the poses of the disks alone."""
    hole = np.array([*solution.robot.tendons.hole_m[i], 0.0])
    places = np.vstack((hole, solution.disk_positions + solution.disk_rotations @ hole))
    spans = np.diff(places, axis=0)
    spans = np.vstack(([0, 0, 1], spans / np.linalg.norm(spans, axis=1)[:, None]))
    sines = np.linalg.norm(np.cross(spans[:-1], spans[1:]), axis=1)
    return np.arctan2(sines, np.einsum("ij,ij->i", spans[:-1], spans[1:]))


# --- displacements -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["robot", "rao", "elastic"])
def test_tensions_to_displacements_and_back(name, request):
    robot = request.getfixturevalue(name)
    draw = np.random.default_rng(1)
    most = 4.0 if name == "rao" else 60.0
    for _ in range(20):
        tensions = draw.uniform(1.0, most, robot.core.tendon_count)
        load = {"gravity": (0, 1, -3), "tip_force": (*draw.uniform(-0.1, 0.1, 2), 0)}
        # the same elements in both: otherwise they differ by the discretisation error
        given = bs.solve(robot, tensions, **objects(**load, elements=1)).raise_for_status()
        found = bs.solve(
            robot, **objects(**load, displacements=given.displacements(), elements=1)
        ).raise_for_status()
        assert np.abs(found.tensions - tensions).max() < 1e-8 * tensions.max()
        assert np.abs(tip(found) - tip(given)).max() < 1e-10 * robot.length
        assert found.slack == () and not found.slack_lengths.any()
        assert found.stable is True and found.undetermined is False
        assert found.length_residual < 1e-12
        np.testing.assert_allclose(found.displacements(), given.displacements(), rtol=0, atol=1e-12)
        np.testing.assert_allclose(found.tendon_lengths, given.tendon_lengths, rtol=0, atol=1e-10)


def test_displacement_of_an_inextensible_tendon_is_its_shortening(robot):
    found = bs.solve(robot, [80, 3, 0])
    np.testing.assert_allclose(
        found.displacements(), 0.641 - found.tendon_lengths, rtol=0, atol=1e-15
    )


def test_displacement_of_an_elastic_tendon_includes_its_elongation(elastic):
    """Hooke: elongation of tendon and transmission, from the pretension on."""
    home = bs.solve(elastic, [2, 2, 2])
    assert np.abs(home.displacements()).max() < 1e-15
    found = bs.solve(elastic, load=bs.Load(displacements=[0.02, -0.005, -0.005]))
    give = 1e-5 + (0.3 + 0.641) / 2e4
    expected = home.tendon_lengths - found.tendon_lengths + give * (found.tensions - 2.0)
    taut = found.tensions > 0
    assert taut[0]
    np.testing.assert_allclose(found.displacements()[taut], expected[taut], rtol=0, atol=1e-12)


def test_elastic_tendons_converge_to_inextensible_ones(robot):
    displacements = [0.02, -0.03, -0.03]
    load = bs.Load(displacements=displacements)
    limit = tip(bs.solve(robot, load=load))
    wires = [robot.with_({TENDONS + "axial_stiffness": k}) for k in (1e5, 1e6, 1e7)]
    errors = [np.linalg.norm(tip(bs.solve(wire, load=load)) - limit) for wire in wires]
    assert errors[0] / errors[1] == pytest.approx(10, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(10, rel=0.05)


@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
def test_lengthened_tendons_are_slack(robot, theory):
    found = bs.solve(
        robot, load=bs.Load(displacements=[0.02, -0.03, -0.03]), model=bs.RodModel(theory)
    ).raise_for_status()
    assert found.slack == (2, 3)
    assert found.tensions[0] > 1 and (found.tensions[1:] == 0).all()
    surplus = 0.641 + 0.03 - found.tendon_lengths[1:]
    np.testing.assert_allclose(found.slack_lengths, [0, *surplus], rtol=0, atol=1e-12)
    assert found.slack_lengths[0] == 0 and "Tendons 2 and 3 are slack." in found.message
    straight = bs.solve(robot, load=bs.Load(displacements=[-0.01] * 3), model=bs.RodModel(theory))
    assert straight.slack == (1, 2, 3) and (straight.tensions == 0).all()
    np.testing.assert_allclose(straight.slack_lengths, 0.01, rtol=0, atol=1e-12)


def test_tendons_are_not_slack_at_home(robot, elastic):
    for each in (robot, elastic):
        found = bs.solve(each, load=bs.Load(displacements=[0, 0, 0])).raise_for_status()
        assert found.slack == ()
        np.testing.assert_allclose(found.tensions, each.tendons.pretension_N, rtol=0, atol=1e-7)


def test_motor_angles_wind_spools(elastic):
    by_angle = bs.solve(elastic, tensions=[None, None, 3.0], load=bs.Load(angles=[2.0, -0.5, None]))
    by_displacement = bs.solve(
        elastic, tensions=[np.nan, np.nan, 3.0], load=bs.Load(displacements=[0.02, -0.005, np.nan])
    )
    np.testing.assert_array_equal(tip(by_angle), tip(by_displacement))
    assert by_angle.tensions[2] == 3.0
    assert by_angle.displacements()[0] == pytest.approx(0.02, abs=1e-15)


def test_three_tendons_of_an_inextensible_backbone(robot):
    """The tensions of the pose are not unique; the smallest are returned, and it is reported."""
    thin = bs.RodModel("kirchhoff")
    given = bs.solve(robot, [30, 20, 20], model=thin)
    held = bs.Load(displacements=given.displacements())
    found = bs.solve(robot, load=held, model=thin).raise_for_status()
    assert np.abs(tip(found) - tip(given)).max() < 1e-9 * robot.length
    assert np.linalg.norm(found.tensions) < np.linalg.norm(given.tensions)
    home = bs.Load(displacements=[0, 0, 0])
    every = bs.solve(robot, load=home, model=thin).raise_for_status()
    assert every.undetermined and every.tensions.max() < 1e-3
    assert "do not determine the tensions" in every.message


def test_two_segments(rao):
    """A published code's tip, then values of an independent solution; by tensions, and by the
    displacements that result."""
    for tensions, mm, within in (
        ([4, 0, 0, 0, 2, 0], (129.370, 145.940, 334.202), 0.15),
        ([0, 0, 0, 3, 0, 0], (0, 211.15, 312.10), 0.021),
        ([8, 0, 0, 0, 0, 0], (0, 328.88, 116.72), 0.021),
    ):
        plain, given = (bs.solve(rao, tensions, model=bs.RodModel(elements=e)) for e in (None, 8))
        assert np.linalg.norm(1e3 * tip(plain) - mm) < within
        assert np.linalg.norm(tip(plain) - tip(given)) < 1e-5
        held = given.displacements() - 0.001 * (np.array(tensions) == 0)  # others slack
        found = bs.solve(rao, load=bs.Load(displacements=held), model=given.model)
        assert np.linalg.norm(tip(found) - tip(given)) < 1e-10
        assert found.slack == tuple(np.flatnonzero(np.array(tensions) == 0) + 1)


@pytest.mark.parametrize("friction", [0.0, 0.1])
def test_opposing_tendons_are_named_without_an_equilibrium(robot, friction):
    robot = robot.with_({"segments.0.tendons.friction": friction})
    conflicting, thin = bs.Load(displacements=[0.03] * 3), bs.RodModel("kirchhoff")
    found = bs.solve(robot, load=conflicting, model=thin)
    assert found.status == "no_equilibrium" and not found.converged and found.tip is None
    assert "tendons 1, 2 and 3 have conflicting displacements" in found.message
    assert found.message.endswith("The nearest that have one are 0, 0, 0 mm.")
    assert found.displacements() is None and found.slack is None and found.history() is None
    assert found.slack_lengths is None and found.span_tensions is None
    assert found.to_dict()["tensions_N"] == [None] * 3
    with pytest.raises(NoSolutionError, match="have conflicting displacements"):
        found.raise_for_status()
    path = bs.Load(displacements=[[0, 0, 0], [0.03] * 3, [0.01, -0.01, -0.01]])
    rows = bs.sweep(robot, load=path, model=thin)
    assert rows.status == ["converged", "no_equilibrium", "converged"]
    assert "have conflicting displacements" in rows.message(1)
    assert np.isnan(rows.tensions[1]).all() and np.isnan(rows.slack_lengths[1]).all()


# --- sweeps --------------------------------------------------------------------------------


def test_sweep_matches_single_solves(rao):
    draw = np.random.default_rng(2)
    displacements = draw.uniform(-1, 1, (20, 2)) @ rao.tendons.hole_m.T - draw.uniform(
        0, 0.002, (20, 6)
    )
    load = bs.Load(displacements=displacements)
    path = bs.sweep(rao, load=load).raise_for_status()
    alone = bs.solve_batch(rao, load=load).raise_for_status()
    one = bs.solve_batch(rao, threads=1, disks=False, load=load)
    cold = bs.sweep(rao, warm=False, load=load)
    assert one.disk_positions is None
    np.testing.assert_array_equal(one.tip_position, alone.tip_position)
    np.testing.assert_array_equal(cold.tip_position, alone.tip_position)
    for i, row in enumerate(displacements):
        found = bs.solve(rao, load=bs.Load(displacements=row))
        assert np.abs(tip(found) - path.tip_position[i]).max() < 1e-9
        # many rows are solved side by side
        assert np.abs(tip(found) - alone.tip_position[i]).max() < 1e-12
        np.testing.assert_allclose(found.tensions, alone.tensions[i], rtol=1e-10)
        np.testing.assert_allclose(found.slack_lengths, alone.slack_lengths[i], atol=1e-13)
        np.testing.assert_allclose(found.span_tensions, alone.span_tensions[i], rtol=1e-10)
        np.testing.assert_allclose(found.disk_rotations, alone.disk_rotations[i], atol=1e-11)
        np.testing.assert_array_equal(alone.displacements()[i], row)
    assert (alone.tensions * alone.slack_lengths == 0).all()
    assert alone.history() is None and path.history()["robot_hash"] == rao.hash


def test_sweep_by_tensions_reports_displacements(elastic):
    tensions = np.outer(np.linspace(0, 40, 5), [1, 0, 0]) + 1.0
    rows = bs.sweep(elastic, tensions)
    assert rows.path is None and rows.history() is None and not rows.undetermined.any()
    for i in range(5):
        found = bs.solve(elastic, tensions[i])
        assert np.abs(rows.displacements()[i] - found.displacements()).max() < 1e-10
        np.testing.assert_array_equal(rows.span_tensions[i], found.span_tensions)
    assert not rows.slack_lengths.any()


def test_actuation_changes_from_row_to_row(robot):
    nan = np.nan
    load = bs.Load(
        [[5, 0, 0], [nan, 0, 0], [5, 0, 0]],
        displacements=[[nan, nan, nan], [0.01, nan, nan], [nan, nan, nan]],
        tip_force=[[0, 0, 0], [0, 0.1, 0], [0, 0, 0]],
    )
    rows = bs.sweep(robot, load=load).raise_for_status()
    assert rows.displacements()[1, 0] == 0.01 and rows.tensions[1, 0] > 5
    np.testing.assert_allclose(rows.tip_position[0], rows.tip_position[2], atol=1e-12)


# --- friction and paths --------------------------------------------------------------------


def test_tensions_with_friction_follow_the_capstan_equation(with_friction):
    found = bs.solve(with_friction, [40, 0, 0]).raise_for_status()
    expected = 40 * np.exp(-0.1 * np.cumsum(bends(found, 0)))
    np.testing.assert_allclose(found.span_tensions[:, 0], expected, rtol=1e-11)
    assert found.stable is None and "friction has no potential" in found.message
    free = with_friction.with_({TENDONS + "friction": 0})
    assert abs(tip(found) - tip(bs.solve(free, [40, 0, 0])))[0] > 1e-3


def test_displacement_hysteresis_continues_through_json(with_friction):
    up = np.linspace(0, 0.02, 11)
    path = np.outer(np.concatenate((up, up[-2::-1])), [1, -0.55, -0.55]) - [0, 0.001, 0.001]
    rows = bs.sweep(with_friction, load=bs.Load(displacements=path)).raise_for_status()
    np.testing.assert_array_equal(rows.displacements(), path)
    assert (rows.tensions * rows.slack_lengths == 0).all()
    assert rows.tensions[5, 0] > rows.tensions[15, 0] + 0.5  # loading, unloading
    history = None
    for i, row in enumerate(path):
        found = bs.solve(with_friction, history=history, load=bs.Load(displacements=row))
        assert np.abs(tip(found) - rows.tip_position[i]).max() < 1e-12
        np.testing.assert_allclose(found.tensions, rows.tensions[i], rtol=0, atol=1e-8)
        history = json.loads(json.dumps(found.history(), allow_nan=False))
    whole = rows.history()
    # a history has no path with other elements beside it, and states larger errors
    stated = {"tip_error_m", "tension_error_N"}
    assert whole.keys() == history.keys() and stated < whole.keys()
    for name in whole.keys() - stated:
        if name in ("tensions_N", "log_tension_drops", "arcs_rad"):
            np.testing.assert_allclose(history[name], whole[name], rtol=0, atol=1e-12)
        else:
            assert history[name] == whole[name]
    for i in (5, 15):
        ratio = rows.span_tensions[i, 1:, 0] / rows.span_tensions[i, :-1, 0]
        assert (ratio < 1).all() if i == 5 else (ratio > 1).any()


def test_zero_friction_equals_no_friction(robot):
    given = [[20, 3, 1], [5, 8, 1]]
    plain = bs.sweep(robot, given)
    history = bs.solve(robot, [0, 0, 0]).history()
    path = bs.sweep(robot, given, history=history).raise_for_status()
    np.testing.assert_allclose(path.tip_position, plain.tip_position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(path.displacements(), plain.displacements(), rtol=0, atol=1e-12)
    assert path.stable == [True, True]


def test_history_of_a_solve_without_friction(robot):
    history = bs.solve(robot, [20, 3, 1], load=bs.Load(tip_force=(0, 0.1, 0))).history()
    assert history["schema_version"] == 1 and history["robot_hash"] == robot.hash
    assert history["tensions_N"] == [20, 3, 1] and history["tip_force_N"] == [0, 0.1, 0]
    continuous = bs.RodModel(tendon_path="continuous")
    assert bs.solve(robot, [20, 3, 1], model=continuous).history() is None


# --- queries of a solution -----------------------------------------------------------------


def test_span_tensions_beyond_the_tendon_are_nan(rao):
    for found in (
        bs.solve(rao, [1, 0, 0, 2, 0, 0]),
        bs.solve(rao, load=bs.Load(displacements=[0.002, *[-0.004] * 5])),
    ):
        spans = found.span_tensions
        assert spans.shape == (20, 6)
        assert np.isnan(spans[10:, :3]).all() and np.isfinite(spans[:, 3:]).all()
        np.testing.assert_array_equal(spans[:10, 0], found.tensions[0])


def test_shape_and_copies_of_an_actuated_robot(with_friction, robot):
    before = bs.solve(with_friction, [40, 0, 0]).history()
    for found in (
        bs.solve(robot, load=bs.Load(displacements=[0.02, -0.03, -0.03])),
        bs.solve(with_friction, [20, 0, 0], history=before),
    ):
        line = found.centerline(4)
        np.testing.assert_allclose(line[-1], tip(found), rtol=0, atol=1e-14)
        np.testing.assert_allclose(line[4::4], found.disk_positions, rtol=0, atol=1e-14)
        for other in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
            np.testing.assert_array_equal(tip(other), tip(found))
            np.testing.assert_array_equal(other.tensions, found.tensions)
        content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
        assert content["displacements_m"] == found.displacements().tolist()
        assert content["slack"] == list(found.slack)
    assert pickle.loads(pickle.dumps(bs.sweep(robot, [[80, 0, 0]]))).converged.all()


def test_displacement_jacobian_of_other_transmissions(robot):
    mixed = bs.displacement_jacobian(
        bs.solve(robot, [None, 3, 3], load=bs.Load(displacements=[0.02, None, None]))
    )
    assert np.isnan(mixed.tip_position_by_displacement[:, 1:]).all()
    assert np.isfinite(mixed.tip_position_by_displacement[:, 0]).all()
    alone = bs.solve(robot, [20, 5, 3])
    same = bs.solve(robot, load=bs.Load(displacements=alone.displacements()))
    np.testing.assert_allclose(
        bs.displacement_jacobian(alone).tip_position_by_displacement,
        bs.displacement_jacobian(same).tip_position_by_displacement,
        rtol=1e-6,
    )
    with pytest.raises(InputError, match="cannot be displaced one by one"):
        bs.displacement_jacobian(bs.solve(robot, [5, 5, 5], model=bs.RodModel("kirchhoff")))


# --- rejected input ------------------------------------------------------------------------


@pytest.mark.parametrize("change", [{}, {"segments.0.tendons.friction": 0.2}])
def test_without_a_command_all_tendons_are_slack(robot, change):
    hanging = robot.with_({"gravity": [3.0, 0.0, -9.0], **change})
    found, slack = bs.solve(hanging), bs.solve(hanging, [0.0, 0.0, 0.0])
    assert found.status == "converged" and found.tip.position[0] > 0.01
    np.testing.assert_array_equal(found.tip.position, slack.tip.position)
    np.testing.assert_array_equal(found.tensions, np.zeros(3))


def test_an_unstable_solve_with_held_tendons_names_them():
    robot = bs.load_robot("examples/small.yaml")
    found = bs.solve(robot, load=bs.Load(displacements=[0.05, 0, 0]))
    assert found.status == "unstable"
    assert found.message.endswith("give slack tendons a negative displacement or tension 0.")
    released = bs.solve(robot, load=bs.Load(displacements=[0.05, -0.05, -0.05]))
    assert released.converged


def test_large_friction_gives_a_warning_without_a_solution():
    def said(friction):
        found = SimpleNamespace(
            status="max_iterations", conflict=((), None), residual=1e-3, iterations=400
        )
        return messages.of_actuation(found, (), friction)

    assert "Check the friction coefficient of 10: " in said(10.0)
    assert "friction" not in said(0.3)


def test_a_pretension_without_a_home_pose(robot):
    tight = robot.with_({TENDONS + "pretension": "100 kN"})
    found = bs.solve(tight, [20, 0, 0]).raise_for_status()
    assert found.displacements() is None and found.to_dict()["displacements_m"] is None
    assert np.isnan(bs.sweep(tight, [[20, 0, 0]]).displacements()).all()
    refused("there is no home pose", lambda: bs.solve(tight, load=bs.Load(displacements=[0, 0, 0])))


def test_the_benchmark_commands_the_displacements_of_its_tension():
    from benchmarks import ours_displacement

    ours_displacement.check()
    tip, tension = ours_displacement.found(1)
    assert tension == pytest.approx(40.0, rel=1e-5)
    assert tip == pytest.approx(ours_displacement.found(8)[0], abs=0.1)  # mm


@pytest.mark.parametrize("elements", [1, 2])
def test_a_solve_that_is_repeated_needs_no_iteration(elements):
    """Its error is estimated all the same, also of a load without a potential."""
    robot = bs.load_robot("amouri2019")
    moment = bs.PointLoad(disk=4, moment=[0.03, 0.01, -0.02])
    load = bs.Load(displacements=[0.0187, -0.0115, -0.0066], point_loads=[moment])
    model = bs.RodModel(elements=elements)
    first = bs.solve(robot, load=load, model=model)
    again = bs.solve(robot, load=load, model=model, history=first.history())
    assert first.converged and again.converged and again.iterations == 0
    assert again.tip.position == pytest.approx(first.tip.position, abs=1e-12)
    assert again.error_estimate.tip == pytest.approx(first.error_estimate.tip, rel=0.2)
