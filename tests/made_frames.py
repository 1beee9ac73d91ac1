"""A synthetic run in closed form, for tests of fields and files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bowstring import RodModel
from bowstring.dynamics.run_file import RunFile
from bowstring.robot.model import Robot
from bowstring.statics.fields import FIELDS, Frames, Section, derive


def made_frames(
    robot: Robot, time: np.ndarray, points: int = 5, force: tuple[float, float, float] = (0, 0, 0)
) -> Frames:
    """An arc in the x-z plane with curvature proportional to sin(2 t); ``force`` in body axes."""
    disks = robot.disks.station_m
    n, m = len(disks), len(robot.tendons.end_disk)
    starts = np.concatenate([[0.0], disks[:-1]])
    station = np.concatenate(
        [np.linspace(a, b, points) for a, b in zip(starts, disks, strict=True)]
    )
    module = np.repeat(np.arange(n), points)
    kappa = 2.0 * np.sin(2.0 * time)  # about y, 1/m
    rate = 4.0 * np.cos(2.0 * time)
    position, rotation = arc(kappa, station)
    disk_position, disk_rotation = arc(kappa, disks)
    step = 1e-6
    velocity = (arc(kappa + step, disks)[0] - arc(kappa - step, disks)[0]) / (2 * step)
    t, p = len(time), len(station)
    moment = np.zeros((t, p, 3))
    moment[..., 1] = kappa[:, None] * robot.bending_stiffness[robot.disks.segment[module]]
    angular = np.zeros((t, n, 3))
    angular[..., 1] = rate[:, None] * disks
    span = np.where(
        np.arange(n)[:, None] <= robot.tendons.end_disk,
        np.diff(disks, prepend=0.0)[:, None],
        np.nan,
    )
    kinetic, elastic = rate**2, kappa**2
    return Frames(
        time=time,
        station=station,
        module=module,
        position=position,
        rotation=rotation,
        force=np.broadcast_to(np.asarray(force, dtype=float), (t, p, 3)).copy(),
        moment=moment,
        disk_position=disk_position,
        disk_rotation=disk_rotation,
        disk_velocity=velocity * rate[:, None, None],
        disk_angular_velocity=angular,
        tension=np.tile(np.arange(1.0, m + 1), (t, 1)),
        tendon_length=disks[robot.tendons.end_disk]
        - robot.tendons.hole_m[:, 0] * kappa[:, None] * disks[robot.tendons.end_disk],
        span_length=np.tile(span, (t, 1, 1)),
        tendon_displacement=robot.tendons.hole_m[:, 0]
        * kappa[:, None]
        * disks[robot.tendons.end_disk],
        slack=np.zeros((t, m)),
        span_tension=np.where(np.isnan(span), np.nan, np.tile(np.arange(1.0, m + 1), (t, n, 1))),
        kinetic_energy=kinetic,
        elastic_energy=elastic,
        gravity_energy=np.zeros(t),
        work=kinetic + elastic - 16.0,
        dissipated_energy=0.001 * time,
    )


def arc(kappa: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and rotations of an arc bent about y towards x."""
    angle = kappa[:, None] * s
    flat = np.abs(angle) < 1e-9
    k = np.where(flat, 1.0, kappa[:, None])
    x = np.where(flat, 0.5 * angle * s, (1.0 - np.cos(angle)) / k)
    z = np.where(flat, s, np.sin(angle) / k)
    c, w, o = np.cos(angle), np.sin(angle), np.zeros_like(angle)
    position = np.stack([x, o, z], axis=-1)
    rows = [np.stack(row, axis=-1) for row in ((c, o, w), (o, o + 1.0, o), (-w, o, c))]
    return position, np.stack(rows, axis=-2)


def made_file(path: Path, robot: Robot, settings: dict[str, Any], times: int = 0) -> RunFile:
    """The file of a synthetic run, still without a record."""
    frames = made_frames(robot, np.zeros(1))
    return RunFile.open(path, robot, settings, frames.station, frames.module, times=times)


def made_records(robot: Robot, time: np.ndarray) -> np.ndarray:
    """The records of a synthetic run that began at time 0, in the format of its file."""
    frames = made_frames(robot, np.concatenate([[0.0], time]))
    values = derive(robot, frames, Section(robot, frames.station, frames.module, RodModel()))
    columns = [frames.time, *(values[field.name] for field in FIELDS)]
    rows = np.concatenate([c.reshape(len(frames.time), -1) for c in columns], axis=1)
    return rows[1:].astype(">f8").reshape(-1).view(np.uint8)
