"""Designs of experiments: Sobol' sequences, Saltelli's design, Morris' trajectories.

A design has a number of rows (``len``), and ``block(start, stop)`` gives the samples of some of
them, always the same. Any part can therefore be evaluated anywhere and again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.optional import load_extra
from bowstring.uncertainty.joint import LEAST_PROBABILITY, Distributions
from bowstring.validation import is_whole, shown, whole

_MOST_ROWS: Final = 10**9
_MOST_POINTS: Final = 2**26
#: Share of each distribution that the levels of Morris' trajectories span, in the middle.
_SPAN: Final = 0.99
_LEVELS: Final = 4


class Design(Protocol):
    """Design of experiments, of one of the kinds below."""

    @property
    def distributions(self) -> Distributions:
        """Distributions of the numbers."""

    def __len__(self) -> int:
        """Number of rows."""

    def block(self, start: int, stop: int) -> Floats:
        """Samples (stop - start, k) of rows in SI."""


def _sobol_points(count: int, dimension: int, seed: int) -> Floats:
    """Points (count, dimension) of a scrambled Sobol' sequence, inside the open unit cube."""
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, seed=np.random.default_rng(seed)).random(count)
    # Half a step of 30 bits: zero, whose quantile may be infinite, can be among the points.
    return np.asarray(points + LEAST_PROBABILITY)


def _check(design: Any) -> None:
    if not isinstance(design.distributions, Distributions):
        raise InputError.of("distributions", shown(design.distributions), "Distributions")
    whole("seed", design.seed, 0, 2**63 - 1)


def _check_count(count: object) -> None:
    if not is_whole(count) or not 2 <= count <= _MOST_POINTS or count & (count - 1):  # type: ignore[operator]
        raise InputError.of("count", shown(count), "a power of two from 2 to 2^26, such as 4096")


def _check_rows(rows: int, cure: str) -> None:
    if rows > _MOST_ROWS:
        raise InputError(f"the design has {rows} rows, at most {_MOST_ROWS:.0e} can be; {cure}")


@short_repr
@dataclass(frozen=True, eq=False)
class SobolSample:
    """Scrambled Sobol' sequence in the joint distribution, for `summarise`.

    Parameters
    ----------
    distributions : Distributions
        Joint distribution.
    count : int
        Number of samples n, a power of two.
    seed : int
        Seed of the scrambling.
    """

    distributions: Distributions
    count: int
    seed: int = 0

    def __post_init__(self) -> None:
        _check(self)
        _check_count(self.count)

    def __len__(self) -> int:
        return self.count

    @cached_property
    def _values(self) -> Floats:
        points = _sobol_points(self.count, len(self.distributions), self.seed)
        return self.distributions.ppf(points)

    def block(self, start: int, stop: int) -> Floats:
        """Samples (stop - start, k) of rows in SI."""
        return self._values[start:stop]


@short_repr
@dataclass(frozen=True, eq=False)
class SaltelliDesign:
    """Saltelli's design for Sobol' indices (theory Eq. 8.5).

    For each of n base points the rows are A, B, then A with each factor in turn from B, then, for
    indices of second order, B with each factor in turn from A. A power of two of finished base
    points is a smaller design of the same kind.

    Parameters
    ----------
    distributions : Distributions
        Joint distribution with d independent factors.
    count : int
        Number of base points n, a power of two; the design has n (d + 2) rows.
    seed : int
        Seed of the scrambling.
    second_order : bool
        Whether indices of second order are wanted, with n (2 d + 2) rows.
    """

    distributions: Distributions
    count: int
    seed: int = 0
    second_order: bool = False

    def __post_init__(self) -> None:
        _check(self)
        _check_count(self.count)
        _check_rows(len(self), "give fewer base points")

    def __len__(self) -> int:
        return self.count * self.width

    @property
    def width(self) -> int:
        """Number of rows of a base point."""
        return len(self._from_b)

    @property
    def rows_of_sample(self) -> slice:
        """Rows of A, which are a sample of the joint distribution."""
        return slice(0, None, self.width)

    @cached_property
    def _from_b(self) -> Bools:
        """Columns that come from B, by row of a base point (width, k)."""
        factor_of = self.distributions.factor_of
        swapped = factor_of == np.arange(len(self.distributions.factors))[:, None]
        plain = np.repeat([[False], [True]], len(factor_of), axis=1)
        return np.vstack([plain, swapped, ~swapped] if self.second_order else [plain, swapped])

    @cached_property
    def _ends(self) -> tuple[Floats, Floats]:
        """Samples A and B (n, k)."""
        columns = len(self.distributions)
        points = _sobol_points(self.count, 2 * columns, self.seed)
        ppf = self.distributions.ppf
        return ppf(points[:, :columns]), ppf(points[:, columns:])

    def block(self, start: int, stop: int) -> Floats:
        """Samples (stop - start, k) of rows in SI."""
        base, row = np.divmod(np.arange(start, min(stop, len(self))), self.width)
        a, b = self._ends
        return np.where(self._from_b[row], b[base], a[base])


@short_repr
@dataclass(frozen=True, eq=False)
class MorrisDesign:
    """Morris' trajectories: from point to point one factor changes (theory Eq. 8.8).

    The four levels of a factor are quantiles that span the middle 99 % of its distribution. Needs
    the extra ``uncertainty``.

    Parameters
    ----------
    distributions : Distributions
        Joint distribution with d independent factors.
    trajectories : int
        Number of trajectories r, of d + 1 rows each.
    seed : int
        Seed of the trajectories.
    """

    distributions: Distributions
    trajectories: int = 20
    seed: int = 0

    def __post_init__(self) -> None:
        _check(self)
        whole("trajectories", self.trajectories, 2, 10**6)
        _check_rows(len(self), "give fewer trajectories")
        load_extra("uncertainty")

    def __len__(self) -> int:
        return self.trajectories * (len(self.distributions.factors) + 1)

    @cached_property
    def problem(self) -> dict[str, Any]:
        """Description of the problem for SALib."""
        factors = [str(j) for j in self.distributions.factor_of]
        return {
            "num_vars": len(factors),
            "names": [str(j) for j in range(len(factors))],
            "bounds": [[0.0, 1.0]] * len(factors),
            "groups": factors,
        }

    @property
    def levels(self) -> int:
        """Number of levels of a factor."""
        return _LEVELS

    @cached_property
    def points(self) -> Floats:
        """Points of the trajectories in the unit cube, (rows, k)."""
        from SALib.sample import morris

        seed = np.random.default_rng(self.seed)
        return np.asarray(morris.sample(self.problem, self.trajectories, _LEVELS, seed=seed))

    def block(self, start: int, stop: int) -> Floats:
        """Samples (stop - start, k) of rows in SI."""
        u = 0.5 + _SPAN * (self.points[start:stop] - 0.5)
        return self.distributions.ppf(u)


def evaluate(
    model: Callable[[Floats], Any],
    design: Design,
    *,
    rows: int = 65_536,
    progress: Callable[[float], None] | None = None,
) -> Floats:
    """Evaluate a model at all rows of a design, block by block.

    Parameters
    ----------
    model : callable
        Function of samples (n, k) in SI, which returns outputs (n,) or (n, m); NaN where it has no
        result, such as no equilibrium.
    design : SobolSample, SaltelliDesign or MorrisDesign
        Design whose rows are evaluated.
    rows : int
        Rows of a block.
    progress : callable, optional
        Progress callback, called with the finished share from 0 to 1.

    Returns
    -------
    ndarray (rows,) or (rows, m)
        Outputs of all rows.

    Raises
    ------
    InputError
        If the outputs of a block have another shape.
    """
    whole("rows", rows, 1, _MOST_ROWS)
    outputs: Floats | None = None
    for start in range(0, len(design), rows):
        stop = min(start + rows, len(design))
        found = np.asarray(model(design.block(start, stop)), dtype=float)
        if outputs is None and found.ndim in (1, 2):
            outputs = np.empty((len(design), *found.shape[1:]))
        if outputs is None or found.shape != (stop - start, *outputs.shape[1:]):
            raise InputError(
                f"model returned an array of shape {found.shape} for {stop - start} samples, it "
                "must return one number or one row of m numbers for each"
            )
        outputs[start:stop] = found
        if progress is not None:
            progress(stop / len(design))
    assert outputs is not None
    return outputs
