"""Command ik: inverse kinematics by constant curvature and by physics."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from bowstring.cli.flags import check_bare, of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import (
    AsJson,
    AutomaticElements,
    Chord,
    Gravity,
    Overrides,
    RobotSource,
    Theory,
    load,
    not_negative,
    numbers_of,
    per_tendon,
    vector,
)
from bowstring.cli.output import (
    NOT_DRAWN,
    figure_file,
    fixed,
    frame,
    naming,
    new_table,
    progress_bar,
    provenance_of,
    say,
    tip_line,
    write_json,
    write_tables,
)
from bowstring.cli.statics import arc_rows, arc_table
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import in_mm, plain
from bowstring.units import number_with_unit, quote

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from rich.table import Table

    from bowstring.inverse.solution import InverseSolution
    from bowstring.robot.model import Robot
    from bowstring.schemas.inverse import Ik, IkPath, IkResidual
    from bowstring.statics.load import Load

#: Coordinate over the robot's length above which a number without a unit is hardly in m.
_FAR: Final = 10.0
#: Distance from the base over the robot's length below which a tip is hardly meant.
_NEAR: Final = 0.01
#: Distance between two rows of a path over the length from which it is a jump.
_JUMP: Final = 0.1
#: Change of a tension over the step of the tip, over its median, from which it is a jump,
_JUMP_RATE: Final = 10.0
#: if it is also larger than this share of the largest tension.
_JUMP_SHARE: Final = 0.05
_SUFFIXES: Final = (".png", ".pdf", ".svg")


def ik(
    robot: RobotSource,
    tip: Annotated[str | None, option("x,y,z", "Desired tip position, base axes.", "--tip")] = None,
    direction: Annotated[
        str | None,
        option("x,y,z", "Desired direction of the tangent at the tip, base axes.", "--direction"),
    ] = None,
    path: Annotated[
        Path | None,
        option("FILE", "CSV of tip positions, in place of --tip: tip_x_mm, tip_y_mm, tip_z_mm."),
    ] = None,
    model: Annotated[
        Literal["cc", "physics"],
        typer.Option(help="Constant curvature, or the equilibrium of the rod."),
    ] = "cc",
    min_tension: Annotated[
        str | None,
        option("T or T1,T2,...", "Least tension of all tendons, or of each.  [default: 0 N]"),
    ] = None,
    max_tension: Annotated[
        str | None,
        option(
            "T or T1,T2,...",
            "Largest tension of all tendons, or of each.  [default: half a turn of its segment]",
        ),
    ] = None,
    displacement_limits: Annotated[
        str | None,
        option(
            "LEAST,LARGEST",
            "Physics: least and largest displacement of each tendon, from the home pose.",
        ),
    ] = None,
    distance_margin: Annotated[
        str | None,
        option(
            "SHARE",
            "Physics, point out of reach: how much farther from it than the nearest tip the tip "
            "may be for smaller tensions, over the length; 0: the nearest tip.  [default: 0.1 %]",
        ),
    ] = None,
    free_length: Annotated[
        bool,
        typer.Option("--free-length", help="Let the length of the arc change to meet the point."),
    ] = False,
    chord: Chord = False,
    theory: Theory = "cosserat",
    gravity: Gravity = None,
    tip_force: Annotated[
        str | None, option("x,y,z", "Dead load: force at the tip, base axes.")
    ] = None,
    elements: AutomaticElements = None,
    residual: Annotated[
        Path | None,
        option(
            "FILE",
            "residual.json of fit --residual: positions are those of the measured point, in the "
            "measuring frame, by its model and residual.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        option("FILE", "Table of the commands for --path (.csv).  [default: commands.csv]"),
    ] = None,
    figure: Annotated[
        Path | None,
        option("FILE", "Figure for --path (.png, .pdf, .svg).  [default: beside the table]"),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Inverse kinematics: tip to tensions and tendon displacements.

    By constant curvature the arcs have the segments' own lengths. By physics the tip is that of the
    equilibrium. Where the point is not reached, the nearest tip is given. With --path the figure
    shows where the commands of both models lead by physics.
    """
    robot_ = load(robot, overrides)
    if (tip is None) == (path is None):
        raise InputError("--tip: give either --tip or --path.")
    if residual is not None:
        others = (
            ("--model", model != "cc"),
            ("--theory", theory != "cosserat"),
            ("--gravity", gravity is not None),
            ("--tip-force", tip_force is not None),
            ("--elements", elements is not None),
            ("--displacement-limits", displacement_limits is not None),
            ("--distance-margin", distance_margin is not None),
            ("--direction", direction is not None),
            ("--free-length", free_length),
            ("--chord", chord),
            ("--figure", figure is not None),
        )
        for flag, there in others:
            if there:
                raise InputError(f"{flag}: not with --residual, which has the model of its fit.")
        if out is not None and path is None:
            raise InputError("--out: it is for --path; a single tip is printed.")
        least = _limit("--min-tension", min_tension, robot_)
        limits = 0.0 if least is None else least, _limit("--max-tension", max_tension, robot_)
        return _with_residual(robot_, residual, tip, path, limits, out, as_json)
    if model == "cc":
        given = (
            ("--theory", theory != "cosserat"),
            ("--gravity", gravity is not None),
            ("--tip-force", tip_force is not None),
            ("--elements", elements is not None),
            ("--displacement-limits", displacement_limits is not None),
            ("--distance-margin", distance_margin is not None),
        )
        for flag, there in given:
            if there and path is None:
                raise InputError(
                    f"{flag}: constant curvature does not use it; add --model physics."
                )
    for flag, there in (("--free-length", free_length), ("--chord", chord)):
        if there and (model == "physics" or path is not None):
            raise InputError(f"{flag}: it is for --tip with --model cc.")
    for flag, file in (("--out", out), ("--figure", figure)):
        if file is not None and path is None:
            raise InputError(f"{flag}: it is for --path; a single tip is printed.")
    options = _Options(
        robot_,
        model,
        min_tension,
        max_tension,
        theory,
        elements,
        gravity,
        tip_force,
        displacement_limits,
        distance_margin,
    )
    if path is not None:
        if direction is not None:
            raise InputError("--direction: a path has its directions as columns; leave it out.")
        return _path(options, path, out, figure, as_json)
    assert tip is not None
    point = vector("--tip", tip, "m")
    check_bare("--tip", tip, "m", robot_, _FAR * robot_.length, "mm")
    distance, reach = math.hypot(*point), robot_.length
    _check_near("--tip", robot_, [point])
    if distance > reach and not free_length:
        raise InputError(
            f"--tip: got a point {number_with_unit(distance, 'm')} from the base, out of "
            f"reach: {robot_.name} is {number_with_unit(reach, 'm')} long."
        )
    tangent = None if direction is None else vector("--direction", direction, "1")
    if tangent is not None and not any(tangent):
        raise InputError("--direction: got 0,0,0; a direction must not be zero.")
    if free_length or chord:
        if tangent is not None or min_tension is not None or max_tension is not None:
            raise InputError(
                f"{'--free-length' if free_length else '--chord'}: it gives tendon lengths without "
                "tensions; leave --direction and limits of tensions out."
            )
        return _arc(robot_, point, free_length, chord, as_json)
    found = options.solve(point, tangent)
    if found.status == "no_equilibrium":
        raise NoSolutionError(f"{robot_.name}: {found.message()}", status="no_equilibrium")
    row: Any = found.to_dict()
    segments = None if found.arcs is None else arc_rows(found.arcs)
    if as_json:
        about = provenance_of(robot_, tip_m=point, direction=tangent, **options.settings())
        return write_json({**row, "model": model, "segments": segments, **about})
    if found.stable is False:
        say("Warning", "the equilibrium is unstable.")
    where = f"\nmisses the point by {1e3 * found.distance:.3f} mm"
    if tangent is not None:
        where += f" and the direction by {math.degrees(found.direction_error):.3f} deg"
    write_tables(
        f"{robot_.name}, {_name(model)}: {found.message()}",
        *([] if segments is None else [arc_table(segments)]),
        tip_line(found.tip_position, found.tip_rotation) + where,
        _tendon_table(found),
    )


def _check_near(flag: str, robot: Robot, points: ArrayLike) -> None:
    """Refuse points that are all at the base, as numbers in m are that were read as mm."""
    import numpy as np

    farthest = max(math.hypot(*point) for point in np.asarray(points))  # does not overflow
    if farthest < _NEAR * robot.length:
        columns = "name the columns tip_x_m, tip_y_m and tip_z_m" if flag == "--path" else "write m"
        what = "no point is farther" if flag == "--path" else "the point is no farther"
        raise InputError(
            f"{flag}: {what} than {number_with_unit(farthest, 'm')} from the base, and "
            f"{robot.name} is {number_with_unit(robot.length, 'm')} long; if the numbers are in m, "
            f"{columns}."
        )


def _with_residual(
    robot: Robot,
    file: Path,
    tip: str | None,
    path: Path | None,
    limits: tuple[Any, Any],
    out: Path | None,
    as_json: bool,
) -> None:
    """Commands that bring the measured point, by a model and its residual, to positions."""
    import numpy as np

    from bowstring.calibration import inverse_with_residual, read_residual
    from bowstring.inverse.table import check_commands, read_tips, write_rows

    residual = of_flag("--residual", lambda name: read_residual(name, robot), file)
    table = None
    if path is None:
        assert tip is not None
        positions = np.array([vector("--tip", tip, "m")])
        check_bare("--tip", tip, "m", robot, _FAR * robot.length, "mm")
        _check_near("--tip", robot, positions)
    else:
        tips = of_flag("--path", read_tips, path)
        _check_near("--path", robot, tips.positions)
        if tips.directions is not None:
            raise InputError("--path: a residual is of positions; leave the directions out.")
        positions = tips.positions
        table = of_flag("--out", check_commands, out or Path("commands.csv"))
    with progress_bar("inverse kinematics") as notify:
        found = inverse_with_residual(
            residual,
            positions,
            min_tension=limits[0],
            max_tension=limits[1],
            progress=lambda share: notify("inverse kinematics", share),
        )
    kinds = found.by_displacement
    if table is not None:
        names = [
            f"displacement_{i}_mm" if by else f"tension_{i}_N" for i, by in enumerate(kinds, 1)
        ]
        header = ["tip_x_mm", "tip_y_mm", "tip_z_mm", "status", "distance_mm", "share_kept", *names]
        scale = np.where(kinds, 1e3, 1.0)
        rows = zip(
            (1e3 * found.position).tolist(),
            found.status,
            (1e3 * found.distance).tolist(),
            found.kept.tolist(),
            (scale * found.commands + 0.0).tolist(),
            strict=True,
        )
        cells = [[*at, status, miss, kept, *row] for at, status, miss, kept, row in rows]
        table = write_rows(table, f"{robot.name}, calibrated model with residual", header, cells)
    if as_json:
        result: IkResidual = {
            "count": len(found.status),
            "reached": int(found.reached.sum()),
            "rows": [
                {
                    "position_m": found.position[k].tolist(),
                    "status": status,  # type: ignore[typeddict-item]
                    "tensions_N": plain(np.where(kinds, np.nan, found.commands[k]).tolist()),
                    "displacements_m": plain(np.where(kinds, found.commands[k], np.nan).tolist()),
                    "point_m": plain(found.point[k].tolist()),
                    "distance_m": plain(float(found.distance[k])),
                    "share_kept": plain(float(found.kept[k])),
                    "beyond_data": bool(found.beyond[k]),
                }
                for k, status in enumerate(found.status)
            ],
            "file": None if table is None else str(table),
            **provenance_of(
                robot,
                tip_m=None if path is not None else positions[0].tolist(),
                path=None if path is None else str(path),
                residual=str(file),
                min_tension_N=limits[0],
                max_tension_N=limits[1],
            ),
        }
        return write_json(result)
    if not np.isfinite(found.point).any():
        raise NoSolutionError(f"{robot.name}: no equilibrium at the given positions")
    beyond = int(found.beyond.sum())
    if beyond:
        say(
            "Warning",
            f"{beyond} of {len(found.status)} positions are beyond the data of the residual; the "
            "calibrated model alone answers there.",
        )
    lines = [
        f"{robot.name}, calibrated model with residual: {int(found.reached.sum())} of "
        f"{len(found.status)} reached; the measured point misses its position by "
        f"{fixed(1e3 * float(np.nanmax(found.distance)), 4)} mm at most."
    ]
    if table is not None:
        return write_tables("\n".join([*lines, f"Commands: {table}"]))
    commands = new_table("tendon", ">command")
    for i, (by, value) in enumerate(zip(kinds, found.commands[0], strict=True), 1):
        commands.add_row(str(i), f"{fixed(1e3 * value, 3)} mm" if by else f"{fixed(value, 4)} N")
    write_tables("\n".join(lines), commands)


class _Options:
    """Flags of both forms of the command."""

    def __init__(
        self,
        robot: Robot,
        model: Literal["cc", "physics"],
        *texts: Any,
    ) -> None:
        min_tension, max_tension, theory, elements, gravity, tip_force, travel, margin = texts
        self.robot, self.model, self.theory, self.elements = robot, model, theory, elements
        self.least = _limit("--min-tension", min_tension, robot)
        self.most = _limit("--max-tension", max_tension, robot)
        self.gravity = robot.gravity if gravity is None else vector("--gravity", gravity, "m/s^2")
        self.displacements = _displacements(travel)
        self.margin: float | str = 1e-3 if margin is None else margin
        self.force = [0.0] * 3 if tip_force is None else vector("--tip-force", tip_force, "N")

    @property
    def load(self) -> Load:
        from bowstring.statics.load import Load

        return Load(gravity=self.gravity, tip_force=self.force)

    def solve(
        self, point: Any, tangent: Any, model: Literal["cc", "physics"] | None = None
    ) -> InverseSolution:
        from bowstring._core import RodModel
        from bowstring.inverse.kinematics import inverse_kinematics

        limits: dict[str, Any] = {"min_tension": 0.0 if self.least is None else self.least}
        limits["max_tension"] = self.most
        try:
            if (model or self.model) == "cc":
                return inverse_kinematics(
                    self.robot, point, direction=tangent, model="constant_curvature", **limits
                )
            rod = RodModel(self.theory, elements=self.elements)
            return inverse_kinematics(
                self.robot,
                point,
                direction=tangent,
                load=self.load,
                model=rod,
                displacement_limits=self.displacements,
                distance_margin=self.margin,
                **limits,
            )
        except InputError as error:
            for name in ("min_tension", "displacement_limits", "distance_margin"):
                if name in str(error):
                    raise InputError(f"--{name.replace('_', '-')}: {error}") from None
            raise

    def settings(self) -> dict[str, Any]:
        physics = self.model == "physics"
        return {
            "model": self.model,
            "min_tension_N": self.least,
            "max_tension_N": self.most,
            "displacement_limits_m": self.displacements,
            "distance_margin": self.margin if physics else None,
            "theory": self.theory if physics else None,
            "gravity_m_per_s2": self.gravity if physics else None,
            "tip_force_N": self.force if physics else None,
            "elements": self.elements,
        }


def _limit(flag: str, text: str | None, robot: Robot) -> Any:
    """Read one tension, or one for each tendon."""
    if text is None:
        return None
    if "," in text:
        return per_tendon(flag, text, "N", robot)
    return not_negative(flag, text, "N")


def _displacements(text: str | None) -> list[float] | None:
    """Read the least and the largest displacement."""
    flag = "--displacement-limits"
    if text is None:
        return None
    found = numbers_of(flag, text, "m")
    if len(found) != 2 or found[0] >= found[1]:
        raise InputError(
            f"{flag}: got {quote(text)}; write the least and the largest displacement, such as "
            '"-30 mm,30 mm".'
        )
    return found


def _name(model: str) -> str:
    return "constant curvature" if model == "cc" else "physics"


def _arc(robot: Robot, point: list[float], free_length: bool, chord: bool, as_json: bool) -> None:
    """The arc of one segment with a free length or with chords, without tensions."""
    import numpy as np

    from bowstring.constant_curvature import RobotArcs

    if len(robot.segments) != 1:
        flag = "--free-length" if free_length else "--chord"
        raise InputError(
            f"{flag}: {robot.name} has {len(robot.segments)} segments; this is for robots of one "
            "segment."
        )
    arcs = RobotArcs.ik(robot, np.array(point), "chord" if chord else None, free_length=free_length)
    segments, miss = arc_rows(arcs), float(arcs.misfit[0])
    lengths = arcs.lengths()
    straight = robot.disks.station_m[robot.tendons.end_disk]
    reached = miss <= 1e-6 * robot.length
    if as_json:
        content: Ik = {
            "model": "cc",
            "status": "reached" if reached else "unreachable",
            "message": "The arc meets the point."
            if reached
            else "The arc does not meet the point.",
            "stable": None,
            "iterations": 0,
            "restarted": False,
            "elements": 0,
            "position_m": plain(point),
            "direction": None,
            "distance_m": miss,
            "nearest_distance_m": miss,
            "direction_error_rad": None,
            "segments": segments,
            "tip": frame(arcs.tip.position, arcs.tip.rotation),
            "tensions_N": None,
            "displacements_m": (straight - lengths).tolist(),
            "tendon_lengths_m": lengths.tolist(),
            "binding": [],
            "tip_error_m": None,
            **provenance_of(robot, tip_m=point, free_length=free_length, chord=chord),
        }
        return write_json(content)
    table = new_table("tendon", ">length mm", ">displacement mm")
    for i, length in enumerate(lengths):
        table.add_row(str(i + 1), fixed(1e3 * length, 3), fixed(1e3 * (straight[i] - length), 3))
    write_tables(
        arc_table(segments),
        tip_line(arcs.tip.position, arcs.tip.rotation)
        + f"; misses the point by {1e3 * miss:.3f} mm",
        table,
    )


def _tendon_table(found: InverseSolution) -> Table:
    table = new_table("tendon", ">tension N", ">length mm", ">displacement mm", "binding limit")
    displacements = found.displacements()
    words = {-1: "least tension", 0: "", 1: "largest tension"}
    words |= {-2: "least displacement", 2: "largest displacement"}
    for i, tension in enumerate(found.tensions):
        table.add_row(
            str(i + 1),
            fixed(tension, 4),
            fixed(1e3 * found.tendon_lengths[i], 3),
            "-" if displacements is None else fixed(1e3 * displacements[i], 3),
            words[int(found.binding[i])],
        )
    return table


def _jumps(changes: Any, steps: Any, tensions: Any) -> bool:
    """Whether tensions change much more from a row to the next than the step of the tip explains.

    Least tensions may be of another set of tendons there.
    """
    import numpy as np

    known = np.isfinite(changes) & (steps > 0.0)
    if not known.any():
        return False
    rates = changes[known] / steps[known]
    where = rates > _JUMP_RATE * np.median(rates)
    return bool((changes[known][where] > _JUMP_SHARE * np.nanmax(tensions)).any())


def _path(
    options: _Options, path: Path, out: Path | None, figure: Path | None, as_json: bool
) -> None:
    """Commands for a path, and where they and those of constant curvature lead by physics."""
    import numpy as np

    from bowstring._core import RodModel
    from bowstring.inverse.table import Landing, check_commands, read_tips, write_commands
    from bowstring.viz.inverse import draw_path
    from bowstring.viz.style import check_figure_file, write_figure

    robot = options.robot
    tips = of_flag("--path", read_tips, path)
    _check_near("--path", robot, tips.positions)
    table = of_flag("--out", check_commands, out or Path("commands.csv"))

    def check(name: str | Path) -> Path:
        return check_figure_file(name, "figure", _SUFFIXES)

    drawing = of_flag("--figure", check, figure or table.with_suffix(".png"))
    rod = RodModel(options.theory, elements=options.elements)
    with progress_bar("inverse kinematics") as notify:
        try:
            found = options.solve(tips.positions, tips.directions)
        except InputError as error:
            raise InputError(f"--path: {error}") from None
        notify("constant curvature", 0.4)
        arcs = (
            found if options.model == "cc" else options.solve(tips.positions, tips.directions, "cc")
        )
        notify("landing of constant curvature", 0.6)
        landed = arcs.land(load=options.load, model=rod).tip_position
        notify("figure", 0.8)
        models = {"constant curvature": landed}
        if options.model == "physics":
            models = {"physics": found.tip_position, **models}
        write_commands(found, table, Landing(arcs.tensions, landed))
        with naming({"table": table}):
            drawn = figure_file(
                lambda: write_figure(
                    lambda: draw_path(tips.positions, models), drawing, "figure", 160, check
                )
            )
    steps = np.linalg.norm(np.diff(tips.positions, axis=0), axis=1)
    for row in np.flatnonzero(steps > _JUMP * robot.length)[:1]:
        say(
            "Warning",
            f"--path: row {row + 2} is {in_mm(float(steps[row]))} from the row before it; the "
            "robot jumps there.",
        )
    reached = found.reached
    miss = np.linalg.norm(landed - tips.positions, axis=1)
    good = miss[np.isfinite(miss)]
    jumps = int(np.sum(found.restarted))
    changes = np.abs(np.diff(found.tensions, axis=0)).max(axis=1, initial=0.0)
    largest = float(np.nanmax(changes, initial=0.0))
    if jumps:
        say(
            "Warning",
            f"{jumps} of {len(found)} rows were found from another start than the row before them; "
            "the tensions may jump there.",
        )
    elif _jumps(changes, steps, found.tensions):
        row = int(np.nanargmax(changes)) + 1
        say(
            "Warning",
            f"a tension changes by {number_with_unit(largest, 'N')} from row {row} to row "
            f"{row + 1}, much more than elsewhere: limit the rate of the tensions there, or try "
            "--min-tension.",
        )
    far, nearest = (
        values[np.isfinite(values)]
        for values in (np.asarray(found.distance), np.asarray(found.nearest_distance))
    )
    summary: IkPath = {
        "model": options.model,
        "count": len(found),
        "reached": int(reached.sum()),
        "restarted": jumps,
        "max_tension_change_N": largest,
        "max_distance_m": float(far.max()) if far.size else None,
        "max_nearest_distance_m": float(nearest.max()) if nearest.size else None,
        "constant_curvature_mean_miss_m": float(good.mean()) if good.size else None,
        "constant_curvature_max_miss_m": float(good.max()) if good.size else None,
        "files": [str(table), *([drawn] if drawn else [])],
        **provenance_of(robot, path=str(path), **options.settings()),
    }
    if as_json:
        return write_json(summary)
    name, all_reached = _name(options.model), bool(reached.all())
    others = "" if all_reached or not far.size else f", the others within {in_mm(far.max())}"
    lines = [f"{robot.name}, {name}: {int(reached.sum())} of {len(found)} reached{others}."]
    if good.size:
        lines.append(
            f"Commanded by constant curvature, the tip lands {in_mm(good.mean())} from the path in "
            f"the mean and {in_mm(good.max())} at most."
        )
    if len(found) > 1:
        lines.append(
            "Largest change of a tension from row to row: " + number_with_unit(largest, "N") + "."
        )
    lines.append(f"Commands: {table}\nFigure: {drawn or NOT_DRAWN}")
    write_tables("\n".join(lines))
