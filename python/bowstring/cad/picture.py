"""Rendered picture of a robot's solid, in perspective, with labelled parts."""

from __future__ import annotations

import math
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.cad.raster import Camera, Mesh, render
from bowstring.cad.solid import MESHED, Part, Solid, triangulate
from bowstring.robot.rest_shape import unloaded_pose
from bowstring.viz.style import LIGHT, check_figure_file, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["check_picture_file", "draw_solid", "mesh_of", "write_picture"]

_DPI: Final = 220
_PIXELS: Final = 1300  # pixels of the longer side
_LETTERS: Final = 11.5  # characters of the title per inch
_ELEVATION: Final = math.radians(17.0)
_ASIDE: Final = math.radians(-48.0)  # angle of the eye from the plane of bending
_DEFLECTION: Final = 2e-4  # distance of the mesh from the surface over the robot's length
_ANGLE: Final = 0.3  # rad
_MOST_NAMED: Final = 6  # tendons
_SMOOTH: Final = 0.8  # least cosine between normals of one smooth surface


def check_picture_file(path: str | Path) -> Path:
    """Check before any work that a picture may be written (`atomic_io.check_file`)."""
    return check_figure_file(path, "picture")


def write_picture(solid: Solid, path: str | Path) -> Path:
    """Render a solid to ``.png``, ``.pdf`` or ``.svg``, whole or not at all.

    Parameters
    ----------
    solid : Solid
        Solid from `make_solid`.
    path : str or Path
        Path of the picture; an existing picture is replaced.

    Returns
    -------
    Path
        Absolute path of the file.

    Raises
    ------
    InputError
        If the suffix is another one, or the file cannot be written.
    """
    return write_figure(lambda: draw_solid(solid), path, "picture", _DPI)


def draw_solid(solid: Solid, pixels: int = _PIXELS) -> Figure:
    """Draw the picture as a matplotlib figure.

    Parameters
    ----------
    solid : Solid
    pixels : int
        Pixels of the longer side of the rendered image.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    mesh = mesh_of(solid.parts)
    camera = Camera(mesh.points, _azimuth(solid), _ELEVATION, pixels)
    colours = np.array([to_rgb(part.colour) for part in solid.parts])
    outlined = np.array([part.kind != "tendon" for part in solid.parts])
    image, seen = render(mesh, camera, colours, outlined)
    left, right, bottom = 0.05, 0.26, 0.04  # margins, as shares of the longer side
    long = max(camera.width, camera.height)
    width = camera.width + (left + right) * long
    inch = _DPI * pixels / _PIXELS
    unloaded = f"{unloaded_pose(solid.robot)}, as built"
    kind = f"simulated: {solid.load}" if solid.posed else unloaded
    title = textwrap.wrap(f"{solid.robot.name}, {kind}", max(12, int(_LETTERS * width / inch)))
    top = 0.06 + 0.03 * len(title)
    height = camera.height + (top + bottom) * long
    figure = Figure(figsize=(width / inch, height / inch))
    axes: Any = figure.add_axes(
        (left * long / width, bottom * long / height, camera.width / width, camera.height / height)
    )
    axes.imshow(image, interpolation="antialiased", aspect="auto")
    axes.set_axis_off()
    _name_parts(axes, solid, camera, seen)
    figure.text(0.02, 0.985, "\n".join(title), va="top", fontsize=10)
    return figure


def _azimuth(solid: Solid) -> float:
    x, y, _ = solid["disk_" + str(len(solid.robot.disks.station_m))].centre_m
    bent = math.hypot(x, y) > 1e-3 * solid.robot.length
    return (math.atan2(y, x) if bent else 0.0) + _ASIDE


def _name_parts(axes: Any, solid: Solid, camera: Camera, part_seen: Ints) -> None:
    """Label parts at the right in vertical order, each with a line to its visible pixels."""
    from matplotlib.patheffects import withStroke

    ink, muted = LIGHT["ink"], LIGHT["muted"]
    disks = [part for part in solid.parts if part.kind == "disk"]
    rods = [part for part in solid.parts if part.kind == "backbone"]
    right = camera.axes[0]
    rim = float(solid.robot.disks.radius_m[0])
    wanted: list[tuple[list[Part], str, Floats, str]] = [
        ([disks[-1]], "end disk", disks[-1].centre_m + rim * right, ink),
        ([solid["base"]], "base", solid["base"].centre_m + rim * right, ink),
        (rods[:1], "backbone", _between(disks, len(disks) // 3), ink),
    ]
    if len(disks) > 1:
        middle = disks[len(disks) // 2]
        wanted.append(([middle], "spacer disk", middle.centre_m + rim * right, ink))
    tendons = [part for part in solid.parts if part.kind == "tendon"]
    for i, alike in enumerate(_sharing(solid)[:_MOST_NAMED]):
        path = solid.tendon_paths[alike[0]]
        span = min(1 + i, len(path) - 2)
        place = 0.5 * (path[span] + path[span + 1])
        numbers = ", ".join(str(k + 1) for k in alike)
        text = f"tendon{'s' if len(alike) > 1 else ''} {numbers}"
        wanted.append(([tendons[k] for k in alike], text, place, tendons[alike[0]].colour))
    named = []
    for parts, text, place, colour in wanted:
        which = [k for k, part in enumerate(solid.parts) if any(part is one for one in parts)]
        rows, columns = np.nonzero(np.isin(part_seen, which))
        if len(rows):
            x, y, _ = camera.see(1e3 * place[None])[0]
            nearest = int(np.hypot(columns - x, rows - y).argmin())
            if len(parts) > 1:  # the colour of the part in front
                colour = solid.parts[part_seen[rows[nearest], columns[nearest]]].colour
            named.append((text, float(columns[nearest]), float(rows[nearest]), colour))
    named.sort(key=lambda name: name[2])
    long = max(camera.width, camera.height)
    heights = _spread(np.array([y for _, _, y, _ in named]), 0.052 * long, camera.height)
    for (text, x, y, colour), height in zip(named, heights.tolist(), strict=True):
        axes.annotate(
            text,
            xy=(x, y),
            xytext=(camera.width + 0.06 * long, height),
            va="center",
            color=colour,
            fontsize=9,
            annotation_clip=False,
            arrowprops={
                "arrowstyle": "-",
                "color": muted,
                "lw": 0.6,
                "shrinkA": 2,
                "shrinkB": 0,
                "relpos": (0.0, 0.5),
                "path_effects": [withStroke(linewidth=1.8, foreground="white")],
            },
        )
        # a dot at the end of the line, visible on dark and grey parts
        axes.plot(x, y, "o", ms=2.6, color=ink, mec="white", mew=0.5, clip_on=False, zorder=5)


def _sharing(solid: Solid) -> list[list[int]]:
    """Group tendons (from 0) by hole; those that share one hide each other."""
    groups: list[list[int]] = []
    start = np.array([path[0] for path in solid.tendon_paths])
    for i, place in enumerate(start):
        near = 1e-6 * float(np.hypot(*place[:2]))
        same = (g for g in groups if np.linalg.norm(start[g[0]] - place) < near)
        found = next(same, None)
        if found is None:
            groups.append([i])
        else:
            found.append(i)
    return groups


def _spread(wanted: Floats, gap: float, height: float) -> Floats:
    """Rows closest to the sorted target rows, at least a gap apart."""
    steps = gap * np.arange(len(wanted))
    rows: Floats = np.maximum.accumulate(wanted - steps)  # smallest sufficient shift
    rows[-1] = min(rows[-1], height - steps[-1])
    return np.asarray(np.minimum.accumulate(rows[::-1])[::-1] + steps)


def _between(disks: list[Part], d: int) -> Floats:
    """Centre of the backbone before a disk."""
    before = disks[d - 1].centre_m if d else np.zeros(3)
    found: Floats = 0.5 * (before + disks[d].centre_m)
    return found


# -- meshes --------------------------------------------------------------------------------------


def mesh_of(parts: tuple[Part, ...]) -> Mesh:
    """Triangles of all parts in mm; normals are smooth within a surface and not across edges."""
    size = max(max(*part.shape.bounding_box().size) for part in parts)
    points, normals, triangles, owner = [], [], [], []
    count = 0
    for k, part in enumerate(parts):
        triangulate(part.shape, _DEFLECTION * size, _ANGLE)
        found, faces = part.shape.tessellate(MESHED, _ANGLE)
        place = np.array([tuple(p) for p in found])
        corners = np.array(faces, dtype=np.int64)
        points.append(place)
        normals.append(_normals(place, corners))
        triangles.append(corners + count)
        owner.append(np.full(len(corners), k))
        count += len(place)
    return Mesh(*(np.concatenate(rows) for rows in (points, normals, triangles, owner)))


def _normals(points: Floats, triangles: Ints) -> Floats:
    from scipy.spatial import cKDTree

    a, b, c = (points[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, triangles[:, k], across)
    normals /= _lengths(normals)
    pairs = cKDTree(points).query_pairs(1e-6 * np.ptp(points, axis=0).max(), output_type="ndarray")
    alike = pairs[(normals[pairs[:, 0]] * normals[pairs[:, 1]]).sum(axis=1) > _SMOOTH]
    smooth = normals.copy()
    np.add.at(smooth, alike[:, 0], normals[alike[:, 1]])
    np.add.at(smooth, alike[:, 1], normals[alike[:, 0]])
    found: Floats = smooth / _lengths(smooth)
    return found


def _lengths(rows: Floats) -> Floats:
    found: Floats = np.maximum(np.linalg.norm(rows, axis=1), 1e-300)[:, None]
    return found
