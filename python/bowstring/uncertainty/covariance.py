"""Correlated parameters of a calibration: estimates and covariance from its result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field

from bowstring.aliases import Floats
from bowstring.errors import InputError
from bowstring.files.json_files import Content, read_json, structured
from bowstring.robot.safe_yaml import reading
from bowstring.uncertainty.paths import LOADS, NumberAtPath, NumbersByPath
from bowstring.units import printable
from bowstring.validation import numbers, shown

#: Key of the distributions, and name of the factor.
CALIBRATION: Final = "calibration"
_MOST_PARAMETERS: Final = 1_000
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


class _Parameter(Content):
    name: str
    unit: str
    value: float
    standard_error: float | None


class _Fit(Content):
    """Structure of what is read of a fit.json; null is a number that is not identifiable."""

    parameters: Annotated[list[_Parameter], Field(max_length=_MOST_PARAMETERS)]
    correlation: Annotated[
        list[Annotated[list[float | None], Field(max_length=_MOST_PARAMETERS)]],
        Field(max_length=_MOST_PARAMETERS),
    ]
    converged: bool


def _of_fit(source: Mapping[str, Any], known: NumbersByPath) -> tuple[list[str], Floats, Floats]:
    """Names, estimates and covariance in SI; NaN where a parameter is not identifiable."""
    try:
        fit = structured(dict(source), _Fit)
        every = len(fit["correlation"])
        if [len(row) for row in fit["correlation"]] != [every] * every:
            raise ValueError("correlation is not square")
        if every < len(fit["parameters"]):
            raise ValueError("correlation has too few rows")
    except ValueError as error:
        raise _error(
            "has no parameters with unit, value, standard_error and correlation; give the fit.json "
            f"of bowstring fit --out ({error})"
        ) from None
    if not fit["converged"]:
        raise _error("has not converged, and its covariance cannot be used; fit again")
    owners = [each["name"].partition(".")[0] for each in fit["parameters"]]
    kept = [i for i, owner in enumerate(owners) if owner in ("segments", "gravity", *LOADS)]
    rows = [fit["parameters"][i] for i in kept]
    names = [each["name"] for each in rows]
    value, deviation = (
        np.array([each[key] for each in rows], dtype=float) for key in ("value", "standard_error")
    )
    correlation = np.array(fit["correlation"], dtype=float).reshape(every, every)
    per_unit = np.array([known[row["name"]].read(row["name"], f"1 {row['unit']}") for row in rows])
    value, deviation = per_unit * value, per_unit * deviation
    covariance = correlation[np.ix_(kept, kept)] * np.outer(deviation, deviation)
    return names, np.where(np.isfinite(deviation), value, np.nan), covariance


def _load(path: Path) -> Any:
    label = printable(str(path))[:200]
    with reading(label):
        try:
            return read_json(path, _MOST_BYTES)
        except ValueError as error:
            if "\0" in str(path):
                raise
            raise InputError(
                f"{label} cannot be used: {error}; give the fit.json of bowstring fit"
            ) from None


def _error(sentence: str) -> InputError:
    return InputError(f"{CALIBRATION} {sentence}", argument="distributions")
