"""Independent verification of a study: the same sweep by 3-D finite elements."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Final, Literal, cast

import numpy as np

from bowstring.aliases import Floats
from bowstring.fem.comparison import RodComparison, compare_with_rod
from bowstring.fem.run import BrickRun, Settings, sweep
from bowstring.formatting import in_mm, in_percent, listed
from bowstring.results import Key, Result
from bowstring.robot.model import Robot

if TYPE_CHECKING:
    from bowstring.fem.run import FeStatus
    from bowstring.study.data_validation import AgainstData

_SAME: Final = 1e-9  # relative difference of equal tensions
_HOLDS: Final = {
    "bonded": "to which it is bonded",
    "sliding": "in which it may widen and narrow",
}


@dataclass(frozen=True)
class FiniteElements(Result):
    """Sweep of one tendon by finite elements, at the n loads of statics."""

    run: BrickRun
    """The run of CalculiX."""
    comparison: RodComparison
    """Tips and stress of both, finite elements and rod."""
    tip_position: Annotated[Floats, Key("tip_position_mm")]
    """Tip (n, 3), m; NaN at loads that were not reached."""
    tendon_lengths: Annotated[Floats, Key("tendon_lengths_mm")]
    """Tendon lengths (n, T), m; NaN at loads that were not reached."""
    apart: Annotated[Floats, Key("from_statics_mm")]
    """Distance of the tip from that of statics (n,), m; NaN at loads that were not reached."""
    measured_point: Annotated[Floats | None, Key("measured_point_mm")] = None
    """With measurements: measured point by finite elements (K, 3), m, base frame, interpolated
    between loads; NaN in rows in which another tendon has tension too or the load is not in the
    sweep."""
    measured_source: str = ""
    """Source of the table: ``"measured"``, ``"synthetic"`` or ``"computed"``."""
    measured_errors: Annotated[dict[str, float], Key("mean_from_measurement_mm")] = field(
        default_factory=dict
    )
    """Mean distance from the measured point over these rows, m, by model; NaN without rows."""

    @property
    def status(self) -> Annotated[FeStatus, Key()]:
        """Status of the run, as in ``fe``."""
        return cast("FeStatus", self.run.status)

    @property
    def middle_stress_ratio(self) -> Annotated[Floats, Key()]:
        """Stress ratio (n,), ``stress_ratio`` of ``fe``; NaN where it has none."""
        return self.comparison.stress_ratio

    @property
    def concentration(self) -> Annotated[Floats, Key()]:
        """Stress concentration (n,), as in ``fe``; NaN where it has none."""
        return self.comparison.concentration

    @property
    def span_error(self) -> Annotated[float, Key()]:
        """Error of the spans, as in ``fe``; NaN without a load."""
        return self.run.span_error

    @property
    def mesh(self) -> Annotated[str, Key()]:
        """Bricks along a module, around and across."""
        return str(self.run.settings["mesh"])

    @property
    def stiffness(self) -> Annotated[float, Key()]:
        """Young's modulus of the disks over that of the backbone."""
        return float(self.run.settings["stiffness"])

    @property
    def grip(self) -> Annotated[Literal["bonded", "sliding"], Key()]:
        """How disks hold the backbone."""
        return cast('Literal["bonded", "sliding"]', self.run.settings["grip"])

    @property
    def calculix_version(self) -> Annotated[str, Key()]:
        """Version of CalculiX."""
        return str(self.run.settings["calculix_version"])

    @property
    def text(self) -> Annotated[tuple[str, ...], Key()]:
        """Settings and results of the finite elements in sentences."""
        run, comparison = self.run, self.comparison
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
        ratio = comparison.stress_ratio[np.isfinite(comparison.stress_ratio)]
        more = f"Span forces equal the tensions within {in_percent(run.span_error, 1)}."
        if ratio.size:
            more += (
                " In the middle of the modules the largest axial stress is "
                f"{ratio.min():.3f} to {ratio.max():.3f} times the rod's; at the disks' edges a "
                f"node has up to {np.nanmax(self.concentration):.2f} times that of the middle, "
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


def solve(
    robot: Robot,
    tensions: Floats,
    statics_tip: Floats,
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
    return FiniteElements(run, compare_with_rod(run), tip, lengths, apart)


def at_data(
    found: FiniteElements, tension: Floats, shares: Floats, data: AgainstData
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
    tendon = int(np.argmax(np.abs(shares)))
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
