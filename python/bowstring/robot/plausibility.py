"""Plausibility checks: valid numbers of a robot that are probably mistakes."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats
from bowstring.units import number_with_unit, rounded

if TYPE_CHECKING:
    from bowstring.robot.arrays import RobotArrays
    from bowstring.robot.parts import Backbone

_STANDARD_GRAVITY: Final = 9.80665  # m/s^2

# Plausible ranges. A wrong unit is mostly wrong by 1000, so each range covers all robots that we
# know of and is much narrower than 1000.
#
# Stiffness: a tension of the robot's own weight W on one tendon bends a segment by
# theta = W r L / (E I) (theory Eq. 1.7). W scales with the robot, so one limit serves a
# catheter and an elephant trunk: 2 degrees for the study's robot, 5 for rao2021, 0.4 rad for a
# Nitinol catheter (0.4 mm by 1 m), 1.7 rad for 1 mm Nitinol under ten disks of 10 g at r = 10 mm,
# 2.4 rad for silicone of 0.1 MPa. Beyond one turn the robot cannot hold its own weight in any
# useful pose; the E = 35 MPa that the study prints gives 5.5 turns.
_MAX_TURNS: Final = 1.0
# Conversely, 1 kN, more than tendons of such robots carry, must bend it by a degree.
_LARGE_TENSION: Final = 1000.0
_MIN_BEND: Final = math.radians(1.0)
_SLENDERNESS: Final = (5.0, 5000.0)  # length/diameter; 60 to 143 for the built-in robots
_DENSITY: Final = (100.0, 25_000.0)  # kg/m^3: light foam to osmium
_DISK_DENSITY: Final = (20.0, 25_000.0)  # of the full disk; holes and cut-outs make it lighter
# Largest total disk thickness, as a share of the length, for which clamped_length may be missing:
# the bend is wrong by that share, and the tip by about half of it in lengths.
_MAX_UNSTATED_CLAMP: Final = 0.02
_MAX_E: Final = 1.3e12  # Pa: diamond
_MAX_GRAVITY: Final = 30.0  # m/s^2: a little more than on Jupiter
_MAX_SAG: Final = 5.0  # deflection of the tip over the length, by the weight of a payload


def implausible(robot: RobotArrays) -> Iterator[str]:
    """Yield a warning for each implausible number of a robot."""
    disks, weight = robot.disks, _weight(robot)
    for k, s in enumerate(robot.segments):
        here = f"segments[{k}]"
        if s.backbone.E is not None and np.any(robot.tendons.segment >= k):
            yield from _implausible_stiffness(robot, k, weight)

        thick = s.backbone.outer_diameter
        slenderness = s.length / thick if thick else _SLENDERNESS[0]
        soft = s.tendons_in == "body"  # soft bodies are thick
        if not soft and not _SLENDERNESS[0] <= slenderness <= _SLENDERNESS[1]:
            kind = "too thick for a rod" if slenderness < _SLENDERNESS[0] else "thinner than a hair"
            yield (
                f"{here}.length = {number_with_unit(s.length, 'm')} with backbone."
                f"{_size(s.backbone)}: length/diameter = "
                f"{rounded(slenderness)} is {kind}; is one of the two in the wrong unit (m, mm)?"
            )
        for part, density, (low, high), material in (
            ("backbone", s.backbone.density, _DENSITY, "backbone material"),
            ("disks", s.disks.density, _DISK_DENSITY, "material"),
        ):
            if density and not low <= density <= high:
                yield (
                    f"{here}.{part}.density = {rounded(density, 4)} kg/m^3: no {material} has it; "
                    "is it in the wrong unit (kg/m^3, g/cm^3)?"
                )
        volume = math.pi * s.disks.radius**2 * s.disks.thickness
        if s.disks.mass and volume:
            mean = s.disks.mass / volume
            if not _DISK_DENSITY[0] <= mean <= _DISK_DENSITY[1]:
                unit = "g" if mean > _DISK_DENSITY[1] else "kg"
                yield (
                    f"{here}.disks.mass = {number_with_unit(s.disks.mass, 'kg')}: a disk of this "
                    f"radius and thickness would have a density of {rounded(mean)} kg/m^3; "
                    f"is the mass in {unit}?"
                )
        if "clamped_length" not in s.disks.model_fields_set:
            held = len(s.disk_positions) * s.disks.thickness / s.length
            if held >= _MAX_UNSTATED_CLAMP:
                yield (
                    f"{here}.disks.clamped_length: missing, so that no disk stiffens the backbone; "
                    f"disks that hold it over their thickness of "
                    f"{number_with_unit(s.disks.thickness, 'm')} would clamp {rounded(100 * held)} "
                    "% of it, and the robot would bend less by about as much: give the length that "
                    "a disk holds, 0 mm if none"
                )
        if s.backbone.G is not None:
            nu = s.backbone.young / (2 * s.backbone.G) - 1
            if not -1 < nu <= 0.5:
                yield (
                    f"{here}.backbone.G = {number_with_unit(s.backbone.G, 'Pa')} with E = "
                    f"{number_with_unit(s.backbone.young, 'Pa')} makes nu = {rounded(nu)}, which "
                    "no isotropic material has; is one of the two in the wrong unit (MPa, GPa)?"
                )
    spacing = np.diff(disks.station_m, prepend=0.0)
    before = np.concatenate(([0.0], disks.thickness_m[:-1]))
    overlap = np.flatnonzero((before + disks.thickness_m) / 2 > spacing * (1 + 1e-9))
    if overlap.size:
        i = int(overlap[0])
        yield (
            f"segments[{disks.segment[i]}].disks.thickness = "
            f"{number_with_unit(float(disks.thickness_m[i]), 'm')}: the disks overlap, they are "
            f"{number_with_unit(float(spacing[i]), 'm')} apart"
        )
    size = math.hypot(*robot.gravity)
    if size > _MAX_GRAVITY:
        yield (
            f"gravity = {rounded(size, 4)} m/s^2 in size: more than on any planet; is it in mm/s^2?"
        )
    yield from _implausible_payloads(robot)
    yield from _buckling(robot)


def _implausible_payloads(robot: RobotArrays) -> Iterator[str]:
    softest = float(robot.bending_stiffness.min())
    for i, payload in enumerate(robot.payloads):
        away = math.hypot(*payload.centre)
        if away > robot.length:
            yield (
                f"payloads[{i}].centre is {number_with_unit(away, 'm')} from its disk, farther "
                f"than the robot is long, {number_with_unit(robot.length, 'm')}; is the unit right "
                "(mm, m)?"
            )
        sag = payload.mass * _STANDARD_GRAVITY * robot.length**2 / (3.0 * softest)
        if sag > _MAX_SAG:
            yield (
                f"payloads[{i}].mass = {number_with_unit(payload.mass, 'kg')}: by linear theory "
                f"its weight moves the tip by {rounded(sag)} lengths of the robot; is the unit "
                "right (g, kg)?"
            )


def _size(backbone: Backbone) -> str:
    """Size of the section at the segment's start, as its fields give it."""
    sizes = {name: getattr(backbone, name) for name in ("diameter", "width", "height")}
    given = [f"{name} = {number_with_unit(v, 'm')}" for name, v in sizes.items() if v is not None]
    return ", ".join(given)


def _weight(robot: RobotArrays) -> float:
    """Weight of disks and backbone in N under standard gravity, not that of the file."""
    lengths = np.array([s.length for s in robot.segments])
    mass = robot.disks.mass_kg.sum() + robot.mass_per_length @ lengths
    return float(mass) * _STANDARD_GRAVITY


def _turns(robot: RobotArrays, k: int, weight: float) -> float:
    """Turns of a segment if one tendon has the robot's weight as tension (linear law)."""
    return weight * _bend_by_newton(robot, k) / math.tau


def _bend_by_newton(robot: RobotArrays, k: int) -> float:
    """Bend angle of a segment per newton of tension in rad/N, theory Eq. 1.7."""
    passing = robot.tendons.segment >= k
    holes = robot.tendons.mean_hole_m[k, passing]
    arm = float(np.hypot(*holes.T).max())
    return arm * robot.segments[k].length / float(robot.bending_stiffness[k])


def _implausible_stiffness(robot: RobotArrays, k: int, weight: float) -> Iterator[str]:
    s = robot.segments[k]
    where = f"segments[{k}].backbone.E = {number_with_unit(s.backbone.young, 'Pa')}"
    diameter = _size(s.backbone)
    turns = _turns(robot, k, weight)
    if s.backbone.young > _MAX_E:
        yield f"{where}: stiffer than diamond; is the unit right (MPa, GPa)?"
    elif turns > _MAX_TURNS:
        stiffer = 1000 * s.backbone.young
        guess = f"is the unit right (MPa, GPa), and {diameter}?"
        if turns / 1000 <= _MAX_TURNS and stiffer <= _MAX_E:
            meant = number_with_unit(stiffer, "Pa")
            bend = 360.0 * turns / 1000
            guess = f"with {meant} it would bend it by {rounded(bend)} degrees: is {meant} meant?"
        yield (
            f"{where} looks wrong: the robot's own weight ({rounded(weight)} N) as the tension of "
            f"one tendon would wind the backbone {rounded(turns)} times around; {guess}"
        )
    elif 0.0 < _LARGE_TENSION * _bend_by_newton(robot, k) < _MIN_BEND:
        yield (
            f"{where} with {diameter} looks wrong: 1 kN on one tendon would bend the segment by "
            f"less than a degree; is one of the two in the wrong unit (GPa, MPa; mm, cm)?"
        )


#: Bend angle of the linear law above which a load without equilibrium gets a hint, rad.
_MUCH_BEND: Final = math.pi


def load_advice(robot: RobotArrays, tensions: ArrayLike, tip_force: ArrayLike = (0, 0, 0)) -> str:
    """Hint at the probable cause where a load has no equilibrium.

    Parameters
    ----------
    robot : Robot
    tensions : array_like (T,)
        Tensions in N; NaN for displacement-controlled tendons.
    tip_force : array_like (3,)
        Force on the tip in N.

    Returns
    -------
    str
        A sentence, ending in a space, on a Young's modulus in a wrong unit or else on a large bend
        by the linear law; empty if both are plausible.
    """
    weight = _weight(robot)
    for k in range(int(robot.tendons.segment.max(initial=-1)) + 1):
        young = robot.segments[k].backbone.E
        if young is None or 1000 * young > _MAX_E:
            continue  # no wrong unit
        if _turns(robot, k, weight) > _MAX_TURNS:
            modulus = number_with_unit(young, "Pa")
            return (
                f"Check Young's modulus: segments[{k}].backbone.E = {modulus} looks too small "
                "(GPa, not MPa?). "
            )
    tension = np.nan_to_num(np.asarray(tensions, dtype=float))
    sideways = float(np.hypot(*np.asarray(tip_force, dtype=float)[:2]))
    total, by_force, beyond = np.zeros(2), 0.0, robot.length
    for k, s in enumerate(robot.segments):
        passing = robot.tendons.segment >= k
        law = s.length / float(robot.bending_stiffness[k])
        total += law * tension[passing] @ robot.tendons.mean_hole_m[k, passing]
        by_force += law * sideways * (beyond - s.length / 2)  # rotation of a cantilever
        beyond -= s.length
    by_tension = float(np.hypot(*total))
    bend, what = max((by_tension, "these tensions"), (by_force, "this force at the tip"))
    if bend <= _MUCH_BEND:
        return ""
    angle = rounded(math.degrees(bend), 2 if bend > 100 else 3)
    return f"By the linear law {what} would bend {robot.name} by {angle} degrees. "


def _buckling(robot: RobotArrays) -> Iterator[str]:
    """Warn if the backbone buckles under its own weight, in the gravity of the file.

    Rayleigh's quotient with the slope sin(pi s / 2 L) of a buckled column: elastic energy over the
    work of all weights. For a uniform column it gives a critical q L^3 / (E I) of 8.30 (exact:
    7.837), which suffices for a warning; it includes disks and segments.
    """
    pressing = -robot.gravity[2]  # weight towards the base at z = 0 compresses the backbone
    if pressing <= 0:
        return
    length, disks = robot.length, robot.disks
    wave = math.pi / (2 * length)

    def sunk(s: Floats) -> Floats:  # how far the point s sinks, per amplitude squared / 2
        return s / 2 - np.sin(2 * wave * s) / (4 * wave)

    work = float((disks.mass_kg + robot.carried_kg) @ sunk(disks.station_m))
    for disk, mass, _, _, beyond, *_ in robot.payload_numbers:  # farther as the disk tilts
        work += mass * beyond * np.sin(wave * disks.station_m[int(disk)]) ** 2
    energy, start = 0.0, 0.0
    for k, segment in enumerate(robot.segments):
        ends = np.array([start, start + segment.length])
        cosine = float(np.diff(ends / 2 + np.sin(2 * wave * ends) / (4 * wave))[0])
        energy += float(robot.bending_stiffness[k]) * wave**2 * cosine
        points = ends[0] + segment.length * (np.arange(64) + 0.5) / 64
        work += float(robot.mass_per_length[k]) * segment.length * float(sunk(points).mean())
        start += segment.length
    ratio = pressing * work / energy
    if ratio > 1:
        k = int(np.argmin(robot.bending_stiffness))
        s = robot.segments[k]
        mass = float(disks.mass_kg[disks.segment == k][0])
        payload = float(robot.carried_kg.sum())
        if s.backbone.stiffness is not None:
            yield (
                f"segments[{k}].backbone.stiffness: the upright backbone buckles under its own "
                f"weight, {rounded(ratio)} times what it can carry; check the units of stiffness "
                "(N m^2, N m, N) and the sign of gravity"
            )
            return
        carried = f", payloads of {number_with_unit(payload, 'kg')}" if payload else ""
        yield (
            f"segments[{k}].backbone.E = {number_with_unit(s.backbone.young, 'Pa')}: the upright "
            f"backbone buckles under its own weight, {rounded(ratio)} times what it can carry; "
            "check the unit of E (MPa, GPa), "
            f"{_size(s.backbone)}, "
            f"disks.mass = {number_with_unit(mass, 'kg')}{carried} and the sign of gravity"
        )
