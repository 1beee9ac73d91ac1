"""Inverse kinematics by constant curvature: arcs for a tip, and the least tensions for arcs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.constant_curvature.arc import Arc
from bowstring.constant_curvature.series import series_jacobian

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_ITERATIONS: Final = 200
_REDUCTIONS: Final = 100  # iterations that make the bends smaller
_STARTS: Final = 8
_LARGEST_STEP: Final = 0.7  # rad in one iteration
_SHARE: Final = 0.5  # share of the way to the least bends in one iteration
_NEAR: Final = 1e-10  # distance over length at which the iteration ends
_REACHED: Final = 1e-6  # distance over length of a reached tip
_DAMPING: Final = 1e-9
_SHARP: Final = 1e6  # weight of the moments beside the tensions


def arcs_to(robot: Robot, positions: Floats, directions: Floats | None) -> RobotArcs:
    """Arcs (n, S) of the segments' own lengths whose tip is nearest to positions (n, 3).

    In closed form for a position and one segment; otherwise by Gauss-Newton iteration, of the arcs
    that reach the tip those with the least sum of squared bends (theory Eq. 10.9).
    """
    if len(robot.segments) == 1 and directions is None:
        return RobotArcs.ik(robot, positions)
    lengths = np.array([segment.length for segment in robot.segments])
    best = np.full((len(positions), len(lengths), 2), np.nan)
    size = np.full(len(positions), np.inf)
    for start in range(_STARTS):
        rows = np.flatnonzero(size > _REACHED)
        if not rows.size:
            break
        given = None if directions is None else directions[rows]
        bends = _start(positions[rows], lengths, start)
        bends, found = _iterate(bends, lengths, positions[rows], given)
        nearer = found < size[rows] - _NEAR
        best[rows[nearer]], size[rows[nearer]] = bends[nearer], found[nearer]
    kappa = np.linalg.norm(best, axis=-1) / lengths
    phi = np.arctan2(best[..., 1], best[..., 0])
    return RobotArcs(robot, Arc(kappa, phi, np.broadcast_to(lengths, kappa.shape)))


def _start(positions: Floats, lengths: Floats, start: int) -> Floats:
    """Bends (n, S, 2): one arc through the tip, then bends against each other."""
    x, y, z = positions.T
    phi, theta = np.arctan2(y, x), 2.0 * np.arctan2(np.hypot(x, y), z)
    share = lengths / lengths.sum()
    if start > 0:
        segments = np.arange(len(lengths))
        phi = phi[:, None] + 2.0 * np.pi * (0.618034 * start + 0.5 * (segments + start))
        theta = np.full_like(phi, 1.2)
    else:
        phi, theta = phi[:, None], theta[:, None] * share
    return np.stack([theta * np.cos(phi), theta * np.sin(phi)], axis=-1)


def _iterate(
    bends: Floats, lengths: Floats, positions: Floats, directions: Floats | None
) -> tuple[Floats, Floats]:
    """Bends after Gauss-Newton iteration, and the distances of their tips over the length."""
    whole, count = lengths.sum(), bends.shape[1]
    ones = np.ones((len(bends), count))
    columns = np.ravel(3 * np.arange(count)[:, None] + np.arange(2))
    damping = np.full(len(bends), _DAMPING)
    size, last = np.full(len(bends), np.inf), bends
    residual = by = np.zeros(0)
    for iteration in range(_ITERATIONS):
        arcs = np.concatenate([bends, np.broadcast_to(lengths, ones.shape)[..., None]], axis=-1)
        pose, jacobian = series_jacobian(arcs, ones)
        here = (pose.position - positions) / whole
        there = jacobian[:, :3, columns] / whole
        if directions is not None:
            tangent = pose.rotation[..., 2]
            here = np.concatenate([here, tangent - directions], axis=-1)
            turned = np.cross(jacobian[:, 3:, columns], tangent[..., None], axis=1)
            there = np.concatenate([there, turned], axis=1)
        found = np.linalg.norm(here, axis=-1)
        reduces = iteration < _REDUCTIONS
        good = found <= size + (1e-3 if reduces else 0.0)
        if residual.size:
            # a worse step is taken back and repeated with more damping
            here = np.where(good[:, None], here, residual)
            there = np.where(good[:, None, None], there, by)
            bends = np.where(good[:, None, None], bends, last)
            found = np.where(good, found, size)
        damping = np.where(good, np.maximum(_DAMPING, 0.1 * damping), 1e-3 + 10.0 * damping)
        residual, by, size, last = here, there, found, bends
        inverse = np.linalg.inv(
            by @ by.swapaxes(1, 2) + damping[:, None, None] * np.eye(by.shape[1])
        )
        back = by.swapaxes(1, 2) @ inverse
        flat = bends.reshape(len(bends), -1)
        step = -(back @ residual[..., None])[..., 0]
        # along directions that leave the tip, towards the least bends
        free = flat - (back @ (by @ flat[..., None]))[..., 0]
        step = step - _SHARE * reduces * np.where(damping[:, None] > 1e-6, 0.0, free)
        largest = np.abs(step).max(axis=-1)
        step *= np.minimum(1.0, _LARGEST_STEP / np.maximum(largest, 1e-300))[:, None]
        if (largest < 1e-11).all():
            break
        bends = (flat + step).reshape(bends.shape)
    return last, size


def tensions_of(robot: Robot, arcs: RobotArcs, least: Floats, most: Floats) -> Floats:
    """Least tensions (n, T) within limits (T,) whose moments bend the segments to arcs (n, S).

    By the linear law (theory Eq. 1.7). Where the limits do not allow the moments, the nearest.
    """
    from scipy.optimize import lsq_linear, nnls

    count = robot.core.tendon_count
    law = RobotArcs.from_tensions(robot, np.concatenate([np.zeros((1, count)), np.eye(count)]))
    vectors = _curvatures(law)
    rest, by = vectors[0], (vectors[1:] - vectors[0]).T
    wanted = _curvatures(arcs) - rest
    # without units: one tension of this size bends a segment by its own radian
    unit = 1.0 / max(float(np.abs(by).max() * robot.length), 1e-300)
    matrix = np.concatenate([_SHARP * by * unit * robot.length, np.eye(count)])
    low, high = least / unit, most / unit
    out = np.empty((len(wanted), count))
    for row, curvature in enumerate(wanted):
        right = np.concatenate([_SHARP * curvature * robot.length, np.zeros(count)])
        if not np.isfinite(right).all():
            out[row] = np.nan
            continue
        found = low + nnls(matrix, right - matrix @ low)[0]
        if (found > high).any():
            wide = np.maximum(high, low + 1e-12)
            found = lsq_linear(matrix, right, (low, wide), method="bvls").x
        out[row] = np.clip(found, low, high) * unit
    return out


def _curvatures(arcs: RobotArcs) -> Floats:
    """Curvature vectors by length without load (n, 2 S) in 1/m.

    Where tendons push, also the strains (n, S) over the length of the robot: linear in tensions.
    """
    stretch = arcs.length / [segment.length for segment in arcs.robot.segments]
    size = arcs.kappa * stretch
    vectors = size[..., None] * np.stack([np.cos(arcs.phi), np.sin(arcs.phi)], axis=-1)
    flat = np.asarray(vectors.reshape(len(vectors), -1))
    if not arcs.robot.tendons.pushes.any():
        return flat
    return np.concatenate([flat, (stretch - 1.0) / arcs.robot.length], axis=-1)
