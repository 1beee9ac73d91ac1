"""Exported solids as other programs read them, beside the robot and its solver.

STL and glTF are read by trimesh, STEP by steputils, a parser without geometry. No reader has code
of the CAD kernel.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from steputils import p21

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.cad.export import write_solid
from bowstring.cad.solid import Solid, make_solid

pytest.importorskip("build123d", exc_type=ImportError)
pytestmark = pytest.mark.cad

# tendons 1 to 3 share holes with 4 to 6, and the backbones meet: solids that touch
ROBOT = bs.load_robot(
    "rao2021",
    {
        "segments.0.disks.count": 2,
        "segments.1.disks.count": 2,
        "segments.0.disks.hole_diameter": "0.9 mm",
        "segments.1.disks.hole_diameter": "0.8 mm",
        "segments.0.tendons.diameter": "0.4 mm",
        "segments.1.tendons.diameter": "0.4 mm",
    },
)
DEFLECTION = 1e-4 * ROBOT.length


class Expected(NamedTuple):
    """Volume and bounding box (2, 3) of a part, m."""

    volume: float
    box: Floats


@pytest.fixture(scope="module")
def pose() -> bs.Solution:
    return bs.solve(ROBOT, [0.8, 0, 0, 0, 0.4, 0])


@pytest.fixture(scope="module")
def tip(pose: bs.Solution) -> Floats:
    return pose.tip.position


@pytest.fixture(scope="module")
def solid(pose: bs.Solution) -> Solid:
    return make_solid(ROBOT, pose)


@pytest.fixture(scope="module")
def parts(pose: bs.Solution) -> dict[str, Expected]:
    """What the robot's numbers and the solver's frames say of each part."""

    def box(points: Floats, axes: Floats, radius: float) -> Floats:
        """Of circles about axes."""
        reach = radius * np.sqrt(np.clip(1 - axes**2, 0, None))
        return np.stack([(points - reach).min(axis=0), (points + reach).max(axis=0)])

    def plate(at: Floats, axis: Floats, radius: float, thickness: float) -> Floats:
        half = thickness / 2 * axis
        return box(np.stack([at - half, at + half]), axis, radius)

    up, disks = np.array([0.0, 0.0, 1.0]), ROBOT.disks
    radius, thickness = 1.25 * disks.radius_m[0], 2 * disks.thickness_m[0]
    holes = 3 * np.pi * 0.45e-3**2
    found = {
        "base": Expected(
            (np.pi * radius**2 - holes) * thickness,
            plate(-thickness / 2 * up, up, radius, thickness),
        )
    }
    data = pose.to_dataset(points=101).isel(time=0)
    segment = disks.segment[data["module"].to_numpy() - 1]
    for k in range(2):
        at = data["position"].to_numpy()[segment == k]
        axes = data["rotation"].to_numpy()[segment == k, :, 2]
        r = ROBOT.segments[k].backbone.diameter / 2
        length = np.linalg.norm(np.diff(at, axis=0), axis=1).sum()
        found[f"backbone_{k + 1}"] = Expected(np.pi * r**2 * length, box(at, axes, r))
    for d, (at, turned) in enumerate(zip(pose.disk_positions, pose.disk_rotations, strict=True)):
        r, t = disks.radius_m[d], disks.thickness_m[d]
        hole = 0.45e-3 if disks.segment[d] == 0 else 0.4e-3
        area = np.pi * (r**2 - 3 * hole**2 - (disks.bore_m[d] / 2) ** 2)
        found[f"disk_{d + 1}"] = Expected(area * t, plate(at, turned[:, 2], r, t))
    paths = ROBOT.tendon_points(pose.disk_positions, pose.disk_rotations)
    for k, (path, length) in enumerate(zip(paths, pose.tendon_lengths, strict=True)):
        along = np.diff(path, axis=0)
        along /= np.linalg.norm(along, axis=1)[:, None]
        ends = np.concatenate([path[:-1], path[1:]])
        r = 0.2e-3
        found[f"tendon_{k + 1}"] = Expected(
            np.pi * r**2 * length, box(ends, np.tile(along, (2, 1)), r)
        )
    return found


def beside(found: Floats, expected: Floats, tolerance: float) -> bool:
    return bool(np.abs(found - expected).max() < tolerance)


# -- STL -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("bent", [False, True])
def test_stl_is_closed_edge_by_edge(solid: Solid, tmp_path: Path, bent: bool) -> None:
    file = write_solid(solid if bent else make_solid(ROBOT), tmp_path / "robot.stl")
    raw = np.frombuffer(file.read_bytes()[84:], np.dtype("<3f4,<(3,3)f4,<u2"))["f1"]
    _, name = np.unique(raw.reshape(-1, 3), axis=0, return_inverse=True)
    a, b, c = name.reshape(-1, 3).T
    # each edge once in each direction, and no more
    edges, times = np.unique(
        np.concatenate([np.stack(pair, axis=1) for pair in ((a, b), (b, c), (c, a))]),
        axis=0,
        return_counts=True,
    )
    assert (times == 1).all() and (edges[:, 0] != edges[:, 1]).all()
    assert {tuple(edge) for edge in edges.tolist()} == {
        tuple(edge) for edge in edges[:, ::-1].tolist()
    }
    corners = raw.astype(float)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert np.linalg.norm(across, axis=1).min() > 1e-6  # mm^2


def test_stl_in_trimesh(
    solid: Solid, parts: dict[str, Expected], tip: Floats, tmp_path: Path
) -> None:
    mesh = trimesh.load_mesh(write_solid(solid, tmp_path / "robot.stl"))
    assert mesh.is_watertight and mesh.is_winding_consistent
    bodies = [body.apply_scale(1e-3) for body in mesh.split(only_watertight=True)]
    assert len(bodies) == len(parts)
    for name, part in parts.items():
        (body,) = (each for each in bodies if beside(each.bounds, part.box, DEFLECTION))
        assert body.volume == pytest.approx(part.volume, rel=0.02), name
        if name == "disk_4":
            assert body.center_mass == pytest.approx(tip, abs=1e-6)


# -- glTF ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["glb", "gltf"])
def test_gltf_in_trimesh(
    solid: Solid, parts: dict[str, Expected], tip: Floats, tmp_path: Path, suffix: str
) -> None:
    file = write_solid(solid, tmp_path / f"robot.{suffix}")
    scene = trimesh.load_scene(file)
    assert set(scene.graph.nodes_geometry) == set(parts) and len(scene.geometry) == len(parts)
    z_up = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    for name, part in parts.items():
        place, mesh = scene.graph[name]
        body = scene.geometry[mesh].apply_transform(z_up @ place)
        body.merge_vertices(merge_norm=True, merge_tex=True)
        assert body.is_watertight and body.is_winding_consistent, name
        assert body.volume == pytest.approx(part.volume, rel=0.02), name
        assert beside(body.bounds, part.box, DEFLECTION), name
        if name == "disk_4":
            assert body.center_mass == pytest.approx(tip, abs=1e-6)


# -- STEP ----------------------------------------------------------------------------------------


def test_step_in_steputils(
    solid: Solid, parts: dict[str, Expected], tip: Floats, tmp_path: Path
) -> None:
    """`test_cad_export` has the volumes."""
    found: dict[str, list[list[Any]]] = {}
    file = p21.readfile(str(write_solid(solid, tmp_path / "robot.step")))
    for each in file.data[0].instances.values():
        if hasattr(each, "entity"):
            found.setdefault(each.entity.name, []).append(each.entity.params)
    assert [params[0] for params in found["PRODUCT"]] == ["rao2021", *parts]
    assert len(found["MANIFOLD_SOLID_BREP"]) == len(parts)
    places = [params[1] for params in found["CARTESIAN_POINT"] if len(params[1]) == 3]
    points = np.array(places, dtype=float)
    assert np.abs(1e-3 * points - tip).max(axis=1).min() < 1e-9
