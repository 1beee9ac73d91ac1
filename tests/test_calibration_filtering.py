"""Prediction of the next row from the measured tips before it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, SlowBias, filtered, fit, fit_slow_bias
from objects import refused

ROBOT = bs.load_robot("amouri2019")
SPREAD, DURATION, NOISE = 3e-3, 20.0, 5e-4


def bench(count, seed, *, time=True):
    """Synthetic rows with a slow bias of the tip."""
    rng = np.random.default_rng(seed)
    tensions = np.abs(rng.normal(0, 15, (count, 3)).cumsum(axis=0)) % 40
    clock = np.cumsum(rng.uniform(0.5, 2.0, count))
    bias = np.zeros((count, 3))
    bias[0] = rng.normal(0, SPREAD, 3)
    for k in range(1, count):
        share = np.exp(-(clock[k] - clock[k - 1]) / DURATION)
        bias[k] = share * bias[k - 1] + rng.normal(0, SPREAD * np.sqrt(1 - share**2), 3)
    tips = bs.solve_batch(ROBOT, tensions).tip_position + bias
    tips = tips + rng.normal(0, NOISE, tips.shape)
    return Data(points=tips, tensions=tensions, time=clock if time else None)


@pytest.fixture(scope="module")
def fitted():
    data = bench(1500, 1)
    found = fit(ROBOT, data, ["segments.0.backbone.E"], loss="linear")
    return found, fit_slow_bias(found, data)


def test_the_bias_is_found(fitted):
    _, bias = fitted
    assert bias.timed
    assert bias.spread == pytest.approx(SPREAD, rel=0.2)
    assert bias.duration == pytest.approx(DURATION, rel=0.35)
    assert bias.noise == pytest.approx(NOISE, rel=0.1)


def test_other_rows_are_predicted_with_their_uncertainty(fitted):
    found, bias = fitted
    data = bench(1500, 2)
    ahead = filtered(found, data, bias)
    assert ahead.score.rmse < 0.6 * ahead.open_loop_score.rmse
    off = np.abs(np.asarray(data.points) - ahead.point)
    inside = (off < 1.96 * ahead.standard_deviation[:, None]).mean()
    assert 0.93 < inside < 0.97

    # the filter is the best of its kind: with another duration the likelihood is less
    def log_likelihood(bias):
        each = filtered(found, data, bias)
        off = (np.asarray(data.points) - each.point) / each.standard_deviation[:, None]
        return -0.5 * (off**2).sum() - 3.0 * np.log(each.standard_deviation).sum()

    best = log_likelihood(replace(bias, spread=SPREAD, duration=DURATION, noise=NOISE))
    for other in ({"duration": 4.0}, {"noise": 2e-3}, {"spread": 1e-3}):
        known = replace(bias, spread=SPREAD, duration=DURATION, noise=NOISE)
        assert log_likelihood(replace(known, **other)) < best - 10


def test_a_prediction_knows_only_the_rows_before(fitted):
    found, bias = fitted
    data = bench(40, 3)
    whole = filtered(found, data, bias)
    points = np.array(data.points)
    points[20:] += 1.0
    later = filtered(found, replace(data, points=points), bias)
    assert later.point[:21] == pytest.approx(whole.point[:21], abs=1e-15)
    assert np.linalg.norm(later.point[21] - whole.point[21]) > 0.1


def test_without_measured_tips_it_returns_to_the_model(fitted):
    found, bias = fitted
    data = bench(120, 4)
    points = np.array(data.points)
    points[20:119] = np.nan
    ahead = filtered(found, replace(data, points=points), bias)
    assert ahead.standard_deviation[20] < 0.5 * ahead.standard_deviation[118]
    assert ahead.standard_deviation[118] == pytest.approx(np.hypot(SPREAD, NOISE), rel=0.25)
    assert np.linalg.norm(ahead.point[118] - ahead.open_loop[118]) < 0.1 * SPREAD


def test_a_recording_starts_without_a_bias(fitted):
    found, bias = fitted
    data = bench(40, 5)
    ahead = filtered(found, replace(data, recording=np.repeat([0, 1], 20)), bias)
    assert ahead.point[20] == pytest.approx(ahead.open_loop[20], abs=1e-15)
    assert np.linalg.norm(ahead.point[19] - ahead.open_loop[19]) > 1e-4


def test_bad_input_is_named(fitted):
    found, bias = fitted
    data = bench(40, 6)
    refused("rows have none", lambda: filtered(found, replace(data, time=None), bias))
    shuffled = np.array(data.time)
    shuffled[[5, 6]] = shuffled[[6, 5]]
    refused("row 7 is not later", lambda: filtered(found, replace(data, time=shuffled), bias))
    few = bench(12, 7)
    small = fit(ROBOT, few, ["base.x"], loss="linear")
    refused("12 fitted rows are too few", lambda: fit_slow_bias(small, few))


def test_without_times_the_duration_is_in_rows():
    data = bench(400, 8, time=False)
    found = fit(ROBOT, data, ["segments.0.backbone.E"], loss="linear")
    bias = fit_slow_bias(found, data)
    assert not bias.timed and 5 < bias.duration < 50
    assert isinstance(bias, SlowBias)
