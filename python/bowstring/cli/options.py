"""Common flags of commands, and groups that make the robot, its loads and the rod model.

The flags of the actuation are in `actuation`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bowstring._core import RodModel
from bowstring.cli import completion
from bowstring.cli.flags import (
    AtPoints,
    Number,
    OnDisks,
    TendonShares,
    Vector,
    ZeroVector,
    of_flag,
    without_unit,
)
from bowstring.cli.groups import Flag, Group, option
from bowstring.cli.output import figure_file, warn
from bowstring.errors import InputError
from bowstring.units import has_no_unit, quote

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load
    from bowstring.validity.loading import Loading


RobotSource = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT",
        help="A built-in robot's name or the path of a robot file.",
        autocompletion=completion.robots,
    ),
]
Overrides = Annotated[
    list[str] | None,
    option(
        "PATH=VALUE",
        'Change a field of the robot file: segments.0.disks.clamped_length="3 mm". Repeatable.',
        "--set",
    ),
]
AsJson = Annotated[
    bool, typer.Option("--json", help="Print one JSON object and nothing else on stdout.")
]
Chord = Annotated[
    bool, typer.Option("--chord", help="Tendons are straight between disks, not parallel curves.")
]
Theory = Annotated[
    Literal["cosserat", "kirchhoff"],
    typer.Option(help="Rod theory: with shear and extension, or without."),
]
Gravity = Annotated[
    list[float] | None,
    Vector("m/s^2", "0,0,-9.81", "Gravity, in place of that of the robot file."),
]


class _Elements(Flag):
    """Number of elements between two disks; the help ends with the default."""

    kind = int

    def __init__(self, default: str) -> None:
        text = f"Fourth-order elements between two disks.  [default: {default}]"
        super().__init__("1|2|4|8", text, values=completion.words("1", "2", "4", "8"))

    def read(self, flag: str, elements: int, robot: Robot) -> int:
        if elements not in (1, 2, 4, 8):
            raise InputError(f"{flag}: got {elements}; must be 1, 2, 4 or 8.")
        return elements


Elements = Annotated[int | None, _Elements("1, or as many as loads between disks need")]
AutomaticElements = Annotated[int | None, _Elements("chosen for accuracy")]
MappingFile = Annotated[
    str | None,
    option(
        "FILE",
        "What the columns of a foreign table are: a built-in mapping or a YAML file.",
        values=completion.mappings,
    ),
]
HistoryFile = Annotated[
    Path | None,
    option("FILE", "Continue the load path that solve --save-history wrote.", "--history"),
]
OfMasses = Annotated[
    float,
    Number(
        "m/s^2",
        "9.81",
        "Gravity that makes tensions of masses; that of the robot is another.",
        "--gravity-on-masses",
        form="g",
        default="9.80665",
        must_be="positive",
    ),
]


def tolerated(text: str) -> Flag:
    """Make the flag of a tolerance, which the function of the command reads."""
    more = 'a share of the length, 0.01 or "1 %", or a length, "0.5 mm".'
    return Flag(None, f"{text}: {more}", default="1 %")


Tolerance = Annotated[str, tolerated("Tolerated tip error")]


def _sweep(
    max_tension: Annotated[
        float | None,
        Number(
            "N",
            '"80 N"',
            "Largest tension of the sweep.  [default: chosen for the robot]",
            form="T",
        ),
    ],
    tendon: Annotated[
        dict[int, float] | None,
        TendonShares(
            "N[:SHARE],...",
            "The actuated tendon, or several: 1,4:0.5 gives tendon 4 half the tension.  "
            "[default: the first of the outermost segment; study takes the worst "
            "one]",
            "--tendon",
        ),
    ],
    points: Annotated[int, option("N", "Number of loads in the sweep.")] = 17,
) -> Loading:
    from bowstring.validity.loading import Loading

    return Loading(max_tension, points, tendon)


Sweep = Annotated["Loading", Group("Sweep", _sweep)]
Models = Annotated[
    str | None,
    option(
        "NAME,...",
        "Models of constant curvature: cc_from_lengths, cc_from_force, cc_from_lengths_chord, "
        "cc_from_force_arm, cc_from_force_calibrated; with an axis bend of a map "
        "cc_from_displacements.  [default: cc_from_lengths,cc_from_force]",
    ),
]
Vectors = list[list[float]]


def named(names: str | None) -> list[str] | None:
    """Names that commas separate, each once."""
    return None if names is None else list(dict.fromkeys(n.strip() for n in names.split(",")))


def dead_loads(
    gravity: Gravity = None,
    tip_force: Annotated[
        list[float] | None,
        Vector("N", "0,1,0", "Dead load: constant force at the tip, base axes.", default="0,0,0"),
    ] = None,
    tip_moment: Annotated[
        list[float] | None,
        ZeroVector("N*m", "0,0.1,0", "Dead load: constant moment at the tip, base axes."),
    ] = None,
    disk_force: Annotated[
        Vectors | None,
        OnDisks(
            "N",
            "4:0,1,0",
            "Dead load: force on disk N, counted from 1 at the base, base axes. Repeatable.",
        ),
    ] = None,
    disk_moment: Annotated[
        Vectors | None,
        OnDisks(
            "N*m",
            "4:0,0.1,0",
            "Dead load: moment on disk N, counted from 1 at the base, base axes. Repeatable.",
        ),
    ] = None,
    point_force: Annotated[
        list[Any] | None,
        AtPoints(
            '4:0,1,0@0,0,"20 mm"',
            "Dead load: force at a point of disk N, counted from 1 at the base; the point is given "
            "in the disk's axes from its centre; or force "
            'on the backbone at an arc length with its unit in place of N, as "137 mm:0,1,0". '
            "Repeatable.",
            form="N:x,y,z@px,py,pz",
        ),
    ] = None,
    follower_force: Annotated[
        list[Any] | None,
        AtPoints(
            "4:0,1,0",
            "Follower load: force on disk N, counted from 1 at the base, or at a point of it, in "
            "the disk's axes; or at an arc length as for --point-force. Repeatable.",
            form="N:x,y,z[@px,py,pz]",
            follower=True,
        ),
    ] = None,
    line_force: Annotated[
        list[float] | None,
        Vector("N/m", "0,0,-2", "Dead load: force per length of backbone in N/m, base axes."),
    ] = None,
) -> Load:
    """Make the load beside the tendons."""
    from bowstring.statics.load import Load

    return Load(
        gravity=gravity,
        tip_force=tip_force,
        tip_moment=tip_moment,
        disk_forces=disk_force,
        disk_moments=disk_moment,
        point_loads=(*(point_force or ()), *(follower_force or ())) or None,
        line_forces=line_force,
    )


def is_loaded(load: Load) -> bool:
    """Whether a load has more than the tendons and zero forces at the tip."""
    at_tip = any(load.tip_force) or any(load.tip_moment)
    return at_tip or bool(load.given - {"tip_force", "tip_moment"})


def settings_of(load: Load, rod: RodModel, *without: str) -> dict[str, Any]:
    """Loads beside the tendons and rod model, for the provenance."""
    points = load.point_loads
    found = {
        "theory": rod.theory,
        "gravity_m_per_s2": load.gravity,
        "tip_force_N": load.tip_force,
        "tip_moment_Nm": load.tip_moment,
        "disk_forces_N": load.disk_forces,
        "disk_moments_Nm": load.disk_moments,
        "point_loads": None if points is None else [each.to_dict() for each in points],
        "line_force_N_per_m": load.line_forces,
        "elements": rod.elements,
    }
    return {name: value for name, value in found.items() if name not in without}


Loads = Annotated["Load", Group("Loads", dead_loads)]
Weight = Annotated["Load", Group("Loads", dead_loads, "gravity", "tip_force")]
DeadForces = Annotated[
    "Load",
    Group("Loads", dead_loads, "gravity", "tip_force", "disk_force", "point_force", "line_force"),
]


def rod_model(theory: Theory = "cosserat", elements: AutomaticElements = None) -> RodModel:
    return RodModel(theory, elements=elements)


Rod = Annotated[RodModel, Group("Rod", rod_model)]


def load(robot: RobotSource, overrides: Overrides = None) -> Robot:
    from bowstring.robot.reader import load_robot

    if not robot.strip():
        raise InputError("ROBOT: got nothing; name a built-in robot or a robot file (YAML).")
    given = changes_of("--set", overrides, 'segments.0.length="500 mm"')
    changes = _whole_paths(robot, given)
    check_bare_changes("--set", lambda change: load_robot(robot, change), changes)
    try:
        found = load_robot(robot, changes)
    except InputError as error:
        if not changes:
            raise
        load_robot(robot)  # errors of the file itself do not name the flag
        raise InputError(f"--set: {error}") from None
    warn(*found.warnings)
    return found


def _of_study(robot: RobotSource = "amouri2019", overrides: Overrides = None) -> Robot:
    return load(robot, overrides)


RobotArgument = Annotated["Robot", Group("", load)]
RobotOfStudy = Annotated["Robot", Group("", _of_study)]


def _whole_paths(source: str, changes: Mapping[str, str]) -> dict[str, str]:
    """Complete paths that have their end only, such as E, to those of the robot file."""
    from bowstring.robot.model import Robot
    from bowstring.robot.paths import full_paths
    from bowstring.robot.reader import load_robot

    ends = [path for path in changes if re.split(r"[.\[]", path)[0] not in Robot.model_fields]
    if not ends:
        return dict(changes)
    robot = load_robot(source)
    out: dict[str, str] = {}
    for path, value in changes.items():
        targets = [path]
        if path in ends:
            with suppress(InputError):  # the robot's own message names what is there
                targets = full_paths(robot, path)
        out.update(dict.fromkeys(targets, value))
    return out


def changes_of(flag: str, texts: Sequence[str] | None, example: str) -> dict[str, str]:
    """Parse PATH=VALUE of a repeatable flag."""
    changes = {}
    for text in texts or ():
        path, equals, value = text.partition("=")
        if not (path.strip() and equals):
            raise InputError(f"{flag}: got {quote(text)}; write for example {flag} {example}.")
        changes[path.strip()] = value
    return changes


def check_bare_changes(
    flag: str, make: Callable[[dict[str, str]], Robot], changes: Mapping[str, str]
) -> None:
    """Refuse a number without a unit for a robot's field if it is plausible in the usual unit.

    ``make`` returns the changed robot. It is plausible if the robot with the usual unit is valid
    and has fewer warnings.
    """
    from bowstring.robot.messages import units_of_field

    def doubts(path: str, value: str) -> float:
        try:
            return len(make({path: value}).warnings)
        except InputError:
            return math.inf

    for path, text in changes.items():
        units = units_of_field(path) if has_no_unit(text) else None
        if units is None:
            continue
        si, usual = units
        if doubts(path, f"{text} {si}") > doubts(path, f"{text} {usual}"):
            raise without_unit(f"{flag} {path}", text.strip(), si, usual)


class Figure(Flag):
    """File of a figure, checked before the work; NAME OF ROBOT-what if it is left out.

    ``content`` names the figure in errors.
    """

    kind = Path

    def __init__(self, what: str, content: str = "figure", robot: str = "NAME OF ROBOT") -> None:
        super().__init__("FILE", f"Figure (.png, .pdf, .svg).  [default: {robot}-{what}]")
        self.what, self.content = what, content

    def value(self, flag: str, file: Path | None, robot: Robot) -> Path:
        found = file or default_file(robot, self.what)
        checked: Path = of_flag(flag, lambda each: check_figure(each, self.content), found)
        return checked


def check_figure(file: str | Path, content: str = "figure") -> Path:
    from bowstring.viz.style import check_figure_file

    return check_figure_file(file, content)


def save_figure(draw: Callable[[], Any], file: Path) -> str | None:
    """Draw a figure into a file that `check_figure` allows, as `figure_file`."""
    from bowstring.viz.style import write_figure

    return figure_file(lambda: write_figure(draw, file, "figure"))


def default_file(robot: Robot, what: str) -> Path:
    """Default file of a result in the working folder, such as NAME-map.png."""
    from bowstring.files.atomic_io import file_stem

    return Path(f"{file_stem(robot.name)}-{what}")


def out_folder(out: Path | None, what: str) -> Path | None:
    """Check the result folder of --out before the work."""
    from bowstring.files.result_folder import check_folder

    return None if out is None else of_flag("--out", lambda path: check_folder(path, what), out)


def measurements_of(
    flag: str, file: Any, robot: Robot, mapping: str | None, **settings: Any
) -> Measurements:
    """Read the table of a flag with the mapping of --mapping."""
    from bowstring.data.measurements import Measurements, read_measurements

    layout = mapping_of(mapping)
    found = of_flag(flag, lambda table: read_measurements(table, robot, layout, **settings), file)
    assert isinstance(found, Measurements)
    return found


def mapping_of(source: str | None) -> Any:
    """Load the mapping of --mapping."""
    from bowstring.data.mapping import load_mapping

    return None if source is None else of_flag("--mapping", load_mapping, source)
