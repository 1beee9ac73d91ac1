"""Command uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import (
    AsJson,
    Gravity,
    Overrides,
    RobotSource,
    TipForce,
    default_file,
    load,
    number_of,
    share_of,
    shares_of,
    vector,
)
from bowstring.cli.output import (
    NOT_DRAWN,
    figure_file,
    progress_bar,
    provenance_of,
    say,
    write,
    write_json,
)


def uncertainty(
    robot: RobotSource,
    distributions: Annotated[
        Path,
        option("FILE", "Distributions of numbers of the robot (YAML), or a calibration."),
    ],
    model: Annotated[
        Literal["cc_from_lengths", "cc_from_force", "cc_from_lengths_chord", "cc_from_force_arm"],
        typer.Option(help="Model of constant curvature."),
    ] = "cc_from_force",
    tolerance: Annotated[
        str, typer.Option(help='Tolerated tip error, a share of the length: 0.01 or "1 %".')
    ] = "1 %",
    max_tension: Annotated[
        str | None,
        option("T", "End of the sweep.  [default: 1.5 times the limit of the nominal robot]"),
    ] = None,
    points: Annotated[int, option("N", "Number of loads in the sweep.")] = 17,
    samples: Annotated[
        int,
        option("N", "Base points of the design, a power of two; d numbers make N (d + 2) samples."),
    ] = 1024,
    tendon: Annotated[
        str | None,
        option(
            "N[:SHARE],...",
            "The actuated tendon, or several: 1,4:0.5 gives tendon 4 half the tension.  "
            "[default: the first of the outermost segment]",
        ),
    ] = None,
    gravity: Gravity = None,
    tip_force: TipForce = "0,0,0",
    out: Annotated[
        Path | None,
        option("FILE", "Figure (.png, .pdf, .svg).  [default: NAME OF ROBOT-uncertainty.png]"),
    ] = None,
    overrides: Overrides = None,
    as_json: AsJson = False,
) -> None:
    """Find how far constant curvature holds where numbers of the robot are known only roughly.

    Constant curvature has the numbers of the robot file, the simulated robot those of each sample.
    """
    tolerated = share_of(
        "--tolerance",
        tolerance,
        "a share of the length above 0 and below 1",
        lambda value: 0 < value < 1,
    )
    limit = None if max_tension is None else number_of("--max-tension", max_tension, "N")
    acting = None if gravity is None else vector("--gravity", gravity, "m/s^2")
    force = vector("--tip-force", tip_force, "N")
    nominal = load(robot, overrides)
    shares = None if tendon is None else shares_of("--tendon", tendon, nominal)

    from bowstring.statics.load import Load
    from bowstring.uncertainty import read_distributions
    from bowstring.validity.loading import Loading
    from bowstring.validity.spread import validity_spread
    from bowstring.viz.style import check_figure_file, write_figure

    def check(path: str | Path) -> Path:
        return check_figure_file(path, "figure", (".png", ".pdf", ".svg"))

    joint = of_flag(
        "--distributions", lambda file: read_distributions(file, nominal), distributions
    )
    for sentence in joint.warnings:
        say("Warning", sentence)
    file = of_flag("--out", check, out or default_file(nominal, "uncertainty.png"))
    with progress_bar("samples") as notify:
        found = validity_spread(
            nominal,
            joint,
            name=model,
            tolerance=tolerated,
            points=samples,
            loading=Loading(limit, points, shares),
            load=Load(gravity=acting, tip_force=force),
            progress=notify,
        )
        written = figure_file(lambda: write_figure(found.figure, file, "figure", 160, check))
    if as_json:
        content: dict[str, Any] = {
            **provenance_of(nominal, distributions=joint.to_dict(), samples=samples),
            **found.to_dict(),
            "warnings": [*nominal.warnings, *joint.warnings],
            "file": written,
        }
        return write_json(content)
    write("\n".join([*found.text, f"Figure: {written or NOT_DRAWN}"]) + "\n")
