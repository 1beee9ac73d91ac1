"""JSON of the command map."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from bowstring.schemas.basic import Interval, Object, OfRobot, OrNull, VectorOrNull, about


class MapAxis(Object):
    """An axis of a map."""

    path: Annotated[str, about("Number of the robot file, or a load, as `--over` takes it.")]
    label: Annotated[str, about("The number in words, without a unit.")]
    unit: Annotated[str, about("SI unit; empty for a plain number.")]
    values: Annotated[list[float], about("Points.", "`unit`")]


class MapOfModel(Object):
    """Map of one model of constant curvature."""

    name: Annotated[
        str,
        about(
            "Model, as `--models` takes it; `cc_from_force_calibrated` has the bending stiffness "
            "that fits best."
        ),
    ]
    values: Annotated[
        list[OrNull] | list[list[OrNull]],
        about("Metric in percent of the length (`valid_to`: N), rows by the second axis."),
    ]
    contour: Annotated[
        list[list[list[float]]],
        about("Lines on which the metric has the tolerance: points, as the axes.", "`unit`"),
    ]
    causes: Annotated[
        Any,
        about(
            "Effect with more than half of the metric at the points of `cause_points`, or empty."
        ),
    ]
    ranges: Annotated[
        list[list[float]],
        about(
            "Ranges in which the tolerance holds: of a single axis, or of the tension or bend for "
            "the robot as it is; empty for others.",
            "`unit`",
        ),
    ]
    defined: Annotated[
        list[bool] | list[list[bool]],
        about(
            "Whether the model has an error at all loads that the metric is of, as `values`: an "
            "equilibrium and an arc."
        ),
    ]


class QuestionValues(Object):
    """What a map asks."""

    tolerance_percent: Annotated[float, about("Tolerated tip error in percent of the length.")]
    metric: Annotated[
        Literal["largest_error", "mean_error", "error", "valid_to"], about("What is mapped.")
    ]
    max_tension_N: Annotated[
        float | None,
        about("End of the sweep where no axis is the tension; null with an axis bend."),
    ]
    axes: Annotated[list[MapAxis], about("Axes in their order; of two, the first is along x.")]


class MapValues(QuestionValues):
    """Values of a map."""

    maps: Annotated[list[MapOfModel], about("Map of each model.")]
    cause_points: Annotated[
        Any, about("Values of each axis at the points of the causes.", "`unit`")
    ]
    states: Annotated[
        list[
            Literal[
                "solved",
                "two equilibria",
                "no stable equilibrium",
                "a tendon is slack",
                "constant curvature not defined",
                "not solved",
            ]
        ],
        about(
            "State of each point, row by row. `not solved`: the solver gave up at some load, which "
            "may have an equilibrium or not."
        ),
    ]
    solved_to: Annotated[
        list[OrNull] | list[list[OrNull]],
        about(
            "Tension (N) or bend (rad) up to which the sweep of each point is solved, as "
            "`values`; `null` where its first load is not."
        ),
    ]
    statics_error_percent: Annotated[
        OrNull, about("Largest estimated error of the tips by statics, in percent of the length.")
    ]


class GridOfModel(Object):
    """Map of one model of constant curvature over more than two axes."""

    name: Annotated[str, about("Model, as `--models` takes it.")]
    values: Annotated[
        Any,
        about(
            "Metric in percent of the length (`valid_to`: N), nested lists in the order of the "
            "axes; `null` without a value."
        ),
    ]
    defined: Annotated[
        Any,
        about(
            "Whether the model has an error at all loads that the metric is of, as `values`: an "
            "equilibrium and an arc."
        ),
    ]


class GridValues(QuestionValues):
    """Values of a map over more than two axes."""

    maps: Annotated[list[GridOfModel], about("Map of each model.")]
    solved: Annotated[
        Any,
        about(
            "Whether all loads that the metric is of have a stable equilibrium, nested lists as of "
            "the values."
        ),
    ]
    gave_up: Annotated[
        Any,
        about(
            "Whether the solver gave up at the first load that is not solved, which may have an "
            "equilibrium or not, as `solved`."
        ),
    ]
    solved_to: Annotated[
        Any,
        about(
            "Tension (N) or bend (rad) up to which each sweep is solved, as `solved`; `null` where "
            "its first load is not."
        ),
    ]


class WorkspaceErrors(Object):
    """Errors of one model of constant curvature over the workspace."""

    name: Annotated[str, about("Model, as `--models` takes it.")]
    error_percent: Annotated[
        list[OrNull],
        about(
            "Tip error at each pose in percent of the length; `null` without an equilibrium or an "
            "arc."
        ),
    ]
    valid_percent: Annotated[
        OrNull,
        about("Share of the poses with an equilibrium at which the tolerance holds, in percent."),
    ]
    causes: Annotated[
        list[str], about("Effect with more than half of the error at each pose, or empty.")
    ]
    not_defined: Annotated[
        int, about("Number of poses with an equilibrium at which the model has no arc.")
    ]


class WorkspaceValues(Object):
    """Values of a map over the workspace."""

    tolerance_percent: Annotated[float, about("Tolerated tip error in percent of the length.")]
    max_tension_N: Annotated[float, about("Largest tension of each tendon.")]
    tip_position_m: Annotated[
        list[VectorOrNull], about("Tip at each pose; `null` without a stable equilibrium.")
    ]
    tensions_N: Annotated[list[list[float]], about("Tensions of all tendons at each pose.")]
    without_equilibrium: Annotated[int, about("Number of poses without a stable equilibrium.")]
    not_solved: Annotated[
        int,
        about("Number of poses at which the solver gave up, which may have an equilibrium or not."),
    ]
    two_equilibria: Annotated[
        list[bool],
        about("Whether another stable equilibrium was found at the tensions of each pose."),
    ]
    errors: Annotated[list[WorkspaceErrors], about("Errors of each model.")]


class Workspace(OfRobot, WorkspaceValues):
    """Output of `bowstring map --workspace`."""

    text: Annotated[list[str], about("What the map says, in sentences.")]
    file: Annotated[str | None, about("File of the map; `null` if it could not be drawn.")]


class Map(OfRobot, MapValues):
    """Output of `bowstring map` without `--workspace`."""

    text: Annotated[list[str], about("What the map says, in sentences.")]
    file: Annotated[str | None, about("File of the map; `null` if it could not be drawn.")]


class Grid(OfRobot, GridValues):
    """Output of `bowstring map` with more than two `--over`."""

    text: Annotated[list[str], about("What the map says, in sentences.")]
    file: Annotated[str | None, about("File of the map; `null` if it could not be drawn.")]


class StoredValues(Object):
    """A map computed in blocks."""

    points: Annotated[int, about("Number of points.")]
    blocks: Annotated[int, about("Number of blocks.")]
    folder: Annotated[str, about("Folder of the blocks.")]
    text: Annotated[list[str], about("What the map says, in sentences; of up to 5 million points.")]
    file: Annotated[
        str | None,
        about("Data set of the map, NetCDF or Zarr, or its figure; `null` if it is not drawn."),
    ]


class StoredMap(OfRobot, StoredValues):
    """Output of `bowstring map --store`."""


class Statistics(Object):
    """Statistics of an output over samples; `null` where it is infinite."""

    mean: Annotated[OrNull, about("Mean.")]
    sd: Annotated[OrNull, about("Standard deviation.")]
    quantiles: Annotated[dict[str, OrNull], about("Quantiles by probability.")]
    probability: Annotated[
        OrNull, about("Probability that the tolerance holds; `null` for the limit.")
    ]
    without_result_percent: Annotated[float, about("Share of the samples without a result.")]


class Indices(Object):
    """Sobol' indices of one factor, with their intervals at 95 %."""

    factor: Annotated[str, about("Uncertain number, or the parameters of a calibration.")]
    first: Annotated[OrNull, about("First-order index: share of the variance alone.")]
    first_interval: Annotated[Interval, about("Its interval.")]
    total: Annotated[OrNull, about("Total index: share with all interactions.")]
    total_interval: Annotated[Interval, about("Its interval.")]


class SpreadValues(Object):
    """Validity limit and error of one model of constant curvature over samples."""

    name: Annotated[str, about("Model, as `--model` takes it.")]
    tolerance_percent: Annotated[float, about("Tolerated tip error in percent of the length.")]
    max_tension_N: Annotated[float, about("End of the sweep.")]
    nominal_limit_N: Annotated[
        OrNull,
        about(
            "Validity limit of the nominal robot; `null` where all loads hold, or where it has no "
            "result."
        ),
    ]
    nominal_solved: Annotated[
        bool,
        about(
            "Whether the nominal robot is solved to its limit or the end of the sweep; if not, its "
            "limit is the last load that is solved."
        ),
    ]
    not_solved_percent: Annotated[
        float,
        about(
            "Share of the samples that are not solved to their limit or the end of the sweep; "
            "their limit is the last load that is solved."
        ),
    ]
    exceeded_at_first_load_percent: Annotated[
        float, about("Share of the samples whose error is above the tolerance at 0 N already.")
    ]
    samples: Annotated[int, about("Number of samples of the statistics.")]
    limit: Annotated[Statistics, about("Validity limit in N.")]
    error: Annotated[Statistics, about("Tip error at the end of the sweep, percent of length.")]
    limit_indices: Annotated[list[Indices], about("Of the limit; empty where few are finite.")]
    error_indices: Annotated[list[Indices], about("Of the error at the end of the sweep.")]
    text: Annotated[list[str], about("What the samples say, in sentences.")]


class Uncertainty(OfRobot, SpreadValues):
    """Output of `bowstring uncertainty`."""

    file: Annotated[str | None, about("Figure; `null` if it could not be drawn.")]
