"""Figures of finite elements and rod: tip over load, stress along and on the backbone."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.fem.comparison import RodComparison
from bowstring.fem.fields import VOIGT
from bowstring.fem.run import BrickRun
from bowstring.robot.rest_shape import rest_frames
from bowstring.statics import rod
from bowstring.statics.model import RodModel
from bowstring.viz.style import AXES, LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.collections import TriMesh
    from matplotlib.figure import Figure

# Halves of the side faces of a brick: the middle of an edge lies outside the line between corners.
_SIDES: Final = ((0, 8), (8, 1), (1, 9), (9, 2), (2, 10), (10, 3), (3, 11), (11, 0))


def draw(run: BrickRun, comparison: RodComparison) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Draw the figures one by one.

    Parameters
    ----------
    run : BrickRun
        Run with at least one step.
    comparison : RodComparison

    Yields
    ------
    stem : str
        ``tip``, ``stress`` and ``field``.
    draw : callable
        Makes the figure, to be called and saved within `bowstring.viz.style.figure_style`.
    """
    yield "tip", partial(_tip, run, comparison)
    yield "stress", partial(stress_along, run, comparison)
    yield "field", partial(field, run)


def _tip(run: BrickRun, comparison: RodComparison) -> Figure:
    from matplotlib.figure import Figure

    load = run.time if run.is_motion else run.tensions.max(axis=1)
    unit = "time in s" if run.is_motion else "largest tension in N"
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    unloaded = rest_frames(run.robot, run.robot.disks.station_m[-1:])[0]
    for axis, (name, colour, _) in enumerate(AXES):
        rods, bricks = (
            1e3 * (tip - unloaded)[:, axis] for tip in (comparison.tip, run.tip_position)
        )
        upper.plot(load, rods, color=LIGHT[colour], linewidth=1.2)
        upper.plot(load, bricks, "o", color=LIGHT[colour], markersize=4, fillstyle="none")
        upper.annotate(
            name, (load[-1], bricks[-1]), xytext=(6, 0), textcoords="offset points", va="center"
        )
    upper.plot([], [], color=LIGHT["muted"], linewidth=1.2, label="rod")
    upper.plot([], [], "o", color=LIGHT["muted"], fillstyle="none", label="finite elements")
    upper.legend()
    title = "Tip, finite elements beside the rod (both simulated)"
    upper.set(title=title, ylabel="displacement in mm")
    lower.plot(load, 1e3 * comparison.difference, "o-", color=LIGHT["ink"], markersize=3)
    lower.set(xlabel=unit, ylabel="distance in mm")
    lower.set_ylim(bottom=0.0)
    return figure


def _last(run: BrickRun) -> str:
    return f"{run.time[-1]:g} s" if run.is_motion else f"{run.tensions[-1].max():g} N"


def stress_along(run: BrickRun, comparison: RodComparison) -> Figure:
    """Draw the largest axial stress along the backbone at the last step, bricks and rod."""
    from matplotlib.figure import Figure

    stress = run.section_stress(-1)
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes = figure.subplots()

    def by_module(z: Floats, module: Ints, *curves: tuple[Floats, str, dict[str, Any]]) -> None:
        for m in np.unique(module).tolist():
            here = module == m
            for values, label, look in curves:
                once = label if m == module[0] else None
                axes.plot(1e3 * z[here], 1e-6 * values[here], label=once, **look)

    dots = {"color": LIGHT["red"], "marker": "o", "markersize": 2.5, "linewidth": 0.8}
    line = {"color": LIGHT["blue"], "linewidth": 1.2}
    peak = (stress.peak, "finite elements, largest at a node", dots)
    largest = (stress.largest, "finite elements, bending and tension", line)
    by_module(stress.arc_length, stress.module, peak, largest)
    if not run.is_motion and np.isfinite(comparison.rod_middle[-1]).all():
        solution = rod.solve(run.robot, run.tensions[-1], load=run.load, model=RodModel(elements=4))
        fields = solution.to_dataset(9)
        z, module = fields.arc_length.to_numpy(), fields.module.to_numpy()
        look = {"color": LIGHT["ink"], "linewidth": 1.0, "linestyle": "--"}
        by_module(z, module, (fields.normal_stress.to_numpy()[0], "rod", look))
    axes.set(xlabel="arc length in mm", ylabel="axial stress at the surface in MPa")
    axes.set_title(
        f"Largest axial stress at {_last(run)} (simulated); what stands out at disks' edges is "
        "the clamps'"
    )
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def field(run: BrickRun) -> Figure:
    """Draw the backbone's surface from the side at the last step, coloured by axial stress.

    Clamped parts are left out.
    """
    from matplotlib.figure import Figure
    from matplotlib.tri import Triangulation

    place, stress, quads = _surface(run)
    tip = run.tip_position[-1]
    bent = np.hypot(tip[0], tip[1]) > 1e-9 * run.robot.length
    towards = np.array([tip[0], tip[1], 0.0]) if bent else np.array([1.0, 0.0, 0.0])
    towards /= np.linalg.norm(towards)
    up = np.array([0.0, 0.0, 1.0])
    quads = quads[_outward(place, quads) @ np.cross(up, towards) <= 0.0]  # visible faces
    flat = 1e3 * np.stack([place @ towards, place @ up], axis=1)
    triangles = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]])
    used, corners = np.unique(triangles, return_inverse=True)
    corners = np.asarray(corners).reshape(-1, 3)
    shade = 1e-6 * stress[used]
    top = float(np.abs(shade).max())

    def paint(axes: Axes) -> TriMesh:
        faces: TriMesh = axes.tripcolor(
            Triangulation(flat[used, 0], flat[used, 1], corners),
            shade,
            shading="gouraud",
            cmap="RdBu_r",
            vmin=-top,
            vmax=top,
            rasterized=True,
        )
        axes.set_aspect("equal")
        axes.grid(False)
        return faces

    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes, close = figure.subplots(1, 2, width_ratios=[3, 2])
    faces = paint(axes)
    title = f"Axial stress at {_last(run)},\nfinite elements (simulated)"
    axes.set(xlabel="towards the tip in mm", ylabel="z in mm", title=title)
    figure.colorbar(faces, ax=axes, label="MPa, positive in tension", shrink=0.8)
    paint(close)
    disks = run.frames.disk_position[-1]
    disk = disks[max(len(disks) // 2 - 1, 0)]
    middle = 1e3 * np.array([disk @ towards, disk @ up])
    reach = 2e3 * max(s.backbone.outer_diameter for s in run.robot.segments)
    close.set_xlim(middle[0] - reach, middle[0] + reach)
    close.set_ylim(middle[1] - 1.5 * reach, middle[1] + 1.5 * reach)
    close.set(title="At a disk", xlabel="mm")
    return figure


def _outward(place: Floats, quads: Ints) -> Floats:
    """Normals (q, 3) of outer faces, of any length."""
    a, b, c, d = (place[quads[:, i]] for i in range(4))
    return np.asarray(np.cross(c - a, d - b), dtype=np.float64)


def _surface(run: BrickRun) -> tuple[Floats, Floats, Ints]:
    """Positions (n, 3), axial stress (n,) and corners (q, 4) of the free backbone's surface."""
    mesh = run.mesh
    displacement, stress, _ = run.nodal(-1)
    reach = np.hypot(mesh.straight[:, 0], mesh.straight[:, 1])
    free = mesh.bricks[~mesh.stiff]
    sides = np.concatenate([free[:, [a, b, b + 4, a + 4]] for a, b in _SIDES])
    part = np.tile(mesh.part[~mesh.stiff], len(_SIDES))
    outer, end = np.empty(sides.shape), 0.0
    for k, segment in enumerate(run.robot.segments):
        end += segment.length
        fraction = 1.0 + (mesh.straight[sides[part == k], 2] - end) / segment.length
        outer[part == k] = segment.backbone.at(fraction).diameter
    quads = sides[(reach[sides] > 0.49 * outer).all(axis=1)]
    place = mesh.nodes + displacement
    # each face is split along its own upright edges
    along = np.zeros_like(place)
    for low, high in ((0, 3), (1, 2)):
        edge = place[quads[:, high]] - place[quads[:, low]]
        edge /= np.linalg.norm(edge, axis=1, keepdims=True)
        np.add.at(along, quads[:, low], edge)
        np.add.at(along, quads[:, high], edge)
    size = np.linalg.norm(along, axis=1, keepdims=True)
    along = np.divide(along, size, out=np.zeros_like(along), where=size > 0)
    return place, np.einsum("ni,nij,nj->n", along, stress[:, VOIGT], along), quads
