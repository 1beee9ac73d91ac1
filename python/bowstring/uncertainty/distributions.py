"""Distributions of one number: normal, truncated normal, log-normal, uniform and triangular.

All numbers are in SI. ``ppf`` is the quantile function, the inverse of the cumulative distribution
function ``cdf``; it is how samples of a unit cube become samples of a robot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.validation import number, numbers, shown

#: Least share of a normal distribution that a truncation may keep.
_LEAST_SHARE: Final = 0.01


class Distribution(Protocol):
    """Distribution of one number."""

    @property
    def mean(self) -> float:
        """Mean."""

    @property
    def sd(self) -> float:
        """Standard deviation."""

    @property
    def support(self) -> tuple[float, float]:
        """Least and largest value; infinite if it has none."""

    def ppf(self, u: ArrayLike) -> Floats:
        """Quantiles at the probabilities `u`."""

    def cdf(self, x: ArrayLike) -> Floats:
        """Probabilities of a value up to `x`."""


def _ndtri(u: ArrayLike) -> Floats:
    from scipy.special import ndtri

    return np.asarray(ndtri(u))


def _ndtr(z: ArrayLike) -> Floats:
    from scipy.special import ndtr

    return np.asarray(ndtr(z))


def _set(owner: object, name: str, value: float) -> None:
    object.__setattr__(owner, name, value)  # checked values of a frozen dataclass


def _finite(name: str, value: Any) -> float:
    right = isinstance(value, (float, int, np.floating, np.integer)) and not isinstance(value, bool)
    if not right or not math.isfinite(value):
        raise InputError.of(name, shown(value), "a finite number")
    return float(value)


def _check_order(names: tuple[str, str], low: float, high: float) -> None:
    if not low < high:
        raise InputError(f"{names[0]} is {low:g} and {names[1]} {high:g}, it must be less")


@dataclass(frozen=True)
class Normal:
    """Normal distribution.

    Parameters
    ----------
    mean, sd : float
        Mean and standard deviation.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        _set(self, "mean", _finite("mean", self.mean))
        _set(self, "sd", number("sd", self.sd))

    @property
    def support(self) -> tuple[float, float]:
        """Least and largest value: infinite."""
        return -math.inf, math.inf

    def ppf(self, u: ArrayLike) -> Floats:
        """Quantiles at the probabilities `u`."""
        return self.mean + self.sd * _ndtri(u)

    def cdf(self, x: ArrayLike) -> Floats:
        """Probabilities of a value up to `x`."""
        return _ndtr((np.asarray(x) - self.mean) / self.sd)


@dataclass(frozen=True)
class TruncatedNormal:
    """Normal distribution between two bounds.

    Parameters
    ----------
    normal : Normal
        The distribution before the truncation.
    low, high : float
        Bounds; one of them may be infinite.
    """

    normal: Normal
    low: float = -math.inf
    high: float = math.inf

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            bound = getattr(self, name)
            _set(self, name, bound if bound in (-math.inf, math.inf) else _finite(name, bound))
        _check_order(("low", "high"), self.low, self.high)
        below, above = self._ends
        if above - below < _LEAST_SHARE:
            raise InputError(
                f"only {above - below:.2g} of the normal distribution lies between {self.low:g} "
                f"and {self.high:g}, at least {_LEAST_SHARE:g} must; give a mean nearer to them"
            )

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """Probabilities of the normal distribution at both bounds."""
        below, above = self.normal.cdf([self.low, self.high])
        return float(below), float(above)

    @cached_property
    def _moments(self) -> tuple[float, float]:
        from scipy.stats import truncnorm

        low, high = ((end - self.normal.mean) / self.normal.sd for end in (self.low, self.high))
        mean, variance = truncnorm.stats(low, high, moments="mv")
        return (
            self.normal.mean + self.normal.sd * float(mean),
            self.normal.sd * math.sqrt(float(variance)),
        )

    @property
    def mean(self) -> float:
        """Mean after the truncation."""
        return self._moments[0]

    @property
    def sd(self) -> float:
        """Standard deviation after the truncation."""
        return self._moments[1]

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    def ppf(self, u: ArrayLike) -> Floats:
        """Quantiles at the probabilities `u`."""
        below, above = self._ends
        x = self.normal.ppf(below + np.asarray(u) * (above - below))
        return np.clip(x, self.low, self.high)  # rounding may leave the bounds

    def cdf(self, x: ArrayLike) -> Floats:
        """Probabilities of a value up to `x`."""
        below, above = self._ends
        return np.clip((self.normal.cdf(x) - below) / (above - below), 0.0, 1.0)


@dataclass(frozen=True)
class LogNormal:
    """Log-normal distribution, of a positive number whose logarithm is normal.

    Parameters
    ----------
    mean, sd : float
        Mean and standard deviation of the number itself, not of its logarithm.
    """

    mean: float
    sd: float

    def __post_init__(self) -> None:
        _set(self, "mean", number("mean", self.mean))
        _set(self, "sd", number("sd", self.sd))

    @cached_property
    def _log(self) -> Normal:
        """Distribution of the logarithm."""
        variance = math.log1p((self.sd / self.mean) ** 2)
        return Normal(math.log(self.mean) - variance / 2.0, math.sqrt(variance))

    @property
    def support(self) -> tuple[float, float]:
        """Zero, and no largest value."""
        return 0.0, math.inf

    def ppf(self, u: ArrayLike) -> Floats:
        """Quantiles at the probabilities `u`."""
        return np.exp(self._log.ppf(u))

    def cdf(self, x: ArrayLike) -> Floats:
        """Probabilities of a value up to `x`."""
        with np.errstate(divide="ignore"):
            return self._log.cdf(np.log(np.maximum(x, 0.0)))


@dataclass(frozen=True)
class Uniform:
    """Uniform distribution.

    Parameters
    ----------
    low, high : float
        Bounds.
    """

    low: float
    high: float

    def __post_init__(self) -> None:
        _set(self, "low", _finite("low", self.low))
        _set(self, "high", _finite("high", self.high))
        _check_order(("low", "high"), self.low, self.high)

    @property
    def mean(self) -> float:
        """Mean."""
        return 0.5 * (self.low + self.high)

    @property
    def sd(self) -> float:
        """Standard deviation."""
        return (self.high - self.low) / math.sqrt(12.0)

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    def ppf(self, u: ArrayLike) -> Floats:
        """Quantiles at the probabilities `u`."""
        return np.asarray(self.low + (self.high - self.low) * np.asarray(u))

    def cdf(self, x: ArrayLike) -> Floats:
        """Probabilities of a value up to `x`."""
        return np.clip((np.asarray(x) - self.low) / (self.high - self.low), 0.0, 1.0)


@dataclass(frozen=True)
class Triangular:
    """Triangular distribution.

    Parameters
    ----------
    low, mode, high : float
        Lower bound, most probable value and upper bound.
    """

    low: float
    mode: float
    high: float

    def __post_init__(self) -> None:
        for name in ("low", "mode", "high"):
            _set(self, name, _finite(name, getattr(self, name)))
        _check_order(("low", "high"), self.low, self.high)
        if not self.low <= self.mode <= self.high:
            raise InputError(f"mode is {self.mode:g}, it must lie in {self.low:g} to {self.high:g}")

    @property
    def mean(self) -> float:
        """Mean."""
        return (self.low + self.mode + self.high) / 3.0

    @property
    def sd(self) -> float:
        """Standard deviation."""
        a, c, b = self.low, self.mode, self.high
        return math.sqrt(((b - a) ** 2 - (b - c) * (c - a)) / 18.0)

    @property
    def support(self) -> tuple[float, float]:
        """The bounds."""
        return self.low, self.high

    def ppf(self, u: ArrayLike) -> Floats:
        """Quantiles at the probabilities `u`."""
        u, width = np.asarray(u), self.high - self.low
        rising = self.low + np.sqrt(u * width * (self.mode - self.low))
        falling = self.high - np.sqrt((1.0 - u) * width * (self.high - self.mode))
        return np.where(u * width <= self.mode - self.low, rising, falling)

    def cdf(self, x: ArrayLike) -> Floats:
        """Probabilities of a value up to `x`."""
        x, width = np.clip(x, self.low, self.high), self.high - self.low
        with np.errstate(divide="ignore", invalid="ignore"):
            rising = (x - self.low) ** 2 / (width * (self.mode - self.low))
            falling = 1.0 - (self.high - x) ** 2 / (width * (self.high - self.mode))
        return np.asarray(np.where((x <= self.mode) & (self.mode > self.low), rising, falling))


@dataclass(frozen=True, eq=False)
class CorrelatedNormal:
    """Joint normal distribution of several numbers, such as the parameters of a calibration.

    Parameters
    ----------
    mean : array_like (k,)
        Means.
    covariance : array_like (k, k)
        Covariance, which may be singular.
    """

    mean: Floats
    covariance: Floats

    def __post_init__(self) -> None:
        count = np.size(self.mean)
        mean = numbers("mean", self.mean, (count,))
        covariance = numbers("covariance", self.covariance, (count, count))
        sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if not (sd > 0.0).all():
            raise InputError(
                "covariance has a variance that is not positive; leave that number out"
            )
        correlation = covariance / np.outer(sd, sd)
        least = np.linalg.eigvalsh(correlation)[0]
        if not np.allclose(correlation, correlation.T, atol=1e-9) or least < -1e-9 * count:
            raise InputError("covariance must be symmetric and have no negative eigenvalue")
        for name, array in (("mean", mean), ("covariance", covariance)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def sd(self) -> Floats:
        """Standard deviations (k,)."""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def _factor(self) -> Floats:
        """Factor F (k, k) with F F^T = covariance; a singular covariance has one too."""
        sd = self.sd
        values, vectors = np.linalg.eigh(self.covariance / np.outer(sd, sd))
        return np.asarray(sd[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))

    def ppf(self, u: ArrayLike) -> Floats:
        """Samples (n, k) of independent probabilities `u` (n, k)."""
        return np.asarray(self.mean + _ndtri(u) @ self._factor.T)
