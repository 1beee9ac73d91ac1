"""Natural frequencies and mode shapes of small oscillations about an equilibrium.

All values are in SI and in the base frame (z along the straight backbone) by default.
N is the number of disks, T the number of tendons.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np

from bowstring import validation
from bowstring._core import check_memory, flexibility, flexibility_at
from bowstring.aliases import Bools, Floats
from bowstring.display import html_table, sampled_rows, short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.pose import Pose
from bowstring.results import Key, Result
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.statics import actuation
from bowstring.statics.actuation import Given
from bowstring.statics.load import Load, as_load
from bowstring.statics.load_tables import points_have_potential, with_arrays
from bowstring.statics.messages import StaticsStatus
from bowstring.statics.model import as_model

if TYPE_CHECKING:
    import xarray as xr

    from bowstring._core import Flexibility, RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.fields import Labelled

_NEUTRAL: Final = 1e8  # squared frequency ratio of bending to a mode that counts as neutral
_ROUNDING: Final = 1e-12
_DENSE: Final = 450  # degrees of freedom up to which all modes are computed at once
_SHARE: Final = 0.2  # share of all modes above which this is faster as well
_DEFLATIONS: Final = 20


@dataclass(frozen=True, eq=False)
class Mode(Result):
    """A natural mode of small oscillation."""

    frequency_hz: Annotated[float, Key()]
    """Natural frequency."""
    kind: Annotated[str, Key()]
    """``bending``, ``torsion`` or ``axial``."""
    displacement: Annotated[Floats, Key()]
    """Displacement of each disk (N, 3) in base axes; the largest is 1."""
    rotation: Annotated[Floats, Key(unit="rad/m of displacement")]
    """Small rotation vector of each disk (N, 3) in its own axes."""


@dataclass(frozen=True, eq=False)
class Modes(Result):
    """Natural modes of small oscillations about an equilibrium, slowest first; made by `modes`."""

    robot: Robot
    """The robot."""
    frequency_hz: Floats
    """Natural frequencies (K,), Hz."""
    kind: list[str]
    """``"bending"``, ``"torsion"`` or ``"axial"``, by the largest part of the kinetic energy in the
    axes of the disks (K,)."""
    displacement: Floats
    """Displacements (K, N, 3) of the disks in base axes, scaled to a largest value of 1."""
    rotation: Floats
    """Small rotation vectors (K, N, 3) of the disks in their own axes, in rad per m of
    displacement. In a mode without displacement the largest rotation is 1."""
    position: Floats
    """Positions (N, 3) of the disks in the equilibrium, m."""
    orientation: Floats
    """Rotations (N, 3, 3) of the disks in the equilibrium."""
    tensions: Annotated[Floats, Key("tensions_N")]
    """Tensions (T,) in the equilibrium, N."""

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
        return html_table(f"Modes of {self.robot.name}", sampled_rows(len(self), row), header)

    def to_dataset(self) -> xr.Dataset:
        """Return all modes with labels and units, along the dimension ``mode``."""
        from bowstring.statics.fields import rows_to_dataset

        vectors = ("disk", "axis")
        turned = "small rotation of the disks in their own axes, by the displacement's m"
        others: dict[str, Labelled] = {
            "frequency": ((), self.frequency_hz, "Hz", "natural frequency"),
            "kind": ((), np.array(self.kind, dtype=str), "1", "bending, torsion or axial"),
            "displacement": (vectors, self.displacement, "1", "of the disks, the largest is 1"),
            "rotation": (vectors, self.rotation, "rad/m", turned),
        }
        tensions = {"tensions_N": self.tensions}
        return rows_to_dataset(self.robot, "mode", {}, others, tensions)

    @property
    def modes(self) -> Annotated[list[Mode], Key()]:
        """Modes, slowest first."""
        shapes = zip(self.frequency_hz, self.kind, self.displacement, self.rotation, strict=True)
        return [Mode(float(frequency), *shape) for frequency, *shape in shapes]

    @property
    def disks(self) -> Annotated[list[Pose], Key()]:
        """Disks of the equilibrium from base to tip."""
        return list(map(Pose, self.position, self.orientation))

    @property
    def status(self) -> Annotated[StaticsStatus, Key()]:
        """Status of the equilibrium, as in ``solve``: ``converged``, else there are no modes."""
        return "converged"


def modes(
    robot: Robot,
    tensions: Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    history: Mapping[str, Any] | None = None,
    count: int = 6,
) -> Modes:
    """Compute natural frequencies and mode shapes about the equilibrium of a load.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : array_like (T,), optional
        Tensions in N, short for ``load=Load(tensions)``; zero by default. They stay constant in the
        oscillation.
    load : Load, optional
        As in `bowstring.solve`, without a moment. A displacement-controlled tendon keeps its
        length in the oscillation except for its own elasticity; a slack one has no effect.
    model : RodModel, optional
        As in `bowstring.solve`.
    history : mapping, optional
        As in `bowstring.solve`. A tendon with friction sticks at each hole where it bends: its
        length between two such holes stays constant in a small oscillation.
    count : int
        Number of modes.

    Returns
    -------
    Modes
        Modes, the slowest first.

    Raises
    ------
    InputError
        If an argument is wrong, or the robot has no mass.
    NoSolutionError
        If there is no stable equilibrium.
    """
    model = as_model(model)
    commands, dead, path = checked(robot, tensions, load, model, history, count)
    return about(robot, commands, dead, model, path, count=count)


def checked(
    robot: Robot,
    tensions: Given | None,
    load: Load | None,
    model: RodModel,
    history: Mapping[str, Any] | None,
    count: int,
) -> tuple[tuple[Bools, Floats], Load, actuation.Path | None]:
    """Commands, dead loads and path of an equilibrium to oscillate about."""
    check_robot(robot)
    check_without_laws(robot, ", which dynamics does not model", but=("friction", *OF_COMMANDS))
    load = as_load(tensions, load)
    if not load.is_actuated:
        load = load.replace(tensions=np.zeros(robot.core.tendon_count))
    commands = actuation.commands(robot, load)
    load = with_arrays(load)
    moment, force = load.tip_moment, load.tip_force
    if moment is not None and validation.row("tip_moment", moment, 3, "N m").any():
        raise InputError("a load with a tip moment has no modes, as a moment has no potential")
    if load.disk_moments is not None and load.disk_moments.any():
        raise InputError("a load with disk_moments has no modes, as a moment has no potential")
    if not points_have_potential(load.point_loads):
        raise InputError(
            "a load with moments or followers in point_loads has no modes: these have no potential"
        )
    if not validation.is_whole(count) or count < 1:
        raise InputError(f"count is {validation.shown(count)}, it must be a positive whole number")
    gravity = load.gravity
    load = Load(
        gravity=None if gravity is None else validation.row("gravity", gravity, 3, "m/s^2"),
        tip_force=None if force is None else validation.row("tip_force", force, 3, "N"),
        disk_forces=load.disk_forces,
        disk_moments=load.disk_moments,
        point_loads=load.point_loads,
        line_forces=load.line_forces,
    )
    path = None
    if commands[0].any() or robot.has_friction or history is not None:
        path = actuation.Path(robot, model, history)
    else:
        validation.check_values("tensions", commands[1], least=robot.tendons.least_tension_N)
    return commands, load, path


def about(
    robot: Robot,
    commands: tuple[Bools, Floats],
    load: Load,
    model: RodModel,
    path: actuation.Path | None,
    *,
    count: int,
) -> Modes:
    """Compute modes about the next step of a path or, without a path, about tensions.

    ``commands`` are those of `bowstring.statics.actuation.commands`, ``load`` has gravity and
    the loads at the tip and on disks.
    """
    found = oscillation(robot, commands, load, model, path, count=count)
    moved, turned = found.displacement, found.rotation
    size = np.linalg.norm(moved, axis=2).max(axis=1)
    spin = np.linalg.norm(turned, axis=2).max(axis=1)
    scale = np.where(size > 1e-9 * spin, size, spin)
    # choose the sign so that the largest component of the tip's displacement is positive
    tip = np.where((size > 1e-9 * spin)[:, None], moved[:, -1], turned[:, -1])
    sign = np.sign(tip[np.arange(len(tip)), np.abs(tip).argmax(axis=1)])
    scale = (scale * np.where(sign == 0, 1.0, sign))[:, None, None]
    return Modes(
        robot=robot,
        frequency_hz=found.speed / (2.0 * np.pi),
        kind=found.kind,
        displacement=moved / scale,
        rotation=turned / scale,
        position=found.position,
        orientation=found.orientation,
        tensions=found.tensions,
    )


@short_repr
@dataclass(frozen=True, eq=False)
class Oscillation:
    """Modes whose mass is 1 kg, slowest first; made by `oscillation`."""

    speed: Floats
    """Angular frequencies (K,), rad/s."""
    kind: list[str]
    """Kinds of the modes (K,), as in `Modes`."""
    displacement: Floats
    """Displacements of the disks in base axes per modal coordinate (K, N, 3)."""
    rotation: Floats
    """Rotations of the disks in their own axes per modal coordinate (K, N, 3), rad/m."""
    position: Floats
    """Positions of the disks in the equilibrium (N, 3), m."""
    orientation: Floats
    """Rotations of the disks in the equilibrium (N, 3, 3)."""
    tensions: Floats
    """Tensions in the equilibrium (T,), N."""


def oscillation(
    robot: Robot,
    commands: tuple[Bools, Floats],
    load: Load,
    model: RodModel,
    path: actuation.Path | None,
    *,
    count: int,
) -> Oscillation:
    """Compute the modes of `about` in modal coordinates of unit mass."""
    status: str
    if path is not None:
        solution = path.core.step(*commands, load)
        status = solution.status
        answer = flexibility_at(path.core) if status == "converged" else None
    else:
        solution = robot.core.solve(commands[1], load, model)
        status, answer = flexibility(robot.core, commands[1], load, solution.model)
    if answer is None:
        raise NoSolutionError(
            f"{robot.name}: there is no stable equilibrium to oscillate about ({status}); "
            "run bowstring solve with these loads for the reason",
            status="no_equilibrium",
        )
    masses, points = answer.masses, answer.points
    if not (masses > 0).any():
        raise InputError(f"{robot.name} has no mass: it has no natural frequencies")
    # sqrt(M) F sqrt(M) z = z / omega^2, F the flexibility (docs/theory/dynamics.md, modal analysis)
    root = np.sqrt(masses)
    values, shapes = _slowest(robot, answer, root, count)
    stiffness = float(robot.bending_stiffness.min()) / robot.length**3
    if values[0] > _NEUTRAL * masses.sum() / stiffness:
        raise NoSolutionError(
            f"{robot.name}: the equilibrium is all but neutral, and its oscillations are lost in "
            "rounding; change the load a little",
            status="no_equilibrium",
        )
    # massless degrees of freedom have eigenvalues of rounding size, which are no modes
    moving = values > _ROUNDING * values[0]
    values, shapes = values[moving], shapes[moving] / values[moving, None]
    positions, frames = solution.disk_positions, solution.disk_rotations
    assert positions is not None and frames is not None
    found = shapes.reshape(len(values), len(positions), points + 1, 3)
    weights = masses.reshape(len(positions), points + 1, 3)
    moved, turned = found[:, :, -2].copy(), found[:, :, -1].copy()
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
    for disk, motion in answer.loaded_disks:
        # from the motion of the common centre of mass to that of the disk
        both = np.concatenate([moved[:, disk], turned[:, disk]], axis=1) @ motion.T
        moved[:, disk], turned[:, disk] = both[:, :3], both[:, 3:]
    return Oscillation(
        speed=1.0 / np.sqrt(values),
        kind=kinds,
        displacement=moved,
        rotation=turned,
        position=positions,
        orientation=frames,
        tensions=solution.tensions,
    )


def _slowest(robot: Robot, answer: Flexibility, root: Floats, count: int) -> tuple[Floats, Floats]:
    """Largest eigenvalues of the mass-weighted flexibility, and their mode shapes times them.

    The eigenvalues are 1 / omega^2, (K,); the shapes of all degrees of freedom (K, F).
    """
    size = len(root)
    count = min(count, size)
    if size <= _DENSE or count > _SHARE * size:
        check_memory(
            40.0 * size**2,
            f"{count} modes of a robot with {len(robot.disks.station_m)} disks",
            "ask for fewer modes, or use fewer disks",
        )
        matrix = answer.matrix()
        values, vectors = np.linalg.eigh(root[:, None] * matrix * root[None, :])
        order = np.argsort(values)[::-1][:count]
        return values[order], (matrix @ (root[:, None] * vectors[:, order])).T
    values, vectors = _iterated(answer, root, count)
    return values, np.array([answer.apply(root * vector) for vector in vectors.T])


def _iterated(answer: Flexibility, root: Floats, count: int) -> tuple[Floats, Floats]:
    """Largest eigenvalues (K,) and eigenvectors (F, K) by implicitly restarted Lanczos iteration.

    Lanczos iteration from one start may miss one of two equal eigenvalues, such as those of
    bending in two planes. The deflated operator is therefore searched as well, until its largest
    eigenvalue is smaller.
    """
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    size = len(root)
    basis = max(2 * count + 1, 20)
    check_memory(8.0 * size * (3 * basis + 2 * count), f"{count} modes", "ask for fewer modes")
    values, vectors = np.zeros(0), np.zeros((size, 0))

    def rest(z: Floats) -> Floats:
        z = z.ravel()
        moved = root * answer.apply(root * z)
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
