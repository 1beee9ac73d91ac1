"""Inverse kinematics by physics and by constant curvature."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
from numpy.typing import ArrayLike

from bowstring import validation
from bowstring._core import RodModel
from bowstring._core import inverse_kinematics as _inverse_kinematics
from bowstring.aliases import Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.inverse.arcs import arcs_to, tensions_of
from bowstring.inverse.displacement_limits import keep_displacements
from bowstring.inverse.friction import follow_with_friction
from bowstring.inverse.limits import ActuationLimits
from bowstring.inverse.solution import InverseSolution
from bowstring.inverse.targets import Targets, angle_between
from bowstring.robot.laws import OF_COMMANDS
from bowstring.robot.model import check_robot, check_tendons, check_without_laws, without_laws
from bowstring.statics.actuation import driven
from bowstring.statics.load import Load
from bowstring.statics.load_tables import with_arrays
from bowstring.units import number_with_unit, read_share
from bowstring.validation import shown

if TYPE_CHECKING:
    from bowstring.robot.model import Robot

_REACHED: Final = 1e-6  # distance over length of a reached tip
_BEYOND: Final = 1.001  # distance from the base over length beyond which no tip can be


def inverse_kinematics(
    robot: Robot,
    position: ArrayLike,
    *,
    direction: ArrayLike | None = None,
    load: Load | None = None,
    model: RodModel | Literal["constant_curvature"] | None = None,
    limits: ActuationLimits | None = None,
    distance_margin: float | str = 1e-3,
    path: bool = True,
) -> InverseSolution:
    """Find tensions that bring the tip to a position.

    By physics the tip is that of the stable equilibrium, and a position counts as reached within
    1e-6 of the length. Where several sets of tensions lead to the position, the result has the
    least sum of squares near it. Where none does, it has the least tensions whose tip is hardly
    farther from the position than the nearest tip (`distance_margin`).

    Parameters
    ----------
    robot : Robot
        The robot. With friction the rows are a path from the home pose, whose history counts.
    position : array_like (3,) or (n, 3)
        Wanted position of the tip in the base frame, m.
    direction : array_like (3,) or (n, 3), optional
        Wanted direction of the tangent at the tip; its length does not matter. Where the pose
        cannot be reached, the error of the direction weighs as much as the same share of the
        length.
    load : Load, optional
        Gravity and dead loads, without actuation. Rows as for `bowstring.sweep`.
    model : RodModel or "constant_curvature", optional
        Physics as for `bowstring.solve`, which is the default; or arcs, which ignore loads
        and shortening: in closed form for one segment and a position, otherwise by iteration, of
        the arcs through the position those with the least squared bends; tensions follow from the
        linear law.
    limits : ActuationLimits, optional
        Limits of the tensions and, by physics and for tendons without friction, displacements.
    distance_margin : float or str
        For positions that cannot be reached, by physics: how much farther from the position than
        the nearest tip the tip may be, as a share of the robot's length, or text such as
        ``"0.1 %"``. The nearest tip of one segment often needs large tensions in all tendons, which
        shorten the robot by fractions of a millimetre; a margin avoids them. 0 gives the nearest
        tip. `InverseSolution.nearest_distance` has its distance.
    path : bool
        Whether rows are a path, each started from the previous one. Otherwise each has its own
        start (with friction the home pose), and they are solved on all cores.

    Returns
    -------
    InverseSolution
        Check `reached`, or call `raise_for_status`.

    Raises
    ------
    InputError
        If an argument is wrong, for a position farther from the base than the robot is long, and
        for tendons without derivatives.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("rao2021")
    >>> found = bs.inverse_kinematics(robot, [0.12, 0.05, 0.36])
    >>> found.status, bool(found.distance < 1e-8)
    ('reached', True)
    >>> bs.solve(robot, found.tensions).tip.position.round(6)
    array([0.12, 0.05, 0.36])
    """
    check_robot(robot)
    check_tendons(robot, "inverse kinematics")
    path = validation.truth("path", path)
    targets, single = _positions(robot, position)
    tangents = _directions(direction, len(targets), single)
    limits = validation.instance("limits", limits, ActuationLimits)
    least, most = limits.tensions(robot)
    margin = _margin(distance_margin)
    displacements = limits.displacements(robot)
    load = _dead(load)
    chosen: RodModel | Literal["constant_curvature"] = "constant_curvature"
    if isinstance(model, str):
        validation.choice("model", model, ("constant_curvature",))
        if load.given:
            raise InputError(
                "constant curvature knows no loads; leave load out, or give model=RodModel()"
            )
        if displacements is not None:
            raise InputError(
                "displacement_limits are for physics; leave them out, or give model=RodModel()"
            )
        found = _by_arcs(robot, targets, tangents, (least, most))
    else:
        chosen = rod = validation.instance("model", model, RodModel)
        wanted = Targets(targets, tangents, margin)
        found = _by_physics(robot, wanted, (least, most), load, rod, path)
        if displacements is not None:
            if robot.has_friction:
                raise InputError(
                    f"displacement_limits are for tendons without friction, and {robot.name} has "
                    "some; leave them out, or set friction to 0"
                )
            if robot.displacement_coupling is not None:
                raise InputError(
                    "displacement_limits are of whole tendons, and the drives of "
                    f"{robot.name} have decoupling; leave them out, or set decoupling to 0"
                )
            lowest, highest = (driven(robot, each) for each in displacements)
            pairs = (least, most), (lowest, highest)
            keep_displacements(without_laws(robot), wanted, *pairs, found, load, rod, _REACHED)
    if single:
        found = {name: value[0] for name, value in found.items()}
        found |= {name: v.item() for name, v in found.items() if isinstance(v, np.generic)}
        targets = targets[0]
        tangents = None if tangents is None else tangents[0]
    return InverseSolution(
        robot=robot,
        model=chosen,
        load=load,
        position=targets,
        direction=tangents,
        min_tension=least,
        max_tension=most,
        displacement_limits=displacements,
        **found,
    )


def _by_physics(
    robot: Robot,
    targets: Targets,
    limits: tuple[Floats, Floats],
    load: Load,
    model: RodModel,
    path: bool,
) -> dict[str, Any]:
    if model.tendon_path == "continuous" or robot.is_embedded:
        raise InputError(
            "inverse kinematics needs derivatives, which continuous and embedded tendons do not "
            'have; use tendon_path="straight" or model="constant_curvature"'
        )
    check_without_laws(
        robot, ", with which there is no inverse by physics", but=("friction", *OF_COMMANDS)
    )
    if robot.has_friction:
        return follow_with_friction(
            robot, targets, limits, load, model, path=path, reached=_REACHED
        )
    threads = None if path else 0
    return _inverse_kinematics(robot.core, targets, limits, load, model, threads)


def _by_arcs(
    robot: Robot, targets: Floats, tangents: Floats | None, limits: tuple[Floats, Floats]
) -> dict[str, Any]:
    least, most = limits
    wanted = arcs_to(robot, targets, tangents)
    tensions = tensions_of(robot, wanted, least, most)
    # the arcs of these tensions: those wanted, unless limits bind
    arcs = RobotArcs.from_tensions(robot, np.nan_to_num(tensions))
    moved = np.linalg.norm(arcs.arc.bend - wanted.arc.bend, axis=-1).max(axis=-1)
    moved += np.abs(arcs.length / wanted.length - 1.0).max(axis=-1)
    bound = moved > 1e-7
    if not bound.any():
        arcs = wanted
    tip = arcs.tip
    distance = np.linalg.norm(tip.position - targets, axis=-1)
    size = distance / robot.length
    error = np.full(len(targets), np.nan)
    if tangents is not None:
        error = angle_between(tip.rotation[..., 2], tangents)
        size = np.hypot(size, 2.0 * np.sin(0.5 * error))
    reached = size <= _REACHED
    at_least, at_most = tensions <= least, tensions >= most
    binding = np.where(at_most, 1, np.where(at_least, -1, 0))
    binding = np.where((bound & ~reached)[:, None], binding, 0).astype(np.int8)
    count = len(targets)
    return {
        "status": ["reached" if done else "unreachable" for done in reached],
        "stable": [None] * count,
        "tensions": tensions,
        "tip_position": tip.position,
        "tip_rotation": tip.rotation,
        "distance": distance,
        "nearest_distance": distance,
        "direction_error": error,
        "tendon_lengths": arcs.lengths(),
        "binding": binding,
        "iterations": np.zeros(count, dtype=np.int64),
        "restarted": np.zeros(count, dtype=bool),
        "elements": np.zeros(count, dtype=np.int64),
        "tip_error": np.full(count, np.nan),
        "arcs": arcs,
    }


# -- arguments ---------------------------------------------------------------------------------


def _positions(robot: Robot, given: ArrayLike) -> tuple[Floats, bool]:
    """Positions (n, 3), and whether a single one was given."""
    found = _rows("position", given, "m")
    single = found.ndim == 1
    found = np.atleast_2d(found)
    if not len(found):
        raise InputError("position has no rows; give one or more")
    with np.errstate(over="ignore"):  # distances of points at 1e308 m overflow
        distance = np.hypot.reduce(found, axis=-1)
    far = np.flatnonzero(distance > _BEYOND * robot.length)
    if far.size:
        k = int(far[0])
        where = "position" if single else f"row {k + 1} of position"
        raise InputError(
            f"{where} is {number_with_unit(float(distance[k]), 'm')} from the base, out of any "
            f"reach: {robot.name} is {number_with_unit(robot.length, 'm')} long"
        )
    return found, single


def _directions(given: ArrayLike | None, count: int, single: bool) -> Floats | None:
    if given is None:
        return None
    found = _rows("direction", given, "")
    if found.ndim == 2 and (single or len(found) != count):
        wanted = "(3,)" if single else f"(3,) or ({count}, 3)"
        raise InputError(f"direction has shape {found.shape}, it must be {wanted}")
    found = np.atleast_2d(found)
    largest = np.abs(found).max(axis=-1, keepdims=True)
    if not (largest > 0.0).all() or not np.isfinite(largest).all():
        k = int(np.flatnonzero(~(largest[:, 0] > 0.0) | ~np.isfinite(largest[:, 0]))[0])
        raise InputError(f"direction is {found[k].tolist()}, it must not be zero or infinite")
    found = found / largest  # so that squares neither overflow nor vanish
    norms = np.linalg.norm(found, axis=-1, keepdims=True)
    return np.array(np.broadcast_to(found / norms, (count, 3)))


def _rows(name: str, given: ArrayLike, unit: str) -> Floats:
    what = "three numbers, or rows of three" + (f", in {unit}" if unit else "")
    found = validation.read(name, given, what)
    if found.ndim not in (1, 2) or found.shape[-1] != 3:
        raise InputError(f"{name} has shape {found.shape}, it must be (3,) or (n, 3)")
    bad = ~np.isfinite(found)
    if bad.any():
        if found.ndim == 1:
            raise InputError(f"{name} is {found.tolist()}, all must be finite numbers")
        k = int(np.flatnonzero(bad.any(axis=-1))[0])
        raise InputError(
            f"row {k + 1} of {name} is {found[k].tolist()}, all must be finite numbers"
        )
    return found


def _margin(given: float | str) -> float:
    found = np.nan
    if isinstance(given, str):
        with suppress(ValueError):
            found = read_share(given)
    else:
        found = validation.number("distance_margin", given, zero=True)
    if not 0.0 <= found < 1.0:
        rule = 'a share of the length, 0 or more and below 1, such as 0.001 or "0.1 %"'
        raise InputError.of("distance_margin", shown(given), rule)
    return found


def _dead(load: Load | None) -> Load:
    """Dead loads without actuation, which is unknown."""
    if load is None:
        return Load()
    if not isinstance(load, Load):
        raise InputError(f"load is {shown(load)}, it must be a bowstring.Load")
    if load.is_actuated:
        raise InputError("load has an actuation, which is what the inverse finds; leave it out")
    if load.base is not None:
        raise InputError("load has a motion of the base, which is for bowstring.simulate only")
    load = with_arrays(load, " or (n, N, 3)")
    given = {name: getattr(load, name) for name in ("gravity", "tip_force", "tip_moment")}
    shape = "numbers of shape (3,) or (n, 3)"
    read = {n: validation.read(n, v, shape) for n, v in given.items() if v is not None}
    return load.replace(**read)
