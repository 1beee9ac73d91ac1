"""A written robot is read back as the same robot."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bowstring.robot.reader import load_robot, robot_names
from bowstring.robot.writer import to_yaml

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("name", [*robot_names(), ROOT / "examples" / "my_robot.yaml"], ids=str)
def test_written_robots_are_read_back_unchanged(name: str | Path, tmp_path: Path) -> None:
    odd = {"segments.0.backbone.E": 1e11 / 3, "gravity": [0.1, -1 / 3, 1e-7]}
    robot = load_robot(name, odd | {"segments.0.disks.clamped_length": 1.2345678912345e-5})
    file = tmp_path / "robot.yaml"
    file.write_text(to_yaml(robot), encoding="utf-8")
    assert load_robot(file) == robot and load_robot(file).hash == robot.hash


def test_every_field_is_written(tmp_path: Path) -> None:
    """The complete example of the docs, with lists of tendons and of disks."""
    page = (ROOT / "docs" / "reference" / "robot-file.md").read_text(encoding="utf-8")
    example = re.search(r"```yaml\n(name: two_segments.*?)```", page, re.DOTALL)
    assert example is not None
    given, file = tmp_path / "given.yaml", tmp_path / "robot.yaml"
    given.write_text(example[1], encoding="utf-8")
    robot = load_robot(given)
    file.write_text(to_yaml(robot, "made\n\nhere: [é"), encoding="utf-8")
    assert file.read_text(encoding="utf-8").startswith(
        "# made\n#\n# here: [é\nname: two_segments\n"
    )
    assert load_robot(file) == robot


def test_defaults_that_nobody_gave_are_not_written() -> None:
    """The page, for one, refuses fields that it does not read."""
    changed = load_robot("amouri2019", {"segments.0.backbone.E": 40e9})
    text = to_yaml(changed)
    for name in ("width_direction", "rest_bend", "backlash", "turns", "relaxation_time"):
        assert name not in text
    assert "E: 40000000000.0 Pa" in text
    # given in the file, although they are the defaults
    assert "clamped_length: 0.0 m" in text and "first_angle: 0.0 rad" in text
