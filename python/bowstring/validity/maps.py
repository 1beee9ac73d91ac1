"""Map of the validity of constant curvature over one or two numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Progress
from bowstring.errors import InputError
from bowstring.robot.laws import LAWS
from bowstring.robot.model import Robot
from bowstring.statics.load import Load
from bowstring.validation import instance
from bowstring.validity.axes import RAMPS, Axis
from bowstring.validity.causes import causes_of, coarser
from bowstring.validity.contour import Line, Refined, contours, crossings, halved, holding
from bowstring.validity.design_space import DesignSpace, RampErrors
from bowstring.validity.loading import Loading
from bowstring.validity.map_result import ValidityMap
from bowstring.validity.map_settings import MapSettings, Metric, read_axes, space_of

MOST_SOLVES: Final = 100_000_000
"""Most equilibria of one map in memory."""
APART: Final = 1e-3
"""Least distance of the tips of two equilibria over the length."""
_LISTED: Final = (
    "This robot file lists the positions of its disks, so that their number is no axis: the map is "
    'over the tension alone; a second axis may be given, such as "pitch_radius=20:30 mm".'
)


def validity_map(
    robot: Robot,
    over: Sequence[str | Axis] | None = None,
    *,
    tolerance: float | str = 0.01,
    metric: Metric | None = None,
    models: Sequence[str] | None = None,
    loading: Loading | None = None,
    load: Load | None = None,
    progress: Progress | None = None,
) -> ValidityMap:
    """Map where constant curvature holds, over one or two numbers of robot, load or actuation.

    Every point is a robot along a ramp of tension from zero, solved by statics (straight spans,
    shear and extension, twist), and compared with constant curvature of the same robot, as in
    `bowstring.run_study`. The lines on which the error has the tolerance are refined.

    Parameters
    ----------
    robot : Robot
        Robot of all numbers that no axis changes. Its friction is left out, except with an axis
        friction or ``bend``.
    over : sequence of str or Axis, optional
        One or two axes, such as ``"tension=0:80 N:41"`` or ``"segments.*.disks.count=3:15"``. The
        default is the tension of the sweep and the number of disks. With ``"bend=0:90 deg"`` the
        motors command the displacements of that bend by constant curvature.
    tolerance : float or str
        Tolerated tip error: a share of the length, 0.01 or "1 %", or a length, "0.5 mm".
    metric : {"largest_error", "mean_error", "error", "valid_to"}, optional
        What is mapped. The default is the error at the tension of the axis, or, where no axis is
        the tension, the largest error over the ramp.
    models : sequence of str, optional
        Models of constant curvature, of `bowstring.validity.errors.LABELS`. The default is from
        lengths and from force; with the axis ``bend`` from commanded displacements and from
        lengths.
    loading : Loading, optional
        Actuated tendons, end of the ramp and number of its loads.
    load : Load, optional
        Gravity (that of the robot if left out) and tip force that no axis changes.
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    ValidityMap
        Values, lines, causes and states.

    Raises
    ------
    InputError
        If an axis or another argument is wrong, or the map has too many points.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> found = bs.validity_map(robot, ["tension=0:80 N:9"])
    >>> [f"{line[0, 0]:.1f} N" for line in found.contour["cc_from_force"]]
    ['56.1 N']
    """
    axes = read_axes(robot, over, instance("loading", loading, Loading), load)
    space = space_of(robot, axes, loading, load)
    found = compute_map(MapSettings.of(space, tolerance, metric, models), progress)
    notes = []
    if over is None and len(axes) == 1:
        notes.append(_LISTED)
    followed = ("friction",) if space.has_friction else ()
    varied = {axis.path.rpartition(".")[2] for axis in axes}
    left_out = [
        LAWS[key].left_out
        for key in robot.laws
        if key not in followed and not varied & {*LAWS[key].sizes}
    ]
    notes += dict.fromkeys(left_out)  # two laws may have one sentence
    return replace(found, notes=tuple(notes))


def compute_map(settings: MapSettings, progress: Progress | None = None) -> ValidityMap:
    """Compute a map over one or two axes; `validity_map` makes the settings.

    Parameters
    ----------
    settings : MapSettings
    progress : callable, optional
        As for `validity_map`.
    """
    space, notify = settings.space, progress or (lambda what, done: None)
    axes = space.axes
    grid = np.meshgrid(*[axis.values for axis in axes], indexing="xy")
    shape = grid[0].shape
    points = np.stack([values.ravel() for values in grid], axis=1)
    _check_size(points, space)
    found = _in_parts(settings, points, lambda share: notify("errors", 0.7 * share))
    value = {name: v.reshape(shape) for name, v in settings.measure(found).items()}
    notify("causes", 0.7)
    defined = settings.defined(found)
    solved = {name: is_solved.reshape(shape) for name, is_solved in settings.solved(found).items()}
    undefined = {name: solved[name] & ~is_.reshape(shape) for name, is_ in defined.items()}
    part = coarser(shape, len(axes))
    whole = np.all(list(solved.values()), axis=0)
    state = np.where(whole, 0, np.where(found.unknown.reshape(shape), 5, 2))
    if not space.has_friction:  # with friction, a pose depends on the path to it
        two = _two_equilibria(space, points, found, part)
        state = np.where((state == 0) & two, 1, state)
    state = np.where((state == 0) & found.slack.reshape(shape), 3, state)
    no_arc = np.any(list(undefined.values()), axis=0)
    state = np.where(whole & no_arc, 4, state)
    total = {name: v.ravel()[part.ravel()] for name, v in value.items()}
    cause = causes_of(settings, points[part.ravel()], total)
    notify("contour", 0.9)
    contour: dict[str, list[Line]] = {name: [] for name in value}
    fine_axes: tuple[Floats, ...] = ()
    fine: dict[str, Floats] = {}
    ranges: dict[str, Floats] = {}
    along = None
    if settings.metric != "valid_to" and len(axes) == 1:
        along = 0
        contour, ranges, fine_axes, fine = _on_one_axis(settings, value)
    elif settings.metric != "valid_to":
        refined = _refined(settings, list(value.values()))
        contour = dict(zip(value, refined.lines, strict=True))
        fine_axes, fine = refined[:2], dict(zip(value, refined.values, strict=True))
        along, own = _own_ramp(space)
        if along is not None:
            line = replace(settings, space=space.at(own))
            errors = line.errors(line.space.axes[0].values[:, None])
            _, ranges, *_ = _on_one_axis(line, line.measure(errors))
    notify("done", 1.0)
    with np.errstate(invalid="ignore"):
        accuracy = found.tip_error / found.length[:, None]
    known = accuracy[np.isfinite(accuracy)]
    return ValidityMap(
        settings=settings,
        value=value,
        contour=contour,
        ranges=ranges,
        along=along,
        fine_axes=fine_axes,
        fine=fine,
        cause={name: effects.reshape(part.shape) for name, effects in cause.items()},
        cause_points=tuple(values.ravel()[part] for values in grid),
        state=state,
        undefined=undefined,
        solved=solved,
        solved_to=found.solved_to.reshape(shape),
        statics_error=float(known.max()) if known.size else float("nan"),
    )


def _check_size(points: Floats, space: DesignSpace) -> None:
    solves = len(points) * space.loads
    if solves > MOST_SOLVES:
        raise InputError(
            f"the map has {len(points)} points with {space.loads} loads each, {solves:.3g} "
            f"equilibria; at most {MOST_SOLVES:.0e} fit: give fewer points, the lines are refined "
            "anyway"
        )


_PART: Final = 4096  # points solved at a time, between two reports of progress


def _in_parts(settings: MapSettings, points: Floats, notify: Callable[[float], None]) -> RampErrors:
    parts = []
    for first in range(0, len(points), _PART):
        parts.append(settings.errors(points[first : first + _PART]))
        notify(min(1.0, (first + _PART) / len(points)))
    if len(parts) == 1:
        return parts[0]

    error = {name: np.concatenate([part.error[name] for part in parts]) for name in parts[0].error}
    others = [each.name for each in fields(RampErrors) if each.name != "error"]
    return RampErrors(
        error=error, **{n: np.concatenate([getattr(part, n) for part in parts]) for n in others}
    )


def _two_equilibria(
    space: DesignSpace, points: Floats, errors: RampErrors, part: NDArray[np.intp]
) -> Bools:
    """Points whose robot has another stable equilibrium at the end of the ramp.

    It is found by a solve from the straight robot, without the ramp, at the points of a coarser
    grid; others take the result of the nearest.
    """
    rows = part.ravel()
    known = rows[errors.converged[rows, -1]]  # the others have nothing to compare with
    apart = np.full(len(points), np.nan)
    if known.size:
        away = space.tip_from_straight(points[known]) - errors.tip[known, -1]
        apart[known] = np.linalg.norm(away, axis=-1)
    with np.errstate(invalid="ignore"):
        two: NDArray[Any] = (apart[rows] > APART * errors.length[rows]).reshape(part.shape)
    shape = tuple(len(axis.values) for axis in reversed(space.axes))
    for i, (count, few) in enumerate(zip(shape, part.shape, strict=True)):
        step = -(-count // few)
        near = np.minimum(np.round(np.arange(count) / step).astype(int), few - 1)
        two = np.take(two, near, axis=i)
    return np.asarray(two)


def _refined(settings: MapSettings, values: list[Floats]) -> Refined:
    """Lines on which the values (Y, X) of each model have the tolerance."""
    axes, level = settings.space.axes, settings.tolerance
    x, y = (axis.values for axis in axes)
    order = [np.argsort(values) for values in (x, y)]
    grids = [value[np.ix_(order[1], order[0])] for value in values]
    whole = (axes[0].is_whole, axes[1].is_whole)
    return contours(x[order[0]], y[order[1]], grids, level, settings.values_at, whole)


def _own_ramp(space: DesignSpace) -> tuple[int | None, dict[int, float]]:
    """Index of the ramp among two axes, and the robot's own value on the other one, if it has."""
    ramps = [i for i, axis in enumerate(space.axes) if axis.path in RAMPS]
    if len(ramps) != 1:
        return None, {}
    other = 1 - ramps[0]
    axis = space.axes[other]
    own = axis.own_value_inside(space.robot)
    return (None, {}) if own is None else (ramps[0], {other: own})


def _on_one_axis(
    settings: MapSettings, value: dict[str, Floats]
) -> tuple[dict[str, list[Line]], dict[str, Floats], tuple[Floats, ...], dict[str, Floats]]:
    """Crossings of the tolerance on one axis, and ranges in which it holds, by model.

    Then the points of the refined axis and the values there by model; empty of whole numbers.
    """
    (axis,), level = settings.space.axes, settings.tolerance
    ahead = np.argsort(axis.values)
    x = axis.values[ahead]
    grids = [one[ahead] for one in value.values()]
    if axis.is_whole:  # nothing lies between its points
        empty: dict[str, list[Line]] = {name: [] for name in value}
        nothing = np.zeros(0)
        pairs = zip(value, grids, strict=True)
        return empty, {name: holding(x, one, nothing, level) for name, one in pairs}, (), {}
    x, fine = halved(x, grids, settings.values_at)
    marks = crossings(x, fine, level, settings.values_at)
    return (
        {n: [np.array([[mark]]) for mark in one] for n, one in zip(value, marks, strict=True)},
        {
            name: holding(x, one, mark, level)
            for name, one, mark in zip(value, fine, marks, strict=True)
        },
        (x,),
        dict(zip(value, fine, strict=True)),
    )
