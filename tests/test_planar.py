"""Robots with one tendon, an opposite pair, or a pair beside the axis: arcs from tendon lengths."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import bowstring as bs
from bowstring.constant_curvature import Arc, RobotArcs, Routing
from shell import Shell

ROBOT = """
segments:
  - length: 160 mm
    backbone: {backbone}
    disks: {{count: 10, mass: 0 g, radius: 20 mm, thickness: 1 mm, clamped_length: {clamp} mm}}
    tendons: {tendons}
"""
ROD = "{diameter: 1 mm, E: 50 GPa, nu: 0.3, density: 0 kg/m^3}"
STRIP = (
    "{width: 12 mm, height: 0.6 mm, width_direction: 70 deg, E: 3 GPa, nu: 0.3, density: 0 kg/m^3}"
)


def robot_of(
    folder: Path,
    *angles: float,
    backbone: str = ROD,
    radius: float = 14.0,
    clamp: float = 0.0,
    **changes: object,
) -> bs.Robot:
    """A robot with tendons at angles in degrees and a radius in mm."""
    rows = [f"{{angle: {a} deg, pitch_radius: {radius} mm}}" for a in angles]
    path = folder / "robot.yaml"
    tendons = f"[{', '.join(rows)}]"
    path.write_text(ROBOT.format(backbone=backbone, clamp=clamp, tendons=tendons))
    return bs.load_robot(path, changes)


def test_an_opposite_pair_bends_in_its_plane(tmp_path: Path, shell: Shell) -> None:
    theta, length, phi = 0.9, 0.155, math.radians(40.0)
    robot_of(tmp_path, 40.0, 220.0)
    lengths = [length - 0.014 * theta, length + 0.014 * theta]
    text = ",".join(f"{1e3 * each:.12g} mm" for each in lengths)
    found = shell.json("fk", str(tmp_path / "robot.yaml"), "--lengths", text)
    (segment,) = found["segments"]
    assert segment["theta_rad"] == pytest.approx(theta, rel=1e-12)
    assert segment["phi_rad"] == pytest.approx(phi, rel=1e-12)
    assert segment["length_m"] == pytest.approx(length, rel=1e-12)
    assert segment["misfit_m"] == 0.0
    out, up = length / theta * (1 - math.cos(theta)), length / theta * math.sin(theta)
    tip = [out * math.cos(phi), out * math.sin(phi), up]
    assert found["tip"]["position_m"] == pytest.approx(tip, rel=1e-12)
    # a third tendon in the plane is redundant, and its misfit is reported
    third = robot_of(tmp_path, 40.0, 220.0, 220.0)
    arcs = RobotArcs.from_lengths(third, [*lengths, lengths[1] + 3e-4])
    assert arcs.misfit[0] == pytest.approx(1e-4 * math.sqrt(1.5), rel=1e-9)
    # the plain arc has the same closed form, and says where it needs the length
    arc = Arc.from_lengths(lengths, Routing([phi, phi + math.pi], 0.014))
    assert (arc.theta, arc.phi) == pytest.approx((theta, phi), rel=1e-12)


@pytest.mark.parametrize("angles", [(25.0,), (25.0, 115.0), (0.0, 120.0)])
def test_too_few_lengths_for_the_arc_leave_the_backbone_its_length(
    tmp_path: Path, angles: tuple[float, ...]
) -> None:
    robot = robot_of(tmp_path, *angles)
    bend = (
        np.array([0.7, 0.3])
        if len(angles) > 1
        else 0.8 * np.array([math.cos(math.radians(25.0)), math.sin(math.radians(25.0))])
    )
    holes = robot.tendons.hole_m
    arcs = RobotArcs.from_lengths(robot, 0.16 - holes @ bend)
    np.testing.assert_allclose(arcs.arc.bend[0], [*bend, 0.16], rtol=1e-12)
    assert arcs.misfit[0] == 0.0
    np.testing.assert_allclose(arcs.lengths(), 0.16 - holes @ bend, rtol=1e-14)


@pytest.mark.parametrize("backbone", [STRIP, STRIP.replace("}", ", rest_bend: 30 deg}")])
@pytest.mark.parametrize("angles", [(0.0, 180.0), (50.0,)])
def test_a_strip_bends_where_it_is_soft(
    tmp_path: Path, backbone: str, angles: tuple[float, ...]
) -> None:
    """Tensions out of the plane of the strip bend it beside that of the tendons."""
    robot = robot_of(tmp_path, *angles, backbone=backbone)
    tensions = [0.9, 0.2][: len(angles)]
    by_force = RobotArcs.from_tensions(robot, tensions)
    by_lengths = RobotArcs.from_lengths(robot, by_force.lengths())
    np.testing.assert_allclose(by_lengths.arc.bend, by_force.arc.bend, rtol=1e-10)
    towards = robot.bend_by_moment[0] @ robot.tendons.hole_m[0]
    change = (
        by_lengths.arc.bend[0, :2]
        - RobotArcs.from_tensions(robot, np.zeros(len(angles))).arc.bend[0, :2]
    )
    assert abs(np.cross(np.append(change, 0.0), np.append(towards, 0.0))[2]) < 1e-12
    assert abs(math.atan2(*change[::-1]) - math.radians(angles[0])) > 0.3
    # its derivative is that of the fit
    lengths, step = by_force.lengths(), 1e-7
    moved = lengths + step * np.eye(len(angles))
    ends = [RobotArcs.from_lengths(robot, m).tip.position for m in (moved, 2 * lengths - moved)]
    np.testing.assert_allclose(
        by_lengths.jacobian()[:3].T, (ends[0] - ends[1]) / (2 * step), rtol=1e-6, atol=1e-7
    )


def test_straight_spans_of_a_single_tendon(tmp_path: Path) -> None:
    """The bend of a module of the given length, by SciPy."""
    robot = robot_of(tmp_path, 30.0)
    wanted = 0.148

    def tendon(a: float) -> float:  # theory Eq. 1.5 for ten equal modules
        return 10 * (2 * 0.016 / a * math.sin(a / 2) - 2 * 0.014 * math.sin(a / 2))

    a = brentq(lambda a: tendon(a) - wanted, 1e-6, 1.0, xtol=1e-15)
    arcs = RobotArcs.from_lengths(robot, [wanted], "chord")
    np.testing.assert_allclose(arcs.module_bends, np.full(10, a), rtol=1e-11)
    assert arcs.length[0] == 0.16
    assert arcs.lengths()[0] == pytest.approx(wanted, rel=1e-14)


@pytest.mark.parametrize("angles", [(10.0,), (10.0, 190.0), (10.0, 100.0)])
def test_the_correction_finds_the_tip_of_the_rod(tmp_path: Path, angles: tuple[float, ...]) -> None:
    robot = robot_of(tmp_path, *angles, clamp=3.0)
    rod = bs.RodModel("kirchhoff")
    found = bs.solve(robot, [1.5, 0.6][: len(angles)], model=rod).raise_for_status()
    plain, better = (
        np.linalg.norm(
            RobotArcs.from_lengths(robot, found.tendon_lengths, law).tip.position
            - found.tip.position
        )
        for law in (None, "chord")
    )
    assert better < 0.1 * plain
    assert plain < 0.02 * robot.length


@pytest.mark.parametrize(
    ("disks", "radius", "load"), [(1, 14.0, 0.5), (2, 6.0, 0.5), (3, 4.0, 0.7)]
)
def test_one_tendon_on_long_spans_has_its_corrected_arc(
    tmp_path: Path, disks: int, radius: float, load: float
) -> None:
    """On spans that are long beside the lever arm, a shorter axis bends the arc by more."""
    robot_of(tmp_path, 40.0, radius=radius)
    path = tmp_path / "robot.yaml"
    path.write_text(path.read_text().replace("count: 10", f"count: {disks}"))
    robot = bs.load_robot(path)
    stiffness = 50e9 * math.pi / 64.0 * 1e-12  # N m^2
    solved = bs.solve(robot, [load * stiffness / (0.16 * 1e-3 * radius)]).raise_for_status()
    arcs = RobotArcs.from_lengths(robot, solved.tendon_lengths, correction="chord")
    np.testing.assert_allclose(arcs.lengths(), solved.tendon_lengths, rtol=1e-12)
    assert arcs.length[0] == pytest.approx(0.16, rel=1e-12)
    assert arcs.theta[0] == pytest.approx(math.acos(solved.tip.rotation[2, 2]), rel=0.1)
