"""Inverse kinematics within limits of the tendon displacements.

Theory: docs/theory/inverse-kinematics.md (Limits of displacement).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.inverse.targets import across, write_row
from bowstring.statics import actuation
from bowstring.statics.derivatives import jacobians
from bowstring.statics.load_tables import row_of
from bowstring.statics.rod import solve

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.inverse.targets import Targets
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load
    from bowstring.statics.solution import Solution

#: Value of `InverseSolution.binding` where a limit of displacement binds.
BEYOND_DISPLACEMENT: Final = 2
_TOLERANCE: Final = 1e-9  # tolerance of a displacement over the length
_MOST_ITERATIONS: Final = 200
_KEPT: Final = 8  # equilibria: the optimiser asks for values and derivatives one by one


@dataclass
class _Equilibrium:
    """Equilibrium under tensions, with derivatives by them."""

    solution: Solution
    miss: Floats
    miss_by: Floats
    displacements: Floats
    displacements_by: Floats


class _Row:
    """Equilibria of one target, as a function of its scaled tensions."""

    def __init__(
        self,
        robot: Robot,
        target: tuple[Floats, Floats | None],
        load: Load,
        model: RodModel,
        home: Floats,
    ) -> None:
        self.robot, self.load, self.model, self.home = robot, load, model, home
        self.position, self.direction = target
        self.compliance = actuation.compliances(robot)
        self.across = across(self.direction)
        self._at = lru_cache(_KEPT)(self._solved)

    def at(self, tensions: Floats) -> _Equilibrium | None:
        """Equilibrium under tensions; None without one or without its derivatives."""
        return self._at(tuple(np.maximum(tensions, 0.0).tolist()))

    def _solved(self, tensions: tuple[float, ...]) -> _Equilibrium | None:
        solution = solve(self.robot, tensions, load=self.load, model=self.model)
        tip, lengths = solution.tip, solution.tendon_lengths
        if tip is None or lengths is None:
            return None
        by = jacobians(solution)
        tangent = tip.rotation[:, 2]
        miss = (tip.position - self.position) / self.robot.length
        turned = np.cross(by.tip_rotation_by_tension.T, tangent) @ self.across.T
        return _Equilibrium(
            solution,
            np.concatenate([miss, self.across @ tangent]),
            np.concatenate([by.tip_position_by_tension / self.robot.length, turned.T]),
            self.home - lengths + self.compliance * np.array(tensions),
            np.diag(self.compliance) - by.lengths_by_tension,
        )


def keep_displacements(
    robot: Robot,
    targets: Targets,
    limits: tuple[Floats, Floats],
    displacements: tuple[Floats, Floats],
    found: dict[str, Any],
    load: Load,
    model: RodModel,
    reached: float,
) -> None:
    """Replace rows whose displacements exceed their limits by rows within the limits.

    A row becomes the least tensions that reach the target within all limits or, where there are
    none, those with the nearest tip.

    Parameters
    ----------
    robot : Robot
    targets : Targets
    limits : (ndarray (T,), ndarray (T,))
        Least and largest tensions, N.
    displacements : (ndarray (T,), ndarray (T,))
        Least and largest displacements, m.
    found : dict
        Fields of `InverseSolution` without these limits; changed in place.
    load : Load
        Dead loads, or rows of them.
    model : RodModel
    reached : float
        Distance over length of a reached tip.

    Raises
    ------
    InputError
        If the robot has no home pose, from which displacements count.
    """
    home = actuation.home_lengths(robot, model)
    if home is None:
        raise InputError(
            f"{robot.name} has no home pose, as its pretensions have no stable equilibrium; leave "
            "displacement_limits out"
        )
    least, most = displacements
    compliance = actuation.compliances(robot)
    now = home - found["tendon_lengths"] + compliance * found["tensions"]
    near = _TOLERANCE * robot.length
    beyond = ((now < least - near) | (now > most + near)).any(axis=-1)
    start: Floats | None = None
    for k in range(len(now)):
        if not beyond[k]:  # rows without an equilibrium have NaN
            start = None
            continue
        own = row_of(load, k, len(now))
        chosen = model.replace(elements=int(found["elements"][k]))
        row = _Row(robot, targets.row(k), own, chosen, home)
        before = found["tensions"][k]
        best = _optimum(row, before if start is None else start, limits, displacements, reached)
        start = None if best is None else best[0]
        _write(row, best, k, found, limits, displacements, reached)


def _optimum(
    row: _Row,
    start: Floats,
    limits: tuple[Floats, Floats],
    displacements: tuple[Floats, Floats],
    reached: float,
) -> tuple[Floats, _Equilibrium] | None:
    """Least tensions at the target within the limits, or those of the nearest tip."""
    from scipy.optimize import minimize

    scale = max(float(limits[1].max()), 1e-300)
    arm = float(np.abs(displacements[1] - displacements[0]).max()) or row.robot.length
    count = len(start)

    class _Lost(Exception):
        """There is no equilibrium at the trial of the optimiser."""

    def at(x: Floats) -> _Equilibrium:
        there = row.at(x * scale)
        if there is None:
            raise _Lost
        return there

    def spare(x: Floats) -> Floats:
        now = at(x).displacements
        return np.concatenate([now - displacements[0], displacements[1] - now]) / arm

    def spare_by(x: Floats) -> Floats:
        by = at(x).displacements_by * (scale / arm)
        return np.concatenate([by, -by])

    kept = {"type": "ineq", "fun": spare, "jac": spare_by}
    there = {
        "type": "eq",
        "fun": lambda x: 1e3 * at(x).miss,
        "jac": lambda x: 1e3 * scale * at(x).miss_by,
    }

    def solved(x: Floats, objective: Any, constraints: Any) -> Floats | None:
        try:
            result = minimize(
                objective,
                x,
                jac=True,
                method="SLSQP",
                bounds=list(zip(limits[0] / scale, limits[1] / scale, strict=True)),
                constraints=constraints,
                options={"ftol": 1e-14, "maxiter": _MOST_ITERATIONS},
            )
        except _Lost:
            return None
        return np.asarray(np.clip(result.x, limits[0] / scale, limits[1] / scale))

    def small(x: Floats) -> tuple[float, Floats]:
        return 0.5 * float(x @ x), x

    def nearness(x: Floats) -> tuple[float, Floats]:
        now = at(x)
        # a small weight on the tensions, which the tip may not determine
        value = 0.5 * float(now.miss @ now.miss) + 5e-11 * float(x @ x)
        return 1e4 * value, 1e4 * (scale * now.miss @ now.miss_by + 1e-10 * x)

    def allowed(x: Floats | None) -> bool:
        return x is not None and bool((spare(x) > -1e-7).all())

    x = np.clip(start, *limits) / scale
    nearest = solved(x, nearness, [kept])
    if nearest is None or not allowed(nearest):
        # from tensions of equal size, which bend the robot little
        nearest = solved(np.full(count, float(x.mean())), nearness, [kept])
    if nearest is None or not allowed(nearest):
        return None
    if np.linalg.norm(at(nearest).miss) < 1e2 * reached:
        least = solved(nearest, small, [kept, there])
        if least is not None and allowed(least) and np.linalg.norm(at(least).miss) <= reached:
            nearest = least
    return nearest * scale, at(nearest)


def _write(
    row: _Row,
    best: tuple[Floats, _Equilibrium] | None,
    k: int,
    found: dict[str, Any],
    limits: tuple[Floats, Floats],
    displacements: tuple[Floats, Floats],
    reached: float,
) -> None:
    """Write the results of a row."""
    found["binding"][k] = 0
    if best is None:
        found["status"][k], found["stable"][k] = "no_equilibrium", None
        for name in ("tensions", "tip_position", "tip_rotation", "tendon_lengths"):
            found[name][k] = np.nan
        for name in ("distance", "nearest_distance", "direction_error", "tip_error"):
            found[name][k] = np.nan
        return
    tensions, at = best
    write_row(found, k, (row.position, row.direction), tensions, at.solution.core)
    if np.linalg.norm(at.miss) <= reached:
        found["status"][k] = "reached"
        return
    found["status"][k] = "unreachable"
    near, size = 1e-6 * row.robot.length, 1e-6 * limits[1]
    for limit, value in (
        (tensions <= limits[0] + size, -1),
        (tensions >= limits[1] - size, 1),
        (at.displacements <= displacements[0] + near, -BEYOND_DISPLACEMENT),
        (at.displacements >= displacements[1] - near, BEYOND_DISPLACEMENT),
    ):
        found["binding"][k][limit] = value
