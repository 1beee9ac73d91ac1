"""The study's numbers against references of other programs, and its own logic."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import Robot
from bowstring.robot.reader import load_robot
from bowstring.statics import rod
from bowstring.study.actuation_budget import actuation_budget
from bowstring.study.comparison import COMPARISONS, FITS
from bowstring.study.run import run_study
from bowstring.study.settings import Ramp
from bowstring.study.shapes import backbones
from bowstring.study.study import Study
from bowstring.validity.loading import Loading
from stages import Stages

MM = 1e-3
EI = 35e9 * math.pi / 64 * 0.005**4  # of the study's robot, N m^2


# -- the sweeps, and what the paper printed ----------------------------------------------------


def test_the_sweep_matches_the_studys(paper: Study) -> None:
    assert paper.statics.tension == pytest.approx(np.arange(0.0, 81.0, 5.0))
    assert paper.statics.converged.all()
    assert paper.statics.tip_position[-1] / MM == pytest.approx([384.556, 0.0, 444.808], abs=6e-3)


def test_displacement_against_the_linear_law(paper: Study) -> None:
    # delta l = F r^2 l / (E I)
    assert paper.statics.linear_displacement[-1] == pytest.approx(
        80.0 * 0.029**2 * 0.641 / EI, rel=1e-9
    )
    # a span's lever arm grows with the bend, so the actual displacement is larger
    assert paper.statics.displacement[-1] > paper.statics.linear_displacement[-1]
    assert paper.statics.displacement[0] == pytest.approx(0.0, abs=1e-12)


def test_geometric_sweep_matches_eq_5(paper: Study) -> None:
    g = paper.geometry
    length = paper.length
    pull = np.linspace(0.0, 80.0 * 0.029**2 * 0.641 / EI, 17)
    assert g.displacement == pytest.approx(pull, rel=1e-9, abs=1e-15)
    expected = np.column_stack([length - pull, length + pull / 2, length + pull / 2])
    assert g.tendon_lengths == pytest.approx(expected, rel=1e-12)
    theta = pull[1:] / 0.029
    x, z = length * (1 - np.cos(theta)) / theta, length * np.sin(theta) / theta
    assert g.tip_position[1:, 0] == pytest.approx(x, rel=1e-9)
    assert g.tip_position[1:, 2] == pytest.approx(z, rel=1e-9)
    assert g.backbone[:, -1] == pytest.approx(g.tip_position, abs=1e-12)


def test_the_published_mean_stands_beside_the_studys_robot_only(paper: Study) -> None:
    assert paper.claim is not None
    assert "4.95" in paper.claim.text and "published mean" in paper.claim.text
    assert "differs" not in paper.claim.text
    assert Stages(load_robot("amouri2019"), max_tension=40.0).claim() is None
    assert Stages(load_robot("rao2021")).claim() is None
    other = Stages(load_robot("amouri2019"), tendon=2, points=3)
    assert other.settings.max_tension == 80.0 and other.claim() is None


# -- other robots, and settings ----------------------------------------------------------------


def test_two_segments() -> None:
    robot = load_robot("rao2021")
    got = Stages(robot, tendon=4)
    assert got.statics.converged.all()
    # the outer tendon bends both segments
    assert np.all(got.geometry.theta[-1] > 0.1)
    assert got.comparisons["cc_from_lengths"].n == 17
    # no published value: must hold for straight spans in short modules
    assert got.comparisons["cc_from_lengths"].mean < 1e-3 * robot.length
    assert got.comparisons["cc_from_lengths_chord"].mean < 1e-5 * robot.length


@pytest.mark.parametrize("angles", [(0,), (0, 180)])
def test_one_or_two_tendons_have_the_errors_of_three(paper: Study, angles: tuple[int, ...]) -> None:
    """A sweep of the first tendon alone: the others only measure the length."""
    tendons = [{"angle": f"{a} deg", "pitch_radius": "29 mm"} for a in angles]
    got = Stages(load_robot("amouri2019").with_({"segments.0.tendons": tendons}))
    assert got.comparisons["cc_from_force"].mean / MM == pytest.approx(4.423, abs=5e-3)
    mean = got.comparisons["cc_from_lengths"].mean / MM
    if len(angles) == 2:
        assert mean == pytest.approx(0.227, abs=5e-3)
    else:  # a single tendon cannot tell chords from bend
        assert 1.0 < mean < 4.423
    # nor the shortening of a backbone under thrust
    share = 1e-4 if len(angles) == 2 else 1e-3
    assert got.comparisons["cc_from_lengths_chord"].mean < share * got.robot.length


def test_a_segment_where_no_tendon_ends_has_no_arc_from_lengths(paper: Study) -> None:
    outer = {"tendons": {"count": 3, "pitch_radius": 0.029}}
    segment = load_robot("amouri2019").segments[0].model_dump(mode="json", exclude_none=True)
    robot = load_robot("amouri2019").with_(
        {"segments": [{**segment, "tendons": []}, {**segment, **outer}]}
    )
    got = Stages(robot)
    assert got.comparisons["cc_from_lengths"].n == 0
    assert "tendons that end at each segment" in got.judged(paper.budget).meanings[0].text
    assert got.over(paper).to_dict()["comparisons"][0]["mean_mm"] is None


@pytest.mark.parametrize(
    ("stiffness", "tension"), [("35 GPa", 80.0), ("70 GPa", 150.0), ("35 MPa", 0.08)]
)
def test_the_load_range_follows_the_linear_law(stiffness: str, tension: float) -> None:
    robot = load_robot("amouri2019").with_({"segments.0.backbone.E": stiffness})
    assert Stages(robot, points=2).settings.max_tension == tension


def test_the_load_range_in_gravity_matches_statics() -> None:
    hanging = load_robot(Path(__file__).parent / "silicone.yaml")
    got = Stages(hanging, points=2)
    load = got.settings.max_tension
    assert load == 3.0  # the linear law alone would end at 1 N, where the robot bends by 20 degrees
    for tension, bent in ((load, True), (4.0, False)):  # the next round load
        tip = rod.solve(hanging, [tension, 0.0, 0.0]).raise_for_status().tip
        assert tip is not None
        assert (math.degrees(math.acos(tip.rotation[2, 2])) <= 80.0) == bent
    assert any("by statics in gravity" in note for note in got.notes())
    # commanded lengths and geometry end with the robot, not at the linear law's 219 degrees
    assert math.degrees(got.geometry.theta[-1, 0]) == pytest.approx(80.0, abs=1.0)
    assert any("about the robot's own bend" in note for note in got.notes())
    model, tension = got.model, got.statics.tension
    budget = actuation_budget(model, tension, model.case(model.main, tension))
    assert budget.displacement_controlled.problem is None


def test_gravity_that_adds_bend_reduces_the_load_range() -> None:
    upright = load_robot("amouri2019").with_({"gravity": "0 0 -9.81 m/s^2"})
    got = Stages(upright, points=2)
    assert got.settings.max_tension < 80.0
    assert got.geometry.scale == 1.0


def test_any_tendon_or_several_can_be_actuated(paper: Study) -> None:
    robot = load_robot("rao2021")
    inner = Stages(robot, tendon=1, points=3)
    assert inner.settings.tendon == 0 and inner.settings.actuated == "tendon 1"
    assert inner.geometry.theta[-1, 0] > 1.0 and inner.geometry.theta[-1, 1] == pytest.approx(0)
    direct = rod.solve(robot, [inner.settings.max_tension, 0, 0, 0, 0, 0]).raise_for_status().tip
    assert direct is not None
    assert inner.statics.tip_position[-1] == pytest.approx(direct.position, abs=1e-9)

    stages = Stages(robot, tendon={2: 1.0, 4: 0.5}, max_tension=2.0, points=3)
    both = stages.over(paper)
    assert both.settings.actuated == "tendons 2 and 4 (at 0.5 of it)"
    sweep = both.to_dict()["sweep"]
    assert sweep["actuated_tendon"] == 2 and sweep["shares"] == [0, 1, 0, 0.5, 0, 0]
    direct = rod.solve(robot, [0, 2, 0, 1, 0, 0]).raise_for_status().tip
    assert direct is not None
    assert both.statics.tip_position[-1] == pytest.approx(direct.position, abs=1e-9)
    # the linear law's displacement of tendon 2: both segments' bends along its own direction
    ei = 54e9 * math.pi / 64 * 0.0014**4
    own, other = 2.0 * 0.01**2 * 0.2 / ei, 1.0 * 0.01**2 * 0.2 / ei * math.cos(math.radians(120))
    assert both.statics.linear_displacement[-1] == pytest.approx(own + other, rel=1e-9)
    # towards which it bends: between 90 and -30 degrees
    x, y, _ = both.towards
    assert -30.0 < math.degrees(math.atan2(y, x)) < 90.0
    assert both.comparison("cc_from_lengths").mean < 1e-3 * robot.length
    model, tension = stages.model, stages.statics.tension
    budget = actuation_budget(model, tension, model.case(model.main, tension))
    assert budget.row("tendon_elasticity").case.problem is None
    force = next(shape for shape in backbones(both)[1] if shape.name == "cc_from_force")
    error = both.comparison("cc_from_force").error[-1]
    assert force.from_statics[-1] == pytest.approx(error, rel=1e-6)


@pytest.mark.parametrize(
    ("tendon", "words"),
    [
        (0, "tendon is 0, it must be a whole number from 1 to 3"),
        (4, "tendon is 4, it must be"),
        ({1: 0.0}, "share of tendon 1 is 0.0; must be above 0"),
        ({1: 0.5}, "largest share of the actuated tendons is 0.5; must be 1"),
        ({1: 1, 2: 1, 3: 1}, "balance each other"),
        ({}, "largest share"),
    ],
)
def test_bad_tendons(tendon: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        run_study(load_robot("amouri2019"), loading=Loading(tendon=tendon))


def test_tendons_that_balance_each_other_can_be_studied_to_a_given_load(paper: Study) -> None:
    balanced = load_robot("amouri2019")
    got = Stages(balanced, tendon={1: 1, 2: 1, 3: 1}, max_tension=10.0, points=3)
    assert got.comparisons["cc_from_force"].maximum < 1e-4  # shortened alone
    found = replace(got.over(paper), dynamics=got.motion, budget=got.budget, verdict=got.verdict)
    json.dumps(found.to_dict(), allow_nan=False)


def test_a_load_that_rolls_the_robot_up_is_named() -> None:
    soft = load_robot("amouri2019").with_({"segments.0.backbone.E": "35 MPa"})
    with pytest.raises(InputError, match=r"80 N winds amouri2019 up by 220 turns"):
        run_study(soft, loading=Loading(max_tension=80.0))


@pytest.mark.slow
def test_loads_beyond_any_arc_are_in_no_mean(paper: Study) -> None:
    got = Stages(load_robot("amouri2019"), max_tension=900.0)
    lengths = got.comparisons["cc_from_lengths"]
    assert 0 < lengths.n < 17
    assert any(f"over the other {lengths.n}" in note for note in got.notes())
    from_lengths = got.judged(paper.budget).meanings[0]
    (gap,) = from_lengths.undecided
    assert 300.0 < gap[0] < 400.0 and gap[1] == 900.0
    assert not from_lengths.valid_throughout


def test_no_equilibrium_at_all_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    class Failed:
        status = ("max_iterations",) * 17
        converged = np.zeros(17, dtype=bool)

        def message(self, row: int) -> str:
            return f"row {row}: {self.status[row]}."

    def fails(robot: Robot, tensions: object, **options: object) -> Failed:
        return Failed()

    monkeypatch.setattr(rod, "sweep", fails)
    with pytest.raises(NoSolutionError, match="max_iterations"):
        run_study(load_robot("amouri2019"), loading=Loading(tendon=1))


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("tolerance", 0.0),
        ("tolerance", math.nan),
        ("tolerance", 1.5),
        ("max_tension", -1.0),
        ("max_tension", math.inf),
        ("points", 1),
        ("theory", "timoshenko"),
        ("rise", 0.0),
        ("rise", math.inf),
        ("modal_damping", -0.01),
        ("modal_damping", 1.0),
    ],
)
def test_bad_settings(setting: str, value: object) -> None:
    given: Any = {setting: value}
    said = f"{setting} is '?{value if isinstance(value, str) else format(value, 'g')}"
    with pytest.raises(InputError, match=said):
        if setting in ("max_tension", "points"):
            Loading(**given)
        elif setting in ("rise", "modal_damping"):
            Ramp(**given)
        else:
            run_study(load_robot("amouri2019"), **given)


# -- outputs -----------------------------------------------------------------------------------


def test_the_contract(paper: Study) -> None:
    got = paper.to_dict()
    assert {"robot", "length_m", "comparisons", "verdict", "budget", "figures"} <= set(got)
    assert got["robot"] == "amouri2019"
    assert got["length_m"] == pytest.approx(0.641)
    fields = ["name", "against", "n", "mean_mm", "max_mm", "rms_mm", "mean_percent"]
    for c in got["comparisons"]:
        assert list(c) == [*fields, "mean_by_axis_mm"]
        assert len(c["mean_by_axis_mm"]) == 3
    order = [(c["against"], c["name"]) for c in got["comparisons"]]
    assert order == [
        *((a, n) for a in ("statics", "dynamics") for n in COMPARISONS),
        *(("statics", name) for name in FITS),
    ]
    assert all(c["n"] == 17 for c in got["comparisons"])
    for against, errors in (
        ("statics", got["sweep"]["errors_mm"]),
        ("dynamics", got["dynamics"]["errors_mm"]),
    ):
        for name in COMPARISONS:
            assert errors[name] == (paper.comparison(name, against).error * 1e3).tolist()
    assert got["data"] == "simulated" and got["registered"] is False
    assert got["provenance"]["robot_hash"] == paper.robot.hash
    assert json.loads(json.dumps(got, allow_nan=False)) == got


def test_a_study_runs_its_stages_and_reports_progress() -> None:
    """On two modules; other tests run single stages."""
    robot = load_robot("amouri2019").with_(
        {"segments.0.disks.count": 2, "segments.0.length": "140 mm"}
    )
    seen: list[float] = []
    found = run_study(
        robot, progress=lambda what, share: seen.append(share), loading=Loading(points=3)
    )
    assert seen[0] == 0.0 and seen[-1] == 1.0
    assert seen == sorted(seen)
    alone = Stages(robot, points=3)
    motion, without = alone.ramp
    whole = replace(
        alone.over(found),
        dynamics=motion,
        without_dynamics=without,
        comparisons=(
            *alone.comparisons.values(),
            *alone.in_time.values(),
            *alone.shapes.comparisons,
        ),
        budget=alone.budget,
        verdict=alone.verdict,
        notes=alone.notes(alone.in_time),
        claim=alone.claim(alone.in_time),
    )
    assert whole.to_dict() == found.to_dict()
