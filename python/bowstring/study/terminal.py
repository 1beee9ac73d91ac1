"""Output of a study in the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rich import box
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from bowstring.formatting import in_percent, number, signed
from bowstring.study.actuation_budget import COMMANDED
from bowstring.study.comparison import COMPARISONS, LABELS, MEANINGS, Case, short
from bowstring.study.error_budget import Side
from bowstring.study.study import Study
from bowstring.study.summary import COLUMNS, Summary, summarise
from bowstring.study.tables import simulated

if TYPE_CHECKING:
    from bowstring.study.angle_validation import AgainstAngles
    from bowstring.study.data_validation import AgainstData

_SIDES: Final[dict[Side, str]] = {"in_sweep": "this sweep", "removed": "full model"}
"""References of the contributions in the terminal."""


def print_study(
    study: Study, console: Console, folder: Path | None = None, *, verbose: bool = False
) -> None:
    """Print the summary of a study; with `verbose` all tables and the whole verdict too.

    Parameters
    ----------
    study : Study
    console : rich.console.Console
    folder : Path, optional
        Folder of the report; its path is printed last.
    verbose : bool
        Print all tables and the whole verdict as well.
    """
    for sentence in study.measured.doubts if study.measured is not None else ():
        console.print(Text.assemble(("Check the measurements. ", "bold"), sentence))
    summary = summarise(study)
    console.print(Text(summary.title, style="bold"))
    console.print("Is constant curvature good enough? Simulated by the rod model:")
    for answer in summary.answers:
        console.print(Padding(Text(answer, style="bold"), (0, 0, 0, 2)))
    for heading, sentence in summary.findings:
        console.print(Text.assemble((f"{heading}: ", "bold"), sentence))
    if verbose:
        console.print()
        _print_details(study, summary, console)
    if folder is not None:
        if not verbose:
            console.print(Text("All tables: in the report, or here with --verbose", style="dim"))
        console.print(Text("Report: ", style="bold"), end="")
        # no line break in a path, so that it can be clicked or copied
        console.print(Text(str(folder / "report.html")), soft_wrap=True)


def _print_details(study: Study, summary: Summary, console: Console) -> None:
    """Print all tables, and the whole verdict."""
    table = _table(summary.reference, COLUMNS)
    for cells in summary.rows:
        table.add_row(*cells)
    console.print(table)
    loads = len(study.statics.tension)
    errors = _table(
        "Tip error of constant curvature (CC); all simulated",
        ("CC from", "mean mm", "max mm", "RMS mm", "mean %", *_BY_AXIS),
    )
    for physics, called in (("statics", ""), ("dynamics", ""), ("fe", "finite elements")):
        of_arcs = [c for c in study.against(physics) if c.name in COMPARISONS]
        for i, c in enumerate(of_arcs):
            if i == 0:
                errors.add_row(Text(f"vs {called or physics}", style="italic"))
            d = c.to_dict()
            errors.add_row(
                short(COMPARISONS[c.name]).removeprefix("from "),
                *(number(d[k]) for k in ("mean_mm", "max_mm", "rms_mm", "mean_percent")),
                *(number(v) for v in d["mean_by_axis_mm"]),
            )
    console.print(errors)
    fewer = [
        f"{short(LABELS[c.name])}, against {c.against}: {c.n} of {loads} loads"
        for c in simulated(study)
        if c.n < loads
    ]
    _print_notes(console, fewer)
    _print_shapes(study, console)
    _print_section(console, "Dynamics", (*study.dynamics_text, *study.limits_text))
    if study.bricks is not None:
        _print_section(console, "Finite elements", study.bricks.text)
    console.print()

    def counted(text: str, n: int) -> str:
        return f"{text} ({n} of {loads})" if 0 < n < loads else text

    def means(case: Case) -> dict[str, str]:
        return {name: counted(number(c.mean * 1e3, 2), c.n) for name, c in case.comparisons.items()}

    budget = _table(
        "Error budget: mean tip error (mm) of this sweep and of the full model, and what\n"
        "each effect alone adds to it (with the effect minus the value without)",
        (
            "effect",
            *(f"{where}:\n{of}" for where in _SIDES.values() for of in ("lengths", "force")),
        ),
    )
    b = study.budget
    first = [*means(b.sweep).values(), *means(b.full_model).values()]
    budget.add_row("(mean error)", *first)
    partial = any(" of " in cell for cell in first)
    problems: dict[str, None] = {}
    for row in b.rows:
        values = []
        mark = ""
        for side in _SIDES:
            for name in MEANINGS:
                found = b.contribution(row, side, name)
                values.append(counted(signed(found.mean * 1e3), found.n))
            for problem in b.problems(row, side):
                problems[f"* {short(row.label)}, {_SIDES[side]}, {problem}"] = None
                mark = " *"
        budget.add_row(short(row.label) + mark, *values)
        partial = partial or any(" of " in cell for cell in values)
    console.print(budget)
    note = f"(n of {loads}): over these loads only, not comparable with the other numbers"
    _print_notes(console, [*[note] * partial, *problems])
    if partial or problems:
        console.print()

    actuation = study.budget.actuation
    controlled = _table(
        "Actuation: mean tip error (mm), from home to the largest command\n"
        "(loading) and back (unloading)",
        ("effect", "CC from\nlengths", "CC from\nforce", "commanded\nlengths", "tip\nmoves"),
    )
    for control, title, base in (
        ("tension", "(tension control, no friction)", actuation.tension_controlled),
        ("displacement", "(displacement control, inextensible)", actuation.displacement_controlled),
    ):
        shown = [(title, base, "")]
        for r in actuation.rows:
            if r.control == control:
                mark = " *" if r.case.problem or r.base.problem else ""
                shown.append((r.short_label + mark, r.case, number(r.moved * 1e3, 2)))
        for label, case, moved in shown:
            errors_of = (means(case).get(name, "") for name in (*MEANINGS, COMMANDED))
            controlled.add_row(label, *errors_of, moved)
    console.print(controlled)
    gaps = dict.fromkeys(c.problem for r in actuation.rows for c in (r.base, r.case) if c.problem)
    _print_notes(console, [*actuation.origins, *(f"* {gap}" for gap in gaps)])
    console.print()

    if study.data is not None:
        _print_data(study.data, console)
    if study.angles is not None:
        _print_angles(study.angles, console)
    percent = f"{in_percent(study.verdict.tolerance, 3)} of length"
    _print_section(console, f"Verdict at {percent}", study.verdict.text)
    if study.claim is not None:
        _print_section(console, "", [study.claim.text], "dim")


def _print_shapes(study: Study, console: Console) -> None:
    """Print errors of constant and variable curvature at the tip and over the disks."""
    errors = _table(
        "Constant and variable curvature against statics: tip, and RMS over the disks",
        ("model", "tip mean mm", "tip max mm", "tip mean %", "disks mean mm", "disks mean %"),
    )
    keys = ("tip_mean_mm", "tip_max_mm", "tip_mean_percent", "shape_mean_mm", "shape_mean_percent")
    for model in study.shapes.models:
        label = f"CC {short(model.label)}" if model.name in COMPARISONS else model.label
        d: Mapping[str, Any] = model.to_dict()
        errors.add_row(label, *(number(d[key]) for key in keys))
    console.print(errors)


def _print_data(found: AgainstData, console: Console) -> None:
    """Print errors against data by model, and the text."""
    from bowstring.study.data_validation import FRAMES

    errors = _table(
        f"Tip error against the data; {found.label}",
        ("model", "mean mm", "95 %", "max mm", "mean %", *_BY_AXIS),
    )
    for kind, title in FRAMES.items():
        errors.add_row(Text(title, style="italic"))
        for c in found.comparisons:
            if c.frame != kind:
                continue
            d = c.to_dict()
            low, high = (number(v, 2) for v in d["interval_95"]["mean_mm"])
            errors.add_row(
                short(found.labels[c.name]),
                number(d["mean_mm"]),
                f"{low} to {high}",
                *(number(d[k]) for k in ("max_mm", "mean_percent")),
                *(number(v) for v in d["mean_by_axis_mm"]),
            )
    console.print(errors)
    _print_section(console, "Against the data", found.text)
    console.print()


def _print_angles(found: AgainstAngles, console: Console) -> None:
    """Print angle errors by model, and the text."""
    from bowstring.study.angle_validation import FRAMES

    errors = _table(
        f"Angle error of the tip's direction; {found.label}",
        ("model", "frame", "mean deg", "95 %", "max deg", "arc tip mm"),
    )
    for c in found.comparisons:
        d = c.to_dict()
        low, high = (number(v, 2) for v in d["interval_95_mean_deg"])
        keys = ("max_deg", "arc_tip_mean_mm")
        cells = (number(d["mean_deg"]), f"{low} to {high}", *(number(d[k]) for k in keys))
        errors.add_row(short(found.labels[c.name]), FRAMES[c.frame], *cells)
    console.print(errors)
    _print_section(console, "Against the data", found.text)
    console.print()


_BY_AXIS: Final = ("x mm", "y mm", "z mm")


def _table(title: str, columns: Sequence[str]) -> Table:
    out = Table(title=title, title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False)
    for i, column in enumerate(columns):
        out.add_column(column, justify="left" if i == 0 else "right", no_wrap=i > 0)
    return out


def _print_section(console: Console, title: str, sentences: Iterable[str], style: str = "") -> None:
    if title:
        console.print(Text(title, style="bold"))
    for sentence in sentences:
        console.print(Padding(Text(sentence, style=style), (0, 0, 0, 2)))


def _print_notes(console: Console, notes: Iterable[str]) -> None:
    for note in notes:
        console.print(Text(note, style="dim"))
