"""Reach of a robot under tension limits: tips, dexterity, compliance and payload there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring._core import RodModel
from bowstring.aliases import Bools, Floats, Progress
from bowstring.constant_curvature import RobotArcs
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.formatting import in_mm, in_percent, significant
from bowstring.results import Key
from bowstring.robot.model import Robot, check_robot, check_tendons
from bowstring.statics.equilibria import columns, differentiable
from bowstring.statics.load import Load
from bowstring.statics.rod import solve_batch
from bowstring.validation import floats, row, share_of_length, whole
from bowstring.validity.control_commands import drawn_tensions, no_pose, prepared, sobol_points
from bowstring.validity.dead_loads import gravity_of
from bowstring.validity.drawn import Drawn, extent
from bowstring.viz.style import LIGHT, WIDTH, log_ticks, title_above

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_POSES: Final = 2048
_THIRD: Final = 1.0 / 3.0
_FIRST: Final = 0.25  # of the payload by the largest compliance: where the search begins
_GROWTH: Final = 1.5
_MOST: Final = 10.0  # times the payload by the compliance: where the search ends
_HALVINGS: Final = 20
_SHARES: Final = 0.03, 0.06, 0.3  # of the work: starts of derivatives, payloads, bisection
_ROUNDING: Final = 1e-9  # value over the largest, below which it is zero


@short_repr
@dataclass(frozen=True)
class Reach(Drawn):
    """Tips under tension limits by physics and by constant curvature; made by `reach`.

    Numbers of a pose are NaN without a stable equilibrium.
    """

    content = "figure of the reach"

    robot: Robot
    """Robot, its friction left out."""
    load: Load
    """Dead loads."""
    max_tension: Annotated[Floats, Key("max_tension_N")]
    """Largest tension of each tendon (T,), N."""
    tensions: Annotated[Floats, Key("tensions_N")]
    """Drawn tensions (P, T), N."""
    tip: Annotated[Floats, Key("tip_position_m")]
    """Tips by physics (P, 3), m; NaN without a stable equilibrium."""
    arc_tip: Annotated[Floats, Key("constant_curvature_tip_m")]
    """Tips by constant curvature at the same tensions (P, 3), m: the linear law, without loads."""
    by_share: Floats
    """Derivative of the tip by each tension over its largest one (P, 3, T), m."""
    compliance: Annotated[Floats, Key("compliance_m_per_N")]
    """Tip displacement by a force on the tip at fixed tensions (P, 3, 3), m/N; NaN without a stable
    equilibrium."""
    payload_direction: Annotated[Floats, Key()]
    """Direction of the payload's force in base axes (3,), of length one."""
    tolerance: Annotated[float, Key("tolerance_percent")]
    """Displacement that a payload may cause, as a share of the length."""
    payload: Annotated[Floats, Key("payload_N")]
    """Largest force on the tip in that direction whose displacement stays within the tolerance
    (P,), N; infinite where ten times the force by the compliance moves it less."""

    @property
    def solved(self) -> Bools:
        """Whether a pose has a stable equilibrium (P,)."""
        return np.isfinite(self.tip[:, 0])

    @property
    def _singular(self) -> Floats:
        """Singular values of `by_share` in directions that the robot has (P, 2) or (P, 3)."""
        out = np.full((len(self.tip), 3), np.nan)
        out[self.solved] = 0.0  # one or two tendons move the tip in as many directions
        values = np.linalg.svd(self.by_share[self.solved], compute_uv=False)
        out[self.solved, : values.shape[1]] = values
        return out[:, : min(3, 2 * len(self.robot.segments))]

    @property
    def manipulability(self) -> Annotated[Floats, Key()]:
        """Product of the singular values of the tip's derivative by all tensions over their largest
        ones (P,): m^2 for one segment, m^3 for more; NaN without a stable equilibrium.

        The tip of one segment moves on a surface (Yoshikawa 1985).
        Zero where the tendons are too few to move the tip in all of these directions.
        """
        return np.asarray(self._singular.prod(axis=-1))

    @property
    def dexterity(self) -> Annotated[Floats, Key()]:
        """Least over largest of these singular values (P,), 1 where the tip moves alike in all
        directions; NaN without a stable equilibrium.

        Zero where the tendons are too few to move the tip in all of them.
        """
        values = self._singular
        return np.asarray(values[:, -1] / values[:, 0])

    @property
    def softness(self) -> Floats:
        """Largest principal compliance (P,), m/N."""
        out = np.full(len(self.tip), np.nan)
        out[self.solved] = np.linalg.norm(self.compliance[self.solved], 2, axis=(1, 2))
        return out

    def described(self) -> list[str]:
        """The result in sentences."""
        solved = self.solved
        count = int(solved.sum())
        out = [
            f"{count} of {len(solved)} drawn poses {'has' if count == 1 else 'have'} a stable "
            "equilibrium: the tip is "
            f"{_span(1e3 * np.hypot(*self.tip[solved, :2].T))} mm from the axis of the base, "
            f"{_span(1e3 * self.tip[solved, 2])} mm along it."
        ]
        away = np.linalg.norm(self.tip - self.arc_tip, axis=1)[solved]
        out.append(
            f"At the same tensions constant curvature has the tip {in_mm(float(away.mean()))} away "
            f"in the mean ({in_percent(float(away.mean()) / self.robot.length, 2)} of length), "
            f"{in_mm(float(away.max()))} at most; it knows no loads."
        )
        out.append(
            f"Dexterity is {_span(self.dexterity[solved])}; the softest direction gives "
            f"{_span(1e3 * self.softness[solved])} mm/N."
        )
        carried = self.payload[solved]
        known = carried[np.isfinite(carried)]
        where = "(" + ", ".join(f"{v:.3g}" for v in self.payload_direction) + ")"
        limit = f"{in_percent(self.tolerance)} of length"
        if known.size:
            out.append(
                f"The payload, the largest force in direction {where} that moves the tip by at "
                f"most {limit}, is {_span(known)} N."
            )
        if known.size < carried.size:
            out.append(
                f"At {carried.size - known.size} of {count} poses the payload is beyond {_MOST:g} "
                f"times the force that moves the tip by {limit} by its compliance."
            )
        out.append("All numbers are simulated, at fixed tensions.")
        return out

    def figure(self) -> Figure:
        """Draw both reachable sets, dexterity, compliance and payload.

        Returns
        -------
        matplotlib.figure.Figure
            Four panels by the distance from the base's axis and the height.
        """
        return _draw(self)


def _span(values: Floats) -> str:
    largest = float(np.abs(values).max())
    ends = (float(values.min()), float(values.max()))
    low, high = (significant(v if abs(v) > _ROUNDING * largest else 0.0) for v in ends)
    return low if low == high else f"{low} to {high}"


def reach(
    robot: Robot,
    max_tension: ArrayLike | None = None,
    *,
    poses: int = _POSES,
    payload_direction: ArrayLike | None = None,
    tolerance: float | str = 0.01,
    load: Load | None = None,
    model: RodModel | None = None,
    progress: Progress | None = None,
) -> Reach:
    """Find where the tip can be under tension limits, and how it moves, yields and carries there.

    Poses are drawn between zero and the largest tensions (chambers push, rods do both), half
    of them with most tendons at a limit, so that the boundary shows. Constant curvature stands
    beside physics.

    Parameters
    ----------
    robot : Robot
        Its friction is left out.
    max_tension : array_like () or (T,), optional
        Largest tensions in N; by default those that bend each segment by a quarter turn by the
        linear law.
    poses : int
        Number of poses: points of a Sobol' sequence over the tensions of all tendons.
    payload_direction : array_like (3,), optional
        Direction of the payload's force in base axes; by default that of gravity, and -z without.
    tolerance : float or str
        Displacement that a payload may cause at fixed tensions: a share of the length, 0.01 or
        "1 %", or a length, "0.5 mm".
    load : Load, optional
        Gravity (that of the robot if left out) and dead loads.
    model : RodModel, optional
        As for `bowstring.solve`.
    progress : callable, optional
        Called with a word and the finished share.

    Returns
    -------
    Reach
        Tips, derivatives and payloads of all poses.

    Raises
    ------
    InputError
        If an argument is wrong, and for tendons without derivatives.
    NoSolutionError
        If no drawn pose has a stable equilibrium.

    Examples
    --------
    >>> import bowstring as bs
    >>> found = bs.reach(bs.load_robot("amouri2019"), 60.0, poses=64)
    >>> bool((1e3 * found.softness).max() > 100)  # mm/N
    True
    """
    check_robot(robot)
    check_tendons(robot, "reach")
    whole("poses", poses, 1, 100_000)
    tolerance = share_of_length("tolerance", tolerance, robot.length)
    if robot.is_embedded:
        raise InputError(
            f"the reach needs derivatives, which tendons in the body do not have; {robot.name} has "
            "such tendons"
        )
    robot, load, model, most = prepared(robot, load, model, max_tension)
    if model.tendon_path == "continuous":
        raise InputError(
            "the reach needs derivatives, which continuous tendons do not have; use "
            'tendon_path="straight"'
        )
    direction = _direction(robot, load, payload_direction)
    notify = progress or (lambda what, done: None)
    notify("poses", 0.0)
    tensions = drawn_tensions(robot, most, _drawn(len(most), poses))
    arcs = RobotArcs.from_tensions(robot, tensions)  # refuses tensions that are far too large
    found = solve_batch(robot, tensions, load=load, model=model, disks=False)
    tip = np.where(found.converged[:, None], found.tip_position, np.nan)
    if not found.converged.any():
        raise no_pose(robot, poses)
    by_share = np.full((poses, 3, len(most)), np.nan)
    compliance = np.full((poses, 3, 3), np.nan)
    notify("derivatives", _SHARES[0])
    solved = np.flatnonzero(found.converged)
    by = _derivatives(robot, load, model, tensions[solved])
    by_share[solved], compliance[solved] = by[0] * most, by[1]
    payload = _payload(
        (robot, load, model), tensions, tip, compliance, direction, tolerance * robot.length, notify
    )
    notify("payload", 1.0)
    return Reach(
        robot,
        load,
        most,
        tensions,
        tip,
        np.asarray(arcs.tip.position),
        by_share,
        compliance,
        direction,
        tolerance,
        payload,
    )


def _drawn(tendons: int, poses: int) -> Floats:
    """Shares of the largest tensions (P, T); in every second pose most are at a limit."""
    points = sobol_points(tendons, poses)
    points[1::2] = np.clip((points[1::2] - _THIRD) / _THIRD, 0.0, 1.0)
    return points


def _derivatives(
    robot: Robot, load: Load, model: RodModel, tensions: Floats
) -> tuple[Floats, Floats]:
    """Derivatives of the tips by tensions (P, 3, T) and by a force on the tip (P, 3, 3)."""
    of = differentiable(robot, load, model, 0)
    others = [given.default for given in of.inputs if given.default is not None]
    rows = [np.repeat(row[None], len(tensions), axis=0) for row in others]
    found = of.core.evaluate([tensions, *rows], of.threads, True, False)
    at = columns(of.tendons, len(robot.segments))
    force = [given.name for given in of.inputs].index("tip_force")
    by = found["jacobians"][:, :3]  # rows of the position
    return by[..., at[0]], by[..., at[force]]


def _payload(
    of: tuple[Robot, Load, RodModel],
    tensions: Floats,
    tip: Floats,
    compliance: Floats,
    direction: Floats,
    allowed: float,
    notify: Progress,
) -> Floats:
    """Force (P,) in a direction that moves each tip by the allowed distance, N.

    It grows step by step, so that the first crossing is found, and is then bisected.
    """
    robot, load, model = of
    out = np.full(len(tip), np.nan)
    rows = np.flatnonzero(np.isfinite(tip[:, 0]))
    most = _MOST * allowed / np.linalg.norm(compliance[rows] @ direction, axis=-1)
    force = _FIRST * allowed / np.linalg.norm(compliance[rows], 2, axis=(1, 2))
    given = np.zeros(3) if load.tip_force is None else floats(load.tip_force)

    def within(at: NDArray[np.intp], force: Floats) -> Bools:
        forces = given + force[:, None] * direction
        found = solve_batch(
            robot,
            tensions[rows[at]],
            load=load.replace(tip_force=forces),
            model=model,
            disks=False,
        )
        moved = np.linalg.norm(found.tip_position - tip[rows[at]], axis=-1)
        return np.asarray(found.converged & (moved <= allowed))

    low, high = np.zeros(len(rows)), np.full(len(rows), np.inf)
    at = np.arange(len(rows))
    _, begin, halving = _SHARES
    while at.size:
        notify("payload", begin + (halving - begin) * (1.0 - len(at) / len(rows)))
        good = within(at, force[at])
        low[at[good]], high[at[~good]] = force[at[good]], force[at[~good]]
        force = _GROWTH * force
        at = at[good & (force[at] < most[at])]
    at = np.flatnonzero(np.isfinite(high))
    for i in range(_HALVINGS if at.size else 0):
        notify("payload", halving + (1.0 - halving) * i / _HALVINGS)
        middle = 0.5 * (low[at] + high[at])
        good = within(at, middle)
        low[at[good]], high[at[~good]] = middle[good], middle[~good]
    out[rows] = np.where(np.isfinite(high), low, np.inf)
    return out


def _direction(robot: Robot, load: Load, given: ArrayLike | None) -> Floats:
    if given is None:
        found = gravity_of(robot, load)
        if not found.any():
            found = np.array([0.0, 0.0, -1.0])
    else:
        found = row("payload_direction", given, 3, "")
        if not found.any():
            raise InputError("payload_direction is zero; it must have a length")
    found = found / np.abs(found).max()  # squares stay in range
    return np.asarray(found / np.linalg.norm(found))


# -- figure -----------------------------------------------------------------------------------

_CELLS: Final = 28  # hexagons along an axis
_ELLIPSES: Final = 14
_LEAST: Final = 1e-30  # least payload on the logarithmic scale, N
_SIZE: Final = 0.05  # size of the largest ellipse over the span of the panel


def _draw(found: Reach) -> Figure:
    """Draw both reachable sets, dexterity, compliance and payload."""
    from matplotlib.figure import Figure

    solved = found.solved
    places = _places(found.tip[solved])
    arcs = _places(found.arc_tip)
    both = np.concatenate([places, arcs], axis=1)
    left, right, low, high = extent((both[0], both[1]))
    shape = np.clip((high - low) / (right - left), 0.3, 2.0)  # of a panel
    figure = Figure(figsize=(WIDTH * 1.5, 1.4 + 4.6 * shape), layout="constrained")
    grid: Any = figure.subplots(2, 2, sharex=True, sharey=True)
    sets, dexterity, compliance, payload = grid.ravel()
    sets.plot(*arcs, ".", ms=1.6, color=LIGHT["red"], alpha=0.5, label="constant curvature")
    sets.plot(*places, ".", ms=1.6, color=LIGHT["blue"], alpha=0.5, label="physics")
    sets.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=2,
        markerscale=5.0,
        handletextpad=0.2,
        columnspacing=0.8,
        title="reachable tips",
        alignment="left",
        title_fontsize=9.5,
        borderaxespad=0.1,
        borderpad=0.0,
    )
    _cells(figure, dexterity, places, found.dexterity[solved], "dexterity", "least")
    softness = 1e3 * found.softness[solved]
    _cells(figure, compliance, places, softness, "compliance (mm/N)", "largest")
    _ellipses(compliance, found, places)
    carried = np.where(np.isfinite(found.payload), found.payload, np.nan)[solved]
    known = np.isfinite(carried)
    if known.any():
        norm = "log" if (carried[known] > _LEAST).all() else None  # no logarithm of zero
        _cells(figure, payload, places, carried, "force on the tip (N)", "least", norm)
    else:
        payload.text(0.5, 0.5, "no limit found", transform=payload.transAxes, ha="center")
    payload.set_title(f"payload to {in_percent(found.tolerance)} of length, least")
    for panel in grid[:, 0]:
        panel.set_ylabel("z of the tip (mm)")
    for panel in grid[1]:
        panel.set_xlabel("from the base's axis (mm)")
    for panel in grid.ravel():
        panel.set_aspect("equal", adjustable="box")
        panel.margins(0.06)
    title_above(figure, f"{found.robot.name}: reach and what it can do there (simulated)")
    return figure


def _places(tips: Floats) -> tuple[Floats, Floats]:
    x, y, z = 1e3 * tips.T
    return np.hypot(x, y), z


def _cells(
    figure: Figure,
    panel: Axes,
    places: tuple[Floats, Floats],
    values: Floats,
    label: str,
    which: str,
    norm: str | None = None,
) -> None:
    """Draw the least or the largest value in each hexagon; NaN is left out."""
    known = np.isfinite(values)
    cells = panel.hexbin(
        places[0][known],
        places[1][known],
        values[known],
        reduce_C_function=np.min if which == "least" else np.max,
        gridsize=_CELLS,
        extent=extent(places),
        cmap="viridis",
        linewidths=0.1,
        norm=norm,
    )
    bar = figure.colorbar(cells, ax=panel, label=label)
    if norm == "log":
        log_ticks(bar.ax.yaxis)
    panel.set_title(f"{label.split(' (')[0]}, {which}")


def _ellipses(panel: Axes, found: Reach, places: tuple[Floats, Floats]) -> None:
    """Draw the tip displacements by forces of one size in the plane of the panel, at some poses."""
    from matplotlib.patches import Ellipse

    rows = np.flatnonzero(found.solved)
    points = np.stack(places, axis=-1)
    span = float(np.ptp(points, axis=0).max()) or 1.0
    chosen = [int(np.argmin(points[:, 0]))]
    far = np.full(len(points), np.inf)
    for _ in range(min(_ELLIPSES, len(points)) - 1):
        far = np.minimum(far, np.linalg.norm(points - points[chosen[-1]], axis=-1))
        chosen.append(int(np.argmax(far)))
    shapes = []
    for k in chosen:
        x, y, _ = found.tip[rows[k]]
        angle = np.arctan2(y, x)
        plane = np.array([[np.cos(angle), np.sin(angle), 0.0], [0.0, 0.0, 1.0]])
        directions, sizes, _ = np.linalg.svd(plane @ found.compliance[rows[k]] @ plane.T)
        shapes.append((points[k], sizes, np.degrees(np.arctan2(*directions[::-1, 0]))))
    largest = max(sizes[0] for _, sizes, _ in shapes)
    for centre, sizes, turn in shapes:
        width, height = 2.0 * _SIZE * span * sizes / largest
        panel.add_patch(
            Ellipse(
                (float(centre[0]), float(centre[1])),
                width,
                height,
                angle=float(turn),
                fc="none",
                ec=LIGHT["ink"],
                lw=0.9,
            )
        )
