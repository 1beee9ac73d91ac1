"""Exudyn on the ramp: the model of exudyn_rod.py with its inertia, generalised-alpha in time.

Discretisation: equal elements per module; fixed steps, modified Newton, spectral radius 0.8. Nodes
are angles (Rxyz): the rotation vectors of the static model fail in the first step, and Euler
parameters take longer. Damping: viscous forces on the nodes, by half of each neighbouring element's
mass and the disk's.
Limits: rotation of disks and backbone is not damped, which moves the tip by less than 0.05 mm. The
tension is set in a Python call before each step; only the spans of tendon 1 are modelled.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.cases import AREA, DENSITY, DISKS, LENGTH, report
from benchmarks.peers.exudyn_rod import exudyn, item, rod
from benchmarks.ramp import (
    DISK_ACROSS,
    DISK_ALONG,
    DISK_MASS,
    DURATION_S,
    MASS_DAMPING,
    OUTPUT_S,
    OUTPUTS,
    ROTARY_INERTIA,
    Tips,
    measure,
    tension,
)


def prepare(elements: int, steps: int, tolerance: float):
    """Prepare a run with `steps` steps between two outputs."""
    system, nodes, _, _, spans = rod(
        elements,
        DISK_MASS,
        (DISK_ALONG, DISK_ACROSS, DISK_ACROSS),
        (2 * ROTARY_INERTIA, ROTARY_INERTIA, ROTARY_INERTIA),
        item.NodeRigidBodyRxyz,
        tendons=1,
    )
    masses = np.full(len(nodes), DENSITY * AREA * LENGTH / DISKS / elements)
    masses[-1] /= 2
    masses[elements::elements] += DISK_MASS
    base = system.AddMarker(item.MarkerNodePosition(nodeNumber=nodes[0]))
    for node, mass in zip(nodes[1:], masses[1:], strict=True):
        marker = system.AddMarker(item.MarkerNodePosition(nodeNumber=node))
        system.AddObject(
            item.CartesianSpringDamper(
                markerNumbers=[base, marker], damping=3 * [MASS_DAMPING * mass]
            )
        )

    def tension_tendons(mbs, time: float) -> bool:  # the time at the end of the step
        for span in spans[0]:
            mbs.SetObjectParameter(span, "force", tension(time))
        return True

    system.SetPreStepUserFunction(tension_tendons)
    tip = system.AddSensor(
        item.SensorNode(
            nodeNumber=nodes[-1],
            outputVariableType=exudyn.OutputVariableType.Position,
            storeInternal=True,
            writeToFile=False,
        )
    )
    system.Assemble()

    settings = exudyn.SimulationSettings()
    settings.linearSolverType = exudyn.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = OUTPUT_S
    march = settings.timeIntegration
    march.verboseMode = 0
    march.endTime = DURATION_S
    march.numberOfSteps = steps * OUTPUTS
    march.adaptiveStep = False
    march.generalizedAlpha.spectralRadius = 0.8
    march.generalizedAlpha.computeInitialAccelerations = False  # at rest
    march.newton.useModifiedNewton = True
    march.newton.relativeTolerance = tolerance

    def run() -> Tips:
        if not system.SolveDynamic(settings, storeSolver=False, showCausingItems=False):
            raise RuntimeError("dynamic solver failed")
        return 1e3 * system.GetSensorStoredData(tip)[:, [2, 3, 1]]

    return run


SETTINGS = {
    f"{e} el./module, dt {1e3 * OUTPUT_S / n:.3g} ms, tol {t:g}": partial(prepare, e, n, t)
    for e in (1, 2, 4, 5)
    for n in (1, 2, 3, 5, 10)
    for t in (1e-3, 1e-6)
} | {
    f"8 el./module, dt {1e3 * OUTPUT_S / n:.3g} ms, tol 1e-06": partial(prepare, 8, n, 1e-6)
    for n in (10, 20)
}


def main() -> None:
    """Measure and report."""
    report(exudyn.__version__, measure(SETTINGS))


if __name__ == "__main__":
    main()
