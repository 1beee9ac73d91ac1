"""Uncertainty of fitted parameters: covariance and profile likelihood intervals.

n is the number of used rows, P that of parameters. Residuals are in mm, parameters are divided by
their natural steps.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bowstring.calibration.pieces import Landscape, Minimum
from bowstring.calibration.search import EXACT

__all__ = ["covariance", "newey_west_lag", "profile_ends"]

Floats = NDArray[np.float64]

#: Normal ratio of the increase of the cost at the end of an interval to that by the derivatives.
_REGULAR: Final = (0.6, 1.7)
#: Size of a fit times parameters up to which irregular intervals are profiled.
_LARGE: Final = 300_000
#: Number of minima from which a profile starts.
_STARTS: Final = 4


def covariance(
    by: tuple[Floats, Floats], rows: Floats, identified: Floats, run: NDArray[np.int64], reach: int
) -> tuple[Floats, float]:
    """Covariance (P, P) of the estimates, and half width of a 95 % interval over standard error.

    This is theory Eq. 7.2; noise may differ between axes. `by` (3 n,) are the first and the
    second derivative of half the loss by the residuals, `rows` (3 n, P) the Jacobian of the
    residuals, `identified` (R, P) the identifiable directions. With a `reach`, rows of one `run`
    (n,) closer than that may be correlated (Newey and West, Econometrica 55, 1987; interval by
    Kiefer and Vogelsang, Econometric Theory 21, 2005).
    """
    from scipy.special import stdtrit

    force, slope = (each.reshape(-1, 3) for each in by)
    of_axis = (rows @ identified.T).reshape(-1, 3, len(identified))
    count, parameters = len(of_axis), len(identified)
    square = np.einsum("kap,kaq->apq", of_axis, of_axis)
    mean = slope.mean(axis=0)
    inverse = np.linalg.inv(np.tensordot(mean, square, 1))
    taken = mean * np.einsum("apq,qp->a", square, inverse)  # parameters determined by each axis
    free = np.maximum(count - taken, 1.0)
    spread = (force**2).sum(axis=0) / free
    correction = 1 + parameters / slope.size * float(slope.var()) / float(slope.mean()) ** 2
    if reach:
        of_row = np.einsum("kap,ka->kp", of_axis, force)
        scatter = of_row.T @ of_row
        for apart in range(1, reach):
            one_run = run[apart:] == run[:-apart]
            both = of_row[apart:][one_run].T @ of_row[:-apart][one_run]
            scatter += (1 - apart / reach) * (both + both.T)
        scatter *= count / float(free.min())
        half = float(np.polyval([-0.5324, 0.4160, 2.9694, 1.9600], reach / count))
    else:
        scatter = np.tensordot(spread, square, 1)
        half = float(stdtrit(free.min(), 0.975))
    back = identified.T @ inverse
    return correction**2 * back @ scatter @ back.T, half


def newey_west_lag(correlation: float, count: int) -> int:
    """Bandwidth in rows for a given autocorrelation (Andrews, Econometrica 59, 1991)."""
    square = min(correlation, 0.97) ** 2
    alpha = 4.0 * square / (1.0 - square) ** 2
    return min(math.ceil(1.1447 * math.pow(alpha * count, 1.0 / 3.0)), count // 2)


def profile_ends(
    land: Landscape | None, covariance: Floats, half: float, jacobian: Floats, slope: Floats
) -> Floats | None:
    """Ends (2, P) of profile likelihood intervals; None where the derivatives suffice.

    They do not suffice where tendons become taut or slack inside an interval, or another minimum is
    hardly higher. The bound of the cost is the one that would reproduce the interval of the
    derivatives for a quadratic cost.
    """
    parameters = len(covariance)
    if land is None or np.abs(land.residuals).max() < 1e3 * EXACT:
        return None
    hessian = jacobian.T @ (slope[:, None] * jacobian)
    bread = np.diag(np.linalg.pinv(hessian, hermitian=True))
    spread = np.diag(covariance)
    least = land.cost(np.zeros(parameters))
    allowed = 0.5 * half**2 * float(np.median(spread / np.maximum(bread, 1e-300)))
    size, axes = np.linalg.eigh(covariance / np.sqrt(np.outer(spread, spread)))
    regular = True
    for length, axis in zip(np.sqrt(np.maximum(size, 0.0)), axes.T, strict=True):
        for sign in (half, -half):
            change = sign * length * axis * np.sqrt(spread)
            if (change < land.low).any() or (change > land.high).any():
                continue
            asked = 0.5 * float(change @ hessian @ change)
            regular &= _REGULAR[0] * asked < land.cost(change) - least < _REGULAR[1] * asked
    minima = [each for each in land.minima if each.cost < least + allowed]
    width = half * np.sqrt(spread)
    for each in minima:
        regular &= bool((np.abs(each.change) <= width).all())
    if regular or land.size * parameters > _LARGE:
        return None
    starts = [Minimum(np.zeros(parameters), least)]
    for each in minima:
        if all((np.abs(each.change - other.change) > 0.1 * width).any() for other in starts):
            starts.append(each)
    ends = [
        [
            land.reach(i, sign, float(width[i]), least + allowed, starts[:_STARTS])
            for i in range(parameters)
        ]
        for sign in (-1.0, 1.0)
    ]
    return np.array(ends)
