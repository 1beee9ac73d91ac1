"""Statics of a robot: backbone as an elastic rod, rigid disks, tendons straight between them.

Everything is SI, in the base frame (z along the straight backbone) unless said otherwise.
A rotation maps body to base. N is the number of disks, T the number of tendons.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring import validation
from bowstring.display import html_table, in_few_rows, millimetres, short_repr
from bowstring.errors import InputError, NoSolutionError, StabilityWarning
from bowstring.formatting import plain
from bowstring.robot.model import check_robot
from bowstring.robot.plausibility import load_advice
from bowstring.statics import actuation
from bowstring.validation import check_choices

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

    import bowstring._core as _core
    from bowstring.robot.model import Robot
    from bowstring.statics.fields import Frames
    from bowstring.statics.limits import Use

__all__ = [
    "Jacobians",
    "Pose",
    "PullJacobian",
    "Solution",
    "Sweep",
    "jacobians",
    "pull_jacobian",
    "solve",
    "solve_batch",
    "sweep",
]

Floats = NDArray[np.float64]
Theory = Literal["cosserat", "kirchhoff"]
TendonPath = Literal["straight", "continuous"]

_NO_LOAD = (0.0, 0.0, 0.0)


class Pose(NamedTuple):
    """Position (3,) in m and rotation (3, 3) body to base."""

    position: Floats
    rotation: Floats


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimated discretisation error of an answer.

    Each element is integrated under the wrench that acts on it, by a method of its own; what it
    misses goes through the last Newton step (defect correction). Stated is three times the motion
    of the modules' ends that takes it away, summed; it covered the error of 2 000 random robots,
    and was at most 30 times it in 99 % (docs/accuracy.md).

    Attributes
    ----------
    tip : float
        Of the tip's position, in m; no disk is further off.
    tension : float
        Of the tension of a tendon that is pulled by a length, in N.
    """

    tip: float
    tension: float

    def to_dict(self) -> dict[str, float | None]:
        """Return it with units in the names, ready for `json.dumps`."""
        tip, tension = plain([self.tip, self.tension])
        return {"tip_m": tip, "tension_N": tension}


class Solution:
    """The answer to one load; made by `solve`.

    Numbers of the pose are None unless `converged`. Every access returns a fresh array.

    Attributes
    ----------
    robot : Robot
    status : str
        ``"converged"``, or why not: ``"max_iterations"``, ``"unstable"`` (an equilibrium was
        found, but no stable one), ``"no_equilibrium"`` (disks collide, or tendons that are pulled
        fight each other).
    converged : bool
    stable : bool or None
        Whether the energy has a minimum here, under what the tendons are driven by. Under a tip
        moment, which has no potential: whether small motions die out at a damping ratio of 1 %.
        False with the status ``"converged"`` where it is the moment that leads from a stable
        equilibrium to one where they do not, as a moment does that rolls a rod up.
        None where that takes more damping, where a tip moment acts on tendons that are pulled or
        on a robot without mass, with friction, and where the elements are too few to tell.
    iterations : int
        Newton steps, those of continuation included.
    residual : float
        Largest moment imbalance over (bending stiffness / length).
    theory, tendon, twist
        As given to `solve`.
    elements : int
        Elements between two disks that the answer was found with.
    error_estimate : ErrorEstimate or None
        Estimated discretisation error; None if the solve failed.
    tensions : ndarray (T,)
        In N, before the base hole; with `gravity` (m/s^2), `tip_force` (N) and `tip_moment` (N m),
        each (3,), the load. Those of pulled tendons are found, NaN if the solve failed.
    undetermined : bool
        Whether the pulls allow many tensions in the same pose; these are the smallest.
    length_residual : float
        Largest length by which a pulled tendon misses its pull, in m.

    A solution is pickled and copied as its load, and solved anew, which gives the same numbers.
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
            ("theory", self.theory),
            ("tensions", ", ".join(f"{v:.6g}" for v in self.tensions) + " N"),
        ]
        if self.core.tip_position is not None:
            rows.insert(0, ("tip", millimetres(self.core.tip_position)))
            rows.append(("tendon lengths", millimetres(self.tendon_lengths)))
        return html_table(f"Solution of {self.robot.name}", rows)

    def __reduce__(self) -> tuple[Any, ...]:
        c = self.core
        physics = (c.theory, c.gravity, c.tip_force, c.tip_moment, c.tendon, c.twist)
        if c.driven:
            # elements as they were asked for: a path that chooses them meets the same ones again
            given = None if self._path is None else self._path.settings["elements"]
            return _drive, (self.robot, c.pulled, c.commands, *physics, given, self._before)
        return _solve, (self.robot, c.tensions, *physics, c.elements)

    @property
    def status(self) -> str:
        return self.core.status

    @property
    def converged(self) -> bool:
        return self.core.converged

    @property
    def stable(self) -> bool | None:
        return self.core.stable

    @property
    def iterations(self) -> int:
        return self.core.iterations

    @property
    def residual(self) -> float:
        return self.core.residual

    @property
    def theory(self) -> Theory:
        return self.core.theory

    @property
    def tendon(self) -> TendonPath:
        return self.core.tendon

    @property
    def twist(self) -> bool:
        return self.core.twist

    @property
    def elements(self) -> int:
        return self.core.elements

    @property
    def error_estimate(self) -> ErrorEstimate | None:
        """Estimated discretisation error; None if the solve failed."""
        found = self.core.error_estimate
        return None if found is None else ErrorEstimate(*found)

    @property
    def tensions(self) -> Floats:
        return self.core.tensions

    @property
    def gravity(self) -> Floats:
        return self.core.gravity

    @property
    def tip_force(self) -> Floats:
        return self.core.tip_force

    @property
    def tip_moment(self) -> Floats:
        return self.core.tip_moment

    @property
    def message(self) -> str:
        """How the solve ended and, if it failed or may be coarse, what to try."""
        core = self.core
        if core.conflict is not None:
            message = actuation.message(
                core.status,
                core.stable,
                [i - 1 for i in self.slack or ()],
                self.undetermined,
                float(self.robot.tendons.friction.max()),
                core.conflict,
                core.residual,
                core.iterations,
                self._advice,
            )
            return message + self._accuracy
        message = _message(
            core.status,
            core.stable,
            core.left_unstable,
            core.fraction,
            core.collision,
            core.residual,
            core.iterations,
            self._advice,
        )
        return message + self._accuracy

    @property
    def _accuracy(self) -> str:
        """A sentence if the estimated error is above what elements are chosen for, else nothing."""
        found = self.error_estimate
        if found is None:
            return ""
        return _coarse(found, self.tensions, self.robot.length, self.elements)

    @property
    def _advice(self) -> str:
        if self.converged:
            return ""
        return load_advice(self.robot, self.tensions, self.tip_force)

    @property
    def tip(self) -> Pose | None:
        """Pose of the last disk."""
        position, rotation = self.core.tip_position, self.core.tip_rotation
        return None if position is None or rotation is None else Pose(position, rotation)

    @property
    def disk_positions(self) -> Floats | None:
        """Positions (N, 3) of the disks from base to tip, the base excluded, in m."""
        return self.core.disk_positions

    @property
    def disk_rotations(self) -> Floats | None:
        """Rotations (N, 3, 3) of the disks."""
        return self.core.disk_rotations

    @property
    def tendon_lengths(self) -> Floats | None:
        """Lengths (T,) of the tendons from the base hole to the end disk's hole, in m."""
        return self.core.tendon_lengths

    @property
    def pulls(self) -> Floats | None:
        """Lengths (T,) that the actuators have taken in since the home pose, in m.

        None if the solve failed, or if the robot's pretension has no home pose.
        """
        core = self.core
        if core.driven or core.tendon_lengths is None:
            return core.pulls
        home = actuation.home_lengths(self.robot, *self._physics)
        if home is None:
            return None
        pulls: Floats = (
            home - core.tendon_lengths + actuation.compliances(self.robot) * core.tensions
        )
        return pulls

    @property
    def slack(self) -> tuple[int, ...] | None:
        """Numbers, from 1, of the pulled tendons that hang."""
        lengths = self.slack_lengths
        if lengths is None:
            return None
        return tuple((actuation.hanging(self.robot, lengths) + 1).tolist())

    @property
    def slack_lengths(self) -> Floats | None:
        """Lengths (T,) by which pulled tendons hang, in m; exactly 0 where a tendon pulls."""
        core = self.core
        if core.driven:
            return core.slack_lengths
        return np.zeros(len(core.tensions)) if core.converged else None

    @property
    def span_tensions(self) -> Floats | None:
        """Tensions (N, T) of the spans from base to tip, in N; NaN beyond a tendon's end."""
        core = self.core
        if not core.converged:
            return None
        passes = _passes(self.robot)
        spans = core.tensions if core.span_tensions is None else core.span_tensions
        return np.where(passes, spans, np.nan)

    @property
    def undetermined(self) -> bool:
        return bool(self.core.undetermined)

    @property
    def length_residual(self) -> float:
        return self.core.length_residual or 0.0

    @property
    def history(self) -> dict[str, Any] | None:
        """Where the path has come to, for ``history`` of the next solve.

        None if the solve failed, or if the tendons are continuous.

        A dict that `json.dumps` takes: ``schema_version``, ``robot``, ``robot_hash``, the settings
        and all that friction remembers.
        """
        core = self.core
        if not core.converged or core.tendon == "continuous":
            return None
        if self._path is None:
            path = actuation.Path(self.robot, *self._physics)
            held = np.zeros(len(core.tensions), bool)
            load = (core.gravity, core.tip_force, core.tip_moment)
            found = path.core.step(held, core.tensions, *load)
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

    @property
    def _physics(self) -> tuple[Theory, TendonPath, bool, int]:
        return self.core.theory, self.core.tendon, self.core.twist, self.core.elements

    def centerline(self, points_per_module: int = 8) -> Floats | None:
        """Points of the backbone from base to tip.

        Parameters
        ----------
        points_per_module : int
            Points after each disk (or the base) up to the next one, which is the last of them.

        Returns
        -------
        ndarray (N * points_per_module + 1, 3) or None
            In m; None if the solve failed.
        """
        try:
            return self.core.centerline(points_per_module)
        except (TypeError, OverflowError):
            raise InputError(
                f"points_per_module is {points_per_module!r}, it must be a whole number from 1"
            ) from None

    def fields(self, points: int = 5) -> xr.Dataset:
        """Centreline, strain, internal forces and stress of the equilibrium, with units.

        Parameters
        ----------
        points : int
            Stations along the flexible part of each module, both ends among them.

        Returns
        -------
        xarray.Dataset
            As of a run (`bowstring.statics.fields`), with one time.

        Raises
        ------
        NoSolutionError
            If the solution did not converge.
        """
        from bowstring.statics.fields import to_dataset

        self.raise_for_status()
        frames = self._frames(points)
        settings = {
            k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in self._load.items()
        }
        settings["tensions_N"] = self.tensions.tolist()
        return to_dataset(self.robot, frames, settings, status=self.status)

    @property
    def _load(self) -> dict[str, Any]:
        return {
            "tip_force": self.tip_force,
            "tip_moment": self.tip_moment,
            "gravity": self.gravity.tolist(),
            "theory": self.theory,
            "tendon": self.tendon,
            "twist": self.twist,
            "elements": self.elements,
        }

    def _frames(self, points: int) -> Frames:
        """The raw fields of a converged solution."""
        from bowstring.statics import simulator

        path = self._path if self.core.driven else None
        return simulator.at_rest(self.robot, self.tensions, path, points=points, **self._load)

    def limits(self) -> tuple[tuple[str, ...], tuple[Use, ...]]:
        """Warnings of the pose, and how far it uses up the limits of the robot file.

        Returns
        -------
        warnings : tuple of str
            Disks below the base, and segments beyond ``yield_strength`` or ``strain_limit``.
        uses : tuple of `bowstring.statics.limits.Use`
            None where the robot file has no limits, or the solve failed.
        """
        from bowstring.statics import limits

        if not self.converged or self.disk_positions is None:
            return (), ()
        frames = partial(self._frames, limits.POINTS)
        return limits.of_pose(self.robot, self.disk_positions, frames, self.theory, self.twist)

    def warnings(self) -> tuple[str, ...]:
        """What this pose meets: disks below the base, and limits of the backbone's material.

        Returns
        -------
        tuple of str
            Sentences; none where the robot stays above its base and, where its file says so,
            within ``yield_strength`` and ``strain_limit``.
        """
        return self.limits()[0]

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise.

        Raises
        ------
        NoSolutionError
            The text says what was reached and what to try.

        Warns
        -----
        StabilityWarning
            If the equilibrium is not stable or, for another reason than friction, not known to be.
        """
        if not self.converged:
            raise NoSolutionError(f"{self.robot.name}: {self.message}", status=self.status)
        if not self.stable and not self.robot.has_friction:
            warnings.warn(f"{self.robot.name}: {self.message}", StabilityWarning, stacklevel=2)
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``bowstring solve --json``, ready for `json.dumps`.

        Returns
        -------
        dict
            ``status, stable, iterations, residual, error_estimate, elements, theory, tip, disks,
            tendon_lengths_m, tensions_N, pulls_m, slack, slack_m, span_tensions_N, undetermined,
            length_residual_m``; the pose's entries are None if the solve failed, as is a number
            that is not finite.
        """
        core = self.core
        pulls, slack, spans = self.pulls, self.slack_lengths, self.span_tensions
        error = self.error_estimate
        tip = disks = lengths = None
        positions, rotations = core.disk_positions, core.disk_rotations
        if positions is not None and rotations is not None and core.tendon_lengths is not None:
            disks = [
                {"position_m": position, "rotation": rotation}
                for position, rotation in zip(positions.tolist(), rotations.tolist(), strict=True)
            ]
            tip = disks[-1]
            lengths = core.tendon_lengths.tolist()
        return {
            "status": core.status,
            "stable": core.stable,
            "iterations": core.iterations,
            "residual": plain(core.residual),
            "error_estimate": None if error is None else error.to_dict(),
            "elements": core.elements,
            "theory": core.theory,
            "tip": tip,
            "disks": disks,
            "tendon_lengths_m": lengths,
            "tensions_N": plain(core.tensions),
            "pulls_m": None if pulls is None else pulls.tolist(),
            "slack": None if self.slack is None else list(self.slack),
            "slack_m": None if slack is None else slack.tolist(),
            "span_tensions_N": None if spans is None else plain(spans),
            "undetermined": self.undetermined,
            "length_residual_m": plain(self.length_residual),
        }


def _passes(robot: Robot) -> NDArray[np.bool_]:
    """Whether a tendon passes a module, (N, T)."""
    passes: NDArray[np.bool_] = (
        np.arange(len(robot.disks.station_m))[:, None] <= robot.tendons.end_disk
    )
    return passes


@dataclass(repr=False, eq=False)  # not frozen: that would cost 4 us a sweep
class Sweep:
    """The answers to n loads; made by `sweep` and `solve_batch`.

    Rows that did not converge hold NaN.

    Attributes
    ----------
    robot : Robot
    tensions : ndarray (n, T)
        In N, before the base holes; found where a tendon is pulled by a length.
    theory : str
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
        The way from straight led to an unstable equilibrium, which was left for a stable one.
    fraction : ndarray (n,)
        Largest fraction of the load that did converge.
    collision : ndarray of int (n,)
        Module (from 0) in which two disks collide; -1 if none.
    tip_error, tension_error : ndarray (n,)
        Estimated discretisation error, in m and N, as `ErrorEstimate`.
    driven : dict or None
        What a drive along a path adds; its numbers are the properties below.
    """

    robot: Robot
    tensions: Floats
    theory: str
    status: list[str]
    converged: NDArray[np.bool_]
    stable: list[bool | None]
    iterations: NDArray[np.int64]
    residual: Floats
    tip_position: Floats
    tip_rotation: Floats
    tendon_lengths: Floats
    disk_positions: Floats | None
    disk_rotations: Floats | None
    left_unstable: NDArray[np.bool_]
    fraction: Floats
    collision: NDArray[np.int64]
    tip_error: Floats
    tension_error: Floats
    physics: tuple[TendonPath, bool, int | None] = ("straight", True, None)
    driven: dict[str, Any] | None = None

    def __len__(self) -> int:
        return len(self.status)

    @property
    def pulls(self) -> Floats:
        """Lengths (n, T) that the actuators have taken in since the home pose, in m."""
        if self.driven is not None:
            return np.array(self.driven["pulls"])
        home = actuation.home_lengths(self.robot, self.theory, *self.physics)
        if home is None:
            return np.full_like(self.tensions, np.nan)
        stretch = actuation.compliances(self.robot) * self.tensions
        pulls: Floats = home - self.tendon_lengths + stretch
        return pulls

    @property
    def slack_lengths(self) -> Floats:
        """Lengths (n, T) by which pulled tendons hang, in m; exactly 0 where a tendon pulls."""
        if self.driven is not None:
            return np.array(self.driven["slack_lengths"])
        return np.where(self.converged[:, None], np.zeros_like(self.tensions), np.nan)

    @property
    def span_tensions(self) -> Floats:
        """Tensions (n, N, T) of the spans from base to tip, in N; NaN beyond a tendon's end."""
        passes = _passes(self.robot)
        if self.driven is not None:
            return np.where(passes, self.driven["span_tensions"], np.nan)
        spans = np.where(passes, self.tensions[:, None, :], np.nan)
        return np.where(self.converged[:, None, None], spans, np.nan)

    @property
    def undetermined(self) -> NDArray[np.bool_]:
        """Rows (n,) whose pulls allow many tensions in the same pose; these are the smallest."""
        if self.driven is not None:
            return np.array(self.driven["undetermined"])
        return np.zeros(len(self), bool)

    @property
    def history(self) -> dict[str, Any] | None:
        """Where the path has come to after the last row, as `Solution.history`.

        None if the rows were no path: by tensions without friction, or each from home.
        """
        return None if self.driven is None else self.driven["history"]

    def __repr__(self) -> str:
        done = int(self.converged.sum())
        return f"<Sweep of {self.robot.name}: {done} of {len(self)} loads converged>"

    def _repr_html_(self) -> str:
        def row(k: int) -> tuple[object, ...]:
            tensions = ", ".join(f"{v:.6g}" for v in self.tensions[k])
            tip = millimetres(self.tip_position[k]) if self.converged[k] else ""
            return k, tensions, tip, self.status[k]

        title = repr(self).strip("<>")
        return html_table(title, in_few_rows(len(self), row), ("", "tensions, N", "tip", "status"))

    def message(self, row: int) -> str:
        """One sentence on how a row ended, as `Solution.message`."""
        advice = ""
        if not self.converged[row]:
            advice = load_advice(self.robot, self.tensions[row])
        if self.driven is not None:
            slack = self.driven["slack_lengths"][row]
            return actuation.message(
                self.status[row],
                self.stable[row],
                actuation.hanging(self.robot, slack) if self.converged[row] else (),
                bool(self.driven["undetermined"][row]),
                float(self.robot.tendons.friction.max()),
                self.driven["conflicts"].get(range(len(self))[row], ((), None)),
                float(self.residual[row]),
                int(self.iterations[row]),
                advice,
            )
        collision = int(self.collision[row])
        return _message(
            self.status[row],
            self.stable[row],
            bool(self.left_unstable[row]),
            float(self.fraction[row]),
            collision if collision >= 0 else None,
            float(self.residual[row]),
            int(self.iterations[row]),
            advice,
        )

    def raise_for_status(self) -> Self:
        """Return self if all rows converged, else raise.

        Raises
        ------
        NoSolutionError
            Names the first row that failed, and how many did.

        Warns
        -----
        StabilityWarning
            As that of a solution, for the first row of those.
        """
        failed = np.flatnonzero(~self.converged)
        if failed.size:
            first = int(failed[0])
            raise NoSolutionError(
                f"{self.robot.name}: {failed.size} of {len(self)} loads have no solution; "
                f"the first is row {first}: {self.message(first)}"
            )
        if not all(self.stable) and not self.robot.has_friction:
            row = [bool(stable) for stable in self.stable].index(False)
            said = f"{self.robot.name}: row {row}: {self.message(row)}"
            warnings.warn(said, StabilityWarning, stacklevel=2)
        return self


@short_repr
@dataclass(frozen=True, eq=False)
class Jacobians:
    """Derivatives of an equilibrium; made by `jacobians`.

    Rows are what changes, columns what changes it. S is the number of segments.

    Attributes
    ----------
    tip_position_by_tension, tip_rotation_by_tension, lengths_by_tension : ndarray
        (3, T) in m/N, (3, T) in rad/N, (T, T) in m/N. A rotation is a small turn of the tip as a
        rotation vector in the base frame: dR = [column]x R. Lengths are those of the tendons.
    tip_position_by_tip_force, tip_rotation_by_tip_force, lengths_by_tip_force : ndarray
        (3, 3) in m/N, (3, 3) in rad/N, (T, 3) in m/N.
    tip_position_by_tip_moment, tip_rotation_by_tip_moment, lengths_by_tip_moment : ndarray
        (3, 3) in m/(N m), (3, 3) in rad/(N m), (T, 3) in m/(N m).
    tip_position_by_stiffness, tip_rotation_by_stiffness, lengths_by_stiffness : ndarray
        (3, S) in m, (3, S) in rad, (T, S) in m: by the relative change of all stiffness of each
        segment's backbone (d/d ln E). E off by 1 % moves the tip by 0.01 times the sum of columns.
    """

    tip_position_by_tension: Floats
    tip_rotation_by_tension: Floats
    lengths_by_tension: Floats
    tip_position_by_tip_force: Floats
    tip_rotation_by_tip_force: Floats
    lengths_by_tip_force: Floats
    tip_position_by_tip_moment: Floats
    tip_rotation_by_tip_moment: Floats
    lengths_by_tip_moment: Floats
    tip_position_by_stiffness: Floats
    tip_rotation_by_stiffness: Floats
    lengths_by_stiffness: Floats


@short_repr
@dataclass(frozen=True, eq=False)
class PullJacobian:
    """Derivatives of an equilibrium by pulls; made by `pull_jacobian`.

    Rows are what changes, columns the tendon whose pull changes it. The column of a tendon that
    hangs is zero, that of one whose tension is given NaN.

    Attributes
    ----------
    tip_position_by_pull, tip_rotation_by_pull : ndarray
        (3, T) in m/m and (3, T) in rad/m, a rotation as in `Jacobians`.
    tensions_by_pull, lengths_by_pull : ndarray
        (T, T) in N/m, (T, T) in m/m.
    """

    tip_position_by_pull: Floats
    tip_rotation_by_pull: Floats
    tensions_by_pull: Floats
    lengths_by_pull: Floats


def solve(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    pulls: actuation.Given | None = None,
    angles: actuation.Given | None = None,
    history: Mapping[str, Any] | None = None,
    theory: Theory = "cosserat",
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = _NO_LOAD,
    tip_moment: ArrayLike = _NO_LOAD,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int | None = None,
) -> Solution:
    """Find the static equilibrium under a load, starting from the straight robot.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (T,), optional
        Tension of each tendon before its base hole in N, none negative.
    pulls : array_like (T,), optional
        Length that each actuator has taken in since the home pose in m; negative if paid out.
    angles : array_like (T,), optional
        Motor angles in rad, of tendons with a ``spool_radius``: the pull is the radius times the
        angle. Each tendon has exactly one of the three, None in the others.
    history : dict, optional
        `Solution.history` of the step before: its path is continued, which matters with friction.
        Without it the path begins in the home pose.
    theory : {"cosserat", "kirchhoff"}
        Backbone with or without shear and extension.
    gravity : array_like (3,), optional
        In m/s^2; the robot's own if left out.
    tip_force, tip_moment : array_like (3,)
        Dead loads at the tip in N and N m: they keep their direction.
    tendon : {"straight", "continuous"}
        How a tendon runs between two disks: straight, or along a curve parallel to the backbone
        (the model of many published codes, for comparison; by tensions and without friction).
    twist : bool
        Whether the backbone can twist.
    elements : {1, 2, 4, 8}, optional
        Elements of fourth order between two disks. Left out, as few as keep the estimated error of
        the tip within 1e-5 of length and that of tensions within 1e-4 of the largest.

    Returns
    -------
    Solution
        Look at its `converged`, or call its `raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> bs.solve(robot, [80, 0, 0]).raise_for_status().tip.position.round(4)
    array([0.3846, 0.    , 0.4448])

    Tendon 1 is shortened by 20 mm, the others are paid out and hang:

    >>> pulled = bs.solve(robot, pulls=[0.02, -0.03, -0.03])
    >>> pulled.tensions.round(2), pulled.slack
    (array([38.89,  0.  ,  0.  ]), (2, 3))
    """
    check_robot(robot)
    if _is_plain(robot, pulls, angles, history):
        if tensions is None:
            actuation.commands(robot, tensions, pulls, angles)
        return _solve(
            robot, tensions, theory, gravity, tip_force, tip_moment, tendon, twist, elements
        )
    pulled, commands = actuation.commands(robot, tensions, pulls, angles)
    physics = (theory, gravity, tip_force, tip_moment, tendon, twist, elements)
    return _drive(robot, pulled, commands, *physics, history)


def _drive(
    robot: Robot,
    pulled: NDArray[np.bool_],
    commands: Floats,
    theory: Theory,
    gravity: ArrayLike | None,
    tip_force: ArrayLike,
    tip_moment: ArrayLike,
    tendon: TendonPath,
    twist: bool,
    elements: int | None,
    before: Mapping[str, Any] | None,
) -> Solution:
    try:
        path = actuation.Path(robot, theory, tendon, twist, elements)
        if before is not None:
            path.resume(before)
        core = path.core.step(pulled, commands, gravity, tip_force, tip_moment)
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Solution(robot, core, path, before)


def _solve(
    robot: Robot,
    tensions: Any,
    theory: Theory,
    gravity: ArrayLike | None,
    tip_force: ArrayLike,
    tip_moment: ArrayLike,
    tendon: TendonPath,
    twist: bool,
    elements: int | None,
) -> Solution:
    if _is_complex(tensions):
        count = robot.core.tendon_count
        raise InputError(f"tensions is {tensions!r:.80}, it must be {count} numbers, in N")
    try:
        core = robot.core.solve(
            tensions, theory, gravity, tip_force, tip_moment, tendon, twist, elements
        )
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Solution(robot, core)


def sweep(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    pulls: actuation.Given | None = None,
    angles: actuation.Given | None = None,
    history: Mapping[str, Any] | None = None,
    theory: Theory = "cosserat",
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = _NO_LOAD,
    tip_moment: ArrayLike = _NO_LOAD,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int | None = None,
    warm: bool = True,
    disks: bool = True,
) -> Sweep:
    """Solve many loads in order in one call.

    With pulls, angles, a history or friction the rows are a path, each a step from the one before
    (from the last that converged).

    Parameters
    ----------
    robot : Robot
    tensions, pulls, angles : array_like (n, T), optional
        In N, m and rad, as for `solve`; NaN where a tendon is driven otherwise.
    history : dict, optional
        As for `solve`: where the first row starts from.
    gravity, tip_force, tip_moment : array_like (3,) or (n, 3)
        As for `solve`, for all rows or row by row.
    theory, tendon, twist, elements
        As for `solve`.
    warm : bool
        Start each load from the solution before it: faster where loads follow each other closely,
        and it stays on the branch of solutions. Otherwise each starts from straight, or from home
        (or from the history) where the rows would be a path.
    disks : bool
        Whether to return the poses of all disks.

    Returns
    -------
    Sweep
        Rows that did not converge hold NaN and are flagged.

    Raises
    ------
    InputError
        If an argument is wrong; the first bad row is named. Nothing is solved then.

    Examples
    --------
    >>> import numpy as np
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> res = bs.sweep(robot, np.outer(np.linspace(0, 80, 17), [1, 0, 0]))
    >>> res.tip_position.shape
    (17, 3)
    """
    check_robot(robot)
    loads = _dead_loads(gravity, tip_force, tip_moment)
    physics = (tendon, twist, elements)
    if not _is_plain(robot, pulls, angles, history):
        driven = (tensions, pulls, angles, history)
        return _follow(robot, driven, loads, theory, physics, disks, path=warm, threads=1)
    rows = _rows(tensions, "tensions", robot)
    try:
        found = robot.core.sweep(rows, theory, *loads, *physics, warm, disks)
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Sweep(robot, rows.copy(), theory, **found, physics=physics)


def solve_batch(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    pulls: actuation.Given | None = None,
    angles: actuation.Given | None = None,
    theory: Theory = "cosserat",
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = _NO_LOAD,
    tip_moment: ArrayLike = _NO_LOAD,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int | None = None,
    threads: int = 0,
    disks: bool = True,
) -> Sweep:
    """Solve many independent loads, each from the straight robot or from home, on all cores.

    Parameters
    ----------
    robot, tensions, pulls, angles, gravity, tip_force, tip_moment, theory, tendon, twist, \
elements, disks
        As for `sweep`.
    threads : int
        Number of threads; 0 takes one for each core. The answers do not depend on it.

    Returns
    -------
    Sweep
        Rows that did not converge hold NaN and are flagged.

    Raises
    ------
    InputError
        If an argument is wrong; the first bad row is named. Nothing is solved then.
    """
    if not (isinstance(threads, int) and 0 <= threads <= 1024):
        raise InputError(f"threads is {threads!r}, it must be a whole number from 0 to 1024")
    check_robot(robot)
    loads = _dead_loads(gravity, tip_force, tip_moment)
    physics = (tendon, twist, elements)
    if not _is_plain(robot, pulls, angles, None):
        driven = (tensions, pulls, angles, None)
        return _follow(robot, driven, loads, theory, physics, disks, path=False, threads=threads)
    rows = _rows(tensions, "tensions", robot)
    try:
        found = robot.core.solve_batch(rows, theory, *loads, *physics, threads, disks)
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Sweep(robot, rows.copy(), theory, **found, physics=physics)


def _is_plain(robot: Robot, pulls: object, angles: object, history: object) -> bool:
    """Whether tensions alone say it all: no lengths and no friction."""
    return pulls is None and angles is None and history is None and not robot.has_friction


def _follow(
    robot: Robot,
    driven: tuple[
        actuation.Given | None,
        actuation.Given | None,
        actuation.Given | None,
        Mapping[str, Any] | None,
    ],
    loads: tuple[Any, Any, Any],
    theory: Theory,
    physics: tuple[TendonPath, bool, int | None],
    disks: bool,
    *,
    path: bool,
    threads: int,
) -> Sweep:
    *given, before = driven
    pulled, commands = actuation.commands(robot, *given, rows=True)
    try:
        way = actuation.Path(robot, theory, *physics)
        if before is not None:
            way.resume(before)
        found = way.core.follow(pulled, commands, *loads, disks, path, threads)
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, *physics) from None
    names = ("pulls", "slack_lengths", "span_tensions", "undetermined", "conflicts")
    extra = {name: found.pop(name) for name in (*names, "length_residual")}
    extra["history"] = way.history() if path else None
    return Sweep(robot, theory=theory, **found, physics=physics, driven=extra)


def joined(parts: Sequence[tuple[NDArray[np.int64], Sweep]]) -> Sweep:
    """Sweeps of parts of the rows as one; it has no history, for it is no single path.

    Parameters
    ----------
    parts : sequence of (ndarray of int, Sweep)
        Rows of each sweep in the whole; of one robot and the same options.

    Returns
    -------
    Sweep
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
        if field.name not in ("robot", "theory", "physics", "driven")
    }
    driven = [sweep.driven for sweep in sweeps]
    extra = None
    if all(each is not None for each in driven):
        extra = {
            name: whole([(each or {})[name] for each in driven])
            for name in driven[0] or {}
            if name not in ("history", "conflicts")
        }
        conflicts = zip(parts, driven, strict=True)
        extra["conflicts"] = {
            int(rows[k]): why
            for (rows, _), each in conflicts
            for k, why in (each or {})["conflicts"].items()
        }
        extra["history"] = None
    first = sweeps[0]
    return Sweep(first.robot, theory=first.theory, physics=first.physics, driven=extra, **rows)


def jacobians(solution: Solution) -> Jacobians:
    """Differentiate an equilibrium by tensions, tip load and stiffness.

    Exact, from the sweep of one Newton step more, at the same `elements`.

    Parameters
    ----------
    solution : Solution
        Converged, with straight tendons.

    Returns
    -------
    Jacobians

    Raises
    ------
    NoSolutionError
        If the solution did not converge.
    InputError
        If its tendons are continuous or rub, for which there are no derivatives.

    Examples
    --------
    How far one more newton on tendon 1 moves the tip, in mm:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> by = bs.jacobians(bs.solve(robot, [40, 0, 0]))
    >>> (1e3 * by.tip_position_by_tension[:, 0]).round(2)
    array([ 5.03,  0.  , -2.55])
    """
    solution.raise_for_status()
    if solution.robot.has_friction:
        raise InputError(
            f"the tendons of {solution.robot.name} rub at their holes: what a tendon does then "
            "depends on which way it goes, and there are no derivatives; set friction to 0"
        )
    if solution.tendon == "continuous":
        raise InputError(
            'the solution has tendon="continuous", for which there are no derivatives; '
            'solve with tendon="straight"'
        )
    found = solution.core.jacobians()
    if found is None:
        raise NoSolutionError(f"{solution.robot.name}: no derivatives at this equilibrium")
    return Jacobians(**found)


def pull_jacobian(solution: Solution) -> PullJacobian:
    """Differentiate an equilibrium by pulls: what the robot does when a motor turns.

    From the derivatives by tensions and the stretch of the tendons.

    Parameters
    ----------
    solution : Solution
        Converged, with straight tendons and without friction. The tendons that hold their pull are
        those that were pulled and are taut; after a solve by tensions alone, all that are taut.

    Returns
    -------
    PullJacobian

    Raises
    ------
    NoSolutionError
        If the solution did not converge.
    InputError
        With friction, with continuous tendons, and where the taut tendons cannot be pulled one by
        one: without extension and stretch, three of them to a segment.

    Examples
    --------
    How far one more millimetre on tendon 1 moves the tip, in mm:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> by = bs.pull_jacobian(bs.solve(robot, pulls=[0.02, -0.03, -0.03]))
    >>> by.tip_position_by_pull[:, 0].round(2)
    array([ 9.63,  0.  , -4.73])
    """
    by = jacobians(solution)
    tensions, pulled = solution.tensions, solution.core.pulled
    driven = np.ones(len(tensions), bool) if pulled is None or not pulled.any() else pulled
    held = np.flatnonzero(driven & (tensions > 0))
    # pull = home - length + compliance * tension
    answer = np.diag(actuation.compliances(solution.robot)) - by.lengths_by_tension
    block = answer[np.ix_(held, held)]
    tensions_by_pull = np.zeros_like(answer)
    if held.size:
        if np.linalg.cond(block) > 1e10:
            raise InputError(
                "the taut tendons cannot be pulled one by one, as the backbone does not shorten: "
                'solve with theory="cosserat", or with fewer taut tendons'
            )
        tensions_by_pull[np.ix_(held, held)] = np.linalg.inv(block)
    tensions_by_pull[:, ~driven] = np.nan
    return PullJacobian(
        tip_position_by_pull=by.tip_position_by_tension @ tensions_by_pull,
        tip_rotation_by_pull=by.tip_rotation_by_tension @ tensions_by_pull,
        tensions_by_pull=tensions_by_pull,
        lengths_by_pull=by.lengths_by_tension @ tensions_by_pull,
    )


def _is_complex(values: Any) -> bool:
    """Whether imaginary parts would be dropped, of which NumPy only warns."""
    return isinstance(values, np.ndarray) and values.dtype.kind == "c"


def _array(values: Any, name: str, shape: str) -> Floats:
    try:
        if _is_complex(values):
            raise TypeError
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{name} must be numbers of shape {shape}, as a list or an array"
        ) from None
    except MemoryError:
        raise validation.too_large(values) from None


def _rows(tensions: actuation.Given | None, name: str, robot: Robot) -> Floats:
    if tensions is None:
        actuation.commands(robot, None, None, None)  # which says what is missing
    count = robot.core.tendon_count
    rows = _array(tensions, name, f"(n, {count})")
    if rows.ndim != 2:
        raise InputError(
            f"{name} has shape {rows.shape}, it must have one row for each load and {count} "
            "columns, one for each tendon"
        )
    return rows


def _dead_loads(gravity: ArrayLike | None, tip_force: ArrayLike, tip_moment: ArrayLike) -> Any:
    """Gravity, tip force and tip moment, of all rows or row by row."""
    return (
        _loads(gravity, "gravity"),
        _loads(tip_force, "tip_force"),
        _loads(tip_moment, "tip_moment"),
    )


def _loads(values: ArrayLike | None, name: str) -> Floats | Sequence[float] | None:
    return None if values is None else _array(values, name, "(3,) or (n, 3)")


def _wrong_choice(
    error: Exception, theory: object, tendon: object, twist: object, elements: object
) -> InputError:
    """Say which of the arguments that are not arrays has the wrong type."""
    try:
        check_choices(theory, tendon, twist, elements, automatic=True)
    except InputError as wrong:
        return wrong
    return InputError(f"an argument has the wrong type: {error}")


def _coarse(found: ErrorEstimate, tensions: Floats, length: float, elements: int | None) -> str:
    """A sentence if an answer is less exact than elements are chosen for, else nothing."""
    largest = float(np.nanmax(tensions, initial=0.0))
    tip, tension = found.tip > 1e-5 * length, found.tension > 1e-4 * largest
    if not (tip or tension):
        return ""
    parts = [f"tip by up to {1e3 * found.tip:.2g} mm"] if tip else []
    parts += [f"tensions by up to {found.tension:.2g} N"] if tension else []
    what = " and ".join(parts)
    cure = "" if elements == 8 else " Leave the number of elements out, or take more."
    return f" Discretisation error: the {what} ({elements} per module).{cure}"


def _message(
    status: str,
    stable: bool | None,
    left_unstable: bool,
    fraction: float,
    collision: int | None,
    residual: float,
    iterations: int,
    advice: str = "",
) -> str:
    match status:
        case "converged":
            if left_unstable and stable:
                return (
                    "The robot buckled: the way from straight led to an unstable equilibrium; "
                    "one of several stable branches is returned. A small load to one side chooses "
                    "the branch."
                )
            if stable is False:
                return (
                    "An equilibrium, but not a stable one: the tip moment, which keeps its "
                    "direction, leads to it from a stable one, and small motions about it grow."
                )
            if stable is None:
                return (
                    "An equilibrium; whether it is stable is not known: a tip moment has no "
                    "potential and lets small oscillations grow unless they are damped by more "
                    "than 1 %, or so few elements do not tell."
                )
            return "A stable equilibrium."
        case "no_equilibrium":
            k = collision if collision is not None else 0
            disks = "the base and disk 1" if k == 0 else f"disks {k} and {k + 1}"
            return (
                f"No equilibrium: {disks} collide, because the load closes the gap between them. "
                f"{advice}Check the tensions, or lower the load."
            )
        case "unstable":
            return (
                "Only an unstable equilibrium was found, and four attempts to leave it led back. "
                "Add a small load to one side, or approach this load by a sweep."
            )
        case _:
            reached = "none of the load" if fraction == 0 else f"{100 * fraction:.3g} % of the load"
            left = f" (residual {residual:.2g})" if np.isfinite(residual) else ""
            return (
                f"No equilibrium was found: {reached} converged, then the solver gave up after "
                f"{iterations} iterations{left}. A pulled tendon or the compressed backbone "
                f"between two disks is probably at its limit (buckling between disks). {advice}"
                "Lower the load."
            )
