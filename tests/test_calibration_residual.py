"""Guarded residual: hysteresis that no parameter describes, learnt from synthetic tips."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring.calibration.fitting import Fit, fit
from bowstring.calibration.gaussian_process import GaussianProcess
from bowstring.calibration.observations import Data, score
from bowstring.calibration.residual import Residual, fit_residual
from bowstring.calibration.residual_comparison import study_residual
from bowstring.calibration.residual_file import read_residual, residual_to_dict
from bowstring.calibration.table_fit import Validation, calibrate
from bowstring.data.measurements import Measurements, load
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from objects import measured, refused
from shell import Shell

RADIUS = 0.012  # m: of the play in the synthetic truth
Floats = NDArray[np.float64]


def loops(seed: int, size: float, runs: int = 8) -> tuple[Floats, NDArray[np.str_]]:
    """Tensions of slow loops in random directions, and the name of each loop."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 2 * np.pi, 30)
    rows, names = [], []
    for run in range(runs):
        a, b = rng.uniform(-size, size, (2, 2))
        plane = a * np.sin(t)[:, None] + b * (1 - np.cos(t))[:, None] / 2
        angle = 2 * np.pi * np.arange(3) / 3
        rows.append(size + plane @ np.array([np.cos(angle), np.sin(angle)]) * 2 / 3)
        names += [f"loop {run}"] * len(t)
    return np.maximum(np.concatenate(rows), 0.0), np.array(names)


def truth(robot: Robot, tensions: Floats) -> Floats:
    """Synthetic tips: they stay behind those of statics by a part of a play, plus noise."""
    tips = bs.sweep(robot, tensions).tip_position
    state, late = tips[0], np.empty_like(tips)
    for k, tip in enumerate(tips):
        behind = state - tip
        state = tip + behind * min(1.0, RADIUS / max(float(np.linalg.norm(behind)), 1e-12))
        late[k] = tip + 0.6 * (state - tip)
    noise = np.random.default_rng(int(1e3 * tensions.sum())).normal(0, 1e-4, tips.shape)
    return np.asarray(late + noise)


def table(robot: Robot, seed: int) -> Measurements:
    tensions, group = loops(seed, 8.0)
    time = np.arange(len(tensions)) * 1.0
    return measured(
        truth(robot, tensions), name=f"loops {seed}", tensions=tensions, group=group, time=time
    )


@pytest.fixture(scope="module")
def data(robot: Robot) -> Measurements:
    return table(robot, 1)


@pytest.fixture(scope="module")
def other(robot: Robot) -> Measurements:
    return table(robot, 2)


@pytest.fixture(scope="module")
def found(robot: Robot, data: Measurements) -> Fit:
    return fit(robot, data, ["base", "segments.0.backbone.E"])


@pytest.fixture(scope="module")
def residual(found: Fit, data: Measurements) -> Residual:
    return fit_residual(found, data)


def test_it_halves_the_error_inside_its_data(residual: Residual, other: Measurements) -> None:
    got = residual.correct(other)
    before, after = score(got.model_point, other.tip), score(got.point, other.tip)
    assert before.rmse > 2e-3  # the play is there, and no parameter describes it
    assert after.rmse < 0.5 * before.rmse
    assert np.isfinite(residual.hyperparameters.memory)
    model, folds = residual.validated
    assert folds.rmse < 0.6 * model.rmse
    assert np.median(got.kept) > 0.8


def test_it_returns_to_the_model_outside_its_data(residual: Residual, other: Measurements) -> None:
    inside = residual.correct(other)
    far = residual.correct(bs.Load(8.0 + np.linspace(0, 1, 30)[:, None] * [400.0, 0, 0]))
    size = np.linalg.norm(inside.point - inside.model_point, axis=1)
    shift = np.linalg.norm(far.point - far.model_point, axis=1)
    assert far.beyond[-1] and far.kept[-1] < 0.05
    assert shift[-1] < 0.05 * np.sqrt(np.mean(size**2))
    assert far.kept[0] > 0.5 and (np.diff(far.kept[5:]) < 1e-9).all()


def test_the_way_to_a_load_counts(residual: Residual) -> None:
    up = np.linspace(0, 12, 25)[:, None] * [1.0, 0, 0] + [0.0, 2, 2]
    path = residual.correct(bs.Load(np.concatenate([up, up[::-1]])))
    loading, unloading = path.point[12], path.point[-13]
    np.testing.assert_allclose(path.model_point[12], path.model_point[-13], atol=1e-7)
    assert loading[0] < path.model_point[12, 0] < unloading[0]  # the tip stays behind
    assert unloading[0] - loading[0] > 0.5 * 2 * 0.6 * RADIUS * 0.5


def test_it_is_the_calibrated_model_alone_without_the_process(
    residual: Residual, found: Fit, other: Measurements
) -> None:
    np.testing.assert_allclose(
        residual.correct(other).model_point, found.predict(other), atol=1e-12
    )


def test_a_row_without_a_solution_has_no_point(found: Fit, data: Measurements) -> None:
    learnt = fit_residual(found, data)
    tensions = np.array([[8.0, 8, 8], [1e7, 0, 0], [8.0, 8, 8]])
    got = learnt.correct(bs.Load(tensions))
    solved = np.isfinite(got.model_point).all(axis=1)
    assert solved[0] and solved[2]
    np.testing.assert_array_equal(np.isfinite(got.point).all(axis=1), solved)
    np.testing.assert_array_equal(got.beyond[~solved], True)


def test_the_process_interpolates_and_fades() -> None:
    x = np.linspace(0, 3, 12)[:, None]
    process = GaussianProcess(x, np.sin(x), 1e-6)
    at = np.array([[1.3], [60.0]])
    np.testing.assert_allclose(process.mean(at)[:, 0], [np.sin(1.3), 0.0], atol=2e-3)
    np.testing.assert_allclose(process.explained(at), [1.0, 0.0], atol=2e-2)


# -- bad input ----------------------------------------------------------------------------------


def test_rows_out_of_order_are_refused(
    found: Fit, data: Measurements, residual: Residual, other: Measurements
) -> None:
    mixed = np.random.default_rng(0).permutation(len(data))
    sentence = r"row \d+ is earlier than the row before it; memory states need rows in the order"
    with pytest.raises(InputError, match=sentence):
        fit_residual(found, data.select(mixed), rows=np.ones(len(data), bool))
    refused(sentence, lambda: residual.correct(other.select(mixed)))


def test_too_few_rows_are_refused(found: Fit, data: Measurements) -> None:
    rows = np.arange(len(data)) < 19
    with pytest.raises(InputError, match="19 measured rows are too few for a residual; measure 20"):
        fit_residual(found, data, rows=rows)


def test_a_tendon_keeps_its_kind_of_command(
    found: Fit, residual: Residual, data: Measurements
) -> None:
    given = np.array(data.tensions)
    lengths = np.where(np.arange(len(given))[:, None] < 100, np.nan, 0.0) * [0, 1, 1]
    lengths[:, 0] = np.nan
    given[100:, 1:] = np.nan
    mixed = Data(points=data.tip, tensions=given, displacements=lengths)
    with pytest.raises(InputError, match="tendon 2 has tensions in some rows and displacements"):
        fit_residual(found, mixed)
    with pytest.raises(InputError, match="fitted to tensions of tendon 1; give these"):
        residual.correct(bs.Load(displacements=np.zeros((2, 3))))


def test_validation_rows_must_not_be_fitted(robot: Robot, data: Measurements) -> None:
    part = data.select(np.arange(len(data)) >= 200)
    with pytest.raises(InputError, match="40 of 40 validation rows are also fitted, the first in"):
        calibrate(robot, data, ["base"], validation=Validation(other=part))
    with pytest.raises(InputError, match="a residual needs validation rows"):
        study_residual(calibrate(robot, data, ["base"]), robot)


# -- comparison ---------------------------------------------------------------------------------


@pytest.mark.slow
def test_physics_saves_data(robot: Robot, data: Measurements, other: Measurements) -> None:
    calibration = calibrate(
        robot, data, ["base", "segments.0.backbone.E"], validation=Validation(other=other)
    )
    study = study_residual(calibration, robot)
    found = {(each.model, each.rows): each for each in study.compared}
    assert {count for _, count in found} == {50, 100, len(data)}
    for count in (50, 100, len(data)):
        rod, commands = found["rod", count], found["commands", count]
        assert rod.alone is not None and rod.corrected.rmse < rod.alone.rmse
        assert rod.corrected.rmse < commands.corrected.rmse
        assert found["arc", count].corrected.count == rod.corrected.count == len(other)
    assert found["rod", 50].corrected.rmse < found["commands", len(data)].corrected.rmse
    content = study.to_dict()
    assert content["rows"] == len(data) and len(content["comparison"]) == 9
    json.dumps(content, allow_nan=False)


# -- file ---------------------------------------------------------------------------------------


def test_a_saved_residual_predicts_the_same(
    residual: Residual, other: Measurements, tmp_path: Path
) -> None:
    file = tmp_path / "residual.json"
    file.write_text(json.dumps(residual_to_dict(residual), allow_nan=False))
    again = read_residual(file, residual.robot)
    one, two = residual.correct(other), again.correct(other)
    np.testing.assert_array_equal(one.point, two.point)
    np.testing.assert_array_equal(one.kept, two.kept)
    assert again.to_dict() == residual.to_dict()


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda c: c.update(version=2), "has version 2, this Bowstring reads 1"),
        (lambda c: c.update(format="fit"), "is no complete residual.json"),
        (lambda c: c.update(robot_hash="0"), "belongs to another robot than amouri2019"),
        (lambda c: c["residuals"].pop(), "is no complete residual.json"),
        (lambda c: c["points"][0].__setitem__(0, None), "is no complete residual.json"),
        (lambda c: c["hyperparameters"].update(noise=-1.0), "is no complete residual.json"),
        (lambda c: c.pop("commands"), "it has no commands"),
        (lambda c: c.update(values=5), "values must be a valid dictionary"),
        (lambda c: c["tool"].__setitem__(0, 10**400), "tool"),
        (lambda c: c["residuals"][0].__setitem__(0, 1e300), "residuals has numbers beyond 1e"),
        (lambda c: c["hyperparameters"].update(point=1e-300), "hyperparameters.point"),
        (lambda c: c.update(points=c["points"] * 100), "rows, from 1 to 4000 are possible"),
    ],
)
def test_a_damaged_file_is_refused(
    residual: Residual, tmp_path: Path, change: Callable[[dict[str, Any]], Any], sentence: str
) -> None:
    content = json.loads(json.dumps(residual_to_dict(residual)))
    change(content)
    file = tmp_path / "residual.json"
    file.write_text(json.dumps(content))
    refused(sentence, lambda: read_residual(file, residual.robot))
    file.write_text("{")
    refused(r"is no complete residual.json", lambda: read_residual(file, residual.robot))
    refused("cannot read", lambda: read_residual(tmp_path / "none.json", residual.robot))


# -- command ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_command_saves_and_compares(
    shell: Shell, data: Measurements, other: Measurements, tmp_path: Path
) -> None:
    files = []
    for each in (data, other):
        files.append(tmp_path / f"{each.name.replace(' ', '_')}.csv")
        bs.write_measurements(replace(each, recording=None), files[-1])
    call = ("fit", "amouri2019", "--measurements", str(files[0]), "--validate", str(files[1]))
    call = (*call, "--parameter", "base", "--residual", "--out", str(tmp_path / "out"))
    got = shell.json(*call)
    assert got["residual"]["folds_residual"]["rmse_mm"] < got["rmse_mm"]
    learnt = read_residual(tmp_path / "out")
    best = got["residual"]["comparison"][2]
    assert (best["model"], best["fitted_rows"]) == ("rod", len(data))
    assert best["with_residual"]["rmse_mm"] < 0.6 * best["alone"]["rmse_mm"]
    solve = ("solve", str(tmp_path / "out" / "robot.yaml"), "--tension", "12,6,6")
    solve = (*solve, "--residual", str(tmp_path / "out" / "residual.json"))
    point = shell.json(*solve)["corrected"]
    direct = learnt.correct(bs.Load([[12.0, 6, 6]]))
    np.testing.assert_allclose(point["point_m"], direct.point[0], atol=1e-12)
    assert point["share_kept"] > 0.5 and not point["beyond_data"]
    assert "measured point, with residual" in shell(*solve)[1]
    assert "tendon commands only" in shell.error(*solve, "--tip-force", "0,1,0")
    assert "leave out --elements" in shell.error(*solve, "--elements", "2")
    corrected = score(learnt.correct(other).point, other.tip)
    assert 1e3 * corrected.rmse == pytest.approx(best["with_residual"]["rmse_mm"], rel=1e-3)


def test_rows_may_state_the_tool_that_the_fit_then_changed(
    robot: Robot, data: Measurements, other: Measurements
) -> None:
    rows = replace(data, tool=np.array([0.0, 0.0, 1e-3]))
    learnt = fit_residual(fit(robot, rows, ["base", "tool.z"]), rows)
    assert learnt.values["tool.z"] != 1e-3
    learnt.correct(replace(other, tool=rows.tool))
    with pytest.raises(InputError, match="the rows state the tool 0, 0, 4 mm"):
        learnt.correct(replace(other, tool=np.array([0.0, 0.0, 4e-3])))


# -- measured -----------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_measured_robot_is_predicted_better(public_data: Callable[[str], Path]) -> None:
    public_data("crl-ftdcr-mocap")
    flexible = {f"segments.{i}.tendons.compliance": 1e-4 for i in range(3)}
    robot = bs.load_robot("crl-ftdcr-v4").with_(flexible)
    train, val = (load("crl-ftdcr-mocap", part) for part in ("train", "val"))
    names = ["base", "tool.z", "segments.*.tendons.compliance"]
    few = np.zeros(len(train), bool)
    few[np.linspace(0, len(train) - 1, 100).round().astype(int)] = True
    for rows, most in ((few, 6.0), (None, 5.0)):
        found = fit(robot, train, names, start={"tool.z": 0.008}, loss="linear", rows=rows)
        got = fit_residual(found, train).correct(val)
        # 8.8 mm: kernel ridge regression from the commands alone with all rows
        assert 1e3 * score(got.point, val.tip).rmse < most
        assert 1e3 * score(got.model_point, val.tip).rmse > most + 0.5
