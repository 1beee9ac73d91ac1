"""The verdict: crossings against an independent sweep, and sentences that match the numbers."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bowstring.constant_curvature import Arc
from bowstring.formatting import in_mm
from bowstring.robot.reader import load_robot
from bowstring.statics import rod
from bowstring.study import verdict
from bowstring.study.combinations import combinations, worst_combination
from bowstring.study.study import Study
from stages import Stages

MM = 1e-3
EI = 35e9 * math.pi / 64 * 0.005**4  # of the study's robot, N m^2


def test_first_crossing_against_an_independent_sweep(paper: Study) -> None:
    robot = paper.robot
    tension = np.arange(50.0, 65.0, 0.01)
    sweep = rod.sweep(robot, np.column_stack([tension, 0 * tension, 0 * tension]))
    tip = Arc(tension * 0.029 / EI, 0.0, robot.length).fk().position
    error = np.linalg.norm(tip - sweep.tip_position, axis=1)
    crossing = float(tension[np.argmax(error > 0.01 * robot.length)])

    lengths, force = paper.verdict.meanings
    assert lengths.valid_throughout and lengths.exceeded == ()
    assert force.valid_to == pytest.approx(crossing, abs=0.011)
    assert force.exceeded == ((force.valid_to, 80.0),)
    assert force.dominant_cause is not None and force.dominant_cause.effect == "straight_spans"
    assert f"up to {force.valid_to:.3g} N" in force.text


def test_clamps_in_the_main_sweep_rise_and_fall(paper: Study) -> None:
    robot = load_robot("amouri2019").with_({"segments.0.disks.clamped_length": "3 mm"})
    got = Stages(robot)
    force = got.comparisons["cc_from_force"]
    assert force.mean / MM == pytest.approx(3.67, abs=5e-3)
    at = dict(zip(got.statics.tension.round(), force.error / MM, strict=True))
    assert [at[40.0], at[50.0], at[60.0], at[80.0]] == pytest.approx([4.9, 5.0, 4.8, 3.4], abs=0.05)
    assert got.judged(paper.budget).meanings[1].valid_throughout

    # a tolerance that is crossed upwards and again downwards
    tight = Stages(robot, tolerance=4.6 * MM / robot.length).judged(paper.budget).meanings[1]
    ((start, end),) = tight.exceeded
    assert 30.0 < start < 40.0 and 60.0 < end < 80.0
    assert tight.valid_to == start


def test_horizontal_gravity_exceeds_the_tolerance_at_the_first_load(paper: Study) -> None:
    got = Stages(load_robot("amouri2019").with_({"gravity": "-9.81 0 0 m/s^2"}))
    meanings = got.judged(paper.budget).meanings
    for m in meanings:
        assert m.valid_to is None
        assert m.exceeded[0][0] == 0.0
    force = meanings[1]
    assert force.dominant_cause is not None and force.dominant_cause.effect == "gravity"
    assert any("gravity (-9.81, 0, 0)" in note for note in got.notes())


def test_a_dominant_cause_needs_a_smaller_error_without_it(paper: Study) -> None:
    """In the example's own sweep, clamps and gravity partly cancel: none is a dominant cause."""
    got = Stages(load_robot(Path(__file__).parents[1] / "examples" / "my_robot.yaml"))
    lengths, force = got.judged(paper.budget).meanings
    assert abs(lengths.shares[0].share) < 0.1 and lengths.dominant_cause is None
    assert "No single effect" in lengths.text and "cause" not in lengths.text
    assert force.dominant_cause is not None and "Dominant cause" in force.text


def test_the_json_has_the_cause_that_the_text_calls_dominant(paper: Study) -> None:
    lengths, force = paper.verdict.to_dict()["meanings"]
    for m in (lengths, force):
        dominant = "Dominant cause" in m["text"]
        assert (m["dominant_cause"] is not None) == dominant
        assert not dominant or m["shares"][0]["share_percent"] > 50
    assert lengths["exceeded_N"] == [] and lengths["dominant_cause"] == "straight_spans"


def test_corrections_hold_beside_clamped_lengths(paper: Study) -> None:
    clamped = {"segments.0.disks.clamped_length": "3 mm"}
    got = Stages(load_robot("amouri2019").with_(clamped))
    (words,) = [
        t for t in got.judged(paper.budget).text if t.startswith("Corrections in closed form")
    ]
    assert "from lengths, lowers" in words and "from force, lowers" in words
    for meaning in got.judged(paper.budget).meanings:
        assert meaning.corrected.max_error < 0.03 * meaning.max_error


def test_the_answer_is_one_sentence(paper: Study, monkeypatch: pytest.MonkeyPatch) -> None:
    lengths, force = paper.verdict.meanings
    assert lengths.answer == "From true tendon lengths: yes, up to 80 N (largest error 0.67 mm)."
    assert force.answer == (
        "From force: only up to 56.1 N, because it ignores that tendons run straight between "
        "the disks; corrected: yes, up to 80 N (largest error 0.125 mm)."
    )
    stages = Stages(load_robot("amouri2019"), tolerance=1e-5)
    answers = [m.answer for m in stages.judged(paper.budget).meanings]
    assert "; corrected: yes, up to 80 N" in answers[0]
    assert "; by a polynomial: yes, up to 80 N" in answers[1]
    monkeypatch.setattr(verdict, "tip_polynomials", lambda *_: (None, None))
    tight = stages.judged(paper.budget).meanings[1]
    assert tight.answer.startswith("From force: only up to 1.69 N, because")
    assert "; corrected: up to " in tight.answer


def test_the_worst_combination_of_tendons_is_judged(paper: Study) -> None:
    robot = load_robot("rao2021")
    tried = combinations(robot)
    assert len(tried) == 3 + 3 + 9 and tried[0] == (0, 0, 0, 1, 0, 0)
    inner = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    both = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    limits = {}
    for shares in (inner, both, tried[0]):
        tendon = {i: 1.0 for i, share in enumerate(shares, 1) if share}
        got = Stages(robot, tolerance=0.001, max_tension=3.0, tendon=tendon)
        limits[shares] = got.judged(paper.budget).meanings[1].valid_to
    worst, _ = worst_combination(robot, [inner, both, tried[0]], "cosserat", 0.001, 3.0)
    assert limits[worst] == min(limits.values()) < max(limits.values())
    # with all tendons alike the first one counts, and a given tendon is kept
    assert paper.settings.shares == (1.0, 0.0, 0.0) and paper.settings.tried == 3
    given = Stages(robot, tendon=2).settings
    assert given.tried == 0 and given.shares[1] == 1.0


def test_the_verdict_compares_only_effects_with_all_loads(paper: Study) -> None:
    """A mean over one load is not the costliest effect."""
    costly = next(row for row in paper.budget.rows if row.effect == "E_minus_10")
    compared = dict(costly.in_sweep.comparisons)
    for name, c in compared.items():
        difference = np.full_like(c.difference, np.nan)
        difference[1] = 1.0
        compared[name] = replace(c, difference=difference)
    broken = replace(costly, in_sweep=replace(costly.in_sweep, comparisons=compared))
    rows = tuple(broken if row is costly else row for row in paper.budget.rows)
    (text,) = verdict._on_left_out(replace(paper.budget, rows=rows))
    assert "1000 mm" not in text
    assert text.endswith("from lengths: E 10 % lower / from force: E 10 % lower.")


def test_the_costliest_effect_has_the_numbers_of_the_budget(paper: Study) -> None:
    (text,) = [t for t in paper.verdict.text if t.startswith("A real robot has effects")]
    rows = [r for r in paper.budget.rows if not r.acts_in_sweep]
    for name, words in (("cc_from_lengths", "from lengths"), ("cc_from_force", "from force")):
        found = {r.label: paper.budget.contribution(r, "in_sweep", name) for r in rows}
        label = max(found, key=lambda one: found[one].mean)
        c = found[label]
        assert label == "transverse tip force 1 N" and label in text
        assert f"{words} by {in_mm(c.mean)} to {in_mm(c.with_effect)}" in text


def test_gravity_of_a_suspended_robot_is_not_listed_as_omitted() -> None:
    got = Stages(load_robot(Path(__file__).parent / "silicone.yaml"), points=3)
    (text,) = [t for t in got.verdict.text if t.startswith("A real robot has effects")]
    assert "gravity" not in text and "E 10 %" in text
