"""Unloaded shape of a backbone: arcs and helices of the rest curvature, straight in clamps."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.robot.arrays import RobotArrays

_AXIS: Final = np.array([0.0, 0.0, 1.0])


def rest_frames(robot: RobotArrays, arc_length: Floats) -> tuple[Floats, Floats]:
    """Frames of the unloaded backbone at arc lengths.

    Parameters
    ----------
    robot : RobotArrays
    arc_length : ndarray (n,)
        Arc lengths from the base in m. Beyond the last disk the backbone is straight.

    Returns
    -------
    position : ndarray (n, 3)
        Positions in m, base frame.
    rotation : ndarray (n, 3, 3)
        Rotations, frame of the section to base frame.
    """
    disks = robot.disks
    half = 0.5 * disks.clamped_length_m
    before = np.concatenate([[0.0], half[:-1]])  # the base clamps nothing
    start = np.concatenate([[0.0], disks.station_m[:-1]]) + before
    flexible = disks.station_m - half - start
    curvature = robot.rest_curvature[disks.segment]
    along, turned = _helix(curvature, flexible)
    origin, frame = np.zeros((len(start), 3)), np.zeros((len(start), 3, 3))
    here, axes = np.zeros(3), np.eye(3)
    for d in range(len(start)):
        origin[d], frame[d] = here + before[d] * axes[:, 2], axes
        here, axes = origin[d] + axes @ along[d], axes @ turned[d]
        here = here + half[d] * axes[:, 2]
    s = np.asarray(arc_length, dtype=np.float64)
    module = np.minimum(np.searchsorted(disks.station_m, s), len(start) - 1)
    local = s - start[module]
    within = np.clip(local, 0.0, flexible[module])
    place, rotation = _helix(curvature[module], within)
    place += (local - within)[:, None] * rotation[..., 2]  # in a clamp
    position: Floats = origin[module] + np.einsum("nij,nj->ni", frame[module], place)
    return position, frame[module] @ rotation


def _helix(curvature: Floats, length: Floats) -> tuple[Floats, Floats]:
    """Ends (n, 3) and frames (n, 3, 3) of helices from the origin along z (Rodrigues)."""
    size = np.linalg.norm(curvature, axis=1)
    axis = np.divide(
        curvature, size[:, None], out=np.zeros_like(curvature), where=size[:, None] > 0
    )
    angle = size * length
    cos, sin = np.cos(angle)[:, None, None], np.sin(angle)[:, None, None]
    outer = axis[:, :, None] * axis[:, None, :]
    cross = np.cross(axis[:, None, :], np.eye(3)[None]).swapaxes(-1, -2)  # columns axis x e_j
    # without curvature the axis is zero, and the frame the identity
    rotation: Floats = cos * np.eye(3) + sin * cross + (1.0 - cos) * outer
    along = axis[:, 2:] * axis
    mean_cos = np.sinc(angle / math.pi)[:, None]
    mean_sin = (np.sin(0.5 * angle) * np.sinc(0.5 * angle / math.pi))[:, None]
    mean = along + mean_cos * (_AXIS - along) + mean_sin * np.cross(axis, _AXIS)
    return length[:, None] * mean, rotation


def unloaded_pose(robot: RobotArrays) -> Literal["straight", "unloaded"]:
    """Name the pose without load: `straight`, or `unloaded` if the backbone is not straight."""
    return "unloaded" if robot.rest_curvature.any() else "straight"


def check_rest_bend(robot: RobotArrays, what: str) -> None:
    """Refuse a backbone that is bent without load to a radius below that of its section."""
    for k, (segment, curvature) in enumerate(
        zip(robot.segments, robot.rest_curvature, strict=True)
    ):
        rod = segment.backbone
        bend, radius = float(np.hypot(*curvature[:2])), 0.5 * float(rod.outer_diameter)
        if bend * radius >= 1.0:
            most = math.degrees(segment.length / radius)
            raise InputError(
                f"{robot.name}: segments[{k}].backbone.rest_bend is "
                f"{math.degrees(rod.rest_bend):g} deg; {what} takes less than {most:.4g} deg, at "
                "which the radius of the bend is half the diameter"
            )
