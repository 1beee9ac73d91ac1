"""Polynomial curvature of a robot: fitted to its shape, or predicted from its loads.

`fit_curvature` gives the polynomials whose disks are nearest to given ones: the least error of
this family of shapes. `curvature_from_loads` predicts them from tensions, weight and tip force, as
the linear law predicts arcs from tensions; it ignores straight spans, clamped lengths, shear,
extension and torsion.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Floats
from bowstring.constant_curvature.arc import to_array
from bowstring.constant_curvature.variable_curvature import MAX_DEGREE, VariableCurvature, legendre
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.arrays import principal_bending
from bowstring.validation import whole

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_UNKNOWNS: Final = 60  # unknowns of the shapes that are fitted at once
_EVALUATIONS: Final = 500
_TOLERANCE: Final = 1e-12  # relative tolerance of cost, step and gradient
_LOADS: Final = 32  # loads that are solved at once
_ITERATIONS: Final = 30
_CONVERGED: Final = 1e-10  # rad
_STEP: Final = 1e-6  # step of finite differences, rad
_LARGEST: Final = 0.5  # step of the Newton iteration, rad
_SHARES: Final = (0.3, 0.65, 1.0)  # shares of weight and tip force that are applied in turn


# -- fit -------------------------------------------------------------------------------------------


def fit_curvature(robot: Robot, disks: ArrayLike, degree: int) -> VariableCurvature:
    """Fit polynomial curvatures to the disk centres of many shapes.

    Base pose and segment lengths are those of the robot; the sum of squared distances of the disks
    is least.

    Parameters
    ----------
    robot : Robot
        The robot.
    disks : array_like (..., N, 3)
        Disk centres from base to tip, base excluded, m, base frame.
    degree : int
        Degree of the polynomials: 0 for the best arcs.

    Returns
    -------
    VariableCurvature
        Of the shape of `disks` without its last two axes.

    Raises
    ------
    InputError
        If a value is not finite, or a segment has fewer disks than degree + 2, so that the disks
        say nothing of the shape between them.
    NoSolutionError
        If the fit did not converge.
    """
    order = whole("degree", degree, 0, MAX_DEGREE)
    count = len(robot.disks.station_m)
    rows = np.asarray(disks, dtype=float)
    if rows.ndim < 2 or rows.shape[-2:] != (count, 3):
        raise InputError(f"disks has shape {rows.shape}, it must be (..., {count}, 3)")
    if not np.isfinite(rows).all():
        raise InputError("disks has a position that is not finite")
    fewest = int(np.bincount(robot.disks.segment).min())
    if fewest < order + 2:
        raise InputError(
            f"a segment of {robot.name} has {fewest} disks; a curvature of degree {order} needs "
            f"{order + 2} or more to be fitted"
        )
    lead, rows = rows.shape[:-2], rows.reshape(-1, count, 3)
    unknowns = len(robot.segments) * 2 * (order + 1)
    many = max(1, _UNKNOWNS // unknowns)
    found = [
        _fitted(robot, rows[first : first + many], order) for first in range(0, len(rows), many)
    ]
    bend = np.concatenate(found) if found else np.zeros((0, len(robot.segments), order + 1, 2))
    return VariableCurvature(robot, bend.reshape(*lead, *bend.shape[1:]))


def _fitted(robot: Robot, disks: Floats, degree: int) -> Floats:
    """Coefficients (K, S, degree + 1, 2) of some shapes, by Levenberg-Marquardt (MINPACK)."""
    from scipy.optimize import least_squares  # takes 0.2 s, and only fits need it

    start = _start(robot, disks, degree)
    count, size = len(start), start[0].size
    blocks = np.arange(count)

    def residual(x: Floats) -> Floats:
        shape = VariableCurvature(robot, x.reshape(start.shape))
        return np.asarray((shape.disk_positions - disks).ravel() / robot.length)

    def jacobian(x: Floats) -> Floats:
        by = VariableCurvature(robot, x.reshape(start.shape)).disk_jacobian() / robot.length
        whole = np.zeros((count, disks[0].size, count, size))
        whole[blocks, :, blocks] = by.reshape(count, -1, size)
        return whole.reshape(disks.size, start.size)

    found = least_squares(
        residual,
        start.ravel(),
        jac=jacobian,
        method="lm",
        ftol=_TOLERANCE,
        xtol=_TOLERANCE,
        gtol=_TOLERANCE,
        max_nfev=_EVALUATIONS,
    )
    if not found.success:
        raise NoSolutionError(
            f"the curvature of degree {degree} was not found in {_EVALUATIONS} evaluations; the "
            "shape may be none of a backbone"
        )
    return np.asarray(found.x.reshape(start.shape))


def polyline_curvature(robot: Robot, disks: Floats) -> tuple[Floats, Floats]:
    """Curvature vector of the polyline through base and disks, in a frame without torsion.

    It is the angle between two neighbouring sides over the distance of their middles; the first
    side is compared with the direction of the base.

    Parameters
    ----------
    robot : Robot
        The robot.
    disks : ndarray (K, N, 3)
        Disk centres, m.

    Returns
    -------
    edges : ndarray (N + 1,)
        Arc lengths between which the curvatures are means, m: the base, and the middles of the
        sides.
    curvature : ndarray (K, N, 2)
        Towards x and y, 1/m.
    """
    from scipy.spatial.transform import Rotation

    count = len(disks)
    stations = np.concatenate([[0.0], robot.disks.station_m])
    edges = np.concatenate([[0.0], 0.5 * (stations[1:] + stations[:-1])])
    sides = np.diff(np.concatenate([np.zeros((count, 1, 3)), disks], axis=1), axis=1)
    frame = np.broadcast_to(np.eye(3), (count, 3, 3))
    turned = np.zeros((count, sides.shape[1], 2))
    for i in range(sides.shape[1]):
        axis = np.cross(frame[:, :, 2], sides[:, i])
        size = np.linalg.norm(axis, axis=-1, keepdims=True)
        angle = np.arctan2(size, np.sum(frame[:, :, 2] * sides[:, i], axis=-1, keepdims=True))
        turn = angle * axis / np.where(size > 0.0, size, 1.0)
        body = np.einsum("kji,kj->ki", frame, turn)
        turned[:, i] = np.stack([body[:, 1], -body[:, 0]], axis=-1)
        frame = Rotation.from_rotvec(turn).as_matrix() @ frame
    return edges, turned / np.diff(edges)[:, None]


def _start(robot: Robot, disks: Floats, degree: int) -> Floats:
    """Initial coefficients: nearest to the curvature of the polyline through the disks."""
    edges, curvature = polyline_curvature(robot, disks)
    out = np.zeros((len(disks), len(robot.segments), degree + 1, 2))
    start = 0.0
    for k, segment in enumerate(robot.segments):
        low, high = (np.clip((e - start) / segment.length, 0, 1) for e in (edges[:-1], edges[1:]))
        inside = high > low
        basis = legendre(0.5 * (low + high)[inside], degree)
        known = curvature[:, inside] * segment.length
        out[:, k] = np.einsum("jn,knq->kjq", np.linalg.pinv(basis), known)
        start += segment.length
    return out


# -- prediction ------------------------------------------------------------------------------------


class _Loads(NamedTuple):
    """Tensions and dead forces on the backbones for K loads."""

    free: Floats
    """Coefficients (K, S, degree + 1, 2) by rest curvature and tensions alone."""
    stiffness: Floats
    """Stiffness of each segment (S, n, n) against its n coefficients, N m."""
    force: Floats
    """Dead forces on the disks (N, 3), N."""

    def part(self, rows: NDArray[np.intp], share: float = 1.0) -> _Loads:
        """Loads of some rows, with a share of the dead forces."""
        return _Loads(self.free[rows], self.stiffness, share * self.force)


def curvature_from_loads(
    robot: Robot,
    tensions: ArrayLike,
    degree: int,
    *,
    gravity: ArrayLike | None = None,
    tip_force: ArrayLike = (0.0, 0.0, 0.0),
    start: VariableCurvature | None = None,
) -> VariableCurvature:
    """Predict polynomial curvatures from tensions, weight and tip force.

    The coefficients make the potential energy stationary, and a minimum: bending, tendons at the
    distance of their holes from the backbone, dead loads (Ritz method, theory Eq. 1.13). Without
    dead loads, and with parallel tendons on a uniform backbone without rest twist, the result is
    the arc of the linear law.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : array_like (..., T)
        Tensions, N, not negative.
    degree : int
        Degree of the polynomials: 0 for arcs.
    gravity : array_like (3,), optional
        Gravity, base axes, m/s^2; that of the robot if left out. Half of the weight of a module
        acts on each of its ends.
    tip_force : array_like (3,)
        Dead force at the tip, base axes, N.
    start : VariableCurvature, optional
        Result of a lower degree for the same loads, to start from. Without it, and where it is NaN,
        dead loads are applied in parts.

    Returns
    -------
    VariableCurvature
        NaN where no stable equilibrium of this family was found.

    Raises
    ------
    InputError
        For tensions that are negative or not finite.
    """
    order = whole("degree", degree, 0, MAX_DEGREE)
    given = to_array("tensions", tensions, len(robot.tendons.segment))
    bad = ~((given >= robot.tendons.least_tension_N) & np.isfinite(given))
    if bad.any():
        at = tuple(np.argwhere(bad)[0])
        raise InputError(f"tension {at[-1] + 1} is {given[at]:g} N; tensions must be >= 0 N")
    lead, rows = given.shape[:-1], given.reshape(-1, given.shape[-1])
    pull = np.asarray(robot.gravity if gravity is None else gravity, dtype=float)
    force = np.outer(_masses(robot), pull)
    force[-1] += np.asarray(tip_force, dtype=float)
    stiffness = _stiffness(robot, order)
    loads = _Loads(_by_tendons(robot, rows, stiffness), stiffness, force)
    if start is not None and (start.bend.shape[:-3] != lead or start.degree > order):
        raise InputError("start is of other loads, or of a higher degree")
    bend = loads.free
    if force.any():
        below = None if start is None else start.bend.reshape(-1, *start.bend.shape[-3:])
        bend = _equilibria(robot, loads, below)
    return VariableCurvature(robot, bend.reshape(*lead, *bend.shape[1:]))


def _stiffness(robot: Robot, degree: int) -> Floats:
    """Stiffness (S, n, n) of each segment against its n coefficients, N m.

    Theory Eq. 1.13: the integral of E I times two polynomials, over the length; E I (2, 2) is that
    against a bend towards x and y.
    """
    nodes, weights = np.polynomial.legendre.leggauss(degree + 4)
    at = 0.5 + 0.5 * nodes
    part = legendre(at, degree)
    out = []
    for segment in robot.segments:
        backbone = segment.backbone.at(at)
        *both, angle = principal_bending(backbone)
        first, second = (np.broadcast_to(stiffness, at.shape) for stiffness in both)
        sin, cos = np.sin(angle), np.cos(angle)
        between = (second - first) * sin * cos
        bending = np.array(
            [
                [first * sin**2 + second * cos**2, between],
                [between, first * cos**2 + second * sin**2],
            ]
        )
        each = np.einsum("n,ni,nj,pqn->ipjq", 0.5 * weights, part, part, bending)
        out.append(each.reshape(2 * degree + 2, -1) / segment.length)
    return np.array(out)


def _masses(robot: Robot) -> Floats:
    """Mass at each disk (N,): its own, payloads, and half of the modules beside it, kg."""
    stations = np.concatenate([[0.0], robot.disks.station_m])
    per_length = np.asarray(robot.mass_per_length)[robot.disks.segment]
    module = per_length * np.diff(stations)
    carried = robot.disks.mass_kg + robot.carried_kg
    return np.asarray(carried + 0.5 * (module + np.append(module[1:], 0.0)))


def _by_tendons(robot: Robot, tensions: Floats, stiffness: Floats) -> Floats:
    """Coefficients (K, S, degree + 1, 2) by rest curvature and tensions.

    The moment of a tendon is its tension times the place of its hole from the tension centre of the
    section, which varies evenly between two disks; it is projected on the polynomials. A backbone
    that is twisted without load turns holes and rest curvature against the frame without torsion.
    """
    degree = stiffness.shape[-1] // 2 - 1
    tendons, rest = robot.tendons, robot.rest_curvature
    stations = np.concatenate([[0.0], robot.disks.station_m])
    nodes, weights = np.polynomial.legendre.leggauss(degree + 3)
    out = np.zeros((len(tensions), len(robot.segments), degree + 1, 2))
    start = angle = 0.0
    for k, segment in enumerate(robot.segments):
        end = start + segment.length
        passing = np.flatnonzero(tendons.segment >= k)
        moment = np.zeros((degree + 1, len(passing), 2))
        free = np.zeros((degree + 1, 2))
        own = np.array([rest[k, 1], -rest[k, 0]]) * segment.length
        for i in np.flatnonzero(robot.disks.segment == k):
            low, high = stations[i], min(stations[i + 1], end)
            at = 0.5 * (low + high) + 0.5 * (high - low) * nodes
            part = legendre((at - start) / segment.length, degree)
            part = part * (0.5 * (high - low) / segment.length * weights)[:, None]
            holes = tendons.holes_m[passing]
            ends = holes[:, [0, 0]] if holes.shape[1] == 1 else holes[:, i : i + 2]
            share = ((at - low) / (high - low))[:, None, None]
            place = (1.0 - share) * ends[:, 0] + share * ends[:, 1] - robot.tension_centre_m[k]
            twist = angle + rest[k, 2] * (at - start)
            turn = np.moveaxis(
                np.array([[np.cos(twist), -np.sin(twist)], [np.sin(twist), np.cos(twist)]]), -1, 0
            )
            moment += np.einsum("nj,npq,ntq->jtp", part, turn, place)
            free += np.einsum("nj,npq,q->jp", part, turn, own)
        total = np.einsum("kt,jtq->kjq", tensions[:, passing], moment)
        by_tension = np.linalg.solve(stiffness[k], total.reshape(len(total), -1, 1))
        out[:, k] = by_tension.reshape(total.shape)
        out[:, k] += (2.0 * np.arange(degree + 1) + 1.0)[:, None] * free
        start, angle = end, angle + rest[k, 2] * segment.length
    return out


def _equilibria(robot: Robot, loads: _Loads, below: Floats | None) -> Floats:
    """Newton iteration for some loads at once, from a result of lower degree or in parts."""
    out = np.full_like(loads.free, np.nan)
    if below is not None:
        rows = np.flatnonzero(np.isfinite(below).all(axis=(1, 2, 3)))
        bend = np.zeros((len(rows), *out.shape[1:]))
        bend[:, :, : below.shape[2]] = below[rows]
        for some in _groups(np.arange(len(rows))):
            out[rows[some]] = _newton(robot, loads.part(rows[some]), bend[some])
    for some in _groups(np.flatnonzero(np.isnan(out).any(axis=(1, 2, 3)))):
        bend = loads.free[some]
        for share in _SHARES:
            bend = _newton(robot, loads.part(some, share), bend)
        out[some] = bend
    return out


def _groups(rows: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    return [rows[first : first + _LOADS] for first in range(0, len(rows), _LOADS)]


def _newton(robot: Robot, loads: _Loads, start: Floats) -> Floats:
    """Solve for one part of the dead loads; NaN where no stable equilibrium is found."""
    count, size = len(start), start[0].size
    from scipy.linalg import block_diag  # only predictions need it

    stiffness = block_diag(*loads.stiffness)
    ways = _STEP * np.concatenate([np.zeros((1, size)), np.eye(size)])

    def derivatives(bend: Floats) -> tuple[Floats, Floats]:
        """First (K, n) and second (K, n, n) derivative of the potential energy, N m."""
        moved = bend.reshape(1, count, size) + ways[:, None]
        shapes = VariableCurvature(robot, moved.reshape(-1, *bend.shape[1:]))
        by = shapes.disk_jacobian().reshape(size + 1, count, -1, 3, size)
        work = np.einsum("mkdcn,dc->mkn", by, loads.force)
        rest = loads.free.reshape(count, size)
        all_of = (moved - rest) @ stiffness - work
        return all_of[0], np.moveaxis(all_of[1:] - all_of[0], 0, -1) / _STEP

    known = np.asarray(np.isfinite(start).all(axis=(1, 2, 3)))
    bend = np.where(known[:, None, None, None], start, loads.free)  # all rows have numbers
    change, hessian = np.full(count, np.inf), np.zeros((count, size, size))
    for _ in range(_ITERATIONS):
        gradient, hessian = derivatives(bend)
        step = np.linalg.solve(hessian, -gradient[..., None])[..., 0]
        largest = np.abs(step).max(axis=1, keepdims=True)
        step *= np.minimum(1.0, _LARGEST / np.maximum(largest, 1e-300))
        bend, change = bend + step.reshape(bend.shape), np.abs(step).max(axis=1)
        if (change < _CONVERGED).all():
            break
    # congruent to the Hessian, with one unit for all entries
    units = np.diag(stiffness)
    scaled = 0.5 * (hessian + np.swapaxes(hessian, 1, 2)) / np.sqrt(np.outer(units, units))
    scaled[~np.isfinite(scaled).all(axis=(1, 2))] = -np.eye(size)
    stable = known & (change < _CONVERGED) & (np.linalg.eigvalsh(scaled)[:, 0] > 0.0)
    return np.asarray(np.where(stable[:, None, None, None], bend, np.nan))
