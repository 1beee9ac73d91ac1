"""Constant curvature: arcs, tendon lengths, poses, tensions; arcs fitted to measured points.

Its extension are backbones with a polynomial curvature (`VariableCurvature`).
"""

from bowstring.constant_curvature.arc import Arc, Routing
from bowstring.constant_curvature.curvature_models import curvature_from_loads, fit_curvature
from bowstring.constant_curvature.robot_arcs import RobotArcs
from bowstring.constant_curvature.shape import ArcFit, Profile, fit_arcs
from bowstring.constant_curvature.variable_curvature import VariableCurvature
from bowstring.pose import Pose

__all__ = [
    "Arc",
    "ArcFit",
    "Pose",
    "Profile",
    "RobotArcs",
    "Routing",
    "VariableCurvature",
    "curvature_from_loads",
    "fit_arcs",
    "fit_curvature",
]
