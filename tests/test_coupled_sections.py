"""Backbones by a full 6x6 stiffness matrix, against the integrated rod and in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import curve_fit
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.dynamics import modes
from objects import PLAIN_STIFFNESS, coupled_robot, coupled_stiffness
from shooting import Shooting

LENGTH = 0.4


def _solve(robot: bs.Robot, tensions: Any, model: Any = None, **load: Any) -> bs.Solution:
    return bs.solve(robot, tensions, load=bs.Load(**load), model=model)


def _integrated(
    found: bs.Solution, stiffness: np.ndarray, *loads: bs.PointLoad
) -> tuple[np.ndarray, np.ndarray]:
    """Tip of the rod of a solution under these loads, by shooting."""
    positions, turns = Shooting(found.robot, found, list(loads), stiffness).solve()
    return positions[-1], turns[-1]


@pytest.mark.parametrize(("seed", "share"), [(1, 0.3), (2, 0.6), (3, 0.8)])
def test_a_tip_wrench_bends_the_rod_as_integrated(seed: int, share: float) -> None:
    stiffness = coupled_stiffness(seed, share)
    force, moment = np.array([0.4, -0.3, -0.2]), np.array([0.02, 0.03, -0.02])
    found = _solve(coupled_robot(stiffness), tensions=[0.0] * 3, tip_force=force, tip_moment=moment)
    at_tip = bs.PointLoad(arc_length=LENGTH, force=force, moment=moment)
    position, rotation = _integrated(found, stiffness, at_tip)
    assert np.linalg.norm(found.tip.position - position) < found.error_estimate.tip
    assert found.error_estimate.tip < 1e-5 * LENGTH
    assert abs(found.tip.rotation - rotation).max() < 5e-5


def test_tendons_bend_the_rod_as_integrated() -> None:
    """The forces of the spans, by the solved poses, on the rod's equations from the base."""
    stiffness = coupled_stiffness(8, 0.7)
    found = _solve(coupled_robot(stiffness), np.array([7.0, 2.0, 4.0]))
    rod = Shooting(found.robot, found, [], stiffness)
    force, moment = rod.on_disks.sum(axis=0)
    moment = moment + np.cross(found.disk_positions, rod.on_disks[:, 0]).sum(axis=0)
    left, positions, _ = rod.shoot(np.concatenate([force, moment]))
    off = np.linalg.norm(positions - found.disk_positions, axis=1)
    assert abs(left).max() < 1e-6 and off.max() < 1e-6 * LENGTH
    assert off[-1] < found.error_estimate.tip


def test_without_couplings_it_is_the_plain_robot() -> None:
    young, poisson, diameter = 35e9, 0.3, 0.005
    area, second = np.pi / 4 * diameter**2, np.pi / 64 * diameter**4
    shear = young / (2 * (1 + poisson))
    plain = bs.load_robot("amouri2019")
    matrix = np.diag([young * second] * 2 + [2 * shear * second, *[shear * area] * 2, young * area])
    fields = ("E", "nu", "density", "diameter")
    robot = plain.with_(
        {f"segments.0.backbone.{name}": None for name in fields}
        | {
            "segments.0.backbone.stiffness": matrix.tolist(),
            "segments.0.backbone.mass_per_length": 1800.0 * area,
        }
    )
    load: dict[str, Any] = {"tensions": [60, 10, 0], "tip_force": [0.5, -0.2, 0.1]}
    a, b = _solve(plain, **load), _solve(robot, **load)
    assert abs(a.tip.position - b.tip.position).max() < 1e-12
    assert abs(a.tip.rotation - b.tip.rotation).max() < 1e-12
    assert robot.mass_per_length == pytest.approx(plain.mass_per_length, rel=1e-14)
    assert robot.bending_stiffness == pytest.approx(plain.bending_stiffness, rel=1e-12)


def test_a_pull_turns_the_tip_of_a_spiral() -> None:
    stiffness = PLAIN_STIFFNESS.copy()
    stiffness[2, 5] = stiffness[5, 2] = 4.0
    pull = 3.0
    found = _solve(coupled_robot(stiffness), tensions=[0.0] * 3, tip_force=[0, 0, pull])
    twist, extension = np.linalg.solve(stiffness[np.ix_([2, 5], [2, 5])], [0.0, pull])
    turned = Rotation.from_matrix(found.tip.rotation).as_rotvec()
    assert turned == pytest.approx([0.0, 0.0, twist * LENGTH], rel=1e-12, abs=1e-12)
    expected = [0.0, 0.0, (1.0 + extension) * LENGTH]
    assert found.tip.position == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_tip_on_a_plane_bends_the_rod_as_integrated() -> None:
    """Under load and contact force together; the tip is on the plane, which only pushes."""
    stiffness, pull = coupled_stiffness(2, 0.6), np.array([0.5, -0.2, -0.1])
    load = bs.Load([0.0] * 3, tip_force=pull)
    free = bs.solve(coupled_robot(stiffness), load=load).tip.position
    plane = bs.Plane([0.6 * free[0], 0.0, 0.0], [-1.0, 0.2, 0.1])
    contact = bs.solve_contact(coupled_robot(stiffness), load=load, plane=plane).raise_for_status()
    tip, turn = contact.solution.tip.position, contact.solution.tip.rotation
    assert contact.state == "sliding" and contact.stable is True
    assert contact.normal_force > 0.05 and abs(plane.gap(tip)) < 1e-9 * LENGTH
    assert abs(contact.force - contact.normal_force * np.array(plane.normal)).max() < 1e-12
    at_tip = bs.PointLoad(arc_length=LENGTH, force=pull + contact.force)
    position, rotation = _integrated(contact.solution, stiffness, at_tip)
    assert np.linalg.norm(tip - position) < contact.solution.error_estimate.tip < 1e-5 * LENGTH
    assert abs(turn - rotation).max() < 5e-5


def test_turned_axes_turn_a_path_on_a_plane_with_friction() -> None:
    stiffness, angle = coupled_stiffness(4, 0.7), 2.0 * np.pi / 3.0
    turn = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    both = np.kron(np.eye(2), turn)
    rows = np.array([[x, 1.0, 2.0] for x in (3.0, 6.0, 9.0, 6.0)])
    free = bs.sweep(coupled_robot(stiffness), rows).tip_position
    point, normal = free[1], np.array([-1.0, 0.4, 0.2])
    here = bs.sweep_contact(coupled_robot(stiffness), rows, plane=bs.Plane(point, normal, 0.3))
    there = bs.sweep_contact(
        coupled_robot(both @ stiffness @ both.T),
        np.roll(rows, 1, axis=1),
        plane=bs.Plane(turn @ point, turn @ normal, 0.3),
    )
    states = [found.state for found in here]
    assert states[0] == "separated" and states[2] != "separated"
    for a, b in zip(here, there, strict=True):
        assert a.converged and b.converged and a.state == b.state
        tips = [found.solution.tip.position for found in (a, b)]
        assert abs(turn @ tips[0] - tips[1]).max() < 1e-8 * LENGTH
        assert abs(turn @ a.force - b.force).max() < 1e-6


def test_strains_along_the_backbone_are_those_of_the_matrix() -> None:
    stiffness = coupled_stiffness(9, 0.8)
    robot = coupled_robot(stiffness, backbone={"rest_twist": "40 deg"}, gravity="0 1 -9.81 m/s^2")
    found = _solve(robot, [6.0, 2.0, 1.0]).to_dataset()
    wrench = np.concatenate([found.moment, found.force], axis=-1)[0]
    strain = np.concatenate([found.curvature, found.strain], axis=-1)[0]
    strain[:, 2] -= np.deg2rad(40.0) / LENGTH
    assert strain @ stiffness == pytest.approx(wrench, rel=1e-9, abs=1e-9)
    assert np.isnan(found.von_mises).all()


@pytest.mark.parametrize("seed", [2, 9])
def test_small_motions_have_the_frequency_of_the_modes_and_its_damping(seed: int) -> None:
    """Released in the shape of the first mode, without other loads: Kelvin-Voigt damping then has
    the ratio omega tau / 2."""
    robot, model = coupled_robot(coupled_stiffness(seed, 0.8), 3), bs.RodModel(elements=2)
    first = modes(robot, [0.0] * 3, model=model, count=1)
    shape, period = first.displacement[0], 1.0 / first.frequency_hz[0]
    omega = 2.0 * np.pi / period
    place = np.array([[0.0, 0.0, z] for z in robot.disks.station_m])
    for ratio in (0.0, 0.02):
        steps = bs.Integrator(
            dt=period / 200.0, spectral_radius=1.0, material_damping=2.0 * ratio / omega
        )
        run = bs.simulate(
            robot,
            [0.0] * 3,
            3.0 * period,
            start=bs.Start(disk_forces=1e-3 * shape),
            model=model,
            integrator=steps,
            output=bs.Output(every=period / 50.0),
        ).raise_for_status()
        position = run.to_dataset()["disk_position"].to_numpy()
        moved = np.einsum("tka,ka->t", position - place, shape)

        def decaying(t: np.ndarray, x: float, y: float, w: float, decay: float) -> np.ndarray:
            return np.asarray(np.exp(-decay * t) * (x * np.cos(w * t) + y * np.sin(w * t)))

        guess = [moved[0], 0.0, 1.02 * omega, 0.01 * omega]
        found = curve_fit(decaying, run.time, moved, guess)[0]
        assert abs(decaying(run.time, *found) - moved).max() < 2e-3 * abs(moved).max()
        assert found[2] == pytest.approx(omega * np.sqrt(1.0 - ratio**2), rel=5e-4)
        assert found[3] / omega == pytest.approx(ratio, rel=1e-3, abs=1e-5)


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_a_column_buckles_at_the_softer_of_its_coupled_bends(theory: str) -> None:
    """At Euler's load with the softer bend; with shear and extension, coupled to nothing, at P with
    P (1 + P/GA - P/EA) equal to it, 1.4 % lower."""
    stiffness = PLAIN_STIFFNESS.copy()
    stiffness[0, 1] = stiffness[1, 0] = 0.04
    stiffness[0, 2] = stiffness[2, 0] = 0.03
    stiffness[3:, 3:] = np.diag([15.0, 15.0, 60.0])
    soft = 1.0 / np.linalg.eigvalsh(np.linalg.inv(stiffness)[:2, :2])[-1]
    critical = euler = (np.pi / (2.0 * LENGTH)) ** 2 * soft
    if theory == "cosserat":
        softer = 1.0 / 15.0 - 1.0 / 60.0
        critical = (np.sqrt(1.0 + 4.0 * euler * softer) - 1.0) / (2.0 * softer)
        assert critical < 0.987 * euler
    robot = coupled_robot(stiffness)
    model = bs.RodModel(theory, elements=8)
    push = bs.Load([0.0] * 3, tip_force=[0.0, 0.0, -critical])
    found = bs.critical_load(robot, load=push, model=model)
    assert found.kind == "bifurcation" and found.factor == pytest.approx(1.0, rel=1e-3)
    for share, stable in ((0.995, True), (1.005, False)):
        search = bs.BranchSearch(max_factor=share, deflation=False)
        straight = bs.branch_diagram(robot, load=push, model=model, search=search).branches[0]
        assert straight.factor[-1] == pytest.approx(share, rel=1e-9)
        assert abs(straight.tip_position[:, :2]).max() < 1e-9
        assert straight.stable[-1] is stable
        # a solve goes on to a stable equilibrium
        bent = _solve(robot, [0.0] * 3, model, tip_force=[0.0, 0.0, -share * critical])
        assert bent.converged and bent.stable is True
        across = np.linalg.norm(bent.tip.position[:2])
        assert across < 1e-9 if stable else across > 0.01 * LENGTH


@pytest.mark.parametrize(("seed", "at"), [(1, 0.3), (2, 0.55), (3, 0.97)])
def test_a_wrench_between_disks_bends_the_rod_as_integrated(seed: int, at: float) -> None:
    """Elements do not refine shear and extension, whose part of the error stays."""
    stiffness = coupled_stiffness(seed, 0.7)
    force, moment = np.array([0.5, -0.4, -0.3]), np.array([0.02, 0.03, -0.02])
    on_section = bs.PointLoad(arc_length=at * LENGTH, force=force, moment=moment)
    found = _solve(coupled_robot(stiffness), tensions=[0.0] * 3, point_loads=[on_section])
    assert found.stable is True
    tip, rotation = _integrated(found, stiffness, on_section)
    # the estimate is itself an approximation
    assert np.linalg.norm(found.tip.position - tip) < 1.02 * found.error_estimate.tip
    assert found.error_estimate.tip < 2e-5 * LENGTH
    assert abs(found.tip.rotation - rotation).max() < 5e-5
