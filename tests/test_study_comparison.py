"""Constant curvature against physics, with means computed by other programs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bowstring.robot.reader import load_robot
from bowstring.study.comparison import Theory
from bowstring.study.study import Study
from stages import Stages

MM = 1e-3


@pytest.mark.parametrize(
    ("theory", "means"),
    [
        (
            "cosserat",
            {
                "cc_from_lengths": 0.227,
                "cc_from_force": 4.423,
                "cc_from_lengths_chord": 0.0,
                "cc_from_force_arm": 0.049,
            },
        ),
        (
            "kirchhoff",
            {
                "cc_from_lengths": 0.228,
                "cc_from_force": 4.417,
                "cc_from_lengths_chord": 0.0,
                "cc_from_force_arm": 0.022,
            },
        ),
    ],
)
def test_means_of_the_four_comparisons(theory: Theory, means: dict[str, float]) -> None:
    got = Stages(load_robot("amouri2019"), theory=theory).comparisons
    assert [c.name for c in got.values()] == list(means)
    for c in got.values():
        assert c.n == 17
        assert c.mean / MM == pytest.approx(means[c.name], abs=5e-3), c.name
    assert got["cc_from_lengths_chord"].mean / MM < 1e-3


def test_maxima_and_axes(paper: Study) -> None:
    force = paper.comparison("cc_from_force")
    assert force.maximum / MM == pytest.approx(12.4, abs=0.05)
    assert force.mean_by_axis / MM == pytest.approx([3.245, 0.0, 2.892], abs=5e-3)
    inextensible = Stages(paper.robot, theory="kirchhoff").comparisons["cc_from_force"]
    assert inextensible.mean_by_axis / MM == pytest.approx([3.261, 0.0, 2.860], abs=5e-3)
    assert paper.comparison("cc_from_lengths").maximum / MM == pytest.approx(0.67, abs=5e-3)
    assert 100 * force.mean / paper.length == pytest.approx(0.69, abs=5e-3)


def test_rms_is_over_points(paper: Study) -> None:
    for c in paper.comparisons:
        assert c.rms == pytest.approx(math.sqrt(np.mean(np.sum(c.difference**2, axis=1))))
        assert c.mean <= c.rms <= c.maximum
