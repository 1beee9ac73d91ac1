"""Work that leaves files, done side by side in several processes."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from multiprocessing.process import BaseProcess
from typing import TypeVar

from bowstring import interrupts

__all__ = ["for_each"]

T = TypeVar("T")

_MOST = 4  # processes; each holds a copy of what it changes
_PATIENCE = 5.0  # s, beyond what our own share tells


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
        Is told the share that is done, from 0 to 1.
    """
    # a process of a pool may start none itself
    may_fork = sys.platform == "linux" and not multiprocessing.current_process().daemon
    count = min(_cores(), _MOST, max(len(items), 1)) if may_fork else 1
    own, *shares = (items[k::count] for k in range(count))
    began = time.monotonic()
    helpers: list[BaseProcess | None] = []
    try:
        for share in shares:
            with interrupts.held():  # one that is started is known, hence ended below
                helpers.append(_start(share, do))
        for i, item in enumerate(own):
            if tell is not None:
                tell(i / len(own))
            do(item)
        # shares are alike: one that takes ten times as long as ours hangs
        until = time.monotonic() + 10.0 * (time.monotonic() - began) + _PATIENCE
        for share, helper in zip(shares, helpers, strict=True):
            if helper is not None:
                helper.join(max(until - time.monotonic(), 0.0))
            if helper is None or helper.exitcode != 0:
                for item in share:
                    do(item)
    finally:
        for helper in helpers:
            if helper is not None:
                helper.kill()
                helper.join()


def _cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1


def _start(share: Sequence[T], do: Callable[[T], None]) -> BaseProcess | None:
    """A process that does a share, or none where the system refuses one."""

    def work() -> None:
        # leaves at once: clean-up and output that was forked with us belong to the first process
        code = 1
        # the first process ends it; where its threads held a lock, Python's own handlers never run
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        try:
            for item in share:
                do(item)
            code = 0
        except BaseException:
            pass  # it is met again where it can be told
        finally:
            os._exit(code)

    process = multiprocessing.get_context("fork").Process(target=work, daemon=True)
    with warnings.catch_warnings(), contextlib.suppress(OSError):
        # newer Pythons warn of threads; those there are hold no lock that the work needs
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
        return process
    return None
