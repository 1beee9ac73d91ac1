"""VTK series of a run for ParaView: .vtu files and the .pvd file that lists them.

Each output time has three parts: surface of the backbone, disks and tendons. Numbers are in single
precision, for pictures; the file of the run has double precision. Names of data contain the unit;
vectors are in the base frame, curvature is in body axes.
"""

from __future__ import annotations

import base64
import math
import re
import shutil
import struct
import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Floats, Progress
from bowstring.errors import InputError
from bowstring.files.atomic_io import check_whole_folder, not_overwritten, write_whole
from bowstring.robot.model import Robot, check_robot, check_round
from bowstring.statics.fields import FIELDS, Section, surface_stress
from bowstring.statics.model import RodModel
from bowstring.validation import shown, whole

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "Part",
    "Tendons",
    "check_data",
    "check_folder",
    "check_stations",
    "check_surface",
    "holes",
    "write_series",
    "write_vtk",
]

_PVD: Final = "run.pvd"
_MARK: Final = "<!-- Bowstring:"  # comment in the .pvd that identifies our files
_POLY_LINE, _POLYGON, _QUAD = 4, 7, 9
_OF_SPACE: Final = ("axis", "row", "column")
#: Variables that are shown, with their axes.
_SHOWN: Final[Mapping[str, tuple[str, ...]]] = {
    **{"time": ("time",), "arc_length": ("station",), "module": ("station",)},
    **{
        field.name: ("time", *field.dims)
        for field in FIELDS
        if field.name
        in (
            *("position", "rotation", "force", "moment", "curvature", "tension"),
            *("disk_position", "disk_rotation", "disk_velocity", "disk_angular_velocity"),
        )
    },
}
_LARGEST: Final = 1e20  # files have single precision


def check_folder(out: str | Path) -> Path:
    """Check before any work that a series may be written to a folder.

    Parameters
    ----------
    out : str or Path
        Folder, which need not exist; a former series in it will be replaced.

    Returns
    -------
    Path
        The same folder, absolute, links resolved.

    Raises
    ------
    InputError
        If the folder contains other files than a former series, or cannot be written.
    """
    return check_whole_folder(out, "VTK series", _check_content)


def _check_content(folder: Path, why: str) -> None:
    present = {path.name for path in folder.iterdir()}
    pvd = folder / _PVD
    text = pvd.read_text("utf-8", errors="replace") if pvd.is_file() else ""
    if text and _MARK not in text:
        raise not_overwritten(why, _PVD)
    listed = re.findall(r'file="([^"]*)"', text)
    foreign = sorted(present - {_PVD, *listed})
    if foreign:
        raise InputError(
            f"{why}: it holds {foreign[0]}, which is not of a VTK series of Bowstring, and "
            "existing files are not overwritten; name a new or an empty folder"
        )


def write_vtk(
    robot: Robot,
    data: xr.Dataset,
    out: str | Path,
    *,
    angles: int = 24,
    progress: Progress | None = None,
) -> Path:
    """Write a run as a VTK series, whole or not at all.

    Parameters
    ----------
    robot : Robot
        Robot of the run.
    data : xarray.Dataset
        Run from `Run.to_dataset` or `bowstring.dynamics.run_file.read_run`; select times by
        ``data.isel(time=slice(None, None, 10))``.
    out : str or Path
        Folder; a former series in it is replaced after success.
    angles : int
        Number of points around the backbone.
    progress : callable, optional
        Progress callback, called with the name of the work and its finished share from 0 to 1.

    Returns
    -------
    Path
        Path of the .pvd file for ParaView. Backbone: ``von_mises_Pa`` and ``axial_stress_Pa`` at
        each point of the surface, ``displacement_m`` from straight, ``curvature_per_m``. Disks:
        ``displacement_m, velocity_m_per_s``. Tendons: ``tension_N``.

    Raises
    ------
    InputError
        If the folder cannot be written, the drive is full or the data are of another robot.
    """
    notify = progress or (lambda what, share: None)
    whole("angles", angles, 3, 1000)
    check_data(robot, data)
    folder = check_folder(out)
    parts = [_Backbone(robot, data, angles), _Disks(robot, data), Tendons(robot, data)]
    return write_series(folder, parts, data, notify)


def write_series(folder: Path, parts: Sequence[Part], data: xr.Dataset, notify: Progress) -> Path:
    """Write parts at the times of ``data``; see `write_vtk`.

    Parameters
    ----------
    folder : Path
        Folder from `check_folder`.
    parts : sequence of Part
    data : xarray.Dataset
        Run with times and provenance attributes.
    notify : callable
        Progress callback.
    """
    times = data["time"].to_numpy()

    def fill(new: Path) -> None:
        need = len(times) * sum(len(part.piece(0)) for part in parts)
        free = shutil.disk_usage(new).free
        if need > free:
            raise InputError(
                f"cannot write the VTK series to {folder}: it needs {need / 1e9:.2g} GB and the "
                f"drive has {free / 1e9:.2g} GB free; choose fewer times"
            )
        rows = []
        for i, time in enumerate(times):
            notify("VTK series", i / len(times))
            for k, part in enumerate(parts):
                name = f"{part.name}_{i:05d}.vtu"
                (new / name).write_text(part.piece(i), encoding="utf-8")
                rows.append(
                    f'<DataSet timestep="{float(time)!r}" part="{k}" name="{part.name}" '
                    f'file="{name}"/>'
                )
        about = ", ".join(
            f"{key}={quoteattr(str(data.attrs[key]))}"
            for key in ("data_origin", "robot", "robot_hash", "bowstring_version")
            if key in data.attrs
        )
        (new / _PVD).write_text(
            '<?xml version="1.0"?>\n'
            f"{_MARK} {about.replace('--', '- -')}; SI units, base frame -->"
            '\n<VTKFile type="Collection" version="1.0">\n<Collection>\n'
            + "\n".join(rows)
            + "\n</Collection>\n</VTKFile>\n",
            encoding="utf-8",
        )

    write_whole(folder, "VTK series", fill, lambda: check_folder(folder))
    notify("VTK series", 1.0)
    return folder / _PVD


def check_data(robot: Robot, data: xr.Dataset) -> None:
    """Raise `InputError` if ``data`` are no run with poses of the robot at one time or more.

    Checks what figures and files show: its axes, finite numbers, increasing times, rotations, and
    stations in every module.
    """
    import xarray as xr

    check_robot(robot)
    if not isinstance(data, xr.Dataset):
        raise InputError(
            f"data is {shown(data)}, it must be a Dataset of a run: the run's `dataset`, or what "
            "`read_run` returns"
        )
    if data.sizes.get("time", 0) == 0 or "position" not in data:
        raise InputError("the run holds no output time; there is nothing to show")
    if data.attrs.get("robot_hash") != robot.hash:
        raise InputError(
            f"the run is of another robot ({data.attrs.get('robot', 'unnamed')}) than {robot.name} "
            "as given; their physics differ"
        )
    for name, dims in _SHOWN.items():
        _check_variable(data, name, dims)
    n, tendons = len(robot.disks.station_m), len(robot.tendons.end_disk)
    if (data.sizes["disk"], data.sizes["tendon"]) != (n, tendons):
        raise _damaged(f"it has not the {n} disks and {tendons} tendons of {robot.name}")
    if (np.diff(data["time"].to_numpy()) <= 0.0).any():
        raise _damaged("its times do not increase")
    for name in ("rotation", "disk_rotation"):
        turned = data[name].to_numpy()
        if (abs(np.einsum("...ij,...ik->...jk", turned, turned) - np.eye(3)) > 1e-3).any():
            raise _damaged(f"{name} holds numbers that are no rotation")
    module = data["module"].to_numpy()
    if not np.array_equal(np.unique(module), np.arange(1, n + 1)) or (np.diff(module) < 0).any():
        raise _damaged(f"module does not count the {n} modules in their order")


def _check_variable(data: xr.Dataset, name: str, dims: tuple[str, ...]) -> None:
    """Refuse a variable that is missing, has other axes, or holds other than finite numbers."""
    if name not in data.variables:
        raise _damaged(f"it has no {name}")
    found = data[name]
    if found.dims != dims or any(found.sizes[dim] != 3 for dim in dims if dim in _OF_SPACE):
        axes = [f"{dim} ({size})" for dim, size in found.sizes.items()]
        raise _damaged(f"{name} has the axes {', '.join(axes) or 'none'}")
    if found.dtype.kind not in "fiu":
        raise _damaged(f"{name} holds {found.dtype}, not numbers")
    if not (abs(found.to_numpy()) <= _LARGEST).all():
        raise _damaged(f"{name} holds numbers that are NaN or above {_LARGEST:g}")


def _damaged(why: str) -> InputError:
    return InputError(f"the run is damaged: {why}")


def check_stations(data: xr.Dataset) -> None:
    """Raise `InputError` if a module of a run has one station only, so no piece of backbone."""
    if np.bincount(data["module"].to_numpy())[1:].min() < 2:
        raise InputError("a surface needs 2 stations or more in a module; the run has 1")


# -- the parts ---------------------------------------------------------------------------------


class Part:
    """Part of the robot with its constant data: cells, and points of the straight robot."""

    name: str

    def __init__(self, cells: Iterable[Iterable[int]], kinds: list[int], straight: Floats) -> None:
        rows = [list(cell) for cell in cells]
        self.straight = straight
        self._cells = (
            f'<Piece NumberOfPoints="{len(straight)}" NumberOfCells="{len(rows)}">\n<Cells>\n'
            + _array("connectivity", np.concatenate(rows).astype(np.int32))
            + _array("offsets", np.cumsum([len(row) for row in rows], dtype=np.int32))
            + _array("types", np.array(kinds, dtype=np.uint8))
            + "</Cells>\n"
        )

    def at(self, i: int) -> tuple[Floats, Mapping[str, Floats]]:
        """Points (p, 3) and data by point at output time number i."""
        raise NotImplementedError

    def piece(self, i: int) -> str:
        """Text of the .vtu file of output time number i."""
        points, values = self.at(i)
        data = "".join(_array(name, array.astype(np.float32)) for name, array in values.items())
        order = "LittleEndian" if sys.byteorder == "little" else "BigEndian"
        return (
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" '
            f'byte_order="{order}" header_type="UInt64">\n<UnstructuredGrid>\n{self._cells}'
            f"<Points>\n{_array('points', points.astype(np.float32))}</Points>\n"
            f"<PointData>\n{data}</PointData>\n</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"
        )


def check_surface(robot: Robot) -> None:
    """Raise `InputError` if the surface of a robot's backbone, with its stress, is not known."""
    check_round(
        robot,
        f"{robot.name}: a VTK series with the stress on the backbone's surface",
        ", or write a run without it, as --out run.nc does",
    )


class _Backbone(Part):
    name = "backbone"

    def __init__(self, robot: Robot, data: xr.Dataset, angles: int) -> None:
        check_surface(robot)
        check_stations(data)
        station, module = data["arc_length"].to_numpy(), data["module"].to_numpy() - 1
        sec = Section(robot, station, module, RodModel())
        around = circle(angles)
        self._cos, self._sin = around[:, 0], around[:, 1]
        self._arm = sec.radius[:, None, None] * around  # (P, angles, 3), body axes
        self._position = data["position"].to_numpy()
        self._rotation = data["rotation"].to_numpy()
        self._curvature = data["curvature"].to_numpy()
        self._stress = surface_stress(sec, data["force"].to_numpy(), data["moment"].to_numpy())
        # no faces between modules, where stations coincide and the stress may jump
        quads = [
            (p * angles + j, p * angles + k, (p + 1) * angles + k, (p + 1) * angles + j)
            for p in np.flatnonzero(np.diff(module) == 0).tolist()
            for j, k in zip(range(angles), [*range(1, angles), 0], strict=True)
        ]
        straight = self._arm + np.stack([0.0 * station, 0.0 * station, station], axis=1)[:, None]
        super().__init__(quads, [_QUAD] * len(quads), straight.reshape(-1, 3))

    def at(self, i: int) -> tuple[Floats, Mapping[str, Floats]]:
        rotation, around = self._rotation[i], len(self._cos)
        points = self._position[i][:, None] + np.einsum("pij,paj->pai", rotation, self._arm)
        points = points.reshape(-1, 3)
        sigma, tau = (
            a[i][:, None] + b[i][:, None] * self._cos + c[i][:, None] * self._sin
            for a, b, c in self._stress
        )
        return points, {
            "von_mises_Pa": np.sqrt(sigma**2 + 3.0 * tau**2).ravel(),
            "axial_stress_Pa": sigma.ravel(),
            "displacement_m": points - self.straight,
            "curvature_per_m": np.repeat(self._curvature[i], around, axis=0),
        }


class _Disks(Part):
    name = "disks"

    def __init__(self, robot: Robot, data: xr.Dataset) -> None:
        disks, around = robot.disks, 48
        half = np.array([0.0, 0.0, 0.5]) * disks.thickness_m[:, None]
        rim = disks.radius_m[:, None, None] * circle(around)
        self._arm = np.concatenate([rim - half[:, None], rim + half[:, None]], axis=1)
        self._position = data["disk_position"].to_numpy()
        self._rotation = data["disk_rotation"].to_numpy()
        self._velocity = data["disk_velocity"].to_numpy()
        self._spin = data["disk_angular_velocity"].to_numpy()
        ring = list(range(around))
        cells: list[list[int]] = []
        kinds: list[int] = []
        for d in range(len(disks.station_m)):
            low, high = 2 * d * around, (2 * d + 1) * around
            cells += [[low + j for j in reversed(ring)], [high + j for j in ring]]
            cells += [
                [low + j, low + k, high + k, high + j]
                for j, k in zip(ring, [*ring[1:], 0], strict=True)
            ]
            kinds += [_POLYGON, _POLYGON] + [_QUAD] * around
        base = np.stack([0 * disks.station_m, 0 * disks.station_m, disks.station_m], axis=1)
        super().__init__(cells, kinds, (self._arm + base[:, None]).reshape(-1, 3))

    def at(self, i: int) -> tuple[Floats, Mapping[str, Floats]]:
        arm = np.einsum("dij,daj->dai", self._rotation[i], self._arm)
        points = (self._position[i][:, None] + arm).reshape(-1, 3)
        velocity = self._velocity[i][:, None] + np.cross(self._spin[i][:, None], arm)
        return points, {
            "displacement_m": points - self.straight,
            "velocity_m_per_s": velocity.reshape(-1, 3),
        }


class Tendons(Part):
    name = "tendons"

    def __init__(self, robot: Robot, data: xr.Dataset) -> None:
        self._holes = holes(robot, data)
        self._tension = data["tension"].to_numpy()
        self._counts = [len(path[0]) for path in self._holes]
        starts = np.cumsum([0, *self._counts[:-1]]).tolist()
        cells = [range(s, s + c) for s, c in zip(starts, self._counts, strict=True)]
        super().__init__(cells, [_POLY_LINE] * len(cells), np.zeros((sum(self._counts), 3)))

    def at(self, i: int) -> tuple[Floats, Mapping[str, Floats]]:
        """Points and tensions of all tendons at an output time.

        Parameters
        ----------
        i : int
            Index of the output time, from 0.

        Returns
        -------
        points : ndarray (p, 3)
            Holes of each tendon from the base to its end disk, one tendon after the other, in m,
            base frame.
        values : dict
            ``tension_N`` (p,): tension of the tendon before the base hole, in N, repeated at its
            points.
        """
        points = np.concatenate([path[i] for path in self._holes])
        return points, {"tension_N": np.repeat(self._tension[i], self._counts)}


def circle(count: int, *, closed: bool = False) -> Floats:
    """Points (count, 3) of the unit circle about z; if closed, the last equals the first."""
    psi = np.linspace(0.0, math.tau, count, endpoint=closed)
    return np.stack([np.cos(psi), np.sin(psi), 0.0 * psi], axis=1)


def holes(robot: Robot, data: xr.Dataset) -> list[Floats]:
    """Holes of each tendon from the base to its end disk.

    Returns
    -------
    list of ndarray (T, k + 1, 3)
        Positions in m, base frame, of each tendon with end disk k.
    """
    position, rotation = data["disk_position"].to_numpy(), data["disk_rotation"].to_numpy()
    return robot.tendon_points(position, rotation)


_TYPES: Final = {"f4": "Float32", "i4": "Int32", "u1": "UInt8"}


def _array(name: str, values: NDArray[Any]) -> str:
    """DataArray element; its base64 content is the number of bytes, then the bytes."""
    raw = np.ascontiguousarray(values).tobytes()
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    content = base64.b64encode(struct.pack("=Q", len(raw)) + raw).decode("ascii")
    kind = _TYPES[values.dtype.str[1:]]
    return f'<DataArray type="{kind}" Name="{name}"{width} format="binary">{content}</DataArray>\n'
