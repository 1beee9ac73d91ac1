"""Control errors of constant curvature: tips that its commands reach, over workspace and load."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from bowstring._core import RodModel
from bowstring.aliases import Floats, Progress
from bowstring.data.tip_errors import known_max, known_mean
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import in_mm, in_percent, significant
from bowstring.inverse.kinematics import inverse_kinematics
from bowstring.inverse.limits import ActuationLimits
from bowstring.results import Key, Result
from bowstring.robot.model import Robot, check_robot, check_tendons
from bowstring.statics.load import Load
from bowstring.statics.load_tables import acts, scaled
from bowstring.statics.rod import solve_batch
from bowstring.validation import choice, share_of_length, whole
from bowstring.validity.control_commands import (
    BY_ARCS,
    COMMANDS,
    SCALES,
    Commander,
    drawn_tensions,
    no_pose,
    prepared,
    sobol_points,
)
from bowstring.validity.dead_loads import gravity_of
from bowstring.validity.drawn import Drawn, draw_bar, draw_cells, keep_open, places
from bowstring.viz.style import LIGHT, WIDTH, log_ticks, title_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

CommandName = Literal[
    "tensions",
    "tensions_arm",
    "tensions_calibrated",
    "displacements",
    "displacements_chord",
    "physics",
]

_Landed = tuple[Floats, dict[str, Floats], float | None, dict[str, float]]

_POSES: Final = 1024
_TOLERANCE: Final = 0.01
_LANDS: Final = 0.9  # commands with a smaller share of tips with an equilibrium are not compared
_SHARES: Final = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the dead loads


@dataclass(frozen=True)
class ControlSeconds(Result):
    """Time for one command in this run."""

    constant_curvature: Annotated[float, Key()]
    """Tensions by constant curvature, in s."""
    physics: Annotated[float | None, Key()]
    """Exact inverse on all cores, in s; None where it is not available."""


@dataclass(frozen=True)
class ControlDistance(Result):
    """Distances of the tip from the wanted tips."""

    mean: Annotated[float, Key("mean_m")]
    """Mean over the tips that land, m; NaN if none does."""
    rms: Annotated[float, Key("rms_m")]
    """Root mean square over them, m; NaN if none does."""
    largest: Annotated[float, Key("max_m")]
    """Largest of them, m; NaN if none does."""
    valid: Annotated[float, Key("valid_percent")]
    """Share of all wanted tips within the tolerance."""
    without_equilibrium: Annotated[int, Key()]
    """Commands without a stable equilibrium, which are not in the distances."""


@dataclass(frozen=True)
class ControlCommand(Result):
    """Where one command leads."""

    name: Annotated[CommandName, Key()]
    """Command of constant curvature, or ``physics``: the exact inverse."""
    after_corrections: Annotated[list[ControlDistance], Key()]
    """Without a correction, after one, and so on."""
    distance: Annotated[Floats, Key("distance_m")]
    """Distance for each wanted tip (C, P), m; NaN without a stable equilibrium."""


@dataclass(frozen=True)
class ControlByLoad(Result):
    """Distances at shares of the dead loads, without corrections."""

    name: Annotated[str, Key()]
    """Command."""
    mean: Annotated[Floats, Key("mean_m")]
    """Mean distance at each share (F,), m; NaN without an equilibrium."""
    largest: Annotated[Floats, Key("max_m")]
    """Largest distance at each share (F,), m; NaN without an equilibrium."""


@short_repr
@dataclass(frozen=True)
class ControlErrors(Drawn):
    """Distances between wanted tips and where commands lead; made by `control_errors`."""

    content = "figure of the control error"

    robot: Robot
    """Robot, its friction left out."""
    load: Load
    """Dead loads."""
    tolerance: Annotated[float, Key("tolerance_percent")]
    """Tolerated distance as a share of the length; 0.01 unless `with_tolerance` changes it."""
    max_tension: Annotated[Floats, Key("max_tension_N")]
    """Largest tension of each tendon (T,), N."""
    drawn: Annotated[int, Key("poses")]
    """Number of poses drawn; those without a stable equilibrium are not wanted."""
    wanted: Annotated[Floats, Key("wanted_m")]
    """Wanted tips (P, 3), m: each is the tip of a stable equilibrium within the limits."""
    landed: dict[str, Floats]
    """Tips by physics (C + 1, P, 3), m, by command: without a correction, and after each one; NaN
    without a stable equilibrium. The exact inverse has no corrections (1, P, 3)."""
    scale: Annotated[float | None, Key("stiffness_scale")]
    """Factor on the bending stiffness of ``tensions_calibrated``, 0.1 to 10; None without it."""
    seconds: dict[str, float]
    """Time of a command in s, in this call: ``constant_curvature`` and ``physics``."""
    load_shares: Annotated[Floats, Key()]
    """Shares of the dead loads (F,) of `by_load`; empty without dead loads."""
    by_load: dict[str, Floats]
    """Mean and largest distance (F, 2) in m at each share of the dead loads, by command."""

    def with_tolerance(self, tolerance: float | str) -> ControlErrors:
        """Return the same tips with another tolerance, without solving anything again.

        Parameters
        ----------
        tolerance : float or str
            Tolerated distance: a share of the length, 0.01 or "1 %", or a length, "0.5 mm".
        """
        share = share_of_length("tolerance", tolerance, self.robot.length)
        return replace(self, tolerance=share)

    def distance(self, name: str) -> Floats:
        """Distances from the wanted tips after each correction (C + 1, P), m."""
        return np.asarray(np.linalg.norm(self.landed[name] - self.wanted, axis=-1))

    def summary(self, name: str) -> list[ControlDistance]:
        """Distances without a correction of a command of `landed`, after one, and so on."""
        return [
            ControlDistance(
                mean=known_mean(row),
                rms=math.sqrt(known_mean(row**2)),
                largest=known_max(row),
                valid=float((row <= self.tolerance * self.robot.length).mean()),
                without_equilibrium=int((~np.isfinite(row)).sum()),
            )
            for row in self.distance(name)
        ]

    def described(self) -> list[str]:
        """The result in sentences."""
        lost, count = self.without_equilibrium, len(self.wanted)
        wanted = "1 tip of a stable equilibrium within the limits of tension is wanted"
        if count > 1:
            wanted = f"{count} tips of stable equilibria within the limits of tension are wanted"
        verb = "pose has" if lost == 1 else "poses have"
        out = [wanted + (f"; {lost} drawn {verb} no stable equilibrium." if lost else ".")]
        rows = {name: self.summary(name) for name in self.landed if name != "physics"}
        fallen = {name: self.summary(name)[0].without_equilibrium for name in self.landed}
        # a mean over few tips does not compare with that over all tips
        known = [name for name in rows if fallen[name] <= (1.0 - _LANDS) * count]
        if known:
            out += self._compared(rows, known)
        else:
            out.append(
                f"No command of constant curvature leads to a stable equilibrium for "
                f"{100 * _LANDS:.0f} % of the tips, so that none is named the nearest."
            )
        for name, lost in fallen.items():
            if lost:
                label = COMMANDS[name][0].upper() + COMMANDS[name][1:]
                words = "1 command, which has" if lost == 1 else f"{lost} commands, which have"
                out.append(
                    f"{label}: no stable equilibrium is found for {words} no part in the distances."
                )
        if "physics" in self.landed:
            exact = self.summary("physics")[0].largest
            out.append(f"The exact inverse lands {in_mm(exact)} from the wanted tip at most.")
        if self.scale is not None and self.scale in SCALES:
            out.append(
                f"The search for a calibrated bending stiffness ended at its limit, {self.scale:g} "
                "times that of the robot file; the best factor may lie beyond it."
            )
        elif self.scale is not None:
            out.append(
                f"The calibrated bending stiffness is {significant(self.scale, 4)} times that of "
                "the robot file, fitted to these tips."
            )
        out.append(
            "Robot and measured tip are simulated; a correction moves the arcs by the measured "
            "distance with the Jacobian of constant curvature."
        )
        return out

    def _compared(self, rows: dict[str, list[ControlDistance]], known: list[str]) -> list[str]:
        """Sentences on the commands that land nearest and farthest, of those that land."""
        length = self.robot.length
        means = {name: rows[name][0].mean for name in known}
        best, worst = min(known, key=means.__getitem__), max(known, key=means.__getitem__)
        whose = (
            f" with an equilibrium for {100 * _LANDS:.0f} % of the tips"
            if len(known) < len(rows)
            else ""
        )
        text = (
            f"Of the commands of constant curvature{whose}, {COMMANDS[best]} land nearest, "
            f"{in_mm(means[best])} from the wanted tip in the mean "
            f"({in_percent(means[best] / length, 2)} of length) and "
            f"{in_mm(rows[best][0].largest)} at most"
        )
        if worst != best:
            text += (
                f"; {COMMANDS[worst]} land farthest, {in_mm(means[worst])} "
                f"({in_percent(means[worst] / length, 2)}) in the mean"
            )
        out = [text + "."]
        count = max(len(found) for found in rows.values()) - 1
        if count:
            least, most = (f([rows[name][-1].mean for name in known]) for f in (min, max))
            times = "one correction" if count == 1 else f"{count} corrections"
            low, high = in_mm(least), in_mm(most)
            span = low if low == high else f"{low} to {high}"
            out.append(f"After {times} by the measured tip the mean distances are {span}.")
        return out

    @property
    def without_equilibrium(self) -> Annotated[int, Key()]:
        """Number of drawn poses without a stable equilibrium, which are not wanted."""
        return self.drawn - len(self.wanted)

    @property
    def seconds_per_command(self) -> Annotated[ControlSeconds, Key()]:
        """Time for one command in this run."""
        return ControlSeconds(self.seconds["constant_curvature"], self.seconds.get("physics"))

    @property
    def commands(self) -> Annotated[list[ControlCommand], Key()]:
        """All commands."""
        return [
            ControlCommand(name, self.summary(name), self.distance(name))
            for name in cast("dict[CommandName, Floats]", self.landed)
        ]

    @property
    def errors_by_load(self) -> Annotated[list[ControlByLoad], Key("by_load")]:
        """Distances by load; empty without dead loads."""
        return [ControlByLoad(name, *values.T) for name, values in self.by_load.items()]

    def figure(self) -> Figure:
        """Draw the distance over the workspace, after corrections, and by load.

        Returns
        -------
        matplotlib.figure.Figure
            A map for each command of constant curvature, and one or two panels of lines.
        """
        return _draw(self)


def control_errors(
    robot: Robot,
    max_tension: ArrayLike | None = None,
    *,
    poses: int = _POSES,
    corrections: int = 3,
    commands: Sequence[str] | None = None,
    load: Load | None = None,
    model: RodModel | None = None,
    progress: Progress | None = None,
) -> ControlErrors:
    """Command a robot by the inverse of constant curvature and solve where its tip lands.

    Wanted tips are those of equilibria at tensions drawn between zero and the limits, so that each
    can be reached. For each command the robot lands by physics; then its tip is measured (here:
    simulated without noise), the arcs are corrected by the Jacobian of constant curvature, and so
    on. The exact inverse stands beside them.

    Parameters
    ----------
    robot : Robot
        Its friction is left out.
    max_tension : array_like () or (T,), optional
        Largest tensions in N, of the drawn poses and of all commands; by default those that bend
        each segment by a quarter turn by the linear law.
    poses : int
        Number of drawn poses: points of a Sobol' sequence over the tensions of all tendons.
    corrections : int
        Number of corrections by the measured tip, 0 to 20.
    commands : sequence of str, optional
        Of ``tensions`` (linear law), ``tensions_arm`` (mean lever arm of straight spans),
        ``tensions_calibrated`` (linear law with the bending stiffness that fits these tips best),
        ``displacements`` and ``displacements_chord`` (with straight spans between disks); by
        default all that the robot takes.
    load : Load, optional
        Gravity (that of the robot if left out) and dead loads. With dead loads the commands are
        also tried at shares of them.
    model : RodModel, optional
        As for `bowstring.solve`.
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    ControlErrors
        Wanted tips, and where each command leads.

    Raises
    ------
    InputError
        If an argument is wrong, or the robot does not take a command.
    NoSolutionError
        If no drawn pose has a stable equilibrium.

    Examples
    --------
    >>> import bowstring as bs
    >>> found = bs.control_errors(bs.load_robot("rao2021"), poses=64, corrections=1)
    >>> before, after = (row.mean for row in found.summary("tensions"))
    >>> 10 * after < before
    True
    """
    check_robot(robot)
    check_tendons(robot, "the control error")
    whole("poses", poses, 1, 100_000)
    whole("corrections", corrections, 0, 20)
    robot, load, model, most = prepared(robot, load, model, max_tension)
    least = np.where(robot.tendons.pushes, -most, 0.0)
    chosen = _chosen(Commander(robot, load, model, least, most), commands)
    notify = progress or (lambda what, done: None)
    is_loaded = acts(load) or gravity_of(robot, load).any()
    shares = np.array(_SHARES if is_loaded else ())
    rounds = 1.0 + len(shares)
    notify("poses", 0.0)

    def at(part: Load, count: int, times: int, begin: float) -> _Landed:
        def tell(what: str, done: float) -> None:
            notify(what, (begin + done) / rounds)

        commander = Commander(robot, part, model, least, most)
        return _landed(commander, count, chosen, times, tell)

    wanted, landed, scale, seconds = at(load, poses, corrections, 0.0)
    if not len(wanted):
        raise no_pose(robot, poses)
    by_load: dict[str, list[list[float]]] = {name: [] for name in landed}
    for k, share in enumerate(shares):
        part = scaled(load, share).replace(gravity=share * gravity_of(robot, load))
        here, there = wanted, landed
        if share != 1.0:
            here, there, *_ = at(part, min(poses, 256), 0, 1.0 + k)
        for name, rows in by_load.items():
            away = np.linalg.norm(there[name][0] - here, axis=-1)
            rows.append([known_mean(away), known_max(away)])
    notify("poses", 1.0)
    return ControlErrors(
        robot,
        load,
        _TOLERANCE,
        most,
        poses,
        wanted,
        landed,
        scale,
        seconds,
        shares,
        {name: np.array(rows) for name, rows in by_load.items() if rows},
    )


def _landed(
    commander: Commander,
    poses: int,
    names: Sequence[str],
    corrections: int,
    notify: Progress,
) -> _Landed:
    """Wanted tips, tips by command, stiffness scale and seconds, as of `ControlErrors`."""
    robot, load, model = commander.robot, commander.load, commander.model
    points = sobol_points(len(commander.most), poses)
    tensions = drawn_tensions(robot, commander.most, points)
    drawn = solve_batch(robot, tensions, load=load, model=model, disks=False)
    wanted = drawn.tip_position[drawn.converged]
    landed: dict[str, Floats] = {}
    seconds: dict[str, float] = {}
    if not len(wanted):
        return wanted, {name: np.zeros((1, 0, 3)) for name in names}, None, seconds
    steps = len(names) + 1.0
    start = time.perf_counter()
    bends = commander.bends_to(wanted)
    commander.command("tensions", bends)
    seconds["constant_curvature"] = (time.perf_counter() - start) / len(wanted)
    for i, name in enumerate(names):
        notify(COMMANDS[name], i / steps)
        if name == "tensions_calibrated":
            commander.calibrate(bends, wanted)
        rows: list[Floats] = []
        asked = bends
        for k in range(corrections + 1):
            if k > 0:
                asked = commander.corrected(asked, wanted - rows[-1])
            rows.append(commander.land(name, commander.command(name, asked)))
        landed[name] = np.stack(rows)
    if not (robot.is_embedded or model.tendon_path == "continuous"):
        notify(COMMANDS["physics"], len(names) / steps)
        start = time.perf_counter()
        limits = ActuationLimits(max_tension=commander.most)
        exact = inverse_kinematics(robot, wanted, load=load, model=model, limits=limits, path=False)
        seconds["physics"] = (time.perf_counter() - start) / len(wanted)
        landed["physics"] = commander.land("physics", exact.tensions)[None]
    scale = commander.scale if "tensions_calibrated" in names else None
    return wanted, landed, scale, seconds


def _chosen(commander: Commander, names: Sequence[str] | None) -> tuple[str, ...]:
    if names is None:
        return tuple(name for name in BY_ARCS if commander.refusal(name) is None)
    if isinstance(names, str) or not names:
        raise InputError(f"commands is {names!r:.60}, it must be names in a list")
    for name in names:
        choice("commands", name, BY_ARCS)
        refusal = commander.refusal(name)
        if refusal is not None:
            raise InputError(f"{commander.robot.name} takes no commands {name}: {refusal}")
    return tuple(dict.fromkeys(names))


# -- figure -----------------------------------------------------------------------------------

_LOOKS: Final = {
    "tensions": ("blue", "o"),
    "tensions_arm": ("green", "^"),
    "tensions_calibrated": ("amber", "s"),
    "displacements": ("red", "D"),
    "displacements_chord": ("purple", "v"),
}
_TITLES: Final = {
    "tensions": "tensions, linear law",
    "tensions_arm": "tensions, mean arm",
    "tensions_calibrated": "tensions, E I calibrated",
    "displacements": "displacements",
    "displacements_chord": "displacements, chords",
}
_LEAST: Final = 1e-6  # percent of length; lower end of the axes
_HEIGHT: Final = 2.4  # inches, of a panel


def _draw(found: ControlErrors) -> Figure:
    """Draw a map of the distance for each command, and lines over corrections and load."""
    from matplotlib.figure import Figure

    names = [name for name in found.landed if name in _LOOKS]
    loaded = len(found.load_shares) > 0
    corrected = len(found.landed[names[0]]) > 1
    maps, lines = (len(names) + 1) // 2, int(corrected) + int(loaded)
    heights = [_HEIGHT * maps, _HEIGHT * lines + 0.5][: 1 + (lines > 0)]
    figure = Figure(figsize=(WIDTH * 1.3, 0.4 + sum(heights)), layout="constrained")
    parts: Any = figure.subfigures(len(heights), 1, height_ratios=heights, squeeze=False)
    _draw_maps(parts[0, 0], found, names)
    if lines:
        panels = list(parts[1, 0].subplots(lines, 1, squeeze=False)[:, 0])
        if corrected:
            panel = panels[0]
            for name in names:
                rows = found.summary(name)
                _lines(panel, found, name, range(len(rows)), [[r.mean, r.largest] for r in rows])
            panel.set_xlabel("corrections by the measured tip")
            panel.set_xticks(range(len(found.landed[names[0]])))
        if loaded:
            for name in names:
                _lines(panels[-1], found, name, 100.0 * found.load_shares, found.by_load[name])
            panels[-1].set_xlabel("share of the dead loads (%), without corrections")
        for panel in panels:
            _finish(panel, found)
        parts[1, 0].legend(
            *panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2
        )
    title_above(
        figure, f"{found.robot.name}: where commands of constant curvature lead (simulated)"
    )
    return figure


def _draw_maps(part: SubFigure, found: ControlErrors, names: list[str]) -> None:
    rows = (len(names) + 1) // 2
    grid = part.subplots(rows, min(2, len(names)), squeeze=False, sharex=True, sharey=True)
    panels = list(grid.ravel())
    surface = len(found.robot.segments) == 1
    for panel in panels[len(names) :]:
        panel.set_axis_off()
    drawn = None
    for panel, name in zip(panels, names, strict=False):
        share = found.distance(name)[0] / found.robot.length
        at = places(found.robot, found.wanted)
        cells = draw_cells(panel, at, share, found.tolerance)
        drawn = drawn if cells is None else cells
        panel.set_title(_TITLES[name])
        panel.set_aspect("equal", adjustable="box")
        keep_open(panel, at)
        panel.tick_params(labelbottom=True)
    for row in grid:
        row[0].set_ylabel("y of the wanted tip (mm)" if surface else "z of the wanted tip (mm)")
    for panel in panels[max(0, len(names) - 2) : len(names)]:
        panel.set_xlabel("x of the wanted tip (mm)" if surface else "from the axis (mm)")
    if drawn is not None:
        draw_bar(part, panels, drawn, found.tolerance, "distance")


def _lines(panel: Axes, found: ControlErrors, name: str, at: Any, values: Any) -> None:
    colour, mark = _LOOKS[name]
    share = 100.0 * np.asarray(values, dtype=float) / found.robot.length
    mean, most = np.maximum(share, _LEAST).T
    panel.plot(at, mean, color=LIGHT[colour], marker=mark, label=COMMANDS[name])
    panel.plot(at, most, color=LIGHT[colour], marker=mark, ls="--", mfc="none")


def _finish(panel: Axes, found: ControlErrors) -> None:
    tolerance = max(100.0 * found.tolerance, _LEAST)
    panel.axhline(tolerance, color=LIGHT["ink"], lw=1.0, ls=":")
    panel.annotate(
        f"tolerance\n{in_percent(found.tolerance)}",
        (1.0, tolerance),
        xycoords=("axes fraction", "data"),
        xytext=(4, 0),
        textcoords="offset points",
        ha="left",
        va="center",
        fontsize=8.0,
    )
    panel.set_yscale("log")
    log_ticks(panel.yaxis)
    panel.set_ylabel("distance (% of length)\nmean; dashed: largest")
