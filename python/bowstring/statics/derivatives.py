"""Derivatives of an equilibrium by tensions, displacements, tip load and stiffness."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.laws import OF_MOTION
from bowstring.robot.model import check_without_laws
from bowstring.statics import actuation
from bowstring.statics.solution import Solution
from bowstring.validation import shown


@short_repr
@dataclass(frozen=True, eq=False)
class Jacobians:
    """Derivatives of an equilibrium; made by `jacobians`.

    Rows are the dependent quantities, columns the variables. S is the number of segments.

    Attributes
    ----------
    tip_position_by_tension, tip_rotation_by_tension, lengths_by_tension : ndarray
        (3, T) in m/N, (3, T) in rad/N, (T, T) in m/N. Rotations of the tip are rotation vectors in
        the base frame: dR = [column]x R. Lengths are those of the tendons.
    tip_position_by_tip_force, tip_rotation_by_tip_force, lengths_by_tip_force : ndarray
        (3, 3) in m/N, (3, 3) in rad/N, (T, 3) in m/N.
    tip_position_by_tip_moment, tip_rotation_by_tip_moment, lengths_by_tip_moment : ndarray
        (3, 3) in m/(N m), (3, 3) in rad/(N m), (T, 3) in m/(N m).
    tip_position_by_stiffness, tip_rotation_by_stiffness, lengths_by_stiffness : ndarray
        (3, S) in m, (3, S) in rad, (T, S) in m: by the relative change of all stiffnesses of each
        segment's backbone (d/d ln E). An error of 1 % of E moves the tip by 0.01 times the sum of
        the columns.
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
class DisplacementJacobian:
    """Derivatives of an equilibrium by displacements; made by `displacement_jacobian`.

    Rows are the dependent quantities, columns the tendons whose displacement varies. The column of
    a slack tendon is zero, that of a tension-controlled one NaN.

    Attributes
    ----------
    tip_position_by_displacement, tip_rotation_by_displacement : ndarray
        (3, T) in m/m and (3, T) in rad/m, a rotation as in `Jacobians`.
    tensions_by_displacement, lengths_by_displacement : ndarray
        (T, T) in N/m, (T, T) in m/m.
    """

    tip_position_by_displacement: Floats
    tip_rotation_by_displacement: Floats
    tensions_by_displacement: Floats
    lengths_by_displacement: Floats


def check_smooth(solution: Solution) -> None:
    """Refuse a solution that has no derivatives."""
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {shown(solution)}, it must be one made by bowstring.solve")
    solution.raise_for_status()
    check_without_laws(
        solution.robot,
        ", which derivatives do not model",
        but=OF_MOTION,
    )
    if solution.model.tendon_path == "continuous":
        raise InputError(
            'the solution has tendon_path="continuous", for which there are no derivatives; '
            'solve with tendon_path="straight"'
        )


def jacobians(solution: Solution) -> Jacobians:
    """Differentiate an equilibrium by tensions, tip load and stiffness.

    The derivatives are exact for the discretised robot: one more block elimination with further
    right-hand sides (theory Eq. 3.4), at the same `elements`.

    Parameters
    ----------
    solution : Solution
        Converged solution with straight tendons.

    Returns
    -------
    Jacobians
        Derivatives of tip and tendon lengths, in SI units.

    Raises
    ------
    NoSolutionError
        If the solution did not converge.
    InputError
        If its tendons are continuous or have friction, for which there are no derivatives.

    Examples
    --------
    How far one more newton on tendon 1 moves the tip, in mm:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> by = bs.jacobians(bs.solve(robot, [40, 0, 0]))
    >>> (1e3 * by.tip_position_by_tension[:, 0]).round(2)
    array([ 5.03,  0.  , -2.55])
    """
    check_smooth(solution)
    found = solution.core.jacobians()
    if found is None:
        raise NoSolutionError(f"{solution.robot.name}: no derivatives at this equilibrium")
    return Jacobians(**{field.name: found[field.name] for field in fields(Jacobians)})


def block_of_taut(displacement_by_tension: Floats, taut: Ints) -> Floats:
    """Block of the displacement by tension (T, T), m/N, of the taut tendons, given by index.

    Raises
    ------
    InputError
        If the matrix is singular.
    """
    block = displacement_by_tension[np.ix_(taut, taut)]
    if np.linalg.cond(block) > 1e10:
        raise InputError(
            "the taut tendons cannot be displaced one by one, as the backbone does not "
            "shorten: solve with a Cosserat rod (bowstring.RodModel()), or with fewer taut "
            "tendons"
        )
    return block


def displacement_jacobian(solution: Solution) -> DisplacementJacobian:
    """Differentiate an equilibrium by tendon displacements.

    Uses the derivatives by tensions and the compliance of the tendons (theory Eq. 4.1).

    Parameters
    ----------
    solution : Solution
        Converged solution with straight tendons and without friction. Displacement-controlled taut
        tendons keep their displacement; after a solve by tensions only, all taut tendons do.

    Returns
    -------
    DisplacementJacobian
        Derivatives by the displacement of each tendon, per metre.

    Raises
    ------
    NoSolutionError
        If the solution did not converge.
    InputError
        With friction, with continuous tendons, and if taut tendons cannot be displaced one by one,
        as for three inextensible ones in a segment of an inextensible backbone.

    Examples
    --------
    How far one more millimetre on tendon 1 moves the tip, in mm:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> bent = bs.solve(robot, load=bs.Load(displacements=[0.02, -0.03, -0.03]))
    >>> by = bs.displacement_jacobian(bent)
    >>> by.tip_position_by_displacement[:, 0].round(2)
    array([ 9.63,  0.  , -4.73])
    """
    by = jacobians(solution)
    tensions, by_displacement = solution.tensions, solution.core.by_displacement
    actuated = (
        np.ones(len(tensions), bool)
        if by_displacement is None or not by_displacement.any()
        else by_displacement
    )
    held = np.flatnonzero(actuated & (tensions > 0))
    # theory Eq. 4.1, s = 0: displacement = home length - length + compliance * tension
    displacement_by_tension = np.diag(actuation.compliances(solution.robot)) - by.lengths_by_tension
    tensions_by_displacement = np.zeros_like(displacement_by_tension)
    if held.size:
        block = block_of_taut(displacement_by_tension, held)
        tensions_by_displacement[np.ix_(held, held)] = np.linalg.inv(block)
    tensions_by_displacement[:, ~actuated] = np.nan
    return DisplacementJacobian(
        tip_position_by_displacement=by.tip_position_by_tension @ tensions_by_displacement,
        tip_rotation_by_displacement=by.tip_rotation_by_tension @ tensions_by_displacement,
        tensions_by_displacement=tensions_by_displacement,
        lengths_by_displacement=by.lengths_by_tension @ tensions_by_displacement,
    )
