"""Shapes of the backbone at the largest load of a study, by the rod and by constant curvature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import BowstringError
from bowstring.statics import rod
from bowstring.statics.model import RodModel
from bowstring.study.comparison import FROM_FORCE, MEANINGS, arcs_of
from bowstring.study.study import Study


@dataclass(frozen=True)
class Shape:
    """Shape of one backbone in the base frame."""

    name: str
    """Name: ``"statics"``, or that of a comparison."""
    backbone: Floats
    """Points from base to tip (p, 3), m."""
    disks: Floats
    """Centres of the disks (N, 3), m."""
    from_statics: Floats
    """Distance of each disk from the same disk by statics (N,), m."""


def backbones(study: Study) -> tuple[float, list[Shape]]:
    """Compute the shapes of rod and constant curvature at the largest load of a study.

    Returns the tension of the actuated tendon, N, at the largest load of the sweep with an
    equilibrium; and the shapes, statics first, constant curvature where it has an arc.
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
        # a cold start may end on another branch than the sweep; compare with its disks
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
    return tension, shapes
