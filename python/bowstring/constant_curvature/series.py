"""Poses, and arcs in series: the one place where arcs are composed.

An arc is a row of bend coordinates (theta cos phi, theta sin phi, length), as in
`bowstring.constant_curvature.arc`; its values near the straight pose are those of the compiled
core. Each arc starts where the one before it ends, in its direction.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import bowstring._core as _core

__all__ = ["Pose", "series_jacobian", "series_pose"]

Array = NDArray[np.float64]


class Pose(NamedTuple):
    """Positions and rotations, elements of SE(3); ``a @ b`` composes them."""

    position: Array
    """Position (..., 3), m."""
    rotation: Array
    """Rotation (..., 3, 3), maps body to the frame that the position is in."""

    def __matmul__(self, other: Pose) -> Pose:
        """The pose `other`, given in the frame of this one; leading dimensions broadcast."""
        moved = (self.rotation @ other.position[..., None])[..., 0]
        return Pose(self.position + moved, self.rotation @ other.rotation)


def series_pose(arcs: Array, share: Array) -> Pose:
    """Pose at the end of S arcs in series.

    Parameters
    ----------
    arcs : ndarray (..., S, 3)
        Bend coordinates, rad and m.
    share : ndarray (..., S)
        Share of each arc that counts, from 0 to 1. Leading dimensions broadcast.

    Returns
    -------
    Pose
        In the frame of the start.
    """
    steps = _steps(share[..., None] * arcs)
    pose = steps[0]
    for step in steps[1:]:
        pose = pose @ step
    return pose


def series_jacobian(arcs: Array, share: Array) -> tuple[Pose, Array]:
    """Pose at the end of S arcs in series, and its derivative by their bend coordinates.

    The parameters are those of `series_pose`. The derivative (..., 6, 3 S), at fixed shares, has
    rows 0 to 2 for the position and 3 to 5 for the rotation vector w in the axes of the start, with
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
    # the arcs beyond are carried along
    for column, end in zip(columns[:-1], ends[:-1], strict=True):
        lever = (pose.position - end)[..., None]
        column[..., :3, :] += np.cross(column[..., 3:, :], lever, axis=-2)
    return pose, np.concatenate(columns, axis=-1)


def _steps(parts: Array) -> list[Pose]:
    """Pose of the end of each arc (..., S, 3) in the frame of its own start."""
    position, rotation = _core.arc_pose(parts.reshape(-1, 3))
    position, rotation = position.reshape(parts.shape), rotation.reshape(*parts.shape, 3)
    return [Pose(position[..., i, :], rotation[..., i, :, :]) for i in range(parts.shape[-2])]
