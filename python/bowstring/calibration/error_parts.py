"""Parts of the error of constant curvature: differences of mean errors of nested models."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.calibration import observations
from bowstring.calibration.observations import Measured
from bowstring.errors import NoSolutionError
from bowstring.formatting import in_mm
from bowstring.results import Key, Result

NoiseSource = Literal["repeats", "stated"]

#: Mean length of a normal vector over the standard deviation of its three coordinates (Maxwell).
_MEAN_LENGTH: Final = math.sqrt(8.0 / math.pi)
#: Least number of degrees of freedom for noise from repeats, three coordinates each.
_FEWEST: Final = 5

#: Errors below this are numerical, m.
_NOTHING: Final = 1e-8
PARTS: Final = {
    "parameters": "parameters and geometry",
    "physics": "physics of the rod",
    "memory": "memory",
    "noise": "measurement noise",
    "unexplained": "unexplained",
}
"""Attributes of the parts, and their names in words, in order."""
#: What to do about the largest part.
_ADVICE: Final = {
    "parameters": "mend these first, by calibration",
    "physics": "use statics of the rod first",
    "memory": "add {memory} to the rod first",
    "noise": "no model mends that",
    "unexplained": "look for missing physics (gravity, payloads, contact) and for errors of the "
    "data first",
}


@dataclass(frozen=True)
class ErrorParts(Result):
    """Parts of the mean error of constant curvature, which add up to the total.

    Each is the mean error of a model less that of the next one on the same rows, and negative where
    the next one is worse.
    """

    total: Annotated[float, Key("total_mm")]
    """Mean error of constant curvature as the robot file has it, m."""
    parameters: Annotated[float, Key("parameters_mm")]
    """Parameters and geometry: what calibration of constant curvature removes, m."""
    physics: Annotated[float, Key("physics_mm")]
    """Physics: what the calibrated rod removes beyond that, m."""
    memory: Annotated[float, Key("memory_mm")]
    """What the chosen memory removes beyond that, m; 0 without one."""
    noise: Annotated[float | None, Key("noise_mm")]
    """Mean error that the noise of the measurements gives a perfect model, m; None if that is not
    known."""
    unexplained: Annotated[float, Key("unexplained_mm")]
    """What is left, with the noise if that is not known, m."""
    noise_source: Annotated[NoiseSource | None, Key()]
    """Source of the noise: scatter of repeats, or the stated uncertainty; None if not known."""
    rows: Annotated[int, Key()]
    """Number of rows, which all models of the parts predict."""

    @property
    def known(self) -> dict[str, float]:
        """Parts by attribute, in order; without noise if that is not known."""
        return {name: value for name in PARTS if (value := getattr(self, name)) is not None}

    def called(self, name: str) -> str:
        """Name of a part in words."""
        with_noise = name == "unexplained" and self.noise is None
        return "unexplained or noise" if with_noise else PARTS[name]

    def verdict(self, memory: str) -> str:
        """Sentence on the largest part and what to do; `memory` names the chosen one."""
        name = max(self.known, key=lambda each: self.known[each])
        most = self.known[name]
        if most < _NOTHING:
            return "Constant curvature has no error on these rows."
        share, verb = ("Most", "are") if most > 0.5 * self.total else ("The largest part", "is")
        return (
            f"{share} of the {in_mm(self.total)} of constant curvature {verb} {self.called(name)} "
            f"({in_mm(most)}): {_ADVICE[name].format(memory=memory)}."
        )


def parts_of(
    stated: Floats,
    arcs: Floats,
    rod: Floats,
    memory: Floats | None,
    noise: tuple[Floats, NoiseSource] | None,
) -> ErrorParts:
    """Divide the mean error of constant curvature.

    Parameters
    ----------
    stated, arcs, rod : ndarray (K,)
        Errors of constant curvature as the robot file has it, of the same calibrated, and of the
        calibrated rod, m; NaN where a row has none.
    memory : ndarray (K,), optional
        Errors of the rod with the chosen memory.
    noise : tuple of ndarray (K,) and str, optional
        Standard uncertainty of a coordinate in each row, and its source.

    Returns
    -------
    ErrorParts
        Parts over the rows that all these models predict.
    """
    last = rod if memory is None else memory
    errors = np.stack([stated, arcs, rod, last])
    seen = np.isfinite(errors).all(axis=0)
    if not seen.any():
        raise NoSolutionError("no held-out row has a solution of all models")
    a, b, d, e = errors[:, seen].mean(axis=1).tolist()
    of_noise = None if noise is None else _MEAN_LENGTH * float(noise[0][seen].mean())
    return ErrorParts(
        total=a,
        parameters=a - b,
        physics=b - d,
        memory=d - e,
        noise=of_noise,
        unexplained=e - (of_noise or 0.0),
        noise_source=None if noise is None else noise[1],
        rows=int(seen.sum()),
    )


def noise_of(data: Measured, values: Floats, measured: Floats) -> tuple[Floats, NoiseSource] | None:
    """Standard uncertainty (K,) of a coordinate by repeats, else as stated, and its source.

    Repeats are rows with the same commands (K, T) and group in different runs. With a memory the
    first run may differ from the others, which counts as noise here.
    """
    if (scatter := _of_repeats(data, values, measured)) is not None:
        return np.full(len(measured), scatter), "repeats"
    sigma = observations.sigmas(data, len(measured))
    return None if sigma is None else (sigma, "stated")


def _of_repeats(data: Measured, values: Floats, measured: Floats) -> float | None:
    """Pooled standard deviation of a coordinate of repeated rows, m; None with too few."""
    repeat = getattr(data, "repeat", None)
    if repeat is None or len(np.unique(repeat)) < 2:
        return None
    group = getattr(data, "group", None)
    label = np.zeros(len(values), int) if group is None else observations.numbered(group)
    cell = observations.numbered(np.stack([observations.loads(values), label], axis=1))
    seen = np.isfinite(measured).all(axis=1)
    square, free = 0.0, 0
    for number in np.unique(cell[seen]).tolist():
        rows = np.flatnonzero(seen & (cell == number))
        if len(np.unique(np.asarray(repeat)[rows])) < len(rows):
            continue  # loading and unloading: the same load with two histories
        square += float(((measured[rows] - measured[rows].mean(axis=0)) ** 2).sum())
        free += len(rows) - 1
    return math.sqrt(square / (3 * free)) if free >= _FEWEST else None
