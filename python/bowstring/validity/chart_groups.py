"""Dimensionless groups of a robot with one segment and one actuated tendon: theory Eq. 9.1."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring import validation
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import listed, significant
from bowstring.robot.model import check_parallel, check_robot, check_straight

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

Vector = tuple[float, float, float]

RANGES: Final = {
    "disks": (3.0, 20.0),
    "pitch": (0.01, 0.1),
    "clamped": (0.0, 0.4),
    "friction": (0.0, 0.3),
    "extension": (0.0, 1.6e-4),
    "torsion": (0.66, 1.0),
    "weight": (0.0, 2.0),
    "tip_force": (0.0, 0.5),
}
"""Ranges of the groups in which the chart is tested; of vectors, of their magnitude."""
_NAMES: Final = {
    "disks": "the number of disks",
    "pitch": "pitch radius over length",
    "clamped": "the clamped share of the spacing",
    "friction": "the friction coefficient",
    "extension": "EI/(EA l^2)",
    "torsion": "GJ/(EI)",
    "weight": "the weight number",
    "tip_force": "the tip force number",
}


@short_repr
@dataclass(frozen=True)
class Groups:
    """Dimensionless groups of one segment with equally spaced disks and one actuated tendon.

    Vectors have x towards the actuated tendon and z along the straight backbone.
    """

    disks: int
    """Number n of disks."""
    pitch: float
    """Pitch radius of the actuated tendon over the length, r/l."""
    clamped: float = 0.0
    """Clamped length over the spacing of the disks, c n/l."""
    friction: float = 0.0
    """Friction coefficient of the actuated tendon; it acts as on loading."""
    extension: float = 0.0
    """Extension of the backbone against its bending, EI/(EA l^2)."""
    torsion: float = 1.0 / 1.3
    """Torsional over bending stiffness, GJ/(EI)."""
    weight: Vector = (0.0, 0.0, 0.0)
    """Weight number: weight of backbone and disks times l^2/(EI)."""
    disk_share: float = 0.0
    """Share of the disks in the weight."""
    tip_force: Vector = (0.0, 0.0, 0.0)
    """Tip force number: dead force at the tip times l^2/(EI)."""

    @classmethod
    def of(cls, robot: Robot, tendon: int = 0, tip_force: Sequence[float] = (0, 0, 0)) -> Groups:
        """Groups of a robot, with its gravity and its friction.

        Parameters
        ----------
        robot : Robot
            Robot with one segment.
        tendon : int
            Index of the actuated tendon, from 0.
        tip_force : array_like (3,)
            Dead force at the tip in base axes, N.

        Returns
        -------
        Groups
            The groups.

        Raises
        ------
        InputError
            If the robot has several segments, a stiffness matrix, or disks that are not equally
            spaced up to the tip.
        """
        check_robot(robot)
        if len(robot.segments) != 1:
            raise InputError(
                f"the validity chart is for one segment, and {robot.name} has "
                f"{len(robot.segments)}; use bowstring.run_study for it"
            )
        check_parallel(robot, "the validity chart")
        check_straight(robot, "the validity chart")
        segment, disks = robot.segments[0], robot.disks
        if segment.backbone.stiffness is not None:
            raise InputError(
                "the validity chart is for backbones with E, G or nu, and a shape, not for those "
                "by a stiffness matrix; use bowstring.run_study for this robot"
            )
        if robot.payloads or disks.hole_length_m.any():
            raise InputError(
                "the validity chart is for robots without payloads and with holes in the mid-plane "
                "of the disks; use bowstring.run_study for this robot"
            )
        length, n = robot.length, len(disks.station_m)
        if not np.allclose(disks.station_m, np.arange(1, n + 1) * length / n, atol=1e-6 * length):
            raise InputError(
                "the validity chart is for disks with equal spacing, the last one at the tip; use "
                "bowstring.run_study for this robot"
            )
        tendon = validation.whole("tendon", tendon, 0, len(robot.tendons.angle_rad) - 1)
        force = validation.numbers("tip_force", tip_force, (3,), "N")
        backbone, angle = segment.backbone, float(robot.tendons.angle_rad[tendon])
        to_number = length**2 / float(robot.bending_stiffness[0])
        own, on_disks = float(robot.mass_per_length[0]) * length, float(disks.mass_kg.sum())
        mass = own + on_disks

        def vector(value: Sequence[float]) -> Vector:
            x, y, z = (float(v) * to_number for v in value)
            c, s = math.cos(angle), math.sin(angle)
            return (c * x + s * y, c * y - s * x, z)

        return cls(
            disks=n,
            pitch=float(robot.tendons.pitch_radius_m[tendon]) / length,
            clamped=float(disks.clamped_length_m[0]) * n / length,
            friction=float(robot.tendons.friction[tendon]),
            extension=backbone.second_moment / (backbone.area * length**2),
            torsion=float(robot.torsion_stiffness[0] / robot.bending_stiffness[0]),
            weight=vector([mass * g for g in robot.gravity]),
            disk_share=on_disks / mass if mass else 0.0,
            tip_force=vector(force.tolist()),
        )

    @property
    def outside(self) -> str:
        """Groups outside `RANGES` in words; empty if there are none."""
        found = []
        for name, (low, high) in RANGES.items():
            size = float(np.linalg.norm(getattr(self, name)))
            if not low * (1 - 1e-9) <= size <= high * (1 + 1e-9):
                found.append(f"{_NAMES[name]} is {significant(size)} (tested {low:g} to {high:g})")
        return listed(found) if found else ""


def bend_per_tension(robot: Robot, tendon: int) -> float:
    """Bend angle by the linear law per tension, r l/(EI), rad/N."""
    radius = float(robot.tendons.pitch_radius_m[tendon])
    return radius * robot.length / float(robot.bending_stiffness[0])
