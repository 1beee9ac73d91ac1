"""Suite as a whole: all sets, its conclusion, and its files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from bowstring.aliases import Progress
from bowstring.errors import InputError
from bowstring.files.atomic_io import write_whole
from bowstring.files.result_folder import check_folder, write_listing
from bowstring.formatting import number
from bowstring.results import Key, Result
from bowstring.suite.protocol import built_in_sets, read_set, sets_in
from bowstring.suite.running import SetResult, run_set
from bowstring.units import quote


@dataclass(frozen=True)
class Suite(Result):
    """Results of all sets."""

    sets: Annotated[tuple[SetResult, ...], Key()]
    """Results in the order of the names."""

    @property
    def missing(self) -> list[SetResult]:
        """Sets whose files are not available."""
        return [each for each in self.sets if each.missing]

    @cached_property
    def ratios(self) -> Annotated[dict[str, float], Key()]:
        """Error of calibrated constant curvature over that of the calibrated rod, by set.

        Only of measured sets in which both predict rows that they were not fitted to.
        """
        found = {}
        for each in self.sets:
            cc, rod = each.model("cc_calibrated"), each.model("rod_calibrated")
            if cc is None or rod is None or each.given.kind != "measured":
                continue
            if not (cc.model.parameters and rod.model.parameters):
                continue
            name = each.given.protocol.metrics[0]
            ratio = cc.validation.values[name] / rod.validation.values[name]
            if np.isfinite(ratio):
                found[each.given.name] = float(ratio)
        return found

    @property
    def conclusion(self) -> Annotated[str, Key()]:
        """Conclusion in one sentence; empty if no set allows one."""
        if not self.ratios:
            return ""
        low, high = min(self.ratios.values()), max(self.ratios.values())
        many = len(self.ratios)
        text = f"{number(low, 2)} to {number(high, 2)}" if many > 1 else number(low, 2)
        sets = f"each of {many} robots" if many > 1 else "one robot"
        return (
            f"For {sets}, rod model and constant curvature were calibrated on one part of the "
            f"measurements; on the other part, constant curvature errs {text} times as much as the "
            "rod model."
        )


def run_suite(
    only: Sequence[str] = (), sets: str | Path | None = None, *, progress: Progress | None = None
) -> Suite:
    """Run the suite, or some of its sets.

    Parameters
    ----------
    only : sequence of str
        Names of sets; all by default.
    sets : str or Path, optional
        Folder of own sets, each a folder in it, in place of those that come with Bowstring.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Suite
        Results. A set whose files are not available has none, and says why.

    Raises
    ------
    InputError
        If there is no such set, or a file of a set is not valid; nothing is run then.
    NoSolutionError
        If a model has no solution.
    """
    folders = {
        each.name: each for each in (built_in_sets() if sets is None else sets_in(Path(sets)))
    }
    if unknown := [name for name in only if name not in folders]:
        raise InputError(
            f"there is no set {quote(unknown[0])}; there are {', '.join(folders)}", argument="only"
        )
    chosen = [read_set(folder) for name, folder in folders.items() if not only or name in only]
    notify = progress or (lambda what, share: None)
    found = []
    for k, each in enumerate(chosen):

        def report(what: str, share: float, done: int = k) -> None:
            notify(what, (done + share) / len(chosen))

        found.append(run_set(each, progress=report))
    notify("done", 1.0)
    return Suite(tuple(found))


def write_suite(
    suite: Suite,
    content: dict[str, Any],
    out: str | Path,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a suite: all numbers, and a figure of each set.

    Parameters
    ----------
    suite : Suite
        The suite.
    content : dict
        Plain values for ``suite.json``, as ``bowstring suite --json`` prints.
    out : str or Path
        Folder; a former suite in it is replaced as a whole.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Absolute path of the folder, with ``suite.json``, and figures as PNG and PDF.

    Raises
    ------
    InputError
        If the folder cannot be written (see `check_folder`).
    """
    from bowstring.suite.figures import draw_set
    from bowstring.viz.style import figure_style, save_figure, save_figures

    notify = progress or (lambda what, share: None)
    folder = check_folder(out, "suite")
    results: Iterable[SetResult] = [each for each in suite.sets if each.models]

    def fill(new: Path) -> None:
        with figure_style():
            save_figures(
                [(each.given.name, partial(draw_set, each)) for each in results],
                lambda stem, figure: save_figure(figure, new / stem),
                lambda share: notify("figures", share),
            )
        write_listing(new / "suite.json", content)

    write_whole(folder, "suite", fill, lambda: check_folder(folder, "suite"))
    return folder
