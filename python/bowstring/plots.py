"""Figures of the study, after the source study's own.

matplotlib is imported by the first figure, not with the package. Figures are narrow, so that their
text stays readable on a phone. Colours are those of Okabe and Ito, which colour-blind readers tell
apart; markers and line styles differ too. In SVG every colour becomes a CSS variable, so that the
page that holds the figure can follow the reader's light or dark theme.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.actuation import COMMANDED, DriveBudget
from bowstring.bricks import plots as brick_plots
from bowstring.colours import COLOURS
from bowstring.comparison import Case, known_max
from bowstring.errors import InputError
from bowstring.robot import Robot
from bowstring.study import Study
from bowstring.words import in_mm

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bowstring.against_data import AgainstData
    from bowstring.calibration import Calibration
    from bowstring.oscillations import Modes
    from bowstring.shape import ArcFit

__all__ = ["backbone_shapes", "draw", "draw_fit", "draw_modes", "figure_style", "svg"]

Array = NDArray[np.float64]

_LIGHT: Final = {name: light for name, (light, _) in COLOURS.items()}
_WIDTH: Final = 4.6  # inches
_TINY: Final = 1e-6  # m; the floor of logarithmic axes


@contextmanager
def figure_style() -> Iterator[None]:
    """The look of all figures, for the time of a ``with`` block; also while they are saved."""
    import matplotlib as mpl

    ink, muted, grid = _LIGHT["ink"], _LIGHT["muted"], _LIGHT["grid"]
    with mpl.rc_context(
        {
            "font.size": 9.0,
            "axes.titlesize": 9.5,
            "axes.titlelocation": "left",
            "axes.labelsize": 9.0,
            "legend.fontsize": 8.5,
            "legend.frameon": False,
            "xtick.labelsize": 8.5,
            "ytick.labelsize": 8.5,
            "text.color": ink,
            "axes.labelcolor": ink,
            "axes.titlecolor": ink,
            "axes.edgecolor": muted,
            "xtick.color": muted,
            "ytick.color": muted,
            "xtick.labelcolor": ink,
            "ytick.labelcolor": ink,
            "grid.color": grid,
            "grid.linewidth": 0.6,
            "axes.grid": True,
            "axes.axisbelow": True,
            "axes.spines.top": False,
            "axes.spines.right": False,
            "lines.linewidth": 1.6,
            "lines.markersize": 4.5,
            "svg.fonttype": "none",
            "svg.hashsalt": "bowstring",
            "pdf.fonttype": 42,
        }
    ):
        yield


def draw(study: Study) -> Iterator[tuple[str, Figure]]:
    """Draw the figures one by one.

    Parameters
    ----------
    study : Study

    Yields
    ------
    stem : str
        File name without ending, from `bowstring.study.FIGURES`.
    figure : matplotlib.figure.Figure
        Draw and save within `figure_style`.
    """
    for shown in study.figures:
        yield shown.stem, _DRAWINGS[shown.stem](study)


def svg(stem: str, figure: Figure) -> str:
    """The figure as an SVG element for an HTML page.

    Parameters
    ----------
    stem : str
        Prefix of all ids, so that figures do not clash on one page.
    figure : matplotlib.figure.Figure

    Returns
    -------
    str
        ``<svg ...>``, its colours as ``var(--ink, #1b1f24)`` and so on, no background.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="', f'id="{stem}-', text)
    text = re.sub(r'href="#', f'href="#{stem}-', text)
    text = re.sub(r"url\(#", f"url(#{stem}-", text)
    for name, light in _LIGHT.items():
        text = text.replace(light, f"var(--{name}, {light})")
    # matplotlib's default marker edge and text colours are black
    text = re.sub(r"(stroke|fill): #000000", r"\1: var(--ink)", text)
    return re.sub(r'<svg [^>]*viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1">', text, count=1)


def draw_modes(modes: Modes) -> Iterator[tuple[str, Figure]]:
    """Draw mode shapes one by one, from the side and from the front.

    Parameters
    ----------
    modes : Modes

    Yields
    ------
    stem : str
        File name without ending, ``mode_01`` and so on.
    figure : matplotlib.figure.Figure
        Draw and save within `figure_style`.
    """
    for k in range(len(modes)):
        yield f"mode_{k + 1:0{max(2, len(str(len(modes))))}d}", _mode(modes, k)


def draw_fit(calibration: Calibration) -> Iterator[tuple[str, Figure]]:
    """Draw what a calibration leaves: by order of the rows and by load, and parity.

    Parameters
    ----------
    calibration : Calibration

    Yields
    ------
    stem : str
        ``residuals`` and ``parity``.
    figure : matplotlib.figure.Figure
        Draw and save within `figure_style`.
    """
    yield "residuals", _residuals(calibration)
    yield "parity", _parity(calibration)


def backbone_shapes(fits: Sequence[ArcFit], source: str) -> Figure:
    """Shapes with their best arcs, and where along the robot the arcs fail.

    Parameters
    ----------
    fits : sequence of bowstring.shape.ArcFit
        Fits of the same shapes with different numbers of pieces; the first is drawn beside the
        shapes.
    source : str
        What the shapes are and where they come from, such as ``"measured: NAME"`` or
        ``"synthetic"``; stands in the figure.

    Returns
    -------
    matplotlib.figure.Figure
        Draw and save within `figure_style`.
    """
    if not fits or len({(len(f), f.dimensions) for f in fits}) > 1:
        raise InputError("the figure needs fits of the same shapes, with one or more pieces")
    figure, (shapes, error, bending) = _subplots(3, 7.4, height_ratios=(3, 2, 2))
    first = fits[0]
    # from the most bent one way to the most bent the other, and the one that is least an arc
    order = np.argsort(first.bend[..., 0].sum(axis=1))
    picked = order[np.unique(np.linspace(0, len(order) - 1, 5).round().astype(int))]
    worst = int(np.argmax(first.rms))
    picked = [*(k for k in picked if k != worst), worst]
    drawn = []
    for k in picked:
        own = first.take(k)
        arc, points = own.curve(np.linspace(0.0, 1.0, 65))[0], own.measured[0]
        if first.dimensions == 3:  # each in the plane of its own arc's start
            plane = _plane(own)
            arc, points = arc @ plane, points @ plane
        drawn.append((arc, points))
    # side by side, along the axis in which they are narrow
    size = np.ptp(np.concatenate([points for _, points in drawn]), axis=0)
    beside = np.zeros(2)
    beside[np.argmin(size)] = 1.0
    place = 0.0
    for k, (arc, points) in zip(picked, drawn, strict=True):
        both = np.concatenate([arc, points]) @ beside
        shift = (place - both.min()) * beside
        place += float(np.ptp(both)) + 0.1
        style: dict[str, Any] = {"markerfacecolor": "none", "markersize": 3.5, "linestyle": "none"}
        shapes.plot(*(points + shift).T, color=_LIGHT["ink"], marker="o", **style)
        shapes.plot(*(arc + shift).T, color=_LIGHT["red" if k == worst else "blue"], linewidth=1.2)
    name = "arc" if first.pieces == 1 else f"{first.pieces} arcs"
    handles: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none"}
    shapes.plot([], [], color=_LIGHT["ink"], label="points", **handles)
    shapes.plot([], [], color=_LIGHT["blue"], label=f"best {name}")
    shapes.plot([], [], color=_LIGHT["red"], label="where it fits least")
    shapes.set_aspect("equal", adjustable="datalim")
    labels = ["first axis", "second axis"]
    if first.dimensions == 3:
        labels = ["towards the bend", "along the start"]
    labels[int(np.argmax(beside))] += ", side by side"
    shapes.set(xlabel=f"{labels[0]} (lengths)", ylabel=f"{labels[1]}\n(lengths)")
    shapes.set_title(f"{source}; {len(picked)} of {len(first)} shapes", fontsize=8.5, pad=22)
    _legend_above(shapes, 3)

    looks = (("blue", "-", "o"), ("red", "--", "s"), ("green", "-.", "^"), ("purple", ":", "d"))
    for i, fit in enumerate(fits):
        colour, line, marker = looks[i % len(looks)]
        where = fit.profile()
        label = "one arc" if fit.pieces == 1 else f"{fit.pieces} arcs"
        own_look: dict[str, Any] = {"color": _LIGHT[colour], "linestyle": line}
        percent = 100.0 * where.fraction
        rms = f"{label}: RMS {100.0 * fit.rms.mean():.3g} %"
        error.plot(percent, where.mean * 100.0, marker=marker, label=rms, **own_look)
        error.plot(percent, where.maximum * 100.0, linewidth=0.8, **own_look)
        bending.plot(percent, where.bent_more, marker=marker, label=label, **own_look)
    error.set(ylabel="distance from the arc\n(% of length)")
    error.set_ylim(bottom=0.0)
    error.set_title("thick: mean over shapes, thin: largest", fontsize=8.5, pad=22)
    _legend_above(error, 2)
    bending.axhline(0.0, color=_LIGHT["muted"], linewidth=0.8)
    bending.set(
        ylabel="bent more than\nthe arc (rad/length)", xlabel="place (% of length from the base)"
    )
    return figure


def _plane(fit: ArcFit) -> Array:
    """Two axes (3, 2): towards the first bend of a shape's arc, and along its start."""
    along, bend = fit.direction[0], fit.curvature_vector[0, 0]
    towards = bend if np.linalg.norm(bend) > 1e-9 else fit.frame[0, :, 0]
    return np.stack([towards / np.linalg.norm(towards), along], axis=1)


# -- the figures -------------------------------------------------------------------------------


def _subplots(rows: int, height: float, **options: Any) -> tuple[Figure, list[Axes]]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, height), layout="constrained")
    axes = figure.subplots(rows, 1, squeeze=False, **options)
    return figure, list(axes[:, 0])


def _legend_above(axes: Axes, columns: int) -> None:
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        handlelength=1.8,
        columnspacing=1.2,
    )


_AXES: Final = (("x", "blue", "o"), ("y", "green", "^"), ("z", "red", "s"))


def _tip_against_force(study: Study) -> Figure:
    figure, (tip, moved, stress, strain) = _subplots(
        4, 8.0, sharex=True, height_ratios=(3, 2, 2, 2)
    )
    s, force = study.statics, study.comparison("cc_from_force")
    motion = study.dynamics
    rising = motion.rising if motion else slice(0)
    still: dict[str, Any] = {"linestyle": "none", "markerfacecolor": "none"}

    def draw_on(
        axes: Axes, name: str, look: tuple[str, str, str], static: Array, over: Array
    ) -> None:
        """A line of dynamics and the markers of statics, or these joined where it is alone."""
        colour, marker, line = _LIGHT[look[0]], look[1], look[2]
        both: dict[str, Any] = {"color": colour, "linestyle": line, "marker": marker}
        if motion:
            axes.plot(motion.tension[rising], over[rising], color=colour, linestyle=line)
            axes.plot(s.tension, static, color=colour, marker=marker, **still)
            axes.plot([], [], label=name, markerfacecolor="none", **both)
        else:
            axes.plot(s.tension, static, label=name, **both)

    none = np.zeros((0, 3))
    for k, (name, colour, marker) in enumerate(_AXES):
        over = (motion.tip_position if motion else none)[:, k] * 1e3
        draw_on(tip, name, (colour, marker, "-"), s.tip_position[:, k] * 1e3, over)
        tip.plot(
            s.tension,
            force.tip_position[:, k] * 1e3,
            color=_LIGHT[colour],
            linestyle="none",
            marker="x",
            markersize=6,
        )
    cross: dict[str, Any] = {"linestyle": "none", "marker": "+", "markersize": 8}
    cross["color"] = _LIGHT["ink"]
    if study.bricks is not None:
        tip.plot(s.tension, study.bricks.tip_position * 1e3, **cross)
        tip.plot([], [], label="finite elements", **cross)
    tip.plot([], [], color=_LIGHT["ink"], linestyle="none", marker="x", label="CC from force")
    tip.set(ylabel="tip coordinate (mm)")
    _legend_above(tip, 4 if study.bricks is None else 3)
    how = "lines: dynamics, markers: statics" if motion else "statics"
    pad = 22 if study.bricks is None else 36  # above one row of the legend, or two
    tip.set_title(f"simulated; {how}", fontsize=8.5, loc="right", pad=pad)

    straight = s.tip_position[0] if s.converged[0] else np.array([0.0, 0.0, study.length])
    away = np.linalg.norm(s.tip_position - straight, axis=-1) * 1e3
    over = motion.displacement * 1e3 if motion else none
    draw_on(moved, "", ("ink", "o", "-"), away, over)
    moved.set(ylabel="displacement\nof the tip (mm)")

    at, run = s.surface, motion.surface if motion else s.surface
    von_mises, normal = ("blue", "o", "-"), ("red", "x", "--")
    draw_on(stress, "von Mises", von_mises, at.von_mises / 1e6, run.von_mises / 1e6)
    draw_on(stress, "along the backbone", normal, at.normal_stress / 1e6, run.normal_stress / 1e6)
    if study.bricks is not None:
        bent = np.linalg.norm(study.bricks.tip_position - straight, axis=-1)
        moved.plot(s.tension, bent * 1e3, **{**cross, "color": _LIGHT["green"]})
        largest = study.bricks.beside.middle.max(axis=1, initial=0.0) / 1e6
        name = "finite elements, mid-module"
        stress.plot(s.tension[: len(largest)], largest, label=name, **cross)
    stress.set(ylabel="largest stress\n(MPa)")
    stress.legend(loc="upper left")
    draw_on(strain, "", ("purple", "d", "-"), at.strain * 100, run.strain * 100)
    strain.set(ylabel="largest strain\n(%)", xlabel=_force_label(study))
    return figure


def _over_time(study: Study) -> Figure:
    motion = study.dynamics
    assert motion is not None
    figure, (pull, tip, apart) = _subplots(3, 6.4, sharex=True, height_ratios=(2, 4, 2))
    time = motion.time
    pull.plot(time, motion.tension, color=_LIGHT["ink"])
    pull.set(ylabel=f"tension of\ntendon {study.settings.tendon + 1} (N)")
    pull.set_title("simulated", fontsize=8.5, loc="right")
    for k, (name, colour, _) in enumerate(_AXES):
        tip.plot(time, motion.tip_position[:, k] * 1e3, color=_LIGHT[colour], label=name)
        tip.plot(time, motion.static_tip[:, k] * 1e3, color=_LIGHT[colour], linestyle="--", lw=1.0)
    tip.plot([], [], color=_LIGHT["ink"], linestyle="--", lw=1.0, label="statics")
    tip.set(ylabel="tip coordinate (mm)")
    _legend_above(tip, 4)
    apart.plot(time, motion.difference * 1e3, color=_LIGHT["purple"])
    apart.set(ylabel="dynamics from\nstatics (mm)", xlabel="time (s)")
    apart.set_ylim(0.0, 1.3 * max(known_max(motion.difference) * 1e3, _TINY))
    if motion.peak is not None:
        when, size = motion.peak
        for axes in (tip, apart):
            axes.axvline(when, color=_LIGHT["amber"], linestyle=":", linewidth=1.2)
        left = when > 0.5 * time[-1]
        apart.annotate(
            f"overshoot {in_mm(size)}",
            (when, 0.98),
            xycoords=("data", "axes fraction"),
            xytext=(-4 if left else 4, 0),
            textcoords="offset points",
            ha="right" if left else "left",
            va="top",
            fontsize=8.5,
        )
    return figure


def _pull_against_force(study: Study) -> Figure:
    figure, (axes, below) = _subplots(2, 4.0, sharex=True, height_ratios=(2, 1))
    s = study.statics
    axes.plot(s.tension, s.pull * 1e3, color=_LIGHT["blue"], marker="o", label="statics")
    axes.plot(
        s.tension, s.linear_pull * 1e3, color=_LIGHT["red"], linestyle="--", label="linear law"
    )
    axes.set(ylabel="pull (mm)")
    _legend_above(axes, 2)
    below.plot(s.tension, (s.linear_pull - s.pull) * 1e3, color=_LIGHT["purple"], marker="d")
    below.set(xlabel=_force_label(study), ylabel="linear law\nminus statics (mm)")
    return figure


def _tip_against_pull(study: Study) -> Figure:
    figure, (axes,) = _subplots(1, 3.0)
    g = study.geometry
    for k, (name, colour, marker) in enumerate(_AXES):
        axes.plot(
            g.pull * 1e3,
            g.tip_position[:, k] * 1e3,
            color=_LIGHT[colour],
            marker=marker,
            label=name,
        )
    axes.set(
        xlabel=f"shortening of tendon {study.settings.tendon + 1} (mm)",
        ylabel="tip coordinate (mm)",
    )
    _legend_above(axes, 3)
    return figure


def _configurations(study: Study) -> Figure:
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    figure = Figure(figsize=(_WIDTH, 4.8))
    axes: Any = figure.add_axes((0.02, 0.0, 0.9, 0.9), projection="3d")
    g, robot = study.geometry, study.robot
    known = np.flatnonzero(np.all(np.isfinite(g.tip_position), axis=-1))
    shown = known[np.unique(np.linspace(0, len(known) - 1, 5).round().astype(int))]

    turn = np.linspace(0.0, math.tau, 33)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    holes = np.column_stack([robot.tendons.hole_m, np.zeros(len(robot.tendons.hole_m))])
    pulled = study.settings.tendon
    points = []
    for i in shown:
        centres = np.concatenate([np.zeros((1, 3)), g.disk_positions[i]]) * 1e3
        frames = np.concatenate([np.eye(3)[None], g.disk_rotations[i]])
        radii = np.concatenate([robot.disks.radius_m[:1], robot.disks.radius_m]) * 1e3
        every = max(1, len(centres) // 60)
        rings = [
            centre + radius * rim @ frame.T
            for centre, frame, radius in zip(
                centres[::every], frames[::every], radii[::every], strict=True
            )
        ]
        disks = Poly3DCollection(
            rings,
            facecolors=_LIGHT["grid"],
            edgecolors=_LIGHT["muted"],
            linewidths=0.6,
            alpha=0.55,  # a disk is seen through
        )
        axes.add_collection3d(disks)
        for t, hole in enumerate(holes):
            last = int(robot.tendons.end_disk[t]) + 2
            path = centres[:last] + frames[:last] @ (hole * 1e3)
            colour, width = ("red", 1.2) if t == pulled else ("blue", 0.8)
            axes.plot(*path.T, color=_LIGHT[colour], linewidth=width)
        backbone = g.backbone[i] * 1e3
        axes.plot(*backbone.T, color=_LIGHT["ink"], linewidth=2.0)
        points += rings
        beyond = backbone[-1] + frames[-1][:, 2] * 0.06 * study.length * 1e3
        axes.text(*beyond, f"{g.pull[i] * 1e3:.3g}", fontsize=8.5, ha="center", va="center")
    _fit_box(axes, np.concatenate(points))
    # the bending plane is seen nearly from the front
    azimuth = math.degrees(float(robot.tendons.angle_rad[pulled])) - 65.0
    axes.view_init(elev=20.0, azim=azimuth)
    for colour, label in (("ink", "backbone"), ("red", "pulled tendon"), ("blue", "other tendons")):
        axes.plot([], [], [], color=_LIGHT[colour], label=label)
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    figure.legend(loc="upper left", ncols=3, handlelength=1.4, columnspacing=1.0)
    figure.text(0.02, 0.9, "number at each tip: pull in mm", fontsize=8.5)
    return figure


def _fit_box(axes: Any, points: Array) -> None:
    """Equal scales along all axes, the box as tight as the robot."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, size = 0.5 * (low + high), high - low
    size = np.maximum(size, 0.25 * size.max())
    for axis, centre, extent in zip("xyz", middle, size, strict=True):
        getattr(axes, f"set_{axis}lim")(centre - 0.52 * extent, centre + 0.52 * extent)
        getattr(axes, f"{axis}axis").set_pane_color((0.0, 0.0, 0.0, 0.0))
        if extent < 0.4 * size.max() and low["xyz".index(axis)] < 0.0:
            getattr(axes, f"set_{axis}ticks")([0.0])  # no room for more
        else:
            axes.locator_params(axis=axis, nbins=5)
    axes.set_box_aspect(tuple(size), zoom=0.8)


def _overlay(study: Study) -> Figure:
    figure, (axes,) = _subplots(1, 3.6)
    hole = study.robot.tendons.hole_m[study.settings.tendon]
    towards = hole / np.linalg.norm(hole)

    def path(tip: Array) -> Array:
        return np.stack([tip[:, :2] @ towards, tip[:, 2]]) * 1e3

    physics = path(study.statics.tip_position)
    lengths = path(study.comparison("cc_from_lengths").tip_position)
    force = path(study.comparison("cc_from_force").tip_position)

    def draw_on(axes: Axes) -> None:
        axes.plot(*physics, label="statics", color=_LIGHT["ink"], marker="o", markersize=3.5)
        blue: dict[str, Any] = {"linestyle": "none", "color": _LIGHT["blue"], "marker": "s"}
        axes.plot(*lengths, label="CC from lengths", markerfacecolor="none", markersize=8, **blue)
        red: dict[str, Any] = {"linestyle": "--", "color": _LIGHT["red"], "marker": "x"}
        axes.plot(*force, label="CC from force", linewidth=1.0, markersize=6, **red)
        if study.bricks is not None:
            bricks = path(study.bricks.tip_position)
            green: dict[str, Any] = {"linestyle": "none", "color": _LIGHT["green"], "marker": "+"}
            axes.plot(*bricks, label="finite elements", markersize=9, **green)

    draw_on(axes)
    direction = "x" if abs(towards[1]) < 1e-9 and towards[0] > 0 else "towards the pulled tendon"
    axes.set(xlabel=f"tip, {direction} (mm)", ylabel="tip, z (mm)")
    axes.set_aspect("equal", adjustable="datalim")
    _legend_above(axes, 3 if study.bricks is None else 2)

    # the last loads large, in the corner that a bent robot leaves free
    ends = np.concatenate(
        [p[:, np.all(np.isfinite(p), axis=0)][:, -2:] for p in (physics, force)], 1
    )
    reach = float(np.ptp(ends, axis=1).max()) if ends.size else 0.0
    if reach > 0.0:
        inset = axes.inset_axes((0.03, 0.03, 0.5, 0.6))
        draw_on(inset)
        x, z = 0.5 * (ends.min(axis=1) + ends.max(axis=1))
        inset.set(xlim=(x - 0.8 * reach, x + 0.8 * reach), ylim=(z - 0.8 * reach, z + 0.8 * reach))
        inset.set(xticks=[], yticks=[], aspect="equal")
        inset.spines[:].set_visible(True)
        inset.set_title("the last loads, magnified", fontsize=8, pad=3)
        axes.indicate_inset_zoom(inset, edgecolor=_LIGHT["muted"])
    return figure


def _errors(study: Study) -> Figure:
    figure, panels = _subplots(2, 5.2, sharex=True)
    tension = study.statics.tension
    titles = ("CC from lengths (Eq. 5)", "CC from force (linear law)")
    for axes, name, title in zip(panels, ("cc_from_lengths", "cc_from_force"), titles, strict=True):
        comparison = study.comparison(name)
        for k, (axis, colour, marker) in enumerate(_AXES):
            axes.plot(
                tension,
                comparison.difference[:, k] * 1e3,
                color=_LIGHT[colour],
                marker=marker,
                label=axis,
            )
        axes.plot(
            study.verdict.fine_tension,
            study.verdict.fine_error[name] * 1e3,
            color=_LIGHT["ink"],
            label="Euclidean",
        )
        if study.bricks is not None:
            axes.plot(
                tension,
                study.comparison(name, "fe").error * 1e3,
                color=_LIGHT["green"],
                linestyle="none",
                marker="+",
                label="Euclidean, from finite elements",
            )
        limit = study.verdict.tolerance_length * 1e3
        largest = np.nanmax(comparison.error, initial=0.0) * 1e3
        if largest > 0.3 * limit:
            axes.axhline(
                limit, color=_LIGHT["amber"], linestyle=":", label=f"tolerance {limit:.3g}"
            )
        else:
            title += f"; tolerance {limit:.3g} mm is above"
        axes.set(ylabel="CC minus statics (mm)")
        axes.set_title(title)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    panels[-1].set(xlabel=_force_label(study))
    return figure


def _error_budget(study: Study) -> Figure:
    budget = study.budget
    drive = budget.drive
    count = len(budget.rows)
    figure, (*panels, driven) = _subplots(3, 8.6, height_ratios=(count, count, len(drive.rows) + 3))
    labels = [row.label.replace(", not a continuous tendon", "") for row in budget.rows]
    labels = [re.sub(r" \(.*\)", "", label) for label in labels]
    places = np.arange(len(labels))[::-1]
    sides = (
        ("Added alone to the plainest physics", [row.added for row in budget.rows], None),
        (
            "Removed alone from the fullest (dashed)",
            [row.removed for row in budget.rows],
            budget.fullest,
        ),
    )
    series = (
        ("cc_from_lengths", "CC from lengths", "blue", "s", 0.14),
        ("cc_from_force", "CC from force", "red", "o", -0.14),
    )
    for axes, (title, cases, whole) in zip(panels, sides, strict=True):
        for name, label, colour, marker, shift in series:
            means = np.array([_mean_of(case, name) for case in cases])
            axes.plot(
                np.maximum(means, _TINY) * 1e3,
                places + shift,
                linestyle="none",
                color=_LIGHT[colour],
                marker=marker,
                markersize=5.5,
                label=label,
            )
            if whole is not None and math.isfinite(_mean_of(whole, name)):
                axes.axvline(
                    max(_mean_of(whole, name), _TINY) * 1e3,
                    color=_LIGHT[colour],
                    linewidth=1.0,
                    linestyle="--",
                )
        for case, place in zip(cases, places, strict=True):
            if not math.isfinite(_mean_of(case, "cc_from_force")):
                axes.annotate(
                    "no equilibrium",
                    (0.5, place),
                    xycoords=("axes fraction", "data"),
                    ha="center",
                    va="center",
                    fontsize=8,
                    color=_LIGHT["muted"],
                )
        if whole is None:
            axes.set_xscale("log")
            low, high = axes.get_xlim()
            axes.set_xlim(low, max(high, 10.0 * low))
        else:
            axes.set_xlim(left=0.0)
        axes.set_yticks(places, labels)
        axes.set_ylim(-0.6, len(labels) - 0.4)
        axes.set_title(title)
        axes.grid(axis="x", which="major")
        axes.set_xlabel("mean error of CC (mm)")
    left, _ = panels[0].get_xlim()
    if left <= _TINY * 1e3:
        panels[0].set_xlabel("mean error of CC (mm)\n(0.001 or less at the left)")
    _drive_panel(
        driven, drive, (*series, (COMMANDED, "CC from commanded lengths", "green", "^", 0))
    )
    handles, names = driven.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper left", ncols=2)
    return figure


def _drive_panel(
    axes: Axes, drive: DriveBudget, series: tuple[tuple[str, str, str, str, float], ...]
) -> None:
    by_tension = [("no friction (this sweep)", drive.tension_driven)]
    by_pull = [("pulled, no stretch or friction", drive.pull_driven)]
    for row in drive.rows:
        rows = by_tension if row.driven_by == "tension" else by_pull
        label = row.short_label.removeprefix("pulled, ")
        if label.startswith("elastic, "):
            label = re.sub(r"(?<=friction) [^,]*", "", label)  # said above
        rows.append((label, row.case))
    cases = [*by_tension, *by_pull]
    places = np.arange(len(cases), dtype=float)[::-1]
    places[: len(by_tension)] += 0.4  # a gap between the two ways to drive
    for name, label, colour, marker, shift in series:
        known = [
            (_mean_of(case, name) * 1e3, place + shift)
            for (_, case), place in zip(cases, places, strict=True)
            if name in case.comparisons
        ]
        axes.plot(
            *np.array(known).T,
            linestyle="none",
            color=_LIGHT[colour],
            marker=marker,
            markersize=5.5,
            label=label,
        )
    axes.set_yticks(places, [label for label, _ in cases])
    axes.set_ylim(-0.6, len(cases))
    axes.set_xlim(left=0.0)
    axes.set_title("How the robot is driven")
    axes.grid(axis="x", which="major")
    assumed = f"\n(assumed: {', '.join(drive.assumptions)})" if drive.assumptions else ""
    axes.set_xlabel("mean error of CC (mm)" + assumed)


def _hysteresis(study: Study) -> Figure:
    drive = study.budget.drive
    figure, panels = _subplots(2, 5.6)
    number = study.settings.tendon + 1
    for axes, loop in zip(panels, drive.loops, strict=True):
        by_tension = loop.driven_by == "tension"
        onward = np.gradient(loop.constant_curvature, axis=0)
        onward /= np.linalg.norm(onward, axis=1, keepdims=True)
        command = loop.command * (1.0 if by_tension else 1e3)
        for way, label, colour, line in (
            (loop.free, "no friction" if by_tension else "no friction, no stretch", "ink", ":"),
            (loop.loading, "loading", "blue", "-"),
            (loop.unloading, "unloading", "red", "--"),
        ):
            ahead = np.sum((way - loop.constant_curvature) * onward, axis=1) * 1e3
            axes.plot(command, ahead, color=_LIGHT[colour], linestyle=line, label=label)
        axes.axhline(0.0, color=_LIGHT["muted"], linewidth=0.8)
        wide = f"up to {in_mm(loop.width)} apart" if math.isfinite(loop.width) else "no numbers"
        axes.set_title(f"driven by {'tension' if by_tension else 'pulled lengths'}; {wide}")
        law = "force" if by_tension else "commanded lengths"
        axes.set(ylabel=f"tip ahead of\nCC from {law} (mm)")
        axes.set_xlabel(_force_label(study) if by_tension else f"pull of tendon {number} (mm)")
        axes.legend(loc="best")
    return figure


_MANY: Final = 300  # rows


def _residuals(calibration: Calibration) -> Figure:
    data, found, out = calibration.data, calibration.fit, calibration.held_out
    figure, panels = _subplots(2, 5.4, sharey=True)
    by_tension = not np.isnan(data.tensions).all()
    given = data.tensions if by_tension else 1e3 * data.pulls
    # the largest command of a row; all tendons paid out is negative
    load = np.nanmax(np.where(np.isnan(given), -np.inf, given), axis=1)
    kind = "largest tension of the row (N)" if by_tension else "largest pull of the row (mm)"
    labels = ("row, in the order of the table", kind)
    for axes, x, label in zip(panels, (np.arange(1, len(data) + 1), load), labels, strict=True):
        for k, (name, colour, marker) in enumerate(_AXES):
            error = 1e3 * found.residuals[:, k]
            look: dict[str, Any] = {"color": _LIGHT[colour], "marker": marker, "linestyle": "none"}
            axes.plot(x[~out], error[~out], markersize=3.0, label=name, **look)
            axes.plot(x[out], error[out], markersize=3.0, markerfacecolor="none", **look)
        axes.axhline(0.0, color=_LIGHT["muted"], linewidth=0.8)
        if data.sigma is not None:
            wide = 2e3 * float(np.median(data.sigma))
            said: dict[str, Any] = {"color": _LIGHT["amber"], "linestyle": ":", "linewidth": 1.2}
            axes.axhline(wide, label="2 x stated uncertainty", **said)
            axes.axhline(-wide, **said)
        axes.set(xlabel=label, ylabel="predicted less measured (mm)")
    if out.any():
        hollow: dict[str, Any] = {"linestyle": "none", "marker": "o", "markerfacecolor": "none"}
        panels[0].plot([], [], color=_LIGHT["ink"], label="held out", **hollow)
    panels[0].set_title(_said_of(calibration), fontsize=8.5, pad=34)
    _legend_above(panels[0], 3)
    return figure


def _parity(calibration: Calibration) -> Figure:
    data, found, out = calibration.data, calibration.fit, calibration.held_out
    figure, (axes,) = _subplots(1, 4.9)
    measured = 1e3 * data.tip
    before = measured + 1e3 * found.before
    after = 1e3 * calibration.predicted
    many = len(data) > _MANY  # then marks cover each other
    thin: dict[str, Any] = {"markersize": 2.0, "alpha": 0.35, "markeredgewidth": 0.4}
    size: dict[str, Any] = thin if many else {"markersize": 3.5}
    grey: dict[str, Any] = {"color": _LIGHT["muted"], "linestyle": "none", "marker": "."}
    axes.plot(measured.ravel(), before.ravel(), label="before", **grey, **(thin if many else {}))
    for k, (name, colour, marker) in enumerate(_AXES):
        look: dict[str, Any] = {"color": _LIGHT[colour], "marker": marker, "linestyle": "none"}
        look |= size
        axes.plot(measured[~out, k], after[~out, k], label=f"{name} fitted", **look)
        axes.plot(measured[out, k], after[out, k], markerfacecolor="none", **look)
    ends = [np.nanmin(measured), np.nanmax(measured)]
    axes.plot(ends, ends, color=_LIGHT["ink"], linewidth=0.8)
    axes.set(xlabel="measured coordinate (mm)", ylabel="predicted coordinate (mm)")
    axes.set_title(_said_of(calibration), fontsize=8.5, pad=20)
    _legend_above(axes, 4)
    legend = axes.get_legend()
    for handle in legend.legend_handles if legend and many else ():
        handle.set(alpha=1.0, markersize=4.0)  # type: ignore[union-attr]
    return figure


def _said_of(calibration: Calibration) -> str:
    found = calibration.fit
    return (
        f"{calibration.data.source}: {calibration.data.name}; {found.robot.name}, {found.model}\n"
        f"RMSE {in_mm(found.score.rmse)}, before {in_mm(found.score_before.rmse)}"
    )


# -- against measurements ----------------------------------------------------------------------


_MODEL_LOOKS: Final = {
    "cc_from_force": ("CC from force", "red", "x"),
    "cc_from_lengths": ("CC from lengths", "amber", "s"),
    "cc_calibrated": ("CC calibrated", "purple", "d"),
    "rod": ("rod as in the file", "green", "^"),
    "rod_calibrated": ("rod calibrated", "blue", "o"),
}
"""Models that the figures of Fig. 9 and 10 show."""


def _data_of(study: Study) -> AgainstData:
    assert study.data is not None
    return study.data


def _by_load(found: AgainstData, values: Array, up: bool) -> tuple[Array, Array]:
    """Means of repeats against the axis: (n,) and (n, 3), one way, in the order of the axis."""
    loads = found.loads
    if not loads.single:  # all as they stand, once
        return (loads.axis, values) if up else (np.zeros(0), np.zeros((0, 3)))
    rows = np.flatnonzero((loads.loading == up) & np.isfinite(values).all(axis=1))
    unit, first, place = np.unique(loads.unit[rows], return_index=True, return_inverse=True)
    means = np.zeros((len(unit), 3))
    np.add.at(means, place.ravel(), values[rows])
    axis = loads.axis[rows][first]
    order = np.argsort(axis, kind="stable")
    return axis[order], (means / np.bincount(place.ravel())[:, None])[order]


def _measured_tip(study: Study) -> Figure:
    found = _data_of(study)
    loads = found.loads
    figure, panels = _subplots(3, 7.4, sharex=True)
    shown = [name for name in _MODEL_LOOKS if name in found.models]
    for k, axes in enumerate(panels):
        for name in shown:
            label, colour, _ = _MODEL_LOOKS[name]
            model = found.comparison(name).tip_position
            for up in (True, False):
                axis, tip = _by_load(found, model, up)
                axes.plot(
                    axis,
                    tip[:, k] * 1e3,
                    color=_LIGHT[colour],
                    linestyle="-" if up else ":",
                    linewidth=1.2,
                    label=label if up else None,
                )
        for up in (True, False):
            rows = (loads.loading == up) if loads.single else np.full(len(found.point), up)
            what = f"{found.data.source}, {'loading' if up else 'unloading'}"
            if rows.any():
                axes.plot(
                    loads.axis[rows],
                    found.point[rows, k] * 1e3,
                    linestyle="none",
                    marker="o",
                    markersize=3.5 if loads.single else 1.5,
                    color=_LIGHT["ink"],
                    markerfacecolor=_LIGHT["ink"] if up else "none",
                    label=what if loads.single else found.data.source,
                )
        bricks = None if study.bricks is None else study.bricks.measured_point
        if bricks is not None and loads.single and np.isfinite(bricks).any():
            axes.plot(
                loads.axis,
                bricks[:, k] * 1e3,
                linestyle="none",
                marker="+",
                markersize=8,
                color=_LIGHT["muted"],
                label="finite elements",
            )
        axes.set(ylabel=f"tip {'xyz'[k]} (mm)")
        _room(axes, found.point[:, k] * 1e3)
    _title_and_legend(panels[0], f"{_label(found)}\n{_frame_said(found)}")
    panels[-1].set(xlabel=loads.label)
    return figure


def _room(axes: Axes, values: Array) -> None:
    """At least 1 mm, so that noise across the bending plane is not blown up to a course."""
    low, high = axes.get_ylim()
    if high - low < 1.0:
        middle = float(np.nanmean(values))
        axes.set_ylim(middle - 0.5, middle + 0.5)


def _title_and_legend(axes: Axes, title: str) -> None:
    _legend_above(axes, 2)
    rows = -(-len(axes.get_legend_handles_labels()[1]) // 2)
    axes.set_title(title, fontsize=8.5, pad=10 + 12 * rows)


def _frame_said(found: AgainstData) -> str:
    if not found.frame_by:
        return "tip not registered: no model gives a base frame"
    label = _MODEL_LOOKS.get(found.frame_by, (found.frame_by,))[0]
    return f"tip registered: in the base frame of {label}"


def _label(found: AgainstData) -> str:
    text = found.label if len(found.label) <= 60 else found.label[:59] + "\N{HORIZONTAL ELLIPSIS}"
    return text.replace("$", r"\$")


def _measured_errors(study: Study) -> Figure:
    found = _data_of(study)
    figure, panels = _subplots(3, 7.0, sharex=True)
    for k, axes in enumerate(panels):
        for name, (label, colour, marker) in _MODEL_LOOKS.items():
            if name not in found.models:
                continue
            difference = found.comparison(name).difference
            for up in (True, False):
                axis, mean = _by_load(found, difference, up)
                axes.plot(
                    axis,
                    mean[:, k] * 1e3,
                    color=_LIGHT[colour],
                    linestyle="-" if up else ":",
                    linewidth=1.2,
                    marker=marker if found.loads.single else None,
                    markersize=3.5,
                    markerfacecolor=_LIGHT[colour] if up else "none",
                    label=label if up else None,
                )
        axes.axhline(0.0, color=_LIGHT["muted"], linewidth=0.8)
        axes.set(ylabel=f"{'xyz'[k]}: model minus\n{found.data.source} (mm)")
        _room(axes, np.zeros(1))
    _title_and_legend(panels[0], f"{_label(found)}\n{_frame_said(found)}")
    panels[-1].set(xlabel=found.loads.label)
    return figure


def _measured_comparison(study: Study) -> Figure:
    from bowstring.against_data import DATA_MODELS

    found = _data_of(study)
    figure, (axes,) = _subplots(1, 5.4)
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
        mean = np.maximum([c.mean for _, c in rows], _TINY) * 1e3
        ends = np.maximum([c.intervals.mean for _, c in rows if c.intervals], _TINY) * 1e3
        away = np.abs(ends.T - mean)
        style: dict[str, Any] = {"color": _LIGHT[colour], "linestyle": "none"}
        axes.errorbar(mean, place, xerr=away, marker=marker, capsize=2.5, label=label, **style)
        largest = np.maximum([c.maximum for _, c in rows], _TINY) * 1e3
        axes.plot(largest, place, marker="|", markersize=8, **style)
    axes.axvline(
        study.settings.tolerance * study.length * 1e3,
        color=_LIGHT["amber"],
        linestyle=":",
        label=f"tolerance {study.settings.tolerance * 100:.3g} %",
    )
    axes.set_xscale("log")
    axes.grid(axis="x", which="major")
    labels = [re.sub(r" \(.*\)|, as the robot", "", DATA_MODELS[name]) for name in names]
    axes.set_yticks(places, [label.replace(" file has it", " as in the file") for label in labels])
    axes.set_ylim(-0.6, len(names) - 0.4)
    axes.set_xlabel(f"tip error against the {found.data.source} tip (mm):\nmean, 95 %, largest")
    one = study.length * 10.0  # mm in a percent

    def in_percents(mm: Any) -> Any:
        return mm / one

    def back(percents: Any) -> Any:
        return percents * one

    percent = axes.secondary_xaxis("top", functions=(in_percents, back))
    percent.set_xlabel(f"% of length; {_label(found)}", fontsize=8.5)
    handles, texts = axes.get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside upper left", ncols=2)
    return figure


def _measured_residuals(study: Study) -> Figure:
    found = _data_of(study)
    figure, panels = _subplots(3, 5.6, sharex=True)
    test = found.residuals
    assert test is not None
    wide = test.scatter if math.isfinite(test.scatter) else test.sigma
    difference = found.comparison("rod_calibrated").difference * 1e3
    row = np.arange(1, len(difference) + 1)
    up = found.loads.loading
    for k, (axes, (axis, colour, marker)) in enumerate(zip(panels, _AXES, strict=True)):
        small = 3.5 if found.loads.single else 1.5
        style: dict[str, Any] = {"color": _LIGHT[colour], "marker": marker, "markersize": small}
        axes.plot(row, difference[:, k], color=_LIGHT[colour], linewidth=0.5)
        for way in (True, False):
            face = _LIGHT[colour] if way else "none"
            rows = (up == way) if found.loads.single else np.full(len(row), way)
            axes.plot(
                row[rows], difference[rows, k], linestyle="none", markerfacecolor=face, **style
            )
        if math.isfinite(wide):
            axes.axhspan(-2e3 * wide, 2e3 * wide, color=_LIGHT["grid"], alpha=0.5, linewidth=0)
        axes.axhline(0.0, color=_LIGHT["muted"], linewidth=0.8)
        axes.set(ylabel=f"{axis} (mm)")
    said = {True: "noise", False: "not noise", None: "not tested"}[test.is_noise]
    panels[0].set_title(f"{_label(found)}; {said}", fontsize=8.5)
    panels[-1].set(xlabel="row, in the order of the table")
    return figure


_SWAY: Final = 0.12  # largest displacement of a mode as drawn, of the length
_TURN: Final = {"bending": 0.6, "torsion": 1.2, "axial": 0.6}  # rad; largest rotation as drawn


def _mode(modes: Modes, k: int) -> Figure:
    from matplotlib.figure import Figure

    robot = modes.robot
    shift, turn = modes.displacement[k], modes.rotation[k]
    size = float(np.linalg.norm(shift, axis=1).max())
    spin = float(np.linalg.norm(turn, axis=1).max())
    scale = min(
        _SWAY * robot.length / size if size > 0 else math.inf,
        _TURN[modes.kind[k]] / spin if spin > 0 else math.inf,
    )
    rest = _shape(robot, modes.position, modes.orientation)
    moved = _shape(
        robot,
        modes.position + scale * shift,
        modes.orientation @ _rotations(scale * turn),
    )
    if modes.kind[k] == "torsion":
        drawn = f"drawn with {math.degrees(scale * spin):.0f} deg at the largest rotation"
    else:
        drawn = f"drawn with {1e3 * scale * size:.3g} mm at the largest displacement"

    figure = Figure(figsize=(_WIDTH, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, across, title in zip(panels, (0, 1), ("side", "front"), strict=True):
        for lines, colour, dash, label in (
            (rest, "muted", "--", "equilibrium"),
            (moved, "blue", "-", "mode shape"),
        ):
            style: dict[str, Any] = {"color": _LIGHT[colour], "linestyle": dash}
            for path, width in lines:
                axes.plot(path[:, across] * 1e3, path[:, 2] * 1e3, linewidth=width, **style)
            axes.plot([], [], label=label, **style)
        axes.set(aspect="equal", xlabel=f"{'xy'[across]} (mm)")
        axes.set_title(title)
        axes.locator_params(axis="x", nbins=4)
    low, high = panels[0].get_xlim()
    room = max(0.0, 0.5 * (400.0 * robot.length - (high - low)))  # a straight robot is narrow
    panels[0].set(ylabel="z (mm)", xlim=(low - room, high + room))
    figure.suptitle(
        f"Mode {k + 1}: {modes.frequency_hz[k]:.5g} Hz, {modes.kind[k]}\n{drawn}",
        fontsize=9.5,
        x=0.02,
        ha="left",
    )
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", ncols=2)
    return figure


def _shape(robot: Robot, position: Array, frames: Array) -> list[tuple[Array, float]]:
    """Lines of a robot with their widths, m: backbone, rims of the disks, tendons."""
    position = np.concatenate([np.zeros((1, 3)), position])
    frames = np.concatenate([np.eye(3)[None], frames])
    # a cubic between two disks, along their axes
    s = np.linspace(0.0, 1.0, 9)[:, None]
    backbone = []
    for i in range(len(position) - 1):
        a, b = position[i], position[i + 1]
        chord = float(np.linalg.norm(b - a))
        u, v = chord * frames[i, :, 2], chord * frames[i + 1, :, 2]
        backbone.append(
            (1 - s) ** 2 * (a * (1 + 2 * s) + u * s) + s**2 * (b * (3 - 2 * s) - v * (1 - s))
        )
    lines: list[tuple[Array, float]] = [(np.concatenate(backbone), 2.0)]
    psi = np.linspace(0.0, math.tau, 33)
    circle = np.stack([np.cos(psi), np.sin(psi), np.zeros_like(psi)], axis=-1)
    every = max(1, len(position) // 60)
    for i in range(len(position) - 1, 0, -every):
        radius = float(robot.disks.radius_m[i - 1])
        lines.append((position[i] + radius * circle @ frames[i].T, 0.8))
    holes = np.column_stack([robot.tendons.hole_m, np.zeros(len(robot.tendons.hole_m))])
    for hole, end in zip(holes, robot.tendons.end_disk, strict=True):
        last = int(end) + 2
        lines.append((position[:last] + frames[:last] @ hole, 0.8))
    return lines


def _rotations(vectors: Array) -> Array:
    """Rotation matrices (N, 3, 3) of rotation vectors (N, 3), Rodrigues."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = vectors.T
    none = np.zeros_like(x)
    cross = np.stack([none, -z, y, z, none, -x, -y, x, none], axis=1).reshape(-1, 3, 3)
    # sinc(t / pi) is sin(t) / t
    once, twice = np.sinc(angle / math.pi), 0.5 * np.sinc(angle / math.tau) ** 2
    result: Array = np.eye(3) + once * cross + twice * cross @ cross
    return result


def _mean_of(case: Case, name: str) -> float:
    return case.comparisons[name].mean


def _force_label(study: Study) -> str:
    return f"tension of tendon {study.settings.tendon + 1} (N)"


def _solid(study: Study) -> Figure:
    """The robot bent by the largest load of the sweep that has an equilibrium."""
    from bowstring import rod
    from bowstring.comparison import with_tendons
    from bowstring.picture import draw_solid
    from bowstring.solid import make_solid

    statics = study.statics
    found = np.flatnonzero(np.array(statics.status) == "converged")
    robot = with_tendons(study.robot, {"friction": 0.0})  # as in the sweep
    tensions = np.zeros(len(robot.tendons.angle_rad))
    tensions[study.settings.tendon] = statics.tension[found[-1]]
    pose = rod.solve(robot, tensions, theory=study.settings.theory)
    return draw_solid(make_solid(robot, pose if pose.converged else None), pixels=900)


def _disk(study: Study) -> Figure:
    from bowstring.drawing import draw_disks

    return draw_disks(study.robot)


def _fe_stress(study: Study) -> Figure:
    assert study.bricks is not None
    return brick_plots.stress_along(study.bricks.run, study.bricks.beside)


def _fe_field(study: Study) -> Figure:
    assert study.bricks is not None
    return brick_plots.field(study.bricks.run)


_DRAWINGS: Final[dict[str, Callable[[Study], Figure]]] = {
    "fig01_robot": _solid,
    "fig02_disk": _disk,
    "fig05_tip_against_force": _tip_against_force,
    "fig05_over_time": _over_time,
    "pull_against_force": _pull_against_force,
    "fig06_tip_against_pull": _tip_against_pull,
    "fig07_configurations": _configurations,
    "fig10_overlay": _overlay,
    "fig11_errors": _errors,
    "fe_stress": _fe_stress,
    "fe_field": _fe_field,
    "error_budget": _error_budget,
    "hysteresis": _hysteresis,
    "fig09_measured_tip": _measured_tip,
    "fig10_measured_errors": _measured_errors,
    "fig12_measured_comparison": _measured_comparison,
    "measured_residuals": _measured_residuals,
}
