"""Parallel coordinates of the points of a map over any number of axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.formatting import in_percent, significant
from bowstring.validity.map_settings import MapSettings
from bowstring.viz.style import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINES: Final = 100  # most points of a kind that are drawn as lines
_DARK: Final = 0.55  # opacity of the lines of points that hold
_FAINT: Final = 0.18  # opacity of the other lines
_BAR: Final = 0.34  # width of the bars over the distance of two axes
_FEW: Final = 6  # points of an axis that all have a label
_FLOOR: Final = 0.03  # lower end of the axis of the error, over the tolerance
_TICKS: Final = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # share of length


class Kinds(NamedTuple):
    """Kinds of points: by effect outside the tolerance, or by validity limit."""

    of: Ints
    """Kind of each point of the map; -1 where the tolerance holds, `len(colours) - 1` where the
    error is not known at all loads, or constant curvature is not defined."""
    colours: list[Any]
    """Colour of each kind."""
    causes: list[str]
    """Effects among the kinds, in their order; empty for the validity limit."""


def draw_parallel(panel: Axes, settings: MapSettings, value: Floats, kinds: Kinds) -> set[str]:
    """Draw the metric of one model at all points; return the keys of the causes in the panel."""
    _lines(panel, settings, value.ravel(), kinds)
    for i in range(value.ndim):
        _bars(panel, i, kinds)
        _axis(panel, i, settings)
    _value_axis(panel, settings, value)
    panel.set_xlim(-0.15, value.ndim + 0.35)
    panel.set_ylim(-0.03, 1.12)
    panel.axis("off")
    panel.grid(False)
    return {kinds.causes[k] for k in np.unique(kinds.of) if 0 <= k < len(kinds.causes)}


def _lines(panel: Axes, settings: MapSettings, value: Floats, kinds: Kinds) -> None:
    """Draw some points as lines, spread over the height of their values."""
    from matplotlib.collections import LineCollection

    rng = np.random.default_rng(0)
    of = kinds.of.ravel()
    limit = settings.metric == "valid_to"
    known = np.flatnonzero(of < len(kinds.colours) - 1)
    outside = known if limit else known[of[known] >= 0]
    inside = known[of[known] < 0]
    for points, strong in ((outside, False), (inside, True)):
        if not points.size:
            continue
        some = np.sort(rng.choice(points, min(_LINES, points.size), replace=False))
        places = np.stack(np.unravel_index(some, kinds.of.shape), axis=1)
        y = (places + rng.uniform(0.15, 0.85, places.shape)) / kinds.of.shape
        y = np.column_stack([y, _height(settings, value, value[some])])
        last = y.shape[1] - 1
        parts = [
            np.stack([np.full_like(y[:, :2], i + _BAR), y[:, i : i + 2]], axis=2)
            for i in range(last)
        ]
        for i, part in enumerate(parts):
            part[:, 1, 0] = i + 1
        colours = LIGHT["ink"] if strong else [kinds.colours[k] for k in of[some]] * last
        faint = None if limit else _FAINT
        panel.add_collection(
            LineCollection(
                list(np.concatenate(parts)),
                colors=colours,
                lw=0.7,
                alpha=_DARK if strong else faint,
            )
        )


def _bars(panel: Axes, i: int, kinds: Kinds) -> None:
    """Share of each kind at each value of an axis."""
    from matplotlib.patches import Rectangle

    count = kinds.of.shape[i]
    rows = np.moveaxis(kinds.of, i, 0).reshape(count, -1)
    y, left = (np.arange(count) + 0.5) / count, np.full(count, float(i))
    panel.add_patch(Rectangle((i, 0.0), _BAR, 1.0, fc="white", ec="none", zorder=2))
    for kind, colour in enumerate(kinds.colours):
        width = _BAR * (rows == kind).mean(axis=1)
        if not width.any():
            continue
        hatch = "////" if kind == len(kinds.colours) - 1 else None
        edge = LIGHT["muted"] if hatch else None
        panel.barh(
            y, width, 1.0 / count, left=left, color=colour, hatch=hatch, ec=edge, lw=0.0, zorder=3
        )
        left = left + width
    panel.add_patch(Rectangle((i, 0.0), _BAR, 1.0, fc="none", ec=LIGHT["muted"], lw=0.7, zorder=4))


def _axis(panel: Axes, i: int, settings: MapSettings) -> None:
    """Label and values of an axis, and the robot's own value on it."""
    from matplotlib.ticker import MaxNLocator

    axis = settings.space.axes[i]
    values = axis.values
    panel.text(i, 1.04, _short(settings.label(i)), ha="left", va="bottom", fontsize=8.5)
    order = np.argsort(values)

    def height(value: float) -> float:
        return float(np.interp(value, values[order], order) + 0.5) / len(values)

    ends = (min(values) / axis.factor, max(values) / axis.factor)
    nice = values / axis.factor
    if len(values) > _FEW:
        nice = np.array(MaxNLocator(5, integer=axis.is_whole).tick_values(*ends))
    for tick in nice[(nice >= ends[0]) & (nice <= ends[1])]:
        text = significant(tick, 4)
        y = height(tick * axis.factor)
        panel.plot([i - 0.02, i], [y, y], color=LIGHT["muted"], lw=0.7, zorder=4)
        label = panel.text(i - 0.035, y, text, ha="right", va="center", fontsize=8.0, zorder=5)
        label.set_bbox({"fc": "white", "ec": "none", "alpha": 0.8, "pad": 0.6})
    own = axis.own_value_inside(settings.space.robot)
    if own is not None:
        y = height(own)
        panel.plot([i, i + _BAR], [y, y], color=LIGHT["ink"], lw=0.9, ls="--", zorder=5)


def _short(label: str) -> str:
    words, bracket, unit = label.rpartition(" (")
    return f"{words}\n({unit}" if bracket and len(label) > 24 else label


def _height(settings: MapSettings, value: Floats, some: Floats) -> Floats:
    """Height of some values on the last axis: logarithm of the error, or validity limit."""
    if settings.metric == "valid_to":
        return np.asarray(some / settings.space.max_tension)
    low, high = _range(settings, value)
    return np.asarray(np.log(np.maximum(some, low) / low) / np.log(high / low))


def _range(settings: MapSettings, value: Floats) -> tuple[float, float]:
    known = value[np.isfinite(value)]
    top = max(float(known.max()) if known.size else 0.0, 2.0 * settings.tolerance)
    return _FLOOR * settings.tolerance, 1.1 * top


def _value_axis(panel: Axes, settings: MapSettings, value: Floats) -> None:
    """Draw the axis of the error, or of the validity limit."""
    x = len(settings.space.axes)
    panel.plot([x, x], [0.0, 1.0], color=LIGHT["muted"], lw=0.9)
    if settings.metric == "valid_to":
        title, marks = "holds up to, N", np.linspace(0.0, settings.space.max_tension, 5)
        texts = [significant(mark) for mark in marks]
    else:
        low, high = _range(settings, value)
        tolerance = settings.tolerance
        far = [t for t in _TICKS if low < t < high and not 0.5 < t / tolerance < 2.0]
        title, marks = "tip error,\n% of length", np.array([low, *far, tolerance])
        texts = [f"≤ {in_percent(low)}", *map(in_percent, far), in_percent(tolerance)]
        y = float(_height(settings, value, np.array([tolerance]))[0])
        panel.plot([x - 0.06, x + 0.06], [y, y], color=LIGHT["ink"], lw=2.0, zorder=4)
    panel.text(x, 1.04, title, ha="left", va="bottom", fontsize=8.5)
    for y, text in zip(_height(settings, value, marks), texts, strict=True):
        panel.plot([x, x + 0.02], [y, y], color=LIGHT["muted"], lw=0.7)
        panel.text(x + 0.07, y, text, ha="left", va="center", fontsize=8.0)
