"""The actuation budget of the study: friction, elastic tendons and displacement control."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.formatting import plain
from bowstring.robot.model import Robot, with_tendons
from bowstring.robot.reader import load_robot
from bowstring.study import report
from bowstring.study.actuation_budget import (
    ASSUMED_FRICTION,
    COMMANDED,
    ActuationBudget,
    actuation_budget,
    assumed_stiffness,
)
from bowstring.study.comparison import Model
from bowstring.study.study import Study
from stages import Stages, printed

ROBOT = load_robot("amouri2019")
MM = 1e-3
UP = np.linspace(0.0, 80.0, 49)
UP_AND_DOWN = np.concatenate((UP, UP[-2::-1]))
TENDONS = "segments.0.tendons."
STRETCH = "E A 30 kN (steel, 0.6 mm, by the robot's size)"
ASSUMED = 30e3
ROWS = [
    "friction_loading",
    "friction_unloading",
    "tendon_elasticity",
    "displacement_controlled_loading",
    "displacement_controlled_unloading",
]


def budget(robot: Robot, max_tension: float = 80.0, points: int = 17) -> ActuationBudget:
    """The actuation part of the budget alone."""
    model = Model(
        robot, int(np.flatnonzero(robot.tendons.segment == len(robot.segments) - 1)[0]), "cosserat"
    )
    tension = np.linspace(0.0, max_tension, points)
    return actuation_budget(model, tension, model.case(model.main, tension))


def displacements_for(robot: Robot, tension: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Commands of the first of three tendons, and the intended tip."""
    arcs = RobotArcs.from_tensions(robot, np.outer(tension, [1, 0, 0]))
    lengths = arcs.lengths()
    meant = RobotArcs.from_lengths(robot, lengths).tip.position  # Eq. 5, from the commanded lengths
    return robot.length - lengths - 0.01 * robot.length * np.array([0, 1, 1]), meant


def errors(tips: np.ndarray, others: np.ndarray) -> np.ndarray:
    return np.linalg.norm(tips - others, axis=1)


# -- against direct calls ------------------------------------------------------------------------


def test_friction_matches_a_loading_and_unloading_path(paper: Study) -> None:
    with_friction = ROBOT.with_({TENDONS + "friction": ASSUMED_FRICTION})
    path = bs.sweep(with_friction, np.outer(UP_AND_DOWN, [1, 0, 0])).raise_for_status()
    law = RobotArcs.from_tensions(ROBOT, np.outer(UP[::3], [1, 0, 0])).tip.position
    d = paper.budget.actuation
    for effect, rows in (
        ("friction_loading", slice(0, 49, 3)),
        ("friction_unloading", slice(96, 47, -3)),
    ):
        case = d.row(effect).case
        assert case.tip_position == pytest.approx(path.tip_position[rows], abs=1e-12)
        expected = errors(law, path.tip_position[rows])
        assert case.error("cc_from_force") == pytest.approx(expected, abs=1e-12)
        from_lengths = RobotArcs.from_lengths(ROBOT, path.tendon_lengths[rows]).tip.position
        expected = errors(from_lengths, path.tip_position[rows])
        assert case.error("cc_from_lengths") == pytest.approx(expected, abs=1e-12)
        assert d.row(effect).base is paper.budget.sweep
    width = errors(path.tip_position[:49], path.tip_position[48:][::-1]).max()
    assert d.loops[0].width == pytest.approx(width)


def test_displacements_are_those_of_constant_curvature(paper: Study) -> None:
    d = paper.budget.actuation
    displacements, meant = displacements_for(ROBOT, UP)
    assert d.displacement == pytest.approx(displacements[::3, 0], abs=1e-12)
    elastic = ROBOT.with_({TENDONS + "axial_stiffness": ASSUMED})
    both = elastic.with_({TENDONS + "friction": ASSUMED_FRICTION})
    for robot, case in (
        (ROBOT, d.displacement_controlled),
        (elastic, d.row("tendon_elasticity").case),
    ):
        found = bs.sweep(robot, load=bs.Load(displacements=displacements)).raise_for_status()
        assert case.error(COMMANDED) == pytest.approx(
            errors(meant, found.tip_position)[::3], abs=1e-9
        )
        assert np.all(found.slack_lengths[:, 1:] > 0.0)  # the others are slack
    path = bs.sweep(
        both, load=bs.Load(displacements=np.concatenate((displacements, displacements[-2::-1])))
    ).raise_for_status()
    there, back = path.tip_position[:49], path.tip_position[48:][::-1]
    for way, tips in (("loading", there), ("unloading", back)):
        case = d.row(f"displacement_controlled_{way}").case
        assert case.error(COMMANDED) == pytest.approx(errors(meant, tips)[::3], abs=1e-9)
    assert d.loops[1].width == pytest.approx(errors(there, back).max(), abs=1e-9)


def test_an_elastic_tendon_lags_by_its_elongation(paper: Study) -> None:
    """Elastic tendons equal inextensible ones with the displacement reduced by T l0 / (E A)."""
    displacements, _ = displacements_for(ROBOT, UP[-1:])
    elastic = bs.solve(
        ROBOT.with_({TENDONS + "axial_stiffness": ASSUMED}),
        load=bs.Load(displacements=displacements[0]),
    )
    late = displacements[0] - [elastic.tensions[0] * ROBOT.length / ASSUMED, 0, 0]
    tip = bs.solve(ROBOT, load=bs.Load(displacements=late)).raise_for_status().tip
    ours = paper.budget.actuation.row("tendon_elasticity").case.tip_position[-1]
    assert tip is not None and ours == pytest.approx(tip.position, abs=1e-9)


# -- limits --------------------------------------------------------------------------------------


def test_ideal_tendons_change_nothing() -> None:
    d = budget(ROBOT.with_({TENDONS + "friction": 1e-12, TENDONS + "axial_stiffness": 1e12}))
    assert not d.friction_assumed and not d.elasticity_assumed and d.assumptions == ()
    for row in d.rows:
        moved = errors(row.case.tip_position, row.base.tip_position)
        # a path with friction may use more elements than the sweep without
        assert row.case.problem is None and moved.max() < 1e-5 * ROBOT.length, row.effect
        assert not row.exceeds
    assert max(loop.width for loop in d.loops) < 1e-5 * ROBOT.length


def test_reference_numbers_are_unchanged(paper: Study) -> None:
    d = paper.budget.actuation
    for name in ("cc_from_lengths", "cc_from_force"):
        assert d.tension_controlled.comparisons[name].mean == paper.comparison(name).mean
    assert d.loops[0].free[::3] == pytest.approx(paper.statics.tip_position, abs=1e-9)


def test_short_steps_give_the_same_result() -> None:
    coarse, fine = budget(ROBOT), budget(ROBOT, points=401)
    for effect in ROWS:
        some = fine.row(effect).case.tip_position[::25]
        assert errors(coarse.row(effect).case.tip_position, some).max() < 0.02 * MM, effect
    for a, b in zip(coarse.loops, fine.loops, strict=True):
        assert a.width == pytest.approx(b.width, rel=0.02)


# -- reported results ----------------------------------------------------------------------------


def test_figures_of_the_papers_robot(paper: Study) -> None:
    d = paper.budget.actuation
    assert [row.effect for row in d.rows] == ROWS
    up, down = d.row("friction_loading"), d.row("friction_unloading")
    assert up.case.comparisons["cc_from_force"].mean / MM == pytest.approx(2.61, abs=0.01)
    assert down.case.comparisons["cc_from_force"].mean / MM == pytest.approx(9.25, abs=0.01)
    # friction opposes motion: less bent while loading, more while unloading
    inner = slice(1, -1)
    bend = [c.tip_position[inner, 0] for c in (up.case, paper.budget.sweep, down.case)]
    assert np.all(bend[0] < bend[1]) and np.all(bend[1][:-2] < bend[2][:-2])
    assert d.row("tendon_elasticity").case.comparisons[COMMANDED].mean / MM == pytest.approx(
        10.95, abs=0.01
    )
    assert all(row.exceeds and row.case.problem is None for row in d.rows)
    assert [loop.width / MM for loop in d.loops] == pytest.approx([29.3, 14.2], abs=0.1)
    assert d.loops[0].apart[[0, -1]] == pytest.approx(0.0, abs=1e-9)


def test_json(paper: Study) -> None:
    d = json.loads(json.dumps(paper.to_dict(), allow_nan=False))["budget"]["actuation"]
    assert (d["friction"], d["friction_origin"]) == (0.1, "assumed")
    assert (d["axial_stiffness_N"], d["elasticity_origin"]) == (30e3, "assumed")
    assert [row["effect"] for row in d["rows"]] == ROWS
    for row in d["rows"]:
        names = {"tension": ("cc_from_lengths", "cc_from_force"), "displacement": (COMMANDED,)}
        for name in names[row["control"]]:
            base = d[row["control"]][name]
            assert {"n", "mean_mm", "max_mm", "mean_percent"} <= set(row[name])
            change = row[name]["mean_mm"] - base["mean_mm"]
            assert row[name]["change_of_mean_mm"] == pytest.approx(change)
        assert row["more_than_constant_curvature"] is True
        assert ("assumed" in row["label"]) == bool(row["assumed"])
    for loop in d["hysteresis"]:
        command = loop["tension_N" if loop["control"] == "tension" else "displacement_mm"]
        assert len(command) == len(loop["tip_loading_mm"]) == len(loop["tip_unloading_mm"]) == 49
        assert loop["width_percent"] == pytest.approx(loop["width_mm"] / 641 * 100)


def test_assumptions_are_reported(paper: Study) -> None:
    d = paper.budget.actuation
    assert d.assumptions == ("friction 0.1", STRETCH)
    assert sum("not measured" in note for note in d.notes) == 2
    assert all("assumed" in row.label for row in d.rows)
    assert all("assumed" in sentence for sentence in d.text[:2])
    for sentence in d.text:
        assert sentence in paper.verdict.text


def test_values_of_the_file_are_used() -> None:
    own = {"friction": 0.05, "axial_stiffness": "50 kN", "compliance": "0.01 mm/N"}
    d = budget(ROBOT.with_({TENDONS + name: value for name, value in own.items()}))
    assert (d.friction, d.axial_stiffness, d.compliance) == (0.05, 50e3, 1e-5)
    assert d.assumptions == () and not any("assumed" in n for n in (*d.notes, *d.text))
    assert "as in the file" in d.text[0] and "transmission 0.01 mm/N" in d.text[1]
    narrower = budget(ROBOT)
    assert d.loops[0].width < narrower.loops[0].width


def test_a_compliance_alone_counts_as_elasticity() -> None:
    d = budget(ROBOT.with_({TENDONS + "compliance": "0.01 mm/N"}))
    assert not d.elasticity_assumed and np.isinf(d.axial_stiffness)
    assert d.assumptions == ("friction 0.1",)


def test_assumed_stiffness_follows_from_the_tendon() -> None:
    thin = ROBOT.with_({TENDONS + "diameter": "150 um"})
    assert assumed_stiffness(thin, 0) == (1.9e3, "steel, 0.15 mm, diameter as in the file")
    nylon = thin.with_({TENDONS + "material": "nylon"})
    assert assumed_stiffness(nylon, 0)[0] == pytest.approx(44.0)
    assert nylon.hash == ROBOT.hash  # an assumption of a study does not change the robot's physics
    with pytest.raises(InputError, match='got "wood"; must be one of steel'):
        thin.with_({TENDONS + "material": "wood"})
    d = budget(thin, points=3)
    assert d.axial_stiffness == 1.9e3 and d.elasticity_origin == "assumed"
    assert d.assumptions[1] == "E A 1.9 kN (steel, 0.15 mm, diameter as in the file)"
    assert any("diameter as in the file" in note for note in d.notes)


def test_elasticity_is_omitted_where_no_stiffness_can_be_assumed() -> None:
    small = ROBOT.with_(
        {
            "segments.0.length": "20 mm",
            "segments.0.backbone.diameter": "0.3 mm",
            "segments.0.disks.radius": "1 mm",
            "segments.0.disks.thickness": "0.2 mm",
            "segments.0.disks.mass": "1 mg",
            TENDONS + "pitch_radius": "0.8 mm",
        }
    )
    d = budget(small, 0.5, points=5)
    assert d.elasticity_origin == "left_out" and np.isinf(d.axial_stiffness)
    assert [row.effect for row in d.rows] == [name for name in ROWS if "elasticity" not in name]
    assert all("elastic" not in row.label for row in d.rows)
    assert all(np.isfinite(row.moved) for row in d.rows)
    assert any("left out" in origin and "0.017 mm" in origin for origin in d.origins)
    assert any("Tendon elasticity is left out" in note for note in d.notes)
    assert not any("tendon elasticity, " in sentence for sentence in d.text)
    # with a diameter there is one
    d = budget(small.with_({TENDONS + "diameter": "0.05 mm"}), 0.5, points=5)
    assert d.row("tendon_elasticity").moved > 0.0


def test_calibrated_friction_is_used_in_the_budget() -> None:
    model = Model(ROBOT, 0, "cosserat")
    tension = np.linspace(0.0, 80.0, 5)
    sweep = model.case(model.main, tension)
    calibrated = ROBOT.with_({TENDONS + "friction": 0.2007})
    d = actuation_budget(model, tension, sweep, calibrated)
    assert (d.friction, d.friction_origin) == (0.2007, "calibrated")
    assert "friction" not in " ".join(d.assumptions)
    assert d.row("friction_loading").label == "friction 0.2007 (calibrated), loading"
    assert d.row("friction_loading").assumed == ()
    assert "friction of 0.2007 at the holes (calibrated to the data)" in d.text[0]
    assert any("that of the calibration" in note for note in d.notes)
    assert not any("gives no friction:" in note for note in d.notes)
    assert d.origins[0] == "calibrated to the data: friction 0.2007"
    own = actuation_budget(Model(calibrated, 0, "cosserat"), tension, sweep)
    ours, file = (each.row("friction_loading").case.tip_position for each in (d, own))
    assert ours == pytest.approx(file, abs=1e-12)


# -- a robot whose file has friction ---------------------------------------------------------------


@pytest.mark.slow
def test_friction_of_the_file_is_reported_as_not_in_the_sweep(paper: Study) -> None:
    stages = Stages(ROBOT.with_({TENDONS + "friction": 0.2}))
    found = replace(
        stages.over(paper),
        dynamics=stages.motion,
        budget=stages.budget,
        verdict=stages.verdict,
    )
    assert found.robot.tendons.friction[0] == 0.2
    assert found.dynamics is not None
    assert found.comparison("cc_from_force").mean == paper.comparison("cc_from_force").mean
    assert any("are without the friction of the tendons." in note for note in found.notes)
    assert not any("are without" in note for note in paper.notes)
    last = found.verdict.text[-1]
    assert last.startswith("The ranges above are without friction. With that of the file, 0.2")
    above = found.budget.actuation.row("friction_loading").case.error("cc_from_force") > 6.41 * MM
    first = found.statics.tension[above][0]
    assert f"from force, loading: at {above.sum()} loads, {first:g} to 80 N" in last
    json.dumps(found.to_dict(), allow_nan=False)
    page = report._html(found, found.to_dict(), dict.fromkeys((f.stem for f in found.figures), ""))
    assert "without friction" in page


@pytest.mark.parametrize("name", ["rao2021", "crl-ftdcr-v4"])
def test_robots_of_several_segments(name: str) -> None:
    robot = load_robot(name)
    d = budget(robot, 3.0, points=7)
    assert all(row.case.problem is None and np.isfinite(row.moved) for row in d.rows)
    assert all(loop.width > 0.5 * MM for loop in d.loops)
    assert not any("In spite of that" in note for note in d.notes)


def test_a_tendon_that_stays_taut_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bowstring.study.actuation_budget._SURPLUS", -0.001)
    assert any("In spite of that" in note for note in budget(ROBOT).notes)


@pytest.mark.slow
def test_commands_without_equilibrium_are_reported() -> None:
    d = budget(ROBOT.with_({TENDONS + "friction": 3}), 400.0)
    case = d.row("displacement_controlled_loading").case
    assert case.problem is not None and "means are over the others" in case.problem
    assert np.isfinite(case.error(COMMANDED)).sum() == case.comparisons[COMMANDED].n < 17
    json.dumps(plain(d.to_dict()), allow_nan=False)


def test_pretension_and_two_points() -> None:
    d = budget(ROBOT.with_({TENDONS + "pretension": "2 N"}), points=2)
    assert len(d.loops[0].command) == 41
    assert all(np.isfinite(row.moved) for row in d.rows)


def test_missing_tendon_fields_are_filled() -> None:
    robot = load_robot("rao2021").with_({"segments.1.tendons.0.friction": 0.3})
    assert with_tendons(robot, {"friction": 0.1}, missing=True).tendons.friction.tolist() == [
        *[0.1] * 3,
        0.3,
        0.1,
        0.1,
    ]
    assert not with_tendons(robot, {"friction": 0.0}).has_friction
    assert with_tendons(robot, {"axial_stiffness": None}) is robot


# -- report --------------------------------------------------------------------------------------


def test_report_and_terminal_show_it(paper: Study, written: Path) -> None:
    page = (written / "report.html").read_text(encoding="utf-8")
    text = " ".join(re.sub(r"<[^>]*>", " ", page).split())
    for row in paper.budget.actuation.rows:
        assert row.label in text
    for sentence in (*paper.budget.actuation.text, *paper.budget.actuation.notes):
        assert sentence.replace("'", "&#39;") in text
    assert (
        f"Assumed, the robot file gives none: friction 0.1; {STRETCH}".replace("'", "&#39;") in text
    )
    apart = page.partition('id="assumed"')[2].partition("<h2")[0]
    rows = re.findall(r'<th scope="row">(.*?)</th><td class="left">the effects of friction', apart)
    assert list(paper.budget.actuation.assumptions) == [row.replace("&#39;", "'") for row in rows]
    assert 'id="hysteresis"' in page
    for name in ("actuation", "hysteresis_by_tension", "hysteresis_by_displacement"):
        assert (written / "tables" / f"{name}.csv").exists()
    shown = printed(paper, 80, verbose=True)
    assert "Actuation: mean tip error" in shown
    assert f"assumed, the robot file gives none: friction 0.1; {STRETCH}" in (
        " ".join(shown.split())
    )
