"""VTK series of finite elements: bricks with displacement, stress and strain, and tendons.

The series has the form of `bowstring.viz.vtk`, with the same names and units of data.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from bowstring.aliases import Bools, Floats, Progress
from bowstring.errors import InputError
from bowstring.fem.run import BrickRun
from bowstring.viz.vtk import Part, Tendons, check_folder, write_series

_BRICK: Final = 25  # quadratic, 20 nodes
_ORDER: Final = (0, 1, 2, 3, 5, 4)  # symmetric tensor in VTK: xx, yy, zz, xy, yz, xz


def write_vtk(run: BrickRun, out: str | Path, *, progress: Progress | None = None) -> Path:
    """Write all steps of a run, whole or not at all.

    Parameters
    ----------
    run : BrickRun
    out : str or Path
        Folder; a former series in it is replaced after success.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Path of the .pvd file. Backbone: ``displacement_m``, ``von_mises_Pa``, ``stress_Pa`` and
        ``strain`` in base axes (xx, yy, zz, xy, yz, xz, as in ParaView), NaN where clamped. Disks,
        the stiff bricks: ``displacement_m``. Tendons: ``tension_N``.

    Raises
    ------
    InputError
        If the folder cannot be written, the drive is full, or no step was finished.
    """
    if not run.states:
        raise InputError("the run holds no step; there is nothing to show")
    folder = check_folder(out)
    arm, data = run.mesh.arm, run.to_dataset()
    parts = [_Backbone(run, ~arm), _Bricks(run, arm), Tendons(run.robot, data)]
    return write_series(folder, parts, data, progress or (lambda what, share: None))


class _Bricks(Part):
    name = "disks"

    def __init__(self, run: BrickRun, which: Bools) -> None:
        self._run = run
        bricks = run.mesh.bricks[which]
        self._nodes, cells = np.unique(bricks, return_inverse=True)
        rows = [[int(v) for v in row] for row in cells.reshape(bricks.shape)]
        super().__init__(rows, [_BRICK] * len(rows), run.mesh.nodes[self._nodes])

    def at(self, i: int) -> tuple[Floats, Mapping[str, Floats]]:
        displacement = self._run.states[i].displacement[self._nodes]
        return self.straight + displacement, {"displacement_m": displacement}


class _Backbone(_Bricks):
    name = "backbone"

    def at(self, i: int) -> tuple[Floats, Mapping[str, Floats]]:
        points, moved = super().at(i)
        _, stress, strain = self._run.nodal(i)
        return points, {
            **moved,
            "von_mises_Pa": von_mises(stress[self._nodes]),
            "stress_Pa": stress[self._nodes][:, _ORDER],
            "strain": strain[self._nodes][:, _ORDER],
        }


def von_mises(stress: Floats) -> Floats:
    """Von Mises stress (...,) of stresses (..., 6) in the order xx, yy, zz, xy, xz, yz."""
    x, y, z, xy, xz, yz = np.moveaxis(stress, -1, 0)
    found: Floats = np.sqrt(
        0.5 * ((x - y) ** 2 + (y - z) ** 2 + (z - x) ** 2) + 3.0 * (xy**2 + xz**2 + yz**2)
    )
    return found
