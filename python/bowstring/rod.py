"""Statics of a robot: backbone as an elastic rod, rigid disks, tendons straight between them.

Everything is SI, in the base frame (z along the straight backbone) unless said otherwise.
A rotation maps body to base. N is the number of disks, T the number of tendons.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.arguments import check_choices
from bowstring.errors import InputError, NoSolutionError

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

    from bowstring import _core
    from bowstring.robot import Robot

__all__ = [
    "Jacobians",
    "Pose",
    "Solution",
    "Sweep",
    "jacobians",
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


class Solution:
    """The answer to one load; made by `solve`.

    Numbers of the pose are None unless `converged`. Every access returns a fresh array.

    Attributes
    ----------
    robot : Robot
    status : str
        ``"converged"``, or why not: ``"max_iterations"``, ``"unstable"`` (an equilibrium was
        found, but no stable one), ``"no_equilibrium"`` (disks collide).
    converged : bool
    stable : bool or None
        Whether the energy has a minimum here. None under a tip moment, which has no potential.
    iterations : int
        Newton steps, those of continuation included.
    residual : float
        Largest moment imbalance over (bending stiffness / length).
    theory, tendon, twist, elements
        As given to `solve`.
    tensions : ndarray (T,)
        In N; with `gravity` (m/s^2), `tip_force` (N) and `tip_moment` (N m), each (3,), the load.

    A solution is pickled and copied as its load, and solved anew, which gives the same numbers.
    """

    __slots__ = ("core", "robot")

    def __init__(self, robot: Robot, core: _core.Solution) -> None:
        self.robot = robot
        self.core = core

    def __repr__(self) -> str:
        position = self.core.tip_position
        if position is not None:
            x, y, z = 1e3 * position
            return f"<Solution of {self.robot.name}: tip at ({x:.3f}, {y:.3f}, {z:.3f}) mm>"
        return f"<Solution of {self.robot.name}: {self.status}>"

    def __reduce__(self) -> tuple[Any, ...]:
        c = self.core
        load = (c.tensions, c.theory, c.gravity, c.tip_force, c.tip_moment)
        return _solve, (self.robot, *load, c.tendon, c.twist, c.elements)

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
        message = _message(
            core.status,
            core.stable,
            core.left_unstable,
            core.fraction,
            core.collision,
            core.residual,
            core.iterations,
        )
        return message + _coarse(core.disk_rotations, core.elements)

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
            As of a run (`bowstring.fields`), with one time.

        Raises
        ------
        NoSolutionError
            If the solution did not converge.
        """
        from bowstring import dynamics
        from bowstring import fields as labelled

        self.raise_for_status()
        load: dict[str, Any] = {
            "tip_force": self.tip_force,
            "tip_moment": self.tip_moment,
            "gravity": self.gravity.tolist(),
            "theory": self.theory,
            "tendon": self.tendon,
            "twist": self.twist,
            "elements": self.elements,
        }
        frames = dynamics.at_rest(self.robot, self.tensions, points=points, **load)
        settings = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in load.items()}
        settings["tensions_N"] = self.tensions.tolist()
        return labelled.to_dataset(self.robot, frames, settings, status=self.status)

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise.

        Raises
        ------
        NoSolutionError
            The text says what was reached and what to try.
        """
        if not self.converged:
            raise NoSolutionError(f"{self.robot.name}: {self.message}", status=self.status)
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``bowstring solve --json``, ready for `json.dumps`.

        Returns
        -------
        dict
            ``status, stable, iterations, residual, theory, tip, disks, tendon_lengths_m,
            tensions_N``; the pose's entries are None if the solve failed, as is a residual that
            is not finite.
        """
        core = self.core
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
            "residual": core.residual if np.isfinite(core.residual) else None,
            "theory": core.theory,
            "tip": tip,
            "disks": disks,
            "tendon_lengths_m": lengths,
            "tensions_N": core.tensions.tolist(),
        }


@dataclass(repr=False, eq=False)  # not frozen: that would cost 4 us a sweep
class Sweep:
    """The answers to n loads; made by `sweep` and `solve_batch`.

    Rows that did not converge hold NaN.

    Attributes
    ----------
    robot : Robot
    tensions : ndarray (n, T)
        In N.
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

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        done = int(self.converged.sum())
        return f"<Sweep of {self.robot.name}: {done} of {len(self)} loads converged>"

    def message(self, row: int) -> str:
        """One sentence on how a row ended, as `Solution.message`."""
        collision = int(self.collision[row])
        return _message(
            self.status[row],
            self.stable[row],
            bool(self.left_unstable[row]),
            float(self.fraction[row]),
            collision if collision >= 0 else None,
            float(self.residual[row]),
            int(self.iterations[row]),
        )

    def raise_for_status(self) -> Self:
        """Return self if all rows converged, else raise.

        Raises
        ------
        NoSolutionError
            Names the first row that failed, and how many did.
        """
        failed = np.flatnonzero(~self.converged)
        if failed.size:
            first = int(failed[0])
            raise NoSolutionError(
                f"{self.robot.name}: {failed.size} of {len(self)} loads have no solution; "
                f"the first is row {first}: {self.message(first)}"
            )
        return self


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


def solve(
    robot: Robot,
    tensions: ArrayLike,
    *,
    theory: Theory = "cosserat",
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = _NO_LOAD,
    tip_moment: ArrayLike = _NO_LOAD,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int = 1,
) -> Solution:
    """Find the static equilibrium under a load, starting from the straight robot.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (T,)
        Tension of each tendon in N, none negative.
    theory : {"cosserat", "kirchhoff"}
        Backbone with or without shear and extension.
    gravity : array_like (3,), optional
        In m/s^2; the robot's own if left out.
    tip_force, tip_moment : array_like (3,)
        Dead loads at the tip in N and N m: they keep their direction.
    tendon : {"straight", "continuous"}
        How a tendon runs between two disks: straight, or along a curve parallel to the backbone
        (the model of many published codes, for comparison).
    twist : bool
        Whether the backbone can twist.
    elements : {1, 2, 4, 8}
        Elements of fourth order between two disks. They refine bending and torsion; shear and
        extension stay averaged over a module.

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
    """
    return _solve(robot, tensions, theory, gravity, tip_force, tip_moment, tendon, twist, elements)


def _solve(
    robot: Robot,
    tensions: ArrayLike,
    theory: Theory,
    gravity: ArrayLike | None,
    tip_force: ArrayLike,
    tip_moment: ArrayLike,
    tendon: TendonPath,
    twist: bool,
    elements: int,
) -> Solution:
    try:
        core = robot.core.solve(
            tensions, theory, gravity, tip_force, tip_moment, tendon, twist, elements
        )
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Solution(robot, core)


def sweep(
    robot: Robot,
    tensions: ArrayLike,
    *,
    theory: Theory = "cosserat",
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = _NO_LOAD,
    tip_moment: ArrayLike = _NO_LOAD,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int = 1,
    warm: bool = True,
    disks: bool = True,
) -> Sweep:
    """Solve many loads in order in one call.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (n, T)
        In N, none negative.
    gravity, tip_force, tip_moment : array_like (3,) or (n, 3)
        As for `solve`, for all rows or row by row.
    theory, tendon, twist, elements
        As for `solve`.
    warm : bool
        Start each load from the solution before it: faster where loads follow each other closely,
        and it stays on the branch of solutions. Otherwise each starts from straight.
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
    rows = _rows(tensions, "tensions", robot)
    try:
        found = robot.core.sweep(
            rows,
            theory,
            _loads(gravity, "gravity"),
            _loads(tip_force, "tip_force"),
            _loads(tip_moment, "tip_moment"),
            tendon,
            twist,
            elements,
            warm,
            disks,
        )
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Sweep(robot, rows.copy(), theory, **found)


def solve_batch(
    robot: Robot,
    tensions: ArrayLike,
    *,
    theory: Theory = "cosserat",
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = _NO_LOAD,
    tip_moment: ArrayLike = _NO_LOAD,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int = 1,
    threads: int = 0,
    disks: bool = True,
) -> Sweep:
    """Solve many independent loads, each from the straight robot, on all cores.

    Parameters
    ----------
    robot, tensions, gravity, tip_force, tip_moment, theory, tendon, twist, elements, disks
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
    rows = _rows(tensions, "tensions", robot)
    if not (isinstance(threads, int) and 0 <= threads <= 1024):
        raise InputError(f"threads is {threads!r}, it must be a whole number from 0 to 1024")
    try:
        found = robot.core.solve_batch(
            rows,
            theory,
            _loads(gravity, "gravity"),
            _loads(tip_force, "tip_force"),
            _loads(tip_moment, "tip_moment"),
            tendon,
            twist,
            elements,
            threads,
            disks,
        )
    except (TypeError, OverflowError) as error:
        raise _wrong_choice(error, theory, tendon, twist, elements) from None
    return Sweep(robot, rows.copy(), theory, **found)


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
        If its tendons are continuous, for which there are no derivatives.

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
    if solution.tendon == "continuous":
        raise InputError(
            'the solution has tendon="continuous", for which there are no derivatives; '
            'solve with tendon="straight"'
        )
    found = solution.core.jacobians()
    if found is None:
        raise NoSolutionError(f"{solution.robot.name}: no derivatives at this equilibrium")
    return Jacobians(**found)


def _array(values: Any, name: str, shape: str) -> Floats:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{name} must be numbers of shape {shape}, as a list or an array"
        ) from None


def _rows(tensions: ArrayLike, name: str, robot: Robot) -> Floats:
    count = robot.core.tendon_count
    rows = _array(tensions, name, f"(n, {count})")
    if rows.ndim != 2:
        raise InputError(
            f"{name} has shape {rows.shape}, it must have one row for each load and {count} "
            "columns, one for each tendon"
        )
    return rows


def _loads(values: ArrayLike | None, name: str) -> Floats | Sequence[float] | None:
    return None if values is None else _array(values, name, "(3,) or (n, 3)")


def _wrong_choice(
    error: Exception, theory: object, tendon: object, twist: object, elements: object
) -> InputError:
    """Say which of the arguments that are not arrays has the wrong type."""
    try:
        check_choices(theory, tendon, twist, elements)
    except InputError as wrong:
        return wrong
    return InputError(f"an argument has the wrong type: {error}")


#: Bend of one element, rad, from which the mesh is worth a check: the error grows with its
#: fourth power, and is 1e-6 of length at 0.16 rad (the study's robot at 80 N).
_COARSE_BEND = 0.6


def _coarse(rotations: Floats | None, elements: int) -> str:
    """A sentence if a module bends too far for its elements, else nothing."""
    if rotations is None or elements == 8:
        return ""
    tangents = np.vstack(([[0.0, 0.0, 1.0]], rotations[:, :, 2]))
    cosines = np.clip(np.einsum("ij,ij->i", tangents[:-1], tangents[1:]), -1.0, 1.0)
    k = int(np.argmin(cosines))
    bend = float(np.arccos(cosines[k]))
    if bend <= _COARSE_BEND * elements:
        return ""
    return (
        f" The backbone bends by {np.degrees(bend):.0f} degrees before disk {k + 1}: solve again "
        f"with elements={min(8, 4 * elements)} to see what the mesh is worth."
    )


def _message(
    status: str,
    stable: bool | None,
    left_unstable: bool,
    fraction: float,
    collision: int | None,
    residual: float,
    iterations: int,
) -> str:
    match status:
        case "converged":
            if left_unstable:
                return (
                    "The robot buckled: the way from straight led to an unstable equilibrium; "
                    "one of several stable branches is returned. A small load to one side chooses "
                    "the branch."
                )
            if stable is None:
                return (
                    "An equilibrium; whether it is stable is not known, because a tip moment has "
                    "no potential."
                )
            return "A stable equilibrium."
        case "no_equilibrium":
            k = collision if collision is not None else 0
            disks = "the base and disk 1" if k == 0 else f"disks {k} and {k + 1}"
            return (
                f"No equilibrium: {disks} collide, because the load closes the gap between them. "
                "Check Young's modulus (GPa, not MPa?) and the tensions, or lower the load."
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
                "between two disks is probably at its limit (buckling between disks). Lower the "
                "load, or check Young's modulus (GPa, not MPa?)."
            )
