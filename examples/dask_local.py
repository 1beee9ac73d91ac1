"""Solve 100 000 loads on two Dask processes, and open the result: python dask_local.py [FOLDER]

Needs the extra: pip install 'bowstring[cluster]'. Stop it by Ctrl-C and start it again with the
same folder: it goes on. Replace `LocalCluster` by your scheduler's address to use a cluster.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
import xarray as xr
from distributed import LocalCluster

import bowstring as bs
from bowstring.jobs import Coordinate, Job, Variable, run, threads

FORCES = np.linspace(-0.5, 0.5, 250)  # transverse tip force, N
TENSIONS = np.linspace(0, 60, 400)  # tension of tendon 1, N


def evaluate(first: int, count: int) -> dict[str, np.ndarray]:
    """The tip for some of the points; a worker calls it for each of its blocks."""
    force, tension = np.unravel_index(np.arange(first, first + count), (250, 400))
    none = np.zeros(count)
    load = bs.Load(tip_force=np.column_stack([none, FORCES[force], none]))
    tensions = np.column_stack([TENSIONS[tension], none, none])
    robot = bs.load_robot("amouri2019")
    found = bs.solve_batch(robot, tensions, load=load, disks=False, threads=threads())
    return {"tip": found.tip_position, "converged": found.converged}


def main(folder: Path) -> None:
    """Run the job, or what is missing of it, and show the map."""
    robot = bs.load_robot("amouri2019")
    job = Job(
        evaluate,
        axes={"force": 250, "tension": 400},
        variables={
            "tip": Variable("m", "tip position", dims={"axis": 3}),
            "converged": Variable("1", "1 where an equilibrium was found", dtype="int8"),
        },
        description={"robot": robot.name, "robot_hash": robot.hash, "gravity": "none"},
        block=5000,
        coordinates={
            "force": Coordinate(FORCES, "N", "transverse tip force along y"),
            "tension": Coordinate(TENSIONS, "N", "tension of tendon 1"),
            "axis": Coordinate(["x", "y", "z"]),
        },
    )
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        store = run(job, folder / "job", cluster.scheduler_address)
    with xr.open_dataset(store.save(folder / "map.nc")) as data:
        tip = data.tip.sel(tension=60, axis="y")
        print(f"{data.converged.size} loads, {int(data.converged.sum())} with an equilibrium")
        print(f"at 60 N the tip is at y = {float(tip.min()):.3f} to {float(tip.max()):.3f} m")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as made:
            main(Path(made))
