"""Comparison of constant curvature with the rod with and without physical effects.

Constant curvature always uses the nominal robot of the file. Its input is, by the name of the
comparison, the tendon lengths of the rod or the force. The rod may have other effects than the
nominal robot (`bowstring.validity.effects`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np

from bowstring.aliases import Floats
from bowstring.constant_curvature import RobotArcs
from bowstring.data.tip_errors import Comparison, known_max, known_mean
from bowstring.display import short_repr
from bowstring.errors import BowstringError
from bowstring.robot.designs import Designs
from bowstring.robot.model import Robot, without_laws
from bowstring.statics import rod
from bowstring.statics.load import Load
from bowstring.statics.model import RodModel
from bowstring.statics.solution import Sweep
from bowstring.validity.effects import Rods, acting, without
from bowstring.validity.loading import linear_bend

if TYPE_CHECKING:
    from bowstring.study import budget_rows as schema

Theory = Literal["cosserat", "kirchhoff"]

COMPARISONS: Final = {
    "cc_from_lengths": "from lengths (Eq. 5)",
    "cc_from_force": "from force (linear law)",
    "cc_from_lengths_chord": "from lengths, chords",
    "cc_from_force_arm": "from force, mean arm",
}
"""Names of the comparisons and their labels."""


FITS: Final = {
    "constant_curvature_fit": "constant curvature, fitted",
    "linear_curvature_fit": "linear curvature, fitted",
    "quadratic_curvature_fit": "quadratic curvature, fitted",
}
"""Comparisons of curvature fitted to the shape by statics, by degree, and their labels."""

PREDICTIONS: Final = {
    "constant_curvature_from_loads": "constant curvature, from loads",
    "linear_curvature_from_loads": "linear curvature, from loads",
    "quadratic_curvature_from_loads": "quadratic curvature, from loads",
}
"""Comparisons of curvature predicted from tensions and weight, by degree, and their labels."""

LABELS: Final = {**COMPARISONS, **FITS, **PREDICTIONS}
"""Labels of all comparisons with simulations."""


def short(label: str) -> str:
    """Shorten a label for narrow tables and figures."""
    label = re.sub(r" \(.*\)|, not a continuous tendon", "", label)
    return label.replace(", as the robot file has it", " as in the file")


FROM_FORCE: Final = ("cc_from_force", "cc_from_force_arm")
"""Comparisons from tensions; the others are from tendon lengths."""

MEANINGS: Final = ("cc_from_lengths", "cc_from_force")
"""Comparisons of budget and verdict: constant curvature without correction."""

CORRECTED: Final = {
    "cc_from_lengths": "cc_from_lengths_chord",
    "cc_from_force": "cc_from_force_arm",
}
"""Comparison with the correction in closed form, by that without."""


# -- what is computed --------------------------------------------------------------------------


@short_repr
@dataclass(frozen=True)
class Case:
    """Rod under one set of assumptions, and the errors of constant curvature against it."""

    rods: Rods
    """The rod: robot, theory and loads."""
    problem: str | None
    """Reason for missing numbers at some or all loads."""
    tip_position: Floats
    """(n, 3), m."""
    comparisons: dict[str, Comparison]
    """Comparisons by name: `MEANINGS`, or from the commanded lengths in displacement control."""

    def error(self, meaning: str) -> Floats:
        """Euclidean tip error (n,) of constant curvature, m."""
        return self.comparisons[meaning].error

    def to_dict(self, base: Case | None = None) -> Any:  # its keys depend on the comparisons
        """Return plain values in mm and percent; with `base`, also the change at common points."""
        out: dict[str, Any] = {"problem": self.problem}
        for name, comparison in self.comparisons.items():
            entry = comparison.to_dict()
            out[name] = {k: entry[k] for k in ("n", "mean_mm", "max_mm", "mean_percent")}
            if base is not None:
                change = self.error(name) - base.error(name)
                out[name]["change_n"] = int(np.isfinite(change).sum())
                out[name]["change_of_mean_mm"] = known_mean(change) * 1e3
                out[name]["change_of_mean_percent"] = known_mean(change) / comparison.length * 100.0
        return out if base is None else out | self.moved_from(base)

    def described(self, assumptions: str) -> Any:
        """Return plain values in mm and percent, after the assumptions in words."""
        return {"description": assumptions, **self.to_dict()}

    def moved_from(self, base: Case) -> schema.TipMoved:
        """Distance of the tip from that of another case, in mm, at common loads."""
        moved = np.linalg.norm(self.tip_position - base.tip_position, axis=-1)
        return {
            "tip_moved_mean_mm": known_mean(moved) * 1e3,
            "tip_moved_max_mm": known_max(moved) * 1e3,
        }


# -- computing it ------------------------------------------------------------------------------


def arcs_of(robot: Robot, name: str, commands: Floats) -> RobotArcs:
    """Arcs of a comparison from tensions or tendon lengths (..., T)."""
    if name in FROM_FORCE:
        law: Literal["linear", "arm"] = "linear" if name == "cc_from_force" else "arm"
        return RobotArcs.from_tensions(robot, commands, law)
    return RobotArcs.from_lengths(robot, commands, None if name == "cc_from_lengths" else "chord")


def poses_by_arcs(robot: Robot, name: str, commands: Floats) -> tuple[Floats, Floats, str]:
    """Position (n, 3), m, and rotation (n, 3, 3) of the tip by constant curvature.

    Rows without an arc are NaN; also returns the reason of the last such row.
    """

    def poses(arcs: RobotArcs) -> Floats:
        return np.concatenate([arcs.tip.position[..., None], arcs.tip.rotation], axis=-1)

    found, reason = _by_arcs(robot, name, commands, poses, (3, 4))
    return found[..., 0], found[..., 1:], reason


def disks_by_arcs(robot: Robot, name: str, commands: Floats) -> Floats:
    """Disk centres (n, N, 3) by constant curvature, m; NaN in rows without an arc."""
    shape = (len(robot.disks.station_m), 3)
    return _by_arcs(robot, name, commands, lambda arcs: arcs.disk_positions, shape)[0]


def _by_arcs(
    robot: Robot,
    name: str,
    commands: Floats,
    of: Callable[[RobotArcs], Floats],
    shape: tuple[int, ...],
) -> tuple[Floats, str]:
    """Values of arcs (n, *shape), NaN in rows without, and the reason of the last such row."""
    out, reason = np.full((len(commands), *shape), math.nan), ""
    good = np.flatnonzero(np.isfinite(commands).all(axis=1))
    try:
        out[good] = of(arcs_of(robot, name, commands[good]))
    except BowstringError:
        for i in good:
            try:
                out[i] = of(arcs_of(robot, name, commands[i]))
            except BowstringError as error:
                reason = str(error)
    return out, reason


class Model:
    """Robot, actuated tendons and theory, with common computations of a study.

    Parameters
    ----------
    robot : Robot
    tendon : int
        Index, from 0, of the tendon that has the whole tension of the sweep.
    theory : {"cosserat", "kirchhoff"}
    shares : sequence of float, optional
        Share (T,) of the sweep's tension in each tendon, from 0 to 1; by default `tendon` alone.
    """

    def __init__(
        self, robot: Robot, tendon: int, theory: Theory, shares: Sequence[float] | None = None
    ) -> None:
        self.given_robot = robot
        """Robot of the file, with its friction and other memories."""
        self.robot = without_laws(robot)
        """Robot without them, for main sweep, dynamics and verdict."""
        self.tendon = tendon
        """Index of the actuated tendon, from 0; of several, the one with the whole tension."""
        self.shares = np.zeros(len(robot.tendons.segment))
        """Share (T,) of the sweep's tension in each tendon."""
        self.shares[tendon] = 1.0
        if shares is not None:
            self.shares[:] = shares
        self.arc_scale = 1.0
        """Share of the linear law's bend at the end of geometric sweep and commanded lengths."""
        self.length = robot.length
        angle = self._angle()
        self.towards = (math.cos(angle), math.sin(angle), 0.0)
        """Direction in which the actuated tendons bend the robot."""
        self.across = (-math.sin(angle), math.cos(angle), 0.0)
        self.main = Rods(Designs(self.robot, {}), RodModel(theory), Load(gravity=robot.gravity))
        """Rod of the main sweep."""

    @cached_property
    def baseline(self) -> Rods:
        """Rod without any effect, except straight spans beside coupled strains."""
        return without(self.main, *acting(self.main))

    def tensions(self, tension: Floats) -> Floats:
        """Tensions of all tendons (n, T), N."""
        return np.asarray(np.outer(tension, self.shares))

    @cached_property
    def linear_bend(self) -> Floats:
        """Bend (S, 2) of each segment per N of the sweep by theory Eq. 1.7, rad/N."""
        return linear_bend(self.robot, self.shares)

    @property
    def linear_bend_of_all(self) -> float:
        """Sum of the segments' bends per N of the sweep by the linear law, rad/N."""
        return float(np.linalg.norm(self.linear_bend, axis=1).sum())

    def linear_displacement(self, tension: Floats) -> Floats:
        """Displacement of the actuated tendon (n,), m: theory Eq. 1.3 with the linear bend."""
        last = int(self.robot.tendons.segment[self.tendon])
        holes = self.robot.tendons.mean_hole_m[: last + 1, self.tendon]
        return np.asarray(tension * float((self.linear_bend[: last + 1] * holes).sum()))

    def _angle(self) -> float:
        """Direction of bending by the tendons, angle from x, rad."""
        pulls = np.count_nonzero(self.shares) == 1 and self.shares[self.tendon] > 0.0
        alone = pulls and self.robot.is_round
        whole = self.linear_bend.sum(axis=0)
        if alone or not whole.any():
            return float(self.robot.tendons.angle_rad[self.tendon])
        return math.atan2(whole[1], whole[0])

    @cached_property
    def budget_clamps(self) -> list[float]:
        """Clamped length that the budget assumes in each segment, m."""
        return [s.disks.clamped_length or s.disks.thickness or 3e-3 for s in self.robot.segments]

    @cached_property
    def budget_holes(self) -> list[float]:
        """Length of the holes that the budget assumes in each segment, m."""
        spacing = 0.8 * float(np.diff(self.robot.disks.station_m, prepend=0.0).min())
        disks = [s.disks for s in self.robot.segments]
        return [d.hole_length or min(d.thickness or 3e-3, spacing) for d in disks]

    def solve(self, rods: Rods, tension: Floats, disks: bool = False) -> Sweep:
        """Solve the equilibria of a rod along the sweep."""
        return rod.sweep(
            rods.designs.robot,
            self.tensions(tension),
            load=rods.load,
            model=rods.model,
            disks=disks,
        )

    def constant_curvature(self, name: str, tension: Floats, lengths: Floats) -> Floats:
        """Tips (n, 3) by constant curvature of the nominal robot, m; NaN where it has none."""
        commands = self.tensions(tension) if name in FROM_FORCE else lengths
        return poses_by_arcs(self.robot, name, commands)[0]

    def compare(
        self,
        tension: Floats,
        tip: Floats,
        lengths: Floats,
        names: Iterable[str] = COMPARISONS,
        against: str = "statics",
    ) -> dict[str, Comparison]:
        """Compare constant curvature with tips, given the tendon lengths."""
        out = {}
        for name in names:
            ours = self.constant_curvature(name, tension, lengths)
            out[name] = Comparison(name, against, self.length, ours, ours - tip)
        return out

    def case(self, rods: Rods, tension: Floats, names: Sequence[str] = MEANINGS) -> Case:
        """Compare constant curvature, by default from lengths and from force, with a rod."""
        try:
            sweep = self.solve(rods, tension)
        except BowstringError as error:
            gap = np.full((len(tension), 3), math.nan)
            lengths = np.full((len(tension), len(self.robot.tendons.segment)), math.nan)
            return Case(rods, str(error), gap, self.compare(tension, gap, lengths, names))
        bad = np.flatnonzero(~np.asarray(sweep.converged))
        problem = None
        if len(bad) == len(tension):
            problem = f"no stable equilibrium found at any load ({sweep.status[bad[0]]})"
        elif len(bad):
            problem = (
                f"no stable equilibrium found at {len(bad)} of {len(tension)} loads "
                f"({sweep.status[bad[0]]} at {tension[bad[0]]:.4g} N); means are over the others"
            )
        tip = sweep.tip_position
        comparisons = self.compare(tension, tip, sweep.tendon_lengths, names)
        return Case(rods, problem, tip, comparisons)
