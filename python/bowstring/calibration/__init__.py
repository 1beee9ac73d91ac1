"""Calibration of a robot's parameters from measured tips: fits, statistics, figures."""

from bowstring.calibration.cross_validation import CrossValidation, cross_validate, hold_out
from bowstring.calibration.error_parts import ErrorParts
from bowstring.calibration.filtering import Filtered, SlowBias, filtered, fit_slow_bias
from bowstring.calibration.fitting import Estimate, Fit, fit
from bowstring.calibration.model_comparison import (
    ComparisonInterrupted,
    JudgedModel,
    ModelComparison,
    compare_models,
)
from bowstring.calibration.observations import Data, PointScore, Score, score
from bowstring.calibration.orientation_fit import AngleScore, OrientationFit, fit_orientation
from bowstring.calibration.prediction import Predicted, predict_with_interval
from bowstring.calibration.priors import Prior, default_priors
from bowstring.calibration.residual import Corrected, Hyperparameters, Residual, fit_residual
from bowstring.calibration.residual_comparison import Compared, ResidualStudy, study_residual
from bowstring.calibration.residual_file import read_residual
from bowstring.calibration.residual_inverse import CorrectedInverse, inverse_with_residual
from bowstring.calibration.table_fit import Calibration, calibrate

__all__ = [
    "AngleScore",
    "Calibration",
    "Compared",
    "ComparisonInterrupted",
    "Corrected",
    "CorrectedInverse",
    "CrossValidation",
    "Data",
    "ErrorParts",
    "Estimate",
    "Filtered",
    "Fit",
    "Hyperparameters",
    "JudgedModel",
    "ModelComparison",
    "OrientationFit",
    "PointScore",
    "Predicted",
    "Prior",
    "Residual",
    "ResidualStudy",
    "Score",
    "SlowBias",
    "calibrate",
    "compare_models",
    "cross_validate",
    "default_priors",
    "filtered",
    "fit",
    "fit_orientation",
    "fit_residual",
    "fit_slow_bias",
    "hold_out",
    "inverse_with_residual",
    "predict_with_interval",
    "read_residual",
    "score",
    "study_residual",
]
