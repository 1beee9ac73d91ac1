"""Errors of constant curvature over the workspace, under tension limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Bools, Floats, Progress
from bowstring.display import short_repr
from bowstring.formatting import in_mm, in_percent, significant
from bowstring.jobs import threads
from bowstring.results import Key, Result
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot, check_robot, check_tendons
from bowstring.statics import rod
from bowstring.statics.design_sweeps import sweep_designs
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.validation import choice, share_of_length, whole
from bowstring.validity.causes import main_cause
from bowstring.validity.control_commands import drawn_tensions, prepared, sobol_points
from bowstring.validity.design_space import COUPLED
from bowstring.validity.drawn import CELLS, Drawn, draw_bar, draw_cells, extent, keep_open, places
from bowstring.validity.effects import Rods, acting, without
from bowstring.validity.errors import LABELS, LAWS, Ramps, tip_errors
from bowstring.validity.figures import CAUSES, colours_of_causes, handles_of_causes
from bowstring.validity.limit_search import gave_up
from bowstring.validity.map_result import STATES
from bowstring.validity.maps import APART
from bowstring.validity.sentences import in_causes, in_not_examined, undefined_in_words
from bowstring.viz.style import LIGHT, subplots, title_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

_POSES: Final = 2048
_PART: Final = 1024
_ON_THE_WAY: Final = (0.0, 0.5, 1.0)  # loads of a path that looks for a second equilibrium


@dataclass(frozen=True)
class WorkspaceErrors(Result):
    """Errors of one model of constant curvature over the workspace."""

    name: Annotated[str, Key()]
    """Model, as ``--models`` takes it."""
    error: Annotated[Floats, Key("error_percent")]
    """Tip error at each pose (P,), a share of the length; NaN without an equilibrium or an arc."""
    valid: Annotated[float, Key("valid_percent")]
    """Share of the poses with an equilibrium at which the tolerance holds; NaN without such poses.
    """
    causes: Annotated[NDArray[np.str_], Key()]
    """Effect with more than half of the error at each pose (P,), or empty."""
    not_defined: Annotated[int, Key()]
    """Number of poses with an equilibrium at which the model has no arc."""


@short_repr
@dataclass(frozen=True)
class WorkspaceMap(Drawn):
    """Errors of constant curvature at many poses of one robot; made by `workspace_map`."""

    content = "map of the workspace"

    robot: Robot
    """Robot, its friction left out."""
    tolerance: Annotated[float, Key("tolerance_percent")]
    """Tolerated tip error as a share of the length."""
    max_tension: Annotated[Floats, Key("max_tension_N")]
    """Largest tension of each tendon (T,), N."""
    tensions: Annotated[Floats, Key("tensions_N")]
    """Tensions of all tendons at each pose (P, T), N."""
    tip: Annotated[Floats, Key("tip_position_m")]
    """Tips by statics (P, 3), m; NaN without a stable equilibrium."""
    error: dict[str, Floats]
    """Tip errors by model (P,), m; NaN without an equilibrium or an arc."""
    cause: dict[str, NDArray[np.str_]]
    """Effect with more than half of the error at each pose (P,), by model; empty text where none
    has."""
    two_equilibria: Annotated[Bools, Key()]
    """Whether another stable equilibrium was found at the same tensions (P,), so that the robot may
    snap through: which of the two it takes depends on how it came there."""
    gave_up: Bools
    """Whether the solver gave up at a pose (P,), so that it may have an equilibrium."""

    @property
    def largest_tensions(self) -> str:
        """Largest tension of all tendons, or the range of them, in words."""
        low, high = (significant(v) for v in (self.max_tension.min(), self.max_tension.max()))
        return f"{high} N" if low == high else f"{low} to {high} N"

    @property
    def solved(self) -> Bools:
        """Whether a pose has a stable equilibrium (P,)."""
        return np.isfinite(self.tip[:, 0])

    @property
    def unknown(self) -> Bools:
        """Whether a pose is not solved because the solver gave up (P,)."""
        return np.asarray(~self.solved & self.gave_up)

    def undefined(self, name: str) -> Bools:
        """Whether a model has no arc at a pose with an equilibrium (P,)."""
        return self.solved & ~np.isfinite(self.error[name])

    def share_valid(self, name: str) -> float:
        """Share of the poses with an equilibrium at which a model holds the tolerance."""
        if not self.solved.any():
            return float("nan")
        error = self.error[name][self.solved]  # without an arc nothing holds
        return float((error <= self.tolerance * self.robot.length).mean())

    def described(self) -> list[str]:
        """The map in sentences."""
        solved = int(self.solved.sum())
        end = f"{self.largest_tensions} in each tendon"
        out = [
            f"{solved} of {len(self.tip)} poses with at most {end} have a stable equilibrium"
            + (
                f"; the other {len(self.tip) - solved} have no place in the figure."
                if solved < len(self.tip)
                else "."
            )
        ]
        if self.not_solved:
            out.append(
                f"At {self.not_solved} of the others the solver gave up, so that they may have "
                "one; tensions near or beyond the largest that the robot carries end so."
            )
        several = int(self.two_equilibria.sum())
        if several:
            verb = "have" if several > 1 else "has"
            out.append(
                f"{several} of them {verb} another stable equilibrium, so that the robot may snap "
                "through; the errors are those of the one found from the straight robot."
            )
        for name, error in self.error.items():
            known = np.isfinite(error)
            if known.any():
                causes = in_causes(error, self.cause[name], 1, self.tolerance * self.robot.length)
                out.append(
                    f"Constant curvature {LABELS[name]} holds to {in_percent(self.tolerance, 3)} "
                    f"of length at {100.0 * self.share_valid(name):.0f} % of them; mean error "
                    f"{in_mm(float(error[known].mean()))}, largest "
                    f"{in_mm(float(error[known].max()))}{causes}."
                )
            elif solved:
                out.append(f"Constant curvature {LABELS[name]} has no arc at any pose.")
            without = self.undefined(name)
            if without.any():
                out.append(undefined_in_words(name, without[self.solved], things="poses"))
        if self.robot.is_coupled and any(
            (self.cause[name][error > self.tolerance * self.robot.length] == "").any()
            for name, error in self.error.items()
        ):
            out.append(in_not_examined(COUPLED))
        out.append(
            "The figure shows the largest error of the poses in each hexagon, and its cause."
        )
        return out

    @property
    def without_equilibrium(self) -> Annotated[int, Key()]:
        """Number of poses without a stable equilibrium."""
        return int((~self.solved & ~self.gave_up).sum())

    @property
    def not_solved(self) -> Annotated[int, Key()]:
        """Number of poses at which the solver gave up, which may have an equilibrium or not."""
        return int(self.unknown.sum())

    @property
    def errors(self) -> Annotated[list[WorkspaceErrors], Key()]:
        """Errors of each model."""
        return [
            WorkspaceErrors(
                name,
                error / self.robot.length,
                self.share_valid(name),
                self.cause[name],
                int(self.undefined(name).sum()),
            )
            for name, error in self.error.items()
        ]

    def figure(self) -> Figure:
        """Draw the largest error by tip position, and its main cause.

        The workspace of one segment is a surface, seen from above; that of more is drawn by the
        distance from the base's axis and the height.

        Returns
        -------
        matplotlib.figure.Figure
            Two panels for each model.
        """
        return _draw(self)


def workspace_map(
    robot: Robot,
    max_tension: ArrayLike | None = None,
    *,
    poses: int = _POSES,
    tolerance: float | str = 0.01,
    models: Sequence[str] | None = None,
    load: Load | None = None,
    model: RodModel | None = None,
    progress: Progress | None = None,
) -> WorkspaceMap:
    """Compare constant curvature with statics over the workspace of a robot.

    Parameters
    ----------
    robot : Robot
        Its friction is left out.
    max_tension : array_like () or (T,), optional
        Largest tensions in N; by default those that bend each segment by a quarter turn by the
        linear law.
    poses : int
        Number of poses: points of a Sobol' sequence over the tensions of all tendons.
    tolerance : float or str
        Tolerated tip error: a share of the length, 0.01 or "1 %", or a length, "0.5 mm".
    models : sequence of str
        Models of constant curvature, of `bowstring.validity.errors.LAWS`.
    load : Load, optional
        Gravity (that of the robot if left out) and tip force.
    model : RodModel, optional
        As for `bowstring.solve`.
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    WorkspaceMap
        Tips and errors of all poses.

    Raises
    ------
    InputError
        If an argument is wrong, and if no pose with tension has an equilibrium.

    Examples
    --------
    >>> import bowstring as bs
    >>> found = bs.workspace_map(bs.load_robot("amouri2019"), 40.0, poses=256)
    >>> found.share_valid("cc_from_lengths")
    1.0
    """
    check_robot(robot)
    check_tendons(robot, "a map of the workspace")
    whole("poses", poses, 1, 1_000_000)
    tolerance = share_of_length("tolerance", tolerance, robot.length)
    models = ("cc_from_lengths", "cc_from_force") if models is None else tuple(models)
    for name in models:
        choice("models", name, list(LAWS))
    robot, load, model, most = prepared(robot, load, model, max_tension)
    tendons = len(most)
    tensions = drawn_tensions(robot, most, sobol_points(tendons, poses))
    one = Designs(robot, {"segments.0.length": [robot.segments[0].length]})
    rods = Rods(one, model, load)
    effects = acting(rods)
    tip = np.full((poses, 3), np.nan)
    error = {name: np.full(poses, np.nan) for name in models}
    cause = {name: np.full(poses, "", dtype="U16") for name in models}
    two, unknown = np.zeros(poses, dtype=bool), np.zeros(poses, dtype=bool)
    notify = progress or (lambda what, done: None)
    rounds = len(effects) + 1 + tendons
    for first in range(0, poses, _PART):
        rows = slice(first, first + _PART)
        count = min(_PART, poses - first)

        def report(what: str, done: int, first: int = first, count: int = count) -> None:
            notify(what, (first + count * done / rounds) / poses)

        ramps = _poses(rods, tensions[rows])
        tip[rows], unknown[rows] = ramps.tip[0], ramps.gave_up[0]
        solved = np.flatnonzero(ramps.converged[0])  # the others have nothing to compare with
        if not solved.size:
            continue
        at = first + solved
        here = tip_errors(one, ramps, models)
        without_it = {}
        for i, effect in enumerate(effects, 1):
            report("poses", i)
            rest = _poses(without(rods, effect), tensions[at])
            without_it[effect] = tip_errors(one, rest, models)
        for name, value in here.items():
            error[name][at] = value[0, solved]
            shares = {k: found[name][0] / robot.length for k, found in without_it.items()}
            cause[name][at] = main_cause(error[name][at] / robot.length, shares)
        # paths from the largest tension of each tendon alone
        for i, start in enumerate(drawn_tensions(robot, most, np.eye(tendons))):
            report("second equilibria", len(effects) + 1 + i)
            two[at] |= _ends_elsewhere(rods, start, tensions[at], tip[at])
    notify("poses", 1.0)
    return WorkspaceMap(robot, tolerance, most, tensions, tip, error, cause, two, unknown)


def _poses(rods: Rods, tensions: Floats) -> Ramps:
    """Poses (P,) of one robot at tensions (P, T), each solved by itself, as one ramp."""
    found = rod.solve_batch(
        rods.designs.robot, tensions, load=rods.load, model=rods.model, disks=False
    )
    return Ramps(
        np.zeros((1, len(found))),
        tensions[None],
        found.converged[None],
        found.tip_position[None],
        found.tendon_lengths[None],
        found.tip_error[None],
        gave_up(found.status)[None],
    )


def _ends_elsewhere(rods: Rods, start: Floats, tensions: Floats, tip: Floats) -> Bools:
    """Poses (P,) at which a path from some tensions ends in another stable equilibrium."""
    robot = rods.designs.robot
    each = Designs(robot, {"segments.0.length": np.full(len(tip), robot.segments[0].length)})
    path = start + np.array(_ON_THE_WAY)[:, None] * (tensions[:, None] - start)
    end = sweep_designs(each, path, load=rods.load, model=rods.model, threads=threads())
    away = np.linalg.norm(end.tip_position[:, -1] - tip, axis=-1)
    return np.asarray(away > APART * robot.length)  # NaN is not apart


# -- figure -----------------------------------------------------------------------------------

_HOLDS: Final = "holds"  # keys of hexagons beside those of the causes
_NO_ARC: Final = "no arc"
_CROSS: Final[dict[str, Any]] = {
    "marker": "x",
    "ls": "none",
    "color": LIGHT["ink"],
    "ms": 3.0,
    "mew": 0.7,
}
_RING: Final[dict[str, Any]] = {**_CROSS, "marker": "o", "mfc": "none", "ms": 4.0}
_KINDS: Final = (_HOLDS, *CAUSES, "", _NO_ARC)


def _draw(found: WorkspaceMap) -> Figure:
    """Draw the largest error by tip position, and below it its main cause, for each model."""
    names = list(found.error)
    figure, panels = subplots(2 * len(names), 0.8 + 6.4 * len(names), sharex=True)
    present: set[str] = set()
    surface = len(found.robot.segments) == 1
    for i, name in enumerate(names):
        errors, causes = panels[2 * i : 2 * i + 2]
        _errors(figure, errors, found, name)
        present |= _causes(causes, found, name)
        errors.set_title(f"constant curvature {LABELS[name]}: largest error")
        causes.set_title(f"constant curvature {LABELS[name]}: cause of it")
        for panel in (errors, causes):
            panel.set_ylabel("y of the tip (mm)" if surface else "z of the tip (mm)")
            panel.set_aspect("equal", adjustable="box")
            keep_open(panel, places(found.robot, found.tip))
    far = "distance of the tip from the base's axis (mm)"
    panels[-1].set_xlabel("x of the tip (mm)" if surface else far)
    handles = _handles(found, present)
    if handles:
        figure.legend(handles=handles, loc="outside lower left", ncols=1)
    kinds = {2: ~found.solved & ~found.gave_up, 5: found.unknown}
    more = "".join(
        f"\n{int(where.sum())} of {len(found.tip)} poses: {STATES[state]}, not shown"
        for state, where in kinds.items()
        if where.any()
    )
    title = f"{found.robot.name}: workspace to {found.largest_tensions} (simulated){more}"
    title_above(figure, title)
    return figure


def _errors(figure: Figure, panel: Axes, found: WorkspaceMap, name: str) -> None:
    from matplotlib.patheffects import withStroke

    along, up = places(found.robot, found.tip)
    share = found.error[name] / found.robot.length
    cells = draw_cells(panel, (along, up), share, found.tolerance)
    if cells is not None:
        draw_bar(figure, [panel], cells, found.tolerance)
    bright = [withStroke(linewidth=2.5, foreground="white")]  # also on dark colours
    for where, mark in ((found.undefined(name), _CROSS), (found.two_equilibria, _RING)):
        if where.any():
            panel.plot(along[where], up[where], **mark, path_effects=bright)


def _causes(panel: Axes, found: WorkspaceMap, name: str) -> set[str]:
    """Draw the cause of the largest error in each hexagon; return the keys of those drawn."""
    from matplotlib.colors import BoundaryNorm, ListedColormap

    error = found.error[name]
    if found.solved.any() and (error[found.solved] <= found.tolerance * found.robot.length).all():
        words = f"holds to {in_percent(found.tolerance)} at all poses"
        panel.text(0.5, 0.5, words, transform=panel.transAxes, ha="center", va="center")
        along, up = (v[found.solved] for v in places(found.robot, found.tip))
        panel.plot(along, up, ls="none")  # the same range as the panel of the errors
        _room_of_a_bar(panel, panel.scatter([], [], c=[]))
        panel.grid(False)
        return {_HOLDS}
    along, up = places(found.robot, found.tip)
    outside = ~(error <= found.tolerance * found.robot.length)
    keys = np.where(outside, found.cause[name], _HOLDS)
    keys = np.where(found.undefined(name), _NO_ARC, keys)
    kind = np.array([_KINDS.index(str(key)) for key in keys])
    worst = np.where(found.undefined(name), np.inf, error)
    rows = np.flatnonzero(found.solved)
    if not rows.size:
        return set()

    def of_worst(members: Any) -> float:
        at = np.asarray(members, dtype=int)
        return float(kind[at[np.argmax(worst[at])]])

    colours = ListedColormap(["white", *colours_of_causes().values(), LIGHT["muted"]])
    cells = panel.hexbin(
        along[rows],
        up[rows],
        rows,
        reduce_C_function=of_worst,
        gridsize=CELLS,
        extent=extent((along[rows], up[rows])),
        norm=BoundaryNorm(np.arange(len(_KINDS) + 1) - 0.5, len(_KINDS)),
        cmap=colours,
        linewidths=0.3,
        edgecolors=LIGHT["muted"],
    )
    _room_of_a_bar(panel, cells)
    panel.grid(False)
    shown = np.asarray(cells.get_array()).astype(int)
    return {_KINDS[i] for i in np.unique(shown)}


def _room_of_a_bar(panel: Axes, shown: Any) -> None:
    """Leave the room of a colour bar, so that both panels have one scale."""
    bar: Any = panel.figure.colorbar(shown, ax=panel, label="largest error", format="10.0")
    for part in (bar.outline, bar.solids):
        part.set_visible(False)
    bar.minorticks_off()
    bar.ax.tick_params(colors="none")
    bar.ax.yaxis.label.set_color("none")


def _handles(found: WorkspaceMap, present: set[str]) -> list[Line2D | Patch]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Line2D | Patch] = []
    if _HOLDS in present:
        label = f"holds to {in_percent(found.tolerance)}"
        handles.append(Patch(fc="white", ec=LIGHT["muted"], label=label))
    handles += handles_of_causes(present, not found.robot.is_coupled)
    if _NO_ARC in present:
        handles.append(Line2D([], [], **_CROSS, label=f"pose: {STATES[4]}"))
        handles.append(Patch(fc=LIGHT["muted"], label=STATES[4]))
    if found.two_equilibria.any():
        label = f"pose: {STATES[1]}, the robot may snap through"
        handles.append(Line2D([], [], **_RING, label=label))
    return handles
