"""Figures of a study's report: file names, titles and captions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.study.ramp_response import has_surface, without_surface


@dataclass(frozen=True)
class Figure(Result):
    """Figure of the report."""

    stem: Annotated[str, Key()]
    """Name, of its files too, which are `figures/<stem>.pdf` and so on."""
    title: Annotated[str, Key()]
    """Title in the report."""
    caption: Annotated[str, Key()]
    """Caption in sentences."""


_ON_SURFACE: Final = "Stress and strain are the largest on the surface of the backbone."
WITHOUT_SURFACE: Final = {"fig05_tip_against_force": "Tip and displacement against force"}
"""Titles of figures of a robot without stress and strain at the surface."""

SOLID_FIGURES: Final = (
    Figure(
        "fig01_solid",
        "The robot as a solid",
        "As in Fig. 1 of Amouri (2019): base, backbone, spacer disks and tendons, bent by the "
        "largest load of the sweep; simulated, statics.",
    ),
)
"""Further figure of a study with the solid, which needs the extra ``cad``."""

FIGURES: Final = (
    Figure(
        "fig01_robot",
        "The robot",
        "As in Fig. 1 of Amouri (2019): the rod, and constant curvature (CC) under the same load; "
        "simulated. A still shows the largest load.",
    ),
    Figure(
        "fig02_disk",
        "Spacer disks",
        "As in Fig. 2 of Amouri (2019), in mm. Sizes with a star are assumed.",
    ),
    Figure(
        "fig02_arc",
        "Arc of the segment at the base",
        "As in Fig. 2 of Amouri (2019), to scale at the largest load: the arc in its bending "
        "plane; below, disk and holes seen from the tip. Numbers are tendons, red ones are "
        "actuated.",
    ),
    Figure(
        "fig03_spaces",
        "Spaces and maps",
        "As Fig. 3 of Amouri (2019): the spaces of constant curvature and the maps between them, "
        "with the numbers of this robot at the largest load.",
    ),
    Figure(
        "fig04_module",
        "Geometry of one module",
        "As Fig. 4 of Amouri (2019): two disks, the backbone and the straight spans of the tendons "
        "in the bending plane, drawn to scale with the numbers of this robot at the largest load.",
    ),
    Figure(
        "fig05_tip_against_force",
        "Tip, displacement, stress and strain against force",
        "One tendon is actuated, as in Fig. 5 of Amouri (2019); simulated. Lines: dynamics, while "
        "the tension rises. Markers: statics at the same tension. Crosses: constant curvature from "
        f"force. {_ON_SURFACE}",
    ),
    Figure(
        "fig05_over_time",
        "Tension and tip over time",
        "The same simulated motion over time: the tension rises and is held. Solid: dynamics. "
        "Dashed: statics at the same tension. Below, the distance of the tip between the two.",
    ),
    Figure(
        "displacement_against_force",
        "Tendon displacement against force",
        "Displacement of the actuated tendon by statics and by the linear law that Amouri (2019) "
        "assumes, and the difference of the two.",
    ),
    Figure(
        "fig06_geometric_sweep",
        "Geometric sweep",
        "The study's geometric sweep, as its Fig. 6: tendon lengths and tip by constant curvature "
        "alone while one tendon is shortened and the others follow. Equal lengths coincide.",
    ),
    Figure(
        "fig07_configurations",
        "Configurations",
        "Configurations of the geometric sweep with disks and tendons, as Fig. 7 of Amouri (2019).",
    ),
    Figure(
        "fig10_overlay",
        "Constant curvature over statics",
        "Path of the tip in the bending plane, as Fig. 10 of Amouri (2019): statics, and constant "
        "curvature from lengths and from force at the same loads.",
    ),
    Figure(
        "backbones",
        "Shapes at the largest load",
        "The backbone in the bending plane at the largest load: the rod by statics, and constant "
        "curvature from lengths and from force, markers at the disks. Below, how far each disk by "
        "constant curvature is from the same disk by statics.",
    ),
    Figure(
        "variable_curvature",
        "Constant and variable curvature",
        "Errors of constant curvature (CC), and of curvature that is a polynomial of arc length in "
        "each segment, against statics: at the tip, and the RMS over the disks. Solid: fitted to "
        "the shape by statics, the best that such a model can do. Dotted, where they differ from "
        "the linear law: predicted from tensions, routing and weight. Below, the curvature in the "
        "bending direction at the largest load, with that of the rod between its disks.",
    ),
    Figure(
        "fig11_errors",
        "Errors by axis",
        "Difference of the tip by constant curvature from statics along each axis, as Fig. 11 of "
        "Amouri (2019), with the Euclidean error and the tolerance.",
    ),
    Figure(
        "validity_map",
        "Map of validity",
        "Tip error of constant curvature by a number of the design and the tension.",
    ),
    Figure(
        "load_map",
        "Map of validity under load",
        "Tip error of constant curvature by a load and the tension.",
    ),
    Figure(
        "validity_spread",
        "Validity limit with uncertain numbers",
        "Constant curvature has the numbers of the robot file, the simulated robot those of each "
        "sample. Above: the limits, or the errors at the largest load where most samples hold to "
        "the end of the sweep. Below: how much of their variance each number explains.",
    ),
    Figure(
        "error_budget",
        "Error budget",
        "Mean error of constant curvature with each effect (filled) and without it (hollow), all "
        "else the same: in this sweep, and in the full model. The line between them is the "
        "contribution of the effect; it points to the left where the effect makes the error "
        "smaller. A count at the right, such as 11 of 17, marks means over so many loads only. "
        "Below, actuation: friction and elasticity of the tendons, loading and unloading.",
    ),
    Figure(
        "hysteresis",
        "Loading and unloading",
        "Distance by which the robot's tip is ahead of the tip by constant curvature at the same "
        "command, along the path of the latter; negative: the robot is bent less. Above, tension "
        "control with friction at the holes; below, displacement control with elastic tendons and "
        "friction. Dotted: without friction and elasticity.",
    ),
)

FE_FIGURES: Final = (
    Figure(
        "fe_stress",
        "Stress along the backbone by finite elements",
        "Largest axial stress at the surface at the last load, by 3-D finite elements and by the "
        "rod. What stands out at the disks' edges is their clamps': a rod has no such thing.",
    ),
    Figure(
        "fe_field",
        "Stress on the backbone by finite elements",
        "Axial stress on the surface of the backbone at the last load, by 3-D finite elements; "
        "what the disks clamp is left out.",
    ),
)
"""Further figures of a study with finite elements."""

BRICKS_IN: Final = {
    "fig05_tip_against_force": " Plus signs: 3-D finite elements, at rest; their stress is the "
    "largest along the backbone in the middle of a module.",
    "fig10_overlay": " Plus signs: 3-D finite elements at the same loads.",
    "fig11_errors": " Plus signs: its Euclidean difference from 3-D finite elements.",
}
"""Ends of captions in a study with finite elements."""

ANGLE_FIGURES: Final = (
    Figure(
        "measured_angles",
        "Angle error against load",
        "Angle between the predicted and the measured direction of the tip, without directions the "
        "error of the bend angle, in the first frame of each model; Amouri (2019) has no such "
        "figure.",
    ),
)
"""Figure of a study with measured angles alone."""

DATA_FIGURES: Final = (
    Figure(
        "fig09_measured_tip",
        "Measured tip against load",
        "The tip in the base frame against the load, as Fig. 9 of Amouri (2019), and what the "
        "models say. Full markers and solid lines: loading. Hollow markers and dotted lines: "
        "unloading. All repeats are drawn.",
    ),
    Figure(
        "fig12_measured_errors",
        "Tip error by axis against load",
        "Model minus measurement along each axis, as Fig. 12 of Amouri (2019) has it for constant "
        "curvature, all in the one base frame for all models; repeats averaged. Solid: loading. "
        "Dotted: unloading.",
    ),
    Figure(
        "measured_comparison",
        "Comparison of errors by model",
        "Mean tip error of each model with its bootstrap interval at 95 %; Amouri (2019) has no "
        "such figure. The thin mark is the largest error. Not registered, in the one base frame "
        "for all, and registered to each model alone.",
    ),
    Figure(
        "measured_parts",
        "Parts of the error of constant curvature",
        "Mean tip error of constant curvature as the robot file has it, on rows that were left out "
        "of the fits: what calibration removes, what the physics of the rod removes then, and a "
        "memory; noise, and what no model explains. The parts add up to the dotted line.",
    ),
    Figure(
        "measured_residuals",
        "What the calibrated rod leaves",
        "Calibrated rod minus measurement along each axis, row by row in the order of the table. "
        "Band: two standard deviations of a coordinate, as stated or as the repeats scatter. "
        "Residuals that are noise show no course.",
    ),
)
"""Further figures of a study with measurements."""


def captions_without_surface(robot: Robot) -> dict[str, str]:
    """Captions of figures that lack stress and strain, in part or whole."""
    why = without_surface(robot)
    if not why:
        return {}
    stem = "fig05_tip_against_force"
    whole = next(f.caption for f in FIGURES if f.stem == stem)
    if not has_surface(robot):
        whole = whole.replace(_ON_SURFACE, "")
    return {stem: f"{whole.rstrip()} {why}"}
