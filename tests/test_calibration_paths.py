"""Derivatives along paths with a memory, beside differences of whole paths."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray

import bowstring as bs
from bowstring import Load, RodModel
from bowstring._core import PathStates
from bowstring.calibration import Data
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import Commands, Prediction, TipModel
from bowstring.robot.model import Robot
from bowstring.statics import actuation
from test_calibration_fitting import made_up_displacements, three_segments
from test_calibration_initial_state import MEMORIES, ROBOT, course

Floats = NDArray[np.float64]
ALL = "segments.*."
#: Fields of each law in all segments, and those of them that are fitted.
LAWS: dict[str, tuple[dict[str, object], list[str]]] = {
    "friction": ({"tendons.friction": 0.2}, ["tendons.friction"]),
    "friction before the base hole": (
        {"tendons.friction": 0.05, "tendons.wrap_angle": 5.0},
        ["tendons.friction", "tendons.wrap_angle"],
    ),
    "friction, mount and clearance": (
        {
            "tendons.friction": 0.1,
            "tendons.hole_clearance": 2e-4,
            "tendons.mount_compliance": 1e-5,
        },
        ["tendons.friction", "tendons.hole_clearance", "tendons.mount_compliance"],
    ),
    "backlash": ({"tendons.backlash": 1e-4}, ["tendons.backlash"]),
    "hysteresis": (
        {"backbone.hysteresis": 0.3, "backbone.hysteresis_play": 0.05},
        ["backbone.hysteresis", "backbone.hysteresis_play"],
    ),
    "relaxation": (
        {"backbone.relaxation": 0.3, "backbone.relaxation_time": 3.0},
        ["backbone.relaxation", "backbone.relaxation_time"],
    ),
    "creep": (
        {"tendons.creep_compliance": 3e-5, "tendons.creep_time": 30.0},
        ["tendons.creep_compliance", "tendons.creep_time"],
    ),
    "friction and relaxation": (
        {
            "tendons.friction": 0.1,
            "backbone.relaxation": 0.3,
            "backbone.relaxation_time": 3.0,
        },
        ["tendons.friction", "backbone.relaxation"],
    ),
}
#: Parameters of robot, drives and start that are fitted with each law.
OTHERS = [
    "segments.1.backbone.E",
    ALL + "tendons.compliance",
    "gravity.0",
    "gain.tendons.3",
    "offset.tendons.6",
    "pitch_radius.segments.2",
    "hole_angle.segments.1",
    "delay",
    "tool.z",
]
START = {"delay": 0.1, "tool.z": 8e-3}


def with_law(law: str) -> tuple[Robot, list[str]]:
    fields, fitted = LAWS[law]
    changed = {f"segments.{i}.{name}": value for i in range(3) for name, value in fields.items()}
    return three_segments(**changed), [ALL + name for name in fitted]


def one_sided(model: TipModel, values: Floats, i: int, change: float) -> Floats:
    """Differences (K, 3 M) of whole paths over a change of a parameter."""
    moved = values.copy()
    moved[i] += change
    apart = model.predict(moved).coordinates - model.predict(values).coordinates
    return np.asarray(apart / change)


def check(model: TipModel) -> None:
    """Compare all derivatives with differences to both sides, whose distance is their error."""
    values = model.unknowns.start
    found = model.jacobian(values, model.predict(values))
    for i, item in enumerate(model.unknowns.items):
        sides = [one_sided(model, values, i, sign * 1e-4 * item.step) for sign in (1.0, -1.0)]
        low, high = np.minimum(*sides), np.maximum(*sides)
        size = np.sqrt((np.maximum(*np.abs(sides)) ** 2).mean())
        assert size > 0.0, item.name
        outside = np.maximum(low - found[:, :, i], found[:, :, i] - high).max(axis=1) / size
        assert outside.max() < 2e-3, (item.name, outside.argmax(), outside.max())
        # most rows are not at a kink
        assert np.median((high - low).max(axis=1)) < 1e-3 * size, item.name


@pytest.mark.parametrize("law", LAWS)
def test_derivatives_lie_between_differences_of_whole_paths(law: str) -> None:
    robot, fitted = with_law(law)
    rows = made_up_displacements(40)
    commands = Commands(np.ones(rows.shape, bool), rows, np.linspace(0.0, 20.0, len(rows)))
    unknowns = Unknowns(robot, [*OTHERS, *fitted], START)
    # one point below the tip
    check(TipModel(unknowns, commands, RodModel(), (14, 29)))


@pytest.mark.parametrize("theory", ["cosserat", "kirchhoff"])
def test_derivatives_with_inextensible_tendons_and_a_tension(
    theory: Literal["cosserat", "kirchhoff"],
) -> None:
    """Drives that stop in every other row, and two recordings, of which one begins bent."""
    robot = ROBOT.with_(MEMORIES["relaxation"] | {"segments.0.tendons.friction": 0.1})
    rows = np.repeat(course(20), 2, axis=0)
    held = np.ones(rows.shape, bool)
    held[:, 2], rows[:, 2] = False, np.linspace(2.0, 5.0, len(rows))
    names = ["segments.0.backbone.E", "segments.0.tendons.friction", "gain.tendons.0"]
    names += ["pitch_radius.segments.0", "initial_displacement.0.0"]
    unknowns = Unknowns(robot, names, {"initial_displacement.0.0": 1e-3})
    commands = Commands(held, rows, np.arange(40.0), np.repeat([0, 1], 20))
    check(TipModel(unknowns, commands, RodModel(theory=theory)))


@pytest.mark.slow
def test_derivatives_beside_a_row_without_equilibrium() -> None:
    """The rows after it are as beside whole paths, and time passes in it."""
    robot, fitted = with_law("friction and relaxation")
    rows = made_up_displacements(8)
    rows[3] = 0.05  # no backbone is compressed by as much
    commands = Commands(np.ones(rows.shape, bool), rows, np.linspace(0.0, 20.0, len(rows)))
    model = TipModel(Unknowns(robot, fitted[1:]), commands, RodModel(), (29,))
    values = model.unknowns.start
    at = model.predict(values)
    assert at.solved.tolist() == [row != 3 for row in range(8)]
    found = model.jacobian(values, at)[at.solved, :, 0]
    apart = one_sided(model, values, 0, 1e-4 * model.unknowns.items[0].step)[at.solved]
    np.testing.assert_allclose(found, apart, rtol=0, atol=2e-3 * np.abs(apart).max())


@pytest.mark.parametrize("law", LAWS)
def test_a_path_from_the_states_of_another_is_that_from_home(law: str) -> None:
    compare_with_home(law, made_up_displacements(40), (0.0, 0.1, -0.1, 1e-4, 0.0))


@pytest.mark.parametrize(
    "law",
    [pytest.param(law, marks=pytest.mark.slow) if "friction" in law else law for law in LAWS],
)
def test_states_of_a_path_pass_over_a_row_without_equilibrium(law: str) -> None:
    rows = made_up_displacements(8)
    rows[3] = 0.05  # no backbone is compressed by as much
    assert not compare_with_home(law, rows, (0.0, 0.1))[3]


def compare_with_home(law: str, rows: Floats, changes: tuple[float, ...]) -> list[bool]:
    """Predictions at start values that move by `changes` of their steps, one after another.

    Returns whether each row is solved.
    """
    robot, fitted = with_law(law)
    commands = Commands(np.ones(rows.shape, bool), rows, np.linspace(0.0, 20.0, len(rows)))
    unknowns = Unknowns(robot, [*OTHERS, *fitted], START)
    model = TipModel(unknowns, commands, RodModel(), (14, 29))
    steps = np.array([item.step for item in unknowns.items])
    for change in changes:
        values = unknowns.start + change * steps
        found, home = model.predict(values, keep=True), model.from_home(values)
        assert found.states and not home.states
        np.testing.assert_array_equal(found.solved, home.solved)
        assert len(rows) - 2 <= found.solved.sum()
        np.testing.assert_allclose(found.points, home.points, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.tensions, home.tensions, rtol=0, atol=1e-8)
    solved: list[bool] = found.solved.tolist()
    return solved


def test_a_fit_whose_rows_have_another_equilibrium_from_home_has_not_converged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot, fitted = with_law("friction")
    rows = made_up_displacements(8)
    commands = Commands(np.ones(rows.shape, bool), rows, None)
    tips = TipModel(Unknowns(robot, fitted), commands, RodModel()).predict(np.array([0.2])).point
    data = Data(tips, displacements=rows)
    assert bs.fit(robot, data, fitted, start={fitted[0]: 0.18}).converged
    predicted = TipModel.from_home

    def elsewhere(model: TipModel, values: Floats) -> Prediction:
        at = predicted(model, values)
        at.position[2] += 1e-3
        return at

    monkeypatch.setattr(TipModel, "from_home", elsewhere)
    found = bs.fit(robot, data, fitted, start={fitted[0]: 0.18})
    assert not found.converged
    assert "1 of 8 rows have another equilibrium on a path from the home pose" in found.message


def test_the_states_of_another_path_save_iterations() -> None:
    robot, _ = with_law("friction")
    held, rows = np.ones((40, 9), bool), made_up_displacements(40)
    core = actuation.Path(robot, RodModel(elements=1)).core
    home = core.follow(held, rows, Load(), False, None, None, PathStates())
    core.reset()
    again = core.follow(held, rows, Load(), False, None, None, home["states"])
    assert again["iterations"].sum() < 0.2 * home["iterations"].sum()


@pytest.mark.parametrize("law", ["none", "hysteresis"])
@pytest.mark.parametrize("disks", [(29,), (14, 29)])
def test_a_kept_prediction_serves_other_frames(law: str, disks: tuple[int, ...]) -> None:
    robot, fitted = with_law(law) if law in LAWS else (three_segments(), [])
    rows = made_up_displacements(12)
    commands = Commands(np.ones(rows.shape, bool), rows, np.linspace(0.0, 20.0, len(rows)))
    names = ["segments.0.backbone.E", "gain", "pitch_radius", "base", "tool", *fitted]
    names += ["marker.0"] * (len(disks) > 1)
    unknowns = Unknowns(robot, names)
    model, fresh = (TipModel(unknowns, commands, RodModel(), disks) for _ in range(2))
    values = unknowns.start
    model.jacobian(values, model.predict(values, keep=True))
    solved = model.solves
    moved = np.where(model.of_frames, values + np.linspace(0.01, 0.05, len(values)), values)
    here, there = model.predict(moved, keep=True), fresh.predict(moved, keep=True)
    np.testing.assert_allclose(here.points, there.points, rtol=0, atol=1e-13)
    found, expected = model.jacobian(moved, here), fresh.jacobian(moved, there)
    size = np.abs(expected).max(axis=(0, 1))
    np.testing.assert_allclose(found / size, expected / size, rtol=0, atol=1e-6)
    assert model.solves == solved
    assert model.predict(1.001 * moved, keep=True).points[0, 0, 0] != here.points[0, 0, 0]
    assert model.solves > solved
