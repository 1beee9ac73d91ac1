"""Many motions at once: real-time factor, and error by the time step.

    python -m benchmarks.motions [--count 256] [--threads 0]

The built-in robot is under gravity (modal damping ratio 0.05). The tensions of all tendons jump
to random values in each control period of 20 ms: from 0 to 60 N (hard), or by at most 4 N from the
last ones (smooth). The real-time factor is the time simulated by all motions together over the
wall time, measured values included; where other work disturbs, that over the processor time is
nearer to that of an idle machine. The error is that of the tip of 8 motions over 2 s, over the
length, against `simulate` at its default tolerance.
"""

from __future__ import annotations

import argparse
import os
import time

import numpy as np

import bowstring as bs
from bowstring.dynamics import Motions, Table

PERIOD = 0.02
PERIODS = 100
CHECKED = 8
TOP = 60.0


def tensions(kind: str, count: int) -> np.ndarray:
    """Tensions (K + 1, N, 3) in N, the first row those at rest."""
    random = np.random.default_rng(0)
    if kind == "hard":
        return random.uniform(0, TOP, (PERIODS + 1, count, 3))
    rows = [random.uniform(0, TOP, (count, 3))]
    for _ in range(PERIODS):
        rows.append(np.clip(rows[-1] + random.uniform(-4, 4, (count, 3)), 0, TOP))
    return np.array(rows)


def expected(robot: bs.Robot, rows: np.ndarray) -> np.ndarray:
    """Tips (K, 3) of one motion by `simulate`."""
    times = PERIOD * np.arange(len(rows))
    found = bs.modes(robot, [0, 0, 0], count=12).frequency_hz * 2 * np.pi
    slow, fast = found[0], found[found >= 2 * found[0]][0]
    damping = bs.Integrator(
        mass_damping=0.1 * slow * fast / (slow + fast), material_damping=0.1 / (slow + fast)
    )
    run = bs.simulate(
        robot,
        Table(np.repeat(times, 2)[1:-1], np.repeat(rows[1:], 2, axis=0)),
        float(times[-1]),
        start=bs.Start(bs.Load(rows[0])),
        integrator=damping,
        output=bs.Output(every=PERIOD, points=0),
    )
    return run.raise_for_status().tip_position[1:]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=256)
    parser.add_argument("--threads", type=int, default=0)
    given = parser.parse_args()
    cores = given.threads or len(os.sched_getaffinity(0))
    robot = bs.load_robot("amouri2019", {"gravity": "0 0 -9.81"})
    print(f"{given.count} motions of {robot.name}, {cores} threads; control period 20 ms")
    print("tensions   dt ms   x real time   by processor time   repeated   rms %   max %")
    for kind in ("smooth", "hard"):
        rows = tensions(kind, given.count)
        checked = min(CHECKED, given.count)
        tips = np.stack([expected(robot, rows[:, i]) for i in range(checked)], axis=1)
        for dt in (4e-3, 2e-3, 1e-3):
            integrator = bs.Integrator(dt=dt, modal_damping=0.05)
            motions = Motions(robot, given.count, integrator=integrator, threads=given.threads)
            motions.reset(tensions=rows[0])
            found = []
            wall, used = time.perf_counter(), time.process_time()
            for row in rows[1:]:
                found.append(motions.step(row).tip_position)
            wall, used = time.perf_counter() - wall, time.process_time() - used
            simulated = given.count * PERIODS * PERIOD
            error = np.linalg.norm(np.array(found)[:, :checked] - tips, axis=2) / robot.length
            share = motions.repeated / (given.count * PERIODS)
            print(
                f"{kind:8}{1e3 * dt:8.3g}{simulated / wall:14.0f}{cores * simulated / used:20.0f}"
                f"{share:11.2%}{100 * np.sqrt((error**2).mean()):8.3f}{100 * error.max():8.3f}"
            )


if __name__ == "__main__":
    main()
