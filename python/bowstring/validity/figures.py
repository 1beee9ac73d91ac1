"""Figures of maps, and of limits with uncertain numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.formatting import in_percent, significant
from bowstring.validity.effects import EFFECTS
from bowstring.validity.errors import INPUTS, LABELS
from bowstring.validity.maps import STATES, Metric, ValidityMap
from bowstring.viz.style import LIGHT, legend_above, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from bowstring.validity.axes import Axis
    from bowstring.validity.spread import Spread

__all__ = [
    "CAUSES",
    "SHADE",
    "draw",
    "draw_region",
    "draw_spread",
    "handles_of",
    "in_words",
    "title_of",
]

Floats = NDArray[np.float64]

CAUSES: Final = {
    "straight_spans": "blue",
    "clamps": "amber",
    "shear_extension": "purple",
    "torsion": "green",
    "gravity": "red",
    "tip_force": "ink",
    "friction": "sky",
    "tendon_stretch": "blue",  # by displacement, where straight spans have no entry
}
HATCHES: Final = ((1, "...."), (2, "////"), (3, "\\\\"))
"""Indices in `STATES`, and their hatches."""
SHADE: Final = 0.35
_LEVELS: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5)  # share of length
_LINES: Final = ("blue", "red", "green", "purple", "amber")


def draw(found: ValidityMap) -> Figure:
    """Draw a map over two axes, or curves over one."""
    return _curves(found) if len(found.axes) == 1 else _regions(found)


def _title(found: ValidityMap) -> str:
    return title_of(found.robot.name, found.metric, found.tolerance, found.max_tension, found.fixed)


def title_of(
    robot: str,
    metric: Metric,
    tolerance: float,
    top: float,
    fixed: Sequence[tuple[Axis, float]] = (),
) -> str:
    """What a map shows, for its title; `top` is the end of the sweep in N."""
    what = {
        "largest_error": f"largest tip error up to {significant(top)} N",
        "mean_error": f"mean tip error up to {significant(top)} N",
        "error": "tip error",
        "valid_to": f"tension up to which {in_percent(tolerance)} of length holds",
    }[metric]
    at = "".join(f", {in_words(axis, value)}" for axis, value in fixed)
    return f"{robot}: {what}{at} (simulated)"


def in_words(axis: Axis, value: float) -> str:
    """A value of an axis, such as ``tip force along x 0.5 N``."""
    words = axis.label.removesuffix(f", {axis.units[1]}")
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    return f"{words} {significant(value / axis.factor)}{unit}"


# -- one axis ----------------------------------------------------------------------------------


def _curves(found: ValidityMap) -> Figure:
    axis = found.axes[0]
    x = axis.values / axis.factor
    figure, (panel,) = subplots(1, 3.1)
    scale = 1.0 if found.metric == "valid_to" else 100.0
    for (name, value), colour in zip(found.value.items(), _LINES, strict=False):
        mark = "o" if axis.is_whole else ""
        panel.plot(x, scale * value, color=LIGHT[colour], marker=mark, label=LABELS[name])
        for line in found.contour[name]:
            at = line[0, 0] / axis.factor
            panel.plot(at, scale * found.tolerance, "D", color=LIGHT[colour], zorder=3)
            panel.annotate(
                f"{at:.4g}", (at, scale * found.tolerance), (4, -10), textcoords="offset points"
            )
    if found.metric == "valid_to":
        panel.set_ylabel("tension, N")
    else:
        panel.axhline(scale * found.tolerance, color=LIGHT["ink"], ls="--", lw=1.0)
        panel.set_ylabel("tip error, % of length")
    panel.set_ylim(bottom=0.0)
    _shade_states(panel, found, x)
    panel.set_xlabel(axis.label)
    legend_above(panel, 2)
    figure.suptitle(_title(found), fontsize=9.5, x=0.01, ha="left")
    return figure


def _shade_states(panel: Axes, found: ValidityMap, x: Floats) -> None:
    half = 0.5 * np.abs(np.diff(x)).mean()
    for state, hatch in HATCHES:
        for i, at in enumerate(x[found.state == state]):
            panel.axvspan(
                at - half,
                at + half,
                facecolor="none",
                edgecolor=LIGHT["muted"],
                hatch=hatch,
                lw=0.0,
                label=STATES[state] if i == 0 else None,
            )


# -- two axes ----------------------------------------------------------------------------------


def _regions(found: ValidityMap) -> Figure:
    names = list(found.value)
    figure, panels = subplots(len(names), 0.6 + 2.9 * len(names), sharex=True)
    present: set[str] = set()
    for panel, name in zip(panels, names, strict=True):
        present |= draw_region(panel, found, name)
        panel.set_title(f"constant curvature {INPUTS[name]}")
        panel.set_ylabel(found.axes[1].label)
    panels[-1].set_xlabel(found.axes[0].label)
    figure.legend(handles=handles_of(found, present), loc="outside lower left", ncols=1)
    figure.suptitle(_title(found), fontsize=9.5, x=0.01, ha="left")
    return figure


def handles_of(found: ValidityMap, present: set[str]) -> list[Line2D | Patch]:
    """Entries of the legend of a map with these causes."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    if found.metric != "valid_to":
        tolerance = in_percent(found.tolerance)
        handles.append(Line2D([], [], color=LIGHT["ink"], lw=2.0, label=f"error {tolerance}"))
        handles.append(Patch(fc="white", ec=LIGHT["grid"], label=f"holds to {tolerance}"))
    for key, colour in CAUSES.items():
        if key in present:
            label = f"mainly {EFFECTS[key]}"
            handles.append(Patch(fc=LIGHT[colour], alpha=SHADE, label=label))
    if "" in present:
        handles.append(Patch(fc=LIGHT["grid"], label="no single main cause"))
    for state, hatch in HATCHES:
        if np.any(found.state == state):
            handles.append(
                Patch(fc="none", ec=LIGHT["muted"], hatch=hatch, lw=0.0, label=STATES[state])
            )
    if _marked(found):
        label = "this robot"
        handles.append(Line2D([], [], color=LIGHT["ink"], lw=0.8, ls="--", label=label))
    return handles


def draw_region(panel: Axes, found: ValidityMap, name: str) -> set[str]:
    """Draw one model; return the keys of the causes in its figure."""
    from matplotlib.colors import to_rgba

    x, y = (axis.values / axis.factor for axis in found.axes)
    value = found.value[name]
    present: set[str] = set()
    if found.metric == "valid_to":
        shade = panel.pcolormesh(x, y, value, cmap="viridis", shading="nearest", rasterized=True)
        panel.figure.colorbar(shade, ax=panel, label="tension, N")
    else:
        fine = found.fine[name]
        fine_x, fine_y = (
            values / axis.factor for values, axis in zip(found.fine_axes, found.axes, strict=True)
        )
        cause = _nearest(found, found.cause[name], fine_x, fine_y)
        outside = np.isfinite(fine) & (fine > found.tolerance)
        present = {str(key) for key in np.unique(cause[outside])}
        for key in present:
            colour = to_rgba(LIGHT[CAUSES[key]], SHADE) if key else LIGHT["grid"]
            here = np.where(outside & (cause == key), 1.0, 0.0)
            panel.contourf(fine_x, fine_y, here, levels=[0.5, 1.5], colors=[colour])
        levels = [v for v in _LEVELS if v != found.tolerance and np.nanmin(value) < v]
        if np.isfinite(value).sum() > 3 and levels:
            thin = panel.contour(
                fine_x,
                fine_y,
                fine,
                levels=levels,
                colors=LIGHT["muted"],
                linewidths=0.7,
                linestyles=":",
            )
            panel.clabel(thin, fmt=lambda v: in_percent(v), fontsize=7.0)
        for line in found.contour[name]:
            u, v = (line[:, i] / found.axes[i].factor for i in range(2))
            panel.plot(u, v, color=LIGHT["ink"], lw=2.0)
    for state, hatch in HATCHES:
        where = np.where(found.state == state, 1.0, np.nan)
        if np.isfinite(where).any():
            drawn = panel.contourf(
                x,
                y,
                np.nan_to_num(where),
                levels=[0.5, 1.5],
                colors="none",
                hatches=[hatch],
            )
            drawn.set_edgecolor(LIGHT["muted"])
            drawn.set_linewidth(0.0)
    for i, own in _marked(found):
        mark = panel.axvline if i == 0 else panel.axhline
        mark(own, color=LIGHT["ink"], lw=0.8, ls="--")
    panel.set_xlim(x.min(), x.max())
    panel.set_ylim(y.min(), y.max())
    panel.grid(False)
    return present


def _marked(found: ValidityMap) -> list[tuple[int, float]]:
    """Axes, and the robot's own value on each where it lies inside."""
    out = []
    for i, axis in enumerate(found.axes):
        own = axis.own_value(found.robot)
        if own is not None and min(axis.start, axis.stop) < own < max(axis.start, axis.stop):
            out.append((i, own / axis.factor))
    return out


def _nearest(found: ValidityMap, cause: NDArray[np.str_], x: Floats, y: Floats) -> NDArray[np.str_]:
    """Causes at the points of a grid, from the nearest of those computed."""
    known = (found.cause_points[0][0], found.cause_points[1][:, 0])
    columns, rows = (
        np.abs(new[:, None] * axis.factor - places[None, :]).argmin(axis=1)
        for new, axis, places in zip((x, y), found.axes, known, strict=True)
    )
    return np.asarray(cause[np.ix_(rows, columns)])


# -- uncertain numbers ---------------------------------------------------------------------------


def draw_spread(found: Spread) -> Figure:
    """Draw the distribution of the validity limit, and Sobol' indices."""
    figure, (above, below) = subplots(2, 5.0, height_ratios=(3, 2))
    finite = found.limit[np.isfinite(found.limit)]
    percent = in_percent(found.tolerance, 3)
    of_limit = found.limit_indices is not None and finite.size > 0.5 * len(found.limit)
    values = finite if of_limit else 100.0 * found.error[np.isfinite(found.error)]
    summary = found.limit_summary if of_limit else found.error_summary
    scale = 1.0 if of_limit else 100.0
    above.hist(values, bins=40, color=LIGHT["blue"], alpha=0.6)
    for p in (0.025, 0.975):
        at = float(summary.quantiles[p].value) * scale
        if np.isfinite(at):
            label = "95 % of the samples" if p < 0.5 else None
            above.axvline(at, color=LIGHT["ink"], ls=":", lw=1.2, label=label)
    own = found.nominal if of_limit else 100.0 * found.tolerance
    if np.isfinite(own):
        label = "nominal robot" if of_limit else f"tolerance {percent}"
        above.axvline(own, color=LIGHT["red"], ls="--", lw=1.4, label=label)
    top = f"{significant(found.max_tension)} N"
    above.set_xlabel(
        f"tension up to which {percent} of length holds, N"
        if of_limit
        else f"tip error at {top}, % of length"
    )
    above.set_ylabel("samples")
    above.set_yticks([])
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
