"""Command study."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bowstring.cli.flags import Number, Share, of_flag
from bowstring.cli.groups import Group, option
from bowstring.cli.options import (
    AsJson,
    MappingFile,
    RobotOfStudy,
    Sweep,
    Theory,
    Tolerance,
    measurements_of,
)
from bowstring.cli.output import Stopped, progress_bar, warn, write_json, write_rich
from bowstring.errors import InputError
from bowstring.units import printable

if TYPE_CHECKING:
    from bowstring.fem.run import Settings
    from bowstring.study.settings import Ramp


def _ramp(
    rise: Annotated[
        float | None,
        Number(
            "s",
            '"500 ms"',
            "Rise time of the tension in dynamics.  [default: chosen for the robot]",
        ),
    ],
    modal_damping: Annotated[
        float,
        Share(
            "a share of critical damping from 0 to below 1",
            lambda value: 0 <= value < 1,
            '"1 %"',
            'Modal damping ratio in dynamics, a share of critical damping: 0.05 or "5 %".',
            default="5 %",
        ),
    ],
) -> Ramp:
    from bowstring.study.settings import Ramp

    return Ramp(rise, modal_damping)


@dataclass(frozen=True)
class _Measured:
    """The table of measurements, and whether models with memories are compared on it."""

    measurements: Annotated[
        Path | None,
        option("FILE", "Table of measurements; each model is compared with it."),
    ] = None
    mapping: MappingFile = None
    compare: Annotated[
        bool,
        typer.Option(
            "--compare",
            help="Compare models with memories on left-out rows of the measurements, and divide "
            "the error of constant curvature into parts; takes up to a second for each row.",
        ),
    ] = False

    def __post_init__(self) -> None:
        if self.measurements is None and self.mapping is not None:
            raise InputError("--mapping needs a table; name it by --measurements.")
        if self.measurements is None and self.compare:
            raise InputError("--compare needs measurements; name their table by --measurements.")


def _finite_elements(
    fe: Annotated[
        bool,
        typer.Option(
            "--fe",
            help="Solve the sweep by 3-D finite elements too; takes minutes, needs CalculiX.",
        ),
    ] = False,
    grip: Annotated[
        Literal["bonded", "sliding"] | None,
        typer.Option(
            help="With --fe: disks hold the backbone's cross-section, or let it widen and narrow.  "
            "[default: bonded]"
        ),
    ] = None,
) -> Settings | None:
    if grip is not None and not fe:
        raise InputError("--grip is for finite elements; give --fe too.")
    if not fe:
        return None
    from bowstring.fem.run import Settings

    return Settings(grip=grip or Settings.grip)


@dataclass(frozen=True)
class _Written:
    """Files of the report, and how much is printed."""

    out: Annotated[
        Path | None,
        option("DIR", "Folder of the report.  [default: bowstring-study/NAME OF ROBOT]"),
    ] = None
    figures: Annotated[
        Literal["pdf", "png", "svg"] | None,
        typer.Option(help="Also save each figure as a file.  [default: in the report alone]"),
    ] = None
    solid: Annotated[
        bool, typer.Option("--solid", help="Show the robot as a solid in the report (extra cad).")
    ] = False
    correction: Annotated[
        Literal["python", "c", "matlab"] | None,
        typer.Option(
            help="Also write the corrected constant curvature of this robot as code, into the "
            "folder of the report."
        ),
    ] = None
    verbose: Annotated[
        bool, typer.Option("--verbose", help="Print all tables and the whole verdict as well.")
    ] = False


_Ramp = Annotated["Ramp", Group("Motion", _ramp)]
_FiniteElements = Annotated["Settings | None", Group("Finite elements", _finite_elements)]


def study(
    context: typer.Context,
    robot: RobotOfStudy,
    tolerance: Tolerance,
    loading: Sweep,
    ramp: _Ramp,
    measured: Annotated[_Measured, Group("Measurements", _Measured)],
    fe: _FiniteElements,
    written: Annotated[_Written, Group("Outputs", _Written)],
    theory: Theory = "cosserat",
    distributions: Annotated[
        Path | None,
        option(
            "FILE",
            "Distributions of numbers of the robot (YAML).  [default: E to 5 %, pitch radius to "
            "1 %, assumed]",
        ),
    ] = None,
    over: Annotated[
        str | None,
        option(
            "PATH=FROM:TO[:N]",
            "Load beside the tension in the map over loads: payload=0:100 g, tilt=0:90 deg, "
            "tip_force=0:1 N, gravity.z.  [default: payload, or tip_force without gravity]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Find where constant curvature holds for a robot; write a report.

    It is compared with statics, with dynamics and, if they are given, with measurements.
    """
    if measured.compare and theory != "cosserat":
        raise InputError("--compare has the Cosserat rod; leave --theory out.")
    from bowstring.fem.run import RunInterrupted
    from bowstring.files.result_folder import check_folder
    from bowstring.robot.reader import robot_names
    from bowstring.study import report
    from bowstring.study.run import run_study
    from bowstring.study.settings import Extras

    joint = None
    if distributions is not None:
        from bowstring.uncertainty import read_distributions

        joint = of_flag(
            "--distributions", lambda file: read_distributions(file, robot), distributions
        )
        warn(*joint.warnings)
    out = report.default_folder(robot) if written.out is None else written.out
    folder = of_flag("--out", check_folder, out)
    source = context.params["robot"]
    robot_file = source if source in robot_names() else printable(str(Path(source).resolve()))
    if written.out is None:
        of_flag("--out", lambda it: report.refuse_other_robot(it, robot_file), folder)
    try:
        with progress_bar("CAD kernel" if written.solid else "geometric sweep") as notify:
            data = None
            if measured.measurements is not None:
                notify("measurements", 0.0)
                table = measured.measurements
                data = measurements_of("--measurements", table, robot, measured.mapping)
            solving = 0.5 if fe is None else 0.9  # share of the time; the report takes the rest
            found = run_study(
                robot,
                tolerance=tolerance,
                theory=theory,
                loading=loading,
                ramp=ramp,
                measurements=data,
                extras=Extras(written.solid, fe, joint, over, measured.compare),
                progress=lambda what, done: notify(what, solving * done),
            )
            notify("figures", solving)
            folder = report.write(
                found,
                folder,
                formats=() if written.figures is None else (written.figures,),
                correction=written.correction,
                robot_file=robot_file,
                progress=lambda what, done: notify(what, solving + (1 - solving) * done),
            )
    except RunInterrupted as stopped:
        raise Stopped(
            f"finite elements {stopped.run.message}; the same command goes on from there."
        ) from None
    told = [*robot.warnings, *(found.measured.doubts if found.measured and not as_json else ())]
    warn(*found.warnings[len(told) :])  # the others were or will be printed
    if as_json:
        content: dict[str, Any] = {
            **found.to_dict(),
            "figures": report.written_figures(folder),
            "folder": str(folder),
        }
        return write_json(content)
    from bowstring.study.terminal import print_study

    write_rich(lambda console: print_study(found, console, folder, verbose=written.verbose))
