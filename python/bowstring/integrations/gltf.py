"""Motion of a run as binary glTF, which browsers, Blender and presentation programs show.

Backbone, disks and tendons are one mesh whose rings of vertices are fixed to stations of the
backbone and to disks, the joints of the file; the animation moves these. Lengths are in m. The
root turns the base frame, z along the straight backbone, to the axes of glTF, where y is up.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring._core import __version__
from bowstring.atomic_io import check_file, write_whole_file
from bowstring.robot.model import Robot, check_round
from bowstring.statics.fields import Section
from bowstring.statics.model import RodModel
from bowstring.viz.style import LIGHT
from bowstring.viz.vtk import check_data, check_stations, circle, holes

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["check_glb", "check_solid", "write_glb"]

Floats = NDArray[np.float64]
Progress = Callable[[str, float], None]

_MARK: Final = b'"generator":"Bowstring'
_AROUND: Final = 20
#: Radius of a tendon without a diameter, over that of the disks.
_THIN: Final = 0.02
_HUES: Final = ("red", "green", "purple", "amber")
#: Rotation from the base frame to the axes of glTF, x, y, z, w.
_Y_UP: Final = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)
_FLOAT, _SHORT, _INT = 5126, 5123, 5125


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
        The file, absolute. Its names are ``backbone``, ``disks`` and ``tendon 1`` and so on; the
        data are in single precision and labelled as simulated.

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
    write_whole_file(file, "glTF file", content.write, lambda: check_glb(file))
    notify("glTF file", 1.0)
    return file


@dataclass(frozen=True, eq=False)
class _Surface:
    """Vertices in the frames of their joints, their normals and joints, and triangles."""

    points: Floats
    normals: Floats
    joints: NDArray[np.int64]
    triangles: NDArray[np.int64]


class _Content:
    """Joints with their motion, surfaces on them, and the bytes of the file."""

    def __init__(self, robot: Robot, data: xr.Dataset) -> None:
        self.robot, self.data = robot, data
        self.binary = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []
        times = data["time"].to_numpy()
        still = np.zeros((len(times), 1, 3))
        position = [still, data["disk_position"].to_numpy(), data["position"].to_numpy()]
        turned = [np.broadcast_to(np.eye(3), (len(times), 1, 3, 3))]
        turned += [data["disk_rotation"].to_numpy(), data["rotation"].to_numpy()]
        self.times = times - times[0]
        self.position = np.concatenate(position, axis=1)
        self.rotation = _quaternions(np.concatenate(turned, axis=1))
        self.disks = position[1].shape[1]

    def surfaces(self) -> dict[str, tuple[_Surface, str]]:
        """Surfaces by name, each with its colour. Joint 0 is the base, then disks and stations."""
        found = {"backbone": (self._backbone(), "blue"), "disks": (self._all_disks(), "muted")}
        for k, path in enumerate(holes(self.robot, self.data)):
            found[f"tendon {k + 1}"] = self._tendon(k, path[0]), _HUES[k % len(_HUES)]
        return found

    def _backbone(self) -> _Surface:
        data = self.data
        station, module = data["arc_length"].to_numpy(), data["module"].to_numpy() - 1
        radius = Section(self.robot, station, module, RodModel()).radius
        around = circle(_AROUND)
        points = radius[:, None, None] * around
        rows = np.flatnonzero(np.diff(module) == 0)  # stations of two modules coincide
        joints = 1 + self.disks + np.arange(len(station))
        return _tube(points, np.broadcast_to(around, points.shape), joints, rows)

    def _all_disks(self) -> _Surface:
        disks, around = self.robot.disks, circle(_AROUND)
        parts = []
        for d in range(self.disks):
            half = np.array([0.0, 0.0, 0.5 * float(disks.thickness_m[d])])
            rim = float(disks.radius_m[d]) * around
            ends = np.stack([rim - half, rim + half])
            joint = np.full(2, 1 + d)
            parts.append(
                _tube(ends, np.broadcast_to(around, ends.shape), joint, np.zeros(1, dtype=int))
            )
            parts += [_cap(ring, side, 1 + d) for ring, side in ((rim - half, -1), (rim + half, 1))]
        return _joined(parts)

    def _tendon(self, index: int, points: Floats) -> _Surface:
        """Tube through the holes of a tendon (k + 1, 3), each in the frame of its disk."""
        given = float(self.robot.tendons.diameter_m[index])
        radius = 0.5 * given if given > 0.0 else _THIN * float(self.robot.disks.radius_m.max())
        count = len(points)
        frames = _matrices(self.rotation[0, :count])
        local = np.einsum("kji,kj->ki", frames, points - self.position[0, :count])
        around = circle(_AROUND)
        rings = local[:, None] + radius * around
        return _tube(
            rings, np.broadcast_to(around, rings.shape), np.arange(count), np.arange(count - 1)
        )

    def write(self, path: Path) -> None:
        """Write the file: JSON, then all arrays."""
        text = json.dumps(self._json(), separators=(",", ":"), allow_nan=False).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + b"\0" * (-len(self.binary) % 4)
        size = 12 + 8 + len(text) + 8 + len(binary)
        with path.open("wb") as stream:
            stream.write(b"glTF" + struct.pack("<II", 2, size))
            stream.write(struct.pack("<I", len(text)) + b"JSON" + text)
            stream.write(struct.pack("<I", len(binary)) + b"BIN\0" + binary)

    def _json(self) -> dict[str, Any]:
        names = ["base", *(f"disk {d + 1}" for d in range(self.disks))]
        names += [f"station {p + 1}" for p in range(self.position.shape[1] - len(names))]
        count = len(names)
        # joints are nodes 0 to count - 1, then their root and the skinned meshes
        nodes: list[dict[str, Any]] = [
            {
                "name": name,
                "translation": self.position[0, j].tolist(),
                "rotation": self.rotation[0, j].tolist(),
            }
            for j, name in enumerate(names)
        ]
        nodes.append({"name": self.robot.name, "rotation": _Y_UP, "children": [*range(count)]})
        meshes: list[dict[str, Any]] = []
        materials: list[dict[str, Any]] = []
        for name, (surface, colour) in self.surfaces().items():
            materials.append({"name": name, **_material(colour, clear=name == "disks")})
            nodes.append({"name": name, "mesh": len(meshes), "skin": 0})
            meshes.append({"name": name, "primitives": [self._primitive(surface, len(meshes))]})
        # vertices are in the frames of their joints; some programs need the identities
        identities = np.tile(np.eye(4, dtype="<f4").ravel(), (count, 1))
        binding = self._array(identities, "MAT4", target=None)
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
                {"joints": [*range(count)], "skeleton": count, "inverseBindMatrices": binding}
            ],
            "meshes": meshes,
            "materials": materials,
        }
        if len(self.times) > 1:
            out["animations"] = [self._animation(count)]
        return {
            **out,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.binary) + (-len(self.binary) % 4)}],
        }

    def _primitive(self, surface: _Surface, material: int) -> dict[str, Any]:
        count = len(surface.points)
        joints, weights = np.zeros((count, 4), "<u2"), np.zeros((count, 4), "<f4")
        joints[:, 0], weights[:, 0] = surface.joints, 1.0
        attributes = {
            "POSITION": self._array(surface.points.astype("<f4"), "VEC3", limits=True),
            "NORMAL": self._array(surface.normals.astype("<f4"), "VEC3"),
            "JOINTS_0": self._array(joints, "VEC4"),
            "WEIGHTS_0": self._array(weights, "VEC4"),
        }
        indices = self._array(surface.triangles.astype("<u4").ravel(), "SCALAR", target=34963)
        return {"attributes": attributes, "indices": indices, "material": material}

    def _animation(self, joints: int) -> dict[str, Any]:
        time = self._array(self.times.astype("<f4"), "SCALAR", limits=True, target=None)
        samplers: list[dict[str, Any]] = []
        channels: list[dict[str, Any]] = []
        for j in range(1, joints):  # the base rests
            for path, values, kind in (
                ("translation", self.position[:, j], "VEC3"),
                ("rotation", self.rotation[:, j], "VEC4"),
            ):
                output = self._array(values.astype("<f4"), kind, target=None)
                channels.append({"sampler": len(samplers), "target": {"node": j, "path": path}})
                samplers.append({"input": time, "output": output, "interpolation": "LINEAR"})
        return {"name": "motion", "channels": channels, "samplers": samplers}

    def _array(
        self,
        values: NDArray[Any],
        kind: str,
        *,
        limits: bool = False,
        target: int | None = 34962,
    ) -> int:
        """Append an array to the binary part, and return its accessor."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        raw = np.ascontiguousarray(values).tobytes()
        view: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(self.binary),
            "byteLength": len(raw),
        }
        if target is not None:
            view["target"] = target
        self.binary += raw
        self.views.append(view)
        accessor: dict[str, Any] = {
            "bufferView": len(self.views) - 1,
            "componentType": {"<f4": _FLOAT, "<u2": _SHORT, "<u4": _INT}[values.dtype.str],
            "count": len(values),
            "type": kind,
        }
        if limits:
            table = values.reshape(len(values), -1)
            accessor |= {"min": table.min(axis=0).tolist(), "max": table.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1


def _tube(
    rings: Floats, normals: Floats, joints: NDArray[np.int64], between: NDArray[np.int64]
) -> _Surface:
    """Surface through rings (n, a, 3), each on its joint (n,), from each ring of `between` on."""
    around = rings.shape[1]
    j = np.arange(around)
    k = np.roll(j, -1)
    low, high = between[:, None] * around, (between[:, None] + 1) * around
    first = np.stack([low + j, low + k, high + k], axis=-1)
    second = np.stack([low + j, high + k, high + j], axis=-1)
    return _Surface(
        rings.reshape(-1, 3),
        np.asarray(normals).reshape(-1, 3),
        np.repeat(joints, around),
        np.concatenate([first, second]).reshape(-1, 3),
    )


def _cap(ring: Floats, side: int, joint: int) -> _Surface:
    """Flat end of a disk, seen from the `side` 1 above or -1 below."""
    count = len(ring)
    middle = np.array([[0.0, 0.0, ring[0, 2]]])
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


def _material(colour: str, *, clear: bool) -> Mapping[str, Any]:
    text = LIGHT[colour].lstrip("#")
    srgb = np.array([int(text[i : i + 2], 16) for i in (0, 2, 4)]) / 255.0
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    rough = {"metallicFactor": 0.0, "roughnessFactor": 0.7}
    alpha = 0.5 if clear else 1.0
    look = {"pbrMetallicRoughness": {"baseColorFactor": [*linear.tolist(), alpha], **rough}}
    return {**look, "doubleSided": True, **({"alphaMode": "BLEND"} if clear else {})}
