"""Initial state of a path that does not begin in the home pose: prediction, fit, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import Commands, TipModel
from objects import followed, refused

ROBOT = bs.load_robot("amouri2019")
TENDONS = np.arange(3)
BACKBONE = "segments.0.backbone."
MEMORIES = {
    "friction": {"segments.0.tendons.friction": 0.1, "segments.0.tendons.compliance": 1e-4},
    "hysteresis": {BACKBONE + "hysteresis": 0.3, BACKBONE + "hysteresis_play": 0.2},
    "relaxation": {BACKBONE + "relaxation": 0.3, BACKBONE + "relaxation_time": 30.0},
    "creep": {
        "segments.0.tendons.creep_compliance": 3e-5,
        "segments.0.tendons.creep_time": 30.0,
        "segments.0.tendons.pretension": 5.0,
    },
}


def course(count, seed=0):
    """Smooth displacements (count, 3) of a bend that turns, m."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, count)
    bend = 0.02 * (0.5 + 0.4 * np.sin(9 * t + rng.uniform(0, 6)))
    towards = 2.0 * np.sin(5 * t + rng.uniform(0, 6))
    return bend[:, None] * np.cos(towards[:, None] - 2 * np.pi * TENDONS / 3)


BEFORE = 0.5 * course(6)[0]
"""Displacements at rest before the first row, less those of the first row, m."""
INITIAL = {f"initial_displacement.0.{t}": BEFORE[t] for t in TENDONS}


def predicted(robot, values, *, start=(), recording=None, time=None):
    """Tips (K, 3) by the model of a fit."""
    by_displacement = np.ones(values.shape, bool)
    commands = Commands(by_displacement, values, time, recording)
    model = TipModel(Unknowns(robot, [], dict(start)), commands, bs.RodModel(elements=1))
    return model.predict(np.zeros(0)).point


@pytest.mark.parametrize("memory", MEMORIES)
def test_a_path_begins_at_the_commands_before_it(memory):
    robot = ROBOT.with_(MEMORIES[memory])
    rows = course(6)
    times = np.array([0.0, 2.0, 4.0, 9.0, 10.0, 12.0])
    found = predicted(robot, rows, start=INITIAL, time=times)
    whole = bs.sweep(
        robot,
        load=bs.Load(displacements=np.vstack((rows[0] + BEFORE, rows))),
        model=bs.RodModel(elements=1),
        times=np.concatenate(([1e15], 1e15 + times)),
    )
    assert found == pytest.approx(whole.tip_position[1:], abs=1e-9)
    from_home = predicted(robot, rows, time=times)
    assert np.linalg.norm(from_home - found, axis=1).max() > 1e-5


def test_a_tendon_begins_at_the_tension_at_rest():
    """The creep of a tendon that holds a tension for long is that tension times its compliance."""
    robot = ROBOT.with_(MEMORIES["creep"])
    rest = np.array([20.0, 3.0, 0.0])
    start = {f"initial_tension.0.{t}": rest[t] for t in TENDONS}
    rows, times = course(4), np.array([0.0, 1.0, 2.0, 3.0])
    found = predicted(robot, rows, start=start, time=times)
    model = bs.RodModel(elements=1)
    first = bs.sweep(robot, rest[None], model=model, times=[1e15])
    later = bs.sweep(
        robot,
        load=bs.Load(displacements=rows),
        model=model,
        times=times,
        history=first.history(),
    )
    assert found == pytest.approx(later.tip_position, abs=1e-9)


def test_backlash_begins_within_its_play():
    rows = course(12)
    start = {"backlash": 5e-4, **INITIAL}
    found = predicted(ROBOT, rows, start=start)
    load = bs.Load(displacements=followed(rows, 5e-4, rows[0] + BEFORE))
    at = bs.solve_batch(ROBOT, load=load, model=bs.RodModel(elements=1)).tip_position
    assert found == pytest.approx(at, abs=1e-9)


@pytest.mark.parametrize(
    ("law", "held"), [(MEMORIES["hysteresis"], {}), ({}, {"backlash": 4e-4, "delay": 0.3})]
)
def test_each_recording_has_its_own_state(law, held):
    robot = ROBOT.with_(law)
    rows, time = np.vstack((course(4), course(5, 1))), np.r_[np.arange(4.0), np.arange(5.0)]
    recording = np.repeat([3, 7], [4, 5])
    second = {name.replace("displacement.0", "displacement.1"): v for name, v in INITIAL.items()}
    found = predicted(robot, rows, start=second | held, recording=recording, time=time)
    assert np.array_equal(found[:4], predicted(robot, rows[:4], start=held, time=time[:4]))
    alone = predicted(robot, rows[4:], start=INITIAL | held, time=time[4:])
    assert np.array_equal(found[4:], alone)


@pytest.fixture(scope="module")
def begun():
    """Synthetic table that begins in the middle of a path of a drive with backlash."""
    rows = course(80)
    load = bs.Load(displacements=followed(rows, 4e-4, rows[0]))
    tips = bs.solve_batch(ROBOT, load=load).tip_position
    noise = np.random.default_rng(3).normal(0.0, 5e-5, tips.shape)
    cut = slice(20, None)
    return Data(points=(tips + noise)[cut], displacements=rows[cut], time=np.arange(60.0))


def test_a_fit_finds_the_initial_state(begun):
    known = fit(ROBOT, begun, ["backlash", "gain", "initial_displacement"], loss="linear")
    from_home = fit(ROBOT, begun, ["backlash", "gain"], loss="linear")
    assert known.converged
    error = abs(known.values["backlash"] - 4e-4)
    assert error < 3 * known["backlash"].standard_error * 1e-3 < 3e-5
    off = np.linalg.norm(from_home.residuals[:10], axis=1).max()
    assert np.linalg.norm(known.residuals, axis=1).max() < 3e-4 < off
    # the state belongs to this recording
    assert "initial_displacement.0.0" in known.names
    assert not any(name.startswith("initial") for name in known.outside_robot)
    assert known.predict(begun) == pytest.approx(begun.points + known.residuals, abs=1e-9)
    other = replace(begun, time=begun.time + 1.0)
    held = {name: v for name, v in known.values.items() if not name.startswith("initial")}
    alone = predicted(ROBOT, np.asarray(begun.displacements), start=held)
    assert known.predict(other) == pytest.approx(alone, abs=1e-9)
    assert np.linalg.norm(known.predict(other) - known.predict(begun), axis=1).max() > 2e-4


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["backlash", "initial_displacement.1"], "is of path 1; the rows have path 0 only"),
        (["backlash", "initial_displacement.0.3"], r"there is no parameter .*displacement\.0\.3"),
        (["backlash", "initial_tension"], "the state of a memory, and this model has none"),
        (
            ["segments.0.tendons.friction", "initial_displacement", "initial_tension"],
            r"displacement\.0\.0 and initial_tension\.0\.0 are of the same tendon",
        ),
        (["gain", "initial_displacement"], "the state of a memory, and this model has none"),
    ],
)
def test_an_initial_state_that_cannot_be_is_refused(begun, names, says):
    refused(says, lambda: fit(ROBOT, begun, names))
