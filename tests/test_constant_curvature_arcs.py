"""Constant curvature against 50-digit arithmetic, by its properties, and with invalid input."""

from __future__ import annotations

import contextlib
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import bowstring as bs
from bowstring.constant_curvature import Arc, RobotArcs, Routing
from bowstring.errors import InputError, NoSolutionError

LENGTH, RADIUS, STIFFNESS = 0.641, 0.029, 1.073786552
ANGLES = np.radians([0.0, 120.0, 240.0])
ROUTING = Routing(ANGLES, RADIUS)
TIGHT = 1e-13

# rounding of kappa * length, and all regimes of the series and closed forms
THETAS = [0.0, 1e-12, 1e-8, 1e-4, 0.3, 0.999999, 1.0, 1.000001, 2.5, np.pi, 4.9, 6.0, 6.28]
THETAS += [2 * np.pi - 1e-8, 2 * np.pi]
PHIS = [0.0, 0.4, np.pi / 2, 2.2, np.pi, -2.6, -np.pi / 2, -0.7]


def arcs() -> list[tuple[float, float, float]]:
    """(kappa, phi, length): the special angles, then random ones."""
    rng = np.random.default_rng(1)
    out = [(t / LENGTH, p, LENGTH) for i, t in enumerate(THETAS) for p in PHIS[i % 2 :: 2]]
    for _ in range(40):
        length = 10 ** rng.uniform(-2, 1)
        out.append((rng.uniform(0, 2 * np.pi) / length, rng.uniform(-np.pi, np.pi), length))
    return out


def tip_by_lengths(lengths, routing):
    """Derivative of the tip pose with respect to the tendon lengths."""
    got = Arc.from_lengths(lengths, routing)
    return got.jacobian() @ got.from_lengths_jacobian(routing)


# -- the reference: the formulas as printed, in 80 digits ----------------------------------------


@pytest.fixture(autouse=True)
def _digits():
    with mp.workdps(80):
        yield


def mp_pose(kappa, phi, length):
    theta = kappa * length
    if theta == 0:
        tip = mp.matrix([0, 0, length])
    else:
        swing = (1 - mp.cos(theta)) / kappa
        tip = mp.matrix([swing * mp.cos(phi), swing * mp.sin(phi), mp.sin(theta) / kappa])
    about_z = mp.matrix([[mp.cos(phi), -mp.sin(phi), 0], [mp.sin(phi), mp.cos(phi), 0], [0, 0, 1]])
    about_y = mp.matrix(
        [[mp.cos(theta), 0, mp.sin(theta)], [0, 1, 0], [-mp.sin(theta), 0, mp.cos(theta)]]
    )
    return tip, about_z * about_y * about_z.T


def mp_curvature(u):
    theta = mp.sqrt(u[0] ** 2 + u[1] ** 2)
    return theta / u[2], mp.atan2(u[1], u[0]) if theta else mp.mpf(0), u[2]


def mp_bend(kappa, phi, length):
    kappa, phi, length = mp.mpf(kappa), mp.mpf(phi), mp.mpf(length)
    return [kappa * length * mp.cos(phi), kappa * length * mp.sin(phi), length]


def mp_holes(angles, radii):
    radii = np.broadcast_to(radii, np.shape(angles))
    return [
        (mp.mpf(r) * mp.cos(mp.mpf(a)), mp.mpf(r) * mp.sin(mp.mpf(a)))
        for a, r in zip(angles, radii, strict=True)
    ]


def mp_lengths(u, holes):
    kappa, phi, length = mp_curvature(u)
    out = []
    for x, y in holes:
        lean = x * mp.cos(phi) + y * mp.sin(phi)
        out.append(length - kappa * length * lean)
    return out


def mp_fit(lengths, holes):
    """Bend coordinates and misfit by the normal equations (accurate enough with 80 digits)."""
    a = mp.matrix([[-x, -y, 1] for x, y in holes])
    b = mp.matrix(lengths)
    u = mp.lu_solve(a.T * a, a.T * b)
    left = a * u - b
    misfit = mp.sqrt(mp.fsum(e**2 for e in left) / len(lengths))
    return list(u), misfit


def mp_derivative(f, at):
    """Central differences with steps of 1e-20: accurate to 40 digits."""
    h = mp.mpf(10) ** -20
    columns = []
    for k in range(len(at)):
        up, down = list(at), list(at)
        up[k] += h
        down[k] -= h
        columns.append([(a - b) / (2 * h) for a, b in zip(f(up), f(down), strict=True)])
    return mp.matrix(columns).T


def mp_pose_derivative(f, at):
    """Rows: position, then the vector of dR R^T."""
    flat = mp_derivative(lambda v: [*(p := f(v))[0], *p[1]], at)
    rotation = f(at)[1]
    out = mp.matrix(6, len(at))
    for k in range(len(at)):
        spin = mp.matrix(3, 3)
        for i in range(9):
            spin[i // 3, i % 3] = flat[3 + i, k]
        spin = spin * rotation.T
        for i in range(3):
            out[i, k] = flat[i, k]
        out[3, k], out[4, k], out[5, k] = spin[2, 1], spin[0, 2], spin[1, 0]
    return out


def error(got, want, scale=None):
    """Norm of the error relative to the norm of the whole, or to `scale`."""
    got = np.asarray(got, dtype=float).reshape(-1)
    want = list(want)
    assert len(got) == len(want)
    off = mp.sqrt(mp.fsum((mp.mpf(g) - w) ** 2 for g, w in zip(got.tolist(), want, strict=True)))
    size = mp.sqrt(mp.fsum(w**2 for w in want)) if scale is None else mp.mpf(scale)
    return float(off / size) if off else 0.0


def by_place(got, want, floor):
    """Largest error of any element, relative to the element but at least to `floor` times the
    largest: elements that cross zero have no relative error of their own."""
    got, want = np.asarray(got, dtype=float).reshape(-1), list(want)
    largest = max(abs(w) for w in want)
    return max(
        float(abs(mp.mpf(g) - w) / max(abs(w), floor * largest))
        for g, w in zip(got.tolist(), want, strict=True)
    )


# -- values against the reference ----------------------------------------------------------------


@pytest.mark.parametrize("case", arcs())
def test_pose(case):
    tip, rotation = mp_pose(*map(mp.mpf, case))
    got = Arc(*case).fk()
    # a full turn returns the tip to the base, where only the length is left as a scale
    theta = case[0] * case[2]
    assert error(got.position, tip, None if theta < 6 else case[2]) < TIGHT
    assert error(got.rotation, rotation) < TIGHT
    if 0 < theta < 1:
        # nothing cancels there, so every coordinate that is not zero by symmetry is accurate
        swing = mp.sqrt(tip[0] ** 2 + tip[1] ** 2)
        assert error(got.position[:2], list(tip)[:2]) < TIGHT
        assert abs(np.hypot(*got.position[:2]) / float(swing) - 1) < TIGHT
        assert error(got.rotation[:2, 2], [rotation[0, 2], rotation[1, 2]]) < TIGHT


@pytest.mark.parametrize("case", arcs()[::3])
def test_pose_at_a_length_is_the_pose_of_a_shorter_arc(case):
    s = np.linspace(0, case[2], 5)
    got = Arc(*case).fk(s)
    for i, place in enumerate(s):
        kappa, phi = map(mp.mpf, case[:2])
        tip, rotation = mp_pose(kappa, phi, mp.mpf(place))
        assert error(got.position[i], tip, case[2]) < TIGHT
        assert error(got.rotation[i], rotation) < TIGHT
    np.testing.assert_array_equal(got.position[-1], Arc(*case).fk().position)


@pytest.mark.parametrize("case", arcs())
def test_pose_jacobian(case):
    at = mp_bend(*case)
    want = mp_pose_derivative(lambda u: mp_pose(*mp_curvature(u)), at)
    got = Arc(*case).jacobian()
    assert error(got[:3], want[:3, :]) < TIGHT
    assert error(got[3:], want[3:, :]) < TIGHT

    want = mp_pose_derivative(lambda v: mp_pose(*v), [mp.mpf(c) for c in case])
    got = Arc(*case).jacobian("curvature")
    assert error(got[:3], want[:3, :]) < TIGHT
    assert error(got[3:], want[3:, :]) < TIGHT


ROUTINGS = {
    "three": (ANGLES, RADIUS),
    "three uneven": (np.array([0.3, 1.9, 4.4]), np.array([0.02, 0.03, 0.025])),
    "four": (np.radians([45.0, 135, 225, 315]), 0.01),
    "seven": (np.linspace(0.1, 5.5, 7), np.linspace(0.004, 0.03, 7)),
}


@pytest.mark.parametrize("routing", ROUTINGS)
@pytest.mark.parametrize("theta", THETAS)
def test_lengths_and_their_fit(routing, theta):
    holes, routing = mp_holes(*ROUTINGS[routing]), Routing(*ROUTINGS[routing])
    count = len(holes)
    for phi in PHIS[::3]:
        case = (theta / LENGTH, phi, LENGTH)
        at = mp_bend(*case)
        got = Arc(*case).lengths(routing)
        assert by_place(got, mp_lengths(at, holes), 0) < TIGHT

        want = mp_derivative(lambda u: mp_lengths(u, holes), at)
        got = Arc(*case).lengths_jacobian(routing)
        assert error(got, want) < TIGHT
        for i in range(2):  # the columns of bend are small compared with that of length
            assert error(got[:, i], want[:, i]) < TIGHT
        want = mp_derivative(lambda v: mp_lengths(mp_bend(*v), holes), [mp.mpf(c) for c in case])
        got = Arc(*case).lengths_jacobian(routing, "curvature")
        assert error(got, want) < TIGHT

        if theta > 2 * np.pi - 1e-6:  # lengths rounded to above a full turn may be rejected
            case = (0.999999 * case[0], *case[1:])
        lengths = Arc(*case).lengths(routing)
        u, _ = mp_fit([mp.mpf(x) for x in lengths.tolist()], holes)
        got = Arc.from_lengths(lengths, routing)
        assert np.all(got.misfit < 1e-15)
        assert abs(float(got.length / u[2]) - 1) < TIGHT
        # redundant lengths have rounding errors that are misfit, and limit the accuracy of the bend
        known = None if count == 3 and theta else max(np.hypot(*map(float, u[:2])), 1e-2)
        assert error(got.bend[:2], u[:2], known) < TIGHT
        if count == 3 and theta:
            kappa, phi, _ = mp_curvature(u)
            assert abs(float(got.kappa / kappa) - 1) < TIGHT
            assert abs(np.sin(float(got.phi) - float(phi))) < TIGHT


@pytest.mark.parametrize("routing", ROUTINGS)
@pytest.mark.parametrize("theta", [0.0, 1e-12, 1e-8, 0.2, 1.0, 3.0, 5.5])
def test_jacobians_by_lengths(routing, theta):
    holes, routing = mp_holes(*ROUTINGS[routing]), Routing(*ROUTINGS[routing])
    lengths = Arc(theta / LENGTH, 2.0, LENGTH).lengths(routing)
    at = [mp.mpf(x) for x in lengths.tolist()]
    want = mp_derivative(lambda v: mp_fit(v, holes)[0], at)
    got = Arc.from_lengths(lengths, routing).from_lengths_jacobian(routing)
    assert error(got[:2], want[:2, :]) < TIGHT
    assert error(got[2], want[2, :], max(1.0, float(mp.norm(want[2, :])))) < TIGHT

    want = mp_pose_derivative(lambda v: mp_pose(*mp_curvature(mp_fit(v, holes)[0])), at)
    got = tip_by_lengths(lengths, routing)
    assert error(got[:3], want[:3, :]) < TIGHT
    assert error(got[3:], want[3:, :]) < TIGHT

    if theta > 0.1:
        want = mp_derivative(lambda v: mp_curvature(mp_fit(v, holes)[0]), at)
        got = Arc.from_lengths(lengths, routing).from_lengths_jacobian(routing, "curvature")
        assert error(got, want) < TIGHT


def test_printed_equations():
    """Eq. 2 to 5, as printed, for three tendons."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        lengths = LENGTH + rng.uniform(-0.03, 0.03, 3)
        l1, l2, l3 = map(mp.mpf, lengths.tolist())
        q = l1**2 + l2**2 + l3**2 - l1 * l2 - l2 * l3 - l1 * l3
        kappa = 2 * mp.sqrt(q) / (mp.mpf(RADIUS) * (l1 + l2 + l3))
        phi = mp.atan2(mp.sqrt(3) * (l3 - l2), l2 + l3 - 2 * l1)
        mean = (l1 + l2 + l3) / 3
        got = Arc.from_lengths(lengths, ROUTING)
        assert error([got.kappa, got.phi, got.length], [kappa, phi, mean]) < TIGHT
        tip, _ = mp_pose(kappa, phi, mean)
        position = Arc.from_lengths(lengths, ROUTING).fk().position
        assert error(position, tip) < TIGHT


def test_redundant_lengths():
    angles, radii = np.linspace(0, 5, 6), np.linspace(0.01, 0.03, 6)
    routing = Routing(angles, radii)
    rng = np.random.default_rng(3)
    lengths = Arc(2.0, 1.0, LENGTH).lengths(routing) + 1e-3 * rng.standard_normal(6)
    at = [mp.mpf(x) for x in lengths.tolist()]
    u, misfit = mp_fit(at, mp_holes(angles, radii))
    got = Arc.from_lengths(lengths, routing)
    assert error(got.bend, u) < TIGHT
    assert abs(float(got.misfit - misfit)) < TIGHT * LENGTH
    assert got.misfit > 1e-4

    # a true minimum, with the length held as well, and the misfit is as reported
    for length in (None, 0.64):
        got = Arc.from_lengths(lengths, routing, length)
        left = got.lengths(routing) - lengths
        assert np.sqrt(np.mean(left**2)) == pytest.approx(float(got.misfit), rel=1e-12)
        if length is not None:
            assert got.length == length
        slope = got.lengths_jacobian(routing).T @ left
        np.testing.assert_allclose(slope[: 3 if length is None else 2], 0, atol=1e-15)
        jacobian = Arc.from_lengths(lengths, routing, length).from_lengths_jacobian(
            routing, hold_length=length is not None
        )
        step = 1e-4 * rng.standard_normal(6)
        moved = Arc.from_lengths(lengths + step, routing, length)
        np.testing.assert_allclose(  # the map is linear in bend coordinates
            moved.bend - got.bend, jacobian @ step, atol=1e-14
        )


def test_paper_sweep_directions():
    """A shortened tendon bends the tip to its side; four quadrants."""
    for i, angle in enumerate(ANGLES):
        lengths = np.full(3, LENGTH + 0.005)
        lengths[i] = LENGTH - 0.01
        got = Arc.from_lengths(lengths, ROUTING).fk()
        x, y, _ = got.position
        assert np.cos(np.arctan2(y, x) - angle) == pytest.approx(1, abs=1e-14)


# -- force ---------------------------------------------------------------------------------------


def test_linear_law_is_the_continuous_tendon():
    got = Arc.from_tensions([[40.0, 0, 0], [80, 0, 0]], ROUTING, LENGTH, STIFFNESS)
    tips = 1e3 * got.fk().position
    np.testing.assert_allclose(
        tips, [[213.207379, 0, 590.986802], [377.307635, 0, 454.867397]], atol=1e-6
    )


# -- tip to arc ----------------------------------------------------------------------------------


@pytest.mark.parametrize("case", [c for c in arcs() if c[0] * c[2] < 6.2])
def test_through_tip(case):
    position = Arc(*case).fk().position
    x, y, z = map(mp.mpf, position.tolist())
    rho = mp.sqrt(x**2 + y**2)
    half = mp.atan2(rho, z)
    distance = mp.sqrt(rho**2 + z**2)
    length = distance * (half / mp.sin(half) if rho else 1)
    phi = mp.atan2(y, x)
    got = Arc.ik(position)
    want = [2 * half * mp.cos(phi), 2 * half * mp.sin(phi)] if rho else [mp.mpf(0)] * 2
    assert error(got.bend[:2], want) < TIGHT
    assert abs(float(got.length / length) - 1) < TIGHT
    np.testing.assert_allclose(got.fk().position, position, atol=2e-14 * case[2])


def test_nearest_is_global():
    rng = np.random.default_rng(4)
    points = np.concatenate([rng.uniform(-1.3, 1.3, (300, 3)), 0.1 * rng.standard_normal((60, 3))])
    points[::10, :2] *= 1e-9
    got = Arc.ik(points, 1.0)
    tips = Arc(got.kappa, got.phi, 1.0).fk().position
    np.testing.assert_allclose(np.linalg.norm(tips - points, axis=-1), got.misfit, atol=1e-14)
    assert np.all((got.kappa >= 0) & (got.kappa <= 2 * np.pi * (1 + 1e-15)))

    # brute force in the plane of the bend, on both sides of the axis
    theta = np.linspace(-2 * np.pi, 2 * np.pi, 8001)
    curve = Arc(theta, 0.0, 1.0).fk().position[:, [0, 2]]
    flat = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=-1)
    brute = np.linalg.norm(flat[:, None] - curve, axis=-1).min(axis=1)
    assert np.all(got.misfit <= brute + 1e-15)
    assert np.all(got.misfit > brute - 1e-3)
    # and over all directions
    around = Arc(theta[::40, None], np.linspace(0, np.pi, 60), 1.0).fk().position.reshape(-1, 3)
    for i in range(0, len(points), 12):
        assert got.misfit[i] <= np.linalg.norm(points[i] - around, axis=-1).min() + 1e-15


@pytest.mark.parametrize("theta", [1e-12, 1e-8, 0.1, 1.0, 3.0, 5.0, 6.2])
def test_nearest_digits(theta):
    """A tip on the curve gives its own arc; elsewhere the distance is stationary in the angle."""
    on = Arc(theta / LENGTH, 0.7, LENGTH).fk().position
    got = Arc.ik(on, LENGTH)
    assert got.kappa * LENGTH == pytest.approx(theta, rel=1e-13)
    assert got.misfit < 1e-15

    if theta == 6.2:  # the nearest would be beyond a full turn
        return
    point = on + np.array([0.01, -0.02, 0.03])
    rho, z = mp.sqrt(mp.mpf(point[0]) ** 2 + mp.mpf(point[1]) ** 2), mp.mpf(point[2])

    def slope(t):
        u = LENGTH * (1 - mp.cos(t)) / t - rho
        v = LENGTH * mp.sin(t) / t - z
        du = LENGTH * (t * mp.sin(t) - 1 + mp.cos(t)) / t**2
        return u * du + v * LENGTH * (t * mp.cos(t) - mp.sin(t)) / t**2

    got = Arc.ik(point, LENGTH)
    t = mp.findroot(slope, mp.mpf(float(got.kappa * LENGTH)))
    assert abs(float(got.kappa * LENGTH / t) - 1) < TIGHT


def test_nearest_special_points():
    # the base: a full turn reaches it; straight ahead beyond reach: straight; behind: phi = 0
    got = Arc.ik([[0, 0, 0], [0, 0, 2], [0, 0, 1], [0, 0, -1], [0, 0, 0.1]], 1.0)
    np.testing.assert_allclose(got.misfit[:3], [0, 1, 0], atol=1e-15)
    np.testing.assert_allclose(got.kappa[:3], [2 * np.pi, 0, 0], atol=1e-7)
    assert np.all(got.phi == 0)
    assert np.all(got.kappa[3:] > 0.5)


# -- properties ----------------------------------------------------------------------------------

thetas = st.one_of(st.floats(0, 6.2), st.floats(-15, 0).map(lambda e: 10.0**e))
phis = st.floats(-np.pi, np.pi)


@st.composite
def routings(draw):
    count = draw(st.integers(3, 8))
    turn = draw(st.floats(0, 6))
    jitter = draw(st.lists(st.floats(-0.2, 0.2), min_size=count, max_size=count))
    radii = draw(st.lists(st.floats(0.005, 0.03), min_size=count, max_size=count))
    return Routing(turn + (np.arange(count) + jitter) * 2 * np.pi / count, radii)


@given(thetas, phis, routings())
def test_round_trip(theta, phi, routing):
    lengths = Arc(theta / LENGTH, phi, LENGTH).lengths(routing)
    got = Arc.from_lengths(lengths, routing)
    assert got.misfit < 1e-14
    np.testing.assert_allclose(got.bend, Arc(theta / LENGTH, phi, LENGTH).bend, atol=1e-11)
    again = got.lengths(routing)
    np.testing.assert_allclose(again, lengths, rtol=1e-13)


@given(thetas, phis, st.floats(0.01, 10))
def test_rotation_is_a_rotation(theta, phi, length):
    position, rotation = Arc(theta / length, phi, length).fk()
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=2e-15)
    assert np.linalg.det(rotation) == pytest.approx(1, abs=2e-15)
    assert np.linalg.norm(position) <= length * (1 + 1e-15)
    # no twist, and a bend to the other side mirrors
    mirror = Arc(-theta / length, phi, length).fk()
    other = Arc(theta / length, phi + np.pi, length).fk()
    np.testing.assert_allclose(mirror.position, other.position, atol=1e-14 * length)


@pytest.mark.parametrize("theta", [0.0, 1e-8, None])
@given(st.floats(1e-3, 6.2), phis, st.floats(0.05, 0.95))
@settings(max_examples=50, deadline=None)
def test_an_arc_composes_of_its_parts(theta, drawn, phi, share):
    """Two arcs in series with one curvature and direction are one arc."""
    theta = drawn if theta is None else theta
    kappa, cut = theta / LENGTH, share * LENGTH
    whole = Arc(kappa, phi, LENGTH)
    first, second = Arc(kappa, phi, [cut, LENGTH - cut])[0], Arc(kappa, phi, LENGTH - cut)
    tip = first.fk() @ second.fk()
    np.testing.assert_allclose(tip.position, whole.fk().position, atol=1e-14)
    np.testing.assert_allclose(tip.rotation, whole.fk().rotation, atol=1e-14)
    np.testing.assert_allclose(first.fk().position, whole.fk(cut).position, atol=1e-14)
    robot = RobotArcs(two_segments(), Arc(kappa, phi, [cut, LENGTH - cut]))
    np.testing.assert_allclose(robot.tip.position, whole.fk().position, atol=1e-14)
    s = np.linspace(0, LENGTH, 7)
    np.testing.assert_allclose(robot.fk(s).position, whole.fk(s).position, atol=1e-14)
    np.testing.assert_allclose(robot.fk(s).rotation, whole.fk(s).rotation, atol=1e-14)


def test_no_jump_where_series_and_closed_form_meet():
    below, above = np.nextafter(1.0, 0), np.nextafter(1.0, 2)
    for f in (lambda *c: Arc(*c).jacobian(), lambda *c: Arc(*c).fk().position):
        np.testing.assert_allclose(f(below, 0.3, 1.0), f(above, 0.3, 1.0), rtol=2e-15, atol=1e-15)


def test_arrays_broadcast():
    rng = np.random.default_rng(5)
    kappa, phi = rng.uniform(0, 3, (4, 1)), rng.uniform(-3, 3, 5)
    position, rotation = Arc(kappa, phi, LENGTH).fk()
    assert position.shape == (4, 5, 3)
    assert rotation.shape == (4, 5, 3, 3)
    lengths = Arc(kappa, phi, LENGTH).lengths(ROUTING)
    assert lengths.shape == (4, 5, 3)
    assert Arc.from_lengths(lengths, ROUTING).misfit.shape == (4, 5)
    assert Arc.from_lengths(lengths, ROUTING, np.full(5, LENGTH)).kappa.shape == (
        4,
        5,
    )
    assert tip_by_lengths(lengths, ROUTING).shape == (4, 5, 6, 3)
    places = np.linspace(0, LENGTH, 9)
    assert Arc(kappa, phi, LENGTH)[..., None].fk(places).rotation.shape == (4, 5, 9, 3, 3)
    part = Arc(kappa, phi, LENGTH)[1:, 2]
    np.testing.assert_array_equal(part.fk().position, position[1:, 2])
    tip = Arc.from_lengths(lengths[::-1, ::2], ROUTING).fk()  # not contiguous
    np.testing.assert_allclose(tip.position, position[::-1, ::2], atol=1e-14)
    assert Arc.ik(position).theta.shape == (4, 5)
    assert Arc.ik(position, LENGTH).misfit.shape == (4, 5)
    assert Arc(np.empty(0), 0.0, LENGTH).fk().position.shape == (0, 3)
    one = Arc(1.0, 0.0, LENGTH).fk()
    assert one.position.shape == (3,)
    np.testing.assert_allclose(Arc.from_bend([0.3, -0.4, 0.5]).bend, [0.3, -0.4, 0.5], rtol=1e-15)
    assert Arc.from_bend([-0.0, -0.0, 1.0]).phi == 0


# -- robots --------------------------------------------------------------------------------------


@cache
def one_segment():
    return bs.load_robot("amouri2019")


@cache
def two_segments():
    modulus = 0.0102 * 64 / np.pi / 0.002**4
    segment = f"""
  - length: 200 mm
    backbone: {{diameter: 2 mm, E: {modulus!r} Pa, nu: 0.3, density: 0 kg/m^3}}
    disks: {{count: 10, mass: 0 g, radius: 12 mm, thickness: 1 mm}}
    tendons: {{count: 3, pitch_radius: 10 mm, first_angle: 90 deg}}
"""
    with TemporaryDirectory() as folder:
        path = Path(folder, "two.yaml")
        path.write_text("segments:" + 2 * segment)
        return bs.load_robot(path)


def robot_arcs(robot, tensions, law="linear"):
    return RobotArcs.from_tensions(robot, tensions, law)


def test_one_segment_robot():
    robot = one_segment()
    lengths = Arc([[0.5], [2.0]], [0.1, 2, -2], LENGTH).lengths(ROUTING)
    got = RobotArcs.from_lengths(robot, lengths)
    np.testing.assert_allclose(got.kappa, [[[0.5]] * 3, [[2.0]] * 3], rtol=1e-12)
    tip = Arc.from_lengths(lengths, ROUTING).fk()
    np.testing.assert_allclose(got.tip.position, tip.position, atol=1e-14)
    np.testing.assert_allclose(got.tip.rotation, tip.rotation, atol=1e-14)
    assert got.disk_positions.shape == (2, 3, 9, 3)
    np.testing.assert_allclose(got.disk_positions[..., -1, :], tip.position, atol=1e-15)
    np.testing.assert_allclose(got.jacobian(), tip_by_lengths(lengths, ROUTING), atol=1e-11)
    free = RobotArcs.ik(robot, 0.9 * got.tip.position, free_length=True)
    np.testing.assert_allclose(free.length, 0.9 * LENGTH, rtol=1e-12)
    again = RobotArcs.ik(robot, got.tip.position)
    np.testing.assert_allclose(again.lengths(), lengths, atol=1e-13)
    assert np.all(again.misfit < 1e-14)


@pytest.mark.parametrize("correction", [None, "chord"])
def test_segments_in_series(correction):
    robot = two_segments()
    rng = np.random.default_rng(6)
    kappa, phi = rng.uniform(0, 8, (20, 2)), rng.uniform(-np.pi, np.pi, (20, 2))
    kappa[0], kappa[1, 0] = 0, 0
    length = rng.uniform(0.19, 0.21, (20, 2))
    lengths = RobotArcs(robot, Arc(kappa, phi, length), correction).lengths()
    got = RobotArcs.from_lengths(robot, lengths, correction)
    np.testing.assert_allclose(got.arc.bend, Arc(kappa, phi, length).bend, atol=1e-12)
    p1, r1 = Arc(kappa[:, 0], phi[:, 0], length[:, 0]).fk()
    p2, r2 = Arc(kappa[:, 1], phi[:, 1], length[:, 1]).fk()
    np.testing.assert_allclose(got.tip.position, p1 + (r1 @ p2[..., None])[..., 0], atol=1e-13)
    np.testing.assert_allclose(got.tip.rotation, r1 @ r2, atol=1e-12)
    np.testing.assert_allclose(got.disk_positions[:, 9], p1, atol=1e-13)

    if correction == "chord":  # the lengths are those from hole to hole
        holes = np.c_[robot.tendons.mean_hole_m[0][3:], np.zeros(3)]
        places = got.disk_positions[:, :, None] + np.einsum(
            "bnij,tj->bnti", got.disk_rotations, holes
        )
        start = np.broadcast_to(holes, (20, 1, 3, 3))
        spans = np.diff(np.concatenate([start, places], axis=1), axis=1)
        total = np.linalg.norm(spans, axis=-1).sum(axis=1)
        np.testing.assert_allclose(total, lengths[:, 3:], rtol=1e-13)

    line = got.centerline(11)
    assert line.shape == (20, 21, 3)
    np.testing.assert_allclose(line[:, 10], p1, atol=1e-13)
    np.testing.assert_allclose(line[:, -1], got.tip.position, atol=1e-15)

    jacobian = RobotArcs.from_lengths(robot, lengths, correction).jacobian()
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        up = RobotArcs.from_lengths(robot, lengths + step, correction).tip
        down = RobotArcs.from_lengths(robot, lengths - step, correction).tip
        np.testing.assert_allclose(
            jacobian[:, :3, k], (up.position - down.position) / 2e-6, atol=1e-6
        )
        spin = (up.rotation - down.rotation) / 2e-6 @ np.swapaxes(got.tip.rotation, -1, -2)
        vector = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=-1)
        np.testing.assert_allclose(jacobian[:, 3:, k], vector, atol=1e-5)


def test_held_lengths_and_their_jacobian():
    robot = two_segments()
    rng = np.random.default_rng(8)
    arc = Arc(rng.uniform(0, 6, (5, 2)), rng.uniform(-3, 3, (5, 2)), 0.2)
    lengths = RobotArcs(robot, arc).lengths() + 1e-4
    got = RobotArcs.from_lengths(robot, lengths, hold_length=True)
    np.testing.assert_array_equal(got.length, 0.2)
    assert np.all(got.misfit > 1e-5)
    step = rng.normal(size=6)
    up, down = (
        RobotArcs.from_lengths(robot, lengths + sign * 1e-6 * step, hold_length=True).tip.position
        for sign in (1, -1)
    )
    np.testing.assert_allclose(got.jacobian()[:, :3] @ step, (up - down) / 2e-6, atol=1e-6)


def test_arcs_are_frozen_and_indexed():
    robot = two_segments()
    got = RobotArcs(robot, Arc(np.full((4, 3, 2), 2.0), 0.1, 0.2), "chord")
    with pytest.raises(ValueError, match="read-only"):
        got.kappa[0] = 1.0
    assert got[1].lengths().shape == (3, 6) and got[1].correction == "chord"
    assert got[..., None].fk([0.0, 0.1]).position.shape == (4, 3, 2, 3)
    assert got[:, 1:].disk_positions.shape == (4, 2, 20, 3)
    assert repr(Arc(2, 0, 0.5)) == "Arc(kappa=2, phi=0, length=0.5, misfit=0)"
    assert len(ROUTING[:2]) == 2
    np.testing.assert_array_equal(Routing.from_holes(ROUTING.holes).holes, ROUTING.holes)


def test_outer_tendons_bend_inner_segments():
    robot = two_segments()
    outer = robot_arcs(robot, [0, 0, 0, 2.0, 0, 0])
    np.testing.assert_allclose(outer.theta, 2.0 * 0.01 * 0.2 / 0.0102 * np.ones(2))
    np.testing.assert_allclose(outer.phi, np.pi / 2)
    inner = robot_arcs(robot, [2.0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(inner.theta, [outer.theta[0], 0], atol=1e-16)


# -- bad input -----------------------------------------------------------------------------------

SQUARE = [0.0, np.pi / 2, np.pi, -np.pi / 2]
BAD = {
    "only if the length of the arc is given": lambda: Arc.from_lengths(
        [0.6, 0.6], Routing(ANGLES[:2], RADIUS)
    ),
    "if the length": lambda: Arc.from_lengths([0.6], Routing([1.0], RADIUS)),
    "of the arc is given": lambda: Arc.from_lengths(
        [0.6] * 3, Routing.from_holes([[0.01, 0.02], [0.0, 0.02], [-0.02, 0.02]])
    ),
    "needs a tendon": lambda: Arc.from_lengths([], Routing([], RADIUS), 0.6),
    "tendon 1 must be positive": lambda: Arc.from_lengths([0.6, -0.1, 0.6], ROUTING),
    "tendon 0 must be positive": lambda: Arc.from_lengths([0.0, 0.6, 0.6], ROUTING),
    "row 2: the length of tendon 2": lambda: Arc.from_lengths(
        [[0.6, 0.6, 0.6], [0.6, 0.6, np.nan]], ROUTING
    ),
    "positive and finite, got inf": lambda: Arc.from_lengths([np.inf] * 3, ROUTING),
    "full turn": lambda: Arc.from_lengths([0.3, 0.6, 0.6], ROUTING),
    "inside the pitch radius": lambda: Arc.from_lengths([0.001, 0.001, 0.1], ROUTING),
    "misfit of the tendon lengths must be finite": lambda: Arc.from_lengths(
        [1e300, 1, 1, 1], Routing(SQUARE, RADIUS)
    ),
    "run on its axis": lambda: Arc.from_lengths([0.6] * 3, Routing(ANGLES, 0.0)),
    "3 values along": lambda: Arc.from_lengths([0.6] * 4, ROUTING),
    "array of numbers": lambda: Arc.from_lengths(["a", 1, 2], ROUTING),
    "not negative, got": lambda: Arc.from_lengths([0.6] * 3, Routing(ANGLES, -RADIUS)),
    "one a tendon": lambda: Arc.from_lengths([0.6] * 3, Routing(ANGLES, [RADIUS, RADIUS])),
    "angles must be finite": lambda: Arc.from_lengths([0.6] * 3, Routing([0, np.nan, 1], RADIUS)),
    "curvature must be finite": lambda: Arc(np.nan, 0, 1).fk(),
    "direction of bending must be finite": lambda: Arc(1, np.inf, 1).fk(),
    "length must be positive": lambda: Arc(1, 0, 0).fk(),
    "bend angle must be below": lambda: Arc(1e200, 0, 1e200).fk(),
    "between 0 and its length": lambda: Arc(1, 0, 1).fk([0.5, 1.1]),
    "position along the arc": lambda: Arc(1, 0, 1).fk(np.nan),
    "do not broadcast": lambda: Arc([1, 2], [1, 2, 3], 1).fk(),
    "bends tighter": lambda: Arc(40, 0, 0.6).lengths(ROUTING),
    "cannot be reached": lambda: Arc.ik([0, 0, 0]),
    "behind it cannot be reached": lambda: Arc.ik([0, 0, -0.3]),
    "no arc of finite length": lambda: Arc.ik([5e-324, 0, -0.3]),
    "tip coordinate must be finite": lambda: Arc.ik([0, np.nan, 1]),
    "3 values": lambda: Arc.ik([0, 1]),
    "coordinate must be finite": lambda: Arc.ik([0, np.inf, 1], 1),
    "arc's length must be positive": lambda: Arc.ik([0, 0, 1], -1),
    "tension of tendon 1": lambda: Arc.from_tensions([1, -1, 0], ROUTING, 1, 1),
    "bending stiffness": lambda: Arc.from_tensions([1, 1, 0], ROUTING, 1, 0),
    "no derivative at a straight": lambda: Arc.from_lengths(
        [0.6] * 3, ROUTING
    ).from_lengths_jacobian(ROUTING, "curvature"),
    "coordinates must be one of": lambda: Arc(1, 0, 1).jacobian("polar"),
    "correction must be one of": lambda: RobotArcs.from_lengths(one_segment(), [0.6] * 3, "arc"),
    "law must be one of": lambda: robot_arcs(one_segment(), [0.6] * 3, "cubic"),
    "tendon 3 is -1 m long, its straight length is 0.641 m; lengths must be 0.0641 m to 6.41 m": (
        lambda: RobotArcs.from_lengths(one_segment(), [0.6, 0.6, -1])
    ),
    "tendon 1 is 29 m long": lambda: RobotArcs.from_lengths(one_segment(), [[0.6] * 3, [29] * 3]),
    "tendon 4 is 0.03 m long": lambda: RobotArcs.from_lengths(
        two_segments(), [0.2] * 3 + [0.03] * 3
    ),
    "its last dimension must be the 2 segments": lambda: RobotArcs(two_segments(), Arc([1], 0, 1)),
    "s is 0.41 m; it must be 0 to 0.4 m": lambda: RobotArcs(two_segments(), Arc([1, 2], 0, 0.2)).fk(
        [0.1, 0.41]
    ),
    "segment 1: no arc has these tendon lengths: they would bend it by": lambda: (
        RobotArcs.from_lengths(one_segment(), [0.3, 0.6, 0.6])
    ),
    "tension 1 is nan N; tensions must be >= 0 N": lambda: robot_arcs(
        one_segment(), [np.nan, 0.6, 1]
    ),
    "segment 2: tendon 4 is shorter": lambda: RobotArcs.from_lengths(
        two_segments(), [0.2, 0.2, 0.2, 0.1, 0.4, 0.4]
    ),
    "the inverse is for one segment": lambda: RobotArcs.ik(two_segments(), [0, 0, 0.3]),
}


@pytest.mark.parametrize("text", BAD)
def test_bad_input(text):
    with pytest.raises(InputError) as caught:
        BAD[text]()
    message = str(caught.value)
    assert text in message
    assert "\n" not in message
    assert len(message) < 250


def test_the_lever_arm_law_and_the_rod_buckle_at_the_same_load():
    """Three equally taut tendons: straight, until the backbone buckles between its disks."""
    robot = bs.load_robot("amouri2019", {"segments.0.disks.count": 3})
    euler = np.pi**2 * robot.bending_stiffness[0] * 9 / robot.length**2
    for share, status in ((0.98, "converged"), (1.02, None)):
        tensions = np.full(3, share * euler / 3)
        exact = bs.solve(robot, tensions, model=bs.RodModel("kirchhoff", elements=8))
        straight = exact.converged and np.abs(exact.tip.position[:2]).max() < 1e-6
        assert straight == (status is not None)
        if straight:
            RobotArcs.from_tensions(robot, tensions, law="arm")
        else:
            with pytest.raises(NoSolutionError, match="beyond the lever-arm law"):
                RobotArcs.from_tensions(robot, tensions, law="arm")


@given(
    st.lists(st.floats(), min_size=3, max_size=3),
    st.lists(st.floats(), min_size=3, max_size=3),
    st.floats(),
)
@example([1e-308, 0.0, 1.3e308], [0.0, 0.0, 0.0], 0.0)
@settings(max_examples=300)
def test_hostile_numbers(values, angles, radii):
    """For any floats: an intentional error, or finite numbers."""
    calls = (
        lambda: Arc.from_lengths(values, Routing(angles, radii)).fk().position,
        lambda: Arc.from_lengths(values, ROUTING).fk().position,
        lambda: Arc(*values).fk().position,
        lambda: Arc(*values).jacobian(),
        lambda: Arc.ik(values).fk().position,
        lambda: Arc.ik(values, radii).misfit,
        lambda: Arc.from_tensions(values, Routing(angles, radii), 1.0, 1.0).theta,
        lambda: Arc(*values).lengths(Routing(angles, radii)),
    )
    for call in calls:
        with contextlib.suppress(InputError, NoSolutionError):
            assert np.all(np.isfinite(call()))
