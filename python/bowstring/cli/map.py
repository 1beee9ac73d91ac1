"""Command map."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import (
    AsJson,
    Models,
    RobotOfStudy,
    Sweep,
    Tolerance,
    Weight,
    default_file,
    named,
)
from bowstring.cli.output import (
    NOT_DRAWN,
    Stopped,
    figure_file,
    progress_bar,
    provenance_of,
    warn,
    write,
    write_json,
)
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import significant

if TYPE_CHECKING:
    from bowstring.cli.schemas import additions as schema
    from bowstring.cli.schemas.basic import OfRobot
    from bowstring.jobs import Job
    from bowstring.validity.multi_axis_maps import ValidityGrid


_MANY: Final = 200_000  # points: minutes


def map_(
    robot: RobotOfStudy,
    tolerance: Tolerance,
    loading: Sweep,
    loads: Weight,
    over: Annotated[
        list[str] | None,
        option(
            "PATH=FROM:TO[:N]",
            "An axis; give it again for more. A number of the robot file (E, pitch_radius, "
            "friction, disks.count), tension, bend=0:90 deg, payload, tilt, tip_force.x or "
            "gravity.z.  [default: tension and number of disks]",
        ),
    ] = None,
    metric: Annotated[
        Literal["largest_error", "mean_error", "error", "valid_to"] | None,
        typer.Option(
            help="What is mapped: an error over the sweep of the tension, the error at the tension "
            "or bend of an axis, or the tension up to which the tolerance holds.  [default: error "
            "with an axis tension or bend, else largest_error]"
        ),
    ] = None,
    models: Models = None,
    out: Annotated[
        Path | None,
        option(
            "FILE",
            "Figure (.png, .pdf, .svg), or numbers with labels and units (.nc; over more than two "
            "axes also .zarr).  [default: NAME OF ROBOT-map.png, with --store .nc]",
        ),
    ] = None,
    store: Annotated[
        Path | None,
        option(
            "DIR",
            "Compute in blocks that are kept in this folder, for large maps; the same command goes "
            "on after a stop.",
        ),
    ] = None,
    dask: Annotated[
        str | None,
        option("ADDRESS", "With --store: scheduler of a Dask cluster that computes the blocks."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Map where constant curvature holds, over numbers of the robot, its load or actuation.

    Every point is a robot along a sweep of tension (of commanded displacements with the axis bend)
    by statics, compared with constant curvature.
    Outside the line at the tolerance, colours tell the effect that makes most of the error.
    """
    from bowstring.validity.map_job import map_job
    from bowstring.validity.map_result import check_map_file
    from bowstring.validity.map_settings import reach_of_ramp, read_axes, space_of
    from bowstring.validity.maps import MOST_SOLVES, validity_map
    from bowstring.validity.sentences import described

    made = provenance_of(
        robot, gravity_m_per_s2=loads.gravity, tip_force_N=loads.tip_force, points=loading.points
    )
    jobs = partial(
        map_job,
        robot,
        tolerance=tolerance,
        metric=metric,
        models=named(models),
        loading=loading,
        load=loads,
    )
    if dask is not None and store is None:
        raise InputError("--dask computes blocks; name their folder by --store.")
    if store is not None:
        if not over:
            raise InputError("--store computes a map over axes; name them by --over.")
        job = of_flag("--over", jobs, over)
        kept = _in_blocks(job, store, out or default_file(robot, "map.nc"), dask)
        if as_json:
            result: schema.StoredMap = {**made, **kept}
            return write_json(result)
        counts = (
            f"{kept['points']} points in {kept['blocks']} blocks. Map: {kept['file'] or NOT_DRAWN}"
        )
        return write("\n".join([*kept["text"], counts]) + "\n")
    if over and len(over) > 2:
        return _many(
            of_flag("--over", jobs, over), out or default_file(robot, "map.png"), made, as_json
        )
    file = of_flag("--out", check_map_file, out or default_file(robot, "map.png"))
    axes = None
    if over:
        axes = of_flag("--over", lambda texts: read_axes(robot, texts, loading, loads), over)
        count = math.prod(len(axis.values) for axis in axes)
        if count > _MANY and count * loading.points <= MOST_SOLVES:
            warn(
                f"{count} points are computed in memory, and a stop loses them; --store DIR keeps "
                "what is done.",
            )
        space = space_of(robot, axes, loading, loads)
        top, reached = reach_of_ramp(space)
        if reached < top:
            warn(
                f"the robot as it is is solved up to about {significant(reached)} N of "
                f"{significant(top)} N, and loads beyond take long; give a smaller range of the "
                "tension.",
            )
    with progress_bar("errors") as notify:
        found = validity_map(
            robot,
            axes,
            tolerance=tolerance,
            metric=metric,
            models=named(models),
            loading=loading,
            load=loads,
            progress=notify,
        )
        written = figure_file(lambda: found.save(file))
    _print(found.to_dict(), described(found), written, made, as_json)


def _many(job: Job, out: Path, made: OfRobot, as_json: bool) -> None:
    """Map over more than two axes in memory."""
    from bowstring.validity.multi_axis_maps import check_grid_file, compute_grid

    file = of_flag("--out", check_grid_file, out)
    with progress_bar("errors") as notify:
        found: ValidityGrid = of_flag("--over", lambda one: compute_grid(one, notify), job)
        notify("figure", 0.95)
        written = figure_file(lambda: found.save(file))
    _print(found.to_dict(), found.described(), written, made, as_json)


def _print(
    found: dict[str, Any], text: list[str], file: str | None, made: OfRobot, as_json: bool
) -> None:
    if as_json:
        return write_json({**made, **found, "text": text, "file": file})
    write("\n".join([*text, f"Map: {file or NOT_DRAWN}"]) + "\n")


def _in_blocks(job: Job, folder: Path, out: Path, dask: str | None) -> schema.StoredValues:
    """Compute a job, or what is missing of it, and write its data set or figure."""
    from bowstring.jobs import RunInterrupted, Unfinished, run
    from bowstring.validity.multi_axis_maps import (
        MOST_DRAWN,
        check_drawn,
        check_grid_file,
        read_grid,
    )

    of_flag("--out", check_grid_file, out)
    drawn = out.suffix.lower() not in (".nc", ".zarr")
    if drawn:
        of_flag("--over", check_drawn, job)
    try:
        with progress_bar("blocks") as notify:
            store = run(job, folder, dask, lambda share: notify("blocks", share))
            text = [f"Over {MOST_DRAWN} points: the data set has the values, and no verdict."]
            if job.points <= MOST_DRAWN:
                notify("causes", 1.0)
                found = read_grid(store)
                text = found.described()
            notify("figure" if drawn else "data set", 1.0)
            written = figure_file(lambda: found.save(out)) if drawn else str(store.save(out))
    except RunInterrupted as stopped:
        raise Stopped(f"{stopped}: run the same command again.") from None
    except Unfinished as stopped:  # not bad input: some blocks were written
        raise NoSolutionError(str(stopped)) from None
    return {
        "points": job.points,
        "blocks": job.blocks,
        "folder": str(store.folder),
        "text": text,
        "file": written,
    }
