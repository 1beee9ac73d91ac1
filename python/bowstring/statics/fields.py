"""Fields of a run with labels and units: curvature, strain, stress, displacement and energy.

`derive` converts raw output (`Frames`) to arrays for many output times at once; `to_dataset` adds
labels. For a run with a file, the core packs the same values into bytes in the order of `FIELDS`.

Body axes of a section: z along the tangent, x and y along those of the base when it is straight.
Force and moment are those of the distal part on the section, so a positive force z is tension.
Disks, tendons, modules and segments are counted from 1 at the base.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import bowstring._core as _core
from bowstring.aliases import Bools, Floats, Ints
from bowstring.errors import InputError
from bowstring.robot.model import Robot, check_round
from bowstring.robot.stiffness import flexibility
from bowstring.statics.model import RodModel

if TYPE_CHECKING:
    import xarray as xr

SCHEMA_VERSION: Final = 2


@dataclass(frozen=True)
class Frames:
    """Raw output at T times and P stations for n disks and m tendons; SI, base axes by default.

    Attributes
    ----------
    time : ndarray (T,)
    station : ndarray (P,)
        Arc length along the straight backbone. Each module is sampled from its start to its end, so
        stations at disks occur twice, because the internal moment jumps there.
    module : ndarray of int (P,)
        Module of each station, from 0.
    position, rotation : ndarray (T, P, 3), (T, P, 3, 3)
        Centreline, and section axes, body to base.
    force, moment : ndarray (T, P, 3)
        Internal force and moment of the distal part on the section, in body axes.
    disk_position, disk_velocity, disk_angular_velocity : ndarray (T, n, 3)
    disk_rotation : ndarray (T, n, 3, 3)
    tension, tendon_length : ndarray (T, m)
    span_length : ndarray (T, n, m)
        NaN where a tendon does not pass.
    tendon_displacement, slack : ndarray (T, m)
        Tendon displacement since the home pose, and slack length.
    span_tension : ndarray (T, n, m)
        Tension of each span, in motion at the instant of the last step where forces balance. NaN
        where a tendon does not pass.
    kinetic_energy, elastic_energy, gravity_energy, work, dissipated_energy : ndarray (T,)
        Energies; work is that of tendons and loads on tip and disks since the start.
    """

    time: Floats
    station: Floats
    module: Ints
    position: Floats
    rotation: Floats
    force: Floats
    moment: Floats
    disk_position: Floats
    disk_rotation: Floats
    disk_velocity: Floats
    disk_angular_velocity: Floats
    tension: Floats
    tendon_length: Floats
    span_length: Floats
    tendon_displacement: Floats
    slack: Floats
    span_tension: Floats
    kinetic_energy: Floats
    elastic_energy: Floats
    gravity_energy: Floats
    work: Floats
    dissipated_energy: Floats


class Field(NamedTuple):
    """Variable over time: name, further dimensions, unit, axes (or "") and meaning."""

    name: str
    dims: tuple[str, ...]
    units: str
    frame: str
    long_name: str


_STATION: Final = ("station",)
_STATION_AXIS: Final = ("station", "axis")
_DISK_AXIS: Final = ("disk", "axis")
_TENDON: Final = ("tendon",)

FIELDS: Final[tuple[Field, ...]] = (
    Field("position", _STATION_AXIS, "m", "base", "position of the centreline"),
    Field("rotation", ("station", "row", "column"), "1", "base from body", "axes of the section"),
    Field("force", _STATION_AXIS, "N", "body", "internal force on the section, z is tension"),
    Field("moment", _STATION_AXIS, "N m", "body", "internal moment on the section, z is torsion"),
    Field("curvature", _STATION_AXIS, "1/m", "body", "curvature about x and y, twist about z"),
    Field("strain", _STATION_AXIS, "1", "body", "shear strain along x and y, extension along z"),
    Field("axial_stress", _STATION, "Pa", "", "mean normal stress N/A, positive in tension"),
    Field("bending_stress", _STATION, "Pa", "", "largest stress of bending at the surface"),
    Field("normal_stress", _STATION, "Pa", "", "largest magnitude of normal stress at the surface"),
    Field("shear_stress", _STATION, "Pa", "", "largest stress of transverse shear at the surface"),
    Field("torsion_stress", _STATION, "Pa", "", "magnitude of torsion stress at the surface"),
    Field("von_mises", _STATION, "Pa", "", "largest von Mises stress around the surface"),
    Field(
        "von_mises_angle",
        _STATION,
        "rad",
        "body",
        "angle around the section where it is, x towards y",
    ),
    Field("von_mises_place", _STATION_AXIS, "m", "base", "point of the surface where it is"),
    Field("von_mises_max", (), "Pa", "", "largest von Mises stress of the robot"),
    Field("von_mises_max_arc_length", (), "m", "", "arc length at which it is"),
    Field("von_mises_max_place", ("axis",), "m", "base", "point of the surface where it is"),
    Field("disk_position", _DISK_AXIS, "m", "base", "position of the disks"),
    Field("disk_rotation", ("disk", "row", "column"), "1", "base from body", "axes of the disks"),
    Field("disk_velocity", _DISK_AXIS, "m/s", "base", "velocity of the disks"),
    Field("disk_angular_velocity", _DISK_AXIS, "rad/s", "base", "angular velocity of the disks"),
    Field("tip_displacement", ("axis",), "m", "base", "displacement of the tip from straight"),
    Field("tension", _TENDON, "N", "", "tension of the tendons before the base hole"),
    Field("tendon_length", _TENDON, "m", "", "length of the tendons, base to end disk"),
    Field("tendon_displacement", _TENDON, "m", "", "tendon displacement since the home pose"),
    Field("slack", _TENDON, "m", "", "slack length of the tendons"),
    Field("span_length", ("disk", "tendon"), "m", "", "length of the span that ends at the disk"),
    Field("span_tension", ("disk", "tendon"), "N", "", "tension of that span"),
    Field("kinetic_energy", (), "J", "", "kinetic energy"),
    Field("elastic_energy", (), "J", "", "elastic energy, that of actuated tendons too"),
    Field("gravity_energy", (), "J", "", "potential energy in gravity"),
    Field("work", (), "J", "", "work of motors and loads since the start"),
    Field(
        "dissipated_energy", (), "J", "", "energy that damping and friction took since the start"
    ),
    Field("energy_balance", (), "J", "", "energy gained minus work plus dissipated: the error"),
)
"""All variables over time, in the order of the file and of the core's records."""

_RAW: Final = frozenset(Frames.__dataclass_fields__)


def _coupled(robot: Robot, segment: Ints, model: RodModel, free: Bools) -> Floats | None:
    """Strains by moment and force (P, 6, 6) where a stiffness matrix is given, NaN elsewhere."""
    if np.isnan(robot.section_stiffness).all():
        return None
    by_segment = np.full((len(robot.segments), 6, 6), np.nan)
    strains = [
        q for q in range(6) if (q != 2 or model.twist) and (q < 3 or model.theory != "kirchhoff")
    ]
    for own, stiffness in zip(by_segment, robot.section_stiffness, strict=True):
        if not np.isnan(stiffness).any():
            own[:] = 0.0
            own[np.ix_(strains, strains)] = flexibility(stiffness[np.ix_(strains, strains)])
    return np.asarray(by_segment[segment] * free[:, :, None])


class Section:
    """Properties of backbone sections at stations (P,) for stress and strain, SI.

    Parameters
    ----------
    robot : Robot
    station : ndarray (P,)
        Arc lengths in m.
    module : ndarray of int (P,)
        Module of each station, from 0.
    model : RodModel
        A Kirchhoff rod has no shear and no extension; one without twist does not twist.
    partly : bool
        Whether segments may be rectangular, where stress and strain are NaN, or by a stiffness
        matrix, where stress is.
    """

    def __init__(
        self,
        robot: Robot,
        station: Floats,
        module: Ints,
        model: RodModel,
        *,
        partly: bool = False,
    ) -> None:
        if not (robot.is_round or partly):
            check_round(
                robot,
                f"{robot.name}: a file with stress and strain",
                ", or write a table of tip and tendons, as --out run.csv does",
            )
        segment = robot.disks.segment[module]
        ends = np.cumsum([s.length for s in robot.segments])
        numbers = np.full((8, len(station)), np.nan)
        for k, part in enumerate(robot.segments):
            here = segment == k
            if not part.backbone.is_round:
                continue
            rod = part.backbone.at(1.0 + (station[here] - ends[k]) / part.length)
            area, second, shear = rod.area, rod.second_moment, rod.shear_modulus
            assert rod.diameter is not None
            each = (rod.diameter, rod.inner_diameter, area, second)
            stiff = (rod.young * second, 2.0 * shear * second, shear * area, rod.young * area)
            numbers[:, here] = np.stack(np.broadcast_arrays(station[here], *each, *stiff))[1:]
        outer, inner, area, second = 0.5 * numbers[0], 0.5 * numbers[1], *numbers[2:4]
        bend, turn, slide, stretch = 1.0 / numbers[4:]
        # the parabolic law V Q / (I b) at the neutral axis: 4/3 for a solid rod, 2 for a thin tube
        shear_factor = 4.0 / 3.0 * (outer**2 + outer * inner + inner**2) / (outer**2 + inner**2)
        self.radius: Floats = outer
        sizes = np.column_stack([outer, area, second / outer, shear_factor / area])
        turn = turn * float(model.twist)
        soft = float(model.theory != "kirchhoff")
        slide, stretch = soft * slide, soft * stretch
        # Clamped lengths are rigid; only the disks before and after a station can clamp it.
        d = robot.disks
        after = np.searchsorted(d.station_m, station)
        beside = np.clip([after - 1, after], 0, len(d.station_m) - 1)
        depth = 0.5 * d.clamped_length_m[beside] - abs(station - d.station_m[beside])
        free = np.all(depth <= 1e-9 * robot.length, axis=0)[:, None]
        self.coupled: Floats | None = _coupled(robot, segment, model, free)
        self.bending_compliance: Floats = np.stack([bend, bend, turn], axis=1) * free
        self.rest_curvature: Floats = robot.rest_curvature[segment] * free
        force_compliance = np.stack([slide, slide, stretch], axis=1) * free
        # as the core takes them, one row a section
        self.columns: Floats = np.hstack([sizes, self.bending_compliance, force_compliance])


def check_frames(robot: Robot, frames: Frames) -> None:
    """Raise `InputError` if the arrays of ``frames`` do not fit each other or the robot."""
    t, p = len(frames.time), len(frames.station)
    n, sizes = len(robot.disks.station_m), _sizes(robot, p)
    shapes = {field.name: (t, *(sizes[dim] for dim in field.dims)) for field in FIELDS}
    shapes |= {"time": (t,), "station": (p,), "module": (p,)}
    for name in Frames.__dataclass_fields__:
        shape = np.shape(getattr(frames, name))
        if shape != shapes[name]:
            raise InputError(
                f"{name} of the frames has shape {shape}; must be {shapes[name]} for {robot.name} "
                f"with {t} times and {p} stations"
            )
    if p == 0:
        raise InputError("the frames have no station; sample each module at one point or more")
    if frames.module.min() < 0 or frames.module.max() >= n:
        raise InputError(f"module of the frames must be 0 to {n - 1}, one for each disk")
    time = frames.time
    if not (time[1:] > time[:-1]).all() or not np.isfinite(time).all():
        raise InputError("time of the frames must be finite and increase")


def surface_stress(sec: Section, force: Floats, moment: Floats) -> tuple[Floats, Floats]:
    """Normal and shear stress around the surface of every section, theory Eq. 6.1.

    Parameters
    ----------
    sec : Section
        Sections at P stations.
    force, moment : ndarray (..., P, 3)
        Internal force and moment in body axes, in N and N m.

    Returns
    -------
    sigma, tau : ndarray (3, ..., P)
        Coefficients a, b, c in Pa: at the angle psi from x towards y the stress is
        ``a + b cos(psi) + c sin(psi)``. sigma is along the tangent, positive in tension; tau is in
        the section, in the direction of increasing psi. Transverse shear follows the parabolic law.
    """
    found = _core.surface_stress(sec.columns, _floats(force), _floats(moment))
    return found[0], found[1]


def von_mises(sigma: Floats, tau: Floats) -> tuple[Floats, Floats, Floats]:
    """Maximum of sqrt(sigma^2 + 3 tau^2) around each section, theory Eq. 6.2.

    Parameters
    ----------
    sigma, tau : ndarray (3, ...)
        Coefficients from `surface_stress`.

    Returns
    -------
    value, cosine, sine : ndarray (...)
        Maximum in Pa, exact to 1e-12 of it, and cosine and sine of its angle.
    """
    rows = (_floats(v).reshape(3, -1) for v in (sigma, tau))
    found = _core.von_mises(*rows).reshape(sigma.shape)
    return found[0], found[1], found[2]


def derive(robot: Robot, frames: Frames, sec: Section) -> dict[str, Floats]:
    """Compute all variables of `FIELDS` for the times of ``frames``.

    Parameters
    ----------
    robot : Robot
    frames : Frames
        Raw output; the energy balance begins at its first time.
    sec : Section
        Sections at its stations.

    Returns
    -------
    dict from name to ndarray (T, ...)
    """
    vectors = (frames.position, frames.rotation, frames.force, frames.moment)
    out = _core.derive(sec.columns, *map(_floats, vectors))
    out |= _of_sections(sec, frames.station, out, frames.force, frames.moment)
    out["tip_displacement"] = frames.disk_position[:, -1] - (0.0, 0.0, robot.length)
    energy = frames.kinetic_energy + frames.elastic_energy + frames.gravity_energy
    balance = energy - frames.work + frames.dissipated_energy  # theory Eq. 5.3
    out["energy_balance"] = balance - (balance[0] if len(balance) else 0.0)
    return {f.name: getattr(frames, f.name) if f.name in _RAW else out[f.name] for f in FIELDS}


def _of_sections(
    sec: Section, station: Floats, found: Mapping[str, Floats], force: Floats, moment: Floats
) -> dict[str, Floats]:
    """Fields that need more than the columns of `sec`, from the core's results by these."""
    curvature, strain = found["curvature"], found["strain"]
    if sec.coupled is not None:
        wrench = np.concatenate([moment, force], axis=-1)
        by_matrix = np.einsum("pij,tpj->tpi", sec.coupled, wrench)
        known = ~np.isnan(by_matrix[..., :1])
        curvature = np.where(known, by_matrix[..., :3], curvature)
        strain = np.where(known, by_matrix[..., 3:], strain)
    stress = found["von_mises"]
    times = np.arange(len(stress))
    top = np.where(np.isnan(stress), -math.inf, stress).argmax(axis=1)
    largest = stress[times, top]
    return {
        # the moments give the change from the unloaded backbone
        "curvature": curvature + sec.rest_curvature,
        "strain": strain,
        "von_mises_max": largest,
        "von_mises_max_arc_length": np.where(np.isnan(largest), math.nan, station[top]),
        "von_mises_max_place": found["von_mises_place"][times, top],
    }


def completing(
    robot: Robot, sec: Section, station: Floats, append: Callable[[NDArray[np.uint8]], None]
) -> Callable[[NDArray[np.uint8]], None]:
    """Complete records of the core before they are appended to a file.

    Parameters
    ----------
    robot : Robot
    sec : Section
        Sections at P stations.
    station : ndarray (P,)
        Arc lengths in m.
    append : callable
        Takes whole records as bytes: time and all of `FIELDS`, big-endian.

    Returns
    -------
    callable
        `append` itself where the core knows all of the sections: plain ones, straight without load.
    """
    if sec.coupled is None and not sec.rest_curvature.any():
        return append
    sizes = _sizes(robot, len(station))
    shapes = {field.name: tuple(sizes[dim] for dim in field.dims) for field in FIELDS}
    ends = 1 + np.cumsum([math.prod(shape) for shape in shapes.values()])
    places = {
        name: slice(end - math.prod(shapes[name]), end)
        for name, end in zip(shapes, ends, strict=True)
    }

    def complete(records: NDArray[np.uint8]) -> None:
        rows = records.view(">f8").reshape(-1, int(ends[-1]))
        found = {
            name: rows[:, places[name]].reshape(-1, *shapes[name]).astype(float)
            for name in ("force", "moment", "curvature", "strain", "von_mises", "von_mises_place")
        }
        better = _of_sections(sec, station, found, found["force"], found["moment"])
        for name, values in better.items():
            rows[:, places[name]] = values.reshape(len(rows), -1)
        append(records)

    return complete


def _sizes(robot: Robot, stations: int) -> dict[str, int]:
    """Sizes of the dimensions of `FIELDS`."""
    disks, tendons = len(robot.disks.station_m), len(robot.tendons.end_disk)
    return {
        "station": stations,
        "axis": 3,
        "row": 3,
        "column": 3,
        "disk": disks,
        "tendon": tendons,
    }


def _floats(values: Floats) -> Floats:
    return np.ascontiguousarray(values, dtype=np.float64)


def coordinates(
    robot: Robot, station: Floats, module: Ints
) -> dict[str, tuple[str, Any, dict[str, str]]]:
    """Coordinates other than time: name to (dimension, values, attributes)."""
    axes = np.array(["x", "y", "z"])
    n, m = len(robot.disks.station_m), len(robot.tendons.end_disk)

    def count(dim: str, values: Any, text: str) -> tuple[str, Any, dict[str, str]]:
        return dim, np.asarray(values, dtype=np.int32), {"units": "1", "long_name": text}

    def length(dim: str, values: Floats) -> tuple[str, Any, dict[str, str]]:
        about = {"units": "m", "long_name": "arc length along the straight backbone"}
        return dim, np.asarray(values, dtype=float), about

    segment = robot.disks.segment[module]
    return {
        "axis": ("axis", axes, {"long_name": "axis of a vector; each variable names its frame"}),
        "row": ("row", axes, {"long_name": "axis of the base"}),
        "column": ("column", axes, {"long_name": "axis of the body"}),
        "disk": count("disk", range(1, n + 1), "disk, counted from 1 at the base"),
        "tendon": count("tendon", range(1, m + 1), "tendon, counted from 1"),
        "arc_length": length("station", station),
        "module": count("station", module + 1, "module, counted from 1 at the base"),
        "segment": count("station", segment + 1, "segment, counted from 1 at the base"),
        "disk_arc_length": length("disk", robot.disks.station_m),
    }


TIME: Final = {"units": "s", "long_name": "time since the start of the run"}
"""Attributes of the time coordinate."""


def field_attributes(field: Field) -> dict[str, str]:
    """Attributes ``units``, ``long_name`` and, if it has one, ``frame`` of a variable."""
    attrs = {"units": field.units, "long_name": field.long_name}
    return attrs | {"frame": field.frame} if field.frame else attrs


def attributes(robot: Robot, settings: Mapping[str, Any]) -> dict[str, str | int]:
    """Provenance of a run as text and numbers, which NetCDF can store.

    Parameters
    ----------
    robot : Robot
    settings : mapping
        Values that JSON can represent, and arrays.

    Returns
    -------
    dict
        ``settings`` and ``robot_definition`` are JSON text.
    """
    try:
        text = json.dumps(dict(settings), allow_nan=False, default=_plain)
    except (TypeError, ValueError) as error:
        raise InputError(f"the settings of a run must be plain values: {error}") from None
    return {
        "title": f"Bowstring run of {robot.name}",
        "data_origin": "simulated",
        "schema_version": SCHEMA_VERSION,
        "bowstring_version": str(_core.__version__),
        "robot": robot.name,
        "robot_hash": robot.hash,
        "robot_definition": robot.definition,
        "settings": text,
    }


def _plain(value: object) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError(f"got {type(value).__name__}")


Labelled = tuple[tuple[str, ...], Any, str, str]
"""Further dimensions of a variable, its values, unit and meaning."""


def rows_to_dataset(
    robot: Robot,
    row: str,
    values: Mapping[str, Any],
    others: Mapping[str, Labelled],
    settings: Mapping[str, Any],
) -> xr.Dataset:
    """Label results in rows, of several loads or several modes.

    Parameters
    ----------
    robot : Robot
    row : str
        Name of the first dimension; its coordinate counts from 1.
    values : mapping from name to array
        Variables of `FIELDS`.
    others : mapping from name to Labelled
        Further variables.
    settings : mapping
        Settings of the solve, stored as an attribute.
    """
    import xarray as xr

    known = {field.name: field for field in FIELDS}
    variables: dict[str, Any] = {
        name: ((row, *known[name].dims), array, field_attributes(known[name]))
        for name, array in values.items()
    }
    for name, (dims, array, units, meaning) in others.items():
        variables[name] = ((row, *dims), array, {"units": units, "long_name": meaning})
    count = len(next(iter(variables.values()))[1])
    used = {dim for dims, *_ in variables.values() for dim in dims}
    none = np.zeros(0, dtype=np.int64)
    places = coordinates(robot, np.zeros(0), none)
    return xr.Dataset(
        variables,
        coords={
            row: (row, np.arange(1, count + 1, dtype=np.int32)),
            **{name: value for name, value in places.items() if value[0] in used},
        },
        attrs=attributes(robot, settings),
    )


def to_dataset(
    robot: Robot,
    frames: Frames,
    settings: Mapping[str, Any],
    *,
    status: str = "converged",
    reason: str = "",
) -> xr.Dataset:
    """Label raw output and add all derived fields.

    Parameters
    ----------
    robot : Robot
    frames : Frames
    settings : mapping
        Settings of the run; ``theory`` (default ``"cosserat"``) and ``twist`` (default True)
        determine which strains exist.
    status, reason : str
        Status of the run, and the reason if it stopped early.

    Returns
    -------
    xarray.Dataset
        All variables of `FIELDS`, with ``units``, ``long_name`` and ``frame``, as
        `bowstring.dynamics.run_file.read_run` returns them. ``to_netcdf`` can store it.

    Raises
    ------
    InputError
        If the arrays do not fit each other or the robot.
    """
    import xarray as xr

    check_frames(robot, frames)
    model = RodModel(settings.get("theory"), twist=bool(settings.get("twist", True)))
    # a stiffness matrix gives strain, but no stress
    partly = robot.has_matrix
    sections = Section(robot, frames.station, frames.module, model, partly=partly)
    values = derive(robot, frames, sections)
    end = float(frames.time[-1]) if len(frames.time) else math.nan
    return xr.Dataset(
        {f.name: (("time", *f.dims), values[f.name], field_attributes(f)) for f in FIELDS},
        coords={
            "time": ("time", np.asarray(frames.time), TIME),
            **coordinates(robot, frames.station, frames.module),
        },
        attrs={
            "complete_to_s": end,
            "status": status,
            "reason": reason,
            **attributes(robot, settings),
        },
    )
