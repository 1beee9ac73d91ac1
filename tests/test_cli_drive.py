"""The command `solve` with pulled tendons, motor angles and histories."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from shell import Shell, refuses

SOLVE = ("solve", "amouri2019")
RUBS = ("--set", "segments.0.tendons.friction=0.1")


def test_pulls(shell: Shell) -> None:
    found = shell.json(*SOLVE, "--pull", "20 mm,-0.03,-3 cm")
    expected = bs.solve(bs.load_robot("amouri2019"), pulls=[0.02, -0.03, -0.03])
    assert expected.tip is not None
    np.testing.assert_array_equal(found["tip"]["position_m"], expected.tip.position)
    assert found["status"] == "converged" and found["stable"] is True
    assert found["pulls_m"] == [0.02, -0.03, -0.03]
    assert found["slack"] == [2, 3] and found["slack_m"][0] == 0
    assert found["tensions_N"][1:] == [0, 0] and found["undetermined"] is False
    assert len(found["span_tensions_N"]) == 9 and found["length_residual_m"] < 1e-12
    settings = found["provenance"]["settings"]
    assert settings["pulls_m"] == [0.02, -0.03, -0.03] and settings["tensions_N"] is None


@pytest.mark.parametrize(
    ("tension", "pull"),
    [("5,-,-", "-,2 mm,-1 mm"), ("5,,", ",0.002,-0.001"), ("5, - ,", " -,2000 um , -0.1 cm")],
)
def test_a_mix(shell: Shell, tension: str, pull: str) -> None:
    found = shell.json(*SOLVE, "--tension", tension, "--pull", pull)
    expected = bs.solve(bs.load_robot("amouri2019"), [5, None, None], pulls=[None, 0.002, -0.001])
    assert found["tensions_N"] == expected.tensions.tolist() and found["tensions_N"][0] == 5


def test_angles(shell: Shell) -> None:
    spool = ("--set", "segments.0.tendons.spool_radius=10 mm")
    angle = shell.json(*SOLVE, *spool, "--angle", "2,-3,-180 deg")
    pull = shell.json(*SOLVE, *spool, "--pull", f"0.02,-0.03,{-0.01 * np.pi}")
    assert angle["tip"]["position_m"] == pytest.approx(pull["tip"]["position_m"], abs=1e-12)
    mixed = shell.json(
        *SOLVE, *spool, "--angle", "2,-,-", "--tension", "-,0,-", "--pull", "-,-,-0.03"
    )
    assert mixed["pulls_m"][0] == 0.02 and mixed["pulls_m"][2] == -0.03


def test_by_tensions_pulls_are_told(shell: Shell) -> None:
    found = shell.json(*SOLVE, "--tension", "80,0,0")
    assert found["pulls_m"] == pytest.approx([0.042057, -0.019898, -0.019898], abs=1e-6)
    assert found["slack"] == [] and found["slack_m"] == [0, 0, 0]
    assert found["span_tensions_N"] == [[80, 0, 0]] * 9
    rao = shell.json("solve", "rao2021", "--tension", "1,0,0,1,0,0")
    assert rao["span_tensions_N"][10] == [None, None, None, 1, 0, 0]


def test_people_see_a_table(shell: Shell) -> None:
    code, out, err = shell(*SOLVE, "--pull", "0.02,-0.03,-0.03")
    assert code == 0 and not err
    header = next(line for line in out.splitlines() if line.startswith("tendon"))
    for word in ("tension N", "length mm", "pull mm", "slack mm"):
        assert word in header
    assert "20.287" in out and "Tendons 2 and 3 hang slack." in " ".join(out.split())


def test_history_goes_through_files(shell: Shell, tmp_path: Path) -> None:
    robot = bs.load_robot("amouri2019", {"segments.0.tendons.friction": 0.1})
    path = bs.sweep(robot, [[40, 0, 0], [20, 0, 0], [10, 0, 0]])
    file = tmp_path / "path.json"
    last = None
    for i, tension in enumerate(("40,0,0", "20,0,0", "10,0,0")):
        before = ["--history", str(file)] if i else []
        arguments = ("--tension", tension, *before, "--save-history", str(file))
        last = shell.json(*SOLVE, *RUBS, *arguments)
        assert last["tip"]["position_m"] == pytest.approx(path.tip_position[i], abs=1e-9)
    assert last is not None and last["provenance"]["settings"]["history"] == str(file)
    assert json.loads(file.read_text())["robot_hash"] == robot.hash
    assert [p.name for p in tmp_path.iterdir()] == ["path.json"]
    assert last["stable"] is None and last["span_tensions_N"][8][0] < 10.5


def test_no_equilibrium(shell: Shell, tmp_path: Path) -> None:
    pulls = ("--pull", "0.03,0.03,0.03", "--theory", "kirchhoff")
    file = tmp_path / "path.json"
    code, out, err = shell(*SOLVE, *pulls, "--save-history", str(file))
    assert code == 1 and not out and not file.exists()
    assert "tendons 1, 2 and 3 pull against each other" in err
    assert "The nearest that have one are 0, 0, 0 mm." in err
    code, out, err = shell(*SOLVE, *pulls, "--json")
    content = json.loads(out, parse_constant=pytest.fail)
    assert code == 1 and content["status"] == "no_equilibrium" and content["tip"] is None
    assert content["pulls_m"] is None and content["slack"] is None
    assert "fight" not in content["message"] and "pull against each other" in content["message"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], "give --tension T1,T2,..., --pull P1,P2,... or --angle A1,A2,..."),
        (["--pull", "1,2"], "--pull: got 2 numbers;"),
        (["--pull", "0,0,0,0"], "--pull: got 4 numbers;"),
        (["--pull", ""], "--pull: got "),
        (["--pull", "0.01,-,0"], 'got "-", which is not a number'),
        (["--pull", "0.01,,0"], "got nothing"),
        (["--pull", "1 N,0,0"], '"N" is not a unit of length'),
        (["--pull", "nan,0,0"], "not a number"),
        (["--pull", "1,0,0"], "it must be less than the tendon's length, 0.641 m"),
        (["--angle", "1,0,0"], "tendon 1 of amouri2019 has no spool_radius"),
        (["--angle", "1 mm,0,0"], "is not a unit of"),
        (["--tension", "1,-,-", "--pull", "0.01,0,0"], "tendon 1 has --tension and --pull"),
        (["--tension", "1,-,-", "--pull", "-,0,-"], "tendon 3 is driven by nothing"),
        (["--tension", "1,-", "--pull", "-,0,-"], "--tension: got 2 entries;"),
        (["--tension", "-1,-,-", "--pull", "-,0,0"], "a tendon cannot push"),
        (["--tension", "1,-,-", "--pull", "-,x,0"], '--pull: got "x", which is not a number'),
        (["--pull", "0,0,0", "--history", "none.json"], "--history: none.json cannot be read"),
        (["--pull", "0,0,0", "--history", "mine"], "--history: mine cannot be read"),
        (["--pull", "0,0,0", "--history", "mine/notes.txt"], "is no JSON"),
        (["--pull", "0,0,0", "--save-history", "no/a.json"], "--save-history: cannot write no/a"),
        (["--pull", "0,0,0", "--save-history", "mine"], "it is a folder"),
    ],
)
def test_bad_input(
    shell: Shell,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    says: str,
) -> None:
    refuses(shell, tmp_path, monkeypatch, says, *SOLVE, *arguments)


def test_a_history_of_something_else(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "path.json"
    upright = ("--set", "gravity=0 0 1")
    shell.json(*SOLVE, "--pull", "0.01,-0.02,-0.02", "--save-history", str(file), *upright)
    again = ("--history", str(file))
    assert "of another robot" in shell.error(*SOLVE, "--pull", "0,0,0", *again)
    assert "of another robot" in shell.error("solve", "rao2021", "--tension", "1,0,0,0,0,0", *again)
    kirchhoff = ("--theory", "kirchhoff", *upright)
    assert "made with theory 'cosserat'" in shell.error(*SOLVE, "--pull=0,0,0", *kirchhoff, *again)
    file.write_text("[1, 2]")
    assert "is no history" in shell.error(*SOLVE, "--pull", "0,0,0", *again)
    file.write_text("[" * 100_000)
    assert "is no JSON" in shell.error(*SOLVE, "--pull", "0,0,0", *again)
