"""Figure of the reach of a robot, with dexterity, compliance and payload."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.formatting import in_percent
from bowstring.validity.drawn import extent
from bowstring.viz.style import LIGHT, WIDTH, log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bowstring.validity.reach import Reach

_CELLS: Final = 28  # hexagons along an axis
_ELLIPSES: Final = 14
_LEAST: Final = 1e-30  # least payload on the logarithmic scale, N
_SIZE: Final = 0.05  # size of the largest ellipse over the span of the panel


def draw_reach(found: Reach) -> Figure:
    """Draw both reachable sets, dexterity, compliance and payload."""
    from matplotlib.figure import Figure

    solved = found.solved
    places = _places(found.tip[solved])
    arcs = _places(found.arc_tip)
    both = np.concatenate([places, arcs], axis=1)
    left, right, low, high = extent((both[0], both[1]))
    shape = np.clip((high - low) / (right - left), 0.3, 2.0)  # of a panel
    figure = Figure(figsize=(WIDTH * 1.5, 1.4 + 4.6 * shape), layout="constrained")
    grid: Any = figure.subplots(2, 2, sharex=True, sharey=True)
    sets, dexterity, compliance, payload = grid.ravel()
    sets.plot(*arcs, ".", ms=1.6, color=LIGHT["red"], alpha=0.5, label="constant curvature")
    sets.plot(*places, ".", ms=1.6, color=LIGHT["blue"], alpha=0.5, label="physics")
    sets.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=2,
        markerscale=5.0,
        handletextpad=0.2,
        columnspacing=0.8,
        title="reachable tips",
        alignment="left",
        title_fontsize=9.5,
        borderaxespad=0.1,
        borderpad=0.0,
    )
    _cells(figure, dexterity, places, found.dexterity[solved], "dexterity", "least")
    softness = 1e3 * found.softness[solved]
    _cells(figure, compliance, places, softness, "compliance (mm/N)", "largest")
    _ellipses(compliance, found, places)
    carried = np.where(np.isfinite(found.payload), found.payload, np.nan)[solved]
    known = np.isfinite(carried)
    if known.any():
        norm = "log" if (carried[known] > _LEAST).all() else None  # no logarithm of zero
        _cells(figure, payload, places, carried, "force on the tip (N)", "least", norm)
    else:
        payload.text(0.5, 0.5, "no limit found", transform=payload.transAxes, ha="center")
    payload.set_title(f"payload to {in_percent(found.tolerance)} of length, least")
    for panel in grid[:, 0]:
        panel.set_ylabel("z of the tip (mm)")
    for panel in grid[1]:
        panel.set_xlabel("from the base's axis (mm)")
    for panel in grid.ravel():
        panel.set_aspect("equal", adjustable="box")
        panel.margins(0.06)
    figure.suptitle(
        f"{found.robot.name}: reach and what it can do there (simulated)",
        fontsize=9.5,
        x=0.01,
        ha="left",
    )
    return figure


def _places(tips: Floats) -> tuple[Floats, Floats]:
    x, y, z = 1e3 * tips.T
    return np.hypot(x, y), z


def _cells(
    figure: Figure,
    panel: Axes,
    places: tuple[Floats, Floats],
    values: Floats,
    label: str,
    which: str,
    norm: str | None = None,
) -> None:
    """Draw the least or the largest value in each hexagon; NaN is left out."""
    known = np.isfinite(values)
    cells = panel.hexbin(
        places[0][known],
        places[1][known],
        values[known],
        reduce_C_function=np.min if which == "least" else np.max,
        gridsize=_CELLS,
        extent=extent(places),
        cmap="viridis",
        linewidths=0.1,
        norm=norm,
    )
    bar = figure.colorbar(cells, ax=panel, label=label)
    if norm == "log":
        log_ticks(bar.ax.yaxis)
    panel.set_title(f"{label.split(' (')[0]}, {which}")


def _ellipses(panel: Axes, found: Reach, places: tuple[Floats, Floats]) -> None:
    """Draw the tip displacements by forces of one size in the plane of the panel, at some poses."""
    from matplotlib.patches import Ellipse

    rows = np.flatnonzero(found.solved)
    points = np.stack(places, axis=-1)
    span = float(np.ptp(points, axis=0).max()) or 1.0
    chosen = [int(np.argmin(points[:, 0]))]
    far = np.full(len(points), np.inf)
    for _ in range(min(_ELLIPSES, len(points)) - 1):
        far = np.minimum(far, np.linalg.norm(points - points[chosen[-1]], axis=-1))
        chosen.append(int(np.argmax(far)))
    shapes = []
    for k in chosen:
        x, y, _ = found.tip[rows[k]]
        angle = np.arctan2(y, x)
        plane = np.array([[np.cos(angle), np.sin(angle), 0.0], [0.0, 0.0, 1.0]])
        directions, sizes, _ = np.linalg.svd(plane @ found.compliance[rows[k]] @ plane.T)
        shapes.append((points[k], sizes, np.degrees(np.arctan2(*directions[::-1, 0]))))
    largest = max(sizes[0] for _, sizes, _ in shapes)
    for centre, sizes, turn in shapes:
        width, height = 2.0 * _SIZE * span * sizes / largest
        panel.add_patch(
            Ellipse(
                (float(centre[0]), float(centre[1])),
                width,
                height,
                angle=float(turn),
                fc="none",
                ec=LIGHT["ink"],
                lw=0.9,
            )
        )
