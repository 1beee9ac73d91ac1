"""Numbers of a robot and its loads by path, as axes of maps and distributions name them."""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection
from typing import Final

from bowstring.errors import InputError
from bowstring.robot.fields import numbers_in
from bowstring.robot.messages import SYNONYMS
from bowstring.robot.model import Robot
from bowstring.robot.overrides import expand
from bowstring.units import quote

_VECTORS: Final = ("gravity", "tip_force", "tip_moment")
_MOST_NEAR: Final = 2  # paths that an error suggests
_NEAR: Final = 0.55  # least similarity of them
_LONGEST: Final = 100  # characters of a path that is compared with others


def numbers_of(robot: Robot) -> list[tuple[str, float]]:
    """Paths and values in SI of all numbers of a robot, also of those that its file leaves out.

    Parameters
    ----------
    robot : Robot

    Returns
    -------
    list of (str, float)
        Paths such as ``segments.0.backbone.E``; a list of numbers has one for each.
    """
    return list(numbers_in(robot.model_dump(mode="json", exclude_none=True)))


def full_paths(robot: Robot, path: str) -> list[str]:
    """Paths of the numbers of a robot file that a path means.

    Parameters
    ----------
    robot : Robot
    path : str
        A path as in `Robot.with_`, with ``*`` for every index; or the end of one, such as ``E`` or
        ``disks.count``, which means that number in every segment and tendon; or ``gravity.z``.

    Returns
    -------
    list of str

    Raises
    ------
    InputError
        If the robot has no such number, or an end means numbers of different kinds.
    """
    return list(find(robot, path, ())[1])


def example_path(robot: Robot) -> str:
    """Path of a number that this robot has, for a message."""
    by_matrix = robot.segments[0].backbone.stiffness is not None
    return f"segments.0.{'length' if by_matrix else 'backbone.E'}"


def find(robot: Robot, path: str, loads: Collection[str]) -> tuple[str, tuple[str, ...]]:
    """Find the numbers that a path means, of the robot file or of its loads.

    Parameters
    ----------
    robot : Robot
    path : str
        As for `full_paths`, or one of `loads`.
    loads : collection of str
        Paths of actuation and loads, such as ``tensions.0`` and ``tip_force.x``.

    Returns
    -------
    name : str
        The path in its usual form, the same for all ways to write it: whole, with ``*`` where it
        means several numbers, and with x, y or z for a component.
    targets : tuple of str
        Paths of the numbers, without ``*``, as the robot file and `loads` have them.

    Raises
    ------
    InputError
        If there is no such number, or an end means numbers of different kinds.
    """
    path = re.sub(r"\[([0-9]+|\*)\]", r".\1", path.strip())
    name = _lettered(path)
    if name in loads:
        return name, (name,)
    if path.endswith(".*"):
        head = path[:-1]
        members = [p for p in loads if p.startswith(head) and p.removeprefix(head).isdecimal()]
        if members:
            return path, tuple(members)
    if re.fullmatch(r"gravity\.[xyz]", path):
        path = f"gravity.{'xyz'.index(path[-1])}"
    known = [known for known, _ in numbers_of(robot)]
    tree = robot.model_dump(mode="json", exclude_none=True)
    found = [p for p in expand(tree, path) if p in known]
    indexed = re.sub(r"\btendons\.(?=[a-z])", "tendons.*.", path)
    if found and found == expand(tree, indexed):  # a list of tendons, not rings
        path = indexed
    if not found:
        found = [p for p in known if p.endswith(f".{path}") and not p.startswith("gravity")]
        kinds = {_kind(p) for p in found}
        if len(kinds) > 1:
            raise InputError(f"{quote(path)} is not unique; write {' or '.join(sorted(kinds))}")
    if not found:
        raise no_such(robot, path, loads, known)
    if len(found) == 1:
        return _lettered(found[0]), tuple(found)
    if "*" in path.split("."):
        return path, tuple(found)
    return f"{_kind(found[0].removesuffix(path))}{path}", tuple(found)


def no_such(
    robot: Robot, path: str, loads: Collection[str], known: Collection[str] | None = None
) -> InputError:
    """Make the error of a path that means no number; it suggests near ones.

    Parameters
    ----------
    robot, path, loads
        As for `find`.
    known : collection of str, optional
        Paths of the numbers of the robot file; all if left out.

    Returns
    -------
    InputError
    """
    if known is None:
        known = [p for p, _ in numbers_of(robot)]
    near, end = _near(path[:_LONGEST], known, loads), example_path(robot).rpartition(".")[2]
    hint = (
        f"did you mean {' or '.join(near)}?"
        if near
        else f"write for example {end}, disks.clamped_length, pitch_radius, gravity.z or "
        "tip_force.x"
    )
    return InputError(f"{robot.name} has no number {quote(path)}; {hint}")


def _near(path: str, known: Collection[str], loads: Collection[str]) -> list[str]:
    """Paths near to one: unique ends of paths, whole paths, and loads."""
    first: dict[str, str] = {}  # of each kind of number, one path
    for each in known:
        if not each.startswith("gravity"):
            first.setdefault(_kind(each), each)
    ends: dict[str, list[str]] = {}
    for kind in first:
        keys = kind.split(".")
        for i in range(1, len(keys)):
            if keys[i] != "*":
                ends.setdefault(".".join(keys[i:]), []).append(kind)
    meant = {end: kinds[0] for end, kinds in ends.items() if len(kinds) == 1}
    meant.update({kind: kind for kind in first} | {each: kind for kind, each in first.items()})
    meant.update({p: p for p in (*loads, *(f"gravity.{q}" for q in "xyz"))})
    synonym = SYNONYMS.get(path.rpartition(".")[2].lower())
    if synonym in meant:
        return [synonym]
    lower = {p.lower(): p for p in meant}
    wanted = path.lower()
    found = [lower[p] for p in difflib.get_close_matches(wanted, lower, n=9, cutoff=_NEAR)]
    found += [p for p in meant if p.endswith(f"_{wanted}") or p.startswith(f"{wanted}.")]
    out: dict[str, str] = {}  # one path for each number
    for each in found:
        out.setdefault(meant[each], each)
    return list(out.values())[:_MOST_NEAR]


def _kind(path: str) -> str:
    return ".".join("*" if key.isdecimal() else key for key in path.split("."))


def _lettered(path: str) -> str:
    """The path with x, y or z in place of the index of a component."""
    head, _, along = path.partition(".")
    component = head in _VECTORS and along in ("0", "1", "2")
    return f"{head}.{'xyz'[int(along)]}" if component else path
