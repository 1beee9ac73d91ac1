"""Rods of SoRoSim: MATLAB scripts that assign the properties of a SorosimLink.

Its tendons belong to a linkage, which is an object of MATLAB; the draft has none.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from bowstring.errors import InputError
from bowstring.robot.draft import Draft, Field, quantity
from bowstring.robot.foreign.values import Function, Unreadable, Values, matlab, number

__all__ = ["draft"]

_LEFT_OUT: Final = "Not converted: tendons (of the linkage), damping and joints."


def draft(text: str, label: str) -> Draft:
    """Draft a robot of the soft links of a script, one after the other, each division a segment."""
    values = matlab(text)
    links = list(dict.fromkeys(name.partition(".")[0] for name in values.names if "." in name))
    segments = [s for link in links for s in _divisions(values, link, f"{label}: {link}")]
    if not segments:
        raise InputError(
            f"{label}: no soft link with numbers that stand in the script; assign L, E, Poi, Rho "
            "and r of each link, such as L1.L = 0.3; L1.r{1} = @(X1)0.03;"
        )
    fields = {"gravity": Field("0 0 0 m/s^2", assumed="gravity"), "segments": segments}
    return Draft(fields, notes=(_LEFT_OUT,))


def _divisions(values: Values, link: str, where: str) -> list[dict[str, Any]]:
    given = {n.partition(".")[2]: v for n, v in values.names.items() if n.startswith(f"{link}.")}
    if given.get("linktype", "s") != "s" or not {"L", "r", "E"} & given.keys():
        return []
    if given.get("CS", "C") != "C":
        raise InputError(f"{where}.CS: only circular sections, 'C', are converted.")
    names = [name for name in ("E", "Rho", "Poi", "G") if name in given]
    numbers_of = {name: number(given[name], f"{where}.{name}") for name in names}
    if "E" not in numbers_of:
        raise InputError(f"{where}.E: no number for it; assign Young's modulus.")
    material: dict[str, Any] = {"E": quantity(numbers_of["E"], "Pa")}
    if "Poi" in numbers_of:
        material["nu"] = quantity(numbers_of["Poi"], "")
    elif "G" in numbers_of:
        material["G"] = quantity(numbers_of["G"], "Pa")
    else:
        material["nu"] = Field("0.5", assumed="nu")
    density = numbers_of.get("Rho")
    material["density"] = (
        Field("0 kg/m^3", assumed="density") if density is None else quantity(density, "kg/m^3")
    )
    lengths = _list(given.get("ld", given.get("L", [])))
    radii = _list(given.get("r", []))
    if not lengths or len(lengths) != len(radii):
        raise InputError(
            f"{where}: got {len(lengths)} lengths and {len(radii)} radii of divisions; assign L or "
            "ld, and r, with numbers, such as L1.L = 0.3; L1.r{1} = @(X1)0.03;"
        )
    segments = []
    for j, (length, radius) in enumerate(zip(lengths, radii, strict=True), 1):
        base, tip = _ends(radius, f"{where}.r{{{j}}}")
        end = {} if tip == base else {"end_diameter": quantity(2 * tip, "m")}
        segments.append(
            {
                "length": quantity(number(length, f"{where}.ld{{{j}}}"), "m"),
                "backbone": {"diameter": quantity(2 * base, "m"), **end, **material},
                "tendons_in": "body",
                "tendons": "[]",
            }
        )
    return segments


def _list(value: Any) -> list[Any]:
    return list(value) if isinstance(value, (list, np.ndarray)) else [value]


def _ends(radius: Any, where: str) -> tuple[float, float]:
    """Radius at both ends of a division; it must be linear in between."""
    if not isinstance(radius, Function):
        one = number(radius, where)
        return one, one
    try:
        base, middle, tip = (radius(at) for at in (0.0, 0.5, 1.0))
    except (Unreadable, ValueError):
        raise InputError(f"{where}: not a function of numbers alone.") from None
    if abs(base + tip - 2 * middle) > 1e-9 * abs(base):
        raise InputError(f"{where}: only radii that change linearly are converted.")
    return base, tip
