"""Drawing of the spacer disks with holes and dimensions."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.robot.disk import outside_bore
from bowstring.robot.model import Robot, check_round
from bowstring.robot.sizes import Sizes, sizes_of
from bowstring.units import rounded
from bowstring.viz.style import LIGHT, check_figure_file, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SUFFIXES: Final = (".svg", ".pdf", ".png")
_DPI: Final = 200
_MOST: Final = 12  # kinds of disks in one drawing
_MOST_PLACES: Final = 14  # holes in a list
_MM: Final = 1e3
_INK, _MUTED, _PLATE, _PAPER = (LIGHT[name] for name in ("ink", "muted", "grid", "paper"))
_THIN: Final = {"color": _MUTED, "linewidth": 0.6}
_CENTRE: Final = {**_THIN, "dashes": (10, 2, 2, 2)}
_ARROW: Final = {
    "arrowstyle": "-|>,head_width=0.12,head_length=0.3",
    "color": _INK,
    "lw": 0.6,
    "shrinkB": 0,
}


class _Kind(NamedTuple):
    """Equal disks; mm."""

    disks: tuple[int, ...]  # numbers, from 1
    radius: float
    thickness: float
    bore: float
    hole: float
    places: Floats
    assumed: bool


def check_drawing_file(path: str | Path) -> Path:
    """Check before any work that a drawing may be written (`atomic_io.check_file`)."""
    return check_figure_file(path, "drawing", _SUFFIXES)


def write_drawing(robot: Robot, path: str | Path) -> Path:
    """Write a drawing of the robot's disks as ``.svg``, ``.pdf`` or ``.png``.

    Parameters
    ----------
    robot : Robot
    path : str or Path

    Returns
    -------
    Path
        Absolute path of the file. Equal disks are drawn once.

    Raises
    ------
    InputError
        If the suffix is another one, the file cannot be written, a size is impossible (`sizes_of`)
        or the robot has more than 12 kinds of disks.
    """
    return write_figure(lambda: draw_disks(robot), path, "drawing", _DPI, _SUFFIXES)


def check_drawing(robot: Robot) -> None:
    """Check before any work that the disks can be drawn; raises as `write_drawing` does."""
    check_round(robot, "a drawing of disks")
    _drawn_kinds(robot)


def draw_disks(robot: Robot) -> Figure:
    """Draw the disks as a matplotlib figure; see `write_drawing`."""
    from matplotlib.figure import Figure

    check_round(robot, "a drawing of disks")
    kinds = _drawn_kinds(robot)
    title = textwrap.wrap(f"{robot.name}: spacer disks, in mm", 65)
    row, head, foot = 3.3, 0.28 + 0.17 * len(title), 0.25  # inches
    high = head + row * len(kinds) + foot
    figure = Figure(figsize=(6.4, high))
    figure.text(0.03, 1.0 - 0.14 / high, "\n".join(title), va="top", fontsize=10)
    for i, kind in enumerate(kinds):
        low = (foot + row * (len(kinds) - 1 - i)) / high
        axes: Any = figure.add_axes((0.0, low, 1.0, row / high))
        _draw(axes, kind)
    if any(kind.assumed for kind in kinds):
        figure.text(
            0.03,
            0.1 / high,
            "* assumed: the robot file does not say it",
            fontsize=7.5,
            color=LIGHT["muted"],
        )
    return figure


def _drawn_kinds(robot: Robot) -> list[_Kind]:
    kinds = _kinds(robot, sizes_of(robot))
    if len(kinds) > _MOST:
        raise InputError(
            f"{robot.name} has {len(kinds)} kinds of disks; a drawing holds up to {_MOST}"
        )
    return kinds


def _kinds(robot: Robot, sizes: Sizes) -> list[_Kind]:
    groups: dict[tuple[Any, ...], list[int]] = {}
    disks = robot.disks
    holes: list[Floats] = []
    for d in range(len(disks.station_m)):
        k = int(disks.segment[d])
        holes.append(_MM * outside_bore(robot.holes(k, d), disks.bore_m[d]))
        size = (disks.radius_m[d], disks.thickness_m[d], disks.bore_m[d], sizes.hole_m[k])
        alike = (*map(float, size), d)
        same = (key for key in groups if key[:4] == alike[:4] and _same(holes[key[4]], holes[d]))
        groups.setdefault(next(same, alike), []).append(d + 1)
    return [
        _Kind(
            tuple(numbers),
            _MM * radius,
            _MM * thickness,
            _MM * bore,
            _MM * hole,
            holes[d],
            robot.segments[int(disks.segment[d])].disks.hole_diameter is None,
        )
        for (radius, thickness, bore, hole, d), numbers in groups.items()
    ]


def _same(a: Floats, b: Floats) -> bool:
    return a.shape == b.shape and bool(np.allclose(a, b, rtol=0, atol=1e-6))


def _numbers(disks: tuple[int, ...]) -> str:
    """Names such as `disk 3`, `disks 1 to 9`, `disks 1, 2 and 5`."""
    if len(disks) == 1:
        return f"disk {disks[0]}"
    if disks == tuple(range(disks[0], disks[-1] + 1)):
        return f"disks {disks[0]} to {disks[-1]}"
    return f"disks {listed([*map(str, disks)])}"


def _size(value: float) -> str:
    return rounded(value, 6)  # the precision of a robot file


def _degrees(value: float) -> str:
    return f"{round(value, 2):g}°"


def _draw(axes: Any, kind: _Kind) -> None:
    """Draw a front view, and beside it a section through the axis and the first hole."""
    from matplotlib.patches import Circle, Rectangle

    r = kind.radius
    star = "*" if kind.assumed else ""
    at = 2.5 * r + kind.thickness / 2
    axes.set(
        xlim=(-1.75 * r, max(3.35 * r, at + kind.thickness / 2 + 0.75 * r)),
        ylim=(-1.32 * r, 1.32 * r),
        aspect="equal",
    )
    axes.set_axis_off()
    cut = {"facecolor": _PAPER, "edgecolor": _INK, "linewidth": 1.1}

    axes.add_patch(Circle((0, 0), r, facecolor=_PLATE, edgecolor=_INK, linewidth=1.3))
    axes.add_patch(Circle((0, 0), kind.bore / 2, **cut))
    for x, y in kind.places:
        axes.add_patch(Circle((x, y), kind.hole / 2, **cut))
        reach = max(kind.hole, 0.05 * r)
        out = np.array([x, y]) / math.hypot(x, y)
        across = np.array([-out[1], out[0]])
        for way in (out, across):
            ends = np.stack([[x, y] - reach * way, [x, y] + reach * way])
            axes.plot(*ends.T, **_THIN)
    for line in (([-1.12 * r, 1.12 * r], [0, 0]), ([0, 0], [-1.12 * r, 1.12 * r])):
        axes.plot(*line, **_CENTRE)
    pitches = sorted({round(math.hypot(x, y), 6) for x, y in kind.places})
    for pitch in pitches:
        dashes = (0, (10, 3, 2, 3))
        circle = Circle(
            (0, 0), pitch, fill=False, edgecolor=_MUTED, linewidth=0.6, linestyle=dashes
        )
        axes.add_patch(circle)
    beside = {"textcoords": "offset points", "fontsize": 8}
    axes.annotate("x", (1.12 * r, 0), xytext=(2, 0), va="center", **beside)
    axes.annotate("y", (0, 1.12 * r), xytext=(0, 1), ha="center", **beside)
    axes.text(-1.7 * r, 1.28 * r, _numbers(kind.disks), va="top", fontsize=9, color=_INK)

    # dimensions of the front view on leaders from its lower left and upper right
    rim = (-r * math.cos(0.6), r * math.sin(0.6))
    _leader(axes, rim, (-1.2 * r, 1.02 * r), f"Ø{_size(2 * r)}")
    bore = kind.bore / 2
    _leader(axes, (-bore * 0.7, -bore * 0.7), (-1.2 * r, -0.75 * r), f"Ø{_size(kind.bore)}")
    if len(kind.places):
        x, y = kind.places[kind.places.sum(axis=1).argmax()]  # the hole nearest its text
        count = f"{len(kind.places)} x " if len(kind.places) > 1 else ""
        on = " / ".join(f"Ø{_size(2 * pitch)}" for pitch in pitches[:3]) + (
            " ..." if pitches[3:] else ""
        )
        label = f"{count}Ø{_size(kind.hole)}{star}\non {on}"
        _leader(axes, (x, y), (1.22 * r, 0.85 * r), label)
        write = _angles if _evenly_spaced(kind.places) else _places
        write(axes, kind)

    # section at x = 0, seen along x
    half = kind.thickness / 2
    left, right = at - half, at + half
    for high, paint, width in ((r, _PLATE, 1.1), (bore, _PAPER, 0.9)):
        rectangle = Rectangle((left, -high), 2 * half, 2 * high, linewidth=width)
        rectangle.set(facecolor=paint, edgecolor=_INK)
        axes.add_patch(rectangle)
    for y in sorted({round(float(y), 6) for _, y in kind.places}):
        for edge in (y - kind.hole / 2, y + kind.hole / 2):
            axes.plot([left, right], [edge, edge], **_THIN, dashes=(4, 2))
    axes.plot([left - 0.2 * r, right + 0.2 * r], [0, 0], **_CENTRE)
    _span(axes, (left, right), -1.1 * r, _size(kind.thickness), r)


def _leader(axes: Any, tip: tuple[float, float], text_at: tuple[float, float], text: str) -> None:
    left = text_at[0] < tip[0]
    axes.annotate(
        text,
        xy=tip,
        xytext=text_at,
        fontsize=8.5,
        ha="right" if left else "left",
        va="center",
        color=_INK,
        arrowprops={**_ARROW, "shrinkA": 1, "relpos": (1.0 if left else 0.0, 0.5)},
    )


def _angles_of(places: Floats) -> Floats:
    """Angles of holes (H, 2) from x, 0 to below 360 degrees."""
    angles = np.degrees(np.arctan2(places[:, 1], places[:, 0])) % 360.0
    angles[np.isclose(angles, 360.0, atol=1e-6)] = 0.0
    return angles


def _evenly_spaced(places: Floats) -> bool:
    """Whether all holes are evenly spaced on one circle."""
    pitch, angles = np.hypot(*places.T), np.sort(_angles_of(places))
    steps = np.diff([*angles, angles[0] + 360.0])
    return bool(np.ptp(pitch) < 1e-6 * pitch.max() and np.ptp(steps) < 1e-4)


def _places(axes: Any, kind: _Kind) -> None:
    """Number the holes counter-clockwise from x, and list their positions."""
    angles, pitch = _angles_of(kind.places), np.hypot(*kind.places.T)
    order = np.lexsort((pitch, angles)).tolist()
    r, same = kind.radius, np.ptp(pitch) < 1e-6 * pitch.max()
    rows = []
    for number, i in enumerate(order[:_MOST_PLACES], 1):
        inner = 1.0 - (kind.hole / 2 + 0.085 * r) / pitch[i]  # share of the distance to the hole
        axes.text(
            *(inner * kind.places[i]),
            str(number),
            fontsize=6.5,
            ha="center",
            va="center",
            color=_INK,
            bbox={"facecolor": _PLATE, "edgecolor": "none", "pad": 0.3},
        )
        on = "" if same else f" on Ø{_size(2 * float(pitch[i]))}"
        rows.append(f"{number}: {_degrees(float(angles[i]))}{on}")
    if order[_MOST_PLACES:]:
        rows.append(f"and {len(order) - _MOST_PLACES} more")
    text = "\n".join(rows)
    axes.text(1.3 * r, 0.55 * r, text, fontsize=7.5, va="top", color=_INK, linespacing=1.15)


def _angles(axes: Any, kind: _Kind) -> None:
    """Dimension the angle of the first hole from x, and that to the next one."""
    angles = np.sort(_angles_of(kind.places))
    r = kind.radius
    marks = [(0.0, float(angles[0]), 0.34)] if angles[0] > 1e-6 else []
    if len(angles) > 1:
        marks.append((float(angles[0]), float(angles[1]), 0.5))
    for start, end, share in marks:
        turn = np.radians(np.linspace(start, end, 60))
        axes.plot(share * r * np.cos(turn), share * r * np.sin(turn), color=_INK, linewidth=0.6)
        for angle in {start, end} - {0.0}:
            c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
            axes.plot([0, r * c], [0, r * s], **_CENTRE)
        mid = math.radians(0.5 * (start + end))
        axes.text(
            (share + 0.02) * r * math.cos(mid),
            (share + 0.02) * r * math.sin(mid),
            _degrees(end - start),
            fontsize=8,
            ha="left" if math.cos(mid) > 0 else "right",
            va="bottom" if math.sin(mid) > -0.2 else "top",
            color=_INK,
            bbox={"facecolor": _PLATE, "edgecolor": "none", "pad": 0.5},
        )


def _span(axes: Any, ends: tuple[float, float], y: float, text: str, r: float) -> None:
    """Dimension between two edges, with outside arrows because the plate is thin."""
    for x, way in ((ends[0], -1), (ends[1], 1)):
        axes.plot([x, x], [-1.02 * r, y - 0.05 * r], **_THIN)
        axes.annotate(
            "",
            xy=(x, y),
            xytext=(x + way * 0.3 * r, y),
            arrowprops={**_ARROW, "shrinkA": 0},
        )
    axes.text(ends[1] + 0.34 * r, y, text, fontsize=8.5, va="center", color=_INK)
