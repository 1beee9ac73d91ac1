"""Clearance of tendons in their holes, as a parameter of a fit."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.calibration.observations import commands
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import TipModel
from bowstring.errors import InputError

CLEARANCE = 3e-4
SEGMENTS = [f"segments.{i}.tendons" for i in range(3)]
ROBOT = bs.load_robot("crl-ftdcr-v4", {f"{each}.compliance": "0.1 mm/N" for each in SEGMENTS})


def displacements(count, seed):
    """Displacements (n, 6) in m: random tensions, none slack."""
    rng = np.random.default_rng(seed)
    tensions = rng.uniform(0.3, 4.0, (count, ROBOT.core.tendon_count))
    return bs.sweep(ROBOT, tensions).displacements()


def listed(robot):
    """The robot with its rings of tendons as lists."""
    return robot.with_(
        {
            f"segments.{i}.tendons": [t.model_dump(exclude_none=True) for t in s.tendon_list]
            for i, s in enumerate(robot.segments)
        }
    )


def bends(robot, rotations):
    """Bends (n, T) in rad from the base to the end disks of the tendons."""
    base = np.tile([0, 0, 1.0], (len(rotations), 1, 1))
    axes = np.concatenate([base, rotations[..., 2]], axis=1)
    turns = np.arccos(np.clip((axes[:, 1:] * axes[:, :-1]).sum(axis=-1), -1, 1))
    return np.cumsum(turns, axis=1)[:, robot.tendons.end_disk]


def tips(robot, given, clearance):
    """Synthetic tips (n, 3): the fixed point of theory Eq. 4.10, with bends from disk to disk."""
    lost = np.zeros(given.shape)
    for _ in range(30):
        found = bs.solve_batch(robot, load=bs.Load(displacements=given - lost))
        assert found.converged.all()
        lost = clearance * bends(robot, found.disk_rotations)
    return found.tip_position


def test_fit_finds_the_clearance():
    given = displacements(60, 1)
    data = Data(points=tips(ROBOT, given, CLEARANCE), displacements=given)
    found = fit(ROBOT, data, ["hole_clearance"], loss="linear")
    assert found.converged, found.message
    assert found["hole_clearance"].value == pytest.approx(1e3 * CLEARANCE, abs=1e-4)
    assert found.score.rmse < 1e-6
    assert found.score_before.rmse > 1e-3


@pytest.mark.parametrize("friction", [0.0, 0.05])
def test_the_rod_solves_the_fixed_point(friction):
    """With friction along the path: the same path by displacements less what is lost."""
    fields = {f"{each}.friction": friction for each in SEGMENTS}
    without = ROBOT.with_(fields)
    robot = ROBOT.with_({**fields, **{f"{each}.hole_clearance": CLEARANCE for each in SEGMENTS}})
    given = displacements(20, 5)
    found = bs.sweep(robot, load=bs.Load(displacements=given))
    assert found.converged.all()
    left = given - CLEARANCE * bends(robot, found.disk_rotations)
    expected = bs.sweep(without, load=bs.Load(displacements=left))
    assert found.tip_position == pytest.approx(expected.tip_position, abs=1e-8)
    assert found.displacements() == pytest.approx(given, abs=1e-12)


def test_a_path_goes_on_from_its_history():
    """With a memory of displacements: the home pose has other losses than the stored one."""
    robot = bs.load_robot(
        "amouri2019",
        {
            "segments.0.tendons.backlash": "0.5 mm",
            "segments.0.tendons.compliance": "0.01 mm/N",
            "segments.0.tendons.hole_clearance": "0.5 mm",
            "segments.0.tendons.mount_compliance": "0.02 mm/N",
        },
    )
    first, second = [6.0, 0.0, 0.0], [3.3e-3, -1.5e-3, -1.5e-3]
    none = [None] * 3
    whole = bs.sweep(robot, load=bs.Load(tensions=[first, none], displacements=[none, second]))
    begun = bs.solve(robot, first)
    after = bs.solve(robot, load=bs.Load(displacements=second), history=begun.history())
    assert after.tensions == pytest.approx(whole.tensions[1], abs=1e-6)


def test_fields_have_the_tensions_and_slack_of_the_solution():
    robot = bs.load_robot(
        "amouri2019",
        {
            "segments.0.tendons.compliance": "0.05 mm/N",
            "segments.0.tendons.hole_clearance": "0.3 mm",
            "segments.0.tendons.mount_compliance": "0.01 mm/N",
        },
    )
    found = bs.solve(robot, load=bs.Load(displacements=[4e-3, -3e-3, -2e-3]))
    fields = found.to_dataset()
    assert fields.tension.values.ravel() == pytest.approx(found.tensions, abs=1e-6)
    assert fields.slack.values.ravel() == pytest.approx(found.slack_lengths, abs=1e-9)


def test_a_derivative_by_it_is_refused():
    solution = bs.solve(ROBOT, [1.0] * 9)
    with pytest.raises(InputError, match="derivatives do not model it"):
        bs.directional_derivatives(solution, {"segments.*.tendons.hole_clearance": 1.0})


def test_a_displacement_holds_the_tension_that_took_it():
    robot = ROBOT.with_({f"{each}.hole_clearance": CLEARANCE for each in SEGMENTS})
    by_tension = bs.solve(robot, [2.0, 0.5, 0.5] * 3)
    again = bs.solve(robot, load=bs.Load(displacements=by_tension.displacements()))
    assert again.tensions == pytest.approx(by_tension.tensions, abs=1e-8)
    plain = bs.solve(ROBOT, [2.0, 0.5, 0.5] * 3)
    assert again.tip.position == pytest.approx(plain.tip.position, abs=1e-9)
    assert (by_tension.displacements() > plain.displacements()).all()


def test_constant_curvature_is_told_that_it_has_no_effect():
    """All tendons of a segment lose the same displacement, which leaves their differences."""
    given = displacements(20, 1)
    data = Data(points=tips(ROBOT, given, 0.0), displacements=given)
    with pytest.raises(InputError, match="hole_clearance has no effect"):
        fit(ROBOT, data, ["hole_clearance"], model="arc")


def test_tensions_do_not_depend_on_it():
    tensions = np.outer(np.linspace(0, 3, 10), [1, 0, 0] * 3)
    data = Data(points=bs.sweep(ROBOT, tensions).tip_position, tensions=tensions)
    held = fit(ROBOT, data, ["base.x"], start={"hole_clearance": 1e-3}, loss="linear")
    assert held.score.rmse < 1e-9


@pytest.mark.parametrize("bent", [{}, {"backbone.rest_bend": 0.3}, {"tendons.0.pretension": 2.0}])
def test_derivatives_are_those_of_differences(bent):
    """All parameters of displacements and tendons, against central differences of predictions."""
    given = displacements(12, 4)
    robot = listed(ROBOT.with_({f"{each}.pretension": 0.5 for each in SEGMENTS})).with_(
        {f"segments.{i}.{k}": v for i in range(3) for k, v in bent.items()}
    )
    data = Data(points=np.zeros((12, 3)), displacements=given)
    names = ["hole_clearance.segments", "gain.segments", "offset.tendons"]
    names += ["segments.*.tendons.compliance", "segments.0.tendons.1.pretension"]
    names += ["segments.0.backbone.E", "gravity.0"]
    start = {f"hole_clearance.segments.{i}": CLEARANCE for i in range(3)}
    unknowns = Unknowns(robot, names, start)
    model = TipModel(unknowns, commands(data, robot), bs.RodModel())
    values = unknowns.start
    exact = model.jacobian(values, model.predict(values, keep=True))
    for i, item in enumerate(unknowns.items):
        step = 1e-3 * item.step * (np.arange(len(values)) == i)
        more, less = (model.predict(values + side * step).point for side in (1, -1))
        central = (more - less) / (2e-3 * item.step)
        assert exact[:, :, i] * item.step == pytest.approx(central * item.step, abs=4e-6), item.name
