"""Constant curvature: tendon lengths or tensions to arcs, arcs to poses, and back.

A segment's backbone is taken for one circular arc, as in section 3 of the source study [1]_. The
functions here are pure geometry, but for the two force laws, and work on arrays: every argument
may have leading dimensions, which broadcast. All numbers are SI and radians.

The arc has a curvature kappa (1/m), a direction of bending phi (from x towards y) and a length
(m). Its bending angle is theta = kappa * length. Tendon i sits at the angle alpha_i (from x towards
y) and the pitch radius r_i, so the tendon on the inside of a bend is shorter::

    l_i = length - theta r_i cos(phi - alpha_i)

The frame of a pose is the segment's start, z along the straight backbone; a rotation maps body to
that frame and holds no twist, Rz(phi) Ry(theta) Rz(-phi).

Curvature and direction are singular where the arc is straight, so the *bend coordinates*
(theta cos(phi), theta sin(phi), length) carry the computation and are what Jacobians refer to
unless asked otherwise; in them nothing is special about the straight pose.

The tip is that of the study's Eq. 1, z = sin(theta)/kappa, also from tendon lengths. Its Eq. 5,
which is Eq. 1 with the lengths put in, is printed with twice this z: it would put the straight
robot's tip at twice its length.

Bad input raises `bowstring.errors.InputError`; "row" in its text counts along the flattened leading
dimensions.

References
----------
.. [1] Amouri 2019, section 3: forward kinematics under constant curvature, Eq. 1 to 5.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

import bowstring._core as _core
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError

Array = NDArray[np.float64]
Coordinates = Literal["bend", "curvature"]
Correction = Literal["chord"]
Law = Literal["linear", "arm"]

__all__ = [
    "Arc",
    "FittedArc",
    "NearestArc",
    "Pose",
    "RobotArcs",
    "bend",
    "disk_frames",
    "from_bend",
    "from_force",
    "from_force_arm",
    "from_lengths",
    "from_lengths_chord",
    "jacobian_from_lengths",
    "jacobian_lengths",
    "jacobian_pose",
    "jacobian_tip_from_lengths",
    "lengths",
    "nearest_tip",
    "pose",
    "robot_fk",
    "robot_from_tensions",
    "robot_ik",
    "robot_jacobian",
    "robot_lengths",
    "through_tip",
    "tip_from_lengths",
]


class Arc(NamedTuple):
    """Circular arcs."""

    kappa: Array
    """Curvature (...), 1/m, not negative."""
    phi: Array
    """Direction of bending (...), rad in (-pi, pi]; 0 where straight."""
    length: Array
    """Length of the backbone (...), m."""

    @property
    def theta(self) -> Array:
        """Bending angle from base to tip (...), rad."""
        return np.asarray(self.kappa * self.length)


class FittedArc(NamedTuple):
    """Circular arcs fitted to tendon lengths."""

    kappa: Array
    """Curvature (...), 1/m, not negative."""
    phi: Array
    """Direction of bending (...), rad in (-pi, pi]; 0 where straight."""
    length: Array
    """Length of the backbone (...), m."""
    misfit: Array
    """Root mean square of what the arc leaves of the tendon lengths (...), m."""

    @property
    def theta(self) -> Array:
        """Bending angle from base to tip (...), rad."""
        return np.asarray(self.kappa * self.length)


class NearestArc(NamedTuple):
    """Arcs of a given length that end nearest to a point."""

    kappa: Array
    """Curvature (...), 1/m, not negative."""
    phi: Array
    """Direction of bending (...), rad in (-pi, pi]; 0 where it is not unique."""
    miss: Array
    """Distance from the arc's tip to the point (...), m."""


class Pose(NamedTuple):
    """Positions and rotations in the frame of the segment's start."""

    position: Array
    """Position (..., 3), m."""
    rotation: Array
    """Rotation (..., 3, 3), maps body to the segment's start."""


# -- shaping -----------------------------------------------------------------------------------


def _array(name: str, value: ArrayLike, last: int | None = None) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} must be an array of numbers, got {value!r:.60}") from None
    if last is not None and (array.ndim == 0 or array.shape[-1] != last):
        raise InputError(
            f"{name} must have {last} values along the last dimension, got shape {array.shape}"
        )
    return array


def _broadcast(
    scalars: dict[str, ArrayLike], vectors: Sequence[Array] = ()
) -> tuple[tuple[int, ...], list[Array]]:
    """Common leading shape; scalars flattened to (n,), vectors to (n, k)."""
    arrays = [_array(name, value) for name, value in scalars.items()]
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays), *(v.shape[:-1] for v in vectors))
    except ValueError:
        shapes = [str(a.shape) for a in arrays] + [str(v.shape) for v in vectors]
        raise InputError(f"shapes do not broadcast together: {', '.join(shapes)}") from None
    flat: list[Array] = [np.broadcast_to(a, shape).reshape(-1) for a in arrays]
    flat += [np.broadcast_to(v, (*shape, v.shape[-1])).reshape(-1, v.shape[-1]) for v in vectors]
    return shape, flat


def _holes(angles: ArrayLike, radii: ArrayLike) -> Array:
    """Hole positions (T, 2), m."""
    alpha, r = _array("angles", angles), _array("radii", radii)
    if alpha.ndim != 1:
        raise InputError(f"angles must be a list, one a tendon, got shape {alpha.shape}")
    if r.shape not in ((), alpha.shape):
        raise InputError(
            f"radii must be one number or one a tendon ({alpha.size}), got shape {r.shape}"
        )
    if not np.all(np.isfinite(alpha)):
        raise InputError(f"angles must be finite, got {alpha.tolist()} rad")
    if not np.all((r >= 0) & np.isfinite(r)):
        raise InputError(f"radii must be finite and not negative, got {r.tolist()} m")
    return np.stack([r * np.cos(alpha), r * np.sin(alpha)], axis=-1)


def _shares(modules: int | ArrayLike | None) -> Array:
    """Share of each module in the segment's length; empty for curved tendons."""
    if modules is None:
        return np.empty(0)
    if isinstance(modules, int | np.integer):
        if not 1 <= modules <= 100_000:
            raise InputError(f"modules must be from 1 to 100000, got {modules}")
        return np.full(int(modules), 1.0 / int(modules))
    parts = _array("modules", modules)
    if parts.ndim != 1 or parts.size == 0 or not np.all((parts > 0) & np.isfinite(parts)):
        raise InputError(
            "modules must be a whole number or a list of positive module lengths, "
            f"got {modules!r:.60}"
        )
    return np.asarray(parts / parts.sum())


def _arc(rows: Array, shape: tuple[int, ...]) -> Arc:
    kappa, phi = _core.arc_curvature(rows).T
    return Arc(kappa.reshape(shape), phi.reshape(shape), rows[:, 2].reshape(shape))


def _pose(rows: Array, shape: tuple[int, ...]) -> Pose:
    position, rotation = _core.arc_pose(rows)
    return Pose(position.reshape(*shape, 3), rotation.reshape(*shape, 3, 3))


def _option(name: str, value: object, options: Sequence[object]) -> None:
    if value not in options:
        names = ", ".join(repr(o) for o in options)
        raise InputError(f"{name} must be one of {names}, got {value!r:.60}")


# -- arcs and poses ----------------------------------------------------------------------------


def bend(kappa: ArrayLike, phi: ArrayLike, length: ArrayLike) -> Array:
    """Bend coordinates of arcs, smooth through the straight pose.

    Parameters
    ----------
    kappa : array_like (...)
        Curvature, 1/m; a negative one bends towards phi + pi.
    phi : array_like (...)
        Direction of bending, rad from x towards y.
    length : array_like (...)
        Length of the backbone, m.

    Returns
    -------
    ndarray (..., 3)
        theta cos(phi) and theta sin(phi), rad, and the length, m.
    """
    shape, (k, p, length_) = _broadcast({"kappa": kappa, "phi": phi, "length": length})
    return _core.arc_bend(k, p, length_).reshape(*shape, 3)


def from_bend(coordinates: ArrayLike) -> Arc:
    """Arcs from bend coordinates; the inverse of `bend`.

    Parameters
    ----------
    coordinates : array_like (..., 3)
        theta cos(phi) and theta sin(phi), rad, and the length, m.

    Returns
    -------
    Arc
    """
    rows = _array("coordinates", coordinates, 3)
    if not (np.all(np.isfinite(rows)) and np.all(rows[..., 2] > 0)):
        raise InputError("bend coordinates must be finite and their length positive")
    return _arc(np.ascontiguousarray(rows.reshape(-1, 3)), rows.shape[:-1])


def pose(kappa: ArrayLike, phi: ArrayLike, length: ArrayLike, s: ArrayLike | None = None) -> Pose:
    """Pose at the tip of arcs, or at any place along them.

    Parameters
    ----------
    kappa, phi, length : array_like (...)
        Arcs: curvature (1/m), direction of bending (rad), length (m).
    s : array_like (...), optional
        Arc length from the base, m, within [0, length]; the tip if not given. Broadcasts with the
        others: `pose(kappa[..., None], phi[..., None], length[..., None], s)` gives many places.

    Returns
    -------
    Pose
        Position (..., 3), m, and rotation (..., 3, 3), in the frame of the segment's start.

    Notes
    -----
    Amouri 2019, Eq. 1: tip = (1 - cos theta)/kappa (cos phi, sin phi), sin theta/kappa.
    """
    scalars = {"kappa": kappa, "phi": phi, "length": length}
    if s is None:
        shape, (k, p, length_) = _broadcast(scalars)
        return _pose(_core.arc_bend(k, p, length_), shape)
    shape, (k, p, length_, s_) = _broadcast({**scalars, "s": s})
    return _pose(_core.arc_part(_core.arc_bend(k, p, length_), s_), shape)


def disk_frames(
    kappa: ArrayLike, phi: ArrayLike, length: ArrayLike, modules: int | ArrayLike
) -> Pose:
    """Poses of the disks of a segment, base excluded.

    Parameters
    ----------
    kappa, phi, length : array_like (...)
        Arcs: curvature (1/m), direction of bending (rad), length (m).
    modules : int or array_like (n,)
        Number of equal modules, or the lengths of the modules in any unit.

    Returns
    -------
    Pose
        Position (..., n, 3), m, and rotation (..., n, 3, 3); the last is the tip. Amouri 2019,
        Fig. 4.
    """
    shares = _shares(modules)
    shape, (k, p, length_) = _broadcast({"kappa": kappa, "phi": phi, "length": length})
    rows = _core.arc_bend(k, p, length_)
    return _pose_at(rows, np.minimum(np.cumsum(shares), 1.0), shape)


def _pose_at(rows: Array, places: Array, shape: tuple[int, ...]) -> Pose:
    """Poses (..., n, ) at `places`, shares of the length."""
    s = (rows[:, 2:] * places).reshape(-1)
    parts = _core.arc_part(np.repeat(rows, places.size, axis=0), s)
    return _pose(parts, (*shape, places.size))


# -- tendon lengths ----------------------------------------------------------------------------


def lengths(
    kappa: ArrayLike,
    phi: ArrayLike,
    length: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    *,
    modules: int | ArrayLike | None = None,
) -> Array:
    """Tendon lengths of arcs.

    Parameters
    ----------
    kappa, phi, length : array_like (...)
        Arcs: curvature (1/m), direction of bending (rad), length (m).
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    modules : int or array_like (n,), optional
        If given, tendons run straight from disk to disk: number of equal modules, or their lengths
        in any unit. Otherwise they run parallel to the backbone.

    Returns
    -------
    ndarray (..., T)
        Tendon lengths, m: length - theta r cos(phi - alpha), or the sum of the straight spans
        2 sin(a/2) (h/a - r cos(phi - alpha)), a and h the bend and length of a module (Amouri
        2019, Fig. 4).
    """
    hole, shares = _holes(angles, radii), _shares(modules)
    shape, (k, p, length_) = _broadcast({"kappa": kappa, "phi": phi, "length": length})
    out = _core.arc_lengths(_core.arc_bend(k, p, length_), hole, shares)
    return out.reshape(*shape, len(hole))


def _fit(
    lengths: ArrayLike, hole: Array, shares: Array, length: ArrayLike | None
) -> tuple[tuple[int, ...], Array, Array]:
    """Leading shape, arcs (n, 3) and misfits (n,)."""
    tendons = _array("lengths", lengths, len(hole))
    if length is None:
        shape, (rows,) = _broadcast({}, [tendons])
        return shape, *_arc_fit(rows, hole, shares, None)
    shape, (held, rows) = _broadcast({"length": length}, [tendons])
    return shape, *_arc_fit(rows, hole, shares, held)


def from_lengths(
    lengths: ArrayLike, angles: ArrayLike, radii: ArrayLike, length: ArrayLike | None = None
) -> FittedArc:
    """Arcs from tendon lengths, tendons parallel to the backbone.

    Parameters
    ----------
    lengths : array_like (..., T)
        Tendon lengths, m; three tendons or more.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    length : array_like (...), optional
        Holds the arc's length (m) and fits the bend alone; otherwise the length is free.

    Returns
    -------
    FittedArc
        Least squares of l_i - (length - theta r_i cos(phi - alpha_i)). Three tendons at 0, 120 and
        240 degrees: Amouri 2019, Eq. 2-4, with phi in all four quadrants and no misfit.

    Raises
    ------
    InputError
        For lengths that no arc can have: a radius of curvature inside the pitch radius, or more
        than a full turn.
    """
    shape, rows, misfit = _fit(lengths, _holes(angles, radii), _shares(None), length)
    return FittedArc(*_arc(rows, shape), misfit.reshape(shape))


def from_lengths_chord(
    lengths: ArrayLike, angles: ArrayLike, radii: ArrayLike, modules: int | ArrayLike
) -> FittedArc:
    """Arcs from the lengths of tendons that run straight from disk to disk.

    Parameters
    ----------
    lengths : array_like (..., T)
        Tendon lengths, m; three tendons or more.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    modules : int or array_like (n,)
        Number of equal modules, or the lengths of the modules in any unit.

    Returns
    -------
    FittedArc
        Least squares on the straight spans (Amouri 2019, Fig. 4). With n equal modules and q the
        radicand of Eq. 4, the bend of a module is a = 2 asin(sqrt(q)/(3 r n)) and the length is
        (mean tendon length) (a/2)/sin(a/2).
    """
    shape, rows, misfit = _fit(lengths, _holes(angles, radii), _shares(modules), None)
    return FittedArc(*_arc(rows, shape), misfit.reshape(shape))


def tip_from_lengths(
    lengths: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    *,
    length: ArrayLike | None = None,
    modules: int | ArrayLike | None = None,
) -> Pose:
    """Tip pose straight from tendon lengths (Amouri 2019, Eq. 5, with the z of Eq. 1).

    Parameters
    ----------
    lengths : array_like (..., T)
        Tendon lengths, m; three tendons or more.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    length : array_like (...), optional
        Holds the arc's length, m.
    modules : int or array_like (n,), optional
        If given, tendons run straight from disk to disk, see `from_lengths_chord`.

    Returns
    -------
    Pose
        Position (..., 3), m, and rotation (..., 3, 3).
    """
    shape, rows, _ = _fit(lengths, _holes(angles, radii), _shares(modules), length)
    return _pose(rows, shape)


# -- force -------------------------------------------------------------------------------------


def from_force(
    tensions: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    length: ArrayLike,
    bending_stiffness: ArrayLike,
) -> Arc:
    """Arcs from tensions by the linear law.

    Parameters
    ----------
    tensions : array_like (..., T)
        Tensions, N, not negative.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    length : array_like (...)
        Length of the backbone, m; the arc keeps it.
    bending_stiffness : array_like (...)
        E I, N m^2.

    Returns
    -------
    Arc
        Bend vector (length/EI) sum of T_i r_i (cos alpha_i, sin alpha_i); for one tendon theta =
        F r l/(E I). The angle is not limited: a soft backbone winds up.
    """
    return _from_tensions(tensions, _holes(angles, radii), length, bending_stiffness, None)


def from_force_arm(
    tensions: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    length: ArrayLike,
    bending_stiffness: ArrayLike,
    modules: int,
) -> Arc:
    """Arcs from tensions by the linear law with the mean lever arm of straight spans.

    Parameters
    ----------
    tensions : array_like (..., T)
        Tensions, N, not negative.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    length : array_like (...)
        Length of the backbone, m; the arc keeps it.
    bending_stiffness : array_like (...)
        E I, N m^2.
    modules : int
        Number n of equal modules.

    Returns
    -------
    Arc
        Bends along the moment m = sum of T_i r_i (cos alpha_i, sin alpha_i), with F = sum of T_i
        and a = theta/n, by theta = (l/EI) (|m| + F (l/n) a/12 - |m| a^2/8).

    Raises
    ------
    NoSolutionError
        From the total tension on at which the backbone buckles between its disks, Euler's
        pi^2 E I n^2/l^2.

    Notes
    -----
    The law is where the energy of a module is stationary, E I a^2/(2 h) plus tensions times the
    straight spans 2 sin(a/2) (h/a - r cos(phi - alpha)), h = l/n, to second order in a. For one
    tendon it is theta = (F l/EI) (r + (l/n) a/12 - r a^2/8), solved exactly as a quadratic.
    """
    if not isinstance(modules, int | np.integer) or not 1 <= modules <= 100_000:
        raise InputError(f"modules must be a whole number from 1 to 100000, got {modules!r:.60}")
    return _from_tensions(tensions, _holes(angles, radii), length, bending_stiffness, int(modules))


def _from_tensions(
    tensions: ArrayLike,
    hole: Array,
    length: ArrayLike,
    bending_stiffness: ArrayLike,
    modules: int | None,
) -> Arc:
    pulls = _array("tensions", tensions, len(hole))
    scalars = {"length": length, "bending_stiffness": bending_stiffness}
    shape, (length_, stiffness, rows) = _broadcast(scalars, [pulls])
    return _arc(_core.arc_from_tensions(rows, hole, length_, stiffness, modules), shape)


# -- tip to arc --------------------------------------------------------------------------------


def through_tip(position: ArrayLike) -> Arc:
    """Arcs that end at the given tips; their length is free.

    Parameters
    ----------
    position : array_like (..., 3)
        Tip, m, in the frame of the segment's start.

    Returns
    -------
    Arc
        phi = atan2(y, x), theta = 2 atan2(hypot(x, y), z) below 2 pi, length = |tip| (theta/2) /
        sin(theta/2).

    Raises
    ------
    InputError
        For the points no arc ends at: the base itself and the axis behind it.
    """
    points = _array("position", position, 3)
    rows = _core.arc_through(np.ascontiguousarray(points.reshape(-1, 3)))
    return _arc(rows, points.shape[:-1])


def nearest_tip(position: ArrayLike, length: ArrayLike) -> NearestArc:
    """Arcs of a given length that end nearest to the given tips.

    Parameters
    ----------
    position : array_like (..., 3)
        Tip, m, in the frame of the segment's start.
    length : array_like (...)
        Length of the arcs, m.

    Returns
    -------
    NearestArc
        The nearest of all arcs with theta from 0 to 2 pi, and its distance. Where its direction is
        not unique (tips on the z axis) phi is 0.
    """
    points = _array("position", position, 3)
    shape, (length_, rows) = _broadcast({"length": length}, [points])
    rows, miss = _core.arc_nearest(rows, length_)
    arc = _arc(rows, shape)
    return NearestArc(arc.kappa, arc.phi, miss.reshape(shape))


# -- Jacobians ---------------------------------------------------------------------------------


def jacobian_pose(
    kappa: ArrayLike,
    phi: ArrayLike,
    length: ArrayLike,
    *,
    coordinates: Coordinates = "bend",
) -> Array:
    """Derivative of the tip pose by the arc.

    Parameters
    ----------
    kappa, phi, length : array_like (...)
        Arcs: curvature (1/m), direction of bending (rad), length (m).
    coordinates : {"bend", "curvature"}
        What the columns refer to: (theta cos phi, theta sin phi, length), or (kappa, phi, length).

    Returns
    -------
    ndarray (..., 6, 3)
        Rows 0 to 2: tip position, m. Rows 3 to 5: rotation vector w in the axes of the segment's
        start, rad, with dR = [w] R.
    """
    _option("coordinates", coordinates, ("bend", "curvature"))
    shape, (k, p, length_) = _broadcast({"kappa": kappa, "phi": phi, "length": length})
    out = _core.arc_pose_jacobian(_core.arc_bend(k, p, length_))
    if coordinates == "curvature":
        out = out @ _core.arc_bend_jacobian(k, p, length_)
    return out.reshape(*shape, 6, 3)


def jacobian_lengths(
    kappa: ArrayLike,
    phi: ArrayLike,
    length: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    *,
    modules: int | ArrayLike | None = None,
    coordinates: Coordinates = "bend",
) -> Array:
    """Derivative of the tendon lengths by the arc; the parameters are those of `lengths`.

    Parameters
    ----------
    kappa, phi, length : array_like (...)
        Arcs: curvature (1/m), direction of bending (rad), length (m).
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    modules : int or array_like (n,), optional
        If given, tendons run straight from disk to disk.
    coordinates : {"bend", "curvature"}
        What the columns refer to: (theta cos phi, theta sin phi, length), or (kappa, phi, length).

    Returns
    -------
    ndarray (..., T, 3)
        Rows: tendon lengths, m.
    """
    _option("coordinates", coordinates, ("bend", "curvature"))
    hole, shares = _holes(angles, radii), _shares(modules)
    shape, (k, p, length_) = _broadcast({"kappa": kappa, "phi": phi, "length": length})
    out = _core.arc_lengths_jacobian(_core.arc_bend(k, p, length_), hole, shares)
    if coordinates == "curvature":
        out = out @ _core.arc_bend_jacobian(k, p, length_)
    return out.reshape(*shape, len(hole), 3)


def jacobian_from_lengths(
    lengths: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    *,
    length: ArrayLike | None = None,
    modules: int | ArrayLike | None = None,
    coordinates: Coordinates = "bend",
) -> Array:
    """Derivative of the fitted arc by the tendon lengths.

    Parameters
    ----------
    lengths : array_like (..., T)
        Tendon lengths, m; three tendons or more.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    length : array_like (...), optional
        Holds the arc's length, m; its row of the Jacobian is then zero.
    modules : int or array_like (n,), optional
        If given, tendons run straight from disk to disk.
    coordinates : {"bend", "curvature"}
        What the rows refer to: (theta cos phi, theta sin phi, length), or (kappa, phi, length).

    Returns
    -------
    ndarray (..., 3, T)

    Raises
    ------
    InputError
        With coordinates "curvature" at a straight arc, where phi has no derivative.
    """
    _option("coordinates", coordinates, ("bend", "curvature"))
    hole, shares = _holes(angles, radii), _shares(modules)
    shape, rows, _ = _fit(lengths, hole, shares, length)
    out = _core.arc_fit_jacobian(rows, hole, shares, length is not None)
    if coordinates == "curvature":
        out = _core.arc_curvature_jacobian(rows) @ out
    return out.reshape(*shape, 3, len(hole))


def jacobian_tip_from_lengths(
    lengths: ArrayLike,
    angles: ArrayLike,
    radii: ArrayLike,
    *,
    length: ArrayLike | None = None,
    modules: int | ArrayLike | None = None,
) -> Array:
    """Derivative of the tip pose by the tendon lengths: both maps composed.

    Parameters
    ----------
    lengths : array_like (..., T)
        Tendon lengths, m; three tendons or more.
    angles : array_like (T,)
        Tendon angles alpha, rad from x towards y.
    radii : array_like (T,) or float
        Pitch radii, m.
    length : array_like (...), optional
        Holds the arc's length, m.
    modules : int or array_like (n,), optional
        If given, tendons run straight from disk to disk.

    Returns
    -------
    ndarray (..., 6, T)
        Rows as in `jacobian_pose`: position, then rotation vector, in the axes of the segment's
        start.
    """
    hole, shares = _holes(angles, radii), _shares(modules)
    shape, rows, _ = _fit(lengths, hole, shares, length)
    out = _core.arc_pose_jacobian(rows)
    out = out @ _core.arc_fit_jacobian(rows, hole, shares, length is not None)
    return out.reshape(*shape, 6, len(hole))


# -- robots: segments in series ----------------------------------------------------------------


class _Robot(Protocol):
    """What is read of a robot."""

    @property
    def segments(self) -> Sequence[Any]: ...
    @property
    def tendons(self) -> Any: ...
    @property
    def disks(self) -> Any: ...
    @property
    def bending_stiffness(self) -> Any: ...


@short_repr
@dataclass(frozen=True, eq=False)
class RobotArcs:
    """A robot's backbone as one arc a segment, in the robot's base frame."""

    kappa: Array
    """Curvatures (..., S), 1/m."""
    phi: Array
    """Directions of bending (..., S), rad, in the frame of each segment's start."""
    length: Array
    """Lengths (..., S), m."""
    misfit: Array
    """Root mean square of what each arc leaves of its tendon lengths (..., S), m."""
    tip: Pose
    """Tip: position (..., 3), m, and rotation (..., 3, 3)."""
    disk_positions: Array
    """Disk centres from base to tip, base excluded (..., N, 3), m."""
    disk_rotations: Array
    """Disk rotations (..., N, 3, 3)."""

    @property
    def theta(self) -> Array:
        """Bending angles (..., S), rad."""
        return np.asarray(self.kappa * self.length)

    def centerline(self, points_per_segment: int = 65) -> Array:
        """Backbone from base to tip.

        Parameters
        ----------
        points_per_segment : int
            Points of each arc, both ends counted; two at least.

        Returns
        -------
        ndarray (..., S (points_per_segment - 1) + 1, 3)
            Positions, m.
        """
        if points_per_segment < 2:
            raise InputError(f"points_per_segment must be at least 2, got {points_per_segment}")
        shape = self.kappa.shape[:-1]
        position, rotation = np.zeros(3), np.eye(3)
        pieces = [np.zeros((*shape, 1, 3))]
        places = np.linspace(0.0, 1.0, points_per_segment)[1:]
        rows = bend(self.kappa, self.phi, self.length)
        for j in range(self.kappa.shape[-1]):
            arc = _pose_at(rows[..., j, :].reshape(-1, 3), places, shape)
            piece = _join(position, rotation, arc)
            pieces.append(piece.position)
            position, rotation = piece.position[..., -1, :], piece.rotation[..., -1, :, :]
        return np.concatenate(pieces, axis=-2)


def _join(position: Array, rotation: Array, local: Pose) -> Pose:
    """Poses (..., n) in the base frame from poses in a segment's frame (...)."""
    turn = rotation[..., None, :, :]
    moved = (turn @ local.position[..., None])[..., 0]
    return Pose(position[..., None, :] + moved, turn @ local.rotation)


@dataclass(frozen=True)
class _Segment:
    """One segment as constant curvature sees it."""

    index: int
    length: float
    bending_stiffness: float
    own: NDArray[np.intp]
    """Tendons that end here."""
    passing: NDArray[np.intp]
    """Tendons that end here or further out."""
    places: Array
    """Disks as shares of the length."""

    def shares(self, correction: Correction | None) -> Array:
        if correction is None:
            return np.empty(0)
        if abs(self.places[-1] - 1.0) > 1e-9:
            raise InputError(
                f"segment {self.index + 1}: the chord correction needs a disk at the segment's end"
            )
        return _shares(np.diff(self.places, prepend=0.0))


def _check_robot(robot: object) -> None:
    if not hasattr(robot, "segments"):
        raise InputError(
            f"robot is {robot!r:.60}, it must be a Robot, as bowstring.load_robot gives it"
        )


def _segments(robot: _Robot) -> list[_Segment]:
    _check_robot(robot)
    out, start = [], 0.0
    stations = np.asarray(robot.disks.station_m, dtype=np.float64)
    ends = np.asarray(robot.tendons.segment)
    for j, segment in enumerate(robot.segments):
        length = float(segment.length)
        here = stations[np.asarray(robot.disks.segment) == j]
        # the stations are sums of lengths and carry their rounding
        places = np.clip((here - start) / length, 0.0, 1.0)
        out.append(
            _Segment(
                j,
                length,
                float(robot.bending_stiffness[j]),
                np.flatnonzero(ends == j),
                np.flatnonzero(ends >= j),
                places,
            )
        )
        start += length
    return out


def _arc_fit(rows: Array, hole: Array, shares: Array, held: Array | None) -> tuple[Array, Array]:
    try:
        return _core.arc_fit(rows, hole, shares, held)
    except BowstringError as error:
        if turn := re.search(r"bend it by (\S+) rad, more than a full turn", str(error)):
            raise type(error)(
                "these tendon lengths would need more than a full turn "
                f"({float(turn[1]):.4g} rad), which is not computed"
            ) from None
        raise


def _robot_holes(robot: _Robot) -> Array:
    _check_robot(robot)
    return np.ascontiguousarray(robot.tendons.hole_m, dtype=np.float64)


def _named(segment: _Segment, error: BowstringError) -> BowstringError:
    return type(error)(f"segment {segment.index + 1}: {error}")


def _assemble(
    segments: list[_Segment], rows: list[Array], misfits: list[Array], shape: tuple[int, ...]
) -> RobotArcs:
    arcs = [_arc(r, shape) for r in rows]
    position, rotation = np.zeros((*shape, 3)), np.broadcast_to(np.eye(3), (*shape, 3, 3))
    positions, rotations = [], []
    for segment, r in zip(segments, rows, strict=True):
        frames = _join(position, rotation, _pose_at(r, np.append(segment.places, 1.0), shape))
        positions.append(frames.position[..., :-1, :])
        rotations.append(frames.rotation[..., :-1, :, :])
        position, rotation = frames.position[..., -1, :], frames.rotation[..., -1, :, :]
    return RobotArcs(
        kappa=np.stack([a.kappa for a in arcs], axis=-1),
        phi=np.stack([a.phi for a in arcs], axis=-1),
        length=np.stack([a.length for a in arcs], axis=-1),
        misfit=np.stack([m.reshape(shape) for m in misfits], axis=-1),
        tip=Pose(position, rotation),
        disk_positions=np.concatenate(positions, axis=-2),
        disk_rotations=np.concatenate(rotations, axis=-3),
    )


def _robot_fit(
    robot: _Robot, lengths: ArrayLike, correction: Correction | None
) -> tuple[tuple[int, ...], list[_Segment], list[Array], list[Array]]:
    """Leading shape, segments, and their arcs (n, 3) and misfits (n,)."""
    _option("correction", correction, (None, "chord"))
    hole = _robot_holes(robot)
    tendons = _array("lengths", lengths, len(hole))
    shape, (rest,) = _broadcast({}, [tendons])
    for t in range(len(hole)):
        wrong = rest[~((rest[:, t] > 0) & np.isfinite(rest[:, t])), t]
        if wrong.size:
            raise InputError(
                f"the length of tendon {t + 1} must be positive and finite, got {wrong[0]} m"
            )
    segments = _segments(robot)
    rest = rest.copy()
    rows, misfits = [], []
    for segment in segments:
        shares = segment.shares(correction)
        own = np.ascontiguousarray(rest[:, segment.own])
        if np.any(own <= 0):
            t = int(segment.own[np.argmax(np.any(own <= 0, axis=0))])
            raise InputError(
                f"segment {segment.index + 1}: tendon {t + 1} is shorter than the bent segments "
                "before it, so nothing is left of it for its own"
            )
        try:
            arcs, misfit = _arc_fit(own, hole[segment.own], shares, None)
            further = np.setdiff1d(segment.passing, segment.own)
            if further.size:
                rest[:, further] -= _core.arc_lengths(arcs, hole[further], shares)
        except BowstringError as error:
            raise _named(segment, error) from None
        rows.append(arcs)
        misfits.append(misfit)
    return shape, segments, rows, misfits


def robot_fk(robot: _Robot, lengths: ArrayLike, correction: Correction | None = None) -> RobotArcs:
    """Forward kinematics of a robot from its tendon lengths.

    Each segment's arc comes from the tendons that end at it. What an outer tendon spends in the
    inner segments follows from their arcs at its holes and is taken off first.

    Parameters
    ----------
    robot : Robot
    lengths : array_like (..., T)
        Tendon lengths from the base to each tendon's end disk, m.
    correction : {None, "chord"}
        None: tendons parallel to the backbone (Amouri 2019, Eq. 2-5). "chord": straight from disk
        to disk (Fig. 4), at the robot's own disk positions.

    Returns
    -------
    RobotArcs
    """
    shape, segments, rows, misfits = _robot_fit(robot, lengths, correction)
    return _assemble(segments, rows, misfits, shape)


def robot_from_tensions(robot: _Robot, tensions: ArrayLike, law: Law = "linear") -> RobotArcs:
    """Arcs of a robot from its tensions; segments keep their lengths.

    Every tendon bends all segments it passes, not only the one it ends at.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (..., T)
        Tensions, N, not negative.
    law : {"linear", "arm"}
        The law of `from_force` or of `from_force_arm`; the latter takes a segment's disks for
        equally spaced.

    Returns
    -------
    RobotArcs
        Its misfit is zero.
    """
    _option("law", law, ("linear", "arm"))
    hole = _robot_holes(robot)
    shape, (pulls,) = _broadcast({}, [_array("tensions", tensions, len(hole))])
    for t in range(len(hole)):
        wrong = pulls[~((pulls[:, t] >= 0) & np.isfinite(pulls[:, t])), t]
        if wrong.size:
            raise InputError(
                f"the tension of tendon {t} must be finite and not negative, got {wrong[0]} N"
            )
    segments = _segments(robot)
    rows = []
    for segment in segments:
        try:
            rows.append(
                _core.arc_from_tensions(
                    np.ascontiguousarray(pulls[:, segment.passing]),
                    hole[segment.passing],
                    np.full(len(pulls), segment.length),
                    np.full(len(pulls), segment.bending_stiffness),
                    segment.places.size if law == "arm" else None,
                )
            )
        except BowstringError as error:
            raise _named(segment, error) from None
    return _assemble(segments, rows, [np.zeros(len(pulls))] * len(rows), shape)


def robot_lengths(
    robot: _Robot,
    kappa: ArrayLike,
    phi: ArrayLike,
    length: ArrayLike | None = None,
    correction: Correction | None = None,
) -> Array:
    """Tendon lengths of a robot from its arcs; the inverse of `robot_fk`.

    Parameters
    ----------
    robot : Robot
    kappa, phi : array_like (..., S)
        Curvatures (1/m) and directions of bending (rad) of the segments.
    length : array_like (..., S), optional
        Lengths of the segments, m; the robot's own if not given.
    correction : {None, "chord"}
        As in `robot_fk`.

    Returns
    -------
    ndarray (..., T)
        Tendon lengths from the base to each tendon's end disk, m.
    """
    _option("correction", correction, (None, "chord"))
    segments, hole = _segments(robot), _robot_holes(robot)
    count = len(segments)
    own = [s.length for s in segments]
    vectors = [
        _array("kappa", kappa, count),
        _array("phi", phi, count),
        _array("length", own if length is None else length, count),
    ]
    shape, (k, p, length_) = _broadcast({}, vectors)
    out = np.zeros((len(k), len(hole)))
    for j, segment in enumerate(segments):
        try:
            rows = _core.arc_bend(*(np.ascontiguousarray(v[:, j]) for v in (k, p, length_)))
            shares = segment.shares(correction)
            out[:, segment.passing] += _core.arc_lengths(rows, hole[segment.passing], shares)
        except BowstringError as error:
            raise _named(segment, error) from None
    return out.reshape(*shape, len(hole))


def robot_ik(
    robot: _Robot, position: ArrayLike, correction: Correction | None = None
) -> tuple[Array, Array]:
    """Tendon lengths that bring a one-segment robot's tip nearest to a point.

    Parameters
    ----------
    robot : Robot
        With one segment: more have no unique answer.
    position : array_like (..., 3)
        Wanted tip position, m, base frame.
    correction : {None, "chord"}
        As in `robot_fk`.

    Returns
    -------
    lengths : ndarray (..., T)
        Tendon lengths, m.
    miss : ndarray (...)
        Distance from the tip of the arc of the robot's own length to the point, m.
    """
    if len(robot.segments) != 1:
        raise InputError(
            f"the inverse is for one segment, this robot has {len(robot.segments)}; "
            "iterate with robot_jacobian"
        )
    arc = nearest_tip(position, float(robot.segments[0].length))
    out = robot_lengths(robot, arc.kappa[..., None], arc.phi[..., None], None, correction)
    return out, arc.miss


def robot_jacobian(
    robot: _Robot, lengths: ArrayLike, correction: Correction | None = None
) -> Array:
    """Derivative of a robot's tip pose by its tendon lengths.

    Parameters
    ----------
    robot : Robot
    lengths : array_like (..., T)
        Tendon lengths from the base to each tendon's end disk, m.
    correction : {None, "chord"}
        As in `robot_fk`.

    Returns
    -------
    ndarray (..., 6, T)
        Rows 0 to 2: tip position, m. Rows 3 to 5: rotation vector in base axes, rad.
    """
    shape, segments, rows, _ = _robot_fit(robot, lengths, correction)
    hole = _robot_holes(robot)
    n, count = len(rows[0]), len(hole)

    # how the lengths left for a segment change with all lengths
    rest = np.broadcast_to(np.eye(count), (n, count, count)).copy()
    rotation: Array = np.broadcast_to(np.eye(3), (n, 3, 3))
    out = np.zeros((n, 6, count))
    for segment, arcs in zip(segments, rows, strict=True):
        shares = segment.shares(correction)
        by_length = _core.arc_fit_jacobian(arcs, hole[segment.own], shares, False)
        by_length = by_length @ rest[:, segment.own]
        further = np.setdiff1d(segment.passing, segment.own)
        if further.size:
            spent = _core.arc_lengths_jacobian(arcs, hole[further], shares)
            rest[:, further] -= spent @ by_length

        local = _core.arc_pose_jacobian(arcs) @ by_length
        step, turn = _core.arc_pose(arcs)
        arm = (rotation @ step[..., None])[..., 0]
        # the turns so far carry this segment's tip along
        out[:, :3] += np.cross(out[:, 3:], arm[..., None], axis=1)
        out[:, :3] += rotation @ local[:, :3]
        out[:, 3:] += rotation @ local[:, 3:]
        rotation = rotation @ turn
    return out.reshape(*shape, 6, count)
