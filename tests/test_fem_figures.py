"""Figures of finite elements."""

from __future__ import annotations

import numpy as np

from bowstring.fem import BrickRun, deck, figures
from bowstring.fem.fields import State
from bowstring.fem.mesh import Fineness, brick_mesh
from fem_robots import small_robot, two_segments


def test_visible_faces_of_an_out_of_plane_backbone() -> None:
    for robot in (small_robot(), two_segments()):
        mesh = brick_mesh(robot, Fineness(2, 8, 1))
        nothing = np.zeros((int((~mesh.stiff).sum()), 8, 6))
        moved = np.outer(mesh.nodes[:, 2], [0.1, 0.3, 0.0])  # sideways, by more than its thickness
        state = State(moved, None, nothing, nothing, np.zeros((len(deck.spans(mesh).first), 3)))
        settings = {"rise_s": None, "gravity": [0.0] * 3, "tip_force": [0.0] * 3}
        tensions = np.zeros((1, len(robot.tendons.end_disk)))
        run = BrickRun(robot, mesh, settings, np.zeros(1), tensions, [state])
        place, _, quads = figures._surface(run)
        side = figures._outward(place, quads)[:, 1]
        built = mesh.nodes[quads].mean(axis=1)[:, 1]  # of the straight robot
        clear = np.abs(built) > 0.1 * robot.segments[0].backbone.diameter
        assert clear.sum() > 20
        np.testing.assert_array_equal(np.sign(side[clear]), np.sign(built[clear]))
