"""``python -m bowstring`` and ``bowstring``: the command, and Ctrl-C while it starts and ends."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Final

# as bowstring.cli.main has them, which takes long to import
_STOPPED: Final = 130
_BAD_INPUT: Final = 2


def _stopped(*_: object) -> None:
    # in the middle of an import an exception may be caught there, or become another one
    os.write(2, b"Stopped: nothing was written.\n")
    os._exit(_STOPPED)


def _refused(sentence: str) -> int:
    print(f"Error: {sentence}.", file=sys.stderr)
    return _BAD_INPUT


def _answer(handler: Callable[[int, FrameType | None], object] | signal.Handlers) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup has it
            signal.signal(number, handler)


def main() -> None:
    """Run the command of ``sys.argv`` and exit."""
    _answer(_stopped)
    from bowstring import interrupts

    try:
        from bowstring.cli.main import main as command
    except ImportError as error:
        if "BOWSTRING_INSTRUCTIONS" not in str(error):
            raise
        sys.exit(_refused(str(error)))

    _answer(interrupts.handler)
    try:
        command()
    except KeyboardInterrupt:  # one more while the first was answered
        sys.exit(_STOPPED)
    finally:
        _answer(signal.SIG_IGN)  # all is said


if __name__ == "__main__":
    main()
