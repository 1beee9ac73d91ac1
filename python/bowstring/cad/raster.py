"""Renderer of triangles in perspective, with hidden surfaces removed, light and shadow."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Ints

_BLOCK: Final = 1_000_000  # pixels processed at once
_CREASE: Final = 0.7  # cosine between the normals of two sides of a visible edge
_EDGE: Final = 0.35  # brightness factor of an edge
_AMBIENT, _KEY, _FILL, _SHINE = 0.46, 0.62, 0.16, 0.22
_SHADOW: Final = 0.45  # share of the key light that shadow removes
_FINER: Final = 2  # subpixels across one pixel (antialiasing)


@dataclass(frozen=True)
class Mesh:
    """Triangles with normals; any unit of length.

    Attributes
    ----------
    points, normals : ndarray (V, 3)
    triangles : ndarray of int (F, 3)
    part : ndarray of int (F,)
        Index of the body of each triangle.
    """

    points: Floats
    normals: Floats
    triangles: Ints
    part: Ints


class Camera:
    """Perspective camera that looks at the centre of points and fits them into the picture.

    Parameters
    ----------
    points : ndarray (V, 3)
        Points that must be visible.
    azimuth, elevation : float
        Direction of the eye in rad; z is up.
    longest : int
        Pixels of the longer side.
    """

    def __init__(self, points: Floats, azimuth: float, elevation: float, longest: int) -> None:
        back = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )
        right = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        self.axes = np.stack([right, np.cross(back, right), back])  # rows: right, up, to the eye
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
        size = float(np.linalg.norm(points - middle, axis=1).max())
        self.eye = middle + 4.0 * size * back
        flat = self._flat(points)[:, :2]
        low, high = flat.min(axis=0), flat.max(axis=0)
        room = 0.02 * (high - low).max()
        self._low, self._high = low - room, high + room
        span = self._high - self._low
        self._scale = longest / float(span.max())
        self.width, self.height = (max(16, math.ceil(s * self._scale)) for s in span.tolist())

    def _flat(self, points: Floats) -> Floats:
        seen = (points - self.eye) @ self.axes.T
        return np.stack([-seen[:, 0] / seen[:, 2], -seen[:, 1] / seen[:, 2], -seen[:, 2]], axis=1)

    def see(self, points: Floats) -> Floats:
        """Project points (V, 3): pixels from the left, from the top, and distance."""
        flat = self._flat(points)
        x = (flat[:, 0] - self._low[0]) * self._scale
        y = (self._high[1] - flat[:, 1]) * self._scale
        return np.stack([x, y, flat[:, 2]], axis=1)


def render(mesh: Mesh, camera: Camera, colours: Floats, outlined: Bools) -> tuple[Floats, Ints]:
    """Render a mesh.

    Parameters
    ----------
    mesh : Mesh
    camera : Camera
    colours : ndarray (parts, 3)
        Colour of each part, 0 to 1.
    outlined : ndarray of bool (parts,)
        Whether the edges of each part are drawn; thin parts would be all edge.

    Returns
    -------
    ndarray (height, width, 4)
        Red, green, blue and coverage, 0 to 1.
    ndarray of int (height, width)
        Visible part at each pixel, -1 for none.
    """
    height, width = _FINER * camera.height, _FINER * camera.width
    screen = camera.see(mesh.points) * [_FINER, _FINER, 1.0]
    screen[:, 2] = 1.0 / screen[:, 2]  # linear over the picture, larger for nearer points
    _, who, share = _nearest(screen, mesh.triangles, width, height)
    seen = np.flatnonzero(who.ravel() >= 0)
    triangle = who.ravel()[seen]
    corners = mesh.triangles[triangle]
    weights = share.reshape(-1, 3)[seen]
    normal = np.einsum("pc,pci->pi", weights, mesh.normals[corners])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
    place = np.einsum("pc,pci->pi", weights, mesh.points[corners])
    to_eye = camera.eye - place
    to_eye /= np.linalg.norm(to_eye, axis=1)[:, None]
    normal *= np.where((normal * to_eye).sum(axis=1) < 0, -1.0, 1.0)[:, None]

    light = np.array([-0.45, 0.75, 0.6]) @ camera.axes  # from above, left of the eye
    light /= np.linalg.norm(light)
    key = np.maximum(normal @ light, 0.0) * (1.0 - _SHADOW * _shadow(mesh, place, normal, light))
    fill = np.maximum(normal @ (np.array([0.8, -0.1, 0.5]) @ camera.axes), 0.0)
    half = light + to_eye
    half /= np.linalg.norm(half, axis=1)[:, None]
    shine = np.maximum((normal * half).sum(axis=1), 0.0) ** 40 * (key > 0)
    level = _AMBIENT + _KEY * key + _FILL * fill
    colour = colours[mesh.part[triangle]] * level[:, None] + _SHINE * shine[:, None]

    image = np.zeros((height, width, 4), dtype=np.float32)
    flat = image.reshape(-1, 4)
    flat[seen, :3] = np.clip(colour, 0.0, 1.0)
    flat[seen, 3] = 1.0
    turned = np.zeros((height, width, 3), dtype=np.float32)
    turned.reshape(-1, 3)[seen] = normal
    part = np.full(height * width, -1)
    part[seen] = mesh.part[triangle]
    part = part.reshape(height, width)
    edge = _edges(part, turned) & outlined[part]
    image[..., :3] *= np.where(edge, _EDGE, 1.0)[..., None]
    return _smaller(image), part[::_FINER, ::_FINER]


def _smaller(image: NDArray[np.float32]) -> Floats:
    """Average blocks of subpixels, with colours weighted by coverage."""
    rows, columns = image.shape[0] // _FINER, image.shape[1] // _FINER
    blocks = image.reshape(rows, _FINER, columns, _FINER, 4).astype(float)
    cover = blocks[..., 3].mean(axis=(1, 3))
    colour = (blocks[..., :3] * blocks[..., 3:]).mean(axis=(1, 3))
    colour /= np.maximum(cover, 1e-9)[..., None]
    return np.concatenate([colour, cover[..., None]], axis=2)


def _edges(part: Ints, normal: NDArray[np.float32]) -> Bools:
    """Pixels at the outline of a body or at a crease of its surface."""
    edge = np.zeros(part.shape, dtype=bool)
    for here, there in (
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
    ):
        other = part[here] != part[there]
        crease = (normal[here] * normal[there]).sum(axis=2) < _CREASE
        both = (part[here] >= 0) & (part[there] >= 0)
        edge[here] |= other | (crease & both)
        edge[there] |= other
    return edge


def _shadow(mesh: Mesh, place: Floats, normal: Floats, light: Floats) -> Floats:
    """Share of the light, 0 to 1, that other bodies block at each point (P, 3)."""
    side = np.cross(light, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    axes = np.stack([side, np.cross(light, side), light])
    points = mesh.points @ axes.T
    low, high = points.min(axis=0), points.max(axis=0)
    size, cells = float((high - low)[:2].max()), 1400
    scale = (cells - 4) / size

    def on_map(at: Floats) -> Floats:
        found: Floats = (at @ axes.T - low) * [scale, scale, 1.0]
        found[:, :2] += 2.0
        return found

    width, height = (math.ceil(s * scale) + 4 for s in (high - low)[:2].tolist())
    near, _, _ = _nearest(on_map(mesh.points), mesh.triangles, width, height)
    # a little off the surface, so that it does not shade itself
    found = on_map(place + 3.0 / scale * normal)
    lost = np.zeros(len(place))
    for dx, dy in ((-0.5, -0.5), (0.5, -0.5), (-0.5, 0.5), (0.5, 0.5)):
        x = np.clip((found[:, 0] + dx).astype(int), 0, width - 1)
        y = np.clip((found[:, 1] + dy).astype(int), 0, height - 1)
        lost += 0.25 * (near[y, x] > found[:, 2] + 2.0 / scale)
    return lost


def _nearest(
    corners: Floats, triangles: Ints, width: int, height: int
) -> tuple[NDArray[np.float32], Ints, NDArray[np.float32]]:
    """Z-buffer: inverse depth, visible triangle (-1: none) and barycentric coordinates per pixel.

    `corners` (V, 3) are x, y and inverse depth, which is linear over the picture. Each triangle is
    intersected with the centre lines of rows, and each intersection with those of columns.
    """
    near = np.full(height * width, -np.inf, dtype=np.float32)
    who = np.full(height * width, -1, dtype=np.int64)
    share = np.zeros((height * width, 3), dtype=np.float32)
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    front = np.flatnonzero(area < 0)  # rows count downwards; back faces of a closed body are hidden
    a, b, c, area = a[front], b[front], c[front], area[front]
    low = np.minimum(np.minimum(a[:, 1], b[:, 1]), c[:, 1])
    high = np.maximum(np.maximum(a[:, 1], b[:, 1]), c[:, 1])
    first, count = _middles(low, high, height)
    for block in _blocks(count, _BLOCK // 8):
        t, y = _counted(first, count, block)
        left, right = np.full(len(t), np.inf), np.full(len(t), -np.inf)
        for p, q in ((a, b), (b, c), (c, a)):
            rise = q[t, 1] - p[t, 1]
            at = (y + 0.5 - p[t, 1]) / np.where(rise == 0.0, np.nan, rise)
            x = np.where((at >= 0.0) & (at <= 1.0), p[t, 0] + at * (q[t, 0] - p[t, 0]), np.nan)
            left, right = np.fmin(left, x), np.fmax(right, x)
        start, length = _middles(left, right, width)
        for piece in _blocks(length, _BLOCK):
            row, x = _counted(start, length, piece)
            f, px, py = t[row], x + 0.5, y[row] + 0.5
            u = _twice_area(b[f], c[f], px, py) / area[f]
            v = _twice_area(c[f], a[f], px, py) / area[f]
            weights = np.stack([u, v, 1.0 - u - v], axis=1)
            depth = u * a[f, 2] + v * b[f, 2] + weights[:, 2] * c[f, 2]
            depth = depth.astype(np.float32)
            pixel = y[row] * width + x
            np.maximum.at(near, pixel, depth)
            won = near[pixel] == depth
            pixel = pixel[won]
            who[pixel], share[pixel] = front[f[won]], weights[won]
    return near.reshape(height, width), who.reshape(height, width), share.reshape(height, width, 3)


def _middles(low: Floats, high: Floats, most: int) -> tuple[Ints, Ints]:
    """First pixel of `most` whose centre lies between two bounds, and number of such pixels."""
    nothing = ~(high >= low)
    first = np.clip(np.ceil(np.where(nothing, 0.0, low) - 0.5), 0, most).astype(np.int64)
    after = np.clip(np.floor(np.where(nothing, -1.0, high) - 0.5) + 1, 0, most).astype(np.int64)
    return first, np.maximum(after - first, 0)


def _blocks(count: Ints, most: int) -> Iterator[slice]:
    """Yield slices of rows whose counts add up to about `most`."""
    total = np.cumsum(count)
    cuts = np.searchsorted(total, np.arange(most, total[-1] if len(total) else 0, most)) + 1
    edges = np.unique([0, *cuts.tolist(), len(count)])
    for i, j in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        yield slice(i, j)


def _counted(first: Ints, count: Ints, block: slice) -> tuple[Ints, Ints]:
    """Expand the rows of a block: row of each item, and index of the item from `first` on."""
    many = count[block]
    row = np.repeat(np.arange(len(count))[block], many)
    before = np.cumsum(many) - many
    return row, first[row] + np.arange(len(row)) - np.repeat(before, many)


def _twice_area(a: Floats, b: Floats, x: Any, y: Any) -> Floats:
    """Twice the signed area of the triangles a, b, (x, y)."""
    found: Floats = (b[:, 0] - a[:, 0]) * (y - a[:, 1]) - (b[:, 1] - a[:, 1]) * (x - a[:, 0])
    return found
