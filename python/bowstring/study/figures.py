"""Figures of the study, after the source study's own."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.tip_errors import known_max
from bowstring.fem.figures import field, stress_along
from bowstring.formatting import in_mm
from bowstring.statics.model import RodModel
from bowstring.study.actuation_budget import COMMANDED, ActuationBudget
from bowstring.study.comparison import short
from bowstring.study.data_figures import (
    measured_angles,
    measured_comparison,
    measured_errors,
    measured_parts,
    measured_residuals,
    measured_tip,
)
from bowstring.study.error_budget import SIDES, Budget, Side
from bowstring.study.geometry_figures import draw_arc, draw_module, draw_spaces
from bowstring.study.ramp_response import has_surface
from bowstring.study.shape_figures import draw_shapes
from bowstring.study.shapes import backbones
from bowstring.study.study import Study
from bowstring.viz.style import AXES, LIGHT, TINY, WIDTH, legend_above, log_ticks, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_TENDON_COLOURS: Final = ("red", "blue", "amber", "purple", "green")
_TENDON_DASHES: Final = ("-", "--", ":", "-.")
_MAGNIFIED: Final = 2.0  # least magnification of an inset


def draw(study: Study) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Draw the figures one by one.

    Yields
    ------
    stem : str
        File name without ending, from `bowstring.study.figure_list.FIGURES`.
    draw : callable
        Makes the figure, to be called and saved within `figure_style`.
    """
    for shown in study.figures:
        yield shown.stem, partial(_DRAWINGS[shown.stem], study)


def _tip_against_force(study: Study) -> Figure:
    whole = has_surface(study.robot)
    figure, axes = (
        subplots(4, 8.0, sharex=True, height_ratios=(3, 2, 2, 2))
        if whole
        else subplots(2, 5.0, sharex=True, height_ratios=(3, 2))
    )
    tip, moved = axes[:2]
    s, force = study.statics, study.comparison("cc_from_force")
    motion = study.dynamics
    rising = motion.rising if motion else slice(0)

    def draw_on(
        axes: Axes, name: str, look: tuple[str, str, str], static: Floats, over: Floats
    ) -> None:
        """Draw dynamics as a line and statics as markers, joined where there is no dynamics."""
        colour, marker, line = LIGHT[look[0]], look[1], look[2]
        if motion:
            axes.plot(motion.tension[rising], over[rising], line, color=colour)
            axes.plot(s.tension, static, marker, color=colour, markerfacecolor="none")
            axes.plot([], [], line + marker, label=name, markerfacecolor="none", color=colour)
        else:
            axes.plot(s.tension, static, line + marker, label=name, color=colour)

    none = np.zeros((0, 3))
    for k, (name, colour, marker) in enumerate(AXES):
        over = (motion.tip_position if motion else none)[:, k] * 1e3
        draw_on(tip, name, (colour, marker, "-"), s.tip_position[:, k] * 1e3, over)
        by_force = force.tip_position[:, k] * 1e3
        tip.plot(s.tension, by_force, "x", color=LIGHT[colour], markersize=6)
    cross: dict[str, Any] = {"marker": "+", "linestyle": "none", "markersize": 8}
    cross["color"] = LIGHT["ink"]
    if study.bricks is not None:
        tip.plot(s.tension, study.bricks.tip_position * 1e3, **cross)
        tip.plot([], [], label="finite elements", **cross)
    tip.plot([], [], "x", color=LIGHT["ink"], label="CC from force")
    tip.set(ylabel="tip coordinate (mm)")
    legend_above(tip, 4 if study.bricks is None else 3)
    how = "lines: dynamics, markers: statics" if motion else "statics"
    pad = 22 if study.bricks is None else 36  # above one row of the legend, or two
    tip.set_title(f"simulated; {how}", fontsize=8.5, loc="right", pad=pad)

    straight = s.tip_position[0] if s.converged[0] else np.array([0.0, 0.0, study.length])
    away = np.linalg.norm(s.tip_position - straight, axis=-1) * 1e3
    over = motion.displacement * 1e3 if motion else none
    draw_on(moved, "", ("ink", "o", "-"), away, over)
    moved.set(ylabel="displacement\nof the tip (mm)")
    if not whole:
        moved.set(xlabel=_force_label(study))
        return figure

    stress, strain = axes[2:]
    at, run = s.surface, motion.surface if motion else s.surface
    von_mises, normal = ("blue", "o", "-"), ("red", "x", "--")
    draw_on(stress, "von Mises", von_mises, at.von_mises / 1e6, run.von_mises / 1e6)
    draw_on(stress, "along the backbone", normal, at.normal_stress / 1e6, run.normal_stress / 1e6)
    if study.bricks is not None:
        bent = np.linalg.norm(study.bricks.tip_position - straight, axis=-1)
        moved.plot(s.tension, bent * 1e3, **{**cross, "color": LIGHT["green"]})
        largest = study.bricks.comparison.middle.max(axis=1, initial=0.0) / 1e6
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
    figure, (tension, tip, apart) = subplots(3, 6.4, sharex=True, height_ratios=(2, 4, 2))
    time = motion.time
    tension.plot(time, motion.tension, color=LIGHT["ink"])
    tension.set(ylabel=f"tension of\n{study.settings.actuated} (N)")
    tension.set_title("simulated", fontsize=8.5, loc="right")
    for k, (name, colour, _) in enumerate(AXES):
        tip.plot(time, motion.tip_position[:, k] * 1e3, color=LIGHT[colour], label=name)
        tip.plot(time, motion.static_tip[:, k] * 1e3, "--", color=LIGHT[colour], lw=1.0)
    tip.plot([], [], "--", color=LIGHT["ink"], lw=1.0, label="statics")
    tip.set(ylabel="tip coordinate (mm)")
    legend_above(tip, 4)
    apart.plot(time, motion.difference * 1e3, color=LIGHT["purple"])
    apart.set(ylabel="dynamics from\nstatics (mm)", xlabel="time (s)")
    apart.set_ylim(0.0, 1.3 * max(known_max(motion.difference) * 1e3, TINY))
    if motion.peak is not None:
        when, size = motion.peak
        for axes in (tip, apart):
            axes.axvline(when, color=LIGHT["amber"], linestyle=":", linewidth=1.2)
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


def _displacement_against_force(study: Study) -> Figure:
    figure, (axes, below) = subplots(2, 4.0, sharex=True, height_ratios=(2, 1))
    s = study.statics
    axes.plot(s.tension, s.displacement * 1e3, "-o", color=LIGHT["blue"], label="statics")
    axes.plot(s.tension, s.linear_displacement * 1e3, "--", color=LIGHT["red"], label="linear law")
    axes.set(ylabel="displacement (mm)")
    legend_above(axes, 2)
    below.plot(
        s.tension, (s.linear_displacement - s.displacement) * 1e3, "-d", color=LIGHT["purple"]
    )
    below.set(xlabel=_force_label(study), ylabel="linear law\nminus statics (mm)")
    return figure


def _geometric_sweep(study: Study) -> Figure:
    figure, (lengths, tip) = subplots(2, 5.4, sharex=True)
    g = study.geometry
    count = g.tendon_lengths.shape[1]
    for t, length in enumerate(g.tendon_lengths.T * 1e3):
        # the first are wide and solid, so that later ones of equal length do not hide them
        style = {
            "color": LIGHT[_TENDON_COLOURS[t % len(_TENDON_COLOURS)]],
            "linestyle": _TENDON_DASHES[t % len(_TENDON_DASHES)],
            "linewidth": 1.4 + 1.8 * (1.0 - t / max(1, count - 1)),
        }
        lengths.plot(g.displacement * 1e3, length, label=f"tendon {t + 1}", **style)
    lengths.set(ylabel="tendon length (mm)")
    legend_above(lengths, min(count, 5))
    for k, (name, colour, marker) in enumerate(AXES):
        place = g.tip_position[:, k] * 1e3
        tip.plot(g.displacement * 1e3, place, "-" + marker, color=LIGHT[colour], label=name)
    tip.set(xlabel=f"displacement of tendon {study.settings.tendon + 1} (mm)")
    tip.set(ylabel="tip coordinate (mm)")
    legend_above(tip, 3)
    return figure


def _configurations(study: Study) -> Figure:
    figure, axes = _view(4.8)
    g = study.geometry
    known = np.flatnonzero(np.all(np.isfinite(g.tip_position), axis=-1))
    shown = known[np.unique(np.linspace(0, len(known) - 1, 5).round().astype(int))]

    points: list[Floats] = []
    tips: list[tuple[Floats, Floats, str]] = []
    for i in shown:
        points += _draw_robot(axes, study, g.backbone[i], g.disk_positions[i], g.disk_rotations[i])
        onward = g.disk_rotations[i, -1][:, 2]
        tips.append((g.backbone[i, -1] * 1e3, onward, f"{g.displacement[i] * 1e3:.3g}"))
    _frame_robots(axes, study, points)
    _label_tips(axes, tips, np.concatenate(points))
    for colour, label in (
        ("ink", "backbone"),
        ("red", "actuated tendon"),
        ("blue", "other tendons"),
    ):
        axes.plot([], [], [], color=LIGHT[colour], label=label)
    figure.legend(loc="upper left", ncols=3, handlelength=1.4, columnspacing=1.0)
    figure.text(0.02, 0.9, "number at each tip: tendon displacement in mm", fontsize=8.5)
    return figure


def _robot(study: Study) -> Figure:
    """Draw the robot at the largest load, and constant curvature under the same load."""
    figure, axes = _view(3.8)
    last = int(np.flatnonzero(study.statics.converged)[-1])
    position, rotation = study.statics.disk_positions[last], study.statics.disk_rotations[last]
    rod, *arcs = backbones(study)[1]
    points = _draw_robot(axes, study, rod.backbone, position, rotation)
    axes.plot([], [], [], color=LIGHT["ink"], label="rod")
    for shape in arcs:
        label, colour, line, _ = _SHAPES[shape.name]
        points.append(shape.backbone * 1e3)
        look: dict[str, Any] = {"color": LIGHT[colour], "linestyle": line, "linewidth": 1.8}
        axes.plot(*points[-1].T, label=label, zorder=10, **look)
        axes.plot(*points[-1][-1:].T, "o", color=LIGHT[colour], markersize=6)
    _frame_robots(axes, study, points)
    figure.legend(loc="upper left", ncols=3, handlelength=2.4, columnspacing=1.0)
    return figure


_SHAPES: Final = {
    "statics": ("rod model", "ink", "-", "o"),
    "cc_from_lengths": ("CC from lengths", "blue", "-.", "s"),
    "cc_from_force": ("CC from force", "red", "--", "x"),
}
"""Label, colour, line and marker of the shapes at the largest load."""


def _view(height: float) -> tuple[Figure, Any]:
    """Figure with axes in 3-D."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    axes: Any = figure.add_axes((0.02, 0.0, 0.9, 0.9), projection="3d")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", zlabel="z (mm)")
    return figure, axes


def _draw_robot(
    axes: Any, study: Study, backbone: Floats, positions: Floats, rotations: Floats
) -> list[Floats]:
    """Draw backbone, disks and tendons; return what is drawn, points in mm."""
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    robot = study.robot
    turn = np.linspace(0.0, math.tau, 33)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)
    centres = np.concatenate([np.zeros((1, 3)), positions]) * 1e3
    frames = np.concatenate([np.eye(3)[None], rotations])
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
        facecolors=LIGHT["grid"],
        edgecolors=LIGHT["muted"],
        linewidths=0.6,
        alpha=0.55,  # a disk is seen through
    )
    axes.add_collection3d(disks)
    for t, path in enumerate(robot.tendon_points(positions, rotations)):
        colour, width = ("red", 1.2) if study.settings.shares[t] else ("blue", 0.8)
        axes.plot(*(1e3 * path.T), color=LIGHT[colour], linewidth=width)
    axes.plot(*(1e3 * backbone.T), color=LIGHT["ink"], linewidth=2.0)
    return [*rings, backbone * 1e3]


def _frame_robots(axes: Any, study: Study, points: Sequence[Floats]) -> None:
    """Fit the axes to what is drawn; the bending plane is seen nearly from the front."""
    _fit_box(axes, np.concatenate(points))
    azimuth = math.degrees(math.atan2(study.towards[1], study.towards[0])) - 65.0
    axes.view_init(elev=20.0, azim=azimuth)


def _label_tips(axes: Any, tips: Sequence[tuple[Floats, Floats, str]], drawn: Floats) -> None:
    """Label each tip in front of all, at the place beyond it where the text covers least."""
    from mpl_toolkits.mplot3d import proj3d

    axes.figure.draw_without_rendering()  # places the axes and their labels
    projection, per_point = axes.get_proj(), 72.0 / axes.figure.dpi

    def on_page(points: Floats) -> tuple[Floats, Floats]:
        """In the axes' own two coordinates, and in points (1/72 inch)."""
        flat = np.column_stack(proj3d.proj_transform(*np.atleast_2d(points).T, projection)[:2])
        return flat, axes.transData.transform(flat) * per_point

    share = np.linspace(0.0, 1.0, 50)[:, None]
    parts = [on_page(drawn)[1]]
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        ends = axes.transData.transform(axis.line.get_xydata())
        parts.append((ends[0] + share * (ends[-1] - ends[0])) * per_point)
        for label in axis.get_ticklabels():
            box = label.get_window_extent()
            grid = np.meshgrid(np.linspace(box.x0, box.x1, 7), np.linspace(box.y0, box.y1, 4))
            parts.append(np.stack(grid, axis=-1).reshape(-1, 2) * per_point)
    taken = np.concatenate(parts)
    for tip, onward, text in tips:
        ends, (start, end) = on_page(np.stack([tip, tip + 1e-3 * np.ptp(drawn) * onward]))
        angle = math.atan2(*(end - start)[::-1])
        half = np.array([2.6 * len(text) + 1.0, 5.0])  # size of the text in points
        turns = angle + np.radians([0, 20, -20, 40, -40, 60, -60, 90, -90, 120, -120])
        ways = np.stack([np.cos(turns), np.sin(turns)], axis=1)
        offsets = np.concatenate([away * ways for away in (12.0, 16.0, 20.0, 26.0, 32.0)])
        hidden = [np.all(np.abs(taken - start - each) < half, axis=1).sum() for each in offsets]
        offset = offsets[int(np.argmin(hidden))]
        axes.annotate(
            text,
            ends[0],
            xytext=offset,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=8.5,
            zorder=1e3,  # over all disks
            bbox={"facecolor": LIGHT["paper"], "edgecolor": "none", "pad": 0.8},
        )
        corners = start + offset + half * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1], [0, 0]])
        taken = np.concatenate([taken, corners])


def _fit_box(axes: Any, points: Floats) -> None:
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
    figure, (axes,) = subplots(1, 3.6)
    physics = _in_plane(study, study.statics.tip_position)
    lengths = _in_plane(study, study.comparison("cc_from_lengths").tip_position)
    force = _in_plane(study, study.comparison("cc_from_force").tip_position)

    def draw_on(axes: Axes) -> None:
        ink: dict[str, Any] = {"color": LIGHT["ink"], "markersize": 3.5}
        axes.plot(*physics, "-o", label="rod model", **ink)
        axes.plot(*physics, "o", zorder=3, **ink)  # drawn over the markers of the others
        blue: dict[str, Any] = {"color": LIGHT["blue"], "markerfacecolor": "none"}
        axes.plot(*lengths, "s", label="CC from lengths", markersize=8, **blue)
        red: dict[str, Any] = {"color": LIGHT["red"], "linewidth": 1.0}
        axes.plot(*force, "x", label="CC from force", markersize=6, **red)
        for end in np.stack([physics, force], axis=-1).swapaxes(0, 1):  # the same load
            axes.plot(*end, color=LIGHT["red"], linewidth=4, alpha=0.5, solid_capstyle="butt")
        if study.bricks is not None:
            bricks = _in_plane(study, study.bricks.tip_position)
            axes.plot(*bricks, "+", label="finite elements", markersize=9, color=LIGHT["green"])

    draw_on(axes)
    axes.set(xlabel=f"tip, {_direction(study)} (mm)", ylabel="tip, z (mm)")
    axes.set_aspect("equal", adjustable="datalim")
    legend_above(axes, 3 if study.bricks is None else 2)

    paths = [p[:, np.all(np.isfinite(p), axis=0)] for p in (physics, lengths, force)]
    _magnify_end(figure, axes, paths, np.concatenate([p[:, -2:] for p in paths[::2]], 1), draw_on)
    return figure


def _magnify_end(
    figure: Figure,
    axes: Axes,
    paths: Sequence[Floats],
    ends: Floats,
    draw_on: Callable[[Axes], None],
) -> None:
    """Magnify the last loads in a corner, if they are close together and a corner is free."""
    reach = float(np.ptp(ends, axis=1).max()) if ends.size else 0.0
    if reach == 0.0:
        return
    middle = 0.5 * (ends.min(axis=1) + ends.max(axis=1))
    low, high = middle - 0.8 * reach, middle + 0.8 * reach
    former = axes.dataLim.frozen()
    axes.update_datalim([low, high])  # the frame around them stays within the axes
    axes.autoscale_view()
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
    axes.apply_aspect()
    size = np.array([axes.bbox.width, axes.bbox.height])
    edges = np.array([axes.get_xlim(), axes.get_ylim()])
    scale = size[0] / np.ptp(edges[0])  # pixels in a mm
    along = np.linspace(0.0, 1.0, 20)[:, None]
    taken = np.concatenate(
        [
            np.concatenate([p.T, *((1 - t) * p.T[:-1] + t * p.T[1:] for t in along)])
            for p in (*paths, np.stack([low, high, [low[0], high[1]], [high[0], low[1]]], 1))
        ]
    )
    taken = (taken - edges[:, 0]) / np.ptp(edges, axis=1)
    for width, height in ((0.5, 0.6), (0.45, 0.5), (0.4, 0.4)):
        side = min(width * size[0], height * size[1])
        if side / (2 * 0.8 * reach) < _MAGNIFIED * scale:
            break
        share = side / size  # a square on the page
        top = 0.97 - share[1] - 0.06  # room for its title
        for corner in ((0.03, 0.03), (0.97 - share[0], top), (0.97 - share[0], 0.03), (0.03, top)):
            inside = (taken > np.array(corner) - 0.03) & (taken < corner + share + (0.03, 0.09))
            if not np.any(np.all(inside, axis=1)):
                inset = axes.inset_axes((*corner, *share))
                draw_on(inset)
                inset.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
                inset.set(xticks=[], yticks=[], aspect="equal")
                inset.spines[:].set_visible(True)
                inset.set_title("enlarged: the last loads", fontsize=8, pad=3)
                axes.indicate_inset_zoom(inset, edgecolor=LIGHT["muted"])
                return
    axes.dataLim.set(former)
    axes.autoscale_view()


def _backbones(study: Study) -> Figure:
    """Draw shapes at the largest load, and their distance from statics along the robot."""
    tension, found = backbones(study)
    figure, (shapes, apart) = subplots(2, 6.0, height_ratios=(2, 1))
    stations = np.concatenate([[0.0], study.robot.disks.station_m]) / study.length * 100.0
    for shape in found:
        label, colour, line, marker = _SHAPES[shape.name]
        look: dict[str, Any] = {"color": LIGHT[colour], "marker": marker, "markersize": 4.5}
        shapes.plot(
            *_in_plane(study, shape.backbone), color=LIGHT[colour], linestyle=line, linewidth=1.4
        )
        disks = _in_plane(study, shape.disks)
        shapes.plot(*disks, linestyle="none", markerfacecolor="none", **look)
        shapes.plot([], [], label=label, linestyle=line, markerfacecolor="none", **look)
        if shape.name != "statics":
            away = np.concatenate([[0.0], shape.from_statics]) * 1e3
            apart.plot(stations, away, linestyle=line, markerfacecolor="none", **look)
    shapes.set(xlabel=f"{_direction(study)} (mm)", ylabel="z (mm)")
    shapes.set_aspect("equal", adjustable="datalim")
    legend_above(shapes, 3)
    shapes.set_title(f"{study.settings.actuated} at {tension:.4g} N", pad=22)
    apart.set(xlabel="disk (% of length from the base)", ylabel="CC from rod model,\nby disk (mm)")
    apart.set_ylim(0.0, max(apart.get_ylim()[1], TINY * 1e3))
    return figure


def _in_plane(study: Study, points: Floats) -> Floats:
    """Points (n, 3) in the bending plane (2, n), mm."""
    return np.stack([points @ study.towards, points[:, 2]]) * 1e3


def _direction(study: Study) -> str:
    x, y, _ = study.towards
    return "x" if abs(y) < 1e-9 and x > 0 else "towards the actuated tendon"


def _errors(study: Study) -> Figure:
    figure, panels = subplots(2, 5.2, sharex=True)
    tension = study.statics.tension
    titles = ("CC from lengths (Eq. 5)", "CC from force (linear law)")
    for axes, name, title in zip(panels, ("cc_from_lengths", "cc_from_force"), titles, strict=True):
        comparison = study.comparison(name)
        for k, (axis, colour, marker) in enumerate(AXES):
            difference = comparison.difference[:, k] * 1e3
            axes.plot(tension, difference, "-" + marker, color=LIGHT[colour], label=axis)
        fine = study.verdict.fine_error[name] * 1e3
        axes.plot(study.verdict.fine_tension, fine, color=LIGHT["ink"], label="Euclidean")
        if study.bricks is not None:
            label = "Euclidean, from finite elements"
            bricks = study.comparison(name, "fe").error * 1e3
            axes.plot(tension, bricks, "+", color=LIGHT["green"], label=label)
        limit = study.verdict.tolerance_length * 1e3
        largest = np.nanmax(comparison.error, initial=0.0) * 1e3
        if largest > 0.3 * limit:
            axes.axhline(limit, color=LIGHT["amber"], linestyle=":", label=f"tolerance {limit:.3g}")
        else:
            title += f"; tolerance {limit:.3g} mm is above"
        axes.set(ylabel="CC minus statics (mm)")
        axes.set_title(title)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    panels[-1].set(xlabel=_force_label(study))
    return figure


def _error_budget(study: Study) -> Figure:
    budget = study.budget
    actuation = budget.actuation
    count = len(budget.rows)
    figure, (*panels, controlled) = subplots(
        3, 8.8, height_ratios=(count, count, len(actuation.rows) + 3)
    )
    for axes, (side, title) in zip(panels, SIDES.items(), strict=True):
        _contributions(axes, budget, side)
        axes.set_title(title)
    by_control = (*_BY_MEANING, (COMMANDED, "CC from commanded lengths", "green", "^", 0.0))
    _actuation_panel(controlled, actuation, by_control)
    keys = [(label, colour, marker, colour) for _, label, colour, marker, _ in by_control]
    keys += [("with the effect", "muted", "o", "muted"), ("without it", "muted", "o", "paper")]
    for label, colour, marker, face in keys:
        look: dict[str, Any] = {"color": LIGHT[colour], "markerfacecolor": LIGHT[face]}
        controlled.plot([], [], marker, label=label, markersize=5.5, **look)
    figure.legend(*controlled.get_legend_handles_labels(), loc="outside upper left", ncols=2)
    return figure


_BY_MEANING: Final = (
    ("cc_from_lengths", "CC from lengths", "blue", "s", 0.16),
    ("cc_from_force", "CC from force", "red", "o", -0.16),
)
"""Name, label, colour, marker, and place beside the row."""


def _contributions(axes: Axes, budget: Budget, side: Side) -> None:
    """Draw a row for each effect: the mean error without it (hollow) and with it (filled)."""
    labels = [short(row.label) for row in budget.rows]
    places = np.arange(len(labels))[::-1]
    counted, means = [], []
    for row, place in zip(budget.rows, places, strict=True):
        counts = []
        for name, _, colour, marker, shift in _BY_MEANING:
            c = budget.contribution(row, side, name)
            counts.append((c.n, c.of))
            if not c.n:
                continue
            means += [c.without_effect, c.with_effect]
            ends = np.maximum([c.without_effect, c.with_effect], TINY) * 1e3
            look: dict[str, Any] = {"color": LIGHT[colour], "marker": marker, "markersize": 5.5}
            level = place + shift
            axes.plot(ends, [level, level], color=LIGHT[colour], linewidth=1.2, zorder=2.0)
            # filled with the page's colour, to hide the line behind
            axes.plot(ends[0], level, markerfacecolor=LIGHT["paper"], zorder=2.1, **look)
            axes.plot(ends[1], level, zorder=2.2, **look)
        counted.append(_say_loads(axes, float(place), counts))
    notes = []
    if means and min(means) < 0.01 * max(means):
        axes.set_xscale("log")
        log_ticks(axes.xaxis)
        low, high = axes.get_xlim()
        axes.set_xlim(low, max(high, 10.0 * low))
        notes = [f"({TINY * 1e3:g} or less at the left)"] if min(means) <= TINY else []
    else:
        axes.set_xlim(left=0.0)
    axes.set_yticks(places, labels)
    axes.set_ylim(-0.6, len(labels) - 0.4)
    _mean_axis(axes, notes, any(counted))


def _say_loads(axes: Axes, place: float, counts: Sequence[tuple[int, int]]) -> bool:
    """Write the number of loads of a row's means beside it, unless all; return whether written."""
    if all(n == of for n, of in counts):
        return False
    text = "; ".join(dict.fromkeys(f"{n} of {of}" if n else "none" for n, of in counts))
    look: dict[str, Any] = {"va": "center", "fontsize": 8, "color": LIGHT["muted"]}
    axes.annotate(text, (1.02, place), xycoords=("axes fraction", "data"), **look)
    return True


_NOTE_WIDTH: Final = 40
"""Width of a note below half a figure, in letters."""


def _mean_axis(axes: Axes, notes: Sequence[str], counted: bool) -> None:
    more = ["(at the right: over these loads only)"] if counted else []
    axes.set_xlabel("\n".join(["mean error of CC (mm)", *notes, *more]))
    axes.grid(axis="x", which="major")


def _actuation_panel(
    axes: Axes, actuation: ActuationBudget, series: tuple[tuple[str, str, str, str, float], ...]
) -> None:
    by_tension = [("no friction (this sweep)", actuation.tension_controlled)]
    by_displacement = [("displacement control, no friction", actuation.displacement_controlled)]
    for row in actuation.rows:
        rows = by_tension if row.control == "tension" else by_displacement
        label = row.short_label
        if label.startswith("elastic, "):
            label = re.sub(r"(?<=friction) [^,]*", "", label)  # said above
        rows.append((label, row.case))
    cases = [*by_tension, *by_displacement]
    places = np.arange(len(cases), dtype=float)[::-1]
    places[: len(by_tension)] += 0.4  # a gap between the two kinds of control
    counted = []
    for (_, case), place in zip(cases, places, strict=True):
        base = case is actuation.tension_controlled or case is actuation.displacement_controlled
        counts = []
        for name, _, colour, marker, shift in series:
            if name not in case.comparisons:
                continue
            c = case.comparisons[name]
            counts.append((c.n, len(c.error)))
            face = LIGHT["paper"] if base else LIGHT[colour]
            look: dict[str, Any] = {"color": LIGHT[colour], "markerfacecolor": face}
            axes.plot(c.mean * 1e3, place + shift, marker, markersize=5.5, **look)
        counted.append(_say_loads(axes, float(place), counts))
    axes.set_yticks(places, [label for label, _ in cases])
    axes.set_ylim(-0.6, len(cases))
    axes.set_xlim(left=0.0)
    axes.set_title("Actuation")
    notes = [
        line
        for each in actuation.assumptions
        for line in textwrap.wrap(f"assumed: {each}", _NOTE_WIDTH, subsequent_indent="   ")
    ]
    _mean_axis(axes, notes, any(counted))


def _hysteresis(study: Study) -> Figure:
    actuation = study.budget.actuation
    figure, panels = subplots(2, 5.6)
    number = study.settings.tendon + 1
    for axes, loop in zip(panels, actuation.loops, strict=True):
        by_tension = loop.control == "tension"
        onward = np.gradient(loop.constant_curvature, axis=0)
        onward /= np.linalg.norm(onward, axis=1, keepdims=True)
        command = loop.command * (1.0 if by_tension else 1e3)
        for way, label, colour, line in (
            (loop.free, "no friction" if by_tension else "no friction, inextensible", "ink", ":"),
            (loop.loading, "loading", "blue", "-"),
            (loop.unloading, "unloading", "red", "--"),
        ):
            ahead = np.sum((way - loop.constant_curvature) * onward, axis=1) * 1e3
            axes.plot(command, ahead, line, color=LIGHT[colour], label=label)
        axes.axhline(0.0, color=LIGHT["muted"], linewidth=0.8)
        wide = f"up to {in_mm(loop.width)} apart" if math.isfinite(loop.width) else "no numbers"
        axes.set_title(f"{'tension' if by_tension else 'displacement'} control; {wide}")
        law = "force" if by_tension else "commanded lengths"
        axes.set(ylabel=f"tip ahead of\nCC from {law} (mm)")
        axes.set_xlabel(
            _force_label(study) if by_tension else f"displacement of tendon {number} (mm)"
        )
        axes.legend(loc="best")
    return figure


def _force_label(study: Study) -> str:
    return f"tension of {study.settings.actuated} (N)"


def _solid(study: Study) -> Figure:
    """The robot bent by the largest load of the sweep that has an equilibrium."""
    from bowstring.cad.picture import draw_solid
    from bowstring.cad.solid import make_solid
    from bowstring.robot.model import without_laws
    from bowstring.statics import rod

    statics = study.statics
    found = np.flatnonzero(np.array(statics.status) == "converged")
    robot = without_laws(study.robot)  # as in the sweep
    tensions = statics.tension[found[-1]] * np.array(study.settings.shares)
    pose = rod.solve(robot, tensions, model=RodModel(study.settings.theory))
    return draw_solid(make_solid(robot, pose if pose.converged else None), pixels=900)


def _disk(study: Study) -> Figure:
    from bowstring.cad.drawing import draw_disks

    return draw_disks(study.robot)


def _fe_stress(study: Study) -> Figure:
    assert study.bricks is not None
    return stress_along(study.bricks.run, study.bricks.comparison)


def _fe_field(study: Study) -> Figure:
    assert study.bricks is not None
    return field(study.bricks.run)


def _map(study: Study) -> Figure:
    assert study.map is not None
    return study.map.figure()


def _load_map(study: Study) -> Figure:
    assert study.load_map is not None
    return study.load_map.figure()


def _spread(study: Study) -> Figure:
    return study.spreads[-1].figure()  # from force, whose errors are larger than from lengths


_DRAWINGS: Final[dict[str, Callable[[Study], Figure]]] = {
    "fig01_robot": _robot,
    "fig01_solid": _solid,
    "fig02_disk": _disk,
    "fig02_arc": draw_arc,
    "fig03_spaces": draw_spaces,
    "fig04_module": draw_module,
    "fig05_tip_against_force": _tip_against_force,
    "fig05_over_time": _over_time,
    "displacement_against_force": _displacement_against_force,
    "fig06_geometric_sweep": _geometric_sweep,
    "fig07_configurations": _configurations,
    "fig10_overlay": _overlay,
    "backbones": _backbones,
    "variable_curvature": draw_shapes,
    "fig11_errors": _errors,
    "fe_stress": _fe_stress,
    "fe_field": _fe_field,
    "validity_map": _map,
    "load_map": _load_map,
    "validity_spread": _spread,
    "error_budget": _error_budget,
    "hysteresis": _hysteresis,
    "fig09_measured_tip": measured_tip,
    "fig12_measured_errors": measured_errors,
    "measured_angles": measured_angles,
    "measured_comparison": measured_comparison,
    "measured_parts": measured_parts,
    "measured_residuals": measured_residuals,
}
