"""Fits to several measured points along the body. All tables are synthetic but one."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring import RodModel
from bowstring.calibration import (
    Data,
    Fit,
    Prior,
    cross_validate,
    filtered,
    fit,
    fit_residual,
    fit_slow_bias,
    observations,
)
from bowstring.calibration.bootstrap import refitted
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.table_fit import Validation, calibrate, read_start
from bowstring.calibration.tip_model import Prediction, TipModel
from bowstring.constant_curvature import RobotArcs
from bowstring.data import Measurements
from bowstring.data.measurements import write_measurements
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from objects import measured, refused
from shell import Shell
from test_calibration_fitting import (
    FRICTION,
    PER_UNIT,
    SIDE,
    E,
    made_up_displacements,
    masses,
    single,
    three_segments,
)

Floats = NDArray[np.float64]
SHARED = "segments.*.tendons.compliance"
ROD = RodModel()
#: Disks of two markers and the tip of the study's robot, from 0.
DISKS = (2, 5, 8)
OFFSETS = {"marker.0.x": 0.02, "marker.0.y": -0.01, "marker.1.z": 0.005, "tool.z": 0.01}
ALL = (E, "base", "tool", "marker.0", "marker.1")


def tensions(rows: int = 30, seed: int = 3) -> Floats:
    return np.random.default_rng(seed).uniform(0.0, 50.0, (rows, 3))


def made(
    robot: Robot,
    truth: Mapping[str, float],
    disks: Sequence[int],
    *,
    noise: float | Sequence[float] = 1e-4,
    seed: int = 0,
    rod: RodModel | None = ROD,
    **commands: Floats,
) -> Data:
    """Points on disks of a robot with known parameters, with noise of each point."""
    (given,) = commands.values()
    data = Data(
        points=np.zeros((len(given), len(disks), 3)),
        stations=robot.disks.station_m[list(disks)] / robot.length,
        **commands,
    )
    unknowns = Unknowns(robot, [], truth)
    rows = observations.commands(data, unknowns.robot)
    points = TipModel(unknowns, rows, rod, disks).predict(np.zeros(0)).points
    own = np.broadcast_to(noise, len(disks))[:, None]
    return replace(
        data, points=points + own * np.random.default_rng(seed).normal(size=points.shape)
    )


def tip_of(data: Data) -> Data:
    """The same rows with the tip alone."""
    return replace(data, points=np.asarray(data.points)[:, -1], stations=None)


def blank(data: Data, where: Any) -> Data:
    points = np.array(data.points)
    points[where] = np.nan
    return replace(data, points=points)


def within(found: Fit, truth: Mapping[str, float], errors: float = 3.0) -> None:
    assert found.converged, found.message
    for estimate in found.estimates:
        start = {"gain": 1.0}.get(estimate.name, 0.0)
        real = truth.get(estimate.name, start) / PER_UNIT[estimate.unit]
        assert abs(estimate.value - real) < errors * estimate.standard_error, estimate


# -- the model -------------------------------------------------------------------------------------


@pytest.mark.parametrize("mixed", [False, True])
def test_exact_derivatives_match_differences(mixed: bool) -> None:
    """Markers beside the backbone, two of them on disks between, one on the end disk."""
    robot = three_segments(
        **{
            "segments.0.tendons.pretension": 0.5,
            "segments.2.tendons.axial_stiffness": 5e3,
            "segments.2.tendons.free_length": 0.3,
            "gravity": "0 0 9.81 m/s^2",
        }
    )
    names = [SHARED, "segments.0.tendons.pretension", "segments.2.tendons.free_length"]
    names += [
        "segments.2.tendons.axial_stiffness",
        "gain.tendons",
        "offset.tendons",
        "backlash",
        "delay",
        "base",
        "tool",
    ]
    names += ["marker.0", "marker.1", "marker.2", "segments.1.backbone.E"]
    given = made_up_displacements(12)
    forces = np.full_like(given, np.nan)
    if mixed:
        given[:, 4], forces[:, 4] = np.nan, np.linspace(0.5, 3.0, 12)
    data = Data(np.zeros((12, 4, 3)), forces, given, time=np.arange(12.0))
    start = {"tool.z": 8e-3, "base.rx": 0.2, "backlash": 5e-5, "delay": 0.05}
    start |= {"marker.0.y": 0.02, "marker.1.x": -0.03, "marker.2.z": 0.01}
    unknowns = Unknowns(robot, names, start)
    model = TipModel(unknowns, observations.commands(data, robot), RodModel(), (4, 14, 29, 29))
    at = model.predict(unknowns.start, keep=True)
    exact = model.jacobian(unknowns.start, at)
    plain = Prediction(at.position, at.rotation, at.solved, at.setting, disks=at.disks)
    differences = model.jacobian(unknowns.start, plain)
    assert exact.shape == (12, 12, len(unknowns.names))
    for i, name in enumerate(unknowns.names):
        size = max(np.abs(differences[:, :, i]).max(), 1e-9 / unknowns.items[i].step)
        error = np.abs(exact[:, :, i] - differences[:, :, i]).max() / size
        assert error <= 1e-6, name
    # the piecewise linear model has the same derivatives
    pieces = model.pieces(unknowns.start, at)
    assert pieces is not None
    taut = pieces.by_displacement & (pieces.tensions > 0.0)
    np.testing.assert_allclose(pieces.tangent(taut), exact, rtol=0.0, atol=1e-6 * abs(exact).max())


@pytest.mark.parametrize(
    ("robot", "rod", "disks"),
    [
        (single(), RodModel(elements=8), DISKS),
        (single().with_({"segments.0.tendons.friction": 0.1}), RodModel(elements=8), (3, 8)),
        (single(), None, DISKS),
    ],
)
def test_points_are_those_of_the_disks(
    robot: Robot, rod: RodModel | None, disks: tuple[int, ...]
) -> None:
    rows = tensions(9)
    unknowns = Unknowns(robot, [], {**OFFSETS, "base.x": 0.1})
    commands = observations.commands(Data(np.zeros((9, 3)), rows), robot)
    got = TipModel(unknowns, commands, rod, disks).predict(np.zeros(0))
    if rod is None:
        found: Any = RobotArcs.from_tensions(robot, rows)
    else:
        found = bs.sweep(robot, rows, model=rod)
    offsets = np.zeros((len(disks), 3))
    offsets[0] = [0.02, -0.01, 0.0]
    offsets[-1, 2] = 0.01
    if len(disks) > 2:
        offsets[1, 2] = 0.005
    turned = found.disk_rotations[:, disks]
    points = found.disk_positions[:, disks] + np.einsum("kmij,mj->kmi", turned, offsets)
    points[..., 0] += 0.1
    np.testing.assert_allclose(got.points, points, rtol=0.0, atol=1e-7)
    np.testing.assert_array_equal(got.point, got.points[:, -1])


# -- fits ------------------------------------------------------------------------------------------


def test_recovers_offsets_and_stiffness() -> None:
    truth = {E: 33e9, "base.rx": 0.01, **OFFSETS}
    found = fit(single(), made(single(), truth, DISKS, tensions=tensions()), ALL)
    assert found.message == "Converged."
    within(found, truth)
    assert [each.disk for each in found.points] == [3, 6, 9]
    assert found.points[0].station == pytest.approx(1 / 3)
    for each in (*(each.score for each in found.points), found.score_of_points):
        assert each.rmse == pytest.approx(1e-4 * np.sqrt(3.0), rel=0.15)
    assert found.score_of_points.count == 90 and found.points[-1].score == found.score
    assert found.points[0].before.rmse > 5e-3


def test_recovers_from_displacements_with_markers_that_are_not_always_seen() -> None:
    robot = three_segments()
    truth = {SHARED: 1.2e-4, "gain": 0.97, "tool.z": 0.008, "marker.0.x": 0.02, "marker.1.y": 0.01}
    data = made(robot, truth, (9, 19, 29), displacements=made_up_displacements(40))
    data = blank(data, (slice(None, None, 3), 0))  # the first marker in every third row
    data = blank(data, (1, 2))  # the tip
    data = blank(blank(data, 4), (7, 1, 2))  # a whole row, and one coordinate
    names = [SHARED, "base", "gain", "tool.z", "marker.0", "marker.1"]
    found = fit(robot, data, names)
    within(found, truth)
    assert not found.used[4] and found.used.sum() == 39
    assert found.used[1] and not found.used_tips[1]
    assert [each.score.count for each in found.points] == [25, 38, 38]
    seen = np.isfinite(np.asarray(data.points)).all(axis=2)
    np.testing.assert_array_equal(np.isfinite(found.point_residuals).all(axis=2), seen)
    # what is not measured has no influence
    wild = np.array(data.points)
    wild[7, 1, :2] = 5.0
    assert fit(robot, replace(data, points=wild), names).values == found.values


def test_recovers_with_friction(robot: Robot) -> None:
    truth = {E: 35e9, FRICTION: 0.12, "marker.0.x": 0.02, "marker.0.z": -0.004}
    data = made(robot, truth, (3, 8), noise=2e-5, tensions=masses()[::2] + SIDE)
    found = fit(robot.with_({FRICTION: 0.1}), data, [E, FRICTION, "marker.0"])
    within(found, truth)


def test_recovers_by_constant_curvature(robot: Robot) -> None:
    truth = {"bend_gain": 0.93, "marker.0.x": 0.02, "marker.1.y": -0.01}
    data = made(robot, truth, DISKS, rod=None, tensions=tensions())
    names = ["bend_gain", "marker.0", "marker.1.y"]
    found = fit(robot, data, names, model="arc")
    assert abs(found["bend_gain"].value - 0.93) < 3 * found["bend_gain"].standard_error
    for name, value in (("marker.0.x", 20.0), ("marker.0.z", 0.0), ("marker.1.y", -10.0)):
        assert abs(found[name].value - value) < 3 * found[name].standard_error


@pytest.mark.parametrize("stiffness", [E, Prior(E, 1e9)])
def test_markers_make_estimates_more_certain(stiffness: str | Prior) -> None:
    """Also with offsets of the markers, which are known here."""
    truth = {E: 33e9, "base.rx": 0.01, "tool.z": 0.01, "marker.0.x": 0.02}
    data = made(single(), truth, DISKS, tensions=tensions())
    parameters = [stiffness, "base", "tool.z"]
    held = {"marker.0.x": 0.02}
    whole, alone = (fit(single(), each, parameters, start=held) for each in (data, tip_of(data)))
    within(whole, truth)
    within(alone, truth)
    for estimate in whole.estimates:
        assert estimate.standard_error < alone[estimate.name].standard_error, estimate.name
    assert whole[E].standard_error < 0.2 * alone[E].standard_error


def test_each_point_has_its_own_noise() -> None:
    """An offset is as certain as its marker, not as the tip, over 30 tables."""
    robot, names = single(), ["marker.0.x", "tool.x"]
    noise, rows = (2e-5, 1e-3), tensions(20)
    found = [
        fit(
            robot,
            made(robot, {}, (2, 8), noise=noise, seed=seed, tensions=rows),
            names,
            loss="linear",
        )
        for seed in range(30)
    ]
    for name, own in zip(names, noise, strict=True):
        errors = np.array([each[name].standard_error for each in found])
        values = np.array([each[name].value for each in found])
        assert errors.mean() == pytest.approx(1e3 * own / np.sqrt(20.0), rel=0.1)
        assert values.std() == pytest.approx(errors.mean(), rel=0.35)
        held = [each[name].low < 0.0 < each[name].high for each in found]
        assert sum(held) >= 26


@pytest.mark.slow
@pytest.mark.parametrize("rows", [8, 20])
def test_intervals_contain_the_truth(rows: int) -> None:
    """Over 80 tables: points with noise of 0.02, 0.1 and 1 mm, the first seen in a half of rows."""
    truth, names = {E: 35e9, **OFFSETS}, [E, "base", "tool.z", "marker.0", "marker.1"]
    robot, noise = single(), (2e-5, 1e-4, 1e-3)
    held = []
    for seed in range(80):
        given = tensions(rows, seed=seed)
        data = made(robot, truth, DISKS, noise=noise, seed=1000 + seed, tensions=given)
        unseen = np.random.default_rng(2000 + seed).permutation(rows) < rows // 2
        found = fit(robot, blank(data, (unseen, 0)), names, loss="linear")
        for each in found.estimates:
            real = truth.get(each.name, 0.0) / {"mm": 1e-3, "deg": 1.0, "GPa": 1e9}[each.unit]
            held.append(each.low < real < each.high)
    assert 0.93 < np.mean(held) < 0.985


def test_a_tip_is_fitted_as_without_a_station() -> None:
    truth = {E: 33e9, "tool.z": 0.01}
    data = tip_of(made(single(), truth, DISKS, tensions=tensions()))
    points = np.asarray(data.points)
    names = [E, "base", "tool.z"]
    plain = fit(single(), data, names)
    stated = fit(single(), Data(points[:, None], tensions(), stations=[1.0]), names)
    assert stated.values == plain.values
    assert [e.standard_error for e in stated.estimates] == [
        e.standard_error for e in plain.estimates
    ]
    # points without stations are not fitted, and the message names them
    more = np.stack([np.full_like(points, 7.0), points], axis=1)
    found = fit(single(), Data(more, tensions()), names)
    assert found.values == plain.values
    assert found.message == (
        "Converged. The 1 point below the tip has no station, and the tip alone is fitted: give "
        "stations to fit all points."
    )


def test_the_last_point_need_not_be_on_the_end_disk() -> None:
    truth = {E: 33e9, "tool.x": 0.02}
    data = made(single(), truth, (2, 6), tensions=tensions())
    found = fit(single(), data, [E, "tool.x"])
    within(found, truth)
    np.testing.assert_array_equal(found.predict(data), found.predict_points(data)[:, -1])
    with pytest.raises(InputError, match="the last point is on disk 7; a residual is of a tip on"):
        fit_residual(found, data)


def test_tendons_in_the_body_are_fitted_by_tensions() -> None:
    """The core has no derivatives for them: differences."""
    tentacle = bs.load_robot(Path(__file__).parents[1] / "examples" / "tentacle.yaml")
    modulus = "segments.*.backbone.E"
    start = tentacle.segments[0].backbone.E
    assert start is not None
    count = tentacle.core.tendon_count
    rows = np.random.default_rng(1).uniform(0.0, 2.0, (12, count))
    end = len(tentacle.disks.station_m) - 1
    truth = {modulus: 1.1 * start, "marker.0.y": 0.02}
    data = made(tentacle, truth, (end // 2, end), tensions=rows)
    found = fit(tentacle, data, [modulus, "marker.0.y"])
    assert found.converged
    assert found.values[modulus] == pytest.approx(1.1 * start, rel=0.01)
    assert found["marker.0.y"].value == pytest.approx(
        20.0, abs=4 * found["marker.0.y"].standard_error
    )


# -- what follows a fit ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def drifting() -> Data:
    """Rows in order, with a slow bias of all points and some tips that are not measured."""
    data = made(single(), OFFSETS, DISKS, tensions=tensions(60))
    drift = np.cumsum(np.random.default_rng(8).normal(0.0, 5e-4, (60, 1, 3)), axis=0)
    return blank(replace(data, points=data.points + drift), (slice(5, 8), -1))


def test_validation_and_filter_are_of_the_tip(robot: Robot, drifting: Data) -> None:
    found = fit(robot, drifting, [E, "marker.0"], start={"tool.z": 0.01})
    assert found.used.all() and found.used_tips.sum() == 57
    checked = cross_validate(fit(robot, drifting, [E], start=OFFSETS), drifting, folds=3)
    assert checked.score.count == 57 and checked.residuals.shape == (60, 3)
    assert np.isnan(checked.residuals[5:8]).all()
    assert checked.score.rmse < 0.02
    ahead = filtered(found, drifting, fit_slow_bias(found, drifting))
    assert ahead.score.count == 57 and ahead.score.rmse < 0.5 * ahead.open_loop_score.rmse
    residual = fit_residual(found, drifting)
    assert residual.validated[0].count <= 57


def test_rows_of_a_fit_move_together_in_a_resample() -> None:
    """The bootstrap of a fit to three points is that of its tip."""
    data = made(single(), OFFSETS, DISKS, noise=1e-3, tensions=tensions(20))
    data = blank(data, (slice(3, 6), 0))
    found = fit(single(), data, [E, "base"], start=OFFSETS, loss="linear")
    unit = np.arange(20)
    expected = refitted(found.residuals, found.linear, unit, resamples=400)
    assert expected is not None
    assert found.score.mean < expected.mean < 1.2 * found.score.mean
    # the same by hand for a few resamples
    linear = found.linear
    assert linear.row is not None and linear.tip is not None
    assert len(linear.row) == 57 and linear.tip.sum() == 20
    errors, random = [], np.random.default_rng(4)
    for _ in range(200):
        drawn = random.integers(0, 20, 20)
        points = np.concatenate([np.flatnonzero(linear.row == row) for row in drawn])
        slope = linear.by_parameter[points].reshape(-1, 7)
        change = np.linalg.lstsq(slope, -linear.force[points].ravel(), rcond=None)[0]
        moved = found.residuals + linear.by_parameter[linear.tip] @ change
        errors.append(
            np.linalg.norm(moved, axis=1).mean() - np.linalg.norm(moved[drawn], axis=1).mean()
        )
    assert expected.mean - found.score.mean == pytest.approx(np.mean(errors), rel=0.5)


def measurements(data: Data) -> Measurements:
    return measured(
        data.points, tensions=np.asarray(data.tensions), stations=np.asarray(data.stations)
    )


def test_held_out_rows_are_fitted_by_no_point() -> None:
    data = measurements(made(single(), OFFSETS, DISKS, tensions=tensions()))
    check = Validation(holdout=0.2)
    spoilt = data.points.copy()
    spoilt[-6:] += 0.01
    found, other = (
        calibrate(single(), replace(data, points=points), ["tool.z", "marker.0"], validation=check)
        for points in (data.points, spoilt)
    )
    assert found.held_out.sum() == 6 and found.fit.values == other.fit.values


def test_rows_behind_the_first_held_out_one_are_not_fitted() -> None:
    """Not by their markers either, where their tips are blank."""
    points = made(single(), OFFSETS, DISKS, tensions=tensions())
    data = measurements(blank(points, (slice(26, 28), -1)))
    found = calibrate(single(), data, ["tool.z"], validation=Validation(holdout=0.2))
    last = int(np.flatnonzero(found.fit.used)[-1])
    assert found.held_out.sum() + last + 1 == 28 and not found.fit.used[last + 1 :].any()


def test_the_command_reports_each_point(shell: Shell, tmp_path: Path) -> None:
    data = blank(made(single(), OFFSETS, DISKS, tensions=tensions()), (slice(0, 4), 1))
    table = write_measurements(measurements(data), tmp_path / "markers.csv")
    names = ("tool.z", "marker.0", "marker.1.z")
    command = ("fit", "amouri2019", "--measurements", str(table))
    command += tuple(part for name in names for part in ("--parameter", name))
    got = shell.json(*command, "--out", str(tmp_path / "fit"))
    assert [each["disk"] for each in got["points"]] == [3, 6, 9]
    assert [each["rows"] for each in got["points"]] == [30, 26, 30]
    assert got["points"][-1]["rmse_mm"] == got["rmse_mm"]
    assert got["all_points"]["count"] == 86
    squares = sum(each["rows"] * each["rmse_mm"] ** 2 for each in got["points"])
    assert got["all_points"]["rmse_mm"] == pytest.approx(np.sqrt(squares / 86))
    assert json.loads((tmp_path / "fit" / "fit.json").read_text())["points"] == got["points"]
    code, out, err = shell(*command)
    lines = [line.split() for line in out.splitlines()]
    assert (code, err) == (0, "") and "30 rows, 3 points a row" in out
    assert ["2", "6", "26"] in [line[:3] for line in lines]
    assert ["tip", "9", "30"] in [line[:3] for line in lines]
    assert any(line[:2] == ["all", "86"] for line in lines)
    # offsets are no part of the robot file, and the next fit holds them
    values = read_start(tmp_path / "fit" / "calibration.json")
    assert values["marker.0.x"] == pytest.approx(0.02, abs=2e-4)
    start = ("--start", str(tmp_path / "fit" / "calibration.json"))
    again = shell.json("fit", "amouri2019", "--measurements", str(table), "--parameter", E, *start)
    before, after = again["all_points"]["rmse_before_mm"], got["all_points"]["rmse_mm"]
    assert before == pytest.approx(after, rel=1e-6)


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "names", "says"),
    [
        ({"stations": [0.25, 0.6666667, 1.0]}, [E],
         r"point 1 is at station 0.25, where amouri2019 has no disk; the nearest is disk 2 at "
         r"0.22222: give the robot a disk there"),
        ({"stations": [0.5, 1.0]}, [E], "it must be 3 numbers, one for each point"),
        ({"stations": [2 / 3, 1 / 3, 1.0]}, [E], "must rise from point to point"),
        ({"stations": [0.3, np.nan, 1.0]}, [E], "it must be 3 numbers, one for each point"),
        ({"stations": "0.3"}, [E], "it must be 3 numbers, one for each point"),
        ({}, ["marker.2.x"],
         "marker.2.x is not identifiable: the rows have the points marker.0 to marker.1 below"),
        ({"stations": None}, ["marker.0.x"], "marker.0.x is not identifiable: the points have no"),
        ({}, ["marker"], r"there is no parameter 'marker'; did you mean marker.0\?"),
        ({}, ["marker.0.rx"], r"there is no parameter 'marker.0.rx'"),
        ({}, ["marker.00.x"], r"there is no parameter 'marker.00.x'"),
        ({}, ["marker.0", "marker.0.x"], "parameter marker.0.x is named twice"),
    ],
)  # fmt: skip
def test_bad_input(change: dict[str, Any], names: list[str], says: str) -> None:
    data = made(single(), {}, DISKS, tensions=tensions(8))
    refused(says, lambda: fit(single(), replace(data, **change), names))


def test_a_marker_that_is_never_seen() -> None:
    data = made(single(), {}, DISKS, tensions=tensions(8))
    with pytest.raises(InputError, match="point 2 of 3 is measured in no row; leave out its col"):
        fit(single(), blank(data, (slice(None), 1)), [E])
    half = blank(data, (slice(4), 1))
    with pytest.raises(InputError, match=r"marker\.1\.x has no effect on the measured points"):
        fit(single(), half, [E, "marker.1.x"], rows=np.arange(8) < 4)
    infinite = np.array(data.points)
    infinite[2, 1, 0] = np.inf
    with pytest.raises(InputError, match="row 3: point 2 is infinite"):
        fit(single(), replace(data, points=infinite), [E])


def test_an_offset_and_the_base_are_not_separated_by_one_pose() -> None:
    """A straight robot: its base and its marker move the same point alike."""
    data = made(single(), {}, DISKS, tensions=np.zeros((5, 3)))
    found = fit(single(), data, ["base.x", "tool.x", "marker.0.x", "marker.1.x"])
    assert found.not_identifiable
    assert "The data cannot separate" in found.message
