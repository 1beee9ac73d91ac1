"""Result of a map over one or two numbers, and its figure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Ints
from bowstring.display import short_repr
from bowstring.files.atomic_io import check_file, write_whole_file
from bowstring.formatting import in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.validity.axes import Axis, in_ranges
from bowstring.validity.causes import coarse_step
from bowstring.validity.contour import Line
from bowstring.validity.errors import INPUTS, LABELS
from bowstring.validity.figures import (
    apart,
    colours_of_causes,
    handles_of_causes,
    hatch_region,
    shade,
    title_of,
)
from bowstring.validity.map_settings import METRICS, MapSettings, Metric
from bowstring.viz.style import (
    LIGHT,
    MARKS,
    check_figure_file,
    legend_above,
    subplots,
    title_above,
    write_figure,
)

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch


State = Literal[
    "solved",
    "two equilibria",
    "no stable equilibrium",
    "a tendon is slack",
    "constant curvature not defined",
    "not solved",
]
STATES: Final[tuple[State, ...]] = get_args(State)
"""States of a point: solved; another stable equilibrium exists at the end of the ramp, so that the
robot may snap through; some load of the ramp has no stable equilibrium; a tendon under displacement
control is slack at the end of the ramp; some model has no arc, so that its error is not defined;
the solver gave up at some load, which may have an equilibrium or not.

A ramp that is not solved to its end has no error. For ``valid_to`` it counts as solved if the
tolerance of each model is exceeded before."""
UNSOLVED: Final = (2, 5)
"""Indices in `STATES` of points that are not solved."""
_SOURCE: Final = "simulated: constant curvature against statics of the rod"
_NUMBERS: Final = ".nc"
_SUFFIXES: Final = (*MARKS, _NUMBERS)


@dataclass(frozen=True)
class MapOfModel(Result):
    """Map of one model of constant curvature."""

    name: Annotated[str, Key()]
    """Model, as ``--models`` takes it; ``cc_from_force_calibrated`` has the bending stiffness that
    fits best."""
    values: Annotated[Floats, Key()]
    """Metric, (Y, X) or (X,), in percent of the length (``valid_to``: N), rows by the second axis;
    NaN without a value."""
    contour: Annotated[list[Line], Key(unit="`unit`")]
    """Lines (n, k) on which the metric has the tolerance, with a coordinate for each of the k axes;
    of one axis each line is a point."""
    ranges: Annotated[Floats, Key(unit="`unit`")]
    """Ranges (n, 2) in which the tolerance holds: of a single axis, or of the tension or bend for
    the robot as it is; empty for others."""
    causes: Annotated[NDArray[np.str_], Key()]
    """Effect with more than half of the metric at the points of `cause_points`, (Y, X) or (X,); or
    empty."""
    defined: Annotated[Bools, Key()]
    """Whether the model has an error at all loads that the metric covers, as `values`, (Y, X) or
    (X,): an equilibrium and an arc."""


@short_repr
@dataclass(frozen=True)
class ValidityMap(Result):
    """Validity of constant curvature over one or two axes; made by `validity_map`."""

    settings: Annotated[MapSettings, Key(flat=True)]
    """Space, models, metric and tolerance."""
    value: dict[str, Floats]
    """Metric by model, (Y, X) or (X,); NaN without a value."""
    contour: dict[str, list[Line]]
    """Lines (n, 2) on which the metric has the tolerance, by model, SI; points (n, 1) of one
    axis."""
    ranges: dict[str, Floats]
    """Ranges (n, 2) of the axis `along` in which the tolerance holds, by model, SI: those of one
    axis; of two axes, those of the tension or bend for the robot as it is. Empty without."""
    along: int | None
    """Index of the axis of `ranges`; None without."""
    fine_axes: tuple[Floats, ...]
    """Values of the axes on the refined grid (U,), (V,), SI; empty of one axis of whole numbers and
    of `valid_to`."""
    fine: dict[str, Floats]
    """Metric by model on the refined grid (V, U): computed near the lines, interpolated elsewhere;
    of one axis (U,), computed. Empty as `fine_axes`."""
    cause: dict[str, NDArray[np.str_]]
    """Effect with more than half of the error, by model, at the points of `cause_points`; empty
    text where none has."""
    cause_points: Annotated[tuple[Floats, ...], Key(unit="`unit`")]
    """Values of each axis at the points of the causes, (Y, X) or (X,), SI."""
    state: Ints
    """Index in `STATES`, (Y, X) or (X,)."""
    undefined: dict[str, Bools]
    """Where a model has no arc at some load that the metric covers, (Y, X) or (X,)."""
    solved: dict[str, Bools]
    """Where all loads that the metric of a model covers are solved, (Y, X) or (X,)."""
    solved_to: Annotated[Floats, Key()]
    """Tension (N) or bend (rad) up to which the ramp of each point is solved, (Y, X) or (X,); NaN
    where its first load is not."""
    statics_error: Annotated[float, Key("statics_error_percent")]
    """Largest estimated error of the tips by statics, as a share of the length; NaN without any."""
    notes: tuple[str, ...] = ()
    """Sentences on the choice of the axes."""

    @property
    def robot(self) -> Robot:
        """Robot of all numbers that no axis changes."""
        return self.settings.space.robot

    @property
    def axes(self) -> tuple[Axis, ...]:
        """One or two axes, the first along x."""
        return self.settings.space.axes

    @property
    def fixed(self) -> tuple[tuple[Axis, float], ...]:
        """Fixed axes of a slice and their values, SI."""
        return self.settings.space.fixed

    @property
    def tolerance(self) -> float:
        """Tolerated tip error as a share of the length."""
        return self.settings.tolerance

    @property
    def metric(self) -> Metric:
        """Metric of `value`, one of `bowstring.validity.map_settings.METRICS`."""
        return self.settings.metric

    @property
    def max_tension(self) -> float:
        """End of the ramp of tension where no axis is the tension, N; NaN with an axis bend."""
        return self.settings.space.max_tension

    @property
    def shares(self) -> tuple[float, ...]:
        """Share (T,) of the ramp's tension in each tendon."""
        return tuple(float(share) for share in self.settings.space.shares)

    @property
    def by_displacement(self) -> bool:
        """Whether motors command bends, so that there is no sweep of tension."""
        return self.settings.space.by_displacement

    @property
    def unsolved(self) -> Bools:
        """Points with a load without equilibrium that the metric covers, (Y, X) or (X,)."""
        return np.isin(self.state, UNSOLVED)

    @property
    def defined(self) -> dict[str, Bools]:
        """Where each model has an error at all loads that its metric covers, (Y, X) or (X,)."""
        return {name: self.solved[name] & ~self.undefined[name] for name in self.value}

    def label(self, axis: int) -> str:
        """Label of an axis with its unit; that of the tension names the tendon."""
        return self.settings.label(axis)

    @property
    def shape(self) -> tuple[int, ...]:
        """Points of the axes, the last axis first."""
        return self.state.shape

    def to_dataset(self) -> xr.Dataset:
        """Values, causes and states with labels and units, along the axes.

        Returns
        -------
        xarray.Dataset
            Variables for each model: its metric, with its name; ``NAME_defined``, 1 where all loads
            that the metric covers have an equilibrium and an arc; and ``NAME_cause``, on axes of
            their own, which may have fewer points. Also ``state`` and ``solved_to``, the tension or
            bend up to which each sweep is solved. The attributes have the metric, the tolerance,
            the load and the sweep.
        """
        import xarray as xr

        dims = [f"axis_{i}" for i in range(len(self.axes), 0, -1)]

        def along(axis: Axis, name: str, values: Floats) -> dict[str, Any]:
            about = {"units": axis.units[0] or "1", "long_name": axis.path}
            return {name: ([name], values, about)}

        coords: dict[str, Any] = {}
        for i, axis in enumerate(self.axes, 1):
            coords |= along(axis, f"axis_{i}", axis.values)
        unit = "N" if self.metric == "valid_to" else "1"
        data: dict[str, Any] = {
            name: (dims, value, {"units": unit, "long_name": f"{METRICS[self.metric]}: {name}"})
            for name, value in self.value.items()
        }
        data["state"] = (dims, self.state, {"flag_meanings": " / ".join(STATES)})
        about = "load up to which the sweep is solved"
        unit = "rad" if self.by_displacement else "N"
        data["solved_to"] = (dims, self.solved_to, {"units": unit, "long_name": about})
        for name, defined in self.defined.items():
            about = f"1 where constant curvature {LABELS[name]} has an error at all loads"
            data[f"{name}_defined"] = (
                dims,
                defined.astype(np.int8),
                {"units": "1", "long_name": about},
            )
        coarse = [f"cause_{dim}" for dim in dims]
        for name, effects in self.cause.items():
            about = "effect with more than half of the error, empty where none has"
            data[f"{name}_cause"] = (coarse, effects.astype(object), {"long_name": about})
        for i, axis in enumerate(self.axes, 1):
            places = np.unique(self.cause_points[i - 1])
            order = places if axis.start < axis.stop else places[::-1]
            coords |= along(axis, f"cause_axis_{i}", order)
        return xr.Dataset(
            data,
            coords,
            {
                "robot": self.robot.name,
                "robot_hash": self.robot.hash,
                "source": _SOURCE,
                **self.settings.attributes,
            },
        )

    def figure(self) -> Figure:
        """Draw the map.

        Returns
        -------
        matplotlib.figure.Figure
            A panel for each model.
        """
        return _curves(self) if len(self.axes) == 1 else _regions(self)

    def save(self, path: str | Path) -> Path:
        """Write the map to a file, whole or not at all.

        Parameters
        ----------
        path : str or Path
            Its suffix tells the format: a figure (PNG, PDF or SVG), or the numbers of `to_dataset`
            as NetCDF. An earlier map is replaced.

        Returns
        -------
        Path
            Absolute path of the file.

        Raises
        ------
        InputError
            If the file cannot be written.
        """
        file = check_map_file(path)
        if file.suffix.lower() != _NUMBERS:
            return write_figure(self.figure, file, "map")
        values = self.to_dataset()
        write_whole_file(
            file,
            "map",
            lambda new: values.to_netcdf(new, engine="netcdf4"),
            lambda: check_map_file(file),
        )
        return file

    @property
    def maps(self) -> Annotated[list[MapOfModel], Key()]:
        """Map of each model."""
        scale = 1.0 if self.metric == "valid_to" else 100.0
        return [
            MapOfModel(
                name,
                scale * value,
                self.contour[name],
                self.ranges.get(name, np.zeros((0, 2))),
                self.cause[name],
                self.defined[name],
            )
            for name, value in self.value.items()
        ]

    @property
    def states(self) -> Annotated[list[State], Key()]:
        """State of each point, row by row. ``not solved``: the solver gave up at some load, which
        may have an equilibrium or not."""
        return [STATES[i] for i in self.state.ravel()]


def check_map_file(path: str | Path) -> Path:
    """Check before any work that a map may be written; return its path."""
    file = Path(path)
    if file.suffix.lower() == _NUMBERS:
        return check_file(file, "map", _SUFFIXES, _SOURCE.encode())
    return check_figure_file(file, "map", _SUFFIXES)


# -- figure -----------------------------------------------------------------------------------

_HATCHES: Final = (((1,), "...."), (UNSOLVED, "////"), ((3,), "\\\\"))
"""Indices in `STATES`, and their hatches."""
_UNDEFINED: Final = "xxxx"
"""Hatch of a region where a model has no arc."""
_LEVELS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # share of length
_LINES: Final = ("blue", "red", "green", "purple", "amber")
_DASHES: Final = ("-", "-", (0, (5, 1.5)), "-.", (0, (1, 1)))
_MOST_CROSSINGS: Final = 4  # crossings of a curve in its legend
_END: Final = "holds to the end"  # keys of areas, beside the keys of the causes
_NONE: Final = "no value"
_NO_ARC: Final = "no arc"


def _title(found: ValidityMap) -> str:
    return title_of(found.robot.name, found.metric, found.max_tension, found.fixed)


def _limit_label(found: ValidityMap) -> str:
    return f"{in_percent(found.tolerance)} of length holds up to (N)"


def _end_label(found: ValidityMap) -> str:
    return f"holds to the end, {significant(found.max_tension)} N"


# -- one axis ----------------------------------------------------------------------------------


def _curves(found: ValidityMap) -> Figure:
    axis = found.axes[0]
    x = axis.values / axis.factor
    figure, (panel,) = subplots(1, 3.6)
    limits = found.metric == "valid_to"
    scale = 1.0 if limits else 100.0
    styles = zip(found.value.items(), _LINES, _DASHES, strict=False)
    for (name, value), colour, dashes in styles:
        mark = "o" if axis.is_whole else ""
        style: Any = {"color": LIGHT[colour], "linestyle": dashes, "marker": mark}
        at, shown = x, value
        if name in found.fine:  # computed to find the crossings, which lie on the curve
            marks = np.array([line[0, 0] for line in found.contour[name]])
            at = np.concatenate([found.fine_axes[0], marks]) / axis.factor
            shown = np.concatenate([found.fine[name], np.full(len(marks), found.tolerance)])
            order = np.argsort(at)
            at, shown = at[order], shown[order]
        panel.plot(at, scale * shown, label=LABELS[name] + _crossings(found, name), **style)
        for line in found.contour[name]:
            panel.plot(
                line[0, 0] / axis.factor,
                scale * found.tolerance,
                "D",
                color=LIGHT[colour],
                clip_on=False,
                zorder=3,
            )
    ink: Any = {"color": LIGHT["ink"], "lw": 1.0}
    if limits:
        panel.axhline(found.max_tension, ls="--", label=_end_label(found), **ink)
        panel.set_ylabel(_limit_label(found))
        panel.set_ylim(0.0, 1.05 * found.max_tension)
    else:
        tolerance = in_percent(found.tolerance)
        panel.axhline(scale * found.tolerance, ls="--", label=f"tolerance {tolerance}", **ink)
        panel.set_ylabel("tip error (% of length)")
        panel.set_ylim(bottom=0.0)
    for _, own in _marked(found):
        panel.axvline(own, ls=":", label="this robot", **ink)
    for states, hatch in _HATCHES:
        where = np.isin(found.state, states)
        shade(panel, x, where, hatch, LIGHT["muted"], _states_label(found, states))
    for (name, undefined), colour in zip(found.undefined.items(), _LINES, strict=False):
        label = f"{LABELS[name]}: not defined"
        shade(panel, x, undefined, _UNDEFINED, LIGHT[colour], label)
    panel.set_xlim(x.min(), x.max())
    panel.set_xlabel(found.label(0))
    legend_above(panel, 1)
    title_above(figure, _title(found))
    return figure


def _crossings(found: ValidityMap, name: str) -> str:
    """Where a curve crosses the tolerance, for its legend: there it covers no other curve."""
    axis = found.axes[0]
    marks = sorted(line[0, 0] / axis.factor for line in found.contour[name])
    if axis.is_whole and len(found.ranges.get(name, [])):
        return f": {in_percent(found.tolerance)} {in_ranges(axis, found.ranges[name])}"
    if not marks:
        return ""
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    shown = [significant(mark) for mark in marks[:_MOST_CROSSINGS]]
    more = " ..." if len(marks) > _MOST_CROSSINGS else ""
    return f": {in_percent(found.tolerance)} at {listed(shown)}{unit}{more}"


def _states_label(found: ValidityMap, states: Sequence[int]) -> str:
    """Those of some states that occur on the map, in words."""
    return ", or ".join(STATES[state] for state in states if np.any(found.state == state))


# -- two axes ----------------------------------------------------------------------------------


def _regions(found: ValidityMap) -> Figure:
    names = list(found.value)
    figure, panels = subplots(len(names), 0.6 + 2.9 * len(names), sharex=True)
    present: set[str] = set()
    for panel, name in zip(panels, names, strict=True):
        present |= draw_region(panel, found, name)
        panel.set_title(f"constant curvature {INPUTS[name]}")
        panel.set_ylabel(found.label(1))
    panels[-1].set_xlabel(found.label(0))
    handles = handles_of(found, present)
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=1)
    title_above(figure, _title(found))
    return figure


def handles_of(found: ValidityMap, present: set[str]) -> list[Line2D | Patch]:
    """Entries of the legend of a map with these causes."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    white: Any = {"fc": "white", "ec": LIGHT["muted"]}
    if found.metric != "valid_to":
        tolerance = in_percent(found.tolerance)
        line = Line2D([], [], color=LIGHT["ink"], lw=2.0, label=f"error {tolerance} of length")
        handles += [line] if any(found.contour.values()) else []
        handles.append(Patch(**white, label=f"holds to {tolerance}"))
    if _END in present:
        handles.append(Patch(**white, label=_end_label(found)))
    if _NONE in present:
        handles.append(Patch(fc=LIGHT["grid"], label="no limit: no arc, or not solved"))
    if _NO_ARC in present:
        look: Any = {"fc": LIGHT["grid"], "ec": LIGHT["muted"], "hatch": _UNDEFINED, "lw": 0.0}
        label = STATES[4] + (" beyond its limit" if found.metric == "valid_to" else "")
        handles.append(Patch(**look, label=label))
    handles += handles_of_causes(present, not found.settings.space.not_examined)
    for states, hatch in _HATCHES:
        if label := _states_label(found, states):
            handles.append(Patch(fc="none", ec=LIGHT["muted"], hatch=hatch, lw=0.0, label=label))
    if _marked(found):
        label = "this robot"
        handles.append(Line2D([], [], color=LIGHT["ink"], lw=0.8, ls="--", label=label))
    return handles


def draw_region(panel: Axes, found: ValidityMap, name: str) -> set[str]:
    """Draw one model; return the keys of the causes and areas in its figure."""
    present = (_limits if found.metric == "valid_to" else _errors)(panel, found, name)
    _finish(panel, found)
    return present


def _limits(panel: Axes, found: ValidityMap, name: str) -> set[str]:
    """Draw the validity limits of one model; white where it holds to the end of the sweep."""
    from matplotlib.colors import ListedColormap

    x, y = (axis.values / axis.factor for axis in found.axes)
    value = found.value[name]
    ends = value >= found.max_tension * (1.0 - 1e-9)
    nothing = np.where(np.isnan(value), 1.0, np.nan)
    options: Any = {"shading": "nearest", "rasterized": True}
    panel.pcolormesh(x, y, nothing, cmap=ListedColormap([LIGHT["grid"]]), **options)
    below = np.where(ends, np.nan, value)
    shade = panel.pcolormesh(
        x, y, below, cmap="viridis", vmin=0.0, vmax=found.max_tension, **options
    )
    panel.figure.colorbar(shade, ax=panel, label=_limit_label(found))
    hatch_region(panel, x, y, np.where(found.undefined[name], 1.0, 0.0), _UNDEFINED)
    areas = {_END: ends, _NONE: np.isnan(value), _NO_ARC: found.undefined[name]}
    return {key for key, where in areas.items() if where.any()}


def _errors(panel: Axes, found: ValidityMap, name: str) -> set[str]:
    """Draw the error of one model; return the keys of the causes in its figure."""
    fine = np.ma.masked_invalid(found.fine[name])
    x, y = (values / axis.factor for values, axis in zip(found.fine_axes, found.axes, strict=True))
    cause = _nearest(found, name, x, y)
    outside = fine.filled(0.0) > found.tolerance
    present = {str(key) for key in np.unique(cause[outside])}
    missing = np.isnan(found.fine[name])
    no_arc = _without_arc(found, name, x, y) if missing.any() else missing
    for where, hatch, face in (
        (no_arc, _UNDEFINED, LIGHT["grid"]),
        (missing & ~no_arc, _HATCHES[1][1], "none"),
    ):
        if where.any():  # to its neighbours with a value, so that nothing between them is white
            fill = panel.contourf(x, y, np.where(where, 1.0, 0.0), levels=[1e-3, 1.5], colors=face)
            fill.set_hatch(hatch)
            fill.set_edgecolor(LIGHT["muted"])
            fill.set_linewidth(0.0)
    present |= {_NO_ARC} if no_arc.any() else set()
    if outside.any():
        # up to the line at the tolerance, which runs between the points
        top = max(float(fine.max()), 1.01 * found.tolerance)
        above = panel.contourf(x, y, fine, levels=[found.tolerance, top], colors="none")
        colours = colours_of_causes()
        for key in sorted(present - {_NO_ARC}):  # a fixed order, for the same file in every run
            here = np.where(cause == key, 1.0, 0.0)
            part = panel.contourf(x, y, here, levels=[0.5, 1.5], colors=[colours[key]])
            part.set_clip_path(above.get_paths()[0], panel.transData)
    levels = [v for v in _LEVELS if v != found.tolerance and fine.min() < v]
    if fine.count() > 3 and levels:
        thin = panel.contour(
            x, y, fine, levels=levels, colors=LIGHT["muted"], linewidths=0.7, linestyles=":"
        )
        labelled = apart(thin, x, y)
        panel.clabel(thin, labelled, fmt=lambda v: in_percent(v), fontsize=7.0)
    for line in found.contour[name]:
        u, v = (line[:, i] / found.axes[i].factor for i in range(2))
        panel.plot(u, v, color=LIGHT["ink"], lw=2.0)
    return present


def _finish(panel: Axes, found: ValidityMap) -> None:
    """Draw what is the same for all metrics: states, the robot as it is, limits of the axes."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator

    bright = [withStroke(linewidth=2.0, foreground="white", alpha=0.7)]  # also on dark colours
    x, y = (axis.values / axis.factor for axis in found.axes)
    for states, hatch in _HATCHES:
        hatch_region(panel, x, y, np.where(np.isin(found.state, states), 1.0, 0.0), hatch)
    for i, own in _marked(found):
        mark = panel.axvline if i == 0 else panel.axhline
        mark(own, color=LIGHT["ink"], lw=0.8, ls="--", path_effects=bright)
    panel.set_xlim(x.min(), x.max())
    panel.set_ylim(y.min(), y.max())
    for one, axis in zip(found.axes, (panel.xaxis, panel.yaxis), strict=True):
        if one.is_whole:
            axis.set_major_locator(MaxNLocator(integer=True))
    panel.grid(False)


def _without_arc(found: ValidityMap, name: str, x: Floats, y: Floats) -> Bools:
    """Points of the refined grid where a model has no arc, not those without equilibrium.

    A point of it without a value is as the nearest point of the map without a value.
    """
    from scipy.spatial import cKDTree

    spans = [abs(axis.stop - axis.start) / axis.factor for axis in found.axes]
    own = [axis.values / axis.factor for axis in found.axes]
    missing, without = np.isnan(found.value[name]), np.isnan(found.fine[name])
    out = without.copy()
    if missing.any():
        rows, columns = np.nonzero(missing)
        known = np.stack([own[0][columns] / spans[0], own[1][rows] / spans[1]], axis=1)
        at, up = np.nonzero(without)[::-1]
        nearest = cKDTree(known).query(np.stack([x[at] / spans[0], y[up] / spans[1]], axis=1))[1]
        out[up, at] = found.undefined[name][rows, columns][nearest]
    return np.asarray(out)


def _marked(found: ValidityMap) -> list[tuple[int, float]]:
    """Axes, and the robot's own value on each where it lies inside."""
    out = []
    for i, axis in enumerate(found.axes):
        own = axis.own_value(found.robot)
        if own is not None and min(axis.start, axis.stop) < own < max(axis.start, axis.stop):
            out.append((i, own / axis.factor))
    return out


def _nearest(found: ValidityMap, name: str, x: Floats, y: Floats) -> NDArray[np.str_]:
    """Causes at the points of a grid, from the nearest of those computed that have an error."""
    from scipy.spatial import cKDTree

    spans = [abs(axis.stop - axis.start) for axis in found.axes]
    places = np.stack(
        [v / span for v, span in zip(found.cause_points, spans, strict=True)], axis=-1
    )
    step = coarse_step(found.shape, 2)
    known = np.isfinite(found.value[name][::step, ::step])
    if not known.any():
        return np.full((len(y), len(x)), "")
    here = np.meshgrid(
        *(v * axis.factor / span for v, axis, span in zip((x, y), found.axes, spans, strict=True))
    )
    nearest = cKDTree(places[known]).query(np.stack(here, axis=-1))[1]
    return np.asarray(found.cause[name][known][nearest])
