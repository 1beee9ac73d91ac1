"""Keyword arguments of test cases, converted to the objects that functions take."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bowstring as bs
from bowstring.data import synthetic
from bowstring.data.measurements import Measurements, read_measurements
from bowstring.errors import InputError

_MODEL = ("theory", "tendon_path", "twist", "elements")
_LOAD = ("displacements", "angles", "gravity", "tip_force", "tip_moment")
_INTEGRATOR = (
    "dt",
    "tolerance",
    "spectral_radius",
    "mass_damping",
    "material_damping",
    "modal_damping",
)
_OUTPUT = ("every", "points", "path", "progress")
_START = ("disk_forces", "initial_history")


def objects(**given: Any) -> dict[str, Any]:
    """Return the arguments with those of `Load`, `RodModel` and others collected in such an object.

    Names that begin with ``initial_`` belong to the load at the start.

    """
    start = {name.removeprefix("initial_"): given.pop(name) for name in _START if name in given}
    initial = {name: value for name, value in given.items() if name.startswith("initial_")}
    if initial:
        start["load"] = bs.Load(**{name[len("initial_") :]: v for name, v in initial.items()})
    kinds = (
        ("model", bs.RodModel, _MODEL),
        ("load", bs.Load, _LOAD),
        ("integrator", bs.Integrator, _INTEGRATOR),
        ("output", bs.Output, _OUTPUT),
    )
    out = {name: value for name, value in given.items() if name not in initial}
    for argument, kind, names in kinds:
        mine = {name: out.pop(name) for name in names if name in out}
        if mine:
            out[argument] = kind(**mine)
    if start:
        out["start"] = bs.Start(**start)
    return out


def bench(**given: Any) -> dict[str, Any]:
    """Return arguments of a synthetic bench, those of its objects collected in them."""
    changes = {"actual": "changes", "displacements": "displacements"}
    named = {changes.get(name, name): value for name, value in given.items()}
    out: dict[str, Any] = {}
    for argument, kind in (
        ("loads", synthetic.Loads),
        ("actual", synthetic.Actual),
        ("mounting", synthetic.Mounting),
        ("instrument", synthetic.Instrument),
    ):
        mine = {f.name: named.pop(f.name) for f in fields(kind) if f.name in named}
        if mine or argument == "loads":
            out[argument] = kind(**mine)
    return {**out, **named}


def measured(points: Any, **columns: Any) -> Measurements:
    """Synthetic measurements of tips (K, 3) or points (K, P, 3); commands not given are NaN."""
    points = np.asarray(points, float)
    rows = len(points)
    commands = [columns[name] for name in ("tensions", "displacements") if name in columns]
    none = np.full(np.shape(commands[0]), np.nan)
    given: dict[str, Any] = {
        "source": "synthetic",
        "name": "made",
        "tensions": none,
        "displacements": none,
        "points": points if points.ndim == 3 else points[:, None],
        "line": np.arange(rows),
        "group": np.full(rows, ""),
        "repeat": np.ones(rows, dtype=int),
    }
    return Measurements(**{**given, **columns})


#: The arguments of `synthetic.STUDY` by name.
STUDY_BY_NAME: dict[str, Any] = {
    name: value
    for part in synthetic.STUDY.values()
    for name, value in vars(part).items()
    if value is not None
}


def refused(says: str, call: Callable[[], object]) -> None:
    """Check for a short `InputError` of one line with these words, or of this pattern."""
    with pytest.raises(InputError) as error:
        call()
    text = str(error.value)
    assert (says in text or re.search(says, text)) and "\n" not in text and len(text) < 300, text


def drafted(path: Path, robot: bs.Robot | None = None) -> str:
    """The mapping that is drafted for a table."""
    with pytest.raises(InputError, match="save these lines as map") as error:
        read_measurements(path, robot)
    return str(error.value).partition("\n\n")[2]


def all_sides(count: int = 20) -> Any:
    """Tensions that bend a robot of three tendons in all directions, (count, 3), N."""
    rng = np.random.default_rng(1)
    tensions = rng.uniform(0, 40, (count, 3))
    tensions[np.arange(count), rng.integers(0, 3, count)] = 0.0
    return tensions


def workbook(path: Path, rows: Iterable[Iterable[Any]], **others: Iterable[Iterable[Any]]) -> Path:
    """Write an Excel workbook of rows, and of further sheets by their titles."""
    import openpyxl

    book = openpyxl.Workbook()
    sheets = [book.worksheets[0], *map(book.create_sheet, others)]
    for sheet, cells in zip(sheets, (rows, *others.values()), strict=True):
        for row in cells:
            sheet.append(list(row))
    book.save(path)
    return path


#: Stiffness of the sections of `coupled_robot` without couplings, in N m^2 and N.
PLAIN_STIFFNESS = np.diag([0.06, 0.09, 0.05, 900.0, 900.0, 1500.0])


def coupled_stiffness(seed: int, share: float) -> Any:
    """Random stiffness matrix with couplings of a share of the largest possible."""
    rows = np.random.default_rng(seed).uniform(-1.0, 1.0, (9, 6))
    product = rows.T @ rows
    cosine = product / np.sqrt(np.outer(product.diagonal(), product.diagonal()))
    size = np.sqrt(PLAIN_STIFFNESS.diagonal())
    return np.outer(size, size) * (share * cosine + (1.0 - share) * np.eye(6))


def coupled_robot(
    stiffness: Any, count: int = 5, segments: int = 1, backbone: Any = None, **fields: Any
) -> bs.Robot:
    """A robot of segments of 0.4 m with this stiffness matrix."""
    line = {"mass_per_length": "30 g/m", "rotary_inertia": "0.05 g*mm", **(backbone or {})}
    disks = {"count": count, "mass": "10 g", "radius": "25 mm", "thickness": "2 mm"}
    segment = {
        "length": "0.4 m",
        "backbone": {"stiffness": np.asarray(stiffness).tolist(), **line},
        "disks": {**disks, "clamped_length": 0.0},
        "tendons": {"count": 3, "pitch_radius": "20 mm"},
    }
    given = {"name": "coupled", "segments": [segment] * segments, **fields}
    return bs.Robot.model_validate(given)


def legend_of(panel: Any) -> list[str]:
    """Labels in the legend of axes."""
    return [text.get_text() for text in panel.get_legend().get_texts()]


def followed(commands: Any, half: float, start: Any) -> Any:
    """Play operator of each column, after a start (T,)."""
    out, state = [], start
    for row in commands:
        state = np.clip(state, row - half, row + half)
        out.append(state)
    return np.array(out)
