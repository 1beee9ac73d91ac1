"""Base of the schemas: objects, numbers, vectors, poses, provenance."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from bowstring.results import Object, OrNull, about

Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
VectorOrNull = Annotated[list[OrNull], Field(min_length=3, max_length=3)]


class MadeBy(Object):
    """Origin of an output."""

    bowstring_version: Annotated[str, about("Version of Bowstring.")]
    schema_version: Annotated[int, about("Version of these schemas.")]
    settings: Annotated[
        dict[str, Any],
        about("Arguments and flags as used, defaults included; units are in the keys."),
    ]


class MadeByRobot(MadeBy):
    """Origin of an output about a robot."""

    robot_hash: Annotated[str, about("Hash of all numbers of the robot file that act in physics.")]


class OfRobot(Object):
    """Addition of all commands with a robot."""

    robot: Annotated[str, about("Name of the robot.")]
    warnings: Annotated[list[str], about("Warnings, one sentence each.")]
    provenance: Annotated[MadeByRobot, about("Origin of the output.")]


class InFolder(Object):
    """Addition of commands that write a folder."""

    folder: Annotated[str | None, about("Folder that was written; `null` without `--out`.")]
