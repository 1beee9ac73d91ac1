"""Inverse kinematics of tendons with friction, row after row of a path.

Theory: docs/theory/inverse-kinematics.md (Friction).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bowstring._core import RodModel
from bowstring._core import inverse_kinematics as _inverse_kinematics
from bowstring.aliases import Floats
from bowstring.inverse.targets import Targets, across, write_row
from bowstring.statics import actuation
from bowstring.statics.load import Load
from bowstring.statics.load_tables import row_of

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_MOST_STEPS: Final = 40
_RADIUS: Final = 0.3  # first and largest change of a tension in a step, over its scale
_LEAST_RADIUS: Final = 1e-9
_DIFFERENCE: Final = 1e-5  # change of a tension for the derivatives, over its scale
_MORE_STARTS: Final = 6  # starts where the last row and the inverse without friction fail
_SPREAD: Final = 0.05  # spread of these starts over the scale of the tensions
_RIDGE: Final = 1e-6  # share of the largest derivative: holds undetermined tensions


class _Landed(NamedTuple):
    """Tip under tensions, relative to its target."""

    tensions: Floats
    miss: Floats
    """Position of the tip from its target over the length and, with a direction, components of
    the tangent across it (3 or 5)."""

    @property
    def size(self) -> float:
        """Distance from the target over the length."""
        return float(np.linalg.norm(self.miss))


class _Row:
    """Target of one row, and steps to tensions from the present state of its path."""

    def __init__(
        self,
        path: actuation.Path,
        target: tuple[Floats, Floats | None],
        limits: tuple[Floats, Floats],
        load: Load,
    ) -> None:
        self.path, self.load = path, load
        self.position, self.direction = target
        self.least, self.most = limits
        self.scale = np.maximum(self.most, 1e-3 * float(self.most.max()))
        self.across = across(self.direction)

    def landed(self, tensions: Floats) -> list[_Landed | None]:
        """Steps to tensions (n, T); None where there is no equilibrium."""
        kinds = np.zeros(tensions.shape, dtype=bool)
        found = self.path.core.follow(kinds, tensions, self.load, False, 1)
        offset = (found["tip_position"] - self.position) / self.path.robot.length
        tangent = found["tip_rotation"][:, :, 2] @ self.across.T
        return [
            _Landed(row, np.concatenate([offset[k], tangent[k]])) if done else None
            for k, (row, done) in enumerate(zip(tensions, found["converged"], strict=True))
        ]

    def nearest(self, start: Floats, reached: float) -> tuple[_Landed | None, int]:
        """Tensions that lead nearest to the target, and the number of steps.

        Gauss-Newton steps within the limits and a box. The tip by a tension has a kink where holes
        begin to slip: first the derivatives to the side of the last step are used, which are
        half of them, and where this brings the tip no nearer, those to both sides.
        """
        (now,) = self.landed(np.clip(start, self.least, self.most)[None])
        if now is None:
            return None, 1
        radius, side = _RADIUS, np.ones(len(start))
        columns: dict[float, Floats] = {}
        for steps in range(1, _MOST_STEPS):
            if now.size <= reached:
                return now, steps
            both = bool(columns)
            if not both:
                columns[1.0] = self._derivatives(now, side)
            elif len(columns) == 1:
                columns[-1.0] = self._derivatives(now, -side)
            step = self._step(now, side, columns, radius)
            there = np.clip(now.tensions + step, self.least, self.most)  # except for rounding
            (after,) = self.landed(there[None])
            if after is None or after.size >= now.size:
                if both:
                    radius = 0.25 * float(np.abs(step / self.scale).max())
            else:
                slow = both and after.size > 0.999 * now.size
                radius = min(2.0 * radius, _RADIUS)
                side = np.where(step < 0.0, -1.0, 1.0)
                now, columns = after, {}
                if slow and now.size > reached:
                    return now, steps
            if radius < _LEAST_RADIUS:
                return now, steps
        return now, _MOST_STEPS

    def _derivatives(self, now: _Landed, side: Floats) -> Floats:
        """Derivatives (3 or 5, T) of the miss by tensions over their scale; zero beyond limits."""
        moves = _DIFFERENCE * side
        there = now.tensions + np.diag(moves * self.scale)
        allowed = (np.diag(there) >= self.least) & (np.diag(there) <= self.most)
        landed = self.landed(np.where(allowed[:, None], there, now.tensions))
        slope = np.zeros((len(now.miss), len(side)))
        for i, near in enumerate(landed):
            if near is not None:
                slope[:, i] = (near.miss - now.miss) / moves[i]
        return slope

    def _step(
        self, now: _Landed, side: Floats, columns: dict[float, Floats], radius: float
    ) -> Floats:
        """Least-squares change of the tensions within the limits and a box."""
        from scipy.optimize import lsq_linear

        count = len(side)
        down = np.minimum((now.tensions - self.least) / self.scale, radius)
        up = np.minimum((self.most - now.tensions) / self.scale, radius)
        if len(columns) == 1:
            matrix, low, high = columns[1.0], -down, up
        else:  # one unknown for each side
            towards, back = side * columns[1.0], -side * columns[-1.0]
            low = np.zeros(2 * count)
            high = np.concatenate([np.where(side > 0.0, up, down), np.where(side > 0.0, down, up)])
            matrix = np.concatenate([towards, back], axis=1)
        ridge = _RIDGE * float(np.linalg.norm(matrix, 2)) * np.eye(matrix.shape[1])
        right = np.concatenate([-now.miss, np.zeros(len(ridge))])
        high = np.maximum(high, low + 1e-15)  # the solver asks for an interval
        found = lsq_linear(np.concatenate([matrix, ridge]), right, (low, high), method="bvls")
        change = found.x
        if len(columns) == 2:
            change = side * (change[:count] - change[count:])
        return np.asarray(change * self.scale)

    def binding(self, at: _Landed) -> NDArray[np.int8]:
        """Limits that the tensions are at: -1 the least, 1 the largest."""
        near = 1e-9 * self.scale
        high, low = at.tensions >= self.most - near, at.tensions <= self.least + near
        return np.where(high, 1, np.where(low, -1, 0)).astype(np.int8)


def follow_with_friction(
    robot: Robot,
    targets: Targets,
    limits: tuple[Floats, Floats],
    load: Load,
    model: RodModel,
    *,
    path: bool,
    reached: float,
) -> dict[str, Any]:
    """Tensions for poses of the tip, in the fields of `InverseSolution`.

    Each row starts from the state that the row before it left or, without `path`, from home.

    Parameters
    ----------
    robot : Robot
    targets : Targets
    limits : (ndarray (T,), ndarray (T,))
        Least and largest tensions, N.
    load : Load
        Dead loads, or rows of them.
    model : RodModel
    path : bool
        Whether the rows are one path.
    reached : float
        Distance over length of a reached tip.
    """
    count, tendons = len(targets.positions), robot.core.tendon_count
    state = actuation.Path(robot, model)
    free = _inverse_kinematics(robot.core, targets, limits, load, model, None if path else 0)
    # `more` are the tensions of the last row beyond those of the inverse without friction
    last, more = robot.tendons.pretension_N, np.zeros(tendons)
    numbers = {
        name: np.full((count, *shape), np.nan)
        for name, shape in (
            ("tensions", (tendons,)),
            ("tip_position", (3,)),
            ("tip_rotation", (3, 3)),
            ("distance", ()),
            ("nearest_distance", ()),
            ("direction_error", ()),
            ("tendon_lengths", (tendons,)),
            ("tip_error", ()),
            ("held_displacements", (tendons,)),
        )
    }
    found: dict[str, Any] = {
        "status": ["no_equilibrium"] * count,
        "stable": [None] * count,
        **numbers,
        "binding": np.zeros((count, tendons), dtype=np.int8),
        "iterations": np.zeros(count, dtype=np.int64),
        "restarted": np.zeros(count, dtype=bool),
        "elements": np.zeros(count, dtype=np.int64),
    }
    for k in range(count):
        if not path:
            state.core.reset()
            last, more = robot.tendons.pretension_N, np.zeros(tendons)
        own = row_of(load, k, count)
        if not np.isfinite(free["tensions"][k]).all():
            continue
        row = _Row(state, targets.row(k), limits, own)
        best = None
        # the second start is the last state, from which a hole slips to either side
        spread = _SPREAD * row.scale * np.random.default_rng(k).normal(size=(_MORE_STARTS, tendons))
        for start in (free["tensions"][k] + more, last, *(last + spread)):
            near, steps = row.nearest(start, reached)
            found["iterations"][k] += steps
            if near is not None and (best is None or near.size < best.size):
                best = near
            if best is not None and best.size <= reached:
                break
        if best is None:
            continue
        step = state.core.step(np.zeros(tendons, dtype=bool), best.tensions, own)
        if not step.converged:
            continue
        last, more = best.tensions, best.tensions - free["tensions"][k]
        write_row(found, k, targets.row(k), best.tensions, step)
        found["held_displacements"][k] = step.displacements
        found["elements"][k] = step.model.elements or 0
        if best.size <= reached:
            found["status"][k] = "reached"
            continue
        found["status"][k] = "max_iterations"
        found["binding"][k] = row.binding(best)
    return found
