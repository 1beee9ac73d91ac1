"""The third opinion of a study: the same sweep by 3-D finite elements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bowstring.bricks.comparison import BesideRod, beside_rod
from bowstring.bricks.run import BrickRun, check, sweep
from bowstring.robot import Robot
from bowstring.words import in_mm

__all__ = ["FiniteElements", "check", "solve"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FiniteElements:
    """A sweep of one tendon by finite elements, at the n loads of statics.

    Attributes
    ----------
    run : BrickRun
    beside : BesideRod
    tip_position : ndarray (n, 3)
        In m; NaN at loads that were not reached.
    tendon_lengths : ndarray (n, T)
        In m.
    apart : ndarray (n,)
        Distance of the tip from that of statics, in m.
    """

    run: BrickRun
    beside: BesideRod
    tip_position: Array
    tendon_lengths: Array
    apart: Array

    @property
    def text(self) -> tuple[str, ...]:
        """What finite elements did and found."""
        run, beside = self.run, self.beside
        asked = run.settings
        how = (
            f"The robot as a solid of {len(run.mesh.bricks)} bricks (mesh {asked['mesh']}, "
            f"CalculiX {asked['calculix_version']}), simulated, with disks "
            f"{asked['stiffness']:g} times as stiff as the backbone."
        )
        if not run.converged:
            how += f" It {run.message}."
        if not np.isfinite(self.apart).any():
            return (how,)
        apart = float(np.nanmax(self.apart))
        found = (
            f"Its tip is at most {in_mm(apart)} from that of statics "
            f"({100 * apart / run.robot.length:.2g} % of the length). The mesh has an error of its "
            "own, which bowstring fe --study tells; what a rigid disk holds across its clamp is no "
            "error and no rod has it."
        )
        ratio = beside.stress_ratio[np.isfinite(beside.stress_ratio)]
        more = f"Forces of the spans are the tensions to {100 * run.span_error:.1g} %."
        if ratio.size:
            more += (
                " In the middle of the modules the largest axial stress is "
                f"{ratio.min():.3f} to {ratio.max():.3f} times the rod's; at the disks' edges a "
                f"node has up to {np.nanmax(beside.concentration):.2f} times that of the middle, "
                "which grows with the fineness of the mesh."
            )
        return how, found, more

    def to_dict(self) -> dict[str, Any]:
        """In mm, for JSON."""
        run = self.run
        return {
            "status": run.status,
            "text": list(self.text),
            "tip_position_mm": (1e3 * self.tip_position).tolist(),
            "tendon_lengths_mm": (1e3 * self.tendon_lengths).tolist(),
            "from_statics_mm": (1e3 * self.apart).tolist(),
            "middle_stress_ratio": self.beside.stress_ratio.tolist(),
            "concentration": self.beside.concentration.tolist(),
            "span_error": run.span_error,
            "mesh": run.settings["mesh"],
            "stiffness": run.settings["stiffness"],
            "calculix_version": run.settings["calculix_version"],
        }


def solve(
    robot: Robot,
    tensions: Array,
    statics_tip: Array,
    progress: Callable[[float], None] | None = None,
) -> FiniteElements:
    """Solve the loads (n, T) of a study by finite elements.

    Parameters
    ----------
    robot : Robot
    tensions : ndarray (n, T)
        In N.
    statics_tip : ndarray (n, 3)
        Of the rod, in m.
    progress : callable, optional

    Returns
    -------
    FiniteElements
        With what was reached, where CalculiX stopped early.
    """
    tell = progress or (lambda share: None)
    run = sweep(robot, tensions, progress=lambda _, share: tell(share))
    tip = np.full((len(tensions), 3), math.nan)
    lengths = np.full(tensions.shape, math.nan)
    if run.states:
        tip[: len(run.states)] = run.tip_position
        lengths[: len(run.states)] = run.frames.tendon_length
    apart = np.linalg.norm(tip - statics_tip, axis=1)
    return FiniteElements(run, beside_rod(run), tip, lengths, apart)
