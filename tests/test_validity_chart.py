"""Validity chart: closed forms, collapse of random robots onto it, its own statements."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from campaign.validity_chart import (
    KINDS,
    draw,
    first_crossing,
    make_robot,
    printed_errors,
    solved_errors,
    trials,
)

import bowstring as bs
from bowstring.errors import InputError
from bowstring.study.comparison import CORRECTED
from bowstring.validity.chart import force_limit, lengths_limit
from bowstring.validity.chart_errors import MODELS, chart_errors, largest_bend
from bowstring.validity.chart_groups import Groups
from bowstring.viz.style import figure_style

ROBOT = bs.load_robot("amouri2019")


def check_collapse(count: int, seed: int) -> None:
    """The figures that docs/theory/validity.md states."""
    found = [each for four in trials(count, seed) for each in four]
    for model in MODELS:
        those = [t for t in found if t.limit.name == model]
        error = np.array([t.error for t in those if t.has_limit])
        corrected = model in CORRECTED.values()  # their errors are small, and fewer have a limit
        assert len(error) > (0.2 if corrected else 0.3) * count
        assert np.median(error) < 0.03
        assert np.quantile(error, 0.95) < (0.2 if corrected else 0.1)
        reliable = np.array([t.error for t in those if t.has_limit and t.limit.reliable])
        assert len(reliable) > 0.65 * len(error)
        assert np.quantile(reliable, 0.95) < (0.05 if corrected else 0.03)
        assert np.mean(reliable < 0.1) > 0.998
        assert np.mean([t.within for t in those]) > 0.99


def test_random_robots_collapse() -> None:
    check_collapse(80, 5)


@pytest.mark.slow
def test_many_random_robots_collapse() -> None:
    """The first 750 of the 5 000 of the docs: one reliable limit that is 10 % off fails."""
    check_collapse(750, 1)


def test_study_robot() -> None:
    chart = bs.validity_chart(ROBOT)
    force = chart["cc_from_force"]
    assert force.tension is not None and force.tension_interval is not None
    bends = np.linspace(0.0, 1.385, 401)
    groups = Groups.of(ROBOT)
    error = solved_errors(ROBOT, groups, bends)[MODELS.index("cc_from_force")]
    solved = first_crossing(bends, error, 0.01) * 80.0 / 1.385
    assert solved == pytest.approx(56.1, abs=0.1)
    low, high = force.tension_interval
    assert low < 56.1 < high
    assert high - low < 0.5
    assert force.reliable
    assert chart["cc_from_lengths"].throughout


def test_closed_form_without_loads() -> None:
    """One module as a column: no clamps, no extension; the arm law is its series."""
    groups = Groups(disks=9, pitch=0.045)
    errors = chart_errors(groups)
    phi = errors.linear_bend
    half = 0.5 * errors.bend / 9
    k = np.sqrt(phi / 0.045)
    assert np.allclose(half, k * 0.045 * np.tan(k / 18) * np.cos(half), atol=1e-9)
    series = phi + phi**2 / 81 * (1 / (12 * 0.045) - phi / 8)
    small = phi < 0.5
    assert np.allclose(errors.bend[small], series[small], atol=2e-4)
    # from lengths the tip stays on its circle, a^2/24 behind
    assert np.allclose(errors.error[0], errors.bend**2 / 81 / 24, rtol=0.02, atol=1e-9)


def test_groups_of_a_robot_are_those_it_was_made_of() -> None:
    rng = np.random.default_rng(2)
    for kind in KINDS:
        groups, _ = draw(rng, kind)
        robot = make_robot(groups)
        stiffness, length = float(robot.bending_stiffness[0]), robot.length
        force = np.array(groups.tip_force) * stiffness / length**2
        found = Groups.of(robot, tip_force=force)
        for name in Groups.__dataclass_fields__:
            assert np.allclose(getattr(found, name), getattr(groups, name), atol=1e-12), name


def test_tendon_turns_the_loads() -> None:
    """Load and tendon turned by the same angle give the same limits."""
    robot = ROBOT.with_({"gravity": [0.0, 0.0, 9.81]})
    turn = math.radians(120.0)
    first = bs.validity_chart(robot, 0.05, tip_force=[0.03, 0.02, 0.1])
    x, y = (
        0.03 * math.cos(turn) - 0.02 * math.sin(turn),
        0.03 * math.sin(turn) + 0.02 * math.cos(turn),
    )
    second = bs.validity_chart(robot, 0.05, tendon=1, tip_force=[x, y, 0.1])
    for a, b in zip(first.limits, second.limits, strict=True):
        assert a.linear_bend == pytest.approx(b.linear_bend)
        assert 0.0 < a.low <= a.linear_bend <= a.high


def test_load_beyond_the_tolerance_leaves_no_range() -> None:
    limit = bs.validity_chart(ROBOT, tip_force=[0.0, 0.2, 0.0])["cc_from_force"]
    assert limit.linear_bend == limit.tension == 0.0
    assert "does not hold" in limit.text


def test_touching_error_gives_an_interval() -> None:
    """Clamps and straight spans: the hump of the error touches the tolerance."""
    groups = Groups(disks=9, pitch=0.045, clamped=0.05)
    error = chart_errors(groups).error[1]
    hump = error[: np.argmax(np.diff(error) < 0) + 1].max()
    limit = bs.validity_chart(groups, float(hump) * 1.001)["cc_from_force"]
    assert limit.low < 0.8 * limit.linear_bend
    assert not limit.reliable
    assert "interval" in limit.text


def test_outside_the_tested_ranges_it_says_so() -> None:
    few = ROBOT.with_({"segments.0.disks.count": 2})
    limit = bs.validity_chart(few)["cc_from_force"]
    assert not limit.reliable
    assert "number of disks is 2 (tested 3 to 20)" in limit.text
    assert "the tolerance is 20 %" in bs.validity_chart(ROBOT, 0.2)["cc_from_force"].text
    assert largest_bend(Groups(disks=3, pitch=0.01)) == pytest.approx(0.36)


def test_bad_input() -> None:
    with pytest.raises(InputError, match="one segment"):
        bs.validity_chart(bs.load_robot("rao2021"))
    uneven = ROBOT.with_({"segments.0.disks.positions": ["100 mm", "300 mm", "641 mm"]})
    with pytest.raises(InputError, match="equal spacing"):
        bs.validity_chart(uneven)
    with pytest.raises(InputError, match="tolerance"):
        bs.validity_chart(ROBOT, 0.0)
    with pytest.raises(InputError, match="tip force number"):
        bs.validity_chart(Groups(9, 0.045), tip_force=[1, 0, 0])
    with pytest.raises(InputError, match="no robot was given"):
        bs.validity_chart()["cc_from_force"]


def test_a_tolerance_is_a_number_or_in_percent() -> None:
    own = bs.validity_chart(ROBOT, 0.02)["cc_from_force"]
    for text in ("2 %", "2%", "0.02"):
        chart = bs.validity_chart(ROBOT, tolerance=text)
        assert chart.tolerance == 0.02
        assert chart["cc_from_force"] == own


FUNCTIONS: dict[str, Callable[[Any], object]] = {
    "validity_chart": lambda it: bs.validity_chart(ROBOT, it),
    "chart without a robot": lambda it: bs.validity_chart(tolerance=it),
    "validity_map": lambda it: bs.validity_map(ROBOT, ["tension=0:8 N:2"], tolerance=it),
    "validity_grid": lambda it: bs.validity_grid(ROBOT, ["tension=0:8 N:2"], tolerance=it),
    "workspace_map": lambda it: bs.workspace_map(ROBOT, 8.0, poses=2, tolerance=it),
    "validity_spread": lambda it: bs.validity_spread(ROBOT, {"E": "35 +- 1 GPa"}, tolerance=it),
    "run_study": lambda it: bs.run_study(ROBOT, tolerance=it),
}


@pytest.mark.parametrize("function", FUNCTIONS)
@pytest.mark.parametrize("value", [0.0, 1, 1.5, np.float64(2.0), "100 %", "2 N", "", True, None])
def test_a_tolerance_beyond_the_length_is_refused(function: str, value: object) -> None:
    with pytest.raises(InputError, match=r"^tolerance is .*, it must be [^;:]*$"):
        FUNCTIONS[function](value)


@pytest.mark.parametrize("function", ["validity_map", "validity_grid", "workspace_map"])
def test_maps_take_a_tolerance_in_percent(function: str) -> None:
    found: Any = FUNCTIONS[function]("2 %")
    assert found.tolerance == 0.02


@pytest.mark.parametrize("function", [*FUNCTIONS][:5])
def test_a_tolerance_may_be_a_length(function: str) -> None:
    if function == "chart without a robot":
        with pytest.raises(InputError, match='tolerance is "2 mm", it must be a share'):
            FUNCTIONS[function]("2 mm")
        return
    found: Any = FUNCTIONS[function]("2 mm")
    assert found.tolerance == pytest.approx(0.002 / 0.641, rel=1e-12)


@pytest.mark.parametrize("kind", ["plain", "friction"])
def test_printed_chart(kind: str) -> None:
    by_force, by_lengths = printed_errors(150, 3, kind)
    assert np.median(by_force) < 0.03
    assert np.quantile(by_force, 0.9) < 0.12
    assert np.median(by_lengths) < 0.12


def test_printed_limits_solve_their_equations() -> None:
    assert force_limit(0.02, 0.0, pitch=0.0) == pytest.approx(math.sqrt(2 * 0.02), rel=5e-3)
    a = lengths_limit(0.01, 0.2)
    assert (a**2 / 24) ** 2 + (a * 0.2 / 4) ** 2 == pytest.approx(1e-4)
    a = lengths_limit(0.01, 0.2, adds=True)
    assert a**2 / 24 + a * 0.2 / 4 == pytest.approx(0.01)
    assert lengths_limit(0.01, 0.0) == pytest.approx(math.sqrt(0.24))


def test_figure() -> None:
    chart = bs.validity_chart(ROBOT)
    with figure_style():
        figure = chart.figure()
    panels = figure.axes
    assert len(panels) == 3
    points = panels[0].containers
    assert len(points) == 1
    x, y = (float(v[0]) for v in points[0].lines[0].get_data())
    assert math.degrees(force_limit(x, 0.0)) == pytest.approx(y, rel=0.03)
    assert "B = 0.44" in chart.caption
    with figure_style():
        assert not bs.validity_chart().figure().axes[0].containers
