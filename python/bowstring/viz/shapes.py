"""Figure of backbone shapes with their fitted arcs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.formatting import in_percent
from bowstring.viz.style import LIGHT, legend_above, subplots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.constant_curvature.shape import ArcFit

__all__ = ["backbone_shapes"]


def backbone_shapes(fits: Sequence[ArcFit], source: str) -> Figure:
    """Draw shapes with their fitted arcs, and the error of the arcs along the robot.

    Parameters
    ----------
    fits : sequence of bowstring.constant_curvature.shape.ArcFit
        Fits of the same shapes with different numbers of pieces; the first is drawn beside the
        shapes.
    source : str
        Source of the shapes for the title, such as ``"measured: NAME"`` or ``"synthetic"``.

    Returns
    -------
    matplotlib.figure.Figure
        Figure, to be drawn and saved within `figure_style`.
    """
    if not fits or len({(len(f), f.dimensions) for f in fits}) > 1:
        raise InputError("the figure needs fits of the same shapes, with one or more pieces")
    figure, (shapes, error, bending) = subplots(3, 7.4, height_ratios=(3, 2, 2))
    first = fits[0]
    # shapes between the extreme bends in both directions, and the one with the largest error
    order = np.argsort(first.bend[..., 0].sum(axis=1))
    picked = order[np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int))]
    worst = int(np.argmax(first.rms))
    picked = [*(k for k in picked if k != worst), worst]
    drawn = []
    for k in picked:
        own = first.take(k)
        arc, points = own.curve(np.linspace(0.0, 1.0, 65))[0], own.measured[0]
        if first.dimensions == 3:  # each in the plane of the start of its own arc
            plane = _plane(own)
            arc, points = arc @ plane, points @ plane
        drawn.append((arc, points))
    # side by side along the axis of their smaller extent
    size = np.ptp(np.concatenate([points for _, points in drawn]), axis=0)
    beside = np.zeros(2)
    beside[np.argmin(size)] = 1.0
    place = 0.0
    for k, (arc, points) in zip(picked, drawn, strict=True):
        both = np.concatenate([arc, points]) @ beside
        shift = (place - both.min()) * beside
        place += float(np.ptp(both)) + 0.1
        style: dict[str, Any] = {"markerfacecolor": "none", "markersize": 3.5, "linestyle": "none"}
        shapes.plot(*(points + shift).T, color=LIGHT["ink"], marker="o", **style)
        shapes.plot(*(arc + shift).T, color=LIGHT["red" if k == worst else "blue"], linewidth=1.2)
    name = "arc" if first.pieces == 1 else f"{first.pieces} arcs"
    handles: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none"}
    shapes.plot([], [], color=LIGHT["ink"], label="points", **handles)
    shapes.plot([], [], color=LIGHT["blue"], label=f"best {name}")
    shapes.plot([], [], color=LIGHT["red"], label="where it fits least")
    shapes.set_aspect("equal", adjustable="datalim")
    labels = ["first axis", "second axis"]
    if first.dimensions == 3:
        labels = ["towards the bend", "along the start"]
    labels[int(np.argmax(beside))] += ", side by side"
    shapes.set(xlabel=f"{labels[0]} (lengths)", ylabel=f"{labels[1]}\n(lengths)")
    shapes.set_title(f"{source}; {len(picked)} of {len(first)} shapes", fontsize=8.5, pad=22)
    legend_above(shapes, 3)

    looks = (("blue", "-", "o"), ("red", "--", "s"), ("green", "-.", "^"), ("purple", ":", "d"))
    for i, fit in enumerate(fits):
        colour, line, marker = looks[i % len(looks)]
        where = fit.profile()
        label = "one arc" if fit.pieces == 1 else f"{fit.pieces} arcs"
        own_look: dict[str, Any] = {"color": LIGHT[colour], "linestyle": line}
        percent = 100.0 * where.fraction
        rms = f"{label}: RMS {in_percent(fit.rms.mean(), 3)}"
        error.plot(percent, where.mean * 100.0, marker=marker, label=rms, **own_look)
        error.plot(percent, where.maximum * 100.0, linewidth=0.8, **own_look)
        bending.plot(percent, where.bent_more, marker=marker, label=label, **own_look)
    error.set(ylabel="distance from the arc\n(% of length)")
    error.set_ylim(bottom=0.0)
    error.set_title("thick: mean over shapes, thin: largest", fontsize=8.5, pad=22)
    legend_above(error, 2)
    bending.axhline(0.0, color=LIGHT["muted"], linewidth=0.8)
    bending.set(
        ylabel="bent more than\nthe arc (rad/length)", xlabel="place (% of length from the base)"
    )
    return figure


def _plane(fit: ArcFit) -> Floats:
    """Axes (3, 2) of a shape's plane: towards the first bend of its arc, and along its start."""
    along, bend = fit.direction[0], fit.curvature_vector[0, 0]
    towards = bend if np.linalg.norm(bend) > 1e-9 else fit.frame[0, :, 0]
    return np.stack([towards / np.linalg.norm(towards), along], axis=1)
