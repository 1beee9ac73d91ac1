"""Sweeps of a study: constant curvature alone, and the rod by statics."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, cast

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.display import short_repr
from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.formatting import significant
from bowstring.results import Key, Result
from bowstring.study.comparison import Model
from bowstring.study.ramp_response import Surface, surface_at_rest
from bowstring.study.settings import Settings
from bowstring.validity.loading import MAX_BEND, TRIED, turned

if TYPE_CHECKING:
    from bowstring.statics.messages import StaticsStatus

_BACKBONE_POINTS: Final = 25  # points per segment


@short_repr
@dataclass(frozen=True)
class GeometricSweep(Result):
    """Geometric sweep of the source study: constant curvature without mechanics."""

    displacement: Annotated[Floats, Key("displacement_mm")]
    """Displacement of the actuated tendon (n,), m."""
    tendon_lengths: Floats
    """Tendon lengths (n, T), m."""
    theta: Annotated[Floats, Key("theta_deg")]
    """Bend angles by displacement and segment (n, S), rad."""
    tip_position: Annotated[Floats, Key("tip_position_mm")]
    """Tip (n, 3), m."""
    disk_positions: Floats
    """Positions of the disks (n, N, 3), m."""
    disk_rotations: Floats
    """Rotations of the disks (n, N, 3, 3)."""
    backbone: Floats
    """Points along the backbone from the base (n, P, 3), m."""
    scale: float = 1.0
    """Share of the sweep's tensions from which the linear law gives these arcs; 1 without
    gravity."""


@short_repr
@dataclass(frozen=True)
class Statics(Result):
    """Sweep by straight-span statics."""

    tension: Annotated[Floats, Key("tension_N")]
    """Tension of the actuated tendon (n,), N; the others have their shares of it."""
    status: Annotated[tuple[StaticsStatus, ...], Key()]
    """Status at each load, as of ``solve``: ``"converged"``, or the reason of failure."""
    converged: Bools
    """Whether each load converged (n,)."""
    tip_position: Annotated[Floats, Key("tip_position_mm")]
    """Tip (n, 3), m; NaN where not converged."""
    disk_positions: Floats
    """Positions of the disks (n, N, 3), m."""
    disk_rotations: Floats
    """Their rotations (n, N, 3, 3), disk frame to base frame."""
    tendon_lengths: Annotated[Floats, Key("tendon_lengths_mm")]
    """Tendon lengths (n, T), m; NaN where not converged."""
    displacement: Annotated[Floats, Key("displacement_mm")]
    """Displacement l0 - l of the actuated tendon (n,), l0 with the straight backbone, m; NaN where
    not converged."""
    linear_displacement: Annotated[Floats, Key("linear_displacement_mm")]
    """Displacement by the linear law (n,), m; NaN where it has none."""
    surface: Annotated[Surface, Key(flat=True)]
    """Largest stress and strain (n,)."""


def arc_scale_of(model: Model, settings: Settings) -> float:
    """Share of the tensions at which the arcs of the linear law end at the robot's own bend.

    It is 1 without gravity. In gravity the linear law may bend a robot ten times too far, so that
    its arcs would be unusable as geometry or as commanded lengths.
    """
    linear = settings.max_tension * model.linear_bend_of_all
    if not any(model.robot.gravity) or linear <= MAX_BEND:
        return 1.0
    tension = np.linspace(0.0, settings.max_tension, TRIED)
    bend = turned(model.robot, model.tensions(tension), model.main.model)
    known = bend[np.isfinite(bend)]
    return min(1.0, max(MAX_BEND, float(known[-1]) if known.size else 0.0) / linear)


def geometric_sweep(model: Model, settings: Settings) -> GeometricSweep:
    """Shorten the actuated tendon by the linear law; the others follow at constant arc length."""
    robot = model.robot
    tension = np.linspace(0.0, settings.max_tension, settings.points)
    arcs = RobotArcs.from_tensions(robot, model.tensions(model.arc_scale * tension))
    try:
        lengths = arcs.lengths()
    except BowstringError:
        turns = settings.max_tension * model.linear_bend_of_all / math.tau
        raise InputError(
            f"by the linear law {settings.max_tension:g} N winds {robot.name} up by "
            f"{significant(turns)} turns, tighter than its tendons' distance from the backbone "
            "lets them; check its stiffness or give a smaller largest tension",
            argument="max_tension",
        ) from None
    # Eq. 5 of the study, from lengths (theory Eq. 1.1 and 1.4), needs tendons that end at each
    # segment and lengths of an arc; otherwise the original arcs are kept, which are the same.
    with suppress(InputError):
        arcs = RobotArcs.from_lengths(robot, lengths)
    return GeometricSweep(
        displacement=displacement_of(model, lengths),
        tendon_lengths=lengths,
        theta=arcs.theta,
        tip_position=arcs.tip.position,
        disk_positions=arcs.disk_positions,
        disk_rotations=arcs.disk_rotations,
        backbone=arcs.centerline(_BACKBONE_POINTS),
        scale=model.arc_scale,
    )


def displacement_of(model: Model, lengths: Floats) -> Floats:
    """Displacement of the actuated tendon from the straight backbone (n,), m."""
    end = model.robot.tendons.end_disk[model.tendon]
    return np.asarray(model.robot.disks.station_m[end] - lengths[:, model.tendon])


def static_sweep(model: Model, settings: Settings) -> Statics:
    """Solve the main sweep.

    Raises
    ------
    NoSolutionError
        If no load has a stable equilibrium.
    """
    tension = np.linspace(0.0, settings.max_tension, settings.points)
    sweep = model.solve(model.main, tension, disks=True)
    if not np.any(sweep.converged):
        raise NoSolutionError(
            f"no load from 0 to {tension[-1]:g} N has a stable equilibrium that the solver could "
            f"find ({sweep.message(0).rstrip('.')}); check stiffness, gravity and largest tension"
        )
    assert sweep.disk_positions is not None and sweep.disk_rotations is not None
    return Statics(
        tension=tension,
        status=cast("tuple[StaticsStatus, ...]", tuple(sweep.status)),
        converged=np.asarray(sweep.converged, dtype=bool),
        tip_position=sweep.tip_position,
        disk_positions=sweep.disk_positions,
        disk_rotations=sweep.disk_rotations,
        tendon_lengths=sweep.tendon_lengths,
        displacement=displacement_of(model, sweep.tendon_lengths),
        linear_displacement=model.linear_displacement(tension),
        surface=surface_at_rest(model, tension, sweep.tip_position),
    )
