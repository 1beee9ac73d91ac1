"""Limits outside the mechanical model: the mounting plane and the strength of the material.

The robot is mounted in the plane z = 0 of the base frame; a disk below it is probably impossible.
Rods that push may buckle between disks; a backbone that is stretched far is not linearly elastic.
A robot file may give limits of a segment's backbone, ``yield_strength`` (von Mises stress) and
``strain_limit`` (strain along its surface); statics stays linearly elastic beyond them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.errors import NoSolutionError
from bowstring.formatting import in_mm, in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.statics import fields
from bowstring.units import number_with_unit

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot
    from bowstring.statics.fields import Frames, Section

What = Literal["strain_limit", "yield_strength"]

POINTS: Final = 5  # stations per module, as in fields
_LARGE_STRETCH: Final = 0.1  # extension of a backbone beyond which linear elasticity is in doubt
_NOTHING: Final = 1e-6  # depth below the base over length, below which it is rounding


@dataclass(frozen=True)
class Utilisation(Result):
    """Utilisation of one limit of a segment's backbone."""

    segment: Annotated[int, Key()]
    """Number of the segment, from 1."""
    what: Annotated[What, Key()]
    """Name of the limit: ``strain_limit`` or ``yield_strength``."""
    value: Annotated[float, Key(unit="1 or Pa")]
    """Largest strain along the surface, or largest von Mises stress."""
    limit: Annotated[float, Key(unit="1 or Pa")]
    """Limit in the same unit."""

    @property
    def share(self) -> Annotated[float, Key()]:
        """Value over limit."""
        return self.value / self.limit

    def __str__(self) -> str:
        value, limit, name = (
            (in_percent(self.value), in_percent(self.limit), "strain")
            if self.what == "strain_limit"
            else (_stress(self.value), _stress(self.limit), "von Mises stress")
        )
        return f"{name} {value}, {in_percent(self.share)} of {self.what} {limit}"


def has_limits(robot: Robot) -> bool:
    """Whether the robot file gives a limit of a backbone."""
    return any(s.backbone.yield_strength or s.backbone.strain_limit for s in robot.segments)


def by_segment(
    robot: Robot, frames: Frames, section: Section, found: dict[str, Floats]
) -> tuple[Floats, Floats]:
    """Largest von Mises stress (T, S) in Pa and strain along the surface (T, S) of each segment.

    `found` is the result of `bowstring.statics.fields.derive`.
    """
    change = found["curvature"] - section.rest_curvature
    bend = np.hypot(change[..., 0], change[..., 1])
    strain = bend * section.radius + np.abs(found["strain"][..., 2])
    segment = robot.disks.segment[frames.module]
    each = range(len(robot.segments))
    return (
        np.stack([found["von_mises"][:, segment == k].max(axis=1) for k in each], axis=1),
        np.stack([strain[:, segment == k].max(axis=1) for k in each], axis=1),
    )


def utilisations(robot: Robot, von_mises: Floats, strain: Floats) -> list[Utilisation]:
    """Utilisation of the segments' limits by the largest stress and strain (S,)."""
    out = []
    for k, segment in enumerate(robot.segments):
        rod = segment.backbone
        found: tuple[tuple[What, float, float | None], ...] = (
            ("strain_limit", float(strain[k]), rod.strain_limit),
            ("yield_strength", float(von_mises[k]), rod.yield_strength),
        )
        for what, value, limit in found:
            if limit is not None and np.isfinite(value):
                out.append(Utilisation(k + 1, what, value, limit))
    return out


def of_pose(
    robot: Robot, disk_positions: Floats, frames_of: Callable[[], Frames], model: RodModel
) -> tuple[tuple[str, ...], tuple[Utilisation, ...]]:
    """Warnings of an equilibrium, and utilisation of the limits of the robot file.

    Parameters
    ----------
    robot : Robot
    disk_positions : ndarray (N, 3)
        Positions of the disks in m.
    frames_of : callable
        Returns raw output with `POINTS` stations per module; called only if there are limits.
    model : RodModel
        Model of the equilibrium.

    Returns
    -------
    warnings : tuple of str
    uses : tuple of Utilisation
        Utilisation of each limit; empty if the robot file has none.
    """
    out = [f"{what}." for what in below_base(robot, disk_positions)]
    if not has_limits(robot):
        return tuple(out), ()
    try:
        frames = frames_of()
    except NoSolutionError as error:
        return (*out, f"limits of the backbone were not checked: {error}"), ()
    section = fields.Section(robot, frames.station, frames.module, model, partly=True)
    found = fields.derive(robot, frames, section)
    von_mises, strain = by_segment(robot, frames, section, found)
    uses = utilisations(robot, von_mises[0], strain[0])
    several = len(robot.segments) > 1
    out += [
        f"the backbone{f' of segment {u.segment}' * several} exceeds its limit: {u}; "
        "lower the load."
        for u in uses
        if u.share > 1.0
    ]
    return tuple(out), tuple(uses)


def buckled_or_stretched(robot: Robot, tensions: Floats, model: RodModel) -> list[str]:
    """Sentences on rods that buckle, and on a backbone stretched beyond linear elasticity.

    Parameters
    ----------
    robot : Robot
    tensions : ndarray (..., T)
        Of one pose or several, in N; NaN where there is no equilibrium.
    model : RodModel
        A rod without extension is not stretched.

    Returns
    -------
    list of str
    """
    rows = np.atleast_2d(tensions)
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return []
    stretched = _stretched_backbones(robot, rows) if model.theory == "cosserat" else []
    return [*_compressed_rods(robot, rows.min(axis=0)), *stretched]


def _stretched_backbones(robot: Robot, tensions: Floats) -> list[str]:
    """Sentence on the segment that tensions (n, T) stretch or compress most, if that is much."""
    last = robot.disks.segment[robot.tendons.end_disk]
    passes = last[:, None] >= np.arange(len(robot.segments))
    stretch = -(tensions @ passes) / robot.axial_stiffness
    row, k = np.unravel_index(np.argmax(np.abs(stretch)), stretch.shape)
    most = float(stretch[row, k])
    if abs(most) <= _LARGE_STRETCH:
        return []
    of = f" of segment {k + 1}" * (len(robot.segments) > 1)
    return [
        f"the tensions {'stretch' if most > 0.0 else 'compress'} the backbone{of} by about "
        f"{in_percent(abs(most))}. The model is linearly elastic: at 10 % its force is a tenth "
        "off that of rubber (neo-Hookean), and further off beyond. Lower the load, or measure."
    ]


def _compressed_rods(robot: Robot, tensions: Floats) -> list[str]:
    """Sentences on rods under compression: beyond Euler's load of a span, or not checked.

    A rod in equidistant holes buckles to both sides in turn, so that each span has hinged ends.
    """
    if robot.is_embedded:  # the body holds them everywhere
        return []
    tendons, out, unknown = robot.tendons, [], []
    spacing = np.diff(robot.disks.station_m, prepend=0.0)
    kinds = [t.kind for segment in robot.segments for t in segment.tendon_list]
    for i in np.flatnonzero(tensions < 0.0).tolist():
        longest = float(spacing[: tendons.end_disk[i] + 1].max())
        euler = np.pi**2 * float(tendons.bending_stiffness_Nm2[i]) / longest**2
        if kinds[i] == "rod" and np.isnan(euler):
            unknown.append(str(i + 1))
        elif -tensions[i] > euler:
            out.append(
                f"rod {i + 1} carries {significant(-float(tensions[i]))} N of compression and "
                f"buckles between two disks {in_mm(longest)} apart at {significant(euler)} N "
                "(Euler's load of hinged ends): take a stiffer rod or more disks."
            )
    if unknown:
        many = len(unknown) > 1
        out.append(
            f"rod{'s' * many} {listed(unknown)} {'are' if many else 'is'} under compression, and "
            f"whether {'they buckle' if many else 'it buckles'} between two disks is not checked: "
            "give bending_stiffness."
        )
    return out


def below_base(robot: Robot, disk_positions: Floats) -> list[str]:
    """Sentence without a full stop if a disk (N, 3) is below the base, else an empty list."""
    z = disk_positions[:, 2]
    if not (z < -_NOTHING * robot.length).any():
        return []
    return [f"{_lowest(z)}, behind the plane in which the robot is mounted"]


def of_sweep(
    robot: Robot, tension: Floats, disk_positions: Floats, surface: Floats
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Warnings of a sweep, and utilisation of the limits of the robot file.

    Parameters
    ----------
    robot : Robot
    tension : ndarray (n,)
        Increasing tensions in N.
    disk_positions : ndarray (n, N, 3)
        Positions of the disks in m; NaN where a load has no equilibrium.
    surface : ndarray (2, n, S)
        Largest von Mises stress in Pa and strain; NaN where unknown.

    Returns
    -------
    warnings, uses : tuple of str
        Sentences.
    """
    several = len(robot.segments) > 1
    warnings, uses = [], []

    def where(beyond: Bools) -> str:
        first = significant(float(tension[np.argmax(beyond)]))
        rest = beyond[np.argmax(beyond) :]
        return f"From {first} N on" if rest.all() else f"At some loads from {first} N on"

    depth = np.min(disk_positions[:, :, 2], axis=1)
    below = np.nan_to_num(depth) < -_NOTHING * robot.length
    if below.any():
        deepest = int(np.nanargmin(depth))
        warnings.append(
            f"{where(below)} the robot reaches behind the plane of the base: at "
            f"{significant(float(tension[deepest]))} N {_lowest(disk_positions[deepest, :, 2])}. "
            "Give a smaller largest tension if something is there."
        )
    known = np.flatnonzero(np.isfinite(surface).any(axis=(0, 2)))
    each = {int(i): utilisations(robot, surface[0, i], surface[1, i]) for i in known}
    for what, k in dict.fromkeys((u.what, u.segment) for some in each.values() for u in some):
        mine = {i: u for i, some in each.items() for u in some if (u.what, u.segment) == (what, k)}
        worst = max(mine, key=lambda i: mine[i].share)
        of = f" of segment {k}" * several
        largest = f"{mine[worst]} at {significant(float(tension[worst]))} N"
        beyond = np.array([i in mine and mine[i].share > 1.0 for i in range(len(tension))])
        if beyond.any():
            warnings.append(
                f"{where(beyond)} the backbone{of} exceeds its limit: {largest}; "
                "statics stays linearly elastic there. Lower the largest tension."
            )
        uses.append((-mine[worst].share, f"Largest on the backbone{of}: {largest}."))
    return tuple(warnings), tuple(text for _, text in sorted(uses))


def _lowest(z: Floats) -> str:
    """Name and position of the lowest disk."""
    i, last = int(np.argmin(z)), len(z) - 1
    name = "the tip" if i == last else f"disk {i + 1}"
    return (
        f"{name} is {in_mm(-float(z[i]))} below the base (z = {significant(float(z[i]) * 1e3)} mm)"
    )


def _stress(value: float) -> str:
    return number_with_unit(float(significant(value)), "Pa")
