"""Bowstring on the ramp: fixed steps, adaptive steps, and the cost of writing all fields.

Times are whole calls of `simulate` that return the tip's motion at 100 Hz. The reference of all tip
errors is our own converged run; run.py compares it with the published figures.
"""

from __future__ import annotations

import tempfile
import time
from functools import partial
from pathlib import Path

import bowstring as bs
from benchmarks.cases import report
from benchmarks.ramp import DURATION_S, MASS_DAMPING, OUTPUT_S, TENSION_N, Tips, measure
from bowstring.dynamics.load_history import ramp
from bowstring.dynamics.simulation import Run, simulate

ROBOT = bs.load_robot("amouri2019")
RUNS = 21
CONVERGED = {"dt": 1e-4, "elements": 4, "spectral_radius": 1.0}


def motion(**settings: object) -> Run:
    tensions = ramp([TENSION_N, 0.0, 0.0], 1.0)
    path = settings.pop("out", None)
    run = simulate(
        ROBOT,
        tensions,
        DURATION_S,
        model=bs.RodModel(elements=settings.pop("elements", 1)),
        integrator=bs.Integrator(mass_damping=MASS_DAMPING, **settings),
        output=bs.Output(points=5 if path else 0, path=path),
    )
    return run.raise_for_status()


def prepare(**settings: object):
    def tips() -> Tips:
        return 1e3 * motion(**settings).tip_position

    return lambda: tips


STEPS = {f"dt {10 / n:.3g} ms": {"dt": OUTPUT_S / n} for n in (10, 8, 7, 5, 4, 3, 2, 1)}
SETTINGS = {
    **STEPS,
    "dt 0.5 ms, elements=2": {"dt": 5e-4, "elements": 2},
    "adaptive, default tolerance": {},
}


def figures() -> dict[str, dict[str, float]]:
    """Times in ms of the motion alone, the whole call, and the call with a file.

    They are the best of `RUNS`, as other work only adds to wall time.
    """

    def clock(call) -> float:
        file.unlink(missing_ok=True)
        start = time.perf_counter()
        call()
        return time.perf_counter() - start

    found = {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "run.nc"
        for name in ("dt 1.43 ms", "dt 3.33 ms", "adaptive, default tolerance"):
            call = partial(motion, **SETTINGS[name])
            times = [
                (call().wall_s, clock(call), clock(partial(call, out=file))) for _ in range(RUNS)
            ]
            best = [1e3 * min(column) for column in zip(*times, strict=True)]
            found[name] = dict(zip(("motion", "call", "call_with_file"), best, strict=True))
    return found


def main() -> None:
    """Measure and report."""
    report(
        bs.__version__,
        measure({name: prepare(**settings) for name, settings in SETTINGS.items()}),
        converged_mm=(1e3 * motion(**CONVERGED).tip_position).round(6).tolist(),
        figures=figures(),
    )


if __name__ == "__main__":
    main()
