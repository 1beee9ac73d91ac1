"""The study in the terminal."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bowstring.formatting import in_percent, number, signed
from bowstring.study.actuation_budget import COMMANDED
from bowstring.study.comparison import COMPARISONS, MEANINGS, Case
from bowstring.study.error_budget import Side
from bowstring.study.study import Study
from bowstring.study.tables import simulated

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bowstring.study.data_validation import AgainstData

__all__ = ["print_study"]

_SIDES: Final[dict[Side, str]] = {"in_sweep": "this sweep", "removed": "full model"}
"""The physics beside which the terminal shows contributions."""


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
            f": {study.length * 1e3:g} mm, {settings.pulled} pulled to {settings.max_tension:g} N",
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
    for c in simulated(study):
        if c.n < len(study.statics.tension):
            note = (
                f"{_short(COMPARISONS[c.name])}, against {c.against}: {c.n} of "
                f"{len(study.statics.tension)} loads"
            )
            console.print(Text(note, style="dim"))
    console.print(Text("Dynamics", style="bold"))
    for sentence in study.dynamics_text:
        console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    for sentence in study.limits_text:
        console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    if study.bricks is not None:
        console.print(Text("Finite elements", style="bold"))
        for sentence in study.bricks.text:
            console.print(Padding(Text(sentence), (0, 0, 0, 2)))
    console.print()

    loads = len(study.statics.tension)

    def counted(text: str, n: int) -> str:
        return f"{text} ({n} of {loads})" if 0 < n < loads else text

    def means(case: Case) -> list[str]:
        return [counted(number(c.mean * 1e3, 2), c.n) for c in case.comparisons.values()]

    budget = table(
        "Error budget: mean tip error (mm) of this sweep and of the full model, and what\n"
        "each effect alone adds to it (with the effect less without it)",
        "effect",
        "this sweep:\nlengths",
        "this sweep:\nforce",
        "full model:\nlengths",
        "full model:\nforce",
    )
    b = study.budget
    first = [*means(b.sweep), *means(b.fullest)]
    budget.add_row("(mean error)", *first)
    partial = any(" of " in cell for cell in first)
    problems: dict[str, None] = {}
    for row in b.rows:
        cells = []
        for side in _SIDES:
            for name in MEANINGS:
                found = b.contribution(row, side, name)
                cells.append(counted(signed(found.mean * 1e3), found.n))
            for problem in b.problems(row, side):
                problems[f"* {_short(row.label)}, {_SIDES[side]}, {problem}"] = None
        mark = " *" if any(b.problems(row, side) for side in _SIDES) else ""
        budget.add_row(_short(row.label) + mark, *cells)
        partial = partial or any(" of " in cell for cell in cells)
    console.print(budget)
    if partial:
        note = f"(n of {loads}): over these loads only, not comparable with the other numbers"
        console.print(Text(note, style="dim"))
    for problem in problems:
        console.print(Text(problem, style="dim"))
    if partial or problems:
        console.print()

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
    for note in drive.origins:
        console.print(Text(note, style="dim"))
    gaps = dict.fromkeys(c.problem for r in drive.rows for c in (r.base, r.case) if c.problem)
    for gap in gaps:
        console.print(Text(f"* {gap}", style="dim"))
    console.print()

    if study.data is not None:
        _print_data(study.data, console, table)
    percent = f"{in_percent(study.verdict.tolerance, 3)} of length"
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

    from bowstring.study.data_validation import FRAMES

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
                _short(found.labels[c.name]).replace(
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
