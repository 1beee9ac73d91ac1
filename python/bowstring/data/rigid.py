"""Rigid motions between frames: rotation and translation, right-handed only."""

from __future__ import annotations

from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.pose import nearest_rotation
from bowstring.results import Key, Result
from bowstring.validation import numbers, shown, vectors

SKEW: Final = 1e-3
"""Largest deviation of a rounded matrix from a rotation."""


class Rigid(Result):
    """Rigid motion: `rotation` (3, 3), then `translation` (3,) in m. Immutable.

    Parameters
    ----------
    rotation : array_like (3, 3)
        Rotation from the axes of the first frame to those of the second. Matrices rounded to 0.001
        are accepted and orthogonalised.
    translation : array_like (3,), optional
        Origin of the first frame in the second, m; zero by default.

    Raises
    ------
    InputError
        If the matrix is no rotation; a mirror image is a left-handed frame.
    """

    __slots__ = ("_rotation", "_translation")

    def __init__(self, rotation: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        matrix = numbers("rotation", rotation, (3, 3))
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > SKEW:
            raise InputError(
                "rotation is none: its rows must be three unit vectors at right angles, got "
                f"{shown(matrix.tolist())}"
            )
        u, _, v = np.linalg.svd(matrix)
        if np.linalg.det(u @ v) < 0:
            raise InputError(
                "rotation has determinant -1, so one of the two frames is left-handed: swap two of "
                "its axes or change the sign of one"
            )
        self._rotation: Floats = u @ v
        self._translation: Floats = numbers("translation", translation, (3,), "m")
        self._rotation.flags.writeable = self._translation.flags.writeable = False

    @classmethod
    def identity(cls) -> Rigid:
        """Make the identity."""
        return cls(np.eye(3))

    @classmethod
    def from_rotation_vector(
        cls, vector: ArrayLike, translation: ArrayLike = (0.0, 0.0, 0.0)
    ) -> Rigid:
        """Make a motion from a rotation vector (3,), axis times angle in rad."""
        turn = numbers("rotation vector", vector, (3,), "rad")
        from scipy.spatial.transform import Rotation  # takes 0.2 s, and tables do not need it

        return cls(Rotation.from_rotvec(turn).as_matrix(), translation)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> Rigid:
        """Make a motion from a homogeneous matrix (4, 4) with last row 0, 0, 0, 1."""
        whole = numbers("matrix", matrix, (4, 4))
        if not np.array_equal(whole[3], [0.0, 0.0, 0.0, 1.0]):
            raise InputError(
                f"the last row of the matrix is {whole[3].tolist()}, it must be 0, 0, 0, 1"
            )
        return cls(whole[:3, :3], whole[:3, 3])

    @property
    def rotation(self) -> Annotated[Floats, Key()]:
        """Rotation matrix (3, 3) by rows."""
        return self._rotation

    @property
    def translation(self) -> Annotated[Floats, Key("translation_m")]:
        """Translation (3,), m."""
        return self._translation

    @property
    def rotation_vector(self) -> Annotated[Floats, Key("rotation_vector_rad")]:
        """The rotation as a vector (3,), axis times angle, rad, the angle at most pi."""
        # a copy, because SciPy before 1.15.2 refuses read-only arrays
        from scipy.spatial.transform import Rotation

        return np.asarray(Rotation.from_matrix(self._rotation.copy()).as_rotvec())

    def apply(self, points: ArrayLike) -> Floats:
        """Move points (..., 3), m; NaN stays NaN."""
        rows = vectors("points", points)
        return np.asarray(rows @ self._rotation.T + self._translation)

    def inverse(self) -> Rigid:
        """Return the inverse motion."""
        return Rigid(self._rotation.T, -self._rotation.T @ self._translation)

    def compose(self, first: Rigid) -> Rigid:
        """Return this motion after another one; the same as ``second @ first``."""
        return Rigid(
            self._rotation @ first._rotation,
            self._rotation @ first._translation + self._translation,
        )

    __matmul__ = compose

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Rigid):
            return NotImplemented
        return np.array_equal(self._rotation, other._rotation) and np.array_equal(
            self._translation, other._translation
        )

    def __hash__(self) -> int:
        return hash((self._rotation.tobytes(), self._translation.tobytes()))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (self._rotation, self._translation)

    def __repr__(self) -> str:
        turn = ", ".join(f"{x:.4g}" for x in np.degrees(self.rotation_vector))
        shift = ", ".join(f"{1e3 * x:.4g}" for x in self._translation)
        return f"<Rigid: turned by ({turn}) deg, moved by ({shift}) mm>"


def align(points: Floats, targets: Floats, weight: Floats | None = None) -> Rigid:
    """Fit the rigid motion of points (K, 3) to targets (K, 3).

    Weighted least squares without reflection. For collinear points the rotation is not unique, and
    one solution is returned.
    """
    middle, target = (np.average(each, axis=0, weights=weight) for each in (points, targets))
    if len(points) == 1:
        return Rigid(np.eye(3), target - middle)
    weighted = targets - target if weight is None else weight[:, None] * (targets - target)
    matrix = nearest_rotation(weighted.T @ (points - middle))
    return Rigid(matrix, target - matrix @ middle)


def _restored(rotation: Floats, translation: Floats) -> Rigid:
    """Restore a pickled motion exactly."""
    out = Rigid(rotation, translation)
    out._rotation = rotation.copy()
    out._rotation.flags.writeable = False
    return out
