"""Numbers as people read them."""

from __future__ import annotations

import math

import pytest

from bowstring import formatting


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.012345, "0.0123"), (12.345, "12.3"), (999.4, "999"), (999.6, "1000"), (123456.0, "123456")],
)
def test_significant_digits_without_exponent(value: float, text: str) -> None:
    assert formatting.significant(value) == text


@pytest.mark.parametrize(
    ("metres", "text"),
    [
        (0.0, "under 0.001 mm"),
        (2.27e-5, "0.023 mm"),
        (4.423e-3, "4.42 mm"),
        (1.2345, "1234 mm"),
        (math.nan, "no number"),
    ],
)
def test_lengths(metres: float, text: str) -> None:
    assert formatting.in_mm(metres) == text


def test_shares_ranges_and_lists() -> None:
    assert formatting.in_percent(0.00691) == "0.69 %"
    assert formatting.in_newtons(0.0, 57.3456) == "0 to 57.3 N"
    assert formatting.in_newtons(80.0, 80.0) == "80 N"
    assert formatting.listed(["a"]) == "a"
    assert formatting.listed(["a", "b", "c"]) == "a, b and c"


@pytest.mark.parametrize(
    ("value", "round_"), [(80.0, 80.0), (99.0, 80.0), (0.0089, 0.008), (1.3, 1.2), (1000.0, 1000.0)]
)
def test_the_round_number_below(value: float, round_: float) -> None:
    assert formatting.round_down(value) == round_


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (4.4228, "4.423"),
        (-1.5, "\N{MINUS SIGN}1.500"),
        (0.0002, "< 0.001"),
        (1e-9, "0.000"),
        (None, "\N{EN DASH}"),
        (math.inf, "\N{EN DASH}"),
    ],
)
def test_table_cells(value: float | None, text: str) -> None:
    assert formatting.number(value) == text


def test_changes_have_a_sign_unless_they_are_zero() -> None:
    assert formatting.signed(1.234) == "+1.23"
    assert formatting.signed(-1.234) == "\N{MINUS SIGN}1.23"
    assert formatting.signed(-0.001) == "0.00"


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.1, 2e-5, "0.100000 +- 0.000020"),
        (123.4, 23.0, "123 +- 23"),
        (34.9999, 0.00812, "34.9999 +- 0.0081"),
        (1.0, 0.0, "1 +- 0"),
        (2.5, 1e-12, "2.5 +- 1e-12"),
        (1e12, 3e10, "1e+12 +- 3e+10"),
    ],
)
def test_values_have_the_digits_of_their_errors(value: float, error: float, text: str) -> None:
    assert formatting.with_error(value, error) == text
