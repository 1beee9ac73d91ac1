"""Pictures of finite elements beside the rod: tip against load, stress along the backbone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from bowstring import rod
from bowstring.brick_comparison import BesideRod
from bowstring.finite_elements import BrickRun
from bowstring.plots import COLOURS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["draw"]


def draw(run: BrickRun, beside: BesideRod) -> Iterator[tuple[str, Figure]]:
    """Draw the figures one by one.

    Parameters
    ----------
    run : BrickRun
        With one step or more.
    beside : BesideRod

    Yields
    ------
    stem : str
        ``tip`` and ``stress``.
    figure : matplotlib.figure.Figure
        Draw and save within `bowstring.plots.figure_style`.
    """
    yield "tip", _tip(run, beside)
    yield "stress", _stress(run, beside)


def _colour(name: str) -> str:
    return COLOURS[name][0]


def _tip(run: BrickRun, beside: BesideRod) -> Figure:
    from matplotlib.figure import Figure

    load = run.time if run.is_motion else run.tensions.max(axis=1)
    unit = "time in s" if run.is_motion else "largest tension in N"
    figure = Figure(figsize=(4.6, 4.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    straight = np.array([0.0, 0.0, run.robot.length])
    for axis, (name, colour) in enumerate(zip("xyz", ("blue", "green", "red"), strict=True)):
        rods, bricks = (1e3 * (tip - straight)[:, axis] for tip in (beside.tip, run.tip_position))
        upper.plot(load, rods, color=_colour(colour), linewidth=1.2)
        upper.plot(load, bricks, "o", color=_colour(colour), markersize=4, fillstyle="none")
        upper.annotate(
            name, (load[-1], bricks[-1]), xytext=(6, 0), textcoords="offset points", va="center"
        )
    upper.plot([], [], color=_colour("muted"), linewidth=1.2, label="rod")
    upper.plot([], [], "o", color=_colour("muted"), fillstyle="none", label="finite elements")
    upper.legend()
    upper.set_title("Tip, finite elements beside the rod (both simulated)")
    upper.set_ylabel("displacement in mm")
    lower.plot(load, 1e3 * beside.difference, "o-", color=_colour("ink"), markersize=3)
    lower.set_ylabel("distance in mm")
    lower.set_ylim(bottom=0.0)
    lower.set_xlabel(unit)
    return figure


def _stress(run: BrickRun, beside: BesideRod) -> Figure:
    from matplotlib.figure import Figure

    stress = run.section_stress(-1)
    figure = Figure(figsize=(6.4, 3.2), layout="constrained")
    axes = figure.subplots()
    for m in np.unique(stress.module).tolist():
        here = stress.module == m
        z = 1e3 * stress.arc_length[here]
        once = m == 0
        axes.plot(
            z,
            1e-6 * stress.peak[here],
            "o-",
            color=_colour("red"),
            markersize=2.5,
            linewidth=0.8,
            label="finite elements, largest at a node" if once else None,
        )
        axes.plot(
            z,
            1e-6 * stress.largest[here],
            color=_colour("blue"),
            linewidth=1.2,
            label="finite elements, bending and tension" if once else None,
        )
    if not run.is_motion and np.isfinite(beside.rod_middle[-1]).all():
        load = {"gravity": run.settings["gravity"], "tip_force": run.settings["tip_force"]}
        solution = rod.solve(run.robot, run.tensions[-1], elements=4, **load)
        fields = solution.fields(9)
        z, values = fields.arc_length.to_numpy(), fields.normal_stress.to_numpy()[0]
        for m in np.unique(fields.module.to_numpy()).tolist():
            here = fields.module.to_numpy() == m
            axes.plot(
                1e3 * z[here],
                1e-6 * values[here],
                "--",
                color=_colour("ink"),
                linewidth=1.0,
                label="rod" if m == 1 else None,
            )
    axes.set_xlabel("arc length in mm")
    axes.set_ylabel("axial stress at the surface in MPa")
    axes.set_title("Largest axial stress; what stands out at disks' edges is the clamps'")
    axes.set_ylim(bottom=0.0)
    axes.legend(loc="lower left")
    return figure
