"""Bowstring from Python: the same cases, and its performance targets.

Rows: one call of `bs.solve`; cold solves in one call of `bs.sweep`; a warm sweep of 17 tensions up
to the case's own; `bs.solve_batch` on all cores. Times are per solve, tip errors the case's own.
"""

from __future__ import annotations

import os
from functools import partial
from time import perf_counter

import numpy as np

import bowstring as bs
from benchmarks.cases import LOADED, Case, Solve, measure, median_ms, report, times_ms
from bowstring.robot.designs import Designs
from bowstring.statics.design_sweeps import sweep_designs

ROBOT = bs.load_robot("amouri2019")
SWEEP = 17
BATCH = 20_000
ROBOTS, MAPPED, TARGETS = 512, 10_000, 1000
RUNS = 30
FIGURE_TENSIONS = np.linspace(
    [0.0, 10.0, 5.0], [80.0, 10.0, 5.0], SWEEP
)  # as in the core's benches


def load(case: Case) -> bs.Load:
    return bs.Load(gravity=case.gravity, tip_force=case.tip_force)


def one_call(case: Case, elements: int = 1) -> Solve:
    def solve() -> np.ndarray:
        solution = bs.solve(
            ROBOT, case.tensions, load=load(case), model=bs.RodModel(elements=elements)
        )
        solution.raise_for_status()
        return 1e3 * solution.tip.position

    return solve


def many(function, fractions: np.ndarray, case: Case) -> Solve:
    """Tensions at the given fractions of the case's, the last of which is 1."""
    tensions = np.outer(fractions, case.tensions)

    def solve() -> np.ndarray:
        result = function(ROBOT, tensions, load=load(case))
        if not result.converged.all():
            raise RuntimeError(f"{(~result.converged).sum()} of {len(tensions)} did not converge")
        return 1e3 * result.tip_position[-1]

    return solve


SETTINGS = {
    "one call": (one_call, 1),
    "one call, elements=2": (partial(one_call, elements=2), 1),
    "one call, elements=8": (partial(one_call, elements=8), 1),
    "cold, in one sweep call": (
        partial(many, partial(bs.sweep, warm=False), np.ones(500)),
        500,
    ),
    "warm sweep of 17": (partial(many, bs.sweep, np.linspace(0, 1, SWEEP)), SWEEP),
    f"batch on {os.cpu_count()} cores": (
        partial(many, bs.solve_batch, np.linspace(0.5, 1, BATCH)),
        BATCH,
    ),
}


def displacement_loads() -> bs.Load:
    """Random displacements of tendon 1 up to 30 mm, the others lengthened, with a tip force."""
    rng = np.random.default_rng(0)
    first = rng.uniform(0.0, 0.03, BATCH)
    others = -0.5 * first - 0.002
    tip_force = np.column_stack([rng.uniform(-0.3, 0.3, (BATCH, 2)), np.zeros(BATCH)])
    displacements = np.column_stack([first, others, others])
    return bs.Load(displacements=displacements, gravity=(0, 0, -9.81), tip_force=tip_force)


def inverse_targets() -> np.ndarray:
    """Tips of `TARGETS` equilibria on a path of the tensions, under the load of the figures."""
    t = np.linspace(0.0, 1.0, TARGETS)[:, None]
    tensions = 30.0 + 25.0 * np.sin(2.0 * np.pi * t + np.array([0.0, 2.1, 4.2]))
    return bs.sweep(ROBOT, tensions, load=load(LOADED), disks=False).tip_position


def jax_over_batch() -> float:
    """Time of `jax.vmap` over `MAPPED` loads over that of the batch call; NaN without JAX.

    Both are the fastest of runs that alternate.
    """
    try:
        import jax
    except ImportError:
        return float("nan")
    import bowstring.jax

    jax.config.update("jax_enable_x64", True)
    tensions = np.random.default_rng(0).uniform(0.0, 40.0, (MAPPED, 3))
    solve = jax.jit(jax.vmap(bowstring.jax.Solver(ROBOT)))
    jax.block_until_ready(solve(tensions))
    times = []
    for _ in range(RUNS):
        start = perf_counter()
        jax.block_until_ready(solve(tensions))
        middle = perf_counter()
        bs.solve_batch(ROBOT, tensions, disks=False)
        times.append((middle - start, perf_counter() - middle))
    mapped, batch = np.min(times, axis=0)
    return float(mapped / batch)


def figures() -> dict[str, float]:
    """Times through Python on the load of the core's micro-benchmarks, in us."""
    solve = partial(bs.solve, ROBOT, FIGURE_TENSIONS[-1], load=load(LOADED))
    sweep = partial(bs.sweep, ROBOT, FIGURE_TENSIONS, load=load(LOADED))
    kirchhoff, cosserat = bs.RodModel("kirchhoff"), bs.RodModel("cosserat")
    many_tensions = np.tile(FIGURE_TENSIONS, (BATCH // SWEEP, 1))
    batch = partial(bs.solve_batch, ROBOT, many_tensions, model=kirchhoff, load=load(LOADED))
    displaced = partial(bs.solve_batch, ROBOT, load=displacement_loads(), disks=False)
    friction = Designs(
        ROBOT.with_({"segments.0.tendons.friction": 0.1}),
        {"segments.0.backbone.E": np.linspace(30e9, 40e9, ROBOTS)},
    )

    def fastest_sweep_us(model: bs.RodModel) -> float:  # as the core's, with which it is compared
        return 1e3 * min(times_ms(partial(sweep, model=model), 1.0))

    targets = inverse_targets()
    inverse = partial(bs.inverse_kinematics, ROBOT, load=load(LOADED))
    ramp = np.outer(np.linspace(0.0, 80.0, 51), [1.0, 0.0, 0.0])
    paths = partial(sweep_designs, friction, ramp)
    return {
        "one_call_kirchhoff": 1e3 * median_ms(partial(solve, model=kirchhoff), 1.0),
        "one_call_cosserat": 1e3 * median_ms(partial(solve, model=cosserat), 1.0),
        "warm17_kirchhoff": fastest_sweep_us(kirchhoff),
        "warm17_cosserat": fastest_sweep_us(cosserat),
        "batch_per_solve": 1e3 * median_ms(batch, 1.0) / len(many_tensions),
        "jax_over_batch": jax_over_batch(),
        "displacement_per_solve": 1e3 * median_ms(displaced, 1.0) / BATCH,
        "inverse_cold": 1e3 * median_ms(partial(inverse, targets[3 * len(targets) // 10]), 1.0),
        "inverse_on_path": 1e3 * median_ms(partial(inverse, targets), 1.0) / len(targets),
        "friction_per_step": 1e3 * median_ms(paths, 1.0) / (ROBOTS * len(ramp)),
    }


def main() -> None:
    """Measure and report."""
    results = measure({name: prepare for name, (prepare, _) in SETTINGS.items()})
    for result in results:
        if result.time_ms is not None:
            result.time_ms /= SETTINGS[result.setting][1]
    report(bs.__version__, results, figures=figures())


if __name__ == "__main__":
    main()
