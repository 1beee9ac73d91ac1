"""Holes with an entry and an exit plane, instead of points in the mid-plane of the disk."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bowstring as bs

THICK = "6 mm"
ROBOT = bs.load_robot(
    "amouri2019",
    {"segments.0.disks.hole_length": THICK, "segments.0.disks.clamped_length": "3 mm"},
)
POINTS = ROBOT.with_({"segments.0.disks.hole_length": "0 mm"})


def lengths(robot: bs.Robot, solution: bs.Solution) -> np.ndarray:
    """Lengths of the tendons from the poses: spans between planes, and the holes."""
    half = 0.5 * robot.disks.hole_length_m
    out = []
    planes = np.broadcast_to(robot.tendons.holes_m, (len(robot.tendons.end_disk), len(half) + 1, 2))
    for holes in planes:
        point, length = np.append(holes[0], 0.0), 0.0
        for k, (place, turn) in enumerate(
            zip(solution.disk_positions, solution.disk_rotations, strict=True)
        ):
            entry = place + turn @ np.append(holes[k + 1], -half[k])
            length += np.linalg.norm(entry - point) + half[k]
            point = place + turn @ np.append(holes[k + 1], half[k])
            if k < len(half) - 1:
                length += half[k]
        out.append(length)
    return np.array(out)


@pytest.mark.parametrize("changes", [{}, {"segments.0.tendons.turns": 0.2}])
@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
def test_lengths_are_those_between_the_planes(changes: dict[str, Any], theory: str) -> None:
    robot = ROBOT.with_(changes)
    for load in ({"tensions": [40, 5, 0]}, {"displacements": [0.03, -0.03, -0.012]}):
        found = bs.solve(robot, load=bs.Load(**load), model=bs.RodModel(theory))
        np.testing.assert_allclose(found.tendon_lengths, lengths(robot, found), atol=1e-12)
    straight = bs.solve(ROBOT, [0, 0, 0])
    np.testing.assert_allclose(straight.tendon_lengths, ROBOT.length, atol=1e-12)


def test_tendon_work_is_elastic_energy() -> None:
    """Without friction the work of the tendons, by their lengths, is stored in the backbone: forces
    and lengths belong to one geometry."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    top = 60.0
    model = bs.RodModel(elements=1)

    def length(tension: float) -> float:
        return float(bs.solve(ROBOT, [tension, 0, 0], model=model).tendon_lengths[0])

    # integral of T dl by parts
    tensions = 0.5 * top * (nodes + 1.0)
    area = 0.5 * top * float(weights @ [length(t) for t in tensions])
    work = area - top * length(top)
    stored = float(bs.solve(ROBOT, [top, 0, 0], model=model).to_dataset().elastic_energy[0])
    assert work == pytest.approx(stored, rel=1e-7)


def test_they_bend_the_robot_less() -> None:
    """A shorter span is nearer to a curve parallel to the backbone, so that its arm is shorter."""
    planes, points = (bs.solve(robot, [40, 0, 0]) for robot in (ROBOT, POINTS))
    continuous = bs.solve(POINTS, [40, 0, 0], model=bs.RodModel(tendon_path="continuous"))
    bends = [s.tip.position[0] for s in (continuous, planes, points)]
    assert bends[0] < bends[1] - 0.2e-3 < bends[2] - 0.4e-3
    # their limit are points
    thin = ROBOT.with_({"segments.0.disks.hole_length": "1 um"})
    off = bs.solve(thin, [40, 0, 0]).tip.position - points.tip.position
    assert np.linalg.norm(off) < 1e-6


def test_continuous_tendons_have_no_planes() -> None:
    model = bs.RodModel(tendon_path="continuous")
    a, b = (bs.solve(robot, [40, 0, 0], model=model) for robot in (ROBOT, POINTS))
    assert np.abs(a.disk_positions - b.disk_positions).max() == 0.0
    assert np.abs(a.tendon_lengths - b.tendon_lengths).max() == 0.0


def test_friction_by_the_bends_between_spans() -> None:
    rough = ROBOT.with_({"segments.0.tendons.friction": 0.1})
    up = bs.sweep(rough, np.outer(np.linspace(0, 40, 9), [1, 0, 0]))
    down = bs.sweep(rough, np.outer(np.r_[np.linspace(0, 40, 9), np.linspace(40, 0, 9)], [1, 0, 0]))
    assert up.converged.all() and down.converged.all()
    # at 20 N before and after 40 N
    assert np.linalg.norm(down.tip_position[13] - up.tip_position[4]) > 1e-3
    # while all holes slip, the tension falls by the angle between the spans at each
    found = bs.solve(rough, [40, 0, 0])
    half = 0.5 * rough.disks.hole_length_m
    frames = [np.eye(3), *found.disk_rotations]
    ends = [np.zeros(3), *found.disk_positions]
    hole = np.append(rough.tendons.hole_m[0], 0.0)
    reach = np.append(0.0, half)
    spans = [
        (ends[k + 1] + frames[k + 1] @ (hole - reach[k + 1] * np.eye(3)[2]))
        - (ends[k] + frames[k] @ (hole + reach[k] * np.eye(3)[2]))
        for k in range(9)
    ]
    spans = np.array([span / np.linalg.norm(span) for span in spans])
    before = np.vstack([[0, 0, 1], spans[:-1]])
    angles = np.arccos(np.clip((before * spans).sum(axis=1), -1, 1))
    tensions = 40.0 * np.exp(-0.1 * np.cumsum(angles))
    np.testing.assert_allclose(found.span_tensions[:, 0], tensions, rtol=1e-6)


def test_the_error_budget_has_a_row(paper: bs.Study) -> None:
    row = next(row for row in paper.budget.rows if row.effect == "hole_planes")
    assert row.label == "holes of 3 mm, not points" and not row.acts_in_sweep
    moved = row.in_sweep.tip_position - row.reference.tip_position
    assert 0.1e-3 < np.linalg.norm(moved[-1]) < 10e-3
    # no effect on a continuous tendon
    assert np.abs(row.added.tip_position - paper.budget.baseline.tip_position).max() == 0.0
    study = bs.run_study(ROBOT, loading=bs.Loading(points=5))
    acting = next(row for row in study.budget.rows if row.effect == "hole_planes")
    assert acting.acts_in_sweep
