"""Result of inverse kinematics."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.display import html_table, millimetres, sampled_rows
from bowstring.errors import InputError, NoSolutionError, StabilityWarning
from bowstring.formatting import in_mm, listed, significant
from bowstring.pose import Pose
from bowstring.results import Key, Result
from bowstring.statics import actuation
from bowstring.statics.load import Load
from bowstring.statics.rod import solve_batch, sweep
from bowstring.statics.solution import Sweep
from bowstring.validation import choice

if TYPE_CHECKING:
    from typing_extensions import Self

    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

InverseStatus = Literal["reached", "unreachable", "max_iterations", "no_equilibrium"]


@dataclass(frozen=True)
class BindingLimit(Result):
    """Limit that keeps the tip from the wanted position."""

    tendon: Annotated[int, Key()]
    """Tendon, from 1."""
    limit: Annotated[Literal["least", "largest"], Key()]
    """Which of its limits."""
    of: Annotated[Literal["tension", "displacement"], Key()]
    """Limited quantity."""


@dataclass(frozen=True, kw_only=True)
class InverseRow(Result):
    """Result of `InverseSolution.to_dict` for one position."""

    status: Annotated[InverseStatus, Key()]
    """``reached``, or why not: ``unreachable``, the tip is the nearest found; ``max_iterations``;
    ``no_equilibrium``."""
    message: Annotated[str, Key()]
    """Status as a sentence."""
    stable: Annotated[bool | None, Key()]
    """Whether the equilibrium is stable; None by constant curvature."""
    iterations: Annotated[int, Key()]
    """Number of iterations of all starts."""
    restarted: Annotated[bool, Key()]
    """Whether a row of a path was found from another start than the previous row."""
    elements: Annotated[int, Key()]
    """Elements between two disks; 0 by constant curvature."""
    position: Annotated[Floats, Key("position_m")]
    """Wanted position of the tip (3,), m."""
    direction: Annotated[Floats | None, Key()]
    """Wanted direction of the tangent at the tip (3,); None without one."""
    distance: Annotated[float, Key("distance_m")]
    """Distance from the tip to the wanted position, m; NaN without an equilibrium."""
    nearest_distance: Annotated[float, Key("nearest_distance_m")]
    """Distance from the nearest tip that was found, perhaps with larger tensions, m; NaN without an
    equilibrium."""
    direction_error: Annotated[float, Key("direction_error_rad")]
    """Angle between the tangent at the tip and the wanted direction, rad; NaN without one."""
    tip: Annotated[Pose | None, Key()]
    """Tip by the model; None without an equilibrium."""
    tensions: Annotated[Floats, Key("tensions_N")]
    """Tension of each tendon (T,), N; NaN without an equilibrium."""
    displacements: Annotated[Floats | None, Key("displacements_m")]
    """Displacement of each tendon (T,), m, NaN without an equilibrium; None without a home pose."""
    tendon_lengths: Annotated[Floats, Key("tendon_lengths_m")]
    """Length of each tendon (T,), m; NaN without an equilibrium."""
    binding: Annotated[list[BindingLimit], Key()]
    """Limits that keep the nearest tip from the wanted position."""
    tip_error: Annotated[float, Key("tip_error_m")]
    """Estimated discretisation error of the tip, m; NaN by constant curvature."""


@dataclass(frozen=True, eq=False, repr=False)
class InverseSolution:
    """Tensions for positions of the tip; made by `inverse_kinematics`.

    Arrays have the shape that is stated for one position. For n positions they have a leading
    dimension n, and a value of a position is a list or an array of n.

    Attributes
    ----------
    robot : Robot
    model : RodModel or "constant_curvature"
    load : Load
        Dead loads of the equilibria; without tensions.
    position : ndarray (3,)
        Wanted position of the tip in m.
    direction : ndarray (3,) or None
        Wanted direction of the tangent at the tip, of length one.
    min_tension, max_tension : ndarray (T,)
        Limits of the tensions in N.
    status : str or list of str
        ``"reached"``, the tip is within 1e-6 of the robot's length of the wanted position (with a
        direction, distance over length and error of the direction together are);
        ``"unreachable"``, limits or robot do not allow it, as far as small changes of tension from
        several starts show; ``"max_iterations"``, a nearer tip may exist, the iteration did not
        converge; ``"no_equilibrium"``, the loads have no stable equilibrium, and the numbers are
        NaN.
    tensions : ndarray (T,)
        Tensions in N. Where the position is reached, the least sum of squares near them that leads
        to the same tip; where it is not, the least that was found with a tip within the margin of
        the nearest one.
    tip_position, tip_rotation : ndarray (3,) in m, (3, 3)
        Pose of the tip under the tensions, by the model.
    distance : float or ndarray
        Distance from the tip to the wanted position, m.
    nearest_distance : float or ndarray
        Distance from the nearest tip that was found to the wanted position, m; that of a position
        with a direction belongs to the nearest pose. It is below `distance` where a margin was used
        for smaller tensions.
    direction_error : float or ndarray
        Angle between the tangent at the tip and the wanted direction, rad; NaN without one.
    tendon_lengths : ndarray (T,)
        In m.
    binding : ndarray of int (T,)
        Where the position is not reached: -1 if the least tension keeps the nearest tip from coming
        nearer, 1 if the largest does, -2 and 2 for the least and the largest displacement,
        otherwise 0. Zeros where it is reached.
    stable : bool, None, or a list of them
        As `Solution.stable`; None by constant curvature.
    iterations : int or ndarray of int
        Gauss-Newton iterations of all starts.
    restarted : bool or ndarray of bool
        Whether a row of a path was found from another start than the previous row, or by leaving
        a saddle to which that leads, so that the robot may jump between them.
    elements : int or ndarray of int
        Elements in a module; 0 by constant curvature.
    tip_error : float or ndarray
        Estimated discretisation error of the tip in m; NaN by constant curvature.
    arcs : RobotArcs or None
        Arcs by constant curvature.
    held_displacements : ndarray (T,) or None
        Displacements of tendons with friction, which depend on the path; None without friction.
    displacement_limits : (ndarray (T,), ndarray (T,)) or None
        Least and largest displacements in m, if they are limited.
    """

    robot: Robot
    model: RodModel | Literal["constant_curvature"]
    load: Load
    position: Floats
    direction: Floats | None
    min_tension: Floats
    max_tension: Floats
    status: Any
    tensions: Floats
    tip_position: Floats
    tip_rotation: Floats
    distance: Any
    nearest_distance: Any
    direction_error: Any
    tendon_lengths: Floats
    binding: NDArray[np.int8]
    stable: Any
    iterations: Any
    restarted: Any
    elements: Any
    tip_error: Any
    arcs: RobotArcs | None = None
    held_displacements: Floats | None = None
    displacement_limits: tuple[Floats, Floats] | None = None

    def __len__(self) -> int:
        if self.position.ndim == 1:
            raise TypeError("the result for one position has no length")
        return len(self.position)

    @property
    def reached(self) -> Any:
        """Whether the tip is reached: bool, or ndarray of bool (n,)."""
        if self.position.ndim == 1:
            return bool(self.status == "reached")
        return np.array([word == "reached" for word in self.status], dtype=bool)

    @property
    def tip(self) -> Pose:
        """Pose of the tip under the tensions."""
        return Pose(self.tip_position, self.tip_rotation)

    def displacements(self) -> Floats | None:
        """Tendon displacements to command, since the home pose in m, positive where shortened.

        By physics with the compliance of the tendons. By constant curvature from the lengths of the
        arcs alone. Gain and zero of the drives are taken out.

        Returns
        -------
        ndarray (T,), or (n, T), or None
            None if the robot's pretension has no home pose.
        """
        robot, lengths = self.robot, self.tendon_lengths
        found: Floats | None
        if self.held_displacements is not None:
            found = self.held_displacements
        elif isinstance(self.model, str):
            found = robot.disks.station_m[robot.tendons.end_disk] - lengths
        else:
            found = actuation.displacements(robot, self.model, lengths, self.tensions)
        return None if found is None else actuation.commanded(robot, found)

    def land(
        self,
        *,
        control: Literal["tensions", "displacements"] = "tensions",
        load: Load | None = None,
        model: RodModel | None = None,
    ) -> Sweep:
        """Equilibria by physics under the commands.

        Parameters
        ----------
        control : {"tensions", "displacements"}
            Which of the commands the motors hold. Displacements, and tensions of tendons with
            friction, are followed as a path from the home pose.
        load : Load, optional
            Dead loads; by default those of the result.
        model : RodModel, optional
            As for `bowstring.solve`; by default that of the result.

        Returns
        -------
        Sweep
            Of one row for one position. Rows without commands have the status
            ``"no_equilibrium"`` and NaN.
        """
        choice("control", control, ("tensions", "displacements"))
        given = self.load if load is None else load
        if not isinstance(given, Load):
            raise InputError(f"load is {given!r:.60}, it must be a bowstring.Load")
        if model is None and not isinstance(self.model, str):
            model = self.model
        values = self.tensions if control == "tensions" else self.displacements()
        if values is None:
            raise InputError(f"{self.robot.name} has no home pose, so there are no displacements")
        rows = np.atleast_2d(values)
        failed = np.asarray(~np.isfinite(rows).all(axis=1))
        rows = np.where(failed[:, None], 0.0, rows)
        if control == "tensions" and not self.robot.has_friction:
            landed = solve_batch(self.robot, rows, load=given, model=model)
        else:
            landed = sweep(self.robot, load=given.replace(**{control: rows}), model=model)
        return _without(landed, failed) if failed.any() else landed

    def __repr__(self) -> str:
        if self.position.ndim == 1:
            tensions = ", ".join(f"{v:.6g}" for v in self.tensions)
            return (
                f"<InverseSolution of {self.robot.name}: {self.status}, tensions {tensions} N, "
                f"distance {in_mm(float(self.distance))}>"
            )
        done = int(self.reached.sum())
        return f"<InverseSolution of {self.robot.name}: {done} of {len(self)} positions reached>"

    def _repr_html_(self) -> str:
        single = self.position.ndim == 1

        def row(k: int) -> tuple[object, ...]:
            at: Any = ... if single else k
            return (
                millimetres(self.position[at]),
                ", ".join(f"{v:.6g}" for v in self.tensions[at]),
                in_mm(float(np.asarray(self.distance)[at])),
                self.status if single else self.status[k],
            )

        count = 1 if single else len(self)
        header = ("position", "tensions, N", "distance", "status")
        return html_table(repr(self).strip("<>"), sampled_rows(count, row), header)

    def message(self, row: int | None = None) -> str:
        """Status of the inverse of a position, as a sentence.

        Parameters
        ----------
        row : int, optional
            Index of the position; left out for a result of one position.

        Returns
        -------
        str
            Status, distance and binding limits.
        """
        single = self.position.ndim == 1
        if single != (row is None):
            raise InputError("row is the index of a position, left out for one position")
        at: Any = ... if row is None else row
        status = self.status if row is None else self.status[row]
        if status == "no_equilibrium":
            within = "" if self.displacement_limits is None else " within the limits"
            return (
                f"The robot has no stable equilibrium{within} under the loads from which to start."
            )
        distance = in_mm(float(np.asarray(self.distance)[at]))
        if status == "reached":
            return f"The tip is reached, within {distance}."
        said = f"The tip comes within {distance} of the position"
        if self.direction is not None:
            angle = np.degrees(float(np.asarray(self.direction_error)[at]))
            said += f" and {significant(angle)} deg of the direction"
        nearest = float(np.asarray(self.nearest_distance)[at])
        nearer = nearest < float(np.asarray(self.distance)[at])
        if nearer:
            said += f", with larger tensions within {in_mm(nearest)}"
        if status == "max_iterations":
            return said + ", and may come nearer: the iteration did not converge."
        binding = self.binding[at]
        parts = []
        low, high = self.displacement_limits or (self.min_tension, self.max_tension)
        for value, what, limit, unit in (
            (1, "largest tension", self.max_tension, "N"),
            (-1, "least tension", self.min_tension, "N"),
            (2, "largest displacement", 1e3 * high, "mm"),
            (-2, "least displacement", 1e3 * low, "mm"),
        ):
            tendons = np.flatnonzero(binding == value)
            if tendons.size:
                each = [f"{i + 1} ({significant(limit[i])} {unit})" for i in tendons]
                named = f"tendon {each[0]}" if len(each) == 1 else f"tendons {listed(each)}"
                parts.append(f"the {what} of {named}")
        if parts:
            binds = "bind" if (binding != 0).sum() > 1 else "binds"
            return f"{said}{', where' if nearer else ';'} {listed(parts)} {binds}."
        return f"{said}; no limit binds: the robot does not reach it from there."

    def raise_for_status(self) -> Self:
        """Return self if all positions are reached, else raise.

        Raises
        ------
        NoSolutionError
            The message has the first position that is not reached, and their number.

        Warns
        -----
        StabilityWarning
            If an equilibrium is unstable, or its stability is unknown.
        """
        reached = np.atleast_1d(self.reached)
        failed = np.flatnonzero(~reached)
        if failed.size:
            k = int(failed[0])
            if self.position.ndim == 1:
                raise NoSolutionError(f"{self.robot.name}: {self.message()}", status=self.status)
            raise NoSolutionError(
                f"{self.robot.name}: {failed.size} of {len(self)} positions are not reached, first "
                f"row {k + 1}: {self.message(k)}",
                status=self.status[k],
            )
        stable = [self.stable] if self.position.ndim == 1 else self.stable
        if self.arcs is None and not all(stable):
            warnings.warn(
                f"{self.robot.name}: an equilibrium of the inverse is unstable, or its stability "
                "is unknown",
                StabilityWarning,
                stacklevel=2,
            )
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return plain values with units in the names, ready for `json.dumps`.

        Returns
        -------
        dict
            ``status, message, stable, iterations, restarted, elements, position_m, direction,
            distance_m, nearest_distance_m, direction_error_rad, tip, tensions_N, displacements_m,
            tendon_lengths_m, binding, tip_error_m``; for n positions ``count, reached, rows``.
        """
        displacements = self.displacements()
        if self.position.ndim == 1:
            return self._row(None, displacements).to_dict()
        rows = [self._row(k, displacements).to_dict() for k in range(len(self))]
        return {"count": len(self), "reached": int(self.reached.sum()), "rows": rows}

    def _row(self, row: int | None, displacements: Floats | None) -> InverseRow:
        at: Any = ... if row is None else row

        def value(name: str) -> Any:
            found = getattr(self, name)
            return found if row is None else found[row]

        tip = Pose(self.tip_position[at], self.tip_rotation[at])
        shared = ("stable", "iterations", "restarted", "elements", "distance", "nearest_distance")
        return InverseRow(
            status=value("status"),
            message=self.message(row),
            **{name: value(name) for name in (*shared, "direction_error", "tip_error")},
            position=self.position[at],
            direction=None if self.direction is None else self.direction[at],
            tip=None if value("status") == "no_equilibrium" else tip,
            tensions=self.tensions[at],
            displacements=None if displacements is None else displacements[at],
            tendon_lengths=self.tendon_lengths[at],
            binding=[
                BindingLimit(
                    int(i) + 1,
                    "least" if limit < 0 else "largest",
                    "tension" if abs(limit) == 1 else "displacement",
                )
                for i, limit in enumerate(self.binding[at])
                if limit
            ],
        )


def _without(landed: Sweep, failed: Bools) -> Sweep:
    """Equilibria less those of rows that have no commands."""
    changed: dict[str, Any] = {
        "status": [
            "no_equilibrium" if lost else word
            for word, lost in zip(landed.status, failed, strict=True)
        ],
        "stable": [
            None if lost else stable for stable, lost in zip(landed.stable, failed, strict=True)
        ],
        "converged": landed.converged & ~failed,
    }
    for field in fields(landed):
        value = getattr(landed, field.name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            rows = failed.reshape(-1, *[1] * (value.ndim - 1))
            changed[field.name] = np.where(rows, np.nan, value)
    return replace(landed, **changed)
