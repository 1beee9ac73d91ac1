"""Tip errors between two models: statistics over points and by axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from bowstring.display import short_repr

if TYPE_CHECKING:
    from bowstring.schemas import study as schema

__all__ = ["Comparison", "known_max", "known_mean"]

Array = NDArray[np.float64]


@short_repr
@dataclass(frozen=True)
class Comparison:
    """Tips by constant curvature compared with those of the rod or a measurement."""

    name: str
    """Name of the model."""
    against: str
    """Name of the reference, such as "statics" or "measurement"."""
    length: float
    """Length of the robot, m; errors in percent refer to it."""
    tip_position: Array
    """Tips by constant curvature (n, 3), m; NaN where there is none."""
    difference: Array
    """Tip by constant curvature minus reference tip (n, 3), m."""

    @cached_property
    def error(self) -> Array:
        """Euclidean tip error (n,), m."""
        return np.asarray(np.linalg.norm(self.difference, axis=-1))

    @property
    def n(self) -> int:
        """Number of points with both tips."""
        return int(np.isfinite(self.error).sum())

    @property
    def mean(self) -> float:
        """Mean error, m."""
        return known_mean(self.error)

    @property
    def maximum(self) -> float:
        """Largest error, m."""
        return known_max(self.error)

    @property
    def rms(self) -> float:
        """Root mean square over points (not over coordinates), m."""
        return math.sqrt(known_mean(self.error**2))

    @property
    def mean_by_axis(self) -> Array:
        """Mean absolute error along x, y and z, m."""
        return np.array([known_mean(along) for along in self._by_axis])

    @property
    def max_by_axis(self) -> Array:
        """Largest absolute error along x, y and z, m."""
        return np.array([known_max(along) for along in self._by_axis])

    @property
    def _by_axis(self) -> Array:
        """Absolute errors (3, n) of points with both tips."""
        return np.asarray(np.abs(self.difference[np.isfinite(self.error)]).T)

    def to_dict(self) -> schema.Comparison:
        """Return the statistics in mm and percent."""
        return {
            "name": cast("schema.ModelName", self.name),
            "against": cast("schema.Reference", self.against),
            "n": self.n,
            "mean_mm": self.mean * 1e3,
            "max_mm": self.maximum * 1e3,
            "rms_mm": self.rms * 1e3,
            "mean_percent": self.mean / self.length * 100.0,
            "mean_by_axis_mm": (self.mean_by_axis * 1e3).tolist(),
        }


def known_mean(values: Array) -> float:
    """Mean of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def known_max(values: Array) -> float:
    """Largest of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else math.nan
