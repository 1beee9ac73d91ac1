"""Command branches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bowstring.cli.options import (
    AsJson,
    AutomaticElements,
    DiskForces,
    DiskMoments,
    FollowerForces,
    Gravity,
    LineForce,
    Overrides,
    PointForces,
    RobotSource,
    Theory,
    TipForce,
    at_points,
    check_elements,
    default_file,
    load,
    number_of,
    of_flag,
    on_disks,
    option,
    per_tendon,
    vector,
)
from bowstring.cli.output import (
    NOT_DRAWN,
    figure_file,
    new_table,
    provenance_of,
    write_json,
    write_tables,
)

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.statics.branches import BranchDiagram


def branches(
    robot: RobotSource,
    tension: Annotated[
        str | None, option("T1,T2,...", "Tension of each tendon at load factor 1.  [default: 0]")
    ] = None,
    gravity: Gravity = None,
    tip_force: TipForce = "0,0,0",
    tip_moment: Annotated[
        str, option("x,y,z", "Dead load: moment at the tip, base axes.")
    ] = "0,0,0",
    disk_force: DiskForces = None,
    disk_moment: DiskMoments = None,
    point_force: PointForces = None,
    follower_force: FollowerForces = None,
    line_force: LineForce = None,
    from_tension: Annotated[
        str | None, option("T1,T2,...", "Tension of each tendon at load factor 0.  [default: 0]")
    ] = None,
    from_tip_force: Annotated[
        str, option("x,y,z", "Force at the tip at load factor 0, base axes.")
    ] = "0,0,0",
    from_gravity: Annotated[
        str | None,
        option(
            "x,y,z",
            "Gravity at load factor 0.  [default: as at 1; none if nothing else is loaded]",
        ),
    ] = None,
    max_factor: Annotated[str, option("F", "Largest load factor.")] = "1",
    step: Annotated[str, option("S", "Largest step along a branch, in rad of rotation.")] = "0.05",
    max_branches: Annotated[int, option("N", "Most branches.")] = 40,
    no_deflation: Annotated[
        bool,
        typer.Option("--no-deflation", help="Do not seek equilibria beside the branches found."),
    ] = False,
    theory: Theory = "cosserat",
    elements: AutomaticElements = None,
    out: Annotated[
        Path | None,
        option("FILE", "Figure (.png, .pdf, .svg).  [default: NAME OF ROBOT-branches.png]"),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Branches of equilibria along a load: where the robot buckles or snaps.

    The load factor goes from 0 to 1, between the loads of --from-... and the others. The figure
    shows the tip: stable equilibria solid, unstable dashed.
    """
    from bowstring._core import RodModel
    from bowstring.statics.branches import BranchSearch, branch_diagram
    from bowstring.statics.load import Load
    from bowstring.viz.branches import draw_branches
    from bowstring.viz.style import check_figure_file, write_figure

    model = load(robot, overrides)
    check_elements(elements)

    def tensions(flag: str, text: str | None) -> list[float] | None:
        return None if text is None else per_tendon(flag, text, "N", model)

    def weight(flag: str, text: str | None) -> list[float] | None:
        return None if text is None else vector(flag, text, "m/s^2")

    force, moment = vector("--tip-force", tip_force, "N"), vector("--tip-moment", tip_moment, "N*m")
    end = Load(
        tensions("--tension", tension),
        gravity=weight("--gravity", gravity),
        tip_force=force,
        tip_moment=moment,
        disk_forces=on_disks("--disk-force", disk_force, "N", model),
        disk_moments=on_disks("--disk-moment", disk_moment, "N*m", model),
        point_loads=at_points(point_force, follower_force, model),
        line_forces=None if line_force is None else vector("--line-force", line_force, "N/m"),
    )
    begin_force = vector("--from-tip-force", from_tip_force, "N")
    begin = None
    if from_tension is not None or from_gravity is not None or any(begin_force):
        begin = Load(
            tensions("--from-tension", from_tension),
            gravity=weight("--from-gravity", from_gravity) or end.gravity,
            tip_force=begin_force,
        )
    search = BranchSearch(
        max_factor=number_of("--max-factor", max_factor, "1"),
        step=number_of("--step", step, "rad"),
        max_branches=max_branches,
        deflation=not no_deflation,
    )

    def check(path: str | Path) -> Path:
        return check_figure_file(path, "figure", (".png", ".pdf", ".svg"))

    file = of_flag("--out", check, out or default_file(model, "branches.png"))
    found = branch_diagram(
        model, load=end, start=begin, model=RodModel(theory, elements=elements), search=search
    )
    written = figure_file(
        lambda: write_figure(lambda: draw_branches(found), file, "figure", 160, check)
    )
    if as_json:
        content: dict[str, Any] = {
            **provenance_of(
                model,
                tensions_N=found.load.tensions,
                gravity_m_per_s2=found.load.gravity,
                tip_force_N=force,
                tip_moment_Nm=moment,
                disk_forces_N=end.disk_forces,
                disk_moments_Nm=end.disk_moments,
                point_loads=[each.to_dict() for each in end.point_loads or ()] or None,
                line_force_N_per_m=end.line_forces,
                from_tensions_N=found.start.tensions,
                from_gravity_m_per_s2=found.start.gravity,
                from_tip_force_N=begin_force,
                max_factor=search.max_factor,
                step_rad=search.step,
                max_branches=search.max_branches,
                deflation=search.deflation,
                theory=theory,
                elements=found.model.elements,
            ),
            **found.to_dict(),
            "text": found.text,
            "file": written,
        }
        return write_json(content)
    write_tables(
        "\n".join(found.text),
        *([_event_table(found)] if found.events else []),
        f"Figure: {written or NOT_DRAWN}",
    )


def _event_table(found: BranchDiagram) -> Table:
    table = new_table("branch", "event", ">load factor", ">tip x mm", ">y mm", ">z mm")
    for number, event in found.events:
        tip = 1e3 * found.branches[number].tip_position[event.point]
        words = event.kind.replace("_", " ")
        place = (f"{round(float(x), 3) + 0.0:.3f}" for x in tip)
        table.add_row(str(number + 1), words, f"{event.factor:.6g}", *place)
    return table
