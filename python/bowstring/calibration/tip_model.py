"""Models of the measured points as a function of commands and parameters, with derivatives.

There are two models: statics of the rod, and constant curvature with a gain on the bend of each
segment. A measured point has an offset in the frame of its disk. All values are in SI; K is the
number of rows, M that of measured points in a row, T that of tendons, P that of parameters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring import threads
from bowstring._core import Linearised, PathStates
from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration.parameters import TENDON_PROPERTIES, Setting, Unknown, Unknowns
from bowstring.calibration.pieces import Pieces
from bowstring.constant_curvature import Arc, RobotArcs
from bowstring.errors import BowstringError, InputError
from bowstring.robot.model import Robot
from bowstring.statics import actuation
from bowstring.statics.load import Load
from bowstring.statics.load_tables import with_arrays
from bowstring.statics.model import RodModel

_NO_LOAD: Final = Load()  # only the robot's gravity
_WEIGHTLESS: Final = Load(gravity=(0.0, 0.0, 0.0))
#: Step of central differences over natural step of a parameter.
_SMALL: Final = 1e-3
#: Step of the one-sided differences of perturbed paths over it.
_PERTURBATION: Final = 1e-4
#: Time at rest before a path, s.
_AT_REST: Final = 1e15
#: Parameters of frames and offsets, which move the points and not the robot.
_FRAMES: Final = ("base.", "tool.", "marker.")
#: Moment on a disk for a derivative, over bending stiffness and length.
_PROBE: Final = 1e-4
#: Number of neighbours from which the solution of a failed row is continued.
_NEIGHBOURS: Final = 2


@dataclass(frozen=True)
class Commands:
    """Commands of the robot in rows, in the order of measurement.

    Attributes
    ----------
    by_displacement : ndarray of bool (K, T)
        Whether a tendon has a displacement, otherwise a tension.
    values : ndarray (K, T)
        Displacements in m and tensions in N.
    time : ndarray (K,) or None
        Time in s, NaN in rows without one.
    recording : ndarray of int (K,) or None
        Rows with the same number form one path, which begins in the home pose; None: all rows do.
    """

    by_displacement: Bools
    values: Floats
    time: Floats | None
    recording: Ints | None = None

    def __len__(self) -> int:
        return len(self.values)

    def effective(self, setting: Setting) -> Floats:
        """Displacements and tensions (K, T) after delay, backlash, gain and offset.

        Tensions below zero, as of noise and of a load cell with another zero, are zero where a
        tendon cannot push.
        """
        values = self.late(setting.delay)
        if setting.backlash.any():
            followed = np.empty_like(values)
            for number, rows in enumerate(self.paths):
                before = setting.initial.get(number, np.zeros((2, 1)))[0]
                first = values[rows[0]] + np.nan_to_num(before)
                followed[rows] = _play(values[rows], setting.backlash, first)
            values = np.where(self.by_displacement, followed, values)
        moved = np.where(self.by_displacement, values * setting.gain + setting.offset, 0.0)
        actuation.check_coupled(setting.robot, self.by_displacement)
        moved = actuation.driven(setting.robot, moved)
        tensions = values * setting.tension_gain
        if self.are_tensions:
            tensions = tensions + setting.tension_offset
        tensions = np.maximum(tensions, setting.robot.tendons.least_tension_N)
        out: Floats = np.where(self.by_displacement, moved, tensions)
        return out

    def late(self, delay: Floats) -> Floats:
        """Values (K, T) after the delays (T,) of the drives, s, along each path.

        Without times the rows are at rest, and a delay has no effect.
        """
        if self.time is None or not delay.any():
            return self.values
        time, out = self.clock(), np.empty_like(self.values)
        for k in self.paths:
            out[k] = actuation.delayed(self.by_displacement[k], self.values[k], time[k], delay)
        return out

    def is_same(self, other: Commands) -> bool:
        """Whether these are the same rows, at the same times and in the same recordings."""
        mine, others = (
            (each.by_displacement, each.values, each.time, each.recording) for each in (self, other)
        )
        return all(map(_same, mine, others))

    @property
    def are_tensions(self) -> bool:
        """Whether all commands are tensions."""
        return not self.by_displacement.any()

    @property
    def are_displacements(self) -> bool:
        """Whether drives are commanded by displacement alone, beside tendons without tension."""
        return bool(self.by_displacement.any() and not self.values[~self.by_displacement].any())

    @property
    def paths(self) -> list[Ints]:
        """Rows of each path, in order."""
        return paths_of(self.recording, len(self))

    def clock(self, what: str = "delay") -> Floats:
        """Check and return times (K,), which `what` needs."""
        time = self.time
        if time is None:
            raise InputError(f"{what} needs the time of each row, and the measurements have none")
        if not np.isfinite(time).all():
            row = int(np.flatnonzero(~np.isfinite(time))[0]) + 1
            raise InputError(f"{what} needs the time of each row, and row {row} has none")
        if not all((np.diff(time[rows]) > 0).all() for rows in self.paths):
            raise InputError(f"{what} needs times that increase from row to row")
        return time

    def durations(self, rows: Ints) -> Floats:
        """Times (n,) from row to row of a path in s, for relaxation and creep; 0 at its start."""
        time = self.clock("relaxation or creep")[rows]
        return np.diff(time, prepend=time[0])


def _same(one: NDArray[Any] | None, other: NDArray[Any] | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one, other, equal_nan=True)


def paths_of(recording: Ints | None, count: int) -> list[Ints]:
    """Rows of each recording in order; None means a single one."""
    if recording is None:
        return [np.arange(count)]
    return [np.flatnonzero(recording == number) for number in np.unique(recording)]


def _play(values: Floats, width: Floats, state: Floats) -> Floats:
    """Play (backlash) operator on each column with its half-width, from a state."""
    out = np.empty_like(values)
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
    """Poses of the disks of the measured points by a model, in the robot's base frame.

    Attributes
    ----------
    position, rotation : ndarray (K, M, 3), (K, M, 3, 3)
        Position (m) and rotation, NaN where the model has no solution.
    solved : ndarray of bool (K,)
        Rows in which the model has a solution.
    setting : Setting
        Parameter values of the prediction.
    solutions : Solutions or None
        Solutions of the core, kept for derivatives.
    tensions, slack : ndarray (K, T) or None
        Tensions (N) and slack lengths (m) by statics.
    disks : tuple of int
        Disks of the measured points, from 0; empty for the end disk alone.
    states : tuple of PathStates
        States along the paths of a robot with a memory, if kept: initial guesses for the next
        prediction.
    moved : dict of Moved
        Predictions with another value of a parameter, by its number; computed on demand, and shared
        with predictions that differ in the frames.
    columns : list
        Derivatives by each parameter, computed on demand.
    """

    position: Floats
    rotation: Floats
    solved: Bools
    setting: Setting
    solutions: Solutions | None = None
    tensions: Floats | None = None
    slack: Floats | None = None
    disks: tuple[int, ...] = ()
    states: tuple[PathStates, ...] = ()
    moved: dict[int, Moved] = field(default_factory=dict, repr=False)
    columns: list[_Column] = field(default_factory=list, repr=False, init=False)

    @cached_property
    def exact(self) -> _Exact | None:
        """Exact derivatives; None without solutions or with undetermined tensions."""
        return None if self.solutions is None else _Exact.of(self.solutions, self)

    @property
    def arms(self) -> Floats:
        """Offsets (K, M, 3) of the measured points from their disks, in the base frame, m."""
        offsets = self.setting.offsets(self.position.shape[1])
        return np.stack([self.rotation[:, m] @ each for m, each in enumerate(offsets)], axis=1)

    @property
    def points(self) -> Floats:
        """Measured points (K, M, 3) in the measuring frame, m; the last is the tip."""
        local = (self.position + self.arms).reshape(-1, 3)
        moved: Floats = local @ rotation(self.setting.turn).T + self.setting.position
        return moved.reshape(self.position.shape)

    @property
    def point(self) -> Floats:
        """The last measured point (K, 3), the tip, in the measuring frame, m."""
        return np.asarray(self.points[:, -1])

    @property
    def coordinates(self) -> Floats:
        """Coordinates (K, 3 M) of the measured points in the measuring frame, m."""
        return self.points.reshape(len(self.position), -1)

    def in_frames_of(self, other: Prediction) -> Prediction:
        """Return this prediction with the base and the offsets of another one."""
        return replace(self, setting=self.setting.in_frames_of(other.setting))


class Solutions(list[Any]):
    """Solutions of the core for rows (K,), without a pose where not solved."""

    @cached_property
    def jacobians(self) -> list[Any]:
        """Derivatives of each row, None where the displacements do not determine the tensions."""
        return threads.in_parts(lambda s: s.jacobians(gravity=True) if s.converged else None, self)


@dataclass(frozen=True)
class Moved:
    """Predictions with two values of a parameter.

    Attributes
    ----------
    above, below : Prediction
        With a larger and a smaller value.
    difference : float
        Difference of both values, in SI.
    """

    above: Prediction
    below: Prediction
    difference: float

    def derivative(self, at: Prediction) -> Floats:
        """Derivatives (K, 3 M + 2 T) of coordinates, tensions and slack lengths by the parameter.

        In the frames of a prediction; of coordinates alone for arcs.
        """
        above, below = (_state(each.in_frames_of(at)) for each in (self.above, self.below))
        return np.asarray((above - below) / self.difference)


def _state(at: Prediction) -> Floats:
    found = (at.coordinates, at.tensions, at.slack)
    return np.concatenate([each for each in found if each is not None], axis=1)


class TipModel:
    """Measured points as a function of the parameters.

    Parameters
    ----------
    unknowns : Unknowns
    commands : Commands
    rod : RodModel or None
        Statics, by default with one element; None means constant curvature.
    disks : sequence of int, optional
        Disk of each measured point, from 0; by default one point on the end disk, the tip.
    shared : dict, optional
        First prediction, by its parameters, of all models of these rows that are given the same
        dictionary: fits that begin at the same values.
    """

    def __init__(
        self,
        unknowns: Unknowns,
        commands: Commands,
        rod: RodModel | None,
        disks: Sequence[int] | None = None,
        shared: dict[bytes, Prediction] | None = None,
    ) -> None:
        end = len(unknowns.robot.disks.station_m) - 1
        self.disks = (end,) if disks is None else tuple(disks)
        self._at_end = np.array([disk == end for disk in self.disks])
        self.unknowns = unknowns
        self.commands = commands
        if unknowns.has_delay:
            commands.clock()
        self.rod = None if rod is None else rod.replace(elements=rod.elements or 1)
        self.solves = 0
        self.shared = shared
        self._last: dict[bytes, Prediction] = {}
        self._guesses = tuple(PathStates() for _ in commands.paths)

    def predict(self, values: Floats, *, keep: bool = False) -> Prediction:
        """Predict the poses of the disks for values (P,) of the parameters.

        A prediction that is kept for its derivatives serves until the next one, also where the
        frames change, which do not move the robot. With a memory its states are the initial guesses
        for the next prediction: if there are several equilibria, the result may differ from that of
        a path from home.

        Raises
        ------
        InputError
            If the robot would be invalid.
        """
        setting = self.unknowns.setting(values)
        key = np.where(self.of_frames, 0.0, values).tobytes()
        known = self._last.get(key) or (self.shared or {}).get(key)
        if known is None:
            known = self._predicted(values, setting, keep)
            if keep:
                self._last = {key: known}
        if keep and self.shared is not None and not self.shared:
            self.shared[key] = known
        self._guesses = known.states or self._guesses
        return replace(known, setting=setting)

    def from_home(self, values: Floats) -> Prediction:
        """Predict anew by paths from the home pose, without guesses of earlier predictions."""
        return self._predicted(values, self.unknowns.setting(values), False)

    def _predicted(self, values: Floats, setting: Setting, keep: bool) -> Prediction:
        if self.rod is not None and keep and self._are_cheap(setting):
            return self._along_paths(values, setting)
        self.solves += 1
        given = self.commands.effective(setting)
        if self.rod is None:
            return self._arcs(setting, given)
        return self._rod(self.rod, setting, given, keep)

    def jacobian(self, values: Floats, at: Prediction) -> Floats:
        """Derivatives (K, 3 M, P) of the coordinates of the measured points.

        Exact by parameters of displacements and tensions, by base, tool and markers, and by E and
        gravity where all points are on the end disk, unless the robot has a memory; by the
        others from differences: of perturbed paths where the robot has a memory.
        """
        return np.stack([column.whole for column in self._columns(values, at)], axis=-1)

    @property
    def of_frames(self) -> Bools:
        """Parameters (P,) of the base, the tool or the markers."""
        return np.array([n.startswith(_FRAMES) for n in self.unknowns.names], dtype=bool)

    def frame_jacobian(self, values: Floats, at: Prediction) -> Floats:
        """Derivatives (K, 3 M, P) by base, tool and markers, zero by other parameters."""
        table = np.zeros((len(self.commands), 3 * len(self.disks), len(values)))
        for i in np.flatnonzero(self.of_frames).tolist():
            table[:, :, i] = self._by_frame(i, values, at)
        return table

    def _by_frame(self, i: int, values: Floats, at: Prediction) -> Floats:
        return self._difference(i, values, lambda s: replace(at, setting=s).coordinates)

    def pieces(self, values: Floats, at: Prediction) -> Pieces | None:
        """Piecewise linear model of the measured points, with tendons that become taut or slack.

        None where no tendon is displacement-controlled, where the displacements do not determine
        the tensions, with a memory or clearance in the holes, and for constant curvature. Rows
        without a solution have NaN.
        """
        clearance = at.setting.robot.tendons.hole_clearance_m
        if not self.commands.by_displacement.any() or clearance.any():
            return None
        exact = at.exact
        if exact is None:
            return None
        assert at.slack is not None
        columns = self._columns(values, at)
        by_slack = np.stack([column.slack for column in columns], axis=-1)
        by_tension = np.stack([column.tensions for column in columns], axis=-1)
        by_point = np.stack([column.point for column in columns], axis=-1)
        return Pieces(
            # commanded tensions depend on the parameters for any active set
            point_by_parameter=by_point + exact.by_tension @ by_tension,
            point_by_tension=exact.by_tension,
            slack=at.slack,
            tensions=exact.tensions,
            slack_by_parameter=by_slack + exact.slack_by_tension @ by_tension,
            slack_by_tension=exact.slack_by_tension,
            by_displacement=self.commands.by_displacement,
        )

    def _columns(self, values: Floats, at: Prediction) -> list[_Column]:
        """Derivatives by each parameter, stored in the prediction."""
        if not at.columns:
            memory = self.rod is not None and at.setting.robot.has_memory
            if memory and not at.moved and not self.of_frames.all():
                self._guesses = at.states or self._guesses
                at.moved.update(self._along_paths(values, at.setting).moved)
            at.columns.extend(self._column(i, values, at) for i in range(len(values)))
        return at.columns

    # -- the models --------------------------------------------------------------------------

    def _rod(self, rod: RodModel, setting: Setting, given: Floats, keep: bool) -> Prediction:
        robot = setting.robot
        by_displacement = self.commands.by_displacement
        continuous = robot.is_embedded or rod.tendon_path == "continuous"
        if continuous and not by_displacement.any() and not robot.has_memory:
            return self._by_tensions(rod, setting, given)
        core = actuation.Path(robot, rod, alone=True).core
        if robot.has_memory or not keep:
            at = self._follow(core, setting, given, disks=not self._at_end.all(), keep=keep)
            return self._of_rows(setting, at)

        def from_home(rows: Ints) -> list[Any]:
            own = actuation.Path(robot, rod).core
            found = []
            for held, row in zip(by_displacement[rows], given[rows], strict=True):
                own.reset()
                found.append(own.step(held, row, _NO_LOAD))
            return found

        parts = np.array_split(np.arange(len(given)), threads.free_cores())
        solutions = Solutions(s for part in threads.results(from_home, parts) for s in part)
        solved = np.array([s.converged for s in solutions])
        _continue_from_neighbours(core, by_displacement, given, solutions, solved)
        found = {
            "tip_position": _table(solutions, solved, "tip_position", 3),
            "tip_rotation": _table(solutions, solved, "tip_rotation", 3, 3),
        }
        if not self._at_end.all():
            count = len(robot.disks.station_m)
            found["disk_positions"] = _table(solutions, solved, "disk_positions", count, 3)
            found["disk_rotations"] = _table(solutions, solved, "disk_rotations", count, 3, 3)
        slack = _table(solutions, solved, "slack_lengths", given.shape[1])
        return Prediction(
            *self._poses(found),
            solved,
            setting,
            solutions,
            slack=slack,
            disks=self.disks,
        )

    def _by_tensions(self, rod: RodModel, setting: Setting, given: Floats) -> Prediction:
        """Predict by continuous tendons, which have tensions only and no derivatives."""
        below = not self._at_end.all()
        at = setting.robot.core.solve_batch(given, _NO_LOAD, rod, threads.free_cores(), below)
        return Prediction(
            *self._poses(at),
            at["converged"],
            setting,
            tensions=given,
            slack=np.zeros_like(given),
            disks=self.disks,
        )

    def _poses(self, found: Mapping[str, Floats]) -> tuple[Floats, Floats]:
        """Positions (K, M, 3) and rotations (K, M, 3, 3) of the disks of the measured points."""
        poses = []
        for kind in ("position", "rotation"):
            tip = found[f"tip_{kind}"][:, None]
            if self._at_end.all():
                poses.append(np.repeat(tip, len(self.disks), axis=1))
                continue
            on_disks = found[f"disk_{kind}s"][:, list(self.disks)]
            on_disks[:, self._at_end] = tip
            poses.append(on_disks)
        return poses[0], poses[1]

    def _of_rows(self, setting: Setting, at: Mapping[str, Any]) -> Prediction:
        return Prediction(
            *self._poses(at),
            at["converged"],
            setting,
            tensions=at["tensions"],
            slack=at["slack_lengths"],
            disks=self.disks,
            states=at["states"],
        )

    def _follow(
        self, core: Any, setting: Setting, given: Floats, *, disks: bool, keep: bool
    ) -> dict[str, Any]:
        """Arrays of all rows by effective commands (K, T), with a memory along each path."""
        robot = setting.robot
        paths = self.commands.paths if robot.has_memory else [np.arange(len(given))]
        cores = None if robot.has_memory else threads.free_cores()
        found = []
        for number, rows in enumerate(paths):
            core.reset()
            held, values, late = self._steps(number, rows, setting, given)
            guesses = self._guesses[number] if keep and robot.has_memory else None
            found.append(core.follow(held, values, _NO_LOAD, disks, cores, late, guesses))
        return _joined(found, paths, disks=disks)

    def _steps(
        self, number: int, rows: Ints, setting: Setting, given: Floats
    ) -> tuple[Bools, Floats, Floats | None]:
        """Kinds and values of the commands of a path, from before its first row, and durations."""
        robot = setting.robot
        held, values = self.commands.by_displacement[rows], given[rows]
        late = self.commands.durations(rows) if robot.is_viscoelastic else None
        before = setting.before(number, held[0], values[0]) if robot.has_memory else None
        if before is not None:  # a row before the first one
            held, values = np.vstack((before[0], held)), np.vstack((before[1], values))
            late = None if late is None else np.concatenate(([_AT_REST], late))
        return held, values, late

    def _arcs(self, setting: Setting, given: Floats) -> Prediction:
        """Predict by constant curvature, with the gain on the bend of each segment."""
        robot, by_displacement = setting.robot, self.commands.by_displacement
        if not by_displacement.any():
            arc = RobotArcs.from_tensions(robot, given).arc
        elif by_displacement.all():  # segments keep their lengths
            lengths = robot.disks.station_m[robot.tendons.end_disk] - given
            arc = RobotArcs.from_lengths(robot, lengths, hold_length=True).arc
        else:
            raise InputError(
                "constant curvature needs all tendons by displacement or all by tension, these "
                "rows mix both"
            )
        bent = Arc(arc.kappa * setting.bend_gain, arc.phi, arc.length)
        arcs = RobotArcs(robot, bent)
        found = dict(zip(("tip_position", "tip_rotation"), arcs.tip, strict=True))
        if not self._at_end.all():
            found["disk_positions"] = arcs.disk_positions
            found["disk_rotations"] = arcs.disk_rotations
        return Prediction(*self._poses(found), np.ones(len(given), bool), setting, disks=self.disks)

    # -- derivatives -------------------------------------------------------------------------

    def _column(self, i: int, values: Floats, at: Prediction) -> _Column:
        item, exact = self.unknowns.items[i], at.exact
        name = item.name
        none = np.zeros(self.commands.values.shape)
        if name.startswith(_FRAMES):
            moved = self._by_frame(i, values, at)
            return _Column(moved, moved, none, none)
        still = np.zeros((len(none), 3 * len(self.disks)))
        by_displacement = self.commands.by_displacement
        if exact is not None:
            if not item.paths and not name.startswith(("hole_angle", "pitch_radius", "bend_gain")):
                commands = self._difference(i, values, self.commands.effective)
                shorter = np.where(by_displacement, commands, 0.0)
                return exact.column(still, -shorter, np.where(by_displacement, 0.0, commands))
            by_home = np.where(by_displacement, self._difference(i, values, self._home), 0.0)
            if item.leaf in TENDON_PROPERTIES:
                # what takes displacement reduces the effective one, at constant tensions
                taken = self._difference(i, values, lambda s: exact.taken(s.robot))
                return exact.column(still, by_home + np.where(by_displacement, taken, 0.0), none)
            known = "gravity" if name.startswith("gravity") else "stiffness" * self._scales(item)
            if known in exact.by_file:
                per = 1.0 if known == "gravity" else 1.0 / values[i]
                for path in item.paths:
                    j = int(path.split(".")[1])
                    still = still + per * exact.by_file[known][:, :, j]
                    by_home = by_home - per * exact.lengths_by_file[known][:, :, j]
                return exact.column(still, by_home, none)

        if i not in at.moved:
            (above, high), (below, low) = self._sides(i, values, _SMALL)
            larger, smaller = (self._predicted(values, each, False) for each in (above, below))
            at.moved[i] = Moved(larger, smaller, high - low)
        return self._by_differences(at.moved[i].derivative(at), at)

    def _by_differences(self, change: Floats, at: Prediction) -> _Column:
        """Convert derivatives of all quantities to those at constant tensions."""
        exact = at.exact
        none = np.zeros(self.commands.values.shape)
        size = 3 * len(self.disks)
        if exact is None:
            return _Column(change[:, :size], change[:, :size], none, none)
        by_displacement = self.commands.by_displacement
        change = np.where(at.solved[:, None], change, 0.0)
        whole, (tensions, slack) = change[:, :size], np.split(change[:, size:], 2, axis=1)
        forced = np.where(by_displacement, 0.0, tensions)
        by_tensions = np.einsum("kit,kt->ki", exact.by_tension, tensions)
        slack = slack - np.einsum("kst,kt->ks", exact.slack_by_tension, tensions)
        return _Column(whole, whole - by_tensions, np.where(by_displacement, slack, 0.0), forced)

    def _are_cheap(self, setting: Setting) -> bool:
        """Whether derivatives along paths take less time with a prediction than after it.

        With friction, and in fits that begin near their end, most of them are not needed
        (`bowstring.calibration.search.Residuals`).
        """
        robot, count = setting.robot, int((~self.of_frames).sum())
        needed = robot.has_memory and not robot.has_friction and self.shared is None
        return needed and 0 < count <= 2 * threads.free_cores()

    def _along_paths(self, values: Floats, setting: Setting) -> Prediction:
        """Predict with derivatives by all parameters except those of frames."""
        moved = [self._perturbed(int(i), values) for i in np.flatnonzero(~self.of_frames)]
        cores = threads.free_cores()
        parts = [part for k in range(cores) if (part := moved[k::cores])]
        self.solves += 1 + len(moved)
        each = threads.results(lambda part: self._changes(part, setting), parts)
        at: Prediction = each[0][0]
        return replace(at, moved={i: moved for part in each for i, moved in part[1]})

    def _perturbed(self, i: int, values: Floats) -> tuple[int, Setting, float]:
        """A parameter, the setting with another value of it, and by how much this is larger."""
        side = self._side(i, values, _PERTURBATION)
        if side[1] - values[i] < 0.5 * _PERTURBATION * self.unknowns.items[i].step:  # at a limit
            below = self._side(i, values, -_PERTURBATION)
            side = max(side, below, key=lambda each: abs(each[1] - values[i]))
        return i, side[0], side[1] - values[i]

    def _changes(
        self, moved: list[tuple[int, Setting, float]], setting: Setting
    ) -> tuple[Prediction, list[tuple[int, Moved]]]:
        """Prediction, and those with other values of some parameters."""
        settings = [setting, *(each for _, each, _ in moved)]
        paths = zip(settings, self._follow_perturbed(settings), strict=True)
        at, *others = [self._of_rows(*each) for each in paths]
        pairs, below = zip(moved, others, strict=True), replace(at, states=())
        return at, [(i, Moved(other, below, difference)) for (i, _, difference), other in pairs]

    def _follow_perturbed(self, settings: Sequence[Setting]) -> list[dict[str, Floats]]:
        """Arrays of all rows by each setting, of which the first is the nominal one."""
        assert self.rod is not None
        below = not self._at_end.all()
        cores = [actuation.Path(s.robot, self.rod, alone=True).core for s in settings]
        given = [self.commands.effective(setting) for setting in settings]
        found = []
        for number, rows in enumerate(self.commands.paths):
            steps = [self._steps(number, rows, *each) for each in zip(settings, given, strict=True)]
            held, values, durations = zip(*steps, strict=True)
            perturbed = list(zip(cores[1:], values[1:], strict=True))
            # a perturbed robot may be viscoelastic where the nominal one is not
            late = next((each for each in durations if each is not None), None)
            cores[0].reset()
            follow, guesses = cores[0].follow_perturbed, self._guesses[number]
            found.append(follow(held[0], values[0], _NO_LOAD, below, perturbed, late, guesses))
        paths = self.commands.paths
        return [_joined(each, paths, disks=below) for each in zip(*found, strict=True)]

    def _home(self, setting: Setting) -> Floats:
        """Unstretched lengths (T,) of the tendons at home, less what clearance takes there, m."""
        assert self.rod is not None
        home = actuation.home_lengths(setting.robot, self.rod)
        if home is None:
            return np.full(self.commands.values.shape[1], np.nan)
        tendons = setting.robot.tendons
        if not tendons.hole_clearance_m.any():
            return home
        pose = setting.robot.core.solve(tendons.pretension_N, _WEIGHTLESS, self.rod)
        bends = _bends_of_tendons(setting.robot, pose.disk_rotations[None])[0]
        return np.asarray(home - tendons.hole_clearance_m * bends)

    def _scales(self, item: Unknown) -> bool:
        """Whether a parameter scales all stiffnesses of segments."""
        segments = self.unknowns.robot.segments
        return item.leaf == "E" and all(
            segments[int(p.split(".")[1])].backbone.nu is not None for p in item.paths
        )

    def _difference(self, i: int, values: Floats, of: Any) -> Floats:
        """Central difference of a function of the setting, one-sided at a limit."""
        (above, high), (below, low) = self._sides(i, values, _SMALL)
        return np.asarray((of(above) - of(below)) / (high - low))

    def _sides(self, i: int, values: Floats, small: float) -> list[tuple[Setting, float]]:
        """Settings with a larger and a smaller value of a parameter, and these values."""
        return [self._side(i, values, change) for change in (small, -small)]

    def _side(self, i: int, values: Floats, change: float) -> tuple[Setting, float]:
        """Setting with a parameter changed by a part of its natural step, and its value."""
        item, moved = self.unknowns.items[i], values.copy()
        moved[i] = np.clip(values[i] + change * item.step, item.low, item.high)
        try:
            return self.unknowns.setting(moved), float(moved[i])
        except BowstringError:  # the robot is invalid on this side
            return self.unknowns.setting(values), float(values[i])


def _continue_from_neighbours(
    core: Any, by_displacement: Bools, given: Floats, solutions: list[Any], solved: Bools
) -> None:
    """Solve rows that failed from the home pose by continuation from the nearest commands.

    Changes `solutions` and `solved` in place.
    """
    known = np.flatnonzero(solved)
    for k in np.flatnonzero(~solved):
        alike = known[(by_displacement[known] == by_displacement[k]).all(axis=1)]
        apart = np.linalg.norm(given[alike] - given[k], axis=1)
        for near in alike[np.argsort(apart, kind="stable")[:_NEIGHBOURS]]:
            core.reset()
            if not core.step(by_displacement[near], given[near], _NO_LOAD).converged:
                continue
            found = core.step(by_displacement[k], given[k], _NO_LOAD)
            if found.converged:
                solutions[k], solved[k] = found, True
                break


def _bends(rotations: Floats) -> Floats:
    """Bend (K, N) in rad from the base to each disk, whose rotations are (K, N, 3, 3)."""
    axes = rotations[..., 2]
    base = np.broadcast_to([0.0, 0.0, 1.0], axes[:, :1].shape)
    axes = np.concatenate([base, axes], axis=1)
    # of nearly parallel axes the difference is more accurate than the product
    apart = np.linalg.norm(np.diff(axes, axis=1), axis=-1)
    bends: Floats = np.cumsum(2.0 * np.arcsin(np.minimum(0.5 * apart, 1.0)), axis=1)
    return bends


def _bends_of_tendons(robot: Robot, rotations: Floats) -> Floats:
    """Bend (K, T) in rad from the base to the end disk of each tendon, zero in unsolved rows."""
    return np.asarray(np.nan_to_num(_bends(rotations)[:, robot.tendons.end_disk]))


def _joined(
    found: Sequence[Mapping[str, Any]], paths: list[Ints], *, disks: bool
) -> dict[str, Any]:
    """Arrays of all rows from those of each path, without a row before the first one; states."""
    names = ["tip_position", "tip_rotation", "converged", "tensions", "slack_lengths"]
    names += ["disk_positions", "disk_rotations"] * disks
    back = np.argsort(np.concatenate(paths))

    def rows(name: str) -> Floats:
        each = zip(found, paths, strict=True)
        return np.concatenate([at[name][len(at[name]) - len(own) :] for at, own in each])

    states = tuple(at["states"] for at in found if "states" in at)
    return {name: rows(name)[back] for name in names} | {"states": states}


def _table(solutions: list[Any], solved: Bools, name: str, *shape: int) -> Floats:
    """One attribute of the core's solutions for all rows (K, ...); NaN in those not solved."""
    table = np.full((len(solved), *shape), np.nan)
    for k in np.flatnonzero(solved):
        table[k] = getattr(solutions[k], name)
    return table


@dataclass(frozen=True)
class _Column:
    """Derivatives by one parameter.

    Attributes
    ----------
    whole : ndarray (K, 3 M)
        Derivatives of the measured points.
    point, slack : ndarray (K, 3 M), (K, T)
        Derivatives of the measured points and of the slack lengths at constant tensions.
    tensions : ndarray (K, T)
        Derivative of commanded tensions.
    """

    whole: Floats
    point: Floats
    slack: Floats
    tensions: Floats


@dataclass(frozen=True)
class _Reciprocal:
    """Derivatives of the poses of disks by tensions, by reciprocity (Maxwell and Betti).

    A force on a disk shortens a tendon by what the tension of the tendon moves the disk; so do a
    moment and the rotation vector (theory Eq. 7.9).

    Attributes
    ----------
    robot : Robot
    cores : list
        Linearised solutions of the core, None for unsolved rows.
    tensions : ndarray (K, T)
    """

    robot: Robot
    cores: list[Linearised | None]
    tensions: Floats

    def position(self, disk: int) -> Floats:
        """Derivatives (K, 3, T) of the position of a disk, zero for unsolved rows."""
        return self._by_wrench("disk_forces", disk, self._moment / self.robot.length)

    def rotation(self, disk: int) -> Floats:
        """Derivatives (K, 3, T) of its rotation vector, zero for unsolved rows."""
        return self._by_wrench("disk_moments", disk, self._moment)

    @property
    def _moment(self) -> float:
        return _PROBE * float(self.robot.bending_stiffness.min()) / self.robot.length

    def _by_wrench(self, name: str, disk: int, size: float) -> Floats:
        table = np.zeros((len(self.cores), 3, self.tensions.shape[1]))
        places = np.array([-size, size])
        weights = np.array([[-0.5, 0.5], [-0.5, 0.5], [0.0, 0.0]]) / size
        # behind position, rotation vector and energy of the tip
        lengths = slice(7, 7 + self.tensions.shape[1])
        for axis in range(3):
            wrench = np.zeros((2, len(self.robot.disks.station_m), 3))
            wrench[:, disk, axis] = places
            load = with_arrays(Load(**{name: wrench}), " or (n, N, 3)")

            def shortened(k: int, load: Load = load) -> Floats:
                core = self.cores[k]
                if core is None:
                    return np.zeros(self.tensions.shape[1])
                both = np.stack([self.tensions[k]] * 2)
                return -core.along(None, both, load, places, weights)[0][lengths]

            table[:, axis] = threads.in_parts(shortened, range(len(self.cores)))
        return table


@dataclass(frozen=True)
class _Exact:
    """Derivatives of the measured points by tensions and stiffness; zero for unsolved rows.

    Attributes
    ----------
    by_tension : ndarray (K, 3 M, T)
    by_file : dict of ndarray (K, 3 M, ...)
        Derivatives at constant tensions: by the relative change of the stiffness of each segment
        ("stiffness", S of them) and by gravity ("gravity", 3); empty with points that are not on
        the end disk.
    lengths_by_file : dict of ndarray (K, T, ...)
        The same of the lengths less what clearance takes with the bend.
    slack_by_tension : ndarray (K, T, T)
        slack = home length - displacement - length + compliance x tension + losses in holes and
        mount (theory Eq. 4.1 and 4.10)
    answer : ndarray (K, T, T)
        Derivative of tensions by slack, for taut displacement-controlled tendons.
    tensions, bends : ndarray (K, T)
        Tensions (N), and bends to the end disks of the tendons (rad).
    """

    by_tension: Floats
    by_file: dict[str, Floats]
    lengths_by_file: dict[str, Floats]
    slack_by_tension: Floats
    answer: Floats
    tensions: Floats
    bends: Floats

    @classmethod
    def of(cls, solutions: Solutions, at: Prediction) -> _Exact | None:
        """Make derivatives; None where the displacements do not determine the tensions."""
        if not at.solved.any():
            return None
        every = zip(solutions.jacobians, at.solved, strict=True)
        each = [found for found, solved in every if solved]
        if any(found is None for found in each):
            return None

        def stacked(name: str) -> Floats:
            first = each[0][name]
            table = np.zeros((len(at.solved), *first.shape))
            table[at.solved] = [found[name] for found in each]
            return table

        tensions = np.where(at.solved[:, None], [s.tensions for s in solutions], 0.0)
        by_displacement = np.stack([s.by_displacement for s in solutions])
        held = by_displacement & (tensions > 0)
        robot = at.setting.robot
        tendons, count = robot.tendons, len(robot.disks.station_m)

        def shorter(name: str) -> Floats:
            clearance = tendons.hole_clearance_m[:, None]
            return stacked(f"lengths_by_{name}") - clearance * stacked(f"bends_by_{name}")

        compliance = np.diag(actuation.compliances(robot))
        compliance += tendons.mount_compliance_m_per_N[:, None]
        by_tension = compliance - shorter("tension")
        both = held[:, :, None] & held[:, None, :]
        size = np.abs(np.einsum("kii->ki", by_tension)).max()
        block = np.where(both, by_tension, 0.0) + size * np.eye(held.shape[1]) * ~held[:, :, None]
        if not np.isfinite(block).all() or np.linalg.cond(block).max() > 1e10:
            return None
        spin = rotation(at.setting.turn)
        arms = np.where(at.solved[:, None, None], at.arms, 0.0)
        end = count - 1
        disks = at.disks or (end,)
        below = cls._below(solutions, at, tensions, end)

        def points(name: str) -> Floats:
            tip = stacked(f"tip_position_by_{name}"), stacked(f"tip_rotation_by_{name}")
            of_disk = {end: tip, **below}
            found = []
            for m, disk in enumerate(disks):
                moved, turned = of_disk[disk]
                turned = np.cross(turned, arms[:, m, :, None], axis=1)
                found.append(np.asarray(spin @ (moved + turned)))
            return np.concatenate(found, axis=1)

        return cls(
            by_tension=points("tension"),
            by_file={} if below else {name: points(name) for name in ("stiffness", "gravity")},
            lengths_by_file={name: shorter(name) for name in ("stiffness", "gravity")},
            slack_by_tension=by_tension,
            answer=np.where(both, np.linalg.inv(block), 0.0),
            tensions=tensions,
            bends=_bends_of_tendons(
                robot, _table(solutions, at.solved, "disk_rotations", count, 3, 3)
            ),
        )

    def taken(self, robot: Robot) -> Floats:
        """Displacements (K, T) that tendons, holes and mount of a robot take here, m."""
        tendons = robot.tendons
        of_mount = (self.tensions - tendons.pretension_N).sum(axis=1, keepdims=True)
        return np.asarray(
            actuation.compliances(robot) * self.tensions
            + tendons.mount_compliance_m_per_N * of_mount
            + tendons.hole_clearance_m * self.bends
        )

    @staticmethod
    def _below(
        solutions: list[Any], at: Prediction, tensions: Floats, end: int
    ) -> dict[int, tuple[Floats, Floats]]:
        """Derivatives (K, 3, T) of positions and rotation vectors of disks before the end disk."""
        disks = {disk for disk in at.disks if disk != end}
        if not disks:
            return {}
        cores = [
            Linearised.at(s) if solved else None
            for s, solved in zip(solutions, at.solved, strict=True)
        ]
        by = _Reciprocal(at.setting.robot, cores, tensions)
        offsets = at.setting.offsets(len(at.disks))
        turning = {d for d, offset in zip(at.disks, offsets, strict=True) if offset.any()}
        still = np.zeros((len(cores), 3, tensions.shape[1]))
        return {d: (by.position(d), by.rotation(d) if d in turning else still) for d in disks}

    def column(self, point: Floats, slack: Floats, tensions: Floats) -> _Column:
        """Column from changes at constant tensions (K, 3 M), (K, T) and of commanded tensions."""
        lacks = slack + np.einsum("kst,kt->ks", self.slack_by_tension, tensions)
        follow = tensions - np.einsum("kst,kt->ks", self.answer, lacks)
        whole = point + np.einsum("kit,kt->ki", self.by_tension, follow)
        return _Column(whole, point, slack, tensions)
