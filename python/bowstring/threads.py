"""Work on threads: of the compiled core, which runs beside Python, and of fits that mostly call it.

Tasks may start tasks: those of a thread run one after the other, so that there are as many threads
as cores.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from typing import Any, Final, TypeVar

T = TypeVar("T")
U = TypeVar("U")

#: Parts of the work of each core, so that all end at the same time.
_PARTS: Final = 8
_own: Final = threading.local()  # `stop`: the event that ends the tasks of this thread


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def free_cores() -> int:
    """Cores that `results` uses here: one in a task of its own."""
    return 1 if hasattr(_own, "stop") else cores()


def results(
    task: Callable[[T], U], items: Sequence[T], notify: Callable[[int], None] | None = None
) -> list[U]:
    """Results of a task for each item, in order; `notify` is called with the number of results.

    After an exception, also one of Ctrl-C while waiting, no further task begins, and those that are
    running end at their next `check`.
    """
    count = min(free_cores(), len(items))
    if count < 2:
        return _listed(map(task, items), notify)
    stop = threading.Event()

    def run(item: T) -> U:
        _own.stop = stop
        return task(item)

    with ThreadPoolExecutor(count) as pool:
        try:
            return _listed(pool.map(run, items), notify)
        except BaseException:
            stop.set()
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _listed(each: Iterable[U], notify: Callable[[int], None] | None) -> list[U]:
    found = []
    for result in each:
        found.append(result)
        if notify is not None:
            notify(len(found))
    return found


def in_parts(task: Callable[[T], U], items: Sequence[T]) -> list[U]:
    """Results of a task that is so short that a thread takes several items at a time."""
    # a thread's start takes as long as a small task
    share = max(-(-len(items) // (_PARTS * free_cores())), 1)
    parts = [items[k : k + share] for k in range(0, len(items), share)]

    def each(part: Sequence[T]) -> list[U]:
        return [task(item) for item in part]

    return [found for part in results(each, parts) for found in part]


def check() -> None:
    """End the task if others of its kind were ended; for each step of a long one."""
    stop: Any = getattr(_own, "stop", None)
    if stop is not None and stop.is_set():
        raise CancelledError
