"""Motions that start from an equilibrium that is not stable."""

from __future__ import annotations

import json
import re
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

import bowstring as bs
from bowstring.cli import main
from bowstring.dynamics.run_file import read_run
from bowstring.errors import StabilityWarning

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


def test_a_column_that_buckles_under_a_follower() -> None:
    """A dead force of 0.9 Euler loads compresses a column, and a follower pulls at its end.

    With the dead force P, the follower F and k^2 = (P - F) / EI a slightly bent column is in
    equilibrium where P cos(k l) = F. Stability is lost there without oscillation.
    """
    euler = np.pi**2 / 4 * float(COLUMN.bending_stiffness[0]) / COLUMN.length**2

    def bent(pull: float) -> float:
        return float(0.9 * np.cos(np.pi / 2 * np.sqrt(0.9 - pull)) - pull)

    def pulled(pull: float) -> bs.Load:
        follower = bs.PointLoad(force=[0, 0, pull * euler], follower=True)
        return bs.Load(tip_force=[0, 0, -0.9 * euler], point_loads=[follower])

    onset = brentq(bent, 0.1, 0.6)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert simulated(COLUMN, pulled(0.95 * onset)).settings["initial_stable"] is True
    with pytest.warns(StabilityWarning, match="not stable"):
        run = simulated(COLUMN, pulled(0.8))
    assert run.settings["initial_stable"] is False
    (sentence,) = run.warnings
    found = re.search(
        r"under a follower load .* without oscillating \(buckling\) from (.*) % of it on\.$",
        sentence,
    )
    assert found is not None, sentence
    assert float(found[1]) == pytest.approx(100 * onset / 0.8, rel=5e-3)


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
