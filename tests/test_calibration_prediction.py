"""Intervals of predicted tips: coverage of synthetic tables, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring.calibration import Data, Fit, fit, predict_with_interval
from bowstring.calibration.bootstrap import left_out
from bowstring.errors import InputError
from objects import refused

ROBOT = bs.load_robot("amouri2019")
E = "segments.0.backbone.E"
Floats = NDArray[np.float64]


def table(seed: int, count: int, noise: float, most: float = 40.0) -> Data:
    """Synthetic tips of the robot of the file under random tensions."""
    rng = np.random.default_rng(seed)
    tensions = rng.uniform(0.0, most, (count, 3))
    tips = bs.solve_batch(ROBOT, tensions).tip_position
    return Data(points=tips + rng.normal(0.0, noise, tips.shape), tensions=tensions)


def of(seed: int, count: int, most: float) -> Fit:
    return fit(ROBOT, table(seed, count, 5e-4, most), [E, "base", "tool.z"], loss="linear")


def test_intervals_hold_95_percent_where_the_parameters_hardly_count() -> None:
    predicted = predict_with_interval(of(1, 60, 40.0), other := table(2, 400, 5e-4))
    assert 0.92 < predicted.coverage(other.points) < 0.97
    assert predicted.scatter == pytest.approx(5e-4, rel=0.3)
    low, high = predicted.interval
    assert predicted.half_width == pytest.approx(float(np.median(high - low)) / 2)


def test_intervals_hold_95_percent_where_the_parameters_count_most() -> None:
    """Twelve rows of small bends say little of large ones."""
    inside, alone, factor = [], [], 0.0
    for seed in range(40):
        other = table(1000 + seed, 50, 5e-4, 60.0)
        predicted = predict_with_interval(of(seed, 12, 15.0), other)
        inside.append(predicted.coverage(other.points))
        without = np.abs(other.points - predicted.point) < 1.96 * predicted.scatter
        alone.append(without.mean())
        factor = max(factor, float(np.median(predicted.by_parameters / predicted.scatter)))
    assert 0.89 < np.mean(inside) < 0.985
    assert np.mean(alone) < 0.8 and factor > 1.5  # the scatter alone is too little


@pytest.mark.slow
def test_the_standard_deviation_by_parameters_is_that_of_repeated_fits() -> None:
    other = table(0, 6, 0.0, 60.0)
    found = [of(seed, 60, 15.0) for seed in range(60)]
    spread = np.std([each.predict(other) for each in found], axis=0)
    stated = np.mean([predict_with_interval(each, other).by_parameters for each in found], axis=0)
    assert np.median(stated / spread) == pytest.approx(1.0, abs=0.2)


def recording(seed: int, robot: bs.Robot, count: int = 120) -> Data:
    """Synthetic tips along slow random tensions: neighbouring rows are alike."""
    rng = np.random.default_rng(seed)
    knots = rng.uniform(0.0, 40.0, (count // 15 + 1, 3))
    at = np.linspace(0.0, len(knots) - 1.0, count)
    tensions = np.stack([np.interp(at, np.arange(len(knots)), each) for each in knots.T], axis=1)
    tips = bs.solve_batch(robot, tensions).tip_position
    return Data(points=tips + rng.normal(0.0, 2e-4, tips.shape), tensions=tensions)


def test_the_misfit_is_that_of_left_out_blocks_where_residuals_depend_synthetic() -> None:
    """Weight and a stiffer direction are missing in the model; other recordings, synthetic."""
    heavy = ROBOT.with_({"gravity": [3.0, 2.0, -9.81], "segments.0.tendons.first_angle": 0.05})
    inside, alone = [], []
    for seed in range(8):
        found = fit(ROBOT, recording(seed, heavy), [E, "base"], loss="linear")
        other = recording(100 + seed, heavy)
        predicted = predict_with_interval(found, other)
        assert found.autocorrelation > 0.5 and predicted.quantile == pytest.approx(2.776, abs=1e-3)
        inside.append(predicted.coverage(other.points))
        rows = predict_with_interval(found, other, errors=found.residuals)
        alone.append(rows.coverage(other.points))
    assert 0.93 < np.mean(inside) < 0.995
    assert np.mean(alone) < np.mean(inside) - 0.02


def test_left_out_blocks_are_those_of_fits_without_them() -> None:
    """One Newton step against a fit to the other rows."""
    heavy = ROBOT.with_({"gravity": [3.0, 2.0, -9.81]})
    data = recording(3, heavy)
    found = fit(ROBOT, data, [E, "base"], loss="linear")
    block = found.linear.block
    assert block is not None and np.bincount(block).tolist() == [24] * 5
    errors = left_out(found.linear, found.residuals)
    for part in range(5):
        others = fit(ROBOT, data, [E, "base"], loss="linear", rows=block != part)
        alone = others.residuals[block == part]
        assert np.abs(errors[block == part] - alone).max() < 0.05 * np.abs(alone).max()


def test_no_block_has_the_loads_of_another_where_they_repeat_synthetic() -> None:
    """The same recording three times: its loads are left out with all their rows."""
    heavy = ROBOT.with_({"gravity": [3.0, 2.0, -9.81]})
    once = recording(5, heavy, 60)
    rng = np.random.default_rng(6)
    points = np.tile(once.points, (3, 1)) + rng.normal(0.0, 1e-4, (180, 3))
    data = Data(points, np.tile(np.asarray(once.tensions), (3, 1)))
    block = fit(ROBOT, data, [E, "base"], loss="linear").linear.block
    assert block is not None and block.max() == 4
    assert (block.reshape(3, 60) == block[:60]).all()


def test_errors_of_left_out_rows_may_give_the_scatter() -> None:
    found, other = of(1, 30, 40.0), table(2, 5, 5e-4)
    errors = np.full((20, 3), [1e-3, 2e-3, 3e-3])
    errors[4] = np.nan
    predicted = predict_with_interval(found, other, errors=errors)
    assert predicted.scatter == pytest.approx([1e-3, 2e-3, 3e-3])
    for bad, what in (
        (np.zeros(3), "has shape"),
        (np.full((4, 3), np.nan), "0 rows say"),
        ([[0.0, 0, 1]], "1 rows say"),
        ("x", "must be numbers"),
    ):
        with pytest.raises(InputError, match=what):
            predict_with_interval(found, other, errors=bad)


def test_tips_of_other_rows_are_refused() -> None:
    predicted = predict_with_interval(of(1, 30, 40.0), other := table(2, 5, 5e-4))
    refused(r"must have \(5, 3\)", lambda: predicted.coverage(other.points[:3]))


def test_a_parameter_that_is_not_identifiable_has_no_interval() -> None:
    data = table(1, 30, 5e-4)
    still = Data(points=data.points, tensions=np.ones_like(data.tensions))
    found = fit(ROBOT, still, [E, "base"], loss="linear")
    assert not np.isfinite(found.standard_errors).all()
    with pytest.raises(InputError, match="is not identifiable, so that no prediction"):
        predict_with_interval(found, data)
