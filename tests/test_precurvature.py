"""Backbones that are curved and twisted without load."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.fem import Fineness, Settings, deck
from bowstring.fem.elements import POINTS, brick_shape
from bowstring.fem.fields import State, frames
from bowstring.fem.mesh import brick_mesh
from bowstring.robot.rest_shape import rest_frames
from fem_robots import needs_ccx, small_robot, two_segments

BEND, DIRECTION, TWIST = math.radians(50.0), math.radians(35.0), math.radians(40.0)


def precurved(twist: float = 0.0, **changes: object) -> bs.Robot:
    rest = {"rest_bend": BEND, "rest_direction": DIRECTION, "rest_twist": twist}
    paths = {f"segments.0.backbone.{name}": value for name, value in rest.items()}
    return bs.load_robot("amouri2019", {**paths, **changes})


def test_the_unloaded_robot_is_an_arc_of_its_rest_bend() -> None:
    robot = precurved()
    found = bs.solve(robot, [0.0, 0.0, 0.0])
    radius = robot.length / BEND
    towards = np.array([math.cos(DIRECTION), math.sin(DIRECTION), 0.0])
    expected = radius * (1 - math.cos(BEND)) * towards + [0.0, 0.0, radius * math.sin(BEND)]
    np.testing.assert_allclose(found.tip.position, expected, atol=1e-13)
    assert found.stable is True


def test_curvature_and_twist_are_one_helix() -> None:
    robot = precurved(TWIST)
    turned = Rotation.from_rotvec(robot.rest_curvature[0] * robot.length).as_matrix()
    np.testing.assert_allclose(bs.solve(robot, [0.0, 0.0, 0.0]).tip.rotation, turned, atol=1e-13)
    assert robot.rest_curvature[0, 2] == pytest.approx(TWIST / robot.length)


def test_fields_are_those_of_the_change_of_curvature() -> None:
    """Without load a precurved backbone has its curvature, and no stress."""
    robot = precurved(TWIST)
    data = bs.solve(robot, [0.0, 0.0, 0.0]).to_dataset()
    np.testing.assert_allclose(
        data["curvature"][0], np.tile(robot.rest_curvature, (data.sizes["station"], 1)), atol=1e-9
    )
    assert float(abs(data["von_mises"]).max()) < 1.0
    assert float(data["elastic_energy"][0]) == pytest.approx(0.0, abs=1e-15)


def test_the_linear_law_adds_to_the_rest_bend() -> None:
    robot = precurved()
    tension = np.array([8.0, 0.0, 2.0])
    arcs = RobotArcs.from_tensions(robot, tension)
    by_tension = robot.length / robot.bending_stiffness[0] * tension @ robot.tendons.hole_m
    bend = by_tension + BEND * np.array([math.cos(DIRECTION), math.sin(DIRECTION)])
    assert float(arcs.theta.ravel()[0]) == pytest.approx(np.linalg.norm(bend), rel=1e-12)
    np.testing.assert_allclose(
        [np.cos(arcs.phi.ravel()[0]), np.sin(arcs.phi.ravel()[0])],
        bend / np.linalg.norm(bend),
        rtol=1e-12,
    )
    # lengths are lengths, whatever the unloaded shape
    found = bs.solve(robot, tension)
    by_lengths = RobotArcs.from_lengths(robot, found.tendon_lengths)
    gap = np.linalg.norm(by_lengths.tip.position - found.tip.position) / robot.length
    assert gap < 0.01


# -- solid and finite elements -----------------------------------------------------------------

CLAMPED = {"segments.0.disks.clamped_length": "3 mm"}
OBLIQUE = {"segments.0.tendons.turns": 0.25, "segments.0.tendons.end_pitch_radius": "18 mm"}
CONE = {"segments.0.backbone.diameter": "6 mm", "segments.0.backbone.end_diameter": "3.5 mm"}
SHORT = CLAMPED | {"segments.0.disks.count": 3, "segments.0.length": "150 mm"}


def curved_tubes() -> bs.Robot:
    """Two segments with clamping disks, gravity and another rest shape each."""
    first, second = "segments.0.backbone.", "segments.1.backbone."
    bends = {first + "rest_bend": "40 deg", first + "rest_direction": "20 deg"}
    turns = {second + "rest_bend": "-30 deg", second + "rest_twist": "40 deg"}
    return two_segments().with_(bends | turns)


def unloaded(robot: bs.Robot) -> bs.Solution:
    nothing = np.zeros(len(robot.tendons.end_disk))
    return bs.solve(robot, load=bs.Load(nothing, gravity=[0.0, 0.0, 0.0]))


@pytest.mark.parametrize(
    "robot",
    [precurved(), precurved(TWIST, **CLAMPED), curved_tubes(), two_segments()],
    ids=["arc", "helix", "tubes", "straight"],
)
def test_frames_without_load_are_those_of_the_solver(robot: bs.Robot) -> None:
    solution = unloaded(robot)
    data = solution.to_dataset(points=5).isel(time=0)
    position, rotation = rest_frames(robot, data["arc_length"].to_numpy())
    np.testing.assert_allclose(position, data["position"], atol=1e-14)
    np.testing.assert_allclose(rotation, data["rotation"], atol=1e-13)
    position, rotation = rest_frames(robot, robot.disks.station_m)
    np.testing.assert_allclose(position, solution.disk_positions, atol=1e-14)
    np.testing.assert_allclose(rotation, solution.disk_rotations, atol=1e-13)


@pytest.mark.parametrize("bend", [1e-12, 1e-8])
def test_frames_of_a_small_rest_bend_are_smooth(bend: float) -> None:
    robot = precurved(**{"segments.0.backbone.rest_bend": bend})
    position, rotation = rest_frames(robot, np.array([0.3, robot.length]))
    towards = np.array([math.cos(DIRECTION), math.sin(DIRECTION)])
    for s, p, r in zip((0.3, robot.length), position, rotation, strict=True):
        angle = bend * s / robot.length
        np.testing.assert_allclose(p[:2], 0.5 * s * angle * towards, rtol=1e-7)
        np.testing.assert_allclose(r[:2, 2], angle * towards, rtol=1e-7)
        assert p[2] == pytest.approx(s, rel=1e-14)


def test_bricks_follow_the_unloaded_shape() -> None:
    straight, robot = two_segments(), curved_tubes()
    plain, mesh = (brick_mesh(r, Fineness(16, 4, 1), mass_arms=True) for r in (straight, robot))
    assert plain.nodes is plain.straight
    np.testing.assert_array_equal(mesh.straight, plain.straight)
    _, slope = brick_shape(POINTS)
    volumes = [
        np.linalg.det(np.einsum("pnk,bni->bpki", slope, m.nodes[m.bricks])).sum(axis=1)
        for m in (plain, mesh)
    ]
    for which in (plain.arm, plain.stiff):  # rigid
        np.testing.assert_allclose(volumes[1][which], volumes[0][which], rtol=1e-9)
    free = ~plain.stiff  # Pappus: the section times the length of the centreline
    assert volumes[1][free].sum() == pytest.approx(volumes[0][free].sum(), rel=1e-4)
    holes = robot.tendon_points(*rest_frames(robot, robot.disks.station_m))
    for t, points in enumerate(holes):
        np.testing.assert_allclose(mesh.nodes[mesh.hole[: len(points), t]], points, atol=1e-15)


@pytest.mark.parametrize(
    "robot", [curved_tubes(), small_robot(**OBLIQUE)], ids=["tubes", "oblique"]
)
def test_fields_of_the_unloaded_bricks_are_those_of_the_solver(robot: bs.Robot) -> None:
    mesh = brick_mesh(robot, Fineness(16, 4, 1))
    free, spans = int((~mesh.stiff).sum()), len(deck.spans(mesh).first)
    nothing = np.zeros((free, 8, 6))
    rest = State(0.0 * mesh.nodes, None, nothing, nothing, np.zeros((spans, 3)))
    tensions = np.zeros((1, len(robot.tendons.end_disk)))
    found = frames(robot, mesh, np.zeros(1), tensions, [rest], [0.0, 0.0, 0.0])
    position, rotation = rest_frames(robot, found.station)
    np.testing.assert_allclose(found.position[0], position, atol=5e-7)  # interpolated
    np.testing.assert_allclose(found.rotation[0], rotation, atol=1e-5)
    np.testing.assert_allclose(found.tendon_length[0], unloaded(robot).tendon_lengths, atol=1e-14)
    np.testing.assert_allclose(found.tendon_displacement[0], 0.0, atol=1e-15)


def test_sliding_disks_have_the_axes_of_the_unloaded_backbone() -> None:
    robot = curved_tubes()
    mesh = brick_mesh(robot, Fineness(2, 4, 1))
    loading = deck.Loading((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1000.0, True, 1e-4)
    bonded = deck.model(robot, mesh, loading, [])
    assert "*ORIENTATION" not in bonded
    sliding = dataclasses.replace(loading, bonded=False)
    plain = brick_mesh(two_segments(), Fineness(2, 4, 1))
    assert "*ORIENTATION" not in deck.model(two_segments(), plain, sliding, [])
    text = deck.model(robot, mesh, sliding, [])
    rotation = rest_frames(robot, robot.disks.station_m)[1]
    axes = [line.split("\n")[1] for line in text.split("*ORIENTATION, ")[1:]]
    # the end disk of the first segment clamps a piece of the second segment too
    for row, disk in zip(axes, (0, 1, 1, 2, 3), strict=True):
        numbers = np.array(row.split(","), dtype=float)
        np.testing.assert_allclose(numbers, rotation[disk][:, :2].T.ravel(), atol=1e-10)
    held = np.flatnonzero(mesh.stiff & ~mesh.arm)
    sets = text.split("*ELSET, ELSET=")[1:]
    members = [v for part in sets for v in part.split("*")[0].split("\n", 1)[1].split(",")]
    found = sorted(int(v) - 1 for v in members if v.strip())
    np.testing.assert_array_equal(found, held)


@pytest.mark.parametrize("sliding", [False, True])
@needs_ccx
def test_finite_elements_of_a_precurved_backbone_under_a_tip_force(
    sliding: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within 1 % of the tip displacement (0.5 % seen), 0.1 % with sliding disks."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot = precurved(**SHORT)
    load = bs.Load([[0.0, 0.0, 0.0]], tip_force=[5.0, 10.0, -5.0])
    settings = Settings(Fineness(4, 8, 1), grip="sliding" if sliding else "bonded")
    solid = bs.fem.sweep(robot, load=load, settings=settings).raise_for_status()
    start = unloaded(robot).tip.position
    force = bs.Load([0.0, 0.0, 0.0], tip_force=load.tip_force)
    rod = bs.solve(robot, load=force).tip.position - start
    gap = np.linalg.norm(solid.tip_position[0] - start - rod) / np.linalg.norm(rod)
    assert gap < (0.001 if sliding else 0.01)


@pytest.mark.parametrize("twist", [0.0, TWIST])
@needs_ccx
def test_finite_elements_of_a_precurved_tapered_robot_with_oblique_tendons(
    twist: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within 1 % of the tip displacement (0.5 % seen), and not of a straight backbone."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    changes = SHORT | CONE | OBLIQUE
    robot, straight = precurved(twist, **changes), bs.load_robot("amouri2019", changes)
    tensions = np.array([[40.0, 5.0, 0.0]])
    settings = Settings(Fineness(4, 8, 1))
    run = bs.fem.sweep(robot, tensions, settings=settings).raise_for_status()
    solid = run.tip_position[0] - unloaded(robot).tip.position
    rod, other = (
        bs.solve(r, tensions[0]).tip.position - unloaded(r).tip.position for r in (robot, straight)
    )
    assert np.linalg.norm(solid - rod) < 0.01 * np.linalg.norm(rod)
    assert np.linalg.norm(solid - other) > 0.2 * np.linalg.norm(rod)
    assert run.span_error < 1e-5


@pytest.mark.cad
@pytest.mark.parametrize("twist", [0.0, 4.0 * math.pi])
def test_the_solid_without_a_pose_is_the_unloaded_shape(twist: float) -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    tube = {"inner_diameter": "3 mm", "end_inner_diameter": "1.5 mm"}
    bore = {f"segments.0.backbone.{name}": value for name, value in tube.items()}
    robot = precurved(twist, **CLAMPED, **CONE, **OBLIQUE, **bore)
    solid = bs.make_solid(robot)
    assert not solid.posed and all(part.shape.is_valid for part in solid.parts)
    # the volume swept by the section, as of straight cones
    areas = [robot.segments[0].backbone.at(x).area for x in (0.0, 0.5, 1.0)]
    swept = robot.length * float(np.dot(areas, [1.0, 4.0, 1.0])) / 6.0
    assert solid["backbone"].volume_m3 == pytest.approx(swept, rel=1e-9)
    solution = unloaded(robot)
    for d, (place, turned) in enumerate(
        zip(solution.disk_positions, solution.disk_rotations, strict=True), 1
    ):
        disk = solid[f"disk_{d}"]
        np.testing.assert_allclose(disk.centre_m, place, atol=1e-12)
        (top, *_) = (
            face
            for face in disk.shape.faces()
            if face.is_planar and np.dot(tuple(face.normal_at()), turned[:, 2]) > 0.5
        )
        np.testing.assert_allclose(tuple(top.normal_at()), turned[:, 2], atol=1e-12)
    for t, length in enumerate(solution.tendon_lengths, 1):
        area = math.pi / 4 * solid.sizes.tendon_m[t - 1] ** 2
        assert solid[f"tendon_{t}"].volume_m3 == pytest.approx(area * length, rel=1e-9)


@pytest.mark.cad
def test_a_twisted_straight_backbone_turns_the_disks() -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    robot = precurved(TWIST, **{"segments.0.backbone.rest_bend": 0.0})
    solid = bs.make_solid(robot)
    expected = math.pi * 0.0025**2 * robot.length
    assert solid["backbone"].volume_m3 == pytest.approx(expected, rel=1e-9)
    end = 0.029 * np.array([math.cos(TWIST), math.sin(TWIST)])
    np.testing.assert_allclose(solid.tendon_paths[0][-1], [*end, robot.length], atol=1e-15)


@pytest.mark.cad
def test_a_rest_bend_tighter_than_the_backbone_is_refused() -> None:
    pytest.importorskip("build123d", exc_type=ImportError)
    robot = precurved(
        **CLAMPED,
        **{"segments.0.backbone.rest_bend": "3600 deg", "segments.0.backbone.diameter": "21 mm"},
    )
    with pytest.raises(InputError, match=r"rest_bend is 3600 deg; the solid takes less than 3498"):
        bs.make_solid(robot)
    with pytest.raises(InputError, match=r"rest_bend is 3600 deg; a mesh takes less than 3498"):
        brick_mesh(robot, Fineness())


def test_bricks_that_are_bent_too_far_are_refused() -> None:
    robot = small_robot(**{"segments.0.backbone.rest_bend": "1800 deg"})
    brick_mesh(robot, Fineness(40, 4, 1))
    with pytest.raises(InputError, match="too far in one brick; finite elements need more bricks"):
        brick_mesh(robot, Fineness(2, 4, 1))
