"""One labelled data set of a job's results, as NetCDF or Zarr, written part by part."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from bowstring._core import __version__
from bowstring.files.atomic_io import (
    check_file,
    check_room,
    check_whole_folder,
    has_mark,
    not_overwritten,
    write_whole,
    write_whole_file,
)
from bowstring.jobs.job import Arrays, Job
from bowstring.optional import load_extra

_MARK: Final = b"bowstring_version"
_WHAT: Final = "data set"

Read = Callable[[int, int], Arrays]
Index = tuple[Any, ...]


def save(job: Job, read: Read, path: Path) -> Path:
    """Write a data set; see `bowstring.jobs.Store.save`."""
    place = check_data_set(path)
    check_room(place.parent, job.total_bytes, f"cannot write the {_WHAT} to {place}")
    if path.suffix.lower() == ".zarr":
        write_whole(place, _WHAT, lambda new: _write_zarr(job, read, new))
    else:
        write_whole_file(place, _WHAT, lambda new: _write_netcdf(job, read, new))
    return place


def check_data_set(path: Path) -> Path:
    """Check before any work that a data set may be written; return its absolute path."""
    if path.suffix.lower() == ".zarr":
        load_extra("cluster", "zarr")
        return check_whole_folder(path, _WHAT, _check_zarr)
    return check_file(path, _WHAT, (".nc", ".zarr"), _MARK)


def _check_zarr(folder: Path, why: str) -> None:
    if next(folder.iterdir(), None) is None:
        return
    mark = folder / ".zattrs"
    if not (mark.is_file() and has_mark(mark, _MARK)):
        raise not_overwritten(why)


def _write_netcdf(job: Job, read: Read, file: Path) -> None:
    import netCDF4

    with netCDF4.Dataset(file, "w") as data:
        data.set_fill_off()
        data.setncatts(_attributes(job))
        for name, size in _sizes(job).items():
            data.createDimension(name, size)
        for name, along in job.coordinates.items():
            values = np.asarray(along.values)
            kind = str if values.dtype.kind == "U" else values.dtype
            written = data.createVariable(name, kind, (name,))
            written.setncatts(_labels(along))
            written[:] = values.astype(object) if kind is str else values
        for name, variable in job.variables.items():
            dims = (*job.axes, *variable.dims)
            written = data.createVariable(name, variable.dtype, dims, contiguous=True)
            written.setncatts(_labels(variable))
        _fill(job, read, data.variables)


def _write_zarr(job: Job, read: Read, folder: Path) -> None:
    import dask.array
    import xarray as xr
    import zarr

    chunk = _part_shape(tuple(job.axes.values()), job.block)
    content = {}
    for name, variable in job.variables.items():
        inner = tuple(variable.dims.values())
        shape = (*job.axes.values(), *inner)
        empty = dask.array.empty(shape, dtype=variable.dtype, chunks=(*chunk, *inner))
        content[name] = ((*job.axes, *variable.dims), empty, _labels(variable))
    along = {
        name: (name, np.asarray(values.values), _labels(values))
        for name, values in job.coordinates.items()
    }
    template = xr.Dataset(content, along, _attributes(job))
    # format 2 is what Zarr-Python for Python 3.10 writes, and all versions read it
    version: dict[str, Any] = {} if zarr.__version__.startswith("2.") else {"zarr_format": 2}
    template.to_zarr(folder, mode="w", compute=False, **version)
    _fill(job, read, zarr.open_group(str(folder), mode="r+"))


def _fill(job: Job, read: Read, target: Any) -> None:
    """Copy all points to the arrays of a file."""
    arrays, first = {name: target[name] for name in job.variables}, 0
    for index, shape in _parts(tuple(job.axes.values()), job.block):
        count = math.prod(shape)
        for name, array in read(first, count).items():
            arrays[name][index] = array.reshape(*shape, *array.shape[1:])
        first += count


def _part_shape(sizes: Sequence[int], most: int) -> tuple[int, ...]:
    """Largest part of a grid that has at most `most` points, contiguous in memory."""
    split = next(k for k in range(len(sizes)) if math.prod(sizes[k + 1 :]) <= most)
    rows = min(most // math.prod(sizes[split + 1 :]), sizes[split])
    return (*(1 for _ in sizes[:split]), rows, *sizes[split + 1 :])


def _parts(sizes: Sequence[int], most: int) -> Iterator[tuple[Index, tuple[int, ...]]]:
    """Yield index and shape of the parts of a grid, in the order of its points."""
    whole = _part_shape(sizes, most)
    split = next((k for k, size in enumerate(whole) if size > 1), len(sizes) - 1)
    for lead in np.ndindex(*sizes[:split]):
        for begin in range(0, sizes[split], whole[split]):
            end = min(begin + whole[split], sizes[split])
            index = (*(slice(k, k + 1) for k in lead), slice(begin, end))
            shape = (*(1 for _ in lead), end - begin, *sizes[split + 1 :])
            yield index, shape


def _sizes(job: Job) -> dict[str, int]:
    found = dict(job.axes)
    for variable in job.variables.values():
        found.update(variable.dims)
    return found


def _labels(thing: Any) -> dict[str, str]:
    labels = {"units": thing.units, "long_name": thing.long_name}
    return {name: text for name, text in labels.items() if text}


def _attributes(job: Job) -> dict[str, Any]:
    """Description of the job: numbers and text as they are, the rest as JSON."""
    plain = {
        name: value if isinstance(value, (str, int, float)) else json.dumps(value)
        for name, value in job.identity["description"].items()
    }
    return {**plain, "bowstring_version": __version__, "job_hash": job.hash}
