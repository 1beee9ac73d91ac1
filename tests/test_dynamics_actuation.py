"""Motion and modes with displacement control, slack and elastic tendons, and friction."""

from __future__ import annotations

import json
import math
import pickle
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics.load_history import Table, ramp, step
from bowstring.dynamics.modal import modes
from bowstring.dynamics.simulation import NoStart, simulate
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import with_tendons
from objects import objects

NAN = math.nan
STIFF = bs.load_robot("amouri2019")
WIRE = {"axial_stiffness": 20e3, "free_length": 0.3, "pretension": 5.0, "spool_radius": 0.01}
ELASTIC = with_tendons(STIFF, WIRE)
WITH_FRICTION = with_tendons(STIFF, {"friction": 0.1})
TOOL = {"mass": "50 g", "centre": "5 -10 30 mm", "inertia": "12 15 8 kg*mm^2"}
RAO = bs.load_robot("rao2021")


# -- motion ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "displacements"),
    [
        (STIFF, [0.02, -0.03, -0.03]),
        (STIFF, [0.012, -0.0058, -0.0062]),
        (ELASTIC, [0.004, -0.002, -0.002]),
        (RAO, [0.004, -0.01, -0.01, 0.003, -0.01, -0.01]),
    ],
)
def test_a_ramp_ends_in_the_equilibrium_of_its_displacements(
    robot: bs.Robot, displacements: list[float]
) -> None:
    steps = {"mass_damping": 15.0, "material_damping": 2e-3}
    given = objects(displacements=ramp(displacements, 0.5), **steps)
    run = simulate(robot, duration=5.0, **given).raise_for_status()
    rest = bs.solve(robot, load=bs.Load(displacements=displacements)).raise_for_status()
    assert np.linalg.norm(run.tip_position[-1] - rest.tip.position) < 1e-6
    end = run.to_dataset().isel(time=-1)
    np.testing.assert_allclose(end.tension, rest.tensions, rtol=0, atol=1e-3)
    np.testing.assert_allclose(end.slack, rest.slack_lengths, rtol=0, atol=1e-6)
    np.testing.assert_allclose(end.tendon_displacement, displacements, rtol=0, atol=1e-15)


def test_slack_lengths_equal_surplus_lengths() -> None:
    """At every output time, in a motion in which tendons become slack and taut."""
    for robot in (STIFF, ELASTIC):
        given = objects(displacements=ramp([0.02, -0.01, -0.012], 0.1), mass_damping=1.0)
        run = simulate(robot, duration=0.6, **given)
        fields = run.raise_for_status().to_dataset()
        home = bs.solve(robot, load=bs.Load(displacements=[0, 0, 0])).tendon_lengths
        if robot is ELASTIC:
            home = home - (0.3 + robot.length) / 20e3 * 5.0  # its elongation under the pretension
        slack = fields.slack.values
        surplus = home - fields.tendon_displacement.values - fields.tendon_length.values
        assert (slack >= 0).all() and (fields.tension.values >= 0).all()
        is_slack = slack > 1e-9
        assert is_slack.any(axis=0).sum() >= 2 and not is_slack.all()
        np.testing.assert_allclose(slack[is_slack], surplus[is_slack], rtol=0, atol=1e-12)
        # a taut elastic tendon elongates; an inextensible one has the length of its displacement
        taut = ~is_slack & (fields.time.values > 0)[:, None]
        assert (surplus[taut] < 1e-9).all()
        if robot is STIFF:
            np.testing.assert_allclose(surplus[taut], 0, atol=1e-10)


@pytest.mark.parametrize("robot", [STIFF, ELASTIC], ids=["stiff", "elastic"])
def test_energy_is_conserved_after_a_release(robot: bs.Robot) -> None:
    """Without damping, between outputs: tendons that become taut dissipate energy."""
    held = {"displacements": [0.01, -0.02, -0.02], "initial_tip_force": [0.5, 0.3, 0.0]}
    run = simulate(robot, duration=1.0, **objects(**held, spectral_radius=1.0, dt=1e-3))
    fields = run.raise_for_status().to_dataset()
    size = float((fields.kinetic_energy + fields.elastic_energy).max())
    assert float(abs(fields.energy_balance).max()) < 1e-3 * size
    assert np.diff(fields.dissipated_energy).min() > -1e-6 * size
    assert float(abs(fields.work).max()) < 1e-9  # the motors do not move


def test_friction_dissipation_closes_the_energy_balance() -> None:
    course = Table([0, 1, 2], [[0, 0, 0], [40, 0, 0], [0, 0, 0]])
    steps = bs.Integrator(spectral_radius=1.0, dt=2e-3)
    fields = simulate(WITH_FRICTION, course, 2.0, integrator=steps).to_dataset()
    work = float(fields.work.max())
    assert float(abs(fields.energy_balance).max()) < 2e-3 * work
    assert np.diff(fields.dissipated_energy).min() > -1e-6 * work
    assert float(fields.dissipated_energy[-1]) > 0.02 * work


def test_slow_load_and_unload_follow_the_path() -> None:
    """Tension up and down: the motion follows the hysteresis loop of statics."""
    course = Table([0, 10, 20], [[0, 0, 0], [40, 0, 0], [0, 0, 0]])
    run = simulate(WITH_FRICTION, course, 20.0, **objects(mass_damping=2.0, every=0.25))
    path = bs.sweep(WITH_FRICTION, run.raise_for_status().to_dataset().tension.values)
    x, static = run.tip_position[:, 0], path.tip_position[:, 0]
    width = static[::-1] - static
    assert width[20] > 2e-3  # in the middle of loading, 20 N
    assert abs(x - static).max() < 1e-3
    assert (x[::-1] - x)[20] == pytest.approx(width[20], rel=0.2)


def test_ideal_tendons_match_tension_control() -> None:
    """Tensions after a history of a robot without elasticity and friction.

    Without numerical damping: only with it, and only under tensions alone, steps keep an imbalance.

    """
    history = bs.solve(STIFF, load=bs.Load(displacements=[0, 0, 0])).history()
    plain, controlled = (
        simulate(
            STIFF, ramp([40, 0, 0], 0.2), 0.5, **objects(dt=2e-3, spectral_radius=1.0, **start)
        )
        for start in ({}, {"initial_history": history})
    )
    np.testing.assert_allclose(controlled.tip_position, plain.tip_position, rtol=0, atol=1e-9)


def test_motor_angles_match_displacements() -> None:
    angles = np.array([0.4, -0.2, -0.2])
    turned = simulate(ELASTIC, duration=0.2, load=bs.Load(angles=ramp(angles, 0.1)))
    pulled = simulate(ELASTIC, duration=0.2, load=bs.Load(displacements=ramp(0.01 * angles, 0.1)))
    np.testing.assert_allclose(turned.tip_position, pulled.tip_position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        turned.to_dataset().tendon_displacement[-1], 0.01 * angles, rtol=0, atol=1e-15
    )
    begun = simulate(ELASTIC, duration=0.01, **objects(angles=angles, initial_angles=angles))
    assert begun.settings["initial_displacements_m"] == pytest.approx(0.01 * angles)


@pytest.mark.parametrize("as_function", [False, True])
def test_mixed_control_over_time(as_function: bool) -> None:
    rows = {
        "tensions": [5, NAN, NAN],
        "displacements": [NAN, 0.002, NAN],
        "angles": [NAN, NAN, -0.1],
    }
    courses: dict[str, Any] = {name: ramp(row, 0.1) for name, row in rows.items()}
    if as_function:
        courses = {k: lambda t, c=course: c.at(t).tolist() for k, course in courses.items()}
    run = simulate(ELASTIC, duration=0.3, **objects(**courses, dt=1e-3))
    fields = run.raise_for_status().to_dataset()
    rise = np.clip(run.time / 0.1, 0, 1)
    np.testing.assert_allclose(fields.tension[1:, 0], 5 * rise[1:], rtol=0, atol=0.05)
    np.testing.assert_allclose(fields.tendon_displacement[:, 1], 0.002 * rise, rtol=0, atol=1e-12)
    np.testing.assert_allclose(fields.tendon_displacement[:, 2], -0.001 * rise, rtol=0, atol=1e-12)
    assert run.settings["initial_tensions_N"] == [0, None, None]
    assert run.settings["initial_displacements_m"] == [None, 0, 0]
    json.dumps(run.settings, allow_nan=False)


def test_displacements_of_elastic_tendons_may_jump() -> None:
    moved = [0.004, -0.002, -0.002]
    run = simulate(ELASTIC, duration=0.1, load=bs.Load(displacements=step(moved, 0.02)))
    assert run.converged and abs(run.tip_position[:3, 0]).max() < 1e-9
    assert run.tip_position[-1, 0] > 5e-3
    given = objects(displacements=[0, 0, 0], initial_displacements=moved)
    back = simulate(ELASTIC, duration=0.1, **given)
    assert back.tip_position[0, 0] > back.tip_position[-1, 0] + 5e-3


def test_modal_damping_includes_displacement_control_without_friction() -> None:
    """Taut tendons of constant length raise the slowest frequency and the modal damping."""
    load, ratio = bs.Load(displacements=[0.004, -0.002, -0.002]), bs.Integrator(modal_damping=0.05)
    damped = simulate(ELASTIC, duration=0.01, load=load, integrator=ratio)
    found = modes(ELASTIC, count=12, load=load).frequency_hz
    slow, fast = 2 * math.pi * found[0], 2 * math.pi * found[found >= 2 * found[0]][0]
    mass, material = (damped.settings[k] for k in ("mass_damping_per_s", "material_damping_s"))
    for w in (slow, fast):
        assert mass / (2 * w) + material * w / 2 == pytest.approx(0.05, rel=1e-9)
    alone, with_friction = (
        simulate(robot, [20, 0, 0], 0.01, integrator=ratio).settings["mass_damping_per_s"]
        for robot in (STIFF, WITH_FRICTION)
    )
    assert with_friction == pytest.approx(alone, rel=1e-9)


# -- modes -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "given"),
    [
        (ELASTIC, {"displacements": [0.004, -0.002, -0.002]}),
        (STIFF, {"displacements": [0.012, -0.0065, -0.0065]}),  # two are slack
        (WITH_FRICTION, {"tensions": [20, 0, 0]}),
        (STIFF, {"tensions": [40, 0, 0]}),
        (STIFF.with_({"payloads": [TOOL]}), {"tensions": [0, 0, 0]}),
    ],
    ids=["elastic", "two slack", "friction", "tensions", "eccentric payload"],
)
def test_modes_match_free_oscillations(robot: bs.Robot, given: dict[str, Any]) -> None:
    """Released from forces with the shape of a mode, the robot oscillates at its frequency."""
    found = modes(robot, count=2, **objects(**given))
    rest = bs.solve(robot, **objects(**given)).disk_positions
    steps = {"spectral_radius": 1.0, "dt": 1e-3, "every": 1e-3, "points": 2}
    for frequency, shape in zip(found.frequency_hz, found.displacement, strict=True):
        held = objects(**given, disk_forces=1e-2 * shape, **steps)
        run = simulate(robot, duration=6 / frequency, **held)
        moved = run.raise_for_status().to_dataset().disk_position.values - rest
        share = np.einsum("tni,ni->t", moved, shape)
        up = np.flatnonzero((share[:-1] < 0) & (share[1:] >= 0))
        crossed = run.time[up] - share[up] * 1e-3 / (share[up + 1] - share[up])
        period = (crossed[-1] - crossed[0]) / (len(crossed) - 1)
        assert len(crossed) >= 5 and 1 / period == pytest.approx(frequency, rel=2e-3)


def test_constraints_raise_frequencies() -> None:
    """Tendons of constant length stiffen the robot, and so do those that stick in their holes."""
    tensions = [20, 12, 10]
    free = modes(STIFF, tensions).frequency_hz
    held = bs.Load(displacements=bs.solve(STIFF, tensions).displacements())
    pulled = modes(STIFF, load=held).frequency_hz
    stuck = modes(WITH_FRICTION, tensions).frequency_hz
    assert (pulled >= free * (1 - 1e-6)).all() and (stuck >= free * (1 - 1e-6)).all()
    assert pulled[0] > 1.3 * free[0] and stuck[0] > pulled[0]


def test_slack_tendons_do_not_change_modes() -> None:
    paid_out = modes(STIFF, load=bs.Load(displacements=[-0.01, -0.01, -0.01]))
    np.testing.assert_allclose(paid_out.frequency_hz, modes(STIFF).frequency_hz, rtol=1e-9)
    assert (paid_out.tensions == 0).all()


def test_modes_under_motor_angles_and_mixed_control() -> None:
    by_angle = modes(ELASTIC, load=bs.Load(angles=[0.4, -0.2, -0.2]))
    by_displacement = modes(ELASTIC, load=bs.Load(displacements=[0.004, -0.002, -0.002]))
    np.testing.assert_allclose(by_angle.frequency_hz, by_displacement.frequency_hz, rtol=1e-12)
    mixed = modes(ELASTIC, [5, None, None], load=bs.Load(displacements=[None, 0, 0]))
    assert mixed.tensions[0] == 5
    assert modes(ELASTIC, [5, 5, 5]).frequency_hz[0] < mixed.frequency_hz[1]


# -- fields and files --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot", "given"),
    [
        (STIFF, {"displacements": [0.02, -0.03, -0.03]}),
        (ELASTIC, {"tensions": [5, None, None], "displacements": [None, 0.002, -0.001]}),
        (WITH_FRICTION, {"displacements": [0.02, -0.012, -0.03]}),
        (WITH_FRICTION, {"tensions": [40, 0, 0]}),
        (RAO, {"displacements": [0.004, -0.01, -0.01, 0.003, -0.01, -0.01]}),
        (RAO, {"tensions": [1, 0, 0, 1, 0, 0]}),
    ],
)
def test_fields_of_an_equilibrium_match_the_solution(
    robot: bs.Robot, given: dict[str, Any]
) -> None:
    solution = bs.solve(robot, **objects(**given)).raise_for_status()
    fields = solution.to_dataset().isel(time=0)
    assert solution.tendon_lengths is not None
    for name, expected, error in (
        ("tension", solution.tensions, 1e-9),
        ("tendon_displacement", solution.displacements(), 1e-12),
        ("slack", solution.slack_lengths, 1e-12),
        ("span_tension", solution.span_tensions, 1e-9),
        ("tendon_length", solution.tendon_lengths, 1e-12),
        ("disk_position", solution.disk_positions, 1e-12),
    ):
        np.testing.assert_allclose(fields[name], expected, rtol=0, atol=error, err_msg=name)


def test_runs_are_copied() -> None:
    load = bs.Load(displacements=ramp([0.004, -0.002, -0.002], 0.05))
    run = simulate(ELASTIC, duration=0.1, load=load)
    again = pickle.loads(pickle.dumps(run))
    np.testing.assert_array_equal(
        again.to_dataset().tendon_displacement, run.to_dataset().tendon_displacement
    )
    assert again.settings == run.settings


def test_displacement_functions_are_not_called_after_the_end() -> None:
    far = Table([0, 0.1, 50], [[0, 0, 0], [0.001, 0, 0], [0.7, 0, 0]])
    run = simulate(STIFF, duration=0.1, **objects(displacements=far, mass_damping=5.0))
    assert run.status == "converged"
    with pytest.raises(InputError, match="at 46 s, it must be less than the tendon's length"):
        simulate(STIFF, duration=46.0, load=bs.Load(displacements=far))


# -- rejected input ----------------------------------------------------------------------------


def test_without_friction_all_spans_carry_the_tension() -> None:
    """Also under tension control alone; NaN beyond a tendon's end."""
    fields = simulate(RAO, [1, 0, 0, 1, 0, 0], 0.02).to_dataset().isel(time=-1)
    passes = np.arange(20)[:, None] <= RAO.tendons.end_disk
    assert (np.isnan(fields.span_tension) == ~passes).all()
    spread = np.where(passes, fields.tension.values, NAN)
    np.testing.assert_array_equal(fields.span_tension, spread)
    assert (fields.slack == 0).all() and float(fields.tendon_displacement[0]) > 0


def test_conflicting_displacements() -> None:
    """Three tendons of an inextensible backbone."""
    held = objects(displacements=[0.03] * 3, theory="kirchhoff")
    rising = objects(displacements=ramp([0.03] * 3, 0.1), theory="kirchhoff")
    run = simulate(STIFF, duration=0.1, **rising)
    assert run.status == "step_failed"
    assert "run bowstring solve with the displacements of that time" in run.message
    # an extensible backbone follows for a while, until it buckles; the last state is as accurate as
    # before (slower motions may pass the buckling point, which rounding decides)
    given = objects(displacements=ramp([0.15] * 3, 0.3), every=0.005)
    fields = simulate(STIFF, duration=0.3, **given).to_dataset()
    assert fields.attrs["status"] == "step_failed" and len(fields.time) > 3
    assert (fields.slack[:-1] == 0).all() and (fields.tension[1:-1] > 0).all()
    np.testing.assert_array_equal(
        fields.span_tension, np.repeat(fields.tension.values[:, None], 9, axis=1)
    )
    with pytest.raises(NoStart, match="no equilibrium to start from"):
        simulate(STIFF, duration=0.1, **held)
    with pytest.raises(NoSolutionError, match="no stable equilibrium"):
        modes(STIFF, **held)


def test_a_displacement_jump_acts_at_once() -> None:
    """A jump is not spread over a step: the error decreases faster than the step."""
    robot = with_tendons(STIFF, {"axial_stiffness": 20e3, "pretension": 20.0})
    jump = {"displacements": step([0.004, -0.002, -0.002])}
    first = simulate(robot, duration=1e-4, **objects(**jump, dt=1e-4, every=1e-4)).to_dataset()
    stretch = 0.004 * 20e3 / 0.641
    assert float(first.tension[-1, 0]) == pytest.approx(20.0 + stretch, rel=0.05)

    def early(dt: float) -> np.ndarray:
        run = simulate(robot, duration=1e-3, **objects(**jump, dt=dt, every=1e-3, points=0))
        return run.raise_for_status().tip_position[-1]

    limit = early(5e-6)
    coarse, fine = (np.linalg.norm(early(dt) - limit) for dt in (2e-4, 1e-4))
    assert fine < 0.35 * coarse


def test_rounding_causes_no_jump_and_no_slip() -> None:
    times, displacements = [0.0, 0.1, 0.2, 0.3], [0.0, -0.02, -0.007, 0.0]
    table = Table(times, np.array([displacements, np.zeros(4), np.zeros(4)]).T)
    force = Table([0.0, 0.2, 0.2, 0.3], [[0, 0, 0], [0, 0, 0], [0.01, 0, 0], [0, 0, 0]])
    assert simulate(STIFF, duration=0.3, **objects(displacements=table, tip_force=force)).converged
    # a displacement that rises and then stays does not reverse friction at the base hole
    sticky = with_tendons(STIFF, {"axial_stiffness": 20e3, "pretension": 5.0, "friction": 0.3})
    path = np.array([0.0, 0.001, 0.010, 0.010])
    table = Table([0.0, 0.1, 0.5, 0.7], np.stack([path, -path / 2, -path / 2], axis=1))
    run = simulate(sticky, duration=0.7, **objects(displacements=table, mass_damping=5.0))
    data = run.to_dataset()
    ratio = (data.tension / data.span_tension.isel(disk=0)).sel(tendon=1).values
    assert run.converged and (ratio[-15:] > 1.0).all()


def test_holes_without_bend_have_no_friction() -> None:
    straight, plain = (modes(r, [10, 10, 10]).frequency_hz for r in (WITH_FRICTION, STIFF))
    np.testing.assert_allclose(straight, plain, rtol=1e-6)


@pytest.mark.parametrize(
    ("robot", "displacement"), [(RAO, 0.004), (bs.load_robot("crl-ftdcr-v4"), 0.004)]
)
def test_several_segments(robot: bs.Robot, displacement: float) -> None:
    count = len(robot.tendons.end_disk)
    displacements = np.full(count, -2 * displacement)
    displacements[0] = displacement
    run = simulate(
        robot,
        duration=0.3,
        load=bs.Load(displacements=ramp(displacements, 0.2)),
        integrator=bs.Integrator(mass_damping=1.0),
        output=bs.Output(every=0.05),
    )
    fields = run.raise_for_status().to_dataset()
    np.testing.assert_allclose(fields.tendon_displacement[-1], displacements, rtol=0, atol=1e-15)
    assert float(fields.tension[:, 0].max()) > 0
    size = float(abs(fields.work).max())
    assert float(abs(fields.energy_balance).max()) < 2e-2 * size
