"""How often `bowstring.calibration.compare_models` finds the memory of synthetic benches.

    python -m benchmarks.model_choice [COUNT] [FIRST SEED]

Each bench is `amouri2019` with a backbone 6 % softer than in the robot file, a misplaced measuring
frame, 0.1 mm noise, and 60, 90 or 120 rows, one every 5 s, on a smooth random path, by
displacements or tensions. It has one memory or none. Of those without, some have slow errors of the
measuring frame, or disks that clamp 2 mm of the backbone, which no model knows. All data are
synthetic.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections import Counter
from typing import Final

import numpy as np

import bowstring as bs
from bowstring.calibration import ModelComparison, compare_models
from bowstring.data.measurements import Measurements
from bowstring.data.rigid import Rigid

NOISE: Final = 1e-4
"""Standard deviation of a coordinate, m."""
E: Final = "segments.0.backbone.E"
ROWS: Final = (60, 90, 120)
#: Differences of the actual robot from the nominal one, by the kind of bench.
TRUTH: Final[dict[str, dict[str, float]]] = {
    "none": {},
    "none, slow errors": {},
    "none, disks clamp": {"segments.0.disks.clamped_length": 2e-3},
    "backlash": {},
    "friction": {"segments.0.tendons.friction": 0.15},
    "hysteresis": {
        "segments.0.backbone.hysteresis": 0.3,
        "segments.0.backbone.hysteresis_play": 0.2,
    },
    "creep": {
        "segments.0.tendons.creep_compliance": 3e-5,
        "segments.0.tendons.creep_time": 30.0,
    },
    "relaxation": {
        "segments.0.backbone.relaxation": 0.2,
        "segments.0.backbone.relaxation_time": 30.0,
    },
}
_PERIOD: Final = 5.0
"""Time from row to row, s."""
#: Half of the dead travel of a tendon with backlash, m.
_HALF: Final = 2.5e-4
#: Slow errors: standard deviation (m), autocorrelation of neighbouring rows, and drift (m).
_SLOW: Final = (3e-4, 0.9, 5e-4)


def table(by_displacement: bool, kind: str, seed: int, rows: int, skip: int = 0) -> Measurements:
    """Synthetic table of one bench, without the first `skip` rows of its path."""
    rng = np.random.default_rng(seed)
    t, shift = np.linspace(0.0, 1.0, rows), rng.uniform(size=4)
    measured = slice(skip, None)
    bend = 0.15 + 0.75 * np.abs(np.sin(np.pi * (2.5 * t + shift[0])))
    bend += 0.1 * np.sin(9 * t + 6 * shift[1])
    towards = 2 * np.pi * (shift[2] + 0.8 * np.sin(2 * np.pi * (1.3 * t + shift[3])))
    along = np.cos(towards[:, None] - 2 * np.pi * np.arange(3) / 3)
    actual = bs.load_robot("amouri2019").with_({E: 33e9, **TRUTH[kind]})
    none = np.full((rows, 3), np.nan)
    if by_displacement:
        tensions, displacements = none, 0.029 * bend[:, None] * along
        half = _HALF if kind == "backlash" else 0.0
        load = bs.Load(displacements=_followed(displacements, half))
    else:
        tensions, displacements = 2 + 60 * bend[:, None] * np.maximum(along, 0.0), none
        load = bs.Load(tensions)
    frame = Rigid.from_rotation_vector([0.01, -0.02, 0.015], [3e-3, -2e-3, 1e-3])
    times = _PERIOD * np.arange(rows)
    tips = frame.apply(bs.sweep(actual, load=load, times=times).tip_position)
    tips = tips + NOISE * rng.standard_normal((rows, 3))
    if kind == "none, slow errors":
        tips += _slow(rng, rows)
    return Measurements(
        source="synthetic",
        name="virtual bench",
        tensions=tensions[measured],
        displacements=displacements[measured],
        points=tips[measured, None],
        line=np.arange(2, rows + 2 - skip),
        group=np.full(rows - skip, ""),
        repeat=np.ones(rows - skip, dtype=int),
        sigma=np.full(rows - skip, NOISE),
        time=times[measured],
    )


def _followed(commands: np.ndarray, half: float) -> np.ndarray:
    """Commands that follow with a play of the given half width."""
    out, state = np.empty_like(commands), commands[0]
    for k, row in enumerate(commands):
        state = np.clip(state, row - half, row + half)
        out[k] = state
    return out


def _slow(rng: np.random.Generator, rows: int) -> np.ndarray:
    size, kept, drift = _SLOW
    out, state = np.empty((rows, 3)), np.zeros(3)
    for k in range(rows):
        state = kept * state + np.sqrt(1 - kept**2) * size * rng.standard_normal(3)
        out[k] = state + drift * k / rows
    return out


def compared(by_displacement: bool, kind: str, seed: int, rows: int) -> ModelComparison:
    """Compare the models on one bench, as a user of the nominal robot."""
    data = table(by_displacement, kind, seed, rows)
    names = ["base", "gain" if by_displacement else E]
    return compare_models(bs.load_robot("amouri2019"), data, names)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    warnings.simplefilter("ignore")
    for by_displacement in (True, False):
        for kind in TRUTH:
            if kind in ("backlash", "creep") and not by_displacement:
                continue
            began, found, chosen = time.perf_counter(), Counter[str](), Counter[str]()
            for seed in range(first, first + count):
                got = compared(by_displacement, kind, seed, ROWS[seed % len(ROWS)])
                found["none" if got.memory is None else got.memory.name] += 1
                chosen[got.chosen.name] += 1
            spent = (time.perf_counter() - began) / count
            actuation = "displacements" if by_displacement else "tensions"
            print(
                f"{actuation}, {kind}: memory {dict(found)}; chosen {dict(chosen)}; {spent:.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
