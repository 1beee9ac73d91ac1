"""Chi-square and F tests against printed tables."""

from __future__ import annotations

import math

import pytest

from bowstring import significance as s


def test_printed_tables() -> None:
    assert s.chi_square_p(3.841, 1) == pytest.approx(0.05, rel=1e-3)
    assert s.chi_square_p(18.307, 10) == pytest.approx(0.05, rel=1e-3)
    assert math.isnan(s.chi_square_p(1.0, 0))
    assert s.variance_ratio_p(3.326, 5, 10) == pytest.approx(0.05, rel=1e-3)
    assert s.variance_ratio_limit(0.05, 5, 10) == pytest.approx(3.326, rel=1e-3)


def test_f_test_of_a_useless_and_a_perfect_parameter() -> None:
    assert s.explained_p(1.0, 1.0, 2, 10) == 1.0
    assert s.explained_p(1.0, 0.0, 2, 10) < 1e-100
