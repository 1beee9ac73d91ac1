"""Registration: exact without noise, and with the coverage found in simulated benches.

All data here are synthetic, with a known truth.

"""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.data.registration import (
    Registration,
    fit_fiducials,
    fit_model,
    known,
    with_and_without,
)
from bowstring.data.rigid import Rigid
from bowstring.errors import InputError
from objects import all_sides, refused

CORNERS = 0.1 * np.array([[0, 0, 0], [1, 0, 0.1], [0, 1, 0], [0.2, 0.3, 1]])  # fiducials, m


def any_frame(rng: np.random.Generator) -> Rigid:
    return Rigid(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))


@pytest.fixture(scope="module")
def tips(robot: bs.Robot) -> tuple[Floats, Floats]:
    """Tips bent in all directions: positions (20, 3), m, and rotations."""
    sweep = bs.sweep(robot, all_sides())
    return sweep.tip_position, sweep.tip_rotation


def errors(found: Registration, truth: Rigid, offset: Floats | None = None) -> Floats:
    """Truth minus estimate, as in the covariance."""
    turn = truth.rotation @ found.frame.rotation.T
    shift = truth.apply(found.frame.inverse().apply(found.pivot)) - found.pivot
    out = [Rotation.from_matrix(turn).as_rotvec(), shift]
    if offset is not None:
        assert found.offset is not None
        out.append(offset - found.offset)
    return np.concatenate(out)


# -- fiducials ---------------------------------------------------------------------------------


def test_fiducials_without_noise() -> None:
    rng = np.random.default_rng(0)
    for count in (3, 4, 9):
        base = rng.normal(size=(count, 3))
        truth = any_frame(rng)
        found = fit_fiducials(truth.inverse().apply(base), base)
        assert np.abs(errors(found, truth)).max() < 1e-13
        assert found.rms < 1e-13
        assert found.dof == 3 * count - 6
        assert np.all(found.standard_error < 1e-12)


def test_fiducials_are_weighted_by_sigma() -> None:
    """A bad fiducial with a large sigma hardly moves the frame."""
    measured = CORNERS.copy()
    measured[3] += [0.0, 0.0, 5e-3]
    even = fit_fiducials(measured, CORNERS)
    found = fit_fiducials(measured, CORNERS, [1e-5, 1e-5, 1e-5, 1e-2])
    off = [np.abs(f.apply(CORNERS) - CORNERS).max() for f in (even, found)]
    assert off[1] < 1e-3 * off[0]


@pytest.mark.parametrize("sigma", ["one", "each", None])
@pytest.mark.slow
def test_coverage_of_fiducials(sigma: str | None) -> None:
    """95 % intervals of all six errors contain the truth in 95 % of simulated registrations."""
    rng = np.random.default_rng(7)
    noise = np.array([5e-5, 1e-4, 2e-4, 4e-4]) if sigma == "each" else np.full(4, 1e-4)
    runs, inside, normal, fit, target = 1500, np.zeros(6), [], [], []
    point = np.array([0.3, -0.2, 0.5])
    for _ in range(runs):
        truth = any_frame(rng)
        measured = truth.inverse().apply(CORNERS) + noise[:, None] * rng.normal(size=(4, 3))
        found = fit_fiducials(measured, CORNERS, noise if sigma else None)
        error = errors(found, truth)
        inside += np.abs(error) <= found.interval()
        normal.append(error @ np.linalg.solve(found.covariance, error))
        missed = truth.apply(found.frame.inverse().apply(point)) - point
        target.append((missed @ missed, found.target_error(point) ** 2))
        fit.append(found.misfit)
    assert np.all(np.abs(inside / runs - 0.95) < 0.03)
    missed_mean, expected = np.mean(target, axis=0)
    if sigma:
        # the whole covariance, correlations included; and the residual is noise
        assert stats.kstest(normal, stats.chi2(6).cdf).pvalue > 1e-3
        assert stats.kstest(6 * np.array(fit), stats.chi2(6).cdf).pvalue > 1e-3
        assert missed_mean == pytest.approx(expected, rel=0.1)
    else:
        assert stats.kstest(np.array(normal) / 6, stats.f(6, 6).cdf).pvalue > 1e-3
        assert math.isnan(found.misfit)


def test_target_error_matches_fitzpatricks_formula() -> None:
    """The formula of Fitzpatrick, West and Maurer 1998, from the principal axes."""
    sigma, count = 1e-4, len(CORNERS)
    found = fit_fiducials(CORNERS, CORNERS, sigma)
    centred = CORNERS - CORNERS.mean(axis=0)
    _, size, axes = np.linalg.svd(centred)
    point = np.array([0.05, 0.4, -0.2])
    arm = axes @ (point - CORNERS.mean(axis=0))
    total = 1.0
    for k in range(3):
        others = [i for i in range(3) if i != k]
        from_axis = sum(size[i] ** 2 for i in others) / count
        total += sum(arm[i] ** 2 for i in others) / from_axis / 3.0
    expected = math.sqrt(total * 3.0 * sigma**2 / count)
    assert found.target_error(point) == pytest.approx(expected, rel=1e-9)
    np.testing.assert_allclose(found.pivot, CORNERS.mean(axis=0), atol=1e-15)
    assert np.abs(found.covariance[:3, 3:]).max() < 1e-20
    moved = found.covariance_about(point)
    np.testing.assert_allclose(moved[3:, 3:], found.point_covariance(point), rtol=1e-12)


def test_noise_larger_than_stated() -> None:
    rng = np.random.default_rng(3)
    measured = CORNERS + 1e-3 * rng.normal(size=(4, 3))
    assert fit_fiducials(measured, CORNERS, 1e-4).variance_p < 1e-6
    assert fit_fiducials(measured, CORNERS, 1e-3).variance_p > 1e-3


@pytest.mark.parametrize(
    ("change", "cause"),
    [
        (np.diag([1.0, -1.0, 1.0]), "change the sign of its y"),
        (np.diag([1.0, 1.0, -1.0]), "change the sign of its z"),
        (np.eye(3)[[1, 0, 2]], "swap its x and y"),
    ],
)
def test_left_handed_fiducials_are_named(change: Floats, cause: str) -> None:
    rng = np.random.default_rng(5)
    truth = Rigid.from_rotation_vector([0.02, -0.05, 0.03], [0.1, 0.2, 0.3])
    measured = truth.inverse().apply(CORNERS) @ change.T + 1e-5 * rng.normal(size=(4, 3))
    refused(f"left-handed.*{cause}", lambda: fit_fiducials(measured, CORNERS))
    far = any_frame(rng).apply(measured)
    refused(r"left-handed.*order of the points", lambda: fit_fiducials(far, CORNERS, 1e-5))


@pytest.mark.parametrize("draws", [30, pytest.param(300, marks=pytest.mark.slow)])
def test_noise_is_rarely_called_left_handed(draws: int) -> None:
    """Fiducials nearly in one plane, with noise as large as their distance from it."""
    rng = np.random.default_rng(2)
    flat = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0.5, 0.5, 1e-3]])
    for _ in range(draws):
        fit_fiducials(any_frame(rng).apply(flat) + 1e-3 * rng.normal(size=(5, 3)), flat)


@pytest.mark.parametrize(
    ("measured", "base", "message"),
    [
        (CORNERS[:2], CORNERS[:2], "2 fiducials do not fix a frame"),
        (CORNERS, CORNERS[:3], "4 fiducials are measured and 3 given"),
        (CORNERS[[0, 1, 2, 1]], CORNERS, "fiducials 2 and 4 are in one place in the measured"),
        (CORNERS, CORNERS[[0, 0, 1, 2]], "fiducials 1 and 2 are in one place in the base"),
        (1e3 * CORNERS, CORNERS, "give both in m, and in the same order"),
        (np.outer([0, 1, 3], [1, 2, 3]), CORNERS[:3], "measured fiducials lie on one line"),
        (CORNERS[:3], np.outer([0, 1, 3], [1, 2, 3]), "base fiducials lie on one line"),
        (CORNERS * [[1], [1], [1], [np.nan]], CORNERS, "point 4 of measured"),
        (CORNERS[:, :2], CORNERS, r"points \(..., 3\)"),
        (CORNERS[0], CORNERS, r"must be \(points, 3\)"),
    ],
)
def test_bad_fiducials(measured: Floats, base: Floats, message: str) -> None:
    refused(message, lambda: fit_fiducials(measured, base))


@pytest.mark.parametrize("sigma", [0.0, -1.0, math.nan, [1e-4, 1e-4], "a"])
def test_bad_sigma(sigma: object) -> None:
    refused("sigma is", lambda: fit_fiducials(CORNERS, CORNERS, sigma))  # type: ignore[arg-type]


# -- with the model ----------------------------------------------------------------------------


@pytest.mark.parametrize("robust", [False, True])
def test_model_without_noise(tips: tuple[Floats, Floats], robust: bool) -> None:
    """Any frame and offset, without a starting guess."""
    predicted, rotations = tips
    rng = np.random.default_rng(0)
    for size in (0.0, 0.02, 0.3):
        truth, offset = any_frame(rng), size * rng.normal(size=3)
        measured = truth.inverse().apply(predicted + rotations @ offset)
        found = fit_model(measured, predicted, rotations, robust=robust)
        assert np.abs(errors(found, truth, offset)).max() < 1e-9
        np.testing.assert_allclose(found.tips(measured, rotations), predicted, atol=1e-9)
    assert fit_model(truth.inverse().apply(predicted), predicted).rms < 1e-13


@pytest.mark.parametrize("sigma", [2e-4, None])
@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.slow
def test_coverage_with_the_model(
    tips: tuple[Floats, Floats], sigma: float | None, robust: bool
) -> None:
    """95 % intervals of all nine unknowns contain the truth in 95 % of simulated benches."""
    predicted, rotations = tips
    rng = np.random.default_rng(11)
    runs, inside = 200 if robust else 400, np.zeros(9)
    for _ in range(runs):
        truth, offset = any_frame(rng), 0.02 * rng.normal(size=3)
        measured = truth.inverse().apply(predicted + rotations @ offset)
        measured = measured + 2e-4 * rng.normal(size=measured.shape)
        found = fit_model(measured, predicted, rotations, sigma=sigma, robust=robust)
        inside += np.abs(errors(found, truth, offset)) <= found.interval()
        assert not found.undetermined
    # each within 3.3 standard errors of so many runs; all together within 1.5 %
    assert np.all(np.abs(inside / runs - 0.95) < 3.3 * math.sqrt(0.95 * 0.05 / runs))
    assert abs(inside.mean() / runs - 0.95) < 0.015


def test_residuals_of_a_good_model_are_noise(tips: tuple[Floats, Floats]) -> None:
    predicted, rotations = tips
    rng = np.random.default_rng(4)
    noise = 2e-5 * rng.normal(size=predicted.shape)
    good = fit_model(predicted + noise, predicted, rotations, sigma=2e-5)
    assert 0.01 < good.variance_p < 0.99
    bent = fit_model(predicted * [1.01, 1.0, 1.0] + noise, predicted, rotations, sigma=2e-5)
    assert bent.variance_p < 1e-9


def test_gross_errors_are_found(tips: tuple[Floats, Floats]) -> None:
    predicted, rotations = tips
    rng = np.random.default_rng(6)
    truth, offset = any_frame(rng), np.array([0.0, 0.01, 0.02])
    measured = truth.inverse().apply(predicted + rotations @ offset)
    measured = measured + 1e-4 * rng.normal(size=measured.shape)
    measured[3] += 0.1
    measured[8] -= 0.05
    plain = fit_model(measured, predicted, rotations)
    robust = fit_model(measured, predicted, rotations, robust=True)
    assert set(np.flatnonzero(robust.weight < 0.01)) == {3, 8}
    assert robust.sigma[0] == pytest.approx(1e-4, rel=0.3)
    off = [np.linalg.norm(errors(f, truth, offset)) for f in (plain, robust)]
    assert off[1] < 0.02 * off[0]


def test_objectivity(tips: tuple[Floats, Floats]) -> None:
    """The registered points do not depend on the position of the measuring frame."""
    predicted, rotations = tips
    rng = np.random.default_rng(8)
    measured = predicted + 1e-3 * rng.standard_t(2, size=predicted.shape)
    other = any_frame(rng)
    for robust in (False, True):
        one = fit_model(measured, predicted, rotations, robust=robust)
        two = fit_model(other.apply(measured), predicted, rotations, robust=robust)
        np.testing.assert_allclose(two.residual, one.residual, atol=1e-8)
        np.testing.assert_allclose(two.standard_error, one.standard_error, rtol=1e-4)
        np.testing.assert_allclose((two.frame @ other).rotation, one.frame.rotation, atol=1e-7)


def test_planar_tips_leave_the_normal_offset_undetermined(robot: bs.Robot) -> None:
    sweep = bs.sweep(robot, np.outer(np.linspace(0, 80, 17), [1, 0, 0]))
    predicted, rotations = sweep.tip_position, sweep.tip_rotation
    rng = np.random.default_rng(1)
    truth, offset = any_frame(rng), np.array([0.01, 0.02, 0.03])
    measured = truth.inverse().apply(predicted + rotations @ offset)
    measured = measured + 2e-5 * rng.normal(size=measured.shape)
    found = fit_model(measured, predicted, rotations, sigma=2e-5)
    assert found.undetermined == ("shift of the frame along y against offset along y of the tip",)
    names = np.array(found.parameters)
    assert set(names[np.isinf(found.standard_error)]) == {"shift_y_m", "offset_y_m"}
    # the determined part is as accurate as before, the undetermined part stays near zero
    error = np.abs(errors(found, truth, offset))
    known_ones = np.isfinite(found.standard_error)
    assert np.all(error[known_ones] < 4 * found.standard_error[known_ones])
    assert found.offset is not None and abs(found.offset[1]) < 0.02
    assert found.rms < 4e-5
    assert math.isinf(found.target_error([0, 0, 0]))
    row = found.to_dict()
    assert row["standard_error"]["shift_y_m"] is None
    json.dumps(row, allow_nan=False)
    # without an offset a plane is sufficient
    assert not fit_model(measured, predicted).undetermined


def test_small_bends_hardly_separate_offset_and_frame(robot: bs.Robot) -> None:
    sweep = bs.sweep(robot, np.outer(np.linspace(0, 8, 17), [1, 0, 0]))
    found = fit_model(sweep.tip_position, sweep.tip_position, sweep.tip_rotation, sigma=2e-5)
    assert any("shift" in w and "offset" in w and "standard error" in w for w in found.weak)


def test_collinear_tips_leave_a_rotation_undetermined() -> None:
    line = np.outer(np.linspace(0, 1, 8), [0, 0, 0.3])
    truth = Rigid.from_rotation_vector([0.3, -0.2, 0.0], [1.0, 2.0, 3.0])
    found = fit_model(truth.inverse().apply(line), line)
    assert found.undetermined == ("rotation of the frame about z",)
    assert found.rms < 1e-12
    assert found.parameters[2] == "rotation_z_rad" and math.isinf(found.standard_error[2])
    # a tip that never rotates does not separate its offset from the frame
    stiff = np.tile(np.eye(3), (8, 1, 1))
    found = fit_model(truth.inverse().apply(line), line, stiff)
    # equally undetermined: in any order
    assert sorted(found.undetermined) == [
        "rotation of the frame about z",
        *(f"shift of the frame along {a} against offset along {a} of the tip" for a in "xyz"),
    ]
    assert found.offset is not None and np.abs(found.offset).max() < 1e-9


def test_undetermined_parameters_keep_their_start() -> None:
    line = np.outer(np.linspace(0, 1, 8), [0, 0, 0.3])
    start = Rigid.from_rotation_vector([0, 0, 1.0])
    found = fit_model(line, line, start=start)
    np.testing.assert_allclose(found.frame.rotation, start.rotation, atol=1e-9)


@pytest.mark.parametrize("offset", [False, True])
def test_left_handed_tips_are_named(tips: tuple[Floats, Floats], offset: bool) -> None:
    predicted, rotations = tips
    rng = np.random.default_rng(9)
    near = Rigid.from_rotation_vector([0.01, 0.02, -0.03], [0.1, 0, 0])
    for frame, cause in ((near, "change the sign of its y"), (any_frame(rng), "left-handed")):
        measured = frame.inverse().apply(predicted + rotations @ [0.0, 0.0, 0.01])
        measured = measured * [1.0, -1.0, 1.0] + 1e-4 * rng.normal(size=predicted.shape)
        with pytest.raises(InputError, match=f"left-handed.*{cause}|{cause}"):
            fit_model(measured, predicted, rotations if offset else None)


def test_bad_model_input(tips: tuple[Floats, Floats]) -> None:
    predicted, rotations = tips
    for call, message in (
        (lambda: fit_model(predicted[:2], predicted[:2]), "2 points have 6 coordinates"),
        (lambda: fit_model(predicted[:3], predicted[:3], rotations[:3]), "give 4 or more"),
        (lambda: fit_model(predicted[:5], predicted), "5 points are measured and 20 predicted"),
        (lambda: fit_model(predicted, predicted, rotations[:4]), r"rotations has shape \(4"),
        (lambda: fit_model(predicted, predicted, -rotations), "rotation 1 is none"),
        (lambda: fit_model(predicted * np.nan, predicted), "point 1 of measured"),
        (lambda: fit_model(predicted, predicted[:1].repeat(20, 0)), "in one place"),
        (lambda: fit_model(predicted, predicted, robust=1), "robust is 1"),  # type: ignore[arg-type]
        (lambda: fit_model(predicted, predicted, start=1), "start is 1"),  # type: ignore[arg-type]
    ):
        refused(message, call)


# -- known, and with and without ---------------------------------------------------------------


def test_known_registration() -> None:
    frame = Rigid.from_rotation_vector([0.1, 0.2, 0.3], [1, 2, 3])
    exact = known(frame)
    assert exact.target_error([5, 5, 5]) == 0.0 and math.isnan(exact.rms)
    unsure = known(frame, np.diag([1e-6, 0, 0, 0, 0, 4e-6]))
    assert unsure.target_error([0, 0, 0]) == pytest.approx(2e-3)
    assert unsure.target_error([0, 1, 0]) == pytest.approx(math.sqrt(5e-6))
    assert unsure.to_dict()["kind"] == "known"
    json.dumps(unsure.to_dict(), allow_nan=False)
    refused("must be a Rigid", lambda: known(np.eye(3)))  # type: ignore[arg-type]
    refused("eigenvalue", lambda: known(frame, -np.eye(6)))
    refused("level is 2", lambda: exact.interval(2))


def test_with_and_without(tips: tuple[Floats, Floats]) -> None:
    """Error statistics before and after, over points and by axis."""
    predicted, rotations = tips
    rng = np.random.default_rng(3)
    truth = Rigid.from_rotation_vector([0.0, 0.005, 0.0], [0.002, 0.0, 0.0])
    measured = truth.inverse().apply(predicted + rotations @ [0.0, 0.0, 0.01])
    measured = measured + 2e-5 * rng.normal(size=measured.shape)
    found = fit_model(measured, predicted, rotations)
    both = with_and_without(found, measured, predicted, 0.641, rotations)
    before, after = both["unregistered"], both["registered"]
    np.testing.assert_array_equal(before.difference, predicted - measured)
    np.testing.assert_allclose(after.difference, -found.residual, atol=1e-15)
    assert after.rms == pytest.approx(found.rms)
    assert before.mean > 100 * after.mean
    for one in both.values():
        assert one.against == "measurement" and one.n == 20
        assert one.rms == pytest.approx(math.sqrt(np.mean(np.sum(one.difference**2, axis=1))))
        np.testing.assert_allclose(one.max_by_axis, np.abs(one.difference).max(axis=0))
        assert np.all(one.mean_by_axis <= one.max_by_axis)
    nominal = with_and_without(found, measured, predicted, 0.641, rotations, nominal=truth)
    assert after.mean < nominal["unregistered"].mean < before.mean
    refused("rotations of the tips", lambda: with_and_without(found, measured, predicted, 0.641))
    with pytest.raises(InputError, match="rotations has shape"):
        with_and_without(found, measured, predicted, 0.641, rotations[:3])
    with pytest.raises(InputError, match="both must be"):
        with_and_without(found, measured, predicted[:3], 0.641, rotations)


def test_points_without_a_prediction_are_left_out(tips: tuple[Floats, Floats]) -> None:
    predicted = tips[0].copy()
    predicted[4] = np.nan
    both = with_and_without(known(Rigid.identity()), tips[0], predicted, 0.641)
    assert both["registered"].n == 19 and both["registered"].mean == 0.0


def test_a_wrong_model_is_not_called_left_handed() -> None:
    """Tips on a dome flatter than the model's error: its mirror image fits better, not clearly."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.1, 0.1, (2, 300))
    dome = x**2 + y**2
    predicted = np.stack([x, y, dome], axis=-1)
    real = np.stack([x, y, -0.3 * dome], axis=-1)
    measured = any_frame(rng).apply(real + 2e-3 * rng.normal(size=real.shape))
    turned = Rotation.from_rotvec(np.stack([-y, x, 0 * x], axis=-1)).as_matrix()
    plain = fit_model(measured, predicted)
    assert fit_model(measured * [1, 1, -1], predicted).rms < 0.8 * plain.rms
    fit_model(measured, predicted, turned)
