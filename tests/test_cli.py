"""The command line: its contract (docs/reference/cli.md), its exit codes, and its errors."""

from __future__ import annotations

import contextlib
import io
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

import bowstring as bs
from bowstring.cli import main
from bowstring.robot import reader
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.study import run as study_module
from bowstring.study.report import refuse_other_robot
from bowstring.study.study import Study
from shell import Shell, adapter, process
from stages import Stages, by_name

ROOT = Path(__file__).parents[1]
SETTINGS = (
    *("tolerance", "max_tension", "points", "tendon"),
    *("theory", "rise", "modal_damping"),
)


# -- the contract ------------------------------------------------------------------------------


def test_robots(shell: Shell) -> None:
    found = shell.json("robots")
    assert [robot["name"] for robot in found["robots"]] == bs.robot_names()
    assert found["robots"][0]["length_m"] == 0.641
    code, out, err = shell("robots")
    assert code == 0 and "amouri2019" in out and not err


def test_schema(shell: Shell) -> None:
    for arguments in (["schema"], ["schema", "--json"]):
        code, out, err = shell(*arguments)
        assert code == 0 and not err
        schema = json.loads(out)
        Draft202012Validator.check_schema(schema)
        assert schema == bs.robot_schema()


def test_fk(shell: Shell) -> None:
    found = shell.json("fk", "amouri2019", "--lengths", "612 mm,0.6555,65.55 cm")
    (segment,) = found["segments"]
    assert set(segment) == {"kappa_per_m", "phi_rad", "theta_rad", "length_m", "misfit_m"}
    assert segment["theta_rad"] == pytest.approx(1.0, rel=1e-12)  # displacement = theta r = 29 mm
    assert segment["length_m"] == pytest.approx(0.641, rel=1e-12)
    expected = bs.constant_curvature.RobotArcs.from_lengths(
        bs.load_robot("amouri2019"), [0.612, 0.6555, 0.6555]
    )
    np.testing.assert_array_equal(found["tip"]["position_m"], expected.tip.position)
    np.testing.assert_array_equal(found["tip"]["rotation"], expected.tip.rotation)


@pytest.mark.parametrize("options", [[], ["--chord"]])
def test_ik_inverts_fk(shell: Shell, options: list[str]) -> None:
    tip = shell.json("fk", "amouri2019", "--lengths", "0.612,0.64,0.67", *options)["tip"]
    point = ",".join(map(repr, tip["position_m"]))
    options = ["--model", "cc", "--free-length", *options]
    found = shell.json("ik", "amouri2019", "--tip", point, *options)
    assert found["tendon_lengths_m"] == pytest.approx([0.612, 0.64, 0.67], rel=1e-12)
    assert found["distance_m"] == 0


def test_ik_reports_its_distance(shell: Shell) -> None:
    arguments = ("ik", "amouri2019", "--tip", "100 mm,0,0.5", "--model", "cc")
    found = shell.json(*arguments)
    assert found["segments"][0]["length_m"] == 0.641
    distance = np.linalg.norm(np.subtract(found["tip"]["position_m"], [0.1, 0, 0.5]))
    assert found["distance_m"] == pytest.approx(distance) and distance > 0.05
    code, out, _ = shell(*arguments)
    assert code == 0 and f"misses the point by {1e3 * distance:.3f} mm" in out


def test_solve(shell: Shell) -> None:
    found = shell.json("solve", "amouri2019", "--tension", "80,0,0")
    assert found["status"] == "converged" and found["stable"] is True
    assert found["theory"] == "cosserat"
    assert found["residual"] < 1e-8 and found["iterations"] > 0
    assert len(found["disks"]) == 9
    assert found["disks"][-1] == found["tip"]
    assert found["tensions_N"] == [80, 0, 0]
    expected = bs.solve(bs.load_robot("amouri2019"), [80, 0, 0])
    assert expected.tip is not None
    np.testing.assert_array_equal(found["tip"]["position_m"], expected.tip.position)
    np.testing.assert_array_equal(found["tip"]["rotation"], expected.tip.rotation)
    np.testing.assert_array_equal(found["tendon_lengths_m"], expected.tendon_lengths)
    # body to base: the tip looks towards +x, where tendon 1 is
    assert found["tip"]["rotation"][0][2] > 0.9
    assert found["provenance"]["robot_hash"] == bs.load_robot("amouri2019").hash


def test_solve_without_a_command_gives_the_pose_under_weight(shell: Shell) -> None:
    found = shell.json("solve", "amouri2019", "--gravity", "9.81,0,0")
    slack = shell.json("solve", "amouri2019", "--gravity", "9.81,0,0", "--tension", "0,0,0")
    assert found == slack and found["tip"]["position_m"][0] > 0.01
    error = shell.error("solve", "amouri2019", "--residual", "residual.json")
    assert error.startswith("no tendon has a command")


def test_solve_loads_may_be_negative_and_carry_units(shell: Shell) -> None:
    plain = shell.json(
        *("solve", "amouri2019", "--theory", "kirchhoff", "--tension", "10,20,0"),
        *("--gravity", "0,0,-9.81", "--tip-force", "-1,0.5,0", "--tip-moment", "-0.1,0,0.05"),
    )
    units = shell.json(
        *("solve", "amouri2019", "--theory=kirchhoff", "--tension", "10 N,20000mN,0"),
        *("--gravity=0,0,-981 cm/s^2", "--tip-force", "-1 N,0.5,0"),
        *("--tip-moment", "-100 N mm,0,50 mN*m"),
    )
    assert plain["theory"] == "kirchhoff"
    assert units["tip"]["position_m"] == pytest.approx(plain["tip"]["position_m"], rel=1e-9)
    expected = bs.solve(
        bs.load_robot("amouri2019"),
        [10, 20, 0],
        load=bs.Load(gravity=(0, 0, -9.81), tip_force=(-1, 0.5, 0), tip_moment=(-0.1, 0, 0.05)),
        model=bs.RodModel("kirchhoff"),
    )
    assert expected.tip is not None
    np.testing.assert_array_equal(plain["tip"]["position_m"], expected.tip.position)


def test_set_is_repeatable(shell: Shell) -> None:
    found = shell.json(
        *("solve", "amouri2019", "--tension", "80,0,0"),
        *("--set", "segments.0.disks.clamped_length=3 mm", "--set", "segments.0.disks.count=5"),
    )
    robot = bs.load_robot(
        "amouri2019", {"segments.0.disks.clamped_length": 0.003, "segments.0.disks.count": 5}
    )
    assert len(found["disks"]) == 5
    assert found["provenance"]["robot_hash"] == robot.hash


def test_warnings_go_to_stderr_and_into_json(shell: Shell) -> None:
    arguments = ["solve", "amouri2019", "--tension", "0,0,0"]
    arguments += ["--set", "segments.0.backbone.E=35 MPa", "--json"]
    code, out, err = shell(*arguments)
    assert code == 0
    assert err.startswith("Warning: segments[0].backbone.E = 35 MPa") and err.count("\n") == 1
    (warning,) = json.loads(out)["warnings"]
    assert err == f"Warning: {warning}\n"


def test_tables_are_for_people(shell: Shell) -> None:
    code, out, err = shell("solve", "amouri2019", "--tension", "80,0,0")
    assert code == 0 and not err
    assert "384.556" in out and "A stable equilibrium" in out
    assert "-0.000" not in out
    code, out, _ = shell("fk", "amouri2019", "--lengths", "0.612,0.6555,0.6555")
    assert code == 0 and "57.296" in out


def test_help_and_version(shell: Shell) -> None:
    code, out, err = shell("--version")
    assert code == 0 and not err
    assert re.fullmatch(rf"bowstring {bs.__version__} \(Python [\d.]+, .*instructions\)\n", out)
    code, out, err = shell()
    assert code == 0 and "solve" in out and not err
    for command in ("robots", "schema", "fk", "ik", "solve", "study"):
        code, out, err = shell(command, "--help")
        assert code == 0 and "--json" in out and not err


def test_doctor_reports_missing_parts(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    extras = "build123d openpyxl mcap h5py SALib distributed jax gymnasium viser rerun torch"
    for extra in extras.split():
        monkeypatch.setitem(sys.modules, extra, None)
    monkeypatch.setenv("PATH", "")
    parts = {part["name"]: part for part in shell.json("doctor")["optional"]}
    assert parts["requests"]["version"] and parts["requests"]["problem"] is None
    assert parts["requests"]["requirement"] == "bowstring[download]"
    del parts["requests"]
    assert {name: part["cure"].split(" ")[-1] for name, part in parts.items()} == {
        "build123d": "'bowstring[cad]'",
        "openpyxl": "'bowstring[excel]'",
        "mcap": "'bowstring[rosbag]'",
        "h5py": "'bowstring[matlab]'",
        "SALib": "'bowstring[uncertainty]'",
        "distributed": "'bowstring[cluster]'",
        "jax": "'bowstring[jax]'",
        "gymnasium": "'bowstring[gymnasium]'",
        "viser": "'bowstring[view]'",
        "rerun": "'bowstring[rerun]'",
        "torch": "torch",
        "CalculiX": "https://www.calculix.de",
        "ffmpeg": "https://ffmpeg.org",
    }
    code, out, _ = shell("doctor")
    said = " ".join(out.split())
    assert code == 0
    for name, part in parts.items():
        assert part["version"] is None and part["problem"] in said
        assert f"{name} no {part['requirement'] or '-'} {part['needed_for']}" in said
    assert "requests" in said and "bowstring[download]" in said


def test_doctor_shows_the_version_that_a_module_states(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = ModuleType("rerun")  # whose package has another name
    module.__version__ = "0.99.1"  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "rerun", module)
    parts = {part["name"]: part for part in shell.json("doctor")["optional"]}
    assert parts["rerun"]["version"] == "0.99.1" and parts["rerun"]["problem"] is None


def test_study(studied: tuple[Path, str]) -> None:
    folder, said = studied
    assert said.count("\n") == 1
    adapter("study").validate_json(said, strict=True)
    found = json.loads(said, parse_constant=pytest.fail)
    assert found["robot"] == "amouri2019" and found["length_m"] == 0.641
    means = [(c["against"], c["name"], round(c["mean_mm"], 2)) for c in found["comparisons"]]
    assert means == [
        ("statics", "cc_from_lengths", 0.23),
        ("statics", "cc_from_force", 4.42),
        ("statics", "cc_from_lengths_chord", 0.0),
        ("statics", "cc_from_force_arm", 0.05),
        ("dynamics", "cc_from_lengths", 0.28),
        ("dynamics", "cc_from_force", 4.35),
        ("dynamics", "cc_from_lengths_chord", 0.13),
        ("dynamics", "cc_from_force_arm", 0.46),
        ("statics", "constant_curvature_fit", 0.04),
        ("statics", "linear_curvature_fit", 0.03),
        ("statics", "quadratic_curvature_fit", 0.03),
    ]
    assert {comparison["n"] for comparison in found["comparisons"]} == {17}
    assert found["provenance"]["settings"]["tolerance_percent"] == pytest.approx(1.0)
    assert Path(found["folder"]) == folder
    page = (folder / "report.html").read_text("utf-8")
    assert all(f'id="{figure["stem"]}"' in page for figure in found["figures"])
    assert not (folder / "figures").exists()  # only on request
    assert (folder / "study.json").is_file()


@pytest.mark.slow
def test_study_of_a_user_robot(
    shell: Shell, paper: Study, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file of the user with every flag; the report is written where it is stated."""
    clamped = {"segments.0.disks.clamped_length": "2 mm"}
    own = load_robot(ROOT / "examples" / "my_robot.yaml").with_(clamped)

    def run(robot: Robot, **given: Any) -> Study:
        assert robot.hash == own.hash and robot.name == "my_robot"
        given = by_name(given)
        settings = {name: given.pop(name) for name in SETTINGS}
        assert settings == {
            "tolerance": "2 %",
            "max_tension": 5.0,
            "points": 5,
            "tendon": {2: 1.0, 6: 0.5},
            "theory": "kirchhoff",
            "rise": pytest.approx(0.9),
            "modal_damping": pytest.approx(0.02),
        }
        given.pop("progress")("verdict", 1.0)
        assert not any(given.values())  # no measurements, mapping, solid, finite elements
        stages = Stages(robot, **settings)
        judged = stages.judged(paper.budget)
        return replace(stages.over(paper), dynamics=stages.motion, verdict=judged)

    monkeypatch.setattr(study_module, "run_study", run)
    code, out, err = shell(
        *("study", str(ROOT / "examples" / "my_robot.yaml"), "--tolerance", "2 %"),
        *("--max-tension", "5 N", "--points", "5", "--theory", "kirchhoff"),
        *("--rise", "900 ms", "--modal-damping", "2 %", "--tendon", "2,6:50 %"),
        *("--set", "segments.0.disks.clamped_length=2 mm"),
    )
    assert code == 0 and not err, err
    assert "2 % of length" in " ".join(out.split()) and "5 N" in out
    report = Path(out.splitlines()[-1].removeprefix("Report: "))
    assert report == here / "bowstring-study" / "my_robot" / "report.html"
    assert "tendons 2 and 6 (at 0.5 of it)" in report.read_text("utf-8")
    written = json.loads(report.with_name("study.json").read_text("utf-8"))
    assert written["provenance"]["robot_file"] == str(ROOT / "examples" / "my_robot.yaml")


def test_the_study_of_another_robot_file_of_this_name_is_kept(shell: Shell, here: Path) -> None:
    held = str(here / "other.yaml")
    Path(held).touch()
    folder = here / "bowstring-study" / "my_robot"
    folder.mkdir(parents=True)
    former = {"files": ["study.json"], "provenance": {"robot_file": held}}
    (folder / "study.json").write_text(json.dumps(former), "utf-8")
    code, out, err = shell("study", str(ROOT / "examples" / "my_robot.yaml"))
    assert (code, out) == (2, "")
    assert f"holds that of another robot with this name, {held}; name another folder" in err
    Path(held).unlink()  # moved
    refuse_other_robot(folder, "/robots/my_robot.yaml")


def test_study_stopped_half_way_writes_nothing(
    shell: Shell, paper: Study, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(study_module, "run_study", lambda robot, **_: paper)
    monkeypatch.setattr("bowstring.study.figures.draw", Mock(side_effect=KeyboardInterrupt))
    folder = tmp_path / "out"
    code, out, err = shell("study", "--out", str(folder))
    assert (code, out, err) == (130, "", "Stopped: nothing was written.\n")
    assert not list(tmp_path.iterdir())


# -- no solution -------------------------------------------------------------------------------


def test_a_load_without_solution(shell: Shell) -> None:
    """The message says what was reached and what to try; JSON has no unconverged numbers."""
    arguments = ["solve", "amouri2019", "--tension", "80,0,0"]
    arguments += ["--set", "segments.0.backbone.E=35 MPa"]
    code, out, err = shell(*arguments)
    warning, error = err.splitlines()
    assert code == 1 and not out
    assert warning.startswith("Warning: ")
    assert error.startswith("Error: ") and "of the load converged" in error
    found = shell.json(*arguments, code=1)
    assert found["status"] != "converged"
    assert found["tip"] is found["disks"] is found["tendon_lengths_m"] is None


def test_loads_beyond_all_bounds(shell: Shell) -> None:
    for load in ("1e300,0,0", "1e308,1e308,1e308"):
        code, out, err = shell("solve", "amouri2019", "--tension", load)
        assert code in (1, 2) and not out and err.startswith("Error: ") and err.count("\n") == 1


# -- bad input ---------------------------------------------------------------------------------


any_text = given(
    command=st.sampled_from([["fk", "--lengths"], ["solve", "--tension"], ["ik", "--tip"]]),
    text=st.text("0123456789.,-+eE nafi kgNm*/^%µ\n\0\u0663", max_size=40)
    | st.lists(st.floats(), min_size=3, max_size=3).map(lambda v: ",".join(map(repr, v))),
)


@settings(max_examples=20, deadline=None, derandomize=True)
@any_text
def test_some_texts_are_solved_or_refused(command: list[str], text: str) -> None:
    answered_or_refused(command, text)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@any_text
def test_any_text_is_solved_or_refused(command: list[str], text: str) -> None:
    answered_or_refused(command, text)


def answered_or_refused(command: list[str], text: str) -> None:
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main.run([command[0], "amouri2019", f"{command[1]}={text}", "--json"])
    assert code in (0, 1, 2), err.getvalue()
    if code == 2:
        assert not out.getvalue() and err.getvalue().count("\n") == 1
    else:
        json.loads(out.getvalue(), parse_constant=pytest.fail)


# -- the process -------------------------------------------------------------------------------


def test_errors_of_a_process_are_not_on_stdout() -> None:
    done = process("solve", "amouri2019", "--tension", "80,0", "--json")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("Error: ") and done.stderr.count("\n") == 1


def test_figures_need_no_display(tmp_path: Path) -> None:
    env = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    env["MPLBACKEND"] = "TkAgg"  # an interactive backend, as one sets for notebooks
    done = process("modes", "amouri2019", "--out", "modes", cwd=tmp_path, env=env)
    assert (done.returncode, done.stderr) == (0, "")
    assert list((tmp_path / "modes").rglob("*.png"))


@pytest.mark.parametrize(
    "arguments",
    [
        ("solve", "amouri2019", "--tension", "80,0,0"),
        ("simulate", "amouri2019", "--tension", "80,0,0", "--rise", "0.1", "--hold", "0.1"),
    ],
)
def test_no_heavy_library_is_loaded(arguments: tuple[str, ...]) -> None:
    code = (
        "import sys; from bowstring.cli import main as cli;"
        f"code = cli.run([*{arguments!r}, '--json']);"
        "heavy = {'pandas', 'matplotlib', 'xarray', 'pint', 'rich', 'jinja2', 'scipy'};"
        "heavy &= set(sys.modules); sys.exit(repr(heavy) if heavy else code)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout)["status"] == "converged"


@pytest.mark.skipif(os.name == "nt", reason="POSIX pipes")
def test_a_broken_pipe_is_no_error() -> None:
    command = [sys.executable, "-m", "bowstring", "schema"]
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(command, stdout=write, stderr=subprocess.PIPE, text=True, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_reported() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "bowstring", "schema"],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 74
    assert done.stderr == "Error: stdout cannot be written: No space left on device.\n"


def test_ascii_terminal(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    text = (ROOT / "python/bowstring/robot/builtin/amouri2019.yaml").read_text("utf-8")
    path.write_text(text.replace("name: amouri2019", "name: τόξο"), "utf-8")
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = process("solve", str(path), "--tension", "80,0,0", env=environment)
    assert done.returncode == 0 and not done.stderr and "????" in done.stdout


def test_a_bug_is_not_reported_as_bad_input(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "robot_names", Mock(side_effect=ZeroDivisionError))
    code, out, err = shell("robots")
    assert code == 70 and not out
    assert "ZeroDivisionError" in err and err.endswith("report it with the lines above.\n")


@pytest.mark.parametrize(
    "error", [np.linalg.LinAlgError("Singular matrix"), OverflowError("math range error")]
)
def test_a_numerical_exception_is_one_sentence(
    error: Exception, shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "robot_names", Mock(side_effect=error))
    code, out, err = shell("robots")
    assert code == 1 and not out and err.count("\n") == 1
    assert err.startswith("Error: the computation fails for these numbers (in ")
    assert str(error) in err and "Traceback" not in err


def test_stopped_by_the_user(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "robot_names", Mock(side_effect=KeyboardInterrupt))
    assert shell("robots") == (130, "", "Stopped: nothing was written.\n")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize("number", ["SIGINT", "SIGTERM"])
def test_stopped_while_it_starts(number: str) -> None:
    """During its imports, which take most of the time of a short command."""
    code = (
        "import runpy, signal, sys\n"
        "class Now:\n"
        "    def find_spec(self, name, *_):\n"
        f"        if name == 'numpy': signal.raise_signal(signal.{number})\n"
        "sys.meta_path.insert(0, Now())\n"
        "sys.argv = ['bowstring', 'robots']\n"
        "runpy.run_module('bowstring', run_name='__main__')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "Stopped: nothing was written.\n"


SOLVE = ("solve", "amouri2019")


@pytest.mark.skipif(os.name == "nt", reason="no SIGTERM")
def test_sigterm_is_handled_like_ctrl_c(monkeypatch: pytest.MonkeyPatch) -> None:
    """A study then leaves no temporary folder behind."""

    def ended(arguments: object) -> int:
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGTERM)
        return 7

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(main, "run", ended)
    try:
        with pytest.raises(SystemExit, match="7"):
            main.main()
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize(
    ("arguments", "got", "meant"),
    [
        ("ik amouri2019 --tip 100,0,600", "--tip: got 100 ", "100 mm"),
        ("ik amouri2019 --tip 0.1,0,600", "--tip: got 600 ", "600 mm"),
        ("fk amouri2019 --lengths 29,29,29", "--lengths: got 29 ", "29 mm"),
        ("fk amouri2019 --lengths 630,641,641", "--lengths: got 630 ", "630 mm"),
        ("solve amouri2019 --displacement 10,-5,-5", "--displacement: got 10 ", "10 mm"),
        (
            "solve amouri2019 --tension 5,-,- --displacement -,2,-1",
            "--displacement: got 2 ",
            "2 mm",
        ),
        (
            "solve amouri2019 --set segments.0.tendons.spool_radius=0.01 --angle 90,-45,-45",
            "--angle: got 90 ",
            "90 deg",
        ),
        ("solve amouri2019 --tension 1,0,0 --gravity 0,0,9810", "--gravity: ", "9810 mm/s^2"),
        ("simulate amouri2019 --displacement 10,-5,-5", "--displacement: got 10 ", "10 mm"),
        (
            "solve amouri2019 --tension 1,0,0 --set segments.0.length=700",
            "--set segments.0.length: got 700 ",
            "700 mm",
        ),
        (
            "solve amouri2019 --tension 1,0,0 --set segments[0].disks.clamped_length=3",
            "--set segments[0].disks.clamped_length: got 3 ",
            "3 mm",
        ),
        (
            "solve amouri2019 --tension 1,0,0 --set segments.*.length=641",
            "--set segments.*.length: got 641 ",
            "641 mm",
        ),
        (
            "study --set segments.0.length=0.7 --set segments.0.backbone.E=35",
            "--set segments.0.backbone.E: got 35 ",
            "35 GPa",
        ),
        (
            "solve amouri2019 --tension 1,0,0 --set segments.0.tendons.pitch_radius=29",
            "--set segments.0.tendons.pitch_radius: got 29 ",
            "29 mm",
        ),
        (
            "bench simulate amouri2019 --masses 0:1:2 --out x.csv --actual segments.0.length=700",
            "--actual segments.0.length: got 700 ",
            "700 mm",
        ),
        (
            "bench simulate amouri2019 --masses 0:1:2 --out x.csv --tool 0,0,8",
            "--tool: got 8 ",
            "8 mm",
        ),
    ],
)
def test_a_bare_number_that_is_far_too_large_suggests_its_unit(shell, arguments, got, meant):
    said = shell.error(*arguments.split())
    assert said.startswith(got) and " without a unit, which is " in said
    assert f'write "{meant}" if that is meant, else "' in said and said.endswith('".')


def test_an_explicit_unit_is_accepted(shell):
    code, _, err = shell(*SOLVE, "--tension", "1,0,0", "--set", "segments.0.length=600 m")
    assert code == 1 and "segments[0].length = 600 m" in err
    # SI without a unit, where nothing is doubtful
    assert shell(*SOLVE, "--tension", "1,0,0", "--set", "segments.0.length=0.6")[::2] == (0, "")
    assert shell(*SOLVE, "--tension", "1,0,0", "--set", "segments.0.backbone.E=3e10")[::2] == (
        0,
        "",
    )
    said = shell.error("ik", "amouri2019", "--tip", "0,0,600 m")
    assert "got a point 600 m from the base, out of reach: amouri2019 is 641 mm long" in said
    said = shell.error("fk", "amouri2019", "--lengths", "29 m,29 m,29 m")
    assert "tendon 1 is 29 m long, its straight length is 0.641 m" in said
    assert shell("fk", "amouri2019", "--lengths", "641 mm,0.65,0.65")[0] == 0
