"""Binary glTF of a run, read by VTK, which animates it, and by trimesh, which knows no skins."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkGLTFReader

from bowstring import load_robot
from bowstring.aliases import Floats
from bowstring.integrations.gltf import write_glb
from bowstring.statics import fields
from made_frames import made_frames
from objects import refused

ROBOT = load_robot("amouri2019")
#: The first is not zero: the file counts from it.
TIMES = np.array([0.3, 0.4, 0.55])
AROUND = 20


@pytest.fixture(scope="module")
def data():
    return fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES), {})


@pytest.fixture(scope="module")
def file(data, tmp_path_factory) -> Path:
    return write_glb(ROBOT, data, tmp_path_factory.mktemp("run") / "run.glb")


def read(file: Path, time: float) -> dict[str, Floats]:
    """Vertices of each part at a time, turned back to the axes of the base."""
    reader = vtkGLTFReader()
    reader.SetFileName(str(file))
    reader.SetFrameRate(0)
    reader.ApplyDeformationsToGeometryOn()
    reader.UpdateInformation()
    reader.EnableAnimation(0)
    reader.UpdateInformation()
    reader.UpdateTimeStep(time)
    blocks, found = reader.GetOutput().NewIterator(), []
    blocks.InitTraversal()
    while not blocks.IsDoneWithTraversal():
        points = vtk_to_numpy(blocks.GetCurrentDataObject().GetPoints().GetData())
        x, up, towards = points.astype(float).T
        found.append(np.stack([x, -towards, up], axis=1))
        blocks.GoToNextItem()
    return dict(zip([mesh["name"] for mesh in head(file)["meshes"]], found, strict=True))


def rings(points: Floats) -> Floats:
    """Rings of a part, without its two ends, each a ring and its middle."""
    return points[: -2 * (AROUND + 1)].reshape(-1, AROUND, 3)


def head(file: Path) -> dict:
    raw = file.read_bytes()
    magic, version, size, length, kind = struct.unpack("<4sIII4s", raw[:20])
    assert (magic, version, kind, size) == (b"glTF", 2, b"JSON", len(raw))
    return json.loads(raw[20 : 20 + length])


@pytest.mark.parametrize("i", [0, 1, 2])
def test_every_part_moves_with_the_run(file, data, i):
    parts = read(file, float(TIMES[i] - TIMES[0]))
    now = data.isel(time=i, station=np.unique(data["arc_length"], return_index=True)[1])
    backbone = rings(parts.pop("backbone"))
    assert backbone.mean(axis=1) == pytest.approx(now["position"].to_numpy(), abs=1e-6)
    radius = ROBOT.segments[0].backbone.outer_diameter / 2
    arms = backbone - now["position"].to_numpy()[:, None]
    assert np.linalg.norm(arms, axis=2) == pytest.approx(radius, abs=1e-6)
    assert np.einsum("pai,pi->pa", arms, now["rotation"].to_numpy()[:, :, 2]) == pytest.approx(
        0.0, abs=1e-6
    )
    for d, (at, thick, wide) in enumerate(
        zip(
            now["disk_position"].to_numpy(),
            ROBOT.disks.thickness_m,
            ROBOT.disks.radius_m,
            strict=True,
        ),
        1,
    ):
        disk = parts.pop(f"disk_{d}")
        assert disk.mean(axis=0) == pytest.approx(at, abs=1e-6)
        reach = np.linalg.norm(disk - at, axis=1).max()
        assert reach == pytest.approx(np.hypot(wide, thick / 2), abs=1e-6)
    paths = ROBOT.tendon_points(data["disk_position"].to_numpy(), data["disk_rotation"].to_numpy())
    assert [*parts] == ["tendon_1", "tendon_2", "tendon_3"]
    for found, path in zip(parts.values(), paths, strict=True):
        assert rings(found).mean(axis=1) == pytest.approx(path[i], abs=1e-6)


def test_a_program_without_skins_shows_the_first_time(tmp_path):
    robot = load_robot(
        "rao2021",
        {"segments.1.disks.count": 2, "segments.1.disks.thickness": 0},
    )
    data = fields.to_dataset(robot, made_frames(robot, TIMES), {})
    scene = trimesh.load_scene(write_glb(robot, data, tmp_path / "run.glb"))
    names = ["backbone_1", "backbone_2", *(f"disk_{d + 1}" for d in range(12))]
    names += [f"tendon_{t + 1}" for t in range(6)]
    assert set(scene.graph.nodes_geometry) == set(names) and len(scene.geometry) == len(names)
    flat = AROUND / 2 * np.sin(2 * np.pi / AROUND)  # of the unit circle's polygon
    volume = {}
    for name in names:
        place, mesh = scene.graph[name]
        part = scene.geometry[mesh].apply_transform(place)
        part.merge_vertices(merge_norm=True)
        assert (part.area_faces > 0).all()
        if name not in ("disk_11", "disk_12"):  # flat ones are two faces
            assert part.is_watertight and part.is_winding_consistent
            volume[name] = part.volume
    for d, (at, disk) in enumerate(zip(data["disk_position"][0], names[2:14], strict=True)):
        centre = scene.geometry[scene.graph[disk][1]].vertices.mean(axis=0)
        assert [centre[0], -centre[2], centre[1]] == pytest.approx(at.to_numpy(), abs=1e-6)
        full = flat * robot.disks.radius_m[d] ** 2 * robot.disks.thickness_m[d]
        assert volume.get(disk, 0.0) == pytest.approx(full, rel=1e-5)
    ends = data["module"].to_numpy()
    for k, name in enumerate(names[:2]):
        mine = data["position"].to_numpy()[0, robot.disks.segment[ends - 1] == k]
        length = np.linalg.norm(np.diff(mine, axis=0), axis=1).sum()
        section = flat * (robot.segments[k].backbone.diameter / 2) ** 2
        assert volume[name] == pytest.approx(section * length, rel=1e-3)


def test_it_says_what_it_is(file):
    content = head(file)
    asset = content["asset"]
    assert asset["version"] == "2.0" and asset["extras"]["data_origin"] == "simulated"
    assert asset["extras"]["robot_hash"] == ROBOT.hash
    names = [mesh["name"] for mesh in content["meshes"]]
    parts = [*(f"disk_{d + 1}" for d in range(9)), "backbone", "tendon_1", "tendon_2", "tendon_3"]
    assert names == parts
    assert [node["name"] for node in content["nodes"] if "mesh" in node] == parts
    assert all(len(mesh["primitives"]) == 1 for mesh in content["meshes"])
    (animation,) = content["animations"]
    time = content["accessors"][animation["samplers"][0]["input"]]
    assert time["min"] == [0.0] and time["max"] == pytest.approx([0.25])


def test_neighbouring_rotations_do_not_turn_the_long_way(data, tmp_path):
    turning = data.copy(deep=True)
    for name in ("disk_rotation", "rotation"):
        for k, angle in enumerate((3.0, 3.3, 3.6)):  # past half a turn about z
            c, s = np.cos(angle), np.sin(angle)
            spin = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            turning[name][k] = turning[name][k].to_numpy() @ spin
    file = write_glb(ROBOT, turning, tmp_path / "turning.glb")
    raw, content = file.read_bytes(), head(file)
    binary = raw[raw.index(b"BIN\0") + 4 :]
    for sampler in content["animations"][0]["samplers"]:
        accessor = content["accessors"][sampler["output"]]
        if accessor["type"] == "VEC4":
            view = content["bufferViews"][accessor["bufferView"]]
            q = np.frombuffer(binary, "<f4", 4 * accessor["count"], view["byteOffset"])
            q = q.reshape(-1, 4)
            assert ((q[1:] * q[:-1]).sum(axis=1) > 0.9).all()


def test_one_time_is_a_solid_at_rest(data, tmp_path):
    file = write_glb(ROBOT, data.isel(time=[1]), tmp_path / "rest.glb")
    assert "animations" not in head(file)


def test_only_a_former_file_is_replaced(file, data, tmp_path):
    mine = tmp_path / "mine.glb"
    mine.write_bytes(b"glTF of another program")
    refused("not overwritten", lambda: write_glb(ROBOT, data, mine))
    assert mine.read_bytes() == b"glTF of another program"
    again = file.read_bytes()
    assert write_glb(ROBOT, data, file).read_bytes() == again
    refused(r"must end in \.glb", lambda: write_glb(ROBOT, data, tmp_path / "run.obj"))
    rao = load_robot("rao2021")
    refused("of another robot", lambda: write_glb(rao, data, tmp_path / "run.glb"))
