"""Settings of a study: actuated tendons, range of tension, and motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import listed, significant
from bowstring.robot.model import Robot
from bowstring.study.comparison import Theory
from bowstring.study.ramp_response import MODAL_DAMPING
from bowstring.validation import is_whole, number, shown, whole

if TYPE_CHECKING:
    from bowstring.fem.run import Settings as FeSettings

__all__ = ["Extras", "Loading", "Ramp", "Settings"]


@dataclass(frozen=True)
class Loading:
    """Sweep of a study from zero: one tendon, or several at fixed shares of one tension.

    Parameters
    ----------
    max_tension : float, optional
        End of the sweep, N. The default is the largest round load (1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6
        or 8 times a power of ten) that bends the whole robot by at most 80 degrees by the linear
        law: 80 N for the study's robot, as in the study. In gravity, the bend is counted from the
        pose without tension, by statics.
    points : int
        Number of loads in equal steps, including zero.
    tendon : int or mapping from int to float, optional
        Number of the actuated tendon, from 1; or a mapping from numbers to shares of the sweep's
        tension, the largest of which must be 1: ``{1: 1.0, 4: 0.5}``. The default is the first
        tendon of the outermost segment. All others are slack.

    Raises
    ------
    InputError
        If a value is out of range.
    """

    max_tension: float | None = None
    points: int = 17
    tendon: int | Mapping[int, float] | None = None

    def __post_init__(self) -> None:
        if self.max_tension is not None:
            number("max_tension", self.max_tension, "N")
        whole("points", self.points, 2, 1000)
        if self.tendon is not None and not isinstance(self.tendon, (int, np.integer, Mapping)):
            rule = "the number of a tendon, or a mapping from numbers to shares"
            raise InputError.of("tendon", shown(self.tendon), rule)

    def shares(self, robot: Robot) -> tuple[float, ...]:
        """Share of the sweep's tension in each tendon of a robot."""
        count = len(robot.tendons.segment)
        out = [0.0] * count
        if self.tendon is None:
            out[int(np.flatnonzero(robot.tendons.segment == len(robot.segments) - 1)[0])] = 1.0
            return tuple(out)
        given = self.tendon if isinstance(self.tendon, Mapping) else {self.tendon: 1.0}
        for tendon, share in given.items():
            if not is_whole(tendon) or not 1 <= tendon <= count:
                rule = f"a whole number from 1 to {count}, the tendons of {robot.name}"
                raise InputError.of("tendon", shown(tendon), rule)
            if not isinstance(share, (int, float)) or not 0.0 < share <= 1.0:
                raise InputError(
                    f"the share of tendon {tendon} is {shown(share)}; must be above 0 and at most "
                    "1",
                    argument="tendon",
                )
            out[tendon - 1] = float(share)
        if max(out) != 1.0:
            raise InputError(
                f"the largest share of the actuated tendons is {max(out):g}; must be 1, the tendon "
                "that has the whole tension of the sweep",
                argument="tendon",
            )
        return tuple(out)


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
    """

    solid: bool = False
    fe: FeSettings | None = None


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
    range_chosen: bool
    """Whether the program chose `max_tension`."""
    rise: float | None
    """Rise of the tension in dynamics, s; None if the program chose it."""
    modal_damping: float
    """Damping ratio of the slowest modes in dynamics."""

    @property
    def actuated(self) -> str:
        """Actuated tendons in words: ``tendon 1``, ``tendons 1 and 4 (at 0.5 of it)``."""
        parts = [
            f"{i}" if share == 1.0 else f"{i} (at {significant(share)} of it)"
            for i, share in enumerate(self.shares, 1)
            if share
        ]
        return f"tendon{'s' * (len(parts) > 1)} {listed(parts)}"

    @property
    def actuated_alone(self) -> bool:
        """Whether one tendon is actuated and all others are slack."""
        return sum(share > 0.0 for share in self.shares) == 1
