"""The study's numbers against references computed by other programs, and its own logic."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from bowstring import arc, rod, study
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot import Robot, load_robot

MM = 1e-3
EI = 35e9 * math.pi / 64 * 0.005**4  # of the study's robot, N m^2


@pytest.fixture(scope="module")
def paper() -> study.Study:
    return study.run(load_robot("amouri2019"))


def row(s: study.Study, effect: str) -> study.BudgetRow:
    return next(r for r in s.budget.rows if r.effect == effect)


# -- the sweep and the comparisons -------------------------------------------------------------


def test_the_sweep_is_the_studys(paper: study.Study) -> None:
    assert paper.statics.tension == pytest.approx(np.arange(0.0, 81.0, 5.0))
    assert paper.statics.converged.all()
    assert paper.statics.tip_position[-1] / MM == pytest.approx([384.556, 0.0, 444.808], abs=6e-3)


@pytest.mark.parametrize(
    ("theory", "means"),
    [
        (
            "cosserat",
            {
                "cc_from_lengths": 0.227,
                "cc_from_force": 4.423,
                "cc_from_lengths_chord": 0.0,
                "cc_from_force_arm": 0.049,
            },
        ),
        (
            "kirchhoff",
            {
                "cc_from_lengths": 0.228,
                "cc_from_force": 4.417,
                "cc_from_lengths_chord": 0.0,
                "cc_from_force_arm": 0.022,
            },
        ),
    ],
)
def test_means_of_the_four_comparisons(theory: study.Theory, means: dict[str, float]) -> None:
    got = study.run(load_robot("amouri2019"), theory=theory)
    assert [c.name for c in got.comparisons] == list(means)
    for c in got.comparisons:
        assert c.n == 17
        assert c.against == "statics"
        assert c.mean / MM == pytest.approx(means[c.name], abs=5e-3), c.name
    assert got.comparison("cc_from_lengths_chord").mean / MM < 1e-3


def test_maxima_and_axes(paper: study.Study) -> None:
    force = paper.comparison("cc_from_force")
    assert force.maximum / MM == pytest.approx(12.4, abs=0.05)
    assert force.mean_by_axis / MM == pytest.approx([3.245, 0.0, 2.892], abs=5e-3)
    inextensible = study.run(paper.robot, theory="kirchhoff").comparison("cc_from_force")
    assert inextensible.mean_by_axis / MM == pytest.approx([3.261, 0.0, 2.860], abs=5e-3)
    assert paper.comparison("cc_from_lengths").maximum / MM == pytest.approx(0.67, abs=5e-3)
    assert 100 * force.mean / paper.length == pytest.approx(0.69, abs=5e-3)


def test_rms_is_over_points(paper: study.Study) -> None:
    for c in paper.comparisons:
        assert c.rms == pytest.approx(math.sqrt(np.mean(np.sum(c.difference**2, axis=1))))
        assert c.mean <= c.rms <= c.maximum


def test_pull_beside_the_linear_law(paper: study.Study) -> None:
    # delta l = F r^2 l / (E I)
    assert paper.statics.linear_pull[-1] == pytest.approx(80.0 * 0.029**2 * 0.641 / EI, rel=1e-9)
    # a span's lever arm grows with the bend, so the real pull runs ahead
    assert paper.statics.pull[-1] > paper.statics.linear_pull[-1]
    assert paper.statics.pull[0] == pytest.approx(0.0, abs=1e-12)


def test_geometric_sweep_is_eq_5(paper: study.Study) -> None:
    g = paper.geometry
    length = paper.length
    pull = np.linspace(0.0, 80.0 * 0.029**2 * 0.641 / EI, 17)
    assert g.pull == pytest.approx(pull, rel=1e-9, abs=1e-15)
    expected = np.column_stack([length - pull, length + pull / 2, length + pull / 2])
    assert g.tendon_lengths == pytest.approx(expected, rel=1e-12)
    theta = pull[1:] / 0.029
    x, z = length * (1 - np.cos(theta)) / theta, length * np.sin(theta) / theta
    assert g.tip_position[1:, 0] == pytest.approx(x, rel=1e-9)
    assert g.tip_position[1:, 2] == pytest.approx(z, rel=1e-9)
    assert g.backbone[:, -1] == pytest.approx(g.tip_position, abs=1e-12)


# -- the error budget --------------------------------------------------------------------------


def test_constant_curvature_is_exact_in_the_plainest_physics(paper: study.Study) -> None:
    for c in paper.budget.plainest.comparisons.values():
        assert c.maximum < 1e-9


def test_straight_spans_are_most_of_the_sweep(paper: study.Study) -> None:
    added = row(paper, "straight_spans").added.comparisons
    assert added["cc_from_force"].mean / MM == pytest.approx(4.417, abs=5e-3)
    assert added["cc_from_lengths"].mean / MM == pytest.approx(0.228, abs=5e-3)


def test_clamps_in_the_main_sweep_rise_and_fall() -> None:
    robot = load_robot("amouri2019").with_({"segments.0.disks.clamped_length": "3 mm"})
    got = study.run(robot)
    force = got.comparison("cc_from_force")
    assert force.mean / MM == pytest.approx(3.67, abs=5e-3)
    at = dict(zip(got.statics.tension.round(), force.error / MM, strict=True))
    assert [at[40.0], at[50.0], at[60.0], at[80.0]] == pytest.approx([4.9, 5.0, 4.8, 3.4], abs=0.05)
    assert got.verdict.meanings[1].holds_throughout

    # a tolerance that is crossed on the way up and again on the way down
    tight = study.run(robot, tolerance=4.6 * MM / got.length).verdict.meanings[1]
    ((start, end),) = tight.fails
    assert 30.0 < start < 40.0 and 60.0 < end < 80.0
    assert tight.holds_to == start


def test_every_effect_has_a_row(paper: study.Study) -> None:
    assert [r.effect for r in paper.budget.rows] == [
        "straight_spans",
        "clamps",
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
    assert "3 mm" in labels and "1 N" in labels
    for r in paper.budget.rows:
        assert r.added.problem is None and r.full.problem is None and r.removed.problem is None


def test_the_budget_changes_one_thing_at_a_time(paper: study.Study) -> None:
    def differences(a: study.Physics, b: study.Physics) -> int:
        return sum(getattr(a, f) != getattr(b, f) for f in a.__dataclass_fields__)

    for r in paper.budget.rows:
        assert differences(r.added.physics, paper.budget.plainest.physics) == 1
        assert differences(r.removed.physics, r.full.physics) == 1
        assert differences(r.in_sweep.physics, paper.budget.sweep.physics) == 1
        assert differences(r.full.physics, paper.budget.fullest.physics) <= 1


def test_stiffness_off_matters_from_force_only(paper: study.Study) -> None:
    for effect in ("E_minus_10", "E_plus_10"):
        added = row(paper, effect).added.comparisons
        assert added["cc_from_force"].mean / MM > 10.0
        assert added["cc_from_lengths"].mean < 1e-9


def test_torsion_is_worth_nothing_in_a_plane(paper: study.Study) -> None:
    assert row(paper, "torsion").added.comparisons["cc_from_force"].mean < 1e-9


def test_the_force_across_the_tip_leaves_the_plane(paper: study.Study) -> None:
    case = row(paper, "tip_force").added
    assert case.physics.tip_force == (0.0, 1.0, 0.0)
    # less than the 80.9 mm of a backbone that may twist
    assert 60.0 < case.tip_position[8, 1] / MM < 80.9
    # the same in the main sweep, which may: the reference case
    case = row(paper, "tip_force").in_sweep
    assert case.tip_position[8] / MM == pytest.approx([213.273, 80.872, 583.929], abs=6e-3)


def test_gravity_in_the_main_sweep_is_the_reference_case(paper: study.Study) -> None:
    case = row(paper, "gravity_upright").in_sweep
    assert case.tip_position[8] / MM == pytest.approx([238.999, 0.0, 578.113], abs=6e-3)


def test_clamps_in_the_main_sweep(paper: study.Study) -> None:
    clamps = row(paper, "clamps")
    assert not clamps.acts_in_sweep
    assert clamps.in_sweep.comparisons["cc_from_force"].mean / MM == pytest.approx(3.67, abs=5e-3)
    spans = row(paper, "straight_spans")
    assert spans.acts_in_sweep
    assert spans.in_sweep.comparisons["cc_from_lengths"].mean / MM < 1e-2


# -- the verdict -------------------------------------------------------------------------------


def test_first_crossing_against_an_independent_sweep(paper: study.Study) -> None:
    robot = paper.robot
    tension = np.arange(50.0, 65.0, 0.01)
    sweep = rod.sweep(robot, np.column_stack([tension, 0 * tension, 0 * tension]))
    tip = arc.pose(tension * 0.029 / EI, 0.0, robot.length).position
    error = np.linalg.norm(tip - sweep.tip_position, axis=1)
    crossing = float(tension[np.argmax(error > 0.01 * robot.length)])

    lengths, force = paper.verdict.meanings
    assert lengths.holds_throughout and lengths.fails == ()
    assert force.holds_to == pytest.approx(crossing, abs=0.011)
    assert force.fails == ((force.holds_to, 80.0),)
    assert force.ended_by is not None and force.ended_by.effect == "straight_spans"
    assert f"up to {force.holds_to:.3g} N" in force.text


def test_gravity_across_ends_it_at_the_first_load() -> None:
    got = study.run(load_robot("amouri2019").with_({"gravity": "-9.81 0 0 m/s^2"}))
    for m in got.verdict.meanings:
        assert m.holds_to is None
        assert m.fails[0][0] == 0.0
    force = got.verdict.meanings[1]
    assert force.ended_by is not None and force.ended_by.effect == "gravity"
    assert any("gravity (-9.81, 0, 0)" in note for note in got.notes)


def test_the_published_mean_stands_beside_the_studys_robot_only(paper: study.Study) -> None:
    assert paper.claim is not None
    assert "4.95" in paper.claim.text and "published mean" in paper.claim.text
    assert "differs" not in paper.claim.text
    assert study.run(load_robot("amouri2019"), max_tension=40.0).claim is None
    assert study.run(load_robot("rao2021")).claim is None


# -- other robots, and settings ----------------------------------------------------------------


def test_two_segments() -> None:
    robot = load_robot("rao2021")
    got = study.run(robot)
    assert got.settings.tendon == 3
    assert got.statics.converged.all()
    # the outer tendon bends both segments
    assert np.all(got.geometry.theta[-1] > 0.1)
    assert got.comparison("cc_from_lengths").n == 17
    # no printed value: what must hold for straight spans in short modules
    assert got.comparison("cc_from_lengths").mean < 1e-3 * robot.length
    assert got.comparison("cc_from_lengths_chord").mean < 1e-5 * robot.length


def test_a_robot_that_buckles_says_so_and_the_study_goes_on() -> None:
    heavy = {f"segments.{k}.disks.mass": "50 g" for k in (0, 1)}
    got = study.run(load_robot("rao2021").with_(heavy))
    assert "tip" in got.budget.fullest_is
    for r in got.budget.rows:
        for case in (r.added, r.full, r.removed):
            known = np.isfinite(case.tip_position).all(axis=1)
            assert (case.problem is None) == known.all()
    json.dumps(got.to_dict(), allow_nan=False)


def test_a_cause_is_named_only_if_the_error_falls_without_it() -> None:
    """In the example's own sweep, clamps and gravity cancel in part: no effect ends the error."""
    got = study.run(load_robot(Path(__file__).parents[1] / "examples" / "my_robot.yaml"))
    lengths, force = got.verdict.meanings
    assert abs(lengths.shares[0].share) < 0.1 and lengths.ended_by is None
    assert "No single effect" in lengths.text and "Most of that" not in lengths.text
    assert force.ended_by is not None and "What ends it" in force.text


def test_a_correction_that_does_harm_is_not_called_better() -> None:
    clamped = {"segments.0.disks.clamped_length": "3 mm"}
    got = study.run(load_robot("amouri2019").with_(clamped))
    (words,) = [t for t in got.verdict.text if t.startswith("Corrections in closed form")]
    assert "from lengths: better" in words and "from force: worse" in words


def test_two_tendons_have_a_force_law_but_no_arc_from_lengths() -> None:
    tendons = [{"angle": f"{a} deg", "pitch_radius": "29 mm"} for a in (0, 180)]
    got = study.run(load_robot("amouri2019").with_({"segments.0.tendons": tendons}))
    assert got.comparison("cc_from_lengths").n == 0
    assert got.comparison("cc_from_force").mean / MM == pytest.approx(4.423, abs=5e-3)
    assert "three tendons" in got.verdict.meanings[0].text
    assert got.to_dict()["comparisons"][0]["mean_mm"] is None


@pytest.mark.parametrize(
    ("stiffness", "tension"), [("35 GPa", 80.0), ("70 GPa", 150.0), ("35 MPa", 0.08)]
)
def test_the_load_range_follows_the_linear_law(stiffness: str, tension: float) -> None:
    robot = load_robot("amouri2019").with_({"segments.0.backbone.E": stiffness})
    assert study.run(robot, points=2).settings.max_tension == tension


def test_a_load_that_winds_the_robot_up_is_named() -> None:
    soft = load_robot("amouri2019").with_({"segments.0.backbone.E": "35 MPa"})
    with pytest.raises(InputError, match=r"80 N winds amouri2019 up by 220 turns"):
        study.run(soft, max_tension=80.0)


def test_loads_beyond_any_arc_count_in_no_mean() -> None:
    got = study.run(load_robot("amouri2019"), max_tension=900.0)
    lengths = got.comparison("cc_from_lengths")
    assert 0 < lengths.n < 17
    assert any(f"over the other {lengths.n}" in note for note in got.notes)
    (gap,) = got.verdict.meanings[0].undecided
    assert 300.0 < gap[0] < 400.0 and gap[1] == 900.0
    assert not got.verdict.meanings[0].holds_throughout


def test_no_equilibrium_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Failed:
        status = ("max_iterations",) * 17
        converged = np.zeros(17, dtype=bool)

        def message(self, row: int) -> str:
            return f"row {row}: {self.status[row]}."

    def fails(robot: Robot, tensions: object, **options: object) -> Failed:
        return Failed()

    monkeypatch.setattr(rod, "sweep", fails)
    with pytest.raises(NoSolutionError, match="max_iterations"):
        study.run(load_robot("amouri2019"))


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("tolerance", 0.0),
        ("tolerance", math.nan),
        ("tolerance", 1.5),
        ("max_tension", -1.0),
        ("max_tension", math.inf),
        ("points", 1),
        ("theory", "timoshenko"),
    ],
)
def test_bad_settings(setting: str, value: object) -> None:
    with pytest.raises(InputError, match=f"got '?{value}"):
        study.run(load_robot("amouri2019"), **{setting: value})  # type: ignore[arg-type]


# -- what goes out -----------------------------------------------------------------------------


def test_the_contract(paper: study.Study) -> None:
    got = paper.to_dict()
    assert {"robot", "length_m", "comparisons", "verdict", "budget", "figures"} <= set(got)
    assert got["robot"] == "amouri2019"
    assert got["length_m"] == pytest.approx(0.641)
    fields = ["name", "against", "n", "mean_mm", "max_mm", "rms_mm", "mean_percent"]
    for c in got["comparisons"]:
        assert list(c) == [*fields, "mean_by_axis_mm"]
        assert len(c["mean_by_axis_mm"]) == 3
    assert got["data"] == "simulated" and got["registered"] is False
    assert got["provenance"]["robot_hash"] == paper.robot.hash
    assert json.loads(json.dumps(got, allow_nan=False)) == got


def test_progress_runs_from_zero_to_one() -> None:
    seen: list[float] = []
    study.run(load_robot("amouri2019"), progress=lambda what, share: seen.append(share))
    assert seen[0] == 0.0 and seen[-1] == 1.0
    assert seen == sorted(seen)


def test_the_verdict_compares_only_effects_with_all_loads(paper):
    """A mean over one load is not the costliest effect."""
    from dataclasses import replace

    costly = next(row for row in paper.budget.rows if row.effect == "E_minus_10")
    compared = dict(costly.in_sweep.comparisons)
    for name, c in compared.items():
        difference = np.full_like(c.difference, np.nan)
        difference[1] = 1.0
        compared[name] = replace(c, difference=difference)
    broken = replace(costly, in_sweep=replace(costly.in_sweep, comparisons=compared))
    rows = tuple(broken if row is costly else row for row in paper.budget.rows)
    (text,) = study._on_left_out(replace(paper.budget, rows=rows))
    assert "1000 mm" not in text
    assert text.endswith("from lengths: E 10 % lower / from force: E 10 % lower.")
