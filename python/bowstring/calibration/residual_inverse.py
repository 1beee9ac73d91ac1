"""Inverse kinematics with a residual: commands that bring the corrected point to a position.

The position is shifted by what separates the corrected point from the tip of the calibrated model,
and the inverse of this model is solved again, until the shift no longer changes (a fixed point,
docs/theory/calibration.md). K is the number of rows, T that of tendons.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Bools, Floats
from bowstring.calibration.parameters import Setting, Unknowns
from bowstring.calibration.residual import LEAST_KEPT, Residual
from bowstring.calibration.tip_model import rotation
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.inverse.kinematics import inverse_kinematics
from bowstring.inverse.limits import ActuationLimits
from bowstring.inverse.solution import InverseSolution
from bowstring.statics.load import Load

#: Distance over the length up to which a position counts as reached.
_REACHED: Final = 1e-5
_LEAST_STEPS: Final = 8
_MOST_STEPS: Final = 30
#: Largest distance of a shifted position from the base, over the length of the robot.
_FARTHEST: Final = 0.999999


@short_repr
@dataclass(frozen=True, eq=False)
class CorrectedInverse:
    """Commands whose corrected points are at given positions; by `inverse_with_residual`.

    Attributes
    ----------
    position : ndarray (K, 3)
        Wanted positions of the measured point in the measuring frame, m.
    commands : ndarray (K, T)
        Displacements in m and tensions in N, as in the rows of the fit; NaN without an equilibrium.
    by_displacement : ndarray of bool (T,)
        Kind of command of each tendon.
    point : ndarray (K, 3)
        Corrected points that these commands lead to, m.
    kept : ndarray (K,)
        As in `Corrected`.
    status : tuple of str
        Of each row: ``"reached"``; ``"unreachable"``, the point is near the nearest that was found;
        ``"no_equilibrium"``; or ``"max_iterations"``, where the shift still changed.
    """

    position: Floats
    commands: Floats
    by_displacement: Bools
    point: Floats
    kept: Floats
    status: tuple[str, ...]

    @property
    def distance(self) -> Floats:
        """Distances (K,) of the corrected points from their positions, m."""
        return np.asarray(np.linalg.norm(self.point - self.position, axis=1))

    @property
    def reached(self) -> Bools:
        """Whether each position (K,) is reached, within 1e-5 of the length."""
        return np.array([status == "reached" for status in self.status])

    @property
    def beyond(self) -> Bools:
        """Rows (K,) beyond the data of the residual, which the calibrated model answers."""
        return np.asarray(~(self.kept >= LEAST_KEPT))

    @property
    def load(self) -> Load:
        """The commands as a load."""
        return _load(self.commands, self.by_displacement)


def inverse_with_residual(
    residual: Residual,
    position: ArrayLike,
    *,
    limits: ActuationLimits | None = None,
    progress: Callable[[float], None] | None = None,
) -> CorrectedInverse:
    """Find commands that bring the measured point, predicted with a residual, to positions.

    Parameters
    ----------
    residual : Residual
        Calibrated model and residual.
    position : array_like (3,) or (K, 3)
        Wanted positions of the measured point in the measuring frame, m. Rows are one path in
        order, which memory states follow.
    limits : ActuationLimits, optional
        Limits of the tensions of the calibrated model, as for `bowstring.inverse_kinematics`.
    progress : callable, optional
        Progress callback, called with the finished share from 0 to 1.

    Returns
    -------
    CorrectedInverse
        Commands, corrected points and status of each row.

    Raises
    ------
    InputError
        If an argument is wrong, there are limits of displacements, the fit has a delay that its
        robot file does not have, or the calibrated robot has no inverse.
    """
    residual = validation.instance("residual", residual, Residual)
    wanted = np.atleast_2d(validation.vectors("position", position))
    if wanted.ndim != 2 or not len(wanted) or not np.isfinite(wanted).all():
        raise InputError("position must be (3,) or (K, 3) finite numbers in m")
    if limits is not None and limits.displacement_limits is not None:
        raise InputError(
            "displacement_limits are not possible with a residual: commands have gain and offset",
            argument="limits",
        )
    robot = residual.robot
    setting = Unknowns(robot, [], residual.values).setting(np.zeros(0))
    notify = progress or (lambda share: None)
    turn = rotation(setting.turn)
    # in the base frame of the robot, where the shift is added
    local = (wanted - setting.position) @ turn
    target, farthest = local, _FARTHEST * setting.robot.length
    for step in range(_MOST_STEPS):
        size = np.linalg.norm(target, axis=1, keepdims=True)
        target = target * np.minimum(1.0, farthest / np.maximum(size, farthest))
        found = inverse_kinematics(
            setting.robot,
            target,
            model="constant_curvature" if residual.rod is None else residual.rod,
            limits=limits,
        )
        commands = _commands(found, setting, residual.by_displacement)
        solved = np.array(np.isfinite(commands).all(axis=1))
        point, kept = _corrected(residual, commands, solved)
        shift = (point - setting.position) @ turn - found.tip_position
        shifted = np.where(np.isfinite(shift), local - shift, target)
        moving = np.linalg.norm(shifted - target, axis=1) > 0.1 * _REACHED * robot.length
        notify((step + 1) / _MOST_STEPS)
        # for a position out of reach the nearest tip may alternate between two sets of tensions
        out_of_reach = np.array(found.status) == "unreachable"
        if not moving.any() or (step >= _LEAST_STEPS and not (moving & ~out_of_reach).any()):
            break
        target = shifted
    near = np.linalg.norm(point - wanted, axis=1) <= _REACHED * robot.length
    missed = np.where(out_of_reach, "unreachable", "max_iterations")
    status = np.where(near, "reached", np.where(solved, missed, "no_equilibrium"))
    return CorrectedInverse(
        wanted, commands, residual.by_displacement, point, kept, tuple(status.tolist())
    )


def _commands(found: InverseSolution, setting: Setting, by_displacement: Bools) -> Floats:
    """Commands (K, T) of the motors, before gain and offset of the calibration."""
    displacements = found.displacements()
    if displacements is None:
        displacements = np.full_like(found.tensions, np.nan)
    moved = (displacements - setting.offset) / setting.gain
    readings = found.tensions
    if not by_displacement.any():  # offsets of tensions are known there alone
        readings = readings - setting.tension_offset
    readings = np.maximum(readings / setting.tension_gain, setting.robot.tendons.least_tension_N)
    return np.where(by_displacement, moved, readings)


def _corrected(residual: Residual, commands: Floats, solved: Bools) -> tuple[Floats, Floats]:
    """Corrected points (K, 3) of a path of commands, and `kept`; NaN for rows without any."""
    point, kept = np.full((len(commands), 3), np.nan), np.full(len(commands), np.nan)
    if solved.any():
        got = residual.correct(_load(commands[solved], residual.by_displacement))
        point[solved], kept[solved] = got.point, got.kept
    return point, kept


def _load(commands: Floats, by_displacement: Bools) -> Load:
    return Load(
        tensions=None if by_displacement.all() else np.where(by_displacement, np.nan, commands),
        displacements=np.where(by_displacement, commands, np.nan)
        if by_displacement.any()
        else None,
    )
