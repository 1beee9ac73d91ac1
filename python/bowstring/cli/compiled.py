"""Command compile: a robot for the C library."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import AsJson, RobotOfStudy
from bowstring.cli.output import provenance_of, write, write_json
from bowstring.formatting import plain

if TYPE_CHECKING:
    from bowstring.schemas.compiled import Compiled

_WHAT: Final = "compiled robot"
_MARK: Final = b'"format": "bowstring compiled robot"'


def compile_(
    robot: RobotOfStudy,
    out: Annotated[
        Path | None, option("FILE", "File to write (.json), in place of stdout.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Write a robot as plain numbers in SI for the C library (bowstring.h).

    The library reads no robot files: it reads what this command writes, with all defaults and units
    resolved.
    """
    from bowstring.atomic_io import check_file, write_whole_file
    from bowstring.inverse.compiled import compile_robot

    def check(path: Path) -> Path:
        return check_file(path, _WHAT, (".json",), _MARK)

    file = None if out is None else of_flag("--out", check, out)
    content: Compiled = {**compile_robot(robot), **provenance_of(robot)}
    text = json.dumps(plain(dict(content)), allow_nan=False, indent=1) + "\n"
    if file is not None:
        write_whole_file(file, _WHAT, lambda new: _fill(new, text), lambda: check(file))
    if as_json:
        return write_json(content)
    write(text if file is None else f"Compiled robot: {file}\n")


def _fill(file: Path, text: str) -> None:
    file.write_text(text, "utf-8")
