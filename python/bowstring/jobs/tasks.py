"""Blocks as tasks of a Dask cluster.

A bounded number of blocks is submitted at a time. A worker returns the bytes of a block's file,
which the client writes: the workers need no shared drive. A worker runs a task on each of its
threads, so that a block uses one thread there.
"""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Final

from bowstring.errors import BowstringError, InputError, NoSolutionError
from bowstring.jobs.job import MADE_BY, Job
from bowstring.optional import load_extra
from bowstring.validation import shown

if TYPE_CHECKING:
    from distributed import Client, Future

_AHEAD: Final = 2  # blocks in flight per thread of the cluster
_LARGEST_JOB: Final = 10_000_000  # bytes, sent with each block
_CONNECT: Final = 10.0  # s to wait for the scheduler
_LOOK: Final = 1.0  # s between two looks at the cluster
_LOGGERS: Final = ("distributed", "tornado")  # loggers of Dask and of its dependencies
_PATIENCE = 300.0  # s without any worker before the run stops

_task = threading.local()


def threads() -> int:
    """Threads that a block may use: 1 as a task of Dask, else 0, which means all cores."""
    return getattr(_task, "threads", 0)


class Failure(Exception):
    """A block or the cluster failed; the text is the reason, `kind` the class of the error."""

    def __init__(self, reason: str, kind: type[BowstringError] = NoSolutionError) -> None:
        super().__init__(reason)
        self.kind = kind


@contextmanager
def connected(client: str | Client) -> Iterator[Client]:
    """Context manager that connects to a scheduler, or uses the user's own client."""
    distributed = load_extra("cluster")
    if isinstance(client, distributed.Client):
        yield client
        return
    with _silent():
        yield from _own(distributed, client)


def _own(distributed: Any, client: str) -> Iterator[Client]:
    """Connect a client of this process' own."""
    if not isinstance(client, str):
        raise InputError.of("client", shown(client), "the address of a Dask scheduler or a Client")
    try:
        _check_address(distributed, client)
        ours = distributed.Client(client, timeout=_CONNECT, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        why = str(error).partition("\n")[0]
        raise InputError(f"cannot connect to the Dask scheduler {client}: {why}") from None
    try:
        yield ours
    finally:
        ours.close(timeout=_CONNECT)


def _check_address(distributed: Any, address: str) -> None:
    """Refuse what no client can connect to: a Client would wait for 20 s when it is deleted."""
    scheme = address.partition("://")[0]
    if scheme == "inproc":
        raise ValueError("inproc is of one process alone; give the address tcp://HOST:PORT")
    distributed.comm.get_address_host_port(address)
    given = distributed.Security().get_connection_args("client")
    secure = scheme in ("tls", "wss")
    if secure and given["ssl_context"] is None:
        raise ValueError(
            f"{scheme} needs certificates; name them in Dask's configuration "
            "(distributed.comm.tls), or give a Client with its Security"
        )
    if given["require_encryption"] and not secure:
        raise ValueError(
            "Dask's configuration requires encryption; give the address tls://HOST:PORT"
        )


@contextmanager
def _silent() -> Iterator[None]:
    """Context manager that hides the messages of Dask; `compute` raises its errors."""
    loggers = [
        logging.getLogger(name)
        for name in list(logging.root.manager.loggerDict)
        if name.partition(".")[0] in _LOGGERS
    ]
    before = [logger.disabled for logger in loggers]
    for logger in loggers:
        logger.disabled = True
    try:
        yield
    finally:
        for logger, disabled in zip(loggers, before, strict=True):
            logger.disabled = disabled


def compute(
    job: Job, numbers: Sequence[int], client: Client, keep: Callable[[int, bytes], None]
) -> None:
    """Compute blocks on a cluster; call `keep` with number and bytes of each, in any order.

    Raises
    ------
    Failure
        If a block failed, or the scheduler or all workers are gone.
    """
    payload = _pickled(job)
    waiting, suspects = deque(numbers), deque[int]()
    repeated: set[int] = set()  # blocks that failed once; the next time they run alone
    flying: dict[Future, int] = {}
    done: queue.SimpleQueue[Future] = queue.SimpleQueue()
    cluster = _Cluster(client)
    try:
        while waiting or suspects or flying:
            room = cluster.room()
            if suspects or not repeated.isdisjoint(flying.values()):
                room = min(room, 1)
            source = suspects or waiting
            for _ in range(min(room - len(flying), len(source))):
                number = source.popleft()
                future = client.submit(_compute, payload, MADE_BY, number, pure=False)
                flying[future] = number
                future.add_done_callback(done.put)
            try:
                future = done.get(timeout=_LOOK)
            except queue.Empty:
                continue
            number = flying.pop(future)
            fault = _fault(job, number, future)
            if fault is None:
                keep(number, _result(future))
            elif number in repeated or fault.kind is InputError:
                raise fault
            else:
                # the death of a worker is blamed on all blocks that it had
                repeated.add(number)
                suspects.append(number)
            del future  # so that the scheduler and the worker forget it
    finally:
        if client.status == "running":
            client.cancel(list(flying))


class _Cluster:
    """Threads of the workers, looked up from time to time."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._threads = 0
        self._looked = -_LOOK
        self._seen = time.monotonic()  # time of the last look that found a worker

    def room(self) -> int:
        """Number of blocks that may be in flight; 0 without a worker."""
        now = time.monotonic()
        if now - self._looked >= _LOOK:
            self._looked = now
            try:
                self._threads = sum(self._client.nthreads().values())
            except Exception as error:
                raise Failure(
                    f"the Dask scheduler does not answer ({_said(error)})", InputError
                ) from error
            if self._threads:
                self._seen = now
            elif now - self._seen > _PATIENCE:
                raise Failure(
                    f"the Dask cluster has had no worker for {_PATIENCE:.0f} s", InputError
                )
        return _AHEAD * self._threads


def _pickled(job: Job) -> bytes:
    import cloudpickle

    try:
        payload: bytes = cloudpickle.dumps(job)
    except Exception as error:
        raise InputError(
            f"evaluate cannot be sent to a cluster: {_said(error)}; make it a function of a module"
        ) from None
    if len(payload) > _LARGEST_JOB:
        raise InputError(
            f"evaluate takes {len(payload) / 1e6:.3g} MB as it is sent with each block, at most "
            f"{_LARGEST_JOB / 1e6:.0f} MB are allowed; make large arrays inside it"
        )
    return payload


def _fault(job: Job, number: int, future: Future) -> Failure | None:
    """Failure of a block, if it failed."""
    import distributed

    if future.status != "error":
        return None
    error = future.exception()
    if not isinstance(error, distributed.KilledWorker):
        return failed(job, number, error)
    return Failure(
        f"{job.block_name(number)} was lost each time with the worker that computed it; see the "
        "worker's log, it may need more memory"
    )


def _result(future: Future) -> bytes:
    """Bytes of a finished block."""
    try:
        found: bytes = future.result()
    except Exception as error:
        raise Failure(f"the Dask scheduler is gone ({_said(error)})", InputError) from error
    return found


def failed(job: Job, number: int, error: BaseException) -> Failure:
    """Failure of a block whose evaluation raised."""
    kind = InputError if isinstance(error, InputError) else NoSolutionError
    failure = Failure(f"{job.block_name(number)} failed: {_said(error)}", kind)
    failure.__cause__ = error
    return failure


def _said(error: BaseException) -> str:
    text = " ".join(str(error).split())[:300]
    return text if text and isinstance(error, BowstringError) else f"{type(error).__name__}: {text}"


# -- on the worker -----------------------------------------------------------------------------


def _compute(payload: bytes, made_by: dict[str, str], number: int) -> bytes:
    for what, here in MADE_BY.items():
        if made_by[what] != here:
            raise InputError(
                f"the worker has {what} {here} and the job {made_by[what]}, so that its results "
                "could differ; see the guide on clusters"
            )
    _task.threads = 1
    return _loaded(payload).compute(number)


@lru_cache(maxsize=1)
def _loaded(payload: bytes) -> Job:
    import cloudpickle

    job: Job = cloudpickle.loads(payload)
    return job
