"""The motion of every solver in `make bench`, and its timing.

Robot: that of `cases.py` with its disks' inertia, at rest and straight, no gravity. The tension of
tendon 1 rises from 0 to 80 N in a second and holds for another; mass-proportional damping is 0.5
1/s. The tip is output every 0.01 s.

The call that computes the motion and returns the tip is timed; construction of a reusable model is
not. The time is processor time: all run on one thread, so it equals wall time on an idle machine,
and other work disturbs long runs less.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import dist

from benchmarks.cases import DENSITY, DIAMETER, median_ms, pi

TENSION_N = 80.0
RISE_S = 1.0
DURATION_S = 2.0
OUTPUT_S = 0.01
OUTPUTS = 200  # after the one at the start
MASS_DAMPING = 0.5

DISK_MASS = 0.02
_RADIUS, _THICKNESS = 0.032, 0.003
DISK_ACROSS = DISK_MASS * (3 * _RADIUS**2 + _THICKNESS**2) / 12
DISK_ALONG = DISK_MASS * _RADIUS**2 / 2
ROTARY_INERTIA = DENSITY * pi * DIAMETER**4 / 64
"""Rotary inertia of the backbone per length, about a diameter; about the axis it is twice that."""

PUBLISHED_X_MM = {0.5: 198.328, 1.0: 370.456, 1.15: 407.6}
"""Tip x at times in s, the last the first peak; from two engines that are independent of Bowstring
and agree to 0.16 mm."""

Tips = Sequence[Sequence[float]]
"""Tip in mm at 0, 0.01, ..., 2 s."""


@dataclass
class Motion:
    """The ramp at one setting; without a motion `tips_mm` is None and `note` gives the reason."""

    setting: str
    time_ms: float | None = None
    tips_mm: Tips | None = None
    note: str = ""


def tension(at_s: float) -> float:
    return TENSION_N * min(at_s / RISE_S, 1.0)


def error_mm(tips: Tips, reference: Tips) -> float:
    """Largest distance of two tips over the motion."""
    return max(dist(a, b) for a, b in zip(tips, reference, strict=True))


def measure(settings: Mapping[str, Callable[[], Callable[[], Tips]]]) -> list[Motion]:
    """Run and time the ramp at every setting (name -> how to prepare it)."""
    motions = []
    for setting, prepare in settings.items():
        try:
            run = prepare()
            tips = [[round(float(x), 6) for x in tip] for tip in run()]
            spent = median_ms(run, budget_s=0.2, least=2, clock=time.process_time)
            motions.append(Motion(setting, spent, tips))
        except Exception as error:  # a failed peer gets a row instead of stopping the benchmark
            reason = (str(error).strip() or type(error).__name__).split("\n")[0]
            motions.append(Motion(setting, note=reason))
    return motions
