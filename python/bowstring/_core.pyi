"""The compiled core; `bowstring.statics` and `bowstring.constant_curvature` are its public face."""

from collections.abc import Callable, Sequence
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

__version__: str

# Constant curvature: one arc a row (bend x, bend y, length); no shares mean curved spans.
def arc_bend(kappa: Floats, phi: Floats, length: Floats) -> Floats: ...
def arc_bend_jacobian(kappa: Floats, phi: Floats, length: Floats) -> Floats: ...
def arc_curvature(arcs: Floats) -> Floats: ...
def arc_curvature_jacobian(arcs: Floats) -> Floats: ...
def arc_part(arcs: Floats, s: Floats) -> Floats: ...
def arc_pose(arcs: Floats) -> tuple[Floats, Floats]: ...
def arc_pose_jacobian(arcs: Floats) -> Floats: ...
def arc_lengths(arcs: Floats, hole: Floats, shares: Floats) -> Floats: ...
def arc_lengths_jacobian(arcs: Floats, hole: Floats, shares: Floats) -> Floats: ...
def arc_fit(
    lengths: Floats, hole: Floats, shares: Floats, length: Floats | None
) -> tuple[Floats, Floats]: ...
def arc_fit_jacobian(arcs: Floats, hole: Floats, shares: Floats, hold_length: bool) -> Floats: ...
def arc_from_tensions(
    tensions: Floats,
    hole: Floats,
    length: Floats,
    bending_stiffness: Floats,
    modules: int | None,
) -> Floats: ...
def arc_through(positions: Floats) -> Floats: ...
def arc_nearest(positions: Floats, length: Floats) -> tuple[Floats, Floats]: ...

@final
class Robot:
    def __new__(
        cls,
        station_m: Floats,
        clamped_length_m: Floats,
        disk_mass_kg: Floats,
        disk_inertia: Floats,
        disk_segment: Ints,
        bending_stiffness: Floats,
        torsion_stiffness: Floats,
        axial_stiffness: Floats,
        shear_stiffness: Floats,
        mass_per_length: Floats,
        rotary_inertia: Floats,
        hole_m: Floats,
        end_disk: Ints,
        gravity: Floats,
    ) -> Robot: ...
    @property
    def tendon_count(self) -> int: ...
    @property
    def disk_count(self) -> int: ...
    def solve(
        self,
        tensions: ArrayLike,
        theory: str,
        gravity: ArrayLike | None,
        tip_force: ArrayLike,
        tip_moment: ArrayLike,
        tendon: str,
        twist: bool,
        elements: int | None,
    ) -> Solution: ...
    def sweep(
        self,
        tensions: Floats,
        theory: str,
        gravity: ArrayLike | None,
        tip_force: ArrayLike,
        tip_moment: ArrayLike,
        tendon: str,
        twist: bool,
        elements: int | None,
        warm: bool,
        disks: bool,
    ) -> dict[str, Any]: ...
    def solve_batch(
        self,
        tensions: Floats,
        theory: str,
        gravity: ArrayLike | None,
        tip_force: ArrayLike,
        tip_moment: ArrayLike,
        tendon: str,
        twist: bool,
        elements: int | None,
        threads: int,
        disks: bool,
    ) -> dict[str, Any]: ...

@final
class Drive:
    def __new__(
        cls,
        robot: Robot,
        theory: str,
        tendon: str,
        twist: bool,
        elements: int | None,
        stiffness: ArrayLike,
        free_length: ArrayLike,
        compliance: ArrayLike,
        friction: ArrayLike,
        pretension: ArrayLike,
    ) -> Drive: ...
    def reset(self) -> None: ...
    def step(
        self,
        pulled: NDArray[np.bool_],
        commands: ArrayLike,
        gravity: ArrayLike | None,
        tip_force: ArrayLike,
        tip_moment: ArrayLike,
    ) -> Solution: ...
    def follow(
        self,
        pulled: NDArray[np.bool_],
        commands: Floats,
        gravity: ArrayLike | None,
        tip_force: ArrayLike,
        tip_moment: ArrayLike,
        disks: bool,
        path: bool,
        threads: int,
    ) -> dict[str, Any]: ...
    def history(self) -> dict[str, Any]: ...
    def resume(
        self,
        tensions: Floats,
        drops: Floats,
        spans: Floats,
        pulled: NDArray[np.bool_],
        commands: Floats,
        gravity: ArrayLike,
        tip_force: ArrayLike,
        tip_moment: ArrayLike,
        strain: Floats,
        slips: NDArray[np.int8],
    ) -> None: ...

@final
class Simulator:
    def __new__(
        cls,
        robot: Robot,
        theory: str,
        tendon: str,
        twist: bool,
        elements: int,
        gravity: Sequence[float] | None,
        mass_damping: float,
        material_damping: float,
        spectral_radius: float,
        step: float | None,
        tolerance: float,
        longest_step: float,
        points: int,
        home: Floats,
        compliance: Floats,
    ) -> Simulator: ...
    def write_to(
        self,
        sections: Floats,
        station: Floats,
        room: NDArray[np.uint8],
        append: Callable[[NDArray[np.uint8]], None],
    ) -> None: ...
    def rest(self, tensions: Floats, tip_force: Floats, tip_moment: Floats) -> str: ...
    def rest_at(self, drive: Drive) -> bool: ...
    def hold(self, forces: Floats, increments: int) -> bool: ...
    def release(self) -> None: ...
    def jump(self, tensions: Floats, tip_force: Floats, tip_moment: Floats) -> None: ...
    def run(
        self,
        duration: Floats,
        tensions: Floats,
        tip_force: Floats,
        tip_moment: Floats,
        record: NDArray[np.bool_],
    ) -> Literal["step_failed", "collision"] | None: ...
    def tip(self) -> tuple[Floats, Floats, Floats]: ...
    def fields(self) -> dict[str, Floats]: ...
    @property
    def steps(self) -> int: ...
    @property
    def iterations(self) -> int: ...
    @property
    def repeated(self) -> int: ...
    @property
    def error(self) -> float | None: ...
    @property
    def output_s(self) -> float: ...
    @property
    def next_step(self) -> float: ...
    @property
    def time(self) -> float: ...

@final
class Flexibility:
    @property
    def masses(self) -> Floats: ...
    @property
    def points(self) -> int: ...
    def apply(self, forces: Floats) -> Floats: ...
    def matrix(self) -> Floats: ...

def flexibility(
    robot: Robot,
    tensions: Floats,
    theory: str,
    gravity: Sequence[float] | None,
    tip_force: Floats,
    tendon: str,
    twist: bool,
    elements: int,
) -> tuple[str, Flexibility | None]: ...
def flexibility_at(drive: Drive) -> Flexibility | None: ...
def check_memory(bytes: float, what: str, cure: str) -> None: ...
def von_mises(sigma: Floats, tau: Floats) -> Floats: ...
def surface_stress(sections: Floats, force: Floats, moment: Floats) -> Floats: ...
def derive(
    sections: Floats, position: Floats, rotation: Floats, force: Floats, moment: Floats
) -> dict[str, Floats]: ...

@final
class Solution:
    @property
    def status(self) -> str: ...
    @property
    def converged(self) -> bool: ...
    @property
    def stable(self) -> bool | None: ...
    @property
    def iterations(self) -> int: ...
    @property
    def residual(self) -> float: ...
    @property
    def left_unstable(self) -> bool: ...
    @property
    def fraction(self) -> float: ...
    @property
    def collision(self) -> int | None: ...
    @property
    def theory(self) -> Literal["cosserat", "kirchhoff"]: ...
    @property
    def tendon(self) -> Literal["straight", "continuous"]: ...
    @property
    def twist(self) -> bool: ...
    @property
    def elements(self) -> int: ...
    @property
    def error_estimate(self) -> tuple[float, float] | None: ...
    @property
    def tensions(self) -> Floats: ...
    @property
    def gravity(self) -> Floats: ...
    @property
    def tip_force(self) -> Floats: ...
    @property
    def tip_moment(self) -> Floats: ...
    @property
    def tip_position(self) -> Floats | None: ...
    @property
    def tip_rotation(self) -> Floats | None: ...
    @property
    def disk_positions(self) -> Floats | None: ...
    @property
    def disk_rotations(self) -> Floats | None: ...
    @property
    def tendon_lengths(self) -> Floats | None: ...
    @property
    def driven(self) -> bool: ...
    @property
    def pulled(self) -> NDArray[np.bool_] | None: ...
    @property
    def commands(self) -> Floats | None: ...
    @property
    def undetermined(self) -> bool | None: ...
    @property
    def length_residual(self) -> float | None: ...
    @property
    def conflict(self) -> tuple[list[int], list[float] | None] | None: ...
    @property
    def pulls(self) -> Floats | None: ...
    @property
    def slack_lengths(self) -> Floats | None: ...
    @property
    def span_tensions(self) -> Floats | None: ...
    def centerline(self, points_per_module: int) -> Floats | None: ...
    def jacobians(self) -> dict[str, Floats] | None: ...
