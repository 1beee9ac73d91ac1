"""Solids of `bowstring export`: their contract and their files."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import bowstring as bs
from bowstring.aliases import Progress
from bowstring.robot.model import Robot
from bowstring.study import run as study_module
from bowstring.study.study import Study
from shell import Shell, refuses
from stages import Stages, by_name

CAD = ("export", "amouri2019")


@pytest.mark.cad
def test_a_bent_robot_as_files(shell: Shell, here: Path) -> None:
    bd = pytest.importorskip("build123d", exc_type=ImportError)
    files = ("--out", "robot.step", "--picture", "robot.png", "--drawing", "disk.svg")
    found = shell.json(*CAD, "--tension", "60,0,0", *files)
    assert set(found) == {
        *("pose", "tip", "disks", "parts", "assumed", "files"),
        *("robot", "warnings", "provenance"),
    }
    solution = bs.solve(bs.load_robot("amouri2019"), tensions=[60, 0, 0])
    np.testing.assert_allclose(found["tip"]["position_m"], solution.tip.position, atol=1e-12)
    assert found["pose"] == "simulated" and len(found["disks"]) == 9
    assert found["files"] == {
        "solid": str(here / "robot.step"),
        "picture": str(here / "robot.png"),
        "drawing": str(here / "disk.svg"),
    }
    assert {p.name for p in here.iterdir()} == {"robot.step", "robot.png", "disk.svg"}
    parts = {part["name"]: part for part in found["parts"]}
    assert len(parts) == 14 and set(parts["base"]) == {
        *("name", "kind", "colour", "volume_m3", "centre_m", "mass_kg"),
    }
    np.testing.assert_allclose(parts["disk_9"]["centre_m"], solution.tip.position, atol=1e-12)
    assert parts["disk_1"]["mass_kg"] == 0.02 and parts["tendon_1"]["mass_kg"] is None
    assert {key: found["assumed"][0][key] for key in ("field", "value_m")} == {
        "field": "segments[0].disks.hole_diameter",
        "value_m": 0.002,
    }
    settings = found["provenance"]["settings"]
    assert settings == {"tensions_N": [60, 0, 0], "displacements_m": None, "angles_rad": None}
    end = bd.import_step("robot.step").children[10].center(bd.CenterOf.MASS)
    np.testing.assert_allclose(np.array(tuple(end)) / 1e3, solution.tip.position, atol=1e-8)


@pytest.mark.cad
def test_description_of_the_straight_robot(shell: Shell, here: Path) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    code, out, err = shell(*CAD, "--out", "robot.stl")
    assert (code, err) == (0, "")
    assert "amouri2019, straight, as built" in out and "tip" not in out
    assert "assumed, because the robot file does not say it:" in out
    assert out.endswith("solid: robot.stl\n")


def test_the_drawing_needs_no_extra(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "build123d", None)
    found = shell.json(*CAD, "--drawing", "disk.pdf")
    assert found["parts"] is None and found["files"] == {"drawing": str(here / "disk.pdf")}


@pytest.mark.parametrize("flag", ["--out=robot.step", "--picture=robot.png"])
def test_without_the_extra(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch, flag: str
) -> None:
    monkeypatch.setitem(sys.modules, "build123d", None)
    says = "solids need build123d, which cannot be loaded; install it: pip install 'bowstring[cad]'"
    refuses(shell, here, says, *CAD, flag)


@pytest.mark.cad
def test_a_load_without_an_equilibrium_writes_nothing(shell: Shell, here: Path) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    code, out, err = shell(*CAD, "--out", "robot.step", "--tension", "1000000,0,0")
    assert (code, out) == (1, "") and err.startswith("Error: ") and not list(here.iterdir())


@pytest.mark.cad
def test_progress_begins_with_the_slow_import(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    from bowstring.cad import solid
    from bowstring.cli import solids

    reported: list[str] = []

    @contextmanager
    def bar(first: str) -> Iterator[Progress]:
        reported.append(first)
        yield lambda what, done: reported.append(what)

    def kernel() -> None:
        reported.append("loaded")

    monkeypatch.setattr(solids, "progress_bar", bar)
    monkeypatch.setattr(solid, "check_cad", kernel)
    code, _, err = shell(*CAD, "--out", "robot.glb", "--tension", "1e6,0,0")
    assert code == 1 and err.startswith("Error: ")
    assert reported == ["CAD kernel", "loaded"]


@pytest.mark.cad
def test_ctrl_c_reports_written_files(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    from bowstring.cad import export, picture

    stopped = Mock(side_effect=KeyboardInterrupt)
    monkeypatch.setattr(picture, "draw_solid", stopped)
    files = ("--out", "robot.stl", "--picture", "robot.png", "--drawing", "disk.svg")
    code, out, err = shell(*CAD, *files)
    assert (code, out) == (130, "")
    assert err == f"Stopped: of the files only {here / 'robot.stl'} is written.\n"
    assert [p.name for p in here.iterdir()] == ["robot.stl"]
    monkeypatch.setattr(export, "_stl", stopped)
    code, out, err = shell(*CAD, "--out", "other.stl", "--picture", "robot.png")
    assert (code, out, err) == (130, "", "Stopped: nothing was written.\n")
    assert [p.name for p in here.iterdir()] == ["robot.stl"]


@pytest.mark.cad
def test_the_study_shows_the_solid(
    shell: Shell, paper: Study, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)

    def run(robot: Robot, **given: Any) -> Study:
        given = by_name(given)
        assert (given["points"], given["rise"], given["solid"]) == (3, 0.5, True)
        return replace(Stages(robot, points=3).over(paper), solid=given["solid"])

    monkeypatch.setattr(study_module, "run_study", run)
    found = shell.json(
        *(
            "study",
            "--points",
            "3",
            "--rise",
            "0.5",
            "--solid",
            "--out",
            "study",
            "--figures",
            "pdf",
        )
    )
    assert [f["stem"] for f in found["figures"]][:2] == ["fig01_solid", "fig01_robot"]
    page = (here / "study" / "report.html").read_text("utf-8")
    assert 'id="fig01_solid"' in page and "data:image/png;base64," in page
    assert (here / "study" / "figures" / "fig02_disk.pdf").is_file()


def test_the_study_without_the_extra(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "build123d", None)
    refuses(shell, here, "solids need build123d", "study", "--solid")


def test_a_precurved_robot_without_actuation_is_unloaded(shell: Shell, here: Path) -> None:
    changes = {
        "segments.0.backbone.rest_bend": "50 deg",
        "segments.0.backbone.rest_twist": "40 deg",
    }
    flags = [flag for path, value in changes.items() for flag in ("--set", f"{path}={value}")]
    found = shell.json(*CAD, *flags, "--drawing", "disk.svg")
    solution = bs.solve(bs.load_robot("amouri2019", changes), tensions=[0, 0, 0])
    assert found["pose"] == "unloaded" and len(found["disks"]) == 9
    np.testing.assert_allclose(found["tip"]["position_m"], solution.tip.position, atol=1e-14)
    np.testing.assert_allclose(found["tip"]["rotation"], solution.tip.rotation, atol=1e-14)
