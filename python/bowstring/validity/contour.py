"""Contour of a function over a rectangle, by refining the cells that it crosses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from bowstring.aliases import Bools, Floats

Line = Floats
"""Points (n, 2) of a line."""


class Refined(NamedTuple):
    """Functions on a refined grid."""

    x: Floats
    """Points along x (U,)."""
    y: Floats
    """Points along y (V,)."""
    values: list[Floats]
    """Values of each function (V, U): computed near its lines, linear between points elsewhere."""
    lines: list[list[Line]]
    """Lines (n, 2) of each function."""


_CELLS: Final = 128  # least number of cells along an axis where a line crosses
_MOST: Final = 8  # most halvings of a cell
_SPLIT: Final = 8  # parts of an interval in which a function of one number crosses
_MOST_SPLITS: Final = 10
_SHARP: Final = 1e-3  # width of such an interval over its end at which it is not split
_FINEST: Final = 1e-6  # width at which it is not split, over the range of all points
_ROUNDS: Final = 200  # most steps along a line at one spacing


def contours(
    x: Floats,
    y: Floats,
    values: Sequence[Floats],
    level: float,
    evaluate: Callable[[Floats], Sequence[Floats]],
    whole: tuple[bool, bool] = (False, False),
) -> Refined:
    """Find the lines on which functions have a level.

    The cells of the grid with corners on both sides of the level, and those beside them, are halved
    until an axis has 128 of them, and each line is followed from cell to cell. Between the points
    of these the functions are linear, so that a line is found far better than to 1 % of an axis. An
    island between the points of the grid is not seen.

    Parameters
    ----------
    x, y : ndarray (X,), (Y,)
        Points of the grid, increasing.
    values : sequence of ndarray (Y, X)
        Values of each function on the grid; NaN where it has none.
    level : float
    evaluate : callable
        Maps points (P, 2) to the values (P,) of all functions.
    whole : (bool, bool)
        Whether x and y have whole numbers only, which are not refined.

    Returns
    -------
    Refined
        Lines of each function, and the grid on which they were found.
    """
    from contourpy import contour_generator

    x, y = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    grids = [np.array(v, dtype=float) for v in values]
    known = np.ones(grids[0].shape, bool)
    for _ in range(_MOST):
        split = [
            not one and len(axis) - 1 < _CELLS for axis, one in zip((x, y), whole, strict=True)
        ]
        if not any(split):
            break
        x, y, grids, known = _halved(x, y, grids, known, split)
        # follow lines into cells in which the coarse grid showed none
        for _ in range(_ROUNDS):
            crossed = np.any([_crossed(grid, level) for grid in grids], axis=0)
            rows, columns = np.nonzero(_points_around(crossed) & ~known)
            if not rows.size:
                break
            found = evaluate(np.stack([x[columns], y[rows]], axis=1))
            for grid, new in zip(grids, found, strict=True):
                grid[rows, columns] = new
            known[rows, columns] = True
    lines = []
    for grid in grids:
        on_level: Any = contour_generator(x, y, np.ma.masked_invalid(grid)).lines(level)
        lines.append([np.asarray(line) for line in on_level])
    return Refined(x, y, grids, lines)


def halved(
    x: Floats, values: Sequence[Floats], evaluate: Callable[[Floats], Sequence[Floats]]
) -> tuple[Floats, list[Floats]]:
    """Halve the steps of functions of one number until they are 1/128 of its range.

    Between two points without a value of any function nothing is evaluated.

    Parameters
    ----------
    x : ndarray (X,)
        Points, increasing.
    values : sequence of ndarray (X,)
        Values of each function there; NaN where it has none.
    evaluate : callable
        Maps points (P,) to the values (P,) of all functions.

    Returns
    -------
    x : ndarray (U,)
        Points, the given ones among them.
    values : list of ndarray (U,)
        Values of each function there.
    """
    grid = np.stack([np.asarray(one, dtype=float) for one in values])
    while len(x) - 1 < _CELLS:
        known = np.isfinite(grid).any(axis=0)
        wanted = known[1:] | known[:-1]
        x, coarse = _between(x), grid
        grid = np.full((len(coarse), len(x)), np.nan)
        grid[:, ::2] = coarse
        if wanted.any():
            grid[:, 1::2][:, wanted] = np.stack(list(evaluate(x[1::2][wanted])))
    return x, list(grid)


def crossings(
    x: Floats,
    values: Sequence[Floats],
    level: float,
    evaluate: Callable[[Floats], Sequence[Floats]],
) -> list[Floats]:
    """Find where functions of one number cross a level, to 0.1 % of the number.

    Parameters
    ----------
    x : ndarray (X,)
        Points, increasing.
    values : sequence of ndarray (X,)
        Values of each function there; NaN where it has none.
    level : float
    evaluate : callable
        Maps points (P,) to the values (P,) of all functions.

    Returns
    -------
    list of ndarray (n,)
        Crossings of each function, increasing.
    """
    # ends, and their values, of the intervals of each function in which it crosses
    found = [_brackets(x, np.asarray(one, dtype=float), level) for one in values]
    finest = _FINEST * float(x[-1] - x[0])
    for _ in range(_MOST_SPLITS):
        wide = [
            b[:, 1] - b[:, 0] > np.maximum(_SHARP * np.abs(b[:, :2]).max(1), finest) for b in found
        ]
        ends = np.concatenate([b[w, :2] for b, w in zip(found, wide, strict=True)])
        if not len(ends):
            break
        inner = np.linspace(ends[:, 0], ends[:, 1], _SPLIT + 1, axis=1)
        new = evaluate(inner[:, 1:-1].ravel())
        first = 0
        for i, (one, some) in enumerate(zip(found, wide, strict=True)):
            last = first + int(some.sum())
            parts = [one[~some]]
            rows = np.asarray(new[i]).reshape(len(ends), -1)[first:last]
            for old, places, row in zip(one[some], inner[first:last], rows, strict=True):
                part = _brackets(places, np.array([old[2], *row, old[3]]), level)
                parts.append(part if len(part) else old[None])
            found[i], first = np.concatenate(parts), last
    return [
        np.sort(b[:, 0] + (level - b[:, 2]) / (b[:, 3] - b[:, 2]) * (b[:, 1] - b[:, 0]))
        for b in found
    ]


def holding(x: Floats, values: Floats, marks: Floats, level: float) -> Floats:
    """Ranges (n, 2) in which a function of one number is at most a level.

    Parameters
    ----------
    x : ndarray (X,)
        Points, increasing.
    values : ndarray (X,)
        Values there; NaN where the function has none.
    marks : ndarray (n,)
        Where it crosses the level; without marks a range ends at its last point.
    level : float

    Returns
    -------
    ndarray (n, 2)
    """
    inside = np.isfinite(values) & (np.nan_to_num(values) <= level)
    out = []
    for first, last in runs(inside):
        before = marks[(marks >= x[max(first - 1, 0)]) & (marks <= x[first])]
        beyond = marks[(marks >= x[last]) & (marks <= x[min(last + 1, len(x) - 1)])]
        low = before.max() if before.size else x[first]
        out.append((low, beyond.min() if beyond.size else x[last]))
    return np.array(out).reshape(-1, 2)


def runs(mask: Bools) -> list[tuple[int, int]]:
    """First and last index of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(first), int(after) - 1) for first, after in edges.reshape(-1, 2)]


def _brackets(x: Floats, values: Floats, level: float) -> Floats:
    """Intervals (n, 4) between neighbours on both sides of a level: ends, and values there."""
    above, known = values > level, np.isfinite(values)
    at = np.flatnonzero((above[1:] != above[:-1]) & known[1:] & known[:-1])
    return np.stack([x[at], x[at + 1], values[at], values[at + 1]], axis=1)


def _crossed(grid: Floats, level: float) -> Bools:
    """Cells (Y - 1, X - 1) with corners on both sides of the level, or with and without values."""
    corners = np.stack([grid[:-1, :-1], grid[:-1, 1:], grid[1:, :-1], grid[1:, 1:]])
    above, below = corners > level, corners <= level
    some, none = above.any(axis=0), below.any(axis=0)
    missing = np.isnan(corners)
    return np.asarray((some & none) | (missing.any(axis=0) & ~missing.all(axis=0)))


def _points_around(cells: Bools) -> Bools:
    """Points (Y, X) of cells (Y - 1, X - 1) and of all cells beside them."""
    from scipy.ndimage import binary_dilation

    return np.asarray(binary_dilation(np.pad(cells, (0, 1)), np.ones((4, 4)), origin=-1))


def _halved(
    x: Floats,
    y: Floats,
    grids: list[Floats],
    known: Bools,
    split: Sequence[bool],
) -> tuple[Floats, Floats, list[Floats], Bools]:
    """The grid with half the spacing along the axes in `split`.

    Returns the axes, the values (linear between known points), and which of them are known.
    """
    wide, tall = split
    new_x, new_y = (_between(axis) if one else axis for axis, one in ((x, wide), (y, tall)))
    grids = [_spread(grid, wide, tall) for grid in grids]
    is_known = np.zeros((len(new_y), len(new_x)), bool)
    is_known[:: 1 + tall, :: 1 + wide] = known
    return new_x, new_y, grids, is_known


def _between(values: Floats) -> Floats:
    """Values and, between each two along the first axis, their mean."""
    out = np.empty((2 * len(values) - 1, *values.shape[1:]))
    out[::2] = values
    out[1::2] = 0.5 * (values[:-1] + values[1:])
    return out


def _spread(grid: Floats, wide: bool, tall: bool) -> Floats:
    for axis, one in ((1, wide), (0, tall)):
        if one:
            grid = np.moveaxis(_between(np.moveaxis(grid, axis, 0)), 0, axis)
    return np.ascontiguousarray(grid)
