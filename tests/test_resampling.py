"""Bootstrap intervals: against a plain loop, and against the truth."""

from __future__ import annotations

import numpy as np
import pytest

from bowstring.resampling import bootstrap


def test_intervals_hold_the_mean_over_all_loads() -> None:
    # each load has an error of its own, shared by its repeats: units are loads
    inside = narrow = 0
    trials, loads, repeats = 300, 30, 5
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
    assert 0.90 <= inside / trials <= 0.98  # the percentile interval of 30 units is a little narrow
    assert narrow / trials < 0.75  # rows as units would feign five times the data


def test_the_product_of_matrices_is_the_loop() -> None:
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


def test_models_share_their_resamples_and_nothing_is_left_to_chance() -> None:
    rng = np.random.default_rng(2)
    error = rng.normal(size=(20, 3))
    unit = np.arange(20)
    once, twice = bootstrap([error, 2.0 * error], unit)
    assert twice.means == pytest.approx(2.0 * once.means)
    assert once.means == pytest.approx(bootstrap([error], unit)[0].means, rel=1e-15)


def test_a_model_without_an_answer_has_no_interval() -> None:
    gap = np.full((5, 3), np.nan)
    good, none = bootstrap([np.ones((5, 3)), gap], np.arange(5))
    assert np.isnan(none.mean).all() and np.isnan(none.means).all()
    assert good.mean == pytest.approx([np.sqrt(3.0)] * 2)
