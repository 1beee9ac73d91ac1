"""Full stiffness matrix of a backbone's section: reading, checks, and numbers without couplings."""

from __future__ import annotations

import re
from collections.abc import Sequence
from numbers import Real
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Bools, Floats
from bowstring.units import NUMBER, Marker, quote, wrong

_SIZE: Final = 6
_ALONE: Final = np.diag([1, 1, 1, 0, 0, 1]).astype(bool)  # entries of a plain section
_ALONE[:2, :2] = True
_SYMMETRY: Final = 1e-9
_LEAST_PIVOT: Final = 1e-12
_ALIKE: Final = 1e-12  # difference of bending stiffnesses that is rounding
_ADVICE: Final = (
    "write six rows of six numbers in SI, for curvature about x and y, twist, shear along x and "
    "y, and extension"
)


class StiffnessMatrix(Marker):
    """Annotation of a field that is a symmetric, positive definite 6x6 matrix in SI."""

    def read(self, value: Any) -> tuple[tuple[float, ...], ...]:
        """Check a matrix given by rows."""
        rows = value.tolist() if isinstance(value, np.ndarray) else value
        if not _is_row(rows):
            raise wrong(f"got {quote(value)}; {_ADVICE}")
        for i, row in enumerate(rows):
            if not _is_row(row):
                raise wrong(f"got {quote(row)} as row {i + 1}; {_ADVICE}")
        given = np.array([[_number(x, i + 1) for x in row] for i, row in enumerate(rows)])
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


def _number(value: Any, row: int) -> float:
    # YAML reads 9e3 as text
    plain = isinstance(value, str) and re.fullmatch(NUMBER, value) is not None
    if not plain and (isinstance(value, bool) or not isinstance(value, Real)):
        raise wrong(f"got {quote(value)} in row {row}; {_ADVICE}")
    try:
        return float(value)
    except (OverflowError, TypeError):
        raise wrong(f"got {quote(value)} in row {row}; {_ADVICE}") from None


def entry_of(path: str) -> tuple[int, int] | None:
    """Row and column, from 0, of the entry of a stiffness matrix at a path; None for others."""
    found = re.fullmatch(r"(?:.*\.)?stiffness\.(\d)\.(\d)", path)
    return None if found is None else (int(found[1]), int(found[2]))


def mirrored(path: str) -> str | None:
    """Path of the entry on the other side of the diagonal; None for all other paths."""
    entry = entry_of(path)
    if entry is None or entry[0] == entry[1]:
        return None
    return f"{path[:-3]}{entry[1]}.{entry[0]}"


def couples(path: str) -> bool:
    """Whether the entry of a stiffness matrix at a path couples strains of a plain section.

    So does a single shear stiffness, which makes two different ones.
    """
    entry = entry_of(path)
    return entry is not None and not _ALONE[entry]


def matrix_of(rows: Sequence[Sequence[ArrayLike]]) -> Floats:
    """Matrix (..., 6, 6) of rows whose entries may be arrays (...) of many robots."""
    entries = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for row in rows for x in row))
    matrix = np.stack(entries, axis=-1).reshape(*entries[0].shape, _SIZE, _SIZE)
    return np.asarray(matrix, dtype=np.float64)


def has_couplings(stiffness: Floats) -> Bools:
    """Whether a section couples strains beyond what the numbers of a plain section describe.

    Parameters
    ----------
    stiffness : ndarray (..., 6, 6)
        Moments and forces by strains, in SI; NaN without a matrix.

    Returns
    -------
    ndarray of bool (...)
        False for a matrix that couples the two curvatures alone and has equal shear stiffnesses,
        and without a matrix.
    """
    couple = ~(np.eye(_SIZE, dtype=bool) | _ALONE)
    coupled = (stiffness[..., couple] != 0.0).any(axis=-1)
    coupled |= stiffness[..., 3, 3] != stiffness[..., 4, 4]
    return np.asarray(coupled & ~np.isnan(stiffness[..., 0, 0]))


def flexibility(stiffness: ArrayLike) -> Floats:
    """Strains by one moment or force alone.

    Parameters
    ----------
    stiffness : array_like (..., n, n)
        Moments and forces by strains, in SI.

    Returns
    -------
    ndarray (..., n, n)
        Inverses of the matrices.
    """
    matrix = np.asarray(stiffness, dtype=np.float64)
    scale = 1.0 / np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
    size = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(matrix * size) * size, dtype=np.float64)


def tension_centre(stiffness: ArrayLike) -> Floats:
    """Place in a section through which an axial force bends it about no axis.

    Parameters
    ----------
    stiffness : array_like (..., 6, 6)
        Moments and forces by strains, in SI.

    Returns
    -------
    ndarray (..., 2)
        x and y in m.
    """
    free = flexibility(stiffness)
    # a force at (x, y) bends by its moment (y, -x) and by itself
    by_place = np.stack([-free[..., :2, 1], free[..., :2, 0]], axis=-1)
    by_force = free[..., :2, 5, None]
    return np.asarray(-np.linalg.solve(by_place, by_force)[..., 0] + 0.0)


def without_couplings(rows: Sequence[Sequence[ArrayLike]]) -> tuple[ArrayLike, ...]:
    """Numbers of a plain section that bends, twists, shears and stretches as much by one load.

    Parameters
    ----------
    rows : sequence of sequence of array_like (...)
        Rows of the matrix: moments and forces by strains, in SI. Entries may be arrays of many
        robots.

    Returns
    -------
    tuple of array_like (...)
        Bending stiffness about both principal axes, angle of the first one from x, torsional,
        axial and shear stiffness.
    """
    free = flexibility(matrix_of(rows))
    bends, axes = np.linalg.eigh(free[..., :2, :2])
    alike = bends[..., 1] - bends[..., 0] <= _ALIKE * bends[..., 1]
    straight = alike | (free[..., 0, 1] == 0.0)
    first = np.where(straight, free[..., 0, 0], bends[..., 0])
    second = np.where(alike, first, np.where(straight, free[..., 1, 1], bends[..., 1]))
    angle = np.where(straight, 0.0, np.arctan2(axes[..., 1, 0], axes[..., 0, 0]))
    shear = 2.0 / (free[..., 3, 3] + free[..., 4, 4])
    numbers = (
        1.0 / first,
        1.0 / second,
        angle,
        1.0 / free[..., 2, 2],
        1.0 / free[..., 5, 5],
        shear,
    )
    return tuple(number[()] for number in numbers)
