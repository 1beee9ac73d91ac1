"""Sobol' indices and Morris' screening of functions whose indices are known."""

from __future__ import annotations

import pickle
import time
from typing import Any

import numpy as np
import pytest
import scipy.stats

import bowstring as bs
from bowstring.errors import NoSolutionError
from bowstring.uncertainty import (
    Distributions,
    MorrisDesign,
    Normal,
    SaltelliDesign,
    SobolIndices,
    SobolSample,
    Uniform,
    evaluate,
    morris_effects,
    read_distributions,
    sobol_indices,
)
from objects import refused

A, B = 7.0, 0.1


@pytest.fixture(scope="module")
def cube(robot: bs.Robot) -> Distributions:
    """Three independent numbers, uniform from -pi to pi."""
    return read_distributions({f"gravity.{i}": Uniform(-np.pi, np.pi) for i in range(3)}, robot)


def ishigami(x: Any) -> Any:
    return np.sin(x[:, 0]) + A * np.sin(x[:, 1]) ** 2 + B * x[:, 2] ** 4 * np.sin(x[:, 0])


def _ishigami_indices() -> tuple[Any, Any, Any]:
    """First order, total and second order of Ishigami and Homma's function."""
    p4, p8 = np.pi**4, np.pi**8
    v1, v2 = 0.5 * (1.0 + B * p4 / 5.0) ** 2, A**2 / 8.0
    v13 = B**2 * p8 * (1.0 / 18.0 - 1.0 / 50.0)
    first, pair = np.array([v1, v2, 0.0]), np.zeros((3, 3))
    pair[0, 2] = pair[2, 0] = v13
    variance = v1 + v2 + v13
    return first / variance, (first + pair.sum(axis=0)) / variance, pair / variance


def _inside(interval: Any, truth: Any) -> Any:
    return (interval.low <= truth) & (truth <= interval.high)


def test_indices_of_ishigami(cube: Distributions) -> None:
    pytest.importorskip("SALib")
    design = SaltelliDesign(cube, 4096, seed=1, second_order=True)
    found = sobol_indices(design, evaluate(ishigami, design))
    first, total, pairs = _ishigami_indices()
    off = ~np.eye(3, dtype=bool)
    assert found.second is not None
    for interval, truth, width in (
        (found.first, first, 0.12),
        (found.total, total, 0.09),
        (found.second, pairs, 0.15),
    ):
        of = off if truth.ndim == 2 else slice(None)
        assert _inside(interval, truth)[of].all()
        assert (interval.high - interval.low)[of].max() < width
        np.testing.assert_allclose(interval.value[of], truth[of], atol=0.02)
    assert np.isnan(np.diag(found.second.value)).all()
    assert found.points == 4096 and found.share_without_result == 0.0


LINEAR = np.array([1.0, 2.0, 3.0, 0.0])


@pytest.fixture(scope="module")
def normals(robot: bs.Robot) -> Distributions:
    paths = ("gravity.0", "gravity.1", "tip_force.x", "segments.*.backbone.nu")
    return read_distributions({p: Normal(0.1, 0.02) for p in paths}, robot)


def test_indices_of_a_linear_model(normals: Distributions) -> None:
    design = SaltelliDesign(normals, 2048, seed=3)
    truth = LINEAR**2 / (LINEAR**2).sum()
    found = sobol_indices(design, evaluate(lambda x: x @ LINEAR, design))
    assert found.second is None and found.factors == ("gravity.x", "gravity.y", "tip_force.x", "nu")
    for interval in (found.first, found.total):
        assert _inside(interval, truth).all()
        assert (interval.high - interval.low).max() < 0.1
        np.testing.assert_allclose(interval.value, truth, atol=0.005)
    assert found.total.high[3] == 0.0  # a factor without effect


@pytest.mark.slow
def test_intervals_cover(cube: Distributions) -> None:
    """Intervals of 95 % contain the truth in at least 93 % of 300 scramblings."""
    first, total, _ = _ishigami_indices()
    inside = []
    for seed in range(300):
        design = SaltelliDesign(cube, 256, seed=seed)
        found = sobol_indices(design, evaluate(ishigami, design), resamples=400, seed=seed)
        inside.append([*_inside(found.first, first), *_inside(found.total, total)])
    assert (np.mean(inside, axis=0) > 0.93).all()


def test_a_correlated_set_is_one_factor(robot: bs.Robot) -> None:
    """Index of a group: variance of the sum of its two correlated numbers."""
    covariance = np.array([[1.0, 0.8], [0.8, 1.0]])
    calibration = {
        "paths": ["gravity.0", "gravity.1"], "mean": [0.0, 0.0], "covariance": covariance.tolist()
    }  # fmt: skip
    joint = read_distributions({"tip_force.x": Normal(0.0, 1.0), "calibration": calibration}, robot)
    design = SaltelliDesign(joint, 1024, seed=1)
    assert len(design) == 4 * 1024
    found = sobol_indices(design, evaluate(lambda x: x.sum(axis=1), design))
    assert found.factors == ("tip_force.x", "calibration")
    np.testing.assert_allclose(found.first.value, np.array([1.0, 3.6]) / 4.6, atol=0.005)
    np.testing.assert_allclose(found.total.value, np.array([1.0, 3.6]) / 4.6, atol=0.005)


def test_standard_errors_are_those_of_scipys_bootstrap(cube: Distributions) -> None:
    design = SaltelliDesign(cube, 128, seed=5)
    outputs = evaluate(ishigami, design)
    rows = outputs.reshape(128, 5).T
    scipys = scipy.stats.sobol_indices(
        func={"f_A": rows[:1], "f_B": rows[1:2], "f_AB": rows[2:, None]}, n=128
    )
    theirs = scipys.bootstrap(n_resamples=2000)
    found = sobol_indices(design, outputs, resamples=20_000, confidence=0.68269)
    for ours, value, other in (
        (found.first, scipys.first_order, theirs.first_order),
        (found.total, scipys.total_order, theirs.total_order),
    ):
        np.testing.assert_allclose(ours.value, value, atol=1e-12)
        half = 0.5 * (ours.high - ours.low)
        np.testing.assert_allclose(half, other.standard_error, rtol=0.1)


def test_several_outputs_are_each_alone(cube: Distributions) -> None:
    design = SaltelliDesign(cube, 256, seed=2)
    table = evaluate(lambda x: np.column_stack([ishigami(x), x[:, 0], 0.0 * x[:, 0] + 5.1]), design)
    both = sobol_indices(design, table)
    alone = sobol_indices(design, table[:, 0])
    np.testing.assert_allclose(both.first.value[0], alone.first.value, atol=1e-12)
    np.testing.assert_allclose(both.total.high[0], alone.total.high, atol=1e-12)
    np.testing.assert_allclose(both.first.value[1], [1.0, 0.0, 0.0], atol=0.02)
    assert np.isnan(both.first.value[2]).all() and np.isnan(both.total.low[2]).all()


def test_one_factor_explains_all(robot: bs.Robot) -> None:
    one = read_distributions({"gravity.2": Normal(0.0, 1.0)}, robot)
    design = SaltelliDesign(one, 256)
    found = sobol_indices(design, evaluate(lambda x: x[:, 0], design))
    assert found.first.value == pytest.approx([1.0], abs=0.01)
    assert found.total.value == pytest.approx([1.0], abs=0.01)


def test_indices_do_not_depend_on_the_unit(cube: Distributions) -> None:
    pytest.importorskip("SALib")
    design = SaltelliDesign(cube, 256, seed=2, second_order=True)
    outputs = evaluate(ishigami, design)
    one, other = (sobol_indices(design, y) for y in (outputs, 1e-12 * outputs + 1e-7))
    assert one.second is not None and other.second is not None
    np.testing.assert_allclose(other.first.high, one.first.high, atol=1e-6)
    np.testing.assert_allclose(other.second.value, one.second.value, atol=1e-6)


# -- samples without a result ---------------------------------------------------------------------


def test_points_without_a_result_are_left_out(cube: Distributions) -> None:
    """The indices are the estimators over the base points that have all their results."""
    design = SaltelliDesign(cube, 512, seed=1)
    outputs = evaluate(lambda x: np.where(x[:, 1] > 2.8, np.nan, ishigami(x)), design)
    found = sobol_indices(design, outputs)
    rows = outputs.reshape(512, 5)
    rows = rows[np.isfinite(rows).all(axis=1)].T
    a, b, ab = rows[0], rows[1], rows[2:]
    mean, variance = rows[:2].mean(), rows[:2].var()
    first = ((b - mean) * (ab - a)).mean(axis=1) / variance
    total = ((ab - a) ** 2).mean(axis=1) / (2.0 * variance)
    assert found.points == rows.shape[1] and 0.05 < found.share_without_result < 0.15
    assert found.share_without_result == 1.0 - rows.shape[1] / 512
    np.testing.assert_allclose(found.first.value, first, atol=1e-12)
    np.testing.assert_allclose(found.total.value, total, atol=1e-12)
    assert (found.first.low < first).all() and (first < found.first.high).all()


def test_too_few_results_are_no_indices(cube: Distributions) -> None:
    design = SaltelliDesign(cube, 512)
    outputs = evaluate(lambda x: np.where(x[:, 1] > -2.0, np.nan, ishigami(x)), design)
    with pytest.raises(NoSolutionError, match=r"only \d+ of 512 base points have a result in all"):
        sobol_indices(design, outputs)


# -- designs --------------------------------------------------------------------------------------


def test_the_rows_of_saltellis_design(cube: Distributions) -> None:
    design = SaltelliDesign(cube, 64, seed=4, second_order=True)
    rows = design.block(0, len(design)).reshape(64, 8, 3)
    a, b = rows[:, 0], rows[:, 1]
    for j in range(3):
        ab, ba = rows[:, 2 + j], rows[:, 5 + j]
        for i in range(3):
            np.testing.assert_array_equal(ab[:, i], (b if i == j else a)[:, i])
            np.testing.assert_array_equal(ba[:, i], (a if i == j else b)[:, i])
    np.testing.assert_array_equal(design.block(0, 512)[design.rows_of_sample], a)
    # one point in each of 64 strata, in every column of A and B
    cells = np.floor(64 * (np.hstack([a, b]) / np.pi + 1.0) / 2.0)
    np.testing.assert_array_equal(np.sort(cells, axis=0), np.repeat(np.arange(64)[:, None], 6, 1))


@pytest.mark.parametrize("kind", [SobolSample, SaltelliDesign, MorrisDesign])
def test_blocks_are_the_same_anywhere(cube: Distributions, kind: Any) -> None:
    if kind is MorrisDesign:
        pytest.importorskip("SALib")
    design = kind(cube, 32, 9)
    at_once = design.block(0, len(design))
    elsewhere = pickle.loads(pickle.dumps(kind(cube, 32, 9)))
    parts = [elsewhere.block(i, min(i + 7, len(design))) for i in range(0, len(design), 7)]
    np.testing.assert_array_equal(np.concatenate(parts[::-1][::-1]), at_once)
    assert not np.array_equal(kind(cube, 32, 8).block(0, len(design)), at_once)
    told: list[float] = []
    found = evaluate(ishigami, design, rows=7, progress=told.append)
    np.testing.assert_array_equal(found, ishigami(at_once))
    assert told == sorted(told) and told[-1] == 1.0


def test_a_beginning_of_a_design_is_a_smaller_one(cube: Distributions) -> None:
    large, small = (SaltelliDesign(cube, n, seed=7) for n in (256, 64))
    np.testing.assert_array_equal(large.block(0, len(small)), small.block(0, len(small)))


def test_bad_designs_and_outputs(cube: Distributions) -> None:
    design = SaltelliDesign(cube, 32)
    short = np.zeros(len(design) - 1)
    cases: list[tuple[Any, str]] = [
        (lambda: SobolSample(cube, 1000), "count is 1000, it must be a power of two"),
        (lambda: SaltelliDesign(cube, 2**40), "power of two from 2 to 2"),
        (lambda: SaltelliDesign(cube, 32, seed=-1), "seed is -1, it must be a whole number"),
        (lambda: SobolSample({"a": 1}, 32), "it must be Distributions"),  # type: ignore[arg-type]
        (lambda: sobol_indices(design, short), r"outputs has shape \(159,\), it must be \(160,\)"),
        (lambda: sobol_indices(design, ["a"] * 160), "it must be outputs of 160 rows"),
        (lambda: sobol_indices(design, np.ones(160), confidence=1.0), "confidence is 1.0, it must"),
        (lambda: evaluate(lambda x: 1.0, design), r"an array of shape \(\) for 160 samples"),
        (lambda: evaluate(lambda x: x[:5], design), r"shape \(5, 3\) for 160 samples, it must ret"),
    ]
    for make, message in cases:
        refused(message, make)


# -- Morris ---------------------------------------------------------------------------------------


def test_morris_ranks_the_factors(normals: Distributions) -> None:
    pytest.importorskip("SALib")
    design = MorrisDesign(normals, 12, seed=1)
    found = morris_effects(design, evaluate(lambda x: x @ LINEAR, design))
    # change over the middle 99 %: between the levels' quantiles, 2/3 of the range apart
    z = scipy.stats.norm.ppf(0.5 + 0.99 * (np.arange(4) / 3.0 - 0.5))
    effects = 1.5 * 0.02 * LINEAR * (z[2] - z[0])
    np.testing.assert_allclose(found.mu_star.value, effects, rtol=1e-9)
    assert found.factors[int(np.argmax(found.mu_star.value))] == "tip_force.x"
    assert len(design) == 12 * 5 and found.trajectories == 12


def test_morris_sees_interactions_and_groups(robot: bs.Robot) -> None:
    pytest.importorskip("SALib")
    calibration = {"paths": ["gravity.0", "gravity.1"], "mean": [0, 0], "covariance": np.eye(2)}
    given = {f"tip_force.{x}": Uniform(-1.0, 1.0) for x in "xyz"}
    joint = read_distributions({**given, "calibration": calibration}, robot)
    design = MorrisDesign(joint, 40, seed=2)

    def model(x: Any) -> Any:
        return x[:, 0] * x[:, 1] + 0.01 * x[:, 2] + 5.0 * (x[:, 3] + x[:, 4])

    outputs = evaluate(model, design)
    found = morris_effects(design, outputs)
    order = [found.factors[i] for i in np.argsort(-found.mu_star.value)]
    assert order[0] == "calibration" and order[-1] == "tip_force.z"
    assert (found.sigma[:2] > 0.3).all() and found.sigma[2] < 1e-9 and np.isnan(found.sigma[3])
    assert (found.mu_star.low <= found.mu_star.value).all()
    # a trajectory without a result is left out
    outputs[3] = np.nan
    less = morris_effects(design, np.column_stack([outputs, model(design.block(0, len(design)))]))
    assert less.trajectories.tolist() == [39, 40]
    assert less.share_without_result.tolist() == pytest.approx([1 / 40, 0.0])
    np.testing.assert_allclose(less.mu_star.value[1], found.mu_star.value)


# -- speed ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_eight_factors_take_little_time(robot: bs.Robot) -> None:
    paths = ("backbone.E", "backbone.diameter", "backbone.density", "length", "disks.mass",
             "disks.radius", "tendons.pitch_radius", "backbone.nu")  # fmt: skip
    joint = read_distributions({f"segments.*.{p}": {"normal": {"sd": "1 %"}} for p in paths}, robot)
    before = time.process_time()
    design = SaltelliDesign(joint, 2**14)
    assert len(design) == 163_840
    found: SobolIndices = sobol_indices(design, evaluate(lambda x: x @ np.ones(8), design))
    assert time.process_time() - before < 1.2
    assert np.isfinite(found.first.value).all()
