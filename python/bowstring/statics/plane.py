"""A rigid plane that the tip may touch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.errors import InputError


@dataclass(frozen=True)
class Plane:
    """Rigid plane; the robot is on the side to which the normal points.

    The values are kept as tuples of floats, the normal with unit length.

    Parameters
    ----------
    point : array_like (3,)
        Any point of the plane in the base frame, in m.
    normal : array_like (3,)
        Normal in the base frame, of any length above 0.
    friction : float
        Coefficient of Coulomb friction between tip and plane; 0 is a frictionless plane.

    Raises
    ------
    InputError
        If a number is not finite, the normal is zero or the friction negative.

    Examples
    --------
    >>> import bowstring as bs
    >>> wall = bs.Plane([0.2, 0, 0], [-2, 0, 0])
    >>> wall.normal
    (-1.0, 0.0, 0.0)
    >>> wall.gap([0.15, 0, 0.6]).round(3)
    np.float64(0.05)
    """

    point: Any
    normal: Any
    friction: float = 0.0

    def __post_init__(self) -> None:
        point = validation.numbers("point", self.point, (3,), "m")
        normal = validation.numbers("normal", self.normal, (3,))
        friction = validation.number("friction", self.friction, zero=True)
        largest = float(np.abs(normal).max())
        if largest == 0.0:
            raise InputError(
                "normal is zero, it must be a vector that points from the plane to the robot"
            )
        normal = normal / largest  # no overflow in the norm
        normal = normal / np.linalg.norm(normal)
        object.__setattr__(self, "point", tuple(point.tolist()))
        object.__setattr__(self, "normal", tuple((normal + 0.0).tolist()))
        object.__setattr__(self, "friction", friction)

    def gap(self, positions: ArrayLike) -> Any:
        """Signed distance (...) of positions (..., 3) in m, negative beyond the plane."""
        return (validation.vectors("positions", positions) - self.point) @ np.array(self.normal)

    @property
    def axes(self) -> Floats:
        """Orthonormal axes (3, 3) as rows: the normal and two tangents."""
        x, y, z = self.normal
        # Duff et al. 2017, Building an orthonormal basis, revisited (Listing 3)
        sign = 1.0 if z >= 0 else -1.0
        a = -1.0 / (sign + z)
        b = x * y * a
        first = (1.0 + sign * x * x * a, sign * b, -sign * x)
        return np.array([self.normal, first, (b, sign + y * y * a, -y)])
