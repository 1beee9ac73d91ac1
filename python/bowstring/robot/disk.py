"""Mass and inertia of a spacer disk from its density: a cylinder without bore and holes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from bowstring.aliases import Floats

_SAME_HOLE = 1e-9  # distance of equal holes as a share of the distance from the axis


class DiskMass(NamedTuple):
    """Mass in kg, moments of inertia about a diameter and about the axis in kg m^2, each (...).

    All refer to the centre of the disk. `across` is the mean over all diameters; with a ring of
    three or more equal holes they are equal.
    """

    mass: Floats
    across: Floats
    axial: Floats


def stacked(values: Sequence[ArrayLike]) -> Floats:
    """Stack numbers, or arrays of the numbers of many robots, along a new last axis."""
    arrays = [np.asarray(value, dtype=float) for value in values]
    if not any(array.ndim for array in arrays):
        return np.array(arrays, dtype=float)
    return np.stack(np.broadcast_arrays(*arrays), axis=-1)


def distinct_holes(places: ArrayLike) -> Floats:
    """Remove duplicates from hole positions.

    Parameters
    ----------
    places : array_like (..., T, 2)
        x and y of the holes of all tendons, in any unit; tendons may share a hole. Of many robots,
        the first one decides which do.

    Returns
    -------
    ndarray (..., H, 2)
        Positions in the order of the first tendon of each hole.
    """
    rows = np.asarray(places, dtype=float)
    if rows.size == 0:
        return rows.reshape(0, 2)
    first = rows.reshape(-1, *rows.shape[-2:])[0]
    found: list[int] = []
    for i, place in enumerate(first):
        apart = np.hypot(*(first[found] - place).T)
        if not np.any(apart <= _SAME_HOLE * math.hypot(*place)):
            found.append(i)
    return rows[..., found, :]


def outside_bore(holes: ArrayLike, bore: ArrayLike) -> Floats:
    """Holes (..., H, 2) of those outside the bore of a disk: tendons in a tube need none.

    Of many robots, the first one decides which are. Arguments are those of `drilled_disk`.
    """
    rows = np.asarray(holes, dtype=float)
    if rows.size == 0:
        return rows
    first = rows.reshape(-1, *rows.shape[-2:])[0]
    return rows[..., 2.0 * np.hypot(*first.T) > np.asarray(bore).flat[0], :]


def room_for_holes(
    holes: ArrayLike, radius: float, bore: float, inner: float = 0.0
) -> tuple[float, str]:
    """Largest hole diameter before holes meet the rim, the bore or each other.

    Parameters
    ----------
    holes : array_like (H, 2)
        Distinct positions x, y in m.
    radius, bore : float
        Radius of the disk and diameter of its bore, in m.
    inner : float
        Inner diameter of the tube in the bore, for tendons within it, in m.

    Returns
    -------
    float, str
        Diameter in m, and the fault of wider holes, for a message.
    """
    places = np.asarray(holes, dtype=float).reshape(-1, 2)
    away = np.hypot(places[:, 0], places[:, 1])
    outside, within = away[2.0 * away > bore], away[2.0 * away <= bore]
    found = []
    if outside.size:
        found += [
            (2.0 * (radius - float(outside.max())), "they would break out of its rim"),
            (2.0 * float(outside.min()) - bore, "they would meet the hole of the backbone"),
        ]
    if within.size:
        found.append((inner - 2.0 * float(within.max()), "they would meet the wall of the tube"))
    if len(places) > 1:
        between = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
        np.fill_diagonal(between, np.inf)
        found.append((float(between.min()), "they would meet each other"))
    return min(found)


def drilled_disk(
    density: float | Floats,
    radius: float | Floats,
    thickness: float | Floats,
    bore: float | Floats,
    holes: ArrayLike,
    hole_diameter: float | Floats,
) -> DiskMass:
    """Mass and inertia of a disk with a bore in the middle and round holes, all through.

    Parameters
    ----------
    density : array_like (...)
        Density in kg/m^3.
    radius, thickness : array_like (...)
        Radius and thickness of the disk in m.
    bore, hole_diameter : array_like (...)
        Diameters of the bore and of the tendons' holes in m.
    holes : array_like (..., H, 2)
        x and y of the holes, in m.

    Returns
    -------
    DiskMass

    Notes
    -----
    A cylinder of mass m, radius r and height t, its axis parallel to that of the disk and d from
    it, has ``m (3 r^2 + t^2) / 12 + m d^2 / 2`` about a diameter of the disk (mean over all) and
    ``m r^2 / 2 + m d^2`` about its axis (Steiner). The holes are such cylinders, taken away.
    """
    places = np.asarray(holes, dtype=float)
    if places.size == 0:
        places = places.reshape(0, 2)
    count = places.shape[-2]
    radii = stacked([radius, 0.5 * bore, *[0.5 * hole_diameter] * count])
    off = np.concatenate([np.zeros((*places.shape[:-2], 2)), (places**2).sum(axis=-1)], axis=-1)
    sign = np.array([1.0, -1.0, *np.full(count, -1.0)])
    tall, heavy = np.asarray(thickness)[..., None], np.asarray(density)[..., None]
    mass = sign * heavy * math.pi * radii**2 * tall
    return DiskMass(
        mass=mass.sum(axis=-1),
        across=(mass * ((3.0 * radii**2 + tall**2) / 12.0 + off / 2.0)).sum(axis=-1),
        axial=(mass * (radii**2 / 2.0 + off)).sum(axis=-1),
    )
