"""File of a run: NetCDF, written in chunks and valid at every moment.

The file appears at its path with the first output times and grows. It has ``status = "running"``
and ``complete_to_s`` until `RunFile.finish`; a killed process leaves a file that any NetCDF reader
can open, with the run up to that time.

The format is classic NetCDF with 64-bit offsets, written here directly. All variables of one output
time form a record, packed by the core. A chunk is therefore one write at the end of the file; a
second write to its first page updates the number of times, the time reached and the status. This
order keeps the file valid at every moment, and it is several times faster than the NetCDF library,
which writes variable by variable. An HDF5 file can be lost if the process is killed during a write.
"""

from __future__ import annotations

import contextlib
import errno
import functools
import io
import math
import os
import shutil
import stat
import struct
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Floats, Ints
from bowstring.dynamics import netcdf
from bowstring.errors import InputError
from bowstring.files.atomic_io import (
    check_parent,
    check_writable,
    folder_beside,
    readable,
    resolved,
)
from bowstring.robot.model import Robot
from bowstring.statics import fields
from bowstring.statics.fields import FIELDS, Field

if TYPE_CHECKING:
    import xarray as xr
    from typing_extensions import Self

__all__ = ["RunFile", "check_file", "read_run"]

_MAGIC: Final = b"CDF\x02"
_CHAR, _INT, _DOUBLE = 2, 4, 6
_DIMENSIONS, _VARIABLES, _ATTRIBUTES = 10, 11, 12
_DIMENSION_ORDER: Final = ("time", "letter", "axis", "row", "column", "disk", "tendon", "station")
_PLACE: Final = struct.Struct(">iq")  # bytes of a variable, and their offset
_TIME: Final = struct.Struct(">d")  # first value of a record
_STATUS_BYTES: Final = 32
_REASON_BYTES: Final = 1024
_PAGE: Final = 4096
_ROOM: Final = 250_000  # bytes per write: few calls, and small enough for the cache
_LARGEST: Final = 2**31 - 4
_OURS: Final = b"bowstring_version"


def check_file(path: str | Path) -> Path:
    """Check before any work that a run may be written to a file.

    Parameters
    ----------
    path : str or Path
        Path with the suffix ``.nc`` in an existing folder; a former run there will be replaced.

    Returns
    -------
    Path
        The same file, absolute, links resolved.

    Raises
    ------
    InputError
        If the suffix is another one, the folder does not exist, or the path exists and is not a
        run.
    """
    file = resolved(path, f"cannot write the run to {path}")
    why = f"cannot write the run to {file}"
    try:
        check_parent(file, why)
        try:
            kind = stat.S_IFMT(file.stat().st_mode)
        except FileNotFoundError:
            kind = None
        if kind == stat.S_IFDIR:
            raise InputError(f"{why}: it is a folder; name a file, for example {file / 'run.nc'}")
        if file.suffix.lower() != ".nc":
            raise InputError(f"{why}: its name must end in .nc")
        if kind is not None:
            if kind != stat.S_IFREG:
                raise InputError(f"{why}: it is a device or pipe; name a file")
            with file.open("rb") as former:
                head = former.read(8192)
            if head and not (head.startswith(_MAGIC) and _OURS in head):
                raise InputError(
                    f"{why}: it is not a run of Bowstring, and existing files are not overwritten; "
                    "name another file"
                )
        check_writable(file, why)
    except OSError as error:
        raise InputError(f"{why}: {error.strerror}") from None
    return file


class RunFile:
    """File of a run while it is written; made by `RunFile.open`.

    As a context manager it finishes the file with the status ``"converged"``, ``"interrupted"``
    after Ctrl-C, or ``"failed"`` with the text of the error.

    Attributes
    ----------
    path : Path
    complete_to : float
        Time in s up to which the file contains the run; NaN before the first output time.
    room : ndarray of uint8
        Buffer for whole records before they are appended.
    """

    def __init__(
        self, path: Path, robot: Robot, settings: Mapping[str, Any], station: Floats, module: Ints
    ) -> None:
        self.path = path
        self.complete_to = float("nan")
        self._attributes = fields.attributes(robot, settings)
        coordinates = fields.coordinates(robot, station, module)
        self._header = _Header(self._attributes, coordinates, FIELDS)
        size = self._header.record
        self.room = np.empty(max(1, _ROOM // size) * size, dtype=np.uint8)
        self._file: BinaryIO | None = None
        self._placed = False
        self._records = 0
        self._closed = False

    @classmethod
    def open(
        cls,
        path: str | Path,
        robot: Robot,
        settings: Mapping[str, Any],
        station: Floats,
        module: Ints,
        *,
        times: int,
    ) -> Self:
        """Start a file, before the work begins.

        Parameters
        ----------
        path : str or Path
            Path of the file; a former run is replaced with the first output times, or at the end.
        robot : Robot
        settings : mapping
            Settings of the run, stored in the file; see `bowstring.statics.fields.to_dataset`.
        station : ndarray (P,)
        module : ndarray of int (P,)
            Stations as in `bowstring.statics.fields.Frames`.
        times : int
            Expected number of output times, for the check of free space.

        Raises
        ------
        InputError
            If the file cannot be written, see `check_file`, or the drive has no room.
        """
        run = cls(check_file(path), robot, settings, station, module)
        why = f"cannot write the run to {run.path}"
        try:
            free = shutil.disk_usage(run.path.parent).free
        except OSError as error:
            raise InputError(f"{why}: {_why(error)}") from None
        need = run._header.size + times * run._header.record
        if need > free:
            raise InputError(
                f"{why}: it needs {need / 1e9:.2g} GB and the drive has {free / 1e9:.2g} GB free"
            )
        return run

    def append(self, records: NDArray[np.uint8]) -> None:
        """Append output times to the file.

        Parameters
        ----------
        records : ndarray of uint8
            Whole records with increasing times: time and all of `bowstring.statics.fields.FIELDS`
            in their order, big-endian.

        Raises
        ------
        InputError
            If the bytes are no whole records, the file was removed or replaced, or the drive is
            full; in the last case the file gets ``status = "failed"`` and contains the run up to
            the last whole chunk.
        """
        if self._closed:
            raise InputError(f"the run in {self.path} is finished; nothing can be added")
        size = self._header.record
        count = len(records) // size
        if len(records) != count * size:
            raise InputError(f"records of this run have {size} bytes each, got {len(records)}")
        if count == 0:
            return
        content = records.data
        (first,) = _TIME.unpack_from(content)
        (last,) = _TIME.unpack_from(content, (count - 1) * size)
        if first <= self.complete_to:
            raise InputError(
                f"output times must increase: got {first:g} s after {self.complete_to:g} s"
            )
        head = (self._records + count, last)
        try:
            if self._records == 0:
                self._replace(self._header.bytes("running", "", *head), content)
            else:
                self._check_place(whole=True)
                self._write(self._size, content)
                self._write(4, self._header.head("running", "", *head))
        except OSError as error:
            self._give_up(error)
        self._records, self.complete_to = head

    def finish(self, status: str = "converged", reason: str = "") -> None:
        """Write the final status and close the file; a second call does nothing.

        Parameters
        ----------
        status : str
            Status such as ``"converged"`` or ``"interrupted"``.
        reason : str
            Reason, for a run that stopped early.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._end(status, reason)
        except OSError as error:
            raise InputError(
                f"cannot finish the run in {self.path}: {_why(error)}; {self._holds()}"
            ) from None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is None:
            self.finish()
        elif isinstance(error, KeyboardInterrupt):
            self.finish("interrupted", "stopped by the user")
        else:
            self.finish("failed", str(error) or type(error).__name__)

    # -- inside --------------------------------------------------------------------------------

    def _replace(self, *parts: bytes | memoryview) -> None:
        """Replace the file as a whole by a new one, and continue in it."""
        with folder_beside(self.path) as work:
            name = work / "new.nc"
            with name.open("wb", buffering=0) as new:
                for part in parts:
                    _write(new, part)
            check_file(self.path)
            os.replace(name, self.path)
            self._placed = True
            self._open()  # at once, before another run replaces it

    @property
    def _size(self) -> int:
        return self._header.size + self._records * self._header.record

    def _check_place(self, whole: bool = False) -> None:
        """Raise if the file was removed, replaced or changed by another program.

        ``whole`` also checks its size, which an interrupt may have left too large.
        """
        try:
            ours = os.fstat(self._open().fileno())
            if not os.path.samestat(os.stat(self.path), ours):
                what = "another file has taken its place; give each run a file of its own"
            elif ours.st_size < self._size or (whole and ours.st_size > self._size):
                what = "another program wrote to its file while it went on"
            else:
                return
        except FileNotFoundError:
            what = "its file was removed while it went on"
        self._closed = True
        if self._file is not None:
            self._file.close()
        raise InputError(f"the run in {self.path} is lost: {what}")

    def _open(self) -> BinaryIO:
        if self._file is None:
            self._file = open(self.path, "r+b", buffering=0)  # noqa: SIM115
        return self._file

    def _write(self, offset: int, content: bytes | memoryview) -> None:
        file = self._open()
        file.seek(offset)
        _write(file, content)

    def _end(self, status: str, reason: str) -> None:
        """Write the status to the file, also after an interrupted write, and close it."""
        if not self._placed:
            self._replace(_Header(self._attributes, {}, ()).bytes(status, reason))
            self._open().close()
            return
        self._check_place()
        with contextlib.closing(self._open()) as file:
            file.seek(0)
            page = file.read(_PAGE)
            self._write(page.index(_name("status")), _ending(status, reason))
            place = page.index(_name("complete_to_s")) + len(_name("complete_to_s")) + 8
            (self.complete_to,) = struct.unpack_from(">d", page, place)

    def _give_up(self, error: OSError) -> None:
        """Handle a full drive: truncate to whole records, write the status, and raise."""
        self._closed = True
        go_on = "go on writing" if self._records else "write"
        why = f"cannot {go_on} the run to {self.path}: {_why(error)}"
        with contextlib.suppress(OSError):
            if self._records:
                self._open().truncate(self._size)
            self._end("failed", why)
        raise InputError(f"{why}; {self._holds()}") from None

    def _holds(self) -> str:
        if not self._placed:
            return "nothing was written"
        if self._records == 0:
            return "the file holds no output time"
        return f"the file holds the run up to {self.complete_to:.6g} s"


def _write(file: BinaryIO | io.FileIO, content: bytes | memoryview) -> None:
    """Write all bytes; an unbuffered file may accept only a part at a time."""
    rest = memoryview(content)
    while rest:
        rest = rest[file.write(rest) :]


def _why(error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "the drive is full"
    if error.errno == errno.EFBIG:
        return "the file is larger than is allowed here"
    return error.strerror or str(error)


def read_run(path: str | Path) -> xr.Dataset:
    """Read the file of a run, also of one that was killed or is still running.

    Parameters
    ----------
    path : str or Path
        File written by `bowstring.simulate`.

    Returns
    -------
    xarray.Dataset
        Variables of `bowstring.statics.fields.to_dataset`, in memory. ``attrs["status"]`` is the
        status of the run (``"running"`` if it was killed or is running), ``attrs["complete_to_s"]``
        the time up to which the file contains it.

    Raises
    ------
    InputError
        If the file does not exist, is not a run, or is truncated.
    """
    import xarray as xr

    try:
        with _open_regular(path) as file:
            head = file.read(8)
            if not head.startswith((netcdf.CLASSIC, netcdf.HDF5)):
                raise InputError(f"{path} is not a run of Bowstring; it is not a NetCDF file")
            netcdf.check(path, file)
    except (OSError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        reason = getattr(error, "strerror", None) or "its name is not valid"
        raise InputError(f"cannot read the run {path}: {reason}") from None
    try:
        data = xr.load_dataset(path, engine="netcdf4")
    except Exception as error:  # damaged files raise errors of all kinds, even KeyError
        why = " ".join(str(error).split())[:200] or type(error).__name__
        raise InputError(f"cannot read the run {path}: it is damaged: {why}") from None
    _check_content(path, data)
    return data


def _open_regular(path: str | Path) -> BinaryIO:
    """Open a regular file; raise `OSError` for a pipe or device, which cannot be read twice."""
    file = readable(path)
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is not a regular file")
    return file


def _check_content(path: str | Path, data: xr.Dataset) -> None:
    """Refuse a dataset that is no run, has a newer version, or lacks variables of a run."""
    about = data.attrs
    if _OURS.decode() not in about:
        raise InputError(f"{path} is a NetCDF file, but not a run of Bowstring")
    version = about.get("schema_version")
    if not isinstance(version, (int, np.integer)):
        raise InputError(
            f"cannot read the run {path}: it is damaged: schema_version is {version!r:.40}"
        )
    if version > fields.SCHEMA_VERSION:
        raise InputError(
            f"{path} was written by a newer Bowstring ({about[_OURS.decode()]!s:.40}); update"
        )
    for name in (_OURS.decode(), "status", "robot", "robot_hash"):
        if not isinstance(about.get(name), str):
            raise InputError(
                f"cannot read the run {path}: it is damaged: {name} is {about.get(name)!r:.40}, "
                "not text"
            )
    for field in (fields.Field("time", (), "", "", ""), *FIELDS):
        if field.name not in data.variables:
            continue
        found = data[field.name]
        if not set(found.dims) <= {"time", *field.dims} or found.dtype.kind not in "fiu":
            raise InputError(
                f"cannot read the run {path}: it is damaged: {field.name} has the axes "
                f"{', '.join(map(str, found.dims)) or 'none'} and holds {found.dtype}"
            )


# -- the format --------------------------------------------------------------------------------
# https://docs.unidata.ucar.edu/nug/current/file_format_specifications.html: big-endian, names and
# values padded to 4 bytes; a header is magic, number of records, dimensions, attributes, variables.


class _Header:
    """Header and fixed variables of a file.

    ``size`` is the offset of the records, ``record`` the bytes of one; both are 0 without records.
    """

    def __init__(
        self,
        attributes: Mapping[str, str | int],
        coordinates: Mapping[str, tuple[str, Any, Mapping[str, str]]],
        variables: Iterable[Field],
    ) -> None:
        sizes = {"time": 0, "letter": 1} if coordinates else {}  # 0: unlimited
        for dim, values, _ in coordinates.values():
            sizes[dim] = len(values)
        fixed, rows = [], []
        for name, (dim, values, attrs) in coordinates.items():
            kind, dims = {
                "U": (_CHAR, (dim, "letter")),
                "i": (_INT, (dim,)),
                "f": (_DOUBLE, (dim,)),
            }[values.dtype.kind]
            raw = values.astype({_CHAR: "S1", _INT: ">i4", _DOUBLE: ">f8"}[kind]).tobytes()
            fixed.append(_pad(raw))
            encoding = {"_Encoding": "utf-8"} if kind == _CHAR else {}
            rows.append(_row(name, dims, kind, (*attrs.items(), *encoding.items())))
        grown = []
        if coordinates:
            rows.append(_row("time", ("time",), _DOUBLE, tuple(fields.TIME.items())))
            grown.append(8)
        for field in variables:
            rows.append(_field_row(field))
            grown.append(8 * math.prod([sizes[dim] for dim in field.dims]))
        self.record = sum(grown)
        if max(grown, default=0) > _LARGEST:
            raise InputError("a run of so many stations does not fit its file; take fewer")
        dimensions = struct.pack(">ii", _DIMENSIONS if sizes else 0, len(sizes))
        for name in filter(sizes.__contains__, _DIMENSION_ORDER):
            dimensions += _name(name) + _int(sizes[name])
        self._dimensions = dimensions
        self._count = len(attributes) + 3
        other = b"".join(
            _text(key, value)
            if isinstance(value, str)
            else _name(key) + struct.pack(">iii", _INT, 1, value)
            for key, value in attributes.items()
        )
        table = struct.pack(">ii", _VARIABLES if rows else 0, len(rows))
        before = 4 + len(self.head("", "")) + len(other) + len(table)
        begin = before + sum(map(len, rows)) + _PLACE.size * len(rows)
        self.size = begin + sum(map(len, fixed))
        parts = [other, table]
        for row, length in zip(rows, [*map(len, fixed), *grown], strict=True):
            parts += (row, _PLACE.pack(length, begin))
            begin += length
        self._tail = b"".join([*parts, *fixed])

    def head(
        self, status: str, reason: str, records: int = 0, complete_to: float = math.nan
    ) -> bytes:
        """Changing part of the header: from byte 4, of fixed length, within the first page."""
        return (
            struct.pack(">i", records)
            + self._dimensions
            + struct.pack(">ii", _ATTRIBUTES, self._count)
            + _name("complete_to_s")
            + struct.pack(">iid", _DOUBLE, 1, complete_to)
            + _ending(status, reason)
        )

    def bytes(self, *head: Any) -> bytes:
        """All bytes before the records; arguments as for `head`."""
        return _MAGIC + self.head(*head) + self._tail


def _ending(status: str, reason: str) -> bytes:
    """Attributes of the status, of fixed length."""
    return _text("status", status, _STATUS_BYTES) + _text("reason", reason, _REASON_BYTES)


@functools.cache
def _row(
    name: str, dims: tuple[str, ...], kind: int, attributes: tuple[tuple[str, str], ...]
) -> bytes:
    """Entry of a variable in the header, before its size and offset; equal in all files."""
    places = [_int(_DIMENSION_ORDER.index(dim)) for dim in dims]
    listed = [_int(_ATTRIBUTES), _int(len(attributes)), *(_text(*each) for each in attributes)]
    return b"".join([_name(name), _int(len(dims)), *places, *listed, _int(kind)])


@functools.cache
def _field_row(field: Field) -> bytes:
    # CF conventions: auxiliary coordinates
    aside = {"station": "arc_length module segment", "disk": "disk_arc_length"}
    beside = " ".join(aside[dim] for dim in field.dims if dim in aside)
    attributes = fields.field_attributes(field)
    if beside:
        attributes |= {"coordinates": beside}
    return _row(field.name, ("time", *field.dims), _DOUBLE, tuple(attributes.items()))


def _int(value: int) -> bytes:
    return value.to_bytes(4, "big")


def _pad(raw: bytes) -> bytes:
    return raw + bytes(-len(raw) % 4)


@functools.cache
def _name(name: str) -> bytes:
    raw = name.encode()
    return _int(len(raw)) + _pad(raw)


def _text(name: str, value: str, room: int = 0) -> bytes:
    """Text attribute; with ``room`` it is padded to that length by NUL, which readers drop."""
    raw = value.encode()
    if room:
        raw = raw[:room].decode(errors="ignore").encode().ljust(room, b"\0")
    return _name(name) + _int(_CHAR) + _int(len(raw)) + _pad(raw)
