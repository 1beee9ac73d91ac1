"""Rigid motions form a group, right-handed only."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bowstring.data.rigid import Rigid, align
from objects import refused


def motions() -> list[Rigid]:
    rng = np.random.default_rng(0)
    vectors = [np.zeros(3), [1e-8, 0, 0], [0, np.pi, 0], *rng.normal(size=(6, 3))]
    return [Rigid.from_rotation_vector(v, rng.normal(size=3)) for v in vectors]


@pytest.mark.parametrize("motion", motions(), ids=repr)
def test_a_group(motion: Rigid) -> None:
    points = np.random.default_rng(1).normal(size=(4, 5, 3))
    np.testing.assert_allclose(motion.inverse().apply(motion.apply(points)), points, atol=1e-14)
    other = motions()[-1]
    both = motion @ other
    np.testing.assert_allclose(both.apply(points), motion.apply(other.apply(points)), atol=1e-14)
    near = motion @ motion.inverse()
    np.testing.assert_allclose(near.rotation, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(near.translation, 0.0, atol=1e-14)
    back = Rigid.from_rotation_vector(motion.rotation_vector, motion.translation)
    np.testing.assert_allclose(back.rotation, motion.rotation, atol=1e-14)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = motion.rotation, motion.translation
    assert np.allclose(Rigid.from_matrix(matrix).apply(points), motion.apply(points))
    assert pickle.loads(pickle.dumps(motion)) == motion == copy.deepcopy(motion)
    assert hash(copy.copy(motion)) == hash(motion)


def test_rotation_comes_before_translation() -> None:
    """Rotation first, then translation; counter-clockwise about z maps x to y."""
    motion = Rigid.from_rotation_vector([0, 0, np.pi / 2], [10.0, 0, 0])
    np.testing.assert_allclose(motion.apply([1.0, 0, 0]), [10.0, 1.0, 0.0], atol=1e-15)
    assert "(0, 0, 90) deg" in repr(motion)
    assert motion.to_dict()["translation_m"] == [10.0, 0, 0]
    assert Rigid.identity() != motion and Rigid.identity() != 1


@pytest.mark.parametrize("count", [1, 2, 3, 8])
@pytest.mark.parametrize("spread", ["space", "line", "place"])
def test_points_are_aligned(count: int, spread: str) -> None:
    rng = np.random.default_rng(count)
    shape = {"space": np.eye(3), "line": np.diag([1.0, 0.0, 0.0]), "place": np.zeros((3, 3))}
    points = rng.normal(size=(count, 3)) @ shape[spread] + 1.0
    targets = motions()[-1].apply(points)
    np.testing.assert_allclose(align(points, targets).apply(points), targets, atol=1e-14)


def test_points_are_weighted() -> None:
    points = np.eye(3)
    frame = align(points, points * [1.0, 1.0, 2.0], np.array([1.0, 1.0, 1e-9]))
    np.testing.assert_allclose(frame.apply(points)[:2], points[:2], atol=1e-6)


def test_motions_are_immutable_copies() -> None:
    turn = np.eye(3)
    motion = Rigid(turn)
    turn[0, 0] = 5.0
    assert motion.rotation[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        motion.rotation[0, 0] = 2.0
    with pytest.raises(AttributeError):
        motion.rotation = turn  # type: ignore[misc]


def test_rounded_rotations_are_made_exact() -> None:
    exact = Rotation.from_rotvec([0.3, 0.2, -0.5]).as_matrix()
    motion = Rigid(np.round(exact, 4))
    np.testing.assert_allclose(motion.rotation @ motion.rotation.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(motion.rotation, exact, atol=1e-4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Rigid(np.diag([1.0, -1.0, 1.0])), "left-handed"),
        (lambda: Rigid(np.eye(3)[[1, 0, 2]]), "left-handed"),
        (lambda: Rigid(2 * np.eye(3)), "rotation is none"),
        (lambda: Rigid(np.zeros((3, 3))), "rotation is none"),
        (lambda: Rigid(np.full((3, 3), np.nan)), "finite"),
        (lambda: Rigid(np.eye(4)), r"shape \(4, 4\)"),
        (lambda: Rigid("a"), "must be numbers"),
        (lambda: Rigid(np.eye(3), [1, 2]), r"translation has shape \(2,\)"),
        (lambda: Rigid.from_matrix(np.ones((4, 4))), "last row"),
        (lambda: Rigid.identity().apply([1, 2]), r"points \(..., 3\)"),
    ],
)
def test_bad_input(call: object, message: str) -> None:
    refused(message, call)  # type: ignore[operator]
