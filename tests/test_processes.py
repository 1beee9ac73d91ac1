"""Work done side by side: all of it once, errors told, nothing left running."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from pathlib import Path
from typing import Any

import pytest

from bowstring import processes


@pytest.fixture(params=[1, 2, 3])
def cores(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(processes, "_cores", lambda: request.param)
    return int(request.param)


@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_each_item_is_done(cores: int, count: int, tmp_path: Path) -> None:
    told: list[float] = []
    processes.for_each(
        range(count), lambda i: (tmp_path / str(i)).touch(exist_ok=False), tell=told.append
    )
    assert sorted(int(p.name) for p in tmp_path.iterdir()) == list(range(count))
    assert told == sorted(told) and all(0.0 <= share < 1.0 for share in told)


@pytest.mark.parametrize("bad", [0, 1, 4])
def test_an_error_comes_up_here(cores: int, bad: int) -> None:
    def do(i: int) -> None:
        if i == bad:
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        processes.for_each(range(5), do)
    assert not multiprocessing.active_children()


def _in_a_pool(folder: Path) -> int:
    processes._cores = lambda: 2  # type: ignore[assignment]
    processes.for_each(range(3), lambda i: (folder / str(i)).touch())
    return len(list(folder.iterdir()))


def test_a_worker_of_a_pool_does_all_itself(tmp_path: Path) -> None:
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply(_in_a_pool, (tmp_path,)) == 3


def test_what_a_lost_process_left_is_done_here(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(processes, "_cores", lambda: 2)
    here = os.getpid()

    def do(i: int) -> None:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        (tmp_path / str(i)).touch()

    processes.for_each(range(4), do)
    assert len(list(tmp_path.iterdir())) == 4


def test_a_stop_ends_the_other_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "_cores", lambda: 2)
    here = os.getpid()

    def do(i: int) -> None:
        if os.getpid() == here:
            raise KeyboardInterrupt
        time.sleep(600.0)

    with pytest.raises(KeyboardInterrupt):
        processes.for_each(range(2), do)
    assert not multiprocessing.active_children()


def test_a_stop_while_processes_start_ends_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """An interrupt between the start of one and its entry in the list would leave it alone."""
    monkeypatch.setattr(processes, "_cores", lambda: 3)
    start = processes._start

    def interrupted(*arguments: Any) -> Any:
        process = start(*arguments)
        signal.raise_signal(signal.SIGINT)
        return process

    monkeypatch.setattr(processes, "_start", interrupted)
    with pytest.raises(KeyboardInterrupt):
        processes.for_each(range(3), lambda i: time.sleep(600.0))
    assert not multiprocessing.active_children()


def test_processes_end_by_a_signal_at_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Also where Python cannot run a handler, as while it waits for a lock for good."""
    monkeypatch.setattr(processes, "_cores", lambda: 2)
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
    monkeypatch.setattr(processes, "_cores", lambda: 2)
    monkeypatch.setattr(processes, "_PATIENCE", 0.1)
    here = os.getpid()

    def do(i: int) -> None:
        if os.getpid() != here:
            time.sleep(600.0)
        (tmp_path / str(i)).touch()

    processes.for_each(range(2), do)
    assert len(list(tmp_path.iterdir())) == 2
