"""Map of validity of a study over the tension and a load: payload, tip force, tilt or gravity."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.formatting import in_percent, listed, significant
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.study.design_map import has_too_many_disks
from bowstring.study.error_budget import transverse_force
from bowstring.validity.axes import Axis, axes_of
from bowstring.validity.contour import runs
from bowstring.validity.dead_loads import check_dead_loads
from bowstring.validity.design_space import DesignSpace
from bowstring.validity.errors import LABELS
from bowstring.validity.map_result import ValidityMap
from bowstring.validity.map_settings import MapSettings
from bowstring.validity.maps import compute_map

if TYPE_CHECKING:
    from bowstring.robot.model import Robot
    from bowstring.study.comparison import Model
    from bowstring.study.settings import Settings

LOAD_AXES: Final = ("payload", "tilt", "tip_force", "tip_force.x", "gravity.x")
"""Kinds of the second axis of this map."""

_TENSIONS, _POINTS = 13, 9  # points of the axes
_RAMP: Final = 9  # loads on the way to a point
_EDGE: Final = 1e-3  # share of the axis that is its end
_MOST_MOVED: Final = 0.065  # tip of the straight robot over its length, by linear theory


def check_load_axis(robot: Robot, model: Model, over: str | None) -> Axis:
    """Read the second axis of the map, or choose it for the robot.

    Parameters
    ----------
    robot : Robot
    model : Model
        Robot and actuated tendons.
    over : str, optional
        Axis as for `bowstring.validity_map`, of the kinds `LOAD_AXES`. By default a payload, or,
        where the robot has no gravity, a tip force.

    Returns
    -------
    Axis
        The chosen one ends at the largest round load that moves the straight robot's tip by at most
        6.5 % of its length by linear theory, perpendicular to it.

    Raises
    ------
    InputError
        If the axis is wrong, or is no load.
    """
    if over is not None:
        (axis,) = axes_of(robot, [over])
        kinds = {path.partition(".")[0] for path in LOAD_AXES}
        if axis.path.partition(".")[0] not in kinds:
            raise InputError(
                f"axis {axis.path} is no load of this map; take payload, tilt, tip_force, "
                "tip_force.x or gravity.z, and bowstring map for other numbers"
            )
        check_dead_loads(robot, [axis.path], _load(model, axis))
        return axis
    gravity = float(np.linalg.norm(robot.gravity))
    if gravity > 0.0:
        return Axis("payload", 0.0, transverse_force(robot, _MOST_MOVED, gravity), _POINTS)
    return Axis("tip_force", 0.0, transverse_force(robot, _MOST_MOVED), _POINTS)


def load_map(model: Model, settings: Settings, axis: Axis) -> ValidityMap | None:
    """Map over the tension and a load.

    Parameters
    ----------
    model : Model
        Robot, without friction, and actuated tendons.
    settings : Settings
    axis : Axis
        Of `check_load_axis`.

    Returns
    -------
    ValidityMap or None
        None where the robot has too many disks for a map.
    """
    if has_too_many_disks(model.robot):
        return None
    space = DesignSpace(
        model.robot,
        (Axis("tension", 0.0, settings.max_tension, _TENSIONS), axis),
        np.array(settings.shares),
        settings.max_tension,
        RodModel(settings.theory),
        _load(model, axis),
        _RAMP,
    )
    return compute_map(MapSettings.of(space, settings.tolerance))


def _load(model: Model, axis: Axis) -> Load:
    """Load of all points: the direction of a tip force, perpendicular to the bending plane."""
    return Load(tip_force=model.across) if axis.path == "tip_force" else Load()


def _assumption(found: ValidityMap) -> str:
    """Gravity or direction of the load of a map, in words."""
    axis = found.axes[1]
    if axis.path == "tip_force":
        return "dead, perpendicular to the bending plane"
    if axis.path.startswith("tip_force."):
        return "dead, in base axes"
    gravity = ", ".join(f"{g:g}" for g in found.robot.gravity)
    along = f"gravity ({gravity}) m/s2 of the robot file"
    return {"payload": f"{along}", "tilt": f"the base leans towards x; {along}"}.get(axis.path, "")


def caption_of_loads(found: ValidityMap) -> str:
    """Caption of the map's figure."""
    axis, why = found.axes[1], _assumption(found)
    return (
        f"Tip error of constant curvature by the {axis.words} and the tension, the robot as it is"
        f"{f' ({why})' if why else ''}; Amouri (2019) has no such figure. Constant curvature does "
        "not know the load. On the black line the error has the tolerance; colours name the effect "
        "that makes more than half of it, and the weight of a payload counts as tip force."
    )


def load_text(found: ValidityMap) -> tuple[str, str]:
    """Where the tolerance holds at half of the sweep's tension: a heading, and a sentence.

    Parameters
    ----------
    found : ValidityMap
        Of `load_map`.

    Returns
    -------
    tuple of (str, str)
    """
    words, tension = found.axes[1].words, 0.5 * found.axes[0].stop
    heading = f"{words[0].upper()}{words[1:]}"
    at = f"with the tension at {significant(tension)} N, half of the largest"
    sources: dict[str, list[str]] = {}
    for name in found.value:
        sources.setdefault(_ranges(found, name, tension), []).append(LABELS[name])
    parts = [
        f"{'up ' if ranges.startswith('to ') else ''}{ranges} ({listed(names)})"
        for ranges, names in sources.items()
    ]
    within = f"the error stays within {in_percent(found.tolerance, 3)}"
    return heading, f"{at}, {within} {', '.join(parts)}"


def load_sentence(found: ValidityMap) -> str:
    """`load_text` as one sentence, with the gravity or direction of the load."""
    (heading, sentence), why = load_text(found), _assumption(found)
    return f"{heading}{f' ({why})' if why else ''}, {sentence}."


def _ranges(found: ValidityMap, name: str, tension: float) -> str:
    """Ranges of the load in which the tolerance holds at one tension, in words."""
    axis, (x, y) = found.axes[1], found.fine_axes
    values = found.fine[name][:, int(np.argmin(np.abs(x - tension)))]
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    inside = np.isfinite(values) & (np.nan_to_num(values) <= found.tolerance)
    span = axis.stop - axis.start
    parts = []
    for first, last in runs(inside):
        low = _crossing(y, values, first, first - 1, found.tolerance)
        high = _crossing(y, values, last, last + 1, found.tolerance)
        from_start = abs(low - axis.start) < _EDGE * abs(span) and axis.start == 0.0
        to_end = abs(high - axis.stop) < _EDGE * abs(span)
        end = f"{'at least ' if to_end else ''}{significant(high / axis.factor)}{unit}"
        parts.append(f"{'' if from_start else significant(low / axis.factor) + ' '}to {end}")
    if not parts:
        start, stop = (significant(end / axis.factor) for end in (axis.start, axis.stop))
        return f"at no value from {start} to {stop}{unit}"
    if len(parts) == 1 and parts[0].startswith("to "):
        return parts[0]
    return f"at {listed([f'0 {part}' if part.startswith('to ') else part for part in parts])}"


def _crossing(y: Floats, values: Floats, inside: int, outside: int, level: float) -> float:
    """Position at which values reach a level between two neighbours, or the inner one."""
    if not 0 <= outside < len(y) or not np.isfinite(values[outside]):
        return float(y[inside])
    share = (level - values[inside]) / (values[outside] - values[inside])
    return float(y[inside] + share * (y[outside] - y[inside]))
