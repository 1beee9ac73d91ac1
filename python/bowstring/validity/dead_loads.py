"""Gravity and tip force at the points of a map: axes of payload, tilt of the base and tip force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.statics.load import Load

_ON_GRAVITY: Final = ("payload", "tilt", "tilt_towards")


def gravity_of(robot: Robot, load: Load) -> Floats:
    """Gravity (3,) of the load, or else of the robot, m/s^2."""
    return np.array(robot.gravity if load.gravity is None else load.gravity, dtype=float)


def check_dead_loads(robot: Robot, paths: Sequence[str], load: Load) -> None:
    """Check that axes of payload, tilt and tip force change something.

    Parameters
    ----------
    robot : Robot
    paths : sequence of str
        Paths of the axes.
    load : Load
        Gravity and tip force that no axis changes.

    Raises
    ------
    InputError
        If there is no gravity for a payload or a tilt, no direction for a tip force, or a tip force
        is given twice.
    """
    has_gravity = gravity_of(robot, load).any() or any(p.startswith("gravity.") for p in paths)
    for path in paths:
        if path in _ON_GRAVITY and not has_gravity:
            raise InputError(
                f"axis {path}: without gravity it changes nothing, and {robot.name} has none; give "
                "a gravity, such as 0,0,-9.81"
            )
    if "tilt_towards" in paths and "tilt" not in paths:
        raise InputError(
            "axis tilt_towards: it is the direction of a tilt; add an axis tilt, such as "
            "tilt=0:90 deg"
        )
    if "tip_force" not in paths:
        return
    if load.tip_force is None or not np.any(load.tip_force):
        raise InputError(
            "axis tip_force: it has the direction of the tip force, and none is given; give one, "
            "such as 0,1,0, or take the axis tip_force.y"
        )
    if components := [path for path in paths if path.startswith("tip_force.")]:
        raise InputError(f"over has tip_force and {components[0]}; give the force by one of them")


def dead_loads(
    robot: Robot, load: Load, values: Mapping[str, Floats], count: int
) -> dict[str, Floats]:
    """Gravity and tip force at the points of a map, where axes change them.

    Parameters
    ----------
    robot : Robot
    load : Load
        Gravity and tip force that no axis changes.
    values : mapping from str to ndarray (P,)
        Values of the axes of loads in SI, by path.
    count : int
        Number P of points.

    Returns
    -------
    dict from str to ndarray (P, 3)
        ``gravity`` in m/s^2 and ``tip_force`` in N, base axes; the tip force has the weight of the
        payload in it.
    """
    force = np.zeros(3) if load.tip_force is None else np.array(load.tip_force, dtype=float)
    vectors = {
        "gravity": np.tile(gravity_of(robot, load), (count, 1)),
        "tip_force": np.tile(force, (count, 1)),
    }
    changed = set()
    for path, value in values.items():
        name, _, along = path.partition(".")
        if along:
            vectors[name][:, "xyz".index(along) if along in "xyz" else int(along)] = value
            changed.add(name)
    if "tip_force" in values:
        vectors["tip_force"] = np.outer(values["tip_force"], force / np.linalg.norm(force))
        changed.add("tip_force")
    if "tilt" in values:
        towards = values.get("tilt_towards", np.zeros(count))
        vectors["gravity"] = tilted(vectors["gravity"], values["tilt"], towards)
        changed.add("gravity")
    if "payload" in values:
        vectors["tip_force"] = (
            vectors["tip_force"] + values["payload"][:, None] * vectors["gravity"]
        )
        changed.add("tip_force")
    return {name: vectors[name] for name in sorted(changed)}


def tilted(gravity: Floats, tilt: Floats, towards: Floats) -> Floats:
    """Turn gravity (P, 3) into the axes of a tilted base.

    Parameters
    ----------
    gravity : ndarray (P, 3)
        Gravity in the axes of the base before the tilt, m/s^2.
    tilt : ndarray (P,)
        Angle by which the base leans, rad.
    towards : ndarray (P,)
        Direction to which it leans, from x counter-clockwise, rad; as of
        `bowstring.data.synthetic.Mounting`.

    Returns
    -------
    ndarray (P, 3)
    """
    from scipy.spatial.transform import Rotation

    axis = np.stack([-np.sin(towards), np.cos(towards), np.zeros_like(towards)], axis=-1)
    turn = Rotation.from_rotvec(tilt[:, None] * axis)
    return np.asarray(turn.apply(gravity, inverse=True))
