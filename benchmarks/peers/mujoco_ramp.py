"""MuJoCo on the ramp: the chain of mujoco_chain.py with its inertia, implicit integrator.

MuJoCo integrates springs explicitly and dampers implicitly, and explicit springs of light, short
links require steps of some microseconds. So hinges are damped by stiffness x step / 2, which
evaluates a spring's moment at the middle of the step: stable, and the added damping decreases with
the step. (Its Runge-Kutta integrator takes more than twice the time at no smaller error.)
Mass-proportional damping: the generalised force -0.5 M v, from Python before each step, which costs
10 to 20 %; MuJoCo has no option for it.
Limits: as in statics, no shear and no stretch; first order in the step.
"""

from __future__ import annotations

from functools import partial

import mujoco
import numpy as np

from benchmarks.cases import AREA, DENSITY, DISKS, LENGTH, report
from benchmarks.peers.mujoco_chain import chain
from benchmarks.ramp import (
    DISK_ACROSS,
    DISK_ALONG,
    DISK_MASS,
    MASS_DAMPING,
    OUTPUT_S,
    OUTPUTS,
    ROTARY_INERTIA,
    Tips,
    measure,
    tension,
)


def prepare(links: int, steps: int):
    """Prepare a run with `steps` steps between two outputs."""
    step = OUTPUT_S / steps
    last = DISKS * links

    def inertial(i: int) -> tuple[float, float, float]:
        h = LENGTH / last / (2 if i == last else 1)
        mass = DENSITY * AREA * h
        across = mass * h**2 / 12 + ROTARY_INERTIA * h
        along = 2 * ROTARY_INERTIA * h
        if i % links:
            return mass, across, along
        return mass + DISK_MASS, across + DISK_ACROSS, along + DISK_ALONG

    model = chain(links, inertial, step, step / 2, tendons=1)
    data = mujoco.MjData(model)
    tip = model.body(f"link{last}").id  # its centre of mass is the tip
    momentum = np.zeros(model.nv)

    def run() -> Tips:
        mujoco.mj_resetData(model, data)
        mujoco.mj_forward(model, data)
        tips = [1e3 * data.xipos[tip]]
        for k in range(steps * OUTPUTS):
            data.ctrl[0] = tension((k + 0.5) * step)
            mujoco.mj_mulM(model, data, momentum, data.qvel)
            np.multiply(momentum, -MASS_DAMPING, out=data.qfrc_applied)
            mujoco.mj_step(model, data)
            if (k + 1) % steps == 0:
                mujoco.mj_kinematics(model, data)
                tips.append(1e3 * data.xipos[tip])
        if data.warning.number.any():
            raise RuntimeError("unstable: MuJoCo reset the motion")
        return tips

    return run


SETTINGS = {
    f"{links} links/module, dt {1e3 * OUTPUT_S / n:.3g} ms": partial(prepare, links, n)
    for links in (1, 2, 4, 8)
    for n in (1, 2, 5, 10, 20, 50)
    if links < 8 or n < 50
}


def main() -> None:
    """Measure and report."""
    report(mujoco.__version__, measure(SETTINGS))


if __name__ == "__main__":
    main()
