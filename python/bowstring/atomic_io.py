"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import os
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import BinaryIO, Final

from bowstring.errors import InputError
from bowstring.formatting import listed

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "check_file",
    "check_parent",
    "check_place",
    "check_replaceable",
    "check_whole_folder",
    "check_writable",
    "folder_beside",
    "has_mark",
    "not_overwritten",
    "readable",
    "resolved",
    "sweep",
    "user_cache",
    "write_whole",
    "write_whole_file",
]


_LETTERS: Final = 50  # of a name that stand in that of the hidden folder beside it
_HIDDEN: Final = re.compile(r"\..*-[0-9a-f]{12}\.bowstring", re.DOTALL)
_OLD: Final = "old"  # in a hidden folder: what was moved away from its place
_WINDOW: Final = 65536  # bytes at either end of a file in which its mark stands


def resolved(path: str | Path, why: str) -> Path:
    """The path, absolute, links resolved; refused where it has no place, as links in a circle."""
    try:
        found = Path(path).resolve()
        circle = found.is_symlink()  # what newer Pythons leave of a circle
    except RuntimeError:  # what older ones make of it
        circle = True
    except OSError as error:  # such as a working folder that was removed
        raise InputError(f"{why}: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{why}: its name is not valid") from None
    if circle:
        raise InputError(f"{why}: links lead to it in a circle")
    return found


def user_cache() -> Path:
    """Folder of the user for what can be fetched or computed again."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local") / "bowstring"
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches/bowstring"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bowstring"


def check_parent(file: Path, why: str) -> None:
    """Refuse a file whose folder is none; `why` begins the sentence."""
    try:
        if file.parent.is_dir():
            return
        what = "is a file" if file.parent.exists() else "does not exist"
    except OSError as error:  # such as a folder above that may not be searched
        what = f"cannot be reached: {error.strerror}"
    raise InputError(f"{why}: the folder {file.parent} {what}")


def check_place(folder: Path, why: str) -> None:
    """Refuse a folder that cannot be made or exchanged in its place; `why` begins the sentence.

    Neither it nor those above it need be there.
    """
    if folder.parent == folder:
        raise InputError(f"{why}: it is the root of the file system; name a folder in it")
    place = folder
    try:
        while not place.parent.exists():
            place = place.parent
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    if not place.parent.is_dir():
        raise InputError(f"{why}: {place.parent} is a file")
    check_writable(place, why)


def check_replaceable(folder: Path, why: str) -> None:
    """Refuse a folder that cannot be replaced as a whole; `why` begins the sentence."""
    try:
        here: Path | None = Path.cwd()
    except OSError:  # it was removed
        here = None
    if here is not None and (folder == here or folder in here.parents):
        fault = "the folder is replaced as a whole, and the working folder is or lies in it"
    elif os.path.ismount(folder):
        fault = "a drive is mounted there, so the folder cannot be replaced as a whole"
    else:
        return
    raise InputError(f"{why}: {fault}; name a folder in it, for example {folder / 'out'}")


def check_whole_folder(
    out: str | Path, what: str, check_content: Callable[[Path, str], None]
) -> Path:
    """Say before any work whether `write_whole` may write to a folder; return it, absolute.

    It need not exist. `what` stands in the error; `check_content`, which is given the folder and
    the beginning of a sentence, refuses what may not be replaced.
    """
    folder = resolved(out, f"cannot write the {what} to {out}")
    why = f"cannot write the {what} to {folder}"
    check_place(folder, why)
    try:
        if not folder.exists():
            return folder
        if not folder.is_dir():
            raise InputError(f"{why}: it is a file; name a folder")
        check_content(folder, why)
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    check_replaceable(folder, why)
    return folder


def check_writable(path: Path, why: str) -> None:
    """Refuse a place in a folder that takes no file, and what only its owner may replace there.

    That is what others have in a folder such as /tmp.
    """
    sweep(path.parent)
    if not _takes_files(path.parent):
        raise InputError(f"{why}: the folder {path.parent} may not be written")
    if not hasattr(os, "geteuid"):
        return
    try:
        above = path.parent.stat()
        owners = {0, above.st_uid, path.lstat().st_uid}
    except FileNotFoundError:
        return
    except OSError as error:  # such as a name that is too long
        raise InputError(f"{why}: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{why}: its name is not valid") from None
    if above.st_mode & stat.S_ISVTX and os.geteuid() not in owners:
        raise InputError(
            f"{why}: it is another user's, who alone may replace it in {path.parent}; choose "
            "another name"
        )


def _takes_files(folder: Path) -> bool:
    """Try whether a new file can be made; rights alone do not say it, as of a read-only drive."""
    with contextlib.suppress(AttributeError, OSError):  # where there are files without a name
        os.close(os.open(folder, os.O_TMPFILE | os.O_WRONLY))
        return True
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@contextlib.contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """A new, hidden folder for what will take a place, on the same drive; removed at the end.

    It is locked while it is in use, so that `sweep` tells it from what a killed process left.
    """
    sweep(path.parent)
    work, lock = _locked_folder(path)
    try:
        yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)
        if lock is not None:
            os.close(lock)


def _locked_folder(path: Path) -> tuple[Path, int | None]:
    while True:
        name = f".{path.name[:_LETTERS]}-{os.urandom(6).hex()}.bowstring"
        work = path.with_name(name)
        work.mkdir(0o700)
        if fcntl is None:
            return work, None
        try:
            lock = os.open(work, os.O_RDONLY)
        except FileNotFoundError:  # another process swept it before it was locked
            continue
        with contextlib.suppress(OSError):  # a drive without locks: nothing is swept there either
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with contextlib.suppress(OSError):
            if os.path.samestat(os.stat(work), os.fstat(lock)):
                return work, lock
        os.close(lock)


def sweep(folder: Path) -> None:
    """Remove what killed processes left hidden in a folder; what they had moved away comes back.

    What a live process uses is locked and stays.
    """
    if fcntl is None:
        return
    try:
        with os.scandir(folder) as entries:
            left = [
                Path(entry.path)
                for entry in entries
                if _HIDDEN.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
            ]
    except OSError:
        return
    for work in left:
        try:
            lock = os.open(work, os.O_RDONLY | os.O_NOFOLLOW)
        except OSError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            _give_back(work)
            shutil.rmtree(work, ignore_errors=True)
        except OSError:
            pass
        finally:
            os.close(lock)


def _give_back(work: Path) -> None:
    """Put what was moved away where it was, unless something else has come there."""
    with contextlib.suppress(FileNotFoundError):
        for former in (work / _OLD).iterdir():
            place = work.with_name(former.name)
            if not os.path.lexists(place):
                os.rename(former, place)


def not_overwritten(why: str, name: str = "it") -> InputError:
    """The error for a file in the way that Bowstring did not write; `why` begins the sentence."""
    return InputError(
        f"{why}: {name} was not written by Bowstring, and existing files are not overwritten; name "
        "another file, or move that one away"
    )


def readable(file: str | Path) -> BinaryIO:
    """A file or pipe, open to be read; a pipe that nothing writes to is empty, and not waited for.

    Raises
    ------
    OSError
        If it cannot be opened.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    handle = os.open(file, flags)
    try:
        if hasattr(os, "set_blocking"):
            os.set_blocking(handle, True)  # what is written to a pipe is waited for
        return os.fdopen(handle, "rb")
    except BaseException as error:
        os.close(handle)
        if isinstance(error, OSError):
            error.filename = str(file)
        raise


def has_mark(file: Path, mark: bytes) -> bool:
    """Whether a file is empty or has a mark near its begin or its end."""
    with file.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        if size == 0 or mark in stream.read(_WINDOW):
            return True
        stream.seek(max(0, size - _WINDOW))
        return mark in stream.read(_WINDOW)


def check_file(file: Path, content: str, suffixes: Sequence[str], mark: bytes) -> Path:
    """Say before any work whether a file may be written.

    Parameters
    ----------
    file : Path
    content : str
        Stands in the error.
    suffixes : sequence of str
        One of them must end its name, such as ``".png"``; upper case is the same.
    mark : bytes
        What every such file of Bowstring holds near its begin or its end.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If its name ends otherwise or is too long, it is a folder, its folder does not exist or may
        not be reached or written, or a file is there that Bowstring did not write.
    """
    why = f"cannot write the {content} to {file}"
    if file.suffix.lower() not in suffixes:
        raise InputError(f"{why}: its name must end in {listed(suffixes, 'or')}")
    try:
        found = resolved(file, why)
        check_parent(found, why)
        if found.exists() and not found.is_file():
            what = "a folder" if found.is_dir() else "a device or pipe"
            raise InputError(f"{why}: it is {what}; name a file")
        check_writable(found, why)
        if found.exists() and not has_mark(found, mark):
            raise not_overwritten(why)
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    return found


def write_whole_file(
    file: Path, what: str, fill: Callable[[Path], None], check: Callable[[], object] = lambda: None
) -> None:
    """Fill a new file beside its place, then put it there in exchange for a former one.

    Parameters
    ----------
    file : Path
        Checked before.
    what : str
        Stands in the error.
    fill : callable
        Is given the new file's path, which has the same suffix.
    check : callable
        Called just before the exchange; raises if the file may not be replaced, as the check before
        the work did.

    Raises
    ------
    InputError
        If the drive does not take it; what was there before stays.
    """
    try:
        with folder_beside(file) as work:
            new = work / f"new{file.suffix if len(file.suffix) < 10 else ''}"
            new.touch()
            fill(new)
            check()
            os.replace(new, file)
    except OSError as error:
        raise InputError(f"cannot write the {what} to {file}: {error.strerror or error}") from None


def write_whole(
    folder: Path,
    what: str,
    fill: Callable[[Path], None],
    check: Callable[[], object] = lambda: None,
) -> None:
    """Fill a new folder beside its place, then put it there in exchange for a former one.

    Parameters
    ----------
    folder : Path
        Checked before: what it holds is replaced.
    what : str
        Stands in the error.
    fill : callable
        Is given the new, empty folder. Beside it, in a hidden folder, is room for what is only
        passed on.
    check : callable
        Called just before the exchange; raises if the folder may not be replaced, as the check
        before the work did.

    Raises
    ------
    InputError
        If the drive does not take it; what was there before stays.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with folder_beside(folder) as work:
            new = work / "new"
            new.mkdir()
            fill(new)
            check()
            _move_in(new, folder, work)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"cannot write the {what} to {folder}: {why}") from None


def _move_in(new: Path, folder: Path, work: Path) -> None:
    if not folder.exists():
        os.rename(new, folder)
        return
    if _exchange(new, folder):
        return
    # two steps; `sweep` takes back the first where the process is killed after it
    former = work / _OLD / folder.name
    former.parent.mkdir()
    os.rename(folder, former)
    try:
        os.rename(new, folder)
    except BaseException:
        os.rename(former, folder)
        raise


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two folders in one step; False where the system or the drive cannot."""
    try:
        library = ctypes.CDLL(None)
        paths = os.fsencode(one), os.fsencode(other)
        if sys.platform == "linux":
            here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
            return bool(library.renameat2(here, paths[0], here, paths[1], exchange) == 0)
        return bool(library.renamex_np(*paths, 2) == 0)  # macOS; RENAME_SWAP
    except (AttributeError, OSError, TypeError):
        return False
