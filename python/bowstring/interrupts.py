"""Ctrl-C and SIGTERM of a command: raise `KeyboardInterrupt` until it is acknowledged.

Python discards an exception raised in a destructor or a callback, and libraries turn one raised
in an import into an `ImportError`. The interrupt is therefore raised again, every tenth of a
second, until the command has unwound or calls `acknowledge`. A further signal does not interrupt
the clean-up, unless it comes much later.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Final

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_INTERVAL: Final = 0.1  # s between two attempts
_PATIENCE: Final = 2.0  # s of clean-up that further signals do not interrupt
_first: float | None = None  # time of the signal that is not acknowledged yet, s


def listen() -> None:
    """Install the handlers of both signals; one that is ignored, as under nohup, stays so."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _raise_again)
    sys.unraisablehook = _discarded


def handler(number: int, frame: FrameType | None) -> None:
    """Handle a signal."""
    global _first
    now = time.monotonic()
    if _first is None:
        _first = now
    _schedule()
    if now - _first > _PATIENCE or not _unwinding():
        raise KeyboardInterrupt


def acknowledge() -> None:
    """Mark the interrupt as handled, so that it is not raised again."""
    global _first
    _first = None
    _schedule(0.0)


def ignore() -> None:
    """Ignore signals from now on: one during Python's shutdown would abort it."""
    for number in SIGNALS:
        if signal.getsignal(number) is handler:
            signal.signal(number, signal.SIG_IGN)
    acknowledge()


def pending() -> bool:
    """Whether an interrupt came that is not acknowledged."""
    return _first is not None


@contextmanager
def deferred() -> Iterator[None]:
    """Context manager that defers interrupts to its end."""
    came: list[int] = []
    numbers = [*SIGNALS, *([signal.SIGALRM] if hasattr(signal, "SIGALRM") else [])]
    try:
        with _replaced(numbers, lambda number, _: came.append(number)):
            yield
    finally:
        if came:
            signal.raise_signal(came[0])


@contextmanager
def ignored() -> Iterator[None]:
    """Context manager that ignores interrupts, so that the end of a run is written whole."""
    with _replaced(SIGNALS, signal.SIG_IGN):
        yield


@contextmanager
def _replaced(numbers: Iterable[int], by: Any) -> Iterator[None]:
    """Context manager that replaces handlers, if they are ours or Python's own."""
    former = {}
    if threading.current_thread() is threading.main_thread():  # the one that gets signals
        ours = (signal.default_int_handler, handler, _raise_again)
        former = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) in ours}
    try:
        for number in former:
            signal.signal(number, by)
        yield
    finally:
        for number, one in former.items():
            signal.signal(number, one)


def is_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C caused an error: during an import it may become another exception."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _raise_again(number: int, frame: FrameType | None) -> None:
    if _first is None:
        return
    _schedule()
    if not _unwinding():
        raise KeyboardInterrupt


def _schedule(seconds: float = _INTERVAL) -> None:
    """Schedule raising the interrupt again; 0 cancels it."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _unwinding() -> bool:
    """Whether an except or finally clause for an interrupt is running."""
    return is_interrupt(sys.exc_info()[1])


def _discarded(lost: sys.UnraisableHookArgs) -> None:
    """Print nothing for an interrupt that Python discards: it is raised again."""
    if not (_first is not None and issubclass(lost.exc_type, KeyboardInterrupt)):
        sys.__unraisablehook__(lost)
