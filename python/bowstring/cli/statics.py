"""Commands of robots and statics: robots, schema, fk, solve."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from bowstring.cli import completion
from bowstring.cli.actuation import (
    Actuation,
    at_rest,
    check_history_file,
    no_command,
    read_history,
    write_history,
)
from bowstring.cli.flags import FAR, Number, Numbers, PerTendon, of_flag, tendon_count
from bowstring.cli.groups import Group, option
from bowstring.cli.options import (
    AsJson,
    Chord,
    HistoryFile,
    Loads,
    RobotArgument,
    Rod,
    is_loaded,
    settings_of,
)
from bowstring.cli.output import (
    fixed,
    new_table,
    provenance_of,
    rod_model,
    tip_line,
    warn,
    write,
    write_json,
    write_tables,
)
from bowstring.errors import InputError, NoSolutionError
from bowstring.units import quote

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.cli.schemas import program
    from bowstring.cli.schemas.statics import Arc, CorrectedPoint, FittedArc
    from bowstring.constant_curvature import RobotArcs
    from bowstring.robot.model import Robot
    from bowstring.statics import limits
    from bowstring.statics.load import Load
    from bowstring.statics.plane import Plane
    from bowstring.statics.solution import Solution


def robots(as_json: AsJson = False) -> None:
    """List the built-in robots."""
    from bowstring.robot import reader

    known = [reader.load_robot(name) for name in reader.robot_names()]
    if as_json:
        rows: list[program.BuiltInRobot] = [
            {
                "name": robot.name,
                "description": robot.description,
                "length_m": robot.length,
                "segments": len(robot.segments),
                "disks": len(robot.disks.station_m),
                "tendons": tendon_count(robot),
            }
            for robot in known
        ]
        content: program.Robots = {"robots": rows}
        return write_json(content)
    table = new_table("name", ">length mm", ">segments", ">disks", ">tendons", "description")
    for robot in known:
        counts = (len(robot.segments), len(robot.disks.station_m), tendon_count(robot))
        title, *_ = robot.description.split("\n")  # the rest has the sources of its numbers
        table.add_row(robot.name, f"{1e3 * robot.length:g}", *map(str, counts), title)
    write_tables(table)


def schema(as_json: AsJson = False) -> None:
    """Print the JSON Schema of a robot file, for editors."""
    from bowstring.robot.reader import robot_schema

    if as_json:
        return write_json(robot_schema())
    write(json.dumps(robot_schema(), indent=2) + "\n")


def fk(
    robot: RobotArgument,
    lengths: Annotated[
        list[float] | None,
        PerTendon(
            "m",
            '"641 mm",0.65,0.65',
            "Tendon lengths, from the base to the end disk.",
            form="L1,L2,...",
            must_be="positive",
            far=FAR,
        ),
    ] = None,
    displacement: Annotated[
        list[float] | None,
        PerTendon(
            "m",
            '"10 mm",-0.005,-0.005',
            "Tendon displacements from the robot without load instead, as drives are commanded: "
            "with decoupling those of the tendon's own segment.",
            form="P1,P2,...",
            signed=True,
        ),
    ] = None,
    chord: Chord = False,
    as_json: AsJson = False,
) -> None:
    """Forward kinematics, constant curvature: lengths or displacements to arcs and tip."""
    import numpy as np

    from bowstring.constant_curvature import RobotArcs
    from bowstring.statics.actuation import driven

    if (lengths is None) == (displacement is None):
        raise InputError("fk takes the tendons' lengths or displacements: give one of the two.")
    correction: Literal["chord"] | None = "chord" if chord else None

    def displaced(by: list[float]) -> RobotArcs:
        unloaded = RobotArcs.from_tensions(robot, np.zeros(tendon_count(robot)))
        home = RobotArcs(robot, unloaded.arc, correction).lengths()
        return RobotArcs.from_lengths(robot, home - driven(robot, np.array(by)), correction)

    arcs: RobotArcs = (
        of_flag("--displacement", displaced, displacement)
        if lengths is None
        else of_flag(
            "--lengths", lambda each: RobotArcs.from_lengths(robot, each, correction), lengths
        )
    )
    segments: list[FittedArc] = [
        {**segment, "misfit_m": float(misfit)}
        for segment, misfit in zip(arc_rows(arcs), arcs.misfit, strict=True)
    ]
    result = {
        "segments": segments,
        "tip": arcs.tip.to_dict(),
        **provenance_of(robot, lengths_m=lengths, displacements_m=displacement, chord=chord),
    }
    if as_json:
        return write_json(result)
    misfits = [segment["misfit_m"] for segment in segments]
    write_tables(arc_table(segments, misfits), tip_line(arcs.tip.position, arcs.tip.rotation))


class _PointAndNormal(Numbers):
    """A plane x,y,z:nx,ny,nz."""

    def read(self, flag: str, text: str, robot: Robot) -> tuple[list[float], list[float]]:
        point, colon, normal = text.partition(":")
        if not colon or ":" in normal:
            raise InputError(
                f"{flag}: got {quote(text)}; must be a point and, after a colon, the normal, for "
                f"example {flag} {self.example}."
            )
        values = self.vector(flag, point), Numbers("1", self.example, "").vector(flag, normal)
        self.check_far(flag, point, robot)
        return values


def _plane(
    plane: Annotated[
        tuple[list[float], list[float]] | None,
        _PointAndNormal(
            "m",
            "0.2,0,0:-1,0,0",
            "Rigid plane that the tip may touch: a point and the normal, which points to the "
            "robot, base axes.",
            form="x,y,z:nx,ny,nz",
            far=FAR,
        ),
    ],
    plane_friction: Annotated[
        float | None,
        Number(
            "",
            "0.2",
            "Coefficient of Coulomb friction between tip and plane.  [default: 0]",
            form="MU",
            must_be="0 or more",
            values=completion.words("0.1", "0.2", "0.3"),
        ),
    ],
) -> Plane | None:
    if plane is None and plane_friction is not None:
        raise InputError("--plane-friction: there is no plane; add --plane.")
    if plane is None:
        return None

    from bowstring.statics.plane import Plane

    try:
        return Plane(*plane, plane_friction or 0.0)
    except InputError as error:
        raise InputError(f"--plane: {error}") from None


_Plane = Annotated["Plane | None", Group("Loads", _plane)]


def solve(
    robot: RobotArgument,
    actuation: Actuation,
    loads: Loads,
    plane: _Plane,
    rod: Rod,
    history: HistoryFile = None,
    save_history: Annotated[
        Path | None, option("FILE", "JSON file for the state of the load path, to continue from.")
    ] = None,
    residual: Annotated[
        Path | None,
        option(
            "FILE",
            "residual.json of fit --residual: also predict the measured point, for a first load "
            "without history.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Statics: tendon tensions, displacements and loads to the robot's equilibrium.

    Without tensions, displacements and angles all tendons are slack.
    """
    from bowstring.statics import rod as statics

    if actuation is None and (history is not None or residual is not None):
        raise no_command()
    load = at_rest(robot, actuation, loads)
    if plane is not None and (history is not None or save_history is not None):
        flag = "--history" if history is not None else "--save-history"
        raise InputError(f"{flag}: a contact is not continued; leave it or --plane out.")
    before = None if history is None else read_history(history)
    if save_history is not None:
        save_history = of_flag("--save-history", check_history_file, save_history)
    corrected = None
    if residual is not None:
        if rod.elements is not None or rod.theory != "cosserat":
            raise InputError(
                "--residual has the rod model of its fit; leave out --elements and --theory."
            )
        if is_loaded(loads) or plane is not None or history is not None:
            raise InputError(
                "--residual knows tendon commands only; leave out loads, plane and history."
            )
        corrected = of_flag("--residual", lambda file: _corrected(file, robot, load), residual)
    contact = None
    if plane is None:
        solution = statics.solve(robot, load=load, model=rod, history=before)
    else:
        from bowstring.statics.contact import solve_contact

        contact = solve_contact(robot, load=load, model=rod, plane=plane)
        touching = contact.raise_for_status().solution
        assert touching is not None
        solution = touching
    if save_history is not None and solution.converged:
        write_history(save_history, solution.history())
    warnings, uses = solution.limits()
    stable, message = solution.stable, solution.message
    if contact is not None:
        warnings = (*warnings, *contact.warnings())
        stable = contact.stable
        if stable is None:
            message = "An equilibrium, whose stability on the plane is not determined."
    if as_json:
        content: dict[str, Any] = {
            **solution.to_dict(),
            "stable": stable,
            "message": message,
            **provenance_of(
                robot,
                tensions_N=load.tensions,
                displacements_m=load.displacements,
                angles_rad=load.angles,
                history=history,
                residual=residual,
                **settings_of(load, solution.model),
                plane_point_m=None if plane is None else plane.point,
                plane_normal=None if plane is None else plane.normal,
                plane_friction=None if plane is None else plane.friction,
            ),
            "warnings": [*robot.warnings, *warnings],
            "backbone_limits": [use.to_dict() for use in uses],
            "contact": None if contact is None else contact.to_dict(),
            "corrected": corrected,
        }
        write_json(content)
    if contact is None:
        solution.raise_for_status()
    warn(*warnings)
    tip = solution.tip
    assert tip is not None
    if not as_json:
        write_tables(
            f"{robot.name}, {rod_model(rod.theory)}: {message} "
            f"({solution.iterations} iterations, residual {solution.residual:.1e})",
            tip_line(tip.position, tip.rotation)
            + ("" if contact is None else f"\n{contact.message}"),
            *([_used_line(uses, robot)] if uses else []),
            *([_corrected_line(corrected)] if corrected else []),
            *([_actuation_table(solution)] if len(solution.tensions) else []),
        )


def _corrected(file: Path, robot: Robot, load: Load) -> CorrectedPoint:
    from bowstring.calibration.residual_file import read_residual
    from bowstring.statics.load import Load

    if load.angles is not None:
        raise InputError("a residual is of tensions and displacements; give these, not --angle")
    given = (load.tensions, load.displacements)
    rows = Load(*(None if each is None else [each] for each in given))
    found = read_residual(file, robot).correct(rows)
    if not math.isfinite(found.kept[0]):
        raise NoSolutionError(f"{robot.name}: the calibrated model has no equilibrium here")
    return {
        "point_m": found.point[0].tolist(),
        "model_point_m": found.model_point[0].tolist(),
        "share_kept": float(found.kept[0]),
        "beyond_data": bool(found.beyond[0]),
    }


def _corrected_line(found: CorrectedPoint) -> str:
    x, y, z = (fixed(1e3 * value, 3) for value in found["point_m"])
    beyond = "; beyond the data" if found["beyond_data"] else ""
    return (
        f"measured point, with residual  x {x}  y {y}  z {z} mm (explained share "
        f"{fixed(found['share_kept'], 2)}{beyond})"
    )


def arc_rows(arcs: RobotArcs) -> list[Arc]:
    columns = (arcs.kappa, arcs.phi, arcs.theta, arcs.length)
    return [
        {"kappa_per_m": kappa, "phi_rad": phi, "theta_rad": theta, "length_m": length}
        for kappa, phi, theta, length in zip(*(c.tolist() for c in columns), strict=True)
    ]


def arc_table(segments: Sequence[Arc], misfits: Sequence[float] = ()) -> Table:
    names = ("segment", ">kappa 1/m", ">phi deg", ">theta deg", ">length mm")
    table = new_table(*names, *([">misfit mm"] if misfits else []))
    for i, s in enumerate(segments):
        table.add_row(
            str(i + 1),
            fixed(s["kappa_per_m"], 6),
            fixed(math.degrees(s["phi_rad"]), 3),
            fixed(math.degrees(s["theta_rad"]), 3),
            fixed(1e3 * s["length_m"], 3),
            *[fixed(1e3 * misfit, 3) for misfit in misfits[i : i + 1]],
        )
    return table


def _used_line(uses: Sequence[limits.Utilisation], robot: Robot) -> str:
    several = len(robot.segments) > 1
    return "\n".join(f"backbone{f' of segment {u.segment}' * several}: {u}" for u in uses)


def _actuation_table(solution: Solution) -> Table:
    lengths, slack = solution.tendon_lengths, solution.slack_lengths
    displacements = solution.displacements()
    assert lengths is not None and slack is not None
    by_tension = not solution.core.on_path
    columns = ("tendon", ">tension N", ">length mm", ">displacement mm")
    table = new_table(*columns, *([] if by_tension else [">slack mm"]))
    for i, tension in enumerate(solution.tensions):
        table.add_row(
            str(i + 1),
            f"{tension:g}",
            fixed(1e3 * lengths[i], 3),
            "-" if displacements is None else fixed(1e3 * displacements[i], 3),
            *([] if by_tension else [fixed(1e3 * slack[i], 3)]),
        )
    return table
