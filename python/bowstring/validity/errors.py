"""Errors of constant curvature for many robots along ramps of tension or of commanded bends."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.jobs import threads
from bowstring.robot.designs import Designs
from bowstring.statics.design_sweeps import sweep_designs
from bowstring.validity.effects import Rods
from bowstring.validity.limit_search import gave_up, solve_ramps

LAWS: Final = {
    "cc_from_lengths": "lengths",
    "cc_from_force": "linear",
    "cc_from_lengths_chord": "chords",
    "cc_from_force_arm": "arm",
}
"""Models of constant curvature by tension or length, by the name of their comparison in a study."""

LABELS: Final = {
    "cc_from_lengths": "from lengths",
    "cc_from_force": "from force",
    "cc_from_lengths_chord": "from lengths, chords",
    "cc_from_force_arm": "from force, mean arm",
    "cc_from_force_calibrated": "from force, E I calibrated",
    "cc_from_displacements": "from commanded displacements",
}
"""Labels of the models."""

INPUTS: Final = {
    "cc_from_lengths": "from tendon lengths",
    "cc_from_force": "from force (linear law)",
    "cc_from_lengths_chord": "from tendon lengths, chords",
    "cc_from_force_arm": "from force, mean lever arm",
    "cc_from_force_calibrated": "from force, stiffness calibrated",
    "cc_from_displacements": "from commanded displacements",
}
"""Input and correction of the models, for titles."""

_BALANCED: Final = 1e-9  # bend over the sum of the tendons' bends, below which it is rounding
_TAUT: Final = 1e-9  # slack length over the robot's length, below which it is rounding
_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0
_SCALES: Final = (0.3, 3.0)  # range of the calibrated stiffness over the given one
_ROUNDS: Final = 32  # rounds of the golden section: to 1e-6 of the interval


@short_repr
@dataclass(frozen=True)
class Ramps:
    """D robots, each along its own ramp of L tensions or bends, solved by statics."""

    ramp: Floats
    """Tensions of the sweep, N, or commanded bends, rad, (D, L)."""
    tensions: Floats
    """Tensions of all tendons (D, L, T), N."""
    converged: Bools
    """Whether each load has a stable equilibrium (D, L); see `limit_search.solve_ramps`."""
    tip: Floats
    """Tips (D, L, 3), m; NaN where not converged."""
    tendon_lengths: Floats
    """Tendon lengths (D, L, T), m."""
    tip_error: Floats
    """Estimated error of the tip by statics (D, L), m."""
    gave_up: Bools
    """Whether the solver gave up at each load (D, L), so that an equilibrium may exist."""
    commanded_lengths: Floats | None = None
    """Tendon lengths that the motors command (D, L, T), m; None by tension."""
    slack: Bools | None = None
    """Whether a tendon is slack at each load (D, L); None by tension."""


def follow(rods: Rods, ramp: Floats, shares: Floats) -> Ramps:
    """Solve robots along ramps, each load from the one before.

    Parameters
    ----------
    rods : Rods
    ramp : ndarray (D, L)
        Tensions of the sweep, N, or bends that constant curvature commands by displacements of all
        tendons, rad.
    shares : ndarray (T,)
        Share of the sweep's tension in each tendon; bends are in the direction of its moment.
    """
    if rods.by_displacement:
        return _follow_displacements(rods, ramp, shares)
    tensions = ramp[..., None] * shares
    return Ramps(ramp, tensions, *solve_ramps(rods, tensions))


def _follow_displacements(rods: Rods, bend: Floats, shares: Floats) -> Ramps:
    displacements = bend[..., None] * displacement_per_bend(rods.designs, shares)[:, None, :]
    arrays = rods.designs.arrays
    straight = np.atleast_2d(np.asarray(arrays.disks.station_m)[..., arrays.tendons.end_disk])
    longest = displacements.max(axis=1) >= straight
    if longest.any():
        tendon = int(np.flatnonzero(longest.any(axis=0))[0]) + 1
        raise InputError(
            f"axis bend: a bend of {math.degrees(bend.max()):.4g} deg shortens tendon {tendon} by "
            "more than its length; give smaller bends, or longer robots"
        )
    found = sweep_designs(
        rods.designs,
        displacements=displacements,
        load=rods.load,
        model=rods.model,
        threads=threads(),
    )
    loose = found.slack_lengths > _TAUT * rods.designs.length[:, None, None]
    return Ramps(
        bend,
        found.tensions,
        found.converged,
        found.tip_position,
        found.tendon_lengths,
        found.tip_error,
        gave_up(found.status),
        straight[:, None, :] - displacements,
        np.asarray(loose.any(axis=-1)),
    )


def displacement_per_bend(designs: Designs, shares: Floats) -> Floats:
    """Displacements (D, T) of all tendons per bend of the robot by constant curvature, m/rad.

    Parameters
    ----------
    designs : Designs
    shares : ndarray (T,)
        Share of each tendon in the moment that has the direction of the bend.

    Returns
    -------
    ndarray (D, T)
        Bends of the segments are in proportion to those by the linear law (theory Eq. 1.7), and
        their sum is the bend of the robot.

    Raises
    ------
    InputError
        If the tendons balance each other.
    """
    arrays = designs.arrays
    means = arrays.tendons.mean_hole_m
    means = np.broadcast_to(means, (len(designs), *means.shape[-3:]))
    bends, sizes = [], []
    for k in range(len(designs.robot.segments)):
        holes = means[:, k]
        radius = np.linalg.norm(holes, axis=-1)
        passing = arrays.tendons.segment >= k
        levers = holes - np.expand_dims(arrays.tension_centre_m[..., k, :], -2)
        moment = np.einsum("t,dtq->dq", shares * passing, levers)
        compliance = np.asarray(arrays.segments[k].length / arrays.bending_stiffness[..., k])
        by_moment = arrays.bend_by_moment[..., k, :, :]
        bends.append((moment[:, None] @ by_moment)[:, 0])
        sizes.append(radius @ np.abs(shares * passing) * compliance)
    whole = sum(np.linalg.norm(bend, axis=-1) for bend in bends)
    if not np.all(whole > _BALANCED * sum(sizes)):
        raise InputError(
            "the actuated tendons balance each other, so that no direction of bend follows; "
            "actuate other tendons",
            argument="tendon",
        )
    out = np.zeros(holes.shape[:2])
    for k, bend in enumerate(bends):
        passing = arrays.tendons.segment >= k
        out += passing * np.einsum("dtq,dq->dt", holes, bend / np.reshape(whole, (-1, 1)))
    return out


def arc_tips(designs: Designs, name: str, ramps: Ramps, scale: Floats | None = None) -> Floats:
    """Tips by a model of constant curvature (D, L, 3), m; NaN where it has no arc.

    Parameters
    ----------
    designs : Designs
        Robots as constant curvature knows them.
    name : str
        One of `LAWS`, or ``cc_from_displacements`` of a ramp of bends.
    ramps : Ramps
        Tensions, and tendon lengths of the rod.
    scale : ndarray (D,), optional
        Factor on the bending stiffness, for the linear law.

    Returns
    -------
    ndarray (D, L, 3)
    """
    if name == "cc_from_displacements":
        assert ramps.commanded_lengths is not None, "checked with the axes"
        commands, law = ramps.commanded_lengths, "lengths"
    else:
        law = LAWS[name]
        commands = ramps.tensions if name.startswith("cc_from_force") else ramps.tendon_lengths
    if scale is not None:
        commands = commands / scale[:, None, None]
    rows = np.ascontiguousarray(commands.reshape(-1, commands.shape[-1]))
    found = designs.robot.core.arc_tips(designs, law, rows)
    return np.asarray(found).reshape(*commands.shape[:2], 3)


def tip_offsets(designs: Designs, ramps: Ramps, names: Sequence[str]) -> dict[str, Floats]:
    """Tips by models of constant curvature less those by statics (D, L, 3), m.

    NaN without equilibrium or arc. ``cc_from_force_calibrated`` is the linear law with the bending
    stiffness of the least mean squared error over the ramp, for each robot.
    """
    return {
        name: _calibrated(designs, ramps)
        if name == "cc_from_force_calibrated"
        else arc_tips(designs, name, ramps) - ramps.tip
        for name in names
    }


def tip_errors(designs: Designs, ramps: Ramps, names: Sequence[str]) -> dict[str, Floats]:
    """Tip errors (D, L) of models of constant curvature, m: sizes of `tip_offsets`."""
    offsets = tip_offsets(designs, ramps, names)
    return {name: np.linalg.norm(offset, axis=-1) for name, offset in offsets.items()}


def _calibrated(designs: Designs, ramps: Ramps) -> Floats:
    """Golden-section search of the logarithm of the stiffness, all robots at once."""

    def offsets(log_scale: Floats) -> Floats:
        return arc_tips(designs, "cc_from_force", ramps, np.exp(log_scale)) - ramps.tip

    def mean(log_scale: Floats) -> Floats:
        squared = np.sum(offsets(log_scale) ** 2, axis=-1)
        return np.asarray(np.where(np.isfinite(squared), squared, 0.0).sum(axis=1))

    count = len(ramps.ramp)
    low, high = (np.full(count, np.log(end)) for end in _SCALES)
    a, b = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
    at_a, at_b = mean(a), mean(b)
    for _ in range(_ROUNDS):
        left = at_a < at_b
        high, low = np.where(left, b, high), np.where(left, low, a)
        a_next, b_next = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        new = np.where(left, a_next, b_next)
        at_new = mean(new)
        at_a, at_b = np.where(left, at_new, at_b), np.where(left, at_a, at_new)
        a, b = a_next, b_next
    return offsets(0.5 * (low + high))
