"""Settings of a map: its space, models, metric and tolerance."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.results import Key, Result
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot, check_robot, with_tendons, without_laws
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.validation import choice, instance, share_of_length
from bowstring.validity.axes import BY_DISPLACEMENT, RAMPS, Axis, axes_of
from bowstring.validity.dead_loads import check_dead_loads
from bowstring.validity.design_space import DesignSpace, RampErrors
from bowstring.validity.effects import Rods
from bowstring.validity.errors import LABELS
from bowstring.validity.limit_search import reach
from bowstring.validity.loading import Loading, largest_load, named

Metric = Literal["largest_error", "mean_error", "error", "valid_to"]

_TRIED: Final = 65  # loads of the search for the last solved one
METRICS: Final[dict[str, str]] = {
    "largest_error": "largest tip error over the sweep, share of length",
    "mean_error": "mean tip error over the sweep, share of length",
    "error": "tip error at the tension or bend of the axis, share of length",
    "valid_to": "tension up to which the tolerance holds, N",
}
"""Metrics of a map, with their labels."""


@dataclass(frozen=True)
class AxisPoints(Result):
    """An axis of a map."""

    path: Annotated[str, Key()]
    """Number of the robot file, or a load, as ``--over`` takes it."""
    label: Annotated[str, Key()]
    """The number in words, without a unit."""
    unit: Annotated[str, Key()]
    """SI unit; empty for a plain number."""
    values: Annotated[Floats, Key(unit="`unit`")]
    """Points (n,)."""


@short_repr
@dataclass(frozen=True)
class MapSettings(Result):
    """Settings of a map over any number of axes; made by `MapSettings.of`, which checks them."""

    space: DesignSpace
    """Robot, axes, loads and sweep."""
    models: tuple[str, ...]
    """Models of constant curvature, of `bowstring.validity.errors.LABELS`."""
    metric: Annotated[Metric, Key()]
    """Quantity of the map, one of `METRICS`."""
    tolerance: Annotated[float, Key("tolerance_percent")]
    """Tolerated tip error as a share of the length."""

    @classmethod
    def of(
        cls,
        space: DesignSpace,
        tolerance: float | str,
        metric: Metric | None = None,
        models: Sequence[str] | None = None,
    ) -> MapSettings:
        """Choose the settings that are left out, and check all.

        Parameters
        ----------
        space : DesignSpace
        tolerance, metric, models
            As for `bowstring.validity_map`.

        Raises
        ------
        InputError
            If a value is wrong or does not fit the axes.
        """
        # where an axis changes the length, a tolerance in mm would be another share of each robot
        fixed = not any(re.fullmatch(r"segments\..*\.length", a.path) for a in space.axes)
        length = space.robot.length if fixed else None
        tolerance = share_of_length("tolerance", tolerance, length)
        return cls(space, _models(space, models), _metric(space, metric), tolerance)

    def label(self, axis: int) -> str:
        """Label of an axis with its unit; of tension and tip force also the tendon or direction."""
        return self._named(self.space.axes[axis], self.space.axes[axis].label)

    def _named(self, axis: Axis, label: str) -> str:
        if axis.path != "tip_force":
            return named(label, self.space.shares)
        force = np.array(self.space.load.tip_force, dtype=float)
        along = ", ".join(f"{v + 0.0:.3g}" for v in force / np.linalg.norm(force))
        return label.replace(axis.words, f"{axis.words} along ({along})")

    def errors(self, points: Floats) -> RampErrors:
        """Errors of its models at points (P, A)."""
        return self.space.errors(points, self.models)

    def measure(self, errors: RampErrors) -> dict[str, Floats]:
        """Metric (P,) by model."""
        return {name: errors.metric(self.metric, name, self.tolerance) for name in self.models}

    def values_at(self, points: Floats) -> list[Floats]:
        """Metric (P,) of each model at points (P, A)."""
        return list(self.measure(self.errors(points)).values())

    def defined(self, errors: RampErrors) -> dict[str, Bools]:
        """Whether each model has an error at all loads that its metric covers (P,)."""
        return {name: errors.is_defined(self.metric, name, self.tolerance) for name in self.models}

    def solved(self, errors: RampErrors) -> dict[str, Bools]:
        """Whether all loads that the metric of each model covers have an equilibrium (P,)."""
        return {name: errors.is_solved(self.metric, name, self.tolerance) for name in self.models}

    @property
    def attributes(self) -> dict[str, Any]:
        """The settings as attributes of a data set: numbers in SI, text and lists."""
        space = self.space
        gravity = space.robot.gravity if space.load.gravity is None else space.load.gravity
        force = (0.0, 0.0, 0.0) if space.load.tip_force is None else space.load.tip_force
        return {
            "metric": self.metric,
            "tolerance": self.tolerance,
            **({} if space.by_displacement else {"max_tension_N": space.max_tension}),
            "loads": space.loads,
            "shares": space.shares.tolist(),
            "gravity_m_per_s2": np.asarray(gravity, dtype=float).tolist(),
            "tip_force_N": np.asarray(force, dtype=float).tolist(),
            **{f"at_{axis.path}": value for axis, value in space.fixed},
        }

    @property
    def end(self) -> Annotated[float | None, Key("max_tension_N")]:
        """End of the sweep where no axis is the tension, N; None with an axis bend."""
        return None if self.space.by_displacement else self.space.max_tension

    @property
    def axes(self) -> Annotated[list[AxisPoints], Key()]:
        """Axes in their order; of two, the first is along x."""
        return [
            AxisPoints(axis.path, self._named(axis, axis.words), axis.units[0], axis.values)
            for axis in self.space.axes
        ]


def read_axes(
    robot: Robot,
    over: Sequence[str | Axis] | str | Axis | None,
    loading: Loading,
    load: Load | None = None,
) -> tuple[Axis, ...]:
    """Read the one or two axes of a map.

    Parameters
    ----------
    robot : Robot
    over : sequence of str or Axis
        Axes as for `validity_map`; None takes the default.
    loading : Loading
        End of the ramp of the default.
    load : Load, optional
        Gravity of that ramp, that of the robot if left out.

    Raises
    ------
    InputError
        If an axis is wrong.
    """
    check_robot(robot)
    if over is None:
        top = end_of_ramp(robot, loading, load)
        over = [f"tension=0:{top:g} N:41"]
        if all(segment.disks.count is not None for segment in robot.segments):
            over.append("segments.*.disks.count=3:20")
    if isinstance(over, str | Axis):
        over = [over]
    axes = axes_of(robot, over)
    if not 1 <= len(axes) <= 2:
        raise InputError(
            f"got {len(axes)} axes; a map has one or two, and bowstring.validity_grid more"
        )
    return axes


def space_of(
    robot: Robot, axes: tuple[Axis, ...], loading: Loading | None, load: Load | None
) -> DesignSpace:
    """Make the space of a map.

    Parameters
    ----------
    robot : Robot
        Its friction and other memories are left out; friction counts with an axis friction or
        ``bend``.
    axes : tuple of Axis
    loading, load
        As for `validity_map`.

    Raises
    ------
    InputError
        If the load has an actuation, a tip moment or loads on disks, or if an axis has an end with
        which there is no robot.
    """
    check_robot(robot)
    robot = without_laws(robot, "friction")
    paths = [axis.path for axis in axes]
    if "tension" in paths and "bend" in paths:
        raise InputError("over has tension and bend; motors command one of them")
    for path in paths:
        if "bend" not in paths and path.rpartition(".")[2] in BY_DISPLACEMENT:
            raise InputError(
                f"axis {path}: with given tensions it changes nothing; add an axis bend, such as "
                "bend=0:90 deg"
            )
    if "bend" in paths and instance("loading", loading, Loading).max_tension is not None:
        raise InputError("max_tension is the end of a sweep of the tension; leave it out with bend")
    if "bend" not in paths and not any(path.endswith(".friction") for path in paths):
        robot = with_tendons(robot, {"friction": 0.0})
    loading, load = instance("loading", loading, Loading), instance("load", load, Load)
    if load.is_actuated:
        raise InputError("load has an actuation; of a map it is that of loading and of the axes")
    if load.tip_moment is not None:
        raise InputError("load has a tip moment; a map takes gravity and tip force only")
    if load.given - {"gravity", "tip_force"}:
        raise InputError("load has loads on disks; a map takes gravity and tip force only")
    check_dead_loads(robot, paths, load)
    shares = np.array(loading.shares(robot))
    top = float("nan") if "bend" in paths else end_of_ramp(robot, loading, load)
    space = DesignSpace(robot, axes, shares, top, RodModel(), load, loading.points)
    space.check()
    return space


def end_of_ramp(robot: Robot, loading: Loading, load: Load | None = None) -> float:
    """End of the ramp of tension in N, as given or chosen for the robot and its gravity."""
    if loading.max_tension is not None:
        return loading.max_tension
    if load is not None and load.gravity is not None:
        robot = robot.with_({"gravity": [float(g) for g in np.asarray(load.gravity)]})
    return largest_load(robot, np.array(loading.shares(robot)), RodModel())


def reach_of_ramp(space: DesignSpace) -> tuple[float, float]:
    """Largest tension of a map, and that up to which the robot as it is is solved by a search, N.

    Both are infinite with an axis ``bend``.
    """
    if space.by_displacement:
        return np.inf, np.inf
    ends = [max(axis.start, axis.stop) for axis in space.axes if axis.path == "tension"]
    top = max([*ends, 0.0 if ends else space.max_tension])
    one = Designs(space.robot, {"segments.0.length": [space.robot.segments[0].length]})
    ramp = np.linspace(0.0, top, _TRIED)
    at = reach(Rods(one, space.model, space.load), ramp[:, None] * space.shares)
    return top, float(ramp[at])


def _metric(space: DesignSpace, metric: Metric | None) -> Metric:
    """Metric of a map, as given or chosen for its axes."""
    ramp = next((axis.path for axis in space.all_axes if axis.path in RAMPS), None)
    chosen: Metric = metric or ("largest_error" if ramp is None else "error")
    choice("metric", chosen, list(METRICS))
    if ramp is not None and chosen != "error":
        raise InputError(
            f"metric {chosen} is over a sweep of the {ramp}, which is an axis here; give other "
            "axes, such as pitch_radius=20:30 mm"
        )
    if chosen == "error" and ramp is None:
        raise InputError(
            "metric error is at the tension or the bend of an axis; give an axis tension or bend"
        )
    return chosen


def _models(space: DesignSpace, models: Sequence[str] | None) -> tuple[str, ...]:
    """Models of a map, as given or chosen for its axes."""
    commanded = "cc_from_displacements"
    if models is None:
        if space.by_displacement:
            return (commanded, "cc_from_lengths")
        return ("cc_from_lengths", "cc_from_force")
    for name in models:
        choice("models", name, list(LABELS))
        if name == commanded and not space.by_displacement:
            raise InputError(f"{commanded} needs commanded displacements; give an axis bend")
    return tuple(models)
