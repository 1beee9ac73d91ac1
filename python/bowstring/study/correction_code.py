"""Corrected constant curvature of a robot as code to paste: Python, C and MATLAB.

The code has the robot's numbers and the closed forms of theory Eq. 1.5 to 1.11, or where these do
not serve the polynomials of `bowstring.study.correction_polynomial`; it needs no library.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError
from bowstring.formatting import in_mm, significant
from bowstring.robot.model import Robot
from bowstring.study.correction_polynomial import MOST_TERMS, bend_fit, without_closed_form
from bowstring.validation import choice

if TYPE_CHECKING:
    from bowstring.study.study import Study

__all__ = ["FILES", "Language", "correction_code"]

Floats = NDArray[np.float64]
Language = Literal["python", "c", "matlab"]

FILES: Final = {"python": "correction.py", "c": "correction.c", "matlab": "correction.m"}
"""Names of the files by language."""


@dataclass(frozen=True)
class _Segment:
    """Numbers of one segment, SI."""

    first: int
    """Index of the first tendon anchored to its end disk; it and all later ones pass."""
    own: int
    """Number of tendons anchored to its end disk."""
    stiffness: float
    holes: Floats
    """Holes (H, 2) of the tendons from `first` on."""
    fit: Floats
    """Mean length and bend vector (3, own) from the lengths of its own tendons."""
    in_holes: float
    flexible: Floats
    clamps: Floats
    """Clamped lengths (n, 2) at the ends of each module."""
    excess: Floats
    skew: Floats
    bow: Floats


def correction_code(study: Study, language: Language) -> str:
    """Write the corrected constant curvature of a study's robot as code.

    Parameters
    ----------
    study : Study
        Its robot, and the largest errors that the code states.
    language : {"python", "c", "matlab"}

    Returns
    -------
    str
        A module of functions ``tip_from_tensions`` and ``tip_from_lengths``; in MATLAB a class of
        these static methods. Units are SI; tips are in the base frame.

    Raises
    ------
    InputError
        If the language is not known, or the robot has neither a closed form nor a polynomial.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    choice("correction", language, tuple(FILES))
    robot, polynomials = study.model.robot, study.verdict.polynomials
    environment = Environment(
        loader=PackageLoader("bowstring.study", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["n"] = lambda value: repr(float(value))
    ending = FILES[language].rpartition(".")[2]
    shared = {"robot": robot, "tendons": len(robot.tendons.segment)}
    if polynomials:
        return environment.get_template(f"polynomial.{ending}.j2").render(
            **shared,
            polynomials=[
                {"name": name, "fit": fit}
                for name, fit in zip(("lengths", "tensions"), polynomials, strict=True)
            ],
            said=_on_polynomials(study),
        )
    if why := without_closed_form(robot):
        raise InputError(
            f"{robot.name} has no correction in closed form, because {why}, and no polynomial of "
            f"at most {MOST_TERMS} terms keeps within the tolerance; give a smaller largest "
            "tension, or compile the rod itself by bowstring export"
        )
    segments = _segments(robot)
    said = [
        f"{source} {in_mm(meaning.corrected.max_error)}"
        for source, meaning in zip(
            ("from lengths", "from force"), study.verdict.meanings, strict=True
        )
    ]
    return environment.get_template(f"correction.{ending}.j2").render(
        **shared,
        segments=segments,
        most=max(len(s.flexible) for s in segments),
        said="; ".join(said),
        swept=f"{study.settings.actuated}, 0 to {significant(study.settings.max_tension)} N",
    )


def _on_polynomials(study: Study) -> list[str]:
    """Range and errors in sentences."""
    robot, fits = study.robot, study.verdict.polynomials
    each = " of each segment" if len(robot.segments) > 1 else ""
    signs = " (chambers push, rods do both)" if robot.tendons.pushes.any() else ""
    gravity = ", ".join(f"{g:.4g}" for g in robot.gravity)
    lines = [
        f"Gravity: {gravity} m/s^2.",
        f"Range: any tensions{signs} whose sum in the tendons{each} is at most",
        "that named here, and the lengths that they give. Largest error against the rod at random",
        "loads that are not in the fit:",
    ]
    lines += [
        f"{source}, sum {significant(fit.top)} N: {in_mm(fit.max_error)} (degree {fit.degree}, "
        f"{len(fit.exponents)} terms)"
        for source, fit in zip(("from lengths", "from tensions"), fits, strict=True)
    ]
    solved = min(fit.solved for fit in fits)
    if solved < 1.0:
        lines.append(f"{1.0 - solved:.1%} of these loads have no equilibrium and are not covered.")
    return lines


def _segments(robot: Robot) -> list[_Segment]:
    disks, of = robot.disks, robot.tendons.segment
    clamped, guided = disks.clamped_length_m / 2.0, disks.hole_length_m / 2.0
    clamps = np.stack([np.append(0.0, clamped[:-1]), clamped], axis=1)
    guides = np.stack([np.append(0.0, guided[:-1]), guided], axis=1)
    spacing = np.diff(disks.station_m, prepend=0.0)
    flexible = spacing - clamps.sum(axis=1)
    beyond = clamps - guides
    excess = beyond.sum(axis=1)
    skew = (beyond[:, 1] - beyond[:, 0]) ** 2 / (2.0 * (flexible + excess))
    bow = flexible / 12.0 + excess / 4.0 - skew / 2.0
    out = []
    for k in range(len(robot.segments)):
        here, first, own = disks.segment == k, int(np.sum(of < k)), int(np.sum(of == k))
        holes = robot.tendons.mean_hole_m[k, first:]
        out.append(
            _Segment(
                first,
                own,
                float(robot.bending_stiffness[k]),
                holes,
                bend_fit(holes[:own]),
                float(guides[here].sum()),
                *(each[here] for each in (flexible, clamps, excess, skew, bow)),
            )
        )
    return out
