"""Tip errors between two models: statistics over points and by axis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal, cast

import numpy as np

from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.results import Key, Result

ModelName = Literal[
    "cc_from_lengths",
    "cc_from_force",
    "cc_from_lengths_chord",
    "cc_from_force_arm",
    "constant_curvature_fit",
    "linear_curvature_fit",
    "quadratic_curvature_fit",
    "constant_curvature_from_loads",
    "linear_curvature_from_loads",
    "quadratic_curvature_from_loads",
    "cc_calibrated",
    "rod",
    "rod_calibrated",
]
Reference = Literal["statics", "dynamics", "fe", "measurement"]


@short_repr
@dataclass(frozen=True)
class Comparison(Result):
    """Tip error of a model against a reference: Euclidean distances, over points."""

    name: str
    """Name of the model."""
    against: str
    """Name of the reference, such as "statics" or "measurement"."""
    length: float
    """Length of the robot, m; errors in percent refer to it."""
    tip_position: Floats
    """Tips by constant curvature (n, 3), m; NaN where there is none."""
    difference: Floats
    """Tip by constant curvature minus reference tip (n, 3), m."""

    @cached_property
    def error(self) -> Floats:
        """Euclidean tip error (n,), m."""
        return np.asarray(np.linalg.norm(self.difference, axis=-1))

    @property
    def model(self) -> Annotated[ModelName, Key("name")]:
        """Model: ``cc_from_lengths``, ``cc_from_force``, and corrected ``cc_from_lengths_chord``,
        ``cc_from_force_arm``; against measurements also ``cc_calibrated``, ``rod``,
        ``rod_calibrated``. They come in this order. Last, against statics, come polynomials of arc
        length as curvature: fitted to the shape by statics (``linear_curvature_fit`` and so on), or
        predicted from tensions and weight (``linear_curvature_from_loads``) where that differs from
        the linear law."""
        return cast("ModelName", self.name)

    @property
    def reference(self) -> Annotated[Reference, Key("against")]:
        """Reference: ``statics``; ``dynamics``, at the times at which the rising tension passes the
        loads of the sweep; ``fe``, finite elements; ``measurement``. They come in this order."""
        return cast("Reference", self.against)

    @property
    def n(self) -> Annotated[int, Key()]:
        """Number of points with both tips."""
        return int(np.isfinite(self.error).sum())

    @property
    def mean(self) -> Annotated[float, Key("mean_mm")]:
        """Mean error, m; NaN without a point."""
        return known_mean(self.error)

    @property
    def maximum(self) -> Annotated[float, Key("max_mm")]:
        """Largest error, m; NaN without a point."""
        return known_max(self.error)

    @property
    def rms(self) -> Annotated[float, Key("rms_mm")]:
        """Root mean square over points (not over coordinates), m; NaN without a point."""
        return math.sqrt(known_mean(self.error**2))

    @property
    def mean_share(self) -> Annotated[float, Key("mean_percent")]:
        """Mean error as a share of the length; NaN without a point."""
        return self.mean / self.length

    @property
    def mean_by_axis(self) -> Annotated[Floats, Key("mean_by_axis_mm")]:
        """Mean absolute error along x, y and z (3,), m; NaN without a point."""
        return np.array([known_mean(along) for along in self._by_axis])

    @property
    def max_by_axis(self) -> Floats:
        """Largest absolute error along x, y and z (3,), m; NaN without a point."""
        return np.array([known_max(along) for along in self._by_axis])

    @property
    def _by_axis(self) -> Floats:
        """Absolute errors (3, n) of points with both tips."""
        return np.asarray(np.abs(self.difference[np.isfinite(self.error)]).T)


def known_mean(values: Floats) -> float:
    """Mean of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def known_max(values: Floats) -> float:
    """Largest of the finite values; NaN without any."""
    known = values[np.isfinite(values)]
    return float(known.max()) if known.size else math.nan
