"""The robot: its file with units, its checks, and its numbers in SI as arrays.

A robot is read from YAML (`load_robot`), checked as a whole, and never changes afterwards;
`Robot.with_` returns a changed copy. Inside there are only SI numbers and radians.
"""

from __future__ import annotations

import difflib
import importlib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationError,
    model_validator,
)
from pydantic_core import PydanticCustomError

from bowstring.display import html_table, short_repr
from bowstring.errors import InputError
from bowstring.robot.disk import distinct_holes, drilled_disk, room_for_holes
from bowstring.robot.plausibility import doubts
from bowstring.robot.safe_yaml import read_yaml, reading, text_of
from bowstring.units import (
    NUMBER,
    Choice,
    Count,
    Quantity,
    Share,
    Text,
    number_with_unit,
    printable,
    quote,
    wrong,
)
from bowstring.validation import shown

__all__ = [
    "Backbone",
    "Disks",
    "Robot",
    "RobotDisks",
    "RobotTendons",
    "Segment",
    "Tendon",
    "TendonRing",
    "load_robot",
    "robot_names",
    "robot_schema",
]

TENDON_MATERIALS: Final = {
    "steel": 105e9,
    "tungsten": 200e9,
    "nitinol": 55e9,
    "aramid": 40e9,
    "polyethylene": 30e9,
    "nylon": 2.5e9,
}
"""E A over the area of the full circle in Pa, for a tendon of that material whose E A is not known:
the middle between strand and wire (steel: 60 to 190 GPa), right within a factor of two."""
_BUILT_IN: Final = Path(__file__).with_name("builtin")
_MAX_SEGMENTS: Final = 100
_MAX_DISKS: Final = 100_000
_MAX_TENDONS: Final = 1_000

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


def _exactly_one(part: BaseModel, first: str, second: str) -> None:
    given = (getattr(part, first) is not None) + (getattr(part, second) is not None)
    if given != 1:
        problem = "both given" if given else "missing"
        raise wrong(f"{first} and {second}: {problem}; write exactly one of the two")


def _one_of(first: str, second: str) -> Any:
    return {"oneOf": [{"required": [first]}, {"required": [second]}]}


class Backbone(_Part):
    """The elastic rod in the middle of a segment: round, solid or a tube.

    Attributes
    ----------
    diameter, inner_diameter : float
        Outer diameter, and that of the bore (0 for a solid rod), in m.
    E, G : float
        Young's and shear modulus in Pa; ``G`` is None where ``nu`` is given.
    nu : float
        Poisson's ratio; None where ``G`` is given.
    density : float
        In kg/m^3.
    yield_strength, strain_limit : float or None
        Von Mises stress in Pa and strain that the material can take; they only warn.
    """

    model_config = ConfigDict(json_schema_extra=_one_of("G", "nu"))

    diameter: Annotated[float, Quantity("m", "5 mm", "1 um", "10 m")] = Field(
        description="Outer diameter."
    )
    inner_diameter: Annotated[float, Quantity("m", "3 mm", "0 mm", "10 m")] = Field(
        0.0, description="Diameter of the bore of a tube; leave out for a solid rod."
    )
    E: Annotated[float, Quantity("Pa", "35 GPa", "1 Pa", "10 TPa")] = Field(
        description="Young's modulus."
    )
    G: Annotated[float | None, Quantity("Pa", "13 GPa", "0.1 Pa", "10 TPa")] = Field(
        None, description="Shear modulus; give this or nu."
    )
    nu: Annotated[float | None, Quantity("", "0.3", "-0.99", "0.5")] = Field(
        None, description="Poisson's ratio; give this or G."
    )
    density: Annotated[float, Quantity("kg/m^3", "1800 kg/m^3", "0 kg/m^3", "1e5 kg/m^3")] = Field(
        description="Mass by volume of the material."
    )
    yield_strength: Annotated[float | None, Quantity("Pa", "200 MPa", "1 Pa", "1 TPa")] = Field(
        None, description="Von Mises stress that the material can take, for warnings."
    )
    strain_limit: Annotated[float | None, Share("1 %", 10.0)] = Field(
        None, description="Strain along the surface that the material can take, for warnings."
    )

    @model_validator(mode="after")
    def _check(self) -> Backbone:
        _exactly_one(self, "G", "nu")
        return self

    @property
    def shear_modulus(self) -> float:
        """Shear modulus in Pa, as given or from E and nu."""
        if self.nu is not None:
            return self.E / (2.0 * (1.0 + self.nu))
        assert self.G is not None
        return self.G

    @property
    def area(self) -> float:
        """Area of the section in m^2."""
        return math.pi / 4.0 * (self.diameter**2 - self.inner_diameter**2)

    @property
    def second_moment(self) -> float:
        """Second moment of area about a diameter in m^4; the polar one is twice this."""
        return math.pi / 64.0 * (self.diameter**4 - self.inner_diameter**4)


class Disks(_Part):
    """The spacer disks of a segment; the last one is its end disk.

    Attributes
    ----------
    count : int
        Number of evenly spaced disks; None where ``positions`` is given.
    positions : tuple of float
        Distances from the segment's start in m; None where ``count`` is given.
    mass : float
        Of each disk in kg, as if of a full cylinder; None where ``density`` is given.
    density : float
        Of the material in kg/m^3; with the holes it gives mass and inertia. None where ``mass`` is.
    radius, thickness : float
        Of each disk, in m.
    hole_diameter : float
        Of the holes of the tendons in m; None where it is not known.
    clamped_length : float
        Length of backbone that each disk holds rigid, centred on the disk, in m.
    """

    model_config = ConfigDict(
        json_schema_extra={"allOf": [_one_of("count", "positions"), _one_of("mass", "density")]}
    )

    count: Annotated[int | None, Count(_MAX_DISKS, "9")] = Field(
        None, description="Number of evenly spaced disks, the last at the segment's end."
    )
    positions: Annotated[
        tuple[float, ...] | None, Quantity("m", "100 150 200 mm", "1 um", "1 km", vector=0)
    ] = Field(
        None,
        description="Distances from the segment's start, increasing, the last at its end; "
        "instead of count.",
    )
    mass: Annotated[float | None, Quantity("kg", "20 g", "0 g", "10000 kg")] = Field(
        None, description="Mass of each disk; give this or density."
    )
    density: Annotated[
        float | None, Quantity("kg/m^3", "1200 kg/m^3", "0 kg/m^3", "1e5 kg/m^3")
    ] = Field(
        None, description="Mass by volume of the disks' material; needs hole_diameter as well."
    )
    radius: Annotated[float, Quantity("m", "32 mm", "1 um", "100 m")] = Field(
        description="Outer radius of each disk; the holes lie within it."
    )
    thickness: Annotated[float, Quantity("m", "3 mm", "0 mm", "100 m")] = Field(
        description="Thickness of each disk, for its inertia."
    )
    hole_diameter: Annotated[float | None, Quantity("m", "2 mm", "1 um", "100 m")] = Field(
        None, description="Diameter of the holes that the tendons pass."
    )
    clamped_length: Annotated[float, Quantity("m", "3 mm", "0 mm", "100 m")] = Field(
        0.0, description="Length of backbone that each disk holds rigid; 0 if left out."
    )

    @model_validator(mode="after")
    def _check(self) -> Disks:
        _exactly_one(self, "count", "positions")
        _exactly_one(self, "mass", "density")
        if self.density is not None and self.hole_diameter is None:
            raise wrong(
                "hole_diameter: missing; with density the mass is that of the disk without its "
                'holes, write for example "hole_diameter: 2 mm"'
            )
        return self


_PITCH = Quantity("m", "29 mm", "1 um", "100 m")
_ANGLE = Quantity("rad", "120 deg", "-360 deg", "360 deg")


class _TendonDrive(_Part):
    """What ring and list say alike: how a tendon stretches, rubs and is driven, how thick it is.

    Left out, a tendon is inextensible, frictionless and directly driven.
    """

    axial_stiffness: Annotated[float | None, Quantity("N", "20 kN", "1 mN", "1e12 N")] = Field(
        None, description="E A of the tendon; leave out for an inextensible one."
    )
    free_length: Annotated[float, Quantity("m", "300 mm", "0 mm", "1 km")] = Field(
        0.0, description="Length of tendon from the base hole to the actuator; 0 if left out."
    )
    compliance: Annotated[float, Quantity("m/N", "0.01 mm/N", "0 m/N", "1000 m/N")] = Field(
        0.0, description="Give of the transmission (spool, gearbox, sheath); 0 if left out."
    )
    friction: Annotated[float, Quantity("", "0.1", "0", "10")] = Field(
        0.0, description="Coulomb's coefficient mu at each hole; 0 if left out."
    )
    pretension: Annotated[float, Quantity("N", "2 N", "0 N", "1e9 N")] = Field(
        0.0, description="Tension in the home pose, where the pull is zero; 0 if left out."
    )
    spool_radius: Annotated[float | None, Quantity("m", "10 mm", "1 um", "100 m")] = Field(
        None, description="Radius at which a spool winds the tendon; needed for motor angles."
    )
    diameter: Annotated[float | None, Quantity("m", "1 mm", "1 um", "100 m")] = Field(
        None,
        description="Diameter of the tendon, for its solid, and for the E A that a study assumes.",
    )
    material: Annotated[str | None, Choice(tuple(TENDON_MATERIALS), "steel")] = Field(
        None, description="Material of the tendon, for the E A that a study assumes; else steel."
    )


class TendonRing(_TendonDrive):
    """Tendons evenly spaced on a circle, counter-clockwise about z, all driven alike.

    Attributes
    ----------
    count : int
        Number of tendons.
    pitch_radius : float
        Distance of the holes from the backbone's axis in m.
    first_angle : float
        Angle of the first tendon from x in rad.
    axial_stiffness, free_length, compliance, friction, pretension, spool_radius, diameter : float
        Of each tendon, as in `Tendon`.
    material : str or None
        Of each tendon.
    """

    count: Annotated[int, Count(_MAX_TENDONS, "3")] = Field(description="Number of tendons.")
    pitch_radius: Annotated[float, _PITCH] = Field(
        description="Distance of the holes from the backbone's axis."
    )
    first_angle: Annotated[float, _ANGLE] = Field(
        0.0, description="Angle of the first tendon from x, counter-clockwise; 0 if left out."
    )


class Tendon(_TendonDrive):
    """One tendon of a list.

    Attributes
    ----------
    angle : float
        From x, counter-clockwise about z, in rad.
    pitch_radius : float
        Distance of its holes from the backbone's axis in m.
    axial_stiffness : float or None
        E A in N; None for an inextensible tendon.
    free_length : float
        Between the base hole and the actuator in m; it stretches as well.
    compliance : float
        Of the transmission in m/N.
    friction : float
        Coulomb's coefficient at each hole.
    pretension : float
        Tension in the home pose, where the pull is zero, in N.
    spool_radius : float or None
        In m; None where no spool is given, hence no motor angle.
    diameter : float or None
        In m; the solid has it, and a study that has to assume E A.
    material : str or None
        One of `TENDON_MATERIALS`; for a study that has to assume E A.
    """

    angle: Annotated[float, _ANGLE] = Field(description="Angle from x, counter-clockwise.")
    pitch_radius: Annotated[float, _PITCH] = Field(
        description="Distance of the holes from the backbone's axis."
    )


def _tendon_form(value: object) -> str:
    return "list" if isinstance(value, (list, tuple)) else "ring"


class Segment(_Part):
    """One segment: backbone, disks, and the tendons that end at its last disk.

    Attributes
    ----------
    name : str or None
    length : float
        Of the straight backbone in m.
    backbone : Backbone
    disks : Disks
    tendons : TendonRing or tuple of Tendon
    """

    name: Annotated[str | None, Text(100, "inner")] = Field(None, description="For reports.")
    length: Annotated[float, Quantity("m", "641 mm", "1 um", "1 km")] = Field(
        description="Length of the segment's backbone, base or last end disk to its end disk."
    )
    backbone: Backbone
    disks: Disks
    tendons: Annotated[
        Annotated[TendonRing, Tag("ring")]
        | Annotated[tuple[Tendon, ...], Field(min_length=1, max_length=_MAX_TENDONS), Tag("list")],
        Discriminator(_tendon_form),
    ]

    @cached_property
    def disk_positions(self) -> tuple[float, ...]:
        """Distances of the disks from the segment's start in m; the last is `length`."""
        if self.disks.positions is not None:
            return (*self.disks.positions[:-1], self.length)
        assert self.disks.count is not None
        n = self.disks.count
        return (*(self.length * i / n for i in range(1, n)), self.length)

    @cached_property
    def tendon_list(self) -> tuple[Tendon, ...]:
        """The tendons one by one, also where the file gives them as a ring."""
        ring = self.tendons
        if not isinstance(ring, TendonRing):
            return ring
        step = math.tau / ring.count
        drive = {name: getattr(ring, name) for name in _TendonDrive.model_fields}
        return tuple(
            Tendon.model_construct(
                angle=ring.first_angle + i * step, pitch_radius=ring.pitch_radius, **drive
            )
            for i in range(ring.count)
        )


@short_repr
@dataclass(frozen=True)
class RobotDisks:
    """All disks from base to tip (N of them, the base excluded), in SI.

    ``inertia_kg_m2`` (N, 2) are the moments of inertia about a diameter and about the axis.
    ``bore_m`` are the diameters of the holes that the backbone passes.
    """

    station_m: Floats
    clamped_length_m: Floats
    mass_kg: Floats
    inertia_kg_m2: Floats
    radius_m: Floats
    thickness_m: Floats
    bore_m: Floats
    segment: Ints


@short_repr
@dataclass(frozen=True)
class RobotTendons:
    """All tendons (T of them, segment by segment, inner first, in file order), in SI.

    ``hole_m`` are x and y of the holes in the base frame, ``end_disk`` the index (from 0) of the
    disk at which a tendon ends. ``axial_stiffness_N`` is infinite where a tendon is inextensible,
    ``spool_radius_m`` is NaN where it has no spool, ``diameter_m`` where it is not known.
    """

    hole_m: Floats
    pitch_radius_m: Floats
    angle_rad: Floats
    segment: Ints
    end_disk: Ints
    axial_stiffness_N: Floats
    free_length_m: Floats
    compliance_m_per_N: Floats
    friction: Floats
    pretension_N: Floats
    spool_radius_m: Floats
    diameter_m: Floats


def _frozen(values: object, dtype: type = float) -> NDArray[Any]:
    array: NDArray[Any] = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array


class Robot(_Part):
    """A cable-driven continuum robot, checked and immutable; every number is SI.

    Make one with `load_robot`, a changed copy with `with_`.

    Attributes
    ----------
    name, description : str
    gravity : tuple of 3 floats
        In the base frame, in m/s^2.
    segments : tuple of Segment
        From base to tip.
    """

    name: Annotated[str, Text(100, "my_robot")] = Field(
        "robot", description="Name for reports; the file's name if left out."
    )
    description: Annotated[str, Text(2000, "Two segments on a tube", lines=True)] = Field(
        "", description="Free text."
    )
    gravity: Annotated[
        tuple[float, float, float],
        Quantity("m/s^2", "0 0 -9.80665 m/s^2", "-10000 m/s^2", "10000 m/s^2", vector=3),
    ] = Field(
        (0.0, 0.0, 0.0),
        description="Gravity in the base frame, z along the straight backbone; none if left out.",
    )
    segments: Annotated[tuple[Segment, ...], Field(min_length=1, max_length=_MAX_SEGMENTS)] = Field(
        description="From base to tip."
    )

    @model_validator(mode="after")
    def _check(self) -> Robot:
        problems = list(_problems_across_fields(self))
        if problems:
            raise PydanticCustomError("bowstring_many", "", {"problems": problems})
        return self

    def __repr__(self) -> str:
        return f"<Robot {self.name}: {self._summary}>"

    def _repr_html_(self) -> str:
        rows = [
            (
                segment.name or f"segment {j}",
                number_with_unit(segment.length, "m"),
                number_with_unit(segment.backbone.diameter, "m"),
                number_with_unit(segment.backbone.E, "Pa"),
                int((self.disks.segment == j - 1).sum()),
                int((self.tendons.segment == j - 1).sum()),
            )
            for j, segment in enumerate(self.segments, 1)
        ]
        header = ("", "length", "diameter", "E", "disks", "tendons")
        return html_table(f"{self.name}: {self._summary}", rows, header)

    @property
    def _summary(self) -> str:
        counts = [
            (len(self.segments), "segment"),
            (len(self.disks.station_m), "disk"),
            (len(self.tendons.angle_rad), "tendon"),
        ]
        named = ", ".join(f"{n} {what}{'' if n == 1 else 's'}" for n, what in counts)
        return f"{number_with_unit(self.length, 'm')}, {named}"

    # Caches live in __dict__; the core's object cannot be pickled and need not be.
    def __getstate__(self) -> dict[Any, Any]:
        state = super().__getstate__()
        state["__dict__"] = self._fields()
        return state

    def __copy__(self) -> Robot:
        return Robot.model_construct(**self._fields())

    def __deepcopy__(self, memo: dict[int, Any] | None = None) -> Robot:
        return self.__copy__()

    def _fields(self) -> dict[str, Any]:
        return {name: self.__dict__[name] for name in Robot.model_fields}

    def with_(self, overrides: Mapping[str, Any]) -> Robot:
        """Return a changed copy, checked again as a whole.

        Parameters
        ----------
        overrides : mapping from path to value
            As ``{"segments.0.disks.clamped_length": "3 mm"}``. A string may carry a unit; numbers
            without one are SI. None removes a field. Setting one of ``G`` and ``nu``, or of
            ``count`` and ``positions``, removes the other.

        Returns
        -------
        Robot

        Raises
        ------
        InputError
            If a path does not exist or the changed robot is not valid.
        """
        # what the file left out stays left out, but where a part of it is set
        tree = self.model_dump(mode="json", exclude_none=True, exclude_unset=True)
        whole = self.model_dump(mode="json", exclude_none=True)
        for path in overrides:
            _fill(tree, whole, str(path).split("."))
        return _build(_override(tree, overrides), self.name)

    @property
    def length(self) -> float:
        """Length of the whole straight backbone in m."""
        return sum(segment.length for segment in self.segments)

    @cached_property
    def disks(self) -> RobotDisks:
        """All disks as arrays."""
        stations: list[float] = []
        start = 0.0
        for segment in self.segments:
            stations += (start + position for position in segment.disk_positions)
            start += segment.length
        index = np.repeat(
            np.arange(len(self.segments)), [len(s.disk_positions) for s in self.segments]
        )

        def each(field: str) -> Floats:
            values = np.array([getattr(s.disks, field) for s in self.segments], dtype=float)
            return values[index]

        mass, radius, thickness = each("mass"), each("radius"), each("thickness")
        inertia = np.stack(
            [mass * (3.0 * radius**2 + thickness**2) / 12.0, mass * radius**2 / 2.0], axis=1
        )
        bore = _bores(self.segments)[index]
        ends = np.flatnonzero(np.diff(index))  # an end disk also holds the backbone beyond it
        bore[ends] = np.maximum(bore[ends], bore[ends + 1])
        for k, s in enumerate(self.segments):
            if s.disks.density is None or s.disks.hole_diameter is None:
                continue
            holes = self.holes(k)
            for width in set(bore[index == k].tolist()):
                drilled = drilled_disk(
                    s.disks.density,
                    s.disks.radius,
                    s.disks.thickness,
                    width,
                    holes,
                    s.disks.hole_diameter,
                )
                same = (index == k) & (bore == width)
                mass[same] = drilled.mass
                inertia[same] = drilled.across, drilled.axial
        return RobotDisks(
            station_m=_frozen(stations),
            clamped_length_m=_frozen(each("clamped_length")),
            mass_kg=_frozen(mass),
            inertia_kg_m2=_frozen(inertia),
            radius_m=_frozen(radius),
            thickness_m=_frozen(thickness),
            bore_m=_frozen(bore),
            segment=_frozen(index, np.int64),
        )

    @cached_property
    def tendons(self) -> RobotTendons:
        """All tendons as arrays."""
        ends = np.cumsum([len(s.disk_positions) for s in self.segments]) - 1
        every = [t for segment in self.segments for t in segment.tendon_list]
        index = np.repeat(
            np.arange(len(self.segments)), [len(s.tendon_list) for s in self.segments]
        )

        def each(field: str, none: float = math.nan) -> Floats:
            values = (getattr(t, field) for t in every)
            return _frozen([none if value is None else value for value in values])

        r, a = each("pitch_radius"), each("angle")
        return RobotTendons(
            hole_m=_frozen(np.stack([r * np.cos(a), r * np.sin(a)], axis=1)),
            pitch_radius_m=r,
            angle_rad=a,
            segment=_frozen(index, np.int64),
            end_disk=_frozen(ends[index], np.int64),
            axial_stiffness_N=each("axial_stiffness", math.inf),
            free_length_m=each("free_length"),
            compliance_m_per_N=each("compliance"),
            friction=each("friction"),
            pretension_N=each("pretension"),
            spool_radius_m=each("spool_radius"),
            diameter_m=each("diameter"),
        )

    def holes(self, segment: int) -> Floats:
        """Places (H, 2) of the holes in the disks of a segment (from 0), x and y in m."""
        return distinct_holes(self.tendons.hole_m[self.tendons.segment >= segment])

    @cached_property
    def has_friction(self) -> bool:
        """Whether any tendon rubs at its holes."""
        return bool(self.tendons.friction.any())

    @cached_property
    def bending_stiffness(self) -> Floats:
        """E I of each segment in N m^2."""
        return _frozen([s.backbone.E * s.backbone.second_moment for s in self.segments])

    @cached_property
    def torsion_stiffness(self) -> Floats:
        """G J of each segment in N m^2; J is the polar second moment of the round section."""
        return _frozen(
            [s.backbone.shear_modulus * 2.0 * s.backbone.second_moment for s in self.segments]
        )

    @cached_property
    def axial_stiffness(self) -> Floats:
        """E A of each segment in N."""
        return _frozen([s.backbone.E * s.backbone.area for s in self.segments])

    @cached_property
    def shear_stiffness(self) -> Floats:
        """G A of each segment in N (shear factor 1)."""
        return _frozen([s.backbone.shear_modulus * s.backbone.area for s in self.segments])

    @cached_property
    def mass_per_length(self) -> Floats:
        """Backbone mass by length of each segment in kg/m."""
        return _frozen([s.backbone.density * s.backbone.area for s in self.segments])

    @cached_property
    def rotary_inertia(self) -> Floats:
        """Density times second moment of area of each segment's backbone, in kg m."""
        return _frozen([s.backbone.density * s.backbone.second_moment for s in self.segments])

    @cached_property
    def definition(self) -> str:
        """The robot as JSON text, every number in SI."""
        return json.dumps(self.model_dump(mode="json", exclude_none=True))

    @cached_property
    def hash(self) -> str:
        """SHA-256 of the robot's physics, as hex.

        Every physical field counts, resolved to SI (disk positions, G, tendons one by one), so
        that two ways to write one robot agree. Names and descriptions do not count.
        """

        import hashlib  # 7 ms, and most runs need no hash

        def exact(value: float) -> str:
            return (value + 0.0).hex()  # + 0.0 makes -0.0 the same as 0.0

        def tendon(t: Tendon) -> list[Any]:
            # What is not used is not named, so that robots keep the hash they had without it.
            drive = {
                name: exact(getattr(t, name))
                for name, field in _TendonDrive.model_fields.items()
                if getattr(t, name) != field.default and name not in ("diameter", "material")
            }
            return [exact(t.angle), exact(t.pitch_radius), *([drive] if drive else [])]

        def weight(disks: Disks) -> dict[str, str]:
            if disks.density is None or disks.hole_diameter is None:
                assert disks.mass is not None
                return {"disk_mass": exact(disks.mass)}
            return {
                "disk_density": exact(disks.density),
                "hole_diameter": exact(disks.hole_diameter),
            }

        content = {
            "format": 1,
            "gravity": [exact(g) for g in self.gravity],
            "segments": [
                {
                    "length": exact(s.length),
                    "diameter": exact(s.backbone.diameter),
                    "inner_diameter": exact(s.backbone.inner_diameter),
                    "E": exact(s.backbone.E),
                    "G": exact(s.backbone.shear_modulus),
                    "density": exact(s.backbone.density),
                    "disk_positions": [exact(p) for p in s.disk_positions],
                    **weight(s.disks),
                    "disk_radius": exact(s.disks.radius),
                    "disk_thickness": exact(s.disks.thickness),
                    "clamped_length": exact(s.disks.clamped_length),
                    "tendons": [tendon(t) for t in s.tendon_list],
                }
                for s in self.segments
            ],
        }
        text = json.dumps(content, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(text.encode("ascii")).hexdigest()

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Plausibility warnings: valid numbers that are probably not meant, each in a sentence."""
        return tuple(doubts(self))

    @cached_property
    def core(self) -> Any:
        """The robot in the Rust core (``bowstring._core.Robot``), built at the first use."""
        core = importlib.import_module("bowstring._core")
        return core.Robot(
            station_m=self.disks.station_m,
            clamped_length_m=self.disks.clamped_length_m,
            disk_mass_kg=self.disks.mass_kg,
            disk_inertia=self.disks.inertia_kg_m2,
            disk_segment=self.disks.segment,
            bending_stiffness=self.bending_stiffness,
            torsion_stiffness=self.torsion_stiffness,
            axial_stiffness=self.axial_stiffness,
            shear_stiffness=self.shear_stiffness,
            mass_per_length=self.mass_per_length,
            rotary_inertia=self.rotary_inertia,
            hole_m=self.tendons.hole_m,
            end_disk=self.tendons.end_disk,
            gravity=_frozen(self.gravity),
        )


# --------------------------------------------------------------------------------------
# Checks across fields
# --------------------------------------------------------------------------------------


def _problems_across_fields(robot: Robot) -> Iterator[str]:
    """Yield "path: sentence" for what no single field can know to be wrong."""
    parts = robot.segments
    for k, s in enumerate(parts):
        here = f"segments[{k}]"
        if s.backbone.inner_diameter >= s.backbone.diameter:
            yield (
                f"{here}.backbone.inner_diameter: "
                f"got {number_with_unit(s.backbone.inner_diameter, 'm')}; must be smaller than "
                f"the diameter, {number_with_unit(s.backbone.diameter, 'm')}"
            )
        if s.disks.positions is not None:
            yield from _position_problems(s, here)
    disk_count = sum(s.disks.count or len(s.disks.positions or ()) for s in parts)
    tendon_count = sum(
        t.count if isinstance(t, TendonRing) else len(t) for t in (s.tendons for s in parts)
    )
    if disk_count > _MAX_DISKS:
        yield f"segments: got {disk_count} disks in all; must be at most {_MAX_DISKS}"
        return
    if tendon_count > _MAX_TENDONS:
        yield f"segments: got {tendon_count} tendons in all; must be at most {_MAX_TENDONS}"
        return
    yield from _hole_problems(parts)
    yield from _drill_problems(parts)
    yield from _clamp_problems(parts)


def _position_problems(s: Segment, here: str) -> Iterator[str]:
    positions = s.disks.positions or ()
    for i in range(1, len(positions)):
        if positions[i] <= positions[i - 1]:
            yield (
                f"{here}.disks.positions: got {number_with_unit(positions[i], 'm')} after "
                f"{number_with_unit(positions[i - 1], 'm')}; must increase from base to tip"
            )
            return
    if abs(positions[-1] - s.length) > 1e-9 * s.length:
        yield (
            f"{here}.disks.positions: the last is {number_with_unit(positions[-1], 'm')}; "
            f"must be the segment's length, {number_with_unit(s.length, 'm')}"
        )


def _hole_problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Every tendon passes the disks and backbones of its own and of all inner segments."""
    for k, s in enumerate(parts):
        radii = [t.pitch_radius for t in s.tendon_list]
        for j, inner in enumerate(parts[: k + 1]):
            whose = "its disk" if j == k else f"the disks of segments[{j}], which it passes"
            rod = "its backbone" if j == k else f"the backbone of segments[{j}]"
            for i, r in enumerate(radii):
                if inner.backbone.diameter / 2 < r < inner.disks.radius:
                    continue
                ring = isinstance(s.tendons, TendonRing)
                where = f"segments[{k}].tendons" + ("" if ring else f"[{i}]") + ".pitch_radius"
                if r >= inner.disks.radius:
                    limit = number_with_unit(inner.disks.radius, "m")
                    fault = f"outside {whose}; must be smaller than the disk's radius, {limit}"
                else:
                    limit = number_with_unit(inner.backbone.diameter / 2, "m")
                    fault = f"inside {rod}; must be larger than the backbone's radius, {limit}"
                yield f"{where}: got {number_with_unit(r, 'm')}, a hole {fault}"
                if ring:
                    break


def _bores(parts: tuple[Segment, ...]) -> Floats:
    """Diameter of the hole that the backbone passes in the disks of each segment."""
    return np.array([s.backbone.diameter for s in parts])


def _drill_problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Holes of a given diameter lie within their disk, apart, and let their tendons through."""
    bores = _bores(parts)
    for k, s in enumerate(parts):
        width, radius = s.disks.hole_diameter, s.disks.radius
        if width is None:
            continue
        passing = [
            (j, i, t) for j in range(k, len(parts)) for i, t in enumerate(parts[j].tendon_list)
        ]
        for j, i, tendon in passing:
            if tendon.diameter is not None and tendon.diameter >= width:
                ring = isinstance(parts[j].tendons, TendonRing)
                where = f"segments[{j}].tendons" + ("" if ring else f"[{i}]") + ".diameter"
                yield (
                    f"{where}: got {number_with_unit(tendon.diameter, 'm')}; must be smaller than "
                    f"the holes that it passes, segments[{k}].disks.hole_diameter = "
                    f"{number_with_unit(width, 'm')}"
                )
                break
        away = np.array([t.pitch_radius for _, _, t in passing])
        angle = np.array([t.angle for _, _, t in passing])
        if not np.all((away > bores[k] / 2) & (away < radius)):
            continue  # reported with the holes
        holes = distinct_holes(np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1))
        limit, fault = room_for_holes(holes, radius, float(bores[k : k + 2].max()))
        if width >= limit:
            yield (
                f"segments[{k}].disks.hole_diameter: got {number_with_unit(width, 'm')}; the disk "
                f"does not hold such holes, {fault}; must be smaller than "
                f"{number_with_unit(limit, 'm')}"
            )


def _clamp_problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Each module needs backbone that can bend between what its two disks clamp."""
    before = 0.0  # what the disk before clamps of a segment's first module; the base clamps none
    for k, s in enumerate(parts):
        spacing = np.diff((0.0, *s.disk_positions))
        own = s.disks.clamped_length
        half = np.full(len(spacing), own / 2)
        start = np.concatenate(([before], half[1:]))
        before = own / 2
        if np.any(spacing <= 0):
            continue  # reported with the positions
        full = np.flatnonzero(spacing <= (start + half) * (1 + 1e-9))
        if not full.size:
            continue
        i = int(full[0])
        space = number_with_unit(float(spacing[i]), "m")
        advice = "write a smaller length, so that some backbone is free to bend"
        if start[i] > half[i]:  # the end disk of the segment before holds more of it
            yield (
                f"segments[{k - 1}].disks.clamped_length: got "
                f"{number_with_unit(parts[k - 1].disks.clamped_length, 'm')}; the end disk of "
                f"segments[{k - 1}] would clamp {number_with_unit(float(start[i]), 'm')} of the "
                f"{space} before disk 1 of segments[{k}]"
                + (f", which clamps {number_with_unit(float(half[i]), 'm')}" if half[i] else "")
                + f"; {advice}"
            )
        else:
            yield (
                f"segments[{k}].disks.clamped_length: got {number_with_unit(own, 'm')}; the disks "
                f"would clamp all of the {space} before disk {i + 1} of the segment; {advice}"
            )


# --------------------------------------------------------------------------------------
# Reading
# --------------------------------------------------------------------------------------


def robot_names() -> list[str]:
    """Return the names of the built-in robots.

    Returns
    -------
    list of str
        Sorted; each is accepted by `load_robot`.
    """
    return sorted(path.stem for path in _BUILT_IN.glob("*.yaml"))


def robot_schema() -> dict[str, Any]:
    """Return the JSON Schema of a robot file, for completion and checks in an editor.

    Returns
    -------
    dict
        JSON Schema (draft 2020-12). It knows fields, types and units' form; checks across
        fields are made by `load_robot` only.
    """
    schema = Robot.model_json_schema()
    for part in (schema, *schema["$defs"].values()):
        part["description"] = part["description"].partition("\n")[0]  # docstrings' first line
        for field in part["properties"].values():
            field.pop("default", None)  # SI numbers, that a file cannot hold
            field.pop("title", None)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def load_robot(source: str | Path, overrides: Mapping[str, Any] | None = None) -> Robot:
    """Load a built-in robot or a robot file.

    Parameters
    ----------
    source : str or Path
        Name of a built-in robot (see `robot_names`) or path of a YAML file.
    overrides : mapping from path to value, optional
        As for `Robot.with_`.

    Returns
    -------
    Robot

    Raises
    ------
    InputError
        If there is no such robot or the file is not valid; every problem is named.

    Examples
    --------
    >>> robot = load_robot("amouri2019", {"segments.0.disks.clamped_length": "3 mm"})
    >>> robot.length
    0.641
    """
    names = robot_names()
    if str(source) in names:
        path, label = _BUILT_IN / f"{source}.yaml", str(source)
    else:
        path, label = Path(source), str(source)
    if len(label) > 200 or not label.isprintable():
        label = f"Robot file {quote(label)}"
    tree = read_yaml(_read_text(path, label, names), label)
    tree.setdefault("name", printable(path.stem)[:100].strip() or "robot")
    return _build(_override(tree, overrides or {}), label)


def _read_text(path: Path, label: str, names: list[str]) -> str:
    with reading(label):
        if not path.exists():
            near = difflib.get_close_matches(label, names, n=1)
            hint = f"did you mean {near[0]}? " if near else ""
            raise InputError(
                f"{label} is neither a file nor a built-in robot; {hint}"
                f"built in are {', '.join(names)}."
            )
        if not path.is_file():
            what = "folder" if path.is_dir() else "device or pipe"
            raise InputError(f"{label} is a {what}; give a robot file (YAML).")
        return text_of(path, label, "robot")


# Setting one of a pair removes the other, so that an override need not know the file's choice.
_EITHER: Final = {
    **{"G": "nu", "nu": "G", "count": "positions", "positions": "count"},
    **{"mass": "density", "density": "mass"},
}


def _fill(tree: Any, whole: Any, keys: Sequence[str]) -> None:
    """Take from the whole what a path goes through and the tree lacks."""
    if len(keys) < 2:
        return
    key, *rest = keys
    if isinstance(tree, dict) and isinstance(whole, dict):
        if key not in tree and isinstance(whole.get(key), dict | list):
            tree[key] = whole[key]
        elif key in tree:
            _fill(tree[key], whole.get(key), rest)
    elif isinstance(tree, list) and isinstance(whole, list):
        for i, (item, known) in enumerate(zip(tree, whole, strict=False)):
            if key in ("*", str(i)):
                _fill(item, known, rest)


def _override(tree: dict[str, Any], overrides: Mapping[str, Any]) -> dict[str, Any]:
    """Set the fields of ``overrides`` in ``tree`` (which changes) and return it."""
    for path, value in overrides.items():
        if not (isinstance(path, str) and path.isprintable() and len(path) <= 100):
            raise InputError(f'Override {quote(path)}: write it as "segments.0.length".')
        *parents, last = keys = re.sub(r"\[([0-9]+)\]", r".\1", path).split(".")
        if not all(keys):
            raise InputError(f'Override {quote(path)}: write it as "segments.0.length".')
        here: Any = tree
        for i, key in enumerate(parents):
            index = _step(here, key, keys[:i], path)
            here = here.setdefault(index, {}) if isinstance(here, dict) else here[index]
        index = _step(here, last, parents, path)
        if value is None:
            if isinstance(here, list):
                raise InputError(f"Override {path}: an entry of a list cannot be removed.")
            here.pop(index, None)
            continue
        here[index] = value if last in ("name", "description") else _read_override(value, path)
        other = _EITHER.get(last)
        if other and isinstance(here, dict) and not _also_set(overrides, path, other):
            here.pop(other, None)
    return tree


def _also_set(overrides: Mapping[str, Any], path: str, other: str) -> bool:
    return f"{path.rpartition('.')[0]}.{other}" in overrides


def _step(here: Any, key: str, above: list[str], path: str) -> Any:
    """The key or index of ``key`` in ``here``, or an error that says what there is."""
    name = ".".join(above)
    if isinstance(here, dict):
        return key
    if not isinstance(here, list):
        raise InputError(f"Override {path}: {name} is a value, there is no {quote(key)} in it.")
    if re.fullmatch(r"[0-9]{1,6}", key, re.ASCII) and int(key) < len(here):
        return int(key)
    choice = f"{name}.0" + (f" to {name}.{len(here) - 1}" if len(here) > 1 else "")
    raise InputError(f"Override {path}: there is no {quote(key)} in {name}; write {choice}.")


def _read_override(value: Any, path: str) -> Any:
    """Text of an override as a file would have it, but a number without a unit is SI."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _read_override(item, path) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_read_override(item, path) for item in value]
    if not isinstance(value, str):
        return value
    text = value.strip()
    if text.startswith(("[", "{")):
        field = read_yaml(f"value: {text}", f"Override {path}").get("value")
        return _read_override(field, path)
    words = text.split()
    if words and all(len(w) <= 100 and re.fullmatch(NUMBER, w, re.ASCII) for w in words):
        numbers = [int(w) if re.fullmatch("[+-]?[0-9]{1,15}", w) else float(w) for w in words]
        return numbers if len(numbers) > 1 else numbers[0]
    return text


# --------------------------------------------------------------------------------------
# What went wrong, in sentences
# --------------------------------------------------------------------------------------

_SYNONYMS: Final = {
    "outer_diameter": "diameter",
    "young": "E",
    "youngs_modulus": "E",
    "elastic_modulus": "E",
    "shear_modulus": "G",
    "poisson": "nu",
    "poisson_ratio": "nu",
    "rho": "density",
    "cables": "tendons",
    "alpha": "angle",
    "ea": "axial_stiffness",
    "mu": "friction",
    "hole": "hole_diameter",
    "preload": "pretension",
}
_PARTS: Final[dict[tuple[str, ...], type[BaseModel]]] = {
    (): Robot,
    ("segments",): Segment,
    ("segments", "backbone"): Backbone,
    ("segments", "disks"): Disks,
    ("segments", "tendons", "ring"): TendonRing,
    ("segments", "tendons", "list"): Tendon,
}
_MAX_LISTED: Final = 20


def _build(tree: dict[str, Any], label: str) -> Robot:
    segments = tree.get("segments")
    if isinstance(segments, list) and len(segments) > _MAX_SEGMENTS:  # before each is looked at
        most = f"must have at most {_MAX_SEGMENTS}"
        raise InputError(f"{label}: segments: got a list of {len(segments)}; {most}.")
    try:
        return Robot.model_validate(tree)
    except ValidationError as error:
        problems = [line for item in error.errors() for line in _sentences(item)]
    first, *others = problems
    more = f" (and {len(others)} more)" if others else ""
    lines = [f"{label}: {first}{more}.", *(f"  {other}." for other in others[:_MAX_LISTED])]
    if len(others) > _MAX_LISTED:
        lines.append(f"  ... and {len(others) - _MAX_LISTED} more.")
    raise InputError("\n".join(lines))


def _path(loc: tuple[int | str, ...]) -> str:
    """`segments[0].tendons[1].angle`, as people write it."""
    text = ""
    for i, step in enumerate(loc):
        if isinstance(step, int):
            text += f"[{step}]"
        elif not (step in ("ring", "list") and i and loc[i - 1] == "tendons"):  # pydantic's tags
            shown = step if re.fullmatch(r"\w{1,40}", step) else quote(step)
            text += f".{shown}" if text else shown
    return text


def _sentences(error: Any) -> list[str]:
    """Turn one of pydantic's errors into "path: sentence" (several for checks across fields)."""
    kind, loc, given = error["type"], error["loc"], error["input"]
    path = _path(loc)
    if kind == "bowstring_many":
        return list(error["ctx"]["problems"])
    if kind == "bowstring":
        return [f"{path}: {error['ctx']['sentence']}"]
    names = tuple(step for step in loc if isinstance(step, str))
    if kind == "missing":
        return [f"{path}: missing; {_advice(names)}"]
    if kind == "extra_forbidden":
        known = _fields_of(_PARTS[names[:-1]])
        near = _nearest(names[-1], known)
        hint = f"; did you mean {near}?" if near else "."
        return [f"{path}: unknown field{hint} Known here: {', '.join(known)}"]
    if kind == "too_short" and given:
        return []  # its entries are wrong, and reported
    if kind == "too_short":
        return [f"{path}: got an empty list; must have at least one"]
    if kind == "too_long":
        return [f"{path}: got {quote(given)}; must have at most {error['ctx']['max_length']}"]
    return [f"{path}: got {quote(given)}; {_advice(names)}"]


def _advice(names: tuple[str, ...]) -> str:
    """What to write at a field: an example, or the names of its own fields."""
    if names == ("segments",):
        return "must be a list of segments, each after a '-'"
    if names[-1:] == ("tendons",):
        names = (*names, "ring")
    part = _PARTS.get(names)
    if part is not None:
        return f"must be a set of fields: {', '.join(_fields_of(part))}"
    field = _PARTS[names[:-1]].model_fields[names[-1]]
    example = next(mark.example for mark in field.metadata if hasattr(mark, "example"))
    return f'write for example "{names[-1]}: {example}"'


def _fields_of(part: type[BaseModel]) -> list[str]:
    """The names of a part's fields, its own before those that it shares with others."""
    return sorted(part.model_fields, key=lambda name: name not in part.__annotations__)


def _nearest(name: str, known: list[str]) -> str | None:
    lower = {field.lower(): field for field in known}
    synonym = _SYNONYMS.get(name.lower())
    if synonym in known:
        return synonym
    near = difflib.get_close_matches(name.lower(), list(lower), n=1, cutoff=0.5)
    return lower[near[0]] if near else None


def with_tendons(robot: Robot, values: Mapping[str, float | None], missing: bool = False) -> Robot:
    """The robot with these fields of all its tendons, or of those only that lack them."""
    changes = {}
    for k, segment in enumerate(robot.segments):
        ring = isinstance(segment.tendons, TendonRing)
        for i, tendon in enumerate(segment.tendon_list[:1] if ring else segment.tendon_list):
            where = f"segments.{k}.tendons" if ring else f"segments.{k}.tendons.{i}"
            for name, value in values.items():
                now = getattr(tendon, name)
                if now != value and not (missing and now):
                    changes[f"{where}.{name}"] = value
    return robot.with_(changes) if changes else robot


def check_robot(robot: object) -> None:
    """Refuse what is no robot, such as its name."""
    if not isinstance(robot, Robot):
        raise InputError(
            f"robot is {shown(robot)}, it must be a Robot, as bowstring.load_robot gives it"
        )
