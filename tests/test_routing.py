"""Tendons that wind about the backbone, converge, or have holes of their own in each disk."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.robot.model import with_tendons
from bowstring.study.study import Study
from shooting import Shooting

HELIX = {"segments.0.tendons.turns": 0.5, "segments.0.tendons.end_pitch_radius": 0.015}


def helical(**changes: object) -> bs.Robot:
    return bs.load_robot("amouri2019", {**HELIX, **changes})


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_a_helical_converging_routing_equals_an_independent_integration(theory: str) -> None:
    found = bs.solve(helical(), [25.0, 4.0, 0.0], model=bs.RodModel(theory, elements=8))
    exact = Shooting(found.robot, found, []).solve()[0]
    assert np.abs(found.disk_positions - exact).max() < 1e-6 * found.robot.length
    assert abs(found.tip.position[1]) > 0.05  # it bends out of the plane of its first hole


def test_holes_follow_turns_and_pitch_radii() -> None:
    robot = helical()
    holes = robot.tendons.holes_m
    share = np.arange(10) / 9
    radius, angle = 0.029 + (0.015 - 0.029) * share, math.pi * share
    for i, first in enumerate((0.0, 2 * math.pi / 3, 4 * math.pi / 3)):
        expected = radius * [np.cos(first + angle), np.sin(first + angle)]
        np.testing.assert_allclose(holes[i].T, expected, atol=1e-15)
    mean = np.trapezoid(holes, robot.disks.station_m[0] * np.arange(10), axis=1) / robot.length
    np.testing.assert_allclose(robot.tendons.mean_hole_m, mean[None], atol=1e-15)
    plain = bs.load_robot("amouri2019")
    assert plain.tendons.holes_m.shape == (3, 1, 2) and plain.is_parallel
    np.testing.assert_array_equal(plain.tendons.mean_hole_m[0], plain.tendons.hole_m)


def listed(**fields: object) -> bs.Robot:
    """The built-in robot with one tendon more than its ring, given one by one."""
    tendons = [
        {"angle": "0 deg", "pitch_radius": "29 mm", **fields},
        {"angle": "120 deg", "pitch_radius": "29 mm"},
    ]
    return bs.load_robot("amouri2019", {"segments.0.tendons": tendons})


def test_angles_and_pitch_radii_of_each_disk_are_those_of_turns() -> None:
    share = np.arange(1, 10) / 9
    one = listed(turns=0.5, end_pitch_radius="15 mm")
    angles = " ".join(f"{180 * s!r}" for s in share.tolist()) + " deg"
    radii = " ".join(f"{29 - 14 * s!r}" for s in share.tolist()) + " mm"
    each = listed(angles=angles, pitch_radii=radii)
    np.testing.assert_allclose(one.tendons.holes_m, each.tendons.holes_m, atol=1e-15)
    np.testing.assert_allclose(
        bs.solve(one, [30.0, 5.0]).tip.position,
        bs.solve(each, [30.0, 5.0]).tip.position,
        atol=1e-12,
    )
    assert one.hash != each.hash != listed().hash


def test_friction_of_helical_tendons() -> None:
    robot = helical(**{"segments.0.tendons.friction": 0.1})
    free = bs.solve(helical(), [20.0, 0.0, 0.0])
    rubbed = bs.solve(robot, [20.0, 0.0, 0.0])
    # a tendon that winds is bent at every hole, also where the robot is straight
    assert rubbed.tip.position[2] > free.tip.position[2]


def test_constant_curvature_sees_the_mean_of_the_routing() -> None:
    robot = helical(**{"segments.0.tendons.turns": 0.1})
    arcs = RobotArcs.from_tensions(robot, [10.0, 0.0, 0.0])
    hole = robot.tendons.mean_hole_m[0, 0]
    bend = 10.0 * np.linalg.norm(hole) * robot.length / robot.bending_stiffness[0]
    assert float(arcs.theta[0]) == pytest.approx(bend, rel=1e-12)


@pytest.mark.usefixtures("coarse")
def test_a_study_of_a_helical_robot_runs(paper: Study) -> None:
    study = bs.run_study(helical(**{"segments.0.tendons.turns": 0.1}))
    errors = {row.name: row.mean / study.length for row in study.comparisons}
    # the plane of bending turns along the backbone: an arc misses more than without
    known = {row.name: row.mean / paper.length for row in paper.comparisons}
    assert errors["cc_from_lengths"] > 5 * known["cc_from_lengths"]


def test_a_drawing_has_a_view_of_each_disk_that_differs() -> None:
    from bowstring.cad.drawing import draw_disks

    sizes = {"segments.0.disks.hole_diameter": "2 mm"}
    same = len(draw_disks(bs.load_robot("amouri2019", sizes)).axes)
    wound = len(draw_disks(helical(**sizes)).axes)
    assert wound == 9 * same


def test_elastic_tendons_that_are_not_parallel_have_their_own_length() -> None:
    """Displacements of a solution, commanded again, give its tensions."""
    for routing in ({"turns": 0.4}, {"end_pitch_radius": 0.01}):
        robot = with_tendons(bs.load_robot("amouri2019"), {"axial_stiffness": 3e4, **routing})
        bent = bs.solve(robot, [14, 6, 4], model=bs.RodModel(elements=2))
        again = bs.solve(robot, load=bs.Load(displacements=bent.displacements()), model=bent.model)
        np.testing.assert_allclose(again.tensions, bent.tensions, rtol=1e-8)
