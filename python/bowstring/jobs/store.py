"""Folder with the blocks of a job: one file each, written whole, with its checksum in its name."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from bowstring import interrupts
from bowstring.errors import InputError
from bowstring.files.atomic_io import (
    check_place,
    check_room,
    folder_beside,
    remove_leftovers,
    resolved,
    write_whole_file,
)
from bowstring.files.json_files import Content, read_json, structured
from bowstring.files.result_folder import write_json
from bowstring.jobs import dataset
from bowstring.jobs.job import LARGEST_BLOCK, Arrays, Job
from bowstring.validation import instance, shown

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_JOB: Final = "job.json"
_MOST_JOB: Final = 10_000_000  # bytes beside those of this job; coordinates are in it
_INDENTED: Final = 5  # times the text without spaces, at most
_MOST_BLOCK: Final = 2 * LARGEST_BLOCK  # bytes of a file; its header is small
_BLOCK: Final = re.compile(r"block-(\d{6})-[0-9a-f]{16}\.nc")  # number from 1, checksum

Put = Callable[[int, bytes], None]


class _Job(Content):
    job: dict[str, Any]


class Unfinished(InputError):
    """The work stopped after some blocks were kept; the message names them and the reason."""


class Store:
    """Results of a job in a folder, complete or not.

    The folder holds ``job.json`` and a file for each finished block, all of them NetCDF. Nothing is
    written before `run` does it.

    Parameters
    ----------
    folder : str or Path
        A new or empty folder, or one with blocks of the same job.
    job : Job
        Job whose blocks they are.

    Attributes
    ----------
    folder : Path
    job : Job
    damaged : tuple of int
        Blocks, from 0, whose file was damaged; they count as missing.

    Raises
    ------
    InputError
        If the folder cannot be written, or holds another job or other files.
    """

    def __init__(self, folder: str | Path, job: Job) -> None:
        self.job = instance("job", job, Job)
        self.folder = resolved(folder, f"cannot write the blocks to {folder}")
        self._files: dict[int, Path] = {}
        self._useless: list[Path] = []
        self.damaged: tuple[int, ...] = ()
        self._last: tuple[int, Arrays] = (-1, {})
        why = f"cannot write the blocks to {self.folder}"
        refused: InputError | None = None
        try:
            check_place(self.folder, why)
        except InputError as error:
            if not os.path.isdir(self.folder):
                raise
            refused = error  # finished blocks are read from a drive that takes no file
        try:
            self._check_job(why)
            self._find()
        except OSError as error:
            raise InputError(f"{why}: {error.strerror}") from None
        if refused is not None and self.missing:
            raise refused

    def _check_job(self, why: str) -> None:
        """Refuse a folder of something else."""
        if not self.folder.exists():
            return
        if not self.folder.is_dir():
            raise InputError(f"{why}: it is a file; name a folder")
        remove_leftovers(self.folder)
        try:
            most = _MOST_JOB + _INDENTED * len(json.dumps(self.job.identity))
            former = structured(read_json(self.folder / _JOB, most), _Job)["job"]
        except FileNotFoundError:
            if next(self.folder.iterdir(), None) is None:
                return
            raise InputError(
                f"{why}: it holds files but no blocks of Bowstring; name a new or an empty folder"
            ) from None
        except ValueError as error:
            raise InputError(
                f"{why}: {_JOB} in it is damaged: {error}; its blocks cannot be used, name another "
                "folder"
            ) from None
        difference = _difference(former, self.job.identity)
        if difference:
            raise InputError(
                f"{why}: it holds blocks of another job, whose {difference}; name another folder"
            )

    def _find(self) -> None:
        """Find the finished blocks, and read each to check it."""
        damaged = set()
        with contextlib.suppress(FileNotFoundError):
            for file in sorted((self.folder / "blocks").iterdir()):
                name = _BLOCK.fullmatch(file.name)
                if name is None:
                    continue
                number = int(name[1]) - 1
                if number in self._files or self._content(file, number) is None:
                    self._useless.append(file)
                    damaged.add(number)
                else:
                    self._files[number] = file
        self.damaged = tuple(sorted(damaged & set(self.missing)))

    def _content(self, file: Path, number: int) -> bytes | None:
        """Bytes of the file of a block; None if they do not fit the checksum in its name."""
        with file.open("rb") as opened:
            content = opened.read(_MOST_BLOCK)  # of a longer file, whose checksum then differs
        return content if file.stem.endswith(self.job.checksum(number, content)) else None

    # -- reading -------------------------------------------------------------------------------

    @property
    def missing(self) -> list[int]:
        """Blocks that are still to be computed, from 0."""
        return [number for number in range(self.job.blocks) if number not in self._files]

    @property
    def kept(self) -> str:
        """What the folder holds, as a part of a sentence."""
        count = f"{len(self._files)} of {self.job.blocks} blocks"
        return f"{count} are kept in {self.folder}, and the same job goes on from there"

    def stopped(self, why: str) -> InputError:
        """Error for work that stops: `Unfinished` if the folder has blocks."""
        kind = Unfinished if self._files else InputError
        return kind(f"{why}; {self.kept}")

    def read(self, first: int, count: int) -> Arrays:
        """Read the arrays of successive points.

        Parameters
        ----------
        first, count : int
            First point, from 0, and number of points.

        Returns
        -------
        dict of str to ndarray
            Each with the leading length ``count``.

        Raises
        ------
        InputError
            If one of their blocks is missing or damaged.
        """
        if not (first >= 0 and 0 < count <= self.job.points - first):
            raise InputError(
                f"the points {first} to {first + count - 1} are asked for, and the job has the "
                f"points 0 to {self.job.points - 1}"
            )
        size, parts = self.job.block, []
        for number in range(first // size, (first + count - 1) // size + 1):
            begin = max(first - number * size, 0)
            end = first + count - number * size
            parts.append({name: a[begin:end] for name, a in self._block(number).items()})
        return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}

    def _block(self, number: int) -> Arrays:
        if self._last[0] != number:
            block = self.job.block_name(number)
            file = self._files.get(number)
            if file is None:
                raise InputError(f"{block} is missing in {self.folder}; run the job to its end")
            try:
                content = self._content(file, number)
            except OSError as error:
                raise InputError(f"cannot read {block}, {file}: {error.strerror}") from None
            if content is None:
                raise InputError(f"{block} in {file} is damaged; run the job again")
            self._last = number, self.job.arrays(content)
        return self._last[1]

    def save(self, path: str | Path) -> Path:
        """Write all results as one data set with coordinates, units and description.

        Parameters
        ----------
        path : str or Path
            File ``.nc`` (NetCDF) or folder ``.zarr`` (Zarr, a chunk about the size of a block;
            needs the extra ``cluster``); a former data set there is replaced. About one block is
            in memory at a time.

        Returns
        -------
        Path
            The same path, absolute.

        Raises
        ------
        InputError
            If blocks are missing, the path cannot be written, or the drive has no room.
        """
        if self.missing:
            raise InputError(
                f"{len(self.missing)} of {self.job.blocks} blocks are missing in {self.folder}; "
                "run the job to its end before it is saved"
            )
        return dataset.save(self.job, self.read, Path(path))

    # -- writing -------------------------------------------------------------------------------

    def check_room(self) -> None:
        """Refuse a job whose missing blocks have no room on the drive."""
        need = sum(map(self.job.file_bytes, self.missing))
        check_room(self.folder, need, f"cannot write the blocks to {self.folder}")

    @contextlib.contextmanager
    def writing(self) -> Iterator[Put]:
        """Context manager that creates and locks the folder; yields the function that adds a block.

        Raises
        ------
        InputError
            If the folder cannot be written, or another run writes to it.
        """
        why = f"cannot write the blocks to {self.folder}"
        with contextlib.ExitStack() as stack:
            try:
                self.folder.mkdir(parents=True, exist_ok=True)
                file = self.folder / _JOB
                if not file.exists():
                    content = {"hash": self.job.hash, "job": self.job.identity}
                    write_whole_file(file, "job", lambda new: write_json(new, content))
                (self.folder / "blocks").mkdir(exist_ok=True)
                stack.enter_context(_locked(file, why))
                work = stack.enter_context(folder_beside(self.folder / "block"))
                for useless in self._useless:
                    useless.unlink(missing_ok=True)
            except OSError as error:
                raise InputError(f"{why}: {error.strerror}") from None
            yield lambda number, content: self._put(number, content, work / "new.nc")

    def _put(self, number: int, content: bytes, new: Path) -> None:
        name = f"block-{number + 1:06}-{self.job.checksum(number, content)}.nc"
        file = self.folder / "blocks" / name
        try:
            with interrupts.deferred():  # a block that was computed is kept
                new.write_bytes(content)
                os.replace(new, file)
                self._files[number] = file
        except OSError as error:
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            fault = "the drive is full" if full else error.strerror
            stopped = self.stopped(f"cannot write {self.job.block_name(number)}: {fault}")
            advice = "; make room" if full else ""
            raise type(stopped)(f"{stopped}{advice}") from None


@contextlib.contextmanager
def _locked(file: Path, why: str) -> Iterator[None]:
    """Refuse a folder that another run writes to."""
    if fcntl is None:
        yield
        return
    handle = os.open(file, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{why}: another run writes to it; wait for its end, or name another folder"
            ) from None
        except OSError:  # a drive without locks
            pass
        yield
    finally:
        os.close(handle)


def _difference(there: Any, here: Any, name: str = "") -> str:
    """First difference of two jobs, such as ``axes is [] and not [1]``; empty if none."""
    if not (isinstance(there, dict) and isinstance(here, dict)):
        equal = there == here and type(there) is type(here)
        return "" if equal else f"{name} is {shown(there)} and not {shown(here)}"
    for key in sorted({*there, *here}):
        path = f"{name}.{key}".removeprefix(".")
        if key not in there or key not in here:
            return f"{path} is {'missing' if key not in there else 'not in this one'}"
        found = _difference(there[key], here[key], path)
        if found:
            return found
    return ""
