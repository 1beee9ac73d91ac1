"""Segments and robots without tendons."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.dynamics import modes
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.plausibility import load_advice
from shell import Shell

TWO = """
name: with_tail
segments:
  - length: 200 mm
    backbone: {diameter: 2 mm, E: 60 GPa, nu: 0.3, density: 6000 kg/m^3}
    disks: {count: 8, mass: 2 g, radius: 12 mm, thickness: 2 mm, clamped_length: 0 mm}
    tendons: {count: 3, pitch_radius: 9 mm}
  - length: 80 mm
    backbone: {diameter: 1.5 mm, E: 60 GPa, nu: 0.3, density: 6000 kg/m^3}
    disks: {count: 3, mass: 1 g, radius: 12 mm, thickness: 2 mm, clamped_length: 0 mm}
    tendons: []
"""


def from_text(path: Path, text: str) -> bs.Robot:
    path.write_text(text)
    return bs.load_robot(path)


def test_a_tail_without_load_continues_along_the_tangent(tmp_path: Path) -> None:
    robot = from_text(tmp_path / "tail.yaml", TWO)
    found = bs.solve(robot, [6.0, 0.0, 0.0])
    assert robot.tendons.segment.tolist() == [0, 0, 0]
    expected = found.disk_positions[7] + 0.08 * found.disk_rotations[7][:, 2]
    np.testing.assert_allclose(found.tip.position, expected, atol=1e-12)
    arcs = RobotArcs.from_tensions(robot, [6.0, 0.0, 0.0])
    assert float(arcs.theta[1]) == 0.0
    by_lengths = RobotArcs.from_lengths(robot, found.tendon_lengths)
    assert np.linalg.norm(by_lengths.tip.position - found.tip.position) < 1e-3 * robot.length
    np.testing.assert_allclose(by_lengths.lengths(), found.tendon_lengths, atol=1e-9)


def test_a_tail_bends_under_its_weight(tmp_path: Path) -> None:
    robot = from_text(tmp_path / "tail.yaml", TWO)
    across = robot.with_({"gravity": [9.81, 0.0, 0.0]})
    found = bs.solve(across, [0.0, 0.0, 0.0]).raise_for_status()
    ends = (found.disk_rotations[7], found.tip.rotation)
    held, tip = (math.atan2(r[0, 2], r[2, 2]) for r in ends)
    assert tip > held > 0.0


def test_inverse_kinematics_of_a_robot_with_a_tail(tmp_path: Path) -> None:
    robot = from_text(tmp_path / "tail.yaml", TWO)
    load = bs.Load(gravity=(9.81, 0.0, 0.0))
    tip = bs.solve(robot, [6.0, 3.0, 1.0], load=load).tip.position
    found = bs.inverse_kinematics(robot, tip, load=load).raise_for_status()
    np.testing.assert_allclose(found.tensions, [6.0, 3.0, 1.0], atol=0.01)
    with pytest.raises(NoSolutionError, match="comes within"):
        bs.inverse_kinematics(robot, 0.9 * tip, load=load).raise_for_status()


def test_arcs_of_inner_segments_without_tendons_are_refused(tmp_path: Path) -> None:
    ring, none = "tendons: {count: 3, pitch_radius: 9 mm}", "tendons: []"
    swapped = TWO.replace(none, "last").replace(ring, none).replace("last", ring)
    robot = from_text(tmp_path / "swapped.yaml", swapped)
    found = bs.solve(robot, [3.0, 0.0, 0.0])
    with pytest.raises(InputError, match="segment 1: no tendon ends at it"):
        RobotArcs.from_lengths(robot, found.tendon_lengths)
    arcs = RobotArcs.from_tensions(robot, [3.0, 0.0, 0.0])
    assert (np.asarray(arcs.theta) > 0).all()


# -- bare rods -----------------------------------------------------------------------------------

ROD = """
segments:
  - length: 150 mm
    backbone: {diameter: 1 mm, E: 60 GPa, nu: 0.3, density: 6000 kg/m^3}
    disks: {count: 12, mass: 0 g, radius: 4 mm, thickness: 0 mm}
    tendons: []
"""
STIFFNESS = 60e9 * math.pi / 64 * 0.001**4
MASS = 6000 * math.pi / 4 * 0.001**2


def test_a_bare_rod_is_that_of_slack_tendons(tmp_path: Path) -> None:
    """Which `test_statics_rod.py` compares with the elastica."""
    robot = from_text(tmp_path / "rod.yaml", ROD)
    slack = robot.with_({"segments.0.tendons": {"count": 3, "pitch_radius": "3 mm"}})
    load, model = bs.Load(tip_force=[0.8, 0.0, 0.0]), bs.RodModel("kirchhoff", elements=8)
    found = bs.solve(robot, [], load=load, model=model).raise_for_status()
    same = bs.solve(slack, [0.0, 0.0, 0.0], load=load, model=model)
    np.testing.assert_allclose(found.disk_positions, same.disk_positions, atol=1e-12)
    assert found.tip.position[0] > 0.05
    assert found.stable and found.tensions.size == 0


def test_a_bare_rod_released_swings_with_its_first_frequency(tmp_path: Path) -> None:
    robot = from_text(tmp_path / "rod.yaml", ROD)
    root = 1.875104068711961  # of cos(x) cosh(x) = -1
    frequency = root**2 / (2 * math.pi) * math.sqrt(STIFFNESS / (MASS * 0.15**4))
    first = modes(robot, [], model=bs.RodModel("kirchhoff")).frequency_hz[0]
    assert first == pytest.approx(frequency, rel=2e-3)
    held = bs.Start(load=bs.Load(tensions=[], tip_force=[1e-3, 0.0, 0.0]))
    run = bs.simulate(robot, [], 0.5 / frequency, start=held)
    x = run.tip_position[:, 0]
    assert x[0] == pytest.approx(1e-3 * 0.15**3 / (3 * STIFFNESS), rel=1e-3)
    assert x[-1] == pytest.approx(-x[0], rel=0.06)  # higher modes have 3 % of the deflection


def test_what_needs_tendons_refuses_a_bare_rod(tmp_path: Path, shell: Shell) -> None:
    path = tmp_path / "rod.yaml"
    robot = from_text(path, ROD)
    file = str(path)
    for command in (
        ("study", file),
        ("ik", file, "--tip", "10 mm,0,140 mm", "--model", "cc"),
        ("ik", file, "--tip", "10 mm,0,140 mm"),
        ("control", file),
        ("reach", file),
        ("reach", file, "--errors"),
        ("map", file, "--over", "E=50:70 GPa:3"),
    ):
        code, out, err = shell(*command)
        assert code == 2 and not out
        assert "needs tendons, and rod has none; solve, simulate and modes take" in err
    code, out, _ = shell("solve", file, "--tip-force", "0.1,0,0")
    assert code == 0 and "tension" not in out
    assert shell.json("simulate", file, "--rise", "0", "--hold", "0.02")["status"] == "converged"
    np.testing.assert_array_equal(RobotArcs.from_tensions(robot, np.zeros((3, 0))).theta, 0.0)
    assert load_advice(robot, []) == ""
