"""Branches of equilibria of a planar rod, independent of Bowstring's core.

The curvature of each module is a Legendre series, so that the angle is linear in the unknowns; the
energy and its first two derivatives are exact but for Gauss quadrature. Dense Newton's method and
pseudo-arclength continuation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Legendre
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass
class PlanarRod:
    """Inextensible rod with disks and straight tendons at the distances `arms` from its axis."""

    length: float
    bending: float
    disks: int
    arms: Floats
    tensions: Floats
    force: Floats
    terms: int = 8

    def __post_init__(self) -> None:
        h, terms = self.length / self.disks, self.terms
        nodes, weights = leggauss(14)
        self.size = self.disks * terms
        self.weights = np.tile(weights * h / 2, self.disks)
        self.module = np.repeat(np.arange(self.disks), len(nodes))
        basis = [Legendre.basis(i) for i in range(terms)]
        integral = [b.integ(lbnd=-1) for b in basis]
        # angle at the quadrature points and at the disks, linear in the unknowns
        self.angle = np.zeros((len(self.module), self.size))
        self.at_disk = np.zeros((self.disks + 1, self.size))
        self.stiffness = np.zeros(self.size)
        for k in range(self.disks):
            for i in range(terms):
                column = k * terms + i
                self.angle[self.module == k, column] = integral[i](nodes) * h / 2
                end = integral[i](1.0) * h / 2
                self.angle[self.module > k, column] = end
                self.at_disk[k + 1 :, column] = end
                self.stiffness[column] = self.bending * h / (2 * i + 1)

    def position(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions of the disks (n + 1, 2), and their first and second derivatives."""
        phi = self.angle @ q
        n, size = self.disks + 1, self.size
        place, first = np.zeros((n, 2)), np.zeros((n, 2, size))
        second = np.zeros((n, 2, size, size))
        for k in range(self.disks):
            here = self.module == k
            w, b = self.weights[here], self.angle[here]
            s, c = w * np.sin(phi[here]), w * np.cos(phi[here])
            place[k + 1] = place[k] + [s.sum(), c.sum()]
            first[k + 1] = first[k] + np.stack([c @ b, -s @ b])
            second[k + 1] = second[k] + np.stack([-(b.T * s) @ b, -(b.T * c) @ b])
        return place, first, second

    def derivatives(self, q: Floats, factor: float) -> tuple[Floats, Floats, Floats]:
        """Gradient and Hessian of the energy, and derivative of the gradient by the factor."""
        place, first, second = self.position(q)
        hessian = np.diag(self.stiffness)
        by_factor = np.zeros(self.size)
        for axis in range(2):
            by_factor -= self.force[axis] * first[-1, axis]
            hessian -= factor * self.force[axis] * second[-1, axis]
        phi = self.at_disk @ q
        for arm, tension in zip(self.arms, self.tensions, strict=True):
            along = np.stack([np.cos(phi), -np.sin(phi)], axis=1)
            across = np.stack([np.sin(phi), np.cos(phi)], axis=1)
            hole = place + arm * along
            d_hole = first - arm * across[:, :, None] * self.at_disk[:, None, :]
            turned = self.at_disk[:, None, :, None] * self.at_disk[:, None, None, :]
            dd_hole = second - arm * along[:, :, None, None] * turned
            for k in range(self.disks):
                span, d = hole[k + 1] - hole[k], d_hole[k + 1] - d_hole[k]
                dd = dd_hole[k + 1] - dd_hole[k]
                size = np.hypot(*span)
                unit = span / size
                normal = np.array([-unit[1], unit[0]]) @ d
                by_factor += tension * unit @ d
                curved = np.einsum("a,aij->ij", unit, dd) + np.outer(normal, normal) / size
                hessian += factor * tension * curved
        return self.stiffness * q + factor * by_factor, hessian, by_factor

    def equilibrium(self, q: Floats, factor: float) -> Floats | None:
        """Newton's method at a load factor."""
        for _ in range(60):
            gradient, hessian, _ = self.derivatives(q, factor)
            if np.abs(gradient).max() < 1e-10 * self.bending / self.length**2:
                return q
            step = -np.linalg.solve(hessian, gradient)
            q = q + step * min(1.0, 0.4 / np.abs(self.angle @ step).max())
        return None

    def branch(self, q: Floats, factor: float, side: float) -> tuple[Floats, Floats]:
        """Points and factors from an equilibrium until the factor leaves [0, 1]."""
        scale = self.length * np.sqrt(self.size)
        at = np.append(q * scale, factor)
        tangent = np.zeros_like(at)
        tangent[-1] = side
        points, step = [at], 0.02
        while len(points) < 4000:
            gradient, hessian, by_factor = self.derivatives(at[:-1] / scale, at[-1])
            rows = np.vstack([np.column_stack([hessian / scale, by_factor]), tangent])
            new = np.linalg.solve(rows, np.append(np.zeros(self.size), 1.0))
            tangent = new / np.linalg.norm(new)
            guess = at + step * tangent
            for _ in range(12):
                gradient, hessian, by_factor = self.derivatives(guess[:-1] / scale, guess[-1])
                rows = np.vstack([np.column_stack([hessian / scale, by_factor]), tangent])
                rest = np.append(gradient, tangent @ (guess - at) - step)
                change = np.linalg.solve(rows, rest)
                guess = guess - change
                if np.abs(change).max() < 1e-10:
                    break
            else:
                step /= 2
                assert step > 1e-7
                continue
            at = guess
            points.append(at)
            step = min(1.5 * step, 0.05)
            if not 0.0 <= at[-1] <= 1.0:
                break
        found = np.array(points)
        return found[:, :-1] / scale, found[:, -1]

    def tip(self, q: Floats) -> Floats:
        return self.position(q)[0][-1]

    def equilibria(self, starts: int, seed: int) -> list[Floats]:
        """Equilibria at load factor 1 by Newton's method from random starts."""
        draw = np.random.default_rng(seed)
        found: list[Floats] = []
        decay = np.tile(0.3 ** np.arange(self.terms), self.disks)
        for _ in range(starts):
            bend = draw.normal(size=self.size) * decay * draw.uniform(0.2, 4.0) / self.length
            q = self.equilibrium(bend, 1.0)
            if q is not None and all(
                np.linalg.norm(self.tip(q) - self.tip(p)) > 1e-5 * self.length for p in found
            ):
                found.append(q)
        return found


def limit_points(factors: Floats) -> list[float]:
    """Extrema of the factor inside a branch, by a parabola through three points."""
    out = []
    for a, b, c in zip(factors, factors[1:], factors[2:], strict=False):
        if (b - a) * (c - b) < 0:
            out.append(b - (a - c) ** 2 / (8 * (a - 2 * b + c)))
    return out
