"""Search for the equilibrium of one load with a contact, along a path in the load factor.

Components of force and tip position are along the axes of the plane: normal, two tangents.
docs/theory/statics.md has the equations.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.statics import actuation
from bowstring.statics.contact_loads import dead_loads, unloaded
from bowstring.statics.contact_slip import energy_norm, sliding_force
from bowstring.statics.contact_solution import ContactSolution, State
from bowstring.statics.load import Load
from bowstring.statics.load_tables import points_have_potential, same_points
from bowstring.statics.plane import Plane
from bowstring.statics.solution import Solution

if TYPE_CHECKING:
    import bowstring._core as _core
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.messages import StaticsStatus

TOLERANCE: Final = 1e-9  # tolerance of a contact: distances over length, forces over their scale
_TARGET: Final = 1e-10  # residual at which the iteration stops
_MOST_ITERATIONS: Final = 40
_MOST_HALVINGS: Final = 10  # halvings of a step of Newton's method
_LONGEST_MOTION: Final = 0.3  # motion of the tip in a step of Newton's method over the length
_LEAST_INCREMENT: Final = 2.0**-8  # least increment of load stepping
_MOST_FAILURES: Final = 16  # contact forces without an equilibrium, before a load is given up
_TRANSVERSE: Final = 1e-2  # force over its scale that breaks a symmetry
_SCAN: Final = 8  # increments in which the first contact is sought


class _Contact(NamedTuple):
    """Equilibrium that meets the contact conditions."""

    core: _core.Solution | None
    """None in the home pose."""
    force: Floats
    """Contact force (3,)."""
    tip: Floats
    """Tip position (3,) relative to the plane's point; its first component is the gap."""
    anchor: Floats | None
    """Tangential position (2,) at which a tip in contact sticks; None if separated."""
    state: State
    residual: float


class _Equilibrium(NamedTuple):
    """Equilibrium under a contact force."""

    core: _core.Solution
    force: Floats
    tip: Floats


class ContactProblem:
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
        dead = dead_loads(robot, load)
        if before is None:
            begin = np.where(self.by_displacement, 0.0, robot.tendons.pretension_N)
            self.dead = (unloaded(dead), dead)
        else:
            displacements = before.displacements()
            assert previous is not None and displacements is not None
            begin = np.where(self.by_displacement, displacements, before.tensions)
            last = dead_loads(robot, before.load)
            last["tip_force"] = last["tip_force"] - previous.force
            first, now = last.get("point_loads"), dead.get("point_loads")
            if first is not None and now is not None and not same_points(first, now):
                raise InputError(
                    "point_loads must act on the same disks and points as under the previous load, "
                    "in the same order; give one that does not act a force of zero"
                )
            for name, value in unloaded({**last, **dead}).items():  # may be in one only
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
        except InputError:  # the path has more elements now, and keeps them
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
        if home.tip[0] < -TOLERANCE * length and self.dead[0]["gravity"].any():
            # it rests on the plane by its weight: gravity increases with the other loads
            first, last = self.dead
            self.dead = ({**first, "gravity": np.zeros(3)}, last)
            home = self.at(0.0, none)
            if home is None:
                return _Contact(None, none, none, None, "separated", 0.0)
        if home.tip[0] < -TOLERANCE * length:
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
                    home = self.frictionless(0.0, 0.0)
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
            return self.frictionless(target, float(last.force[0]))
        anchor = last.anchor
        if anchor is None:
            saved = self.path.core.history()
            free = self.at(target, np.zeros(3))
            if free is not None and free.tip[0] >= -_TARGET * self.robot.length:
                return self.verified(free, None)
            self.restore(saved)
            anchor = self.first_contact(factor, target)
            if anchor is None:
                return None
        return self.with_friction(target, last.force, anchor)

    def first_contact(self, factor: float, target: float) -> Floats | None:
        """Tangential position (2,) of the free tip where it first reaches the plane."""
        from scipy.optimize import brentq  # a contact without friction does not need it

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
        if reached is None or not abs(reached.tip[0]) <= TOLERANCE * self.robot.length:
            return None
        return reached.tip[1:]

    # ----------------------------------------------------------------------------------
    # Contact conditions
    # ----------------------------------------------------------------------------------

    def frictionless(self, factor: float, normal_force: float) -> _Contact | None:
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
                return self.verified(here, here.tip[1:])
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
                return self.verified(here, here.tip[1:])  # below numerical resolution
        return None

    def with_friction(self, factor: float, force: Floats, anchor: Floats) -> _Contact | None:
        """Contact with friction: Newton's method on theory Eq. 3.9.

        The tip position is linearised in the force, Coulomb's law is not. The step is damped by the
        natural monotonicity test, in the norm of the compliance.
        """
        here = self.at(factor, force)
        if here is None:
            return None
        for _ in range(_MOST_ITERATIONS):
            verified = self.verified(here, anchor)
            if verified is not None and verified.residual <= _TARGET:
                return verified
            compliance = self.compliance(here.core)
            if compliance is None:
                return verified
            target = self.linear_force(compliance, here, anchor)
            if target is None:
                return verified
            following = self.damped_step(factor, here, target - here.force, compliance, anchor)
            if following is None:
                return verified  # below numerical resolution, or not converged
            here = following
        return None

    def damped_step(
        self, factor: float, here: _Equilibrium, step: Floats, compliance: Floats, anchor: Floats
    ) -> _Equilibrium | None:
        """Equilibrium after the longest of the halved steps that leads to a shorter next step."""
        size, longest = energy_norm(compliance, step), math.hypot(*step)
        if longest == 0:
            return None
        share = min(1.0, (self.scale + math.hypot(*here.force)) / longest)
        motion = share * math.hypot(*(compliance @ step))
        share *= min(1.0, _LONGEST_MOTION * self.robot.length / max(motion, 1e-300))
        saved = self.path.core.history()
        for _ in range(_MOST_HALVINGS):
            trial = self.at(factor, here.force + share * step)
            if trial is not None:
                target = self.linear_force(compliance, trial, anchor)
                if target is not None:
                    following = energy_norm(compliance, target - trial.force)
                    if following <= (1 - share / 4) * size:
                        return trial
            self.restore(saved)
            share /= 2
        return None

    def linear_force(self, compliance: Floats, here: _Equilibrium, anchor: Floats) -> Floats | None:
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
        return sliding_force(compliance, free, self.friction, here.force[1:])

    def verified(self, here: _Equilibrium, anchor: Floats | None) -> _Contact | None:
        """Contact with its state and residual; None if a condition is violated."""
        length, force, gap = self.robot.length, here.force, here.tip[0]
        if not force.any():
            residual = max(0.0, -gap / length)
            if residual > TOLERANCE:
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
            # slip is against the friction force, which is then on the cone
            direction = -force[1:] / size
            along = float(direction @ slip)
            across = math.hypot(*(slip - along * direction))
            law = max(across, -along, (self.friction * normal - size) / scale)
        else:
            law = math.hypot(*slip)
        beyond = (size - self.friction * normal) / scale
        residual = max(0.0, abs(gap) / length, -normal / scale, beyond, law)
        if not residual <= TOLERANCE:
            return None
        place = here.tip[1:] if slides else anchor
        state: State = "sliding" if slides else "sticking"
        return _Contact(here.core, force, here.tip, place, state, residual)

    def result(self, found: _Contact | None) -> ContactSolution:
        """Contact as a solution; one that failed if nothing was found."""
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
