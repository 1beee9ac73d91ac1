"""The error budget: each effect against reference cases, one factor at a time."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bowstring.formatting import plain
from bowstring.robot.reader import load_robot
from bowstring.study.comparison import Case, Model
from bowstring.study.error_budget import BudgetRow, Side
from bowstring.study.study import Study
from bowstring.validity.effects import Rods
from stages import Stages, with_gaps

MM = 1e-3


def row(s: Study | Stages, effect: str) -> BudgetRow:
    return next(r for r in s.budget.rows if r.effect == effect)


def test_constant_curvature_is_exact_in_the_baseline(paper: Study) -> None:
    for c in paper.budget.baseline.comparisons.values():
        assert c.maximum < 1e-9


def test_straight_spans_dominate_the_sweep(paper: Study) -> None:
    added = row(paper, "straight_spans").added.comparisons
    assert added["cc_from_force"].mean / MM == pytest.approx(4.417, abs=5e-3)
    assert added["cc_from_lengths"].mean / MM == pytest.approx(0.228, abs=5e-3)


def test_every_effect_has_a_row(paper: Study) -> None:
    assert [r.effect for r in paper.budget.rows] == [
        "straight_spans",
        "clamps",
        "hole_planes",
        "shear_extension",
        "torsion",
        "gravity_upright",
        "gravity_hanging",
        "gravity_horizontal",
        "tip_force",
        "E_minus_10",
        "E_plus_10",
    ]
    labels = " ".join(r.label for r in paper.budget.rows)
    assert "3 mm" in labels and "transverse tip force 1 N" in labels
    for r in paper.budget.rows:
        assert r.added.problem is None and r.full.problem is None and r.removed.problem is None


def test_the_budget_changes_one_thing_at_a_time(paper: Study) -> None:
    def numbers(rods: Rods) -> list[object]:
        (segment,), load, model = rods.designs.robot.segments, rods.load, rods.model
        disks, backbone = segment.disks, segment.backbone
        of_robot = [disks.clamped_length, disks.hole_length, backbone.E]
        of_model = [model.theory, model.tendon_path, model.twist]
        return [*of_model, load.gravity, load.tip_force, *of_robot]

    def differences(a: Case, b: Case) -> int:
        pairs = zip(numbers(a.rods), numbers(b.rods), strict=True)
        return sum(x != y for x, y in pairs)

    for r in paper.budget.rows:
        assert differences(r.added, paper.budget.baseline) == 1
        assert differences(r.removed, r.full) == 1
        assert differences(r.in_sweep, paper.budget.sweep) == 1
        assert differences(r.full, paper.budget.full_model) <= 1


def test_stiffness_error_matters_from_force_only(paper: Study) -> None:
    for effect in ("E_minus_10", "E_plus_10"):
        added = row(paper, effect).added.comparisons
        assert added["cc_from_force"].mean / MM > 10.0
        assert added["cc_from_lengths"].mean < 1e-9


def test_torsion_has_no_effect_in_a_plane(paper: Study) -> None:
    assert row(paper, "torsion").added.comparisons["cc_from_force"].mean < 1e-9


def test_a_transverse_tip_force_leaves_the_plane(paper: Study) -> None:
    case = row(paper, "tip_force").added
    assert case.rods.load.tip_force == (0.0, 1.0, 0.0)
    # less than the 80.9 mm of a backbone that can twist
    assert 60.0 < case.tip_position[8, 1] / MM < 80.9
    # the same in the main sweep, where it can: the reference case
    case = row(paper, "tip_force").in_sweep
    assert case.tip_position[8] / MM == pytest.approx([213.273, 80.872, 583.929], abs=6e-3)


def test_gravity_in_the_main_sweep_is_the_reference_case(paper: Study) -> None:
    case = row(paper, "gravity_upright").in_sweep
    assert case.tip_position[8] / MM == pytest.approx([238.999, 0.0, 578.113], abs=6e-3)


def test_clamps_in_the_main_sweep(paper: Study) -> None:
    clamps = row(paper, "clamps")
    assert not clamps.acts_in_sweep
    assert clamps.in_sweep.comparisons["cc_from_force"].mean / MM == pytest.approx(3.67, abs=5e-3)
    spans = row(paper, "straight_spans")
    assert spans.acts_in_sweep
    assert spans.in_sweep.comparisons["cc_from_lengths"].mean / MM < 1e-2


def test_a_buckling_robot_is_reported_and_the_study_continues() -> None:
    heavy = {f"segments.{k}.disks.mass": "50 g" for k in (0, 1)}
    got = Stages(load_robot("rao2021").with_(heavy))
    assert "tip" in got.budget.full_model_description
    for r in got.budget.rows:
        for case in (r.added, r.full, r.removed):
            known = np.isfinite(case.tip_position).all(axis=1)
            assert (case.problem is None) == known.all()
    json.dumps(plain(got.budget.to_dict()), allow_nan=False)


def test_a_robot_that_cannot_stand_is_suspended_in_the_full_model(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    real = Model.case

    def case(model: Model, rods: Rods, tension: np.ndarray) -> Case:
        found = real(model, rods, tension)
        return replace(found, problem="it buckles") if rods.load.gravity[2] < 0.0 else found

    monkeypatch.setattr(Model, "case", case)
    budget = Stages(load_robot("rao2021"), points=2).budget
    assert "gravity (hanging)" in budget.full_model_description
    assert budget.full_model.problem is None and budget.full_model.rods.load.gravity[2] > 0.0


# -- contributions -----------------------------------------------------------------------------


def test_a_contribution_is_the_difference_with_and_without(paper: Study) -> None:
    b = paper.budget
    name = "cc_from_force"

    def mean(case: object) -> float:
        return case.comparisons[name].mean  # type: ignore[attr-defined, no-any-return]

    hanging = row(paper, "gravity_hanging")
    c = b.contribution(hanging, "removed", name)
    assert (c.with_effect, c.without_effect) == (mean(hanging.full), mean(hanging.removed))
    assert c.mean / MM == pytest.approx(-10.89, abs=5e-3)  # it reduces the error
    assert c.n == c.of == 17 and not c.partial

    # the sweep has straight spans, so they are removed; it has no tip force, so that is added
    spans, force = row(paper, "straight_spans"), row(paper, "tip_force")
    for r, present, absent in ((spans, b.sweep, spans.in_sweep), (force, force.in_sweep, b.sweep)):
        c = b.contribution(r, "in_sweep", name)
        assert (c.with_effect, c.without_effect) == (mean(present), mean(absent))
        assert c.mean > 0.0
    for r in b.rows:
        c = b.contribution(r, "added", name)
        assert (c.with_effect, c.without_effect) == (mean(r.added), mean(b.baseline))


def test_contributions_in_json_have_one_sign(paper: Study) -> None:
    rows = {r["effect"]: r for r in paper.budget.to_dict()["rows"]}
    sides: tuple[Side, ...] = ("added", "removed", "in_sweep")
    for r in paper.budget.rows:
        for side in sides:
            for name in ("cc_from_lengths", "cc_from_force"):
                c = paper.budget.contribution(r, side, name)
                entry = rows[r.effect][side][name]
                assert entry["contribution_mm"] == pytest.approx(c.mean / MM)
                assert entry["contribution_n"] == c.n
    got = rows["straight_spans"]["in_sweep"]
    assert got["how"] == "removed" and got["cc_from_force"]["contribution_mm"] > 4.0
    moved = rows["gravity_hanging"]["removed"]["tip_moved_mean_mm"]
    case = row(paper, "gravity_hanging")
    away = np.linalg.norm(case.full.tip_position - case.removed.tip_position, axis=1)
    assert moved == pytest.approx(away.mean() / MM)


def test_a_contribution_is_over_the_loads_that_both_cases_have(paper: Study) -> None:
    r = row(paper, "tip_force")
    r = replace(r, removed=with_gaps(r.removed, range(11, 17)))
    c = paper.budget.contribution(r, "removed", "cc_from_force")
    assert (c.n, c.of, c.partial) == (11, 17, True)
    assert c.with_effect == pytest.approx(r.full.error("cc_from_force")[:11].mean())
    assert paper.budget.problems(r, "removed") == ("without it: no equilibrium there",)


@pytest.mark.slow
def test_other_gravity_is_compared_with_the_sweep_without_gravity() -> None:
    """The effect of upright gravity on a suspended robot differs from that of reversing gravity."""
    robot = load_robot(Path(__file__).parent / "silicone.yaml")
    got = Stages(robot, points=3, max_tension=1.0)
    without = Stages(robot.with_({"gravity": "0 0 0 m/s^2"}), points=3, max_tension=1.0)
    for effect in ("gravity_upright", "gravity_hanging", "gravity_horizontal"):
        for name in ("cc_from_lengths", "cc_from_force"):
            ours = got.budget.contribution(row(got, effect), "in_sweep", name)
            same = without.budget.contribution(row(without, effect), "in_sweep", name)
            assert (ours.n, ours.mean) == (same.n, pytest.approx(same.mean, rel=1e-9))
