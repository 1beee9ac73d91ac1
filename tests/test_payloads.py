"""Rigid bodies fixed to disks: weight, inertia, motion and modes."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

import bowstring as bs
from stages import Stages

ROBOT = bs.load_robot("amouri2019", {"gravity": "0 0 -9.81"})
LIGHT = bs.load_robot(
    "amouri2019",
    {"segments.0.disks.mass": "0 g", "segments.0.backbone.density": "0 kg/m^3"},
)
TENSIONS = [40.0, 0.0, 10.0]
TOOL: dict[str, Any] = {
    "mass": "50 g",
    "centre": "5 -10 30 mm",
    "inertia": "12 15 8 kg*mm^2",
}


def carrying(robot: bs.Robot, *payloads: dict[str, Any]) -> bs.Robot:
    return robot.with_({"payloads": list(payloads)})


def test_the_weight_acts_at_the_centre_of_mass() -> None:
    robot = carrying(ROBOT, TOOL, {"mass": "20 g", "disk": 5, "centre": "0 20 0 mm"})
    assert robot.payload_numbers[:, 0].tolist() == [8.0, 4.0]
    weights = [
        bs.PointLoad(force=[0, 0, -0.05 * 9.81], point=[0.005, -0.010, 0.030]),
        bs.PointLoad(4, force=[0, 0, -0.02 * 9.81], point=[0, 0.020, 0]),
    ]
    for load in ({"tensions": TENSIONS}, {"displacements": [0.03, -0.03, -0.012]}):
        found = bs.solve(robot, load=bs.Load(**load))
        same = bs.solve(ROBOT, load=bs.Load(**load, point_loads=weights))
        assert found.stable
        assert np.abs(found.disk_positions - same.disk_positions).max() < 1e-12
    # without gravity it weighs nothing
    free = bs.solve(robot, TENSIONS, load=bs.Load(gravity=(0, 0, 0)))
    bare = bs.solve(ROBOT, TENSIONS, load=bs.Load(gravity=(0, 0, 0)))
    assert np.abs(free.disk_positions - bare.disk_positions).max() < 1e-13


def test_a_body_like_the_disk_is_a_heavier_disk() -> None:
    """Mass and inertia at the centre of each disk are those of the disk itself."""
    disks = ROBOT.disks
    own = [
        {
            "disk": k + 1,
            "mass": float(disks.mass_kg[k]),
            "inertia": [float(disks.inertia_kg_m2[k, q]) for q in (0, 0, 1)],
        }
        for k in range(9)
    ]
    both = carrying(ROBOT, *own)
    heavy = ROBOT.with_({"segments.0.disks.mass": "40 g"})
    a, b = bs.modes(both, TENSIONS), bs.modes(heavy, TENSIONS)
    np.testing.assert_allclose(a.frequency_hz, b.frequency_hz, rtol=1e-9)
    np.testing.assert_allclose(np.abs(a.displacement), np.abs(b.displacement), atol=1e-6)
    runs = [bs.simulate(r, bs.dynamics.ramp(TENSIONS, 0.1), 0.3) for r in (both, heavy)]
    np.testing.assert_allclose(runs[0].tip_position, runs[1].tip_position, atol=1e-6)


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_frequencies_are_those_of_a_body_on_a_beam(gravity: float) -> None:
    """A massless beam with a body on its end, whose centre of mass lies beyond it: four degrees of
    freedom with a closed form; under gravity a beam in tension, and a pendulum."""
    m, d, inertia = 0.05, 0.03, (1.2e-5, 1.5e-5, 8e-6)
    body = {"mass": m, "centre": [0, 0, d], "inertia": list(inertia)}
    robot = carrying(LIGHT, body)
    load = bs.Load([0, 0, 0], gravity=(0, 0, gravity))
    model = bs.RodModel("kirchhoff", elements=2)
    found = bs.modes(robot, load=load, model=model, count=5)
    length, bending = robot.length, float(robot.bending_stiffness[0])
    # deflection and slope of a clamped beam in tension by those of its end
    tension = m * gravity

    def shapes(x: float) -> np.ndarray:
        """Four solutions of EI w'''' = T w'' and their first three derivatives."""
        if tension == 0.0:
            return np.array([[1, x, x**2, x**3], [0, 1, 2 * x, 3 * x**2], [0, 0, 2, 6 * x],
                             [0, 0, 0, 6.0]])  # fmt: skip
        k = math.sqrt(tension / bending)
        s, c = math.sinh(k * x), math.cosh(k * x)
        return np.array([[1, x, c, s], [0, 1, k * s, k * c], [0, 0, k**2 * c, k**2 * s],
                         [0, 0, k**3 * s, k**3 * c]])  # fmt: skip

    start, end = shapes(0.0), shapes(length)
    # columns: coefficients for unit deflection and unit slope of the end
    conditions = np.array([start[0], start[1], end[0], end[1]])
    coefficients = np.linalg.solve(conditions, np.eye(4)[:, 2:])
    force = -bending * end[3] @ coefficients + tension * end[1] @ coefficients
    moment = bending * end[2] @ coefficients
    stiffness = np.array([force, moment]) + np.diag([0.0, m * gravity * d])
    expected = []
    # bending towards x turns about y, and towards y about x
    for about in (1, 0):
        mass = np.array([[m, m * d], [m * d, m * d**2 + inertia[about]]])
        expected += np.sqrt(eigh(stiffness, mass, eigvals_only=True)).tolist()
    torsion = float(robot.torsion_stiffness[0]) / length
    expected.append(math.sqrt(torsion / inertia[2]))
    expected = np.sort(expected) / (2 * np.pi)
    np.testing.assert_allclose(found.frequency_hz, expected, rtol=2e-5)


def test_hash_and_overrides() -> None:
    robot = carrying(ROBOT, TOOL)
    assert robot.hash != ROBOT.hash
    assert carrying(ROBOT, {**TOOL, "disk": 9}).hash == robot.hash
    assert robot.with_({"payloads.0.mass": "80 g"}).hash != robot.hash
    assert json.loads(robot.definition)["payloads"][0]["mass"] == 0.05


def test_a_map_varies_the_mass_of_a_payload() -> None:
    robot = carrying(ROBOT, TOOL, {"mass": "10 g", "disk": 3})
    drawn = bs.validity_map(robot, ["payloads.0.mass=10:50 g:3", "tension=0:20 N:3"])
    assert drawn.value["cc_from_force"].shape == (3, 3)


def test_implausible_payloads_get_a_warning() -> None:
    far = carrying(ROBOT, {"mass": "1 g", "centre": [0, 0, 20]})
    assert "payloads[0].centre is 20 m from its disk" in " ".join(far.warnings)
    heavy = carrying(ROBOT, {"mass": 50.0})
    assert "payloads[0].mass = 50 kg" in " ".join(heavy.warnings)
    assert not any("payload" in text for text in carrying(ROBOT, TOOL).warnings)


@pytest.mark.usefixtures("coarse")
def test_a_study_and_a_map_take_a_payload() -> None:
    robot = carrying(ROBOT, TOOL)
    found = bs.run_study(robot, loading=bs.Loading(max_tension=20.0, points=5))
    name = "cc_from_force"
    bare = Stages(ROBOT, max_tension=20.0, points=5).comparisons[name]
    assert found.comparison(name).mean > bare.mean
    drawn = bs.validity_map(robot, ["tension=0:20 N:5"])
    other = bs.validity_map(ROBOT, ["tension=0:20 N:5"])
    assert not np.allclose(drawn.value[name], other.value[name], equal_nan=True)
