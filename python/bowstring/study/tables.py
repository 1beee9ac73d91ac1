"""Tables of a study as CSV: names, columns with units, rows."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.tip_errors import Comparison
from bowstring.study.actuation_budget import COMMANDED
from bowstring.study.comparison import MEANINGS
from bowstring.study.shapes import backbones
from bowstring.study.study import Study

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements
    from bowstring.study.angle_validation import AgainstAngles
    from bowstring.study.data_validation import AgainstData

Cell = str | float | int | None

Table = tuple[str, list[str], list[Sequence[Cell]]]


def write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    """Write a table as CSV in UTF-8; missing and non-finite numbers are empty fields."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows([_csv_cell(cell) for cell in row] for row in rows)


def _csv_cell(cell: Cell) -> str:
    """Format a number with nine significant digits; a missing one is an empty field."""
    if cell is None:
        return ""
    if isinstance(cell, float):
        return f"{cell + 0.0:.9g}" if math.isfinite(cell) else ""
    return str(cell)


def study_tables(study: Study) -> Iterable[Table]:
    """Yield name, header with units, and rows of every table."""
    tendons = [f"tendon_{t + 1}_length_mm" for t in range(len(study.robot.tendons.segment))]
    bends = [f"segment_{k + 1}_theta_deg" for k in range(len(study.robot.segments))]

    g = study.geometry
    yield _table(
        "geometric_sweep",
        ("displacement_mm", g.displacement * 1e3),
        (tendons, g.tendon_lengths * 1e3),
        (bends, np.degrees(g.theta)),
        (_TIP, g.tip_position * 1e3),
    )
    yield _by_disk(
        "geometric_configurations", "displacement_mm", g.displacement * 1e3, g.disk_positions
    )

    s = study.statics
    yield _table(
        "statics",
        ("tension_N", s.tension),
        ("status", s.status),
        (_TIP, s.tip_position * 1e3),
        (tendons, s.tendon_lengths * 1e3),
        ("displacement_mm", s.displacement * 1e3),
        ("linear_law_displacement_mm", s.linear_displacement * 1e3),
        *s.surface.to_dict().items(),
    )
    yield _by_disk("statics_configurations", "tension_N", s.tension, s.disk_positions)

    tension, shapes = backbones(study)
    count = len(shapes[0].disks)
    yield _table(
        "backbones",
        ("name", np.repeat([shape.name for shape in shapes], count)),
        ("tension_N", [tension] * count * len(shapes)),
        ("disk", np.tile(np.arange(1, count + 1), len(shapes))),
        (_POSITION, np.concatenate([shape.disks for shape in shapes]) * 1e3),
        ("from_statics_mm", np.concatenate([shape.from_statics for shape in shapes]) * 1e3),
    )

    motion = study.dynamics
    if motion is not None:
        yield _table(
            "dynamics",
            ("time_s", motion.time),
            ("tension_N", motion.tension),
            (_TIP, motion.tip_position * 1e3),
            (_named("statics_tip"), motion.static_tip * 1e3),
            ("difference_mm", motion.difference * 1e3),
            ("tip_displacement_mm", motion.displacement * 1e3),
            *motion.surface.to_dict().items(),
        )

    comparisons = simulated(study)
    rows: list[Mapping[str, Any]] = [c.to_dict() for c in comparisons]
    keys = ("name", "against", "n", "mean_mm", "max_mm", "rms_mm", "mean_percent")
    yield _table(
        "comparisons",
        *((key, [row[key] for row in rows]) for key in keys),
        (_named("mean"), [row["mean_by_axis_mm"] for row in rows]),
    )
    yield _table(
        "errors",
        ("name", np.repeat([c.name for c in comparisons], len(s.tension))),
        ("against", np.repeat([c.against for c in comparisons], len(s.tension))),
        ("tension_N", np.tile(s.tension, len(comparisons))),
        (_TIP, np.concatenate([c.tip_position for c in comparisons]) * 1e3),
        (_named("d", ""), np.concatenate([c.difference for c in comparisons]) * 1e3),
        ("error_mm", np.concatenate([c.error for c in comparisons]) * 1e3),
        ("error_percent", np.concatenate([c.error / c.length for c in comparisons]) * 100.0),
    )
    rows = [model.to_dict() for model in study.shapes.models]
    yield _table("shapes", *((key, [row[key] for row in rows]) for key in rows[0]))
    if study.data is not None:
        yield from _data_tables(study.data)
    if study.angles is not None:
        yield from _angle_tables(study.angles)
    v = study.verdict
    yield _table(
        "verdict_sweep",
        ("tension_N", v.fine_tension),
        *((f"{name}_error_mm", error * 1e3) for name, error in v.fine_error.items()),
    )
    budget = study.budget.to_dict()
    yield "budget", *_budget_table(budget)
    yield "actuation", *_actuation_table(budget["actuation"])
    for loop in study.budget.actuation.loops:
        d: Mapping[str, Any] = loop.to_dict()
        command = "tension_N" if loop.control == "tension" else "displacement_mm"
        yield _table(
            f"hysteresis_by_{loop.control}",
            (command, d[command]),
            *(
                (_named(f"{kind}_tip"), d[f"tip_{kind}_mm"])
                for kind in ("free", "loading", "unloading", "constant_curvature")
            ),
            ("apart_mm", loop.apart * 1e3),
        )


def _named(of: str, between: str = "_") -> list[str]:
    """Names of columns of coordinates in mm."""
    return [f"{of}{between}{axis}_mm" for axis in "xyz"]


_POSITION: Final = _named("", "")
_TIP: Final = _named("tip")


def _table(name: str, *columns: tuple[str | Sequence[str], Any]) -> Table:
    """Make a table of columns (n,) with names, and blocks of columns (n, k) with k names."""
    header: list[str] = []
    cells: list[list[Cell]] = []
    for names, values in columns:
        block = [names] if isinstance(names, str) else names
        header += block
        cells += np.reshape(values, (len(values), len(block))).T.tolist()
    return name, header, list(zip(*cells, strict=True))


def _by_disk(name: str, load: str, loads: Floats, disks: Floats) -> Table:
    """Make a table of disk positions (n, N, 3), a row for each disk at each load."""
    count = disks.shape[1]
    return _table(
        name,
        (load, np.repeat(loads, count)),
        ("disk", np.tile(np.arange(1, count + 1), len(loads))),
        (_POSITION, np.concatenate(disks) * 1e3),
    )


def simulated(study: Study) -> list[Comparison]:
    """Comparisons with simulations at the loads of the sweep."""
    return [c for c in study.comparisons if c.against != "measurement"]


def _data_tables(found: AgainstData) -> Iterable[Table]:
    """Yield tables of the comparison with data; each row has the source of the data."""
    data, loads = found.data, found.loads
    source = [data.source]
    ways = np.where(loads.loading, "loading", "unloading") if loads.single else None
    yield _table(
        "measured",
        ("source", source * len(data)),
        ("line", data.line),
        ("run", loads.run + 1),
        ("branch", [None] * len(data) if ways is None else ways),
        *_commands(data),
        (_named("measured"), data.tip * 1e3),
        (_named("registered"), found.point * 1e3),
        *((_named(name), found.comparison(name).tip_position * 1e3) for name in found.models),
    )
    rows: list[Mapping[str, Any]] = [c.to_dict() for c in found.comparisons]
    yield _table(
        "measured_comparisons",
        ("source", source * len(rows)),
        *((key, [row[key] for row in rows]) for key in ("name", "frame")),
        ("registered", ["yes" if row["registered"] else "no" for row in rows]),
        *((key, [row[key] for row in rows]) for key in ("n", "mean_mm")),
        (["mean_low_mm", "mean_high_mm"], [row["interval_95"]["mean_mm"] for row in rows]),
        *((key, [row[key] for row in rows]) for key in ("max_mm", "rms_mm", "mean_percent")),
        *((_named(key), [row[f"{key}_by_axis_mm"] for row in rows]) for key in ("mean", "max")),
    )
    if (compared := found.models_compared) is not None:
        from bowstring.calibration.fit_folder import model_rows

        header, *models = model_rows(compared.models, compared.chosen)
        yield (
            "measured_models",
            ["source", *header],
            [[data.source, *(cell or None for cell in row)] for row in models],
        )
    if found.effects:
        steps: list[Mapping[str, Any]] = [effect.to_dict() for effect in found.effects]
        keys = [key for key in steps[0] if "interval" not in key]
        none: list[Cell] = [data.source, "none", "none of the below", found.baseline_mean * 1e3]
        yield (
            "measured_decomposition",
            ["source", *keys],
            [none, *([data.source, *map(step.get, keys)] for step in steps)],
        )


def _angle_tables(found: AgainstAngles) -> Iterable[Table]:
    """Yield tables of the comparison with angles; each row has the source of the data."""
    data, degrees = found.data, math.degrees(1.0)
    source = [data.source]
    measured = {"bend": data.bend, "direction": data.direction}
    yield _table(
        "measured_angles",
        ("source", source * len(data)),
        ("line", data.line),
        *_commands(data),
        *((f"{name}_deg", of * degrees) for name, of in measured.items() if of is not None),
        *((f"{c.name}_{c.frame}_error_deg", c.error * degrees) for c in found.comparisons),
    )
    rows: list[Mapping[str, Any]] = [c.to_dict() for c in found.comparisons]
    yield _table(
        "measured_angle_errors",
        ("source", source * len(rows)),
        *((key, [row[key] for row in rows]) for key in ("name", "frame", "n", "mean_deg")),
        (["mean_low_deg", "mean_high_deg"], [row["interval_95_mean_deg"] for row in rows]),
        *((key, [row[key] for row in rows]) for key in ("max_deg", "rmse_deg", "arc_tip_mean_mm")),
    )


def _commands(data: Measurements) -> Iterable[tuple[list[str], Floats]]:
    """Names and columns of the tensions and displacements of the data."""
    by_tension, by_displacement = _of(data.tensions), _of(data.displacements)
    yield [f"tension_{t + 1}_N" for t in by_tension], data.tensions[:, by_tension]
    names = [f"displacement_{t + 1}_mm" for t in by_displacement]
    yield names, data.displacements[:, by_displacement] * 1e3


def _of(commands: Floats) -> list[int]:
    """Indices of tendons with these commands."""
    return [int(t) for t in np.flatnonzero(~np.isnan(commands).all(axis=0))]


_ERROR: Final = ("n", "mean_mm", "max_mm", "mean_percent")
_MOVED: Final = ("tip_moved_mean_mm", "tip_moved_max_mm")


def _budget_table(budget: Mapping[str, Any]) -> tuple[list[str], list[Sequence[Cell]]]:
    kinds = (*_ERROR, *(f"contribution_{kind}" for kind in ("n", "mm", "percent")))
    header = ["effect", "case", "problem", *_MOVED]
    header += [f"{name}_{kind}" for name in MEANINGS for kind in kinds]

    def row(effect: str, what: str, d: Mapping[str, Any]) -> list[Cell]:
        errors = [d[name].get(kind) for name in MEANINGS for kind in kinds]
        return [effect, what, d["problem"], *map(d.get, _MOVED), *errors]

    rows: list[Sequence[Cell]] = [
        row("", "baseline", budget["baseline"]),
        row("", "full_model", budget["full_model"]),
        row("", "this sweep", budget["sweep"]),
    ]
    for r in budget["rows"]:
        to = {"added": "added to", "removed": "removed from"}[r["in_sweep"]["how"]]
        rows += [
            row(r["effect"], "added to baseline", r["added"]),
            row(r["effect"], "full model with it", r["full"]),
            row(r["effect"], "removed from full model", r["removed"]),
            row(r["effect"], f"{to} this sweep", r["in_sweep"]),
        ]
    return header, rows


def _actuation_table(actuation: Mapping[str, Any]) -> tuple[list[str], list[Sequence[Cell]]]:
    kinds = (*_ERROR, "change_of_mean_mm")
    rows: list[Sequence[Cell]] = []
    for kind, d in (
        ("tension", actuation["tension"]),
        ("displacement", actuation["displacement"]),
        *(("", row) for row in actuation["rows"]),
    ):
        what = [d.get("effect"), d.get("control", kind), " ".join(d.get("assumed", ()))]
        for name in (*MEANINGS, COMMANDED):
            if name in d:
                errors = map(d[name].get, kinds)
                rows.append([*what, name, d["problem"], *errors, *map(d.get, _MOVED)])
    return ["effect", "control", "assumed", "name", "problem", *kinds, *_MOVED], rows
