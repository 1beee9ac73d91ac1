"""The study on disk and in the terminal: report.html, figures, CSV tables, study.json; modes; fits.

A folder is written beside its place under a hidden name and moved in whole when it is complete, so
a reader finds the old study or the new one, never a mixture. A folder that this module did not
write is never touched.
"""

from __future__ import annotations

import contextlib
import csv
import json
import math
import re
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.actuation import COMMANDED
from bowstring.budget import BudgetRow
from bowstring.comparison import COMPARISONS, MEANINGS, Case, Comparison
from bowstring.errors import InputError
from bowstring.files import check_place, resolved, write_whole
from bowstring.processes import for_each
from bowstring.robot import Robot
from bowstring.study import Study
from bowstring.words import number, signed

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.console import Console
    from rich.table import Table

    from bowstring.against_data import AgainstData
    from bowstring.calibration import Calibration
    from bowstring.oscillations import Modes

__all__ = ["check_folder", "default_folder", "print_study", "write", "write_fit", "write_modes"]

Progress = Callable[[str, float], None]
Cell = str | float | int | None

_DPI: Final = 160
_CALLED: Final = {"fe": "finite elements"}  # what is not called as its file
_AXES: Final = ("x", "y", "z")


# -- where it goes -----------------------------------------------------------------------------


def default_folder(robot: Robot) -> Path:
    """Folder of a robot's study if none is asked for: ``bowstring-study/<robot name>``.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    Path
        Relative; characters of the name that a file system may refuse become underscores.
    """
    name = re.sub(r"[^\w.-]+", "_", robot.name).strip("._") or "robot"
    return Path("bowstring-study") / name


def check_folder(out: str | Path, what: str = "study") -> Path:
    """Say before any work whether a study may be written to a folder.

    Parameters
    ----------
    out : str or Path
        The folder; it need not exist.
    what : str
        ``"study"``, ``"modes"``, ``"fit"`` or ``"fe"``; its JSON file lists the files that may be
        replaced.

    Returns
    -------
    Path
        The same folder, absolute, links resolved.

    Raises
    ------
    InputError
        If there is something in its place that is not a study of this program, or holds files that
        the study did not write, or if it cannot be written.
    """
    called = _CALLED.get(what, what)
    folder = resolved(out, f"cannot write the {called} to {out}")
    why = f"cannot write the {called} to {folder}"
    check_place(folder, why)
    if not folder.exists():
        return folder
    if not folder.is_dir():
        raise InputError(f"{why}: it is a file; name a folder")
    present = {
        p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_symlink() or p.is_file()
    }
    if not present:
        return folder
    try:
        former = json.loads((folder / f"{what}.json").read_text(encoding="utf-8"))
        files = set(former["files"])
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(
            f"{why}: it holds files but no {called} of Bowstring, and nothing of yours is "
            "replaced; name a new or an empty folder"
        ) from None
    foreign = sorted(present - files)
    if foreign:
        raise InputError(
            f"cannot replace the {called} in {folder}: it also holds {foreign[0]}, which Bowstring "
            "did not write; move that away or name another folder"
        )
    return folder


def write(study: Study, out: str | Path | None = None, *, progress: Progress | None = None) -> Path:
    """Write the report of a study.

    Parameters
    ----------
    study : Study
    out : str or Path, optional
        Folder; a former study in it is replaced whole, after success. `default_folder` if not
        given.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: report.html, study.json, ``figures/`` (PNG, PDF), ``tables/`` (CSV).

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`).
    """
    tell = progress or (lambda what, share: None)
    folder = check_folder(default_folder(study.robot) if out is None else out)
    write_whole(folder, "study", lambda new: _fill(study, new, tell))
    tell("done", 1.0)
    return folder


def write_modes(
    modes: Modes, content: dict[str, Any], out: str | Path, *, progress: Progress | None = None
) -> Path:
    """Write pictures of mode shapes.

    Parameters
    ----------
    modes : Modes
    content : dict
        Plain values for ``modes.json``, as ``bowstring modes --json`` prints.
    out : str or Path
        Folder; former modes in it are replaced whole, after success.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: modes.json and each mode as PNG, PDF and SVG.

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`).
    """
    from bowstring import plots

    tell = progress or (lambda what, share: None)
    folder = check_folder(out, "modes")

    def fill(new: Path) -> None:
        def save(drawing: tuple[str, Figure]) -> None:
            stem, figure = drawing
            save_figure(figure, new / stem)
            figure.savefig(new / f"{stem}.svg", metadata={"Date": None, "Creator": "Bowstring"})

        with plots.figure_style():
            made = list(plots.draw_modes(modes))
            for_each(made, save, tell=lambda share: tell("pictures", share))
        files = sorted([*(p.name for p in new.iterdir()), "modes.json"])
        write_json(new / "modes.json", {**content, "files": files})

    write_whole(folder, "modes", fill)
    tell("done", 1.0)
    return folder


def write_fit(
    calibration: Calibration,
    content: dict[str, Any],
    out: str | Path,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a calibration: the robot with its calibrated numbers, all numbers, two figures.

    Parameters
    ----------
    calibration : Calibration
    content : dict
        Plain values for ``fit.json``, as ``bowstring fit --json`` prints.
    out : str or Path
        Folder; a former fit in it is replaced whole, after success.
    progress : callable, optional
        Is told what is being done and the share that is done, from 0 to 1.

    Returns
    -------
    Path
        The folder, absolute: robot.yaml, calibration.json with what a robot file has no place for,
        fit.json, and residuals and parity as PNG and PDF.

    Raises
    ------
    InputError
        If the folder may not be written (see `check_folder`).
    """
    from bowstring import plots
    from bowstring.calibration import BESIDE
    from bowstring.robotfile import to_yaml

    tell = progress or (lambda what, share: None)
    folder = check_folder(out, "fit")
    found, data = calibration.fit, calibration.data
    hashed = "" if data.sha256 is None else f", SHA-256 {data.sha256}"
    lines = [
        f"Calibrated by Bowstring ({found.model}) on {data.source} data: {data.name}{hashed}",
        found.message,
        *[f"Not part of a robot file: {each}" for each in calibration.elsewhere],
        *([f"{BESIDE} has these for bowstring fit --start"] if calibration.elsewhere else []),
    ]

    def fill(new: Path) -> None:
        robot = to_yaml(found.robot, "\n".join(" ".join(line.split()) for line in lines))
        (new / "robot.yaml").write_text(robot, encoding="utf-8")
        write_json(new / BESIDE, calibration.beside_to_dict())
        with plots.figure_style():
            save_figures(plots.draw_fit(calibration), new, lambda share: tell("figures", share))
        files = sorted([*(p.name for p in new.iterdir()), "fit.json"])
        write_json(new / "fit.json", {**content, "files": files})

    write_whole(folder, "fit", fill)
    tell("done", 1.0)
    return folder


def _fill(study: Study, folder: Path, tell: Progress) -> None:
    from bowstring import plots

    tables = folder / "tables"
    tables.mkdir()
    for name, header, rows in _tables(study):
        _write_csv(tables / f"{name}.csv", header, rows)

    figures = folder / "figures"
    figures.mkdir()
    with plots.figure_style(), tempfile.TemporaryDirectory() as passed_on:

        def save(drawing: tuple[str, Figure]) -> None:
            stem, figure = drawing
            save_figure(figure, figures / stem)
            Path(passed_on, stem).write_text(plots.svg(stem, figure), encoding="utf-8")

        made = list(plots.draw(study))
        for_each(made, save, tell=lambda share: tell("figures", share))
        drawn = {stem: Path(passed_on, stem).read_text(encoding="utf-8") for stem, _ in made}

    tell("report", 0.95)
    content = study.to_dict()
    (folder / "report.html").write_text(_html(study, content, drawn), encoding="utf-8")
    written = [p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file()]
    content["files"] = sorted([*written, "study.json"])
    write_json(folder / "study.json", content)


def save_figures(
    drawings: Iterable[tuple[str, Figure]], folder: Path, tell: Callable[[float], None]
) -> None:
    """Each as PNG and PDF under its stem."""
    for_each(list(drawings), lambda each: save_figure(each[1], folder / each[0]), tell=tell)


def save_figure(figure: Figure, path: Path) -> None:
    """As PNG and PDF; `path` has no ending."""
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
        figure.set_layout_engine("none")  # laid out once, not in each file format again
    figure.savefig(f"{path}.png", dpi=_DPI)
    with _glyphs_alone():
        figure.savefig(f"{path}.pdf", metadata={"CreationDate": None, "Creator": "Bowstring"})


@contextlib.contextmanager
def _glyphs_alone() -> Iterator[None]:
    """Fonts in a PDF without the tables that lay out text: a PDF numbers and places glyphs itself.

    To cut them down takes matplotlib three quarters of the time of a font, 0.1 s.
    """
    from fontTools.subset import Options

    name = "_drop_tables_default"  # one without it keeps the tables
    former = getattr(Options, name, [])
    setattr(Options, name, [*former, "GDEF", "GPOS", "GSUB", "MATH", "kern"])
    try:
        yield
    finally:
        setattr(Options, name, former)


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Plain values, as people can read them; NaN is an error."""
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    path.write_text(text + "\n", encoding="utf-8")


# -- tables ------------------------------------------------------------------------------------


def _write_csv(path: Path, header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
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


def _tables(study: Study) -> Iterable[tuple[str, list[str], list[Sequence[Cell]]]]:
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
            for d in (c.to_dict() for c in _simulated(study))
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
            for c in _simulated(study)
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


def _simulated(study: Study) -> list[Comparison]:
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
        header += [
            f"{name}_n",
            f"{name}_mean_mm",
            f"{name}_max_mm",
            f"{name}_mean_percent",
            f"{name}_change_of_mean_mm",
            f"{name}_change_of_mean_percent",
        ]

    def row(effect: str, what: str, case: Case, base: Case | None) -> list[Cell]:
        d = case.to_dict(base)
        cells: list[Cell] = [effect, what, d["problem"]]
        cells += [d.get("tip_moved_mean_mm"), d.get("tip_moved_max_mm")]
        for name in names:
            e = d[name]
            cells += [e["n"], e["mean_mm"], e["max_mm"], e["mean_percent"]]
            cells += [e.get("change_of_mean_mm"), e.get("change_of_mean_percent")]
        return cells

    b = study.budget
    rows = [
        row("", "plainest", b.plainest, None),
        row("", "fullest", b.fullest, None),
        row("", "this sweep", b.sweep, None),
    ]
    for r in b.rows:
        rows.append(row(r.effect, "added to plainest", r.added, b.plainest))
        rows.append(row(r.effect, "fullest with it", r.full, None))
        rows.append(row(r.effect, "removed from fullest", r.removed, r.full))
        how = "removed from this sweep" if r.acts_in_sweep else "added to this sweep"
        rows.append(row(r.effect, how, r.in_sweep, b.sweep))
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


# -- the page ----------------------------------------------------------------------------------


def _html(study: Study, content: dict[str, Any], drawn: dict[str, str]) -> str:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("bowstring"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["number"] = number
    environment.filters["signed"] = signed
    from bowstring.colours import COLOURS

    page = environment.get_template("report.html.j2").render(
        study=study,
        content=content,
        comparisons=[(COMPARISONS[c.name], c.to_dict()) for c in _simulated(study)],
        data=None if study.data is None else _data_page(study.data),
        sweep=_sweep_rows(study),
        # drawn by this program, ids and text escaped by matplotlib
        figures=[(f, Markup(drawn[f.stem])) for f in study.figures],
        tables=[name for name, _, _ in _tables(study)],
        colours=COLOURS,
        provenance=content["provenance"],
    )
    return page + "\n"


def _data_page(found: AgainstData) -> dict[str, Any]:
    """What the page shows of the verdict on data."""
    from bowstring.against_data import DATA_MODELS, FRAMES

    label = found.label[0].upper() + found.label[1:]
    return {
        "label": label,
        "models": [
            (
                DATA_MODELS[name],
                [
                    (FRAMES[c.frame], c.to_dict())
                    for kind in FRAMES
                    for c in found.comparisons
                    if (c.name, c.frame) == (name, kind)
                ],
            )
            for name in found.models
        ],
        **found.to_dict(),
    }


def _sweep_rows(study: Study) -> list[dict[str, Any]]:
    s = study.statics
    lengths, force = study.comparison("cc_from_lengths"), study.comparison("cc_from_force")
    return [
        {
            "tension": float(s.tension[i]),
            "status": s.status[i],
            "tip": (s.tip_position[i] * 1e3).tolist(),
            "pull": float(s.pull[i]) * 1e3,
            "linear_pull": float(s.linear_pull[i]) * 1e3,
            "from_lengths": float(lengths.error[i]) * 1e3,
            "from_force": float(force.error[i]) * 1e3,
        }
        for i in range(len(s.tension))
    ]


# -- the terminal ------------------------------------------------------------------------------


def print_study(study: Study, console: Console, folder: Path | None = None) -> None:
    """Print the study's tables and verdict.

    Parameters
    ----------
    study : Study
    console : rich.console.Console
    folder : Path, optional
        Where the report lies; its path is printed last.
    """
    from rich import box
    from rich.padding import Padding
    from rich.table import Table
    from rich.text import Text

    def table(title: str, *columns: str) -> Table:
        out = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
        for i, column in enumerate(columns):
            out.add_column(column, justify="left" if i == 0 else "right", no_wrap=i > 0)
        return out

    robot, settings = study.robot, study.settings
    console.print(
        Text.assemble(
            (robot.name, "bold"),
            f": {study.length * 1e3:g} mm, tendon {settings.tendon + 1} pulled to "
            f"{settings.max_tension:g} N",
        )
    )

    errors = table(
        "Tip error of constant curvature (CC); all simulated",
        "CC from",
        "mean mm",
        "max mm",
        "RMS mm",
        "mean %",
        "x mm",
        "y mm",
        "z mm",
    )
    for physics, called in (("statics", ""), ("dynamics", ""), ("fe", "finite elements")):
        for i, c in enumerate(study.against(physics)):
            if i == 0:
                errors.add_row(Text(f"vs {called or physics}", style="italic"))
            d = c.to_dict()
            errors.add_row(
                _short(COMPARISONS[c.name]).removeprefix("from "),
                *(number(d[k]) for k in ("mean_mm", "max_mm", "rms_mm", "mean_percent")),
                *(number(v) for v in d["mean_by_axis_mm"]),
            )
    console.print(errors)
    for c in _simulated(study):
        if c.n < len(study.statics.tension):
            note = (
                f"{_short(COMPARISONS[c.name])}, against {c.against}: {c.n} of "
                f"{len(study.statics.tension)} loads"
            )
            console.print(Text(note, style="dim"))
    console.print(Text("Dynamics", style="bold"))
    for sentence in study.dynamics_text:
        console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    if study.bricks is not None:
        console.print(Text("Finite elements", style="bold"))
        for sentence in study.bricks.text:
            console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    console.print()

    plainest, fullest = study.budget.plainest, study.budget.fullest

    loads = len(study.statics.tension)

    def counted(text: str, n: int) -> str:
        return f"{text} ({n} of {loads})" if 0 < n < loads else text

    def means(case: Case) -> list[str]:
        return [counted(number(c.mean * 1e3, 2), c.n) for c in case.comparisons.values()]

    def worth(row: BudgetRow, name: str) -> str:
        common = np.isfinite(row.full.error(name)) & np.isfinite(row.removed.error(name))
        return counted(signed(row.worth(name) * 1e3), int(common.sum()))

    budget = table(
        "Error budget: mean tip error (mm) with an effect added alone to the\n"
        "plainest physics, and what the effect changes in the fullest",
        "effect",
        "added:\nlengths",
        "added:\nforce",
        "in fullest:\nlengths",
        "in fullest:\nforce",
    )
    budget.add_row("(plainest; fullest)", *means(plainest), *means(fullest))
    partial = any(" of " in cell for cell in (*means(plainest), *means(fullest)))
    for row in study.budget.rows:
        worths = [worth(row, name) for name in fullest.comparisons]
        mark = " *" if row.added.problem or row.removed.problem or row.full.problem else ""
        budget.add_row(_short(row.label) + mark, *means(row.added), *worths)
        partial = partial or any(" of " in cell for cell in (*means(row.added), *worths))
    console.print(budget)
    if partial:
        note = f"(n of {loads}): over these loads only, not comparable with the other numbers"
        console.print(Text(note, style="dim"))
    problems = [
        f"* {_short(row.label)}: {problem}"
        for row in study.budget.rows
        for problem in dict.fromkeys([row.added.problem, row.full.problem, row.removed.problem])
        if problem
    ]
    for problem in problems:
        console.print(Text(problem, style="dim"))

    drive = study.budget.drive
    driven = table(
        "How the robot is driven: mean tip error (mm), from home to the largest command\n"
        "(loading) and back (unloading)",
        "effect",
        "CC from\nlengths",
        "CC from\nforce",
        "commanded\nlengths",
        "tip\nmoves",
    )

    def driven_means(case: Case) -> list[str]:
        cells = dict(zip(case.comparisons, means(case), strict=True))
        return [cells.get(name, "") for name in (*MEANINGS, COMMANDED)]

    for row_of, title, base in (
        ("tension", "(tension, no friction)", drive.tension_driven),
        ("pull", "(pulled, no stretch or friction)", drive.pull_driven),
    ):
        driven.add_row(title, *driven_means(base), "")
        for r in drive.rows:
            if r.driven_by == row_of:
                mark = " *" if r.case.problem or r.base.problem else ""
                driven.add_row(
                    r.short_label + mark, *driven_means(r.case), number(r.moved * 1e3, 2)
                )
    console.print(driven)
    if drive.assumptions:
        note = f"assumed, the robot file gives none: {'; '.join(drive.assumptions)}"
        console.print(Text(note, style="dim"))
    gaps = dict.fromkeys(c.problem for r in drive.rows for c in (r.base, r.case) if c.problem)
    for gap in gaps:
        console.print(Text(f"* {gap}", style="dim"))
    console.print()

    if study.data is not None:
        _print_data(study.data, console, table)
    percent = f"{study.verdict.tolerance * 100:.3g} % of length"
    console.print(Text(f"Verdict at {percent}", style="bold"))
    for sentence in study.verdict.text:
        console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    if study.claim is not None:
        console.print(Padding(Text(study.claim.text, style="dim"), (0, 0, 0, 2)))
    if folder is not None:
        console.print(Text("Report: "), end="")
        # a path must stay one line, to be clicked or copied
        console.print(Text(str(folder / "report.html")), soft_wrap=True)


def _print_data(found: AgainstData, console: Console, table: Callable[..., Table]) -> None:
    """The verdict on data: errors by model, and its sentences."""
    from rich.padding import Padding
    from rich.text import Text

    from bowstring.against_data import DATA_MODELS, FRAMES

    errors = table(
        f"Tip error against the data; {found.label}",
        "model",
        "mean mm",
        "95 %",
        "max mm",
        "mean %",
        "x mm",
        "y mm",
        "z mm",
    )
    for kind, title in FRAMES.items():
        errors.add_row(Text(title, style="italic"))
        for c in found.comparisons:
            if c.frame != kind:
                continue
            d = c.to_dict()
            low, high = (number(v, 2) for v in d["interval_95"]["mean_mm"])
            errors.add_row(
                _short(DATA_MODELS[c.name]).replace(
                    ", as the robot file has it", " as in the file"
                ),
                number(d["mean_mm"]),
                f"{low} to {high}",
                *(number(d[k]) for k in ("max_mm", "mean_percent")),
                *(number(v) for v in d["mean_by_axis_mm"]),
            )
    console.print(errors)
    console.print(Text("Against the data", style="bold"))
    for sentence in found.text:
        console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    console.print()


def _short(label: str) -> str:
    return re.sub(r" \(.*\)|, not a continuous tendon", "", label)
