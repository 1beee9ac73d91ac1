"""Suite on a terminal: one table, reasons for its gaps, and the conclusion."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bowstring.formatting import significant
from bowstring.suite.protocol import COLUMNS
from bowstring.suite.running import ModelResult, SetResult
from bowstring.suite.summary import Suite

if TYPE_CHECKING:
    from rich.console import Console

HEADER: Final = ("set, metric", "kind", "rows", *COLUMNS.values(), "authors", "learner")
"""Header of the table."""
_NONE: Final = "\N{EN DASH}"
_NOTE: Final = "Errors at rows that were not fitted; CC: constant curvature."
_FITTED: Final = "* arcs fitted to each shape itself: a bound on constant curvature, no prediction."


def table_rows(suite: Suite) -> Iterator[tuple[str, ...]]:
    """Yield the cells of the table: a row for each set, and below it one for each metric.

    Parameters
    ----------
    suite : Suite
        The suite.

    Yields
    ------
    tuple of str
        Cells in the order of `HEADER`.
    """
    for each in suite.sets:
        yield (each.given.name, each.given.kind, _rows(each), *[""] * (len(HEADER) - 3))
        for name, metric in each.given.metrics.items():
            models = [_cell(each.model(column), name) for column in COLUMNS]
            figures = (each.published(by, name) for by in ("authors", "learner"))
            quoted = [_NONE if figure is None else significant(figure.value) for figure in figures]
            yield (f"  {metric.label}, {metric.unit}", "", "", *models, *quoted)


def print_suite(suite: Suite, console: Console, folder: Path | None = None) -> None:
    """Print the suite.

    Parameters
    ----------
    suite : Suite
        The suite.
    console : rich.console.Console
        Where it is printed.
    folder : Path, optional
        Folder of its files.
    """
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for k, name in enumerate(HEADER):
        title = name if k < 3 else name.replace(" ", "\n")
        table.add_column(title, justify="left" if k < 2 else "right", no_wrap=k > 0)
    for row in table_rows(suite):
        table.add_row(*row)
    console.print(table)
    console.print(f"\n{_NOTE}")
    if any(model.model.model == "arcs" for each in suite.sets for model in each.models):
        console.print(_FITTED)
    for each in suite.sets:
        for column, why in each.given.protocol.without.items():
            console.print(f"{each.given.name}, {COLUMNS[column]}: {why}")
        for model in each.models:
            if not model.converged:
                console.print(f"{each.given.name}, {model.model.name}: {model.message}")
    if suite.conclusion:
        console.print(f"\n{suite.conclusion}")
    if folder is not None:
        console.print(f"\nNumbers and figures: {folder}")


def _rows(result: SetResult) -> str:
    return str(max(m.validation.rows for m in result.models)) if result.models else _NONE


def _cell(result: ModelResult | None, metric: str) -> str:
    if result is None:
        return _NONE
    text = significant(result.validation.values[metric])
    lost = result.validation.without_solution
    text += "*" * (result.model.model == "arcs")
    return f"{text} ({lost} rows unsolved)" if lost else text
