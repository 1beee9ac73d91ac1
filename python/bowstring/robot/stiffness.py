"""Full stiffness matrix of a backbone's section: reading, checks, and numbers without couplings."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from numbers import Real
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.units import NUMBER, Marker, quote, wrong

__all__ = ["StiffnessMatrix", "flexibility", "without_couplings"]

_SIZE: Final = 6
_SYMMETRY: Final = 1e-9
_LEAST_PIVOT: Final = 1e-12
_ADVICE: Final = (
    "write six rows of six numbers in SI, for curvature about x and y, twist, shear along x and "
    "y, and extension"
)


class StiffnessMatrix(Marker):
    """Annotation of a field that is a symmetric, positive definite 6x6 matrix in SI."""

    def read(self, value: Any) -> tuple[tuple[float, ...], ...]:
        """Check a matrix given by rows."""
        rows = value.tolist() if isinstance(value, np.ndarray) else value
        if not _is_row(rows) or not all(_is_row(row) for row in rows):
            raise wrong(f"got {quote(value)}; {_ADVICE}")
        given = np.array([[_number(x) for x in row] for row in rows])
        if not np.isfinite(given).all():
            raise wrong(f"got a number that is not finite; {_ADVICE}")
        diagonal = given.diagonal()
        if (diagonal <= 0.0).any():
            i = int(np.argmin(diagonal))
            raise wrong(
                f"got {given[i, i]:g} in row {i + 1} on the diagonal; a stiffness is positive"
            )
        size = np.sqrt(np.outer(diagonal, diagonal))
        apart = abs(given - given.T) / size
        if apart.max() > _SYMMETRY:
            i, j = (int(k) for k in np.unravel_index(np.argmax(apart), apart.shape))
            raise wrong(
                f"got {given[i, j]:g} in row {i + 1}, column {j + 1}, but {given[j, i]:g} in row "
                f"{j + 1}, column {i + 1}; must be symmetric"
            )
        if np.linalg.eigvalsh(0.5 * (given + given.T) / size)[0] <= _LEAST_PIVOT:
            raise wrong(
                "got a matrix that is not positive definite, so that some strain would release "
                "energy; check the signs and sizes of the couplings"
            )
        return tuple(tuple(float(x) for x in row) for row in given)

    def json_schema(self) -> dict[str, Any]:
        """JSON Schema of the rows."""
        row = {"type": "array", "items": {"type": "number"}, "minItems": _SIZE, "maxItems": _SIZE}
        return {"type": "array", "items": row, "minItems": _SIZE, "maxItems": _SIZE}


def _is_row(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str) and len(value) == _SIZE


def _number(value: Any) -> float:
    # YAML reads 9e3 as text
    plain = isinstance(value, str) and re.fullmatch(NUMBER, value) is not None
    if not plain and (isinstance(value, bool) or not isinstance(value, Real)):
        raise wrong(f"got {quote(value)}; {_ADVICE}")
    try:
        return float(value)
    except (OverflowError, TypeError):
        raise wrong(f"got {quote(value)}; {_ADVICE}") from None


def flexibility(stiffness: ArrayLike) -> NDArray[np.float64]:
    """Strains by one moment or force alone.

    Parameters
    ----------
    stiffness : array_like (6, 6)
        Moments and forces by strains, in SI.

    Returns
    -------
    ndarray (6, 6)
        Inverse of the matrix.
    """
    matrix = np.asarray(stiffness, dtype=np.float64)
    scale = 1.0 / np.sqrt(matrix.diagonal())
    inverse = np.linalg.inv(matrix * np.outer(scale, scale)) * np.outer(scale, scale)
    return np.asarray(inverse, dtype=np.float64)


def without_couplings(stiffness: ArrayLike) -> tuple[float, ...]:
    """Numbers of a plain section that bends, twists, shears and stretches as much by one load.

    Parameters
    ----------
    stiffness : array_like (6, 6)
        Moments and forces by strains, in SI.

    Returns
    -------
    tuple of float
        Bending stiffness about both principal axes, angle of the first one from x, torsional,
        axial and shear stiffness.
    """
    free = flexibility(stiffness)
    (hard, soft), axes = np.linalg.eigh(free[:2, :2])
    if free[0, 1] == 0.0:
        first, second, angle = free[0, 0], free[1, 1], 0.0
    else:
        first, second = hard, soft
        angle = math.atan2(axes[1, 0], axes[0, 0])
    shear = 2.0 / (free[3, 3] + free[4, 4])
    return (
        float(1.0 / first),
        float(1.0 / second),
        angle,
        float(1.0 / free[2, 2]),
        float(1.0 / free[5, 5]),
        float(shear),
    )
