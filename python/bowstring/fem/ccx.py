"""CalculiX as a separate process: find, start and monitor it, and interpret its exit."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, Literal, NamedTuple

from bowstring.errors import InputError
from bowstring.fem.output import reason

Status = Literal["converged", "diverged", "killed", "out_of_memory", "no_space", "failed"]

_LOOK: Final = 0.1  # s between two checks of the files
_PATIENCE: Final = 5.0  # s for it to end after a signal
_FULL: Final = 1 << 20  # free bytes below which a drive counts as full
# The read ends when this process ends for any reason; $1 is a folder to remove.
_WATCH: Final = 'read -r pid; read -r line; kill -KILL "$pid"; [ -z "$1" ] || rm -rf -- "$1"'


class End(NamedTuple):
    """End of a run: status and reason."""

    status: Status
    why: str


def find() -> Path:
    """Find the program.

    Raises
    ------
    InputError
        If ``ccx`` is not on the search path.
    """
    found = shutil.which("ccx")
    if found is None:
        raise InputError(
            "finite elements need CalculiX 2.20 or newer, and there is no program ccx on the "
            "search path; install it (Debian and Ubuntu: sudo apt-get install calculix-ccx; "
            "elsewhere see https://www.calculix.de)"
        )
    return Path(found)


def version(program: Path) -> str:
    """Return the version of the program, such as ``"2.20"``.

    Raises
    ------
    InputError
        If it does not start, or is older than 2.20.
    """
    try:
        answer = subprocess.run(
            [program, "-v"], stdin=subprocess.DEVNULL, capture_output=True, timeout=60, check=False
        ).stdout
    except OSError as error:
        raise InputError(f"{program} does not start: {error.strerror}") from None
    except subprocess.TimeoutExpired:
        raise InputError(f"{program} does not answer when asked for its version by -v") from None
    found = re.search(r"Version (\d+)\.(\d+)", answer.decode("ascii", "replace"))
    if found is None:
        raise InputError(f"{program} does not say its version when asked by -v; is it CalculiX?")
    if (int(found[1]), int(found[2])) < (2, 20):
        raise InputError(
            f"{program} is CalculiX {found[1]}.{found[2]}; finite elements need 2.20 or newer"
        )
    return f"{found[1]}.{found[2]}"


def run(
    program: Path, folder: Path, job: str, look: Callable[[], None], *, fleeting: bool = False
) -> End:
    """Run an input deck.

    Parameters
    ----------
    program : Path
    folder : Path
        Folder with ``job.inp``, for all files, including ``job.log``.
    look : callable
        Called repeatedly, and once after the program has ended. An exception from it, also from
        Ctrl-C, ends the program.
    fleeting : bool
        Whether to remove the folder if this process is killed.
    """
    log = folder / f"{job}.log"
    # line buffering, so that tables of a finished step are not left in a buffer
    environment = {"OMP_NUM_THREADS": "1", **os.environ, "GFORTRAN_UNBUFFERED_ALL": "y"}
    with log.open("wb") as output, _watcher(folder if fleeting else None) as watch:
        try:
            child = subprocess.Popen(
                [program, job],
                cwd=folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=environment,
            )
        except OSError as error:
            raise InputError(f"{program} does not start: {error.strerror}") from None
        try:
            watch(child.pid)
            while True:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    child.wait(_LOOK)
                if child.returncode is not None:
                    break
                look()
        finally:
            _end(child)
    look()
    return _meaning(child.returncode, log, folder)


@contextlib.contextmanager
def _watcher(folder: Path | None) -> Iterator[Callable[[int], None]]:
    """Start a shell that ends a program, given its process id, if this process is killed.

    It starts before the program, so that the program is always watched. Without a POSIX shell the
    program would run to its own end.
    """
    try:
        # a new session, so that signals to all processes of a terminal do not reach it
        watcher = subprocess.Popen(
            ["/bin/sh", "-c", _WATCH, "sh", str(folder or "")],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
    except OSError:
        yield lambda process: None
        return
    assert watcher.stdin is not None
    channel = watcher.stdin.fileno()

    def notify(process: int) -> None:
        with contextlib.suppress(BrokenPipeError):  # the shell was ended
            os.write(channel, f"{process}\n".encode())

    try:
        yield notify
    finally:
        watcher.kill()  # before its input ends
        with watcher:
            pass


def _end(child: subprocess.Popen[bytes]) -> None:
    if child.poll() is not None:
        return
    child.terminate()
    try:
        child.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        child.kill()
        child.wait()


def _meaning(code: int, log: Path, folder: Path) -> End:
    text = log.read_text("utf-8", errors="replace")
    said = reason(text)
    low = text.lower()
    if code == 0 and not said:
        return End("converged", "")
    if "no space left" in low or shutil.disk_usage(folder).free < _FULL:
        return End("no_space", f"no space is left on the drive of {folder}")
    if "error in u_calloc" in low or "error allocating memory" in low or "not enough memory" in low:
        return End("out_of_memory", "CalculiX ran out of memory")
    if code < 0:
        name = signal.Signals(-code).name
        more = ", as a system out of memory does" if name == "SIGKILL" else ""
        return End("killed", f"CalculiX was killed ({name}){more}")
    if "increment size smaller than minimum" in low or "too many cutbacks" in low:
        return End("diverged", "no equilibrium was found beyond, however short the increment")
    return End("failed", f"CalculiX ended with code {code}" + (f": {said}" if said else ""))
