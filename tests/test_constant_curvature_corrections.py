"""Corrected constant curvature of robots: straight spans, clamped lengths, holes of thick disks."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.optimize import minimize

import bowstring as bs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import Robot
from bowstring.statics import rod
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.study.comparison import poses_by_arcs
from bowstring.validity.loading import largest_load

PLAIN = {"gravity": "0 0 0"}
THICK = {
    **PLAIN,
    "segments.0.disks.clamped_length": "6 mm",
    "segments.0.disks.hole_length": "4 mm",
    "segments.0.disks.thickness": "4 mm",
}


def robot(tmp_path, seed: int) -> tuple[Robot, np.ndarray]:
    """A random robot of one segment without weight, and shares of its tensions."""
    rng = np.random.default_rng(seed)
    count, length = int(rng.integers(4, 17)), rng.uniform(0.1, 0.8)
    spacing = np.ones(count) if rng.random() < 0.3 else rng.uniform(0.5, 1.5, count)
    stations = np.cumsum(spacing) * length / spacing.sum()
    least = np.diff(stations, prepend=0.0).min()
    radius = rng.uniform(0.015, 0.06) * length
    clamped = rng.uniform(0.0, 0.35) * least
    thickness = clamped if rng.random() < 0.6 else rng.uniform(0.0, 0.35) * least
    hole = 0.0 if rng.random() < 0.4 else thickness
    tendons = int(rng.integers(3, 7))
    places = " ".join(f"{1e3 * x:.12g}" for x in stations)
    path = tmp_path / "robot.yaml"
    path.write_text(
        f"""
segments:
  - length: {1e3 * stations[-1]:.12g} mm
    backbone: {{E: 60 GPa, nu: 0.33, density: 0 kg/m^3,
               diameter: {2e3 * radius * rng.uniform(0.03, 0.15)} mm}}
    disks: {{positions: {places} mm, thickness: {1e3 * thickness} mm, mass: 0 g,
            clamped_length: {1e3 * clamped} mm, hole_length: {1e3 * hole} mm,
            radius: {1.3e3 * radius} mm}}
    tendons: {{count: {tendons}, pitch_radius: {1e3 * radius} mm}}
"""
    )
    shares = np.zeros(tendons)
    first = int(rng.integers(tendons))
    shares[first] = 1.0
    if rng.random() < 0.5:
        shares[(first + 1) % tendons] = rng.uniform()
    return bs.load_robot(path), shares


def gains(robot: Robot, shares: np.ndarray) -> list[float]:
    """Corrected over uncorrected mean tip error against the rod, from force and from lengths."""
    tension = np.linspace(0.0, largest_load(robot, shares, RodModel("cosserat")), 17)
    tensions = tension[:, None] * shares
    exact = rod.sweep(robot, tensions, load=Load(gravity=(0, 0, 0)), model=RodModel("cosserat"))
    out = []
    for name, corrected, commands in (
        ("cc_from_force", "cc_from_force_arm", tensions),
        ("cc_from_lengths", "cc_from_lengths_chord", exact.tendon_lengths),
    ):
        plain, better = (
            np.linalg.norm(poses_by_arcs(robot, each, commands)[0] - exact.tip_position, axis=1)
            for each in (name, corrected)
        )
        known = np.isfinite(better)
        assert known.sum() >= 14  # the law of force ends where a module buckles
        out.append(better[known].mean() / plain[known].mean())
    return out


@pytest.mark.parametrize("count", [60, pytest.param(500, marks=pytest.mark.slow)])
def test_a_tenth_of_the_error_is_left(tmp_path, count):
    found = np.array([gains(*robot(tmp_path, seed)) for seed in range(count)])
    assert np.all(np.mean(found < 0.1, axis=0) >= 0.9), np.mean(found < 0.1, axis=0)
    assert np.all(found.max(axis=0) < 0.8)


def holes_of(robot: Robot, arcs: RobotArcs) -> np.ndarray:
    """Length (..., T) of the paths through the planes of the holes, from the disks' poses."""
    paths = robot.tendon_points(arcs.disk_positions, arcs.disk_rotations)
    lengths = [np.linalg.norm(np.diff(path, axis=-2), axis=-1).sum(axis=-1) for path in paths]
    return np.stack(lengths, axis=-1)


@pytest.mark.parametrize("seed", range(6))
def test_lengths_are_those_from_hole_to_hole(tmp_path, seed):
    one, shares = robot(tmp_path, seed)
    tensions = np.linspace(0.05, 0.3, 4)[:, None] * largest_load(one, shares, RodModel()) * shares
    arcs = RobotArcs.from_tensions(one, tensions, "arm")
    # the term of modules with two different ends is an expansion
    np.testing.assert_allclose(arcs.lengths(), holes_of(one, arcs), atol=1e-6 * one.length)
    again = RobotArcs.from_lengths(one, arcs.lengths(), "chord")
    np.testing.assert_allclose(again.lengths(), arcs.lengths(), atol=1e-14)
    np.testing.assert_allclose(again.theta, arcs.theta, rtol=2e-3)
    np.testing.assert_allclose(again.module_bends.sum(axis=-1), again.theta[:, 0], rtol=1e-13)
    assert np.linalg.norm(again.disk_positions[:, -1] - again.tip.position) < 1e-15


def test_the_built_in_robot_has_the_closed_forms():
    """Equal modules without clamps: theory Eq. 1.6, and Eq. 1.10 with a = theta/n."""
    plain = bs.load_robot("amouri2019")
    length, radius, n = plain.length, 0.029, 9
    lengths = length + np.random.default_rng(2).uniform(-0.02, 0.02, (50, 3))
    l1, l2, l3 = lengths.T
    root = np.sqrt(l1**2 + l2**2 + l3**2 - l1 * l2 - l2 * l3 - l1 * l3)
    a = 2.0 * np.arcsin(root / (3.0 * radius * n))
    got = RobotArcs.from_lengths(plain, lengths, "chord")
    np.testing.assert_allclose(got.theta[:, 0], n * a, rtol=1e-10)
    mean = lengths.mean(axis=1) * (a / 2.0) / np.sin(a / 2.0)
    np.testing.assert_allclose(got.length[:, 0], mean, rtol=1e-12)

    force, moment = 80.0, 80.0 * radius
    stiffness = plain.bending_stiffness[0]
    theta = RobotArcs.from_tensions(plain, [force, 0, 0], "arm").theta[0]
    arm = moment + force * length / n * (theta / n) / 12 - moment * (theta / n) ** 2 / 8
    assert theta == pytest.approx(length / stiffness * arm, rel=1e-12)


def test_equal_modules_end_like_one_arc(tmp_path):
    """Clamped c at both ends: one arc of length n (f + c a cot(a/2)). The base clamps nothing."""
    thick = bs.load_robot("amouri2019", THICK)
    arcs = RobotArcs.from_tensions(thick, [60, 0, 0], "arm")
    first, *others = arcs.module_bends
    np.testing.assert_allclose(others, others[0], rtol=1e-12)
    assert first > others[0]
    position, rotation = arcs.disk_positions, arcs.disk_rotations
    chord = rotation[0].T @ (position[-1] - position[0])
    n, a, c = 8, others[0], 3e-3
    flexible = thick.length / 9 - 2.0 * c
    theta = n * a
    length = n * (flexible + c * a / np.tan(a / 2.0))
    tip = length / theta * np.array([1.0 - np.cos(theta), 0.0, np.sin(theta)])
    np.testing.assert_allclose(chord, tip, atol=1e-12)


def test_the_law_of_force_makes_the_energy_stationary():
    """The energy of modules bent to arcs, minimised by their bends, to the order of the law."""
    thick = bs.load_robot("amouri2019", THICK)
    tensions = np.array([30.0, 12.0, 0.0])
    got = RobotArcs.from_tensions(thick, tensions, "arm")
    flexible = np.full(9, thick.length / 9 - 6e-3)
    flexible[0] += 3e-3

    def energy(bends):
        arcs = RobotArcs(thick, got.arc, "chord")._bend(np.asarray(bends))
        stored = 0.5 * thick.bending_stiffness[0] * np.sum(np.square(bends) / flexible)
        return stored + float(holes_of(thick, arcs) @ tensions)

    best = minimize(energy, got.module_bends, method="BFGS", options={"gtol": 1e-7})
    np.testing.assert_allclose(got.module_bends, best.x, rtol=2e-3)


@pytest.mark.parametrize("overrides", [PLAIN, THICK])
def test_inverse_and_derivatives(overrides):
    one = bs.load_robot("amouri2019", overrides)
    rng = np.random.default_rng(5)
    arcs = RobotArcs.from_tensions(one, 30.0 * rng.uniform(size=(20, 3)), "arm")
    lengths = arcs.lengths()
    got = RobotArcs.from_lengths(one, lengths, "chord")
    tip = got.tip.position
    free = RobotArcs.ik(one, tip, "chord", free_length=True)
    np.testing.assert_allclose(free.tip.position, tip, atol=1e-12)
    np.testing.assert_allclose(free.lengths(), lengths, atol=1e-11)
    held = RobotArcs.ik(one, 0.95 * tip, "chord")
    np.testing.assert_allclose(held.length, one.length, rtol=1e-15)
    away = np.linalg.norm(held.tip.position - 0.95 * tip, axis=1)
    np.testing.assert_allclose(held.misfit[:, 0], away, atol=1e-15)
    for turn in (-1e-3, 1e-3):  # the nearest of its length
        arc = bs.constant_curvature.Arc(held.kappa + turn / held.length, held.phi, held.length)
        beside = RobotArcs(one, arc, "chord").tip.position
        assert np.all(np.linalg.norm(beside - 0.95 * tip, axis=1) > away)

    step = 1e-5
    jacobian = got.jacobian()
    for t in range(3):
        moved = [
            RobotArcs.from_lengths(one, lengths + sign * step * np.eye(3)[t], "chord").tip.position
            for sign in (1, -1)
        ]
        np.testing.assert_allclose(
            jacobian[:, :3, t], (moved[0] - moved[1]) / (2 * step), rtol=1e-4, atol=1e-4
        )


def test_buckling_and_bad_input():
    one = bs.load_robot("amouri2019", PLAIN)
    euler = np.pi**2 * one.bending_stiffness[0] * 81 / one.length**2
    RobotArcs.from_tensions(one, [0.999 * euler, 0, 0], "arm")
    for share in (1.0, 5.0):
        with pytest.raises(NoSolutionError, match=f"limit {euler:.0f}"):
            RobotArcs.from_tensions(one, [share * euler, 0, 0], "arm")
    with pytest.raises(InputError, match="more than half a turn"):
        two = bs.load_robot("amouri2019", {**PLAIN, "segments.0.disks.count": 2})
        RobotArcs.from_lengths(two, [0.5, 0.9, 0.9], "chord")
    with pytest.raises(InputError, match="not with straight spans"):
        RobotArcs.from_lengths(one, [0.6] * 3, "chord", hold_length=True)
    thick = bs.load_robot("amouri2019", THICK)
    with pytest.raises(InputError, match="its clamped lengths alone"):
        RobotArcs(thick, bs.constant_curvature.Arc([0.0], 0.0, 0.05), "chord")
    for point in ([0.01, 0.0, 0.0], [0.0, 0.0, 0.05]):
        with pytest.raises(NoSolutionError, match="no corrected arc"):
            RobotArcs.ik(thick, point, "chord", free_length=True).tip.position  # noqa: B018
    body = bs.load_robot("amouri2019", {**PLAIN, "segments.0.tendons_in": "body"})
    for make in (
        lambda: RobotArcs.from_tensions(body, [1.0, 0, 0], "arm"),
        lambda: RobotArcs.from_lengths(body, [0.64] * 3, "chord"),
    ):
        with pytest.raises(InputError, match="those of this robot run in its body"):
            make()


def test_tendons_opposite_each_other_do_not_count() -> None:
    """Equal modules bend alike, also across the line of two opposite tendons."""
    tendons = [{"angle": f"{a} deg", "pitch_radius": "29 mm"} for a in (0, 180, 270)]
    one = bs.load_robot("amouri2019", {**PLAIN, "segments.0.tendons": tendons})
    for phi in (np.pi / 2, np.pi / 2 + 1e-3):
        arcs = RobotArcs(one, bs.constant_curvature.Arc([1.0], phi, one.length), "chord")
        np.testing.assert_allclose(arcs.module_bends, arcs.module_bends[0], rtol=1e-9)


def test_arcs_are_copied_and_empty() -> None:
    one = bs.load_robot("amouri2019", THICK)
    arcs = RobotArcs.from_tensions(one, [[40.0, 0, 0]], "arm")
    assert arcs.tip.position.shape == (1, 3)
    again = pickle.loads(pickle.dumps(arcs))
    np.testing.assert_array_equal(again.module_bends, arcs.module_bends)
    assert RobotArcs.from_lengths(one, np.empty((0, 3)), "chord").lengths().shape == (0, 3)
