"""Tendons in the body itself: soft robots without disks."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from scipy.optimize import minimize

import bowstring as bs
from bowstring.errors import InputError

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("BOWSTRING_DATA", ROOT.parent / "shared" / "data"))
TENTACLE = ROOT / "examples" / "tentacle.yaml"


def test_a_body_needs_no_disks() -> None:
    robot = bs.load_robot(TENTACLE)
    jsonschema.validate(yaml.safe_load(TENTACLE.read_text()), bs.robot_schema())
    assert robot.is_embedded
    assert robot.warnings == ()
    assert robot.disks.mass_kg.sum() == 0.0

    # the mass is that of two cones
    def volume(a: float, b: float, length: float) -> float:
        return np.pi / 12.0 * length * (a * a + a * b + b * b)

    mass = 1500.0 * (volume(0.03082, 0.01284, 0.305) + volume(0.01284, 0.0096, 0.055))
    lengths = np.array([s.length for s in robot.segments])
    assert robot.mass_per_length @ lengths == pytest.approx(mass, rel=1e-12)


def test_embedded_tendons_are_the_limit_of_many_disks() -> None:
    """Second order in the distance of the disks, tapered and converging under gravity."""
    tensions = [6.0, 1.0]
    tip = bs.solve(bs.load_robot(TENTACLE), tensions).raise_for_status().tip.position
    gaps = []
    for count in (20, 40, 80):
        disks = {"mass": 0.0, "radius": 0.05, "thickness": 0.0, "clamped_length": 0.0}
        changes: dict[str, object] = {
            "segments.0.disks": disks | {"count": count},
            "segments.1.disks": disks | {"count": 4},
        }
        robot = bs.load_robot(TENTACLE, changes)
        # the same holes with straight spans between disks that the core takes as such
        spans = bs._core.Robot(_with_straight_spans(robot))
        found = spans.solve(tensions, bs.Load(), bs.RodModel())
        gaps.append(np.linalg.norm(found.disk_positions[-1] - tip))
    assert gaps[0] / gaps[1] == pytest.approx(4.0, rel=0.25)
    assert gaps[1] / gaps[2] == pytest.approx(4.0, rel=0.25)
    assert gaps[2] < 3e-3 * 0.36


class _StraightSpans:
    """Arrays of a robot whose tendons are straight between disks."""

    is_embedded = False

    def __init__(self, robot: bs.Robot) -> None:
        self._robot = robot

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)


def _with_straight_spans(robot: bs.Robot) -> _StraightSpans:
    return _StraightSpans(robot)


def test_bodies_and_disks_do_not_mix(tmp_path: Path) -> None:
    text = TENTACLE.read_text()
    head, tail = text.rsplit("    tendons_in: body\n", 1)
    path = tmp_path / "mixed.yaml"
    path.write_text(
        head + "    disks: {count: 2, mass: 1 g, radius: 8 mm, thickness: 1 mm}\n" + tail
    )
    with pytest.raises(InputError, match="tendons_in: got disks after body"):
        bs.load_robot(path)


@pytest.mark.data
def test_markers_of_a_measured_tentacle() -> None:
    """E, nu and density identified on eight measured configurations, as the authors of the data
    did: the mean error of the markers is 10.8 mm (theirs, over more configurations: 15.8). Some
    6 mm of it are the same along the axis at all loads, and an offset of the base takes it away."""
    path = DATA / "soromox-tentacle" / "single_tendon.csv"
    if not path.exists():
        pytest.skip(f"needs the data of others, soromox-tentacle, in {DATA}")
    with path.open() as file:
        rows = list(csv.DictReader(file))
    tensions = np.array([[float(r["tension_1_N"]), float(r["tension_2_N"])] for r in rows])
    markers = np.array(
        [[[float(r[f"marker_{i}_{q}_m"]) for q in "xyz"] for i in (1, 2, 3, 4)] for r in rows]
    )
    offsets = 1e-3 * np.array([[0, 25, 0], [0, -21, 0], [0, 20, 0], [0, 0, 8.0]])
    # places where the markers are, and others between them
    at = [30, 60, 95, 129.1, 160, 190, 219.5, 250, 280, 305]
    places = {"mass": 0.0, "radius": 0.016, "thickness": 0.0, "clamped_length": 0.0}
    shape: dict[str, object] = {
        "segments.0.disks": places | {"positions": [1e-3 * s for s in at]},
        "segments.1.disks": places | {"count": 3},
    }
    held = [at.index(s) for s in (129.1, 219.5, 280)] + [len(at) + 2]
    start = np.array([0.505, 0.45, 1.5, 0.0])  # MPa, 1, g/cm^3, mm

    def errors(x: np.ndarray) -> np.ndarray:
        changes = dict(shape)
        for k in (0, 1):
            numbers = {"E": x[0] * 1e6, "nu": x[1], "density": x[2] * 1e3}
            changes |= {f"segments.{k}.backbone.{n}": float(v) for n, v in numbers.items()}
        found = bs.solve_batch(bs.load_robot(TENTACLE, changes), tensions, disks=True)
        place = found.disk_positions[:, held]
        turn = found.disk_rotations[:, held]
        model = place + np.einsum("nkij,kj->nki", turn, offsets) + [0.0, 0.0, 1e-3 * x[3]]
        return np.linalg.norm(model - markers, axis=-1)

    def fitted(free: int) -> float:
        """Least mean error over the first parameters, within the bounds of the authors."""
        low, high = np.array([0.01, 0.4, 1.0, -20.0]), np.array([1.0, 0.5, 2.0, 20.0])

        def mean(x: np.ndarray) -> float:
            return float(errors(np.clip(np.append(x, start[free:]), low, high)).mean())

        found = minimize(mean, start[:free], method="Nelder-Mead", options={"fatol": 1e-6})
        print(f"{found.x} {1e3 * found.fun:.2f} mm of {1e3 * mean(start[:free]):.2f} mm")
        return float(found.fun)

    assert fitted(3) < 11e-3  # asked: 10 mm
    assert fitted(4) < 10e-3
