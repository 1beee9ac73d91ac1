"""PyElastica: a discrete Cosserat rod, relaxed to rest by damped explicit dynamics.

Model: equal elements; base, disks and tip are centres of elements (so the rod is half an element
longer at each end), which makes it second order; with base and tip at nodes it is first order and
26 mm off with the coarser mesh. Tendon forces act on these elements as force and couple, so that
spans are straight and frictionless. Statics: there is no static solver; position Verlet with
critical damping of the first mode runs until the rod has settled. Rotary inertia, which has no
effect at rest, is increased to allow the longest step that the axial wave permits.
Small on purpose (few elements, two cases, one timed run each): the number of steps is proportional
to the number of elements.
"""

from __future__ import annotations

import time
from importlib.metadata import version
from math import sqrt

import elastica
import numpy as np
from numba import njit

from benchmarks.cases import (
    AREA,
    DENSITY,
    DIAMETER,
    DISKS,
    DISPLACEMENTS,
    EI,
    LENGTH,
    LOADED,
    SHEAR,
    YOUNG,
    Case,
    Result,
    holes,
    report,
)

FIRST_MODE = 3.516 * sqrt(EI / (DENSITY * AREA)) / LENGTH**2  # rad/s, clamped-free rod
SETTLING_S = 14 / FIRST_MODE  # leaves exp(-14), 1e-6, of the first displacement
INERTIA_FACTOR = 400.0


@njit(cache=True)
def add_tendon_forces(position, directors, tensions, hole, per_module, forces, torques):
    disks = (directors.shape[2] - 1) // per_module
    for t in range(tensions.shape[0]):
        arms = np.empty((disks + 1, 3))
        points = np.empty((disks + 1, 3))
        for k in range(disks + 1):
            e = k * per_module  # the element whose centre is the disk's
            arms[k] = hole[t, 0] * directors[0, :, e] + hole[t, 1] * directors[1, :, e]
            points[k] = 0.5 * (position[:, e] + position[:, e + 1]) + arms[k]
        for k in range(1, disks + 1):
            e = k * per_module
            back = points[k - 1] - points[k]
            force = tensions[t] * back / np.linalg.norm(back)
            if k < disks:
                ahead = points[k + 1] - points[k]
                force += tensions[t] * ahead / np.linalg.norm(ahead)
            forces[:, e] += 0.5 * force
            forces[:, e + 1] += 0.5 * force
            # couples are in the frame of the element
            torques[:, e] += directors[:, :, e].copy() @ np.cross(arms[k], force)


class Loads(elastica.NoForces):
    """Tendons, weight and tip force, all from the start."""

    def __init__(self, case: Case, per_module: int):
        super().__init__()
        elements = DISKS * per_module + 1
        mass = np.full(elements, DENSITY * AREA * LENGTH / (elements - 1))
        mass[-1] /= 2  # half of the last element lies beyond the tip
        mass[per_module::per_module] += case.disk_mass
        force = np.outer(case.gravity, mass)
        force[:, -1] += case.tip_force
        self.dead = np.zeros((3, elements + 1))
        self.dead[:, :-1] += force / 2
        self.dead[:, 1:] += force / 2
        self.tensions = np.array(case.tensions)
        self.holes = np.array(holes())
        self.per_module = per_module

    def apply_forces(self, system, time=0.0):
        system.external_forces += self.dead
        add_tendon_forces(
            system.position_collection,
            system.director_collection,
            self.tensions,
            self.holes,
            self.per_module,
            system.external_forces,
            system.external_torques,
        )


class Simulator(
    elastica.BaseSystemCollection, elastica.Constraints, elastica.Forcing, elastica.Damping
):
    pass


def relax(per_module: int, case: Case, duration_s: float = SETTLING_S) -> list[float]:
    h = LENGTH / (DISKS * per_module)
    rod = elastica.CosseratRod.straight_rod(
        DISKS * per_module + 1,
        start=np.array([0.0, 0.0, -h / 2]),
        direction=np.array([0.0, 0.0, 1.0]),
        normal=np.array([1.0, 0.0, 0.0]),
        base_length=LENGTH + h,
        base_radius=DIAMETER / 2,
        density=DENSITY,
        youngs_modulus=YOUNG,
        shear_modulus=SHEAR,
    )
    rod.mass_second_moment_of_inertia *= INERTIA_FACTOR
    rod.inv_mass_second_moment_of_inertia /= INERTIA_FACTOR
    dt = 0.5 * h / sqrt(YOUNG / DENSITY)

    simulator = Simulator()
    simulator.append(rod)
    simulator.constrain(rod).using(
        elastica.FixedConstraint, constrained_position_idx=(0, 1), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(Loads, case, per_module)
    simulator.dampen(rod).using(
        elastica.AnalyticalLinearDamper, uniform_damping_constant=2 * FIRST_MODE, time_step=dt
    )
    simulator.finalize()

    stepper = elastica.PositionVerlet()
    now = 0.0
    while now < duration_s:
        now = stepper.step(simulator, now, dt)
    tip = 1e3 * rod.position_collection[:, -2:].mean(axis=1)
    if not np.isfinite(tip).all():
        raise RuntimeError("the explicit integration diverged")
    return [float(x) for x in tip]


def measured(per_module: int, case: Case) -> Result:
    setting = f"{per_module} el./module, relaxed"
    relax(per_module, case, duration_s=1e-3)  # compiles
    start = time.perf_counter()
    try:
        tip = relax(per_module, case)
    except Exception as error:
        return Result(setting, case.name, note=str(error))
    return Result(setting, case.name, 1e3 * (time.perf_counter() - start), tip)


def main() -> None:
    """Measure and report."""
    results = [measured(n, case) for case in (DISPLACEMENTS[-1], LOADED) for n in (2, 4)]
    report(version("pyelastica"), results)


if __name__ == "__main__":
    main()
