"""The tables of a study: names, columns with their units, rows; and how they go to CSV."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.data.tip_errors import Comparison
from bowstring.study.comparison import Case
from bowstring.study.shapes import backbones
from bowstring.study.study import Study

if TYPE_CHECKING:
    from bowstring.study.data_validation import AgainstData

__all__ = ["simulated", "study_tables", "write_csv"]

Cell = str | float | int | None

_AXES: Final = ("x", "y", "z")


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([_csv_cell(cell) for cell in row] for row in rows)


def _csv_cell(cell: Cell) -> str:
    """Numbers to nine significant digits; a missing one is an empty field."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell + 0.0:.9g}" if math.isfinite(cell) else ""
    return str(cell)


def study_tables(study: Study) -> Iterable[tuple[str, list[str], list[Sequence[Cell]]]]:
    """Name, header with units, and rows of every table."""
    tendons = [f"tendon_{t + 1}_length_mm" for t in range(len(study.robot.tendons.segment))]
    position = [f"{axis}_mm" for axis in _AXES]
    tip = [f"tip_{p}" for p in position]
    segments = range(len(study.robot.segments))

    g = study.geometry
    yield (
        "geometric_sweep",
        ["pull_mm", *tendons, *(f"segment_{k + 1}_theta_deg" for k in segments), *tip],
        np.column_stack(
            [
                g.pull * 1e3,
                g.tendon_lengths * 1e3,
                np.degrees(g.theta),
                g.tip_position * 1e3,
            ]
        ).tolist(),
    )
    yield (
        "geometric_configurations",
        ["pull_mm", "disk", *position],
        [
            [pull * 1e3, disk + 1, *(point * 1e3).tolist()]
            for pull, disks in zip(g.pull.tolist(), g.disk_positions, strict=True)
            for disk, point in enumerate(disks)
        ],
    )

    s = study.statics
    surface = list(s.surface.to_dict())
    yield (
        "statics",
        ["tension_N", "status", *tip, *tendons, "pull_mm", "linear_law_pull_mm", *surface],
        [
            [tension, status, *rest]
            for tension, status, rest in zip(
                s.tension.tolist(),
                s.status,
                np.column_stack(
                    [
                        s.tip_position * 1e3,
                        s.tendon_lengths * 1e3,
                        s.pull * 1e3,
                        s.linear_pull * 1e3,
                        *s.surface.to_dict().values(),
                    ]
                ).tolist(),
                strict=True,
            )
        ],
    )
    yield (
        "statics_configurations",
        ["tension_N", "disk", *position],
        [
            [tension, disk + 1, *(point * 1e3).tolist()]
            for tension, disks in zip(s.tension.tolist(), s.disk_positions, strict=True)
            for disk, point in enumerate(disks)
        ],
    )

    found = backbones(study)
    yield (
        "backbones",
        ["name", "tension_N", "disk", *position, "from_statics_mm"],
        [
            [shape.name, found.tension, disk + 1, *(point * 1e3).tolist(), float(away) * 1e3]
            for shape in found.shapes
            for disk, (point, away) in enumerate(zip(shape.disks, shape.from_statics, strict=True))
        ],
    )

    motion = study.dynamics
    if motion is not None:
        yield (
            "dynamics",
            [
                "time_s",
                "tension_N",
                *tip,
                *(f"statics_{p}" for p in tip),
                "difference_mm",
                "tip_displacement_mm",
                *surface,
            ],
            np.column_stack(
                [
                    motion.time,
                    motion.tension,
                    motion.tip_position * 1e3,
                    motion.static_tip * 1e3,
                    motion.difference * 1e3,
                    motion.displacement * 1e3,
                    *motion.surface.to_dict().values(),
                ]
            ).tolist(),
        )

    axis_means = [f"mean_{axis}_mm" for axis in _AXES]
    yield (
        "comparisons",
        ["name", "against", "n", "mean_mm", "max_mm", "rms_mm", "mean_percent", *axis_means],
        [
            [
                d["name"],
                d["against"],
                d["n"],
                d["mean_mm"],
                d["max_mm"],
                d["rms_mm"],
                d["mean_percent"],
                *d["mean_by_axis_mm"],
            ]
            for d in (c.to_dict() for c in simulated(study))
        ],
    )
    yield (
        "errors",
        [
            "name",
            "against",
            "tension_N",
            *tip,
            *(f"d{p}" for p in position),
            "error_mm",
            "error_percent",
        ],
        [
            [c.name, c.against, *row]
            for c in simulated(study)
            for row in np.column_stack(
                [
                    s.tension,
                    c.tip_position * 1e3,
                    c.difference * 1e3,
                    c.error * 1e3,
                    c.error / c.length * 100.0,
                ]
            ).tolist()
        ],
    )
    if study.data is not None:
        yield from _data_tables(study.data)
    v = study.verdict
    yield (
        "verdict_sweep",
        ["tension_N", *(f"{name}_error_mm" for name in v.fine_error)],
        np.column_stack([v.fine_tension, *(e * 1e3 for e in v.fine_error.values())]).tolist(),
    )
    yield "budget", *_budget_table(study)
    yield "drive", *_drive_table(study)
    for loop in study.budget.drive.loops:
        d = loop.to_dict()
        command = "tension_N" if loop.driven_by == "tension" else "pull_mm"
        kinds = ("free", "loading", "unloading", "constant_curvature")
        yield (
            f"hysteresis_by_{loop.driven_by}",
            [command, *(f"{kind}_{p}" for kind in kinds for p in tip), "apart_mm"],
            np.column_stack(
                [d[command], *(d[f"tip_{kind}_mm"] for kind in kinds), loop.apart * 1e3]
            ).tolist(),
        )


def simulated(study: Study) -> list[Comparison]:
    """Comparisons with simulations, which have the loads of the sweep."""
    return [c for c in study.comparisons if c.against != "measurement"]


def _data_tables(found: AgainstData) -> Iterable[tuple[str, list[str], list[Sequence[Cell]]]]:
    """Tables of the verdict on data; each row says what the data are."""
    position = [f"{axis}_mm" for axis in _AXES]
    data, loads = found.data, found.loads
    models = [found.comparison(name) for name in found.models]
    ways = {True: "loading", False: "unloading"}
    header = ["source", "line", "run", "way", *(f"tension_{t + 1}_N" for t in _of(data.tensions))]
    header += [f"pull_{t + 1}_mm" for t in _of(data.pulls)]
    header += [f"measured_{p}" for p in position] + [f"registered_{p}" for p in position]
    header += [f"{c.name}_{p}" for c in models for p in position]
    numbers = np.column_stack(
        [
            data.tensions[:, _of(data.tensions)],
            data.pulls[:, _of(data.pulls)] * 1e3,
            data.tip * 1e3,
            found.point * 1e3,
            *(c.tip_position * 1e3 for c in models),
        ]
    ).tolist()
    yield (
        "measured",
        header,
        [
            [data.source, line, run + 1, ways[bool(up)] if loads.single else None, *row]
            for line, run, up, row in zip(
                data.line.tolist(), loads.run.tolist(), loads.loading, numbers, strict=True
            )
        ],
    )
    header = ["source", "name", "frame", "registered", "n", "mean_mm", "mean_low_mm"]
    header += ["mean_high_mm", "max_mm", "rms_mm", "mean_percent"]
    header += [f"{kind}_{p}" for kind in ("mean", "max") for p in position]
    rows: list[Sequence[Cell]] = []
    for c in found.comparisons:
        d = c.to_dict()
        rows.append(
            [
                data.source,
                c.name,
                c.frame,
                "yes" if c.registered else "no",
                c.n,
                d["mean_mm"],
                *d["interval_95"]["mean_mm"],
                *(d[k] for k in ("max_mm", "rms_mm", "mean_percent")),
                *d["mean_by_axis_mm"],
                *d["max_by_axis_mm"],
            ]
        )
    yield "measured_comparisons", header, rows
    if found.effects:
        steps = [effect.to_dict() for effect in found.effects]
        first: list[Cell] = [data.source, "none", "none of the below", found.plain * 1e3]
        yield (
            "measured_decomposition",
            ["source", *(k for k in steps[0] if "interval" not in k)],
            [first, *([data.source, *_plain_cells(step)] for step in steps)],
        )


def _plain_cells(step: dict[str, Any]) -> list[Cell]:
    return [value for key, value in step.items() if "interval" not in key]


def _of(commands: Any) -> list[int]:
    """Tendons that are driven so."""
    return [int(t) for t in np.flatnonzero(~np.isnan(commands).all(axis=0))]


def _budget_table(study: Study) -> tuple[list[str], list[Sequence[Cell]]]:
    names = list(study.verdict.fine_error)
    header = ["effect", "case", "problem", "tip_moved_mean_mm", "tip_moved_max_mm"]
    for name in names:
        header += [f"{name}_{what}" for what in ("n", "mean_mm", "max_mm", "mean_percent")]
        header += [f"{name}_contribution_{what}" for what in ("n", "mm", "percent")]

    def row(effect: str, what: str, d: dict[str, Any]) -> list[Cell]:
        cells: list[Cell] = [effect, what, d["problem"]]
        cells += [d.get("tip_moved_mean_mm"), d.get("tip_moved_max_mm")]
        for name in names:
            e = d[name]
            cells += [e["n"], e["mean_mm"], e["max_mm"], e["mean_percent"]]
            cells += [e.get(f"contribution_{what}") for what in ("n", "mm", "percent")]
        return cells

    b = study.budget.to_dict()
    rows = [
        row("", "plainest", b["plainest"]),
        row("", "fullest", b["fullest"]),
        row("", "this sweep", b["sweep"]),
    ]
    for r in b["rows"]:
        rows.append(row(r["effect"], "added to plainest", r["added"]))
        rows.append(row(r["effect"], "fullest with it", r["full"]))
        rows.append(row(r["effect"], "removed from fullest", r["removed"]))
        to = {"added": "added to", "removed": "removed from"}[r["in_sweep"]["how"]]
        rows.append(row(r["effect"], f"{to} this sweep", r["in_sweep"]))
    return header, list(rows)


def _drive_table(study: Study) -> tuple[list[str], list[Sequence[Cell]]]:
    header = ["effect", "driven_by", "assumed", "name", "problem", "n", "mean_mm", "max_mm"]
    header += ["mean_percent", "change_of_mean_mm", "tip_moved_mean_mm", "tip_moved_max_mm"]
    drive = study.budget.drive
    rows: list[Sequence[Cell]] = []
    cases: list[tuple[str, str, str, Case, Case | None]] = [
        ("", "tension", "", drive.tension_driven, None),
        ("", "pull", "", drive.pull_driven, None),
    ]
    cases += [(r.effect, r.driven_by, " ".join(r.assumed), r.case, r.base) for r in drive.rows]
    for effect, driven_by, assumed, case, base in cases:
        d = case.to_dict(base)
        for name in case.comparisons:
            e = d[name]
            cells: list[Cell] = [effect, driven_by, assumed, name, d["problem"]]
            cells += [e["n"], e["mean_mm"], e["max_mm"], e["mean_percent"]]
            cells += [e.get("change_of_mean_mm")]
            cells += [d.get("tip_moved_mean_mm"), d.get("tip_moved_max_mm")]
            rows.append(cells)
    return header, rows
