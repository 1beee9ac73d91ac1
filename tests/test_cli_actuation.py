"""`solve`, `simulate` and `modes` with actuated tendons, motor angles, friction and histories."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics.load_history import Table, ramp
from shell import Shell

SOLVE = ("solve", "amouri2019")
WITH_FRICTION = ("--set", "segments.0.tendons.friction=0.1")
SPOOL = ("--set", "segments.0.tendons.spool_radius=10 mm")
SIMULATE = ("simulate", "amouri2019")
BRIEF = ("--rise", "0.1", "--hold", "0.1")
NAN = float("nan")


def test_displacements(shell: Shell) -> None:
    found = shell.json(*SOLVE, "--displacement", "20 mm,-0.03,-3 cm")
    expected = bs.solve(
        bs.load_robot("amouri2019"), load=bs.Load(displacements=[0.02, -0.03, -0.03])
    )
    assert expected.tip is not None
    np.testing.assert_array_equal(found["tip"]["position_m"], expected.tip.position)
    assert found["status"] == "converged" and found["stable"] is True
    assert found["displacements_m"] == [0.02, -0.03, -0.03]
    assert found["slack"] == [2, 3] and found["slack_m"][0] == 0
    assert found["tensions_N"][1:] == [0, 0] and found["undetermined"] is False
    assert len(found["span_tensions_N"]) == 9 and found["length_residual_m"] < 1e-12
    settings = found["provenance"]["settings"]
    assert settings["displacements_m"] == [0.02, -0.03, -0.03] and settings["tensions_N"] is None


@pytest.mark.parametrize(
    ("tension", "displacement"),
    [("5,-,-", "-,2 mm,-1 mm"), ("5,,", ",0.002,-0.001"), ("5, - ,", " -,2000 um , -0.1 cm")],
)
def test_mixed_tension_and_displacement_control(
    shell: Shell, tension: str, displacement: str
) -> None:
    found = shell.json(*SOLVE, "--tension", tension, "--displacement", displacement)
    expected = bs.solve(
        bs.load_robot("amouri2019"),
        [5, None, None],
        load=bs.Load(displacements=[None, 0.002, -0.001]),
    )
    assert found["tensions_N"] == expected.tensions.tolist() and found["tensions_N"][0] == 5


def test_angles(shell: Shell) -> None:
    spool = ("--set", "segments.0.tendons.spool_radius=10 mm")
    angle = shell.json(*SOLVE, *spool, "--angle", "2,-3,-180 deg")
    displacement = shell.json(*SOLVE, *spool, "--displacement", f"0.02,-0.03,{-0.01 * np.pi}")
    assert angle["tip"]["position_m"] == pytest.approx(displacement["tip"]["position_m"], abs=1e-12)
    mixed = shell.json(
        *SOLVE, *spool, "--angle", "2,-,-", "--tension", "-,0,-", "--displacement", "-,-,-0.03"
    )
    assert mixed["displacements_m"][0] == 0.02 and mixed["displacements_m"][2] == -0.03


def test_tension_control_reports_displacements(shell: Shell) -> None:
    found = shell.json(*SOLVE, "--tension", "80,0,0")
    assert found["displacements_m"] == pytest.approx([0.042057, -0.019898, -0.019898], abs=1e-6)
    assert found["slack"] == [] and found["slack_m"] == [0, 0, 0]
    assert found["span_tensions_N"] == [[80, 0, 0]] * 9
    rao = shell.json("solve", "rao2021", "--tension", "1,0,0,1,0,0")
    assert rao["span_tensions_N"][10] == [None, None, None, 1, 0, 0]


def test_the_terminal_shows_a_table(shell: Shell) -> None:
    code, out, err = shell(*SOLVE, "--displacement", "0.02,-0.03,-0.03")
    assert code == 0 and not err
    header = next(line for line in out.splitlines() if line.startswith("tendon"))
    for word in ("tension N", "length mm", "displacement mm", "slack mm"):
        assert word in header
    assert "20.287" in out and "Tendons 2 and 3 are slack." in " ".join(out.split())


def test_history_goes_through_files(shell: Shell, tmp_path: Path) -> None:
    robot = bs.load_robot("amouri2019", {"segments.0.tendons.friction": 0.1})
    path = bs.sweep(robot, [[40, 0, 0], [20, 0, 0], [10, 0, 0]])
    file = tmp_path / "path.json"
    last = None
    for i, tension in enumerate(("40,0,0", "20,0,0", "10,0,0")):
        before = ["--history", str(file)] if i else []
        arguments = ("--tension", tension, *before, "--save-history", str(file))
        last = shell.json(*SOLVE, *WITH_FRICTION, *arguments)
        assert last["tip"]["position_m"] == pytest.approx(path.tip_position[i], abs=1e-9)
    assert last is not None and last["provenance"]["settings"]["history"] == str(file)
    assert json.loads(file.read_text())["robot_hash"] == robot.hash
    assert [p.name for p in tmp_path.iterdir()] == ["path.json"]
    assert last["stable"] is None and last["span_tensions_N"][8][0] < 10.5


def test_no_equilibrium(shell: Shell, tmp_path: Path) -> None:
    displacements = ("--displacement", "0.03,0.03,0.03", "--theory", "kirchhoff")
    file = tmp_path / "path.json"
    code, out, err = shell(*SOLVE, *displacements, "--save-history", str(file))
    assert code == 1 and not out and not file.exists()
    assert "tendons 1, 2 and 3 have conflicting displacements" in err
    assert "The nearest that have one are 0, 0, 0 mm." in err
    code, out, err = shell(*SOLVE, *displacements, "--json")
    content = json.loads(out, parse_constant=pytest.fail)
    assert code == 1 and content["status"] == "no_equilibrium" and content["tip"] is None
    assert content["displacements_m"] is None and content["slack"] is None
    assert "have conflicting displacements" in content["message"]


def test_a_history_of_another_robot(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "path.json"
    upright = ("--set", "gravity=0 0 1")
    shell.json(*SOLVE, "--displacement", "0.01,-0.02,-0.02", "--save-history", str(file), *upright)
    again = ("--history", str(file))
    assert "of another robot" in shell.error(*SOLVE, "--displacement", "0,0,0", *again)
    assert "of another robot" in shell.error("solve", "rao2021", "--tension", "1,0,0,0,0,0", *again)
    kirchhoff = ("--theory", "kirchhoff", *upright)
    assert "made with theory 'cosserat'" in shell.error(
        *SOLVE, "--displacement=0,0,0", *kirchhoff, *again
    )
    file.write_text("[1, 2]")
    assert "is no history" in shell.error(*SOLVE, "--displacement", "0,0,0", *again)
    file.write_text("[" * 100_000)
    assert "is no JSON" in shell.error(*SOLVE, "--displacement", "0,0,0", *again)


# -- simulate and modes ------------------------------------------------------------------------


def spooled() -> bs.Robot:
    return bs.load_robot("amouri2019", {"segments.0.tendons.spool_radius": "10 mm"})


def test_motion_by_mixed_control_from_a_start(shell: Shell) -> None:
    """Entries omitted in a list of the start are zero."""
    flags = ("--tension", "5,-,-", "--displacement", "-,2 mm,-", "--angle=-,-,-0.1")
    found = shell.json(*SIMULATE, *SPOOL, *flags, "--from-displacement=-,1 mm,0.5 mm", *BRIEF)
    expected = bs.simulate(
        spooled(),
        Table([0, 0.1], [[0, NAN, NAN], [5, NAN, NAN]]),
        0.2,
        load=bs.Load(
            displacements=Table([0, 0.1], [[NAN, 0.001, NAN], [NAN, 0.002, NAN]]),
            angles=Table([0, 0.1], [[NAN, NAN, 0.05], [NAN, NAN, -0.1]]),
        ),
    )
    np.testing.assert_allclose(found["tip_position_m"], expected.tip_position, atol=1e-9)
    assert found["tip_position_m"][0][1] != 0


TABLE = "t_s,tension_1_N,displacement_2_mm,angle_3_deg\n0,0,0,0\n0.1,5,1,-10\n0.2,5,1,-10\n"


def test_a_table_of_mixed_columns(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "mixed.csv"
    path.write_text(TABLE)
    found = shell.json(*SIMULATE, *SPOOL, "--table", str(path))
    run = bs.simulate(
        spooled(),
        ramp([5, NAN, NAN], 0.1),
        0.2,
        load=bs.Load(
            displacements=ramp([NAN, 0.001, NAN], 0.1),
            angles=ramp([NAN, NAN, np.deg2rad(-10)], 0.1),
        ),
    )
    np.testing.assert_allclose(found["tip_position_m"], run.tip_position, atol=1e-9)
    started = shell.json(*SIMULATE, *SPOOL, "--table", str(path), "--from", "1,-,-")
    settings = started["provenance"]["settings"]
    assert settings["initial_tensions_N"] == [1, None, None]
    assert settings["initial_displacements_m"] == [None, 0, 0]
    assert "has no spool_radius" in shell.error(*SIMULATE, "--table", str(path))


def test_modes_after_a_history(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "path.json"
    shell.json(*SOLVE, *WITH_FRICTION, "--tension", "40,0,0", "--save-history", str(file))
    flags = ("--tension", "20,0,0", "--count", "1", "--history", str(file))
    back = shell.json("modes", "amouri2019", *WITH_FRICTION, *flags)
    assert back["provenance"]["settings"]["history"] == str(file)
    robot = bs.load_robot("amouri2019", {"segments.0.tendons.friction": "0.1"})
    known = bs.modes(robot, [20, 0, 0], count=1, history=json.loads(file.read_text()))
    assert back["modes"][0]["frequency_hz"] == known.frequency_hz[0]


def test_motion_with_friction_goes_on_from_a_history(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "path.json"
    kept = ("--history", str(file), "--save-history", str(file))
    shell.json(*SOLVE, *WITH_FRICTION, "--tension", "40,0,0", *kept[2:])
    loaded = shell.json(*SOLVE, *WITH_FRICTION, "--tension", "20,0,0", *kept)
    flags = ("--tension", "20,0,0", "--from", "20,0,0", *kept[:2], *BRIEF)
    found = shell.json(*SIMULATE, *WITH_FRICTION, *flags, "--modal-damping", "5 %")
    tip = np.array(found["tip_position_m"])
    np.testing.assert_allclose(tip, [loaded["tip"]["position_m"]] * len(tip), atol=1e-8)
    assert "of another robot" in shell.error(*SIMULATE, *flags)


def test_modes_of_displacements(shell: Shell) -> None:
    robot = spooled()
    expected = bs.modes(robot, load=bs.Load(displacements=[0.02, -0.03, -0.03]))
    found = shell.json("modes", "amouri2019", "--displacement", "20 mm,-30 mm,-30 mm")
    assert [m["frequency_hz"] for m in found["modes"]] == pytest.approx(expected.frequency_hz)
    assert found["tensions_N"] == pytest.approx(expected.tensions)
    turned = shell.json("modes", "amouri2019", *SPOOL, "--angle=2,-3,-3")
    assert turned["modes"][0]["frequency_hz"] == pytest.approx(expected.frequency_hz[0])
    assert found["provenance"]["settings"]["displacements_m"] == [0.02, -0.03, -0.03]
