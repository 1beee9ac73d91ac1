"""Statics of a robot: elastic rod as backbone, rigid disks, tendons straight between them.

All values are in SI and in the base frame (z along the straight backbone) by default.
N is the number of disks, T the number of tendons. docs/theory/statics.md has the equations.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.robot.model import check_robot
from bowstring.statics import actuation
from bowstring.statics.load import Load, as_load
from bowstring.statics.load_tables import with_arrays
from bowstring.statics.model import as_model
from bowstring.statics.solution import Solution, Sweep, solution

if TYPE_CHECKING:
    from bowstring._core import RodModel
    from bowstring.robot.model import Robot


def solve(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    history: Mapping[str, Any] | None = None,
) -> Solution:
    """Find the static equilibrium under a load, starting from the straight robot.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : array_like (T,), optional
        Tension of each tendon in N, short for ``load=Load(tensions)``. Without tensions,
        displacements, angles and history all tendons are slack.
    load : Load, optional
        All loads; `tensions` may be given beside it.
    model : RodModel, optional
        Model of the rod. The default ``RodModel()`` is a Cosserat rod with straight tendons and
        adaptive elements.
    history : dict, optional
        `Solution.history()` of the previous step, whose path is continued; matters with friction or
        another memory. By default the path begins in the home pose. Relaxation and creep have no
        time to act: the solution is that at once after the load.

    Returns
    -------
    Solution
        Check `converged`, or call `raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> bs.solve(robot, [80, 0, 0]).raise_for_status().tip.position.round(4)
    array([0.3846, 0.    , 0.4448])

    Shorten tendon 1 by 20 mm and lengthen the others, which become slack:

    >>> bent = bs.solve(robot, load=bs.Load(displacements=[0.02, -0.03, -0.03]))
    >>> bent.tensions.round(2), bent.slack
    (array([38.89,  0.  ,  0.  ]), (2, 3))
    """
    check_robot(robot)
    return solution(robot, as_load(tensions, load), as_model(model), history)


def sweep(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    history: Mapping[str, Any] | None = None,
    times: ArrayLike | None = None,
    warm: bool = True,
    disks: bool = True,
) -> Sweep:
    """Solve many loads in order in one call.

    With displacements, angles, a history or a memory (friction, hysteresis, relaxation, creep) the
    rows form a path: each one is a step from the last row that converged.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : array_like (n, T), optional
        Tensions in N, short for ``load=Load(tensions)``.
    load : Load, optional
        Actuation (n, T), NaN where a tendon has a command of another kind; gravity and tip loads
        (3,) or (n, 3); loads on disks (N, 3) or (n, N, 3).
    model : RodModel, optional
        As for `solve`.
    history : dict, optional
        As for `solve`; the first row continues it.
    times : array_like (n,), optional
        Times in s since the home pose, or since the last row of the history; for a robot with
        relaxation, creep or a delay. Actuation is linear in time from row to row; where a drive has
        a delay, it is that of the first row before this row. `fit` counts from the first row:
        ``times=data.time - data.time[0]`` gives its predictions.
    warm : bool
        Start each load from the previous solution, which is faster for small increments and stays
        on one branch of solutions. Otherwise each starts from the straight robot, or, where the
        rows would form a path, from the home pose or the history.
    disks : bool
        Whether to return the poses of all disks.

    Returns
    -------
    Sweep
        Rows that did not converge hold NaN and are flagged.

    Raises
    ------
    InputError
        If an argument is wrong; the first bad row is named. Nothing is solved then.

    Examples
    --------
    >>> import numpy as np
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> res = bs.sweep(robot, np.outer(np.linspace(0, 80, 17), [1, 0, 0]))
    >>> res.tip_position.shape
    (17, 3)
    """
    check_robot(robot)
    warm, disks = validation.truth("warm", warm), validation.truth("disks", disks)
    load, model = _rows(as_load(tensions, load)), as_model(model)
    if history is not None and times is not None and robot.tendons.delay_s.any():
        raise InputError(
            f"a history does not have the commands that the delay of {robot.name} holds back; "
            "sweep all rows at once, or set delay to 0",
            argument="history",
        )
    if actuation.is_by_tensions(robot, load, history):
        rows = _tensions(robot, load)
        late = actuation.checked_times(robot, times, len(rows))
        if late is not None:
            rows = actuation.through_drives(robot, np.zeros(rows.shape, bool), rows, late)
        found = robot.core.sweep(rows, load, model, warm, disks)
        return Sweep(robot, rows.copy(), model, **found)
    return _follow(robot, load, model, history, disks, threads=None if warm else 1, times=times)


def solve_batch(
    robot: Robot,
    tensions: actuation.Given | None = None,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    threads: int = 0,
    disks: bool = True,
) -> Sweep:
    """Solve many independent loads, each from the straight robot or from home, on all cores.

    Parameters
    ----------
    robot : Robot
        The robot.
    tensions : array_like (n, T), optional
        As for `sweep`.
    load : Load, optional
        As for `sweep`.
    model : RodModel, optional
        As for `sweep`.
    threads : int
        Number of threads; 0 takes one for each core. The solutions do not depend on it.
    disks : bool
        As for `sweep`.

    Returns
    -------
    Sweep
        Rows that did not converge hold NaN and are flagged.

    Raises
    ------
    InputError
        If an argument is wrong; the first bad row is named. Nothing is solved then.

    Notes
    -----
    Hundreds of loads by tensions or more may start from a polynomial that is fitted to the
    solutions of a sample of them (theory of statics, Globalisation). Where a load has several
    stable equilibria, the one that is found then depends on the other rows.
    """
    validation.whole("threads", threads, 0, 1024)
    check_robot(robot)
    disks = validation.truth("disks", disks)
    load, model = _rows(as_load(tensions, load)), as_model(model)
    if actuation.is_by_tensions(robot, load):
        rows = _tensions(robot, load)
        found = robot.core.solve_batch(rows, load, model, threads, disks)
        return Sweep(robot, rows.copy(), model, **found)
    return _follow(robot, load, model, None, disks, threads=threads)


def _follow(
    robot: Robot,
    load: Load,
    model: RodModel,
    before: Mapping[str, Any] | None,
    disks: bool,
    *,
    threads: int | None,
    times: ArrayLike | None = None,
) -> Sweep:
    """Solve rows as a path or, with a number of threads, each from the start."""
    given, commands = actuation.given(robot, load, rows=True)
    at_once = threads is not None and times is None  # all loads at once after the start
    late = None if at_once else actuation.checked_times(robot, times, len(commands))
    commands = actuation.through_drives(robot, given, commands, late)
    durations = late if late is None or threads is not None else np.diff(late, prepend=0.0)
    path = actuation.Path(robot, model, before)
    found = path.core.follow(given, commands, load, disks, threads, durations)
    names = ("displacements", "slack_lengths", "span_tensions", "undetermined", "conflicts")
    extra = {name: found.pop(name) for name in (*names, "length_residual")}
    extra["history"] = path.history() if threads is None else None
    return Sweep(robot, model=model, **found, path=extra)


def _tensions(robot: Robot, load: Load) -> Floats:
    if load.tensions is None:
        actuation.commands(robot, load)  # raises an error that names what is missing
    count = robot.core.tendon_count
    rows = _array(load.tensions, "tensions", f"(n, {count})")
    if rows.ndim != 2:
        raise actuation.not_rows("tensions", rows.shape, count)
    return rows


def _rows(load: Load) -> Load:
    """Return the load with gravity, tip force and tip moment as arrays (3,) or (n, 3)."""
    load = with_arrays(load, " or (n, N, 3)")
    names = ("gravity", "tip_force", "tip_moment")
    given = {name: getattr(load, name) for name in names}
    if all(value is None or _is_plain_vector(value) for value in given.values()):
        return load  # the core converts these faster
    arrays = {
        name: None if value is None else _array(value, name, "(3,) or (n, 3)")
        for name, value in given.items()
    }
    return load.replace(**arrays)


def _is_plain_vector(value: object) -> bool:
    return isinstance(value, tuple) and all(type(item) in (int, float) for item in value)


def _array(values: ArrayLike, name: str, shape: str) -> Floats:
    if type(values) is np.ndarray and values.dtype == np.float64:
        return values
    try:
        return validation.floats(values)
    except TypeError:
        raise InputError(
            f"{name} must be numbers of shape {shape}, as a list or an array"
        ) from None
