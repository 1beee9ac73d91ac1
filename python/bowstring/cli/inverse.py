"""Command ik: inverse kinematics by constant curvature and by physics."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from bowstring.cli.flags import FAR, Numbers, OneOrEach, Vector, of_flag
from bowstring.cli.groups import Group, option
from bowstring.cli.options import (
    AsJson,
    Chord,
    RobotArgument,
    Rod,
    Weight,
    check_figure,
    save_figure,
)
from bowstring.cli.output import (
    NOT_DRAWN,
    fixed,
    naming,
    new_table,
    progress_bar,
    provenance_of,
    tip_line,
    warn,
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

    from bowstring.aliases import Floats
    from bowstring.cli.schemas.inverse import IkPath, IkResidual
    from bowstring.inverse.solution import InverseSolution
    from bowstring.robot.model import Robot
    from bowstring.statics.load import Load

#: Share of the robot's length within which no tip is meant.
_NEAR: Final = 0.01
#: Share of the length from which the distance of two rows of a path is a jump.
_JUMP: Final = 0.1
#: A tension jumps where its change over the step of the tip is this many times the median,
_JUMP_RATE: Final = 10.0
#: and the change is larger than this share of the largest tension.
_JUMP_SHARE: Final = 0.05


class _Limits(Numbers):
    """Least and largest value, such as "-30 mm,30 mm"."""

    form = "LEAST,LARGEST"

    def read(self, flag: str, text: str, robot: Robot) -> list[float]:
        found = self.numbers(flag, text)
        if len(found) != 2 or found[0] >= found[1]:
            raise InputError(
                f"{flag}: got {quote(text)}; write the least and the largest displacement, such as "
                f"{self.example}."
            )
        return found


class _Direction(Vector):
    def read(self, flag: str, text: str, robot: Robot) -> list[float]:
        value = super().read(flag, text, robot)
        if not any(value):
            raise InputError(f"{flag}: got 0,0,0; a direction must not be zero.")
        return value


@dataclass(frozen=True, kw_only=True)
class _Options:
    """Model and limits."""

    robot: Robot
    model: Annotated[
        Literal["physics", "cc"],
        typer.Option(help="The equilibrium of the rod, or constant curvature."),
    ] = "physics"
    min_tension: Annotated[
        Any,
        OneOrEach(
            "N",
            '"1 N"',
            "Least tension of all tendons, or of each.  [default: 0 N; of what pushes half a turn]",
        ),
    ]
    max_tension: Annotated[
        Any,
        OneOrEach(
            "N",
            '"80 N"',
            "Largest tension of all tendons, or of each.  [default: half a turn of its segment]",
        ),
    ]
    displacement_limits: Annotated[
        list[float] | None,
        _Limits(
            "m",
            '"-30 mm,30 mm"',
            "Physics: least and largest displacement of each tendon, from the home pose.",
        ),
    ]
    distance_margin: Annotated[
        str | None,
        option(
            "SHARE",
            "Physics, point out of reach: how much farther from it than the nearest tip the tip "
            "may be for smaller tensions, over the length; 0: the nearest tip.  [default: 0.1 %]",
        ),
    ] = None
    loads: Weight
    rod: Rod

    def of_physics(self) -> dict[str, bool]:
        """Flags that constant curvature does not use, and whether they are given."""
        return {
            "--theory": self.rod.theory != "cosserat",
            "--gravity": self.loads.gravity is not None,
            "--tip-force": any(self.loads.tip_force),
            "--elements": self.rod.elements is not None,
            "--displacement-limits": self.displacement_limits is not None,
            "--distance-margin": self.distance_margin is not None,
        }

    @property
    def margin(self) -> float | str:
        return 1e-3 if self.distance_margin is None else self.distance_margin

    @property
    def load(self) -> Load:
        if self.loads.gravity is not None:
            return self.loads
        return self.loads.replace(gravity=self.robot.gravity)

    def solve(
        self, point: Any, tangent: Any, model: Literal["cc", "physics"] | None = None
    ) -> InverseSolution:
        from bowstring.inverse.kinematics import inverse_kinematics
        from bowstring.inverse.limits import ActuationLimits

        given: dict[str, Any] = {"model": "constant_curvature"}
        displacements = None
        if (model or self.model) == "physics":
            given = {"load": self.load, "model": self.rod, "distance_margin": self.margin}
            displacements = self.displacement_limits
        limits = ActuationLimits(self.min_tension, self.max_tension, displacements)
        try:
            return inverse_kinematics(self.robot, point, direction=tangent, limits=limits, **given)
        except InputError as error:
            for name in ("min_tension", "displacement_limits", "distance_margin"):
                if name in str(error):
                    raise InputError(f"--{name.replace('_', '-')}: {error}") from None
            raise

    def settings(self) -> dict[str, Any]:
        physics = self.model == "physics"
        return {
            "model": self.model,
            "min_tension_N": self.min_tension,
            "max_tension_N": self.max_tension,
            "displacement_limits_m": self.displacement_limits,
            "distance_margin": self.margin if physics else None,
            "theory": self.rod.theory if physics else None,
            "gravity_m_per_s2": self.load.gravity if physics else None,
            "tip_force_N": self.load.tip_force if physics else None,
            "elements": self.rod.elements,
        }


_Given = Annotated[_Options, Group("Model and limits", _Options)]


def ik(
    robot: RobotArgument,
    tip: Annotated[
        list[float] | None,
        Vector("m", "0.1,0,0.6", "Desired tip position, base axes.", far=FAR),
    ],
    direction: Annotated[
        list[float] | None,
        _Direction("1", "0.5,0,0.9", "Desired direction of the tangent at the tip, base axes."),
    ],
    options: _Given,
    path: Annotated[
        Path | None,
        option("FILE", "CSV of tip positions, in place of --tip: tip_x_mm, tip_y_mm, tip_z_mm."),
    ] = None,
    free_length: Annotated[
        bool,
        typer.Option(
            "--free-length",
            help="With --model cc: let the length of the arc change to meet the point.",
        ),
    ] = False,
    chord: Chord = False,
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
    as_json: AsJson = False,
) -> None:
    """Inverse kinematics: tip to tensions and tendon displacements.

    By constant curvature the arcs have the segments' own lengths. By physics the tip is that of the
    equilibrium. Where the point is not reached, the nearest tip is given. With --path the figure
    shows where the commands of both models lead by physics.
    """
    if (tip is None) == (path is None):
        raise InputError("--tip: give either --tip or --path.")
    if residual is not None:
        others = {
            "--model": options.model != "physics",
            **options.of_physics(),
            "--direction": direction is not None,
            "--free-length": free_length,
            "--chord": chord,
            "--figure": figure is not None,
        }
        for flag, there in others.items():
            if there:
                raise InputError(f"{flag}: not with --residual, which has the model of its fit.")
        if out is not None and path is None:
            raise InputError("--out: it is for --path; a single tip is printed.")
        return _with_residual(options, residual, tip, path, out, as_json)
    for flag, there in options.of_physics().items():
        if there and options.model == "cc" and path is None:
            raise InputError(f"{flag}: constant curvature does not use it; leave --model cc out.")
    for flag, there in (("--free-length", free_length), ("--chord", chord)):
        if there and (options.model == "physics" or path is not None):
            raise InputError(f"{flag}: it is for --tip with --model cc.")
    for flag, file in (("--out", out), ("--figure", figure)):
        if file is not None and path is None:
            raise InputError(f"{flag}: it is for --path; a single tip is printed.")
    if path is not None:
        if direction is not None:
            raise InputError("--direction: a path has its directions as columns; leave it out.")
        return _path(options, path, out, figure, as_json)
    assert tip is not None
    distance, reach = math.hypot(*tip), robot.length
    _check_near("--tip", robot, [tip])
    if distance > reach and not free_length:
        raise InputError(
            f"--tip: got a point {number_with_unit(distance, 'm')} from the base, out of "
            f"reach: {robot.name} is {number_with_unit(reach, 'm')} long."
        )
    if free_length or chord:
        if (direction, options.min_tension, options.max_tension) != (None, None, None):
            raise InputError(
                f"{'--free-length' if free_length else '--chord'}: it gives tendon lengths without "
                "tensions; leave --direction and limits of tensions out."
            )
        return _arc(robot, tip, free_length, chord, as_json)
    found = options.solve(tip, direction)
    if found.status == "no_equilibrium":
        raise NoSolutionError(f"{robot.name}: {found.message()}", status="no_equilibrium")
    _warn_of_tensions(robot, found.tensions)
    row: Any = found.to_dict()
    segments = None if found.arcs is None else arc_rows(found.arcs)
    if as_json:
        about = provenance_of(robot, tip_m=tip, direction=direction, **options.settings())
        return write_json({**row, "model": options.model, "segments": segments, **about})
    if found.stable is False:
        warn("the equilibrium is unstable.")
    where = f"\nmisses the point by {1e3 * found.distance:.3f} mm"
    if direction is not None:
        where += f" and the direction by {math.degrees(found.direction_error):.3f} deg"
    write_tables(
        f"{robot.name}, {_name(options.model)}: {found.message()}",
        *([] if segments is None else [arc_table(segments)]),
        tip_line(found.tip_position, found.tip_rotation) + where,
        _tendon_table(found),
    )


def _warn_of_tensions(robot: Robot, tensions: Floats) -> None:
    """Warn of rods that buckle, and of a backbone stretched far, by tensions (..., T) in N."""
    from bowstring.statics.limits import buckled_or_stretched
    from bowstring.statics.model import RodModel

    warn(*buckled_or_stretched(robot, tensions, RodModel()))


def _check_near(flag: str, robot: Robot, points: ArrayLike) -> None:
    """Refuse points that all lie at the base, as where numbers in m were read as mm."""
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
    options: _Options,
    file: Path,
    tip: list[float] | None,
    path: Path | None,
    out: Path | None,
    as_json: bool,
) -> None:
    """Print commands that bring the measured point to positions, by a model and its residual."""
    import numpy as np

    from bowstring.calibration import inverse_with_residual, read_residual
    from bowstring.inverse.limits import ActuationLimits
    from bowstring.inverse.table import check_commands, read_tips, write_rows

    robot = options.robot
    residual = of_flag("--residual", lambda name: read_residual(name, robot), file)
    table = None
    if path is None:
        assert tip is not None
        positions = np.array([tip])
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
            limits=ActuationLimits(options.min_tension, options.max_tension),
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
                min_tension_N=options.min_tension,
                max_tension_N=options.max_tension,
            ),
        }
        return write_json(result)
    if not np.isfinite(found.point).any():
        raise NoSolutionError(f"{robot.name}: no equilibrium at the given positions")
    beyond = int(found.beyond.sum())
    if beyond:
        warn(
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


def _name(model: str) -> str:
    return "constant curvature" if model == "cc" else "rod model"


def _arc(robot: Robot, point: list[float], free_length: bool, chord: bool, as_json: bool) -> None:
    """Print the arc of one segment with a free length or with chords, without tensions."""
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
        content: dict[str, Any] = {
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
            "tip": arcs.tip.to_dict(),
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
    """Whether tensions change much more between two rows than the step of the tip explains.

    Least tensions may be of another set of tendons there.
    """
    import numpy as np

    known = np.isfinite(changes) & (steps > 0.0)
    if not known.any():
        return False
    rates = changes[known] / steps[known]
    where = rates > _JUMP_RATE * np.median(rates)
    return bool((changes[known][where] > _JUMP_SHARE * np.nanmax(np.abs(tensions))).any())


def _path(
    options: _Options, path: Path, out: Path | None, figure: Path | None, as_json: bool
) -> None:
    """Write commands for a path, and where they and those of constant curvature lead."""
    import numpy as np

    from bowstring.inverse.table import Landing, check_commands, read_tips, write_commands
    from bowstring.viz.inverse import draw_path

    robot = options.robot
    tips = of_flag("--path", read_tips, path)
    _check_near("--path", robot, tips.positions)
    table = of_flag("--out", check_commands, out or Path("commands.csv"))

    drawing = of_flag("--figure", check_figure, figure or table.with_suffix(".png"))
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
        landed = arcs.land(load=options.load, model=options.rod).tip_position
        notify("figure", 0.8)
        models = {"constant curvature": landed}
        if options.model == "physics":
            models = {"physics": found.tip_position, **models}
        write_commands(found, table, Landing(arcs.tensions, landed))
        with naming({"table": table}):
            drawn = save_figure(lambda: draw_path(tips.positions, models), drawing)
    steps = np.linalg.norm(np.diff(tips.positions, axis=0), axis=1)
    for row in np.flatnonzero(steps > _JUMP * robot.length)[:1]:
        warn(
            f"--path: row {row + 2} is {in_mm(float(steps[row]))} from the row before it; the "
            "robot jumps there.",
        )
    _warn_of_tensions(robot, found.tensions)
    reached = found.reached
    miss = np.linalg.norm(landed - tips.positions, axis=1)
    good = miss[np.isfinite(miss)]
    jumps = int(np.sum(found.restarted))
    changes = np.abs(np.diff(found.tensions, axis=0)).max(axis=1, initial=0.0)
    largest = float(np.nanmax(changes, initial=0.0))
    if jumps:
        warn(
            f"{jumps} of {len(found)} rows were found from another start than the row before them; "
            "the tensions may jump there.",
        )
    elif _jumps(changes, steps, found.tensions):
        row = int(np.nanargmax(changes)) + 1
        warn(
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
