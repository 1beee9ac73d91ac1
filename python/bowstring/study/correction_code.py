"""Corrected constant curvature of a robot as code to paste: Python, C and MATLAB.

From lengths and from tensions each, the code has the robot's numbers and the closed form of theory
Eq. 1.5 to 1.11, or where that does not serve the polynomial of
`bowstring.study.correction_polynomial`; it needs no library.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.formatting import in_mm, significant
from bowstring.robot.model import Robot
from bowstring.study.correction_polynomial import MOST_TERMS, bend_fit, without_closed_form
from bowstring.study.verdict import how_far
from bowstring.validation import choice

if TYPE_CHECKING:
    from bowstring.study.study import Study

Language = Literal["python", "c", "matlab"]

FILES: Final = {"python": "correction.py", "c": "correction.c", "matlab": "correction.m"}
"""Names of the files by language."""

_WIDTH: Final = 100  # columns of the sentences


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
        A module of functions ``tip_from_tensions`` and ``tip_from_lengths``, each by corrected arcs
        or by a polynomial, whichever the verdict prefers; in MATLAB a class of these static
        methods. Units are SI; tips are in the base frame.

    Raises
    ------
    InputError
        If the language is not known, or the robot has neither a closed form nor a polynomial.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    choice("correction", language, tuple(FILES))
    robot, why = study.model.robot, without_closed_form(study.model.robot)
    neither = f"{why}, and no polynomial of at most {MOST_TERMS} terms keeps within the tolerance"
    fits = zip(("lengths", "tensions"), study.verdict.meanings, strict=True)
    given = {name: m.polynomial for name, m in fits if m.polynomial or not why}
    if not given:
        raise InputError(
            f"{robot.name} has no correction in closed form, because {neither}; give a smaller "
            "largest tension, or compile the rod itself by bowstring export"
        )
    environment = Environment(
        loader=PackageLoader("bowstring.study", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["n"] = lambda value: repr(float(value))
    ending = FILES[language].rpartition(".")[2]
    return environment.get_template(f"correction.{ending}.j2").render(
        robot=robot,
        tendons=len(robot.tendons.segment),
        given=given,
        segments=_segments(robot) if None in given.values() else [],
        said=[line for each in _said(study, neither) for line in textwrap.wrap(each, _WIDTH)],
    )


def _said(study: Study, neither: str) -> Iterator[str]:
    """Range and error of each correction in sentences."""
    robot, verdict = study.robot, study.verdict
    each = " of each segment" if len(robot.segments) > 1 else ""
    signs = " (chambers push, rods do both)" if robot.tendons.pushes.any() else ""
    gravity = ", ".join(f"{g:.4g}" for g in robot.gravity)
    yield (
        "Written by Bowstring. SI units; base frame, z along the straight backbone; without "
        "friction and tip loads. Errors are against the rod model."
    )
    for source, m in zip(("From lengths", "From tensions"), verdict.meanings, strict=True):
        if fit := m.polynomial:
            yield (
                f"{source}: polynomial of degree {fit.degree} ({len(fit.exponents)} terms), fitted "
                f"in gravity ({gravity}) m/s^2. Range: any tensions{signs} whose sum in the "
                f"tendons{each} is at most {significant(fit.top)} N, and the lengths that they "
                f"give. Largest error at random loads that are not in the fit: "
                f"{in_mm(fit.max_error)}."
            )
            if fit.solved < 1.0:
                yield f"{1.0 - fit.solved:.1%} of them have no equilibrium and are not covered."
        elif without_closed_form(robot):
            yield f"{source}: no correction, because {neither}."
        else:
            top = study.settings.max_tension
            farther = (m.valid_to or 0.0) > (m.corrected.valid_to or 0.0)
            plain = f"; without the correction: {how_far(m, top)}" if farther else ""
            yield (
                f"{source}: constant curvature, corrected: tendons run straight between the disks, "
                f"clamped lengths stay straight; without gravity. Error within "
                f"{in_mm(verdict.tolerance_length)} with {study.settings.actuated}: "
                f"{how_far(m.corrected, top)}{plain}."
            )


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
