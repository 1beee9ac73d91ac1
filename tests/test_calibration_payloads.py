"""Fits of the mass and the centre of mass of payloads, to synthetic tips."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, Fit, fit
from objects import refused

MASS, CENTRE = 0.05, (0.005, -0.010, 0.030)  # kg, m
NOISE = 2e-5  # m
BARE = bs.load_robot("amouri2019", {"gravity": "0 0 -9.81"})
TOOL = {"mass": "50 g", "centre": "5 -10 30 mm"}
ROBOT = BARE.with_({"payloads": [TOOL]})
GUESS = ROBOT.with_({"payloads.0.mass": "30 g"})
LOADS = np.linspace(0, 40, 8)
TENSIONS = np.concatenate([np.outer(LOADS, each) for each in np.eye(3)]) + np.array([2, 1, 3])


@cache
def exact_tips() -> Any:
    """Tips under the weight as a dead force at the centre of mass, not as a payload."""
    weight = bs.PointLoad(force=[0, 0, -9.81 * MASS], point=CENTRE)
    return bs.solve_batch(BARE, TENSIONS, load=bs.Load(point_loads=[weight])).tip_position


def synthetic(seed: int) -> Data:
    tips = exact_tips()
    noise = np.random.default_rng(seed).normal(0, NOISE, tips.shape)
    return Data(points=tips + noise, tensions=TENSIONS)


def fitted(seed: int, *names: str, robot: bs.Robot = GUESS, **others: Any) -> Fit:
    return fit(robot, synthetic(seed), list(names), **others)


def contains(found: Fit, name: str, value: float) -> bool:
    estimate = found[name]
    return bool(estimate.low <= value <= estimate.high)


def test_a_mass_synthetic() -> None:
    """Seen: 50.00 g with a standard error of 0.01 g, from 30 g."""
    found = fitted(0, "payloads.0.mass")
    assert found.converged and not found.not_identifiable
    mass = found["payloads.0.mass"]
    assert mass.unit == "g" and mass.start == pytest.approx(30)
    assert contains(found, "payloads.0.mass", 50.0)
    assert found.is_in_robot("payloads.0.mass") and not found.is_in_robot("base")
    assert mass.standard_error < 0.03
    assert found.noise == pytest.approx(NOISE, rel=0.3)
    assert found.robot.payloads[0].mass == pytest.approx(1e-3 * mass.value)
    # the stiffness makes up for a part of the weight
    both = fitted(0, "payloads.*.mass", "segments.0.backbone.E")
    assert contains(both, "payloads.*.mass", 50.0)
    assert contains(both, "segments.0.backbone.E", 35.0)
    assert both["payloads.*.mass"].standard_error > 3 * mass.standard_error


def test_a_mass_and_its_centre_synthetic() -> None:
    """Noise of a hundredth, as the centre along the axis needs precise tips."""
    tips = exact_tips()
    data = Data(points=tips + 0.01 * (synthetic(1).points - tips), tensions=TENSIONS)
    start = GUESS.with_({"payloads.0.centre": "0 0 10 mm"})
    found = fit(start, data, ["payloads.0.mass", "payloads.0.centre", "base.x"])
    assert found.converged
    assert contains(found, "payloads.0.mass", 1e3 * MASS)
    for axis, value in enumerate(CENTRE):
        assert contains(found, f"payloads.0.centre.{axis}", 1e3 * value)
        assert found[f"payloads.0.centre.{axis}"].unit == "mm"


def test_a_mass_under_displacements_synthetic() -> None:
    """Displacements count from the home pose, in which the payload already acts."""
    displaced = np.array([[0.02, -0.02, -0.012], [0.01, 0.005, -0.02], [-0.02, 0.02, -0.004]])
    solved = [bs.solve(ROBOT, load=bs.Load(displacements=row)) for row in displaced]
    tips = np.array([each.raise_for_status().tip.position for each in solved])
    data = Data(points=tips, displacements=displaced)
    found = fit(GUESS, data, ["payloads.0.mass"])
    # one element per module in a fit
    assert found["payloads.0.mass"].value == pytest.approx(50, rel=0.02)


@pytest.mark.slow
def test_intervals_of_a_mass_cover_the_truth_synthetic() -> None:
    """95 % intervals contain the truth in about 95 % of synthetic tables."""
    held, trials = np.zeros(2), 60
    for seed in range(trials):
        found = fitted(seed, "payloads.0.mass", "segments.0.backbone.E")
        held += [
            contains(found, "payloads.0.mass", 50.0),
            contains(found, "segments.0.backbone.E", 35.0),
        ]
    # 57 expected of each, standard deviation 1.7
    assert held.min() >= 51


@pytest.mark.parametrize(
    ("robot", "names", "options", "says"),
    [
        (
            GUESS.with_({"gravity": "0 0 0"}),
            ["payloads.0.mass"],
            {},
            "payloads.0.mass is not identifiable: amouri2019 has no gravity",
        ),
        (
            GUESS.with_({"payloads.0.mass": "0 g"}),
            ["payloads.0.centre"],
            {},
            "the payload has a mass of 0 kg, give it one to begin with",
        ),
        (GUESS, ["payloads.0.mass"], {"model": "arc"}, "constant curvature knows no weight"),
        (GUESS, ["centre.1"], {"model": "arc"}, "constant curvature knows no weight"),
        (GUESS, ["payloads.0.inertia.0"], {}, "does not act on a robot at rest"),
        (GUESS, ["payloads.1.mass"], {}, "there is no parameter 'payloads.1.mass'"),
        (GUESS, ["payloads.0.disk"], {}, "there is no parameter 'payloads.0.disk'"),
        (BARE, ["payloads.0.mass"], {}, "needs a payload, and amouri2019 has none"),
    ],
)
def test_what_cannot_be_identified_is_refused(
    robot: bs.Robot, names: list[str], options: dict[str, Any], says: str
) -> None:
    refused(says, lambda: fitted(0, *names, robot=robot, **options))


def test_a_mass_and_the_gravity_are_correlated_synthetic() -> None:
    light = {"segments.0.disks.mass": "0 g", "segments.0.backbone.density": "0 kg/m^3"}
    tips = bs.solve_batch(ROBOT.with_(light), TENSIONS).tip_position
    data = Data(points=tips, tensions=TENSIONS)
    found = fit(GUESS.with_(light), data, ["payloads.0.mass", "gravity.2"])
    assert found.not_identifiable == (("payloads.0.mass", "gravity.2"),)
