"""Shared parts of figures of maps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.formatting import significant
from bowstring.validity.axes import Axis, in_words
from bowstring.validity.effects import EFFECTS
from bowstring.validity.map_settings import Metric
from bowstring.viz.style import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.contour import ContourSet
    from matplotlib.patches import Patch

CAUSES: Final = {
    "straight_spans": "blue",
    "clamps": "amber",
    "hole_planes": "sky",
    "shear_extension": "ink",
    "torsion": "green",
    "gravity": "red",
    "tip_force": "purple",
    "friction": "yellow",
    "tendon_stretch": "blue",  # by displacement, where straight spans have no entry
}
_SHADE: Final = 0.35  # opacity of the colours of areas
_LABEL: Final = 0.05  # least distance of labels along x over the width


def colours_of_causes() -> dict[str, Any]:
    """Colours of areas by `CAUSES`, the last one by "": of no main cause."""
    from matplotlib.colors import to_rgba

    shades = {key: to_rgba(LIGHT[colour], _SHADE) for key, colour in CAUSES.items()}
    return {**shades, "": LIGHT["grid"]}


def handles_of_causes(present: set[str], examined: bool) -> list[Patch]:
    """Entries of the legend of the causes present, "" for none; `examined` are all of them."""
    from matplotlib.patches import Patch

    labels = {key: f"mainly {EFFECTS[key].label}" for key in CAUSES}
    labels[""] = "no single main cause" if examined else "no main cause found"
    colours = colours_of_causes()
    return [Patch(fc=colours[key], label=labels[key]) for key in labels if key in present]


def title_of(
    robot: str, metric: Metric, top: float, fixed: Sequence[tuple[Axis, float]] = ()
) -> str:
    """Title of a map; `top` is the end of the sweep in N."""
    end = f"{significant(top)} N"
    what = {
        "largest_error": f"largest tip error up to {end}",
        "mean_error": f"mean tip error up to {end}",
        "error": "tip error",
        "valid_to": "validity limit of constant curvature",
    }[metric]
    at = "".join(f", {in_words(axis, value)}" for axis, value in fixed)
    return f"{robot}: {what}{at} (simulated)"


def shade(panel: Axes, x: Floats, where: Bools, hatch: str, colour: str, label: str) -> None:
    """Hatch a curve around the points of `where`."""
    half = 0.5 * np.abs(np.diff(x)).mean()
    for i, at in enumerate(x[where]):
        panel.axvspan(
            at - half,
            at + half,
            facecolor="none",
            edgecolor=colour,
            hatch=hatch,
            lw=0.0,
            label=label if i == 0 else None,
        )


def hatch_region(panel: Axes, x: Floats, y: Floats, where: Floats, hatch: str) -> None:
    """Hatch the region of a grid in which `where` is 1."""
    if where.any():
        drawn = panel.contourf(x, y, where, levels=[0.5, 1.5], colors="none", hatches=[hatch])
        drawn.set_edgecolor(LIGHT["muted"])
        drawn.set_linewidth(0.0)


def apart(lines: ContourSet, x: Floats, y: Floats) -> list[float]:
    """Levels of the lines whose middles lie apart, so that their labels do."""
    size = np.array([x.max() - x.min(), y.max() - y.min()])
    places: list[Floats] = []
    out = []
    for level, path in zip(lines.levels, lines.get_paths(), strict=True):
        points = path.vertices / size
        if len(points) < 2:
            continue
        place = points[len(points) // 2]
        if all(np.abs(place - other)[0] > _LABEL for other in places):
            places.append(place)
            out.append(float(level))
    return out
