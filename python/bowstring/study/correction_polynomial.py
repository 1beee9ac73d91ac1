"""The tip as a polynomial of tensions or of tendon lengths, fitted to the rod.

It serves where no corrected arc keeps within the tolerance: under gravity, for bent backbones, for
tendons in one plane.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg

from bowstring.aliases import Bools, Floats, Ints
from bowstring.display import short_repr
from bowstring.robot.model import Robot
from bowstring.statics import rod
from bowstring.study.comparison import Model
from bowstring.validity.loading import whole_share

_FITTED: Final = 6000  # random loads of the fit
_HELD_OUT: Final = 2000  # further ones, for the error
MOST_TERMS: Final = 250
"""Largest number of terms of a coordinate; more are no code to paste."""
_SOURCES: Final = ("lengths", "tensions")
_HIGHEST: Final = 8  # degree
_FEWEST: Final = 0.5  # share of the loads with an equilibrium
_TRIED: Final = 500  # first loads that tell whether so many have one, as a load without takes long
_RANGES: Final = (1.0, 0.5, 0.25)  # of the largest tension, until an error is tolerated
_ENOUGH: Final = 0.1  # share of the tolerance below which a higher degree gains nothing
_ROUNDING: Final = 1e-9  # of the bounds of the inputs, as in the code written
_SLACK: Final = 0.01  # of the length, by which mean tendon lengths may differ from those of the fit
_NO_MOMENT: Final = 1e-9  # sum and moments of a combination of tensions, over the largest
_DIRECTIONS: Final = 12  # in which the bends of a segment are bounded


@short_repr
@dataclass(frozen=True)
class TipPolynomial:
    """The tip as a polynomial of ``inputs = weights @ (commands - offset)``."""

    offset: Floats
    """Commands (T,) of no input, N or m."""
    weights: Floats
    """Inputs (q, T) by commands, 1/N or 1/m; within the range they are about 1 at most."""
    sides: Floats
    """Directions (m, q) in which the inputs of the fit are bounded: the range of the polynomial."""
    limits: Floats
    """Largest ``sides @ inputs`` (m,)."""
    exponents: Ints
    """Powers (n, q) of the inputs in each term."""
    coefficients: Floats
    """Tip (n, 3) by each term, m, base frame."""
    max_error: float
    """Largest error at random loads that are not in the fit, m."""
    solved: float
    """Share of the random loads that have an equilibrium; the others are in neither."""
    top: float
    """Largest sum of the sizes of the tensions in the tendons that end at one segment, N: the
    range."""

    @property
    def degree(self) -> int:
        """Largest sum of powers in a term."""
        return int(self.exponents.sum(axis=1).max())

    def tip(self, commands: Floats) -> Floats:
        """Tips (n, 3), m, at commands (n, T), N or m; NaN outside the range."""
        inputs = (commands - self.offset) @ self.weights.T
        out = _terms(inputs, self.exponents) @ self.coefficients
        out[~(inputs @ self.sides.T <= self.limits + _ROUNDING).all(axis=1)] = math.nan
        return out


def bend_fit(holes: Floats) -> Floats:
    """Mean length and bend (3, T) per length of tendons through these holes (T, 2), theory Eq. 1.3.

    Of tendons in one plane the least bend with these lengths.
    """
    return np.linalg.pinv(np.column_stack([np.ones(len(holes)), -holes]))


def without_closed_form(robot: Robot) -> str:
    """Why the corrected arcs of a robot have no closed form; empty if they have one."""
    if robot.rest_curvature.any():
        return "its backbone is bent without load"
    if not robot.bends_alike or robot.tension_centre_m.any():
        return "its backbone does not bend alike about all axes"
    if not all(_gives_length(robot, k) for k in range(len(robot.segments))):
        return "it has a segment with too few tendons to determine its length and bend"
    return ""


def _gives_length(robot: Robot, segment: int) -> bool:
    """Whether the lengths of a segment's own tendons give the length of its arc."""
    holes = robot.tendons.mean_hole_m[segment, robot.tendons.segment == segment]
    size = np.abs(holes).max(initial=1e-300)
    scaled = np.column_stack([np.ones(len(holes)), holes / size])
    ranks = [np.linalg.matrix_rank(each, tol=1e-6) for each in (scaled, scaled[:, 1:])]
    return bool(ranks[0] > ranks[1])


def tip_polynomials(
    model: Model, top: float, tolerance: float
) -> tuple[TipPolynomial | None, TipPolynomial | None]:
    """Fit the tip of a robot's rod, with its gravity and without friction.

    Parameters
    ----------
    model : Model
    top : float
        Largest sum of the sizes of the tensions in the tendons that end at one segment, N. Tendons
        pull, chambers push, rods do both. The range of a polynomial ends there, or at a half or a
        quarter of it if only then it keeps within the tolerance.
    tolerance : float
        Tolerated tip error, m. The degree is the lowest that errs by a tenth of it; if none does of
        up to 8 and of at most 250 terms a coordinate, the one with the smallest error.

    Returns
    -------
    tuple of TipPolynomial or None
        From tendon lengths, whose inputs are the bends of the segments, and from tensions, whose
        inputs are their sums and moments; None for one that does not keep within the tolerance.
    """
    best: dict[str, TipPolynomial] = {}
    for share in _RANGES:
        if left := [each for each in _SOURCES if each not in best]:
            found = _polynomials(model, share * top, tolerance, left)
            best |= {name: fit for name, fit in found.items() if fit.max_error <= tolerance}
    return best.get("lengths"), best.get("tensions")


def _polynomials(
    model: Model, top: float, tolerance: float, sources: list[str]
) -> dict[str, TipPolynomial]:
    """Polynomials from the sources over one range, whatever their error; none without loads."""
    robot = model.robot
    of = robot.tendons.segment
    signs = _signs(model)
    tensions = _random_tensions(of, signs, top)
    for count in (_TRIED, len(tensions)):
        found = rod.solve_batch(
            robot, tensions[:count], load=model.main.load, model=model.main.model, disks=False
        )
        good = np.asarray(found.converged)
        if good.mean() < _FEWEST:
            return {}
    held_out = (np.arange(len(tensions)) >= _FITTED)[good]
    lengths, tensions = np.asarray(found.tendon_lengths)[good], tensions[good]

    straight = np.cumsum([s.length for s in robot.segments])[of]
    bends, means = _segment_fits(robot)
    for k in range(0, len(bends), 2):  # of tendons in one plane only the first axis bends
        along = (lengths - straight) @ bends[k : k + 2].T
        _, _, axes = np.linalg.svd(along - along.mean(axis=0), full_matrices=False)
        bends[k : k + 2] = axes @ bends[k : k + 2]
    inputs = (lengths - straight) @ bends.T
    scale = np.abs(inputs).max()
    # beside its bends each segment has a mean length, which only bounds the range
    by_length = np.vstack([bends / scale, means / (_SLACK * robot.length)])
    angle = np.arange(_DIRECTIONS) * math.tau / _DIRECTIONS
    around = np.kron(np.eye(len(means)), np.column_stack([np.cos(angle), np.sin(angle)]))
    both = np.vstack([np.eye(len(means)), -np.eye(len(means))])
    around = scipy.linalg.block_diag(around, both)
    bounds = ((lengths - straight) @ by_length.T @ around.T).max(axis=0)
    bounds[-len(both) :] += 1.0
    varied = np.zeros(len(by_length), bool)
    varied[: len(bends)] = np.ptp(inputs, axis=0) > 1e-9 * scale

    combined, acting = _combined_tensions(robot)
    single = [i for i, each in enumerate(signs) if len(each) == 1]
    one_sign = np.array([-signs[i][0] * np.eye(len(of))[i] for i in single])
    sums = np.array([each for k in np.unique(of) for each in _sums(signs, of == k)])
    fits = {
        "lengths": (lengths, varied, straight, by_length, around, bounds),
        "tensions": (
            tensions,
            acting,
            np.zeros(len(of)),
            combined / top,
            np.vstack([one_sign.reshape(-1, len(of)), sums]) @ combined.T,
            np.repeat([0.0, 1.0], [len(one_sign), len(sums)]),
        ),
    }
    tips = np.asarray(found.tip_position)[good]
    out = {}
    for source in sources:
        commands, varied, offset, weights, sides, limits = fits[source]
        terms, coefficients, error = _fit(
            (commands - offset) @ weights.T, varied, tips, held_out, _ENOUGH * tolerance
        )
        out[source] = TipPolynomial(
            offset, weights, sides, limits, terms, coefficients, error, float(good.mean()), top
        )
    return out


def _combined_tensions(robot: Robot) -> tuple[Floats, Bools]:
    """Orthogonal combinations (T, T) of tensions, and whether each (T,) has a sum or a moment.

    The tensions of a segment load each disk by their sum and by two moments about its centre.
    Combinations without sum and moments hardly change the shape: of n parallel tendons n - 3.
    """
    of = robot.tendons.segment
    holes = np.nan_to_num(robot.tendons.holes_m).reshape(len(of), -1)
    combined, acting = np.zeros((len(of), len(of))), np.zeros(len(of), bool)
    for k in np.unique(of):
        own = np.flatnonzero(of == k)
        arms = holes[own] / np.abs(holes[own]).max(initial=1e-300)
        _, sizes, rows = np.linalg.svd(np.column_stack([np.ones(len(own)), arms]).T)
        combined[np.ix_(own, own)] = rows
        acting[own[: np.count_nonzero(sizes > _NO_MOMENT * sizes[0])]] = True
    return combined, acting


def _signs(model: Model) -> list[tuple[float, ...]]:
    """Signs that the tension of each tendon may have: chambers push, rods push and pull."""
    robot = model.robot
    whole = np.array(whole_share(robot))
    both = robot.tendons.pushes & (np.maximum(whole, model.shares) > 0.0)
    return [(1.0, -1.0) if b else (one,) for one, b in zip(whole.tolist(), both, strict=True)]


def _sums(signs: list[tuple[float, ...]], own: Bools) -> Iterator[Floats]:
    """Sums of sizes as rows (T,) on tensions: one for each choice of the own tendons' signs."""
    chosen = [each if mine else (0.0,) for each, mine in zip(signs, own, strict=True)]
    return map(np.array, itertools.product(*chosen))


def _random_tensions(of: Ints, signs: list[tuple[float, ...]], top: float) -> Floats:
    """Tensions (n, T) whose sizes over each segment's tendons sum to at most `top`, from none."""
    rng = np.random.default_rng(1)
    count = _FITTED + _HELD_OUT
    tensions = np.zeros((count, len(of)))
    for k in np.unique(of):
        own = np.flatnonzero(of == k)
        shares = rng.dirichlet(np.full(len(own), 0.5), count)
        tensions[:, own] = top * shares * rng.uniform(size=(count, 1)) ** (1.0 / len(own))
        alone = np.arange(count) % 20 < 2  # the edges of the range, and more at their ends
        tensions[np.ix_(alone, own)] = 0.0
        along = 0.5 - 0.5 * np.cos(np.pi * rng.uniform(size=alone.sum()))
        tensions[alone, rng.choice(own, alone.sum())] = top * along
    tensions[[0, -1]] = 0.0  # of the fit, and of its test
    tensions *= np.column_stack([rng.choice(each, count) for each in signs])
    return tensions


def _segment_fits(robot: Robot) -> tuple[Floats, Floats]:
    """Bends (2 S, T) and mean lengths (S, T) of the segments per tendon length.

    They are those of arcs without correction, of the segments in which tendons end.
    """
    of = robot.tendons.segment
    rest, bends, means = np.eye(len(of)), [], []
    for k, holes in enumerate(robot.tendons.mean_hole_m):
        own, further = of == k, of > k
        if not own.any():
            continue
        mean, *bend = bend_fit(holes[own]) @ rest[own]
        rest[further] -= mean - holes[further] @ np.array(bend)
        bends += bend
        means.append(mean)
    return np.array(bends), np.array(means)


def _fit(
    inputs: Floats,
    varied: Bools,
    tips: Floats,
    held_out: Bools,
    enough: float,
) -> tuple[Ints, Floats, float]:
    """Exponents, coefficients and largest error of the lowest degree that is good enough."""
    best: tuple[Ints, Floats, float] | None = None
    for degree in range(1, _HIGHEST + 1):
        if best and math.comb(varied.sum() + degree, degree) > MOST_TERMS:
            break
        exponents = _exponents(varied, degree)
        terms = _terms(inputs, exponents)
        coefficients = scipy.linalg.lstsq(
            terms[~held_out], tips[~held_out], 1e-12, check_finite=False, lapack_driver="gelsy"
        )[0]
        off = (terms @ coefficients - tips)[held_out]
        error = float(np.linalg.norm(off, axis=1).max())
        if best is None or error < best[2]:
            best = exponents, coefficients, error
        if error <= enough:
            break
    assert best is not None
    return best


def _exponents(varied: Bools, degree: int) -> Ints:
    """Powers (n, q) of all terms of the varied inputs (q,) up to a degree."""
    count = varied.sum()
    chosen = itertools.combinations_with_replacement(range(count + 1), degree)
    out = [np.bincount(c, minlength=count + 1)[:count] for c in chosen]
    exponents = np.zeros((len(out), len(varied)), np.int64)
    exponents[:, varied] = out
    return exponents


def _terms(inputs: Floats, exponents: Ints) -> Floats:
    """Values (n, terms) of the terms at inputs (n, q)."""
    powers = inputs[:, :, None] ** np.arange(exponents.max() + 1)
    out = np.ones((len(inputs), len(exponents)))
    for q in range(inputs.shape[1]):
        out *= powers[:, q, exponents[:, q]]
    return out
