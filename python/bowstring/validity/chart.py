"""Dimensionless validity chart: where constant curvature stops, read without solving the robot.

It is for robots with one segment, equally spaced disks and one actuated tendon. The derivation, the
class of robots and the errors seen are in docs/theory/validity.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import in_newtons, in_percent, significant
from bowstring.validity.chart_errors import MODELS, ChartErrors, Response, chart_errors
from bowstring.validity.chart_groups import Groups, bend_per_tension
from bowstring.viz.style import LIGHT, subplots

if TYPE_CHECKING:
    from matplotlib.axes import Axes
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
        words = (
            "Upper panel, from force: compute B = 12 tolerance n^2 (r/l)/|1 - D| with D = 4 "
            "friction n^2 (r/l), find the curve of the clamped share over the tolerance, and read "
            "the bend F r l/(EI) at which the error first crosses the tolerance. Middle panel, "
            "from lengths: E = sqrt(1 + (2 friction n^2)^2), bend angle between two disks. Lower "
            "panel: move of the tip by a load."
        )
        if self.groups is None:
            return words
        groups, tolerance = self.groups, self.tolerance
        strength, clamped, adds = force_reading(groups, tolerance)
        bend = force_limit(strength, clamped, adds, groups.pitch)
        exact = self["cc_from_force"]
        words += (
            f" Example: n = {groups.disks}, r/l = {significant(groups.pitch)}, tolerance "
            f"{significant(100 * tolerance)} %, clamped share {significant(groups.clamped)}, "
            f"friction {significant(groups.friction)}: B = {significant(strength)}, clamped share "
            f"over tolerance {significant(clamped)}; the limit from force is "
            f"{math.degrees(bend):.0f} deg"
        )
        if exact.tension is not None and exact.linear_bend:
            words += f", or {significant(bend * exact.tension / exact.linear_bend)} N"
        return f"{words}, without loads."

    def figure(self) -> Figure:
        """Draw the chart for a printed page, with the robot's point if one was given.

        Returns
        -------
        matplotlib.figure.Figure
            Draw and save within `bowstring.viz.style.figure_style`.
        """
        return _draw(self)


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


# -- figure: the printed chart, theory Eqs. 9.7 and 9.8 ---------------------------------------

_PITCH: Final = 0.03  # r/l of the curves, on which it has little effect
_CLAMPED_OVER_TOLERANCE: Final = (0, 2, 5, 10, 20, 40)
_CLAMPED: Final = (0.0, 0.01, 0.03, 0.1, 0.25, 0.67)
_COLOURS: Final = ("ink", "blue", "green", "amber", "red", "purple")
_FINE: Final = np.linspace(0.0, 1.0, 2001)[1:] ** 2 * np.pi


def _draw(chart: ValidityChart) -> Figure:
    """Draw the three panels; `figure` of the chart has the details."""
    import matplotlib as mpl

    with mpl.rc_context({"text.parse_math": True}):  # labels are formulas, without text of files
        figure, (force, lengths, loads) = subplots(3, 9.6, height_ratios=(4, 3, 3))
        _from_force(force, chart)
        _from_lengths(lengths, chart)
        _loads(loads, chart)
    return figure


def force_limit(
    strength: float, clamped: float, adds: bool = False, pitch: float = _PITCH
) -> float:
    """Validity limit from force by the printed chart, in bend of the linear law: Eq. 9.7.

    Parameters
    ----------
    strength : float
        B = 12 tolerance n^2 (r/l) / abs(1 - D), with D = 4 friction n^2 (r/l).
    clamped : float
        Clamped share of the spacing, less 1/n of it, over the tolerance.
    adds : bool
        Whether clamps add to the error, D > 1, and not oppose it.
    pitch : float
        Pitch radius over length.

    Returns
    -------
    float
        Limit in rad; pi where the chart ends.
    """
    phi = _FINE
    bent = phi * (1.0 - 1.5 * pitch * phi) + (1.0 if adds else -1.0) * clamped * strength
    above = _lever(phi) * phi * np.abs(bent) > strength
    return float(phi[np.argmax(above)]) if above.any() else math.pi


def lengths_limit(strength: float, clamped: float, adds: bool = False) -> float:
    """Validity limit from lengths by the printed chart, as bend angle of a module: Eq. 9.8.

    Parameters
    ----------
    strength : float
        Tolerance over E = sqrt(1 + (2 friction n^2)^2).
    clamped : float
        Clamped over flexible length of a spacing, over E.
    adds : bool
        Whether friction dominates, 2 friction n^2 > 1, and clamps add to it.

    Returns
    -------
    float
        Limit in rad.
    """
    clamp = clamped / 4.0
    if adds:
        return 12.0 * (math.sqrt(clamp**2 + strength / 6.0) - clamp)
    return math.sqrt(288.0 * (math.sqrt(clamp**4 + strength**2 / 144.0) - clamp**2))


def _lever(theta: Floats) -> Floats:
    """Derivative of an arc's tip by its bend angle, over the length."""
    half = np.sin(theta / 2.0) / (theta / 2.0)
    return np.sqrt(np.maximum(1.0 + half**2 - 2.0 * np.sin(theta) / theta, 0.0)) / theta


def force_reading(groups: Groups, tolerance: float) -> tuple[float, float, bool]:
    """Arguments of `force_limit` for a robot."""
    size = groups.pitch * groups.disks**2
    friction = 1.0 - 4.0 * groups.friction * size
    strength = 12.0 * tolerance * size / max(abs(friction), 1e-9)
    return strength, groups.clamped * (1.0 - 1.0 / groups.disks) / tolerance, friction < 0.0


def lengths_reading(groups: Groups, tolerance: float) -> tuple[float, float, bool]:
    """Arguments of `lengths_limit` for a robot."""
    friction = 2.0 * groups.friction * groups.disks**2
    whole = math.hypot(1.0, friction)
    return tolerance / whole, groups.clamped / (1.0 - groups.clamped) / whole, friction > 1.0


def _curves(
    axes: Axes,
    strengths: Floats,
    clamps: Sequence[float],
    limit: Callable[[float, float, bool], float],
    unit: float = 1.0,
) -> None:
    """Draw the limit in degrees over the strength by clamped share, dashed where clamps add."""
    for clamped, colour in zip(clamps, _COLOURS, strict=True):
        for adds in (False, True)[: 2 if clamped else 1]:
            limits = np.degrees([limit(strength, clamped, adds) for strength in strengths])
            line: dict[str, Any] = {"color": LIGHT[colour], "lw": 1.0 if adds else 1.6}
            label = None if adds else f"{clamped:g}"
            axes.loglog(unit * strengths, limits, "--" if adds else "-", label=label, **line)


def _from_force(axes: Axes, chart: ValidityChart) -> None:
    def within_chart(strength: float, clamped: float, adds: bool) -> float:
        bend = force_limit(strength, clamped, adds)
        return bend if bend < math.pi else math.nan

    _curves(axes, np.geomspace(0.02, 40.0, 161), _CLAMPED_OVER_TOLERANCE, within_chart)
    axes.set(
        xlabel=r"$B = 12\,\varepsilon\,n^2\,(r/l)\,/\,|1-D|$,   $D = 4\,\mu\,n^2\,(r/l)$",
        ylabel=r"limit: bend $F r l/(EI)$ (deg)",
        xlim=(0.02, 40.0),
        ylim=(0.6, 180.0),
    )
    _plain_ticks(axes, (1, 2, 5, 10, 20, 45, 90, 180), (0.1, 1, 10))
    title = r"clamped share $(1-1/n)\,c n/l$ over $\varepsilon$; dashed where $D > 1$"
    axes.legend(title=title, ncols=6, loc="lower right", **_LEGEND)
    axes.set_title("From force, linear law, without loads", pad=6)
    if chart.groups is not None:
        limit = chart["cc_from_force"]
        if limit.linear_bend and not limit.throughout:
            strength = force_reading(chart.groups, chart.tolerance)[0]
            low, at, high = np.degrees([limit.low, limit.linear_bend, limit.high])
            axes.errorbar(strength, at, [[at - low], [high - at]], **_POINT)


def _from_lengths(axes: Axes, chart: ValidityChart) -> None:
    _curves(axes, np.geomspace(2e-5, 0.05, 80), _CLAMPED, lengths_limit, 100.0)
    axes.set(
        xlabel=r"$\varepsilon/E$ (% of length),   $E^2 = 1 + (2\,\mu\,n^2)^2$",
        ylabel="limit: bend angle of\na module (deg)",
        xlim=(0.002, 5.0),
        ylim=(0.02, 500.0),
    )
    _plain_ticks(axes, (0.1, 1, 2, 5, 10, 20, 45, 90), (0.01, 0.1, 0.5, 1, 2, 5))
    title = "clamped over flexible length, over $E$\n" r"(dashed where $2\,\mu\,n^2 > 1$)"
    axes.legend(title=title, ncols=3, loc="upper left", **_LEGEND)
    axes.set_title("From lengths, without loads", pad=6)
    if chart.groups is not None:
        limit = chart["cc_from_lengths"]
        if limit.linear_bend and not limit.throughout:
            strength = lengths_reading(chart.groups, chart.tolerance)[0]
            at = math.degrees(limit.bend) / chart.groups.disks
            axes.errorbar(100 * strength, at, **_POINT)


def _loads(axes: Axes, chart: ValidityChart) -> None:
    small, bends = 0.02, np.linspace(0.0, np.pi, 60)
    names = ("towards the tendon", "across the bend", "along the base's axis")
    for k, (name, colour) in enumerate(zip(names, ("blue", "green", "red"), strict=True)):
        for first, line in ((3, "-"), (0, "--")):
            loads = np.zeros((len(bends), 6))
            loads[:, first + k] = small
            moved = Response.load()(bends, np.full(len(bends), 1.0 / 1.3), loads)[:, :3]
            size = 100 * np.linalg.norm(moved, axis=1) * 0.1 / small
            label = name if first else None
            axes.plot(np.degrees(bends), size, line, color=LIGHT[colour], label=label)
    axes.set(
        xlabel=r"bend angle $\theta$ (deg)",
        ylabel="the tip moves by\n(% of length)",
        xlim=(0.0, 180.0),
        ylim=(0.0, 4.8),
        xticks=range(0, 181, 30),
    )
    axes.legend(fontsize=8.0, loc="upper right")
    axes.set_title(
        "Loads: tip force number $P l^2/(EI) = 0.1$ (solid),\n"
        "weight number $w l^3/(EI) = 0.1$ (dashed)",
        pad=6,
    )
    if chart.groups is not None:
        bend = math.degrees(chart["cc_from_force"].bend)
        axes.axvline(bend, color=LIGHT["ink"], lw=0.8)


_LEGEND: Final[dict[str, Any]] = {
    "title_fontsize": 8.0,
    "fontsize": 8.0,
    "handlelength": 1.4,
    "columnspacing": 1.0,
}
_POINT: Final[dict[str, Any]] = {
    "fmt": "o",
    "color": LIGHT["ink"],
    "markersize": 5,
    "capsize": 3,
    "lw": 1.0,
    "zorder": 5,
}


def _plain_ticks(axes: Axes, y: Sequence[float], x: Sequence[float]) -> None:
    axes.set_yticks(y, [f"{v:g}" for v in y])
    axes.set_xticks(x, [f"{v:g}" for v in x])
    axes.minorticks_off()
