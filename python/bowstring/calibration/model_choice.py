"""Choice between models by their errors on left-out rows: one-standard-error rule.

K is the number of rows, P that of models. Errors are distances in m, NaN where a row has none.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

__all__ = ["MEMORY_ERRORS", "Difference", "blocks_of", "choose", "difference"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Blocks of neighbouring rows in each fold.
_PER_FOLD: Final = 4
#: Standard errors by which a memory must be better than the calibrated rod.
MEMORY_ERRORS: Final = 3.0
#: Difference of mean errors that is numerical, m.
_NOTHING: Final = 1e-8


@dataclass(frozen=True)
class Difference:
    """Difference of the mean errors of two models on the same rows.

    Attributes
    ----------
    mean : float
        Mean error of the simpler model less that of the more complex one, m: positive if the more
        complex one is better.
    standard_error : float
        Standard error of the mean over blocks of neighbouring rows, m.
    """

    mean: float
    standard_error: float

    def exceeds(self, errors: float) -> bool:
        """Whether the more complex model is better by more than some standard errors."""
        return self.mean > max(errors * self.standard_error, _NOTHING)


def blocks_of(part: Ints, used: NDArray[np.bool_]) -> Ints:
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


def difference(simple: Floats, complex_: Floats, block: Ints) -> Difference:
    """Compare the errors (K,) of two models, with the standard error over blocks (K,)."""
    both = np.isfinite(simple - complex_) & (block >= 0)
    gain, label = (simple - complex_)[both], np.unique(block[both], return_inverse=True)[1]
    if not len(gain):
        return Difference(-math.inf, math.inf)
    mean, count = float(gain.mean()), int(label.max()) + 1
    if count < 2:
        return Difference(mean, math.inf)
    # a ratio of sums, as blocks have different numbers of rows
    left = np.bincount(label, gain - mean)
    scatter = math.sqrt(count / (count - 1) * float(left @ left)) / len(gain)
    return Difference(mean, scatter)


def choose(errors: Sequence[Floats], block: Ints) -> int:
    """Choose the simplest model that is within one standard error of the best.

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
        if not difference(errors[simpler], errors[best], block).exceeds(1.0):
            return simpler
    return best
