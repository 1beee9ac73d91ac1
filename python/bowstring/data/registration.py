"""Rigid registration of the frame of a measuring device to the robot's base frame.

A rigid motion maps measured points to the base frame::

    base = rotation @ measured + translation

It is known, fitted to fiducials (points known in both frames), or fitted to the tips that a model
predicts, on request with the offset of the tool or marker from the tip. A fit has a covariance. Its
errors are a small rotation about a *pivot*, the centroid of the fitted points, a shift of that
point, both in base axes, and the error of the offset in the axes of the tip::

    true point = pivot + exp(rotation error) (registered point - pivot) + shift

At the pivot of a fit to fiducials of equal noise, rotation and shift are uncorrelated. All values
are in SI and radians. Noise is isotropic; RMS is over points, not over coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import linalg, optimize, special
from scipy.spatial.transform import Rotation

from bowstring.aliases import Floats
from bowstring.data.rigid import SKEW, Rigid, align
from bowstring.data.tip_errors import Comparison
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import plain
from bowstring.significance import MIRROR, chi_square_p, variance_ratio_limit
from bowstring.validation import floats, instance, number, numbers, read, shown, truth, vectors

__all__ = [
    "Registration",
    "fit_fiducials",
    "fit_model",
    "known",
    "with_and_without",
]

Kind = Literal["known", "fiducials", "model"]

PARAMETERS: Final = tuple(
    f"{name}_{axis}_{unit}"
    for name, unit in (("rotation", "rad"), ("shift", "m"), ("offset", "m"))
    for axis in "xyz"
)
"""Parameters of a fit in the order of its covariance; the first six without an offset."""

_OTHER_UNIT: Final = 5.0  # ratio of spans that means another unit; rotations change them by sqrt(3)
_FLAT: Final = 1e-4  # width over size of fiducials that counts as a line
_LOST: Final = 1e-7  # singular value over the largest that counts as zero
_WEAK: Final = 0.02  # singular value over the largest that counts as weak
_HUBER: Final = 2.5  # standard deviations; 90 % of distances in space are smaller
_FEW: Final = 10  # points below which fits with an offset have many minima
_MEDIAN: Final = 1.5382  # median distance in space over standard deviation along an axis
_AXES: Final = ((0, "x"), (1, "y"), (2, "z"))
_CLEARLY: Final = 3.0  # ratio of sums of squares above which model errors do not explain it


# -- a registration ----------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True, eq=False)
class Registration:
    """Rigid motion from measuring frame to base frame, with its uncertainty.

    Made by `known`, `fit_fiducials` or `fit_model`.
    """

    kind: Kind
    """"known", "fiducials" or "model": made by `known`, `fit_fiducials` or `fit_model`."""
    frame: Rigid
    """Motion from measuring frame to base frame."""
    pivot: Floats
    """Point (3,) to which rotation and shift refer, m, base frame."""
    covariance: Floats
    """Covariance of `parameters` (p, p), rad and m. Where a parameter is not identifiable, the
    diagonal is infinite and the rest NaN. Zero if the frame is known."""
    residual: Floats
    """Registered minus given points (n, 3), m, base axes, with the offset."""
    weight: Floats
    """Final weights (n,) of a robust fit, from 0 to 1; 1 in other fits."""
    sigma: Floats
    """Standard deviation of a measured coordinate (n,), m: given, or from the residuals."""
    sigma_given: bool
    """Whether standard deviations were given, not estimated from the residuals; True if the frame
    is known."""
    robust: bool = False
    """Whether it is a robust fit with Huber's loss."""
    offset: Floats | None = None
    """Offset of the measured point from the tip (3,), m, in the tip's axes; None if not fitted."""
    undetermined: tuple[str, ...] = ()
    """Directions that are not identifiable, in words; their values stay closest to the start of
    the fit."""
    weak: tuple[str, ...] = ()
    """Weakly identifiable directions, in words, with their standard deviations."""

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the rows of `covariance`."""
        return PARAMETERS[: len(self.covariance)]

    @property
    def dof(self) -> int:
        """Degrees of freedom: number of coordinates minus parameters."""
        return self.residual.size - len(self.covariance) if self.kind != "known" else 0

    @property
    def rms(self) -> float:
        """Registration error of the fitted points: RMS of their residuals over points, m."""
        if not len(self.residual):
            return math.nan
        return float(np.sqrt(np.mean(np.sum(self.residual**2, axis=1))))

    @property
    def misfit(self) -> float:
        """Weighted sum of squares over degrees of freedom.

        About 1 if the residuals are noise of the given sigma; NaN if none was given.
        """
        if not self.sigma_given or self.dof <= 0:
            return math.nan
        square = np.sum(self.residual**2, axis=1) / self.sigma**2
        return float(np.sum(self.weight * square) / self.dof)

    @property
    def variance_p(self) -> float:
        """P-value of `misfit` under noise alone; NaN if no sigma was given."""
        return chi_square_p(self.misfit * self.dof, self.dof)

    @property
    def standard_error(self) -> Floats:
        """Standard errors of `parameters` (p,), rad and m; infinite if not identifiable."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    def interval(self, level: float = 0.95) -> Floats:
        """Half widths (p,) of the confidence intervals of `parameters`, rad and m.

        From the normal distribution if sigma was given, from Student's t if it is estimated from
        the residuals, as always in a robust fit.
        """
        if not 0.0 < number("level", level) < 1.0:
            raise InputError(f"level is {level:g}, it must lie between 0 and 1")
        tail = 0.5 + 0.5 * level
        normal = self.sigma_given and not self.robust
        width = special.ndtri(tail) if normal else special.stdtrit(max(self.dof, 1), tail)
        return np.asarray(width * self.standard_error)

    def point_covariance(self, point: ArrayLike) -> Floats:
        """Covariance (3, 3) of the registered position of a point (3,) of the base frame, m^2.

        It has the error of the frame only, without the noise of measuring that point.
        """
        if any(not math.isfinite(x) for x in self.covariance.ravel()):
            return np.full((3, 3), math.inf)
        return self.covariance_about(point)[3:, 3:]

    def target_error(self, point: ArrayLike) -> float:
        """RMS error of the registered position of a point (3,) of the base frame, m."""
        return float(np.sqrt(np.trace(self.point_covariance(point))))

    def covariance_about(self, point: ArrayLike) -> Floats:
        """Covariance (6, 6) of the rotation and the shift of another point (3,), m."""
        arm = numbers("point", point, (3,), "m") - self.pivot
        by = np.eye(6)
        by[3:, :3] = -_cross(arm)
        return np.asarray(by @ self.covariance[:6, :6] @ by.T)

    def apply(self, points: ArrayLike) -> Floats:
        """Map measured points (..., 3) to the base frame, m."""
        return self.frame.apply(points)

    def tips(self, points: ArrayLike, rotations: ArrayLike | None) -> Floats:
        """Map measured points to tips (..., 3), m, base frame, by subtracting the offset.

        Parameters
        ----------
        points : array_like (..., 3)
            Measured points, m.
        rotations : array_like (..., 3, 3)
            Rotations of the tip by the model, body to base; unused without an offset.
        """
        if self.offset is None:
            return self.apply(points)
        moved, turns = self.apply(points), vectors("rotations", rotations)
        if turns.shape != (*moved.shape, 3):
            raise InputError(f"rotations has shape {turns.shape}, it must be {(*moved.shape, 3)}")
        return np.asarray(moved - turns @ self.offset)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; None where not identifiable or not known."""
        errors, width = self.standard_error, self.interval()
        return {
            "kind": self.kind,
            **self.frame.to_dict(),
            "offset_m": None if self.offset is None else self.offset.tolist(),
            "pivot_m": self.pivot.tolist(),
            "standard_error": {n: plain(e) for n, e in zip(self.parameters, errors, strict=True)},
            "half_width_95": {n: plain(w) for n, w in zip(self.parameters, width, strict=True)},
            "points": len(self.residual),
            "rms_mm": plain(self.rms * 1e3),
            "sigma_given": self.sigma_given,
            "misfit": plain(self.misfit),
            "undetermined": list(self.undetermined),
            "weak": list(self.weak),
        }


def known(frame: Rigid, covariance: ArrayLike | None = None) -> Registration:
    """Make a known registration.

    Parameters
    ----------
    frame : Rigid
        Measuring frame to base frame.
    covariance : array_like (6, 6), optional
        Covariance of rotation (rad) and shift (m) about the base's origin; zero by default.
    """
    if not isinstance(frame, Rigid):
        raise InputError(f"frame is {shown(frame)}, it must be a Rigid")
    matrix = np.zeros((6, 6))
    if covariance is not None:
        matrix = numbers("covariance", covariance, (6, 6))
        values = np.linalg.eigvalsh(0.5 * (matrix + matrix.T))
        if not np.allclose(matrix, matrix.T) or values[0] < -1e-9 * abs(values[-1]):
            raise InputError("covariance must be symmetric and have no negative eigenvalue")
    none = np.zeros(0)
    return Registration("known", frame, np.zeros(3), matrix, np.zeros((0, 3)), none, none, True)


# -- fiducials ---------------------------------------------------------------------------------


def fit_fiducials(
    measured: ArrayLike, base: ArrayLike, sigma: ArrayLike | None = None
) -> Registration:
    """Register by points that are known in both frames.

    Parameters
    ----------
    measured : array_like (n, 3)
        Fiducials in the measuring frame, m.
    base : array_like (n, 3)
        The same fiducials in the base frame, m, assumed exact.
    sigma : float or array_like (n,), optional
        Standard deviation of each measured coordinate, m; weights are its inverse squares. By
        default all are equal and estimated from the residuals.

    Returns
    -------
    Registration
        The rigid motion with its covariance and residuals.

    Raises
    ------
    InputError
        For fewer than three fiducials, for collinear or coincident ones, for two lists in different
        units, and for a left-handed measuring frame.

    Notes
    -----
    Least-squares rotation in closed form (Kabsch 1976, Umeyama 1991), without scale. Three
    fiducials, or any in one plane, fit a left-handed frame as well as a right-handed one, so a
    left-handed frame is then not detected.
    """
    ours, theirs = _finite_points("measured", measured), _finite_points("base", base)
    if len(ours) != len(theirs):
        raise InputError(
            f"{len(ours)} fiducials are measured and {len(theirs)} given in the base frame: both "
            "lists must have the same points in the same order"
        )
    if len(ours) < 3:
        raise InputError(f"{len(ours)} fiducials do not fix a frame: give three or more")
    spread, weight = _sigma(sigma, len(ours))
    for name, points in (("measured", ours), ("base", theirs)):
        _check_fiducials(name, points)
    sizes = [float(np.linalg.norm(np.ptp(points, axis=0))) for points in (ours, theirs)]
    if max(sizes) > _OTHER_UNIT * min(sizes):
        raise InputError(
            f"the measured fiducials span {sizes[0]:.4g} m and those of the base {sizes[1]:.4g} m: "
            "give both in m, and in the same order"
        )
    pairs = _Pairs(ours, theirs, weight)
    best = _search(pairs)
    _check_handed(pairs, best.left, _search(pairs.mirrored).left)
    return _registration("fiducials", pairs, best, spread)


def _check_fiducials(name: str, points: Floats) -> None:
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for i, j in combinations(range(len(points)), 2):
        if np.linalg.norm(points[i] - points[j]) <= 1e-9 * size:
            raise InputError(
                f"fiducials {i + 1} and {j + 1} are in one place in the {name} points: leave out "
                "one of them, or average repeats"
            )
    values = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if values[1] < _FLAT * values[0]:
        raise InputError(
            f"the {name} fiducials lie on one line, about which the frame may turn freely: add one "
            "beside it"
        )


def _check_handed(pairs: _Pairs, left: float, mirror_left: float) -> None:
    """Refuse a frame whose mirror image fits significantly better."""
    if pairs.dof <= 0 or left <= _doubtful(pairs.dof) * mirror_left:
        return
    weight, base = pairs.weight, pairs.base
    size = float(weight @ np.sum((base - base.mean(axis=0)) ** 2, axis=1))
    if left <= 1e-20 * size:
        return  # both are exact: flat fiducials
    total = weight.sum()
    raise InputError(
        f"the measuring frame is left-handed: its mirror image fits with "
        f"{1e3 * math.sqrt(mirror_left / total):.3g} mm RMS, the frame itself with "
        f"{1e3 * math.sqrt(left / total):.3g} mm; {_handed_cause(pairs)}"
    )


def _doubtful(dof: int) -> float:
    """Ratio of sums of squares up to which a mirror image is not significantly better."""
    return max(_CLEARLY, variance_ratio_limit(MIRROR, dof, dof))


def _handed_cause(pairs: _Pairs) -> str:
    """Correction in words: the change after which the frames differ by the smallest rotation."""
    same = np.eye(3)
    changes = {f"change the sign of its {a}": same - 2.0 * np.diag(same[i]) for i, a in _AXES}
    for (i, a), (j, b) in combinations(_AXES, 2):
        changes[f"swap its {a} and {b}"] = swap = np.eye(3)
        swap[[i, j]] = swap[[j, i]]
    turns = {}
    for words, change in changes.items():
        frame = align(pairs.measured @ change.T, pairs.base, pairs.weight)
        turns[words] = float(np.linalg.norm(frame.rotation_vector))
    best = min(turns, key=lambda words: turns[words])
    if turns[best] < math.radians(20.0):
        return f"{best} (the frames then differ by {math.degrees(turns[best]):.2g} deg)"
    return "change the sign of one of its axes or swap two, or check the order of the points"


# -- with the model ----------------------------------------------------------------------------


def fit_model(
    measured: ArrayLike,
    predicted: ArrayLike,
    rotations: ArrayLike | None = None,
    *,
    sigma: ArrayLike | None = None,
    robust: bool = False,
    start: Rigid | None = None,
) -> Registration:
    """Register by the tips that a model predicts.

    The fit also removes model errors that look like a rigid motion, so that a comparison after it
    favours the model. Always show it beside the comparison without registration.

    Parameters
    ----------
    measured : array_like (K, 3)
        Measured points, m, in the measuring frame.
    predicted : array_like (K, 3)
        Tips predicted by the model, m, base frame.
    rotations : array_like (K, 3, 3), optional
        Rotations of the tips, body to base. If given, the offset of the measured point from the
        tip, in the tip's axes, is fitted too.
    sigma : float or array_like (K,), optional
        Standard deviation of each measured coordinate, m. By default all are equal and estimated
        from the residuals.
    robust : bool
        Whether to use Huber's loss of the distance of each point, quadratic up to 2.5 standard
        deviations.
    start : Rigid, optional
        Initial motion, which is kept in directions that are not identifiable; by default the best
        motion without an offset.

    Returns
    -------
    Registration
        The rigid motion with its covariance and residuals.

    Raises
    ------
    InputError
        For too few points, and for a left-handed measuring frame.
    NoSolutionError
        If the fit does not converge.

    Notes
    -----
    Trust-region least squares (SciPy) with exact derivatives; with Huber's loss iteratively
    reweighted until weights and scale converge. Covariances assume normal noise; those of a robust
    fit are Huber's asymptotic ones. Identifiability follows from the singular values of the
    Jacobian, with rotations scaled by the RMS distance of the points from their centroid.
    """
    ours, theirs = _finite_points("measured", measured), _finite_points("predicted", predicted)
    if len(ours) != len(theirs):
        raise InputError(
            f"{len(ours)} points are measured and {len(theirs)} predicted: give one prediction for "
            "each point"
        )
    turns = None if rotations is None else _rotations(rotations, len(ours))
    spread, weight = _sigma(sigma, len(ours))
    truth("robust", robust)
    if start is not None:
        instance("start", start, Rigid)
    pairs = _Pairs(ours, theirs, weight, turns)
    if pairs.dof <= 0:
        what = "a base frame" if turns is None else "a base frame and an offset"
        raise InputError(
            f"{len(ours)} points have {ours.size} coordinates, too few for the {pairs.unknowns} "
            f"unknowns of {what} and their errors: give {pairs.unknowns // 3 + 1} or more"
        )
    if float(np.ptp(theirs, axis=0).max()) == 0.0 or float(np.ptp(ours, axis=0).max()) == 0.0:
        raise InputError("all points are in one place: only a robot that moves registers itself")

    best = _search(pairs, start)
    mirror_left = best.left
    if turns is None or best.left > _doubtful(pairs.dof) * best.bound:
        mirror_left = _search(pairs.mirrored).left
    _check_handed(pairs, best.left, mirror_left)
    down = scale = None
    if robust:
        best, down, scale = _reweighted(pairs, spread, best)
    return _registration("model", pairs, best, spread, down, scale)


@dataclass(frozen=True)
class _Pairs:
    """Measured points (n, 3), their counterparts in the base frame, and weights (n,).

    With `turns` (n, 3, 3), the rotations of the tips, the points in the base frame are the tips,
    and the offset of the measured points from them is unknown too.
    """

    measured: Floats
    base: Floats
    weight: Floats
    turns: Floats | None = None

    @property
    def unknowns(self) -> int:
        return 6 if self.turns is None else 9

    @property
    def dof(self) -> int:
        return self.base.size - self.unknowns

    @property
    def mirrored(self) -> _Pairs:
        return replace(self, measured=-self.measured)

    @cached_property
    def middle(self) -> Floats:
        """Weighted centroid (3,) of the measured points."""
        return np.asarray(self.weight @ self.measured / self.weight.sum())

    @property
    def size(self) -> float:
        """RMS distance of the measured points from their centroid, m."""
        square = np.sum((self.measured - self.middle) ** 2, axis=1)
        return math.sqrt(float(self.weight @ square / self.weight.sum()))

    @property
    def linear(self) -> Floats:
        """Derivative (n, 3, 3 or 6) of the residuals by shift and offset."""
        shift = np.broadcast_to(np.eye(3), (len(self.base), 3, 3))
        return shift if self.turns is None else np.concatenate([shift, -self.turns], axis=2)

    def arms(self, frame: Rigid) -> Floats:
        """Vectors from the centroid to the points (n, 3), in base axes."""
        return np.asarray((self.measured - self.middle) @ frame.rotation.T)

    def residual(self, frame: Rigid, offset: Floats) -> Floats:
        """Registered minus given points (n, 3), m."""
        found = frame.apply(self.measured) - self.base
        return found if self.turns is None else np.asarray(found - self.turns @ offset)


class _Best(NamedTuple):
    frame: Rigid
    offset: Floats
    left: float
    """Weighted sum of squares."""
    bound: float = 0.0
    """Lower bound for any frame, left-handed or not: that of the best affine map."""


def _search(pairs: _Pairs, start: Rigid | None = None) -> _Best:
    """Best frame and offset for given weights."""
    if start is not None:
        return _refined(pairs, start)
    base, weight = pairs.base, pairs.weight
    start = align(pairs.measured, base, weight)
    values = np.linalg.svd(base - base.mean(axis=0), compute_uv=False)
    if values[1] <= _LOST * values[0]:  # collinear: the rotation about the line is not identifiable
        return _refined(pairs, Rigid(np.eye(3), weight @ base / weight.sum() - pairs.middle))
    if pairs.turns is None:
        none = np.zeros(3)
        return _Best(start, none, float(weight @ np.sum(pairs.residual(start, none) ** 2, axis=1)))
    starts, bound = _starts(pairs, start)
    best = _refined(pairs, starts[0])
    few = base.size - 15  # degrees of freedom of the affine map
    limit = 0.0
    if few > 0:
        limit = variance_ratio_limit(MIRROR, few + 6, few) * (few + 6) / few
    for way in starts[1:]:
        if best.left <= limit * bound:  # within noise of the lower bound
            break
        best = min(best, _refined(pairs, way), key=lambda end: end.left)
    return best._replace(bound=bound)


def _refined(pairs: _Pairs, start: Rigid) -> _Best:
    """Least squares from an initial frame; rotations are scaled to m by the size of the points."""
    root = np.sqrt(pairs.weight)[:, None]
    arms, size, fixed = pairs.arms(start), pairs.size, pairs.linear

    def residual(x: Floats) -> Floats:
        turned = Rotation.from_rotvec(x[:3] / size).apply(arms)
        return np.ravel(root * (turned + fixed @ x[3:] - pairs.base))

    def jacobian(x: Floats) -> Floats:
        turned = Rotation.from_rotvec(x[:3] / size).apply(arms)
        spin = -_cross(turned) @ _left_jacobian(x[:3] / size) / size
        rows = np.concatenate([spin, fixed], axis=2) * root[..., None]
        return np.reshape(rows, (-1, rows.shape[-1]))

    x = np.zeros(3 + fixed.shape[2])
    x[3:6] = start.apply(pairs.middle)
    # shift and offset follow from the rotation by linear least squares of minimum norm
    x[3:] += np.linalg.lstsq(jacobian(x)[:, 3:], -residual(x), rcond=_LOST)[0]
    full = False
    for _ in range(3):  # no step along directions that are not identifiable
        values, directions = _directions(jacobian(x))
        ways = directions[values > _LOST * values[0]]
        full = len(ways) == len(x)
        x, left = _least_squares(residual, jacobian, x, ways)
        if full:
            break
    turn = Rotation.from_rotvec(x[:3] / size).as_matrix() @ start.rotation
    return _Best(Rigid(turn, x[3:6] - turn @ pairs.middle), x[6:], left)


def _least_squares(
    residual: Callable[[Floats], Floats],
    jacobian: Callable[[Floats], Floats],
    x: Floats,
    ways: Floats,
) -> tuple[Floats, float]:
    """Minimise the sum of squares along directions (d, p) from x; return minimiser and sum."""
    found = optimize.least_squares(
        lambda z: residual(x + z @ ways),
        np.zeros(len(ways)),
        lambda z: jacobian(x + z @ ways) @ ways.T,
        method="lm",
        ftol=1e-13,
        xtol=1e-12,
        gtol=1e-14,
        max_nfev=500,
    )
    if found.status <= 0:
        raise NoSolutionError(
            "no base frame was found that brings the measured points to the predicted ones: give "
            "a start, or check that both lists have the same order"
        )
    return x + found.x @ ways, 2.0 * float(found.cost)


def _starts(pairs: _Pairs, first: Rigid) -> tuple[list[Rigid], float]:
    """Best of many initial rotations for a fit with an offset, and lower bound of the sum.

    Candidates are a motion without an offset, 59 evenly spread rotations of it, and the rotation
    nearest to the best affine map with an offset, each with its best shift and offset.
    """
    root = np.sqrt(pairs.weight)[:, None, None]
    arms, size, fixed = pairs.arms(first), pairs.size, pairs.linear
    # change of the map, of minimum norm
    change = np.einsum("ij,kl->kijl", np.eye(3), arms / size).reshape(len(arms), 3, 9)
    rows = (root * np.concatenate([change, fixed], axis=2)).reshape(-1, 15)
    wanted = (root[..., 0] * (pairs.base - arms)).ravel()
    best = np.linalg.lstsq(rows, wanted, rcond=1e-6)[0]
    bound = float(np.sum((wanted - rows @ best) ** 2))
    affine = best[:9].reshape(3, 3) / size
    u, _, v = np.linalg.svd(np.eye(3) + affine)
    nearest = (u * [1.0, 1.0, np.linalg.det(u @ v)]) @ v
    ways = np.concatenate([nearest[None], Rotation.create_group("I").as_matrix()])
    u, values, _ = np.linalg.svd((root * fixed).reshape(-1, 6), full_matrices=False)
    u = u[:, values > _LOST * values[0]]
    turned = np.einsum("wij,kj->wki", ways, arms)
    rest = (root[..., 0] * (pairs.base - turned)).reshape(len(ways), -1)
    left = np.sum(rest**2, axis=1) - np.sum((rest @ u) ** 2, axis=1)
    out = []
    tried = 5 if len(arms) < _FEW else 2
    for way in ways[np.argsort(left, kind="stable")[:tried]]:
        turn = way @ first.rotation
        out.append(Rigid(turn, first.apply(pairs.middle) - turn @ pairs.middle))
    return out, bound


def _reweighted(pairs: _Pairs, spread: Floats | None, best: _Best) -> tuple[_Best, Floats, Floats]:
    """Robust fit with Huber's loss: result, weights (K,), and standard deviations (K,)."""
    down = np.ones(len(pairs.base))
    for _ in range(200):
        distance = np.linalg.norm(pairs.residual(best.frame, best.offset), axis=1)
        scale = spread
        if scale is None:
            typical = float(np.median(distance)) / _MEDIAN
            typical *= math.sqrt(pairs.base.size / pairs.dof)
            # points that fit exactly leave no scale
            floor = 1e-12 * float(np.ptp(pairs.base, axis=0).max())
            scale = np.full(len(down), max(typical, floor))
        ratio = distance / (_HUBER * scale)
        now = 1.0 / np.maximum(ratio, 1.0)
        settled = float(np.abs(now - down).max()) < 1e-6
        down = now
        if settled:
            return best, down, scale
        best = _refined(replace(pairs, weight=pairs.weight * down), best.frame)
    raise NoSolutionError(
        "the weights of the robust fit do not settle: fit without robust, and look at the residuals"
    )


# -- uncertainty -------------------------------------------------------------------------------


def _registration(
    kind: Kind,
    pairs: _Pairs,
    best: _Best,
    spread: Floats | None,
    down: Floats | None = None,
    scale: Floats | None = None,
) -> Registration:
    """Covariance and identifiability, from the Jacobian of the residuals.

    `spread` are the given standard deviations (n,), None to estimate them from the residuals;
    `down` and `scale` are the weights and the standard deviations (n,) of a robust fit.
    """
    robust, given = down is not None, spread is not None
    spread = spread if scale is None else scale
    down = np.ones(len(pairs.base)) if down is None else down
    force = pairs.weight * down
    moved = best.frame.apply(pairs.measured)
    pivot = force @ moved / force.sum()
    by = np.concatenate([-_cross(moved - pivot), pairs.linear], axis=2)
    residual = pairs.residual(best.frame, best.offset)
    count, unknowns, dof = len(residual), pairs.unknowns, pairs.dof
    square = np.sum(residual**2, axis=1)
    if spread is None:
        spread = np.full(count, math.sqrt(square.sum() / dof))
    factor = 1.0
    if robust:
        # asymptotic variance of a fit with Huber's loss and isotropic noise
        slope = float(np.mean(np.where(down < 1.0, 2.0 * down / 3.0, 1.0)))
        factor = float(np.sum(down**2 * square / spread**2)) / dof / slope**2
    # relative weights keep exact fits finite
    typical = float(spread.max())
    relative = spread / typical if typical > 0 else np.ones(count)
    size = math.sqrt(float(np.mean(np.sum(by[:, :, :3] ** 2, axis=(1, 2)))) / 2.0)
    unit = np.ones(unknowns)
    unit[:3] = 1.0 / size
    rows = (by * unit / relative[:, None, None]).reshape(-1, unknowns)
    values, directions = _directions(rows)
    lost = values <= _LOST * values[0]
    kept = directions[~lost] * unit
    covariance = factor * typical**2 * (kept.T / values[~lost] ** 2) @ kept
    free = np.linalg.norm(directions[lost], axis=0) > 1e-5
    covariance[free] = covariance[:, free] = math.nan
    covariance[free, free] = math.inf
    weak = []
    for value, direction in zip(values[~lost], directions[~lost], strict=True):
        if value <= _WEAK * values[0]:
            error = math.sqrt(factor) * typical / value
            weak.append(f"{_words(direction)}: standard error {_amount(direction, error, size)}")
    return Registration(
        kind,
        best.frame,
        pivot,
        covariance,
        residual,
        down,
        spread,
        given,
        robust,
        offset=None if pairs.turns is None else best.offset,
        undetermined=tuple(_words(d) for d in _simple(directions[lost])),
        weak=tuple(weak),
    )


def _directions(rows: Floats) -> tuple[Floats, Floats]:
    """Singular values (p,) of a tall matrix, and its right singular vectors (p, p) as rows."""
    _, values, directions = np.linalg.svd(np.linalg.qr(rows, mode="r"))
    return values, directions


def _simple(space: Floats) -> Floats:
    """Directions (d, p) with the same span, along single parameters as far as possible."""
    if len(space) < 2:
        return space
    _, _, order = linalg.qr(space, pivoting=True)
    rows = np.linalg.solve(space[:, np.sort(order[: len(space)])], space)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


_PARTS: Final = (
    ("rotation of the frame about {}", ""),
    ("shift of the frame along {}", ""),
    ("offset along {}", " of the tip"),
)


def _words(direction: Floats) -> str:
    """Describe a direction in scaled parameters (p,) in words."""
    parts = []
    for i, (words, axes) in enumerate(_PARTS[: len(direction) // 3]):
        share = direction[3 * i : 3 * i + 3]
        if np.linalg.norm(share) > 0.2:
            parts.append(words.format(_axis(share)) + axes)
    return " against ".join(parts)


def _axis(vector: Floats) -> str:
    unit = vector / np.linalg.norm(vector)
    if np.abs(unit).max() > 0.98:
        return "xyz"[int(np.argmax(np.abs(unit)))]
    unit = unit * np.sign(unit[np.argmax(np.abs(unit))])
    return "(" + ", ".join(f"{x:.2f}" for x in unit + 0.0) + ")"


def _amount(direction: Floats, error: float, size: float) -> str:
    if np.linalg.norm(direction[:3]) > 0.98:
        return f"{math.degrees(error / size):.2g} deg"
    return f"{1e3 * error:.2g} mm"


def with_and_without(
    registration: Registration,
    measured: ArrayLike,
    predicted: ArrayLike,
    length: float,
    rotations: ArrayLike | None = None,
    *,
    nominal: Rigid | None = None,
    name: str = "rod",
) -> dict[str, Comparison]:
    """Compare model and measurement with and without the registration.

    Parameters
    ----------
    registration : Registration
        Registration from `fit_model` or `fit_fiducials`.
    measured : array_like (K, 3)
        Measured points, m, measuring frame.
    predicted : array_like (K, 3)
        Tips predicted by the model, m, base frame; NaN where there are none.
    length : float
        Length of the robot, m.
    rotations : array_like (K, 3, 3), optional
        Rotations of the tips, body to base; needed if the registration has an offset.
    nominal : Rigid, optional
        Nominal measuring frame without the registration; the base frame by default.
    name : str
        Name of both comparisons.

    Returns
    -------
    dict
        ``"unregistered"`` and ``"registered"``; each difference is model minus measurement, in base
        axes, m. `bowstring.data.Comparison` has mean, RMS and maximum over points, and by
        axis.
    """
    ours, theirs = vectors("measured", measured), vectors("predicted", predicted)
    if ours.ndim != 2 or ours.shape != theirs.shape:
        raise InputError(
            f"measured has shape {ours.shape} and predicted {theirs.shape}, both must be "
            "(points, 3)"
        )
    whole = number("length", length, "m")
    before = (nominal or Rigid.identity()).apply(ours)
    if registration.offset is not None and rotations is None:
        raise InputError("the registration has an offset: give the rotations of the tips too")
    after = registration.tips(ours, rotations)
    return {
        "unregistered": Comparison(name, "measurement", whole, theirs, theirs - before),
        "registered": Comparison(name, "measurement", whole, theirs, theirs - after),
    }


# -- small pieces ------------------------------------------------------------------------------


def _cross(vectors: Floats) -> Floats:
    """Matrices (..., 3, 3) of cross products with vectors (..., 3)."""
    return np.cross(np.eye(3), vectors[..., None, :])


def _left_jacobian(vector: Floats) -> Floats:
    """Left Jacobian (3, 3) of SO(3): derivative of a rotation by its rotation vector."""
    angle = float(np.linalg.norm(vector))
    cross = _cross(vector)
    once = 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    twice = (angle - math.sin(angle)) / angle**3 if angle > 1e-2 else 1 / 6 - angle**2 / 120
    return np.asarray(np.eye(3) + once * cross + twice * cross @ cross)


def _finite_points(name: str, value: ArrayLike) -> Floats:
    found = vectors(name, value)
    if found.ndim != 2 or not len(found):
        raise InputError(f"{name} has shape {found.shape}, it must be (points, 3), in m")
    bad = ~np.isfinite(found).all(axis=1)
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(f"point {i + 1} of {name} is {found[i].tolist()}, all must be finite")
    return found


def _rotations(value: ArrayLike, count: int) -> Floats:
    found = read("rotations", value, "numbers")
    if found.shape != (count, 3, 3):
        raise InputError(f"rotations has shape {found.shape}, it must be {(count, 3, 3)}")
    off = np.abs(found @ np.swapaxes(found, 1, 2) - np.eye(3)).max(axis=(1, 2))
    bad = ~((off < SKEW) & (np.linalg.det(found) > 0))
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(f"rotation {i + 1} is none: {shown(found[i].tolist())}")
    return found


def _sigma(value: ArrayLike | None, count: int) -> tuple[Floats | None, Floats]:
    """Standard deviations (n,), or None if not given, and their weights (n,)."""
    if value is None:
        return None, np.ones(count)
    try:
        found = np.array(np.broadcast_to(floats(value), (count,)))
    except (TypeError, ValueError):
        raise InputError(
            f"sigma is {shown(value)}, it must be one standard deviation in m, or one for each of "
            f"the {count} points"
        ) from None
    if not (np.isfinite(found) & (found > 0)).all():
        raise InputError(f"sigma is {shown(value)}, it must be finite and positive, in m")
    return found, (found.min() / found) ** 2
