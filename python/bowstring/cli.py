"""The command line: a thin face of the Python API. Its contract is docs/cli.md.

Libraries that take long to load are imported by the command that needs them.
"""

from __future__ import annotations

import io
import json
import math
import os
import signal
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
import typer

from bowstring import __version__, arc
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot import Robot, load_robot, robot_names, robot_schema
from bowstring.units import quote, read_number

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

BAD_INPUT: Final = 2
NO_SOLUTION: Final = 1
STOPPED: Final = 130  # as a shell reports Ctrl-C
OUTPUT_LOST: Final = 74  # EX_IOERR
PIPE_CLOSED: Final = 141  # as a shell reports SIGPIPE
BUG: Final = 70  # EX_SOFTWARE

JSON_SCHEMA_VERSION: Final = 1

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

RobotSource = Annotated[
    str, typer.Argument(metavar="ROBOT", help="A built-in robot's name or the path of a file.")
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help='Override a field: segments.0.disks.clamped_length="3 mm". Repeatable.',
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object and nothing else on stdout.")
]
Chord = Annotated[
    bool, typer.Option("--chord", help="Tendons straight from disk to disk, not parallel curves.")
]
Theory = Annotated[Literal["cosserat", "kirchhoff"], typer.Option(help="Rod theory.")]


# -- commands ----------------------------------------------------------------------------------


def _show_version(wanted: bool) -> None:
    if wanted:
        _write(f"bowstring {__version__}\n")
        raise typer.Exit()


@app.callback(invoke_without_command=True)
def _main(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Is constant curvature good enough for my cable-driven continuum robot?

    Numbers are SI unless a unit is attached: 80, "80 N", 0.641, "641 mm".
    """
    if context.invoked_subcommand is None:
        _write(context.get_help() + "\n")


@app.command()
def robots(as_json: AsJson = False) -> None:
    """List the built-in robots."""
    known = [load_robot(name) for name in robot_names()]
    if as_json:
        rows = [
            {
                "name": robot.name,
                "description": robot.description,
                "length_m": robot.length,
                "segments": len(robot.segments),
                "disks": len(robot.disks.station_m),
                "tendons": _tendon_count(robot),
            }
            for robot in known
        ]
        return _write_json({"robots": rows})
    table = _table("name", ">length mm", ">segments", ">disks", ">tendons", "description")
    for robot in known:
        counts = (len(robot.segments), len(robot.disks.station_m), _tendon_count(robot))
        table.add_row(robot.name, f"{1e3 * robot.length:g}", *map(str, counts), robot.description)
    _write_tables(table)


@app.command()
def schema(as_json: AsJson = False) -> None:
    """Print the JSON Schema of a robot file, for editors."""
    if as_json:
        return _write_json(robot_schema())
    _write(json.dumps(robot_schema(), indent=2) + "\n")


@app.command()
def fk(
    robot: RobotSource,
    lengths: Annotated[
        str, typer.Option(metavar="L1,L2,...", help="Tendon lengths, base to end disk.")
    ],
    chord: Chord = False,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Constant curvature forward: tendon lengths to arcs and tip."""
    model = _load(robot, overrides)
    values = _per_tendon("--lengths", lengths, "m", model, above_zero=True)
    try:
        arcs = arc.robot_fk(model, values, "chord" if chord else None)
    except InputError as error:
        raise InputError(f"--lengths: {error}") from None
    segments = _segments(arcs)
    for segment, misfit in zip(segments, arcs.misfit, strict=True):
        segment["misfit_m"] = float(misfit)
    result = {
        "segments": segments,
        "tip": _frame(arcs.tip.position, arcs.tip.rotation),
        **_provenance(model, lengths_m=values, chord=chord),
    }
    if as_json:
        return _write_json(result)
    _write_tables(_arc_table(segments), _tip_line(arcs.tip.position, arcs.tip.rotation))


@app.command()
def ik(
    robot: RobotSource,
    tip: Annotated[str, typer.Option(metavar="x,y,z", help="Wanted tip position.")],
    free_length: Annotated[
        bool, typer.Option("--free-length", help="Let the arc's length change to meet the point.")
    ] = False,
    chord: Chord = False,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Constant curvature backward: a tip position to arc and lengths.

    The arc has the robot's own length and comes as near to the point as it can; the miss is
    reported.
    """
    model = _load(robot, overrides)
    point = np.array(_vector("--tip", tip, "m"))
    if len(model.segments) != 1:
        raise InputError(
            f"{model.name} has {len(model.segments)} segments; ik is for robots of one segment."
        )
    if free_length:
        kappa, phi, length = arc.through_tip(point)
        miss = 0.0
    else:
        distance, reach = math.hypot(*point), model.length
        if distance > reach:
            raise InputError(
                f"--tip: got a point {1e3 * distance:.4g} mm from the base, out of reach: "
                f"{model.name} is {1e3 * reach:.4g} mm long."
            )
        kappa, phi, nearest_miss = arc.nearest_tip(point, model.length)
        length, miss = np.asarray(model.length), float(nearest_miss)
    tendons = arc.robot_lengths(
        model, kappa[None], phi[None], length[None], "chord" if chord else None
    )
    position, rotation = arc.pose(kappa, phi, length)
    segment = {
        "kappa_per_m": float(kappa),
        "phi_rad": float(phi),
        "theta_rad": float(kappa * length),
        "length_m": float(length),
    }
    result = {
        "segments": [segment],
        "tendon_lengths_m": tendons,
        "miss_m": miss,
        "tip": _frame(position, rotation),
        **_provenance(model, tip_m=point, free_length=free_length, chord=chord),
    }
    if as_json:
        return _write_json(result)
    _write_tables(
        _arc_table([segment]),
        _tip_line(position, rotation) + f"; misses the point by {1e3 * miss:.3f} mm",
        _tendon_table(model, tendons),
    )


@app.command()
def solve(
    robot: RobotSource,
    tension: Annotated[str, typer.Option(metavar="T1,T2,...", help="Tendon tensions.")],
    theory: Theory = "cosserat",
    gravity: Annotated[
        str | None, typer.Option(metavar="x,y,z", help="Gravity, instead of the file's.")
    ] = None,
    tip_force: Annotated[
        str, typer.Option(metavar="x,y,z", help="Dead force at the tip, base axes.")
    ] = "0,0,0",
    tip_moment: Annotated[
        str, typer.Option(metavar="x,y,z", help="Dead moment at the tip, base axes.")
    ] = "0,0,0",
    elements: Annotated[
        int, typer.Option(metavar="1|2|4|8", help="Elements of fourth order between two disks.")
    ] = 1,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Statics: tendon tensions and loads to the robot's equilibrium."""
    from bowstring import rod

    model = _load(robot, overrides)
    tensions = _per_tendon("--tension", tension, "N", model)
    if elements not in (1, 2, 4, 8):
        raise InputError(f"--elements: got {elements}; must be 1, 2, 4 or 8.")
    weight = _vector("--gravity", gravity, "m/s^2") if gravity is not None else model.gravity
    force = _vector("--tip-force", tip_force, "N")
    moment = _vector("--tip-moment", tip_moment, "N*m")
    solution = rod.solve(
        model,
        tensions,
        theory=theory,
        gravity=weight,
        tip_force=force,
        tip_moment=moment,
        elements=elements,
    )
    if as_json:
        _write_json(
            {
                **solution.to_dict(),
                "message": solution.message,
                **_provenance(
                    model,
                    theory=theory,
                    gravity_m_per_s2=weight,
                    tip_force_N=force,
                    tip_moment_Nm=moment,
                    elements=elements,
                ),
            }
        )
    solution.raise_for_status()
    tip = solution.tip
    assert tip is not None
    if not as_json:
        _write_tables(
            f"{model.name}, {theory}: {solution.message} "
            f"({solution.iterations} iterations, residual {solution.residual:.1e})",
            _tip_line(tip.position, tip.rotation),
            _tendon_table(model, solution.tendon_lengths, tensions),
        )


@app.command()
def study(
    robot: RobotSource = "amouri2019",
    measurements: Annotated[
        str | None, typer.Option(metavar="FILE", help="Measured tips (not available yet).")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of the report.  [default: bowstring-study/NAME OF ROBOT]"
        ),
    ] = None,
    tolerance: Annotated[
        str, typer.Option(help='Tolerated tip error, a share of the length: 0.01 or "1 %".')
    ] = "1 %",
    max_tension: Annotated[
        str | None, typer.Option(metavar="T", help="End of the sweep; chosen if not given.")
    ] = None,
    points: Annotated[int, typer.Option(metavar="N", help="Loads of the sweep.")] = 17,
    theory: Theory = "cosserat",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Compare constant curvature with statics; write a report."""
    if measurements is not None:
        raise InputError("--measurements is not available yet: this version compares simulations.")
    share = _share("--tolerance", tolerance)
    if not 0 < share < 1:
        raise InputError(
            f"--tolerance: got {quote(tolerance)}; must lie between 0 and 1, or 0 % and 100 %."
        )
    limit = None if max_tension is None else _number("--max-tension", max_tension, "N")
    if limit is not None and limit <= 0:
        raise InputError(f"--max-tension: got {limit:g} N; must be positive.")
    if not 2 <= points <= 1000:
        raise InputError(f"--points: got {points}; must be from 2 to 1000.")
    model = _load(robot, overrides)

    from bowstring import report
    from bowstring import study as study_

    folder = report.check_folder(report.default_folder(model) if out is None else out)
    with _progress() as tell:
        found = study_.run(
            model,
            tolerance=share,
            max_tension=limit,
            points=points,
            theory=theory,
            progress=lambda what, done: tell(what, 0.5 * done),
        )
        folder = report.write(
            found, folder, progress=lambda what, done: tell(what, 0.5 + 0.5 * done)
        )
    if as_json:
        return _write_json({**found.to_dict(), "folder": folder})
    _write_rich(lambda console: report.print_study(found, console, folder))


# -- reading flags -----------------------------------------------------------------------------


_EXAMPLES: Final = {
    "--lengths": '"641 mm",0.65,0.65',
    "--tension": "80,0,0",
    "--tip": "0.1,0,0.6",
    "--gravity": "0,0,-9.81",
    "--tip-force": "0,1,0",
    "--tip-moment": "0,0.1,0",
    "--tolerance": '"1 %"',
    "--max-tension": "80",
}


def _load(source: str, overrides: Sequence[str] | None) -> Robot:
    changes = {}
    for text in overrides or ():
        path, equals, value = text.partition("=")
        if not (path.strip() and equals):
            raise InputError(
                f'--set: got {quote(text)}; write for example --set segments.0.length="500 mm".'
            )
        changes[path.strip()] = value
    robot = load_robot(source, changes)
    for sentence in robot.warnings:
        _say("Warning", sentence)
    return robot


def _numbers(flag: str, text: str, si: str) -> list[float]:
    values = []
    for item in text.split(","):
        try:
            values.append(read_number(item, si))
        except ValueError as error:
            raise InputError(
                f"{flag}: got {quote(item.strip())}, {error}; write for example "
                f"{flag} {_EXAMPLES[flag]}."
            ) from None
    return values


def _number(flag: str, text: str, si: str) -> float:
    values = _numbers(flag, text, si)
    if len(values) != 1:
        raise InputError(f"{flag}: got {len(values)} numbers; write one.")
    return values[0]


def _share(flag: str, text: str) -> float:
    """A share as "0.01" or "1 %"."""
    percent = text.strip().endswith("%")
    value = _number(flag, text.strip().rstrip("%") if percent else text, "")
    return value / 100.0 if percent else value


def _vector(flag: str, text: str, si: str) -> list[float]:
    values = _numbers(flag, text, si)
    if len(values) != 3:
        raise InputError(
            f"{flag}: got {_count(len(values), 'number')}; write x, y and z, "
            f"for example {flag} {_EXAMPLES[flag]}."
        )
    return values


def _per_tendon(
    flag: str, text: str, si: str, robot: Robot, above_zero: bool = False
) -> list[float]:
    values = _numbers(flag, text, si)
    wanted = _tendon_count(robot)
    if len(values) != wanted:
        raise InputError(
            f"{flag}: got {_count(len(values), 'number')}; {robot.name} has "
            f"{_count(wanted, 'tendon')}, write one number for each."
        )
    for i, value in enumerate(values, 1):
        if value < 0 or (above_zero and value == 0):
            rule = "positive" if above_zero else "0 or more, a tendon cannot push"
            raise InputError(f"{flag}: got {value:g} {si} for tendon {i}; must be {rule}.")
    return values


def _tendon_count(robot: Robot) -> int:
    return len(robot.tendons.angle_rad)


def _count(n: int, thing: str) -> str:
    return f"{n} {thing}" + ("" if n == 1 else "s")


# -- writing -----------------------------------------------------------------------------------


def _say(kind: str, sentence: str) -> None:
    """A line on stderr."""
    print(f"{kind}: {sentence}", file=sys.stderr)


def _write(text: str) -> None:
    """All of stdout passes here, so that a reader that leaves early is no error."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except OSError as error:
        # the interpreter flushes again when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            raise typer.Exit(PIPE_CLOSED) from None
        _say("Error", f"stdout cannot be written: {error.strerror}.")
        raise typer.Exit(OUTPUT_LOST) from None


def _write_json(content: dict[str, Any]) -> None:
    _write(json.dumps(_plain(content), allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    """What JSON can hold: lists for arrays, null for what is not a finite number."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, (np.ndarray, np.generic)):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return str(value) if isinstance(value, Path) else value


def _provenance(robot: Robot, **settings: Any) -> dict[str, Any]:
    return {
        "robot": robot.name,
        "warnings": robot.warnings,
        "provenance": {
            "bowstring_version": __version__,
            "schema_version": JSON_SCHEMA_VERSION,
            "robot_hash": robot.hash,
            "settings": settings,
        },
    }


@contextmanager
def _progress() -> Iterator[Callable[[str, float], None]]:
    """A bar on stderr if a person looks at it; what it yields is told what is done, and how far."""
    if not sys.stderr.isatty():
        yield lambda what, done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda what, done: bar.update(task, description=what, completed=done)


def _frame(position: Any, rotation: Any) -> dict[str, Any]:
    return {"position_m": position, "rotation": rotation}


def _segments(arcs: arc.RobotArcs) -> list[dict[str, float]]:
    columns = (arcs.kappa, arcs.phi, arcs.theta, arcs.length)
    names = ("kappa_per_m", "phi_rad", "theta_rad", "length_m")
    return [dict(zip(names, map(float, row), strict=True)) for row in zip(*columns, strict=True)]


def _table(*columns: str) -> Table:
    """A rich table; a column whose name starts with > is aligned right."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for name in columns:
        table.add_column(name.lstrip(">"), justify="right" if name.startswith(">") else "left")
    return table


def _arc_table(segments: Sequence[dict[str, float]]) -> Table:
    fitted = "misfit_m" in segments[0]
    names = ("segment", ">kappa 1/m", ">phi deg", ">theta deg", ">length mm")
    table = _table(*names, *([">misfit mm"] if fitted else []))
    for i, s in enumerate(segments, 1):
        table.add_row(
            str(i),
            _fixed(s["kappa_per_m"], 6),
            _fixed(math.degrees(s["phi_rad"]), 3),
            _fixed(math.degrees(s["theta_rad"]), 3),
            _fixed(1e3 * s["length_m"], 3),
            *([_fixed(1e3 * s["misfit_m"], 3)] if fitted else []),
        )
    return table


def _tip_line(position: Any, rotation: Any) -> str:
    x, y, z = (_fixed(1e3 * float(value), 3) for value in position)
    # not acos, which loses half the digits near the straight pose
    bend = math.atan2(math.hypot(rotation[0][2], rotation[1][2]), rotation[2][2])
    return f"tip  x {x}  y {y}  z {z} mm, tip turned by {_fixed(math.degrees(bend), 2)} deg"


def _tendon_table(robot: Robot, lengths: Any, tensions: Sequence[float] | None = None) -> Table:
    straight = robot.disks.station_m[robot.tendons.end_disk]
    table = _table("tendon", *([">tension N"] if tensions else []), ">length mm", ">pull mm")
    for i, length in enumerate(lengths):
        table.add_row(
            str(i + 1),
            *([f"{tensions[i]:g}"] if tensions else []),
            _fixed(1e3 * length, 3),
            _fixed(1e3 * (straight[i] - length), 3),
        )
    return table


def _fixed(value: float, digits: int) -> str:
    return f"{round(float(value), digits) + 0.0:.{digits}f}"  # + 0.0: no -0.000


def _write_tables(*parts: Table | str) -> None:
    def draw(console: Console) -> None:
        for i, part in enumerate(parts):
            if i:
                console.print()
            console.print(part)

    _write_rich(draw)


def _write_rich(draw: Callable[[Console], None]) -> None:
    from rich.console import Console

    buffer, terminal = io.StringIO(), sys.stdout.isatty()
    width = Console().width if terminal else 100
    draw(Console(file=buffer, width=width, force_terminal=terminal, highlight=False, markup=False))
    _write("\n".join(line.rstrip() for line in buffer.getvalue().splitlines()) + "\n")


# -- the process -------------------------------------------------------------------------------


def run(arguments: Sequence[str]) -> int:
    """Run one command.

    Parameters
    ----------
    arguments : sequence of str
        As after ``bowstring`` in a shell.

    Returns
    -------
    int
        Exit code: 0, 1 for no solution, 2 for bad input, 70 for a bug, 130 after Ctrl-C, 141 when
        the reader of stdout has left.
    """
    try:
        code = app(list(arguments), prog_name="bowstring", standalone_mode=False)
    except InputError as error:
        _say("Error", str(error))
        return BAD_INPUT
    except NoSolutionError as error:
        _say("Error", str(error))
        return NO_SOLUTION
    except typer.TyperException as error:
        context = getattr(error, "ctx", None)
        command = context.command_path if context else "bowstring"
        sentence = " ".join(error.format_message().split()).rstrip(".")
        sentence = sentence.replace("Value error, ", "")
        _say("Error", f"{sentence}; see {command} --help.")
        return BAD_INPUT
    except KeyboardInterrupt:
        code = STOPPED
    except BaseException as error:  # a panic of the core is no Exception
        if isinstance(error, SystemExit):
            raise
        traceback.print_exc()
        _say("Error", "this is a bug in Bowstring; please report it with the lines above.")
        return BUG
    if code == STOPPED:
        _say("Stopped", "nothing was written.")
    return code if isinstance(code, int) else 0


def main() -> None:
    """Entry point of the command ``bowstring``."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a name in Greek on an ASCII terminal
    # as Ctrl-C, so that a study takes its temporary folder away
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    sys.exit(run(sys.argv[1:]))
