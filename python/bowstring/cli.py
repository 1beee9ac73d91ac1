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
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np
import typer

from bowstring import __version__, arc
from bowstring.errors import InputError, NoSolutionError
from bowstring.files import check_parent
from bowstring.robot import Robot, load_robot, robot_names, robot_schema
from bowstring.units import quote, read_number, rounded

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

    from bowstring.bench import Bench
    from bowstring.calibration import Calibration
    from bowstring.dynamics import Run
    from bowstring.measurements import Measurements, TendonCheck
    from bowstring.rod import Solution

BAD_INPUT: Final = 2
NO_SOLUTION: Final = 1
STOPPED: Final = 130  # as a shell reports Ctrl-C
OUTPUT_LOST: Final = 74  # EX_IOERR
PIPE_CLOSED: Final = 141  # as a shell reports SIGPIPE
BUG: Final = 70  # EX_SOFTWARE

JSON_SCHEMA_VERSION: Final = 1
TIP_INTERVAL: Final = 0.01  # s, of the tip in the JSON of simulate, if --every is not longer
LONGEST_RUN: Final = 10_000.0  # s
SHORTEST_STEP: Final = 1e-6  # s
MOST_OUTPUTS: Final = 1_000_000
MOST_ISSUES: Final = 20  # that people are shown
MOST_LOADS: Final = 100_000  # of a range

_TOO_SHORT: Final = f"{SHORTEST_STEP:g} s or more are possible, less drowns in rounding."

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
bench_app = typer.Typer(help="Data of a test bench.", rich_markup_mode=None)
app.add_typer(bench_app, name="bench")
data_app = typer.Typer(help="Public data sets.", rich_markup_mode=None)
app.add_typer(data_app, name="data")

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


Gravity = Annotated[
    str | None, typer.Option(metavar="x,y,z", help="Gravity, instead of the file's.")
]
Elements = Annotated[
    int, typer.Option(metavar="1|2|4|8", help="Elements of fourth order between two disks.")
]
TipForce = Annotated[
    str, typer.Option(metavar="x,y,z", help="Dead force at the tip, base axes, all the time.")
]

MappingFile = Annotated[
    str | None,
    typer.Option(metavar="FILE", help="Mapping of a table that is not in the tidy format (YAML)."),
]
OfMasses = Annotated[
    str, typer.Option("--g", metavar="g", help="Gravity that makes tensions of masses.")
]


class _Stopped(Exception):
    """Ctrl-C where something is kept; the text says what."""


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
    tension: Annotated[
        str | None, typer.Option(metavar="T1,T2,...", help="Tendon tensions.")
    ] = None,
    pull: Annotated[
        str | None,
        typer.Option(
            metavar="P1,P2,...",
            help="Lengths taken in since the home pose; negative is paid out. With - for a tendon "
            "in one list, another says how it is driven: --tension 5,-,- --pull -,2mm,2mm.",
        ),
    ] = None,
    angle: Annotated[
        str | None, typer.Option(metavar="A1,A2,...", help="Motor angles, in rad or with a unit.")
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Go on with the path of --save-history before."),
    ] = None,
    save_history: Annotated[
        Path | None, typer.Option(metavar="FILE", help="JSON file of where the path has come to.")
    ] = None,
    theory: Theory = "cosserat",
    gravity: Gravity = None,
    tip_force: Annotated[
        str, typer.Option(metavar="x,y,z", help="Dead force at the tip, base axes.")
    ] = "0,0,0",
    tip_moment: Annotated[
        str, typer.Option(metavar="x,y,z", help="Dead moment at the tip, base axes.")
    ] = "0,0,0",
    elements: Elements = 1,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Statics: tendon tensions, pulls and loads to the robot's equilibrium."""
    from bowstring import rod

    model = _load(robot, overrides)
    tensions, pulls, angles = _driven_by(model, tension, pull, angle)
    _check_elements(elements)
    weight = _vector("--gravity", gravity, "m/s^2") if gravity is not None else model.gravity
    force = _vector("--tip-force", tip_force, "N")
    moment = _vector("--tip-moment", tip_moment, "N*m")
    before = None if history is None else _read_history(history)
    if save_history is not None:
        _of("--save-history", _check_history_file, save_history)
    solution = rod.solve(
        model,
        tensions,
        pulls=pulls,
        angles=angles,
        history=before,
        theory=theory,
        gravity=weight,
        tip_force=force,
        tip_moment=moment,
        elements=elements,
    )
    if save_history is not None and solution.converged:
        _write_history(save_history, solution.history)
    if as_json:
        _write_json(
            {
                **solution.to_dict(),
                "message": solution.message,
                **_provenance(
                    model,
                    tensions_N=tensions,
                    pulls_m=pulls,
                    angles_rad=angles,
                    history=history,
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
            _driven_table(solution),
        )


@app.command()
def study(
    robot: RobotSource = "amouri2019",
    measurements: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Table of measurements (docs/bench.md): all models against them."
        ),
    ] = None,
    mapping: MappingFile = None,
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
    rise: Annotated[
        str | None,
        typer.Option(metavar="s", help="Rise of the tension in dynamics; chosen if not given."),
    ] = None,
    modal_damping: Annotated[
        str, typer.Option(help='Damping in dynamics, a share of critical: 0.05 or "5 %".')
    ] = "5 %",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Compare constant curvature with statics, dynamics and measurements; write a report."""
    if mapping is not None and measurements is None:
        raise InputError("--mapping is of a table; name the table by --measurements.")
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
    seconds = None if rise is None else _number("--rise", rise, "s")
    if seconds is not None and seconds <= 0:
        raise InputError(f"--rise: got {seconds:g} s; must be positive.")
    damping = _share("--modal-damping", modal_damping)
    if not 0 <= damping < 1:
        raise InputError(
            f"--modal-damping: got {quote(modal_damping)}; must lie from 0 to below 1, or 0 % to "
            "below 100 %."
        )
    model = _load(robot, overrides)

    from bowstring import report
    from bowstring import study as study_

    folder = _of("--out", report.check_folder, report.default_folder(model) if out is None else out)
    with _progress() as tell:
        found = study_.run(
            model,
            tolerance=share,
            max_tension=limit,
            points=points,
            theory=theory,
            rise=seconds,
            modal_damping=damping,
            measurements=measurements,
            mapping=mapping,
            progress=lambda what, done: tell(what, 0.5 * done),
        )
        folder = report.write(
            found, folder, progress=lambda what, done: tell(what, 0.5 + 0.5 * done)
        )
    if as_json:
        return _write_json({**found.to_dict(), "folder": folder})
    _write_rich(lambda console: report.print_study(found, console, folder))


@app.command()
def simulate(
    robot: RobotSource,
    tension: Annotated[
        str | None, typer.Option(metavar="T1,T2,...", help="Tendon tensions after the rise.")
    ] = None,
    pull: Annotated[
        str | None,
        typer.Option(
            metavar="P1,P2,...",
            help="Lengths taken in after the rise, m or with a unit. A tendon with - in one list, "
            "another says how it is driven.",
        ),
    ] = None,
    angle: Annotated[
        str | None,
        typer.Option(metavar="A1,A2,...", help="Motor angles after the rise, rad or with a unit."),
    ] = None,
    rise: Annotated[
        str | None,
        typer.Option(metavar="s", help="Time of the rise; 0 is a jump.  [default: 1]"),
    ] = None,
    hold: Annotated[
        str | None, typer.Option(metavar="s", help="Time after the rise.  [default: 1]")
    ] = None,
    before: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="T1,T2,...",
            help="Tensions of the equilibrium at the start, from where they rise or, with "
            "--rise 0, are released.  [default: none]",
        ),
    ] = None,
    from_pull: Annotated[
        str | None,
        typer.Option(
            metavar="P1,P2,...", help="Pulls of that equilibrium.  [default: those of home, 0]"
        ),
    ] = None,
    history: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Start on the path of solve --save-history."),
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="CSV over time, columns t_s and for each tendon tension_1_N, pull_1_mm or "
            "angle_1_deg; instead of --tension, --pull, --angle, --rise and --hold.",
        ),
    ] = None,
    theory: Theory = "cosserat",
    gravity: Gravity = None,
    tip_force: TipForce = "0,0,0",
    tip_moment: Annotated[
        str, typer.Option(metavar="x,y,z", help="Dead moment at the tip, base axes, all the time.")
    ] = "0,0,0",
    mass_damping: Annotated[
        str, typer.Option(metavar="1/s", help="Damping force per mass and velocity.")
    ] = "0",
    material_damping: Annotated[
        str, typer.Option(metavar="s", help="Kelvin-Voigt: stress of strain rate over strain.")
    ] = "0",
    modal_damping: Annotated[
        str | None,
        typer.Option(
            metavar="RATIO", help='Of the slowest modes, 0.01 or "1 %"; instead of these two.'
        ),
    ] = None,
    spectral_radius: Annotated[
        float, typer.Option(metavar="0...1", help="Numerical damping: 1 is none, 0 most.")
    ] = 0.8,
    dt: Annotated[
        str | None, typer.Option(metavar="s", help="Fixed step.  [default: steps adapt]")
    ] = None,
    tolerance: Annotated[
        str | None,
        typer.Option(metavar="m", help="Error of one step.  [default: 2e-6 of the length]"),
    ] = None,
    every: Annotated[
        str, typer.Option(metavar="s", help="Time between two outputs of all fields.")
    ] = "0.01",
    elements: Elements = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="NetCDF file of all fields, run.nc.")
    ] = None,
    vtk: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of a series for ParaView.")
    ] = None,
    animation: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Moving picture, .gif or .mp4.")
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Dynamics: tensions and pulls over time to the robot's motion, from rest in equilibrium."""
    model = _load(robot, overrides)
    wanted = (tension, pull, angle)
    driven, duration = _driven_over_time(model, wanted, rise, hold, (before, from_pull), table)
    path = None if history is None else _read_history(history)
    _check_elements(elements)
    mass = _not_negative("--mass-damping", mass_damping, "1/s")
    material = _not_negative("--material-damping", material_damping, "s")
    if modal_damping is not None and (mass or material):
        raise InputError(
            "--modal-damping is instead of --mass-damping and --material-damping; give either."
        )
    moment = _vector("--tip-moment", tip_moment, "N*m")
    if modal_damping is not None and any(moment):
        raise InputError(
            "--modal-damping needs the modes, and under --tip-moment there are none; give "
            "--mass-damping and --material-damping instead."
        )
    if dt is not None and tolerance is not None:
        raise InputError("--tolerance is for steps that adapt and --dt fixes them; give either.")
    if not 0 <= spectral_radius <= 1:
        raise InputError(f"--spectral-radius: got {spectral_radius:g}; must be from 0 to 1.")
    fixed = None if dt is None else _positive("--dt", dt, "s")
    if fixed is not None and fixed < SHORTEST_STEP:
        raise InputError(
            f"--dt: got {fixed:g} s; must be {SHORTEST_STEP:g} s or more, shorter steps drown in "
            "rounding."
        )
    interval = _positive("--every", every, "s")
    if interval < SHORTEST_STEP:
        raise InputError(
            f"--every: got {interval:g} s; must be {SHORTEST_STEP:g} s or more, shorter steps "
            "drown in rounding."
        )
    if duration / interval > MOST_OUTPUTS:
        raise InputError(
            f"--every: {every} gives {duration / interval:.3g} outputs; up to {MOST_OUTPUTS} are "
            "possible."
        )
    settings: dict[str, Any] = {
        "tip_force": _vector("--tip-force", tip_force, "N"),
        "tip_moment": moment,
        "history": path,
        "theory": theory,
        "gravity": None if gravity is None else _vector("--gravity", gravity, "m/s^2"),
        "elements": elements,
        "mass_damping": mass,
        "material_damping": material,
        "modal_damping": _ratio("--modal-damping", modal_damping),
        "spectral_radius": spectral_radius,
        "dt": fixed,
        "tolerance": None if tolerance is None else _positive("--tolerance", tolerance, "m"),
        "every": interval,
    }
    targets = _Targets(out, vtk, animation, duration)

    from bowstring import dynamics

    if vtk is None and animation is None:
        settings["points"] = dynamics.DEFAULT_POINTS if out else 0  # nobody looks at fields
    share = 0.5 if vtk or animation else 1.0
    run: Run | None = None
    files: dict[str, Path | None] | None = None
    try:
        with _progress() as tell:
            try:
                run = dynamics.simulate(
                    model,
                    duration=duration,
                    out=targets.out,
                    progress=lambda done: tell("motion", share * done),
                    **driven,
                    **settings,
                )
            except dynamics.RunInterrupted as stopped:
                run = stopped.run
            except dynamics.NoStart as error:
                if as_json:
                    why = {"status": error.status, "message": str(error)}
                    files = targets.write(error.run)
                    _write_json({**_run_json(error.run, interval), **why, "files": files})
                raise
            files = targets.write(run, lambda what, done: tell(what, share + (1 - share) * done))
        if as_json:
            _write_json({**_run_json(run, interval), "files": files})
        else:
            _write_tables(*_run_tables(run, files))
    except KeyboardInterrupt:
        if run is None:
            raise
        kept = f"the run is in {run.path}" if run.path else "nothing is kept"
        if files is not None:
            raise _Stopped(f"the result is not printed whole; {kept}.") from None
        done = "was stopped" if run.status == "interrupted" else "was done"
        pictures = "; pictures are not" if vtk or animation else ""
        raise _Stopped(f"the motion {done} and {kept}{pictures}.") from None
    if run.status == "interrupted":
        kept = f"; {files['run']} holds the run up to there" if files["run"] else ""
        raise _Stopped(f"at {run.end:.6g} s of {duration:g} s{kept}.")
    run.raise_for_status()


@app.command()
def modes(
    robot: RobotSource,
    tension: Annotated[
        str | None, typer.Option(metavar="T1,T2,...", help="Tendon tensions.  [default: none]")
    ] = None,
    pull: Annotated[
        str | None,
        typer.Option(
            metavar="P1,P2,...",
            help="Lengths taken in, which the tendons keep while the robot oscillates.",
        ),
    ] = None,
    angle: Annotated[
        str | None, typer.Option(metavar="A1,A2,...", help="Motor angles, which are kept as well.")
    ] = None,
    count: Annotated[int, typer.Option(metavar="N", help="How many, the slowest.")] = 6,
    theory: Theory = "cosserat",
    gravity: Gravity = None,
    tip_force: TipForce = "0,0,0",
    elements: Elements = 1,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Folder of pictures of the shapes.")
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Natural frequencies and mode shapes about an equilibrium."""
    model = _load(robot, overrides)
    if tension is None and pull is None and angle is None:
        tension = ",".join("0" for _ in range(_tendon_count(model)))
    tensions, pulls, angles = _driven_by(model, tension, pull, angle)
    _check_elements(elements)
    if not 1 <= count <= 1000:
        raise InputError(f"--count: got {count}; must be from 1 to 1000.")
    weight = _vector("--gravity", gravity, "m/s^2") if gravity is not None else model.gravity
    force = _vector("--tip-force", tip_force, "N")

    from bowstring import dynamics

    if out is not None:
        from bowstring import report

        out = _of("--out", lambda path: report.check_folder(path, "modes"), out)
    provenance = _provenance(
        model,
        count=count,
        theory=theory,
        gravity_m_per_s2=weight,
        tip_force_N=force,
        elements=elements,
        **{
            name: given
            for name, given in (("pulls_m", pulls), ("angles_rad", angles))
            if given is not None
        },
    )
    try:
        found = dynamics.modes(
            model,
            tensions,
            pulls=pulls,
            angles=angles,
            count=count,
            tip_force=force,
            theory=theory,
            gravity=weight,
            elements=elements,
        )
    except NoSolutionError as error:
        if as_json:
            nothing = {"status": error.status, "tensions_N": tensions, "modes": [], "disks": []}
            _write_json({**nothing, **provenance})
        raise
    content = _plain({**found.to_dict(), **provenance})
    folder = None
    if out is not None:
        with _progress() as tell:
            folder = report.write_modes(found, content, out, progress=tell)
    if as_json:
        return _write_json({**content, "folder": folder})
    listed = _table(">mode", ">frequency Hz", "kind")
    for i, (frequency, kind) in enumerate(zip(found.frequency_hz, found.kind, strict=True), 1):
        listed.add_row(str(i), f"{frequency:.5g}", kind)
    _write_tables(
        f"{model.name}, {theory}: {_count(len(found), 'mode')} about the equilibrium",
        listed,
        *([f"Pictures: {folder}"] if folder else []),
    )


@app.command()
def fit(
    robot: RobotSource,
    parameter: Annotated[
        list[str],
        typer.Option(
            metavar="NAME",
            help="To fit: a number of the robot file (segments.0.backbone.E), base, tool, gain, "
            "offset, backlash, delay, hole_angle, pitch_radius, bend_gain. Repeatable.",
        ),
    ],
    measurements: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Table of measurements: CSV, TSV or .xlsx."),
    ] = None,
    mapping: MappingFile = None,
    data: Annotated[
        str | None, typer.Option(metavar="NAME", help="A public data set instead of a table.")
    ] = None,
    part: Annotated[
        str | None, typer.Option(metavar="PART", help="Which of its tables, if there are several.")
    ] = None,
    g: OfMasses = "9.80665",
    model: Annotated[
        Literal["rod", "arc"], typer.Option(help="Statics, or constant curvature.")
    ] = "rod",
    loss: Annotated[
        Literal["linear", "soft_l1", "huber"],
        typer.Option(help="Least squares, or robust against outliers."),
    ] = "soft_l1",
    holdout: Annotated[
        str | None,
        typer.Option(metavar="SHARE", help="Keep the last rows from the fit, and predict them."),
    ] = None,
    folds: Annotated[
        int | None,
        typer.Option(metavar="K", help="Predict each of K parts by a fit to the others."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder of the calibrated robot file, and of figures."),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Calibrate a robot: parameters from measured tips, and what the data know of them."""
    from bowstring import calibration, datasets
    from bowstring.measurements import read_measurements

    gravity = _positive("--g", g, "m/s^2")
    if (measurements is None) == (data is None):
        raise InputError(
            "give either --measurements FILE or --data NAME, a public data set (bowstring data "
            "list)."
        )
    if data is None and part is not None:
        raise InputError("--part is of a public data set; name it by --data.")
    if data is not None and mapping is not None:
        raise InputError("--mapping is of a table; a set of --data brings its own.")
    if holdout is not None and folds is not None:
        raise InputError("--holdout and --folds are two ways to validate; give one.")
    share = None if holdout is None else _share("--holdout", holdout)
    if share is not None and not 0 < share < 1:
        raise InputError(
            f"--holdout: got {quote(str(holdout))}; must lie between 0 and 1, or 0 % and 100 %."
        )
    if folds is not None and folds < 2:
        raise InputError(f"--folds: got {folds}; must be 2 or more.")
    known = _load(robot, overrides)
    if out is not None:
        from bowstring import report

        _of("--out", lambda path: report.check_folder(path, "fit"), out)
    file: Path | None = measurements
    if data is not None:
        file, mapping = datasets.table(data, part), data
    assert file is not None
    table = read_measurements(file, known, mapping, g=gravity)
    if data is not None:
        table = replace(table, name=data if part is None else f"{data}, {part}")
    with _progress() as tell:
        found = calibration.calibrate(
            known,
            table,
            parameter,
            model=model,
            loss=loss,
            holdout=share,
            folds=folds,
            progress=tell,
        )
    if found.tendons.alarm:
        _say("Warning", found.tendons.sentence)
    content = _plain(
        {
            **found.to_dict(),
            **_provenance(
                known,
                measurements=measurements,
                mapping=mapping,
                data=data,
                part=part,
                g_m_per_s2=gravity,
                parameters=parameter,
                model=model,
                loss=loss,
                holdout=share,
                folds=folds,
            ),
        }
    )
    folder = None
    if out is not None and found.fit.converged:
        with _progress() as tell:
            folder = report.write_fit(found, content, out, progress=tell)
    if as_json:
        _write_json({**content, "folder": folder})
    else:
        _write_tables(*_fit_tables(found, out if folder else None))
    if not found.fit.converged:
        raise NoSolutionError(f"{known.name}: {found.fit.message}")


@bench_app.command("check")
def bench_check(
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Table of measurements: CSV, TSV or .xlsx.")
    ],
    robot: Annotated[
        str | None,
        typer.Option(metavar="ROBOT", help="Robot that was measured; checks its tendons' order."),
    ] = None,
    mapping: MappingFile = None,
    g: OfMasses = "9.80665",
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Read a table of measurements and say what is in it, and what is wrong with it."""
    from bowstring.measurements import check_tendons, read_measurements

    gravity = _positive("--g", g, "m/s^2")
    model = None if robot is None else _load(robot, overrides)
    if model is None and overrides:
        raise InputError("--set changes a robot; name it by --robot.")
    found = read_measurements(file, model, mapping, g=gravity)
    check = None if model is None else check_tendons(model, found)
    if as_json:
        settings = {"file": file, "mapping": mapping, "g_m_per_s2": gravity}
        return _write_json(_measurements_json(found, check, model, settings))
    _write_tables(*_measurements_tables(found, check))


@bench_app.command("simulate")
def bench_simulate(
    robot: RobotSource,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Table to write, .csv; its truth stands beside it.")
    ],
    masses: Annotated[
        str | None,
        typer.Option(
            metavar="FIRST:STEP:LAST", help="Masses hung on one tendon; a list M1,M2,... as well."
        ),
    ] = None,
    tensions: Annotated[
        str | None, typer.Option(metavar="FIRST:STEP:LAST", help="Its tensions instead.")
    ] = None,
    pulls: Annotated[
        str | None, typer.Option(metavar="FIRST:STEP:LAST", help="Its pulls instead.")
    ] = None,
    tendon: Annotated[
        int, typer.Option(metavar="N", help="The tendon; nothing pulls the others.")
    ] = 1,
    g: OfMasses = "9.80665",
    repeats: Annotated[int, typer.Option(metavar="N", help="Runs through the loads.")] = 1,
    unload: Annotated[
        bool, typer.Option("--unload/--no-unload", help="Each time also back to the first load.")
    ] = True,
    noise: Annotated[
        str, typer.Option(metavar="m", help="Standard deviation of each measured coordinate.")
    ] = "0.02 mm",
    friction: Annotated[
        str | None, typer.Option(metavar="mu", help="Actual friction, instead of the file's.")
    ] = None,
    actual: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PATH=VALUE",
            help='What else is not as ROBOT says: segments.0.backbone.E="+5 %". Repeatable.',
        ),
    ] = None,
    gravity: Gravity = None,
    gravity_frame: Annotated[
        Literal["base", "measuring"],
        typer.Option(help="Axes of gravity: it turns with a tilted base, or stays plumb."),
    ] = "base",
    tilt: Annotated[
        str,
        typer.Option(
            metavar="ANGLE[,TOWARDS]", help="Lean of the base, and towards which angle from x."
        ),
    ] = "0",
    shift: Annotated[
        str, typer.Option(metavar="x,y,z", help="Base in the measuring frame.")
    ] = "0,0,0",
    tool: Annotated[
        str,
        typer.Option(metavar="x,y,z", help="Measured point seen from the tip; the data say so."),
    ] = "0,0,0",
    tool_error: Annotated[
        str, typer.Option(metavar="x,y,z", help="By how much it is elsewhere, unsaid.")
    ] = "0,0,0",
    tip_force: Annotated[
        str, typer.Option(metavar="x,y,z", help="Disturbance: dead force at the tip, base axes.")
    ] = "0,0,0",
    drift: Annotated[
        str,
        typer.Option(metavar="x,y,z", help="Disturbance: how far the base has moved at the end."),
    ] = "0,0,0",
    theory: Theory = "cosserat",
    seed: Annotated[int, typer.Option(metavar="N", help="Of the noise.")] = 0,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Make synthetic measurements of a robot, with known truth."""
    from bowstring import bench

    model = _load(robot, overrides)
    given = {"--masses": masses, "--tensions": tensions, "--pulls": pulls}
    loads = _loads_of_one(model, given, tendon)
    angles = _numbers("--tilt", tilt, "rad")
    if len(angles) > 2:
        raise InputError(f"--tilt: got {len(angles)} numbers; write an angle, and where to.")
    lean, towards = angles[0], angles[1] if len(angles) == 2 else 0.0
    if not 0 <= lean <= math.pi:
        raise InputError(
            f"--tilt: got {lean:g} rad; must be from 0 to 180 deg, a second angle says where to."
        )
    if repeats < 1:
        raise InputError(f"--repeats: got {repeats}; must be 1 or more.")
    if seed < 0:
        raise InputError(f"--seed: got {seed}; must be 0 or more.")
    settings: dict[str, Any] = {
        **loads,
        "tendon": tendon,
        "g": _positive("--g", g, "m/s^2"),
        "repeats": repeats,
        "unload": unload,
        "noise": _not_negative("--noise", noise, "m"),
        "friction": None if friction is None else _not_negative("--friction", friction, ""),
        "actual": _changes("--actual", actual, 'segments.0.backbone.E="+5 %"'),
        "gravity": None if gravity is None else _vector("--gravity", gravity, "m/s^2"),
        "gravity_frame": gravity_frame,
        "tilt": lean,
        "tilt_towards": towards,
        "shift": _vector("--shift", shift, "m"),
        "tool": _vector("--tool", tool, "m"),
        "tool_error": _vector("--tool-error", tool_error, "m"),
        "tip_force": _vector("--tip-force", tip_force, "N"),
        "drift": _vector("--drift", drift, "m"),
        "theory": theory,
    }
    _of("--out", bench.check_table, out)
    made = bench.set_up(model, **settings)
    found = made.measure(seed)
    table, truth = bench.write(found, out)
    if as_json:
        return _write_json(
            {
                **_measurements_json(found, None, model, {**settings, "seed": seed}),
                "hysteresis_m": made.hysteresis,
                "truth": found.truth,
                "files": {"table": table, "truth": truth},
            }
        )
    _write_tables(
        *_measurements_tables(found, None),
        _truth_table(made),
        f"Synthetic: nothing of this was measured.\nTable: {out}\nTruth: {bench.truth_file(out)}",
    )


@data_app.command("list")
def data_list(as_json: AsJson = False) -> None:
    """List the public data sets."""
    from bowstring import datasets

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
        return _write_json({"data_sets": rows})
    table = _table("name", "kind", "licence", "parts", "description")
    for item in sets:
        table.add_row(item.name, item.kind, item.licence, " ".join(item.parts), item.description)
    _write_tables(table)


@data_app.command("get")
def data_get(
    name: Annotated[str, typer.Argument(metavar="NAME", help="See bowstring data list.")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Copy the files to DIR/NAME.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Fetch a public data set at its pinned commit, and check it."""
    from bowstring import datasets

    folder = datasets.path(name) if out is None else datasets.copy(name, out)
    item = datasets.describe(name)
    if as_json:
        files = [folder / file.name for file in item.files]
        return _write_json(
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
    _write(
        f"{folder}: {item.kind}, {item.licence} licence, github.com/{item.repository} at commit "
        f"{item.commit[:12]}; hashes agree\n"
    )


# -- reading flags -----------------------------------------------------------------------------


_EXAMPLES: Final = {
    "--lengths": '"641 mm",0.65,0.65',
    "--tension": "80,0,0",
    "--pull": '"10 mm",-0.005,-0.005',
    "--angle": '"90 deg",-0.5,-0.5',
    "--tip": "0.1,0,0.6",
    "--gravity": "0,0,-9.81",
    "--tip-force": "0,1,0",
    "--tip-moment": "0,0.1,0",
    "--tolerance": '"1 %"',
    "--max-tension": "80",
    "--from": "40,0,0",
    "--from-pull": '"10 mm",-0.005,-0.005',
    "--rise": '"500 ms"',
    "--hold": '"2 s"',
    "--dt": '"1 ms"',
    "--every": '"10 ms"',
    "--mass-damping": "0.5",
    "--material-damping": '"1 ms"',
    "--modal-damping": '"1 %"',
    "--g": "9.81",
    "--masses": '0:"500 g":8',
    "--tensions": "0:5:80",
    "--pulls": '0:"2 mm":0.03',
    "--noise": '"0.02 mm"',
    "--friction": "0.1",
    "--tilt": '"0.3 deg"',
    "--shift": '"1 mm",0,0',
    "--tool": '0,0,"8 mm"',
    "--tool-error": '"1 mm",0,0',
    "--drift": '0,"0.2 mm",0',
    "--holdout": '"20 %"',
}


def _load(source: str, overrides: Sequence[str] | None) -> Robot:
    if not source.strip():
        raise InputError("ROBOT: got nothing; name a built-in robot or a robot file (YAML).")
    robot = load_robot(source, _changes("--set", overrides, 'segments.0.length="500 mm"'))
    for sentence in robot.warnings:
        _say("Warning", sentence)
    return robot


def _changes(flag: str, texts: Sequence[str] | None, example: str) -> dict[str, str]:
    """PATH=VALUE, as often as given."""
    changes = {}
    for text in texts or ():
        path, equals, value = text.partition("=")
        if not (path.strip() and equals):
            raise InputError(f"{flag}: got {quote(text)}; write for example {flag} {example}.")
        changes[path.strip()] = value
    return changes


def _numbers(flag: str, text: str, si: str) -> list[float]:
    values = []
    for item in text.split(","):
        try:
            values.append(read_number(item, si))
        except ValueError as error:
            raise InputError(
                f"{flag}: got {quote(item.strip())}, {error}; write for example "
                f"{flag} {_example(flag, si)}."
            ) from None
    return values


def _example(flag: str, si: str) -> str:
    if (flag, si) == ("--tolerance", "m"):  # of simulate; that of the study is a share
        return '"1 um"'
    return _EXAMPLES[flag]


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


def _positive(flag: str, text: str, si: str) -> float:
    value = _number(flag, text, si)
    if value <= 0:
        raise InputError(f"{flag}: got {value:g} {si}; must be positive.")
    return value


def _not_negative(flag: str, text: str, si: str) -> float:
    value = _number(flag, text, si)
    if value < 0:
        raise InputError(f"{flag}: got {value:g} {si}; must be 0 or more.")
    return value


def _ratio(flag: str, text: str | None) -> float | None:
    value = None if text is None else _share(flag, text)
    if value is not None and not 0 <= value <= 1:
        raise InputError(f"{flag}: got {quote(text)}; must be from 0 to 1, or 0 % to 100 %.")
    return value


def _check_elements(elements: int) -> None:
    if elements not in (1, 2, 4, 8):
        raise InputError(f"--elements: got {elements}; must be 1, 2, 4 or 8.")


def _vector(flag: str, text: str, si: str) -> list[float]:
    values = _numbers(flag, text, si)
    if len(values) != 3:
        raise InputError(
            f"{flag}: got {_count(len(values), 'number')}; write x, y and z, "
            f"for example {flag} {_EXAMPLES[flag]}."
        )
    return values


def _per_tendon(
    flag: str,
    text: str,
    si: str,
    robot: Robot,
    above_zero: bool = False,
    signed: bool = False,
) -> list[float]:
    values = _numbers(flag, text, si)
    wanted = _tendon_count(robot)
    if len(values) != wanted:
        raise InputError(
            f"{flag}: got {_count(len(values), 'number')}; {robot.name} has "
            f"{_count(wanted, 'tendon')}, write one number for each."
        )
    for i, value in enumerate(values, 1):
        if not signed and (value < 0 or (above_zero and value == 0)):
            rule = "positive" if above_zero else "0 or more, a tendon cannot push"
            raise InputError(f"{flag}: got {value:g} {si} for tendon {i}; must be {rule}.")
    return values


def _range(flag: str, text: str, si: str) -> list[float]:
    """Numbers one by one, or first:step:last."""
    parts = text.split(":")
    if len(parts) == 1:
        return _numbers(flag, text, si)
    if len(parts) != 3:
        raise InputError(
            f"{flag}: got {quote(text)}; write first:step:last, for example {flag} "
            f"{_EXAMPLES[flag]}."
        )
    first, step, last = (_number(flag, part, si) for part in parts)
    if step == 0 or (last - first) / step < 0:
        raise InputError(f"{flag}: steps of {step:g} {si} do not lead from {first:g} to {last:g}.")
    steps = (last - first) / step
    if steps > MOST_LOADS:
        raise InputError(f"{flag}: got {steps:.3g} steps; up to {MOST_LOADS} are possible.")
    if abs(steps - round(steps)) > 1e-6:
        end = first + math.floor(steps) * step
        raise InputError(
            f"{flag}: steps of {step:g} {si} from {first:g} do not meet {last:g}; end for example "
            f"at {end:g}."
        )
    # 3 * 0.1 is 0.3
    return [float(f"{first + i * step:.12g}") for i in range(round(steps) + 1)]


_Driven = list[float | None]


def _driven_by(
    robot: Robot, tension: str | None, pull: str | None, angle: str | None
) -> tuple[_Driven | None, _Driven | None, _Driven | None]:
    """Tensions, pulls and angles as `rod.solve` takes them; each tendon has one of them."""
    flags = (("--tension", tension, "N"), ("--pull", pull, "m"), ("--angle", angle, "rad"))
    given = [text for _, text, _ in flags if text is not None]
    if not given:
        raise InputError(
            "how the tendons are driven is missing: give --tension T1,T2,..., --pull P1,P2,... or "
            "--angle A1,A2,..."
        )
    if len(given) == 1:
        alone: list[_Driven | None] = [None, None, None]
        for k, (flag, text, si) in enumerate(flags):
            if text is not None:
                alone[k] = [*_per_tendon(flag, text, si, robot, signed=k > 0)]
        return alone[0], alone[1], alone[2]
    lists: list[_Driven | None] = []
    for flag, text, si in flags:
        lists.append(None if text is None else _some_tendons(flag, text, si, robot))
    for i in range(_tendon_count(robot)):
        said = [
            flag
            for (flag, _, _), values in zip(flags, lists, strict=True)
            if values is not None and values[i] is not None
        ]
        if len(said) > 1:
            raise InputError(
                f"tendon {i + 1} has {' and '.join(said)}; write - for it in all but one of them."
            )
        if not said:
            raise InputError(
                f"tendon {i + 1} is driven by nothing; write a number for it in one of the lists."
            )
    return lists[0], lists[1], lists[2]


def _loads_of_one(robot: Robot, texts: dict[str, str | None], tendon: int) -> dict[str, Any]:
    """Masses, tensions or pulls of one tendon, as `bench.set_up` takes them."""
    given = [(flag, text) for flag, text in texts.items() if text is not None]
    if not given:
        raise InputError(
            "loads are missing: give for example --masses 0:0.5:8 (kg), --tensions 0:5:80 (N) or "
            '--pulls 0:"2 mm":0.03.'
        )
    if len(given) > 1:
        raise InputError(f"{' and '.join(flag for flag, _ in given)} are the loads; give either.")
    count = _tendon_count(robot)
    if not 1 <= tendon <= count:
        raise InputError(f"--tendon: got {tendon}; {robot.name} has {_count(count, 'tendon')}.")
    ((flag, text),) = given
    si = {"--masses": "kg", "--tensions": "N", "--pulls": "m"}[flag]
    values = _range(flag, text, si)
    for value in values:
        if flag != "--pulls" and value < 0:
            raise InputError(
                f"{flag}: got {value:g} {si}; must be 0 or more, a tendon cannot push."
            )
    if flag == "--masses":
        return {"masses": values}
    tensions = np.zeros((len(values), count))
    if flag == "--tensions":
        tensions[:, tendon - 1] = values
        return {"tensions": tensions}
    pulls = np.full_like(tensions, np.nan)
    tensions[:, tendon - 1] = np.nan
    pulls[:, tendon - 1] = values
    return {"tensions": tensions if count > 1 else None, "pulls": pulls}


def _some_tendons(flag: str, text: str, si: str, robot: Robot) -> _Driven:
    """Numbers of a list in which a blank or a dash means that a tendon is driven otherwise."""
    items = [item.strip() for item in text.split(",")]
    wanted = _tendon_count(robot)
    if len(items) != wanted:
        raise InputError(
            f"{flag}: got {_count(len(items), 'entry', 'entries')}; {robot.name} has "
            f"{_count(wanted, 'tendon')}, write a number or - for each."
        )
    values: _Driven = [None if item in ("", "-") else _numbers(flag, item, si)[0] for item in items]
    for i, value in enumerate(values, 1):
        if flag == "--tension" and value is not None and value < 0:
            raise InputError(
                f"{flag}: got {value:g} {si} for tendon {i}; must be 0 or more, a tendon cannot "
                "push."
            )
    return values


_MOST_HISTORY: Final = 200_000_000  # bytes


def _read_history(file: Path) -> dict[str, Any]:
    try:
        with file.open("rb") as stream:
            data = stream.read(_MOST_HISTORY)
        content = json.loads(data)
    except OSError as error:
        raise InputError(f"--history: {file} cannot be read: {error.strerror}.") from None
    except (ValueError, RecursionError):
        raise InputError(
            f"--history: {file} is no JSON; give a file that --save-history wrote."
        ) from None
    if not isinstance(content, dict) or "robot_hash" not in content:
        raise InputError(f"--history: {file} is no history; give one that --save-history wrote.")
    return content


def _check_history_file(file: Path) -> None:
    check_parent(file, f"cannot write {file}")
    if file.is_dir():
        raise InputError(f"cannot write {file}: it is a folder")


def _write_history(file: Path, history: dict[str, Any] | None) -> None:
    """Whole or not at all: beside its place first."""
    new = file.with_name(f".{file.name}.new")
    try:
        new.write_text(json.dumps(history, allow_nan=False) + "\n", "utf-8")
        os.replace(new, file)
    except OSError as error:
        new.unlink(missing_ok=True)
        raise InputError(f"--save-history: cannot write {file}: {error.strerror}") from None


def _driven_over_time(
    robot: Robot,
    wanted: tuple[str | None, str | None, str | None],
    rise: str | None,
    hold: str | None,
    before: tuple[str | None, str | None],
    table: Path | None,
) -> tuple[dict[str, Any], float]:
    """What the flags of `simulate` say of the tendons, as it takes them, and the duration."""
    from bowstring.courses import Table

    starts = {
        flag: None if text is None else _some_tendons(flag, text, si, robot)
        for (flag, si), text in zip((("--from", "N"), ("--from-pull", "m")), before, strict=True)
    }
    if table is not None:
        from bowstring.timetable import read_drive

        flags = zip(("--tension", "--pull", "--angle"), wanted, strict=True)
        for flag, given in (*flags, ("--rise", rise), ("--hold", hold)):
            if given is not None:
                raise InputError(f"--table says it all: leave {flag} out, or --table.")
        driven: dict[str, Any] = _of("--table", lambda path: read_drive(path, robot), table)
        duration = float(next(iter(driven.values())).times[-1])
        if duration < SHORTEST_STEP:
            raise InputError(f"--table: it takes {duration:g} s; {_TOO_SHORT}")
        if duration > LONGEST_RUN:
            raise InputError(
                f"--table: it takes {duration:g} s; a run of up to {LONGEST_RUN:g} s is possible."
            )
        at_zero = {name: course.at(0.0, before=True).tolist() for name, course in driven.items()}
        begin = _starts(robot, starts, at_zero)
        return driven | {f"initial_{name}": row for name, row in begin.items()}, duration
    if wanted == (None, None, None):
        raise InputError(
            "what drives the tendons is missing: give --tension T1,T2,..., --pull P1,P2,..., "
            "--angle A1,A2,... or --table FILE."
        )
    ends = dict(zip(("tensions", "pulls", "angles"), _driven_by(robot, *wanted), strict=True))
    rising = _not_negative("--rise", "1" if rise is None else rise, "s")
    holding = _not_negative("--hold", "1" if hold is None else hold, "s")
    duration = float(f"{rising + holding:.12g}")  # 0.1 + 0.2 is 0.3
    if duration == 0:
        raise InputError("--rise and --hold are both 0 s: there is no time to simulate.")
    if duration < SHORTEST_STEP:
        raise InputError(f"--hold: with --rise the run takes {duration:g} s; {_TOO_SHORT}")
    if duration > LONGEST_RUN:
        flag = "--rise" if rising > holding else "--hold"
        raise InputError(
            f"{flag}: the run takes {duration:g} s; up to {LONGEST_RUN:g} s are possible."
        )
    nan = float("nan")
    rows = {
        name: [nan if v is None else v for v in end]
        for name, end in ends.items()
        if end is not None
    }
    at_zero = {name: [0.0 * v for v in row] for name, row in rows.items()}
    begin = at_zero | _starts(robot, starts, at_zero)
    return {name: Table([0.0, rising], [begin[name], row]) for name, row in rows.items()}, duration


def _starts(
    robot: Robot, starts: Mapping[str, _Driven | None], at_zero: Mapping[str, list[float]]
) -> dict[str, list[float]]:
    """Tensions, pulls and angles of the start: those of --from and --from-pull, else at time 0.

    NaN stands for a tendon that is driven otherwise; nothing if nothing is asked for.
    """
    found = {name: list(row) for name, row in at_zero.items()}
    asked = False
    for flag, start in starts.items():
        kinds = ("tensions",) if flag == "--from" else ("pulls", "angles")
        for i, value in enumerate(start or ()):
            mine = [name for name in kinds if name in found and not math.isnan(found[name][i])]
            if value is None:
                continue
            if not mine:
                other = "tension" if flag == "--from" else "pull or angle"
                raise InputError(
                    f"{flag}: got {value:g} for tendon {i + 1}, which no {other} moves; write - "
                    "for it."
                )
            asked = True
            radius = float(robot.tendons.spool_radius_m[i])
            if mine == ["angles"] and not math.isnan(radius):  # else simulate says what is missing
                value /= radius
            found[mine[0]][i] = value
    return found if asked else {}


def _tendon_count(robot: Robot) -> int:
    return len(robot.tendons.angle_rad)


def _count(n: int, thing: str, things: str | None = None) -> str:
    return f"{n} {thing if n == 1 else things or thing + 's'}"


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


class _Targets:
    """Files that a run is written to, each checked before the work begins."""

    def __init__(
        self, out: Path | None, vtk: Path | None, animation: Path | None, duration: float
    ) -> None:
        self.out, self.vtk, self.animation = out, vtk, animation
        if out is not None:
            from bowstring.runfile import check_file

            self.out = _of("--out", check_file, out)
        if vtk is not None:
            from bowstring.vtk import check_folder

            self.vtk = _of("--vtk", check_folder, vtk)
        if animation is not None:
            from bowstring.animation import check_length, check_picture

            self.animation = _of("--animation", check_picture, animation)
            _of("--animation", check_length, duration)
        if self.out is not None and self.out == self.animation:
            raise InputError(f"--out and --animation are the same file, {self.out}.")
        for flag, file in (("--out", self.out), ("--animation", self.animation)):
            if self.vtk is not None and file is not None and self.vtk in file.parents:
                raise InputError(
                    f"{flag}: {file} lies in the folder of --vtk, which is for the series alone; "
                    "name another place."
                )

    def write(
        self, run: Run, tell: Callable[[str, float], None] = lambda what, done: None
    ) -> dict[str, Path | None]:
        """Write what is not yet, unless the user has stopped the run; say what there is."""
        files: dict[str, Path | None] = {"run": run.path, "vtk": None, "animation": None}
        if run.status == "interrupted" or len(run.time) == 0:
            return files
        if self.vtk is None and self.animation is None:
            return files
        share = 0.5 if self.vtk and self.animation else 0.0
        data = run.dataset
        if self.vtk is not None:
            from bowstring.vtk import write_vtk

            files["vtk"] = write_vtk(
                run.robot, data, self.vtk, progress=lambda what, done: tell(what, share * done)
            )
        if self.animation is not None and len(run.time) > 1:
            from bowstring.animation import animate

            files["animation"] = animate(
                run.robot,
                data,
                self.animation,
                progress=lambda what, done: tell(what, share + (1 - share) * done),
            )
        return files


def _of(flag: str, check: Callable[[Any], Any], value: Any) -> Any:
    """The result of a check, whose errors name the flag."""
    try:
        return check(value)
    except InputError as error:
        raise InputError(f"{flag}: {error}") from None


def _run_json(run: Run, every: float) -> dict[str, Any]:
    interval = max(TIP_INTERVAL, every)
    count = int(run.end / interval + 1e-9)
    times = np.round(np.arange(count + 1) * interval, 12)
    if run.end - times[-1] > 1e-9 * run.end:
        times = np.append(times, run.end)
    else:
        times[-1] = run.end
    moved = len(run.time) > 0
    return {
        "status": run.status,
        "t_s": times if moved else [],
        "tip_position_m": run.tip_at(times) if moved else [],
        "steps": run.steps,
        "real_time_factor": run.real_time_factor if moved else None,
        "message": run.message,
        **_provenance(run.robot, **run.settings),
    }


def _run_tables(run: Run, files: dict[str, Path | None]) -> Iterator[Table | str]:
    yield (
        f"{run.robot.name}, {run.settings['theory']}: {run.status}, {run.end:.6g} s in "
        f"{_count(run.steps, 'step')}, about {rounded(run.real_time_factor)} times real time"
    )
    if len(run.time) == 0:
        return
    table = _table("", ">time s", ">tip x mm", ">y mm", ">z mm")
    moved = np.linalg.norm(run.tip_position - run.tip_position[:1], axis=1)
    moments = [("start", 0), ("farthest from the start", int(moved.argmax())), ("end", -1)]
    for name, i in moments:
        table.add_row(
            name, f"{run.time[i]:.6g}", *(_fixed(1e3 * value, 3) for value in run.tip_position[i])
        )
    yield table
    labels = {"run": "Run", "vtk": "VTK series", "animation": "Animation"}
    lines = [f"{labels[name]}: {file}" for name, file in files.items() if file is not None]
    if lines:
        yield "\n".join(lines)


def _measurements_json(
    found: Measurements, check: TendonCheck | None, robot: Robot | None, settings: dict[str, Any]
) -> dict[str, Any]:
    tendons = [
        {"given_by": kind, f"smallest_{unit}": low, f"largest_{unit}": high}
        for kind, unit, low, high in _driven(found)
    ]
    labels, counts = np.unique(found.group, return_counts=True)
    groups = dict(zip(labels.tolist(), counts.tolist(), strict=True))
    ranges = None
    if found.points.shape[1]:
        ranges = {"smallest": found.tip.min(axis=0), "largest": found.tip.max(axis=0)}
    provenance = (
        {"provenance": {"bowstring_version": __version__, "schema_version": JSON_SCHEMA_VERSION,
                        "settings": settings}}
        if robot is None
        else _provenance(robot, **settings)
    )  # fmt: skip
    return {
        "name": found.name,
        "source": found.source,
        "rows": len(found),
        "rows_left_out": found.left_out,
        "tendons": tendons,
        "points": found.points.shape[1],
        "points_unit": "px" if found.scale is None else "m",
        "tip": ranges,
        "tool_m": found.tool,
        "stations": found.stations,
        "angles": found.bend is not None,
        "sigma_m": None if found.sigma is None else float(np.median(found.sigma)),
        "groups": {name: count for name, count in groups.items() if name},
        "repeats": len(np.unique(found.repeat)),
        "time_s": None if found.time is None else [found.time.min(), found.time.max()],
        "issues": [{"line": line, "text": text} for line, text in found.issues],
        "tendon_check": None
        if check is None
        else {
            "found": check.found,
            "tendons": check.tendons,
            "sentence": check.sentence,
            "unexplained": check.unexplained,
            "turn_rad": check.turn,
        },
        "sha256": found.sha256,
        **provenance,
    }


def _truth_table(made: Bench) -> Table:
    truth = made.truth
    table = _table("truth", "")
    for item in truth["differences"]:
        said = "" if item["told"] is None else f", not {_shown(item['told'])}"
        table.add_row(item["path"], f"{_shown(item['actual'])}{said}")
    axes = "base" if truth["gravity_frame"] == "base" else "measuring frame"
    weight = " ".join(f"{v:g}" for v in truth["gravity_m_per_s2"])
    table.add_row("gravity", f"{weight} m/s^2, axes of the {axes}")
    tilt, towards = (math.degrees(truth[name]) for name in ("tilt_rad", "tilt_towards_rad"))
    table.add_row("base", f"leans by {tilt:.4g} deg towards {towards:.4g} deg")
    for name, values, factor, unit in (
        ("base shifted", truth["base"]["translation_m"], 1e3, "mm"),
        ("measured point", truth["actual_tool_m"], 1e3, "mm from the tip, its axes"),
        ("side force", truth["disturbances"]["tip_force_N"], 1.0, "N"),
        ("drift", truth["disturbances"]["drift_m"], 1e3, "mm up to the end"),
    ):
        if any(values):
            table.add_row(name, f"{' '.join(f'{factor * v:.6g}' for v in values)} {unit}")
    table.add_row("noise", f"{1e3 * made.noise:.4g} mm, standard deviation of each coordinate")
    if made.hysteresis is not None:
        table.add_row("hysteresis", f"{_fixed(1e3 * made.hysteresis, 3)} mm at most")
    return table


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _driven(found: Measurements) -> Iterator[tuple[str, str, float, float]]:
    """Of each tendon: what it is given by, the unit, and the range."""
    for k in range(found.tendon_count):
        by_pull = bool(np.isnan(found.tensions[:, k]).all())
        values = (found.pulls if by_pull else found.tensions)[:, k]
        kind, unit = ("pull", "m") if by_pull else ("tension", "N")
        yield kind, unit, float(np.nanmin(values)), float(np.nanmax(values))


def _measurements_tables(found: Measurements, check: TendonCheck | None) -> Iterator[Table | str]:
    left = f", {found.left_out} left out" if found.left_out else ""
    yield f"{found.name}: {found.source}, {_count(len(found), 'row')}{left}"
    if found.tendon_count:
        table = _table("tendon", "given by", ">from", ">to", "")
        for k, (kind, unit, low, high) in enumerate(_driven(found), 1):
            factor, shown = (1e3, "mm") if unit == "m" else (1.0, unit)
            table.add_row(str(k), kind, _fixed(factor * low, 3), _fixed(factor * high, 3), shown)
        yield table
    lines = []
    if found.points.shape[1]:
        factor, unit = (1.0, "px") if found.scale is None else (1e3, "mm")
        axes = [
            f"{axis} {_fixed(factor * low, 3)} to {_fixed(factor * high, 3)}"
            for axis, low, high in zip(
                "xyz", found.tip.min(axis=0), found.tip.max(axis=0), strict=True
            )
        ]
        lines.append(
            f"tip: {', '.join(axes)} {unit}, {_count(found.points.shape[1], 'point')} a row"
        )
    if found.bend is not None:
        low, high = np.degrees([found.bend.min(), found.bend.max()])
        lines.append(f"bend: {_fixed(low, 2)} to {_fixed(high, 2)} deg")
    if found.sigma is not None:
        lines.append(f"uncertainty: {rounded(1e3 * float(np.median(found.sigma)), 3)} mm")
    labels, counts = np.unique(found.group, return_counts=True)
    if len(labels) > 1 or labels[0]:
        shown_groups = [f"{label or '(none)'} {n}" for label, n in zip(labels, counts, strict=True)]
        more = f" and {len(labels) - 8} more" if len(labels) > 8 else ""
        lines.append(f"groups: {', '.join(shown_groups[:8])}{more}")
    if len(np.unique(found.repeat)) > 1:
        lines.append(f"repeats: {len(np.unique(found.repeat))}")
    if lines:
        yield "\n".join(lines)
    if found.issues:
        table = _table(">line", "what")
        for line, text in found.issues[:MOST_ISSUES]:
            table.add_row(str(line), text)
        yield table
        if len(found.issues) > MOST_ISSUES:
            yield f"... and {len(found.issues) - MOST_ISSUES} more; --json has them all."
    if check is not None:
        yield ("Check the tendons. " if check.alarm else "") + check.sentence


def _fit_tables(found: Calibration, folder: Path | None) -> Iterator[Table | str]:
    fit, data = found.fit, found.data
    left = f", {data.left_out} left out" if data.left_out else ""
    kept = f", {_count(int(found.held_out.sum()), 'row')} held out" if found.held_out.any() else ""
    what = "statics" if fit.model == "rod" else "constant curvature"
    yield (
        f"{fit.robot.name}, {what}, fitted to {data.name} ({data.source}): "
        f"{_count(int(fit.used.sum()), 'row')}{kept}{left}"
    )
    table = _table("parameter", ">value", ">std. error", ">95 % from", ">to", ">began at", "unit")
    for e in fit.estimates:
        digits = _digits(e.standard_error, e.value)
        told = math.isfinite(e.standard_error)
        table.add_row(
            e.name,
            _fixed(e.value, digits),
            rounded(e.standard_error, 2) if told else "unknown",
            *([_fixed(e.low, digits), _fixed(e.high, digits)] if told else ["-", "-"]),
            f"{e.start:.6g}",
            e.unit,
        )
    yield table
    yield fit.message
    if found.correlated:
        pairs = [f"{a} and {b} by {r:.3f}" for a, b, r in found.correlated]
        yield "Estimates correlate: " + "; ".join(pairs) + "."
    scores = _table("tip error", ">rows", ">RMSE mm", ">mean mm", ">largest mm")
    placed = {"base.x", "base.y", "base.z", "base.rx", "base.ry", "base.rz"} <= set(fit.names)
    before = "before, base put in place" if placed else "before"
    rows = [(before, fit.score_before), ("after", fit.score)]
    if found.held_out_score is not None:
        rows.append(("rows held out", found.held_out_score))
    if found.folds is not None:
        rows.append((f"{len(found.folds.folds)} folds", found.folds.score))
        rows += [(f"  {n}", s) for n, s in zip(found.folds.labels, found.folds.folds, strict=True)]
    for name, score in rows:
        cells = [_fixed(1e3 * v, 3) for v in (score.rmse, score.mean, score.largest)]
        scores.add_row(name, str(score.count), *cells)
    yield scores
    if found.unanswered:
        yield (
            f"To {_count(found.unanswered, 'row')} of the validation the calibrated model has no "
            "answer; these are in none of its numbers."
        )
    said = ""
    if data.sigma is not None:
        said = f"; the table says {rounded(1e3 * float(np.median(data.sigma)), 3)} mm"
    yield f"Scatter of a coordinate: {_fixed(1e3 * fit.noise, 4)} mm{said}."
    if folder is not None:
        yield f"Calibrated robot: {folder / 'robot.yaml'}"


def _digits(error: float, value: float) -> int:
    """Digits after the point that an estimate is worth: two of its error."""
    size = error if math.isfinite(error) and error > 0 else abs(value) * 1e-4 or 1e-4
    return min(12, max(0, 1 - math.floor(math.log10(size))))


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


def _tendon_table(robot: Robot, lengths: Any) -> Table:
    straight = robot.disks.station_m[robot.tendons.end_disk]
    table = _table("tendon", ">length mm", ">pull mm")
    for i, length in enumerate(lengths):
        table.add_row(str(i + 1), _fixed(1e3 * length, 3), _fixed(1e3 * (straight[i] - length), 3))
    return table


def _driven_table(solution: Solution) -> Table:
    lengths, pulls, slack = solution.tendon_lengths, solution.pulls, solution.slack_lengths
    assert lengths is not None and slack is not None
    by_tension = not solution.core.driven
    columns = ("tendon", ">tension N", ">length mm", ">pull mm")
    table = _table(*columns, *([] if by_tension else [">slack mm"]))
    for i, tension in enumerate(solution.tensions):
        table.add_row(
            str(i + 1),
            f"{tension:g}",
            _fixed(1e3 * lengths[i], 3),
            "-" if pulls is None else _fixed(1e3 * pulls[i], 3),
            *([] if by_tension else [_fixed(1e3 * slack[i], 3)]),
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
    except _Stopped as stopped:
        _say("Stopped", str(stopped))
        return STOPPED
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
