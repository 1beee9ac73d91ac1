"""Ramp of tension of a robot: actuated tendons, and the largest load."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import BowstringError, InputError
from bowstring.formatting import listed, round_down, significant
from bowstring.robot.model import Robot, check_tendons, without_laws
from bowstring.statics import rod
from bowstring.statics.model import RodModel
from bowstring.validation import is_whole, number, shown, whole

MAX_BEND: Final = math.radians(80.0)
"""Bend of the whole robot at the largest load by default, rad."""
FARTHEST: Final = 16.0
"""Largest range in gravity over that of the linear law."""
TRIED: Final = 33
"""Loads of the search for the range in gravity."""


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
        tension, the largest of which must be 1: ``{1: 1.0, 4: 0.5}``. Rods and chambers push by a
        negative share: ``{1: -1.0}``. The default is the first tendon of the outermost segment, at
        -1 if it is a chamber. All others are slack.

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
        check_tendons(robot, "a sweep of tensions")
        count = len(robot.tendons.segment)
        out = [0.0] * count
        if self.tendon is None:
            of = robot.tendons.segment
            first = int(np.flatnonzero(of == of.max())[0])
            out[first] = whole_share(robot)[first]
            return tuple(out)
        given = self.tendon if isinstance(self.tendon, Mapping) else {self.tendon: 1.0}
        for tendon, share in given.items():
            if not is_whole(tendon) or not 1 <= tendon <= count:
                rule = f"a whole number from 1 to {count}, the tendons of {robot.name}"
                raise InputError.of("tendon", shown(tendon), rule)
            least = -1.0 if robot.tendons.pushes[tendon - 1] else 0.0
            if not isinstance(share, (int, float)) or not least <= share <= 1.0 or share == 0.0:
                rule = "from -1 to 1 and not 0" if least else "above 0 and at most 1"
                raise InputError(
                    f"the share of tendon {tendon} is {shown(share)}; must be {rule}",
                    argument="tendon",
                )
            out[tendon - 1] = float(share)
        if (largest := max(map(abs, out))) != 1.0:
            raise InputError(
                f"the largest share of the actuated tendons is {largest:g}; must be 1, the tendon "
                "that has the whole tension of the sweep",
                argument="tendon",
            )
        return tuple(out)


def whole_share(robot: Robot) -> list[float]:
    """Share of the sweep's tension with which each tendon alone acts: -1 of a chamber, else 1."""
    every = [tendon for segment in robot.segments for tendon in segment.tendon_list]
    return [-1.0 if tendon.kind == "chamber" else 1.0 for tendon in every]


def actuated(shares: Sequence[float] | Floats) -> str:
    """Actuated tendons in words: ``tendon 1``, ``tendons 1 and 4 (at 0.5 of it)``.

    Parameters
    ----------
    shares : sequence of float (T,)
        Share of the sweep's tension in each tendon.
    """
    parts = [
        f"{i}" if share == 1.0 else f"{i} (at {significant(float(share))} of it)"
        for i, share in enumerate(shares, 1)
        if share
    ]
    return f"tendon{'s' * (len(parts) > 1)} {listed(parts)}"


def named(label: str, shares: Sequence[float] | Floats) -> str:
    """Label of an axis in which the tension of the sweep is that of the actuated tendons."""
    return label.replace("of the sweep", f"of {actuated(shares)}")


def linear_bend(robot: Robot, shares: Floats) -> Floats:
    """Bend (S, 2) of each segment per N of the sweep by theory Eq. 1.7, rad/N.

    Parameters
    ----------
    robot : Robot
    shares : ndarray (T,)
        Share of the sweep's tension in each tendon.

    Returns
    -------
    ndarray (S, 2)
    """
    out = np.zeros((len(robot.segments), 2))
    for k in range(len(robot.segments)):
        passing = robot.tendons.segment >= k
        holes = robot.tendons.mean_hole_m[k, passing] - robot.tension_centre_m[k]
        moment = shares[passing] @ holes
        size = float(np.abs(shares[passing]) @ robot.tendons.arm_m[passing])
        if np.linalg.norm(moment) > 1e-9 * size:  # otherwise the tendons balance each other
            out[k] = robot.bend_by_moment[k] @ moment
    return out


def largest_load(robot: Robot, shares: Floats, model: RodModel) -> float:
    """Default end of the sweep: a round load, N.

    Parameters
    ----------
    robot : Robot
    shares : ndarray (T,)
        Share of the sweep's tension in each tendon.
    model : RodModel
        Rod of the search in gravity.

    Raises
    ------
    InputError
        If the tendons balance each other.
    """
    by_newton = float(np.linalg.norm(linear_bend(robot, shares), axis=1).sum())
    if not by_newton > 0.0:
        raise InputError(
            "the actuated tendons balance each other and bend nothing by the linear law, so that "
            "no load range follows; give a largest tension, or actuate other tendons",
            argument="tendon",
        )
    linear = MAX_BEND / by_newton
    if not any(robot.gravity):
        return round_down(linear)
    top = linear
    while top <= FARTHEST * linear:
        tension = np.linspace(0.0, top, TRIED)
        bend = turned(robot, np.outer(tension, shares), model)
        beyond = np.flatnonzero(~(bend <= MAX_BEND))
        if beyond.size:
            break
        top *= 2.0
    else:
        return round_down(0.5 * top)
    i = int(beyond[0])
    if i == 0:  # no reference pose without tension
        return round_down(linear)
    low, high = tension[i - 1], tension[i]
    load = float(low)
    if np.isfinite(bend[i]):
        load += float((high - low) * (MAX_BEND - bend[i - 1]) / (bend[i] - bend[i - 1]))
    return round_down(load) if load > 0.0 else round_down(linear)


def turned(robot: Robot, tensions: Floats, model: RodModel) -> Floats:
    """Sum of the segments' rotations from the pose of the first load at each load (n,), rad.

    Parameters
    ----------
    robot : Robot
        Its friction is left out.
    tensions : ndarray (n, T)
        Tensions in N.
    model : RodModel

    Returns
    -------
    ndarray (n,)
        NaN without a stable equilibrium.
    """
    count = len(tensions)
    try:
        sweep = rod.sweep(without_laws(robot), tensions, model=model)
    except BowstringError:
        return np.full(count, math.nan)
    assert sweep.disk_rotations is not None
    disks = robot.disks.segment
    ends = np.append(np.flatnonzero(np.diff(disks)), len(disks) - 1)
    out, before = np.zeros(count), np.broadcast_to(np.eye(3), (count, 3, 3))
    for end in ends:
        here = np.where(sweep.converged[:, None, None], sweep.disk_rotations[:, end], math.nan)
        bent = np.swapaxes(before, 1, 2) @ here
        turn = np.swapaxes(bent[:1], 1, 2) @ bent
        cosine = 0.5 * (np.trace(turn, axis1=1, axis2=2) - 1.0)
        out += np.arccos(np.clip(cosine, -1.0, 1.0))
        before = here
    return out
