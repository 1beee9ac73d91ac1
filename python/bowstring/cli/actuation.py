"""Actuation of the tendons from flags: at rest, over time, and after a preload."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from bowstring.cli.flags import Number, PerTendon, of_flag, tendon_count
from bowstring.cli.groups import Group, option
from bowstring.cli.output import warn
from bowstring.errors import InputError
from bowstring.files.atomic_io import check_file, not_overwritten, write_whole_file

if TYPE_CHECKING:
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

LONGEST_RUN: Final = 10_000.0  # s
SHORTEST_STEP: Final = 1e-6  # s
TOO_SHORT: Final = f"{SHORTEST_STEP:g} s is the shortest, as less is below numerical resolution."
Commands = list[float | None]


class _Texts(PerTendon):
    """Values of the tendons as text; a dash refers to another list, so all are read together."""

    def read(self, flag: str, text: str, robot: Robot) -> Any:
        return text


_TENSION: Final = _Texts("N", '"80 N",0,0', "Tendon tensions.", "--tension")
_DISPLACEMENT: Final = _Texts(
    "m",
    '"10 mm",-0.005,-0.005',
    "Tendon displacements from the home pose; negative where lengthened. A - leaves a tendon "
    "to another list: --tension 5,-,- --displacement -,2mm,2mm.",
    "--displacement",
    form="P1,P2,...",
    signed=True,
)
_ANGLE: Final = _Texts(
    "rad",
    '"90 deg",-0.5,-0.5',
    "Motor angles, in rad or with a unit.",
    "--angle",
    form="A1,A2,...",
    signed=True,
)
_PRESSURE: Final = _Texts(
    "Pa",
    '"30 kPa",0,0',
    "Pressures in chambers, above that around the robot: tensions of minus pressure times area.",
    "--pressure",
    form="P1,P2,...",
    signed=True,
)
Tension = Annotated[str | None, _TENSION]
Displacement = Annotated[str | None, _DISPLACEMENT]
Angle = Annotated[str | None, _ANGLE]
Pressure = Annotated[str | None, _PRESSURE]


def actuation_or_none(
    robot: Robot, tension: Tension, displacement: Displacement, angle: Angle, pressure: Pressure
) -> Load | None:
    """Make a load from tensions, displacements, angles and pressures; each tendon has one."""
    from bowstring.statics.actuation import tensions_of_pressures
    from bowstring.statics.load import Load

    texts = (
        (_TENSION, tension),
        (_DISPLACEMENT, displacement),
        (_ANGLE, angle),
        (_PRESSURE, pressure),
    )
    given = [(flag, text) for flag, text in texts if text is not None]
    if not given:
        return None
    lists = {
        flag.name: flag.entries(flag.name, text, robot, dashes=len(given) > 1)
        for flag, text in given
    }
    for i in range(tendon_count(robot)):
        said = [flag for flag, values in lists.items() if values[i] is not None]
        if len(said) > 1:
            raise InputError(
                f"tendon {i + 1} has {' and '.join(said)}; write - for it in all but one of them."
            )
        if not said:
            raise InputError(
                f"tendon {i + 1} has no command; write a number for it in one of the lists."
            )
    if pressure is not None:
        pushed = of_flag(
            "--pressure", lambda each: tensions_of_pressures(robot, each), lists["--pressure"]
        )
        pulled = lists.get("--tension", pushed)
        lists["--tension"] = [a if b is None else b for a, b in zip(pulled, pushed, strict=True)]
    return Load(*(lists.get(flag.name) for flag in (_TENSION, _DISPLACEMENT, _ANGLE)))


Actuation = Annotated["Load | None", Group("Actuation", actuation_or_none)]


def acting(actuation: Load, loads: Load) -> Load:
    """Load of an actuation and of loads beside the tendons."""
    return loads.replace(
        tensions=actuation.tensions,
        displacements=actuation.displacements,
        angles=actuation.angles,
    )


def no_command() -> InputError:
    return InputError(
        "no tendon has a command: give --tension T1,T2,..., --displacement P1,P2,..., "
        "--angle A1,A2,... or, for chambers, --pressure P1,P2,..."
    )


def at_rest(robot: Robot, actuation: Load | None, loads: Load) -> Load:
    """Load of an equilibrium: slack tendons without an actuation, gravity of the robot file."""
    from bowstring.statics.load import Load

    slack = Load(tensions=[0.0] * tendon_count(robot))
    gravity = robot.gravity if loads.gravity is None else loads.gravity
    return acting(actuation or slack, loads).replace(gravity=gravity)


_MOST_HISTORY: Final = 100_000_000  # bytes
# Keys of a file of --save-history.
_NAMES: Final = {"schema_version", "robot_hash", "commands", "tensions_N", "arcs_rad"}


def read_history(file: Path) -> dict[str, Any]:
    from bowstring.files.json_files import read_json

    try:
        content = read_json(file, _MOST_HISTORY)
    except OSError as error:
        raise InputError(f"--history: {file} cannot be read: {error.strerror}.") from None
    except ValueError as error:
        raise InputError(
            f"--history: {file} is no history: {error}; give a file that --save-history wrote."
        ) from None
    if "robot_hash" not in content:
        raise InputError(f"--history: {file} is no history; give one that --save-history wrote.")
    return content


def check_history_file(file: Path) -> Path:
    """Check before any work that a history may be written: to a new file or a former history."""
    from bowstring.files.json_files import read_json

    found = check_file(file, "history", (file.suffix.lower(),), b'{"schema_version": ')
    if found.exists() and found.stat().st_size:
        try:
            former = _NAMES.issubset(read_json(found, _MOST_HISTORY))
        except (OSError, ValueError):
            former = False
        if not former:
            raise not_overwritten(f"cannot write the history to {found}")
    return found


def write_history(file: Path, history: dict[str, Any] | None) -> None:
    """Write a history, whole or not at all."""

    def fill(new: Path) -> None:
        new.write_text(json.dumps(history, allow_nan=False) + "\n", "utf-8")

    try:
        write_whole_file(file, "history", fill, lambda: check_history_file(file))
    except InputError as error:
        raise InputError(f"--save-history: {error}") from None


@dataclass(frozen=True)
class OverTime:
    """Actuation over time, actuation at the start if it differs, and duration in s."""

    load: Load
    start: Load | None
    duration: float


def actuated_over_time(
    robot: Robot,
    tension: Tension,
    displacement: Displacement,
    angle: Angle,
    pressure: Pressure,
    rise: Annotated[
        float | None,
        Number(
            "s",
            '"500 ms"',
            "Time of the rise to --tension, --displacement, --angle; 0 is a jump.  [default: 1]",
            must_be="0 or more",
        ),
    ],
    hold: Annotated[
        float | None,
        Number("s", '"2 s"', "Time after the rise.  [default: 1]", must_be="0 or more"),
    ],
    before: Annotated[
        Commands | None,
        PerTendon(
            "N",
            '"40 N",0,0',
            "Tensions at the start, where the robot is in equilibrium; they change to "
            "--tension within --rise.  [default: none]",
            "--from",
            dashes=True,
        ),
    ],
    from_displacement: Annotated[
        Commands | None,
        PerTendon(
            "m",
            '"10 mm",-0.005,-0.005',
            "Displacements of that equilibrium.  [default: those of home, 0]",
            form="P1,P2,...",
            signed=True,
            dashes=True,
        ),
    ],
    table: Annotated[
        Path | None,
        option(
            "FILE",
            "CSV over time, columns t_s and for each tendon tension_1_N, displacement_1_mm or "
            "angle_1_deg; instead of --tension, --displacement, --angle, --rise and --hold.",
        ),
    ] = None,
) -> OverTime:
    """Make the actuation of a motion: a table, or a rise from the start to given values."""
    from bowstring.dynamics.load_history import CLOSEST, Table
    from bowstring.statics.load import Load

    starts = {"--from": before, "--from-displacement": from_displacement}
    wanted = {
        "--tension": tension,
        "--displacement": displacement,
        "--angle": angle,
        "--pressure": pressure,
    }
    if table is not None:
        for flag, given in {**wanted, "--rise": rise, "--hold": hold}.items():
            if given is not None:
                raise InputError(
                    f"--table already gives the actuation: leave {flag} out, or --table."
                )
        return _of_table(robot, table, starts)
    load = actuation_or_none(robot, tension, displacement, angle, pressure)
    if load is None and tendon_count(robot):
        raise InputError(
            "no tendon has a command: give --tension T1,T2,..., --displacement "
            "P1,P2,..., --angle A1,A2,... or --table FILE."
        )
    load = load or Load(tensions=[])  # a bare rod has none
    rising = 1.0 if rise is None else rise
    if 0 < rising < CLOSEST:
        raise InputError(
            f"--rise: got {rising:g} s; must be 0, which is a jump, or {CLOSEST:g} s or more: less "
            "is below numerical resolution."
        )
    holding = 1.0 if hold is None else hold
    duration = float(f"{rising + holding:.12g}")  # 0.1 + 0.2 gives 0.3
    if duration == 0:
        raise InputError("--rise and --hold are both 0 s: there is no time to simulate.")
    if duration < SHORTEST_STEP:
        raise InputError(f"--hold: with --rise the run takes {duration:g} s; {TOO_SHORT}")
    if duration > LONGEST_RUN:
        flag = "--rise" if rising > holding else "--hold"
        raise InputError(
            f"{flag}: the run takes {duration:g} s; up to {LONGEST_RUN:g} s are possible."
        )
    nan = float("nan")
    rows = {
        name: [nan if v is None else v for v in end]
        for name in ("tensions", "displacements", "angles")
        if (end := getattr(load, name)) is not None
    }
    at_zero = {name: [0.0 * v for v in row] for name, row in rows.items()}
    begin = at_zero | _starts(robot, starts, at_zero)
    over_time = {name: Table([0.0, rising], [begin[name], row]) for name, row in rows.items()}
    return OverTime(Load(**over_time), None, duration)


def _of_table(robot: Robot, table: Path, starts: Mapping[str, Commands | None]) -> OverTime:
    import numpy as np

    from bowstring.data.tendon_check import wound_by_tensions
    from bowstring.dynamics.load_table import read_actuation
    from bowstring.statics.load import Load

    actuation = of_flag("--table", lambda path: read_actuation(path, robot), table)
    if "tensions" in actuation:
        tensions = np.nan_to_num(actuation["tensions"].values)
        if wound := wound_by_tensions(robot, tensions):
            warn(f"--table: {wound}")
    duration = float(next(iter(actuation.values())).times[-1])
    if duration < SHORTEST_STEP:
        raise InputError(f"--table: it takes {duration:g} s; {TOO_SHORT}")
    if duration > LONGEST_RUN:
        raise InputError(
            f"--table: it takes {duration:g} s; a run of up to {LONGEST_RUN:g} s is possible."
        )
    at_zero = {name: values.at(0.0, before=True).tolist() for name, values in actuation.items()}
    begin = _starts(robot, starts, at_zero)
    return OverTime(Load(**actuation), Load(**begin) if begin else None, duration)


Motion = Annotated[OverTime, Group("Actuation", actuated_over_time)]


def _starts(
    robot: Robot, starts: Mapping[str, Commands | None], at_zero: Mapping[str, list[float]]
) -> dict[str, list[float]]:
    """Initial tensions, displacements and angles: --from and --from-displacement, else at time 0.

    NaN marks a tendon with a command of another kind; empty without these flags.
    """
    found = {name: list(row) for name, row in at_zero.items()}
    asked = False
    for flag, start in starts.items():
        kinds = ("tensions",) if flag == "--from" else ("displacements", "angles")
        for i, value in enumerate(start or ()):
            mine = [name for name in kinds if name in found and not math.isnan(found[name][i])]
            if value is None:
                continue
            if not mine:
                other = "tension" if flag == "--from" else "displacement or angle"
                raise InputError(
                    f"{flag}: got {value:g} for tendon {i + 1}, which no {other} moves; write - "
                    "for it."
                )
            asked = True
            radius = float(robot.tendons.spool_radius_m[i])
            if mine == ["angles"] and not math.isnan(radius):  # otherwise simulate raises an error
                value /= radius
            found[mine[0]][i] = value
    return found if asked else {}
