"""Commands of robots and statics: robots, schema, fk, solve."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

from bowstring.cli.actuation import (
    Angle,
    Displacement,
    Tension,
    actuated_by,
    check_history_file,
    read_history,
    write_history,
)
from bowstring.cli.options import (
    AsJson,
    AutomaticElements,
    Chord,
    DiskForces,
    DiskMoments,
    FollowerForces,
    Gravity,
    HistoryFile,
    LineForce,
    Overrides,
    PlaneFriction,
    PlaneText,
    PointForces,
    RobotSource,
    Theory,
    at_points,
    check_bare,
    check_elements,
    load,
    of_flag,
    on_disks,
    option,
    per_tendon,
    plane_of,
    tendon_count,
    vector,
)
from bowstring.cli.output import (
    fixed,
    frame,
    new_table,
    provenance_of,
    say,
    tip_line,
    write,
    write_json,
    write_tables,
)
from bowstring.errors import InputError, NoSolutionError

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.constant_curvature import RobotArcs
    from bowstring.robot.model import Robot
    from bowstring.schemas import program
    from bowstring.schemas.statics import Arc, CorrectedPoint, FittedArc, Fk
    from bowstring.statics import limits
    from bowstring.statics.load import Load
    from bowstring.statics.solution import Solution


#: Coordinate over the robot's length above which a number without a unit is hardly in m.
_FAR: Final = 10.0


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
        title = robot.description.partition("\n")[
            0
        ]  # what follows says where its numbers come from
        table.add_row(robot.name, f"{1e3 * robot.length:g}", *map(str, counts), title)
    write_tables(table)


def schema(as_json: AsJson = False) -> None:
    """Print the JSON Schema of a robot file, for editors."""
    from bowstring.robot.reader import robot_schema

    if as_json:
        return write_json(robot_schema())
    write(json.dumps(robot_schema(), indent=2) + "\n")


def fk(
    robot: RobotSource,
    lengths: Annotated[str, option("L1,L2,...", "Tendon lengths, from the base to the end disk.")],
    chord: Chord = False,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Forward kinematics, constant curvature: lengths to arcs and tip."""
    from bowstring.constant_curvature import RobotArcs

    model = load(robot, overrides)
    values = per_tendon("--lengths", lengths, "m", model, above_zero=True)
    check_bare("--lengths", lengths, "m", model, _FAR * model.length, "mm")
    try:
        arcs = RobotArcs.from_lengths(model, values, "chord" if chord else None)
    except InputError as error:
        raise InputError(f"--lengths: {error}") from None
    segments: list[FittedArc] = [
        {**segment, "misfit_m": float(misfit)}
        for segment, misfit in zip(arc_rows(arcs), arcs.misfit, strict=True)
    ]
    result: Fk = {
        "segments": segments,
        "tip": frame(arcs.tip.position, arcs.tip.rotation),
        **provenance_of(model, lengths_m=values, chord=chord),
    }
    if as_json:
        return write_json(result)
    misfits = [segment["misfit_m"] for segment in segments]
    write_tables(arc_table(segments, misfits), tip_line(arcs.tip.position, arcs.tip.rotation))


def solve(
    robot: RobotSource,
    tension: Tension = None,
    displacement: Displacement = None,
    angle: Angle = None,
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
    theory: Theory = "cosserat",
    gravity: Gravity = None,
    tip_force: Annotated[str, option("x,y,z", "Dead load: force at the tip, base axes.")] = "0,0,0",
    tip_moment: Annotated[
        str, option("x,y,z", "Dead load: moment at the tip, base axes.")
    ] = "0,0,0",
    disk_force: DiskForces = None,
    disk_moment: DiskMoments = None,
    point_force: PointForces = None,
    follower_force: FollowerForces = None,
    line_force: LineForce = None,
    plane: PlaneText = None,
    plane_friction: PlaneFriction = None,
    elements: AutomaticElements = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Statics: tendon tensions, displacements and loads to the robot's equilibrium.

    Without tensions, displacements and angles all tendons are slack.
    """
    from bowstring._core import RodModel
    from bowstring.statics import rod
    from bowstring.statics.load import Load

    model = load(robot, overrides)
    wanted = (tension, displacement, angle)
    if wanted == (None, None, None) and history is None and residual is None:
        load_ = Load(tensions=[0.0] * len(model.tendons.segment))
    else:
        load_ = actuated_by(model, *wanted)
    check_elements(elements)
    weight = vector("--gravity", gravity, "m/s^2") if gravity is not None else model.gravity
    force = vector("--tip-force", tip_force, "N")
    moment = vector("--tip-moment", tip_moment, "N*m")
    disk_forces = on_disks("--disk-force", disk_force, "N", model)
    disk_moments = on_disks("--disk-moment", disk_moment, "N*m", model)
    points = at_points(point_force, follower_force, model)
    line = None if line_force is None else vector("--line-force", line_force, "N/m")
    rigid = plane_of("--plane", plane, plane_friction)
    if rigid is not None:
        if history is not None or save_history is not None:
            flag = "--history" if history is not None else "--save-history"
            raise InputError(f"{flag}: a contact is not continued; leave it or --plane out.")
        check_bare(
            "--plane", (plane or "").partition(":")[0], "m", model, _FAR * model.length, "mm"
        )
    before = None if history is None else read_history(history)
    if save_history is not None:
        save_history = of_flag("--save-history", check_history_file, save_history)
    all_loads = load_.replace(
        gravity=weight,
        tip_force=force,
        tip_moment=moment,
        disk_forces=disk_forces,
        disk_moments=disk_moments,
        point_loads=points,
        line_forces=line,
    )
    rod_model = RodModel(theory, elements=elements)
    corrected = None
    if residual is not None:
        loads = (gravity, disk_force, disk_moment, point_force, follower_force, line_force, plane)
        if elements is not None or theory != "cosserat":
            raise InputError(
                "--residual has the rod model of its fit; leave out --elements and --theory."
            )
        if any(force) or any(moment) or any(each is not None for each in (*loads, history)):
            raise InputError(
                "--residual knows tendon commands only; leave out loads, plane and history."
            )
        corrected = of_flag("--residual", lambda file: _corrected(file, model, load_), residual)
    contact = None
    if rigid is None:
        solution = rod.solve(model, load=all_loads, model=rod_model, history=before)
    else:
        from bowstring.statics.contact import solve_contact

        contact = solve_contact(model, load=all_loads, model=rod_model, plane=rigid)
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
                model,
                tensions_N=load_.tensions,
                displacements_m=load_.displacements,
                angles_rad=load_.angles,
                history=history,
                residual=residual,
                theory=theory,
                gravity_m_per_s2=weight,
                tip_force_N=force,
                tip_moment_Nm=moment,
                disk_forces_N=disk_forces,
                disk_moments_Nm=disk_moments,
                point_loads=None if points is None else [each.to_dict() for each in points],
                line_force_N_per_m=line,
                plane_point_m=None if rigid is None else rigid.point,
                plane_normal=None if rigid is None else rigid.normal,
                plane_friction=None if rigid is None else rigid.friction,
                elements=solution.model.elements,
            ),
            "warnings": [*model.warnings, *warnings],
            "backbone_limits": [use.to_dict() for use in uses],
            "contact": None if contact is None else contact.to_dict(),
            "corrected": corrected,
        }
        write_json(content)
    if contact is None:
        solution.raise_for_status()
    for sentence in warnings:
        say("Warning", sentence)
    tip = solution.tip
    assert tip is not None
    if not as_json:
        write_tables(
            f"{model.name}, {theory}: {message} "
            f"({solution.iterations} iterations, residual {solution.residual:.1e})",
            tip_line(tip.position, tip.rotation)
            + ("" if contact is None else f"\n{contact.message}"),
            *([_used_line(uses, model)] if uses else []),
            *([_corrected_line(corrected)] if corrected else []),
            _actuation_table(solution),
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
