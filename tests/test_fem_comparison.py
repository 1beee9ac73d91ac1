"""Finite elements compared with the rod, where hardly anything is loaded."""

from __future__ import annotations

import numpy as np
import pytest

from bowstring.fem import sweep
from bowstring.fem.comparison import RodComparison, compare_with_rod
from fem_robots import COARSE, needs_ccx, small_robot


def beside(
    middle: list[list[float]], rod: list[list[float]], edge: list[list[float]]
) -> RodComparison:
    steps = len(middle)
    nothing = np.zeros((steps, 3)), np.zeros(steps)
    return RodComparison(*nothing, *(np.array(v) for v in (middle, rod, edge)))


def test_a_module_without_load_has_no_concentration() -> None:
    """Two segments with only the inner one loaded: values in the outer one are rounding."""
    found = beside([[50e6, 20.0]], [[49e6, 0.0]], [[60e6, 500.0]])
    np.testing.assert_allclose(found.stress_ratio, [50 / 49])
    np.testing.assert_allclose(found.concentration, [1.2])


def test_an_unloaded_state_is_not_compared() -> None:
    found = beside([[50e6], [30.0]], [[50e6], [0.0]], [[60e6], [90.0]])
    np.testing.assert_array_equal(np.isnan(found.stress_ratio), [False, True])
    np.testing.assert_array_equal(np.isnan(found.concentration), [False, True])


def test_where_the_rod_has_no_equilibrium_there_is_no_ratio() -> None:
    found = beside([[50e6]], [[np.nan]], [[60e6]])
    assert np.isnan(found.stress_ratio).all()
    np.testing.assert_allclose(found.concentration, [1.2])


@needs_ccx
@pytest.mark.usefixtures("own_cache")
def test_tension_put_on_and_taken_off() -> None:
    run = sweep(small_robot(), [[20.0, 0, 0], [0, 0, 0]], settings=COARSE).raise_for_status()
    found = compare_with_rod(run)
    assert found.stress_ratio[0] == pytest.approx(1.0, abs=0.1)
    assert found.concentration[0] > 0.7  # 4 bricks around have too low stress at their nodes
    assert np.isnan([found.stress_ratio[1], found.concentration[1]]).all()
    np.testing.assert_allclose(run.tip_position[1], [0.0, 0.0, 0.140], atol=1e-8)
