"""Rods and chambers: tendons that push too, with tensions of either sign."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import bowstring as bs
from bowstring.calibration import Prior, calibrate
from bowstring.constant_curvature import RobotArcs
from bowstring.data.measurements import read_measurements
from bowstring.errors import InputError
from bowstring.statics.limits import buckled_or_stretched
from shell import Shell
from shooting import Shooting, tip_of
from stages import Stages

E, DIAMETER, LENGTH, RADIUS = 85e3, 26e-3, 0.14, 8e-3
AREA, SECOND = math.pi / 4 * DIAMETER**2, math.pi / 64 * DIAMETER**4
CHAMBERS = f"""
segments:
  - length: {LENGTH} m
    tendons_in: body
    backbone: {{diameter: {DIAMETER} m, E: {E} Pa, nu: 0.4, density: 1060 kg/m^3}}
    tendons: {{count: 3, pitch_radius: {RADIUS} m, kind: chamber, area: 1.5 cm^2}}
"""
RODS = """
segments:
  - length: 70 mm
    backbone: {diameter: 0.7 mm, E: 58 GPa, nu: 0.3, density: 6450 kg/m^3}
    disks: {count: 7, mass: 0 g, radius: 5 mm, thickness: 1 mm, clamped_length: 0 mm}
    tendons: {count: 4, pitch_radius: 3.5 mm, kind: rod}
"""


def _robot(folder: Path, text: str, **changes: Any) -> bs.Robot:
    file = folder / "robot.yaml"
    file.write_text(text)
    paths = {f"segments.0.{path.replace('__', '.')}": value for path, value in changes.items()}
    return bs.load_robot(file, paths)


@pytest.fixture
def chambers(tmp_path: Path) -> bs.Robot:
    return _robot(tmp_path, CHAMBERS)


@pytest.fixture
def rods(tmp_path: Path) -> bs.Robot:
    return _robot(tmp_path, RODS)


@pytest.mark.parametrize("kind", ["rod", "chamber"])
def test_poses_are_drawn_where_tendons_push(tmp_path: Path, kind: str) -> None:
    """Chambers push, rods do both; constant curvature commands these tensions too."""
    robot = _robot(tmp_path, RODS, tendons__kind=kind)
    for found in (bs.reach(robot, 4, poses=8), bs.workspace_map(robot, 4, poses=8)):
        drawn = found.tensions
        assert not drawn[0].any()
        assert -4.0 <= drawn.min() < -2.0
        assert (drawn.max() > 2.0) if kind == "rod" else (drawn.max() == 0.0)
    errors = bs.control_errors(robot, poses=8, max_tension=4, corrections=0, commands=["tensions"])
    away = np.linalg.norm(errors.landed["tensions"][0] - errors.wanted, axis=-1)
    assert away.max() < 0.02 * robot.length


@pytest.mark.parametrize("force", [-2.5, -0.3, 1.7])
def test_a_chamber_bends_and_extends_in_closed_form(chambers: bs.Robot, force: float) -> None:
    """kappa = P r/(E I) by the length without load, and extension P/(E A)."""
    theta = force * RADIUS * LENGTH / (E * SECOND)
    length = LENGTH * (1.0 - force / (E * AREA))
    tip = length / theta * np.array([1.0 - math.cos(theta), 0.0, math.sin(theta)])
    found = bs.solve(chambers, [force, 0.0, 0.0]).raise_for_status()
    assert found.stable
    assert found.tip.position == pytest.approx(tip, abs=1e-9 * LENGTH)
    arcs = RobotArcs.from_tensions(chambers, [force, 0.0, 0.0])
    assert arcs.length[0] == pytest.approx(length, rel=1e-12)
    assert arcs.theta[0] * math.cos(arcs.phi[0]) == pytest.approx(theta, rel=1e-12)
    assert arcs.tip.position == pytest.approx(tip, abs=1e-12 * LENGTH)


def test_chambers_under_load_agree_with_shooting(chambers: bs.Robot) -> None:
    tensions, force = np.array([-1.8, 0.4, 0.4]), (0.05, -0.08)
    load = bs.Load(tip_force=[force[0], 0.0, force[1]])
    found = bs.solve(chambers, tensions, load=load).raise_for_status()
    shear = E / 2.8
    stiffness = np.array([E, E, 2 * shear, shear, shear, E]) * np.repeat([SECOND, AREA], 3)
    holes = np.pad(chambers.tendons.hole_m, ((0, 0), (0, 1))), np.zeros((3, 3))
    dead = np.array([force[0], 0.0, force[1]])
    x, _, z = tip_of(stiffness, (LENGTH,), lambda *_: holes, tensions, lambda _: dead)
    # theory of continuous tendons: dead loads shear and stretch by a linear law beside them
    assert found.error_estimate is not None
    assert np.linalg.norm(found.tip.position - [x, 0.0, z]) < found.error_estimate.tip
    assert found.error_estimate.tip < 2e-4 * LENGTH


def test_rods_under_load_agree_with_shooting(tmp_path: Path) -> None:
    robot = _robot(tmp_path, RODS, disks__count=3)
    tensions, force = np.array([0.5, 0.1, -0.7, 0.1]), (0.06, -0.1)
    load = bs.Load(tip_force=[force[0], 0.0, force[1]])
    model = bs.RodModel(elements=8)
    found = bs.solve(robot, tensions, load=load, model=model).raise_for_status()
    at_tip = bs.PointLoad(arc_length=robot.length, force=load.tip_force)
    disks, turns = Shooting(robot, found, [at_tip]).solve()
    assert found.disk_positions == pytest.approx(disks, abs=1e-8 * robot.length)
    assert abs(turns[-1, 0, 2]) > 0.5


def test_rods_that_push_and_pull_alike_make_an_arc(rods: bs.Robot) -> None:
    """The spans of a module are parallel: a couple T 2r cos(a/2) without axial force."""
    force, r, n, length = 0.9, 3.5e-3, 7, 0.07
    stiffness = 58e9 * math.pi / 64 * 0.7e-3**4
    couple = 2.0 * force * r * length / stiffness
    theta = brentq(lambda t: t - couple * math.cos(t / (2 * n)), 0.0, couple, xtol=1e-15)
    found = bs.solve(rods, [force, 0.0, -force, 0.0]).raise_for_status()
    tip = length / theta * np.array([1.0 - math.cos(theta), 0.0, math.sin(theta)])
    assert found.tip.position == pytest.approx(tip, abs=1e-9 * length)
    # spans to both sides of the chord
    chord = 2.0 * length / theta * math.sin(theta / (2 * n))
    away = 2.0 * r * math.sin(theta / (2 * n))
    assert found.tendon_lengths is not None
    assert found.tendon_lengths[[0, 2]] == pytest.approx(
        [n * (chord - away), n * (chord + away)], abs=1e-9 * length
    )


def test_displacement_control_finds_tensions_of_either_sign(tmp_path: Path) -> None:
    robot = _robot(tmp_path, RODS, tendons__count=3, tendons__axial_stiffness="4 kN")
    given = np.array([[1.2, -0.5, -0.4], [-0.8, 0.3, 0.6], [-0.2, -0.3, -0.1]])
    moved = np.array([bs.solve(robot, row).displacements() for row in given])
    found = bs.sweep(robot, load=bs.Load(displacements=moved)).raise_for_status()
    assert found.tensions == pytest.approx(given, abs=1e-7)
    assert not found.slack_lengths.any()
    one = bs.solve(robot, load=bs.Load(displacements=moved[0])).raise_for_status()
    assert one.slack == ()
    # the same tendons without pushing: those that would push are slack
    pulls = robot.with_({"segments.0.tendons.kind": "tendon"})
    loose = bs.solve(pulls, load=bs.Load(displacements=moved[0])).raise_for_status()
    assert (loose.tensions >= 0.0).all()
    assert loose.slack


def test_backlash_and_creep_hold_for_rods_that_push(tmp_path: Path) -> None:
    """Their equations are linear in displacement and tension: a turned robot is a mirrored one."""
    laws = {"backlash": "0.1 mm", "creep_compliance": "0.02 mm/N", "compliance": "0.01 mm/N"}
    changes = {f"tendons__{name}": value for name, value in laws.items()}
    robot = _robot(tmp_path, RODS, **changes)
    path = 1e-3 * np.array([[1.0, 0.0, -1.0, 0.0], [0.4, 0.0, -0.4, 0.0], [0.9, 0.0, -0.9, 0.0]])
    times = [1.0, 30.0, 60.0]
    one = bs.sweep(robot, load=bs.Load(displacements=path), times=times).raise_for_status()
    other = bs.sweep(robot, load=bs.Load(displacements=-path), times=times).raise_for_status()
    assert (one.tensions[:, 2] < 0.0).any()
    assert other.tensions[:, [2, 0]] == pytest.approx(one.tensions[:, [0, 2]], abs=1e-8)


def test_inverse_kinematics_pushes_as_well_as_pulls(rods: bs.Robot) -> None:
    wanted = bs.solve(rods, [0.6, 0.2, -0.6, -0.2]).raise_for_status().tip.position
    found = bs.inverse_kinematics(rods, wanted).raise_for_status()
    assert found.tensions.min() < -0.1
    reached = bs.solve(rods, found.tensions).raise_for_status().tip.position
    assert reached == pytest.approx(wanted, abs=1e-8)
    limits = bs.ActuationLimits(max_tension=3.0)
    arcs = bs.inverse_kinematics(rods, wanted, model="constant_curvature", limits=limits)
    assert arcs.tensions.min() < -0.1
    # pushes and pulls together, so that the arcs keep their lengths
    assert abs(arcs.tensions.sum()) < 1e-3


def test_measured_compressions_are_read(rods: bs.Robot, tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    names = ",".join(f"tension_{i}_N" for i in range(1, 5))
    table.write_text(f"{names},tip_x_mm,tip_y_mm,tip_z_mm\n0.5,0,-0.5,0,20,0,60\n")
    assert bs.read_measurements(table, rods).tensions[0, 2] == -0.5


def test_rods_that_buckle_are_announced(tmp_path: Path, rods: bs.Robot) -> None:
    load = [0.5, 0.0, -0.5, 0.0]
    assert bs.solve(rods, load).warnings() == (
        "rod 3 is under compression, and whether it buckles between two disks is not checked: "
        "give bending_stiffness.",
    )
    # pi^2 E I/h^2 with disks 10 mm apart
    euler = math.pi**2 * 4e-6 / 0.01**2
    stiff = _robot(tmp_path, RODS, tendons__bending_stiffness=4e-6)
    assert euler == pytest.approx(0.395, abs=5e-4)
    assert bs.solve(stiff, [0.39, 0.0, -0.39, 0.0]).warnings() == ()
    (said,) = bs.solve(stiff, [0.4, 0.0, -0.4, 0.0]).warnings()
    assert said == (
        "rod 3 carries 0.4 N of compression and buckles between two disks 10 mm apart at 0.395 N "
        "(Euler's load of hinged ends): take a stiffer rod or more disks."
    )


def test_inverse_kinematics_announces_rods_that_buckle(
    tmp_path: Path, rods: bs.Robot, shell: Shell
) -> None:
    x, y, z = 1e3 * bs.solve(rods, [1.0, 0.0, -1.0, 0.0]).tip.position
    file, tip = str(tmp_path / "robot.yaml"), f"{x} mm,{y} mm,{z} mm"
    code, _, err = shell("ik", file, "--tip", tip, "--max-tension", "2 N")
    assert code == 0, err
    assert "under compression, and whether" in err


def test_shares_of_a_study_push(tmp_path: Path) -> None:
    """A couple of a rod that pulls and one that pushes, in which the modules bend alike."""
    robot = _robot(tmp_path, RODS, tendons__kind="chamber")
    assert bs.Loading().shares(robot) == (-1.0, 0.0, 0.0, 0.0)
    found = Stages(robot, max_tension=0.4, points=3, tendon={1: -1.0, 3: 1.0})
    assert found.statics.tip_position[-1, 0] < -5e-3
    assert 0.0 < found.comparisons["cc_from_force"].maximum < 1e-3 * robot.length
    plain = bs.load_robot("amouri2019")
    with pytest.raises(
        InputError, match=r"share of tendon 1 is -1\.0; must be above 0 and at most"
    ):
        bs.Loading(tendon={1: -1.0}).shares(plain)


def test_a_budget_assumes_no_friction_of_rods(rods: bs.Robot) -> None:
    rows = Stages(rods, points=2, tendon={1: -1.0}, max_tension=0.4).budget.actuation.rows
    assert rows[0].label == "friction 0, loading"
    assert rows[0].assumed == ()
    # rods that hold the displacements of the arc keep the tip near it
    commanded = next(row for row in rows if row.effect == "tendon_elasticity")
    assert commanded.case.tip_position[-1, 0] < -1e-3


def test_a_tendon_in_a_list_still_only_pulls(tmp_path: Path) -> None:
    tendons = [
        {"angle": 0.0, "pitch_radius": RADIUS, "kind": "chamber"},
        {"angle": math.pi, "pitch_radius": RADIUS},
    ]
    robot = _robot(tmp_path, CHAMBERS, tendons=tendons)
    assert bs.solve(robot, [-1.0, 0.5]).converged
    with pytest.raises(
        InputError, match=r"tension of tendon 2 is -0\.5 N, it must be zero or more"
    ):
        bs.solve(robot, [-1.0, -0.5])
    with pytest.raises(InputError, match=r"tension 2 is -0\.5 N; tensions must be >= 0 N"):
        RobotArcs.from_tensions(robot, [-1.0, -0.5])
    assert bs.sweep(robot, [[-1.0, 0.0], [0.0, 0.2]]).converged.all()


def test_pressures_are_commands(shell: Shell, tmp_path: Path, chambers: bs.Robot) -> None:
    file = str(tmp_path / "robot.yaml")
    found = shell.json("solve", file, "--pressure", "12 kPa,0,3 kPa")
    assert found["tensions_N"] == pytest.approx([-1.8, 0.0, -0.45])
    same = bs.solve(chambers, [-1.8, 0.0, -0.45]).tip.position
    assert found["tip"]["position_m"] == pytest.approx(same)
    mixed = shell.json("solve", file, "--pressure", "12 kPa,-,-", "--tension", "-,1,0")
    assert mixed["tensions_N"] == pytest.approx([-1.8, 1.0, 0.0])
    no_area = _robot(tmp_path, CHAMBERS.replace(", area: 1.5 cm^2", ""))
    assert np.isnan(no_area.tendons.area_m2).all()
    refused = shell.error("solve", file, "--pressure", "12 kPa,0,0")
    assert "--pressure: tendon 1 of robot has no area" in refused


def test_a_fit_takes_tensions_of_rods_with_their_sign(rods: bs.Robot, tmp_path: Path) -> None:
    """E is found although each rod pushes in half the rows; offsets begin at zero."""
    phase = 2.0 * math.pi * np.arange(12) / 12
    pull, push = 1.5 * np.sin(phase), np.sin(2.0 * phase)
    tensions = np.stack([pull, push, -pull, -push], axis=1)
    tips = [1e3 * bs.solve(rods, row).tip.position for row in tensions]
    rows = np.hstack([tensions, tips]).tolist()
    header = "tension_1_N,tension_2_N,tension_3_N,tension_4_N,tip_x_mm,tip_y_mm,tip_z_mm"
    file = tmp_path / "rods.csv"
    file.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    data = read_measurements(file, rods)
    young = "segments.0.backbone.E"
    assert calibrate(rods, data, [young]).fit.values[young] == pytest.approx(58e9, rel=1e-5)
    found = calibrate(rods, data, [young, Prior("offset.tendons", 0.01)])
    assert found.tendons.found == "as_stated" and "leaves 0 %" in found.tendons.sentence
    assert max(abs(v) for k, v in found.fit.values.items() if k != young) < 1e-3
    rested = [row[:4] for row in (0.05 * np.array([[1], [-1], [0]]) * np.ones(4)).tolist()]
    at_rest = bs.solve(rods, np.zeros(4)).tip.position * 1e3
    rows = [[*row, *at_rest] for row in rested] + rows
    text = "\n".join(["# zero: rows 1-3", header, *(",".join(map(str, row)) for row in rows)])
    file.write_text(text + "\n")
    data = read_measurements(file, rods)
    assert data.zero_error is not None and data.zero_error.all()
    assert calibrate(rods, data, [young]).fit.values[young] == pytest.approx(58e9, rel=1e-3)


@pytest.mark.parametrize(("share", "said"), [(0.09, None), (0.11, "stretch"), (-0.11, "compress")])
def test_a_backbone_that_is_stretched_far_is_named(
    chambers: bs.Robot, share: float, said: str | None
) -> None:
    """Mean extension is the sum of the forces over E A."""
    robot = chambers.with_({"segments.*.tendons.kind": "rod", "segments.*.tendons.area": None})
    found = bs.solve(robot, np.full(3, -share * robot.axial_stiffness[0] / 3))
    extension = found.tip.position[2] / robot.length - 1.0
    assert extension == pytest.approx(share, rel=0.1)
    told = [text for text in found.warnings() if "linearly elastic" in text]
    assert len(told) == (said is not None)
    assert said is None or told[0].startswith(f"the tensions {said} the backbone by about 11 %.")


@pytest.mark.parametrize("points", [0, 2])
def test_a_motion_names_its_largest_tensions(chambers: bs.Robot, points: int) -> None:
    """They lie between two outputs; rows of fields have those at the outputs alone."""
    each = 0.12 * chambers.axial_stiffness[0] / 3 * np.ones(3)
    table = bs.dynamics.Table([0.0, 0.05, 0.1], [0 * each, -each, 0 * each])
    options = {"model": bs.RodModel(elements=1), "output": bs.Output(every=0.05, points=points)}
    run = bs.simulate(chambers, table, 0.1, **options)
    (told,) = run.exceeded
    assert told.startswith("the tensions stretch the backbone by about 12 %.")
    assert bs.simulate(chambers, table, 0.03, **options).exceeded == ()


def test_commands_warn_of_a_stretched_backbone_in_the_same_words(
    chambers: bs.Robot, tmp_path: Path, shell: Shell
) -> None:
    force = -0.12 * chambers.axial_stiffness[0] / 3
    given = [str(tmp_path / "robot.yaml"), "--tension", ",".join(3 * [f"{force:.6g}"])]
    flags = {"solve": [], "modes": [], "simulate": ["--rise", "0.1", "--hold", "0"]}
    _, _, told = shell("solve", *given)
    assert "the tensions stretch the backbone by about 12 %." in " ".join(told.split())
    for command, more in flags.items():
        assert shell(command, *given, *more)[2] == told
        (said,) = shell.json(command, *given, *more)["warnings"]
        assert "the tensions stretch the backbone by about 12 %." in said


def test_of_several_poses_the_one_that_stretches_most_is_named(chambers: bs.Robot) -> None:
    force = 0.06 * chambers.axial_stiffness[0] * np.eye(3)  # 6 % in each row, 18 % in sum
    rows = np.vstack([-force, np.full(3, np.nan)])
    assert buckled_or_stretched(chambers, rows, bs.RodModel()) == []
    assert buckled_or_stretched(chambers, rows[-1], bs.RodModel()) == []
    rows[0] *= 2.0
    (told,) = buckled_or_stretched(chambers, rows, bs.RodModel())
    assert "stretch the backbone by about 12 %" in told
    assert buckled_or_stretched(chambers, rows, bs.RodModel("kirchhoff")) == []
    rao = bs.load_robot("rao2021")
    (told,) = buckled_or_stretched(rao, np.full(6, 0.05 * rao.axial_stiffness[0]), bs.RodModel())
    assert "compress the backbone of segment 1 by about 30 %" in told
