"""The error budget: what each physical effect does to constant curvature's error.

Each effect is added alone to the plainest physics, removed alone from the fullest, and changed
alone in the physics of the main sweep. How the robot is driven (friction, elastic tendons, pulled
lengths) has a table of its own, `bowstring.actuation`, since it depends on the path.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.actuation import DriveBudget, drive_budget
from bowstring.comparison import Case, Model, Physics, known_mean
from bowstring.robot import Robot
from bowstring.words import round_down

__all__ = ["GRAVITY", "Budget", "BudgetRow", "error_budget"]

Array = NDArray[np.float64]

GRAVITY: Final = 9.81
"""m/s^2, in every gravity case of the budget."""
_MAX_SIDEWAYS: Final = 0.13  # of the length: what 1 N across the tip of the study's robot does


# -- what is computed --------------------------------------------------------------------------


@dataclass(frozen=True)
class BudgetRow:
    """One effect: added alone to the plainest physics, removed alone from the fullest.

    And, since both are far from the sweep that the verdict is about, changed alone in that sweep.
    """

    effect: str
    label: str
    added: Case
    full: Case
    """The fullest physics in which the effect acts (of alternatives, with this one)."""
    removed: Case
    in_sweep: Case
    """The main sweep with only this effect changed: removed if it acts there, else added."""
    acts_in_sweep: bool

    def worth(self, meaning: str) -> float:
        """What the effect adds to the mean error when all others act too, m; may be negative."""
        return known_mean(self.full.error(meaning) - self.removed.error(meaning))

    def to_dict(self, plainest: Case, sweep: Case) -> dict[str, Any]:
        """The row in mm and percent."""
        return {
            "effect": self.effect,
            "label": self.label,
            "added": self.added.to_dict(plainest),
            "full": self.full.to_dict(),
            "removed": self.removed.to_dict(self.full),
            "in_sweep": {
                "how": "removed" if self.acts_in_sweep else "added",
                **self.in_sweep.to_dict(sweep),
            },
        }


@dataclass(frozen=True)
class Budget:
    """The error budget."""

    plainest: Case
    fullest: Case
    sweep: Case
    """The physics of the main sweep."""
    rows: tuple[BudgetRow, ...]
    plainest_is: str
    fullest_is: str
    notes: tuple[str, ...]
    drive: DriveBudget
    """Friction, elastic tendons and pulled lengths."""

    def to_dict(self) -> dict[str, Any]:
        """The budget in mm and percent."""
        return {
            "plainest": {"is": self.plainest_is, **self.plainest.to_dict()},
            "fullest": {"is": self.fullest_is, **self.fullest.to_dict()},
            "sweep": self.sweep.to_dict(),
            "rows": [row.to_dict(self.plainest, self.sweep) for row in self.rows],
            "notes": list(self.notes),
            "drive": self.drive.to_dict(),
        }


# -- running it --------------------------------------------------------------------------------


def error_budget(
    model: Model, tension: Array, tell: Callable[[float], None] = lambda share: None
) -> Budget:
    """What each physical effect does to the error of constant curvature.

    Parameters
    ----------
    model : Model
    tension : array (n,)
        Loads of the pulled tendon, N.
    tell : callable, optional
        Is told the share that is done, up to 1.

    Returns
    -------
    Budget
    """
    effects = _effects(model)
    plain = Physics()
    cases: dict[Physics, Case] = {}

    def case(physics: Physics) -> Case:
        if physics not in cases:
            cases[physics] = model.case(physics, tension)
        return cases[physics]

    full = plain
    for effect in effects:
        if not effect.alternative:
            full = replace(full, **effect.on)
    posture = "upright"
    if case(full).problem:
        # A backbone that cannot stand under its own weight can still hang.
        hanging = replace(full, gravity=(0.0, 0.0, GRAVITY))
        if not case(hanging).problem:
            full, posture = hanging, "hanging"

    rows = []
    for i, effect in enumerate(effects):
        whole = replace(full, **effect.on)
        rows.append(
            BudgetRow(
                effect.key,
                effect.label,
                added=case(replace(plain, **effect.on)),
                full=case(whole),
                removed=case(_without(whole, effect)),
                in_sweep=case(_changed(model, effect)),
                acts_in_sweep=_acts(model, effect),
            )
        )
        tell((i + 1) / (len(effects) + 1))
    drive = drive_budget(model, tension, case(model.main))
    tell(1.0)

    clamps = (
        "the file's clamps"
        if any(s.disks.clamped_length for s in model.robot.segments)
        else "each disk clamps as much backbone as it is thick (3 mm if its thickness is zero)"
    )
    x, y, _ = model.towards
    return Budget(
        plainest=case(plain),
        fullest=case(full),
        sweep=case(model.main),
        rows=tuple(rows),
        plainest_is="continuous tendon, no clamps, no shear or extension, no twist, no gravity, no "
        "tip force, E as in the file",
        fullest_is=f"straight spans, clamps, shear and extension, twist, gravity ({posture}), tip "
        "force, E 10 % lower",
        notes=(
            "Effects interact and can cancel: neither the column 'added' nor the column 'removed' "
            "adds up to the whole, and one effect can lower the error that another one makes.",
            "'From force' always uses the file's own E and length, as a user would, also where "
            "the physics is stiffer, softer or clamped.",
            "'In this sweep' changes the effect alone in the physics of the main sweep: taken out "
            "if it acts there, added if not (gravity takes the place of the file's).",
            "'Removed' takes the effect out of the fullest physics. The alternatives (gravity in "
            "the other orientations, E 10 % higher) are compared with a fullest physics that has "
            "them in place of its own.",
            f"Gravity is {GRAVITY} m/s2: upright along -z (base below), hanging along +z, "
            f"horizontal along ({_zero(-x):.3g}, {_zero(-y):.3g}, 0), in the bending plane and "
            "against the pulled tendon, which lies on top.",
            "The force across the tip is dead and perpendicular to the bending plane. It is the "
            "largest round force that moves the straight robot's tip by at most 13 % of the "
            "length by linear theory: 1 N for the study's robot.",
            f"Clamps: {clamps}.",
        ),
        drive=drive,
    )


# -- the effects -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Effect:
    key: str
    label: str
    on: dict[str, Any]
    """Fields of `Physics` that make the effect act."""
    alternative: bool = False
    """Another value of a field that the fullest physics sets otherwise."""


def _effects(model: Model) -> list[_Effect]:
    robot = model.robot
    clamps = sorted({f"{c * 1e3:.4g}" for c in model.budget_clamps})
    force = _tip_force(robot)
    return [
        _Effect(
            "straight_spans", "straight spans, not a continuous tendon", {"tendon": "straight"}
        ),
        _Effect("clamps", f"disks clamp {' / '.join(clamps)} mm", {"clamped": "budget"}),
        _Effect("shear_extension", "shear and extension", {"theory": "cosserat"}),
        _Effect("torsion", "torsion (the backbone may twist)", {"twist": True}),
        _Effect("gravity_upright", "gravity, upright", {"gravity": (0.0, 0.0, -GRAVITY)}),
        _Effect("gravity_hanging", "gravity, hanging", {"gravity": (0.0, 0.0, GRAVITY)}, True),
        _Effect(
            "gravity_horizontal",
            "gravity, horizontal",
            {"gravity": _times(model.towards, -GRAVITY)},
            True,
        ),
        _Effect(
            "tip_force", f"{force:g} N across the tip", {"tip_force": _times(model.across, force)}
        ),
        _Effect("E_minus_10", "E 10 % lower", {"stiffness": 0.9}),
        _Effect("E_plus_10", "E 10 % higher", {"stiffness": 1.1}, True),
    ]


def _tip_force(robot: Robot) -> float:
    """1 N for the study's robot; for another the round force that moves its tip as much, N."""
    compliance, beyond = 0.0, robot.length
    for segment, stiffness in zip(robot.segments, robot.bending_stiffness, strict=True):
        inner = beyond - segment.length
        compliance += (beyond**3 - inner**3) / (3.0 * float(stiffness))
        beyond = inner
    return round_down(_MAX_SIDEWAYS * robot.length / compliance)


def _without(physics: Physics, effect: _Effect) -> Physics:
    plain = Physics()
    return replace(physics, **{name: getattr(plain, name) for name in effect.on})


def _acts(model: Model, effect: _Effect) -> bool:
    """Whether the main sweep has the effect (of gravity: exactly this one)."""
    if effect.key == "clamps":
        return any(s.disks.clamped_length for s in model.robot.segments)
    return all(getattr(model.main, name) == value for name, value in effect.on.items())


def _changed(model: Model, effect: _Effect) -> Physics:
    """The physics of the main sweep with only this effect changed."""
    if _acts(model, effect):
        return _without(model.main, effect)
    return replace(model.main, **effect.on)


def _times(vector: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    # + 0.0: no negative zeros
    x, y, z = (v * factor + 0.0 for v in vector)
    return (x, y, z)


def _zero(value: float) -> float:
    return 0.0 if abs(value) < 1e-12 else value
