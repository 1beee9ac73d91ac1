"""MuJoCo on the displacement-controlled robot: the chain of mujoco_chain.py, tendon 1 held by a
stiff spring.

Model: as in statics. A tendon's own limit on its length (`range`) is a soft constraint too, which
is solved with the masses and without the stiffness, and does not come to rest in the long steps
that make MuJoCo fast here. Therefore tendon 1 has a spring whose reference is the commanded length;
with damping = stiffness x time step, as in the hinges, each step has it in its matrix, and 4 to 10
are enough. A tension-only spring switches between its two states in such steps; so the spring of
tendon 1 also pushes, and tendons 2 and 3 have none. That they are slack is prescribed, and checked.
Limits: the spring elongates by T/k. No extension of the backbone (0.04 mm at 40 N), which under
displacement control is 0.4 mm at the tip however fine the chain; a spring of 1e6 N/m happens to
compensate it.
"""

from __future__ import annotations

from functools import partial

import mujoco

from benchmarks.cases import AREA, DENSITY, DISKS, LENGTH, report
from benchmarks.displacement import BY_TENSION, LIMITS, Found, measure
from benchmarks.peers.mujoco_chain import STEP_S, chain

INERTIA = 1e-3  # plays no part in statics; with less, springs above 1e7 N/m overflow


def prepare(links: int, steps: int, stiffness: float):
    backbone = DENSITY * AREA * LENGTH / DISKS / links

    def inertial(i: int) -> tuple[float, float, float]:
        return backbone + (0 if i % links else BY_TENSION.disk_mass), INERTIA, INERTIA

    model = chain(links, inertial, STEP_S, STEP_S, BY_TENSION.gravity)
    model.tendon_stiffness[0] = stiffness
    model.tendon_damping[0] = stiffness * STEP_S
    model.tendon_lengthspring[0] = LIMITS[0]
    data = mujoco.MjData(model)
    tip = model.body(f"link{DISKS * links}").id  # its centre of mass is the tip

    def solve() -> Found:
        mujoco.mj_resetData(model, data)
        data.xfrc_applied[tip, :3] = BY_TENSION.tip_force
        mujoco.mj_step(model, data, nstep=steps)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        tension = stiffness * (data.ten_length[0] - LIMITS[0])
        hang = all(data.ten_length[t] < LIMITS[t] for t in (1, 2))
        if tension < 0 or not hang or data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise RuntimeError("unstable")
        return [1e3 * x for x in data.xipos[tip]], tension

    return solve


SETTINGS = {
    f"{links} links/module, {steps} steps, spring {k} N/m": partial(prepare, links, steps, float(k))
    for links in (1, 2, 4, 8, 16)
    for steps in (4, 6, 10)
    for k in ("1e6", "1e8")
}


def main() -> None:
    """Measure and report."""
    report(mujoco.__version__, measure(SETTINGS))


if __name__ == "__main__":
    main()
