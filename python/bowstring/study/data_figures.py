"""Figures of a study with measurements and all models."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.formatting import in_percent
from bowstring.study.comparison import short
from bowstring.study.study import Study
from bowstring.viz.style import AXES, LIGHT, TINY, legend_above, log_ticks, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bowstring.study.data_validation import AgainstData

_MODEL_LOOKS: Final = {
    "cc_from_force": ("CC from force", "red", "x"),
    "cc_from_lengths": ("CC from lengths", "amber", "s"),
    "cc_calibrated": ("CC calibrated", "purple", "d"),
    "rod": ("rod as in the file", "green", "^"),
    "rod_calibrated": ("rod calibrated", "blue", "o"),
}
"""Models in the figures after Fig. 9 and 12 of the source study."""


def measured_tip(study: Study) -> Figure:
    """Draw the tip over load by axis: data, and models in their frame."""
    found = _data_of(study)
    loads = found.loads
    figure, panels = subplots(3, 7.4, sharex=True)
    for k, axes in enumerate(panels):
        _draw_models(axes, found, "tip_position", k)
        for up in (True, False):
            rows = (loads.loading == up) if loads.single else np.full(len(found.point), up)
            what = f"{found.data.source}, {'loading' if up else 'unloading'}"
            if rows.any():
                axes.plot(
                    loads.axis[rows],
                    found.point[rows, k] * 1e3,
                    "o",
                    markersize=3.5 if loads.single else 1.5,
                    color=LIGHT["ink"],
                    markerfacecolor=LIGHT["ink"] if up else "none",
                    label=what if loads.single else found.data.source,
                )
        bricks = None if study.bricks is None else study.bricks.measured_point
        if bricks is not None and loads.single and np.isfinite(bricks).any():
            look: dict[str, Any] = {"color": LIGHT["muted"], "markersize": 8}
            axes.plot(loads.axis, bricks[:, k] * 1e3, "+", label="finite elements", **look)
        axes.set(ylabel=f"tip {'xyz'[k]} (mm)")
        _room(axes, found.point[:, k] * 1e3)
    _title_and_legend(panels[0], f"{_label(found)}\n{_frame_said(found)}")
    panels[-1].set(xlabel=loads.label)
    return figure


def measured_errors(study: Study) -> Figure:
    """Draw models minus data over load."""
    found = _data_of(study)
    figure, panels = subplots(3, 7.0, sharex=True)
    for k, axes in enumerate(panels):
        _draw_models(axes, found, "difference", k, marked=found.loads.single)
        axes.axhline(0.0, color=LIGHT["muted"], linewidth=0.8)
        axes.set(ylabel=f"{'xyz'[k]}: model minus\n{found.data.source} (mm)")
        _room(axes, np.zeros(1))
    _title_and_legend(panels[0], f"{_label(found)}\n{_frame_said(found)}")
    panels[-1].set(xlabel=found.loads.label)
    return figure


def measured_comparison(study: Study) -> Figure:
    """Draw the mean error of every model with its interval, with and without registration."""
    found = _data_of(study)
    figure, (axes,) = subplots(1, 5.4)
    names = list(found.models)
    places = np.arange(len(names), dtype=float)[::-1]
    looks = (
        ("as_measured", "not registered", "red", "x", 0.2),
        ("calibrated", "registered, one frame", "blue", "o", 0.0),
        ("own", "registered, own frame", "green", "^", -0.2),
    )
    for kind, label, colour, marker, shift in looks:
        rows = [
            (place + shift, c)
            for name, place in zip(names, places, strict=True)
            for c in found.comparisons
            if (c.name, c.frame) == (name, kind) and c.n and c.intervals is not None
        ]
        if not rows:
            continue
        place = np.array([p for p, _ in rows])
        mean = np.maximum([c.mean for _, c in rows], TINY) * 1e3
        ends = np.maximum([c.intervals.mean for _, c in rows if c.intervals], TINY) * 1e3
        away = np.abs(ends.T - mean)
        style: dict[str, Any] = {"color": LIGHT[colour], "linestyle": "none"}
        axes.errorbar(mean, place, xerr=away, marker=marker, capsize=2.5, label=label, **style)
        largest = np.maximum([c.maximum for _, c in rows], TINY) * 1e3
        axes.plot(largest, place, marker="|", markersize=8, **style)
    axes.axvline(
        study.settings.tolerance * study.length * 1e3,
        color=LIGHT["amber"],
        linestyle=":",
        label=f"tolerance {in_percent(study.settings.tolerance, 3)}",
    )
    axes.set_xscale("log")
    log_ticks(axes.xaxis)
    axes.grid(axis="x", which="major")
    axes.set_yticks(places, [short(found.labels[name]) for name in names])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlabel(f"tip error against the {found.data.source} tip (mm):\nmean, 95 %, largest")
    one = study.length * 10.0  # mm in a percent

    def in_percents(mm: Any) -> Any:
        return mm / one

    def back(percents: Any) -> Any:
        return percents * one

    percent = axes.secondary_xaxis("top", functions=(in_percents, back))
    percent.set_xlabel(f"% of length; {_label(found)}", fontsize=8.5)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


def measured_angles(study: Study) -> Figure:
    """Draw the angle errors over load, by model."""
    found = study.angles
    assert found is not None
    figure, (axes,) = subplots(1, 3.6)
    for name, (label, colour, marker) in _MODEL_LOOKS.items():
        if name in found.models:
            error = np.degrees(found.comparison(name).error)
            style: dict[str, Any] = {"color": LIGHT[colour], "markersize": 3.5}
            axes.plot(found.loads.axis, error, marker, label=label, **style)
    axes.set(xlabel=found.loads.label, ylabel=f"angle to the {found.data.source} tip (deg)")
    axes.set_ylim(bottom=0.0)
    legend_above(axes, 3)
    return figure


def measured_parts(study: Study) -> Figure:
    """Draw the parts of the error of constant curvature on left-out rows."""
    from bowstring.calibration.figures import draw_parts

    found = _data_of(study)
    assert found.models_compared is not None
    return draw_parts(found.models_compared, _label(found))


def measured_residuals(study: Study) -> Figure:
    """Draw the residuals of the calibrated rod by row."""
    found = _data_of(study)
    figure, panels = subplots(3, 5.6, sharex=True)
    test = found.residuals
    assert test is not None
    wide = test.scatter if math.isfinite(test.scatter) else test.sigma
    difference = found.comparison("rod_calibrated").difference * 1e3
    row = np.arange(1, len(difference) + 1)
    up = found.loads.loading
    for k, (axes, (axis, colour, marker)) in enumerate(zip(panels, AXES, strict=True)):
        small = 3.5 if found.loads.single else 1.5
        style: dict[str, Any] = {"color": LIGHT[colour], "markersize": small}
        axes.plot(row, difference[:, k], color=LIGHT[colour], linewidth=0.5)
        for way in (True, False):
            face = LIGHT[colour] if way else "none"
            rows = (up == way) if found.loads.single else np.full(len(row), way)
            axes.plot(row[rows], difference[rows, k], marker, markerfacecolor=face, **style)
        if math.isfinite(wide):
            axes.axhspan(-2e3 * wide, 2e3 * wide, color=LIGHT["grid"], alpha=0.5, linewidth=0)
        axes.axhline(0.0, color=LIGHT["muted"], linewidth=0.8)
        axes.set(ylabel=f"{axis} (mm)")
    said = {True: "noise", False: "not noise", None: "not tested"}[test.is_noise]
    panels[0].set_title(f"{_label(found)}; {said}", fontsize=8.5)
    panels[-1].set(xlabel="row, in the order of the table")
    return figure


def _data_of(study: Study) -> AgainstData:
    assert study.data is not None
    return study.data


def _draw_models(axes: Axes, found: AgainstData, of: str, k: int, *, marked: bool = False) -> None:
    """Draw a coordinate of all models' tips or differences over load."""
    for name, (label, colour, marker) in _MODEL_LOOKS.items():
        if name not in found.models:
            continue
        values = getattr(found.comparison(name), of)
        for up in (True, False):
            axis, mean = _by_load(found, values, up)
            axes.plot(
                axis,
                mean[:, k] * 1e3,
                color=LIGHT[colour],
                linestyle="-" if up else ":",
                linewidth=1.2,
                marker=marker if marked else None,
                markersize=3.5,
                markerfacecolor=LIGHT[colour] if up else "none",
                label=label if up else None,
            )


def _by_load(found: AgainstData, values: Floats, up: bool) -> tuple[Floats, Floats]:
    """Means of repeats (n, 3) of loading or unloading over the abscissa (n,), in its order."""
    loads = found.loads
    if not loads.single:  # no means: all rows in their order
        return (loads.axis, values) if up else (np.zeros(0), np.zeros((0, 3)))
    rows = np.flatnonzero((loads.loading == up) & np.isfinite(values).all(axis=1))
    unit, first, place = np.unique(loads.unit[rows], return_index=True, return_inverse=True)
    means = np.zeros((len(unit), 3))
    np.add.at(means, place.ravel(), values[rows])
    axis = loads.axis[rows][first]
    order = np.argsort(axis, kind="stable")
    return axis[order], (means / np.bincount(place.ravel())[:, None])[order]


def _room(axes: Axes, values: Floats) -> None:
    """Set a range of at least 1 mm, so that noise out of the bending plane is not magnified."""
    low, high = axes.get_ylim()
    if high - low < 1.0:
        middle = float(np.nanmean(values))
        axes.set_ylim(middle - 0.5, middle + 0.5)


def _title_and_legend(axes: Axes, title: str) -> None:
    legend_above(axes, 2)
    rows = -(-len(axes.get_legend_handles_labels()[1]) // 2)
    axes.set_title(title, fontsize=8.5, pad=10 + 12 * rows)


def _frame_said(found: AgainstData) -> str:
    if not found.frame_by:
        return "tip not registered: no model gives a base frame"
    label = _MODEL_LOOKS.get(found.frame_by, (found.frame_by,))[0]
    return f"tip registered: in the base frame of {label}"


def _label(found: AgainstData) -> str:
    return found.label if len(found.label) <= 60 else found.label[:59] + "\N{HORIZONTAL ELLIPSIS}"
