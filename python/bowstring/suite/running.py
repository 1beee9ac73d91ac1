"""Runs of the models of one set, with results kept by the hash of their inputs."""

from __future__ import annotations

import hashlib
import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np

import bowstring._core as _core
from bowstring.aliases import Floats, Progress
from bowstring.calibration.observations import numbered
from bowstring.data.columns import Source
from bowstring.errors import BowstringError, InputError
from bowstring.files.atomic_io import file_stem, user_cache, write_whole_file
from bowstring.files.json_files import Content, read_json, structured
from bowstring.files.result_folder import write_json
from bowstring.results import Key, Result
from bowstring.suite.prediction import Fitted, arcs_of_shapes, errors_of, fitted, observed
from bowstring.suite.protocol import Column, Figure, Model, SuiteSet
from bowstring.suite.tables import Table

_FORM: Final = 1  # version of the kept results
_MOST_KEPT: Final = 10_000_000  # bytes


@dataclass(frozen=True)
class SuiteScore(Result):
    """Metrics of a model on some rows, in their units."""

    rows: Annotated[int, Key()]
    """Number of rows that the metrics include: those with a prediction."""
    without_solution: Annotated[int, Key("rows_without_solution")]
    """Number of rows without a solution, which no metric includes."""
    values: Annotated[Mapping[str, float], Key()]
    """Value by name of the metric, in the unit of the metric; NaN without any prediction."""


@dataclass(frozen=True)
class ModelResult(Result):
    """Result of one model of a set."""

    model: Model
    """Model of the protocol."""
    validation: Annotated[SuiteScore, Key()]
    """Rows that were not fitted; of ``arcs``, all rows."""
    train: Annotated[SuiteScore | None, Key()]
    """Rows of the fit; None for a model without parameters."""
    values: Annotated[Mapping[str, float], Key("parameters")]
    """Values by name, fitted to all rows of training, in SI."""
    converged: Annotated[bool, Key()]
    """Whether all fits converged."""
    message: Annotated[str, Key()]
    """Message of the fit to all rows of training; empty without parameters."""
    seconds: Annotated[float, Key("time_s")]
    """Time of its computation, s."""

    @property
    def name(self) -> Annotated[str, Key()]:
        """Name of the model in its set."""
        return self.model.name

    @property
    def kind(self) -> Annotated[Literal["constant_curvature", "rod", "arcs"], Key("model")]:
        """Kind of model; ``arcs`` are fitted to each measured shape and predict nothing."""
        return self.model.model

    @property
    def column(self) -> Annotated[Column | None, Key()]:
        """Column of the table; None without one."""
        return self.model.column

    @property
    def label(self) -> Annotated[str, Key()]:
        """Model in words."""
        return self.model.label


@dataclass(frozen=True)
class MetricOfSet(Result):
    """Metric of a set."""

    name: Annotated[str, Key()]
    """Name, as in the protocol."""
    label: Annotated[str, Key()]
    """Metric in words."""
    unit: Annotated[str, Key()]
    """Unit of its values."""


@dataclass(frozen=True)
class PublishedFigure(Result):
    """Published figure."""

    by: Annotated[Literal["authors", "learner", "other"], Key()]
    """Model of the authors of the data, one that learns from data, or another one."""
    metric: Annotated[str, Key()]
    """Name of the metric."""
    value: Annotated[float, Key()]
    """Value in the unit of the metric."""
    what: Annotated[str, Key()]
    """Model in words."""
    source: Annotated[str, Key()]
    """Source of the figure, and its rows."""


@dataclass(frozen=True)
class SetResult(Result):
    """Results of all models of a set."""

    given: SuiteSet
    """The set."""
    models: Annotated[tuple[ModelResult, ...], Key()] = ()
    """Results in the order of the protocol; empty where files are missing."""
    missing: str = ""
    """Why there are none; empty otherwise."""

    @property
    def name(self) -> Annotated[str, Key()]:
        """Name of the set."""
        return self.given.name

    @property
    def kind(self) -> Annotated[Source, Key()]:
        """Whether its rows are measured, synthetic or computed."""
        return self.given.kind

    @property
    def description(self) -> Annotated[str, Key()]:
        """Set in words."""
        return self.given.protocol.description

    @property
    def metrics(self) -> Annotated[list[MetricOfSet], Key()]:
        """Metrics; the first one is that of figures."""
        return [MetricOfSet(name, m.label, m.unit) for name, m in self.given.metrics.items()]

    @property
    def figures(self) -> Annotated[list[PublishedFigure], Key("published")]:
        """Published figures."""
        found = self.given.protocol.published
        return [PublishedFigure(f.by, f.metric, f.value, f.what, f.source) for f in found]

    @property
    def without(self) -> Annotated[dict[str, str], Key()]:
        """Why a column has no model, by column."""
        return {str(column): why for column, why in self.given.protocol.without.items()}

    @property
    def why_missing(self) -> Annotated[str | None, Key("missing")]:
        """Why there are no results; None where all files are available."""
        return self.missing or None

    def model(self, column: Column) -> ModelResult | None:
        """Result of the model in a column of the table."""
        return next((each for each in self.models if each.model.column == column), None)

    def published(self, by: str, metric: str) -> Figure | None:
        """Published figure for the table."""
        figures = self.given.protocol.published
        return next(
            (f for f in figures if (f.by, f.metric, f.in_table) == (by, metric, True)), None
        )


def run_set(given: SuiteSet, *, progress: Progress | None = None) -> SetResult:
    """Run all models of a set; results with the same inputs are taken from the user's cache.

    Parameters
    ----------
    given : SuiteSet
        The set.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    SetResult
        Without results, but with the reason, if the tables are not available.

    Raises
    ------
    BowstringError
        If a table is not valid or a model cannot be evaluated; the message names the set.
    """
    notify = progress or (lambda what, share: None)
    try:
        notify(f"{given.name}: tables", 0.0)
        inputs = given.hash
    except InputError as error:
        return SetResult(given, missing=str(error))
    found: list[ModelResult] = []
    tables: dict[str, Table] = {}
    for k, model in enumerate(given.protocol.models):
        notify(f"{given.name}: {model.name}", k / len(given.protocol.models))
        file = _kept_file(given.name, model, inputs)
        result = _kept(file, model)
        if result is None:
            try:
                if not tables:
                    names = (given.protocol.train, given.protocol.validation)
                    tables = {name: given.table(name) for name in names if name is not None}
                result = _run(given, model, tables)
            except BowstringError as error:
                raise type(error)(f"set {given.name}, {model.name}: {error}") from None
            _keep(file, result)
        found.append(result)
    return SetResult(given, tuple(found))


def _run(given: SuiteSet, model: Model, tables: Mapping[str, Table]) -> ModelResult:
    began = time.perf_counter()
    protocol = given.protocol
    train = tables[protocol.train]
    judged = tables[protocol.validation or protocol.train]
    trained, whole, fits = None, Fitted(lambda table: np.empty(0), {}), []
    if model.model == "arcs":
        predicted = arcs_of_shapes(judged, model.pieces)
    else:
        whole = fitted(given, model, train)
        fits.append(whole)
        if model.parameters:
            trained = _score(given, whole.predict(train), train)
        if model.parameters and protocol.leave_out is not None:
            predicted = _left_out(given, model, train, fits)
        else:
            predicted = whole.predict(judged)
    return ModelResult(
        model,
        _score(given, predicted, judged),
        trained,
        whole.values,
        all(fit.converged for fit in fits),
        whole.message,
        time.perf_counter() - began,
    )


def _left_out(given: SuiteSet, model: Model, table: Table, fits: list[Fitted]) -> Floats:
    """Predict each row, or each group, by a fit to the others; fits are added to the list."""
    labels = table.data.group if given.protocol.leave_out == "group" else table.data.line
    fold = numbered(labels)
    if fold.max(initial=0) < 1:
        raise InputError("leave_out: group needs groups, and all rows are of one")
    out: Floats | None = None
    for number in range(int(fold.max()) + 1):
        fits.append(fitted(given, model, table, fold != number))
        predicted = fits[-1].predict(table)
        if out is None:
            out = np.full_like(predicted, np.nan)
        out[fold == number] = predicted[fold == number]
    assert out is not None
    return out


def _score(given: SuiteSet, predicted: Floats, table: Table) -> SuiteScore:
    metrics = given.metrics
    observable = next(iter(metrics.values())).observable
    measured = observed(table, observable)
    if observable == "tip" and predicted.ndim == 3:  # arcs predict all points
        predicted = predicted[:, -1]
    errors = errors_of(predicted, measured, observable)
    seen = np.isfinite(measured.reshape(len(measured), -1)).all(axis=1)
    solved = seen & np.isfinite(errors.reshape(len(errors), -1)).all(axis=1)
    values = {name: metric(errors[seen]) for name, metric in metrics.items()}
    return SuiteScore(int(solved.sum()), int((seen & ~solved).sum()), values)


# -- kept results ----------------------------------------------------------------------------------


@cache
def _code() -> str:
    """SHA-256 of the package itself: its sources and its compiled core."""
    digest = hashlib.sha256()
    root = Path(_core.__file__).parent
    for file in (*sorted(root.rglob("*.py")), Path(_core.__file__)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _kept_file(name: str, model: Model, inputs: str) -> Path:
    key = hashlib.sha256(f"{_code()} {inputs} {model.model_dump_json()}".encode()).hexdigest()
    stem = file_stem(f"{name}-{model.name}")
    return user_cache() / "suite" / f"{stem}-{key[:32]}.json"


def _keep(file: Path, result: ModelResult) -> None:
    """Write a result, whole or not at all; a cache that cannot be written is no error."""
    content = {"form": _FORM, **result.to_dict()}
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        write_whole_file(file, "result", lambda new: write_json(new, content))
    except (OSError, InputError):
        return


class _KeptScore(Content):
    rows: int
    rows_without_solution: int
    values: dict[str, float | None]


class _KeptResult(Content):
    form: Literal[1]
    validation: _KeptScore
    train: _KeptScore | None
    parameters: dict[str, float]
    converged: bool
    message: str
    time_s: float


def _kept(file: Path, model: Model) -> ModelResult | None:
    """Read a kept result; None if there is none or it is damaged."""
    try:
        content = structured(read_json(file, _MOST_KEPT), _KeptResult)
    except (OSError, ValueError):
        return None
    train = content["train"]
    return ModelResult(
        model,
        _kept_score(content["validation"]),
        None if train is None else _kept_score(train),
        content["parameters"],
        content["converged"],
        content["message"],
        content["time_s"],
    )


def _kept_score(content: _KeptScore) -> SuiteScore:
    values = {name: math.nan if v is None else v for name, v in content["values"].items()}
    return SuiteScore(content["rows"], content["rows_without_solution"], values)
