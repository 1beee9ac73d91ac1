"""Shared parts of figures of results over the workspace."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.results import Result
from bowstring.robot.model import Robot
from bowstring.viz.style import LIGHT, write_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import PolyCollection
    from matplotlib.figure import Figure, SubFigure

CELLS: Final = 30
"""Hexagons along an axis."""
_NARROWEST: Final = 0.3  # least span of an axis over that of the other
_SHARE_OF_PLACE: Final = 0.02  # least span over the largest coordinate
_SHARES: Final = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1)  # shares of length


class Drawn(Result, ABC):
    """Result with a figure that can be saved."""

    content: ClassVar[str]
    """The figure in words, for errors."""

    @abstractmethod
    def figure(self) -> Figure:
        """Draw the figure."""

    def save(self, path: str | Path) -> Path:
        """Write the figure to a file (PNG, PDF or SVG), whole or not at all.

        Parameters
        ----------
        path : str or Path
            An earlier figure is replaced.

        Returns
        -------
        Path
            Absolute path of the file.
        """
        return write_figure(self.figure, path, self.content)


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
        gridsize=CELLS,
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


def _shades(name: str, count: int) -> list[tuple[float, ...]]:
    """Colours of one of matplotlib's maps, without its palest ones."""
    from matplotlib import colormaps

    dark_first = name.endswith("_r")
    places = np.linspace(0.05, 0.65, count) if dark_first else np.linspace(0.35, 0.95, count)
    return [tuple(colormaps[name](place)) for place in places]
