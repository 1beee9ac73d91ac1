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

from bowstring.aliases import Floats


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
        self.weights = weights * h / 2
        module = np.repeat(np.arange(self.disks), len(nodes))
        basis = [Legendre.basis(i) for i in range(terms)]
        integral = [b.integ(lbnd=-1) for b in basis]
        # angle at the quadrature points and at the disks, linear in the unknowns
        self.angle = np.zeros((len(module), self.size))
        self.at_disk = np.zeros((self.disks + 1, self.size))
        self.stiffness = np.zeros(self.size)
        for k in range(self.disks):
            for i in range(terms):
                column = k * terms + i
                self.angle[module == k, column] = integral[i](nodes) * h / 2
                end = integral[i](1.0) * h / 2
                self.angle[module > k, column] = end
                self.at_disk[k + 1 :, column] = end
                self.stiffness[column] = self.bending * h / (2 * i + 1)

    def position(self, q: Floats) -> tuple[Floats, Floats]:
        """Positions of the disks (n + 1, 2), and their derivatives."""
        place, first = np.zeros((self.disks + 1, 2)), np.zeros((self.disks + 1, 2, self.size))
        phi = (self.angle @ q).reshape(self.disks, 1, -1)
        s, c = self.weights * np.sin(phi), self.weights * np.cos(phi)
        b = self.angle.reshape(self.disks, -1, self.size)
        np.cumsum(np.concatenate([s, c], axis=1).sum(axis=2), axis=0, out=place[1:])
        np.cumsum(np.concatenate([c @ b, -s @ b], axis=1), axis=0, out=first[1:])
        return place, first

    def derivatives(self, q: Floats, factor: float) -> tuple[Floats, Floats, Floats]:
        """Gradient and Hessian of the energy, and derivative of the gradient by the factor."""
        place, first = self.position(q)
        hessian, by_factor = np.zeros((self.size, self.size)), np.zeros(self.size)
        loads = np.zeros_like(place)  # derivatives of the potential by the positions of the disks
        loads[-1] = -self.force
        phi = self.at_disk @ q
        along = np.stack([np.cos(phi), -np.sin(phi)], axis=1)
        across = np.stack([np.sin(phi), np.cos(phi)], axis=1)
        turn = across[:, :, None] * self.at_disk[:, None, :]
        for arm, tension in zip(self.arms, self.tensions, strict=True):
            span = np.diff(place + arm * along, axis=0)
            size = np.hypot(*span.T)[:, None]
            unit = span / size
            left = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
            normal = (left[:, None] @ np.diff(first - arm * turn, axis=0))[:, 0]
            hessian += tension * (normal / size).T @ normal
            at_holes = -tension * np.diff(unit, axis=0, prepend=0.0, append=0.0)
            loads += at_holes
            by_factor -= arm * (at_holes * across).sum(axis=1) @ self.at_disk
            hessian -= arm * (self.at_disk.T * (at_holes * along).sum(axis=1)) @ self.at_disk
        by_factor += np.tensordot(loads, first, 2)
        beyond = np.cumsum(loads[:0:-1], axis=0)[::-1, :, None]  # of all disks beyond a module
        phi = (self.angle @ q).reshape(self.disks, -1)
        turned = self.weights * (np.sin(phi) * beyond[:, 0] + np.cos(phi) * beyond[:, 1])
        hessian -= (self.angle.T * turned.ravel()) @ self.angle
        hessian = np.diag(self.stiffness) + factor * hessian
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
        tangent = np.append(np.zeros(self.size), side)

        def newton(point: Floats, apart: float) -> tuple[Floats, Floats]:
            """Change that leaves a point `apart` along the tangent, and the tangent there."""
            gradient, hessian, by_factor = self.derivatives(point[:-1] / scale, point[-1])
            rows = np.vstack([np.column_stack([hessian / scale, by_factor]), tangent])
            right = np.zeros((self.size + 1, 2))
            right[:-1, 0], right[-1] = -gradient, (apart, 1.0)
            change, along = np.linalg.solve(rows, right).T
            return change, along / np.linalg.norm(along)

        tangent = newton(at, 0.0)[1]
        points, step = [at], 0.02
        while len(points) < 4000:
            guess = at + step * tangent
            for _ in range(12):
                change, along = newton(guess, step - tangent @ (guess - at))
                guess = guess + change
                if np.abs(change).max() < 1e-7:  # the error left is about its square
                    break
            else:
                step /= 2
                assert step > 1e-7
                continue
            at, tangent = guess, along
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
