"""The verdict on data: benches with a known truth, sentences of the report, invalid input.

All data here are synthetic: made by `bowstring.sweep` with friction, gravity, a tilted base, and
noise.

"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from pydantic import TypeAdapter
from rich.console import Console

import bowstring as bs
from bowstring.calibration.bootstrap import bootstrap
from bowstring.cli.schemas import study as schemas
from bowstring.cli.schemas.results import object_of
from bowstring.constant_curvature import Arc, RobotArcs
from bowstring.data.measurements import STANDARD_GRAVITY, Measurements, load, write_measurements
from bowstring.data.rigid import Rigid
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.reader import load_robot
from bowstring.study import calibration as study_calibration
from bowstring.study import data_validation, report
from bowstring.study import run as study_module
from bowstring.study.data_validation import (
    DATA_MODELS,
    FRAMES,
    AgainstData,
    check_measurements,
    judge_data,
)
from bowstring.study.figure_list import DATA_FIGURES
from bowstring.study.run import run_study
from bowstring.study.settings import Extras
from bowstring.study.study import Study
from bowstring.study.summary import summarise
from bowstring.study.terminal import print_study
from bowstring.validity.loading import Loading
from objects import measured
from shell import Shell
from stages import Stages
from test_study_report import read, table

NOISE = 2e-5
GRAVITY = (0.0, 0.0, -9.81)
FRAME = Rigid.from_rotation_vector(np.radians(0.3) * np.array([0.6, 0.8, 0.0]), [1e-3, -5e-4, 2e-4])
"""Measuring frame to base frame."""


def test_doubts_of_a_table_are_the_first_lines_of_a_study(
    robot: bs.Robot, paper: Study, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rows that are left out, and a shift of all displacements that the arcs do not see."""
    tensions = np.linspace(0.0, 40.0, 5)[:, None] * [1.0, 0.0, 0.0]
    arcs = RobotArcs.from_tensions(robot, tensions)
    moved = robot.length - arcs.lengths() + 0.1
    lost = {"left_out": 3, "below_zero": 3, "least_tension": -0.2}
    data = measured(arcs.tip.position, displacements=moved, **lost)
    found = judge_data(robot, data, 0.01)
    assert [each[:20] for each in found.doubts] == ["3 of 8 rows are left", "The displacements ha"]
    with_data = replace(paper, data=found)
    assert set(found.doubts) <= set(with_data.warnings)
    print_study(with_data, Console(width=400))
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert first.startswith("Check the measurements. 3 of 8 rows are left out")
    assert second.startswith("Check the measurements. The displacements have 100 mm")


def made(
    *,
    stiffness: float = 1.05,
    friction: float = 0.1,
    gravity: tuple[float, float, float] = GRAVITY,
    side: tuple[float, float, float] = (0.0, 0.0, 0.0),
    repeats: int = 3,
    unload: bool = True,
    source: str = "synthetic",
    seed: int = 0,
) -> Measurements:
    """The study's bench, 0:0.5:8 kg on cable 1."""
    robot = load_robot("amouri2019")
    actual = robot.with_(
        {
            "gravity": list(gravity),
            "segments.0.tendons.friction": friction,
            "segments.0.backbone.E": stiffness * robot.segments[0].backbone.E,
        }
    )
    up = STANDARD_GRAVITY * np.arange(0.0, 8.1, 0.5)
    way = np.concatenate([up, up[-2::-1]]) if unload else up
    tensions = np.outer(np.tile(way, repeats), [1.0, 0.0, 0.0])
    found = bs.sweep(actual, tensions, disks=False, load=bs.Load(tip_force=side)).raise_for_status()
    tips = FRAME.inverse().apply(found.tip_position)
    tips += np.random.default_rng(seed).normal(scale=NOISE, size=tips.shape)
    runs = np.repeat(np.arange(1, repeats + 1), len(way))
    about: dict[str, Any] = {"source": source, "name": "a made bench", "repeat": runs}
    return measured(tips, tensions=tensions, sigma=np.full(len(tips), NOISE), **about)


@pytest.fixture(scope="module")
def robot() -> bs.Robot:
    return load_robot("amouri2019").with_({"gravity": list(GRAVITY)})


@pytest.fixture(scope="module")
def bench() -> Measurements:
    return made()


@pytest.fixture(scope="module")
def verdict(robot: bs.Robot, bench: Measurements) -> AgainstData:
    return judge_data(robot, bench, 0.01)


# -- a known truth -----------------------------------------------------------------------------


def test_residuals_of_the_calibrated_rod_are_noise(
    verdict: AgainstData,
) -> None:
    best = verdict.comparison("rod_calibrated")
    assert best.rms == pytest.approx(math.sqrt(3.0) * NOISE, rel=0.1)
    assert best.maximum < 5.0 * NOISE
    assert verdict.residuals is not None and verdict.residuals.is_noise is True
    assert verdict.text[-1] == verdict.residuals.text
    assert "no departure of the residuals from noise" in verdict.residuals.text


def test_expected_error_of_the_calibrated_rod_is_its_error_at_a_new_bench(
    verdict: AgainstData,
) -> None:
    assert verdict.expected is not None and verdict.calibration is not None
    anew = made(seed=99)
    predicted = verdict.calibration.frame.inverse().apply(verdict.calibration.point)
    real = np.linalg.norm(predicted - anew.tip, axis=1).mean()
    low, high = verdict.expected.interval
    assert low <= real <= high
    assert verdict.comparison("rod_calibrated").mean < verdict.expected.mean
    assert "at rows of this kind that it was not fitted to" in " ".join(verdict.text)


def test_parameters_and_frame_match_the_truth(verdict: AgainstData) -> None:
    calibration = verdict.calibration
    assert calibration is not None
    modulus = calibration.robot.segments[0].backbone.E
    assert modulus == pytest.approx(1.05 * 35e9, rel=1e-3)
    assert calibration.robot.tendons.friction == pytest.approx(np.full(3, 0.1), rel=0.01)
    # the frame of the robot: noise and a shift along y that planar motion hardly determines
    tip = np.array([0.0, 0.0, 0.641])
    missed = verdict.frame.apply(FRAME.inverse().apply(tip)) - tip
    assert np.linalg.norm(missed) < 3 * NOISE


def test_all_models_in_all_frames_with_intervals(verdict: AgainstData) -> None:
    assert verdict.models == tuple(DATA_MODELS)
    for name in DATA_MODELS:
        for frame in FRAMES:
            c = verdict.comparison(name, frame)  # type: ignore[arg-type]
            assert c.n == 99 and c.against == "measurement"
            assert c.intervals is not None
            low, high = c.intervals.mean
            assert low <= c.mean <= high
            for axis in range(3):
                low, high = c.intervals.mean_by_axis[axis]
                assert low <= c.mean_by_axis[axis] <= high
            assert c.registered == (frame != "as_measured")
    # its own frame minimises the sum of squares
    for name in DATA_MODELS:
        own, shared = verdict.comparison(name, "own"), verdict.comparison(name)
        assert own.rms <= shared.rms * (1 + 1e-6)


def test_differences_are_model_minus_measurement_in_base_axes(
    verdict: AgainstData, robot: bs.Robot, bench: Measurements
) -> None:
    raw = verdict.comparison("rod", "as_measured")
    expected = bs.solve_batch(robot, bench.tensions).tip_position - bench.tip
    assert raw.difference == pytest.approx(expected, abs=1e-9)
    force = RobotArcs.from_tensions(robot, bench.tensions).tip.position
    shared = verdict.comparison("cc_from_force")
    assert shared.difference == pytest.approx(force - verdict.frame.apply(bench.tip), abs=1e-12)
    # lengths are those of the calibrated rod, as none were measured
    assert verdict.calibration is not None
    actual = bs.sweep(verdict.calibration.robot, bench.tensions)
    lengths = RobotArcs.from_lengths(robot, actual.tendon_lengths).tip.position
    assert verdict.comparison("cc_from_lengths").tip_position == pytest.approx(lengths, abs=1e-9)
    assert any("lengths were not measured" in note for note in verdict.notes)


def test_calibrated_constant_curvature_has_its_best_gain(
    verdict: AgainstData, robot: bs.Robot, bench: Measurements
) -> None:
    (gain,) = verdict.gains.values()
    own = verdict.own_frames["cc_calibrated"]
    angle = RobotArcs.from_tensions(robot, bench.tensions)

    def mean(factor: float) -> float:
        tips = Arc(factor * angle.kappa[:, 0], angle.phi[:, 0], robot.length).fk().position
        return float(np.linalg.norm(tips - own.apply(bench.tip), axis=1).mean())

    mine = verdict.comparison("cc_calibrated").mean
    assert mine == pytest.approx(mean(gain), rel=1e-6)
    # the robust loss lies between squares and absolute values
    assert mine < 1.05 * min(mean(g) for g in np.linspace(0.8, 1.3, 501))


def test_calibrated_constant_curvature_is_judged_as_it_was_fitted(verdict: AgainstData) -> None:
    mine, own = (verdict.comparison("cc_calibrated", f) for f in ("calibrated", "own"))
    assert mine.mean == pytest.approx(own.mean, rel=1e-9)
    assert mine.rms == pytest.approx(own.rms, rel=1e-9)
    # its tips are still compared in the common base frame of all models
    assert mine.tip_position - verdict.point == pytest.approx(mine.difference, abs=1e-12)
    # never worse than the same model uncalibrated, in the same frame
    for frame in ("as_measured", "own"):
        plain = verdict.comparison("cc_from_force", frame)  # type: ignore[arg-type]
        fitted = verdict.comparison("cc_calibrated", frame)  # type: ignore[arg-type]
        assert fitted.rms <= 1.001 * plain.rms


def test_calibrated_constant_curvature_is_not_worse_than_uncalibrated() -> None:
    # gravity in the bending plane: the calibrated rod's base frame is wrong for any arc
    lying = (9.81, 0.0, 0.0)
    robot = load_robot("amouri2019").with_({"gravity": list(lying)})
    found = judge_data(robot, made(gravity=lying, repeats=1), 0.01)
    mine = found.comparison("cc_calibrated").mean
    assert mine < 8e-3 < found.comparison("cc_from_force").mean
    assert mine < found.comparison("cc_from_force", "own").mean
    # the one from lengths has the lengths of the rod, and says so
    assert found.lengths_of == "rod_calibrated"
    assert found.labels["cc_from_lengths"].startswith("CC from lengths of the calibrated rod")
    text = " ".join(found.text)
    assert "from lengths (those of the calibrated rod, for none were measured)" in text
    assert "with a base frame of its own" in text


@pytest.mark.slow
def test_unconverged_constant_curvature_is_not_shown(
    robot: bs.Robot, bench: Measurements, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = study_calibration.calibrate_arc

    def worse(*args: Any) -> study_calibration.ArcCalibration:
        found = real(*args)
        return replace(found, point=found.point * [1.3, 1.0, 1.0])

    monkeypatch.setattr(data_validation, "calibrate_arc", worse)
    found = judge_data(robot, bench, 0.01)
    assert "cc_calibrated" not in found.models and not found.gains
    assert any("constant curvature is left out: its fit ended at" in n for n in found.notes)

    def unsettled(*args: Any) -> study_calibration.ArcCalibration:
        return replace(real(*args), converged=False, message="Stopped after 50 passes.")

    monkeypatch.setattr(data_validation, "calibrate_arc", unsettled)
    found = judge_data(robot, bench, 0.01)
    assert "cc_calibrated" not in found.models
    assert any("did not settle. Stopped after 50 passes." in note for note in found.notes)


def test_effects_one_after_another_end_at_the_calibrated_rod(verdict: AgainstData) -> None:
    assert [e.name for e in verdict.effects] == ["registration", "gravity", "friction", "stiffness"]
    best = verdict.comparison("rod_calibrated").mean
    assert verdict.effects[-1].cumulative_mean == pytest.approx(best, rel=1e-6)
    explained = sum(e.explains for e in verdict.effects)
    assert verdict.baseline_mean - explained == pytest.approx(best, rel=1e-6)
    for effect in verdict.effects:
        assert effect.increase_without == pytest.approx(effect.without - best, abs=1e-12)
        assert (
            effect.increase_without_interval[0]
            <= effect.increase_without
            <= effect.increase_without_interval[1]
        )
        assert effect.increase_without > 1e-3  # each of them matters on this bench
    # registration alone: the effect of the displaced base on a perfect model
    moved = np.linalg.norm(verdict.point - verdict.data.tip, axis=1).mean()
    assert verdict.effects[0].without == pytest.approx(moved, rel=0.01)


def test_the_measuring_frame_affects_registration_only(
    robot: bs.Robot, bench: Measurements, verdict: AgainstData
) -> None:
    far = replace(bench, points=np.add(bench.points, [0.5, 0.0, 1.0]))
    found = judge_data(robot, far, 0.01).effects
    assert [e.name for e in found] == [e.name for e in verdict.effects]
    for there, here in zip(found[1:], verdict.effects[1:], strict=True):
        assert there.explains == pytest.approx(here.explains, abs=1e-6)
        assert there.increase_without == pytest.approx(here.increase_without, abs=1e-6)
    assert found[0].explains > 0.9 * math.hypot(0.5, 1.0)


def test_loads_runs_and_directions(verdict: AgainstData) -> None:
    loads = verdict.loads
    assert loads.count == 17 and len(np.unique(loads.run)) == 3
    assert loads.loading.reshape(3, 33)[0].tolist() == [True] * 17 + [False] * 16
    assert len(np.unique(loads.cell)) == 33
    assert loads.label == "tension of tendon 1 (N)"


def test_resampled_units(verdict: AgainstData, bench: Measurements) -> None:
    unit, words = verdict.loads.resampled
    assert len(np.unique(unit)) == 17 and "17 loads" in words
    assert any("17 loads" in note for note in verdict.notes)
    rng = np.random.default_rng(1)
    loads = replace(verdict.loads, unit=np.arange(400)[rng.permutation(400)])
    unit, words = loads.resampled
    assert np.bincount(unit).tolist() == [20] * 20 and "20 neighbouring rows" in words
    # a path that returns home occasionally is still a path
    home = np.where(np.arange(400) % 10 == 0, 0, np.arange(400))
    assert np.bincount(replace(loads, unit=home).resampled[0]).tolist() == [20] * 20


# -- what the model does not have --------------------------------------------------------------


@pytest.mark.parametrize(("side", "known"), [((0.1, 0.0, 0.0), True), ((0.0, 0.3, 0.0), False)])
@pytest.mark.slow
def test_a_side_force_is_not_noise(
    robot: bs.Robot, side: tuple[float, float, float], known: bool
) -> None:
    """With the gravity of the bench in the robot file, and without."""
    found = judge_data(robot if known else load_robot("amouri2019"), made(side=side), 0.01)
    assert found.residuals is not None and found.residuals.is_noise is False
    assert "The residuals are not noise" in found.text[-1]
    assert found.calibration is not None
    assert found.calibration.other_load and found.calibration.gravity != "calibrated"


def test_gravity_missing_in_the_file_is_detected_and_reported(
    bench: Measurements, verdict: AgainstData
) -> None:
    found = judge_data(load_robot("amouri2019"), bench, 0.01)
    assert found.calibration is not None and verdict.calibration is not None
    assert found.calibration.gravity == "assumed" and verdict.calibration.gravity == "file"
    assert found.calibration.robot.gravity == pytest.approx((0.0, 0.0, -STANDARD_GRAVITY))
    assert found.residuals is not None and found.residuals.is_noise is True
    assert any("has no gravity, the data do" in note for note in found.notes)
    # a held value is reported as known, as if the file had stated it
    name = "segments.*.backbone.E"
    errors = [v.calibration.fit[name].standard_error for v in (found, verdict) if v.calibration]
    assert errors[0] == pytest.approx(errors[1], rel=0.1)


def test_gravity_of_a_tilted_base_is_calibrated() -> None:
    lean = np.radians(1.5)
    askew = 9.81 * np.array([math.sin(lean), 0.0, -math.cos(lean)])
    data = made(gravity=(askew[0], askew[1], askew[2]))
    for file in ([0.0, 0.0, 0.0], list(GRAVITY)):
        found = judge_data(load_robot("amouri2019").with_({"gravity": file}), data, 0.01)
        assert found.calibration is not None and found.calibration.gravity == "calibrated"
        gravity = np.array(found.calibration.robot.gravity)
        errors = [found.calibration.fit[f"gravity.{i}"].standard_error for i in range(3)]
        assert np.all(np.abs(gravity - askew) < 4.0 * np.array(errors))
        assert found.residuals is not None and found.residuals.is_noise is True


def test_no_gravity_is_detected_where_there_is_none() -> None:
    found = judge_data(load_robot("amouri2019"), made(gravity=(0.0, 0.0, 0.0)), 0.01)
    assert found.calibration is not None and found.calibration.gravity == "file"
    assert not any(found.calibration.robot.gravity) and not found.calibration.other_load
    assert [e.name for e in found.effects] == ["registration", "friction", "stiffness"]


@pytest.mark.slow
def test_displacement_control_gives_the_lengths() -> None:
    robot = load_robot("amouri2019").with_({"segments.0.tendons.compliance": 1e-5})
    bend = np.linspace(0.02, 0.7, 24)
    towards = np.linspace(0.0, 2.5, 24)
    displacements = (
        0.029 * bend[:, None] * np.cos(towards[:, None] - np.radians([0.0, 120.0, 240.0]))
    )
    tips = bs.solve_batch(robot, load=bs.Load(displacements=1.02 * displacements)).tip_position
    rng = np.random.default_rng(1)
    data = replace(
        made(repeats=1, unload=True).select(np.arange(24)),
        tensions=np.full((24, 3), np.nan),
        displacements=displacements,
        points=(FRAME.inverse().apply(tips) + rng.normal(scale=NOISE, size=tips.shape))[:, None],
        repeat=np.ones(24, int),
    )
    found = judge_data(robot, data, 0.01)
    assert "cc_from_force" not in found.models
    expected = RobotArcs.from_lengths(robot, 0.641 - displacements).tip.position
    assert found.comparison("cc_from_lengths").tip_position == pytest.approx(expected)
    assert found.calibration is not None
    assert found.calibration.gain == pytest.approx(1.02, abs=2e-3)
    assert found.comparison("rod_calibrated").mean < 3 * NOISE
    assert found.loads.label == "row"
    assert not any("lengths were not measured" in note for note in found.notes)


def test_a_tool_is_compared_at_its_own_position(robot: bs.Robot, bench: Measurements) -> None:
    tool = np.array([0.0, 0.0, 0.02])
    assert robot.hash != load_robot("amouri2019").hash
    plain = made(repeats=1)
    actual = robot.with_({"segments.0.tendons.friction": 0.1, "segments.0.backbone.E": 1.05 * 35e9})
    turned = bs.sweep(actual, plain.tensions, disks=False).tip_rotation
    moved = FRAME.inverse().apply(FRAME.apply(plain.tip) + turned @ tool)
    found = judge_data(robot, replace(plain, points=moved[:, None], tool=tool), 0.01)
    assert found.comparison("rod_calibrated").mean < 3 * NOISE
    assert any("from the tip in its axes" in note for note in found.notes)


@pytest.mark.slow
def test_a_real_robot(public_data: Callable[[str], Path]) -> None:
    """Measured: three segments, nine tendons actuated by displacements, motion capture."""
    public_data("crl-ftdcr-mocap")
    data = load("crl-ftdcr-mocap", "train").select(slice(0, 400))
    found = judge_data(load_robot("crl-ftdcr-v4"), data, 0.01)
    assert found.label == "measured: crl-ftdcr-mocap, train"
    order = [found.comparison(n).mean for n in ("rod_calibrated", "rod", "cc_from_lengths")]
    assert order == sorted(order) and order[0] < 7e-3 < 15e-3 < order[2]
    assert found.comparison("cc_calibrated").mean > order[0]
    assert found.residuals is not None and found.residuals.is_noise is False
    assert "cc_from_force" not in found.models and len(found.gains) == 3
    assert any("a study holds friction" in note for note in found.notes)
    assert "neighbouring rows" in found.loads.resampled[1]


@pytest.mark.slow
def test_rows_without_a_tip_lead_the_path(robot: bs.Robot) -> None:
    """Synthetic: tips near the peak load are missing; without their rows the path breaks."""
    whole = made(repeats=1)
    gap = whole.points.copy()
    gap[13:20] = np.nan
    data = replace(whole, points=gap)
    found = judge_data(robot, data, 0.01)
    best = found.comparison("rod_calibrated")
    assert best.n == 26 and best.rms == pytest.approx(math.sqrt(3.0) * NOISE, rel=0.3)
    assert found.residuals is not None and found.residuals.is_noise is True
    assert "7 of the rows have no measured tip" in found.text[0]
    assert all(c.n == 26 and c.intervals is not None for c in found.comparisons)
    assert not any("has no solution" in note for note in found.notes)
    said = found.to_dict()
    assert said["rows"] == 33 and said["without_tip"] == 7
    # as many resampled loads as were measured: intervals are those of these rows only
    errors = best.difference[data.seen]
    [alone] = bootstrap([errors], found.loads.unit[data.seen])
    assert best.intervals is not None
    np.testing.assert_array_equal(best.intervals.mean, alone.mean)
    broken = judge_data(robot, replace(data.select(data.seen), left_out=7), 0.01)
    assert broken.comparison("rod_calibrated").rms > 10 * best.rms
    assert any("7 rows were left out of it" in note for note in broken.notes)


# -- bad input ---------------------------------------------------------------------------------


def test_measurements_that_cannot_be_validated(robot: bs.Robot, bench: Measurements) -> None:
    count = len(bench)
    gap = bench.points.copy()
    gap[3:] = np.nan
    still = np.broadcast_to(bench.points[:1], bench.points.shape)
    cases: list[tuple[Measurements, str]] = [
        (bench.select([3]), "there is one row"),
        (bench.select([1, 5, 9]), "there are 3 rows"),
        (bench.select(np.flatnonzero(bench.tensions[:, 0] == 0.0)), "all rows are at one load"),
        (bench.select(np.flatnonzero(bench.tensions[:, 0] < 6.0)), "at 2 loads only"),
        (replace(bench, points=gap), "there are 3 rows"),
        (replace(bench, points=still), "the tip is in the same place"),
        (replace(bench, scale=None), "in pixels"),
    ]
    for data, words in cases:
        with pytest.raises(InputError, match=re.escape(words)):
            check_measurements(robot, data)
    with pytest.raises(InputError, match="measurements is 3, it must be the path of a table"):
        bs.run_study(robot, measurements=3)  # type: ignore[operator]
    with pytest.raises(InputError, match="are of 3 tendons, rao2021 has 6"):
        check_measurements(load_robot("rao2021"), bench)
    many = bench.select(np.arange(count).repeat(300))
    with pytest.raises(InputError, match="29700 rows are too many"):
        check_measurements(robot, many)


def test_swapped_tendons_are_named_before_any_work() -> None:
    robot = load_robot("rao2021")
    rng = np.random.default_rng(1)
    tensions = rng.uniform(0, 1.5, (40, 6)) * (rng.random((40, 6)) < 0.5)
    tips = bs.solve_batch(robot, tensions).tip_position
    data = measured(tips, tensions=tensions[:, [0, 1, 2, 4, 3, 5]])
    with pytest.raises(InputError, match="4 and 5"):
        check_measurements(robot, data)


@pytest.mark.slow
def test_a_rotated_base_is_reported(robot: bs.Robot, bench: Measurements) -> None:
    # tendon 2 acts where tendon 1 is stated: in one plane a rotated base explains it as well
    data = replace(bench, tensions=bench.tensions[:, [1, 0, 2]])
    check_measurements(robot, data)
    text = " ".join(judge_data(robot, data, 0.01).text)
    assert "the base is turned by 120 deg against" in text
    assert "if it is not, tendons 1 and 2 are swapped" in text


def test_a_mean_over_some_rows_is_labelled(robot: bs.Robot, bench: Measurements) -> None:
    # kg instead of g: only the unloaded rows have an equilibrium
    found = judge_data(robot, replace(bench, tensions=1e3 * bench.tensions), 0.01)
    rod = found.comparison("rod")
    assert 0 < rod.n < len(bench)
    assert f"as the robot file has it over {rod.n} of {len(bench)} rows" in " ".join(found.text)


# -- the study and its report ------------------------------------------------------------------


@pytest.fixture(scope="module")
def whole(robot: bs.Robot, bench: Measurements) -> Study:
    """The whole study with one run of measurements and a comparison on left-out rows."""
    data, extras = bench.select(bench.repeat == 1), Extras(compare=True)
    return run_study(robot, measurements=data, loading=Loading(points=5), extras=extras)


def test_json_is_as_its_schema_has_it(whole: Study) -> None:
    TypeAdapter(object_of(schemas.StudyResults)).validate_python(whole.to_dict(), strict=True)


@pytest.fixture(scope="module")
def written(whole: Study, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report.write(whole, tmp_path_factory.mktemp("study") / "out")


@pytest.mark.slow
def test_calibrated_friction_enters_the_budget(whole: Study, written: Path) -> None:
    budget = whole.budget.actuation
    assert whole.data is not None and whole.data.calibration is not None
    assert (
        budget.friction_origin == "calibrated"
        and budget.to_dict()["friction_origin"] == "calibrated"
    )
    assert budget.friction == whole.data.calibration.robot.tendons.friction[0]
    assert "(calibrated)" in budget.row("friction_loading").label
    assert f"With the calibrated one, {budget.friction:.4g}" in whole.verdict.text[-1]
    assert any("are without the friction that was calibrated" in note for note in whole.notes)
    page = (written / "report.html").read_text(encoding="utf-8")
    assert f"Calibrated to the data: friction {budget.friction:.4g}" in page
    assert "gives none: friction" not in page


def test_the_json_has_the_comparisons_and_the_block(written: Path, whole: Study) -> None:
    content = json.loads((written / "study.json").read_text(encoding="utf-8"))
    against = [c for c in content["comparisons"] if c["against"] == "measurement"]
    assert {c["name"] for c in against} == set(DATA_MODELS)
    for name in ("cc_from_lengths", "cc_from_force", "cc_calibrated", "rod", "rod_calibrated"):
        first, *others = (c for c in against if c["name"] == name)
        assert first["registered"] is True and first["frame"] == "calibrated"
        assert {c["frame"] for c in others} == {"as_measured", "own"}
        assert first["interval_95"]["mean_mm"][0] <= first["mean_mm"]
    block = content["measurements"]
    assert {"source", "name", "rows", "left_out", "registration", "calibration", "residuals"} <= (
        set(block)
    )
    assert block["source"] == "synthetic" and block["rows"] == 33 and block["left_out"] == 0
    assert block["residuals"]["noise"] is True
    assert block["bootstrap"]["resamples"] == 2000 and block["bootstrap"]["units"] == 17
    assert content["data"] == "simulated; synthetic: a made bench"
    assert whole.comparison("rod_calibrated", "measurement").registered  # type: ignore[attr-defined]
    # the simulated part equals that of the study without measurements
    alone = Stages(whole.robot, points=5)
    assert [c for c in content["comparisons"] if c["against"] != "measurement"] == [
        c.to_dict()
        for c in (
            *alone.comparisons.values(),
            *alone.in_time.values(),
            *alone.shapes.comparisons,
        )
    ]


def test_the_page_has_the_figures_and_labels_the_data(written: Path, whole: Study) -> None:
    source = (written / "report.html").read_text(encoding="utf-8")
    text = " ".join(re.sub(r"<svg.*?</svg>|<[^>]*>", " ", source, flags=re.DOTALL).split())
    assert whole.data is not None
    for sentence in (*whole.data.text, *whole.data.notes):
        assert " ".join(sentence.split()) in text.replace("&#39;", "'").replace("&amp;", "&")
    for figure in DATA_FIGURES:
        assert f'id="{figure.stem}"' in source
        drawn = re.search(rf'id="{figure.stem}">.*?</svg>', source, flags=re.DOTALL)
        assert drawn is not None and "synthetic" in drawn.group()
        if figure.stem.startswith("fig"):
            assert "registered: in the base frame of rod calibrated" in drawn.group()
        assert re.search(rf'id="{figure.stem}">.*?Synthetic: a made bench\. ', source, re.DOTALL)
    page = read(written / "report.html")
    assert page.open == [] and len(page.ids) == len(set(page.ids))
    assert all(r.startswith("#") and r[1:] in page.ids for r in page.references)
    assert "not registered" in text and "bootstrap intervals at 95 %" in text
    assert len(re.findall("<caption>", source)) == len(re.findall("<table>", source))
    assert "measured tip (mm)" not in text  # nothing here was measured


def test_the_verdict_divides_the_error_of_left_out_rows(written: Path, whole: Study) -> None:
    assert whole.data is not None
    found = whole.data.models_compared
    assert found is not None and found.memory is not None
    assert found.memory.name == "rod_friction"  # the bench has it
    parts = whole.to_dict()["measurements"]["comparison"]["parts"]
    names = ("parameters", "physics", "memory", "noise", "unexplained")
    assert sum(parts[f"{name}_mm"] for name in names) == pytest.approx(parts["total_mm"])
    assert found.verdict in whole.data.text[-1]
    assert "the rod with tendon friction is the one to use" in whole.data.text[-1]
    assert dict(summarise(whole).findings)["Rows left out of the fits"] == found.verdict.rstrip(".")
    rows = {row["model"]: row for row in table(written, "measured_models")}
    assert rows["rod_friction"]["chosen"] == "yes" and rows["cc"]["source"] == "synthetic"
    assert float(rows["rod_friction"]["left_out_mean_mm"]) == pytest.approx(
        1e3 * np.nanmean(found.memory.errors)
    )


def test_a_comparison_needs_measurements_and_the_cosserat_rod(
    robot: bs.Robot, bench: Measurements
) -> None:
    for given in ({}, {"measurements": bench, "theory": "kirchhoff"}):
        with pytest.raises(InputError, match="give measurements, and leave theory out"):
            run_study(robot, extras=Extras(compare=True), **given)  # type: ignore[arg-type]


def test_the_tables_label_the_data_in_each_row(written: Path, whole: Study) -> None:
    rows = table(written, "measured")
    assert len(rows) == 33 and {row["source"] for row in rows} == {"synthetic"}
    assert whole.data is not None
    assert float(rows[5]["registered_x_mm"]) == pytest.approx(whole.data.point[5, 0] * 1e3)
    best = whole.data.comparison("rod_calibrated").tip_position[5, 2] * 1e3
    assert float(rows[5]["rod_calibrated_z_mm"]) == pytest.approx(best)
    compared = table(written, "measured_comparisons")
    assert len(compared) == 21 and {row["registered"] for row in compared} == {"yes", "no"}
    assert all(row["against"] != "measurement" for row in table(written, "comparisons"))


@pytest.mark.slow
def test_a_failed_calibration_keeps_the_other_results(
    robot: bs.Robot,
    bench: Measurements,
    whole: Study,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fails = Mock(side_effect=NoSolutionError("99 rows have no solution to begin with"))
    monkeypatch.setattr(data_validation, "calibrate", fails)
    judged = judge_data(robot, bench, 0.01)
    assert judged.calibrated_friction is None
    simulated = (c for c in whole.comparisons if c.against != "measurement")
    found = replace(whole, data=judged, comparisons=(*simulated, *judged.comparisons))
    assert found.data is not None
    assert "rod_calibrated" not in found.data.models and found.data.frame_by == "rod"
    assert {"cc_from_force", "cc_calibrated", "rod"} <= set(found.data.models)
    assert any("99 rows have no solution to begin with" in note for note in found.data.notes)
    content = found.to_dict()["measurements"]
    assert content["calibration"] is None and content["residuals"] is None
    folder = report.write(found, tmp_path / "out")
    source = (folder / "report.html").read_text(encoding="utf-8")
    assert 'id="measured_comparison"' in source
    assert 'id="measured_residuals"' not in source and 'id="measured_parts"' not in source
    assert content["comparison"] is None


def test_the_fewest_rows_are_validated(robot: bs.Robot, bench: Measurements) -> None:
    found = judge_data(robot, bench.select([0, 5, 10, 16]), 0.01)
    assert found.comparison("rod").n == 4
    assert "4 rows at 4 loads, loading only." in found.text[0]
    # fewer points than parameters: as in the file, and the report gives the reason
    assert found.calibration is None and found.residuals is None
    assert any("too few" in note for note in found.notes)
    found = judge_data(robot, bench.select([0, 2, 4, 6, 8, 10, 12, 14, 16]), 0.01)
    assert found.calibration is not None and found.residuals is not None


@pytest.mark.slow
def test_the_command(
    shell: Shell,
    bench: Measurements,
    whole: Study,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    file = write_measurements(bench.select(bench.repeat == 1), tmp_path / "bench.csv")

    def run(robot: bs.Robot, **given: Any) -> Study:
        """The study with other measurements, after the given ones are read."""
        assert robot.hash == whole.robot.hash and given["loading"].points == 3
        read_here = study_module.as_measurements(robot, given["measurements"])
        assert read_here.tip == pytest.approx(bench.tip[bench.repeat == 1], abs=1e-9)
        return whole

    monkeypatch.setattr(study_module, "run_study", run)
    set_gravity = ("--set", "gravity=0 0 -9.81 m/s^2")
    code, out, _ = shell(
        "study", "amouri2019", "--measurements", str(file), "--points", "3", *set_gravity,
        "--out", str(tmp_path / "out"), "--verbose",
    )  # fmt: skip
    assert code == 0
    assert "Measurements: Synthetic data, a made bench" in " ".join(out.split())
    assert "Tip error against the data; synthetic: a made bench" in out
    assert "no departure of the residuals from noise" in " ".join(out.split())
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_study_of_51_points_is_quick(tmp_path: Path) -> None:
    data: Any = made(unload=False)
    assert len(data) == 51
    robot = load_robot("amouri2019")
    before = time.process_time()
    judge_data(robot, data, 0.01)
    # of 15 s for the whole study; the rest is drawing. CPU time: other work may run in parallel
    assert time.process_time() - before < 5.0
