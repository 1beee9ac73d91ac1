"""Actuation of the tendons from flags: at rest, over time, and after a preload."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from bowstring.atomic_io import check_file, not_overwritten, write_whole_file
from bowstring.cli.options import (
    not_negative,
    of_flag,
    option,
    per_tendon,
    tendon_count,
)
from bowstring.errors import InputError

if TYPE_CHECKING:
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

LONGEST_RUN: Final = 10_000.0  # s
SHORTEST_STEP: Final = 1e-6  # s
TOO_SHORT: Final = f"{SHORTEST_STEP:g} s is the shortest, as less is below numerical resolution."
Commands = list[float | None]
Tension = Annotated[str | None, option("T1,T2,...", "Tendon tensions.")]
Displacement = Annotated[
    str | None,
    option(
        "P1,P2,...",
        "Tendon displacements from the home pose; negative where lengthened. A - leaves a tendon "
        "to another list: --tension 5,-,- --displacement -,2mm,2mm.",
    ),
]
Angle = Annotated[str | None, option("A1,A2,...", "Motor angles, in rad or with a unit.")]


def actuated_by(
    robot: Robot, tension: str | None, displacement: str | None, angle: str | None
) -> Load:
    """Make a load from tensions, displacements and angles; each tendon has one of them."""
    from bowstring.statics.load import Load

    flags = (
        ("--tension", tension, "N"),
        ("--displacement", displacement, "m"),
        ("--angle", angle, "rad"),
    )
    given = [text for _, text, _ in flags if text is not None]
    if not given:
        raise InputError(
            "no tendon has a command: give --tension T1,T2,..., --displacement "
            "P1,P2,... or --angle A1,A2,..."
        )
    lists = _lists(robot, flags, dashes=len(given) > 1)
    for i in range(tendon_count(robot)):
        said = [flag for flag, values in lists.items() if values and values[i] is not None]
        if len(said) > 1:
            raise InputError(
                f"tendon {i + 1} has {' and '.join(said)}; write - for it in all but one of them."
            )
        if not said:
            raise InputError(
                f"tendon {i + 1} has no command; write a number for it in one of the lists."
            )
    return Load(*lists.values())


def _lists(
    robot: Robot, flags: Iterable[tuple[str, str | None, str]], *, dashes: bool
) -> dict[str, Commands | None]:
    """Numbers by flag, None for a flag that is not given."""
    return {
        flag: None
        if text is None
        else per_tendon(flag, text, si, robot, signed=si != "N", dashes=dashes)
        for flag, text, si in flags
    }


_MOST_HISTORY: Final = 100_000_000  # bytes
# Keys of a file of --save-history.
_NAMES: Final = {"schema_version", "robot_hash", "commands", "tensions_N", "arcs_rad"}


def read_history(file: Path) -> dict[str, Any]:
    from bowstring.json_files import read_json

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
    from bowstring.json_files import read_json

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


def actuated_over_time(
    robot: Robot,
    wanted: tuple[str | None, str | None, str | None],
    rise: str | None,
    hold: str | None,
    before: tuple[str | None, str | None],
    table: Path | None,
) -> tuple[Load, Load | None, float]:
    """Actuation from the flags of `simulate`: over time, at the start, and duration."""
    from bowstring.dynamics.load_history import CLOSEST, Table
    from bowstring.statics.load import Load

    begin_at = ("--from", before[0], "N"), ("--from-displacement", before[1], "m")
    starts = _lists(robot, begin_at, dashes=True)
    if table is not None:
        from bowstring.dynamics.load_table import read_actuation

        flags = zip(("--tension", "--displacement", "--angle"), wanted, strict=True)
        for flag, given in (*flags, ("--rise", rise), ("--hold", hold)):
            if given is not None:
                raise InputError(
                    f"--table already gives the actuation: leave {flag} out, or --table."
                )
        actuation: dict[str, Any] = of_flag(
            "--table", lambda path: read_actuation(path, robot), table
        )
        duration = float(next(iter(actuation.values())).times[-1])
        if duration < SHORTEST_STEP:
            raise InputError(f"--table: it takes {duration:g} s; {TOO_SHORT}")
        if duration > LONGEST_RUN:
            raise InputError(
                f"--table: it takes {duration:g} s; a run of up to {LONGEST_RUN:g} s is possible."
            )
        at_zero = {
            name: history.at(0.0, before=True).tolist() for name, history in actuation.items()
        }
        begin = _starts(robot, starts, at_zero)
        return Load(**actuation), Load(**begin) if begin else None, duration
    if wanted == (None, None, None):
        raise InputError(
            "no tendon has a command: give --tension T1,T2,..., --displacement "
            "P1,P2,..., --angle A1,A2,... or --table FILE."
        )
    load = actuated_by(robot, *wanted)
    rising = not_negative("--rise", "1" if rise is None else rise, "s")
    if 0 < rising < CLOSEST:
        raise InputError(
            f"--rise: got {rising:g} s; must be 0, which is a jump, or {CLOSEST:g} s or more: less "
            "is below numerical resolution."
        )
    holding = not_negative("--hold", "1" if hold is None else hold, "s")
    duration = float(f"{rising + holding:.12g}")  # 0.1 + 0.2 is 0.3
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
    return Load(**over_time), None, duration


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
