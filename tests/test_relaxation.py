"""Relaxation of the backbone and creep of the tendons: closed forms, limits, fit."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.errors import InputError
from bowstring.study.actuation_budget import actuation_budget
from bowstring.study.comparison import Model
from stages import law_rows

SHARE, TIME = 0.3, 20.0
RELAXES = {
    "segments.*.backbone.relaxation": SHARE,
    "segments.*.backbone.relaxation_time": f"{TIME} s",
}
COMPLIANCE, CREEP = 2e-5, 3e-5  # m/N
CREEPS = {
    "segments.*.tendons.compliance": COMPLIANCE,
    "segments.*.tendons.creep_compliance": CREEP,
    "segments.*.tendons.creep_time": f"{TIME} s",
}
ELASTIC = bs.load_robot("amouri2019")
VISCOELASTIC = bs.load_robot("amouri2019", RELAXES)
CREEPING = bs.load_robot("amouri2019", CREEPS)


def bends(moments, times, robot=VISCOELASTIC):
    """Bends (n,) about x in rad under tip moments (N m) at these times (s)."""
    load = bs.Load(np.zeros((len(times), 3)), tip_moment=np.outer(moments, [1.0, 0.0, 0.0]))
    found = bs.sweep(robot, load=load, times=times)
    assert found.converged.all()
    tangent = found.tip_rotation[:, :, 2]
    return np.arctan2(-tangent[:, 1], tangent[:, 2])


def test_under_a_constant_moment_the_bend_creeps_by_the_closed_form():
    moment = 0.8 * ELASTIC.bending_stiffness[0] / ELASTIC.length

    def worst(steps):
        times = np.linspace(0.0, 3 * TIME, steps + 1)
        found = bends(np.full(steps + 1, moment), times)
        late = 1.0 - np.exp(-(1.0 - SHARE) * times / TIME)
        expected = found[0] * (1.0 + SHARE / (1.0 - SHARE) * late)
        return np.abs(found - expected).max() / found[0]

    assert worst(60) < 2e-4
    # second order in the time from row to row
    assert worst(15) / worst(60) == pytest.approx(16, rel=0.2)


@pytest.mark.parametrize("dead", [{}, {"gravity": (0.0, -9.81, 0.0), "tip_force": (0.3, 0.2, 0)}])
@pytest.mark.parametrize("disks", [5, 10, 20])
def test_the_first_answer_is_elastic_and_the_last_has_the_relaxed_stiffness(disks, dead):
    """Both within the stated error."""
    own = {"nu": None, "G": 13.5e9}  # torsion does not relax
    changes = {f"segments.0.backbone.{name}": value for name, value in own.items()}
    elastic = ELASTIC.with_({**changes, "segments.0.disks.count": disks})
    # nor does the axial strain; the elements are the same for all
    kirchhoff = bs.RodModel("kirchhoff", elements=4)
    tensions = [30.0, 5.0, 0.0]

    def alone(robot):
        return bs.solve(robot, load=bs.Load(tensions, **dead), model=kirchhoff).tip.position

    load = bs.Load([tensions] * 2, **dead)
    found = bs.sweep(elastic.with_(RELAXES), load=load, model=kirchhoff, times=[0.0, 1e9])
    soft = elastic.with_({"segments.0.backbone.E": (1.0 - SHARE) * elastic.segments[0].backbone.E})
    off = np.linalg.norm(found.tip_position - [alone(elastic), alone(soft)], axis=1)
    assert (off < found.tip_error + 1e-10).all() and found.tip_error.max() < 1e-6
    assert alone(elastic.with_(RELAXES)) == pytest.approx(alone(elastic), abs=1e-9)


SECOND, SECOND_TIME = 0.2, 150.0
TWICE = VISCOELASTIC.with_(
    {
        "segments.*.backbone.second_relaxation": SECOND,
        "segments.*.backbone.second_relaxation_time": f"{SECOND_TIME} s",
    }
)


def test_under_a_constant_moment_two_time_constants_creep_by_the_closed_form():
    """EI (k - s1 v1 - s2 v2) = M with tau v' = k - v, by the matrix exponential."""
    from scipy.linalg import expm

    moment = 0.8 * ELASTIC.bending_stiffness[0] / ELASTIC.length
    shares, rates = np.array([SHARE, SECOND]), 1.0 / np.array([TIME, SECOND_TIME])
    matrix = rates[:, None] * (shares[None, :] - np.eye(2))

    def worst(steps):
        times = np.linspace(0.0, 2 * SECOND_TIME, steps + 1)
        found = bends(np.full(steps + 1, moment), times, robot=TWICE)
        # v' = matrix v + rates k0, with the curvature at once k0 = 1
        rest = -np.linalg.solve(matrix, rates)
        lags = np.stack([rest - expm(t * matrix) @ rest for t in times])
        return np.abs(found / found[0] - (1.0 + lags @ shares)).max()

    assert worst(120) < 1e-3
    assert worst(60) / worst(120) == pytest.approx(4, rel=0.25)  # second order


def test_two_time_constants_rest_at_the_stiffness_that_neither_relaxes():
    moment = 0.5 * ELASTIC.bending_stiffness[0] / ELASTIC.length
    found = bends([moment] * 2, [0.0, 1e9], robot=TWICE)
    assert found[1] == pytest.approx(found[0] / (1.0 - SHARE - SECOND), rel=1e-4)


def test_two_time_constants_of_creep_add_up():
    second = {
        "segments.*.tendons.second_creep_compliance": 2e-5,
        "segments.*.tendons.second_creep_time": "200 s",
    }
    times = np.array([0.0, 3.0, 70.0, 500.0])
    tensions = np.array([20.0, 3.0, 0.0])
    found = bs.sweep(CREEPING.with_(second), np.tile(tensions, (4, 1)), times=times)
    grown = found.displacements() - found.displacements()[0]
    terms = CREEP * -np.expm1(-times / TIME) + 2e-5 * -np.expm1(-times / 200.0)
    assert grown == pytest.approx(np.outer(terms, tensions), abs=1e-12)


def test_a_history_of_one_time_constant_continues():
    """Histories of earlier versions have one term."""
    robot = VISCOELASTIC.with_(CREEPS)
    rows = bs.Load(displacements=np.outer([0.01, 0.03, 0.02], [1.0, -0.5, -0.5]))
    stored = bs.sweep(robot, load=rows, times=[1.0, 9.0, 14.0]).history()
    old = {
        **stored,
        "lags_per_m": [row[:2] for row in stored["lags_per_m"]],
        "creep_m": [row[0] for row in stored["creep_m"]],
    }
    now, then = (
        bs.sweep(robot, np.zeros((1, 3)), times=[5.0], history=each) for each in (stored, old)
    )
    assert np.array_equal(now.tip_position, then.tip_position)


def test_fit_finds_two_time_constants():
    names = ["relaxation", "relaxation_time", "second_relaxation", "second_relaxation_time"]
    paths = [f"segments.0.backbone.{name}" for name in names]
    values = [0.15, 8.0, 0.2, 120.0]
    truth = ELASTIC.with_(dict(zip(paths, values, strict=True)))
    size = np.repeat([10.0, 40.0, 5.0, 30.0, 0.0], 16)
    tensions = np.concatenate([np.outer(size, row) for row in np.eye(3)])
    times = np.cumsum(np.tile(np.geomspace(1.0, 30.0, 16), 15))
    noise = np.random.default_rng(2).normal(0.0, 1e-4, (len(tensions), 3))
    tips = bs.sweep(truth, tensions, times=times).tip_position + noise  # synthetic
    data = Data(points=tips, tensions=tensions, time=times)
    start = ELASTIC.with_(dict(zip(paths, [0.1, 5.0, 0.1, 200.0], strict=True)))
    found = fit(start, data, [*paths, "segments.0.backbone.E"], loss="linear")
    assert found.converged
    for path, exact in zip(paths, values, strict=True):
        assert abs(found.values[path] - exact) < 3.5 * found[path].standard_error
        assert found[path].standard_error < 0.15 * exact


def test_under_constant_tensions_the_displacements_creep_exactly():
    times = np.array([0.0, 3.0, 7.0, 7.0, 100.0])
    tensions = np.array([20.0, 3.0, 0.0])
    found = bs.sweep(CREEPING, np.tile(tensions, (5, 1)), times=times)
    displacements = found.displacements()
    grown = displacements - displacements[0]
    expected = CREEP * np.outer(1.0 - np.exp(-times / TIME), tensions)
    assert grown == pytest.approx(expected, abs=1e-12)
    assert found.tip_position == pytest.approx(np.tile(found.tip_position[0], (5, 1)), abs=1e-12)


def test_a_ramp_of_tension_creeps_exactly_in_one_step():
    times = np.array([0.0, 12.0])
    tensions = np.array([[0.0, 0.0, 0.0], [24.0, 0.0, 0.0]])
    found = bs.sweep(CREEPING, tensions, times=times)
    elastic = bs.sweep(bs.load_robot("amouri2019", {**CREEPS, **no_creep()}), tensions)
    crept = found.displacements()[1, 0] - elastic.displacements()[1, 0]
    rate, t = 2.0, times[1]
    assert crept == pytest.approx(CREEP * rate * (t - TIME * -math.expm1(-t / TIME)), rel=1e-9)


def no_creep():
    return {"segments.*.tendons.creep_compliance": 0.0}


def test_a_preload_relaxes_by_the_closed_form():
    preload = 10.0
    robot = CREEPING.with_({"segments.0.tendons.pretension": preload})
    kirchhoff = bs.RodModel("kirchhoff")  # no axial strain of the backbone
    times = np.linspace(0.0, 2 * TIME, 161)
    load = bs.Load(displacements=np.zeros((len(times), 3)))
    found = bs.sweep(robot, load=load, model=kirchhoff, times=times)
    assert found.converged.all()
    lost = CREEP / (COMPLIANCE + CREEP) * -np.expm1(-times * (1 + CREEP / COMPLIANCE) / TIME)
    expected = np.repeat(preload * (1.0 - lost)[:, None], 3, axis=1)
    assert found.tensions == pytest.approx(expected, rel=2e-4)


def test_friction_hysteresis_and_relaxation_go_together():
    robot = VISCOELASTIC.with_(
        {
            **CREEPS,
            "segments.*.tendons.friction": 0.1,
            "segments.*.backbone.hysteresis": 0.1,
            "segments.*.backbone.hysteresis_play": "5 deg",
        }
    )
    up = np.linspace(0.0, 0.03, 12)
    first = np.concatenate([up, up[::-1], np.zeros(6)])
    displacements = np.column_stack([first, -0.5 * first, -0.5 * first])
    times = 4.0 * np.arange(len(first))
    found = bs.sweep(robot, load=bs.Load(displacements=displacements), times=times)
    assert found.converged.all()
    # it comes back late, and goes on returning while the motors stand still
    late = np.linalg.norm(found.tip_position[-6:, :2], axis=1)
    assert late[0] > 1e-3 and (np.diff(late) < 0).all()


def test_a_history_keeps_the_estimated_error_and_the_time_without_a_solution():
    robot = VISCOELASTIC.with_({**CREEPS, "segments.0.disks.count": 4})
    force = np.array([[0.4, 0.0, 0.0], [0.0, 0.0, 0.0]])
    load = bs.Load(np.full((2, 3), 1.0), tip_force=force)
    whole = bs.sweep(robot, load=load, times=[1e3, 1e3])
    first = bs.sweep(robot, load=bs.Load(np.ones((1, 3)), tip_force=force[:1]), times=[1e3])
    rest = bs.sweep(robot, load=bs.Load(np.ones((1, 3))), times=[0.0], history=first.history())
    assert rest.tip_error[0] >= max(first.tip_error[0], whole.tip_error[1]) > 1e-9

    rows = np.array([[0.02, -0.01, -0.01], [0.1, 0.1, 0.1], [0.02, -0.01, -0.01]])
    whole = bs.sweep(CREEPING, load=bs.Load(displacements=rows), times=[1.0, 40.0, 50.0])
    begun = bs.sweep(CREEPING, load=bs.Load(displacements=rows[:2]), times=[1.0, 40.0])
    stored = json.loads(json.dumps(begun.history()))
    assert not begun.converged[1] and stored["time_since_last_solution_s"] == 39.0
    rest = bs.sweep(CREEPING, load=bs.Load(displacements=rows[2:]), times=[10.0], history=stored)
    assert rest.tensions[0] == pytest.approx(whole.tensions[2], rel=1e-9)


def test_rows_that_do_not_follow_each_other_have_their_whole_time():
    tensions = [[40.0, 0, 0]] * 3
    apart = bs.sweep(VISCOELASTIC, tensions, times=[100.0, 200.0, 200.001], warm=False)
    alone = [bs.sweep(VISCOELASTIC, [tensions[0]], times=[t]) for t in (100.0, 200.0, 200.001)]
    expected = [each.tip_position[0] for each in alone]
    assert apart.tip_position == pytest.approx(np.array(expected), abs=1e-9)


def test_time_in_a_row_without_a_solution_passes():
    load = bs.Load(displacements=np.array([[0.02, -0.01, -0.01], [0.1, 0.1, 0.1], [0.0, 0, 0]]))
    found = bs.sweep(CREEPING, load=load, times=[1.0, 30.0, 31.0])
    assert found.converged.tolist() == [True, False, True]
    kept = bs.Load(displacements=load.displacements[[0, 2]])
    without = bs.sweep(CREEPING, load=kept, times=[1.0, 31.0])
    assert found.tip_position[2] == pytest.approx(without.tip_position[1], abs=1e-9)


@pytest.mark.parametrize(
    ("time", "says"),
    [
        (["now"] * 20, r"time must be \(20,\) numbers in s"),
        ([*range(19), np.nan], "needs the time of each row, and row 20 has none"),
        (None, "relaxation or creep needs the time of each row, and the measurements have none"),
    ],
)
def test_a_fit_names_missing_times(time, says):
    tensions = np.outer(np.linspace(0.0, 40.0, 20), [1.0, 0.0, 0.0])
    tips = bs.sweep(ELASTIC, tensions).tip_position
    data = Data(points=tips, tensions=tensions, time=time)
    name = "segments.0.backbone.relaxation"
    with pytest.raises(InputError, match=says):
        fit(ELASTIC, data, ["segments.0.backbone.E", name], start={name: 0.1})


def test_the_error_budget_has_rows_of_relaxation_and_creep():
    tension = np.linspace(0.0, 60.0, 5)
    lasting = ELASTIC.with_(
        {
            "segments.0.backbone.relaxation": 0.2,
            "segments.0.backbone.relaxation_time": "30 s",
            "segments.0.tendons.creep_compliance": "0.01 mm/N",
            "segments.0.tendons.creep_time": "100 s",
        }
    )
    found, rows = law_rows(lasting, ELASTIC)
    assert list(rows)[-2:] == ["relaxation", "creep"]
    # once at rest the backbone bends as one of 0.8 of the stiffness does at once
    soft = ELASTIC.with_({"segments.0.backbone.E": 0.8 * ELASTIC.segments[0].backbone.young})
    at_rest = bs.sweep(soft, np.outer(tension, [1.0, 0.0, 0.0])).tip_position
    tip = rows["relaxation"].case.tip_position
    assert abs(tip - at_rest).max() < 0.01 * rows["relaxation"].moved
    assert rows["relaxation"].moved > 5e-3
    # once at rest the tendons give as those of that compliance do at once
    crept = rows["creep"].case.tip_position
    model = Model(ELASTIC.with_({"segments.0.tendons.compliance": "0.01 mm/N"}), 0, "cosserat")
    with_compliance = actuation_budget(model, tension, model.case(model.main, tension))
    elastic_tip = with_compliance.row("tendon_elasticity").case.tip_position
    np.testing.assert_allclose(crept, elastic_tip, atol=1e-6)
    assert rows["creep"].moved > 1e-4
    assert sum("held until the robot rests" in text for text in found.text) == 2
