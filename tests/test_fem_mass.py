"""Energies of a mesh in rigid-body motion, compared with its disks and its rod."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bowstring.fem.mass import disk_points, gravity_energy, kinetic_energy, payload_centres
from bowstring.fem.mesh import Fineness, brick_mesh
from bowstring.robot.rest_shape import rest_frames
from fem_robots import two_segments

ROBOT = two_segments()
MESH = brick_mesh(ROBOT, Fineness(2, 8, 1), mass_arms=True)


def rod_pieces() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mass, centre and length of the backbone of each segment, to the mesh's end."""
    ends = np.cumsum([0.0] + [s.length for s in ROBOT.segments])
    ends[-1] = MESH.slice_z[-1]
    length = np.diff(ends)
    return ROBOT.mass_per_length * length, 0.5 * (ends[1:] + ends[:-1]), length


def test_points_of_a_disk_have_its_mass() -> None:
    np.testing.assert_allclose(4 * disk_points(ROBOT, MESH).sum(axis=1), ROBOT.disks.mass_kg)


def test_translation_has_the_energy_of_all_mass() -> None:
    velocity = np.array([0.3, -0.2, 0.6])
    mass = ROBOT.disks.mass_kg.sum() + rod_pieces()[0].sum()
    energy = kinetic_energy(ROBOT, MESH, np.broadcast_to(velocity, MESH.nodes.shape))
    assert energy == pytest.approx(0.5 * mass * velocity @ velocity, rel=2e-3)


@pytest.mark.parametrize("axis", [0, 1, 2], ids=["x", "y", "z"])
def test_rotation_has_the_energy_of_all_inertia(axis: int) -> None:
    spin = 2.0 * np.eye(3)[axis]
    mass, middle, length = rod_pieces()
    across, axial = ROBOT.disks.inertia_kg_m2.T
    if axis == 2:
        # polar moment of a rod: twice its second moment of area over its area
        turned = [2 * s.backbone.second_moment / s.backbone.area for s in ROBOT.segments]
        inertia = axial.sum() + mass @ turned
    else:
        thin = [s.backbone.second_moment / s.backbone.area for s in ROBOT.segments]
        inertia = np.sum(across + ROBOT.disks.mass_kg * ROBOT.disks.station_m**2)
        inertia += mass @ (middle**2 + length**2 / 12 + thin)
    energy = kinetic_energy(ROBOT, MESH, np.cross(spin, MESH.nodes))
    assert energy == pytest.approx(0.5 * inertia * 4.0, rel=3e-3)


def test_weight_is_zero_with_all_mass_at_the_base() -> None:
    gravity = [0.5, 0.0, -9.8]
    disk = np.zeros((len(ROBOT.disks.mass_kg), 3))
    assert gravity_energy(ROBOT, MESH, 0.0 * MESH.nodes, disk, gravity) == 0.0
    disk[:, 2] = ROBOT.disks.station_m
    mass, middle, _ = rod_pieces()
    expected = 9.8 * (ROBOT.disks.mass_kg @ ROBOT.disks.station_m + mass @ middle)
    energy = gravity_energy(ROBOT, MESH, MESH.nodes, disk, gravity)
    assert energy == pytest.approx(expected, rel=2e-3)


TOOLS = [{"mass": "40 g", "centre": "5 -12 30 mm"}, {"mass": "10 g", "disk": 2}]


@pytest.mark.parametrize("bend", ["0 deg", "40 deg"])
def test_the_centre_of_a_payload_moves_with_its_disk(bend: str) -> None:
    """A combination of nodes of the disk, for any rigid motion, also of a curved robot."""
    robot = ROBOT.with_({"payloads": TOOLS, "segments.0.backbone.rest_bend": bend})
    mesh = brick_mesh(robot, Fineness(2, 8, 1), mass_arms=True)
    place, axes = rest_frames(robot, robot.disks.station_m)
    turn = Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()
    moved = mesh.nodes @ turn.T + [0.1, 0.2, -0.3]
    centres = [(-1, [0.005, -0.012, 0.030]), (1, [0.0, 0.0, 0.0])]
    found = payload_centres(robot, mesh)
    for (mass, nodes, weight), (disk, centre), kg in zip(found, centres, [0.04, 0.01], strict=True):
        expected = turn @ (place[disk] + axes[disk] @ centre) + [0.1, 0.2, -0.3]
        np.testing.assert_allclose(weight @ moved[nodes], expected, atol=1e-12)
        assert weight.sum() == pytest.approx(1.0, abs=1e-12) and mass == pytest.approx(kg)
    bare = ROBOT.with_({"segments.0.backbone.rest_bend": bend})
    disks, gravity = place, [0.5, 0.0, -9.8]
    more = gravity_energy(robot, mesh, mesh.nodes, disks, gravity)
    more -= gravity_energy(bare, mesh, mesh.nodes, disks, gravity)
    heights = [
        kg * (place[d] + axes[d] @ c) for kg, (d, c) in zip([0.04, 0.01], centres, strict=True)
    ]
    assert more == pytest.approx(-np.sum(heights, axis=0) @ gravity, rel=1e-9)
