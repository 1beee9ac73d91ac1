"""Sobol' indices with bootstrap intervals, and Morris' screening.

Indices are those of `scipy.stats.sobol_indices` and, of second order, SALib. SciPy's own bootstrap
(BCa, with a jackknife) takes time in n^2, SALib's gathers n numbers for each resample and index;
here all resamples of all indices are one matrix product.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.optional import load_extra
from bowstring.uncertainty.sampling import MorrisDesign, SaltelliDesign
from bowstring.validation import read, shown, whole

#: Numbers of a chunk of resamples: 16 MB.
_CHUNK: Final = 2**21
#: Least number of base points, or trajectories, with all their results.
_LEAST_POINTS: Final = 32
_LEAST_TRAJECTORIES: Final = 4
#: Standard deviation over mean of an output, below which its variation is rounding.
_ROUNDING: Final = 1e-12


@short_repr
@dataclass(frozen=True, eq=False)
class IntervalEstimate:
    """Estimate with its confidence interval, numbers or arrays.

    Attributes
    ----------
    value, low, high : float or ndarray
        Estimate and bounds of the interval.
    """

    value: Any
    low: Any
    high: Any


@short_repr
@dataclass(frozen=True, eq=False)
class SobolIndices:
    """Sobol' indices of d factors, of one output or of m.

    Attributes
    ----------
    factors : tuple of str (d,)
    first, total : IntervalEstimate (d,) or (m, d)
        First-order index: share of the variance that a factor explains alone. Total index: share
        with all its interactions. NaN for an output that does not vary.
    second : IntervalEstimate (d, d) or (m, d, d), or None
        Share by the interaction of two factors, symmetric with NaN on the diagonal; None if the
        design has no rows for it.
    points : int or ndarray (m,)
        Base points with all their results; the indices are over these.
    share_without_result : float or ndarray (m,)
        Share of the base points left out, as at least one of their rows has no result.
    confidence : float
        Confidence level of the intervals.
    """

    factors: tuple[str, ...]
    first: IntervalEstimate
    total: IntervalEstimate
    second: IntervalEstimate | None
    points: NDArray[np.intp]
    share_without_result: Floats
    confidence: float


@short_repr
@dataclass(frozen=True, eq=False)
class MorrisEffects:
    """Elementary effects of d factors, of one output or of m.

    Attributes
    ----------
    factors : tuple of str (d,)
    mu_star : IntervalEstimate (d,) or (m, d)
        Mean absolute elementary effect: change of the output over the middle 99 % of the factor's
        distribution. Large for an important factor.
    sigma : ndarray (d,) or (m, d)
        Standard deviation of the elementary effects, large for interactions and nonlinear effects;
        NaN for correlated numbers.
    trajectories : int or ndarray (m,)
        Trajectories with all their results; the effects are over these.
    share_without_result : float or ndarray (m,)
        Share of the trajectories left out.
    confidence : float
        Confidence level of the intervals.
    """

    factors: tuple[str, ...]
    mu_star: IntervalEstimate
    sigma: Floats
    trajectories: NDArray[np.intp]
    share_without_result: Floats
    confidence: float


def sobol_indices(
    design: SaltelliDesign,
    outputs: ArrayLike,
    *,
    confidence: float = 0.95,
    resamples: int = 1000,
    seed: int = 0,
) -> SobolIndices:
    """Sobol' indices of the outputs of a design, with bootstrap intervals.

    Outputs that are NaN or infinite are taken as no result. A base point without the results of
    all its rows is left out, and the indices are those of the model where it has a result; the
    share left out is part of the result.

    Parameters
    ----------
    design : SaltelliDesign
        Design of n base points.
    outputs : array_like (rows,) or (rows, m)
        Outputs of the model at all rows, as `evaluate` gives them.
    confidence : float
        Confidence level of the intervals.
    resamples : int
        Bootstrap resamples of the base points; intervals are between their percentiles.
    seed : int
        Seed of the resamples.

    Returns
    -------
    SobolIndices
        Indices with intervals, and the share of base points left out.

    Raises
    ------
    InputError
        If the outputs do not fit the design.
    NoSolutionError
        If fewer than 32 base points have all their results.

    Notes
    -----
    docs/theory/uncertainty.md has the estimators. Points of a Sobol' sequence cover the space more
    evenly than independent ones, which the bootstrap assumes: intervals tend to be too wide, not
    too narrow.
    """
    if not isinstance(design, SaltelliDesign):
        raise InputError.of("design", shown(design), "a SaltelliDesign")
    found = checked_outputs(outputs, len(design))
    level = checked_confidence(confidence)
    whole("resamples", resamples, 100, 100_000)
    if design.second_order:
        load_extra("uncertainty")
    single = found.ndim == 1
    # (m, width, n), a copy that may change
    table: Floats = np.array(found.reshape(design.count, design.width, -1).transpose(2, 1, 0))
    has_result: Bools = np.asarray(np.isfinite(table).all(axis=1))
    points = has_result.sum(axis=1)
    if (points < min(_LEAST_POINTS, design.count)).any():
        raise NoSolutionError(
            f"only {points.min()} of {design.count} base points have a result in all their rows, "
            f"at least {_LEAST_POINTS} must; narrow the distributions"
        )
    varies = _standardise(table, has_result)
    count = len(design.distributions.factors)
    value = _estimates(table, count, design.second_order)
    rng = np.random.default_rng(seed)
    low, high = _percentiles(table, has_result, count, (resamples, level), rng)
    for each in (value, low, high):
        each[~varies] = np.nan
    parts = [slice(0, count), slice(count, 2 * count), slice(2 * count, None)]
    first, total, pairs = ([x[:, part] for x in (value, low, high)] for part in parts)
    second = None
    if design.second_order:
        second = _interval([_square(x, count) for x in pairs], single)
    return SobolIndices(
        factors=design.distributions.factors,
        first=_interval(first, single),
        total=_interval(total, single),
        second=second,
        points=points[0] if single else points,
        share_without_result=_squeezed(1.0 - points / design.count, single),
        confidence=level,
    )


def _standardise(table: Floats, has_result: Bools) -> Bools:
    """Standardise outputs by A and B; return which outputs vary.

    Base points without all results become zero. Zeros add nothing to any sum in the estimators,
    which are ratios of sums: they do not change the indices over the other base points.
    """
    varies = np.empty(len(table), dtype=bool)
    for m, (rows, kept) in enumerate(zip(table, has_result, strict=True)):
        mean, sd = rows[:2, kept].mean(), rows[:2, kept].std()
        varies[m] = sd > _ROUNDING * abs(mean)
        rows -= mean
        rows /= sd if varies[m] else 1.0
        rows[:, ~kept] = 0.0
    return varies


def _estimates(table: Floats, count: int, second_order: bool) -> Floats:
    """Indices (m, 2 d + pairs) by SciPy and SALib."""
    from scipy import stats

    outputs, _, n = table.shape
    if outputs == count == 1:  # SciPy fails for a single index
        return _estimates(np.repeat(table, 2, axis=0), count, second_order)[:1]
    given = {
        "f_A": table[:, 0],
        "f_B": table[:, 1],
        "f_AB": np.moveaxis(table[:, 2 : 2 + count], 1, 0),
    }
    found = stats.sobol_indices(func=given, n=n)
    shape = (outputs, count)
    parts = [np.reshape(found.first_order, shape), np.reshape(found.total_order, shape)]
    if second_order:
        from SALib.analyze.sobol import second_order as pair_index

        a, b = table[:, 0].T, table[:, 1].T
        ab, ba = (np.moveaxis(table[:, k : k + count], 1, 0) for k in (2, 2 + count))
        pairs = [pair_index(a, ab[i].T, ab[j].T, ba[i].T, b) for i, j in _pairs(count)]
        parts.append(np.reshape(np.transpose(pairs), (outputs, -1)))
    return np.concatenate(parts, axis=1)


def _pairs(count: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(count) for j in range(i + 1, count)]


def _percentiles(
    table: Floats,
    has_result: Bools,
    count: int,
    resampling: tuple[int, float],
    rng: np.random.Generator,
) -> tuple[Floats, Floats]:
    """Bounds (m, 2 d + pairs) of the bootstrap intervals.

    Every index is a function of means over base points, so that the means of a resample are those
    of its counts of base points times a matrix.
    """
    resamples, level = resampling
    outputs, width, n = table.shape
    pairs = _pairs(count) if width > count + 2 else []
    # by output: has a result, a + b, a^2 + b^2, first and total order, second order
    columns = [
        _terms(rows, kept, count, pairs) for rows, kept in zip(table, has_result, strict=True)
    ]
    terms = np.concatenate(columns, axis=1)
    means = np.empty((resamples, terms.shape[1]))
    step = max(1, _CHUNK // n)
    for start in range(0, resamples, step):
        stop = min(start + step, resamples)
        means[start:stop] = _counts(stop - start, n, rng) @ terms
    tail = 0.5 * (1.0 - level)
    with np.errstate(divide="ignore", invalid="ignore"):
        indices = _indices_of_means(means.reshape(resamples, outputs, -1), count, pairs)
        low, high = np.quantile(indices, [tail, 1.0 - tail], axis=0)
    return low, high


def _terms(rows: Floats, kept: Bools, count: int, pairs: list[tuple[int, int]]) -> Floats:
    a, b, ab, ba = rows[0], rows[1], rows[2 : 2 + count], rows[2 + count :]
    products = [ba[i] * ab[j] - a * b for i, j in pairs]
    return np.stack(
        [kept, a + b, a**2 + b**2, *(b * (ab - a)), *((a - ab) ** 2), *products], axis=1
    )


def _indices_of_means(means: Floats, count: int, pairs: list[tuple[int, int]]) -> Floats:
    """Indices (..., 2 d + pairs) of means of `_terms` (theory Eqs 8.6 and 8.7)."""
    means = means / means[..., :1]
    total, square = means[..., 1:2], means[..., 2:3]
    variance = square / 2.0 - (total / 2.0) ** 2
    first = means[..., 3 : 3 + count] / variance
    whole_effect = means[..., 3 + count : 3 + 2 * count] / (2.0 * variance)
    second = means[..., 3 + 2 * count :] / variance
    for k, (i, j) in enumerate(pairs):
        second[..., k] -= first[..., i] + first[..., j]
    return np.concatenate([first, whole_effect, second], axis=-1)


def _counts(resamples: int, n: int, rng: np.random.Generator) -> Floats:
    """How often each of n base points is in each resample, divided by n."""
    drawn = rng.integers(0, n, size=(resamples, n), dtype=np.uint16 if n <= 2**16 else np.uint32)
    counts = np.empty((resamples, n))
    for row, which in zip(counts, drawn, strict=True):
        row[:] = np.bincount(which, minlength=n)
    return counts / n


def _square(pairs: Floats, count: int) -> Floats:
    """Symmetric matrices (m, d, d) of pairs (m, d (d - 1) / 2)."""
    out = np.full((len(pairs), count, count), np.nan)
    for k, (i, j) in enumerate(_pairs(count)):
        out[:, i, j] = out[:, j, i] = pairs[:, k]
    return out


def morris_effects(
    design: MorrisDesign,
    outputs: ArrayLike,
    *,
    confidence: float = 0.95,
    seed: int = 0,
) -> MorrisEffects:
    """Elementary effects of Morris by SALib, a cheap screening before Sobol' indices.

    Outputs that are NaN or infinite are taken as no result; a trajectory without all its results
    is left out. Needs the extra ``uncertainty``.

    Parameters
    ----------
    design : MorrisDesign
        Design of r trajectories.
    outputs : array_like (rows,) or (rows, m)
        Outputs of the model at all rows, as `evaluate` gives them.
    confidence : float
        Confidence level of the intervals.
    seed : int
        Seed of the bootstrap.

    Returns
    -------
    MorrisEffects
        Mean absolute effects with intervals, and the share of trajectories left out.

    Raises
    ------
    InputError
        If the outputs do not fit the design.
    NoSolutionError
        If fewer than 4 trajectories have all their results.
    """
    if not isinstance(design, MorrisDesign):
        raise InputError.of("design", shown(design), "a MorrisDesign")
    found = checked_outputs(outputs, len(design))
    level = checked_confidence(confidence)
    from SALib.analyze import morris

    single = found.ndim == 1
    table = found.reshape(design.trajectories, -1, 1 if single else found.shape[1])
    has_result: Bools = np.asarray(np.isfinite(table).all(axis=1))
    kept = has_result.sum(axis=0)
    if (kept < min(_LEAST_TRAJECTORIES, design.trajectories)).any():
        raise NoSolutionError(
            f"only {kept.min()} of {design.trajectories} trajectories have a result in all their "
            f"rows, at least {_LEAST_TRAJECTORIES} must; narrow the distributions"
        )
    points = design.points.reshape(design.trajectories, -1, design.points.shape[1])
    results = []
    for m in range(table.shape[2]):
        rows = has_result[:, m]
        effects = morris.analyze(
            design.problem,
            points[rows].reshape(-1, points.shape[2]),
            table[rows, :, m].ravel(),
            num_resamples=1000,
            conf_level=level,
            num_levels=design.levels,
            seed=np.random.default_rng(seed),
        )
        results.append(
            [np.array(effects[key], float) for key in ("mu_star", "mu_star_conf", "sigma")]
        )
    value, half, sigma = np.moveaxis(np.array(results), 1, 0)
    return MorrisEffects(
        factors=design.distributions.factors,
        mu_star=_interval([value, np.maximum(value - half, 0.0), value + half], single),
        sigma=_squeezed(sigma, single),
        trajectories=kept[0] if single else kept,
        share_without_result=_squeezed(1.0 - kept / design.trajectories, single),
        confidence=level,
    )


def _interval(parts: list[Floats], single: bool) -> IntervalEstimate:
    return IntervalEstimate(*(_squeezed(part, single) for part in parts))


def _squeezed(values: Floats, single: bool) -> Floats:
    return values[0] if single else values


def checked_outputs(outputs: ArrayLike, rows: int) -> Floats:
    """Check outputs of a model (rows,) or (rows, m)."""
    found = read("outputs", outputs, f"outputs of {rows} rows")
    if found.ndim not in (1, 2) or len(found) != rows or found.size == 0:
        raise InputError(f"outputs has shape {found.shape}, it must be ({rows},) or ({rows}, m)")
    return found


def checked_confidence(value: object) -> float:
    """Check a confidence level."""
    right = isinstance(value, (float, np.floating)) and 0.5 <= value < 1.0
    if not right:
        raise InputError.of(
            "confidence", shown(value), "a number from 0.5 to below 1, such as 0.95"
        )
    return float(value)  # type: ignore[arg-type]
