"""Error budget: contribution of each physical effect to the error of constant curvature.

One factor at a time, each effect is added to the baseline, removed from the full model, and changed
in the main sweep. Its contribution is the mean error with the effect minus that without it.

Actuation (friction, elastic tendons, displacement control) has its own table
(`bowstring.study.actuation_budget`), because it depends on the path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, cast

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.tip_errors import known_mean
from bowstring.display import short_repr
from bowstring.formatting import round_down
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.study.actuation_budget import ActuationBudget, actuation_budget
from bowstring.study.comparison import MEANINGS, Case, Model
from bowstring.validity.effects import EFFECTS, Effect, Rods, with_values

if TYPE_CHECKING:
    from bowstring.study import budget_rows as schema

Side = Literal["added", "removed", "in_sweep"]

SIDES: Final[dict[Side, str]] = {
    "in_sweep": "Each effect alone in this sweep",
    "removed": "Each effect alone in the full model",
}
"""Parts of the budget in report and figures, with their titles."""
GRAVITY: Final = 9.81
"""Gravity in all gravity cases of the budget, m/s^2."""
_ON_COUPLED: Final = (
    "Straight spans are no row here: there is no continuous tendon beside coupled strains of the "
    "backbone to compare them with, so the baseline has straight spans too.",
    "Without shear and extension, or without torsion, a coupled section has none of these strains "
    "whatever the load, so its couplings with them do not act.",
)
_MAX_SIDEWAYS: Final = 0.13  # tip displacement over length by 1 N transverse to the study's robot


# -- what is computed --------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True)
class Contribution:
    """Contribution of one effect to the mean error of constant curvature."""

    n: int
    """Number of loads with results both with and without the effect, over which means are taken."""
    of: int
    """Number of loads of the sweep."""
    with_effect: float
    """Mean error with the effect, m; NaN without such loads."""
    without_effect: float
    """Mean error without it, m."""

    @property
    def mean(self) -> float:
        """Mean error with minus without the effect, m; positive if the effect increases it."""
        return self.with_effect - self.without_effect

    @property
    def partial(self) -> bool:
        """Whether loads are missing, so that it is not comparable with other contributions."""
        return 0 < self.n < self.of


@short_repr
@dataclass(frozen=True)
class BudgetRow:
    """One effect: added to the baseline, removed from the full model, changed in the main sweep."""

    effect: str
    """Key, such as ``"straight_spans"``."""
    label: str
    """Effect in words."""
    added: Case
    """Baseline with the effect."""
    full: Case
    """Full model with the effect (of alternatives, with this one)."""
    removed: Case
    """`full` without the effect."""
    in_sweep: Case
    """Main sweep with this effect removed if it acts there, otherwise added."""
    reference: Case
    """Reference of `in_sweep`, which differs in this effect only: the main sweep, or, for another
    kind of gravity, the main sweep without gravity."""
    acts_in_sweep: bool
    """Whether the effect acts in the main sweep."""


@short_repr
@dataclass(frozen=True)
class Budget(Result):
    """Error budget."""

    baseline: Case
    """Case of the baseline."""
    full_model: Case
    """Case of the full model."""
    sweep: Case
    """Case of the main sweep."""
    rows: tuple[BudgetRow, ...]
    """Effects, without those of actuation."""
    baseline_description: str
    """Assumptions of the baseline in words."""
    full_model_description: str
    """Assumptions of the full model in words."""
    notes: Annotated[tuple[str, ...], Key()]
    """Definitions and assumptions of the budget in sentences."""
    actuation: Annotated[ActuationBudget, Key()]
    """Budget of friction, elastic tendons and displacement control."""

    def cases(self, row: BudgetRow, side: Side) -> tuple[Case, Case]:
        """Return the two cases with and without an effect."""
        if side == "added":
            return row.added, self.baseline
        if side == "removed":
            return row.full, row.removed
        pair = (row.reference, row.in_sweep)
        return pair if row.acts_in_sweep else pair[::-1]

    def contribution(self, row: BudgetRow, side: Side, meaning: str) -> Contribution:
        """Compute the contribution of an effect to the mean error.

        Parameters
        ----------
        row : BudgetRow
        side : {"added", "removed", "in_sweep"}
            Reference: added to the baseline, removed from the full model, or changed in the main
            sweep.
        meaning : str
            Name of the comparison, one of `bowstring.study.comparison.MEANINGS`.
        """
        present, absent = (case.error(meaning) for case in self.cases(row, side))
        common = np.isfinite(present) & np.isfinite(absent)
        means = (known_mean(error[common]) for error in (present, absent))
        return Contribution(int(common.sum()), len(common), *means)

    def left_out(self, meaning: str) -> tuple[list[tuple[float, float, str]], list[str]]:
        """Effects that the main sweep lacks, with contributions at all of its loads.

        Returns
        -------
        rows : list of (float, float, str)
            Contribution to the mean error (m), mean error with the effect (m), and label.
        missing : list of str
            Labels of effects without numbers at some or all loads.
        """
        needed = int(np.isfinite(self.sweep.error(meaning)).sum())
        gravity = EFFECTS["gravity"].acts(self.sweep.rods)
        rows, missing = [], []
        for row in self.rows:
            # gravity in other orientations is not left out if the sweep has gravity
            if row.acts_in_sweep or (gravity and row.effect.startswith("gravity")):
                continue
            contribution = self.contribution(row, "in_sweep", meaning)
            if contribution.n < needed or needed == 0:
                missing.append(row.label)
            else:
                rows.append((contribution.mean, contribution.with_effect, row.label))
        return rows, missing

    def problems(self, row: BudgetRow, side: Side) -> tuple[str, ...]:
        """Reasons for missing loads of a contribution, without duplicates."""
        present, absent = self.cases(row, side)
        named = (("with it", present.problem), ("without it", absent.problem))
        return tuple(f"{which}: {problem}" for which, problem in named if problem)

    @property
    def of_baseline(self) -> Annotated[schema.DescribedCase, Key("baseline")]:
        """The baseline."""
        return cast("schema.DescribedCase", self.baseline.described(self.baseline_description))

    @property
    def of_full_model(self) -> Annotated[schema.DescribedCase, Key("full_model")]:
        """The full model."""
        return cast("schema.DescribedCase", self.full_model.described(self.full_model_description))

    @property
    def of_sweep(self) -> Annotated[schema.Case, Key("sweep")]:
        """The physics of the sweep."""
        return cast("schema.Case", self.sweep.to_dict())

    @property
    def effects(self) -> Annotated[list[schema.BudgetRow], Key("rows")]:
        """Effects, without those of actuation."""
        return [self._row_to_dict(row) for row in self.rows]

    def _row_to_dict(self, row: BudgetRow) -> schema.BudgetRow:
        def side(name: Side, **more: str) -> Any:
            case: Case = getattr(row, name)
            out = {**more, **case.to_dict()}
            for meaning in MEANINGS:
                found = self.contribution(row, name, meaning)
                length = case.comparisons[meaning].length
                out[meaning]["contribution_n"] = found.n
                out[meaning]["contribution_mm"] = found.mean * 1e3
                out[meaning]["contribution_percent"] = found.mean / length * 100.0
            present, absent = self.cases(row, name)
            return out | present.moved_from(absent)

        return {
            "effect": row.effect,
            "label": row.label,
            "added": side("added"),
            "full": row.full.to_dict(),
            "removed": side("removed"),
            "in_sweep": side("in_sweep", how="removed" if row.acts_in_sweep else "added"),
        }


# -- running it --------------------------------------------------------------------------------


def error_budget(
    model: Model,
    tension: Floats,
    notify: Callable[[float], None] = lambda share: None,
    calibrated: Robot | None = None,
) -> Budget:
    """Compute the error budget of constant curvature.

    Parameters
    ----------
    model : Model
    tension : array (n,)
        Loads of the actuated tendon, N.
    notify : callable, optional
        Progress callback, called with the finished share up to 1.
    calibrated : Robot, optional
        Robot with calibrated friction.
    """
    plain = model.baseline
    entries = [
        entry
        for entry in _entries(model)
        if entry.key != "straight_spans" or plain.model.tendon_path == "continuous"
    ]
    cases: dict[tuple[object, ...], Case] = {}

    def case(rods: Rods) -> Case:
        load = rods.load
        key = (rods.designs.robot.hash, rods.model, load.gravity, load.tip_force)
        if key not in cases:
            cases[key] = model.case(rods, tension)
        return cases[key]

    full = plain
    for entry in entries:
        if not entry.alternative:
            full = entry.added(full)
    posture = "upright"
    if case(full).problem:
        # A backbone that buckles upright under its own weight can still hang.
        hanging = with_values(full, "load", {"gravity": (0.0, 0.0, GRAVITY)})
        if not case(hanging).problem:
            full, posture = hanging, "hanging"

    rows = []
    for i, entry in enumerate(entries):
        whole, acts = entry.added(full), entry.acts(model.main)
        without = entry.removed(model.main)
        in_place = entry.effect is EFFECTS["gravity"] and not acts
        rows.append(
            BudgetRow(
                entry.key,
                entry.label,
                added=case(entry.added(plain)),
                full=case(whole),
                removed=case(entry.removed(whole)),
                in_sweep=case(without if acts else entry.added(model.main)),
                # gravity replaces that of the sweep
                reference=case(without if in_place else model.main),
                acts_in_sweep=acts,
            )
        )
        notify((i + 1) / (len(entries) + 1))
    actuation = actuation_budget(model, tension, case(model.main), calibrated)
    notify(1.0)

    clamps = (
        "the file's clamps"
        if any(s.disks.clamped_length for s in model.robot.segments)
        else "each disk clamps as much backbone as it is thick (3 mm if its thickness is zero)"
    )
    x, y, _ = model.towards
    stiffness, coupled = _stiffness_word(model.robot), model.robot.is_coupled
    of_file = stiffness if stiffness.startswith("E") else f"the {stiffness}"
    return Budget(
        baseline=case(plain),
        full_model=case(full),
        sweep=case(model.main),
        rows=tuple(rows),
        baseline_description=f"{'straight spans' if coupled else 'continuous tendon'}, no clamps, "
        f"no shear or extension, no twist, no gravity, no tip force, {stiffness} as in the file",
        full_model_description="straight spans, clamps, shear and extension, twist, gravity "
        f"({posture}), tip force, {stiffness} 10 % lower",
        notes=(
            "A contribution is the mean error with the effect less the mean error without it, all "
            "else the same: positive if the effect makes the error larger.",
            "Effects interact and can cancel: contributions do not add up to the whole, one effect "
            "can lower the error that another one makes, and the contribution of an effect depends "
            "on the other effects that act.",
            f"Constant curvature from force always uses {of_file} and length of the robot file, as "
            "a user would, also where the simulated robot is stiffer, softer or clamped.",
            "'In this sweep' changes one effect in the physics of the main sweep: it is removed if "
            "it acts there and added if it does not. Gravity in an orientation replaces the "
            "gravity of the robot file; its contribution is the change from the same sweep without "
            "gravity.",
            "'In the full model' removes one effect from the full model. Gravity in another "
            f"orientation and {stiffness} 10 % higher replace the gravity and the {stiffness} of "
            "the full model.",
            f"Gravity is {GRAVITY} m/s2: upright along -z (base below), hanging along +z, "
            f"horizontal along ({_zero(-x):.3g}, {_zero(-y):.3g}, 0), in the bending plane; "
            "the actuated tendon is on the upper side.",
            "The transverse tip force is dead and perpendicular to the bending plane. It is the "
            "largest round force that moves the straight robot's tip by at most 13 % of the "
            "length by linear theory: 1 N for the study's robot.",
            f"Clamps: {clamps}.",
            "Holes: a straight tendon bends at entry and exit of a hole, which is as long as the "
            f"disk is thick ({' / '.join(f'{h * 1e3:.4g}' for h in model.budget_holes)} mm); "
            "otherwise in the mid-plane of the disk."
            + ("" if coupled else " A continuous tendon has no such points."),
            *(_ON_COUPLED if coupled else ()),
        ),
        actuation=actuation,
    )


# -- the effects -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Entry:
    """An effect of the budget and its size."""

    key: str
    label: str
    effect: Effect
    present: dict[str, Any]
    """Values of the effect's fields with which it acts."""
    alternative: bool = False
    """Whether it is an alternative to another size in the full model."""

    def added(self, rods: Rods) -> Rods:
        return with_values(rods, self.effect.part, self.present)

    def removed(self, rods: Rods) -> Rods:
        return with_values(rods, self.effect.part, self.effect.absent)

    def acts(self, rods: Rods) -> bool:
        """Whether rods have the effect, gravity and tip force in the same direction."""
        if self.effect.part == "load":
            return all(getattr(rods.load, name) == value for name, value in self.present.items())
        return self.effect.acts(rods)


def _entries(model: Model) -> list[_Entry]:
    clamps = sorted({f"{c * 1e3:.4g}" for c in model.budget_clamps})
    holes = sorted({f"{h * 1e3:.4g}" for h in model.budget_holes})
    force, stiffness = transverse_force(model.robot, _MAX_SIDEWAYS), _stiffness_word(model.robot)
    gravity = {
        "upright": (0.0, 0.0, -GRAVITY),
        "hanging": (0.0, 0.0, GRAVITY),
        "horizontal": _times(model.towards, -GRAVITY),
    }

    def entry(
        key: str, label: str, *present: Any, of: str = "", alternative: bool = False
    ) -> _Entry:
        effect = EFFECTS[of or key]
        values = dict(zip(effect.absent, present, strict=True))
        return _Entry(key, label, effect, values, alternative)

    return [
        entry("straight_spans", "straight spans, not a continuous tendon", "straight"),
        entry("clamps", f"disks clamp {' / '.join(clamps)} mm", model.budget_clamps),
        entry(
            "hole_planes",
            f"holes of {' / '.join(holes)} mm, not points",
            model.budget_holes,
            alternative=True,
        ),
        entry("shear_extension", "shear and extension", "cosserat"),
        entry("torsion", "torsion (the backbone may twist)", True),
        *(
            entry(
                f"gravity_{way}", f"gravity, {way}", g, of="gravity", alternative=way != "upright"
            )
            for way, g in gravity.items()
        ),
        entry("tip_force", f"transverse tip force {force:g} N", _times(model.across, force)),
        _softer("E_minus_10", f"{stiffness} 10 % lower", model.robot, 0.9),
        _softer("E_plus_10", f"{stiffness} 10 % higher", model.robot, 1.1),
    ]


def _softer(key: str, label: str, robot: Robot, factor: float) -> _Entry:
    """Change of E, or of whole stiffness matrices, by a factor."""
    backbones = [segment.backbone for segment in robot.segments]

    def scaled(by: float) -> dict[str, Any]:
        matrices = [b.stiffness and (by * np.array(b.stiffness)).tolist() for b in backbones]
        return {"E": [b.E and by * b.young for b in backbones], "stiffness": matrices}

    effect = Effect(label, "backbone", scaled(1.0), lambda rods: False)
    return _Entry(key, label, effect, scaled(factor), alternative=factor > 1.0)


def _stiffness_word(robot: Robot) -> str:
    """Name of the stiffness that the robot file gives: of E or of matrices."""
    by_matrix = [s.backbone.stiffness is not None for s in robot.segments]
    if not any(by_matrix):
        return "E"
    return "stiffness matrix" if all(by_matrix) else "E or stiffness matrix"


def transverse_force(robot: Robot, share: float, unit: float = 1.0) -> float:
    """Largest force that moves the straight robot's tip by at most a share of its length, rounded.

    Parameters
    ----------
    robot : Robot
    share : float
        Deflection over the length, by linear theory.
    unit : float
        Divisor of the force before it is rounded, such as gravity for a mass.

    Returns
    -------
    float
        Force in N over `unit`, rounded down.
    """
    compliance, beyond = 0.0, robot.length
    for segment, stiffness in zip(robot.segments, robot.bending_stiffness, strict=True):
        inner = beyond - segment.length
        compliance += (beyond**3 - inner**3) / (3.0 * float(stiffness))
        beyond = inner
    return round_down(share * robot.length / compliance / unit)


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    # + 0.0: no negative zeros
    x, y, z = (v * factor + 0.0 for v in vector)
    return (x, y, z)


def _zero(value: float) -> float:
    return 0.0 if abs(value) < 1e-12 else value
