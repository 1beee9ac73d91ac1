"""Settings of a study: actuated tendons, range of tension, and motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.study.comparison import Theory
from bowstring.study.ramp_response import MODAL_DAMPING
from bowstring.validation import number
from bowstring.validity.loading import actuated

if TYPE_CHECKING:
    from bowstring.fem.run import Settings as FeSettings
    from bowstring.uncertainty import Distributions


@dataclass(frozen=True)
class Ramp:
    """Motion of a study: the tension rises from zero to the end of the sweep, and is held.

    Parameters
    ----------
    rise : float, optional
        Rise time in s, a quarter to 200 periods of the slowest mode; 20 periods by default, which
        is close to statics.
    modal_damping : float
        Damping ratio of the slowest modes.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    rise: float | None = None
    modal_damping: float = MODAL_DAMPING

    def __post_init__(self) -> None:
        if self.rise is not None:
            number("rise", self.rise, "s")
        if not number("modal_damping", self.modal_damping, zero=True) < 1.0:
            rule = "from 0 to below 1, a ratio of critical damping"
            raise InputError.of("modal_damping", f"{self.modal_damping:g}", rule)


@dataclass(frozen=True)
class Extras:
    """Optional parts of a study.

    Parameters
    ----------
    solid : bool
        Whether the report shows the robot as a solid (`bowstring.cad.solid`); takes some seconds.
    fe : bowstring.fem.Settings, optional
        Settings of 3-D finite elements that also solve the sweep; takes minutes.
    uncertainty : Distributions, str, Path or mapping, optional
        Distributions of the robot's numbers, as `bowstring.uncertainty.read_distributions` takes
        them. By default a standard deviation of 5 % of Young's modulus, where the file gives one,
        and of 1 % of the pitch radius, which the report calls assumed.
    over : str, optional
        Axis beside the tension of the map over loads: ``"payload=0:100 g"``, ``"tilt=0:90 deg"``,
        ``"tip_force=0:1 N"`` (perpendicular to the bending plane), a component such as
        ``tip_force.x`` or ``gravity.z``. By default a payload, or a tip force where the robot has
        no gravity.
    compare : bool
        Whether models with memories are compared on left-out rows of the measurements
        (`bowstring.calibration.compare_models`), for the parts of the error; takes up to a second
        for each row.
    """

    solid: bool = False
    fe: FeSettings | None = None
    uncertainty: Distributions | str | Path | Mapping[str, Any] | None = None
    over: str | None = None
    compare: bool = False


@short_repr
@dataclass(frozen=True)
class Settings:
    """Resolved settings of a study."""

    tolerance: float
    """Tolerated tip error as a share of the length."""
    max_tension: float
    """End of the sweep, N."""
    points: int
    """Number of loads of the sweep, from zero to `max_tension`."""
    theory: Theory
    """Rod theory of the main sweep: ``"cosserat"`` or ``"kirchhoff"``."""
    tendon: int
    """Index of the actuated tendon, from 0; of several, the first with the whole tension."""
    shares: tuple[float, ...]
    """Share of the sweep's tension in each tendon, from 0 to 1."""
    tried: int
    """Number of combinations of tendons of which `shares` is the worst; 0 if they were given."""
    earlier: tuple[str, ...]
    """Sentences on other combinations that leave the tolerance earlier from lengths or from force,
    without a capital and a full stop."""
    range_chosen: bool
    """Whether the program chose `max_tension`."""
    rise: float | None
    """Rise of the tension in dynamics, s; None if the program chose it."""
    modal_damping: float
    """Damping ratio of the slowest modes in dynamics."""

    @property
    def actuated(self) -> str:
        """Actuated tendons in words: ``tendon 1``, ``tendons 1 and 4 (at 0.5 of it)``."""
        return actuated(self.shares)

    @property
    def judged(self) -> str:
        """Actuated tendons, and the number of combinations of which they leave the tolerance
        first, as a share of the range of tension."""
        if self.tried < 2:
            return self.actuated
        alone = self.tried == len(self.shares)
        worst = f"the worst of {self.tried} {'' if alone else 'combinations of '}tendons"
        other = "; from one input another exceeds the tolerance earlier"
        return f"{self.actuated} ({worst}{other if self.earlier else ''})"

    @property
    def actuated_alone(self) -> bool:
        """Whether one tendon is actuated and all others are slack."""
        return sum(share != 0.0 for share in self.shares) == 1
