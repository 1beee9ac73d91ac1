"""Drives that are commanded by displacements of each segment alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.calibration import Data, fit
from bowstring.constant_curvature import Arc, RobotArcs
from bowstring.dynamics import ramp
from bowstring.errors import InputError
from bowstring.statics.actuation import commanded, driven
from shell import Shell

ROD = "{diameter: 0.9 mm, E: 55 GPa, nu: 0.3, density: 6450 kg/m^3}"
DISKS = "{count: 8, mass: 0.5 g, radius: 9 mm, thickness: 3 mm, clamped_length: 0 mm}"
ROBOT = f"""
segments:
  - length: 80 mm
    backbone: {ROD}
    disks: {DISKS}
    tendons: {{count: 3, pitch_radius: 7 mm, decoupling: 1}}
  - length: 90 mm
    backbone: {ROD}
    disks: {DISKS}
    tendons: {{count: 4, pitch_radius: 5.5 mm, first_angle: 20 deg, decoupling: 1}}
  - length: 60 mm
    backbone: {ROD}
    disks: {DISKS}
    tendons:
      - {{angle: 0 deg, pitch_radius: 4 mm, decoupling: 1}}
      - {{angle: 180 deg, pitch_radius: 4 mm, decoupling: 1}}
"""
#: Bends of the segments; the tendons of the last one bend it in one plane.
BENDS = np.array([[0.2, -0.1], [-0.12, 0.09], [0.25, 0.0]])


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "robot.yaml"
    path.write_text(ROBOT)
    return path


@pytest.fixture
def robot(file: Path) -> bs.Robot:
    return bs.load_robot(file)


@pytest.fixture
def own(robot: bs.Robot) -> Floats:
    """Displacements of each segment alone that make these bends, m."""
    tendons = robot.tendons
    found: Floats = (tendons.hole_m * BENDS[tendons.segment]).sum(axis=1)
    return found


def test_drives_add_what_inner_segments_take(robot: bs.Robot, own: Floats) -> None:
    """The tendons then have the lengths that they have along the arcs of the single segments."""
    length = np.array([segment.length for segment in robot.segments])
    kappa, phi = np.hypot(*BENDS.T) / length, np.arctan2(BENDS[:, 1], BENDS[:, 0])
    lengths = RobotArcs(robot, Arc(kappa, phi, length)).lengths()
    whole = robot.disks.station_m[robot.tendons.end_disk] - lengths
    assert driven(robot, own) == pytest.approx(whole, abs=1e-12)
    assert commanded(robot, whole) == pytest.approx(own, abs=1e-12)
    # three tendons around a segment also tell its shortening, which all that pass take
    shorter = own + np.repeat([1e-3, 0.0], [3, 6])
    assert driven(robot, shorter) == pytest.approx(whole + 1e-3, abs=1e-12)
    # without decoupling a command is the displacement of the whole tendon
    plain = robot.with_({"segments.*.tendons.decoupling": 0})
    assert driven(plain, own).tolist() == own.tolist()
    # where the middle drives do not decouple, the outer ones add what its tendons leave over
    some = robot.with_({"segments.1.tendons.decoupling": 0})
    mixed = np.where(robot.tendons.segment == 1, whole, own)
    assert driven(some, mixed) == pytest.approx(whole, abs=1e-12)


def test_commands_of_segments_reach_every_solver(robot: bs.Robot, own: Floats) -> None:
    plain = robot.with_({"segments.*.tendons.decoupling": 0})
    whole = driven(robot, own)
    one = bs.solve(robot, load=bs.Load(displacements=own))
    other = bs.solve(plain, load=bs.Load(displacements=whole))
    assert one.raise_for_status().tip.position.tolist() == other.tip.position.tolist()
    rows = np.outer([0.5, 1.0], own)
    swept = bs.sweep(robot, load=bs.Load(displacements=rows)).raise_for_status()
    assert swept.tip_position[-1] == pytest.approx(one.tip.position, abs=1e-9)
    run = bs.simulate(robot, load=bs.Load(displacements=ramp(0.1 * own, 0.01)), duration=0.02)
    same = bs.simulate(plain, load=bs.Load(displacements=ramp(0.1 * whole, 0.01)), duration=0.02)
    assert run.tip_position[-1] == pytest.approx(same.tip_position[-1], abs=1e-12)


def test_inverse_kinematics_returns_commands(robot: bs.Robot) -> None:
    wanted = bs.solve(robot, [0.5, 0, 0.2, 0.2, 0, 0.1, 0, 0.1, 0]).raise_for_status().tip.position
    found = bs.inverse_kinematics(robot, wanted).raise_for_status()
    again = bs.solve(robot, load=bs.Load(displacements=found.displacements())).raise_for_status()
    assert again.tip.position == pytest.approx(wanted, abs=1e-7)
    limits = bs.ActuationLimits(displacement_limits=[-0.01, 0.01])
    with pytest.raises(InputError, match="displacement_limits are of whole tendons"):
        bs.inverse_kinematics(robot, wanted, limits=limits)


def test_a_displacement_needs_those_of_inner_segments(robot: bs.Robot, own: Floats) -> None:
    tensions = [1.0, 0, 0, *[None] * 6]
    displacements = [None] * 3 + own[3:].tolist()
    said = "tendon 4 has the displacement of its own segment.*tendon 1 of an inner segment has none"
    with pytest.raises(InputError, match=said):
        bs.solve(robot, load=bs.Load(tensions=tensions, displacements=displacements))
    # a tendon at 0 degrees takes nothing from those at 120 and 240: rounding asks for no others
    ring = {f"segments.{k}.tendons": {"count": 3, "pitch_radius": "4 mm"} for k in range(3)}
    aligned = robot.with_({**ring, "segments.1.tendons.decoupling": 1})
    alone = bs.Load(
        tensions=[None, 0.3, 0.3, None, 0.3, 0.3, *3 * [0.0]],
        displacements=[1e-4, None, None, 1e-4, *5 * [None]],
    )
    assert bs.solve(aligned, load=alone).converged
    # the other way it is known
    inner = bs.Load(tensions=[None] * 3 + [0.3] * 6, displacements=[*own[:3], *[None] * 6])
    assert bs.solve(robot, load=inner).converged


def test_measured_commands_are_fitted(robot: bs.Robot, own: Floats) -> None:
    """A table of commands of the segments: the fit of a radius finds that of the robot."""
    rows = np.outer([0.3, 0.6, 1.0, -0.4, -0.8], own)
    tips = bs.sweep(robot, load=bs.Load(displacements=rows)).raise_for_status().tip_position
    data = Data(tips, displacements=rows)
    wrong = robot.with_({"segments.0.tendons.pitch_radius": "7.3 mm"})
    found = fit(wrong, data, ["segments.0.tendons.pitch_radius"])
    assert found.values["segments.0.tendons.pitch_radius"] == pytest.approx(7e-3, rel=1e-5)


def test_fk_takes_displacements(shell: Shell, file: Path) -> None:
    ring = "{count: 3, pitch_radius: 4 mm, decoupling: 1}"
    robot = bs.load_robot(file, {"segments.2.tendons": ring})
    tendons = robot.tendons
    own = (tendons.hole_m * BENDS[tendons.segment]).sum(axis=1)
    text = ",".join(f"{1e3 * each:.17g} mm" for each in own)
    flags = ["fk", str(file), "--set", f"segments.2.tendons={ring}", "--displacement", text]
    found = shell.json(*flags)
    along_x = [s["theta_rad"] * np.cos(s["phi_rad"]) for s in found["segments"]]
    assert along_x == pytest.approx(BENDS[:, 0], abs=1e-12)
    assert [s["length_m"] for s in found["segments"]] == pytest.approx([0.08, 0.09, 0.06])
    chord = shell.json(*flags, "--chord")
    assert chord["tip"]["position_m"] == pytest.approx(found["tip"]["position_m"], abs=1e-4)
    assert chord["tip"]["position_m"] != found["tip"]["position_m"]
    both = shell.error(*flags, "--lengths", "80 mm," * 9 + "80 mm")
    assert "give one of the two" in both
    assert "give one of the two" in shell.error("fk", str(file))
