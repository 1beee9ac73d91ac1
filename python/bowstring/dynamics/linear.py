"""Linear model of small motions about an equilibrium, for control design."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.dynamics.modal import Oscillation, checked, oscillation
from bowstring.errors import InputError
from bowstring.robot.laws import OF_DISPLACEMENTS
from bowstring.robot.model import check_without_laws, without_laws
from bowstring.statics.derivatives import jacobians
from bowstring.statics.load import Load, as_load
from bowstring.statics.model import as_model
from bowstring.statics.rod import solve
from bowstring.validation import is_whole, number, read, shown

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.actuation import Given


class DiscreteModel(NamedTuple):
    """Linear model in steps: ``x[k + 1] = A x[k] + B u[k]``, ``y = C x + D u``."""

    A: Floats
    """State matrix (2 K, 2 K)."""
    B: Floats
    """Input matrix (2 K, T)."""
    C: Floats
    """Output matrix (3 + T, 2 K)."""
    D: Floats
    """Feedthrough matrix (3 + T, T)."""
    dt: float
    """Step, s."""


@short_repr
@dataclass(frozen=True, eq=False)
class LinearModel:
    """Small motions about an equilibrium; made by `linearise`.

    ``dx/dt = A x + B u + B_force f`` and ``y = C x + D u + D_force f``, all as changes from the
    equilibrium. The state x are K modal coordinates (m kg^(1/2)) and their rates, u the tensions
    (N), f a dead force on the tip (N), and y the position of the tip and the lengths of the tendons
    (m).

    `D` and `D_force` hold the static response of all modes that are left out, so that the response
    to a constant u or f is exact.
    """

    robot: Robot
    """The robot."""
    frequency_hz: Floats
    """Natural frequencies of the modes (K,), Hz."""
    damping: Floats
    """Damping ratios of the modes (K,)."""
    tensions: Floats
    """Tensions of the equilibrium (T,), N."""
    outputs: Floats
    """Tip position and tendon lengths in the equilibrium (3 + T,), m."""
    A: Floats
    """State matrix (2 K, 2 K)."""
    B: Floats
    """Input matrix of the tensions (2 K, T)."""
    C: Floats
    """Output matrix (3 + T, 2 K)."""
    D: Floats
    """Feedthrough matrix of the tensions (3 + T, T)."""
    B_force: Floats
    """Input matrix of the force (2 K, 3)."""
    D_force: Floats
    """Feedthrough matrix of the force (3 + T, 3)."""

    def discrete(self, dt: float) -> DiscreteModel:
        """Model in steps with inputs that are constant in a step (zero-order hold).

        Parameters
        ----------
        dt : float
            Step in s.

        Returns
        -------
        DiscreteModel
            Matrices in the order that `scipy.signal.dlti` and ``control.ss`` take.
        """
        from scipy.linalg import expm

        dt = number("dt", dt, "s")
        if dt <= 0.0:
            raise InputError(f"dt is {dt:g} s, it must be above 0 s")
        states, inputs = self.B.shape
        both = np.zeros((states + inputs, states + inputs))
        both[:states] = np.concatenate([self.A, self.B], axis=1) * dt
        with np.errstate(all="ignore"):
            turned = expm(both)
        if not np.isfinite(turned).all():
            raise InputError(f"dt is {dt:g} s, too long for a finite response; give a shorter step")
        return DiscreteModel(turned[:states, :states], turned[:states, states:], self.C, self.D, dt)


def linearise(
    robot: Robot,
    tensions: Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    modes: int = 12,
    damping: ArrayLike = 0.01,
) -> LinearModel:
    """Linearise the motion about the equilibrium of tensions and dead loads.

    Parameters
    ----------
    robot : Robot
        Robot without friction.
    tensions : array_like (T,), optional
        Tensions in N, short for ``load=Load(tensions)``; zero by default.
    load : Load, optional
        As for `bowstring.modes`, with tensions only. A slack tendon (0 N) can be tightened in the
        model, and loosened, which it cannot in the robot.
    model : RodModel, optional
        As for `bowstring.solve`.
    modes : int
        Number of modes, the slowest; faster ones respond at once.
    damping : array_like () or (K,)
        Damping ratio of all modes, or of each (0.01 is 1 % of critical).

    Returns
    -------
    LinearModel
        Matrices of a linear model, for LQR, Kalman filters and model-predictive control.

    Raises
    ------
    InputError
        If an argument is wrong, and for tendons with friction or without derivatives.
    NoSolutionError
        If there is no stable equilibrium.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> found = bs.linearise(robot, [40, 0, 0], modes=4)
    >>> found.frequency_hz.round(2)[:2]
    array([1.59, 1.63])
    >>> found.discrete(1e-3).B.shape
    (8, 3)
    """
    model = as_model(model)
    given = as_load(tensions, load)
    if not given.is_tension_controlled:
        raise InputError("a linear model is for tensions; load has displacements or angles")
    if not is_whole(modes) or modes < 1:
        raise InputError.of("modes", shown(modes), "a positive whole number")
    commands, dead, path = checked(robot, None, given, model, None, modes)
    if robot.is_embedded:
        raise InputError(
            "a linear model needs derivatives, which tendons in the body do not have; "
            f"{robot.name} has such tendons"
        )
    check_without_laws(robot, ", which no linear model has", but=OF_DISPLACEMENTS)
    found = oscillation(robot, commands, dead, model, path, count=modes)
    ratios = _damping(damping, len(found.speed), modes)
    by = jacobians(solve(without_laws(robot), commands[1], load=dead, model=model))
    shapes = found.displacement[:, -1].T
    lengths, stretched = _lengths(robot, found)
    # a tension does work as its tendon becomes shorter
    by_tension, by_force = -stretched.T, shapes.T
    squared = found.speed**2
    static = np.concatenate([by.tip_position_by_tension, by.lengths_by_tension])
    static_force = np.concatenate([by.tip_position_by_tip_force, by.lengths_by_tip_force])
    seen = np.concatenate([shapes, stretched])
    count = len(squared)
    zero, one = np.zeros((count, count)), np.eye(count)
    return LinearModel(
        robot=robot,
        frequency_hz=found.speed / (2.0 * np.pi),
        damping=ratios,
        tensions=found.tensions,
        outputs=np.concatenate([found.position[-1], lengths]),
        A=np.block([[zero, one], [-np.diag(squared), -np.diag(2.0 * ratios * found.speed)]]),
        B=np.concatenate([np.zeros_like(by_tension), by_tension]),
        C=np.concatenate([seen, np.zeros_like(seen)], axis=1),
        D=static - seen @ (by_tension / squared[:, None]),
        B_force=np.concatenate([np.zeros_like(by_force), by_force]),
        D_force=static_force - seen @ (by_force / squared[:, None]),
    )


def _damping(given: ArrayLike, count: int, asked: int) -> Floats:
    found = read("damping", given, "a ratio, or a ratio of each mode")
    if found.shape == (asked,):
        found = found[:count]  # fewer modes have mass
    if found.shape not in ((), (count,)) or not (np.isfinite(found) & (found >= 0.0)).all():
        raise InputError(
            f"damping is {found.tolist()}, it must be a ratio or {count} ratios, 0 or more"
        )
    return np.array(np.broadcast_to(found, (count,)))


def _lengths(robot: Robot, found: Oscillation) -> tuple[Floats, Floats]:
    """Lengths of the tendons (T,) in m, and their derivatives by the modal coordinates (T, K)."""
    step = 1e-30  # of the complex argument, which gives the derivative without cancellation
    turn = np.zeros((*found.rotation.shape, 3))
    x, y, z = np.moveaxis(found.rotation, -1, 0)
    turn[..., 0, 1], turn[..., 0, 2], turn[..., 1, 2] = -z, y, -x
    turn -= turn.swapaxes(-1, -2)
    position: Any = found.position + 1j * step * found.displacement
    rotation: Any = found.orientation + 1j * step * (found.orientation @ turn)
    lengths, stretched = [], []
    for points in robot.tendon_points(position, rotation):
        spans = np.diff(points, axis=-2)
        whole = np.sqrt((spans**2).sum(axis=-1)).sum(axis=-1)
        lengths.append(float(whole[0].real))
        stretched.append(whole.imag / step)
    return np.array(lengths), np.array(stretched)
