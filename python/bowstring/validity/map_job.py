"""Maps over any number of axes, computed in blocks: stored as they come, resumed, on a cluster."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.jobs import Coordinate, Job, Variable
from bowstring.robot.model import Robot, check_robot
from bowstring.statics.load import Load
from bowstring.validity.axes import Axis, axes_of
from bowstring.validity.errors import LABELS
from bowstring.validity.loading import Loading
from bowstring.validity.map_settings import METRICS, MapSettings, Metric, space_of

__all__ = ["Points", "map_job"]

_BLOCK: Final = 4096  # points: about a second on one core
_LEAST_BLOCKS: Final = 100  # least blocks of a map, if full blocks would be fewer
_SLACK: Final = Variable("1", "1 where a tendon is slack at the bend", dtype="int8")


@short_repr
@dataclass(frozen=True)
class Points:
    """Function that a worker calls: the metric at some points of the grid of the axes."""

    settings: MapSettings
    """Settings of the map."""

    def __call__(self, first: int, count: int) -> dict[str, NDArray[Any]]:
        space = self.settings.space
        values = [axis.values for axis in space.axes]
        places = np.unravel_index(np.arange(first, first + count), [len(v) for v in values])
        points = np.stack([v[place] for v, place in zip(values, places, strict=True)], axis=1)
        errors = self.settings.errors(points)
        out: dict[str, NDArray[Any]] = {**self.settings.measure(errors)}
        for name, is_defined in self.settings.defined(errors).items():
            out[f"{name}_defined"] = is_defined.astype(np.int8)
        solved = np.all(list(self.settings.solved(errors).values()), axis=0)
        out["solved"] = solved.astype(np.int8)
        out["gave_up"] = np.asarray(~solved & errors.unknown, dtype=np.int8)
        out["solved_to"] = errors.solved_to
        if space.by_displacement:
            out["slack"] = errors.slack.astype(np.int8)
        return out


def map_job(
    robot: Robot,
    over: Sequence[str | Axis],
    *,
    tolerance: float | str = 0.01,
    metric: Metric | None = None,
    models: Sequence[str] | None = None,
    loading: Loading | None = None,
    load: Load | None = None,
    block: int | None = None,
) -> Job:
    """Make the job of a large map, for `bowstring.jobs.run`.

    Parameters
    ----------
    robot : Robot
        The robot.
    over : sequence of str or Axis
        Any number of axes.
    tolerance, metric, models, loading, load : object
        As for `bowstring.validity_map`.
    block : int, optional
        Points in a block; by default 4096, or a hundredth of a smaller map.

    Returns
    -------
    Job
        Its variables are the metric by model; ``NAME_defined``, 1 where a model has an error at all
        loads that the metric covers; ``solved``, 1 where these loads have a stable equilibrium;
        ``gave_up``, 1 where the solver gave up at the first one without; ``solved_to``, the tension
        or bend up to which a sweep is solved; and with an axis bend ``slack``, 1 where a tendon is
        slack at that bend. Its axes are ``axis_1`` and so on, in SI.

    Raises
    ------
    InputError
        If an argument is wrong or the job is too large.

    Examples
    --------
    >>> import bowstring as bs
    >>> from bowstring.validity.map_job import map_job
    >>> axes = ["tension=0:80 N:9", "E=30:40 GPa:3", "pitch_radius=20:30 mm:3"]
    >>> map_job(bs.load_robot("amouri2019"), axes).points
    81
    """
    check_robot(robot)
    axes = axes_of(robot, over)
    if not axes:
        raise InputError("over has no axis; a job has one or more")
    space = space_of(robot, axes, loading, load)
    settings = MapSettings.of(space, tolerance, metric, models)
    count = math.prod(len(axis.values) for axis in axes)
    unit = "N" if settings.metric == "valid_to" else "1"
    shown = {"gravity": space.load.gravity, "tip_force": space.load.tip_force}
    return Job(
        Points(settings),
        {f"axis_{i}": len(axis.values) for i, axis in enumerate(axes, 1)},
        {
            **{
                name: Variable(
                    unit, f"{METRICS[settings.metric]}: constant curvature {LABELS[name]}"
                )
                for name in settings.models
            },
            **{
                f"{name}_defined": Variable(
                    "1",
                    f"1 where constant curvature {LABELS[name]} has an error at all loads",
                    dtype="int8",
                )
                for name in settings.models
            },
            "solved": Variable("1", "1 where all loads have a stable equilibrium", dtype="int8"),
            "gave_up": Variable(
                "1", "1 where the solver gave up at the first load not solved", dtype="int8"
            ),
            "solved_to": Variable(
                "rad" if space.by_displacement else "N", "load up to which the sweep is solved"
            ),
            **({"slack": _SLACK} if space.by_displacement else {}),
        },
        {
            "robot": robot.name,
            "robot_hash": robot.hash,
            "source": "simulated: constant curvature against statics of the rod",
            "metric": settings.metric,
            "tolerance": settings.tolerance,
            **({} if space.by_displacement else {"max_tension_N": space.max_tension}),
            "loads": space.loads,
            "shares": space.shares.tolist(),
            "axes": [axis.path for axis in axes],
            "load": {k: None if v is None else np.asarray(v).tolist() for k, v in shown.items()},
        },
        block or max(1, min(_BLOCK, -(-count // _LEAST_BLOCKS))),
        {
            f"axis_{i}": Coordinate(axis.values, axis.units[0] or "1", axis.path)
            for i, axis in enumerate(axes, 1)
        },
    )
