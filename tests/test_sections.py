"""Backbones that are tapered, or rectangular."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.cad.solid import make_solid
from bowstring.constant_curvature import RobotArcs, curvature_from_loads
from bowstring.robot.designs import Designs

ROOT = Path(__file__).parents[1]
CONE = {"segments.0.backbone.diameter": "6 mm", "segments.0.backbone.end_diameter": "3.5 mm"}
TUBE = CONE | {
    "segments.0.backbone.inner_diameter": "3 mm",
    "segments.0.backbone.end_inner_diameter": "1.5 mm",
}
FLAT = {
    "segments.0.backbone": {
        "width": "10 mm",
        "height": "4 mm",
        "width_direction": "30 deg",
        "E": "35 GPa",
        "nu": 0.3,
        "density": "1800 kg/m^3",
    }
}
WEIGHT = {"gravity": "3 0 -9 m/s^2"}
LOADS = [np.array([12.0, 0.0, 3.0]), np.array([0.0, 25.0, 0.0])]


def robot_with(*changes: dict[str, object]) -> bs.Robot:
    together: dict[str, object] = {}
    for change in changes:
        together |= change
    return bs.load_robot("amouri2019", together)


def test_mean_stiffness_is_that_of_the_mean_flexibility() -> None:
    robot = robot_with(TUBE)
    length, modulus = robot.length, 35e9

    def second(s: float) -> float:
        outer, inner = 6e-3 - 2.5e-3 * s / length, 3e-3 - 1.5e-3 * s / length
        return math.pi / 64.0 * (outer**4 - inner**4)

    flexibility = quad(lambda s: 1.0 / (modulus * second(s)), 0.0, length, epsrel=1e-12)[0]
    assert robot.bending_stiffness[0] == pytest.approx(length / flexibility, rel=1e-10)
    assert robot.bend_by_moment[0] == pytest.approx(np.eye(2) * flexibility, rel=1e-10)
    # the volume of two cones
    volume = (
        math.pi
        / 12.0
        * length
        * sum(
            sign * (a * a + a * b + b * b) for sign, a, b in ((1, 6e-3, 3.5e-3), (-1, 3e-3, 1.5e-3))
        )
    )
    assert robot.mass_per_length[0] * length == pytest.approx(1800.0 * volume, rel=1e-12)


@pytest.mark.parametrize("changes", [CONE, TUBE, FLAT])
def test_the_linear_law_is_the_limit_of_small_tensions(changes: dict[str, object]) -> None:
    """Of a rod whose tendons run beside it everywhere; an arc differs in place, not in angle."""
    robot = robot_with(changes)
    tensions = 1e-3 * LOADS[0]
    arcs = RobotArcs.from_tensions(robot, tensions)
    rod = bs.solve(robot, tensions, model=bs.RodModel("kirchhoff", tendon_path="continuous"))
    tangent, found = rod.tip.rotation[:2, 2], arcs.tip.rotation[..., :2, 2].ravel()
    np.testing.assert_allclose(found, tangent, atol=2e-4 * np.linalg.norm(tangent))
    core = robot.core.arc_tips(Designs(robot, {}), "linear", tensions[None])
    np.testing.assert_allclose(np.ravel(core), arcs.tip.position.ravel(), atol=1e-12)


def test_a_rectangle_bends_to_its_thin_side() -> None:
    """Without the direction of the section, the bend would be towards tendon 1, along x."""
    arcs = RobotArcs.from_tensions(robot_with(FLAT), [10.0, 0.0, 0.0])
    ratio = (10.0 / 4.0) ** 2
    # a moment towards x, in the axes of the section; it bends ratio times more across the width
    along, across = math.cos(math.radians(30.0)), -math.sin(math.radians(30.0)) * ratio
    expected = math.radians(30.0) + math.atan2(across, along)
    assert float(np.ravel(arcs.phi)[0]) == pytest.approx(expected, abs=1e-9)


def test_torsion_constants_of_rectangles() -> None:
    """Timoshenko and Goodier, table of art. 109: J / (long short^3)."""
    for ratio, constant in [(1.0, 0.1406), (2.0, 0.229), (5.0, 0.291), (10.0, 0.312)]:
        sides = {"width": f"{ratio} mm", "height": "1 mm"}
        backbone = robot_with({"segments.0.backbone": FLAT["segments.0.backbone"] | sides})  # type: ignore[operator]
        found = backbone.segments[0].backbone.torsion_constant
        assert found / (ratio * 1e-12) == pytest.approx(constant, abs=6e-4)


def test_princeton_beam() -> None:
    """Experiment of Dowell and Traybar; figures of another geometrically exact code and ANSYS."""
    beam = robot_with(
        {
            "segments.0.length": 0.508,
            "segments.0.disks.mass": 0.0,
            "segments.0.backbone": {
                "width": 12.377e-3,
                "height": 3.2024e-3,
                "width_direction": math.radians(45.0),
                "E": 71.7e9,
                "nu": 0.31,
                "density": 0.0,
            },
        }
    )
    load = bs.Load([0.0, 0.0, 0.0], tip_force=[8.896, 0.0, 0.0])
    x, y, z = bs.solve(beam, load=load).tip.position - [0.0, 0.0, 0.508]
    across, stiff = (x - y) / math.sqrt(2.0), (x + y) / math.sqrt(2.0)
    assert [z, stiff, across] == pytest.approx([-0.0143664, 0.0089529, 0.1089703], abs=1e-4)
    assert [stiff, across] == pytest.approx([0.0088372, 0.1089879], abs=1e-4)


def test_stress_is_that_of_the_local_diameter() -> None:
    robot = robot_with(CONE)
    data = bs.solve(robot, LOADS[0]).to_dataset(points=9)
    fraction = data["arc_length"].to_numpy() / robot.length
    diameter = 6e-3 - 2.5e-3 * fraction
    moment = np.linalg.norm(data["moment"][0, :, :2], axis=-1)
    force = data["force"][0, :, 2].to_numpy()
    expected = 32.0 * moment / (math.pi * diameter**3) + abs(force) * 4 / (math.pi * diameter**2)
    np.testing.assert_allclose(data["normal_stress"][0], expected, rtol=1e-9)
    curvature = np.linalg.norm(data["curvature"][0, :, :2], axis=-1)
    np.testing.assert_allclose(curvature, moment / (35e9 * math.pi / 64.0 * diameter**4), rtol=1e-9)


def test_clamps_of_a_tapered_backbone_have_their_own_weight() -> None:
    """A cantilever in little gravity, by the linear theory of beams."""
    length, clamped, g = 0.3, 0.03, 1e-3
    robot = bs.load_robot(
        "amouri2019",
        {
            "gravity": [g, 0.0, 0.0],
            "segments.0.length": length,
            "segments.0.backbone.diameter": 24e-3,
            "segments.0.backbone.end_diameter": 6e-3,
            "segments.0.backbone.E": 3e6,
            "segments.0.disks": {
                "count": 4,
                "mass": "0 g",
                "radius": "35 mm",
                "thickness": "30 mm",
                "clamped_length": clamped,
            },
        },
    )
    step = length / 200_000
    s = np.arange(step / 2.0, length, step)

    def beyond(each: Floats) -> Floats:
        return (np.flip(np.cumsum(np.flip(each))) - 0.5 * each) * step

    diameter = 24e-3 - 18e-3 * s / length
    moment = beyond(beyond(1800.0 * g * math.pi / 4.0 * diameter**2))
    away = np.abs(s[:, None] - robot.disks.station_m).min(axis=1)
    curvature = np.where(away > clamped / 2.0, moment, 0.0) / (3e6 * math.pi / 64.0 * diameter**4)
    sag = float((curvature * (length - s)).sum() * step)
    found = bs.solve(robot, [0, 0, 0], model=bs.RodModel("kirchhoff", elements=4))
    assert found.tip.position[0] == pytest.approx(sag, rel=1e-5)


def test_a_taper_to_the_same_size_is_none() -> None:
    plain = robot_with(WEIGHT)
    same = robot_with(WEIGHT, {"segments.0.backbone.end_diameter": "5 mm"})
    for tensions in LOADS:
        a, b = (bs.solve(r, tensions) for r in (plain, same))
        np.testing.assert_allclose(a.tip.position, b.tip.position, atol=1e-12)
        assert a.error_estimate.tip == pytest.approx(b.error_estimate.tip, rel=1e-6)
    assert plain.hash != same.hash


def test_the_lever_arm_law_takes_all_sections_that_bend_alike() -> None:
    side = 3e-3
    square = {**FLAT["segments.0.backbone"], "width": side, "height": side}
    round_ = (side**4 / 12.0 * 64.0 / np.pi) ** 0.25  # of the same E I
    arcs = [
        RobotArcs.from_tensions(robot_with(changes), LOADS[0], "arm")
        for changes in (
            {"segments.0.backbone": square},
            {"segments.0.backbone.diameter": round_},
        )
    ]
    assert arcs[0].tip.position == pytest.approx(arcs[1].tip.position, abs=1e-12)


def test_a_study_of_a_rectangular_backbone_has_no_stress() -> None:
    robot = robot_with(FLAT)
    study = bs.run_study(robot, loading=bs.Loading(max_tension=25.0, points=3, tendon=2))
    assert "computed: the section is rectangular" in study.without_surface
    assert study.without_surface in study.notes
    assert np.isnan(study.statics.surface.strain).all()
    tip = bs.solve(robot, LOADS[1]).raise_for_status().tip.position
    assert study.statics.tip_position[-1] == pytest.approx(tip, abs=1e-6)
    law = RobotArcs.from_tensions(robot, LOADS[1]).tip.position
    error = study.comparison("cc_from_force").error[-1]
    assert error == pytest.approx(np.linalg.norm(law - tip), abs=1e-6)
    assert {"straight_spans", "E_minus_10"} < {row.effect for row in study.budget.rows}


@pytest.mark.cad
@pytest.mark.parametrize("changes", [CONE, TUBE])
def test_the_solid_of_a_tapered_backbone_has_its_volume(changes: dict[str, object]) -> None:
    robot = robot_with(changes)
    sections = [robot.segments[0].backbone.at(x) for x in np.linspace(0.0, 1.0, 3)]
    mean = np.array([s.area for s in sections]) @ [1.0, 4.0, 1.0] / 6.0
    for pose in (None, bs.solve(robot, LOADS[0])):
        (rod,) = (p for p in make_solid(robot, pose).parts if p.kind == "backbone")
        assert rod.shape.is_valid
        assert rod.shape.volume == pytest.approx(
            1e9 * mean * robot.length, rel=1e-4
        )  # the tensions compress it


@pytest.mark.parametrize("changes", [CONE, FLAT])
def test_predicted_curvature_knows_the_section(changes: dict[str, object]) -> None:
    """Small tensions: the angle is that of the rod's flexibility as the degree grows."""
    robot = robot_with(changes)
    tensions = 1e-3 * LOADS[0]
    rod = bs.solve(robot, tensions, model=bs.RodModel("kirchhoff", tendon_path="continuous"))
    straight = [0.0, 0.0, robot.length]
    gaps = []
    for degree in range(3):
        found = curvature_from_loads(robot, tensions, degree).tip.position.ravel()
        gaps.append(np.linalg.norm(found - rod.tip.position))
    moved = np.linalg.norm(rod.tip.position - straight)
    assert gaps[2] <= gaps[1] * 1.01 <= gaps[0] * 1.03
    assert gaps[2] < 6e-3 * moved


def test_limits_are_those_of_the_round_segments(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "reference" / "robot-file.md").read_text(encoding="utf-8")
    path = tmp_path / "complete.yaml"
    path.write_text(text.partition("```yaml\n")[2].partition("```")[0], encoding="utf-8")
    robot = bs.load_robot(path)  # a round segment with limits, and a rectangular one
    found = bs.solve(robot, [4.0, 0.0, 0.0, 0.0, 0.0, 0.0]).raise_for_status()
    assert [use.segment for use in found.limits()[1]] == [1, 1]
