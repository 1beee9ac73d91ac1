"""Continuous tendons in soft bodies, beside solvers of our own: closed form and shooting."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

import bowstring as bs
from shooting import STRAIGHT, hat, strain, tip_of

LENGTH, DIAMETER, E, NU = 0.12, 0.016, 0.8e6, 0.42
GRAVITY = 9.80665


def body(*tendons: dict[str, object], density: float = 0.0, twist: float = 0.0) -> bs.Robot:
    """A soft cylinder whose tendons run in it."""
    return bs.Robot.model_validate(
        {
            "name": "soft body",
            "gravity": [0.0, 0.0, -GRAVITY],
            "segments": [
                {
                    "length": LENGTH,
                    "tendons_in": "body",
                    "disks": {"count": 12, "mass": 0.0, "radius": 0.01, "thickness": 0.0},
                    "backbone": {
                        "diameter": DIAMETER,
                        "E": E,
                        "nu": NU,
                        "density": density,
                        "rest_twist": twist,
                    },
                    "tendons": list(tendons),
                }
            ],
        }
    )


def stiffness() -> np.ndarray:
    area, inertia = np.pi / 4 * DIAMETER**2, np.pi / 64 * DIAMETER**4
    shear = E / (2 * (1 + NU))
    return np.array(
        [E * inertia, E * inertia, 2 * shear * inertia, shear * area, shear * area, E * area]
    )


@pytest.mark.parametrize("tension", [0.5, 4.0])
@pytest.mark.parametrize(
    ("twist", "turns"), [(0.0, 0.0), (1.0, 0.0), (3.0, 0.0), (0.0, 0.3), (0.6, -0.2)]
)
def test_without_loads_the_strain_is_constant(twist: float, turns: float, tension: float) -> None:
    """In axes that turn with the tendon every section is the same, and the shape an exponential."""
    tendon = {"angle": 0.4, "pitch_radius": 5e-3, "turns": turns}
    solved = bs.solve(body(tendon, twist=twist), [tension]).raise_for_status()
    hole = 5e-3 * np.array([np.cos(0.4), np.sin(0.4), 0.0])
    turning = np.array([0.0, 0.0, (twist + 2 * np.pi * turns) / LENGTH])
    holes = hole[None], np.zeros((1, 3))
    rest = np.add(STRAIGHT, [*turning, 0.0, 0.0, 0.0])
    found = strain(stiffness(), rest, np.zeros(6), holes, np.array([tension]))
    rate = np.zeros((4, 4))
    rate[:3, :3], rate[:3, 3] = hat(found[:3]), found[3:]
    tip = expm(rate * LENGTH)[:3, 3]
    error = np.linalg.norm(solved.tip.position - tip)
    assert error < (1e-12 if turns == 0.0 else 1e-6) * LENGTH + solved.error_estimate.tip


def shot(
    tendons: list[dict[str, float]], tensions: list[float], density: float, tip_force: np.ndarray
) -> np.ndarray:
    """Tip by shooting from the base under weight and tip force, with the law of every section."""
    line = np.array([0.0, 0.0, -density * np.pi / 4 * DIAMETER**2 * GRAVITY])

    def holes(_: int, s: float) -> tuple[np.ndarray, np.ndarray]:
        places, slopes = [], []
        for tendon in tendons:
            end = tendon.get("end_pitch_radius", tendon["pitch_radius"])
            slope = (end - tendon["pitch_radius"]) / LENGTH
            rate = 2 * np.pi * tendon.get("turns", 0.0) / LENGTH
            r, a = tendon["pitch_radius"] + slope * s, tendon["angle"] + rate * s
            along, across = np.array([[np.cos(a), np.sin(a), 0.0], [-np.sin(a), np.cos(a), 0.0]])
            places.append(r * along)
            slopes.append(slope * along + r * rate * across)
        return np.array(places), np.array(slopes)

    def force(s: float) -> np.ndarray:
        return tip_force + line * (LENGTH - s)

    return tip_of(stiffness(), (LENGTH,), holes, tensions, force)


@pytest.mark.parametrize("force", [[0.0, 0.0, 0.0], [0.05, -0.1, 0.02]])
@pytest.mark.parametrize(
    ("tendons", "tensions"),
    [
        ([{"angle": 0.0, "pitch_radius": 6e-3, "turns": 0.5}], [1.5]),
        (
            [
                {"angle": 0.5, "pitch_radius": 6e-3, "end_pitch_radius": 2e-3},
                {"angle": 2.6, "pitch_radius": 5e-3},
                {"angle": 4.0, "pitch_radius": 3e-3, "end_pitch_radius": 5e-3, "turns": -0.3},
            ],
            [1.2, 0.3, 0.8],
        ),
    ],
)
def test_under_its_weight(
    tendons: list[dict[str, float]], tensions: list[float], force: list[float]
) -> None:
    robot = body(*tendons, density=1100.0)
    solved = bs.solve(robot, tensions, load=bs.Load(tip_force=force)).raise_for_status()
    tip = shot(tendons, tensions, 1100.0, np.array(force))
    error = np.linalg.norm(solved.tip.position - tip)
    assert error < solved.error_estimate.tip + 1e-6 * LENGTH
    assert error < 1e-4 * LENGTH
