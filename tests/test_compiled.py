"""Robots for the C library: the description, and the command that writes it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter

import bowstring as bs
from bowstring.cli.schemas.compiled import RobotDescription
from shell import Shell

DESCRIPTION = TypeAdapter(RobotDescription)


@pytest.mark.parametrize("name", bs.robot_names())
def test_every_built_in_robot(name: str) -> None:
    robot = bs.load_robot(name)
    found = bs.compile_robot(robot)
    DESCRIPTION.validate_python(found, strict=True)
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert found["disks"][-1]["station_m"] == pytest.approx(robot.length)
    assert len(found["segments"]) == len(robot.segments)
    assert len(found["tendons"]) == robot.core.tendon_count
    for tendon in found["tendons"]:
        assert len(tendon["holes_m"]) in (1, tendon["end_disk"] + 2)


def test_the_study_robot_by_hand() -> None:
    found = bs.compile_robot(bs.load_robot("amouri2019"))
    (section,) = found["segments"][0]["sections"]
    # Table 1: a round rod of 2.5 mm radius and 35 GPa, nu 0.3
    second = np.pi * 2.5e-3**4 / 4
    np.testing.assert_allclose(section[:2], 35e9 * second)
    np.testing.assert_allclose(section[3], 35e9 / 2.6 * 2 * second)
    np.testing.assert_allclose(section[4], 35e9 * np.pi * 2.5e-3**2)
    first, second_tendon, _ = found["tendons"]
    np.testing.assert_allclose(first["holes_m"], [[0.029, 0.0]], atol=1e-15)
    assert np.degrees(np.arctan2(*second_tendon["holes_m"][0][::-1])) == pytest.approx(120.0)
    assert first["end_disk"] == 8 and found["gravity_m_per_s2"] == [0.0, 0.0, 0.0]
    # the tension of half a turn by the linear law T r l / (E I) = pi
    limit = np.pi * section[0] / (0.029 * 0.641)
    assert first["max_tension_N"] == pytest.approx(limit, rel=1e-6)


def test_payloads_and_elastic_tendons() -> None:
    robot = bs.load_robot("amouri2019").with_(
        {
            "payloads": [{"disk": 9, "mass": 0.1, "centre": [0.01, 0.0, 0.02]}],
            "segments.0.tendons.axial_stiffness": 20e3,
            "segments.0.tendons.pretension": 2.0,
        }
    )
    found = bs.compile_robot(robot)
    (payload,) = found["payloads"]
    assert payload["disk"] == 8 and payload["mass_kg"] == 0.1
    assert payload["centre_m"] == [0.01, 0.0, 0.02]
    tendon = found["tendons"][2]
    assert tendon["pretension_N"] == 2.0
    assert tendon["compliance_m_per_N"] >= 0.641 / 20e3


def test_the_command(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "robot.json"
    change = ("--set", "segments.0.backbone.E=30 GPa")
    call = ("export", "amouri2019", "--out", str(file), *change)
    code, out, _ = shell(*call)
    assert code == 0 and str(file) in " ".join(out.split())
    written = json.loads(file.read_text("utf-8"))
    robot = bs.load_robot("amouri2019").with_({"segments.0.backbone.E": 30e9})
    assert {key: written[key] for key in bs.compile_robot(robot)} == bs.compile_robot(robot)
    assert written["provenance"]["robot_hash"] == robot.hash
    assert written == shell.json(*call)
    assert shell("export", "rao2021", "--out", str(file))[0] == 0  # over its own file


def test_other_files_are_not_overwritten(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "notes.json"
    file.write_text('{"notes": "mine"}')
    said = shell.error("export", "amouri2019", "--out", str(file))
    assert said.startswith("--out: ") and "notes.json" in said
    assert file.read_text() == '{"notes": "mine"}'


def test_friction_is_refused(shell: Shell, tmp_path: Path) -> None:
    friction = ("--set", "segments.0.tendons.friction=0.1")
    said = shell.error("export", "amouri2019", "--out", str(tmp_path / "robot.json"), *friction)
    assert "friction" in said and "the C library does not model" in said
