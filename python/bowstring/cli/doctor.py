"""Command doctor: installed and missing parts, with commands that install them."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

from bowstring import threads
from bowstring._core import __version__, instructions
from bowstring.cli.options import AsJson
from bowstring.cli.output import new_table, progress_bar, write_json, write_tables
from bowstring.errors import InputError
from bowstring.optional import EXTRAS, load_extra

if TYPE_CHECKING:
    from bowstring.cli.schemas import program as schema

_FFMPEG: Final = "Debian: apt-get install ffmpeg; else https://ffmpeg.org"


def _extra(name: str) -> str:
    module = load_extra(name)
    if found := getattr(module, "__version__", None):
        return str(found)
    from importlib.metadata import version  # takes 10 ms

    return version(module.__name__)


def _calculix() -> str:
    from bowstring.fem import ccx

    return ccx.version(ccx.find())


def _ffmpeg() -> str:
    found = shutil.which("ffmpeg")
    if found is None:
        raise InputError(
            "animations as MP4 need ffmpeg, and there is no program ffmpeg on the search path; "
            f"install it ({_FFMPEG})"
        )
    return found


#: Optional parts: name, function that returns its version or raises, purpose, what pip installs for
#: it, install command.
_PARTS: Final[tuple[tuple[str, Callable[[], str], str, str | None, str], ...]] = (
    *(
        (
            extra.module,
            partial(_extra, name),
            f"{extra.purpose} ({extra.feature})",
            extra.requirement,
            extra.command,
        )
        for name, extra in EXTRAS.items()
    ),
    (
        "CalculiX",
        _calculix,
        "finite elements (bowstring fe, study --fe)",
        None,
        "Debian: apt-get install calculix-ccx; else https://www.calculix.de",
    ),
    (
        "ffmpeg",
        _ffmpeg,
        "animations as MP4 (GIF needs nothing)",
        None,
        _FFMPEG,
    ),
)


def facts() -> schema.Machine:
    """Version, interpreter, platform and processor instructions."""
    return {
        "bowstring": __version__,
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "instructions": instructions(),
        "cores": threads.cores(),
    }


def doctor(as_json: AsJson = False) -> None:
    """Show what is installed, what is missing and how to add it."""
    found: list[schema.OptionalPart] = []
    with progress_bar(_PARTS[0][0]) as progress:
        for k, (name, look, purpose, requirement, cure) in enumerate(_PARTS):
            progress(name, k / len(_PARTS))
            part: schema.OptionalPart = {
                "name": name,
                "needed_for": purpose,
                "requirement": requirement,
                "version": None,
                "problem": None,
                "cure": None,
            }
            try:
                part["version"] = look()
            except InputError as error:
                part["problem"], part["cure"] = str(error), cure
            found.append(part)
    here = facts()
    if as_json:
        content: schema.Doctor = {**here, "optional": found}
        return write_json(content)
    table = new_table("optional part", "found", "pip install", "needed for")
    for part in found:
        install = part["requirement"] or "-"
        table.add_row(part["name"], part["version"] or "no", install, part["needed_for"])
    missing = [f"{p['name']}: {p['problem']}." for p in found if p["problem"]]
    write_tables(
        f"bowstring {here['bowstring']}, Python {here['python']}, {here['platform']}, "
        f"{here['instructions']} instructions, {here['cores']} cores",
        table,
        "\n".join(missing) or "Nothing is missing.",
    )
