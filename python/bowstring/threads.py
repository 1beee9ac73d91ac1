"""Work on threads: of the compiled core, which runs beside Python, and of fits that mostly call it.

Tasks may start tasks, on their share of the cores.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from typing import Final, TypeVar

T = TypeVar("T")
U = TypeVar("U")

#: Parts of the work of each core, so that all end at the same time.
_PARTS: Final = 8
#: Of the task of a thread: `cores`, its share of them, and `stops`, the events that end it.
_own: Final = threading.local()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def free_cores() -> int:
    """Cores that `results` uses here: all, or the share of a task."""
    return int(getattr(_own, "cores", 0)) or cores()


def results(
    task: Callable[[T], U],
    items: Sequence[T],
    notify: Callable[[int], None] | None = None,
    most: int | None = None,
) -> list[U]:
    """Results of a task for each item, in order, of `most` at once.

    `notify` is called with the number of results.

    After an exception of the task whose result is awaited, or of Ctrl-C while waiting, no further
    task begins, and those that are running end at their next `check`.
    """
    free = free_cores()
    count = min(free, len(items), most or free)
    if count < 2:
        return _listed(map(task, items), notify)
    stop = threading.Event()
    stops = (*_stops(), stop)

    def run(item: T) -> U:
        _own.cores, _own.stops = max(free // count, 1), stops
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
    if any(stop.is_set() for stop in _stops()):
        raise CancelledError


def _stops() -> tuple[threading.Event, ...]:
    return tuple(getattr(_own, "stops", ()))
