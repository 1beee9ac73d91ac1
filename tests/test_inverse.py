"""Inverse kinematics: tips of forward solves, other optimisers, limits, bad input."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import least_squares, linprog, minimize

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import NoSolutionError
from bowstring.inverse.limits import ActuationLimits as Limits
from bowstring.inverse.limits import default_max_tension
from bowstring.robot.model import with_tendons

ROBOTS = ("amouri2019", "rao2021", "crl-ftdcr-v4")


def forward(robot, count, seed, share=0.5, load=None):
    """Stable equilibria under random tensions: tensions (n, T), tips, and the largest tensions."""
    rng = np.random.default_rng(seed)
    most = share * default_max_tension(robot)
    tensions = rng.uniform(0.0, 1.0, (count, len(most))) * most
    found = bs.solve_batch(robot, tensions, load=load, disks=False)
    good = np.array([stable is True for stable in found.stable])
    assert good.mean() > 0.9
    return tensions[good], found.tip_position[good], most


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize(
    ("count", "seed"), [(400, 11), pytest.param(10_000, 12, marks=pytest.mark.slow)]
)
def test_tips_of_forward_solves_are_reached(name, count, seed):
    robot = bs.load_robot(name)
    tensions, tips, most = forward(robot, count, seed)
    found = bs.inverse_kinematics(robot, tips, limits=Limits(max_tension=most), path=False)
    assert (found.tensions >= 0.0).all() and (found.tensions <= most).all()
    assert found.reached.mean() > 0.999
    reached = found.reached
    assert found.distance[reached].max() < 1e-6 * robot.length
    # the tip of a solve that knows nothing of the inverse
    landed = found.land()
    off = np.linalg.norm(landed.tip_position - tips, axis=1)[reached]
    # it may take other elements, which agree to their estimated error
    assert (off < 1e-6 * robot.length + found.tip_error[reached]).mean() > 0.999
    # never more than what made the tip, as far as it is the same branch
    more = np.linalg.norm(found.tensions, axis=1) / np.linalg.norm(tensions, axis=1)
    assert np.median(more) <= 1.0 + 1e-9
    assert all(found.stable[row] is True for row in np.flatnonzero(reached))


def least_by_slsqp(robot, start, most, kind, of):
    """Least tensions (N) by scipy from a start, and whether it ended well.

    `of` gives what is zero ("eq") or not negative ("ineq"), in m, and its derivative by tensions.

    """
    scale = np.max(most)

    def part(t, which):
        return of(bs.solve(robot, np.clip(t, 0.0, 1.0) * scale))[which] / robot.length

    found = minimize(
        lambda t: 0.5 * t @ t,
        start / scale,
        jac=lambda t: t,
        bounds=[(0.0, m) for m in np.broadcast_to(most, len(start)) / scale],
        constraints={
            "type": kind,
            "fun": lambda t: part(t, 0),
            "jac": lambda t: part(t, 1) * scale,
        },
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 300},
    )
    return found.x * scale, found.success


@pytest.mark.parametrize("name", ["rao2021", "crl-ftdcr-v4"])
def test_tensions_are_the_least(name):
    """SLSQP from the result finds no smaller tensions, and from others no smaller ones near."""
    robot = bs.load_robot(name)
    _, tips, most = forward(robot, 12, 21)
    found = bs.inverse_kinematics(robot, tips, limits=Limits(max_tension=most), path=False)
    for tip, own in zip(tips[found.reached], found.tensions[found.reached], strict=True):

        def away(solved, tip=tip):
            return solved.tip.position - tip, bs.jacobians(solved).tip_position_by_tension

        best, _ = least_by_slsqp(robot, own, most, "eq", away)
        assert np.linalg.norm(best) > np.linalg.norm(own) * (1.0 - 1e-5)
        assert np.abs(best - own).max() < 1e-2 * most.max()


def unit_tension(robot):
    """Tension that bends the robot by one radian by the linear law."""
    arm = max(np.hypot(*hole) for hole in robot.tendons.mean_hole_m[0])
    return min(np.asarray(robot.bending_stiffness)) / (robot.length * arm)


@pytest.mark.parametrize("name", ["rao2021", "crl-ftdcr-v4"])
def test_least_tensions_fulfil_the_conditions_of_optimality(name):
    """Conditions of Karush, Kuhn and Tucker, with derivatives of the forward solver."""
    robot = bs.load_robot(name)
    _, tips, most = forward(robot, 150, 22)
    found = bs.inverse_kinematics(robot, tips, limits=Limits(max_tension=most), path=False)
    unit = unit_tension(robot)
    bound = 0
    for row in np.flatnonzero(found.reached):
        tensions = found.tensions[row]
        by_tension = bs.jacobians(bs.solve(robot, tensions)).tip_position_by_tension
        low, high = tensions == 0.0, tensions == most
        free = ~(low | high)
        if free.sum() <= 3:
            continue
        multipliers = np.linalg.lstsq(by_tension[:, free].T, -tensions[free], rcond=None)[0]
        gradient = (tensions + by_tension.T @ multipliers) / unit
        assert np.abs(gradient[free]).max() < 1e-2
        assert (gradient[low] > -1e-2).all() and (gradient[high] < 1e-2).all()
        bound += low.sum()
    assert bound > 100


def test_unreachable_tips_are_the_nearest(robot):
    """scipy's bounded least squares on forward solves comes no nearer."""
    rng = np.random.default_rng(5)
    for _ in range(12):
        way = rng.normal(size=3)
        target = way / np.linalg.norm(way) * rng.uniform(0.3, 0.6)
        target[2] = abs(target[2])
        found = bs.inverse_kinematics(
            robot, target, limits=Limits(max_tension=80.0), distance_margin=0
        )
        assert found.status == "unreachable"

        def residual(t, target=target):
            return bs.solve(robot, 80.0 * np.clip(t, 0, 1)).tip.position - target

        def jacobian(t):
            return 80.0 * bs.jacobians(bs.solve(robot, 80.0 * t)).tip_position_by_tension

        best = min(
            least_squares(
                residual, start, jacobian, bounds=(0.0, 1.0), x_scale=1.0, xtol=1e-14, ftol=1e-14
            ).cost
            for start in (found.tensions / 80.0 * 0.98 + 0.01, [0.3, 0.3, 0.3], [0.7, 0.2, 0.2],
                          [0.2, 0.7, 0.2], [0.2, 0.2, 0.7])
        )  # fmt: skip
        assert found.distance == found.nearest_distance <= np.sqrt(2.0 * best) * (1.0 + 1e-5)


@pytest.mark.parametrize("name", ["amouri2019", "rao2021"])
def test_unreachable_tips_take_the_least_tensions_within_the_margin(name):
    """scipy finds no smaller tensions whose tip is within the margin of the nearest one."""
    robot = bs.load_robot(name)
    rng = np.random.default_rng(9)
    most = 0.8 * default_max_tension(robot).min()
    limits = Limits(max_tension=most)
    for number in range(6):
        way = rng.normal(size=3)
        way[2] = abs(way[2])
        target = way / np.linalg.norm(way) * rng.uniform(0.85, 0.99) * robot.length
        if name == "amouri2019" and number == 0:
            target = np.array([0.1, 0.02, 0.6])
        found = bs.inverse_kinematics(robot, target, limits=limits)
        nearest = bs.inverse_kinematics(robot, target, limits=limits, distance_margin=0)
        if nearest.status == "reached":
            assert found.distance < 1e-6 * robot.length
            continue
        assert found.status == nearest.status == "unreachable"
        assert found.nearest_distance == nearest.distance
        largest = nearest.distance + 1e-3 * robot.length
        assert found.distance <= largest
        landed = bs.solve(robot, found.tensions).tip.position
        assert np.linalg.norm(landed - target) < largest * (1.0 + 1e-6)
        size = np.linalg.norm(found.tensions)
        assert size < np.linalg.norm(nearest.tensions)

        def room(solved, target=target, largest=largest):
            way = solved.tip.position - target
            distance = np.linalg.norm(way)
            by = bs.jacobians(solved).tip_position_by_tension
            return largest - distance, -(way / distance) @ by

        for start in (found.tensions, nearest.tensions):
            best, good = least_by_slsqp(robot, start, most, "ineq", room)
            if good:
                assert size < np.linalg.norm(best) * (1.0 + 2e-3)
        wide = bs.inverse_kinematics(robot, target, limits=limits, distance_margin="1 %")
        assert np.linalg.norm(wide.tensions) < size
        _, more = found.message().split("with larger tensions within")
        assert " mm, where the " in more or " mm; no limit binds" in more


def test_margin_leaves_reached_tips_alone(robot):
    tip = bs.solve(robot, [90.0, 60.0, 70.0]).tip.position
    found = bs.inverse_kinematics(robot, tip)
    np.testing.assert_allclose(found.tensions, [90.0, 60.0, 70.0], atol=0.1)
    assert found.status == "reached" and found.nearest_distance == found.distance


def test_unreachable_path_is_followed_without_jumps(robot):
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    path = np.stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), np.full_like(angle, 0.58)], axis=-1)
    found = bs.inverse_kinematics(robot, path)
    assert set(found.status) == {"unreachable"} and not found.restarted.any()
    largest = found.nearest_distance + 1e-3 * robot.length
    assert (found.distance <= largest).all()
    assert np.abs(np.diff(found.tensions, axis=0)).max() < 3.0
    # each from its own start
    alone = bs.inverse_kinematics(robot, path[::40], path=False)
    np.testing.assert_allclose(alone.tensions, found.tensions[::40], atol=0.2)
    np.testing.assert_allclose(alone.nearest_distance, found.nearest_distance[::40], atol=1e-7)


def test_limits_that_bind_are_named(robot):
    tip = bs.solve(robot, [60.0, 0.0, 0.0]).tip.position
    limits = Limits(max_tension=30.0)
    found = bs.inverse_kinematics(robot, tip, limits=limits, distance_margin=0)
    assert found.status == "unreachable"
    assert found.tensions[0] == 30.0 and found.binding[0] == 1
    assert "the largest tension of tendon 1 (30 N)" in found.message()
    with pytest.raises(NoSolutionError, match="largest tension of tendon 1"):
        found.raise_for_status()
    # limits bind the nearest tip, whatever the margin permits
    relaxed = bs.inverse_kinematics(robot, tip, limits=limits)
    assert relaxed.tensions[0] < 30.0 and relaxed.binding.tolist() == found.binding.tolist()
    # each tendon has its own limits
    found = bs.inverse_kinematics(robot, tip, limits=Limits([2.0, 3.0, 4.0], 70.0))
    assert (found.tensions >= [2.0, 3.0, 4.0]).all()
    held = bs.inverse_kinematics(robot, tip, limits=Limits([0, 5, 0], [70, 5, 70]))
    assert held.tensions[1] == 5.0


@pytest.mark.parametrize("name", ["rao2021", "crl-ftdcr-v4"])
def test_positions_with_directions_are_reached(name):
    robot = bs.load_robot(name)
    tensions, _, most = forward(robot, 150, 8)
    poses = bs.solve_batch(robot, tensions)
    tips, tangents = poses.tip_position, poses.tip_rotation[..., 2]
    found = bs.inverse_kinematics(
        robot, tips, direction=3.0 * tangents, limits=Limits(max_tension=most), path=False
    )
    # two segments have four bends and the pose five numbers: only the tensions' own pose is exact
    assert found.reached.mean() > (0.95 if name == "crl-ftdcr-v4" else 0.9)
    reached = found.reached
    assert found.direction_error[reached].max() < 2e-6
    landed = found.land()
    assert np.abs(landed.tip_rotation[reached][..., 2] - tangents[reached]).max() < 1e-5


def test_path_is_followed_without_jumps():
    robot = bs.load_robot("crl-ftdcr-v4")
    angle = np.linspace(0.0, 2.0 * np.pi, 201)
    tips = np.stack(
        [0.05 * np.cos(angle), 0.05 * np.sin(angle), np.full_like(angle, 0.165)], axis=-1
    )
    found = bs.inverse_kinematics(robot, tips).raise_for_status()
    assert not found.restarted.any()
    assert np.abs(np.diff(found.tensions, axis=0)).max() < 0.05 * found.tensions.max()
    # the same tips each from its own start
    cold = bs.inverse_kinematics(robot, tips, path=False)
    assert cold.reached.all()
    again = bs.inverse_kinematics(robot, tips, path=False)
    np.testing.assert_array_equal(cold.tensions, again.tensions)


def test_displacements_lead_to_the_same_pose(rao):
    tips = np.linspace([0.05, 0.02, 0.385], [0.12, 0.05, 0.36], 10)
    found = bs.inverse_kinematics(rao, tips, limits=Limits(min_tension=0.5)).raise_for_status()
    landed = found.land(control="displacements").raise_for_status()
    assert np.abs(landed.tip_position - tips).max() < 1e-7
    assert np.abs(landed.tensions - found.tensions).max() < 5e-3


def test_constant_curvature_in_closed_form(robot):
    rng = np.random.default_rng(2)
    tensions = rng.uniform(0.0, 60.0, (200, 3))
    arcs = RobotArcs.from_tensions(robot, tensions)
    found = bs.inverse_kinematics(robot, arcs.tip.position, model="constant_curvature")
    assert found.reached.all() and found.distance.max() < 1e-12
    # the least tensions leave one tendon slack
    least = tensions - tensions.min(axis=1, keepdims=True)
    np.testing.assert_allclose(found.tensions, least, atol=1e-8)
    np.testing.assert_allclose(found.tendon_lengths, arcs.lengths(), atol=1e-13)
    straight = robot.length - arcs.lengths()
    np.testing.assert_allclose(found.displacements(), straight, atol=1e-13)


@pytest.mark.parametrize("name", ["rao2021", "crl-ftdcr-v4"])
def test_constant_curvature_of_several_segments(name):
    robot = bs.load_robot(name)
    most = 0.5 * default_max_tension(robot)
    tensions = np.random.default_rng(4).uniform(0.0, 1.0, (300, len(most))) * most
    arcs = RobotArcs.from_tensions(robot, tensions)
    found = bs.inverse_kinematics(robot, arcs.tip.position, model="constant_curvature")
    assert found.reached.mean() > 0.98
    reached = found.reached
    assert found.distance[reached].max() < 1e-6 * robot.length
    again = RobotArcs.from_tensions(robot, found.tensions).tip.position
    assert np.abs(again - arcs.tip.position)[reached].max() < 2e-6 * robot.length


def test_landing_of_constant_curvature_is_that_of_a_solve(robot):
    found = bs.inverse_kinematics(robot, [0.3, 0.0, 0.53], model="constant_curvature")
    direct = bs.solve(robot, found.tensions).tip.position
    np.testing.assert_allclose(found.land().tip_position[0], direct, atol=1e-12)
    assert np.linalg.norm(direct - found.tip_position) > 1e-3


def test_single_and_rows_agree_and_are_shown(robot):
    one = bs.inverse_kinematics(robot, [0.3, 0.0, 0.53])
    rows = bs.inverse_kinematics(robot, [[0.3, 0.0, 0.53]])
    np.testing.assert_array_equal(one.tensions, rows.tensions[0])
    assert isinstance(one.status, str) and isinstance(one.distance, float)
    assert len(rows) == 1 and rows.status == [one.status]
    assert one.to_dict() == rows.to_dict()["rows"][0]
    for found in (one, rows):
        assert "amouri2019" in repr(found) and "<table>" in found._repr_html_()
    with pytest.raises(TypeError):
        len(one)


def rubbing(friction):
    """Robot with friction, and tips that it comes to as tendon 1 is pulled and let go."""
    robot = with_tendons(bs.load_robot("rao2021"), {"friction": friction})
    share = np.concatenate([np.linspace(0.1, 1.0, 10), np.linspace(0.95, 0.5, 10)])
    tensions = np.outer(share, [6.0, 0.0, 2.0, 3.0, 0.0, 1.0])
    return robot, bs.sweep(robot, tensions).raise_for_status()


@pytest.mark.parametrize("friction", [0.05, pytest.param(0.15, marks=pytest.mark.slow)])
def test_the_path_counts_with_friction(friction):
    robot, there_and_back = rubbing(friction)
    tips = there_and_back.tip_position
    found = bs.inverse_kinematics(robot, tips)
    assert found.reached[:10].all()
    # beyond the reversal other tensions are at hand than those that gave the tips
    assert np.max(found.distance) < 1e-3 * robot.length
    # the same path, solved by itself
    landed = bs.sweep(robot, found.tensions)
    np.testing.assert_allclose(landed.tip_position, found.tip_position, atol=2e-5 * robot.length)
    np.testing.assert_allclose(found.land().tip_position, landed.tip_position, atol=1e-9)
    np.testing.assert_allclose(found.displacements(), landed.displacements(), atol=1e-5)


def test_the_way_back_takes_less_tension_than_the_way_there():
    free = bs.load_robot("amouri2019")
    robot = with_tendons(free, {"friction": 0.1})
    there = bs.sweep(robot, np.outer(np.linspace(5, 40, 8), [1, 0, 0])).tip_position
    tips = np.concatenate([there, there[6:2:-1]])
    found = bs.inverse_kinematics(robot, tips)
    assert np.max(found.distance) < 1e-3 * robot.length
    without = bs.inverse_kinematics(free, tips, limits=Limits(max_tension=60.0)).tensions
    for out, back in ((6, 8), (5, 9), (4, 10), (3, 11)):
        assert found.tensions[out, 0] > 1.01 * without[out, 0]
        assert found.tensions[back, 0] < 0.98 * found.tensions[out, 0]


def test_hardly_any_friction_gives_the_inverse_without_it():
    robot, there = rubbing(1e-7)
    free = with_tendons(robot, {"friction": 0.0})
    found = bs.inverse_kinematics(robot, there.tip_position[:10])
    expected = bs.inverse_kinematics(free, there.tip_position[:10])
    assert found.reached.all()
    np.testing.assert_allclose(found.tensions, expected.tensions, atol=2e-2)
    np.testing.assert_allclose(found.displacements(), expected.displacements(), atol=1e-6)


def test_friction_with_a_direction_and_from_home():
    robot, there = rubbing(0.05)
    tips = there.tip_position[[3, 8]]
    tangents = there.tip_rotation[[3, 8]][:, :, 2]
    found = bs.inverse_kinematics(robot, tips, direction=tangents, path=False)
    assert (np.asarray(found.distance) < 1e-3 * robot.length).all()
    assert (np.asarray(found.direction_error) < 5e-3).all()
    alone = bs.solve(robot, found.tensions[1])  # a path of one step from home
    np.testing.assert_allclose(alone.tip.position, found.tip_position[1], atol=1e-9)


def test_out_of_reach_with_friction_is_not_called_reached():
    robot, _ = rubbing(0.1)
    found = bs.inverse_kinematics(robot, [0.3, 0.0, 0.0], limits=Limits(max_tension=2.0))
    assert found.status == "max_iterations"
    assert (found.tensions <= 2.0 + 1e-12).all()
    assert found.distance > 0.01
    assert (found.binding == 1).any()


@pytest.mark.parametrize("least", [-0.02, -0.0095])
def test_displacements_are_kept_within_limits(rao, least):
    """With redundant tendons another set reaches the position, at the cost of larger tensions."""
    position = [0.12, 0.05, 0.36]
    free = bs.inverse_kinematics(rao, position)
    limits = (least, 0.0078)
    found = bs.inverse_kinematics(rao, position, limits=Limits(displacement_limits=limits))
    assert found.status == "reached" and found.distance < 1e-6 * rao.length
    moved = bs.solve(rao, found.tensions).displacements()  # by a solve of its own
    assert (moved > limits[0] - 1e-8).all() and (moved < limits[1] + 1e-8).all()
    if (free.displacements() > least).all():
        np.testing.assert_allclose(found.tensions, free.tensions, atol=1e-9)
        return
    assert free.displacements().min() < least
    assert np.linalg.norm(found.tensions) > np.linalg.norm(free.tensions)
    # no admissible step along the set of equal tips makes the tensions smaller
    by = bs.jacobians(bs.solve(rao, found.tensions))
    by_displacement = -by.lengths_by_tension  # of inextensible tendons
    at_limit = np.flatnonzero(moved < least + 1e-7)
    cost = np.asarray(found.tensions) / np.linalg.norm(found.tensions)
    bounds = [(0, 1) if t < 1e-6 else (-1, 1) for t in found.tensions]
    tip = by.tip_position_by_tension / np.abs(by.tip_position_by_tension).max()
    rows = -by_displacement[at_limit] / np.abs(by_displacement).max()
    step = linprog(cost, rows, np.zeros(len(rows)), tip, np.zeros(3), bounds=bounds)
    assert step.fun > -1e-3


def test_displacement_limits_that_bind_are_named(robot):
    tips = bs.sweep(robot, [[60, 0, 0], [20, 0, 0]]).tip_position
    found = bs.inverse_kinematics(robot, tips, limits=Limits(displacement_limits=[-0.05, 0.02]))
    assert found.status == ["unreachable", "reached"]
    assert found.binding[0, 0] == 2 and not found.binding[1].any()
    assert "the largest displacement of tendon 1 (20 mm)" in found.message(0)
    # the nearest tip: that of the displacement itself, to first order in the others
    held = bs.solve(robot, load=bs.Load(displacements=[0.02, -0.05, -0.05]))
    np.testing.assert_allclose(found.tensions[0], held.tensions, atol=1e-2)
    row = found.to_dict()["rows"][0]
    assert {"tendon": 1, "limit": "largest", "of": "displacement"} in row["binding"]


def test_each_tendon_can_have_its_own_limits(robot):
    tip = bs.solve(robot, [30, 0, 10]).tip
    limits = Limits(displacement_limits=[[-1, -1, -1], [1, 1, 0.0]])
    found = bs.inverse_kinematics(robot, tip.position, limits=limits)
    assert found.displacements()[2] < 1e-8


def test_path_with_gaps_and_jumps_is_followed(rao):
    """Rows out of reach and far jumps between rows do not spoil those that follow."""
    _, tips, most = forward(rao, 60, 31)
    tips[7] = [0.0, 0.0, -0.3]
    tips[8] = tips[7]
    tips[20] = [0.0, 0.0, 0.0]
    found = bs.inverse_kinematics(rao, tips, limits=Limits(max_tension=most))
    there = np.ones(len(tips), dtype=bool)
    there[[7, 8, 20]] = False
    assert found.reached[there].all() and not found.reached[~there].any()
    assert np.isfinite(found.tensions).all() and np.isfinite(found.distance).all()
    landed = found.land().tip_position
    assert np.linalg.norm(landed - tips, axis=1)[there].max() < 1e-5 * rao.length


def test_loads_that_change_along_a_path(rao):
    """Each row has its own gravity, tip force and tip moment."""
    angle = np.linspace(0.0, 2.0, 40)
    load = bs.Load(
        gravity=9.81 * np.stack([np.sin(angle), 0.0 * angle, -np.cos(angle)], axis=-1),
        tip_force=np.linspace([0.0, 0.0, 0.0], [0.03, 0.02, -0.05], 40),
        tip_moment=np.linspace([0.0, 0.0, 0.0], [0.002, 0.0, 0.003], 40),
    )
    tips = np.linspace([0.05, 0.02, 0.385], [0.12, 0.05, 0.36], 40)
    found = bs.inverse_kinematics(rao, tips, load=load).raise_for_status()
    landed = found.land()
    assert np.abs(landed.tip_position - tips).max() < 1e-5 * rao.length


def test_one_tendon_bends_in_its_plane(robot):
    tip = bs.solve(robot, [50.0, 0.0, 0.0]).tip.position
    # two tendons are held slack
    limits = Limits(max_tension=[80.0, 0.0, 0.0])
    found = bs.inverse_kinematics(robot, tip, limits=limits)
    assert found.status == "reached"
    np.testing.assert_allclose(found.tensions, [50.0, 0.0, 0.0], atol=1e-3)
    side = np.array([0.0, 0.05, 0.0])
    aside = bs.inverse_kinematics(robot, tip + side, limits=limits)
    assert aside.status == "unreachable"
    assert aside.nearest_distance == pytest.approx(0.05, rel=1e-6)


def test_rows_without_equilibrium_land_nowhere(robot):
    path = [[0.2, 0.0, 0.58], [0.2, 0.0, 0.58], [0.21, 0.0, 0.57]]
    found = bs.inverse_kinematics(robot, path)
    tensions = found.tensions.copy()
    tensions[1] = np.nan
    landed = dataclasses.replace(found, tensions=tensions).land()
    assert landed.status == ["converged", "no_equilibrium", "converged"]
    assert np.isnan(landed.tip_position[1]).all() and landed.stable[1] is None
    assert np.isfinite(landed.tip_position[[0, 2]]).all()


@pytest.mark.parametrize("size", [1e-300, 1e300])
def test_the_length_of_a_direction_does_not_matter(robot: bs.Robot, size: float) -> None:
    ours, other = (
        bs.inverse_kinematics(robot, [0.1, 0, 0.6], direction=[k, 0, k]) for k in (1.0, size)
    )
    assert np.array_equal(ours.tensions, other.tensions)
