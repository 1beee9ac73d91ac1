"""Numbers of a robot file by path: all of them, and the unit and range of each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from bowstring.robot.model import Robot
from bowstring.units import Quantity


def numbers_in(tree: Any, path: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number of a robot file with its path.

    Parameters
    ----------
    tree : dict or list
        Robot as `Robot.model_dump` gives it.
    path : str
        Path of `tree` itself.
    """
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree)
    for key, value in entries:
        here = f"{path}.{key}" if path else str(key)
        if isinstance(value, (dict, list)):
            yield from numbers_in(value, here)
        elif isinstance(value, (int, float)) and not isinstance(value, bool):
            yield here, value


def number_fields(tree: Any) -> Iterator[tuple[str, float]]:
    """Yield every number of a robot file except counts, as `numbers_in` does."""
    return ((path, value) for path, value in numbers_in(tree) if isinstance(value, float))


def quantity_of(robot: Robot, path: str) -> Quantity | None:
    """Unit and range of the number at a path that exists; None for a share."""
    part: Any = robot
    marks: Any = ()
    for key in path.split("."):
        if isinstance(part, tuple):  # an entry of a list, or of a vector with one unit
            part = part[int(key)]
        else:
            marks = type(part).model_fields[key].metadata
            part = getattr(part, key)
    return next((mark for mark in marks if isinstance(mark, Quantity)), None)
