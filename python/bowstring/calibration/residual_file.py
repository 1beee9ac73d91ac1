"""File of a residual, beside the calibrated robot file."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field
from typing_extensions import NotRequired

from bowstring.calibration.observations import Score
from bowstring.calibration.residual import MOST_ROWS, Hyperparameters, Residual, Scales, Table
from bowstring.errors import InputError
from bowstring.files import json_files
from bowstring.files.json_files import Content, Row, Triple, read_json, structured
from bowstring.robot.model import Robot
from bowstring.robot.parts import MAX_TENDONS
from bowstring.robot.reader import load_robot
from bowstring.statics.model import RodModel
from bowstring.validation import shown

#: Name of the file in the folder of a fit.
RESIDUAL: Final = "residual.json"
_FORMAT: Final = "bowstring residual"
_VERSION: Final = 1
_MOST_BYTES: Final = 50_000_000
_MOST_VALUES: Final = 1_000
_MOST_ELEMENTS: Final = 1_000
_LARGEST: Final = 1e12


def residual_to_dict(residual: Residual) -> dict[str, Any]:
    """Return the content of the file of a residual.

    Parameters
    ----------
    residual : Residual
        Residual to save.

    Returns
    -------
    dict
        Plain values in SI, for `json.dumps`.
    """
    table, at = residual.table, residual.hyperparameters
    finite = {name: v if math.isfinite(v) else None for name, v in asdict(at).items()}
    memory = table.memory(at.radius * residual.scales.length)
    return {
        "format": _FORMAT,
        "version": _VERSION,
        "robot": residual.robot.name,
        "robot_hash": residual.robot.hash,
        "units": "SI: m, N, rad, s",
        "rod": None if residual.rod is None else residual.rod.to_dict(),
        "values": dict(residual.values),
        "tool": residual.tool.tolist(),
        "hyperparameters": finite,
        "command_scale": residual.scales.command.tolist(),
        "by_displacement": residual.by_displacement.tolist(),
        "commands": table.commands.tolist(),
        "points": table.point.tolist(),
        "memory": memory.tolist(),
        "residuals": residual.residuals.tolist(),
        "folds": [asdict(each) for each in residual.validated],
    }


def read_residual(path: str | Path, robot: Robot | None = None) -> Residual:
    """Read a residual and its calibrated robot.

    Parameters
    ----------
    path : str or Path
        ``residual.json``, or its folder.
    robot : Robot, optional
        Calibrated robot, by default ``robot.yaml`` beside the file.

    Returns
    -------
    Residual
        Calibrated model with residual.

    Raises
    ------
    InputError
        If the file cannot be read, has another content or version, or belongs to another robot.
    """
    file = Path(path)
    if file.is_dir():
        file = file / RESIDUAL
    try:
        content = read_json(file, _MOST_BYTES)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}") from None
    except ValueError as error:
        raise _none(file, error) from None
    if content.get("format") != _FORMAT:
        raise _none(file)
    if content.get("version") != _VERSION:
        raise InputError(
            f"{file} has version {shown(content.get('version'))}, this Bowstring reads {_VERSION}; "
            "fit the residual again"
        )
    robot = robot or load_robot(file.parent / "robot.yaml")
    if content.get("robot_hash") != robot.hash:
        raise InputError(
            f"{file} belongs to another robot than {robot.name} as given; take the robot.yaml of "
            "the same fit, unchanged"
        )
    try:
        return _residual(structured(content, _Content), robot)
    except ValueError as error:
        raise _none(file, error) from None


def _none(file: Path, error: object = "it has another format") -> InputError:
    return InputError(
        f"{file} is no complete {RESIDUAL} of bowstring fit --residual: {error}; fit it again"
    )


# beyond these bounds, which no fit reaches, the process cannot be computed
_Scale = Annotated[float, Field(ge=1e-9, le=1e9)]
_Numbers = Annotated[dict[str, float], Field(max_length=_MOST_VALUES)]


class _Hyperparameters(Content):
    commands: _Scale | None
    point: _Scale | None
    memory: _Scale | None
    radius: _Scale
    noise: Annotated[float, Field(ge=1e-6, le=1e9)]


class _Rod(Content):
    theory: str
    elements: Annotated[int, Field(ge=1, le=_MOST_ELEMENTS)] | None
    tendon_path: NotRequired[str | None]
    twist: bool


class _Score(Content):
    count: Annotated[int, Field(ge=0)]
    rmse: float
    mean: float
    largest: float
    rmse_centred: float
    mean_centred: float


class _Content(Content):
    """Structure of the file; None stands for an input that is not used."""

    rod: _Rod | None
    values: _Numbers
    tool: Triple
    hyperparameters: _Hyperparameters
    command_scale: Row
    by_displacement: Annotated[list[bool], Field(max_length=MAX_TENDONS)]
    commands: json_files.Table
    points: json_files.Table
    memory: json_files.Table
    residuals: json_files.Table
    folds: Annotated[list[_Score], Field(min_length=2, max_length=2)]


def _residual(content: Any, robot: Robot) -> Residual:
    count, rows = robot.core.tendon_count, len(content["points"])
    if not 1 <= rows <= MOST_ROWS:  # before the work, which grows by the square of the rows
        raise ValueError(f"it has {rows} rows, from 1 to {MOST_ROWS} are possible")
    shapes = {
        "command_scale": (count,),
        "by_displacement": (count,),
        "commands": (rows, count),
        "points": (rows, 3),
        "memory": (rows, 3),
        "residuals": (rows, 3),
    }
    for name, shape in shapes.items():
        if np.shape(content[name]) != shape:
            raise ValueError(f"{name} has the shape {np.shape(content[name])}, not {shape}")
        if not (np.abs(content[name]) <= _LARGEST).all():
            raise ValueError(f"{name} has numbers beyond {_LARGEST:g}")
    at = Hyperparameters(
        **{name: math.inf if v is None else v for name, v in content["hyperparameters"].items()}
    )
    if math.isinf(min(at.commands, at.point)):
        raise ValueError("hyperparameters have no length scale of commands or points")
    scales = Scales(content["command_scale"], robot.length)
    if not (scales.command >= 1 / _LARGEST).all():
        raise ValueError("command_scale must be positive")
    table = Table(content["commands"], content["points"], [np.arange(rows)])
    folds = [Score(**each) for each in content["folds"]]
    return Residual(
        robot=robot,
        rod=None if content["rod"] is None else RodModel(**content["rod"]),
        values=content["values"],
        tool=np.array(content["tool"]),
        hyperparameters=at,
        scales=scales,
        by_displacement=np.array(content["by_displacement"], dtype=bool),
        table=table.with_memory(at.radius * scales.length, content["memory"]),
        residuals=content["residuals"],
        validated=(folds[0], folds[1]),
    )
