"""Command line, a thin layer on the Python API; its contract is docs/reference/cli.md.

Libraries that take long to load are imported by the command that needs them.
"""

from __future__ import annotations

import io
import re
import sys
import traceback
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Final, TextIO

import typer

from bowstring import interrupts
from bowstring.cli.groups import Command, Quiet, spread
from bowstring.cli.output import Stopped, be_quiet, coloured, say, warn, write
from bowstring.errors import FigureWarning, InputError, NoSolutionError, StabilityWarning

BAD_INPUT: Final = 2
NO_SOLUTION: Final = 1
STOPPED: Final = 130  # as a shell reports Ctrl-C
BUG: Final = 70  # EX_SOFTWARE
#: Module and function of each command.
_COMMANDS: Final = {
    "new": "new.new",
    "robots": "statics.robots",
    "schema": "statics.schema",
    "fk": "statics.fk",
    "ik": "inverse.ik",
    "control": "control.control",
    "reach": "control.reach",
    "solve": "statics.solve",
    "branches": "branches.branches",
    "study": "study.study",
    "suite": "suite.suite",
    "simulate": "dynamics.simulate",
    "modes": "dynamics.modes",
    "fit": "fit.fit",
    "fe": "fe.fe",
    "export": "export.export",
    "view": "view.view",
    "playground": "playground.playground",
    "doctor": "doctor.doctor",
    "map": "map.map_",
    "uncertainty": "uncertainty.uncertainty",
    "bench check": "bench.check",
    "bench simulate": "bench.simulate",
    "data list": "data.list_sets",
    "data get": "data.get",
}
_GROUPS: Final = {"bench": "Data of a test bench.", "data": "Public data sets."}


def _group(quiet: Quiet = False) -> None:
    if quiet:
        be_quiet(True)


def _show_version(wanted: bool) -> None:
    if wanted:
        from bowstring.cli import doctor

        here = doctor.facts()
        write(
            f"bowstring {here['bowstring']} (Python {here['python']}, {here['platform']}, "
            f"{here['instructions']} instructions)\n"
        )
        raise typer.Exit()


def _main(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Is constant curvature good enough for my cable-driven continuum robot?

    Numbers are SI unless a unit is attached: 80, "80 N", 0.641, "641 mm".
    """
    if quiet:
        be_quiet(True)
    if context.invoked_subcommand is None:
        write(context.get_help() + "\n")


def _app(only: str = "", *, flags: bool = True) -> typer.Typer:
    """Make the parser of all commands, or of one command or group alone, which takes less time.

    Without flags, the commands are there for the help of the program.
    """
    app = typer.Typer(
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["-h", "--help"]},
    )
    app.callback(invoke_without_command=True)(_main)
    groups = {"": app}
    for name, text in _GROUPS.items():
        groups[name] = typer.Typer(help=text, rich_markup_mode=None)
        groups[name].callback()(_group)
        app.add_typer(groups[name], name=name)
    for name, place in _COMMANDS.items():
        if only not in ("", name.split()[0]):
            continue
        module, function = place.split(".")
        command = getattr(import_module(f"bowstring.cli.{module}"), function)
        group, _, own = name.rpartition(" ")
        groups[group].command(own, cls=Command)(spread(command) if flags else _named(command))
    return app


def _named(command: Callable[..., None]) -> Callable[[], None]:
    def run() -> None: ...

    run.__doc__ = command.__doc__
    return run


def _app_of(arguments: Sequence[str]) -> typer.Typer:
    """Make the parser that these arguments need."""
    first = next((text for text in arguments if text not in ("-q", "--quiet")), "")
    if first in ("-h", "--help", "--version"):
        return _app(flags=False)
    return _app(first if first in {name.split()[0] for name in _COMMANDS} else "")


def __getattr__(name: str) -> typer.Typer:
    if name == "app":  # all commands, for documentation and tests
        return _app()
    raise AttributeError(name)


# Flags whose name differs from that of their argument.
_FLAGS: Final = {
    "tensions": ("--tension", "--tensions"),
    "displacements": ("--displacement", "--displacements"),
    "angles": ("--angle",),
    "parameters": ("--parameter",),
    "count": ("--samples",),
    "g": ("--gravity-on-masses",),
}
# Flags from which an argument is made.
_MADE_OF: Final = {
    "tensions": ("--from", "--masses", "--table"),
    "displacements": ("--angle", "--from-displacement", "--table"),
}


def in_flags(error: InputError, arguments: Sequence[str]) -> str:
    """Message of an error with the given flags from which its value can come."""
    if not error.argument:
        return str(error)
    before = takewhile(lambda text: text != "--", arguments)
    given = {text.partition("=")[0] for text in before}
    own = _FLAGS.get(error.argument, ("--" + error.argument.replace("_", "-"),))
    flags = [flag for flag in own if flag in given]
    made_of = [flag for flag in _MADE_OF.get(error.argument, ()) if flag in given]
    if not (flags or made_of):
        return str(error)
    if made_of or not error.rule:
        return f"{' or '.join([*flags, *made_of])}: {error}"
    where = "" if error.index is None else f" for tendon {error.index + 1}"
    return f"{flags[0]}: got {error.value}{where}; must be {error.rule}."


_LISTS: Final = 'separate numbers by commas without blanks, or quote the list: "5 N,0,0"'


def _with_advice(sentence: str, context: Any, arguments: Sequence[str]) -> str:
    """Typer's sentence on wrong arguments, or what to write instead where that is known."""
    from bowstring.units import is_numbers

    extra = re.fullmatch(r"Got unexpected extra argument\S* \((.*)\)", sentence)
    if extra and is_numbers(extra[1]):
        return f"unexpected {extra[1]}: {_LISTS}"
    unknown = re.match(r"No such option: (-[-\w]+)", sentence)
    if unknown and re.match(r"-\.?\d", unknown[1]):
        return f"unexpected {unknown[1]}: {_LISTS}"
    takes = {flag for each in context.command.params for flag in each.opts} if context else set()
    if unknown and "--set" in takes:
        from bowstring.robot.messages import paths_of_field

        given = [text.partition("=") for text in arguments]
        places = [i for i, (flag, _, _) in enumerate(given) if flag == unknown[1]]
        value = "VALUE"
        if places:
            following = [a for a in arguments[places[0] + 1 : places[0] + 2] if a[:1] != "-"]
            value = given[places[0]][2] or (following[0] if following else value)
        paths = paths_of_field(unknown[1].lstrip("-").replace("-", "_"))
        if paths:
            value = f'"{value}"' if " " in value else value
            ways = " or ".join(f"--set {path}={value}" for path in paths)
            return f"no flag {unknown[1]}; it is a field of the robot file: write {ways}"
    return sentence


def _is_numerical(error: BaseException) -> bool:
    """Whether numbers, not code, ended the computation; NumPy is imported by few commands."""
    of_numpy = type(error).__name__ == "LinAlgError"
    return of_numpy or isinstance(error, FloatingPointError | OverflowError)


def _numerical_failure(error: BaseException) -> str:
    """Sentence on a numerical exception, with the line of Bowstring that it comes from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if "bowstring" in Path(frame.filename).parts]
    where = f" (in {Path(own[-1].filename).name}, line {own[-1].lineno})" if own else ""
    return (
        f"the computation fails for these numbers{where}: {str(error).rstrip('.')}; try other "
        "values, and please report the command and this sentence."
    )


def run(arguments: Sequence[str]) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str
        Arguments as after ``bowstring`` in a shell.

    Returns
    -------
    int
        Exit code: 0, 1 for no solution, 2 for bad input, 70 for a bug, 130 after Ctrl-C, 141 for a
        broken pipe of stdout.
    """
    be_quiet(False)
    try:
        # None: typer detects a terminal itself
        style = None if coloured(sys.stdout) else False
        app = _app_of(arguments)
        code = app(list(arguments), prog_name="bowstring", standalone_mode=False, color=style)
        late = interrupts.pending() and code != STOPPED
        interrupts.acknowledge()
        if late:
            say("Stopped", "the work was done before.")
            return STOPPED
    except (InputError, NoSolutionError) as error:
        if interrupts.pending():  # the interrupt caused the error, for example in an import
            code = STOPPED
        else:
            if isinstance(error, InputError):
                say("Error", in_flags(error, arguments))
                return BAD_INPUT
            say("Error", str(error))
            return NO_SOLUTION
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "bowstring"
        sentence = " ".join(error.format_message().split()).rstrip(".")
        sentence = _with_advice(sentence.replace("Value error, ", ""), context, arguments)
        see = f" See {command}" if sentence.endswith("?") else f"; see {command}"
        say("Error", f"{sentence}{see} --help.")
        return BAD_INPUT
    except MemoryError as error:
        what = f" ({error})" if str(error) else ""
        say("Error", f"the memory does not suffice{what}; ask for less at a time.")
        return BAD_INPUT
    except Stopped as stopped:
        interrupts.acknowledge()
        say("Stopped", str(stopped))
        return STOPPED
    except KeyboardInterrupt:
        code = STOPPED
    except BaseException as error:  # a panic of the core is a BaseException
        if isinstance(error, SystemExit):
            raise
        if not (interrupts.is_interrupt(error) or interrupts.pending()):
            if _is_numerical(error):
                say("Error", _numerical_failure(error))
                return NO_SOLUTION
            traceback.print_exc()
            say("Error", "this is a bug in Bowstring; please report it with the lines above.")
            return BUG
        code = STOPPED
    if code == STOPPED:
        interrupts.acknowledge()
        say("Stopped", "nothing was written.")
    return code if isinstance(code, int) else 0


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Show a warning; those of Bowstring without their line of code."""
    if issubclass(category, (StabilityWarning, FigureWarning)):
        warn(str(message))
    else:
        sys.stderr.write(warnings.formatwarning(message, category, filename, lineno, line))


def main() -> None:
    """Entry point of the command ``bowstring``."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # non-ASCII names on an ASCII terminal
    warnings.showwarning = _show_warning
    interrupts.listen()
    try:
        code = run(sys.argv[1:])
    finally:
        interrupts.ignore()
    sys.exit(code)
