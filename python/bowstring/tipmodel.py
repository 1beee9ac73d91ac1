"""The measured point by a model: from commands and parameters, with its derivatives.

Two models: the rod's statics, and constant curvature with a gain on each segment's bend. Inside
everything is SI; K is the number of rows, T that of tendons, P that of parameters.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring import arc, drive
from bowstring.errors import BowstringError, InputError
from bowstring.robot import Robot
from bowstring.unknowns import DRIVE, Setting, Unknown, Unknowns

__all__ = ["Commands", "Model", "Prediction", "TipModel", "paths_of", "rotation"]

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Model = Literal["rod", "arc"]

_NO_LOAD: Final = (0.0, 0.0, 0.0)
#: Share of a natural step of a parameter for differences; more where friction jumps.
_SMALL: Final = 1e-3
_SMALL_FRICTION: Final = 0.1


@dataclass(frozen=True)
class Commands:
    """What drives the robot, row by row in the order in which it was done.

    Attributes
    ----------
    pulled : ndarray of bool (K, T)
        Whether a tendon has a pull, otherwise a tension.
    values : ndarray (K, T)
        In m and N.
    time : ndarray (K,) or None
        In s.
    recording : ndarray of int (K,) or None
        Rows with the same number are one path, which begins at home; None: all rows are.
    """

    pulled: Bools
    values: Floats
    time: Floats | None
    recording: NDArray[np.int64] | None = None

    def __len__(self) -> int:
        return len(self.values)

    def effective(self, setting: Setting) -> Floats:
        """Pulls and tensions (K, T) after delay, backlash, gain and offset."""
        values = self.values
        if setting.delay:
            time, late = self.clock(), np.empty_like(values)
            for rows in self.paths:
                late[rows] = _delayed(values[rows], time[rows], setting.delay)
            values = late
        if setting.backlash.any():
            followed = np.empty_like(values)
            for rows in self.paths:
                followed[rows] = _play(values[rows], setting.backlash)
            values = np.where(self.pulled, followed, values)
        out: Floats = values * setting.gain + np.where(self.pulled, setting.offset, 0.0)
        return out

    @property
    def paths(self) -> list[NDArray[np.int64]]:
        """Rows of each path, in their order."""
        return paths_of(self.recording, len(self))

    def clock(self) -> Floats:
        """Times (K,) that a delay can be taken from."""
        time = self.time
        if time is None:
            raise InputError("delay needs the time of each row, and the measurements have none")
        if not all((np.diff(time[rows]) > 0).all() for rows in self.paths):
            raise InputError("delay needs times that increase from row to row")
        return time


def paths_of(recording: NDArray[np.int64] | None, count: int) -> list[NDArray[np.int64]]:
    """Rows of each recording in their order; of all rows where None is given."""
    if recording is None:
        return [np.arange(count)]
    return [np.flatnonzero(recording == number) for number in np.unique(recording)]


def _delayed(values: Floats, time: Floats, delay: float) -> Floats:
    """Commands some time before (or after) each row, straight between rows."""
    asked = time - delay
    return np.stack([np.interp(asked, time, column) for column in values.T], axis=1)


def _play(values: Floats, width: Floats) -> Floats:
    """What follows each column with a play of its half-width: it moves only when it is pushed."""
    out = np.empty_like(values)
    state = values[0]
    for k, row in enumerate(values):
        state = np.minimum(np.maximum(state, row - width), row + width)
        out[k] = state
    return out


def rotation(turn: Floats) -> Floats:
    """Rotation (3, 3) of a rotation vector."""
    from scipy.spatial.transform import Rotation

    return np.array(Rotation.from_rotvec(turn).as_matrix())


@dataclass(frozen=True)
class Prediction:
    """The end disk by a model, in the robot's base frame.

    Attributes
    ----------
    position, rotation : ndarray (K, 3), (K, 3, 3)
        NaN where the model has no answer.
    solved : ndarray of bool (K,)
    solutions : list or None
        Of the core, where derivatives are wanted.
    """

    position: Floats
    rotation: Floats
    solved: Bools
    setting: Setting
    commands: Floats
    solutions: list[Any] | None = None

    @property
    def point(self) -> Floats:
        """The measured point (K, 3) in the measuring frame."""
        local = self.position + self.rotation @ self.setting.tool
        moved: Floats = local @ rotation(self.setting.turn).T + self.setting.position
        return moved


class TipModel:
    """The measured point as a function of the parameters.

    Parameters
    ----------
    unknowns : Unknowns
    commands : Commands
    model : {"rod", "arc"}
    theory : str
        Of the rod.
    """

    def __init__(
        self, unknowns: Unknowns, commands: Commands, model: Model, theory: str = "cosserat"
    ) -> None:
        self.unknowns = unknowns
        self.commands = commands
        self.model = model
        self.theory = theory
        self.solves = 0

    def predict(self, values: Floats, *, keep: bool = False) -> Prediction:
        """The end disk by these values (P,) of the parameters.

        Raises
        ------
        InputError
            If no robot can have them.
        """
        setting = self.unknowns.setting(values)
        given = self.commands.effective(setting)
        self.solves += 1
        if self.model == "arc":
            return self._arcs(setting, given)
        return self._rod(setting, given, keep)

    def jacobian(self, values: Floats, at: Prediction) -> Floats:
        """Derivatives (K, 3, P) of the measured point.

        Exact for what acts on pulls and tensions, for E, base and tool, unless tendons rub; central
        differences for the rest.
        """
        exact = None
        if at.solutions is not None and not at.setting.robot.has_friction:
            exact = _Exact.of(at)
        columns = [self._column(i, values, at, exact) for i in range(len(values))]
        return np.stack(columns, axis=-1) if columns else np.zeros((len(self.commands), 3, 0))

    # -- the models --------------------------------------------------------------------------

    def _rod(self, setting: Setting, given: Floats, keep: bool) -> Prediction:
        robot = setting.robot
        pulled = self.commands.pulled
        given = np.where(pulled, given, np.maximum(given, 0.0))
        way = drive.Path(robot, self.theory, "straight", True, 1)
        if robot.has_friction:
            return self._paths(way, setting, given)
        if not keep:
            found = way.core.follow(pulled, given, None, _NO_LOAD, _NO_LOAD, False, False, 0)
            solved = found["converged"]
            return Prediction(found["tip_position"], found["tip_rotation"], solved, setting, given)
        solutions = []
        for held, row in zip(pulled, given, strict=True):
            way.core.reset()
            solutions.append(way.core.step(held, row, None, _NO_LOAD, _NO_LOAD))
        solved = np.array([s.converged for s in solutions])
        position = np.full((len(given), 3), np.nan)
        turned = np.full((len(given), 3, 3), np.nan)
        for k in np.flatnonzero(solved):
            position[k] = solutions[k].tip_position
            turned[k] = solutions[k].tip_rotation
        return Prediction(position, turned, solved, setting, given, solutions)

    def _paths(self, way: drive.Path, setting: Setting, given: Floats) -> Prediction:
        """The rod along each path, with friction; a path begins at home."""
        position = np.full((len(given), 3), np.nan)
        turned = np.full((len(given), 3, 3), np.nan)
        solved = np.zeros(len(given), bool)
        for rows in self.commands.paths:
            way.core.reset()
            loads = self.commands.pulled[rows], given[rows], None, _NO_LOAD, _NO_LOAD
            found = way.core.follow(*loads, False, True, 1)
            position[rows], turned[rows] = found["tip_position"], found["tip_rotation"]
            solved[rows] = found["converged"]
        return Prediction(position, turned, solved, setting, given)

    def _arcs(self, setting: Setting, given: Floats) -> Prediction:
        """Constant curvature: the tendons' arcs, segment by segment, each bend times its gain."""
        kappa, phi, length = _arcs_of(setting.robot, self.commands.pulled, given)
        position, turned = np.zeros((len(given), 3)), np.eye(3)
        bends = kappa * setting.bend_gain
        for j in range(len(length)):
            piece = arc.pose(bends[:, j], phi[:, j], np.full(len(given), length[j]))
            position = position + np.einsum("...ij,...j->...i", turned, piece.position)
            turned = turned @ piece.rotation
        return Prediction(position, np.array(turned), np.ones(len(given), bool), setting, given)

    # -- derivatives -------------------------------------------------------------------------

    def _column(self, i: int, values: Floats, at: Prediction, exact: _Exact | None) -> Floats:
        item = self.unknowns.items[i]
        name = item.name
        if name.startswith(("base.", "tool.")):
            return self._difference(i, values, lambda setting: _placed(at, setting))
        if exact is not None:
            if not item.paths and not name.startswith(("hole_angle", "pitch_radius", "bend_gain")):
                commands = self._difference(i, values, self.commands.effective)
                return exact.by_command(commands)
            if item.leaf in DRIVE:
                return self._by_drive(i, values, at, exact)
            if item.leaf == "E" and self._same_nu(item):
                by_home = -self._difference(i, values, self._home)
                whole: Floats = exact.by_command(np.broadcast_to(by_home, at.commands.shape))
                for path in item.paths:
                    j = int(path.split(".")[1])
                    whole = whole + exact.by_stiffness(j) / values[i]
                return whole

        def solved(setting: Setting) -> Floats:
            given = self.commands.effective(setting)
            self.solves += 1
            found = (
                self._arcs(setting, given)
                if self.model == "arc"
                else (self._rod(setting, given, keep=False))
            )
            return found.point

        small = _SMALL_FRICTION if at.setting.robot.has_friction else _SMALL
        return self._difference(i, values, solved, small)

    def _by_drive(self, i: int, values: Floats, at: Prediction, exact: _Exact) -> Floats:
        """What gives way more is pulled less, tension by tension; so is what is longer at home."""
        by_home = self._difference(i, values, self._home)
        by_compliance = self._difference(
            i, values, lambda setting: drive.compliances(setting.robot)
        )
        shorter = np.where(self.commands.pulled, by_home + exact.tensions * by_compliance, 0.0)
        return exact.by_command(-shorter)

    def _home(self, setting: Setting) -> Floats:
        home = drive.home_lengths(setting.robot, self.theory, "straight", True, 1)
        if home is None:
            return np.full(len(setting.robot.tendons.segment), np.nan)
        return home

    def _same_nu(self, item: Unknown) -> bool:
        segments = self.unknowns.robot.segments
        return all(segments[int(p.split(".")[1])].backbone.nu is not None for p in item.paths)

    def _difference(self, i: int, values: Floats, of: Any, small: float = _SMALL) -> Floats:
        """Central difference, one-sided at a limit, of a function of the setting."""
        item = self.unknowns.items[i]
        found, at = [], []
        for sign in (1.0, -1.0):
            moved = values.copy()
            moved[i] = np.clip(values[i] + sign * small * item.step, item.low, item.high)
            try:
                found.append(of(self.unknowns.setting(moved)))
            except BowstringError:  # the one side has no robot
                moved = values
                found.append(of(self.unknowns.setting(moved)))
            at.append(moved[i])
        return np.asarray((found[0] - found[1]) / (at[0] - at[1]))


def _placed(at: Prediction, setting: Setting) -> Floats:
    moved = Prediction(at.position, at.rotation, at.solved, setting, at.commands)
    return moved.point


@dataclass(frozen=True)
class _Exact:
    """Derivatives of the measured point by commands and stiffness, of all rows.

    Attributes
    ----------
    tip : ndarray (K, 3, T)
        By the command of each tendon, its pull or its tension.
    stiff : ndarray (K, 3, S)
        By the relative change of the stiffness of each segment, commands held.
    tensions : ndarray (K, T)
    """

    tip: Floats
    stiff: Floats
    tensions: Floats

    @classmethod
    def of(cls, at: Prediction) -> _Exact | None:
        """None where the pulls do not determine the tensions."""
        assert at.solutions is not None
        if not at.solved.all():
            return None
        each = [s.jacobians() for s in at.solutions]
        if any(found is None for found in each):
            return None

        def stacked(name: str) -> Floats:
            return np.stack([found[name] for found in each])

        tensions = np.stack([s.tensions for s in at.solutions])
        pulled = np.stack([s.pulled for s in at.solutions])
        held = pulled & (tensions > 0)
        # pull = home - length + compliance x tension, for the tendons that hold their pull
        answer = np.diag(drive.compliances(at.setting.robot)) - stacked("lengths_by_tension")
        both = held[:, :, None] & held[:, None, :]
        size = np.abs(np.einsum("kii->ki", answer)).max()
        block = np.where(both, answer, 0.0) + size * np.eye(held.shape[1]) * ~held[:, :, None]
        if not np.isfinite(block).all() or np.linalg.cond(block).max() > 1e10:
            return None
        inverse = np.where(both, np.linalg.inv(block), 0.0)
        free = np.where(~pulled[:, None, :] & held[:, :, None], answer, 0.0)
        by_command = inverse - inverse @ free + np.eye(held.shape[1]) * ~pulled[:, :, None]
        spin = rotation(at.setting.turn)
        arm = at.rotation @ at.setting.tool

        def point(name: str) -> Floats:
            turned = np.cross(stacked(f"tip_rotation_by_{name}"), arm[:, :, None], axis=1)
            return np.asarray(spin @ (stacked(f"tip_position_by_{name}") + turned))

        by_tension = point("tension")
        longer = stacked("lengths_by_stiffness")
        return cls(
            tip=by_tension @ by_command,
            stiff=point("stiffness") + by_tension @ inverse @ longer,
            tensions=tensions,
        )

    def by_command(self, change: Floats) -> Floats:
        """(K, 3) by changes (K, T) of the commands."""
        moved: Floats = np.einsum("kit,kt->ki", self.tip, change)
        return moved

    def by_stiffness(self, segment: int) -> Floats:
        return self.stiff[:, :, segment]


def _arcs_of(robot: Robot, pulled: Bools, given: Floats) -> tuple[Floats, Floats, Floats]:
    """Curvature and direction (K, S) of each segment's arc, and the lengths (S,) that they keep."""
    lengths = np.array([segment.length for segment in robot.segments])
    if not pulled.any():
        by_force = arc.robot_from_tensions(robot, given)
        return by_force.kappa, by_force.phi, lengths
    if not pulled.all():
        raise InputError(
            "constant curvature needs all tendons by pull or all by tension, these rows mix both"
        )
    tendons = robot.tendons
    rest = robot.disks.station_m[tendons.end_disk] - given
    kappa, phi = np.zeros((2, len(given), len(lengths)))
    for j, length in enumerate(lengths):
        own = np.flatnonzero(tendons.segment == j)
        further = np.flatnonzero(tendons.segment > j)
        angle, radius = tendons.angle_rad, tendons.pitch_radius_m
        found = arc.from_lengths(rest[:, own], angle[own], radius[own], length)
        kappa[:, j], phi[:, j] = found.kappa, found.phi
        if further.size:
            holes = angle[further], radius[further]
            rest[:, further] -= arc.lengths(found.kappa, found.phi, length, *holes)
    return kappa, phi, lengths
