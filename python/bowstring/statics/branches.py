"""Branches of equilibria along a load: limit points, bifurcations, critical loads.

All values are in SI and in the base frame (z along the straight backbone) by default.
N is the number of disks, T the number of tendons. docs/theory/statics.md has the equations.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import numpy as np

from bowstring import validation
from bowstring._core import follow_branches
from bowstring.aliases import Floats, Ints
from bowstring.display import short_repr
from bowstring.errors import InputError, NoSolutionError
from bowstring.results import Key, Result
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import check_robot, check_without_laws
from bowstring.statics.load import Load, as_load
from bowstring.statics.load_tables import (
    FORCE,
    MOMENT,
    POINT_NUMBERS,
    acts,
    same_points,
    with_arrays,
    without_wrenches,
)
from bowstring.statics.model import as_model

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot

Kind = Literal["limit_point", "bifurcation"]
End = Literal["range", "closed", "joined", "collision", "unstable", "points", "lost"]

_SAME: Final = 1e-6  # distance between disks over length below which two equilibria are equal
_MOST_CUT: Final = 3  # branches that end early and that the text names
_ENDS: Final = {
    "range": "the end of the range of the load factor",
    "closed": "its first point",
    "joined": "a bifurcation of another branch",
    "collision": "a collision of two disks",
    "unstable": "the loss of stability",
    "points": "the largest number of points",
    "lost": "a point behind which the continuation does not converge",
}


@dataclass(frozen=True)
class BranchSearch:
    """Range and step of the search for branches.

    Parameters
    ----------
    max_factor : float
        Largest load factor; the least one is 0.
    step : float
        Largest step along a branch: radians of rotation, and load over the load that bends the
        robot by about 1 rad. Where a branch is straight, its load grows in longer steps.
    max_points : int
        Most points of a branch.
    max_branches : int
        Most branches.
    deflation : bool
        Whether equilibria beside the branches found are sought at load factor 1.

    Raises
    ------
    InputError
        If a value is out of its range.
    """

    max_factor: float = 1.0
    step: float = 0.05
    max_points: int = 2000
    max_branches: int = 40
    deflation: bool = True

    def __post_init__(self) -> None:
        for name, least, most in (("max_factor", 0.0, 1e9), ("step", 0.0, 0.5)):
            value = getattr(self, name)
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not least < value <= most:
                raise InputError(
                    f"{name} is {value!r}, it must be a number above 0, up to {most:g}"
                )
        for name, least, most in (("max_points", 2, 100_000), ("max_branches", 1, 1000)):
            validation.whole(name, getattr(self, name), least, most)
        validation.truth("deflation", self.deflation)


@dataclass(frozen=True)
class _Settings:
    """Search for the core."""

    max_factor: float
    step: float
    max_points: int
    max_branches: int
    deflation: bool
    first_loss: bool


@dataclass(frozen=True)
class BranchEvent(Result):
    """A limit point or a bifurcation."""

    kind: Annotated[Kind, Key()]
    """``limit_point``: the load factor has an extremum; ``bifurcation``: branches meet."""
    point: Annotated[int, Key()]
    """Index of its point on the branch, from 0."""
    multiplicity: Annotated[int, Key()]
    """Number of eigenvalues of the second variation that change their sign."""
    factor: Annotated[float, Key()]
    """Load factor."""


@short_repr
@dataclass(frozen=True, eq=False)
class Branch(Result):
    """A branch of equilibria, n points in order."""

    factor: Annotated[Floats, Key()]
    """Load factor of each point (n,)."""
    arclength: Floats
    """Length along the branch (n,), in the units of `BranchSearch.step`."""
    residual: Floats
    """Largest moment imbalance (n,) over (bending stiffness / length)."""
    stable: Annotated[tuple[bool | None, ...], Key()]
    """Whether each equilibrium is stable. None where an eigenvalue is zero, as at events and on a
    family of equal branches, and where it is not determined (`Solution.stable`)."""
    unstable_modes: Annotated[tuple[int | None, ...], Key()]
    """Number of negative eigenvalues of the second variation; None under a moment."""
    neutral_modes: Ints
    """Number of eigenvalues (n,) that are zero within rounding."""
    disk_positions: Floats
    """Positions of the disks (n, N, 3), m."""
    disk_rotations: Floats
    """Rotations of the disks (n, N, 3, 3)."""
    events: Annotated[tuple[BranchEvent, ...], Key()]
    """Limit points and bifurcations in order."""
    origin: Annotated[tuple[int, int] | None, Key()]
    """Branch and event at which it begins, from 0; None for the first branch, for those that begin
    at load factor 0 beside it, and for those that deflation found."""
    end: Annotated[End, Key()]
    """Why it ends: ``range`` of the load factor; ``closed``; ``joined`` at a bifurcation of another
    branch; ``collision`` of disks; ``unstable``, not followed further; most ``points``; ``lost``,
    it does not converge."""

    @property
    def largest_residual(self) -> Annotated[float, Key("residual")]:
        """Largest moment imbalance of a point over (bending stiffness / length)."""
        return float(self.residual.max())

    def __len__(self) -> int:
        return len(self.factor)

    @property
    def tip_position(self) -> Annotated[Floats, Key("tip_position_m")]:
        """Tip (n, 3) at each point, m."""
        return self.disk_positions[:, -1]

    @property
    def last_stable(self) -> float | None:
        """Largest load factor with a stable equilibrium; None without one."""
        factors = [f for f, s in zip(self.factor, self.stable, strict=True) if s]
        return float(max(factors)) if factors else None

    def at(self, factor: float) -> list[int]:
        """Indices of the points at a load factor, each of which the branch reaches exactly."""
        return [int(i) for i in np.flatnonzero(np.abs(self.factor - factor) < 1e-9)]


@short_repr
@dataclass(frozen=True, eq=False)
class BranchDiagram(Result):
    """Branches of equilibria along a load; made by `branch_diagram`."""

    robot: Robot
    """The robot."""
    start: Load
    """Load at factor 0."""
    load: Load
    """Load at factor 1."""
    model: RodModel
    """Model of the rod with the number of elements used."""
    branches: Annotated[tuple[Branch, ...], Key()]
    """Branches; the first one begins at load factor 0."""
    complete: Annotated[bool, Key()]
    """Whether all bifurcations were followed: fewer branches were found than allowed, and none of
    them ended at the largest number of points or where the continuation did not converge."""
    deflated: Annotated[bool, Key()]
    """Whether deflation was used; it is not on a family of equal branches."""
    max_factor: float = 1.0
    """Largest load factor, at which `equilibria` are given."""

    def __len__(self) -> int:
        return len(self.branches)

    @property
    def events(self) -> tuple[tuple[int, BranchEvent], ...]:
        """All events, each with the index of its branch."""
        return tuple((i, e) for i, b in enumerate(self.branches) for e in b.events)

    def equilibria(self) -> tuple[tuple[int, int], ...]:
        """Equilibria found at the largest load factor, each once: branch and point."""
        found: list[tuple[int, int]] = []
        nearest = _SAME * self.robot.length
        for i, branch in enumerate(self.branches):
            for k in branch.at(self.max_factor):
                here = branch.disk_positions[k]
                before = (self.branches[j].disk_positions[m] for j, m in found)
                if all(np.abs(here - other).max() > nearest for other in before):
                    found.append((i, k))
        return tuple(found)

    def critical(self) -> CriticalLoad:
        """Where the first branch loses its stability."""
        return _critical(self)

    @property
    def text(self) -> list[str]:
        """The diagram in sentences."""
        events = [e for _, e in self.events]
        limits = sum(e.kind == "limit_point" for e in events)
        counts = (
            f"{_counted(limits, 'limit point')}, {_counted(len(events) - limits, 'bifurcation')}"
        )
        plural = "" if len(self) == 1 else "es"
        out = [f"{len(self)} branch{plural}: {counts}.", self.critical().text]
        at_load = self.equilibria()
        if at_load:
            known = [self.branches[i].stable[k] for i, k in at_load]
            stable, open_ = sum(s is True for s in known), sum(s is None for s in known)
            rest = f", {open_} undetermined" if open_ else ""
            out.append(
                f"At load factor {self.max_factor:g}: {_counted(len(at_load), 'equilibrium')}, "
                f"{stable} stable{rest}."
            )
        else:
            first = self.branches[0]
            most = int(np.argmax(first.factor))
            kinds = [e.kind.replace("_", " ") for e in first.events if e.point == most]
            reached = f"a {kinds[0]}" if kinds else _ENDS[first.end]
            out.append(
                f"No equilibrium was found at load factor {self.max_factor:g}; the first branch "
                f"reaches {first.factor[most]:.6g}: {reached}."
            )
        cut = [(i, b) for i, b in enumerate(self.branches) if b.end in ("points", "lost")]
        for i, branch in cut[:_MOST_CUT]:
            last = float(branch.factor[-1])
            load = " and ".join(_differences(self.start, self.load, last))
            out.append(
                f"Branch {i + 1} was followed only up to load factor {last:.6g} ({load}), where it "
                f"ends at {_ENDS[branch.end]}; what lies behind is not known."
            )
        if len(cut) > _MOST_CUT:
            out.append(f"So were {len(cut) - _MOST_CUT} more.")
        if not self.complete and not cut:
            out.append("More branches were not followed: the largest number was reached.")
        return out

    @property
    def elements(self) -> Annotated[int, Key()]:
        """Elements between two disks."""
        return self.model.elements or 1

    @property
    def theory(self) -> Annotated[Literal["cosserat", "kirchhoff"], Key()]:
        """Theory of the backbone."""
        return self.model.theory

    @property
    def at_load(self) -> Annotated[list[EquilibriumOnBranch], Key("equilibria")]:
        """Equilibria found at the largest load factor."""
        branches = self.branches
        return [
            EquilibriumOnBranch(i, k, branches[i].stable[k], branches[i].tip_position[k])
            for i, k in self.equilibria()
        ]

    @property
    def loss(self) -> Annotated[CriticalLoad, Key("critical")]:
        """Loss of stability of the first branch."""
        return self.critical()


@dataclass(frozen=True, eq=False)
class EquilibriumOnBranch(Result):
    """An equilibrium at the largest load factor."""

    branch: Annotated[int, Key()]
    """Its branch, from 0."""
    point: Annotated[int, Key()]
    """Its point on the branch, from 0."""
    stable: Annotated[bool | None, Key()]
    """Whether it is stable; None if not determined."""
    tip_position: Annotated[Floats, Key("tip_position_m")]
    """Tip (3,), m."""


@dataclass(frozen=True)
class CriticalLoad(Result):
    """Where the branch from load factor 0 loses its stability; made by `critical_load`."""

    factor: Annotated[float | None, Key()]
    """Critical load factor; None if the branch stays stable as far as it was followed."""
    kind: Annotated[Literal["limit_point", "bifurcation", "oscillation"] | None, Key()]
    """``limit_point``: a robot loaded further snaps. ``bifurcation``: it buckles. ``oscillation``:
    under a moment small oscillations grow; the factor is then between two points."""
    multiplicity: Annotated[int, Key()]
    """Number of eigenvalues that change their sign: 2 if a robot buckles in any plane."""
    stable_to: Annotated[float | None, Key()]
    """Largest load factor up to which all equilibria of the branch were found stable."""
    end: End
    """Why the branch ends, as in `Branch`."""
    more: tuple[str, ...]
    """Load to the critical point beyond the load at factor 0, by components, for people."""

    @property
    def text(self) -> Annotated[str, Key()]:
        """The critical load as a sentence."""
        if self.factor is None:
            if self.stable_to is None:
                return "The first branch is nowhere proven stable."
            return (
                f"The first branch is stable up to load factor {self.stable_to:.6g}; "
                f"it ends at {_ENDS[self.end]}."
            )
        what = {
            "limit_point": "the robot snaps (limit point)",
            "bifurcation": "the robot buckles (bifurcation)",
            "oscillation": "small oscillations grow",
            None: "",
        }[self.kind]
        return f"At {' and '.join(self.more)}, {what}: load factor {self.factor:.6g}."


def branch_diagram(
    robot: Robot,
    tensions: Any = None,
    *,
    load: Load | None = None,
    start: Load | None = None,
    model: RodModel | None = None,
    search: BranchSearch | None = None,
) -> BranchDiagram:
    """Find the branches of equilibria along a load, with their stability and events.

    Parameters
    ----------
    robot : Robot
        The robot; without friction.
    tensions : array_like (T,), optional
        Tensions in N at load factor 1, short for ``load=Load(tensions)``; zero if left out.
    load : Load, optional
        Load at load factor 1: tensions, gravity, and loads on tip and disks.
    start : Load, optional
        Load at load factor 0; between the two, loads are interpolated linearly. By default gravity
        alone, as in `load`; no load if `load` is gravity alone.
    model : RodModel, optional
        As for `bowstring.solve`; elements are chosen for the whole diagram.
    search : BranchSearch, optional
        How far and how finely branches are followed.

    Returns
    -------
    BranchDiagram
        Branches that are connected to the equilibrium at load factor 0, or to those equal to it if
        it has buckled in any plane, and those that deflation finds at load factor 1. Completeness
        is not guaranteed (theory of statics, Search for all equilibria).

    Raises
    ------
    InputError
        If an argument is wrong.
    NoSolutionError
        If there is no stable equilibrium at load factor 0.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> found = bs.branch_diagram(robot, load=bs.Load(tip_force=[0.3, 0, -12]))
    >>> [len(branch.events) for branch in found.branches]
    [0, 1]
    >>> found.branches[1].events[0].kind
    'limit_point'
    """
    search = BranchSearch() if search is None else search
    if not isinstance(search, BranchSearch):
        raise InputError("search must be a bowstring.BranchSearch")
    return _followed(robot, as_load(tensions, load), start, model, search, first_loss=False)


def critical_load(
    robot: Robot,
    tensions: Any = None,
    *,
    load: Load | None = None,
    start: Load | None = None,
    model: RodModel | None = None,
    max_factor: float = 1e6,
) -> CriticalLoad:
    """Find where a robot that is loaded further buckles or snaps.

    Follows the branch from `start` in the direction of `load` to the first point at which it is no
    longer stable.

    Parameters
    ----------
    robot : Robot
        The robot; without friction.
    tensions : array_like (T,), optional
        As for `branch_diagram`.
    load : Load, optional
        Load at load factor 1, such as that of 1 N: the factor is then the critical load in N.
    start : Load, optional
        As for `branch_diagram`: such as the present load.
    model : RodModel, optional
        As for `branch_diagram`.
    max_factor : float
        Load factor up to which the branch is followed.

    Returns
    -------
    CriticalLoad
        The point of lost stability, or the highest load factor reached without one.

    Raises
    ------
    InputError
        If an argument is wrong.
    NoSolutionError
        If there is no stable equilibrium at load factor 0.

    Examples
    --------
    Euler's load of the straight robot, and the margin of a present load:

    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> found = bs.critical_load(robot, load=bs.Load(tip_force=[0, 0, -1]))
    >>> found.kind, round(found.factor, 2)
    ('bifurcation', 6.45)
    >>> now = bs.Load([0, 0, 0], tip_force=[0, 0, -6])
    >>> found = bs.critical_load(robot, load=bs.Load(tip_force=[0, 0, -7]), start=now)
    >>> print(found.text)
    At 0.4481 N at the tip more, the robot buckles (bifurcation): load factor 0.448145.
    """
    search = BranchSearch(max_factor=max_factor, deflation=False, max_branches=1)
    return _followed(
        robot, as_load(tensions, load), start, model, search, first_loss=True
    ).critical()


def _followed(
    robot: Robot,
    load: Load,
    start: Load | None,
    model: RodModel | None,
    search: BranchSearch,
    *,
    first_loss: bool,
) -> BranchDiagram:
    check_robot(robot)
    if start is not None and not isinstance(start, Load):
        raise InputError("start must be a bowstring.Load")
    end, model = _complete(robot, load, "load"), as_model(model)
    if start is None:
        alone = not (np.any(end.tensions) or acts(end))
        start = Load(gravity=np.zeros(3) if alone else end.gravity)
    begin = _complete(robot, start, "start")
    settings = _Settings(
        *(search.max_factor, search.step, search.max_points, search.max_branches, search.deflation),
        first_loss=first_loss,
    )
    # gravity is part of both loads
    found = follow_branches(
        robot.core, (begin.tensions, begin), (end.tensions, end), model, settings
    )
    if found["status"] != "converged":
        raise NoSolutionError(
            "No stable equilibrium was found at load factor 0; start from a lower load."
        )
    return BranchDiagram(
        robot=robot,
        start=begin,
        load=end,
        model=model.replace(elements=found["elements"]),
        branches=tuple(_branch(b) for b in found["branches"]),
        complete=found["complete"],
        deflated=found["deflated"],
        max_factor=float(search.max_factor),
    )


def _complete(robot: Robot, load: Load, name: str) -> Load:
    """Return a load by tensions with arrays for tensions and gravity."""
    if not load.is_tension_controlled:
        raise InputError(
            f"{name} has displacements or angles; branches are followed in tensions and loads"
        )
    check_without_laws(robot, ", with which branches are not followed", but=OF_COMMANDS)
    count = robot.core.tendon_count
    tensions = np.zeros(count) if load.tensions is None else validation.floats(load.tensions)
    gravity = robot.gravity if load.gravity is None else load.gravity
    return replace(with_arrays(load), tensions=tensions, gravity=validation.floats(gravity))


def _branch(found: dict[str, Any]) -> Branch:
    factor = found["factor"]
    events = tuple(
        BranchEvent(kind, point, multiplicity, float(factor[point]))
        for kind, point, multiplicity in found.pop("events")
    )
    stable, unstable = tuple(found.pop("stable")), tuple(found.pop("unstable_modes"))
    return Branch(**found, events=events, stable=stable, unstable_modes=unstable)


def _critical(diagram: BranchDiagram) -> CriticalLoad:
    first = diagram.branches[0]
    lost = next((k for k, s in enumerate(first.stable) if s is False), None)
    last = len(first) if lost is None else lost
    proven = [float(first.factor[k]) for k in range(last) if first.stable[k]]
    stable_to = max(proven) if proven else None
    event = next((e for e in first.events if lost is not None and _leads(first, e, lost)), None)
    kind: Literal["limit_point", "bifurcation", "oscillation"] | None = None
    factor = None
    if event is not None:
        kind, factor = event.kind, event.factor
    elif lost is not None and stable_to is not None:
        kind, factor = "oscillation", stable_to
    return CriticalLoad(
        factor=factor,
        kind=kind,
        multiplicity=event.multiplicity if event is not None else 0,
        stable_to=stable_to,
        end=first.end,
        more=_differences(diagram.start, diagram.load, factor) if factor is not None else (),
    )


def _leads(branch: Branch, event: BranchEvent, lost: int) -> bool:
    """Whether no equilibrium between an event and the first unstable one is stable."""
    between = range(event.point, lost + 1)
    return event.point <= lost and not any(branch.stable[k] for k in between)


_IN_WORDS: Final = (
    ("tip_force", "N", "at the tip"),
    ("tip_moment", "N m", "of moment at the tip"),
    ("gravity", "m/s^2", "of gravity"),
    ("disk_forces", "N", "in all on the disks"),
    ("disk_moments", "N m", "of moment in all on the disks"),
    ("line_forces", "N/m", "along the backbone"),
)


def _differences(start: Load, load: Load, factor: float) -> tuple[str, ...]:
    """Difference of the loads at a factor and at factor 0, by components."""
    out = []
    for i, (a, b) in enumerate(zip(start.tensions, load.tensions, strict=True)):
        if a != b:
            word = "more" if b > a else "less"
            out.append(f"{factor * abs(b - a):.4g} N on tendon {i + 1} {word}")
    parts = [(getattr(start, name), getattr(load, name), *said) for name, *said in _IN_WORDS]
    points = _same_rows(start.point_loads, load.point_loads)
    parts += [
        (*(table[:, FORCE] for table in points), "N", "in all at points of the robot"),
        (*(table[:, MOMENT] for table in points), "N m", "of moment in all at points of the robot"),
    ]
    for *ends, unit, words in parts:
        first, last = (np.zeros(3) if v is None else np.asarray(v) for v in ends)
        total = np.max if unit == "N/m" else np.sum
        size, before, after = (
            total(np.linalg.norm(v, axis=-1)) for v in (last - first, first, last)
        )
        if size > 0:
            word = "more" if after >= before else "less"
            out.append(f"{factor * size:.4g} {unit} {words} {word}")
    return tuple(out)


def _same_rows(first: Floats | None, last: Floats | None) -> tuple[Floats, Floats]:
    """Numbers of point loads (P, 12) at both ends: those at one end only are zero at the other."""
    a, b = (np.zeros((0, POINT_NUMBERS)) if table is None else table for table in (first, last))
    if same_points(a, b):
        return a, b
    return np.concatenate([a, without_wrenches(b)]), np.concatenate([without_wrenches(a), b])


def _counted(count: int, what: str) -> str:
    if count == 1:
        return f"1 {what}"
    return f"{count} equilibria" if what == "equilibrium" else f"{count} {what}s"
