"""JSON of the command fit."""

from __future__ import annotations

from typing import Annotated

from bowstring.calibration.model_comparison import ComparisonInterrupted, ModelComparison
from bowstring.calibration.orientation_fit import OrientationFit
from bowstring.calibration.residual_comparison import ResidualStudy
from bowstring.calibration.table_fit import Calibration
from bowstring.schemas.basic import InFolder, OfRobot, about
from bowstring.schemas.results import beside


@beside(Calibration)
class Fit(OfRobot, InFolder):
    """Output of `bowstring fit`."""

    residual: Annotated[ResidualStudy | None, about("Residual; `null` without `--residual`.")]
    comparison: Annotated[
        ModelComparison | None, about("Comparison of models; `null` without `--compare`.")
    ]


@beside(ComparisonInterrupted)
class StoppedComparison(OfRobot, InFolder):
    """Output of `bowstring fit --compare` that was stopped by Ctrl-C; there is no fit."""


@beside(OrientationFit)
class FitOfAngles(OfRobot):
    """Output of `bowstring fit` of a table with angles only."""
