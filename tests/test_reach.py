"""What a robot reaches, and how it moves, yields and carries there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.shell import Shell

import bowstring as bs
from bowstring.errors import InputError, NoSolutionError

AMOURI, RAO = bs.load_robot("amouri2019"), bs.load_robot("rao2021")


def test_tips_are_those_of_single_solves_and_within_the_limits() -> None:
    load = bs.Load(gravity=[0.0, 0.0, -9.81], tip_force=[0.02, 0.0, -0.03])
    most = np.array([3.0, 4.0, 5.0, 2.0, 2.5, 3.0])
    found = bs.reach(RAO, most, poses=24, load=load)
    assert (found.tensions >= 0).all() and (found.tensions <= most).all()
    at_limit = (found.tensions == 0) | (found.tensions == most)
    assert at_limit[1::2].mean() > 0.5
    for k in range(0, 24, 5):
        single = bs.solve(RAO, found.tensions[k], load=load)
        assert np.linalg.norm(single.tip.position - found.tip[k]) < 1e-7
        arcs = bs.constant_curvature.RobotArcs.from_tensions(RAO, found.tensions[k])
        np.testing.assert_allclose(arcs.tip.position, found.arc_tip[k], atol=1e-12)


def test_derivatives_are_those_of_single_solves() -> None:
    found = bs.reach(RAO, 3.0, poses=16)
    for k in (3, 7, 9):
        by = bs.jacobians(bs.solve(RAO, found.tensions[k]))
        np.testing.assert_allclose(found.by_share[k], 3.0 * by.tip_position_by_tension, atol=1e-5)
        np.testing.assert_allclose(found.compliance[k], by.tip_position_by_tip_force, atol=1e-3)


def test_compliance_is_symmetric_and_that_of_a_cantilever() -> None:
    """Dead loads have a potential; the straight robot bends by l^3 / (3 E I)."""
    found = bs.reach(AMOURI, 50.0, poses=8)
    turned = found.compliance.transpose(0, 2, 1)
    np.testing.assert_allclose(found.compliance, turned, atol=1e-9)
    straight = found.compliance[0]
    assert (found.tensions[0] == 0).all()
    beam = AMOURI.length**3 / (3.0 * AMOURI.bending_stiffness[0])
    assert straight[0, 0] == pytest.approx(beam, rel=1e-3)
    assert found.softness[0] == pytest.approx(beam, rel=1e-3)


def test_one_segment_moves_alike_in_all_directions_where_it_is_straight() -> None:
    found = bs.reach(AMOURI, 50.0, poses=8)
    assert found.dexterity[0] == pytest.approx(1.0, abs=1e-6)
    # on a surface: along no direction is the tip faster than T l r / (2 E I) times sqrt(3 / 2)
    arm = np.linalg.norm(AMOURI.tendons.mean_hole_m[0, 0])
    speed = 50.0 * arm * AMOURI.length**2 / (2.0 * AMOURI.bending_stiffness[0])
    assert found.manipulability[0] == pytest.approx(1.5 * speed**2, rel=2e-2)


@pytest.mark.parametrize("tendons", [1, 2])
def test_few_tendons_move_the_tip_in_few_directions(tendons: int, tmp_path: Path) -> None:
    found = bs.reach(AMOURI.with_({"segments.0.tendons.count": tendons}), poses=8)
    # two opposite tendons bend in a plane, and shorten the robot by hardly anything
    assert (found.dexterity < 1e-3).all()
    assert tendons == 2 or not found.manipulability.any()
    assert found.save(tmp_path / "plane.png").stat().st_size > 10_000


def test_a_payload_of_zero_has_a_figure(tmp_path: Path) -> None:
    """Below the resolution of the solver any force may move the tip too far."""
    found = bs.reach(AMOURI, poses=16, tolerance=1e-300)
    assert found.save(tmp_path / "zero.png").stat().st_size > 10_000


def test_a_direction_of_any_size_is_one_direction() -> None:
    for size in (1e-310, 1.0, 1e300):
        found = bs.reach(AMOURI, poses=2, payload_direction=[0.0, size, -size])
        np.testing.assert_allclose(found.payload_direction, np.array([0, 1, -1]) / np.sqrt(2))


def test_payload_moves_the_tip_by_the_tolerance() -> None:
    direction = np.array([1.0, 2.0, -2.0]) / 3.0
    found = bs.reach(RAO, 3.0, poses=24, payload_direction=3.0 * direction, tolerance=0.02)
    assert np.isfinite(found.payload).all()
    for tensions, tip, force in zip(found.tensions, found.tip, found.payload, strict=True):
        for factor in (0.5, 1.0):
            load = bs.Load(tip_force=factor * force * direction)
            moved = np.linalg.norm(bs.solve(RAO, tensions, load=load).tip.position - tip)
            limit = 0.02 * RAO.length
            assert moved < limit if factor < 1 else moved == pytest.approx(limit, rel=1e-3)


def test_a_straight_robot_carries_its_buckling_load() -> None:
    found = bs.reach(AMOURI, 50.0, poses=2, tolerance=0.01)
    euler = np.pi**2 * AMOURI.bending_stiffness[0] / (4.0 * AMOURI.length**2)
    assert found.payload_direction.tolist() == [0.0, 0.0, -1.0]
    # a slender robot: shear and extension change it by less than 1 %; just beyond it deflects
    assert found.payload[0] == pytest.approx(euler, rel=0.01)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"max_tension": -1.0}, "above 0 N"),
        ({"poses": 0}, "poses"),
        ({"payload_direction": [0, 0, 0]}, "zero"),
        ({"payload_direction": [0, np.inf, 0]}, "payload_direction"),
        ({"payload_direction": [0, 1]}, "payload_direction"),
        ({"load": bs.Load([1, 0, 0])}, "leave it out"),
        ({"load": bs.Load(tip_force=[0, np.nan, 0])}, "tip force"),
        ({"model": bs.RodModel(tendon_path="continuous")}, "derivatives"),
    ],
)
def test_bad_input_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        bs.reach(AMOURI, **{"poses": 4, **given})


def test_tendons_in_the_body_are_refused() -> None:
    tentacle = bs.load_robot(Path(__file__).parents[1] / "examples" / "tentacle.yaml")
    with pytest.raises(InputError, match="tentacle has such tendons"):
        bs.reach(tentacle, poses=4)


def test_without_equilibria_there_is_no_result() -> None:
    with pytest.raises(NoSolutionError, match="smaller dead loads"):
        bs.reach(AMOURI, poses=2, load=bs.Load(tip_force=[1e6, 0.0, 0.0]))


@pytest.mark.parametrize("function", [bs.reach, bs.control_errors, bs.workspace_map])
def test_tensions_beyond_all_that_the_robot_carries_are_refused_before_work(function: Any) -> None:
    said = "none of 63 poses with tensions up to 40000 N has .*; by the linear law 181 N bends a"
    with pytest.raises(InputError, match=said):
        function(AMOURI, 40000.0, progress=lambda *_: pytest.fail("work began"))


def test_progress_is_that_of_the_work() -> None:
    """Payloads take most of the time."""
    shares: list[float] = []
    bs.reach(AMOURI, 50.0, poses=8, progress=lambda _, share: shares.append(share))
    assert shares == sorted(shares) and shares[0] == 0.0 and shares[-1] == 1.0
    assert np.diff(shares).max() < 0.2 and sum(share > 0.3 for share in shares) > 10


def test_command(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "reach.svg"
    flags = ["--poses", "12", "--payload-direction", "0,1,0", "--out", str(file)]
    found = shell.json("reach", "rao2021", *flags)
    assert file.read_text().startswith("<?xml")
    assert len(found["payload_N"]) == len(found["dexterity"]) == 12
    code, text, _ = shell("reach", "rao2021", *flags)
    assert code == 0 and "simulated" in text
    for bad, says in (("x", "not a number"), ("1 N,0,0", "plain number"), ("0,0", "2 numbers")):
        message = shell.error("reach", "rao2021", "--payload-direction", bad)
        assert message.startswith("--payload-direction: got") and says in message
