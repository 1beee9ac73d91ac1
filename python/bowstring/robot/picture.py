"""Small picture of a robot for a notebook: an SVG seen across the plane of its bend."""

from __future__ import annotations

import html
from collections.abc import Callable, Collection, Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.display import some

if TYPE_CHECKING:
    from bowstring.robot.arrays import RobotArrays

_SIZE: Final = 180  # pixels of the longer side
_ROOM: Final = 8
_FAINT: Final = 0.25
_POSES: Final = 4


def picture(
    robot: RobotArrays,
    positions: Floats,
    rotations: Floats,
    *,
    slack: Collection[int] = (),
    title: str = "",
) -> str:
    """Draw a robot in one pose, or in up to four of several, the last one darkest.

    The view is along the normal of the plane through z and the farthest tip; z points up.

    Parameters
    ----------
    robot : RobotArrays
        The robot.
    positions : ndarray (N, 3) or (n, N, 3)
        Positions of its disks in m, base frame.
    rotations : ndarray (N, 3, 3) or (n, N, 3, 3)
        Rotations of its disks.
    slack : collection of int
        Tendons, from 1, that are drawn dashed in the last pose.
    title : str
        Text for readers who do not see the picture.

    Returns
    -------
    str
        SVG in the colour of the surrounding text; empty without a finite pose.
    """
    centres = np.asarray(positions, dtype=float).reshape(-1, len(robot.disks.station_m), 3)
    frames = np.asarray(rotations, dtype=float).reshape(*centres.shape, 3)
    known = np.isfinite(centres).all(axis=(1, 2))
    shown = some(int(known.sum()), _POSES)
    centres, frames = centres[known][shown], frames[known][shown]
    if not len(centres):
        return ""
    aside = np.linalg.norm(centres[:, -1, :2], axis=1)
    x, y = centres[int(aside.argmax()), -1, :2]
    size = float(aside.max())
    view = np.array([[x, y, 0.0], [0.0, 0.0, size]]) / size if size > 1e-6 * robot.length else _XZ
    poses = [
        _Pose(robot, *pose, view, slack if k == len(centres) - 1 else ())
        for k, pose in enumerate(zip(centres, frames, strict=True))
    ]
    every = np.concatenate([points for pose in poses for points in pose.points])
    low, high = every.min(axis=0), every.max(axis=0)
    scale = _SIZE / float((high - low).max())
    width, height = scale * (high - low) + 2 * _ROOM

    def place(points: Floats) -> Floats:
        across = scale * (points[:, 0] - low[0]) + _ROOM
        return np.stack([across, scale * (high[1] - points[:, 1]) + _ROOM], axis=1)

    groups = (
        f'<g opacity="{1.0 if k == len(poses) - 1 else _FAINT:g}">{pose.svg(place)}</g>'
        for k, pose in enumerate(poses)
    )
    said = html.escape(title or robot.name)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'role="img" aria-label="{said}" fill="none" stroke="currentColor" '
        f'stroke-linecap="round"><title>{said}</title>{"".join(groups)}</svg>'
    )


_XZ: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


class _Pose:
    """Projected backbone, disks and tendons of a pose."""

    def __init__(
        self,
        robot: RobotArrays,
        centres: Floats,
        frames: Floats,
        view: Floats,
        slack: Collection[int],
    ) -> None:
        base = np.zeros((1, 3)), np.eye(3)[None]
        points = np.concatenate([base[0], centres]) @ view.T
        tangents = np.concatenate([base[1], frames])[:, :, 2] @ view.T
        # cubic curves from disk to disk, along the normals of both
        length = np.diff(robot.disks.station_m, prepend=0.0)[:, None] / 3.0
        self._backbone = points
        self._handles = points[:-1] + length * tangents[:-1], points[1:] - length * tangents[1:]
        across = np.cross(frames[:, :, 2], np.cross(view[0], view[1]))
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
        arm = (robot.disks.radius_m[:, None] * across) @ view.T
        self._disks = np.stack([points[1:] - arm, points[1:] + arm], axis=1)
        self._tendons = [path @ view.T for path in robot.tendon_points(centres, frames)]
        self._slack = slack

    @property
    def points(self) -> Iterable[Floats]:
        """All points, for the size of the picture."""
        return [self._backbone, self._disks.reshape(-1, 2), *self._tendons]

    def svg(self, place: Callable[[Floats], Floats]) -> str:
        """Elements, at places (n, 2) in pixels by a function of points (n, 2)."""
        rows = np.concatenate([place(h) for h in (*self._handles, self._backbone[1:])], axis=1)
        start = _pair(place(self._backbone[:1])[0])
        curve = " ".join("C" + " ".join(_pair(row[i : i + 2]) for i in (0, 2, 4)) for row in rows)
        disks = " ".join("M" + " L".join(map(_pair, place(disk))) for disk in self._disks)
        tendons = "".join(
            f'<path d="M{" L".join(map(_pair, place(path)))}"'
            + (' stroke-dasharray="3 3"/>' if k in self._slack else "/>")
            for k, path in enumerate(self._tendons, 1)
        )
        return (
            f'<g stroke-width="0.7" opacity="0.7">{tendons}</g>'
            f'<path stroke-width="2" opacity="0.45" d="{disks}"/>'
            f'<path stroke-width="3" d="M{start} {curve}"/>'
        )


def _pair(point: Floats) -> str:
    return f"{point[0]:.1f},{point[1]:.1f}"
