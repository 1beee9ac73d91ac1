"""The file of a run: complete at every moment, and equal to the dataset."""

from __future__ import annotations

import errno
import os
import re
import resource
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bowstring import load_robot
from bowstring.dynamics.run_file import RunFile, check_file, read_run
from bowstring.errors import InputError
from bowstring.statics import fields
from made_frames import made_file, made_frames, made_records
from objects import refused

ROBOT = load_robot("amouri2019")
SETTINGS = {"theory": "cosserat", "damping": None, "twist": True}


def chunk(number, times=20, robot=ROBOT):
    return made_records(robot, 0.01 * np.arange(number * times, (number + 1) * times))


@pytest.mark.parametrize("name", ["amouri2019", "rao2021"])
def test_a_run_in_chunks_is_the_dataset(tmp_path, name):
    robot = load_robot(name)
    path = tmp_path / "run.nc"
    run = made_file(path, robot, SETTINGS)
    for size in (range(0, 7), range(7, 8), range(8, 8), range(8, 30)):
        run.append(made_records(robot, 0.01 * np.array(size, dtype=float)))
    run.finish("stopped", "the smallest step failed")
    run.finish("converged")  # too late: nothing changes
    whole = fields.to_dataset(
        robot,
        made_frames(robot, 0.01 * np.arange(30)),
        SETTINGS,
        status="stopped",
        reason="the smallest step failed",
    )
    xr.testing.assert_identical(read_run(path), whole)
    # any reader of NetCDF
    xr.testing.assert_identical(xr.load_dataset(path), whole)
    xr.testing.assert_identical(xr.load_dataset(path, engine="scipy"), whole)
    assert os.listdir(tmp_path) == ["run.nc"]


def test_repr_names_the_file(tmp_path):
    path = tmp_path / "run.nc"
    run = made_file(path, ROBOT, SETTINGS)
    assert os.listdir(tmp_path) == []
    for i in range(3):
        run.append(chunk(i))
        now = read_run(path)
        assert now.attrs["status"] == "running" and now.attrs["reason"] == ""
        assert now.attrs["complete_to_s"] == run.complete_to == now.time[-1]
        assert now.sizes["time"] == 20 * (i + 1)
    run.finish()
    assert read_run(path).attrs["status"] == "converged"
    refused("finished", lambda: run.append(chunk(3)))


def test_a_run_without_output_times(tmp_path):
    with made_file(tmp_path / "run.nc", ROBOT, SETTINGS) as run:
        run.append(made_records(ROBOT, np.zeros(0)))
    empty = read_run(tmp_path / "run.nc")
    assert empty.attrs["status"] == "converged" and np.isnan(empty.attrs["complete_to_s"])
    assert empty.attrs["robot_hash"] == ROBOT.hash and not empty.sizes


@pytest.mark.parametrize(
    ("error", "status", "reason"),
    [
        (KeyboardInterrupt(), "interrupted", "stopped by the user"),
        (RuntimeError("tension 1 at 0.3 s is NaN — µ"), "failed", "tension 1 at 0.3 s is NaN — µ"),
        (RuntimeError("ä" * 2000), "failed", "ä" * 512),
    ],
)
def test_an_error_during_a_run_is_recorded(tmp_path, error, status, reason):
    path = tmp_path / "run.nc"
    with pytest.raises(type(error)), made_file(path, ROBOT, SETTINGS) as run:
        run.append(chunk(0))
        raise error
    data = read_run(path)
    assert (data.attrs["status"], data.attrs["reason"]) == (status, reason)
    assert data.sizes["time"] == 20


WRITER = """
    import sys, time
    import numpy as np
    sys.path.insert(0, sys.argv[2])
    from bowstring import load_robot
    from made_frames import made_file, made_records
    robot = load_robot("amouri2019")
    first = made_records(robot, 0.01 * np.arange(20))
    numbers = first.view(">f8").reshape(20, -1)
    print("ready", flush=True)
    run = made_file(sys.argv[1], robot, {})
    for i in range(1000):
        run.append(first)
        numbers[:, 0] += 0.2
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_killed_run_opens_and_says_where_it_ended(tmp_path):
    """SIGKILL at moments from the first chunk to long after it."""
    rng = np.random.default_rng(7)
    waits = [0.0, 0.001, 0.003, *rng.uniform(0.0, 0.05, 9)]
    ends = []
    for k, wait in enumerate(waits):
        path = tmp_path / f"run{k}.nc"
        arguments = [sys.executable, "-c", textwrap.dedent(WRITER), path, Path(__file__).parent]
        with subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None and child.stdout.readline() == "ready\n"
            while not path.exists():
                time.sleep(1e-4)
            time.sleep(wait)
            child.kill()
        assert child.returncode == -signal.SIGKILL
        data = xr.load_dataset(path)
        assert data.attrs["status"] == "running"
        end = data.attrs["complete_to_s"]
        ends.append(end)
        assert data.time[-1] == end and data.sizes["time"] % 20 == 0
        np.testing.assert_allclose(data.time, 0.01 * np.arange(data.sizes["time"]), atol=1e-9)
        # the chunks of the writer differ only in their time
        for name in ("position", "von_mises", "tension", "von_mises_max_place", "energy_balance"):
            rows = data[name].values.reshape(-1, 20, *data[name].shape[1:])
            assert np.array_equal(rows, np.broadcast_to(rows[0], rows.shape)), name
    assert len(set(map(str, ends))) > 5


def test_a_full_disk(tmp_path):
    path = tmp_path / "run.nc"
    run = made_file(path, ROBOT, SETTINGS)
    run.append(chunk(0))
    file = run._open()

    class Full:
        """Writes half a chunk, then nothing at the end of the file; the header fits."""

        half = True

        def write(self, content):
            if len(content) < 4096:
                return file.write(content)
            if self.half:
                self.half = False
                return file.write(content[: len(content) // 2])
            raise OSError(errno.ENOSPC, "No space left on device")

        def __getattr__(self, name):
            return getattr(file, name)

    run._file = Full()
    with pytest.raises(
        InputError, match=r"the drive is full; the file holds the run up to 0\.19 s"
    ):
        run.append(chunk(1))
    refused("finished", lambda: run.append(chunk(1)))
    data = read_run(path)
    assert data.attrs["status"] == "failed" and "the drive is full" in data.attrs["reason"]
    assert data.attrs["complete_to_s"] == data.time[-1] == 0.19
    expected = fields.to_dataset(ROBOT, made_frames(ROBOT, 0.01 * np.arange(20)), SETTINGS)
    xr.testing.assert_equal(data, expected)
    assert file.closed


LIMITED = """
    import sys
    sys.path.insert(0, sys.argv[2])
    from bowstring.errors import InputError
    from test_dynamics_run_file import ROBOT, chunk, made_file
    import resource
    run = made_file(sys.argv[1], ROBOT, {})
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]), resource.RLIM_INFINITY))
    try:
        for i in range(5):
            run.append(chunk(i))
    except InputError as error:
        print(error)
"""


@pytest.mark.parametrize(("limit", "times"), [(1_000_000, 60), (100_000, 0)])
@pytest.mark.slow
def test_a_limit_of_the_system(tmp_path, limit, times):
    """The kernel refuses in the middle of a chunk, including the first."""
    path = tmp_path / "run.nc"
    folder = Path(__file__).parent
    arguments = [sys.executable, "-c", textwrap.dedent(LIMITED), path, folder, str(limit)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=True)
    assert "larger than is allowed" in done.stdout
    data = read_run(path)
    assert data.attrs["status"] == "failed" and data.sizes.get("time", 0) == times
    assert os.listdir(tmp_path) == ["run.nc"]
    assert resource.getrlimit(resource.RLIMIT_FSIZE)[0] != limit


def test_too_little_disk_space_is_reported_before_the_work(tmp_path):
    need = 1e-9 * 10**11 * len(chunk(0)) / 20
    says = re.escape(f"needs {need:.2g} GB and the drive has ")
    refused(says, lambda: made_file(tmp_path / "run.nc", ROBOT, SETTINGS, times=10**11))
    assert os.listdir(tmp_path) == []


def test_writable_paths(tmp_path):
    with pytest.raises(InputError, match=r"the folder .*/no does not exist"):
        made_file(tmp_path / "no" / "run.nc", ROBOT, SETTINGS)
    (tmp_path / "text").write_text("mine")
    refused("/text is a file", lambda: check_file(tmp_path / "text" / "run.nc"))
    (tmp_path / "text.nc").write_text("mine")
    refused("existing files are not overwritten", lambda: check_file(tmp_path / "text.nc"))
    refused(r"its name must end in \.nc$", lambda: check_file(tmp_path / "run.csv"))
    refused("it is a folder; name a file", lambda: check_file(tmp_path))
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc")
    refused("existing files are not overwritten", lambda: check_file(tmp_path / "other.nc"))
    # a former run is replaced, once there is another
    for end in ("first", "second"):
        with made_file(tmp_path / "run.nc", ROBOT, SETTINGS) as run:
            if end == "second":
                assert read_run(tmp_path / "run.nc").attrs["status"] == "first"
            run.finish(end)
    assert read_run(tmp_path / "run.nc").attrs["status"] == "second"


@pytest.mark.parametrize("chunks", [1, 2])
@pytest.mark.parametrize("ending", [False, True])
@pytest.mark.parametrize("other", ["run", "text", None])
def test_a_second_run_into_the_same_file(tmp_path, chunks, ending, other):
    """Two runs to one file: the first reports it, and writes nothing to the file of the second."""
    path = tmp_path / "run.nc"
    first = made_file(path, ROBOT, SETTINGS)
    for i in range(chunks):
        first.append(chunk(i))
    if other == "run":
        second = made_file(path, ROBOT, SETTINGS)
        second.append(chunk(0))
    elif other == "text":
        (tmp_path / "new").write_text("mine")
        (tmp_path / "new").replace(path)
    else:
        path.unlink()
    why = "another file has taken its place" if other else "its file was removed"
    with pytest.raises(InputError, match=rf"the run in .*/run\.nc is lost: {why}"):
        if ending:
            first.finish()
        else:
            first.append(chunk(2))
    first.finish("failed")  # too late: nothing changes
    if other == "run":
        second.append(chunk(1))
        second.finish()
        data = read_run(path)
        assert data.attrs["status"] == "converged" and data.sizes["time"] == 40
    elif other == "text":
        assert path.read_text() == "mine"
    assert os.listdir(tmp_path) == ([path.name] if other else [])


@pytest.mark.parametrize(
    ("ending", "size"),
    [(False, 0), (False, 100), (False, -8), (False, 100_000_000), (True, 0), (True, -8)],
)
def test_a_file_truncated_by_another_process(tmp_path, ending, size):
    """As after ``> run.nc``: appended data would make no valid run."""
    path = tmp_path / "run.nc"
    run = made_file(path, ROBOT, SETTINGS)
    run.append(chunk(0))
    run.append(chunk(1))
    os.truncate(path, size if size >= 0 else path.stat().st_size + size)
    left = path.stat().st_size
    with pytest.raises(InputError, match=r"is lost: another program wrote to its file"):
        if ending:
            run.finish()
        else:
            run.append(chunk(2))
    run.finish("failed")  # too late: nothing changes
    assert path.stat().st_size == left


def test_a_disk_that_is_already_full(tmp_path, monkeypatch):
    """No file is left, and the message does not mention one."""

    def full(file):
        raise OSError(errno.ENOSPC, "No space left on device")

    run = made_file(tmp_path / "run.nc", ROBOT, SETTINGS)
    monkeypatch.setattr("bowstring.dynamics.run_file.folder_beside", full)
    refused(r"cannot write the run .* is full; nothing was written", lambda: run.append(chunk(0)))
    assert os.listdir(tmp_path) == []


def test_chunks_out_of_sequence(tmp_path):
    with made_file(tmp_path / "run.nc", ROBOT, SETTINGS) as run:
        run.append(chunk(1))
        refused(r"must increase: got 0 s after 0\.39 s", lambda: run.append(chunk(0)))
        with pytest.raises(InputError, match=r"records of this run have \d+ bytes each, got \d+"):
            run.append(chunk(2)[:-8])
        run.append(chunk(2))
    assert read_run(tmp_path / "run.nc").sizes["time"] == 40


def test_files_that_are_not_runs(tmp_path):
    refused("No such file", lambda: read_run(tmp_path / "no.nc"))
    (tmp_path / "text.nc").write_text("a run?")
    refused("not a NetCDF file", lambda: read_run(tmp_path / "text.nc"))
    (tmp_path / "cut.nc").write_bytes(b"CDF\x02\x00\x00")
    refused("cannot read the run", lambda: read_run(tmp_path / "cut.nc"))
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc")
    refused("not a run of Bowstring", lambda: read_run(tmp_path / "other.nc"))


@pytest.mark.parametrize("missing", [1, 200_000, None])
@pytest.mark.parametrize("status", ["converged", "running"])
def test_an_incomplete_copy_is_refused(tmp_path, missing, status):
    """Other readers read zeros for missing data."""
    run = made_file(tmp_path / "run.nc", ROBOT, SETTINGS)
    run.append(chunk(0))
    if status == "converged":
        run.finish()
    whole = (tmp_path / "run.nc").read_bytes()
    run.finish()
    size = run._header.size  # all of the header, and a little more
    kept = size + 100 if missing is None else len(whole) - missing
    assert size < kept < len(whole)
    for content, cut in ((whole, False), (whole[:kept], True)):
        (tmp_path / "copy.nc").write_bytes(content)
        if cut:
            refused(r"cannot read the run .* is cut off", lambda: read_run(tmp_path / "copy.nc"))
        else:
            assert read_run(tmp_path / "copy.nc").attrs["status"] == status


def test_a_file_cut_within_its_header_is_refused(tmp_path):
    run = made_file(tmp_path / "run.nc", ROBOT, SETTINGS)
    run.append(chunk(0))
    run.finish()
    header = (tmp_path / "run.nc").read_bytes()[: run._header.size]
    for kept in (*range(4, 300, 7), *range(300, len(header), 1001)):
        (tmp_path / "copy.nc").write_bytes(header[:kept])
        refused(r"cannot read the run ", lambda: read_run(tmp_path / "copy.nc"))


@pytest.mark.parametrize("step", ["_replace", "_write", "_open"])
@pytest.mark.parametrize("call", [1, 2, 3])
@pytest.mark.parametrize("after", [False, True])
def test_ctrl_c_within_a_write(tmp_path, monkeypatch, step, call, after):
    """Before or after a step of writing: the file holds whole chunks and the reason of its end."""
    path = tmp_path / "run.nc"
    calls = 0
    original = getattr(RunFile, step)

    def interrupted(self, *arguments):
        nonlocal calls
        calls += 1
        if calls == call and not after:
            raise KeyboardInterrupt
        result = original(self, *arguments)
        if calls == call and after:
            raise KeyboardInterrupt
        return result

    with pytest.raises(KeyboardInterrupt), made_file(path, ROBOT, SETTINGS) as run:
        with monkeypatch.context() as patch:
            patch.setattr(RunFile, step, interrupted)
            for i in range(3):
                run.append(chunk(i))
        raise KeyboardInterrupt  # where there are fewer calls
    data = read_run(path)
    assert data.attrs["status"] == "interrupted"
    if data.sizes:
        assert data.sizes["time"] % 20 == 0 and data.time[-1] == data.attrs["complete_to_s"]
        np.testing.assert_allclose(data.time, 0.01 * np.arange(data.sizes["time"]))
