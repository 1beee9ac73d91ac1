"""The validity chart: makes its table, and compares it with the solver for random robots.

``python -m campaign.validity_chart table`` makes the table of the response to loads again (five
minutes). ``python -m campaign.validity_chart collapse 5000`` draws random robots of the chart's
class and compares the predicted validity limits with those of the solver.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import Final

import numpy as np
from numpy.typing import NDArray

import bowstring as bs
from bowstring.study.comparison import FROM_FORCE, poses_by_arcs
from bowstring.validity.chart import (
    Limit,
    force_limit,
    force_reading,
    lengths_limit,
    lengths_reading,
    validity_chart,
)
from bowstring.validity.chart_errors import MODELS, TABLE, monomials
from bowstring.validity.chart_groups import RANGES, Groups

Array = NDArray[np.float64]

_BASE: Final = bs.load_robot("amouri2019")
_GRAVITY: Final = 9.80665

# -- the table ---------------------------------------------------------------------------------

BENDS: Final = np.linspace(0.0, 4.5, 16)
TORSION: Final = (0.6, 1.4)
LARGEST: Final = (2.5, 0.9)
"""Largest weight number and tip force number."""
_DEGREE: Final = 4
_SAMPLES: Final = 1200
_FLOOR: Final = 0.02  # moves of the tip below it have equal weight in the fit
_PITCH: Final = 2e-3  # so small that the tendon resists no torsion


def _exponents() -> NDArray[np.int64]:
    found = [
        np.bincount(chosen, minlength=6)
        for degree in range(1, _DEGREE + 1)
        for chosen in combinations_with_replacement(range(6), degree)
    ]
    return np.array(found)


def _loads(rng: np.random.Generator) -> Array:
    out = rng.normal(size=(_SAMPLES, 2, 3))
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    out *= np.sqrt(rng.uniform(size=(_SAMPLES, 2, 1))) * np.array(LARGEST)[:, None]
    return out.reshape(_SAMPLES, 6)


def _responses(bend: float, torsion: float, loads: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Moves of tip and bend vector of a rod with a continuous tendon, length 1 m."""
    diameter, modulus, density = 3.6e-3, 1e9, 1000.0
    robot = _BASE.with_(
        {
            "segments.0.length": 1.0,
            "segments.0.disks.count": 6,
            "segments.0.disks.mass": 0.0,
            "segments.0.disks.thickness": 0.0,
            "segments.0.disks.radius": 3e-3,
            "segments.0.tendons.pitch_radius": _PITCH,
            "segments.0.backbone.diameter": diameter,
            "segments.0.backbone.E": modulus,
            "segments.0.backbone.G": modulus * torsion / 2.0,
            "segments.0.backbone.density": density,
        }
    )
    stiffness = float(robot.bending_stiffness[0])
    loads = np.vstack([np.zeros(6), loads])
    rows = np.zeros((len(loads), 3))
    rows[:, 0] = bend * stiffness / _PITCH
    load = bs.Load(
        rows,
        gravity=loads[:, :3] * stiffness / (density * robot.segments[0].backbone.area),
        tip_force=loads[:, 3:] * stiffness,
    )
    model = bs.RodModel("kirchhoff", "continuous", True)
    found = bs.solve_batch(robot, load=load, model=model, disks=False)
    holes = np.column_stack([np.ones(3), -robot.tendons.hole_m])  # theory Eq. 1.3
    bends = np.linalg.solve(holes, found.tendon_lengths.T)[1:].T
    out = np.hstack([found.tip_position, bends])
    return out[1:] - out[0], np.asarray(found.converged)[1:]


def make_table() -> None:
    """Fit the responses at all nodes and write the table."""
    rng, exponents = np.random.default_rng(19), _exponents()
    odd = exponents[:, [1, 4]].sum(axis=1) % 2 == 1  # in the loads across the plane of the bend
    fitted = np.zeros((len(BENDS), len(TORSION), len(exponents), 5))
    for i, bend in enumerate(BENDS):
        for j, torsion in enumerate(TORSION):
            loads = _loads(rng)
            moved, good = _responses(float(bend), torsion, loads)
            terms, moved = monomials(loads, exponents)[good], moved[good]
            weight = 1.0 / (_FLOOR + np.linalg.norm(moved[:, :3], axis=1))
            for k, across in enumerate((False, True, False, False, True)):
                those = odd == across
                fitted[i, j, those, k] = np.linalg.lstsq(
                    terms[:, those] * weight[:, None], moved[:, k] * weight, rcond=None
                )[0]
        print(f"bend {bend:.2f} rad: {good.mean():.1%} solved", flush=True)
    np.savez_compressed(
        TABLE,
        coefficients=fitted.astype(np.float32),
        bends=BENDS,
        torsion=np.array(TORSION),
        exponents=exponents,
        largest=np.array(LARGEST),
    )


# -- random robots -----------------------------------------------------------------------------

KINDS: Final = {"plain": (), "friction": ("friction",), "loads": ("loads",)}
KINDS["all"] = ("friction", "loads")


def draw(rng: np.random.Generator, kind: str) -> tuple[Groups, float]:
    """Draw a robot of the class with friction and loads by its kind, and a tolerance."""
    ratio = rng.uniform(0.05, 0.5)  # backbone diameter over pitch radius
    pitch = _log(rng, *RANGES["pitch"])
    friction = rng.uniform(*RANGES["friction"]) if "friction" in KINDS[kind] else 0.0
    loads = {}
    if "loads" in KINDS[kind]:
        loads["weight"] = _vector(rng, 0.02, RANGES["weight"][1])
        loads["tip_force"] = _vector(rng, 0.01, RANGES["tip_force"][1])
        loads["disk_share"] = rng.uniform()
    groups = Groups(
        disks=int(rng.integers(3, 21)),
        pitch=pitch,
        clamped=rng.uniform(*RANGES["clamped"]),
        friction=friction,
        extension=(ratio * pitch) ** 2 / 16.0,
        torsion=1.0 / (1.0 + rng.uniform(0.0, 0.45)),
        **loads,
    )
    return groups, _log(rng, 0.005, 0.05)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _vector(rng: np.random.Generator, low: float, high: float) -> tuple[float, float, float]:
    value = rng.normal(size=3)
    x, y, z = value * (_log(rng, low, high) / np.linalg.norm(value))
    return (float(x), float(y), float(z))


def make_robot(groups: Groups, length: float = 0.5, modulus: float = 1e7) -> bs.Robot:
    """Robot with given groups and with gravity along its weight number."""
    n, radius = groups.disks, groups.pitch * length
    diameter = 4.0 * length * math.sqrt(groups.extension)
    stiffness = modulus * math.pi * diameter**4 / 64.0
    number = float(np.linalg.norm(groups.weight))
    mass = number * stiffness / length**2 / _GRAVITY
    area = math.pi / 4.0 * diameter**2
    return _BASE.with_(
        {
            "segments.0.length": length,
            "segments.0.disks.count": n,
            "segments.0.disks.clamped_length": groups.clamped * length / n,
            "segments.0.disks.thickness": 0.0,
            "segments.0.disks.mass": mass * groups.disk_share / n,
            "segments.0.disks.radius": 1.1 * radius,
            "segments.0.tendons.pitch_radius": radius,
            "segments.0.tendons.friction": groups.friction,
            "segments.0.backbone.diameter": diameter,
            "segments.0.backbone.E": modulus,
            "segments.0.backbone.nu": 1.0 / groups.torsion - 1.0,
            "segments.0.backbone.density": mass * (1.0 - groups.disk_share) / (area * length),
            "gravity": [_GRAVITY * w / number if number else 0.0 for w in groups.weight],
        }
    )


def solved_errors(robot: bs.Robot, groups: Groups, linear_bend: Array) -> Array:
    """Tip errors (4, n) over the length by the solver, along a ramp of tension."""
    stiffness, length = float(robot.bending_stiffness[0]), robot.length
    rows = np.zeros((len(linear_bend), 3))
    rows[:, 0] = linear_bend * stiffness / (groups.pitch * length**2)
    force = np.array(groups.tip_force) * stiffness / length**2
    found = bs.sweep(robot, load=bs.Load(rows, tip_force=force), disks=False)
    out = []
    for model in MODELS:
        commands = rows if model in FROM_FORCE else found.tendon_lengths
        tips = poses_by_arcs(robot, model, commands)[0]
        out.append(np.linalg.norm(tips - found.tip_position, axis=1) / length)
    return np.array(out)


# -- comparison --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Trial:
    """Limit of one robot by the solver and by the chart."""

    kind: str
    limit: Limit
    solved: float
    """Linear bend at the limit by the solver, rad, at most the end of the chart."""

    @property
    def has_limit(self) -> bool:
        """Whether constant curvature fails within the chart but not from the first load."""
        never = self.solved == self.limit.linear_bend == 0.0
        return not never and not (self.limit.throughout and self.solved >= self._end)

    @property
    def _end(self) -> float:
        return self.limit.linear_bend * (1.0 - 1e-9)

    @property
    def error(self) -> float:
        """Relative error of the chart's limit."""
        apart = abs(self.limit.linear_bend - self.solved)
        return apart / self.solved if self.solved else math.inf

    @property
    def within(self) -> bool:
        """Whether the solver's limit lies in the stated interval."""
        return self.limit.low * (1 - 1e-3) <= self.solved <= self.limit.high * (1 + 1e-3)


def trials(count: int, seed: int, kinds: tuple[str, ...] = tuple(KINDS)) -> Iterator[list[Trial]]:
    """Compare random robots; each gives a trial for each constant-curvature model."""
    rng = np.random.default_rng(seed)
    for i in range(count):
        kind = kinds[i % len(kinds)]
        groups, tolerance = draw(rng, kind)
        chart = validity_chart(groups, tolerance)
        robot = make_robot(groups)
        end = float(chart.linear_bend[-1])
        highest = max(limit.high for limit in chart.limits)
        bends = min(end, 1.5 * highest + 0.02 * end) * np.linspace(0.0, 1.0, 61) ** 2
        errors = solved_errors(robot, groups, bends)
        found = []
        for limit, error in zip(chart.limits, errors, strict=True):
            found.append(Trial(kind, limit, first_crossing(bends, error, tolerance)))
        yield found


def first_crossing(bends: Array, error: Array, tolerance: float) -> float:
    """First crossing of the tolerance by cubic interpolation, or the last bend with an error."""
    from scipy.interpolate import CubicSpline

    known = len(bends) if np.isfinite(error).all() else int(np.argmin(np.isfinite(error)))
    above = error[:known] > tolerance
    if not above.any():
        return float(bends[known - 1])
    i = int(np.argmax(above))
    if i == 0:
        return 0.0
    near = slice(max(i - 2, 0), min(i + 2, known))
    fine = np.linspace(bends[i - 1], bends[i], 401)
    crossed = CubicSpline(bends[near], error[near])(fine) > tolerance
    return float(fine[np.argmax(crossed)])


def printed_errors(count: int, seed: int, kind: str) -> tuple[Array, Array]:
    """Relative errors of the printed chart, from force and from lengths, against the program."""
    rng = np.random.default_rng(seed)
    by_force, by_lengths = [], []
    for _ in range(count):
        groups, tolerance = draw(rng, kind)
        chart = validity_chart(groups, tolerance)
        force, lengths = chart["cc_from_force"], chart["cc_from_lengths"]
        read = force_limit(*force_reading(groups, tolerance), groups.pitch)
        by_force.append(min(read, chart.linear_bend[-1]) / force.linear_bend - 1.0)
        if not lengths.throughout:
            bend = groups.disks * lengths_limit(*lengths_reading(groups, tolerance))
            by_lengths.append(bend / lengths.bend - 1.0)
    return np.abs(by_force), np.abs(by_lengths)


def summary(found: list[Trial]) -> str:
    """Errors of trials in one line."""
    error = np.array([t.error for t in found if t.has_limit])
    reliable = np.array([t.error for t in found if t.has_limit and t.limit.reliable])
    inside = np.mean([t.within for t in found])
    if not len(error):
        return f"{len(found):6d} robots, none with a limit within the chart"
    of_reliable = ""
    if len(reliable):
        of_reliable = (
            f" with median {np.median(reliable):7.3%}, 95 % below "
            f"{np.quantile(reliable, 0.95):6.2%}, largest {reliable.max():6.2%}"
        )
    return (
        f"{len(found):6d} robots, {len(error):5d} with a limit: median "
        f"{np.median(error):7.3%}, 95 % below {np.quantile(error, 0.95):6.2%}; reliable "
        f"{len(reliable) / len(error):6.1%}{of_reliable}; inside the interval {inside:6.2%}"
    )


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("table")
    collapse = commands.add_parser("collapse")
    collapse.add_argument("count", type=int)
    collapse.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    if given.command == "table":
        make_table()
        return
    everything = [each for found in trials(given.count, given.seed) for each in found]
    for kind in ("plain", "friction"):
        for error, source in zip(
            printed_errors(given.count, given.seed, kind), ("force", "lengths"), strict=True
        ):
            print(
                f"printed chart, {kind}, from {source}: {len(error)} limits, median "
                f"{np.median(error):.2%}, 95 % below {np.quantile(error, 0.95):.1%}"
            )
    for kind in (*KINDS, "of all"):
        for model in MODELS:
            those = [
                t
                for t in everything
                if t.limit.name == model and (kind == "of all" or t.kind == kind)
            ]
            print(f"{kind:9s}{model:23s}{summary(those)}", flush=True)


if __name__ == "__main__":
    main()
