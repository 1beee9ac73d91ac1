"""Commands of public data sets: data list, data get."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bowstring.cli import completion
from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import AsJson
from bowstring.cli.output import new_table, progress_bar, write, write_json, write_tables
from bowstring.units import printable

if TYPE_CHECKING:
    from bowstring.cli.schemas import program as schema
    from bowstring.data.datasets import DataSet


def list_sets(as_json: AsJson = False) -> None:
    """List the public data sets."""
    from bowstring.data import datasets

    sets = [datasets.describe(name) for name in datasets.available()]
    if as_json:
        rows: list[schema.DataSet] = [
            {
                **_origin(item),
                "description": item.description,
                "transcribed_from": item.transcribed,
                "parts": list(item.parts),
                "files": [
                    {"name": f.name, "url": item.url(f), "sha256": f.sha256} for f in item.files
                ],
            }
            for item in sets
        ]
        content: schema.DataSets = {"data_sets": rows}
        return write_json(content)
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
    with progress_bar(name) as notify:
        if out is None:
            folder = datasets.path(name, progress=notify)
        else:
            folder = of_flag(
                "--out", lambda place: datasets.copy(name, place, progress=notify), out
            )
    if as_json:
        content: schema.DataFolder = {
            **_origin(item),
            "folder": str(folder),
            "files": [str(folder / file.name) for file in item.files],
        }
        return write_json(content)
    write(
        f"{printable(str(folder))}: {item.kind}, {item.licence} licence, "
        f"github.com/{item.repository} at commit {item.commit[:12]}; hashes agree\n"
    )


def _origin(item: DataSet) -> schema.DataOrigin:
    return {
        "name": item.name,
        "kind": item.kind,
        "repository": item.repository,
        "commit": item.commit,
        "licence": item.licence,
    }
