"""Ctrl-C and SIGTERM reach a command at any moment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="no SIGTERM")

# the effect of imports of large libraries on an interrupt; `ready` marks when it may arrive
BROKEN_IMPORT = """
try:
    ready()
    time.sleep(20)
except KeyboardInterrupt as error:
    raise ImportError("the core cannot be loaded") from error
"""
OPTIONAL_IMPORT = """
try:
    try:
        ready()
        time.sleep(20)
    except BaseException:
        raise ImportError("no fast variant") from None
except ImportError:
    pass
time.sleep(20)
"""
COMPILED = """
exec("ready()\\ntime.sleep(20)")
"""
DESTRUCTOR = """
class Kept:
    def __del__(self):
        ready()
        time.sleep(20)

kept = Kept()
del kept
time.sleep(20)
"""
CALLBACK = """
import weakref

class Kept:
    pass

def gone(_):
    ready()
    time.sleep(20)

kept = Kept()
watched = weakref.ref(kept, gone)
del kept
time.sleep(20)
"""


def stop(folder: Path, library: str, signals: list[signal.Signals]) -> tuple[int, str]:
    """Exit code and output of `bowstring export` when stopped while it imports a library."""
    marker = folder / "ready"
    begin = f"import time\ndef ready():\n    open({str(marker)!r}, 'w').close()\n"
    (folder / "build123d.py").write_text(begin + textwrap.dedent(library))
    with subprocess.Popen(
        [sys.executable, "-m", "bowstring", "export", "amouri2019", "--out", "a.step"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        try:
            while not marker.exists():
                assert process.poll() is None
                time.sleep(0.01)
            for number in signals:
                process.send_signal(number)
                time.sleep(0.03)
            out, _ = process.communicate(timeout=15)
        finally:
            process.kill()
    assert not (folder / "a.step").exists()
    return process.returncode, out


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("library", [BROKEN_IMPORT, OPTIONAL_IMPORT])
@pytest.mark.slow
def test_an_interrupt_within_an_import(
    tmp_path: Path, library: str, number: signal.Signals
) -> None:
    assert stop(tmp_path, library, [number]) == (130, "Stopped: nothing was written.\n")


def test_an_interrupt_of_code_compiled_from_a_string(tmp_path: Path) -> None:
    assert stop(tmp_path, COMPILED, [signal.SIGINT]) == (130, "Stopped: nothing was written.\n")


@pytest.mark.parametrize("library", [DESTRUCTOR, CALLBACK])
def test_an_interrupt_swallowed_by_an_import(tmp_path: Path, library: str) -> None:
    signals = [signal.SIGTERM, signal.SIGTERM]
    assert stop(tmp_path, library, signals) == (130, "Stopped: nothing was written.\n")


def test_further_signals_do_not_break_off_the_clean_up(tmp_path: Path) -> None:
    library = """
    try:
        ready()
        time.sleep(20)
    finally:
        time.sleep(0.3)
        print("cleaned up", flush=True)
    """
    signals = [signal.SIGTERM, signal.SIGTERM, signal.SIGINT]
    code, out = stop(tmp_path, library, signals)
    assert (code, out) == (130, "cleaned up\nStopped: nothing was written.\n")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
def test_a_finished_command_ignores_signals() -> None:
    """A signal during the end of Python must not abort it."""
    code = (
        "import os, signal, sys, atexit\n"
        "from bowstring.cli import main\n"
        "atexit.register(lambda: [os.kill(os.getpid(), signal.SIGTERM) for _ in range(3)])\n"
        "sys.argv = ['bowstring', 'robots']\n"
        "main.main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "") and "amouri2019" in done.stdout
