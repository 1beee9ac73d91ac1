"""JSON of the command study.

``study.json`` in its folder holds `StudyResults`, which has no ``folder``, and two keys more:
``files``, the names of the files in the folder, and ``sha256``, their hashes by name.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from typing_extensions import NotRequired

from bowstring.calibration.bootstrap import Expected
from bowstring.calibration.model_comparison import ModelComparison
from bowstring.calibration.residual_tests import NoiseTest
from bowstring.cli.schemas.results import beside
from bowstring.data.columns import Source
from bowstring.data.measurements import MeasurementIssue
from bowstring.data.rigid import Rigid
from bowstring.data.tip_errors import Comparison
from bowstring.results import Object, OrNull, about
from bowstring.study.angle_validation import AgainstAngles
from bowstring.study.calibration import StudyCalibration
from bowstring.study.data_validation import BaseEstimate, DataComparison, Effect
from bowstring.study.error_budget import Budget
from bowstring.study.figure_list import Figure
from bowstring.study.finite_elements import FiniteElements
from bowstring.study.notes import PublishedClaim
from bowstring.study.ramp_response import Transient
from bowstring.study.shape_models import ShapeModels
from bowstring.study.sweeps import GeometricSweep, Statics
from bowstring.study.verdict import Verdict
from bowstring.validity.map_result import ValidityMap
from bowstring.validity.spread import Spread

# -- measurements ----------------------------------------------------------------------------------


@beside(Rigid)
class TurnedFrame(Object):
    """Transformation from the measuring frame to the base frame."""

    turned_deg: Annotated[float, about("Angle of the rotation.")]


@beside(Rigid)
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


class Decomposition(Object):
    """Decomposition of the error of the rod."""

    baseline_mm: Annotated[OrNull, about("Mean error of the baseline rod.")]
    effects: Annotated[list[Effect], about("Steps.")]


class Bootstrap(Object):
    """How the intervals were found."""

    resamples: Annotated[int, about("Number of resamples.")]
    level: Annotated[float, about("Confidence level.")]
    unit: Annotated[str, about("Unit of resampling.")]
    units: Annotated[int, about("Number of these.")]
    calibrated_rod_at_other_rows: Annotated[
        Expected | None, about("Expected error; `null` without calibration or with few rows.")
    ]


@beside(StudyCalibration)
class CalibrationOfStudy(Object):
    """Calibration of the rod."""

    constant_curvature_gains: Annotated[
        dict[str, float], about("Fitted gains of calibrated constant curvature.")
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
    issues: Annotated[list[MeasurementIssue], about("Faults of the table.")]
    loads: Annotated[int, about("Number of different loads.")]
    repeats: Annotated[int, about("Number of repeats.")]
    unloading_rows: Annotated[
        int | None, about("Rows on unloading; `null` if several commands change.")
    ]
    registration: Annotated[Registration, about("Registration.")]
    calibration: Annotated[
        CalibrationOfStudy | None,
        about("Calibration; `null` if the rod could not be calibrated, and `notes` says why."),
    ]
    residuals: Annotated[
        NoiseTest | None, about("Tests of the residuals; `null` without calibration.")
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


class ErrorsByModel(Object):
    """Errors of the models at the loads of the sweep."""

    errors_mm: Annotated[
        dict[str, list[OrNull]], about("Tip error of each model at the loads of the sweep.")
    ]


@beside(Statics)
class StudySweep(ErrorsByModel):
    """Sweep by statics."""

    actuated_tendon: Annotated[int, about("First actuated tendon, from 1.")]
    shares: Annotated[list[float], about("Share of the tension by tendon.")]


@beside(Transient)
class Motion(ErrorsByModel):
    """Dynamics: a ramp of tension, then a hold."""


class NoMotion(Object):
    """Dynamics that were left out."""

    status: Annotated[Literal["left_out"], about("Status.")]
    text: Annotated[list[str], about("Why they were left out.")]


# -- all -------------------------------------------------------------------------------------------


class StudyProvenance(Object):
    """Origin of a study."""

    schema_version: Annotated[int, about("Version of the schema of a study.")]
    bowstring_version: Annotated[str, about("Version of Bowstring.")]
    robot_hash: Annotated[str, about("Hash of all numbers of the robot file that act in physics.")]
    robot: Annotated[dict[str, Any], about("The [robot file](robot-file.md).")]
    robot_file: NotRequired[
        Annotated[str, about("In study.json: path of the robot file, or name of a built-in robot.")]
    ]
    settings: Annotated[
        dict[str, Any],
        about("Arguments and flags as used, defaults included; units are in the keys."),
    ]


class UncertainNumbers(Object):
    """Validity limits where numbers of the robot are uncertain."""

    assumed: Annotated[bool, about("Whether the program assumed the uncertainty.")]
    models: Annotated[
        list[Spread], about("From lengths and from force; empty without enough results.")
    ]


class StudyMaps(Object):
    """Maps of validity of a study: errors at the tension of the first axis."""

    design: Annotated[
        ValidityMap | None,
        about("Over the tension and a number of the design; `null` where `notes` say why."),
    ]
    load: Annotated[
        ValidityMap | None,
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
        StudyMeasurements | None, about("Comparison with measured tips; `null` without.")
    ]
    angles: Annotated[
        AgainstAngles | None,
        about("Comparison with measured angles; `null` without, or where tips were measured."),
    ]
    notes: Annotated[list[str], about("Assumptions and limits in sentences.")]
    warnings: Annotated[list[str], about("Warnings, one sentence each.")]
    backbone_limits: Annotated[
        list[str], about("How far the sweep uses the limits of the backbone, in sentences.")
    ]
    sweep: Annotated[StudySweep, about("Sweep by statics.")]
    dynamics: Annotated[Motion | NoMotion, about("Dynamics, or why they were left out.")]
    shapes: Annotated[ShapeModels, about("Models over the whole backbone.")]
    maps: Annotated[StudyMaps, about("Maps of validity.")]
    uncertainty: Annotated[
        UncertainNumbers, about("Validity limits with uncertain numbers of the robot.")
    ]
    finite_elements: Annotated[
        FiniteElements | None, about("Finite elements; `null` without `--fe`.")
    ]
    geometric_sweep: Annotated[GeometricSweep, about("Constant curvature alone.")]
    provenance: Annotated[StudyProvenance, about("Origin of the study.")]


class Study(StudyResults):
    """Output of `bowstring study`."""

    folder: Annotated[str, about("Folder of the report.")]
