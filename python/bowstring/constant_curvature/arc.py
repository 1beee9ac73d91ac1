"""Constant curvature of one segment: tendon lengths or tensions to arcs, arcs to poses, and back.

The backbone of a segment is one circular arc, as in section 3 of the source study [1]_. All maps
are pure geometry except for the two force laws. Every argument may have leading dimensions, which
broadcast. All numbers are in SI and radians. docs/theory/constant-curvature.md has the equations.

An arc has a curvature kappa (1/m), a direction of bending phi (from x towards y) and a length (m);
its bend angle is theta = kappa * length. Tendon i sits at the angle alpha_i (from x towards y)
and the pitch radius r_i, so the tendon on the inside of a bend is shorter::

    l_i = length - theta r_i cos(phi - alpha_i)

The frame of a pose is the segment's start, z along the straight backbone. A rotation maps body to
that frame and contains no twist: Rz(phi) Ry(theta) Rz(-phi).

Curvature and direction are singular where the arc is straight. Computations therefore use the
*bend coordinates* (theta cos(phi), theta sin(phi), length), in which the straight pose is regular
(theory Eq. 1.2). Jacobians refer to them by default.

The tip follows the study's Eq. 1, z = sin(theta)/kappa, also from tendon lengths. The study's
Eq. 5, which is its Eq. 1 in terms of lengths, is printed with twice this z: the straight robot's
tip would be at twice its length.

Bad input raises `bowstring.errors.InputError`; "row" in its text counts along the flattened leading
dimensions.

References
----------
.. [1] Amouri 2019, section 3: forward kinematics under constant curvature, Eq. 1 to 5.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

import bowstring._core as _core
from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.pose import Pose
from bowstring.robot.arrays import frozen
from bowstring.validation import shown

Coordinates = Literal["bend", "curvature"]


@short_repr
@dataclass(frozen=True, eq=False, init=False)
class Routing:
    """Routing of the tendons of one segment, parallel to the backbone.

    ``routing[index]`` selects tendons.
    """

    holes: Floats
    """Positions x, y of the holes (T, 2), m."""

    def __init__(self, angles: ArrayLike, radii: ArrayLike) -> None:
        """Make a routing from angles and pitch radii.

        Parameters
        ----------
        angles : array_like (T,)
            Tendon angles alpha, rad from x towards y.
        radii : array_like (T,) or float
            Pitch radii, m.
        """
        alpha, r = to_array("angles", angles), to_array("radii", radii)
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
        self._set(np.stack([r * np.cos(alpha), r * np.sin(alpha)], axis=-1))

    @classmethod
    def from_holes(cls, holes: ArrayLike) -> Routing:
        """Make a routing from hole positions (T, 2), m."""
        routing = cls.__new__(cls)
        routing._set(to_array("holes", holes, 2))
        return routing

    def _set(self, holes: Floats) -> None:
        object.__setattr__(self, "holes", frozen(holes))

    def __len__(self) -> int:
        return len(self.holes)

    def __getitem__(self, index: Any) -> Routing:
        return Routing.from_holes(self.holes[index])


@short_repr
@dataclass(frozen=True, eq=False, init=False)
class Arc:
    """Array of circular arcs of any shape; ``arc[index]`` indexes as NumPy does."""

    kappa: Floats
    """Curvature (...), 1/m."""
    phi: Floats
    """Direction of bending (...), rad; in (-pi, pi] and 0 where straight, unless given."""
    length: Floats
    """Length of the backbone (...), m."""
    misfit: Floats
    """Residual of the fit (...), m: root mean square over tendon lengths (`from_lengths`) or
    distance from the tip to the point (`ik`); zero otherwise."""
    bend: Floats = field(repr=False)
    """Bend coordinates (..., 3): theta cos(phi) and theta sin(phi), rad, and the length, m."""

    def __init__(self, kappa: ArrayLike, phi: ArrayLike, length: ArrayLike) -> None:
        """Make arcs.

        Parameters
        ----------
        kappa : array_like (...)
            Curvature, 1/m; a negative one bends towards phi + pi.
        phi : array_like (...)
            Direction of bending, rad from x towards y.
        length : array_like (...)
            Length of the backbone, m.
        """
        shape, rows = broadcast({"kappa": kappa, "phi": phi, "length": length})
        self._set(shape, *rows, np.zeros(shape), _core.arc_bend(*rows))

    def _set(self, shape: tuple[int, ...], *values: Floats) -> None:
        names = ("kappa", "phi", "length", "misfit", "bend")
        for name, value in zip(names, values, strict=True):
            whole = frozen(value).reshape((*shape, 3) if name == "bend" else shape)
            object.__setattr__(self, name, whole)

    @classmethod
    def _of(cls, bend: Floats, shape: tuple[int, ...], misfit: Floats | None = None) -> Arc:
        """Make arcs from checked bend coordinates."""
        rows = np.ascontiguousarray(bend).reshape(-1, 3)
        kappa, phi = _core.arc_curvature(rows).T
        arc = cls.__new__(cls)
        arc._set(shape, kappa, phi, rows[:, 2], np.zeros(shape) if misfit is None else misfit, rows)
        return arc

    # -- constructors --------------------------------------------------------------------------

    @classmethod
    def from_bend(cls, coordinates: ArrayLike) -> Arc:
        """Make arcs from bend coordinates.

        Parameters
        ----------
        coordinates : array_like (..., 3)
            theta cos(phi) and theta sin(phi), rad, and the length, m.

        Returns
        -------
        Arc
        """
        rows = to_array("coordinates", coordinates, 3)
        if not (np.all(np.isfinite(rows)) and np.all(rows[..., 2] > 0)):
            raise InputError("bend coordinates must be finite and their length positive")
        return cls._of(rows, rows.shape[:-1])

    @classmethod
    def from_lengths(
        cls, lengths: ArrayLike, routing: Routing, length: ArrayLike | None = None
    ) -> Arc:
        """Fit arcs to tendon lengths.

        Parameters
        ----------
        lengths : array_like (..., T)
            Tendon lengths, m; of any number of tendons if `length` is given. Without it three or
            more, or tendons on both sides of the axis in one plane with it, as an opposite pair.
        routing : Routing
            Holes of the tendons.
        length : array_like (...), optional
            Fixed length of the arc, m, so that only the bend is fitted. By default the length is
            free.

        Returns
        -------
        Arc
            Least-squares fit of l_i = length - theta r_i cos(phi - alpha_i), theory Eq. 1.3. For
            three tendons at 0, 120 and 240 degrees it is theory Eq. 1.4 (Amouri 2019, Eq. 2-4, with
            phi in all four quadrants), without misfit.

        Raises
        ------
        InputError
            For lengths that no arc can have: a radius of curvature inside the pitch radius, or more
            than a full turn.
        """
        tendons = to_array("lengths", lengths, len(routing))
        shape, (*held, rows) = broadcast({} if length is None else {"length": length}, tendons)
        bend, misfit = _core.arc_fit(rows, routing.holes, held[0] if held else None)
        return cls._of(bend, shape, misfit)

    @classmethod
    def from_tensions(
        cls,
        tensions: ArrayLike,
        routing: Routing,
        length: ArrayLike,
        bending_stiffness: ArrayLike,
    ) -> Arc:
        """Make arcs from tensions by the linear law.

        Parameters
        ----------
        tensions : array_like (..., T)
            Tensions, N, not negative.
        routing : Routing
            Holes of the tendons.
        length : array_like (...)
            Length of the backbone, m; the arc keeps it.
        bending_stiffness : array_like (...)
            E I, N m^2.

        Returns
        -------
        Arc
            Arcs that bend along the moment m = sum of T_i r_i (cos alpha_i, sin alpha_i) by
            ``|m| l/(E I)``, for one tendon ``F r l/(E I)`` (theory Eq. 1.7), without an upper
            limit.
        """
        given = to_array("tensions", tensions, len(routing))
        scalars = {"length": length, "bending_stiffness": bending_stiffness}
        shape, (length_, stiffness, rows) = broadcast(scalars, given)
        return cls._of(_core.arc_from_tensions(rows, routing.holes, length_, stiffness), shape)

    @classmethod
    def ik(cls, position: ArrayLike, length: ArrayLike | None = None) -> Arc:
        """Find the arcs that end at points, or nearest to them.

        Parameters
        ----------
        position : array_like (..., 3)
            Target position of the tip, m, in the frame of the segment's start.
        length : array_like (...), optional
            Length of the arcs, m. By default it is free and the arcs end at the points.

        Returns
        -------
        Arc
            With a free length: phi = atan2(y, x), theta = 2 atan2(hypot(x, y), z) below 2 pi,
            length = ``|tip| (theta/2)/sin(theta/2)``. With a given length: the arc with theta from
            0 to 2 pi whose tip is nearest, with its distance as `misfit`; phi is 0 where it is not
            unique (z axis).

        Raises
        ------
        InputError
            With a free length, for a point that no arc reaches: the origin and the negative z
            axis.
        """
        points = to_array("position", position, 3)
        if length is None:
            rows = _core.arc_through(points.reshape(-1, 3))
            return cls._of(rows, points.shape[:-1])
        shape, (length_, rows) = broadcast({"length": length}, points)
        bend, miss = _core.arc_nearest(rows, length_)
        return cls._of(bend, shape, miss)

    # -- maps ----------------------------------------------------------------------------------

    @property
    def theta(self) -> Floats:
        """Bend angle from base to tip (...), rad."""
        return np.asarray(self.kappa * self.length)

    def __getitem__(self, index: Any) -> Arc:
        arc = Arc.__new__(Arc)
        index = index if isinstance(index, tuple) else (index,)
        whole = (*index, slice(None)) if any(i is ... for i in index) else index
        bend = self.bend[whole]
        scalars = (self.kappa, self.phi, self.length, self.misfit)
        arc._set(bend.shape[:-1], *(value[index] for value in scalars), bend)
        return arc

    def fk(self, s: ArrayLike | None = None) -> Pose:
        """Pose at the tip, or at any arc length.

        Parameters
        ----------
        s : array_like (...), optional
            Arc length from the base, m, within [0, length]; the tip if not given. Broadcasts with
            the arcs: ``arc[..., None].fk(s)`` gives several points of each.

        Returns
        -------
        Pose
            Position (..., 3), m, and rotation (..., 3, 3), in the frame of the segment's start.

        Notes
        -----
        theory Eq. 1.1 (Amouri 2019, Eq. 1):
        tip = (1 - cos theta)/kappa (cos phi, sin phi), sin theta/kappa.
        """
        shape, rows = self.kappa.shape, self.bend.reshape(-1, 3)
        if s is not None:
            shape, (s_, rows) = broadcast({"s": s}, self.bend)
            rows = _core.arc_part(rows, s_)
        position, rotation = _core.arc_pose(rows)
        return Pose(position.reshape(*shape, 3), rotation.reshape(*shape, 3, 3))

    def lengths(self, routing: Routing) -> Floats:
        """Tendon lengths (..., T), m.

        Parallel to the backbone: length - theta r cos(phi - alpha), theory Eq. 1.3.
        """
        out = _core.arc_lengths(self.bend.reshape(-1, 3), routing.holes)
        return out.reshape(*self.kappa.shape, len(routing))

    def jacobian(self, coordinates: Coordinates = "bend") -> Floats:
        """Derivative of the tip pose by the arc.

        Parameters
        ----------
        coordinates : {"bend", "curvature"}
            Variables of the columns: (theta cos phi, theta sin phi, length), or (kappa, phi,
            length).

        Returns
        -------
        ndarray (..., 6, 3)
            Rows 0 to 2: tip position, m. Rows 3 to 5: rotation vector w in the axes of the
            segment's start, rad, with dR = [w] R. The derivative by tendon lengths is
            ``arc.jacobian() @ arc.from_lengths_jacobian(routing)``.
        """
        return self._by(coordinates, _core.arc_pose_jacobian(self.bend.reshape(-1, 3)))

    def lengths_jacobian(self, routing: Routing, coordinates: Coordinates = "bend") -> Floats:
        """Derivative (..., T, 3) of `lengths` by the arc; coordinates as in `jacobian`."""
        rows = self.bend.reshape(-1, 3)
        out = _core.arc_lengths_jacobian(rows, routing.holes)
        return self._by(coordinates, out)

    def from_lengths_jacobian(
        self, routing: Routing, coordinates: Coordinates = "bend", *, hold_length: bool = False
    ) -> Floats:
        """Derivative of `from_lengths` by the tendon lengths, at its result.

        Parameters
        ----------
        routing : Routing
            As for `from_lengths`.
        coordinates : {"bend", "curvature"}
            Variables of the rows: (theta cos phi, theta sin phi, length), or (kappa, phi, length).
        hold_length : bool
            Whether the arc's length was fixed; its row is then zero.

        Returns
        -------
        ndarray (..., 3, T)
            Derivatives in SI units per metre of tendon.

        Raises
        ------
        InputError
            With coordinates "curvature" at a straight arc, where phi has no derivative.
        """
        check_option("coordinates", coordinates, ("bend", "curvature"))
        out = _core.arc_fit_jacobian(routing.holes, hold_length)
        if coordinates == "curvature":
            out = _core.arc_curvature_jacobian(self.bend.reshape(-1, 3)) @ out
            return out.reshape(*self.kappa.shape, 3, len(routing))
        return np.broadcast_to(out, (*self.kappa.shape, 3, len(routing)))

    def _by(self, coordinates: Coordinates, by_bend: Floats) -> Floats:
        """Convert derivatives (n, k, 3) by bend coordinates to (..., k, 3) by `coordinates`."""
        check_option("coordinates", coordinates, ("bend", "curvature"))
        if coordinates == "curvature":
            scalars = (v.reshape(-1) for v in (self.kappa, self.phi, self.length))
            by_bend = by_bend @ _core.arc_bend_jacobian(*scalars)
        return by_bend.reshape(*self.kappa.shape, *by_bend.shape[1:])


# -- arguments ---------------------------------------------------------------------------------


def to_array(name: str, value: ArrayLike, last: int | None = None) -> Floats:
    """Convert to an array of numbers, `last` of them along the last dimension."""
    try:
        array = np.asarray(value, dtype=np.float64)
    except (OverflowError, TypeError, ValueError):
        raise InputError(f"{name} must be an array of numbers, got {shown(value)}") from None
    if last is not None and (array.ndim == 0 or array.shape[-1] != last):
        raise InputError(
            f"{name} must have {last} values along the last dimension, got shape {array.shape}"
        )
    return array


def broadcast(
    scalars: dict[str, ArrayLike], *vectors: Floats
) -> tuple[tuple[int, ...], list[Floats]]:
    """Broadcast leading dimensions; scalars are flattened to (n,), vectors to (n, k)."""
    arrays = [to_array(name, value) for name, value in scalars.items()]
    try:
        shape = np.broadcast_shapes(*(a.shape for a in arrays), *(v.shape[:-1] for v in vectors))
    except ValueError:
        shapes = [str(a.shape) for a in arrays] + [str(v.shape) for v in vectors]
        raise InputError(f"shapes do not broadcast together: {', '.join(shapes)}") from None
    flat: list[Floats] = [np.broadcast_to(a, shape).reshape(-1) for a in arrays]
    count = math.prod(shape)
    flat += [np.broadcast_to(v, (*shape, v.shape[-1])).reshape(count, v.shape[-1]) for v in vectors]
    return shape, flat


def check_option(name: str, value: object, options: Sequence[object]) -> None:
    """Refuse a value that is not one of `options`."""
    if value not in options:
        names = ", ".join(repr(o) for o in options)
        raise InputError(f"{name} must be one of {names}, got {shown(value)}")
