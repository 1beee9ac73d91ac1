"""Hysteresis of the backbone: closed forms, calibration, error budget."""

from __future__ import annotations

import math

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from stages import law_rows

SHARE, PLAY = 0.25, math.radians(12)
SET = {"segments.*.backbone.hysteresis": SHARE, "segments.*.backbone.hysteresis_play": PLAY}
STUDY = bs.load_robot("amouri2019", SET)


def follow(robot, moments):
    """Bends (n,) about x in rad along a path of tip moments (N m)."""
    rows = np.outer(moments, [1.0, 0.0, 0.0])
    found = bs.sweep(
        robot, np.zeros((len(rows), robot.core.tendon_count)), load=bs.Load(tip_moment=rows)
    )
    assert found.converged.all()
    tangent = found.tip_rotation[:, :, 2]
    return np.arctan2(-tangent[:, 1], tangent[:, 2])


def closed_form(robot, moments):
    """The same for a constant moment: a spring E I beside a play of curvature."""
    stiffness = robot.bending_stiffness[0]
    share, play = robot.hysteresis[0]
    bends, state = [], 0.0
    for moment in moments:
        free = moment / stiffness
        # the play sticks, or follows at its half-width: kappa = M / (E I) + share x state
        kappa = free + share * state
        if abs(kappa - state) > play:
            side = math.copysign(1.0, kappa - state)
            kappa = (free - share * side * play) / (1.0 - share)
            state = kappa - side * play
        bends.append(kappa)
    disks = robot.disks
    clamped = disks.clamped_length_m.sum() - 0.5 * disks.clamped_length_m[-1]
    return np.array(bends) * (disks.station_m[-1] - clamped)


def test_loading_unloading_and_reversal_are_those_of_the_closed_form():
    largest = 1.2 * STUDY.bending_stiffness[0] / STUDY.length
    moments = largest * np.array([0.1, 0.4, 1.0, 0.7, 0.0, -0.5, -1.0, -0.2, 0.0, 0.9])
    bends = follow(STUDY, moments)
    assert bends == pytest.approx(closed_form(STUDY, moments), abs=1e-10)
    # a set stays without load, on either side
    assert bends[4] > math.radians(3) and bends[8] < -math.radians(3)


def test_below_the_play_the_backbone_is_elastic():
    moments = np.array([0.5, 0.0]) * STUDY.bending_stiffness[0] * PLAY / STUDY.length
    elastic = bs.load_robot("amouri2019")
    assert follow(STUDY, moments) == pytest.approx(follow(elastic, moments), abs=1e-12)


def test_the_path_between_two_turning_points_does_not_matter():
    def end(steps):
        up = np.linspace(0.0, 60.0, steps + 1)[1:]
        down = np.linspace(60.0, 5.0, steps + 1)[1:]
        tensions = np.outer(np.concatenate([up, down]), [1.0, 0.0, 0.0])
        return bs.sweep(STUDY, tensions).tip_position[-1]

    # modules far from the others in bend may turn at other steps
    assert np.linalg.norm(end(40) - end(160)) < 1e-4 * STUDY.length
    elastic = bs.sweep(bs.load_robot("amouri2019"), [[5.0, 0.0, 0.0]])
    assert np.linalg.norm(end(40) - elastic.tip_position[0]) > 0.02 * STUDY.length


def test_a_cycle_dissipates_the_work_of_the_closed_form():
    stiffness, length = STUDY.bending_stiffness[0], STUDY.length
    largest = 1.5 * stiffness / length
    cycle = largest * np.sin(np.linspace(0.5 * np.pi, 2.5 * np.pi, 2001))
    bends = follow(STUDY, np.concatenate([[largest], cycle]))[1:]
    work = 0.5 * ((cycle[1:] + cycle[:-1]) * np.diff(bends)).sum()
    # per length: 4 E I share x play x (amplitude of the curvature - play)
    share, play = STUDY.hysteresis[0]
    flexible = closed_form(STUDY, [1e-9 * largest])[0] * stiffness / (1e-9 * largest)
    amplitude = bends[0] / flexible
    expected = 4.0 * stiffness * share * play * (amplitude - play) * flexible
    assert work == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("disks", [3, 12])
def test_beyond_the_play_the_backbone_is_softer_and_bent_back(disks):
    """Where all curvature grows beyond the play r, EI ((1 - w) kappa + w r) is the moment: that of
    an elastic robot of (1 - w) EI which is bent back by w r / (1 - w) without load."""
    play = math.radians(2.0)
    own = {"nu": None, "G": 13.5e9}  # torsion keeps nothing
    changes = {f"segments.0.backbone.{name}": value for name, value in own.items()}
    changes |= {"segments.0.backbone.hysteresis_play": play, "segments.0.disks.count": disks}
    robot = bs.load_robot("amouri2019", {**SET, **changes})
    model = bs.RodModel("kirchhoff", elements=8)
    load = bs.Load([[20.0, 0.0, 0.0], [60.0, 0.0, 0.0]], gravity=(0.0, 0.0, -9.81))
    elastic = robot.with_({"segments.0.backbone.hysteresis": 0})
    softer = elastic.with_(
        {
            "segments.0.backbone.E": (1.0 - SHARE) * robot.segments[0].backbone.E,
            "segments.0.backbone.rest_bend": SHARE / (1.0 - SHARE) * play,
            "segments.0.backbone.rest_direction": math.pi,  # away from the first tendon
        }
    )
    found, expected, without = (
        bs.sweep(r, load=load, model=model) for r in (robot, softer, elastic)
    )
    off = np.linalg.norm(found.tip_position - expected.tip_position, axis=1)
    assert (off < found.tip_error + 1e-10).all() and found.tip_error.max() < 1e-5
    assert np.linalg.norm(found.tip_position - without.tip_position, axis=1).min() > 1e-3


def test_a_history_of_earlier_versions_has_one_set_for_each_module():
    first = bs.sweep(STUDY, [[60.0, 0.0, 0.0]])
    stored = first.history()
    each = len(stored["plays_per_m"]) // STUDY.core.disk_count
    old = {**stored, **{name: stored[name][::each] for name in ("plays_per_m", "lags_per_m")}}
    new, rest = (bs.sweep(STUDY, [[5.0, 0.0, 0.0]], history=h) for h in (stored, old))
    assert each > 1 and rest.converged.all()
    assert np.linalg.norm(rest.tip_position[0] - new.tip_position[0]) < 0.02 * STUDY.length


def test_loads_between_disks_leave_the_set_where_it_is():
    """A relaxed robot is a softer one, also where loads divide its modules into other elements, and
    a history continues where such a load goes."""
    changes = {"segments.0.backbone.nu": None, "segments.0.backbone.G": 13.5e9}
    relaxes = {"segments.0.backbone.relaxation": 0.3, "segments.0.disks.count": 4}
    robot = bs.load_robot("amouri2019", {**changes, **relaxes})
    softer = robot.with_(
        {
            "segments.0.backbone.relaxation": 0.0,
            "segments.0.backbone.E": 0.7 * robot.segments[0].backbone.E,
        }
    )
    places = 0.3 * robot.length, 0.42 * robot.length
    pushed = [bs.PointLoad(arc_length=at, force=(0.3, 0.2, 0.0)) for at in places]
    model = bs.RodModel("kirchhoff", elements=8)
    first = bs.Load([[20.0, 0.0, 0.0]] * 2, point_loads=pushed)
    found = bs.sweep(robot, load=first, model=model, times=[0.0, 1e9])
    same = bs.solve(softer, load=bs.Load([20.0, 0.0, 0.0], point_loads=pushed), model=model)
    off = np.linalg.norm(found.tip_position[1] - same.tip.position)
    assert off < found.tip_error[1] + same.error_estimate.tip < 2e-5
    later = bs.Load([[20.0, 0.0, 0.0]])
    rest = bs.sweep(robot, load=later, model=model, times=[1e9], history=found.history())
    alone = bs.solve(softer, load=bs.Load([20.0, 0.0, 0.0]), model=model)
    off = np.linalg.norm(rest.tip_position[0] - alone.tip.position)
    assert off < rest.tip_error[0] + alone.error_estimate.tip


def test_displacements_count_from_the_home_pose_without_a_set():
    displacements = np.array([[0.02, np.nan, np.nan], [0.0, np.nan, np.nan]])
    load = bs.Load(np.where(np.isnan(displacements), 1.0, np.nan), displacements)
    changes = {"segments.*.tendons.compliance": "0.05 mm/N"}
    robot = bs.load_robot("amouri2019", {**SET, **changes})
    found = bs.sweep(robot, load=load)
    elastic = bs.sweep(robot.with_({"segments.*.backbone.hysteresis": 0}), load=load)
    assert found.converged.all() and elastic.converged.all()
    # the tendon that was displaced is slack by what the set leaves
    assert found.slack_lengths[-1, 0] > 1e-3 > elastic.slack_lengths[-1, 0]
    assert found.tip_position[-1, 0] > 0.01 + elastic.tip_position[-1, 0]


def test_fit_finds_share_and_play():
    truth = {"segments.0.backbone.hysteresis": 0.2, "segments.0.backbone.hysteresis_play": 0.1}
    tensions = np.concatenate(
        [np.outer(np.abs(np.sin(np.linspace(0, 6, 40))) * 50, row) for row in np.eye(3)]
    )
    rng = np.random.default_rng(3)
    tips = bs.sweep(bs.load_robot("amouri2019", truth), tensions).tip_position  # synthetic
    tips = tips + rng.normal(0.0, 1e-4, tips.shape)
    start = bs.load_robot(
        "amouri2019",
        {"segments.0.backbone.hysteresis": 0.1, "segments.0.backbone.hysteresis_play": 0.15},
    )
    found = fit(start, Data(points=tips, tensions=tensions), list(truth), loss="linear")
    assert found.converged, found.message
    share, play = found.estimates
    assert share.low < 0.2 < share.high and share.standard_error < 0.01
    assert play.low < math.degrees(0.1) < play.high and play.standard_error < 1.0


def test_the_error_budget_has_rows_of_hysteresis():
    found, rows = law_rows(STUDY, bs.load_robot("amouri2019"))
    up, down = rows["hysteresis_loading"], rows["hysteresis_unloading"]
    assert 1e-3 < up.moved < down.moved
    assert any("hysteresis of the backbone (25 %)" in text for text in found.text)


@pytest.mark.slow
def test_the_study_and_a_workspace_leave_the_set_out():
    from bowstring.study.run import run_study
    from bowstring.validity.loading import Loading

    robots = STUDY, bs.load_robot("amouri2019")
    loading = Loading(max_tension=40.0)
    found, elastic = (run_study(robot, loading=loading) for robot in robots)
    assert found.statics.tip_position == pytest.approx(elastic.statics.tip_position, abs=1e-9)
    assert any("hysteresis" in note for note in found.notes)
    spaces = [bs.workspace_map(robot, max_tension=20.0, poses=64) for robot in robots]
    assert spaces[0].tip == pytest.approx(spaces[1].tip, abs=1e-9, nan_ok=True)
