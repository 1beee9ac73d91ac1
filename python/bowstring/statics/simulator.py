"""Simulators of the core: made for a robot, and the raw fields that they leave; fields at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bowstring._core import Simulator
from bowstring.errors import NoSolutionError
from bowstring.statics import actuation
from bowstring.statics.fields import Frames
from bowstring.statics.load import InstantLoad, Load

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

__all__ = ["Scheme", "at_rest", "frames", "keep_start", "make", "stations"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Scheme(NamedTuple):
    """Time integration and damping in numbers, SI."""

    step: float | None = 1.0
    """Fixed step; None adapts it."""
    tolerance: float = 1.0
    """Error of a disk's position in an adapted step to aim for."""
    longest_step: float = 1.0
    spectral_radius: float = 1.0
    mass_damping: float = 0.0
    material_damping: float = 0.0


def make(
    robot: Robot,
    model: RodModel,
    gravity: Any,
    points: int,
    scheme: Scheme = Scheme(),  # noqa: B008
) -> Simulator:
    """A robot that can move; arguments as of `bowstring.simulate`, checked."""
    home = actuation.home_lengths(robot, model)
    if home is None:
        home = np.full(len(robot.tendons.end_disk), np.nan)
    compliances = actuation.compliances(robot)
    return Simulator(robot.core, model, gravity, scheme, points, home, compliances)


def stations(robot: Robot, points: int) -> tuple[Floats, Ints]:
    """Arc length and module of every point, both ends of each flexible part among them."""
    disks = robot.disks
    held = disks.clamped_length_m / 2.0
    end = disks.station_m - held
    start = np.concatenate([[0.0], disks.station_m[:-1] + held[:-1]])
    share = np.linspace(0.0, 1.0, points)
    station = start[:, None] + share * (end - start)[:, None]
    return station.ravel(), np.repeat(np.arange(len(start)), points)


def keep_start(simulator: Simulator, load: InstantLoad) -> None:
    """Keep the fields of a robot that rests under a load, as of time 0."""
    row = (load.actuation[None], load.tip_force[None], load.tip_moment[None])
    simulator.run(np.zeros(1), *row, np.array([True]))


def frames(simulator: Simulator, where: tuple[Floats, Ints]) -> Frames:
    """All that was kept, at these `stations`; the simulator gives it away."""
    return Frames(station=where[0], module=where[1], **simulator.fields())


def at_rest(
    robot: Robot, load: Load, model: RodModel, path: actuation.Path | None = None, *, points: int
) -> Frames:
    """Raw fields of an equilibrium, as of a run that has not begun; see `Solution.to_dataset`.

    Of the tensions or, if it is given, that a path has come to.
    """
    simulator = make(robot, model, load.gravity, points)
    tip = [np.zeros(3) if v is None else v for v in (load.tip_force, load.tip_moment)]
    start = InstantLoad(*(np.asarray(row, dtype=float) for row in (load.tensions, *tip)))
    if path is None:
        status = simulator.rest(*start)
    else:
        status = "converged" if simulator.rest_at(path.core) else "max_iterations"
        start = start._replace(actuation=path.core.history()["commands"])
    if status != "converged":
        raise NoSolutionError(
            f"{robot.name}: there is no equilibrium to take fields of ({status})",
            status="no_equilibrium",
        )
    keep_start(simulator, start)
    return frames(simulator, stations(robot, points))
