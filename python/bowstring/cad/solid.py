"""Solid of a robot: backbone, disks with holes, base and tendons, unloaded or in a pose.

Needs the extra ``cad`` (build123d, which contains the OpenCASCADE kernel). Shapes are in mm, as CAD
programs expect; all other values are in SI and in the base frame.

A bent backbone is bounded by rational Bezier patches, four around and one or more along the
flexible part of a module: their ends and eight further sections are circles exactly at the frames
of the solver or of the unloaded backbone. A tendon is a chain of cylinders from hole to hole,
mitred where they meet, so that its volume is its section times its length.
"""

from __future__ import annotations

import copy
import math
import re
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.errors import InputError
from bowstring.files.json_files import parsed, structured
from bowstring.formatting import listed, significant
from bowstring.optional import load_extra
from bowstring.robot.disk import outside_bore
from bowstring.robot.model import Robot, check_disks, check_robot, check_round
from bowstring.robot.parts import Backbone
from bowstring.robot.rest_shape import check_rest_bend, rest_frames
from bowstring.robot.sizes import Sizes, part_names, sizes_of
from bowstring.validation import shown
from bowstring.viz.vtk import check_data

if TYPE_CHECKING:
    import xarray as xr

    from bowstring.statics.solution import Solution

__all__ = ["MESHED", "Part", "Solid", "check_cad", "make_solid", "plain_name", "triangulate"]

_MM: Final = 1e3
_SECTIONS: Final = 8  # intervals of one patch, equal to its degree
_STRAIGHT: Final = 1e-7  # rad; spans that differ by less are one cylinder
_TURN: Final = 1.0  # rad; largest rotation of an unloaded backbone along one patch

# Screen colours (sRGB). The colour of a tendon depends on its number.
_BASE, _BACKBONE, _DISK = "#5d6673", "#3c4a5c", "#b9c6d3"
_TENDONS: Final = ("#c94f00", "#0072b2", "#007a5a", "#9c4c83", "#9a6a00", "#1b1f24")


@dataclass(frozen=True)
class Part:
    """One body of the robot.

    Attributes
    ----------
    name : str
        ``base``, ``backbone`` (``backbone_2`` of the second segment), ``disk_1`` ...,
        ``tendon_1`` ...
    kind : str
        ``base``, ``backbone``, ``disk`` or ``tendon``.
    colour : str
        ``#rrggbb``.
    shape : build123d.Solid
        Shape in mm at its position in the robot.
    mass_kg : float or None
        Mass in kg; None where the robot file has none.
    """

    name: str
    kind: str
    colour: str
    shape: Any = field(repr=False)
    mass_kg: float | None

    @property
    def volume_m3(self) -> float:
        """Volume in m^3."""
        return float(self.shape.volume) / _MM**3

    @property
    def centre_m(self) -> Floats:
        """Centre of the volume (3,) in m."""
        return self._properties()[0]

    @property
    def inertia_m5(self) -> Floats:
        """Inertia tensor of the volume (3, 3) about its centre, base axes, in m^5.

        Its product with a density is the inertia tensor of the mass.
        """
        return self._properties()[1]

    def _properties(self) -> tuple[Floats, Floats]:
        from OCP.BRepGProp import BRepGProp
        from OCP.GProp import GProp_GProps

        found = GProp_GProps()
        BRepGProp.VolumeProperties_s(self.shape.wrapped, found)
        centre, matrix = found.CentreOfMass(), found.MatrixOfInertia()
        return (
            np.array([centre.X(), centre.Y(), centre.Z()]) / _MM,
            np.array([[matrix.Value(i, j) for j in (1, 2, 3)] for i in (1, 2, 3)]) / _MM**5,
        )


@dataclass(frozen=True)
class Solid:
    """Solid of a robot; made by `make_solid`.

    Attributes
    ----------
    robot : Robot
    sizes : Sizes
        Sizes, given or assumed.
    parts : tuple of Part
        Base, backbones, disks, tendons, each from base to tip.
    tendon_paths : tuple of ndarray (k + 1, 3)
        Holes of each tendon from the base to its end disk k, in m.
    posed : bool
        Whether the robot has a pose; False for the unloaded robot.
    load : str
        Load of the pose in words; empty for the unloaded robot.
    """

    robot: Robot
    sizes: Sizes
    parts: tuple[Part, ...]
    tendon_paths: tuple[Floats, ...]
    posed: bool
    load: str

    def __getitem__(self, name: str) -> Part:
        for part in self.parts:
            if part.name == name:
                return part
        raise KeyError(name)

    def assembly(self) -> Any:
        """Parts as one build123d ``Compound`` with names and colours, in mm."""
        bd, children = check_cad(), []
        for part in self.parts:
            shape = copy.copy(part.shape)  # a shape can have one parent only
            shape.label, shape.color = part.name, bd.Color(part.colour)
            children.append(shape)
        return bd.Compound(label=plain_name(self.robot.name), children=children)


def check_cad() -> Any:
    """Import build123d.

    Raises
    ------
    InputError
        If it is not installed.
    """
    return load_extra("cad")


MESHED: Final = 1e9  # mm; tolerance for build123d that keeps the mesh of `triangulate`


def triangulate(shape: Any, deflection: float, angle: float) -> None:
    """Mesh a build123d shape; build123d's own tolerance is relative to the length of edges.

    Parameters
    ----------
    shape : build123d.Shape
        Shape that stores the mesh.
    deflection : float
        Largest distance from the surface, in mm.
    angle : float
        Angle between neighbouring facets, in rad.
    """
    from OCP.BRepMesh import BRepMesh_IncrementalMesh

    BRepMesh_IncrementalMesh(shape.wrapped, deflection, False, angle, True)


def plain_name(name: str) -> str:
    """Reduce a name to characters that every CAD program reads."""
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode("ascii")
    return re.sub(r"[^A-Za-z0-9.+-]+", "_", letters).strip("_") or "robot"


def make_solid(robot: Robot, pose: Solution | xr.Dataset | None = None) -> Solid:
    """Make the solid of a robot.

    Parameters
    ----------
    robot : Robot
        The robot.
    pose : Solution or xarray.Dataset, optional
        Equilibrium, or one output time of a run (``run.to_dataset().isel(time=[k])``); the
        default is the unloaded robot, straight or with the rest curvature of its backbone.

    Returns
    -------
    Solid
        Parts with names and colours, in mm.

    Raises
    ------
    InputError
        If build123d is not installed, a size is impossible (`sizes_of`), the pose is of another
        robot, or a bent backbone makes no valid solid.
    NoSolutionError
        If the solution did not converge.
    """
    check_robot(robot)
    check_round(robot, "the solid")
    check_disks(robot, "the solid")
    if pose is None:
        check_rest_bend(robot, "the solid")
    check_cad()
    sizes = sizes_of(robot)
    data = None if pose is None else _one_time(robot, pose)
    frames = _unloaded(robot) if data is None else _of_pose(data)
    paths = tuple(robot.tendon_points(frames.disk_position, frames.disk_rotation))
    parallel = frames.is_straight and robot.is_parallel
    parts = [
        Part("base", "base", _BASE, _base(robot, sizes), None),
        *_backbones(robot, frames),
        *_disks(robot, sizes, frames),
        *_tendons(robot, sizes, paths, parallel),
    ]
    load = "" if data is None else _load(data)
    return Solid(robot, sizes, tuple(parts), paths, data is not None, load)


class _Frames(NamedTuple):
    """Frames of P points of the flexible backbone and of N disks, base frame."""

    is_straight: bool
    """Whether the robot is straight, so that its parts are exact cylinders and cones."""
    module: Ints
    """Modules (P,) of the points, from 0."""
    arc_length: Floats
    """Arc lengths (P,), m."""
    position: Floats
    rotation: Floats
    disk_position: Floats
    disk_rotation: Floats


def _of_pose(data: xr.Dataset) -> _Frames:
    names = ("position", "rotation", "disk_position", "disk_rotation")
    module, arc_length = data["module"].to_numpy() - 1, data["arc_length"].to_numpy()
    return _Frames(False, module, arc_length, *(data[name].to_numpy()[0] for name in names))


def _unloaded(robot: Robot) -> _Frames:
    """Frames of the unloaded robot, in each module at the ends and sections of its patches."""
    disks = robot.disks
    half = 0.5 * disks.clamped_length_m
    start = np.concatenate([[0.0], disks.station_m[:-1] + half[:-1]])
    end = disks.station_m - half
    turn = np.linalg.norm(robot.rest_curvature, axis=1)[disks.segment] * (end - start)
    counts = _SECTIONS * np.maximum(np.ceil(turn / _TURN), 1.0).astype(int) + 1
    module = np.repeat(np.arange(len(counts)), counts)
    arc_length = np.concatenate(list(map(np.linspace, start, end, counts)))
    straight = not robot.rest_curvature.any()
    points, stations = rest_frames(robot, arc_length), rest_frames(robot, disks.station_m)
    return _Frames(straight, module, arc_length, *points, *stations)


def _one_time(robot: Robot, pose: Any) -> xr.Dataset:
    data: xr.Dataset = pose
    if hasattr(pose, "raise_for_status"):
        data = pose.to_dataset(points=_SECTIONS + 1)
    elif not hasattr(pose, "sizes"):
        raise InputError(f"pose is {shown(pose)}, it must be a solution or the fields of a run")
    check_data(robot, data)
    if data.sizes["time"] != 1:
        raise InputError(
            f"the pose has {data.sizes['time']} output times; choose one by .isel(time=[0])"
        )
    if np.bincount(data["module"].to_numpy())[1:].min() < 3:
        raise InputError("the pose has fewer than 3 points in a module; ask for 9")
    return data


_MOST_TENSIONS: Final = 3  # different tensions that are listed


def _load(data: xr.Dataset) -> str:
    """Describe a load: `tendon 1 at 60 N, tendons 2 and 3 at 5 N, with gravity`."""
    tensions = data["tension"].to_numpy()[0].tolist()
    most = max(map(abs, tensions))
    groups: dict[str, list[str]] = {}
    for i, tension in enumerate(tensions, 1):
        if abs(tension) > 1e-9 * most:
            groups.setdefault(significant(tension), []).append(str(i))
    if len(groups) > _MOST_TENSIONS:
        said = [f"tensions up to {significant(most)} N"]
    else:
        said = [
            f"tendon{'s' if len(which) > 1 else ''} {listed(which)} at {value} N"
            for value, which in groups.items()
        ]
    try:
        settings = structured(parsed(data.attrs["settings"]), dict[str, Any])
    except (KeyError, ValueError):
        raise InputError("the run is damaged: its settings are no JSON") from None
    kinds = {
        "gravity": ("gravity", "gravity_m_per_s2"),
        "a load at the tip": ("tip_force", "tip_moment", "tip_force_N", "tip_moment_Nm"),
        "loads on disks": (
            *("disk_forces", "disk_moments", "disk_forces_N", "disk_moments_Nm"),
            *("point_loads", "line_forces", "line_forces_N_per_m"),
        ),
    }
    acting = [
        kind
        for kind, names in kinds.items()
        if any(_acts(settings[name]) for name in names if name in settings)
    ]
    said = said or ["no tension"]
    if acting:
        said.append(f"with {listed(acting)}")
    if "duration_s" in settings:  # a run
        said.append(f"at {significant(float(data['time'][0]))} s")
    return ", ".join(said)


def _acts(load: Any) -> bool:
    """Whether a load of the settings, constant or a table over time, is not zero."""
    return bool(np.any(load.get("values", True) if isinstance(load, dict) else load))


# -- plates --------------------------------------------------------------------------------------


def _plate(radius: float, thickness: float, bore: float, places: Floats, hole: float) -> Any:
    """Round plate with axis z and centre at the origin; arguments in m, shape in mm."""
    bd = check_cad()
    low = -0.5 * _MM * thickness

    def circle(x: float, y: float, diameter: float) -> Any:
        at = bd.Plane((_MM * float(x), _MM * float(y), low))
        return bd.Wire.make_circle(0.5 * _MM * float(diameter), at)

    inner = [circle(x, y, hole) for x, y in places]
    if bore:
        inner.append(circle(0.0, 0.0, bore))
    face = bd.Face(circle(0.0, 0.0, 2.0 * radius), inner)
    return bd.Solid.extrude(face, (0.0, 0.0, _MM * thickness))


def _base(robot: Robot, sizes: Sizes) -> Any:
    bd, thick = check_cad(), sizes.base_thickness_m
    plate = _plate(sizes.base_radius_m, thick, 0.0, robot.holes(0), float(sizes.hole_m[0]))
    return plate.moved(bd.Location((0.0, 0.0, -0.5 * _MM * thick)))


def _disks(robot: Robot, sizes: Sizes, frames: _Frames) -> Iterator[Part]:
    bd, disks, names = check_cad(), robot.disks, part_names(robot).disks
    position, rotation = frames.disk_position, frames.disk_rotation
    for d in range(len(disks.station_m)):
        k = int(disks.segment[d])
        # separate shapes: disks that share one lose their names in some CAD programs
        plate = _plate(
            float(disks.radius_m[d]),
            float(disks.thickness_m[d]),
            float(disks.bore_m[d]),
            outside_bore(robot.holes(k, d), disks.bore_m[d]),
            float(sizes.hole_m[k]),
        )
        place = bd.Plane(
            tuple((_MM * position[d]).tolist()),
            x_dir=tuple(rotation[d, :, 0].tolist()),
            z_dir=tuple(rotation[d, :, 2].tolist()),
        )
        mass = float(disks.mass_kg[d])
        yield Part(names[d], "disk", _DISK, plate.moved(bd.Location(place)), mass)


# -- tubes ---------------------------------------------------------------------------------------

_HALF: Final = math.sqrt(0.5)


def _circle(radius: float) -> Floats:
    """Circle about z as four rational quadratic arcs.

    Control points (4, 3, 3) have the weights 1, sqrt(1/2), 1.
    """
    x = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [1, 0, 0]], dtype=float)
    return radius * np.stack([x[:-1], x[:-1] + x[1:], x[1:]], axis=1)


def _control(points: Floats) -> Floats:
    """Control points of the Bezier curve through points (n, ...) at equal steps."""
    n = len(points)
    t = np.linspace(0.0, 1.0, n)
    basis = np.array([math.comb(n - 1, j) * t**j * (1 - t) ** (n - 1 - j) for j in range(n)]).T
    made: Floats = np.linalg.solve(basis, points.reshape(n, -1)).reshape(points.shape)
    made[0], made[-1] = points[0], points[-1]  # so that neighbours meet exactly
    return made


def _tube(walls: list[list[Floats]]) -> Any:
    """Solid between two ends, inside the first wall and outside the second, if there is one.

    Each wall is a list of pieces of rings (n, 4, 3, 3) in m: circles along the wall, whose points
    are interpolated by Bezier curves. A piece begins with the last ring of the previous one.
    """
    bd = check_cad()
    faces = []
    for wall in walls:
        for piece in wall:
            net = _MM * _control(piece)
            for q in range(4):
                points = [[bd.Vector(*p) for p in row] for row in net[:, q].tolist()]
                weights = [[1.0, _HALF, 1.0]] * len(points)
                faces.append(bd.Face.make_bezier_surface(points, weights))
    for end in (0, -1):
        outer, *inner = [_ring(wall[end][end]) for wall in walls]
        faces.append(bd.Face(outer, inner))
    return bd.Solid(bd.Shell(faces))


def _ring(points: Floats) -> Any:
    bd = check_cad()
    weights = [1.0, _HALF, 1.0]
    return bd.Wire(
        [
            bd.Edge.make_bezier(*[bd.Vector(*p) for p in arc], weights=weights)
            for arc in (_MM * points).tolist()
        ]
    )


def _backbones(robot: Robot, frames: _Frames) -> Iterator[Part]:
    bd, start = check_cad(), 0.0
    for k, (s, name) in enumerate(zip(robot.segments, part_names(robot).backbones, strict=True)):
        rod = s.backbone
        if frames.is_straight:
            shape = _straight(bd, s.length, rod).moved(bd.Location((0, 0, _MM * start)))
        else:
            pieces = list(_pieces(robot, frames, k))
            walls = ["diameter", *(["inner_diameter"] if _bored(rod) else [])]
            shape = _tube([[_rings(piece, rod, wall) for piece in pieces] for wall in walls])
        start += s.length
        if not (frames.is_straight or shape.is_valid):
            raise InputError(
                f"{robot.name}: {name} makes no sound solid in this pose: its wall is too thin for "
                "the CAD kernel, or it is bent more tightly than it is thick"
            )
        mass = float(robot.mass_per_length[k]) * s.length
        yield Part(name, "backbone", _BACKBONE, shape, mass)


def _rod(bd: Any, length: float, diameters: list[float]) -> Any:
    outer, *inner = [bd.Wire.make_circle(0.5 * _MM * d) for d in diameters]
    return bd.Solid.extrude(bd.Face(outer, inner), (0.0, 0.0, _MM * length))


def _bored(rod: Backbone) -> bool:
    return rod.inner_diameter > 0 or bool(rod.end_inner_diameter)


def _straight(bd: Any, length: float, rod: Backbone) -> Any:
    """Straight backbone of a segment."""
    start, end = rod.at(0.0), rod.at(1.0)
    if not rod.is_tapered:
        assert rod.diameter is not None
        return _rod(bd, length, [d for d in (rod.diameter, rod.inner_diameter) if d])

    def cone(first: Any, last: Any) -> Any:
        return bd.Solid.make_cone(0.5 * _MM * float(first), 0.5 * _MM * float(last), _MM * length)

    whole = cone(start.diameter, end.diameter)
    return whole - cone(start.inner_diameter, end.inner_diameter) if _bored(rod) else whole


def _rings(piece: _Piece, rod: Backbone, wall: str) -> Floats:
    position, rotation, fraction = piece
    radius = np.broadcast_to(0.5 * getattr(rod.at(fraction), wall), fraction.shape)
    arms: Floats = np.einsum("n,nij,qcj->nqci", radius, rotation, _circle(1.0))
    return position[:, None, None] + arms


_Piece = tuple[Floats, Floats, Floats]
"""Positions, rotations and fractions of the segment of frames along a piece of backbone."""


def _pieces(robot: Robot, frames: _Frames, segment: int) -> Iterator[_Piece]:
    """Yield frames of a segment's backbone piece by piece, flexible and clamped ones."""
    _, module, arc_length, position, rotation, disk_position, disk_rotation = frames
    mine = np.flatnonzero(robot.disks.segment == segment).tolist()
    length = robot.segments[segment].length
    end_station = float(robot.disks.station_m[mine[-1]])
    fractions = 1.0 + (arc_length - end_station) / length
    here, turned, at = np.zeros(3), np.eye(3), 0.0
    if mine[0]:
        here, turned = disk_position[mine[0] - 1], disk_rotation[mine[0] - 1]
    short = 1e-9 * robot.length
    for d in mine:
        p, r, f = position[module == d], rotation[module == d], fractions[module == d]
        if np.linalg.norm(p[0] - here) > short:
            yield np.stack([here, p[0]]), np.stack([turned, r[0]]), np.array([at, f[0]])
        else:
            p, r = np.array([here, *p[1:]]), np.array([turned, *r[1:]])
        end = disk_position[d]
        clamped = np.linalg.norm(end - p[-1]) > short
        if not clamped:
            p, r = np.array([*p[:-1], end]), np.array([*r[:-1], disk_rotation[d]])
        for first in range(0, len(p) - 1, _SECTIONS):
            last = first + _SECTIONS + 1
            yield p[first:last], r[first:last], f[first:last]
        beyond = 1.0 + (float(robot.disks.station_m[d]) - end_station) / length
        if clamped:
            turns = np.stack([r[-1], disk_rotation[d]])
            yield np.stack([p[-1], end]), turns, np.array([f[-1], beyond])
        here, turned, at = end, disk_rotation[d], beyond


def _tendons(
    robot: Robot, sizes: Sizes, paths: tuple[Floats, ...], parallel: bool
) -> Iterator[Part]:
    bd = check_cad()
    for i, (path, name) in enumerate(zip(paths, part_names(robot).tendons, strict=True)):
        diameter = float(sizes.tendon_m[i])
        if parallel:
            at = bd.Location(tuple((_MM * path[0]).tolist()))
            shape = _rod(bd, float(path[-1, 2]), [diameter]).moved(at)
        else:
            shape = _tube([_mitred(path, 0.5 * diameter)])
        yield Part(name, "tendon", _TENDONS[i % len(_TENDONS)], shape, None)


def _mitred(path: Floats, radius: float) -> list[Floats]:
    """Rings of cylinders along a path (n, 3), mitred in the planes of symmetry."""
    along = np.diff(path, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    bends = np.linalg.norm(np.cross(along[:-1], along[1:]), axis=1) > _STRAIGHT
    corner = np.flatnonzero(bends) + 1
    points = path[[0, *corner, -1]]
    along = np.diff(points, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    circle = _circle(radius) @ _upright(along[0]).T
    rings = [points[0] + circle]
    for i, (before, after) in enumerate(pairwise(along), 1):
        normal = before + after
        rings.append(points[i] + circle - (circle @ normal)[..., None] / (before @ normal) * before)
        # the smallest rotation from one direction to the next (Rodrigues)
        axis, cosine = np.cross(before, after), before @ after
        circle = (
            cosine * circle
            + np.cross(axis, circle)
            + (circle @ axis)[..., None] / (1 + cosine) * axis
        )
    rings.append(points[-1] + circle)
    return [np.stack(pair) for pair in pairwise(rings)]


def _upright(direction: Floats) -> Floats:
    """Rotation (3, 3) whose third axis is a given direction."""
    other = np.eye(3)[np.abs(direction).argmin()]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(direction, x), direction], axis=1)
