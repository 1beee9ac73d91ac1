"""Tables of the suite: rows with commands, loads and measured points, in SI."""

from __future__ import annotations

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.data.mapping import Mapping
from bowstring.data.measurements import Measurements, read_measurements
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.statics.load import Load

#: Loads that the tables of a set have by row.
_BY_ROW: Final = ("tensions", "displacements", "gravity", "disk_forces", "disk_moments")


@dataclass(frozen=True, eq=False)
class Table:
    """K rows of a set."""

    data: Measurements
    """Commands and points."""
    load: Load | None = None
    """Gravity and loads on disks, each with K rows; None: only the robot's gravity."""

    def __len__(self) -> int:
        return len(self.data)


def rows_of(load: Load, rows: NDArray[Any]) -> Load:
    """Select rows of a load by booleans (K,) or indices."""
    given = {name: getattr(load, name) for name in _BY_ROW}
    return replace(
        load,
        **{name: value[rows] for name, value in given.items() if isinstance(value, np.ndarray)},
    )


def _mapped(path: Path, robot: Robot | None, mapping: Mapping | None) -> Table:
    assert mapping is not None
    checked = None if mapping.tendons is None else robot  # shapes need no commands
    return Table(read_measurements(path, checked, mapping))


def _sorosim_statics(path: Path, robot: Robot | None, mapping: Mapping | None) -> Table:
    """Read shapes of a rod under wrenches, computed by SoRoSim and written by opencr-mujoco.

    Six rows a shape: rotation (or moment), then position (or force), for the stations of two
    halves. No mapping describes this, because each row of a mapping is one measurement, and
    gravity and wrenches differ from shape to shape.
    """
    try:
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.reader(file))
        labels = lines[0][1:]
        numbers = np.array([[float(cell) for cell in line[1:]] for line in lines[2:]])
        shapes = numbers.reshape(-1, 2, 3, len(labels))
        column = {name: shapes[..., labels.index(name)] for name in labels}
        wrenches = [column[name] for name in ("mid_wrench", "tip_wrench")]
        gravity = column["gravity"][:, 1]
    except (ValueError, LookupError, csv.Error):
        raise InputError(f"{path} is not a table of static shapes by SoRoSim") from None
    to_base = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
    # the first station of the second half is the last one of the first
    stations = [n for n in labels if n.startswith("seg") and n != "seg2_s01"]
    points = np.stack([column[name][:, 1] for name in stations], axis=1) @ to_base.T
    assert robot is not None
    count, none = len(shapes), np.full((len(shapes), robot.core.tendon_count), np.nan)
    data = Measurements(
        source="computed",
        name="sorosim-rods",
        tensions=np.zeros_like(none),
        displacements=none,
        points=points,
        line=3 + 6 * np.arange(count),
        group=np.full(count, ""),
        repeat=np.ones(count, dtype=np.int64),
        path=path,
    )
    load = Load(
        gravity=gravity @ to_base.T,
        disk_forces=np.stack([each[:, 1] @ to_base.T for each in wrenches], axis=1),
        disk_moments=np.stack([each[:, 0] @ to_base.T for each in wrenches], axis=1),
    )
    return Table(data, load)


READERS: Final[dict[str, Callable[[Path, Robot | None, Mapping | None], Table]]] = {
    "mapping": _mapped,
    "sorosim_statics": _sorosim_statics,
}
"""Readers of tables by the name that a protocol gives."""
