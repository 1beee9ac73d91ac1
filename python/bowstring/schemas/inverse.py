"""JSON of the inverse kinematics of `bowstring ik`."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.schemas.basic import Object, OfRobot, OrNull, Pose, Vector, VectorOrNull, about
from bowstring.schemas.statics import Arc

__all__ = [
    "BindingLimit",
    "ControlDistance",
    "Ik",
    "IkPath",
    "IkResidual",
    "InverseRow",
    "InverseRows",
]

InverseStatus = Literal["reached", "unreachable", "max_iterations", "no_equilibrium"]


class BindingLimit(Object):
    """Limit that keeps the tip from the wanted position."""

    tendon: Annotated[int, about("Tendon, from 1.")]
    limit: Annotated[Literal["least", "largest"], about("Which of its limits.")]
    of: Annotated[Literal["tension", "displacement"], about("Limited quantity.")]


class _Inverse(Object):
    """Keys of all inverses."""

    status: Annotated[
        InverseStatus,
        about(
            "`reached`, or why not: `unreachable`, the tip is the nearest found; `max_iterations`; "
            "`no_equilibrium`."
        ),
    ]
    message: Annotated[str, about("Status as a sentence.")]
    stable: Annotated[
        bool | None,
        about("Whether the equilibrium is stable; `null` by constant curvature."),
    ]
    iterations: Annotated[int, about("Number of iterations of all starts.")]
    restarted: Annotated[
        bool, about("Whether a row of a path was found from another start than the previous row.")
    ]
    elements: Annotated[int, about("Elements between two disks; 0 by constant curvature.")]
    position_m: Annotated[Vector, about("Wanted position of the tip.")]
    direction: Annotated[
        Vector | None, about("Wanted direction of the tangent at the tip; `null` without one.")
    ]
    nearest_distance_m: Annotated[
        OrNull,
        about("Distance from the nearest tip that was found, perhaps with larger tensions."),
    ]
    direction_error_rad: Annotated[
        OrNull, about("Angle between the tangent at the tip and the wanted direction.")
    ]
    displacements_m: Annotated[
        list[OrNull] | None, about("Displacement of each tendon; `null` without a home pose.")
    ]
    binding: Annotated[
        list[BindingLimit], about("Limits that keep the tip from the wanted position.")
    ]
    tip_error_m: Annotated[OrNull, about("Estimated discretisation error of the tip.")]


class InverseRow(_Inverse):
    """Result of `InverseSolution.to_dict` for one position."""

    distance_m: Annotated[OrNull, about("Distance from the tip to the wanted position.")]
    tip: Annotated[Pose | None, about("Tip by the model; `null` without an equilibrium.")]
    tensions_N: Annotated[list[OrNull], about("Tension of each tendon.")]
    tendon_lengths_m: Annotated[list[OrNull], about("Length of each tendon.")]


class InverseRows(Object):
    """Result of `InverseSolution.to_dict` for n positions."""

    count: Annotated[int, about("Number of positions.")]
    reached: Annotated[int, about("Number of those that are reached.")]
    rows: Annotated[list[InverseRow], about("All positions.")]


class Ik(_Inverse, OfRobot):
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


class ControlDistance(Object):
    """Distances of the tip from the wanted tips."""

    mean_m: Annotated[OrNull, about("Mean over the tips that land.")]
    rms_m: Annotated[OrNull, about("Root mean square over them.")]
    max_m: Annotated[OrNull, about("Largest of them.")]
    valid_percent: Annotated[float, about("Share of all wanted tips within the tolerance.")]
    without_equilibrium: Annotated[
        int, about("Commands without a stable equilibrium, which are not in the distances.")
    ]
