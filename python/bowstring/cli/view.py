"""Command view: robots and runs in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from bowstring.cli import completion
from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import Overrides, Tolerance, load, measurements_of
from bowstring.cli.output import write
from bowstring.errors import InputError

Robots = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[ROBOT]...",
        help="Built-in robots' names or paths of robot files.",
        autocompletion=completion.robots,
    ),
]


def view(
    tolerance: Tolerance,
    robots: Robots = None,
    run: Annotated[
        list[Path] | None, option("FILE", "Run of simulate --out (.nc), which plays. Repeatable.")
    ] = None,
    measurements: Annotated[
        Path | None,
        option("FILE", "Table of measurements in the base frame of the first robot, as points."),
    ] = None,
    port: Annotated[int, option("N", "Port of this machine to serve at.")] = 8080,
    overrides: Overrides = None,
) -> None:
    """Show robots and runs in the browser, with sliders.

    It serves a page on this machine until Ctrl-C; nothing leaves the machine. Tips of constant
    curvature are beside the rod, all simulated.
    """
    from bowstring.dynamics.run_file import read_run
    from bowstring.integrations.live import view as live_view

    names = robots or ([] if run else ["amouri2019"])
    subjects: list[Any] = [load(name, overrides) for name in names]
    points = None
    if measurements is not None:
        if not subjects:
            raise InputError("--measurements needs a ROBOT whose points they are.")
        points = measurements_of("--measurements", measurements, subjects[0], None).tip
    subjects += [of_flag("--run", read_run, file) for file in run or ()]
    shown = live_view(subjects, measured=points, tolerance=tolerance, port=port)
    try:
        write(f"{shown.url} shows {len(subjects)} in the browser; Ctrl-C ends it.\n")
        shown.wait()
    finally:
        shown.stop()
