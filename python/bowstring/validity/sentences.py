"""A map in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats
from bowstring.formatting import in_newtons, in_percent, listed, significant
from bowstring.validity.axes import RAMPS, Axis, in_ranges
from bowstring.validity.causes import coarse_step
from bowstring.validity.contour import runs
from bowstring.validity.effects import EFFECTS
from bowstring.validity.errors import LABELS
from bowstring.validity.loading import actuated
from bowstring.validity.map_result import STATES, UNSOLVED, ValidityMap
from bowstring.validity.map_settings import MapSettings


def described(found: ValidityMap) -> list[str]:
    """A map in sentences."""
    out = list(found.notes)
    percent = f"{in_percent(found.tolerance, 3)} of length"
    for name, value in found.value.items():
        label = LABELS[name]
        undefined = found.undefined[name]
        if not np.isfinite(value).any():
            out.append(f"Constant curvature {label} has no {_lacks(found, name)} on the map.")
            if not found.undefined[name].any():
                continue
        elif found.metric == "valid_to":
            limits = limits_in_words(found.settings, value)
            out.append(f"Constant curvature {label} holds to {percent} up to {limits}.")
        else:
            step = coarse_step(value.shape, value.ndim)
            causes = in_causes(value, found.cause[name], step, found.tolerance)
            where = _where(found, name)
            out.append(f"Constant curvature {label} holds to {percent} {where}{causes}.")
        if undefined.any():
            out.append(undefined_in_words(name, undefined, _at_points(found, undefined)))
    out += sweep_in_words(found.settings)
    if found.metric == "valid_to":
        out += notes_on_limits(found.settings, found.value, found.solved_to)
    for i in (1, 3):
        where = found.state == i
        if where.any():
            said = f"{int(where.sum())} of {where.size} points: {STATES[i]}"
            out.append(f"{said}{_at_points(found, where)}.")
    unsolved = {i: found.state == i for i in UNSOLVED}
    places = {i: _at_points(found, where) for i, where in unsolved.items()}
    out += unsolved_in_words(found.settings, unsolved, found.solved_to, places)
    if 2 * int(found.unsolved.sum()) > found.state.size:
        many = any(axis.path in RAMPS for axis in found.axes)
        out.append(
            "Most of the map is not solved; give a smaller range of the tension or bend."
            if many
            else "Most sweeps are not solved to their end; give a smaller largest tension."
        )
    slack = found.state == 3
    out += notes_on_slack(found.settings, slack)
    out += notes_on_causes(found.settings, found.value, found.cause)
    return out


def _lacks(found: ValidityMap, name: str) -> str:
    if found.metric == "valid_to":
        return "validity limit anywhere"
    if found.undefined[name].any():
        return "value anywhere" if found.unsolved.any() else "arc anywhere"
    if found.metric == "error":
        return "equilibrium to compare with"
    return "sweep with an equilibrium at all loads to compare with"


def _where(found: ValidityMap, name: str) -> str:
    """Where the tolerance holds."""
    value = found.value[name]
    inside = value <= found.tolerance  # false without a value
    known = np.isfinite(value)
    if inside.all() and known.all() and not found.contour[name]:
        return "everywhere"
    ranges = found.ranges.get(name)
    if len(found.axes) == 1 and ranges is not None:
        if known.sum() == 1 and inside[known].all() and len(ranges) == 1 and np.ptp(ranges) == 0.0:
            return f"{in_ranges(found.axes[0], ranges)}, the only point with a value"
        return in_ranges(found.axes[0], ranges) if len(ranges) else "nowhere"
    if not inside.any() and not found.contour[name]:
        return "nowhere"
    if inside[known].all() and not found.contour[name]:
        return f"at the {int(known.sum())} of {value.size} points that have a value"
    where = "on a part of the map"
    if found.along is None or ranges is None:
        return where
    other = found.axes[1 - found.along]
    own = other.own_value(found.robot)
    assert own is not None, "the ranges are those of the robot as it is"
    at = in_ranges(found.axes[found.along], ranges) if len(ranges) else "nowhere"
    return f"{where}: at the robot's own {_quantity(other, own)} {at}"


def _quantity(axis: Axis, value: float) -> str:
    """A value of an axis, such as ``9 disks`` or ``payload at the tip of 0 g``."""
    if axis.is_whole:
        return f"{value:.0f} disks"
    unit = f" {axis.units[1]}" if axis.units[1] else ""
    return f"{axis.words} of {significant(value / axis.factor)}{unit}"


def _at_points(found: ValidityMap, where: Bools) -> str:
    """Ranges of a single axis that the points of `where` cover, in brackets."""
    if len(found.axes) != 1 or not where.any():
        return ""
    axis = found.axes[0]
    order = np.argsort(axis.values)
    values = axis.values[order]
    ends = [(values[first], values[last]) for first, last in runs(where[order])]
    return f" ({in_ranges(axis, np.array(ends))})"


def undefined_in_words(name: str, undefined: Bools, where: str = "", things: str = "points") -> str:
    """Sentence on the points at which a model has no arc."""
    why = "no arc has the tendon lengths, which ask for more than a full turn or too sharp a bend"
    if name == "cc_from_force_arm":
        why = "the tension reaches the buckling load between two disks"
    count = f"{int(undefined.sum())} of {undefined.size} {things}"
    return f"Constant curvature {LABELS[name]} is not defined at {count}{where}: {why}."


def sweep_in_words(settings: MapSettings) -> list[str]:
    """Sentence on the sweep that a metric covers."""
    what = {"largest_error": "largest", "mean_error": "mean"}.get(settings.metric)
    if what is None:
        return []
    space = settings.space
    end = significant(space.max_tension)
    return [
        f"The error is the {what} of {space.loads} loads from 0 to {end} N of "
        f"{actuated(space.shares)}."
    ]


def unsolved_in_words(
    settings: MapSettings,
    unsolved: Mapping[int, Bools],
    solved_to: Floats,
    places: Mapping[int, str] | None = None,
) -> list[str]:
    """Sentences on the points that are not solved, by their index in `STATES`.

    Parameters
    ----------
    settings : MapSettings
    unsolved : mapping from int to ndarray (N,)
        Points of each state.
    solved_to : ndarray (N,)
        Tension (N) or bend (rad) up to which each sweep is solved; NaN without any.
    places : mapping from int to str, optional
        Where these points are.
    """
    out = []
    for state, where in unsolved.items():
        if not where.any():
            continue
        said = f"{int(where.sum())} of {where.size} points: {STATES[state]}"
        said += "" if places is None else places[state]
        beyond = _beyond(settings, solved_to[where])
        if STATES[state] == "not solved":
            said += f": the solver gave up {beyond}, where the robot may have no equilibrium."
        else:
            said += f" {beyond}."
        out.append(said)
    part = np.any([where & (solved_to > 0.0) for where in unsolved.values()])
    if part and settings.metric == "valid_to":
        out.append("A sweep that holds as far as it is solved has its last solved load as limit.")
    return out


def _beyond(settings: MapSettings, solved_to: Floats) -> str:
    """Loads of sweeps that are not solved, such as ``beyond 20 to 35 N``."""
    known = solved_to[np.isfinite(solved_to)]
    words = []
    if known.size:
        ends = float(known.min()), float(known.max())
        if settings.space.by_displacement:
            shown = list(dict.fromkeys(significant(math.degrees(end)) for end in ends))
            words.append(f"beyond {' to '.join(shown)} deg")
        else:
            words.append(f"beyond {in_newtons(*ends)}")
    if known.size < solved_to.size:
        words.append("at the first load")
    return " or ".join(words)


def limits_in_words(settings: MapSettings, limit: Floats) -> str:
    """Range of the validity limits of a map (N), at least one of which is finite."""
    known = limit[np.isfinite(limit)]
    low, high = float(known.min()), float(known.max())
    step, end = _first_load(settings), significant(settings.space.max_tension)
    words = in_newtons(low, high)
    if 0.0 < low < step:  # between loads it is not resolved
        words = f"less than {significant(step)} N"
        words += f", at most {significant(high)} N," if high >= step else ""
    return f"{words} on this map; the sweep ends at {end} N"


def _first_load(settings: MapSettings) -> float:
    return settings.space.max_tension / (settings.space.loads - 1)


def notes_on_limits(
    settings: MapSettings, value: dict[str, Floats], solved_to: Floats
) -> list[str]:
    """Sentences on validity limits that the loads of the sweep do not resolve."""
    step = _first_load(settings)
    first = f"{significant(step)} N, the first load of the sweep"
    none = ~(solved_to > 0.0)  # also where nothing is solved
    unresolved = none & np.any([np.isnan(limit) for limit in value.values()], axis=0)
    below = [np.isnan(limit) | ((limit > 0.0) & (limit < step)) for limit in value.values()]
    out = []
    if np.any(below & ~unresolved):
        out.append(
            f"Some limits lie below {first}, and are not resolved; give a smaller largest tension."
        )
    if unresolved.any():
        out.append(
            f"At {int(unresolved.sum())} of {unresolved.size} points the sweep is not solved at "
            f"{first}, so that no limit is found; give a smaller largest tension."
        )
    return out


def in_causes(value: Floats, cause: NDArray[np.str_], step: int, tolerance: float) -> str:
    """Main causes of a map where its error is above the tolerance, as the end of a sentence."""
    coarse = value[(slice(None, None, step),) * value.ndim]
    effects = cause[coarse > tolerance]
    counts = {effect: int((effects == effect).sum()) for effect in EFFECTS}
    acting = sorted((e for e in EFFECTS if counts[e]), key=lambda e: -counts[e])
    if not acting:
        return ""
    many = ", each in its part of the map" if len(acting) > 1 else ""
    return f"; main cause of the error: {listed([EFFECTS[e].label for e in acting])}{many}"


def notes_on_slack(settings: MapSettings, slack: Bools) -> list[str]:
    """What to change where tendons are slack at most points of a map of bends."""
    paths = [axis.path for axis in settings.space.all_axes]
    if 2 * int(slack.sum()) <= slack.size or any("pretension" in path for path in paths):
        return []
    return [
        "At most points a tendon is slack; give the tendons a pretension, such as --set "
        'segments.0.tendons.pretension="10 N", or an axis pretension.'
    ]


def notes_on_causes(
    settings: MapSettings, value: dict[str, Floats], cause: dict[str, NDArray[np.str_]]
) -> list[str]:
    """Sentence on effects that are not examined where a main cause is missing."""
    why = settings.space.not_examined
    if not why or settings.metric == "valid_to":
        return []
    for name, effects in cause.items():
        step = coarse_step(value[name].shape, value[name].ndim)
        coarse = value[name][(slice(None, None, step),) * value[name].ndim]
        if (effects[coarse > settings.tolerance] == "").any():
            return [in_not_examined(why)]
    return []


def in_not_examined(why: str) -> str:
    """Sentence on straight spans that are not among the causes."""
    return (
        "Where no main cause is found, it may be that tendons run straight between the disks: "
        f"{why}."
    )
