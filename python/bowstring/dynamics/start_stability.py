"""Stability of the equilibrium from which a motion starts, as one sentence."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from bowstring.aliases import Floats
from bowstring.statics import messages
from bowstring.statics.load import Load
from bowstring.statics.load_tables import FOLLOWER, MOMENT, WRENCH, InstantLoad

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

_HALVINGS: Final = 10  # bisections of the share of the load at which stability is lost


class Judged(NamedTuple):
    """Stability of the start, as `bowstring.Solution.stable`, and a sentence if not stable."""

    stable: bool | None
    sentence: str = ""


def judged_start(
    robot: Robot, initial: InstantLoad, load: Load, model: RodModel, *, on_path: bool
) -> Judged:
    """Judge the equilibrium from which a motion starts, as `bowstring.solve` does.

    Parameters
    ----------
    robot : Robot
    initial : InstantLoad
        Load at the start.
    load : Load
        The same without actuation, with gravity and with the forces that hold the robot.
    model : RodModel
        Model of the run.
    on_path : bool
        Whether the start is the end of a path: with displacements, friction or a history.

    Returns
    -------
    Judged
        True for a minimum of the potential energy. False or None has a sentence, except with
        friction, where stability is never known.
    """
    if on_path and robot.has_friction:
        return Judged(None)
    if initial.has_potential:
        return Judged(True)  # the start is a minimum, or there is none
    stable, cause = None, messages.without_potential(load, short=True)
    if not on_path:
        # a growth rate needs the elements of `solve`, not the fewer of a run
        model = model.replace(elements=None)
        found = robot.core.solve(initial.actuation, load, model)
        if not found.converged:
            return Judged(None)  # the run finds no start either, or one that solve does not find
        stable, model = found.stable, found.model
    if stable:
        return Judged(True)
    if stable is None:
        return Judged(
            None,
            "the motion starts from an equilibrium that is not known to be stable: "
            f"{cause} may let small oscillations about it grow (flutter) unless they are damped "
            "by more than 1 %",
        )
    return Judged(
        False,
        "the motion starts from an equilibrium that is not stable: "
        f"under {cause} small motions about it grow{_onset(robot, initial, load, model)}",
    )


def _onset(robot: Robot, initial: InstantLoad, load: Load, model: RodModel) -> str:
    """Say how stability is lost when the loads without a potential increase from zero.

    Growth of oscillations increases from zero, so that just beyond their onset `stable` is None;
    that of a motion that does not oscillate is strong at once.
    """

    def stable(share: float) -> tuple[bool, bool | None]:
        part = _scaled(load, share)
        found = robot.core.solve(initial.actuation, part, model)
        return found.converged, found.stable

    low, high, beyond = 0.0, 1.0, False
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        converged, found = stable(middle)
        if not converged:
            return ""
        if found:
            low = middle
        else:
            high, beyond = middle, found is None
    how = "as oscillations (flutter)" if beyond else "without oscillating (buckling)"
    return f", {how} from {100 * high:.3g} % of it on"


def _scaled(load: Load, share: float) -> Load:
    """Scale dead moments and followers, and keep the other loads."""

    def part(value: Floats | None) -> Floats | None:
        return None if value is None else share * value

    points = load.point_loads
    if points is not None:
        points = points.copy()
        follows = points[:, FOLLOWER] != 0
        points[follows, WRENCH] *= share
        points[~follows, MOMENT] *= share
    return load.replace(
        tip_moment=part(load.tip_moment), disk_moments=part(load.disk_moments), point_loads=points
    )
