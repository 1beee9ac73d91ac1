"""Ramp response of a study: dynamics under a rising tension, as for Fig. 5, compared with statics.

The tension rises linearly from zero, with the robot at rest, and is then held. By default the rise
takes 20 periods of the slowest mode with a damping ratio of 5 %. The tip is then within 0.1 % of
length of statics on average (on the built-in robots; a smaller ratio prolongs oscillation, a
larger one increases the lag), and lag, overshoot and oscillation are still visible.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Final

import numpy as np

from bowstring.aliases import Bools, Floats
from bowstring.data.tip_errors import known_max, known_mean
from bowstring.display import short_repr
from bowstring.dynamics import simulation
from bowstring.dynamics.integrator import Integrator
from bowstring.dynamics.load_history import ramp
from bowstring.dynamics.modal import modes
from bowstring.errors import InputError, NoSolutionError
from bowstring.formatting import in_mm, in_percent, listed, significant
from bowstring.results import Key, Result
from bowstring.robot.model import Robot
from bowstring.statics import fields, limits, simulator
from bowstring.study.comparison import Model

if TYPE_CHECKING:
    from bowstring.dynamics.simulation import Status

MODAL_DAMPING: Final = 0.05
"""Default modal damping ratio."""
_RISE: Final = 20.0  # periods of the slowest mode
_SHORTEST_RISE: Final = 0.25  # periods
_LONGEST_RISE: Final = 200.0  # periods
_HOLD: Final = 5.0  # periods
_OUTPUTS: Final = 24  # outputs per period
_TOLERANCE: Final = 1e-7  # tolerance of a step over length, for three correct digits
_ELEMENTS: Final = (1, 2, 4, 8)  # elements per module, for stress and strain at rest
_SAME: Final = 1e-4  # difference of equal tips over length; lumped masses cause 1e-6


# -- what is computed --------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True)
class Surface(Result):
    """Largest stress and strain on the surface of the whole backbone, by load or time."""

    von_mises: Annotated[Floats, Key("von_mises_max_MPa")]
    """Von Mises stress (K,), Pa; NaN where not computed."""
    normal_stress: Annotated[Floats, Key("normal_stress_max_MPa")]
    """Magnitude of normal stress (K,), Pa; NaN where not computed."""
    strain: Annotated[Floats, Key("strain_max_percent")]
    """Magnitude of axial strain by bending and extension (K,); NaN where not computed."""
    by_segment: Floats
    """Largest von Mises stress (Pa) and strain of each segment (2, K, S)."""


@short_repr
@dataclass(frozen=True)
class Transient(Result):
    """Motion by a ramp of tension, then a hold, and statics at the same tensions."""

    length: float
    """Length of the robot, m."""
    frequency: Annotated[float, Key("slowest_frequency_hz")]
    """Frequency of the slowest mode without tension, Hz."""
    rise: Annotated[float, Key("rise_s")]
    """Rise time, s."""
    hold: Annotated[float, Key("hold_s")]
    """Hold time, s."""
    rise_chosen: bool
    """Whether the program chose `rise`."""
    modal_damping: Annotated[float, Key()]
    """Damping ratio of the slowest modes."""
    mass_damping: Annotated[float, Key("mass_damping_per_s")]
    """Mass-proportional damping, 1/s."""
    material_damping: Annotated[float, Key("material_damping_s")]
    """Kelvin-Voigt damping, s."""
    status: Annotated[Status, Key()]
    """Status as in ``simulate``: ``"converged"``, or why the motion stopped early."""
    reason: Annotated[str, Key()]
    """Reason if it stopped early."""
    time: Annotated[Floats, Key("time_s")]
    """Time (K,), s."""
    tension: Annotated[Floats, Key("tension_N")]
    """Tension of the actuated tendon (K,), N."""
    tip_position: Annotated[Floats, Key("tip_position_mm")]
    """Tip (K, 3), m."""
    surface: Annotated[Surface, Key(flat=True)]
    """Largest stress and strain at each time (K,)."""
    static_tip: Floats
    """Tip by statics at the same tension (K, 3), m; NaN without equilibrium."""
    load_tip: Floats
    """Tip at the loads of the study (n, 3), m; NaN where not reached."""
    load_lengths: Floats
    """Tendon lengths at the loads of the study (n, T), m."""
    peak: tuple[float, float] | None
    """Time (s) and size (m) of the overshoot: largest distance of the tip beyond the static tip
    along the static path during the hold."""

    @property
    def converged(self) -> bool:
        """Whether the motion converged to its end."""
        return self.status == "converged"

    @property
    def displacement(self) -> Annotated[Floats, Key("tip_displacement_mm")]:
        """Displacement of the tip since the start (K,), m."""
        return np.asarray(np.linalg.norm(self.tip_position - self.tip_position[0], axis=-1))

    @cached_property
    def difference(self) -> Floats:
        """Distance of the tip from statics (K,), m."""
        return np.asarray(np.linalg.norm(self.tip_position - self.static_tip, axis=-1))

    @property
    def rising(self) -> Bools:
        """Output times before the hold (K,)."""
        return self.time <= self.rise * (1 + 1e-9)

    @property
    def mean_difference(self) -> Annotated[float, Key("difference_from_statics_mean_mm")]:
        """Mean distance of the tip from statics over the rise, m; NaN without an equilibrium."""
        return known_mean(self.difference[self.rising])

    @property
    def max_difference(self) -> tuple[float, float]:
        """Largest difference over the rise, m, and its tension, N."""
        rising = np.where(self.rising, self.difference, math.nan)
        if not np.isfinite(rising).any():
            return math.nan, math.nan
        return known_max(rising), float(self.tension[np.nanargmax(rising)])

    @property
    def largest_difference(self) -> Annotated[float, Key("difference_from_statics_max_mm")]:
        """Largest distance over the rise, m; NaN without an equilibrium."""
        return self.max_difference[0]

    @property
    def largest_difference_at(self) -> Annotated[float, Key("difference_from_statics_max_at_N")]:
        """Tension at the largest distance, N; NaN without an equilibrium."""
        return self.max_difference[1]

    @property
    def overshoot(self) -> Annotated[float | None, Key("overshoot_mm")]:
        """Overshoot of the tip during the hold, m; None without one."""
        return self.peak[1] if self.peak else None

    @property
    def overshoot_share(self) -> Annotated[float | None, Key("overshoot_percent")]:
        """Overshoot as a share of the length; None without one."""
        return self.peak[1] / self.length if self.peak else None

    @property
    def overshoot_at(self) -> Annotated[float | None, Key("overshoot_at_s")]:
        """Time of the overshoot, s; None without one."""
        return self.peak[0] if self.peak else None

    @property
    def lag(self) -> Annotated[float, Key("lag_s")]:
        """Mean lag of the motion behind statics over the rise, s; NaN if they cannot be compared.

        Along the line from the first to the last static tip of the rise, by the area between the
        two curves, so that oscillations cancel.
        """
        still, moving = self.static_tip[self.rising], self.tip_position[self.rising]
        way = still[-1] - still[0]
        size = float(way @ way)
        if not size > 0.0:
            return math.nan
        behind = (still - moving) @ way / size
        steps = np.diff(self.time[self.rising])
        return float(np.sum(0.5 * (behind[1:] + behind[:-1]) * steps))

    @property
    def residual(self) -> Annotated[float, Key("residual_mm")]:
        """Largest distance of the tip from statics in the last slowest period of the hold, m; NaN
        if the motion stopped before."""
        if not self.converged:
            return math.nan
        return known_max(self.difference[self.time >= self.time[-1] - 1.0 / self.frequency])

    @property
    def text(self) -> Annotated[tuple[str, ...], Key()]:
        """Settings and results in sentences."""
        periods = self.rise * self.frequency
        chosen = " (chosen by the program)" if self.rise_chosen else ""
        out = [
            f"The tension rises in {significant(self.rise)} s{chosen}, {significant(periods)} "
            f"periods of the slowest mode ({significant(self.frequency)} Hz), and is held for "
            f"{significant(self.hold)} s; damping is {in_percent(self.modal_damping)} of critical."
        ]
        if not self.converged:
            out.append(
                f"The motion stopped at {significant(float(self.time[-1]))} s, at "
                f"{significant(float(self.tension[-1]))} N: {self.reason}. What follows is up to "
                "there."
            )
        largest, where = self.max_difference
        if math.isfinite(largest):
            words = (
                f"At the same tension the tip is {in_mm(self.mean_difference)} "
                f"({in_percent(self.mean_difference / self.length)} of length) from statics in the "
                f"mean over the rise, at most {in_mm(largest)} at {significant(where)} N"
            )
            if math.isfinite(self.lag):
                verb = "lags" if self.lag >= 0 else "leads"
                words += f"; it {verb} by {significant(abs(self.lag) * 1e3)} ms"
            out.append(words + ".")
        if self.peak is not None:
            when, size = self.peak
            share = in_percent(size / self.length)
            words = (
                "After the rise, while the tension is constant, the tip overshoots by "
                f"{in_mm(size)} ({share} of length) at {significant(when)} s"
            )
            if math.isfinite(self.residual):
                words += f"; in the last period of the hold it is {in_mm(self.residual)} off"
            out.append(words + ".")
        return tuple(out)


# -- computing it ------------------------------------------------------------------------------


def slowest_frequency(model: Model) -> float:
    """Compute the lowest natural frequency of the robot without tension, Hz.

    Raises
    ------
    InputError
        If the robot has no mass.
    NoSolutionError
        If there is no stable equilibrium to oscillate about.
    """
    main = model.main
    found = modes(model.robot, load=main.load, model=main.model, count=1)
    if not len(found):
        raise NoSolutionError(f"{model.robot.name}: no mode was found")
    return float(found.frequency_hz[0])


def check_rise(robot: Robot, rise: float, frequency: float) -> None:
    """Raise `InputError` if a rise is too short to be meaningful, or too long to compute."""
    shortest, longest = _SHORTEST_RISE / frequency, _LONGEST_RISE / frequency
    if not shortest <= rise <= longest:
        rule = (
            f"from {significant(shortest)} to {significant(longest)} s, a quarter to "
            f"{_LONGEST_RISE:g} of the slowest periods of {robot.name}"
        )
        message = f"the rise takes {rise:g} s; must be {rule}"
        raise InputError(message, argument="rise", value=f"{rise:g} s", rule=rule)


def transient(
    model: Model,
    tension: Floats,
    frequency: float,
    rise: float | None = None,
    modal_damping: float = MODAL_DAMPING,
    progress: Callable[[float], None] | None = None,
) -> Transient:
    """Simulate a linear rise to the last of these tensions, and a hold.

    Parameters
    ----------
    model : Model
        Model with the assumptions of the main sweep.
    tension : ndarray (n,)
        Loads of the study in equal steps from zero, N; each is reached at the end of a time step.
    frequency : float
        Frequency from `slowest_frequency`, Hz.
    rise : float, optional
        Rise time in s; by default 20 periods of the slowest mode without tension.
    modal_damping : float
        Damping ratio of the slowest modes.
    progress : callable, optional
        Progress callback, called with the finished share.

    Returns
    -------
    Transient
        Motion, also one that stopped early.

    Raises
    ------
    InputError, NoSolutionError
        If the motion cannot begin.
    """
    robot, main = model.robot, model.main
    chosen = rise is None
    rise = _RISE / frequency if rise is None else rise
    hold = _HOLD / frequency
    top, loads = float(tension[-1]), len(tension) - 1
    often = max(1, math.ceil(_OUTPUTS * rise * frequency / loads))
    run = simulation.simulate(
        robot,
        ramp(model.tensions(tension[-1:])[0], rise),
        rise + hold,
        load=main.load,
        model=main.model,
        integrator=Integrator(modal_damping=modal_damping, tolerance=_TOLERANCE * model.length),
        output=simulation.Output(every=rise / (often * loads), progress=progress),
    )
    frames = run.frames
    if frames is None:
        raise NoSolutionError(f"{robot.name}: {run.message}")
    tension = np.minimum(top * run.time / rise, top)
    reached = min(len(run.time), often * loads + 1)

    still = model.solve(main, tension[:reached]).tip_position
    beside = np.concatenate([still, np.repeat(still[-1:], len(run.time) - reached, axis=0)])
    at_loads = slice(0, reached, often)
    load_tip = np.full((loads + 1, 3), math.nan)
    load_lengths = np.full((loads + 1, len(robot.tendons.segment)), math.nan)
    known = len(run.time[at_loads])
    load_tip[:known] = run.tip_position[at_loads]
    load_lengths[:known] = frames.tendon_length[at_loads]

    return Transient(
        length=model.length,
        frequency=frequency,
        rise=rise,
        hold=hold,
        rise_chosen=chosen,
        modal_damping=modal_damping,
        mass_damping=run.settings["mass_damping_per_s"],
        material_damping=run.settings["material_damping_s"],
        status=run.status,
        reason=run.reason,
        time=run.time,
        tension=tension,
        tip_position=run.tip_position,
        surface=_surface(model, frames),
        static_tip=beside,
        load_tip=load_tip,
        load_lengths=load_lengths,
        peak=_peak(run, still, rise),
    )


def _peak(run: simulation.Run, still: Floats, rise: float) -> tuple[float, float] | None:
    """Time and size of the largest distance beyond the last static tip along the static path."""
    if run.end <= rise or len(still) < 2 or not np.isfinite(still[-2:]).all():
        return None
    ahead = still[-1] - still[-2]
    size = float(np.linalg.norm(ahead))
    if size == 0.0:
        return None
    times = np.linspace(rise, run.end, 2001)
    beyond = (run.tip_at(times) - still[-1]) @ (ahead / size)
    at = int(np.argmax(beyond))
    return float(times[at]), max(float(beyond[at]), 0.0)


def surface_at_rest(model: Model, tension: Floats, tip: Floats) -> Surface:
    """Stress and strain of equilibria.

    Parameters
    ----------
    model : Model
        Model with the assumptions of the main sweep.
    tension : ndarray (n,)
        Loads, N.
    tip : ndarray (n, 3)
        Tips of the equilibria, m. Stress is NaN where the solver, from the straight robot, finds no
        or another equilibrium.
    """
    found = np.full((3, len(tension)), math.nan)
    by_segment = np.full((2, len(tension), len(model.robot.segments)), math.nan)
    rows = model.tensions(tension) if has_surface(model.robot) else ()
    for i, row in enumerate(rows):
        frames = _frames_at_rest(model, row, tip[i])
        if frames is not None:
            surface = _surface(model, frames)
            found[:, i] = surface.von_mises[0], surface.normal_stress[0], surface.strain[0]
            by_segment[:, i] = surface.by_segment[:, 0]
    von_mises, normal, strain = found
    return Surface(von_mises, normal, strain, by_segment)


def _frames_at_rest(model: Model, tensions: Floats, tip: Floats) -> fields.Frames | None:
    """Fields of the equilibrium with a given tip, with the fewest elements that reproduce it."""
    main = model.main
    for elements in _ELEMENTS:
        try:
            frames = simulator.at_rest(
                model.robot,
                main.load.replace(tensions=tensions),
                main.model.replace(elements=elements),
                points=simulation.DEFAULT_POINTS,
            )
        except NoSolutionError:
            continue
        if np.linalg.norm(frames.disk_position[0, -1] - tip) < _SAME * model.length:
            return frames
    return None


def _surface(model: Model, frames: fields.Frames) -> Surface:
    main = model.main
    section = fields.Section(model.robot, frames.station, frames.module, main.model, partly=True)
    found = fields.derive(model.robot, frames, section)
    von_mises, strain = limits.by_segment(model.robot, frames, section, found)
    return Surface(
        von_mises=_largest(von_mises),
        normal_stress=_largest(found["normal_stress"]),
        strain=_largest(strain),
        by_segment=np.stack([von_mises, strain]),
    )


def _largest(values: Floats) -> Floats:
    """Largest known value of each row (K, ...); NaN without any."""
    known = np.where(np.isnan(values), -math.inf, values).max(axis=1)
    return np.where(np.isfinite(known), known, math.nan)


def has_surface(robot: Robot) -> bool:
    """Whether stress and strain at the surface are computed in any segment."""
    return any(segment.backbone.is_round for segment in robot.segments)


def without_surface(robot: Robot) -> str:
    """Why stress and strain at the surface are not computed, in a sentence.

    Returns
    -------
    str
        Empty where they are computed in all segments.
    """
    left_out: dict[str, list[str]] = {}
    for k, segment in enumerate(robot.segments, 1):
        if segment.backbone.stiffness is not None:
            why = "the section is given by its stiffness matrix, which has no shape"
        elif not segment.backbone.is_round:
            why = "the section is rectangular, and they are computed of round ones only"
        else:
            continue
        left_out.setdefault(why, []).append(str(k))
    if not left_out:
        return ""
    parts = []
    for why, segments in left_out.items():
        whole = len(segments) == len(robot.segments)
        where = "" if whole else f"segment{'s' * (len(segments) > 1)} {listed(segments)}: "
        parts.append(where + why)
    rest = "; the largest values are those of the other segments" if has_surface(robot) else ""
    return f"Stress and strain at the surface are not computed: {'; '.join(parts)}{rest}."
