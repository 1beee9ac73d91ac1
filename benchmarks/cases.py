"""Robot, loads and reference tips of every solver in `make bench`.

Robot: `amouri2019` (Amouri 2019, Table 1, with E = 35 GPa): a solid backbone clamped at the base,
nine rigid disks, three tendons that run straight and without friction from hole to hole. Metres,
newtons, kilograms; base frame with z along the straight backbone; tips in mm.

A solver is measured as in a user's loop: imports, compilation and construction of a reusable model
are not counted; every solve starts from the straight robot.
"""

from __future__ import annotations

import json
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import cos, pi, sin

LENGTH = 0.641
DIAMETER = 0.005
YOUNG = 35e9
POISSON = 0.3
DENSITY = 1800.0
DISKS = 9
PITCH_RADIUS = 0.029
TENDON_ANGLES = (0.0, 2 * pi / 3, 4 * pi / 3)

SHEAR = YOUNG / 2 / (1 + POISSON)
AREA = pi * DIAMETER**2 / 4
EI = YOUNG * pi * DIAMETER**4 / 64
GJ = SHEAR * pi * DIAMETER**4 / 32
EA = YOUNG * AREA
GA = SHEAR * AREA  # shear factor 1, as in Bowstring


@dataclass(frozen=True)
class Case:
    name: str
    tensions: tuple[float, float, float]
    tip_mm: tuple[float, float, float]
    """Reference tip: straight spans, Cosserat rod."""
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tip_force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    disk_mass: float = 0.02


# Tips from two codes that are independent of Bowstring; they agree to the digits given.
DISPLACEMENTS = (
    Case("20 N", (20.0, 0.0, 0.0), (110.695401, 0.0, 628.054156)),
    Case("40 N", (40.0, 0.0, 0.0), (216.182744, 0.0, 589.450082)),
    Case("60 N", (60.0, 0.0, 0.0), (309.551981, 0.0, 527.056300)),
    Case("80 N", (80.0, 0.0, 0.0), (384.556175, 0.0, 444.807525)),
)
# Tip from Exudyn (peers/exudyn_rod.py) with 4, 8 and 16 elements a module and tolerance 1e-8,
# extrapolated: accurate to 2e-4 mm; at 80 N the same extrapolation agrees with the tip above to
# 3e-6 mm.
LOADED = Case(
    "loaded",
    (40.0, 10.0, 5.0),
    (193.70087, 115.49344, 586.57495),
    gravity=(0.0, 0.0, -9.81),
    tip_force=(0.0, 1.0, 0.0),
)
CASES = (*DISPLACEMENTS, LOADED)


def holes() -> list[tuple[float, float]]:
    """The tendons' holes (x, y), the same in every disk."""
    return [(PITCH_RADIUS * cos(a), PITCH_RADIUS * sin(a)) for a in TENDON_ANGLES]


@dataclass
class Result:
    """One solved case; without a solution `tip_mm` is None and `note` gives the reason."""

    setting: str
    case: str
    time_ms: float | None = None
    tip_mm: Sequence[float] | None = None
    note: str = ""


Solve = Callable[[], Sequence[float]]
"""Solves one case from straight and returns the tip in mm; raises where it finds no solution."""


def median_ms(
    call: Callable[[], object],
    budget_s: float = 0.3,
    least: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> float:
    """Median time of a call, repeated for about `budget_s`."""
    return statistics.median(times_ms(call, budget_s, least, clock))


def times_ms(
    call: Callable[[], object],
    budget_s: float,
    least: int = 5,
    clock: Callable[[], float] = time.perf_counter,
) -> list[float]:
    """Times of a call, repeated for about `budget_s`."""
    times: list[float] = []
    while len(times) < least or (sum(times) < 1e3 * budget_s and len(times) < 10_000):
        start = clock()
        call()
        times.append(1e3 * (clock() - start))
    return times


def measure(
    settings: Mapping[str, Callable[[Case], Solve]], cases: Iterable[Case] = CASES
) -> list[Result]:
    """Solve and time every case at every setting (name -> how to prepare a case)."""
    results = []
    for case in cases:
        for setting, prepare in settings.items():
            try:
                solve = prepare(case)
                tip = [float(x) for x in solve()]  # the first run, which may compile, is not timed
                results.append(Result(setting, case.name, median_ms(solve), tip))
            except Exception as error:  # a failed peer gets a row instead of stopping the benchmark
                results.append(Result(setting, case.name, note=str(error).strip().split("\n")[0]))
    return results


def report(version: str, results: Sequence[Result], **more: object) -> None:
    """One line of JSON, the last that a benchmark process prints; read by run.py."""
    print(json.dumps({"version": version, "results": [asdict(r) for r in results], **more}))
