"""Tests whether the residuals of a calibrated model are noise, or the model lacks an effect.

The size of the residuals is compared with the stated uncertainty and with the scatter of repeats
(lack of fit). The autocorrelation of neighbours along the load is compared with zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from scipy import special

from bowstring.aliases import Bools, Floats, Ints
from bowstring.formatting import in_mm, listed, significant
from bowstring.results import Key, Result
from bowstring.significance import NOISE, chi_square_p, variance_ratio_p

_FEW: Final = 8  # least number of pairs of neighbours for a test
_FAR: Final = 5.0  # standard deviations of a coordinate
_WRONG: Final = 10.0  # robust standard deviations of an outlier among repeats
_FEW_WRONG: Final = 0.05  # largest share of outliers
_NOTHING: Final = 1e-8  # m; smaller residuals are rounding errors and tolerances, not noise
_MOST_LINES: Final = 5  # lines named in a message


@dataclass(frozen=True)
class NoiseTest(Result):
    """Tests whether residuals are noise."""

    rms: Annotated[float, Key("rms_of_a_coordinate_mm")]
    """RMS of a coordinate with respect to the degrees of freedom, m; NaN without any."""
    dof: Annotated[int, Key()]
    """Degrees of freedom: residual coordinates less parameters."""
    sigma: Annotated[float, Key("stated_sigma_mm")] = math.nan
    """Stated standard deviation of a coordinate (RMS over rows), m; NaN if not stated."""
    scatter: Annotated[float, Key("scatter_of_repeats_mm")] = math.nan
    """Standard deviation of a coordinate from the scatter of repeats, m; NaN without repeats."""
    chi_square: Annotated[float, Key()] = math.nan
    """Chi-square: sum of squares over the stated variance; NaN if not stated."""
    variance_p: Annotated[float, Key()] = math.nan
    """P-value of the chi-square test; NaN if not possible."""
    lack_of_fit_ratio: Annotated[float, Key()] = math.nan
    """F ratio: variance of the means of repeats over that within repeats; NaN without repeats."""
    lack_of_fit_p: Annotated[float, Key()] = math.nan
    """P-value of the F test; NaN if not possible."""
    autocorrelation: Annotated[float, Key()] = math.nan
    """Autocorrelation of neighbours along the load, pooled over axes; NaN with too few rows."""
    autocorrelation_p: Annotated[float, Key()] = math.nan
    """One-sided p-value of the autocorrelation; NaN if not possible."""
    outliers: Annotated[int, Key("outlier_rows")] = 0
    """Number of rows with a coordinate beyond five standard deviations."""
    outlier_lines: tuple[int, ...] = ()
    """Lines of these rows."""
    wrong_lines: Annotated[tuple[int, ...], Key("lines_against_their_repeats")] = ()
    """Lines that contradict repeats of their load; the tests leave them out."""
    wrong_by: float = 0.0
    """Largest residual coordinate in these lines, m."""
    other_load: Annotated[bool, Key()] = False
    """Whether a constant load outside the model would explain clearly more."""
    significance_level: Annotated[float, Key()] = NOISE
    """P-value below which a test rejects noise."""

    @property
    def wrong_size(self) -> bool:
        """Whether the residuals are larger than noise, by repeats if there are any."""
        p_value = self.lack_of_fit_p if math.isfinite(self.lack_of_fit_p) else self.variance_p
        return p_value < NOISE  # False for NaN

    @property
    def in_order(self) -> bool:
        """Whether the residuals are significantly autocorrelated."""
        return self.autocorrelation_p < NOISE

    @property
    def nothing_left(self) -> bool:
        """Whether the residuals are of rounding size, as for simulated data without noise."""
        return self.rms < _NOTHING

    @property
    def tested(self) -> bool:
        """Whether any test was possible."""
        return not self.nothing_left and any(
            map(math.isfinite, (self.variance_p, self.lack_of_fit_p, self.autocorrelation_p))
        )

    @property
    def is_noise(self) -> Annotated[bool | None, Key("noise")]:
        """Whether the residuals are noise; None if no test was possible."""
        if self.nothing_left:
            return None
        if self.other_load or self.wrong_size or self.in_order:
            return False
        return True if self.tested else None

    @property
    def text(self) -> Annotated[str, Key()]:
        """Results in one or two sentences."""
        if self.nothing_left:
            return (
                "Nothing is left to be tested: the calibrated model meets the data to 0.00001 mm, "
                "which no measurement allows."
            )
        if self.is_noise is None:
            return (
                "Whether the residuals are noise cannot be said: the table states no uncertainty, "
                "has no repeats, and too few rows."
            )
        parts = []
        if math.isfinite(self.variance_p):
            ratio = math.sqrt(self.chi_square / self.dof)
            parts.append(
                f"their RMS over the stated uncertainty of {in_mm(self.sigma)} is {ratio:.2f} "
                f"(chi-square {significant(self.chi_square)} for {self.dof} degrees of freedom, "
                f"{_p_value(self.variance_p)})"
            )
        if math.isfinite(self.lack_of_fit_p):
            times = significant(math.sqrt(self.lack_of_fit_ratio), 2)
            parts.append(
                f"what repeats have in common is {times} times what their own scatter of "
                f"{in_mm(self.scatter)} explains ({_p_value(self.lack_of_fit_p)})"
            )
        if math.isfinite(self.autocorrelation_p):
            parts.append(
                f"neighbours along the load correlate by {self.autocorrelation:.2f} "
                f"({_p_value(self.autocorrelation_p)})"
            )
        if self.other_load:
            parts.append("a constant load that the model does not have would explain them in part")
        said = "; ".join(parts)
        if self.is_noise:
            out = f"These data show no departure of the residuals from noise: {said}."
            if self.variance_p < NOISE:
                out += " The stated uncertainty is too small: the repeats scatter by more."
        else:
            out = (
                f"The residuals are not noise: {said}. Something acts on the robot or on the "
                "measurement that the calibrated model does not have, and the intervals of its "
                "parameters do not allow for the resulting bias."
            )
        if self.outliers:
            rows = "One row is" if self.outliers == 1 else f"{self.outliers} rows are"
            out += (
                f" {rows} more than five standard deviations away ({_lines(self.outlier_lines)})."
            )
        if self.wrong_lines:
            one = len(self.wrong_lines) == 1
            errs, them = ("errs by", "it") if one else ("err by up to", "them")
            out += (
                f" {_lines(self.wrong_lines).capitalize()} {errs} {in_mm(self.wrong_by)}, and "
                f"repeats of the same load do not: these tests leave {them} out, all other numbers "
                f"have {them}; look at {them}."
            )
        return out


def _p_value(probability: float) -> str:
    return "p < 0.0001" if probability < 1e-4 else f"p = {significant(probability, 2)}"


def _lines(lines: tuple[int, ...]) -> str:
    named = [str(line) for line in lines[:_MOST_LINES]]
    if len(lines) > _MOST_LINES:
        return f"lines {', '.join(named)} and {len(lines) - _MOST_LINES} more"
    return f"line{'s' * (len(lines) > 1)} {listed(named)}"


def _wrong(e: Floats, cells: Ints) -> Bools:
    """Outliers (K,): large residuals where another row of the same cell has a small one."""
    usual = 1.4826 * float(np.median(np.abs(e))) if len(e) else 0.0
    off = np.abs(e).max(axis=1, initial=0.0) > _WRONG * usual
    _, place = np.unique(cells, return_inverse=True)
    has_good = np.bincount(place, ~off) > 0
    wrong = off & has_good[place] & (usual > 0.0)
    # too many for outliers: the rows are no repeats
    return np.asarray(wrong & (wrong.sum() <= max(1, _FEW_WRONG * len(e))))


def autocorrelation(residual: Floats, near: Bools) -> tuple[float, float]:
    """Compute the autocorrelation of neighbours, pooled over coordinates, and its p-value.

    The coordinates of a row may have different variances and be correlated, as those of several
    points are, and those of a tip whose command is noisy.

    Parameters
    ----------
    residual : array (K, C)
        Model minus measurement, m.
    near : array of bool (K - 1,)
        Whether a row and the next are neighbours.

    Returns
    -------
    correlation, p_value : float
        NaN with too few neighbours. The p-value is one-sided, by the normal limit; a fit lowers the
        correlation a little, which is conservative.
    """
    squares = np.sum(residual**2, axis=0)
    pairs, count = int(near.sum()), len(residual)
    if pairs < _FEW or squares.sum() == 0.0:
        return math.nan, math.nan
    products = float(np.sum(residual[1:][near] * residual[:-1][near]))
    moments = residual.T @ residual
    deviation = math.sqrt(pairs * float(np.sum(moments**2))) / count
    correlation = products / pairs * count / float(squares.sum())
    return min(max(correlation, -1.0), 1.0), float(special.ndtr(-products / deviation))


def noise_test(
    residual: Floats,
    run: Ints,
    cell: Ints,
    parameters: int,
    sigma: Floats | None = None,
    *,
    line: Ints | None = None,
    other_load: bool = False,
) -> NoiseTest:
    """Test the residuals of a fitted model.

    Parameters
    ----------
    residual : array (K, 3)
        Model minus measurement, m, in the order of measurement; rows with NaN are ignored.
    run : array of int (K,)
        Number of the run; rows of different runs are no neighbours.
    cell : array of int (K,)
        Rows with the same number are repeats, with the same prediction of the model.
    parameters : int
        Number of fitted parameters.
    sigma : array (K,), optional
        Stated standard deviation of a coordinate, m.
    line : array of int (K,), optional
        Lines of the rows in messages; by default numbers from 1.
    other_load : bool
        Whether a calibration with a further constant load explained clearly more.

    Returns
    -------
    NoiseTest

    Notes
    -----
    The size is tested against the stated sigma by chi-square, and against repeats by the F test for
    lack of fit (Draper and Smith, Applied Regression Analysis, 1998, 2.1). The autocorrelation of
    neighbours, pooled over axes, is tested against its normal limit under independence; a fit
    lowers it a little, which is conservative. A mistyped row would widen the scatter of its repeats
    and hide a lack of fit; an outlier whose repeats are none is therefore listed and left out.
    """
    good = np.isfinite(residual).all(axis=1)
    lines = np.arange(1, len(residual) + 1) if line is None else line
    wrong = np.zeros(len(residual), dtype=bool)
    wrong[good] = _wrong(residual[good], cell[good])
    good &= ~wrong
    e, runs, cells = residual[good], run[good], cell[good]
    count = len(e)
    dof = 3 * count - parameters
    rms = math.sqrt(float(np.sum(e**2)) / dof) if dof > 0 else math.nan

    tests: dict[str, float] = {}
    limit = math.nan
    if sigma is not None and dof > 0:
        spread = sigma[good]
        limit = float(np.sqrt(np.mean(spread**2)))
        square = float(np.sum((e / spread[:, None]) ** 2))
        tests |= {"sigma": limit, "chi_square": square, "variance_p": chi_square_p(square, dof)}

    _, place, size = np.unique(cells, return_inverse=True, return_counts=True)
    own = 3 * (count - len(size))
    common = 3 * len(size) - parameters
    means = np.stack([np.bincount(place, axis) / size for axis in e.T], axis=1)
    if own >= _FEW:
        within = float(np.sum((e - means[place]) ** 2)) / own
        tests["scatter"] = limit = math.sqrt(within)
        if common > 0 and within > 0.0:
            ratio = float(size @ np.sum(means**2, axis=1)) / common / within
            p = variance_ratio_p(ratio, common, own)
            tests |= {"lack_of_fit_ratio": ratio, "lack_of_fit_p": p}

    correlation, autocorrelation_p = autocorrelation(e, runs[1:] == runs[:-1])
    # without a limit there are no outliers
    far = (np.abs(e) > _FAR * limit).any(axis=1) & (limit > 0.0)
    return NoiseTest(
        rms,
        dof,
        **tests,
        autocorrelation=correlation,
        autocorrelation_p=autocorrelation_p,
        outliers=int(far.sum()),
        outlier_lines=tuple(lines[good][far].tolist()),
        wrong_lines=tuple(lines[wrong].tolist()),
        wrong_by=float(np.abs(residual[wrong]).max(initial=0.0)),
        other_load=other_load,
    )
