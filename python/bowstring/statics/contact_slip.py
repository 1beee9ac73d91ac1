"""Contact force of a sliding tip by Coulomb friction, in the axes of the plane."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from bowstring.aliases import Floats

_ANGLES: Final = 48  # angles at which the direction of the slip is bracketed


def energy_norm(compliance: Floats, force: Floats) -> float:
    """Norm of a force by the energy of the motion that it causes."""
    return math.sqrt(max(0.0, float(force @ compliance @ force)))


def sliding_force(
    compliance: Floats, free: Floats, friction: float, tangential: Floats
) -> Floats | None:
    """Contact force of a sliding tip whose position is `free` + `compliance` @ force.

    The direction of the slip is the root of one function of its angle, theory Eq. 3.12. Of
    several roots, takes the one with the friction force nearest to `tangential`.
    """

    from scipy.optimize import brentq

    def at(angle: Any) -> tuple[Any, Any, Any, Any]:
        x, y = np.cos(angle), np.sin(angle)
        # gap of a unit normal force with its friction force
        unit = compliance[0, 0] - friction * (compliance[0, 1] * x + compliance[0, 2] * y)
        normal = -free[0] / unit
        forces = (normal, -friction * normal * x, -friction * normal * y)
        slip = [free[i] + sum(compliance[i, j] * forces[j] for j in range(3)) for i in (1, 2)]
        return x * slip[1] - y * slip[0], x * slip[0] + y * slip[1], unit, forces

    angles = np.linspace(0.0, 2 * np.pi, _ANGLES + 1)
    across, _, unit, _ = at(angles)
    possible = (unit[:-1] > 0) & (unit[1:] > 0) & (across[:-1] * across[1:] <= 0)
    best, nearest = None, np.inf
    for k in np.flatnonzero(possible):
        ends = (angles[k], angles[k + 1])
        angle = brentq(lambda a: at(a)[0], *ends, xtol=1e-15, rtol=1e-14)
        _, along, _, forces = at(angle)
        force = np.array(forces)
        distance = math.hypot(*(force[1:] - tangential))
        if along >= 0 and distance < nearest:
            best, nearest = force, distance
    return best
