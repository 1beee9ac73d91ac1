"""Settings of the time integration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.statics.simulator import Scheme
from bowstring.units import quote, read_number, read_share
from bowstring.validation import number

DEFAULT_INTERVAL: Final = 0.01  # s
DEFAULT_SPECTRAL_RADIUS: Final = 0.8
_TOLERANCE_SHARE: Final = 2e-6  # default tolerance over length, per step


@dataclass(frozen=True)
class Integrator:
    """Settings of the time integration: steps, numerical and physical damping.

    The scheme is the generalised-alpha method, theory Eq. 5.1 and 5.2: implicit and of
    second order.

    Parameters
    ----------
    dt : float, optional
        Longest step in s. By default steps adapt to `tolerance`.
    tolerance : float or str, optional
        Error tolerance of a disk's position per step: in m, a length such as "1 um", or a share of
        the robot's length such as "1e-4 %". By default 2e-6 of the length. Steps are 10 ms at most.
    spectral_radius : float
        Spectral radius at infinity, 0 to 1, which sets the numerical damping. At 1 there is none,
        and each step conserves energy to 1e-5 of its largest value.
    mass_damping : float
        Mass-proportional (Rayleigh) damping: force per mass and velocity, in 1/s.
    material_damping : float
        Kelvin-Voigt damping: stress per strain rate over stress per strain, in s.
    modal_damping : float, optional
        Modal damping ratio (0.01 is 1 % of critical), instead of these two: that of the slowest
        mode and of the first one at least twice as fast, about the initial equilibrium without
        forces on disks and friction. Taut displacement-controlled tendons keep their length in
        these modes.

    Raises
    ------
    InputError
        If a value is out of range, or two exclude each other.
    """

    dt: float | None = None
    tolerance: float | str | None = None
    spectral_radius: float = DEFAULT_SPECTRAL_RADIUS
    mass_damping: float = 0.0
    material_damping: float = 0.0
    modal_damping: float | None = None

    def __post_init__(self) -> None:
        if self.tolerance is not None and self.dt is not None:
            raise InputError("give dt or tolerance, not both: a fixed step has no tolerance")
        if self.tolerance is not None:
            _in_metres(self.tolerance, 1.0)
        checked = {
            "dt": ("s", False),
            "mass_damping": ("1/s", True),
            "material_damping": ("s", True),
            "spectral_radius": ("", True),
            "modal_damping": ("", True),
        }
        for name, (unit, zero) in checked.items():
            value = getattr(self, name)
            if value is not None or name not in ("dt", "modal_damping"):
                object.__setattr__(self, name, number(name, value, unit, zero=zero))
        if self.modal_damping is not None and (self.mass_damping or self.material_damping):
            raise InputError("give modal_damping, or mass and material damping, not both")

    def scheme(self, length: float, longest_step: float) -> Scheme:
        """Parameters for a robot of a given length in m; `longest_step` in s."""
        tolerance = _TOLERANCE_SHARE * length
        if self.tolerance is not None:
            tolerance = _in_metres(self.tolerance, length)
        return Scheme(
            self.dt,
            tolerance,
            longest_step,
            self.spectral_radius,
            self.mass_damping,
            self.material_damping,
        )


def _in_metres(tolerance: float | str, length: float) -> float:
    """Tolerance in m; a share is that of a length in m."""
    if not isinstance(tolerance, str):
        return number("tolerance", tolerance, "m")
    try:
        share = tolerance.strip().endswith("%")
        found = read_share(tolerance) * length if share else read_number(tolerance, "m")
    except ValueError:
        found = 0.0
    if found <= 0.0:
        rule = 'a length above 0, such as "1 um", or a share of that of the robot, such as "1e-4 %"'
        raise InputError.of("tolerance", quote(tolerance), rule)
    return found


def with_ratio(scheme: Scheme, ratio: float, frequency_hz: Floats) -> Scheme:
    """Return the scheme with mass and material damping for a damping ratio of two modes.

    The modes are the slowest and the first at least twice as fast, of these natural frequencies
    (K,) in Hz.
    """
    slow = 2.0 * np.pi * float(frequency_hz[0])
    faster = frequency_hz[frequency_hz >= 2.0 * frequency_hz[0]]
    fast = 2.0 * np.pi * float(faster[0]) if len(faster) else 10.0 * slow
    return scheme._replace(
        mass_damping=2.0 * ratio * slow * fast / (slow + fast),
        material_damping=2.0 * ratio / (slow + fast),
    )
