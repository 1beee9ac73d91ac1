"""Commands of constant curvature for wanted arcs, and where they lead by physics."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring._core import RodModel
from bowstring.aliases import Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.constant_curvature.arc import Arc
from bowstring.constant_curvature.series import series_jacobian
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import significant
from bowstring.inverse.arcs import arcs_to, tensions_of
from bowstring.inverse.limits import default_max_tension
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot, without_laws
from bowstring.statics.design_sweeps import sweep_designs
from bowstring.statics.load import Load
from bowstring.statics.load_tables import with_arrays
from bowstring.statics.rod import solve, solve_batch
from bowstring.validation import instance, read
from bowstring.validity.loading import whole_share

COMMANDS: Final = {
    "tensions": "tensions by the linear law",
    "tensions_arm": "tensions by the mean lever arm",
    "tensions_calibrated": "tensions, E I calibrated",
    "displacements": "displacements",
    "displacements_chord": "displacements along chords",
    "physics": "tensions by physics",
}
"""Labels of the commands; all but the last are those of constant curvature."""
_TRIED: Final = 64  # poses of which one must have an equilibrium
BY_ARCS: Final = tuple(name for name in COMMANDS if name != "physics")

_ARM_ROUNDS: Final = 8
_RAMP: Final = (1.0 / 3.0, 2.0 / 3.0, 1.0)  # shares of displacements on the way from the home pose
SCALES: Final = (0.1, 10.0)
"""Limits of the factor on the calibrated bending stiffness."""
_FITTED: Final = 1e-6  # tolerance of the logarithm of the factor
_AT_LIMIT: Final = 1e-4  # distance of the logarithm of the factor from a limit
_SINGULAR: Final = 0.02  # singular value over the largest below which a direction is not corrected
_LARGEST: Final = 0.5  # correction of a bend, rad


@dataclass
class Commander:
    """Turns wanted tips into commands by constant curvature, and solves where they lead."""

    robot: Robot
    """Robot without friction."""
    load: Load
    """Dead loads."""
    model: RodModel
    """Model of the physics."""
    least: Floats
    """Least tensions (T,), N."""
    most: Floats
    """Largest tensions (T,), N."""
    scale: float = field(default=1.0, init=False)
    """Factor on the bending stiffness of ``tensions_calibrated``."""

    @cached_property
    def _at_rest(self) -> RobotArcs:
        return RobotArcs.from_tensions(self.robot, np.zeros(len(self.least)))

    def bends_to(self, tips: Floats) -> Floats:
        """Bends (P, S, 2) in rad of the arcs whose tips are nearest to tips (P, 3)."""
        arcs = arcs_to(self.robot, tips, None)
        return np.asarray(arcs.arc.bend[..., :2])

    def command(self, name: str, bends: Floats) -> Floats:
        """Tensions in N or displacements in m (P, T) for bends (P, S, 2)."""
        if name.startswith("displacements"):
            return self._displacements(bends, "chord" if name.endswith("chord") else None)
        if name == "tensions_arm":
            return self._by_arm(bends)
        scale = self.scale if name == "tensions_calibrated" else 1.0
        limits = self.least / scale, self.most / scale
        return scale * tensions_of(self.robot, self._arcs(bends), *limits)

    def land(self, name: str, commands: Floats) -> Floats:
        """Tips (P, 3) in m by physics under commands (P, T); NaN without a stable equilibrium."""
        if not name.startswith("displacements"):
            tensions = np.nan_to_num(commands)
            found = solve_batch(self.robot, tensions, load=self.load, model=self.model, disks=False)
            tips = np.where(found.converged[:, None], found.tip_position, np.nan)
        else:
            each = {"segments.0.length": np.full(len(commands), self.robot.segments[0].length)}
            path = np.nan_to_num(commands)[:, None, :] * np.array(_RAMP)[:, None]
            ways = sweep_designs(
                Designs(self.robot, each), displacements=path, load=self.load, model=self.model
            )
            tips = np.where(ways.converged[:, -1:], ways.tip_position[:, -1], np.nan)
            # an unstable equilibrium on the way does not mean that there is none at its end
            for k in np.flatnonzero(~ways.converged[:, -1] & np.isfinite(commands).all(axis=-1)):
                end = solve(
                    self.robot, load=self.load.replace(displacements=commands[k]), model=self.model
                )
                if end.converged and end.tip is not None:
                    tips[k] = end.tip.position
        tips[~np.isfinite(commands).all(axis=-1)] = np.nan
        return np.asarray(tips)

    def corrected(self, bends: Floats, missing: Floats) -> Floats:
        """Bends after a correction of tips by vectors (P, 3) in m, by constant curvature."""
        lengths = [segment.length for segment in self.robot.segments]
        arcs = np.concatenate(
            [bends, np.broadcast_to(lengths, bends.shape[:2])[..., None]], axis=-1
        )
        _, jacobian = series_jacobian(arcs, np.ones(bends.shape[:2]))
        columns = np.ravel(3 * np.arange(bends.shape[1])[:, None] + np.arange(2))
        known = np.asarray(np.isfinite(missing).all(axis=-1))
        step = np.linalg.pinv(jacobian[:, :3, columns], rcond=_SINGULAR)
        step = (step @ np.where(known[:, None], missing, 0.0)[..., None])[..., 0]
        largest = np.abs(step).max(axis=-1, keepdims=True)
        step *= np.minimum(1.0, _LARGEST / np.maximum(largest, _LARGEST))
        return np.asarray(bends + step.reshape(bends.shape))

    def calibrate(self, bends: Floats, wanted: Floats) -> None:
        """Choose the factor on the bending stiffness with the least mean squared distance."""
        from scipy.optimize import minimize_scalar

        free = tensions_of(
            self.robot, self._arcs(bends), self.least, np.full_like(self.most, np.inf)
        )

        def mean(log_scale: float) -> float:
            scaled = np.clip(np.exp(log_scale) * free, self.least, self.most)
            squared = np.sum((self.land("tensions", scaled) - wanted) ** 2, axis=-1)
            # a command without an equilibrium is no better than a robot that does not bend
            return float(np.where(np.isfinite(squared), squared, self.robot.length**2).mean())

        limits = np.log(SCALES)
        if mean(limits[0]) == mean(limits[1]) == mean(0.0):
            self.scale = 1.0  # no tensions, so that none can be fitted
            return
        found = minimize_scalar(mean, bounds=limits, method="bounded", options={"xatol": _FITTED}).x
        nearest = int(np.abs(limits - found).argmin())
        at_limit = abs(limits[nearest] - found) < _AT_LIMIT
        self.scale = SCALES[nearest] if at_limit else float(np.exp(found))

    def refusal(self, name: str) -> str | None:
        """Say why the robot does not take a command, or None."""
        straight = np.zeros((1, len(self.robot.segments), 2))
        try:
            self.land(name, self.command(name, straight))
        except InputError as error:
            return str(error).removeprefix("row 1: ")
        return None

    def _arcs(self, bends: Floats, correction: str | None = None) -> RobotArcs:
        lengths = np.array([segment.length for segment in self.robot.segments])
        kappa = np.linalg.norm(bends, axis=-1) / lengths
        arc = Arc(
            kappa,
            np.arctan2(bends[..., 1], bends[..., 0]),
            np.broadcast_to(lengths, kappa.shape),
        )
        return RobotArcs(self.robot, arc, correction)  # type: ignore[arg-type]

    def _displacements(self, bends: Floats, correction: str | None) -> Floats:
        rest = RobotArcs(self.robot, self._at_rest.arc, correction)  # type: ignore[arg-type]
        return np.asarray(rest.lengths() - self._arcs(bends, correction).lengths())

    def _by_arm(self, bends: Floats) -> Floats:
        """Tensions whose arcs by the law with the mean lever arm are those wanted."""
        asked, lost = bends, np.zeros(len(bends), dtype=bool)
        for _ in range(_ARM_ROUNDS):
            tensions = tensions_of(self.robot, self._arcs(asked), self.least, self.most)
            away = bends - self._bends_by_arm(tensions)
            lost |= ~np.isfinite(away).all(axis=(1, 2))
            asked = np.where(lost[:, None, None], bends, asked + away)
        tensions[lost] = np.nan
        return tensions

    def _bends_by_arm(self, tensions: Floats) -> Floats:
        """Bends (P, S, 2) by the law with the mean lever arm; NaN where it has no equilibrium."""
        tensions = np.nan_to_num(tensions)
        try:
            return np.asarray(RobotArcs.from_tensions(self.robot, tensions, "arm").arc.bend)[
                ..., :2
            ]
        except NoSolutionError:
            if len(tensions) == 1:
                return np.full((1, len(self.robot.segments), 2), np.nan)
        half = len(tensions) // 2
        return np.concatenate([self._bends_by_arm(t) for t in (tensions[:half], tensions[half:])])


def largest_tensions(robot: Robot, given: ArrayLike | None) -> Floats:
    """Largest tensions (T,) in N, given or those of a quarter turn by the linear law.

    Parameters
    ----------
    robot : Robot
    given : array_like () or (T,), or None

    Returns
    -------
    ndarray (T,)
        In N.
    """
    count = robot.core.tendon_count
    if given is None:
        return 0.5 * default_max_tension(robot)
    found = read("max_tension", given, f"a number or {count} numbers, in N")
    if found.shape not in ((), (count,)) or not (np.isfinite(found) & (found > 0.0)).all():
        raise InputError(
            f"max_tension is {found.tolist()}, it must be a number or {count} numbers above 0 N"
        )
    return np.array(np.broadcast_to(found, (count,)))


def prepared(
    robot: Robot, load: Load | None, model: RodModel | None, max_tension: ArrayLike | None
) -> tuple[Robot, Load, RodModel, Floats]:
    """Check robot, load, model and largest tensions of the poses to be drawn.

    Parameters
    ----------
    robot : Robot
    load : Load, optional
        Dead loads, without actuation and motion of the base.
    model : RodModel, optional
    max_tension : array_like () or (T,), optional
        Largest tensions in N, as of `largest_tensions`.

    Returns
    -------
    Robot
        Without friction.
    Load
        With arrays.
    RodModel
        The given or the default one.
    ndarray (T,)
        Largest tensions in N.

    Raises
    ------
    InputError
        If an argument is wrong, or the tensions are too large: the pose without tension has an
        equilibrium, and none of a few others.
    """
    load, model = instance("load", load, Load), instance("model", model, RodModel)
    if load.is_actuated:
        raise InputError("load has an actuation, and tensions are drawn; leave it out")
    load = with_arrays(load)
    robot = without_laws(robot)
    most = largest_tensions(robot, max_tension)
    solve(robot, np.zeros(len(most)), load=load, model=model)  # refuses loads that do not fit
    # a pose without equilibrium takes as long as several with one, so that a few are tried first
    tensions = drawn_tensions(robot, most, sobol_points(len(most), _TRIED))
    found = solve_batch(robot, tensions, load=load, model=model, disks=False).converged
    if found[0] and not found[1:].any():
        half_turn = float(default_max_tension(robot).max())
        raise InputError(
            f"none of {_TRIED - 1} poses with tensions up to {most.max():g} N has a stable "
            f"equilibrium; by the linear law {significant(half_turn)} N bends a segment of "
            f"{robot.name} by half a turn: give a smaller largest tension",
            argument="max_tension",
        )
    return robot, load, model, most


def sobol_points(tendons: int, count: int) -> Floats:
    """First points (count, T) of a Sobol' sequence in the unit cube; the first one is zero."""
    from scipy.stats import qmc

    points = qmc.Sobol(tendons, scramble=False).random_base2(max(1, (count - 1).bit_length()))
    return np.asarray(points[:count])


def drawn_tensions(robot: Robot, most: Floats, points: Floats) -> Floats:
    """Tensions (n, T) up to `most` (T,) at points (n, T) of the unit cube, N; zero at zero.

    Tendons pull, chambers push, and rods pull in the first half of the cube and push in the second.
    """
    whole = np.array(whole_share(robot))
    both = np.where(points <= 0.5, 2.0 * points, 1.0 - 2.0 * points)
    shares = np.where(robot.tendons.pushes & (whole > 0.0), both, whole * points)
    return np.asarray(most * shares)


def no_pose(robot: Robot, poses: int) -> NoSolutionError:
    """Error where no drawn pose has an equilibrium."""
    return NoSolutionError(
        f"{robot.name}: none of {poses} drawn poses has a stable equilibrium, and the first "
        "is without tension; give smaller dead loads",
        status="no_equilibrium",
    )
