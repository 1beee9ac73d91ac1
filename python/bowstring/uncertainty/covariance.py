"""Correlated parameters of a calibration: estimates and covariance from its result."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bowstring.atomic_io import readable
from bowstring.errors import InputError
from bowstring.robot.safe_yaml import reading
from bowstring.uncertainty.paths import LOADS, NumberAtPath, NumbersByPath
from bowstring.units import printable
from bowstring.validation import numbers, shown

__all__ = ["CALIBRATION", "read_calibration"]

Floats = NDArray[np.float64]

#: Key of the distributions, and name of the factor.
CALIBRATION: Final = "calibration"
_MOST_BYTES: Final = 64_000_000  # fit.json also has the residuals of all rows


def read_calibration(
    source: object, known: NumbersByPath, taken: set[str], folder: Path
) -> tuple[tuple[NumberAtPath, ...], Floats, Floats]:
    """Read the parameters of a calibration that are in the robot file.

    Parameters of the actuation and the frames are integrated out, as are those in `taken`: the
    others keep their means and covariance.

    Parameters
    ----------
    source : str, Path or mapping
        ``fit.json``, its content, or ``{"paths": ..., "mean": ..., "covariance": ...}`` in SI.
    known : NumbersByPath
    taken : set of str
        Paths that have a distribution of their own.
    folder : Path
        Folder of a relative path.

    Returns
    -------
    tuple
        Numbers (k,), means (k,) and covariance (k, k) in SI.
    """
    if isinstance(source, (str, Path)):
        source = _load(folder / source)
    if not isinstance(source, Mapping):
        raise _error(f"is {shown(source)}, it must be the fit.json of bowstring fit or its content")
    if "covariance" in source:
        names = [str(name) for name in source.get("paths", ())]
        mean = numbers("mean of the calibration", source.get("mean"), (len(names),))
        size = (len(names), len(names))
        covariance = numbers("covariance of the calibration", source["covariance"], size)
    else:
        names, mean, covariance = _of_fit(source, known)
    found, keep = [], []
    for i, name in enumerate(names):
        number = known[name]
        if taken.isdisjoint(number.targets):
            found.append(number)
            keep.append(i)
        elif not taken.issuperset(number.targets):
            raise number.error("only a part of it has a distribution of its own; give all or none")
    undetermined = [name for i, name in enumerate(names) if i in keep and np.isnan(mean[i])]
    if undetermined:
        raise _error(
            f"does not determine {undetermined[0]}; hold it in the fit, or give it a distribution "
            "of its own"
        )
    if not found and not taken:
        raise _error("has no parameter of the robot file")
    return tuple(found), mean[keep], covariance[np.ix_(keep, keep)]


def _of_fit(source: Mapping[str, Any], known: NumbersByPath) -> tuple[list[str], Floats, Floats]:
    """Names, estimates and covariance in SI; NaN where a parameter is not identifiable."""
    try:
        rows = [each for each in source["parameters"] if _in_file(each["name"])]
        kept = [_in_file(each["name"]) for each in source["parameters"]]
        names = [each["name"] for each in rows]
        units = [each["unit"] for each in rows]
        value, error = (
            np.array([each[key] for each in rows], dtype=float)
            for key in ("value", "standard_error")
        )
        correlation = np.array(source["correlation"], dtype=float)[np.ix_(kept, kept)]
        converged = source["converged"]
    except (KeyError, TypeError, ValueError, AttributeError, IndexError):
        raise _error(
            "has no parameters with unit, value, standard_error and correlation; give the fit.json "
            "of bowstring fit --out"
        ) from None
    if not converged:
        raise _error("has not converged, and its covariance cannot be used; fit again")
    per_unit = np.array(
        [known[n].read(n, f"1 {unit}") for n, unit in zip(names, units, strict=True)]
    )
    value, error = per_unit * value, per_unit * error
    return names, np.where(np.isfinite(error), value, np.nan), correlation * np.outer(error, error)


def _in_file(name: str) -> bool:
    return name.partition(".")[0] in ("segments", "gravity", *LOADS)


def _load(path: Path) -> Any:
    label = printable(str(path))[:200]
    with reading(label):
        with readable(path) as file:
            data = file.read(_MOST_BYTES + 1)
        if len(data) > _MOST_BYTES:
            raise InputError(f"{label} is too large; a fit.json has at most 64 MB")
        try:
            return json.loads(data)
        except (ValueError, RecursionError):
            raise InputError(f"{label} is not JSON; give the fit.json of bowstring fit") from None


def _error(sentence: str) -> InputError:
    return InputError(f"{CALIBRATION} {sentence}", argument="distributions")
