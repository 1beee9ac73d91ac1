"""The tension ramp of the study: against theory, its own runs, and failures."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics import simulation
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.study.comparison import COMPARISONS, Theory
from bowstring.study.figure_list import FIGURES
from bowstring.study.ramp_response import Transient
from bowstring.study.study import Study
from stages import Stages

MM = 1e-3
FREQUENCY = 2.2804  # Hz, of the study's robot, from shared references of other programs


@pytest.fixture(scope="module")
def slow(paper: Study) -> Transient:
    assert paper.dynamics is not None
    return paper.dynamics


# -- the motion --------------------------------------------------------------------------------


def test_the_ramp_is_as_requested(slow: Transient) -> None:
    assert slow.converged
    assert slow.frequency == pytest.approx(FREQUENCY, rel=1e-3)
    assert slow.rise == pytest.approx(20 / FREQUENCY, rel=1e-3)
    assert slow.time[0] == 0.0 and slow.time[-1] == pytest.approx(slow.rise + slow.hold)
    assert slow.tension == pytest.approx(np.interp(slow.time, [0.0, slow.rise], [0.0, 80.0]))


def test_the_slow_ramp_is_near_statics(slow: Transient, paper: Study) -> None:
    """The reason for the defaults, and the value in the report."""
    assert slow.mean_difference < 1e-3 * paper.length
    largest, at = slow.max_difference
    assert largest < 6e-3 * paper.length and at < 5.0
    # a ramp of twice the duration has half the oscillation, at half as many loads
    slower = Stages(paper.robot, rise=2 * slow.rise).motion
    assert slower.mean_difference < 0.5 * slow.mean_difference
    assert slower.max_difference[0] < 0.6 * slow.max_difference[0]


def test_lag_and_distance_from_statics_by_damping(slow: Transient, paper: Study) -> None:
    """x'' + 2 zeta omega x' + omega^2 x follows a ramp with a delay of 2 zeta / omega."""
    motions = {ratio: Stages(paper.robot, modal_damping=ratio).motion for ratio in (0.02, 0.1)}
    motions[0.05] = slow
    for ratio, motion in motions.items():
        assert motion.lag == pytest.approx(2 * ratio / (2 * math.pi * FREQUENCY), rel=0.15)
    assert min(motions, key=lambda ratio: motions[ratio].mean_difference) == 0.05


def test_overshoot_matches_the_run(slow: Transient, paper: Study) -> None:
    """Computed again from a run with shorter steps and outputs of its own."""
    assert slow.peak is not None
    when, size = slow.peak
    run = simulation.simulate(
        paper.robot,
        bs.dynamics.ramp([80.0, 0.0, 0.0], slow.rise),
        slow.rise + slow.hold,
        integrator=bs.Integrator(modal_damping=0.05, tolerance=2e-8 * paper.length),
        output=bs.Output(every=slow.rise / 2000),
    )
    end = bs.solve(paper.robot, [80.0, 0.0, 0.0]).tip
    before = bs.solve(paper.robot, [79.99, 0.0, 0.0]).tip
    assert end is not None and before is not None
    ahead = (end.position - before.position) / np.linalg.norm(end.position - before.position)
    beyond = (run.tip_position - end.position) @ ahead
    beyond[run.time < slow.rise] = 0.0
    assert size == pytest.approx(beyond.max(), rel=2e-3)
    assert when == pytest.approx(run.time[beyond.argmax()], abs=0.02 / FREQUENCY)
    assert slow.rise < when < slow.rise + 0.5 / FREQUENCY
    assert slow.residual < size


def test_a_fast_ramp_differs_from_statics(slow: Transient, paper: Study) -> None:
    found = Stages(paper.robot, rise=0.5)
    fast = found.motion
    assert not fast.rise_chosen and slow.rise_chosen
    assert fast.peak is not None and slow.peak is not None
    assert fast.peak[1] > 10 * slow.peak[1]
    assert fast.mean_difference > 10 * slow.mean_difference
    assert any(f"overshoots by {fast.peak[1] * 1e3:.3g} mm" in s for s in fast.text)
    # quasi-static results are the same
    assert found.verdict.text == paper.verdict.text
    assert found.budget.to_dict() == paper.budget.to_dict()
    for name in COMPARISONS:
        assert found.comparisons[name].to_dict() == paper.comparison(name).to_dict()


def test_strong_damping_leaves_no_overshoot(paper: Study) -> None:
    motion = Stages(paper.robot, modal_damping=0.95).motion
    assert motion.peak is not None and 0.0 <= motion.peak[1] < 1e-2 * MM


# -- stress and strain -------------------------------------------------------------------------


def test_static_stress_is_that_of_the_fields(paper: Study) -> None:
    whole = bs.solve(paper.robot, [80.0, 0.0, 0.0]).to_dataset(points=9)
    surface = paper.statics.surface
    assert surface.von_mises[-1] == pytest.approx(float(whole.von_mises_max[0]), rel=1e-6)
    assert surface.normal_stress[-1] == pytest.approx(float(whole.normal_stress.max()), rel=1e-6)
    # Hooke's law along the backbone
    assert surface.strain == pytest.approx(surface.normal_stress / 35e9, rel=1e-9)
    assert surface.von_mises[0] == pytest.approx(0.0, abs=1.0)


@pytest.mark.parametrize("gravity", ["0 0 9.81 m/s^2", "0 0 -9.81 m/s^2", "9.81 0 0 m/s^2"])
def test_weight_and_clamps_have_static_stress(gravity: str) -> None:
    source = Path(__file__).parents[1] / "examples" / "my_robot.yaml"
    robot = load_robot(source).with_({"gravity": gravity})
    found = Stages(robot, points=3, tendon=5)
    tensions = [0.0, 0.0, 0.0, 0.0, found.settings.max_tension, 0.0, 0.0, 0.0]
    whole = bs.solve(robot, tensions).to_dataset()
    assert found.statics.surface.von_mises[-1] == pytest.approx(
        float(whole.von_mises_max[0]), rel=1e-3
    )
    assert np.isfinite(found.statics.surface.strain).all()


def test_stress_in_time_ends_at_the_static_stress(slow: Transient, paper: Study) -> None:
    still = np.interp(slow.tension, paper.statics.tension, paper.statics.surface.von_mises)
    late = slow.time > 0.8 * slow.rise
    assert slow.surface.von_mises[late] == pytest.approx(still[late], rel=0.02)


# -- constant curvature against it -------------------------------------------------------------


def test_constant_curvature_against_the_slow_ramp(slow: Transient, paper: Study) -> None:
    for name in COMPARISONS:
        still, moved = paper.comparison(name), paper.comparison(name, "dynamics")
        assert moved.against == "dynamics" and moved.n == still.n == 17
        # the two tips are that far apart
        assert abs(moved.mean - still.mean) < 1e-3 * paper.length
    lengths = paper.comparison("cc_from_lengths", "dynamics")
    assert lengths.mean / MM == pytest.approx(0.284, abs=2e-3)
    force = paper.comparison("cc_from_force", "dynamics")
    assert force.mean / MM == pytest.approx(4.346, abs=3e-3)
    at_loads = np.array([np.interp(20.0, slow.tension[:481], x[:481]) for x in slow.tip_position.T])
    assert force.tip_position[4] - force.difference[4] == pytest.approx(at_loads, abs=1e-9)


@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
@pytest.mark.parametrize("source", ["rao2021", "clamped", "upright"])
def test_other_robots(source: str, theory: Theory) -> None:
    changes = {
        "rao2021": {},
        "clamped": {"segments.0.disks.clamped_length": "3 mm"},
        "upright": {"gravity": "0 0 -9.81 m/s^2"},
    }[source]
    robot = load_robot("rao2021" if source == "rao2021" else "amouri2019").with_(changes)
    found = Stages(robot, theory=theory, points=5, tendon=len(robot.tendons.segment) - 2)
    motion = found.motion
    assert motion.converged
    assert motion.mean_difference < 1e-3 * robot.length
    assert motion.tip_position[0] == pytest.approx(found.statics.tip_position[0], abs=1e-7)
    for name in COMPARISONS:
        assert found.in_time[name].n == 5


# -- failed and partial motions ----------------------------------------------------------------


def test_a_robot_without_mass_has_statics_only(paper: Study) -> None:
    light = {"segments.0.disks.mass": "0 g", "segments.0.backbone.density": "0 kg/m^3"}
    stages = Stages(load_robot("amouri2019").with_(light))
    motion, why_not = stages.ramp
    found = replace(stages.over(paper), dynamics=motion, without_dynamics=why_not)
    assert found.dynamics is None
    assert found.dynamics_text == (
        "Dynamics is left out: amouri2019 has no mass: it has no natural frequencies.",
    )
    got = found.to_dict()
    assert [c["against"] for c in got["comparisons"]] == ["statics"] * 7  # and three fits
    assert got["dynamics"] == {"status": "left_out", "text": list(found.dynamics_text)}
    assert len(got["figures"]) == len(FIGURES) - 1
    assert found.comparison("cc_from_force").mean / MM == pytest.approx(4.423, abs=5e-3)


@pytest.mark.parametrize("reason", ["collision", "step_failed"])
def test_a_motion_that_stops_is_shown_up_to_there(
    monkeypatch: pytest.MonkeyPatch, reason: str, paper: Study
) -> None:
    whole = simulation.simulate

    def stops(robot: Robot, tensions: Any, duration: float, **options: Any) -> simulation.Run:
        run = whole(robot, tensions, 0.4 * duration, **options)
        run.status, run.reason = reason, simulation._WHY[reason]  # type: ignore[assignment]
        return run

    monkeypatch.setattr(simulation, "simulate", stops)
    found = Stages(load_robot("amouri2019"))
    motion = found.motion
    # 40 % of 25 periods are half of the rise
    assert motion.tension[-1] == pytest.approx(40.0)
    assert motion.peak is None and math.isnan(motion.residual)
    assert found.in_time["cc_from_force"].n == 9
    assert found.comparisons["cc_from_force"].n == 17
    text = " ".join(motion.text)
    assert "The motion stopped at 4.39 s, at 40 N: " + motion.reason in text
    assert "overshoot" not in text
    assert any("do not compare their means" in note for note in found.notes(found.in_time))
    claim = found.claim(found.in_time)
    assert claim is not None and "against dynamics" not in claim.text
    got = replace(found.over(paper), dynamics=motion).to_dict()
    assert got["dynamics"]["overshoot_mm"] is None
    json.dumps(got, allow_nan=False)


@pytest.mark.slow
def test_colliding_disks_end_the_motion() -> None:
    found = Stages(load_robot("amouri2019"), max_tension=900.0, rise=0.115)
    motion = found.motion
    assert motion.status == "collision" and motion.time[-1] < motion.rise
    assert "two neighbouring disks met" in motion.text[1]
    assert 0 < found.in_time["cc_from_force"].n < 17


@pytest.mark.parametrize("rise", [0.1, 1e6])
def test_a_rise_beyond_its_range_is_bad_input(rise: float) -> None:
    with pytest.raises(InputError, match=r"must be from 0\.11 to 87\.7 s"):
        _ = Stages(load_robot("amouri2019"), rise=rise).ramp
