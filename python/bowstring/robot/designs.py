"""Many robots that differ from one robot in some of its numbers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BaseModel

from bowstring.aliases import Floats
from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.robot.arrays import RobotArrays
from bowstring.robot.disk import stacked
from bowstring.robot.model import Robot, check_robot
from bowstring.robot.paths import full_paths
from bowstring.robot.stiffness import entry_of, mirrored
from bowstring.validation import floats

__all__ = ["Designs"]

_SHAPING: Final = ("count", "positions")  # fields that change the number of disks or tendons


@short_repr
@dataclass(frozen=True)
class Designs:
    """Many robots that differ from one robot in some of its numbers, and not in its topology.

    Numbers of disks, tendons and segments are those of `robot`. The robots are checked together:
    each value with all others as in `robot`, and the extremes with each other, as `Robot.with_`
    does; the mechanics checks every robot.

    Parameters
    ----------
    robot : Robot
        Robot from which they differ.
    values : mapping from str to array_like (D,)
        Values in SI by path, such as ``segments.*.backbone.E``, of D robots.

    Raises
    ------
    InputError
        If a path does not exist, a value is not valid, or the topology would change.

    Examples
    --------
    >>> import bowstring as bs
    >>> from bowstring.robot.designs import Designs
    >>> designs = Designs(bs.load_robot("amouri2019"), {"segments.*.backbone.E": [30e9, 40e9]})
    >>> len(designs)
    2
    """

    robot: Robot
    values: Mapping[str, ArrayLike]

    def __post_init__(self) -> None:
        check_robot(self.robot)
        given = {path: np.atleast_1d(floats(v)) for path, v in self.values.items()}
        sizes = {len(v) for v in given.values()}
        if len(sizes) > 1 or any(v.ndim != 1 for v in given.values()) or 0 in sizes:
            shapes = ", ".join(f"{path} {v.shape}" for path, v in given.items())
            raise InputError(f"values has arrays of different length: {shapes}; give one for each")
        wide: dict[str, Floats] = {}
        for path, array in given.items():
            for each in full_paths(self.robot, path):
                if each.rpartition(".")[2] in _SHAPING and not _is_position(each):
                    raise InputError(
                        f"{path} changes the number of disks or tendons; make a robot for each"
                    )
                wide[each] = array
        for path, array in list(wide.items()):  # a matrix stays symmetric
            if (other := mirrored(path)) is not None:
                wide.setdefault(other, array)
        object.__setattr__(self, "values", wide)
        self._check_extremes()

    def __len__(self) -> int:
        return len(np.asarray(next(iter(self.values.values())))) if self.values else 1

    def __getitem__(self, rows: slice | NDArray[np.intp]) -> Designs:
        """Some of the robots, not checked again."""
        part = object.__new__(Designs)
        object.__setattr__(part, "robot", self.robot)
        chosen = {path: np.asarray(v)[rows] for path, v in self.values.items()}
        object.__setattr__(part, "values", chosen)
        return part

    def robot_at(self, index: int) -> Robot:
        """Make one of the robots, checked as from a file."""
        chosen = {path: float(np.asarray(v)[index]) for path, v in self.values.items()}
        return self.robot.with_(chosen)

    def _check_extremes(self) -> None:
        # paths with the same values change together
        together: dict[int, list[str]] = {}
        for path, v in self.values.items():
            together.setdefault(id(v), []).append(path)
        groups = list(together.values())
        ends = []
        for paths in groups:
            array = np.asarray(self.values[paths[0]])
            if not np.isfinite(array).all():
                raise InputError(f"{paths[0]} has a value that is not finite")
            ends.append((float(array.min()), float(array.max())))
        corners = product(*ends) if len(ends) <= 4 else zip(*ends, strict=True)
        for corner in corners:
            changes = {
                path: value for paths, value in zip(groups, corner, strict=True) for path in paths
            }
            try:
                self.robot.with_(changes)
            except InputError as error:
                # advice on units is for a user's own text
                raise InputError(str(error).partition("\n")[0].rstrip(".")) from None

    @cached_property
    def arrays(self) -> RobotArrays:
        """Arrays of the robots as `Robot` has them, with a leading axis (D,) where they vary."""
        tree: Any = self.robot
        for path, array in self.values.items():
            tree = _replaced(tree, path.split("."), np.asarray(array))
        return RobotArrays.model_construct(
            **{name: getattr(tree, name) for name in RobotArrays.model_fields}
        )

    @cached_property
    def sections(self) -> Floats:
        """Numbers of the sections of the segments (D, 11 P S)."""
        return self._flat(self.arrays.sections, 3)

    @property
    def section_stiffness(self) -> Floats:
        """Stiffness matrices (S, 6, 6) of the sections of all robots; NaN where not given.

        Of robots that differ in them there are none here: `by_stiffness` divides these.
        """
        if self.varies_stiffness:
            return np.full((len(self.robot.segments), 6, 6), np.nan)
        return self.robot.section_stiffness

    @property
    def varies_stiffness(self) -> bool:
        """Whether the robots differ in entries of stiffness matrices."""
        return any(entry_of(path) is not None for path in self.values)

    def by_stiffness(self) -> Iterator[tuple[NDArray[np.intp], Designs]]:
        """Yield robots with the same stiffness matrices, and their indices."""
        paths = [path for path in self.values if entry_of(path) is not None]
        table = np.stack([np.asarray(self.values[path]) for path in paths], axis=1)
        kinds, of = np.unique(table, axis=0, return_inverse=True)
        for kind, entries in enumerate(kinds.tolist()):
            rows = np.flatnonzero(of.ravel() == kind)
            part = self[rows]
            left = {path: v for path, v in part.values.items() if path not in paths}
            if not left:  # one number stands for all, so that there are as many robots
                length = self.robot.segments[0].length
                left = {"segments.0.length": np.full(len(rows), length)}
            same = self.robot.with_(dict(zip(paths, entries, strict=True)))
            object.__setattr__(part, "robot", same)
            object.__setattr__(part, "values", left)
            yield rows, part

    @cached_property
    def disks(self) -> Floats:
        """Station, clamped length, mass, two moments of inertia, hole length of disks (D, 6 N)."""
        disks = self.arrays.disks
        inertia = disks.inertia_kg_m2[..., 0], disks.inertia_kg_m2[..., 1]
        parts = (disks.station_m, disks.clamped_length_m, disks.mass_kg, *inertia)
        return self._flat(stacked([*parts, disks.hole_length_m]), 2)

    @cached_property
    def payloads(self) -> Floats:
        """Numbers of the payloads (D, 8 P)."""
        return self._flat(self.arrays.payload_numbers, 2)

    @cached_property
    def holes(self) -> Floats:
        """x and y of the holes of the tendons, in base and disks (D, 2 T P)."""
        return self._flat(self.arrays.tendons.holes_m, 3)

    @cached_property
    def lines(self) -> Floats:
        """Numbers of the lines of the tendons (D, 9 T)."""
        return self._flat(self.arrays.tendons.lines, 2)

    @cached_property
    def gravity(self) -> Floats:
        """Gravity (D, 3), m/s^2."""
        return np.array(np.broadcast_to(stacked(list(self.arrays.gravity)), (len(self), 3)))

    @cached_property
    def length(self) -> Floats:
        """Lengths of the straight backbones (D,), m."""
        return np.array(np.broadcast_to(np.asarray(self.arrays.length), (len(self),)))

    def _flat(self, numbers: Floats, axes: int) -> Floats:
        """Rows (D, n) of the numbers of each robot, which have some axes, and D or one before."""
        flat = numbers.reshape(*numbers.shape[: numbers.ndim - axes], -1)
        return np.ascontiguousarray(np.broadcast_to(flat, (len(self), flat.shape[-1])))


def _is_position(path: str) -> bool:
    return path.split(".")[-2:-1] == ["positions"]


def _replaced(part: Any, keys: list[str], value: Any) -> Any:
    """Copy of a part with another value at the end of a path, without checks."""
    if not keys:
        return value
    key, *rest = keys
    if isinstance(part, BaseModel):
        fields = {name: getattr(part, name) for name in type(part).model_fields}
        fields[key] = _replaced(fields[key], rest, value)
        return type(part).model_construct(set(part.model_fields_set), **fields)
    items = list(part)
    items[int(key)] = _replaced(items[int(key)], rest, value)
    return tuple(items)
