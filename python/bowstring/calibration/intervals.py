"""Uncertainty of fitted parameters: covariance and profile likelihood intervals.

n is the number of points that are measured in used rows, D that of coordinates of a point, M that
of measured points in a row, N that of used rows, P that of parameters, Q that of priors. Residuals
are in mm or rad, parameters are divided by their natural steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration.pieces import Landscape, Minimum
from bowstring.calibration.residual_tests import autocorrelation
from bowstring.significance import NOISE, NORMAL, student

#: Share of a parameter in a direction that is not identifiable, from which on it is undetermined.
_SHARE: Final = 1e-3
#: Residuals that count as zero, m; below the precision of any device.
EXACT: Final = 1e-8
#: Singular value over the largest below which the data do not identify a direction of parameters.
SAME: Final = 1e-5
#: The same for data and priors together, after such directions are removed from the data.
_NOTHING: Final = 1e-10
#: Autocorrelation of residuals that indicates dependent errors, if significant.
_ALIKE: Final = 0.3
#: Share of the errors of a row in some direction that a fit leaves, below which the other rows
#: hardly determine that direction.
_ALONE: Final = 0.1
#: Normal ratio of the increase of the cost at the end of an interval to that by the derivatives.
_REGULAR: Final = (0.6, 1.7)
#: Size of a fit times parameters up to which irregular intervals are profiled.
_LARGE: Final = 300_000
#: Number of minima from which a profile starts.
_STARTS: Final = 4


@dataclass(frozen=True, eq=False)
class Dependence:
    """Row and point of each residual, and dependence of neighbouring rows.

    Attributes
    ----------
    correlation : float
        Autocorrelation of neighbouring rows of a group; NaN with too few rows.
    is_significant : bool
        Whether it is above 0.3, and by more than chance.
    run : ndarray of int (N,)
        Rows of the same number are neighbours of a group.
    row, point : ndarray of int (n,)
        Used row and point of D residuals each.
    """

    correlation: float
    is_significant: bool
    run: Ints
    row: Ints
    point: Ints

    @classmethod
    def of(cls, errors: Floats, counted: Bools, group: NDArray[Any]) -> Dependence:
        """Test errors (K, M, D) in m or rad of the points that count (K, M).

        `group` (K,) as by `observations.groups`.
        """
        at = np.flatnonzero(counted.any(axis=1))
        row, point = np.nonzero(counted[at])
        near = (np.diff(at) == 1) & (group[at[1:]] == group[at[:-1]])
        run = np.concatenate([[0], np.cumsum(~near)])
        residual = np.where(counted[at][:, :, None], errors[at], 0.0).reshape(len(at), -1)
        if np.abs(residual).max() < EXACT:
            return cls(math.nan, False, run, row, point)
        correlation, p_value = autocorrelation(residual, near)
        significant = correlation > _ALIKE and p_value < NOISE
        return cls(correlation, significant, run, row, point)

    @property
    def reach(self) -> int:
        """Bandwidth in rows (Andrews, Econometrica 59, 1991); 0 for independent rows."""
        if not self.is_significant:
            return 0
        count = len(self.run)
        square = min(self.correlation, 0.97) ** 2
        alpha = 4.0 * square / (1.0 - square) ** 2
        return min(math.ceil(1.1447 * math.pow(alpha * count, 1.0 / 3.0)), count // 2)


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Uncertainty of the estimates by theory Eqs 7.2, 7.4 and 7.5; made by `of`.

    Attributes
    ----------
    covariance : ndarray (P, P)
        Covariance of scaled parameters; zero in directions of `lost`.
    half : ndarray (P,)
        Half width of a 95 % interval over the standard error.
    noise : float
        Standard deviation of an independent residual that would give the same covariance, mm.
    determined : float
        Number of parameters that the data determine, the rest of P being left to the priors.
    lost : ndarray (L, P)
        Directions that are not identifiable.
    """

    covariance: Floats
    half: Floats
    noise: float
    determined: float
    lost: Floats

    @property
    def undetermined(self) -> Bools:
        """Parameters (P,) with a share in a direction that is not identifiable."""
        return np.asarray((np.abs(self.lost) >= _SHARE).any(axis=0))

    @classmethod
    def of(
        cls,
        by: tuple[Floats, Floats],
        jacobian: Floats,
        prior: Floats,
        weighted_by: float,
        dependence: Dependence,
    ) -> Uncertainty:
        """Compute the covariance at a minimum; the errors of a row may have any covariance.

        Where a row determines a direction nearly alone, each coordinate of each point has one
        variance instead, and intervals have the degrees of freedom of Welch and Satterthwaite.

        Parameters
        ----------
        by : tuple of ndarray (D n,)
            First and second derivative of half the loss by the residuals.
        jacobian, prior : ndarray (D n, P), (Q, P)
            Derivatives of the residuals of data and priors.
        weighted_by : float
            Standard deviation of a residual by which the priors are weighted, mm.
        dependence : Dependence
            Rows and points of the residuals; rows may be correlated (Newey and West, Econometrica
            55, 1987; interval by Kiefer and Vogelsang, Econometric Theory 21, 2005).

        Returns
        -------
        Uncertainty
            Covariance, intervals and noise.
        """
        size = np.sqrt((jacobian**2).sum(axis=0) + (prior**2).sum(axis=0))
        size[size == 0] = 1.0
        rows, own = jacobian / size, prior / size
        _, singular, direction = np.linalg.svd(rows, full_matrices=False)
        is_seen = singular > SAME * singular[0]
        if len(own):  # priors determine what the data do not, and inexact derivatives must not
            rows = rows @ direction[is_seen].T @ direction[is_seen]
            both = np.concatenate([rows, own])
            _, singular, direction = np.linalg.svd(both, full_matrices=False)
            is_seen = singular > _NOTHING * singular[0]
        seen, lost = direction[is_seen], direction[~is_seen]

        force, slope = (each.reshape(len(dependence.row), -1) for each in by)
        of_axis = (rows @ seen.T).reshape(*force.shape, len(seen))
        own = own @ seen.T
        points = [dependence.point == m for m in np.unique(dependence.point)]
        square = np.stack([_square(of_axis[own_rows]) for own_rows in points])
        mean = np.stack([slope[own_rows].mean(axis=0) for own_rows in points])
        bread = np.tensordot(mean, square, 2)
        inverse = np.linalg.inv(bread + own.T @ own)
        taken = mean * np.einsum("mapq,qp->ma", square, inverse)  # determined by each axis
        determined = float(taken.sum())
        rows_of = np.array([[float(own_rows.sum())] for own_rows in points])
        free = np.maximum(rows_of - taken, 1.0)
        share = determined / slope.size
        correction = 1 + share * float(slope.var()) / float(slope.mean()) ** 2
        back = seen.T @ inverse / size[:, None]
        half: Any
        if reach := dependence.reach:
            scatter = _scatter(of_axis, force, dependence, reach)
            scatter *= float(rows_of.sum() / free.min(axis=1).sum())
            width = reach / len(dependence.run)
            half = float(np.polyval([-0.5324, 0.4160, 2.9694, 1.9600], width))
        elif (clusters := _Clusters.of(of_axis, mean, inverse, dependence)) is not None:
            scatter = clusters.scatter(force)
            half = student(clusters.freedom(back))
        else:
            spread = np.stack([(force[own_rows] ** 2).sum(axis=0) for own_rows in points]) / free
            of_point = np.einsum("ma,mapq->mpq", spread, square)
            scatter = of_point.sum(axis=0)
            share_of_point = np.einsum("ip,mpq,iq->mi", back, of_point, back)
            half = student(_freedom(share_of_point, free.min(axis=1)))
        scatter *= correction**2
        of_data = back @ scatter @ back.T
        of_priors = weighted_by**2 * back @ own.T @ own @ back.T
        covariance = of_data + of_priors
        total = np.diag(covariance)
        known = np.diag(of_priors) / np.where(total > 0.0, total, 1.0)
        return cls(
            covariance,
            np.sqrt(half**2 + known * (NORMAL**2 - half**2)),
            math.sqrt(float(np.sum(inverse * scatter)) / max(determined, 1e-300)),
            determined,
            lost,
        )


@dataclass(frozen=True, eq=False)
class _Clusters:
    """Rows whose errors have any covariance: jackknife of a linearised fit.

    A wrong command moves all coordinates of its row, and more where the robot moves more. The
    jackknife counts this in full (MacKinnon, Nielsen and Webb, Journal of Applied Econometrics 38,
    2023). C is the number of coordinates of a row, p that of directions. Made by `of`.

    Attributes
    ----------
    place : tuple of ndarray of int (n,)
        Row of each point, and its place in it.
    derivatives : ndarray (N, C, p)
        Derivatives of the coordinates, zero where not measured.
    scaled : ndarray (N, C, p)
        Derivatives by directions in which the Hessian is the identity, times the roots of the mean
        second derivatives of the loss.
    left : ndarray (N, p, p)
        Inverse of the Hessian without the row, in these directions.
    """

    place: tuple[Ints, Ints]
    derivatives: Floats
    scaled: Floats
    left: Floats

    @classmethod
    def of(
        cls, of_axis: Floats, mean: Floats, inverse: Floats, dependence: Dependence
    ) -> _Clusters | None:
        """Make rows; None if a row determines a direction nearly alone: none shows its errors."""
        place = dependence.row, np.unique(dependence.point, return_inverse=True)[1]
        derivatives = np.zeros((len(dependence.run), len(mean), *of_axis.shape[1:]))
        derivatives[place] = of_axis
        derivatives = derivatives.reshape(len(derivatives), mean.size, -1)
        weight = np.maximum(mean.ravel(), 0.0)  # rounding, where Huber's loss is linear in all rows
        scaled = np.sqrt(weight)[:, None] * derivatives @ np.linalg.cholesky(inverse)
        left = np.eye(len(inverse)) - np.swapaxes(scaled, 1, 2) @ scaled
        if np.linalg.eigvalsh(left).min(initial=1.0) < _ALONE:
            return None
        return cls(place, derivatives, scaled, np.linalg.inv(left))

    def without_row(self, errors: Floats) -> Floats:
        """Errors (N, C, E) by fits without the row, from those by the fit (Woodbury's identity)."""
        return np.asarray(
            errors + self.scaled @ (self.left @ (np.swapaxes(self.scaled, 1, 2) @ errors))
        )

    def scatter(self, force: Floats) -> Floats:
        """Covariance (p, p) of the gradient."""
        rows, coordinates, _ = self.derivatives.shape
        table = np.zeros((rows, coordinates // force.shape[1], force.shape[1]))
        table[self.place] = force
        errors = self.without_row(table.reshape(rows, coordinates, 1))
        of_row = (np.swapaxes(self.derivatives, 1, 2) @ errors)[..., 0]
        return np.asarray(of_row.T @ of_row)

    def freedom(self, back: Floats) -> Floats:
        """Degrees of freedom (P,) of the variances of parameters, for equal, independent errors.

        By Bell and McCaffrey (Survey Methodology 28, 2002). `back` (P, p) times the gradient is the
        error of the parameters.
        """
        scaled, all_own = self.scaled, self.without_row(self.derivatives @ back.T)
        freedom = np.ones(len(back))
        for i in range(len(back)):
            own = all_own[..., i]
            size = (own**2).sum(axis=1)
            common = (own[:, None] @ scaled)[:, 0]
            taken = (common**2).sum(axis=1)
            square = (size**2).sum() - 2.0 * size @ taken + ((common.T @ common) ** 2).sum()
            if square > 0.0:
                freedom[i] = (size - taken).sum() ** 2 / square
        return np.maximum(freedom, 1.0)


def _square(of_axis: Floats) -> Floats:
    """Sums (D, P, P) over the rows of the products of derivatives (n, D, P) by each axis."""
    by_axis = np.swapaxes(of_axis, 0, 1)
    return np.asarray(np.swapaxes(by_axis, 1, 2) @ by_axis)


def _freedom(variance: Floats, free: Floats) -> Floats:
    """Degrees of freedom (P,) of sums of variances (M, P) with `free` (M,) degrees of freedom.

    By Welch and Satterthwaite; equal to that of a single variance.
    """
    if len(free) == 1:
        return np.repeat(free, variance.shape[1])
    total = variance.sum(axis=0)
    share = np.divide(variance, total, where=total > 0.0, out=np.ones_like(variance))
    return np.asarray(1.0 / (share**2 / free[:, None]).sum(axis=0))


def _scatter(of_axis: Floats, force: Floats, dependence: Dependence, reach: int) -> Floats:
    """Covariance of the gradient with correlated rows of a run, closer than `reach`.

    Points of the same row may be correlated as well.
    """
    run = dependence.run
    of_row = np.zeros((len(run), of_axis.shape[2]))
    np.add.at(of_row, dependence.row, np.einsum("kap,ka->kp", of_axis, force))
    scatter = np.asarray(of_row.T @ of_row)
    for apart in range(1, reach):
        one_run = run[apart:] == run[:-apart]
        both = of_row[apart:][one_run].T @ of_row[:-apart][one_run]
        scatter += (1 - apart / reach) * (both + both.T)
    return scatter


def profile_ends(land: Landscape | None, found: Uncertainty, hessian: Floats) -> Floats | None:
    """Ends (2, P) of profile likelihood intervals; None where the derivatives suffice.

    They do not suffice where tendons become taut or slack inside an interval, or another minimum is
    hardly higher. The bound of the cost is the one that would reproduce the interval of the
    derivatives for a quadratic cost. Parameters that are not identifiable have no interval by the
    derivatives, and infinite ends here; the profiles of the others are minimised over them too.
    """
    if land is None or np.abs(land.residuals).max() < 1e3 * EXACT:
        return None
    covariance, half = found.covariance, found.half
    parameters = len(covariance)
    known = np.flatnonzero(~found.undetermined)
    if not len(known):
        return None
    bread = np.diag(np.linalg.pinv(hessian, hermitian=True))
    spread = np.diag(covariance)
    least = land.cost(np.zeros(parameters))
    ratio = spread[known] / np.maximum(bread[known], 1e-300)
    allowed = 0.5 * half**2 * float(np.median(ratio))
    widest, most = float(half.max()), least + float(allowed.max())
    scale = np.sqrt(spread[known])
    size, axes = np.linalg.eigh(covariance[np.ix_(known, known)] / np.outer(scale, scale))
    regular = True
    for length, axis in zip(np.sqrt(np.maximum(size, 0.0)), axes.T, strict=True):
        for sign in (widest, -widest):
            change = np.zeros(parameters)
            change[known] = sign * length * axis * scale
            if (change < land.low).any() or (change > land.high).any():
                continue
            asked = 0.5 * float(change @ hessian @ change)
            regular &= _REGULAR[0] * asked < land.cost(change) - least < _REGULAR[1] * asked
    minima = [each for each in land.minima if each.cost < most]
    width = half[known] * scale
    for each in minima:
        regular &= bool((np.abs(each.change[known]) <= width).all())
    if regular or land.size * parameters > _LARGE:
        return None
    starts = [Minimum(np.zeros(parameters), least)]
    for each in minima:
        apart = [np.abs(each.change - other.change)[known] > 0.1 * width for other in starts]
        if all(away.any() for away in apart):
            starts.append(each)
    ends = np.outer([-np.inf, np.inf], np.ones(parameters))
    for i, wide in zip(known, width, strict=True):
        most = least + float(allowed[i])
        for side, sign in enumerate((-1.0, 1.0)):
            ends[side, i] = land.reach(int(i), sign, float(wide), most, starts[:_STARTS])
    return ends
