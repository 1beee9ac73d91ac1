"""Results of statics: `Solution` for one load, `Sweep` for many.

All values are in SI and in the base frame (z along the straight backbone) by default.
A rotation maps body to base. N is the number of disks, T the number of tendons.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from operator import attrgetter
from types import SimpleNamespace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np

from bowstring.aliases import Bools, Floats, Ints
from bowstring.display import html_table, millimetres, sampled_rows
from bowstring.errors import InputError, NoSolutionError, StabilityWarning
from bowstring.pose import Pose
from bowstring.results import Key, Result
from bowstring.robot.picture import picture
from bowstring.robot.plausibility import load_advice
from bowstring.statics import actuation, messages
from bowstring.statics.load import Load, PointLoad
from bowstring.statics.load_tables import ON_DISKS, with_arrays
from bowstring.statics.messages import StaticsStatus
from bowstring.validation import whole

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

    import bowstring._core as _core
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.fields import Frames
    from bowstring.statics.limits import Utilisation


@dataclass(frozen=True)
class ErrorEstimate(Result):
    """Estimated discretisation error of a solution.

    Defect correction: each element is integrated by a sixth-order Runge-Kutta method (theory
    Eq. 3.5), and its defect is substituted through the last elimination. The estimate is three
    times the sum of the resulting motions of the modules' ends. It was above the error of 2 000
    random robots, and at most 30 times the error in 99 % of them (docs/verification/accuracy.md).
    """

    tip: Annotated[float, Key("tip_m")]
    """Error of the position of the tip, m; it covers all disks; NaN where it is not known."""
    tension: Annotated[float, Key("tension_N")]
    """Error of the tension of a displacement-controlled tendon, N; NaN where it is not known."""


def _of_core(name: str) -> Any:
    """Property that reads an attribute of the core's solution."""
    return property(attrgetter(f"core.{name}"))


class Solution(Result):
    """Equilibrium of one load; made by `solve`.

    Values of the pose are None unless `converged`. Every access returns a new array. Pickles and
    copies contain the load, which is solved again and gives the same numbers.
    """

    __slots__ = ("_before", "_path", "core", "robot")

    def __init__(
        self,
        robot: Robot,
        core: _core.Solution,
        path: actuation.Path | None = None,
        before: Mapping[str, Any] | None = None,
    ) -> None:
        self.robot = robot
        self.core = core
        self._path = path
        self._before = before

    def __repr__(self) -> str:
        position = self.core.tip_position
        if position is not None:
            x, y, z = 1e3 * position
            return f"<Solution of {self.robot.name}: tip at ({x:.3f}, {y:.3f}, {z:.3f}) mm>"
        return f"<Solution of {self.robot.name}: {self.status}>"

    def _repr_html_(self) -> str:
        rows: list[tuple[str, object]] = [
            ("status", self.status),
            ("stable", "unknown" if self.stable is None else "yes" if self.stable else "no"),
            ("theory", self.model.theory),
            ("tensions", ", ".join(f"{v:.6g}" for v in self.tensions) + " N"),
        ]
        if self.core.tip_position is not None:
            rows.insert(0, ("tip", millimetres(self.core.tip_position)))
            rows.append(("tendon lengths", millimetres(self.tendon_lengths)))
        title = f"Solution of {self.robot.name}"
        drawn = ""
        if self.disk_positions is not None and self.disk_rotations is not None:
            drawn = picture(
                self.robot,
                self.disk_positions,
                self.disk_rotations,
                slack=self.slack or (),
                title=title,
            )
        return drawn + html_table(title, rows)

    def __reduce__(self) -> tuple[Any, ...]:
        model = self.model
        if self._path is not None and self.core.on_path:
            # elements as given: a path with adaptive elements chooses the same ones again
            model = self._path.model
        return solution, (self.robot, self.load, model, self._before)

    status: Annotated[StaticsStatus, Key()] = _of_core("status")
    """``converged``, or the reason of failure: ``max_iterations`` (within the bounds of iterations
    and work), ``unstable`` (only an unstable equilibrium was found), ``no_equilibrium`` (disks
    collide, or the displacements conflict)."""
    converged: bool = _of_core("converged")
    """Whether the status is ``converged``."""
    stable: Annotated[bool | None, Key()] = _of_core("stable")
    """Whether the equilibrium is stable, given the commands of the tendons; None where that is not
    determined.

    The potential energy has a minimum then. Under a moment, which has no potential: whether small
    oscillations decay at a damping ratio of 1 %. False with the status ``"converged"`` where
    increasing the moment leads from a stable equilibrium to one with growing oscillations, such as
    a moment that rolls up a rod. None where the decay needs more damping, where a moment acts on
    displacement-controlled tendons or on a robot without mass, with friction, and where there are
    too few elements to decide."""
    iterations: Annotated[int, Key()] = _of_core("iterations")
    """Newton iterations, including those of load stepping."""
    residual: Annotated[float, Key()] = _of_core("residual")
    """Largest moment imbalance over (bending stiffness / length); NaN if the solve failed."""
    model: RodModel = _of_core("model")
    """Model given to `solve`, with the number of elements of the solution."""
    tensions: Annotated[Floats, Key("tensions_N")] = _of_core("tensions")
    """Tension of each tendon before the base hole (T,), N; computed where a displacement is given,
    and NaN if the solve failed."""
    disk_positions: Floats | None = _of_core("disk_positions")
    """Positions (N, 3) of the disks from base to tip, the base excluded, m."""
    disk_rotations: Floats | None = _of_core("disk_rotations")
    """Rotations (N, 3, 3) of the disks."""
    tendon_lengths: Annotated[Floats | None, Key("tendon_lengths_m")] = _of_core("tendon_lengths")
    """Length of each tendon (T,) from the base hole to the end disk's, m; None without a solution.
    """

    @property
    def load(self) -> Load:
        """The load that was solved, with its actuation."""
        core = self.core
        tensions, displacements, points = core.tensions, None, core.point_loads
        if core.by_displacement is not None and core.commands is not None:
            tensions = np.where(core.by_displacement, np.nan, core.commands)
            displacements = np.where(core.by_displacement, core.commands, np.nan)
        return Load(
            tensions,
            displacements,
            gravity=core.gravity,
            tip_force=core.tip_force,
            tip_moment=core.tip_moment,
            disk_forces=core.disk_forces,
            disk_moments=core.disk_moments,
            point_loads=None if points is None else map(PointLoad.of_numbers, points.tolist()),
            line_forces=core.line_forces,
        )

    @property
    def error_estimate(self) -> Annotated[ErrorEstimate | None, Key()]:
        """Estimated discretisation error; None if the solve failed."""
        found = self.core.error_estimate
        return None if found is None else ErrorEstimate(*found)

    @property
    def message(self) -> str:
        """Message on the solve, with advice if it failed or its discretisation is coarse."""
        core, robot = self.core, self.robot
        advice = "" if self.converged else load_advice(robot, self.tensions, core.tip_force)
        if core.conflict is None:
            said = messages.of_solution(core, advice)
        else:
            slack = [i - 1 for i in self.slack or ()]
            friction = float(robot.tendons.friction.max())
            given = np.asarray(core.commands)[np.asarray(core.by_displacement)]
            held = bool((given == 0).any() and (given > 0).any())
            said = messages.of_actuation(core, slack, friction, advice, held)
        if core.error_estimate is None:
            return said
        elements = self.model.elements
        return said + messages.discretisation(
            core.error_estimate,
            self.tensions,
            robot.length,
            elements,
            path=core.conflict is not None and robot.has_memory,
        )

    @property
    def tip(self) -> Pose | None:
        """Pose of the last disk."""
        position, rotation = self.core.tip_position, self.core.tip_rotation
        return None if position is None or rotation is None else Pose(position, rotation)

    def displacements(self) -> Floats | None:
        """Tendon displacements (T,) since the home pose in m, positive where shortened.

        None if the solve failed, or if the robot's pretension has no home pose.
        """
        core = self.core
        if core.on_path or core.tendon_lengths is None:
            return core.displacements
        return actuation.displacements(self.robot, self.model, core.tendon_lengths, core.tensions)

    @property
    def shortened(self) -> Annotated[Floats | None, Key("displacements_m")]:
        """Displacement of each tendon (T,), m, by `displacements`; None without a solution or a
        home pose."""
        return self.displacements()

    @property
    def disk_poses(self) -> Annotated[list[Pose] | None, Key("disks")]:
        """All disks from base to tip, without the base; None without a solution."""
        positions, rotations = self.core.disk_positions, self.core.disk_rotations
        if positions is None or rotations is None:
            return None
        return list(map(Pose, positions, rotations))

    @property
    def tip_pose(self) -> Annotated[Pose | None, Key("tip")]:
        """Tip; None without a solution."""
        disks = self.disk_poses
        return None if disks is None else disks[-1]

    @property
    def elements(self) -> Annotated[int | None, Key()]:
        """Elements between two disks."""
        return self.model.elements

    @property
    def theory(self) -> Annotated[Literal["cosserat", "kirchhoff"], Key()]:
        """Theory of the backbone."""
        return self.model.theory

    @property
    def slack(self) -> Annotated[tuple[int, ...] | None, Key()]:
        """Numbers, from 1, of displacement-controlled tendons that are slack; None without a
        solution."""
        lengths = self.slack_lengths
        if lengths is None:
            return None
        return tuple((actuation.slack(self.robot, lengths) + 1).tolist())

    @property
    def slack_lengths(self) -> Annotated[Floats | None, Key("slack_m")]:
        """Slack length (T,) of displacement-controlled tendons, m, exactly 0 where taut; None
        without a solution."""
        core = self.core
        if core.on_path:
            return core.slack_lengths
        return np.zeros(len(core.tensions)) if core.converged else None

    @property
    def span_tensions(self) -> Annotated[Floats | None, Key("span_tensions_N")]:
        """Tensions (N, T) of the spans from base to tip, N; NaN beyond a tendon's end, and None
        without a solution."""
        core = self.core
        if not core.converged:
            return None
        passes = _passes(self.robot)
        spans = core.tensions if core.span_tensions is None else core.span_tensions
        return np.where(passes, spans, np.nan)

    @property
    def undetermined(self) -> Annotated[bool, Key()]:
        """Whether several sets of tensions have the same pose; the smallest is given."""
        return bool(self.core.undetermined)

    @property
    def length_residual(self) -> Annotated[float, Key("length_residual_m")]:
        """Largest violation of a commanded displacement, m; NaN if the solve failed."""
        return self.core.length_residual or 0.0

    def history(self) -> dict[str, Any] | None:
        """State of the path, for ``history`` of the next solve.

        None if the solve failed, or if the tendons are continuous.

        A dict for `json.dumps`: ``schema_version``, ``robot``, ``robot_hash``, the settings and the
        state of friction. After a solve by tensions it solves one step of the path.
        """
        core = self.core
        if not core.converged or self.model.tendon_path == "continuous":
            return None
        if self._path is None:
            path = actuation.Path(self.robot, self.model)
            load = with_arrays(self.load)
            found = path.core.step(np.zeros(len(core.tensions), bool), core.tensions, load)
            if not self._is_pose_of(found):
                raise NoSolutionError(
                    f"{self.robot.name}: there is no history, because the path from home does not "
                    "lead to this pose; approach it by a sweep with a history"
                )
            self._path = path
        return self._path.history()

    def _is_pose_of(self, other: _core.Solution) -> bool:
        here, there = self.core.tip_position, other.tip_position
        if here is None or there is None:
            return False
        return bool(np.abs(here - there).max() <= 1e-8 * self.robot.length)

    def centerline(self, points_per_module: int = 8) -> Floats | None:
        """Points of the backbone from base to tip.

        Parameters
        ----------
        points_per_module : int
            Number of points between a disk (or the base) and the next disk, which is the last one.

        Returns
        -------
        ndarray (N * points_per_module + 1, 3) or None
            Positions in m; None if the solve failed.
        """
        try:
            return self.core.centerline(points_per_module)
        except (TypeError, OverflowError):
            raise InputError(
                f"points_per_module is {points_per_module!r}, it must be a whole number from 1"
            ) from None

    def to_dataset(self, points: int = 5) -> xr.Dataset:
        """Centreline, strain, internal forces and stress of the equilibrium, with units.

        Parameters
        ----------
        points : int
            Stations along the flexible part of each module, both ends included.

        Returns
        -------
        xarray.Dataset
            Variables of a run (`bowstring.statics.fields`) at one time.

        Raises
        ------
        NoSolutionError
            If the solution did not converge.
        """
        from bowstring.statics.fields import to_dataset

        points = whole("points", points, 2, 1000)
        self.raise_for_status()
        frames = self._frames(points)
        core, model, loads = self.core, self.model, self.load.point_loads
        settings = {
            "tip_force": core.tip_force.tolist(),
            "tip_moment": core.tip_moment.tolist(),
            **{
                name: value.tolist()
                for name in ON_DISKS
                if (value := getattr(core, name)) is not None
            },
            **({} if loads is None else {"point_loads": [load.to_dict() for load in loads]}),
            "gravity": core.gravity.tolist(),
            "theory": model.theory,
            "tendon": model.tendon_path,
            "twist": model.twist,
            "elements": model.elements,
            "tensions_N": self.tensions.tolist(),
        }
        return to_dataset(self.robot, frames, settings, status=self.status)

    def _frames(self, points: int) -> Frames:
        """Raw fields of a converged solution."""
        from bowstring.statics import simulator

        path = self._path if self.core.on_path else None
        load = self.load.replace(tensions=self.tensions)
        return simulator.at_rest(self.robot, load, self.model, path, points=points)

    def limits(self) -> tuple[tuple[str, ...], tuple[Utilisation, ...]]:
        """Warnings of the pose, and utilisation of the limits of the robot file.

        Returns
        -------
        warnings : tuple of str
            Rods that buckle, a backbone stretched beyond linear elasticity, disks below the base,
            and segments beyond ``yield_strength`` or ``strain_limit``.
        uses : tuple of `bowstring.statics.limits.Utilisation`
            Utilisation of each limit; empty if the robot file has none or the solve failed.
        """
        from bowstring.statics import limits

        if not self.converged or self.disk_positions is None:
            return (), ()
        frames = partial(self._frames, limits.POINTS)
        beyond = limits.buckled_or_stretched(self.robot, self.tensions, self.model)
        warnings, uses = limits.of_pose(self.robot, self.disk_positions, frames, self.model)
        return (*beyond, *warnings), uses

    def warnings(self) -> tuple[str, ...]:
        """Warnings of the pose; see `limits`.

        Returns
        -------
        tuple of str
            Sentences.
        """
        return self.limits()[0]

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise.

        Raises
        ------
        NoSolutionError
            The message has the reached state and advice.

        Warns
        -----
        StabilityWarning
            If the equilibrium is unstable, or its stability is unknown for a reason other than
            friction.
        """
        if not self.converged:
            raise NoSolutionError(f"{self.robot.name}: {self.message}", status=self.status)
        if not self.stable and not self.robot.has_memory:
            warnings.warn(f"{self.robot.name}: {self.message}", StabilityWarning, stacklevel=2)
        return self


def _passes(robot: Robot) -> Bools:
    """Whether a tendon passes a module, (N, T)."""
    passes: Bools = np.arange(len(robot.disks.station_m))[:, None] <= robot.tendons.end_disk
    return passes


@dataclass(repr=False, eq=False)  # not frozen: that would cost 4 us a sweep
class Sweep:
    """Equilibria of n loads; made by `sweep` and `solve_batch`.

    Rows that did not converge hold NaN.

    Attributes
    ----------
    robot : Robot
    tensions : ndarray (n, T)
        Tensions before the base holes in N; computed where a displacement is given.
    model : RodModel
    status : list of str (n,)
        As `Solution.status`.
    converged : ndarray of bool (n,)
    stable : list of bool or None (n,)
    iterations : ndarray of int (n,)
    residual : ndarray (n,)
    tip_position, tip_rotation : ndarray (n, 3) in m, (n, 3, 3)
    tendon_lengths : ndarray (n, T)
        In m.
    disk_positions, disk_rotations : ndarray (n, N, 3) in m, (n, N, 3, 3); or None
        None if called with ``disks=False``.
    left_unstable : ndarray of bool (n,)
        Whether the path from the straight robot led to an unstable equilibrium, from which the
        solver went on to a stable one.
    fraction : ndarray (n,)
        Largest fraction of the load that converged.
    collision : ndarray of int (n,)
        Module (from 0) in which two disks collide; -1 if none.
    tip_error, tension_error : ndarray (n,)
        Estimated discretisation error, in m and N, as `ErrorEstimate`.
    path : dict or None
        Further results of a path, which the methods below return.
    """

    robot: Robot
    tensions: Floats
    model: RodModel
    status: list[str]
    converged: Bools
    stable: list[bool | None]
    iterations: Ints
    residual: Floats
    tip_position: Floats
    tip_rotation: Floats
    tendon_lengths: Floats
    disk_positions: Floats | None
    disk_rotations: Floats | None
    left_unstable: Bools
    fraction: Floats
    collision: Ints
    tip_error: Floats
    tension_error: Floats
    path: dict[str, Any] | None = None

    def __len__(self) -> int:
        return len(self.status)

    def displacements(self) -> Floats:
        """Tendon displacements (n, T) since the home pose in m, positive where shortened."""
        if self.path is not None:
            return np.array(self.path["displacements"])
        found = actuation.displacements(self.robot, self.model, self.tendon_lengths, self.tensions)
        return np.full_like(self.tensions, np.nan) if found is None else found

    @property
    def slack_lengths(self) -> Floats:
        """Slack length (n, T) of displacement-controlled tendons in m; 0 where taut."""
        if self.path is not None:
            return np.array(self.path["slack_lengths"])
        return np.where(self.converged[:, None], np.zeros_like(self.tensions), np.nan)

    @property
    def span_tensions(self) -> Floats:
        """Tensions (n, N, T) of the spans from base to tip, in N; NaN beyond a tendon's end."""
        passes = _passes(self.robot)
        if self.path is not None:
            return np.where(passes, self.path["span_tensions"], np.nan)
        spans = np.where(passes, self.tensions[:, None, :], np.nan)
        return np.where(self.converged[:, None, None], spans, np.nan)

    @property
    def undetermined(self) -> Bools:
        """Rows (n,) in which several sets of tensions have the same pose; the smallest is given."""
        if self.path is not None:
            return np.array(self.path["undetermined"])
        return np.zeros(len(self), bool)

    def history(self) -> dict[str, Any] | None:
        """State of the path after the last row, as `Solution.history()`.

        None if the rows form no path: tensions without friction, or independent loads.
        """
        return None if self.path is None else self.path["history"]

    def __repr__(self) -> str:
        done = int(self.converged.sum())
        return f"<Sweep of {self.robot.name}: {done} of {len(self)} loads converged>"

    def _repr_html_(self) -> str:
        def row(k: int) -> tuple[object, ...]:
            tensions = ", ".join(f"{v:.6g}" for v in self.tensions[k])
            tip = millimetres(self.tip_position[k]) if self.converged[k] else ""
            return k, tensions, tip, self.status[k]

        title, drawn = repr(self).strip("<>"), ""
        if self.disk_positions is not None and self.disk_rotations is not None:
            drawn = picture(self.robot, self.disk_positions, self.disk_rotations, title=title)
        header = ("", "tensions, N", "tip", "status")
        return drawn + html_table(title, sampled_rows(len(self), row), header)

    def to_dataset(self) -> xr.Dataset:
        """All rows with labels and units, along the dimension ``load``.

        Returns
        -------
        xarray.Dataset
            ``tip_position``, ``tension``, ``tendon_length``, ``slack``, ``span_tension``, of disks
            ``disk_position`` and ``disk_rotation`` if they were computed, and of each row
            ``status``, ``converged``, ``residual``, ``tip_error`` and ``tension_error``.
        """
        from bowstring.statics.fields import rows_to_dataset

        values = {
            "tension": self.tensions,
            "tendon_length": self.tendon_lengths,
            "tendon_displacement": self.displacements(),
            "slack": self.slack_lengths,
            "span_tension": self.span_tensions,
        }
        if self.disk_positions is not None and self.disk_rotations is not None:
            values |= {"disk_position": self.disk_positions, "disk_rotation": self.disk_rotations}
        others = {
            "tip_position": (("axis",), self.tip_position, "m", "position of the tip"),
            "residual": ((), self.residual, "1", "moment imbalance over EI / length"),
            "tip_error": ((), self.tip_error, "m", "estimated discretisation error of the tip"),
            "tension_error": ((), self.tension_error, "N", "the same of tensions"),
            "converged": ((), self.converged, "1", "whether the row has a solution"),
            "status": ((), np.array(self.status, dtype=str), "1", "how the row ended"),
        }
        return rows_to_dataset(self.robot, "load", values, others, self.model.to_dict())

    def message(self, row: int) -> str:
        """Message on a row, as `Solution.message`."""
        advice = "" if self.converged[row] else load_advice(self.robot, self.tensions[row])
        found = SimpleNamespace(**{name: getattr(self, name)[row] for name in messages.NEEDED})
        if self.path is None:
            return messages.of_solution(found, advice)
        found.undetermined = self.path["undetermined"][row]
        found.conflict = self.path["conflicts"].get(range(len(self))[row], ((), None))
        lengths = self.path["slack_lengths"][row]
        slack = actuation.slack(self.robot, lengths) if self.converged[row] else ()
        friction = float(self.robot.tendons.friction.max())
        return messages.of_actuation(found, slack, friction, advice)

    def raise_for_status(self) -> Self:
        """Return self if all rows converged, else raise.

        Raises
        ------
        NoSolutionError
            The message has the first row that failed and their number.

        Warns
        -----
        StabilityWarning
            As for a solution; the message has the first such row.
        """
        failed = np.flatnonzero(~self.converged)
        if failed.size:
            first = int(failed[0])
            raise NoSolutionError(
                f"{self.robot.name}: {failed.size} of {len(self)} loads have no solution; "
                f"the first is row {first + 1}: {self.message(first)}"
            )
        if not all(self.stable) and not self.robot.has_memory:
            row = [bool(stable) for stable in self.stable].index(False)
            said = f"{self.robot.name}: row {row + 1}: {self.message(row)}"
            warnings.warn(said, StabilityWarning, stacklevel=2)
        return self


def solution(
    robot: Robot, load: Load, model: RodModel, before: Mapping[str, Any] | None = None
) -> Solution:
    """Solve one load; `bowstring.solve` without its checks and defaults."""
    load = with_arrays(load)
    if before is None and not load.is_actuated:
        load = load.replace(tensions=np.zeros(robot.core.tendon_count))
    if actuation.is_by_tensions(robot, load, before):
        return Solution(robot, robot.core.solve(load.tensions, load, model))
    given, commands = actuation.commands(robot, load)
    path = actuation.Path(robot, model, before)
    return Solution(robot, path.core.step(given, commands, load), path, before)


def joined(parts: Sequence[tuple[Ints, Sweep]]) -> Sweep:
    """Join sweeps of parts of the rows; the result is no single path and has no history.

    Parameters
    ----------
    parts : sequence of (ndarray of int, Sweep)
        Rows of each sweep in the whole; of one robot and the same options.
    """
    order = np.argsort(np.concatenate([rows for rows, _ in parts]), kind="stable")

    def whole(values: list[Any]) -> Any:
        if any(value is None for value in values):
            return None
        if isinstance(values[0], np.ndarray):
            return np.concatenate(values)[order]
        rows = [row for value in values for row in value]
        return [rows[k] for k in order]

    sweeps = [sweep for _, sweep in parts]
    rows = {
        field.name: whole([getattr(sweep, field.name) for sweep in sweeps])
        for field in fields(Sweep)
        if field.name not in ("robot", "model", "path")
    }
    path = [sweep.path for sweep in sweeps if sweep.path is not None]
    extra = None
    if len(path) == len(sweeps):
        names = path[0].keys() - {"history", "conflicts"}
        extra = {name: whole([each[name] for each in path]) for name in names}
        extra["conflicts"] = {
            int(places[k]): why
            for (places, _), each in zip(parts, path, strict=True)
            for k, why in each["conflicts"].items()
        }
        extra["history"] = None
    first = sweeps[0]
    return Sweep(first.robot, model=first.model, path=extra, **rows)
