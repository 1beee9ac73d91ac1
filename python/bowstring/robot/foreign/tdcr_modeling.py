"""Robots of tdcr-modeling (Rao et al. 2021): MATLAB parameters, or C++ with setRobotParameters."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.errors import InputError
from bowstring.robot.draft import Draft, Field, quantity, tendon, vector
from bowstring.robot.foreign.values import Unreadable, Values, cpp, matlab, numbers

__all__ = ["draft_cpp", "draft_matlab"]

Floats = NDArray[np.float64]

_NOT_STATED: Final = {
    "thickness": Field("0 mm", assumed="disk thickness"),
    "clamped_length": Field("0 mm", assumed="clamped length"),
}
_CPP: Final = ("length", "youngs_modulus", "routing", "number_disks", "pradius_disks", "ro")


def draft_matlab(text: str, label: str) -> Draft:
    """Draft a robot from assignments to n, L, p_tendon, E, nu, ro, ri, g, m_bb and m_disk."""
    values = matlab(text)
    lengths, disks = (_numbers(values, name, label) for name in ("L", "n"))
    young, outer = (float(_numbers(values, name, label)[0]) for name in ("E", "ro"))
    inner = float(_optional(values, "ri", 0.0)[0])
    holes = _numbers(values, "p_tendon", label)
    if holes.size % 4:
        raise InputError(f"{label}: p_tendon: got {holes.size} numbers; must be columns of 4.")
    backbone: dict[str, Any] = {
        "diameter": quantity(2 * outer, "m"),
        **({"inner_diameter": quantity(2 * inner, "m")} if inner else {}),
        "E": quantity(young, "Pa"),
    }
    nu, shear = _optional(values, "nu"), _optional(values, "G")
    if nu.size:
        backbone["nu"] = quantity(nu[0], "")
    elif shear.size:
        backbone["G"] = quantity(shear[0], "Pa")
    else:
        backbone["nu"] = Field("0.3", assumed="nu")
    modules, masses = _optional(values, "l"), _masses(text, "m_bb")
    volume = math.pi * (outer**2 - inner**2) * (modules[0] if modules.size else 0.0)
    backbone["density"] = Field("0 kg/m^3", assumed="density")
    if masses.size == modules.size and volume > 0:
        density = quantity(masses[0] / volume, "kg/m^3")
        backbone["density"] = Field(density, "from m_bb, its mass")
    masses = _masses(text, "m_disk")
    mass = Field(quantity(masses[0], "kg")) if masses.size else Field("0 g", assumed="disk mass")
    gravity = _optional(values, "g")
    down = Field("0 0 0 m/s^2", assumed="gravity")
    if gravity.size:
        down = Field(vector((0.0, 0.0, -gravity[0]), "m/s^2"), "its models have it along -z")
    return _draft(label, lengths, disks, backbone, mass, holes.reshape(-1, 4)[:, :2], down)


def draft_cpp(text: str, label: str) -> Draft:
    """Draft a robot from the arguments of setRobotParameters."""
    for call in reversed(cpp(text).calls):
        try:
            given = dict(zip(_CPP, map(numbers, call.arguments[:6]), strict=True))
        except (Unreadable, ValueError):
            continue
        if call.name == "setRobotParameters" and given["routing"].ndim == 2:
            break
    else:
        raise InputError(
            f"{label}: no call of setRobotParameters(length, youngs_modulus, routing, "
            "number_disks, pradius_disks, ro, ...) with numbers that stand in the file."
        )
    backbone = {
        "diameter": quantity(2 * float(given["ro"]), "m"),
        "E": quantity(float(given["youngs_modulus"]), "Pa"),
        "nu": Field("0.3", "as in its models"),
        "density": Field("0 kg/m^3", assumed="density"),
    }
    lengths, disks = (np.atleast_1d(given[name]) for name in ("length", "number_disks"))
    mass = Field("0 g", assumed="disk mass")
    weightless = Field("0 0 0 m/s^2", "its models have none")
    return _draft(label, lengths, disks, backbone, mass, given["routing"][:, :2], weightless)


def _draft(
    label: str,
    lengths: Floats,
    disks: Floats,
    backbone: dict[str, Any],
    mass: Field,
    holes: Floats,
    gravity: Field,
) -> Draft:
    segments = []
    if len(disks) != len(lengths) or not len(lengths) or len(holes) % len(lengths):
        raise InputError(
            f"{label}: got lengths of {len(lengths)} segments, disks of {len(disks)} and "
            f"{len(holes)} tendons; must be the same number of tendons for each segment."
        )
    each = len(holes) // len(lengths)
    radii = np.hypot(*holes.T)
    radius = Field(
        quantity(1.2 * radii.max(initial=1e-3), "m"), "assumed: 1.2 pitch radii", "disk radius"
    )
    for k, (length, count) in enumerate(zip(lengths, disks, strict=True)):
        own = range(k * each, (k + 1) * each)
        segments.append(
            {
                "length": quantity(length, "m"),
                "backbone": dict(backbone),
                "disks": {
                    "count": quantity(count, ""),
                    "mass": mass,
                    "radius": radius,
                    **_NOT_STATED,
                },
                "tendons": [tendon(math.atan2(*holes[i, ::-1]), radii[i]) for i in own],
            }
        )
    return Draft({"gravity": gravity, "segments": segments})


def _optional(values: Values, name: str, default: float | None = None) -> Floats:
    """Numbers of a name as a row, or the default, or none."""
    try:
        return numbers(values.names[name]).ravel()
    except (KeyError, Unreadable):
        return np.array([] if default is None else [default])


def _masses(text: str, name: str) -> Floats:
    """Masses of weights that are written as masses times g, which may be 0; none without g."""
    one, two = (_optional(matlab(text, g=g), name) for g in (1.0, 2.0))
    return one if one.size and np.array_equal(two, 2.0 * one) and one.any() else np.array([])


def _numbers(values: Values, name: str, label: str) -> Floats:
    found = _optional(values, name)
    if not found.size:
        raise InputError(
            f"{label}: no numbers for {name}; a parameter file of tdcr-modeling assigns n, L, "
            "p_tendon, E and ro, and one of SoRoSim the properties of a SorosimLink."
        )
    return found
