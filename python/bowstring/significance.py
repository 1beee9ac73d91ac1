"""Chi-square and F tests, and the significance level of each decision by one."""

from __future__ import annotations

import math
from typing import Any, Final

from scipy import special

NORMAL: Final = 1.959964
"""Standard deviations on either side of a 95 % interval by a known standard deviation."""

NOISE: Final = 0.005
"""P-value below which residuals are not noise."""
MIRROR: Final = 1e-4
"""P-value below which a mirror image fits better than by noise; low, as such a frame is refused."""
EXTRA_LOAD: Final = 1e-6
"""P-value below which gravity explains the data; low, as errors of a model are not normal."""


def student(dof: Any) -> Any:
    """Standard errors on either side of a 95 % interval by a standard error of `dof` degrees of
    freedom, a number or an array."""
    return special.stdtrit(dof, 0.975)


def chi_square_p(square: float, dof: int) -> float:
    """P-value of a sum of squares over their variances; NaN without degrees of freedom."""
    return float(special.chdtrc(dof, square)) if dof > 0 else math.nan


def variance_ratio_p(ratio: float, dof: int, noise_dof: int) -> float:
    """P-value of a ratio of two variances (F test); `noise_dof` belong to the denominator."""
    return float(special.fdtrc(dof, noise_dof, ratio))


def variance_ratio_limit(level: float, dof: int, noise_dof: int) -> float:
    """Ratio of two variances whose p-value is `level`."""
    return float(special.fdtri(dof, noise_dof, 1.0 - level))


def explained_p(before: float, after: float, more: int, dof: int) -> float:
    """P-value of a lower sum of squares with more parameters (F test of nested models).

    `dof` are the degrees of freedom of the larger model.
    """
    return variance_ratio_p((before - after) / more / max(after / dof, 1e-300), more, dof)
