"""Simulators of the core: construction, raw fields of a run, and fields at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from bowstring._core import Simulator
from bowstring.aliases import Floats, Ints
from bowstring.errors import NoSolutionError
from bowstring.statics import actuation
from bowstring.statics.fields import Frames
from bowstring.statics.load import Load
from bowstring.statics.load_tables import InstantLoad, with_arrays

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot


class Scheme(NamedTuple):
    """Parameters of time integration and damping, SI."""

    step: float | None = 1.0
    """Fixed time step, s; None for an adaptive one."""
    tolerance: float = 1.0
    """Error tolerance of a disk's position in an adaptive step, m."""
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
    """Make the simulator of a robot; checked arguments of `bowstring.simulate`."""
    home = actuation.home_lengths(robot, model)
    if home is None:
        home = np.full(len(robot.tendons.end_disk), np.nan)
    compliances = actuation.compliances(robot)
    return Simulator(robot.core, model, gravity, scheme, points, home, compliances)


def stations(robot: Robot, points: int) -> tuple[Floats, Ints]:
    """Arc length and module of all stations, including both ends of each flexible part."""
    disks = robot.disks
    held = disks.clamped_length_m / 2.0
    end = disks.station_m - held
    start = np.concatenate([[0.0], disks.station_m[:-1] + held[:-1]])
    share = np.linspace(0.0, 1.0, points)
    station = start[:, None] + share * (end - start)[:, None]
    return station.ravel(), np.repeat(np.arange(len(start)), points)


def keep_start(simulator: Simulator, load: InstantLoad) -> None:
    """Record the fields of the equilibrium of a load as time 0."""
    simulator.run(np.zeros(1), load.row, np.array([True]))


def frames(simulator: Simulator, where: tuple[Floats, Ints]) -> Frames:
    """Take all records from the simulator, at these `stations`."""
    return Frames(station=where[0], module=where[1], **simulator.fields())


def at_rest(
    robot: Robot, load: Load, model: RodModel, path: actuation.Path | None = None, *, points: int
) -> Frames:
    """Raw fields of an equilibrium in the form of a run; see `Solution.to_dataset`.

    The equilibrium is that of the tensions or, if given, the end of a path.
    """
    simulator = make(robot, model, load.gravity, points)
    tip = [np.zeros(3) if v is None else v for v in (load.tip_force, load.tip_moment)]
    load = with_arrays(load)
    names = ("disk_forces", "disk_moments", "point_loads", "line_forces")
    disks = [() if (v := getattr(load, name)) is None else np.ravel(v) for name in names]
    given = (load.tensions, *tip, *disks, ())
    start = InstantLoad(*(np.asarray(row, dtype=float) for row in given))
    if path is None:
        status = simulator.rest(start)
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
