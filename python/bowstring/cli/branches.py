"""Command branches."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bowstring.cli.flags import Number, PerTendon, Vector, ZeroVector
from bowstring.cli.groups import Group, option
from bowstring.cli.options import (
    AsJson,
    Figure,
    Loads,
    RobotArgument,
    Rod,
    save_figure,
    settings_of,
)
from bowstring.cli.output import NOT_DRAWN, new_table, provenance_of, write_json, write_tables

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.statics.branches import BranchDiagram, BranchSearch
    from bowstring.statics.load import Load


_Tensions = Annotated[
    list[float] | None,
    PerTendon("N", '"80 N",0,0', "Tension of each tendon at load factor 1.  [default: 0]"),
]


def _start(
    loads: Load,
    from_tension: Annotated[
        list[float] | None,
        PerTendon("N", '"40 N",0,0', "Tension of each tendon at load factor 0.  [default: 0]"),
    ],
    from_tip_force: Annotated[
        list[float],
        ZeroVector("N", "0,0,-4", "Force at the tip at load factor 0, base axes."),
    ],
    from_gravity: Annotated[
        list[float] | None,
        Vector(
            "m/s^2",
            "0,0,-9.81",
            "Gravity at load factor 0.  [default: as at 1; none if nothing else is loaded]",
        ),
    ],
) -> Load | None:
    """Make the load at load factor 0, where it is not zero."""
    from bowstring.statics.load import Load

    if from_tension is None and from_gravity is None and not any(from_tip_force):
        return None
    return Load(from_tension, gravity=from_gravity or loads.gravity, tip_force=from_tip_force)


def _search(
    max_factor: Annotated[float, Number("1", "2", "Largest load factor.", form="F", default="1")],
    step: Annotated[
        float,
        Number(
            "rad",
            "0.05",
            "Largest step along a branch, in rad of rotation.",
            form="S",
            default="0.05",
        ),
    ],
    max_branches: Annotated[int, option("N", "Most branches.")] = 40,
    no_deflation: Annotated[
        bool,
        typer.Option("--no-deflation", help="Do not seek equilibria beside the branches found."),
    ] = False,
) -> BranchSearch:
    from bowstring.statics.branches import BranchSearch

    return BranchSearch(
        max_factor=max_factor, step=step, max_branches=max_branches, deflation=not no_deflation
    )


_Start = Annotated["Load | None", Group("Loads", _start)]
_Search = Annotated["BranchSearch", Group("Search", _search)]


def branches(
    robot: RobotArgument,
    tension: _Tensions,
    loads: Loads,
    start: _Start,
    search: _Search,
    rod: Rod,
    out: Annotated[Path, Figure("branches.png")],
    as_json: AsJson = False,
) -> None:
    """Branches of equilibria along a load: where the robot buckles or snaps.

    The load factor goes from 0 to 1, between the loads of --from-... and the others. The figure
    shows the tip: stable equilibria solid, unstable dashed.
    """
    from bowstring.statics.branches import branch_diagram
    from bowstring.viz.branches import draw_branches

    found = branch_diagram(
        robot, load=loads.replace(tensions=tension), start=start, model=rod, search=search
    )
    written = save_figure(lambda: draw_branches(found), out)
    if as_json:
        content: dict[str, Any] = {
            **provenance_of(
                robot,
                tensions_N=found.load.tensions,
                **settings_of(loads.replace(gravity=found.load.gravity), found.model),
                from_tensions_N=found.start.tensions,
                from_gravity_m_per_s2=found.start.gravity,
                from_tip_force_N=[0.0] * 3 if start is None else start.tip_force,
                max_factor=search.max_factor,
                step_rad=search.step,
                max_branches=search.max_branches,
                deflation=search.deflation,
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
