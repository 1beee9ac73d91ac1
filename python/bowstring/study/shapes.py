"""Shapes of the backbone at the largest load of a study: the rod beside constant curvature.

The study compares tips; here are the whole shapes, and how far they part from disk to disk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import BowstringError
from bowstring.statics import rod
from bowstring.statics.model import RodModel
from bowstring.study.comparison import FROM_FORCE, MEANINGS, arcs_of
from bowstring.study.study import Study

__all__ = ["Backbones", "Shape", "backbones"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Shape:
    """One backbone in the base frame."""

    name: str
    """``"statics"``, or the name of a comparison."""
    backbone: Array
    """(p, 3) points from base to tip, m."""
    disks: Array
    """(N, 3) centres of the disks, m."""
    from_statics: Array
    """(N,) distance of each disk from the same disk by statics, m."""


@dataclass(frozen=True)
class Backbones:
    """All backbones at one load."""

    tension: float
    """Of the actuated tendon, N: the largest load of the sweep that has an equilibrium."""
    shapes: tuple[Shape, ...]
    """Statics first; constant curvature where it has an arc."""


def backbones(study: Study) -> Backbones:
    """Find the shapes of rod and constant curvature at the largest load of a study.

    Parameters
    ----------
    study : Study

    Returns
    -------
    Backbones
    """
    statics = study.statics
    last = int(np.flatnonzero(statics.converged)[-1])
    tension = float(statics.tension[last])
    disks = statics.disk_positions[last]
    model = study.model
    tensions = model.tensions(np.array([tension]))[0]

    solution = rod.solve(model.robot, tensions, model=RodModel(study.settings.theory))
    curve = solution.centerline() if solution.converged else None
    if curve is None or np.linalg.norm(curve[-1] - disks[-1]) > 1e-4 * study.length:
        # a cold start may end on another branch than the sweep, whose disks are known
        curve = np.concatenate([np.zeros((1, 3)), disks])
    shapes = [Shape("statics", curve, disks, np.zeros(len(disks)))]

    for name in MEANINGS:
        try:
            fed = tensions if name in FROM_FORCE else statics.tendon_lengths[last]
            arcs = arcs_of(model.robot, name, fed)
        except BowstringError:  # no arc has these lengths
            continue
        away = np.linalg.norm(arcs.disk_positions - disks, axis=-1)
        shapes.append(Shape(name, arcs.centerline(), arcs.disk_positions, away))
    return Backbones(tension, tuple(shapes))
