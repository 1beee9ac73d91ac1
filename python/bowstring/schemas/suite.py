"""JSON of the command suite."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.data.columns import Source
from bowstring.schemas.basic import MadeBy, Object, OrNull, about

Column = Literal["cc", "cc_calibrated", "rod", "rod_calibrated"]


class SuiteScore(Object):
    """Metrics of a model on some rows."""

    rows: Annotated[int, about("Number of rows that the metrics include.")]
    rows_without_solution: Annotated[
        int, about("Number of rows without a solution, which no metric includes.")
    ]
    values: Annotated[
        dict[str, OrNull], about("Value by name of the metric, in the unit of the metric.")
    ]


class SuiteModel(Object):
    """Result of one model of a set."""

    name: Annotated[str, about("Name of the model in its set.")]
    model: Annotated[
        Literal["constant_curvature", "rod", "arcs"],
        about("Kind of model; `arcs` are fitted to each measured shape and predict nothing."),
    ]
    column: Annotated[Column | None, about("Column of the table; `null` for none.")]
    label: Annotated[str, about("Model in words.")]
    validation: Annotated[SuiteScore, about("Rows that were not fitted; of `arcs`, all rows.")]
    train: Annotated[
        SuiteScore | None, about("Rows of the fit; `null` for a model without parameters.")
    ]
    parameters: Annotated[dict[str, float], about("Fitted values by name, in SI.")]
    converged: Annotated[bool, about("Whether all fits converged.")]
    message: Annotated[str, about("Message of the fit; empty without parameters.")]
    time_s: Annotated[float, about("Time of the computation.")]


class SuiteMetric(Object):
    """Metric of a set."""

    name: Annotated[str, about("Name, as in the protocol.")]
    label: Annotated[str, about("Metric in words.")]
    unit: Annotated[str, about("Unit of its values.")]


class SuiteFigure(Object):
    """Published figure."""

    by: Annotated[
        Literal["authors", "learner", "other"],
        about("Model of the authors of the data, one that learns from data, or another one."),
    ]
    metric: Annotated[str, about("Name of the metric.")]
    value: Annotated[float, about("Value in the unit of the metric.")]
    what: Annotated[str, about("Model in words.")]
    source: Annotated[str, about("Source of the figure, and its rows.")]


class SuiteSetResult(Object):
    """Results of one set."""

    name: Annotated[str, about("Name of the set.")]
    kind: Annotated[Source, about("Whether its rows are measured, synthetic or computed.")]
    description: Annotated[str, about("Set in words.")]
    metrics: Annotated[list[SuiteMetric], about("Metrics; the first one is that of figures.")]
    models: Annotated[list[SuiteModel], about("Models; empty where files are missing.")]
    published: Annotated[list[SuiteFigure], about("Published figures.")]
    without: Annotated[dict[str, str], about("Why a column has no model, by column.")]
    missing: Annotated[
        str | None, about("Why there are no results; `null` where all files are available.")
    ]


class SuiteValues(Object):
    """Values of the suite."""

    sets: Annotated[list[SuiteSetResult], about("Results of each set.")]
    ratios: Annotated[
        dict[str, float],
        about(
            "Error of calibrated constant curvature over that of the calibrated rod, by measured "
            "set with a validation of both."
        ),
    ]
    conclusion: Annotated[str, about("Conclusion in one sentence, or empty.")]


class Suite(SuiteValues):
    """Output of `bowstring suite`."""

    folder: Annotated[str | None, about("Folder of `--out`; `null` without it.")]
    provenance: Annotated[MadeBy, about("Version and settings.")]
