"""JSON of the commands robots, export, doctor, data list and data get."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.cli.schemas.basic import OfRobot
from bowstring.results import Object, about


class BuiltInRobot(Object):
    """A built-in robot."""

    name: Annotated[str, about("Name, as ROBOT takes it.")]
    description: Annotated[str, about("Description.")]
    length_m: Annotated[float, about("Length of the straight backbone.")]
    segments: Annotated[int, about("Number of segments.")]
    disks: Annotated[int, about("Number of disks, without the base.")]
    tendons: Annotated[int, about("Number of tendons.")]


class Robots(Object):
    """Output of `bowstring robots`."""

    robots: Annotated[list[BuiltInRobot], about("Built-in robots.")]


class Export(OfRobot):
    """Output of `bowstring export` for rigid links."""

    file: Annotated[str, about("The model.")]
    format: Annotated[Literal["MJCF", "URDF"], about("Format of the model.")]
    joints: Annotated[int, about("Number of joints, of three hinges each.")]
    tensions_N: Annotated[list[float], about("Tensions at which the tip error is stated.")]
    tip_error_m: Annotated[
        float,
        about(
            "Distance of the tip of the links from that of the rod: in equilibrium (MJCF), or with "
            "the rod's rotations of the disks (URDF)."
        ),
    ]


class OptionalPart(Object):
    """An optional package or program."""

    name: Annotated[str, about("Name.")]
    needed_for: Annotated[str, about("Features that need it.")]
    requirement: Annotated[
        str | None,
        about("What pip installs for it, an extra of Bowstring or a package; `null`: a program."),
    ]
    version: Annotated[str | None, about("Version or path; `null` if the part is missing.")]
    problem: Annotated[str | None, about("Fault; `null` if it can be used.")]
    cure: Annotated[str | None, about("Command that adds it; `null` if it can be used.")]


class Machine(Object):
    """Versions and machine."""

    bowstring: Annotated[str, about("Version of Bowstring.")]
    python: Annotated[str, about("Version of Python.")]
    platform: Annotated[str, about("Operating system and processor.")]
    instructions: Annotated[str, about("Processor instructions in use.")]
    cores: Annotated[int, about("Processor cores that can be used.")]


class Doctor(Machine):
    """Output of `bowstring doctor`."""

    optional: Annotated[list[OptionalPart], about("Optional parts.")]


class DataFile(Object):
    """A file of a public data set."""

    name: Annotated[str, about("Name.")]
    url: Annotated[str | None, about("Address; `null` if the file was transcribed.")]
    sha256: Annotated[str, about("SHA-256 of the file.")]


class DataOrigin(Object):
    """Origin of a public data set."""

    name: Annotated[str, about("Name, as `--data` takes it.")]
    kind: Annotated[Literal["measured", "computed"], about("Origin of the numbers.")]
    repository: Annotated[str, about("GitHub repository, owner/name.")]
    commit: Annotated[str, about("Commit that the files are pinned to.")]
    licence: Annotated[str, about("Licence.")]


class DataSet(DataOrigin):
    """A public data set."""

    description: Annotated[str, about("Description.")]
    transcribed_from: Annotated[
        str | None,
        about("What the numbers were transcribed from; `null` if the files are in the repository."),
    ]
    parts: Annotated[list[str], about("Its tables, as `--part` takes them.")]
    files: Annotated[list[DataFile], about("Files.")]


class DataSets(Object):
    """Output of `bowstring data list`."""

    data_sets: Annotated[list[DataSet], about("Public data sets.")]


class DataFolder(DataOrigin):
    """Output of `bowstring data get`."""

    folder: Annotated[str, about("Folder of the files.")]
    files: Annotated[list[str], about("Paths of the files.")]
