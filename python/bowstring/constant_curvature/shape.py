"""Is a measured backbone an arc? The best arcs through whole shapes, and where they fail.

A shape is a row of points along the backbone, from base to tip, in a plane or in space and in any
unit. It is divided by its own length, so that every length here is a share of the backbone's: an
error of 0.01 is 1 % of length, a curvature is times length, in rad. The best arc starts at the
first point and has length 1; its start direction and its curvature are free, and it is nearest to
the points in the least-squares sense, each point matched with the place on the arc at its share of
the length. In `pieces` arcs that go on in each other's direction, all equally long, each has a
curvature of its own; in space each also bends in a plane of its own.

RMS is over the points of a shape, never over coordinates, the first point included, which has no
error by definition; figures of many shapes are means over shapes. "Row" in a message counts shapes
from 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bowstring._core as _core
from bowstring.errors import InputError, NoSolutionError
from bowstring.validation import floats, is_whole, shown

__all__ = ["ArcFit", "Profile", "fit_arcs"]

Array = NDArray[np.float64]

_CHUNK: Final = 200_000  # points fitted at once, for memory
_STARTS: Final = np.linspace(-4.0 * np.pi, 4.0 * np.pi, 51)  # bends tried at first, rad
_STEPS: Final = 500
_GAUSS_NEWTON: Final = 30  # steps; what is left over then gets full Newton steps
_STRAIGHT: Final = 1e-12  # rad; no direction of bending below


class Profile(NamedTuple):
    """Where along the robot the arcs fail, over many shapes."""

    fraction: Array
    """Shares of the length (n,), from 0 to 1."""
    mean: Array
    """Mean distance from shape to arc there (n,), over length."""
    maximum: Array
    """Largest distance there (n,), over length."""
    bent_more: Array
    """Mean of how much more the shapes bend there than their arcs (n,), times length, rad.

    Level beyond the first and the last vertex."""


@dataclass(frozen=True, eq=False)
class ArcFit:
    """The best arcs of K shapes of P points in D dimensions; made by `fit_arcs`.

    Positions are relative to the first point and over the length of the shape.
    """

    pieces: int
    """Number m of arcs to a shape."""
    length: Array
    """Length of each shape (K,), in the unit of its points."""
    fraction: Array
    """Share of the length at each point (K, P)."""
    measured: Array
    """The points (K, P, D)."""
    fitted: Array
    """The places on the arcs matched with them (K, P, D)."""
    frame: Array
    """Start frames (K, 3, 3), z along the start of the arc, body to the axes of the points; a
    plane's first axis is here the third, its second the first."""
    bend: Array
    """Bends (K, m, 2) of the pieces, rad, each over its own length: rotation about y and about -x
    of the frame that it starts with, as in `bowstring.constant_curvature.arcs`."""

    def __len__(self) -> int:
        return len(self.length)

    @property
    def dimensions(self) -> int:
        """2 in a plane, 3 in space."""
        return int(self.measured.shape[-1])

    @property
    def direction(self) -> Array:
        """Unit vectors (K, D) in which the arcs start."""
        return _from_space(self.frame[:, :, 2], self.dimensions)

    @property
    def curvature(self) -> Array:
        """Curvature times length (K, m), rad.

        In a plane with a sign: positive where it turns from the first axis towards the second. In
        space never negative.
        """
        if self.dimensions == 2:
            return self.bend[..., 0] * self.pieces
        return np.asarray(np.linalg.norm(self.bend, axis=-1) * self.pieces)

    @cached_property
    def curvature_vector(self) -> Array:
        """Derivative of the unit tangent by the share of the length, at the start of each piece.

        Shape (K, m, D), rad, in the axes of the points.
        """
        starts = np.arange(self.pieces) / self.pieces
        _, frames = _chain(self.frame, self.bend, np.broadcast_to(starts, (len(self), self.pieces)))
        flat = np.concatenate([self.bend, np.zeros_like(self.bend[..., :1])], axis=-1)
        return _from_space((frames @ flat[..., None])[..., 0] * self.pieces, self.dimensions)

    @property
    def error(self) -> Array:
        """Arc minus measured point (K, P, D), over length."""
        return self.fitted - self.measured

    @cached_property
    def distance(self) -> Array:
        """Length of `error` (K, P), over length."""
        return np.asarray(np.linalg.norm(self.error, axis=-1))

    @property
    def rms(self) -> Array:
        """Root mean square of the distance over the points of each shape (K,), over length."""
        return np.asarray(np.sqrt(np.mean(self.distance**2, axis=-1)))

    @property
    def tip(self) -> Array:
        """Distance at the last point (K,), over length."""
        return self.distance[:, -1]

    @cached_property
    def residual_curvature(self) -> Array:
        """Local curvature of the shape minus that of the arc, at the inner points, times length.

        Shape (K, P - 2, D - 1), rad. First along the arc's own bending, positive where the shape is
        bent more than the arc; in space then across it. The local curvature is the turn of the
        polyline at a point over half the length of its two sides, and so as rough as the points.
        """
        sides = np.diff(_to_space(self.measured), axis=1)
        turn = _turns(sides[:, :-1], sides[:, 1:])
        spacing = np.diff(self.fraction)
        local = turn / (0.5 * (spacing[:, 1:] + spacing[:, :-1]))[..., None]
        inner = self.fraction[:, 1:-1]
        _, frames = _chain(self.frame, self.bend, inner)
        body = (np.swapaxes(frames, -1, -2) @ local[..., None])[..., 0]
        # the axis of a bend towards x is y, towards y it is -x
        shape = np.stack([body[..., 1], -body[..., 0]], axis=-1)
        piece = np.minimum((inner * self.pieces).astype(int), self.pieces - 1)
        own = np.take_along_axis(self.bend, piece[..., None], axis=1) * self.pieces
        size = np.linalg.norm(own, axis=-1, keepdims=True)
        bent = size > _STRAIGHT
        towards = np.where(bent, own / np.where(bent, size, 1.0), np.array([1.0, 0.0]))
        across = np.stack([-towards[..., 1], towards[..., 0]], axis=-1)
        left = shape - own
        out = np.stack([np.sum(left * towards, -1), np.sum(left * across, -1)], axis=-1)
        return np.asarray(out[..., : self.dimensions - 1])

    def take(self, rows: Any) -> ArcFit:
        """The fits of some of the shapes, by index, slice or mask."""
        at = np.atleast_1d(np.arange(len(self))[rows])
        parts = (self.length, self.fraction, self.measured, self.fitted, self.frame, self.bend)
        return ArcFit(self.pieces, *(np.array(part[at]) for part in parts))

    def curve(self, fraction: ArrayLike) -> Array:
        """The arcs (K, n, D) at shares (n,) of their length, over length."""
        places = floats(fraction)
        places = np.broadcast_to(places, (len(self), places.size))
        return _from_space(_chain(self.frame, self.bend, places)[0], self.dimensions)

    def profile(self, places: int = 21) -> Profile:
        """Where along the robot the arcs fail.

        Parameters
        ----------
        places : int
            Equally spaced shares of the length, both ends counted. Between points, distances and
            curvatures are interpolated linearly.

        Returns
        -------
        Profile
        """
        if not is_whole(places) or places < 2:
            raise InputError(f"places is {shown(places)}, it must be a whole number of 2 or more")
        grid = np.linspace(0.0, 1.0, places)
        distance = _interpolated(grid, self.fraction, self.distance)
        bent = _interpolated(grid, self.fraction[:, 1:-1], self.residual_curvature[..., 0])
        return Profile(grid, distance.mean(axis=0), distance.max(axis=0), bent.mean(axis=0))

    def to_dict(self) -> dict[str, Any]:
        """The figures in percent of length: of each shape's RMS and tip error over shapes."""
        rms, tip = self.rms * 100.0, self.tip * 100.0
        where = self.profile()
        return {
            "pieces": self.pieces,
            "n": len(self),
            "points": int(self.fraction.shape[1]),
            "shape_rms_mean_percent": float(rms.mean()),
            "shape_rms_max_percent": float(rms.max()),
            "tip_mean_percent": float(tip.mean()),
            "tip_max_percent": float(tip.max()),
            "worst_fraction": float(where.fraction[np.argmax(where.mean)]),
            "profile": {
                "fraction": where.fraction.tolist(),
                "mean_percent": (where.mean * 100.0).tolist(),
                "max_percent": (where.maximum * 100.0).tolist(),
                "bent_more_rad": where.bent_more.tolist(),
            },
        }


def fit_arcs(points: ArrayLike, pieces: int = 1, stations: ArrayLike | None = None) -> ArcFit:
    """The best arc, or row of equal arcs, through each of many shapes.

    Parameters
    ----------
    points : array_like (K, P, 2) or (K, P, 3), or one shape without K
        Points along the backbone from base to tip, in any unit; three at least.
    pieces : int
        Arcs of equal length to a shape, tangent-continuous; not more than P - 1.
    stations : array_like (P,) or (K, P), optional
        Arc length from the base at which the points sit on the backbone, in their unit. If not
        given, that of the polyline through the points, which cuts the corners of a bend: with n
        equal sides and a bending angle theta it is short by about theta^2 / (24 n^2).

    Returns
    -------
    ArcFit

    Raises
    ------
    InputError
        For shapes with values that are not finite, with too few points, or with neighbours in one
        place.
    NoSolutionError
        If the best arc of a shape was not found; it is named.

    Notes
    -----
    Levenberg-Marquardt in bend coordinates, which are smooth through the straight shape, on all
    shapes at once. A single arc starts from the best of many bending angles up to two full turns,
    each with its best direction in closed form; several pieces start from that arc and from the
    turns of the polyline, and the better end is kept.
    """
    rows, fraction, length = _checked(points, stations)
    count, number = fraction.shape
    if not is_whole(pieces) or pieces < 1:
        raise InputError(f"pieces is {shown(pieces)}, it must be a whole number of 1 or more")
    m = int(pieces)
    if m > number - 1:
        raise InputError(
            f"{m} arcs cannot be told apart by {number} points: give {number - 1} pieces or fewer"
        )
    held = np.ceil(fraction[:, 1:] * m - 1e-9).astype(int)  # the piece that each point ends in
    for piece in range(1, m + 1):
        empty = ~np.any(held == piece, axis=1)
        if empty.any():
            raise InputError(
                f"row {int(np.argmax(empty)) + 1}: no point lies on piece {piece} of {m}, so its "
                "curvature is unknown: give fewer pieces"
            )
    dimensions = rows.shape[-1]
    target = _to_space((rows - rows[:, :1]) / length[:, None, None])
    frame, bend = np.empty((count, 3, 3)), np.empty((count, m, 2))
    step = max(1, _CHUNK // number)
    for begin in range(0, count, step):
        part = slice(begin, begin + step)
        frame[part], bend[part] = _fit(target[part], fraction[part], m, dimensions == 2, begin)
    fitted, _ = _chain(frame, bend, fraction)
    return ArcFit(
        m,
        length,
        fraction,
        _from_space(target, dimensions),
        _from_space(fitted, dimensions),
        frame,
        bend,
    )


# -- input -------------------------------------------------------------------------------------


def _checked(points: ArrayLike, stations: ArrayLike | None) -> tuple[Array, Array, Array]:
    """Points (K, P, D), their shares of the length (K, P), and the lengths (K,)."""
    try:
        rows = floats(points)
    except TypeError:
        raise InputError(
            "points must be numbers of shape (shapes, points, 2 or 3), one shape may do without "
            "the first; shapes of unequal numbers of points are fitted apart"
        ) from None
    if rows.ndim == 2:
        rows = rows[None]
    if rows.ndim != 3 or rows.shape[-1] not in (2, 3) or not len(rows):
        raise InputError(
            f"points has shape {rows.shape}, it must be (shapes, points, 2 or 3), one shape may "
            "do without the first"
        )
    if rows.shape[1] < 3:
        raise InputError(
            f"a shape of {rows.shape[1]} points says nothing of its curvature: give 3 or more"
        )
    bad = ~np.isfinite(rows).all(axis=-1)
    if bad.any():
        k, p = np.argwhere(bad)[0]
        raise InputError(f"row {k + 1}: point {p + 1} is not finite: {rows[k, p].tolist()}")
    sides = np.linalg.norm(np.diff(rows, axis=1), axis=-1)
    size = sides.max(axis=1, keepdims=True)
    same = sides <= 1e-9 * size
    if same.any():
        k, p = np.argwhere(same)[0]
        raise InputError(
            f"row {k + 1}: points {p + 1} and {p + 2} lie in one place, leave out one of them"
        )
    polyline = sides.sum(axis=1)
    if stations is None:
        at = np.concatenate([np.zeros((len(rows), 1)), np.cumsum(sides, axis=1)], axis=1)
    else:
        try:
            given = floats(stations)
            at = np.broadcast_to(given, rows.shape[:2])
        except (TypeError, ValueError):
            raise InputError(
                f"stations must be numbers of shape ({rows.shape[1]},) or {rows.shape[:2]}, one "
                "for each point"
            ) from None
        if not (np.isfinite(at).all() and (np.diff(at, axis=1) > 0).all()):
            raise InputError("stations must be finite and grow from base to tip")
        at = at - at[:, :1]
        ratio = polyline / at[:, -1]
        far = (ratio < 0.5) | (ratio > 2.0)
        if far.any():
            k = int(np.argmax(far))
            raise InputError(
                f"row {k + 1}: the points are {polyline[k]:.4g} apart along their polyline, their "
                f"stations {at[k, -1]:.4g}: give both in one unit"
            )
    length = np.array(at[:, -1])
    return rows, at / length[:, None], length


def _to_space(rows: Array) -> Array:
    """Shapes in space; a plane's first axis becomes z, its second x, so that arcs start along z."""
    if rows.shape[-1] == 3:
        return rows
    return np.stack([rows[..., 1], np.zeros(rows.shape[:-1]), rows[..., 0]], axis=-1)


def _from_space(rows: Array, dimensions: int) -> Array:
    return rows if dimensions == 3 else rows[..., [2, 0]]


def _interpolated(grid: Array, at: Array, values: Array) -> Array:
    return np.stack([np.interp(grid, x, y) for x, y in zip(at, values, strict=True)])


# -- arcs in a row -----------------------------------------------------------------------------


def _parts(bend: Array, fraction: Array) -> list[Array]:
    """What of each piece lies before each point, as bend coordinates (K P, 3)."""
    m = bend.shape[1]
    out = []
    for i in range(m):
        share = np.clip(fraction * m - i, 0.0, 1.0)[..., None]
        rows = np.concatenate([share * bend[:, None, i], share / m], axis=-1)
        out.append(np.ascontiguousarray(rows.reshape(-1, 3)))
    return out


def _chain(frame: Array, bend: Array, fraction: Array) -> tuple[Array, Array]:
    """Positions (K, P, 3) and rotations (K, P, 3, 3) along arcs in a row."""
    shape = fraction.shape
    position = np.zeros((*shape, 3))
    rotation = np.broadcast_to(frame[:, None], (*shape, 3, 3))
    for rows in _parts(bend, fraction):
        step, turn = _core.arc_pose(rows)
        position = position + (rotation @ step.reshape(*shape, 3, 1))[..., 0]
        rotation = rotation @ turn.reshape(*shape, 3, 3)
    return position, rotation


def _jacobian(frame: Array, bend: Array, fraction: Array, planar: bool) -> tuple[Array, Array]:
    """Positions (K, P, 3), and their derivative (K, P, 3, n) by start direction and bends."""
    shape, m = fraction.shape, bend.shape[1]
    end, _ = _chain(frame, bend, fraction)
    position = np.zeros((*shape, 3))
    rotation = np.broadcast_to(frame[:, None], (*shape, 3, 3))
    # turns of the start about its own x and y; in a plane only about y
    axes = np.swapaxes(frame[:, :, 1:2] if planar else frame[:, :, :2], 1, 2)[:, None]
    columns = [np.swapaxes(np.cross(axes, end[:, :, None]), -1, -2)]
    for i, rows in enumerate(_parts(bend, fraction)):
        step, turn = _core.arc_pose(rows)
        share = np.clip(fraction * m - i, 0.0, 1.0)[..., None, None]
        local = _core.arc_pose_jacobian(rows)[:, :, : 1 if planar else 2].reshape(*shape, 6, -1)
        position = position + (rotation @ step.reshape(*shape, 3, 1))[..., 0]
        by = rotation @ (local[..., :3, :] * share)
        spin = rotation @ (local[..., 3:, :] * share)
        # what lies beyond is carried along
        columns.append(by + np.cross(spin, (end - position)[..., None], axis=2))
        rotation = rotation @ turn.reshape(*shape, 3, 3)
    return end, np.concatenate(columns, axis=-1)


def _rotation(turn: Array) -> Array:
    """Matrices (K, 3, 3) of rotation vectors (K, 3)."""
    from scipy.spatial.transform import Rotation  # 0.2 s, which an arc does not need

    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def _moved(frame: Array, bend: Array, step: Array, planar: bool) -> tuple[Array, Array]:
    turn = np.zeros((len(step), 3))
    if planar:
        turn[:, 1] = step[:, 0]
        bends = np.stack([step[:, 1:], np.zeros_like(step[:, 1:])], axis=-1)
    else:
        turn[:, :2] = step[:, :2]
        bends = step[:, 2:].reshape(bend.shape)
    return frame @ _rotation(turn), bend + bends


# -- the fit -----------------------------------------------------------------------------------


def _fit(target: Array, fraction: Array, m: int, planar: bool, offset: int) -> tuple[Array, Array]:
    """Start frames (K, 3, 3) and bends (K, m, 2) of the best arcs."""
    frame, bend, done = _descend(target, fraction, *_best_start(target, fraction, planar), planar)
    if m > 1:
        whole = frame, np.repeat(bend / m, m, axis=1)
        turned = _turned_start(target, fraction, m, planar)
        frame, bend, done = _descend(target, fraction, *whole, planar)
        others = _descend(target, fraction, *turned, planar)
        second = _cost(target, fraction, *others[:2]) < _cost(target, fraction, frame, bend)
        for kept, other in zip((frame, bend, done), others, strict=True):
            kept[second] = other[second]
    if not done.all():
        raise NoSolutionError(
            f"row {offset + int(np.argmin(done)) + 1}: the best arc was not found in {_STEPS} "
            "steps, the shape may be none of a backbone"
        )
    return frame, bend


def _cost(target: Array, fraction: Array, frame: Array, bend: Array) -> Array:
    """Sums of squares (K,)."""
    return np.asarray(np.sum((_chain(frame, bend, fraction)[0] - target) ** 2, axis=(1, 2)))


def _best_start(target: Array, fraction: Array, planar: bool) -> tuple[Array, Array]:
    """The best of many single arcs, each with its best direction."""
    bends = _STARTS if planar else _STARTS[_STARTS >= 0.0]
    best = np.full(len(target), -np.inf)
    angle, pair = np.zeros(len(target)), np.zeros((len(target), 3, 2))
    for theta in bends:
        # x and z on an arc in the plane of both
        turned = theta * fraction
        half = 0.5 * turned
        chord = fraction * np.sinc(half / np.pi)
        template = np.stack([chord * np.sin(half), chord * np.cos(half)], axis=-1)
        overlap = np.swapaxes(target, 1, 2) @ template
        if planar:
            # with the same handedness only: a + i b of the rotation about y
            overlap = _rotation_part(overlap)
        gram = np.swapaxes(overlap, 1, 2) @ overlap
        trace = gram[:, 0, 0] + gram[:, 1, 1]
        area = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
        # sum of the singular values: what the best direction attains
        attained = np.sqrt(np.maximum(trace + 2.0 * np.sqrt(np.maximum(area, 0.0)), 0.0))
        score = 2.0 * attained - np.sum(template**2, axis=(1, 2))
        better = score > best
        best[better], angle[better], pair[better] = score[better], theta, overlap[better]
    bend = np.stack([angle, np.zeros_like(angle)], axis=-1)[:, None]
    return _with_columns(pair), bend


def _with_columns(overlap: Array) -> Array:
    """Frames (K, 3, 3) whose x and z attain most of overlaps (K, 3, 2)."""
    u, _, v = np.linalg.svd(overlap, full_matrices=False)
    x, z = np.moveaxis(u @ v, -1, 0)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _rotation_part(overlap: Array) -> Array:
    """The part of overlaps (K, 3, 2) in the plane y = 0 that a rotation about y attains."""
    same = 0.5 * (overlap[:, 0, 0] + overlap[:, 2, 1])
    turn = 0.5 * (overlap[:, 0, 1] - overlap[:, 2, 0])
    none = np.zeros_like(same)
    return np.stack([same, turn, none, none, -turn, same], axis=-1).reshape(-1, 3, 2)


def _turned_start(target: Array, fraction: Array, m: int, planar: bool) -> tuple[Array, Array]:
    """Pieces that turn as the polyline does, in the best direction."""
    sides = np.diff(target, axis=1)
    frame = _frame_along(sides[:, 0], planar)
    bend = np.zeros((len(target), m, 2))
    turns = _turns(sides[:, :-1], sides[:, 1:])
    piece = np.minimum((fraction[:, 1:-1] * m).astype(int), m - 1)
    carried, rows = frame, np.arange(len(target))
    for p in range(turns.shape[1]):
        body = (np.swapaxes(carried, 1, 2) @ turns[:, p, :, None])[..., 0]
        bend[rows, piece[:, p], 0] += body[:, 1]
        bend[rows, piece[:, p], 1] -= body[:, 0]
        carried = _rotation(turns[:, p]) @ carried
    if planar:
        bend[..., 1] = 0.0
    overlap = np.swapaxes(target, 1, 2) @ _chain(frame, bend, fraction)[0]
    if planar:
        return _with_columns(_rotation_part(overlap[..., [0, 2]])) @ frame, bend
    u, _, v = np.linalg.svd(overlap)
    u[..., 2] *= np.linalg.det(u @ v)[:, None]
    return u @ v @ frame, bend


def _frame_along(z: Array, planar: bool) -> Array:
    """Frames (K, 3, 3) with z along vectors (K, 3); y is that of the plane, or any."""
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    if planar:
        y = np.broadcast_to(np.array([0.0, 1.0, 0.0]), z.shape)
    else:
        y = np.cross(z, np.eye(3)[np.argmin(np.abs(z), axis=-1)])
        y /= np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _turns(before: Array, after: Array) -> Array:
    """Rotation vectors (..., 3) that turn sides into the next; 0 where they turn right back."""
    cross = np.cross(before, after)
    size = np.linalg.norm(cross, axis=-1, keepdims=True)
    angle = np.arctan2(size, np.sum(before * after, axis=-1, keepdims=True))
    return np.asarray(np.where(size > 0, cross / np.where(size > 0, size, 1.0), 0.0) * angle)


def _descend(
    target: Array, fraction: Array, frame: Array, bend: Array, planar: bool
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Levenberg-Marquardt on all shapes at once; the last (K,) says which are done."""
    frame, bend = frame.copy(), bend.copy()
    active = np.arange(len(target))
    damping = np.full(len(target), 1e-3)
    for n in range(_STEPS):
        f, b, s, wanted = frame[active], bend[active], fraction[active], target[active]
        cost, gradient, normal = _slope(wanted, s, f, b, planar)
        if n >= _GAUSS_NEWTON:  # slow where much is left of the shape
            normal = _curved(wanted, s, f, b, planar)
        diagonal = np.einsum("kii->ki", normal)
        scale = diagonal + 1e-12 * diagonal.max(axis=1, keepdims=True)
        damped = normal + np.einsum(
            "ki,ij->kij", damping[active, None] * scale, np.eye(len(scale.T))
        )
        step = -np.linalg.solve(damped, gradient[..., None])[..., 0]
        tried_frame, tried_bend = _moved(f, b, step, planar)
        tried = _cost(wanted, s, tried_frame, tried_bend)
        good = tried <= cost
        to = active[good]
        frame[to], bend[to] = tried_frame[good], tried_bend[good]
        damping[active] *= np.where(good, 0.1, 10.0)
        # done: a full step moves nothing, or promises less than rounding takes
        small = np.abs(step).max(axis=1) < 1e-12
        expected = -np.sum(gradient * step, axis=1)
        rounding = expected <= 1e-16 * cost + 1e-30
        hopeless = (damping[active] > 1e12) & (expected <= 1e-12 * cost)
        damping[active] = np.clip(damping[active], 1e-15, 1e15)
        active = active[~((small & good) | rounding | hopeless)]
        if not active.size:
            break
    done = np.ones(len(target), dtype=bool)
    done[active] = False
    return frame, bend, done


def _slope(
    target: Array, fraction: Array, frame: Array, bend: Array, planar: bool
) -> tuple[Array, Array, Array]:
    """Sums of squares (K,), half their gradient (K, n), and Gauss-Newton's matrix (K, n, n)."""
    place, by = _jacobian(frame, bend, fraction, planar)
    residual = (place - target).reshape(len(target), -1, 1)
    rows = by.reshape(len(target), -1, by.shape[-1])
    turned = np.swapaxes(rows, 1, 2)
    return np.sum(residual[..., 0] ** 2, axis=1), (turned @ residual)[..., 0], turned @ rows


def _curved(target: Array, fraction: Array, frame: Array, bend: Array, planar: bool) -> Array:
    """Newton's matrix (K, n, n) by differences of the gradient, its eigenvalues made positive."""
    columns = []
    for unit in np.eye(1 + bend.shape[1] if planar else 2 + 2 * bend.shape[1]) * 1e-5:
        ahead, behind = (
            _slope(
                target, fraction, *_moved(frame, bend, np.tile(by, (len(bend), 1)), planar), planar
            )[1]
            for by in (unit, -unit)
        )
        columns.append((ahead - behind) / 2e-5)
    matrix = np.stack(columns, axis=-1)
    values, vectors = np.linalg.eigh(0.5 * (matrix + np.swapaxes(matrix, 1, 2)))
    return np.asarray((vectors * np.abs(values)[:, None]) @ np.swapaxes(vectors, 1, 2))
