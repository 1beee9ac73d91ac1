"""Output of commands: JSON or tables on stdout, warnings and progress on stderr."""

from __future__ import annotations

import io
import json
import math
import os
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, Final, TextIO

import typer

from bowstring._core import __version__
from bowstring.errors import InputError
from bowstring.formatting import listed, plain
from bowstring.units import printable

if TYPE_CHECKING:
    from pathlib import Path

    from rich.console import Console
    from rich.table import Table

    from bowstring.aliases import Progress
    from bowstring.cli.schemas import basic as schema
    from bowstring.robot.model import Robot

OUTPUT_LOST: Final = 74  # EX_IOERR
PIPE_CLOSED: Final = 141  # as a shell reports SIGPIPE
JSON_SCHEMA_VERSION: Final = 1
_BAR_AFTER: Final = 0.3  # s of work before its bar appears
_BAR_EVERY: Final = 0.1  # s between two drawings
_BAR_WIDTH: Final = 24
_quiet = False
_bar: _Bar | None = None  # the bar on the terminal


class Stopped(Exception):
    """Ctrl-C after which some output remains; the message names it."""


def counted(n: int, thing: str, things: str | None = None) -> str:
    return f"{n} {thing if n == 1 else things or thing + 's'}"


def rod_model(theory: str) -> str:
    """The rod model and its theory, for a heading."""
    return f"rod model ({theory.capitalize()})"


def be_quiet(wanted: bool) -> None:
    """Switch progress, notes and warnings off, or on again."""
    global _quiet
    _quiet = wanted


def say(kind: str, sentence: str) -> None:
    """Print a line on stderr."""
    if kind in ("Warning", "Note") and _quiet:
        return
    if _bar is not None:
        _bar.clear()
    print(printable(f"{kind}: {sentence}"), file=sys.stderr)


def warn(*sentences: str) -> None:
    """Print warnings on stderr."""
    for sentence in sentences:
        say("Warning", sentence)


def coloured(stream: TextIO) -> bool:
    """Whether styled text may be written: https://no-color.org and https://force-color.org."""
    if os.environ.get("NO_COLOR") or os.environ.get("TERM") == "dumb":
        return False
    return bool(os.environ.get("FORCE_COLOR")) or stream.isatty()


def write(text: str) -> None:
    """Write to stdout; a broken pipe is no error. All output to stdout passes here."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        # the interpreter flushes again at its end
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            raise typer.Exit(PIPE_CLOSED) from None
        say("Error", f"stdout cannot be written: {error.strerror}.")
        raise typer.Exit(OUTPUT_LOST) from None


NOT_DRAWN: Final = "not drawn"


def figure_file(save: Callable[[], Path]) -> str | None:
    """Save a figure and return its path; None, with a warning, where drawing it failed."""
    from bowstring.viz.style import not_drawn

    try:
        return str(save())
    except Exception as error:
        not_drawn("the figure", error)
        return None


@contextmanager
def naming(written: Mapping[str, object]) -> Iterator[None]:
    """On an error or Ctrl-C, name the files that are already written."""
    try:
        yield
    except (InputError, KeyboardInterrupt) as error:
        files = [str(file) for file in written.values() if file]
        if not files:
            raise
        kept = f"of the files only {listed(files)} {'is' if len(files) == 1 else 'are'} written"
        if isinstance(error, InputError):
            raise InputError(f"{error}; {kept}") from None
        raise Stopped(f"{kept}.") from None


def write_json(content: Mapping[str, object]) -> None:
    write(json.dumps(plain(dict(content)), allow_nan=False) + "\n")


def made_by(**settings: Any) -> schema.MadeBy:
    return {
        "bowstring_version": __version__,
        "schema_version": JSON_SCHEMA_VERSION,
        "settings": settings,
    }


def provenance_of(robot: Robot, **settings: Any) -> schema.OfRobot:
    return {
        "robot": robot.name,
        "warnings": list(robot.warnings),
        "provenance": {**made_by(**settings), "robot_hash": robot.hash},
    }


class _Bar:
    """Progress line on the terminal: work, finished share, elapsed and remaining time.

    A thread draws it, so that the time advances during work without reports. It uses neither
    colours nor other escape codes.
    """

    def __init__(self, what: str) -> None:
        self._began = time.monotonic()
        self._state = (what, 0.0, 0.0)  # work, finished share, and time of the report in s
        self._drawn = 0  # columns
        self._lock, self._end = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._draw, daemon=True)
        self._thread.start()

    def update(self, what: str, done: float) -> None:
        _, before, reported = self._state
        self._state = (what, done, reported if done == before else time.monotonic() - self._began)

    def clear(self) -> None:
        """Erase the line until it is drawn again."""
        with self._lock:
            if self._drawn:
                self._write("")

    def close(self) -> None:
        self._end.set()
        self._thread.join()
        self.clear()

    def _draw(self) -> None:
        pause = _BAR_AFTER
        while not self._end.wait(pause):
            with self._lock:
                self._write(progress_line(*self._state, time.monotonic() - self._began))
            pause = _BAR_EVERY

    def _write(self, line: str) -> None:
        width = os.get_terminal_size(sys.stderr.fileno()).columns or 80
        line = line[: width - 1]
        print(f"\r{line:{self._drawn}}", end="\r" * (not line), file=sys.stderr, flush=True)
        self._drawn = len(line)


def progress_line(what: str, done: float, reported: float, now: float) -> str:
    """Format a progress bar as one line of text.

    ``done`` is the finished share, 0 if unknown. ``reported`` and ``now`` are the times of its
    report and of now, in seconds from the start.
    """
    if done > 0.0:
        filled = round(_BAR_WIDTH * min(done, 1.0))
        bar = "#" * filled + "." * (_BAR_WIDTH - filled)
        left = max(reported / done - now, 0.0)
        state = f"{100 * min(done, 1.0):3.0f} %  {_clock(now)} elapsed, {_clock(left)} left"
    else:
        place = int(now / _BAR_EVERY) % (_BAR_WIDTH - 2)
        bar = f"{'.' * place + '###':.<{_BAR_WIDTH}}"
        state = f"  -    {_clock(now)} elapsed"
    return f"[{bar}] {state}  {printable(what)}"


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


@contextmanager
def progress_bar(what: str) -> Iterator[Progress]:
    """Show a progress bar on stderr if it is a terminal; ``what`` is its first label.

    Yields a callback that takes the current step and the share done, 0 if it is unknown.
    """
    global _bar
    if _quiet or not sys.stderr.isatty() or os.environ.get("TERM") == "dumb":
        yield lambda what, done: None
        return
    _bar = bar = _Bar(what)
    try:
        yield bar.update
    finally:
        _bar = None
        bar.close()


def new_table(*columns: str) -> Table:
    """Make a rich table; a column whose name starts with > is aligned right."""
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
        """Console that removes control characters from text before styles are applied."""

        def render(
            self, renderable: RenderableType, options: ConsoleOptions | None = None
        ) -> Iterable[Segment]:
            for part in super().render(renderable, options):
                yield part if part.control else part._replace(text=printable(part.text))

    buffer = io.StringIO()
    width = Console().width if sys.stdout.isatty() else 100
    styled = coloured(sys.stdout)
    draw(Plain(file=buffer, width=width, force_terminal=styled, highlight=False, markup=False))
    write("\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n")
