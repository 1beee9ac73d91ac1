"""Variables of a MATLAB file (.mat) as the columns of a table."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError, library_errors
from bowstring.optional import load_extra
from bowstring.units import quote

_HEADER: Final = 128  # bytes
_COMPRESSED: Final = 15  # type of an element
_MOST_BYTES: Final = 1_000_000_000  # of all variables, unpacked
_VERSION_7_3: Final = b"MATLAB 7.3"
_NUMBERS: Final = {  # classes of variables
    *("double", "single", "logical", "int8", "int16", "int32", "int64"),
    *("uint8", "uint16", "uint32", "uint64"),
}

Array = NDArray[Any]


def is_matlab(data: bytes) -> bool:
    """Whether a file with this content is one of MATLAB."""
    return data.startswith(b"MATLAB ")


def read_columns(
    path: Path, data: bytes, like: str | None
) -> tuple[dict[str, list[str]], list[str]]:
    """Read the numbers and texts of a file.

    Parameters
    ----------
    path : Path
        Path in messages.
    data : bytes
        Content of the file.
    like : str or None
        Variable whose number of rows the columns have; None where all have the same.

    Returns
    -------
    dict of str to list of str
        Cells by the name of the column: ``t``, ``log.t`` for a field of a struct, and ``tip_1``,
        ``tip_2`` and so on for a matrix.
    list of str
        Names of the variables that are left out.

    Raises
    ------
    InputError
        If the file cannot be read, or `like` is needed, or the extra of version 7.3.
    """
    load = _version_7_3 if data.startswith(_VERSION_7_3) else _version_7
    with library_errors(f"{path}: this MATLAB file cannot be read"):
        tree = load(path, data)
    found = dict(_arrays({k: v for k, v in tree.items() if not k.startswith("__")}))
    counts = Counter(len(array) for array in found.values() if len(array) > 1)
    if like is not None and like not in found:
        have = ", ".join(map(quote, list(found)[:12])) or "nothing that can be read"
        raise InputError(f"{path}: there is no variable {quote(like)}; the file has {have}")
    if not counts:
        raise InputError(
            f"{path}: no variable has rows of numbers; tables and timetables of MATLAB are saved "
            "by writetable or writetimetable, or with their variables alone"
        )
    if like is None and len(counts) > 1:
        rows = ", ".join(f"{quote(k)} {len(v)}" for k, v in list(found.items())[:12])
        raise InputError(
            f"{path}: the variables have different numbers of rows ({rows}); name one in the "
            "mapping, such as table: {block: "
            f"{next(iter(found))}}}, to read those that have as many"
        )
    count = next(iter(counts)) if like is None else len(found[like])
    columns: dict[str, list[str]] = {}
    for name, array in found.items():
        if len(array) == count:
            wide = array.ndim > 1
            for k, cells in enumerate(array.T if wide else [array], 1):
                columns[f"{name}_{k}" if wide else name] = [str(cell) for cell in cells.tolist()]
    return columns, [name for name, array in found.items() if len(array) != count]


def _version_7(path: Path, data: bytes) -> dict[str, Any]:
    """Variables of a file up to version 7, structs as dictionaries."""
    from scipy.io import loadmat  # takes a while to load

    _check_size(path, data)
    tree: dict[str, Any] = loadmat(io.BytesIO(data), simplify_cells=True)
    return tree


def _version_7_3(path: Path, data: bytes) -> dict[str, Any]:
    """Arrays of numbers of a file of version 7.3, which is HDF5, structs as dictionaries."""
    try:
        h5py = load_extra("matlab")
    except InputError as error:
        raise InputError(f"{path}: {error}; or save the file with save(..., '-v7')") from None
    size = 0

    def tree(group: Any) -> dict[str, Any]:
        nonlocal size
        out: dict[str, Any] = {}
        for name in group:
            # others lead to other files, as external and virtual data sets do
            if not isinstance(group.get(name, getlink=True), h5py.HardLink) or name[0] == "#":
                continue
            item = group[name]
            kind = item.attrs.get("MATLAB_class", b"")
            kind = kind.decode() if isinstance(kind, bytes) else str(kind)
            if isinstance(item, h5py.Group):
                if kind == "struct":
                    out[name] = tree(item)
            elif kind in _NUMBERS and "MATLAB_empty" not in item.attrs:
                if item.external or item.is_virtual or item.dtype.kind not in "biuf":
                    continue
                size += item.size * item.dtype.itemsize
                _refuse_above(path, size)
                out[name] = np.squeeze(item[()].T)
        return out

    with h5py.File(io.BytesIO(data), "r") as file:
        return tree(file)


def _arrays(tree: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Array]]:
    """Vectors and matrices of numbers, and vectors of text, with their names."""
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _arrays(value, f"{above}{name}.")
        elif isinstance(value, np.ndarray) and value.ndim in (1, 2) and value.size:
            is_text = value.ndim == 1 and all(isinstance(cell, str) for cell in value.tolist())
            if value.dtype.kind in "biuf" or is_text:
                yield above + name, value


def _check_size(path: Path, data: bytes) -> None:
    """Refuse compressed variables that expand beyond memory, before they are read."""
    order = "<" if data[126:128] == b"IM" else ">"
    at, size = _HEADER, 0
    while at + 8 <= len(data):
        kind, count = struct.unpack(f"{order}II", data[at : at + 8])
        at += 8
        if kind == _COMPRESSED:
            size += _unpacked(data[at : at + count])
        _refuse_above(path, size)
        at += count


def _refuse_above(path: Path, size: int) -> None:
    if size > _MOST_BYTES:
        raise InputError(
            f"{path}: the variables would unpack to more than {_MOST_BYTES // 10**6} MB, and are "
            "not read; save the table alone"
        )


def _unpacked(data: bytes) -> int:
    """Size of compressed data, at most a little more than what is read."""
    unpacker, size = zlib.decompressobj(), 0
    try:
        while data and size <= _MOST_BYTES:
            size += len(unpacker.decompress(data, 10_000_000))
            data = unpacker.unconsumed_tail
    except zlib.error:
        return size  # the reader says what is damaged
    return size
