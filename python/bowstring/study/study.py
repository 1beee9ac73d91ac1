"""Results of a study, which `bowstring.study.run` computes.

Values are in SI and radians; `Study.to_dict` converts them to mm, degrees and percent.
`bowstring.study.report` writes them, `bowstring.study.figures` draws them.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

import bowstring._core as _core
from bowstring.data.tip_errors import Comparison
from bowstring.display import html_table
from bowstring.errors import InputError
from bowstring.formatting import in_percent, listed, plain
from bowstring.robot.model import Robot
from bowstring.statics import limits
from bowstring.statics.model import RodModel
from bowstring.study.comparison import Model
from bowstring.study.design_map import caption_of
from bowstring.study.error_budget import Budget
from bowstring.study.figure_list import (
    ANGLE_FIGURES,
    BRICKS_IN,
    DATA_FIGURES,
    FE_FIGURES,
    FIGURES,
    SOLID_FIGURES,
    WITHOUT_SURFACE,
    Figure,
    captions_without_surface,
)
from bowstring.study.load_map import caption_of_loads, load_sentence
from bowstring.study.notes import PublishedClaim
from bowstring.study.ramp_response import Transient, has_surface, without_surface
from bowstring.study.settings import Settings
from bowstring.study.shape_models import ShapeModels
from bowstring.study.sweeps import GeometricSweep, Statics
from bowstring.study.verdict import Verdict
from bowstring.validity.map_result import ValidityMap
from bowstring.validity.spread import Spread

if TYPE_CHECKING:
    from bowstring.study.angle_validation import AgainstAngles
    from bowstring.study.data_validation import AgainstData
    from bowstring.study.finite_elements import FiniteElements

SCHEMA_VERSION: Final = 1


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
    """All models against measured tips, if there are any."""
    angles: AgainstAngles | None = None
    """All models against measured angles, if the measurements have no tips."""
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
        title = " ".join([repr(self).strip("<>"), *(m.answer for m in self.verdict.meanings)])
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
    def measured(self) -> AgainstData | AgainstAngles | None:
        """All models against the measurements, if there are any."""
        return self.data or self.angles

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
        """Figures of the study: `SOLID_FIGURES`, `FIGURES`, `FE_FIGURES`, and of the data."""
        missing = ["fig05_over_time"] * (self.dynamics is None)
        missing += ["fig02_disk"] * bool(self.without_disks)
        missing += ["variable_curvature"] * (not self.shapes.curves)
        missing += ["validity_map"] * (self.map is None)
        missing += ["load_map"] * (self.load_map is None)
        missing += ["validity_spread"] * (not self.spreads)
        found = [f for f in FIGURES if f.stem not in missing]
        captions = {
            **captions_without_surface(self.robot),
            **({} if self.map is None else {"validity_map": caption_of(self.map)}),
            **({} if self.load_map is None else {"load_map": caption_of_loads(self.load_map)}),
        }
        found = [replace(f, caption=captions.get(f.stem, f.caption)) for f in found]
        if not has_surface(self.robot):
            found = [replace(f, title=WITHOUT_SURFACE.get(f.stem, f.title)) for f in found]
        if self.bricks is not None:
            found = [replace(f, caption=f.caption + BRICKS_IN.get(f.stem, "")) for f in found]
        found = [*(SOLID_FIGURES if self.solid else ()), *found]
        if self.bricks is not None and len(self.bricks.run.states) > 1:
            found += FE_FIGURES
        if self.angles is not None:
            found = [
                *(replace(f, caption=f"{self.angles.title}. {f.caption}") for f in ANGLE_FIGURES),
                *found,
            ]
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
        """Why there is no drawing of the disks; empty if there is one."""
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

    @cached_property
    def _limits(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        s, settings = self.statics, self.settings
        largest, model = s.tension[-1] * np.array(settings.shares), RodModel(settings.theory)
        found, uses = limits.of_sweep(self.robot, s.tension, s.disk_positions, s.surface.by_segment)
        return (*limits.buckled_or_stretched(self.robot, largest, model), *found), uses

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of robot, data and sweep: missing equilibria, disks below the base, limits."""
        missing = self.without_equilibrium
        of_data = self.measured.doubts if self.measured is not None else ()
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

    def to_dict(self) -> dict[str, Any]:
        """Return the study as JSON values; None for NaN and infinity."""
        s, d, measured = self.statics, self.data, self.measured
        out = {
            "robot": self.robot.name,
            "length_m": self.length,
            "comparisons": [c.to_dict() for c in self.comparisons],
            "verdict": self.verdict.to_dict(),
            "budget": self.budget.to_dict(),
            "figures": [f.to_dict() for f in self.figures],
            "published_claim": None if self.claim is None else self.claim.to_dict(),
            "data": "simulated" if measured is None else f"simulated; {measured.label}",
            "registered": d is not None,
            "measurements": None if d is None else d.to_dict(),
            "angles": None if self.angles is None else self.angles.to_dict(),
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            "backbone_limits": list(self.limits_text),
            "sweep": {
                "actuated_tendon": self.settings.tendon + 1,
                "shares": list(self.settings.shares),
                **s.to_dict(),
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
            "geometric_sweep": self.geometry.to_dict(),
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
        found: dict[str, Any] = plain(out)
        return found

    def _errors_mm(self, against: str) -> dict[str, list[float | None]]:
        """Errors by name at the loads of the sweep, mm."""
        return {c.name: (c.error * 1e3).tolist() for c in self.against(against)}
