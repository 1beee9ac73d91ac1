"""Coverage of the interval of a stiffness beside zeros, noise and spikes of sensors.

    python -m benchmarks.sensors [COUNT] [FIRST SEED] [ROBOT]

Each bench is a table as the program of a test stand writes it: 8 rows without load, from which the
zeros are read, then 24 rows of random loads. Each load cell or encoder has a zero and noise that
the fit does not know. In half of the rows of load cells one tendon has no load, so that noise about
zero must be recognised. Half of the benches have one to three spikes of 2 to 30 times the noise of
their channel, in any row, command or coordinate of the tip; half of these have one more of the
largest number of a device. The modulus differs by up to 10 % from that of the robot file.

Counted are fits within 1 % of the truth, those whose interval holds it, and those whose error is
more than twice the half width of the interval, without a doubt that says so. A refused fit is
neither right nor does it hold the truth. All data are synthetic. Half a second for a fit.
"""

from __future__ import annotations

import sys
import tempfile
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

import bowstring as bs
from bowstring.calibration.table_fit import Calibration, calibrate
from bowstring.constant_curvature import RobotArcs
from bowstring.data import read_measurements
from bowstring.errors import BowstringError

Floats = NDArray[np.float64]
Sensors = Literal["load cells, rod", "load cells, arc", "encoders, rod"]
Spikes = Literal["none", "some", "device"]

SPIKES: Final[tuple[Spikes, ...]] = ("none", "some", "none", "device")
KINDS: Final[tuple[Sensors, ...]] = ("load cells, rod", "load cells, arc", "encoders, rod")
E: Final = "segments.*.backbone.E"
UNLOADED: Final = 8
"""Rows without load, from which the zeros are read."""
ROWS: Final = 32
"""All rows."""
RANGE: Final = {"amouri2019": 25.0, "rao2021": 1.0}
"""Largest tension of a robot, N."""
COMMAND: Final = 2e-3
"""Noise of a command over its range."""
TIP: Final = 3e-4
"""Noise of a coordinate of the tip over the length of the robot."""
DEVICE: Final = 4095.0
"""Largest number of a device of 12 bits."""


@dataclass(frozen=True)
class Bench:
    """A table, and what the fit should find."""

    robot: bs.Robot
    head: str
    table: Floats
    truth: float
    """True modulus, GPa."""
    arc: bool

    def fit(self) -> Calibration:
        """Fit the modulus to the table, as a user does."""
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "bench.csv"
            np.savetxt(path, self.table, "%.6g", ",", header=self.head, comments="")
            data = read_measurements(path, self.robot)
        return calibrate(self.robot, data, [E], model="arc" if self.arc else None)


def bench(name: str, kind: Sensors, spikes: Spikes, seed: int) -> Bench:
    """Make one bench of a robot."""
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    robot, high = bs.load_robot(name), RANGE[name]
    tendons, path = len(robot.tendons.pitch_radius_m), "segments.*.tendons"
    by_displacement = kind == "encoders, rod"
    loads = high * rng.uniform(0.0, 1.0, (ROWS, tendons))
    if by_displacement:  # all tendons taut, and compliant, as else displacements tell no stiffness
        loads += 0.2 * high
        soft = 0.3 * robot.tendons.pitch_radius_m[0] / high
        robot = robot.with_({f"{path}.compliance": soft, f"{path}.pretension": 0.2 * high})
    else:
        rest = rng.random(ROWS) < 0.5
        loads[rest, rng.integers(0, tendons, rest.sum())] = 0.0
    loads[:UNLOADED] = 0.2 * high if by_displacement else 0.0
    shift = rng.uniform(0.9, 1.1)
    truth = shift * robot.segments[0].backbone.E / 1e9
    actual = robot.with_({E: 1e9 * truth})
    if kind == "load cells, arc":
        tips = RobotArcs.from_tensions(actual, loads).tip.position
    else:
        solved = bs.solve_batch(actual, loads)
        tips = solved.tip_position
        if by_displacement:
            loads = 1e3 * solved.displacements()
    unit = np.ptp(loads) if by_displacement else high
    deviation = np.repeat([COMMAND * unit, 1e3 * TIP * robot.length], [tendons, 3])
    table = np.hstack([loads, 1e3 * tips])
    table += deviation * rng.normal(size=table.shape)
    table[:, :tendons] += unit / 3 * rng.uniform(-1, 1, tendons)
    for _ in range(rng.integers(1, 4) if spikes != "none" else 0):
        k = rng.integers(table.shape[1])
        table[rng.integers(ROWS), k] += deviation[k] * rng.choice([-1, 1]) * rng.uniform(2, 30)
    if spikes == "device":
        table[rng.integers(ROWS), rng.integers(tendons)] = DEVICE
    kind_of, unit_of = ("displacement", "mm") if by_displacement else ("tension", "N")
    columns = [f"{kind_of}_{k + 1}_{unit_of}" for k in range(tendons)]
    head = f"# source: synthetic\n# zero: rows 1-{UNLOADED}\n"
    head += ",".join([*columns, "tip_x_mm", "tip_y_mm", "tip_z_mm"])
    return Bench(robot, head, table, truth, kind == "load cells, arc")


def outcome(made: Bench) -> tuple[bool, bool, float, bool]:
    """Whether a fit is right, covers and is silently off; third, its error in standard errors."""
    try:
        fitted = made.fit()
    except BowstringError:
        return False, False, np.nan, False
    modulus = fitted.fit[E]
    error = modulus.value - made.truth
    far = abs(error) > modulus.high - modulus.low
    return (
        abs(error) <= 0.01 * made.truth,
        modulus.low <= made.truth <= modulus.high,
        error / modulus.standard_error,
        far and fitted.fit.converged and not fitted.doubts,
    )


def main() -> None:
    name = next((text for text in sys.argv[1:] if text in RANGE), "amouri2019")
    count, first = (int(text) for text in [*[t for t in sys.argv[1:] if t != name], "200", "0"][:2])
    found: dict[tuple[str, str], list[tuple[bool, bool, float, bool]]] = {}
    for seed in range(first, first + count):
        kind, spikes = KINDS[seed % len(KINDS)], SPIKES[seed // len(KINDS) % len(SPIKES)]
        one = outcome(bench(name, kind, spikes, seed))
        for key in product((kind, "all"), (spikes, "all")):
            found.setdefault(key, []).append(one)
    print(f"{count} synthetic benches of {name} from seed {first}")
    print("sensors          spikes  benches  within 1 %  interval holds  mean square  silently off")
    for key in sorted(found):
        right, inside, over, silent = np.array(found[key], float).T
        print(
            f"{key[0]:16s} {key[1]:7s} {len(right):7d} {100 * right.mean():9.1f} % "
            f"{100 * inside.mean():13.1f} % {np.nanmean(over**2):12.2f} {silent.sum():13.0f}"
        )


if __name__ == "__main__":
    main()
