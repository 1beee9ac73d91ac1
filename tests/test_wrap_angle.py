"""Friction of the tendons between drive and base hole."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit

MU, WRAP = 0.1, math.pi / 2
WITH_FRICTION = bs.load_robot("amouri2019", {"segments.0.tendons.friction": MU})
WRAPPED = WITH_FRICTION.with_({"segments.0.tendons.wrap_angle": "90 deg"})
LOST = math.exp(-MU * WRAP)


def test_a_wrap_lowers_the_tension_as_a_capstan():
    up = np.linspace(5.0, 40.0, 8)
    whole = np.concatenate((up, up[::-1]))[:, None] * [1.0, 0.0, 0.0]
    found = bs.sweep(WRAPPED, whole)
    assert found.converged.all()
    # once it slips, the robot has the tension on the other side of the wrap
    inner = np.concatenate((up * LOST, up[::-1] / LOST))[:, None] * [1.0, 0.0, 0.0]
    alone = bs.sweep(WITH_FRICTION, np.delete(inner, 8, axis=0))  # at the turning point it sticks
    assert found.tip_position[:8] == pytest.approx(alone.tip_position[:8], abs=1e-9)
    assert found.tip_position[8] == pytest.approx(found.tip_position[7], abs=1e-9)
    assert found.tip_position[-1] == pytest.approx(alone.tip_position[-1], abs=1e-9)
    assert found.span_tensions[3, 0, 0] == pytest.approx(alone.span_tensions[3, 0, 0])


def test_without_friction_a_wrap_has_no_effect():
    plain = bs.load_robot("amouri2019")
    wrapped = plain.with_({"segments.0.tendons.wrap_angle": "90 deg"})
    rows = [[30.0, 5.0, 0.0]]
    assert np.array_equal(bs.sweep(wrapped, rows).tip_position, bs.sweep(plain, rows).tip_position)
    assert not wrapped.has_memory


def test_the_lost_displacement_grows_with_the_tension():
    """At the motor the tendon stretches by more than behind the wrap."""
    give = 1e-4  # m/N
    robot = WRAPPED.with_({"segments.0.tendons.compliance": give})
    up = np.linspace(0.0, 0.02, 9)
    rows = np.concatenate((up, up[-2::-1]))[:, None] * [1.0, -0.5, -0.5]
    found = bs.sweep(robot, load=bs.Load(displacements=rows))
    assert found.converged.all()
    loading, unloading = found.tip_position[7], found.tip_position[9]
    behind = bs.sweep(
        robot.with_({"segments.0.tendons.wrap_angle": 0.0}), load=bs.Load(displacements=rows)
    )
    wide = np.linalg.norm(loading - unloading)
    narrow = np.linalg.norm(behind.tip_position[7] - behind.tip_position[9])
    assert wide > 3 * narrow
    drop = math.log(found.tensions[7, 0] / found.span_tensions[7, 0, 0])
    assert MU * WRAP < drop < MU * (WRAP + 0.5)


@pytest.mark.parametrize(("friction", "wrap"), [(0.01, "15 rad"), (0.05, "10 rad"), (0.1, "5 rad")])
def test_segments_bend_in_turn_behind_long_wraps(friction, wrap):
    """Tendons become slack, stick and reverse; block pivots cycle on such rows."""
    own = {"compliance": "0.1 mm/N", "friction": friction, "wrap_angle": wrap}
    fields = {f"segments.{i}.tendons.{name}": v for i in range(3) for name, v in own.items()}
    robot = bs.load_robot("crl-ftdcr-v4", fields)
    up = np.linspace(0.0, 1.0, 21)
    bend = 4e-3 * np.cos(np.radians(45.0 - 120.0 * np.arange(3)))
    cycle = np.concatenate((up, up[-2::-1]))[:, None] * bend
    rows = np.full((3 * len(cycle), 9), -5e-5)
    first, second, both = np.split(rows, 3)
    first[:, :3] += cycle
    second[:, 3:6] += cycle
    both[:, :6] += np.tile(cycle, 2)
    found = bs.sweep(robot, load=bs.Load(displacements=rows))
    assert found.converged.all()
    assert found.iterations.max() < 50


def test_fit_finds_the_wrap():
    rng = np.random.default_rng(4)
    t = np.linspace(0.0, 1.0, 80)
    size = 25 + 20 * np.sin(14 * t)
    towards = 3 * np.sin(5 * t)
    tensions = size[:, None] * np.maximum(np.cos(towards[:, None] - 2.0944 * np.arange(3)), 0.05)
    tips = bs.sweep(WRAPPED, tensions).tip_position + rng.normal(0, 1e-4, (80, 3))  # synthetic
    name = "segments.*.tendons.wrap_angle"
    found = fit(WITH_FRICTION, Data(points=tips, tensions=tensions), [name], loss="linear")
    assert found.converged
    estimate = found[name]
    assert abs(found.values[name] - WRAP) < 3.5 * estimate.standard_error * (
        found.values[name] / estimate.value
    )
