"""Polynomial curvature: exact shapes, fits that recover them, predictions from loads."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.constant_curvature import (
    RobotArcs,
    VariableCurvature,
    curvature_from_loads,
    fit_curvature,
)
from bowstring.constant_curvature.curvature_models import polyline_curvature
from bowstring.errors import InputError

ROBOT = bs.load_robot("amouri2019")
THREE = bs.load_robot("crl-ftdcr-v4")
TENSIONS = np.outer([10.0, 40.0, 80.0], [1.0, 0.0, 0.0])


def clothoid(
    bend: float, slope: float, direction: float, stations: Floats, length: float
) -> Floats:
    """Points (n, 3) of the curve with the angle bend x + slope (x^2 - x) of its tangent."""

    def along(of: object, end: float) -> float:
        value, _ = quad(of, 0.0, end, epsabs=1e-13, epsrel=1e-13)
        return float(value)

    def angle(x: float) -> float:
        return bend * x + slope * (x * x - x)

    out = []
    for s in stations / length:
        side = along(lambda x: math.sin(angle(x)), s)
        out.append(
            [
                side * math.cos(direction),
                side * math.sin(direction),
                along(lambda x: math.cos(angle(x)), s),
            ]
        )
    return length * np.array(out)


def rms(shape: VariableCurvature, disks: Floats) -> Floats:
    """RMS of the distance over the disks (K,), m."""
    away = np.linalg.norm(shape.disk_positions - disks, axis=-1)
    return np.asarray(np.sqrt(np.mean(away**2, axis=-1)))


def drawn(rng: np.random.Generator, robot: bs.Robot, degree: int, count: int = 4) -> Floats:
    size = np.array([1.2, 0.8, 0.5, 0.3])[: degree + 1, None]
    return np.asarray(rng.normal(size=(count, len(robot.segments), degree + 1, 2)) * size)


# -- shapes ------------------------------------------------------------------------------------


@pytest.mark.parametrize("slope", [0.0, 0.7, -2.5])
def test_linear_curvature_in_a_plane_is_a_clothoid(slope: float) -> None:
    bend, direction = 1.4, 2.1
    true = clothoid(bend, slope, direction, ROBOT.disks.station_m, ROBOT.length)
    towards = np.array([math.cos(direction), math.sin(direction)])
    # angle' = bend + slope (2 x - 1)
    shape = VariableCurvature(ROBOT, np.outer([bend, slope], towards)[None])
    assert np.abs(shape.disk_positions - true).max() < 1e-9 * ROBOT.length
    assert shape.tip.rotation[:, 2] == pytest.approx(
        [*(math.sin(bend) * towards), math.cos(bend)], abs=1e-9
    )
    found = fit_curvature(ROBOT, true, 1)
    assert found.bend[0] == pytest.approx(shape.bend[0], abs=1e-8)
    assert rms(found, true) < 1e-9 * ROBOT.length
    ends = found.curvature(0, [0.0, 1.0]) * ROBOT.length
    assert ends == pytest.approx(np.outer([bend - slope, bend + slope], towards), abs=1e-7)


@pytest.mark.parametrize("robot", [ROBOT, THREE], ids=["one segment", "three segments"])
def test_degree_zero_is_constant_curvature(robot: bs.Robot) -> None:
    bend = drawn(np.random.default_rng(1), robot, 0)
    arcs = bs.constant_curvature.Arc.from_bend(
        np.concatenate(
            [
                bend[..., 0, :],
                np.broadcast_to([[s.length] for s in robot.segments], (*bend.shape[:2], 1)),
            ],
            axis=-1,
        )
    )
    shape, known = VariableCurvature(robot, bend), RobotArcs(robot, arcs)
    assert shape.disk_positions == pytest.approx(known.disk_positions, abs=1e-12)
    assert shape.disk_rotations == pytest.approx(known.disk_rotations, abs=1e-12)
    assert shape.tip.position == pytest.approx(known.tip.position, abs=1e-12)


def test_a_curve_in_space_is_that_of_the_frame_equation() -> None:
    """Against R' = R [u] and p' = R e3, integrated by a method of eighth order."""
    bend = drawn(np.random.default_rng(5), THREE, 3, 1)[0]
    state = np.concatenate([np.zeros(3), np.eye(3).ravel()])
    for k, segment in enumerate(THREE.segments):

        def rate(x: float, y: Floats, k: int = k, length: float = segment.length) -> Floats:
            t = 2.0 * x - 1.0
            basis = [1.0, t, 0.5 * (3.0 * t**2 - 1.0), 0.5 * (5.0 * t**3 - 3.0 * t)]
            u, v = basis @ bend[k]
            spin = np.array([[0.0, 0.0, u], [0.0, 0.0, v], [-u, -v, 0.0]])
            frame = y[3:].reshape(3, 3)
            return np.concatenate([length * frame[:, 2], (frame @ spin).ravel()])

        whole = solve_ivp(rate, (0.0, 1.0), state, "DOP853", rtol=1e-12, atol=1e-13)
        state = whole.y[:, -1]
    tip = VariableCurvature(THREE, bend).tip
    assert tip.position == pytest.approx(state[:3], abs=1e-8 * THREE.length)
    assert tip.rotation.ravel() == pytest.approx(state[3:], abs=1e-7)


def test_the_jacobian_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(2)
    bend, way = drawn(rng, THREE, 2), rng.normal(size=(4, 3, 3, 2))
    step = 1e-6
    ahead, behind = (
        VariableCurvature(THREE, bend + sign * step * way).disk_positions for sign in (1.0, -1.0)
    )
    exact = np.einsum("kncsjq,ksjq->knc", VariableCurvature(THREE, bend).disk_jacobian(), way)
    assert exact == pytest.approx((ahead - behind) / (2.0 * step), abs=1e-8)


def test_the_centerline_passes_through_the_disks() -> None:
    shape = VariableCurvature(THREE, drawn(np.random.default_rng(4), THREE, 2, 1)[0])
    line = shape.centerline()
    gaps = np.linalg.norm(line[:, None] - shape.disk_positions, axis=-1).min(axis=0)
    assert line[0].tolist() == [0.0, 0.0, 0.0] and gaps.max() < 1e-12


# -- fits --------------------------------------------------------------------------------------


@pytest.mark.parametrize("robot", [ROBOT, THREE], ids=["one segment", "three segments"])
@pytest.mark.parametrize("degree", [0, 1, 2])
def test_a_shape_of_the_family_is_recovered(robot: bs.Robot, degree: int) -> None:
    bend = drawn(np.random.default_rng(7), robot, degree)
    disks = VariableCurvature(robot, bend).disk_positions
    for order in range(degree, 3):  # the higher families contain it
        found = fit_curvature(robot, disks, order)
        assert found.bend[:, :, : degree + 1] == pytest.approx(bend, abs=1e-7)
        assert rms(found, disks).max() < 1e-9 * robot.length


@pytest.mark.parametrize(
    ("robot", "load"),
    [
        (ROBOT, bs.Load(tip_force=[0.1, 0.4, 0.2])),
        (ROBOT.with_({"segments.0.tendons.end_pitch_radius": "15 mm"}), bs.Load()),
        (ROBOT.with_({"segments.0.backbone.rest_bend": "40 deg"}), bs.Load(gravity=[3, 2, -5])),
    ],
    ids=["tip force", "converging", "precurved"],
)
def test_errors_do_not_grow_with_the_degree(robot: bs.Robot, load: bs.Load) -> None:
    disks = bs.sweep(robot, TENSIONS, load=load, disks=True).disk_positions
    assert disks is not None
    errors = [rms(fit_curvature(robot, disks, degree), disks) for degree in range(4)]
    for more, less in pairwise(errors):
        assert (less <= more + 1e-9 * robot.length).all()
    assert (errors[2] < 0.2 * errors[0]).all()  # and these shapes are no arcs


def test_fits_are_objective() -> None:
    """A turn about the axis of the base turns the curvature vectors."""
    load = bs.Load(tip_force=[0.1, 0.4, 0.2])
    disks = bs.sweep(ROBOT, TENSIONS, load=load, disks=True).disk_positions
    assert disks is not None
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    here, there = (fit_curvature(ROBOT, d, 2) for d in (disks, disks @ turn.T))
    assert there.bend == pytest.approx(here.bend @ turn[:2, :2].T, abs=1e-7)


def test_a_fit_of_degree_zero_is_the_best_arc() -> None:
    """Of one segment, against a minimiser that knows nothing of it."""
    from scipy.optimize import minimize

    sweep = bs.sweep(ROBOT, TENSIONS, load=bs.Load(gravity=[0.0, 9.81, 0.0]), disks=True)
    disks = sweep.disk_positions
    assert disks is not None
    found = fit_curvature(ROBOT, disks, 0)
    length = ROBOT.length

    def squared(bend: Floats) -> float:
        arcs = RobotArcs(ROBOT, bs.constant_curvature.Arc.from_bend([[*bend, length]]))
        return float(np.sum(((arcs.disk_positions - disks[1]) / length) ** 2))

    best = minimize(squared, [0.5, 0.5], method="Nelder-Mead", options={"xatol": 1e-9}).x
    assert found.bend[1, 0, 0] == pytest.approx(best, abs=1e-5)


def test_the_curvature_of_a_polyline_is_that_of_its_arcs() -> None:
    shape = VariableCurvature(ROBOT, np.array([[[[1.2, -0.5]]]]))
    edges, curvature = polyline_curvature(ROBOT, shape.disk_positions)
    assert edges[0] == 0.0 and len(edges) == 10
    assert curvature[0] * ROBOT.length == pytest.approx(np.tile([1.2, -0.5], (9, 1)), abs=1e-9)


@pytest.mark.parametrize(
    ("disks", "degree", "message"),
    [
        (np.zeros((3, 8, 3)), 1, r"disks has shape \(3, 8, 3\), it must be \(..., 9, 3\)"),
        (np.full((9, 3), np.nan), 1, "a position that is not finite"),
        (np.zeros((9, 3)), 6, "degree is 6, it must be a whole number from 0 to 5"),
        (np.zeros((9, 3)), 1.5, "degree is 1.5, it must be a whole number"),
    ],
)
def test_bad_shapes_are_refused(disks: Floats, degree: int, message: str) -> None:
    with pytest.raises(InputError, match=message):
        fit_curvature(ROBOT, disks, degree)


def test_too_few_disks_are_refused() -> None:
    few = ROBOT.with_({"segments.0.disks.count": 2})
    disks = bs.solve(few, [10, 0, 0]).disk_positions
    assert fit_curvature(few, disks, 0).degree == 0
    with pytest.raises(InputError, match="a segment of amouri2019 has 2 disks; a curvature of"):
        fit_curvature(few, disks, 1)
    with pytest.raises(InputError, match=r"bend has shape \(2, 1, 2\), it must be"):
        VariableCurvature(ROBOT, np.zeros((2, 1, 2)))


# -- predictions -------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_without_dead_loads_it_is_the_linear_law(degree: int) -> None:
    rng = np.random.default_rng(3)
    for robot in (ROBOT, THREE, ROBOT.with_({"segments.0.backbone.rest_bend": "40 deg"})):
        tensions = rng.uniform(0.0, 3.0, (5, len(robot.tendons.segment)))
        found = curvature_from_loads(robot, tensions, degree)
        law = RobotArcs.from_tensions(robot, tensions)
        assert found.disk_positions == pytest.approx(law.disk_positions, abs=1e-10)


def test_converging_tendons_bend_by_their_moment() -> None:
    """The pitch radius falls from 29 to 15 mm, so the curvature is linear: F r(s) / EI."""
    robot = ROBOT.with_({"segments.0.tendons.end_pitch_radius": "15 mm"})
    found = curvature_from_loads(robot, [50.0, 0.0, 0.0], 1)
    radii = np.array([float(robot.tendons.pitch_radius_m[0]), 0.015])
    expected = 50.0 * radii / float(robot.bending_stiffness[0])
    assert found.curvature(0, [0.0, 1.0])[:, 0] == pytest.approx(expected, rel=1e-9)
    assert found.curvature(0, [0.0, 1.0])[:, 1] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_small_deflections_are_those_of_a_cantilever() -> None:
    stiffness, length = float(ROBOT.bending_stiffness[0]), ROBOT.length
    force = 1e-4
    found = curvature_from_loads(ROBOT, [0, 0, 0], 1, tip_force=[0.0, force, 0.0])
    assert found.tip.position[1] == pytest.approx(force * length**3 / (3 * stiffness), rel=1e-6)
    # moment F (l - s): largest at the base, none at the tip
    ends = found.curvature(0, [0.0, 1.0])
    assert ends[:, 1] == pytest.approx([force * length / stiffness, 0.0], abs=1e-9)


def test_predictions_converge_to_a_rod_without_torsion() -> None:
    """Of many disks: a continuous Kirchhoff rod in the plane, under weight and tip force."""
    fine = ROBOT.with_({"segments.0.disks.count": 60, "segments.0.disks.mass": "3 g"})
    rod = bs.RodModel("kirchhoff", "continuous", twist=False)
    load = bs.Load(gravity=[-9.81, 0.0, 0.0], tip_force=[0.1, 0.0, 0.2])
    sweep = bs.sweep(fine, TENSIONS, load=load, model=rod)
    errors = []
    for degree in (0, 1, 2, 4):
        found = curvature_from_loads(
            fine, TENSIONS, degree, gravity=load.gravity, tip_force=load.tip_force
        )
        away = np.linalg.norm(found.tip.position - sweep.tip_position, axis=-1)
        errors.append(float(away.max()) / fine.length)
    assert errors[0] > 0.01 > 1e-3 > errors[2] > errors[3]
    assert errors[3] < 2e-4


def test_a_backbone_that_buckles_has_no_prediction() -> None:
    stiffness, length = float(ROBOT.bending_stiffness[0]), ROBOT.length
    critical = math.pi**2 * stiffness / (4.0 * length**2)
    forces = [0.9 * critical, 1.1 * critical]
    known = [
        np.isfinite(curvature_from_loads(ROBOT, [0, 0, 0], 2, tip_force=[0, 0, -f]).bend).all()
        for f in forces
    ]
    assert known == [True, False]


def test_a_rest_twist_turns_curvature_and_holes() -> None:
    """Against a continuous Kirchhoff rod, whose axis is a helix."""
    robot = ROBOT.with_(
        {"segments.0.backbone.rest_bend": "40 deg", "segments.0.backbone.rest_twist": "60 deg"}
    )
    rod = bs.RodModel("kirchhoff", "continuous", twist=False)
    free = bs.solve(robot, [0, 0, 0], model=rod)
    found = curvature_from_loads(robot, [0, 0, 0], 4)
    assert found.tip.position == pytest.approx(free.tip.position, abs=1e-4 * robot.length)


def test_negative_tensions_are_refused() -> None:
    with pytest.raises(InputError, match="tension 2 is -3 N; tensions must be >= 0 N"):
        curvature_from_loads(ROBOT, [0, -3, 0], 1)
