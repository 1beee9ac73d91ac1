"""Metrics of the suite: a statistic of the errors of one observable, with its unit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from bowstring.aliases import Floats

__all__ = ["METRICS", "Metric", "Observable"]

Observable = Literal["tip", "markers", "bend", "shape"]

_MM: Final = ("mm", 1e-3)
_DEG: Final = ("deg", float(np.pi / 180.0))
_PERCENT: Final = ("% of length", 0.01)


@dataclass(frozen=True)
class Metric:
    """Statistic of the errors of one observable over rows.

    Attributes
    ----------
    observable : {"tip", "markers", "bend", "shape"}
        Measured quantity: point at the tip, all points (markers), bend angle, or the whole shape
        over its own length.
    label : str
        Name for tables.
    unit : str
    per_unit : float
        The unit in SI.
    statistic : callable
        Maps errors (K, ...) in SI to one number.
    """

    observable: Observable
    label: str
    unit: str
    per_unit: float
    statistic: Callable[[Floats], Any]

    def __call__(self, errors: Floats) -> float:
        """Value in `unit` of errors (K, ...) in SI, NaN where a model has no solution."""
        rows = errors.reshape(len(errors), -1)
        known = rows[np.isfinite(rows).all(axis=1)].reshape(-1, *errors.shape[1:])
        return float(self.statistic(known) / self.per_unit) if len(known) else float("nan")


def _rms(errors: Floats) -> Any:
    return np.sqrt(np.mean(errors**2))


def _mean_of_rms(errors: Floats) -> Any:
    return np.sqrt(np.mean(errors**2, axis=-1)).mean()


def _mean_of_last(errors: Floats) -> Any:
    return errors[..., -1].mean()


METRICS: Final[dict[str, Metric]] = {
    "tip_rmse": Metric("tip", "tip RMSE", *_MM, _rms),
    "tip_mean": Metric("tip", "mean tip error", *_MM, np.mean),
    "tip_median": Metric("tip", "median tip error", *_MM, np.median),
    "tip_max": Metric("tip", "largest tip error", *_MM, np.max),
    "marker_mean": Metric("markers", "mean marker error", *_MM, np.mean),
    "marker_rmse": Metric("markers", "marker RMSE", *_MM, _rms),
    "bend_rmse": Metric("bend", "bend RMSE", *_DEG, _rms),
    "bend_mean": Metric("bend", "mean bend error", *_DEG, np.mean),
    "shape_rms": Metric("shape", "shape RMS", *_PERCENT, _mean_of_rms),
    "shape_tip": Metric("shape", "shape tip", *_PERCENT, _mean_of_last),
}
"""Metrics by the name that a protocol gives."""
