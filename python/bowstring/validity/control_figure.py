"""Figure of the control errors of constant curvature."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.formatting import in_percent
from bowstring.validity.control_commands import COMMANDS
from bowstring.validity.drawn import draw_bar, draw_cells, keep_open, places
from bowstring.viz.style import LIGHT, WIDTH, log_ticks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

    from bowstring.validity.control import ControlErrors

_LOOKS: Final = {
    "tensions": ("blue", "o"),
    "tensions_arm": ("green", "^"),
    "tensions_calibrated": ("amber", "s"),
    "displacements": ("red", "D"),
    "displacements_chord": ("purple", "v"),
}
_TITLES: Final = {
    "tensions": "tensions, linear law",
    "tensions_arm": "tensions, mean arm",
    "tensions_calibrated": "tensions, E I calibrated",
    "displacements": "displacements",
    "displacements_chord": "displacements, chords",
}
_LEAST: Final = 1e-6  # percent of length; lower end of the axes
_HEIGHT: Final = 2.4  # inches, of a panel


def draw_control(found: ControlErrors) -> Figure:
    """Draw a map of the distance for each command, and lines over corrections and load."""
    from matplotlib.figure import Figure

    names = [name for name in found.landed if name in _LOOKS]
    loaded = len(found.load_shares) > 0
    corrected = len(found.landed[names[0]]) > 1
    maps, lines = (len(names) + 1) // 2, int(corrected) + int(loaded)
    heights = [_HEIGHT * maps, _HEIGHT * lines + 0.5][: 1 + (lines > 0)]
    figure = Figure(figsize=(WIDTH * 1.3, 0.4 + sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    _draw_maps(parts[0, 0], found, names)
    if lines:
        panels = list(parts[1, 0].subplots(lines, 1, squeeze=False)[:, 0])
        if corrected:
            panel = panels[0]
            for name in names:
                rows = found.summary(name)
                _lines(panel, found, name, range(len(rows)), [[r.mean, r.largest] for r in rows])
            panel.set_xlabel("corrections by the measured tip")
            panel.set_xticks(range(len(found.landed[names[0]])))
        if loaded:
            for name in names:
                _lines(panels[-1], found, name, 100.0 * found.load_shares, found.by_load[name])
            panels[-1].set_xlabel("share of the dead loads (%), without corrections")
        for panel in panels:
            _finish(panel, found)
        parts[1, 0].legend(
            *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2
        )
    figure.suptitle(
        f"{found.robot.name}: where commands of constant curvature lead (simulated)",
        fontsize=9.5,
        x=0.01,
        ha="left",
    )
    return figure


def _draw_maps(part: SubFigure, found: ControlErrors, names: list[str]) -> None:
    rows = (len(names) + 1) // 2
    grid = part.subplots(rows, min(2, len(names)), squeeze=False, sharex=True, sharey=True)
    panels = list(grid.ravel())
    surface = len(found.robot.segments) == 1
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    drawn = None
    for panel, name in zip(panels, names, strict=False):
        share = found.distance(name)[0] / found.robot.length
        at = places(found.robot, found.wanted)
        cells = draw_cells(panel, at, share, found.tolerance)
        drawn = drawn if cells is None else cells
        panel.set_title(_TITLES[name])
        panel.set_aspect("equal", adjustable="box")
        keep_open(panel, at)
        panel.tick_params(labelbottom=True)
    for row in grid:
        row[0].set_ylabel("y of the wanted tip (mm)" if surface else "z of the wanted tip (mm)")
    for panel in panels[max(0, len(names) - 2) : len(names)]:
        panel.set_xlabel("x of the wanted tip (mm)" if surface else "from the axis (mm)")
    if drawn is not None:
        draw_bar(part, panels, drawn, found.tolerance, "distance")


def _lines(panel: Axes, found: ControlErrors, name: str, at: Any, values: Any) -> None:
    colour, mark = _LOOKS[name]
    share = 100.0 * np.asarray(values, dtype=float) / found.robot.length
    mean, most = np.maximum(share, _LEAST).T
    panel.plot(at, mean, color=LIGHT[colour], marker=mark, label=COMMANDS[name])
    panel.plot(at, most, color=LIGHT[colour], marker=mark, ls="--", mfc="none")


def _finish(panel: Axes, found: ControlErrors) -> None:
    tolerance = max(100.0 * found.tolerance, _LEAST)
    panel.axhline(tolerance, color=LIGHT["ink"], lw=1.0, ls=":")
    panel.annotate(
        f"tolerance\n{in_percent(found.tolerance)}",
        (1.0, tolerance),
        xycoords=("axes fraction", "data"),
        xytext=(4, 0),
        textcoords="offset points",
        ha="left",
        va="center",
        fontsize=8.0,
    )
    panel.set_yscale("log")
    log_ticks(panel.yaxis)
    panel.set_ylabel("distance (% of length)\nmean; dashed: largest")
