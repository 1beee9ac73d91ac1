"""JSON of solids that export writes, and of the command fe."""

from __future__ import annotations

from typing import Annotated, Literal

from typing_extensions import NotRequired

from bowstring.cli.schemas.basic import InFolder, OfRobot, Vector
from bowstring.fem.convergence import Refinement
from bowstring.fem.run import FeStatus
from bowstring.pose import Pose
from bowstring.results import Object, OrNull, about
from bowstring.robot.sizes import Assumed


class Part(Object):
    """A body of the solid."""

    name: Annotated[
        str, about("`base`, `backbone` (`backbone_2` of segment 2), `disk_1`, `tendon_1`, ...")
    ]
    kind: Annotated[str, about("`base`, `backbone`, `disk` or `tendon`.")]
    colour: Annotated[str, about("Colour, `#rrggbb`.")]
    volume_m3: Annotated[float, about("Volume.")]
    centre_m: Annotated[Vector, about("Centre of volume.")]
    mass_kg: Annotated[OrNull, about("Mass; `null` for parts without mass in the model.")]


class SolidFiles(Object):
    """Files of a solid."""

    solid: NotRequired[Annotated[str, about("CAD file, with `--out`.")]]
    picture: NotRequired[Annotated[str, about("Picture, with `--picture`.")]]
    drawing: NotRequired[Annotated[str, about("Drawing, with `--drawing`.")]]


class SolidPose(Object):
    """Pose of a solid."""

    tip: Annotated[Pose | None, about("Tip; `null` if the robot is straight.")]
    disks: Annotated[
        list[Pose] | None, about("Disks from base to tip; `null` if the robot is straight.")
    ]


class Cad(SolidPose, OfRobot):
    """Output of `bowstring export` for a solid, a picture or a drawing."""

    pose: Annotated[
        Literal["straight", "unloaded", "simulated"],
        about(
            "Without actuation `straight`, or `unloaded` if the backbone is curved or twisted "
            "without load; with actuation `simulated`: in equilibrium."
        ),
    ]
    parts: Annotated[list[Part] | None, about("Bodies; `null` if only a drawing was asked for.")]
    assumed: Annotated[list[Assumed], about("Sizes that the robot file does not give.")]
    files: Annotated[SolidFiles, about("Files that were written.")]


class FeLoad(Object):
    """Result of finite elements at a load or time."""

    t_s: NotRequired[Annotated[float, about("Time, with `--dynamic`.")]]
    tensions_N: Annotated[list[float], about("Tension of each tendon.")]
    tip: Annotated[Pose, about("Tip by finite elements.")]
    rod_tip_position_m: Annotated[
        Vector | None, about("Position of the tip by the rod; `null` without an equilibrium.")
    ]
    difference_mm: Annotated[OrNull, about("Distance between the two tips.")]
    span_tensions_N: Annotated[
        list[list[OrNull]],
        about("Force in each span, by module and tendon; `null` beyond the end of a tendon."),
    ]
    middle_stress_Pa: Annotated[
        list[float],
        about("Largest axial stress at the surface in the middle of each module."),
    ]
    rod_middle_stress_Pa: Annotated[list[float] | None, about("Stress there by the rod.")]
    edge_stress_Pa: Annotated[
        list[float],
        about("Largest axial stress at the surface at the edges of the disks of each module."),
    ]


class FeLimit(Object):
    """Convergence study of the mesh."""

    tip_position_m: Annotated[list[Vector], about("Extrapolated position of the tip by load.")]
    error_mm: Annotated[list[float], about("Uncertainty of the extrapolated position.")]
    difference_mm: Annotated[list[OrNull], about("Its distance from the tip of the rod.")]
    refinements: Annotated[list[Refinement], about("Refinements.")]


class FeRun(Object):
    """Results of `bowstring fe`."""

    status: Annotated[
        FeStatus,
        about(
            "`converged`; else `diverged`, `killed`, `out_of_memory`, `no_space` or `failed`, with "
            "the loads before."
        ),
    ]
    message: Annotated[str, about("Status as a sentence.")]
    loads: Annotated[list[FeLoad], about("Results by load or time.")]
    span_error: Annotated[
        OrNull, about("Largest relative deviation of the force in a span from its tension.")
    ]
    stress_ratio: Annotated[
        list[OrNull],
        about(
            "By load, of the module with the largest stress in its middle: this stress over that "
            "of the rod."
        ),
    ]
    concentration: Annotated[
        list[OrNull],
        about("By load, of the same module: largest stress at a node over that in its middle."),
    ]
    nodes: Annotated[int, about("Nodes of the mesh.")]
    bricks: Annotated[int, about("Brick elements of the mesh.")]
    cached: Annotated[int, about("Loads or times taken from the cache.")]
    iterations: Annotated[int, about("Iterations of CalculiX.")]
    wall_s: Annotated[float, about("Time that CalculiX took.")]
    limit: Annotated[FeLimit | None, about("Limit for fine meshes; `null` without `--study`.")]


class Fe(FeRun, OfRobot, InFolder):
    """Output of `bowstring fe`."""
