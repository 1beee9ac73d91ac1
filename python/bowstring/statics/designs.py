"""Sweeps of many robots in one call of the core."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.display import short_repr
from bowstring.errors import InputError
from bowstring.robot.designs import Designs
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel, as_model
from bowstring.validation import floats, shown

__all__ = ["DesignSweep", "sweep_designs"]

Floats = NDArray[np.float64]


@short_repr
@dataclass(frozen=True)
class DesignSweep:
    """Equilibria of D robots at L loads each; made by `sweep_designs`.

    Loads that did not converge hold NaN.
    """

    designs: Designs
    """The robots."""
    tensions: Floats
    """Tensions (D, L, T), N."""
    converged: NDArray[np.bool_]
    """Whether each load converged (D, L)."""
    status: NDArray[np.str_]
    """Status as of `bowstring.Solution`, (D, L)."""
    tip_position: Floats
    """Tips (D, L, 3), m."""
    tendon_lengths: Floats
    """Lengths of the tendons (D, L, T), m."""
    tip_error: Floats
    """Estimated discretisation error of the tip (D, L), m."""


def sweep_designs(
    designs: Designs,
    tensions: ArrayLike,
    *,
    load: Load | None = None,
    model: RodModel | None = None,
    threads: int = 0,
) -> DesignSweep:
    """Solve the loads of many robots in sequence, each load from the one before, on all cores.

    Parameters
    ----------
    designs : Designs
        The robots.
    tensions : array_like (L, T) or (D, L, T)
        Tensions in N, the same for all robots or of each.
    load : Load, optional
        Gravity, tip force and tip moment, (3,) or (D, 3) or (D, L, 3); gravity is that of the
        robots if left out.
    model : RodModel, optional
        As for `bowstring.solve`.
    threads : int
        Number of threads; 0 takes one for each core. The solutions do not depend on it.

    Returns
    -------
    DesignSweep

    Raises
    ------
    InputError
        If an argument is wrong; nothing is solved then.

    Examples
    --------
    >>> import numpy as np
    >>> import bowstring as bs
    >>> from bowstring.robot.designs import Designs
    >>> from bowstring.statics.designs import sweep_designs
    >>> robots = Designs(bs.load_robot("amouri2019"), {"segments.*.backbone.E": [30e9, 35e9, 40e9]})
    >>> found = sweep_designs(robots, np.outer([0, 40, 80], [1, 0, 0]))
    >>> found.tip_position.shape
    (3, 3, 3)
    """
    if not isinstance(designs, Designs):
        raise InputError(f"designs is {shown(designs)}, it must be Designs of robots")
    count, tendons = len(designs), len(designs.robot.tendons.segment)
    given = floats(tensions)
    if given.ndim not in (2, 3) or given.shape[-1] != tendons:
        raise InputError(
            f"tensions has shape {given.shape}, it must be (L, {tendons}) or (D, L, {tendons})"
        )
    if given.ndim == 3 and given.shape[0] != count:
        raise InputError(f"tensions has {given.shape[0]} robots, the designs are {count}")
    each = given.shape[-2]
    rows = np.ascontiguousarray(np.broadcast_to(given, (count, each, tendons)))

    def wide(name: str, value: ArrayLike | None, otherwise: Floats | None) -> Floats | None:
        if value is None:
            if otherwise is None:
                return None
            array = otherwise
        else:
            array = floats(value)
        if array.shape == (3,):
            return array
        if array.shape == (count, 3):
            array = array[:, None, :]
        if array.shape not in ((count, 1, 3), (count, each, 3)):
            raise InputError(
                f"{name} has shape {array.shape}, it must be (3,), ({count}, 3) or "
                f"({count}, {each}, 3)"
            )
        return np.ascontiguousarray(np.broadcast_to(array, (count, each, 3))).reshape(-1, 3)

    load = Load() if load is None else load
    varies = any(path.startswith("gravity") for path in designs.values)
    dead = Load(
        gravity=wide("gravity", load.gravity, designs.gravity if varies else None),
        tip_force=wide("tip_force", load.tip_force, None),
        tip_moment=wide("tip_moment", load.tip_moment, None),
    )
    found = designs.robot.core.sweep_designs(
        designs, rows.reshape(-1, tendons), dead, as_model(model), threads
    )
    shape = (count, each)
    return DesignSweep(
        designs,
        rows,
        found["converged"].reshape(shape),
        np.array(found["status"]).reshape(shape),
        found["tip_position"].reshape(*shape, 3),
        found["tendon_lengths"].reshape(*shape, tendons),
        found["tip_error"].reshape(shape),
    )
