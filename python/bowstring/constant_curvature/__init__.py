"""Constant curvature: arcs, tendon lengths, poses, tensions; arcs fitted to measured points."""

from bowstring.constant_curvature.arc import Arc, Routing
from bowstring.constant_curvature.robot_arcs import RobotArcs
from bowstring.constant_curvature.series import Pose
from bowstring.constant_curvature.shape import ArcFit, Profile, fit_arcs

__all__ = ["Arc", "ArcFit", "Pose", "Profile", "RobotArcs", "Routing", "fit_arcs"]
