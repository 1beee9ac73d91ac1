"""Map of validity of a study: over the tension and one number of the robot's design."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring.errors import InputError
from bowstring.robot.paths import find
from bowstring.statics.model import RodModel
from bowstring.validity.axes import Axis
from bowstring.validity.design_space import DesignSpace
from bowstring.validity.map_result import ValidityMap
from bowstring.validity.map_settings import MapSettings
from bowstring.validity.maps import compute_map

if TYPE_CHECKING:
    from bowstring.robot.model import Robot
    from bowstring.study.settings import Settings

_MOST_DISKS: Final = 60  # most disks of a robot with a map
_LOADS, _POINTS = 21, 12  # points of the axes
_NUMBERS: Final = ("pitch_radius", "backbone.diameter", "backbone.E")
_RANGES: Final = ((0.5, 1.5), (0.5, 1.2), (0.5, 1.1), (0.9, 1.1))  # over the robot's own value


def design_map(robot: Robot, settings: Settings) -> ValidityMap | None:
    """Map over the tension and a number of the design, around the robot's own.

    Parameters
    ----------
    robot : Robot
        Robot without friction.
    settings : Settings

    Returns
    -------
    ValidityMap or None
        None where `without_map` has a reason.
    """
    axis = design_axis(robot)
    if axis is None or without_map(robot):
        return None
    axes = (Axis("tension", 0.0, settings.max_tension, _LOADS), axis)
    model, shares = RodModel(settings.theory), np.array(settings.shares)
    space = DesignSpace(robot, axes, shares, settings.max_tension, model)
    return compute_map(MapSettings.of(space, settings.tolerance))


def has_too_many_disks(robot: Robot) -> bool:
    """Whether a robot has too many disks for the maps of a study."""
    return len(robot.disks.station_m) > _MOST_DISKS


def without_map(robot: Robot) -> str:
    """Why a robot has no map, in a sentence; empty if it has one."""
    if has_too_many_disks(robot):
        return (
            f"The maps of validity are left out: {robot.name} has {len(robot.disks.station_m)} "
            f"disks, and they are for at most {_MOST_DISKS}; bowstring map computes them."
        )
    if design_axis(robot) is None:
        return (
            "The map of validity is left out: number of disks, pitch radius, diameter and Young's "
            "modulus are not the same everywhere, or cannot vary, so that no number of all is "
            "varied; bowstring map takes a number of one segment."
        )
    return ""


def caption_of(found: ValidityMap) -> str:
    """Caption of the map's figure."""
    axis = found.axes[1]
    counts = {segment.disks.count for segment in found.robot.segments}
    words, why = axis.words, ""
    if axis.is_whole:
        words += " of each segment"
    elif None in counts:
        why = " (the positions of the disks are listed, so that their number is no axis)"
    elif len(counts) > 1:
        why = " (segments have different numbers of disks)"
    else:
        why = " (the clamped lengths leave no room for more disks)"
    return (
        f"Tip error of constant curvature by the {words} and the tension, all other numbers as "
        f"they are{why}; Amouri (2019) has no such figure. On the black line the error has the "
        "tolerance; colours name the effect that makes more than half of it. Dashed: this robot."
    )


def design_axis(robot: Robot) -> Axis | None:
    """Number of disks of each segment, or the first other number that all segments share."""
    for axis in _axes(robot):
        with suppress(InputError):
            for end in (axis.start, axis.stop):
                robot.with_({axis.path: int(end) if axis.is_whole else end})
            return axis
    return None


def _axes(robot: Robot) -> Iterator[Axis]:
    """Axes around the robot's own value, wide ranges first: the robot may refuse their ends."""
    own = _own(robot, "segments.*.disks.count")
    if own is not None:
        count = int(own)
        least = max(1, min(2, count - 1), count // 3)
        for top in range(count + max(3, count // 2), count, -1):
            yield Axis("segments.*.disks.count", least, top, max(2, min(_POINTS, top)))
    for name in _NUMBERS:
        # beside a stiffness matrix there is no E, and the diameter changes nothing
        if robot.has_matrix and name.startswith("backbone."):
            continue
        try:
            path = find(robot, name, ())[0]
        except InputError:  # rings and lists of tendons side by side share no path
            continue
        own = _own(robot, path)
        if own is not None:
            for low, high in _RANGES:
                yield Axis(path, low * own, high * own, _POINTS)


def _own(robot: Robot, path: str) -> float | None:
    """The value that all segments share; None where they differ or one of them has none."""
    with suppress(InputError):
        targets = find(robot, path, ())[1]
        if len(targets) >= len(robot.segments):
            return Axis(path, 1.0, 2.0).own_value(robot)
    return None
