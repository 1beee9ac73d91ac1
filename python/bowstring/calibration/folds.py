"""Cross-validation: blocks of neighbouring rows, each left out of a fit to the others."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bowstring.aliases import Bools, Floats, Ints
from bowstring.calibration import observations
from bowstring.calibration.observations import Measured
from bowstring.errors import InputError
from bowstring.validation import is_whole, shown


def part_of_rows(
    data: Measured, values: Floats, used: Bools, folds: int
) -> tuple[Ints, NDArray[Any]]:
    """Part (K,) of each row in `cross_validate`, from 0, and the groups (K,) that no part splits.

    Raises
    ------
    InputError
        If the groups cannot be divided into so many parts.
    """
    if not is_whole(folds) or folds < 2:
        raise InputError(f"folds is {shown(folds)}, it must be a whole number from 2")
    group = _groups_of_folds(data, values, used)
    return _blocks(group, used, int(folds)), group


def parts(data: Measured, values: Floats, used: Bools, folds: int) -> Ints:
    """Divide rows into the parts of `cross_validate`.

    Parameters
    ----------
    data : Measurements or Data
        Rows, of which the groups and repeats are used.
    values : ndarray (K, T)
        Commands of all rows.
    used : ndarray of bool (K,)
        Rows that count.
    folds : int
        Number of parts; fewer where there are fewer groups.

    Returns
    -------
    ndarray of int (K,)
        Part of each row, from 0.
    """
    group = _groups_of_folds(data, values, used)
    count = len(np.unique(group[used]))
    folds = min(folds, count) if count > 1 else folds
    while folds > 2 and count > 1:
        try:
            return _blocks(group, used, folds)
        except InputError:  # groups of unequal size
            folds -= 1
    if count > 1:
        return observations.numbered(group) % 2
    return _blocks(np.zeros(len(group)), used, folds)


def _groups_of_folds(data: Measured, values: Floats, used: Bools) -> NDArray[Any]:
    """Groups (K,) that no part splits; the loads where they repeat without other groups."""
    group = observations.groups(data, len(values))
    load = observations.loads(values)
    if observations.repeats_loads(load[used]) and not _has_own_groups(data, group):
        group = np.array([f"load {number}" for number in (1 + load).tolist()])
    return group


def _has_own_groups(data: Measured, group: NDArray[Any]) -> bool:
    """Whether rows have groups that are no mere repeats of loads."""
    repeat = getattr(data, "repeat", None)
    return len(np.unique(group)) > 1 and (repeat is None or len(np.unique(repeat)) < 2)


def _blocks(group: NDArray[Any], used: Bools, folds: int) -> Ints:
    """Part (K,) of each row: neighbouring groups, with about the same number of rows per part."""
    number = observations.numbered(group)
    groups = int(number.max()) + 1
    if groups == 1:
        order = np.cumsum(used) - 1
        return np.array(np.minimum(order * folds // max(int(used.sum()), 1), folds - 1))
    if groups < folds:
        raise InputError(
            f"folds is {folds}, there are only {groups} groups or loads to leave out",
            argument="folds",
        )
    counts = np.bincount(number, used)
    middle = np.cumsum(counts) - counts / 2
    of_group = np.minimum((middle * folds / counts.sum()).astype(int), folds - 1)
    if len(np.unique(of_group)) < folds:
        raise InputError(
            f"folds is {folds}, but the groups or loads are too unequal for so many parts; take "
            "fewer",
            argument="folds",
        )
    return np.asarray(of_group[number])
