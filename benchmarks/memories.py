"""Coverage of the intervals of memories: full fits to synthetic benches with known truth.

    python -m benchmarks.memories [COUNT] [FIRST SEED] [--begun]

The benches are those of `benchmarks.model_choice`: 60, 90 or 120 rows, one every 5 s, 0.1 mm noise,
backlash with a dead travel of 0.5 mm, friction 0.15, hysteresis, creep and relaxation with 30 s.
Each fit has the memory as unknown, beside the base and the modulus of the backbone or the gain, and
starts near the truth: this counts intervals, not searches. With --begun the path has begun 30 rows
before the first measured one; each bench is then fitted twice, from the home pose and with the
initial state as unknown. All data are synthetic.
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


#: Rows before the first measured one.
_BEFORE: Final = 30
_FROM_HOME: Final = (("", 0, False),)
_BEGUN: Final = (
    (", fitted from home", _BEFORE, False),
    (", initial state fitted", _BEFORE, True),
)


def inside(
    kind: str, by_displacement: bool, seed: int, before: int = 0, initial: bool = False
) -> dict[str, bool]:
    """Whether the interval of each parameter of a memory holds the truth, by its name.

    The path has rows `before` the first measured one; `initial` is whether that state is fitted.
    """
    truth = _MEMORIES[kind]
    rng = np.random.default_rng([7, seed])
    start = {name: value * rng.uniform(0.7, 1.4) for name, value in truth.items()}
    # stiffness and gain are known: creep counts against the stiffness of the backbone
    robot = bs.load_robot("amouri2019").with_({E: 33e9})
    data = table(by_displacement, kind, seed, ROWS[seed % len(ROWS)], before)
    names = ["base", *truth, "gain" if by_displacement else E]
    if initial:
        names.append("initial_displacement" if by_displacement else "initial_tension")
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
    begun = len(given) < len(sys.argv) - 1
    warnings.simplefilter("ignore")
    for kind in _MEMORIES:
        by_displacement = kind in ("backlash", "creep", "friction")
        for how, before, initial in _BEGUN if begun else _FROM_HOME:
            held: dict[str, list[bool]] = defaultdict(list)
            for seed in range(first, first + count):
                for name, hit in inside(kind, by_displacement, seed, before, initial).items():
                    held[name].append(hit)
            shares = {name: f"{np.mean(hits):.3f}" for name, hits in held.items()}
            print(f"{kind}{how}: {shares} of {count}", flush=True)


if __name__ == "__main__":
    main()
