"""Parts of a robot file: their fields, units and ranges."""

from __future__ import annotations

import contextlib
import inspect
import math
from functools import cached_property
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import ArrayLike
from pydantic import (
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    SerializerFunctionWrapHandler,
    Tag,
    model_serializer,
    model_validator,
)

from bowstring.aliases import Bools, Floats
from bowstring.errors import InputError
from bowstring.robot.disk import stacked
from bowstring.robot.laws import LAWS
from bowstring.robot.stiffness import StiffnessMatrix
from bowstring.units import Choice, Count, Quantity, Share, Text, wrong

MAX_SEGMENTS: Final = 100
MAX_DISKS: Final = 100_000
MAX_TENDONS: Final = 1_000
MAX_HOLES: Final = 2_000_000  # disks times tendons: arrays of 0.2 GB, the core takes 0.6 GB

TENDON_MATERIALS: Final = {
    "steel": 105e9,
    "tungsten": 200e9,
    "nitinol": 55e9,
    "aramid": 40e9,
    "polyethylene": 30e9,
    "nylon": 2.5e9,
}
"""E A over the area of the full circle in Pa by material, for tendons without a given E A: the
mean of strand and wire (steel: 60 to 190 GPa), within a factor of two of either."""


TENDON_KINDS: Final = ("tendon", "rod", "chamber")


class Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        """Document the attributes in a docstring without them, by their declarations."""
        text = inspect.cleandoc(cls.__doc__ or "")
        if "\nAttributes\n" in text:
            return
        lines = [text, "", "Attributes", "----------"]
        for name, field in cls.model_fields.items():
            kind = inspect.formatannotation(field.annotation)
            unit = "".join(f", {m.si}" for m in field.metadata if isinstance(m, Quantity) and m.si)
            lines += [f"{name} : {kind}{unit}", f"    {field.description}"]
        cls.__doc__ = "\n".join(lines)


def _exactly_one(part: BaseModel, first: str, second: str) -> None:
    given = (getattr(part, first) is not None) + (getattr(part, second) is not None)
    if given != 1:
        problem = "both given" if given else "missing"
        raise wrong(f"{first} and {second}: {problem}; write exactly one of the two")


def _one_of(first: str, second: str) -> Any:
    return {"oneOf": [{"required": [first]}, {"required": [second]}]}


_PITCH = Quantity("m", "29 mm", "0 mm", "100 m")
_ANGLE = Quantity("rad", "120 deg", "-360 deg", "360 deg")
_SIZE = Quantity("m", "5 mm", "1 um", "10 m")
_COMPLIANCE = Quantity("m/N", "0.01 mm/N", "0 m/N", "1000 m/N")
#: Largest share of the bending stiffness that slides or relaxes: the statics of a step does not
#: converge far above it.
_MOST_INELASTIC: Final = 0.6
_INELASTIC = Quantity("", "0.1", "0", str(_MOST_INELASTIC))
_EDGE: Final = 1.0 + 1e-12  # what rounding adds to the edge of a section


def _check_stiffness(backbone: Backbone) -> None:
    """Refuse what a stiffness matrix replaces; without one, what only goes with it."""
    if backbone.stiffness is None:
        for name in ("mass_per_length", "rotary_inertia"):
            if getattr(backbone, name) is not None:
                raise wrong(f"{name}: given without stiffness; it follows from density and shape")
        for name, example in (("E", "35 GPa"), ("density", "1800 kg/m^3")):
            if getattr(backbone, name) is None:
                raise wrong(f'{name}: missing; write for example "{name}: {example}"')
        return
    if backbone.mass_per_length is None:
        raise wrong(
            'mass_per_length: missing; with stiffness write for example "mass_per_length: 40 g/m"'
        )
    shape = ("inner_diameter", "width", "height", "width_direction")
    for name in ("E", "G", "nu", "density", *shape, "yield_strength", "strain_limit"):
        if name in backbone.model_fields_set and getattr(backbone, name) is not None:
            raise wrong(f"{name}: given with stiffness, which replaces it; leave one of them out")
    if backbone.is_tapered:
        raise wrong(
            "stiffness: given with the size at the segment's end; a stiffness is the same "
            "everywhere in its segment, split the segment for another"
        )


def _rest_of_section(backbone: Backbone) -> None:
    """Refuse fields of a round and of a rectangular section side by side, and parts of one."""
    given = {name: getattr(backbone, name) is not None for name in Backbone.model_fields}
    for name in ("inner_diameter", "width_direction"):
        given[name] = bool(np.any(getattr(backbone, name)))
    if given["diameter"] and (given["width"] or given["height"]):
        raise wrong(
            "diameter and width: both given; write diameter of a round backbone, or width and "
            "height of a rectangular one"
        )
    if given["diameter"]:
        for name in ("end_width", "end_height", "width_direction"):
            if given[name]:
                raise wrong(f"{name}: given with diameter; it is for a rectangular backbone")
        return
    if not (given["width"] or given["height"]):
        raise wrong(
            'diameter: missing; write for example "diameter: 5 mm", or width and height of a '
            "rectangular backbone"
        )
    for name in ("width", "height"):
        if not given[name]:
            raise wrong(f"{name}: missing; a rectangular backbone needs width and height")
    limits = ("yield_strength", "strain_limit")
    for name in ("end_diameter", "end_inner_diameter", *limits, "inner_diameter"):
        if given[name]:
            what = "limits are" if name in limits else "it is"
            raise wrong(f"{name}: given with width; {what} for a round backbone")


class Backbone(Part):
    """Elastic rod in the middle of a segment: a round bar, a tube, or a rectangular bar.

    It is tapered where a size at the end of the segment is given: sizes then change in proportion
    to arc length. With ``stiffness``, ``diameter`` is the outer one, for disks and pictures.
    """

    model_config = ConfigDict(
        json_schema_extra={
            "allOf": [
                {
                    "if": {"not": {"required": ["stiffness"]}},
                    "then": {
                        "required": ["E", "density"],
                        "allOf": [
                            _one_of("G", "nu"),
                            {
                                "oneOf": [
                                    {"required": ["diameter"]},
                                    {"required": ["width", "height"]},
                                ]
                            },
                        ],
                    },
                    "else": {"required": ["mass_per_length"]},
                },
            ]
        }
    )

    diameter: Annotated[float | None, _SIZE] = Field(
        None, description="Outer diameter of a round backbone; give this, or width and height."
    )
    inner_diameter: Annotated[float, Quantity("m", "3 mm", "0 mm", "10 m")] = Field(
        0.0, description="Diameter of the bore of a tube; leave out for a solid rod."
    )
    end_diameter: Annotated[float | None, _SIZE] = Field(
        None, description="Outer diameter at the segment's end; diameter if left out."
    )
    end_inner_diameter: Annotated[float | None, Quantity("m", "3 mm", "0 mm", "10 m")] = Field(
        None, description="Diameter of the bore at the segment's end; inner_diameter if left out."
    )
    width: Annotated[float | None, _SIZE] = Field(
        None, description="Width of a rectangular backbone; give height as well."
    )
    height: Annotated[float | None, _SIZE] = Field(
        None, description="Height of a rectangular backbone, perpendicular to its width."
    )
    end_width: Annotated[float | None, _SIZE] = Field(
        None, description="Width at the segment's end; width if left out."
    )
    end_height: Annotated[float | None, _SIZE] = Field(
        None, description="Height at the segment's end; height if left out."
    )
    width_direction: Annotated[float, _ANGLE] = Field(
        0.0, description="Direction of the width, angle from x, counter-clockwise; 0 if left out."
    )
    E: Annotated[float | None, Quantity("Pa", "35 GPa", "1 Pa", "10 TPa")] = Field(
        None, description="Young's modulus; give this, or stiffness."
    )
    G: Annotated[float | None, Quantity("Pa", "13 GPa", "0.1 Pa", "10 TPa")] = Field(
        None, description="Shear modulus; give this or nu."
    )
    nu: Annotated[float | None, Quantity("", "0.3", "-0.99", "0.5")] = Field(
        None, description="Poisson's ratio; give this or G."
    )
    density: Annotated[
        float | None, Quantity("kg/m^3", "1800 kg/m^3", "0 kg/m^3", "1e5 kg/m^3")
    ] = Field(None, description="Mass by volume of the material; give this, or mass_per_length.")
    stiffness: Annotated[tuple[tuple[float, ...], ...] | None, StiffnessMatrix()] = Field(
        None,
        description="Full stiffness of the section, six rows of six numbers in SI: moments (N m) "
        "and forces (N) by curvature about x and y, twist (1/m), shear along x and y, extension; "
        "instead of E, G or nu, density and shape.",
    )
    mass_per_length: Annotated[float | None, Quantity("kg/m", "40 g/m", "0 kg/m", "1e6 kg/m")] = (
        Field(None, description="Mass per length; with stiffness.")
    )
    rotary_inertia: Annotated[float | None, Quantity("kg*m", "0.05 g*mm", "0 kg*m", "1e6 kg*m")] = (
        Field(
            None,
            description="Rotary inertia per length about an axis of the section, density times "
            "second moment of area; with stiffness, 0 if left out.",
        )
    )
    yield_strength: Annotated[float | None, Quantity("Pa", "200 MPa", "1 Pa", "1 TPa")] = Field(
        None, description="Von Mises stress that the material can take, for warnings."
    )
    strain_limit: Annotated[float | None, Share("1 %", 10.0)] = Field(
        None, description="Strain along the surface that the material can take, for warnings."
    )
    rest_bend: Annotated[float, Quantity("rad", "40 deg", "-3600 deg", "3600 deg")] = Field(
        0.0, description="Bend of the unloaded segment from start to end; 0 if left out, straight."
    )
    rest_direction: Annotated[float, _ANGLE] = Field(
        0.0, description="Direction of rest_bend, angle from x, counter-clockwise; 0 if left out."
    )
    rest_twist: Annotated[float, Quantity("rad", "30 deg", "-3600 deg", "3600 deg")] = Field(
        0.0, description="Twist of the unloaded segment from start to end; 0 if left out."
    )

    hysteresis: Annotated[float, _INELASTIC] = Field(
        0.0,
        description="Share of the bending stiffness that slides beyond hysteresis_play; 0 if left "
        "out, elastic.",
    )
    hysteresis_play: Annotated[float, Quantity("rad", "5 deg", "0 deg", "3600 deg")] = Field(
        0.0,
        description="Change of the segment's bend beyond which that share slides; 0 if left out.",
    )
    relaxation: Annotated[float, _INELASTIC] = Field(
        0.0, description="Share of the bending stiffness that relaxes with time; 0 if left out."
    )
    relaxation_time: Annotated[float, Quantity("s", "30 s", "1 ms", "1e9 s")] = Field(
        30.0, description="Time constant of the relaxation; 30 s if left out."
    )
    second_relaxation: Annotated[float, _INELASTIC] = Field(
        0.0, description="Share that relaxes with another time constant; 0 if left out."
    )
    second_relaxation_time: Annotated[float, Quantity("s", "300 s", "1 ms", "1e9 s")] = Field(
        300.0, description="Time constant of the second relaxation; 300 s if left out."
    )

    @model_validator(mode="after")
    def _check(self) -> Backbone:
        _check_stiffness(self)
        if self.stiffness is None:
            _exactly_one(self, "G", "nu")
            _rest_of_section(self)
        shares = self.hysteresis + self.relaxation + self.second_relaxation
        if shares > _MOST_INELASTIC + 1e-9:  # 0.2 + 0.4 is rounded
            raise wrong(
                f"hysteresis and relaxation: together {shares:.3g} of the bending stiffness, at "
                f"most {_MOST_INELASTIC:g} is possible"
            )
        return self

    @property
    def replaced(self) -> tuple[str, ...]:
        """Fields with a value that do not count beside a stiffness matrix."""
        return ("inner_diameter", "width_direction") if self.stiffness is not None else ()

    @model_serializer(mode="wrap")
    def _without_replaced(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        found: dict[str, Any] = dump(self)
        for name in self.replaced:
            found.pop(name, None)
        return found

    def _given(self, name: str) -> Any:
        value = getattr(self, name)
        if value is None:
            raise InputError(
                f"a backbone by its stiffness matrix has no {name}: this needs E, G or nu, density "
                "and the shape of the section"
            )
        return value

    @property
    def young(self) -> float:
        """Young's modulus in Pa."""
        modulus: float = self._given("E")
        return modulus

    @property
    def is_round(self) -> bool:
        """Whether the section is a circle or a ring, not a rectangle."""
        return self.width is None and self.stiffness is None

    @property
    def is_tapered(self) -> bool:
        """Whether the section changes along the segment."""
        ends = (self.end_diameter, self.end_inner_diameter, self.end_width, self.end_height)
        return any(end is not None for end in ends)

    def at(self, fraction: ArrayLike) -> Backbone:
        """Backbone with the section at a fraction of the segment everywhere.

        Parameters
        ----------
        fraction : array_like (...)
            0 at the start of the segment, 1 at its end; of several, the sizes are arrays.

        Returns
        -------
        Backbone
        """
        if not self.is_tapered:
            return self
        sizes: dict[str, Any] = {}
        for name in ("diameter", "inner_diameter", "width", "height"):
            start, end = getattr(self, name), getattr(self, f"end_{name}")
            if end is not None:
                start = (start + np.asarray(fraction) * (np.asarray(end) - start))[()]
            sizes |= {name: start, f"end_{name}": None}
        return self.model_copy(update=sizes)

    @property
    def outer_diameter(self) -> Any:
        """Diameter of the circle around the largest section in m."""
        if self.width is not None and self.height is not None:
            sides = (self.width, self.height), (self.end_width, self.end_height)
            ends = [0.0 if s is None else s for s in (*sides[0], *sides[1])]
            width, height = np.maximum(ends[0], ends[2]), np.maximum(ends[1], ends[3])
            return np.hypot(width, height)[()]
        if self.diameter is None:
            return 0.0  # of a backbone by its stiffness, unknown
        if self.end_diameter is None:
            return self.diameter
        return np.maximum(self.diameter, self.end_diameter)[()]

    def encloses(self, places: ArrayLike, fraction: ArrayLike) -> Bools:
        """Whether points lie within or on the outline of the sections, in material or bore.

        Parameters
        ----------
        places : array_like (..., 2)
            x and y in m.
        fraction : array_like (...)
            Places of the sections: 0 at the start of the segment, 1 at its end.

        Returns
        -------
        ndarray (...)
            False everywhere for a backbone by its stiffness without a diameter.
        """
        x, y = np.moveaxis(np.asarray(places, dtype=float), -1, 0)
        section = self.at(fraction)
        if section.width is not None and section.height is not None:
            c, s = math.cos(self.width_direction), math.sin(self.width_direction)
            along, across = np.abs(c * x + s * y), np.abs(c * y - s * x)
            return np.asarray(
                (2 * along <= _EDGE * section.width) & (2 * across <= _EDGE * section.height)
            )
        outer = 0.0 if section.diameter is None else section.diameter
        return np.asarray((2 * np.hypot(x, y) <= _EDGE * outer) & (np.asarray(outer) > 0))

    def in_bore(self, places: ArrayLike, fraction: ArrayLike) -> Bools:
        """Whether points lie in the bore of a tube; arguments as of `encloses`."""
        x, y = np.moveaxis(np.asarray(places, dtype=float), -1, 0)
        return np.asarray(_EDGE * 2 * np.hypot(x, y) < self.at(fraction).inner_diameter)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus in Pa, as given or from E and nu."""
        if self.nu is not None:
            return self.young / (2.0 * (1.0 + self.nu))
        modulus: float = self._given("G")
        return modulus

    @property
    def area(self) -> float:
        """Area of the section at the segment's start in m^2."""
        if self.width is not None and self.height is not None:
            return self.width * self.height
        self._given("E")
        assert self.diameter is not None
        return math.pi / 4.0 * (self.diameter**2 - self.inner_diameter**2)

    @property
    def second_moments(self) -> tuple[float, float]:
        """Second moments of area at the segment's start about both principal axes in m^4.

        The first axis of a rectangle is along its width.
        """
        if self.width is not None and self.height is not None:
            return self.width * self.height**3 / 12.0, self.height * self.width**3 / 12.0
        self._given("E")
        assert self.diameter is not None
        round_one = math.pi / 64.0 * (self.diameter**4 - self.inner_diameter**4)
        return round_one, round_one

    @property
    def second_moment(self) -> float:
        """Mean second moment of area at the segment's start in m^4; the polar one is twice this."""
        return sum(self.second_moments) / 2.0

    @property
    def torsion_constant(self) -> Any:
        """Torsion constant J of the section at the segment's start in m^4.

        The polar second moment of a round section; of a rectangle by Saint-Venant's series
        (Timoshenko and Goodier, Theory of Elasticity, art. 109).
        """
        if self.width is None or self.height is None:
            return 2.0 * self.second_moment
        long = np.maximum(self.width, self.height)
        short = np.minimum(self.width, self.height)
        odd = np.arange(1, 40, 2).reshape(-1, *(1,) * np.ndim(long))
        series = (np.tanh(odd * math.pi / 2.0 * long / short) / odd.astype(float) ** 5).sum(axis=0)
        return (long * short**3 / 3.0 * (1.0 - 192.0 / math.pi**5 * short / long * series))[()]


class Disks(Part):
    """Spacer disks of a segment; the last one is its end disk.

    With ``mass`` a disk has the inertia of a cylinder without holes, with ``density`` mass and
    inertia of the drilled disk. ``clamped_length`` is centred on the disk.
    """

    model_config = ConfigDict(
        json_schema_extra={"allOf": [_one_of("count", "positions"), _one_of("mass", "density")]}
    )

    count: Annotated[int | None, Count(MAX_DISKS, "9")] = Field(
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

    hole_length: Annotated[float, Quantity("m", "3 mm", "0 mm", "100 m")] = Field(
        0.0,
        description="Length of the tendons' holes along the axis, centred on the disk: tendons "
        "bend at their entry and exit planes; 0 if left out, points in the mid-plane.",
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


class Payload(Part):
    """Rigid body fixed to a disk: a tool, a camera, a mass."""

    disk: Annotated[int | None, Count(MAX_DISKS, "9")] = Field(
        None, description="Disk, counted from 1 at the base; the last one if left out."
    )
    mass: Annotated[float, Quantity("kg", "50 g", "0 g", "10000 kg")] = Field(description="Mass.")
    centre: Annotated[
        tuple[float, float, float], Quantity("m", "0 0 20 mm", "-100 m", "100 m", vector=3)
    ] = Field(
        (0.0, 0.0, 0.0),
        description="Centre of mass from the centre of the disk, x y z in the axes of the disk; "
        "0 if left out.",
    )
    inertia: Annotated[
        tuple[float, float, float],
        Quantity("kg*m^2", "12 12 8 kg*mm^2", "0 kg*m^2", "1e6 kg*m^2", vector=3),
    ] = Field(
        (0.0, 0.0, 0.0),
        description="Moments of inertia about its centre of mass and the axes of the disk; 0 if "
        "left out, a point.",
    )

    @model_validator(mode="after")
    def _check(self) -> Payload:
        a, b, c = self.inertia
        if 2.0 * max(a, b, c) > (a + b + c) * (1.0 + 1e-12):
            raise wrong(
                f"inertia: got {a:g} {b:g} {c:g} kg*m^2; the largest moment of inertia of a body "
                "is at most the sum of the other two"
            )
        return self


class TendonProperties(Part):
    """Common fields of ring and list: elasticity, friction, actuation and diameter of a tendon.

    By default a tendon is inextensible and frictionless, and its transmission rigid.
    """

    axial_stiffness: Annotated[float | None, Quantity("N", "20 kN", "1 mN", "1e12 N")] = Field(
        None, description="E A of the tendon; leave out for an inextensible one."
    )
    free_length: Annotated[float, Quantity("m", "300 mm", "0 mm", "1 km")] = Field(
        0.0, description="Length of tendon from the base hole to the actuator; 0 if left out."
    )
    compliance: Annotated[float, _COMPLIANCE] = Field(
        0.0, description="Compliance of the transmission (spool, gearbox, sheath); 0 if left out."
    )
    creep_compliance: Annotated[float, _COMPLIANCE] = Field(
        0.0,
        description="Compliance of tendon and transmission that comes with time; 0 if left out.",
    )
    creep_time: Annotated[float, Quantity("s", "30 s", "1 ms", "1e9 s")] = Field(
        30.0, description="Time constant of that compliance; 30 s if left out."
    )
    second_creep_compliance: Annotated[float, _COMPLIANCE] = Field(
        0.0, description="Compliance that comes with another time constant; 0 if left out."
    )
    second_creep_time: Annotated[float, Quantity("s", "300 s", "1 ms", "1e9 s")] = Field(
        300.0, description="Time constant of the second creep; 300 s if left out."
    )
    friction: Annotated[float, Quantity("", "0.1", "0", "10")] = Field(
        0.0, description="Coulomb friction coefficient mu at each hole; 0 if left out."
    )
    wrap_angle: Annotated[float, Quantity("rad", "90 deg", "0 deg", "3600 deg")] = Field(
        0.0,
        description="Angle by which the tendon turns between drive and base hole, over guides or "
        "in a sheath, with the same friction; 0 if left out.",
    )
    backlash: Annotated[float, Quantity("m", "0.2 mm", "0 mm", "1 km")] = Field(
        0.0,
        description="Half the free travel of the drive when the displacement reverses; 0 if left "
        "out.",
    )
    hole_clearance: Annotated[float, Quantity("m", "0.1 mm", "0 mm", "1 km")] = Field(
        0.0,
        description="Difference of the radii of hole and tendon: where the backbone bends, the "
        "tendon loses displacement; 0 if left out.",
    )
    mount_compliance: Annotated[float, _COMPLIANCE] = Field(
        0.0,
        description="Displacement that the mount of the drives takes for each newton of the sum of "
        "all tensions; 0 if left out.",
    )
    gain: Annotated[float, Quantity("", "1.02", "0.001", "1000")] = Field(
        1.0, description="Displacement of the tendon over that commanded; 1 if left out."
    )
    zero: Annotated[float, Quantity("m", "0.2 mm", "-1 km", "1 km")] = Field(
        0.0, description="Displacement of the tendon where 0 is commanded; 0 if left out."
    )
    decoupling: Annotated[float, Quantity("", "1", "0", "1")] = Field(
        0.0,
        description="Share, of the displacement that inner segments take of the tendon, that its "
        "drive adds to the commanded one: 1 if displacements are those of its own segment alone, 0 "
        "if left out, those of the whole tendon.",
    )
    delay: Annotated[float, Quantity("s", "50 ms", "0 s", "1000 s")] = Field(
        0.0, description="Time after which the drive follows a command; 0 if left out."
    )
    pretension: Annotated[float, Quantity("N", "2 N", "0 N", "1e9 N")] = Field(
        0.0, description="Tension in the home pose, where its displacement is zero; 0 if left out."
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

    kind: Annotated[str, Choice(TENDON_KINDS, "rod")] = Field(
        "tendon",
        description="A tendon can only pull; a rod pushes too, and so does a chamber under "
        "pressure, on the path of its axis: both take tensions of either sign.",
    )
    area: Annotated[float | None, Quantity("m^2", "2 cm^2", "1e-12 m^2", "10 m^2")] = Field(
        None, description="Area on which the pressure of a chamber acts; needed for pressures."
    )
    bending_stiffness: Annotated[
        float | None, Quantity("N*m^2", "200 N*mm^2", "1e-15 N*m^2", "1e6 N*m^2")
    ] = Field(None, description="E I of a rod, for the warning where it buckles between two disks.")

    turns: Annotated[float, Quantity("", "0.5", "-100", "100")] = Field(
        0.0,
        description="Turns about the backbone from the base to its end disk, counter-clockwise; "
        "0 if left out.",
    )
    end_pitch_radius: Annotated[float | None, _PITCH] = Field(
        None,
        description="Pitch radius at its end disk, reached evenly along the backbone; "
        "pitch_radius if left out.",
    )

    @property
    def pushes(self) -> bool:
        """Whether it pushes too, so that its tension may be negative and it is never slack."""
        return self.kind != "tendon"

    @model_validator(mode="after")
    def _check_kind(self) -> TendonProperties:
        for name, kind in (("area", "chamber"), ("bending_stiffness", "rod")):
            if getattr(self, name) is not None and self.kind != kind:
                raise wrong(f"{name}: given with kind {self.kind}; it is for kind {kind}")
        if not self.pushes:
            return self
        for law in LAWS.values():
            for name in law.sizes if law.owner == "tendons" and not law.pushes else ():
                if np.any(getattr(self, name)):
                    raise wrong(f"{name}: given with kind {self.kind}, which pushes; set it to 0")
        return self


class TendonRing(TendonProperties):
    """Tendons evenly spaced on a circle, counter-clockwise about z, all actuated alike."""

    count: Annotated[int, Count(MAX_TENDONS, "3")] = Field(description="Number of tendons.")
    pitch_radius: Annotated[float, _PITCH] = Field(
        description="Distance of the holes from the backbone's axis."
    )
    first_angle: Annotated[float, _ANGLE] = Field(
        0.0, description="Angle of the first tendon from x, counter-clockwise; 0 if left out."
    )


class Tendon(TendonProperties):
    """One tendon of a list."""

    angle: Annotated[float, _ANGLE] = Field(description="Angle from x, counter-clockwise.")
    pitch_radius: Annotated[float, _PITCH] = Field(
        description="Distance of the holes from the backbone's axis."
    )
    angles: Annotated[
        tuple[float, ...] | None,
        Quantity("rad", "10 20 30 deg", "-36000 deg", "36000 deg", vector=0),
    ] = Field(
        None,
        description="Angles in the disks, from the first to its end disk, if they differ from "
        "angle, that in the base.",
    )
    pitch_radii: Annotated[
        tuple[float, ...] | None, Quantity("m", "28 27 26 mm", "0 mm", "100 m", vector=0)
    ] = Field(
        None,
        description="Pitch radii in the disks, from the first to its end disk, if they differ from "
        "pitch_radius, that in the base.",
    )

    @property
    def is_parallel(self) -> bool:
        """Whether the tendon is parallel to the backbone."""
        if any(v is not None for v in (self.angles, self.pitch_radii, self.end_pitch_radius)):
            return False
        return not np.any(self.turns)

    @model_validator(mode="after")
    def _check(self) -> Tendon:
        if self.turns and self.angles is not None:
            raise wrong("turns and angles: both given; write one of the two")
        if self.end_pitch_radius is not None and self.pitch_radii is not None:
            raise wrong("end_pitch_radius and pitch_radii: both given; write one of the two")
        return self

    @property
    def base_hole(self) -> tuple[float, float]:
        """x and y of its hole in the base, m; of a parallel tendon in all disks."""
        return self.pitch_radius * math.cos(self.angle), self.pitch_radius * math.sin(self.angle)

    def holes(self, stations: ArrayLike) -> Floats:
        """Positions of its holes in the frames of base and disks.

        Parameters
        ----------
        stations : array_like (..., n)
            Arc lengths of the disks up to its end disk, m.

        Returns
        -------
        ndarray (..., n + 1, 2)
            x and y in m, that in the base first.
        """
        station = np.asarray(stations, dtype=float)
        share = station / station[..., -1:]
        first = np.zeros((*station.shape[:-1], 1))

        def column(value: Any) -> Floats:
            return np.asarray(value, dtype=float)[..., None]

        radius, angle = column(self.pitch_radius), column(self.angle)
        end = radius if self.end_pitch_radius is None else column(self.end_pitch_radius)
        radii = radius + (end - radius) * share
        angles = angle + math.tau * column(self.turns) * share
        if self.pitch_radii is not None:
            radii = stacked(self.pitch_radii)
        if self.angles is not None:
            angles = stacked(self.angles)

        def whole(base: Floats, beyond: Floats) -> Floats:
            lead = np.broadcast_shapes(first.shape[:-1], base.shape[:-1], beyond.shape[:-1])
            parts = (np.broadcast_to(v, (*lead, v.shape[-1])) for v in (base, beyond))
            return np.concatenate(list(parts), axis=-1)

        radii, angles = np.broadcast_arrays(whole(radius, radii), whole(angle, angles))
        return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)


def tendon_field(segment: int, tendons: object, tendon: int, name: str) -> str:
    """Path of a tendon's field in a file (tendon from 0); a ring has one for all its tendons."""
    ring = isinstance(tendons, TendonRing)
    return f"segments[{segment}].tendons{'' if ring else f'[{tendon}]'}.{name}"


def _disks_of_a_body(schema: dict[str, Any]) -> None:
    """A body with tendons in it needs no disks."""
    schema["required"].remove("disks")
    body = {"properties": {"tendons_in": {"const": "body"}}, "required": ["tendons_in"]}
    schema["anyOf"] = [{"required": ["disks"]}, body]


_PLACES: Final = 10  # of a body without disks, where it is divided into modules


class Segment(Part):
    """One segment: backbone, disks, and the tendons anchored to its end disk.

    Attributes
    ----------
    name : str or None
    length : float
        Length of the straight backbone in m.
    backbone : Backbone
    tendons_in : str
        "disks", or "body" where the tendons run in channels of the backbone itself, as in a soft
        robot: they touch it everywhere, and may lie inside its radius.
    disks : Disks
        Without disks in the file (only with ``tendons_in`` "body"), ten places without mass.
    tendons : TendonRing or tuple of Tendon
        Empty where no tendon ends at the segment.
    """

    model_config = ConfigDict(json_schema_extra=_disks_of_a_body)

    name: Annotated[str | None, Text(100, "inner")] = Field(None, description="For reports.")
    length: Annotated[float, Quantity("m", "641 mm", "1 um", "1 km")] = Field(
        description="Length of the segment's backbone, base or last end disk to its end disk."
    )
    backbone: Backbone
    tendons_in: Annotated[str, Choice(("disks", "body"), "body")] = Field(
        "disks",
        description="Where the tendons run: in holes of disks, or in channels of the body itself, "
        "a soft robot that needs no disks.",
    )
    disks: Disks
    tendons: Annotated[
        Annotated[TendonRing, Tag("ring")]
        | Annotated[tuple[Tendon, ...], Field(max_length=MAX_TENDONS), Tag("list")],
        Discriminator(lambda value: "list" if isinstance(value, (list, tuple)) else "ring"),
    ]

    @model_validator(mode="before")
    @classmethod
    def _without_disks(cls, given: Any) -> Any:
        if not isinstance(given, dict) or given.get("tendons_in") != "body":
            return given
        disks = given.get("disks", {})
        if not isinstance(disks, dict):
            return given
        backbone = given.get("backbone")
        sizes = [0.0]
        for name in ("diameter", "end_diameter", "width", "end_width", "height", "end_height"):
            size = backbone.get(name) if isinstance(backbone, dict) else None
            with contextlib.suppress(ValueError, TypeError):  # reported with the backbone
                sizes.append(float(np.asarray(_SIZE.read(size))))
        places: dict[str, Any] = {"thickness": 0.0, "clamped_length": 0.0}
        places["radius"] = max(max(sizes) / 2.0, 1e-6)
        if "positions" not in disks:
            places["count"] = _PLACES
        if "density" not in disks:
            places["mass"] = 0.0
        return {**given, "disks": places | disks}

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
        """Tendons one by one, also where the file gives a ring."""
        ring = self.tendons
        if not isinstance(ring, TendonRing):
            return ring
        step = math.tau / ring.count
        properties = {name: getattr(ring, name) for name in TendonProperties.model_fields}
        return tuple(
            Tendon.model_construct(
                angle=ring.first_angle + i * step, pitch_radius=ring.pitch_radius, **properties
            )
            for i in range(ring.count)
        )
