"""Command suite."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from bowstring.cli import completion
from bowstring.cli.groups import option
from bowstring.cli.options import AsJson, out_folder
from bowstring.cli.output import Stopped, made_by, progress_bar, say, write_json, write_rich

MISSING = 1  # exit code where files of a set are missing


def suite(
    only: Annotated[
        list[str] | None,
        option(
            "NAME",
            "Run this set only; give it again for more.",
            values=completion.data_sets,
        ),
    ] = None,
    sets: Annotated[
        Path | None,
        option("DIR", "Folder of own sets, each a folder in it.  [default: those of Bowstring]"),
    ] = None,
    out: Annotated[Path | None, option("DIR", "Folder for all numbers and figures.")] = None,
    as_json: AsJson = False,
) -> None:
    """Judge constant curvature and the rod on all public data sets.

    Exit code 1 if files of a set are missing; the others are run.
    """
    folder = out_folder(out, "suite")

    from bowstring.suite.summary import run_suite, write_suite
    from bowstring.suite.terminal import print_suite

    solving = 0.95 if folder else 1.0
    try:
        with progress_bar("suite") as notify:
            found = run_suite(
                only or (), sets, progress=lambda what, done: notify(what, solving * done)
            )
            content: dict[str, Any] = {
                **found.to_dict(),
                "folder": None if folder is None else str(folder),
                "provenance": made_by(only=only or [], sets=None if sets is None else str(sets)),
            }
            if folder is not None:
                write_suite(
                    found,
                    dict(content),
                    folder,
                    progress=lambda what, done: notify(what, solving + (1 - solving) * done),
                )
    except KeyboardInterrupt:
        raise Stopped(
            "results of finished models are kept; the same command goes on from there."
        ) from None
    if as_json:
        write_json(content)
    else:
        write_rich(lambda console: print_suite(found, console, folder))
    for each in found.missing:
        say("Error", f"set {each.given.name}: {each.missing.rstrip('.')}.")
    if found.missing:
        raise typer.Exit(MISSING)
