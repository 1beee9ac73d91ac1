"""Commands of a test bench: bench check, bench simulate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from bowstring.cli import completion
from bowstring.cli.flags import Number, Numbers, Range, ZeroVector, of_flag, tendon_count
from bowstring.cli.groups import Group, option
from bowstring.cli.options import (
    AsJson,
    Gravity,
    MappingFile,
    OfMasses,
    Overrides,
    RobotArgument,
    Theory,
    changes_of,
    check_bare_changes,
    load,
    mapping_of,
)
from bowstring.cli.output import (
    counted,
    fixed,
    made_by,
    new_table,
    progress_bar,
    provenance_of,
    write_json,
    write_tables,
)
from bowstring.errors import InputError
from bowstring.units import rounded

if TYPE_CHECKING:
    from rich.table import Table

    from bowstring.cli.schemas import bench as schema
    from bowstring.data import synthetic
    from bowstring.data.measurements import Measurements
    from bowstring.data.synthetic import Bench
    from bowstring.data.tendon_check import TendonCheck
    from bowstring.robot.model import Robot

MOST_ISSUES: Final = 20  # issues in the printed table


def check(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", help="Table of measurements: CSV, TSV, .xlsx, .mat or .mcap."
        ),
    ],
    g: OfMasses,
    robot: Annotated[
        str | None,
        option(
            "ROBOT",
            "Robot that was measured; checks the order of its tendons.",
            values=completion.robots,
        ),
    ] = None,
    mapping: MappingFile = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Read a table of measurements; say what it holds and what is wrong."""
    from bowstring.data.measurements import read_measurements
    from bowstring.data.tendon_check import check_tendons

    model = None if robot is None else load(robot, overrides)
    if model is None and overrides:
        raise InputError("--set changes a robot; name it by --robot.")
    with progress_bar("table") as notify:
        found = read_measurements(file, model, mapping_of(mapping), g=g)
        notify("tendons", 0.0)
        check = None if model is None else check_tendons(model, found)
    if as_json:
        settings = {"file": file, "mapping": mapping, "g_m_per_s2": g}
        doubts = [found.doubt] if found.doubt else []
        doubts += [check.sentence] if check is not None and check.alarm else []
        made: dict[str, object] = {"provenance": made_by(**settings), "warnings": doubts}
        if model is not None:
            made = {**provenance_of(model, **settings), "warnings": [*doubts, *model.warnings]}
        return write_json({**_measurements_json(found, check), **made})
    write_tables(*_measurements_tables(found, check))


# Fields of a bench's objects that are not in its settings, or there by another name.
_NOT_SETTINGS: Final = {"changes", "base"}
_NO_PUSH: Final = "0 or more, a tendon cannot push"


def _loads(
    robot: Robot,
    masses: Annotated[
        list[float] | None,
        Range("kg", '0:"500 g":8', "Masses on one tendon; a list M1,M2,... too.", rule=_NO_PUSH),
    ],
    tensions: Annotated[
        list[float] | None,
        Range("N", "0:5:80", "Tensions of that tendon instead.", rule=_NO_PUSH),
    ],
    displacements: Annotated[
        list[float] | None, Range("m", '0:"2 mm":0.03', "Its displacements instead.")
    ],
    g: OfMasses,
    period: Annotated[
        float | None,
        Number(
            "s",
            '"5 s"',
            "Time from row to row, for a column of times; relaxation and creep need it.",
            must_be="positive",
        ),
    ],
    tendon: Annotated[int, option("N", "The tendon; the others have no load.")] = 1,
    repeats: Annotated[int, option("N", "Number of runs through the loads.")] = 1,
    unload: Annotated[
        bool,
        typer.Option("--unload/--no-unload", help="Whether each run returns to the first load."),
    ] = True,
) -> synthetic.Loads:
    """Make the loads of one tendon."""
    import numpy as np

    from bowstring.data.synthetic import Loads

    lists = {"--masses": masses, "--tensions": tensions, "--displacements": displacements}
    given = {flag: values for flag, values in lists.items() if values is not None}
    if not given:
        raise InputError(
            "loads are missing: give for example --masses 0:0.5:8 (kg), --tensions 0:5:80 (N) or "
            '--displacements 0:"2 mm":0.03.'
        )
    if len(given) > 1:
        raise InputError(f"{' and '.join(given)} are the loads; give either.")
    count = tendon_count(robot)
    if not 1 <= tendon <= count:
        raise InputError(f"--tendon: got {tendon}; {robot.name} has {counted(count, 'tendon')}.")
    (values,) = given.values()
    rows: dict[str, Any] = {}
    if tensions is not None or (displacements is not None and count > 1):
        rows["tensions"] = np.zeros((len(values), count))
        rows["tensions"][:, tendon - 1] = np.nan if tensions is None else tensions
    if displacements is not None:
        rows["displacements"] = np.full((len(values), count), np.nan)
        rows["displacements"][:, tendon - 1] = displacements
    return Loads(
        **rows, masses=masses, tendon=tendon, g=g, repeats=repeats, unload=unload, period=period
    )


_Loads = Annotated["synthetic.Loads", Group("Loads", _loads)]


class _Tilt(Numbers):
    form = "ANGLE[,TOWARDS]"

    def read(self, flag: str, text: str, robot: Robot) -> list[float]:
        angles = self.numbers(flag, text)
        if len(angles) > 2:
            raise InputError(f"{flag}: got {len(angles)} numbers; write an angle, and where to.")
        return angles


def _actual(
    robot: Robot,
    gravity: Gravity,
    tip_force: Annotated[
        list[float],
        ZeroVector("N", "0,1,0", "Disturbance: constant force at the tip, base axes."),
    ],
    friction: Annotated[
        float | None,
        Number(
            "",
            "0.1",
            "Actual friction coefficient, in place of the file's.",
            form="mu",
            must_be="0 or more",
        ),
    ],
    actual: Annotated[
        list[str] | None,
        option(
            "PATH=VALUE",
            'Field that differs from ROBOT in fact: segments.0.backbone.E="+5 %". Repeatable.',
        ),
    ] = None,
    gravity_frame: Annotated[
        Literal["base", "measuring"],
        typer.Option(help="Frame of --gravity: it tilts with the base, or stays vertical."),
    ] = "base",
    theory: Theory = "cosserat",
) -> synthetic.Actual:
    from bowstring.data.synthetic import Actual
    from bowstring.robot.model import with_tendons

    if friction is not None:
        of_flag("--friction", lambda value: with_tendons(robot, {"friction": value}), friction)
    changes = changes_of("--actual", actual, 'segments.0.backbone.E="+5 %"')
    check_bare_changes("--actual", robot.with_, changes)
    return Actual(friction, changes, gravity, gravity_frame, tip_force, theory)


def _mounting(
    tilt: Annotated[
        list[float],
        _Tilt(
            "rad",
            '"0.3 deg"',
            "Tilt of the base, and its direction as an angle from x.",
            default="0",
        ),
    ],
    shift: Annotated[
        list[float],
        ZeroVector("m", '"1 mm",0,0', "Position of the base in the measuring frame.", far=50.0),
    ],
    drift: Annotated[
        list[float],
        ZeroVector(
            "m", '0,"0.2 mm",0', "Disturbance: displacement of the base by the last row.", far=5.0
        ),
    ],
) -> synthetic.Mounting:
    from bowstring.data.synthetic import Mounting

    lean, towards = (*tilt, 0.0)[:2]
    return Mounting(tilt=lean, tilt_towards=towards, shift=shift, drift=drift)


def _instrument(
    noise: Annotated[
        float,
        Number(
            "m",
            '"0.02 mm"',
            "Standard deviation of each measured coordinate.",
            default="0.02 mm",
            must_be="0 or more",
            far=1.0,
        ),
    ],
    tool: Annotated[
        list[float],
        ZeroVector(
            "m",
            '0,0,"8 mm"',
            "Measured point relative to the tip, as the table states it.",
            far=5.0,
        ),
    ],
    tool_error: Annotated[
        list[float],
        ZeroVector(
            "m",
            '"1 mm",0,0',
            "Offset of the measured point that the table does not state.",
            far=1.0,
        ),
    ],
) -> synthetic.Instrument:
    from bowstring.data.synthetic import Instrument

    return Instrument(noise, tool, tool_error)


_Actual = Annotated["synthetic.Actual", Group("Actual robot", _actual)]
_Mounting = Annotated["synthetic.Mounting", Group("Mounting", _mounting)]
_Instrument = Annotated["synthetic.Instrument", Group("Instrument", _instrument)]


def simulate(
    robot: RobotArgument,
    out: Annotated[
        Path,
        option(
            "FILE",
            "Table to write, .csv; the true values go to a .truth.json file beside it.",
            values=completion.formats(".csv"),
        ),
    ],
    loads: _Loads,
    actual: _Actual,
    mounting: _Mounting,
    instrument: _Instrument,
    seed: Annotated[int, option("N", "Seed of the noise.")] = 0,
    as_json: AsJson = False,
) -> None:
    """Make synthetic measurements of a robot, with known truth."""
    from bowstring.data import synthetic

    if seed < 0:
        raise InputError(f"--seed: got {seed}; must be 0 or more.")
    of_flag("--out", synthetic.check_table, out)
    with progress_bar("equilibria") as notify:
        try:
            made = synthetic.set_up(
                robot,
                loads,
                actual=actual,
                mounting=mounting,
                instrument=instrument,
                progress=lambda share: notify("equilibria", 0.95 * share),
            )
        except InputError as error:
            if error.argument == "period":
                raise InputError(f"--period: {error}") from None
            raise
        found = made.measure(seed)
        notify("table", 0.95)
        table, truth = synthetic.write(found, out)
    if as_json:
        settings = {"actual": actual.changes, "seed": seed}
        for part in (loads, actual, mounting, instrument):
            settings |= {k: v for k, v in vars(part).items() if k not in _NOT_SETTINGS}
        for name in ("tensions", "displacements", "masses"):
            if settings[name] is None:
                del settings[name]
        content: dict[str, Any] = {
            **_measurements_json(found, None),
            **provenance_of(robot, **settings),
            "hysteresis_m": made.hysteresis,
            "truth": found.truth,
            "files": {"table": str(table), "truth": str(truth)},
        }
        return write_json(content)
    write_tables(
        *_measurements_tables(found, None),
        _truth_table(made),
        f"Synthetic: not measured.\nTable: {out}\nTruth: {synthetic.truth_file(out)}",
    )


def _measurements_json(found: Measurements, check: TendonCheck | None) -> dict[str, Any]:
    import numpy as np

    from bowstring.data.measurements import MeasurementIssue

    tendons: list[schema.TensionRange | schema.DisplacementRange] = [
        {"given_by": "tension", "smallest_N": low, "largest_N": high}
        if kind == "tension"
        else {"given_by": "displacement", "smallest_m": low, "largest_m": high}
        for kind, _, low, high in _commands(found)
    ]
    ranges: schema.TipRange | None = None
    if found.points.shape[1] and found.seen.any():
        tips = found.tip[found.seen]
        ranges = {"smallest": tips.min(axis=0).tolist(), "largest": tips.max(axis=0).tolist()}
    return {
        "name": found.name,
        "source": found.source,
        "rows": len(found),
        "rows_left_out": found.left_out,
        "rows_without_tip": found.without_tip,
        "tendons": tendons,
        "points": found.points.shape[1],
        "points_unit": "px" if found.scale is None else "m",
        "tip": ranges,
        "tool_m": found.tool.tolist(),
        "stations": None if found.stations is None else found.stations.tolist(),
        "angles": found.bend is not None,
        "sigma_m": None if found.sigma is None else float(np.median(found.sigma)),
        "groups": {name: count for name, count in _groups(found).items() if name},
        "repeats": len(np.unique(found.repeat)),
        "recordings": 1 if found.recording is None else len(np.unique(found.recording)),
        "time_s": None
        if found.time is None
        else [float(found.time.min()), float(found.time.max())],
        "issues": [MeasurementIssue(*issue).to_dict() for issue in found.issues],
        "tendon_check": None if check is None else check.to_dict(),
        "sha256": found.sha256,
    }


def _truth_table(made: Bench) -> Table:
    truth = made.truth
    table = new_table("truth", "")
    for item in truth["differences"]:
        said = "" if item["nominal"] is None else f", not {_shown(item['nominal'])}"
        table.add_row(item["path"], f"{_shown(item['actual'])}{said}")
    axes = "base" if truth["gravity_frame"] == "base" else "measuring frame"
    weight = " ".join(f"{v:g}" for v in truth["gravity_m_per_s2"])
    table.add_row("gravity", f"{weight} m/s^2, axes of the {axes}")
    tilt, towards = (math.degrees(truth[name]) for name in ("tilt_rad", "tilt_towards_rad"))
    table.add_row("base", f"tilted by {tilt:.4g} deg towards {towards:.4g} deg")
    for name, values, factor, unit in (
        ("base shifted", truth["base"]["translation_m"], 1e3, "mm"),
        ("measured point", truth["actual_tool_m"], 1e3, "mm from the tip, its axes"),
        ("side force", truth["disturbances"]["tip_force_N"], 1.0, "N"),
        ("drift", truth["disturbances"]["drift_m"], 1e3, "mm up to the end"),
    ):
        if any(values):
            table.add_row(name, f"{' '.join(f'{factor * v:.6g}' for v in values)} {unit}")
    table.add_row("noise", f"{1e3 * made.noise:.4g} mm, standard deviation of each coordinate")
    if made.hysteresis is not None:
        table.add_row("hysteresis", f"{fixed(1e3 * made.hysteresis, 3)} mm at most")
    return table


def _shown(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _groups(found: Measurements) -> dict[str, int]:
    import numpy as np

    labels, counts = np.unique(found.group, return_counts=True)
    return dict(zip(labels.tolist(), counts.tolist(), strict=True))


def _commands(found: Measurements) -> Iterator[tuple[str, str, float, float]]:
    """Yield kind of command, unit and range of each tendon."""
    import numpy as np

    for k in range(found.tendon_count):
        by_displacement = bool(np.isnan(found.tensions[:, k]).all())
        values = (found.displacements if by_displacement else found.tensions)[:, k]
        kind, unit = ("displacement", "m") if by_displacement else ("tension", "N")
        yield kind, unit, float(np.nanmin(values)), float(np.nanmax(values))


def _measurements_tables(found: Measurements, check: TendonCheck | None) -> Iterator[Table | str]:
    import numpy as np

    if found.doubt:
        yield f"Check the table. {found.doubt}"
    left = f", {found.without_tip} without a tip" if found.without_tip else ""
    left += f", {found.left_out} left out" if found.left_out else ""
    yield f"{found.name}: {found.source}, {counted(len(found), 'row')}{left}"
    if found.tendon_count:
        table = new_table("tendon", "given by", ">from", ">to", "")
        for k, (kind, unit, low, high) in enumerate(_commands(found), 1):
            factor, shown = (1e3, "mm") if unit == "m" else (1.0, unit)
            table.add_row(str(k), kind, fixed(factor * low, 3), fixed(factor * high, 3), shown)
        yield table
    lines = []
    if found.points.shape[1] and found.seen.any():
        tips = found.tip[found.seen]
        factor, unit = (1.0, "px") if found.scale is None else (1e3, "mm")
        axes = [
            f"{axis} {fixed(factor * low, 3)} to {fixed(factor * high, 3)}"
            for axis, low, high in zip("xyz", tips.min(axis=0), tips.max(axis=0), strict=True)
        ]
        lines.append(
            f"tip: {', '.join(axes)} {unit}, {counted(found.points.shape[1], 'point')} a row"
        )
    if found.bend is not None:
        low, high = np.degrees([found.bend.min(), found.bend.max()])
        lines.append(f"bend: {fixed(low, 2)} to {fixed(high, 2)} deg")
    if found.sigma is not None:
        lines.append(f"uncertainty: {rounded(1e3 * float(np.median(found.sigma)), 3)} mm")
    groups = [f"{label or '(none)'} {n}" for label, n in _groups(found).items()]
    if groups != [f"(none) {len(found)}"]:
        more = f" and {len(groups) - 8} more" if len(groups) > 8 else ""
        lines.append(f"groups: {', '.join(groups[:8])}{more}")
    if (count := len(np.unique(found.repeat))) > 1:
        lines.append(f"repeats: {count}")
    if found.recording is not None and (count := len(np.unique(found.recording))) > 1:
        lines.append(f"recordings: {count}, each a path of its own")
    if lines:
        yield "\n".join(lines)
    if found.issues:
        table = new_table(">line", "what")
        for line, text in found.issues[:MOST_ISSUES]:
            table.add_row(str(line), text)
        yield table
        if len(found.issues) > MOST_ISSUES:
            yield f"... and {len(found.issues) - MOST_ISSUES} more; --json has them all."
    if check is not None:
        yield ("Check the tendons. " if check.alarm else "") + check.sentence
