"""Corrected constant curvature of a robot as code to paste: Python, C and MATLAB.

The code has the robot's numbers and the closed forms of theory Eq. 1.5 to 1.11; it needs no
library.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError
from bowstring.formatting import in_mm, significant
from bowstring.robot.model import Robot
from bowstring.validation import choice

if TYPE_CHECKING:
    from bowstring.study.study import Study

__all__ = ["FILES", "Language", "check_correction", "correction_code", "without_code"]

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


def check_correction(robot: Robot, language: str) -> None:
    """Refuse a language that is not known, and robots without a closed form.

    Raises
    ------
    InputError
    """
    choice("correction", language, tuple(FILES))
    if why := without_code(robot):
        raise InputError(
            f"there is no correction in closed form: the backbone of {robot.name} {why}"
        )


def without_code(robot: Robot) -> str:
    """What the backbone of a robot does that has no closed form; empty if it has one."""
    if robot.rest_curvature.any():
        return "is bent without load"
    if not robot.bends_alike or robot.tension_centre_m.any():
        return "does not bend alike about all axes"
    if not all(_gives_length(robot, k) for k in range(len(robot.segments))):
        return "has a segment with too few tendons to determine its length and bend"
    return ""


def _gives_length(robot: Robot, segment: int) -> bool:
    """Whether the lengths of a segment's own tendons give the length of its arc."""
    holes = robot.tendons.mean_hole_m[segment, robot.tendons.segment == segment]
    size = np.abs(holes).max(initial=1e-300)
    scaled = np.column_stack([np.ones(len(holes)), holes / size])
    ranks = [np.linalg.matrix_rank(each, tol=1e-6) for each in (scaled, scaled[:, 1:])]
    return bool(ranks[0] > ranks[1])


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
        As for `check_correction`.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    robot = study.model.robot
    check_correction(robot, language)
    segments = _segments(robot)
    environment = Environment(
        loader=PackageLoader("bowstring.study", "templates"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["n"] = lambda value: repr(float(value))
    said = [
        f"{source} {in_mm(meaning.corrected.max_error)}"
        for source, meaning in zip(
            ("from lengths", "from force"), study.verdict.meanings, strict=True
        )
    ]
    ending = FILES[language].rpartition(".")[2]
    return environment.get_template(f"correction.{ending}.j2").render(
        robot=robot,
        tendons=len(robot.tendons.segment),
        segments=segments,
        most=max(len(s.flexible) for s in segments),
        said="; ".join(said),
        swept=f"{study.settings.actuated}, 0 to {significant(study.settings.max_tension)} N",
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
        fit = np.linalg.pinv(np.column_stack([np.ones(own), -holes[:own]]))
        out.append(
            _Segment(
                first,
                own,
                float(robot.bending_stiffness[k]),
                holes,
                fit,
                float(guides[here].sum()),
                *(each[here] for each in (flexible, clamps, excess, skew, bow)),
            )
        )
    return out
