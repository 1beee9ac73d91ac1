"""Figure of a map over any number of axes: parallel coordinates, and slices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.formatting import in_percent, significant
from bowstring.validity.axes import Axis, in_words
from bowstring.validity.errors import INPUTS
from bowstring.validity.figures import CAUSES, SHADE, title_of
from bowstring.validity.map_result import STATES, draw_region, handles_of
from bowstring.viz.style import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from bowstring.validity.map_result import ValidityMap
    from bowstring.validity.multi_axis_maps import ValidityGrid

_WIDTH: Final = 7.4  # inches: three slices beside each other
_SLICES: Final = 3  # most slices
_LINES: Final = 100  # most points of a kind that are drawn as lines
_DARK: Final = 0.55  # opacity of the lines of points that hold
_FAINT: Final = 0.18  # opacity of the other lines
_BAR: Final = 0.34  # width of the bars over the distance of two axes
_LIMITS: Final = 4  # classes of the validity limit
_FEW: Final = 6  # points of an axis that all have a label
_FLOOR: Final = 0.03  # lower end of the axis of the error, over the tolerance
_TICKS: Final = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # share of length


class _Kinds(NamedTuple):
    """Kinds of points: by effect outside the tolerance, or by validity limit."""

    of: Ints
    """Kind of each point of the map; -1 where the tolerance holds, `len(colours) - 1` where the
    error is not known at all loads, or constant curvature is not defined."""
    colours: list[Any]
    """Colour of each kind."""
    causes: list[str]
    """Effects among the kinds, in their order; empty for the validity limit."""


def draw_grid(found: ValidityGrid) -> Figure:
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
        present = _parallel(panel, found, name)
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
    figure.suptitle(title, fontsize=9.5, x=0.01, ha="left")
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
    if any(_own(found, axis) is not None for axis in found.axes):
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


# -- slices ------------------------------------------------------------------------------------


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
    own = _own(found, axis)
    return float(axis.values[len(axis.values) // 2]) if own is None else own


def _own(found: ValidityGrid, axis: Axis) -> float | None:
    """The robot's own value where it is on the axis."""
    own = axis.own_value(found.space.robot)
    inside = own is not None and axis.values.min() <= own <= axis.values.max()
    return own if inside else None


# -- parallel coordinates ----------------------------------------------------------------------


def _kinds(found: ValidityGrid, name: str) -> _Kinds:
    from matplotlib import colormaps
    from matplotlib.colors import to_rgba

    value = found.value[name]
    if found.metric == "valid_to":
        ends = np.linspace(0.0, found.space.max_tension, _LIMITS + 1)
        of = np.clip(np.digitize(value, ends) - 1, 0, _LIMITS - 1)
        shades = colormaps["viridis"]((np.arange(_LIMITS) + 0.5) / _LIMITS)
        colours: list[Any] = [tuple(map(float, shade)) for shade in shades]
        causes: list[str] = []
    else:
        causes = [*CAUSES, ""]
        colours = [to_rgba(LIGHT[colour], SHADE) for colour in CAUSES.values()]
        colours.append(LIGHT["grid"])
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
    return _Kinds(of, [*colours, "none"], causes)


def _parallel(panel: Axes, found: ValidityGrid, name: str) -> set[str]:
    """Draw parallel coordinates of one model; return the keys of the causes in them."""
    kinds = _kinds(found, name)
    _lines(panel, found, name, kinds)
    for i, axis in enumerate(found.axes):
        _bars(panel, i, kinds)
        _axis(panel, i, found, _own(found, axis))
    _value_axis(panel, found, name)
    panel.set_xlim(-0.15, len(found.axes) + 0.35)
    panel.set_ylim(-0.03, 1.12)
    panel.axis("off")
    panel.grid(False)
    return {kinds.causes[k] for k in np.unique(kinds.of) if 0 <= k < len(kinds.causes)}


def _lines(panel: Axes, found: ValidityGrid, name: str, kinds: _Kinds) -> None:
    """Draw some points as lines, spread over the height of their values."""
    from matplotlib.collections import LineCollection

    rng = np.random.default_rng(0)
    of, value = kinds.of.ravel(), found.value[name].ravel()
    limit = found.metric == "valid_to"
    known = np.flatnonzero(of < len(kinds.colours) - 1)
    outside = known if limit else known[of[known] >= 0]
    inside = known[of[known] < 0]
    for points, strong in ((outside, False), (inside, True)):
        if not points.size:
            continue
        some = np.sort(rng.choice(points, min(_LINES, points.size), replace=False))
        places = np.stack(np.unravel_index(some, kinds.of.shape), axis=1)
        y = (places + rng.uniform(0.15, 0.85, places.shape)) / kinds.of.shape
        y = np.column_stack([y, _height(found, name, value[some])])
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


def _bars(panel: Axes, i: int, kinds: _Kinds) -> None:
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


def _axis(panel: Axes, i: int, found: ValidityGrid, own: float | None) -> None:
    """Label and values of an axis, and the robot's own value on it."""
    from matplotlib.ticker import MaxNLocator

    axis = found.axes[i]
    values = axis.values
    panel.text(i, 1.04, _short(found.label(i)), ha="left", va="bottom", fontsize=8.5)
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
    if own is not None:
        y = height(own)
        panel.plot([i, i + _BAR], [y, y], color=LIGHT["ink"], lw=0.9, ls="--", zorder=5)


def _short(label: str) -> str:
    words, bracket, unit = label.rpartition(" (")
    return f"{words}\n({unit}" if bracket and len(label) > 24 else label


def _height(found: ValidityGrid, name: str, value: Floats) -> Floats:
    """Height of values on the last axis: logarithm of the error, or validity limit."""
    if found.metric == "valid_to":
        return np.asarray(value / found.space.max_tension)
    low, high = _range(found, name)
    return np.asarray(np.log(np.maximum(value, low) / low) / np.log(high / low))


def _range(found: ValidityGrid, name: str) -> tuple[float, float]:
    value = found.value[name]
    known = value[np.isfinite(value)]
    top = max(float(known.max()) if known.size else 0.0, 2.0 * found.tolerance)
    return _FLOOR * found.tolerance, 1.1 * top


def _value_axis(panel: Axes, found: ValidityGrid, name: str) -> None:
    """Draw the axis of the error, or of the validity limit."""
    x = len(found.axes)
    panel.plot([x, x], [0.0, 1.0], color=LIGHT["muted"], lw=0.9)
    if found.metric == "valid_to":
        title, marks = "holds up to, N", np.linspace(0.0, found.space.max_tension, 5)
        texts = [significant(mark) for mark in marks]
    else:
        low, high = _range(found, name)
        tolerance = found.tolerance
        far = [t for t in _TICKS if low < t < high and not 0.5 < t / tolerance < 2.0]
        title, marks = "tip error,\n% of length", np.array([low, *far, tolerance])
        texts = [f"≤ {in_percent(low)}", *map(in_percent, far), in_percent(tolerance)]
        y = float(_height(found, name, np.array([tolerance]))[0])
        panel.plot([x - 0.06, x + 0.06], [y, y], color=LIGHT["ink"], lw=2.0, zorder=4)
    panel.text(x, 1.04, title, ha="left", va="bottom", fontsize=8.5)
    for y, text in zip(_height(found, name, marks), texts, strict=True):
        panel.plot([x, x + 0.02], [y, y], color=LIGHT["muted"], lw=0.7)
        panel.text(x + 0.07, y, text, ha="left", va="center", fontsize=8.0)
