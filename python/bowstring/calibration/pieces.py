"""Piecewise linear model of the measured points near given parameters, with slack tendons.

With T the tensions of the actuated tendons, s their slack lengths and d a change of the parameters,
a row of measurements is

    s = s0 + G d + M (T - T0),    s >= 0,    T >= 0,    s T = 0
    point = point0 + A d + B (T - T0)

a linear complementarity problem (LCP) per row (theory Eq. 4.1 and 4.2). Unlike the
derivatives of one active set, it contains the changes where tendons become taut or slack. K is the
number of rows, C that of measured coordinates in a row, T that of tendons, P that of parameters;
all values are in SI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property, lru_cache
from typing import Any, Final, Literal

import numpy as np

from bowstring.aliases import Bools, Floats, Ints

Loss = Literal["linear", "soft_l1", "huber"]

#: Rounds of block pivoting, in which all violated complementarities change; then single pivots.
_BLOCKS: Final = 10
_ROUNDS: Final = 60
#: Relative size of tensions and slack lengths that counts as zero.
_TINY: Final = 1e-10
#: Range of the search for other minima, in natural steps of the parameters.
_FAR: Final = 30.0
#: Effort of the search, rows x tendons x parameters x starts, which limits the number of starts.
_STARTS: Final = 12
_FEWEST_STARTS: Final = 3
_SIZE: Final = 300_000
#: Distance of a start over that of the change of the active set behind which it lies.
_BEYOND: Final = 1.5
_SEED: Final = 1
#: Steps of the search for the end of an interval, and its relative tolerance.
_REACHES: Final = 14
_NEAR: Final = 0.05
#: Eigenvalue over the largest below which a direction of the parameters has no effect.
_LOST: Final = 1e-10


def rho(z: Floats, loss: Loss, count: int) -> Floats:
    """Loss and its first two derivatives (3, m) by z (m,); quadratic beyond the first `count`.

    This is rho of theory Eq. 7.1. Residuals of priors stand behind those of the data.
    """
    out = np.stack([z, np.ones_like(z), np.zeros_like(z)])
    data = z[:count]
    if loss == "soft_l1":
        t = 1.0 + data
        out[:, :count] = 2.0 * (np.sqrt(t) - 1.0), t**-0.5, -0.5 * t**-1.5
    elif loss == "huber":
        t = np.maximum(data, 1.0)
        beyond = 2.0 * np.sqrt(t) - 1.0, t**-0.5, -0.5 * t**-1.5
        out[:, :count] = np.where(data > 1.0, beyond, out[:, :count])
    return out


def influence(residuals: Floats, loss: Loss, turn: float) -> tuple[Floats, Floats]:
    """First and second derivative of half the loss by residuals, which turns linear at `turn`."""
    if not np.isfinite(turn):
        return residuals, np.ones_like(residuals)
    z = (residuals / turn) ** 2
    _, first, second = rho(z, loss, len(z))
    return residuals * first, first + 2.0 * z * second


@dataclass(frozen=True)
class Pieces:
    """Piecewise linear model of the measured points.

    Attributes
    ----------
    point_by_parameter : ndarray (K, C, P)
        Derivatives at constant tensions of actuated tendons.
    point_by_tension : ndarray (K, C, T)
    slack, tensions : ndarray (K, T)
        Slack lengths (m) and tensions (N) at no change.
    slack_by_parameter : ndarray (K, T, P)
        Derivatives at constant tensions.
    slack_by_tension : ndarray (K, T, T)
    by_displacement : ndarray of bool (K, T)
        Whether a tendon is displacement-controlled; only these may become slack.
    """

    point_by_parameter: Floats
    point_by_tension: Floats
    slack: Floats
    tensions: Floats
    slack_by_parameter: Floats
    slack_by_tension: Floats
    by_displacement: Bools

    def rows(self, which: Bools) -> Pieces:
        """Return the model of some rows."""
        return Pieces(**{each.name: getattr(self, each.name)[which] for each in fields(self)})

    def scaled(self, step: Floats) -> Pieces:
        """Return the model in parameters scaled by their steps (P,)."""
        return replace(
            self,
            point_by_parameter=self.point_by_parameter * step,
            slack_by_parameter=self.slack_by_parameter * step,
        )

    def seen(self, which: Bools) -> Pieces:
        """Return the model with coordinates (K, C) that stay in place where not measured."""
        return replace(
            self,
            point_by_parameter=np.where(which[:, :, None], self.point_by_parameter, 0.0),
            point_by_tension=np.where(which[:, :, None], self.point_by_tension, 0.0),
        )

    def tangent(self, taut: Bools) -> Floats:
        """Derivatives (K, C, P) of the points while these tendons (K, T) are taut."""
        by = self._tensions_by_parameter(taut)
        return np.asarray(self.point_by_parameter + self.point_by_tension @ by)

    def _tensions_by_parameter(self, taut: Bools) -> Floats:
        """Derivatives (K, T, P) of the tensions while these tendons (K, T) are taut."""
        held = np.where(taut[:, :, None], self.slack_by_parameter, 0.0)
        return np.asarray(-np.linalg.solve(self._block(taut, self.slack_by_tension), held))

    def moved(self, change: Floats) -> tuple[Floats, Bools]:
        """Change (K, C) of the points for a change (P,) of parameters, and taut tendons (K, T)."""
        free = self.slack + self.slack_by_parameter @ change
        free = free - np.einsum("kij,kj->ki", self.slack_by_tension, self.tensions)
        tensions, taut = self._complementary(free)
        by = self.point_by_tension @ (tensions - self.tensions)[:, :, None]
        return np.asarray(self.point_by_parameter @ change + by[:, :, 0]), taut

    def answers(self, parameter: int) -> bool:
        """Whether the point depends on a parameter, here or with another active set."""
        change = np.zeros(self.slack_by_parameter.shape[2])
        size = np.abs(self.point_by_tension).max(initial=0.0) * np.abs(self.tensions).max(initial=0)
        for step in (_FAR, -_FAR):
            change[parameter] = step
            if np.abs(self.moved(change)[0]).max(initial=0.0) > 1e-9 * (size + 1e-6):
                return True
        return False

    def crossings(self) -> tuple[Floats, Floats]:
        """Distance (K, T) to where a tendon becomes taut or slack, and gradients.

        It is the slack length of a slack tendon, or the tension of a taut one, over the norm of its
        gradient (K, T, P) by the parameters; infinite for tension-controlled tendons.
        """
        taut = self.by_displacement & (self.tensions > 0.0)
        by = self._tensions_by_parameter(taut)
        slack_by = self.slack_by_parameter + self.slack_by_tension @ by
        gradient = np.where(taut[:, :, None], by, slack_by)
        value = np.where(taut, self.tensions, self.slack)
        norm = np.linalg.norm(gradient, axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = np.where(self.by_displacement & (norm > 0.0), value / norm, np.inf)
        return distance, gradient

    @cached_property
    def _size(self) -> float:
        diagonal = np.einsum("kii->ki", self.slack_by_tension)
        return float(np.abs(diagonal).max(initial=0.0)) or 1.0

    def _block(self, taut: Bools, matrix: Floats) -> Floats:
        """Matrices (K, T, T) of the taut tendons, with unit rows for the others."""
        both = taut[:, :, None] & taut[:, None, :]
        eye = self._size * np.eye(taut.shape[1])
        return np.asarray(np.where(both, matrix, 0.0) + eye * ~taut[:, :, None])

    def _complementary(self, free: Floats) -> tuple[Floats, Bools]:
        """Tensions (K, T) by block principal pivoting (Judice and Pires, 1994), and taut tendons.

        `free` (K, T) is the slack length at zero tension of all actuated tendons.
        """
        taut = self.by_displacement & (self.tensions > 0.0)
        tensions = np.where(self.by_displacement, 0.0, self.tensions)
        matrix, by_displacement = self.slack_by_tension, self.by_displacement
        free = free + (matrix @ tensions[:, :, None])[:, :, 0]  # effect of commanded tensions
        size = np.abs(free).max(initial=0.0) + 1e-300
        force = size / self._size
        todo = np.arange(len(free))
        best = np.full(len(free), free.shape[1] + 1)
        left = np.full(len(free), _BLOCKS)
        for _ in range(_ROUNDS):
            now = taut[todo]
            found = np.linalg.solve(
                self._block(now, matrix), np.where(now, -free[todo], 0.0)[:, :, None]
            )
            found = np.where(now, found[:, :, 0], 0.0)
            slack = free[todo] + (matrix @ found[:, :, None])[:, :, 0]
            wrong = (now & (found < -_TINY * force)) | (
                by_displacement & ~now & (slack < -_TINY * size)
            )
            tensions[todo] = np.where(by_displacement, found, tensions[todo])
            count = wrong.sum(axis=1)
            some = count > 0
            if not some.any():
                break
            todo, wrong, count, now = todo[some], wrong[some], count[some], now[some]
            matrix, by_displacement = matrix[some], by_displacement[some]
            fewer = count < best[todo]
            left[todo] = np.where(fewer, _BLOCKS, left[todo] - 1)
            best[todo] = np.minimum(best[todo], count)
            one = np.zeros_like(wrong)
            last = wrong.shape[1] - 1 - wrong[:, ::-1].argmax(axis=1)
            one[np.arange(len(one)), last] = True
            taut[todo] = now ^ np.where((left[todo] > 0)[:, None], wrong, one)
        return tensions, taut


@dataclass(frozen=True)
class Minimum:
    """Minimum of the cost by the piecewise linear model.

    Attributes
    ----------
    change : ndarray (P,)
        Change of the parameters to the minimum.
    cost : float
        Cost as defined by `scipy.optimize.least_squares`.
    """

    change: Floats
    cost: float


@dataclass(frozen=True)
class Landscape:
    """Cost of a fit near a point, by the piecewise linear model.

    Attributes
    ----------
    pieces : Pieces
        Model of all used rows, in scaled parameters.
    residuals : ndarray (C K + Q,)
        Residuals at no change, those of priors behind those of the data; zero where not measured.
    weight : ndarray (C K,)
        Residual per metre of the points.
    low, high : ndarray (P,)
        Bounds of the change.
    prior : ndarray (Q, P)
        Derivatives of the residuals of priors.
    loss : mapping
        Callable ``loss`` and ``f_scale`` of `scipy.optimize.least_squares`; empty for a quadratic
        loss.
    """

    pieces: Pieces
    residuals: Floats
    weight: Floats
    low: Floats
    high: Floats
    prior: Floats
    loss: Mapping[str, Any]

    @property
    def size(self) -> int:
        """Approximate size of one Jacobian of the residuals."""
        return self.weight.size * len(self.low)

    def cost(self, change: Floats) -> float:
        """Cost as defined by `scipy.optimize.least_squares`."""
        turn = self.loss.get("f_scale", 1.0)
        z = (self._residuals(change) / turn) ** 2
        if self.loss:
            z = self.loss["loss"](z)[0]
        return float(0.5 * turn**2 * z.sum())

    @cached_property
    def minima(self) -> list[Minimum]:
        """Minima with other tendons taut or slack, lowest first; empty if no tendon changes.

        The starts are no change, changes that make the nearest tendons taut or slack, and random
        ones.
        """
        distance, gradient = self.pieces.crossings()
        near = np.argwhere(distance < _FAR)
        if not len(near):
            return []
        count = max(_FEWEST_STARTS, min(_STARTS, _SIZE // self.size))
        found = [self._descend(start) for start in _starts(distance, gradient, near, count)]
        return sorted(found, key=lambda minimum: minimum.cost)

    def reach(self, i: int, sign: float, width: float, most: float, near: list[Minimum]) -> float:
        """End of the profile likelihood interval of a parameter for a bound on the cost.

        Parameters
        ----------
        i, sign
            Index of the parameter, and direction: 1 or -1.
        width : float
            Estimate of the result.
        most : float
            Bound on the cost, minimised over all other parameters.
        near : list of Minimum
            Minima from which to start; the farthest result counts.

        Returns
        -------
        float
            Change of the parameter; its limit or infinity if the cost stays below the bound.
        """
        bound = float(self.high[i] if sign > 0 else self.low[i])
        farthest = -np.inf
        for begin in near:
            inside, others = float(begin.change[i]), begin.change
            along = self._profile(begin.change, i)
            step, outside = width, np.nan
            for _ in range(_REACHES):
                value = inside + sign * step if np.isnan(outside) else 0.5 * (inside + outside)
                value = min(value, bound) if sign > 0 else max(value, bound)
                # start from the profile of the present active set, else from the last point
                ahead = self._descend(others + (value - inside) * along, held=i, value=value)
                if ahead.cost > most:
                    ahead = self._descend(others, held=i, value=value)
                if ahead.cost <= most:
                    inside, others = value, ahead.change
                    step *= 2.0
                    if value == bound:
                        break
                else:
                    outside = value
                if abs(outside - inside) < _NEAR * abs(inside - begin.change[i]):
                    break
            end = inside
            if np.isnan(outside):
                end = bound if inside == bound else sign * np.inf
            farthest = max(farthest, sign * end)
        return float(sign * farthest)

    def _profile(self, change: Floats, i: int) -> Floats:
        """Derivatives (P,) of the cost-minimising parameters by parameter `i`; 1 for itself."""
        slope = self._slope(change)
        size = np.linalg.norm(slope, axis=0)
        scaled = slope / np.where(size > 0.0, size, 1.0)
        inverse = np.linalg.pinv(scaled.T @ scaled, rcond=_LOST, hermitian=True)
        if inverse[i, i] <= 0.0:
            return np.asarray(np.arange(len(change)) == i, dtype=float)
        column = inverse[:, i] / np.where(size > 0.0, size, 1.0)
        return np.asarray(column / column[i] if column[i] else np.arange(len(change)) == i, float)

    @cached_property
    def _moved(self) -> Callable[[bytes], tuple[Floats, Bools]]:
        """Return `Pieces.moved` by the bytes of a change, with its last result cached."""
        return lru_cache(maxsize=1)(lambda change: self.pieces.moved(np.frombuffer(change)))

    def _residuals(self, change: Floats) -> Floats:
        moved, _ = self._moved(change.tobytes())
        by = np.concatenate([self.weight * moved.ravel(), self.prior @ change])
        return np.asarray(self.residuals + by)

    def _slope(self, change: Floats) -> Floats:
        _, taut = self._moved(change.tobytes())
        tangent = self.pieces.tangent(taut).reshape(len(self.weight), -1)
        return np.concatenate([tangent * self.weight[:, None], self.prior])

    def _descend(self, start: Floats, held: int = -1, value: float = 0.0) -> Minimum:
        from scipy.optimize import least_squares

        free = np.arange(len(start)) != held

        def full(part: Floats) -> Floats:
            whole = np.full(len(start), value)
            whole[free] = part
            return whole

        if not free.any():
            return Minimum(full(start[free]), self.cost(full(start[free])))
        far = np.inf if held >= 0 else _FAR + np.abs(start)
        low, high = np.maximum(self.low, -far)[free], np.minimum(self.high, far)[free]
        low, high = np.minimum(low, -1e-12), np.maximum(high, 1e-12)
        end = least_squares(
            lambda part: self._residuals(full(part)),
            np.clip(start[free], np.nextafter(low, high), np.nextafter(high, low)),
            jac=lambda part: self._slope(full(part))[:, free],
            bounds=(low, high),
            x_scale="jac",
            max_nfev=30,
            ftol=1e-6,
            xtol=1e-6,
            **self.loss,
        )
        return Minimum(full(end.x), float(end.cost))


def _starts(distance: Floats, gradient: Floats, near: Ints, count: int) -> list[Floats]:
    parameters = gradient.shape[2]
    random = np.random.default_rng(_SEED)
    across: dict[int, Floats] = {}
    for k, t in near[np.argsort(distance[tuple(near.T)])]:
        toward = -gradient[k, t] / np.linalg.norm(gradient[k, t])
        across.setdefault(int(t), _BEYOND * distance[k, t] * toward)
    none = np.zeros(parameters)
    starts = [none, sum(across.values(), none), *across.values()]
    starts = starts[: max(2, count // 2)]
    radii = np.geomspace(1.0, _FAR, count - len(starts))
    starts += [radius * random.normal(size=parameters) / parameters**0.5 for radius in radii]
    return starts
