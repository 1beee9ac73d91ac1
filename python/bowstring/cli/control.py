"""Commands control and reach: commands of constant curvature, and what a robot reaches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bowstring.cli.flags import OneOrEach, Vector
from bowstring.cli.groups import option
from bowstring.cli.options import (
    AsJson,
    Figure,
    Models,
    RobotOfStudy,
    Rod,
    Weight,
    named,
    tolerated,
)
from bowstring.cli.output import (
    NOT_DRAWN,
    figure_file,
    fixed,
    new_table,
    progress_bar,
    provenance_of,
    write_json,
    write_tables,
)
from bowstring.errors import InputError

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.cli.schemas.basic import OfRobot
    from bowstring.statics.load import Load
    from bowstring.validity.control import ControlErrors
    from bowstring.validity.reach import Reach
    from bowstring.validity.workspace import WorkspaceMap


_COLUMNS = 3  # corrections in the table, beside the last one


def control(
    robot: RobotOfStudy,
    max_tension: Annotated[
        Any,
        OneOrEach(
            "N",
            '"80 N"',
            "Largest tension of all tendons, or of each, of the wanted tips and of all commands.  "
            "[default: a quarter turn of its segment by the linear law]",
            one="positive",
        ),
    ],
    tolerance: Annotated[str, tolerated("Tolerated distance")],
    loads: Weight,
    rod: Rod,
    out: Annotated[Path, Figure("control.png", "figure of the control error", "NAME")],
    poses: Annotated[int, option("N", "Number of wanted tips to draw.")] = 1024,
    corrections: Annotated[
        int, option("N", "Number of corrections by the measured tip, 0 to 20.")
    ] = 3,
    commands: Annotated[
        str | None,
        option(
            "NAME,...",
            "Commands of constant curvature: tensions, tensions_arm, tensions_calibrated, "
            "displacements, displacements_chord.  [default: all that the robot takes]",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Where the robot lands when the inverse of constant curvature commands it.

    Wanted tips are drawn over the workspace. For each the tendons are commanded by constant
    curvature, the equilibrium is solved, and the command is corrected by the tip that the robot
    reached. The exact inverse stands beside it.
    """

    from bowstring.validation import share_of_length
    from bowstring.validity.control import control_errors

    share = share_of_length("tolerance", tolerance, robot.length)
    with progress_bar("poses") as notify:
        found = control_errors(
            robot,
            poses=poses,
            corrections=corrections,
            commands=named(commands),
            max_tension=max_tension,
            load=loads,
            model=rod,
            progress=notify,
        ).with_tolerance(share)
        written = figure_file(lambda: found.save(out))
    made = provenance_of(robot, **_settings(loads), poses=poses, corrections=corrections)
    _print(found, written, made, as_json, _table(found))


def reach(
    robot: RobotOfStudy,
    max_tension: Annotated[
        Any,
        OneOrEach(
            "N",
            '"80 N"',
            "Largest tension of all tendons, or of each.  [default: a quarter turn of its segment "
            "by the linear law]",
            one="positive",
        ),
    ],
    payload_direction: Annotated[
        list[float] | None,
        Vector(
            "",
            "0,0,-1",
            "Direction of the payload's force, base axes.  [default: that of gravity, else -z]",
        ),
    ],
    tolerance: Annotated[
        str, tolerated("Displacement that a payload may cause; with --errors the tip error")
    ],
    loads: Weight,
    rod: Rod,
    out: Annotated[Path, Figure("reach.png", "figure of the reach", "NAME")],
    errors: Annotated[
        bool,
        typer.Option(
            "--errors", help="The errors of constant curvature by the position of the tip instead."
        ),
    ] = False,
    models: Models = None,
    poses: Annotated[int, option("N", "Number of poses to draw.")] = 2048,
    as_json: AsJson = False,
) -> None:
    """What the robot reaches under tension limits, by physics and by constant curvature.

    With the dexterity, the compliance of the tip, and the largest payload for a displacement
    allowed, over the workspace; or, with --errors, where constant curvature holds there, and which
    effect makes most of its error.
    """
    from bowstring.validity.reach import reach as find_reach
    from bowstring.validity.workspace import workspace_map

    if errors and payload_direction is not None:
        raise InputError("--payload-direction: --errors has no payloads; leave one of them out.")
    if models is not None and not errors:
        raise InputError("--models: it names models whose errors are mapped; add --errors.")
    with progress_bar("poses") as notify:
        given: dict[str, Any] = {
            "poses": poses,
            "max_tension": max_tension,
            "tolerance": tolerance,
            "load": loads,
            "model": rod,
            "progress": notify,
        }
        found = (
            workspace_map(robot, models=named(models), **given)
            if errors
            else find_reach(robot, payload_direction=payload_direction, **given)
        )
        written = figure_file(lambda: found.save(out))
    _print(found, written, provenance_of(robot, **_settings(loads), poses=poses), as_json)


def _settings(loads: Load) -> dict[str, Any]:
    return {"gravity_m_per_s2": loads.gravity, "tip_force_N": loads.tip_force}


def _print(
    found: ControlErrors | Reach | WorkspaceMap,
    file: str | None,
    made: OfRobot,
    as_json: bool,
    *tables: Table,
) -> None:
    text = found.described()
    if as_json:
        return write_json({**made, **found.to_dict(), "text": text, "file": file})
    write_tables(*tables, "\n".join([*text, f"Figure: {file or NOT_DRAWN}"]))


def _table(found: ControlErrors) -> Table:
    """Mean and largest distance in mm, without and after corrections."""
    from bowstring.validity.control_commands import COMMANDS

    count = max(len(rows) for rows in found.landed.values())
    shown = [k for k in range(1, count) if k <= _COLUMNS or k == count - 1]
    after = [f">after {k}" for k in shown]
    table = new_table("command", ">mean mm", ">largest mm", *after, ">in tolerance %")
    for name in found.landed:
        rows = found.summary(name)
        means = [fixed(1e3 * row.mean, 3) for row in rows]
        table.add_row(
            COMMANDS[name],
            means[0],
            fixed(1e3 * rows[0].largest, 3),
            *(means[k] if k < len(means) else "-" for k in shown),
            fixed(100.0 * rows[0].valid, 0),
        )
    return table
