"""soromox: geometric variable strain (GVS) rod with continuous tendons, in JAX.

Model: one Cosserat rod whose strain is a Legendre polynomial of given order in all six components;
its tendons follow a parallel curve. Statics: Newton (optimistix) on elastic + gravity + tendon
forces = 0, compiled once and reused for any load; 64 bit, one case a call.
Limits: tendons cannot run straight from disk to disk, so on this robot the tip error is that of the
model (12.4 mm at 80 N) at every order; its disks are massless, their weight is added as point
forces.
"""

from __future__ import annotations

from functools import cache, partial
from importlib.metadata import version

import jax
import jax.numpy as jnp
import numpy as np
import optimistix
from soromox.actuation import ThreadlikeActuator, ThreadlikeRouting
from soromox.systems import GVS, GVSSegment, JointSpec, LinkSpec, StrainBasisSpec

from benchmarks.cases import (
    DENSITY,
    DIAMETER,
    DISKS,
    LENGTH,
    POISSON,
    YOUNG,
    Case,
    Solve,
    holes,
    measure,
    report,
)

jax.config.update("jax_enable_x64", True)

# Its rod runs along local x: the base rotation maps (x, y, z) to the robot's (z, x, y).
BASE_POSE = jnp.array([-0.5, -0.5, -0.5, 0.5, 0.0, 0.0, 0.0])
STATIONS = jnp.linspace(0, LENGTH, DISKS + 1)[1:]


@cache
def compiled_solver(order: int, gauss_points: int):
    segment = GVSSegment(
        link=LinkSpec.circular(
            length=LENGTH,
            radius=DIAMETER / 2,
            density=DENSITY,
            reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
            young_modulus=YOUNG,
            poisson_ratio=POISSON,
        ),
        joint=JointSpec.fixed(),
        basis=StrainBasisSpec("legendre", [1] * 6, order),
        num_gauss_points=gauss_points,
    )
    paths = jnp.array([(0.0, x, y) for x, y in holes()])
    tendons = ThreadlikeActuator.tendons(ThreadlikeRouting.linear(intercept=paths))

    upright = GVS.from_segments([segment], base_pose=BASE_POSE, actuators=tendons)

    @jax.jit
    def solve(tensions, gravity, tip_force, disk_mass):
        rod = upright.update_params(gravity=gravity)
        forces = (disk_mass * gravity)[None, :].repeat(DISKS, axis=0).at[-1].add(tip_force)

        def disk_centres(q):
            return rod.forward_kinematics_abscissa_batched(q, STATIONS)[:, :3, 3]

        def imbalance(q, _):
            (applied,) = jax.vjp(disk_centres, q)[1](forces)
            elastic = rod.stiffness_matrix() @ q
            return elastic + rod.gravitational_force(q) - rod.actuation_force(q, tensions) - applied

        newton = optimistix.Newton(rtol=1e-8, atol=1e-8)
        straight = jnp.zeros(rod.num_coordinates)
        answer = optimistix.root_find(imbalance, newton, straight, max_steps=50, throw=False)
        return disk_centres(answer.value)[-1], answer.result == optimistix.RESULTS.successful

    return solve


def prepare(order: int, gauss_points: int, case: Case) -> Solve:
    solver = compiled_solver(order, gauss_points)
    loads = [jnp.array(x) for x in (case.tensions, case.gravity, case.tip_force, case.disk_mass)]

    def solve() -> list[float]:
        tip, converged = jax.block_until_ready(solver(*loads))
        if not converged:
            raise RuntimeError("Newton did not converge")
        return list(1e3 * np.asarray(tip))

    return solve


SETTINGS = {
    f"strain order {order}, {points} Gauss points": partial(prepare, order, points)
    for order, points in ((0, 5), (2, 5))
}


def main() -> None:
    """Measure and report."""
    report(version("soromox"), measure(SETTINGS))


if __name__ == "__main__":
    main()
