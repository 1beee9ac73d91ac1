"""Priors of fitted parameters: normal about the nominal values, independent of each other.

P is the number of parameters, Q that of parameters with a prior. All values are in SI, except those
of `Priors`, which are divided by the natural steps of the parameters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.calibration.parameters import Unknown, Unknowns
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.validation import shown

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


@dataclass(frozen=True)
class Prior:
    """A parameter of a fit with a normal prior about its nominal value.

    The nominal value is that of the robot file, 1 for ``gain``, ``pitch_radius`` and ``bend_gain``,
    0 for the other parameters of the actuation, and the initial value for ``base``, ``tool`` and
    ``marker``.

    Parameters
    ----------
    name : str
        Name of a parameter of `bowstring.fit`, or of a group whose members all have this prior.
    sd : float, optional
        Standard deviation in SI. The default is that of `default_priors`.

    Raises
    ------
    InputError
        If the standard deviation is not a number above 0.
    """

    name: str
    sd: float | None = None

    def __post_init__(self) -> None:
        number = isinstance(self.sd, (int, float, np.number)) and not isinstance(self.sd, bool)
        if self.sd is not None and not (number and 0 < self.sd < math.inf):
            raise InputError(
                f"prior of {self.name} is {shown(self.sd)}, it must be a standard deviation above "
                "0, in SI",
                argument="parameters",
            )


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
        Standard deviations in SI, those of a `Prior` without one: 0.02 of a ``gain``, 0.5 mm of an
        ``offset``, 0.1 mm of a ``backlash``, 0.2 mm of a
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


def names_of(parameters: Sequence[str | Prior]) -> Sequence[str]:
    """Names of parameters with and without a prior."""
    if isinstance(parameters, str):  # which `Unknowns` refuses
        return parameters
    return [each.name if isinstance(each, Prior) else each for each in parameters]


def deviations_of(
    robot: Robot, parameters: Sequence[str | Prior], *, by_tension: bool
) -> dict[str, float]:
    """Standard deviations in SI of the parameters with a prior, by name of a single parameter."""
    found: dict[str, float] = {}
    for prior in parameters:
        if not isinstance(prior, Prior):
            continue
        items = Unknowns(robot, [prior.name], by_tension=by_tension).items
        if prior.sd is not None:
            _check_units(prior.name, items)
        for item in items:
            deviation = _default(robot, item) if prior.sd is None else prior.sd
            if deviation is None:
                raise InputError(
                    f"{item.name} has no default prior; give it a standard deviation, in SI",
                    argument="parameters",
                )
            found[item.name] = deviation
    return found


def with_priors(names: Sequence[str], deviations: Mapping[str, float]) -> list[str | Prior]:
    """Parameters, with priors of those that have a standard deviation."""
    return [Prior(name, deviations[name]) if name in deviations else name for name in names]


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
            argument="parameters",
        )
    _check_units(key, found)
    return found


def _check_units(key: str, found: Sequence[Unknown]) -> None:
    kinds = {(each.leaf, each.name.startswith("base.r"), each.unit) for each in found}
    if len({kind[:2] for kind in kinds}) > 1:
        raise InputError(
            f"prior of {key} is for several parameters with different units; name each: "
            f"{', '.join(each.name for each in found)}",
            argument="parameters",
        )
