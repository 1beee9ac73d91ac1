"""Tendons in the body itself: soft robots without disks."""

from __future__ import annotations

from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml

import bowstring as bs
from bowstring.errors import InputError

ROOT = Path(__file__).parents[1]
TENTACLE = ROOT / "examples" / "tentacle.yaml"


def test_a_body_needs_no_disks() -> None:
    robot = bs.load_robot(TENTACLE)
    jsonschema.validate(yaml.safe_load(TENTACLE.read_text()), bs.robot_schema())
    assert robot.is_embedded
    assert robot.warnings == ()
    assert robot.disks.mass_kg.sum() == 0.0

    # the mass is that of two cones
    def volume(a: float, b: float, length: float) -> float:
        return np.pi / 12.0 * length * (a * a + a * b + b * b)

    mass = 1500.0 * (volume(0.03082, 0.01284, 0.305) + volume(0.01284, 0.0096, 0.055))
    lengths = np.array([s.length for s in robot.segments])
    assert robot.mass_per_length @ lengths == pytest.approx(mass, rel=1e-12)


def test_embedded_tendons_are_the_limit_of_many_disks() -> None:
    """Second order in the distance of the disks, tapered and converging under gravity."""
    tensions = [6.0, 1.0]
    tip = bs.solve(bs.load_robot(TENTACLE), tensions).raise_for_status().tip.position
    gaps = []
    for count in (20, 40, 80):
        disks = {"mass": 0.0, "radius": 0.05, "thickness": 0.0, "clamped_length": 0.0}
        changes: dict[str, object] = {
            "segments.0.disks": disks | {"count": count},
            "segments.1.disks": disks | {"count": 4},
        }
        robot = bs.load_robot(TENTACLE, changes)
        # the same holes with straight spans between disks that the core takes as such
        spans = bs._core.Robot(_StraightSpans(robot))
        found = spans.solve(tensions, bs.Load(), bs.RodModel())
        gaps.append(np.linalg.norm(found.disk_positions[-1] - tip))
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.25)
    assert gaps[1] / gaps[2] == pytest.approx(4.0, rel=0.25)
    assert gaps[2] < 3e-3 * 0.36


class _StraightSpans:
    """Arrays of a robot whose tendons are straight between disks."""

    is_embedded = False

    def __init__(self, robot: bs.Robot) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)


def test_bodies_and_disks_do_not_mix(tmp_path: Path) -> None:
    text = TENTACLE.read_text()
    head, tail = text.rsplit("    tendons_in: body\n", 1)
    path = tmp_path / "mixed.yaml"
    path.write_text(
        head + "    disks: {count: 2, mass: 1 g, radius: 8 mm, thickness: 1 mm}\n" + tail
    )
    with pytest.raises(InputError, match="tendons_in: got disks after body"):
        bs.load_robot(path)


def test_a_tendon_winds_slowly_from_section_to_section() -> None:
    tendon = {"segments.0.tendons": [{"angle": 0.0, "pitch_radius": 5e-3, "turns": 1.0}]}
    body = {"segments.0.tendons_in": "body", "segments.0.disks.hole_length": 0.0}
    robot = bs.load_robot("amouri2019", {**tendon, **body, "segments.0.disks.count": 20})
    assert robot.core.tendon_count == 1
    with pytest.raises(InputError, match=r"0\.0526 of a turn between two modules of the body"):
        robot.with_({"segments.0.disks.count": 19})
