"""Comparison of finite elements with the rod: tips, and stress in modules and at disk edges."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.aliases import Floats, Ints
from bowstring.dynamics import simulation
from bowstring.dynamics.integrator import Integrator
from bowstring.dynamics.load_history import ramp
from bowstring.fem.fields import SectionStress
from bowstring.fem.run import BrickRun
from bowstring.statics import rod
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel

_NOTHING: Final = 1e-4  # stress over the largest of a run that counts as zero


@dataclass(frozen=True)
class RodComparison:
    """Results of finite elements and rod at K loads or times in M modules, SI.

    Attributes
    ----------
    tip : ndarray (K, 3)
        Tip of the rod, m; NaN where it has no equilibrium.
    difference : ndarray (K,)
        Distance of the two tips, m.
    middle, rod_middle : ndarray (K, M)
        Largest axial stress at the surface in the middle of each module's free backbone, Pa. That
        of the rod is NaN in motion, where stress is not compared.
    edge : ndarray (K, M)
        Largest axial stress at a node of a module, Pa, usually at the edge of a disk. The stress at
        a rigid clamp is singular: it grows with refinement and indicates a stress concentration.
    """

    tip: Floats
    difference: Floats
    middle: Floats
    rod_middle: Floats
    edge: Floats

    @property
    def stress_ratio(self) -> Floats:
        """Ratio (K,) of the largest stress in the middle of a module to that of the rod.

        NaN without load, and where the rod has no stress.
        """
        k, at = self._most_stressed()
        return self._ratio(self.middle[k, at], self.rod_middle[k, at])

    @property
    def concentration(self) -> Floats:
        """Ratio (K,) of largest nodal stress to that in the middle, in the most stressed module.

        NaN without load. In other modules the moment may vanish in the middle.
        """
        k, at = self._most_stressed()
        return self._ratio(self.edge[k, at], self.middle[k, at])

    def _most_stressed(self) -> tuple[Ints, Ints]:
        at = self.middle.argmax(axis=1) if self.middle.size else np.zeros(0, dtype=int)
        return np.arange(len(self.middle)), at

    def _ratio(self, stress: Floats, by: Floats) -> Floats:
        """Ratio of stresses; NaN where they are within the tolerance of the Newton iteration."""
        least = _NOTHING * self.middle.max(initial=0.0)
        found: Floats = np.divide(
            stress, by, out=np.full(len(stress), np.nan), where=np.isfinite(by) & (by > least)
        )
        return found


def compare_with_rod(run: BrickRun) -> RodComparison:
    """Solve the rod for the loads or times of a run by finite elements.

    Parameters
    ----------
    run : BrickRun
        Run of `sweep` or `ramp`.

    Returns
    -------
    RodComparison
        Tips and stresses of both at each output.
    """
    stress = [run.section_stress(i) for i in range(len(run.states))]
    modules = len(run.robot.disks.station_m)
    middle = np.array([_middle(s, modules) for s in stress]).reshape(-1, modules)
    edge = np.array([[s.peak[s.module == m].max() for m in range(modules)] for s in stress])
    if run.is_motion:
        tip, rod_middle = _in_motion(run), np.full_like(middle, np.nan)
    else:
        tip, rod_middle = _at_rest(run, modules)
    difference = np.linalg.norm(run.tip_position - tip, axis=1) if run.states else np.zeros(0)
    return RodComparison(tip, difference, middle, rod_middle, edge.reshape(-1, modules))


def _middle(stress: SectionStress, modules: int) -> Floats:
    found = np.zeros(modules)
    for m in range(modules):
        here = np.flatnonzero(stress.module == m)
        found[m] = stress.largest[here[len(here) // 2]]
    return found


def _at_rest(run: BrickRun, modules: int) -> tuple[Floats, Floats]:
    tip = np.full((len(run.states), 3), np.nan)
    stress = np.full((len(run.states), modules), np.nan)
    for i, row in enumerate(run.tensions):
        solution = rod.solve(run.robot, row, load=run.load, model=RodModel(elements=4))
        if solution.tip is None:
            continue
        tip[i] = solution.tip.position
        normal = solution.to_dataset(3).normal_stress.to_numpy()[0]
        stress[i] = normal.reshape(modules, 3)[:, 1]
    return tip, stress


def _in_motion(run: BrickRun) -> Floats:
    asked = run.settings
    found = simulation.simulate(
        run.robot,
        ramp(run.wanted_tensions[-1], asked["rise_s"]),
        float(run.wanted_time[-1]),
        load=Load(gravity=asked["gravity"]),
        integrator=Integrator(mass_damping=asked["mass_damping_per_s"]),
        output=simulation.Output(points=0),
    )
    reached = run.time <= found.end * (1 + 1e-9)
    tip = np.full((len(run.time), 3), np.nan)
    tip[reached] = found.tip_at(run.time[reached])
    return tip
