"""JSON of the command study.

``study.json`` in its folder holds `StudyResults`, which has no ``folder``, and two keys more:
``files``, the names of the files in the folder, and ``sha256``, their hashes by name.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from bowstring.schemas.basic import (
    FeStatus,
    Interval,
    MeasurementIssue,
    MotionStatus,
    Object,
    OrNull,
    RigidMotion,
    Source,
    StaticsStatus,
    Vector,
    VectorOrNull,
    about,
)
from bowstring.schemas.fit import EndOfFit, ModelComparison
from bowstring.schemas.maps import MapValues, SpreadValues

# -- comparisons -----------------------------------------------------------------------------------


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


class Comparison(Object):
    """Tip error of a model against a reference: Euclidean distances, over points."""

    name: Annotated[
        ModelName,
        about(
            "Model: `cc_from_lengths`, `cc_from_force`, and corrected `cc_from_lengths_chord`, "
            "`cc_from_force_arm`; against measurements also `cc_calibrated`, `rod`, "
            "`rod_calibrated`. They come in this order. Last, against statics, come polynomials of "
            "arc length as curvature: fitted to the shape by statics (`linear_curvature_fit` and "
            "so on), or predicted from tensions and weight (`linear_curvature_from_loads`) where "
            "that differs from the linear law."
        ),
    ]
    against: Annotated[
        Reference,
        about(
            "Reference: `statics`; `dynamics`, at the times at which the rising tension passes the "
            "loads of the sweep; `fe`, finite elements; `measurement`. They come in this order."
        ),
    ]
    n: Annotated[int, about("Number of points that both sides have.")]
    mean_mm: Annotated[OrNull, about("Mean error.")]
    max_mm: Annotated[OrNull, about("Largest error.")]
    rms_mm: Annotated[OrNull, about("Root mean square of the error.")]
    mean_percent: Annotated[OrNull, about("Mean error in percent of the length.")]
    mean_by_axis_mm: Annotated[VectorOrNull, about("Means of absolute errors by axis.")]


class ComparisonIntervals(Object):
    """95 % intervals by bootstrap."""

    mean_mm: Annotated[Interval, about("Of the mean error.")]
    rms_mm: Annotated[Interval, about("Of the root mean square.")]
    mean_percent: Annotated[Interval, about("Of the mean error in percent of the length.")]
    mean_by_axis_mm: Annotated[list[Interval], about("Of the means by axis x, y, z.")]


class DataComparison(Comparison):
    """Tip error of a model against measurements."""

    max_by_axis_mm: Annotated[VectorOrNull, about("Largest absolute errors by axis.")]
    registered: Annotated[bool, about("Whether a base frame was fitted.")]
    frame: Annotated[
        Literal["calibrated", "as_measured", "own"],
        about(
            "`calibrated`: one base frame for all models, that of the calibrated rod "
            "(`cc_calibrated` keeps that of its own calibration). `as_measured`: not registered. "
            "`own`: the frame that fits the model best. They come in this order."
        ),
    ]
    interval_95: Annotated[ComparisonIntervals, about("95 % intervals.")]


# -- shapes ----------------------------------------------------------------------------------------


class ShapeErrors(Object):
    """Errors of one model at the tip and over the disks, against statics."""

    name: Annotated[ModelName, about("Model, as of `comparisons`.")]
    kind: Annotated[
        Literal["constant_curvature", "fit", "prediction"],
        about(
            "`constant_curvature` from lengths or force; `fit`: curvature fitted to the disks by "
            "statics; `prediction`: from tensions and weight."
        ),
    ]
    degree: Annotated[int, about("Degree of the curvature in arc length; 0: constant.")]
    n: Annotated[int, about("Number of loads.")]
    tip_mean_mm: Annotated[OrNull, about("Mean error of the tip.")]
    tip_max_mm: Annotated[OrNull, about("Largest error of the tip.")]
    tip_mean_percent: Annotated[OrNull, about("Mean error of the tip in percent of the length.")]
    shape_mean_mm: Annotated[
        OrNull, about("Mean over the loads of the root mean square error over the disks.")
    ]
    shape_max_mm: Annotated[OrNull, about("Largest error of a disk.")]
    shape_mean_percent: Annotated[OrNull, about("`shape_mean_mm` in percent of the length.")]


class StudyShapes(Object):
    """Constant curvature, and curvature that varies along the robot."""

    models: Annotated[
        list[ShapeErrors], about("Constant curvature, then fits and predictions by degree.")
    ]
    text: Annotated[list[str], about("Results, and why models are left out, in sentences.")]


# -- verdict ---------------------------------------------------------------------------------------


class EffectShare(Object):
    """Share of an effect in the error of constant curvature."""

    effect: Annotated[str, about("Name of the effect.")]
    label: Annotated[str, about("The effect in words.")]
    error_without_mm: Annotated[OrNull, about("Error with this effect alone removed.")]
    share_percent: Annotated[
        OrNull, about("Share of the error; shares interact and need not add up to 100 %.")
    ]


class ValidityLimit(Object):
    """Verdict on constant curvature from lengths, or from force."""

    name: Annotated[str, about("`cc_from_lengths` or `cc_from_force`.")]
    valid_throughout: Annotated[bool, about("Whether the error never exceeds the tolerance.")]
    valid_to_N: Annotated[
        OrNull,
        about("Tension at the first crossing, or the last one solved; `null` if it never holds."),
    ]
    exceeded_N: Annotated[
        list[Interval], about("Ranges of tension in which the error exceeds the tolerance.")
    ]
    undecided_N: Annotated[
        list[Interval], about("Ranges of tension without an equilibrium or without an arc.")
    ]
    max_error_mm: Annotated[OrNull, about("Largest error.")]
    max_error_at_N: Annotated[OrNull, about("Tension of the largest error.")]
    dominant_cause: Annotated[
        str | None,
        about(
            "Effect with more than half of the error at `shares_at_N`, also if the tolerance is "
            "never exceeded; `null` without such an effect."
        ),
    ]
    shares_at_N: Annotated[
        OrNull,
        about("Tension of the shares: the first crossing, or that of the largest error."),
    ]
    shares: Annotated[list[EffectShare], about("Shares of the effects, largest first.")]
    text: Annotated[str, about("The verdict in words.")]


class Verdict(Object):
    """Verdict on constant curvature."""

    tolerance_percent: Annotated[float, about("Tolerated error in percent of the length.")]
    tolerance_mm: Annotated[float, about("Tolerated error.")]
    text: Annotated[list[str], about("The verdict in sentences.")]
    meanings: Annotated[
        list[ValidityLimit], about("Constant curvature from lengths, then from force.")
    ]


# -- error budget ----------------------------------------------------------------------------------


class CaseError(Object):
    """Tip error of constant curvature under one set of physical assumptions."""

    n: Annotated[int, about("Number of loads.")]
    mean_mm: Annotated[OrNull, about("Mean error.")]
    max_mm: Annotated[OrNull, about("Largest error.")]
    mean_percent: Annotated[OrNull, about("Mean error in percent of the length.")]


class Problem(Object):
    """Reason for missing numbers."""

    problem: Annotated[
        str | None, about("Why numbers are missing, at some loads or all; `null` if none are.")
    ]


class Case(Problem):
    """Constant curvature under one set of physical assumptions."""

    cc_from_lengths: Annotated[CaseError, about("From tendon lengths.")]
    cc_from_force: Annotated[CaseError, about("From force.")]


class Description(Object):
    """Physical assumptions."""

    description: Annotated[str, about("The assumptions in words.")]


class DescribedCase(Case, Description):
    """Constant curvature under one set of physical assumptions that are described."""


class ContributionError(CaseError):
    """Tip error, and the contribution of an effect to it."""

    contribution_n: Annotated[
        int, about("Number of loads with an equilibrium both with and without the effect.")
    ]
    contribution_mm: Annotated[
        OrNull,
        about(
            "Mean error with the effect less mean error without it, over these loads; positive if "
            "the effect increases the error."
        ),
    ]
    contribution_percent: Annotated[OrNull, about("The same in percent of the length.")]


class TipMoved(Object):
    """Motion of the tip of the full physics by an effect."""

    tip_moved_mean_mm: Annotated[OrNull, about("Mean distance by which the effect moves the tip.")]
    tip_moved_max_mm: Annotated[OrNull, about("Largest distance.")]


class EffectCase(Problem, TipMoved):
    """An effect added or removed."""

    cc_from_lengths: Annotated[ContributionError, about("From tendon lengths.")]
    cc_from_force: Annotated[ContributionError, about("From force.")]


class SweepEffectCase(EffectCase):
    """An effect changed in the sweep."""

    how: Annotated[Literal["added", "removed"], about("Removed if it acts there, else added.")]


class BudgetRow(Object):
    """Row of the error budget."""

    effect: Annotated[str, about("Name of the effect.")]
    label: Annotated[str, about("The effect in words.")]
    added: Annotated[EffectCase, about("The effect alone added to the baseline.")]
    full: Annotated[Case, about("The full model with the effect (of alternatives, with this one).")]
    removed: Annotated[EffectCase, about("The effect alone removed from the full model.")]
    in_sweep: Annotated[SweepEffectCase, about("The effect alone changed in the sweep.")]


# -- error budget of actuation ---------------------------------------------------------------------


class ChangeError(CaseError):
    """Tip error, and its change by an effect of actuation."""

    change_n: Annotated[int, about("Number of loads with and without the effect.")]
    change_of_mean_mm: Annotated[OrNull, about("Change of the mean error over these loads.")]
    change_of_mean_percent: Annotated[OrNull, about("The same in percent of the length.")]


class ActuationEffect(Problem, TipMoved):
    """An effect of actuation, relative to the same commands without it."""

    effect: Annotated[str, about("Name of the effect.")]
    label: Annotated[str, about("The effect in words.")]
    assumed: Annotated[
        list[Literal["friction", "elasticity"]], about("What the robot file does not give.")
    ]
    more_than_constant_curvature: Annotated[
        bool,
        about(
            "Whether the effect moves the tip by more than the error of constant curvature without "
            "it, in the means."
        ),
    ]


class TensionEffect(ActuationEffect):
    """Row of the budget under tension control."""

    control: Annotated[Literal["tension"], about("Actuation.")]
    cc_from_lengths: Annotated[ChangeError, about("From tendon lengths.")]
    cc_from_force: Annotated[ChangeError, about("From force.")]


class DisplacementEffect(ActuationEffect):
    """Row of the budget under displacement control."""

    control: Annotated[Literal["displacement"], about("Actuation.")]
    cc_from_commanded_lengths: Annotated[ChangeError, about("From the commanded lengths.")]


class CommandedCase(Problem, Description):
    """Constant curvature under displacement control."""

    cc_from_commanded_lengths: Annotated[CaseError, about("From the commanded lengths.")]


class Hysteresis(Object):
    """Tip along a loop of loading and unloading."""

    width_mm: Annotated[
        OrNull, about("Largest distance between loading and unloading at equal command.")
    ]
    width_percent: Annotated[OrNull, about("The same in percent of the length.")]
    tip_free_mm: Annotated[
        list[VectorOrNull], about("Tip without friction, with inextensible tendons.")
    ]
    tip_loading_mm: Annotated[list[VectorOrNull], about("Tip on loading.")]
    tip_unloading_mm: Annotated[
        list[VectorOrNull], about("Tip on unloading, in the order of the commands.")
    ]
    tip_constant_curvature_mm: Annotated[
        list[VectorOrNull],
        about("Tip by constant curvature, from force or from the commanded lengths."),
    ]


class TensionHysteresis(Hysteresis):
    """Hysteresis under tension control."""

    control: Annotated[Literal["tension"], about("Actuation.")]
    widest_at_tension_N: Annotated[OrNull, about("Command of the largest distance.")]
    tension_N: Annotated[list[float], about("Commands.")]


class DisplacementHysteresis(Hysteresis):
    """Hysteresis under displacement control."""

    control: Annotated[Literal["displacement"], about("Actuation.")]
    widest_at_displacement_mm: Annotated[OrNull, about("Command of the largest distance.")]
    displacement_mm: Annotated[list[OrNull], about("Commands.")]


Origin = Literal["file", "calibrated", "assumed", "left_out"]


class ActuationBudget(Object):
    """Friction, elastic tendons, displacement control, loading and unloading."""

    friction: Annotated[float, about("Friction coefficient of the actuated tendon.")]
    friction_origin: Annotated[
        Origin, about("Origin of the friction: robot file, calibration or assumption.")
    ]
    axial_stiffness_N: Annotated[
        OrNull, about("EA of the actuated tendon; `null` if only its transmission is elastic.")
    ]
    compliance_m_per_N: Annotated[float, about("Compliance of its transmission.")]
    free_length_m: Annotated[float, about("Length of tendon before the base.")]
    elasticity_origin: Annotated[
        Origin, about("Origin of the elasticity; `left_out` if there is nothing to assume EA from.")
    ]
    elasticity_by: Annotated[str, about("How an assumed EA was found, or why there is none.")]
    commanded_displacement_mm: Annotated[
        list[OrNull], about("Displacement of the actuated tendon at the loads of the sweep.")
    ]
    tension: Annotated[
        DescribedCase, about("Tension control without friction and elasticity: the sweep.")
    ]
    displacement: Annotated[
        CommandedCase, about("Displacement control without friction and elasticity.")
    ]
    rows: Annotated[list[TensionEffect | DisplacementEffect], about("Effects.")]
    hysteresis: Annotated[
        list[TensionHysteresis | DisplacementHysteresis],
        about("Under tension control, then under displacement control."),
    ]
    text: Annotated[list[str], about("Results in sentences.")]
    notes: Annotated[list[str], about("Assumptions and limits in sentences.")]


class Budget(Object):
    """Error budget."""

    baseline: Annotated[DescribedCase, about("The baseline.")]
    full_model: Annotated[DescribedCase, about("The full model.")]
    sweep: Annotated[Case, about("The physics of the sweep.")]
    rows: Annotated[list[BudgetRow], about("Effects.")]
    notes: Annotated[list[str], about("How to read it, and its limits, in sentences.")]
    actuation: Annotated[
        ActuationBudget, about("[Budget of actuation](../guide/actuation-budget.md).")
    ]


# -- measurements ----------------------------------------------------------------------------------


class TurnedFrame(RigidMotion):
    """Transformation from the measuring frame to the base frame."""

    turned_deg: Annotated[float, about("Angle of the rotation.")]


class BaseEstimate(Object):
    """A coordinate of the base by calibration."""

    value: Annotated[float, about("Estimate.", "`unit`")]
    standard_error: Annotated[OrNull, about("Standard error.", "`unit`")]
    unit: Annotated[str, about("Unit.")]


class Registration(TurnedFrame):
    """Registration of the measurements."""

    by: Annotated[str, about("Model with which the frame was found.")]
    base_in_measuring_frame: Annotated[
        dict[str, BaseEstimate] | None,
        about("Base by coordinate `x` to `rz`; `null` without calibration."),
    ]
    own_frames: Annotated[
        dict[str, TurnedFrame], about("Frame that fits each model best, by model.")
    ]


class StudyCalibrationNumbers(EndOfFit):
    """Result of `StudyCalibration.to_dict`."""

    gravity_origin: Annotated[
        Literal["file", "assumed", "calibrated"], about("Origin of the gravity.")
    ]
    gravity_m_per_s2: Annotated[Vector, about("Gravity in base axes.")]
    other_load: Annotated[
        bool,
        about("Whether a constant load other than gravity would explain the data clearly better."),
    ]
    notes: Annotated[list[str], about("Choices and limits in sentences.")]


class StudyCalibration(StudyCalibrationNumbers):
    """Calibration of the rod."""

    constant_curvature_gains: Annotated[
        dict[str, float], about("Fitted gains of calibrated constant curvature.")
    ]


class ResidualTests(Object):
    """Tests whether the residuals of the calibrated rod are noise."""

    noise: Annotated[
        bool | None, about("Whether they are noise; `null` if nothing could be tested.")
    ]
    rms_of_a_coordinate_mm: Annotated[OrNull, about("Root mean square of a coordinate.")]
    stated_sigma_mm: Annotated[
        OrNull, about("Stated standard uncertainty of a coordinate; `null` if not stated.")
    ]
    scatter_of_repeats_mm: Annotated[
        OrNull, about("Scatter of a coordinate of repeats; `null` without repeats.")
    ]
    chi_square: Annotated[OrNull, about("Sum of squares over the stated variance.")]
    dof: Annotated[int, about("Degrees of freedom.")]
    variance_p: Annotated[OrNull, about("p-value of the variance test.")]
    lack_of_fit_ratio: Annotated[OrNull, about("F ratio of the lack-of-fit test.")]
    lack_of_fit_p: Annotated[OrNull, about("p-value of the lack-of-fit test.")]
    autocorrelation: Annotated[OrNull, about("Autocorrelation along the load.")]
    autocorrelation_p: Annotated[OrNull, about("p-value of no autocorrelation.")]
    significance_level: Annotated[float, about("p-value below which a test rejects noise.")]
    outlier_rows: Annotated[int, about("Rows more than five standard deviations away.")]
    lines_against_their_repeats: Annotated[
        list[int], about("Lines that contradict repeats of their load; these tests omit them.")
    ]
    other_load: Annotated[
        bool, about("Whether a constant load that the model lacks would explain clearly more.")
    ]
    text: Annotated[str, about("Result in sentences.")]


class DecompositionStep(Object):
    """A step of the decomposition of the error of the rod."""

    effect: Annotated[str, about("Name of the effect.")]
    label: Annotated[str, about("The effect in words.")]
    cumulative_mean_mm: Annotated[OrNull, about("Mean error with this effect and all before it.")]
    explains_mm: Annotated[
        OrNull, about("Decrease of the mean error by this step; negative if it increases.")
    ]
    explains_interval_95_mm: Annotated[Interval, about("Its 95 % interval.")]
    mean_without_it_alone_mm: Annotated[
        OrNull, about("Mean error of the calibrated robot without this effect alone.")
    ]
    increase_without_mm: Annotated[
        OrNull, about("Increase of the mean error without this effect alone.")
    ]
    increase_without_interval_95_mm: Annotated[Interval, about("Its 95 % interval.")]


class Decomposition(Object):
    """Decomposition of the error of the rod."""

    baseline_mm: Annotated[OrNull, about("Mean error of the baseline rod.")]
    effects: Annotated[list[DecompositionStep], about("Steps.")]


class ExpectedError(Object):
    """Mean error of the calibrated rod at rows that it was not fitted to."""

    mean_mm: Annotated[OrNull, about("Mean error.")]
    interval_95_mm: Annotated[Interval, about("Its 95 % interval.")]


class Bootstrap(Object):
    """How the intervals were found."""

    resamples: Annotated[int, about("Number of resamples.")]
    level: Annotated[float, about("Confidence level.")]
    unit: Annotated[str, about("What is resampled together.")]
    units: Annotated[int, about("Number of these.")]
    calibrated_rod_at_other_rows: Annotated[
        ExpectedError | None, about("Expected error; `null` without calibration or with few rows.")
    ]


class StudyMeasurements(Object):
    """Comparison with measurements."""

    source: Annotated[Source, about("Origin of the numbers.")]
    name: Annotated[str, about("Name of the table.")]
    file: Annotated[str | None, about("Path of the table.")]
    sha256: Annotated[str | None, about("SHA-256 of the table.")]
    rows: Annotated[int, about("Number of rows, without those left out.")]
    left_out: Annotated[int, about("Rows left out; `issues` has the reasons.")]
    without_tip: Annotated[int, about("Rows without a measured tip.")]
    issues: Annotated[list[MeasurementIssue], about("What is wrong with the table.")]
    loads: Annotated[int, about("Number of different loads.")]
    repeats: Annotated[int, about("Number of repeats.")]
    unloading_rows: Annotated[
        int | None, about("Rows on unloading; `null` if several commands change.")
    ]
    registration: Annotated[Registration, about("Registration.")]
    calibration: Annotated[
        StudyCalibration | None,
        about("Calibration; `null` if the rod could not be calibrated, and `notes` says why."),
    ]
    residuals: Annotated[
        ResidualTests | None, about("Tests of the residuals; `null` without calibration.")
    ]
    decomposition: Annotated[Decomposition, about("Decomposition of the error.")]
    bootstrap: Annotated[Bootstrap, about("How the intervals were found.")]
    comparison: Annotated[
        ModelComparison | None,
        about("Models on left-out rows; `null` without `--compare`, or `notes` says why."),
    ]
    text: Annotated[list[str], about("Results in sentences.")]
    notes: Annotated[list[str], about("Choices and limits in sentences.")]


# -- sweeps and motion -----------------------------------------------------------------------------


class Surface(Object):
    """Largest stress and strain at the surface of the backbone, by load or time."""

    von_mises_max_MPa: Annotated[list[OrNull], about("Von Mises stress.")]
    normal_stress_max_MPa: Annotated[list[OrNull], about("Magnitude of the axial stress.")]
    strain_max_percent: Annotated[list[OrNull], about("Magnitude of the axial strain.")]


class ErrorsByModel(Object):
    """Errors of the models at the loads of the sweep."""

    errors_mm: Annotated[
        dict[str, list[OrNull]], about("Tip error of each model at the loads of the sweep.")
    ]


class StudySweep(Surface, ErrorsByModel):
    """Sweep by statics."""

    actuated_tendon: Annotated[int, about("First actuated tendon, from 1.")]
    shares: Annotated[list[float], about("Share of the tension by tendon.")]
    tension_N: Annotated[list[float], about("Tensions of the actuated tendon.")]
    status: Annotated[list[StaticsStatus], about("Status by load, as of `solve`.")]
    tip_position_mm: Annotated[list[VectorOrNull], about("Tip.")]
    tendon_lengths_mm: Annotated[list[list[OrNull]], about("Tendon lengths.")]
    displacement_mm: Annotated[list[OrNull], about("Displacement of the actuated tendon.")]
    linear_displacement_mm: Annotated[list[OrNull], about("The same by the linear law.")]


class MotionNumbers(Surface):
    """Result of `Transient.to_dict`."""

    status: Annotated[
        MotionStatus, about("As of `simulate`; `converged` if the motion came to its end.")
    ]
    reason: Annotated[str, about("Why it stopped early; else empty.")]
    text: Annotated[list[str], about("Results in sentences.")]
    slowest_frequency_hz: Annotated[float, about("Natural frequency of the slowest mode.")]
    rise_s: Annotated[float, about("Rise time of the tension.")]
    hold_s: Annotated[float, about("Time after the rise.")]
    modal_damping: Annotated[float, about("Damping ratio of the slowest modes.")]
    mass_damping_per_s: Annotated[float, about("Mass-proportional damping.")]
    material_damping_s: Annotated[float, about("Kelvin-Voigt damping.")]
    difference_from_statics_mean_mm: Annotated[
        OrNull, about("Mean distance of the tip from statics over the rise.")
    ]
    difference_from_statics_max_mm: Annotated[OrNull, about("Largest distance over the rise.")]
    difference_from_statics_max_at_N: Annotated[OrNull, about("Tension there.")]
    lag_s: Annotated[OrNull, about("Lag behind statics, mean over the rise.")]
    overshoot_mm: Annotated[OrNull, about("Overshoot of the tip during the hold.")]
    overshoot_percent: Annotated[OrNull, about("The same in percent of the length.")]
    overshoot_at_s: Annotated[OrNull, about("Time of the overshoot.")]
    residual_mm: Annotated[
        OrNull, about("Largest distance from statics in the last period of the hold.")
    ]
    time_s: Annotated[list[float], about("Times.")]
    tension_N: Annotated[list[float], about("Tension of the actuated tendon at these times.")]
    tip_position_mm: Annotated[list[Vector], about("Tip.")]
    tip_displacement_mm: Annotated[list[float], about("Distance of the tip from its start.")]


class Motion(MotionNumbers, ErrorsByModel):
    """Dynamics: a ramp of tension, then a hold."""


class NoMotion(Object):
    """Dynamics that were left out."""

    status: Annotated[Literal["left_out"], about("Status.")]
    text: Annotated[list[str], about("Why they were left out.")]


class StudyFiniteElements(Object):
    """Sweep by finite elements."""

    status: Annotated[FeStatus, about("As of `fe`.")]
    text: Annotated[list[str], about("Results in sentences.")]
    tip_position_mm: Annotated[list[VectorOrNull], about("Tip.")]
    tendon_lengths_mm: Annotated[list[list[OrNull]], about("Tendon lengths.")]
    from_statics_mm: Annotated[list[OrNull], about("Distance of the tip from that of statics.")]
    measured_point_mm: Annotated[
        list[VectorOrNull] | None,
        about(
            "With measurements: measured point by finite elements, interpolated between loads, by "
            "row of the table; `null` in rows in which another tendon has tension too or the load "
            "is not in the sweep."
        ),
    ]
    mean_from_measurement_mm: Annotated[
        dict[str, OrNull], about("Mean distance from the measured point over these rows, by model.")
    ]
    middle_stress_ratio: Annotated[list[OrNull], about("As `stress_ratio` of `fe`.")]
    concentration: Annotated[list[OrNull], about("As of `fe`.")]
    span_error: Annotated[OrNull, about("As of `fe`.")]
    mesh: Annotated[str, about("Bricks along a module, around and across.")]
    stiffness: Annotated[float, about("Young's modulus of the disks over that of the backbone.")]
    grip: Annotated[Literal["bonded", "sliding"], about("How disks hold the backbone.")]
    calculix_version: Annotated[str, about("Version of CalculiX.")]


class GeometricSweep(Object):
    """Constant curvature alone, over the displacement of the actuated tendon."""

    displacement_mm: Annotated[list[float], about("Displacements.")]
    tip_position_mm: Annotated[list[Vector], about("Tip.")]
    theta_deg: Annotated[list[list[float]], about("Bend angles, by displacement and segment.")]


# -- all -------------------------------------------------------------------------------------------


class Figure(Object):
    """Figure of the report."""

    title: Annotated[str, about("Title.")]
    caption: Annotated[str, about("Caption.")]
    png: Annotated[str, about("Path in the folder.")]
    pdf: Annotated[str, about("Path in the folder.")]


class PublishedClaim(Object):
    """Published figure of the same comparison."""

    source: Annotated[str, about("Publication.")]
    what: Annotated[str, about("What is compared.")]
    smaller_than_mm: Annotated[float, about("Published bound of the mean error.")]
    smaller_than_percent: Annotated[float, about("The same in percent of the length.")]
    compared_with: Annotated[str, about("The comparison with it in words.")]


class StudyProvenance(Object):
    """Origin of a study."""

    schema_version: Annotated[int, about("Version of the schema of a study.")]
    bowstring_version: Annotated[str, about("Version of Bowstring.")]
    robot_hash: Annotated[str, about("Hash of all numbers of the robot file that act in physics.")]
    robot: Annotated[dict[str, Any], about("The [robot file](robot-file.md).")]
    settings: Annotated[
        dict[str, Any],
        about("Arguments and flags as used, defaults included; units are in the keys."),
    ]


class UncertainNumbers(Object):
    """Validity limits where numbers of the robot are uncertain."""

    assumed: Annotated[bool, about("Whether the program assumed the uncertainty.")]
    models: Annotated[
        list[SpreadValues], about("From lengths and from force; empty without enough results.")
    ]


class StudyMaps(Object):
    """Maps of validity of a study: errors at the tension of the first axis."""

    design: Annotated[
        MapValues | None,
        about("Over the tension and a number of the design; `null` where `notes` say why."),
    ]
    load: Annotated[
        MapValues | None,
        about("Over the tension and a load (`--over`); `null` where `notes` say why."),
    ]
    text: Annotated[list[str], about("Loads up to which the tolerance holds, in sentences.")]


class StudyResults(Object):
    """Result of `Study.to_dict`."""

    robot: Annotated[str, about("Name of the robot.")]
    length_m: Annotated[float, about("Length of the straight backbone.")]
    comparisons: Annotated[list[Comparison | DataComparison], about("Comparisons.")]
    verdict: Annotated[Verdict, about("Verdict.")]
    budget: Annotated[Budget, about("Error budget.")]
    figures: Annotated[list[Figure], about("Figures of the report.")]
    published_claim: Annotated[
        PublishedClaim | None, about("Published figure; `null` if there is none for this robot.")
    ]
    data: Annotated[str, about("Origin of all numbers: simulated, and the table.")]
    registered: Annotated[bool, about("Whether measurements were registered to the base.")]
    measurements: Annotated[
        StudyMeasurements | None, about("Comparison with measurements; `null` without.")
    ]
    notes: Annotated[list[str], about("Assumptions and limits in sentences.")]
    warnings: Annotated[list[str], about("Warnings, one sentence each.")]
    backbone_limits: Annotated[
        list[str], about("How far the sweep uses the limits of the backbone, in sentences.")
    ]
    sweep: Annotated[StudySweep, about("Sweep by statics.")]
    dynamics: Annotated[Motion | NoMotion, about("Dynamics, or why they were left out.")]
    shapes: Annotated[StudyShapes, about("Models over the whole backbone.")]
    maps: Annotated[StudyMaps, about("Maps of validity.")]
    uncertainty: Annotated[
        UncertainNumbers, about("Validity limits with uncertain numbers of the robot.")
    ]
    finite_elements: Annotated[
        StudyFiniteElements | None, about("Finite elements; `null` without `--fe`.")
    ]
    geometric_sweep: Annotated[GeometricSweep, about("Constant curvature alone.")]
    provenance: Annotated[StudyProvenance, about("Origin of the study.")]


class Study(StudyResults):
    """Output of `bowstring study`."""

    folder: Annotated[str, about("Folder of the report.")]
