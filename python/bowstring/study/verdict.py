"""Verdict: validity limit of constant curvature at a tolerance, and its dominant cause.

Crossings of the tolerance are searched on a fine sweep and bisected. The cause is found by removing
each effect of the main sweep, one at a time, at the load in question.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.data.tip_errors import Comparison, known_max
from bowstring.display import short_repr
from bowstring.formatting import in_mm, in_newtons, in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.study.comparison import COMPARISONS, CORRECTED, MEANINGS, Case, Model
from bowstring.study.correction_polynomial import (
    TipPolynomial,
    tip_polynomials,
    without_closed_form,
)
from bowstring.study.error_budget import Budget
from bowstring.validity.contour import runs
from bowstring.validity.effects import DOMINANT, EFFECTS, Rods, acting, without

_FINE_POINTS: Final = 401  # loads of the fine sweep
_BISECTIONS: Final = 40
_WORTH_NAMING: Final = 0.1  # least share of the error of an effect that the text names


# -- what is computed --------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True)
class Share(Result):
    """Share of one effect in the error of constant curvature at one load of the main sweep."""

    effect: Annotated[str, Key()]
    """Key, such as ``"straight_spans"``."""
    label: Annotated[str, Key()]
    """Effect in words."""
    error_without: Annotated[float, Key("error_without_mm")]
    """Error with this effect removed, m; NaN without an equilibrium."""
    share: Annotated[float, Key("share_percent")]
    """(error - error_without) / error; effects interact, so shares need not add up to one; NaN
    without an equilibrium."""


@short_repr
@dataclass(frozen=True)
class Range(Result):
    """Where the error of a comparison is within the tolerance."""

    name: Annotated[str, Key()]
    """Name of the comparison, such as ``cc_from_force``."""
    valid_throughout: Annotated[bool, Key()]
    """Whether all loads have an error, and none is above the tolerance."""
    valid_to: Annotated[float | None, Key("valid_to_N")]
    """Validity limit, N: first crossing of the tolerance, or the last load solved; None if it
    never holds."""
    exceeded: Annotated[tuple[tuple[float, float], ...], Key("exceeded_N")]
    """Ranges of tension in which the error is above the tolerance, N."""
    undecided: Annotated[tuple[tuple[float, float], ...], Key("undecided_N")]
    """Ranges of tension without equilibrium or without an arc, N."""
    max_error: Annotated[float, Key("max_error_mm")]
    """Largest error on the fine sweep, m; NaN without any."""
    max_at: Annotated[float, Key("max_error_at_N")]
    """Tension of the largest error, N; 0 without any."""


@short_repr
@dataclass(frozen=True)
class Meaning(Range):
    """Verdict on constant curvature from lengths or from force."""

    shares_at: Annotated[float, Key("shares_at_N")]
    """Tension of the shares, N: the first crossing, else that of the largest error."""
    shares: Annotated[tuple[Share, ...], Key()]
    """Shares, largest first; empty if rod and constant curvature agree there."""
    corrected: Annotated[Range, Key()]
    """The same with the correction in closed form."""
    polynomial: TipPolynomial | None
    """The tip as a polynomial; None where the corrected arc in closed form holds farther, or the
    corrected arcs from lengths and from force both keep within the tolerance, and where no
    polynomial does."""
    polynomial_to: float | None
    """Tension of the sweep up to which the polynomial is fitted, N; None without one."""
    answer: Annotated[str, Key()]
    """Whether constant curvature is good enough, in one sentence."""
    text: Annotated[str, Key()]
    """Verdict in sentences."""

    @property
    def corrected_reaches_farther(self) -> bool:
        """Whether the correction raises the validity limit."""
        return (self.corrected.valid_to or 0.0) > (self.valid_to or 0.0)

    @property
    def corrected_serves(self) -> bool:
        """Whether the corrected arc holds farther than the polynomial."""
        return (self.polynomial_to or 0.0) < 0.999 * (self.corrected.valid_to or 0.0)

    @property
    def cause(self) -> Annotated[str | None, Key("dominant_cause")]:
        """Effect with more than half of the error at the load of the shares, also if the tolerance
        is never exceeded; None without such an effect."""
        return self.dominant_cause.effect if self.dominant_cause else None

    @property
    def cause_label(self) -> str:
        """Heading of the effect with the largest share, which is dominant above one half."""
        return "Dominant cause" if self.dominant_cause else "Largest contribution"

    @property
    def largest_contribution(self) -> Share | None:
        """Effect with the largest share of the error, if that is at least 10 %."""
        largest = self.shares[:1]
        return largest[0] if largest and largest[0].share >= _WORTH_NAMING else None

    @property
    def dominant_cause(self) -> Share | None:
        """Effect with more than half of the error, at the load `shares_at`."""
        largest = self.largest_contribution
        return largest if largest and largest.share > DOMINANT else None


@short_repr
@dataclass(frozen=True)
class Verdict(Result):
    """Verdict on constant curvature in plain words, with its numbers."""

    tolerance: Annotated[float, Key("tolerance_percent")]
    """Tolerated tip error as a share of the length."""
    tolerance_length: Annotated[float, Key("tolerance_mm")]
    """Tolerated tip error, m."""
    meanings: Annotated[tuple[Meaning, ...], Key()]
    """Verdicts from lengths and from force."""
    fine_tension: Floats
    """Tensions of the fine sweep (n,), N."""
    fine_error: dict[str, Floats]
    """Errors on the fine sweep, m."""
    text: Annotated[tuple[str, ...], Key()]
    """Verdict, corrections, variable curvature and effects outside the sweep in sentences."""


# -- running it --------------------------------------------------------------------------------


def judge(
    model: Model,
    tolerance: float,
    max_tension: float,
    comparisons: dict[str, Comparison],
    budget: Budget,
    on_shapes: Sequence[str] = (),
) -> Verdict:
    """Find the validity limit of constant curvature, its cause, and effects outside the sweep.

    Parameters
    ----------
    model : Model
    tolerance : float
        Tolerated tip error as a share of the robot's length.
    max_tension : float
        End of the sweep, N; the search uses a finer sweep than the study.
    comparisons : dict
        Comparisons of the study by name, for the sentence on corrections.
    budget : Budget
        Error budget, for the sentence on effects outside the sweep.
    on_shapes : sequence of str
        Sentences on curvature that varies along the robot.
    """
    fine = np.linspace(0.0, max_tension, _FINE_POINTS)
    case_tension = np.linspace(0.0, max_tension, len(budget.sweep.tip_position))
    case = model.case(model.main, fine, tuple(COMPARISONS))
    meanings = tuple(_meaning(model, name, case, fine, tolerance) for name in MEANINGS)
    closed = not without_closed_form(model.robot)
    if not closed or not all(m.corrected.valid_throughout for m in meanings):
        of = model.robot.tendons.segment
        load = float(np.bincount(of, np.abs(model.shares)).max())  # of the fullest segment
        fits = tip_polynomials(model, load * max_tension, tolerance * model.length)
        fitted = (
            replace(m, polynomial=fit, polynomial_to=fit.top / load) if fit else m
            for m, fit in zip(meanings, fits, strict=True)
        )
        meanings = tuple(
            m if closed and by_fit.corrected_serves else by_fit
            for m, by_fit in zip(meanings, fitted, strict=True)
        )
    meanings = tuple(replace(m, answer=_answer(m, max_tension)) for m in meanings)
    return Verdict(
        tolerance=tolerance,
        tolerance_length=tolerance * model.length,
        meanings=meanings,
        fine_tension=fine,
        fine_error={name: case.error(name) for name in MEANINGS},
        text=(
            *(m.text for m in meanings),
            *_on_coupled(model, meanings),
            *_on_corrections(comparisons),
            *on_shapes,
            *_on_left_out(budget),
            *budget.actuation.text,
            *_on_friction(budget, case_tension, tolerance, model.length),
        ),
    )


def _range(model: Model, name: str, case: Case, tension: Floats, limit: float) -> Range:
    """Search where the error of a comparison is at most `limit`, m."""
    error = case.error(name)
    known = np.isfinite(error)
    above = known & (np.nan_to_num(error) > limit)

    def crossing(i: int, j: int) -> float:
        """Bisect the crossing between the neighbouring loads i (not above) and j (above)."""
        low, high = float(tension[i]), float(tension[j])
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            value = _error_at(model, name, middle, model.main)
            if not math.isfinite(value):
                break
            low, high = (low, middle) if value > limit else (middle, high)
        return high

    exceeded = []
    for i, j in runs(above):
        start = crossing(i - 1, i) if i > 0 and known[i - 1] else float(tension[i])
        more = j + 1 < len(tension) and known[j + 1]
        exceeded.append((start, crossing(j + 1, j) if more else float(tension[j])))
    undecided = tuple((float(tension[i]), float(tension[j])) for i, j in runs(~known))

    valid_to: float | None = None
    if known[0] and not above[0]:
        gaps = [a for a, _ in exceeded] + [float(tension[i - 1]) for i, _ in runs(~known) if i]
        valid_to = min([*gaps, float(tension[-1])])
    return Range(
        name=name,
        valid_throughout=not exceeded and not undecided,
        valid_to=valid_to,
        exceeded=tuple(exceeded),
        undecided=undecided,
        max_error=known_max(error),
        max_at=float(tension[int(np.argmax(np.where(known, error, -1.0)))]),
    )


def _meaning(model: Model, name: str, case: Case, tension: Floats, tolerance: float) -> Meaning:
    limit = tolerance * model.length
    found = _range(model, name, case, tension, limit)
    error = case.error(name)
    known = np.isfinite(error)
    shares_at = found.exceeded[0][0] if found.exceeded else found.max_at
    meaning = Meaning(
        **vars(found),
        shares_at=shares_at,
        shares=shares_of(model, name, shares_at) if known.any() else (),
        corrected=_range(model, CORRECTED[name], case, tension, limit),
        polynomial=None,
        polynomial_to=None,
        answer="",
        text="",
    )
    solved = np.all(np.isfinite(case.tip_position), axis=-1)
    reasons = (
        (~known & ~solved, "no stable equilibrium was found"),
        (~known & solved, "constant curvature has no arc there"),
    )
    without = []
    for where, why in reasons:
        if ranges := [in_newtons(float(tension[i]), float(tension[j])) for i, j in runs(where)]:
            without.append(f"{listed(ranges)} ({why})")
    text = _in_words(meaning, tolerance, model.length, tension[-1], without)
    return replace(meaning, text=text)


def _error_at(model: Model, name: str, tension: float, rods: Rods) -> float:
    """Error of constant curvature at one load, m."""
    return float(model.case(rods, np.array([tension]), (name,)).error(name)[0])


def shares_of(model: Model, name: str, tension: float) -> tuple[Share, ...]:
    """Remove each effect that acts in the main sweep, one at a time, at one load.

    Parameters
    ----------
    model : Model
    name : str
        Name of the comparison, one of `bowstring.study.comparison.MEANINGS`.
    tension : float
        Load of the main sweep, N.

    Returns
    -------
    tuple of Share
        Largest share first; empty if rod and constant curvature agree.
    """
    whole = _error_at(model, name, tension, model.main)
    if not whole > 1e-9 * model.length:
        return ()
    out = []
    for key in acting(model.main):
        rest = _error_at(model, name, tension, without(model.main, key))
        if math.isfinite(rest):
            label = EFFECTS[key].label + " as in the file" * (key == "gravity")
            out.append(Share(key, label, rest, (whole - rest) / whole))
    return tuple(sorted(out, key=lambda s: -s.share))


# -- in words ----------------------------------------------------------------------------------


def _answer(m: Meaning, top: float) -> str:
    """Whether constant curvature is good enough, in one sentence."""
    source = {"cc_from_lengths": "From true tendon lengths", "cc_from_force": "From force"}[m.name]
    if not math.isfinite(m.max_error):
        return f"{source}: unknown, because constant curvature gives no arc at any load."
    only = "only " if m.valid_to and m.exceeded else ""
    words = f"{source}: {only}{how_far(m, top)}"
    if not m.exceeded:
        return f"{words}."
    cause = m.largest_contribution
    if cause is not None:
        part = "because it ignores" if m.dominant_cause else "in part because it ignores"
        named = [s for s in m.shares if s.share > 0.5 * cause.share]
        words += f", {part} {listed([f'that {EFFECTS[s.effect].because}' for s in named])}"
    fit, end = m.polynomial, m.polynomial_to or 0.0
    if fit is not None and not m.corrected_serves:
        if end > (m.valid_to or 0.0):
            error = in_mm(fit.max_error)
            yes = "yes, " if math.isclose(end, top) else ""
            words += f"; by a polynomial: {yes}up to {significant(end)} N (largest error {error})"
    elif m.corrected_reaches_farther:
        words += f"; corrected: {how_far(m.corrected, top)}"
    elif not m.corrected.undecided and m.corrected.max_error < 0.9 * m.max_error:
        words += f"; corrected, the largest error is {in_mm(m.corrected.max_error)}"
    return f"{words}."


def how_far(found: Range, top: float) -> str:
    """Say up to which load of a sweep to `top`, N, the error is within the tolerance."""
    if found.valid_throughout:
        return f"yes, up to {significant(top)} N (largest error {in_mm(found.max_error)})"
    if not found.valid_to and not found.exceeded:
        return "unknown: no comparison at the first loads"
    if not found.valid_to:
        return f"no (largest error {in_mm(found.max_error)} at {significant(found.max_at)} N)"
    beyond = "" if found.exceeded else ", with no comparison beyond"
    return f"up to {significant(found.valid_to)} N{beyond}"


def _in_words(
    m: Meaning, tolerance: float, length: float, max_tension: float, without: Sequence[str]
) -> str:
    percent = f"{in_percent(tolerance, 3)} of length ({in_mm(tolerance * length)})"
    top = f"{max_tension:.4g} N"
    source = {
        "cc_from_lengths": "From tendon lengths (Eq. 5 of Amouri 2019)",
        "cc_from_force": "From force through the linear law",
    }[m.name]
    if not math.isfinite(m.max_error):
        return (
            f"{source}, constant curvature gives no tip at any load: it needs tendons that end at "
            "each segment and lengths that an arc can have."
        )
    largest = (
        f"{in_mm(m.max_error)} ({in_percent(m.max_error / length)} of length) "
        f"at {significant(m.max_at)} N"
    )
    if m.valid_throughout:
        range_of = f"stays below {percent} over the sweep to {top}"
    elif not m.exceeded:
        range_of = f"stays below {percent} wherever it is compared"
    elif m.valid_to is None or m.valid_to == 0.0:
        range_of = f"is above {percent} from the first load"
    else:
        range_of = f"stays below {percent} up to {significant(m.valid_to)} N"
    words = f"{source}, the error of constant curvature {range_of}; the largest is {largest}."
    if m.exceeded:
        ranges = listed([f"{significant(a)} to {significant(b)} N" for a, b in m.exceeded])
        words += f" It is above from {ranges}."
    if m.undecided:
        words += f" No comparison is possible at {listed(without)}."
    words += _cause_in_words(m)
    return words


def _cause_in_words(m: Meaning) -> str:
    where = f"at {significant(m.shares_at)} N"
    if not m.shares:
        return " There the two agree."
    worst = m.shares[0]
    if worst.share <= 0.0:
        return (
            f" No effect of this sweep is to blame alone {where}: removing any one "
            "of them leaves the error as large or larger."
        )
    if worst.share < _WORTH_NAMING:
        return (
            f" No single effect of this sweep explains it {where}: without {worst.label}, which "
            f"has the largest share, the error would still be {in_mm(worst.error_without)}."
        )
    rest = f"without this effect the error {where} would be {in_mm(worst.error_without)}"
    words = f" {m.cause_label}: {worst.label}; {rest}."
    rivals = [s.label for s in m.shares[1:] if s.share > 0.5 * worst.share]
    if rivals:
        words += f" Nearly as much: {listed(rivals)} (effects interact, shares need not add up)."
    return words


@short_repr
@dataclass(frozen=True)
class Correction:
    """A correction in closed form: means over the loads that have a tip with and without it."""

    name: str
    """Name of the comparison that it corrects."""
    what: str
    """Correction in words."""
    source: str
    """Input of constant curvature: ``"from lengths"`` or ``"from force"``."""
    before: float
    """Mean error without it, m."""
    after: float
    """Mean error with it, m."""
    n: int
    """Number of these loads."""


def corrections(comparisons: Mapping[str, Comparison]) -> list[Correction]:
    """Corrections in closed form whose errors have loads in common with those they correct.

    Parameters
    ----------
    comparisons : mapping
        Against statics, by name.
    """
    out = []
    for what, source, name in (
        ("chords instead of arcs", "from lengths", "cc_from_lengths"),
        ("the mean lever arm", "from force", "cc_from_force"),
    ):
        errors = np.array([comparisons[name].error, comparisons[CORRECTED[name]].error])
        both = errors[:, np.isfinite(errors).all(axis=0)]
        if both.size:
            before, after = both.mean(axis=1).tolist()
            out.append(Correction(name, what, source, before, after, both.shape[1]))
    return out


def _on_coupled(model: Model, meanings: Sequence[Meaning]) -> list[str]:
    if not model.robot.is_coupled or all(m.dominant_cause for m in meanings if m.shares):
        return []
    return [
        "Where no effect dominates, it may be that tendons run straight between the disks: beside "
        "coupled strains of the backbone this effect is not examined."
    ]


def _on_corrections(comparisons: dict[str, Comparison]) -> list[str]:
    parts = []
    loads = len(comparisons["cc_from_force"].error)
    for c in corrections(comparisons):
        was, now = in_mm(c.before), in_mm(c.after)
        over = "" if c.n == loads else f" (over {c.n} of {loads} loads)"
        if was == now:
            parts.append(f"{c.what}, {c.source}: the mean error stays at {now}{over}")
        else:
            change = "lower" if c.after < c.before else "raise"
            parts.append(
                f"{c.what}, {c.source}, {change}s the mean error from {was} to {now}{over}"
            )
    return [f"Corrections in closed form: {'; '.join(parts)}."] if parts else []


def _on_friction(budget: Budget, tension: Floats, tolerance: float, length: float) -> list[str]:
    """Loads at which the file's own friction, outside the main sweep, violates the tolerance."""
    if budget.actuation.friction_assumed:
        return []
    parts = []
    for meaning, words in zip(MEANINGS, ("from lengths", "from force"), strict=True):
        for way in ("loading", "unloading"):
            error = budget.actuation.row(f"friction_{way}").case.error(meaning)
            if not np.isfinite(error).any():
                continue
            above = tension[np.nan_to_num(error) > tolerance * length]
            where = "nowhere"
            if above.size:
                where = f"at {above.size} loads, {in_newtons(float(above[0]), float(above[-1]))}"
            parts.append(f"{words}, {way}: {where}")
    if not parts:
        return []
    calibrated = budget.actuation.friction_origin == "calibrated"
    whose = "the calibrated one" if calibrated else "that of the file"
    return [
        f"The ranges above are without friction. With {whose}, {budget.actuation.friction:.4g}, "
        f"the error is above {in_percent(tolerance, 3)} of length at these of the sweep's "
        f"{len(tension)} loads: {'; '.join(parts)}."
    ]


def _on_left_out(budget: Budget) -> list[str]:
    """Effect outside the main sweep with the largest contribution in the error budget."""
    found: dict[str, list[str]] = {}
    partly = []
    for meaning, words in zip(MEANINGS, ("from lengths", "from force"), strict=True):
        rows, missing = budget.left_out(meaning)
        if rows:
            more, mean, label = max(rows)
            change = "raises the mean error" if more > 0.0 else "lowers the mean error"
            parts = found.setdefault(label, [])
            change = "" if parts and parts[0].startswith(change) else f"{change} "
            parts.append(f"{change}{words} by {in_mm(abs(more))} to {in_mm(mean)}")
        if missing:
            partly.append(f"{words}: {'; '.join(missing)}")
    if not found:
        return []
    text = (
        "A real robot has effects that this sweep leaves out. Of those in the budget, each added "
        f"alone to this sweep, the largest {'is' if len(found) == 1 else 'are'}: "
        f"{listed([f'{label}, which {listed(parts)}' for label, parts in found.items()])}."
    )
    if partly:
        text += (
            " Not compared, because they have numbers at some of the loads only or at none: "
            f"{' / '.join(partly)}."
        )
    return [text]
