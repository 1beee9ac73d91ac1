"""Command playground: the page on which a robot is bent in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from bowstring.cli.output import write
from bowstring.errors import InputError

#: One file, built by `make playground`; wheels have it.
PAGE: Final = Path(__file__).with_name("playground.html")


def playground() -> None:
    """Bend a robot in the browser and see where constant curvature fails.

    It opens a file that needs neither a server nor a network; all poses are simulated.
    """
    import webbrowser

    if not PAGE.is_file():
        raise InputError(
            "the playground is not built here; run `make playground` in a clone (it needs Node.js "
            "and Rust), or install a wheel of Bowstring, which has it."
        )
    shown = webbrowser.open(PAGE.as_uri())
    write(f"{PAGE}{' is open in the browser' if shown else ': open this file in a browser'}.\n")
