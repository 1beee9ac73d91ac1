"""The input of CalculiX."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from bowstring.fem import deck
from bowstring.fem.mesh import Fineness, brick_mesh
from fem_robots import small_robot, two_segments

LOADING = deck.Loading((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1000.0, True, 1e-4)


def test_every_span_begins_at_a_node_of_its_own() -> None:
    mesh = brick_mesh(two_segments(), Fineness(2, 4, 1))
    spans = deck.spans(mesh)
    assert len(spans.first) == 2 * 2 + 3 * 4
    assert len(set(spans.first.tolist())) == len(spans.first)
    inner = spans.tied >= 0
    np.testing.assert_array_equal(inner, spans.disk > 0)
    np.testing.assert_array_equal(spans.tied[inner], mesh.hole[spans.disk, spans.tendon][inner])
    np.testing.assert_array_equal(spans.last, mesh.hole[spans.disk + 1, spans.tendon])


def test_the_model_is_in_mm_newton_and_tonnes() -> None:
    robot = small_robot()
    mesh = brick_mesh(robot, Fineness(2, 4, 1), mass_arms=True)
    steps = [deck.Step((40.0, 0.0, 0.0), 0.5, 0.1, 0.1)]
    text = deck.model(robot, mesh, LOADING, steps)
    assert "*MATERIAL, NAME=FREE1\n*ELASTIC\n35000,0.3\n*DENSITY\n1.8e-09\n" in text
    assert "*MATERIAL, NAME=HELD1\n*ELASTIC\n35000000,0\n" in text
    masses = [float(v) for v in re.findall(r"\*MASS, ELSET=\S+\n(\S+)", text)]
    assert 4 * sum(masses) == pytest.approx(2 * 20e-6)  # 20 g each, four nodes an entry
    assert "*AMPLITUDE, NAME=COURSE1, TIME=TOTAL TIME\n0,0\n0.5,40\n" in text
    nodes = text[text.index("*NODE") : text.index("*NSET")].split("\n")[1:-1]
    assert max(float(line.split(",")[3]) for line in nodes) == pytest.approx(141.5)
    assert max(map(len, text.split("\n"))) < 132  # limit of CalculiX


def test_a_sliding_base_is_held_on_average() -> None:
    """Its rigid-body motion is constrained, but not the deformation of a bent section."""
    mesh = brick_mesh(small_robot(), Fineness(2, 8, 1))
    text = deck.model(small_robot(), mesh, replace(LOADING, bonded=False), [deck.Step((1.0, 0, 0))])
    x, y, _ = mesh.nodes[mesh.base].T
    column = {int(node) + 1: i for i, node in enumerate(mesh.base)}
    found = []
    for equation in text.split("*EQUATION\n")[1:]:
        numbers = re.split(r"[,\n]", equation.split("*")[0])
        terms = np.array(numbers[1 : 1 + 3 * int(numbers[0])], dtype=float).reshape(-1, 3)
        if int(terms[0, 0]) in column:
            row = np.zeros((2, len(x)))
            for node, axis, value in terms:
                row[int(axis) - 1, column[int(node)]] += value
            found.append(row.ravel())
    means = np.array(found)
    assert means.shape == (3, 2 * len(x))
    one, none = np.ones_like(x), np.zeros_like(x)
    whole = np.array([[*one, *none], [*none, *one], [*(-y), *x]]).T
    assert np.linalg.matrix_rank(means @ whole, tol=1e-6) == 3
    for bent in ([*(x * x - y * y), *(2 * x * y)], [*(2 * x * y), *(y * y - x * x)]):
        np.testing.assert_allclose(means @ bent, 0.0, atol=1e-12)


def test_static_steps_ramp_and_motion_follows_its_history() -> None:
    robot = small_robot(gravity="0 0 -10 m/s^2")
    mesh = brick_mesh(robot, Fineness(2, 4, 1))
    loading = replace(LOADING, gravity=(0.0, 0.0, -10.0), tip_force=(0.0, 2.0, 0.0))
    rest = deck.Step((40.0, 0.0, 5.0), first=0.25, longest=0.5)
    text = deck.steps(robot, mesh, loading, [rest])
    assert "*STATIC\n0.25,1,0.0001,0.5\n" in text
    assert "*TEMPERATURE\nTENDON1,40\n" in text and "TENDON3,5\n" in text
    assert "FREE1,GRAV,10000,0,0,-1" in text
    forces = np.array(
        [line.split(",") for line in re.findall(r"^\d+,[123],[-\d.e]+$", text, re.MULTILINE)],
        dtype=float,
    )
    total = [forces[forces[:, 1] == axis, 2].sum() for axis in (1, 2, 3)]
    np.testing.assert_allclose(total, [0.0, 2.0, -10 * 2 * 0.020], atol=1e-9)
    moving = deck.steps(robot, mesh, LOADING, [deck.Step((40.0, 0.0, 0.0), 0.5, 0.1, 0.1)])
    assert "*DYNAMIC\n0.05,0.5,5e-05,0.05\n*TEMPERATURE, AMPLITUDE=COURSE1\nTENDON1,1.\n" in moving
    assert "U,V" in moving


def test_a_motion_is_one_step_with_intermediate_output() -> None:
    """At the start of each step CalculiX would recompute the accelerations, with an impulse."""
    mesh = brick_mesh(small_robot(), Fineness(2, 4, 1))
    todo = [
        deck.Step((0.0, 0.0, 0.0), first=0.1),
        deck.Step((20.0, 0.0, 0.0), 0.5, 0.1, 0.1),
        deck.Step((40.0, 0.0, 0.0), 0.25, 0.2, 0.2),
    ]
    text = deck.steps(small_robot(), mesh, LOADING, todo)
    assert text.count("*STEP") == 2 and text.count("*STATIC") == 1
    moving = text[text.rindex("*STEP") :]
    assert "*DYNAMIC\n0.05,0.75,5e-05,0.05\n" in moving
    assert "*NODE PRINT, NSET=BODY, TIME POINTS=OUTPUTS\nU,V\n" in moving
    assert "FREQUENCY" not in moving
    assert deck.steps(small_robot(), mesh, LOADING, todo[1:]) == moving
    model = deck.model(small_robot(), mesh, LOADING, todo)
    assert "*TIME POINTS, NAME=OUTPUTS, TIME=TOTAL TIME\n1.5\n1.75\n" in model


def test_damping_is_of_the_whole_model() -> None:
    mesh = brick_mesh(small_robot(), Fineness(2, 4, 1))
    text = deck.model(small_robot(), mesh, replace(LOADING, damping=1.5), [])
    assert text.index("*MATERIAL") < text.index("*DAMPING, ALPHA=1.5\n") < text.index("*BOUNDARY")
    assert "*DAMPING" not in deck.model(small_robot(), mesh, LOADING, [])


def test_a_stopped_run_continues_after_its_last_step() -> None:
    assert deck.resume(7).startswith("*RESTART, READ, STEP=7\n")
