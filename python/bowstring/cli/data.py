"""Commands of public data sets: data list, data get."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from bowstring.cli import completion
from bowstring.cli.options import AsJson, of_flag, option
from bowstring.cli.output import fields_of, new_table, progress_bar, write, write_json, write_tables
from bowstring.units import printable

_WHERE: Final = ("kind", "repository", "commit", "licence")


def list_sets(as_json: AsJson = False) -> None:
    """List the public data sets."""
    from bowstring.data import datasets

    sets = [datasets.describe(name) for name in datasets.available()]
    if as_json:
        rows = [
            {
                **fields_of(item, "name", "description", *_WHERE),
                "transcribed_from": item.transcribed,
                "parts": item.parts,
                "files": [
                    {"name": f.name, "url": item.url(f), "sha256": f.sha256} for f in item.files
                ],
            }
            for item in sets
        ]
        return write_json({"data_sets": rows})
    table = new_table("name", "kind", "licence", "parts", "description")
    for item in sets:
        table.add_row(item.name, item.kind, item.licence, " ".join(item.parts), item.description)
    write_tables(table)


def get(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME",
            help="One of those that bowstring data list shows.",
            autocompletion=completion.data_sets,
        ),
    ],
    out: Annotated[Path | None, option("DIR", "Copy the files to DIR/NAME.")] = None,
    as_json: AsJson = False,
) -> None:
    """Download a public data set and check it."""
    from bowstring.data import datasets

    item = datasets.describe(name)
    with progress_bar(name) as tell:
        if out is None:
            folder = datasets.path(name, progress=tell)
        else:
            folder = of_flag("--out", lambda place: datasets.copy(name, place, progress=tell), out)
    if as_json:
        return write_json(
            {
                **fields_of(item, "name", "kind"),
                "folder": folder,
                "files": [folder / file.name for file in item.files],
                **fields_of(item, *_WHERE[1:]),
            }
        )
    write(
        f"{printable(str(folder))}: {item.kind}, {item.licence} licence, "
        f"github.com/{item.repository} at commit {item.commit[:12]}; hashes agree\n"
    )
