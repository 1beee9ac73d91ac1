"""Warnings about a pose: disks below the base, and strain limits of the backbone."""

from __future__ import annotations

import io
import json
import math

import numpy as np
import pytest
from rich.console import Console

import bowstring as bs
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.robot.writer import to_yaml
from bowstring.statics import limits
from bowstring.study import report
from bowstring.study.study import Study
from bowstring.study.terminal import print_study
from shell import Shell
from stages import Stages

ROD = "segments.0.backbone."


@pytest.fixture(scope="module")
def limited() -> Robot:
    return load_robot("amouri2019").with_(
        {ROD + "strain_limit": "0.5 %", ROD + "yield_strength": "400 MPa"}
    )


def test_strain_matches_the_bend(limited: Robot) -> None:
    solution = bs.solve(limited, [20.0, 0.0, 0.0])
    warnings, (strain, stress) = solution.limits()
    assert warnings == () == solution.warnings()
    # an arc of F r l / (E I), slightly more by straight spans, and the axial force
    ei = 35e9 * math.pi / 64 * 0.005**4
    assert strain.value == pytest.approx(0.0025 * 20.0 * 0.029 / ei, rel=0.05)
    assert stress.value == pytest.approx(35e9 * strain.value, rel=0.02)
    assert strain.share == strain.value / 0.005 and stress.limit == 400e6


def test_a_backbone_beyond_its_limit_is_named(limited: Robot) -> None:
    bent = bs.solve(limited, [80.0, 0.0, 0.0])
    assert bent.warnings() == (
        "the backbone exceeds its limit: strain 0.58 %, 115 % of strain_limit 0.5 %; "
        "lower the load.",
    )
    weak = limited.with_({ROD + "yield_strength": "100 MPa", ROD + "strain_limit": None})
    (warning,) = bs.solve(weak, [80.0, 0.0, 0.0]).warnings()
    assert "von Mises stress" in warning and "of yield_strength 100 MPa" in warning
    # the same when actuated by the displacements of that pose
    by_displacement = bs.solve(limited, load=bs.Load(displacements=bent.displacements())).limits()[
        1
    ]
    assert by_displacement[0].value == pytest.approx(bent.limits()[1][0].value, rel=1e-6)


def test_each_segment_has_its_own_limits() -> None:
    robot = load_robot("rao2021").with_({"segments.1.backbone.strain_limit": 0.001})
    (warning,) = bs.solve(robot, [0.0, 0.0, 0.0, 3.0, 0.0, 0.0]).warnings()
    assert warning.startswith("the backbone of segment 2 exceeds")
    assert bs.solve(robot, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]).warnings() == ()


def test_a_tip_below_the_base_is_named() -> None:
    robot = load_robot("amouri2019")
    assert bs.solve(robot, [130.0, 0.0, 0.0]).warnings() == ()
    low = bs.solve(robot, [200.0, 0.0, 0.0])
    assert low.tip is not None
    (warning,) = low.warnings()
    z = 1e3 * float(low.tip.position[2])
    assert z < 0 and warning.startswith(f"the tip is {-z:.3g} mm below the base (z = {z:.3g} mm)")


def test_the_study_warns_about_its_sweep(limited: Robot, paper: Study) -> None:
    strong = limited.with_({ROD + "yield_strength": "1 GPa"})
    found = Stages(strong, max_tension=200.0, points=5).over(paper)
    assert found.statics.tip_position[-1, 2] < 0
    below, strain = found.warnings
    assert below.startswith(
        "From 200 N on the robot reaches behind the plane of the base: at 200 N"
    )
    assert "at 200 N the tip is 89.7 mm below the base" in below
    assert strain.startswith("From 100 N on the backbone exceeds its limit: strain 1.5 %")
    assert "at 200 N" in strain
    assert len(found.limits_text) == 2 and "yield_strength 1 GPa" in found.limits_text[1]
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert content["warnings"] == list(found.warnings)
    assert content["backbone_limits"] == list(found.limits_text)
    page = report._html(found, found.to_dict(), dict.fromkeys((f.stem for f in found.figures), ""))
    assert below in page and found.limits_text[0] in page
    out = io.StringIO()
    print_study(found, Console(file=out, width=200), verbose=True)
    assert found.limits_text[0] in out.getvalue()


def test_the_builtin_study_has_no_warnings(paper: Study) -> None:
    assert paper.warnings == () and paper.limits_text == ()


def test_loads_without_an_equilibrium_are_skipped(limited: Robot) -> None:
    disks = np.full((4, 9, 3), np.nan)
    disks[:2, :, 2] = 0.1
    disks[2, :, 2] = -0.01
    surface = np.full((2, 4, 1), np.nan)
    surface[:, :3, 0] = [[1e8, 2e8, 9e8], [0.001, 0.002, 0.003]]
    tension = np.array([0.0, 1.0, 2.0, 3.0])
    warnings, uses = limits.of_sweep(limited, tension, disks, surface)
    assert [w.split(" the ")[0] for w in warnings] == ["At some loads from 2 N on"] * 2
    assert "at 2 N disk 1 is 10 mm below" in warnings[0]
    assert uses[1].endswith("strain 0.3 %, 60 % of strain_limit 0.5 % at 2 N.")


def test_stress_is_available_where_a_sweep_uses_more_elements(limited: Robot, paper: Study) -> None:
    few = limited.with_({"segments.0.disks.count": 2})
    found = Stages(few, max_tension=80.0, points=3).over(paper)
    assert found.statics.converged.all()
    assert np.isfinite(found.statics.surface.strain).all()
    assert found.warnings[-1].startswith("From 80 N on the backbone exceeds its limit")


def test_limits_do_not_change_the_physics(limited: Robot) -> None:
    assert limited.hash == load_robot("amouri2019").hash
    assert limited.segments[0].backbone.strain_limit == 0.005
    assert "strain_limit: 0.005" in to_yaml(limited)


@pytest.mark.parametrize("value", ["half", "0 %", -0.1, "2000 %", True, "nan", "5 mm"])
def test_bad_strain_limits(value: object) -> None:
    with pytest.raises(InputError, match=r"strain_limit: got .*must be above 0 and at most 10"):
        load_robot("amouri2019").with_({ROD + "strain_limit": value})


def test_the_command_prints_the_warning(shell: Shell) -> None:
    flags = ("--tension", "200,0,0", "--set", ROD + "strain_limit=2 %")
    code, out, err = shell("solve", "amouri2019", *flags)
    assert code == 0
    assert err.startswith("Warning: the tip is 89.7 mm below the base")
    assert "backbone: strain 1.5 %, 7" in out and "% of strain_limit 2 %" in out
    code, out, err = shell("solve", "amouri2019", *flags, "--json")
    content = json.loads(out)
    assert "below the base" in content["warnings"][0]
    assert content["backbone_limits"][0]["what"] == "strain_limit"
    assert 0.7 < content["backbone_limits"][0]["share"] < 0.8
