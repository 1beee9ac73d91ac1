"""Compliance of the mount of all motors, as a parameter of a fit."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.calibration.observations import commands
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import TipModel
from bowstring.errors import InputError
from bowstring.robot.model import Robot

MOUNT = 2e-5
SEGMENTS = [f"segments.{i}.tendons" for i in range(3)]
ROBOT = bs.load_robot("crl-ftdcr-v4", {f"{each}.compliance": "0.1 mm/N" for each in SEGMENTS})

PRETENSIONED = ROBOT.with_({f"{each}.pretension": "0.5 N" for each in SEGMENTS})


def actuated(robot: Robot, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
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


def model_of(
    robot: Robot, given: np.ndarray, names: list[str], start: dict[str, float]
) -> TipModel:
    data = Data(points=np.zeros((len(given), 3)), displacements=given)
    return TipModel(Unknowns(robot, names, start), commands(data, robot), bs.RodModel())


@pytest.mark.parametrize("stretch", ["0.1 mm/N", "0.001 mm/N", "0 mm/N"])
def test_prediction_is_that_by_tensions(stretch: str) -> None:
    """Also where the mount gives far more than the tendons, and a plain iteration diverges."""
    robot = PRETENSIONED.with_({f"{each}.compliance": stretch for each in SEGMENTS})
    given, tips = actuated(robot, 30, 1)
    model = model_of(robot, given, ["base.x"], {"mount_compliance": MOUNT})
    found = model.predict(model.unknowns.start)
    assert found.solved.all()
    np.testing.assert_allclose(found.point, tips, atol=2e-6)


def test_it_takes_nothing_from_the_home_pose() -> None:
    model = model_of(PRETENSIONED, np.zeros((1, 9)), ["base.x"], {"mount_compliance": MOUNT})
    found = model.predict(model.unknowns.start)
    home = bs.sweep(PRETENSIONED, PRETENSIONED.tendons.pretension_N[None]).tip_position
    np.testing.assert_allclose(found.point, home, atol=1e-9)


def test_fit_finds_the_compliance() -> None:
    given, tips = actuated(ROBOT, 60, 2)
    found = fit(ROBOT, Data(points=tips, displacements=given), ["mount_compliance"], loss="linear")
    assert found.converged, found.message
    assert found["mount_compliance"].value == pytest.approx(1e3 * MOUNT, rel=1e-4)
    assert found.score.rmse < 1e-6 < 5e-4 < found.score_before.rmse
    # the fitted robot is a robot file
    assert found.outside_robot == {} and found.is_in_robot("mount_compliance")
    reached = bs.solve_batch(found.robot, load=bs.Load(displacements=given))
    np.testing.assert_allclose(reached.tip_position, tips, atol=1e-6)


@pytest.mark.parametrize("clearance", [0.0, 3e-4])
def test_derivatives_are_those_of_differences(clearance: float) -> None:
    """All parameters of displacements and tendons, against central differences of predictions."""
    given, _ = actuated(PRETENSIONED, 12, 3)
    names = ["mount_compliance", "gain.segments", "offset.tendons", "segments.0.backbone.E"]
    names += ["segments.*.tendons.compliance", "segments.*.tendons.pretension"]
    names += ["hole_clearance"] * bool(clearance)
    start = {"mount_compliance": MOUNT, "hole_clearance": clearance}
    model = model_of(PRETENSIONED, given, names, start)
    values = model.unknowns.start
    exact = model.jacobian(values, model.predict(values, keep=True))
    for i, item in enumerate(model.unknowns.items):
        step = 1e-2 * item.step * (np.arange(len(values)) == i)
        more, less = (model.predict(values + side * step).point for side in (1, -1))
        central = (more - less) / 2e-2
        assert exact[:, :, i] * item.step == pytest.approx(central, abs=4e-6), item.name


def test_it_has_no_effect_on_rows_by_tension() -> None:
    tensions = np.outer(np.linspace(0, 3, 10), [1, 0, 0] * 3)
    data = Data(points=bs.sweep(ROBOT, tensions).tip_position, tensions=tensions)
    with pytest.raises(InputError, match="mount_compliance has no effect"):
        fit(ROBOT, data, ["mount_compliance"])


def test_constant_curvature_is_told_that_it_has_no_effect() -> None:
    given, tips = actuated(ROBOT, 20, 1)
    with pytest.raises(InputError, match="mount_compliance has no effect"):
        fit(ROBOT, Data(points=tips, displacements=given), ["mount_compliance"], model="arc")


def test_it_is_one_number_for_the_robot() -> None:
    with pytest.raises(InputError, match=r"there is no parameter 'mount_compliance\.tendons'"):
        Unknowns(ROBOT, ["mount_compliance.tendons"])
    with pytest.raises(InputError, match="start of mount_compliance"):
        Unknowns(ROBOT, ["mount_compliance"], {"mount_compliance": float("nan")})
