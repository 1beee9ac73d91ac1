"""Errors of constant curvature in dimensionless groups, without a solver: docs/theory/validity.md.

Lengths are over the robot's length l, moments over EI/l, forces over EI/l^2. A tension is given by
its bend angle of the linear law, phi = F r l/(EI). Modules between disks are solved in closed form;
the response to gravity and tip force comes from a table (`campaign/validity_chart.py` makes it).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from bowstring.aliases import Bools, Floats, Ints
from bowstring.validity.chart_groups import Groups

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

MODELS: Final = (
    "cc_from_lengths",
    "cc_from_force",
    "cc_from_lengths_chord",
    "cc_from_force_arm",
)
"""Constant-curvature models, named as in the study."""
TABLE: Final = Path(__file__).with_name("chart_response.npz")
"""File of the response to loads."""

_LARGEST_BEND: Final = np.pi
_LARGEST_LOAD: Final = 4.0
"""Largest F s^2/(EI) of a module of length s; a module alone buckles at pi^2."""
_STEPS: Final = 160
_TINY: Final = 1e-12

# Uncertainty of the tip error, theory Eq. 9.13; `python -m campaign.validity_chart` tests it.
_UNCERTAINTY_OF_ERROR: Final = 0.003
_UNCERTAINTY_OF_LOADS: Final = 0.012
_UNCERTAINTY_OF_LOADS_WITH_FRICTION: Final = 0.12
_UNCERTAINTY_OF_BEND: Final = 0.002


@dataclass(frozen=True)
class ChartErrors:
    """Tip errors over the length along a ramp of tension."""

    linear_bend: Floats
    """Bend angle of the linear law (n,), rad: the tension."""
    bend: Floats
    """Bend angle of the robot by the tendon alone (n,), rad."""
    error: Floats
    """Tip errors (4, n) of `MODELS`."""
    uncertainty: Floats
    """Stated uncertainty (4, n) of `error`."""


@dataclass(frozen=True)
class _Chain:
    """Robot under its tendon alone at tensions (N,), with modules (n,)."""

    tension: Floats
    """Tensions (N, n) of the spans."""
    tip: Floats
    """Tip (N, 3)."""
    module_bend: Floats
    """Bend angles (N, n)."""
    lengths_bend: Floats
    """Bend vectors (N, 2) by constant curvature from the tendon lengths."""
    lengths_mean: Floats
    """Mean tendon lengths (N,)."""
    compliance: Floats
    """Bend of an inner module per bend by the linear law (N,)."""
    first_compliance: Floats
    """Bend of the first module per bend by the linear law (N,)."""


def largest_bend(groups: Groups) -> float:
    """Bend of the linear law at the end of the chart, rad."""
    return float(min(_LARGEST_BEND, _LARGEST_LOAD * groups.pitch * groups.disks**2))


def chart_errors(groups: Groups) -> ChartErrors:
    """Tip errors of constant curvature from zero tension to the end of the chart.

    Parameters
    ----------
    groups : Groups
        Groups of the robot.

    Returns
    -------
    ChartErrors
        The ramp ends early where a load exceeds the table.
    """
    phi = largest_bend(groups) * np.linspace(0.0, 1.0, _STEPS + 1) ** 2
    chain = _chain(groups, phi)
    n, bend = groups.disks, chain.module_bend.sum(axis=1)
    modules = _Modules.of(groups)
    tip, lengths_bend, lengths_mean = chain.tip, chain.lengths_bend, chain.lengths_mean
    moved = np.zeros(len(phi))
    known = np.full(len(phi), True)
    if np.any(groups.weight) or np.any(groups.tip_force):
        shift, shift_bend, known = _response_to_loads(groups, phi, chain)
        tip = tip + shift
        more = np.sum((lengths_bend + shift_bend) ** 2 - lengths_bend**2, axis=1)
        lengths_mean = lengths_mean * (1.0 - more / (24.0 * n**2))
        lengths_bend = lengths_bend + shift_bend
        moved = np.linalg.norm(shift, axis=1) + np.linalg.norm(shift_bend, axis=1)
    towards = np.tile([1.0, 0.0], (len(phi), 1))
    tips = (
        _arc_tip(lengths_bend, lengths_mean),
        _arc_tip(phi[:, None] * towards, np.ones(len(phi))),
        modules.tip_by_lengths(lengths_bend, lengths_mean),
        modules.tip(modules.under(phi), towards),
    )
    error = np.linalg.norm(np.array(tips) - tip, axis=2)
    module_load = phi / (groups.pitch * n**2)
    of_bend = bend * np.max(chain.module_bend, axis=1) ** 2 * module_load
    of_loads = (
        _UNCERTAINTY_OF_LOADS + _UNCERTAINTY_OF_LOADS_WITH_FRICTION * groups.friction * phi
    ) * moved
    uncertainty = _UNCERTAINTY_OF_ERROR * error + of_loads + _UNCERTAINTY_OF_BEND * of_bend
    stop = len(phi) if known.all() else int(np.argmin(known))
    return ChartErrors(phi[:stop], bend[:stop], error[:, :stop], uncertainty[:, :stop])


# -- the tendon alone --------------------------------------------------------------------------


def _chain(groups: Groups, phi: Floats) -> _Chain:
    n, r = groups.disks, groups.pitch
    modules = _Modules.of(groups)
    flexible, start, half = modules.flexible, modules.start, modules.end
    pulled = np.maximum(phi, _TINY) / r
    tension = np.repeat(pulled[:, None], n, axis=1)
    for _ in range(8 if groups.friction else 1):  # fixed point of Eq. 9.9
        shape = _module(tension, r, flexible, start, half)
        first, last = shape.slope_start, shape.slope_end
        if groups.friction:
            turned = np.cumsum(first, axis=1)
            turned[:, 1:] += np.cumsum(last, axis=1)[:, :-1]
            tension = pulled[:, None] * np.exp(-groups.friction * turned)
    along = shape.along * (1.0 - tension * groups.extension)
    bend = first + last
    heading = np.cumsum(bend, axis=1) - bend + first  # of the line through the holes, from z
    z = (along * np.cos(heading) + shape.across * np.sin(heading)).sum(axis=1)
    x = (along * np.sin(heading) - shape.across * np.cos(heading)).sum(axis=1)
    shown = 2.0 * np.sin(bend / 2.0).sum(axis=1)  # Eq. 9.5
    linear = tension * r / n
    compliance = (shape.linear_start + shape.linear_end) / linear
    none = np.zeros_like(x)
    return _Chain(
        tension=tension,
        tip=np.stack([x, none, z], axis=1),
        module_bend=bend,
        lengths_bend=np.stack([shown, none], axis=1),
        lengths_mean=np.hypot(along, shape.across).sum(axis=1),
        compliance=compliance[:, n // 2],
        first_compliance=compliance[:, 0],
    )


@dataclass(frozen=True)
class _Module:
    """Modules between two disks under the tension of their span; slopes are against the span."""

    linear_start: Floats
    """Slope at the start for small slopes."""
    linear_end: Floats
    slope_start: Floats
    """Slope at the start, rad."""
    slope_end: Floats
    along: Floats
    """Distance from disk to disk along the span."""
    across: Floats
    """Distance from disk to disk across the span, positive away from the tendon."""


def _module(tension: Floats, r: float, flexible: Floats, start: Floats, end: float) -> _Module:
    """Bend modules by the force along their spans: Eq. 9.3."""
    k = np.sqrt(tension)
    s, c = np.sin(k * flexible), np.cos(k * flexible)
    sine = r * (1.0 - c + end * k * s) / (s + end * k * c + start * k * (c - end * k * s))
    cosine = r + start * k * sine
    linear_start, linear_end = k * sine, k * (cosine * s - sine * c)
    slope_start, slope_end = _finite(linear_start), _finite(linear_end)
    along = start * np.cos(slope_start) + end * np.cos(slope_end)
    across = start * np.sin(slope_start) - end * np.sin(slope_end)
    for place, weight in _GAUSS:
        x = k * flexible * place
        slope = k * (sine * np.cos(x) - cosine * np.sin(x))
        slope = slope * np.where(slope > 0.0, slope_start / linear_start, slope_end / linear_end)
        along = along + weight * flexible * np.cos(slope)
        across = across + weight * flexible * np.sin(slope)
    return _Module(linear_start, linear_end, slope_start, slope_end, along, across)


_GAUSS: Final = (
    (0.5 - np.sqrt(0.15), 5.0 / 18.0),
    (0.5, 8.0 / 18.0),
    (0.5 + np.sqrt(0.15), 5.0 / 18.0),
)


def _finite(linear: Floats) -> Floats:
    """Solve slope = linear * cos(slope), Eq. 9.4, by Newton's method."""
    slope = np.arctan(linear)
    for _ in range(3):
        slope = slope - (slope - linear * np.cos(slope)) / (1.0 + linear * np.sin(slope))
    return np.asarray(slope)


# -- constant curvature ------------------------------------------------------------------------


def _arc_tip(bend: Floats, length: Floats) -> Floats:
    """Tip (N, 3) of arcs with bend vectors (N, 2): theory Eq. 1.2."""
    theta = np.maximum(np.linalg.norm(bend, axis=1), 1e-9)
    x, y = bend.T * (2.0 * (np.sin(theta / 2.0) / theta) ** 2)
    return np.asarray(length[:, None] * np.stack([x, y, np.sin(theta) / theta], axis=1))


@dataclass(frozen=True)
class _Modules:
    """Modules (n,), each an arc between clamped lengths: corrected constant curvature."""

    pitch: float
    flexible: Floats
    start: Floats
    """Clamped length at the start."""
    end: float

    @classmethod
    def of(cls, groups: Groups) -> _Modules:
        n = groups.disks
        half = groups.clamped / (2.0 * n)
        start = np.full(n, half)
        start[0] = 0.0  # the base clamps nothing
        return cls(groups.pitch, 1.0 / n - start - half, start, half)

    @property
    def _skew(self) -> Floats:
        length = self.flexible + self.start + self.end
        return np.asarray((self.end - self.start) ** 2 / (2.0 * length))

    @property
    def _softening(self) -> Floats:
        """f h of theory Eq. 1.10."""
        bow = self.flexible / 12.0 + (self.start + self.end) / 4.0 - self._skew / 2.0
        return np.asarray(self.flexible * bow)

    def under(self, phi: Floats) -> Floats:
        """Bends (N, n) by the law with the mean lever arm: theory Eq. 1.10."""
        linear = phi[:, None] * self.flexible
        stiffness = 1.0 - phi[:, None] / self.pitch * self._softening
        return np.asarray(2.0 * linear / (stiffness + np.sqrt(stiffness**2 + linear**2 / 2.0)))

    def tip_by_lengths(self, bend: Floats, mean: Floats) -> Floats:
        """Tips (N, 3) from bend vectors (N, 2) and mean of the tendon lengths: theory Eq. 1.5."""
        chord = np.linalg.norm(bend, axis=1)
        stiffer = (self._softening.max() - self._softening) / self.pitch
        curvature = chord / self.flexible.sum()
        for _ in range(8):
            share = 1.0 / (1.0 + curvature[:, None] * stiffer)
            bends = curvature[:, None] * self.flexible * share
            away = chord - 2.0 * np.sin(bends / 2.0).sum(axis=1)
            slope = (np.cos(bends / 2.0) * self.flexible * share**2).sum(axis=1)
            curvature = curvature + away / slope
        sine, cosine = np.sin(bends / 2.0), np.cos(bends / 2.0)
        rigid = ((self.start + self.end) * cosine + self._skew * sine**2).sum(axis=1)
        stretch = (mean - rigid) / (self.flexible * np.sinc(bends / (2.0 * np.pi))).sum(axis=1)
        return self.tip(bends, bend / np.maximum(chord, _TINY)[:, None], stretch)

    def tip(self, bends: Floats, towards: Floats, stretch: Floats | float = 1.0) -> Floats:
        """Tips (N, 3) of modules with bends (N, n) in directions (N, 2)."""
        before = np.cumsum(bends, axis=1) - bends
        stretch = np.reshape(stretch, (-1, 1))
        chord = stretch * self.flexible * np.sinc(bends / (2.0 * np.pi))
        x, z = (
            (
                self.start * of(before)
                + chord * of(before + bends / 2)
                + self.end * of(before + bends)
            ).sum(axis=1)
            for of in (np.sin, np.cos)
        )
        return np.concatenate([x[:, None] * towards, z[:, None]], axis=1)


# -- gravity and tip force ---------------------------------------------------------------------


@dataclass(frozen=True)
class Response:
    """Response of an arc to loads: polynomials in the six load numbers, tabulated over bend."""

    spline: CubicSpline
    """Coefficients (stiffness ratio, monomial, output) over the bend angle."""
    bends: Floats
    """Nodes of the bend angle, rad."""
    torsion: Floats
    """The two torsional stiffnesses over the bending stiffness."""
    exponents: Ints
    """Exponents (monomials, 6)."""
    largest: Floats
    """Largest weight number and tip force number."""

    @classmethod
    @lru_cache(maxsize=1)
    def load(cls) -> Response:
        """Read the table."""
        from scipy.interpolate import CubicSpline

        with np.load(TABLE) as file:
            data: dict[str, Any] = dict(file)
        coefficients = data["coefficients"].astype(float)
        return cls(
            CubicSpline(data["bends"], coefficients, axis=0),
            data["bends"],
            data["torsion"],
            data["exponents"],
            data["largest"],
        )

    def __call__(self, bend: Floats, torsion: Floats, loads: Floats) -> Floats:
        """Changes (N, 5) of the tip and of the bend vector from lengths, by loads (N, 6)."""
        terms = monomials(loads, self.exponents)
        soft, stiff = np.einsum("nm,ngmk->gnk", terms, self.spline(bend))
        low, high = 1.0 / self.torsion
        share = (1.0 / torsion - low) / (high - low)
        return np.asarray(soft + share[:, None] * (stiff - soft))


def monomials(loads: Floats, exponents: Ints) -> Floats:
    """Products (N, M) of powers of loads (N, 6)."""
    out = np.ones((len(loads), len(exponents)))
    for j, powers in enumerate(exponents.T):
        out *= (loads[:, j, None] ** np.arange(powers.max() + 1))[:, powers]
    return out


def _response_to_loads(groups: Groups, phi: Floats, chain: _Chain) -> tuple[Floats, Floats, Bools]:
    """Changes of the tip (N, 3) and of the bend vector (N, 2), and where the table covers them."""
    table, n = Response.load(), groups.disks
    weight = np.array(groups.weight)
    force = np.array(groups.tip_force) + weight * (groups.disk_share / (2.0 * n))
    bend, soft = chain.module_bend.sum(axis=1), chain.compliance
    loads = soft[:, None] * np.concatenate([weight, force])
    # the tendon resists torsion by F r^2, Eq. 9.10
    by_tendon = chain.tension.mean(axis=1) * groups.pitch**2
    torsion = soft * (groups.torsion / (1.0 - groups.clamped) + by_tendon)
    known = (
        (np.linalg.norm(loads[:, :3], axis=1) <= table.largest[0])
        & (np.linalg.norm(loads[:, 3:], axis=1) <= table.largest[1])
        & (bend <= table.bends[-1])
    )
    known = np.logical_and.accumulate(known)
    moved = table(np.minimum(bend, table.bends[-1]), torsion, loads * known[:, None])
    shift, shift_bend = moved[:, :3], moved[:, 3:]
    # the base clamps nothing: a hinge there, Eq. 9.11
    theta = np.maximum(bend, 1e-4)
    sine, cosine, none = np.sin(theta), np.cos(theta), np.zeros_like(theta)
    centre = np.stack([theta - sine, none, 1.0 - cosine], axis=1) / theta[:, None] ** 2
    moment = np.cross(chain.tip + shift / 2.0, force) + np.cross(centre, weight)
    turn = moment * ((chain.first_compliance - soft) / n)[:, None]
    turn[:, 2] = 0.0
    # a larger bend lowers the tension by friction, and that the bend, Eq. 9.12
    lost = 0.5 * groups.friction * phi * shift_bend[:, 0]
    by_bend = np.stack([sine / theta - centre[:, 2], none, (cosine - sine / theta) / theta], axis=1)
    shift = shift + np.cross(turn, chain.tip) - lost[:, None] * by_bend
    shift_bend = shift_bend + np.stack([turn[:, 1] - lost, -turn[:, 0]], axis=1)
    return shift, shift_bend, known
