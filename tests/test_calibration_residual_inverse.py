"""Inverse kinematics with a residual, on synthetic tips with a hysteresis that no model has."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring.calibration import (
    Data,
    Residual,
    fit,
    fit_residual,
    inverse_with_residual,
)
from bowstring.calibration.residual_file import residual_to_dict
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.robot.writer import to_yaml
from shell import Shell

Floats = NDArray[np.float64]
#: The robot's base in the measuring frame, turned by 90 degrees besides, m.
BASE = np.array([0.01, -0.02, 0.005])


def path(robot: Robot, rows: int, phase: float) -> Floats:
    """Displacements of a smooth path of two segments, m."""
    t = np.linspace(0.0, 12.0 * np.pi, rows)
    angle = 2 * np.pi * np.arange(3) / 3
    size = 1.5e-3 * (1.5 + np.sin(t / 5 + phase))
    inner = size[:, None] * np.cos(t[:, None] - angle)
    outer = 2e-3 * np.cos(0.7 * t[:, None] + phase - angle)
    return np.concatenate([inner, inner + outer], axis=1)


def measured(robot: Robot, commands: Floats) -> Floats:
    """Synthetic tips: motors with a gain, and tips a part of the last steps behind."""
    tips = bs.sweep(robot, load=bs.Load(displacements=0.97 * commands)).tip_position
    late = tips.copy()
    for k in range(1, len(tips)):
        late[k] = tips[k] + 0.5 * (late[k - 1] - tips[k])
    moved = late @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(moved + BASE)


@pytest.fixture(scope="module")
def residual(rao: Robot) -> Residual:
    commands = path(rao, 200, 0.0)
    data = Data(points=measured(rao, commands), displacements=commands)
    return fit_residual(fit(rao, data, ["base", "gain"]), data)


def test_commands_bring_the_corrected_point_to_a_path(rao: Robot, residual: Residual) -> None:
    wanted = residual.correct(bs.Load(displacements=path(rao, 60, 0.4))).point
    found = inverse_with_residual(residual, wanted)
    assert found.reached.all() and not found.beyond.any()
    assert found.distance.max() <= 1e-5 * rao.length
    # the model and its residual confirm it, as a path of rows
    again = residual.correct(found.load)
    assert again.point == pytest.approx(wanted, abs=1e-5 * rao.length)
    # the model alone would land off the path by what the residual knows
    off = np.linalg.norm(again.model_point - wanted, axis=1)
    assert np.median(off) > 100 * found.distance.max()


def test_a_calibrated_backlash_is_crossed(rao: Robot) -> None:
    commands = path(rao, 200, 0.0)
    loose = rao.with_({"segments.*.tendons.*.backlash": 1e-4})
    tips = bs.sweep(loose, load=bs.Load(displacements=commands)).tip_position
    data = Data(points=tips, displacements=commands)
    found = fit(rao, data, ["backlash"], start={"backlash": 5e-5})
    learnt = fit_residual(found, data)
    got = inverse_with_residual(learnt, tips[20:60])
    assert got.reached.mean() > 0.9
    assert np.median(got.distance) <= 1e-5 * rao.length


def test_the_zeros_of_load_cells_are_in_the_commands() -> None:
    """Commands are readings: 0.5 N above the tension, so that no tension is below zero."""
    robot = bs.load_robot("amouri2019")
    turn = np.linspace(0.0, 6.0 * np.pi, 60)[:, None] - 2.0 * np.pi * np.arange(3) / 3
    tensions = np.maximum((3.0 + np.sin(turn[:, :1] / 3)) * np.cos(turn), 0.0)
    tips = bs.sweep(robot, tensions).tip_position
    tips = tips + 1e-4 * np.sin(turn)
    data = Data(points=tips, tensions=tensions + 0.5)
    found = fit(robot, data, ["offset"])
    assert found.values["offset"] == pytest.approx(-0.5, abs=0.05)
    residual = fit_residual(found, data)
    wanted = residual.correct(bs.Load(tensions[20:26] + 0.5)).point
    got = inverse_with_residual(residual, wanted)
    assert got.reached.mean() > 0.5
    assert got.commands.min() == pytest.approx(-found.values["offset"], abs=1e-6)


def test_points_out_of_reach_and_beyond_the_data_say_so(rao: Robot, residual: Residual) -> None:
    far = inverse_with_residual(residual, BASE + np.array([0.0, 0.0, 2.0 * rao.length]))
    assert far.status == ("unreachable",)
    assert far.distance[0] == pytest.approx(rao.length, rel=0.1)
    bent = bs.solve(rao, load=bs.Load(displacements=np.tile([6e-3, -3e-3, -3e-3], 2)))
    tip = bent.raise_for_status().tip
    assert tip is not None
    x, y, z = tip.position
    aside = inverse_with_residual(residual, BASE + np.array([-y, x, z]))
    assert aside.beyond.all()


def test_bad_input_is_refused(residual: Residual) -> None:
    for wrong in ([], [1.0, 2.0], [[0.0, 0.0, np.nan]], "here"):
        with pytest.raises(InputError, match="position"):
            inverse_with_residual(residual, wrong)  # type: ignore[arg-type]
    limits = bs.ActuationLimits(displacement_limits=[-0.01, 0.01])
    with pytest.raises(InputError, match="displacement_limits are not possible with a residual"):
        inverse_with_residual(residual, BASE, limits=limits)


def test_the_command_line(rao: Robot, residual: Residual, shell: Shell, tmp_path: Path) -> None:
    file, calibrated = tmp_path / "residual.json", tmp_path / "robot.yaml"
    file.write_text(json.dumps(residual_to_dict(residual)))
    calibrated.write_text(to_yaml(residual.robot))
    wanted = residual.correct(bs.Load(displacements=path(rao, 20, 0.4))).point
    call = ("ik", str(calibrated), "--residual", str(file))

    tip = ",".join(f"{x:.9g}" for x in wanted[0])
    found = shell.json(*call, "--tip", tip)
    (row,) = found["rows"]
    assert row["status"] == "reached" and not row["beyond_data"] and found["file"] is None
    assert row["tensions_N"] == [None] * 6
    again = residual.correct(bs.Load(displacements=[row["displacements_m"]])).point
    assert again[0] == pytest.approx(wanted[0], abs=1e-5 * rao.length)
    assert "1 of 1 reached" in shell(*call, "--tip", tip)[1]

    table, out = tmp_path / "tips.csv", tmp_path / "commands.csv"
    rows = "\n".join(",".join(f"{1e3 * x:.9g}" for x in row) for row in wanted)
    table.write_text(f"tip_x_mm,tip_y_mm,tip_z_mm\n{rows}\n")
    found = shell.json(*call, "--path", str(table), "--out", str(out))
    assert found["count"] == found["reached"] == 20
    with out.open(newline="") as stream:
        assert next(stream).startswith("# commands by Bowstring")
        written = list(csv.DictReader(stream))
    commands = [[float(row[f"displacement_{i}_mm"]) for i in range(1, 7)] for row in written]
    again = residual.correct(bs.Load(displacements=1e-3 * np.array(commands))).point
    assert again == pytest.approx(wanted, abs=2e-5 * rao.length)

    for flags, said in (
        (("--model", "cc"), "--model: not with --residual, which has the model of its fit"),
        (("--direction", "0,0,1"), "--direction: not with --residual"),
        (("--out", "x.csv"), "--out: it is for --path"),
    ):
        assert said in shell.error(*call, "--tip", tip, *flags)
    said = shell.error("ik", "amouri2019", "--residual", str(file), "--tip", tip)
    assert "belongs to another robot" in said
