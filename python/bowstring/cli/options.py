"""Common flags of commands, and conversion of their texts to numbers; errors name the flag.

The flags of the actuation are in `actuation`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from bowstring.cli import completion
from bowstring.cli.output import counted, say
from bowstring.errors import InputError
from bowstring.units import NUMBER, has_no_unit, number_with_unit, quote, read_number, read_share

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements
    from bowstring.robot.model import Robot
    from bowstring.statics.load import PointLoad
    from bowstring.statics.plane import Plane

MOST_LOADS: Final = 100_000  # loads of a range
_EARTH_IN_MM: Final = (9700.0, 9900.0)  # Earth's gravity in mm/s^2


def option(
    form: str, text: str, *names: str, values: Callable[..., list[str]] | None = None
) -> Any:
    """Make a flag from the form of its value and its help; its default name is the argument's.

    ``values`` are offered by completion.
    """
    return typer.Option(*names, metavar=form, help=text, autocompletion=values)


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
Gravity = Annotated[str | None, option("x,y,z", "Gravity, in place of that of the robot file.")]
_ELEMENTS: Final = completion.words("1", "2", "4", "8")
Elements = Annotated[
    int | None,
    option(
        "1|2|4|8",
        "Fourth-order elements between two disks.  [default: 1, or as many as loads between disks "
        "need]",
        values=_ELEMENTS,
    ),
]
AutomaticElements = Annotated[
    int | None,
    option(
        "1|2|4|8",
        "Fourth-order elements between two disks.  [default: chosen for accuracy]",
        values=_ELEMENTS,
    ),
]
TipForce = Annotated[str, option("x,y,z", "Dead load: constant force at the tip, base axes.")]
DiskForces = Annotated[
    list[str] | None,
    option(
        "N:x,y,z",
        "Dead load: force on disk N, counted from 1 at the base, base axes. Repeatable.",
        "--disk-force",
    ),
]
DiskMoments = Annotated[
    list[str] | None,
    option(
        "N:x,y,z",
        "Dead load: moment on disk N, counted from 1 at the base, base axes. Repeatable.",
        "--disk-moment",
    ),
]
PointForces = Annotated[
    list[str] | None,
    option(
        "N:x,y,z@px,py,pz",
        "Dead load: force at a point of disk N, counted from 1 at the base; the point is given in "
        "the disk's axes from its centre; or force "
        'on the backbone at an arc length with its unit in place of N, as "137 mm:0,1,0". '
        "Repeatable.",
        "--point-force",
    ),
]
FollowerForces = Annotated[
    list[str] | None,
    option(
        "N:x,y,z[@px,py,pz]",
        "Follower load: force on disk N, counted from 1 at the base, or at a point of it, in the "
        "disk's axes; or at an arc length as for --point-force. Repeatable.",
        "--follower-force",
    ),
]
LineForce = Annotated[
    str | None,
    option("x,y,z", "Dead load: force per length of backbone in N/m, base axes.", "--line-force"),
]
PlaneText = Annotated[
    str | None,
    option(
        "x,y,z:nx,ny,nz",
        "Rigid plane that the tip may touch: a point and the normal, which points to the robot, "
        "base axes.",
        "--plane",
    ),
]
PlaneFriction = Annotated[
    str | None,
    option(
        "MU",
        "Coefficient of Coulomb friction between tip and plane.  [default: 0]",
        "--plane-friction",
        values=completion.words("0.1", "0.2", "0.3"),
    ),
]
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
OfMasses = Annotated[str, option("g", "Gravity that turns masses into tensions.", "--g")]


_EXAMPLES: Final = {
    "--lengths": '"641 mm",0.65,0.65',
    "--tension": '"80 N",0,0',
    "--displacement": '"10 mm",-0.005,-0.005',
    "--angle": '"90 deg",-0.5,-0.5',
    "--tip": "0.1,0,0.6",
    "--direction": "0.5,0,0.9",
    "--min-tension": '"1 N"',
    "--displacement-limits": '"-30 mm,30 mm"',
    "--gravity": "0,0,-9.81",
    "--tip-force": "0,1,0",
    "--tip-moment": "0,0.1,0",
    "--disk-force": "4:0,1,0",
    "--disk-moment": "4:0,0.1,0",
    "--plane": "0.2,0,0:-1,0,0",
    "--plane-friction": "0.2",
    "--payload-direction": "0,0,-1",
    "--tolerance": '"1 %"',
    "--max-tension": '"80 N"',
    "--from": '"40 N",0,0',
    "--from-tension": '"40 N",0,0',
    "--from-tip-force": "0,0,-4",
    "--from-gravity": "0,0,-9.81",
    "--max-factor": "2",
    "--period": '"5 s"',
    "--step": "0.05",
    "--from-displacement": '"10 mm",-0.005,-0.005',
    "--rise": '"500 ms"',
    "--hold": '"2 s"',
    "--dt": '"1 ms"',
    "--every": '"10 ms"',
    "--mass-damping": "0.5",
    "--material-damping": '"1 ms"',
    "--modal-damping": '"1 %"',
    "--point-force": '4:0,1,0@0,0,"20 mm"',
    "--follower-force": "4:0,1,0",
    "--line-force": "0,0,-2",
    "--tendon": "1,2:0.5",
    "--g": "9.81",
    "--masses": '0:"500 g":8',
    "--tensions": "0:5:80",
    "--loads": "10:10:80",
    "--displacements": '0:"2 mm":0.03',
    "--noise": '"0.02 mm"',
    "--friction": "0.1",
    "--tilt": '"0.3 deg"',
    "--shift": '"1 mm",0,0',
    "--tool": '0,0,"8 mm"',
    "--tool-error": '"1 mm",0,0',
    "--drift": '0,"0.2 mm",0',
    "--holdout": '"20 %"',
    "--prior": 'offset="0.5 mm"',
}


def load(source: str, overrides: Sequence[str] | None) -> Robot:
    from bowstring.robot.reader import load_robot

    if not source.strip():
        raise InputError("ROBOT: got nothing; name a built-in robot or a robot file (YAML).")
    given = changes_of("--set", overrides, 'segments.0.length="500 mm"')
    changes = _whole_paths(source, given)
    check_bare_changes("--set", lambda change: load_robot(source, change), changes)
    try:
        robot = load_robot(source, changes)
    except InputError as error:
        if not changes:
            raise
        load_robot(source)  # errors of the file itself do not name the flag
        raise InputError(f"--set: {error}") from None
    for sentence in robot.warnings:
        say("Warning", sentence)
    return robot


def _whole_paths(source: str, changes: Mapping[str, str]) -> dict[str, str]:
    """Changes by the paths of the robot file, where some have the end of a path, as of an axis."""
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


def numbers_of(flag: str, text: str, si: str, example: str = "") -> list[float]:
    if not example:  # --tolerance of simulate is a length, that of the study a share
        example = '"1 um"' if (flag, si) == ("--tolerance", "m") else _EXAMPLES[flag]
    values = []
    for item in text.split(","):
        try:
            values.append(read_number(item, si))
        except ValueError as error:
            raise InputError(
                f"{flag}: got {quote(item.strip())}, {error}; write for example {flag} {example}."
            ) from None
        low, high = _EARTH_IN_MM
        if si == "m/s^2" and has_no_unit(item) and low < abs(values[-1]) < high:
            raise _without_unit(flag, item.strip(), si, "mm/s^2")
    return values


def number_of(flag: str, text: str, si: str) -> float:
    values = numbers_of(flag, text, si)
    if len(values) != 1:
        raise InputError(f"{flag}: got {len(values)} numbers; write one.")
    return values[0]


def share_of(flag: str, text: str, rule: str, accepts: Callable[[float], bool]) -> float:
    """Read a share such as "0.01" or "1 %"; ``rule`` has its meaning and range for the error."""
    value = math.nan
    with suppress(ValueError):
        value = read_share(text)
    if not accepts(value):
        raise InputError(
            f"{flag}: got {quote(text.strip())}; must be {rule}, "
            f"write for example {flag} {_EXAMPLES[flag]}."
        )
    return value


def shares_of(flag: str, text: str, robot: Robot) -> dict[int, float]:
    """Parse numbers of tendons and their shares of the sweep's tension."""
    out: dict[int, float] = {}
    count = tendon_count(robot)
    rule = "a tendon and, after a colon, its share of the sweep's tension"
    for item in text.split(","):
        number, colon, share = item.strip().partition(":")
        if not (number.isdecimal() and 1 <= int(number) <= count):
            raise InputError(
                f"{flag}: got {quote(item.strip())}; must be a tendon of {robot.name} from 1 to "
                f"{count}, and its share after a colon, for example {flag} 1,{min(count, 2)}:0.5."
            )
        if int(number) in out:
            raise InputError(f"{flag}: tendon {number} is there twice; name each one once.")
        out[int(number)] = share_of(flag, share, rule, math.isfinite) if colon else 1.0
    return out


def positive(flag: str, text: str, si: str) -> float:
    value = number_of(flag, text, si)
    if value <= 0:
        raise InputError(f"{flag}: got {f'{value:g} {si}'.strip()}; must be positive.")
    return value


def not_negative(flag: str, text: str, si: str) -> float:
    value = number_of(flag, text, si)
    if value < 0:
        raise InputError(f"{flag}: got {f'{value:g} {si}'.strip()}; must be 0 or more.")
    return value


def ratio(flag: str, text: str | None) -> float | None:
    if text is None:
        return None
    rule = "a share of critical damping from 0 to 1"
    return share_of(flag, text, rule, lambda value: 0 <= value <= 1)


def check_elements(elements: int | None) -> None:
    if elements not in (None, 1, 2, 4, 8):
        raise InputError(f"--elements: got {elements}; must be 1, 2, 4 or 8.")


def vector(flag: str, text: str, si: str) -> list[float]:
    values = numbers_of(flag, text, si)
    if len(values) != 3:
        raise InputError(
            f"{flag}: got {counted(len(values), 'number')}; write x, y and z, "
            f"for example {flag} {_EXAMPLES[flag]}."
        )
    return values


_AT_POINTS: Final = ("--point-force", "--follower-force")


def on_disks(
    flag: str, texts: Sequence[str] | None, si: str, robot: Robot
) -> list[list[float]] | None:
    """Parse N:x,y,z of a repeatable flag to vectors on all disks; None without any."""
    if not texts:
        return None
    count = len(robot.disks.station_m)
    vectors = [[0.0, 0.0, 0.0] for _ in range(count)]
    seen = set()
    for text in texts:
        disk, components = _disk_of(flag, text, robot)
        if disk in seen:
            raise InputError(f"{flag}: disk {disk} is there twice; name each one once.")
        seen.add(disk)
        vectors[disk - 1] = vector(flag, components, si)
    return vectors


def _disk_of(flag: str, text: str, robot: Robot) -> tuple[int, str]:
    """Disk, counted from 1, before a colon, and the text after it."""
    count = len(robot.disks.station_m)
    number, colon, components = text.partition(":")
    number = number.strip()
    short = number.isdecimal() and len(number) < 10
    point = "@0,0,0" if flag == "--point-force" else ""
    place = " or an arc length with its unit" if flag in _AT_POINTS else ""
    if not (colon and short and 1 <= int(number) <= count):
        raise InputError(
            f"{flag}: got {quote(text)}; must be a disk of {robot.name} from 1 to {count}"
            f"{place} and, after a colon, x, y and z, for example {flag} {min(4, count)}:0,1,0"
            f"{point}."
        )
    return int(number), components


def _arc_length_of(flag: str, text: str) -> float | None:
    """Read an arc length with its unit before a colon; None for a disk."""
    text = text.strip()
    if not text or has_no_unit(text) or not re.match(NUMBER, text, re.ASCII):
        return None
    return number_of(flag, text, "m")


def at_points(
    dead: Sequence[str] | None, followers: Sequence[str] | None, robot: Robot
) -> tuple[PointLoad, ...] | None:
    """Parse --point-force and --follower-force; None without any."""
    from bowstring.statics.load import PointLoad

    loads = []
    for flag, texts in zip(_AT_POINTS, (dead, followers), strict=True):
        for text in texts or ():
            place, _, components = text.partition(":")
            arc_length = _arc_length_of(flag, place)
            if arc_length is None:
                disk, components = _disk_of(flag, text, robot)
            else:
                disk = 0
            force, at, point = components.partition("@")
            if not at and arc_length is None and flag == "--point-force":
                raise InputError(
                    f"{flag}: got {quote(text)}; a point of the disk must follow the force after "
                    f"an @, for example {flag} {_EXAMPLES[flag]}; --disk-force takes a force on "
                    "the centre; for a force on the backbone give an arc length in place of the "
                    'disk, such as "137 mm:0,1,0".'
                )
            offset: Sequence[float] = (0.0, 0.0, 0.0)
            if at:
                offset = vector(flag, point, "m")
                check_bare(flag, point, "m", robot, 10.0 * robot.length, "mm")
            values = vector(flag, force, "N")
            follower = "follower" in flag
            try:
                load = PointLoad(
                    disk - 1, values, point=offset, follower=follower, arc_length=arc_length
                )
            except InputError as error:
                raise InputError(f"{flag}: {error}") from None
            loads.append(load)
    return tuple(loads) or None


def plane_of(flag: str, text: str | None, friction: str | None) -> Plane | None:
    """Parse x,y,z:nx,ny,nz to a plane; None without it."""
    from bowstring.statics.plane import Plane

    if text is None:
        if friction is not None:
            raise InputError(f"--plane-friction: there is no plane; add {flag}.")
        return None
    point, colon, normal = text.partition(":")
    if not colon or ":" in normal:
        raise InputError(
            f"{flag}: got {quote(text)}; must be a point and, after a colon, the normal, for "
            f"example {flag} {_EXAMPLES[flag]}."
        )
    coefficient = 0.0 if friction is None else not_negative("--plane-friction", friction, "")
    at, along = vector(flag, point, "m"), vector(flag, normal, "1")
    try:
        return Plane(at, along, coefficient)
    except InputError as error:
        raise InputError(f"{flag}: {error}") from None


def check_bare(
    flag: str, text: str, si: str, robot: Robot, most: float | Sequence[float], small: str
) -> None:
    """Refuse a number without a unit that is too large in SI but plausible in a smaller unit.

    ``most`` is a limit for each number, or one for all.
    """
    items = [item.strip() for item in text.split(",")]
    limits = [most] * len(items) if isinstance(most, (int, float)) else most
    for item, limit in zip(items, limits, strict=False):
        if not has_no_unit(item) or abs(float(item)) <= limit:
            continue
        if abs(read_number(f"{item} {small}", si)) <= limit:
            winds = " and more than all of a tendon" if si == "rad" else ""
            why = f"{winds}, and {robot.name} is {number_with_unit(robot.length, 'm')} long"
            raise _without_unit(flag, item, si, small, why)


def _without_unit(flag: str, item: str, si: str, small: str, why: str = "") -> InputError:
    return InputError(
        f"{flag}: got {item} without a unit, which is {item} {si}{why}; "
        f'write "{item} {small}" if that is meant, else "{item} {si}".'
    )


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
            raise _without_unit(f"{flag} {path}", text.strip(), si, usual)


def check_bare_command(flag: str, text: str, si: str, robot: Robot) -> None:
    """Refuse displacements and angles without a unit that exceed the length of a tendon."""
    import numpy as np

    tendons = robot.tendons
    longest = robot.disks.station_m[tendons.end_disk] + tendons.free_length_m
    if si == "m":  # the solver has a better message for slightly too large displacements
        check_bare(flag, text, si, robot, (1.6 * longest).tolist(), "mm")
    if si == "rad":
        turns = longest / tendons.spool_radius_m  # NaN without a spool, refused elsewhere
        check_bare(flag, text, si, robot, np.nan_to_num(turns, nan=math.inf).tolist(), "deg")


def per_tendon(
    flag: str,
    text: str,
    si: str,
    robot: Robot,
    *,
    above_zero: bool = False,
    signed: bool = False,
    dashes: bool = False,
) -> list[Any]:
    """Read a number for each tendon; with `dashes`, a dash or a blank gives None."""
    items = [item.strip() for item in text.split(",")]
    wanted = tendon_count(robot)
    first = _EXAMPLES[flag].partition(",")[0]
    example = ",".join([first, *[first if above_zero else "0"] * (wanted - 1)])
    values = [
        None if dashes and item in ("", "-") else numbers_of(flag, item, si, example)[0]
        for item in items
    ]
    if len(values) != wanted:
        kind = ("entry", "entries") if dashes else ("number", "numbers")
        rest = "a number or - for each" if dashes else "one number for each"
        raise InputError(
            f"{flag}: got {counted(len(values), *kind)}; {robot.name} has "
            f"{counted(wanted, 'tendon')}, write {rest}."
        )
    if signed:
        check_bare_command(flag, text, si, robot)
    for i, value in enumerate(values, 1):
        if value is not None and not signed and (value < 0 or (above_zero and value == 0)):
            rule = "positive" if above_zero else "0 or more, a tendon cannot push"
            raise InputError(f"{flag}: got {value:g} {si} for tendon {i}; must be {rule}.")
    return values


def range_of(flag: str, text: str, si: str) -> list[float]:
    """Read a list of numbers, or first:step:last."""
    parts = text.split(":")
    if len(parts) == 1:
        return numbers_of(flag, text, si)
    if len(parts) != 3:
        raise InputError(
            f"{flag}: got {quote(text)}; write first:step:last, for example {flag} "
            f"{_EXAMPLES[flag]}."
        )
    first, step, last = (number_of(flag, part, si) for part in parts)
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


def tendon_count(robot: Robot) -> int:
    return len(robot.tendons.angle_rad)


def of_flag(flag: str, check: Callable[[Any], Any], value: Any) -> Any:
    """Run a check, whose errors then name the flag."""
    try:
        return check(value)
    except InputError as error:
        if error.rule:  # its own flag is named at the end
            raise
        raise InputError(f"{flag}: {error}") from None


def default_file(robot: Robot, what: str) -> Path:
    """File in the working folder that has a result if no other is named, such as NAME-map.png."""
    from bowstring.atomic_io import file_stem

    return Path(f"{file_stem(robot.name)}-{what}")


def out_folder(out: Path | None, what: str) -> Path | None:
    """Check the result folder of --out before the work."""
    from bowstring.result_folder import check_folder

    return None if out is None else of_flag("--out", lambda path: check_folder(path, what), out)


def measurements_of(
    flag: str, file: Any, robot: Robot, mapping: str | None, **g: float
) -> Measurements:
    """Read the table of a flag with the mapping of --mapping."""
    from bowstring.data.measurements import Measurements, read_measurements

    layout = mapping_of(mapping)
    found = of_flag(flag, lambda table: read_measurements(table, robot, layout, **g), file)
    assert isinstance(found, Measurements)
    return found


def mapping_of(source: str | None) -> Any:
    """Load the mapping of --mapping."""
    from bowstring.data.mapping import load_mapping

    return None if source is None else of_flag("--mapping", load_mapping, source)
