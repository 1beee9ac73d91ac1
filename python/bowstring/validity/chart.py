"""Dimensionless validity chart: where constant curvature stops, read without solving the robot.

It is for robots with one segment, equally spaced disks and one actuated tendon. The derivation, the
class of robots and the errors seen are in docs/theory/validity.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import in_newtons, in_percent, significant
from bowstring.validity.chart_errors import MODELS, ChartErrors, chart_errors
from bowstring.validity.chart_groups import Groups, bend_per_tension

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bowstring.robot.model import Robot

TOLERANCES: Final = (0.005, 0.05)
"""Range of tolerances in which the chart is tested."""
_RELIABLE: Final = 0.1  # largest stated relative error of a reliable limit
_LABELS: Final = {
    "cc_from_lengths": "From tendon lengths",
    "cc_from_force": "From force through the linear law",
    "cc_from_lengths_chord": "From tendon lengths with chords",
    "cc_from_force_arm": "From force with the mean lever arm",
}


@short_repr
@dataclass(frozen=True)
class Limit:
    """Validity limit of one constant-curvature model: the first crossing of the tolerance.

    Bends are those of the linear law, F r l/(EI), in rad.
    """

    name: str
    """Model, named as in the study: `bowstring.validity.chart_errors.MODELS`."""
    linear_bend: float
    """Limit; 0 if the tolerance never holds, the end of the chart if it holds throughout."""
    low: float
    """Lower end of the interval of the limit."""
    high: float
    """Upper end of the interval of the limit."""
    bend: float
    """Bend angle of the robot at the limit, by the tendon alone, rad."""
    throughout: bool
    """Whether the error stays below the tolerance up to the end of the chart."""
    reliable: bool
    """Whether all groups are in the tested ranges and the stated error is at most 10 %."""
    tension: float | None
    """Tension at the limit, N; None without a robot."""
    tension_interval: tuple[float, float] | None
    """Interval of the tension, N; None without a robot."""
    text: str
    """Limit in a sentence."""

    @property
    def error(self) -> float:
        """Stated relative error: the larger half of the interval over the limit."""
        half = max(self.high - self.linear_bend, self.linear_bend - self.low)
        return half / self.linear_bend if self.linear_bend else (math.inf if half else 0.0)


@short_repr
@dataclass(frozen=True)
class ValidityChart:
    """Validity chart, with the limits of a robot if one was given."""

    tolerance: float
    """Tolerated tip error over the length."""
    groups: Groups | None
    """Groups of the robot."""
    limits: tuple[Limit, ...]
    """Limits of the models; empty without a robot."""
    linear_bend: Floats
    """Bend by the linear law (n,) from zero to the end of the chart, rad."""
    tip_error: dict[str, Floats] = field(repr=False)
    """Predicted tip errors (n,) over the length, by model."""

    def __getitem__(self, name: str) -> Limit:
        """Limit of a model by its name, such as ``"cc_from_force"``."""
        for limit in self.limits:
            if limit.name == name:
                return limit
        known = ", ".join(limit.name for limit in self.limits) or "none, as no robot was given"
        raise InputError(f"the chart has no limit {name!r}; it has {known}")

    @property
    def caption(self) -> str:
        """Caption of the figure: how to read it, with the robot as worked example."""
        from bowstring.validity.chart_figure import caption

        return caption(self)

    def figure(self) -> Figure:
        """Draw the chart for a printed page, with the robot's point if one was given.

        Returns
        -------
        matplotlib.figure.Figure
            Draw and save within `bowstring.viz.style.figure_style`.
        """
        from bowstring.validity.chart_figure import draw

        return draw(self)


def validity_chart(
    robot: Robot | Groups | None = None,
    tolerance: float | str = 0.01,
    *,
    tendon: int = 0,
    tip_force: Sequence[float] = (0.0, 0.0, 0.0),
) -> ValidityChart:
    """Read the validity limits of constant curvature from dimensionless groups.

    Nothing is solved: modules between disks are in closed form, and the response to loads comes
    from a table. `bowstring.run_study` gives the exact limit.

    Parameters
    ----------
    robot : Robot or Groups, optional
        Robot with one segment and equally spaced disks, with its gravity and friction; or its
        groups. Without one the chart has a figure only.
    tolerance : float or str
        Tolerated tip error: a share of the length, 0.01 or "1 %", or, of a robot, "0.5 mm".
    tendon : int
        Index of the actuated tendon, from 0; the other tendons have no tension.
    tip_force : array_like (3,)
        Dead force at the tip in base axes, N; not with groups.

    Returns
    -------
    ValidityChart
        Limits with intervals, and `figure`.

    Raises
    ------
    InputError
        If the robot is not of the chart's class or an argument is wrong.

    Examples
    --------
    >>> import bowstring as bs
    >>> chart = bs.validity_chart(bs.load_robot("amouri2019"))
    >>> print(chart["cc_from_force"].text)
    From force through the linear law, constant curvature holds to 1 % of length up to 56.1 N ...
    """
    tolerance = validation.share_of_length("tolerance", tolerance, getattr(robot, "length", None))
    if robot is None:
        return ValidityChart(tolerance, None, (), np.zeros(0), {})
    per_tension = None
    if isinstance(robot, Groups):
        if np.any(tip_force):
            raise InputError("tip_force is for a robot; groups have a tip force number")
        groups = robot
    else:
        groups = Groups.of(robot, tendon, tip_force)
        per_tension = bend_per_tension(robot, tendon)
    errors = chart_errors(groups)
    outside = groups.outside
    if not TOLERANCES[0] <= tolerance <= TOLERANCES[1]:
        tested = " to ".join(in_percent(t) for t in TOLERANCES)
        untested = f"the tolerance is {in_percent(tolerance)} (tested {tested})"
        outside = f"{outside} and {untested}" if outside else untested
    limits = tuple(_limit(i, errors, tolerance, outside, per_tension) for i in range(len(MODELS)))
    by_name = dict(zip(MODELS, errors.error, strict=True))
    return ValidityChart(tolerance, groups, limits, errors.linear_bend, by_name)


def _limit(
    model: int, errors: ChartErrors, tolerance: float, outside: str, per_tension: float | None
) -> Limit:
    phi, error, uncertainty = errors.linear_bend, errors.error[model], errors.uncertainty[model]
    at, throughout = _crossing(phi, error, tolerance)
    low, _ = _crossing(phi, error + uncertainty, tolerance)
    high, _ = _crossing(phi, error - uncertainty, tolerance)
    tension, interval = None, None
    if per_tension is not None:
        tension, interval = at / per_tension, (low / per_tension, high / per_tension)
    limit = Limit(
        name=MODELS[model],
        linear_bend=at,
        low=low,
        high=high,
        bend=float(np.interp(at, phi, errors.bend)),
        throughout=throughout,
        reliable=False,
        tension=tension,
        tension_interval=interval,
        text="",
    )
    reliable = not outside and limit.error <= _RELIABLE
    return replace(limit, reliable=reliable, text=_in_words(limit, tolerance, outside))


def _crossing(bend: Floats, error: Floats, tolerance: float) -> tuple[float, bool]:
    """First crossing of the tolerance, and whether the error never reaches it."""
    above = error > tolerance
    if not above.any():
        return float(bend[-1]), True
    i = int(np.argmax(above))
    if i == 0:
        return 0.0, False
    share = (tolerance - error[i - 1]) / (error[i] - error[i - 1])
    return float(bend[i - 1] + share * (bend[i] - bend[i - 1])), False


def _in_words(limit: Limit, tolerance: float, outside: str) -> str:
    def shown(a: float, b: float) -> str:
        degrees = [significant(math.degrees(v)) for v in (a, b)]
        return f"{degrees[0] if a == b else ' to '.join(degrees)} deg of linear bend"

    at, interval = shown(limit.linear_bend, limit.linear_bend), shown(limit.low, limit.high)
    if limit.tension is not None and limit.tension_interval is not None:
        at = in_newtons(limit.tension, limit.tension)
        interval = in_newtons(*limit.tension_interval)
    words = f"{_LABELS[limit.name]}, constant curvature "
    to = in_percent(tolerance, 3)
    if limit.linear_bend == 0.0:
        words += f"does not hold to {to} of length at any tension"
    elif limit.throughout:
        words += f"holds to {to} of length up to the end of the chart at {at}"
    else:
        words += f"holds to {to} of length up to {at} ({interval})"
    words += "."
    if outside:
        words += f" Not reliable: {outside}."
    elif limit.error > _RELIABLE:
        words += (
            " The limit is sensitive, because the error stays near the tolerance: use the interval."
        )
    return words
