"""Quadratic elements: shape functions, and integration points of CalculiX.

The order of nodes is that of the mesh.
"""

from __future__ import annotations

import math
from itertools import product
from typing import Final

import numpy as np

from bowstring.aliases import Floats

GAUSS: Final = 1.0 / math.sqrt(3.0)
"""Coordinate of the integration points of C3D20R, 2 in each direction."""
POINTS: Final = GAUSS * np.array([p[::-1] for p in product((-1.0, 1.0), repeat=3)])
"""Integration points of C3D20R (8, 3) in CalculiX's order, x fastest."""
_THREE: Final = math.sqrt(0.6) * np.array([-1.0, 0.0, 1.0])
MASS_POINTS: Final = np.array([p[::-1] for p in product(_THREE, repeat=3)])
"""Points (27, 3) at which CalculiX integrates the mass of C3D20R."""
MASS_WEIGHTS: Final = np.prod(list(product((5 / 9, 8 / 9, 5 / 9), repeat=3)), axis=1)
"""Weights (27,) of these points."""
# in the order of a brick's nodes
_CORNERS: Final = np.array(
    [(x, y, z) for z in (-1, 1) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))], dtype=float
)
_FLAT: Final = ((0, -1), (1, 0), (0, 1), (-1, 0))
_EDGES: Final = np.array(
    [(*p, -1) for p in _FLAT]
    + [(*p, 1) for p in _FLAT]
    + [(x, y, 0) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))],
    dtype=float,
)


def brick_shape(points: Floats) -> tuple[Floats, Floats]:
    """Shape functions (p, 20) of a brick of 20 nodes, and their derivatives (p, 20, 3)."""
    x = points[:, None]
    values, slopes = [], []
    for nodes, corner in ((_CORNERS, True), (_EDGES, False)):
        on = nodes[None]
        factor = np.where(on == 0, 1.0 - x**2, 1.0 + x * on)
        slope = np.where(on == 0, -2.0 * x, on + 0.0 * x)
        others = factor[..., [1, 0, 0]] * factor[..., [2, 2, 1]]
        whole = factor.prod(axis=-1)
        if corner:
            line = (x * on).sum(axis=-1) - 2.0
            values.append(0.125 * whole * line)
            slopes.append(0.125 * (slope * others * line[..., None] + whole[..., None] * on))
        else:
            values.append(0.25 * whole)
            slopes.append(0.25 * slope * others)
    return np.concatenate(values, axis=1), np.concatenate(slopes, axis=1)


def quad_shape(xi: Floats, eta: Floats) -> tuple[Floats, Floats, Floats]:
    """Shape functions of a quadrilateral of 8 nodes, and their derivatives; each (..., 8)."""
    x, y = np.asarray(xi)[..., None], np.asarray(eta)[..., None]
    a, b = np.array([-1.0, 1.0, 1.0, -1.0]), np.array([-1.0, -1.0, 1.0, 1.0])
    corner = 0.25 * (1 + x * a) * (1 + y * b) * (x * a + y * b - 1)
    by_x = 0.25 * a * (1 + y * b) * (2 * x * a + y * b)
    by_y = 0.25 * b * (1 + x * a) * (x * a + 2 * y * b)
    flat = 0.5 * (1 - x * x) * np.concatenate([1 - y, 1 + y], axis=-1)  # edges 5 and 7
    tall = 0.5 * (1 - y * y) * np.concatenate([1 + x, 1 - x], axis=-1)  # edges 6 and 8
    one = np.ones_like(x)
    flat_x = -x * np.concatenate([1 - y, 1 + y], axis=-1)
    flat_y = 0.5 * (1 - x * x) * np.concatenate([-one, one], axis=-1)
    tall_x = 0.5 * (1 - y * y) * np.concatenate([one, -one], axis=-1)
    tall_y = -y * np.concatenate([1 + x, 1 - x], axis=-1)

    def join(c: Floats, f: Floats, t: Floats) -> Floats:
        return np.concatenate([c, f[..., :1], t[..., :1], f[..., 1:], t[..., 1:]], axis=-1)

    return join(corner, flat, tall), join(by_x, flat_x, tall_x), join(by_y, flat_y, tall_y)
