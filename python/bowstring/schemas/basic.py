"""Base of the schemas: objects, numbers, vectors, poses, provenance."""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import ConfigDict, Field, with_config
from typing_extensions import TypedDict

__all__ = [
    "STRICT",
    "BaseEstimate",
    "InFolder",
    "Interval",
    "MadeBy",
    "MadeByRobot",
    "MeasurementIssue",
    "Object",
    "OfRobot",
    "OrNull",
    "Pair",
    "Pose",
    "Rotation",
    "Vector",
    "VectorOrNull",
    "about",
]


def about(text: str, unit: str | None = None) -> Any:
    """Describe a key; its unit where it does not follow from the end of the key."""
    return Field(description=text, json_schema_extra=None if unit is None else {"unit": unit})


#: No other keys, and no number that is not finite.
STRICT: Final = ConfigDict(extra="forbid", allow_inf_nan=False)


@with_config(STRICT)
class Object(TypedDict):
    """Base of all objects: no other keys, and no number that is not finite."""


OrNull = float | None
Pair = Annotated[list[float], Field(min_length=2, max_length=2)]
Interval = Annotated[list[OrNull], Field(min_length=2, max_length=2)]
Vector = Annotated[list[float], Field(min_length=3, max_length=3)]
VectorOrNull = Annotated[list[OrNull], Field(min_length=3, max_length=3)]
Rotation = Annotated[list[Vector], Field(min_length=3, max_length=3)]


class Pose(Object):
    """Position and orientation in the base frame."""

    position_m: Annotated[Vector, about("Position.")]
    rotation: Annotated[Rotation, about("Rotation matrix by rows; it maps body axes to base axes.")]


class BaseEstimate(Object):
    """A coordinate of the base by calibration."""

    value: Annotated[float, about("Estimate.", "`unit`")]
    standard_error: Annotated[OrNull, about("Standard error.", "`unit`")]
    unit: Annotated[str, about("Unit.")]


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


class MeasurementIssue(Object):
    """A line of a table of measurements that has something wrong."""

    line: Annotated[int, about("Line of the file, from 1.")]
    text: Annotated[str, about("Fault, and whether the row is left out.")]


class InFolder(Object):
    """Addition of commands that write a folder."""

    folder: Annotated[str | None, about("Folder that was written; `null` without `--out`.")]
