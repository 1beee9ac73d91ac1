"""Drawings of a robot's geometry: the symbols of an arc, the spaces and maps, and one module."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.formatting import in_mm, significant
from bowstring.study.equations import ring_of
from bowstring.study.first_segment import FirstSegment, first_segment
from bowstring.study.study import Study
from bowstring.viz.style import LIGHT, WIDTH

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_ELL, _RHO = "\N{SCRIPT SMALL L}", "\N{GREEK SMALL LETTER RHO}"
_MM: Final = 1e3
_FAR: Final = 1.6  # distance over arc length beyond which a centre is not drawn
_LINES: Final = ("-", "--", ":", "-.")
_COLOURS: Final = ("red", "blue", "amber", "purple", "green")
_LINE: Final = 0.155  # height of a line of the key, inches
_MOST: Final = 8  # tendons with their own line in the key


def draw_arc(study: Study) -> Figure:
    """Draw the arc of the segment at the base in its bending plane, and the base from above.

    Returns
    -------
    matplotlib.figure.Figure
        To scale, in mm, at the largest load that has an equilibrium; the key has the numbers.
    """
    segment = first_segment(study)
    figure = _figure(4.4)
    side: Any = figure.add_axes((0.01, 0.37, 0.60, 0.60))
    above: Any = figure.add_axes((0.06, 0.01, 0.46, 0.35))
    for axes in (side, above):
        axes.set_axis_off()
        axes.set_aspect("equal")
    _arc_from_the_side(side, segment)
    _base_from_above(above, study, segment)
    number = " of segment 1" if len(study.robot.segments) > 1 else ""
    end = segment.arcs.disk_positions[len(segment.stations) - 1] * _MM
    place = ", ".join(f"{v + 0.0:.4g}" for v in np.round(end, 6))
    bent = not segment.straight
    radius = in_mm(segment.length / segment.theta) if bent else "infinite"
    kappa = significant(segment.theta / segment.length)
    angle = significant(round(math.degrees(segment.phi), 6) + 0.0, 4)
    rows = [
        ("", f"{study.settings.actuated}\nat {significant(segment.tension)} N", "ink"),
        (_ELL, f"arc length{number}\n{significant(segment.length * _MM, 4)} mm", "ink"),
        ("θ", f"bend angle\n{significant(math.degrees(segment.theta))}°", "red"),
        (_RHO, f"radius 1/κ of the arc\n{radius}\nκ = {kappa} 1/m", "blue"),
        ("p", f"{'end disk' if number else 'tip'} at x, y, z\n({place}) mm", "green"),
        ("φ", f"direction of bending,\nfrom x: {angle}°", "purple"),
        ("r", _pitch_radii(study), "amber"),
    ]
    _key(figure, rows)
    return figure


def _arc_from_the_side(axes: Axes, segment: FirstSegment) -> None:
    length, theta = segment.length * _MM, max(segment.theta, 1e-9)
    radius = length / theta
    turn = np.linspace(0.0, theta, 100)
    arc = radius * np.stack([1.0 - np.cos(turn), np.sin(turn)])
    tip, tangent = arc[:, -1], np.array([math.sin(theta), math.cos(theta)])
    inward = np.array([math.cos(theta), -math.sin(theta)])
    unit = 0.22 * length
    axes.plot(*arc, color=LIGHT["ink"], linewidth=2.2)
    _write(axes, arc[:, 50], _ELL, (-9 * math.cos(theta / 2), 9 * math.sin(theta / 2)))

    # the radii, cut off if the centre is far away
    reach = radius if radius <= _FAR * length else 0.4 * length
    dashes: dict[str, Any] = {"color": LIGHT["blue"], "linewidth": 1.0, "linestyle": "--"}
    if not segment.straight:
        for start, way in ((np.zeros(2), np.array([1.0, 0.0])), (tip, inward)):
            end = start + reach * way
            axes.plot(*np.stack([start, end], axis=1), **dashes)
            if reach < radius:
                _arrow(axes, end, end + 0.08 * length * way, "blue")
        if reach == radius:
            axes.plot(radius, 0.0, "+", color=LIGHT["blue"], markersize=8)
            size = min(0.3 * radius, 0.3 * length)
            swept = np.pi - turn
            axes.plot(
                radius + size * np.cos(swept), size * np.sin(swept), color=LIGHT["red"], lw=1.0
            )
            middle = np.pi - theta / 2
            place = np.array([radius + size * math.cos(middle), size * math.sin(middle)])
            _write(axes, place, "θ", (9 * math.cos(middle), 9 * math.sin(middle)), "red")
        _write(axes, tip + 0.5 * reach * inward, _RHO, tuple(8 * tangent), "blue")
    # base frame, and at the end the direction of the base and the tangent
    for way, name in ((np.array([1.0, 0.0]), "towards φ"), (np.array([0.0, 1.0]), "z")):
        _arrow(axes, np.zeros(2), unit * way, "ink")
        shift = (4, 8) if name == "z" else (0, -9)
        _write(axes, unit * way, name, shift, "ink")
    axes.plot(
        *np.stack([tip, tip + unit * np.array([0.0, 1.0])], axis=1),
        color=LIGHT["muted"],
        linewidth=0.8,
        linestyle=":",
    )
    _arrow(axes, tip, tip + unit * tangent, "muted")
    turned = np.linspace(0.0, theta, 40)
    axes.plot(
        *(tip[:, None] + 0.6 * unit * np.stack([np.sin(turned), np.cos(turned)])),
        color=LIGHT["red"],
        linewidth=1.0,
    )
    half = np.array([math.sin(theta / 2), math.cos(theta / 2)])
    _write(axes, tip + 0.6 * unit * half, "θ", tuple(8 * half), "red")
    axes.plot(*tip, "o", color=LIGHT["green"], markersize=5)
    _write(axes, tip, "p", tuple(-10 * inward), "green")
    axes.plot([-0.09 * length, 0.09 * length], [0.0, 0.0], color=LIGHT["ink"], linewidth=3.0)
    axes.margins(0.1)


def _base_from_above(axes: Axes, study: Study, segment: FirstSegment) -> None:
    """Draw the x-y plane of the base frame with the holes, seen from the tip."""
    from matplotlib.patches import Circle

    robot = study.robot
    disk = robot.segments[0].disks.radius * _MM
    axes.add_patch(Circle((0, 0), disk, facecolor="none", edgecolor=LIGHT["muted"], linewidth=1.0))
    rod = 0.5 * robot.segments[0].backbone.outer_diameter * _MM
    axes.add_patch(Circle((0, 0), rod, facecolor=LIGHT["grid"], edgecolor=LIGHT["ink"], lw=0.8))
    for way, name in ((np.array([1.0, 0.0]), "x"), (np.array([0.0, 1.0]), "y")):
        _arrow(axes, np.zeros(2), 1.25 * disk * way, "ink")
        _write(axes, 1.25 * disk * way, name, (7 * way[1], -7 * way[0]))
    bend = np.array([math.cos(segment.phi), math.sin(segment.phi)])
    if not segment.straight:
        _arrow(axes, np.zeros(2), 1.7 * disk * bend, "purple", wide=True)
        across = np.array([-bend[1], bend[0]])
        _write(axes, 1.6 * disk * bend, "φ", tuple(9 * across), "purple")
    for names, hole in _holes(study):
        hole = hole * _MM
        actuated = any(study.settings.shares[t] for t in names)
        colour = "red" if actuated else "blue"
        axes.plot(*hole, "o", color=LIGHT[colour], markersize=4)
        size = float(np.linalg.norm(hole))
        out = hole / size if size else np.array([0.0, -1.0])
        if max(float(out @ way) for way in (*np.eye(2), bend)) > 0.97:  # an arrow is there
            out = np.array([[0.96, -0.28], [0.28, 0.96]]) @ out
        _write(axes, disk * out, _numbers(names), tuple(8 * out), colour)
    first = robot.tendons.hole_m[segment.tendons[-1]] * _MM
    if first.any():
        axes.plot(*np.stack([np.zeros(2), first], axis=1), color=LIGHT["amber"], linewidth=1.0)
        way = first / np.linalg.norm(first)
        _write(axes, 0.55 * first, "r", (-7 * way[1], 7 * way[0]), "amber")
    axes.margins(0.12)


def draw_spaces(study: Study) -> Figure:
    """Draw the spaces of constant curvature and the maps between them, with numbers.

    Returns
    -------
    matplotlib.figure.Figure
        Of the segment at the base, at the largest load that has an equilibrium.
    """
    from matplotlib.patches import FancyBboxPatch

    segment = first_segment(study)
    arcs, robot = segment.arcs, study.robot
    lengths = study.statics.tendon_lengths[segment.load][segment.tendons] * _MM
    listing = ", ".join(f"{v:.4g}" for v in lengths[:_MOST]) + " ..." * (len(lengths) > _MOST)
    of_one = ", segment 1" if len(robot.segments) > 1 else ""
    end = ", ".join(
        f"{v + 0.0:.4g}" for v in np.round(arcs.disk_positions[len(segment.stations) - 1] * _MM, 6)
    )
    kappa = significant(segment.theta / segment.length)
    phi = significant(round(math.degrees(segment.phi), 6) + 0.0, 4)
    theta = significant(math.degrees(segment.theta))
    load = f"{study.settings.actuated} at {significant(segment.tension)} N"
    ring = ring_of(study, segment) is not None  # else Eqs. 2 to 5 do not hold
    boxes = [
        (f"Actuator space: tensions\n{load}", "purple"),
        (f"Actuator space: tendon lengths (mm)\n{listing}", "red"),
        (
            f"Configuration space{of_one}\nφ {phi}°,  θ {theta}°,  κ {kappa} 1/m,  "
            f"{_ELL} {segment.length * _MM:.4g} mm",
            "blue",
        ),
        (f"Task space: {'end disk' if of_one else 'tip'} at x, y, z\n({end}) mm", "green"),
    ]
    maps = [
        "physics: statics",
        "map of this robot" + ": Eqs. 2 to 4" * ring,
        "map of any arc: Eq. 1",
    ]
    if not segment.from_lengths:  # no arc has these lengths
        del boxes[1], maps[0]
        maps[0] = "map of this robot: linear law"
    figure = _figure(0.95 * len(boxes) - 0.25)
    axes: Any = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, 1.0))
    axes.set_ylim(0.35 - len(boxes), 0.35)
    axes.set_axis_off()
    left, right = 0.1, 0.9
    for k, (text, colour) in enumerate(boxes):
        look: dict[str, Any] = {"facecolor": "none", "edgecolor": LIGHT[colour]}
        style = "round,pad=0,rounding_size=0.04"
        axes.add_patch(FancyBboxPatch((left, -k - 0.29), right - left, 0.58, style, **look))
        axes.text(0.5, -k, text, fontsize=9, ha="center", va="center", linespacing=1.4)
    for k, text in enumerate(maps):
        _arrow(axes, np.array([0.5, -k - 0.31]), np.array([0.5, -k - 0.69]), "ink")
        axes.text(0.53, -k - 0.5, text, fontsize=8.5, va="center")
    past = [(left, 0.03, 0, "linear law")] if segment.from_lengths else []
    past += [(right, 0.97, 1, "Eq. 5")] if ring and segment.from_lengths else []
    for edge, place, start, text in past:  # past the tendon lengths, past the configuration
        path = np.array([[edge, -start], [place, -start], [place, -start - 2], [edge, -start - 2]])
        axes.plot(*path[:3].T, color=LIGHT["amber"], linewidth=1.0)
        _arrow(axes, path[2], path[3], "amber")
        _write(axes, np.array([place, -start - 1.0]), text, (0, 0), "amber")
        axes.texts[-1].set_rotation(90)
    return figure


def draw_module(study: Study) -> Figure:
    """Draw one module of the segment at the base in its bending plane: disks and straight spans.

    Returns
    -------
    matplotlib.figure.Figure
        To scale; the key has the numbers. The second module, because the first one has no disk at
        its start; of a single module, that one.
    """
    segment = first_segment(study)
    robot, theta = study.robot, segment.theta
    part, k = robot.segments[0], min(1, len(segment.stations) - 1)
    ends = np.concatenate([[0.0], segment.stations])
    share = (ends[k + 1] - ends[k]) / segment.stations[-1]
    turn, size = theta * share, segment.length * share * _MM
    bend = np.array([math.cos(segment.phi), math.sin(segment.phi)])

    def at(s: float) -> tuple[Floats, Floats, Floats]:
        """Position, normal and tangent at a share of the module."""
        angle = turn * s
        f = size * s * float(np.sinc(angle / (2 * math.pi)))  # chord
        place = f * np.array([math.sin(angle / 2), math.cos(angle / 2)])
        across = np.array([math.cos(angle), -math.sin(angle)])
        return place, across, np.array([math.sin(angle), math.cos(angle)])

    # tendons with equal distances from the backbone in the bending plane coincide
    by_distance: dict[float, list[int]] = {}
    for names, hole in _holes(study):
        by_distance.setdefault(round(float(hole @ bend) * _MM, 6), []).extend(names)
    spans = []
    for i, (distance, names) in enumerate(sorted(by_distance.items(), reverse=True)):
        ends_of_span = np.array([at(s)[0] + distance * at(s)[1] for s in (0.0, 1.0)])
        spans.append((distance, names, ends_of_span, _COLOURS[i % len(_COLOURS)]))
    high, radius = part.disks.thickness * _MM, part.disks.radius * _MM
    clamp = part.disks.clamped_length
    number = ", segment 1" if len(robot.segments) > 1 else ""
    rows = [
        ("", f"module {k + 1} of {len(segment.stations)}{number}", "ink"),
        ("s", f"arc length of the\nmodule {significant(size, 4)} mm", "ink"),
        ("a", f"bend angle of the module\n{significant(math.degrees(turn))}°", "red"),
        ("R", f"disk radius\n{in_mm(radius / _MM)}", "muted"),
        ("t", f"disk thickness\n{in_mm(high / _MM)}", "muted"),
    ]
    if part.backbone.outer_diameter:
        rows.append(("ø", f"backbone, diameter\n{in_mm(part.backbone.outer_diameter)}", "ink"))
    if part.disks.hole_diameter is not None:
        rows.append(("", f"holes, diameter\n{in_mm(part.disks.hole_diameter)}", "muted"))
    if clamp:
        rows.append(("c", f"clamped by each disk\n{in_mm(clamp)}", "purple"))
    rows.append(("d", "offset of a tendon from\nthe axis", "ink"))
    for distance, names, (low, top), colour in spans[:_MOST]:
        which = f"tendon{'s' * (len(names) > 1)} {_numbers(names)}"
        span = float(np.linalg.norm(top - low))
        rows.append(("", f"{which}:\nd {distance:.4g}, span {span:.4g} mm", colour))
    if spans[_MOST:]:
        rows.append(("", "and further tendons", "ink"))

    figure = _figure(max(3.0, _key_height(rows)))
    axes: Any = figure.add_axes((0.01, 0.02, 0.58, 0.95), anchor="N")
    axes.set_axis_off()
    axes.set_aspect("equal")
    look: dict[str, Any] = {"facecolor": LIGHT["grid"], "edgecolor": LIGHT["ink"], "lw": 1.0}
    for share_of_module in (0.0, 1.0):
        place, across, onward = at(share_of_module)
        half = max(0.5 * high, 0.004 * radius) * onward
        corners = [-radius * across - half, radius * across - half]
        corners += [radius * across + half, -radius * across + half]
        if share_of_module == 1.0 or k > 0:
            axes.fill(*(place + np.array(corners)).T, **look)
        else:
            ground = np.stack([place - radius * across, place + radius * across], axis=1)
            axes.plot(*ground, color=LIGHT["ink"], linewidth=3.0)
    line = np.stack([at(s)[0] for s in np.linspace(0.0, 1.0, 60)], axis=1)
    axes.plot(*line, color=LIGHT["ink"], linewidth=2.4)
    if clamp:
        _clamps(axes, at, clamp * _MM / size, k > 0)
    for i, (_, names, (low, top), colour) in enumerate(spans):
        ends_of_span = np.stack([low, top], axis=1)
        dashes = _LINES[i % len(_LINES)]
        axes.plot(*ends_of_span, dashes, color=LIGHT[colour], linewidth=1.5)
        axes.plot(*ends_of_span, "o", color=LIGHT[colour], markersize=3.5)
        up = (0.35, 0.5, 0.65)[i % 3]  # neighbours do not cover each other
        _write(axes, (1 - up) * low + up * top, _numbers(names), (0, 0), colour)
    distance, _, _, colour = spans[0]
    if abs(distance) > 0.1 * radius:
        below = at(0.0)[0] - np.array([0.0, 0.5 * high + 0.12 * radius])
        beside = below + distance * at(0.0)[1]
        _arrow(axes, below, beside, colour)
        _arrow(axes, beside, below, colour)
        _write(axes, 0.5 * (below + beside), "d", (0, -8), colour)
    _module_sizes(axes, at, radius, high)
    axes.margins(0.1)
    _key(figure, rows)
    return figure


def _module_sizes(axes: Axes, at: Any, radius: float, high: float) -> None:
    """Write the letters of the key at the lengths that they name."""
    (start, across, _), (end, turned, onward) = at(0.0), at(1.0)
    middle, normal, _ = at(0.5)
    _write(axes, middle, "s", tuple(7 * normal))
    low = start - radius * across
    top = end - radius * turned
    _write(axes, low, "t", (-8, 0), "muted")
    _write(axes, 0.5 * (top + end) + 0.5 * high * onward, "R", tuple(8 * onward), "muted")
    _write(axes, end + 0.5 * high * onward, "ø", tuple(8 * onward), "ink")
    # the planes of the two disks meet at the angle a: shown at the end, against the start's
    reach = 1.12 * radius
    axes.plot(
        *np.stack([end, end + reach * across], axis=1),
        color=LIGHT["red"],
        linewidth=0.8,
        linestyle=":",
    )
    axes.plot(*np.stack([end, end + reach * turned], axis=1), color=LIGHT["red"], linewidth=0.8)
    _write(axes, end + reach * 0.5 * (across + turned), "a", (8, 0), "red")


def _clamps(axes: Axes, at: Any, share: float, both: bool) -> None:
    for s, way in ((0.0, 1.0), (1.0, -1.0)):
        if s == 1.0 or both:
            ends = np.stack([at(s)[0], at(s + way * min(0.5 * share, 0.5))[0]], axis=1)
            axes.plot(*ends, color=LIGHT["purple"], linewidth=5.0, solid_capstyle="butt")


# -- parts of drawings ---------------------------------------------------------------------------


def _figure(height: float) -> Figure:
    from matplotlib.figure import Figure

    return Figure(figsize=(WIDTH, height))


def _holes(study: Study) -> list[tuple[list[int], Floats]]:
    """Places of the holes in the first segment's disks (m), each with its tendons from 0."""
    out: list[tuple[list[int], Floats]] = []
    for t, hole in enumerate(study.robot.tendons.hole_m):
        same = next((names for names, at in out if np.linalg.norm(at - hole) < 1e-9), None)
        if same is None:
            out.append(([t], hole))
        else:
            same.append(t)
    return out


def _numbers(tendons: Sequence[int]) -> str:
    return ", ".join(str(t + 1) for t in sorted(tendons))


def _pitch_radii(study: Study) -> str:
    radii = sorted({float(f"{r:.6g}") for r in study.robot.tendons.pitch_radius_m})
    if len(radii) == 1:
        return f"pitch radius\n{in_mm(radii[0])}"
    return f"pitch radii\n{in_mm(radii[0])} to {in_mm(radii[-1])}"


def _arrow(axes: Axes, start: Floats, end: Floats, colour: str, wide: bool = False) -> None:
    axes.plot(*np.stack([start, end], axis=1), linestyle="none")  # for the limits of the axes
    axes.annotate(
        "",
        xy=tuple(end),
        xytext=tuple(start),
        arrowprops={
            "arrowstyle": "-|>,head_width=0.18,head_length=0.4",
            "color": LIGHT[colour],
            "lw": 1.4 if wide else 1.0,
            "shrinkA": 0,
            "shrinkB": 0,
        },
    )


def _write(
    axes: Axes, place: Floats, text: str, shift: Sequence[float], colour: str = "ink"
) -> None:
    axes.annotate(
        text,
        tuple(place),
        xytext=(shift[0], shift[1]),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=9,
        color=LIGHT[colour],
        zorder=5,
        bbox={"facecolor": LIGHT["paper"], "edgecolor": "none", "pad": 0.6},
    )


def _key_height(rows: Sequence[tuple[str, str, str]]) -> float:
    """Height of a figure that holds a key, inches."""
    return 0.35 + _LINE * sum(text.count("\n") + 1.35 for _, text, _ in rows)


def _key(figure: Figure, rows: Sequence[tuple[str, str, str]]) -> None:
    """Write the key at the right: letters, their meanings and values."""
    line = _LINE / figure.get_figheight()
    place = 1.0 - 0.15 / figure.get_figheight()
    for letter, text, colour in rows:
        figure.text(0.60, place, letter, color=LIGHT[colour], fontsize=9.5, va="top", weight="bold")
        figure.text(0.64, place, text, color=LIGHT[colour], fontsize=8, va="top", linespacing=1.15)
        place -= line * (text.count("\n") + 1.35)
