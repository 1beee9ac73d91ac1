"""The robot along the sweep in 3-D for the report: numbers that its script draws."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.display import some
from bowstring.errors import BowstringError
from bowstring.study.comparison import FROM_FORCE, MEANINGS, arcs_of

if TYPE_CHECKING:
    from bowstring.study.study import Study

_MOST_LOADS: Final = 60
_MOST_DISKS: Final = 120
_MOST_HOLES: Final = 600
_MOST_MEASURED: Final = 300
_POINTS: Final = 17  # of an arc
_LABELS: Final = {"cc_from_force": "CC from force", "cc_from_lengths": "CC from tendon lengths"}


def scene(study: Study) -> dict[str, Any] | None:
    """Shapes of rod and constant curvature at the loads of a study, and measured points.

    Returns
    -------
    dict or None
        Lengths in mm in the base frame, loads in N, at most 60 loads with an equilibrium and 120
        disks: ``load, disks`` (position and rotation by rows), ``models`` with ``backbone`` and
        ``error``, ``measured``, and sizes of the robot. None without an equilibrium.
    """
    robot, statics = study.robot, study.statics
    rows = np.flatnonzero(statics.converged)
    if not len(rows):
        return None
    rows = rows[some(len(rows), _MOST_LOADS)]
    kept = some(len(robot.disks.station_m), _MOST_DISKS)
    position, rotation = statics.disk_positions[rows], statics.disk_rotations[rows]
    poses = np.concatenate(
        [position[:, kept] * 1e3, rotation[:, kept].reshape(len(rows), -1, 9)], axis=-1
    )
    return {
        "length": robot.length * 1e3,
        "load": _rounded(statics.tension[rows], 4),
        "station": _rounded(robot.disks.station_m[kept] * 1e3, 3),
        "radius": _rounded(robot.disks.radius_m[kept] * 1e3, 3),
        "disks": _rounded(poses, 4),
        "tendons": _tendons(study, position, rotation),
        "tolerance": study.settings.tolerance * robot.length * 1e3,
        "models": [_model(study, name, rows) for name in MEANINGS],
        "measured": _measured(study),
        "label": None if study.data is None else study.data.label,
    }


def _tendons(study: Study, position: Floats, rotation: Floats) -> list[Any]:
    """Points of each tendon (mm) at each load; empty for a robot with very many holes."""
    robot = study.robot
    if len(robot.tendons.segment) * position.shape[1] > _MOST_HOLES:
        return []
    paths = robot.tendon_points(position, rotation)
    return [[_rounded(path[k] * 1e3, 2) for path in paths] for k in range(len(position))]


def _model(study: Study, name: str, rows: Ints) -> dict[str, Any]:
    """Backbones (mm) and tip errors (mm) of a model of constant curvature; null without an arc."""
    model, statics = study.model, study.statics
    commands = model.tensions(statics.tension) if name in FROM_FORCE else statics.tendon_lengths
    backbones: list[Any] = []
    for command in commands[rows]:
        try:
            line = arcs_of(model.robot, name, command).centerline(_POINTS)
        except BowstringError:  # no arc has these lengths
            backbones.append(None)
            continue
        backbones.append(_rounded(line * 1e3, 3))
    error = study.comparison(name).error[rows] * 1e3
    return {
        "name": name,
        "label": _LABELS[name],
        "backbone": backbones,
        "error": [None if np.isnan(e) else float(f"{e:.6g}") for e in error],
    }


def _measured(study: Study) -> list[Any]:
    """Measured points (mm) in the base frame."""
    if study.data is None:
        return []
    points = study.data.point[np.isfinite(study.data.point).all(axis=1)]
    found: list[Any] = _rounded(points[some(len(points), _MOST_MEASURED)] * 1e3, 3)
    return found


def _rounded(values: Any, digits: int) -> Any:
    return np.round(np.asarray(values, dtype=float), digits).tolist()


def scene_text(study: Study) -> str:
    """`scene` as JSON that may stand in a script element."""
    text = json.dumps(scene(study), allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c")
