"""Summary of a study: one table and a few sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.display import short_repr
from bowstring.formatting import in_mm, in_percent, listed, number, significant
from bowstring.robot.laws import MEMORIES
from bowstring.robot.model import Robot
from bowstring.study.actuation_budget import COMMANDED
from bowstring.study.comparison import MEANINGS
from bowstring.study.correction_polynomial import without_closed_form
from bowstring.study.load_map import load_text
from bowstring.study.study import Study
from bowstring.study.verdict import Meaning, corrections
from bowstring.validity.errors import LABELS

COLUMNS: Final = ("CC from", "valid to", "mean error", "mean, corrected", "largest error", "at")
"""Columns of the table; the corrected error is the mean with the correction in closed form."""

_FEWEST: Final = 3  # least loads of a mean; one of them is mostly without tension
_INPUTS: Final = {
    "cc_from_lengths": "tendon lengths",
    "cc_from_force": "force (linear law)",
}


@short_repr
@dataclass(frozen=True)
class Summary:
    """Main results; the report has their derivation."""

    title: str
    """Robot, length, actuated tendons, range of tension and tolerance in one line."""
    reference: str
    """What the tips are compared with, for the title of the table."""
    rows: tuple[tuple[str, ...], ...]
    """Rows in the order of `COLUMNS`, one from lengths and one from force."""
    answers: tuple[str, ...]
    """Whether constant curvature is good enough, a sentence from lengths and one from force."""
    findings: tuple[tuple[str, str], ...]
    """Headings and sentences."""


def summarise(study: Study) -> Summary:
    """Extract the main results from a study."""
    verdict, robot = study.verdict, study.robot
    tolerance = f"{in_mm(verdict.tolerance_length)} ({in_percent(verdict.tolerance, 3)} of length)"
    gravity = "in gravity" if any(robot.gravity) else "no gravity"
    return Summary(
        title=(
            f"{robot.name}: {study.length * 1e3:g} mm, {gravity}, {study.settings.judged} from 0 "
            f"to {study.settings.max_tension:g} N, tolerance {tolerance}"
        ),
        reference="Tip error of constant curvature (CC) against the rod model, simulated",
        rows=tuple(_row(study, meaning) for meaning in verdict.meanings),
        answers=tuple(meaning.answer for meaning in verdict.meanings),
        findings=tuple(_findings(study)),
    )


def _row(study: Study, meaning: Meaning) -> tuple[str, ...]:
    if not math.isfinite(meaning.max_error):
        return _INPUTS[meaning.name], "no arc", "", "", "", ""
    top = study.settings.max_tension
    if meaning.valid_throughout:
        holds = f"{top:g} N (all)"
    elif not meaning.valid_to:
        holds = "no load"
    elif not meaning.exceeded:
        holds = f"{significant(meaning.valid_to)} N, no comparison beyond"
    else:
        holds = f"{significant(meaning.valid_to)} N"
    error = f"{in_mm(meaning.max_error)} ({in_percent(meaning.max_error / study.length)})"
    known = study.comparison(meaning.name, "statics")
    mean = corrected = number(None)
    if _enough(study, known.n):
        mean = in_mm(known.mean)
        for c in corrections({c.name: c for c in study.against("statics")}):
            if (c.name, c.n) == (meaning.name, known.n):  # else the means are over other loads
                corrected = in_mm(c.after) if c.after < c.before else "not lower"
    at = f"{significant(meaning.max_at)} N"
    return _INPUTS[meaning.name], holds, mean, corrected, error, at


def _enough(study: Study, n: int) -> bool:
    """Whether the table has a mean over so many loads."""
    return n >= min(_FEWEST, len(study.statics.tension))


def _over(study: Study, n: int, before: str = "") -> str:
    """Number of loads of a mean in words; empty if they are all loads."""
    loads = len(study.statics.tension)
    return "" if n == loads else f"{before}{n} of {loads} loads"


def _findings(study: Study) -> Iterator[tuple[str, str]]:
    if study.without_equilibrium:
        yield "Left out", study.without_equilibrium.rstrip(".")
    for sentence in study.settings.earlier:
        yield "Other tendons", sentence
    yield from _correction(study)
    if study.spreads:
        how = "assumed; " if study.uncertainty_assumed else ""
        known = [s for s in study.spreads if np.isfinite(s.limit).any()] or study.spreads
        robots = f"{len(known[0].limit)} robots"
        limits = []
        for s in known:
            median = math.isfinite(s.limit_summary.quantiles[0.5].value)
            exact = "the limit is" if s.mostly_exceeded else "the median limit is"
            what = exact if median else "the limit is at least"
            limits.append(f"{LABELS[s.name]} {what} {s.limit_text}")
        scatter = f"with standard deviations of {study.uncertain_numbers} ({how}{robots})"
        yield "How sure", f"{scatter}, {'; '.join(limits)}"
    if study.load_map is not None:
        yield load_text(study.load_map)
    yield from _largest_effect(study)
    yield from _actuation(study)
    if study.limits_text:
        heading, _, found = study.limits_text[0].rstrip(".").partition(": ")
        yield heading, found
    if study.dynamics is not None and math.isfinite(study.dynamics.max_difference[0]):
        largest, _ = study.dynamics.max_difference
        yield (
            "Dynamics",
            f"with a rise of {significant(study.dynamics.rise)} s the tip stays within "
            f"{in_mm(largest)} of its equilibrium",
        )
    elif study.dynamics is None:
        yield "Dynamics", study.dynamics_text[0].rstrip(".")
    if study.bricks is not None and study.bricks.text:
        yield "Finite elements", study.bricks.text[0].rstrip(".")
    if study.measured is not None:
        yield "Measurements", " ".join(study.measured.text[:2]).rstrip(".")
    if study.data is not None and study.data.models_compared is not None:
        yield "Rows left out of the fits", study.data.models_compared.verdict.rstrip(".")


def _correction(study: Study) -> Iterator[tuple[str, str]]:
    """Formula of the correction with the numbers of the robot, or the call that has it."""
    for meaning in study.verdict.meanings:
        corrected, fit = meaning.corrected, meaning.polynomial
        if fit is not None:
            each = " in each segment" if len(study.robot.segments) > 1 else ""
            top = significant(fit.top)
            yield (
                f"Polynomial {LABELS[meaning.name]}",
                f"largest error {in_mm(fit.max_error)} for any tensions whose sum{each} is at "
                f"most {top} N; degree {fit.degree}, {len(fit.exponents)} terms; --correction "
                "python, c or matlab writes it as code",
            )
            if not meaning.corrected_serves:
                continue
        lower = corrected.max_error < 0.9 * meaning.max_error
        if not (meaning.corrected_reaches_farther or lower):
            continue
        from_force = meaning.name == "cc_from_force"
        formula = _formula(study.robot, from_force)
        if formula is None:
            law = ', "arm"' if from_force else ', "chord"'
            call = "from_tensions(robot, tensions" if from_force else "from_lengths(robot, lengths"
            formula = f"module by module: RobotArcs.{call}{law}) in Python"
            if fit is None and not without_closed_form(study.robot):
                formula += "; --correction python, c or matlab writes it as code"
        error = in_mm(corrected.max_error)
        if corrected.undecided:
            error += f", with no result beyond {significant(corrected.valid_to or 0.0)} N"
        yield f"Corrected {LABELS[meaning.name]}", f"{formula}; largest error then {error}"


def _formula(robot: Robot, from_force: bool) -> str | None:
    """Closed form for one segment of equal modules, theory Eq. 1.6 and 1.10."""
    disks, spacing = robot.disks, np.diff(robot.disks.station_m, prepend=0.0)
    radii, centre = robot.tendons.pitch_radius_m, robot.tension_centre_m
    thick = disks.clamped_length_m.any() or disks.hole_length_m.any()
    if len(robot.segments) > 1 or thick or np.ptp(spacing) > 1e-9 * robot.length:
        return None
    if not robot.is_parallel or np.ptp(radii) > 1e-9 * radii[0] or centre.any():
        return None
    n, radius = len(spacing), float(radii[0])
    if from_force:
        by_newton = robot.length / n / float(robot.bending_stiffness[0])
        linear, softer = radius * by_newton, robot.length / n * by_newton / 12.0
        return (
            f"for a tension F on one tendon, in N: u = {linear:.4g} F; v = 1 - {softer:.4g} F; "
            f"bend angle {2 * n} u/(v + sqrt(v^2 + u^2/2)) rad; arc length {in_mm(robot.length)}"
        )
    angles = np.sort(np.mod(robot.tendons.angle_rad, math.tau))
    if len(angles) != 3 or np.ptp(np.diff(angles, append=angles[0] + math.tau)) > 1e-9:
        return None
    return (
        "for tendon lengths l1, l2, l3: q = l1^2 + l2^2 + l3^2 - l1 l2 - l2 l3 - l1 l3; "
        f"a = 2 asin(sqrt(q)/({in_mm(3 * n * radius)})) rad; bend angle {n} a; arc length "
        "(l1 + l2 + l3) a/(6 sin(a/2))"
    )


def _largest_effect(study: Study) -> Iterator[tuple[str, str]]:
    """Effect outside the sweep with the largest contribution to the mean error."""
    parts: dict[str, list[str]] = {}
    for name, words in zip(MEANINGS, ("from lengths", "from force"), strict=True):
        found, _ = study.budget.left_out(name)
        n = study.comparison(name).n
        if found and _enough(study, n):
            _, mean, label = max(found)
            over = _over(study, n, " over ")
            parts.setdefault(label, []).append(f"{in_mm(mean)} {words}{over}")
    for label, means in parts.items():
        yield "Largest effect left out", f"{label}; with it the mean error is {listed(means)}"


def _actuation(study: Study) -> Iterator[tuple[str, str]]:
    if study.robot.tendons.pushes.any():  # the assumed friction and cables are those of tendons
        return
    actuation = study.budget.actuation
    of_memories = tuple(key for key in MEMORIES if key != "friction")
    rows = [row for row in actuation.rows if not row.effect.startswith(of_memories)]
    up, down, *elastic, _, _ = rows
    parts = []
    if _enough(study, min(up.moved_n, down.moved_n)):
        loaded, released = (_over(study, row.moved_n, ", ") for row in (up, down))
        parts.append(
            f"moves the tip on average by {in_mm(up.moved)} (loading{loaded}), by "
            f"{in_mm(down.moved)} (unloading{released})"
        )
    loop = actuation.loops[0]
    if _enough(study, int(np.isfinite(loop.apart).sum())):
        at = significant(loop.widest_at)
        parts.append(f"loading and unloading differ most, by {in_mm(loop.width)}, at {at} N")
    assumed = " (assumed)" if actuation.friction_assumed else ""
    if parts:
        yield f"Friction {actuation.friction:.3g}{assumed}", "; ".join(parts)
    assumed = " (assumed)" if actuation.elasticity_assumed else ""
    for row in elastic:
        if _enough(study, row.moved_n):
            over = _over(study, row.moved_n, ", over ")
            moved = (
                "at equal motor positions, stretch moves the tip by "
                f"{in_mm(row.moved)} on average{over}"
            )
            commanded = row.case.comparisons[COMMANDED].mean
            if math.isfinite(commanded):
                moved += f"; constant curvature from these errs by {in_mm(commanded)} on average"
            yield f"Elastic tendons{assumed}", moved
