"""Damaged run files are rejected with one sentence, before they are loaded."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bowstring.dynamics import netcdf
from bowstring.dynamics.run_file import read_run
from bowstring.errors import InputError
from bowstring.robot.reader import load_robot
from made_frames import made_file, made_records
from objects import refused

ROBOT = load_robot("amouri2019")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    file = tmp_path_factory.mktemp("run") / "run.nc"
    with made_file(file, ROBOT, {}) as run:
        run.append(made_records(ROBOT, np.array([0.01, 0.02])))
    return file.read_bytes()


def put(offset: int, value: int) -> Callable[[bytes], bytes]:
    return lambda data: data[:offset] + struct.pack(">i", value) + data[offset + 4 :]


def after(name: str, more: int, value: int) -> Callable[[bytes], bytes]:
    """Change the number at an offset after the first occurrence of a name."""
    word = struct.pack(">i", len(name)) + name.encode()

    def change(data: bytes) -> bytes:
        return put(data.index(word) + len(word) + -len(word) % 4 + more, value)(data)

    return change


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (put(4, 2**31 - 1), "is cut off"),  # numbers of records
        (put(4, -1), "it counts -1"),
        (put(8, 7), "a list begins with 7, not 10"),
        (put(12, 2**31 - 1), "a list of 2147483647 entries"),
        (put(12, 0), "a list begins with"),
        (put(16, 2**31 - 1), "a name of 2147483647 letters"),
        (put(16, 0), "a name of 0 letters"),
        (after("station", 0, 2**31 - 1), "has"),  # its length: that of a variable disagrees
        (after("station", 0, 0), "two dimensions grow"),
        (after("complete_to_s", 0, 99), "99 is no type of numbers"),
        (after("complete_to_s", 4, 2**31 - 1), "is cut off"),
        (after("position", 0, 30_000), "position has 30000 dimensions"),
        (after("position", 4, 77), "position has a dimension that is not there"),
        (lambda data: data[:3] + b"\x09" + data[4:], "its version of the format is 9"),
        (lambda data: data.replace(b"position", b"positi\0n"), "is not a name"),
        (lambda data: data.replace(b"moment", b"force\0"), "is not a name"),
    ],
)
def test_a_damaged_header(
    whole: bytes, tmp_path: Path, change: Callable[[bytes], bytes], says: str
) -> None:
    file = tmp_path / "run.nc"
    file.write_bytes(change(whole))
    with pytest.raises(InputError, match="cannot read the run") as caught:
        read_run(file)
    assert says in str(caught.value)


def test_variables_that_overlap(whole: bytes, tmp_path: Path) -> None:
    """Many variables at one position would need more memory than the file has bytes."""
    file = tmp_path / "run.nc"
    data = xr.Dataset({name: ("x", np.zeros(100)) for name in "abc"})
    data.to_netcdf(file, format="NETCDF3_64BIT")
    raw = file.read_bytes()
    begin = len(raw) - 2400
    assert raw.count(struct.pack(">q", begin + 800)) == 1
    file.write_bytes(raw.replace(struct.pack(">q", begin + 800), struct.pack(">q", begin)))
    refused("lies where something else does", lambda: read_run(file))


@pytest.mark.parametrize("form", ["NETCDF3_CLASSIC", "NETCDF3_64BIT", "NETCDF4", "NETCDF4_CLASSIC"])
def test_copies_by_other_programs_are_read(whole: bytes, tmp_path: Path, form: str) -> None:
    (tmp_path / "run.nc").write_bytes(whole)
    run = read_run(tmp_path / "run.nc")
    run.to_netcdf(tmp_path / "copy.nc", format=form)
    xr.testing.assert_equal(read_run(tmp_path / "copy.nc"), run)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda run: run.assign_attrs(schema_version="two"), "schema_version is 'two'"),
        (lambda run: run.assign_attrs(status=3.0), "status is"),
        (lambda run: run.assign_attrs(schema_version=99), "by a newer Bowstring"),
        (lambda run: run.assign(work=("disk", np.zeros(9))), "work has the axes disk"),
        (lambda run: run.assign(work=("time", np.array(["a"] * 2))), "work has the axes time"),
        (lambda run: xr.Dataset(run.variables), "not a run of Bowstring"),
    ],
)
@pytest.mark.parametrize("form", ["NETCDF3_64BIT", "NETCDF4"])
@pytest.mark.slow
def test_a_run_of_another_form(
    whole: bytes, tmp_path: Path, change: Callable[[xr.Dataset], xr.Dataset], says: str, form: str
) -> None:
    (tmp_path / "run.nc").write_bytes(whole)
    change(read_run(tmp_path / "run.nc").isel(time=slice(0, 2))).to_netcdf(
        tmp_path / "copy.nc", format=form
    )
    with pytest.raises(InputError) as caught:
        read_run(tmp_path / "copy.nc")
    assert says in str(caught.value)


def test_hdf5_with_impossible_sizes(tmp_path: Path) -> None:
    import netCDF4

    with netCDF4.Dataset(tmp_path / "run.nc", "w") as data:
        data.createDimension("x", 10**6)
        data.createVariable("a", "f8", ("x", "x"), chunksizes=(1000, 1000))
    refused(r"bytes cannot hold the 8e\+12 of its variables", lambda: read_run(tmp_path / "run.nc"))


def test_a_slow_hdf5_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "run.nc").write_bytes(netcdf.HDF5 + bytes(100))
    refused("it is damaged", lambda: read_run(tmp_path / "run.nc"))
    monkeypatch.setattr(netcdf, "_SECONDS", 0.02)
    monkeypatch.setattr(netcdf, "_SCRIPT", "while True: pass")
    refused("it is damaged: reading it does not end", lambda: read_run(tmp_path / "run.nc"))
    monkeypatch.setattr(netcdf, "_SECONDS", 10.0)
    monkeypatch.setattr(netcdf, "_SCRIPT", "import os; os.abort()")
    refused("it is damaged: it cannot be read", lambda: read_run(tmp_path / "run.nc"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")
def test_a_pipe_is_no_run(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "run.nc")
    refused("it is not a regular file", lambda: read_run(tmp_path / "run.nc"))
