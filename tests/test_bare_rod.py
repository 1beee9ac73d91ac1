"""Segments without tendons."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError

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


def test_arcs_of_inner_segments_without_tendons_are_refused(tmp_path: Path) -> None:
    first, second = TWO.split("tendons: {count: 3, pitch_radius: 9 mm}")
    swapped = (
        first
        + "tendons: []"
        + second.replace("tendons: []", "tendons: {count: 3, pitch_radius: 9 mm}")
    )
    robot = from_text(tmp_path / "swapped.yaml", swapped)
    found = bs.solve(robot, [3.0, 0.0, 0.0])
    with pytest.raises(InputError, match="segment 1: no tendon ends at it"):
        RobotArcs.from_lengths(robot, found.tendon_lengths)
    arcs = RobotArcs.from_tensions(robot, [3.0, 0.0, 0.0])
    assert (np.asarray(arcs.theta) > 0).all()
