"""ROS bags (MCAP) are read by their drafts: messages of ROS 1 and 2, and JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.data.measurements import Measurements, read_measurements
from bowstring.data.rosbag import read_topic, topics
from bowstring.errors import InputError
from objects import drafted, refused

writer = pytest.importorskip("mcap.writer", reason="needs the extra rosbag")
ros1 = pytest.importorskip("mcap_ros1.writer", reason="needs the extra rosbag")
ros2 = pytest.importorskip("mcap_ros2.writer", reason="needs the extra rosbag")

ROWS, STEP, BEGIN = 40, 0.05, 1_700_000_000
HEADER = "std_msgs/Header header\n"
POSE = """\
geometry_msgs/Pose pose
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
JOINTS = "string[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
HEADER_2 = """\
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
HEADER_1 = """\
================================================================================
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
"""


def _truth(robot: bs.Robot, time: Floats) -> tuple[Floats, Floats]:
    """Displacements (K, 3) and tips (K, 3) of arcs, m."""
    bend, turn = 0.9 + 0.6 * np.sin(2 * time), 0.4 + 3 * time
    side = robot.length * (1 - np.cos(bend)) / bend
    tip = np.stack([side * np.cos(turn), side * np.sin(turn), robot.length * np.sin(bend) / bend])
    angles = robot.tendons.angle_rad - turn[:, None]
    return robot.tendons.pitch_radius_m * bend[:, None] * np.cos(angles), tip.T


def _messages(robot: bs.Robot) -> Iterator[tuple[int, str, dict[str, Any]]]:
    """Stamp (ns), topic and content of the messages, poses between those of the joints."""
    clock = STEP * np.arange(ROWS)
    for k, (t, moved) in enumerate(zip(clock, _truth(robot, clock)[0], strict=True)):
        names = ["motor_1", "motor_2", "motor_3"]
        values = dict(zip(names, moved.tolist(), strict=True))
        names = names[k % 3 :] + names[: k % 3]  # a driver may write them in any order
        content = {"name": names, "position": [values[n] for n in names]}
        yield round(t * 1e9), "/joint_states", content | {"velocity": [], "effort": []}
    clock = STEP * np.arange(ROWS - 1) + 0.4 * STEP
    for t, (x, y, z) in zip(clock, _truth(robot, clock)[1].tolist(), strict=True):
        turned = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
        pose = {"position": {"x": x, "y": y, "z": z}, "orientation": turned}
        yield round(t * 1e9), "/mocap/tip", {"pose": pose}


def _object(value: Any) -> Any:
    if isinstance(value, dict):
        return SimpleNamespace(**{key: _object(each) for key, each in value.items()})
    return value


def write_ros2(path: Path, robot: bs.Robot) -> None:
    with path.open("wb") as file:
        made = ros2.Writer(file)
        schemas = {
            "/mocap/tip": made.register_msgdef(
                "geometry_msgs/PoseStamped", HEADER + POSE + HEADER_2
            ),
            "/joint_states": made.register_msgdef(
                "sensor_msgs/JointState", HEADER + JOINTS + HEADER_2
            ),
            "/rosout": made.register_msgdef("std_msgs/String", "string data\n"),
        }
        for t, topic, content in _messages(robot):
            stamp = {"sec": BEGIN + t // 10**9, "nanosec": t % 10**9}
            message = {"header": {"stamp": stamp, "frame_id": "base"}, **content}
            late = BEGIN * 10**9 + t + 30_000_000  # recorded 30 ms later
            made.write_message(topic, schemas[topic], _object(message), log_time=late)
        made.write_message("/rosout", schemas["/rosout"], _object({"data": "ready"}), log_time=0)
        made.finish()


def write_ros1(path: Path, robot: bs.Robot) -> None:
    from mcap_ros1._vendor.genpy import Time, dynamic  # type: ignore[import-not-found]

    texts = {
        "/mocap/tip": ("geometry_msgs/PoseStamped", HEADER + POSE + HEADER_1),
        "/joint_states": ("sensor_msgs/JointState", HEADER + JOINTS + HEADER_1),
    }
    kinds = {topic: dynamic.generate_dynamic(*text)[text[0]] for topic, text in texts.items()}

    def fill(message: Any, content: dict[str, Any]) -> Any:
        for key, value in content.items():
            old = getattr(message, key)
            setattr(message, key, fill(old, value) if isinstance(value, dict) else value)
        return message

    with path.open("wb") as file:
        made = ros1.Writer(file)
        for t, topic, content in _messages(robot):
            message = fill(kinds[topic](), content)
            message.header.stamp = Time(BEGIN + t // 10**9, t % 10**9)
            made.write_message(topic, message, log_time=BEGIN * 10**9 + t)
        made.finish()


@contextmanager
def json_bag(path: Path) -> Iterator[Callable[[str, int, Any], None]]:
    """Writer of messages in JSON: topic, time in ns, and content."""
    with path.open("wb") as file:
        made = writer.Writer(file)
        made.start()
        schema = made.register_schema("any", "jsonschema", b"{}")
        channels: dict[str, int] = {}

        def write(topic: str, time: int, content: Any) -> None:
            if topic not in channels:
                channels[topic] = made.register_channel(topic, "json", schema)
            text = content if isinstance(content, bytes) else json.dumps(content).encode()
            made.add_message(channels[topic], time, text, time)

        yield write
        made.finish()


def write_json(path: Path, robot: bs.Robot) -> None:
    with json_bag(path) as write:
        for t, topic, content in _messages(robot):
            write(topic, t, content)


@pytest.mark.parametrize("write", [write_ros2, write_ros1, write_json])
def test_two_topics_are_joined_by_the_draft(
    write: Callable[[Path, bs.Robot], None], robot: bs.Robot, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    write(path, robot)
    text = drafted(path, robot)
    assert "not decided" not in text and 'block: "/joint_states"' in text
    (tmp_path / "map.yaml").write_text(text)
    found = read_measurements(path, robot, tmp_path / "map.yaml")
    time = STEP * np.arange(ROWS - 1) + 0.4 * STEP
    displacements, tip = _truth(robot, time)
    assert found.time is not None
    begin = 0 if write is write_json else BEGIN
    np.testing.assert_allclose(found.time - begin, time, atol=1e-6)
    np.testing.assert_allclose(found.tip, tip, atol=1e-12)
    np.testing.assert_allclose(found.displacements, displacements, atol=3e-4)  # interpolated
    what = "recorded" if write is write_json else "stamp of its header"
    assert any(what in note for _, note in found.issues)


def test_a_single_topic_needs_no_name(robot: bs.Robot, tmp_path: Path) -> None:
    """Stamps give the order; entries of arrays have names or numbers; text and images are left."""
    path = tmp_path / "run.mcap"
    moved, tip = _truth(robot, STEP * np.arange(6))
    with json_bag(path) as write:
        for k in (0, 2, 1, 3, 4, 5):
            stamp = {"sec": BEGIN, "nanosec": k * 10**8}
            write(
                "/bench",
                k if k != 2 else 0,
                {
                    "header": {"stamp": stamp, "frame_id": "base"},
                    "disp_mm": (1e3 * moved[k]).tolist(),
                    "points": [
                        {"name": "base", "x": 0.0},
                        dict(zip(("name", "x", "y", "z"), ("tip", *tip[k].tolist()), strict=True)),
                    ],
                    "ready": k > 0,
                    "image": [0] * 1000,
                    "note": "a",
                },
            )
        write("/log", 0, {"text": "no numbers"})
    text = """\
source: measured
tendons:
  quantity: displacement
  unit: mm
  columns: [/bench.disp_mm_1, /bench.disp_mm_2, /bench.disp_mm_3]
tip: {columns: [/bench.points_tip.x, /bench.points_tip.y, /bench.points_tip.z], unit: m}
time: {column: time, unit: s}
keep: {column: /bench.ready, value: 1}
"""
    (tmp_path / "map.yaml").write_text(text)
    found: Measurements = read_measurements(path, robot, tmp_path / "map.yaml")
    np.testing.assert_allclose(found.tip, tip[1:], atol=1e-12)
    np.testing.assert_allclose(found.displacements, moved[1:], atol=1e-12)
    assert found.line.tolist() == [2, 3, 4, 5, 6]
    (tmp_path / "map.yaml").write_text(text.replace("time, unit", "image_1, unit"))
    with pytest.raises(InputError) as refused:
        read_measurements(path, robot, tmp_path / "map.yaml")
    assert '"/bench.points_base.x"' in str(refused.value) and "note" not in str(refused.value)


def test_stamps_before_zero(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with json_bag(path) as write:
        for seconds, parts in ((1, 0), (-1, 250_000_000), (-5, 500_000_000)):
            write("/a", 0, {"header": {"stamp": {"sec": seconds, "nanosec": parts}}, "x": 0})
    columns, _ = read_topic(path, path.read_bytes(), "/a")
    assert columns["time"] == ["-4.500000000", "-0.750000000", "1.000000000"]


@pytest.mark.parametrize("damaged", [b'{"x": 1', b"\xff", b"[" * 100_000])
def test_messages_that_cannot_be_decoded_are_left_out(tmp_path: Path, damaged: bytes) -> None:
    path = tmp_path / "run.mcap"
    with json_bag(path) as write:
        write("/a", 0, damaged)
        for k in (1, 2):
            write("/a", k, {"x": k})
        write("/b", 3, damaged)
    columns, notes = read_topic(path, path.read_bytes(), "/a")
    assert columns["/a.x"] == ["1", "2"]
    assert notes[1].startswith("1 of 3 messages of /a cannot be decoded, and are left out: ")
    assert topics(path, path.read_bytes()) == ["/a"]
    refused("this bag cannot be read: ", lambda: read_topic(path, path.read_bytes(), "/b"))


def test_numbers_of_one_name_are_pointed_out(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with json_bag(path) as write:
        write("/a", 0, {"x_1": 1, "x": [2, 3], "y": 4})
    columns, notes = read_topic(path, path.read_bytes(), "/a")
    assert columns["/a.x_1"] == ["2"] and columns["/a.x_2"] == ["3"]
    assert 'have the same name, the last one is read: "/a.x_1"' in notes[-1]


def test_bags_that_are_not_read(
    robot: bs.Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, mapping = tmp_path / "run.mcap", tmp_path / "map.yaml"
    write_json(path, robot)
    mapping.write_text(
        "source: measured\ntable: {block: /tip}\ntime: {column: time, unit: s}\n"
        "tip: {columns: [a, b, c], unit: m}\n"
        "tendons: {quantity: tension, unit: N, columns: [f]}\n"
    )

    def refused(match: str, mapping: Path | None = mapping) -> None:
        with pytest.raises(InputError, match=match):
            read_measurements(path, mapping=mapping)

    refused('no numbers of a topic "/tip"; topics with numbers: "/joint_states", "/mocap/tip"')
    mapping.write_text(mapping.read_text().replace("table: {block: /tip}\n", ""))
    refused("several topics have numbers: .*; name one in a mapping, such as table: {block: /j")
    mapping.write_text(mapping.read_text() + "table: {skip: 2}\n")
    refused("a bag has block alone, its topic")
    data = path.read_bytes()
    monkeypatch.setattr("bowstring.data.rosbag._MOST_BYTES", 1_000)
    refused("would unpack to more than", None)
    monkeypatch.undo()
    path.write_bytes(data[: len(data) // 2])
    refused("this bag cannot be read", None)
    path.write_bytes(data[:8])
    refused("this bag cannot be read|no index", None)
    with json_bag(path) as write:
        write("/a", 0, b'{"x": 1')
    refused("this bag cannot be read: JSONDecodeError", None)
    with json_bag(path) as write:
        write("/a", 0, {"text": "b"})
    refused("no topic has numbers that can be read", None)
    with json_bag(path) as write:
        for k in range(3):
            write("/a", k, {f"{k}_{i}": 0 for i in range(4000)})
    refused('the messages of "/a" have more than 10000 different numbers', None)
    path.write_bytes(b"#ROSBAG V2.0\n" + bytes(9))
    refused("a bag in the format ROS 1; bags are read as .mcap", None)
    monkeypatch.setitem(__import__("sys").modules, "mcap.reader", None)
    path.write_bytes(data)
    refused(r"ROS bags need mcap.reader.*pip install 'bowstring\[rosbag\]'", None)


def defined(path: Path, definition: str) -> Path:
    """Write a bag of ROS 1 with a message by this definition."""
    with path.open("wb") as file:
        made = writer.Writer(file)
        made.start()
        schema = made.register_schema("a/B", "ros1msg", definition.encode())
        channel = made.register_channel("/b", "ros1", schema)
        made.add_message(channel, 0, bytes(8), 0)
        made.finish()
    return path


def test_a_definition_of_ros_1_runs_no_code(tmp_path: Path) -> None:
    """Its library makes a module of the definition, with comments and constants as they stand."""
    path, mark = tmp_path / "run.mcap", tmp_path / "mark"
    code = f"open({str(mark)!r}, 'w').close()"
    defined(path, f'float64 x # """\n# \n#"""\nstring S="""\nstring T=\'\'\' + {code}\n')
    drafted(path)
    defined(path, f"float64 x\n{code} y\n")
    with pytest.raises(InputError, match=r"run.mcap: .* in the definition of \"a/B\" is no field"):
        read_measurements(path)
    assert not mark.exists()


def test_arrays_of_a_definition_of_ros_1_do_not_fill_the_memory(tmp_path: Path) -> None:
    """Its library makes all entries of a message before it reads any."""
    nested = [f"{'=' * 80}\nMSG: a/C{i}\na/C{i + 1}[10] x\n" for i in range(12)]
    for definition in ("float64[3000000000] x\n", "".join(["a/C0 x\n", *nested])):
        with pytest.raises(InputError, match=r'"a/B" has arrays with more than 100000 entries'):
            read_measurements(defined(tmp_path / "large.mcap", definition))
