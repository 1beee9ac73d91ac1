"""Delay of the drives: commands with times reach the tendons later, and a fit hands it on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.data import synthetic
from bowstring.dynamics import Motions, Table
from bowstring.errors import InputError
from bowstring.robot.model import with_drives
from bowstring.robot.writer import to_yaml
from bowstring.study.calibration import predicted

PLAIN = bs.load_robot("amouri2019", {"segments.0.tendons.compliance": "0.05 mm/N"})
DELAY = np.array([0.3, 0.0, 0.7])
ROBOT = with_drives(PLAIN, delay=DELAY)
TIMES = np.array([0.0, 0.4, 1.0, 1.2, 2.0, 2.5, 3.1, 4.0])
BEND = np.array([2.0, 5.0, 8.0, 7.0, 3.0, 6.0, 9.0, 9.0]) * 1e-3
MOVED = np.outer(BEND, [1.0, -0.4, -0.6])
LATE = np.transpose([np.interp(TIMES - d, TIMES, c) for d, c in zip(DELAY, MOVED.T, strict=True)])


@pytest.mark.parametrize(("name", "unit"), [("displacements", 1.0), ("tensions", 2e3)])
def test_rows_with_times_reach_the_tendons_later(name: str, unit: float) -> None:
    given, late = (bs.Load(**{name: unit * (each + 0.01)}) for each in (MOVED, LATE))
    found = bs.sweep(ROBOT, load=given, times=TIMES).raise_for_status().tip_position
    np.testing.assert_allclose(found, bs.sweep(PLAIN, load=late).tip_position, atol=1e-9)
    at_rest = [bs.sweep(robot, load=given).tip_position for robot in (ROBOT, PLAIN)]
    np.testing.assert_allclose(*at_rest, atol=1e-12)
    assert np.abs(at_rest[0] - found).max() > 1e-2
    assert len(bs.compile_robot(ROBOT)["disks"]) == 9


TABLE = Table([0.0, 0.05, 0.05, 0.15], [[10, 0, 0], [20, 0, 0], [20, 5, 0], [0, 5, 0]])
MOTIONS = {
    "table": ([0.1] * 3, TABLE, Table(TABLE.times + 0.1, TABLE.values)),
    "each": (
        [0.1, 0.0, 0.1],
        Table([0.0, 0.1], [[10, 0, 0], [20, 5, 0]]),
        Table([0.0, 0.1, 0.2], [[10, 0, 0], [10, 5, 0], [20, 5, 0]]),
    ),
    "function": (
        [0.1, 0.0, 0.1],
        lambda t: [10 + 50 * t, 20 * t, 0],
        lambda t: [10 + 50 * max(t - 0.1, 0.0), 20 * t, 0],
    ),
}


@pytest.mark.parametrize("kind", MOTIONS)
def test_a_motion_follows_the_shifted_history(kind: str) -> None:
    delay, given, shifted = MOTIONS[kind]
    one = bs.simulate(with_drives(PLAIN, delay=np.array(delay)), given, 0.25).tip_position
    np.testing.assert_allclose(one, bs.simulate(PLAIN, shifted, 0.25).tip_position, atol=1e-12)


def test_the_robot_file_of_a_fit_has_its_delay(tmp_path: Path) -> None:
    loads = synthetic.Loads(displacements=np.tile(MOVED, (2, 1)), unload=False, period=0.5)
    actual = synthetic.Actual(changes={"segments.0.tendons.delay": "0.3 s"})
    data = synthetic.simulate(PLAIN, loads, actual=actual)
    found = fit(PLAIN, data, ["delay", "gain"], loss="linear", model=bs.RodModel())
    assert found["delay"].value == pytest.approx(0.3, abs=5e-3) and found.outside_robot == {}
    (tmp_path / "fitted.yaml").write_text(to_yaml(found.robot))
    robot = bs.load_robot(tmp_path / "fitted.yaml")
    assert robot.tendons.delay_s == pytest.approx(found["delay"].value, abs=1e-12)
    load = bs.Load(displacements=data.displacements)
    path = bs.sweep(robot, load=load, times=data.time, model=found.rod.replace(elements=1))
    np.testing.assert_allclose(path.tip_position, found.predict(data), atol=1e-9)
    # a study and a second fit read the file
    judged = predicted(robot, data, "cosserat")
    np.testing.assert_allclose(judged.tip_position, found.predict(data), atol=1e-6)
    again = fit(robot, data, ["delay"], loss="linear")
    assert again["delay"].value == pytest.approx(0.0, abs=1e-3)
    assert again.robot.tendons.delay_s == pytest.approx(0.3, abs=5e-3)
    # a negative one, of clocks that differ, stays outside
    early = fit(PLAIN, data, ["gain"], start={"delay": -0.2})
    assert early.outside_robot == {"delay": -0.2} and not early.robot.tendons.delay_s.any()


def test_who_has_no_times_or_no_commands_before_says_so() -> None:
    mixed = bs.Load(
        tensions=[[None, 0, 0], [5, 0, 0]], displacements=[[1e-3, None, None], [None] * 3]
    )
    with pytest.raises(InputError, match=r"tendon 1 has a delay and changes between"):
        bs.sweep(ROBOT, load=mixed, times=[0.0, 1.0])
    history = bs.sweep(ROBOT, load=bs.Load(displacements=MOVED)).history()
    with pytest.raises(InputError, match=r"history does not have the commands .* set delay to 0"):
        bs.sweep(ROBOT, load=bs.Load(displacements=MOVED), times=TIMES, history=history)
    with pytest.raises(InputError, match=r"row 3: tension of tendon 1 is -5 N"):
        bs.sweep(ROBOT, [[1, 0, 0], [5, 0, 0], [-5, 0, 0]], times=[0.0, 1.0, 1.2])
    with pytest.raises(InputError, match="have delay, with which many motions are not computed"):
        Motions(ROBOT, 2)
    with pytest.raises(InputError, match="have delay, which no linear model has; set delay to 0"):
        bs.linearise(ROBOT, [20.0, 1.0, 5.0], modes=2)
    rows = Data(points=np.zeros((8, 3)), displacements=MOVED)
    with pytest.raises(InputError, match="delay needs the time of each row"):
        fit(PLAIN, rows, ["gain"], start={"delay": 0.1})
