"""Simulators of the core: made for a robot, and the raw fields that they leave; fields at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.errors import NoSolutionError
from bowstring.statics import actuation
from bowstring.statics.fields import Frames
from bowstring.statics.load import Load

if TYPE_CHECKING:
    from bowstring._core import Simulator
    from bowstring.robot.model import Robot

__all__ = ["at_rest", "frames", "keep_start", "make", "stations"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def make(
    robot: Robot,
    theory: str,
    tendon: str,
    twist: bool,
    elements: int,
    gravity: Sequence[float] | None,
    points: int,
    *,
    mass_damping: float = 0.0,
    material_damping: float = 0.0,
    spectral_radius: float = 1.0,
    dt: float | None = 1.0,
    tolerance: float = 1.0,
    longest_step: float = 1.0,
) -> Simulator:
    """A robot that can move; arguments as of `bowstring.simulate`, checked."""
    import bowstring._core as _core

    home = actuation.home_lengths(robot, theory, tendon, twist, elements)
    return _core.Simulator(
        robot.core,
        theory,
        tendon,
        twist,
        elements,
        gravity,
        float(mass_damping),
        float(material_damping),
        float(spectral_radius),
        dt,
        tolerance,
        longest_step,
        points,
        np.full(len(robot.tendons.end_disk), np.nan) if home is None else home,
        actuation.compliances(robot),
    )


def stations(robot: Robot, points: int) -> tuple[Floats, Ints]:
    """Arc length and module of every point, both ends of each flexible part among them."""
    disks = robot.disks
    held = disks.clamped_length_m / 2.0
    end = disks.station_m - held
    start = np.concatenate([[0.0], disks.station_m[:-1] + held[:-1]])
    share = np.linspace(0.0, 1.0, points)
    station = start[:, None] + share * (end - start)[:, None]
    return station.ravel(), np.repeat(np.arange(len(start)), points)


def keep_start(simulator: Simulator, load: Load) -> None:
    """Keep the fields of a robot that rests under a load, as of time 0."""
    row = (load.drive[None], load.tip_force[None], load.tip_moment[None])
    simulator.run(np.zeros(1), *row, np.array([True]))


def frames(simulator: Simulator, where: tuple[Floats, Ints]) -> Frames:
    """All that was kept, at these `stations`; the simulator gives it away."""
    return Frames(station=where[0], module=where[1], **simulator.fields())


def at_rest(
    robot: Robot,
    tensions: ArrayLike,
    path: actuation.Path | None,
    *,
    tip_force: ArrayLike,
    tip_moment: ArrayLike,
    gravity: Sequence[float],
    theory: str,
    tendon: str,
    twist: bool,
    elements: int,
    points: int,
) -> Frames:
    """Raw fields of an equilibrium, as of a run that has not begun; see `Solution.fields`.

    Of the tensions or, if it is given, that a path has come to.
    """
    simulator = make(robot, theory, tendon, twist, elements, gravity, points)
    load = Load(*(np.asarray(v, dtype=float) for v in (tensions, tip_force, tip_moment)))
    if path is None:
        status = simulator.rest(*load)
    else:
        status = "converged" if simulator.rest_at(path.core) else "max_iterations"
        load = replace(load, drive=path.core.history()["commands"])
    if status != "converged":
        raise NoSolutionError(
            f"{robot.name}: there is no equilibrium to take fields of ({status})",
            status="no_equilibrium",
        )
    keep_start(simulator, load)
    return frames(simulator, stations(robot, points))
