"""Settings of the time integration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from bowstring.errors import InputError
from bowstring.statics.simulator import Scheme
from bowstring.validation import number

__all__ = ["DEFAULT_INTERVAL", "DEFAULT_SPECTRAL_RADIUS", "Integrator"]

DEFAULT_INTERVAL: Final = 0.01  # s
DEFAULT_SPECTRAL_RADIUS: Final = 0.8
_TOLERANCE_SHARE: Final = 2e-6  # of the length, in each step


@dataclass(frozen=True)
class Integrator:
    """Implicit time integration of second order: steps, numerical and physical damping.

    Parameters
    ----------
    dt : float, optional
        Longest step in s. If not given, steps adapt to `tolerance`.
    tolerance : float, optional
        Error of a disk's position in one step to aim for, m; 2e-6 of the length if not given. Steps
        are 10 ms at most.
    spectral_radius : float
        Numerical damping: the spectral radius at infinity, 0 to 1. At 1 there is none, and each
        step keeps energy to 1e-5 of its largest value.
    mass_damping : float
        Mass-proportional (Rayleigh) damping: force per mass and velocity, in 1/s.
    material_damping : float
        Kelvin-Voigt damping: the stress of the strain's rate over that of the strain, in s.
    modal_damping : float, optional
        Instead of these two: a ratio of critical damping (0.01 is 1 %) that the slowest mode has,
        and the first that is at least twice as fast, about the equilibrium at the start (forces on
        disks and friction left out). There a tendon whose displacement is given keeps its length if
        it is taut.

    Raises
    ------
    InputError
        If a value is out of range, or two exclude each other.
    """

    dt: float | None = None
    tolerance: float | None = None
    spectral_radius: float = DEFAULT_SPECTRAL_RADIUS
    mass_damping: float = 0.0
    material_damping: float = 0.0
    modal_damping: float | None = None

    def __post_init__(self) -> None:
        if self.tolerance is not None and self.dt is not None:
            raise InputError("give dt or tolerance, not both: a fixed step has no tolerance")
        checked = {
            "dt": ("s", False),
            "tolerance": ("m", False),
            "mass_damping": ("1/s", True),
            "material_damping": ("s", True),
            "spectral_radius": ("", True),
            "modal_damping": ("", True),
        }
        for name, (unit, zero) in checked.items():
            value = getattr(self, name)
            if value is not None or name not in ("dt", "tolerance", "modal_damping"):
                object.__setattr__(self, name, number(name, value, unit, zero=zero))
        if self.modal_damping is not None and (self.mass_damping or self.material_damping):
            raise InputError("give modal_damping, or mass and material damping, not both")

    def scheme(self, length: float, longest_step: float) -> Scheme:
        """In numbers, for a robot of a length in m; `longest_step` in s."""
        tolerance = _TOLERANCE_SHARE * length if self.tolerance is None else self.tolerance
        return Scheme(
            self.dt,
            tolerance,
            longest_step,
            self.spectral_radius,
            self.mass_damping,
            self.material_damping,
        )
