"""Figures of mode shapes, from the side and from the front."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from bowstring.aliases import Floats
from bowstring.robot.model import Robot
from bowstring.viz.style import LIGHT, WIDTH
from bowstring.viz.vtk import circle

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.dynamics.modal import Modes

_SWAY: Final = 0.12  # largest drawn displacement over length
_TURN: Final = {"bending": 0.6, "torsion": 1.2, "axial": 0.6}  # rad; largest drawn rotation


def draw_modes(modes: Modes) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """Draw mode shapes one by one, from the side and from the front.

    Yields
    ------
    stem : str
        File name without suffix, ``mode_01`` and so on.
    draw : callable
        Makes the figure, to be called and saved within `figure_style`.
    """
    for k in range(len(modes)):
        yield f"mode_{k + 1:0{max(2, len(str(len(modes))))}d}", partial(_mode, modes, k)


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
        modes.orientation @ Rotation.from_rotvec(scale * turn).as_matrix(),
    )
    if modes.kind[k] == "torsion":
        drawn = f"drawn with {math.degrees(scale * spin):.0f} deg at the largest rotation"
    else:
        drawn = f"drawn with {1e3 * scale * size:.3g} mm at the largest displacement"

    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    for axes, across, title in zip(panels, (0, 1), ("side", "front"), strict=True):
        for lines, colour, dash, label in (
            (rest, "muted", "--", "equilibrium"),
            (moved, "blue", "-", "mode shape"),
        ):
            style: dict[str, Any] = {"color": LIGHT[colour], "linestyle": dash}
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


def _shape(robot: Robot, position: Floats, frames: Floats) -> list[tuple[Floats, float]]:
    """Lines of a robot in m with their widths: backbone, rims of the disks, tendons."""
    position = np.concatenate([np.zeros((1, 3)), position])
    frames = np.concatenate([np.eye(3)[None], frames])
    # a cubic between two disks, tangent to their axes
    chords = np.linalg.norm(np.diff(position, axis=0), axis=1)
    ends = np.concatenate([[0.0], np.cumsum(chords)])
    places = np.linspace(ends[:-1], ends[1:], 9, axis=1).ravel()
    backbone = CubicHermiteSpline(ends, position, frames[:, :, 2])
    lines: list[tuple[Floats, float]] = [(backbone(places), 2.0)]
    every = max(1, len(position) // 60)
    for i in range(len(position) - 1, 0, -every):
        radius = float(robot.disks.radius_m[i - 1])
        rim = radius * circle(33, closed=True)
        lines.append((position[i] + rim @ frames[i].T, 0.8))
    lines += [(points, 0.8) for points in robot.tendon_points(position[1:], frames[1:])]
    return lines
