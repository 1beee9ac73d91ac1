"""Bootstrap intervals, against a plain loop and against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from bowstring.calibration.bootstrap import Linear, bootstrap, refitted


@pytest.mark.parametrize(
    ("trials", "least", "most"),
    [(40, 0.85, 1.0), pytest.param(300, 0.90, 0.98, marks=pytest.mark.slow)],
)
def test_intervals_cover_the_mean_over_all_loads(trials: int, least: float, most: float) -> None:
    # each load has its own error, shared by its repeats: the resampled units are loads
    inside = narrow = 0
    loads, repeats = 30, 5
    unit = np.repeat(np.arange(loads), repeats)
    truth = np.sqrt(2.0 / np.pi)  # mean of |N(0, 1)|
    for seed in range(trials):
        rng = np.random.default_rng(seed)
        error = np.zeros((loads * repeats, 3))
        error[:, 0] = np.repeat(rng.normal(size=loads), repeats)
        low, high = bootstrap([error], unit, resamples=400)[0].mean
        inside += low <= truth <= high
        low, high = bootstrap([error], np.arange(len(error)), resamples=400)[0].mean
        narrow += low <= truth <= high
    assert (
        least <= inside / trials <= most
    )  # the percentile interval of 30 units is slightly too narrow
    assert narrow / trials < 0.75  # resampling rows would imply five times the data


def test_matrix_product_matches_the_loop() -> None:
    rng = np.random.default_rng(1)
    unit = np.array([0, 0, 1, 2, 2, 2, 3, 3])
    error = rng.normal(size=(8, 3))
    error[4] = np.nan
    found = bootstrap([error], unit, resamples=4000)[0]
    size = np.linalg.norm(error, axis=1)
    rows = [np.flatnonzero(unit == u) for u in range(4)]
    means, axes = [], []
    for _ in range(4000):
        drawn = np.concatenate([rows[u] for u in rng.integers(0, 4, 4)])
        means.append(np.nanmean(size[drawn]))
        axes.append(np.nanmean(np.abs(error[drawn]), axis=0))
    assert found.mean == pytest.approx(np.quantile(means, [0.025, 0.975]), rel=0.03)
    expected = np.quantile(axes, [0.025, 0.975], axis=0).T
    assert found.mean_by_axis == pytest.approx(expected, rel=0.05)
    assert found.rms[0] >= found.mean[0]


def test_models_share_reproducible_resamples() -> None:
    rng = np.random.default_rng(2)
    error = rng.normal(size=(20, 3))
    unit = np.arange(20)
    once, twice = bootstrap([error, 2.0 * error], unit)
    assert twice.means == pytest.approx(2.0 * once.means)
    assert once.means == pytest.approx(bootstrap([error], unit)[0].means, rel=1e-15)


def test_a_model_without_a_solution_has_no_interval() -> None:
    gap = np.full((5, 3), np.nan)
    good, none = bootstrap([np.ones((5, 3)), gap], np.arange(5))
    assert np.isnan(none.mean).all() and np.isnan(none.means).all()
    assert good.mean == pytest.approx([np.sqrt(3.0)] * 2)


def fitted(seed: int, rows: int = 24) -> tuple[np.ndarray, Linear, np.ndarray, float]:
    """Six linear parameters fitted to noise, and the mean error of the fit at new rows."""
    rng = np.random.default_rng(seed)
    jacobian = np.random.default_rng(7).normal(size=(rows, 3, 6))
    measured = rng.normal(size=(rows, 3))
    flat = jacobian.reshape(-1, 6)
    predicted = (flat @ np.linalg.lstsq(flat, measured.ravel(), rcond=None)[0]).reshape(rows, 3)
    residual = predicted - measured
    anew = np.linalg.norm(predicted - rng.normal(size=(400, rows, 3)), axis=2).mean()
    no_priors = np.zeros((0, 6)), np.zeros(0)
    linear = Linear(jacobian, residual, np.ones((rows, 3)), *no_priors)
    return residual, linear, np.arange(rows), float(anew)


@pytest.mark.parametrize(
    ("trials", "within", "least"),
    [(20, 0.05, 0.8), pytest.param(150, 0.02, 0.87, marks=pytest.mark.slow)],
)
def test_expected_error_of_a_fit_is_its_error_at_new_rows(
    trials: int, within: float, least: float
) -> None:
    held, honest = 0, 0
    means, seen, real = [], [], []
    for seed in range(trials):
        residual, linear, unit, anew = fitted(seed)
        found = refitted(residual, linear, unit, resamples=400)
        assert found is not None
        means.append(found.mean)
        seen.append(np.linalg.norm(residual, axis=1).mean())
        real.append(anew)
        low, high = bootstrap([residual], unit, resamples=400)[0].mean
        held += low <= anew <= high
        honest += found.interval[0] <= anew <= found.interval[1]
    assert np.mean(seen) < 0.94 * np.mean(real)  # the error at the fitted rows is too small
    assert np.mean(means) == pytest.approx(np.mean(real), rel=within)
    assert honest / trials > least and held < honest


@pytest.mark.parametrize("has_priors", [False, True])
def test_one_step_is_a_fit_to_the_resample(has_priors: bool) -> None:
    """Priors are the same in every resample."""
    rng = np.random.default_rng(7)
    rows, parameters = 24, 6
    unit, flat = np.arange(rows), rng.normal(size=(3 * rows, parameters))
    own = np.diag(rng.uniform(3, 10, parameters))[: parameters if has_priors else 0]
    target = np.concatenate([rng.normal(size=3 * rows), own @ rng.normal(size=parameters)])
    both = np.concatenate([flat, own])
    at = both @ np.linalg.lstsq(both, target, rcond=None)[0] - target
    residual, by_priors = at[: 3 * rows].reshape(rows, 3), at[3 * rows :]
    linear = Linear(flat.reshape(rows, 3, -1), residual, np.ones((rows, 3)), own, by_priors)
    drawn_error, whole = [], []
    for _ in range(600):
        drawn = rng.integers(0, rows, rows)
        some = (3 * drawn[:, None] + np.arange(3)).ravel()
        force = np.concatenate([at[some], by_priors])
        change = np.linalg.lstsq(np.concatenate([flat[some], own]), -force, rcond=None)[0]
        error = np.linalg.norm(residual + (flat @ change).reshape(rows, 3), axis=1)
        drawn_error.append(error[drawn].mean())
        whole.append(error.mean())
    mean = np.linalg.norm(residual, axis=1).mean() + np.mean(whole) - np.mean(drawn_error)
    found = refitted(residual, linear, unit)
    assert found is not None and found.mean == pytest.approx(mean, rel=0.01)
    width = np.subtract(*np.quantile(drawn_error, [0.975, 0.025]))
    assert np.diff(found.interval)[0] == pytest.approx(width, rel=0.1)
    assert refitted(residual[:5], linear, unit[:5]) is None
