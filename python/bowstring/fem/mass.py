"""Mass and energies of a mesh: point masses of the disks, bricks of the backbone, payloads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.fem.elements import MASS_POINTS, MASS_WEIGHTS, brick_shape
from bowstring.fem.mesh import BrickMesh
from bowstring.robot.model import Robot
from bowstring.robot.rest_shape import rest_frames


class CentreOfMass(NamedTuple):
    """Centre of mass of a payload as an affine combination of nodes of its disk.

    The disk is rigid, so that ``weight @ nodes`` moves with it as the centre does. A dead force at
    the centre is the same force times the weights at the nodes, for any motion of the disk.
    """

    mass: float
    """Mass in kg."""
    nodes: Ints
    weight: Floats
    """Weights of the nodes; their sum is 1."""


def payload_centres(robot: Robot, mesh: BrickMesh) -> list[CentreOfMass]:
    """Centres of mass of all payloads, on the arms ``mesh.mass_nodes`` of their disks."""
    found = []
    numbers = robot.payload_numbers
    disks = numbers[:, 0].astype(int)
    places, axes = rest_frames(robot, robot.disks.station_m[disks])
    for disk, place, turned, row in zip(disks.tolist(), places, axes, numbers, strict=True):
        nodes = mesh.mass_nodes[disk].ravel()
        arms = mesh.nodes[nodes] - place
        size = float(np.abs(arms).max())
        affine = np.concatenate([np.ones((1, len(nodes))), arms.T / size])
        centre = np.concatenate([[1.0], turned @ row[2:5] / size])
        # the smallest weights
        found.append(CentreOfMass(float(row[1]), nodes, np.linalg.pinv(affine) @ centre))
    return found


def disk_points(robot: Robot, mesh: BrickMesh) -> Floats:
    """Mass (N, 3) in kg of each of the points ``mesh.mass_nodes`` of a disk, by height.

    Points below and above the station share the mass that gives the disk its thickness.
    """
    mass, (across, axial) = robot.disks.mass_kg, robot.disks.inertia_kg_m2.T
    excess = np.maximum(across - 0.5 * axial, 0.0)
    off = excess / np.where(mass > 0, 2.0 * mass * mesh.mass_height**2, 1.0)
    found: Floats = 0.25 * mass[:, None] * np.stack([off, 1.0 - 2.0 * off, off], axis=1)
    return found


def kinetic_energy(robot: Robot, mesh: BrickMesh, velocity: Floats) -> float:
    """Kinetic energy in J of a mesh with disks; ``velocity`` (n, 3) of its nodes in m/s."""
    bricks, weight = _backbone(robot, mesh)
    value, _ = brick_shape(MASS_POINTS)
    inside = np.einsum("pn,bni->bpi", value, velocity[bricks])
    ends = np.sum(velocity[mesh.mass_nodes] ** 2, axis=(1, 3))
    disks = np.sum(disk_points(robot, mesh) * ends)
    return float(0.5 * (np.sum(weight * np.sum(inside**2, axis=2)) + disks))


def gravity_energy(
    robot: Robot, mesh: BrickMesh, place: Floats, disk: Floats, gravity: Sequence[float]
) -> float:
    """Gravity energy in J, zero with all mass at the base; positions of nodes and disks in m."""
    bricks, weight = _backbone(robot, mesh)
    value, _ = brick_shape(MASS_POINTS)
    inside = np.einsum("bp,pn,bni->i", weight, value, place[bricks])
    moment = inside + robot.disks.mass_kg @ disk
    for mass, nodes, share in payload_centres(robot, mesh):
        moment = moment + mass * (share @ place[nodes])
    return -float(moment @ np.asarray(gravity, dtype=float))


def _backbone(robot: Robot, mesh: BrickMesh) -> tuple[Ints, Floats]:
    """Nodes (b, 20) of the backbone's bricks, and mass (b, 27) of their points in kg."""
    here = ~mesh.arm
    _, slope = brick_shape(MASS_POINTS)
    bricks = mesh.bricks[here]
    volume = np.linalg.det(np.einsum("pnk,bni->bpik", slope, mesh.nodes[bricks])) * MASS_WEIGHTS
    density = np.array([s.backbone.density for s in robot.segments])
    return bricks, density[mesh.part[here], None] * volume
