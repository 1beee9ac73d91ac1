"""Statics of a robot whose tip touches a rigid plane, without or with Coulomb friction.

The contact force is an unknown dead force on the tip. docs/theory/statics.md has the equations.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bowstring import validation
from bowstring.errors import InputError
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.statics import actuation
from bowstring.statics.contact_loads import load_rows
from bowstring.statics.contact_problem import TOLERANCE, ContactProblem
from bowstring.statics.contact_solution import ContactSolution
from bowstring.statics.load import Load, as_load
from bowstring.statics.model import as_model
from bowstring.statics.plane import Plane

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

__all__ = ["ContactSolution", "solve_contact", "sweep_contact"]


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
    for row in load_rows(robot, as_load(tensions, load)):
        found.append(_solve(robot, row, model, plane, previous))
        previous = found[-1] if found[-1].converged else previous
    return tuple(found)


def _solve(
    robot: Robot, load: Load, model: RodModel, plane: Plane, previous: ContactSolution | None
) -> ContactSolution:
    _check(robot, model, plane, previous)
    problem = ContactProblem(robot, load, model, plane, previous)
    start = problem.start(previous)
    return problem.result(problem.solve(start))


def _check(robot: Robot, model: RodModel, plane: Plane, previous: ContactSolution | None) -> None:
    if not isinstance(plane, Plane):
        raise InputError(f"plane is {validation.shown(plane)}, it must be a bowstring.Plane")
    check_without_laws(
        robot, ", with which a contact is not solved", argument="plane", but=OF_COMMANDS
    )
    if model.tendon_path == "continuous":
        raise InputError(
            'a contact is not solved with tendon_path="continuous"; use tendon_path="straight"'
        )
    base = -float(np.dot(plane.normal, plane.point))
    if base < -TOLERANCE * robot.length:
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
