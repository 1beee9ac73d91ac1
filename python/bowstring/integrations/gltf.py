"""Motion of a run as binary glTF, which browsers, Blender and presentation programs show.

Each part is a node with one closed mesh. The nodes of disks move. Backbones and tendons follow
joints, which are stations of the backbone and disks; their vertices are those of the first time, as
programs without skins show them. Lengths are in m. The root turns the base frame, z along the
straight backbone, to the axes of glTF, where y is up.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring._core import __version__
from bowstring.aliases import Floats, Ints, Progress
from bowstring.files.atomic_io import check_file, write_whole_file
from bowstring.robot.model import Robot, check_round
from bowstring.robot.sizes import part_names
from bowstring.statics.fields import Section
from bowstring.statics.model import RodModel
from bowstring.viz.colours import rgb
from bowstring.viz.gltf_file import INDICES, GltfArrays, glb
from bowstring.viz.vtk import check_data, check_stations, circle, holes

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["check_glb", "check_solid", "write_glb"]

_MARK: Final = b'"generator":"Bowstring'
_AROUND: Final = 20
#: Radius of a tendon without a diameter, over that of the disks.
_THIN: Final = 0.02
#: Distance of two rings that are one, over the length of the robot.
_SAME: Final = 1e-9
_HUES: Final = ("red", "green", "purple", "amber")
#: Rotation from the base frame to the axes of glTF, x, y, z, w.
_Y_UP: Final = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)


def check_glb(path: str | Path) -> Path:
    """Check before any work that a ``.glb`` file may be written; return its path."""
    return check_file(Path(path), "glTF file", (".glb",), _MARK)


def check_solid(robot: Robot) -> None:
    """Raise `InputError` if the backbone has no round surface to show."""
    check_round(robot, f"{robot.name}: a glTF file")


def write_glb(
    robot: Robot,
    data: xr.Dataset,
    path: str | Path,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a run as an animated solid in binary glTF 2.0, whole or not at all.

    Parameters
    ----------
    robot : Robot
        Robot of the run.
    data : xarray.Dataset
        Run from `Run.to_dataset` or `bowstring.dynamics.run_file.read_run`; select times by
        ``data.isel(time=slice(None, None, 10))``.
    path : str or Path
        Ends in ``.glb``; a former file of Bowstring is replaced, no other.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        The file, absolute. Its nodes are named as the parts of a solid: ``backbone``, ``disk_1``,
        ``tendon_1`` and so on; the data are in single precision and labelled as simulated.

    Raises
    ------
    InputError
        If the file cannot be written, the data are of another robot, or the backbone is not round.
    """
    notify = progress or (lambda what, share: None)
    file = check_glb(path)
    check_data(robot, data)
    check_stations(data)
    check_solid(robot)
    content = _Content(robot, data)
    notify("glTF file", 0.5)

    def fill(new: Path) -> None:
        new.write_bytes(content.file())

    write_whole_file(file, "glTF file", fill, lambda: check_glb(file))
    notify("glTF file", 1.0)
    return file


@dataclass(frozen=True, eq=False)
class _Surface:
    """Vertices in the frames of their joints, their normals and joints, and triangles."""

    points: Floats
    normals: Floats
    joints: Ints
    triangles: Ints


class _Content:
    """Joints with their motion, surfaces on them, and the bytes of the file."""

    def __init__(self, robot: Robot, data: xr.Dataset) -> None:
        self.robot, self.data = robot, data
        self.names = part_names(robot)
        self.arrays = GltfArrays()
        times = data["time"].to_numpy()
        still = np.zeros((len(times), 1, 3))
        position = [still, data["disk_position"].to_numpy(), data["position"].to_numpy()]
        turned = [np.broadcast_to(np.eye(3), (len(times), 1, 3, 3))]
        turned += [data["disk_rotation"].to_numpy(), data["rotation"].to_numpy()]
        self.times = times - times[0]
        self.position = np.concatenate(position, axis=1)
        self.rotation = _quaternions(np.concatenate(turned, axis=1))
        self.disks = position[1].shape[1]
        # of the joints at the first time, to the axes of glTF
        self.frames = np.tile(np.eye(4), (self.position.shape[1], 1, 1))
        up = _matrices(np.array(_Y_UP))
        self.frames[:, :3, :3] = up @ _matrices(self.rotation[0])
        self.frames[:, :3, 3] = self.position[0] @ up.T

    def _backbones(self) -> dict[str, _Surface]:
        data = self.data
        station, module = data["arc_length"].to_numpy(), data["module"].to_numpy() - 1
        radius = Section(self.robot, station, module, RodModel()).radius
        segment = self.robot.disks.segment[module]
        place = np.column_stack([self.position[0, 1 + self.disks :], radius])
        found = {}
        for k, name in enumerate(self.names.backbones):
            rows = np.flatnonzero(segment == k)
            # stations of two modules coincide, and triangles between them would have no area
            apart = np.linalg.norm(np.diff(place[rows], axis=0), axis=1) > _SAME * self.robot.length
            rows = rows[np.concatenate([[True], apart])]
            rings = radius[rows, None, None] * circle(_AROUND)
            found[name] = _closed(rings, 1 + self.disks + rows)
        return found

    def _disk(self, d: int) -> _Surface:
        disks = self.robot.disks
        half = np.array([0.0, 0.0, 0.5 * float(disks.thickness_m[d])])
        rim = float(disks.radius_m[d]) * circle(_AROUND)
        return _closed(np.stack([rim - half, rim + half]), np.full(2, 1 + d))

    def _tendon(self, index: int, points: Floats) -> _Surface:
        """Tube through the holes of a tendon (k + 1, 3), each in the frame of its disk."""
        given = float(self.robot.tendons.diameter_m[index])
        radius = 0.5 * given if given > 0.0 else _THIN * float(self.robot.disks.radius_m.max())
        count = len(points)
        frames = _matrices(self.rotation[0, :count])
        local = np.einsum("kji,kj->ki", frames, points - self.position[0, :count])
        return _closed(local[:, None] + radius * circle(_AROUND), np.arange(count))

    def file(self) -> bytes:
        """Return the bytes of the file."""
        joints = ["base", *self.names.disks]
        joints += [f"station {p + 1}" for p in range(self.position.shape[1] - len(joints))]
        count = len(joints)
        # joints are nodes 0 to count - 1, then their root and the skinned meshes
        nodes: list[dict[str, Any]] = [
            {
                "name": name,
                "translation": self.position[0, j].tolist(),
                "rotation": self.rotation[0, j].tolist(),
            }
            for j, name in enumerate(joints)
        ]
        nodes.append({"name": self.robot.name, "rotation": _Y_UP, "children": [*range(count)]})
        materials = [_material("backbone", "blue"), _material("disk", "muted", clear=True)]
        meshes: list[dict[str, Any]] = []

        def mesh(name: str, surface: _Surface, material: int, *, skin: bool) -> int:
            primitive = self._primitive(surface, material, skin=skin)
            meshes.append({"name": name, "primitives": [primitive]})
            return len(meshes) - 1

        for d in range(self.disks):
            nodes[1 + d]["mesh"] = mesh(joints[1 + d], self._disk(d), 1, skin=False)
        skinned = {name: (surface, 0) for name, surface in self._backbones().items()}
        for k, path in enumerate(holes(self.robot, self.data)):
            name = self.names.tendons[k]
            skinned[name] = self._tendon(k, path[0]), len(materials)
            materials.append(_material(name, _HUES[k % len(_HUES)]))
        for name, (surface, material) in skinned.items():
            index = mesh(name, self._bound(surface), material, skin=True)
            nodes.append({"name": name, "mesh": index, "skin": 0})
        attributes = self.data.attrs
        about = {
            key: str(attributes[key])
            for key in ("data_origin", "robot", "robot_hash")
            if key in attributes
        }
        out: dict[str, Any] = {
            "asset": {"generator": f"Bowstring {__version__}", "version": "2.0", "extras": about},
            "scene": 0,
            "scenes": [{"nodes": [*range(count, len(nodes))]}],
            "nodes": nodes,
            "skins": [
                {
                    "joints": [*range(count)],
                    "skeleton": count,
                    "inverseBindMatrices": self.arrays.add(self._unbinding(), target=None),
                }
            ],
            "meshes": meshes,
            "materials": materials,
        }
        if len(self.times) > 1:
            out["animations"] = [self._animation(count)]
        return glb({**out, **self.arrays.content()}, self.arrays.data)

    def _bound(self, surface: _Surface) -> _Surface:
        """Move a surface from the frames of its joints to where it is at the first time."""
        frames = self.frames[surface.joints]
        turned = frames[:, :3, :3]
        return replace(
            surface,
            points=np.einsum("pij,pj->pi", turned, surface.points) + frames[:, :3, 3],
            normals=np.einsum("pij,pj->pi", turned, surface.normals),
        )

    def _unbinding(self) -> NDArray[np.float32]:
        """Inverse bind matrices (J, 16), column by column."""
        inverse = np.linalg.inv(self.frames)
        inverse[:, 3] = 0.0, 0.0, 0.0, 1.0
        return np.asarray(inverse.swapaxes(1, 2).reshape(-1, 16), dtype="<f4")

    def _primitive(self, surface: _Surface, material: int, *, skin: bool) -> dict[str, Any]:
        attributes = {
            "POSITION": self.arrays.add(surface.points.astype("<f4"), limits=True),
            "NORMAL": self.arrays.add(surface.normals.astype("<f4")),
        }
        if skin:
            count = len(surface.points)
            joints, weights = np.zeros((count, 4), "<u2"), np.zeros((count, 4), "<f4")
            joints[:, 0], weights[:, 0] = surface.joints, 1.0
            attributes |= {
                "JOINTS_0": self.arrays.add(joints),
                "WEIGHTS_0": self.arrays.add(weights),
            }
        indices = self.arrays.add(surface.triangles.astype("<u4").ravel(), target=INDICES)
        return {"attributes": attributes, "indices": indices, "material": material}

    def _animation(self, joints: int) -> dict[str, Any]:
        time = self.arrays.add(self.times.astype("<f4"), limits=True, target=None)
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for j in range(1, joints):  # the base rests
            for path, values in (
                ("translation", self.position[:, j]),
                ("rotation", self.rotation[:, j]),
            ):
                output = self.arrays.add(values.astype("<f4"), target=None)
                channels.append({"sampler": len(samplers), "target": {"node": j, "path": path}})
                samplers.append({"input": time, "output": output, "interpolation": "LINEAR"})
        return {"name": "motion", "channels": channels, "samplers": samplers}


def _closed(rings: Floats, joints: Ints) -> _Surface:
    """Closed surface through rings (n, a, 3), each about the z axis of its joint (n,)."""
    normals = np.broadcast_to(circle(rings.shape[1]), rings.shape)
    parts = [_cap(rings[end], side, joints[end]) for end, side in ((0, -1), (-1, 1))]
    if joints[0] != joints[-1] or (rings[0] != rings[-1]).any():  # a flat disk has no rim
        parts.insert(0, _tube(rings, normals, joints))
    return _joined(parts)


def _tube(rings: Floats, normals: Floats, joints: Ints) -> _Surface:
    """Surface through rings (n, a, 3), each on its joint (n,)."""
    count, around = rings.shape[:2]
    j = np.arange(around)
    k = np.roll(j, -1)
    low = around * np.arange(count - 1)[:, None]
    high = low + around
    first = np.stack([low + j, low + k, high + k], axis=-1)
    second = np.stack([low + j, high + k, high + j], axis=-1)
    return _Surface(
        rings.reshape(-1, 3),
        np.asarray(normals).reshape(-1, 3),
        np.repeat(joints, around),
        np.concatenate([first, second]).reshape(-1, 3),
    )


def _cap(ring: Floats, side: int, joint: int) -> _Surface:
    """Flat end, seen from the `side` 1 above or -1 below."""
    count = len(ring)
    middle = ring.mean(axis=0, keepdims=True)
    j = np.arange(count)
    fan = np.stack([np.full(count, count), j, np.roll(j, -1)][:: 1 if side > 0 else -1], axis=-1)
    normals = np.tile([0.0, 0.0, float(side)], (count + 1, 1))
    return _Surface(np.concatenate([ring, middle]), normals, np.full(count + 1, joint), fan)


def _joined(parts: Sequence[_Surface]) -> _Surface:
    first = np.cumsum([0, *(len(part.points) for part in parts[:-1])])
    return _Surface(
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.joints for part in parts]),
        np.concatenate([part.triangles + n for part, n in zip(parts, first, strict=True)]),
    )


def _quaternions(rotations: Floats) -> Floats:
    """Quaternions (T, J, 4), x, y, z, w, of rotations (T, J, 3, 3), without changes of sign."""
    from scipy.spatial.transform import Rotation

    found = Rotation.from_matrix(rotations.reshape(-1, 3, 3)).as_quat()
    found = found.reshape(*rotations.shape[:2], 4)
    turns = np.sign((found[1:] * found[:-1]).sum(axis=-1, keepdims=True))
    turns = np.cumprod(np.where(turns < 0.0, -1.0, 1.0), axis=0)
    found[1:] *= turns
    return np.asarray(found)


def _matrices(quaternions: Floats) -> Floats:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(quaternions).as_matrix())


def _material(name: str, colour: str, *, clear: bool = False) -> Mapping[str, Any]:
    srgb = np.array(rgb(colour)) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    rough = {"metallicFactor": 0.0, "roughnessFactor": 0.7}
    alpha = 0.5 if clear else 1.0
    look = {"pbrMetallicRoughness": {"baseColorFactor": [*linear.tolist(), alpha], **rough}}
    blend = {"alphaMode": "BLEND"} if clear else {}
    return {"name": name, **look, "doubleSided": True, **blend}
