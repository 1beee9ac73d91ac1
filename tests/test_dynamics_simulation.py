"""Dynamics from Python: motion, fields, modes, time-dependent loads, files, invalid input."""

from __future__ import annotations

import math
import os
import pickle
import signal
import time as clock
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import bowstring as bs
from bowstring.dynamics import simulation
from bowstring.dynamics.load_history import Table, ramp, step
from bowstring.dynamics.modal import modes
from bowstring.dynamics.run_file import RunFile, read_run
from bowstring.dynamics.simulation import simulate
from bowstring.errors import InputError, NoSolutionError
from objects import objects, refused

ROBOT = bs.load_robot("amouri2019")
TWO = ROBOT.with_({"segments.0.disks.count": 2, "segments.0.disks.positions": None})


def tendon_1(newtons: float) -> list[float]:
    return [newtons, 0.0, 0.0]


def bare_rod(length: str, disks: int, **backbone: Any) -> bs.Robot:
    """A rod: its disks have no mass, and its tendons no tension."""
    own = {"disks.count": disks, "disks.mass": 0, "disks.thickness": 0, "length": length}
    own |= {f"backbone.{name}": value for name, value in backbone.items()}
    return ROBOT.with_({f"segments.0.{name}": value for name, value in own.items()})


def released(
    tension: float, duration: float, *, to: float = 0.0, robot: bs.Robot = ROBOT, **given: Any
) -> bs.Run:
    """The motion from rest under a tension of tendon 1 that changes at the start."""
    start = {"initial_tensions": tendon_1(tension)}
    run = simulate(robot, tendon_1(to), duration, **objects(**start, **given))
    return run.raise_for_status()


# -- motion ----------------------------------------------------------------------------------


def test_ramp_matches_independent_engines() -> None:
    steps = bs.Integrator(mass_damping=0.5, dt=1e-3)
    run = simulate(ROBOT, ramp(tendon_1(80), 1.0), 1.3, integrator=steps)
    assert run.converged and run.end == 1.3
    x = run.tip_position[:, 0]
    # two independent engines agree within 0.16 mm on these
    assert x[50] == pytest.approx(0.198328, abs=0.2e-3)
    assert x[100] == pytest.approx(0.370456, abs=0.2e-3)
    assert x.max() == pytest.approx(0.4076, abs=0.2e-3)
    assert run.time[x.argmax()] == pytest.approx(1.15, abs=0.011)


def test_default_settings_are_near_convergence() -> None:
    run, limit = (
        simulate(ROBOT, ramp(tendon_1(80), 1.0), 2.0, **objects(mass_damping=0.5, **given))
        for given in ({}, {"dt": 2e-4, "spectral_radius": 1.0})
    )
    error = np.linalg.norm(run.tip_position - limit.tip_position, axis=1)
    assert error.max() < 0.3e-3


@pytest.mark.parametrize("case", [1, 2])
def test_release_of_another_groups_rod(case: int, public_data: Callable[[str], Path]) -> None:
    """A steel rod released from forces in its middle and at its tip, by a Cosserat solver of
    another group. Its damping ratio is strain rate to strain: material damping."""
    path = public_data("sorosim-rods") / f"SpringSteel_dynamics_{case}.txt"
    lines = [[float(x) for x in line.split()] for line in path.read_text().splitlines()]
    to_base = np.array([[0, 0, 1], [0, -1, 0], [1, 0, 0]])
    gravity = to_base @ lines[0][-3:]
    middle, tip = to_base @ lines[1][4:7], to_base @ lines[1][10:13]
    recorded = np.array(lines[2:])
    time, expected = recorded[:, 0], recorded[:, 10:13] @ to_base.T
    steel = bare_rod("600 mm", 6, diameter="1.6 mm", E="200 GPa", nu=0.33, density=7870)
    forces = np.zeros((6, 3))
    forces[2], forces[5] = middle, tip
    held = objects(gravity=gravity.tolist(), disk_forces=forces)
    steps = objects(material_damping=lines[0][0], dt=1e-3, every=0.005)
    run = simulate(steel, [0.0, 0.0, 0.0], float(time[-1]), **held, **steps)
    error = np.linalg.norm(run.tip_position - expected, axis=1)
    rms = math.sqrt((error**2).mean())
    assert len(error) == 2001
    assert rms < 1e-3 * 0.6, f"{1e3 * rms:.2f} mm"  # requirement: 1 % of length
    assert error[0] < 0.1e-3


@pytest.mark.parametrize("radius", [0.8, 1.0])
@pytest.mark.parametrize("dt", [None, 1e-2, 5e-2])
def test_step_error_estimates_are_accurate(radius: float, dt: float | None) -> None:
    def moved(dt: float | None) -> Any:
        steps = objects(mass_damping=0.5, spectral_radius=radius, dt=dt, every=0.05, points=0)
        return simulate(ROBOT, ramp(tendon_1(20), 0.1), 1.0, **steps)

    run = moved(dt)
    off = np.linalg.norm(run.tip_position - moved(2e-4).tip_position, axis=1).max()
    assert off < run.error_estimate < 6 * off
    assert ("give a smaller dt" in run.message) == (run.error_estimate > 0.01 * ROBOT.length)


def test_one_step_has_no_error_estimate() -> None:
    run = released(0.0, 0.01, to=20.0, dt=1e-2, points=0)
    assert run.steps == 1 and run.error_estimate is None
    assert "too few steps" in run.message
    for duration in (0.1, 0.0):
        still = simulate(ROBOT, tendon_1(0), duration, **objects(dt=1e-2, points=0))
        assert still.error_estimate == 0.0


@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
def test_energy_is_conserved_over_a_hundred_periods(theory: Any) -> None:
    steps = {"spectral_radius": 1.0, "dt": 1e-3, "every": 0.05, "points": 2}
    run = released(40.0, 44.0, theory=theory, **steps)
    data = run.to_dataset()
    assert float(abs(data.energy_balance).max()) < 1e-4 * float(data.elastic_energy[0])
    # and swings as far as before
    assert run.tip_position[-100:, 0].max() > 0.97 * run.tip_position[0, 0]


def test_numerical_damping_dissipates_energy() -> None:
    data = released(40.0, 2.0, spectral_radius=0.5, dt=5e-3).to_dataset()
    assert data.energy_balance[-1] < -0.05 * data.elastic_energy[0]


@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
@pytest.mark.parametrize("dt", [1e-4, 5e-2])
def test_release_never_fails(theory: Any, dt: float) -> None:
    run = released(40.0, min(1.0, 400 * dt), theory=theory, spectral_radius=1.0, dt=dt)
    assert run.to_dataset().kinetic_energy.max() < 1.02 * run.to_dataset().elastic_energy[0]


# -- fields ----------------------------------------------------------------------------------


def test_internal_moment_is_that_of_the_tendon_at_the_disks() -> None:
    """Beyond the middle of a module, 80 N act along the span, at its distance."""
    model = bs.RodModel("kirchhoff", elements=4)
    data = bs.solve(ROBOT, tendon_1(80), model=model).to_dataset(points=3)
    solution = bs.solve(ROBOT, tendon_1(80), model=model)
    positions, rotations = solution.disk_positions, solution.disk_rotations
    assert positions is not None and rotations is not None
    hole = np.array([0.029, 0.0, 0.0])
    before, after = positions[3] + rotations[3] @ hole, positions[4] + rotations[4] @ hole
    pull = 80 * (before - after) / np.linalg.norm(before - after)  # on disk 5
    for point in range(12, 15):
        place = data.position.values[0, point]
        moment = np.cross(after - place, pull)
        own = data.rotation.values[0, point] @ data.moment.values[0, point]
        np.testing.assert_allclose(own, moment, atol=2e-5 * np.linalg.norm(moment))
        force = data.rotation.values[0, point] @ data.force.values[0, point]
        np.testing.assert_allclose(force, pull, atol=1e-7)


def test_section_forces_carry_the_weight_below() -> None:
    """Suspended and straight, every section carries the weight below it."""
    data = bs.solve(ROBOT, tendon_1(0), load=bs.Load(gravity=[0, 0, 9.81])).to_dataset()
    density = 1800 * math.pi * 2.5e-3**2
    for s, module, force in zip(
        data.arc_length.values, data.module.values, data.force.values[0], strict=True
    ):
        below = (10 - module) * 0.02 + density * (0.641 - s)
        assert force[2] == pytest.approx(9.81 * below, rel=1e-9)


def test_dataset_and_tip_agree() -> None:
    run = simulate(ROBOT, ramp(tendon_1(20), 0.2), 0.35, output=bs.Output(every=0.02))
    assert run.time[-1] == pytest.approx(0.35) and len(run.time) == 19
    np.testing.assert_array_equal(run.to_dataset().disk_position.values[:, -1], run.tip_position)
    np.testing.assert_allclose(run.to_dataset().position.values[:, -1], run.tip_position, atol=1e-9)
    assert run.to_dataset().attrs["status"] == "converged"
    between = run.tip_at(run.time[:-1] + 0.01)
    fine = simulate(ROBOT, ramp(tendon_1(20), 0.2), 0.35, output=bs.Output(every=0.01))
    np.testing.assert_allclose(between[:17], fine.tip_position[1:35:2], atol=2e-4)


def test_a_backbone_beside_continuous_tendons_carries_their_tension() -> None:
    model = bs.RodModel(tendon_path="continuous")
    still = bs.solve(ROBOT, tendon_1(40), model=model).to_dataset()
    np.testing.assert_allclose(still.force.values[0, :, 2], -40.0, rtol=1e-9)
    straight = float(bs.solve(ROBOT, tendon_1(40)).to_dataset().von_mises_max[0])
    assert float(still.von_mises_max[0]) == pytest.approx(straight, rel=0.03)


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
@pytest.mark.parametrize("dt", [1e-4, 3e-5, 1e-5, 1e-6])
@pytest.mark.parametrize("tension", [5, 40, 80])
def test_a_release_needs_few_iterations_at_short_steps(
    theory: Any, dt: float, tension: float
) -> None:
    run = released(tension, 5 * dt, theory=theory, dt=dt)
    assert run.repeated == 0 and run.iterations <= 25


@pytest.mark.parametrize("dt", [1e-4, 1e-5, 3e-6])
@pytest.mark.parametrize(("start", "end"), [(40, 0), (0, 40), (10, 60)])
def test_tensions_of_continuous_tendons_may_jump(dt: float, start: float, end: float) -> None:
    """They shorten it at once; mass gets no impulse from that, however short the step."""
    steps = {"dt": dt, "spectral_radius": 1.0, "every": dt}
    run = released(start, 10 * dt, to=end, tendon_path="continuous", **steps)
    data = run.to_dataset()
    model = bs.RodModel(tendon_path="continuous")
    bent = bs.solve(ROBOT, tendon_1(max(start, end)), model=model).to_dataset()
    assert run.repeated == 0
    assert float(abs(data.energy_balance).max()) < 3e-4 * float(bent.elastic_energy[0])
    # slow at first: change of force over mass, times time
    assert float(data.kinetic_energy[1]) < 0.1 * float(data.kinetic_energy[-1])


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
@pytest.mark.parametrize("radius", [0.8, 1.0])
@pytest.mark.parametrize(
    ("name", "tensions", "dt"),
    [
        ("rao2021", [0, 2.85, 0, 2.85, 0, 0], 1e-3),
        ("crl-ftdcr-v4", [0, 0, 4.28, 4.31, 0, 0, 0, 0.04, 3.23], 3e-4),
    ],
)
def test_a_violent_release_continues_after_cut_steps(
    name: str, tensions: list[float], dt: float, radius: float, theory: Any
) -> None:
    """Steps that are too long leave velocities that the strain cannot follow."""
    given = objects(theory=theory, initial_tensions=tensions, dt=dt, spectral_radius=radius)
    run = simulate(bs.load_robot(name), [0.0] * len(tensions), 0.03, **given).raise_for_status()
    data = run.to_dataset()
    energy = data.kinetic_energy + data.elastic_energy
    assert float(energy.max()) < 1.05 * float(energy[0])


@pytest.mark.parametrize("room", [1, 100_000, 10_000_000])  # bytes: one time, some, all of them
def test_file_contains_the_same_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    monkeypatch.setattr("bowstring.dynamics.run_file._ROOM", room)
    case: Any = {
        "robot": bs.load_robot("rao2021"),
        "tensions": ramp([8, 1, 0, 2, 0, 0], 0.1),
        "duration": 0.15,
        "mass_damping": 0.5,
        "dt": 2e-3,
    }
    kept = simulate(**objects(**case))
    seen: list[float] = []
    written = simulate(**objects(**case, path=tmp_path / "run.nc", progress=seen.append))
    assert written.frames is None and seen[-1] == pytest.approx(1.0)
    assert read_run(tmp_path / "run.nc").attrs["status"] == "converged"
    xr.testing.assert_identical(written.to_dataset(), kept.to_dataset())
    for name in ("time", "tip_position", "tip_velocity", "steps", "iterations", "repeated"):
        np.testing.assert_array_equal(getattr(written, name), getattr(kept, name))


@pytest.mark.parametrize(
    "settings",
    [
        {"theory": "kirchhoff"},
        {"twist": False},
        {"tendon_path": "continuous", "elements": 2},
        {"tip_force": step([0.5, 0.2, 0.1], 0.013)},
        {"dt": 0.02, "points": 2},
    ],
)
def test_file_of_a_release_contains_the_same_run(tmp_path: Path, settings: dict[str, Any]) -> None:
    """Energy at the start is not zero, and sections have shear as in the theory."""
    arguments: Any = {
        "initial_tensions": [30, 5, 0],
        "initial_tip_force": [0.2, 0.4, 0],
        **settings,
    }
    kept = simulate(ROBOT, tendon_1(1), 0.05, **objects(**arguments))
    written = simulate(ROBOT, tendon_1(1), 0.05, **objects(**arguments, path=tmp_path / "run.nc"))
    assert kept.to_dataset().elastic_energy[0] > 1e-3
    xr.testing.assert_identical(written.to_dataset(), kept.to_dataset())


@pytest.mark.parametrize("call", [1, 2, 5])
@pytest.mark.parametrize("after", [False, True])
def test_interrupted_while_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: int, after: bool
) -> None:
    append, calls = RunFile.append, 0

    def interrupted(self: RunFile, records: Any) -> None:
        nonlocal calls
        calls += 1
        if calls == call and not after:
            raise KeyboardInterrupt
        append(self, records)
        if calls == call:
            raise KeyboardInterrupt

    monkeypatch.setattr("bowstring.dynamics.run_file._ROOM", 100_000)
    monkeypatch.setattr(RunFile, "append", interrupted)
    with pytest.raises(simulation.RunInterrupted) as caught:
        simulate(ROBOT, tendon_1(5), 1.0, output=bs.Output(path=tmp_path / "run.nc"))
    run = caught.value.run
    data = run.to_dataset()  # of the same times
    assert data.attrs["status"] == run.status == "interrupted"
    assert len(run.time) == data.sizes.get("time", 0) < 101
    assert 0 < run.wall_s < 10  # with the interval of the interrupt
    assert (len(run.time) > 0) == (after or call > 1)
    assert run.wall_s > 0 and np.isfinite(run.real_time_factor)


@pytest.mark.parametrize("name", [None, "run.nc"])
def test_wall_time_of_a_motion(tmp_path: Path, name: str | None) -> None:
    """The start is included, and the time in `progress` is not."""
    out = None if name is None else tmp_path / name
    start = simulate(ROBOT, tendon_1(5), 0.0, output=bs.Output(path=out))
    assert start.wall_s > 0 and start.real_time_factor == 0.0
    begun = clock.perf_counter()
    run = simulate(
        ROBOT, tendon_1(5), 0.05, output=bs.Output(path=out, progress=lambda _: clock.sleep(0.2))
    )
    assert 0 < run.wall_s < clock.perf_counter() - begun - 0.2


def test_a_load_that_fails_at_the_start_keeps_the_former_run(tmp_path: Path) -> None:
    asked = []

    def tension(t: float) -> list[float]:
        asked.append(t)
        if len(asked) == 2:
            raise ValueError("no more")
        return tendon_1(5)

    former = simulate(ROBOT, tendon_1(6), 0.02, output=bs.Output(path=tmp_path / "run.nc"))
    with pytest.raises(InputError, match="failed at 0 s: ValueError: no more"):
        simulate(ROBOT, tension, 0.1, output=bs.Output(path=tmp_path / "run.nc"))
    assert asked == [0.0, 0.0] and former.to_dataset().attrs["status"] == "converged"


@pytest.mark.parametrize("within", ["progress", "displacements"])
def test_an_interrupted_run_keeps_its_records(tmp_path: Path, within: str) -> None:
    def stop(share: float) -> list[float]:
        if share > 0.4:
            raise KeyboardInterrupt
        return [0.01 * share, -0.02, -0.02]

    by_progress = within == "progress"
    tensions, path = tendon_1(5) if by_progress else None, tmp_path / "run.nc"
    load = None if by_progress else bs.Load(displacements=lambda t: stop(t / 5.0))
    output = bs.Output(path=path, progress=stop if by_progress else None)
    with pytest.raises(simulation.RunInterrupted) as caught:
        simulate(ROBOT, tensions, 5.0, load=load, output=output)
    assert caught.value.run.status == "interrupted"
    again = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(again, simulation.RunInterrupted) and again.run.end == caught.value.run.end
    data = read_run(path)
    assert data.attrs["status"] == "interrupted"
    end = float(data.time[-1])
    assert 1.9 < end < 3.1 and end == caught.value.run.end
    if not by_progress:
        assert float(data.tendon_displacement[-1, 0]) == pytest.approx(0.01 * end / 5.0)


# -- loads over time -------------------------------------------------------------------------


def test_a_file_overwritten_by_another_run_is_detected(tmp_path: Path) -> None:
    out = tmp_path / "run.nc"
    first, second = (
        bs.simulate(ROBOT, [pull, 0, 0], 0.02, output=bs.Output(path=out)) for pull in (5.0, 6.0)
    )
    refused("holds another run by now", lambda: first.to_dataset())
    assert second.to_dataset().sizes["time"] == 3


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_second_interrupt_does_not_spoil_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    finish = RunFile.finish

    def again(self: RunFile, *arguments: Any) -> None:
        signal.raise_signal(signal.SIGINT)
        finish(self, *arguments)

    def stop(share: float) -> None:
        # both wait until the interpreter checks for signals; another thread may be late
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
        try:
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGTERM)
        finally:  # children inherit the mask
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT, signal.SIGTERM})

    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    monkeypatch.setattr(RunFile, "finish", again)
    try:
        with pytest.raises(simulation.RunInterrupted) as caught:
            simulate(
                ROBOT, tendon_1(5), 0.1, output=bs.Output(path=tmp_path / "run.nc", progress=stop)
            )
    finally:
        signal.signal(signal.SIGTERM, before)
    data = read_run(tmp_path / "run.nc")
    assert data.attrs["status"] == caught.value.run.status == "interrupted"
    assert float(data.time[-1]) == caught.value.run.end > 0
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_function_table_and_ramp_agree() -> None:
    arguments: dict[str, Any] = {"dt": 2e-3, "mass_damping": 0.5}
    by_ramp = simulate(ROBOT, ramp(tendon_1(30), 0.2), 0.3, **objects(**arguments))
    by_table = simulate(
        ROBOT, Table([0, 0.2], [tendon_1(0), tendon_1(30)]), 0.3, **objects(**arguments)
    )
    asked: list[float] = []

    def tension(t: float) -> list[float]:
        asked.append(t)
        return tendon_1(30 * min(t / 0.2, 1.0))

    by_function = simulate(ROBOT, tension, 0.3, **objects(**arguments))
    np.testing.assert_array_equal(by_ramp.tip_position, by_table.tip_position)
    np.testing.assert_allclose(by_function.tip_position, by_ramp.tip_position, atol=1e-7)
    # once before each step, and at the start
    later = [t for t in asked if t > 0]
    assert len(later) == by_function.steps == 150
    assert (np.diff(later) > 0).all()


def test_jump_inside_a_run() -> None:
    run = simulate(ROBOT, step(tendon_1(10), 0.1), 0.3, integrator=bs.Integrator(dt=1e-3))
    before = run.time <= 0.1
    assert np.abs(run.tip_position[before, 0]).max() == 0.0
    assert run.tip_position[-1, 0] > 0.02
    later = simulate(ROBOT, step(tendon_1(10)), 0.2, integrator=bs.Integrator(dt=1e-3))
    np.testing.assert_allclose(run.tip_position[10:], later.tip_position, atol=1e-7)


@pytest.mark.parametrize("rises", [True, False])
@pytest.mark.parametrize("every", [0.01, 0.07])
def test_times_of_two_tables_may_differ_by_rounding(rises: bool, every: float) -> None:
    """Half a unit in the last place between two corners or jumps makes no step of its own."""
    tips = []
    for time in (0.3, 0.1 + 0.2):
        times = [0, time, 0.5] if rises else [0, time, time, 0.5]
        displacements = Table([0, 0.3, 0.3, 0.5], [tendon_1(t) for t in (0, 5, 3, 0)])
        force = Table(times, [[x, 0, 0] for x in ((0, 0.1, 0) if rises else (0, 0.1, 0.3, 0))])
        given = objects(tip_force=force, dt=5e-3, every=every)
        run = simulate(ROBOT, displacements, 0.6, **given)
        assert run.raise_for_status().steps <= 125
        tips.append(run.tip_position)
    np.testing.assert_allclose(tips[1], tips[0], atol=1e-9)


def test_modal_damping_gives_its_ratio() -> None:
    ratio = 0.02
    run = released(2.0, 6.0, modal_damping=ratio, dt=1e-3)
    x = run.tip_position[:, 0]
    peaks = [i for i in range(1, len(x) - 1) if x[i] > x[i - 1] and x[i] >= x[i + 1]]
    first, last = peaks[2], peaks[-1]
    cycles = round((run.time[last] - run.time[first]) * 2.28)
    decrement = math.log(x[first] / x[last]) / cycles
    assert decrement == pytest.approx(2 * math.pi * ratio, rel=0.03)


# -- modes -----------------------------------------------------------------------------------


def test_modes_of_the_straight_robot() -> None:
    assert repr(modes(ROBOT, count=2)) == "<Modes of amouri2019: 2.28, 2.28 Hz>"
    found = modes(ROBOT)
    f = found.frequency_hz
    assert f[[0, 2, 4]] == pytest.approx([2.2804, 14.250, 27.96], rel=1e-3)
    assert f[[1, 3]] == pytest.approx(f[[0, 2]], rel=1e-9)  # any direction
    assert found.kind[:5] == ["bending"] * 4 + ["torsion"]
    refined = modes(ROBOT, model=bs.RodModel(elements=4))
    assert f == pytest.approx(refined.frequency_hz, rel=1e-4)


def test_modes_of_a_bare_rod_match_euler_bernoulli() -> None:
    bare = bare_rod("500 mm", 10, diameter="2 mm", E="70 GPa", density=2700)
    found = modes(bare, count=8, model=bs.RodModel("kirchhoff", elements=2))
    bending = found.frequency_hz[np.array(found.kind) == "bending"]
    radius = 1e-3
    speed = math.sqrt(70e9 * radius**2 / 4 / 2700)
    exact = np.array([1.875104, 4.694091, 7.854757]) ** 2 / (2 * math.pi * 0.5**2) * speed
    # rotary inertia reduces it by 1e-5 and more
    assert bending[[0, 2, 4]] == pytest.approx(exact, rel=2e-4)


# -- bad input -------------------------------------------------------------------------------


def test_whole_numbers_of_numpy_are_whole(tmp_path: Path) -> None:
    numbers: dict[str, Any] = {"points": np.int64(3), "elements": np.int64(2)}
    run = simulate(ROBOT, tendon_1(5), 0.02, **objects(**numbers, path=tmp_path / "run.nc"))
    assert run.converged and run.to_dataset().sizes["station"] == 27
    assert len(modes(ROBOT, count=np.int64(2))) == 2


def test_errors_carry_their_status() -> None:
    heavy = {"gravity": (0.0, 0.0, -981000.0)}
    for fails in (
        lambda: simulate(TWO, tendon_1(4000), 1.0),
        lambda: simulate(ROBOT, tendon_1(5), 0.1, **objects(**heavy)),
        lambda: modes(ROBOT, **objects(**heavy)),
    ):
        with pytest.raises(NoSolutionError, match=r"no equilibrium|no stable") as error:
            fails()
        assert error.value.status == "no_equilibrium"
        assert pickle.loads(pickle.dumps(error.value)).status == "no_equilibrium"
    run = simulate(TWO, ramp(tendon_1(4000), 0.1), 0.1)
    for found in (run, bs.solve(TWO, tendon_1(4000))):
        with pytest.raises(NoSolutionError) as error:
            found.raise_for_status()
        assert error.value.status == found.status != "converged"


@pytest.mark.parametrize(
    ("function", "text"),
    [
        (lambda t: tendon_1(float("nan")) if t > 0.05 else tendon_1(1), "nan.* at 0.0"),
        (lambda t: tendon_1(-1) if t > 0.05 else tendon_1(1), "tendon 1 is -1 N at 0.0"),
        (lambda t: [1.0], "returned shape"),
        (lambda t: tendon_1(1 / (0.05 - t)) if t >= 0.05 else tendon_1(1), "failed at|tendon 1 is"),
        (lambda t: {}["no\nsuch\nkey" * 99], "failed at 0 s: KeyError: 'no"),
    ],
)
def test_bad_functions_stop_the_run_and_keep_it(function: Any, text: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=text) as error:
        simulate(ROBOT, function, 0.1, **objects(dt=1e-3, path=tmp_path / "run.nc"))
    assert "\n" not in str(error.value) and len(str(error.value)) < 400
    if (tmp_path / "run.nc").exists():
        data = read_run(tmp_path / "run.nc")
        assert data.attrs["status"] == "failed"
        assert data.sizes["time"] == 0 or float(data.time[-1]) <= 0.051


def test_a_failed_run_reports_time_and_reason() -> None:
    run = simulate(TWO, ramp(tendon_1(4000), 4.0), 4.0, integrator=bs.Integrator(mass_damping=5.0))
    assert run.status in ("collision", "step_failed")
    assert 0 < run.end < 4.0 and f"{run.end:.6g} s" in run.message
    assert np.isfinite(run.tip_position).all()
    with pytest.raises(NoSolutionError, match="stopped at"):
        run.raise_for_status()


def test_function_with_a_ramp_that_ends_between_outputs() -> None:
    """0.7 is not 70 times 0.01 in floating point."""
    for rise in (0.35, 0.57, 0.7):
        run = simulate(
            ROBOT, ramp(tendon_1(40), rise), 0.8, load=bs.Load(tip_force=lambda t: [0.0, 0.0, 0.0])
        )
        plain = simulate(ROBOT, ramp(tendon_1(40), rise), 0.8)
        assert run.converged and len(run.time) == 81
        np.testing.assert_allclose(run.tip_position, plain.tip_position, atol=3e-4)


def test_no_rest_above_the_euler_load() -> None:
    """Above its Euler load, a straight robot is unstable under an axial force."""
    forces = np.zeros((9, 3))
    forces[-1] = [0.0, 0.0, -10.0]
    with pytest.raises(NoSolutionError, match="no stable equilibrium"):
        simulate(ROBOT, tendon_1(0), 0.1, start=bs.Start(disk_forces=forces))


def test_a_run_that_cannot_start_keeps_the_former_file(tmp_path: Path) -> None:
    file = tmp_path / "run.nc"
    simulate(ROBOT, tendon_1(5), 0.1, output=bs.Output(path=file))
    before = file.read_bytes()
    with pytest.raises(NoSolutionError):
        simulate(TWO, tendon_1(4000), 1.0, output=bs.Output(path=file))
    assert file.read_bytes() == before


def test_rare_outputs_do_not_make_long_steps() -> None:
    rare = simulate(ROBOT, ramp(tendon_1(80), 0.1), 0.1, output=bs.Output(every=5.0))
    often = simulate(ROBOT, ramp(tendon_1(80), 0.1), 0.1)
    assert np.linalg.norm(rare.tip_position[-1] - often.tip_position[-1]) < 0.5e-3


def test_times_outside_a_run_are_refused() -> None:
    run = simulate(ROBOT, tendon_1(5), 0.1)
    assert run.tip_at(0.05).shape == (1, 3)
    refused(r"from 0 to 0\.1 s", lambda: run.tip_at([0.05, 5.0]))


def test_modes_below_rounding_are_dropped() -> None:
    found = modes(ROBOT, count=1000)
    assert 20 < len(found) < 90 and found.frequency_hz[-1] < 1e7
    with pytest.raises(NoSolutionError, match=r"neutral|no stable"):
        modes(ROBOT, load=bs.Load(tip_force=[0.0, 0.0, -10.0]))


@pytest.mark.filterwarnings("error")
def test_modes_of_a_massless_backbone_are_those_of_its_disks() -> None:
    changes = {"segments.0.backbone.density": "0 kg/m^3", "segments.0.disks.count": "2"}
    found = modes(ROBOT.with_(changes), count=1000)
    assert len(found) == 12


@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
@pytest.mark.parametrize("count", [1, 8])
def test_a_start_under_a_moment_is_found(theory: Any, count: int) -> None:
    """A soft rod rotated far by a moment has a start wherever statics have a solution."""
    soft = {
        "segments.0.length": "0.4 m",
        "segments.0.backbone.diameter": "10 mm",
        "segments.0.backbone.E": "70 MPa",
        "segments.0.backbone.nu": "0.4",
        "segments.0.backbone.density": "1200 kg/m^3",
        "segments.0.disks.count": str(count),
        "segments.0.disks.mass": "1e-6 g",
        "segments.0.disks.radius": "12 mm",
        "segments.0.tendons.pitch_radius": "9 mm",
    }
    robot = bs.load_robot("amouri2019", overrides=soft)
    load: dict[str, Any] = {
        "gravity": [3.8678, -7.957, -4.2383],
        "tip_force": [-0.1082, -0.2535, -0.1185],
        "tip_moment": [0.0029, 0.0734, 0.0316],
        "theory": theory,
        "elements": 4,
    }
    start = bs.solve(robot, [0, 0, 0], **objects(**load)).raise_for_status().tip.position
    run = simulate(robot, [0, 0, 0], 0.02, **objects(**load, points=0)).raise_for_status()
    assert np.linalg.norm(run.tip_position - start, axis=1).max() < 1e-4 * robot.length


@pytest.mark.parametrize("jump", [0.0, 0.02])
def test_a_failed_jump_keeps_the_records_before_it(jump: float, tmp_path: Path) -> None:
    """After a jump beyond all bounds the motion stops at the jump, which is output once."""
    pull = Table([jump, jump], [tendon_1(0), tendon_1(1e9)])
    times = [0.0, 0.01, 0.02] if jump else [0.0]
    for out in (None, tmp_path / "run.nc"):
        run = simulate(ROBOT, pull, 0.05, output=bs.Output(path=out))
        assert run.status == "step_failed" and run.time.tolist() == times
        np.testing.assert_allclose(run.tip_at(run.end), [[0.0, 0.0, 0.641]], atol=1e-12)
        assert run.to_dataset().time.values.tolist() == times
        assert run.to_dataset().attrs["status"] == "step_failed"


def test_a_tolerance_of_steps_may_be_a_length_or_a_share() -> None:
    given = [1e-5, "0.01 mm", "1e-5", f"{1e-3 / 0.641} %"]
    schemes = [bs.Integrator(tolerance=each).scheme(0.641, 1.0) for each in given]
    assert [scheme.tolerance for scheme in schemes] == pytest.approx(4 * [1e-5], rel=1e-12)


@pytest.mark.filterwarnings("ignore::bowstring.errors.StabilityWarning")
def test_disk_forces_act_together_with_a_moment() -> None:
    holding = np.zeros((9, 3))
    holding[4, 0], holding[8, 1] = 2.0, 0.5
    load: dict[str, Any] = {"tip_moment": [0.3, 0.6, 0.2], "points": 0}
    run = simulate(ROBOT, tendon_1(10), 0.2, **objects(**load, disk_forces=holding))
    at_rest = bs.solve(
        ROBOT, tendon_1(10), load=bs.Load(tip_moment=load["tip_moment"])
    ).tip.position
    assert np.linalg.norm(run.tip_position[0] - at_rest) > 0.05  # until they are released
    assert np.linalg.norm(run.tip_position[-1] - run.tip_position[0]) > 0.01
    alone = np.zeros((9, 3))
    alone[8] = [0.4, 0.5, 0.0]
    held = simulate(ROBOT, tendon_1(10), 0.0, **objects(**load, disk_forces=alone))
    same = bs.solve(
        ROBOT, tendon_1(10), load=bs.Load(tip_force=alone[8], tip_moment=load["tip_moment"])
    )
    assert np.linalg.norm(held.tip_position[0] - same.tip.position) < 1e-5
