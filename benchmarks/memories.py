"""Coverage of the intervals of memories: full fits to synthetic benches with known truth.

    python -m benchmarks.memories [COUNT] [FIRST SEED] [--begun]

The benches are those of `benchmarks.model_choice`: 60, 90 or 120 rows, one every 5 s, 0.1 mm noise,
backlash with a dead travel of 0.5 mm, friction 0.15, hysteresis, creep and relaxation with 30 s.
Each fit has the memory as unknown, beside the base and the modulus of the backbone or the gain, and
starts near the truth: this counts intervals, not searches. With --begun only the last 20 rows of a
path are measured; each bench is then fitted twice, from the home pose and with the initial state as
unknown. All data are synthetic.
"""

from __future__ import annotations

import sys
import warnings
from collections import defaultdict
from typing import Final

import numpy as np

import bowstring as bs
from benchmarks.model_choice import ROWS, TRUTH, E, table
from bowstring.calibration import fit

_MEMORIES: Final = {
    kind: {name: value for name, value in TRUTH[kind].items() if name != E}
    for kind in ("friction", "hysteresis", "creep", "relaxation")
} | {"backlash": {"backlash": 2.5e-4}}


#: Rows measured at the end of a path that has begun before.
_LAST: Final = 20


def inside(
    kind: str, by_displacement: bool, seed: int, begun: bool = False, initial: bool = False
) -> dict[str, bool]:
    """Whether the interval of each parameter of a memory holds the truth, by its name.

    `begun` is whether the first rows of the path are lost, `initial` whether that state is fitted.
    """
    truth = _MEMORIES[kind]
    rng = np.random.default_rng([7, seed])
    start = {name: value * rng.uniform(0.7, 1.4) for name, value in truth.items()}
    # stiffness and gain are known: creep counts against the stiffness of the backbone
    robot = bs.load_robot("amouri2019").with_({E: 33e9})
    rows = ROWS[seed % len(ROWS)]
    data = table(by_displacement, kind, seed, rows, rows - _LAST if begun else 0)
    names = ["base", *truth, "gain" if by_displacement else E]
    if initial:
        at = "displacement" if by_displacement and kind != "creep" else "tension"
        names.append(f"initial_{at}")
    found = fit(robot, data, names, start=start, loss="linear")
    out = {}
    for name, value in truth.items():
        estimate = found[name]
        usual = value * estimate.value / found.values[name]  # in the estimate's unit
        out[name.rpartition(".")[2]] = bool(estimate.low <= usual <= estimate.high)
    return out


def main() -> None:
    given = [text for text in sys.argv[1:] if text != "--begun"]
    count = int(given[0]) if given else 200
    first = int(given[1]) if len(given) > 1 else 0
    begun = "--begun" in sys.argv
    warnings.simplefilter("ignore")
    for kind in _MEMORIES:
        by_displacement = kind in ("backlash", "creep", "friction")
        for initial in (False, True) if begun else (False,):
            held: dict[str, list[bool]] = defaultdict(list)
            for seed in range(first, first + count):
                for name, hit in inside(kind, by_displacement, seed, begun, initial).items():
                    held[name].append(hit)
            shares = {name: f"{np.mean(hits):.3f}" for name, hits in held.items()}
            how = ", initial state fitted" if initial else ", from home" if begun else ""
            print(f"{kind}{how}: {shares} of {count}", flush=True)


if __name__ == "__main__":
    main()
