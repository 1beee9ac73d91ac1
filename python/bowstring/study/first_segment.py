"""Arcs of a robot at one load of a study, for its equations and drawings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.display import short_repr
from bowstring.errors import BowstringError

if TYPE_CHECKING:
    from bowstring.study.study import Study


@short_repr
@dataclass(frozen=True)
class FirstSegment:
    """Constant curvature at the largest load with an equilibrium: the segment at the base.

    Its tendons end at its own end disk, so that their lengths are those of one arc. All SI.
    """

    load: int
    """Index of the load in the sweep."""
    tension: float
    """Tension of the sweep, N."""
    arcs: RobotArcs
    """Arcs of all segments."""
    without_lengths: str
    """Reason for arcs by the linear law; empty for arcs from the lengths."""
    tendons: NDArray[np.intp]
    """Indices of the tendons anchored to its end disk."""
    stations: Floats
    """Arc lengths of its disks from the base (n,), m."""
    tip: Floats
    """Centre of its end disk by statics (3,), m."""

    @property
    def from_lengths(self) -> bool:
        """Whether the arcs follow from the tendon lengths."""
        return not self.without_lengths

    @property
    def theta(self) -> float:
        """Bend angle, rad."""
        return float(self.arcs.theta[0])

    @property
    def phi(self) -> float:
        """Bending direction from x towards y, rad."""
        return float(self.arcs.phi[0])

    @property
    def length(self) -> float:
        """Arc length, m."""
        return float(self.arcs.length[0])

    @property
    def straight(self) -> bool:
        """Whether the arc is practically straight."""
        return self.theta < 1e-6

    @property
    def equal_modules(self) -> bool:
        """Whether its disks are evenly spaced, clamp nothing, and have holes without a length."""
        steps, count = np.diff(self.stations, prepend=0.0), len(self.stations)
        disks = self.arcs.robot.disks
        thick = disks.clamped_length_m[:count].any() or disks.hole_length_m[:count].any()
        return bool(np.ptp(steps) < 1e-9 * self.stations[-1]) and not thick


def first_segment(study: Study) -> FirstSegment:
    """Find the first segment at the largest load of the sweep with an equilibrium."""
    robot, statics = study.model.robot, study.statics
    load = int(np.flatnonzero(statics.converged)[-1])
    tension = float(statics.tension[load])
    try:
        arcs, reason = RobotArcs.from_lengths(robot, statics.tendon_lengths[load]), ""
    except BowstringError as error:  # too few tendons, or lengths without an arc
        reason = str(error).rstrip(".")
        tensions = study.model.tensions(study.model.arc_scale * np.array([tension]))[0]
        arcs = RobotArcs.from_tensions(robot, tensions)
    stations = robot.disks.station_m[robot.disks.segment == 0]
    return FirstSegment(
        load=load,
        tension=tension,
        arcs=arcs,
        without_lengths=reason,
        tendons=np.flatnonzero(robot.tendons.segment == 0),
        stations=stations,
        tip=statics.disk_positions[load, len(stations) - 1],
    )
