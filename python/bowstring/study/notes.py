"""Notes of a study: its assumptions and limits in sentences, and the published claim."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from bowstring.data.tip_errors import Comparison
from bowstring.formatting import in_mm, in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.laws import LAWS
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.study.comparison import COMPARISONS, FROM_FORCE, poses_by_arcs
from bowstring.study.settings import Settings
from bowstring.study.sweeps import GeometricSweep, Statics
from bowstring.validity.loading import FARTHEST

if TYPE_CHECKING:
    from bowstring.study.angle_validation import AgainstAngles
    from bowstring.study.data_validation import AgainstData


@dataclass(frozen=True)
class PublishedClaim(Result):
    """Published result of the source study beside ours; none of its measurements is available."""

    mean_mm: Annotated[float, Key("smaller_than_mm")]
    """Published upper bound of the mean error, mm."""
    mean_percent: Annotated[float, Key("smaller_than_percent")]
    """Published upper bound of the mean error in percent of the length."""
    ours: Annotated[str, Key("compared_with")]
    """Name of the corresponding comparison."""
    text: str
    """Comparison with ours in sentences."""
    source: Annotated[str, Key()] = "Amouri 2019"
    """Publication."""
    what: Annotated[str, Key()] = "mean of constant curvature against finite elements"
    """What is compared."""


def claim_of(
    robot: Robot,
    settings: Settings,
    comparisons: dict[str, Comparison],
    in_time: dict[str, Comparison],
    by_bricks: dict[str, Comparison],
) -> PublishedClaim | None:
    """Published mean of the source study, for its own robot and load range only."""
    if robot.name != "amouri2019" or settings.max_tension != 80.0:
        return None
    if settings.tendon != 0 or not settings.actuated_alone:
        return None
    ours = comparisons["cc_from_force"]
    x, _, z = ours.mean_by_axis
    moving = ""
    if in_time and in_time["cc_from_force"].n == ours.n:
        moving = f"; against dynamics it is {in_mm(in_time['cc_from_force'].mean)}"
    if by_bricks and by_bricks["cc_from_force"].n == ours.n:
        moving += f"; against our finite elements {in_mm(by_bricks['cc_from_force'].mean)}"
    text = (
        "Amouri 2019 prints, for constant curvature against its finite-element run, a mean error "
        "smaller than 4.95 mm (0.77 % of length), and speaks of errors along each axis. This is "
        f"its published mean; ours, from force and against statics, is {in_mm(ours.mean)} "
        f"({in_percent(ours.mean / robot.length)}; {in_mm(x)} in x, {in_mm(z)} in z){moving}. How "
        "it turned force into cable length is our reading of its section 4.1 (the linear law). No "
        "measured data of it are available, so nothing here is its measurement."
    )
    if robot.hash != load_robot("amouri2019").hash:
        text += " The robot studied here differs from the built-in one in some of its numbers."
    return PublishedClaim(4.95, 0.77, ours.name, text)


def notes_of(
    robot: Robot,
    settings: Settings,
    geometry: GeometricSweep,
    statics: Statics,
    comparisons: dict[str, Comparison],
    in_time: dict[str, Comparison],
    data: AgainstData | None,
    angles: AgainstAngles | None = None,
) -> tuple[str, ...]:
    """Assumptions and limits of a study in sentences."""
    simulated = (
        "constant curvature is compared with the statics and the dynamics of this program, not "
        "with a measurement. All share the base frame, so nothing was registered."
    )
    out = [
        f"All data are simulated: {simulated}"
        if data is None and angles is None
        else f"Apart from 'Against the data', all is simulated: {simulated}",
        "Errors are Euclidean at the tip unless an axis is named; means and RMS are over loads "
        "(zero load included), never over coordinates.",
        f"Physics of the main sweep: {settings.theory.capitalize()} rod, frictionless tendons "
        "straight from disk to disk, dead loads, "
        + (
            f"gravity ({', '.join(f'{g:g}' for g in robot.gravity)}) m/s2 as in the robot file."
            if any(robot.gravity)
            else "no gravity (the robot file has none)."
        ),
    ]
    out += [f"{sentence[0].upper()}{sentence[1:]}." for sentence in settings.earlier]
    if settings.range_chosen:
        out.append(
            f"The load range to {settings.max_tension:g} N was chosen by the program: the largest "
            "round load that "
            + (
                "turns the robot by at most 80 degrees from its pose without tension, by statics "
                f"in gravity (at most {FARTHEST:g} times that of the linear law)."
                if any(robot.gravity)
                else "bends the robot by at most 80 degrees by the linear law."
            )
        )
    if geometry.scale < 1.0:
        out.append(
            f"In gravity the linear law bends {robot.name} far more than it goes: the geometric "
            "sweep and the commanded lengths end at the arcs of "
            f"{significant(geometry.scale * settings.max_tension)} N, about the robot's own bend."
        )
    calibrated = data is not None and data.calibrated_friction is not None
    left_out, lost = (
        [f"the {key} of the {LAWS[key].owner}" for key in robot.laws if LAWS[key].memory is memory]
        for memory in (True, False)
    )
    if lost:
        out.append(f"Main sweep, dynamics and error budget are without {listed(lost)}.")
    if calibrated:
        left_out = ["the friction that was calibrated", *left_out[robot.has_friction :]]
    if left_out:
        out.append(
            f"The main sweep, dynamics, stress and strain, and the ranges in the verdict are "
            f"without {listed(left_out)}. What each does alone is in the error budget under "
            "'Actuation'."
        )
    for name, comparison in comparisons.items():
        missing = int(statics.converged.sum()) - comparison.n
        if missing and not comparison.n:
            out.append(
                f"Constant curvature {COMPARISONS[name]} has no numbers here: "
                f"{_without_arcs(robot, settings, statics, name)}."
            )
        elif missing:
            out.append(
                f"Constant curvature {COMPARISONS[name]} has no arc at {missing} of the loads that "
                f"statics solved; its numbers are over the other {comparison.n}."
            )
    for name, comparison in in_time.items():
        if comparison.n != comparisons[name].n:
            out.append(
                f"Constant curvature {COMPARISONS[name]} is compared with dynamics at "
                f"{comparison.n} loads and with statics at {comparisons[name].n}: do not compare "
                "their means."
            )
    return tuple(out)


def _without_arcs(robot: Robot, settings: Settings, statics: Statics, name: str) -> str:
    """Reason why constant curvature has no arc at the last load that statics solved."""
    last = int(np.flatnonzero(statics.converged)[-1])
    force = statics.tension[last] * np.array(settings.shares)
    commands = force if name in FROM_FORCE else statics.tendon_lengths[last]
    return poses_by_arcs(robot, name, commands[None])[2].partition(";")[0] or "no arc fits"
