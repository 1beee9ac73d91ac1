"""Commands control and reach: commands of constant curvature, and what a robot reaches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import (
    AsJson,
    AutomaticElements,
    Gravity,
    Overrides,
    RobotSource,
    Theory,
    TipForce,
    default_file,
    load,
    per_tendon,
    positive,
    share_of,
    vector,
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

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.robot.model import Robot
    from bowstring.validity.control import ControlErrors


_COLUMNS = 3  # corrections in the table, beside the last one


def control(
    robot: RobotSource = "amouri2019",
    max_tension: Annotated[
        str | None,
        option(
            "T or T1,T2,...",
            "Largest tension of all tendons, or of each, of the wanted tips and of all commands.  "
            "[default: a quarter turn of its segment by the linear law]",
        ),
    ] = None,
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
    tolerance: Annotated[
        str, typer.Option(help='Tolerated distance, a share of the length: 0.01 or "1 %".')
    ] = "1 %",
    gravity: Gravity = None,
    tip_force: TipForce = "0,0,0",
    theory: Theory = "cosserat",
    elements: AutomaticElements = None,
    out: Annotated[
        Path | None,
        option("FILE", "Figure (.png, .pdf, .svg).  [default: NAME-control.png]"),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Where the robot lands when the inverse of constant curvature commands it.

    Wanted tips are drawn over the workspace. For each the tendons are commanded by constant
    curvature, the equilibrium is solved, and the command is corrected by the tip that the robot
    reached. The exact inverse stands beside it.
    """
    model, given, settings = _read(
        robot, overrides, max_tension, tolerance, gravity, tip_force, theory, elements
    )

    from bowstring.validity.control import check_control_file, control_errors

    file = of_flag("--out", check_control_file, out or default_file(model, "control.png"))
    names = None if commands is None else [name.strip() for name in commands.split(",")]
    with progress_bar("poses") as notify:
        found = control_errors(
            model,
            poses=poses,
            corrections=corrections,
            commands=names,
            **given,
            progress=notify,
        )
        written = figure_file(lambda: found.save(file))
    if not as_json:
        return write_tables(
            _table(found), "\n".join([*found.described(), f"Figure: {written or NOT_DRAWN}"])
        )
    content: dict[str, Any] = {
        **provenance_of(model, **settings, poses=poses, corrections=corrections),
        **found.to_dict(),
        "text": found.described(),
        "file": written,
    }
    return write_json(content)


def reach(
    robot: RobotSource = "amouri2019",
    max_tension: Annotated[
        str | None,
        option(
            "T or T1,T2,...",
            "Largest tension of all tendons, or of each.  [default: a quarter turn of its segment "
            "by the linear law]",
        ),
    ] = None,
    poses: Annotated[int, option("N", "Number of poses to draw.")] = 2048,
    payload_direction: Annotated[
        str | None,
        option(
            "x,y,z",
            "Direction of the payload's force, base axes.  [default: that of gravity, else -z]",
        ),
    ] = None,
    tolerance: Annotated[
        str,
        typer.Option(
            help='Displacement that a payload may cause, a share of the length: 0.01 or "1 %".'
        ),
    ] = "1 %",
    gravity: Gravity = None,
    tip_force: TipForce = "0,0,0",
    theory: Theory = "cosserat",
    elements: AutomaticElements = None,
    out: Annotated[
        Path | None,
        option("FILE", "Figure (.png, .pdf, .svg).  [default: NAME-reach.png]"),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """What the robot reaches under tension limits, by physics and by constant curvature.

    With the dexterity, the compliance of the tip, and the largest payload for a displacement
    allowed, over the workspace.
    """
    model, given, settings = _read(
        robot, overrides, max_tension, tolerance, gravity, tip_force, theory, elements
    )
    along = None
    if payload_direction is not None:
        along = vector("--payload-direction", payload_direction, "")

    from bowstring.validity.reach import check_reach_file
    from bowstring.validity.reach import reach as find_reach

    file = of_flag("--out", check_reach_file, out or default_file(model, "reach.png"))
    with progress_bar("poses") as notify:
        found = find_reach(
            model,
            poses=poses,
            payload_direction=along,
            **given,
            progress=notify,
        )
        written = figure_file(lambda: found.save(file))
    if not as_json:
        return write_tables("\n".join([*found.described(), f"Figure: {written or NOT_DRAWN}"]))
    content: dict[str, Any] = {
        **provenance_of(model, **settings, poses=poses),
        **found.to_dict(),
        "text": found.described(),
        "file": written,
    }
    return write_json(content)


def _read(
    robot: str,
    overrides: list[str] | None,
    max_tension: str | None,
    tolerance: str,
    gravity: str | None,
    tip_force: str,
    theory: Literal["cosserat", "kirchhoff"],
    elements: int | None,
) -> tuple[Robot, dict[str, Any], dict[str, Any]]:
    """Robot, arguments that both functions take, and settings for the provenance."""
    tolerated = share_of(
        "--tolerance",
        tolerance,
        "a share of the length above 0 and below 1",
        lambda value: 0 < value < 1,
    )
    model = load(robot, overrides)
    most = None if max_tension is None else _tensions(max_tension, model)
    acting = None if gravity is None else vector("--gravity", gravity, "m/s^2")
    force = vector("--tip-force", tip_force, "N")

    from bowstring._core import RodModel
    from bowstring.statics.load import Load

    given = {
        "max_tension": most,
        "tolerance": tolerated,
        "load": Load(gravity=acting, tip_force=force),
        "model": RodModel(theory, elements=elements),
    }
    return model, given, {"gravity_m_per_s2": acting, "tip_force_N": force}


def _tensions(text: str, robot: Robot) -> float | list[float]:
    if "," in text:
        return per_tendon("--max-tension", text, "N", robot)
    return positive("--max-tension", text, "N")


def _table(found: ControlErrors) -> Table:
    """Mean and largest distance in mm, without and after corrections."""
    from bowstring.validity.control_commands import COMMANDS

    count = max(len(rows) for rows in found.landed.values())
    shown = [k for k in range(1, count) if k <= _COLUMNS or k == count - 1]
    after = [f">after {k}" for k in shown]
    table = new_table("command", ">mean mm", ">largest mm", *after, ">in tolerance %")
    for name in found.landed:
        rows = found.summary(name)
        means = [fixed(1e3 * row["mean_m"], 3) for row in rows]
        table.add_row(
            COMMANDS[name],
            means[0],
            fixed(1e3 * rows[0]["max_m"], 3),
            *(means[k] if k < len(means) else "-" for k in shown),
            fixed(rows[0]["valid_percent"], 0),
        )
    return table
