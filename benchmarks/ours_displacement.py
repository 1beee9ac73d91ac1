"""Bowstring on the displacement-controlled robot: one call of `bs.solve`.

The reference tip of all errors is also ours, with elements=8; run.py compares it with the
independent one."""

from __future__ import annotations

from functools import partial

import bowstring as bs
from benchmarks.cases import LENGTH, report
from benchmarks.displacement import BY_TENSION, DISPLACEMENTS, SLACK, Found, measure

ROBOT = bs.load_robot("amouri2019")
SETTINGS = {"one call": 1, "one call, elements=2": 2, "one call, elements=4": 4}


def found(elements: int) -> Found:
    solution = bs.solve(
        ROBOT,
        load=bs.Load(
            displacements=DISPLACEMENTS, gravity=BY_TENSION.gravity, tip_force=BY_TENSION.tip_force
        ),
        model=bs.RodModel(elements=elements),
    ).raise_for_status()
    return 1e3 * solution.tip.position, solution.tensions[0]


def check() -> None:
    """Check that the displacements are those of 40 N, within a millionth of the length.

    That is far above what a change of the mesh moves (1e-8 m), and far below what a solver errs.
    """
    load = bs.Load(BY_TENSION.tensions, gravity=BY_TENSION.gravity, tip_force=BY_TENSION.tip_force)
    solution = bs.solve(ROBOT, load=load, model=bs.RodModel(elements=8)).raise_for_status()
    paid_out = solution.displacements() - [0.0, SLACK, SLACK]
    assert abs(paid_out - DISPLACEMENTS).max() < 1e-6 * LENGTH, (
        f"at 40 N the displacements are {paid_out}"
    )


def main() -> None:
    """Measure and report."""
    check()
    report(
        bs.__version__,
        measure({name: partial(partial, found, n) for name, n in SETTINGS.items()}),
        converged_mm=[float(x) for x in found(8)[0]],
    )


if __name__ == "__main__":
    main()
