"""JSON of a robot for the C library, as `bowstring export` writes it."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from bowstring.cli.schemas.basic import OfRobot, Pair, Vector
from bowstring.results import Object, about

Eleven = Annotated[list[float], Field(min_length=11, max_length=11)]
Six = Annotated[list[float], Field(min_length=6, max_length=6)]


class SegmentNumbers(Object):
    """Backbone of a segment."""

    sections: Annotated[
        list[Eleven],
        about(
            "One section, or five at equal distances from start to end. Each has the bending "
            "stiffness about both principal axes in N m^2, the angle of the first one from x in "
            "rad, torsional stiffness in N m^2, axial and shear stiffness in N, mass per length in "
            "kg/m, rotary inertia per length in kg m, and curvature about x and y and twist "
            "without load in 1/m."
        ),
    ]
    stiffness: Annotated[
        Annotated[list[Six], Field(min_length=6, max_length=6)] | None,
        about("Stiffness matrix of the section in SI, if the robot file gives one."),
    ]


class DiskNumbers(Object):
    """A disk."""

    station_m: Annotated[float, about("Distance from the base along the straight backbone.")]
    clamped_length_m: Annotated[float, about("Rigid length, centred on the station.")]
    hole_length_m: Annotated[float, about("Length of the holes, centred on the station.")]
    mass_kg: Annotated[float, about("Mass.")]
    inertia_kg_m2: Annotated[Pair, about("Moments of inertia about a diameter and the axis.")]
    segment: Annotated[int, about("Segment before the disk, from 0.")]


class TendonNumbers(Object):
    """A tendon."""

    holes_m: Annotated[
        list[Pair],
        about("x and y of its holes in base and disks up to its end disk; one stands for all."),
    ]
    end_disk: Annotated[int, about("Index of the end disk, from 0.")]
    compliance_m_per_N: Annotated[float, about("Compliance from motor to end disk.")]
    pretension_N: Annotated[float, about("Tension in the home pose.")]
    max_tension_N: Annotated[float, about("Default of its largest tension in inverse kinematics.")]


class PayloadNumbers(Object):
    """A body fixed to a disk."""

    disk: Annotated[int, about("Index of the disk, from 0.")]
    mass_kg: Annotated[float, about("Mass.")]
    centre_m: Annotated[Vector, about("Centre of mass from the centre of the disk, disk frame.")]
    inertia_kg_m2: Annotated[
        Vector, about("Moments of inertia about axes through its centre of mass, disk frame.")
    ]


class RobotDescription(Object):
    """Result of `compile_robot`: numbers of a robot in SI, as the core takes them."""

    format: Annotated[Literal["bowstring compiled robot"], about("Marks such a description.")]
    format_version: Annotated[
        Literal[1], about("Version of the layout; the library reads one version only.")
    ]
    tendon_path: Annotated[
        Literal["straight", "embedded"],
        about("Tendons straight between disks, or embedded in the body."),
    ]
    segments: Annotated[list[SegmentNumbers], about("Segments from the base.")]
    disks: Annotated[list[DiskNumbers], about("Disks from the base; the last one is the tip.")]
    tendons: Annotated[list[TendonNumbers], about("Tendons, inner segments first.")]
    payloads: Annotated[list[PayloadNumbers], about("Bodies fixed to disks.")]
    gravity_m_per_s2: Annotated[Vector, about("Gravity in the base frame.")]


class Compiled(OfRobot, RobotDescription):
    """Output of `bowstring export` for plain numbers, and the file that it writes."""
