"""Bricks of a robot: their volume, shape, sections and holes."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bowstring.fem.elements import POINTS, brick_shape
from bowstring.fem.mesh import Fineness, brick_mesh
from bowstring.robot.model import Robot
from fem_robots import small_robot, two_segments
from objects import refused


def volumes(mesh: object, which: np.ndarray) -> np.ndarray:
    """Volumes of bricks, by CalculiX's 8 integration points; all contributions must be positive."""
    _, slope = brick_shape(POINTS)
    parts = np.linalg.det(np.einsum("pnk,bni->bpki", slope, mesh.nodes[mesh.bricks[which]]))
    assert parts.min() > 0
    return parts.sum(axis=1)


@pytest.mark.parametrize("robot", [small_robot(), two_segments()], ids=["rod", "tubes"])
@pytest.mark.parametrize("fineness", [Fineness(2, 4, 1), Fineness(4, 8, 2), Fineness(6, 12, 3)])
def test_bricks_fill_the_backbone(robot: Robot, fineness: Fineness) -> None:
    mesh = brick_mesh(robot, fineness)
    volumes(mesh, np.arange(len(mesh.bricks)))
    near = {4: 0.02, 8: 0.002, 12: 0.0005}[fineness.around]
    for k, segment in enumerate(robot.segments):
        free = np.flatnonzero(~mesh.stiff & (mesh.part == k))
        disks = robot.disks
        clamps = disks.clamped_length_m
        before = 0.5 * np.concatenate([[0.0], clamps[:-1]]) + 0.5 * clamps
        lengths = np.diff(disks.station_m, prepend=0.0) - before
        expected = segment.backbone.area * lengths[disks.segment == k].sum()
        assert volumes(mesh, free).sum() == pytest.approx(expected, rel=near)


@pytest.mark.parametrize("robot", [small_robot(), two_segments()], ids=["rod", "tubes"])
def test_sections_have_the_second_moment_of_the_backbone(robot: Robot) -> None:
    mesh = brick_mesh(robot, Fineness(2, 4, 1))
    value, slope = brick_shape(POINTS)
    for k, segment in enumerate(robot.segments):
        one = mesh.slices[np.flatnonzero(mesh.slice_module >= 0)]
        one = one[mesh.part[one[:, 0]] == k][0]
        points = mesh.nodes[mesh.bricks[one]]
        volume = np.linalg.det(np.einsum("pnk,bni->bpki", slope, points))
        x = np.einsum("pn,bni->bpi", value, points)
        length = np.ptp(points[..., 2])
        moment = (volume * x[..., 0] ** 2).sum() / length
        # 8 points are not exact for it, but they are for CalculiX's stiffness
        assert moment == pytest.approx(segment.backbone.second_moment, rel=0.02)


def test_mid_nodes_lie_on_the_circle() -> None:
    mesh = brick_mesh(small_robot(), Fineness(2, 8, 1))
    at_base = mesh.nodes[mesh.base]
    radius = np.hypot(at_base[:, 0], at_base[:, 1])
    outline = radius > 0.0025
    assert outline.sum() == 16  # 8 corners, 8 edges
    np.testing.assert_allclose(radius[outline], radius.max(), rtol=1e-12)
    assert radius.max() == pytest.approx(0.0025, rel=5e-4)


def test_holes_are_where_the_robot_has_them() -> None:
    robot = two_segments()
    mesh = brick_mesh(robot, Fineness(2, 4, 1))
    ends = robot.tendons.end_disk
    for t, (x, y) in enumerate(robot.tendons.hole_m):
        assert (mesh.hole[: ends[t] + 2, t] >= 0).all()
        assert (mesh.hole[ends[t] + 2 :, t] < 0).all()
        stations = [0.0, *robot.disks.station_m[: ends[t] + 1]]
        expected = [[x, y, z] for z in stations]
        np.testing.assert_allclose(mesh.nodes[mesh.hole[: ends[t] + 2, t]], expected, atol=1e-15)
    rows = mesh.nodes[mesh.rows[mesh.station_row]]
    np.testing.assert_allclose(rows[..., 2].T, np.tile(robot.disks.station_m, (rows.shape[1], 1)))


@pytest.mark.parametrize("around", [4, 8, 12])
@pytest.mark.parametrize("inner", ["0 mm", "4 mm"])
def test_the_first_tendon_is_before_the_middle_of_an_edge(around: int, inner: str) -> None:
    robot = small_robot(
        **{"segments.0.tendons.first_angle": "17 deg", "segments.0.backbone.inner_diameter": inner}
    )
    mesh = brick_mesh(robot, Fineness(2, around, 1))
    outline = mesh.nodes[mesh.base]
    outline = outline[np.hypot(*outline.T[:2]) > 0.0024]
    angles = np.sort(np.arctan2(outline[:, 1], outline[:, 0]) - np.radians(17.0))
    np.testing.assert_allclose(np.diff(angles), np.pi / around, atol=1e-9)
    corners = mesh.nodes[mesh.rows[1]]  # between slices there are no edges
    corners = corners[np.hypot(*corners.T[:2]) > 0.0024]
    turns = np.arctan2(corners[:, 1], corners[:, 0]) - np.radians(17.0)
    share = np.mod(turns / (2 * np.pi / around), 1.0)
    np.testing.assert_allclose(share, 0.5, atol=1e-9)


def test_points_that_carry_mass_have_the_moments_of_a_disk() -> None:
    robot = two_segments()
    mesh = brick_mesh(robot, Fineness(2, 4, 1), mass_arms=True)
    for i, nodes in enumerate(mesh.mass_nodes):
        radius, thickness = robot.disks.radius_m[i], robot.disks.thickness_m[i]
        off = thickness**2 / (24 * mesh.mass_height[i] ** 2)
        share = 0.25 * np.array([off, 1 - 2 * off, off])
        place = mesh.nodes[nodes] - [0, 0, robot.disks.station_m[i]]
        moment = np.einsum("k,aki,akj->ij", share, place, place)
        expected = np.diag([radius**2 / 4, radius**2 / 4, thickness**2 / 12])
        np.testing.assert_allclose(moment, expected, atol=1e-12)


def test_brick_lengths_grow_gradually_towards_the_middle() -> None:
    mesh = brick_mesh(small_robot(), Fineness(8, 8, 1))
    length = np.diff(mesh.slice_z)[mesh.slice_module == 0]
    np.testing.assert_allclose(length, length[::-1])
    assert (np.diff(length[:4]) > 0).all()
    assert length.sum() == pytest.approx(0.0685)
    assert math.isclose(mesh.slice_z[-1], 0.140 + 0.0015)


@pytest.mark.parametrize(
    ("fineness", "says"),
    [
        (Fineness(3, 8, 1), "even number"),
        (Fineness(4, 6, 1), "multiple of 4"),
        (Fineness(4, 8, 0), "rings"),
    ],
)
def test_impossible_meshes_are_named(fineness: Fineness, says: str) -> None:
    refused(says, lambda: brick_mesh(small_robot(), fineness))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"segments.0.disks.clamped_length": 0}, "clamped_length is 0.*--set"),
        ({"segments.0.backbone.nu": 0.5}, "Poisson's ratio 0.5"),
        ({"segments.0.tendons.friction": 0.1}, "have friction, which"),
    ],
)
def test_a_robot_that_cannot_be_meshed_gets_a_reason(changes: dict[str, object], says: str) -> None:
    refused(says, lambda: brick_mesh(small_robot(**changes), Fineness()))
