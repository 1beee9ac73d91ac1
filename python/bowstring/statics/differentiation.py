"""Differentiation of an equilibrium, to second order, along lines of loads and robots.

Theory: docs/theory/statics.md (Derivatives along a direction).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import combinations
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bowstring._core import Linearised
from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.fields import quantity_of
from bowstring.robot.paths import numbers_of
from bowstring.statics import actuation
from bowstring.statics.derivatives import block_of_taut, check_smooth
from bowstring.statics.load import Load
from bowstring.statics.load_tables import with_arrays
from bowstring.statics.solution import Solution
from bowstring.statics.solution import solution as solved
from bowstring.validation import shown

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

#: Parts of a load that a direction can change: actuation, vectors, and vectors on disks.
ACTUATION: Final = ("tensions", "displacements")
VECTORS: Final = ("gravity", "tip_force", "tip_moment")
ON_DISKS: Final = ("disk_forces", "disk_moments")
#: Step of a difference over the natural size of a number.
_SHARE: Final = 3e-3
#: Largest motion of the tip in a step: rotation in rad, or displacement over the length.
_LARGEST: Final = 0.01
#: Relative error of the first derivatives above which the step is reduced, and by how much.
_INEXACT: Final = 1e-6
_SHORTER: Final = 0.3
_ATTEMPTS: Final = 6
#: Motion of the tip in a step, over the natural one, below which it counts as zero.
_RESTING: Final = 1e-3
#: Largest number of just taut tendons whose combinations are tried.
_MOST_SWITCHING: Final = 10
#: Load of the home pose.
_WEIGHTLESS: Final = Load(gravity=(0.0, 0.0, 0.0))


@short_repr
@dataclass(frozen=True, eq=False)
class Rates:
    """Derivatives of the results of an equilibrium along a line, per unit of the line."""

    tip_position: Floats
    """Position of the tip (3,), m."""
    tip_rotation: Floats
    """Rotation vector of the tip (3,) in the base frame, rad; the rotation R turns as
    dR = [tip_rotation]x R."""
    lengths: Floats
    """Lengths of the tendons (T,) from base hole to end disk, m."""
    tensions: Floats
    """Tensions of the tendons (T,), N."""
    elastic_energy: float
    """Elastic energy of the backbone, without that of elastic tendons, J."""
    disk_positions: Floats
    """Positions of the disks (N, 3), m."""


#: Results with derivatives.
QUANTITIES: Final = tuple(Rates.__dataclass_fields__)


@short_repr
@dataclass(frozen=True, eq=False)
class DirectionalDerivatives:
    """Derivatives of an equilibrium along a line; made by `directional_derivatives`."""

    first: Rates
    """First derivatives."""
    second: Rates
    """Second derivatives; of the rotation vector from the equilibrium to the moved tip."""
    relative_error: float
    """Estimated error of the differences for the first derivatives of the tip, over the largest of
    their kind, from a difference of a lower order; rounding adds up to about 1e-9."""
    just_taut: tuple[int, ...]
    """Numbers, from 1, of displacement-controlled tendons at the limit of slack: the derivatives
    hold in the direction given, and those of the opposite direction differ."""


class _Stencil(NamedTuple):
    """Finite difference on a line with unit steps."""

    offsets: Floats
    """Places, (n,)."""
    weights: Floats
    """Weights (3, n) of the first derivative, the same at a lower order, and the second."""

    def scaled(self, step: float) -> _Stencil:
        return _Stencil(
            self.offsets * step, self.weights / np.array([step, step, step * step])[:, None]
        )


@lru_cache
def _stencil(side: int) -> _Stencil:
    """Seven places around zero, or on one side of it (1 or -1)."""
    offsets = np.arange(7.0) - 3.0 if side == 0 else side * np.arange(7.0)

    def weights(places: Floats, order: int) -> Floats:
        powers = places ** np.arange(len(places))[:, None]
        right = np.zeros(len(places))
        right[order] = order  # 1 and 2 are their own factorials
        return np.asarray(np.linalg.solve(powers, right), dtype=np.float64)

    inner = slice(1, 6) if side == 0 else slice(0, 6)
    coarse = np.zeros(7)
    coarse[inner] = weights(offsets[inner], 1)
    return _Stencil(offsets, np.stack([weights(offsets, 1), coarse, weights(offsets, 2)]))


@dataclass(frozen=True)
class Direction:
    """Change of a load and of a robot along a line, per unit of it."""

    tensions: Floats
    """Changes of the tensions of tension-controlled tendons (T,), N."""
    displacements: Floats
    """Changes of the displacements of displacement-controlled tendons (T,), m."""
    vectors: dict[str, Floats] = field(default_factory=dict)
    """Changes of `VECTORS` (3,) and `ON_DISKS` (N, 3), in SI."""
    numbers: dict[str, float] = field(default_factory=dict)
    """Changes of numbers of the robot file by path, in SI."""


class _Lines(NamedTuple):
    """Results along a line: numbers of the core, and home length and compliance of the tendons.

    Each has three rows: first derivative, the same at a lower order, second derivative.
    """

    numbers: Floats
    home: Floats
    compliance: Floats


class Differentiator:
    """Differentiates an equilibrium along lines of loads and robots, to second order."""

    def __init__(self, solution: Solution) -> None:
        check_smooth(solution)
        if solution.undetermined:
            raise InputError(
                "several sets of tensions have the pose of the solution, so that they have no "
                "derivatives; take an extensible backbone (bowstring.RodModel()) or fewer taut "
                "tendons"
            )
        core = Linearised.at(solution.core)
        if core is None:
            raise NoSolutionError(f"{solution.robot.name}: no derivatives at this equilibrium")
        self.core = core
        self.solution, self.robot, self.load = solution, solution.robot, solution.load
        self.tensions = solution.tensions
        count = len(self.tensions)
        given = solution.core.by_displacement
        self.by_displacement = np.zeros(count, bool) if given is None else given
        self.held = self.by_displacement & (self.tensions > 0.0)
        loose = self.by_displacement & ~self.held
        lengths = solution.slack_lengths
        slack = np.zeros(count, bool)
        slack[actuation.slack(self.robot, np.zeros(count) if lengths is None else lengths)] = True
        self.switching = np.flatnonzero(loose & ~slack)
        if len(self.switching) > _MOST_SWITCHING:
            raise InputError(
                f"{len(self.switching)} tendons are at the limit of slack at once, at most "
                f"{_MOST_SWITCHING} can be; give the robot a pretension, or move it away from there"
            )

    # ---------------------------------------------------------------------------------------
    # Lines of loads and robots
    # ---------------------------------------------------------------------------------------

    def natural_step(self, direction: Direction) -> float:
        """Step along a direction that changes the pose little."""
        moment, arm, mass = self._scales
        force = moment / self.robot.length
        sizes = {
            "tip_force": force,
            "disk_forces": force,
            "tip_moment": moment,
            "disk_moments": moment,
            "gravity": min(force / mass, 10.0 / _SHARE) if mass > 0.0 else 10.0,
        }
        steps = [
            (moment / arm, direction.tensions),
            (arm, direction.displacements),
            *((sizes[name], rate) for name, rate in direction.vectors.items()),
            *((self._size(path), np.array(v)) for path, v in direction.numbers.items()),
        ]
        shares = [float(np.abs(rate).max(initial=0.0)) / size for size, rate in steps]
        # a rate below the smallest numbers has no share
        return _SHARE / max(*shares, float(np.finfo(float).tiny))

    def _size(self, path: str) -> float:
        """Natural size of a number of the robot file."""
        value = abs(self._numbers[path])
        if value > 0.0:
            return value
        quantity = quantity_of(self.robot, path)
        si = "" if quantity is None else quantity.si
        moment, arm, mass = self._scales
        sizes = {
            "m": arm,
            "rad": 1.0,
            "N": moment / arm,
            "m/N": arm * arm / moment,
            "kg": mass or 1.0,
            "kg*m^2": 1e-6 * mass * arm * arm or 1.0,
        }
        return sizes.get(si, 1.0)

    @cached_property
    def _scales(self) -> tuple[float, float, float]:
        """Moment in N m, pitch radius in m and carried mass in kg."""
        robot = self.robot
        arms = robot.tendons.arm_m
        return (
            float(robot.bending_stiffness.min()) / robot.length,
            float(arms.mean()) if arms.any() else robot.length,
            float(robot.disks.mass_kg.sum() + robot.carried_kg.sum()),
        )

    @cached_property
    def _numbers(self) -> dict[str, float]:
        return dict(numbers_of(self.robot))

    def robots(
        self, direction: Direction, step: float, sides: tuple[int, ...] = (0, 1, -1)
    ) -> tuple[_Stencil, list[Robot] | None]:
        """Stencil and robots along a direction; one-sided where a number is at its limit."""
        if not direction.numbers:
            return _stencil(sides[0]).scaled(step), None
        refused: InputError | None = None
        for side in sides:
            stencil = _stencil(side).scaled(step)
            try:
                return stencil, [
                    self.robot if s == 0.0 else self._robot(direction, s)
                    for s in stencil.offsets.tolist()
                ]
            except InputError as error:
                # keep the error of an increase: the others may come from a limit
                refused = error if refused is None or side == 1 else refused
        said = str(refused).partition("\n")[0].rstrip(".")  # its advice is on values of a user
        raise InputError(f"no derivative by {', '.join(direction.numbers)}: {said}")

    def _robot(self, direction: Direction, place: float) -> Robot:
        """Robot at a place on the line."""
        robot = self.robot.with_(
            {path: self._numbers[path] + place * v for path, v in direction.numbers.items()}
        )
        if self._places(robot) != self._places(self.robot):
            raise InputError(
                "a point load at an arc length comes to a disk or leaves one, so that its effect "
                "is not smooth"
            )
        return robot

    def _places(self, robot: Robot) -> list[list[int]]:
        """Disks before, and at or before, the sections on which point loads act."""
        arcs = [load.arc_length for load in self.load.point_loads or ()]
        sections = np.array([arc for arc in arcs if arc is not None])
        near = 1e-6 * robot.length
        stations = robot.disks.station_m
        return [np.searchsorted(stations, sections + way).tolist() for way in (-near, near)]

    def loads(self, direction: Direction, offsets: Floats, tensions: Floats) -> tuple[Floats, Load]:
        """Tensions (n, T) and other loads at the offsets of a line."""
        core = self.solution.core
        changed: dict[str, Floats] = {}
        for name in (*VECTORS, *ON_DISKS):
            now, rate = getattr(core, name), direction.vectors.get(name)
            if rate is not None:
                now = np.zeros_like(rate) if now is None else now
                changed[name] = now + np.multiply.outer(offsets, rate)
            elif now is not None:
                changed[name] = now
        load = self.load.replace(tensions=None, displacements=None, **changed)
        rows = self.tensions + np.multiply.outer(offsets, tensions)
        return rows, with_arrays(load, " or (n, N, 3)")

    def along(
        self,
        direction: Direction,
        stencil: _Stencil,
        robots: list[Robot] | None,
        tensions: Floats,
    ) -> _Lines:
        """Derivatives along a direction with these changes of the tensions."""
        rows, load = self.loads(direction, stencil.offsets, tensions)
        cores = None if robots is None else [robot.core for robot in robots]
        found = self.core.along(cores, rows, load, *stencil)
        still = np.zeros((3, len(self.tensions)))
        if robots is None or not self.by_displacement.any():
            return _Lines(np.stack(found), still, still)
        # theory Eq. 4.1: a tendon has its unstretched length l0 - C T0 at zero displacement
        pretension = np.stack([robot.tendons.pretension_N for robot in robots])
        compliance = np.stack([actuation.compliances(robot) for robot in robots])
        at_home = self._home.along(cores, pretension, _WEIGHTLESS, *stencil)
        home = np.stack(at_home)[:, self._lengths] - stencil.weights @ (compliance * pretension)
        return _Lines(np.stack(found), home, stencil.weights @ compliance)

    @cached_property
    def _home(self) -> Linearised:
        """Home pose, from which displacements are counted."""
        robot = self.robot
        home = robot.core.solve(robot.tendons.pretension_N, _WEIGHTLESS, self.solution.model)
        core = Linearised.at(home)
        if core is None:
            raise NoSolutionError(f"{robot.name}: no derivatives at the home pose")
        return core

    @property
    def _lengths(self) -> slice:
        """Lengths of the tendons among the numbers of the core."""
        return slice(7, 7 + len(self.tensions))

    # ---------------------------------------------------------------------------------------
    # Tendons at given displacements
    # ---------------------------------------------------------------------------------------

    @cached_property
    def by_tension(self) -> Floats:
        """First derivatives (n, T) by the tensions of tendons that are or may become taut."""
        count = len(self.tensions)
        columns = []
        for i, unit in enumerate(np.eye(count)):
            if not (self.held[i] or i in self.switching):
                columns.append(np.zeros(self._size_of_row))
                continue
            direction = Direction(unit, np.zeros(count))
            stencil = _stencil(0).scaled(self.natural_step(direction))
            columns.append(self.along(direction, stencil, None, unit).numbers[0])
        return np.stack(columns, axis=1)

    @property
    def _size_of_row(self) -> int:
        return 7 + len(self.tensions) + 3 * len(self.robot.disks.station_m)

    @cached_property
    def _displacement_by_tension(self) -> Floats:
        """Displacement by tension (T, T) of tendons that keep their length, m/N."""
        # theory Eq. 4.1: displacement = home length - length + compliance * tension - slack
        own = np.diag(actuation.compliances(self.robot))
        answer: Floats = own - self.by_tension[self._lengths]
        return answer

    def _tension_rates(self, wanted: Floats, held: Bools) -> Floats:
        """Tensions that change the displacements of taut tendons as wanted; zero for others."""
        rates = np.zeros(len(wanted))
        if held.any():
            block = block_of_taut(self._displacement_by_tension, np.flatnonzero(held))
            rates[held] = np.linalg.solve(block, wanted[held])
        return rates

    def first_tensions(self, wanted: Floats) -> tuple[Floats, Bools]:
        """First derivatives of the tensions, and which tendons are taut along the line.

        `wanted` are the changes of displacement that the tensions have to make. A tendon at the
        limit of slack becomes taut or slack, whichever is consistent.
        """
        least = 1e-9 * max(1.0, float(np.abs(wanted).max(initial=0.0)))
        for size in range(len(self.switching) + 1):
            for taut in combinations(self.switching.tolist(), size):
                held = self.held.copy()
                held[list(taut)] = True
                rates = self._tension_rates(wanted, held)
                slack = self._displacement_by_tension @ rates - wanted
                free = [i for i in self.switching.tolist() if i not in taut]
                if (rates[list(taut)] >= 0.0).all() and (slack[free] >= -least).all():
                    return rates, held
        raise NoSolutionError(
            f"{self.robot.name}: no state of the tendons at the limit of slack fits this direction"
        )

    # ---------------------------------------------------------------------------------------

    def differentiate(self, direction: Direction) -> DirectionalDerivatives:
        """First and second derivatives along a direction."""
        step = self.natural_step(direction)
        for _ in range(_ATTEMPTS):
            stencil, robots = self.robots(direction, step)
            tensions, held = direction.tensions, self.held
            lines = self.along(direction, stencil, robots, tensions)
            inexact = np.zeros(len(tensions))
            if self.by_displacement.any():
                free = lines.home - lines.numbers[:, self._lengths]
                free += lines.compliance * self.tensions
                rates, held = self.first_tensions(direction.displacements - free[0])
                inexact = self._tension_rates(free[0] - free[1], held)
                tensions = tensions + rates
                if rates.any():
                    lines = self.along(direction, stencil, robots, tensions)
            first, coarse = lines.numbers[:2]
            coarse = coarse + self.by_tension @ inexact if inexact.any() else coarse
            motion = max(
                float(np.linalg.norm(first[3:6])),
                float(np.linalg.norm(first[:3])) / self.robot.length,
            )
            # a tip that stays in place moves by rounding alone
            least = _RESTING * _SHARE / step
            error = _relative_error(first, coarse, (least * self.robot.length, least))
            if motion * step > _LARGEST:
                step *= min(_SHORTER, _LARGEST / (motion * step))
            elif error > _INEXACT:
                step *= _SHORTER
            else:
                break
        second = lines.numbers[2]
        bent = np.zeros(len(tensions))
        if held.any():
            off = lines.home[2] - second[self._lengths] + lines.compliance[2] * self.tensions
            bent = self._tension_rates(-(off + 2.0 * lines.compliance[0] * tensions), held)
            second = second + self.by_tension @ bent
        if not (np.isfinite(first).all() and np.isfinite(second).all()):
            raise NoSolutionError(f"{self.robot.name}: no derivatives at this equilibrium")
        return DirectionalDerivatives(
            self._rates(first, tensions),
            self._rates(second, bent),
            error,
            tuple((self.switching + 1).tolist()),
        )

    def _rates(self, row: Floats, tensions: Floats) -> Rates:
        ends = 7 + len(self.tensions)
        return Rates(
            tip_position=row[:3],
            tip_rotation=row[3:6],
            lengths=row[7:ends],
            tensions=tensions,
            elastic_energy=float(row[6]),
            disk_positions=row[ends:].reshape(-1, 3),
        )

    # ---------------------------------------------------------------------------------------

    def of_functions(
        self, direction: Direction, functions: Mapping[str, Callable[[Solution], ArrayLike]]
    ) -> dict[str, Floats]:
        """First derivatives of functions of a solution, from the equilibria along a direction."""
        at_limit = len(self.switching) > 0 or (self.tensions[direction.tensions > 0.0] <= 0.0).any()
        stencil, robots = self.robots(
            direction, self.natural_step(direction), (1,) if at_limit else (0, 1, -1)
        )
        rows, load = self.loads(direction, stencil.offsets, direction.tensions)
        commanded = self.load.displacements
        values: dict[str, list[Floats]] = {name: [] for name in functions}
        for i, s in enumerate(stencil.offsets.tolist()):
            changes: dict[str, Any] = {name: getattr(load, name)[i] for name in direction.vectors}
            if commanded is None:
                changes["tensions"] = rows[i]
            else:
                changes["tensions"] = self.load.tensions + s * direction.tensions
                changes["displacements"] = commanded + s * direction.displacements
            robot = self.robot if robots is None else robots[i]
            near = solved(robot, self.load.replace(**changes), self.solution.model)
            near.raise_for_status()
            for name, function in functions.items():
                values[name].append(_result(name, function(near)))
                if values[name][-1].shape != values[name][0].shape:
                    raise InputError(
                        f"{name} has shape {values[name][0].shape} at one solution and "
                        f"{values[name][-1].shape} beside it, which has no derivative"
                    )
        return {
            name: np.tensordot(stencil.weights[0], np.stack(rows_), axes=1)
            for name, rows_ in values.items()
        }


def _result(name: str, value: object) -> Floats:
    """Result of a user's function."""
    try:
        if value is None:
            raise TypeError
        return np.asarray(value, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise InputError(
            f"{name} returned {shown(value)}, it must return a number or an array of numbers"
        ) from None


def _relative_error(first: Floats, coarse: Floats, least: Sequence[float]) -> float:
    """Largest difference over the largest number of its kind: position and rotation of the tip."""
    errors = [
        float(np.abs(first[kind] - coarse[kind]).max())
        / max(float(np.abs(first[kind]).max()), small)
        for kind, small in zip((slice(0, 3), slice(3, 6)), least, strict=True)
    ]
    return max(errors)
