"""Figure of a wanted path of the tip, and of the tips under the commands of models."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from bowstring.aliases import Floats
from bowstring.viz.style import LIGHT, legend_above, log_ticks, subplots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LOOKS = (("blue", "-"), ("red", "--"))


def draw_path(wanted: Floats, landed: Mapping[str, Floats]) -> Figure:
    """Draw a wanted path of the tip and the tips under commands, from above and from the side.

    Parameters
    ----------
    wanted : ndarray (n, 3)
        Wanted positions in m.
    landed : mapping of str to ndarray (n, 3)
        Tips under the commands of each model in m, by its label; NaN where there is none.

    Returns
    -------
    matplotlib.figure.Figure
        Figure, to be drawn and saved within `bowstring.viz.style.figure_style`.
    """
    figure, panels = subplots(3, 8.4)
    views = ((0, 1, "x, mm", "y, mm"), (0, 2, "x, mm", "z, mm"))
    for panel, (across, up, x_label, y_label) in zip(panels, views, strict=False):
        panel.plot(
            1e3 * wanted[:, across],
            1e3 * wanted[:, up],
            color=LIGHT["muted"],
            linewidth=4.0,
            alpha=0.5,
            label="wanted",
        )
        for (label, tips), (colour, style) in zip(landed.items(), _LOOKS, strict=False):
            panel.plot(
                1e3 * tips[:, across], 1e3 * tips[:, up], style, color=LIGHT[colour], label=label
            )
        panel.set(xlabel=x_label, ylabel=y_label)
        panel.set_aspect("equal", adjustable="datalim")
    legend_above(panels[0], 3)
    last = panels[2]
    rows = np.arange(1, len(wanted) + 1)
    for (label, tips), (colour, style) in zip(landed.items(), _LOOKS, strict=False):
        miss = 1e3 * np.linalg.norm(tips - wanted, axis=1)
        last.plot(rows, np.maximum(miss, 1e-6), style, color=LIGHT[colour], label=label)
    last.set(xlabel="row of the path", ylabel="distance, mm", yscale="log")
    log_ticks(last.yaxis)
    return figure
