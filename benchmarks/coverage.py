"""Coverage of the confidence intervals of a calibration: full fits to synthetic benches.

    python -m benchmarks.coverage [COUNT] [LOSS] [slack]

The virtual bench of `amouri2019`: 17 masses on cable 1, loading and unloading, 3 repeats, gravity,
friction 0.1, a backbone 3 % softer than in the robot file, a base that is displaced and tilted by
0.3 degrees, 0.02 mm noise. The path is solved once, noise is drawn for each bench; every bench is
fitted from the robot file, as by a user. All data are synthetic. About half a second for a fit.

`slack`: 12 rows of displacements of `amouri2019` with a tendon compliance of 0.2 mm/N and tendons 1
mm too short, fitted from 0.1 mm/N and 0 mm. In some rows tendons are at the limit of slack, and the
error has minima on either side. Two designs, 0.5 mm noise: `in turn`, each tendon shortened in
turn, and `one tendon`, whose rows hardly determine the offsets. One to four seconds for a fit.
"""

from __future__ import annotations

import math
import sys
import time
from dataclasses import replace

import numpy as np

import bowstring as bs
from bowstring.calibration.fitting import Fit, Loss, fit
from bowstring.calibration.observations import Data
from bowstring.data.rigid import Rigid
from bowstring.data.synthetic import STUDY, Mounting, set_up

NAMES = ["segments.0.backbone.E", "segments.0.tendons.friction", "base"]
#: Names of `NAMES`, the base by coordinate, in the units of the fit: GPa, 1, mm, deg.
TRUTH = np.array([0.97 * 35.0, 0.1, 1.0, -1.0, 2.0, 0.0, 0.3, 0.0])


def fits(count: int, loss: Loss, seed: int = 1) -> list[Fit]:
    """Fits to `count` benches that differ only in their noise."""
    robot = bs.load_robot("amouri2019")
    known = robot.with_({"gravity": STUDY["actual"].gravity})
    turn, shift = np.radians(TRUTH[5:]), 1e-3 * TRUTH[2:5]
    made = set_up(
        robot,
        STUDY["loads"],
        actual=replace(STUDY["actual"], changes={"segments.0.backbone.E": 1e9 * float(TRUTH[0])}),
        mounting=Mounting(Rigid.from_rotation_vector(turn, shift)),
    )
    rng = np.random.default_rng(seed)
    return [fit(known, made.measure(rng), NAMES, loss=loss) for _ in range(count)]


def inside(found: list[Fit]) -> np.ndarray:
    """Whether each bench's interval (count, parameters) contains the true value."""
    low = np.array([[e.low for e in each.estimates] for each in found])
    high = np.array([[e.high for e in each.estimates] for each in found])
    return np.asarray((low <= TRUTH) & (high >= TRUTH))


#: Displacements of the designs with tendons at the limit of slack (m), and the noise of a
#: coordinate (m).
SLACK = {
    "in turn": (
        np.concatenate(
            [np.outer(np.linspace(0, 0.02, 4), np.roll([1, -0.5, -0.5], i)) for i in range(3)]
        ),
        5e-4,
    ),
    "one tendon": (np.outer(np.linspace(0, 0.02, 12), [1.0, 0.0, 0.0]), 5e-4),
}
SLACK_NAMES = ["segments.0.tendons.compliance", "offset.tendons"]
#: mm/N, mm, mm, mm
SLACK_TRUTH = np.array([0.2, 1.0, 1.0, 1.0])


def slack_fits(
    displacements: np.ndarray, noise: float, count: int, loss: Loss, seed: int = 0
) -> list[Fit]:
    """Fits to tables with tendons at the limit of slack, which differ only in their noise."""
    robot = bs.load_robot("amouri2019").with_({SLACK_NAMES[0]: 1e-4})
    real = robot.with_({SLACK_NAMES[0]: 1e-3 * float(SLACK_TRUTH[0])})
    tips = bs.solve_batch(
        real, load=bs.Load(displacements=displacements + 1e-3 * SLACK_TRUTH[1:])
    ).tip_position
    rng = np.random.default_rng(seed)
    return [
        fit(
            robot,
            Data(points=tips + rng.normal(0, noise, tips.shape), displacements=displacements),
            SLACK_NAMES,
            loss=loss,
        )
        for _ in range(count)
    ]


def slack(count: int, loss: Loss) -> None:
    for name, (displacements, noise) in SLACK.items():
        began = time.perf_counter()
        found = slack_fits(displacements, noise, count, loss)
        spent = time.perf_counter() - began
        low = np.array([[e.low for e in each.estimates] for each in found])
        high = np.array([[e.high for e in each.estimates] for each in found])
        held = ((low <= SLACK_TRUTH) & (high >= SLACK_TRUTH)).mean(axis=0)
        across = sum("determine the parameters badly" in each.message for each in found)
        print(f"{name}: {count} synthetic tables, loss {loss}, {spent / count:.2f} s a fit")
        for k, parameter in enumerate(found[0].names):
            width = np.median(high[:, k] - low[:, k])
            print(f"  {parameter:30s} inside {100 * held[k]:5.1f} %, median width {width:.4g}")
        print(
            f"  not converged: {sum(not each.converged for each in found)}; intervals across "
            f"changes of sides: {across}"
        )


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    loss: Loss = "soft_l1" if "soft_l1" in sys.argv else "linear"
    if "slack" in sys.argv:
        slack(count, loss)
        return
    began = time.perf_counter()
    found = fits(count, loss)
    spent = time.perf_counter() - began
    share = inside(found).mean(axis=0)
    values = np.array([[e.value for e in each.estimates] for each in found])
    errors = np.array([[e.standard_error for e in each.estimates] for each in found])
    print(f"{count} synthetic benches, loss {loss}, {spent / count:.2f} s a fit")
    print(f"two standard errors of a share: {200 * math.sqrt(0.95 * 0.05 / count):.1f} %")
    print(f"{'parameter':30s} {'truth':>8s} {'mean':>10s} {'spread':>9s} {'std.err.':>9s} inside")
    spread = values.std(axis=0, ddof=1)
    for k, name in enumerate(found[0].names):
        print(
            f"{name:30s} {TRUTH[k]:8.3f} {values[:, k].mean():10.5f} {spread[k]:9.2g}"
            f" {errors[:, k].mean():9.2g} {100 * share[k]:5.1f} %"
        )
    free = 3 * int(found[0].used.sum()) - len(TRUTH)
    noise = STUDY["instrument"].noise
    chi = np.array([(each.residuals**2).sum() / noise**2 / free for each in found])
    print(
        f"residual over noise (root of reduced chi squared): mean {np.sqrt(chi).mean():.4f}, "
        f"from {np.sqrt(chi.min()):.3f} to {np.sqrt(chi.max()):.3f}"
    )
    shouted = sum("not noise" in each.message for each in found)
    print(
        f"not converged: {sum(not each.converged for each in found)}; called not noise: {shouted}"
    )


if __name__ == "__main__":
    main()
