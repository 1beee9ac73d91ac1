"""Independent verification of a study: the same sweep by 3-D finite elements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final, cast

import numpy as np
from numpy.typing import NDArray

from bowstring.fem.comparison import BesideRod, beside_rod
from bowstring.fem.run import BrickRun, Settings, sweep
from bowstring.formatting import in_mm, in_percent, listed
from bowstring.robot.model import Robot

if TYPE_CHECKING:
    from bowstring.fem.run import FeStatus
    from bowstring.schemas import study as schema
    from bowstring.study.data_validation import AgainstData

__all__ = ["FiniteElements", "at_data", "solve"]

Array = NDArray[np.float64]

_SAME: Final = 1e-9  # relative difference of equal tensions
_HOLDS: Final = {
    "bonded": "to which it is bonded",
    "sliding": "in which it may widen and narrow",
}


@dataclass(frozen=True)
class FiniteElements:
    """Sweep of one tendon by finite elements, at the n loads of statics.

    Attributes
    ----------
    run : BrickRun
    beside : BesideRod
    tip_position : ndarray (n, 3)
        Position of the tip in m; NaN at loads that were not reached.
    tendon_lengths : ndarray (n, T)
        Tendon lengths in m.
    apart : ndarray (n,)
        Distance of the tip from that of statics, in m.
    measured_point : ndarray (K, 3), optional
        Measured point at the rows of a table by finite elements, in m, base frame; NaN at rows
        with other actuated tendons or beyond the loads that were reached.
    measured_source : str
        Source of the table: ``"measured"``, ``"synthetic"`` or ``"computed"``.
    measured_errors : dict
        Mean distance from the measured point over these rows by model, in m.
    """

    run: BrickRun
    beside: BesideRod
    tip_position: Array
    tendon_lengths: Array
    apart: Array
    measured_point: Array | None = None
    measured_source: str = ""
    measured_errors: dict[str, float] = field(default_factory=dict)

    @property
    def text(self) -> tuple[str, ...]:
        """Settings and results of the finite elements in sentences."""
        run, beside = self.run, self.beside
        asked = run.settings
        how = (
            f"The robot as a solid of {len(run.mesh.bricks)} bricks (mesh {asked['mesh']}, "
            f"CalculiX {asked['calculix_version']}), simulated, with disks "
            f"{asked['stiffness']:g} times as stiff as the backbone, {_HOLDS[asked['grip']]}."
        )
        if not run.converged:
            how += f" It {run.message}."
        if not np.isfinite(self.apart).any():
            return (how,)
        apart = float(np.nanmax(self.apart))
        found = (
            f"Its tip is at most {in_mm(apart)} from that of statics "
            f"({in_percent(apart / run.robot.length)} of the length). The mesh has an error of its "
            "own, which bowstring fe --study estimates"
        )
        if asked["grip"] == "bonded":
            found += (
                "; the lateral constraint by a rigid disk is not in the rod model, and --grip "
                "sliding removes it"
            )
        found += "."
        ratio = beside.stress_ratio[np.isfinite(beside.stress_ratio)]
        more = f"Span forces equal the tensions within {in_percent(run.span_error, 1)}."
        if ratio.size:
            more += (
                " In the middle of the modules the largest axial stress is "
                f"{ratio.min():.3f} to {ratio.max():.3f} times the rod's; at the disks' edges a "
                f"node has up to {np.nanmax(beside.concentration):.2f} times that of the middle, "
                "which grows with the fineness of the mesh."
            )
        return (how, found, more, *self._text_of_data())

    def _text_of_data(self) -> tuple[str, ...]:
        if self.measured_point is None:
            return ()
        rows = int(np.isfinite(self.measured_point).all(axis=1).sum())
        if rows == 0:
            return (
                f"No row of the {self.measured_source} table actuates this tendon alone within "
                "these loads: there is nothing to compare.",
            )
        means = [f"{name} {in_mm(size)}" for name, size in self.measured_errors.items()]
        return (
            f"At the {rows} rows of the {self.measured_source} table that actuate this tendon "
            "alone within these loads the mean distance from the table's point, in the one base "
            f"frame for all, is: {listed(means)}; finite elements are interpolated between loads.",
        )

    def to_dict(self) -> schema.StudyFiniteElements:
        """Return plain values in mm for JSON."""
        run, point = self.run, self.measured_point
        return {
            "status": cast("FeStatus", run.status),
            "text": list(self.text),
            "tip_position_mm": (1e3 * self.tip_position).tolist(),
            "tendon_lengths_mm": (1e3 * self.tendon_lengths).tolist(),
            "from_statics_mm": (1e3 * self.apart).tolist(),
            "measured_point_mm": None if point is None else (1e3 * point).tolist(),
            "mean_from_measurement_mm": {k: 1e3 * e for k, e in self.measured_errors.items()},
            "middle_stress_ratio": self.beside.stress_ratio.tolist(),
            "concentration": self.beside.concentration.tolist(),
            "span_error": run.span_error,
            "mesh": run.settings["mesh"],
            "stiffness": run.settings["stiffness"],
            "grip": run.settings["grip"],
            "calculix_version": run.settings["calculix_version"],
        }


def solve(
    robot: Robot,
    tensions: Array,
    statics_tip: Array,
    settings: Settings,
    progress: Callable[[float], None] | None = None,
) -> FiniteElements:
    """Solve the loads (n, T) of a study by finite elements.

    Parameters
    ----------
    robot : Robot
    tensions : ndarray (n, T)
        Tensions in N.
    statics_tip : ndarray (n, 3)
        Tip of the rod in m.
    settings : Settings
    progress : callable, optional

    Returns
    -------
    FiniteElements
        Result, also if CalculiX stopped early.
    """
    notify = progress or (lambda share: None)
    run = sweep(robot, tensions, settings=settings, progress=lambda _, share: notify(share))
    tip = np.full((len(tensions), 3), math.nan)
    lengths = np.full(tensions.shape, math.nan)
    if run.states:
        tip[: len(run.states)] = run.tip_position
        lengths[: len(run.states)] = run.frames.tendon_length
    apart = np.linalg.norm(tip - statics_tip, axis=1)
    return FiniteElements(run, beside_rod(run), tip, lengths, apart)


def at_data(
    found: FiniteElements, tension: Array, shares: Array, data: AgainstData
) -> FiniteElements:
    """Compare a sweep with measurements, at rows with only its tendons actuated in its shares.

    Parameters
    ----------
    found : FiniteElements
    tension : ndarray (n,)
        Tensions of the sweep, increasing, in N.
    shares : ndarray (T,)
        Share of that tension in each tendon; the largest is 1.
    data : AgainstData

    Returns
    -------
    FiniteElements
        Result with the measured point, interpolated between loads by cubic splines.
    """
    from scipy.interpolate import make_interp_spline

    table = data.data.tensions
    point = np.full((len(table), 3), math.nan)
    reached = len(found.run.states)
    tendon = int(np.argmax(shares))
    rest = np.abs(table - np.outer(table[:, tendon], shares))
    alone = (rest <= _SAME * np.abs(table[:, [tendon]])).all(axis=1)
    if reached > 1:
        frames = found.run.frames
        by_load = frames.disk_position[:, -1] + frames.disk_rotation[:, -1] @ data.data.tool
        within = (table[:, tendon] >= tension[0]) & (table[:, tendon] <= tension[reached - 1])
        rows = alone & within & np.isfinite(data.point).all(axis=1)
        course = make_interp_spline(tension[:reached], by_load, k=min(3, reached - 1))
        point[rows] = course(table[rows, tendon])
    models = {"finite elements": point}
    for name, called in (
        ("rod", "the rod as in the file"),
        ("cc_from_force", "constant curvature from force"),
        ("cc_from_lengths", "constant curvature from lengths"),
    ):
        if name in data.models:
            models[called] = data.comparison(name).tip_position
    off = {name: np.linalg.norm(tip - data.point, axis=1) for name, tip in models.items()}
    here = np.all([np.isfinite(size) for size in off.values()], axis=0)
    return replace(
        found,
        measured_point=point,
        measured_source=data.data.source,
        measured_errors={name: float(size[here].mean()) for name, size in off.items()}
        if here.any()
        else {},
    )
