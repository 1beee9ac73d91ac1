"""STEP, STL and glTF files of a solid, read back by independent means."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

import bowstring as bs
from bowstring.cad.export import check_solid_file, write_solid
from bowstring.cad.solid import make_solid
from bowstring.errors import InputError
from bowstring.files.atomic_io import write_whole_file
from objects import refused

bd = pytest.importorskip("build123d", exc_type=ImportError)
pytestmark = pytest.mark.cad


@pytest.fixture(scope="module")
def solid():
    robot = bs.load_robot("amouri2019", {"segments.0.disks.clamped_length": "3 mm"})
    return make_solid(robot, bs.solve(robot, tensions=[60, 0, 20]))


def rgb(colour):
    return np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255


def test_step_holds_named_coloured_parts(solid, tmp_path):
    file = write_solid(solid, tmp_path / "robot.step")
    assert file == tmp_path / "robot.step" and list(tmp_path.iterdir()) == [file]
    read = bd.import_step(file)
    assert read.label == "amouri2019"
    assert [child.label for child in read.children] == [part.name for part in solid.parts]
    for child, part in zip(read.children, solid.parts, strict=True):
        assert len(child.solids()) == 1 and child.is_valid
        assert 1e-9 * child.volume == pytest.approx(part.volume_m3, rel=1e-6)
        np.testing.assert_allclose(tuple(child.color)[:3], rgb(part.colour), atol=2e-3)
    text = file.read_text("ascii")
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    assert (
        f"'robot_hash: {solid.robot.hash}'" in text
        and "'pose: simulated, tendon 1 at 60 N, tendon 3 at 20 N'" in text
    )
    assert "'assumed: segments[0].disks.hole_diameter = 2 mm" in text


def test_an_assembly_keeps_its_parts_when_a_file_is_written(solid, tmp_path):
    mine = solid.assembly()
    write_solid(solid, tmp_path / "robot.stl")
    assert [child.label for child in mine.children] == [part.name for part in solid.parts]
    assert mine.volume == pytest.approx(1e9 * sum(part.volume_m3 for part in solid.parts))


def triangles(file):
    """Corners (F, 3, 3) of an STL file in mm."""
    raw = file.read_bytes()[84:]
    return np.frombuffer(raw, dtype=np.dtype("(3,)<f4,(3,3)<f4,<u2"))["f1"].astype(float)


SIZES = {  # of the study's robot, and scaled versions
    "segments.0.length": 641,
    "segments.0.backbone.diameter": 5,
    "segments.0.disks.radius": 32,
    "segments.0.disks.thickness": 3,
    "segments.0.tendons.pitch_radius": 29,
}


@pytest.mark.parametrize("share", [1.0, 1e-3, 50.0])
def test_mesh_error_is_within_its_tolerance_at_any_size(tmp_path, share):
    robot = bs.load_robot("amouri2019", {k: f"{share * v} mm" for k, v in SIZES.items()})
    pose = bs.solve(robot, [60 * share**2, 0, 0])  # the same shape
    corners = triangles(write_solid(make_solid(robot, pose), tmp_path / "robot.stl")) / 1e3
    assert 30_000 < len(corners) < 80_000
    # on the backbone, away from its ends and the bores of the disks, which have its radius
    corners = corners / robot.length
    path = np.concatenate(pose.to_dataset(points=401)["position"].to_numpy()) / robot.length
    radius = 0.5 * robot.segments[0].backbone.diameter / robot.length
    tree = cKDTree(path)
    share_of = np.random.default_rng(1).dirichlet([1, 1, 1], 10)
    far, _ = tree.query(corners.reshape(-1, 3))
    mine = (far.reshape(-1, 3) < 1.01 * radius).all(axis=1)
    inside = np.einsum("wk,fki->fwi", share_of, corners[mine])
    ends = path[[0, -1]]
    apart = np.linalg.norm(inside[:, :, None] - ends, axis=-1).min(axis=(1, 2))
    far, _ = tree.query(inside[apart > 3 * radius])
    assert len(far) > 1000
    assert np.abs(far - radius).max() < 1e-4


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_gltf_has_colours_and_what_it_is_of(solid, tmp_path, suffix):
    """`test_cad_foreign_readers` has names, volumes and places of the meshes."""
    file = write_solid(solid, tmp_path / f"robot.{suffix}")
    assert list(tmp_path.iterdir()) == [file]
    raw = file.read_bytes()
    if suffix == "glb":
        size, kind = struct.unpack_from("<I4s", raw, 12)
        assert kind == b"JSON" and size % 4 == 0
        raw = raw[20 : 20 + size]
    content = json.loads(raw)
    (root,) = (content["nodes"][i] for i in content["scenes"][0]["nodes"])
    for i, part in zip(root["children"], solid.parts, strict=True):
        (primitive,) = content["meshes"][content["nodes"][i]["mesh"]]["primitives"]
        material = content["materials"][primitive["material"]]["pbrMetallicRoughness"]
        assert material["metallicFactor"] == 0.1
        # sRGB colours, made linear as the standard requires
        screen = rgb(part.colour)
        linear = np.where(screen <= 0.04045, screen / 12.92, ((screen + 0.055) / 1.055) ** 2.4)
        np.testing.assert_allclose(material["baseColorFactor"], [*linear, 1], atol=2e-3)
    about = content["asset"]["extras"]
    assert about["robot_hash"] == solid.robot.hash
    assert about["pose"].startswith("simulated, tendon 1 at 60 N")
    assert content["asset"]["version"] == "2.0"


def test_names_with_non_ascii_letters(tmp_path):
    robot = bs.load_robot("amouri2019", {"name": "Röbot 机's"})
    read = bd.import_step(write_solid(make_solid(robot), tmp_path / "r.stp"))
    assert read.label == "Robot_s"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("robot.obj", "its name must end in .step, .stp, .stl, .glb or .gltf"),
        ("robot", "its name must end in"),
        ("none/robot.step", "none does not exist"),
        ("folder.step", "it is a folder"),
        ("file.txt/robot.step", "file.txt is a file"),
        ("a" * 300 + ".step", "File name too long"),
    ],
)
def test_impossible_files(tmp_path, name, says):
    (tmp_path / "folder.step").mkdir()
    (tmp_path / "file.txt").write_text("mine")
    with pytest.raises(InputError, match="cannot write the solid to") as caught:
        check_solid_file(tmp_path / name)
    assert says in str(caught.value)


@pytest.mark.parametrize("given", ["is_dir", "exists"])
def test_folders_without_search_permission(tmp_path, monkeypatch, given):
    def denied(self):  # root may search any folder
        raise PermissionError(13, "Permission denied")

    (tmp_path / "closed").mkdir()
    monkeypatch.setattr(Path, given, denied)
    with pytest.raises(InputError, match=r"cannot write the solid to .*: Permission denied"):
        check_solid_file(tmp_path / "closed" / "robot.step")


def test_a_failure_keeps_the_former_file(tmp_path, solid, monkeypatch):
    file = tmp_path / "robot.step"
    file.write_text("bowstring_version: former")
    monkeypatch.setattr(bd, "export_step", lambda *_: False)
    refused(r"cannot write the solid .* the CAD kernel failed", lambda: write_solid(solid, file))

    def full(new):
        new.write_text("half of it")
        raise OSError(28, "No space left on device")

    refused("No space left on device", lambda: write_whole_file(file, "solid", full))
    assert file.read_text() == "bowstring_version: former" and list(tmp_path.iterdir()) == [file]
