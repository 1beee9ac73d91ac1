"""Ctrl-C and SIGTERM of a command: each becomes a `KeyboardInterrupt`, until it is answered.

Python throws away an exception that comes within a destructor or a callback, and libraries turn
one that comes within an import into an `ImportError`. So the interrupt is raised again, every tenth
of a second, until the command has unwound or says by `answered` what became of it. While it
unwinds, a further signal does not break off the clean-up, unless it comes much later.
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

__all__ = [
    "HEARD",
    "answered",
    "handler",
    "held",
    "ignore",
    "listen",
    "pending",
    "unheard",
    "was_stopped",
]

HEARD: Final = (signal.SIGINT, signal.SIGTERM)
_AGAIN: Final = 0.1  # s between two attempts
_PATIENCE: Final = 2.0  # s of clean-up that further signals leave alone
_first: float | None = None  # when the signal that waits for an answer came


def listen() -> None:
    """Hear both signals from now on, unless one is ignored, as nohup has it."""
    for number in HEARD:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, handler)
    if hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, _again)
    sys.unraisablehook = _not_lost


def handler(number: int, frame: FrameType | None) -> None:
    """The signal handler."""
    global _first
    now = time.monotonic()
    if _first is None:
        _first = now
    _wake()
    if now - _first > _PATIENCE or not _unwinding():
        raise KeyboardInterrupt


def answered() -> None:
    """Say that an interrupt was met and what follows is meant to run."""
    global _first
    _first = None
    _wake(0.0)


def ignore() -> None:
    """Hear no signal any more: the command is over, and one that meets Python's end aborts it."""
    for number in HEARD:
        if signal.getsignal(number) is handler:
            signal.signal(number, signal.SIG_IGN)
    answered()


def pending() -> bool:
    """Whether an interrupt came that nobody has answered."""
    return _first is not None


@contextmanager
def held() -> Iterator[None]:
    """Hold interrupts back within; one that came is heard at the end."""
    came: list[int] = []
    numbers = [*HEARD, *([signal.SIGALRM] if hasattr(signal, "SIGALRM") else [])]
    try:
        with _handled(numbers, lambda number, _: came.append(number)):
            yield
    finally:
        if came:
            signal.raise_signal(came[0])


@contextmanager
def unheard() -> Iterator[None]:
    """Ignore interrupts within, so that the end of a run is written whole."""
    with _handled(HEARD, signal.SIG_IGN):
        yield


@contextmanager
def _handled(numbers: Iterable[int], by: Any) -> Iterator[None]:
    """Handle signals otherwise within, where the handler is ours or Python's own."""
    former = {}
    if threading.current_thread() is threading.main_thread():  # the only one that hears any
        ours = (signal.default_int_handler, handler, _again)
        former = {n: signal.getsignal(n) for n in numbers if signal.getsignal(n) in ours}
    try:
        for number in former:
            signal.signal(number, by)
        yield
    finally:
        for number, one in former.items():
            signal.signal(number, one)


def was_stopped(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: in the middle of an import it may become another one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _again(number: int, frame: FrameType | None) -> None:
    if _first is None:
        return
    _wake()
    if not _unwinding():
        raise KeyboardInterrupt


def _wake(seconds: float = _AGAIN) -> None:
    """Have the interrupt raised again after some time, or no more after 0."""
    if hasattr(signal, "setitimer"):
        signal.setitimer(signal.ITIMER_REAL, seconds)


def _unwinding() -> bool:
    """Whether the interrupted code is that of an except or finally clause for an interrupt."""
    return was_stopped(sys.exc_info()[1])


def _not_lost(lost: sys.UnraisableHookArgs) -> None:
    """Say nothing of an interrupt that Python throws away: it comes again."""
    if not (_first is not None and issubclass(lost.exc_type, KeyboardInterrupt)):
        sys.__unraisablehook__(lost)
