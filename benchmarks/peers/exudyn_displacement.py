"""Exudyn on the displacement-controlled robot: the rod of exudyn_rod.py, tendon 1 a rope that is
shortened.

Model: as in statics; tendon 1 is a `ReevingSystemSprings` through points of all disks, with uniform
force and stiffness EA over its length, whose reference length is reduced to the commanded one in
load steps. The rope also pushes (`regularizationForce` < 0), and tendons 2 and 3, which are known
to be slack, are left out.
Limits: the rope elongates by T L / EA. At EA = 1e6 N the static solver converges in 50 equal load
steps and not in 40; at 1e7 N only with adaptive steps, here from 20 on. The tolerance is 1e-6, with
adaptive steps 1e-4. Each setting runs once.
"""

from __future__ import annotations

from functools import partial

from benchmarks.cases import LENGTH, holes, report
from benchmarks.displacement import BY_TENSION, DISPLACEMENTS, Found, measure
from benchmarks.peers.exudyn_rod import exudyn, item, model_axes, rod, static_settings


def prepare(elements: int, stiffness: float, load_steps: int, tolerance: float, adaptive: bool):
    system, nodes, beams, disks, _ = rod(elements, BY_TENSION.disk_mass, tendons=0)
    for body in (*disks, *beams):
        marker = system.AddMarker(item.MarkerBodyMass(bodyNumber=body))
        load = item.LoadMassProportional(
            markerNumber=marker, loadVector=model_axes(BY_TENSION.gravity)
        )
        system.AddLoad(load)
    tip = system.AddMarker(item.MarkerNodePosition(nodeNumber=nodes[-1]))
    system.AddLoad(
        item.LoadForceVector(markerNumber=tip, loadVector=model_axes(BY_TENSION.tip_force))
    )

    ground = system.AddObject(item.ObjectGround())
    hole = model_axes((*holes()[0], 0))
    points = [
        system.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=hole))
        for body in (ground, *disks)
    ]
    rope = system.AddObject(
        item.ReevingSystemSprings(
            markerNumbers=points,
            stiffnessPerLength=stiffness,
            regularizationForce=-1,
            referenceLength=LENGTH,
            sheavesAxes=exudyn.Vector3DList([[0, 0, 1]] * len(points)),
            sheavesRadii=[0.0] * len(points),
        )
    )

    def shorten(mbs, load_factor: float) -> bool:
        mbs.SetObjectParameter(rope, "referenceLength", LENGTH - DISPLACEMENTS[0] * load_factor)
        return True

    system.SetPreStepUserFunction(shorten)
    system.Assemble()

    settings = static_settings(load_steps, tolerance, adaptive=adaptive)

    def solve() -> Found:
        if not system.SolveStatic(
            settings, storeSolver=False, showCausingItems=False, showHints=False
        ):
            raise RuntimeError("static solver failed")
        x, y, z = system.GetNodeOutput(nodes[-1], exudyn.OutputVariableType.Position)
        force = system.GetObjectOutput(rope, exudyn.OutputVariableType.ForceLocal)
        return [1e3 * y, 1e3 * z, 1e3 * x], force

    return solve


SETTINGS = {
    **{
        f"{e} el./module, EA 1e6 N, 50 load steps": partial(prepare, e, 1e6, 50, 1e-6, False)
        for e in (1, 2, 4)
    },
    **{
        f"{e} el./module, EA {ea} N, adaptive": partial(prepare, e, float(ea), 20, 1e-4, True)
        for e, ea in ((1, "1e6"), (2, "1e6"), (1, "1e7"), (2, "1e7"), (4, "1e7"))
    },
}


def main() -> None:
    """Measure and report."""
    report(exudyn.__version__, measure(SETTINGS, repeat=False))


if __name__ == "__main__":
    main()
