"""Derivatives of an equilibrium by any number of its load and its robot, and along directions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.robot.laws import LAWS
from bowstring.robot.paths import find
from bowstring.statics.differentiation import (
    ACTUATION,
    ON_DISKS,
    QUANTITIES,
    VECTORS,
    Differentiator,
    Direction,
    DirectionalDerivatives,
)
from bowstring.statics.solution import Solution
from bowstring.validation import shown

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

#: Fields that change the number of disks, or have no smooth effect.
_ROUGH: Final = {
    "count": "it is a whole number",
    "disk": "it is a whole number",
    **{size: "derivatives do not model it" for law in LAWS.values() for size in law.sizes},
    "friction": "with friction an equilibrium depends on the load history",
}
_LOADS: Final = (*ACTUATION, *VECTORS, *ON_DISKS)


@short_repr
@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of an equilibrium by many numbers; made by `derivatives`.

    ``found[of, by]`` is an array whose leading dimensions are those of the result and whose last
    ones are those of the variable, such as (3, T) for ``found["tip_position", "tensions"]``.
    """

    values: dict[tuple[str, str], Floats]
    """Arrays by result and variable."""
    relative_error: float
    """Largest of the estimated relative errors, see `DirectionalDerivatives`."""
    just_taut: tuple[int, ...]
    """Numbers, from 1, of displacement-controlled tendons at the limit of slack: the derivatives
    are then those for an increase of each variable."""

    def __getitem__(self, key: tuple[str, str]) -> Floats:
        """Array of a result by a variable."""
        if key in self.values:
            return self.values[key]
        for place, what in enumerate(("result", "variable")):
            names = list(dict.fromkeys(known[place] for known in self.values))
            if not isinstance(key, tuple) or len(key) != 2 or key[place] not in names:
                raise InputError(
                    f"there is no derivative {shown(key)}: the {what} must be one of "
                    f"{', '.join(names)}"
                )
        raise AssertionError(key)  # every result has every variable


def _paths(robot: Robot, name: str) -> tuple[str, ...]:
    """Full paths of the numbers of the robot file that a variable changes."""
    _, paths = find(robot, name, _LOADS)
    if paths[0].startswith("gravity"):
        raise InputError("gravity is a vector of the load: write gravity, not its components")
    leaf = paths[0].rpartition(".")[2]
    if leaf in _ROUGH:
        raise InputError(f"no derivative by {name}: {_ROUGH[leaf]}")
    return paths


def _shape(solution: Solution, name: str) -> tuple[int, ...]:
    """Shape of a variable."""
    if name in ACTUATION:
        return (len(solution.tensions),)
    if name in VECTORS:
        return (3,)
    if name in ON_DISKS:
        return (len(solution.robot.disks.station_m), 3)
    return ()


def _direction(differentiator: Differentiator, given: Mapping[str, Any]) -> Direction:
    """Make a direction of a mapping, checked."""
    solution, count = differentiator.solution, len(differentiator.tensions)
    zero = np.zeros(count)
    parts: dict[str, Floats] = {"tensions": zero, "displacements": zero}
    vectors: dict[str, Floats] = {}
    numbers: dict[str, float] = {}
    for name, value in given.items():
        paths = () if name in _LOADS else _paths(solution.robot, name)
        try:
            rate = validation.floats(value)
        except TypeError:
            rate = np.array(np.nan)
        shape = _shape(solution, name)
        if rate.shape != shape or not np.isfinite(rate).all():
            raise InputError(
                f"{name} is {shown(value)}, it must be finite numbers of shape {shape}"
            )
        if name in ACTUATION:
            other = (
                differentiator.by_displacement
                if name == "tensions"
                else ~differentiator.by_displacement
            )
            if (wrong := np.flatnonzero(other & (rate != 0.0))).size:
                kind = "displacement" if name == "tensions" else "tension"
                raise InputError(
                    f"tendon {wrong[0] + 1} has a given {kind}, so that {name} cannot change along "
                    "the line"
                )
            parts[name] = rate
        elif name in _LOADS:
            vectors[name] = rate
        else:
            numbers.update(dict.fromkeys(paths, float(rate)))
    direction = Direction(**parts, vectors=vectors, numbers=numbers)
    rates = [*parts.values(), *vectors.values(), np.array(list(numbers.values()))]
    if not any(rate.any() for rate in rates):
        raise InputError("the direction is zero; give the change of at least one number")
    return direction


def directional_derivatives(
    solution: Solution, direction: Mapping[str, ArrayLike]
) -> DirectionalDerivatives:
    """Differentiate an equilibrium twice along a direction of its load and its robot.

    The derivatives are those of the discretised robot at the same `elements`, by the tangent of the
    equilibrium and differences of high order of the imbalance (docs/theory/statics.md, Derivatives
    along a direction); no other equilibrium is solved.

    Parameters
    ----------
    solution : Solution
        Converged solution with straight tendons, without friction or another law of
        `bowstring.robot.laws`. Displacement-controlled tendons keep their displacement unless it
        changes.
    direction : mapping from str to array_like
        Changes per unit of the line: ``tensions`` (T,) in N, ``displacements`` (T,) in m,
        ``gravity``, ``tip_force``, ``tip_moment`` (3,), ``disk_forces``, ``disk_moments`` (N, 3),
        and numbers of the robot file by their paths, such as ``segments.*.backbone.E``, in SI.

    Returns
    -------
    DirectionalDerivatives
        First and second derivatives per unit of the line.

    Raises
    ------
    NoSolutionError
        If the solution did not converge, or is too close to losing stability.
    InputError
        If the direction is not valid, and as for `jacobians`.

    Examples
    --------
    How the tip moves as tendon 1 is pulled, in mm/N and mm/N^2:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> by = bs.directional_derivatives(bs.solve(robot, [40, 0, 0]), {"tensions": [1, 0, 0]})
    >>> (1e3 * by.first.tip_position).round(3), (1e3 * by.second.tip_position).round(4)
    (array([ 5.027,  0.   , -2.549]), array([-0.0304,  0.    , -0.0599]))
    """
    differentiator = Differentiator(solution)
    if not isinstance(direction, Mapping) or not all(isinstance(name, str) for name in direction):
        raise InputError(
            f"direction is {shown(direction)}, it must be a mapping such as "
            "{'tensions': [1, 0, 0]}"
        )
    return differentiator.differentiate(_direction(differentiator, direction))


def derivatives(
    solution: Solution,
    by: Sequence[str] | None = None,
    *,
    functions: Mapping[str, Callable[[Solution], ArrayLike]] | None = None,
) -> Derivatives:
    """Differentiate an equilibrium by numbers of its load, its actuation and its robot.

    All share one elimination of the tangent, as for `directional_derivatives`. For tensions, tip
    load and stiffness alone, `jacobians` is faster.

    Parameters
    ----------
    solution : Solution
        As for `directional_derivatives`.
    by : sequence of str, optional
        Variables, as there; a path with ``*`` is one variable that changes all its numbers alike.
        The actuation, tip force, tip moment and gravity if left out.
    functions : mapping from str to callable, optional
        Further results: functions of a `Solution` that return a number or an array, such as the
        largest stress or the natural frequencies. They are evaluated at seven nearby equilibria.

    Returns
    -------
    Derivatives
        ``found[of, by]`` for each of `QUANTITIES` and `functions`, NaN for the tension of a
        displacement-controlled tendon and the displacement of a tension-controlled one.

    Raises
    ------
    NoSolutionError
        If the solution did not converge, or is too close to losing stability.
    InputError
        If a variable does not exist or has no smooth effect, and as for `jacobians`.

    Examples
    --------
    By how many mm the tip moves if the backbone is 0.1 mm thicker, at given displacements:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> bent = bs.solve(robot, load=bs.Load(displacements=[0.02, -0.03, -0.03]))
    >>> by = bs.derivatives(bent, by=["displacements", "segments.0.backbone.diameter"])
    >>> by["tip_position", "displacements"].shape
    (3, 3)
    >>> (1e3 * by["tip_position", "segments.0.backbone.diameter"] * 1e-4).round(3)
    array([-0.014,  0.   ,  0.006])

    How the two lowest frequencies change with tension 1, in Hz/N:

    >>> def frequencies(near):
    ...     return bs.modes(near.robot, load=near.load, model=near.model, count=2).frequency_hz
    >>> taut = bs.solve(robot, [40, 0, 0])
    >>> by = bs.derivatives(taut, by=["tensions"], functions={"frequency": frequencies})
    >>> by["frequency", "tensions"][:, 0].round(4)
    array([0.0003, 0.0009])
    """
    differentiator = Differentiator(solution)
    functions = {} if functions is None else functions
    if not isinstance(functions, Mapping) or not all(map(callable, functions.values())):
        raise InputError(
            f"functions is {shown(functions)}, it must be a mapping from names to functions of a "
            "solution"
        )
    if taken := sorted(set(functions) & set(QUANTITIES)):
        raise InputError(f"functions has {taken[0]}, which is a result of every equilibrium")
    if by is None:
        controls = (~differentiator.by_displacement).any(), differentiator.by_displacement.any()
        kinds = [name for name, some in zip(ACTUATION, controls, strict=True) if some]
        by = [*kinds, "tip_force", "tip_moment", "gravity"]
    if (
        isinstance(by, str)
        or not isinstance(by, Sequence)
        or not all(isinstance(name, str) for name in by)
    ):
        raise InputError(f"by is {shown(by)}, it must be a list of variables such as 'tensions'")
    values: dict[tuple[str, str], Floats] = {}
    error, taut = 0.0, tuple((differentiator.switching + 1).tolist())
    for name in dict.fromkeys(by):
        shape = _shape(solution, name)
        columns: list[dict[str, Any] | None] = []
        for unit in np.eye(int(np.prod(shape))).reshape(-1, *shape):
            if name in ACTUATION and differentiator.by_displacement[unit.argmax()] == (
                name == "tensions"
            ):
                columns.append(None)
                continue
            direction = _direction(differentiator, {name: unit})
            found = differentiator.differentiate(direction)
            error = max(error, found.relative_error)
            own = differentiator.of_functions(direction, functions) if functions else {}
            columns.append({**{of: getattr(found.first, of) for of in QUANTITIES}, **own})
        known = next((column for column in columns if column is not None), None)
        if known is None:
            kind = "displacement" if name == "tensions" else "tension"
            raise InputError(f"no derivative by {name}: every tendon has a given {kind}")
        for of, first in known.items():
            nothing = np.full(np.shape(first), np.nan)
            stack = [nothing if column is None else column[of] for column in columns]
            array = np.moveaxis(np.stack(stack), 0, -1)
            values[of, name] = array.reshape((*np.shape(first), *shape))
    return Derivatives(values, error, taut)
