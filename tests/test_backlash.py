"""Backlash of the drives: the play operator, its invariants, calibration, refusals."""

from __future__ import annotations

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import Commands, TipModel
from bowstring.robot.model import with_tendons
from objects import followed
from stages import law_rows

HALF = 0.4e-3
FIELD = "segments.*.tendons.backlash"
TIGHT = bs.load_robot("amouri2019")
LOOSE = bs.load_robot("amouri2019", {FIELD: HALF})
#: To a turning point, back by less than the free travel, and beyond.
BEND = np.array([4.0, 10.0, 9.5, 9.2, 3.0, 3.5, -6.0, 0.0]) * 1e-3
COMMANDS = np.stack([BEND, -0.5 * BEND - 1e-3, -0.5 * BEND - 1e-3], axis=1)


def test_tendons_move_by_the_play_operator_of_the_commands():
    found = bs.sweep(LOOSE, load=bs.Load(displacements=COMMANDS)).raise_for_status()
    moved = followed(COMMANDS, HALF, np.zeros(3))
    assert found.displacements() == pytest.approx(moved, abs=1e-15)
    same = bs.sweep(TIGHT, load=bs.Load(displacements=moved)).raise_for_status()
    assert found.tip_position == pytest.approx(same.tip_position, abs=1e-9)
    assert found.tensions == pytest.approx(same.tensions, abs=1e-5)
    # within the free travel nothing moves
    assert found.tip_position[2] == pytest.approx(found.tip_position[1], abs=1e-9)
    assert np.linalg.norm(found.tip_position[4] - found.tip_position[1]) > 1e-2


def test_each_row_of_a_batch_starts_from_home():
    found = bs.solve_batch(LOOSE, load=bs.Load(displacements=COMMANDS)).raise_for_status()
    alone = [followed(row[None], HALF, np.zeros(3))[0] for row in COMMANDS]
    assert found.displacements() == pytest.approx(np.array(alone), abs=1e-15)


def test_a_step_without_a_solution_leaves_the_drive_where_it_was():
    impossible = np.full((1, 3), 0.3)  # all tendons shortened by half of the robot
    rows = np.concatenate([COMMANDS[:2], impossible, COMMANDS[2:]])
    found = bs.sweep(LOOSE, load=bs.Load(displacements=rows))
    assert found.converged.tolist() == [True, True, False, *[True] * 6]
    whole = bs.sweep(LOOSE, load=bs.Load(displacements=COMMANDS))
    assert found.displacements()[3:] == pytest.approx(whole.displacements()[2:], abs=1e-15)


def test_after_tensions_the_drive_is_where_the_tendon_is():
    nan = np.nan
    load = bs.Load(
        tensions=[[40.0, 0.0, 0.0], [nan] * 3],
        displacements=[[nan] * 3, [0.0, 0.0, 0.0]],
    )
    found = bs.sweep(LOOSE, load=load).raise_for_status()
    reached = found.displacements()[0]
    assert reached[0] > 2e-3
    assert found.displacements()[1] == pytest.approx(np.clip(reached, -HALF, HALF), abs=1e-15)


@pytest.mark.parametrize("start", [{}, {FIELD: 2e-4}])
def test_a_fit_finds_it(start):
    rng = np.random.default_rng(5)
    t = np.linspace(0.0, 3.0, 70)
    bend = 8e-3 * np.sin(2 * np.pi * t)
    towards = 2.0 * t
    commands = bend[:, None] * np.cos(towards[:, None] - 2 * np.pi * np.arange(3) / 3)
    tips = bs.sweep(LOOSE, load=bs.Load(displacements=commands)).raise_for_status().tip_position
    data = Data(points=tips + 5e-5 * rng.standard_normal(tips.shape), displacements=commands)
    found = fit(TIGHT, data, ["gain", FIELD], start=start, loss="linear")
    assert found.converged
    assert found[FIELD].low <= 1e3 * HALF <= found[FIELD].high
    assert found.values[FIELD] == pytest.approx(HALF, rel=0.05)
    # the robot file of the fit alone has its predictions
    path = bs.sweep(
        found.robot, load=bs.Load(displacements=commands), model=bs.RodModel(elements=1)
    )
    assert path.tip_position == pytest.approx(found.predict(data), abs=1e-9)


def test_a_backlash_of_commands_is_one_of_the_drives_without_loss_at_the_first_row():
    start = {"backlash": HALF, "gain": 1.05, "offset": 2e-4}
    commands = Commands(np.ones(COMMANDS.shape, bool), COMMANDS, None)
    model = bs.RodModel(elements=1)
    found = TipModel(Unknowns(TIGHT, [], start), commands, model).predict(np.zeros(0))
    drives = {"gain": 1.05, "zero": 2e-4, "backlash": 1.05 * HALF}
    robot = with_tendons(TIGHT, drives)
    taken_up = COMMANDS[0] + HALF * np.sign(COMMANDS[0])
    load = bs.Load(displacements=np.vstack((taken_up, COMMANDS)))
    path = bs.sweep(robot, load=load, model=model)
    assert path.tip_position[1:] == pytest.approx(found.point, abs=1e-9)


def test_the_error_budget_has_rows_of_backlash():
    found, rows = law_rows(LOOSE, TIGHT)
    up, down = rows["backlash_loading"], rows["backlash_unloading"]
    assert up.control == "displacement"
    assert up.moved > 1e-3 and down.moved > 1e-3
    assert any("backlash (0.4 mm each way) moves the tip" in text for text in found.text)
