"""Composition of arcs in series.

An arc is a row of bend coordinates (theta cos phi, theta sin phi, length), as in
`bowstring.constant_curvature.arc`; the compiled core evaluates it, also near the straight pose.
Each arc starts at the end of the one before, in its direction.
"""

from __future__ import annotations

import numpy as np

import bowstring._core as _core
from bowstring.aliases import Floats
from bowstring.pose import Pose


def series_pose(arcs: Floats, share: Floats) -> Pose:
    """Pose at the end of S arcs in series.

    Parameters
    ----------
    arcs : ndarray (..., S, 3)
        Bend coordinates, rad and m.
    share : ndarray (..., S)
        Used part of each arc, from 0 to 1. Leading dimensions broadcast.

    Returns
    -------
    Pose
        Pose in the frame of the start.
    """
    steps = _steps(share[..., None] * arcs)
    pose = steps[0]
    for step in steps[1:]:
        pose = pose @ step
    return pose


def series_jacobian(arcs: Floats, share: Floats) -> tuple[Pose, Floats]:
    """Pose at the end of S arcs in series, and its derivative by their bend coordinates.

    The parameters are those of `series_pose`. The derivative (..., 6, 3 S) at fixed shares has the
    position in rows 0 to 2, and in rows 3 to 5 the rotation vector w in the axes of the start, with
    dR = [w] R.
    """
    parts = share[..., None] * arcs
    local = _core.arc_pose_jacobian(parts.reshape(-1, 3)).reshape(*parts.shape[:-1], 6, 3)
    local = local * share[..., None, None]
    steps = _steps(parts)
    pose, ends = steps[0], [steps[0].position]
    columns = [local[..., 0, :, :]]
    for i, step in enumerate(steps[1:], 1):
        halves = local[..., i, :3, :], local[..., i, 3:, :]
        columns.append(np.concatenate([pose.rotation @ half for half in halves], axis=-2))
        pose = pose @ step
        ends.append(pose.position)
    # a change of an arc moves all arcs beyond it rigidly
    for column, end in zip(columns[:-1], ends[:-1], strict=True):
        lever = (pose.position - end)[..., None]
        column[..., :3, :] += np.cross(column[..., 3:, :], lever, axis=-2)
    return pose, np.concatenate(columns, axis=-1)


def _steps(parts: Floats) -> list[Pose]:
    """Pose of the end of each arc (..., S, 3) in the frame of its own start."""
    position, rotation = _core.arc_pose(parts.reshape(-1, 3))
    position, rotation = position.reshape(parts.shape), rotation.reshape(*parts.shape, 3)
    return [Pose(position[..., i, :], rotation[..., i, :, :]) for i in range(parts.shape[-2])]
