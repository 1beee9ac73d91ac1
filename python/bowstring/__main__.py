"""Entry point of ``bowstring`` and ``python -m bowstring``; Ctrl-C during start and end."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from types import FrameType
from typing import Final

# The same values as in bowstring.cli.main, which takes long to import.
_STOPPED: Final = 130
_BAD_INPUT: Final = 2


def _stopped(*_: object) -> None:
    # An exception raised during an import may be caught or replaced there.
    os.write(2, b"Stopped: nothing was written.\n")
    os._exit(_STOPPED)


def _refused(sentence: str) -> int:
    print(f"Error: {sentence}.", file=sys.stderr)
    return _BAD_INPUT


def _leave_stopped() -> None:
    """Exit without the end of ``python -m``.

    Where Ctrl-C interrupted code compiled from a string, such as that of dataclasses, ``python -m``
    sends SIGINT to itself instead of exiting with a code.
    """
    _set_handler(signal.SIG_IGN)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):
            stream.flush()
    os._exit(_STOPPED)


def _set_handler(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # nohup ignores signals
            signal.signal(number, handler)


def main() -> None:
    """Run the command of ``sys.argv`` and exit."""
    _set_handler(_stopped)
    from bowstring import interrupts

    try:
        from bowstring.cli.main import main as command
    except ImportError as error:
        if "BOWSTRING_INSTRUCTIONS" not in str(error):
            raise
        sys.exit(_refused(str(error)))

    _set_handler(interrupts.handler)
    try:
        command()
    except KeyboardInterrupt:  # a second one while the first was handled
        _leave_stopped()
    except SystemExit as end:
        if end.code == _STOPPED:
            _leave_stopped()
        raise
    finally:
        _set_handler(signal.SIG_IGN)  # all output is written


if __name__ == "__main__":
    main()
