"""Points of a space of designs and loads, and the errors of constant curvature there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot
from bowstring.robot.paths import full_paths
from bowstring.robot.stiffness import couples, entry_of
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.units import number_with_unit
from bowstring.validity.axes import RAMPS, Axis
from bowstring.validity.dead_loads import dead_loads
from bowstring.validity.effects import EFFECTS, Rods, acting, without
from bowstring.validity.errors import Ramps, follow, tip_offsets

COUPLED: Final = "beside coupled strains of the backbone this effect is not examined"
"""Why straight spans of a backbone with coupled strains are not among the causes."""
_MOST_DISKS: Final = 10_000  # of a robot; more would delay Ctrl-C by seconds
_MOST_CORNERS: Final = 4  # axes whose ends are all tried with each other


@short_repr
@dataclass(frozen=True)
class RampErrors:
    """Errors of constant curvature at P points, along a ramp of L tensions or bends each."""

    ramp: Floats
    """Tensions, N, or commanded bends, rad, (P, L)."""
    length: Floats
    """Lengths of the robots (P,), m."""
    converged: Bools
    """Whether each load has a stable equilibrium (P, L)."""
    tip: Floats
    """Tips by statics (P, L, 3), m."""
    tip_error: Floats
    """Their estimated errors (P, L), m."""
    error: dict[str, Floats]
    """Tip errors by model (P, L), m."""
    slack: Bools
    """Whether a tendon is slack at the end of a ramp of bends (P,)."""
    gave_up: Bools
    """Whether the solver gave up at each load (P, L)."""

    @classmethod
    def empty(cls, points: int, loads: int, names: Sequence[str]) -> RampErrors:
        """Arrays for `put` to fill."""
        shape = (points, loads)
        return cls(
            np.zeros(shape),
            np.zeros(points),
            np.zeros(shape, bool),
            np.full((*shape, 3), np.nan),
            np.full(shape, np.nan),
            {name: np.full(shape, np.nan) for name in names},
            np.zeros(points, bool),
            np.zeros(shape, bool),
        )

    def put(
        self, rows: NDArray[np.intp], known: Designs, ramps: Ramps, offsets: Mapping[str, Floats]
    ) -> None:
        """Set some points: robots, their ramps by statics, and offsets (D, L, 3) by model, m."""
        self.ramp[rows] = ramps.ramp
        if ramps.slack is not None:
            self.slack[rows] = ramps.slack[:, -1]
        self.length[rows] = known.length
        self.converged[rows] = ramps.converged
        self.tip[rows] = ramps.tip
        self.tip_error[rows] = ramps.tip_error
        self.gave_up[rows] = ramps.gave_up
        for name, offset in offsets.items():
            self.error[name][rows] = np.linalg.norm(offset, axis=-1)

    @property
    def solved(self) -> Bools:
        """Whether all loads of a ramp have a stable equilibrium (P,)."""
        return np.asarray(self.converged.all(axis=1))

    @property
    def solved_to(self) -> Floats:
        """Load up to which a ramp is solved (P,), N or rad; NaN where its first load is not."""
        loads = self.converged.shape[1]
        count = np.where(self.solved, loads, np.argmin(self.converged, axis=1))
        ends = self.ramp[np.arange(len(count)), np.maximum(count - 1, 0)]
        return np.asarray(np.where(count > 0, ends, np.nan))

    @property
    def unknown(self) -> Bools:
        """Whether the solver gave up at the first load of a ramp that is not solved (P,)."""
        first = np.argmin(self.converged, axis=1)
        return np.asarray(~self.solved & self.gave_up[np.arange(len(first)), first])

    def is_solved(self, metric: str, name: str, tolerance: float) -> Bools:
        """Whether all loads that a metric of a model covers have a stable equilibrium (P,).

        Every metric covers the whole ramp, except that ``valid_to`` ends at the first crossing of
        the tolerance.
        """
        if metric != "valid_to":
            return self.solved
        first, loads = self._stop(name, tolerance), self.converged.shape[1]
        at_end = self.converged[np.arange(len(first)), np.minimum(first, loads - 1)]
        return np.asarray((first == loads) | at_end)

    def is_defined(self, metric: str, name: str, tolerance: float) -> Bools:
        """Whether a model has an error at all loads that a metric covers (P,)."""
        known = np.isfinite(self.error[name])  # not where a load has no equilibrium
        if metric == "error":
            return np.asarray(self.solved & known[:, -1])
        if metric != "valid_to":
            return np.asarray(known.all(axis=1))
        first, loads = self._stop(name, tolerance), known.shape[1]
        at_end = known[np.arange(len(first)), np.minimum(first, loads - 1)]
        return np.asarray((first == loads) | at_end)

    def metric(self, metric: str, name: str, tolerance: float) -> Floats:
        """A metric of a model (P,), one of `bowstring.validity.map_settings.METRICS`.

        An error is NaN where some load of the ramp has no equilibrium, or the model has no arc at a
        load that the metric covers. Such a point never holds the tolerance.
        """
        if metric == "valid_to":
            return self.valid_to(name, tolerance)
        of = {"largest_error": self.worst, "mean_error": self.mean, "error": self.last}
        return np.where(self.is_defined(metric, name, tolerance), of[metric](name), np.nan)

    def worst(self, name: str) -> Floats:
        """Largest error over the ramp (P,), as a share of the length; NaN without any.

        Between loads the error is a parabola through the largest one and its neighbours.
        """
        error = self.error[name] / self.length[:, None]
        known = np.isfinite(error)
        peak = np.argmax(np.where(known, error, -1.0), axis=1)
        rows = np.arange(len(error))
        top = np.where(known.any(axis=1), error[rows, peak], np.nan)
        inner = np.clip(peak, 1, error.shape[1] - 2)
        a, b, c = (error[rows, inner + i] for i in (-1, 0, 1))
        bent = a - 2.0 * b + c
        with np.errstate(divide="ignore", invalid="ignore"):
            vertex = b - (c - a) ** 2 / (8.0 * bent)
        use = (inner == peak) & np.isfinite(vertex) & (bent < 0.0)
        return np.where(use, np.fmax(top, vertex), top)

    def last(self, name: str) -> Floats:
        """Error at the end of the ramp (P,), as a share of the length."""
        return np.asarray(self.error[name][:, -1] / self.length)

    def mean(self, name: str) -> Floats:
        """Mean error over the loads of the ramp that have one (P,), as a share of the length."""
        error = self.error[name]
        known = np.isfinite(error)
        total = np.where(known, error, 0.0).sum(axis=1)
        with np.errstate(invalid="ignore"):
            return np.asarray(total / known.sum(axis=1) / self.length)

    def valid_to(self, name: str, tolerance: float) -> Floats:
        """Validity limit (P,), N: first crossing of the tolerance, or the end of what has an error.

        Between loads the error is a cubic with the slopes of central differences. 0 where the first
        load is above the tolerance; NaN without an error there, or at the second load where the
        first is within the tolerance.
        """
        share = self.error[name] / self.length[:, None]
        known = np.isfinite(share)
        rows = np.arange(len(share))
        above = known & (np.nan_to_num(share) > tolerance)
        first = self._stop(name, tolerance)
        crosses = (first < share.shape[1]) & above[rows, np.minimum(first, share.shape[1] - 1)]
        before = np.maximum(first - 1, 0)
        limit = self.ramp[rows, before]
        at = rows[crosses & (first > 0)]
        if at.size:
            k = first[at]
            limit[at] = _crossing(self.ramp[at], share[at], k, tolerance)
        limit[first == 0] = 0.0
        return np.where(known[:, 0] & (known[:, 1] | (first == 0)), limit, np.nan)

    def _stop(self, name: str, tolerance: float) -> NDArray[np.intp]:
        """First load of each ramp (P,) without an error or above the tolerance; L without any."""
        share = self.error[name] / self.length[:, None]
        holds = np.isfinite(share) & (np.nan_to_num(share) <= tolerance)
        return np.asarray(np.where(holds.all(axis=1), share.shape[1], np.argmin(holds, axis=1)))


def _crossing(x: Floats, y: Floats, k: NDArray[np.intp], level: float) -> Floats:
    """Where the cubic between points k - 1 and k of each row crosses a level."""
    rows = np.arange(len(k))
    last = x.shape[1] - 1

    def slope(i: NDArray[np.intp]) -> Floats:
        low, high = np.maximum(i - 1, 0), np.minimum(i + 1, last)
        high = np.where(np.isfinite(y[rows, high]), high, i)
        rise = (y[rows, high] - y[rows, low]) / (x[rows, high] - x[rows, low])
        return np.asarray(rise)

    x0, x1 = x[rows, k - 1], x[rows, k]
    y0, y1, h = y[rows, k - 1], y[rows, k], x1 - x0
    d0, d1 = slope(k - 1) * h, slope(k) * h
    low, high = np.zeros(len(k)), np.ones(len(k))
    for _ in range(40):
        t = 0.5 * (low + high)
        value = (
            y0 * (1 + 2 * t) * (1 - t) ** 2
            + d0 * t * (1 - t) ** 2
            + y1 * t**2 * (3 - 2 * t)
            + d1 * t**2 * (t - 1)
        )
        over = value > level
        low, high = np.where(over, low, t), np.where(over, t, high)
    return np.asarray(x0 + h * high)


@short_repr
@dataclass(frozen=True)
class DesignSpace:
    """Space of designs and loads: every point has a robot, a load and a ramp of tension.

    A point is a row of values in SI, one for each axis. The ramp goes from zero to `max_tension`,
    or to the value of the axis ``tension``. With the axis ``bend`` it is a ramp of bends that
    constant curvature commands by displacements.
    """

    robot: Robot
    """Robot of all numbers that no axis changes."""
    axes: tuple[Axis, ...]
    """Axes of the points."""
    shares: Floats
    """Share (T,) of the ramp's tension in each tendon."""
    max_tension: float
    """End of the ramp where no axis is the tension, N; NaN with an axis bend."""
    model: RodModel
    """Rod theory and tendon path."""
    load: Load = field(default_factory=Load)
    """Gravity (that of the robot if None) and tip force that no axis changes."""
    loads: int = 17
    """Loads of the ramp."""
    fixed: tuple[tuple[Axis, float], ...] = ()
    """Further axes with one value each, SI."""

    @property
    def all_axes(self) -> tuple[Axis, ...]:
        """Axes of the points, and those that have one value."""
        return (*self.axes, *(axis for axis, _ in self.fixed))

    @property
    def by_displacement(self) -> bool:
        """Whether the ramp is one of commanded bends."""
        return any(axis.path == "bend" for axis in self.all_axes)

    @property
    def has_friction(self) -> bool:
        """Whether the tendons of some point may have friction."""
        varies = any(axis.path.endswith(".friction") for axis in self.all_axes)
        return varies or self.robot.has_friction

    @property
    def not_examined(self) -> str:
        """Why straight spans are not among the causes, in words; empty where they are."""
        if self.by_displacement:
            return "with commanded bends this effect is not examined"
        if self.robot.is_coupled or any(couples(axis.path) for axis in self.all_axes):
            return COUPLED
        return ""

    def at(self, values: Mapping[int, float]) -> DesignSpace:
        """The space with one value for some axes, by their index, SI."""
        fixed = tuple((self.axes[i], value) for i, value in values.items())
        left = tuple(axis for i, axis in enumerate(self.axes) if i not in values)
        return replace(self, axes=left, fixed=(*self.fixed, *fixed))

    def check(self) -> None:
        """Refuse ends of the axes with which there is no robot, or one of too many disks.

        Raises
        ------
        InputError
            It names the axes and their values.
        """
        axes = [a for a in self.axes if not a.is_load and entry_of(a.path) is None]
        ends = [(axis.start, axis.stop) for axis in axes]
        corners = product(*ends) if len(ends) <= _MOST_CORNERS else zip(*ends, strict=True)
        for corner in corners:
            at = dict(zip(axes, corner, strict=True))
            why = self._refused(at)
            if why:
                fewer: list[dict[Axis, float]] = [{}, *({a: value} for a, value in at.items())]
                at = next((each for each in fewer if self._refused(each)), at)
                kind = "axes" if len(at) > 1 else "axis"
                named = [_at(axis, value) for axis, value in at.items()]
                text = f"{kind} {listed(named)}: {why}" if at else why
                raise InputError(text, argument="over" if at else "")

    def _refused(self, at: Mapping[Axis, float]) -> str:
        """Why no robot has these values of axes; empty if one has."""
        changes = {
            path: int(value) if axis.is_whole else value
            for axis, value in at.items()
            for path in full_paths(self.robot, axis.path)
        }
        try:
            count = len(self.robot.with_(changes).disks.station_m)
        except InputError as error:
            # advice on units is for a user's own text
            return str(error).partition("\n")[0].rstrip(".")
        if count > _MOST_DISKS:
            return f"{self.robot.name} has {count} disks; a map takes at most {_MOST_DISKS}"
        return ""

    def errors(self, points: Floats, names: Sequence[str]) -> RampErrors:
        """Errors of constant curvature at points (P, A).

        Parameters
        ----------
        points : ndarray (P, A)
            Values of the axes in SI.
        names : sequence of str
            Models of constant curvature, of `bowstring.validity.errors.LABELS`.
        """
        points = np.asarray(points, dtype=float).reshape(-1, len(self.axes))
        out = RampErrors.empty(len(points), self.loads, names)
        for rows, rods, ramp in self._groups(points):
            ramps = follow(rods, ramp, self.shares)
            out.put(rows, rods.designs, ramps, tip_offsets(rods.designs, ramps, names))
        return out

    def errors_without(self, points: Floats, names: Sequence[str]) -> dict[str, RampErrors]:
        """Errors at points (P, A) with rods that lack one effect.

        Constant curvature keeps the robots as they are. With friction, the change that straight
        spans make is that without friction, because a continuous tendon has none.

        Parameters
        ----------
        points, names
            As for `errors`.

        Returns
        -------
        dict from str to RampErrors
            By effect that acts at some point, in the order of `bowstring.validity.effects.EFFECTS`;
            NaN at points where it does not act.
        """
        out: dict[str, RampErrors] = {}
        for rows, rods, ramp in self._groups(points):
            known, effects = rods.designs, acting(rods)
            rest = {effect: follow(without(rods, effect), ramp, self.shares) for effect in effects}
            offsets = {effect: tip_offsets(known, ramps, names) for effect, ramps in rest.items()}
            if {"straight_spans", "friction"} <= rest.keys():
                whole = tip_offsets(known, follow(rods, ramp, self.shares), names)
                continuous, free = offsets["straight_spans"], offsets["friction"]
                offsets["straight_spans"] = {
                    name: whole[name] - free[name] + continuous[name] for name in names
                }
            for effect in effects:
                errors = out.setdefault(effect, RampErrors.empty(len(points), self.loads, names))
                errors.put(rows, known, rest[effect], offsets[effect])
        return {effect: out[effect] for effect in EFFECTS if effect in out}

    def tip_from_straight(self, points: Floats) -> Floats:
        """Tips (P, 3) at the ends of the ramps, solved from the straight robot at once, m."""
        out = np.full((len(points), 3), np.nan)
        for rows, rods, ramp in self._groups(points):
            out[rows] = follow(rods, ramp[:, -1:], self.shares).tip[:, 0]
        return out

    def _groups(self, points: Floats) -> Iterator[tuple[NDArray[np.intp], Rods, Floats]]:
        """Points with the same disks: their rows, rods, and ramps (D, L)."""
        constant = np.array([value for _, value in self.fixed])
        points = np.hstack([points, np.tile(constant, (len(points), 1))])
        whole = [i for i, axis in enumerate(self.all_axes) if axis.is_whole]
        kinds, of = np.unique(points[:, whole], axis=0, return_inverse=True)
        for kind, counts in enumerate(kinds):
            rows = np.flatnonzero(of.ravel() == kind)
            changes = {
                path: int(value)
                for i, value in zip(whole, counts, strict=True)
                for path in full_paths(self.robot, self.all_axes[i].path)
            }
            robot = self.robot.with_(changes) if changes else self.robot
            yield rows, *self._rods(robot, points[rows])

    def _rods(self, robot: Robot, points: Floats) -> tuple[Rods, Floats]:
        values: dict[str, Floats] = {}
        loads: dict[str, Floats] = {}
        end = np.full(len(points), self.max_tension)
        for i, axis in enumerate(self.all_axes):
            if axis.path in RAMPS:
                end = points[:, i]
            elif axis.is_load:
                loads[axis.path] = points[:, i]
            elif not axis.is_whole:
                values[axis.path] = points[:, i]
        if not values:  # one array of numbers keeps a robot for each point
            values = {"segments.0.length": np.full(len(points), robot.segments[0].length)}
        load = self.load.replace(**dead_loads(robot, self.load, loads, len(points)))
        rods = Rods(Designs(robot, values), self.model, load, self.by_displacement)
        return rods, end[:, None] * np.linspace(0.0, 1.0, self.loads)


def _at(axis: Axis, value: float) -> str:
    unit = axis.units[0]
    return f"{axis.path} at {number_with_unit(value, unit) if unit else f'{value:g}'}"
