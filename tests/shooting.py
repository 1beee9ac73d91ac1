"""Cosserat rods solved by shooting, independent of the package's solver."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

import bowstring as bs
from bowstring.aliases import Floats


class Shooting:
    """A Cosserat rod from the base, with jumps of force and moment at disks and loaded sections.

    The forces of the straight spans act at the poses of a solution: that is an equilibrium if the
    rod passes through its disks.
    """

    def __init__(
        self,
        robot: bs.Robot,
        found: bs.Solution,
        loads: list[bs.PointLoad],
        stiffness: Floats | None = None,
    ) -> None:
        if stiffness is None:
            bending, shear = robot.bending_stiffness, robot.shear_stiffness
            stretching = [shear, shear, robot.axial_stiffness]
            rows = np.array([bending, bending, robot.torsion_stiffness, *stretching]).T
            stiffness = rows[:, :, None] * np.eye(6)
        segment = robot.disks.segment
        #: Strains by the wrench, both in axes of the section, and weights per length by module.
        by_segment = np.broadcast_to(np.linalg.inv(stiffness), (segment[-1] + 1, 6, 6))
        self.compliance = by_segment[segment]
        if found.model.theory == "kirchhoff":
            self.compliance[:, 3:] = 0.0
        self.weight = np.outer(robot.mass_per_length[segment], found.core.gravity)
        self.stations = robot.disks.station_m
        self.loads = loads
        self.on_disks = self.spans(robot, found)
        self.on_disks[:, 0] += robot.disks.mass_kg[:, None] * found.core.gravity

    @staticmethod
    def spans(robot: bs.Robot, found: bs.Solution) -> Floats:
        """Forces and moments (N, 2, 3) of the spans on all disks."""
        positions = np.concatenate([np.zeros((1, 3)), found.disk_positions])
        turns = np.concatenate([np.eye(3)[None], found.disk_rotations])
        out = np.zeros((len(positions), 2, 3))
        tendons = robot.tendons
        for t, tension in enumerate(found.tensions):
            ends = int(tendons.end_disk[t]) + 2
            own = np.broadcast_to(tendons.holes_m[t], (len(turns), 2))[:ends]
            arms = np.einsum("nij,nj->ni", turns[:ends, :, :2], own)
            along = np.diff(positions[:ends] + arms, axis=0)
            pull = tension * along / np.linalg.norm(along, axis=1)[:, None]
            forces = np.concatenate([pull, np.zeros((1, 3))])
            forces[1:] -= pull
            out[:ends, 0] += forces
            out[:ends, 1] += np.cross(arms, forces)
        return out[1:]

    def rate(self, _: float, y: Floats, module: int) -> Floats:
        turn, force, moment = y[3:12].reshape(3, 3), y[12:15], y[15:18]
        strain = self.compliance[module] @ np.concatenate([turn.T @ moment, turn.T @ force])
        along = turn @ (np.array([0.0, 0.0, 1.0]) + strain[3:])
        x, y_, z = strain[:3]
        turned = turn @ np.array([[0.0, -z, y_], [z, 0.0, -x], [-y_, x, 0.0]])
        return np.concatenate(
            [along, turned.ravel(), -self.weight[module], -np.cross(along, force)]
        )

    def shoot(self, wrench: Floats) -> tuple[Floats, Floats, Floats]:
        """Force and moment left beyond the tip; positions and rotations of the disks."""
        y = np.concatenate([np.zeros(3), np.eye(3).ravel(), wrench])
        places: list[tuple[float, Any]] = [(s, k) for k, s in enumerate(self.stations)]
        places += [(load.arc_length or 0.0, load) for load in self.loads]
        before, disks = 0.0, []
        for s, what in sorted(places, key=lambda place: place[0]):
            span, module = (before, s), (min(len(disks), len(self.stations) - 1),)
            done = solve_ivp(self.rate, span, y, "DOP853", args=module, rtol=1e-12, atol=1e-14)
            y, before = done.y[:, -1].copy(), s
            turn = y[3:12].reshape(3, 3)
            if isinstance(what, bs.PointLoad):
                axes = turn if what.follower else np.eye(3)
                force, moment = axes @ np.array(what.force), axes @ np.array(what.moment)
                moment = moment + np.cross(turn @ np.array(what.point), force)
            else:
                disks.append((y[:3].copy(), turn))
                force, moment = self.on_disks[what]
            y[12:15] -= force
            y[15:18] -= moment
        positions, turns = (np.array(each) for each in zip(*disks, strict=True))
        return y[12:18], positions, turns

    def solve(self, near: Any = (0.0,) * 6) -> tuple[Floats, Floats]:
        """Positions and rotations of the disks where nothing is left beyond the tip.

        The force and moment at the base are searched near these.
        """
        found = root(lambda wrench: self.shoot(wrench)[0], near, tol=1e-12)
        left, positions, turns = self.shoot(found.x)
        assert np.abs(left).max() < 1e-9
        return positions, turns


# -- rods with continuous tendons --------------------------------------------------------------

STRAIGHT = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def hat(w: Floats) -> Floats:
    return np.array([[0.0, -w[2], w[1]], [w[2], 0.0, -w[0]], [-w[1], w[0], 0.0]])


def strain(
    stiffness: Floats, rest: Floats, wrench: Floats, holes: tuple[Floats, Floats], tensions: Floats
) -> Floats:
    """Strains (u, v) of a section that carries a wrench (moment, force) together with its tendons.

    Stiffness (6,) of bending, twist, shear and extension; `holes` are the places (n, 3) of the
    tendons and their derivatives by arc length.
    """
    found = rest.copy()
    for _ in range(50):
        residual, tangent = stiffness * (found - rest) - wrench, np.diag(stiffness)
        for b, slope, tension in zip(*holes, tensions, strict=True):
            along = found[3:] + np.cross(found[:3], b) + slope
            length = np.linalg.norm(along)
            t = along / length
            residual = residual + tension * np.concatenate([np.cross(b, t), t])
            by = np.hstack([-hat(b), np.eye(3)])
            tangent = tangent + tension / length * by.T @ (np.eye(3) - np.outer(t, t)) @ by
        step = np.linalg.solve(tangent, residual)
        found = found - step
        if abs(step).max() < 1e-12:
            return found
    raise AssertionError("no strain balances the wrench")


def tip_of(
    stiffness: Floats,
    ends: Sequence[float],
    holes: Callable[[int, float], tuple[Floats, Floats]],
    tensions: Any,
    force: Callable[[float], Floats],
) -> Floats:
    """Tip of a straight rod, by the moment at the base for which nothing is left at the tip.

    A cut through rod and tendons carries no more than the dead force beyond it, `force(s)`. The
    segments end at `ends`; `holes(segment, s)` are those of the tendons that pass there, the last.
    """

    def rates(s: float, y: Floats, segment: int) -> Floats:
        turn, moment = y[3:12].reshape(3, 3), y[12:]
        beyond, (places, slopes) = force(s), holes(segment, s)
        wrench = np.concatenate([turn.T @ moment, turn.T @ beyond])
        passing = np.asarray(tensions)[len(tensions) - len(places) :]
        found = strain(stiffness, STRAIGHT, wrench, (places, slopes), passing)
        along = turn @ found[3:]
        return np.concatenate([along, (turn @ hat(found[:3])).ravel(), -np.cross(along, beyond)])

    def end(moment: Floats) -> Floats:
        y, start = np.concatenate([np.zeros(3), np.eye(3).ravel(), moment]), 0.0
        for segment, stop in enumerate(ends):
            span = (start, stop)
            done = solve_ivp(rates, span, y, "DOP853", args=(segment,), rtol=1e-10, atol=1e-12)
            y, start = done.y[:, -1], stop
        return y

    left = end(root(lambda moment: end(moment)[12:], np.zeros(3), tol=1e-11).x)
    assert np.abs(left[12:]).max() < 1e-8
    return left[:3]
