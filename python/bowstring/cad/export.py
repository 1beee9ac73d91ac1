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

from bowstring._core import __version__
from bowstring.atomic_io import check_file, is_full, write_whole_file
from bowstring.cad.solid import MESHED, Solid, check_cad, plain_name, triangulate
from bowstring.robot.rest_shape import unloaded_pose

__all__ = ["SUFFIXES", "check_solid_file", "write_solid"]

SUFFIXES: Final = (".step", ".stp", ".stl", ".glb", ".gltf")

# Bytes that identify files written by Bowstring.
_STL_HEADER: Final = b"Bowstring, binary STL in mm"
_MARKS: Final = {
    ".step": b"bowstring_version: ",
    ".stp": b"bowstring_version: ",
    ".stl": _STL_HEADER,
    ".glb": b'"bowstring_version": ',
    ".gltf": b'"bowstring_version": ',
}

# Distance of a mesh from the surface over the robot's length, and angle between two facets.
_DEFLECTION: Final = 1e-4
_ANGLE: Final = 0.2  # rad


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
    triangulate(assembly, 1e3 * _DEFLECTION * solid.robot.length, _ANGLE)
    return assembly


def _stl(solid: Solid, file: Path) -> bool:
    bd = check_cad()
    made = bd.export_stl(_meshed(solid), str(file), tolerance=MESHED, angular_tolerance=_ANGLE)
    if made:
        with file.open("r+b") as stream:
            stream.write(_STL_HEADER.ljust(80))
    return bool(made)


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
    # first, as `has_mark` looks near the beginning of the file
    asset = {**content.pop("asset"), "extras": _about(solid)}
    content = {"asset": asset, **content}
    for material in content["materials"]:  # the default is metal, black in most viewers
        material["pbrMetallicRoughness"].update(metallicFactor=0.1, roughnessFactor=0.6)
    if file.suffix.lower() == ".gltf":
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode("ascii")
        content["buffers"] = [{"byteLength": len(data), "uri": uri}]
        file.write_text(json.dumps(content), "utf-8")
    else:
        file.write_bytes(_glb(content, data))
    return True


# -- the container .glb: a header, JSON, then the data, each of whole words -----------------------

_JSON, _BIN = 0x4E4F534A, 0x004E4942


def _read_glb(raw: bytes) -> tuple[dict[str, Any], bytes]:
    size = struct.unpack_from("<I", raw, 12)[0]
    length = struct.unpack_from("<I", raw, 20 + size)[0]
    return json.loads(raw[20 : 20 + size]), raw[28 + size : 28 + size + length]


def _glb(content: dict[str, Any], data: bytes) -> bytes:
    text = json.dumps(content).encode("utf-8")
    text += b" " * (-len(text) % 4)
    data += b"\0" * (-len(data) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text
    chunks += struct.pack("<II", len(data), _BIN) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
