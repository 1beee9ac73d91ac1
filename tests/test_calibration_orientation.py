"""Constant curvature is fitted to bend angles and directions, without a measured tip."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring.calibration import fit_orientation
from bowstring.constant_curvature import RobotArcs
from bowstring.data.measurements import Measurements, write_measurements
from bowstring.errors import InputError
from objects import measured, refused
from shell import Shell, adapter

Floats = NDArray[np.float64]
ROBOT = bs.load_robot("amouri2019")
GAIN, NOISE = 0.88, np.radians(0.3)


def made(seed: int, noise: float = NOISE) -> Measurements:
    """Angles of arcs bent by 0.88 of what displacements ask, with Gaussian noise: synthetic."""
    rng = np.random.default_rng(seed)
    angles = np.radians([0, 120, 240])
    size, towards = rng.uniform(2e-3, 9e-3, 60), rng.uniform(-np.pi, np.pi, 60)
    displacements = size[:, None] * np.cos(towards[:, None] - angles)
    arc = RobotArcs.from_lengths(ROBOT, ROBOT.length - displacements, hold_length=True).arc
    bend, direction = GAIN * (arc.kappa * arc.length)[:, 0], arc.phi[:, 0]
    return measured(
        np.empty((60, 0, 3)),
        name="angles",
        displacements=displacements,
        bend=bend + noise * rng.normal(size=60),
        direction=direction + noise * rng.normal(size=60) / np.sin(bend),
    )


@pytest.mark.parametrize("loss", ["linear", "soft_l1", "huber"])
@pytest.mark.parametrize("directions", [True, False])
def test_gain_noise_and_intervals(loss: str, directions: bool) -> None:
    """Estimates scatter as their standard errors say, and the score is an angle."""
    deviations = []
    for seed in range(12):
        data = made(seed)
        data = data if directions else replace(data, direction=None)
        found = fit_orientation(ROBOT, data, ["bend_gain"], model="arc", loss=loss)  # type: ignore[arg-type]
        (gain,) = found.estimates
        deviations.append((gain.value - GAIN) / gain.standard_error)
        assert found.converged and gain.low < gain.value < gain.high
        assert found.noise == pytest.approx(NOISE, rel=0.35)
        residuals = 2 if directions else 1
        assert found.score.rmse == pytest.approx(np.sqrt(residuals) * NOISE, rel=0.3)
        too_much = (1 / GAIN - 1) * np.sqrt(np.mean(np.square(data.bend)))  # type: ignore[arg-type]
        before = np.hypot(np.sqrt(residuals) * NOISE, too_much)
        assert found.score_before.rmse == pytest.approx(before, rel=0.2)
    assert 0.4 < np.sqrt(np.mean(np.square(deviations))) < 1.8


def test_a_robust_loss_takes_no_notice_of_outliers() -> None:
    data = made(2)
    assert data.bend is not None
    spoiled = data.bend.copy()
    spoiled[::20] += 0.8
    data = replace(data, bend=spoiled)
    robust, plain = (
        fit_orientation(ROBOT, data, ["bend_gain"], model="arc", loss=loss).estimates[0].value
        for loss in ("huber", "linear")
    )
    assert robust == pytest.approx(GAIN, abs=0.01) and plain > GAIN + 0.02


@pytest.mark.parametrize("loss", ["linear", "soft_l1"])
def test_a_sensor_that_bends_in_a_plane(loss: str) -> None:
    """Its direction has no noise; the standard error is that of the bends alone."""
    data = made(5)
    assert data.bend is not None
    plane = made(5, noise=0.0)
    data = replace(data, direction=plane.direction)
    (gain,) = fit_orientation(ROBOT, data, ["bend_gain"], model="arc", loss=loss).estimates  # type: ignore[arg-type]
    alone = replace(data, direction=None)
    (of_bends,) = fit_orientation(ROBOT, alone, ["bend_gain"], model="arc", loss=loss).estimates  # type: ignore[arg-type]
    assert gain.value == pytest.approx(of_bends.value, abs=of_bends.standard_error)
    assert gain.standard_error == pytest.approx(of_bends.standard_error, rel=0.35)
    assert abs(gain.value - GAIN) < 3 * gain.standard_error


def test_the_base_of_a_sensor_is_fitted() -> None:
    """A tilted frame and an angle of the holes, beside the gain; bends have no sign or turns."""
    data = made(4, noise=0.0)
    assert data.direction is not None and data.bend is not None
    turned = replace(data, direction=data.direction + np.radians(7))
    names = ["bend_gain", "hole_angle", "base.rx", "base.ry"]
    values = [each.value for each in fit_orientation(ROBOT, turned, names, model="arc").estimates]
    np.testing.assert_allclose(values, [GAIN, 7, 0, 0], atol=1e-5)
    other = replace(data, bend=-data.bend, direction=data.direction + 3 * np.pi)
    assert fit_orientation(ROBOT, other, ["bend_gain"], model="arc").estimates[
        0
    ].value == pytest.approx(GAIN)


def test_statics() -> None:
    """Young's modulus from tensions and the angles of their equilibria."""
    robot = ROBOT.with_({"gravity": [0, 0, -9.81], "segments.0.backbone.E": "41 GPa"})
    tensions = np.random.default_rng(6).uniform(0, 40, (12, 3))
    x, y, z = bs.solve_batch(robot, tensions).tip_rotation[..., 2].T
    data = replace(
        made(1).select(np.arange(12)),
        tensions=tensions,
        displacements=np.full((12, 3), np.nan),
        bend=np.arctan2(np.hypot(x, y), z),
        direction=np.arctan2(y, x),
    )
    first = robot.with_({"segments.0.backbone.E": "48 GPa"})
    found = fit_orientation(first, data, ["segments.0.backbone.E"])
    assert found.model == "rod" and found.rows == 12
    assert found.estimates[0].value == pytest.approx(41, rel=1e-3)
    refused("belongs to constant curvature", lambda: fit_orientation(first, data, ["bend_gain"]))


@pytest.mark.parametrize(
    ("names", "says"),
    [
        (["base.x"], "base.x has no effect on the orientation"),
        (["bend_gain", "gain"], "cannot separate bend_gain, gain"),
        ([], "parameters is empty"),
    ],
)
def test_parameters_that_angles_do_not_determine(names: list[str], says: str) -> None:
    refused(says, lambda: fit_orientation(ROBOT, made(1), names, model="arc"))
    with pytest.raises(InputError, match="has no bend angles"):
        fit_orientation(ROBOT, replace(made(1), bend=None), ["bend_gain"], model="arc")


def test_the_command(shell: Shell, tmp_path: Path) -> None:
    table = write_measurements(made(3), tmp_path / "angles.csv")
    asked = ["fit", "amouri2019", "--measurements", str(table), "--parameter"]
    code, said, _ = shell(*asked, "bend_gain", "--model", "arc")
    assert code == 0 and "fitted to the angles of angles (synthetic): 60 rows" in said
    assert "largest deg" in said and " mm" not in said
    _, text, _ = shell(*asked, "bend_gain", "--model", "arc", "--json")
    adapter("fit --measurements, angles only").validate_json(text, strict=True)
    (gain,) = json.loads(text)["parameters"]
    assert gain["low"] < GAIN < gain["high"]
    code, said, _ = shell(*asked, "gain")
    assert code == 0 and "statics, fitted to the angles" in said
    code, _, refused = shell(*asked, "gain", "--folds", "3")
    assert code != 0 and "--folds needs measured tips" in refused
