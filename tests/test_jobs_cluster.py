"""Jobs in blocks on a local Dask cluster: same bytes as in one process, whatever dies."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring import interrupts
from bowstring.errors import InputError, NoSolutionError
from bowstring.jobs import Job, RunInterrupted, run, tasks, threads
from test_jobs import content, evaluate, made, refused

distributed = pytest.importorskip("distributed", exc_type=ImportError)

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("default"),  # Dask closes some of its sockets late
]

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two processes, one thread each, which come back when they are killed."""
    import dask

    with (
        dask.config.set({"distributed.deploy.lost-worker-timeout": "1 hour"}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as two,
    ):
        yield two


def slowly(first: int, count: int, dies: Path | None = None) -> dict[str, Any]:
    """Evaluate; the worker dies at point 400, once if `dies` is a path that does not exist yet."""
    time.sleep(0.05)
    if dies is not None and first == 400 and not dies.is_file():
        if not dies.is_dir():
            dies.touch()
        os.kill(os.getpid(), getattr(signal, "SIGKILL", signal.SIGTERM))
    return evaluate(first, count) | {"status": np.full(count, threads())}


def job(dies: Path | None = None, **changes: Any) -> Job:
    return made(evaluate=partial(slowly, dies=dies), block=20, **changes)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The blocks of one process."""
    one = made(evaluate=lambda f, n: slowly(f, n) | {"status": np.ones(n, "int8")}, block=20)
    return content(run(one, tmp_path_factory.mktemp("one") / "job"))


def test_a_killed_worker_costs_its_block(
    cluster: Any, expected: dict[str, bytes], tmp_path: Path
) -> None:
    dies = tmp_path / "died"
    store = run(job(dies), tmp_path / "job", cluster.scheduler_address)
    assert dies.exists()
    assert content(store) == expected
    assert (store.read(0, 1001)["status"] == 1).all()  # threads


def test_few_blocks_are_in_flight(cluster: Any, expected: dict[str, bytes], tmp_path: Path) -> None:
    with distributed.Client(cluster) as client:
        client.wait_for_workers(2, timeout=60)
        most: list[int] = []
        store = run(job(), tmp_path / "job", client, lambda share: most.append(len(client.futures)))
        assert client.status == "running"
    assert len(most) == 51 and 2 <= max(most) <= 5
    assert content(store) == expected


def test_a_block_that_kills_each_worker_is_named(cluster: Any, tmp_path: Path) -> None:
    said = refused(
        lambda: run(job(tmp_path), tmp_path / "job", cluster.scheduler_address), NoSolutionError
    )
    assert said.startswith("block 21 of 51 (points 401 to 420) was lost each time with the worker")
    assert "of 51 blocks are kept in" in said


def fails(first: int, count: int, once: Path | None = None) -> dict[str, Any]:
    """Evaluate; point 400 raises, once if a path is given."""
    if first == 400 and not (once and once.exists()):
        if once:
            once.touch()
        raise OSError("no licence")
    return slowly(first, count)


def test_a_block_that_raises_is_computed_once_more(
    cluster: Any, expected: dict[str, bytes], tmp_path: Path
) -> None:
    again = made(evaluate=partial(fails, once=tmp_path / "raised"), block=20)
    assert content(run(again, tmp_path / "job", cluster.scheduler_address)) == expected
    said = refused(
        lambda: run(made(evaluate=fails, block=20), tmp_path / "j", cluster.scheduler_address),
        NoSolutionError,
    )
    assert said.startswith("block 21 of 51 (points 401 to 420) failed: OSError: no licence; 2")


def test_a_block_that_fails_is_named(cluster: Any, tmp_path: Path) -> None:
    wrong = made(evaluate=lambda f, n: {}, block=20)
    said = refused(lambda: run(wrong, tmp_path / "job", cluster.scheduler_address))
    assert "failed: evaluate gave nothing, it must give error, tip and status; 0 of 51" in said


def test_ctrl_c_keeps_what_is_done(
    cluster: Any, expected: dict[str, bytes], tmp_path: Path
) -> None:
    def stop(share: float) -> None:
        if share > 0.3:
            signal.raise_signal(signal.SIGINT)

    interrupts.listen()
    with pytest.raises(RunInterrupted, match=r"1[67] of 51 blocks are kept"):
        run(job(), tmp_path / "job", cluster.scheduler_address, stop)
    assert content(run(job(), tmp_path / "job", cluster.scheduler_address)) == expected


@contextmanager
def scheduler() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Address and process of a cluster that can be killed."""
    code = (
        "from distributed import LocalCluster as C\n"
        "if __name__ == '__main__':\n"
        "    c = C(n_workers=1, processes=False, protocol='tcp://', dashboard_address=':0')\n"
        "    print(c.scheduler_address, flush=True)\n"
        "    input()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    ) as process:
        assert process.stdout is not None
        yield process.stdout.readline().strip(), process


def test_a_scheduler_that_goes_away(expected: dict[str, bytes], tmp_path: Path) -> None:
    with scheduler() as (address, process):

        def kill(share: float) -> None:
            if share > 0.3:
                process.kill()

        said = refused(lambda: run(job(), tmp_path / "job", address, kill))
    assert said.startswith("the Dask scheduler ") and "of 51 blocks are kept in" in said
    assert said.endswith("and the same job goes on from there")
    kept = {file.name: file.read_bytes() for file in (tmp_path / "job" / "blocks").iterdir()}
    assert len(kept) >= 16 and kept.items() <= expected.items()
    said = refused(lambda: run(job(), tmp_path / "job", address))
    assert said.startswith(f"cannot connect to the Dask scheduler {address}: ")


def test_the_command_says_one_sentence_when_the_scheduler_goes_away(tmp_path: Path) -> None:
    folder = tmp_path / "blocks"
    axes = ("--over", "E=20:50 GPa:400", "--over", "nu=0:0.4:400")
    more = ("--store", str(folder), "--out", str(tmp_path / "map.nc"))
    start = [sys.executable, "-m", "bowstring", "map", "amouri2019", *axes, *more, "--dask"]
    with (
        scheduler() as (address, process),
        subprocess.Popen([*start, address], stderr=subprocess.PIPE, text=True) as command,
    ):
        while not list(folder.glob("blocks/*.nc")) and command.poll() is None:
            time.sleep(0.1)
        process.kill()
        said = command.communicate(timeout=60)[1]
    assert command.returncode == 1  # not 2: something was written
    (line,) = said.splitlines()
    assert line.startswith("Error: the Dask scheduler ") and "blocks are kept in" in line


def test_a_cluster_without_workers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tasks, "_PATIENCE", 1.0)
    with (
        distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=":0") as none,
        distributed.Client(none) as client,
    ):
        said = refused(lambda: run(job(), tmp_path / "job", client))
    assert said.startswith("the Dask cluster has had no worker for 1 s; 0 of 51 blocks are kept")


def test_clients_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="client is 5, it must be the address"):
        run(job(), tmp_path / "job", 5)  # type: ignore[arg-type]


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_the_campaign(tmp_path: Path) -> None:
    pytest.importorskip("psutil")
    from campaign import blocks

    outcome = blocks.campaign(300_000, blocks.stand_in, tmp_path)
    assert len(outcome.seconds) == 4
    assert 1e7 < outcome.memory["worker"] < 1e9 and 1e7 < outcome.memory["client"] < 1e9
    (tmp_path / "serial" / "blocks").rename(tmp_path / "blocks")
    next(iter((tmp_path / "blocks").iterdir())).unlink()
    with pytest.raises(AssertionError, match="a block is missing"):
        blocks.compare(tmp_path, tmp_path / "cluster", 30)


def test_the_example(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, str(ROOT / "examples" / "dask_local.py"), str(tmp_path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("100000 loads, 100000 with an equilibrium\nat 60 N the tip is at")
