"""The example of a ROS 2 node: its logic by physics, and its thin node against stand-ins of ROS."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bowstring as bs

PACKAGE = Path(__file__).parents[1] / "examples" / "ros2" / "bowstring_follower"


@pytest.fixture
def follower(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Class `TipFollower`, imported as ROS would."""
    for name in [name for name in sys.modules if name.startswith("bowstring_follower")]:
        monkeypatch.delitem(sys.modules, name)  # the guide imports a copy of it
    monkeypatch.syspath_prepend(str(PACKAGE))
    from bowstring_follower.follower import TipFollower

    return TipFollower


def until_still(robot: Any, most: int = 2000) -> list[Any]:
    """Commands until they no longer change."""
    commands = [robot.step()]
    while len(commands) < most:
        commands.append(robot.step())
        if (commands[-1].tensions == commands[-2].tensions).all():
            return commands
    raise AssertionError("the follower does not come to rest")


def test_the_tip_arrives_within_all_limits(follower: Any) -> None:
    moving = follower("rao2021", 100.0, max_tension=8.0, max_speed=0.2, max_tension_rate=50.0)
    target = [0.1, 0.02, 0.37]
    assert moving.set_target(target) == ""
    commands = until_still(moving)
    tips = np.array([command.tip_position for command in commands])
    tensions = np.array([command.tensions for command in commands])
    # the tip that a solve of its own has under the last command
    there = bs.solve(bs.load_robot("rao2021"), tensions[-1])
    np.testing.assert_allclose(there.tip.position, target, atol=1e-7)
    np.testing.assert_allclose(there.tendon_lengths, commands[-1].tendon_lengths, atol=1e-12)
    np.testing.assert_allclose(there.displacements(), commands[-1].displacements, atol=1e-12)
    assert commands[-1].distance < 1e-7
    assert tensions.min() >= 0.0 and tensions.max() <= 8.0
    assert np.abs(np.diff(tensions, axis=0)).max() <= 0.5 + 1e-9
    assert len(commands) >= np.linalg.norm(tips[0] - target) / 0.002


def test_a_new_target_starts_from_the_present_tip(follower: Any) -> None:
    moving = follower("crl-ftdcr-v4", 100.0, max_speed=0.1, max_tension_rate=1e6)
    moving.set_target([0.04, 0.0, 0.17])
    here = [moving.step() for _ in range(10)][-1].tip_position
    moving.set_target([0.0, 0.04, 0.17])
    after = moving.step().tip_position
    assert np.linalg.norm(after - here) < 2e-3
    np.testing.assert_allclose(until_still(moving)[-1].tip_position, [0.0, 0.04, 0.17], atol=1e-7)


def test_targets_out_of_reach(follower: Any) -> None:
    moving = follower("amouri2019", max_tension=30.0, max_speed=10.0, max_tension_rate=1e6)
    reached = bs.solve(bs.load_robot("amouri2019"), [60, 0, 0]).tip.position
    said = moving.set_target(reached)
    assert "largest tension of tendon 1 (30 N)" in said
    last = until_still(moving)[-1]
    assert 29.0 < last.tensions.max() <= 30.0 and last.distance > 0.01
    for wrong in ([1.0, 0.0, 0.0], [0.0, np.nan, 0.3], [0.1, 0.2]):
        with pytest.raises(ValueError):
            moving.set_target(wrong)
    # the wrong ones have changed nothing
    np.testing.assert_array_equal(moving.step().tensions, last.tensions)


@pytest.mark.parametrize("wrong", [{"rate": 0.0}, {"max_tension": -1.0}, {"max_speed": np.inf}])
def test_wrong_parameters(follower: Any, wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        follower("amouri2019", **wrong)


def test_the_node_publishes_what_the_logic_commands(
    follower: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against stand-ins of the messages and of rclpy: not a test of ROS itself."""
    said: list[str] = []

    class Node:
        def __init__(self, name: str) -> None:
            self.out: dict[str, list[Any]] = {}

        def declare_parameter(self, name: str, default: Any) -> Any:
            return SimpleNamespace(value=default)

        def create_publisher(self, kind: type, topic: str, depth: int) -> Any:
            kept = self.out.setdefault(topic, [])

            def publish(message: Any) -> None:
                assert isinstance(message, kind)
                kept.append(message)

            return SimpleNamespace(publish=publish)

        def create_subscription(self, *arguments: Any) -> None:
            assert arguments[1] == "tip_target"

        def create_timer(self, period: float, callback: Any) -> None:
            assert period == pytest.approx(0.02)

        def get_logger(self) -> Any:
            return SimpleNamespace(error=said.append, warning=said.append)

        def get_clock(self) -> Any:
            return SimpleNamespace(now=lambda: SimpleNamespace(to_msg=lambda: 0))

    class Message:
        def __init__(self, **values: Any) -> None:
            self.header, self.point = SimpleNamespace(), SimpleNamespace()
            vars(self).update(values)

    def kind(name: str) -> type:
        return type(name, (Message,), {})

    messages = {
        "geometry_msgs": ["PointStamped"],
        "sensor_msgs": ["JointState"],
        "std_msgs": ["Float64MultiArray"],
    }
    for package, names in messages.items():
        module = ModuleType(f"{package}.msg")
        vars(module).update({name: kind(name) for name in names})
        monkeypatch.setitem(sys.modules, package, ModuleType(package))
        monkeypatch.setitem(sys.modules, module.__name__, module)
    for name, value in (("rclpy", {}), ("rclpy.node", {"Node": Node})):
        module = ModuleType(name)
        vars(module).update(value)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "bowstring_follower.node", raising=False)
    from bowstring_follower.node import FollowerNode

    node = FollowerNode()
    header, point = SimpleNamespace(frame_id="base"), SimpleNamespace(x=0.05, y=0.0, z=0.385)
    node.on_target(Message(header=SimpleNamespace(frame_id="world"), point=point))
    node.on_target(Message(header=header, point=SimpleNamespace(x=9.0, y=0.0, z=0.0)))
    assert "'world'" in said[0] and "out of any reach" in said[1]
    node.on_target(Message(header=header, point=point))
    for _ in range(600):
        node.on_cycle()
    tendons, tip = node.out["tendons"][-1], node.out["predicted_tip"][-1]
    assert tendons.name == [f"tendon_{i}" for i in range(1, 7)]
    found = bs.solve(bs.load_robot("rao2021"), tendons.effort)
    np.testing.assert_allclose(found.tip.position, [0.05, 0.0, 0.385], atol=1e-7)
    np.testing.assert_allclose(tendons.position, found.tendon_lengths, atol=1e-12)
    assert (tip.header.frame_id, tip.point.x) == ("base", pytest.approx(0.05, abs=1e-7))
    assert len(node.out["tendon_displacements"][-1].data) == 6
    assert len(said) == 2


def test_the_package_is_complete() -> None:
    package = ET.parse(PACKAGE / "package.xml").getroot()
    assert package.findtext("name") == PACKAGE.name
    needs = {need.text for need in package.findall("exec_depend")}
    node = (PACKAGE / PACKAGE.name / "node.py").read_text("utf-8")
    assert needs - {"rclpy"} == {
        line.split()[1].partition(".")[0] for line in node.splitlines() if "_msgs.msg" in line
    }
    assert (PACKAGE / "resource" / PACKAGE.name).exists()
    compile((PACKAGE / "setup.py").read_text("utf-8"), "setup.py", "exec")
