"""Mean, spread, quantiles and probabilities of an output, each with its sampling error."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import significant
from bowstring.uncertainty.indices import (
    IntervalEstimate,
    SobolIndices,
    checked_confidence,
)
from bowstring.validation import read, shown

_QUANTILES: Final = (0.025, 0.5, 0.975)
_LEAST: Final = 32  # samples
#: Largest half width of the interval of an index whose value is stated without "about".
_SHARP: Final = 0.05


@short_repr
@dataclass(frozen=True, eq=False)
class Summary:
    """Statistics of one output over samples; made by `summarise`.

    Attributes
    ----------
    count : int
        Number of samples, with those without a result.
    share_without_result : float
        Share of the samples that are NaN; they count in no statistic but `probability`.
    mean, sd : IntervalEstimate
        Mean and standard deviation; NaN if a value is infinite.
    quantiles : mapping from probability to IntervalEstimate
    probability : IntervalEstimate or None
        Probability that the output is at most the tolerance; a sample without a result does not
        hold it. None without a tolerance.
    tolerance : float or None
    confidence : float
        Confidence level of the intervals.
    """

    count: int
    share_without_result: float
    mean: IntervalEstimate
    sd: IntervalEstimate
    quantiles: Mapping[float, IntervalEstimate]
    probability: IntervalEstimate | None
    tolerance: float | None
    confidence: float


def summarise(
    outputs: ArrayLike,
    *,
    tolerance: float | None = None,
    quantiles: Sequence[float] = _QUANTILES,
    confidence: float = 0.95,
) -> Summary:
    """Summarise one output over samples of the joint distribution.

    Parameters
    ----------
    outputs : array_like (n,)
        Outputs of a `SobolSample`, or of the rows ``design.rows_of_sample`` of a
        `SaltelliDesign`. NaN means no result, infinity a value beyond what was computed, such as a
        validity limit above the largest load.
    tolerance : float, optional
        Largest allowed output.
    quantiles : sequence of float
        Probabilities of the quantiles.
    confidence : float
        Confidence level of the intervals.

    Returns
    -------
    Summary
        Statistics with intervals, and the share of samples without a result.

    Raises
    ------
    InputError
        If an argument is outside its range.
    NoSolutionError
        If fewer than 32 samples have a result.

    Notes
    -----
    Intervals take the samples as independent: that of the mean is normal, that of the standard
    deviation follows from the fourth moment, those of quantiles lie between order statistics, that
    of the probability is Wilson's. For the samples of a Sobol' sequence they tend to be too wide.
    """
    found = read("outputs", outputs, "outputs (n,)")
    if found.ndim != 1:
        raise InputError(f"outputs has shape {found.shape}, it must be (n,)")
    level = checked_confidence(confidence)
    wanted = read("quantiles", quantiles, "probabilities").ravel()
    if not ((wanted > 0.0) & (wanted < 1.0)).all():
        raise InputError.of("quantiles", shown(quantiles), "probabilities above 0 and below 1")
    values = np.sort(found[~np.isnan(found)])
    if len(values) < _LEAST:
        raise NoSolutionError(
            f"only {len(values)} of {found.size} samples have a result, at least {_LEAST} must; "
            "take more samples or narrow the distributions"
        )
    mean, sd = _moments(values, level)
    return Summary(
        count=found.size,
        share_without_result=1.0 - len(values) / found.size,
        mean=mean,
        sd=sd,
        quantiles={float(p): _quantile(values, float(p), level) for p in wanted},
        probability=None if tolerance is None else _probability(found, tolerance, level),
        tolerance=tolerance,
        confidence=level,
    )


def _moments(values: Floats, level: float) -> tuple[IntervalEstimate, IntervalEstimate]:
    from scipy.special import ndtri

    if not np.isfinite(values[[0, -1]]).all():
        none = _interval(math.nan, math.nan, math.nan)
        return none, none
    n, mean, sd = len(values), values.mean(), values.std(ddof=1)
    half = float(ndtri(0.5 + level / 2.0)) / math.sqrt(n)
    fourth = np.mean(((values - mean) / sd) ** 4) if sd > 0.0 else 1.0
    relative = 0.5 * half * math.sqrt(max(fourth - 1.0, 0.0))
    return (
        _interval(mean, mean - half * sd, mean + half * sd),
        _interval(sd, sd * math.exp(-relative), sd * math.exp(relative)),
    )


def _quantile(values: Floats, p: float, level: float) -> IntervalEstimate:
    """Quantile of sorted values, with the order statistics that enclose it."""
    from scipy.stats import binom

    n = len(values)
    low, high = binom.ppf([0.5 * (1.0 - level), 0.5 * (1.0 + level)], n, p)
    bounds = values[[max(int(low) - 1, 0), min(int(high), n - 1)]]
    value = values[min(int(p * n), n - 1)]  # an order statistic, as values may be infinite
    return _interval(value, *bounds)


def _probability(found: Floats, tolerance: float, level: float) -> IntervalEstimate:
    from scipy.stats import binomtest

    if not isinstance(tolerance, (int, float, np.number)) or not np.isfinite(tolerance):
        raise InputError.of("tolerance", shown(tolerance), "a finite number")
    held = int((found <= tolerance).sum())
    ends = binomtest(held, found.size).proportion_ci(level, method="wilson")
    return _interval(held / found.size, ends.low, ends.high)


def _interval(value: Any, low: Any, high: Any) -> IntervalEstimate:
    return IntervalEstimate(float(value), float(low), float(high))


def spread_text(
    summary: Summary,
    indices: SobolIndices | None,
    unit: str,
    size: float = 1.0,
    end: float | None = None,
) -> str:
    """Write median, spread and main factor of an output.

    Parameters
    ----------
    summary : Summary
        With the quantiles 0.025, 0.5 and 0.975.
    indices : SobolIndices or None
        Indices of the same output, for its main factor.
    unit : str
        Unit of the text.
    size : float
        Size of this unit in SI.
    end : float, optional
        Value beyond which outputs are infinite, in SI.

    Returns
    -------
    str
        Such as "56 N (95 %: 49 to 63 N); E causes 71 % of that spread", or with the 95 % interval
        of a share that is known roughly, "E causes about 71 % (62 to 80 %) of that spread".
    """
    low, middle, high = (float(summary.quantiles[p].value) / size for p in _QUANTILES)
    if not math.isfinite(middle):
        raise InputError("the median of the outputs is infinite; state their range instead")
    spread = high - low

    def text(value: float) -> str:
        """Write a value to two digits of the spread and of itself, unless it is far smaller."""
        if not 0.0 < spread < math.inf:
            return significant(value)
        finest = min(spread, abs(value)) if abs(value) > 1e-3 * spread else spread
        return f"{value:.{max(0, 1 - math.floor(math.log10(finest)))}f}"

    ends = f"95 %: {text(low)} to {text(high)} {unit}"
    beyond = "beyond the range" if end is None else f"more than {significant(end / size)} {unit}"
    if high == math.inf:
        ends = f"95 %: {text(low)} {unit} to {beyond}"
    elif low == -math.inf:
        ends = f"97.5 %: {text(high)} {unit} or less"
    said = [f"{text(middle)} {unit} ({ends})"]
    if indices is not None and np.isfinite(indices.first.value).all():
        said.append(_main_factor(indices))
    if summary.share_without_result > 0.0:
        said.append(f"{_percent(summary.share_without_result)} of the samples have no result")
    return "; ".join(said)


def _main_factor(indices: SobolIndices) -> str:
    """Factor with the largest first-order index, or the largest total index if it interacts."""
    first, total = indices.first, indices.total
    if first.value.ndim != 1:
        raise InputError("indices are of several outputs; give those of one")
    main = int(np.argmax(total.value))
    share, ends = float(first.value[main]), (float(first.low[main]), float(first.high[main]))
    about, between = "", ""
    if ends[1] - ends[0] > 2.0 * _SHARP:
        low, high = (f"{100.0 * min(max(end, 0.0), 1.0):.0f}" for end in ends)
        about, between = "about ", f" ({low} to {high} %)"
    interacts = float(total.low[main]) > max(ends[1], share + _SHARP)
    more = f", with its interactions {_percent(float(total.value[main]))}" if interacts else ""
    return f"{indices.factors[main]} causes {about}{_percent(share)}{between} of that spread{more}"


def _percent(share: float) -> str:
    share = min(max(share, 0.0), 1.0)
    return "less than 1 %" if 0.0 < share < 0.01 else f"{100.0 * share:.0f} %"
