"""Parameters of a robot from measured tips: fits, their statistics, their figures."""

from bowstring.calibration.fitting import (
    CrossValidation,
    Estimate,
    Fit,
    cross_validate,
    fit,
    hold_out,
)
from bowstring.calibration.observations import Data, Score, score
from bowstring.calibration.table_fit import Calibration, calibrate

__all__ = [
    "Calibration",
    "CrossValidation",
    "Data",
    "Estimate",
    "Fit",
    "Score",
    "calibrate",
    "cross_validate",
    "fit",
    "hold_out",
    "score",
]
