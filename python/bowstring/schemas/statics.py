"""JSON of the commands fk and solve."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.schemas.basic import Object, OfRobot, OrNull, Pose, Vector, about
from bowstring.statics.contact_solution import ContactSolution
from bowstring.statics.limits import Use
from bowstring.statics.messages import StaticsStatus
from bowstring.statics.solution import ErrorEstimate

__all__ = [
    "Arc",
    "Equilibrium",
    "Fk",
    "Pose",
    "Solve",
]


class Arc(Object):
    """Arc of a segment by constant curvature."""

    kappa_per_m: Annotated[float, about("Curvature.")]
    phi_rad: Annotated[float, about("Angle of the bending plane from x, counter-clockwise.")]
    theta_rad: Annotated[float, about("Bend angle.")]
    length_m: Annotated[float, about("Arc length.")]


class FittedArc(Arc):
    """Arc of a segment from tendon lengths."""

    misfit_m: Annotated[
        float, about("Root mean square of the part of redundant lengths that no arc has.")
    ]


class Fk(OfRobot):
    """Output of `bowstring fk`."""

    segments: Annotated[list[FittedArc], about("Arcs, inner segment first.")]
    tip: Annotated[Pose, about("Tip.")]


class Equilibrium(Object):
    """Result of `Solution.to_dict`."""

    status: Annotated[
        StaticsStatus,
        about(
            "`converged`, or the reason for no solution: `max_iterations`; `unstable`, only "
            "unstable equilibria were found; `no_equilibrium`."
        ),
    ]
    stable: Annotated[
        bool | None, about("Whether the equilibrium is stable ([details](cli.md#solve)).")
    ]
    iterations: Annotated[int, about("Number of Newton iterations.")]
    residual: Annotated[
        OrNull, about("Largest moment imbalance over (bending stiffness / length).")
    ]
    error_estimate: Annotated[
        ErrorEstimate | None, about("Estimated error; `null` without a solution.")
    ]
    elements: Annotated[int | None, about("Elements between two disks.")]
    theory: Annotated[Literal["cosserat", "kirchhoff"], about("Theory of the backbone.")]
    tip: Annotated[Pose | None, about("Tip; `null` without a solution.")]
    disks: Annotated[
        list[Pose] | None,
        about("All disks from base to tip, without the base; `null` without a solution."),
    ]
    tendon_lengths_m: Annotated[list[float] | None, about("Length of each tendon.")]
    tensions_N: Annotated[list[OrNull], about("Tension of each tendon before the base hole.")]
    displacements_m: Annotated[list[float] | None, about("Displacement of each tendon.")]
    slack: Annotated[list[int] | None, about("Slack tendons, from 1.")]
    slack_m: Annotated[list[float] | None, about("Slack length of each tendon.")]
    span_tensions_N: Annotated[
        list[list[OrNull]] | None,
        about("Tensions by span from base to tip; `null` beyond the end of a tendon."),
    ]
    undetermined: Annotated[
        bool,
        about("Whether the displacements leave the tensions undetermined; the smallest are given."),
    ]
    length_residual_m: Annotated[OrNull, about("Largest deviation from a prescribed displacement.")]


class CorrectedPoint(Object):
    """Measured point by a calibrated model and its residual, measuring frame."""

    point_m: Annotated[Vector, about("Corrected point.")]
    model_point_m: Annotated[Vector, about("Point of the calibrated model alone.")]
    share_kept: Annotated[
        float,
        about("Share of the variance that the fitted rows explain: near 1 among them, 0 far away."),
    ]
    beyond_data: Annotated[bool, about("Whether that share is below one half.")]


class Solve(Equilibrium, OfRobot):
    """Output of `bowstring solve`."""

    corrected: Annotated[
        CorrectedPoint | None, about("Point with the residual; `null` without `--residual`.")
    ]

    message: Annotated[str, about("Status as a sentence, and what to try.")]
    backbone_limits: Annotated[list[Use], about("Segments for which the robot file has limits.")]
    contact: Annotated[
        ContactSolution | None,
        about(
            "Contact of the tip; `null` without `--plane`. The other numbers are then those under "
            "the contact force as a dead force."
        ),
    ]
