"""Protocol of a data set in the suite: tables, metrics, models and published figures, as YAML.

A set is a folder with ``protocol.yaml``, ``robot.yaml`` (unless the protocol names a built-in
robot) and ``mapping.yaml`` (unless the data set has a built-in one).
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from bowstring.calibration.pieces import Loss
from bowstring.data import datasets
from bowstring.data.columns import TOOL, Source, did_you_mean
from bowstring.data.field_messages import Fields, checked
from bowstring.data.mapping import Mapping, load_mapping, mapping_names
from bowstring.errors import InputError
from bowstring.formatting import listed
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot, robot_names
from bowstring.robot.safe_yaml import read_yaml, reading, text_of
from bowstring.suite.metrics import METRICS, Metric
from bowstring.suite.tables import READERS, Table
from bowstring.units import Count, Quantity, Text, printable, quote, read_number, wrong

_BUILT_IN: Final = Path(__file__).with_name("sets")
_ROBOT: Final = "robot.yaml"
_MAPPING: Final = "mapping.yaml"
_FILE: Final = "protocol.yaml"
#: Fields of a protocol on which the results of all models depend.
_OF_DATA: Final = {"reader", "train", "validation", "leave_out", "metrics", "markers"}

Column = Literal["cc", "cc_calibrated", "rod", "rod_calibrated"]
COLUMNS: Final[dict[Column, str]] = {
    "cc": "CC",
    "cc_calibrated": "CC fitted",
    "rod": "rod",
    "rod_calibrated": "rod fitted",
}
"""Columns of models in the table of the suite, and their titles; CC is constant curvature."""


def _metric(name: str) -> str:
    if name not in METRICS:
        hint = did_you_mean(name, list(METRICS))
        raise wrong(f"got {quote(name)}; {hint}must be one of {', '.join(METRICS)}")
    return name


def _start(value: object) -> object:
    """Texts of initial values as numbers in SI."""
    if not isinstance(value, dict):
        raise wrong(f"got {quote(value)}; must be parameters and their values in SI")
    found = {}
    for name, text in value.items():
        try:
            found[name] = read_number(str(text), "")
        except ValueError as error:
            raise wrong(f"{name}: got {quote(text)}, {error}; write a number in SI") from None
    return found


Word = Annotated[str, Text(60, "rod")]
Sentence = Annotated[str, Text(500, "Published in the repository")]
MetricName = Annotated[str, AfterValidator(_metric)]


class Marker(Fields):
    """Measured point of a row, on a disk of the robot.

    Attributes
    ----------
    at : float
        Arc length of the disk on which it is, m.
    offset : tuple of 3 floats
        Position of the marker in the frame of the disk, m.
    """

    at: Annotated[float, Quantity("m", "129.1 mm", "0 m", "1000 m")]
    offset: Annotated[tuple[float, float, float], TOOL] = (0.0, 0.0, 0.0)


class Model(Fields):
    """Model that predicts the rows.

    Attributes
    ----------
    name : str
        Name, unique in the set.
    model : {"constant_curvature", "rod", "arcs"}
        Constant curvature from the commands, the rod, or `pieces` arcs of equal length fitted to
        each measured shape, which is a bound on constant curvature and no prediction.
    column : str or None
        Column of the table, one of `COLUMNS`; without one it is in the files only.
    label : str
        Model in words.
    parameters : tuple of str
        Fitted parameters, as of `bowstring.fit`.
    start : dict
        Initial and held values in SI, as of `bowstring.fit`.
    changes : dict
        Changed fields of the robot file; ``set`` in the protocol.
    loss : {"linear", "soft_l1", "huber"}
        Loss of the fit.
    pieces : int
        Number of arcs of ``arcs``.
    correction : {"residual", "one_row_ahead"} or None
        Correction of the fitted model: a residual that is learnt from the rows of training, or a
        filter, which predicts each row from the measured tips before it.
    """

    name: Word
    model: Literal["constant_curvature", "rod", "arcs"]
    column: Column | None = None
    label: Sentence
    parameters: tuple[Word, ...] = ()
    start: Annotated[dict[str, float], BeforeValidator(_start)] = Field(default_factory=dict)
    changes: dict[str, str] = Field(default_factory=dict, alias="set")
    loss: Loss = "linear"
    pieces: Annotated[int, Count(100, "2")] = 1
    correction: Literal["residual", "one_row_ahead"] | None = None

    @model_validator(mode="after")
    def _check(self) -> Model:
        if self.model == "arcs" and (self.parameters or self.changes or self.start):
            raise wrong("model: arcs are fitted to each shape; leave out parameters, start and set")
        if self.model != "arcs" and self.pieces != 1:
            raise wrong("pieces: of arcs only")
        if self.correction is not None and not self.parameters:
            raise wrong("correction: of a fitted model only; give parameters")
        if self.correction is not None and self.column is not None:
            raise wrong("correction: the columns are of models alone; leave out column")
        return self


class Figure(Fields):
    """Published figure, in the unit of its metric.

    Attributes
    ----------
    by : {"authors", "learner", "other"}
        Model of the authors of the data, one that learns from data, or another one, which is in
        files and figures only.
    metric : str
        Name of the metric.
    value : float
        Value in the unit of the metric; in a protocol with this unit.
    what, source : str
        Model, and where the figure is published; rows other than those of the table are named.
    in_table : bool
        Whether it is shown in the table; others are in the files only.
    """

    by: Literal["authors", "learner", "other"]
    metric: MetricName
    value: float
    what: Sentence
    source: Sentence
    in_table: bool = True

    @model_validator(mode="before")
    @classmethod
    def _unit(cls, value: Any) -> Any:
        """Take the unit off the value."""
        if not isinstance(value, dict) or not isinstance(value.get("value"), str):
            return value
        metric = METRICS.get(str(value.get("metric")))
        if metric is None:
            return value
        number, _, unit = value["value"].strip().partition(" ")
        if unit.strip() != metric.unit:
            raise wrong(f"value: got {quote(value['value'])}; must be a number of {metric.unit}")
        return {**value, "value": number}


class Protocol(Fields):
    """Protocol of one data set.

    Attributes
    ----------
    description : str
    data : str or None
        Name of a public data set; None: tables are files in the folder of the set.
    robot : str or None
        Name of a built-in robot; None: ``robot.yaml`` in the folder.
    reader : str
        ``mapping``, or a reader of `bowstring.suite.tables.READERS` for tables that no mapping
        describes.
    train : str
        Table to which parameters are fitted.
    validation : str or None
        Table that is predicted.
    leave_out : {"row", "group"} or None
        In place of a table for validation: each row, or each group of rows, is predicted by a fit
        to the others.
    metrics : tuple of str
        Names of metrics of one observable.
    markers : tuple of Marker
        Disks of the measured points, for metrics of markers.
    models : tuple of Model
    published : tuple of Figure
    without : dict
        Why a column has no model, by column.
    """

    description: Sentence
    data: Word | None = None
    robot: Word | None = None
    reader: Literal["mapping", "sorosim_statics"] = "mapping"
    train: Annotated[str, Text(200, "train")]
    validation: Annotated[str | None, Text(200, "val")] = None
    leave_out: Literal["row", "group"] | None = None
    metrics: tuple[MetricName, ...] = Field(min_length=1)
    markers: tuple[Marker, ...] = ()
    models: tuple[Model, ...] = Field(min_length=1)
    published: tuple[Figure, ...] = ()
    without: dict[Column, Sentence] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check(self) -> Protocol:
        if self.data is not None and self.data not in datasets.available():
            hint = did_you_mean(self.data, datasets.available())
            raise wrong(
                f"data: got {quote(self.data)}; {hint}must be one of "
                f"{', '.join(datasets.available())}, or left out for files in the folder of the set"
            )
        if self.robot is not None and self.robot not in robot_names():
            raise wrong(
                f"robot: got {quote(self.robot)}; must be one of {', '.join(robot_names())}, or "
                "left out for robot.yaml in the folder of the set"
            )
        kinds = {METRICS[name].observable for name in self.metrics}
        if len(kinds) > 1:
            raise wrong(f"metrics: {' and '.join(sorted(kinds))}; all must be of one observable")
        if "markers" in kinds and not self.markers:
            raise wrong("markers: missing; give the arc length and offset of each measured point")
        if self.validation is not None and self.leave_out is not None:
            raise wrong("validation and leave_out: give one")
        if self.validation is None and self.leave_out is None:
            for model in self.models:
                if model.parameters:
                    raise wrong(
                        f"model {model.name} is fitted, and no other rows judge it; give "
                        "validation, a table, or leave_out: row"
                    )
        for what, names in (
            ("name", [model.name for model in self.models]),
            ("column", [str(model.column) for model in self.models if model.column]),
        ):
            if twice := [name for name in names if names.count(name) > 1]:
                raise wrong(f"models: two have the {what} {twice[0]}")
        for model in self.models:
            if model.correction is not None and (kinds != {"tip"} or self.validation is None):
                raise wrong(
                    f"models: {model.name} has a correction, which is of tips in a table of "
                    "validation"
                )
            if "bend" in kinds and model.model == "arcs":
                raise wrong("models: arcs are fitted to shapes, and the metrics are of bends")
            if "shape" in kinds and model.model != "arcs":
                raise wrong(f"models: {model.name} predicts no shape; give a metric of the tip")
        return self


@dataclass(frozen=True)
class SuiteSet:
    """A data set of the suite with its robot, mapping and protocol; made by `read_set`."""

    name: str
    """Name of its folder."""
    folder: Path
    """Folder of its files."""
    protocol: Protocol
    """Protocol."""
    robot: Robot | None
    """Robot before any fit; None for arcs of shapes alone."""
    mapping: Mapping | None
    """Mapping of its tables; None with a reader of its own."""

    @property
    def kind(self) -> Source:
        """Whether its rows are measured, synthetic or computed."""
        if self.protocol.data is not None:
            return datasets.describe(self.protocol.data).kind
        return "computed" if self.mapping is None else self.mapping.source

    @property
    def metrics(self) -> dict[str, Metric]:
        """Metrics by name."""
        return {name: METRICS[name] for name in self.protocol.metrics}

    def file(self, table: str) -> Path:
        """File of a table, downloaded if needed, its hash checked.

        Parameters
        ----------
        table : str
            Part or file of the public data set, or file in the folder of the set.

        Returns
        -------
        Path
            Path of the file.

        Raises
        ------
        InputError
            If it is not available.
        """
        if self.protocol.data is None:
            found = self.folder / table
            if not found.is_file():
                raise InputError(f"set {self.name}: there is no file {table} in {self.folder}")
            return found
        if self.protocol.reader == "mapping":
            return datasets.table(self.protocol.data, table)
        return datasets.path(self.protocol.data) / table

    def table(self, table: str) -> Table:
        """Read one of its tables.

        Parameters
        ----------
        table : str
            As for `file`.

        Returns
        -------
        Table
            Its rows.

        Raises
        ------
        InputError
            If it is not available or not valid.
        """
        read = READERS[self.protocol.reader]
        found = read(self.file(table), self.robot, self.mapping)
        markers = self.protocol.markers
        count = found.data.points.shape[1]
        if markers and count != len(markers):
            raise InputError(
                f"set {self.name}: the protocol has {len(markers)} markers, {table} has "
                f"{count} points in a row"
            )
        return found

    @cached_property
    def hash(self) -> str:
        """SHA-256 of its tables and its files, as hex.

        Raises
        ------
        InputError
            If a table is not available.
        """
        digest = hashlib.sha256()
        for table in filter(None, (self.protocol.train, self.protocol.validation)):
            file = self.file(table)
            files = [file]
            if self.mapping is not None and self.mapping.join is not None:
                files.append(file.parent / self.mapping.join.file)
            for each in filter(Path.is_file, files):  # reading names a file that is missing
                digest.update(hashlib.sha256(each.read_bytes()).digest())
        digest.update(b"" if self.robot is None else self.robot.hash.encode())
        mapping = "" if self.mapping is None else self.mapping.model_dump_json()
        digest.update(mapping.encode())
        digest.update(self.protocol.model_dump_json(include=_OF_DATA).encode())
        return digest.hexdigest()


def built_in_sets() -> list[Path]:
    """Folders of the sets that come with Bowstring, by name."""
    return sets_in(_BUILT_IN)


def sets_in(folder: Path) -> list[Path]:
    """Folders of the sets in a folder, by name.

    Parameters
    ----------
    folder : Path
        Folder of sets.

    Returns
    -------
    list of Path
        Folders with a protocol.

    Raises
    ------
    InputError
        If there is none.
    """
    with reading(f"Folder {printable(str(folder))}"):
        found = sorted(path.parent for path in folder.glob(f"*/{_FILE}"))
    if not found:
        raise InputError(
            f"{printable(str(folder))} has no set; a set is a folder in it with {_FILE}, "
            "robot.yaml and mapping.yaml"
        )
    return found


def read_set(folder: str | Path) -> SuiteSet:
    """Read a set of the suite.

    Parameters
    ----------
    folder : str or Path
        Folder with ``protocol.yaml``, ``robot.yaml`` and ``mapping.yaml``.

    Returns
    -------
    SuiteSet
        The set, its robot and mapping read.

    Raises
    ------
    InputError
        If a file is missing or not valid; the message lists all problems with their fields.
    """
    place = Path(folder)
    label = f"Protocol of {printable(place.name)}"
    _check_inside(place, label, {"file": _FILE, "robot": _ROBOT, "mapping": _MAPPING})
    with reading(label):
        text = text_of(place / _FILE, label, "protocol")
    protocol = checked(Protocol, read_yaml(text, label, "protocol", "train"), label)
    needs_robot = any(model.model != "arcs" for model in protocol.models)
    robot = load_robot(protocol.robot or place / _ROBOT) if needs_robot else None
    mapping = None
    if protocol.reader == "mapping":
        own = place / _MAPPING
        named = protocol.data if protocol.data in mapping_names() and not own.exists() else None
        mapping = load_mapping(named or own)
    tables = {"train": protocol.train, "validation": protocol.validation}
    if mapping is not None and mapping.join is not None:
        beside = Path(protocol.train).parent / mapping.join.file
        tables["join.file of the mapping"] = str(beside)
    given = {field: name for field, name in tables.items() if name is not None}
    _check_inside(None if protocol.data else place, label, given)
    found = SuiteSet(place.name, place, protocol, robot, mapping)
    if robot is not None:
        for model in protocol.models:
            changed = robot.with_(model.changes)
            for marker in protocol.markers:
                marker_disk(changed, marker, place.name)
    return found


def _check_inside(folder: Path | None, label: str, names: dict[str, str]) -> None:
    """Refuse file names, given by field, that lead out of the folder of a set.

    Links are followed. `folder` is None for public data, of which the names alone are checked.
    """
    for field, name in names.items():
        inside = not os.path.isabs(name) and Path(os.path.normpath(name)).parts[:1] != ("..",)
        if inside and folder is not None:
            try:
                inside = (folder / name).resolve().is_relative_to(folder.resolve())
            except (OSError, RuntimeError, ValueError):  # links in a circle, or no valid name
                inside = False
        if not inside:
            raise InputError(
                f"{label}: {field}: got {quote(name)}, which is outside the folder of its data; "
                "name a file in it"
            )


def marker_disk(robot: Robot, marker: Marker, name: str = "") -> int:
    """Index of the disk on which a marker is.

    Parameters
    ----------
    robot : Robot
        Robot with the disk.
    marker : Marker
        The marker.
    name : str
        Name of the set for the message.

    Returns
    -------
    int
        Index from the base.

    Raises
    ------
    InputError
        If there is no disk at its arc length.
    """
    apart = abs(robot.disks.station_m - marker.at)
    nearest = int(apart.argmin())
    if apart[nearest] > 1e-9 * robot.length:
        stations = [f"{1e3 * station:g}" for station in robot.disks.station_m]
        raise InputError(
            f"set {name}: a marker is at {1e3 * marker.at:g} mm, where {robot.name} has no disk; "
            f"its disks are at {listed(stations)} mm"
        )
    return nearest
