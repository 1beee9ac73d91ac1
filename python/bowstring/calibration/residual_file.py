"""File of a residual, beside the calibrated robot file."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, astuple
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.atomic_io import readable
from bowstring.calibration.observations import Score
from bowstring.calibration.residual import Hyperparameters, Residual, Scales, Table
from bowstring.errors import BowstringError, InputError
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.statics.model import RodModel

__all__ = ["RESIDUAL", "read_residual", "residual_to_dict"]

#: Name of the file in the folder of a fit.
RESIDUAL: Final = "residual.json"
_FORMAT: Final = "bowstring residual"
_VERSION: Final = 1
_MOST_BYTES: Final = 50_000_000

Floats = NDArray[np.float64]


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
    content = _content(file)
    if content.get("format") != _FORMAT:
        raise _none(file)
    if content.get("version") != _VERSION:
        raise InputError(
            f"{file} has version {content.get('version')!r}, this Bowstring reads {_VERSION}; "
            "fit the residual again"
        )
    robot = robot or load_robot(file.parent / "robot.yaml")
    if content.get("robot_hash") != robot.hash:
        raise InputError(
            f"{file} belongs to another robot than {robot.name} as given; take the robot.yaml of "
            "the same fit, unchanged"
        )
    try:
        return _residual(content, robot)
    except (BowstringError, KeyError, TypeError, ValueError):
        raise _none(file) from None


def _content(file: Path) -> dict[str, Any]:
    try:
        with readable(file) as stream:
            text = stream.read(_MOST_BYTES + 1)
    except OSError as error:
        raise InputError(f"cannot read {file}: {error.strerror}") from None
    try:
        content = json.loads(text) if len(text) <= _MOST_BYTES else None
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise _none(file)
    return content


def _none(file: Path) -> InputError:
    return InputError(f"{file} is no complete {RESIDUAL} of bowstring fit --residual; fit it again")


def _residual(content: dict[str, Any], robot: Robot) -> Residual:
    count = robot.core.tendon_count
    points = _numbers(content["points"], (-1, 3))
    rows = len(points)
    at = Hyperparameters(
        **{
            name: math.inf if value is None else float(value)
            for name, value in content["hyperparameters"].items()
        }
    )
    used = math.isfinite(min(at.commands, at.point))
    if not (rows and used and min(asdict(at).values()) > 0 and math.isfinite(at.radius + at.noise)):
        raise ValueError("hyper-parameters")
    folds = [Score(**each) for each in content["folds"]]
    if len(folds) != 2 or not np.isfinite([astuple(each) for each in folds]).all():
        raise ValueError("folds")
    scales = Scales(_numbers(content["command_scale"], (count,)), robot.length)
    kinds = np.array(content["by_displacement"])
    if kinds.dtype != bool or kinds.shape != (count,) or not (scales.command > 0).all():
        raise ValueError("commands")
    table = Table(_numbers(content["commands"], (rows, count)), points, [np.arange(rows)])
    memory = _numbers(content["memory"], (rows, 3))
    return Residual(
        robot=robot,
        rod=None if content["rod"] is None else RodModel(**content["rod"]),
        values={str(name): float(value) for name, value in content["values"].items()},
        tool=_numbers(content["tool"], (3,)),
        hyperparameters=at,
        scales=scales,
        by_displacement=kinds,
        table=table.with_memory(at.radius * scales.length, memory),
        residuals=_numbers(content["residuals"], (rows, 3)),
        validated=(folds[0], folds[1]),
    )


def _numbers(value: Any, shape: tuple[int, ...]) -> Floats:
    """Finite numbers of a shape, of which -1 stands for any size."""
    found = np.array(value, dtype=float)
    fits = len(found.shape) == len(shape) and all(
        want in (-1, size) for want, size in zip(shape, found.shape, strict=True)
    )
    if not fits or not np.isfinite(found).all():
        raise ValueError("numbers")
    return found
