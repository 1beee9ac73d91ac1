"""Jobs in blocks: what is refused, the folder, resuming, and the data set at the end."""

from __future__ import annotations

import errno
import math
import os
import pickle
import shutil
import signal
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from bowstring import interrupts
from bowstring.errors import InputError, NoSolutionError
from bowstring.jobs import (
    Coordinate,
    Job,
    RunInterrupted,
    Store,
    Variable,
    dataset,
    run,
    tasks,
    threads,
)

SHAPE = (7, 11, 13)  # 1001 points: 10 blocks of 100 and one of 1


def evaluate(first: int, count: int, calls: list[int] | None = None) -> dict[str, Any]:
    if calls is not None:
        calls.append(first // 100)
    point = np.arange(first, first + count)
    found = {"error": np.sin(point), "tip": np.outer(point, [1.0, 2, 3]), "status": point % 3}
    found["error"][point == 250] = np.nan
    return found


def made(**changes: Any) -> Job:
    job = Job(
        evaluate,
        axes=dict(zip(("length", "force", "seed"), SHAPE, strict=True)),
        variables={
            "error": Variable("m", "error of the tip"),
            "tip": Variable("m", "tip", {"axis": 3}, "float32"),
            "status": Variable("1", "status of the solve", dtype="int8"),
        },
        description={"robot": "amouri2019", "metric": {"name": "cc", "tolerance": 0.01}},
        block=100,
        coordinates={
            "length": Coordinate(np.linspace(0.1, 0.7, 7), "m", "length of the robot"),
            "axis": Coordinate(["x", "y", "z"]),
        },
    )
    if "axes" in changes:
        changes.setdefault("coordinates", {})
    return replace(job, **changes)


def content(store: Store) -> dict[str, bytes]:
    """Names and bytes of the files of all blocks."""
    return {file.name: file.read_bytes() for file in (store.folder / "blocks").iterdir()}


def refused(call: Callable[[], object], kind: type[Exception] = InputError) -> str:
    with pytest.raises(kind) as caught:
        call()
    said = str(caught.value)
    assert "\n" not in said
    return said


# -- the job -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"axes": {"a": 10**6, "b": 10**6}},
            "the job has 1e+12 points (21000 GB of results), at most 1e+09 are allowed; take fewer",
        ),
        ({"block": 0}, "block is 0, it must be a whole number from 1 to"),
        ({"block": 10**7}, "block is 10000000, it must be a whole number from 1 to 2380952"),
        (
            {"axes": {"a": 10**9}},
            "block is 100, it must be a whole number from 10000 to",
        ),
        ({"axes": {"a": 0}}, "size of the axis a is 0"),
        ({"axes": {}}, "axes is empty"),
        ({"axes": {"axis": 3}}, "two dimensions have the name axis"),
        ({"axes": {"tip": 3}}, "a variable and a dimension have the name tip"),
        ({"axes": {"tip force": 3}}, "name is 'tip force', it must be a word"),
        ({"coordinates": {"length": Coordinate([1.0])}}, "the coordinate length has 1 values"),
        ({"coordinates": {"width": Coordinate([1.0])}}, "the dimension width has no points"),
        ({"variables": {"a": Variable("m", "a", dtype="complex")}}, "dtype of a is 'complex'"),
        ({"description": {"robot": object()}}, "must be numbers and text"),
        ({"description": {"tolerance": math.nan}}, "must be numbers and text"),
        ({"evaluate": 3}, "evaluate is 3, it must be a function"),
    ],
)
def test_jobs_that_are_refused(changes: dict[str, Any], words: str) -> None:
    assert words in refused(lambda: made(**changes))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (lambda first, count: {"error": np.zeros(count)}, "evaluate gave error, it must give"),
        (lambda first, count: None, "evaluate gave None, it must give error, tip and status"),
        (
            lambda first, count: evaluate(first, count) | {"error": np.zeros(count + 1)},
            "evaluate gave error of shape (101,), not (100,)",
        ),
        (
            lambda first, count: evaluate(first, count) | {"status": np.zeros(count)},
            "evaluate gave status as float64, it must be int8",
        ),
    ],
)
def test_arrays_of_another_form_are_refused(given: Any, words: str, tmp_path: Path) -> None:
    said = refused(lambda: run(made(evaluate=given), tmp_path / "job"))
    assert said.startswith(f"block 1 of 11 (points 1 to 100) failed: {words}"), said


def test_a_job_is_known_by_what_its_results_depend_on() -> None:
    hashes = {
        made().hash,
        made(block=99).hash,
        made(axes=dict(zip(("force", "length", "seed"), (11, 7, 13), strict=True))).hash,
        made(description={"robot": "other"}).hash,
        made(coordinates={}).hash,
    }
    assert len(hashes) == 5
    assert made(evaluate=partial(evaluate, calls=[])).hash in hashes


# -- the folder --------------------------------------------------------------------------------


def test_results_are_complete_and_labelled(tmp_path: Path) -> None:
    shares: list[float] = []
    store = run(made(), tmp_path / "new" / "job", progress=shares.append)
    assert shares == pytest.approx([k / 11 for k in range(1, 12)])
    assert len(content(store)) == 11 and store.missing == []
    data = xr.load_dataset(store.save(tmp_path / "map.nc"))
    check_data(data)
    assert list(data.axis.values) == ["x", "y", "z"]
    found, expected = store.read(95, 310), evaluate(95, 310)
    for name, array in found.items():
        np.testing.assert_array_equal(array, expected[name].astype(array.dtype))
    store.save(tmp_path / "map.nc")  # its own file is replaced
    assert os.listdir(store.folder / "blocks") and not list(store.folder.glob(".*"))


def check_data(data: xr.Dataset) -> None:
    expected = evaluate(0, 1001)
    assert data.error.dims == ("length", "force", "seed")
    assert data.tip.dims == ("length", "force", "seed", "axis")
    np.testing.assert_array_equal(data.error, expected["error"].reshape(SHAPE))
    np.testing.assert_array_equal(data.tip, expected["tip"].reshape(*SHAPE, 3))
    np.testing.assert_array_equal(data.status, expected["status"].reshape(SHAPE))
    assert data.error.attrs == {"units": "m", "long_name": "error of the tip"}
    assert data.length.attrs == {"units": "m", "long_name": "length of the robot"}
    np.testing.assert_array_equal(data.length, np.linspace(0.1, 0.7, 7))
    assert data.attrs["robot"] == "amouri2019" and "tolerance" in data.attrs["metric"]
    assert data.attrs["job_hash"] == made().hash


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
def test_results_as_zarr(tmp_path: Path) -> None:
    pytest.importorskip("zarr", exc_type=ImportError)
    store = run(made(axes={"length": 7, "other": 143}), tmp_path / "job")
    for _ in range(2):  # its own folder is replaced
        place = store.save(tmp_path / "map.zarr")
    data = xr.open_zarr(place)
    assert data.error.encoding["chunks"] == (1, 100)
    expected = evaluate(0, 1001)["error"].reshape(7, 143)
    np.testing.assert_array_equal(data.error, expected)
    run(made(), tmp_path / "all").save(tmp_path / "map.zarr")
    check_data(xr.open_zarr(tmp_path / "map.zarr"))
    (tmp_path / "my.zarr").mkdir()
    (tmp_path / "my.zarr" / "file").touch()
    assert "not overwritten" in refused(lambda: store.save(tmp_path / "my.zarr"))


def test_zarr_without_its_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zarr", None)
    store = run(made(), tmp_path / "job")
    said = refused(lambda: store.save(tmp_path / "map.zarr"))
    assert "need zarr" in said and "pip install 'bowstring[cluster]'" in said


def test_saving_needs_all_blocks_and_a_free_name(tmp_path: Path) -> None:
    store = Store(tmp_path / "job", made())
    said = refused(lambda: store.save(tmp_path / "map.nc"))
    assert said.startswith("11 of 11 blocks are missing in ")
    assert "block 3 of 11 (points 201 to 300) is missing" in refused(lambda: store.read(200, 1))
    assert not (tmp_path / "job").exists()
    store = run(made(), tmp_path / "job")
    assert ".nc or .zarr" in refused(lambda: store.save(tmp_path / "map.h5"))
    (tmp_path / "map.nc").write_text("mine")
    assert "not overwritten" in refused(lambda: store.save(tmp_path / "map.nc"))
    assert "the points 1000 to 1001 are asked for" in refused(lambda: store.read(1000, 2))


@given(st.lists(st.integers(1, 6), min_size=1, max_size=4), st.integers(1, 50))
def test_parts_cover_a_grid_in_the_order_of_its_points(sizes: list[int], most: int) -> None:
    points = np.arange(math.prod(sizes)).reshape(sizes)
    found = []
    for index, shape in dataset._parts(sizes, most):
        part = points[index]
        assert part.shape == shape and part.size <= most
        found += part.ravel().tolist()
    assert found == list(range(points.size))


# -- resuming ----------------------------------------------------------------------------------


def test_only_missing_and_damaged_blocks_are_computed(tmp_path: Path) -> None:
    store = run(made(), tmp_path / "job")
    before, files = content(store), sorted((store.folder / "blocks").iterdir())
    files[2].unlink()
    files[4].write_bytes(files[4].read_bytes()[:-1])
    bits = bytearray(files[6].read_bytes())
    bits[-200] ^= 1
    files[6].write_bytes(bits)
    files[8].replace(files[8].with_name(files[8].name.replace("000009", "000003")))
    (store.folder / "blocks" / "mine.txt").touch()
    assert "is damaged; run the job again" in refused(lambda: store.read(400, 1))

    calls: list[int] = []
    job = made(evaluate=partial(evaluate, calls=calls))
    assert Store(tmp_path / "job", job).damaged == (2, 4, 6)
    store = run(job, tmp_path / "job")
    assert calls == [2, 4, 6, 8]
    (store.folder / "blocks" / "mine.txt").unlink()
    assert content(store) == before
    run(job, tmp_path / "job")
    assert calls == [2, 4, 6, 8]


@pytest.mark.parametrize(
    ("changes", "difference"),
    [
        ({"block": 50}, "block is 100 and not 50"),
        (
            {"description": {"robot": "amouri2019", "metric": {"name": "cc", "tolerance": 0.02}}},
            "description.metric.tolerance is 0.01 and not 0.02",
        ),
        ({"description": {"robot": "amouri2019"}}, "description.metric is not in this one"),
        (
            {"axes": {"length": 7, "force": 11}},
            "axes is [['length', 7], ['force', 11], ['seed', 13]] and not ",
        ),
    ],
)
def test_a_folder_of_another_job_is_refused(
    changes: dict[str, Any], difference: str, tmp_path: Path
) -> None:
    store = run(made(), tmp_path / "job")
    before = content(store)
    said = refused(lambda: run(made(**changes), tmp_path / "job"))
    assert f"it holds blocks of another job, whose {difference}" in said
    assert said.endswith("; name another folder")
    assert content(store) == before


def test_folders_that_cannot_be_used(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "it is a file" in refused(lambda: run(made(), tmp_path / "file"))
    assert "it holds files but no blocks" in refused(lambda: run(made(), tmp_path))
    (tmp_path / "job").mkdir()
    (tmp_path / "job" / "job.json").write_text("{}")
    assert "job.json in it is damaged" in refused(lambda: run(made(), tmp_path / "job"))


def test_enormous_files_of_a_folder_are_not_loaded(tmp_path: Path) -> None:
    store = run(made(), tmp_path / "job")
    before = content(store)
    file = min((store.folder / "blocks").iterdir())
    os.truncate(file, 2_000_000_000)  # it takes no room on the disk
    tracemalloc.start()
    assert Store(store.folder, made()).damaged == (0,)
    assert content(run(made(), store.folder)) == before
    os.truncate(store.folder / "job.json", 2_000_000_000)
    said = refused(lambda: run(made(), store.folder))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert "job.json in it is damaged: it is larger than 10" in said
    assert most < 150_000_000


@pytest.mark.skipif(os.name == "nt", reason="needs locks of files")
def test_a_finished_job_is_read_from_a_drive_that_takes_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = run(made(), tmp_path / "job").read(0, 1001)
    monkeypatch.setattr("bowstring.files.atomic_io._takes_files", lambda folder: False)
    np.testing.assert_array_equal(run(made(), tmp_path / "job").read(0, 1001)["tip"], whole["tip"])
    next((tmp_path / "job" / "blocks").iterdir()).unlink()
    with pytest.raises(InputError, match=f"the folder {tmp_path} may not be written"):
        run(made(), tmp_path / "job")


def test_two_runs_do_not_share_a_folder(tmp_path: Path) -> None:
    with Store(tmp_path / "job", made()).writing():
        said = refused(lambda: run(made(), tmp_path / "job"))
    assert "another run writes to it" in said
    run(made(), tmp_path / "job")


# -- what stops it -----------------------------------------------------------------------------


def test_a_full_drive_keeps_what_is_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = Path.write_bytes

    def write(path: Path, data: bytes) -> int:
        if len(list((tmp_path / "job" / "blocks").iterdir())) == 4:
            whole(path, data[:50])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return whole(path, data)

    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", write)
        said = refused(lambda: run(made(), tmp_path / "job"))
    assert said == (
        f"cannot write block 5 of 11 (points 401 to 500): the drive is full; 4 of 11 blocks are "
        f"kept in {tmp_path / 'job'}, and the same job goes on from there; make room"
    )
    assert not list((tmp_path / "job").glob(".*"))
    assert content(run(made(), tmp_path / "job")) == content(run(made(), tmp_path / "other"))


def test_no_room_is_said_before_the_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = shutil.disk_usage(tmp_path)._replace(free=60_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda place: free)
    said = refused(lambda: run(made(), tmp_path / "job"))
    assert "it needs 6.61e-05 GB and the drive has 6e-05 GB free" in said
    assert not (tmp_path / "job").exists()


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        (InputError("tensions is wrong"), InputError, "failed: tensions is wrong; 2 of 11"),
        (ZeroDivisionError("by zero"), NoSolutionError, "failed: ZeroDivisionError: by zero; 2"),
    ],
)
def test_a_block_that_fails_is_named(
    error: Exception, kind: type[Exception], words: str, tmp_path: Path
) -> None:
    def fails(first: int, count: int) -> dict[str, Any]:
        if first == 200:
            raise error
        return evaluate(first, count)

    said = refused(lambda: run(made(evaluate=fails), tmp_path / "job"), kind)
    assert said.startswith("block 3 of 11 (points 201 to 300) " + words)
    run(made(), tmp_path / "job")


def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    def stopped(first: int, count: int) -> dict[str, Any]:
        if first == 300:
            signal.raise_signal(signal.SIGINT)
        return evaluate(first, count)

    interrupts.listen()
    with pytest.raises(RunInterrupted, match=r"3 of 11 blocks are kept in .* goes on") as caught:
        run(made(evaluate=stopped), tmp_path / "job")
    assert not interrupts.pending()
    assert caught.value.store.missing == list(range(3, 11))
    calls: list[int] = []
    run(made(evaluate=partial(evaluate, calls=calls)), tmp_path / "job")
    assert calls == list(range(3, 11))


def test_ctrl_c_while_a_block_is_written_keeps_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = Path.write_bytes

    def write(path: Path, data: bytes) -> int:
        signal.raise_signal(signal.SIGINT)
        return whole(path, data)

    monkeypatch.setattr(Path, "write_bytes", write)
    with pytest.raises(RunInterrupted, match="1 of 11 blocks are kept") as caught:
        run(made(), tmp_path / "job")
    again = pickle.loads(pickle.dumps(caught.value))
    assert type(again) is RunInterrupted and str(again) == str(caught.value)
    assert again.store.missing == caught.value.store.missing


def slowly(first: int, count: int) -> dict[str, Any]:
    time.sleep(0.05)
    return evaluate(first, count)


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_run_killed_twice_goes_on(tmp_path: Path) -> None:
    """SIGKILL at any moment: every block is there once at the end, and the numbers are the same."""
    code = (
        "import test_jobs as t, pathlib\n"
        f"t.run(t.made(evaluate=t.slowly, block=20), pathlib.Path({str(tmp_path / 'job')!r}))"
    )
    blocks = tmp_path / "job" / "blocks"
    for target in (10, 30, None):
        with subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parent) as process:
            while process.poll() is None:
                if target and blocks.exists() and len(list(blocks.iterdir())) >= target:
                    process.kill()
                time.sleep(0.01)
        assert process.returncode == (-signal.SIGKILL if target else 0)
    assert not list((tmp_path / "job").glob(".*"))
    numbers = sorted(int(file.name.split("-")[1]) for file in blocks.iterdir())
    assert numbers == list(range(1, 52))
    store = Store(tmp_path / "job", made(block=20))
    assert content(store) == content(run(made(block=20), tmp_path / "other"))


# -- as tasks of a cluster, without one --------------------------------------------------------


def test_threads_of_a_block() -> None:
    cloudpickle = pytest.importorskip("cloudpickle")
    assert threads() == 0
    payload = cloudpickle.dumps(made())
    try:
        assert tasks._compute(payload, tasks.MADE_BY, 3) == made().compute(3)
        assert threads() == 1
    finally:
        del tasks._task.threads


def test_a_worker_of_another_version_is_refused() -> None:
    other = tasks.MADE_BY | {"bowstring": "0.0.1"}
    assert "the job 0.0.1" in refused(lambda: tasks._compute(b"", other, 0))


def test_jobs_that_cannot_be_sent() -> None:
    pytest.importorskip("cloudpickle")
    lock = threading.Lock()
    said = refused(lambda: tasks._pickled(made(evaluate=lambda f, n: lock)))
    assert said.startswith("evaluate cannot be sent to a cluster: TypeError: ")
    large = partial(evaluate, calls=np.zeros(2_000_000))
    assert "evaluate takes 16 MB" in refused(lambda: tasks._pickled(made(evaluate=large)))


# -- addresses of a cluster --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("address", "words"),
    [
        ("tls://127.0.0.1:1", "tls needs certificates"),
        ("wss://127.0.0.1:1", "wss needs certificates"),
        ("inproc://127.0.0.1/1", "give the address tcp://HOST:PORT"),
        ("none://127.0.0.1:1", "unknown address scheme"),
        ("", "missing port number"),
    ],
)
def test_an_address_without_a_scheduler_is_refused_at_once(
    tmp_path: Path, address: str, words: str
) -> None:
    pytest.importorskip("distributed", exc_type=ImportError)
    began = time.monotonic()
    said = refused(lambda: run(made(), tmp_path / "job", address))
    assert time.monotonic() - began < 5.0  # a client that fails takes 20 s to go
    assert said.startswith(f"cannot connect to the Dask scheduler {address}: ") and words in said
