"""A large array computation, divided into blocks; a block's results as the bytes of a file.

The bytes are a classic NetCDF file, which any NetCDF reader opens. They are made where the block is
computed, so that they are the same on one machine and on a cluster.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring._core import __version__, instructions
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import listed, significant
from bowstring.validation import choice, shown, whole

_MOST_POINTS: Final = 10**9
_MOST_BLOCKS: Final = 100_000  # files in a folder
LARGEST_BLOCK: Final = 50_000_000  # bytes: a worker holds several blocks, and should need 1 GB
_HEAD: Final = 4096  # bytes of a block beside its numbers, at most as a rule
_POINT: Final = "point"  # outer dimension in the file of a block
_TYPES: Final = ("float64", "float32", "int32", "int16", "int8")  # types of classic NetCDF

Arrays = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class Coordinate:
    """Values along a dimension.

    Attributes
    ----------
    values : sequence of float or str
    units, long_name : str
        Attributes in the data set; empty for none.
    """

    values: Sequence[float] | Sequence[str] | NDArray[Any]
    units: str = ""
    long_name: str = ""


@dataclass(frozen=True)
class Variable:
    """One array of results.

    Attributes
    ----------
    units, long_name : str
        Attributes in the data set.
    dims : mapping of str to int
        Names and sizes of its dimensions beside the axes of the job.
    dtype : {"float64", "float32", "int32", "int16", "int8"}
        Type of its numbers.
    """

    units: str
    long_name: str
    dims: Mapping[str, int] = field(default_factory=dict)
    dtype: str = "float64"


@short_repr
@dataclass(frozen=True, eq=False)
class Job:
    """A large array computation over a grid of points, which is never held in memory.

    Attributes
    ----------
    evaluate : callable
        ``evaluate(first, count)`` returns the arrays of the points ``first`` to
        ``first + count - 1`` as a dict; each has the leading length ``count``. It must be
        deterministic, and for a cluster it must be possible to pickle it; `threads` is the number
        of threads that it may use.
    axes : mapping of str to int
        Names and sizes of the axes whose product are the points; the last one varies fastest.
        ``numpy.unravel_index`` converts a point to its place on each axis.
    variables : mapping of str to Variable
        What `evaluate` returns.
    description : mapping
        What is computed, such as robot, load, version and hash, in terms of JSON. It is kept with
        the results, and another description is another job.
    block : int
        Points in a block; a block should take about a second.
    coordinates : mapping of str to Coordinate
        Values along axes or along dimensions of variables.

    Raises
    ------
    InputError
        If the job is too large, its blocks are too large or too small, or the names, sizes and
        types do not fit.
    """

    evaluate: Callable[[int, int], Mapping[str, NDArray[Any]]]
    axes: Mapping[str, int]
    variables: Mapping[str, Variable]
    description: Mapping[str, Any]
    block: int
    coordinates: Mapping[str, Coordinate] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not callable(self.evaluate):
            raise InputError.of("evaluate", shown(self.evaluate), "a function")
        for what in ("axes", "variables"):
            if not getattr(self, what):
                raise InputError(f"{what} is empty, a job needs at least one")
        for name, size in self.axes.items():
            whole(f"size of the axis {name}", size, 1, 10**18)
        for name, variable in self.variables.items():
            choice(f"dtype of {name}", variable.dtype, _TYPES)
        sizes = self._checked_sizes()
        for name, along in self.coordinates.items():
            if sizes.get(name) != len(along.values):
                raise InputError(
                    f"the coordinate {name} has {len(along.values)} values, and the dimension "
                    f"{name} has {sizes.get(name, 'no')} points"
                )
        self._check_extent()
        try:
            self.identity  # noqa: B018 - raises
        except (AttributeError, TypeError, ValueError) as error:
            raise InputError(
                f"description and coordinates must be numbers and text, as in JSON: {error}"
            ) from None

    def _checked_sizes(self) -> dict[str, int]:
        """Sizes of all dimensions; raise for a name that means two things."""
        sizes = dict(self.axes)
        for name, variable in self.variables.items():
            for dim, size in variable.dims.items():
                whole(f"size of the dimension {dim} of {name}", size, 1, 10**18)
                if dim == _POINT or dim in self.axes or sizes.setdefault(dim, size) != size:
                    raise InputError(f"two dimensions have the name {dim}; rename that of {name}")
        for name in (*sizes, *self.variables):
            if not (isinstance(name, str) and name.isidentifier() and name.isascii()):
                raise InputError.of("name", shown(name), "a word of letters, digits and _")
        for name in self.variables:
            if name in sizes:
                raise InputError(f"a variable and a dimension have the name {name}; rename one")
        return sizes

    def _check_extent(self) -> None:
        size = f"{significant(self.total_bytes / 1e9)} GB of results"
        if self.points > _MOST_POINTS:
            raise InputError(
                f"the job has {self.points:.3g} points ({size}), at most {_MOST_POINTS:.0e} are "
                "allowed; take fewer points on an axis, or fewer axes"
            )
        least, most = -(-self.points // _MOST_BLOCKS), LARGEST_BLOCK // self._point_bytes
        if most < least:
            raise InputError(
                f"the job has {size}, at most {LARGEST_BLOCK * _MOST_BLOCKS / 1e9:.0f} GB are "
                "allowed; take fewer points on an axis, or fewer variables"
            )
        whole("block", self.block, least, most)

    # -- blocks --------------------------------------------------------------------------------

    @cached_property
    def points(self) -> int:
        """Number of points."""
        return math.prod(map(int, self.axes.values()))

    @cached_property
    def blocks(self) -> int:
        """Number of blocks."""
        return -(-self.points // self.block)

    @cached_property
    def total_bytes(self) -> int:
        """Bytes of all results, as numbers."""
        return self.points * self._point_bytes

    @cached_property
    def _point_bytes(self) -> int:
        return sum(
            np.dtype(variable.dtype).itemsize * math.prod(variable.dims.values())
            for variable in self.variables.values()
        )

    def span(self, number: int) -> tuple[int, int]:
        """First point and number of points of a block, both from 0."""
        first = number * self.block
        return first, min(self.block, self.points - first)

    def file_bytes(self, number: int) -> int:
        """Bytes of the file of a block, rounded up."""
        return self.span(number)[1] * self._point_bytes + _HEAD

    def block_name(self, number: int) -> str:
        """Block in a message, where blocks and points are counted from 1."""
        first, count = self.span(number)
        return f"block {number + 1} of {self.blocks} (points {first + 1} to {first + count})"

    # -- what it is ----------------------------------------------------------------------------

    @cached_property
    def identity(self) -> dict[str, Any]:
        """All that the results depend on, in terms of JSON."""
        content = {
            "description": dict(self.description),
            "axes": list(self.axes.items()),
            "coordinates": {
                name: {"values": list(c.values), "units": c.units, "long_name": c.long_name}
                for name, c in self.coordinates.items()
            },
            "variables": {
                name: {
                    "units": v.units,
                    "long_name": v.long_name,
                    "dims": list(v.dims.items()),
                    "dtype": v.dtype,
                }
                for name, v in self.variables.items()
            },
            "block": self.block,
            "made_by": MADE_BY,
        }
        text = json.dumps(content, allow_nan=False, default=lambda value: value.tolist())
        found = json.loads(text)
        assert isinstance(found, dict)
        return found

    @cached_property
    def hash(self) -> str:
        """SHA-256 of `identity`."""
        text = json.dumps(self.identity, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()

    # -- results of a block --------------------------------------------------------------------

    def compute(self, number: int) -> bytes:
        """Compute a block; return the bytes of its file."""
        first, count = self.span(number)
        found = self.evaluate(first, count)
        if not isinstance(found, Mapping) or set(found) != set(self.variables):
            given = ", ".join(map(str, found)) if isinstance(found, Mapping) else shown(found)
            raise InputError(
                f"evaluate gave {given or 'nothing'}, it must give {listed([*self.variables])}"
            )
        return self._file(first, count, {name: np.asarray(found[name]) for name in found})

    def _file(self, first: int, count: int, arrays: Arrays) -> bytes:
        from scipy.io import netcdf_file

        buffer = io.BytesIO()
        with netcdf_file(buffer, "w", version=2) as file:
            file.bowstring_version = __version__.encode()
            file.job_hash = self.hash.encode()
            file.first_point = str(first).encode()  # from 0
            file.createDimension(_POINT, count)
            for variable in self.variables.values():
                for dim, size in variable.dims.items():
                    if dim not in file.dimensions:
                        file.createDimension(dim, size)
            for name, variable in self.variables.items():
                array, shape = arrays[name], (count, *variable.dims.values())
                if array.shape != shape:
                    raise InputError(f"evaluate gave {name} of shape {array.shape}, not {shape}")
                if not np.can_cast(array.dtype, variable.dtype, "same_kind"):
                    raise InputError(
                        f"evaluate gave {name} as {array.dtype}, it must be {variable.dtype}"
                    )
                written = file.createVariable(name, variable.dtype, (_POINT, *variable.dims))
                written.units = variable.units.encode()
                written.long_name = variable.long_name.encode()
                written[:] = array
            file.flush()
            return buffer.getvalue()

    def arrays(self, content: bytes) -> Arrays:
        """Arrays of a block, from the bytes of its file."""
        from scipy.io import netcdf_file

        with netcdf_file(io.BytesIO(content), "r", mmap=False) as file:
            return {
                name: file.variables[name][:].astype(variable.dtype)
                for name, variable in self.variables.items()
            }

    def checksum(self, number: int, content: bytes) -> str:
        """Checksum of the bytes of a block, different for each block and job."""
        digest = hashlib.sha256(f"{self.hash} {number} ".encode())
        digest.update(content)
        return digest.hexdigest()[:16]


#: Versions on which the last bits of results depend, beside the job.
MADE_BY: Final = {"bowstring": __version__, "instructions": instructions()}
