"""Swapped tendons, left-handed frames and wrong units are reported, but only where certain."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.data.columns import Column, Joined
from bowstring.data.measurements import Measurements, load
from bowstring.data.tendon_check import check_tendons
from bowstring.robot.model import Robot
from objects import measured

STUDY = bs.load_robot("amouri2019")
RNG = np.random.default_rng(5)
STAR = np.concatenate([np.outer(np.linspace(0, 60, 7), row) for row in np.eye(3)])
ANY = RNG.uniform(0, 60, (30, 3)) * (RNG.random((30, 3)) < 0.6)
PLANE = np.outer(np.linspace(0, 80, 17), [1, 0, 0])


def made(robot: Robot, tensions: Floats, **loads: ArrayLike) -> Measurements:
    """Tips by statics with 0.02 mm of noise: synthetic."""
    tip = bs.solve_batch(robot, tensions, load=bs.Load(**loads)).tip_position
    noise = np.random.default_rng(1).normal(0, 2e-5, tip.shape)
    return measured(tip + noise, tensions=tensions)


def reordered(data: Measurements, first: int, second: int) -> Measurements:
    order = np.arange(data.tendon_count)
    order[[first - 1, second - 1]] = second - 1, first - 1
    return replace(
        data, tensions=data.tensions[:, order], displacements=data.displacements[:, order]
    )


GRAVITIES = [(0, 0, 0), (0, 0, -9.81), (9.81, 0, 0)]


@pytest.mark.parametrize("gravity", GRAVITIES)
@pytest.mark.parametrize("tensions", [STAR, ANY], ids=["star", "any"])
def test_one_segment(tensions: Floats, gravity: tuple[float, float, float]) -> None:
    data = made(STUDY, tensions, gravity=gravity)
    right = check_tendons(STUDY, data)
    assert right.found == "as_stated" and not right.alarm and right.unexplained < 0.1
    assert "other sense" not in right.sentence
    for pair in combinations((1, 2, 3), 2):
        found = check_tendons(STUDY, reordered(data, *pair))
        # three tendons in reverse order are two of them swapped: both are reported
        assert found.found == "mirrored" and found.tendons == pair and found.alarm
        assert f"or tendons {pair[0]} and {pair[1]} are swapped" in found.sentence
        assert "left-handed" in found.sentence


@pytest.mark.parametrize("turn", range(6))
def test_the_measuring_frame_may_lie_anywhere(turn: int) -> None:
    data = made(STUDY, ANY)
    rotation = Rotation.random(random_state=turn).as_matrix()
    moved = replace(data, points=data.points @ rotation.T + [1.0, -2.0, 0.3])
    found = check_tendons(STUDY, moved)
    assert found.found in ("as_stated", "turned") and not found.alarm
    mirrored = check_tendons(STUDY, replace(moved, points=moved.points * [1, 1, -1]))
    assert mirrored.found == "mirrored" and mirrored.alarm


def test_the_angle_is_that_of_the_base_in_the_measuring_frame() -> None:
    data = made(STUDY, ANY)
    base = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    found = check_tendons(STUDY, replace(data, points=data.points @ base.T))
    assert found.found == "turned" and "a base turned by 30 degrees" in found.sentence
    assert np.degrees(found.turn) == pytest.approx(30, abs=1)


@pytest.mark.parametrize("gravity", GRAVITIES)
def test_planar_motion_gives_no_warning(gravity: tuple[float, float, float]) -> None:
    data = made(STUDY, PLANE, gravity=gravity)
    for same in (data, reordered(data, 2, 3), replace(data, points=data.points * [1, -1, 1])):
        found = check_tendons(STUDY, same)
        assert (
            found.found == "as_stated"
            and "cannot distinguish the reversed numbering" in found.sentence
        )
    # where the frame is registered, the direction identifies the tendon
    wrong = check_tendons(STUDY, reordered(data, 1, 2))
    assert wrong.found == "turned" and wrong.tendons == (1, 2) and not wrong.alarm
    assert wrong.turn == pytest.approx(-np.radians(120), abs=np.radians(2))


def test_the_sign_of_displacements() -> None:
    data = made(STUDY, ANY)
    displacements = bs.solve_batch(STUDY, ANY).tendon_lengths
    displacements = STUDY.length - displacements
    data = replace(data, tensions=np.full_like(displacements, np.nan), displacements=displacements)
    assert check_tendons(STUDY, data).found == "as_stated"
    found = check_tendons(STUDY, replace(data, displacements=-displacements))
    assert found.found == "turned" and abs(found.turn) == pytest.approx(np.pi, abs=0.05)
    assert "the sign of the displacements is wrong" in found.sentence
    named = check_tendons(STUDY, reordered(data, 2, 3))
    assert named.found == "mirrored" and named.tendons == (2, 3)


def test_two_segments(rao: Robot) -> None:
    tensions = RNG.uniform(0, 1.5, (60, 6)) * (RNG.random((60, 6)) < 0.5)
    data = made(rao, tensions)
    assert check_tendons(rao, data).found == "as_stated"
    for pair in [(1, 2), (1, 3), (2, 3), (4, 5), (4, 6), (5, 6)]:
        found = check_tendons(rao, reordered(data, *pair))
        assert (found.found, found.tendons) == ("swapped", pair), found.sentence
    assert check_tendons(rao, replace(data, points=data.points * [-1, 1, 1])).found == "mirrored"


def swings(time: Floats) -> Floats:
    """Displacements (n, 3) of two oscillations, whose periods have no common multiple, m."""
    x, y = 6e-3 * np.sin(1.1 * time), 5e-3 * np.sin(0.61 * time + 0.4)
    angles = np.radians([0, 120, 240])
    return np.asarray(np.outer(x, np.cos(angles)) + np.outer(y, np.sin(angles)))


def late_table(lag: float) -> Measurements:
    """Tips by statics, some time behind the commands of their rows."""
    time = np.arange(0.0, 31.0, 0.23)
    tips = bs.solve_batch(STUDY, load=bs.Load(displacements=swings(time - lag))).tip_position
    return measured(tips, displacements=swings(time), time=time)


@pytest.mark.parametrize("lag", [1.7, -3.04])
def test_clocks_that_are_apart(lag: float) -> None:
    data = late_table(lag)
    alone = check_tendons(STUDY, data)
    side = "behind" if lag > 0 else "ahead of"
    assert alone.alarm and f"{abs(lag):.3g} s {side} the commands" in alone.sentence
    assert "--parameter delay" in alone.sentence and alone.unexplained < 0.1
    # the shift is added to the clock of the joined table, and replaces the one it had
    for has_commands, shift in ((True, 0.5 + lag), (False, 0.5 - lag)):
        joined = replace(data, join=Joined(0.5, has_commands))
        found = check_tendons(STUDY, joined)
        named = re.search(r"write shift: (\S+) s in the mapping's join", found.sentence)
        assert named and float(named[1]) == pytest.approx(shift, abs=0.011), found.sentence
        assert "agrees with the tendon order" in found.sentence
    fitted = check_tendons(STUDY, data, delay_is_fitted=True)
    assert fitted.found == "as_stated" and "clocks" not in fitted.sentence
    # both errors at once
    swapped = check_tendons(STUDY, reordered(data, 1, 3))
    assert f"{abs(lag):.3g} s {side}" in swapped.sentence
    assert "or tendons 1 and 3 are swapped" in swapped.sentence


@pytest.mark.parametrize("lag", [-2.4, 7.1])
@pytest.mark.parametrize("motion", ["periodic", "ramp"])
def test_shifts_of_motions_with_several_peaks_or_a_flat_one(motion: str, lag: float) -> None:
    """The smallest of the shifts that explain a periodic motion; one ramp, once."""
    time = np.arange(0.0, 70.0, 0.07)

    def commands(at: Floats) -> Floats:
        share = np.clip((at - 30) / 9, 0, 1) if motion == "ramp" else np.sin(at) * np.sin(0.2 * at)
        return np.outer(6e-3 * share, np.cos(np.radians([0, 120, 240])))

    lengths = STUDY.length - commands(time - lag)
    arcs = bs.constant_curvature.RobotArcs.from_lengths(STUDY, lengths, hold_length=True)
    data = replace(late_table(0.0).select(np.zeros(len(time), int)), time=time)
    data = replace(data, displacements=commands(time), points=arcs.tip.position[:, None])
    sentence = check_tendons(STUDY, data).sentence
    named = re.search(r"tips are (\S+) s (behind|ahead of) the commands", sentence)
    assert named, sentence
    assert float(named[1]) * (1 if named[2] == "behind" else -1) == pytest.approx(lag, abs=0.03)


@pytest.mark.parametrize("lag", [0.08, -0.1])
def test_a_small_shift_that_the_data_prove_is_a_remark(lag: float) -> None:
    found = check_tendons(STUDY, replace(late_table(lag), join=Joined(0.0, True)))
    assert found.found == "as_stated" and 0.05 < found.unexplained < 0.1
    assert f"write shift: {lag:.3g} s in the mapping's join" in found.remark
    assert found.remark in found.sentence
    fitted = check_tendons(STUDY, late_table(lag), delay_is_fitted=True)
    assert not fitted.remark and fitted.unexplained < 0.05


@pytest.mark.parametrize("motion", ["triangle", "sines"])
@pytest.mark.parametrize("backlash", [0.5e-3, 2e-3])
def test_hysteresis_is_no_shift_of_the_clocks(motion: str, backlash: float) -> None:
    """Behind a backlash the tips are late too, by a time that differs with the speed."""
    data = late_table(0.0)
    assert data.time is not None
    commands = swings(data.time)
    if motion == "triangle":
        share = np.abs((data.time / 6.3) % 2 - 1)
        commands = 8e-3 * np.outer(share, np.cos(np.radians([0, 120, 240])))
    moved = commands.copy()
    for before, now in pairwise(moved):
        np.clip(before, now - backlash / 2, now + backlash / 2, out=now)
    moved -= moved.mean(axis=1, keepdims=True)
    arcs = bs.constant_curvature.RobotArcs.from_lengths(STUDY, STUDY.length - moved)
    found = check_tendons(
        STUDY, replace(data, displacements=commands, points=arcs.tip.position[:, None])
    )
    assert found.found == "as_stated" and not found.remark, found.sentence


def test_clocks_are_not_blamed_for_the_order_nor_for_noise() -> None:
    right = late_table(0.0)
    assert check_tendons(STUDY, right).found == "as_stated"
    swapped = check_tendons(STUDY, reordered(right, 1, 2))
    assert swapped.found == "mirrored" and "clocks" not in swapped.sentence
    noise = np.random.default_rng(3).normal(0, 0.02, right.points.shape)
    for other in (
        replace(right, points=noise),
        replace(late_table(1.7), time=right.time[::-1]),  # type: ignore[index]
    ):
        found = check_tendons(STUDY, other)
        assert found.found == "unclear" and not re.search("apart|behind|ahead", found.sentence)


def test_tables_that_cannot_be_checked() -> None:
    data = made(STUDY, ANY)
    for other, says in (
        (data.select(slice(3)), "it takes 4 rows or more"),
        (replace(data, scale=None), "points are in pixels"),
        (replace(data, points=data.points * 0, tensions=1e-5 * ANY), "the tip hardly moves"),
        (replace(data, tensions=ANY[:, :0], displacements=ANY[:, :0]), "no command of any tendon"),
        (
            replace(data, tensions=ANY[:, :2], displacements=ANY[:, :2]),
            "2 tendons, amouri2019 has 3",
        ),
        (replace(data, points=data.points[:, :0]), "no point and no direction"),
        (replace(data, tensions=ANY * np.nan), "some tendons are given by tension and others"),
    ):
        found = check_tendons(STUDY, other)
        assert found.found == "unchecked" and says in str(found) and not found.alarm
    still = check_tendons(STUDY, replace(data, tensions=ANY * 0))
    assert still.found == "unclear"


@pytest.mark.parametrize("part", ["train", "val", "keypoints", "tendon_pull"])
@pytest.mark.slow
def test_a_measured_robot_of_three_segments(part: str, public_data: Callable[[str], Path]) -> None:
    public_data("crl-ftdcr-mocap")
    robot, data = bs.load_robot("crl-ftdcr-v4"), load("crl-ftdcr-mocap", part)
    right = check_tendons(robot, data)
    assert right.found == "as_stated", right.sentence
    if part == "tendon_pull":
        return  # most tendons are slack: too little variance is explained to identify any
    for pair in [(1, 2), (2, 3), (4, 5), (5, 6), (7, 8), (7, 9)]:
        found = check_tendons(robot, reordered(data, *pair))
        assert (found.found, found.tendons) == ("swapped", pair), found.sentence
    for mirror in ([1, -1, 1], [-1, 1, 1]):
        found = check_tendons(robot, replace(data, points=data.points * mirror))
        assert found.found == "mirrored" and not found.tendons
    # the numbers in the column names used as the order
    by_id = np.argsort([4, 3, 9, 5, 2, 8, 6, 1, 7])
    found = check_tendons(robot, replace(data, displacements=data.displacements[:, by_id]))
    assert found.found == "unclear" and found.alarm
    assert check_tendons(robot, replace(data, displacements=-data.displacements)).found == "turned"


def test_measured_angles(public_data: Callable[[str], Path]) -> None:
    public_data("tamm-spring")
    data = load("tamm-spring")
    tendons = [{"angle": f"{a} deg", "pitch_radius": "2.5 mm"} for a in (30, 150, 270)]
    robot = STUDY.with_(
        {
            "segments.0.length": "40 mm",
            "segments.0.disks.radius": "4 mm",
            "segments.0.backbone.diameter": "1 mm",
            "segments.0.tendons": tendons,
        }
    )
    as_stated = check_tendons(robot, data)
    assert as_stated.found == "as_stated"
    assert as_stated.sentence.startswith("The tip's rotation agrees with the tendon order")
    for pair in combinations((1, 2, 3), 2):
        found = check_tendons(robot, reordered(data, *pair))
        assert found.found == "mirrored" and found.tendons == pair
    assert data.direction is not None
    clockwise = check_tendons(robot, replace(data, direction=-data.direction))
    assert clockwise.found == "mirrored"


# -- tensions in another unit ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "says"), [(1e3, "would wind amouri2019"), (1e-3, "the tip moves far more")]
)
def test_tensions_in_a_wrong_unit_give_a_warning(factor: float, says: str) -> None:
    data = made(STUDY, PLANE, gravity=(0, 0, -9.81))
    assert not check_tendons(STUDY, data).alarm
    found = check_tendons(STUDY, replace(data, tensions=factor * data.tensions))
    assert found.found == "unclear" and found.alarm
    assert says in found.sentence and "check the unit of the tensions or masses" in found.sentence


@pytest.mark.parametrize("times", [0.3, 3.0])
def test_a_stiffness_to_be_calibrated_is_not_doubted(times: float) -> None:
    data = made(STUDY, 0.25 * STAR)
    other = STUDY.with_({"segments.0.backbone.E": times * 35e9})
    assert not check_tendons(other, data).alarm


# -- a table in another unit, or scaled by a factor ----------------------------------------------

SILICONE = STUDY.with_(
    {
        "gravity": "0 0 9.80665",  # suspended: it bends a tenth of the linear law
        "segments.0.length": "400 mm",
        "segments.0.backbone.diameter": "20 mm",
        "segments.0.backbone.E": "1 MPa",
        "segments.0.backbone.density": 1070,
        "segments.0.disks.count": 10,
        "segments.0.disks.mass": "30 g",
        "segments.0.disks.thickness": "5 mm",
        "segments.0.tendons.pitch_radius": "25 mm",
    }
)
SLENDER = STUDY.with_(
    {
        "segments.0.length": "123.6 mm",
        "segments.0.backbone.diameter": "1 mm",
        "segments.0.backbone.E": "60 GPa",
        "segments.0.disks.mass": "1 g",
        "segments.0.disks.radius": "6 mm",
        "segments.0.disks.thickness": "2 mm",
        "segments.0.tendons.pitch_radius": "4.75 mm",
    }
)


def by_displacement(robot: Robot, tensions: Floats) -> Measurements:
    data = made(robot, tensions)
    lengths = bs.solve_batch(robot, tensions).tendon_lengths
    return replace(data, tensions=tensions * np.nan, displacements=robot.length - lengths)


BENCHES = {
    "silicone": (SILICONE, made(SILICONE, np.outer(np.linspace(0, 1, 12), [1, 0, 0]))),
    "silicone, any": (SILICONE, made(SILICONE, ANY / 60)),
    "study": (STUDY, made(STUDY, PLANE)),
    "slender": (SLENDER, made(SLENDER, STAR / 15)),
    "slender, by displacement": (SLENDER, by_displacement(SLENDER, STAR / 15)),
}


@pytest.mark.parametrize("name", BENCHES)
def test_a_correct_table_gives_no_warning(name: str) -> None:
    robot, data = BENCHES[name]
    found = check_tendons(robot, data)
    assert found.found == "as_stated" and found.unexplained < 0.2, found.sentence


@pytest.mark.parametrize("name", BENCHES)
@pytest.mark.parametrize(
    ("factor", "is_tip"),
    # tips 1000 times larger are rejected
    [(1e3, False), *((factor, is_tip) for factor in (1e-3, 0.1, 10.0) for is_tip in (True, False))],
)
def test_another_unit_is_noticed(name: str, factor: float, is_tip: bool) -> None:
    robot, data = BENCHES[name]
    commands = "displacements" if "displacement" in name else "tensions"
    changed = ("points",) if is_tip else ("tensions", "displacements")
    found = check_tendons(
        robot, replace(data, **{each: factor * getattr(data, each) for each in changed})
    )
    assert found.found == "unclear" and found.alarm
    assert "check the unit of" in found.sentence and "check the order" not in found.sentence
    assert ("of the tip's columns" if is_tip else f"of the {commands}") in found.sentence


def test_a_tip_that_does_not_move_is_noticed() -> None:
    data = made(STUDY, ANY)
    found = check_tendons(STUDY, replace(data, points=data.points * 0))
    assert found.alarm and "does not move, though amouri2019 would" in found.sentence


def test_other_errors_of_a_robot_file_are_not_reported_as_units() -> None:
    robot, data = BENCHES["slender"]
    for path, factor in (("backbone.E", 0.4), ("backbone.E", 2.5), ("length", 1.3)):
        value = factor * (robot.length if path == "length" else robot.segments[0].backbone.E)
        assert not check_tendons(robot.with_({f"segments.0.{path}": value}), data).alarm


def test_elongating_displacements_are_not_reported_as_units() -> None:
    soft = {"segments.0.tendons.compliance": "5 mm/N"}
    data = BENCHES["slender, by displacement"][1]
    displacements = data.displacements + 5e-3 * STAR / 15
    assert not check_tendons(SLENDER.with_(soft), replace(data, displacements=displacements)).alarm


@pytest.mark.parametrize("factor", [1, 10])
def test_displacements_among_tensions_are_checked_too(factor: float) -> None:
    data = made(STUDY, ANY)
    displacements = np.full_like(data.tensions, np.nan)
    displacements[:, 0] = np.linspace(0, 0.03, len(displacements)) * factor
    tensions = data.tensions.copy()
    tensions[:, 0] = np.nan
    found = check_tendons(STUDY, replace(data, tensions=tensions, displacements=displacements))
    assert "some tendons are given by tension and others by displacement" in found.sentence
    assert ("check the unit of the displacements" in found.sentence) == (factor == 10)
    assert found.alarm == (factor == 10)


# -- a constant in the displacements --------------------------------------------------------------


def arcs_of(robot: Robot, shift: ArrayLike) -> Measurements:
    """Exact arcs of constant curvature, displacements with a shift (3,) m: synthetic."""
    tensions = np.concatenate([0.5 * ANY[:7], np.zeros((1, 3))])
    arcs = bs.constant_curvature.RobotArcs.from_tensions(robot, tensions)
    data = made(STUDY, tensions)
    return replace(
        data,
        tensions=np.full_like(tensions, np.nan),
        displacements=robot.length - arcs.lengths() + shift,
        points=arcs.tip.position[:, None],
    )


def test_a_shift_of_all_displacements_is_named() -> None:
    """Constant curvature bends by their differences, and explains all of the motion."""
    assert check_tendons(STUDY, arcs_of(STUDY, 0.0)).found == "as_stated"
    for shift, says in (
        (0.1, r"^The displacements have 100 mm or more in common in all rows, and amouri2019 cann"),
        (-0.1, r"^All tendons are lengthened by \d+\.?\d* mm or more in all rows"),
        (-0.641, r"^All tendons are lengthened by"),  # lengths of the tendons, with a minus
    ):
        found = check_tendons(STUDY, arcs_of(STUDY, shift))
        assert found.found == "unclear" and found.alarm
        assert re.search(says, found.sentence) and "straight robot off all rows" in found.sentence


@pytest.mark.parametrize("zero", [0.0, 2.0])
def test_turned_signs_of_displacements_are_named_before_a_zero(zero: float) -> None:
    """Turned signs lengthen all tendons of a robot whose tendons stretch by what is common."""
    soft = STUDY.with_({"segments.0.tendons.compliance": "0.2 mm/N"})
    data = arcs_of(soft, 0.1)
    found = check_tendons(soft, replace(data, displacements=-data.displacements - zero))
    assert found.alarm and "Write positive: lengthened in the mapping" in found.sentence
    assert found.sentence.startswith("The sign of the displacements looks turned")
    assert ("straight robot off all rows" in found.sentence) == bool(zero)
    # alone they are a base that is turned by half a turn, or that
    exact = arcs_of(STUDY, 0.0)
    half = check_tendons(STUDY, replace(exact, displacements=-exact.displacements))
    assert half.found == "turned" and "if it is not, the sign of the displacements" in half.sentence


def test_the_zero_of_displacements_is_named_in_their_unit() -> None:
    zeros = np.array([2048.0, 1990.0, 2100.0])
    data = arcs_of(STUDY, 2e-5 * zeros)  # counts of 0.02 mm
    columns = tuple(Column(k, f"m{k + 1}", 2e-5) for k in range(3))
    found = check_tendons(STUDY, replace(data, columns=columns))
    assert (
        found.alarm and "The likely zero is 2048 of m1, 1990 of m2 and 2100 of m3" in found.sentence
    )


@pytest.mark.parametrize("zeros", [(5.0, 9.0, 7.0), (12.0, 0.0, 0.0)])
def test_zeros_of_load_cells_are_named(zeros: tuple[float, float, float]) -> None:
    columns = tuple(Column(k, f"F{k + 1}") for k in range(3))
    data = replace(made(STUDY, ANY), tensions=ANY + zeros, columns=columns)
    found = check_tendons(STUDY, data)
    assert found.alarm and not found.remark
    which = "tendons 1, 2 and 3 read" if all(zeros) else "tendon 1 reads"
    assert f"Without load {which} " in found.sentence
    likely = [f"{zero:.4g} of F{k}" for k, zero in enumerate(zeros, 1)]
    assert f"The likely zero is {likely[0]}, {likely[1]} and {likely[2]}: give" in found.sentence


def test_a_pretension_is_no_zero() -> None:
    """It fits worse without; only the same one of all tendons may be either, which is asked."""
    own = check_tendons(STUDY, made(STUDY, ANY + np.array([5.0, 9.0, 7.0])))
    assert not own.alarm and not own.remark
    for data in (made(STUDY, ANY + 5.0), replace(made(STUDY, ANY), tensions=ANY + 5.0)):
        found = check_tendons(STUDY, data)
        assert not found.alarm and found.remark in found.sentence
        assert found.remark.startswith("No tendon comes near zero: tendons 1, 2 and 3 read 5, 5")


def test_a_shift_that_the_robot_follows_is_not_named() -> None:
    for shift in (1e-3, -1e-3):
        assert not check_tendons(STUDY, arcs_of(STUDY, shift)).alarm
    # a tendon is shortened, and the others are not let out
    one = arcs_of(STUDY, 0.0)
    held = np.outer(np.linspace(0.0, 0.06, len(one)), [1.0, 0.0, 0.0])
    assert "in common" not in check_tendons(STUDY, replace(one, displacements=held)).sentence
    # compliant tendons take it up, and soft backbones shorten by it
    for field in ("compliance", "mount_compliance"):
        soft = STUDY.with_({f"segments.0.tendons.{field}": "0.2 mm/N"})
        assert not check_tendons(soft, arcs_of(STUDY, 0.1)).alarm
    rubber = STUDY.with_({"segments.0.backbone.E": "1 MPa", "segments.0.backbone.diameter": 0.04})
    data = arcs_of(STUDY, 0.03)
    shorter = replace(data, points=data.points * (1 - 0.03 / STUDY.length))
    assert not check_tendons(rubber, shorter).alarm
    at_its_place = check_tendons(rubber, data)
    assert at_its_place.alarm
    assert "In line 0 the displacements have 30 mm in common" in at_its_place.sentence
    assert "the tip is where the straight robot has it" in at_its_place.sentence


@pytest.mark.parametrize("shift", [(6, -6, 6, -6), (-1, 9, -1, 9)])
def test_a_shift_that_opposite_tendons_contradict_is_named(shift: tuple[int, ...]) -> None:
    """Its mean is none or hides it; two opposite tendons cannot both be shortened."""
    robot = STUDY.with_({"segments.0.tendons": {"count": 4, "pitch_radius": 0.029}})
    moved = 6e-3 * np.cos(np.linspace(0, 9, 30)[:, None] - robot.tendons.angle_rad)
    moved *= np.linspace(0.2, 1, 30)[:, None]
    arcs = bs.constant_curvature.RobotArcs.from_lengths(robot, STUDY.length - moved)
    none = np.full_like(moved, np.nan)
    data = made(STUDY, np.repeat(PLANE[:1], 30, axis=0))
    data = replace(data, tensions=none, displacements=moved, points=arcs.tip.position[:, None])
    assert not check_tendons(robot, data).alarm
    found = check_tendons(robot, replace(data, displacements=moved + 1e-3 * np.array(shift)))
    assert found.alarm and f"have {max(shift)} mm or more in common" in found.sentence


def test_one_tendon_has_no_shift_of_its_own() -> None:
    single = STUDY.with_({"segments.0.tendons": [{"angle": 0.0, "pitch_radius": 0.029}]})
    data = arcs_of(STUDY, 0.1)
    alone = replace(data, tensions=data.tensions[:, :1], displacements=data.displacements[:, :1])
    assert "in common" not in check_tendons(single, alone).sentence
