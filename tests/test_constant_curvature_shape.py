"""Best arcs through backbone shapes: exact on arcs, objective, and on measured shapes."""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import optimize
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.constant_curvature.shape import ArcFit, fit_arcs
from bowstring.viz.shapes import backbone_shapes
from bowstring.viz.style import figure_style, svg
from objects import refused

DATA = Path(os.environ.get("BOWSTRING_DATA", Path(__file__).parents[2] / "shared" / "data"))


def plane_arcs(bends: Floats, start: Floats, share: Floats) -> Floats:
    """Points (K, P, 2) on m equal arcs in series, by complex numbers; length 1."""
    m = bends.shape[1]
    place = np.zeros((len(bends), share.size), dtype=complex)
    heading = start[:, None] * np.ones_like(share)
    for i in range(m):
        part = np.clip(share * m - i, 0.0, 1.0)
        half = 0.5 * bends[:, i, None] * part
        place += part / m * np.sinc(half / np.pi) * np.exp(1j * (heading + half))
        heading = heading + bends[:, i, None] * part
    return np.stack([place.real, place.imag], axis=-1)


def space_arcs(kappa: Floats, phi: Floats, share: Floats) -> Floats:
    """Points (P, 3) on arcs in series, each with curvature and direction."""
    m = len(kappa)
    position, rotation, points = np.zeros(3), np.eye(3), []
    for s in share:
        i = min(int(s * m), m - 1)
        position, rotation = np.zeros(3), np.eye(3)
        for j in range(i + 1):
            part = min(max(s - j / m, 0.0), 1 / m)
            pose = bs.constant_curvature.Arc(kappa[j], phi[j], 1 / m).fk(part)
            position, rotation = position + rotation @ pose.position, rotation @ pose.rotation
        points.append(position)
    return np.array(points)


def uneven(rng: np.random.Generator, count: int) -> Floats:
    share = np.cumsum(rng.uniform(0.3, 1.0, count - 1))
    return np.concatenate([[0.0], share / share[-1]])


# -- measured ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def measured() -> Floats:
    """Whole backbone shapes (433, 20, 2) of a real robot, pixels."""
    path = DATA / "ucl-planar-shape" / "sample_data.csv"
    if not path.exists():
        pytest.skip(f"needs the data of others, ucl-planar-shape, in {DATA}")
    table = pd.read_csv(path)
    table = table[table.tracking_ok == 1]
    return np.array([json.loads(text) for text in table.points_json])


@pytest.mark.parametrize(("pieces", "rms", "tip"), [(1, 1.13, 1.90), (2, 0.90, 1.18)])
def test_measured_shapes(measured: Floats, pieces: int, rms: float, tip: float) -> None:
    fit = fit_arcs(measured, pieces)
    assert len(fit) == 433
    assert 100 * fit.rms.mean() == pytest.approx(rms, abs=0.03)
    assert 100 * fit.tip.mean() == pytest.approx(tip, abs=0.03)
    row = fit.to_dict()
    assert row["shape_rms_mean_percent"] == pytest.approx(100 * fit.rms.mean())
    assert row["tip_mean_percent"] == pytest.approx(100 * fit.tip.mean())
    json.dumps(row, allow_nan=False)


def test_measured_shapes_against_scipy(measured: Floats) -> None:
    """Some of them against another optimiser, from many starts, to the same sum of squares."""
    some = measured[::29]
    fit = fit_arcs(some)
    for k in range(len(some)):

        def left(x: Floats, k: int = k) -> Floats:
            arc = plane_arcs(x[None, 1:], x[:1], fit.fraction[k])[0]
            return np.ravel(arc - fit.measured[k])

        starts = [[a, b] for a in (-3.0, -1.5, 0.0, 1.5) for b in (-4.0, -1.0, 1.0, 4.0)]
        best = min(optimize.least_squares(left, x, xtol=1e-12).cost for x in starts)
        assert np.sum(fit.distance[k] ** 2) == pytest.approx(2 * best, rel=1e-8)


def test_speed(measured: Floats) -> None:
    fit_arcs(measured[:3])
    begin = time.process_time()
    fit_arcs(measured)
    assert time.process_time() - begin < 1.0


# -- synthetic ---------------------------------------------------------------------------------


@pytest.mark.parametrize("pieces", [1, 2, 3])
def test_arcs_in_a_plane_are_recovered(pieces: int) -> None:
    rng = np.random.default_rng(pieces)
    bends = rng.uniform(-4, 4, (60, pieces))
    bends[:4] = [[0.0], [1e-12], [1e-8], [-1e-4]]
    start, share = rng.uniform(-3, 3, 60), uneven(rng, 14)
    points = 170.0 * plane_arcs(bends, start, share) + [30.0, -5.0]
    fit = fit_arcs(points, pieces, stations=170.0 * share + 12.0)
    assert fit.rms.max() < 1e-10
    np.testing.assert_allclose(fit.curvature, bends * pieces, atol=1e-10)
    heading = np.stack([np.cos(start), np.sin(start)], axis=-1)
    np.testing.assert_allclose(fit.direction, heading, atol=1e-10)
    np.testing.assert_allclose(fit.length, 170.0)
    # the curvature vector is perpendicular to the tangent, to its left where positive
    left = np.stack([-heading[:, 1], heading[:, 0]], axis=-1) * fit.curvature[:, :1]
    np.testing.assert_allclose(fit.curvature_vector[:, 0], left, atol=1e-9)


@pytest.mark.parametrize("pieces", [1, 2, 3])
def test_arcs_in_space_are_recovered(pieces: int) -> None:
    rng = np.random.default_rng(pieces)
    share, shapes, kappas, turns = uneven(rng, 12), [], [], []
    for k in range(20):
        kappa = rng.uniform(0, 4, pieces) if k else np.zeros(pieces)
        turn = Rotation.random(random_state=rng).as_matrix()
        shapes.append(space_arcs(kappa, rng.uniform(-3, 3, pieces), share) @ turn.T)
        kappas.append(kappa)
        turns.append(turn)
    fit = fit_arcs(0.64 * np.array(shapes) - 2.0, pieces, stations=0.64 * share)
    assert fit.rms.max() < 1e-10
    np.testing.assert_allclose(fit.curvature, kappas, atol=1e-9)
    np.testing.assert_allclose(fit.direction, np.array(turns)[:, :, 2], atol=1e-9)


def test_curvature_vector_in_space() -> None:
    """Towards phi, with the magnitude of the curvature, in the axes of the points."""
    share = np.linspace(0, 1, 9)
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5]).as_matrix()
    fit = fit_arcs(space_arcs(np.array([1.5]), np.array([0.7]), share) @ turn.T, 1, share)
    expected = 1.5 * turn @ [math.cos(0.7), math.sin(0.7), 0.0]
    np.testing.assert_allclose(fit.curvature_vector[0, 0], expected, atol=1e-10)


def test_two_full_turns_and_an_s_shape() -> None:
    share = np.linspace(0, 1, 41)
    coil = plane_arcs(np.array([[11.0]]), np.zeros(1), share)
    assert fit_arcs(coil, 1, share).curvature == pytest.approx(11.0)
    s = plane_arcs(np.array([[3.0, -3.0]]), np.zeros(1), share)
    np.testing.assert_allclose(fit_arcs(s, 2, share).curvature, [[6.0, -6.0]], atol=1e-9)
    assert fit_arcs(s, 1, share).rms[0] > 0.05


def noisy(rng: np.random.Generator, count: int, dimensions: int) -> Floats:
    """Shapes that are not arcs."""
    share = np.linspace(0, 1, 15)
    bends = rng.uniform(-2, 2, (count, 3))
    flat = plane_arcs(bends, rng.uniform(-3, 3, count), share)
    if dimensions == 3:
        flat = np.concatenate(
            [flat, 0.2 * rng.normal(size=(count, 1, 1)) * share[:, None] ** 2], -1
        )
    return flat + 0.005 * rng.normal(size=flat.shape)


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("pieces", [1, 2])
def test_objectivity(dimensions: int, pieces: int) -> None:
    """Translation, rotation and a change of unit change only the directions."""
    rng = np.random.default_rng(7)
    shapes = noisy(rng, 25, dimensions)
    if dimensions == 3:
        turn = Rotation.random(random_state=rng).as_matrix()
    else:
        turn = Rotation.from_rotvec([0, 0, 2.2]).as_matrix()[:2, :2]
    one = fit_arcs(shapes, pieces)
    other = fit_arcs(1e3 * shapes @ turn.T + rng.normal(size=dimensions), pieces)
    np.testing.assert_allclose(other.rms, one.rms, rtol=1e-8)
    np.testing.assert_allclose(other.curvature, one.curvature, atol=1e-5)
    np.testing.assert_allclose(other.error, one.error @ turn.T, atol=1e-6)
    np.testing.assert_allclose(other.direction, one.direction @ turn.T, atol=1e-6)
    np.testing.assert_allclose(other.residual_curvature, one.residual_curvature, atol=1e-4)


def test_a_plane_in_space_is_a_plane() -> None:
    shapes = noisy(np.random.default_rng(3), 30, 2)
    flat = fit_arcs(shapes)
    space = fit_arcs(np.concatenate([shapes, np.zeros((30, 15, 1))], axis=-1))
    np.testing.assert_allclose(space.rms, flat.rms, rtol=1e-8)
    np.testing.assert_allclose(space.curvature, np.abs(flat.curvature), atol=1e-5)
    towards = space.residual_curvature[..., 0]
    np.testing.assert_allclose(towards, flat.residual_curvature[..., 0], atol=1e-4)
    np.testing.assert_allclose(space.residual_curvature[..., 1], 0.0, atol=1e-4)


def test_a_shape_alone_and_among_others_in_any_order() -> None:
    shapes = noisy(np.random.default_rng(5), 10, 2)
    together = fit_arcs(shapes, 2)
    alone = fit_arcs(shapes[4], 2)
    np.testing.assert_allclose(alone.rms[0], together.rms[4], rtol=1e-9)
    taken = together.take([4, 2])
    assert isinstance(taken, ArcFit) and len(taken) == 2
    np.testing.assert_array_equal(taken.rms, together.rms[[4, 2]])
    np.testing.assert_allclose(together.curve(together.fraction[4])[4], together.fitted[4])


def test_statistics() -> None:
    """RMS over points, the first included; tip at the last."""
    fit = fit_arcs(noisy(np.random.default_rng(5), 6, 3))
    assert np.all(fit.distance[:, 0] == 0.0)
    np.testing.assert_allclose(fit.error, fit.fitted - fit.measured)
    by_hand = np.sqrt(np.sum(fit.error**2, axis=(1, 2)) / 15)
    np.testing.assert_allclose(fit.rms, by_hand)
    np.testing.assert_allclose(fit.tip, np.linalg.norm(fit.error[:, -1], axis=-1))
    rows = fit.profile(29)
    np.testing.assert_allclose(rows.mean[[0, -1]], [0.0, fit.tip.mean()], atol=1e-15)
    np.testing.assert_allclose(rows.maximum[-1], fit.tip.max())


def test_error_decreases_with_the_number_of_pieces() -> None:
    shapes = noisy(np.random.default_rng(11), 40, 2)
    errors = [fit_arcs(shapes, m).rms for m in (1, 2, 4)]
    assert np.all(errors[1] <= errors[0] * (1 + 1e-9))
    assert np.all(errors[2] <= errors[1] * (1 + 1e-9))


def test_known_failure_of_one_arc() -> None:
    """A backbone bent only beyond its middle bends less than its arc before it, more after it."""
    share = np.linspace(0, 1, 41)
    for sign in (1.0, -1.0):
        shape = plane_arcs(np.array([[0.0, sign]]), np.zeros(1), share)
        fit = fit_arcs(shape, 1, share)
        where = fit.profile()
        kappa = abs(float(fit.curvature[0, 0]))
        np.testing.assert_allclose(where.bent_more[2:9], -kappa, atol=1e-9)
        np.testing.assert_allclose(where.bent_more[12:19], 2.0 - kappa, rtol=1e-3)
    two = fit_arcs(shape, 2, share).residual_curvature
    assert np.abs(np.delete(two, 19, axis=1)).max() < 1e-3  # except at the joint


def test_straight_shapes_have_no_residual_direction() -> None:
    fit = fit_arcs(np.outer(np.linspace(0, 3, 6), [0.0, 0.6, 0.8]))
    assert np.abs(fit.residual_curvature).max() < 1e-12
    assert fit.rms[0] < 1e-15


# -- bad input ---------------------------------------------------------------------------------

LINE = np.outer(np.arange(5.0), [1.0, 0.2])


def with_nan() -> Floats:
    rows = np.tile(LINE, (3, 1, 1))
    rows[1, 3, 0] = np.nan
    return rows


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: fit_arcs(with_nan()), r"row 2: point 4 is not finite"),
        (lambda: fit_arcs(LINE[:2]), "2 points has no curvature"),
        (lambda: fit_arcs(LINE[[0, 1, 1, 2]]), "row 1: points 2 and 3 lie in one place"),
        (lambda: fit_arcs(np.zeros((4, 2))), "points 1 and 2 lie in one place"),
        (lambda: fit_arcs(np.zeros((2, 4, 4))), r"shape \(2, 4, 4\)"),
        (lambda: fit_arcs(np.zeros((0, 4, 2))), "shape"),
        (lambda: fit_arcs([[[0, 0], [1, 1]], [[0, 0]]]), "must be numbers"),
        (lambda: fit_arcs("a"), "must be numbers"),
        (lambda: fit_arcs(LINE, 0), "pieces is 0"),
        (lambda: fit_arcs(LINE, 1.5), "pieces is 1.5"),
        (lambda: fit_arcs(LINE, 5), "give 4 pieces or fewer"),
        (lambda: fit_arcs(LINE[[0, 3, 4]], 2), "no point lies on piece 1"),
        (lambda: fit_arcs(LINE, 1, [0, 1, 3, 2, 4]), "grow from base to tip"),
        (lambda: fit_arcs(LINE, 1, [0, 1]), "stations must be numbers of shape"),
        (lambda: fit_arcs(LINE, 1, np.arange(5) * 1e3), "one unit"),
        (lambda: fit_arcs(LINE).profile(1), "places is 1"),
    ],
)
def test_bad_input(call: object, message: str) -> None:
    refused(message, call)  # type: ignore[operator]


# -- figure ------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [2, 3])
def test_figure(dimensions: int) -> None:
    shapes = noisy(np.random.default_rng(5), 9, dimensions)
    fits = [fit_arcs(shapes, m) for m in (1, 2)]
    with figure_style():
        text = svg("s", backbone_shapes(fits, "synthetic"))
    assert "synthetic" in text and "2 arcs" in text and f"of {len(shapes)} shapes" in text
    refused("same shapes", lambda: backbone_shapes([], "synthetic"))
    refused("same shapes", lambda: backbone_shapes([fits[0], fits[1].take([0])], "synthetic"))
