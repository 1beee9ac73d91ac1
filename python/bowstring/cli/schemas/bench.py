"""JSON of the commands bench check and bench simulate."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from typing_extensions import NotRequired

from bowstring.cli.schemas.basic import MadeBy, MadeByRobot, OfRobot, Pair, Vector
from bowstring.data.columns import Source
from bowstring.data.measurements import MeasurementIssue
from bowstring.data.rigid import Rigid
from bowstring.data.tendon_check import TendonCheck
from bowstring.results import Object, OrNull, about


class TensionRange(Object):
    """Range of a tension-controlled tendon."""

    given_by: Annotated[Literal["tension"], about("Actuation.")]
    smallest_N: Annotated[float, about("Smallest tension.")]
    largest_N: Annotated[float, about("Largest tension.")]


class DisplacementRange(Object):
    """Range of a displacement-controlled tendon."""

    given_by: Annotated[Literal["displacement"], about("Actuation.")]
    smallest_m: Annotated[float, about("Smallest displacement.")]
    largest_m: Annotated[float, about("Largest displacement.")]


class TipRange(Object):
    """Range of the last measured point."""

    smallest: Annotated[Vector, about("Smallest x, y and z.", "`points_unit`")]
    largest: Annotated[Vector, about("Largest x, y and z.", "`points_unit`")]


class TableOfMeasurements(Object):
    """Content of a table of measurements."""

    name: Annotated[str, about("Name of the table.")]
    source: Annotated[Source, about("Origin of the numbers.")]
    rows: Annotated[int, about("Number of rows, without those left out.")]
    rows_left_out: Annotated[int, about("Rows left out; `issues` has the reasons.")]
    rows_without_tip: Annotated[int, about("Rows without a measured tip.")]
    tendons: Annotated[list[TensionRange | DisplacementRange], about("Actuation of each tendon.")]
    points: Annotated[int, about("Measured points in a row.")]
    points_unit: Annotated[Literal["m", "px"], about("Unit of the points.")]
    tip: Annotated[TipRange | None, about("Range of the last point.")]
    tool_m: Annotated[
        Vector, about("Measured point in the frame of the end disk; zero if not stated.")
    ]
    stations: Annotated[
        list[float] | None,
        about(
            "Arc lengths of the points over the length of the backbone, from 0 at the base to 1 at "
            "the tip; `null` if the table does not state them."
        ),
    ]
    angles: Annotated[bool, about("Whether the table has bend angles.")]
    sigma_m: Annotated[
        OrNull, about("Median stated standard uncertainty of a coordinate; `null` if not stated.")
    ]
    groups: Annotated[dict[str, int], about("Rows by label, such as `loading`.")]
    repeats: Annotated[int, about("Number of repeats.")]
    recordings: Annotated[int, about("Number of recordings; each is a load path of its own.")]
    time_s: Annotated[Pair | None, about("First and last time; `null` without times.")]
    issues: Annotated[list[MeasurementIssue], about("Faults of the table.")]
    tendon_check: Annotated[
        TendonCheck | None, about("Check of the order of the tendons; `null` without a robot.")
    ]
    sha256: Annotated[str | None, about("SHA-256 of the table.")]


class BenchCheck(TableOfMeasurements):
    """Output of `bowstring bench check`."""

    robot: NotRequired[Annotated[str, about("Name of the robot, with `--robot`.")]]
    warnings: Annotated[list[str], about("Warnings of table, tendons and robot.")]
    provenance: Annotated[MadeByRobot | MadeBy, about("Origin of the output.")]


class Difference(Object):
    """A field in which the actual robot differs."""

    path: Annotated[str, about("Path of the field.")]
    nominal: Annotated[Any, about("Value of ROBOT; `null` if it has none.")]
    actual: Annotated[Any, about("Value of the actual robot; `null` if it has none.")]


class BenchLoads(Object):
    """Loads of a synthetic test bench."""

    by: Annotated[str, about("`tensions`, `displacements`, both, or `masses`.")]
    masses_kg: NotRequired[Annotated[list[float], about("Masses, if masses are given.")]]
    tendon: NotRequired[
        Annotated[int, about("Tendon that the masses load, from 1, if masses are given.")]
    ]
    g_m_per_s2: NotRequired[Annotated[float, about("Gravity on the masses, if masses are given.")]]
    repeats: Annotated[int, about("Number of runs through the loads.")]
    period_s: Annotated[float | None, about("Time from row to row; `null` without times.")]
    unload: Annotated[bool, about("Whether a run unloads again.")]


class Disturbances(Object):
    """Disturbances that the table does not state."""

    tip_force_N: Annotated[Vector, about("Force at the tip, base axes.")]
    drift_m: Annotated[Vector, about("Drift of the measuring frame up to the last row.")]


class TruthRows(Object):
    """True values by row."""

    tip_position_m: Annotated[list[Vector], about("Tip in the base frame.")]
    point_m: Annotated[list[Vector], about("Measured point in the measuring frame, without noise.")]


class Truth(Object):
    """True values of synthetic measurements."""

    schema_version: Annotated[int, about("Version of this object.")]
    source: Annotated[Literal["synthetic"], about("Origin of the numbers.")]
    bowstring_version: Annotated[str, about("Version of Bowstring.")]
    robot: Annotated[str, about("Name of ROBOT.")]
    robot_hash: Annotated[str, about("Hash of ROBOT.")]
    actual_robot_hash: Annotated[str, about("Hash of the actual robot.")]
    differences: Annotated[
        list[Difference], about("Fields in which the actual robot differs from ROBOT.")
    ]
    actual_robot: Annotated[
        dict[str, Any], about("The actual robot as a [robot file](robot-file.md).")
    ]
    theory: Annotated[str, about("Theory of the backbone.")]
    loads: Annotated[BenchLoads, about("Loads.")]
    gravity_m_per_s2: Annotated[Vector, about("Gravity as given.")]
    gravity_frame: Annotated[Literal["base", "measuring"], about("Frame in which it is given.")]
    gravity_in_base_m_per_s2: Annotated[Vector, about("Gravity in base axes.")]
    base: Annotated[Rigid, about("Base frame in the measuring frame.")]
    frame: Annotated[Rigid, about("Measuring frame in the base frame.")]
    tilt_rad: Annotated[float, about("Tilt of the base.")]
    tilt_towards_rad: Annotated[float, about("Direction of the tilt from x, counter-clockwise.")]
    tool_m: Annotated[Vector, about("Measured point in the frame of the end disk, as stated.")]
    actual_tool_m: Annotated[Vector, about("Actual point in the frame of the end disk.")]
    noise_m: Annotated[float, about("Standard deviation of the noise of a coordinate.")]
    noise_description: Annotated[str, about("Meaning of `noise_m`.")]
    seed: Annotated[int, about("Seed of the noise.")]
    disturbances: Annotated[Disturbances, about("Disturbances.")]
    rows: Annotated[TruthRows, about("True values by row.")]


class BenchFiles(Object):
    """Files of a synthetic test bench."""

    table: Annotated[str, about("Table.")]
    truth: Annotated[str, about("True values.")]


class BenchSimulate(TableOfMeasurements, OfRobot):
    """Output of `bowstring bench simulate`."""

    hysteresis_m: Annotated[
        OrNull,
        about("Largest distance between loading and unloading at equal load; `null` without it."),
    ]
    truth: Annotated[Truth, about("True values, as in their file.")]
    files: Annotated[BenchFiles, about("Files that were written.")]
