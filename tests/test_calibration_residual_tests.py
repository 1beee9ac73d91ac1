"""Residual tests classify residuals as noise when they are, and only then."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bowstring.calibration.residual_tests import noise_test
from bowstring.significance import NOISE

SIGMA = 2e-5
ROWS = 99


def made(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """White noise in three runs of 33 repeated cells."""
    rng = np.random.default_rng(seed)
    return (
        rng.normal(scale=SIGMA, size=(ROWS, 3)),
        np.repeat([0, 1, 2], 33),
        np.tile(np.arange(33), 3),
    )


@pytest.mark.parametrize(("draws", "most"), [(40, 2), pytest.param(300, 8, marks=pytest.mark.slow)])
def test_noise_is_recognised_at_the_significance_level(draws: int, most: int) -> None:
    alarms = 0
    for seed in range(draws):
        residual, run, cell = made(seed)
        alarms += not noise_test(residual, run, cell, 0, np.full(ROWS, SIGMA)).is_noise
    # two tests decide, each at NOISE; 300 draws of 1 % give 8, and 40 give 3, with a chance of 1 %
    assert alarms <= most
    assert pytest.approx(0.005) == NOISE


def test_a_trend_along_the_load_is_not_noise() -> None:
    residual, run, cell = made(1)
    course = SIGMA * np.sin(2.0 * np.pi * cell / 33.0)
    found = noise_test(residual + 1.5 * course[:, None], run, cell, 0)
    assert found.in_order and found.wrong_size and found.is_noise is False
    assert "are not noise" in found.text and "correlate" in found.text


def test_a_trend_without_repeats_or_sigma_is_detected() -> None:
    residual, run, _ = made(2)
    course = 2.0 * SIGMA * np.sin(np.arange(ROWS) / 5.0)
    found = noise_test(residual + course[:, None], run, np.arange(ROWS), 0)
    assert math.isnan(found.variance_p) and math.isnan(found.lack_of_fit_p)
    assert found.is_noise is False


def test_a_sigma_stated_too_small_is_distinguished_from_a_wrong_model() -> None:
    residual, run, cell = made(3)
    found = noise_test(residual, run, cell, 0, np.full(ROWS, SIGMA / 2))
    assert found.variance_p < NOISE and found.is_noise is True
    assert "stated uncertainty is too small" in found.text
    # without repeats there is no other explanation
    alone = noise_test(residual, run, np.arange(ROWS), 0, np.full(ROWS, SIGMA / 2))
    assert alone.is_noise is False


def test_a_shift_between_runs_is_detected_despite_its_scatter() -> None:
    residual, run, cell = made(4)
    found = noise_test(residual + 3.0 * SIGMA * (run[:, None] - 1), run, cell, 0)
    assert not found.wrong_size and found.in_order


def test_residual_sizes_match_the_data() -> None:
    residual, run, cell = made(5)
    found = noise_test(residual, run, cell, 8, np.full(ROWS, SIGMA))
    assert found.dof == 3 * ROWS - 8
    assert found.rms == pytest.approx(np.sqrt(np.sum(residual**2) / found.dof))
    assert found.scatter == pytest.approx(SIGMA, rel=0.15)
    far = residual.copy()
    far[7, 2] = 20 * SIGMA
    found = noise_test(far, run, np.arange(ROWS), 8, np.full(ROWS, SIGMA))
    assert (
        found.outliers == 1
        and "One row is more than five standard deviations away (line 8)." in (found.text)
    )


def test_one_mistyped_row_is_named_and_hides_nothing() -> None:
    sigma = np.full(ROWS, SIGMA)
    residual, run, cell = made(7)
    mistyped = residual.copy()
    mistyped[50, 0] += 1.0
    found = noise_test(mistyped, run, cell, 0, sigma, line=np.arange(ROWS) + 2)
    assert found.wrong_lines == (52,) and found.is_noise
    assert found.rms == pytest.approx(SIGMA, rel=0.1)
    assert found.scatter == pytest.approx(SIGMA, rel=0.15)
    assert "Line 52 errs by 1000 mm, and repeats of the same load do not" in found.text
    assert "too small" not in found.text
    # what a wrong model leaves is still detected besides
    course = 3.0 * SIGMA * np.sin(2.0 * np.pi * cell / 33.0)
    found = noise_test(mistyped + course[:, None], run, cell, 0, sigma)
    assert found.wrong_lines == (51,) and found.is_noise is False


def test_a_load_wrong_in_all_repeats_is_no_mistyped_row() -> None:
    residual, run, cell = made(8)
    residual = residual + 1e-3 * (cell == 12)[:, None]
    found = noise_test(residual, run, cell, 0, np.full(ROWS, SIGMA))
    assert found.wrong_lines == () and found.is_noise is False


def test_false_repeats_are_no_mistyped_rows() -> None:
    residual, run, cell = made(10)
    residual[::9] += 1e-3
    found = noise_test(residual, run, cell, 0, np.full(ROWS, SIGMA))
    assert found.wrong_lines == () and found.variance_p < NOISE


def test_too_few_rows_are_not_tested() -> None:
    residual, run, cell = (a[:4] for a in made(6))
    found = noise_test(residual, run, cell, 0)
    assert found.is_noise is None and "cannot be said" in found.text
    assert noise_test(residual, run, cell, 0, other_load=True).is_noise is False


def test_solver_residuals_of_noise_free_data_are_not_tested() -> None:
    _, run, cell = made(9)
    course = 1e-9 * np.sin(2.0 * np.pi * cell / 33.0)[:, None] * np.ones(3)
    found = noise_test(course, run, cell, 8)
    assert found.is_noise is None and "no measurement allows" in found.text
