"""Checks of a NetCDF file before it is loaded.

The NetCDF libraries trust a header: one damaged byte can make them allocate gigabytes, read zeros
beyond the end of the file, or hang. A classic file is checked here: its header is read within the
bounds of the file, and all variables must lie within the file without overlap. HDF5 is too complex
for that: a separate process with limits on memory and time reads the file first.
"""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO, Final, NamedTuple, TypeVar

from bowstring.errors import InputError

CLASSIC: Final = b"CDF"
HDF5: Final = b"\x89HDF\r\n\x1a\n"

_DIMENSION, _VARIABLE, _ATTRIBUTE = 10, 11, 12
_BYTES: Final = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
"""Bytes of a number by its type; types above 6 exist in CDF-5 only."""
_CLASSIC_TYPES: Final = 6
_MOST_ENTRIES: Final = 10_000  # entries of a list in a header
_MOST_DIMENSIONS: Final = 32  # dimensions of a variable
_LONGEST_NAME: Final = 1024  # bytes
_CUT: Final = "the file is cut off, as by a copy that did not end"

_RATIO: Final = 1100  # largest compression ratio of deflate
_ROOM: Final = 512 << 20  # bytes that a reader needs beside the data
_SECONDS: Final = 5.0  # s of processor time for a small file
_RATE: Final = 2e7  # bytes/s of a larger one


_Entry = TypeVar("_Entry", bound=tuple[Any, ...])  # begins with its name


class _Damaged(Exception):
    """Fault of a file, as the end of a message."""


def check(path: str | Path, file: BinaryIO) -> None:
    """Refuse a file that is damaged or would not fit into memory.

    Parameters
    ----------
    path : str or Path
        Name in the error.
    file : file
        File open for reading that begins with a NetCDF magic number.

    Raises
    ------
    InputError
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    try:
        if file.read(3) == CLASSIC:
            file.seek(0)
            _Header(file, size).check()
        else:
            _read_in_process(Path(path), size)
    except _Damaged as why:
        raise InputError(f"cannot read the run {path}: {why}") from None


# -- classic -----------------------------------------------------------------------------------
# https://docs.unidata.ucar.edu/nug/current/file_format_specifications.html


class _Variable(NamedTuple):
    name: str
    grows: bool
    bytes: int
    begin: int


class _Header:
    """Header of a classic file (CDF-1, CDF-2, CDF-5), read within the bounds of the file."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._left = file, size
        self.size = size
        version = self._take(4)[3]
        if version not in (1, 2, 5):
            raise _Damaged(f"its version of the format is {version}, it must be 1, 2 or 5")
        self._types = max(_BYTES) if version == 5 else _CLASSIC_TYPES
        self._wide = 8 if version == 5 else 4
        self._count = partial(self._int, self._wide)
        self._offset = partial(self._int, 4 if version == 1 else 8)
        self.records = self._count()
        self.dimensions = self._list(_DIMENSION, self._dimension)
        if sum(length == 0 for _, length in self.dimensions) > 1:
            raise _Damaged("its header is damaged: two dimensions grow")
        self._list(_ATTRIBUTE, self._attribute)
        self.variables = self._list(_VARIABLE, self._variable)
        self.end = size - self._left

    def check(self) -> None:
        """Check that all variables lie after the header, within the file and without overlap."""
        grown = [v for v in self.variables if v.grows]
        record = sum(v.bytes for v in grown)
        if len(grown) > 1:
            record = sum(_padded(v.bytes) for v in grown)
        places = [(v.begin, v.bytes, v.name) for v in self.variables if not v.grows]
        if grown:
            begin = min(v.begin for v in grown)
            places.append((begin, record * self.records, "what grows"))
            within = sorted((v.begin - begin, v.bytes, v.name) for v in grown)
            _check_apart(within, 0, record)
        _check_apart(sorted(places), self.end, self.size)

    def _take(self, count: int) -> bytes:
        if count > self._left:
            raise _Damaged(_CUT)
        self._left -= count
        return self._file.read(count)

    def _skip(self, count: int) -> None:
        if count > self._left:
            raise _Damaged(_CUT)
        self._left -= count
        self._file.seek(count, os.SEEK_CUR)

    def _int(self, size: int = 4) -> int:
        value = int.from_bytes(self._take(size), "big", signed=True)
        if value < 0:
            raise _Damaged(f"its header is damaged: it counts {value}")
        return value

    def _list(self, tag: int, entry: Callable[[], _Entry]) -> list[_Entry]:
        found, count = self._int(), self._count()
        if found not in (tag, 0) or (found == 0 and count):
            raise _Damaged(f"its header is damaged: a list begins with {found}, not {tag}")
        if count > _MOST_ENTRIES:
            raise _Damaged(f"its header is damaged: a list of {count} entries")
        entries = [entry() for _ in range(count)]
        names = [each[0] for each in entries]
        if len(set(names)) < len(names):
            raise _Damaged("its header is damaged: two entries have one name")
        return entries

    def _name(self) -> str:
        count = self._count()
        if not 0 < count <= _LONGEST_NAME:
            raise _Damaged(f"its header is damaged: a name of {count} letters")
        raw = self._take(_padded(count))[:count]
        name = raw.decode("utf-8", "surrogateescape")  # invalid UTF-8 is not printable
        if not name.isprintable() or not name or "/" in name:
            raise _Damaged(f"its header is damaged: {raw[:40]!r} is not a name")
        return name

    def _dimension(self) -> tuple[str, int]:
        return self._name(), self._count()

    def _type(self) -> int:
        kind = self._int()
        if not 1 <= kind <= self._types:
            raise _Damaged(f"its header is damaged: {kind} is no type of numbers")
        return kind

    def _attribute(self) -> tuple[str, int]:
        name, kind = self._name(), self._type()
        self._skip(_padded(_BYTES[kind] * self._count()))
        return name, kind

    def _variable(self) -> _Variable:
        name, count = self._name(), self._count()
        if count > _MOST_DIMENSIONS:
            raise _Damaged(f"its header is damaged: {name} has {count} dimensions")
        places = [self._count() for _ in range(count)]
        if any(place >= len(self.dimensions) for place in places):
            raise _Damaged(f"its header is damaged: {name} has a dimension that is not there")
        shape = [self.dimensions[place][1] for place in places]
        self._list(_ATTRIBUTE, self._attribute)
        kind = self._type()
        stated = int.from_bytes(self._take(self._wide), "big")
        begin = self._offset()
        if 0 in shape[1:]:
            raise _Damaged(f"its header is damaged: {name} grows along another than its first axis")
        grows = bool(shape) and shape[0] == 0
        count = math.prod(shape[grows:]) * _BYTES[kind]
        if stated not in (count, _padded(count), 2**32 - 1):  # the last: above 32 bits
            raise _Damaged(f"its header is damaged: {name} has {count} bytes, not {stated}")
        return _Variable(name, grows, count, begin)


def _padded(count: int) -> int:
    return count + -count % 4


def _check_apart(places: list[tuple[int, int, str]], begin: int, end: int) -> None:
    """Refuse sorted parts (begin, bytes, name) that overlap or exceed their bounds."""
    for place, count, name in places:
        if place < begin:
            raise _Damaged(f"its header is damaged: {name} lies where something else does")
        begin = place + count
        if begin > end:
            raise _Damaged(_CUT)


# -- HDF5 --------------------------------------------------------------------------------------

_SCRIPT: Final = """import sys
sys.path[:] = sys.argv[3:]
from bowstring.dynamics import netcdf
netcdf._read()
"""


def _read_in_process(path: Path, size: int) -> None:
    """Read the whole file in a separate process with limits of memory and time."""
    if not sys.executable:  # embedded Python: no process can be started
        return
    seconds = _SECONDS + size / _RATE
    try:
        done = subprocess.run(
            [sys.executable, "-c", _SCRIPT, os.path.abspath(path), str(seconds), *sys.path],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=10.0 * seconds,
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
        )
    except subprocess.TimeoutExpired:
        raise _Damaged("it is damaged: reading it does not end") from None
    except OSError as error:
        raise _Damaged(f"no process can be started to check it: {error.strerror}") from None
    said = done.stdout.decode("utf-8", "replace").strip()
    if done.returncode == 0 and said == "whole":
        return
    raise _Damaged(said if done.returncode == 0 and said else "it is damaged: it cannot be read")


def _read() -> None:
    """Read the file in the separate process, which prints "whole" or the fault."""
    path, seconds = sys.argv[1], float(sys.argv[2])
    import netCDF4

    limit = _Limits(seconds)
    size = os.path.getsize(path)
    try:
        with netCDF4.Dataset(path) as data:
            data.set_auto_maskandscale(False)
            for name in data.ncattrs():
                data.getncattr(name)
            counts = {}
            for name, variable in data.variables.items():
                for attribute in variable.ncattrs():
                    variable.getncattr(attribute)
                item = getattr(variable.dtype, "itemsize", 8)  # text of any length: at least
                counts[name] = math.prod(variable.shape) * item
            total = sum(counts.values())
            if total > _RATIO * size + 4096 * len(counts):
                print(f"it is damaged: {size} bytes cannot hold the {total:.3g} of its variables")
                return
            if total > _free():
                print(f"its data take {total / 1e9:.3g} GB and {_free() / 1e9:.3g} GB are free")
                return
            limit.allow(2 * max(counts.values(), default=0))
            for variable in data.variables.values():
                variable[...]
    except Exception as error:
        print(f"it is damaged: {' '.join(str(error).split())[:200]}")
        return
    print("whole")


class _Limits:
    """Limits of this process, on systems that support them."""

    def __init__(self, seconds: float) -> None:
        self._base = 0
        try:
            import resource
        except ImportError:
            return
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = resource.getrusage(resource.RUSAGE_SELF).ru_utime
        most = math.ceil(used + seconds)
        resource.setrlimit(resource.RLIMIT_CPU, (most, most + 5))
        try:
            pages = int(Path("/proc/self/statm").read_text("ascii").split()[0])
        except OSError:
            return
        self._base = pages * resource.getpagesize() + _ROOM
        self.allow(0)

    def allow(self, more: int) -> None:
        """Allow this many bytes of memory beside what a reader needs."""
        if not self._base:
            return
        import resource

        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        soft = self._base + more
        if hard != resource.RLIM_INFINITY:
            soft = min(soft, hard)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def _free() -> float:
    """Bytes of free memory; infinite if the system does not report it."""
    try:
        return float(os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (AttributeError, OSError, ValueError):
        return math.inf
