"""Exudyn: geometrically exact beam elements and constant-tension springs.

Model: two-node shear-deformable beams interpolated on SE(3); a disk is a rigid body on the beam's
own node; a span is a SpringDamper without stiffness whose constant `force` is the tension, between
points of two neighbouring disks, so that spans are straight and frictionless as in the reference.
Nodes are rotation vectors (Lie group); with Euler parameters the static solver needs ten times the
load steps. Discretisation: equal elements per module, second order. Statics: full Newton in load
steps; a single step from straight does not converge at 80 N.
Limits: the static solver scales loads but no spring force, hence a Python call per load step.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

sys.exudynFast = True  # the build without range checks; read by exudyn at its first import

import exudyn  # noqa: E402
from exudyn import itemInterface as item  # noqa: E402

from benchmarks.cases import (  # noqa: E402
    AREA,
    DENSITY,
    DISKS,
    EA,
    EI,
    GA,
    GJ,
    LENGTH,
    TENDON_ANGLES,
    Case,
    Solve,
    holes,
    measure,
    report,
)

TINY = 1e-9  # rotary inertia: must be positive, plays no part in statics


def model_axes(vector: tuple[float, float, float]) -> list[float]:
    """Exudyn's beam runs along x: (x, y, z) of the robot are (y, z, x) of the model."""
    return [vector[2], vector[0], vector[1]]


class Rod(NamedTuple):
    """A model and the indices of its items, with the spans of each tendon from base to tip."""

    system: exudyn.MainSystem
    nodes: list
    beams: list
    disks: list
    spans: list[list]


def rod(
    elements: int,
    disk_mass: float,
    disk_inertia: tuple[float, float, float] = (TINY, TINY, TINY),
    rotary_inertia: tuple[float, float, float] = (TINY, TINY, TINY),
    node: Callable = item.NodeRigidBodyRotVecLG,
    tendons: int = len(TENDON_ANGLES),
) -> Rod:
    """Axial and transverse inertias, in kg m^2, and of the backbone per length, in kg m."""
    system = exudyn.SystemContainer().AddSystem()
    section = exudyn.BeamSection()
    section.stiffnessMatrix = np.diag([EA, GA, GA, GJ, EI, EI])
    section.massPerLength = DENSITY * AREA
    section.inertia = np.diag(rotary_inertia)

    h = LENGTH / DISKS / elements
    nodes = [
        system.AddNode(node(referenceCoordinates=[h * k, 0, 0, 0, 0, 0]))
        for k in range(DISKS * elements + 1)
    ]
    beams = [
        system.AddObject(
            item.ObjectBeamGeometricallyExact(nodeNumbers=list(pair), length=h, sectionData=section)
        )
        for pair in pairwise(nodes)
    ]
    ground = system.AddObject(item.ObjectGround())
    disks = [
        system.AddObject(
            item.ObjectRigidBody(mass=disk_mass, inertia=[*disk_inertia, 0, 0, 0], nodeNumber=node)
        )
        for node in nodes[elements::elements]
    ]
    clamp = [
        system.AddMarker(item.MarkerBodyRigid(bodyNumber=ground)),
        system.AddMarker(item.MarkerNodeRigid(nodeNumber=nodes[0])),
    ]
    system.AddObject(item.GenericJoint(markerNumbers=clamp))

    spans = []
    for x, y in holes()[:tendons]:
        points = [
            system.AddMarker(
                item.MarkerBodyPosition(bodyNumber=body, localPosition=model_axes((x, y, 0)))
            )
            for body in (ground, *disks)
        ]
        spans.append(
            [
                system.AddObject(item.SpringDamper(markerNumbers=list(ends)))
                for ends in pairwise(points)
            ]
        )
    return Rod(system, nodes, beams, disks, spans)


def static_settings(load_steps: int, tolerance: float, *, adaptive: bool = False):
    settings = exudyn.SimulationSettings()
    settings.linearSolverType = exudyn.LinearSolverType.EigenSparse
    settings.solution.file.write = False
    static = settings.staticSolver
    static.verboseMode = 0
    static.numberOfLoadSteps = load_steps
    static.adaptiveStep = adaptive
    static.computeLoadsJacobian = False  # dead loads: the iterations are the same without
    static.newton.relativeTolerance = tolerance
    return settings


def prepare(elements: int, load_steps: int, tolerance: float, case: Case) -> Solve:
    system, nodes, beams, disks, spans = rod(elements, case.disk_mass)
    tensioned = [
        (span, tension)
        for tendon, tension in zip(spans, case.tensions, strict=True)
        for span in tendon
    ]

    if any(case.gravity):
        for body in (*disks, *beams):
            marker = system.AddMarker(item.MarkerBodyMass(bodyNumber=body))
            load = item.LoadMassProportional(
                markerNumber=marker, loadVector=model_axes(case.gravity)
            )
            system.AddLoad(load)
    if any(case.tip_force):
        marker = system.AddMarker(item.MarkerNodePosition(nodeNumber=nodes[-1]))
        load = item.LoadForceVector(markerNumber=marker, loadVector=model_axes(case.tip_force))
        system.AddLoad(load)

    def tension_tendons(mbs, load_factor: float) -> bool:
        for span, tension in tensioned:
            mbs.SetObjectParameter(span, "force", tension * load_factor)
        return True

    system.SetPreStepUserFunction(tension_tendons)
    system.Assemble()

    settings = static_settings(load_steps, tolerance)

    def solve() -> list[float]:
        if not system.SolveStatic(settings, storeSolver=False, showCausingItems=False):
            raise RuntimeError("static solver failed")
        x, y, z = system.GetNodeOutput(nodes[-1], exudyn.OutputVariableType.Position)
        return [1e3 * y, 1e3 * z, 1e3 * x]

    return solve


SETTINGS = {
    f"{e} el./module, {s} load steps, tol {t:g}": partial(prepare, e, s, t)
    for e in (1, 2, 4, 8, 16)
    for s, t in ((2, 1e-6), (3, 1e-3), (4, 1e-3), (6, 1e-3), (8, 1e-5))
}


def main() -> None:
    """Measure and report."""
    report(exudyn.__version__, measure(SETTINGS))


if __name__ == "__main__":
    main()
