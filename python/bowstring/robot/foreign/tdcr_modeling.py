"""Robots of tdcr-modeling (Rao et al. 2021): MATLAB parameters, or C++ with setRobotParameters."""

from __future__ import annotations

import math
import re
from typing import Any, Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.robot.draft import Draft, Field, quantity, tendon, vector
from bowstring.robot.foreign.values import Values, cpp, matlab, numbers

_NO_DENSITY: Final = Field("0 kg/m^3", assumed="density")
_NO_MASS: Final = Field("0 g", assumed="disk mass")


def draft_matlab(text: str, label: str) -> Draft:
    """Draft a robot from assignments to n, L, p_tendon, E, nu, ro, ri, g, m_bb and m_disk."""
    values = matlab(text, label)
    given = {name: _row(values, name) for name in ("n", "L", "p_tendon", "E", "ro")}
    missing = [n for n, row in given.items() if not row.size or (n in ("E", "ro") and row.size > 1)]
    holes = np.atleast_1d(values.names.get("p_tendon", 0.0))
    if missing or len(holes) != 4:
        raise InputError(
            f"{label}: cannot read {', '.join(missing) or 'p_tendon, which must have 4 rows'}; a "
            "parameter file of tdcr-modeling assigns numbers to n, L, p_tendon, E and ro."
        )
    outer, inner = given["ro"][0], _row(values, "ri")[:1].sum()  # 0 without ri
    backbone: dict[str, Any] = {"diameter": quantity(2 * outer, "m")}
    if inner:
        backbone["inner_diameter"] = quantity(2 * inner, "m")
    backbone["E"] = quantity(given["E"][0], "Pa")
    for name, si in (("nu", ""), ("G", "Pa")):
        if _row(values, name).size:
            backbone[name] = quantity(_row(values, name)[0], si)
            break
    else:
        backbone["nu"] = Field("0.3", assumed="nu")
    # masses are written as weights, m*g, and g may be 0
    one, two = (matlab(re.sub(r"\bg\s*=[^;\n]*", f"g={g}", text), label) for g in (1, 2))
    masses = {
        name: _row(one, name)
        for name in ("m_bb", "m_disk")
        if np.array_equal(_row(two, name), 2 * _row(one, name))
    }
    modules, rod = _row(values, "l"), masses.get("m_bb", np.array([]))
    backbone["density"] = _NO_DENSITY
    volumes = math.pi * (outer**2 - inner**2) * modules
    if rod.size and rod.shape == volumes.shape and (volumes > 0).all():
        density = rod / volumes
        if density.any() and np.allclose(density, density[0]):
            backbone["density"] = Field(quantity(density[0], "kg/m^3"), "from m_bb, its mass")
    disk = masses.get("m_disk", np.array([]))
    mass = Field(quantity(disk[0], "kg")) if disk.any() and np.ptp(disk) == 0 else _NO_MASS
    gravity = _row(values, "g")
    down = Field("0 0 0 m/s^2", assumed="gravity")
    if gravity.size:
        down = Field(vector((0.0, 0.0, -gravity[0]), "m/s^2"), "its models have it along -z")
    return _draft(label, given["L"], given["n"], backbone, mass, holes.T, down)


def draft_cpp(text: str, label: str) -> Draft:
    """Draft a robot from the arguments of setRobotParameters."""
    for call in reversed(cpp(text, label).calls):
        try:
            length, young, routing, disks, _, ro = map(numbers, call.arguments[:6])
            young, ro = young.reshape(()), ro.reshape(())
        except ValueError:
            continue
        if call.name == "setRobotParameters" and routing.ndim == 2 and routing.shape[1] == 3:
            break
    else:
        raise InputError(
            f"{label}: no call of setRobotParameters(length, youngs_modulus, routing, "
            "number_disks, pradius_disks, ro, ...) with numbers that stand in the file."
        )
    backbone = {
        "diameter": quantity(2 * float(ro), "m"),
        "E": quantity(float(young), "Pa"),
        "nu": Field("0.3", "as in its models"),
        "density": _NO_DENSITY,
    }
    weightless = Field("0 0 0 m/s^2", "its models have none")
    return _draft(label, length.ravel(), disks.ravel(), backbone, _NO_MASS, routing, weightless)


def _draft(
    label: str,
    lengths: Floats,
    disks: Floats,
    backbone: dict[str, Any],
    mass: Field,
    holes: Floats,
    gravity: Field,
) -> Draft:
    if not len(disks) == len(lengths) > 0 or len(holes) % len(lengths):
        raise InputError(
            f"{label}: got lengths of {len(lengths)} segments, disks of {len(disks)} and "
            f"{len(holes)} tendons; must be the same number of tendons for each segment."
        )
    rows = holes.reshape(len(lengths), -1, holes.shape[1])
    widest = float(np.hypot(holes[:, 0], holes[:, 1]).max(initial=1e-3))
    segments = [
        {
            "length": quantity(length, "m"),
            "backbone": backbone,
            "disks": {
                "count": quantity(count, ""),
                "mass": mass,
                "radius": Field(
                    quantity(1.2 * widest, "m"), "assumed: 1.2 pitch radii", "disk radius"
                ),
                "thickness": Field("0 mm", assumed="disk thickness"),
                "clamped_length": Field("0 mm", assumed="clamped length"),
            },
            "tendons": [tendon(x, y) for x, y, *_ in own],
        }
        for length, count, own in zip(lengths, disks, rows, strict=True)
    ]
    return Draft({"gravity": gravity, "segments": segments})


def _row(values: Values, name: str) -> Floats:
    """Numbers of a name; none if it has no numbers."""
    try:
        return numbers(values.names.get(name)).ravel()
    except ValueError:
        return np.array([])
