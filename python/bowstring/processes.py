"""Work that leaves files, done side by side in several processes."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Any, TypeVar

from bowstring import interrupts

__all__ = ["for_each"]

T = TypeVar("T")

_MOST = 4  # processes; each holds a copy of what it changes
_PATIENCE = 60.0  # s without any finished item: the processes hang

_do: Callable[[int], None]  # what a forked process does with the item of an index


def for_each(
    items: Sequence[T], do: Callable[[T], None], *, tell: Callable[[float], None] | None = None
) -> None:
    """Do something with each item, in as many processes as there are cores, four at most.

    Only files that `do` leaves are seen afterwards. What another process failed to do is done
    again here, so that an error comes up as if there were this process only. Other processes are
    forked, which costs nothing to start and asks nothing of the items, but is safe on Linux only;
    elsewhere the items are done one after the other.

    Parameters
    ----------
    items : sequence
    do : callable
        Is given one item; doing it twice must be the same as doing it once. It must not use the
        compiled core, whose threads are not there in a forked process.
    tell : callable, optional
        Progress callback: the share that is done, from 0 to 1.
    """
    tell = tell or (lambda share: None)
    # a process of a pool may start none itself
    may_fork = sys.platform == "linux" and not multiprocessing.current_process().daemon
    count = min(_cores(), _MOST, len(items)) if may_fork else 1
    done = _in_processes(items, do, count, tell) if count > 1 else set()
    left = [i for i in range(len(items)) if i not in done]
    for before, i in enumerate(left, len(done)):
        tell(before / len(items))
        do(items[i])


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _in_processes(
    items: Sequence[T], do: Callable[[T], None], count: int, tell: Callable[[float], None]
) -> set[int]:
    """Do the items in forked processes; return the indices of those that are done."""
    former = multiprocessing.active_children()
    futures: dict[Future[None], int] = {}
    pool = None
    try:
        # an interrupt between a fork and its entry among the children would lose a process
        with interrupts.held(), warnings.catch_warnings():
            # newer Pythons warn of threads; those there are hold no lock that the work needs
            warnings.simplefilter("ignore", DeprecationWarning)
            pool = ProcessPoolExecutor(
                count, multiprocessing.get_context("fork"), _begin, (lambda i: do(items[i]),)
            )
            futures.update((pool.submit(_work, i), i) for i in range(len(items)))
        pending = set(futures)
        while pending:
            tell(1.0 - len(pending) / len(items))
            finished, pending = wait(pending, _PATIENCE, FIRST_COMPLETED)
            if not finished:
                break
    except (OSError, ImportError, NotImplementedError):  # the system refuses processes or locks
        pass
    finally:
        for child in multiprocessing.active_children():
            if child not in former:
                child.kill()
        if pool is not None:
            pool.shutdown(cancel_futures=True)
    return {i for f, i in futures.items() if not (f.cancelled() or f.exception())}


def _begin(do: Callable[[int], None]) -> None:
    """Prepare a forked process."""
    global _do
    _do = do
    # the first process ends it; where its threads held a lock, Python's own handlers never run
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End a process whose parent was killed: it would wait for work without end."""
    parent: Any = multiprocessing.parent_process()
    parent.join()
    os._exit(1)


def _work(i: int) -> None:
    _do(i)
