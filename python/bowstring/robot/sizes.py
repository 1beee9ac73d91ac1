"""Names and sizes of a robot's parts; sizes that a robot file leaves out are assumed and listed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final, NamedTuple

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.results import Key, Result
from bowstring.robot.disk import room_for_holes
from bowstring.robot.model import Robot, check_round
from bowstring.robot.parts import TendonRing, tendon_field
from bowstring.units import number_with_unit

# Tendons are thin compared with the backbone (published robots: 0.2 to 1 mm on 1 to 5 mm).
_TENDON: Final = 1 / 5  # tendon diameter over backbone diameter
_HOLE: Final = 2.0  # hole diameter over tendon diameter
_USED_ROOM: Final = 0.8  # hole diameter over the largest that fits
_BASE_RADIUS, _BASE_THICKNESS = 1.25, 2.0  # times those of the first disk


@dataclass(frozen=True)
class Assumed(Result):
    """A size that the robot file does not give."""

    field: Annotated[str, Key()]
    """Field."""
    value_m: Annotated[float, Key()]
    """Assumed value."""
    why: Annotated[str, Key()]
    """Reason for the value."""

    def __str__(self) -> str:
        return f"{self.field} = {number_with_unit(self.value_m, 'm')}, {self.why}"


@dataclass(frozen=True)
class Sizes:
    """Sizes of the solid of a robot with S segments and T tendons, in m.

    Attributes
    ----------
    hole_m : ndarray (S,)
        Diameter of the tendons' holes in the disks of each segment; the base has that of the first.
    tendon_m : ndarray (T,)
        Diameter of each tendon.
    base_radius_m, base_thickness_m : float
        Radius and thickness of the base plate below the origin of the base frame.
    assumed : tuple of Assumed
        Sizes that the file leaves out.
    """

    hole_m: Floats
    tendon_m: Floats
    base_radius_m: float
    base_thickness_m: float
    assumed: tuple[Assumed, ...]


def sizes_of(robot: Robot) -> Sizes:
    """Collect the sizes of a robot's solid, given or assumed.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    Sizes

    Raises
    ------
    InputError
        If a backbone is not round, the disks have no thickness, or do not hold holes for a tendon
        of the given diameter.
    """
    if robot.is_embedded:
        raise InputError(
            f"{robot.name}: drawings and solids take tendons in disks only, not tendons_in body"
        )
    check_round(robot, f"{robot.name}: a drawing or solid")
    for k, s in enumerate(robot.segments):
        if s.disks.thickness == 0:
            raise InputError(
                f"{robot.name}: segments[{k}].disks.thickness is 0 mm, which makes no solid; write "
                f'for example --set segments.{k}.disks.thickness="3 mm"'
            )
    tendons, assumed = robot.tendons, []
    rods = np.array([s.backbone.outer_diameter for s in robot.segments])
    thin = np.array([_TENDON * rods[: k + 1].min() for k in range(len(rods))])[tendons.segment]
    wanted = np.where(np.isnan(tendons.diameter_m), thin, tendons.diameter_m)
    holes = np.empty(len(rods))
    for k, s in enumerate(robot.segments):
        passing = np.flatnonzero(tendons.segment >= k)
        if not passing.size:
            holes[k] = holes[k - 1]  # no tendon passes, and the disks have no holes
            continue
        thick = int(passing[wanted[passing].argmax()])
        bore = float(robot.disks.bore_m[robot.disks.segment == k].max())
        own = np.flatnonzero(robot.disks.segment == k)
        drilled = own[:1] if robot.is_parallel else own
        inner = float(np.min([s.backbone.inner_diameter, s.backbone.at(1.0).inner_diameter]))
        room, fault = min(
            room_for_holes(robot.holes(k, d), s.disks.radius, bore, inner) for d in drilled
        )
        if s.disks.hole_diameter is not None:
            holes[k] = s.disks.hole_diameter  # checked when the file was read
            continue
        holes[k] = min(_HOLE * wanted[thick], _USED_ROOM * room)
        if holes[k] <= np.nan_to_num(tendons.diameter_m[passing]).max():
            widest = float(np.nanmax(tendons.diameter_m[passing]))
            raise InputError(
                f"{robot.name}: the disks of segments[{k}] do not hold holes for a tendon of "
                f"{number_with_unit(widest, 'm')}: wider than {number_with_unit(room, 'm')} "
                f"{fault}; write a smaller tendons.diameter or disks.hole_diameter"
            )
        why = (
            "twice the thickest tendon"
            if holes[k] == _HOLE * wanted[thick]
            else f"{_USED_ROOM:.0%} of the room that the disk has"
        )
        assumed.append(Assumed(f"segments[{k}].disks.hole_diameter", float(holes[k]), why))
    narrowest = np.minimum.accumulate(holes)[tendons.segment]
    sure = np.isnan(tendons.diameter_m)
    diameter = np.where(sure, np.minimum(wanted, narrowest / _HOLE), wanted)
    for k, s in enumerate(robot.segments):
        mine = np.flatnonzero((tendons.segment == k) & sure)
        ring = isinstance(s.tendons, TendonRing)
        for i in mine[:1] if ring else mine:
            whole = diameter[i] == thin[i]
            why = "a fifth of the thinnest backbone" if whole else "half of the narrowest hole"
            place = i - np.flatnonzero(tendons.segment == k)[0]
            field = tendon_field(k, s.tendons, place, "diameter")
            assumed.append(Assumed(field, float(diameter[i]), why))
    first = robot.segments[0].disks
    radius, thickness = _BASE_RADIUS * first.radius, _BASE_THICKNESS * first.thickness
    assumed += [
        Assumed("radius of the base", radius, f"{_BASE_RADIUS:g} times that of the first disk"),
        Assumed("thickness of the base", thickness, "twice that of the first disk"),
    ]
    return Sizes(holes, diameter, radius, thickness, tuple(assumed))


class PartNames(NamedTuple):
    """Names of a robot's parts in exported files, each from base to tip."""

    backbones: tuple[str, ...]
    """``backbone``, or ``backbone_1`` and so on where there are several segments."""
    disks: tuple[str, ...]
    tendons: tuple[str, ...]


def part_names(robot: Robot) -> PartNames:
    """Names of backbones, disks and tendons: a file is read beside another of the same robot."""

    def numbered(kind: str, count: int) -> tuple[str, ...]:
        return tuple(f"{kind}_{k + 1}" for k in range(count))

    segments = len(robot.segments)
    return PartNames(
        numbered("backbone", segments) if segments > 1 else ("backbone",),
        numbered("disk", len(robot.disks.station_m)),
        numbered("tendon", len(robot.tendons.segment)),
    )
