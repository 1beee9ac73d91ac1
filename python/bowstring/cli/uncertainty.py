"""Command uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from bowstring.cli.flags import of_flag
from bowstring.cli.groups import option
from bowstring.cli.options import (
    AsJson,
    Figure,
    RobotArgument,
    Sweep,
    Tolerance,
    Weight,
    save_figure,
)
from bowstring.cli.output import NOT_DRAWN, progress_bar, provenance_of, warn, write, write_json


def uncertainty(
    robot: RobotArgument,
    distributions: Annotated[
        Path,
        option("FILE", "Distributions of numbers of the robot (YAML), or a calibration."),
    ],
    tolerance: Tolerance,
    loading: Sweep,
    loads: Weight,
    out: Annotated[Path, Figure("uncertainty.png")],
    model: Annotated[
        Literal["cc_from_lengths", "cc_from_force", "cc_from_lengths_chord", "cc_from_force_arm"],
        typer.Option(help="Model of constant curvature."),
    ] = "cc_from_force",
    samples: Annotated[
        int,
        option("N", "Base points of the design, a power of two; d numbers make N (d + 2) samples."),
    ] = 1024,
    as_json: AsJson = False,
) -> None:
    """Find how far constant curvature holds where numbers of the robot are known only roughly.

    Constant curvature has the numbers of the robot file, the simulated robot those of each sample.
    Without --max-tension the sweep ends at 1.5 times the limit of the robot file's robot.
    """
    from bowstring.uncertainty import SaltelliDesign, read_distributions
    from bowstring.validity.spread import validity_spread

    joint = of_flag("--distributions", lambda file: read_distributions(file, robot), distributions)
    warn(*joint.warnings)
    with progress_bar("samples") as notify:
        found = validity_spread(
            robot,
            SaltelliDesign(joint, samples),
            name=model,
            tolerance=tolerance,
            loading=loading,
            load=loads,
            progress=notify,
        )
        written = save_figure(found.figure, out)
    if as_json:
        content: dict[str, Any] = {
            **provenance_of(robot, distributions=joint.to_dict(), samples=samples),
            **found.to_dict(),
            "warnings": [*robot.warnings, *joint.warnings],
            "file": written,
        }
        return write_json(content)
    write("\n".join([*found.text, f"Figure: {written or NOT_DRAWN}"]) + "\n")
