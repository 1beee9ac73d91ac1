"""Parallel work: every item once, errors reported, no process left running."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from bowstring import processes, threads


@pytest.fixture(autouse=True)
def two_cores_beside_jax(monkeypatch: pytest.MonkeyPatch) -> None:
    """Other tests may have imported JAX, beside which no process is forked."""
    monkeypatch.setattr(processes, "_WITH_THREADS", ())
    monkeypatch.setattr(threads, "cores", lambda: 2)


@pytest.fixture(params=[1, 2, 3])
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(threads, "cores", lambda: request.param)
    return int(request.param)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_each_item_is_done(cores: int, count: int, tmp_path: Path) -> None:
    reported: list[float] = []
    processes.for_each(
        range(count), lambda i: (tmp_path / str(i)).touch(exist_ok=False), notify=reported.append
    )
    assert sorted(int(p.name) for p in tmp_path.iterdir()) == list(range(count))
    assert reported == sorted(reported) and all(0.0 <= share < 1.0 for share in reported)


@pytest.mark.parametrize("bad", [0, 1, 4])
def test_an_error_is_raised_in_the_parent(cores: int, bad: int) -> None:
    def do(i: int) -> None:
        if i == bad:
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        processes.for_each(range(5), do)
    assert not multiprocessing.active_children()


def _in_a_pool(folder: Path) -> int:
    threads.cores = lambda: 2
    processes.for_each(range(3), lambda i: (folder / str(i)).touch())
    return len(list(folder.iterdir()))


def test_a_pool_worker_starts_no_processes(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(_in_a_pool, (tmp_path,)) == 3


def test_work_of_a_lost_process_is_done_in_the_parent(tmp_path: Path) -> None:
    here = os.getpid()

    def do(i: int) -> None:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        (tmp_path / str(i)).touch()

    processes.for_each(range(4), do)
    assert len(list(tmp_path.iterdir())) == 4


def test_a_stop_ends_the_other_processes() -> None:
    def stop(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        processes.for_each(range(2), lambda i: time.sleep(600.0), notify=stop)
    assert not multiprocessing.active_children()


def test_a_stop_while_processes_start_ends_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt between the start of a process and its entry in the list would orphan it."""
    monkeypatch.setattr(threads, "cores", lambda: 3)
    submit = ProcessPoolExecutor.submit

    def interrupted(*arguments: Any) -> Any:
        future = submit(*arguments)
        signal.raise_signal(signal.SIGINT)
        return future

    monkeypatch.setattr(ProcessPoolExecutor, "submit", interrupted)
    with pytest.raises(KeyboardInterrupt):
        processes.for_each(range(3), lambda i: time.sleep(600.0))
    assert not multiprocessing.active_children()


def test_processes_end_by_a_signal_at_once(tmp_path: Path) -> None:
    """Also where Python cannot run a handler, as while it waits for a lock for ever."""
    here = os.getpid()

    def do(i: int) -> None:
        if os.getpid() != here:
            kept = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)]
            assert kept == [signal.SIG_DFL, signal.SIG_IGN]
            (tmp_path / "known").touch()

    processes.for_each(range(2), do)
    assert (tmp_path / "known").exists()


def test_a_process_that_hangs_is_not_waited_for_long(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(processes, "_PATIENCE", 0.1)
    here = os.getpid()

    def do(i: int) -> None:
        if os.getpid() != here:
            time.sleep(600.0)
        (tmp_path / str(i)).touch()

    processes.for_each(range(2), do)
    assert len(list(tmp_path.iterdir())) == 2


def test_processes_end_when_the_first_one_is_killed(tmp_path: Path) -> None:
    program = f"""
import os, pathlib, time
from bowstring import processes, threads
threads.cores = lambda: 3
def do(i):
    pathlib.Path({str(tmp_path)!r}, str(os.getpid())).touch()
    time.sleep(600.0)
processes.for_each(range(3), do)
"""
    first = subprocess.Popen([sys.executable, "-c", program], start_new_session=True)
    _until(lambda: len(list(tmp_path.iterdir())) == 3)
    first.kill()
    first.wait()
    _until(lambda: not any(map(_runs, tmp_path.iterdir())))


def _runs(known: Path) -> bool:
    try:
        return ") Z " not in Path("/proc", known.name, "stat").read_text()
    except OSError:
        return False


def _until(met: Callable[[], bool]) -> None:
    end = time.monotonic() + 60.0
    while not met():
        assert time.monotonic() < end
        time.sleep(0.05)


def test_no_process_is_forked_beside_jax(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_WITH_THREADS", ("jaxlib",))
    monkeypatch.setitem(sys.modules, "jaxlib", sys)
    seen: list[int] = []
    processes.for_each(range(3), lambda i: seen.append(os.getpid()))
    assert seen == 3 * [os.getpid()]
