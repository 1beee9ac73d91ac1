"""JSON of the command fit, and of the calibration in a study."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.schemas.basic import (
    Found,
    InFolder,
    Object,
    OfRobot,
    OrNull,
    Source,
    VectorOrNull,
    about,
)


class Estimate(Object):
    """A fitted parameter."""

    name: Annotated[str, about("Name.")]
    unit: Annotated[str, about("Unit of the numbers below.")]
    value: Annotated[float, about("Estimate.", "`unit`")]
    standard_error: Annotated[
        OrNull,
        about(
            "Standard error; `null`, as are the bounds, if the parameter is not identifiable or "
            "the standard error as wide as its range.",
            "`unit`",
        ),
    ]
    low: Annotated[OrNull, about("Lower bound of the 95 % interval.", "`unit`")]
    high: Annotated[OrNull, about("Upper bound.", "`unit`")]
    start: Annotated[float, about("Value at which the fit begins.", "`unit`")]
    at_limit: Annotated[bool, about("Whether the estimate is at the end of its range.")]
    cut: Annotated[bool, about("Whether the interval ends at the end of the range.")]
    prior_mean: Annotated[OrNull, about("Mean of the prior; `null` without one.", "`unit`")]
    prior_sd: Annotated[OrNull, about("Standard deviation of the prior.", "`unit`")]


class CorrelatedPair(Object):
    """Two correlated parameters."""

    names: Annotated[list[str], about("The two names.")]
    correlation: Annotated[float, about("Correlation of their estimates.")]


class TipErrors(Object):
    """Tip errors over rows."""

    rmse_mm: Annotated[OrNull, about("Root mean square of the tip error.")]
    mean_mm: Annotated[OrNull, about("Mean tip error.")]
    max_mm: Annotated[OrNull, about("Largest tip error.")]
    rmse_centred_mm: Annotated[
        OrNull, about("Root mean square of the tip error without the mean error vector.")
    ]
    mean_centred_mm: Annotated[OrNull, about("Mean tip error without the mean error vector.")]


class RowErrors(TipErrors):
    """Tip errors and their number of rows."""

    rows: Annotated[int, about("Number of rows.")]


class HoldoutValidation(RowErrors):
    """Validation with rows that were kept from the fit."""

    kind: Annotated[Literal["holdout"], about("Kind of validation.")]
    rows_without_solution: Annotated[
        int, about("Rows without a solution of the calibrated model; they count in no number.")
    ]


class Fold(RowErrors):
    """A part of a cross-validation."""

    left_out: Annotated[str, about("What this part leaves out of the fit and predicts.")]


class FoldsValidation(RowErrors):
    """Cross-validation: errors over all parts."""

    kind: Annotated[Literal["folds"], about("Kind of validation.")]
    rows_without_solution: Annotated[
        int, about("Rows without a solution of the calibrated model; they count in no number.")
    ]
    converged: Annotated[bool, about("Whether all fits converged.")]
    folds: Annotated[list[Fold], about("Parts.")]


class OneRowAhead(RowErrors):
    """Errors of predictions that know the measured tips of the rows before, and the slow bias."""

    bias_spread_mm: Annotated[
        float, about("Standard deviation of a coordinate of the bias over a long time.")
    ]
    bias_duration: Annotated[
        float, about("Time in which the bias forgets its value, in s, or in rows without times.")
    ]
    noise_mm: Annotated[
        float, about("Standard deviation of a coordinate of what changes from row to row.")
    ]


class Intervals(Object):
    """95 % intervals of the coordinates, from the uncertainty of parameters and the scatter."""

    coverage_95: Annotated[OrNull, about("Share of the measured coordinates inside.")]
    half_width_mm: Annotated[OrNull, about("Median half-width.")]


class FileValidation(RowErrors):
    """Validation with another table."""

    kind: Annotated[Literal["file"], about("Kind of validation.")]
    rows_without_solution: Annotated[
        int, about("Rows without a solution of the calibrated model; they count in no number.")
    ]
    name: Annotated[str, about("Name of the table.")]
    source: Annotated[Source, about("Origin of its numbers.")]
    rows_left_out: Annotated[int, about("Rows left out; `bench check` has the reasons.")]
    sha256: Annotated[str | None, about("SHA-256 of the table.")]
    intervals: Annotated[
        Intervals | None,
        about("Open loop; `null` where a parameter is not identifiable."),
    ]
    filtered: Annotated[
        OneRowAhead | None,
        about("The same rows, each predicted from those before; `null` without `--filter`."),
    ]


Validation = HoldoutValidation | FoldsValidation | FileValidation


class FitTendonCheck(Object):
    """Comparison of the order of the tendons with the motion of the tip."""

    found: Annotated[
        Found,
        about("As in `bench check`."),
    ]
    alarm: Annotated[bool, about("Whether something is probably wrong.")]
    sentence: Annotated[str, about("Result as a sentence.")]


class FitData(Object):
    """The fitted table."""

    name: Annotated[str, about("Name of the table.")]
    source: Annotated[Source, about("Origin of its numbers.")]
    rows: Annotated[int, about("Number of rows, without those left out.")]
    rows_left_out: Annotated[int, about("Rows left out; `bench check` has the reasons.")]
    rows_without_tip: Annotated[int, about("Rows without a measured tip.")]
    sigma_mm: Annotated[
        OrNull, about("Median stated standard uncertainty of a coordinate; `null` if not stated.")
    ]
    sha256: Annotated[str | None, about("SHA-256 of the table.")]


class OutlierRow(Object):
    """A row far beyond the scatter of the others."""

    line: Annotated[int, about("Line of the table, from 1.")]
    distance_mm: Annotated[float, about("Tip error.")]


class PointErrors(Object):
    """Errors of one measured point over the fitted rows in which it is measured."""

    disk: Annotated[int, about("Number of its disk, from 1.")]
    station: Annotated[float, about("Arc length of the disk over the length of the robot.")]
    rows: Annotated[int, about("Fitted rows in which it is measured.")]
    rmse_mm: Annotated[OrNull, about("Root mean square of the distance to the predicted point.")]
    mean_mm: Annotated[OrNull, about("Mean distance.")]
    max_mm: Annotated[OrNull, about("Largest distance.")]
    rmse_centred_mm: Annotated[
        OrNull, about("Root mean square of the distance without the mean error vector.")
    ]
    mean_centred_mm: Annotated[OrNull, about("Mean distance without the mean error vector.")]
    rmse_before_mm: Annotated[OrNull, about("Root mean square of the distance before the fit.")]


class AllPointErrors(Object):
    """Errors over all measured points of the fitted rows."""

    count: Annotated[int, about("Number of points over all rows.")]
    rmse_mm: Annotated[OrNull, about("Root mean square of the distance to the predicted point.")]
    mean_mm: Annotated[OrNull, about("Mean distance.")]
    max_mm: Annotated[OrNull, about("Largest distance.")]
    rmse_centred_mm: Annotated[
        OrNull, about("Root mean square of the distance without the mean error vector.")
    ]
    mean_centred_mm: Annotated[OrNull, about("Mean distance without the mean error vector.")]
    rmse_before_mm: Annotated[OrNull, about("Root mean square of the distance before the fit.")]


class EndOfFit(Object):
    """Estimates, and how the fit ended."""

    converged: Annotated[bool, about("Whether the fit converged.")]
    message: Annotated[str, about("How it ended.")]
    parameters: Annotated[list[Estimate], about("Fitted parameters.")]
    correlation: Annotated[
        list[list[OrNull]],
        about("Correlation matrix; `null` for parameters that are not identifiable."),
    ]
    not_identifiable: Annotated[
        list[list[str]], about("Groups of parameters that the rows cannot separate.")
    ]
    rows: Annotated[int, about("Fitted rows.")]


class FitNumbers(EndOfFit, TipErrors):
    """Result of `Fit.to_dict`; tip errors are those after the fit."""

    model: Annotated[Literal["rod", "arc"], about("`rod`: statics; `arc`: constant curvature.")]
    doubts: Annotated[list[str], about("Why the result itself is not to be believed.")]
    rows_without_equilibrium: Annotated[
        int, about("Rows without an equilibrium; they are not fitted.")
    ]
    rmse_before_mm: Annotated[
        OrNull,
        about(
            "Root mean square of the tip error of ROBOT as given; a base of which all six "
            "parameters are fitted is first put where it fits best."
        ),
    ]
    mean_before_mm: Annotated[OrNull, about("Mean of the same.")]
    points: Annotated[
        list[PointErrors],
        about("Measured points that are fitted, from base to tip; the last is the tip."),
    ]
    all_points: Annotated[AllPointErrors, about("Errors over all of them.")]
    noise_mm: Annotated[
        OrNull, about("Scatter of a coordinate by its median, which outliers hardly change.")
    ]
    residuals_over_stated_uncertainty: Annotated[
        OrNull,
        about(
            "Root mean square of residual over stated uncertainty: about 1 if the model lacks "
            "nothing; `null` if none is stated."
        ),
    ]
    autocorrelation: Annotated[
        OrNull, about("Autocorrelation of the residuals; `null` with too few rows.")
    ]
    evaluations: Annotated[int, about("Evaluations of all rows.")]


class TableFit(FitNumbers):
    """Result of `Calibration.to_dict`."""

    loss: Annotated[Literal["linear", "soft_l1", "huber"], about("Loss function.")]
    correlated: Annotated[
        list[CorrelatedPair], about("Pairs correlated by 0.9 or more, strongest first.")
    ]
    validation: Annotated[Validation | None, about("Validation; `null` without any.")]
    tendon_check: Annotated[FitTendonCheck, about("Check of the order of the tendons.")]
    data: Annotated[FitData, about("The fitted table.")]
    outliers: Annotated[
        list[OutlierRow],
        about("Few rows far beyond the scatter of the others, such as mistyped ones."),
    ]
    lines: Annotated[list[int], about("Line of each row in the table.")]
    residuals_mm: Annotated[
        list[VectorOrNull],
        about("Predicted less measured tip of each row; `null` where nothing was measured."),
    ]


class ResidualLengths(Object):
    """Length scales of the inputs of a residual; `null` where an input is not used."""

    commands: Annotated[OrNull, about("Length scale of the commands over their spread.")]
    point: Annotated[
        OrNull, about("Length scale of the predicted point over the length of the robot.")
    ]
    memory: Annotated[OrNull, about("Length scale of the memory state over its radius.")]


class ResidualNumbers(Object):
    """Result of `Residual.to_dict`."""

    length_scales: Annotated[ResidualLengths, about("Length scales of the inputs.")]
    memory_radius_mm: Annotated[
        OrNull, about("Radius of the memory state; `null` if it is not used.")
    ]
    noise: Annotated[float, about("Variance of the noise over that of the residual.")]
    rows: Annotated[int, about("Rows of the Gaussian process.")]
    folds_model: Annotated[
        RowErrors, about("Tip errors of the calibrated model alone at the fitted rows.")
    ]
    folds_residual: Annotated[
        RowErrors,
        about(
            "Tip errors of the same rows with the residual, each predicted by a residual without "
            "its block of rows."
        ),
    ]


class ComparedModel(Object):
    """Tip errors of a model at the validation rows."""

    model: Annotated[
        Literal["rod", "arc", "commands"],
        about("`rod`: statics; `arc`: constant curvature; `commands`: learner on commands alone."),
    ]
    fitted_rows: Annotated[int, about("Rows that the model and the residual are fitted to.")]
    alone: Annotated[
        RowErrors | None, about("Without residual; `null` for the learner on commands alone.")
    ]
    with_residual: Annotated[RowErrors, about("With residual.")]


class ResidualStudy(ResidualNumbers):
    """Residual and its comparison with other models."""

    rows_beyond_data: Annotated[
        int, about("Validation rows of which less than half of the variance is explained.")
    ]
    median_share_kept: Annotated[
        float, about("Median over the validation rows of the explained share of the variance.")
    ]
    comparison: Annotated[list[ComparedModel], about("Models by number of fitted rows.")]


ModelName = Literal[
    "cc",
    "cc_calibrated",
    "rod",
    "rod_calibrated",
    "rod_backlash",
    "rod_friction",
    "rod_hysteresis",
    "rod_creep",
    "rod_relaxation",
]


class JudgedModel(Object):
    """A model of a comparison."""

    model: Annotated[
        ModelName,
        about(
            "`cc`, `rod`: constant curvature and statics as the robot file has them; "
            "`_calibrated`: with fitted parameters; the others: with a memory besides."
        ),
    ]
    parameters: Annotated[list[str], about("Fitted parameters.")]
    estimates: Annotated[
        list[Estimate], about("Their estimates; empty if nothing was fitted, or the fit failed.")
    ]
    fitted: Annotated[
        RowErrors | None, about("Tip errors of the fitted rows; `null` if `reason` says why.")
    ]
    left_out: Annotated[
        RowErrors | None, about("Tip errors of the rows, each predicted by a fit without its fold.")
    ]
    validation: Annotated[
        RowErrors | None, about("Tip errors of the validation table; `null` without one.")
    ]
    reason: Annotated[
        str, about("Why there are no numbers; with numbers a note on the fit, or empty.")
    ]


class ErrorParts(Object):
    """Parts of the mean error of constant curvature, which add up to the total."""

    rows: Annotated[int, about("Rows that all models of the parts predict.")]
    total_mm: Annotated[float, about("Mean error of constant curvature as the robot file has it.")]
    parameters_mm: Annotated[
        float, about("Parameters and geometry: what calibration of constant curvature removes.")
    ]
    physics_mm: Annotated[float, about("Physics: what the calibrated rod removes beyond that.")]
    memory_mm: Annotated[float, about("What the chosen memory removes beyond that.")]
    noise_mm: Annotated[
        OrNull, about("Mean error of a perfect model by noise; `null` if noise is not known.")
    ]
    unexplained_mm: Annotated[
        float, about("What is left, with the noise if that is not known. Parts may be negative.")
    ]
    noise_source: Annotated[
        Literal["repeats", "stated"] | None, about("How the noise is known; `null` if it is not.")
    ]


class HeldOutParts(ErrorParts):
    """Parts of the error of constant curvature, and the rows they are of."""

    on: Annotated[
        Literal["folds", "validation"], about("Left-out rows of the folds, or validation table.")
    ]


class ModelComparison(Object):
    """Models judged on left-out rows."""

    folds: Annotated[int, about("Number of folds.")]
    models: Annotated[list[JudgedModel], about("Models in the order of complexity.")]
    chosen: Annotated[ModelName, about("The model to use.")]
    memory: Annotated[
        ModelName | None,
        about("The memory that is clearly better than the calibrated rod; `null` without one."),
    ]
    parts: Annotated[HeldOutParts, about("Parts of the error of constant curvature.")]
    verdict: Annotated[str, about("Its largest part and what to do, as a sentence.")]


class Fit(TableFit, OfRobot, InFolder):
    """Output of `bowstring fit`."""

    residual: Annotated[ResidualStudy | None, about("Residual; `null` without `--residual`.")]
    comparison: Annotated[
        ModelComparison | None, about("Comparison of models; `null` without `--compare`.")
    ]


class StoppedModels(Object):
    """Models that were finished when a comparison was stopped."""

    folds: Annotated[int, about("Number of folds.")]
    models: Annotated[
        list[JudgedModel], about("Finished models, in the order of complexity; none is chosen.")
    ]
    unfinished: Annotated[list[ModelName], about("Models that were not finished.")]


class StoppedComparison(StoppedModels, OfRobot, InFolder):
    """Output of `bowstring fit --compare` that was stopped by Ctrl-C; there is no fit."""
