"""Figures of maps, and of limits with uncertain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats
from bowstring.formatting import in_percent, listed, significant
from bowstring.validity.causes import coarse_step
from bowstring.validity.effects import EFFECTS
from bowstring.validity.errors import INPUTS, LABELS
from bowstring.validity.map_settings import Metric
from bowstring.validity.maps import STATES, UNSOLVED, ValidityMap
from bowstring.validity.sentences import in_ranges
from bowstring.viz.style import LIGHT, legend_above, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import ContourSet
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from bowstring.validity.axes import Axis
    from bowstring.validity.spread import Spread

CAUSES: Final = {
    "straight_spans": "blue",
    "clamps": "amber",
    "hole_planes": "sky",
    "shear_extension": "ink",
    "torsion": "green",
    "gravity": "red",
    "tip_force": "purple",
    "friction": "yellow",
    "tendon_stretch": "blue",  # by displacement, where straight spans have no entry
}
HATCHES: Final = (((1,), "...."), (UNSOLVED, "////"), ((3,), "\\\\"))
"""Indices in `STATES`, and their hatches."""
UNDEFINED: Final = "xxxx"
"""Hatch of a region where a model has no arc."""
SHADE: Final = 0.35
_LEVELS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # share of length
_LINES: Final = ("blue", "red", "green", "purple", "amber")
_DASHES: Final = ("-", "-", (0, (5, 1.5)), "-.", (0, (1, 1)))
_LABEL: Final = 0.05  # least distance of labels along x over the width
_BINS: Final = 40
_MOST_CROSSINGS: Final = 4  # crossings of a curve in its legend
_END: Final = "holds to the end"  # keys of areas, beside the keys of the causes
_NONE: Final = "no value"
_NO_ARC: Final = "no arc"


def draw(found: ValidityMap) -> Figure:
    """Draw a map over two axes, or curves over one."""
    return _curves(found) if len(found.axes) == 1 else _regions(found)


def _title(found: ValidityMap) -> str:
    return title_of(found.robot.name, found.metric, found.max_tension, found.fixed)


def title_of(
    robot: str, metric: Metric, top: float, fixed: Sequence[tuple[Axis, float]] = ()
) -> str:
    """Title of a map; `top` is the end of the sweep in N."""
    end = f"{significant(top)} N"
    what = {
        "largest_error": f"largest tip error up to {end}",
        "mean_error": f"mean tip error up to {end}",
        "error": "tip error",
        "valid_to": "validity limit of constant curvature",
    }[metric]
    at = "".join(f", {in_words(axis, value)}" for axis, value in fixed)
    return f"{robot}: {what}{at} (simulated)"


def in_words(axis: Axis, value: float) -> str:
    """A value of an axis, such as ``tip force along x 0.5 N``."""
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    return f"{axis.words} {significant(value / axis.factor)}{unit}"


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
    for states, hatch in HATCHES:
        where = np.isin(found.state, states)
        _shade(panel, x, where, hatch, LIGHT["muted"], _states_label(found, states))
    for (name, undefined), colour in zip(found.undefined.items(), _LINES, strict=False):
        label = f"{LABELS[name]}: not defined"
        _shade(panel, x, undefined, UNDEFINED, LIGHT[colour], label)
    panel.set_xlim(x.min(), x.max())
    panel.set_xlabel(found.label(0))
    legend_above(panel, 1)
    figure.suptitle(_title(found), fontsize=9.5, x=0.01, ha="left")
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


def _shade(panel: Axes, x: Floats, where: Bools, hatch: str, colour: str, label: str) -> None:
    """Hatch a curve around the points of `where`."""
    half = 0.5 * np.abs(np.diff(x)).mean()
    for i, at in enumerate(x[where]):
        panel.axvspan(
            at - half,
            at + half,
            facecolor="none",
            edgecolor=colour,
            hatch=hatch,
            lw=0.0,
            label=label if i == 0 else None,
        )


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
    figure.suptitle(_title(found), fontsize=9.5, x=0.01, ha="left")
    return figure


def handles_of(found: ValidityMap, present: set[str]) -> list[Line2D | Patch]:
    """Entries of the legend of a map with these causes."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    white: Any = {"fc": "white", "ec": LIGHT["muted"]}
    space = found.settings.space
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
        look: Any = {"fc": LIGHT["grid"], "ec": LIGHT["muted"], "hatch": UNDEFINED, "lw": 0.0}
        label = STATES[4] + (" beyond its limit" if found.metric == "valid_to" else "")
        handles.append(Patch(**look, label=label))
    for key, colour in CAUSES.items():
        if key in present:
            label = f"mainly {EFFECTS[key].label}"
            handles.append(Patch(fc=LIGHT[colour], alpha=SHADE, label=label))
    if "" in present:
        words = "no main cause found" if space.not_examined else "no single main cause"
        handles.append(Patch(fc=LIGHT["grid"], label=words))
    for states, hatch in HATCHES:
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
    _hatch(panel, x, y, np.where(found.undefined[name], 1.0, 0.0), UNDEFINED)
    areas = {_END: ends, _NONE: np.isnan(value), _NO_ARC: found.undefined[name]}
    return {key for key, where in areas.items() if where.any()}


def _errors(panel: Axes, found: ValidityMap, name: str) -> set[str]:
    """Draw the error of one model; return the keys of the causes in its figure."""
    from matplotlib.colors import to_rgba

    fine = np.ma.masked_invalid(found.fine[name])
    x, y = (values / axis.factor for values, axis in zip(found.fine_axes, found.axes, strict=True))
    cause = _nearest(found, name, x, y)
    outside = fine.filled(0.0) > found.tolerance
    present = {str(key) for key in np.unique(cause[outside])}
    missing = np.isnan(found.fine[name])
    no_arc = _without_arc(found, name, x, y) if missing.any() else missing
    for where, hatch, face in (
        (no_arc, UNDEFINED, LIGHT["grid"]),
        (missing & ~no_arc, HATCHES[1][1], "none"),
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
        for key in sorted(present - {_NO_ARC}):  # a fixed order, for the same file in every run
            colour = to_rgba(LIGHT[CAUSES[key]], SHADE) if key else LIGHT["grid"]
            here = np.where(cause == key, 1.0, 0.0)
            part = panel.contourf(x, y, here, levels=[0.5, 1.5], colors=[colour])
            part.set_clip_path(above.get_paths()[0], panel.transData)
    levels = [v for v in _LEVELS if v != found.tolerance and fine.min() < v]
    if fine.count() > 3 and levels:
        thin = panel.contour(
            x, y, fine, levels=levels, colors=LIGHT["muted"], linewidths=0.7, linestyles=":"
        )
        labelled = _apart(thin, x, y)
        panel.clabel(thin, labelled, fmt=lambda v: in_percent(v), fontsize=7.0)
    for line in found.contour[name]:
        u, v = (line[:, i] / found.axes[i].factor for i in range(2))
        panel.plot(u, v, color=LIGHT["ink"], lw=2.0)
    return present


def _apart(lines: ContourSet, x: Floats, y: Floats) -> list[float]:
    """Levels of the lines whose middles lie apart, so that their labels do."""
    size = np.array([x.max() - x.min(), y.max() - y.min()])
    places: list[Floats] = []
    out = []
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        points = path.vertices / size
        if len(points) < 2:
            continue
        place = points[len(points) // 2]
        if all(np.abs(place - other)[0] > _LABEL for other in places):
            places.append(place)
            out.append(float(level))
    return out


def _finish(panel: Axes, found: ValidityMap) -> None:
    """Draw what is the same for all metrics: states, the robot as it is, limits of the axes."""
    from matplotlib.patheffects import withStroke
    from matplotlib.ticker import MaxNLocator

    bright = [withStroke(linewidth=2.0, foreground="white", alpha=0.7)]  # also on dark colours
    x, y = (axis.values / axis.factor for axis in found.axes)
    for states, hatch in HATCHES:
        _hatch(panel, x, y, np.where(np.isin(found.state, states), 1.0, 0.0), hatch)
    for i, own in _marked(found):
        mark = panel.axvline if i == 0 else panel.axhline
        mark(own, color=LIGHT["ink"], lw=0.8, ls="--", path_effects=bright)
    panel.set_xlim(x.min(), x.max())
    panel.set_ylim(y.min(), y.max())
    for one, axis in zip(found.axes, (panel.xaxis, panel.yaxis), strict=True):
        if one.is_whole:
            axis.set_major_locator(MaxNLocator(integer=True))
    panel.grid(False)


def _hatch(panel: Axes, x: Floats, y: Floats, where: Floats, hatch: str) -> None:
    """Hatch the region of a grid in which `where` is 1."""
    if where.any():
        drawn = panel.contourf(x, y, where, levels=[0.5, 1.5], colors="none", hatches=[hatch])
        drawn.set_edgecolor(LIGHT["muted"])
        drawn.set_linewidth(0.0)


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


# -- uncertain numbers ---------------------------------------------------------------------------


def draw_spread(found: Spread) -> Figure:
    """Draw the distribution of the validity limit, and Sobol' indices."""
    figure, (above, below) = subplots(2, 5.2, height_ratios=(3, 2))
    finite = found.limit[np.isfinite(found.limit)]
    percent = in_percent(found.tolerance, 3)
    of_limit = found.limit_indices is not None and finite.size > 0.5 * len(found.limit)
    values = finite if of_limit else 100.0 * found.error[np.isfinite(found.error)]
    summary = found.limit_summary if of_limit else found.error_summary
    scale = 1.0 if of_limit else 100.0
    total = int(np.isfinite(found.error).sum()) if not of_limit else len(found.limit)
    edges = np.linspace(0.0, found.max_tension if of_limit else values.max(), _BINS + 1).tolist()
    each: Any = {"weights": np.full(len(values), 100.0 / total)}
    above.hist(values, bins=edges, color=LIGHT["blue"], alpha=0.6, **each)
    held = 100.0 * float(np.isinf(found.limit).mean())
    if of_limit and held:
        wide = 2.0 * found.max_tension / _BINS
        label = f"holds to the end: {held:.0f} %"
        above.bar(
            found.max_tension + wide, held, wide, color=LIGHT["green"], alpha=0.6, label=label
        )
    two_sided = np.isfinite([float(summary.quantiles[p].value) for p in (0.025, 0.975)]).all()
    for p, style, label in (
        (0.5, "-", "median"),
        (0.025, ":", "95 % of the samples" if two_sided else "97.5 % of the samples lie above"),
        (0.975, ":", "" if two_sided else "97.5 % of the samples lie below"),
    ):
        at = float(summary.quantiles[p].value) * scale
        if np.isfinite(at):
            above.axvline(at, color=LIGHT["ink"], ls=style, lw=1.2, label=label or None)
    own = found.nominal if of_limit else 100.0 * found.tolerance
    if np.isfinite(own):
        label = "nominal robot" if of_limit else f"tolerance {percent}"
        above.axvline(own, color=LIGHT["red"], ls="--", lw=1.4, label=label)
    end = f"{significant(found.max_tension)} N"
    above.set_xlabel(
        f"{percent} of length holds up to (N); sweep to {end}"
        if of_limit
        else f"tip error at {end} (% of length)"
    )
    above.set_ylabel("share of the samples (%)")
    above.set_xlim(left=0.0)
    legend_above(above, 2)
    indices = found.limit_indices if of_limit else found.error_indices
    assert indices is not None
    order = np.argsort(np.nan_to_num(indices.total.value))
    place = np.arange(len(order), dtype=float)
    for estimate, shift, colour, label in (
        (indices.first, 0.18, "blue", "alone (first order)"),
        (indices.total, -0.18, "amber", "with interactions (total)"),
    ):
        value = np.clip(np.asarray(estimate.value)[order], 0.0, None)
        spread = [
            np.clip(value - np.asarray(estimate.low)[order], 0.0, None),
            np.clip(np.asarray(estimate.high)[order] - value, 0.0, None),
        ]
        below.barh(place + shift, value, 0.34, color=LIGHT[colour], label=label)
        below.errorbar(value, place + shift, xerr=spread, fmt="none", ecolor=LIGHT["ink"], lw=1.0)
    below.set_yticks(place, [indices.factors[i] for i in order])
    below.set_xlabel("share of the variance (Sobol' index, 95 % interval)")
    below.set_xlim(left=0.0)
    legend_above(below, 2)
    title = f"{found.robot.name}: constant curvature {LABELS[found.name]} (simulated)"
    figure.suptitle(title, fontsize=9.5, x=0.01, ha="left")
    return figure
