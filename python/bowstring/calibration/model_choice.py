"""Choice between models by their errors on left-out rows: one-standard-error rule.

Models are compared by the ratio of their errors in blocks of neighbouring rows. Differences would
be those of the few blocks with the largest errors, where a memory acts most. K is the number of
rows, P that of models. Errors are distances in m, NaN where a row has none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.aliases import Bools, Floats, Ints

#: Blocks of neighbouring rows in each fold.
_PER_FOLD: Final = 4
#: Standard errors by which a memory must be better than the calibrated rod.
MEMORY_ERRORS: Final = 2.5
#: The same over its own limit without memory. Missing elasticities, of 12 benches: 0.4 at most;
#: hysteresis, creep and relaxation: 1.6 at least.
LIMIT_ERRORS: Final = 1.0
#: Errors below this count as none, m.
_NOTHING: Final = 1e-8


@dataclass(frozen=True)
class Gain:
    """Decrease of the error from one model to a more complex one on the same rows.

    Attributes
    ----------
    mean : float
        Mean over blocks of the natural logarithm of the ratio of their mean errors: positive if the
        more complex model is better.
    standard_error : float
        Standard error of that mean.
    """

    mean: float
    standard_error: float

    def exceeds(self, errors: float) -> bool:
        """Whether the more complex model is better by more than some standard errors."""
        return self.mean > errors * self.standard_error


def blocks_of(part: Ints, used: Bools) -> Ints:
    """Divide each fold into four blocks of neighbouring rows.

    Parameters
    ----------
    part : ndarray of int (K,)
        Fold of each row, from 0.
    used : ndarray of bool (K,)
        Rows that count.

    Returns
    -------
    ndarray of int (K,)
        Block of each row, from 0; -1 for rows that do not count.
    """
    block = np.full(len(part), -1, dtype=np.int64)
    for fold in np.unique(part[used]).tolist():
        rows = np.flatnonzero(used & (part == fold))
        block[rows] = fold * _PER_FOLD + np.arange(len(rows)) * _PER_FOLD // len(rows)
    return block


def gain(simple: Floats, complex_: Floats, block: Ints) -> Gain:
    """Compare the errors (K,) of two models over blocks (K,) of the rows that have both."""
    both = np.isfinite(simple - complex_) & (block >= 0)
    _, label = np.unique(block[both], return_inverse=True)
    count = np.bincount(label)
    if len(count) < 2:
        return Gain(0.0, math.inf)
    means = (np.bincount(label, each[both]) / count for each in (simple, complex_))
    before, after = (np.log(np.maximum(mean, _NOTHING)) for mean in means)
    ratio = before - after
    return Gain(float(ratio.mean()), float(ratio.std(ddof=1)) / math.sqrt(len(ratio)))


def choose(errors: Sequence[Floats], block: Ints) -> int:
    """Choose the simplest model that is within one standard error of the least mean error.

    Parameters
    ----------
    errors : sequence of ndarray (K,)
        Left-out errors of P models, in the order of complexity.
    block : ndarray of int (K,)
        Block of each row, by `blocks_of`.

    Returns
    -------
    int
        Index of the chosen model.
    """
    best = int(np.argmin([np.nanmean(each) for each in errors]))
    for simpler in range(best):
        if not gain(errors[simpler], errors[best], block).exceeds(1.0):
            return simpler
    return best
