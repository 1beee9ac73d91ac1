"""Map of the validity of constant curvature over any number of numbers, and its slices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Progress
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import in_percent, listed, significant
from bowstring.jobs import Job, Store
from bowstring.jobs.dataset import check_data_set, save
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics.load import Load
from bowstring.units import quote, read_number
from bowstring.validation import numbers
from bowstring.validity.axes import Axis, in_words
from bowstring.validity.causes import causes_of, coarse_step, coarser
from bowstring.validity.design_space import DesignSpace
from bowstring.validity.errors import INPUTS, LABELS
from bowstring.validity.figures import colours_of_causes, title_of
from bowstring.validity.loading import Loading
from bowstring.validity.map_job import Points, map_job
from bowstring.validity.map_result import STATES, ValidityMap, draw_region, handles_of
from bowstring.validity.map_settings import MapSettings, Metric
from bowstring.validity.maps import compute_map
from bowstring.validity.parallel_coordinates import Kinds, draw_parallel
from bowstring.validity.sentences import (
    in_causes,
    limits_in_words,
    notes_on_causes,
    notes_on_limits,
    notes_on_slack,
    sweep_in_words,
    undefined_in_words,
    unsolved_in_words,
)
from bowstring.viz.style import LIGHT, MARKS, check_figure_file, title_above, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

__all__ = [
    "MOST_DRAWN",
    "MOST_POINTS",
    "ValidityGrid",
    "check_grid_file",
    "compute_grid",
    "read_grid",
    "validity_grid",
]

MOST_POINTS: Final = 20_000
"""Most points of a map over more than two axes that is computed without blocks."""
MOST_DRAWN: Final = 5_000_000
"""Most points of a map in blocks that is read into memory, for a figure or slices."""
_NUMBERS: Final = (".nc", ".zarr")
_SUFFIXES: Final = (*MARKS, *_NUMBERS)


@dataclass(frozen=True)
class GridOfModel(Result):
    """Map of one model of constant curvature over more than two axes."""

    name: Annotated[str, Key()]
    """Model, as ``--models`` takes it."""
    values: Annotated[Floats, Key()]
    """Metric (...) in percent of the length (``valid_to``: N), nested lists in the order of the
    axes; NaN without a value."""
    defined: Annotated[Bools, Key()]
    """Whether the model has an error at all loads that the metric covers (...), as `values`: an
    equilibrium and an arc."""


@short_repr
@dataclass(frozen=True)
class ValidityGrid(Result):
    """Validity of constant curvature over any number of axes.

    Made by `validity_grid`, or by `read_grid` of a map in blocks.
    """

    job: Job
    """Job of the points, with description, labels and units."""
    value: dict[str, Floats]
    """Metric by model, a dimension for each axis in their order; NaN without a value."""
    solved: Annotated[Bools, Key()]
    """Whether all loads of a point that the metric covers have a stable equilibrium (...), with the
    same dimensions."""
    gave_up: Annotated[Bools, Key()]
    """Whether the solver gave up at the first load of a point that is not solved (...), with the
    same dimensions."""
    solved_to: Annotated[Floats, Key()]
    """Tension (N) or bend (rad) up to which the sweep of each point is solved (...), with the same
    dimensions; NaN where its first load is not."""
    defined: dict[str, Bools]
    """Where a model has an error at all loads that the metric covers, with the same dimensions."""
    cause: dict[str, NDArray[np.str_]]
    """Effect with more than half of the error, by model, on every `step`-th point of each axis;
    empty text where none has. Without entries for the metric ``valid_to``."""
    step: int
    """Step along each axis between the points of `cause`."""
    slack: Bools | None = None
    """Whether a tendon is slack at the end of a ramp of bends, with the same dimensions."""

    @property
    def undefined(self) -> dict[str, Bools]:
        """Where a model has no arc at a load that the metric covers, with the same dimensions."""
        return {name: self.solved & ~defined for name, defined in self.defined.items()}

    @property
    def settings(self) -> Annotated[MapSettings, Key(flat=True)]:
        """Space, models, metric and tolerance."""
        return settings_of(self.job)

    @property
    def space(self) -> DesignSpace:
        """Robot, axes, loads and sweep."""
        return self.settings.space

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Axes in their order."""
        return self.space.axes

    @property
    def tolerance(self) -> float:
        """Tolerated tip error as a share of the length."""
        return self.settings.tolerance

    @property
    def metric(self) -> Metric:
        """Metric of `value`, one of `bowstring.validity.map_settings.METRICS`."""
        return self.settings.metric

    def label(self, axis: int) -> str:
        """Label of an axis with its unit; that of the tension names the tendon."""
        return self.settings.label(axis)

    def slice(
        self, at: Mapping[str, float | str] | None = None, /, **values: float | str
    ) -> ValidityMap:
        """Map over the one or two axes that are left when the others have one value.

        It is computed anew, so that the values need not be points of the map, and its line at the
        tolerance is refined.

        Parameters
        ----------
        at : mapping of str to float or str, optional
            Value of an axis by its path or the end of the path, in SI or with a unit, such as
            ``{"tip_force.x": "0.5 N"}``.
        **values : float or str
            The same for paths without a dot, such as ``tension=40``.

        Returns
        -------
        ValidityMap
            The map over the axes that are left.

        Raises
        ------
        InputError
            If a path is no axis, a value is outside of its axis, or not one or two axes are left.

        Examples
        --------
        >>> import bowstring as bs
        >>> axes = ["tension=0:80 N:5", "E=30:40 GPa:3", "tip_force.x=-1:1 N:3"]
        >>> found = bs.validity_grid(bs.load_robot("amouri2019"), axes)
        >>> found.slice({"tip_force.x": 0.0, "E": "35 GPa"}).contour["cc_from_force"][0].round(1)
        array([[56.1]])
        """
        fixed: dict[int, float] = {}
        for path, value in {**(at or {}), **values}.items():
            i = self._index(path)
            if i in fixed:
                raise InputError(f"slice has two values for the axis {self.axes[i].path}")
            fixed[i] = _value_on(self.axes[i], value)
        left = len(self.axes) - len(fixed)
        if not 1 <= left <= 2:
            paths = listed([axis.path for axis in self.axes])
            raise InputError(
                f"slice leaves {left} axes of {paths}; give values for all but one or two of them"
            )
        return compute_map(replace(self.settings, space=self.space.at(fixed)))

    def _index(self, path: str) -> int:
        paths = [axis.path for axis in self.axes]
        found = [i for i, own in enumerate(paths) if own == path or own.endswith(f".{path}")]
        if len(found) != 1:
            raise InputError(f"slice: got {quote(path)}; must be one of the axes {listed(paths)}")
        return found[0]

    def figure(self) -> Figure:
        """Draw parallel coordinates of all points, and slices, whose lines it computes.

        Returns
        -------
        matplotlib.figure.Figure
            For each model the parallel coordinates and, below them, a row of slices over the first
            two axes at values of the third. Further axes have the robot's own value there, or the
            middle of their range.
        """
        return _draw(self)

    def save(self, path: str | Path) -> Path:
        """Write the map to a file, whole or not at all.

        Parameters
        ----------
        path : str or Path
            Its suffix tells the format: a figure (PNG, PDF or SVG), or a data set with
            coordinates and units (NetCDF ``.nc``, or a folder ``.zarr``, which needs the extra
            ``cluster``). An earlier map is replaced.

        Returns
        -------
        Path
            Absolute path.

        Raises
        ------
        InputError
            If it cannot be written.
        """
        file = check_grid_file(path)
        if file.suffix.lower() not in _NUMBERS:
            return write_figure(self.figure, file, "map")
        flags = {f"{name}_defined": defined for name, defined in self.defined.items()}
        flags |= {"solved": self.solved, "gave_up": self.gave_up}
        flags |= {} if self.slack is None else {"slack": self.slack}
        shown = {name: flag.astype(np.int8) for name, flag in flags.items()}
        all_of: dict[str, NDArray[Any]] = {**self.value, **shown, "solved_to": self.solved_to}

        def read(first: int, count: int) -> dict[str, NDArray[Any]]:
            return {name: values.flat[first : first + count] for name, values in all_of.items()}

        return save(self.job, read, file)

    def described(self) -> list[str]:
        """The map in sentences."""
        out = []
        for name, value in self.value.items():
            first = f"Constant curvature {LABELS[name]} holds to {in_percent(self.tolerance, 3)}"
            undefined = self.undefined[name]
            if self.metric == "valid_to" and np.isfinite(value).any():
                limits = limits_in_words(self.settings, value)
                out.append(f"{first} of length up to {limits}.")
            elif self.metric == "valid_to":
                out.append(f"Constant curvature {LABELS[name]} has no validity limit on the map.")
            else:
                inside = self.solved & (value <= self.tolerance)  # false without a value
                words = f"{first} of length at {int(inside.sum())} of {value.size} points"
                causes = in_causes(value, self.cause[name], self.step, self.tolerance)
                out.append(f"{words}{causes}.")
            if undefined.any():
                out.append(undefined_in_words(name, undefined))
        out += sweep_in_words(self.settings)
        if self.metric == "valid_to":
            out += notes_on_limits(self.settings, self.value, self.solved_to)
        out += unsolved_in_words(
            self.settings,
            {2: ~self.solved & ~self.gave_up, 5: ~self.solved & self.gave_up},
            self.solved_to,
        )
        if self.slack is not None and self.slack.any():
            out.append(f"{int(self.slack.sum())} of {self.slack.size} points: a tendon is slack.")
            out += notes_on_slack(self.settings, self.slack)
        return out + notes_on_causes(self.settings, self.value, self.cause)

    @property
    def maps(self) -> Annotated[list[GridOfModel], Key()]:
        """Map of each model."""
        scale = 1.0 if self.metric == "valid_to" else 100.0
        found = self.value.items()
        return [GridOfModel(name, scale * value, self.defined[name]) for name, value in found]


def settings_of(job: Job) -> MapSettings:
    """Settings of the map of a job of `bowstring.validity.map_job.map_job`."""
    if not isinstance(job.evaluate, Points):
        raise InputError("the job is no map; make it by bowstring.validity.map_job.map_job")
    return job.evaluate.settings


def _value_on(axis: Axis, value: float | str) -> float:
    """A value on an axis in SI."""
    if isinstance(value, str):
        try:
            value = read_number(value, axis.units[0])
        except ValueError as error:
            raise InputError(f"slice: {axis.path} got {quote(value)}, {error}") from None
    value = float(numbers(f"value of {axis.path}", value, ()))
    low, high = sorted((axis.start, axis.stop))
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    near = 1e-12 * (high - low)
    if not low - near <= value <= high + near or (axis.is_whole and value != int(value)):
        kind = "a whole number from " if axis.is_whole else ""
        ends = f"{low / axis.factor:g} to {high / axis.factor:g}{unit}"
        raise InputError(
            f"slice: {axis.path} is {significant(value / axis.factor, 6)}{unit}; must be "
            f"{kind}{ends}, as on the map"
        )
    return value


def check_grid_file(path: str | Path) -> Path:
    """Check before any work that a map over more than two axes may be written; return its path."""
    file = Path(path)
    if file.suffix.lower() in _NUMBERS:
        return check_data_set(file)
    return check_figure_file(file, "map", _SUFFIXES)


def validity_grid(
    robot: Robot,
    over: Sequence[str | Axis],
    *,
    tolerance: float | str = 0.01,
    metric: Metric | None = None,
    models: Sequence[str] | None = None,
    loading: Loading | None = None,
    load: Load | None = None,
    progress: Progress | None = None,
) -> ValidityGrid:
    """Map where constant curvature holds, over any number of axes, in memory.

    Parameters
    ----------
    robot : Robot
        The robot.
    over : sequence of str or Axis
        Axes as for `bowstring.validity_map`, at least one.
    tolerance, metric, models, loading, load, progress : object
        As for `bowstring.validity_map`.

    Returns
    -------
    ValidityGrid
        Values, states and causes at all points.

    Raises
    ------
    InputError
        If an argument is wrong, or the map has more than 20 000 points. `read_grid` reads a larger
        one that was computed in blocks.

    Examples
    --------
    >>> import bowstring as bs
    >>> axes = ["tension=0:80 N:5", "E=30:40 GPa:3", "tip_force.x=-1:1 N:3"]
    >>> bs.validity_grid(bs.load_robot("amouri2019"), axes).value["cc_from_force"].shape
    (5, 3, 3)
    """
    job = map_job(
        robot,
        over,
        tolerance=tolerance,
        metric=metric,
        models=models,
        loading=loading,
        load=load,
    )
    return compute_grid(job, progress)


def compute_grid(job: Job, progress: Progress | None = None) -> ValidityGrid:
    """Compute a job of `bowstring.validity.map_job.map_job` in memory.

    Parameters
    ----------
    job : Job
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    ValidityGrid
        Values, states and causes at all points.

    Raises
    ------
    InputError
        If it has more than 20 000 points.
    """
    if job.points > MOST_POINTS:
        raise InputError(
            f"the map has {job.points} points, and over more than two axes at most {MOST_POINTS} "
            "are computed at once; give fewer points, or a folder for blocks (--store DIR)"
        )
    notify = progress or (lambda what, done: None)
    parts = []
    for block in range(job.blocks):
        notify("errors", 0.9 * block / job.blocks)
        parts.append(job.evaluate(*job.span(block)))
    notify("causes", 0.9)
    return _grid(job, {name: np.concatenate([part[name] for part in parts]) for name in parts[0]})


def read_grid(store: Store) -> ValidityGrid:
    """Read a map in blocks, for its figure and its slices.

    Parameters
    ----------
    store : Store
        Blocks of a job of `bowstring.validity.map_job.map_job`, all computed.

    Returns
    -------
    ValidityGrid
        Values, states and causes at all points.

    Raises
    ------
    InputError
        If a block is missing, the job is no map, or it has more than 5 million points.
    """
    check_drawn(store.job)
    return _grid(store.job, store.read(0, store.job.points))


def check_drawn(job: Job) -> None:
    """Refuse a map that is too large for a figure."""
    settings_of(job)
    if job.points > MOST_DRAWN:
        raise InputError(
            f"the map has {job.points:.3g} points, a figure has at most {MOST_DRAWN:.0e}; write a "
            "data set (.nc, .zarr)"
        )


def _grid(job: Job, flat: Mapping[str, NDArray[Any]]) -> ValidityGrid:
    """Give flat arrays their dimensions, and find the causes."""
    settings = settings_of(job)
    axes, shape = settings.space.axes, tuple(job.axes.values())
    value = {name: np.asarray(flat[name]).reshape(shape) for name in settings.models}
    part = coarser(shape, len(shape))
    cause: dict[str, NDArray[np.str_]] = {}
    if settings.metric != "valid_to":
        places = np.unravel_index(part.ravel(), shape)
        points = [axis.values[place] for axis, place in zip(axes, places, strict=True)]
        total = {name: v[places] for name, v in value.items()}
        found = causes_of(settings, np.stack(points, axis=1), total)
        cause = {name: effects.reshape(part.shape) for name, effects in found.items()}
    step = coarse_step(shape, len(shape))
    slack = flat["slack"].reshape(shape) == 1 if "slack" in flat else None
    defined = {name: flat[f"{name}_defined"].reshape(shape) == 1 for name in settings.models}
    solved, gave_up = (flat[name].reshape(shape) == 1 for name in ("solved", "gave_up"))
    solved_to = np.asarray(flat["solved_to"]).reshape(shape)
    return ValidityGrid(job, value, solved, gave_up, solved_to, defined, cause, step, slack)


# -- figure -----------------------------------------------------------------------------------

_WIDTH: Final = 7.4  # inches: three slices beside each other
_SLICES: Final = 3  # most slices
_LIMITS: Final = 4  # classes of the validity limit


def _draw(found: ValidityGrid) -> Figure:
    """Draw parallel coordinates and slices, for each model."""
    from matplotlib.figure import Figure

    names = list(found.value)
    views, others = _slices(found)
    heights = [2.7, 2.1] if views else [2.7]
    height = 1.9 + sum(heights) * len(names)
    figure = Figure(figsize=(_WIDTH, height), layout="constrained")
    rows = figure.add_gridspec(len(heights) * len(names), 1, height_ratios=heights * len(names))
    handles: dict[str, Line2D | Patch] = {}
    for k, name in enumerate(names):
        panel = figure.add_subplot(rows[len(heights) * k])
        panel.set_title(f"constant curvature {INPUTS[name]}", fontweight="bold", pad=4.0)
        present = draw_parallel(panel, found.settings, found.value[name], _kinds(found, name))
        if not views:
            continue
        cells = rows[2 * k + 1].subgridspec(1, len(views)).subplots(sharey=True, squeeze=False)[0]
        for cell, view in zip(cells, views, strict=True):
            present |= draw_region(cell, view, name)
            if found.metric == "valid_to":  # one scale for all slices
                cell.collections[0].set_clim(0.0, found.space.max_tension)
            cell.set_title(in_words(*view.fixed[-1]), fontsize=8.5)
            cell.set_xlabel(view.label(0))
            handles |= {str(one.get_label()): one for one in handles_of(view, present)}
        cells[0].set_ylabel(view.label(1))
    handles |= {str(one.get_label()): one for one in _line_handles(found)}
    figure.legend(
        handles=list(handles.values()),
        loc="outside lower left",
        ncols=2,
        title=_caption(found, others),
        alignment="left",
        title_fontsize=8.5,
    )
    robot, top = found.space.robot.name, found.space.max_tension
    title = title_of(robot, found.metric, top)
    title_above(figure, title)
    return figure


def _caption(found: ValidityGrid, others: str) -> str:
    if found.metric == "valid_to":
        bars = "Bars: at each value of an axis, the points by the tension up to which they hold."
        lines = "Lines: single points, of the same colours."
    else:
        tolerance = in_percent(found.tolerance)
        bars = (
            f"Bars: at each value of an axis, the share of points with an error above {tolerance}"
        )
        bars += ", by its main cause."
        lines = (
            f"Dark lines: single points that hold to {tolerance}; light lines: points that do not."
        )
    last = f" Slices at {others}." if others else ""
    return f"{bars}\n{lines}{last}"


def _line_handles(found: ValidityGrid) -> list[Line2D | Patch]:
    """Entries of the legend that only the parallel coordinates have."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    out: list[Line2D | Patch] = []
    if found.metric != "valid_to":
        label = f"point that holds to {in_percent(found.tolerance)}"
        out.append(Line2D([], [], color=LIGHT["ink"], lw=0.7, label=label))
    if any(axis.own_value_inside(found.space.robot) is not None for axis in found.axes):
        label = "this robot"
        out.append(Line2D([], [], color=LIGHT["ink"], lw=0.8, ls="--", label=label))
    missing = {
        2: np.any(~found.solved & ~found.gave_up),
        5: np.any(~found.solved & found.gave_up),
        4: any(undefined.any() for undefined in found.undefined.values()),
    }
    if any(missing.values()):
        label = ", or ".join(STATES[state] for state, has in missing.items() if has)
        out.append(Patch(fc="none", ec=LIGHT["muted"], hatch="////", lw=0.0, label=label))
    return out


def _slices(found: ValidityGrid) -> tuple[list[ValidityMap], str]:
    """Slices over the first two axes at values of the third, and the values of the others."""
    if len(found.axes) < 3:
        return [], ""
    along = found.axes[2]
    count = min(_SLICES, len(along.values))
    chosen = along.values[np.round(np.linspace(0, len(along.values) - 1, count)).astype(int)]
    rest = {axis.path: _rest(found, axis) for axis in found.axes[3:]}
    views = [found.slice({**rest, along.path: float(at)}) for at in chosen]
    words = [in_words(axis, rest[axis.path]) for axis in found.axes[3:]]
    return views, ", ".join(words)


def _rest(found: ValidityGrid, axis: Axis) -> float:
    """The robot's own value where it is on the axis, or the middle of its points."""
    own = axis.own_value_inside(found.space.robot)
    return float(axis.values[len(axis.values) // 2]) if own is None else own


def _kinds(found: ValidityGrid, name: str) -> Kinds:
    from matplotlib import colormaps

    value = found.value[name]
    if found.metric == "valid_to":
        ends = np.linspace(0.0, found.space.max_tension, _LIMITS + 1)
        of = np.clip(np.digitize(value, ends) - 1, 0, _LIMITS - 1)
        shades = colormaps["viridis"]((np.arange(_LIMITS) + 0.5) / _LIMITS)
        colours: list[Any] = [tuple(map(float, shade)) for shade in shades]
        causes: list[str] = []
    else:
        by_cause = colours_of_causes()
        causes, colours = list(by_cause), list(by_cause.values())
        few = found.cause[name].shape
        nearest = [
            np.minimum(np.round(np.arange(many) / found.step).astype(int), count - 1)
            for many, count in zip(value.shape, few, strict=True)
        ]
        effect = found.cause[name][np.ix_(*nearest)]
        of = np.full(value.shape, -1)
        for kind, key in enumerate(causes):
            of[(value > found.tolerance) & (effect == key)] = kind
    of[~(np.isfinite(value) & found.defined[name])] = len(colours)
    return Kinds(of, [*colours, "none"], causes)
