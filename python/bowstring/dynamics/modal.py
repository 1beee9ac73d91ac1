"""Natural frequencies and mode shapes of small oscillations about an equilibrium.

Everything is SI, in the base frame (z along the straight backbone) unless said otherwise.
N is the number of disks, T the number of tendons.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring import validation
from bowstring.display import html_table, in_few_rows
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import check_robot
from bowstring.statics import actuation
from bowstring.statics.actuation import Given
from bowstring.statics.rod import TendonPath, Theory

if TYPE_CHECKING:
    import bowstring._core as _core
    from bowstring.robot.model import Robot

__all__ = ["Modes", "modes"]

Floats = NDArray[np.float64]

_NEUTRAL: Final = 1e8  # by which bending is quicker than what is called neutral, squared
_ROUNDING: Final = 1e-12
_DENSE: Final = 450  # freedoms up to which all modes are found at once
_SHARE: Final = 0.2  # of all modes from which that takes less time as well
_DEFLATIONS: Final = 20


@dataclass(frozen=True, eq=False)
class Modes:
    """Small oscillations about an equilibrium, slowest first; made by `modes`.

    Attributes
    ----------
    robot : Robot
    frequency_hz : ndarray (K,)
    kind : list of str (K,)
        ``"bending"``, ``"torsion"`` or ``"axial"``: where most of the kinetic energy is, along
        the axes of the disks.
    displacement : ndarray (K, N, 3)
        Of the disks, base axes; scaled so that the largest is 1.
    rotation : ndarray (K, N, 3)
        Of the disks as small rotation vectors in their own axes, rad by the displacement's m.
        Where nothing but rotation moves, the largest rotation is 1.
    position, orientation : ndarray (N, 3) in m, (N, 3, 3)
        Of the disks in the equilibrium.
    tensions : ndarray (T,)
        In N.
    """

    robot: Robot
    frequency_hz: Floats
    kind: list[str]
    displacement: Floats
    rotation: Floats
    position: Floats
    orientation: Floats
    tensions: Floats

    def __len__(self) -> int:
        return len(self.kind)

    def __repr__(self) -> str:
        frequencies = ", ".join(f"{f:.4g}" for f in self.frequency_hz[:6])
        more = ", ..." if len(self) > 6 else ""
        return f"<Modes of {self.robot.name}: {frequencies}{more} Hz>"

    def _repr_html_(self) -> str:
        def row(k: int) -> tuple[object, ...]:
            return k + 1, f"{self.frequency_hz[k]:.6g}", self.kind[k]

        header = ("mode", "frequency, Hz", "kind")
        return html_table(f"Modes of {self.robot.name}", in_few_rows(len(self), row), header)

    def to_dict(self) -> dict[str, Any]:
        """Return the content of ``bowstring modes --json``."""
        return {
            "status": "converged",
            "tensions_N": self.tensions.tolist(),
            "modes": [
                {
                    "frequency_hz": float(f),
                    "kind": kind,
                    "displacement": d.tolist(),
                    "rotation": r.tolist(),
                }
                for f, kind, d, r in zip(
                    self.frequency_hz, self.kind, self.displacement, self.rotation, strict=True
                )
            ],
            "disks": [
                {"position_m": p, "rotation": r}
                for p, r in zip(self.position.tolist(), self.orientation.tolist(), strict=True)
            ],
        }


def modes(
    robot: Robot,
    tensions: Given | None = None,
    *,
    pulls: Given | None = None,
    angles: Given | None = None,
    count: int = 6,
    tip_force: ArrayLike = (0.0, 0.0, 0.0),
    history: Mapping[str, Any] | None = None,
    theory: Theory = "cosserat",
    gravity: Sequence[float] | None = None,
    tendon: TendonPath = "straight",
    twist: bool = True,
    elements: int | None = None,
) -> Modes:
    """Natural frequencies and mode shapes about the equilibrium of a load.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (T,), optional
        In N; none if nothing is given. They stay as they are while the robot oscillates.
    pulls, angles : array_like (T,), optional
        As in `bowstring.solve`. A tendon that is pulled keeps its length while the robot
        oscillates, but for its own stretch; one that hangs does nothing.
    count : int
        How many modes, the slowest.
    tip_force, history, theory, gravity, tendon, twist, elements
        As in `bowstring.solve`. Where a tendon that rubs bends at a hole it does not slip in
        a small oscillation: each stretch between two such holes keeps its length.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        If an argument is wrong, or the robot has no mass.
    NoSolutionError
        If there is no stable equilibrium.
    """
    check_robot(robot)
    if tensions is None and pulls is None and angles is None:
        tensions = np.zeros(robot.core.tendon_count)
    pulled, row = actuation.commands(robot, tensions, pulls, angles)
    force = validation.row("tip_force", tip_force, 3, "N")
    if not validation.is_whole(count) or count < 1:
        raise InputError(f"count is {validation.shown(count)}, it must be a positive whole number")
    validation.check_choices(theory, tendon, twist, elements, automatic=True)
    if gravity is not None:
        gravity = validation.row("gravity", gravity, 3, "m/s^2").tolist()
    physics = (theory, tendon, twist, None if elements is None else int(elements))
    path = None
    if pulled.any() or robot.has_friction or history is not None:
        path = actuation.Path(robot, *physics)
        if history is not None:
            path.resume(history)
    else:
        validation.check_values("tensions", row)
    return about(robot, pulled, row, path, physics, gravity=gravity, tip_force=force, count=count)


def about(
    robot: Robot,
    pulled: NDArray[np.bool_],
    row: Floats,
    path: actuation.Path | None,
    physics: tuple[Theory, TendonPath, bool, int | None],
    *,
    gravity: Sequence[float] | None,
    tip_force: Floats,
    count: int,
) -> Modes:
    """Modes about the next step of a path or, if there is none, about tensions."""
    import bowstring._core as _core

    if path is not None:
        solution = path.core.step(pulled, row, gravity, tip_force, np.zeros(3))
        status = solution.status
        answer = _core.flexibility_at(path.core) if status == "converged" else None
    else:
        theory, tendon, twist, elements = physics
        solution = robot.core.solve(
            row, theory, gravity, tip_force, np.zeros(3), tendon, twist, elements
        )
        status, answer = _core.flexibility(
            robot.core, row, theory, gravity, tip_force, tendon, twist, solution.elements
        )
    if answer is None:
        raise NoSolutionError(
            f"{robot.name}: there is no stable equilibrium to oscillate about ({status}); "
            "bowstring.solve with the same loads tells more",
            status="no_equilibrium",
        )
    masses, points = answer.masses, answer.points
    if not (masses > 0).any():
        raise InputError(f"{robot.name} has no mass: it has no natural frequencies")
    # sqrt(M) F sqrt(M) z = z / omega^2
    root = np.sqrt(masses)
    values, shapes = _slowest(robot, answer, root, count)
    stiffness = float(robot.bending_stiffness.min()) / robot.length**3
    if values[0] > _NEUTRAL * masses.sum() / stiffness:
        raise NoSolutionError(
            f"{robot.name}: the equilibrium is all but neutral, and its oscillations are lost in "
            "rounding; change the load a little",
            status="no_equilibrium",
        )
    # what rounding leaves of massless freedoms is no mode
    moving = values > _ROUNDING * values[0]
    values, shapes = values[moving], shapes[moving]
    positions, frames = solution.disk_positions, solution.disk_rotations
    assert positions is not None and frames is not None
    found = shapes.reshape(len(values), len(positions), points + 1, 3)
    weights = masses.reshape(len(positions), points + 1, 3)
    moved, turned = found[:, :, -2], found[:, :, -1]
    # share of the energy along and about the axis
    own = np.einsum("nji,knj->kni", frames, moved)
    sliding = own**2 * weights[:, -2]
    turning = turned**2 * weights[:, -1]
    total = sliding.sum(axis=(1, 2)) + turning.sum(axis=(1, 2))
    shares = {
        "axial": sliding[..., 2].sum(axis=1) / total,
        "torsion": turning[..., 2].sum(axis=1) / total,
    }
    kinds = [
        next((name for name, share in shares.items() if share[k] > 0.5), "bending")
        for k in range(len(values))
    ]
    size = np.linalg.norm(moved, axis=2).max(axis=1)
    spin = np.linalg.norm(turned, axis=2).max(axis=1)
    scale = np.where(size > 1e-9 * spin, size, spin)
    # the sign that moves the tip forward along its largest axis
    tip = np.where((size > 1e-9 * spin)[:, None], moved[:, -1], turned[:, -1])
    sign = np.sign(tip[np.arange(len(values)), np.abs(tip).argmax(axis=1)])
    scale = (scale * np.where(sign == 0, 1.0, sign))[:, None, None]
    return Modes(
        robot=robot,
        frequency_hz=1.0 / (2.0 * np.pi * np.sqrt(values)),
        kind=kinds,
        displacement=moved / scale,
        rotation=turned / scale,
        position=positions,
        orientation=frames,
        tensions=solution.tensions,
    )


def _slowest(
    robot: Robot, flexibility: _core.Flexibility, root: Floats, count: int
) -> tuple[Floats, Floats]:
    """Largest eigenvalues of the flexibility between masses, and displacements by their modes.

    The eigenvalues are 1 / omega^2, (K,); displacements of all freedoms (K, F).
    """
    size = len(root)
    count = min(count, size)
    if size <= _DENSE or count > _SHARE * size:
        import bowstring._core as _core

        _core.check_memory(
            40.0 * size**2,
            f"{count} modes of a robot with {len(robot.disks.station_m)} disks",
            "ask for fewer modes, or use fewer disks",
        )
        matrix = flexibility.matrix()
        values, vectors = np.linalg.eigh(root[:, None] * matrix * root[None, :])
        order = np.argsort(values)[::-1][:count]
        shapes = (matrix @ (root[:, None] * vectors[:, order])).T / values[order][:, None]
        return values[order], shapes
    values, vectors = _iterated(flexibility, root, count)
    moved = np.array([flexibility.apply(root * vector) for vector in vectors.T])
    return values, moved / np.maximum(values, np.finfo(float).tiny)[:, None]


def _iterated(flexibility: _core.Flexibility, root: Floats, count: int) -> tuple[Floats, Floats]:
    """Largest eigenvalues (K,) and eigenvectors (F, K) by implicitly restarted Lanczos iteration.

    Lanczos iteration from one start may miss one of two equal eigenvalues, such as those of
    bending in two planes: the rest of the operator is searched as well, until what it has is less.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    import bowstring._core as _core

    size = len(root)
    basis = max(2 * count + 1, 20)
    _core.check_memory(
        8.0 * size * (3 * basis + 2 * count), f"{count} modes", "ask for fewer modes"
    )
    values, vectors = np.zeros(0), np.zeros((size, 0))

    def rest(z: Floats) -> Floats:
        z = z.ravel()
        moved = root * flexibility.apply(root * z)
        moved -= vectors @ (values * (vectors.T @ z))
        return np.asarray(moved, dtype=np.float64)

    random = np.random.default_rng(0)
    wanted = count
    try:
        for _ in range(_DEFLATIONS):
            found, shapes = eigsh(
                LinearOperator((size, size), matvec=rest, dtype=np.float64),
                k=wanted,
                ncv=basis,
                which="LA",
                v0=random.standard_normal(size),
            )
            known = values.min() if len(values) >= count else -np.inf
            values = np.concatenate([values, found])
            vectors = np.hstack([vectors, shapes])
            order = np.argsort(values)[::-1][:count]
            values, vectors = values[order], vectors[:, order]
            if found.max() <= known * (1 + 1e-9):
                break
            wanted = 1
    except ArpackNoConvergence:
        raise NoSolutionError(
            f"{count} modes were not found in the iterations allowed; ask for fewer modes",
            status="max_iterations",
        ) from None
    return values, vectors
