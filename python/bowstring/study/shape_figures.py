"""Figure of a study: constant curvature and curvature that varies along the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.constant_curvature.curvature_models import polyline_curvature
from bowstring.study.comparison import LABELS, short
from bowstring.viz.style import LIGHT, legend_above, log_ticks, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bowstring.study.study import Study

_LOOKS: Final = {
    "cc_from_lengths": ("blue", "-.", ""),
    "cc_from_force": ("red", "--", ""),
    "constant_curvature_fit": ("ink", "-", "o"),
    "linear_curvature_fit": ("green", "-", "^"),
    "quadratic_curvature_fit": ("purple", "-", "s"),
    "constant_curvature_from_loads": ("ink", ":", "x"),
    "linear_curvature_from_loads": ("green", ":", "+"),
    "quadratic_curvature_from_loads": ("purple", ":", "d"),
}
"""Colour, line and marker of the models in the figure."""
_LEAST: Final = 1e-4  # error in percent of the length that is drawn
_PLACES: Final = 41  # points along a segment


def draw_shapes(study: Study) -> Figure:
    """Draw errors against the load, and the curvature along the robot at the largest one."""
    figure, (tip, disks, along) = subplots(3, 8.2, height_ratios=(3, 3, 3))
    tension = study.statics.tension
    for model in study.shapes.models:
        if model.name not in _LOOKS:
            continue
        look = _look(model.name)
        for axes, error in ((tip, model.comparison.error), (disks, model.shape)):
            percent = error / study.length * 100.0
            percent = np.where(percent > _LEAST, percent, np.nan)
            axes.plot(tension, percent, label=_label(model.name), **look)
    for axes, what in ((tip, "tip error"), (disks, "RMS error over\nthe disks")):
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
        axes.minorticks_off()
        axes.set_ylabel(f"{what} (% of length)")
    disks.set_xlabel(f"tension of {study.settings.actuated} (N)")
    legend_above(tip, 2)
    _draw_curvature(study, along)
    return figure


def _look(name: str) -> dict[str, Any]:
    colour, line, marker = _LOOKS[name]
    look: dict[str, Any] = {"color": LIGHT[colour], "linestyle": line, "marker": marker}
    return look | {"markersize": 4.0, "markerfacecolor": "none"}


def _label(name: str) -> str:
    label = short(LABELS[name]).replace(" curvature,", ",")
    return f"CC {label}" if name.startswith("cc_") else label


def _draw_curvature(study: Study, axes: Axes) -> None:
    """Curvature towards the bending direction at the largest load with an equilibrium."""
    last = int(np.flatnonzero(study.statics.converged)[-1])
    towards = np.array(study.towards[:2])
    for name, curve in study.shapes.curves.items():
        start = 0.0
        for k, segment in enumerate(study.robot.segments):
            share = np.linspace(0.0, 1.0, _PLACES)
            places = (start + share * segment.length) / study.length * 100.0
            value = curve.curvature(k, share)[last] @ towards
            axes.plot(places, value, **(_look(name) | {"marker": ""}))
            start += segment.length
    edges, curvature = polyline_curvature(study.robot, study.statics.disk_positions[[last]])
    middles = 0.5 * (edges[1:] + edges[:-1]) / study.length * 100.0
    rod: dict[str, Any] = {"marker": "D", "linestyle": "none", "color": LIGHT["amber"]}
    axes.plot(middles, curvature[0] @ towards, markersize=4.0, label="rod, by disk", **rod)
    axes.set(xlabel="place (% of length from the base)", ylabel="curvature (1/m)")
    low, high = axes.get_ylim()
    middle, least = 0.5 * (low + high), 0.05 * max(abs(low), abs(high))  # low noise stays low
    half = max(0.5 * (high - low), least)
    axes.set_ylim(middle - half, middle + half)
    axes.legend(loc="best")
    load = study.statics.tension[last]
    axes.set_title(f"{study.settings.actuated} at {load:.4g} N", fontsize=8.5, loc="right")
