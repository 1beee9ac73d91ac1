"""Comparison of models: choice on synthetic benches, parts of the error, bad input, output."""

from __future__ import annotations

import csv
import json
import re
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks.model_choice import NOISE, E, compared, table
from numpy.typing import NDArray
from rich.table import Table

import bowstring as bs
from bowstring.calibration import Data, JudgedModel, ModelComparison, Prior, compare_models
from bowstring.calibration.cross_validation import cross_validate
from bowstring.calibration.error_parts import noise_of, parts_of
from bowstring.calibration.figures import draw_parts
from bowstring.calibration.folds import part_of_rows
from bowstring.calibration.memories import Memory, parameters_of, starts_of
from bowstring.calibration.model_choice import blocks_of, choose, gain
from bowstring.calibration.model_comparison import ComparisonInterrupted
from bowstring.calibration.observations import commands
from bowstring.cli.fit import _comparison_tables, _with_estimate
from bowstring.data.measurements import Measurements
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import Robot
from shell import Shell, adapter

Floats = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
#: Memories by whether a bench is displacement-controlled.
BENCHES = [
    (True, "none"),
    (True, "backlash"),
    (True, "friction"),
    (True, "hysteresis"),
    (False, "none"),
    (False, "friction"),
    (False, "hysteresis"),
]


@pytest.fixture(scope="module")
def remembered() -> ModelComparison:
    """Comparison on a bench with backlash."""
    return compared(True, "backlash", 0, 60)


# -- parts of the error ---------------------------------------------------------------------------


def test_parts_add_up_with_negative_ones() -> None:
    rng = np.random.default_rng(3)
    means = np.array([[8e-3], [1e-3], [3e-3], [0.0]])
    stated, arcs, rod, memory = means + rng.uniform(1e-3, 5e-3, (4, 50))
    arcs[7] = memory[9] = np.nan
    noise = np.full(50, NOISE)
    verdict = parts_of(stated, arcs, rod, memory, None).verdict("backlash")
    assert re.fullmatch(
        r"Most of the \S+ mm of constant curvature are parameters and geometry \(\S+ mm\): mend "
        r"these first, by calibration\.",
        verdict,
    )
    for last in (None, memory):
        for known in (None, (noise, "stated")):
            parts = parts_of(stated, arcs, rod, last, known)  # type: ignore[arg-type]
            assert sum(parts.known.values()) == pytest.approx(parts.total, rel=1e-14)
            assert parts.physics < 0.0 < parts.parameters
            assert parts.rows == (49 if last is None else 48)
            assert parts.memory == 0.0 or last is not None
            assert ("noise" in parts.known) == (known is not None)
    seen = np.isfinite(arcs + memory)
    assert parts.total == pytest.approx(stated[seen].mean())
    with pytest.raises(NoSolutionError, match="no held-out row"):
        parts_of(stated, np.full(50, np.nan), rod, None, None)


def test_noise_is_that_of_repeats_else_as_stated() -> None:
    rng = np.random.default_rng(1)
    runs, loads = 6, 40
    tensions = np.tile(np.arange(loads)[:, None] * [1.0, 0.0, 0.0], (runs, 1))
    tips = 0.5 * NOISE * rng.standard_normal((runs * loads, 3)) + tensions
    data = Data(points=tips, tensions=tensions)
    assert noise_of(data, tensions, tips) is None
    stated = replace_of(data, sigma=np.full(len(tips), NOISE))
    assert noise_of(stated, tensions, tips)[1] == "stated"  # type: ignore[index]
    repeated = replace_of(stated, repeat=np.repeat(np.arange(runs), loads))
    found = noise_of(repeated, tensions, tips)
    assert found is not None and found[1] == "repeats"
    np.testing.assert_allclose(found[0], 0.5 * NOISE, rtol=0.1)


def replace_of(data: Any, **columns: Any) -> Any:
    """Object with the attributes of other data and further columns."""
    names = ("tensions", "displacements", "points", "group", "time", "sigma", "repeat")
    given = {name: getattr(data, name, None) for name in names}
    return type("Rows", (), {**given, **columns})()


# -- choice ---------------------------------------------------------------------------------------


def test_a_missing_compliance_is_no_creep(robot: Robot) -> None:
    """Disks that clamp the backbone make the tendons act on a stiffer robot, whatever the time."""
    data = table(True, "none, disks clamp", 1001, 120)
    found = compare_models(robot, data, ["base", "gain"], memories=["creep"])
    assert found.memory is None and found.chosen.name == "rod_calibrated"
    assert "no better than a compliance of the tendons" in found["rod_creep"].reason


def test_a_model_is_chosen_if_it_is_clearly_better() -> None:
    rng = np.random.default_rng(0)
    rows, part = np.arange(100), np.arange(100) // 20
    block = blocks_of(part, rows % 10 != 3)
    assert set(block[rows % 10 == 3]) == {-1} and len(set(block)) == 21
    assert all(len(set(part[block == k])) == 1 for k in range(20))
    simple = 1e-3 * rng.uniform(0.5, 1.5, 100)
    assert choose([simple, simple], block) == 0
    mixed = simple * np.where(block % 2, 1.1, 0.88)  # less on average, by chance
    assert mixed.mean() < simple.mean() and choose([simple, mixed], block) == 0
    assert choose([simple, 0.8 * simple], block) == 1
    assert choose([2 * simple, simple, simple * rng.uniform(0.9, 1.1, 100)], block) == 1
    # a tenth less in all blocks counts, whatever the errors in a block are
    size = np.where(rows < 10, 100.0, 1.0)
    assert gain(simple * size, 0.9 * simple * size, block).mean == pytest.approx(-np.log(0.9))
    assert gain(simple * 1e-9, simple * 1e-12, block).mean == 0.0  # both without error


def test_a_bench_without_memory_has_none() -> None:
    found = compared(True, "none", 0, 60)
    assert found.memory is None and found.parts.memory == 0.0
    assert found.chosen.name in ("rod", "rod_calibrated")
    assert found.chosen.left_out is not None
    assert found.chosen.left_out.mean == pytest.approx(1.6 * NOISE, rel=0.15)


def test_numbers_of_a_comparison(remembered: ModelComparison) -> None:
    found = remembered
    assert found.chosen is found.memory is found["rod_backlash"]
    fit = found.chosen.fit
    assert fit is not None and fit.values["backlash"] == pytest.approx(2.5e-4, rel=0.05)
    parts = found.parts
    assert sum(parts.known.values()) == pytest.approx(parts.total, rel=1e-14)
    assert parts.noise == pytest.approx(NOISE * np.sqrt(8 / np.pi)) and found.on == "folds"
    names = ["cc", "cc_calibrated", "rod_calibrated", "rod_backlash"]
    a, b, d, e = (found[name].errors.mean() for name in names)
    assert parts.parameters == pytest.approx(a - b) and parts.physics == pytest.approx(b - d)
    assert parts.memory == pytest.approx(d - e)
    assert parts.memory == max(parts.known.values()) and "add backlash" in found.verdict
    assert abs(parts.unexplained) < 0.2 * parts.noise
    with pytest.raises(InputError, match="was not compared"):
        found["rod_set"]


@pytest.mark.slow
@pytest.mark.parametrize(("by_displacement", "memory"), BENCHES)
def test_memories_are_found_and_none_is_invented(by_displacement: bool, memory: str) -> None:
    """A small version of `python -m benchmarks.model_choice`, where all of these were right."""
    found = [compared(by_displacement, memory, seed, 90) for seed in (100, 101)]
    expected = None if memory == "none" else f"rod_{memory}"
    names = [None if each.memory is None else each.memory.name for each in found]
    assert names == [expected] * 2


def test_a_memory_that_cannot_be_fitted_has_a_reason(robot: Robot) -> None:
    data = table(False, "none", 1, 40)
    names = ["base", "segments.0.tendons.friction"]
    found = compare_models(robot, data, names, memories=("backlash", "friction"))
    assert [each.name for each in found.models[4:]] == ["rod_backlash", "rod_friction"]
    for name, reason in (("backlash", "tension-controlled"), ("friction", "given parameters")):
        judged = found[f"rod_{name}"]
        assert reason in judged.reason and judged.left_out is None
        with pytest.raises(InputError, match="has no numbers"):
            _ = judged.errors
    assert found.memory is None


def test_progress_is_reported_for_each_fit_and_can_interrupt(robot: Robot) -> None:
    data, seen = table(False, "none", 1, 40), list[tuple[str, float]]()
    names = ["base", E]
    compare_models(
        robot, data, names, memories=["backlash"], progress=lambda *given: seen.append(given)
    )
    shares = [share for _, share in seen]
    assert shares == sorted(shares) and shares[0] == 0.0 and seen[-1] == ("done", 1.0)
    # before the fit to all rows, after it, and after each of five folds
    assert [name for name, _ in seen].count("rod, calibrated") == 7

    def stop(name: str, share: float) -> None:
        if name == "rod with tendon friction":  # no failure of this memory
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        compare_models(robot, data, names, memories=["friction"], progress=stop)
    stopped = caught.value
    assert isinstance(stopped, ComparisonInterrupted) and stopped.unfinished == ("rod_friction",)
    whole = compare_models(robot, data, names, memories=())
    for mine, each in zip(stopped.models, whole.models, strict=True):
        assert mine.name == each.name and mine.left_out == each.left_out


def test_models_without_frames_are_judged_as_they_stand(robot: Robot) -> None:
    data = table(False, "none", 1, 40)
    found = compare_models(robot, data, [E], memories=())
    stated: JudgedModel = found["rod"]
    assert stated.parameters == () and stated.fit is None and stated.fitted == stated.left_out
    tips = bs.sweep(robot, data.tensions).tip_position
    np.testing.assert_allclose(stated.errors, np.linalg.norm(tips - data.tip, axis=1), atol=1e-5)


def test_validation_rows_are_divided(robot: Robot) -> None:
    data, other = (table(False, "none", seed, 40) for seed in (1, 2))
    found = compare_models(robot, data, ["base", E], validation=other, memories=())
    assert found.on == "validation" and found.parts.rows == 40
    scores = [found[name].validation for name in ("cc", "cc_calibrated", "rod_calibrated")]
    a, b, d = (score.mean for score in scores if score is not None)
    assert found.parts.total == pytest.approx(a)
    assert found.parts.physics == pytest.approx(b - d)
    fit = found["rod_calibrated"].fit
    assert fit is not None
    own = np.linalg.norm(fit.predict(other) - other.tip, axis=1)
    assert d == pytest.approx(own.mean())


# -- bad input ------------------------------------------------------------------------------------


def test_bad_input_is_refused_before_work(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def never(*given: Any, **named: Any) -> None:
        raise AssertionError("work has begun")

    monkeypatch.setattr("bowstring.calibration.model_comparison.fit_from", never)
    data = table(False, "none", 1, 40)

    def refused(
        says: str, data: Measurements = data, names: Any = ("base", E), **more: Any
    ) -> None:
        with pytest.raises(InputError, match=says):
            compare_models(robot, data, list(names), **more)

    refused("12 rows with a measured tip are too few .* measure 20", data.select(slice(0, 12)))
    refused("too few .* 30 folds", folds=30)
    refused("whole number from 2", folds=1)
    refused("memory 'set' is unknown", memories=["set"])
    refused("leave it out, calibrated constant curvature has it", names=["base", "bend_gain"])
    refused("there is no parameter", names=["base", "stiffness"])
    refused("prior of base is for several parameters", names=[Prior("base", 1e-3)])
    half = data.select(slice(20, 40))
    refused("20 of 20 validation rows are also fitted, the first in line 22", validation=half)
    blank = replace(half, points=np.full_like(half.points, np.nan))
    refused("no measured tip to validate", validation=blank)
    time = np.arange(40.0)
    time[[10, 11]] = time[[11, 10]]
    disordered = replace(data, time=time)
    refused("row 12 is earlier .* a memory needs rows in the order of measurement", disordered)
    other = replace(table(False, "none", 2, 40), time=time)
    refused("row 12 is earlier .* in virtual bench a memory needs", validation=other)
    with pytest.raises(AssertionError):  # without a memory the order is free
        compare_models(robot, disordered, ["base", E], memories=())


def test_times_restart_with_each_recording(robot: Robot) -> None:
    rows = np.arange(60)
    data = replace(table(False, "none", 3, 60), recording=rows % 2, time=5.0 * (rows // 2))
    found = compare_models(robot, data, ["base", E], memories=["relaxation"])
    assert found["rod_relaxation"].fit is not None and found.memory is None
    with pytest.raises(InputError, match="must be Measurements"):
        compare_models(robot, Data(points=data.tip, tensions=data.tensions), [E])  # type: ignore[arg-type]


def test_the_loss_is_that_of_all_fits(robot: Robot) -> None:
    data, loss = table(False, "none", 2, 20), "linear"
    found = compare_models(robot, data, ["base", E], folds=2, loss=loss, memories=())
    alone = found["rod_calibrated"].fit
    assert alone is not None
    whole = bs.fit(robot, data, ["base", E], loss=loss)
    assert alone.values == whole.values
    # the base is registered before
    assert all(each.start for each in alone.estimates if each.name.startswith("base"))
    begin = {E: alone.values[E]}
    crossed = cross_validate(whole, data, start=begin, folds=2)
    np.testing.assert_array_equal(found["rod_calibrated"].residuals, crossed.residuals)


@pytest.mark.parametrize("memory", ["hysteresis", "creep", "friction"])
def test_folds_end_where_fits_to_their_rows_do(robot: Robot, memory: Memory) -> None:
    data, names = table(True, memory, 4, 60), ["base", "gain", *parameters_of(memory)]
    start = starts_of(memory, robot, commands(data, robot))[-1]
    whole = bs.fit(robot, data, names, start=start)
    assert whole.converged
    crossed = cross_validate(whole, data, folds=3, start=whole.values)
    part, _ = part_of_rows(data, data.displacements, np.ones(len(data), bool), 3)
    for k in range(3):
        alone = bs.fit(robot, data, names, start=whole.values, rows=part != k)
        apart = np.linalg.norm(crossed.residuals - alone.residuals, axis=1)[part == k]
        assert apart.max() < 0.1 * alone.noise


# -- output ---------------------------------------------------------------------------------------


def test_the_bar_adds_up(remembered: ModelComparison) -> None:
    parts = replace(remembered.parts, physics=-1e-3, total=remembered.parts.total - 1e-3)
    figure = draw_parts(replace(remembered, parts=parts), "synthetic: a bench")
    (axes,) = figure.axes
    bars = [(bar.get_x(), bar.get_width()) for bar in axes.patches]
    assert sum(width for _, width in bars) == pytest.approx(
        1e3 * sum(parts.known.values()), rel=1e-12
    )
    ends = sorted((x + min(width, 0.0), x + max(width, 0.0)) for x, width in bars)
    assert all(a[1] == pytest.approx(b[0]) for a, b in pairwise(ends))
    assert axes.get_xlabel().endswith("(mm)")
    assert len(axes.get_legend().get_texts()) == 5  # type: ignore[union-attr]


def test_the_table_marks_the_choice(remembered: ModelComparison) -> None:
    judged = replace(remembered["rod_hysteresis"], fitted=None, left_out=None, reason="not found")
    models = (*remembered.models[:-1], judged)
    sentence, table, *rest = _comparison_tables(replace(remembered, models=models), None)
    assert isinstance(table, Table) and "5 folds" in str(sentence)
    marks = dict(zip(*(table.columns[k].cells for k in (1, 0)), strict=True))
    assert [name for name, mark in marks.items() if mark == "*"] == ["rod with backlash"]
    assert list(table.columns[-1].cells)[-1] == "-"
    text = " ".join(each for each in rest if isinstance(each, str))
    assert "Rod with backbone hysteresis: not found." in text
    assert "Fit it with --parameter backlash besides." in text and remembered.verdict in text


def test_a_stopped_comparison_keeps_what_is_done(
    shell: Shell, tmp_path: Path, remembered: ModelComparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = ROOT / "examples" / "bench.csv", tmp_path / "out"
    call = ("fit", "amouri2019", "--measurements", str(file), "--parameter", E, "--compare")
    module = sys.modules["bowstring.calibration.model_comparison"]
    names = [each.name for each in remembered.models]

    def compare(*args: object, **more: object) -> ModelComparison:
        raise ComparisonInterrupted(remembered.models[:count], names[count:], 5)

    monkeypatch.setattr(module, "compare_models", compare)
    count = 0
    assert shell(*call, "--out", str(out)) == (130, "", "Stopped: nothing was written.\n")
    assert not out.exists()
    count = 3
    code, text, err = shell(*call)
    assert (code, err) == (130, "Stopped: 3 of 9 models are finished.\n")
    assert text.startswith("Incomplete: 3 of 9 models are finished.") and "*" not in text
    assert "constant curvature, calibrated" in text and "backlash" not in text
    code, text, err = shell(*call, "--out", str(out), "--json")
    assert code == 130 and "3 of 9 models are finished; " in err and "without a fit" in err
    adapter("fit --compare, stopped").validate_json(text, strict=True)
    got = json.loads(text)
    assert [each["model"] for each in got["models"]] == names[:3]
    assert got["unfinished"] == names[3:] and got["folder"] == str(out)
    assert sorted(each.name for each in out.iterdir()) == ["fit.json", "models.csv"]
    with (out / "models.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["model"] for row in rows] == names[:3] and not any(row["chosen"] for row in rows)

    # stopped in the fit itself all models are kept, in a folder that may be replaced
    def stop(*args: object, **more: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(module, "compare_models", lambda *args, **more: remembered)
    with monkeypatch.context() as patch:
        patch.setattr(sys.modules["bowstring.calibration.table_fit"], "calibrate", stop)
        code, _, err = shell(*call, "--out", str(out))
    assert code == 130 and "9 of 9 models are finished; " in err
    assert len(json.loads((out / "fit.json").read_text(encoding="utf-8"))["models"]) == 9

    # a complete fit stays
    (out / "robot.yaml").touch()
    (out / "fit.json").write_text('{"files": ["fit.json", "models.csv", "robot.yaml"]}')
    monkeypatch.setattr(module, "compare_models", compare)
    code, _, err = shell(*call, "--out", str(out))
    assert code == 130 and "they are not written: " in err and "a complete fit, which stays" in err
    assert (out / "robot.yaml").exists()


def test_a_long_comparison_says_how_long_it_takes(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    times = iter([0.0, 5.0, 60.0, 90.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(times))
    seen: list[float] = []
    update = _with_estimate(lambda what, done: seen.append(done))
    for done in (0.0, 0.1, 0.2):
        update("rod", done)
    assert seen == [0.0, 0.1, 0.2]
    said = capsys.readouterr().err
    assert said.count("Note: ") == 1 and "takes about 9 minutes more" in said


def test_the_command_writes_the_comparison(
    shell: Shell, tmp_path: Path, remembered: ModelComparison, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compare(robot: Robot, data: Measurements, names: list[str], **more: Any) -> ModelComparison:
        assert robot.gravity[2] == -9.80665 and (len(data), names) == (33, ["base", E])
        assert more["folds"] == 5 and more["validation"] is None
        return remembered

    monkeypatch.setattr("bowstring.calibration.model_comparison.compare_models", compare)
    file, out = ROOT / "examples" / "bench.csv", tmp_path / "out"
    flags = ("--set", "gravity=0 0 -9.80665 m/s^2", "--parameter", "base", "--parameter", E)
    command = ("fit", "amouri2019", "--measurements", str(file), *flags, "--compare")
    got = shell.json(*command, "--out", str(out))["comparison"]
    assert got["chosen"] == got["memory"] == "rod_backlash" and got["folds"] == 5
    parts = [value for name, value in got["parts"].items() if name.endswith("_mm")]
    assert 2 * parts[0] == pytest.approx(sum(parts), rel=1e-12)
    assert got["parts"]["noise_source"] == "stated"
    with (out / "models.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert [row["model"] for row in rows] == [each["model"] for each in got["models"]]
    assert [row["model"] for row in rows if row["chosen"] == "yes"] == ["rod_backlash"]
    shown = {row["model"]: row["left_out_mean_mm"] for row in rows}
    for each in got["models"]:
        if each["left_out"] is None:
            assert shown[each["model"]] == "" and each["reason"]
        else:
            assert float(shown[each["model"]]) == pytest.approx(each["left_out"]["mean_mm"])
    assert "<svg" in (out / "error_parts.svg").read_text(encoding="utf-8")
