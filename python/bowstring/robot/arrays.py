"""Numbers of a robot as arrays, one entry per disk, tendon or segment."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator
from pydantic_core import PydanticCustomError

from bowstring.aliases import Bools, Floats, Ints
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.robot.consistency import bores, problems
from bowstring.robot.disk import distinct_holes, drilled_disk, outside_bore, stacked
from bowstring.robot.laws import LAWS, MEMORIES
from bowstring.robot.parts import MAX_SEGMENTS, Backbone, Part, Payload, Segment, Tendon
from bowstring.robot.stiffness import (
    has_couplings,
    matrix_of,
    tension_centre,
    without_couplings,
)
from bowstring.units import Quantity, Text


@short_repr
@dataclass(frozen=True)
class RobotDisks:
    """Arrays of all N disks from base to tip, base excluded, in SI.

    ``inertia_kg_m2`` (N, 2) are the moments of inertia about a diameter and about the axis.
    ``bore_m`` are the diameters of the holes for the backbone.
    """

    station_m: Floats
    """Arc lengths (N,) of the disks from the base, along the straight backbone, m."""
    clamped_length_m: Floats
    """Lengths (N,) of backbone that each disk clamps rigidly, centred on it, m."""
    mass_kg: Floats
    """Masses (N,), kg."""
    inertia_kg_m2: Floats
    radius_m: Floats
    """Outer radii (N,), m."""
    thickness_m: Floats
    """Thicknesses (N,), m."""
    bore_m: Floats
    hole_length_m: Floats
    """Lengths (N,) of the tendons' holes along the axis, centred on the disks, m."""
    segment: Ints
    """Segments (N,) of the disks, as indices from 0."""


#: Numbers of a line of the core, in its order.
_LINE: Final = (
    "axial_stiffness_N",
    "free_length_m",
    "compliance_m_per_N",
    "friction",
    "pretension_N",
    "backlash_m",
    "wrap_angle_rad",
    "hole_clearance_m",
    "mount_compliance_m_per_N",
)


@short_repr
@dataclass(frozen=True)
class RobotTendons:
    """Arrays of all T tendons by segment, innermost first, in file order, in SI.

    ``hole_m`` are x and y of the holes in the base, ``end_disk`` the index (from 0) of the
    disk to which a tendon is anchored. ``axial_stiffness_N`` is infinite for an inextensible
    tendon, ``spool_radius_m`` NaN for one without a spool, ``diameter_m`` NaN where unknown.
    """

    hole_m: Floats
    holes_m: Floats
    """x and y (T, P, 2) of the holes in the frames of base and disks, m. P is 1 where all tendons
    are parallel to the backbone; otherwise N + 1, NaN beyond a tendon's end disk."""
    mean_hole_m: Floats
    """Mean of x and y (S, T, 2) over the length of each segment, m: what constant curvature sees of
    the routing."""
    pitch_radius_m: Floats
    """Distances (T,) of the holes in the base from the backbone's axis, m."""
    angle_rad: Floats
    """Angles (T,) of the holes in the base from x, counter-clockwise about z, rad."""
    segment: Ints
    """Segments (T,) to whose end disks the tendons are anchored, as indices from 0."""
    end_disk: Ints
    axial_stiffness_N: Floats
    free_length_m: Floats
    """Elastic lengths (T,) between base hole and actuator, m."""
    compliance_m_per_N: Floats
    """Compliances (T,) of the transmission, m/N."""
    creep: Floats
    """Creep of each tendon (T, 2, 2): two terms, each a compliance that comes with time in m/N, and
    its time in s."""
    friction: Floats
    """Coulomb friction coefficients (T,) at each hole."""
    wrap_angle_rad: Floats
    """Angles (T,) by which the tendons turn between drive and base hole, with the same friction."""
    backlash_m: Floats
    """Halves (T,) of the free travel of the drives when the displacement reverses, m."""
    hole_clearance_m: Floats
    """Differences (T,) of the radii of hole and tendon, m."""
    mount_compliance_m_per_N: Floats
    """Displacements (T,) that the mount of the drives takes by the sum of all tensions, m/N."""
    gain: Floats
    """Displacements (T,) of the tendons over those commanded."""
    zero_m: Floats
    """Displacements (T,) of the tendons where 0 is commanded, m."""
    decoupling: Floats
    """Shares (T,), of the displacements that inner segments take, that the drives add."""
    delay_s: Floats
    """Times (T,) after which the drives follow commands, s."""
    pretension_N: Floats
    """Tensions (T,) in the home pose, where the tendon displacements are zero, N."""
    spool_radius_m: Floats
    diameter_m: Floats
    pushes: Bools
    """Whether each tendon (T,) is a rod or a chamber, which pushes too."""
    area_m2: Floats
    """Areas (T,) on which the pressure of chambers acts, NaN where unknown, m^2."""
    bending_stiffness_Nm2: Floats
    """Bending stiffnesses (T,) of rods, NaN where unknown, N m^2."""

    @property
    def least_tension_N(self) -> Floats:
        """Least possible tensions (T,): 0, or -infinity of those that push too, N."""
        return np.where(self.pushes, -math.inf, 0.0)

    @cached_property
    def arm_m(self) -> Floats:
        """Lever arms (..., T), m: pitch radii in the base; of a tendon on the axis there, the
        largest distance of its mean hole in a segment from the axis."""
        beyond = np.hypot(*np.moveaxis(self.mean_hole_m, -1, 0)).max(axis=-2, initial=0.0)
        return frozen(np.where(self.pitch_radius_m > 0, self.pitch_radius_m, beyond))

    @cached_property
    def lines(self) -> Floats:
        """Numbers (..., T, 9) of the lines of the core: transmission, elasticity and friction."""
        each = np.broadcast_arrays(*(getattr(self, name) for name in _LINE))
        return frozen(np.stack(each, axis=-1))


def _in_pairs(first: Floats, second: Floats) -> Floats:
    return frozen(np.stack(np.broadcast_arrays(first, second), axis=-1))


def _in_terms(each: Callable[[str], Floats], size: str, time: str) -> Floats:
    """Sizes and times (..., 2, 2) of both terms, from fields of these names."""
    names = ((size, time), (f"second_{size}", f"second_{time}"))
    terms = [_in_pairs(*map(each, pair)) for pair in names]
    return frozen(np.stack(np.broadcast_arrays(*terms), axis=-2))


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_GAUSS: Final = tuple(zip(0.5 + 0.5 * _NODES, 0.5 * _WEIGHTS, strict=True))
"""Places in the unit interval, each with its weight."""


def _mass(backbone: Backbone) -> Any:
    """Mass per length in kg/m."""
    if backbone.mass_per_length is not None:
        return backbone.mass_per_length
    assert backbone.density is not None
    return backbone.density * backbone.area


def _rotary(backbone: Backbone) -> Any:
    """Rotary inertia per length in kg m."""
    if backbone.stiffness is not None:
        return 0.0 if backbone.rotary_inertia is None else backbone.rotary_inertia
    assert backbone.density is not None
    return backbone.density * backbone.second_moment


def principal_bending(backbone: Backbone) -> tuple[Any, Any, Any]:
    """Bending stiffness of a section about both principal axes, and where these are.

    Parameters
    ----------
    backbone : Backbone

    Returns
    -------
    first, second : float
        Bending stiffness at the start of the segment, N m^2; of a stiffness matrix that by a moment
        alone, all other loads zero.
    angle : float
        Angle of the first axis from x, rad.
    """
    if backbone.stiffness is not None:
        first, second, angle, *_ = without_couplings(backbone.stiffness)
        return first, second, angle
    first, second = backbone.second_moments
    return backbone.young * first, backbone.young * second, backbone.width_direction


def _section(backbone: Backbone) -> Floats:
    """Numbers (..., 8) of a section, in the order of `RobotArrays.sections`."""
    if backbone.stiffness is not None:
        return stacked([*without_couplings(backbone.stiffness), _mass(backbone), _rotary(backbone)])
    first, second = backbone.second_moments
    shear = backbone.shear_modulus
    numbers = (
        backbone.young * first,
        backbone.young * second,
        backbone.width_direction,
        shear * backbone.torsion_constant,
        backbone.young * backbone.area,
        shear * backbone.area,
        _mass(backbone),
        _rotary(backbone),
    )
    return stacked(numbers)


def frozen(values: object, dtype: type = float) -> NDArray[Any]:
    """Copy values into a read-only array.

    Parameters
    ----------
    values : array_like
        Values of any shape.
    dtype : type
        Type of the entries.

    Returns
    -------
    ndarray
        New read-only array.
    """
    array: NDArray[Any] = np.array(values, dtype=dtype)
    array.flags.writeable = False
    return array


class RobotArrays(Part):
    """Fields of a robot, with their numbers as arrays in SI.

    The fields may be arrays of the numbers of many robots (`bowstring.robot.designs.Designs`); then
    all arrays have a leading axis for them.
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

    segments: Annotated[tuple[Segment, ...], Field(min_length=1, max_length=MAX_SEGMENTS)] = Field(
        description="From base to tip."
    )

    payloads: Annotated[tuple[Payload, ...], Field(max_length=MAX_SEGMENTS)] = Field(
        (), description="Rigid bodies fixed to disks."
    )

    @model_validator(mode="after")
    def _check(self) -> RobotArrays:
        found = list(problems(self.segments))
        if not found:
            disks = sum(len(s.disk_positions) for s in self.segments)
            for i, payload in enumerate(self.payloads):
                if payload.disk is not None and payload.disk > disks:
                    found.append(
                        f"payloads[{i}].disk: got {payload.disk}; the robot has {disks} disks"
                    )
        if found:
            raise PydanticCustomError("bowstring_many", "", {"problems": found})
        return self

    @cached_property
    def payload_numbers(self) -> Floats:
        """Disk, counted from 0, mass, centre and moments of inertia (P, 8) of payloads, SI."""
        last = sum(len(s.disk_positions) for s in self.segments)
        if not self.payloads:
            return frozen(np.zeros((0, 8)))
        rows = [
            stacked([(p.disk or last) - 1, p.mass, *p.centre, *p.inertia]) for p in self.payloads
        ]
        return frozen(np.stack(np.broadcast_arrays(*rows), axis=-2))

    @cached_property
    def carried_kg(self) -> Floats:
        """Mass (N,) of the payloads of each disk, kg."""
        numbers = self.payload_numbers
        disks = sum(len(s.disk_positions) for s in self.segments)
        carried = np.zeros((*numbers.shape[:-2], disks))
        for row in np.moveaxis(numbers, -2, 0):
            carried[..., int(row[..., 0].flat[0])] += row[..., 1]
        return frozen(carried)

    @property
    def length(self) -> float:
        """Length of the whole straight backbone in m."""
        return sum(segment.length for segment in self.segments)

    @cached_property
    def disks(self) -> RobotDisks:
        """All disks as arrays."""
        counts = [len(s.disk_positions) for s in self.segments]
        index = np.repeat(np.arange(len(counts)), counts)

        def each(field: str) -> Floats:
            values = (getattr(s.disks, field) for s in self.segments)
            return stacked([math.nan if v is None else v for v in values])[..., index]

        mass, radius, thickness = each("mass"), each("radius"), each("thickness")
        inertia = np.stack(
            np.broadcast_arrays(
                mass * (3.0 * radius**2 + thickness**2) / 12.0, mass * radius**2 / 2.0
            ),
            axis=-1,
        )
        bore = bores(self.segments)[..., index]
        ends = np.flatnonzero(np.diff(index))  # an end disk also clamps the next segment's start
        bore[..., ends] = np.maximum(bore[..., ends], bore[..., ends + 1])
        for k, s in enumerate(self.segments):
            d = s.disks
            if d.density is None or d.hole_diameter is None:
                continue
            own = np.flatnonzero(index == k)
            # the end disk may have a wider bore than the others
            alike = (own[-1:], own[:-1]) if self.is_parallel else own[:, None]
            for here in alike:
                i = here[0] if len(here) else own[0]
                holes = self.holes(k, i)
                if not self.is_embedded:
                    holes = outside_bore(holes, bore[..., i])
                drilled = drilled_disk(
                    *(d.density, d.radius, d.thickness), bore[..., i], holes, d.hole_diameter
                )
                if drilled.mass.ndim > mass.ndim - 1:  # of many robots
                    shape = drilled.mass.shape
                    mass = np.broadcast_to(mass, (*shape, len(index))).copy()
                    inertia = np.broadcast_to(inertia, (*shape, len(index), 2)).copy()
                mass[..., here] = drilled.mass[..., None]
                inertia[..., here, 0] = drilled.across[..., None]
                inertia[..., here, 1] = drilled.axial[..., None]
        return RobotDisks(
            station_m=frozen(self._stations),
            clamped_length_m=frozen(each("clamped_length")),
            mass_kg=frozen(mass),
            inertia_kg_m2=frozen(inertia),
            radius_m=frozen(radius),
            thickness_m=frozen(thickness),
            bore_m=frozen(bore),
            hole_length_m=frozen(each("hole_length")),
            segment=frozen(index, np.int64),
        )

    @cached_property
    def _stations(self) -> Floats:
        stations: list[Any] = []
        start: Any = 0.0
        for segment in self.segments:
            stations += (start + position for position in segment.disk_positions)
            start += segment.length
        return stacked(stations)

    @cached_property
    def tendons(self) -> RobotTendons:
        """All tendons as arrays."""
        ends = np.cumsum([len(s.disk_positions) for s in self.segments]) - 1
        every = [t for segment in self.segments for t in segment.tendon_list]
        counts = [len(s.tendon_list) for s in self.segments]
        index = np.repeat(np.arange(len(counts)), counts)

        def each(field: str, none: float = math.nan) -> Floats:
            values = (getattr(t, field) for t in every)
            return frozen(stacked([none if value is None else value for value in values]))

        r, a = each("pitch_radius"), each("angle")
        hole = np.stack(np.broadcast_arrays(r * np.cos(a), r * np.sin(a)), axis=-1)
        holes, mean = self._routing(every, ends[index], hole)
        return RobotTendons(
            hole_m=frozen(hole),
            holes_m=frozen(holes),
            mean_hole_m=frozen(mean),
            pitch_radius_m=r,
            angle_rad=a,
            segment=frozen(index, np.int64),
            end_disk=frozen(ends[index], np.int64),
            axial_stiffness_N=each("axial_stiffness", math.inf),
            free_length_m=each("free_length"),
            compliance_m_per_N=each("compliance"),
            creep=_in_terms(each, "creep_compliance", "creep_time"),
            friction=each("friction"),
            wrap_angle_rad=each("wrap_angle"),
            backlash_m=each("backlash"),
            hole_clearance_m=each("hole_clearance"),
            mount_compliance_m_per_N=each("mount_compliance"),
            gain=each("gain"),
            zero_m=each("zero"),
            decoupling=each("decoupling"),
            delay_s=each("delay"),
            pretension_N=each("pretension"),
            spool_radius_m=each("spool_radius"),
            diameter_m=each("diameter"),
            pushes=frozen([t.pushes for t in every], bool),
            area_m2=each("area"),
            bending_stiffness_Nm2=each("bending_stiffness"),
        )

    def _routing(self, every: list[Tendon], ends: Ints, hole: Floats) -> tuple[Floats, Floats]:
        """Holes of all tendons in base and disks, and their means over the segments."""
        count = len(self.segments)
        mean = np.repeat(hole[..., None, :, :], count, axis=-3)
        if all(tendon.is_parallel for tendon in every):
            return hole[..., :, None, :], mean
        station = self._stations
        of = np.repeat(np.arange(count), [len(s.disk_positions) for s in self.segments])
        planes = np.concatenate([np.zeros((*station.shape[:-1], 1)), station], axis=-1)
        routes = [t.holes(station[..., : e + 1]) for t, e in zip(every, ends, strict=True)]
        lead = np.broadcast_shapes(hole.shape[:-2], *(route.shape[:-2] for route in routes))
        holes = np.full((*lead, len(every), len(of) + 1, 2), math.nan)
        mean = np.broadcast_to(mean, (*lead, *mean.shape[-3:])).copy()
        for i, (tendon, route) in enumerate(zip(every, routes, strict=True)):
            holes[..., i, : route.shape[-2], :] = route
            if tendon.is_parallel:
                continue
            for k in range(of[ends[i]] + 1):
                own = np.flatnonzero(of == k)
                at = slice(own[0], own[-1] + 2)
                length = planes[..., own[-1] + 1] - planes[..., own[0]]
                area = np.trapezoid(route[..., at, :], planes[..., at, None], axis=-2)
                mean[..., k, i, :] = area / np.asarray(length)[..., None]
        return holes, mean

    def tendon_points(self, position: Floats, rotation: Floats) -> list[Floats]:
        """Points that the tendons pass, from the base hole to the hole of the end disk.

        Parameters
        ----------
        position : ndarray (..., N, 3)
            Positions of the disks in m, base frame.
        rotation : ndarray (..., N, 3, 3)
            Rotations of the disks, disk frame to base frame.

        Returns
        -------
        list of ndarray (..., P, 3)
            For each tendon, in m, base frame; P is the number of disks that it passes and 1. Where
            holes have a length, entry and exit of each hole, up to the middle of the end disk.
        """
        lead, n = position.shape[:-2], position.shape[-2]
        base = np.zeros((*lead, 1, 3))
        centres = np.concatenate([base, position], axis=-2)
        frames = np.concatenate([np.broadcast_to(np.eye(3), (*lead, 1, 3, 3)), rotation], axis=-3)
        holes = np.broadcast_to(self.tendons.holes_m, (len(self.tendons.end_disk), n + 1, 2))
        points = []
        for hole, end in zip(holes, self.tendons.end_disk, strict=True):
            last = int(end) + 2
            arm = np.einsum("...kij,kj->...ki", frames[..., :last, :, :2], hole[:last])
            points.append(centres[..., :last, :] + arm)
        half = 0.5 * self.disks.hole_length_m
        if not half.any():
            return points
        along = half[:, None] * rotation[..., 2]
        planes = []
        for path in points:
            own = along[..., : path.shape[-2] - 1, :]
            inner = np.stack([path[..., 1:, :] - own, path[..., 1:, :] + own], axis=-2)
            flat = inner.reshape(*inner.shape[:-3], -1, 3)
            flat[..., -1, :] = path[..., -1, :]
            planes.append(np.concatenate([path[..., :1, :], flat], axis=-2))
        return planes

    @cached_property
    def is_parallel(self) -> bool:
        """Whether all tendons are parallel to the backbone."""
        return bool(self.tendons.holes_m.shape[-2] == 1)

    def holes(self, segment: int, disk: int = -1) -> Floats:
        """Positions x, y (H, 2) of the holes in the disks of a segment (index from 0), in m.

        Where tendons are not parallel to the backbone, those in one disk (index from 0).
        """
        passing = self.tendons.segment >= segment
        if self.is_parallel:
            return distinct_holes(self.tendons.hole_m[..., passing, :])
        return distinct_holes(self.tendons.holes_m[..., passing, disk + 1, :])

    @cached_property
    def hysteresis(self) -> Floats:
        """Hysteresis of each backbone (S, 2): share, and half-width of the play in 1/m."""
        share = stacked([s.backbone.hysteresis for s in self.segments])
        play = stacked([s.backbone.hysteresis_play / s.length for s in self.segments])
        return _in_pairs(share, play)

    @cached_property
    def relaxation(self) -> Floats:
        """Relaxation of each backbone (S, 2, 2): two terms, each a share and a time in s."""

        def each(name: str) -> Floats:
            return stacked([getattr(s.backbone, name) for s in self.segments])

        return _in_terms(each, "relaxation", "relaxation_time")

    @cached_property
    def laws(self) -> tuple[str, ...]:
        """Laws that act, by their keys in `bowstring.robot.laws.LAWS`."""
        backbones = [s.backbone for s in self.segments]
        tendons = [t for s in self.segments for t in s.tendon_list]
        return tuple(
            law.key
            for law in LAWS.values()
            for parts in [tendons if law.part == "tendons" else backbones]
            if any(np.any(getattr(p, size) != law.none) for p in parts for size in law.sizes)
        )

    @cached_property
    def displacement_coupling(self) -> Floats | None:
        """Displacements of the tendons (T, T) by those commanded, of drives that add what inner
        segments take (theory Eq. 4.13); None without decoupling.

        Raises
        ------
        InputError
            For many designs whose holes or decoupling differ.
        """
        tendons = self.tendons
        if not tendons.decoupling.any():
            return None
        if tendons.decoupling.ndim > 1 or tendons.mean_hole_m.ndim > 3:
            raise InputError(
                "designs with different holes take displacements of whole tendons; set decoupling "
                "to 0"
            )
        every = np.eye(len(tendons.segment))
        taken = np.zeros_like(every)
        for k, holes in enumerate(tendons.mean_hole_m):
            own, beyond = tendons.segment == k, tendons.segment > k
            # shortening and bend of the segment: at the hole b a tendon loses s + b . bend
            arm = np.column_stack([np.full(len(holes), np.abs(holes).max()), holes])
            if np.linalg.matrix_rank(arm[own]) == np.linalg.matrix_rank(arm[own, 1:]):
                arm = arm[:, 1:]  # its own tendons do not tell a shortening from a bend
            taken[np.ix_(beyond, own)] = arm[beyond] @ np.linalg.pinv(arm[own])
        share = tendons.decoupling[:, None]
        alone = np.linalg.inv(every + (1.0 - share) * taken)
        found = every + share * (taken @ alone)
        found[np.abs(found) < 1e-12] = 0.0  # rounding; `check_coupled` reads who needs whom
        return frozen(found)

    @property
    def memories(self) -> tuple[str, ...]:
        """Laws that act and have a memory."""
        return tuple(key for key in self.laws if key in MEMORIES)

    @property
    def has_memory(self) -> bool:
        """Whether equilibria depend on the path."""
        return bool(self.memories)

    @property
    def has_friction(self) -> bool:
        """Whether any tendon has friction at its holes."""
        return "friction" in self.memories

    @property
    def is_viscoelastic(self) -> bool:
        """Whether any backbone relaxes or any tendon creeps, so that equilibria depend on time."""
        return any(MEMORIES[key].timed for key in self.memories)

    def _by_segment(self, value: Callable[[Backbone], Any]) -> Floats:
        """Means (S,) of a number over the length of each segment."""

        def mean(backbone: Backbone) -> Any:
            if not backbone.is_tapered:
                return value(backbone)
            return sum(w * value(backbone.at(x)) for x, w in _GAUSS)

        return frozen(stacked([mean(s.backbone) for s in self.segments]))

    @cached_property
    def sections(self) -> Floats:
        """Sections (S, P, 11) of the backbone along each segment, in SI.

        At P equal distances from the start to the end of a segment: 1 where nothing is tapered,
        otherwise 5. Columns: bending stiffness about both principal axes, angle of the first one
        from x, torsional, axial and shear stiffness (shear factor 1), mass per length, rotary
        inertia per length, and the curvature about x and y and twist without load.
        """
        tapered = any(s.backbone.is_tapered for s in self.segments)
        places = np.linspace(0.0, 1.0, 5) if tapered else [0.0]
        rows = [
            np.stack([_section(s.backbone.at(float(x))) for x in places], axis=-2)
            for s in self.segments
        ]
        lead = np.broadcast_shapes(*(row.shape[:-2] for row in rows))
        sections = np.stack([np.broadcast_to(r, (*lead, *r.shape[-2:])) for r in rows], axis=-3)
        rest = self.rest_curvature[..., :, None, :]
        shape = np.broadcast_shapes(sections.shape[:-1], (*rest.shape[:-2], len(places)))
        parts = [np.broadcast_to(p, (*shape, p.shape[-1])) for p in (sections, rest)]
        return frozen(np.concatenate(parts, axis=-1))

    @cached_property
    def is_embedded(self) -> bool:
        """Whether the tendons run in the body itself, which they touch everywhere."""
        return self.segments[0].tendons_in == "body"

    @cached_property
    def is_round(self) -> bool:
        """Whether all sections are circles or rings."""
        return all(s.backbone.is_round for s in self.segments)

    @cached_property
    def bend_by_moment(self) -> Floats:
        """Bend (S, 2, 2) of each segment towards x and y by a moment that bends it so, rad/(N m).

        By the flexibility 1/(E I), its mean over the length.
        """
        flexibility = []
        for principal in (0, 1):

            def own(backbone: Backbone, axis: int = principal) -> Any:
                return 1.0 / principal_bending(backbone)[axis]

            flexibility.append(self._by_segment(own))
        angle = stacked([principal_bending(s.backbone)[2] for s in self.segments])
        length = stacked([s.length for s in self.segments])
        cos, sin = np.cos(angle), np.sin(angle)
        first, second = (f * length for f in flexibility)
        # a bend towards x is a rotation about y
        towards_x = first * sin**2 + second * cos**2
        towards_y = first * cos**2 + second * sin**2
        both = np.broadcast_arrays(towards_x, (second - first) * sin * cos, towards_y)
        return frozen(np.stack([np.stack(both[:2], -1), np.stack(both[1:], -1)], axis=-2))

    @cached_property
    def tension_centre_m(self) -> Floats:
        """Place (S, 2) in each section through which an axial force does not bend it, in m.

        Off the backbone's line only where a stiffness matrix couples bending and extension.
        """
        given = ~np.isnan(self.section_stiffness[..., 0, 0])
        matrices = np.where(given[..., None, None], self.section_stiffness, np.eye(6))
        return frozen(tension_centre(matrices))

    @cached_property
    def bends_alike(self) -> bool:
        """Whether each section has the same bending stiffness about all axes."""
        return bool(np.all(self.sections[..., 0] == self.sections[..., 1]))

    @cached_property
    def bending_stiffness(self) -> Floats:
        """E I of each segment in N m^2: the inverse of the mean flexibility 1/(E I)."""
        return frozen(
            1.0 / self._by_segment(lambda b: sum(1.0 / k for k in principal_bending(b)[:2]) / 2.0)
        )

    @cached_property
    def rest_curvature(self) -> Floats:
        """Curvature about x and y and twist about z (S, 3) of the unloaded backbone, 1/m.

        In the frame of the backbone, one row for each segment.
        """

        def rows(of: Callable[[Backbone], Any]) -> Floats:
            return stacked([of(s.backbone) / s.length for s in self.segments])

        parts = (
            rows(lambda b: -b.rest_bend * np.sin(b.rest_direction)),
            rows(lambda b: b.rest_bend * np.cos(b.rest_direction)),
            rows(lambda b: b.rest_twist),
        )
        return frozen(np.stack(np.broadcast_arrays(*parts), axis=-1))

    @cached_property
    def torsion_stiffness(self) -> Floats:
        """G J of each segment in N m^2: the inverse of the mean flexibility 1/(G J)."""
        return frozen(1.0 / self._by_segment(lambda b: 1.0 / _section(b)[..., 3]))

    @cached_property
    def axial_stiffness(self) -> Floats:
        """E A of each segment in N: the inverse of the mean of 1/(E A)."""
        return frozen(1.0 / self._by_segment(lambda b: 1.0 / _section(b)[..., 4]))

    @cached_property
    def shear_stiffness(self) -> Floats:
        """G A of each segment in N (shear factor 1): the inverse of the mean of 1/(G A)."""
        return frozen(1.0 / self._by_segment(lambda b: 1.0 / _section(b)[..., 5]))

    @cached_property
    def section_stiffness(self) -> Floats:
        """Stiffness matrix (S, 6, 6) of the section of each segment, in SI; NaN where not given."""
        none = np.full((6, 6), math.nan)
        given = [s.backbone.stiffness for s in self.segments]
        each = [none if rows is None else matrix_of(rows) for rows in given]
        lead = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in each))
        return frozen(np.stack([np.broadcast_to(m, (*lead, 6, 6)) for m in each], axis=-3))

    @cached_property
    def is_coupled(self) -> bool:
        """Whether a stiffness matrix couples strains that a plain section does not couple."""
        return bool(has_couplings(self.section_stiffness).any())

    @cached_property
    def mass_per_length(self) -> Floats:
        """Mean mass per length of each segment's backbone in kg/m."""
        return self._by_segment(_mass)

    @cached_property
    def rotary_inertia(self) -> Floats:
        """Density times second moment of area of each segment's backbone, its mean, in kg m."""
        return self._by_segment(_rotary)
