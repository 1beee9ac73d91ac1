"""Displacements lost in the holes of tendons and in the mount of all motors."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.calibration.observations import commands
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import TipModel
from bowstring.errors import InputError

CLEARANCE, MOUNT = 3e-4, 2e-5
SEGMENTS = [f"segments.{i}.tendons" for i in range(3)]
ROBOT = bs.load_robot("crl-ftdcr-v4", {f"{each}.compliance": "0.1 mm/N" for each in SEGMENTS})
PRETENSIONED = ROBOT.with_({f"{each}.pretension": 0.5 for each in SEGMENTS})


def displacements(count, seed):
    """Displacements (n, 6) in m: random tensions, none slack."""
    rng = np.random.default_rng(seed)
    tensions = rng.uniform(0.3, 4.0, (count, ROBOT.core.tendon_count))
    return bs.sweep(ROBOT, tensions).displacements()


def actuated(robot, count, seed):
    """Displacements (n, T) of the motors, and tips (n, 3), of random tensions; some are slack.

    The mount takes its part of a pose that is known by tensions, so that nothing is iterated.
    """
    rng = np.random.default_rng(seed)
    tensions = rng.uniform(-1.0, 4.0, (count, robot.core.tendon_count))
    slack = tensions < 0
    tensions = np.maximum(tensions, 0.0)
    found = bs.sweep(robot, tensions)
    before = found.displacements() - np.where(slack, 1e-4, 0.0)
    more = tensions - robot.tendons.pretension_N
    return before + MOUNT * more.sum(axis=1, keepdims=True), found.tip_position


def model_of(robot, given, names, start):
    data = Data(points=np.zeros((len(given), 3)), displacements=given)
    return TipModel(Unknowns(robot, names, start), commands(data, robot), bs.RodModel())


def has_derivatives_of_differences(model, share):
    """By central differences of predictions over a share of the step of each parameter."""
    values = model.unknowns.start
    exact = model.jacobian(values, model.predict(values, keep=True))
    for i, item in enumerate(model.unknowns.items):
        step = share * item.step * (np.arange(len(values)) == i)
        more, less = (model.predict(values + side * step).point for side in (1, -1))
        central = (more - less) / (2 * share)
        assert exact[:, :, i] * item.step == pytest.approx(central, abs=4e-6), item.name


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


@pytest.mark.parametrize("stretch", ["0.1 mm/N", "0.001 mm/N", "0 mm/N"])
def test_prediction_with_a_mount_is_that_by_tensions(stretch):
    """Also where the mount gives far more than the tendons, and a plain iteration diverges."""
    robot = PRETENSIONED.with_({f"{each}.compliance": stretch for each in SEGMENTS})
    given, reached = actuated(robot, 30, 1)
    model = model_of(robot, given, ["base.x"], {"mount_compliance": MOUNT})
    found = model.predict(model.unknowns.start)
    assert found.solved.all()
    assert found.point == pytest.approx(reached, abs=2e-6)


def test_a_mount_takes_nothing_from_the_home_pose():
    model = model_of(PRETENSIONED, np.zeros((1, 9)), ["base.x"], {"mount_compliance": MOUNT})
    found = model.predict(model.unknowns.start)
    home = bs.sweep(PRETENSIONED, PRETENSIONED.tendons.pretension_N[None]).tip_position
    assert found.point == pytest.approx(home, abs=1e-9)


def test_fit_finds_the_compliance_of_the_mount():
    given, reached = actuated(ROBOT, 60, 2)
    data = Data(points=reached, displacements=given)
    found = fit(ROBOT, data, ["mount_compliance"], loss="linear")
    assert found.converged, found.message
    assert found["mount_compliance"].value == pytest.approx(1e3 * MOUNT, rel=1e-4)
    assert found.score.rmse < 1e-6 < 5e-4 < found.score_before.rmse
    # the fitted robot is a robot file
    assert found.outside_robot == {} and found.is_in_robot("mount_compliance")
    again = bs.solve_batch(found.robot, load=bs.Load(displacements=given))
    assert again.tip_position == pytest.approx(reached, abs=1e-6)


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


@pytest.mark.parametrize("name", ["hole_clearance", "mount_compliance"])
def test_constant_curvature_is_told_that_it_has_no_effect(name):
    """All tendons of a segment lose the same displacement, which leaves their differences."""
    given, reached = actuated(ROBOT, 20, 1)
    with pytest.raises(InputError, match=f"{name} has no effect"):
        fit(ROBOT, Data(points=reached, displacements=given), [name], model="arc")


def test_tensions_do_not_depend_on_it():
    tensions = np.outer(np.linspace(0, 3, 10), [1, 0, 0] * 3)
    data = Data(points=bs.sweep(ROBOT, tensions).tip_position, tensions=tensions)
    held = fit(ROBOT, data, ["base.x"], start={"hole_clearance": 1e-3}, loss="linear")
    assert held.score.rmse < 1e-9
    with pytest.raises(InputError, match="mount_compliance has no effect"):
        fit(ROBOT, data, ["mount_compliance"])


def test_the_compliance_of_the_mount_is_one_number_for_the_robot():
    with pytest.raises(InputError, match=r"there is no parameter 'mount_compliance\.tendons'"):
        Unknowns(ROBOT, ["mount_compliance.tendons"])
    with pytest.raises(InputError, match="start of mount_compliance"):
        Unknowns(ROBOT, ["mount_compliance"], {"mount_compliance": float("nan")})


@pytest.mark.parametrize("bent", [{}, {"backbone.rest_bend": 0.3}, {"tendons.0.pretension": 2.0}])
def test_derivatives_with_clearance(bent):
    """All parameters of displacements and tendons."""
    robot = listed(PRETENSIONED).with_(
        {f"segments.{i}.{k}": v for i in range(3) for k, v in bent.items()}
    )
    names = ["hole_clearance.segments", "gain.segments", "offset.tendons"]
    names += ["segments.*.tendons.compliance", "segments.0.tendons.1.pretension"]
    names += ["segments.0.backbone.E", "gravity.0"]
    start = {f"hole_clearance.segments.{i}": CLEARANCE for i in range(3)}
    has_derivatives_of_differences(model_of(robot, displacements(12, 4), names, start), 1e-3)


@pytest.mark.parametrize("clearance", [0.0, CLEARANCE])
def test_derivatives_with_a_mount(clearance):
    """All parameters of displacements and tendons, also of slack ones."""
    given, _ = actuated(PRETENSIONED, 12, 3)
    names = ["mount_compliance", "gain.segments", "offset.tendons", "segments.0.backbone.E"]
    names += ["segments.*.tendons.compliance", "segments.*.tendons.pretension"]
    names += ["hole_clearance"] * bool(clearance)
    start = {"mount_compliance": MOUNT, "hole_clearance": clearance}
    has_derivatives_of_differences(model_of(PRETENSIONED, given, names, start), 1e-2)
