"""Robots on a base that moves and turns."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.dynamics.base_motion import BaseHistory

ROBOT = bs.load_robot("amouri2019")
MASS = 0.05
LIGHT = ROBOT.with_(
    {
        "segments.0.disks.mass": "0 g",
        "segments.0.backbone.density": "0 kg/m^3",
        "payloads": [{"mass": MASS}],
    }
)
ONE_DISK = LIGHT.with_({"segments.0.disks.count": 1})
TENSIONS = [40.0, 0.0, 10.0]
KEEP = bs.Integrator(spectral_radius=1.0)
TIMES = np.linspace(0.0, 1.0, 101)


def moved(robot: bs.Robot, base: bs.BaseMotion | None, tensions: Any, **others: Any) -> bs.Run:
    load = bs.Load(base=base, **others)
    return bs.simulate(robot, tensions, 1.0, load=load, integrator=KEEP).raise_for_status()


def test_a_constant_acceleration_is_a_gravity() -> None:
    acceleration = np.array([2.0, -1.0, 0.5])
    base = bs.BaseMotion(TIMES, 0.5 * TIMES[:, None] ** 2 * acceleration)
    steps = bs.Integrator(dt=1e-3, spectral_radius=1.0)
    run = bs.simulate(LIGHT, TENSIONS, 1.0, load=bs.Load(base=base), integrator=steps)
    # the only mass is at the tip, and the force on it begins at once
    start = bs.Start(bs.Load(tip_force=[0, 0, 0]))
    load = bs.Load(tip_force=-MASS * acceleration)
    same = bs.simulate(LIGHT, TENSIONS, 1.0, load=load, start=start, integrator=steps)
    assert np.ptp(run.tip_position, axis=0).max() > 5e-3
    assert np.abs(run.tip_position - same.tip_position).max() < 1e-10


def test_a_steady_motion_is_rest() -> None:
    base = bs.BaseMotion(TIMES, TIMES[:, None] * [0.3, -0.2, 1.0])
    run = moved(ROBOT, base, TENSIONS)
    assert np.ptp(run.tip_position, axis=0).max() < 1e-7
    # turning steadily about the axis of a straight robot
    base = bs.BaseMotion(TIMES, rotations=TIMES[:, None] * [0, 0, 5.0])
    run = moved(ROBOT, base, [0, 0, 0])
    assert np.ptp(run.tip_position, axis=0).max() < 1e-7


def test_a_mass_on_a_turning_beam() -> None:
    """Small deflection w of a mass on a massless beam whose base turns by theta about y:
    m w'' = -k w + m (theta'^2 w - theta'' L) and gravity in axes of the base."""
    amplitude, rate, g = 0.05, 9.0, 9.81
    theta = amplitude * (np.sin(rate * TIMES) - rate * TIMES * np.exp(-20 * TIMES**2))
    base = bs.BaseMotion(TIMES, rotations=theta[:, None] * [0, 1, 0])
    hanging = LIGHT.with_({"gravity": [0, 0, g]})
    steps = bs.Integrator(dt=2e-3, spectral_radius=1.0)
    run = bs.simulate(hanging, [0, 0, 0], 1.0, load=bs.Load(base=base), integrator=steps)
    length, bending = LIGHT.length, float(LIGHT.bending_stiffness[0])
    # stiffness of a beam in tension by the weight, at its end
    k = math.sqrt(MASS * g / bending)
    stiffness = MASS * g * k / (k * length - math.tanh(k * length))
    turn = np.array([base.accelerations([t], [0, 0, 0])[0] for t in TIMES])

    def slope(t: float, y: np.ndarray) -> list[float]:
        spin, rate_now = np.interp(t, TIMES, turn[:, 7]), np.interp(t, TIMES, turn[:, 4])
        angle = np.interp(t, TIMES, theta)
        # world gravity (0, 0, g) has the component -g sin(theta) along x of the base
        force = MASS * (rate_now**2 * y[0] - spin * length - g * math.sin(angle))
        return [y[1], (force - stiffness * y[0]) / MASS]

    exact = solve_ivp(slope, (0, 1), [0, 0], t_eval=run.time, rtol=1e-9, atol=1e-12).y[0]
    found = run.tip_position[:, 0]
    assert np.abs(exact).max() > 3e-3
    assert np.abs(found - exact).max() < 0.01 * np.abs(exact).max()


def test_a_tilted_base_ends_in_the_static_pose() -> None:
    """A quarter turn in a second under damping: the robot sags as statics say."""
    share = np.clip(TIMES / 0.9, 0, 1)
    angle = 0.5 * np.pi * share**3 * (10 - 15 * share + 6 * share**2)
    times = np.concatenate([TIMES, [2.0, 3.0, 5.0]])
    turned = np.concatenate([angle, np.full(3, 0.5 * np.pi)])
    base = bs.BaseMotion(times, rotations=turned[:, None] * [0, 1, 0])
    upright = ROBOT.with_({"gravity": "0 0 -9.81"})
    run = bs.simulate(
        upright, TENSIONS, 5.0, load=bs.Load(base=base),
        integrator=bs.Integrator(mass_damping=15.0), output=bs.Output(every=0.1),
    ).raise_for_status()  # fmt: skip
    # the base's x axis points down: world -z is its x axis
    rest = bs.solve(upright, TENSIONS, load=bs.Load(gravity=[9.81, 0, 0]))
    assert np.abs(run.tip_position[-1] - rest.tip.position).max() < 1e-4
    assert np.abs(run.tip_position[0] - run.tip_position[-1]).max() > 0.03


@pytest.mark.parametrize("by_displacement", [False, True])
def test_the_start_is_an_equilibrium_on_the_tilted_base(*, by_displacement: bool) -> None:
    """A base that stays tilted: its gravity is that of the world turned back."""
    upright = ROBOT.with_({"gravity": "0 0 -9.81"})
    tilt = np.array([0.2, 1.1, -0.3])
    weight = Rotation.from_rotvec(tilt).inv().apply([0, 0, -9.81])
    rest = bs.solve(upright, TENSIONS, load=bs.Load(gravity=weight)).raise_for_status()
    given: dict[str, Any] = {"tensions": TENSIONS}
    if by_displacement:
        given = {"displacements": rest.displacements()}
    load = bs.Load(base=bs.BaseMotion([0, 1], rotations=[tilt, tilt]), **given)
    run = bs.simulate(upright, duration=0.5, load=load).raise_for_status()
    level = bs.solve(upright, TENSIONS).raise_for_status()
    assert np.linalg.norm(level.tip.position - rest.tip.position) > 5e-3
    assert np.abs(run.tip_position - rest.tip.position).max() < 1e-6


def test_energy_relative_to_the_base() -> None:
    way = 0.1 * np.sin(5 * TIMES)[:, None] * [1, 0.5, 0]
    turn = 0.3 * np.sin(4 * TIMES)[:, None] * [0.2, 1, 0.4]
    base = bs.BaseMotion(TIMES, way, turn)
    data = moved(ROBOT, base, TENSIONS, gravity=[0, 0, -9.81]).to_dataset()
    left = data.kinetic_energy + data.elastic_energy + data.gravity_energy - data.work
    scale = float(data.kinetic_energy.max())
    assert scale > 1e-3
    assert float(np.abs(left - left[1]).max()) < 2e-3 * scale
    assert "rotations_rad" in data.attrs["settings"]


def test_accelerations_are_those_of_the_poses() -> None:
    times = np.linspace(0, 1, 401)
    rotations = np.stack([0.3 * np.sin(2 * times), 0.5 * times**2, 0.2 * np.cos(3 * times)], 1)
    positions = np.stack([np.sin(times), times**3, np.cos(2 * times)], 1)
    base = bs.BaseMotion(times, positions, rotations)
    gravity = np.array([1.0, 2.0, -9.0])
    t, h = 0.437, 1e-4
    at = base.accelerations([t], gravity)[0]

    def turn(s: float) -> np.ndarray:
        return Rotation.from_rotvec(
            [0.3 * np.sin(2 * s), 0.5 * s**2, 0.2 * np.cos(3 * s)]
        ).as_matrix()

    def rate(s: float) -> np.ndarray:
        skew = turn(s).T @ (turn(s + h) - turn(s - h)) / (2 * h)
        return np.array([skew[2, 1], skew[0, 2], skew[1, 0]])

    acceleration = np.array([-np.sin(t), 6 * t, -4 * np.cos(2 * t)])
    change = turn(t).T @ gravity - turn(0.0).T @ gravity
    np.testing.assert_allclose(at[:3], turn(t).T @ acceleration - change, atol=1e-3)
    np.testing.assert_allclose(at[3:6], rate(t), atol=1e-5)
    np.testing.assert_allclose(at[6:], (rate(t + h) - rate(t - h)) / (2 * h), atol=1e-3)


@pytest.mark.parametrize(
    ("hertz", "tensions", "tolerance"),
    [(5.0, [0, 0, 0], 1e-11), (60.0, lambda t: [0, 0, 0], 1e-8), (200.0, [0, 0, 0], 1e-11)],
    ids=["5 Hz", "60 Hz, tensions by a function", "200 Hz"],
)
def test_a_shaken_base_acts_as_the_inertial_force(
    hertz: float, tensions: Any, tolerance: float
) -> None:
    """Motions faster than the steps of a slow one; the only mass is at the tip."""
    rate, end = 2 * np.pi * hertz, 12 / hertz if hertz > 20 else 0.3
    times = np.linspace(0.0, end, 901)
    grown = np.clip(4 * times / end, 0, 1)
    amplitude = 20.0 / rate**2 * grown**3 * (10 - 15 * grown + 6 * grown**2)
    base = bs.BaseMotion(times, np.outer(amplitude * np.sin(rate * times), [1, 0, 0]))
    force = np.zeros((len(times), 3))
    force[:, 0] = -MASS * base.accelerations(times, [0, 0, 0])[:, 0]  # linear between poses
    damped, output = {"mass_damping": 2.0}, bs.Output(every=end / 100, points=0)
    exact = bs.simulate(
        ONE_DISK, [0, 0, 0], end, load=bs.Load(tip_force=bs.dynamics.Table(times, force)),
        start=bs.Start(bs.Load(tip_force=[0, 0, 0])),
        integrator=bs.Integrator(dt=end / 5400, **damped), output=output,
    ).raise_for_status()  # fmt: skip
    moved = float(np.ptp(exact.tip_position[:, 0]))
    run = bs.simulate(
        ONE_DISK, tensions, end, load=bs.Load(base=base),
        integrator=bs.Integrator(tolerance=tolerance, **damped), output=output,
    ).raise_for_status()  # fmt: skip
    apart = np.linalg.norm(run.tip_position - exact.tip_position, axis=1).max()
    assert run.error_estimate is not None and exact.error_estimate is not None
    assert apart <= run.error_estimate + exact.error_estimate
    assert apart < (2e-3 if tolerance < 1e-10 else 1e-2) * moved


def test_curves_between_accelerations_are_as_fine_as_the_motion() -> None:
    g = [0, 0, -9.81]
    fine = np.linspace(0, 2, 4001)
    slow = bs.BaseMotion(fine, np.outer(0.1 * np.sin(3 * fine), [1, 0, 0]))
    turning = bs.BaseMotion(
        [0, 1, 2], [[0, 0, 0], [1, 0, 0], [1, 0, 1]], [[0, 0, 0], [0, 2.9, 0], [2, 2.9, 0]]
    )
    random = np.random.default_rng(0)
    noisy = bs.BaseMotion(
        fine, random.normal(0, 1e-5, (4001, 3)), random.normal(0, 1e-4, (4001, 3))
    )
    still = bs.BaseMotion(fine, np.outer(fine, [0.3, -0.2, 1.0]))
    checks = np.linspace(0, 1.7, 3333)
    for base, most in ((slow, 40), (turning, 40), (noisy, 4000), (still, 1)):
        history = BaseHistory(base, g, 1.7)
        exact, found = base.accelerations(checks, g), history.rows(checks)
        size = np.maximum(np.linalg.norm(exact.reshape(-1, 3, 3), axis=2).max(axis=0), 1e-2)
        apart = np.linalg.norm((found - exact).reshape(-1, 3, 3), axis=2).max(axis=0)
        assert (apart <= 1.3e-5 * size).all() and history.misfit <= 1e-5
        assert 2 <= len(history.knots()) <= most + 1
        assert max(history.knots()) == 1.7


def test_a_motion_from_plain_values() -> None:
    base = bs.BaseMotion(TIMES, rotations=TIMES[:, None] * [0, 0, 1.0])
    again = bs.BaseMotion.of_dict(base.to_dict())
    np.testing.assert_array_equal(again.rotations, base.rotations)
    assert again.positions is None
