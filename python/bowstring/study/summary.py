"""The verdict as an engineer would report it: one table and a few sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from bowstring.display import short_repr
from bowstring.formatting import in_mm, in_percent, listed, significant
from bowstring.study.comparison import MEANINGS
from bowstring.study.study import Study
from bowstring.study.verdict import Meaning

__all__ = ["COLUMNS", "Summary", "summarise"]

COLUMNS: Final = ("constant curvature from", "holds to", "mean error", "largest error", "at")
"""Of the table, without the dominant cause."""

_INPUTS: Final = {
    "cc_from_lengths": "tendon lengths",
    "cc_from_force": "force (linear law)",
}


@short_repr
@dataclass(frozen=True)
class Summary:
    """What a reader needs first; all of it stands in the report with its derivation."""

    title: str
    rows: tuple[tuple[str, ...], ...]
    """By `COLUMNS`, one for each meaning of constant curvature."""
    findings: tuple[tuple[str, str], ...]
    """A heading and a sentence each."""


def summarise(study: Study) -> Summary:
    """Take the verdict's main numbers from a study."""
    verdict, robot = study.verdict, study.robot
    data = "simulated" if study.data is None else f"simulated, and {study.data.label}"
    tolerance = f"{in_percent(verdict.tolerance, 3)} of length, {in_mm(verdict.tolerance_length)}"
    return Summary(
        title=(
            f"{robot.name}: {study.length * 1e3:g} mm, {study.settings.pulled} to "
            f"{study.settings.max_tension:g} N, tolerance {tolerance} ({data})"
        ),
        rows=tuple(_row(study, meaning) for meaning in verdict.meanings),
        findings=tuple(_findings(study)),
    )


def _row(study: Study, meaning: Meaning) -> tuple[str, ...]:
    if not math.isfinite(meaning.max_error):
        return _INPUTS[meaning.name], "no arc", "", "", ""
    top = study.settings.max_tension
    if meaning.holds_throughout:
        holds = f"{top:g} N (all)"
    elif not meaning.holds_to:
        holds = "no load"
    else:
        holds = f"{significant(meaning.holds_to)} N"
    error = f"{in_mm(meaning.max_error)} ({in_percent(meaning.max_error / study.length)})"
    mean = in_mm(study.comparison(meaning.name, "statics").mean)
    return _INPUTS[meaning.name], holds, mean, error, f"{significant(meaning.max_at)} N"


def _findings(study: Study) -> Iterator[tuple[str, str]]:
    causes: dict[str, list[str]] = {}
    for meaning in study.verdict.meanings:
        label = meaning.ended_by.label if meaning.ended_by else "no single effect"
        causes.setdefault(label, []).append(_INPUTS[meaning.name].split(" (")[0])
    yield "Dominant cause", "; ".join(f"from {listed(v)}: {k}" for k, v in causes.items())
    corrections = [
        f"{what}: {in_mm(now.mean)} in the mean"
        for name, what in (
            ("cc_from_lengths_chord", "chords instead of arcs, from lengths"),
            ("cc_from_force_arm", "mean lever arm, from force"),
        )
        if (now := study.comparison(name, "statics")).mean
        < study.comparison(name.rsplit("_", 1)[0], "statics").mean
    ]
    yield "Correction in closed form", "; ".join(corrections) or "none lowers the mean error"
    yield from _largest_effect(study)
    yield from _actuation(study)
    if study.limits_text:
        yield "Backbone", study.limits_text[0].rstrip(".")
    if study.dynamics is not None and math.isfinite(study.dynamics.max_difference[0]):
        largest, at = study.dynamics.max_difference
        yield (
            "Dynamics",
            f"rise in {significant(study.dynamics.rise)} s: the tip is {in_mm(largest)} from "
            f"statics at most, at {significant(at)} N",
        )


def _largest_effect(study: Study) -> Iterator[tuple[str, str]]:
    """The effect of the error budget, not in this sweep, that adds the largest mean error."""
    budget = study.budget
    found = []
    for row in budget.rows:
        if row.acts_in_sweep or (
            any(budget.sweep.physics.gravity) and row.effect.startswith("gravity")
        ):
            continue
        added = [budget.contribution(row, "in_sweep", name) for name in MEANINGS]
        if all(math.isfinite(each.with_effect) for each in added):
            found.append((max(each.mean for each in added), row.label, added))
    if found:
        _, label, (lengths, force) = max(found, key=lambda each: each[0])
        yield (
            "Largest effect not in this sweep",
            f"{label}: mean error {in_mm(lengths.with_effect)} from lengths, "
            f"{in_mm(force.with_effect)} from force",
        )


def _actuation(study: Study) -> Iterator[tuple[str, str]]:
    drive = study.budget.drive
    up, down, *stretches, _, _ = drive.rows
    parts = []
    if math.isfinite(up.moved) and math.isfinite(down.moved):
        assumed = " (assumed)" if drive.friction_assumed else ""
        parts.append(
            f"friction {drive.friction:.3g}{assumed} moves the tip by {in_mm(up.moved)} in "
            f"loading, {in_mm(down.moved)} in unloading"
        )
    for row in stretches:
        if math.isfinite(row.moved):
            assumed = " (assumed)" if drive.elasticity_assumed else ""
            parts.append(f"elastic tendons{assumed} by {in_mm(row.moved)} in the mean")
    if math.isfinite(drive.loops[0].width):
        loop = drive.loops[0]
        parts.append(f"hysteresis up to {in_mm(loop.width)} at {significant(loop.widest_at)} N")
    if parts:
        yield "Actuation", "; ".join(parts)
