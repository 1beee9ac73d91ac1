"""Entry point of ``bowstring`` and ``python -m bowstring``; Ctrl-C during start and end."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
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
        sys.exit(_STOPPED)
    finally:
        _set_handler(signal.SIG_IGN)  # all output is written


if __name__ == "__main__":
    main()
