"""The study's verification by finite elements."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring.errors import InputError
from bowstring.fem.mesh import Fineness, brick_mesh
from bowstring.fem.run import BrickRun, RunInterrupted, Settings
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.study import run as study_module
from bowstring.study.comparison import COMPARISONS
from bowstring.study.finite_elements import solve
from bowstring.study.run import run_study
from bowstring.study.settings import Extras
from bowstring.study.study import Study
from fem_robots import needs_ccx, small_robot
from shell import Shell
from stages import Stages, printed
from test_cli_fe import ROBOT

LOADS = np.array([[0.0], [80.0]])


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@needs_ccx
@pytest.mark.usefixtures("coarse")
def test_constant_curvature_finite_elements_and_rod(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The three-way comparison by one command."""
    made: list[Study] = []

    def run(robot: Robot, **given: Any) -> Study:
        if given["extras"].fe.grip == "bonded":
            made.append(run_study(robot, **given))
            return made[-1]
        (whole,) = made
        loads = Stages(robot, points=3, max_tension=80.0).model.tensions(whole.statics.tension)
        tips = whole.statics.tip_position
        return replace(
            whole, bricks=solve(robot, loads, tips, given["extras"].fe, lambda share: None)
        )

    monkeypatch.setattr(study_module, "run_study", run)
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(ROBOT)
    arguments = ("study", "small.yaml", "--fe", "--points", "3", "--max-tension", "80")
    found = shell.json(*arguments, "--out", "out")
    by_name = {(c["name"], c["against"]): c for c in found["comparisons"]}
    for name in COMPARISONS:
        assert by_name[name, "fe"]["n"] == 3
    # the error of constant curvature from force is due to the clamps in every comparison
    rod, solid = (by_name["cc_from_force", a]["mean_mm"] for a in ("statics", "fe"))
    assert solid == pytest.approx(rod, abs=0.1)
    part = found["finite_elements"]
    assert part["status"] == "converged"
    assert max(part["from_statics_mm"]) < 0.1
    assert part["middle_stress_ratio"][-1] == pytest.approx(1.0, abs=0.03)
    stems = {f["stem"] for f in found["figures"]}
    assert {"fe_stress", "fe_field"} <= stems
    html = (tmp_path / "out" / "report.html").read_text("utf-8")
    assert "Finite elements" in html and "The robot as a solid of" in html
    written = json.loads((tmp_path / "out" / "study.json").read_text("utf-8"))
    assert written["finite_elements"] == part
    assert "vs finite elements" in printed(made[0], 100, verbose=True)
    freely = shell.json(*arguments, "--grip", "sliding")["finite_elements"]
    assert freely["grip"] == "sliding" and "widen and narrow" in freely["text"][0]
    assert max(freely["from_statics_mm"]) < 0.2 * max(part["from_statics_mm"])


@needs_ccx
@pytest.mark.usefixtures("coarse")
def test_finite_elements_stand_beside_measurements(shell: Shell, here: Path) -> None:
    """All by one command: constant curvature, finite elements, rod, data."""
    Path("small.yaml").write_text(ROBOT)
    shell.json("bench", "simulate", "small.yaml", "--masses", "0:1:8", "--out", "bench.csv")
    arguments = ("--fe", "--points", "5", "--max-tension", "60", "--measurements", "bench.csv")
    found = shell.json("study", "small.yaml", *arguments, "--out", "out")
    part = found["finite_elements"]
    point = np.array(part["measured_point_mm"], dtype=float)
    data = np.isfinite(point).all(axis=1)
    assert 10 <= data.sum() < len(data)  # 7 and 8 kg exceed 60 N
    means = part["mean_from_measurement_mm"]
    assert set(means) == {
        "finite elements",
        "the rod as in the file",
        "constant curvature from force",
        "constant curvature from lengths",
    }
    # coarse in load, stiffer because disks prevent contraction; no friction, as in the rod
    assert means["finite elements"] == pytest.approx(means["the rod as in the file"], abs=0.15)
    assert any("rows of the synthetic table" in s for s in part["text"])
    html = (here / "out" / "report.html").read_text("utf-8")
    assert "statics, dynamics and finite elements." in html
    captions = {f["stem"]: f["caption"] for f in found["figures"]}
    assert "Plus signs: 3-D finite elements" in captions["fig10_overlay"]


@needs_ccx
def test_a_stopped_study_reports_that_it_can_continue(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stop(robot: Robot, *_: object, **__: object) -> None:
        run = BrickRun(robot, brick_mesh(robot, Fineness(2, 4, 1)), {"rise_s": None}, LOADS, LOADS)
        run.status, run.reason = "interrupted", "it was interrupted"
        raise RunInterrupted(run)

    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(ROBOT)
    monkeypatch.setattr("bowstring.study.finite_elements.sweep", stop)
    code, out, err = shell("study", "small.yaml", "--fe", "--points", "2", "--out", "out")
    assert (code, out) == (130, "")
    assert "0 of 2 are kept; the same command goes on from there" in err
    assert not (tmp_path / "out").exists()


def test_it_is_refused_before_any_work(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="clamped_length is 0"):
        run_study(load_robot("amouri2019"), extras=Extras(fe=Settings()))
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="apt-get install calculix-ccx"):
        run_study(small_robot(), extras=Extras(fe=Settings()))


def test_a_study_without_finite_elements_has_no_entries_of_them(paper: Study) -> None:
    assert paper.bricks is None
    assert paper.against("fe") == ()
    assert paper.to_dict()["finite_elements"] is None
    assert not any(f.stem.startswith("fe_") for f in paper.figures)
    assert np.isfinite(paper.statics.tip_position).all()
