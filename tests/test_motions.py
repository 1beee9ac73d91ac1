"""Many motions side by side: against `simulate`, energies, independence, resets, failures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics import Motions, Table
from bowstring.errors import InputError

DAMPED = bs.Integrator(modal_damping=0.05)
PERIOD = 0.02


@pytest.fixture(scope="module")
def robot() -> Any:
    return bs.load_robot("amouri2019", {"gravity": "0 0 -9.81"})


def tips(motions: Motions, rows: np.ndarray) -> np.ndarray:
    """Tips (K, N, 3) after each period; the first row of tensions is that at rest."""
    motions.reset(tensions=rows[0])
    found = []
    for row in rows[1:]:
        state = motions.step(row)
        assert state.moving.all()
        found.append(state.tip_position)
    return np.array(found)


def simulated(robot: Any, rows: np.ndarray, between: str, **settings: Any) -> np.ndarray:
    """The same motion by `simulate`, at the ends of the periods (K, 3)."""
    times = PERIOD * np.arange(len(rows))
    table = Table(times, rows)
    if between == "hold":
        table = Table(np.repeat(times, 2)[1:-1], np.repeat(rows[1:], 2, axis=0))
    run = bs.simulate(
        robot,
        table,
        float(times[-1]),
        start=bs.Start(bs.Load(rows[0])),
        output=bs.Output(every=PERIOD, points=0),
        **settings,
    )
    return run.raise_for_status().tip_position[1:]


@pytest.mark.parametrize("between", ["hold", "ramp"])
@pytest.mark.parametrize("name", ["amouri2019", "crl-ftdcr-v4"])
def test_motions_are_those_of_simulate(name: str, between: str) -> None:
    robot = bs.load_robot(name, {"gravity": "0 0 -9.81"})
    top = {"amouri2019": 40.0, "crl-ftdcr-v4": 1.5}[name]
    tendons = len(robot.tendons.end_disk)
    rows = np.random.default_rng(0).uniform(0, top, (26, 3, tendons))
    errors = []
    for dt in (2e-3, 1e-3):
        integrator = bs.Integrator(dt=dt, modal_damping=0.05)
        found = tips(Motions(robot, 3, between=between, integrator=integrator), rows)
        # modes of the same equilibrium in both
        scheme = bs.Integrator(**damping(robot))
        expected = [simulated(robot, rows[:, i], between, integrator=scheme) for i in range(3)]
        error = np.linalg.norm(found - np.stack(expected, axis=1), axis=2) / robot.length
        errors.append(float(np.sqrt((error**2).mean())))
    # random jumps of all tensions in each period: a hard case
    assert errors[0] < 0.006 and errors[1] < 0.3 * errors[0]


def damping(robot: Any, ratio: float = 0.05) -> dict[str, float]:
    """Mass and material damping by the ratio of the slowest mode and a faster one (theory)."""
    speed = (
        2 * np.pi * bs.modes(robot, np.zeros(len(robot.tendons.end_disk)), count=12).frequency_hz
    )
    slow = speed[0]
    fast = speed[speed >= 2 * slow][0]
    return {
        "mass_damping": 2 * ratio * slow * fast / (slow + fast),
        "material_damping": 2 * ratio / (slow + fast),
    }


@pytest.mark.parametrize(
    "model",
    [
        bs.RodModel(theory="kirchhoff"),
        bs.RodModel(elements=2),
        bs.RodModel(tendon_path="continuous"),
    ],
)
def test_other_models(robot: Any, model: bs.RodModel) -> None:
    rows = np.random.default_rng(1).uniform(0, 30, (11, 2, 3))
    integrator = bs.Integrator(dt=1e-3, **damping(robot))
    found = tips(Motions(robot, 2, model=model, integrator=integrator), rows)
    scheme = bs.Integrator(**damping(robot))
    for i in range(2):
        expected = simulated(robot, rows[:, i], "hold", model=model, integrator=scheme)
        assert abs(found[:, i] - expected).max() < 2e-3 * robot.length


def test_energy_is_kept_without_damping(robot: Any) -> None:
    """Kinetic, elastic and gravity energy, and that of the constant tensions, are constant."""
    integrator = bs.Integrator(dt=1e-3, spectral_radius=1.0)
    motions = Motions(robot, 4, integrator=integrator)
    state = motions.reset(tensions=[[20, 20, 20], [40, 0, 0], [0, 30, 0], [5, 5, 40]])
    held = np.array([30.0, 0, 0])

    def energy(state: Any) -> np.ndarray:
        stored = state.kinetic_energy + state.elastic_energy + state.gravity_energy
        return np.asarray(stored + state.tendon_lengths @ held)

    start, scale = energy(state), 0.0
    for _ in range(100):
        state = motions.step(held)
        scale = max(scale, float(state.kinetic_energy.max()))
    assert state.moving.all() and scale > 0.1
    assert abs(energy(state) - start).max() < 2e-3 * scale


def test_a_motion_does_not_depend_on_the_others(robot: Any) -> None:
    rows = np.random.default_rng(2).uniform(0, 80, (16, 11, 3))
    together = tips(Motions(robot, 11, integrator=DAMPED), rows)
    threads = tips(Motions(robot, 11, integrator=DAMPED, threads=1), rows)
    assert np.array_equal(together, threads)
    for i in (0, 5, 10):
        alone = tips(Motions(robot, 1, integrator=DAMPED), rows[:, i : i + 1])
        # which series of a rotation is used depends on all lanes: rounding errors differ
        np.testing.assert_allclose(alone[:, 0], together[:, i], rtol=0, atol=1e-10)


def test_a_reset_begins_again(robot: Any) -> None:
    rows = np.random.default_rng(3).uniform(0, 40, (9, 3, 3))
    motions = Motions(robot, 3, integrator=DAMPED)
    first = tips(motions, rows)
    assert np.array_equal(tips(motions, rows), first)
    # a single one, while the others go on
    before = motions.state
    state = motions.reset(1, rows[0, 1])
    assert np.array_equal(state.tip_position[[0, 2]], before.tip_position[[0, 2]])
    assert np.array_equal(state.tip_velocity[[0, 2]], before.tip_velocity[[0, 2]])
    assert not state.tip_velocity[1].any()
    assert np.array_equal(motions.step(rows[1]).tip_position[1], first[0, 1])
    random = motions.reset_at_random(most=50, seed=7).tip_position
    assert np.array_equal(motions.reset_at_random(most=50, seed=7).tip_position, random)
    assert not np.array_equal(motions.reset_at_random(most=50, seed=8).tip_position, random)


def test_a_motion_that_fails_is_reported(robot: Any) -> None:
    motions = Motions(robot, 9, integrator=DAMPED)
    motions.reset(tensions=[10, 10, 10])
    tensions = np.full((9, 3), 10.0)
    tensions[4] = [1e7, 0, 0]
    for _ in range(3):
        state = motions.step(tensions)
    others = np.arange(9) != 4
    assert state.status[4] in ("step_failed", "collision") and not state.moving[4]
    assert state.moving[others].all() and (state.status[others] == "moving").all()
    for values in state[:9]:
        assert np.isfinite(values).all()
    assert np.array_equal(state.tensions[4], [10, 10, 10])  # as before the period that failed
    assert motions.reset([4], [10, 10, 10]).moving.all()
    # no equilibrium to start from
    assert motions.reset([2], [1e9, 0, 0]).status[2] == "no_equilibrium"


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (lambda r: Motions(r, 0), "count is 0"),
        (lambda r: Motions(r, 2, period=-1), "period is -1 s"),
        (lambda r: Motions(r, 2, between="jump"), "between is 'jump'"),
        (lambda r: Motions(r, 2, integrator=bs.Integrator(tolerance=1e-6)), "equal steps"),
        (lambda r: Motions(r, 2, integrator=bs.Integrator(dt=1e-9)), "time step is 1e-9 s"),
        (lambda r: Motions(r, 2, load=bs.Load(tip_moment=[0, 0, 1])), "load has tip_moment"),
        (lambda r: Motions(r, 2, load=bs.Load(tip_force=[0, 1])), "tip_force has shape"),
        (lambda r: Motions(r, 2).step([1, 1, 1]), "motion 0 has no state"),
        (lambda r: Motions(r, 2).reset(tensions=[1, -1, 1]), "tension 2 is -1 N"),
        (lambda r: Motions(r, 2).reset(tensions=[[1, 1, 1], [1, np.nan, 1]]), "tension 2 of"),
        (lambda r: Motions(r, 2).reset(tensions=[1, 1]), "tensions has shape (2,)"),
        (lambda r: Motions(r, 2).reset(2, [1, 1, 1]), "which is 2"),
        (lambda r: Motions(r, 2).reset("one"), "which is 'one'"),
        (lambda r: Motions(r, 2).reset_at_random(most=-3), "tension is -3 N"),
        (lambda r: Motions(r, 2).reset_at_random(most=3, seed="a"), "seed is 'a'"),
        (lambda r: Motions(r.with_({"segments.0.tendons.friction": 0.1}), 2), "have friction"),
    ],
)
def test_wrong_arguments(robot: Any, wrong: Callable[[Any], Any], said: str) -> None:
    with pytest.raises(InputError) as error:
        wrong(robot)
    assert said in str(error.value) and "\n" not in str(error.value)
