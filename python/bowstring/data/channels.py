"""Faults of a channel of readings: noise about zero, its likely zero, spikes and saturation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from bowstring.aliases import Bools, Floats, Ints
from bowstring.formatting import listed, significant

_FEW: Final = 4  # readings below zero that do not show their distribution
_SMALL: Final = 0.02  # share of the range below which readings below zero are noise by their size
_LARGE: Final = 0.25  # share of the range above which they are none
_WIDE: Final = 4.0  # standard deviations of a normal distribution that a large sample reaches
_MEDIAN: Final = 0.6745  # median over standard deviation of a half-normal distribution
_REACH: Final = 3.0  # standard deviations
_GATHERED: Final = 0.85  # mean^2 over mean square; 0.64 if half-normal, 1 for equal readings
_MORE: Final = 5.0  # readings below zero for one above, where a zero errs by one deviation
_ABOVE: Final = 0.05  # share of the range above zero that is noise
_LOW: Final = 0.1  # share of the range in which the readings without load lie
_GATHER: Final = 0.2  # share of the rows there if they gather; 0.1 if readings are uniform
_OFTEN: Final = 0.02  # share of rows above which readings are no spikes
_TWO: Final = 20  # rows from which two readings may be spikes
_FAR: Final = 3.0  # distance of a spike over the range of the others
_PART: Final = 4  # one of so many readings of a steady channel may be a spike
_STEP: Final = 1.4  # least ratio of two levels of a geometric series
_LEVELS: Final = 3  # ratios of a geometric series
_ALIKE: Final = 2.0  # largest over least of these ratios
_RUN: Final = 5  # rows
_STILL: Final = 0.05  # share of its range within which a robot rests
_DISTINCT: Final = 0.8  # share of different readings of a sensor; commands repeat
_SAMPLE: Final = 1_000  # readings that show whether they repeat


def noise_about_zero(readings: Floats) -> float:
    """Half-width of noise about zero, if the readings below zero are noise; else 0.

    Noise is as often above zero as below, and gathers at zero; readings with another zero gather
    away from it.
    """
    below = -readings[readings < 0.0]
    most = float(np.delete(readings, spikes(readings)).max(initial=0.0))
    if not below.size or most <= 0.0:
        return 0.0
    if len(below) >= _FEW:  # without single readings far below
        below = below[below <= _WIDE / _MEDIAN * np.median(below)]
    width = float(below.max())
    if width <= _SMALL * most and len(below) < _FEW:
        return width
    above = int(((readings >= 0.0) & (readings <= width)).sum())
    is_even = len(below) <= _MORE * (above + 1)
    gathered = float(below.mean() ** 2 / (below**2).mean())
    is_small = width <= _SMALL * most
    is_noise = len(below) >= _FEW and width <= _LARGE * most and gathered < _GATHERED
    # noise above zero reaches as far
    reach = max(width, _REACH / _MEDIAN * float(np.median(below)))
    return reach if is_even and (is_small or is_noise) else 0.0


def likely_zero(readings: Floats) -> float:
    """Reading without load: the middle of the lowest ones, NaN if they do not gather there."""
    low, high = np.quantile(readings, [_OFTEN / 2, 1.0 - _OFTEN / 2])
    near = readings[(readings >= low) & (readings <= low + _LOW * (high - low))]
    return float(np.median(near)) if len(near) > _GATHER * len(readings) else np.nan


def is_negated(readings: Floats) -> bool:
    """Whether readings of what is never below zero look turned in sign, not shifted.

    They reach up to zero, or near it without gathering at their lowest, where readings with another
    zero are without load.
    """
    top, span = float(np.quantile(readings, 1.0 - _OFTEN / 2)), _range(readings)
    if top > _ABOVE * span or not span:
        return False
    is_low = np.isfinite(likely_zero(readings))
    return top > -_SMALL * span or (not is_low and top > -_LARGE * span)


def _few_of(count: int) -> int:
    """Number of readings that may be spikes."""
    return max(1 + (count >= _TWO), int(_OFTEN * count))


def spikes(readings: Floats) -> Ints:
    """Rows of the few readings that lie several times the range of the others away from them.

    Many in a row are a pulse; the last of a geometric series is not a spike.
    """
    if len(readings) <= _FEW + 1:
        return np.empty(0, np.int64)
    some = np.sort(readings[:: max(1, len(readings) // _SAMPLE)])
    few = _few_of(len(some))
    low, high = some[few - len(some)], some[-1 - few]
    if max(low - readings.min(), readings.max() - high) <= _FAR * (high - low):
        return np.empty(0, np.int64)
    distance = np.abs(readings - np.median(readings))
    last = len(readings) - 1 - _few_of(len(readings))
    rest = readings[distance <= np.partition(distance, last)[last]]
    if len(np.unique(rest[:_SAMPLE])) <= _FEW:  # a tendon that is seldom loaded
        return np.empty(0, np.int64)
    low, high = rest.min(), rest.max()
    middle = np.sort(readings)[(len(readings) - 1) // 2 : len(readings) // 2 + 1]
    if any(_is_geometric(readings, centre) for centre in middle):
        return np.empty(0, np.int64)
    rows = np.flatnonzero(np.maximum(low - readings, readings - high) > _FAR * (high - low))
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    return np.concatenate([run for run in runs if len(run) < _RUN] or [rows[:0]])


def _is_geometric(readings: Floats, centre: float) -> bool:
    """Whether the readings farthest from a centre are levels of about the same ratio."""
    sizes = np.abs(readings - centre)
    levels = [float(sizes.max())]
    for _ in range(_LEVELS):
        levels.append(float(sizes.max(where=sizes < levels[-1] / _STEP, initial=0.0)))
        if not levels[-1]:
            return False
    ratios = np.divide(levels[:-1], levels[1:])
    return bool(ratios.max() <= _ALIKE * ratios.min())


def steady(readings: Floats) -> Bools:
    """Readings of a robot at rest without spikes: several times the range of the others away."""
    order = np.argsort(np.abs(readings - np.median(readings)), kind="stable")
    kept = np.ones(len(readings), bool)
    for few in range(len(readings) // _PART, 0, -1):
        low, high = readings[order[:-few]].min(), readings[order[:-few]].max()
        far = readings[order[-few:]]
        if np.maximum(low - far, far - high).min() > _FAR * (high - low):
            kept[order[-few:]] = False
            break
    return kept


def saturated(readings: Floats, from_rest: bool = False) -> tuple[int, int] | None:
    """First row and length of a run of readings at the end of the range of a sensor.

    Of one that reads from rest, the least reading is no such end.
    """
    for end in (readings.max(), *([] if from_rest else [readings.min()])):
        at_end = readings == end
        if end == 0.0 or at_end.sum() < _RUN:
            continue
        change = np.flatnonzero(np.diff(np.r_[False, at_end, False]))
        starts, lengths = change[::2], change[1::2] - change[::2]
        others = readings[~at_end & (readings != 0.0)][:_SAMPLE]
        if lengths.max() >= _RUN and len(np.unique(others)) > max(_DISTINCT * len(others), _FEW):
            return int(starts[lengths.argmax()]), int(lengths.max())
    return None


def rest(channels: Sequence[Floats], first: int, count: int) -> bool:
    """Whether no channel of a kind moves in a run of rows, as where a robot is held.

    The measure is the largest range, because others may be noise alone.
    """
    in_run = max(_range(each[first : first + count]) for each in channels)
    return in_run <= _STILL * max(map(_range, channels))


def _range(readings: Floats) -> float:
    seen = readings[np.isfinite(readings)]
    return float(np.ptp(seen)) if len(seen) else 0.0


def advice(zeros: Sequence[tuple[str, float]], negated: Sequence[str] = ()) -> str:
    """Sentences on columns that look turned in sign, and on the likely zeros of the others.

    Zeros are in the units of the columns.
    """
    if negated:
        read = "reads" if len(negated) == 1 else "read"
        said = (
            f"{listed(negated)} {read} below zero under load: turn the sign, in a mapping by "
            f"{{column: {negated[0]}, sign: -1}}{'' if len(negated) == 1 else ' and so on'}."
        )
        others = [each for each in zeros if each[0] not in negated and each[1] < 0]
        return f"{said} {advice(others)}" if others else said
    known = [f"{significant(zero, 4)} of {name}" for name, zero in zeros if np.isfinite(zero)]
    numbers = (
        " ".join(significant(zero, 4) for _, zero in zeros) if len(known) == len(zeros) else ""
    )
    likely = f"The likely zero is {listed(known)}: give" if known else "Give"
    return (
        f"{likely} the reading of each tendon without load, in the straight robot, as zero in the "
        f"mapping, or in a comment '# zero: {numbers or 'first'}' above the header (first: that of "
        "the first row)."
    )
