"""Run file-writing work in parallel processes."""

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

from bowstring import interrupts, threads

T = TypeVar("T")

_MOST = 4  # processes; each copies the memory that it changes
_PATIENCE = 60.0  # s without a finished item after which the processes count as stuck
# libraries whose threads may hold a lock that a forked process waits for
_WITH_THREADS: tuple[str, ...] = ("jaxlib", "torch")

_do: Callable[[int], None]  # work of a forked process on the item of an index


def for_each(
    items: Sequence[T],
    do: Callable[[T], None],
    *,
    notify: Callable[[float], None] | None = None,
    failed: Callable[[T, Exception], None] | None = None,
) -> None:
    """Call a function on each item, in one process per core, at most four.

    Only files that `do` writes remain. An item that failed in another process is repeated in this
    one, so that its exception is raised here. Processes are forked, so items need no pickling;
    that is safe on Linux only and beside no library with threads of its own such as JAX. Otherwise
    the items are processed one after the other.

    Parameters
    ----------
    items : sequence
    do : callable
        Called with one item; must be idempotent. It must not use the compiled core, whose threads
        do not exist in a forked process.
    notify : callable, optional
        Progress callback, called with the finished share from 0 to 1.
    failed : callable, optional
        Called with an item and its exception, which is then not raised.
    """
    notify = notify or (lambda share: None)
    # a daemonic process may not have children
    may_fork = sys.platform == "linux" and not multiprocessing.current_process().daemon
    may_fork = may_fork and sys.modules.keys().isdisjoint(_WITH_THREADS)
    count = min(threads.cores(), _MOST, len(items)) if may_fork else 1
    done = _in_processes(items, do, count, notify) if count > 1 else set()
    left = [i for i in range(len(items)) if i not in done]
    for before, i in enumerate(left, len(done)):
        notify(before / len(items))
        try:
            do(items[i])
        except Exception as error:
            if failed is None or interrupts.is_interrupt(error):
                raise
            failed(items[i], error)


def _in_processes(
    items: Sequence[T], do: Callable[[T], None], count: int, notify: Callable[[float], None]
) -> set[int]:
    """Process items in forked processes; return the indices of the finished ones."""
    former = multiprocessing.active_children()
    futures: dict[Future[None], int] = {}
    pool = None
    try:
        # an interrupt between a fork and its entry among the children would lose a process
        with interrupts.deferred(), warnings.catch_warnings():
            # Newer Pythons warn of threads; ours hold no lock that the work needs.
            warnings.simplefilter("ignore", DeprecationWarning)
            pool = ProcessPoolExecutor(
                count, multiprocessing.get_context("fork"), _begin, (lambda i: do(items[i]),)
            )
            futures.update((pool.submit(_work, i), i) for i in range(len(items)))
        pending = set(futures)
        while pending:
            notify(1.0 - len(pending) / len(items))
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
    # The parent ends it; where a thread of the parent held a lock, Python's handlers never run.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End a process whose parent was killed, which would wait for work forever."""
    parent: Any = multiprocessing.parent_process()
    parent.join()
    os._exit(1)


def _work(i: int) -> None:
    _do(i)
