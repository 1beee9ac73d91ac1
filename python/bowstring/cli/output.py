"""What commands print: JSON or tables on stdout, warnings and progress on stderr."""

from __future__ import annotations

import io
import json
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final

import typer

from bowstring._core import __version__
from bowstring.formatting import plain
from bowstring.robot.model import Robot
from bowstring.units import printable

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

OUTPUT_LOST: Final = 74  # EX_IOERR
PIPE_CLOSED: Final = 141  # as a shell reports SIGPIPE
JSON_SCHEMA_VERSION: Final = 1


class Stopped(Exception):
    """Ctrl-C where something is kept; the text says what."""


def counted(n: int, thing: str, things: str | None = None) -> str:
    return f"{n} {thing if n == 1 else things or thing + 's'}"


def say(kind: str, sentence: str) -> None:
    """A line on stderr."""
    print(printable(f"{kind}: {sentence}"), file=sys.stderr)


def write(text: str) -> None:
    """All of stdout passes here, so that a reader that leaves early is no error."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        # the interpreter flushes again when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            raise typer.Exit(PIPE_CLOSED) from None
        say("Error", f"stdout cannot be written: {error.strerror}.")
        raise typer.Exit(OUTPUT_LOST) from None


def write_json(content: dict[str, Any]) -> None:
    write(json.dumps(plain(content), allow_nan=False) + "\n")


def provenance_of(robot: Robot | None, **settings: Any) -> dict[str, Any]:
    made_by = {"bowstring_version": __version__, "schema_version": JSON_SCHEMA_VERSION}
    if robot is None:
        return {"provenance": {**made_by, "settings": settings}}
    return {
        "robot": robot.name,
        "warnings": robot.warnings,
        "provenance": {**made_by, "robot_hash": robot.hash, "settings": settings},
    }


@contextmanager
def progress_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar on stderr if a person looks at it; what it yields is told what is done, and how far."""
    if not sys.stderr.isatty():
        yield lambda what, done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda what, done: bar.update(task, description=what, completed=done)


def fields_of(thing: object, *names: str) -> dict[str, Any]:
    return {name: getattr(thing, name) for name in names}


def frame(position: Any, rotation: Any) -> dict[str, Any]:
    return {"position_m": position, "rotation": rotation}


def new_table(*columns: str) -> Table:
    """A rich table; a column whose name starts with > is aligned right."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name in columns:
        table.add_column(name.lstrip(">"), justify="right" if name.startswith(">") else "left")
    return table


def tip_line(position: Any, rotation: Any) -> str:
    x, y, z = (fixed(1e3 * float(value), 3) for value in position)
    # not acos, which loses half the digits near the straight pose
    bend = math.atan2(math.hypot(rotation[0][2], rotation[1][2]), rotation[2][2])
    return f"tip  x {x}  y {y}  z {z} mm, tip turned by {fixed(math.degrees(bend), 2)} deg"


def fixed(value: float, digits: int) -> str:
    return f"{round(float(value), digits) + 0.0:.{digits}f}"  # + 0.0: no -0.000


def write_tables(*parts: Table | str) -> None:
    def draw(console: Console) -> None:
        for i, part in enumerate(parts):
            if i:
                console.print()
            console.print(part)

    write_rich(draw)


def write_rich(draw: Callable[[Console], None]) -> None:
    from rich.console import Console, ConsoleOptions, RenderableType
    from rich.segment import Segment

    class Plain(Console):
        """Text that is shown has no control characters of its own; styles come on top of it."""

        def render(
            self, renderable: RenderableType, options: ConsoleOptions | None = None
        ) -> Iterable[Segment]:
            for part in super().render(renderable, options):
                yield part if part.control else part._replace(text=printable(part.text))

    buffer, terminal = io.StringIO(), sys.stdout.isatty()
    width = Console().width if terminal else 100
    draw(Plain(file=buffer, width=width, force_terminal=terminal, highlight=False, markup=False))
    write("\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n")
