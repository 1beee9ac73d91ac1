"""JSON of the inverse kinematics of `bowstring ik`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from bowstring.schemas.basic import Object, OfRobot, OrNull, Pose, Vector, VectorOrNull, about
from bowstring.schemas.statics import Arc

__all__ = [
    "BindingLimit",
    "Control",
    "ControlValues",
    "Ik",
    "IkPath",
    "IkResidual",
    "InverseRow",
    "InverseRows",
    "ReachFound",
    "ReachValues",
]

InverseStatus = Literal["reached", "unreachable", "max_iterations", "no_equilibrium"]


class BindingLimit(Object):
    """Limit that keeps the tip from the wanted position."""

    tendon: Annotated[int, about("Tendon, from 1.")]
    limit: Annotated[Literal["least", "largest"], about("Which of its limits.")]
    of: Annotated[Literal["tension", "displacement"], about("What is limited.")]


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
    reached: Annotated[int, about("Number of those that the model reaches.")]
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
        about("Mean distance from the path at which the commands of constant curvature land."),
    ]
    constant_curvature_max_miss_m: Annotated[OrNull, about("Largest such distance.")]
    files: Annotated[list[str], about("Table of the commands and figure.")]


class CorrectedCommand(Object):
    """Commands whose measured point, by model and residual, is at a position."""

    position_m: Annotated[Vector, about("Wanted position, measuring frame.")]
    status: Annotated[
        InverseStatus,
        about("As for a tip; `reached` within 1e-5 of the length."),
    ]
    tensions_N: Annotated[
        list[OrNull], about("Tension of each tendon; `null` where a displacement is commanded.")
    ]
    displacements_m: Annotated[
        list[OrNull], about("Displacement of each tendon; `null` where a tension is commanded.")
    ]
    point_m: Annotated[VectorOrNull, about("Measured point by model and residual.")]
    distance_m: Annotated[OrNull, about("Its distance from the position.")]
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


class ControlCommand(Object):
    """Where one command leads."""

    name: Annotated[
        Literal[
            "tensions",
            "tensions_arm",
            "tensions_calibrated",
            "displacements",
            "displacements_chord",
            "physics",
        ],
        about("Command of constant curvature, or `physics`: the exact inverse."),
    ]
    after_corrections: Annotated[
        list[ControlDistance], about("Without a correction, after one, and so on.")
    ]
    distance_m: Annotated[
        list[list[OrNull]],
        about("The same for each wanted tip; `null` without a stable equilibrium."),
    ]


class ControlByLoad(Object):
    """Distances at shares of the dead loads, without corrections."""

    name: Annotated[str, about("Command.")]
    mean_m: Annotated[list[OrNull], about("Mean distance at each share.")]
    max_m: Annotated[list[OrNull], about("Largest distance at each share.")]


class ControlSeconds(Object):
    """Time for one command in this run."""

    constant_curvature: Annotated[float, about("Tensions by constant curvature, in s.")]
    physics: Annotated[
        OrNull, about("Exact inverse on all cores, in s; `null` where it is not available.")
    ]


class ControlValues(Object):
    """Distances between wanted tips and where commands lead."""

    tolerance_percent: Annotated[float, about("Tolerated distance in percent of the length.")]
    max_tension_N: Annotated[list[float], about("Largest tension of each tendon.")]
    poses: Annotated[int, about("Number of poses drawn.")]
    without_equilibrium: Annotated[
        int, about("Number of those without a stable equilibrium, which are not wanted.")
    ]
    wanted_m: Annotated[list[Vector], about("Wanted tips.")]
    stiffness_scale: Annotated[
        float | None,
        about("Factor on the bending stiffness of `tensions_calibrated`; `null` without it."),
    ]
    seconds_per_command: Annotated[ControlSeconds, about("Time for one command in this run.")]
    commands: Annotated[list[ControlCommand], about("All commands.")]
    load_shares: Annotated[list[float], about("Shares of the dead loads of `by_load`.")]
    by_load: Annotated[list[ControlByLoad], about("Distances by load; empty without dead loads.")]


class Control(OfRobot, ControlValues):
    """Output of `bowstring control`."""

    text: Annotated[list[str], about("What the result says, in sentences.")]
    file: Annotated[str | None, about("File of the figure; `null` if it could not be drawn.")]


class ReachValues(Object):
    """Tips under tension limits, and how the robot moves, yields and carries there.

    Numbers of a pose are `null` without a stable equilibrium.
    """

    max_tension_N: Annotated[list[float], about("Largest tension of each tendon.")]
    tensions_N: Annotated[list[list[float]], about("Tensions of all tendons at each pose.")]
    tip_position_m: Annotated[list[VectorOrNull], about("Tip by physics.")]
    constant_curvature_tip_m: Annotated[
        list[Vector], about("Tip by the linear law of constant curvature, without loads.")
    ]
    manipulability: Annotated[
        list[OrNull],
        about(
            "Product of the singular values of the tip's derivative by all tensions over their "
            "largest ones: m^2 for one segment, m^3 for more."
        ),
    ]
    dexterity: Annotated[list[OrNull], about("Least over largest of these singular values.")]
    compliance_m_per_N: Annotated[
        list[Annotated[list[VectorOrNull], Field(min_length=3, max_length=3)]],
        about("Displacement of the tip by a force on it at fixed tensions."),
    ]
    payload_direction: Annotated[Vector, about("Direction of the payload's force.")]
    tolerance_percent: Annotated[
        float, about("Displacement that a payload may cause, in percent of the length.")
    ]
    payload_N: Annotated[
        list[OrNull],
        about(
            "Largest force in that direction within this displacement; `null` also where ten times "
            "the force by the compliance moves the tip less."
        ),
    ]


class ReachFound(OfRobot, ReachValues):
    """Output of `bowstring reach`."""

    text: Annotated[list[str], about("What the result says, in sentences.")]
    file: Annotated[str | None, about("File of the figure; `null` if it could not be drawn.")]
