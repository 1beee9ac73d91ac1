"""Files and folders that are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

from bowstring.errors import InputError

__all__ = ["check_parent", "write_whole"]


def check_parent(file: Path, why: str) -> None:
    """Refuse a file whose folder is none; `why` begins the sentence."""
    if not file.parent.is_dir():
        what = "is a file" if file.parent.exists() else "does not exist"
        raise InputError(f"{why}: the folder {file.parent} {what}")


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
        # beside its place, so that the move is within one file system
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise InputError(f"cannot write the {what} to {folder}: {error.strerror}") from None
    try:
        new = work / "new"
        new.mkdir()
        fill(new)
        _move_in(new, folder, work / "old")
    except OSError as error:
        why = error.strerror or error
        raise InputError(f"cannot write the {what} to {folder}: {why}") from None
    finally:
        shutil.rmtree(work, ignore_errors=True)


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
