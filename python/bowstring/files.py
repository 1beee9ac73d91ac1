"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from bowstring.errors import InputError

__all__ = [
    "check_file",
    "check_parent",
    "check_place",
    "check_writable",
    "folder_beside",
    "new_beside",
    "resolved",
    "write_whole",
    "write_whole_file",
]


_LETTERS = 50  # of a name that stand in that of a hidden file or folder beside it
_ENDING = 10  # letters of a suffix that does; a longer one is of no format


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
    place = folder
    try:
        while not place.parent.exists():
            place = place.parent
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    if not place.parent.is_dir():
        raise InputError(f"{why}: {place.parent} is a file")
    check_writable(place, why)


def check_writable(path: Path, why: str) -> None:
    """Refuse a place in a folder that takes no file, and what only its owner may replace there.

    That is what others have in a folder such as /tmp.
    """
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


def new_beside(file: Path) -> tuple[int, str]:
    """A new, hidden file that will take another's place: its descriptor and its path.

    Anybody may read it who may read new files here; a temporary file is its owner's only.
    """
    suffix = file.suffix if len(file.suffix) <= _ENDING else ""
    name = str(file.with_name(f".{file.stem[:_LETTERS]}-{os.urandom(6).hex()}{suffix}"))
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
    return os.open(name, flags, 0o666), name


@contextlib.contextmanager
def folder_beside(path: Path) -> Iterator[Path]:
    """A new, hidden folder for what will take a place, on the same drive; removed at the end."""
    work = Path(tempfile.mkdtemp(prefix=f".{path.name[:_LETTERS]}-", dir=path.parent))
    try:
        yield work
    finally:
        shutil.rmtree(work, ignore_errors=True)


def check_file(file: Path, content: str, suffixes: Sequence[str]) -> Path:
    """Say before any work whether a file may be written.

    Parameters
    ----------
    file : Path
    content : str
        Stands in the error.
    suffixes : sequence of str
        One of them must end its name, such as ``".png"``; upper case is the same.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If its name ends otherwise or is too long, it is a folder, or its folder does not exist or
        may not be reached or written.
    """
    why = f"cannot write the {content} to {file}"
    if file.suffix.lower() not in suffixes:
        *most, last = suffixes
        names = f"{', '.join(most)} or {last}" if most else last
        raise InputError(f"{why}: its name must end in {names}")
    try:
        found = resolved(file, why)
        check_parent(found, why)
        if found.exists() and not found.is_file():
            what = "a folder" if found.is_dir() else "a device or pipe"
            raise InputError(f"{why}: it is {what}; name a file")
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    check_writable(found, why)
    return found


def write_whole_file(file: Path, what: str, fill: Callable[[Path], None]) -> None:
    """Fill a new file beside its place, then put it there in exchange for a former one.

    Parameters
    ----------
    file : Path
        Checked before.
    what : str
        Stands in the error.
    fill : callable
        Is given the new file's path, which has the same suffix.

    Raises
    ------
    InputError
        If the drive does not take it; what was there before stays.
    """
    name = ""
    try:
        handle, name = new_beside(file)
        os.close(handle)
        fill(Path(name))
        os.replace(name, file)
    except OSError as error:
        raise InputError(f"cannot write the {what} to {file}: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):
            os.unlink(name)


def write_whole(folder: Path, what: str, fill: Callable[[Path], None]) -> None:
    """Fill a new folder beside its place, then put it there in exchange for a former one.

    Parameters
    ----------
    folder : Path
        Checked before: what it holds is replaced.
    what : str
        Stands in the error.
    fill : callable
        Is given the new, empty folder.

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
            _move_in(new, folder, work / "old")
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"cannot write the {what} to {folder}: {why}") from None


def _move_in(new: Path, folder: Path, old: Path) -> None:
    if not folder.exists():
        os.rename(new, folder)
        return
    os.rename(folder, old)
    try:
        os.rename(new, folder)
    except BaseException:
        os.rename(old, folder)
        raise
