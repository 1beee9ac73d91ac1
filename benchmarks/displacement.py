"""The displacement-controlled robot of `make bench`, for every solver with length control.

Robot, gravity and tip force: those of `cases.LOADED`. Tendon 1 is shortened; 2 and 3 are lengthened
until they are slack by 10 mm. From straight, in one call; construction of a reusable model is not
counted.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from benchmarks.cases import LENGTH, LOADED, Case, median_ms

TENSION_N = 40.0
DISPLACEMENTS = (0.022265557409, -0.015678655058, -0.025854244622)
"""Displacements (m). At 40, 0 and 0 N our solution with elements=8 has the first of these, and the
others plus 10 mm each."""
SLACK = 0.01
LIMITS = tuple(LENGTH - value for value in DISPLACEMENTS)
"""Largest length of each tendon from the base hole to its end, in m."""

BY_TENSION = Case("", (TENSION_N, 0, 0), (0, 0, 0), LOADED.gravity, LOADED.tip_force)
CHECK_TIP_MM = (234.99458, 89.37542, 571.62069)
"""Tip under tension instead of displacement control: Exudyn (peers/exudyn_rod.py on `BY_TENSION`)
with 8 and 16 elements a module and tolerance 1e-8, extrapolated."""

Found = tuple[Sequence[float], float]
"""Tip in mm and tension of tendon 1 in N."""


@dataclass
class Displaced:
    """The case at one setting; without a solution `tip_mm` is None and `note` gives the reason."""

    setting: str
    time_ms: float | None = None
    tip_mm: Sequence[float] | None = None
    tension_n: float | None = None
    note: str = ""


def measure(
    settings: Mapping[str, Callable[[], Callable[[], Found]]], repeat: bool = True
) -> list[Displaced]:
    """Solve and time every setting (name -> how to prepare it); only once unless `repeat`."""
    results = []
    for setting, prepare in settings.items():
        try:
            solve = prepare()
            start = time.perf_counter()
            tip, tension = solve()
            spent = 1e3 * (time.perf_counter() - start)
            if repeat:  # the first run is not timed
                spent = median_ms(solve)
            results.append(Displaced(setting, spent, [float(x) for x in tip], float(tension)))
        except Exception as error:  # a failed peer gets a row instead of stopping the benchmark
            reason = (str(error).strip() or type(error).__name__).split("\n")[0]
            results.append(Displaced(setting, note=reason))
    return results
