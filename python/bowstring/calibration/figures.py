"""Figures of a calibration: residuals and parity."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.calibration.error_parts import PARTS
from bowstring.formatting import in_mm
from bowstring.viz.style import AXES, LIGHT, legend_above, subplots

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.calibration.model_comparison import ModelComparison
    from bowstring.calibration.table_fit import Calibration

_MANY: Final = 300  # rows
_LINE: Final = 13.5  # points; height of a line of the legend
#: Colour and hatch of each part of the error, in order.
_PARTS: Final = (
    ("blue", ""),
    ("sky", "///"),
    ("amber", ""),
    ("grid", "..."),
    ("muted", ""),
)


def draw_fit(calibration: Calibration) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Draw the residuals of a calibration by row and by load, and parity.

    Parameters
    ----------
    calibration : Calibration

    Yields
    ------
    stem : str
        ``residuals`` and ``parity``.
    draw : callable
        Makes the figure, to be called and saved within `figure_style`.
    """
    yield "residuals", partial(_residuals, calibration)
    yield "parity", partial(_parity, calibration)


def draw_parts(comparison: ModelComparison, data: str) -> Figure:
    """Draw the parts of the error of constant curvature as one stacked bar.

    Negative parts are stacked to the left of zero.

    Parameters
    ----------
    comparison : ModelComparison
    data : str
        Source and name of the data, for the title.

    Returns
    -------
    matplotlib.figure.Figure
        Figure, to be drawn and saved within `figure_style`.
    """
    parts = comparison.parts
    figure, (axes,) = subplots(1, 2.9)
    ends = {True: 0.0, False: 0.0}
    looks = dict(zip(PARTS, _PARTS, strict=True))
    for name, value in parts.known.items():
        colour, hatch = looks[name]
        axes.barh(
            0.0,
            1e3 * value,
            left=ends[value >= 0.0],
            color=LIGHT[colour],
            hatch=hatch,
            edgecolor=LIGHT["paper"],
            label=f"{parts.called(name)} {1e3 * value:.3g} mm",
        )
        ends[value >= 0.0] += 1e3 * value
    axes.axvline(0.0, color=LIGHT["ink"], linewidth=0.8)
    axes.axvline(1e3 * parts.total, color=LIGHT["ink"], linestyle=":", linewidth=1.2)
    axes.set(ylim=(-0.6, 0.6), yticks=[], xlabel="mean tip error of constant curvature (mm)")
    axes.grid(visible=False, axis="y")
    rows = "rows left out by folds" if comparison.on == "folds" else "rows of the validation table"
    title = f"{data}\n{in_mm(parts.total)} (dotted) over {parts.rows} {rows}"
    axes.set_title(title, fontsize=8.5, pad=6 + _LINE * len(parts.known))
    legend_above(axes, 1)
    return figure


def _residuals(calibration: Calibration) -> Figure:
    data, found, out = calibration.data, calibration.fit, calibration.held_out
    figure, panels = subplots(2, 5.4, sharey=True)
    by_tension = not np.isnan(data.tensions).all()
    given = data.tensions if by_tension else 1e3 * data.displacements
    # the largest command of a row; negative if all tendons are lengthened
    load = np.nanmax(np.where(np.isnan(given), -np.inf, given), axis=1)
    kind = (
        "largest tension of the row (N)" if by_tension else "largest displacement of the row (mm)"
    )
    labels = ("row, in the order of the table", kind)
    for axes, x, label in zip(panels, (np.arange(1, len(data) + 1), load), labels, strict=True):
        for k, (name, colour, marker) in enumerate(AXES):
            error = 1e3 * found.residuals[:, k]
            look: dict[str, Any] = {"color": LIGHT[colour], "marker": marker, "linestyle": "none"}
            axes.plot(x[~out], error[~out], markersize=3.0, label=name, **look)
            axes.plot(x[out], error[out], markersize=3.0, markerfacecolor="none", **look)
        axes.axhline(0.0, color=LIGHT["muted"], linewidth=0.8)
        if data.sigma is not None:
            wide = 2e3 * float(np.median(data.sigma))
            said: dict[str, Any] = {"color": LIGHT["amber"], "linestyle": ":", "linewidth": 1.2}
            axes.axhline(wide, label="2 x stated uncertainty", **said)
            axes.axhline(-wide, **said)
        axes.set(xlabel=label, ylabel="predicted less measured (mm)")
    if out.any():
        hollow: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none"}
        panels[0].plot([], [], color=LIGHT["ink"], label="held out", **hollow)
    panels[0].set_title(_title(calibration), fontsize=8.5, pad=34)
    legend_above(panels[0], 3)
    return figure


def _parity(calibration: Calibration) -> Figure:
    data, found, out = calibration.data, calibration.fit, calibration.held_out
    figure, (axes,) = subplots(1, 4.9)
    measured = 1e3 * data.tip
    before = measured + 1e3 * found.before
    after = 1e3 * calibration.predicted
    many = len(data) > _MANY  # with many rows marks overlap
    thin: dict[str, Any] = {"markersize": 2.0, "alpha": 0.35, "markeredgewidth": 0.4}
    size: dict[str, Any] = thin if many else {"markersize": 3.5}
    grey: dict[str, Any] = {"color": LIGHT["muted"], "linestyle": "none", "marker": "."}
    axes.plot(measured.ravel(), before.ravel(), label="before", **grey, **(thin if many else {}))
    for k, (name, colour, marker) in enumerate(AXES):
        look: dict[str, Any] = {"color": LIGHT[colour], "marker": marker, "linestyle": "none"}
        look |= size
        axes.plot(measured[~out, k], after[~out, k], label=f"{name} fitted", **look)
        axes.plot(measured[out, k], after[out, k], markerfacecolor="none", **look)
    ends = [np.nanmin(measured), np.nanmax(measured)]
    axes.plot(ends, ends, color=LIGHT["ink"], linewidth=0.8)
    axes.set(xlabel="measured coordinate (mm)", ylabel="predicted coordinate (mm)")
    axes.set_title(_title(calibration), fontsize=8.5, pad=20)
    legend_above(axes, 4)
    legend = axes.get_legend()
    for handle in legend.legend_handles if legend and many else ():
        handle.set(alpha=1.0, markersize=4.0)  # type: ignore[union-attr]
    return figure


def _title(calibration: Calibration) -> str:
    found = calibration.fit
    return (
        f"{calibration.data.source}: {calibration.data.name}; {found.robot.name}, {found.model}\n"
        f"RMSE {in_mm(found.score.rmse)}, before {in_mm(found.score_before.rmse)}"
    )
