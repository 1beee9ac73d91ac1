"""`bowstring fit`: from a table of measurements to a calibrated robot, and its error messages.

All tables here are synthetic, except those of public data sets.

"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import sensors

import bowstring as bs
from bowstring.calibration.cross_validation import hold_out
from bowstring.calibration.figures import draw_fit
from bowstring.calibration.fitting import fit
from bowstring.calibration.observations import score
from bowstring.calibration.table_fit import Validation, calibrate, read_start
from bowstring.cli.fit import _fit_tables
from bowstring.constant_curvature import RobotArcs
from bowstring.data import synthetic
from bowstring.data.measurements import Measurements, read_measurements
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from objects import bench, measured, refused
from shell import Shell

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "examples" / "bench.csv"
UPRIGHT = ("--set", "gravity=0 0 -9.80665 m/s^2")
E, MU = "segments.0.backbone.E", "segments.0.tendons.friction"
FIT = ("fit", "amouri2019", "--measurements", str(TABLE), *UPRIGHT)
NAMES = ("--parameter", E, "--parameter", MU, "--parameter", "base")


@pytest.fixture(scope="module")
def robot() -> Robot:
    """The robot of the example's table, without its friction."""
    return bs.load_robot("amouri2019", {"gravity": [0, 0, -9.80665]})


@pytest.fixture(scope="module")
def data(robot: Robot) -> Measurements:
    return read_measurements(TABLE, robot)


@pytest.mark.slow
def test_the_example_is_fitted(shell: Shell, robot: Robot, tmp_path: Path) -> None:
    folder = tmp_path / "new" / "fit"
    got = shell.json(*FIT, *NAMES, "--out", str(folder))
    found = {p["name"]: p for p in got["parameters"]}
    for name, truth in ((E, 35.0), (MU, 0.1)):
        assert abs(found[name]["value"] - truth) < 3 * found[name]["standard_error"]
        assert found[name]["low"] < found[name]["value"] < found[name]["high"]
    assert found[MU]["start"] == 0 and found[E]["unit"] == "GPa"
    assert got["converged"] and got["not_identifiable"] == []
    assert got["residuals_over_stated_uncertainty"] == pytest.approx(1.0, abs=0.25)
    assert got["rmse_mm"] < 0.05 < 5 < got["rmse_before_mm"]
    assert got["data"]["source"] == "synthetic" and got["data"]["rows"] == 33
    assert len(got["residuals_mm"]) == len(got["lines"]) == 33
    pair = next(c for c in got["correlated"] if c["names"] == ["base.y", "base.rx"])
    assert pair["correlation"] > 0.9
    # the folder: complete, with a robot file that can be used directly
    assert got["folder"] == str(folder)
    kept = json.loads((folder / "fit.json").read_text())
    names = kept.pop("files")
    assert sorted(p.name for p in folder.iterdir()) == names
    assert set(kept.pop("sha256")) == set(names) - {"fit.json"}
    assert kept == {k: v for k, v in got.items() if k != "folder"}
    text = (folder / "robot.yaml").read_text()
    assert "synthetic data: bench" in text and "# Not part of a robot file: base.x = " in text
    calibrated = bs.load_robot(folder / "robot.yaml")
    assert calibrated.bending_stiffness[0] == pytest.approx(
        1e9 * found[E]["value"] * np.pi * 0.005**4 / 64
    )
    fitted_friction = calibrated.model_dump()["segments"][0]["tendons"]["friction"]
    assert fitted_friction == pytest.approx(found[MU]["value"])
    # again with the calibrated robot: no further improvement, and the folder is replaced
    again = shell.json(
        "fit",
        str(folder / "robot.yaml"),
        "--measurements",
        str(TABLE),
        *NAMES,
        "--out",
        str(folder),
    )
    assert again["rmse_before_mm"] == pytest.approx(again["rmse_mm"], rel=1e-3)


def test_the_terminal_labels_the_data(shell: Shell) -> None:
    weightless = FIT[: -len(UPRIGHT)]  # where only the ratio of E to all tensions is determined
    code, out, err = shell(*weightless, "--parameter", E, "--parameter", "gain")
    text = " ".join(out.split())
    assert code == 0 and not err
    assert "amouri2019, statics, fitted to bench (synthetic): 33 rows" in text
    assert f"The data cannot separate {E} and gain, which are correlated: hold one of them." in text
    assert text.count("unknown") == 2
    # friction is missing in this model: the residuals show it, in their order and their size
    assert "The residuals are not noise" in text and "times the stated uncertainty" in text


def test_a_table_is_not_a_public_data_set(shell: Shell) -> None:
    said = shell.error("fit", "amouri2019", "--data", str(TABLE), "--parameter", "base")
    assert "bench.csv is a file, not a public data set; give --measurements." in said


def test_priors_by_flag(shell: Shell) -> None:
    """Without gravity tips determine only the ratio of E to the gain of all tensions."""
    names = ("--parameter", E, "--parameter", "gain")
    weightless = (*FIT[: -len(UPRIGHT)], *names)
    got = shell.json(*weightless, "--priors")
    found = {p["name"]: p for p in got["parameters"]}
    assert (found["gain"]["prior_mean"], found["gain"]["prior_sd"]) == (1.0, 0.02)
    assert found["gain"]["standard_error"] == pytest.approx(0.02, rel=0.02)
    assert found[E]["prior_mean"] is None and found[E]["prior_sd"] is None
    assert not got["not_identifiable"] and got["provenance"]["settings"]["priors"] == {"gain": 0.02}
    # given ones are set in the unit of the parameter, beside the defaults or without them
    both = shell.json(*weightless, "--priors", "--prior", f"{E}=1 GPa", "--prior", "gain=none")
    assert both["provenance"]["settings"]["priors"] == {E: 1e9}
    assert [p["prior_sd"] for p in both["parameters"]] == [1.0, None]
    code, out, _ = shell(*weightless, "--prior", "gain=3%")
    assert code == 0 and "1 ± 0.03" in out and "Determined by their priors" in out
    for bad, words in [
        ("offset=1 mm", "prior of 'offset' belongs to no fitted parameter; fitted are"),
        ("gain=-1", "--prior: got -1; must be a positive number"),
        ("gain=2 mm", "must be a positive number"),
        (f"{E}=2 mm", "is not a unit of stress"),
        ("gain", "write for example --prior"),
    ]:
        assert words in shell.error(*weightless, "--prior", bad)


def test_rows_held_out_do_not_touch_the_fit(robot: Robot, data: Measurements) -> None:
    out = hold_out(robot, data, 0.2)
    np.testing.assert_array_equal(out, data.group == "unloading")  # a run is not split
    spoilt = replace(data, points=data.points + np.where(out, 0.01, 0.0)[:, None, None])
    names = [E, "base"]
    check = Validation(holdout=0.2)
    plain, other = (calibrate(robot, each, names, validation=check) for each in (data, spoilt))
    assert plain.fit.values == other.fit.values
    np.testing.assert_array_equal(plain.held_out, out)
    assert plain.held_out_score is not None and other.held_out_score is not None
    assert plain.held_out_score.count == 16
    shift = 0.01 * np.ones(3)
    left = plain.fit.residuals[out] - shift
    rmse = float(np.sqrt((left**2).sum(axis=1).mean()))
    assert other.held_out_score.rmse == pytest.approx(rmse)


def test_rows_without_a_solution_are_reported_and_not_scored() -> None:
    robot = bs.load_robot("amouri2019")
    bend = np.linspace(0.02, 0.5, 20)
    displacements = 0.029 * bend[:, None] * np.cos(np.radians([0.0, 120.0, 240.0]))
    tips = bs.solve_batch(robot, load=bs.Load(displacements=displacements)).tip_position
    tips += np.random.default_rng(0).normal(0.0, 2e-5, tips.shape)
    displacements[-3:] = 0.03  # three inextensible tendons that are all shortened have no solution
    data = measured(tips, displacements=displacements)
    found = calibrate(robot, data, ["gain", "base"], validation=Validation(holdout=0.25))
    assert found.held_out.sum() == 5 and found.without_solution == 3
    assert found.held_out_score is not None and found.held_out_score.count == 2
    assert found.to_dict()["validation"]["rows_without_solution"] == 3
    said = " ".join(str(part) for part in _fit_tables(found, None))
    assert "3 validation rows have no solution and are left out of the scores." in said


def test_validation_in_json(shell: Shell) -> None:
    few = ("--parameter", E, "--loss", "linear", "--model", "rod")
    held = shell.json(*FIT, *few, "--holdout", "20 %")["validation"]
    assert held["kind"] == "holdout" and held["rows"] == 16 and held["rmse_mm"] > 1
    folds = shell.json(*FIT, *few, "--folds", "2")["validation"]
    assert folds["kind"] == "folds" and folds["rows"] == 33 and folds["converged"]
    assert [f["left_out"] for f in folds["folds"]] == ["loading", "unloading"]
    assert shell.json(*FIT, *few)["validation"] is None


@pytest.mark.slow
def test_another_table_is_predicted_once(shell: Shell, robot: Robot, tmp_path: Path) -> None:
    """Two synthetic tables of one bench; the other is displaced, and not aligned."""
    made = synthetic.simulate(robot, seed=7, **bench(masses=np.linspace(0, 8, 9), friction=0.1))
    shift = np.array([3e-3, 0.0, 4e-3])
    file, _ = synthetic.write(replace(made, points=made.points + shift), tmp_path / "other.csv")
    folder = tmp_path / "fit"
    of = ("--validate", str(file))
    got = shell.json(*FIT, *NAMES, *of, "--out", str(folder))
    plain = shell.json(*FIT, *NAMES)
    assert [p["value"] for p in got["parameters"]] == [p["value"] for p in plain["parameters"]]
    said = got["validation"]
    assert (
        said["kind"] == "file" and said["rows"] == len(made) and said["rows_without_solution"] == 0
    )
    assert said["name"] == made.name
    assert said["source"] == "synthetic" and said["sha256"] != got["data"]["sha256"]
    assert said["rmse_mm"] == pytest.approx(5.0, abs=0.05)
    assert said["mean_mm"] == pytest.approx(5.0, abs=0.05) and 4.9 < said["max_mm"] < 5.2
    assert said["rmse_centred_mm"] < 0.1 and said["mean_centred_mm"] < 0.1
    _, out, _ = shell(*FIT, *NAMES, *of)
    text = " ".join(out.split())
    assert "was not fitted, and nothing was aligned to it. Without the mean offset" in text

    # results that robot.yaml cannot hold are read by the next command
    again = ("fit", str(folder / "robot.yaml"), "--measurements", str(TABLE))
    start = ("--start", str(folder / "calibration.json"))
    held = shell.json(*again, *start, *of, "--parameter", E)
    assert held["rmse_before_mm"] == pytest.approx(got["rmse_mm"], rel=1e-9)
    assert held["validation"]["rmse_mm"] == pytest.approx(said["rmse_mm"], rel=1e-3)
    begun = shell.json(*again, *start, "--parameter", "base.x")["parameters"][0]
    base = next(p["value"] for p in got["parameters"] if p["name"] == "base.x")
    assert begun["start"] == pytest.approx(base, rel=1e-12)
    # they are passed on to the next file as well, fitted or held
    shell.json(*again, *start, "--parameter", E, "--out", str(tmp_path / "next"))
    values = [read_start(each / "calibration.json") for each in (folder, tmp_path / "next")]
    assert len(values[0]) == 6 and values[0] == values[1]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"values": {"base.x": "1"}}', '{"values": 1}'])
def test_an_invalid_start(text: str, shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "calibration.json"
    file.write_text(text, encoding="utf-8")
    said = shell.error(*FIT, "--parameter", E, "--start", str(file))
    assert "is no calibration.json of bowstring fit" in said


def test_a_part_has_all_repeats_of_its_loads(robot: Robot) -> None:
    made = synthetic.simulate(robot, seed=1, **bench(masses=[0, 2, 4], repeats=3))
    found = calibrate(robot, made, [E], validation=Validation(folds=3))
    assert found.folds is not None
    assert found.folds.labels == ("load 1", "load 2", "load 3")
    assert [part.count for part in found.folds.folds] == [6, 6, 3]  # the last is measured once
    # neither model has friction, so that a load is predicted to its noise
    assert found.folds.score.rmse < 3 * 0.02e-3 * np.sqrt(3)


def test_folds_reveal_overfitting_to_the_loads(robot: Robot) -> None:
    """Only the bench has friction; frames and radius compensate for it at five loads."""
    names = [E, "segments.0.tendons.pitch_radius", "base", "tool"]
    heavy = robot.with_({"gravity": [0.0, 0.0, -9.81]})
    given = {"friction": 0.1, "noise": 0.5e-3}
    few = synthetic.simulate(heavy, seed=1, **bench(masses=[0, 1.5, 3, 5.5, 8], repeats=3, **given))
    found = calibrate(heavy, few, names, validation=Validation(folds=5), loss="linear")
    others = synthetic.simulate(heavy, seed=2, **bench(masses=np.arange(0, 8.1, 0.5), **given))
    real = score(found.fit.predict(others), others.tip).rmse
    assert found.folds is not None
    assert real > 1.2 * found.fit.score.rmse  # the error at the fitted rows is too small
    assert found.folds.score.rmse > real


# -- properties stated by the measurements ------------------------------------------------------


def test_rows_count_by_their_uncertainty(robot: Robot) -> None:
    made = synthetic.simulate(robot, seed=2, **bench(masses=np.linspace(0, 8, 17)))
    assert made.sigma is not None
    bad = np.arange(len(made)) % 3 == 0
    scatter = np.random.default_rng(3).normal(0, 2e-3, made.points.shape)
    points = made.points + np.where(bad[:, None, None], scatter, 0.0)
    said = replace(made, points=points, sigma=np.where(bad, 2e-3, made.sigma))
    unsaid = replace(said, sigma=None)
    weighted, plain = (fit(robot, each, [E], loss="linear") for each in (said, unsaid))
    assert abs(weighted[E].value - 35) < 4 * weighted[E].standard_error
    assert weighted[E].standard_error < 0.05 * plain[E].standard_error
    assert weighted.excess == pytest.approx(1.0, abs=0.35) and np.isnan(plain.excess)
    with pytest.raises(InputError, match="sigma must be positive"):
        fit(robot, replace(said, sigma=np.zeros(len(said))), [E])


def test_the_tool_of_the_table_is_held(robot: Robot) -> None:
    made = synthetic.simulate(robot, seed=1, **bench(masses=[0, 3, 6], tool=[0, 0, 0.02]))
    found = fit(robot, made, [E], loss="linear")
    assert found.score.rmse < 3 * 0.02e-3
    assert fit(robot, replace(made, tool=np.zeros(3)), [E]).score.rmse > 1e-3
    fitted = fit(robot, made, [E, "tool.z"], loss="linear")["tool.z"]
    assert fitted.start == pytest.approx(20) and fitted.value == pytest.approx(20, abs=0.1)


def test_points_below_the_tip_and_blanks_are_not_tips(robot: Robot, data: Measurements) -> None:
    plain = fit(robot, data, [E], loss="linear")
    low = np.full_like(data.points, 7.0)
    low[::2] = np.nan
    more = replace(data, points=np.concatenate([low, data.points], axis=1))
    assert fit(robot, more, [E], loss="linear").values == plain.values
    unseen = data.points.copy()
    unseen[4] = np.nan
    left = fit(robot, replace(data, points=unseen), [E], loss="linear")
    assert left.used.sum() == 32 and np.isnan(left.residuals[4]).all()


# -- refusals ----------------------------------------------------------------------------------


def of(*parts: str) -> tuple[str, ...]:
    return ("fit", "amouri2019", *parts)


def test_a_fit_that_does_not_converge(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["bowstring.calibration.search"], "_EVALUATIONS", 1)
    folder = tmp_path / "fit"
    more = (*FIT, *NAMES, "--loss", "linear", "--out", str(folder))
    got = shell.json(*more, code=1)
    assert not got["converged"] and got["folder"] is None and not folder.exists()
    assert got["message"].startswith("Not converged after 1 steps")
    code, out, err = shell(*more)
    assert code == 1 and "Not converged" in out and err.startswith("Error: amouri2019: Not conv")


def table(folder: Path, change: Callable[[list[str]], list[str]]) -> str:
    """The example's table with its rows changed: header first."""
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith("mass_1"))
    file = folder / "table.csv"
    file.write_text("\n".join([*lines[:start], *change(lines[start:])]) + "\n", encoding="utf-8")
    return str(file)


def test_too_few_rows(shell: Shell, tmp_path: Path) -> None:
    file = table(tmp_path, lambda rows: rows[:4])
    said = shell.error("fit", "amouri2019", "--measurements", file, *NAMES)
    assert "3 measured points are too few for 8 parameters" in said


def test_repeated_rows_report_unidentifiable_parameters(shell: Shell, tmp_path: Path) -> None:
    file = table(tmp_path, lambda rows: [rows[0], *[rows[9]] * 12])
    got = shell.json("fit", "amouri2019", "--measurements", file, *UPRIGHT, *NAMES)
    assert got["not_identifiable"] and got["data"]["rows"] == 12
    assert "cannot separate" in got["message"]
    assert all(p["standard_error"] is None for p in got["parameters"] if p["name"] == E)


def test_swapped_tendons_are_named(shell: Shell, tmp_path: Path) -> None:
    robot = bs.load_robot("amouri2019")
    rng = np.random.default_rng(1)
    tensions = rng.uniform(0, 30, (30, 3)) * (rng.random((30, 3)) < 0.6)
    made = synthetic.simulate(robot, **bench(tensions=tensions, unload=False))
    file, _ = synthetic.write(
        replace(made, tensions=made.tensions[:, [0, 2, 1]]), tmp_path / "b.csv"
    )
    code, out, err = shell(*of("--measurements", str(file), "--parameter", E))
    assert code == 0 and err.startswith("Warning: ") and err.count("\n") == 1
    assert "tendons 2 and 3" in err and "not noise" in out
    warning = err.removeprefix("Warning: ").strip()
    for command in (
        of("--measurements", str(file), "--parameter", E),
        ("bench", "check", str(file), "--robot", "amouri2019"),
    ):
        _, out, _ = shell(*command, "--json")
        assert json.loads(out)["warnings"] == [*robot.warnings, warning]


def shifted(folder: Path) -> str:
    """The example's table in another frame: tips 100 mm beside."""

    def moved(rows: list[str]) -> list[str]:
        cells = [row.split(",") for row in rows]
        for row in cells[1:]:
            row[3] = str(float(row[3]) + 100.0)
        return [",".join(row) for row in cells]

    return table(folder, moved)


def test_a_result_in_doubt_is_written_by_force_alone(shell: Shell, tmp_path: Path) -> None:
    out = tmp_path / "fit"
    call = of("--measurements", shifted(tmp_path), *UPRIGHT, "--parameter", E)
    code, text, err = shell(*call)
    assert code == 0 and not err and "Calibrated robot" not in text
    first = " ".join(text.split())
    assert first.startswith("Check the result. The residuals are mostly a rigid offset")
    code, text, err = shell(*call, "--out", str(out))
    assert code == 1 and "Converged." in text and not out.exists()
    assert err.startswith("Error: amouri2019: nothing is written") and err.count("\n") == 1
    assert "--force writes it nevertheless. The residuals are mostly a rigid offset" in err
    got = shell.json(*call, "--out", str(out), code=1)
    assert got["converged"] and got["folder"] is None and not out.exists()
    assert any("rigid offset" in each for each in got["warnings"])
    code, text, err = shell(*call, "--out", str(out), "--force")
    assert code == 0 and "Calibrated robot" in text
    header = (out / "robot.yaml").read_text(encoding="utf-8").splitlines()
    assert header[0].startswith("# In doubt: The residuals are mostly a rigid offset")
    # with its base it needs no force
    whole = shell.json(*call, "--parameter", "base", "--out", str(tmp_path / "whole"))
    assert whole["folder"] and not any("offset" in each for each in whole["warnings"])


def test_doubts_of_the_commands_count_too(robot: Robot) -> None:
    rng = np.random.default_rng(1)
    tensions = rng.uniform(0, 30, (30, 3)) * (rng.random((30, 3)) < 0.6)
    made = synthetic.simulate(robot, **bench(tensions=tensions, unload=False))
    assert not calibrate(robot, made, ["base"]).doubts
    swapped = replace(made, tensions=made.tensions[:, [0, 2, 1]])
    assert "tendons 2 and 3" in calibrate(robot, swapped, ["base"]).doubts[0]
    few = replace(made, left_out=9, below_zero=9, least_tension=-1.0)
    assert "are biased" in calibrate(robot, few, ["base"]).doubts[0]
    others = replace(made, left_out=9)
    assert others.doubt and not calibrate(robot, others, ["base"]).doubts


def test_zeros_of_load_cells_are_fitted(shell: Shell, tmp_path: Path, robot: Robot) -> None:
    """No row is left out for a reading below zero, and the zeros are no doubt."""
    rng = np.random.default_rng(4)
    tensions = rng.uniform(0, 20, (40, 3))
    tensions[np.arange(40), np.arange(40) % 3] = 0
    tip = RobotArcs.from_tensions(robot, tensions).tip.position + rng.normal(0, 1e-4, (40, 3))
    path = tmp_path / "cells.csv"
    head = "tension_1_N,tension_2_N,tension_3_N,tip_x_mm,tip_y_mm,tip_z_mm"
    cells = np.hstack([tensions + np.array([4, -2, 1]), 1e3 * tip])
    np.savetxt(path, cells, fmt="%.5f", delimiter=",", header=head, comments="")
    args = ("fit", "amouri2019", "--measurements", str(path), "--model", "arc", "--parameter", E)
    raw = shell.json(*args)
    assert raw["data"]["rows_left_out"] and "likely zero is 4" in raw["warnings"][0]
    got = shell.json(*args, "--parameter", "offset.tendons", "--priors", "--prior", "offset=5 N")
    assert not got["data"]["rows_left_out"] and not got["warnings"]
    assert got["parameters"][0]["value"] == pytest.approx(35.0, rel=2e-3)
    assert [(each["unit"], each["prior_sd"]) for each in got["parameters"][1:]] == [("N", 5.0)] * 3
    offsets = np.array([each["value"] for each in got["parameters"][1:]])
    np.testing.assert_allclose(offsets - offsets.mean(), [-3, 3, 0], atol=0.05)


def test_intervals_know_zeros_noise_and_spikes() -> None:
    """Nine benches of `python -m benchmarks.sensors`: no spike of a device is silent."""
    inside = 0
    for seed in range(9):
        kind = sensors.KINDS[seed % 3]
        made = sensors.bench("amouri2019", kind, "device", seed)
        found = made.fit()
        stiffness = found.fit[sensors.E]
        assert found.fit.converged and found.data.left_out <= 3
        assert "4095" in found.data.doubt + str(found.data.issues)
        assert stiffness.value == pytest.approx(made.truth, rel=0.015)
        assert abs(stiffness.value - made.truth) < stiffness.high - stiffness.low
        inside += stiffness.low < made.truth < stiffness.high
        offsets = [each for each in found.fit.estimates if each.name.startswith("offset")]
        assert len(offsets) == (0 if kind == "encoders, rod" else 3)
        assert all(0 < (each.prior_sd or 0) < 0.1 for each in offsets)
    assert inside >= 7


def test_a_mistyped_row_is_named_and_hardly_counts(shell: Shell, tmp_path: Path) -> None:
    def mistyped(rows: list[str]) -> list[str]:
        cells = rows[9].split(",")
        cells[3] = str(float(cells[3]) + 50.0)
        return [*rows[:9], ",".join(cells), *rows[10:]]

    args = ("fit", "amouri2019", "--measurements", table(tmp_path, mistyped), *UPRIGHT)
    got = shell.json(*args, "--parameter", E, "--parameter", MU)
    [far] = got["outliers"]
    assert far["line"] == 14 and far["distance_mm"] == pytest.approx(50.0, abs=0.5)
    assert got["parameters"][0]["value"] == pytest.approx(35.0, abs=0.01)
    _, out, _ = shell(*args, "--parameter", E, "--parameter", MU)
    assert "Far off, look at: line 14 (50 mm)." in out


def test_rows_without_a_tip_keep_the_path_whole(shell: Shell, tmp_path: Path) -> None:
    """Seven tips around the peak load are blank; without their commands too, the path breaks."""

    def blanked(cells: slice) -> Callable[[list[str]], list[str]]:
        def change(rows: list[str]) -> list[str]:
            out = [row.split(",") for row in rows]
            for row in out[14:21]:
                row[cells] = [""] * len(row[cells])
            return [",".join(row) for row in out]

        return change

    given = (*UPRIGHT, "--parameter", E, "--parameter", MU)
    kept = table(tmp_path, blanked(slice(3, 6)))
    code, out, err = shell("fit", "amouri2019", "--measurements", kept, *given)
    assert code == 0 and not err and "26 rows, 7 without a tip" in " ".join(out.split())
    got = shell.json("fit", "amouri2019", "--measurements", kept, *given)
    assert got["rows"] == 26 and got["rmse_mm"] < 0.05
    assert got["data"]["rows"] == 33 and got["data"]["rows_without_tip"] == 7
    lost = table(tmp_path, blanked(slice(2, 6)))
    code, _, err = shell("fit", "amouri2019", "--measurements", lost, *given)
    assert code == 0 and "with friction the rows are one path, and 7 rows were left out" in err


def test_the_scatter_is_labelled_as_a_median(shell: Shell) -> None:
    """A rod without friction misses most rows by far more than the median: synthetic table."""
    args = (*FIT, "--parameter", "segments.0.tendons.pitch_radius")
    got = shell.json(*args)
    whole = got["rmse_mm"] / np.sqrt(3)
    _, out, _ = shell(*args)
    text = " ".join(out.split())
    assert whole > 2 * got["noise_mm"]
    assert f"That is by their median; their root mean square is {whole:.4f} mm: some rows" in text
    _, out, _ = shell(*FIT, *NAMES)
    assert "by their median" not in out


@pytest.mark.parametrize("times", [1, 10])
def test_many_rows_are_thinned_in_figures(robot: Robot, data: Measurements, times: int) -> None:
    rows = data.select(np.tile(np.arange(33), times))
    found = calibrate(robot, rows, ["bend_gain"], model="arc")
    parity = dict(draw_fit(found))["parity"]()
    marks = [line for line in parity.axes[0].lines if line.get_marker() not in ("None", "")]
    assert len(marks) > 3
    for line in marks:
        assert line.get_alpha() == (None if times == 1 else 0.35)


def test_data_without_noise_have_no_lack_of_fit(robot: Robot) -> None:
    made = synthetic.simulate(
        robot, **bench(tensions=np.outer(np.linspace(0, 60, 13), [1, 0, 0]), noise=0.0)
    )
    found = fit(robot, made, [E, "base.x"])
    assert found.score.rmse < 1e-8 and found.message == "Converged."


def test_masses_in_another_unit_are_named(shell: Shell, tmp_path: Path) -> None:
    file = table(tmp_path, lambda rows: [rows[0].replace("_kg", "_t"), *rows[1:]])
    code, _, err = shell(*of("--measurements", str(file), "--parameter", E))
    assert code == 1 and "rows have no solution" in err
    assert "check the unit of the tensions or masses" in err


def test_too_many_rows_are_refused(robot: Robot, data: Measurements) -> None:
    many = data.select(np.arange(33_000) % 33)
    refused(r"33000 rows are too many.*keep one row of 4", lambda: fit(robot, many, [E]))


@pytest.mark.parametrize(
    ("change", "says"),
    [({"scale": None}, "in pixels"), ({"points": np.empty((33, 0, 3))}, "angles only")],
)
def test_data_without_a_tip_in_metres(
    robot: Robot, data: Measurements, change: dict[str, Any], says: str
) -> None:
    refused(says, lambda: fit(robot, replace(data, **change), [E]))


# -- data of others ----------------------------------------------------------------------------


def test_a_public_set_by_name(shell: Shell, public_data: Callable[[str], Path]) -> None:
    """Measured: constant curvature with gains, fitted to the train part of a real robot."""
    public_data("crl-ftdcr-mocap")
    names = ("hole_angle.segments", "bend_gain.segments", "base", "tool.z")
    got = shell.json(
        *("fit", "crl-ftdcr-v4", "--data", "crl-ftdcr-mocap", "--part", "train"),
        *(part for name in names for part in ("--parameter", name)),
        *("--model", "arc", "--loss", "linear", "--validate", "val"),
    )
    assert got["data"]["name"] == "crl-ftdcr-mocap, train" and got["data"]["source"] == "measured"
    assert got["rows"] == 1620 and got["rmse_mm"] == pytest.approx(13.90, abs=0.01)
    val = got["validation"]
    assert val["kind"] == "file" and val["rows"] == 443 and val["name"] == "crl-ftdcr-mocap, val"
    assert val["mean_mm"] == pytest.approx(10.65, abs=0.05)
    assert val["rmse_centred_mm"] == pytest.approx(12.50, abs=0.05)
    said = shell.error("fit", "crl-ftdcr-v4", "--data", "crl-ftdcr-mocap", "--parameter", "base")
    assert "name one" in said


def test_a_soft_backbone_is_reported_in_its_own_unit(shell: Shell, tmp_path: Path) -> None:
    soft = {E: "1 MPa", "segments.0.backbone.diameter": "20 mm", "segments.0.length": "400 mm"}
    overrides = [text for path, value in soft.items() for text in ("--set", f"{path}={value}")]
    table = tmp_path / "soft.csv"
    loads = ("--tensions", "0:0.1:0.5", "--out", str(table), "--no-unload")
    shell("bench", "simulate", "amouri2019", *loads, *overrides)
    command = ("fit", "amouri2019", "--measurements", str(table), "--parameter", E, *overrides)
    (found,) = shell.json(*command)["parameters"]
    assert found["unit"] == "MPa" and found["value"] == pytest.approx(1.0, rel=0.01)
    assert found["start"] == pytest.approx(1.0)
    code, out, _ = shell(*command)
    assert code == 0 and "MPa" in out and "GPa" not in out


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")
@pytest.mark.parametrize(
    ("command", "says"),
    [
        ("bench check PIPE --robot amouri2019", "the table is empty"),
        ("bench check TABLE --mapping PIPE", "is empty"),
        ("solve amouri2019 --tension 1,0,0 --history PIPE", "--history"),
        ("fit amouri2019 --measurements TABLE --parameter friction --start PIPE", "PIPE"),
    ],
)
def test_a_pipe_without_a_writer_is_not_waited_for(
    shell: Shell, tmp_path: Path, command: str, says: str
) -> None:
    pipe = tmp_path / "PIPE"
    os.mkfifo(pipe)
    names = {"PIPE": str(pipe), "TABLE": str(TABLE)}
    assert says in shell.error(*[names.get(word, word) for word in command.split()])


@pytest.mark.skipif(not Path("/dev/fd").exists(), reason="no /dev/fd")
def test_a_pipe_is_read_to_its_end() -> None:
    # as with the shell's <(...): the writer exists, its data arrive later
    end, start = os.pipe()

    def write() -> None:
        time.sleep(0.2)
        with os.fdopen(start, "wb") as pipe:
            pipe.write(TABLE.read_bytes())

    writer = threading.Thread(target=write)
    writer.start()
    assert len(read_measurements(f"/dev/fd/{end}")) == len(read_measurements(TABLE))
    writer.join()
    os.close(end)
