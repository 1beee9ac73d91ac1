"""Figure of the errors over the workspace, and of their causes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.formatting import in_percent
from bowstring.validity.effects import EFFECTS
from bowstring.validity.errors import LABELS
from bowstring.validity.figures import CAUSES, SHADE
from bowstring.validity.maps import STATES
from bowstring.viz.style import LIGHT, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    from bowstring.robot.model import Robot
    from bowstring.validity.workspace import WorkspaceMap

_CELLS: Final = 30  # hexagons along an axis
_NARROWEST: Final = 0.3  # least span of an axis over that of the other
_SHARE_OF_PLACE: Final = 0.02  # least span over the largest coordinate
_SHARES: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)  # shares of length
_HOLDS: Final = "holds"  # keys of hexagons beside those of the causes
_NO_ARC: Final = "no arc"
_CROSS: Final[dict[str, Any]] = {
    "marker": "x",
    "ls": "none",
    "color": LIGHT["ink"],
    "ms": 3.0,
    "mew": 0.7,
}
_RING: Final[dict[str, Any]] = {**_CROSS, "marker": "o", "mfc": "none", "ms": 4.0}
_KINDS: Final = (_HOLDS, *CAUSES, "", _NO_ARC)


def draw_workspace(found: WorkspaceMap) -> Figure:
    """Draw the largest error by tip position, and below it its main cause, for each model."""
    names = list(found.error)
    figure, panels = subplots(2 * len(names), 0.8 + 6.4 * len(names), sharex=True)
    present: set[str] = set()
    surface = len(found.robot.segments) == 1
    for i, name in enumerate(names):
        errors, causes = panels[2 * i : 2 * i + 2]
        _errors(figure, errors, found, name)
        present |= _causes(causes, found, name)
        errors.set_title(f"constant curvature {LABELS[name]}: largest error")
        causes.set_title(f"constant curvature {LABELS[name]}: cause of it")
        for panel in (errors, causes):
            panel.set_ylabel("y of the tip (mm)" if surface else "z of the tip (mm)")
            panel.set_aspect("equal", adjustable="box")
            keep_open(panel, places(found.robot, found.tip))
    far = "distance of the tip from the base's axis (mm)"
    panels[-1].set_xlabel("x of the tip (mm)" if surface else far)
    handles = _handles(found, present)
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=1)
    kinds = {2: ~found.solved & ~found.gave_up, 5: found.unknown}
    more = "".join(
        f"\n{int(where.sum())} of {len(found.tip)} poses: {STATES[state]}, not shown"
        for state, where in kinds.items()
        if where.any()
    )
    title = f"{found.robot.name}: workspace to {found.largest_tensions} (simulated){more}"
    figure.suptitle(title, fontsize=9.5, x=0.01, ha="left")
    return figure


def places(robot: Robot, tip: Floats) -> tuple[Floats, Floats]:
    """Horizontal and vertical place of tips (P, 3) in a panel, mm."""
    x, y, z = 1e3 * tip.T
    return (x, y) if len(robot.segments) == 1 else (np.hypot(x, y), z)


def extent(places: tuple[Floats, Floats]) -> tuple[float, float, float, float]:
    """Ranges of a panel with places (P,) in mm, also where these lie on a line or in one point.

    Without width, hexagons cannot be seen and a panel of equal scales has no area.
    """
    known = [p[np.isfinite(p)] for p in places]
    known = [p if p.size else np.zeros(1) for p in known]
    ends = [(float(p.min()), float(p.max())) for p in known]
    least = max(
        _NARROWEST * max(high - low for low, high in ends),
        _SHARE_OF_PLACE * max(abs(end) for pair in ends for end in pair),
        1e-9,
    )
    wide = [
        (low - w, high + w) for low, high in ends for w in [max(0.0, 0.5 * (least - high + low))]
    ]
    return (*wide[0], *wide[1])


def keep_open(panel: Axes, places: tuple[Floats, Floats]) -> None:
    """Set the ranges of a panel to the extent of places (P,) in mm, with margins."""
    left, right, low, high = extent(places)
    panel.update_datalim([(left, low), (right, high)])
    panel.margins(0.06)  # a hexagon extends beyond its centre
    panel.autoscale_view()


def _errors(figure: Figure, panel: Axes, found: WorkspaceMap, name: str) -> None:
    from matplotlib.patheffects import withStroke

    along, up = places(found.robot, found.tip)
    share = found.error[name] / found.robot.length
    cells = draw_cells(panel, (along, up), share, found.tolerance)
    if cells is not None:
        draw_bar(figure, [panel], cells, found.tolerance)
    bright = [withStroke(linewidth=2.5, foreground="white")]  # also on dark colours
    for where, mark in ((found.undefined(name), _CROSS), (found.two_equilibria, _RING)):
        if where.any():
            panel.plot(along[where], up[where], **mark, path_effects=bright)


def draw_cells(
    panel: Axes, places: tuple[Floats, Floats], error: Floats, tolerance: float
) -> PolyCollection | None:
    """Draw the largest error in each hexagon; None without an error.

    `places` are horizontal and vertical (P,) in mm; `error` (P,) and `tolerance` are shares of the
    length. Places with an error of NaN are left out.
    """
    from matplotlib.colors import BoundaryNorm, ListedColormap

    along, up = places
    error = 100.0 * error
    known = np.isfinite(error)
    bounds = sorted({0.0, *_SHARES, tolerance})
    within = bounds.index(tolerance)
    colours = ListedColormap(
        [*_shades("Blues_r", within), *_shades("Oranges", len(bounds) - within)]
    )
    norm: Any = BoundaryNorm([100.0 * b for b in bounds], colours.N, extend="max")
    if not known.any():
        return None
    return panel.hexbin(
        along[known],
        up[known],
        error[known],
        reduce_C_function=np.max,
        gridsize=_CELLS,
        extent=extent(places),
        norm=norm,
        cmap=colours,
        linewidths=0.1,
    )


def draw_bar(
    figure: Figure | SubFigure,
    panels: Sequence[Axes],
    cells: PolyCollection,
    tolerance: float,
    word: str = "error",
) -> None:
    """Draw the colour bar of `draw_cells` beside panels, with a line at the tolerance."""
    bar = figure.colorbar(cells, ax=list(panels), label=f"largest {word} (% of length)")
    bar.ax.axhline(100.0 * tolerance, color=LIGHT["ink"], lw=2.0)


def _causes(panel: Axes, found: WorkspaceMap, name: str) -> set[str]:
    """Draw the cause of the largest error in each hexagon; return the keys of those drawn."""
    from matplotlib.colors import BoundaryNorm, ListedColormap, to_rgba

    error = found.error[name]
    if found.solved.any() and (error[found.solved] <= found.tolerance * found.robot.length).all():
        words = f"holds to {in_percent(found.tolerance)} at all poses"
        panel.text(0.5, 0.5, words, transform=panel.transAxes, ha="center", va="center")
        along, up = (v[found.solved] for v in places(found.robot, found.tip))
        panel.plot(along, up, ls="none")  # the same range as the panel of the errors
        _room_of_a_bar(panel, panel.scatter([], [], c=[]))
        panel.grid(False)
        return {_HOLDS}
    along, up = places(found.robot, found.tip)
    outside = ~(error <= found.tolerance * found.robot.length)
    keys = np.where(outside, found.cause[name], _HOLDS)
    keys = np.where(found.undefined(name), _NO_ARC, keys)
    kind = np.array([_KINDS.index(str(key)) for key in keys])
    worst = np.where(found.undefined(name), np.inf, error)
    rows = np.flatnonzero(found.solved)
    if not rows.size:
        return set()

    def of_worst(members: Any) -> float:
        at = np.asarray(members, dtype=int)
        return float(kind[at[np.argmax(worst[at])]])

    shades = [to_rgba(LIGHT[colour], SHADE) for colour in CAUSES.values()]
    colours = ListedColormap(
        [to_rgba("white"), *shades, to_rgba(LIGHT["grid"]), to_rgba(LIGHT["muted"])]
    )
    cells = panel.hexbin(
        along[rows],
        up[rows],
        rows,
        reduce_C_function=of_worst,
        gridsize=_CELLS,
        extent=extent((along[rows], up[rows])),
        norm=BoundaryNorm(np.arange(len(_KINDS) + 1) - 0.5, len(_KINDS)),
        cmap=colours,
        linewidths=0.3,
        edgecolors=LIGHT["muted"],
    )
    _room_of_a_bar(panel, cells)
    panel.grid(False)
    shown = np.asarray(cells.get_array()).astype(int)
    return {_KINDS[i] for i in np.unique(shown)}


def _room_of_a_bar(panel: Axes, shown: Any) -> None:
    """Leave the room of a colour bar, so that both panels have one scale."""
    bar: Any = panel.figure.colorbar(shown, ax=panel, label="largest error", format="10.0")
    for part in (bar.outline, bar.solids):
        part.set_visible(False)
    bar.minorticks_off()
    bar.ax.tick_params(colors="none")
    bar.ax.yaxis.label.set_color("none")


def _handles(found: WorkspaceMap, present: set[str]) -> list[Line2D | Patch]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    if _HOLDS in present:
        label = f"holds to {in_percent(found.tolerance)}"
        handles.append(Patch(fc="white", ec=LIGHT["muted"], label=label))
    for key, colour in CAUSES.items():
        if key in present:
            handles.append(
                Patch(fc=LIGHT[colour], alpha=SHADE, label=f"mainly {EFFECTS[key].label}")
            )
    if "" in present:
        words = "no main cause found" if found.robot.is_coupled else "no single main cause"
        handles.append(Patch(fc=LIGHT["grid"], label=words))
    if _NO_ARC in present:
        handles.append(Line2D([], [], **_CROSS, label=f"pose: {STATES[4]}"))
        handles.append(Patch(fc=LIGHT["muted"], label=STATES[4]))
    if found.two_equilibria.any():
        label = f"pose: {STATES[1]}, the robot may snap through"
        handles.append(Line2D([], [], **_RING, label=label))
    return handles


def _shades(name: str, count: int) -> list[tuple[float, ...]]:
    """Colours of one of matplotlib's maps, without its palest ones."""
    from matplotlib import colormaps

    dark_first = name.endswith("_r")
    places = np.linspace(0.05, 0.65, count) if dark_first else np.linspace(0.35, 0.95, count)
    return [tuple(colormaps[name](place)) for place in places]
