"""JSON of the commands fk and solve."""

from __future__ import annotations

from typing import Annotated

from bowstring.cli.schemas.basic import OfRobot, Vector
from bowstring.cli.schemas.results import beside
from bowstring.pose import Pose
from bowstring.results import Object, about
from bowstring.statics.contact_solution import ContactSolution
from bowstring.statics.limits import Utilisation
from bowstring.statics.solution import Solution


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


class CorrectedPoint(Object):
    """Measured point by a calibrated model and its residual, measuring frame."""

    point_m: Annotated[Vector, about("Corrected point.")]
    model_point_m: Annotated[Vector, about("Point of the calibrated model alone.")]
    share_kept: Annotated[
        float,
        about("Share of the variance that the fitted rows explain: near 1 among them, 0 far away."),
    ]
    beyond_data: Annotated[bool, about("Whether that share is below one half.")]


@beside(Solution)
class Solve(OfRobot):
    """Output of `bowstring solve`."""

    corrected: Annotated[
        CorrectedPoint | None, about("Point with the residual; `null` without `--residual`.")
    ]

    message: Annotated[str, about("Status as a sentence, and what to try.")]
    backbone_limits: Annotated[
        list[Utilisation], about("Segments for which the robot file has limits.")
    ]
    contact: Annotated[
        ContactSolution | None,
        about(
            "Contact of the tip; `null` without `--plane`. The other numbers are then those under "
            "the contact force as a dead force."
        ),
    ]
