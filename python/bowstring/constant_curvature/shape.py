"""Least-squares fit of circular arcs to measured backbone shapes.

A shape is a row of points along the backbone, from base to tip, in a plane or in space and in any
unit. Lengths are divided by the length of the shape: an error of 0.01 is 1 % of length, and a
curvature times length is in rad. The fitted arc starts at the first point and has length 1; its
start direction and curvature are free. Each point is compared with the point of the arc at the same
share of the length. With `pieces`, tangent-continuous arcs of equal length each have their own
curvature, and in space their own plane of bending.

RMS is over the points of a shape, not over coordinates, and includes the first point, whose error
is zero by definition; statistics of several shapes are means over shapes. "Row" in a message counts
shapes from 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.constant_curvature.series import series_jacobian, series_pose
from bowstring.errors import InputError, NoSolutionError
from bowstring.pose import Pose, nearest_rotation
from bowstring.validation import floats, floats_or_refuse, is_whole, shown

_STARTS: Final = np.linspace(-4.0 * np.pi, 4.0 * np.pi, 51)  # initial bends, rad
_EVALUATIONS: Final = 5000
_TOLERANCE: Final = 1e-12  # relative tolerance of cost, step and gradient
_STRAIGHT: Final = 1e-12  # rad; smaller bends have no direction
_Y: Final = np.array([0.0, 1.0, 0.0])
_CROSS: Final = np.cross(np.eye(3)[:, None], np.eye(3)).reshape(3, 9)  # a x b = b (a _CROSS)


class Profile(NamedTuple):
    """Error of the arcs along the robot, over many shapes."""

    fraction: Floats
    """Shares of the length (n,), from 0 to 1."""
    mean: Floats
    """Mean distance from shape to arc (n,), over length."""
    maximum: Floats
    """Largest distance from shape to arc (n,), over length."""
    bent_more: Floats
    """Mean curvature of the shapes minus that of their arcs (n,), times length, rad; constant
    beyond the first and the last vertex."""


@dataclass(frozen=True, eq=False)
class ArcFit:
    """Arcs fitted to K shapes of P points in D dimensions by `fit_arcs`.

    Positions are relative to the first point and divided by the length of the shape.
    """

    pieces: int
    """Number m of arcs per shape."""
    length: Floats
    """Length of each shape (K,), in the unit of its points."""
    fraction: Floats
    """Share of the length at each point (K, P)."""
    measured: Floats
    """Measured points (K, P, D)."""
    fitted: Floats
    """Points of the arcs at the same shares of the length (K, P, D)."""
    frame: Floats
    """Start frames (K, 3, 3), z along the start of the arc, body to the axes of the points. For
    plane shapes, the first axis of the plane is the third one here, and the second the first."""
    bend: Floats
    """Bends (K, m, 2) of the pieces over their own lengths, rad: rotations about y and about -x of
    the start frame of each piece, as in `bowstring.constant_curvature.arc`."""

    def __len__(self) -> int:
        return len(self.length)

    @property
    def dimensions(self) -> int:
        """Number of dimensions: 2 in a plane, 3 in space."""
        return int(self.measured.shape[-1])

    @property
    def direction(self) -> Floats:
        """Start directions of the arcs (K, D), unit vectors."""
        return _from_space(self.frame[:, :, 2], self.dimensions)

    @property
    def curvature(self) -> Floats:
        """Curvature times length (K, m), rad.

        In a plane it is positive where the arc turns from the first axis towards the second. In
        space it is never negative.
        """
        if self.dimensions == 2:
            return self.bend[..., 0] * self.pieces
        return np.asarray(np.linalg.norm(self.bend, axis=-1) * self.pieces)

    @cached_property
    def curvature_vector(self) -> Floats:
        """Derivative of the unit tangent by the share of the length, at the start of each piece.

        Shape (K, m, D), rad, in the axes of the points.
        """
        starts = np.arange(self.pieces) / self.pieces
        frames = _along(self.frame, self.bend, starts).rotation
        flat = np.concatenate([self.bend, np.zeros_like(self.bend[..., :1])], axis=-1)
        return _from_space((frames @ flat[..., None])[..., 0] * self.pieces, self.dimensions)

    @property
    def error(self) -> Floats:
        """Arc minus measured point (K, P, D), over length."""
        return self.fitted - self.measured

    @cached_property
    def distance(self) -> Floats:
        """Length of `error` (K, P), over length."""
        return np.asarray(np.linalg.norm(self.error, axis=-1))

    @property
    def rms(self) -> Floats:
        """Root mean square of the distance over the points of each shape (K,), over length."""
        return np.asarray(np.sqrt(np.mean(self.distance**2, axis=-1)))

    @property
    def tip(self) -> Floats:
        """Distance at the last point (K,), over length."""
        return self.distance[:, -1]

    @cached_property
    def residual_curvature(self) -> Floats:
        """Local curvature of the shape minus that of the arc, at the inner points, times length.

        Shape (K, P - 2, D - 1), rad. The first component is in the plane of the arc, positive where
        the shape is bent more than the arc; in space the second is perpendicular to it. The local
        curvature is the angle of the polyline at a point over half the length of its two sides,
        and as noisy as the points.
        """
        sides = np.diff(_to_space(self.measured), axis=1)
        turn = _turns(sides[:, :-1], sides[:, 1:])
        spacing = np.diff(self.fraction)
        local = turn / (0.5 * (spacing[:, 1:] + spacing[:, :-1]))[..., None]
        inner = self.fraction[:, 1:-1]
        frames = _along(self.frame, self.bend, inner).rotation
        body = (np.swapaxes(frames, -1, -2) @ local[..., None])[..., 0]
        # a bend towards x is a rotation about y, one towards y a rotation about -x
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
        """Select the fits of some shapes by index, slice or mask."""
        at = np.atleast_1d(np.arange(len(self))[rows])
        parts = (self.length, self.fraction, self.measured, self.fitted, self.frame, self.bend)
        return ArcFit(self.pieces, *(np.array(part[at]) for part in parts))

    def curve(self, fraction: ArrayLike) -> Floats:
        """Points of the arcs (K, n, D) at shares (n,) of their length, over length."""
        pose = _along(self.frame, self.bend, floats(fraction).reshape(-1))
        return _from_space(pose.position, self.dimensions)

    def profile(self, places: int = 21) -> Profile:
        """Error of the arcs along the robot.

        Parameters
        ----------
        places : int
            Number of equally spaced shares of the length, both ends included. Distances and
            curvatures are interpolated linearly between points.

        Returns
        -------
        Profile
            Distances and curvatures at these shares of the length.
        """
        if not is_whole(places) or places < 2:
            raise InputError(f"places is {shown(places)}, it must be a whole number of 2 or more")
        grid = np.linspace(0.0, 1.0, places)
        distance = _interpolated(grid, self.fraction, self.distance)
        bent = _interpolated(grid, self.fraction[:, 1:-1], self.residual_curvature[..., 0])
        return Profile(grid, distance.mean(axis=0), distance.max(axis=0), bent.mean(axis=0))

    def to_dict(self) -> dict[str, Any]:
        """Mean and maximum over shapes of RMS and tip error, in percent of length."""
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
    """Fit an arc, or a series of arcs of equal length, to each of many shapes.

    Parameters
    ----------
    points : array_like (K, P, 2) or (K, P, 3), or one shape without K
        Points along the backbone from base to tip, in any unit; at least 3.
    pieces : int
        Number of tangent-continuous arcs of equal length per shape, at most P - 1.
    stations : array_like (P,) or (K, P), optional
        Arc length of the points from the base, in their unit. The default is that of the polyline
        through the points, which is too short by about theta^2 / (24 n^2) of it, with n equal sides
        and a bend angle theta.

    Returns
    -------
    ArcFit
        Curvatures, directions and residuals of each shape.

    Raises
    ------
    InputError
        For shapes with values that are not finite, with too few points, or with coincident
        neighbours.
    NoSolutionError
        If the fit of a shape did not converge; the message names the shape.

    Notes
    -----
    Levenberg-Marquardt method (`scipy.optimize.leastsq`) in bend coordinates, which are
    regular at the straight shape. The initial guess of a single arc is the best of many bending
    angles up to two full turns, each with its optimal direction in closed form. Several pieces
    start from that arc and from the angles of the polyline; the better result is returned.
    """
    rows, fraction, length = _checked(points, stations)
    number = fraction.shape[1]
    if not is_whole(pieces) or pieces < 1:
        raise InputError(f"pieces is {shown(pieces)}, it must be a whole number of 1 or more")
    m = int(pieces)
    if m > number - 1:
        raise InputError(
            f"{m} arcs cannot be told apart by {number} points: give {number - 1} pieces or fewer"
        )
    held = np.ceil(fraction[:, 1:] * m - 1e-9).astype(int)  # piece of each point
    for piece in range(1, m + 1):
        empty = ~np.any(held == piece, axis=1)
        if empty.any():
            raise InputError(
                f"row {int(np.argmax(empty)) + 1}: no point lies on piece {piece} of {m}, so its "
                "curvature is unknown: give fewer pieces"
            )
    dimensions = rows.shape[-1]
    target = _to_space((rows - rows[:, :1]) / length[:, None, None])
    frame, bend = _fit(target, fraction, m, dimensions == 2)
    return ArcFit(
        m,
        length,
        fraction,
        _from_space(target, dimensions),
        _from_space(_along(frame, bend, fraction).position, dimensions),
        frame,
        bend,
    )


# -- input -------------------------------------------------------------------------------------


def _checked(points: ArrayLike, stations: ArrayLike | None) -> tuple[Floats, Floats, Floats]:
    """Check the input; return points (K, P, D), shares of the length (K, P) and lengths (K,)."""
    rows = floats_or_refuse(
        points,
        "points must be numbers of shape (shapes, points, 2 or 3), one shape may do without "
        "the first; shapes of unequal numbers of points are fitted apart",
    )
    if rows.ndim == 2:
        rows = rows[None]
    if rows.ndim != 3 or rows.shape[-1] not in (2, 3) or not len(rows):
        raise InputError(
            f"points has shape {rows.shape}, it must be (shapes, points, 2 or 3), one shape may "
            "do without the first"
        )
    if rows.shape[1] < 3:
        raise InputError(f"a shape of {rows.shape[1]} points has no curvature: give 3 or more")
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


def _to_space(rows: Floats) -> Floats:
    """Shapes in space; the first axis of a plane becomes z and the second x."""
    if rows.shape[-1] == 3:
        return rows
    return np.stack([rows[..., 1], np.zeros(rows.shape[:-1]), rows[..., 0]], axis=-1)


def _from_space(rows: Floats, dimensions: int) -> Floats:
    return rows if dimensions == 3 else rows[..., [2, 0]]


def _interpolated(grid: Floats, at: Floats, values: Floats) -> Floats:
    return np.stack([np.interp(grid, x, y) for x, y in zip(at, values, strict=True)])


# -- arcs in series ----------------------------------------------------------------------------


def _along(frame: Floats, bend: Floats, fraction: Floats) -> Pose:
    """Poses (K, P) at shares (K, P) or (P,) of the length of arcs with start frames (K, 3, 3)."""
    arcs = _arcs(bend)[:, None]
    return Pose(np.zeros(3), frame[:, None]) @ series_pose(arcs, _shares(fraction, bend.shape[1]))


def _arcs(bend: Floats) -> Floats:
    """Bend coordinates (..., m, 3) of equal pieces of a backbone of length 1."""
    m = bend.shape[-2]
    return np.concatenate([bend, np.full((*bend.shape[:-1], 1), 1.0 / m)], axis=-1)


def _shares(fraction: Floats, m: int) -> Floats:
    """Part (..., m) of each piece before each point."""
    return np.clip(fraction[..., None] * m - np.arange(m), 0.0, 1.0)


# -- the fit -----------------------------------------------------------------------------------


class _Found(NamedTuple):
    cost: float
    frame: Floats
    bend: Floats
    converged: bool


def _fit(target: Floats, fraction: Floats, m: int, planar: bool) -> tuple[Floats, Floats]:
    """Fit arcs; return start frames (K, 3, 3) and bends (K, m, 2)."""
    frame, bend = _best_start(target, fraction, planar)
    starts = [(frame, np.repeat(bend / m, m, axis=1))]
    if m > 1:
        starts.append(_turned_start(target, fraction, m, planar))
    frames, bends = np.empty_like(frame), np.empty((len(target), m, 2))
    for k, share in enumerate(_shares(fraction, m)):
        ends = [_least_squares(target[k], share, f[k], b[k], planar) for f, b in starts]
        best = min(ends, key=lambda end: end.cost)
        if not best.converged:
            raise NoSolutionError(
                f"row {k + 1}: the best arc was not found in {_EVALUATIONS} evaluations, the shape "
                "may be none of a backbone"
            )
        frames[k], bends[k] = best.frame, best.bend
    return frames, bends


def _least_squares(
    points: Floats, share: Floats, frame: Floats, bend: Floats, planar: bool
) -> _Found:
    """Fit arcs to points (P, 3) from an initial guess by Levenberg-Marquardt (MINPACK).

    Unknowns are rotations of the start frame about its x and then its y axis (in a plane about y
    only) and changes of the bends. Residuals are in the axes of the start frame.
    """
    from scipy.optimize import leastsq  # takes 0.2 s, and only fits need it

    axes = 1 if planar else 2

    def moved(unknowns: Floats) -> tuple[Floats, Floats]:
        about_x, about_y = (0.0, *unknowns[:1]) if planar else unknowns[:2]
        (c, s), (cx, sx) = ((math.cos(a), math.sin(a)) for a in (about_y, about_x))
        turn = np.array([[c, 0.0, s], [sx * s, cx, -sx * c], [-cx * s, sx, cx * c]])
        bends = bend.copy()
        bends[:, :axes] += unknowns[axes:].reshape(-1, axes)
        return turn, bends

    @lru_cache(maxsize=1)
    def evaluated(key: bytes) -> tuple[Floats, Floats]:
        turn, bends = moved(np.frombuffer(key))
        pose, by = series_jacobian(_arcs(bends), share)
        seen = points @ (frame @ turn)
        # a rotation of the frame rotates the coordinates of points in it by the inverse
        spins = np.array([turn[0], _Y])[-axes:]
        by_turn = seen @ (spins @ _CROSS).reshape(axes, 3, 3)
        by_bend = by.reshape(len(share), 6, -1, 3)[:, :3, :, :axes].reshape(len(share), 3, -1)
        whole = np.concatenate([by_turn.transpose(1, 2, 0), by_bend], axis=-1)
        return (pose.position - seen).reshape(-1), whole.reshape(seen.size, -1)

    # leastsq and not least_squares, whose checks took a third of the time
    found, _, last, _, state = leastsq(
        lambda x: evaluated(x.tobytes())[0],
        np.zeros(axes * (1 + len(bend))),
        Dfun=lambda x: evaluated(x.tobytes())[1],
        full_output=True,
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        maxfev=_EVALUATIONS,
        diag=np.ones(axes * (1 + len(bend))),
    )
    turn, bends = moved(found)
    cost = 0.5 * float(last["fvec"] @ last["fvec"])
    return _Found(cost, frame @ turn, bends, state in (1, 2, 3, 4))


def _best_start(target: Floats, fraction: Floats, planar: bool) -> tuple[Floats, Floats]:
    """Best of many single arcs, each with its optimal direction."""
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
            # only proper rotations: a + i b of the rotation about y
            overlap = _rotation_part(overlap)
        gram = np.swapaxes(overlap, 1, 2) @ overlap
        trace = gram[:, 0, 0] + gram[:, 1, 1]
        area = gram[:, 0, 0] * gram[:, 1, 1] - gram[:, 0, 1] ** 2
        # the optimal direction attains the sum of the singular values
        attained = np.sqrt(np.maximum(trace + 2.0 * np.sqrt(np.maximum(area, 0.0)), 0.0))
        score = 2.0 * attained - np.sum(template**2, axis=(1, 2))
        better = score > best
        best[better], angle[better], pair[better] = score[better], theta, overlap[better]
    bend = np.stack([angle, np.zeros_like(angle)], axis=-1)[:, None]
    return _with_columns(pair), bend


def _with_columns(overlap: Floats) -> Floats:
    """Frames (K, 3, 3) whose x and z columns have the largest inner product with (K, 3, 2)."""
    u, _, v = np.linalg.svd(overlap, full_matrices=False)
    x, z = np.moveaxis(u @ v, -1, 0)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _rotation_part(overlap: Floats) -> Floats:
    """Part of overlaps (K, 3, 2) in the plane y = 0 that a rotation about y can attain."""
    same = 0.5 * (overlap[:, 0, 0] + overlap[:, 2, 1])
    turn = 0.5 * (overlap[:, 0, 1] - overlap[:, 2, 0])
    none = np.zeros_like(same)
    return np.stack([same, turn, none, none, -turn, same], axis=-1).reshape(-1, 3, 2)


def _turned_start(target: Floats, fraction: Floats, m: int, planar: bool) -> tuple[Floats, Floats]:
    """Initial pieces with the angles of the polyline, in the optimal direction."""
    from scipy.spatial.transform import Rotation

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
        carried = Rotation.from_rotvec(turns[:, p]).as_matrix() @ carried
    if planar:
        bend[..., 1] = 0.0
    overlap = np.swapaxes(target, 1, 2) @ _along(frame, bend, fraction).position
    if planar:
        return _with_columns(_rotation_part(overlap[..., [0, 2]])) @ frame, bend
    return nearest_rotation(overlap) @ frame, bend


def _frame_along(z: Floats, planar: bool) -> Floats:
    """Frames (K, 3, 3) with z along vectors (K, 3); y is normal to the plane, or arbitrary."""
    z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    if planar:
        y = np.broadcast_to(np.array([0.0, 1.0, 0.0]), z.shape)
    else:
        y = np.cross(z, np.eye(3)[np.argmin(np.abs(z), axis=-1)])
        y /= np.linalg.norm(y, axis=-1, keepdims=True)
    return np.stack([np.cross(y, z), y, z], axis=-1)


def _turns(before: Floats, after: Floats) -> Floats:
    """Rotation vectors (..., 3) from each side to the next; 0 where they are opposite."""
    cross = np.cross(before, after)
    size = np.linalg.norm(cross, axis=-1, keepdims=True)
    angle = np.arctan2(size, np.sum(before * after, axis=-1, keepdims=True))
    return np.asarray(np.where(size > 0, cross / np.where(size > 0, size, 1.0), 0.0) * angle)
