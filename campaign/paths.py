"""Stated errors of random paths with a memory: ``python -m campaign.paths 2000``.

Random robots with each law, and with all, follow 20 random commands under random loads. Each step
is compared with that of eight elements, and the second half with that from a stored history.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

import bowstring as bs
from bowstring.errors import InputError

Array = NDArray[np.float64]

STEPS: Final = 20
LAWS: Final = ("friction", "backlash", "creep", "hysteresis", "relaxation", "all")
_TIMED: Final = ("creep", "relaxation", "all")
#: Errors that are compared: above this part of the length and of the largest tension.
_LEAST: Final = (1e-9, 1e-7)


class Path(NamedTuple):
    """Stated and true errors of each step: tip over the length, tension over the largest.

    `large` steps state more than 1e-4 of the length. `continued` is the largest distance of the
    path from its continued first half, over the errors of both; NaN if a step did not converge.
    """

    stated: Array
    error: Array
    large: Array
    continued: float


def _law(name: str, rng: np.random.Generator) -> dict[str, object]:
    kept = rng.uniform(0.05, 0.5)
    hysteresis = kept * (rng.uniform() if name == "all" else 1.0)
    laws: dict[str, dict[str, object]] = {
        "friction": {"tendons.friction": rng.uniform(0.05, 0.4)},
        "backlash": {"tendons.backlash": rng.uniform(1e-4, 1e-3)},
        "creep": {
            "tendons.creep_compliance": rng.uniform(1e-6, 3e-5),
            "tendons.creep_time": rng.uniform(5.0, 60.0),
        },
        "hysteresis": {
            "backbone.hysteresis": hysteresis,
            "backbone.hysteresis_play": rng.uniform(0.01, 0.3),
        },
        "relaxation": {
            "backbone.relaxation": kept - hysteresis if name == "all" else kept,
            "backbone.relaxation_time": rng.uniform(5.0, 60.0),
        },
    }
    if name != "all":
        return laws[name]
    return {field: value for law in laws.values() for field, value in law.items()}


def _robot(law: str, rng: np.random.Generator) -> bs.Robot:
    """A robot of one or two segments; tapered, precurved or with winding tendons at random."""
    base = bs.load_robot(str(rng.choice(["amouri2019", "rao2021"])))
    segments = len(base.segments)
    fields = _law(law, rng)
    if law == "creep" or rng.random() < 0.5:
        fields["tendons.compliance"] = rng.uniform(5e-6, 5e-5)
    changes = {f"segments.*.{name}": value for name, value in fields.items()}
    for k, segment in enumerate(base.segments):
        own = f"segments.{k}"
        changes[f"{own}.disks.count"] = int(rng.integers(2, 12 // segments))
        diameter = segment.backbone.outer_diameter
        if rng.random() < 0.3 and segment.backbone.inner_diameter == 0.0:
            changes[f"{own}.backbone.end_diameter"] = rng.uniform(0.7, 1.0) * diameter
        if rng.random() < 0.3:
            changes[f"{own}.backbone.rest_bend"] = rng.uniform(0.0, 0.6)
            changes[f"{own}.backbone.rest_direction"] = rng.uniform(-3.0, 3.0)
    if segments == 1 and rng.random() < 0.3:
        changes["segments.0.tendons.turns"] = rng.uniform(-0.2, 0.2)
    return base.with_(changes)


def _load(robot: bs.Robot, rng: np.random.Generator) -> bs.Load:
    """Commands that bend the robot by up to about a radian, and dead loads."""
    holes = robot.tendons.hole_m
    stiffness, length = robot.bending_stiffness[0], robot.length
    bend = rng.uniform(-1.0, 1.0, (STEPS, 2))
    shortening = bend @ holes.T
    if rng.random() < 0.5:
        commands = {"displacements": shortening + 0.01 * np.abs(holes).max()}
    else:
        tension_per_length = stiffness / (length * np.abs(holes).max() ** 2)
        commands = {"tensions": np.maximum(shortening, 0.0) * tension_per_length}
    direction = rng.normal(size=(2, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    force = rng.choice([0.0, 1.0]) * stiffness / length**2
    return bs.Load(**commands, gravity=9.81 * direction[0], tip_force=force * direction[1])


def _rows(load: bs.Load, rows: slice) -> bs.Load:
    def part(values: Array | None) -> Array | None:
        return None if values is None else values[rows]

    return bs.Load(
        tensions=part(load.tensions),
        displacements=part(load.displacements),
        gravity=load.gravity,
        tip_force=load.tip_force,
    )


def follow(law: str, number: int) -> Path | str:
    """Follow one random path; the refusal of its robot or load as text."""
    rng = np.random.default_rng([46, LAWS.index(law), number])
    try:
        robot = _robot(law, rng)
        load = _load(robot, rng)
        times = 5.0 * np.arange(STEPS) if law in _TIMED else None
        found = bs.sweep(robot, load=load, times=times)
        best = bs.sweep(robot, load=load, times=times, model=bs.RodModel(elements=8))
    except InputError as error:
        return str(error)
    both = found.converged & best.converged
    last = STEPS if both.all() else int(np.argmin(both))
    tensions, length = best.tensions[:last], robot.length
    unit = np.array([length, max(1e-9, np.abs(tensions).max(initial=0.0))])
    off = np.linalg.norm(found.tip_position - best.tip_position, axis=1)[:last]
    of_tension = np.abs(found.tensions[:last] - tensions).max(axis=1, initial=0.0)
    error = np.stack([off, of_tension], axis=1) / unit
    stated = np.stack([found.tip_error, found.tension_error], axis=1)[:last] / unit
    # eight elements may have turned to another branch as well, and state it
    large = np.maximum(found.tip_error, best.tip_error)[:last] > 1e-4 * length
    half, continued = STEPS // 2, math.nan
    if last == STEPS:
        rows = slice(half, None)
        shorter = bs.sweep(
            robot, load=_rows(load, slice(half)), times=None if times is None else times[:half]
        )
        history = json.loads(json.dumps(shorter.history()))
        later = None if times is None else times[rows] - times[half - 1]
        rest = bs.sweep(robot, load=_rows(load, rows), times=later, history=history)
        apart = np.linalg.norm(rest.tip_position - found.tip_position[rows], axis=1)
        allowed = rest.tip_error + found.tip_error[rows] + 1e-9 * length
        continued = float(np.max(np.where(rest.converged, apart / allowed, np.inf)))
    return Path(stated, error, large, continued)


def _print(law: str, found: Iterable[Path | str]) -> None:
    all_paths = list(found)
    paths = [path for path in all_paths if isinstance(path, Path)]
    if not paths:
        print(f"{law}: all {len(all_paths)} paths refused")
        return
    stated, error, large = (np.concatenate(x) for x in list(zip(*paths, strict=True))[:3])
    texts = []
    for q, least in enumerate(_LEAST):
        counted = (error[:, q] > least) & ~large
        ratio = stated[counted, q] / error[counted, q]
        covered, close = ((ratio >= 1.0).sum(), (ratio <= 30.0).sum())
        count = max(1, len(ratio))
        texts.append(
            f"{len(ratio)} steps, covered {covered / count:.2%}, "
            f"within 30 times {close / count:.1%}"
        )
    ratio = np.array([path.continued for path in paths])
    ratio = ratio[~np.isnan(ratio)]
    print(
        f"{law}: {len(paths)} paths, {len(all_paths) - len(paths)} refused; tip {texts[0]}; "
        f"tension {texts[1]}; {large.sum()} of {len(error)} steps state more than 1e-4; "
        f"{(ratio > 1.0).sum()} of {len(ratio)} continued otherwise, at most "
        f"{ratio.max(initial=0.0):.1f} times the errors of both"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", type=int, help="random paths in all")
    parser.add_argument("--law", choices=LAWS, help="only this law")
    given = parser.parse_args()
    laws = [given.law] if given.law else LAWS
    each = -(-given.paths // len(laws))
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        for law in laws:
            _print(law, pool.map(follow, [law] * each, range(each), chunksize=4))


if __name__ == "__main__":
    main()
