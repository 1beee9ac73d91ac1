"""Figure of a branch diagram."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bowstring.viz.style import LIGHT, legend_above, subplots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.statics.branches import Branch, BranchDiagram

_STYLES = {True: ("-", "stable"), False: ("--", "unstable"), None: (":", "not determined")}
_MARKERS = {"limit_point": ("o", "limit point"), "bifurcation": ("s", "bifurcation")}


def draw_branches(diagram: BranchDiagram) -> Figure:
    """Draw the tip's coordinates along all branches: stable solid, unstable dashed, events marked.

    Coordinates that stay within 1e-6 of the length are left out.

    Returns
    -------
    matplotlib.figure.Figure
        Figure, to be drawn and saved within `bowstring.viz.style.figure_style`.
    """
    tips = np.concatenate([branch.tip_position for branch in diagram.branches])
    spread = np.ptp(tips, axis=0) > 1e-6 * diagram.robot.length
    shown = [axis for axis in range(3) if spread[axis]] or [2]
    figure, panels = subplots(len(shown), 1.0 + 2.2 * len(shown), sharex=True)
    for panel, axis in zip(panels, shown, strict=True):
        labelled: set[str] = set()
        for branch in diagram.branches:
            value = 1e3 * branch.tip_position[:, axis]
            for first, last, stable in _pieces(branch):
                style, label = _STYLES[stable]
                panel.plot(
                    branch.factor[first : last + 1],
                    value[first : last + 1],
                    style,
                    color=LIGHT["ink"],
                    label=None if label in labelled else label,
                )
                labelled.add(label)
            for event in branch.events:
                marker, label = _MARKERS[event.kind]
                panel.plot(
                    event.factor,
                    value[event.point],
                    marker,
                    color=LIGHT["ink"],
                    markerfacecolor="white",
                    label=None if label in labelled else label,
                )
                labelled.add(label)
        panel.set_ylabel(f"tip {'xyz'[axis]} (mm)")
    panels[-1].set_xlabel("load factor (1)")
    legend_above(panels[0], 5)
    return figure


def _pieces(branch: Branch) -> list[tuple[int, int, bool | None]]:
    """First and last point of the pieces of equal stability.

    An event, whose stability is not determined, ends one piece and begins the next.
    """
    events = {event.point for event in branch.events}
    out: list[tuple[int, int, bool | None]] = []
    for a, b in pairwise(range(len(branch))):
        stable = branch.stable[a] if b in events or b == len(branch) else branch.stable[b]
        if a in events or (a == 0 and branch.origin is not None):
            stable = branch.stable[b]
        if out and out[-1][2] is stable and out[-1][1] == a:
            out[-1] = (out[-1][0], b, stable)
        else:
            out.append((a, b, stable))
    return out
