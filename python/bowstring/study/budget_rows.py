"""JSON of the rows of a study's error budgets."""

from __future__ import annotations

from typing import Annotated, Literal

from bowstring.results import Object, OrNull, about


class CaseError(Object):
    """Tip error of constant curvature under one set of physical assumptions."""

    n: Annotated[int, about("Number of loads.")]
    mean_mm: Annotated[OrNull, about("Mean error.")]
    max_mm: Annotated[OrNull, about("Largest error.")]
    mean_percent: Annotated[OrNull, about("Mean error in percent of the length.")]


class Problem(Object):
    """Reason for missing numbers."""

    problem: Annotated[
        str | None, about("Why numbers are missing, at some loads or all; `null` if none are.")
    ]


class Case(Problem):
    """Constant curvature under one set of physical assumptions."""

    cc_from_lengths: Annotated[CaseError, about("From tendon lengths.")]
    cc_from_force: Annotated[CaseError, about("From force.")]


class Description(Object):
    """Physical assumptions."""

    description: Annotated[str, about("The assumptions in words.")]


class DescribedCase(Case, Description):
    """Constant curvature under one set of physical assumptions that are described."""


class ContributionError(CaseError):
    """Tip error, and the contribution of an effect to it."""

    contribution_n: Annotated[
        int, about("Number of loads with an equilibrium both with and without the effect.")
    ]
    contribution_mm: Annotated[
        OrNull,
        about(
            "Mean error with the effect less mean error without it, over these loads; positive if "
            "the effect increases the error."
        ),
    ]
    contribution_percent: Annotated[OrNull, about("Contribution in percent of the length.")]


class TipMoved(Object):
    """Motion of the tip of the full physics by an effect."""

    tip_moved_mean_mm: Annotated[OrNull, about("Mean distance by which the effect moves the tip.")]
    tip_moved_max_mm: Annotated[OrNull, about("Largest distance.")]


class EffectCase(Problem, TipMoved):
    """An effect added or removed."""

    cc_from_lengths: Annotated[ContributionError, about("From tendon lengths.")]
    cc_from_force: Annotated[ContributionError, about("From force.")]


class SweepEffectCase(EffectCase):
    """An effect changed in the sweep."""

    how: Annotated[Literal["added", "removed"], about("Removed if it acts there, else added.")]


class BudgetRow(Object):
    """Row of the error budget."""

    effect: Annotated[str, about("Name of the effect.")]
    label: Annotated[str, about("The effect in words.")]
    added: Annotated[EffectCase, about("The effect alone added to the baseline.")]
    full: Annotated[Case, about("The full model with the effect (of alternatives, with this one).")]
    removed: Annotated[EffectCase, about("The effect alone removed from the full model.")]
    in_sweep: Annotated[SweepEffectCase, about("The effect alone changed in the sweep.")]


# -- error budget of actuation ---------------------------------------------------------------------


class ChangeError(CaseError):
    """Tip error, and its change by an effect of actuation."""

    change_n: Annotated[int, about("Number of loads with and without the effect.")]
    change_of_mean_mm: Annotated[OrNull, about("Change of the mean error over these loads.")]
    change_of_mean_percent: Annotated[OrNull, about("Change in percent of the length.")]


class ActuationEffect(Problem, TipMoved):
    """An effect of actuation, relative to the same commands without it."""

    effect: Annotated[str, about("Name of the effect.")]
    label: Annotated[str, about("The effect in words.")]
    assumed: Annotated[
        list[Literal["friction", "elasticity"]], about("Properties not in the robot file.")
    ]
    more_than_constant_curvature: Annotated[
        bool,
        about(
            "Whether the effect moves the tip by more than the error of constant curvature without "
            "it, in the means."
        ),
    ]


class TensionEffect(ActuationEffect):
    """Row of the budget under tension control."""

    control: Annotated[Literal["tension"], about("Actuation.")]
    cc_from_lengths: Annotated[ChangeError, about("From tendon lengths.")]
    cc_from_force: Annotated[ChangeError, about("From force.")]


class DisplacementEffect(ActuationEffect):
    """Row of the budget under displacement control."""

    control: Annotated[Literal["displacement"], about("Actuation.")]
    cc_from_commanded_lengths: Annotated[ChangeError, about("From the commanded lengths.")]


class CommandedCase(Problem, Description):
    """Constant curvature under displacement control."""

    cc_from_commanded_lengths: Annotated[CaseError, about("From the commanded lengths.")]


ActuationRow = TensionEffect | DisplacementEffect
