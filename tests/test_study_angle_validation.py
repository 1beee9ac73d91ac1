"""Constant curvature and rod against measured angles of the tip, without a measured position."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.data.measurements import write_measurements
from bowstring.errors import InputError
from bowstring.study.angle_validation import judge_angles
from bowstring.study.data_validation import judge_data
from shell import Shell, adapter
from test_calibration_orientation import GAIN, NOISE, ROBOT, made

RADIUS = float(ROBOT.tendons.pitch_radius_m[0])


def test_error_of_the_nominal_and_the_calibrated_arc() -> None:
    """The nominal arc bends by 1 / 0.88 too much; calibrated, noise is left."""
    data = made(1)
    found = judge_angles(ROBOT, data, 0.01)
    assert data.bend is not None
    plain, own = (
        found.comparison("cc_from_lengths", "as_measured"),
        found.comparison("cc_calibrated"),
    )
    excess = (1 / GAIN - 1) * np.abs(data.bend)
    assert plain.score.mean == pytest.approx(excess.mean(), rel=0.1)
    assert own.score.rmse == pytest.approx(np.sqrt(2) * NOISE, rel=0.2)
    assert plain.interval[0] < plain.score.mean < plain.interval[1]
    names = [e.name for each in found.calibrations for e in each.estimates]
    assert names.count("base.rz") == 2 and {"gain", "bend_gain"} <= set(names)
    assert "do not judge the tolerance of 1 %" in found.text[0]
    assert "If both were arcs" in found.text[1] and "tolerance" not in " ".join(found.text[1:])


def test_error_of_the_tip_of_an_arc() -> None:
    """The distance of the tips is that of the arcs of the robot with these angles."""
    data = made(2, noise=0.0)
    found = judge_angles(ROBOT, data, 0.01).comparison("cc_from_lengths", "as_measured")
    arcs = [
        RobotArcs.from_lengths(ROBOT, ROBOT.length - gain * data.displacements, hold_length=True)
        for gain in (1.0, GAIN)
    ]
    apart = np.linalg.norm(arcs[0].tip.position - arcs[1].tip.position, axis=1)
    np.testing.assert_allclose(found.apart, apart, rtol=1e-6, atol=1e-9)
    assert found.mean_apart == pytest.approx(apart.mean())
    with_bends_only = judge_angles(ROBOT, replace(data, direction=None), 0.01)
    again = with_bends_only.comparison("cc_from_lengths")
    np.testing.assert_allclose(again.apart, apart, rtol=1e-6, atol=1e-9)
    assert [c.frame for c in with_bends_only.comparisons] == ["as_measured"] * 5
    assert any("No direction was measured" in note for note in with_bends_only.notes)


def test_a_turned_sensor_is_no_error_of_the_model() -> None:
    data = made(3, noise=0.0)
    assert data.direction is not None and data.bend is not None
    turned = replace(data, direction=data.direction + np.radians(7))
    found = judge_angles(ROBOT, turned, 0.01)
    arc = next(each for each in found.calibrations if each.model == "arc")
    np.testing.assert_allclose(np.degrees(arc.turn), [0, 0, 7], atol=1e-4)
    assert found.comparison("cc_calibrated").score.largest < 1e-6
    straight = judge_angles(ROBOT, data, 0.01).comparison("cc_from_lengths", "as_measured")
    registered = found.comparison("cc_from_lengths", "calibrated").score.mean
    assert registered == pytest.approx(straight.score.mean, rel=0.05)
    assert found.comparison("cc_from_lengths", "as_measured").score.mean > 1.2 * registered


@pytest.mark.parametrize("degrees", [7, 90, 180])
def test_angles_that_are_turned_far_are_a_doubt(
    degrees: float, shell: Shell, tmp_path: Path
) -> None:
    """The fitted frame would hide a wrong sign of the displacements."""
    data = made(3)
    assert data.direction is not None
    turned = replace(data, direction=data.direction + np.radians(degrees))
    doubts = judge_angles(ROBOT, turned, 0.01).doubts
    assert len(doubts) == (degrees > 20)
    assert all("the sign of the displacements is wrong" in each for each in doubts)
    table = write_measurements(turned, tmp_path / "angles.csv")
    checked = " ".join(shell("bench", "check", str(table), "--robot", "amouri2019")[1].split())
    assert (f"a base turned by {degrees} degrees" in checked) == (degrees > 20)


def test_tensions() -> None:
    """The rod has the angles of its equilibria; lengths are those of the calibrated rod."""
    robot = ROBOT.with_({"gravity": [0, 0, -9.81]})
    tensions = np.random.default_rng(6).uniform(0, 40, (12, 3))
    x, y, z = bs.solve_batch(robot, tensions).tip_rotation[..., 2].T
    data = replace(
        made(1).select(np.arange(12)),
        tensions=tensions,
        displacements=np.full((12, 3), np.nan),
        bend=np.arctan2(np.hypot(x, y), z),
        direction=np.arctan2(y, x),
    )
    soft = robot.with_({"segments.0.backbone.E": "31 GPa"})
    found = judge_angles(soft, data, 0.01)
    assert found.lengths_of == "rod_calibrated"
    assert found.labels["cc_from_lengths"].startswith("CC from lengths of the calibrated rod")
    assert found.comparison("rod_calibrated").score.largest < np.radians(0.01)
    assert found.comparison("rod").score.mean > np.radians(1)
    assert {"cc_from_force", "cc_from_force_arm"} <= set(found.models)


def test_two_segments_have_no_arc_but_a_gain_each() -> None:
    robot = bs.load_robot("rao2021")
    rng = np.random.default_rng(7)
    tensions = rng.uniform(0, 1.5, (24, 6)) * (rng.random((24, 6)) < 0.5)
    x, y, z = bs.solve_batch(robot, tensions).tip_rotation[..., 2].T
    data = replace(
        made(1).select(np.arange(24)),
        tensions=tensions,
        displacements=np.full((24, 6), np.nan),
        bend=np.arctan2(np.hypot(x, y), z),
        direction=np.arctan2(y, x),
    )
    found = judge_angles(robot, data, 0.01)
    assert all(np.isnan(c.mean_apart) for c in found.comparisons)
    text = " ".join(found.text)
    assert "bend gain of segment 1" in text and "bend gain of segment 2" in text
    assert "If both were arcs" not in text and "One degree" not in text
    assert found.to_dict()["comparisons"][0]["arc_tip_mean_mm"] is None


def test_data_that_are_refused() -> None:
    data = made(1)
    with pytest.raises(InputError, match="the bend angle is the same in all rows"):
        judge_angles(ROBOT, replace(data, bend=np.full(60, 0.4)), 0.01)
    with pytest.raises(InputError, match="has no bend angles; judge_data"):
        judge_angles(ROBOT, replace(data, bend=None), 0.01)
    with pytest.raises(InputError, match="angles only; judge_angles"):
        judge_data(ROBOT, data, 0.01)


def test_the_command(shell: Shell, tmp_path: Path) -> None:
    table = write_measurements(made(3), tmp_path / "angles.csv")
    asked = ["study", "amouri2019", "--measurements", str(table), "--points", "3"]
    out = tmp_path / "out"
    code, text, _ = shell(*asked, "--out", str(out), "--json")
    assert code == 0
    adapter("study").validate_json(text, strict=True)
    content = json.loads(text)
    assert content["measurements"] is None and content["angles"]["rows"] == 60
    assert content["data"] == "simulated; synthetic: angles"
    page = " ".join((out / "report.html").read_text("utf-8").split())
    for sentence in (*content["angles"]["text"], "angles alone, 60 rows at 60 loads"):
        assert sentence.replace("'", "&#39;") in page
    assert content["figures"][0]["stem"] == "measured_angles"
    drawn = page.partition('id="measured_angles"')[2].partition("</figure>")[0]
    assert "<svg" in drawn and "CC from lengths" in drawn and "Synthetic: angles." in drawn
    rows = (out / "tables" / "measured_angles.csv").read_text("utf-8").splitlines()
    assert len(rows) == 61 and "cc_from_lengths_as_measured_error_deg" in rows[0]
    code, _, refused = shell(*asked, "--compare")
    assert code == 2 and "angles has angles only" in refused


def test_angles_in_another_unit_are_noticed() -> None:
    data = made(1)
    assert data.bend is not None
    (doubt,) = judge_angles(ROBOT, replace(data, bend=np.radians(data.bend)), 0.01).doubts
    assert "The tip turns" in doubt and "check the unit of the angles and of the disp" in doubt
