"""Write a robot's solid as STEP, STL or glTF, by the suffix of the file.

STEP and STL are in mm, as CAD programs and printers expect; glTF is in m with y up by its standard,
so that the robot's z axis points up in a viewer.
"""

from __future__ import annotations

import base64
import errno
import json
import struct
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring._core import __version__
from bowstring.aliases import Ints
from bowstring.cad.solid import MESHED, Solid, check_cad, plain_name, triangulate
from bowstring.files.atomic_io import check_file, is_full, write_whole_file
from bowstring.robot.rest_shape import unloaded_pose
from bowstring.viz.gltf_file import COMPONENTS, INDICES, GltfArrays, glb

__all__ = ["SUFFIXES", "check_solid_file", "write_solid"]

SUFFIXES: Final = (".step", ".stp", ".stl", ".glb", ".gltf")

# Bytes that identify files written by Bowstring.
_STL_HEADER: Final = b"Bowstring, binary STL in mm"
_MARKS: Final = {
    ".step": b"bowstring_version: ",
    ".stp": b"bowstring_version: ",
    ".stl": _STL_HEADER,
    ".glb": b'"bowstring_version":',
    ".gltf": b'"bowstring_version":',
}

# Distance of a mesh from the surface over the robot's length, and angle between two facets.
_DEFLECTION: Final = 1e-4
_ANGLE: Final = 0.2  # rad

_MM: Final = 1e3
# Facets of a binary STL file behind its header.
_FACETS: Final = np.dtype([("normal", "<3f4"), ("corners", "<(3,3)f4"), ("attribute", "<u2")])
_APART: Final = 1e-6  # shift of parts that touch in corners, over the robot's length
_KEY: Final = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], np.uint64)


def check_solid_file(path: str | Path) -> Path:
    """Check before any work that a solid may be written (`atomic_io.check_file`)."""
    file = Path(path)
    return check_file(file, "solid", SUFFIXES, _MARKS.get(file.suffix.lower(), b""))


def write_solid(solid: Solid, path: str | Path) -> Path:
    """Write a robot's solid to a file, whole or not at all.

    Parameters
    ----------
    solid : Solid
        Solid from `make_solid`.
    path : str or Path
        ``.step`` or ``.stp``: an assembly of named and coloured parts. ``.stl``: one binary mesh.
        ``.glb`` or ``.gltf``: meshes with names and colours; ``.gltf`` embeds its data.

    Returns
    -------
    Path
        Absolute path of the file.

    Raises
    ------
    InputError
        If the suffix is another one, or the file cannot be written.
    """
    file = check_solid_file(path)

    def fill(new: Path) -> None:
        write = {".stl": _stl, ".glb": _gltf, ".gltf": _gltf}.get(file.suffix.lower(), _step)
        try:
            written = write(solid, new)
        except RuntimeError as error:  # build123d raises these
            if "Failed to write" not in str(error):
                raise
            written = False
        if not written:
            why = "the drive is full; make room" if is_full(new) else "the CAD kernel failed"
            raise OSError(errno.EIO, why)

    write_whole_file(file, "solid", fill, lambda: check_solid_file(file))
    return file


def _about(solid: Solid) -> dict[str, Any]:
    """Provenance of the file."""
    return {
        "robot": solid.robot.name,
        "robot_hash": solid.robot.hash,
        "bowstring_version": __version__,
        "pose": f"simulated, {solid.load}" if solid.posed else unloaded_pose(solid.robot),
        "assumed": [str(size) for size in solid.sizes.assumed],
    }


def _step(solid: Solid, file: Path) -> bool:
    bd = check_cad()
    if not bd.export_step(solid.assembly(), str(file)):
        return False
    about = _about(solid)
    about["robot"] = plain_name(about["robot"])
    lines = [f"{key}: {value}" for key, value in about.items() if key != "assumed"]
    lines += [f"assumed: {size}" for size in about["assumed"]]
    quoted = ",\n".join("'" + line.replace("'", "''")[:250] + "'" for line in lines)
    text = file.read_text("ascii")
    head = "FILE_DESCRIPTION(('Open CASCADE Model')"
    file.write_text(text.replace(head, f"FILE_DESCRIPTION((\n{quoted})", 1), "ascii")
    return True


def _meshed(solid: Solid) -> Any:
    assembly = solid.assembly()
    triangulate(assembly, _MM * _DEFLECTION * solid.robot.length, _ANGLE)
    return assembly


def _stl(solid: Solid, file: Path) -> bool:
    bd = check_cad()
    assembly = _meshed(solid)
    if not bd.export_stl(assembly, str(file), tolerance=MESHED, angular_tolerance=_ANGLE):
        return False
    raw = bytearray(file.read_bytes())
    raw[: len(_STL_HEADER)] = _STL_HEADER
    rows = np.frombuffer(raw, _FACETS, offset=84)  # part after part
    owner = np.repeat(np.arange(len(solid.parts)), [_facets(each) for each in assembly.children])
    _set_apart(rows["corners"], owner, np.float32(_APART * _MM * solid.robot.length))
    file.write_bytes(raw)
    return True


def _facets(shape: Any) -> int:
    """Number of triangles of a meshed shape."""
    from OCP.BRep import BRep_Tool
    from OCP.TopLoc import TopLoc_Location

    at = TopLoc_Location()
    return sum(BRep_Tool.Triangulation_s(f.wrapped, at).NbTriangles() for f in shape.faces())


def _set_apart(corners: NDArray[np.float32], owner: Ints, step: np.float32) -> None:
    """Move parts that share corners (F, 3, 3) with an earlier one.

    An edge of four triangles, two of each part, belongs to no closed mesh.
    """
    corners += np.float32(0.0)  # no -0.0, as many programs compare bits
    later = owner
    while later.size:
        bits = np.ascontiguousarray(corners).view(np.uint32).astype(np.uint64)
        # equal corners have equal keys; the contrary, which is rare, moves a part in vain
        _, label = np.unique(bits @ _KEY, return_inverse=True)
        label = label.reshape(-1, 3)
        first = np.full(label.max() + 1, owner.max())
        np.minimum.at(first, label, owner[:, None])
        later = np.unique(owner[(first[label] < owner[:, None]).any(axis=1)])
        corners[np.isin(owner, later)] += step


def _gltf(solid: Solid, file: Path) -> bool:
    bd = check_cad()
    made = bd.export_gltf(
        _meshed(solid),
        str(file),
        unit=bd.Unit.MM,
        binary=True,
        linear_deflection=MESHED,
        angular_deflection=_ANGLE,
    )
    if not made:
        return False
    content, data = _read_glb(file.read_bytes())
    arrays = GltfArrays()
    for mesh in content["meshes"]:
        mesh["primitives"] = [_one_primitive(mesh["primitives"], content, data, arrays)]
    for material in content["materials"]:  # the default is metal, black in most viewers
        material["pbrMetallicRoughness"].update(metallicFactor=0.1, roughnessFactor=0.6)
    # first, as `has_mark` looks near the beginning of the file
    asset = {**content.pop("asset"), "extras": _about(solid)}
    content = {"asset": asset, **content, **arrays.content()}
    if file.suffix.lower() == ".gltf":
        text = base64.b64encode(arrays.data).decode("ascii")
        content["buffers"][0]["uri"] = f"data:application/octet-stream;base64,{text}"
        file.write_text(json.dumps(content), "utf-8")
    else:
        file.write_bytes(glb(content, arrays.data))
    return True


def _one_primitive(
    faces: list[dict[str, Any]], content: dict[str, Any], data: bytes, arrays: GltfArrays
) -> dict[str, Any]:
    """Join the faces of a part: many programs make an object of each primitive."""

    def read(index: int) -> NDArray[Any]:
        accessor = content["accessors"][index]
        view = content["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        kind, count = COMPONENTS[accessor["componentType"]], width * int(accessor["count"])
        return np.frombuffer(data, kind, count, start).reshape(-1, width)

    attributes = {
        name: np.concatenate([read(face["attributes"][name]) for face in faces])
        for name in faces[0]["attributes"]
    }
    counts = [content["accessors"][face["attributes"]["POSITION"]]["count"] for face in faces]
    before = np.cumsum([0, *counts[:-1]], dtype="<u4")
    corners = np.concatenate(
        [read(face["indices"]) + n for face, n in zip(faces, before, strict=True)]
    )
    return {
        **faces[0],
        "attributes": {
            name: arrays.add(values, limits=name == "POSITION")
            for name, values in attributes.items()
        },
        "indices": arrays.add(corners, target=INDICES),
    }


def _read_glb(raw: bytes) -> tuple[dict[str, Any], bytes]:
    size = struct.unpack_from("<I", raw, 12)[0]
    return json.loads(raw[20 : 20 + size]), raw[28 + size :]
