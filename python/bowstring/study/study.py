"""Study of a robot: error and validity limit of constant curvature.

`run_study` repeats the study of Amouri 2019 for any robot and tendon, or several tendons:

1. its geometric sweep, constant curvature alone (Eq. 5, Fig. 6 and 7);
2. a sweep of the tension from zero, solved by straight-span statics;
3. the same tension over time, solved by dynamics, with stress and strain as in Fig. 5
   (`bowstring.study.ramp_response`);
4. constant curvature compared with both, from the tendon *lengths* of the rod (Eq. 2-5 of the
   study) and from the *force* by the linear law, each plain and corrected
   (`bowstring.study.comparison`), and curvature that varies along the robot
   (`bowstring.study.shape_models`);
5. an error budget: physical effects one at a time, in this sweep, added to a baseline and removed
   from a full model (`bowstring.study.error_budget`); friction, elastic tendons and displacement
   control along a path of loading and unloading (`bowstring.study.actuation_budget`);
6. a verdict at a stated tolerance (`bowstring.study.verdict`);
7. with measurements, all models against them, with and without registration, a decomposition of
   the error, and tests of the residuals (`bowstring.study.data_validation`).

Budget and verdict use statics, which needs no choice of rise time and damping. Friction at the
holes is in the actuation part of the budget only.

This module has numbers only: `bowstring.study.report` writes them, `bowstring.study.figures` draws
them. Values are in SI and radians; `Study.to_dict` converts them to mm, degrees and percent.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from numpy.typing import NDArray

import bowstring._core as _core
from bowstring.constant_curvature import RobotArcs
from bowstring.data.tip_errors import Comparison
from bowstring.display import html_table, short_repr
from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.formatting import in_mm, in_percent, listed, plain, significant
from bowstring.robot.model import Robot, check_disks, check_robot, without_memory
from bowstring.robot.reader import load_robot
from bowstring.statics import limits
from bowstring.statics.model import RodModel
from bowstring.study.comparison import (
    COMPARISONS,
    FROM_FORCE,
    MEANINGS,
    Model,
    Theory,
    points_by_arcs,
)
from bowstring.study.design_map import caption_of, design_map, without_map
from bowstring.study.error_budget import Budget, error_budget
from bowstring.study.load_map import caption_of_loads, check_load_axis, load_map, load_sentence
from bowstring.study.ramp_response import (
    Surface,
    Transient,
    check_rise,
    has_surface,
    slowest_frequency,
    surface_at_rest,
    transient,
    without_surface,
)
from bowstring.study.settings import Extras, Ramp, Settings
from bowstring.study.shape_models import ShapeModels, compare_shapes
from bowstring.study.verdict import Verdict, judge
from bowstring.validation import choice, instance, share_of_length, shown
from bowstring.validity.loading import FARTHEST, MAX_BEND, TRIED, Loading, largest_load, turned
from bowstring.validity.maps import ValidityMap
from bowstring.validity.spread import Spread, assumed_distributions, sampled

if TYPE_CHECKING:
    from bowstring.data.measurements import Measurements
    from bowstring.schemas import study as schema
    from bowstring.schemas.basic import StaticsStatus
    from bowstring.study.data_validation import AgainstData
    from bowstring.study.finite_elements import FiniteElements

__all__ = [
    "DATA_FIGURES",
    "FE_FIGURES",
    "FIGURES",
    "Figure",
    "GeometricSweep",
    "PublishedClaim",
    "Settings",
    "Statics",
    "Study",
    "run_study",
]

Array = NDArray[np.float64]
Progress = Callable[[str, float], None]

SCHEMA_VERSION: Final = 1
_ON_MATRIX: Final = (
    "The uncertain numbers leave out the stiffness matrix: its entries take no distributions.",
)
_ASSUMED_POINTS, _GIVEN_POINTS = 256, 1024  # base points of the samples
_BACKBONE_POINTS: Final = 25  # points per segment


@dataclass(frozen=True)
class Figure:
    """Figure of the report: file name without suffix, title, and caption."""

    stem: str
    """File name without suffix."""
    title: str
    """Title in the report."""
    caption: str
    """Caption in sentences."""


_ON_SURFACE: Final = "Stress and strain are the largest on the surface of the backbone."
_WITHOUT_SURFACE: Final = {"fig05_tip_against_force": "Tip and displacement against force"}

SOLID_FIGURES: Final = (
    Figure(
        "fig01_robot",
        "The robot as a solid",
        "As in Fig. 1 of the study: base, backbone, spacer disks and tendons, bent by the largest "
        "load of the sweep; simulated, statics.",
    ),
)
"""Further figure of a study with the solid, which needs the extra ``cad``."""

FIGURES: Final = (
    Figure(
        "fig02_disk",
        "Spacer disks",
        "As in Fig. 2 of the study, in mm. Sizes with a star are assumed.",
    ),
    Figure(
        "arc_symbols",
        "Arc of the segment at the base",
        "Symbols of constant curvature as in Eqs. 1 to 5 of the study, drawn to scale with the "
        "numbers of this robot at the largest load. Above, the arc in its bending plane. Below, "
        "the disk and its holes seen from the tip; numbers are tendons, red ones are actuated.",
    ),
    Figure(
        "fig04_module",
        "Geometry of one module",
        "As Fig. 4 of the study: two disks, the backbone and the straight spans of the tendons in "
        "the bending plane, drawn to scale with the numbers of this robot at the largest load.",
    ),
    Figure(
        "fig05_tip_against_force",
        "Tip, displacement, stress and strain against force",
        "One tendon is actuated, as in Fig. 5 of the study; simulated. Lines: dynamics, while the "
        "tension rises. Markers: statics at the same tension. Crosses: constant curvature from "
        f"force. {_ON_SURFACE}",
    ),
    Figure(
        "fig05_over_time",
        "Tension and tip over time",
        "The same simulated motion over time: the tension rises and is held. Solid: dynamics. "
        "Dashed: statics at the same tension. Below, the distance of the tip between the two.",
    ),
    Figure(
        "displacement_against_force",
        "Tendon displacement against force",
        "Displacement of the actuated tendon by statics and by the linear law that the study "
        "assumes, and the difference of the two.",
    ),
    Figure(
        "fig06_tip_against_displacement",
        "Tip against tendon displacement",
        "The study's geometric sweep, as its Fig. 6b: tip coordinates by constant curvature alone "
        "while one tendon is shortened and the others follow.",
    ),
    Figure(
        "fig06_tendon_lengths",
        "Tendon lengths against tendon displacement",
        "The study's geometric sweep, as its Fig. 6a: lengths of all tendons by constant curvature "
        "alone. Lines of tendons with equal lengths coincide.",
    ),
    Figure(
        "fig07_configurations",
        "Configurations",
        "Configurations of the geometric sweep with disks and tendons, as Fig. 7 of the study.",
    ),
    Figure(
        "fig10_overlay",
        "Constant curvature over statics",
        "Path of the tip in the bending plane, as Fig. 10 of the study: statics, and constant "
        "curvature from lengths and from force at the same loads.",
    ),
    Figure(
        "backbones",
        "Shapes at the largest load",
        "The backbone in the bending plane at the largest load: the rod by statics, and constant "
        "curvature from lengths and from force, markers at the disks. Below, how far each disk by "
        "constant curvature is from the same disk by statics.",
    ),
    Figure(
        "variable_curvature",
        "Constant and variable curvature",
        "Errors of constant curvature (CC), and of curvature that is a polynomial of arc length in "
        "each segment, against statics: at the tip, and the RMS over the disks. Solid: fitted to "
        "the shape by statics, the best that such a model can do. Dotted, where they differ from "
        "the linear law: predicted from tensions, routing and weight. Below, the curvature in the "
        "bending direction at the largest load, with that of the rod between its disks.",
    ),
    Figure(
        "fig11_errors",
        "Errors by axis",
        "Difference of the tip by constant curvature from statics along each axis, as Fig. 11 of "
        "the study, with the Euclidean error and the tolerance.",
    ),
    Figure(
        "validity_map",
        "Map of validity",
        "Tip error of constant curvature by a number of the design and the tension.",
    ),
    Figure(
        "load_map",
        "Map of validity under load",
        "Tip error of constant curvature by a load and the tension.",
    ),
    Figure(
        "validity_spread",
        "Validity limit with uncertain numbers",
        "Constant curvature has the numbers of the robot file, the simulated robot those of each "
        "sample. Above: the limits, or the errors at the largest load where most samples hold to "
        "the end of the sweep. Below: how much of their variance each number explains.",
    ),
    Figure(
        "error_budget",
        "Error budget",
        "Mean error of constant curvature with each effect (filled) and without it (hollow), all "
        "else the same: in this sweep, and in the full model. The line between them is the "
        "contribution of the effect; it points to the left where the effect makes the error "
        "smaller. A count at the right, such as 11 of 17, marks means over so many loads only. "
        "Below, actuation: friction and elasticity of the tendons, loading and unloading.",
    ),
    Figure(
        "hysteresis",
        "Loading and unloading",
        "Distance by which the robot's tip is ahead of the tip by constant curvature at the same "
        "command, along the path of the latter; negative: the robot is bent less. Above, tension "
        "control with friction at the holes; below, displacement control with elastic tendons and "
        "friction. Dotted: without friction and elasticity.",
    ),
)

FE_FIGURES: Final = (
    Figure(
        "fe_stress",
        "Stress along the backbone by finite elements",
        "Largest axial stress at the surface at the last load, by 3-D finite elements and by the "
        "rod. What stands out at the disks' edges is their clamps': a rod has no such thing.",
    ),
    Figure(
        "fe_field",
        "Stress on the backbone by finite elements",
        "Axial stress on the surface of the backbone at the last load, by 3-D finite elements; "
        "what the disks clamp is left out.",
    ),
)
"""Further figures of a study with finite elements."""

_BRICKS_IN: Final = {
    "fig05_tip_against_force": " Plus signs: 3-D finite elements, at rest; their stress is the "
    "largest along the backbone in the middle of a module.",
    "fig10_overlay": " Plus signs: 3-D finite elements at the same loads.",
    "fig11_errors": " Plus signs: its Euclidean difference from 3-D finite elements.",
}

DATA_FIGURES: Final = (
    Figure(
        "fig09_measured_tip",
        "Measured tip against load",
        "The tip in the base frame against the load, as Fig. 9 of the study, and what the models "
        "say. Full markers and solid lines: loading. Hollow markers and dotted lines: unloading. "
        "All repeats are drawn.",
    ),
    Figure(
        "fig12_measured_errors",
        "Tip error by axis against load",
        "Model minus measurement along each axis, as Fig. 12 of the study has it for constant "
        "curvature, all in the one base frame for all models; repeats averaged. Solid: loading. "
        "Dotted: unloading.",
    ),
    Figure(
        "measured_comparison",
        "Comparison of errors by model",
        "Mean tip error of each model with its bootstrap interval at 95 %; the study has no such "
        "figure. The thin mark is the largest error. Not registered, in the one base frame for "
        "all, and registered to each model alone.",
    ),
    Figure(
        "measured_parts",
        "Parts of the error of constant curvature",
        "Mean tip error of constant curvature as the robot file has it, on rows that were left out "
        "of the fits: what calibration removes, what the physics of the rod removes then, and a "
        "memory; noise, and what no model explains. The parts add up to the dotted line.",
    ),
    Figure(
        "measured_residuals",
        "What the calibrated rod leaves",
        "Calibrated rod minus measurement along each axis, row by row in the order of the table. "
        "Band: two standard deviations of a coordinate, as stated or as the repeats scatter. "
        "Residuals that are noise show no course.",
    ),
)
"""Further figures of a study with measurements."""


# -- what is computed --------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True)
class GeometricSweep:
    """Geometric sweep of the source study: constant curvature without mechanics."""

    displacement: Array
    """Displacement of the actuated tendon (n,), m."""
    tendon_lengths: Array
    """(n, T), m."""
    theta: Array
    """Bend angles (n, S), rad."""
    tip_position: Array
    """(n, 3), m."""
    disk_positions: Array
    """(n, N, 3), m."""
    disk_rotations: Array
    """Rotations of the disks (n, N, 3, 3)."""
    backbone: Array
    """Points along the backbone from the base (n, P, 3), m."""
    scale: float = 1.0
    """Share of the sweep's tensions from which the linear law gives these arcs; 1 without
    gravity."""


@short_repr
@dataclass(frozen=True)
class Statics:
    """Sweep by straight-span statics."""

    tension: Array
    """Tension of the actuated tendon (n,), N; the others have their shares of it."""
    status: tuple[StaticsStatus, ...]
    """Status at each load (n,): ``"converged"``, or the reason of failure."""
    converged: NDArray[np.bool_]
    """Whether each load converged (n,)."""
    tip_position: Array
    """Tip (n, 3), m; NaN where not converged."""
    disk_positions: Array
    """(n, N, 3), m."""
    disk_rotations: Array
    """(n, N, 3, 3), disk frame to base frame."""
    tendon_lengths: Array
    """(n, T), m."""
    displacement: Array
    """Displacement l0 - l of the actuated tendon (n,), l0 with the straight backbone, m."""
    linear_displacement: Array
    """Displacement by the linear law (n,), m."""
    surface: Surface
    """Largest stress and strain (n,)."""


@dataclass(frozen=True)
class PublishedClaim:
    """Published result of the source study beside ours; none of its measurements is available."""

    mean_mm: float
    """Published upper bound of the mean error, mm."""
    mean_percent: float
    """The same bound in percent of the length."""
    ours: str
    """Name of the corresponding comparison."""
    text: str
    """Comparison with ours in sentences."""


@dataclass(frozen=True)
class Study:
    """Results of a study."""

    robot: Robot
    """Nominal robot, before any calibration."""
    settings: Settings
    """Resolved settings."""
    geometry: GeometricSweep
    """Geometric sweep by constant curvature."""
    statics: Statics
    """Main sweep by statics."""
    dynamics: Transient | None
    """Response to the ramp of tension; None if left out."""
    without_dynamics: str
    """Reason if dynamics is left out."""
    comparisons: tuple[Comparison, ...]
    """Comparisons with statics, dynamics, finite elements, and the measurement."""
    budget: Budget
    """Error budget of constant curvature."""
    verdict: Verdict
    """Validity limits of constant curvature and their causes."""
    shapes: ShapeModels
    """Constant and variable curvature over the whole backbone."""
    claim: PublishedClaim | None
    """Published result; None for another robot, load range or actuation than the source study's."""
    notes: tuple[str, ...] = field(default=())
    """Assumptions and limits of the results in sentences."""
    data: AgainstData | None = None
    """All models against measurements, if there are any."""
    solid: bool = False
    """Whether the report shows the robot as a solid."""
    bricks: FiniteElements | None = None
    """Sweep by finite elements, if requested."""
    map: ValidityMap | None = None
    """Validity over the tension and a number of the design; None where `notes` say why."""
    load_map: ValidityMap | None = None
    """Validity over the tension and a load; None where `notes` say why."""
    spreads: tuple[Spread, ...] = ()
    """Validity limits with uncertain numbers, from lengths and from force."""
    uncertainty_assumed: bool = True
    """Whether the program assumed the uncertainty."""

    def __repr__(self) -> str:
        force, count = f"{self.settings.max_tension:.6g} N", len(self.comparisons)
        return f"<Study of {self.robot.name} to {force}: {count} comparisons>"

    def _repr_html_(self) -> str:
        rows = [
            (c.name, c.against, f"{1e3 * c.mean:.3f}", f"{1e3 * c.maximum:.3f}")
            for c in self.comparisons
        ]
        title = repr(self).strip("<>")
        return html_table(title, rows, ("comparison", "against", "mean, mm", "max, mm"))

    @property
    def length(self) -> float:
        """Length of the robot, m."""
        return self.robot.length

    @cached_property
    def model(self) -> Model:
        """Model of robot and actuated tendons."""
        chosen = self.settings
        return Model(self.robot, chosen.tendon, chosen.theory, chosen.shares)

    @property
    def towards(self) -> tuple[float, float, float]:
        """Direction in which the actuated tendons bend the robot, a unit vector."""
        return self.model.towards

    def comparison(self, name: str, against: str = "statics") -> Comparison:
        """Return a comparison by name and reference; with a measurement the registered one."""
        return next(c for c in self.comparisons if (c.name, c.against) == (name, against))

    def against(self, physics: str) -> tuple[Comparison, ...]:
        """Return comparisons with ``"statics"``, ``"dynamics"``, ``"fe"`` or ``"measurement"``."""
        return tuple(c for c in self.comparisons if c.against == physics)

    @property
    def figures(self) -> tuple[Figure, ...]:
        """Figures of the study: `SOLID_FIGURES`, `FIGURES`, `FE_FIGURES`, `DATA_FIGURES`."""
        missing = ["fig05_over_time"] * (self.dynamics is None)
        missing += ["fig02_disk"] * bool(self.without_disks)
        missing += ["variable_curvature"] * (not self.shapes.curves)
        missing += ["validity_map"] * (self.map is None)
        missing += ["load_map"] * (self.load_map is None)
        missing += ["validity_spread"] * (not self.spreads)
        found = [f for f in FIGURES if f.stem not in missing]
        captions = {
            **self._without_surface_captions,
            **({} if self.map is None else {"validity_map": caption_of(self.map)}),
            **({} if self.load_map is None else {"load_map": caption_of_loads(self.load_map)}),
        }
        found = [replace(f, caption=captions.get(f.stem, f.caption)) for f in found]
        if not has_surface(self.robot):
            found = [replace(f, title=_WITHOUT_SURFACE.get(f.stem, f.title)) for f in found]
        if self.bricks is not None:
            found = [replace(f, caption=f.caption + _BRICKS_IN.get(f.stem, "")) for f in found]
        found = [*(SOLID_FIGURES if self.solid else ()), *found]
        if self.bricks is not None and len(self.bricks.run.states) > 1:
            found += FE_FIGURES
        if self.data is None:
            return tuple(found)
        absent = {"measured_residuals"} if self.data.calibration is None else set()
        absent |= {"measured_parts"} if self.data.models_compared is None else set()
        of_data = [
            replace(f, caption=f"{self.data.title}. {f.caption}")
            for f in DATA_FIGURES
            if f.stem not in absent
        ]
        return (*of_data, *found)

    @property
    def uncertain_numbers(self) -> str:
        """The uncertain numbers and their standard deviations in words; empty without any."""
        if not self.spreads:
            return ""
        joint = self.spreads[0].distributions
        sizes = zip(joint.paths, joint.mean.tolist(), joint.sd.tolist(), strict=True)
        words = (
            f"{path.rpartition('.')[2].replace('_', ' ')}"
            + (f" {in_percent(sd / abs(mean))}" if mean else "")
            for path, mean, sd in sizes
        )
        return listed(list(dict.fromkeys(words)))

    @cached_property
    def without_disks(self) -> str:
        """Why there is no drawing of the disks, where there is none."""
        from bowstring.cad.drawing import check_drawing

        try:
            check_drawing(self.robot)
        except InputError as error:
            return str(error)
        return ""

    @property
    def without_surface(self) -> str:
        """Why stress and strain are not computed, in a sentence; empty where they are."""
        return without_surface(self.robot)

    @property
    def _without_surface_captions(self) -> dict[str, str]:
        """Captions of figures that lack stress and strain, in part or whole."""
        if not self.without_surface:
            return {}
        stem = "fig05_tip_against_force"
        whole = next(f.caption for f in FIGURES if f.stem == stem)
        if not has_surface(self.robot):
            whole = whole.replace(_ON_SURFACE, "")
        return {stem: f"{whole.rstrip()} {self.without_surface}"}

    @cached_property
    def _limits(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        s = self.statics
        return limits.of_sweep(self.robot, s.tension, s.disk_positions, s.surface.by_segment)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of robot, data and sweep: missing equilibria, disks below the base, limits."""
        missing = self.without_equilibrium
        of_data = self.data.doubts if self.data is not None else ()
        return (*self.robot.warnings, *of_data, *([missing] if missing else []), *self._limits[0])

    @property
    def without_equilibrium(self) -> str:
        """Message on loads without an equilibrium, with advice; empty if there are none."""
        failed = np.flatnonzero(~self.statics.converged)
        if not failed.size:
            return ""
        loads = self.statics.tension
        advice = (
            "Give a smaller largest tension (--max-tension)"
            if failed[0] > 0
            else "Check stiffness and gravity"
        )
        return (
            f"{failed.size} of {len(loads)} loads have no stable equilibrium that the solver found "
            f"(first at {loads[failed[0]]:.4g} N: {self.statics.status[failed[0]]}); they count in "
            f"no mean. {advice}."
        )

    @property
    def limits_text(self) -> tuple[str, ...]:
        """Utilisation of the limits of the robot file in the sweep."""
        return self._limits[1]

    @property
    def dynamics_text(self) -> tuple[str, ...]:
        """Results of dynamics in sentences, or reason why it is left out."""
        return self.dynamics.text if self.dynamics else (self.without_dynamics,)

    def to_dict(self) -> schema.StudyResults:
        """Return the study as JSON values; None for NaN and infinity."""
        s, g, d = self.statics, self.geometry, self.data
        out: schema.StudyResults = {
            "robot": self.robot.name,
            "length_m": self.length,
            "comparisons": [c.to_dict() for c in self.comparisons],
            "verdict": self.verdict.to_dict(),
            "budget": self.budget.to_dict(),
            "figures": [
                {
                    "title": f.title,
                    "caption": f.caption,
                    "png": f"figures/{f.stem}.png",
                    "pdf": f"figures/{f.stem}.pdf",
                }
                for f in self.figures
            ],
            "published_claim": None
            if self.claim is None
            else {
                "source": "Amouri 2019",
                "what": "mean of constant curvature against finite elements",
                "smaller_than_mm": self.claim.mean_mm,
                "smaller_than_percent": self.claim.mean_percent,
                "compared_with": self.claim.ours,
            },
            "data": "simulated" if d is None else f"simulated; {d.label}",
            "registered": d is not None,
            "measurements": None if d is None else d.to_dict(),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            "backbone_limits": list(self.limits_text),
            "sweep": {
                "actuated_tendon": self.settings.tendon + 1,
                "shares": list(self.settings.shares),
                "tension_N": s.tension.tolist(),
                "status": list(s.status),
                "tip_position_mm": (s.tip_position * 1e3).tolist(),
                "tendon_lengths_mm": (s.tendon_lengths * 1e3).tolist(),
                "displacement_mm": (s.displacement * 1e3).tolist(),
                "linear_displacement_mm": (s.linear_displacement * 1e3).tolist(),
                **s.surface.to_dict(),
                "errors_mm": self._errors_mm("statics"),
            },
            "dynamics": {"status": "left_out", "text": list(self.dynamics_text)}
            if self.dynamics is None
            else {**self.dynamics.to_dict(), "errors_mm": self._errors_mm("dynamics")},
            "shapes": self.shapes.to_dict(),
            "maps": {
                "design": None if self.map is None else self.map.to_dict(),
                "load": None if self.load_map is None else self.load_map.to_dict(),
                "text": [] if self.load_map is None else [load_sentence(self.load_map)],
            },
            "uncertainty": {
                "assumed": self.uncertainty_assumed,
                "models": [spread.to_dict() for spread in self.spreads],
            },
            "finite_elements": None if self.bricks is None else self.bricks.to_dict(),
            "geometric_sweep": {
                "displacement_mm": (g.displacement * 1e3).tolist(),
                "tip_position_mm": (g.tip_position * 1e3).tolist(),
                "theta_deg": np.degrees(g.theta).tolist(),
            },
            "provenance": {
                "schema_version": SCHEMA_VERSION,
                "bowstring_version": str(_core.__version__),
                "robot_hash": self.robot.hash,
                "robot": self.robot.model_dump(mode="json", exclude_none=True),
                "settings": {
                    "tolerance_percent": self.settings.tolerance * 100.0,
                    "max_tension_N": self.settings.max_tension,
                    "points": self.settings.points,
                    "theory": self.settings.theory,
                    "gravity_m_per_s2": [g + 0.0 for g in self.robot.gravity],
                    "rise_s": self.settings.rise,
                    "modal_damping": self.settings.modal_damping,
                },
            },
        }
        found: schema.StudyResults = plain(out)
        return found

    def _errors_mm(self, against: str) -> dict[str, list[float | None]]:
        """Errors by name at the loads of the sweep, mm."""
        return {c.name: (c.error * 1e3).tolist() for c in self.against(against)}


# -- running it --------------------------------------------------------------------------------


def run_study(
    robot: Robot,
    *,
    tolerance: float | str = 0.01,
    theory: Theory = "cosserat",
    loading: Loading | None = None,
    ramp: Ramp | None = None,
    measurements: Measurements | str | Path | None = None,
    extras: Extras | None = None,
    progress: Progress | None = None,
) -> Study:
    """Study the error of constant curvature for a robot.

    Parameters
    ----------
    robot : Robot
        The robot.
    tolerance : float or str
        Tolerated tip error as a share of the robot's length: 0.01 or "1 %".
    theory : {"cosserat", "kirchhoff"}
        Rod theory of the main sweep and of dynamics. The budget uses both.
    loading : Loading, optional
        Actuated tendons, range of tension, and number of loads.
    ramp : Ramp, optional
        Rise of the tension and damping in dynamics.
    measurements : Measurements, str or Path, optional
        Measurements of this robot, or their table, with which all models are compared too
        (`bowstring.study.data_validation`). Read a table in another format by
        `bowstring.read_measurements` with a mapping.
    extras : Extras, optional
        Solid in the report, finite elements.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Study
        Comparison, error budget and verdict; `bowstring.study.report.write` writes its report.

    Raises
    ------
    InputError
        If a setting is out of range, the measurements cannot be read or used, or a solid or finite
        elements are not possible.
    NoSolutionError
        If no load of the sweep has an equilibrium.
    """
    check_robot(robot)
    check_disks(robot, "the study")
    notify = progress or (lambda what, share: None)
    loading, extras = instance("loading", loading, Loading), instance("extras", extras, Extras)
    settings = _settings(robot, tolerance, theory, loading, instance("ramp", ramp, Ramp))
    model = Model(robot, settings.tendon, settings.theory, settings.shares)
    over = check_load_axis(robot, model, extras.over)
    solid, fe = extras.solid, extras.fe
    if solid:
        from bowstring.cad.solid import check_cad
        from bowstring.robot.sizes import sizes_of

        sizes_of(robot)
        check_cad()
    if fe is not None:
        from bowstring.fem.run import check

        check(robot)
        fe.check()
    if extras.compare and (measurements is None or theory != "cosserat"):
        raise InputError(
            "compare is of models on left-out rows of measurements, with the Cosserat rod; give "
            "measurements, and leave theory out"
        )
    data = None
    if measurements is not None:
        from bowstring.study.data_validation import judge_data

        notify("measurements", 0.0)
        data = judge_data(
            robot,
            _read(robot, measurements),
            settings.tolerance,
            settings.theory,
            lambda share: notify("measurements", 0.2 * share),
            compare=extras.compare,
        )
    whole = _between(notify, 0.2 if data is not None else 0.0, 1.0)
    notify = _between(
        whole, 0.0, 1.0 if fe is None else 0.2
    )  # finite elements take most of the time
    model.arc_scale = _arc_scale(model, settings)

    notify("geometric sweep", 0.0)
    geometry = _geometric_sweep(model, settings)

    notify("statics", 0.05)
    statics = _statics(model, settings)
    comparisons = model.compare(statics.tension, statics.tip_position, statics.tendon_lengths)
    shapes = compare_shapes(model, statics, comparisons)

    notify("dynamics", 0.1)
    motion, without = _dynamics(
        model, settings, statics, lambda share: notify("dynamics", 0.1 + 0.1 * share)
    )
    in_time = {}
    if motion is not None:
        in_time = model.compare(
            statics.tension, motion.load_tip, motion.load_lengths, against="dynamics"
        )

    notify("error budget", 0.2)
    budget = error_budget(
        model,
        statics.tension,
        lambda share: notify("error budget", 0.2 + 0.6 * share),
        _calibrated_friction(data),
    )

    notify("verdict", 0.8)
    verdict = judge(
        model, settings.tolerance, settings.max_tension, comparisons, budget, shapes.text
    )

    notify("map and uncertainty", 0.9)
    of_design = design_map(without_memory(robot), settings)
    of_load = load_map(model, settings, over)
    spreads = _spreads(robot, settings, extras.uncertainty)

    bricks, by_bricks = None, {}
    if fe is not None:
        from bowstring.study import finite_elements

        bricks = finite_elements.solve(
            robot,
            model.tensions(statics.tension),
            statics.tip_position,
            fe,
            lambda share: whole("finite elements", 0.2 + 0.8 * share),
        )
        by_bricks = model.compare(
            statics.tension, bricks.tip_position, bricks.tendon_lengths, against="fe"
        )
        if data is not None:
            bricks = finite_elements.at_data(bricks, statics.tension, model.shares, data)
    whole("done", 1.0)
    return Study(
        robot=robot,
        settings=settings,
        geometry=geometry,
        statics=statics,
        dynamics=motion,
        without_dynamics=without,
        comparisons=(
            *comparisons.values(),
            *in_time.values(),
            *by_bricks.values(),
            *(() if data is None else data.comparisons),
            *shapes.comparisons,
        ),
        budget=budget,
        verdict=verdict,
        shapes=shapes,
        claim=_claim(robot, settings, comparisons, in_time, by_bricks),
        notes=(
            *_notes(robot, settings, geometry, statics, comparisons, in_time, data),
            *([without_map(robot)] if of_design is None else ()),
            *([without_surface(robot)] if without_surface(robot) else ()),
            *(_ON_MATRIX if spreads and extras.uncertainty is None and _by_matrix(robot) else ()),
            *(spreads[0].distributions.warnings if spreads else ()),
        ),
        data=data,
        solid=solid,
        bricks=bricks,
        map=of_design,
        load_map=of_load,
        spreads=spreads,
        uncertainty_assumed=extras.uncertainty is None,
    )


def _by_matrix(robot: Robot) -> bool:
    return any(segment.backbone.stiffness is not None for segment in robot.segments)


def _spreads(robot: Robot, settings: Settings, given: Any) -> tuple[Spread, ...]:
    """Validity limits with uncertain numbers; none where statics solves too few samples."""
    shares = {i: share for i, share in enumerate(settings.shares, 1) if share}
    loading = Loading(settings.max_tension, settings.points, shares)
    free = without_memory(robot)
    try:
        joint = assumed_distributions(free) if given is None else given
    except InputError:  # nothing may vary by the assumed sizes
        return ()
    spread_of = sampled(
        free,
        joint,
        MEANINGS,
        tolerance=settings.tolerance,
        points=_ASSUMED_POINTS if given is None else _GIVEN_POINTS,
        loading=loading,
        model=RodModel(settings.theory),
    )
    out = []
    for name in MEANINGS:
        with suppress(NoSolutionError):
            out.append(spread_of(name))
    return tuple(out)


def _between(notify: Progress, start: float, end: float) -> Progress:
    """Progress callback for a part of the work between two shares."""
    return lambda what, done: notify(what, start + (end - start) * done)


def _read(robot: Robot, measurements: Measurements | str | Path) -> Measurements:
    from bowstring.data.measurements import Measurements, read_measurements

    if isinstance(measurements, Measurements):
        return measurements
    if not isinstance(measurements, (str, Path)):
        raise InputError(
            f"measurements is {shown(measurements)}, it must be the path of a table, or "
            "measurements that are read"
        )
    return read_measurements(measurements, robot)


def _settings(
    robot: Robot, tolerance: float | str, theory: Theory, loading: Loading, ramp: Ramp
) -> Settings:
    tolerance = share_of_length("tolerance", tolerance)
    choice("theory", theory, ("cosserat", "kirchhoff"))
    shares = loading.shares(robot)
    leading = int(np.argmax(shares))
    limit = loading.max_tension
    if limit is None:
        limit = largest_load(robot, np.array(shares), RodModel(theory))
    return Settings(
        tolerance=tolerance,
        max_tension=limit,
        points=loading.points,
        theory=theory,
        tendon=leading,
        shares=shares,
        range_chosen=loading.max_tension is None,
        rise=ramp.rise,
        modal_damping=ramp.modal_damping,
    )


def _arc_scale(model: Model, settings: Settings) -> float:
    """Share of the tensions at which the arcs of the linear law end at the robot's own bend.

    It is 1 without gravity. In gravity the linear law may bend a robot ten times too far, so that
    its arcs would be unusable as geometry or as commanded lengths.
    """
    linear = settings.max_tension * model.linear_bend_of_all
    if not any(model.robot.gravity) or linear <= MAX_BEND:
        return 1.0
    tension = np.linspace(0.0, settings.max_tension, TRIED)
    bend = turned(model.robot, model.tensions(tension), model.main.model)
    known = bend[np.isfinite(bend)]
    return min(1.0, max(MAX_BEND, float(known[-1]) if known.size else 0.0) / linear)


def _geometric_sweep(model: Model, settings: Settings) -> GeometricSweep:
    """Shorten the actuated tendon by the linear law; the others follow at constant arc length."""
    robot = model.robot
    tension = np.linspace(0.0, settings.max_tension, settings.points)
    arcs = RobotArcs.from_tensions(robot, model.tensions(model.arc_scale * tension))
    try:
        lengths = arcs.lengths()
    except BowstringError:
        turns = settings.max_tension * model.linear_bend_of_all / math.tau
        raise InputError(
            f"by the linear law {settings.max_tension:g} N winds {robot.name} up by "
            f"{significant(turns)} turns, tighter than its tendons' distance from the backbone "
            "lets them; check its stiffness or give a smaller largest tension",
            argument="max_tension",
        ) from None
    # Eq. 5 of the study, from lengths (theory Eq. 1.1 and 1.4), needs three tendons per
    # segment and lengths of an arc; otherwise the original arcs are kept, which are the same.
    with suppress(InputError):
        arcs = RobotArcs.from_lengths(robot, lengths)
    return GeometricSweep(
        displacement=_displacement(model, lengths),
        tendon_lengths=lengths,
        theta=arcs.theta,
        tip_position=arcs.tip.position,
        disk_positions=arcs.disk_positions,
        disk_rotations=arcs.disk_rotations,
        backbone=arcs.centerline(_BACKBONE_POINTS),
        scale=model.arc_scale,
    )


def _displacement(model: Model, lengths: Array) -> Array:
    """Displacement of the actuated tendon from the straight backbone (n,), m."""
    end = model.robot.tendons.end_disk[model.tendon]
    return np.asarray(model.robot.disks.station_m[end] - lengths[:, model.tendon])


def _statics(model: Model, settings: Settings) -> Statics:
    tension = np.linspace(0.0, settings.max_tension, settings.points)
    sweep = model.solve(model.main, tension, disks=True)
    if not np.any(sweep.converged):
        raise NoSolutionError(
            f"no load from 0 to {tension[-1]:g} N has a stable equilibrium that the solver could "
            f"find ({sweep.message(0).rstrip('.')}); check stiffness, gravity and largest tension"
        )
    assert sweep.disk_positions is not None and sweep.disk_rotations is not None
    return Statics(
        tension=tension,
        status=cast("tuple[StaticsStatus, ...]", tuple(sweep.status)),
        converged=np.asarray(sweep.converged, dtype=bool),
        tip_position=sweep.tip_position,
        disk_positions=sweep.disk_positions,
        disk_rotations=sweep.disk_rotations,
        tendon_lengths=sweep.tendon_lengths,
        displacement=_displacement(model, sweep.tendon_lengths),
        linear_displacement=model.linear_displacement(tension),
        surface=surface_at_rest(model, tension, sweep.tip_position),
    )


def _dynamics(
    model: Model, settings: Settings, statics: Statics, progress: Callable[[float], None]
) -> tuple[Transient | None, str]:
    """Motion, or reason why there is none; statics does not depend on it."""
    try:
        frequency = slowest_frequency(model)
    except BowstringError as error:
        return None, f"Dynamics is left out: {str(error).rstrip('.')}."
    if settings.rise is not None:
        check_rise(model.robot, settings.rise, frequency)
    try:
        motion = transient(
            model,
            statics.tension,
            frequency,
            settings.rise,
            settings.modal_damping,
            progress,
        )
    except BowstringError as error:
        return None, f"Dynamics is left out: {str(error).rstrip('.')}."
    return motion, ""


def _calibrated_friction(data: AgainstData | None) -> Robot | None:
    """Calibrated robot, if its friction was identifiable."""
    if data is None or data.calibration is None or not data.calibration.fit.converged:
        return None
    names = data.calibration.fit.names
    return data.calibration.robot if any(n.endswith(".friction") for n in names) else None


def _claim(
    robot: Robot,
    settings: Settings,
    comparisons: dict[str, Comparison],
    in_time: dict[str, Comparison],
    by_bricks: dict[str, Comparison],
) -> PublishedClaim | None:
    """Published mean of the source study, for its own robot and load range only."""
    if robot.name != "amouri2019" or settings.max_tension != 80.0:
        return None
    if settings.tendon != 0 or not settings.actuated_alone:
        return None
    ours = comparisons["cc_from_force"]
    x, _, z = ours.mean_by_axis
    moving = ""
    if in_time and in_time["cc_from_force"].n == ours.n:
        moving = f"; against dynamics it is {in_mm(in_time['cc_from_force'].mean)}"
    if by_bricks and by_bricks["cc_from_force"].n == ours.n:
        moving += f"; against our finite elements {in_mm(by_bricks['cc_from_force'].mean)}"
    text = (
        "Amouri 2019 prints, for constant curvature against its finite-element run, a mean error "
        "smaller than 4.95 mm (0.77 % of length), and speaks of errors along each axis. This is "
        f"the study's published mean; ours, from force and against statics, is {in_mm(ours.mean)} "
        f"({in_percent(ours.mean / robot.length)}; {in_mm(x)} in x, {in_mm(z)} in z){moving}. How "
        "the study turned force into cable length is our reading of its section 4.1 (the linear "
        "law). No measured data of the study are available, so nothing here is its measurement."
    )
    if robot.hash != load_robot("amouri2019").hash:
        text += " The robot studied here differs from the built-in one in some of its numbers."
    return PublishedClaim(4.95, 0.77, ours.name, text)


def _without_arcs(robot: Robot, settings: Settings, statics: Statics, name: str) -> str:
    """Reason why constant curvature has no arc at the last load that statics solved."""
    last = int(np.flatnonzero(statics.converged)[-1])
    force = statics.tension[last] * np.array(settings.shares)
    commands = force if name in FROM_FORCE else statics.tendon_lengths[last]
    return points_by_arcs(robot, name, commands[None])[1].partition(";")[0] or "no arc fits"


def _notes(
    robot: Robot,
    settings: Settings,
    geometry: GeometricSweep,
    statics: Statics,
    comparisons: dict[str, Comparison],
    in_time: dict[str, Comparison],
    data: AgainstData | None,
) -> tuple[str, ...]:
    simulated = (
        "constant curvature is compared with the statics and the dynamics of this program, not "
        "with a measurement. All share the base frame, so nothing was registered."
    )
    out = [
        f"All data are simulated: {simulated}"
        if data is None
        else f"Apart from 'Against the data', all is simulated: {simulated}",
        "Errors are Euclidean at the tip unless an axis is named; means and RMS are over loads "
        "(zero load included), never over coordinates.",
        f"Physics of the main sweep: {settings.theory.capitalize()} rod, frictionless tendons "
        "straight from disk to disk, dead loads, "
        + (
            f"gravity ({', '.join(f'{g:g}' for g in robot.gravity)}) m/s2 as in the robot file."
            if any(robot.gravity)
            else "no gravity (the robot file has none)."
        ),
    ]
    if settings.range_chosen:
        out.append(
            f"The load range to {settings.max_tension:g} N was chosen by the program: the largest "
            "round load that "
            + (
                "turns the robot by at most 80 degrees from its pose without tension, by statics "
                f"in gravity (at most {FARTHEST:g} times that of the linear law)."
                if any(robot.gravity)
                else "bends the robot by at most 80 degrees by the linear law."
            )
        )
    if geometry.scale < 1.0:
        out.append(
            f"In gravity the linear law bends {robot.name} far more than it goes: the geometric "
            "sweep and the commanded lengths end at the arcs of "
            f"{significant(geometry.scale * settings.max_tension)} N, about the robot's own bend."
        )
    calibrated = _calibrated_friction(data) is not None
    if robot.has_friction or calibrated:
        whose = "that was calibrated" if calibrated else "that the robot file gives"
        out.append(
            f"The friction {whose} is left out of the main sweep, of dynamics, of "
            "stress and strain and of the ranges in the verdict. What it does, loading and "
            "unloading, is in the error budget under 'Actuation' and in the "
            "verdict's last sentences."
        )
    if robot.has_hysteresis:
        out.append(
            "The hysteresis of the backbone is left out of the main sweep, of dynamics, of stress "
            "and strain and of the verdict. What it does, loading and unloading, is in the error "
            "budget under 'Actuation'."
        )
    if robot.has_backlash:
        out.append(
            "The backlash of the drives is left out of the main sweep, of dynamics and of the "
            "verdict. What it does under displacement control, loading and unloading, is in the "
            "error budget under 'Actuation'."
        )
    if robot.is_viscoelastic:
        out.append(
            "Relaxation and creep are left out of all but the error budget, since the loads have "
            "no times. What they do once a load is held until the robot rests is there under "
            "'Actuation'."
        )
    for name, comparison in comparisons.items():
        missing = int(statics.converged.sum()) - comparison.n
        if missing and not comparison.n:
            out.append(
                f"Constant curvature {COMPARISONS[name]} has no numbers here: "
                f"{_without_arcs(robot, settings, statics, name)}."
            )
        elif missing:
            out.append(
                f"Constant curvature {COMPARISONS[name]} has no arc at {missing} of the loads that "
                f"statics solved; its numbers are over the other {comparison.n}."
            )
    for name, comparison in in_time.items():
        if comparison.n != comparisons[name].n:
            out.append(
                f"Constant curvature {COMPARISONS[name]} is compared with dynamics at "
                f"{comparison.n} loads and with statics at {comparisons[name].n}: do not compare "
                "their means."
            )
    return tuple(out)
