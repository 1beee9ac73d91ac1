"""The piecewise linear model of a measured point, against the rod that it approximates."""

import numpy as np
import pytest

import bowstring as bs
from bowstring import RodModel
from bowstring.calibration import observations
from bowstring.calibration.observations import Data
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import TipModel

NAMES = ["segments.0.tendons.compliance", "offset.tendons", "segments.0.backbone.E", "base.rx"]
#: Three tendons, each shortened in turn while the others are lengthened by half of it, m.
DISPLACEMENTS = np.concatenate(
    [np.outer(np.linspace(0, 0.02, 4), np.roll([1, -0.5, -0.5], i)) for i in range(3)]
)


def model_at(offset, names=NAMES, mount=0.0):
    """The rod's model, the values, and the point there."""
    robot = bs.load_robot("amouri2019").with_({"segments.0.tendons.compliance": 2e-4})
    unknowns = Unknowns(robot, names, {"offset.tendons": offset, "mount_compliance": mount})
    data = Data(points=np.zeros((12, 3)), displacements=DISPLACEMENTS)
    model = TipModel(unknowns, observations.commands(data, robot), RodModel())
    return model, unknowns.start, model.predict(unknowns.start, keep=True)


@pytest.mark.parametrize("mount", [0.0, 1e-5])
def test_the_model_follows_the_rod_across_active_set_changes(mount):
    model, values, at = model_at(5e-4, mount=mount)
    pieces = model.pieces(values, at)
    change = np.array([0.0, *(3 * [6e-4]), 0.0, 0.0])  # to a state with more taut tendons
    real = model.predict(values + change, keep=True)
    moved, taut = pieces.moved(change)
    before = np.array([s.tensions for s in at.solutions]) > 0
    after = np.array([s.tensions for s in real.solutions]) > 0
    assert (before != after).sum() >= 6
    assert (taut == after).all()
    error = np.abs(at.point + moved - real.point).max()
    assert error < 0.03 * np.abs(real.point - at.point).max()
    straight = np.abs(at.point + pieces.tangent(before) @ change - real.point).max()
    assert straight > 5 * error  # one active set does not represent it


@pytest.mark.parametrize("mount", [0.0, 1e-5])
def test_its_tangent_is_the_models_derivative(mount):
    """Also for parameters differentiated numerically, such as the angle of the holes."""
    model, values, at = model_at(5e-4, [*NAMES, "hole_angle", "mount_compliance"], mount)
    pieces = model.pieces(values, at)
    taut = np.array([s.tensions for s in at.solutions]) > 0
    exact = model.jacobian(values, at)
    assert np.abs(pieces.tangent(taut) - exact).max() < 1e-9 * np.abs(exact).max()


def test_active_set_changes_match_the_rod():
    model, values, at = model_at(5e-4)
    pieces = model.pieces(values, at)
    distance, gradient = pieces.crossings()
    k, t = np.unravel_index(np.argmin(distance), distance.shape)
    was = at.solutions[k].tensions[t] > 0
    toward = -gradient[k, t] / np.linalg.norm(gradient[k, t]) * distance[k, t]
    for share, changes in ((0.9, False), (1.1, True)):
        moved = model.predict(values + share * toward, keep=True)
        assert (was != (moved.solutions[k].tensions[t] > 0)) == changes
