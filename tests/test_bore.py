"""Tendons within the outline of the backbone: in the bore of a tube, and beside a strip."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.robot.plausibility import implausible
from bowstring.robot.sizes import sizes_of
from bowstring.study.design_map import design_axis
from shooting import Shooting

CATHETER = """
segments:
  - length: 60 mm
    backbone: {diameter: 2 mm, inner_diameter: 1.4 mm, E: 90 MPa, nu: 0.4, density: 1100 kg/m^3}
    disks: {count: 24, mass: 0 g, radius: 1.1 mm, thickness: 0.2 mm, clamped_length: 0 mm}
    tendons:
      - {angle: 30 deg, pitch_radius: 0.6 mm}
      - {angle: 210 deg, pitch_radius: 0.6 mm}
"""

# the third tendon is on the axis of the inner segment, and leaves it behind its end disk
WRIST = """
segments:
  - length: 50 mm
    backbone: {diameter: 3 mm, inner_diameter: 2 mm, E: 2 GPa, nu: 0.3, density: 1200 kg/m^3}
    disks: {count: 5, mass: 1 g, radius: 5 mm, thickness: 0 mm}
    tendons: {count: 3, pitch_radius: 3 mm}
  - length: 40 mm
    backbone: {diameter: 3 mm, inner_diameter: 2 mm, E: 1 GPa, nu: 0.3, density: 1200 kg/m^3}
    disks: {positions: 0.05 10 20 30 40 mm, mass: 1 g, radius: 5 mm, thickness: 0 mm}
    tendons:
      - angle: 60 deg
        pitch_radius: 0 mm
        pitch_radii: 0 0 0 0 0 3 3 3 3 3 mm
"""

STRIP = """
segments:
  - length: 90 mm
    backbone:
      {width: 14 mm, height: 0.8 mm, width_direction: 50 deg, E: 3 GPa, nu: 0.3, density: 0 kg/m^3}
    disks: {count: 30, mass: 1 g, radius: 12 mm, thickness: 1 mm, clamped_length: 0 mm}
    tendons: [{angle: 140 deg, pitch_radius: 4 mm}, {angle: -40 deg, pitch_radius: 4 mm}]
"""


def robot_of(folder: Path, text: str, **changes: object) -> bs.Robot:
    path = folder / "robot.yaml"
    path.write_text(text)
    return bs.load_robot(path, {k.replace("__", "."): v for k, v in changes.items()})


def bend(rotation: np.ndarray) -> float:
    """Angle of a frame's z axis from that of the base, rad."""
    return math.atan2(math.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])


def linear(robot: bs.Robot, tension: float, radius: float, segment: int = 0) -> float:
    stiffness = float(robot.bending_stiffness[segment])
    return tension * radius * robot.segments[segment].length / stiffness


def test_a_tendon_in_a_lumen_bends_by_its_lever_arm(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, CATHETER)
    second = math.pi / 64 * (0.002**4 - 0.0014**4)
    theta = 0.8 * 0.0006 * 0.06 / (90e6 * second)
    assert theta == pytest.approx(linear(robot, 0.8, 0.0006), rel=1e-12)
    channel = bs.RodModel("kirchhoff", tendon_path="continuous")
    along = bs.solve(robot, [0.8, 0.0], model=channel)
    assert bend(along.tip.rotation) == pytest.approx(theta, rel=1e-9)
    spans = bs.solve(robot, [0.8, 0.0])
    assert bend(spans.tip.rotation) == pytest.approx(theta, rel=0.02)
    # for the mechanics only the stiffness of the section counts, not where its material is
    numbers = [robot.bending_stiffness, robot.torsion_stiffness, robot.shear_stiffness]
    (ei,), (gj,), (ga,), (ea,) = (n.tolist() for n in (*numbers, robot.axial_stiffness))
    stiffness = np.diag([ei, ei, gj, ga, ga, ea]).tolist()
    no_outline = robot.with_(
        {"segments.0.backbone": {"stiffness": stiffness, "mass_per_length": 0.0}}
    )
    same = bs.solve(no_outline, [0.8, 0.0]).tip.position
    np.testing.assert_allclose(same, spans.tip.position, rtol=0, atol=1e-12)


def test_friction_and_displacements_act_in_a_lumen(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, CATHETER)
    mu = 0.15
    rough = robot.with_({"segments.0.tendons.*.friction": mu})
    pulled = bs.solve(rough, [0.8, 0.0])
    assert pulled.shortened is not None
    displacement = bs.Load(displacements=[pulled.shortened[0], np.nan])
    held = bs.solve(rough, [np.nan, 0.0], load=displacement)
    np.testing.assert_allclose(held.tip.position, pulled.tip.position, atol=1e-8)
    # the tendon turns by the bend in all, and the tension falls by exp(-mu turn) along it
    free = bs.solve(robot, [0.8, 0.0])
    mean = (1.0 - math.exp(-mu * bend(pulled.tip.rotation))) / (mu * bend(pulled.tip.rotation))
    assert bend(pulled.tip.rotation) == pytest.approx(mean * bend(free.tip.rotation), rel=0.01)
    assert robot.warnings == rough.warnings == ()


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_a_tendon_on_the_axis_leaves_its_inner_segment_straight(
    tmp_path: Path, theory: str
) -> None:
    robot = robot_of(tmp_path, WRIST)
    tensions = np.array([0.0, 0.0, 0.0, 4.0])
    found = bs.solve(robot, tensions, model=bs.RodModel(theory)).raise_for_status()
    exact = Shooting(robot, found, []).solve()[0]
    assert np.abs(found.disk_positions - exact).max() < 1e-7 * robot.length
    theta = linear(robot, 4.0, 0.003, segment=1)
    assert bend(found.disk_rotations[4]) < 1e-3 * theta
    assert bend(found.tip.rotation) == pytest.approx(theta, rel=0.01)
    assert robot.tendons.arm_m[3] == pytest.approx(0.003, rel=1e-3)
    # by constant curvature too, and no warning takes the tendon for one without a lever arm
    arcs = bs.constant_curvature.RobotArcs.from_tensions(robot, tensions)
    np.testing.assert_allclose(arcs.theta, [0.0, theta], rtol=1e-3, atol=1e-15)
    assert list(implausible(robot)) == []
    # a ring and a list share no pitch radius that the map of a study could vary
    axis = design_axis(robot)
    assert axis is not None
    assert axis.path == "segments.*.backbone.diameter"


@pytest.mark.parametrize("path", ["straight", "continuous"])
def test_a_hole_beside_the_flat_face_of_a_strip_bends_it(tmp_path: Path, path: str) -> None:
    robot = robot_of(tmp_path, STRIP)
    stiffness = 3e9 * 0.014 * 0.0008**3 / 12
    theta = 2.0 * 0.004 * 0.09 / stiffness
    found = bs.solve(robot, [2.0, 0.0], model=bs.RodModel("kirchhoff", tendon_path=path))
    assert bend(found.tip.rotation) == pytest.approx(
        theta, rel=1e-9 if path == "continuous" else 0.01
    )
    assert math.atan2(*found.tip.position[1::-1]) == pytest.approx(math.radians(140.0), abs=1e-9)


def test_disks_have_no_hole_for_a_tendon_in_the_tube(tmp_path: Path) -> None:
    robot = robot_of(tmp_path, WRIST.replace("thickness: 0 mm", "thickness: 1 mm"))
    given = robot.with_(
        {"segments.*.disks.density": 1000.0, "segments.*.disks.hole_diameter": "1 mm"}
    )
    area = [math.pi / 4 * (100 - 9 - n) * 1e-6 for n in (3, 1)]  # of 10 mm, of 3 mm, n of 1 mm
    inner, outer = given.disks.mass_kg[3], given.disks.mass_kg[8]
    assert [inner, outer] == pytest.approx([1000 * 1e-3 * a for a in area], rel=1e-12)
    # a tendon that the file gives no size fits between the axis of its hole and the tube's wall
    near = robot_of(tmp_path, CATHETER)
    assert (sizes_of(near).tendon_m < 2 * (0.0007 - 0.0006)).all()
