"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import contextlib
import ctypes
import errno
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

_LETTERS: Final = 50  # letters of a name that begin the name of its hidden folder
_HIDDEN: Final = re.compile(r"\..*-[0-9a-f]{12}\.bowstring", re.DOTALL)
_STEM: Final = 100  # bytes of a stem; file systems take 255, with what follows it
_OLD: Final = "old"  # subfolder of a hidden folder with the former content
_FULL: Final = 100_000  # free bytes below which a drive counts as full
_WINDOW: Final = 65536  # bytes at either end of a file that are searched for its mark


def resolved(path: str | Path, why: str) -> Path:
    """Absolute path with links resolved; raise `InputError` where links lead in a circle."""
    try:
        found = Path(path).resolve()
        circle = found.is_symlink()  # newer Pythons leave a circle of links unresolved
    except RuntimeError:  # older Pythons raise
        circle = True
    except OSError as error:  # such as a working folder that was removed
        raise InputError(f"{why}: {error.strerror}") from None
    except ValueError:
        raise InputError(f"{why}: its name is not valid") from None
    if circle:
        raise InputError(f"{why}: links lead to it in a circle")
    return found


def file_stem(name: str) -> str:
    """Make the stem of a file name from a name that a file gives, such as that of a robot.

    Characters other than letters, digits, ``.``, ``-`` and ``_`` become underscores, so that the
    name leads to no other folder. It begins and ends with a letter or digit, in 100 bytes at most.
    """
    letters = re.sub(r"[^\w.-]+", "_", name).encode()[:_STEM].decode(errors="ignore")
    return letters.strip("._-") or "robot"


def user_cache() -> Path:
    """User's cache folder."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local") / "bowstring"
    if sys.platform == "darwin":
        return Path.home() / "Library/Caches/bowstring"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "bowstring"


def check_parent(file: Path, why: str) -> None:
    """Refuse a file whose folder does not exist; `why` begins the message."""
    try:
        if file.parent.is_dir():
            return
        what = "is a file" if file.parent.exists() else "does not exist"
    except OSError as error:  # such as a folder above that may not be searched
        what = f"cannot be reached: {error.strerror}"
    raise InputError(f"{why}: the folder {file.parent} {what}")


def check_place(folder: Path, why: str) -> None:
    """Refuse a folder that cannot be created or replaced; `why` begins the message.

    Neither the folder nor its parents need exist.
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
    """Refuse a folder that cannot be replaced as a whole; `why` begins the message."""
    try:
        here: Path | None = Path.cwd()
    except OSError:  # the working folder was removed
        here = None
    if here is not None and (folder == here or folder in here.parents):
        fault = "the folder is replaced as a whole, and the working folder is or lies in it"
    elif os.path.ismount(folder):
        fault = "a drive is mounted there, so the folder cannot be replaced as a whole"
    else:
        return
    raise InputError(f"{why}: {fault}; name a folder in it, for example {folder / 'out'}")


def check_room(path: Path, need: int, why: str) -> None:
    """Refuse more bytes than the drive of a path has free; `why` begins the message.

    The path need not exist.
    """
    place = path
    try:
        while not place.exists():
            place = place.parent
        free = shutil.disk_usage(place).free
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    if need > free:
        raise InputError(
            f"{why}: it needs {need / 1e9:.3g} GB and the drive has {free / 1e9:.3g} GB free; ask "
            "for less, or name a place on a larger drive"
        )


def check_whole_folder(
    out: str | Path, what: str, check_content: Callable[[Path, str], None]
) -> Path:
    """Check before any work that `write_whole` may write to a folder; return its absolute path.

    The folder need not exist. `what` names the content in the error. `check_content`, called with
    the folder and the beginning of the message, raises where the content must not be replaced.
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
    """Refuse a path on a full drive, in a folder without write permission, or of another user.

    In a folder such as /tmp only the owner of a file may replace it.
    """
    remove_leftovers(path.parent)
    if not _takes_files(path.parent):
        raise InputError(f"{why}: the folder {path.parent} may not be written")
    with contextlib.suppress(OSError):
        drive = shutil.disk_usage(path.parent)
        if drive.free == 0 and drive.total > 0:  # some drives state no sizes
            raise InputError(f"{why}: the drive is full; make room")
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
    """Try to create a file: permissions alone do not show a read-only drive."""
    with contextlib.suppress(AttributeError, OSError):  # some systems have no unnamed files
        os.close(os.open(folder, os.O_TMPFILE | os.O_WRONLY))
        return True
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@contextlib.contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """Create a hidden folder beside a path, on the same drive; remove it at the end.

    It is locked while in use: `remove_leftovers` removes unlocked ones only.
    """
    remove_leftovers(path.parent)
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
        except FileNotFoundError:  # another process removed it before it was locked
            continue
        with contextlib.suppress(OSError):  # a drive without locks: nothing is removed there
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        with contextlib.suppress(OSError):
            if os.path.samestat(os.stat(work), os.fstat(lock)):
                return work, lock
        os.close(lock)


def remove_leftovers(folder: Path) -> None:
    """Remove hidden folders that killed processes left in a folder, and restore former content.

    Folders that a live process uses are locked and stay.
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
            _restore(work)
            shutil.rmtree(work, ignore_errors=True)
        except OSError:
            pass
        finally:
            os.close(lock)


def _restore(work: Path) -> None:
    """Move former content back, unless its path is in use again."""
    with contextlib.suppress(FileNotFoundError):
        for former in (work / _OLD).iterdir():
            place = work.with_name(former.name)
            if not os.path.lexists(place):
                os.rename(former, place)


def not_overwritten(why: str, name: str = "it") -> InputError:
    """Error for an existing file that Bowstring did not write; `why` begins the message."""
    return InputError(
        f"{why}: {name} was not written by Bowstring, and existing files are not overwritten; name "
        "another file, or move that one away"
    )


def readable(file: str | Path) -> BinaryIO:
    """Open a file or pipe for reading; a pipe without a writer is empty and does not block.

    Raises
    ------
    OSError
        If it cannot be opened.
    """
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    handle = os.open(file, flags)
    try:
        if hasattr(os, "set_blocking"):
            os.set_blocking(handle, True)  # wait for data of a pipe that has a writer
        return os.fdopen(handle, "rb")
    except BaseException as error:
        os.close(handle)
        if isinstance(error, OSError):
            error.filename = str(file)
        raise


def has_mark(file: Path, mark: bytes) -> bool:
    """Whether a file is empty or contains a mark near its beginning or end."""
    with file.open("rb") as stream:
        size = stream.seek(0, os.SEEK_END)
        stream.seek(0)
        if size == 0 or mark in stream.read(_WINDOW):
            return True
        stream.seek(max(0, size - _WINDOW))
        return mark in stream.read(_WINDOW)


def check_file(file: Path, content: str, suffixes: Sequence[str], mark: bytes) -> Path:
    """Check before any work that a file may be written.

    Parameters
    ----------
    file : Path
    content : str
        Name of the content in the error.
    suffixes : sequence of str
        Allowed suffixes, such as ``".png"``; case does not matter.
    mark : bytes
        Bytes that every such file of Bowstring has near its beginning or end.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If the suffix is not allowed, the name is too long, the path is a folder, its folder does
        not exist or cannot be written, or the file exists and Bowstring did not write it.
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
    """Write a file beside its path, then replace the former one in one step.

    Parameters
    ----------
    file : Path
        Path that was checked before.
    what : str
        Name of the content in the error.
    fill : callable
        Writes the content; called with the path of the new file, which has the same suffix.
    check : callable
        Repeats the check just before the replacement; raises if the file must not be replaced.

    Raises
    ------
    InputError
        If the file cannot be written; the former file stays.
    """
    try:
        with folder_beside(file) as work:
            new = work / f"new{file.suffix if len(file.suffix) < 10 else ''}"
            new.touch()
            with _netcdf_errors(new):
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
    """Write a folder beside its path, then replace the former one in one step.

    Parameters
    ----------
    folder : Path
        Path that was checked before; its content is replaced.
    what : str
        Name of the content in the error.
    fill : callable
        Writes the content; called with the new, empty folder. Its parent is a hidden folder for
        temporary files.
    check : callable
        Repeats the check just before the replacement; raises if the folder must not be replaced.

    Raises
    ------
    InputError
        If the folder cannot be written; the former folder stays.
    """
    try:
        with _folders_above(folder), folder_beside(folder) as work:
            new = work / "new"
            new.mkdir()
            with _netcdf_errors(new):
                fill(new)
            check()
            _move_in(new, folder, work)
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"cannot write the {what} to {folder}: {why}") from None


@contextlib.contextmanager
def _folders_above(path: Path) -> Iterator[None]:
    """Create the folders above a path; remove those that are new if the work fails."""
    new = [above for above in path.parents if not above.exists()]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for above in new:
            with contextlib.suppress(OSError):
                above.rmdir()
        raise


@contextlib.contextmanager
def _netcdf_errors(new: Path) -> Iterator[None]:
    """Context manager that raises an `OSError` where the NetCDF library fails to write.

    The library does not pass on the error of the system: on a full drive it says "HDF error" or
    "Permission denied".
    """
    try:
        yield
    except (PermissionError, RuntimeError) as error:
        of_netcdf = str(error).startswith("NetCDF: ")
        if is_full(new) and (of_netcdf or isinstance(error, PermissionError)):
            raise OSError(errno.ENOSPC, "the drive is full; make room") from None
        if not of_netcdf:
            raise
        raise OSError(errno.EIO, f"{error}; is there room on the drive?") from None


def is_full(path: Path) -> bool:
    """Whether the drive of a path counts as full."""
    try:
        return shutil.disk_usage(path.parent).free < _FULL
    except OSError:
        return False


def _move_in(new: Path, folder: Path, work: Path) -> None:
    if not folder.exists():
        os.rename(new, folder)
        return
    if _exchange(new, folder):
        return
    # Two steps: `remove_leftovers` undoes the first one if the process is killed between them.
    former = work / _OLD / folder.name
    former.parent.mkdir()
    os.rename(folder, former)
    try:
        os.rename(new, folder)
    except BaseException:
        os.rename(former, folder)
        raise


def _exchange(one: Path, other: Path) -> bool:
    """Exchange two folders in one step; return False where that is not supported."""
    try:
        library = ctypes.CDLL(None)
        paths = os.fsencode(one), os.fsencode(other)
        if sys.platform == "linux":
            here, exchange = -100, 2  # AT_FDCWD, RENAME_EXCHANGE
            return bool(library.renameat2(here, paths[0], here, paths[1], exchange) == 0)
        return bool(library.renamex_np(*paths, 2) == 0)  # macOS; RENAME_SWAP
    except (AttributeError, OSError, TypeError):
        return False
