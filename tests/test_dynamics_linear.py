"""Linear models of small motions, against statics, modes and the nonlinear motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import cont2discrete

import bowstring as bs
from bowstring.errors import InputError, NoSolutionError
from objects import refused

AMOURI, RAO = bs.load_robot("amouri2019"), bs.load_robot("rao2021")
LOADED = bs.Load(
    [3.0, 1.0, 0.5, 0.2, 2.0, 0.1], gravity=[1.0, 0.0, -9.0], tip_force=[0.02, 0.01, -0.03]
)


FREE = LOADED.replace(gravity=[0.0, 0.0, 0.0])


@pytest.mark.parametrize("hole_length", ["0 mm", "3 mm"])
@pytest.mark.parametrize(
    # the couples of the weight on the tangents, by Hermite's rule, are not those of lumped masses
    ("load", "elements", "within"),
    [(FREE, None, 1e-9), (LOADED, 1, 1e-5), (LOADED, 2, 1e-6)],
)
def test_all_modes_together_are_the_static_response(
    hole_length: str, load: bs.Load, elements: int | None, within: float
) -> None:
    """Modes and their work on the tendons, summed, equal the derivatives of statics."""
    robot = RAO.with_({"segments.*.disks.hole_length": hole_length})
    model = bs.RodModel(elements=elements)
    found = bs.linearise(robot, load=load, model=model, modes=10_000)
    by = bs.jacobians(bs.solve(robot, load=load, model=model))
    static = np.concatenate([by.tip_position_by_tension, by.lengths_by_tension])
    response = -found.C @ np.linalg.solve(found.A, found.B)
    np.testing.assert_allclose(response, static, rtol=0, atol=within * np.abs(static).max())
    assert np.abs(found.D).max() < within * np.abs(static).max()
    force = -found.C @ np.linalg.solve(found.A, found.B_force)
    expected = by.tip_position_by_tip_force
    size = np.abs(expected).max()
    np.testing.assert_allclose(force[:3], expected, rtol=0, atol=within * size)


def test_few_modes_keep_the_static_response() -> None:
    few = bs.linearise(RAO, load=LOADED, modes=3)
    by = bs.jacobians(bs.solve(RAO, load=LOADED))
    response = few.D - few.C @ np.linalg.solve(few.A, few.B)
    np.testing.assert_allclose(response[:3], by.tip_position_by_tension, rtol=1e-9, atol=1e-12)
    assert np.abs(few.D[:3]).max() > 1e-3 * np.abs(response[:3]).max()


def test_frequencies_and_damping_are_those_of_the_modes() -> None:
    ratios = [0.01, 0.02, 0.03, 0.04]
    found = bs.linearise(AMOURI, [40, 0, 0], modes=4, damping=ratios)
    expected = bs.modes(AMOURI, [40, 0, 0], count=4).frequency_hz
    np.testing.assert_allclose(found.frequency_hz, expected, rtol=1e-12)
    values = np.linalg.eigvals(found.A)
    values = values[values.imag > 0]
    values = values[np.argsort(np.abs(values))]
    np.testing.assert_allclose(np.abs(values), 2 * np.pi * expected, rtol=1e-9)
    np.testing.assert_allclose(-values.real / np.abs(values), ratios, rtol=1e-9)


@pytest.mark.parametrize(
    ("robot", "load"), [(AMOURI, bs.Load([40.0, 5.0, 3.0])), (RAO, LOADED)], ids=["one", "two"]
)
def test_small_steps_move_the_robot_as_the_nonlinear_motion(robot: bs.Robot, load: bs.Load) -> None:
    """By a step of one tension; the damping by mass alone is the same in every mode's equation."""
    rate, dt, duration = 2.0, 1e-3, 0.3
    speed = 2 * np.pi * bs.linearise(robot, load=load, modes=30).frequency_hz
    found = bs.linearise(robot, load=load, modes=30, damping=rate / (2.0 * speed))
    change = np.zeros(len(found.tensions))
    change[0] = 1e-3 * found.tensions.max()
    run = bs.simulate(
        robot,
        duration=duration,
        load=load.replace(tensions=found.tensions + change),
        start=bs.Start(load.replace(gravity=None)),
        integrator=bs.Integrator(dt=dt / 4, spectral_radius=1.0, mass_damping=rate),
        output=bs.Output(every=dt),
    ).raise_for_status()
    moved = run.tip_position - found.outputs[:3]
    a, b, c, d, _ = found.discrete(dt)
    x, rows = np.zeros(len(a)), []
    for _ in range(len(moved)):
        rows.append((c @ x + d @ change)[:3])
        x = a @ x + b @ change
    size = np.abs(moved).max()
    assert size > 1e-5 * robot.length
    # the second-order part of the motion is a thousandth of it, the time integration adds the rest
    assert np.abs(np.array(rows)[1:] - moved[1:]).max() < 0.02 * size


def test_steps_are_those_of_scipy() -> None:
    found = bs.linearise(RAO, load=LOADED, modes=5)
    ours = found.discrete(2e-3)
    scipys = cont2discrete((found.A, found.B, found.C, found.D), 2e-3)
    for mine, theirs in zip(ours[:4], scipys[:4], strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-7, atol=1e-12)


def test_a_regulator_damps_the_model() -> None:
    model = bs.linearise(RAO, load=LOADED, modes=4).discrete(5e-3)
    weight = model.C[:3].T @ model.C[:3] * 1e6 + 1e-6 * np.eye(len(model.A))
    cost = solve_discrete_are(model.A, model.B, weight, np.eye(6))
    gain = np.linalg.solve(np.eye(6) + model.B.T @ cost @ model.B, model.B.T @ cost @ model.A)
    free = np.abs(np.linalg.eigvals(model.A)).max()
    closed = np.abs(np.linalg.eigvals(model.A - model.B @ gain)).max()
    assert closed < 0.99 < free < 1.0


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"load": bs.Load(displacements=[0.01, -0.005, -0.005])}, "for tensions"),
        ({"tensions": [1, 2]}, "3"),
        ({"tensions": [1, 2, np.nan]}, "tension"),
        ({"damping": -0.1}, "damping"),
        ({"damping": [0.1, 0.2]}, "12 ratios"),
        ({"damping": "x"}, "damping is 'x'"),
        ({"modes": 2, "damping": [0.1, 0.2, 0.3]}, "2 ratios"),
        ({"modes": 0}, "modes is 0, it must be a positive whole number"),
        ({"load": bs.Load([1, 0, 0], tip_moment=[0, 1, 0])}, "potential"),
        ({"model": bs.RodModel(tendon_path="continuous")}, "derivatives"),
    ],
)
def test_bad_input_is_refused(given: dict[str, Any], says: str) -> None:
    refused(says, lambda: bs.linearise(AMOURI, **given))


def test_friction_and_missing_equilibria_are_refused() -> None:
    with pytest.raises(InputError, match="friction"):
        bs.linearise(AMOURI.with_({"segments.0.tendons.friction": 0.1}), [1, 0, 0])
    with pytest.raises(NoSolutionError, match="no stable equilibrium"):
        bs.linearise(AMOURI, [4000, 4000, 4000])
    refused("dt is 0 s", lambda: bs.linearise(AMOURI, [1, 0, 0]).discrete(0.0))
    refused("shorter step", lambda: bs.linearise(AMOURI, [1, 0, 0]).discrete(1e300))
    tentacle = bs.load_robot(Path(__file__).parents[1] / "examples" / "tentacle.yaml")
    refused("tentacle has such tendons", lambda: bs.linearise(tentacle))
