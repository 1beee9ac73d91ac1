"""The robot as a solid for the command export: CAD file, picture, drawing of its disks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from bowstring.cli.flags import of_flag
from bowstring.cli.output import (
    fixed,
    naming,
    new_table,
    progress_bar,
    provenance_of,
    tip_line,
    write_json,
    write_tables,
)
from bowstring.errors import InputError
from bowstring.files.atomic_io import resolved

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.aliases import Floats
    from bowstring.cad.solid import Part, Solid
    from bowstring.cli.schemas import solids as schema
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

_Disks: TypeAlias = "tuple[Floats, Floats]"
"""Positions (N, 3) in m and rotations (N, 3, 3) of the disks."""


def write_solids(
    robot: Robot,
    actuation: Load | None,
    out: str | None,
    picture: str | None,
    drawing: str | None,
    as_json: bool,
) -> None:
    """Write the solid, a picture of it, and the drawing of the disks.

    With actuation the robot is in equilibrium, without it unloaded.
    """
    from bowstring.cad import export
    from bowstring.cad.drawing import check_drawing_file, write_drawing
    from bowstring.cad.picture import check_picture_file, write_picture
    from bowstring.cad.solid import check_cad, make_solid
    from bowstring.robot.rest_shape import rest_frames, unloaded_pose
    from bowstring.robot.sizes import sizes_of
    from bowstring.statics import rod

    for flag, check, file in (
        ("--out", export.check_solid_file, out),
        ("--picture", check_picture_file, picture),
        ("--drawing", check_drawing_file, drawing),
    ):
        if file is not None:
            of_flag(flag, check, file)
    _all_different(out, picture, drawing)
    sizes = sizes_of(robot)
    pose, solid = None, None
    files: schema.SolidFiles = {}
    with naming(files), progress_bar("CAD kernel" if out or picture else "drawing") as notify:
        if out is not None or picture is not None:
            check_cad()
        if actuation is not None:
            pose = rod.solve(robot, load=actuation).raise_for_status()
        if out is not None or picture is not None:
            notify("solid", 0.6)
            solid = make_solid(robot, pose)
            if out is not None:
                notify("file", 0.7)
                files["solid"] = str(export.write_solid(solid, out))
            if picture is not None:
                notify("picture", 0.75)
                files["picture"] = str(write_picture(solid, picture))
        if drawing is not None:
            notify("drawing", 0.95 if out or picture else 0.0)
            files["drawing"] = str(write_drawing(robot, drawing))
    kind = unloaded_pose(robot) if pose is None else "simulated"
    disks: _Disks | None = None
    if pose is not None:
        assert pose.disk_positions is not None and pose.disk_rotations is not None
        disks = pose.disk_positions, pose.disk_rotations
    elif kind == "unloaded":
        disks = rest_frames(robot, robot.disks.station_m)
    if as_json:
        content: dict[str, Any] = {
            "pose": kind,
            **_pose_json(disks),
            "parts": None if solid is None else [_part_json(part) for part in solid.parts],
            "assumed": [size.to_dict() for size in sizes.assumed],
            "files": files,
            **provenance_of(
                robot,
                tensions_N=actuation and actuation.tensions,
                displacements_m=actuation and actuation.displacements,
                angles_rad=actuation and actuation.angles,
            ),
        }
        return write_json(content)
    lines: list[Table | str] = [
        f"{robot.name}, " + (f"{kind}, as built" if pose is None else "simulated pose")
    ]
    if disks is not None:
        lines.append(tip_line(disks[0][-1], disks[1][-1]))
    if solid is not None:
        lines.append(_table(solid))
    if sizes.assumed:
        lines.append(
            "assumed, because the robot file does not say it:\n"
            + "\n".join(f"  {size}" for size in sizes.assumed)
        )
    given = {"solid": out, "picture": picture, "drawing": drawing}
    lines.append("\n".join(f"{what}: {file}" for what, file in given.items() if file))
    write_tables(*lines)


def _all_different(*files: str | None) -> None:
    given = [resolved(file, f"cannot write {file}") for file in files if file is not None]
    for i, file in enumerate(given):
        if file in given[:i]:
            raise InputError(f"two of --out, --picture and --drawing name {file}; give two names.")


def _pose_json(disks: _Disks | None) -> dict[str, Any]:
    if disks is None:
        return {"tip": None, "disks": None}
    from bowstring.pose import Pose

    frames = [Pose(*pose).to_dict() for pose in zip(*disks, strict=True)]
    return {"tip": frames[-1], "disks": frames}


def _part_json(part: Part) -> schema.Part:
    return {
        "name": part.name,
        "kind": part.kind,
        "colour": part.colour,
        "volume_m3": part.volume_m3,
        "centre_m": list(part.centre_m),
        "mass_kg": part.mass_kg,
    }


def _table(solid: Solid) -> Table:
    """Table of kinds of parts, with parts of equal volume in one row."""
    table = new_table("part", ">count", ">volume mm^3", ">mass g")
    groups: dict[tuple[str, str], list[Any]] = {}
    for part in solid.parts:
        key = (part.kind, f"{1e9 * part.volume_m3:.5g}")
        groups.setdefault(key, []).append(part)
    for (kind, volume), parts in groups.items():
        mass = parts[0].mass_kg
        table.add_row(kind, str(len(parts)), volume, "-" if mass is None else fixed(1e3 * mass, 3))
    return table
