"""JSON of the inverse kinematics of `bowstring ik`."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.cli.schemas.basic import OfRobot, Vector, VectorOrNull
from bowstring.cli.schemas.results import beside
from bowstring.cli.schemas.statics import Arc
from bowstring.inverse.solution import InverseRow, InverseStatus
from bowstring.pose import Pose
from bowstring.results import Object, OrNull, about


@beside(InverseRow)
class Ik(OfRobot):
    """Output of `bowstring ik`."""

    model: Annotated[Literal["cc", "physics"], about("Constant curvature or physics.")]
    segments: Annotated[list[Arc] | None, about("Arcs, inner segment first; `null` by physics.")]
    distance_m: Annotated[float, about("Distance between the tip and the point.")]
    tip: Annotated[Pose, about("Tip by the model.")]
    tensions_N: Annotated[
        list[float] | None,
        about("Tension of each tendon; `null` with `--free-length` or `--chord`."),
    ]
    tendon_lengths_m: Annotated[list[float], about("Length of each tendon.")]


class IkPath(OfRobot):
    """Output of `bowstring ik --path`."""

    model: Annotated[
        Literal["cc", "physics"], about("Model of the commands: constant curvature or physics.")
    ]
    count: Annotated[int, about("Number of positions.")]
    reached: Annotated[int, about("Number of positions that the model reaches.")]
    restarted: Annotated[
        int, about("Rows found from another start than the row before, where tensions may jump.")
    ]
    max_tension_change_N: Annotated[
        float, about("Largest change of a tension from one row to the next.")
    ]
    max_distance_m: Annotated[OrNull, about("Largest distance of the model's tip from its row.")]
    max_nearest_distance_m: Annotated[
        OrNull,
        about("Largest distance of the nearest tip that was found, perhaps with larger tensions."),
    ]
    constant_curvature_mean_miss_m: Annotated[
        OrNull,
        about("Mean distance of the tips from the path under the commands of constant curvature."),
    ]
    constant_curvature_max_miss_m: Annotated[OrNull, about("Largest of these distances.")]
    files: Annotated[list[str], about("Table of the commands and figure.")]


class CorrectedCommand(Object):
    """Commands whose measured point, by model and residual, is at a position."""

    position_m: Annotated[Vector, about("Wanted position, measuring frame.")]
    status: Annotated[
        InverseStatus,
        about("Status as for a tip; `reached` within 1e-5 of the length."),
    ]
    tensions_N: Annotated[
        list[OrNull], about("Tension of each tendon; `null` where a displacement is commanded.")
    ]
    displacements_m: Annotated[
        list[OrNull], about("Displacement of each tendon; `null` where a tension is commanded.")
    ]
    point_m: Annotated[VectorOrNull, about("Measured point by model and residual.")]
    distance_m: Annotated[OrNull, about("Distance of the point from the position.")]
    share_kept: Annotated[OrNull, about("Share of the variance that the fitted rows explain.")]
    beyond_data: Annotated[bool, about("Whether that share is below one half: physics answers.")]


class IkResidual(OfRobot):
    """Output of `bowstring ik --residual`."""

    count: Annotated[int, about("Number of positions.")]
    reached: Annotated[int, about("Number of those that are reached.")]
    rows: Annotated[list[CorrectedCommand], about("All positions.")]
    file: Annotated[str | None, about("Table of the commands; `null` without `--path`.")]
