"""Motions that start from an equilibrium that is not stable."""

from __future__ import annotations

import json
import re
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.cli import main
from bowstring.dynamics.run_file import read_run
from bowstring.dynamics.start_stability import judged_start
from bowstring.errors import StabilityWarning
from bowstring.statics.load_tables import InstantLoad

ROBOT = bs.load_robot("amouri2019")
COLUMN = ROBOT.with_(
    {
        "segments.0.disks.mass": "0 g",
        "segments.0.disks.count": 24,
        "segments.0.disks.thickness": "0 mm",
    }
)
#: Beck 1952, of a uniform column.
FLUTTER = 20.05


def push(robot: bs.Robot, share: float) -> bs.Load:
    critical = FLUTTER * float(robot.bending_stiffness[0]) / robot.length**2
    return bs.Load(point_loads=[bs.PointLoad(force=[0, 0, -share * critical], follower=True)])


def simulated(robot: bs.Robot, load: bs.Load, **others: Any) -> bs.Run:
    return bs.simulate(robot, [0, 0, 0], 1e-3, load=load, **others)


@pytest.mark.parametrize("share", [1.5, 3.0])
def test_a_column_beyond_its_flutter_load(share: float) -> None:
    """The share of the load at which stability is lost is that of Beck's column."""
    with pytest.warns(StabilityWarning, match="amouri2019: the motion starts from") as caught:
        run = simulated(COLUMN, push(COLUMN, share))
    assert len(caught) == 1
    assert run.settings["initial_stable"] is False
    (sentence,) = run.warnings
    found = re.search(r"as oscillations \(flutter\) from (.*) % of it on\.$", sentence)
    assert found is not None, sentence
    assert float(found[1]) == pytest.approx(100 / share, rel=5e-3)


def test_a_column_just_beyond_its_flutter_load() -> None:
    """Oscillations grow slowly there, and damping of a few per cent would hold them."""
    with pytest.warns(StabilityWarning, match="not known to be stable: a follower .*flutter"):
        run = simulated(COLUMN, push(COLUMN, 1.02))
    assert run.settings["initial_stable"] is None


@pytest.mark.parametrize(
    "load",
    [
        push(COLUMN, 0.98),
        bs.Load(tip_force=[0, 0, -1.0]),
        bs.Load(tip_moment=[0, 0.1, 0]),
        # an equilibrium without the load, which acts later
        bs.Load(tip_moment=bs.dynamics.ramp([0, 0, 6.0], 1.0)),
    ],
)
def test_stable_starts_say_nothing(load: bs.Load) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = simulated(COLUMN, load)
    assert run.settings["initial_stable"] is True
    assert run.warnings == ()


def test_starts_on_a_path() -> None:
    """With displacements stability under a follower is not determined; with friction never."""
    load = push(ROBOT, 1.5)
    held = bs.Load(displacements=[0.0, 0.0, 0.0], point_loads=load.point_loads)
    with pytest.warns(StabilityWarning, match="not known to be stable"):
        assert bs.simulate(ROBOT, duration=0, load=held).settings["initial_stable"] is None
    rubbing = ROBOT.with_({"segments.0.tendons.friction": 0.1})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = bs.simulate(rubbing, [1, 0, 0], 0, load=push(rubbing, 0.1))
    assert run.settings["initial_stable"] is None


def test_buckling_by_name() -> None:
    """Stability that is lost to False at once is lost without oscillation."""
    moment = np.array([0.0, 0.0, 2.0])

    def solve(tensions: Any, load: bs.Load, model: Any) -> Any:
        stable = abs(load.tip_moment[2]) < 1.5
        return SimpleNamespace(converged=True, stable=stable, model=model)

    none = np.zeros(0)
    robot: Any = SimpleNamespace(core=SimpleNamespace(solve=solve))
    initial = InstantLoad(none, none, moment, none, none, none, none, none)
    load = bs.Load(tip_moment=moment)
    stable, said = judged_start(robot, initial, load, bs.RodModel(), on_path=False)
    assert stable is False
    assert said.endswith(
        "under a dead moment small motions about it grow, without oscillating (buckling) from 75 % "
        "of it on"
    )


def test_on_the_command_line(capsys: pytest.CaptureFixture[str], tmp_path: Any) -> None:
    force = 1.5 * FLUTTER * float(ROBOT.bending_stiffness[0]) / ROBOT.length**2
    words = ["simulate", "amouri2019", "--tension", "0,0,0", "--rise", "0", "--hold", "0.01"]
    words += ["--follower-force", f"9:0,0,{-force}", "--json", "--out", str(tmp_path / "run.nc")]
    with pytest.warns(StabilityWarning):
        assert main.run(words) == 0
    content = json.loads(capsys.readouterr().out)
    assert len(content["warnings"]) == 1 and "flutter" in content["warnings"][0]
    assert content["provenance"]["settings"]["initial_stable"] is False
    stored = json.loads(read_run(tmp_path / "run.nc").attrs["settings"])
    assert stored["initial_stable"] is False
