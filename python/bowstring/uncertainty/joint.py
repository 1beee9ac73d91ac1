"""Joint distribution of the uncertain numbers of a robot, its actuation and its load."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bowstring.aliases import Floats
from bowstring.display import html_table, short_repr
from bowstring.errors import InputError
from bowstring.robot.model import Robot
from bowstring.robot.safe_yaml import read_yaml, reading, text_of
from bowstring.uncertainty.covariance import CALIBRATION, read_calibration
from bowstring.uncertainty.distributions import (
    CorrelatedNormal,
    Distribution,
    LogNormal,
    Normal,
    Triangular,
    TruncatedNormal,
    Uniform,
)
from bowstring.uncertainty.paths import NumberAtPath, NumbersByPath
from bowstring.units import printable, quote
from bowstring.validation import shown

#: Probability of the outermost samples: half a step of the 30 bits of a Sobol' sequence.
LEAST_PROBABILITY: Final = 2.0**-31
#: Kinds with their fields: required, optional.
_KINDS: Final[dict[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "normal": (("sd",), ("mean", "from", "to")),
    "lognormal": (("sd",), ("mean",)),
    "uniform": (("from", "to"), ()),
    "triangular": (("from", "to"), ("mode",)),
}
_RARE: Final = 1e-3  # probability beyond which a normal distribution excludes a value
_MOST: Final = 1_000  # distributions; a Sobol' sequence has 21 201 dimensions


@short_repr
@dataclass(frozen=True, eq=False)
class Distributions:
    """Joint distribution of k numbers; made by `read_distributions`.

    Independent numbers come first, then those of a calibration, which are correlated and form one
    *factor*: Sobol' indices are defined for independent factors only.

    Attributes
    ----------
    numbers : tuple of NumberAtPath (k,)
        Paths, units and ranges, in the order of columns of samples.
    independent : tuple of Distribution
        Distributions of the first columns.
    correlated : CorrelatedNormal or None
        Joint distribution of the other columns.
    """

    numbers: tuple[NumberAtPath, ...]
    independent: tuple[Distribution, ...]
    correlated: CorrelatedNormal | None = None

    def __post_init__(self) -> None:
        if not self.numbers:
            raise InputError("distributions has no path; give at least one number a distribution")
        if len(self.numbers) > _MOST:
            raise InputError(f"distributions has {len(self.numbers)} paths, at most {_MOST} can be")
        _check_overlap(self.numbers)
        for j, number in enumerate(self.numbers):
            _check_support(number, self._marginals[j], j >= len(self.independent))

    def __len__(self) -> int:
        return len(self.numbers)

    def _repr_html_(self) -> str:
        rows = [
            (number.path, type(each).__name__, number.text(each.mean), number.text(each.sd))
            for number, each in zip(self.numbers, self._marginals, strict=True)
        ]
        return html_table("Distributions", rows, ("", "kind", "mean", "sd"))

    @property
    def paths(self) -> tuple[str, ...]:
        """Path of each column (k,)."""
        return tuple(number.path for number in self.numbers)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on distributions that exclude the nominal value, or nearly exclude it."""
        pairs = zip(self.numbers, self._marginals, strict=True)
        return tuple(text for number, each in pairs if (text := _far_from_nominal(number, each)))

    @cached_property
    def factors(self) -> tuple[str, ...]:
        """Names of the independent factors (d,): short where this is clear."""
        paths = self.paths[: len(self.independent)]
        last = [_last(path) for path in paths]
        names = [n if last.count(n) == 1 else p for n, p in zip(last, paths, strict=True)]
        if self.correlated is not None:
            names.append(CALIBRATION)
        return tuple(names)

    @cached_property
    def factor_of(self) -> NDArray[np.intp]:
        """Factor of each column (k,)."""
        return np.minimum(np.arange(len(self)), len(self.independent))

    @property
    def mean(self) -> Floats:
        """Mean of each column (k,)."""
        return np.array([each.mean for each in self._marginals])

    @property
    def sd(self) -> Floats:
        """Standard deviation of each column (k,)."""
        return np.array([each.sd for each in self._marginals])

    def ppf(self, u: ArrayLike) -> Floats:
        """Convert points of the unit cube to samples.

        Parameters
        ----------
        u : array_like (n, k)
            Independent probabilities, above 0 and below 1.

        Returns
        -------
        ndarray (n, k)
            Samples in SI.
        """
        u = np.asarray(u, dtype=float)
        values = np.empty(u.shape)
        for j, distribution in enumerate(self.independent):
            values[:, j] = distribution.ppf(u[:, j])
        if self.correlated is not None:
            values[:, len(self.independent) :] = self.correlated.ppf(u[:, len(self.independent) :])
        return values

    def by_path(self, values: ArrayLike) -> dict[str, Floats]:
        """Split samples by path.

        Parameters
        ----------
        values : array_like (n, k)
            Samples in SI.

        Returns
        -------
        dict from path to ndarray (n,)
            Values in SI of every path without ``*``; those of actuation and load are in the form
            ``tensions.0`` and ``tip_force.x``.
        """
        values = np.asarray(values, dtype=float)
        return {
            target: values[:, j]
            for j, number in enumerate(self.numbers)
            for target in number.targets
        }

    def to_dict(self) -> dict[str, Any]:
        """Return the distributions in the form of `read_distributions`, numbers in SI units."""
        out: dict[str, Any] = {}
        for number, distribution in zip(self.numbers, self.independent, strict=False):
            out[number.path] = _to_dict(number, distribution)
        if self.correlated is not None:
            out[CALIBRATION] = {
                "paths": list(self.paths[len(self.independent) :]),
                "mean": self.correlated.mean.tolist(),
                "covariance": self.correlated.covariance.tolist(),
            }
        return out

    @cached_property
    def _marginals(self) -> tuple[Distribution, ...]:
        if self.correlated is None:
            return self.independent
        pairs = zip(self.correlated.mean.tolist(), self.correlated.sd.tolist(), strict=True)
        return (*self.independent, *(Normal(mean, sd) for mean, sd in pairs))


def read_distributions(
    source: str | Path | Mapping[str, Any],
    robot: Robot,
    nominal: Mapping[str, float] | None = None,
) -> Distributions:
    """Read distributions of numbers of the robot file, the actuation and the load.

    Parameters
    ----------
    source : str, Path or mapping from path to distribution
        YAML file, or the same as a mapping. A distribution is a mapping such as
        ``{"normal": {"mean": "35 GPa", "sd": "5 %"}}`` or an object such as ``Normal(35e9, 2e9)``.
        In a file every number has its unit; in Python a number without one is SI. A share in
        percent is one of the nominal value, which also stands for a ``mean`` or ``mode`` that is
        left out. A path with ``*`` has one random number for all that it stands for. The key
        ``calibration`` takes the ``fit.json`` of a calibration (path or content): all its
        parameters that are in the robot file, with their covariance, except those that have a
        distribution of their own.
    robot : Robot
        Nominal robot.
    nominal : mapping from path to float, optional
        Nominal values of actuation and loads in SI.

    Returns
    -------
    Distributions
        Joint distribution, whose samples the robot accepts.

    Raises
    ------
    InputError
        If a path is unknown, a distribution is not valid, or its samples reach values that the
        robot refuses.

    Examples
    --------
    >>> import bowstring as bs
    >>> robot = bs.load_robot("amouri2019")
    >>> bs.uncertainty.read_distributions(
    ...     {"segments.*.backbone.E": {"normal": {"sd": "5 %"}}}, robot
    ... ).sd
    array([1.75e+09])
    """
    if isinstance(source, (str, Path)):
        path = Path(source)
        label = printable(str(source))[:200]
        with reading(label):
            text = text_of(path, label, "distributions")
        tree: Mapping[Any, Any] = read_yaml(text, label, "distributions", "segments.*.backbone.E")
        try:
            return _read(tree, robot, nominal, path.parent)
        except InputError as error:
            raise InputError(f"{label}: {error}", argument="distributions") from None
    if not isinstance(source, Mapping):
        raise InputError(
            f"distributions is {shown(source)}, it must be the name of a file or a mapping from "
            "path to distribution"
        )
    return _read(source, robot, nominal, Path())


def _read(
    tree: Mapping[Any, Any], robot: Robot, nominal: Mapping[str, float] | None, folder: Path
) -> Distributions:
    known = NumbersByPath(robot, nominal)
    own = {path: value for path, value in tree.items() if path != CALIBRATION}
    found = [known[path] for path in own]
    independent = [_one(at, value) for at, value in zip(found, own.values(), strict=True)]
    if CALIBRATION not in tree:
        return Distributions(tuple(found), tuple(independent))
    taken = {target for at in found for target in at.targets}
    rest, mean, covariance = read_calibration(tree[CALIBRATION], known, taken, folder)
    if len(rest) == 1:
        independent.append(Normal(float(mean[0]), float(np.sqrt(covariance[0, 0]))))
        return Distributions((*found, *rest), tuple(independent))
    joint = CorrelatedNormal(mean, covariance) if rest else None
    return Distributions((*found, *rest), tuple(independent), joint)


def _one(number: NumberAtPath, value: object) -> Distribution:
    """Read one distribution."""
    if isinstance(value, (Normal, TruncatedNormal, LogNormal, Uniform, Triangular)):
        return value
    kinds = ", ".join(_KINDS)
    if not isinstance(value, Mapping) or len(value) != 1:
        raise number.error(f"got {quote(value)}; must be one distribution, as {_example(number)}")
    ((kind, fields),) = value.items()
    if kind not in _KINDS:
        raise number.error(
            f"there is no distribution {quote(kind)}; known are {kinds}, as {_example(number)}"
        )
    required, optional = _KINDS[kind]
    allowed = " and ".join([", ".join((*optional, *required)[:-1]), required[-1]])
    if not isinstance(fields, Mapping):
        raise number.error(f"{kind} has {quote(fields)}; must have the fields {allowed}")
    for name in fields:
        if name not in (*required, *optional):
            raise number.error(f"{kind} has no field {quote(name)}; its fields are {allowed}")
    for name in required:
        if name not in fields:
            raise number.error(f"{kind} lacks {name}; its fields are {allowed}")
    given = {name: number.read(name, each) for name, each in fields.items()}
    return _checked(number, kind, given)


def _example(number: NumberAtPath) -> str:
    """A normal distribution about the number of the robot, as it is written."""
    fields = ", ".join([f"mean: {number.text(x)}" for x in number.nominal[:1]] + ["sd: 5 %"])
    return f"{{normal: {{{fields}}}}}"


def _checked(number: NumberAtPath, kind: str, given: Mapping[str, float]) -> Distribution:
    if "sd" in given and not 0.0 < given["sd"] < np.inf:
        raise number.error(f"sd is {number.text(given['sd'])}, it must be above zero")
    low, high = given.get("from", -np.inf), given.get("to", np.inf)
    if not low < high:
        raise number.error(
            f"from is {number.text(low)} and to {number.text(high)}; from must be below to"
        )
    if kind == "uniform":
        return Uniform(low, high)
    middle = "mode" if kind == "triangular" else "mean"
    value = given[middle] if middle in given else number.nominal_value(middle)
    if kind == "triangular":
        if not low <= value <= high:
            raise number.error(
                f"mode is {number.text(value)}, it must lie from {number.text(low)} to "
                f"{number.text(high)}"
            )
        return Triangular(low, value, high)
    if kind == "lognormal":
        if value <= 0.0:
            raise number.error(f"mean is {number.text(value)}, that of a lognormal must be above 0")
        return LogNormal(value, given["sd"])
    normal = Normal(value, given["sd"])
    if not {"from", "to"} & set(given):
        return normal
    try:
        return TruncatedNormal(normal, low, high)
    except InputError:
        raise number.error(
            "less than 1 % of this normal distribution lies between from and to; give a mean "
            "nearer to them"
        ) from None


def _check_support(number: NumberAtPath, distribution: Distribution, correlated: bool) -> None:
    """Refuse a distribution whose samples reach values that the robot refuses."""
    ends = distribution.ppf([LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY])
    if number.low <= ends[0] and ends[1] <= number.high:
        return
    if ends[0] < number.low:
        outside = distribution.cdf(number.low)
        side, rule = 0, f"at least {number.text(number.low)}"
    else:
        outside = 1.0 - distribution.cdf(number.high)
        side, rule = 1, f"at most {number.text(number.high)}"
    bound = distribution.support[side]
    reached = bound if np.isfinite(bound) else ends[side]
    cure = "give bounds within this"
    if correlated:
        cure = "give it a distribution of its own, such as lognormal"
    elif isinstance(distribution, Normal):
        cure = "truncate it by from and to"
        if number.low >= 0.0 and distribution.mean > 0.0:
            cure = f"take lognormal, or {cure}"
    share = f" ({float(outside):.2g} of them lie beyond)" if outside > 1e-4 else ""
    raise number.error(
        f"samples reach {number.text(reached, 3)}, and the robot allows {rule}{share}; {cure}"
    )


def _far_from_nominal(number: NumberAtPath, distribution: Distribution) -> str | None:
    """Warning of a distribution that excludes the nominal value; None if it has it."""
    low, high = distribution.support
    if isinstance(distribution, Normal | LogNormal):  # samples hardly ever reach their ends
        low, high = distribution.ppf([_RARE, 1.0 - _RARE])
    out = [value for value in number.nominal if not low <= value <= high]
    if not out:
        return None
    below = out[0] < low
    almost = "almost " if isinstance(distribution, Normal | LogNormal) else ""
    side, ends = (
        ("below", f"from {number.text(float(low))}")
        if below
        else ("above", f"up to {number.text(float(high))}")
    )
    return (
        f"{number.path} is {number.text(out[0])} in the robot file, {side} {almost}all samples "
        f"({ends}); if these are right, write their middle into the robot file."
    )


def _check_overlap(found: Sequence[NumberAtPath]) -> None:
    seen: dict[str, str] = {}
    for number, target in ((n, t) for n in found for t in n.targets):
        if seen.get(target) == number.path:
            raise InputError(
                f"{number.path} has two distributions; leave one of them out",
                argument="distributions",
            )
        if target in seen:
            raise InputError(
                f"{seen[target]} and {number.path} both have {target}; leave one of them out",
                argument="distributions",
            )
        seen[target] = number.path


def _last(path: str) -> str:
    """Short name of a path: its last field, or the load with its axis."""
    if not path.startswith("segments"):
        return path
    *_, last = (key for key in re.split(r"\.", path) if key != "*" and not key.isdecimal())
    return last


def _to_dict(number: NumberAtPath, distribution: Distribution) -> dict[str, dict[str, Any]]:
    def text(value: float) -> str | float:
        return f"{value!r} {number.si}" if number.si else value

    if isinstance(distribution, Uniform):
        fields = {"from": distribution.low, "to": distribution.high}
    elif isinstance(distribution, Triangular):
        low, high = distribution.support
        fields = {"from": low, "mode": distribution.mode, "to": high}
    else:
        normal = distribution.normal if isinstance(distribution, TruncatedNormal) else distribution
        fields = {"mean": normal.mean, "sd": normal.sd}
    if isinstance(distribution, TruncatedNormal):
        bounds = dict(zip(("from", "to"), distribution.support, strict=True))
        fields |= {name: bound for name, bound in bounds.items() if np.isfinite(bound)}
    truncated = isinstance(distribution, TruncatedNormal)
    kind = "normal" if truncated else type(distribution).__name__.lower()
    return {kind: {name: text(value) for name, value in fields.items()}}
