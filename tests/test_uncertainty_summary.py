"""Mean, spread, quantiles and probability of an output, with intervals and text."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.stats

import bowstring as bs
from bowstring.errors import InputError, NoSolutionError
from bowstring.uncertainty import (
    Normal,
    SaltelliDesign,
    SobolIndices,
    Uniform,
    evaluate,
    read_distributions,
    sobol_indices,
    spread_text,
    summarise,
)
from objects import refused


def _linear(weights: Any, n: int = 8192) -> tuple[Any, SobolIndices, SaltelliDesign]:
    robot = bs.load_robot("amouri2019")
    joint = read_distributions(
        {
            "segments.*.backbone.E": Normal(35e9, 1.75e9),
            "segments.*.tendons.friction": Uniform(0.0, 0.2),
        },
        robot,
    )
    design = SaltelliDesign(joint, n, seed=1)
    outputs = evaluate(lambda x: 56.0 + ((x - joint.mean) / joint.sd) @ weights, design)
    return outputs, sobol_indices(design, outputs), design


@pytest.mark.slow
def test_intervals_cover() -> None:
    """Intervals of 95 % contain the truth in about 95 % of samples, of a skewed distribution."""
    truth = scipy.stats.gamma(3.0)
    rng = np.random.default_rng(0)
    inside: dict[Any, list[bool]] = {}
    for _ in range(1000):
        found = summarise(truth.rvs(400, random_state=rng), tolerance=2.0)
        assert found.probability is not None
        pairs = [
            ("mean", found.mean, truth.mean()),
            ("sd", found.sd, truth.std()),
            ("probability", found.probability, truth.cdf(2.0)),
            *((p, each, truth.ppf(p)) for p, each in found.quantiles.items()),
        ]
        for name, interval, value in pairs:
            inside.setdefault(name, []).append(interval.low <= value <= interval.high)
    for name, each in inside.items():
        assert 0.91 < np.mean(each) < 0.99, name


def test_statistics_of_a_normal_sample() -> None:
    values = scipy.stats.norm(10.0, 2.0).ppf((np.arange(4096) + 0.5) / 4096)
    found = summarise(values, tolerance=10.0)
    assert found.mean.value == pytest.approx(10.0) and found.sd.value == pytest.approx(
        2.0, rel=1e-3
    )
    assert found.mean.high - found.mean.value == pytest.approx(1.96 * 2.0 / 64.0, rel=1e-3)
    assert found.sd.high - found.sd.low == pytest.approx(
        2 * 1.96 * 2.0 / np.sqrt(2 * 4096), rel=0.02
    )
    for p, each in found.quantiles.items():
        exact = scipy.stats.norm(10.0, 2.0).ppf(p)
        assert each.low < exact < each.high and each.value == pytest.approx(exact, abs=0.01)
        error = 2 * 1.96 * np.sqrt(p * (1 - p) / 4096) / scipy.stats.norm(10, 2).pdf(exact)
        assert each.high - each.low == pytest.approx(error, rel=0.1)
    assert found.probability is not None and found.probability.value == 0.5


def test_a_sample_without_a_result_does_not_hold_the_tolerance() -> None:
    values = np.r_[np.full(60, 1.0), np.full(20, 3.0), np.full(20, np.nan)]
    found = summarise(values, tolerance=2.0)
    assert found.probability is not None and found.probability.value == 0.6
    assert 0.45 < found.probability.low < 0.6 < found.probability.high < 0.72
    assert found.count == 100 and found.share_without_result == pytest.approx(0.2)
    assert found.mean.value == pytest.approx(1.5)


def test_a_probability_of_one_has_an_interval() -> None:
    found = summarise(np.linspace(0.0, 1.0, 100), tolerance=2.0)
    assert found.probability is not None and found.probability.value == 1.0
    assert 0.95 < found.probability.low < 1.0 and found.probability.high == 1.0


def test_the_sentence_of_a_limit() -> None:
    outputs, indices, design = _linear(np.array([3.0, 1.9]))
    found = summarise(outputs[design.rows_of_sample])
    text = spread_text(found, indices, "N")
    assert text == "56 N (95 %: 49 to 63 N); E causes 71 % of that spread"
    outputs[: design.width] = np.nan
    text = spread_text(summarise(outputs[design.rows_of_sample]), None, "N")
    assert text == "56 N (95 %: 49 to 63 N); less than 1 % of the samples have no result"


def test_values_far_below_the_spread_keep_two_digits() -> None:
    said = spread_text(summarise(np.r_[np.linspace(0.47, 0.9, 900), np.full(100, 12.3)]), None, "N")
    assert said == "0.71 N (95 %: 0.48 to 12 N)"


def test_limits_beyond_the_loads_are_infinite() -> None:
    values = np.r_[np.linspace(50.0, 80.0, 900), np.full(100, np.inf)]
    found = summarise(values)
    assert np.isnan(found.mean.value) and found.quantiles[0.975].value == np.inf
    assert spread_text(found, None, "N") == "66.7 N (95 %: 50.8 N to beyond the range)"
    said = "66.7 N (95 %: 50.8 N to more than 80 N)"
    assert spread_text(found, None, "N", end=80.0) == said
    with pytest.raises(InputError, match="median of the outputs is infinite"):
        spread_text(summarise(np.full(50, np.inf)), None, "N")


def test_interactions_are_named() -> None:
    robot = bs.load_robot("amouri2019")
    joint = read_distributions({f"gravity.{i}": Uniform(-1.0, 1.0) for i in range(2)}, robot)
    design = SaltelliDesign(joint, 4096, seed=1)
    outputs = evaluate(lambda x: x[:, 0] * x[:, 1] + 0.3 * x[:, 0], design)
    text = spread_text(summarise(outputs), sobol_indices(design, outputs), "mm", 1e-3)
    share = 0.3**2 / 3 / (0.3**2 / 3 + 1 / 9)
    assert (
        f"gravity.x causes {100 * share:.0f} % of that spread, with its interactions 100 %" in text
    )


def test_bad_input() -> None:
    good = np.arange(100.0)
    with pytest.raises(NoSolutionError, match="only 3 of 100 samples have a result, at least 32"):
        summarise(np.where(good < 3, good, np.nan))
    for call, message in (
        (lambda: summarise(np.zeros((2, 50))), r"shape \(2, 50\), it must be \(n,\)"),
        (lambda: summarise(good, tolerance=np.nan), "tolerance is nan, it must be a finite number"),
        (lambda: summarise(good, quantiles=[0.0]), r"quantiles is \[0.0\], it must be"),
        (lambda: summarise(good, confidence=95), "confidence is 95, it must be a number from 0.5"),
    ):
        refused(message, call)
