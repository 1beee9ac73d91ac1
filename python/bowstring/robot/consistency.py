"""Checks between the fields of a robot."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.robot.disk import distinct_holes, outside_bore, room_for_holes, stacked
from bowstring.robot.parts import (
    MAX_DISKS,
    MAX_HOLES,
    MAX_TENDONS,
    Backbone,
    Segment,
    Tendon,
    TendonRing,
    tendon_field,
)
from bowstring.units import number_with_unit


def problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Yield "path: sentence" for each inconsistency between fields."""
    for k, s in enumerate(parts):
        here = f"segments[{k}]"
        yield from _bore_problems(s.backbone, here)
        if s.disks.positions is not None:
            yield from _position_problems(s, here)
    disks = sum(s.disks.count or len(s.disks.positions or ()) for s in parts)
    rings = (s.tendons for s in parts)
    tendons = sum(t.count if isinstance(t, TendonRing) else len(t) for t in rings)
    for what, count, most in (("disks", disks, MAX_DISKS), ("tendons", tendons, MAX_TENDONS)):
        if count > most:
            yield f"segments: got {count} {what} in all; must be at most {most}"
            return
    if disks * tendons > MAX_HOLES:
        yield (
            f"segments: got {disks} disks and {tendons} tendons in all; disks times tendons must "
            f"be at most {MAX_HOLES}"
        )
        return
    if len({s.tendons_in for s in parts}) > 1:
        k = next(k for k, s in enumerate(parts) if s.tendons_in != parts[0].tendons_in)
        yield (
            f"segments[{k}].tendons_in: got {parts[k].tendons_in} after {parts[0].tendons_in}; all "
            "segments must have the same"
        )
    for k, s in enumerate(parts):
        for i, tendon in enumerate(s.tendon_list if s.tendons_in == "body" else ()):
            if tendon.friction:
                where = tendon_field(k, s.tendons, i, "friction")
                yield f"{where}: got {tendon.friction:g}; must be 0 with tendons_in body"
                break
    yield from _hole_problems(parts)
    yield from _drill_problems(parts)
    yield from _clamp_problems(parts)
    yield from _hole_length_problems(parts)


def _bore_problems(backbone: Backbone, here: str) -> Iterator[str]:
    """Check that the bore of a tube is smaller than the tube, at both ends of the segment."""
    for name, place in (("inner_diameter", 0.0), ("end_inner_diameter", 1.0)):
        section = backbone.at(place)
        if section.diameter is not None and section.inner_diameter >= section.diameter:
            yield (
                f"{here}.backbone.{name}: "
                f"got {number_with_unit(section.inner_diameter, 'm')}; must be smaller than "
                f"the diameter{' there' if place else ''}, "
                f"{number_with_unit(section.diameter, 'm')}"
            )
            return


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
    """Check each tendon's hole against disks and backbones of its own and all inner segments."""
    for k, s in enumerate(parts):
        problem = _routing_problem(parts, k)
        if problem:
            yield problem
            continue
        winding = _winding_problem(parts, k)
        if winding:
            yield winding
            continue
        for i, tendon in enumerate(s.tendon_list):
            fault = next(_hole_faults(parts, k, tendon), None)
            if fault is None:
                continue
            r, name, text = fault
            where = tendon_field(k, s.tendons, i, name)
            yield f"{where}: got {number_with_unit(r, 'm')}, a hole {text}"
            if isinstance(s.tendons, TendonRing):
                break


def _hole_faults(
    parts: tuple[Segment, ...], k: int, tendon: Tendon
) -> Iterator[tuple[float, str, str]]:
    """Distance from the axis (m), field and fault of holes of a tendon of segment k."""
    name = "pitch_radius"
    if not tendon.is_parallel:
        name = "end_pitch_radius" if tendon.end_pitch_radius is not None else name
        name = "pitch_radii" if tendon.pitch_radii is not None else name
    for j, (holes, fraction) in enumerate(_routes(parts, k, tendon)):
        s, away = parts[j], np.hypot(*holes.T)
        if away.max() * (1.0 + 1e-12) >= s.disks.radius:
            whose = "its disk" if j == k else f"the disks of segments[{j}], which it passes"
            limit = number_with_unit(s.disks.radius, "m")
            fault = f"outside {whose}; must be smaller than the disk's radius, {limit}"
            yield float(away.max()), name, fault
        elif s.tendons_in == "disks":
            rod = s.backbone
            if away.min() > rod.outer_diameter:
                continue  # clear of the circle around any section
            solid = rod.encloses(holes, fraction) & ~rod.in_bore(holes, fraction)
            inside = np.flatnonzero(solid)
            if inside.size:
                which = "its backbone" if j == k else f"the backbone of segments[{j}]"
                at = rod.at(float(fraction[inside[0]]))
                soft = "; chambers in a soft body need tendons_in: body"
                rule = _clear_of(at) + (soft if tendon.kind == "chamber" else "")
                yield float(away[inside[0]]), name, f"inside {which}; must be {rule}"


def _clear_of(section: Backbone) -> str:
    """Where the holes of disks may be about a section of the backbone, as the end of a sentence."""
    if section.width is not None and section.height is not None:
        sides = (number_with_unit(side, "m") for side in (section.width, section.height))
        return "beside its section, {} by {}".format(*sides)
    radius = number_with_unit(section.outer_diameter / 2, "m")
    beside = f"larger than the backbone's radius, {radius}"
    if not section.inner_diameter:
        return beside
    bore = number_with_unit(section.inner_diameter / 2, "m")
    return f"{beside}, or smaller than that of its bore, {bore}"


def _routes(parts: tuple[Segment, ...], k: int, tendon: Tendon) -> Iterator[tuple[Floats, Floats]]:
    """Holes (n, 2) of a tendon of segment k and where they are in their segment, from 0 to 1.

    By segments from the base, each with the hole where it begins.
    """
    if tendon.is_parallel:
        for s in parts[: k + 1]:
            ends = [0.0, 1.0]
            if s.backbone.is_tapered:
                ends = [0.0, *(p / s.length for p in s.disk_positions)]
            yield np.array([tendon.base_hole] * len(ends)), np.array(ends)
        return
    stations = _stations(parts, k)
    holes = tendon.holes(np.concatenate(stations))
    start, before = 0.0, 0
    for s, station in zip(parts, stations, strict=False):
        planes = np.array([start, *station])
        yield holes[before : before + len(planes)], (planes - start) / s.length
        start, before = float(station[-1]), before + len(station)


def _stations(parts: tuple[Segment, ...], k: int) -> list[Floats]:
    """Arc lengths of the disks from the base to the end disk of segment k, by segments, m."""
    starts = np.cumsum([0.0, *(s.length for s in parts[:k])])
    return [np.array(s.disk_positions) + at for s, at in zip(parts[: k + 1], starts, strict=True)]


def _routing_problem(parts: tuple[Segment, ...], k: int) -> str:
    """Check the number of angles and pitch radii that are given for each disk."""
    s = parts[k]
    count = sum(s.disks.count or len(s.disks.positions or ()) for s in parts[: k + 1])
    for i, tendon in enumerate(s.tendon_list):
        for name in ("angles", "pitch_radii"):
            values = getattr(tendon, name)
            if values is not None and len(values) != count:
                return (
                    f"{tendon_field(k, s.tendons, i, name)}: got {len(values)} numbers; must have "
                    f"{count}, one for each disk from the first to its end disk"
                )
    return ""


def _winding_problem(parts: tuple[Segment, ...], k: int) -> str:
    """Check that tendons do not wind too fast for the places where they are held."""
    s = parts[k]
    if all(tendon.is_parallel for tendon in s.tendon_list):
        return ""
    station = np.concatenate(_stations(parts, k))
    if np.any(np.diff(station, prepend=0.0) <= 0):
        return ""  # reported with the positions
    body = s.tendons_in == "body"
    most, what = (0.05, "modules of the body") if body else (0.5, "disks")
    for i, tendon in enumerate(s.tendon_list):
        if tendon.is_parallel:
            continue
        fastest = abs(tendon.turns) * np.diff(station, prepend=0.0).max() / station[-1]
        if fastest > most * (1.0 + 1e-9):
            return (
                f"{tendon_field(k, s.tendons, i, 'turns')}: got {tendon.turns:g}, which is "
                f"{fastest:.3g} of a turn between two {what}; must be at most {most:g} there: "
                "write fewer turns, or a larger disks.count"
            )
        if body:
            continue
        disk = 0
        for part, (hole, fraction) in zip(parts, _routes(parts, k, tendon), strict=False):
            through = np.flatnonzero(_crossings(part, hole, fraction))
            if through.size:
                name = "turns" if tendon.turns else "angles"
                return (
                    f"{tendon_field(k, s.tendons, i, name)}: the tendon passes through the "
                    f"backbone on the way to disk {disk + through[0] + 1}; write fewer turns, or "
                    "more disks"
                )
            disk += len(hole) - 1
    return ""


def _crossings(s: Segment, hole: Floats, fraction: Floats) -> Bools:
    """Which spans between holes (n, 2) on the outside of a backbone pass through it."""
    along = np.diff(hole, axis=0)
    square = np.maximum((along**2).sum(axis=1), 1e-300)
    nearest = np.clip(-(hole[:-1] * along).sum(axis=1) / square, 0.0, 1.0)
    share = nearest[:, None, None]
    if not s.backbone.is_round:  # the point nearest to the axis may be beside a rectangle
        within = np.broadcast_to(np.linspace(0.0, 1.0, 34)[1:-1], (len(along), 32))
        share = np.column_stack([nearest, within])[..., None]
    points = hole[:-1, None] + share * along[:, None]
    at = fraction[:-1, None] + share[..., 0] * np.diff(fraction)[:, None]
    outside = ~s.backbone.encloses(hole, fraction)
    through = s.backbone.encloses(points, at).any(axis=1)
    return np.asarray(outside[:-1] & outside[1:] & through)


def bores(parts: tuple[Segment, ...]) -> Floats:
    """Diameter of the hole for the backbone in the disks of each segment, m."""
    return stacked([s.backbone.outer_diameter for s in parts])


def _drill_problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Check that holes lie within their disk, do not overlap, and are wider than their tendons."""
    for k, s in enumerate(parts):
        width, radius = s.disks.hole_diameter, s.disks.radius
        if width is None:
            continue
        passing = [
            (j, i, t) for j in range(k, len(parts)) for i, t in enumerate(parts[j].tendon_list)
        ]
        for j, i, tendon in passing:
            if tendon.diameter is not None and tendon.diameter >= width:
                where = tendon_field(j, parts[j].tendons, i, "diameter")
                yield (
                    f"{where}: got {number_with_unit(tendon.diameter, 'm')}; must be smaller than "
                    f"the holes that it passes, segments[{k}].disks.hole_diameter = "
                    f"{number_with_unit(width, 'm')}"
                )
                break
        if not passing:
            continue
        # a rectangle leaves more of the disk than the circle around it
        rods = [p.backbone for p in parts[k : k + 2]]
        rod = max(0.0 if r.width is not None else float(r.outer_diameter) for r in rods)
        for places in _places(parts, k, [(j, t) for j, _, t in passing]):
            holes = distinct_holes(places)
            drilled = outside_bore(holes, rod)
            slot = float(bores(parts[k : k + 2]).max())
            if (
                s.disks.density is not None
                and rod < slot
                and len(outside_bore(holes, slot)) < len(holes)
            ):
                yield (
                    f"segments[{k}].disks.density: the disks' hole for a rectangular backbone is "
                    f"taken as the circle around it, {number_with_unit(slot, 'm')}, which here "
                    "contains holes of tendons; write mass in its place"
                )
                break
            if not len(drilled) or not np.all(np.hypot(*drilled.T) < radius):
                break  # in the bore, or reported with the holes
            limit, fault = room_for_holes(drilled, radius, rod)
            if width >= limit:
                yield (
                    f"segments[{k}].disks.hole_diameter: got {number_with_unit(width, 'm')}; the "
                    f"disk does not hold such holes, {fault}; must be smaller than "
                    f"{number_with_unit(limit, 'm')}"
                )
                break


def _places(
    parts: tuple[Segment, ...], k: int, passing: list[tuple[int, Tendon]]
) -> Iterator[Floats]:
    """Holes (T, 2) in the disks of segment k; a single entry if all disks have the same."""
    if all(t.is_parallel for _, t in passing):
        yield np.array([t.base_hole for _, t in passing])
        return
    if any(_routing_problem(parts, j) for j in {j for j, _ in passing}):
        return  # reported with the holes
    before = sum(len(each) for each in _stations(parts, k)[:-1])
    routes = [t.holes(np.concatenate(_stations(parts, j))) for j, t in passing]
    for i in range(len(parts[k].disk_positions)):
        yield np.array([route[before + i + 1] for route in routes])


def _hole_length_problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Check that each tendon is free between the holes of neighbouring disks."""
    before = 0.0
    for k, s in enumerate(parts):
        own = s.disks.hole_length
        if np.any(own) and s.tendons_in == "body":
            yield (
                f"segments[{k}].disks.hole_length: got {number_with_unit(own, 'm')}; must be 0 "
                "with tendons_in body"
            )
            return
        spacing = np.diff((0.0, *s.disk_positions))
        if np.any(spacing <= 0):
            return  # reported with the positions
        held = np.concatenate(([before], np.full(len(spacing) - 1, own / 2))) + own / 2
        before = own / 2
        if np.any(spacing <= held * (1 + 1e-9)):
            i = int(np.argmax(spacing <= held * (1 + 1e-9)))
            yield (
                f"segments[{k}].disks.hole_length: got {number_with_unit(own, 'm')}; the holes "
                f"leave no tendon free in the {number_with_unit(float(spacing[i]), 'm')} before "
                f"disk {i + 1}"
            )
            return


def _clamp_problems(parts: tuple[Segment, ...]) -> Iterator[str]:
    """Check that each module has flexible backbone between the clamped lengths of its disks."""
    before = 0.0  # clamped length at the start of a segment; the base clamps none
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
        if start[i] > half[i]:  # the end disk of the previous segment clamps more of it
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
