"""Command of finite elements: fe."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bowstring.cli.flags import Number, PerTendon, Range, of_flag
from bowstring.cli.groups import Group, option
from bowstring.cli.options import AsJson, RobotArgument, Weight, out_folder
from bowstring.cli.output import (
    Stopped,
    counted,
    fixed,
    new_table,
    progress_bar,
    provenance_of,
    write_json,
    write_tables,
)
from bowstring.errors import InputError
from bowstring.formatting import in_percent, plain

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.fem.comparison import RodComparison
    from bowstring.fem.convergence import Convergence
    from bowstring.fem.mesh import Fineness
    from bowstring.fem.run import BrickRun, Motion, Settings

_STEPS = 8  # default number of loads of a sweep


def _settings(
    mesh: Annotated[
        str,
        option(
            "M,A,R",
            "Bricks along each module (even), around it (a multiple of 4), and rings across.",
        ),
    ] = "8,8,1",
    stiffness: Annotated[
        float, option("K", "Young's modulus of the disks over that of the backbone.")
    ] = 1000.0,
    grip: Annotated[
        Literal["bonded", "sliding"],
        typer.Option(help="Disks hold the backbone's cross-section, or let it widen and narrow."),
    ] = "bonded",
) -> Settings:
    from bowstring.fem.run import Settings

    settings = Settings(of_flag("--mesh", _fineness, mesh), stiffness, grip)
    of_flag("--stiffness", Settings.check, settings)
    return settings


def _motion(
    rise: Annotated[
        float | None,
        Number(
            "s",
            '"500 ms"',
            "With --dynamic: rise time of the tensions.  [default: 1]",
            must_be="positive",
        ),
    ],
    hold: Annotated[
        float | None,
        Number(
            "s", '"2 s"', "With --dynamic: time after the rise.  [default: 0]", must_be="0 or more"
        ),
    ],
    mass_damping: Annotated[
        float | None,
        Number(
            "1/s",
            "0.5",
            "With --dynamic: mass-proportional damping.  [default: 0]",
            must_be="0 or more",
        ),
    ],
    dynamic: Annotated[
        bool, typer.Option("--dynamic", help="Simulate a motion from rest, not a static sweep.")
    ] = False,
) -> Motion | None:
    for flag, given in (("--rise", rise), ("--hold", hold), ("--mass-damping", mass_damping)):
        if given is not None and not dynamic:
            raise InputError(f"{flag} is for --dynamic; give that too.")
    if not dynamic:
        return None
    from bowstring.fem.run import Motion

    return Motion(rise or 1.0, hold or 0.0, mass_damping=mass_damping or 0.0)


_Settings = Annotated["Settings", Group("Finite elements", _settings)]
_Motion = Annotated["Motion | None", Group("Motion", _motion)]


def fe(
    robot: RobotArgument,
    tension: Annotated[
        list[float],
        PerTendon("N", '"80 N",0,0', "Tendon tensions of the last load.", default=...),
    ],
    loads: Annotated[
        list[float] | None,
        Range(
            "N",
            "10:10:80",
            "Loads to solve, as the largest tension; the others keep their ratio to it.  "
            "[default: 8 equal steps]",
            rule="0 or more",
        ),
    ],
    weight: Weight,
    motion: _Motion,
    settings: _Settings,
    study: Annotated[
        bool,
        typer.Option(
            "--study",
            help="Convergence study: refine the mesh and extrapolate to the limit, with its error; "
            "takes about ten times as long.",
        ),
    ] = False,
    out: Annotated[Path | None, option("DIR", "Folder for fields, figures and numbers.")] = None,
    keep: Annotated[Path | None, option("DIR", "Folder for CalculiX's own files.")] = None,
    as_json: AsJson = False,
) -> None:
    """Independent verification by 3-D finite elements (CalculiX)."""
    import numpy as np

    last = np.array(tension)
    if not last.any():
        raise InputError("--tension: got no tension at all; give one above 0.")
    force, gravity = weight.tip_force, weight.gravity
    if motion is not None and loads is not None:
        raise InputError("--loads is for statics; with --dynamic the tensions rise by --rise.")
    if motion is not None and any(force):
        raise InputError("--tip-force is for statics; it cannot be given with --dynamic.")
    if study and (any(force) or gravity is not None or keep is not None):
        raise InputError("--study is for tensions alone; leave out the other loads and --keep.")

    from bowstring.fem import report
    from bowstring.fem.run import RunInterrupted, check_keep, ramp, sweep
    from bowstring.statics.load import Load

    out = out_folder(out, "fe")
    if keep is not None:
        of_flag("--keep", check_keep, keep)
    rows = _rows(last, loads)
    gravity = list(robot.gravity) if gravity is None else gravity
    load_ = Load(gravity=gravity, tip_force=force if motion is None else None)
    limit: Convergence | None = None
    try:
        with progress_bar("mesh") as notify:
            common: dict[str, Any] = {"settings": settings, "progress": notify}
            if study:
                from bowstring.fem import convergence

                ends = rows if motion is None else last
                limit = convergence.study(robot, ends, motion=motion, **common)
                run = limit.run
            elif motion is not None:
                run = ramp(robot, last, motion, load=load_, keep=keep, **common)
            else:
                run = sweep(robot, rows, load=load_, keep=keep, **common)
    except RunInterrupted as stopped:
        again = "begins anew" if stopped.run.is_motion else "goes on from there"
        raise Stopped(f"{stopped.run.message}; the same command {again}.") from None

    from bowstring.fem.comparison import compare_with_rod

    comparison = compare_with_rod(run)
    content: dict[str, Any] = {
        **_content(run, comparison, limit),
        **provenance_of(run.robot, **run.settings),
        "folder": None,
    }
    if out is not None and run.states:
        with progress_bar("figures") as notify:
            written = {key: value for key, value in content.items() if key != "folder"}
            folder = report.write(run, comparison, plain(written), out, progress=notify)
        content["folder"] = str(folder)
    if as_json:
        write_json(content)
    elif run.states:
        write_tables(*_tables(run, comparison, limit, content["folder"]))
    run.raise_for_status()


def _fineness(mesh: str) -> Fineness:
    from bowstring.fem.mesh import Fineness

    try:
        module, around, rings = (int(part) for part in mesh.split(","))
    except ValueError:
        raise InputError(
            f"got {mesh}; write three whole numbers, bricks along a module, around and rings, "
            "for example 8,8,1"
        ) from None
    fineness = Fineness(module, around, rings)
    fineness.check()
    return fineness


def _rows(last: Any, loads: list[float] | None) -> Any:
    import numpy as np

    top = float(last.max())
    values = np.linspace(0.0, top, _STEPS + 1)[1:] if loads is None else np.array(loads)
    return np.outer(values / top, last)


def _content(run: BrickRun, comparison: RodComparison, limit: Convergence | None) -> dict[str, Any]:
    import numpy as np

    from bowstring.fem.report import rows

    content: dict[str, Any] = {
        "status": run.status,
        "message": run.message,
        "loads": rows(run, comparison),
        "span_error": run.span_error if run.states else None,
        "stress_ratio": comparison.stress_ratio.tolist(),
        "concentration": comparison.concentration.tolist(),
        "nodes": len(run.mesh.nodes),
        "bricks": len(run.mesh.bricks),
        "cached": run.cached,
        "iterations": run.iterations,
        "wall_s": run.wall_s,
        "limit": None,
    }
    if limit is not None:
        content["limit"] = {
            "tip_position_m": limit.limit.tolist(),
            "error_mm": (1e3 * limit.error).tolist(),
            "difference_mm": (1e3 * np.linalg.norm(limit.limit - comparison.tip, axis=1)).tolist(),
            "refinements": [refinement.to_dict() for refinement in limit.refinements],
        }
    return content


def _tables(
    run: BrickRun, comparison: RodComparison, limit: Convergence | None, folder: str | None
) -> Iterator[Table | str]:
    import numpy as np

    mesh = run.mesh
    yield (
        f"{run.robot.name}, finite elements: {run.message}; mesh {run.settings['mesh']}, "
        f"{counted(len(mesh.nodes), 'node')}, {counted(run.cached, 'step')} from the cache"
    )
    table = new_table(
        ">time s" if run.is_motion else ">tension N",
        ">tip x mm",
        ">y mm",
        ">z mm",
        ">from rod mm",
        *([">limit from rod", ">error bar"] if limit is not None else []),
        ">mid stress MPa",
        ">by rod's",
        ">at edges MPa",
    )
    ratio = comparison.stress_ratio
    for i, tip in enumerate(run.tip_position):
        load_ = run.time[i] if run.is_motion else run.tensions[i].max()
        more = []
        if limit is not None:
            more = [
                fixed(1e3 * float(np.linalg.norm(limit.limit[i] - comparison.tip[i])), 2),
                fixed(1e3 * limit.error[i], 2),
            ]
        table.add_row(
            f"{load_:g}",
            *(fixed(1e3 * v, 2) for v in tip),
            _known(1e3 * comparison.difference[i], 2),
            *more,
            fixed(1e-6 * comparison.middle[i].max(), 1),
            _known(ratio[i], 3),
            fixed(1e-6 * comparison.edge[i].max(), 1),
        )
    yield table
    yield f"span forces are the tensions to {in_percent(run.span_error, 1)}"
    if limit is not None:
        yield _refinements(limit)
    if folder is not None:
        yield f"written to {folder}"


def _refinements(limit: Convergence) -> Table:
    import numpy as np

    table = new_table("refined", "of", ">moves the last tip by mm", ">beyond mm", ">order")
    for r in limit.refinements:
        moved = 1e3 * np.linalg.norm(np.diff(r.tips[:, -1], axis=0), axis=1)
        table.add_row(
            r.name,
            ", ".join(r.labels),
            ", ".join(fixed(v, 3) for v in moved),
            fixed(1e3 * float(np.linalg.norm(r.limit[-1] - r.tips[-1, -1])), 3),
            _known(r.order, 1),
        )
    return table


def _known(value: float, digits: int) -> str:
    return fixed(value, digits) if math.isfinite(value) else "-"
