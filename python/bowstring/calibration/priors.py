"""Priors of fitted parameters: normal about the nominal values, independent of each other.

P is the number of parameters, Q that of parameters with a prior. All values are in SI, except those
of `Priors`, which are divided by the natural steps of the parameters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.calibration.parameters import Unknown, Unknowns
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.validation import shown

PriorChoice = Literal["default"] | Mapping[str, float] | None

#: Default standard deviations of the actuation, SI.
_ACTUATION: Final = {
    "gain": 0.02,
    "offset": 5e-4,
    "backlash": 1e-4,
    "hole_clearance": 2e-4,
    "delay": 0.1,
}
#: Default standard deviation of the place of a hole in each direction, m.
_HOLE: Final = 2e-4


@dataclass(frozen=True, eq=False)
class Priors:
    """Means and standard deviations of scaled parameters.

    Attributes
    ----------
    mean, deviation : ndarray (P,)
        The deviation is infinite without a prior.
    """

    mean: Floats
    deviation: Floats

    @classmethod
    def of(cls, unknowns: Unknowns, nominal: Unknowns, deviations: Mapping[str, float]) -> Priors:
        """Make priors from standard deviations in SI by name; `nominal` starts at the means."""
        step = np.array([item.step for item in unknowns.items])
        deviation = np.array([deviations.get(name, math.inf) for name in unknowns.names])
        return cls(nominal.start / step, deviation / step)

    @property
    def known(self) -> Bools:
        """Parameters (P,) with a prior."""
        return np.isfinite(self.deviation)

    @property
    def free(self) -> int:
        """Number of parameters without a prior."""
        return int((~self.known).sum())

    def residuals(self, scaled: Floats, noise: float) -> Floats:
        """Residuals (Q,) beside those of the data, whose standard deviation is `noise`."""
        known = self.known
        return np.asarray(noise * ((scaled - self.mean) / self.deviation)[known])

    def jacobian(self, noise: float) -> Floats:
        """Derivatives (Q, P) of the residuals."""
        return np.asarray(np.diag(noise / self.deviation)[self.known])


def default_priors(
    robot: Robot, parameters: Sequence[str], *, by_tension: bool = False
) -> dict[str, float]:
    """Return the default standard deviations of parameters about their nominal values.

    Parameters
    ----------
    robot : Robot
        Robot with the nominal holes.
    parameters : sequence of str
        Names of parameters, as for `bowstring.fit`.
    by_tension : bool
        Whether all commands are tensions, of whose offsets nothing is known in general.

    Returns
    -------
    dict from name to float
        Standard deviations in SI, for ``priors`` of `bowstring.fit`: 0.02 of a ``gain``, 0.5 mm of
        an ``offset``, 0.1 mm of a ``backlash``, 0.2 mm of a
        ``hole_clearance``, 0.1 s of a ``delay``, and of the holes 0.2 mm in
        the radial and in the tangential direction (``pitch_radius``, ``hole_angle``, and the same
        fields of the robot file). Other parameters have none and are left out: nothing is known of
        stiffness, friction, base and tool of a robot in general.

    Raises
    ------
    InputError
        For names that are unknown or duplicate.
    """
    found = {}
    for item in Unknowns(robot, parameters, by_tension=by_tension).items:
        deviation = _default(robot, item)
        if deviation is not None:
            found[item.name] = deviation
    return found


def _default(robot: Robot, item: Unknown) -> float | None:
    head, _, rest = item.name.partition(".")
    if head in _ACTUATION and item.unit != "N":
        return _ACTUATION[head]
    if head in ("hole_angle", "pitch_radius"):
        return _HOLE / _radius(robot, [int(rest.rpartition(".")[2])] if rest else None)
    in_tendons = bool(item.paths) and ".tendons." in item.paths[0]
    if in_tendons and item.leaf == "pitch_radius":
        return _HOLE
    if in_tendons and item.leaf in ("angle", "first_angle"):
        return _HOLE / _radius(robot, [int(path.split(".")[1]) for path in item.paths])
    return None


def _radius(robot: Robot, segments: Sequence[int] | None) -> float:
    """Mean pitch radius of the tendons of some segments, or of all, m."""
    tendons = robot.tendons
    which = slice(None) if segments is None else np.isin(tendons.segment, segments)
    return float(tendons.arm_m[which].mean())


def read_priors(choice: PriorChoice, robot: Robot, unknowns: Unknowns) -> dict[str, float]:
    """Check priors and return the finite standard deviations in SI by name of a parameter."""
    if choice is None:
        return {}
    if isinstance(choice, str) and choice == "default":
        return default_priors(robot, unknowns.names, by_tension=unknowns.by_tension)
    if not isinstance(choice, Mapping):
        raise InputError.of(
            "priors", shown(choice), '"default", or a mapping of names to standard deviations'
        )
    found: dict[str, float] = {}
    for key, value in choice.items():
        number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
        if not (number and value > 0):
            raise InputError(
                f"prior of {key} is {shown(value)}, it must be a standard deviation above 0, in SI",
                argument="priors",
            )
        found |= dict.fromkeys((item.name for item in matching(unknowns, key)), float(value))
    return {name: value for name, value in found.items() if math.isfinite(value)}


def matching(unknowns: Unknowns, key: str) -> list[Unknown]:
    """Return the fitted parameters that a name of a prior stands for.

    These are the parameter of this name, those of its group (``gain`` for ``gain.tendons.0``), and
    with ``*`` those of all indices.

    Raises
    ------
    InputError
        If there are none, or they have different units.
    """
    pattern = re.escape(str(key)).replace(r"\*", r"(?:\*|\d+)")
    found = [i for i in unknowns.items if re.fullmatch(rf"{pattern}(?:\..+)?", i.name)]
    if not found:
        raise InputError(
            f"prior of {shown(key)} belongs to no fitted parameter; fitted are "
            f"{', '.join(unknowns.names)}",
            argument="priors",
        )
    kinds = {(each.leaf, each.name.startswith("base.r"), each.unit) for each in found}
    if len({kind[:2] for kind in kinds}) > 1:
        raise InputError(
            f"prior of {key} is for several parameters with different units; name each: "
            f"{', '.join(each.name for each in found)}",
            argument="priors",
        )
    return found
