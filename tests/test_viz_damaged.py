"""Damaged runs: no picture, file or view of numbers that are none."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import bowstring as bs
from bowstring.errors import InputError
from bowstring.integrations.gltf import write_glb
from bowstring.integrations.rerun import write_rerun
from bowstring.statics import fields
from bowstring.viz.animation import animate
from bowstring.viz.vtk import write_vtk
from made_frames import made_frames
from objects import refused

ROBOT = bs.load_robot("amouri2019")
RUN = fields.to_dataset(ROBOT, made_frames(ROBOT, np.array([0.0, 0.1, 0.25])), {})
WRITERS = {"run.glb": write_glb, "series": write_vtk, "run.gif": animate, "run.rrd": write_rerun}


def changed(name: str, value: object) -> xr.Dataset:
    found = RUN[name].to_numpy().astype(float)
    found.flat[-1] = value
    return RUN.assign({name: (RUN[name].dims, found)})


DAMAGED: dict[str, Callable[[], xr.Dataset]] = {
    "position holds numbers that are NaN": lambda: changed("position", np.nan),
    "disk_position holds numbers": lambda: changed("disk_position", 1e300),
    "tension holds numbers": lambda: changed("tension", -np.inf),
    "rotation holds numbers that are no": lambda: changed("rotation", 0.0),
    "disk_rotation holds numbers that are no": lambda: changed("disk_rotation", -1.0),
    "times do not increase": lambda: changed("time", 0.1),
    "module does not count the 9 modules": lambda: changed("module", 10),
    "it has no moment": lambda: RUN.drop_vars("moment"),
    r"position has the axes time \(3\), axis \(3\)": lambda: RUN.assign(
        position=RUN["position"][:, 0]
    ),
    r"position has the axes time \(3\), station \(45\), axis \(2\)": lambda: RUN.isel(
        axis=slice(0, 2)
    ),
    "it has not the 9 disks and 3 tendons": lambda: RUN.isel(disk=slice(1, 9)),
    "curvature holds <U": lambda: RUN.assign(curvature=RUN["curvature"].astype(str)),
}


@pytest.mark.parametrize("why", DAMAGED)
def test_damaged_runs_are_refused(why: str, tmp_path: Path) -> None:
    data = DAMAGED[why]()
    for name, write in WRITERS.items():
        with pytest.raises(InputError, match=f"^the run is damaged: .*{why}"):
            write(ROBOT, data, tmp_path / name)
    refused(f"^the run is damaged: .*{why}", lambda: bs.view(data))
    assert list(tmp_path.iterdir()) == []


def test_a_surface_needs_two_stations_in_a_module(tmp_path: Path) -> None:
    single = RUN.isel(station=slice(None, None, 5))
    for show in (lambda: write_glb(ROBOT, single, tmp_path / "run.glb"), lambda: bs.view(single)):
        refused("2 stations or more in a module", show)
