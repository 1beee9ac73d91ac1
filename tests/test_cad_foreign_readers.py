"""Exported solids as other programs read them, beside the robot and its solver.

STL and glTF are read by trimesh. STEP is read by steputils, a parser without geometry: volumes and
boxes are integrated here from the surfaces of ISO 10303-42. No reader has code of the CAD kernel.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.interpolate import BPoly
from steputils import p21

import bowstring as bs
from bowstring.cad.export import write_solid
from bowstring.cad.solid import Solid, make_solid

pytest.importorskip("build123d", exc_type=ImportError)
pytestmark = pytest.mark.cad

Floats = NDArray[np.float64]

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


class Step:
    """Parts of a STEP file of planes, whole cylinders and whole Bezier patches, in mm."""

    def __init__(self, file: Path) -> None:
        self.data = p21.readfile(str(file)).data[0].instances

    def all(self, name: str) -> list[list[Any]]:
        """Parameters of the entities of a name."""
        return [
            each.entity.params
            for each in self.data.values()
            if hasattr(each, "entity") and each.entity.name == name
        ]

    def of(self, reference: str, name: str = "") -> tuple[str, list[Any]]:
        """Name and parameters of an entity, of several at once that of a name."""
        found = self.data[reference]
        if hasattr(found, "entity"):
            return found.entity.name, found.entity.params
        (entity,) = (each for each in found.entities if each.name == (name or "B_SPLINE_SURFACE"))
        return entity.name, entity.params

    def vector(self, reference: str) -> Floats:
        return np.array(self.of(reference)[1][1], dtype=float)

    def net(self, params: list[Any]) -> Floats:
        """Control points of a surface; those of a curve are one row."""
        poles = next(each for each in params if isinstance(each, p21.ParameterList))
        rows = poles if isinstance(poles[0], p21.ParameterList) else [poles]
        return np.array([[self.vector(pole) for pole in row] for row in rows])

    def frame(self, reference: str) -> tuple[Floats, Floats]:
        """Origin and axes (columns) of a placement."""
        _, (_, origin, axis, first) = self.of(reference)
        z, x = self.vector(axis), self.vector(first)
        return self.vector(origin), np.stack([x, np.cross(z, x), z], axis=1)

    def parts(self) -> dict[str, tuple[float, Floats, Floats]]:
        """Volume, bounding box and origin of each part, by name."""
        shapes = {}
        for definition, shape in self.all("SHAPE_DEFINITION_REPRESENTATION"):
            shapes[self.of(definition)[1][2]] = shape
        found = {}
        for relation, place in self.all("CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"):
            _, name, _, _, definition, _ = self.of(self.of(place)[1][2])[1]
            transformation = self.of(relation, "REPRESENTATION_RELATIONSHIP_WITH_TRANSFORMATION")[1]
            _, _, start, end = self.of(transformation[0])[1]
            assert self.frame(start)[0] == pytest.approx(0.0, abs=0) and name not in found
            (solid,) = (
                params
                for kind, params in map(self.of, self.of(shapes[definition])[1][1])
                if kind == "MANIFOLD_SOLID_BREP"
            )
            volume, points = 0.0, []
            origin, axes = self.frame(end)
            for face in self.of(solid[1])[1][1]:
                share, on_face = self.face(face)
                volume += share
                points.append(origin + on_face @ axes.T)
            points = np.concatenate(points)
            found[name] = volume, np.stack([points.min(axis=0), points.max(axis=0)]), origin
        return found

    def face(self, reference: str) -> tuple[float, Floats]:
        """A third of the flow of the position through a face, and points on it."""
        _, (_, bounds, surface, same_sense) = self.of(reference)
        sign = 1.0 if same_sense == ".T." else -1.0
        kind, params = self.of(surface)
        edges = [edge for bound in bounds for edge in self.edges(bound)]
        points = np.concatenate([on_edge for _, on_edge in edges])
        if kind == "PLANE":
            origin, axes = self.frame(params[1])
            area = np.sum([swept for swept, _ in edges], axis=0) @ axes[:, 2]
            assert sign * area > 0  # counter-clockwise about the outer normal
            return origin @ axes[:, 2] * area / 3, points
        if kind == "CYLINDRICAL_SURFACE":
            (_, axes), radius = self.frame(params[1]), params[2]
            height = np.ptp(points @ axes[:, 2])
            return sign * 2 * np.pi * radius**2 * height / 3, points
        net = self.net(params)
        weights = self.of(surface, "RATIONAL_B_SPLINE_SURFACE")[1][0]
        u, w = np.polynomial.legendre.leggauss(12)
        u, w = (u + 1) / 2, w / 2
        place, along, around = patch(net, np.array(weights, dtype=float), u)
        flow = np.einsum("uvi,uvi,u,v->", place, np.cross(along, around), w, w)
        return sign * flow / 3, points

    def edges(self, bound: str) -> list[tuple[Floats, Floats]]:
        """Area vector swept from the origin along each edge of a bound, and points on it."""
        _, (_, loop, bound_forward) = self.of(bound)
        found = []
        for oriented in self.of(loop)[1][1]:
            _, (_, _, _, edge, forward) = self.of(oriented)
            _, (_, start, end, curve, same_sense) = self.of(edge)
            sign = np.prod([1 if f == ".T." else -1 for f in (bound_forward, forward, same_sense)])
            ends = [self.vector(self.of(vertex)[1][1]) for vertex in (start, end)]
            if self.of(curve, "B_SPLINE_CURVE")[0] in ("SURFACE_CURVE", "SEAM_CURVE"):
                curve = self.of(curve)[1][1]
            kind, params = self.of(curve, "B_SPLINE_CURVE")
            if kind == "LINE":
                swept, points = np.cross(*ends) / 2, np.array(ends)
            elif kind == "CIRCLE":
                assert start == end
                (origin, axes), radius = self.frame(params[1]), params[2]
                turn = np.linspace(0, 2 * np.pi, 721)
                points = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1) @ axes[:, :2].T
                swept, points = np.pi * radius**2 * axes[:, 2], origin + points
            else:
                net = self.net(params)
                weights = np.ones(net.shape[:2])
                if not hasattr(self.data[curve], "entity"):
                    rational = self.of(curve, "RATIONAL_B_SPLINE_CURVE")[1][0]
                    weights = np.array(rational, dtype=float)[None]
                u, w = np.polynomial.legendre.leggauss(40)
                place, _, tangent = patch(net, weights, (u + 1) / 2)
                swept = w / 2 @ np.cross(place[0], tangent[0]) / 2
                points = patch(net, weights, np.linspace(0, 1, 91))[0][0]
            found.append((sign * swept, points))
        return found


def patch(net: Floats, weights: Floats, t: Floats) -> tuple[Floats, Floats, Floats]:
    """Points and derivatives of a rational Bezier surface, of both parameters at `t`."""
    homogeneous = np.concatenate([net * weights[..., None], weights[..., None]], axis=-1)

    def curves(points: Floats, derivative: int) -> Floats:
        return BPoly(points[:, None], [0.0, 1.0])(t, derivative)

    def both(u: int, v: int) -> Floats:
        rows = curves(homogeneous, u) if len(net) > 1 else homogeneous * (u == 0)
        return curves(rows.swapaxes(0, 1), v).swapaxes(0, 1)

    whole = both(0, 0)
    place = whole[..., :3] / whole[..., 3:]
    slopes = [
        (each[..., :3] - place * each[..., 3:]) / whole[..., 3:]
        for each in (both(1, 0), both(0, 1))
    ]
    return place, *slopes


def test_step_in_steputils(
    solid: Solid, parts: dict[str, Expected], tip: Floats, tmp_path: Path
) -> None:
    step = Step(write_solid(solid, tmp_path / "robot.step"))
    found = step.parts()
    assert list(found) == list(parts)
    assert [params[0] for params in step.all("PRODUCT")] == ["rao2021", *parts]
    for name, part in parts.items():
        volume, box, _ = found[name]
        assert 1e-9 * volume == pytest.approx(part.volume, rel=1e-6), name
        assert beside(1e-3 * box, part.box, 1e-6), name
    assert 1e-3 * found["disk_4"][2] == pytest.approx(tip, abs=1e-9)
