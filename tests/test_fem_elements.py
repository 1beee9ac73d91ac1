"""Shape functions: one at their own node, and exact for quadratic fields."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from bowstring.fem.elements import POINTS, brick_shape, quad_shape

# VTK's order of a quadratic hexahedron: corners below and above, edges below, above, upright
_CORNERS = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
_MIDDLES = [(0, -1), (1, 0), (0, 1), (-1, 0)]
NODES = np.array(
    [(*p, z) for plane in (_CORNERS, _MIDDLES) for z in (-1, 1) for p in plane]
    + [(*p, 0) for p in _CORNERS],
    dtype=float,
)


def test_each_function_of_a_brick_is_one_at_its_node_alone():
    value, _ = brick_shape(NODES)
    assert value == pytest.approx(np.eye(20), abs=1e-14)


def test_a_brick_represents_quadratic_fields_and_their_slopes():
    def field(x, y, z):
        return 1 + x - 2 * y + 3 * z + x * y - y * z + 0.5 * x * z + x**2 - 2 * y**2 + z**2

    def slopes(x, y, z):
        by_x, by_y = 1 + y + 0.5 * z + 2 * x, -2 + x - z - 4 * y
        return np.stack([by_x, by_y, 3 - y + 0.5 * x + 2 * z], axis=1)

    points = np.random.default_rng(1).uniform(-1, 1, (30, 3))
    value, slope = brick_shape(points)
    given = field(*NODES.T)
    assert value @ given == pytest.approx(field(*points.T), abs=1e-13)
    assert np.einsum("pnk,n->pk", slope, given) == pytest.approx(slopes(*points.T), abs=1e-13)


def test_integration_points_are_in_the_order_of_calculix():
    place = 3**-0.5
    assert POINTS[:3] == pytest.approx(place * np.array([[-1, -1, -1], [1, -1, -1], [-1, 1, -1]]))
    # two Gauss points are exact for cubics
    cubic = Polynomial([1, 2, 3, 4])
    assert cubic(POINTS[:, 0]).sum() == pytest.approx(4 * (2 + 3 * 2 / 3))


def test_a_face_has_the_functions_of_its_brick():
    x, y = np.random.default_rng(2).uniform(-1, 1, (2, 12))
    value, by_x, by_y = quad_shape(x, y)
    whole, slope = brick_shape(np.stack([x, y, np.full(12, -1.0)], axis=1))
    face = [0, 1, 2, 3, 8, 9, 10, 11]
    assert value == pytest.approx(whole[:, face], abs=1e-14)
    assert by_x == pytest.approx(slope[:, face, 0], abs=1e-14)
    assert by_y == pytest.approx(slope[:, face, 1], abs=1e-14)
