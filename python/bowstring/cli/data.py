"""Commands of public data sets: data list, data get."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bowstring.cli.options import AsJson, of_flag, option
from bowstring.cli.output import new_table, write, write_json, write_tables
from bowstring.units import printable


def list_sets(as_json: AsJson = False) -> None:
    """List the public data sets."""
    from bowstring.data import datasets

    sets = [datasets.describe(name) for name in datasets.available()]
    if as_json:
        rows = [
            {
                "name": item.name,
                "description": item.description,
                "kind": item.kind,
                "repository": item.repository,
                "commit": item.commit,
                "licence": item.licence,
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
    name: Annotated[str, typer.Argument(metavar="NAME", help="See bowstring data list.")],
    out: Annotated[Path | None, option("DIR", "Copy the files to DIR/NAME.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fetch a public data set at its pinned commit, and check it."""
    from bowstring.data import datasets

    item = datasets.describe(name)
    if out is None:
        folder = datasets.path(name)
    else:
        folder = of_flag("--out", lambda place: datasets.copy(name, place), out)
    if as_json:
        files = [folder / file.name for file in item.files]
        return write_json(
            {
                "name": name,
                "kind": item.kind,
                "folder": folder,
                "files": files,
                "repository": item.repository,
                "commit": item.commit,
                "licence": item.licence,
            }
        )
    write(
        f"{printable(str(folder))}: {item.kind}, {item.licence} licence, "
        f"github.com/{item.repository} at commit {item.commit[:12]}; hashes agree\n"
    )
