"""Binary glTF of a run, read and animated by VTK, which shares no code with the writer."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkGLTFReader

from bowstring import load_robot
from bowstring.errors import InputError
from bowstring.integrations.gltf import write_glb
from bowstring.statics import fields
from made_frames import made_frames
from shell import Shell

Floats = NDArray[np.float64]

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


def read(file: Path, time: float) -> list[Floats]:
    """Vertices of each surface at a time, turned back to the axes of the base."""
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
    return found


def head(file: Path) -> dict:
    raw = file.read_bytes()
    magic, version, size, length, kind = struct.unpack("<4sIII4s", raw[:20])
    assert (magic, version, kind, size) == (b"glTF", 2, b"JSON", len(raw))
    return json.loads(raw[20 : 20 + length])


@pytest.mark.parametrize("i", [0, 1, 2])
def test_every_surface_moves_with_the_run(file, data, i):
    backbone, disks, *tendons = read(file, float(TIMES[i] - TIMES[0]))
    now = data.isel(time=i)
    rings = backbone.reshape(-1, AROUND, 3)
    assert rings.mean(axis=1) == pytest.approx(now["position"].to_numpy(), abs=1e-6)
    radius = ROBOT.segments[0].backbone.outer_diameter / 2
    arms = rings - now["position"].to_numpy()[:, None]
    assert np.linalg.norm(arms, axis=2) == pytest.approx(radius, abs=1e-6)
    assert np.einsum("pai,pi->pa", arms, now["rotation"].to_numpy()[:, :, 2]) == pytest.approx(
        0.0, abs=1e-6
    )
    middle = disks.reshape(len(ROBOT.disks.station_m), -1, 3).mean(axis=1)
    assert middle == pytest.approx(now["disk_position"].to_numpy(), abs=1e-6)
    reach = np.linalg.norm(disks.reshape(len(middle), -1, 3) - middle[:, None], axis=2).max()
    half = ROBOT.disks.thickness_m.max() / 2
    assert reach == pytest.approx(np.hypot(ROBOT.disks.radius_m.max(), half), abs=1e-6)
    paths = ROBOT.tendon_points(data["disk_position"].to_numpy(), data["disk_rotation"].to_numpy())
    assert len(tendons) == len(paths) == 3
    for found, path in zip(tendons, paths, strict=True):
        assert found.reshape(-1, AROUND, 3).mean(axis=1) == pytest.approx(path[i], abs=1e-6)


def test_it_says_what_it_is(file):
    content = head(file)
    asset = content["asset"]
    assert asset["version"] == "2.0" and asset["extras"]["data_origin"] == "simulated"
    assert asset["extras"]["robot_hash"] == ROBOT.hash
    names = [mesh["name"] for mesh in content["meshes"]]
    assert names == ["backbone", "disks", "tendon 1", "tendon 2", "tendon 3"]
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
    with pytest.raises(InputError, match="not overwritten"):
        write_glb(ROBOT, data, mine)
    assert mine.read_bytes() == b"glTF of another program"
    again = file.read_bytes()
    assert write_glb(ROBOT, data, file).read_bytes() == again
    with pytest.raises(InputError, match=r"must end in \.glb"):
        write_glb(ROBOT, data, tmp_path / "run.obj")
    with pytest.raises(InputError, match="of another robot"):
        write_glb(load_robot("rao2021"), data, tmp_path / "run.glb")


def test_the_command_writes_it(shell: Shell, tmp_path: Path) -> None:
    out = tmp_path / "run.glb"
    call = ("simulate", "amouri2019", "--tension", "40,0,0", "--rise", "0.02", "--hold", "0")
    found = shell.json(*call, "--out", str(out))
    assert found["files"]["glb"] == str(out)
    tips = [read(out, t)[0].reshape(-1, AROUND, 3).mean(axis=1)[-1] for t in (0.0, 0.02)]
    assert tips[0] == pytest.approx(found["tip_position_m"][0], abs=1e-6)
    assert tips[1] == pytest.approx(found["tip_position_m"][-1], abs=1e-6)
