"""MuJoCo: a chain of rigid links and spatial tendons.

Model: equal links per module, joined in the middle of each piece of backbone by three hinges
(bending about x and y, twist about z) whose springs are EI/h and GJ/h; a spatial tendon runs
through one site a disk, straight and frictionless, and a motor applies the tension.
Discretisation: second order in the link length h. Statics: MuJoCo has no static solver, so the
chain is relaxed with the implicit integrator; damping = stiffness x time step makes each step a
fixed-point iteration with the elastic stiffness as its matrix, and 4 to 10 steps are enough.
Limits: no shear and no stretch (0.07 mm at 80 N); time grows faster than the square of the links.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import mujoco

from benchmarks.cases import (
    AREA,
    DENSITY,
    DISKS,
    EI,
    GJ,
    LENGTH,
    TENDON_ANGLES,
    Case,
    Solve,
    holes,
    measure,
    report,
)

STEP_S = 10.0  # long beside every period of the chain, so that inertia plays no part


Inertial = Callable[[int], tuple[float, float, float]]
"""Mass of link i = 1, 2, ... with its disk, and moments of inertia across and along its axis."""


def chain(
    links: int,
    inertial: Inertial,
    step_s: float,
    spring_time_s: float,
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tendons: int = len(TENDON_ANGLES),
) -> mujoco.MjModel:
    """`links` joints per module; joint i at (i - 1/2) h, so that stations i h lie within a body.
    The damping of a hinge over its stiffness is `spring_time_s`."""
    h = LENGTH / DISKS / links
    hinges = "".join(
        f'<joint type="hinge" axis="{axis}" stiffness="{k / h}" damping="{k / h * spring_time_s}"/>'
        for axis, k in (("1 0 0", EI), ("0 1 0", EI), ("0 0 1", GJ))
    )

    def sites(disk: int, z: float) -> str:
        return "".join(
            f'<site name="hole{t}_{disk}" pos="{x} {y} {z}"/>'
            for t, (x, y) in enumerate(holes()[:tendons])
        )

    bodies = ""
    for i in range(1, DISKS * links + 1):
        disk, rest = divmod(i, links)
        mass, across, along = inertial(i)
        bodies += f'<body name="link{i}" pos="0 0 {h if i > 1 else h / 2}">{hinges}'
        bodies += f'<inertial pos="0 0 {h / 2}" mass="{mass}" '
        bodies += f'diaginertia="{across} {across} {along}"/>'
        bodies += "" if rest else sites(disk, h / 2)
    bodies += "</body>" * (DISKS * links)

    cables = "".join(
        f'<spatial name="tendon{t}">'
        + "".join(f'<site site="hole{t}_{disk}"/>' for disk in range(DISKS + 1))
        + "</spatial>"
        for t in range(tendons)
    )
    motors = "".join(f'<motor tendon="tendon{t}" gear="-1"/>' for t in range(tendons))
    down = " ".join(map(str, gravity))
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step_s}" integrator="implicitfast" gravity="{down}">'
        '<flag contact="disable" constraint="disable"/></option>'
        f"<worldbody>{sites(0, 0.0)}{bodies}</worldbody>"
        f"<tendon>{cables}</tendon><actuator>{motors}</actuator></mujoco>"
    )


def prepare(links: int, steps: int, case: Case) -> Solve:
    backbone = DENSITY * AREA * LENGTH / DISKS / links

    def inertial(i: int) -> tuple[float, float, float]:
        return backbone + (0 if i % links else case.disk_mass), 1e-6, 1e-6

    model = chain(links, inertial, STEP_S, STEP_S, case.gravity)
    data = mujoco.MjData(model)
    tip = model.body(f"link{DISKS * links}").id  # its centre of mass is the tip

    def solve() -> list[float]:
        mujoco.mj_resetData(model, data)
        data.ctrl[:] = case.tensions
        data.xfrc_applied[tip, :3] = case.tip_force
        mujoco.mj_step(model, data, nstep=steps)
        mujoco.mj_kinematics(model, data)
        return [1e3 * x for x in data.xipos[tip]]

    return solve


SETTINGS = {
    f"{links} links/module, {steps} steps": partial(prepare, links, steps)
    for links in (1, 2, 4, 8, 16)
    for steps in (4, 6, 10)
}


def main() -> None:
    """Measure and report."""
    report(mujoco.__version__, measure(SETTINGS))


if __name__ == "__main__":
    main()
