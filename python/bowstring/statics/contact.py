"""Statics of a robot whose tip touches a rigid plane, without or with Coulomb friction.

The contact force is an unknown dead force on the tip. Components of force and tip position in this
file are along the axes of the plane: normal, two tangents. docs/theory/statics.md has the
equations.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bowstring import validation
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError, StabilityWarning
from bowstring.robot.model import check_robot
from bowstring.statics import actuation
from bowstring.statics.load import (
    ON_DISKS,
    Load,
    as_load,
    per_disk,
    points_have_potential,
    same_points,
    with_arrays,
    without_wrenches,
)
from bowstring.statics.model import as_model
from bowstring.statics.plane import Plane
from bowstring.statics.solution import Solution

if TYPE_CHECKING:
    from typing_extensions import Self

    import bowstring._core as _core
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.schemas import statics as schema
    from bowstring.schemas.basic import StaticsStatus

__all__ = ["ContactSolution", "solve_contact", "sweep_contact"]

Floats = NDArray[np.float64]
State = Literal["separated", "sticking", "sliding"]

_TOLERANCE: Final = 1e-9  # of a converged contact: distances over length, forces over their scale
_TARGET: Final = 1e-10  # at which the iteration stops
_MOST_ITERATIONS: Final = 40
_MOST_HALVINGS: Final = 10  # of a step of Newton's method
_LONGEST_MOTION: Final = 0.3  # of the tip in a step of Newton's method, over the length
_ANGLES: Final = 48  # at which the direction of the slip is bracketed
_LEAST_INCREMENT: Final = 2.0**-8  # of load stepping
_MOST_FAILURES: Final = 16  # contact forces without an equilibrium, before a load is given up
_TRANSVERSE: Final = 1e-2  # force over its scale that breaks a symmetry
_SCAN: Final = 8  # increments in which the first contact is sought
_BEYOND: Final = 1e-6  # distance over length from which a disk counts as beyond the plane
_VECTORS: Final = {"gravity": "m/s^2", "tip_force": "N", "tip_moment": "N m"}


@short_repr
@dataclass(frozen=True, eq=False)
class ContactSolution:
    """Equilibrium of a robot whose tip may touch a plane; made by `solve_contact`.

    Attributes
    ----------
    plane : Plane
    status : str
        ``"converged"``, or the reason of failure as in `Solution.status`. The other values are None
        or NaN then.
    state : str or None
        ``"separated"``; ``"sticking"``, friction holds the tip in its place; ``"sliding"``, the tip
        is in contact and slides, or is free to slide on a frictionless plane.
    solution : Solution or None
        The equilibrium under the load and the contact force as a dead tip force. Its `stable` is
        that without the constraint.
    force : ndarray (3,)
        Contact force on the tip in the base frame, in N.
    normal_force : float
        Its component along the normal, in N; never negative.
    gap : float
        Distance of the tip from the plane in m: zero within the tolerance in contact.
    point : ndarray (3,) or None
        Point of the plane that the tip touches, in m; None if separated. A sticking tip is held
        there.
    residual : float
        Largest violation of the contact conditions: distances over the length, forces over the
        larger of the contact force and (least bending stiffness / length squared). At most 1e-9.
    stable : bool or None
        Whether the constrained equilibrium is stable. None where this is not proven: with friction
        in contact, and under a moment in contact.
    """

    plane: Plane
    status: StaticsStatus
    state: State | None
    solution: Solution | None
    force: Floats
    normal_force: float
    gap: float
    point: Floats | None
    residual: float
    stable: bool | None

    @property
    def converged(self) -> bool:
        """Whether the contact conditions are proven."""
        return self.status == "converged"

    @property
    def disks_beyond(self) -> tuple[int, ...]:
        """Numbers, from 1, of disks before the tip whose centres are beyond the plane.

        The plane acts on the tip only.
        """
        if self.solution is None or self.solution.disk_positions is None:
            return ()
        gaps = self.plane.gap(self.solution.disk_positions[:-1])
        beyond = np.flatnonzero(gaps < -_BEYOND * self.solution.robot.length)
        return tuple((beyond + 1).tolist())

    @property
    def message(self) -> str:
        """The contact as a sentence."""
        if not self.converged:
            return (
                "No contact equilibrium was found that is stable under its contact force as a "
                f"dead force ({self.status}); approach it in smaller steps of the load "
                "(bowstring.sweep_contact), or move the plane."
            )
        if self.state == "separated":
            return f"The tip is {1e3 * self.gap:.6g} mm from the plane."
        what = "sticks to" if self.state == "sticking" else "slides on"
        if self.plane.friction == 0:
            what = "touches"
        said = f"The tip {what} the plane with a normal force of {self.normal_force:.6g} N"
        if self.plane.friction > 0:
            tangential = np.linalg.norm(
                self.force - self.normal_force * np.array(self.plane.normal)
            )
            said += f" and {tangential:.6g} N of friction"
        return said + "."

    def warnings(self) -> tuple[str, ...]:
        """Warning of disks before the tip that are beyond the plane, as sentences."""
        beyond = self.disks_beyond
        if not beyond:
            return ()
        one = len(beyond) == 1
        numbers = ", ".join(map(str, beyond))
        return (
            f"{'disk' if one else 'disks'} {numbers} {'is' if one else 'are'} beyond the plane, "
            "which acts on the tip only",
        )

    def raise_for_status(self) -> Self:
        """Return self if converged, else raise.

        Raises
        ------
        NoSolutionError
            The message has advice.

        Warns
        -----
        StabilityWarning
            If the equilibrium is unstable, or its stability is unknown for a reason other than
            friction.
        """
        if self.solution is None:
            raise NoSolutionError(self.message, status=self.status)
        if not self.stable and (self.state == "separated" or self.plane.friction == 0):
            word = "unstable" if self.stable is False else "not known to be stable"
            said = f"{self.solution.robot.name}: the equilibrium is {word}. {self.message}"
            warnings.warn(said, StabilityWarning, stacklevel=2)
        return self

    def to_dict(self) -> schema.Contact:
        """Return the key ``contact`` of ``bowstring solve --json``; only if converged."""
        if self.state is None:
            raise NoSolutionError(self.message, status=self.status)
        return {
            "state": self.state,
            "gap_m": self.gap,
            "force_N": self.force.tolist(),
            "normal_force_N": self.normal_force,
            "point_m": None if self.point is None else self.point.tolist(),
            "residual": self.residual,
            "stable": self.stable,
            "disks_beyond": list(self.disks_beyond),
            "message": self.message,
        }


def solve_contact(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    plane: Plane,
    previous: ContactSolution | None = None,
) -> ContactSolution:
    """Find the static equilibrium of a robot whose tip may touch a rigid plane.

    The plane acts on the centre of the last disk only.

    Parameters
    ----------
    robot : Robot
        The robot, without friction in the tendons. Its base is not beyond the plane.
    tensions : array_like (T,), optional
        Tension of each tendon in N, short for ``load=Load(tensions)``.
    load : Load, optional
        All loads but the contact force; `tensions` may be given beside it.
    model : RodModel, optional
        As for `solve`, with straight tendons.
    plane : Plane
        The plane, with its friction.
    previous : ContactSolution, optional
        Contact under the previous load, whose path is continued. By default the path begins in the
        home pose under gravity, and the other loads increase in proportion from there; where the
        weight alone brings the tip to the plane, gravity increases with them. With friction the tip
        sticks where it first touches, then sticks or slides; the home pose must not be beyond the
        plane then.

    Returns
    -------
    ContactSolution
        Check `converged`, or call `raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong.

    Notes
    -----
    With friction each call is one step of the implicit Euler rule (return mapping): the friction
    force opposes the whole displacement in the step. Where the tip slides along a curve, take
    several steps (`sweep_contact`).

    Contact equilibria that are unstable under the contact force as a dead force are not found.

    Examples
    --------
    Tendon 1 presses the tip against a wall:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> wall = bs.Plane([0.15, 0, 0], [-1, 0, 0])
    >>> contact = bs.solve_contact(robot, [40, 0, 0], plane=wall).raise_for_status()
    >>> contact.state, round(contact.normal_force, 3), contact.stable
    ('sliding', 0.918, True)
    """
    check_robot(robot)
    return _solve(robot, as_load(tensions, load), as_model(model), plane, previous)


def sweep_contact(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    plane: Plane,
    previous: ContactSolution | None = None,
) -> tuple[ContactSolution, ...]:
    """Solve many loads in order, each as a step from the last one that converged.

    Parameters
    ----------
    robot : Robot
        As for `solve_contact`.
    tensions : array_like (n, T), optional
        Tensions in N, short for ``load=Load(tensions)``.
    load : Load, optional
        As for `sweep`: actuation (n, T); gravity and tip loads (3,) or (n, 3); loads on disks
        (N, 3) or (n, N, 3).
    model : RodModel, optional
        As for `solve_contact`.
    plane : Plane
        As for `solve_contact`.
    previous : ContactSolution, optional
        As for `solve_contact`; the first row continues it.

    Returns
    -------
    tuple of ContactSolution (n,)
        The contact of each row; one that did not converge has no solution.

    Raises
    ------
    InputError
        If an argument is wrong. Nothing is solved then, except where a single row is wrong.

    Examples
    --------
    Press the tip against a rough wall, then move it sideways by tendon 2:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> wall = bs.Plane([0.15, 0, 0], [-1, 0, 0], friction=1)
    >>> rows = [[40, 0, 0], [40, 2, 0], [40, 8, 0]]
    >>> [contact.state for contact in bs.sweep_contact(robot, rows, plane=wall)]
    ['sliding', 'sticking', 'sliding']
    """
    check_robot(robot)
    model, found = as_model(model), []
    for row in _rows(robot, as_load(tensions, load)):
        found.append(_solve(robot, row, model, plane, previous))
        previous = found[-1] if found[-1].converged else previous
    return tuple(found)


def _rows(robot: Robot, load: Load) -> list[Load]:
    """Return the load of each row."""
    load = with_arrays(load, " or (n, N, 3)")
    count = len(actuation.commands(robot, load, rows=True)[1])
    values: dict[str, Any] = {}
    for name in (*actuation.KINDS, *_VECTORS, *ON_DISKS):
        given = getattr(load, name)
        if given is None:
            continue
        array = validation.read(name, given, "numbers")
        array = per_disk(name, array, robot.core.disk_count)
        once = 2 if name in ON_DISKS else 1
        if array.ndim == once:
            array = np.broadcast_to(array, (count, *array.shape))
        if array.ndim != once + 1 or len(array) != count:
            raise InputError(
                f"{name} has shape {array.shape}, it must have {count} rows, as others"
            )
        values[name] = array
    points = load.point_loads
    return [
        Load(point_loads=points, **{name: array[k] for name, array in values.items()})
        for k in range(count)
    ]


def _solve(
    robot: Robot, load: Load, model: RodModel, plane: Plane, previous: ContactSolution | None
) -> ContactSolution:
    _check(robot, model, plane, previous)
    problem = _Problem(robot, load, model, plane, previous)
    start = problem.start(previous)
    return problem.result(problem.solve(start))


def _check(robot: Robot, model: RodModel, plane: Plane, previous: ContactSolution | None) -> None:
    if not isinstance(plane, Plane):
        raise InputError(f"plane is {validation.shown(plane)}, it must be a bowstring.Plane")
    if robot.has_friction:
        raise InputError(
            f"the tendons of {robot.name} have friction, with which a contact is not solved; set "
            "friction of the tendons to 0",
            argument="plane",
        )
    if model.tendon_path == "continuous":
        raise InputError(
            'a contact is not solved with tendon_path="continuous"; use tendon_path="straight"'
        )
    base = -float(np.dot(plane.normal, plane.point))
    if base < -_TOLERANCE * robot.length:
        raise InputError(
            f"the base of {robot.name} is {-1e3 * base:.6g} mm beyond the plane; the normal must "
            "point from the plane to the side of the robot",
            argument="plane",
        )
    if previous is None:
        return
    if not isinstance(previous, ContactSolution):
        raise InputError(
            f"previous is {validation.shown(previous)}, it must be a bowstring.ContactSolution"
        )
    if previous.solution is None:
        raise InputError("previous did not converge; give the last contact that did")
    if previous.plane != plane:
        raise InputError("previous is of another plane; continue with the same one")
    if previous.solution.robot.hash != robot.hash:
        raise InputError(
            "previous is of another robot, or of one with other numbers; continue with the same one"
        )


class _Contact(NamedTuple):
    """Equilibrium that meets the contact conditions."""

    core: _core.Solution | None
    """None in the home pose."""
    force: Floats
    """Contact force (3,)."""
    tip: Floats
    """Tip position (3,) relative to the plane's point; its first component is the gap."""
    anchor: Floats | None
    """Place (2,) at which a tip in contact sticks; None if separated."""
    state: State
    residual: float


class _Equilibrium(NamedTuple):
    """Equilibrium under a contact force."""

    core: _core.Solution
    force: Floats
    tip: Floats


class _Problem:
    """Contact of one load, as a path in the load factor from the previous load."""

    def __init__(
        self,
        robot: Robot,
        load: Load,
        model: RodModel,
        plane: Plane,
        previous: ContactSolution | None,
    ) -> None:
        before = None if previous is None else previous.solution
        self.robot, self.plane, self.friction = robot, plane, plane.friction
        self.axes, self.origin = plane.axes, np.array(plane.point)
        self.path = actuation.Path(robot, model, None if before is None else before.history())
        self.by_displacement, end = actuation.commands(robot, load)
        dead = _dead(robot, load)
        if before is None:
            begin = np.where(self.by_displacement, 0.0, robot.tendons.pretension_N)
            self.dead = (_unloaded(dead), dead)
        else:
            displacements = before.displacements()
            assert previous is not None and displacements is not None
            begin = np.where(self.by_displacement, displacements, before.tensions)
            last = _dead(robot, before.load)
            last["tip_force"] = last["tip_force"] - previous.force
            first, now = last.get("point_loads"), dead.get("point_loads")
            if first is not None and now is not None and not same_points(first, now):
                raise InputError(
                    "point_loads must act on the same disks and points as under the previous load, "
                    "in the same order; give one that does not act a force of zero"
                )
            for name, value in _unloaded({**last, **dead}).items():  # may be in one only
                dead.setdefault(name, value)
                last.setdefault(name, np.zeros_like(value))
            self.dead = (last, dead)
        self.commands = (begin, end)
        #: Force that bends the robot by about 1 rad, in N.
        self.scale = float(np.min(robot.bending_stiffness)) / robot.length**2
        self.failure: StaticsStatus = "max_iterations"
        self.failures = 0

    # ----------------------------------------------------------------------------------
    # Equilibrium under a given contact force
    # ----------------------------------------------------------------------------------

    def at(self, factor: float, force: Floats) -> _Equilibrium | None:
        """Solve the equilibrium at a load factor under a contact force; None without one."""
        if self.failures >= _MOST_FAILURES:
            return None
        first, last = self.dead
        mixed = last
        if factor != 1.0:
            mixed = {name: (1 - factor) * first[name] + factor * last[name] for name in last}
        begin, end = self.commands
        commands = end if factor == 1.0 else (1 - factor) * begin + factor * end
        load = Load(**{**mixed, "tip_force": mixed["tip_force"] + force @ self.axes})
        core = self.path.core.step(self.by_displacement, commands, load)
        if core.status == "unstable":
            # leave a symmetric state by a small transverse force
            across = _TRANSVERSE * self.scale * self.axes[1:].sum(axis=0)
            pushed = load.replace(tip_force=load.tip_force + across)
            if self.path.core.step(self.by_displacement, commands, pushed).tip_position is not None:
                core = self.path.core.step(self.by_displacement, commands, load)
        if core.tip_position is None:
            self.failure, self.failures = core.status, self.failures + 1
            return None
        return _Equilibrium(core, force, self.axes @ (core.tip_position - self.origin))

    def compliance(self, core: _core.Solution) -> Floats | None:
        """Derivative (3, 3) of the tip position by the contact force, at the given commands."""
        by = core.jacobians()
        if by is None:
            return None
        found = by["tip_position_by_tip_force"]
        held = np.flatnonzero(self.by_displacement & (core.tensions > 0))
        if held.size:
            # theory Eq. 3.8: home length - length + compliance * tension is constant
            block = np.diag(actuation.compliances(self.robot)) - by["lengths_by_tension"]
            inverse = np.linalg.pinv(block[np.ix_(held, held)], rcond=1e-10)
            tensions = inverse @ by["lengths_by_tip_force"][held]
            found = found + by["tip_position_by_tension"][:, held] @ tensions
        local: Floats = self.axes @ found @ self.axes.T
        return local

    def restore(self, saved: dict[str, Any]) -> None:
        """Return to a state of the path."""
        try:
            self.path.core.resume(saved)
        except InputError:  # the path has more elements now, and does not go back
            self.path = actuation.Path(self.robot, self.path.model)
            self.path.core.resume(saved)

    # ----------------------------------------------------------------------------------
    # Path
    # ----------------------------------------------------------------------------------

    def start(self, previous: ContactSolution | None) -> _Contact:
        """Contact at load factor 0."""
        if previous is not None and previous.solution is not None:
            core, force = previous.solution.core, self.axes @ previous.force
            assert core.tip_position is not None and previous.state is not None
            tip = self.axes @ (core.tip_position - self.origin)
            anchor = None
            if previous.point is not None:
                anchor = (self.axes @ (previous.point - self.origin))[1:]
            return _Contact(core, force, tip, anchor, previous.state, previous.residual)
        none = np.zeros(3)
        if self.friction == 0:
            return _Contact(None, none, none, None, "separated", 0.0)  # the path does not matter
        home = self.at(0.0, none)
        if home is None:
            return _Contact(None, none, none, None, "separated", 0.0)
        length = self.robot.length
        if home.tip[0] < -_TOLERANCE * length and self.dead[0]["gravity"].any():
            # it rests on the plane by its weight: gravity increases with the other loads
            first, last = self.dead
            self.dead = ({**first, "gravity": np.zeros(3)}, last)
            home = self.at(0.0, none)
            if home is None:
                return _Contact(None, none, none, None, "separated", 0.0)
        if home.tip[0] < -_TOLERANCE * length:
            raise InputError(
                f"the home pose of {self.robot.name} reaches {-1e3 * home.tip[0]:.6g} mm beyond "
                "the plane; with friction the path must begin on the side of the robot: move the "
                "plane, or set its friction to 0",
                argument="plane",
            )
        return _Contact(home.core, none, home.tip, None, "separated", 0.0)

    def solve(self, start: _Contact) -> _Contact | None:
        """Contact at load factor 1, by load stepping where one step does not converge."""
        factor, increment, last = 0.0, 1.0, start
        while factor < 1.0:
            saved = self.path.core.history()
            target = min(1.0, factor + increment)
            found = self.advance(factor, target, last)
            if found is None:
                self.restore(saved)
                if factor == 0.0 and last.core is None:
                    # a frictionless path begins with the contact of the home pose
                    home = self.press(0.0, 0.0)
                    if home is None:
                        return None
                    last = home
                    continue
                increment /= 2
                if increment < _LEAST_INCREMENT:
                    return None
                continue
            factor, last = target, found
            increment *= 2
        return last

    def advance(self, factor: float, target: float, last: _Contact) -> _Contact | None:
        """Contact at a load factor from that at a lower one."""
        if self.friction == 0:
            return self.press(target, float(last.force[0]))
        anchor = last.anchor
        if anchor is None:
            saved = self.path.core.history()
            free = self.at(target, np.zeros(3))
            if free is not None and free.tip[0] >= -_TARGET * self.robot.length:
                return self.proven(free, None)
            self.restore(saved)
            anchor = self.touch(factor, target)
            if anchor is None:
                return None
        return self.hold(target, last.force, anchor)

    def touch(self, factor: float, target: float) -> Floats | None:
        """Place (2,) at which the free tip first reaches the plane between two load factors."""
        from scipy.optimize import brentq  # which a contact without friction does not need

        below, before = factor, self.at(factor, np.zeros(3))
        if before is None:
            return None
        if before.tip[0] <= 0:
            return before.tip[1:]
        for k in range(1, _SCAN + 1):
            above = factor + (target - factor) * k / _SCAN
            here = self.at(above, np.zeros(3))
            if here is None:
                return None
            if here.tip[0] < 0:
                break
            below = above
        else:
            return None

        def gap(at: float) -> float:
            free = self.at(at, np.zeros(3))
            return np.nan if free is None else float(free.tip[0])

        try:
            root = brentq(gap, below, above, xtol=1e-15, rtol=1e-14)
        except ValueError:  # NaN
            return None
        reached = self.at(root, np.zeros(3))
        if reached is None or not abs(reached.tip[0]) <= _TOLERANCE * self.robot.length:
            return None
        return reached.tip[1:]

    # ----------------------------------------------------------------------------------
    # Contact conditions
    # ----------------------------------------------------------------------------------

    def press(self, factor: float, normal_force: float) -> _Contact | None:
        """Contact without friction: the root of the gap in the normal force, theory Eq. 3.10.

        Newton's method from the compliance, then the secant, in a bracket.
        """
        length = self.robot.length
        low, high = -1.0, np.inf  # normal forces with the tip beyond the plane, and before it
        failed = np.inf  # least normal force found without an equilibrium
        trial, last = normal_force, None
        for _ in range(_MOST_ITERATIONS):
            here = self.at(factor, np.array([trial, 0.0, 0.0]))
            if here is None:
                if trial == 0:
                    return None
                failed, last = min(failed, trial), None
                if failed - low <= 1e-4 * (self.scale + failed):
                    return None
                trial = 0.5 * (max(low, 0.0) + failed)
                continue
            gap = here.tip[0]
            if abs(gap) <= _TARGET * length or (trial == 0 and gap > 0):
                return self.proven(here, here.tip[1:])
            if gap < 0:
                low = trial
            else:
                high = trial
            slope = 0.0
            if last is not None and trial != last[0]:
                slope = (gap - last[1]) / (trial - last[0])
            if slope <= 0:
                compliance = self.compliance(here.core)
                slope = 0.0 if compliance is None else compliance[0, 0]
            reach = self.scale + trial
            step = min(max(-gap / slope, -reach), reach) if slope > 0 else -np.sign(gap) * reach
            last, trial = (trial, gap), max(0.0, trial + step)
            if not low < trial < high:
                trial = 0.5 * (max(low, 0.0) + high)
            if abs(trial - last[0]) <= 1e-15 * (self.scale + trial):
                return self.proven(here, here.tip[1:])  # below numerical resolution
        return None

    def hold(self, factor: float, force: Floats, anchor: Floats) -> _Contact | None:
        """Contact with friction: Newton's method on theory Eq. 3.9.

        The tip position is linearised in the force, Coulomb's law is not. The step is damped by the
        natural monotonicity test, in the norm of the compliance.
        """
        here = self.at(factor, force)
        if here is None:
            return None
        for _ in range(_MOST_ITERATIONS):
            proven = self.proven(here, anchor)
            if proven is not None and proven.residual <= _TARGET:
                return proven
            compliance = self.compliance(here.core)
            if compliance is None:
                return proven
            target = self.local(compliance, here, anchor)
            if target is None:
                return proven
            following = self.damped(factor, here, target - here.force, compliance, anchor)
            if following is None:
                return proven  # below numerical resolution, or not converged
            here = following
        return None

    def damped(
        self, factor: float, here: _Equilibrium, step: Floats, compliance: Floats, anchor: Floats
    ) -> _Equilibrium | None:
        """Equilibrium after the longest of the halved steps that leads to a shorter next step."""
        size, longest = _norm(compliance, step), math.hypot(*step)
        if longest == 0:
            return None
        share = min(1.0, (self.scale + math.hypot(*here.force)) / longest)
        motion = share * math.hypot(*(compliance @ step))
        share *= min(1.0, _LONGEST_MOTION * self.robot.length / max(motion, 1e-300))
        saved = self.path.core.history()
        for _ in range(_MOST_HALVINGS):
            trial = self.at(factor, here.force + share * step)
            if trial is not None:
                target = self.local(compliance, trial, anchor)
                if target is not None:
                    following = _norm(compliance, target - trial.force)
                    if following <= (1 - share / 4) * size:
                        return trial
            self.restore(saved)
            share /= 2
        return None

    def local(self, compliance: Floats, here: _Equilibrium, anchor: Floats) -> Floats | None:
        """Contact force by theory Eq. 3.9 where the tip position is linear in the force."""
        free = here.tip - compliance @ here.force
        free[1:] -= anchor
        if free[0] >= 0:
            return np.zeros(3)
        stuck: Any
        try:
            stuck = np.linalg.solve(compliance, -free)
        except np.linalg.LinAlgError:  # a straight inextensible robot
            stuck = np.linalg.lstsq(compliance, -free, rcond=None)[0]
        if 0 <= math.hypot(*stuck[1:]) <= self.friction * stuck[0]:
            return np.asarray(stuck, float)
        return _sliding(compliance, free, self.friction, here.force[1:])

    def proven(self, here: _Equilibrium, anchor: Floats | None) -> _Contact | None:
        """Contact with its state and residual; None if a condition is violated."""
        length, force, gap = self.robot.length, here.force, here.tip[0]
        if not force.any():
            residual = max(0.0, -gap / length)
            if residual > _TOLERANCE:
                return None
            return _Contact(here.core, force, here.tip, None, "separated", residual)
        assert anchor is not None
        normal, size = float(force[0]), math.hypot(*force[1:])
        scale = max(self.scale, math.hypot(*force))
        slip = (here.tip[1:] - anchor) / length
        slides = self.friction == 0 or math.hypot(*slip) > _TARGET
        if self.friction == 0:
            law = size / scale
        elif slides and size > 0:
            # no slip but against the friction force, which is then on the cone
            direction = -force[1:] / size
            along = float(direction @ slip)
            across = math.hypot(*(slip - along * direction))
            law = max(across, -along, (self.friction * normal - size) / scale)
        else:
            law = math.hypot(*slip)
        beyond = (size - self.friction * normal) / scale
        residual = max(0.0, abs(gap) / length, -normal / scale, beyond, law)
        if not residual <= _TOLERANCE:
            return None
        place = here.tip[1:] if slides else anchor
        state: State = "sliding" if slides else "sticking"
        return _Contact(here.core, force, here.tip, place, state, residual)

    def result(self, found: _Contact | None) -> ContactSolution:
        if found is None or found.core is None:
            none = np.full(3, np.nan)
            status = self.failure
            return ContactSolution(
                self.plane, status, None, None, none, np.nan, np.nan, None, np.nan, None
            )
        core, anchor = found.core, found.anchor
        # the state of the path is that of the solution, from which a copy is solved again
        solution = Solution(self.robot, core, self.path, self.path.history())
        separated = anchor is None
        # theory Eq. 3.13: a free minimum is one on the plane; under a moment there is no energy
        has_moment = bool(core.tip_moment.any()) or bool(
            core.disk_moments is not None and core.disk_moments.any()
        )
        has_potential = not has_moment and points_have_potential(core.point_loads)
        proves = separated or (self.friction == 0 and core.stable and has_potential)
        return ContactSolution(
            plane=self.plane,
            status="converged",
            state=found.state,
            solution=solution,
            force=found.force @ self.axes,
            normal_force=float(found.force[0]),
            gap=float(found.tip[0]),
            point=None if anchor is None else self.origin + np.array([0.0, *anchor]) @ self.axes,
            residual=float(found.residual),
            stable=core.stable if proves else None,
        )


def _norm(compliance: Floats, force: Floats) -> float:
    """Norm of a force by the energy of the motion that it causes."""
    return math.sqrt(max(0.0, float(force @ compliance @ force)))


def _sliding(
    compliance: Floats, free: Floats, friction: float, tangential: Floats
) -> Floats | None:
    """Contact force of a sliding tip whose position is `free` + `compliance` @ force.

    The direction of the slip is the root of one function of its angle, theory Eq. 3.12. Of
    several roots that is taken whose friction force is the nearest to `tangential`.
    """

    from scipy.optimize import brentq

    def at(angle: Any) -> tuple[Any, Any, Any, Any]:
        x, y = np.cos(angle), np.sin(angle)
        # gap of a unit normal force with its friction force
        unit = compliance[0, 0] - friction * (compliance[0, 1] * x + compliance[0, 2] * y)
        normal = -free[0] / unit
        forces = (normal, -friction * normal * x, -friction * normal * y)
        slip = [free[i] + sum(compliance[i, j] * forces[j] for j in range(3)) for i in (1, 2)]
        return x * slip[1] - y * slip[0], x * slip[0] + y * slip[1], unit, forces

    angles = np.linspace(0.0, 2 * np.pi, _ANGLES + 1)
    across, _, unit, _ = at(angles)
    possible = (unit[:-1] > 0) & (unit[1:] > 0) & (across[:-1] * across[1:] <= 0)
    best, nearest = None, np.inf
    for k in np.flatnonzero(possible):
        ends = (angles[k], angles[k + 1])
        angle = brentq(lambda a: at(a)[0], *ends, xtol=1e-15, rtol=1e-14)
        _, along, _, forces = at(angle)
        force = np.array(forces)
        distance = math.hypot(*(force[1:] - tangential))
        if along >= 0 and distance < nearest:
            best, nearest = force, distance
    return best


def _unloaded(dead: dict[str, Floats]) -> dict[str, Floats]:
    """Return the gravity, and the other loads with the size zero, on the same points."""
    none = {name: np.zeros_like(value) for name, value in dead.items()}
    none["gravity"] = dead["gravity"]
    if "point_loads" in dead:
        none["point_loads"] = without_wrenches(dead["point_loads"])
    return none


def _dead(robot: Robot, load: Load) -> dict[str, Floats]:
    """Dead loads as arrays: gravity, tip force and moment, and those on disks if given."""
    load = with_arrays(load)
    found: dict[str, Floats] = {}
    for name, unit in _VECTORS.items():
        value = getattr(load, name)
        if value is None:
            found[name] = np.array(robot.gravity) if name == "gravity" else np.zeros(3)
        else:
            found[name] = validation.numbers(name, value, (3,), unit)
    count = robot.core.disk_count
    if load.point_loads is not None:
        found["point_loads"] = load.point_loads.copy()
        found["point_loads"][:, 0] %= count  # below zero they count from the tip
    for name, unit in ON_DISKS.items():
        value = getattr(load, name)
        if value is not None:
            value = per_disk(name, value, count)
            found[name] = validation.numbers(name, value, (count, 3), unit)
    return found
