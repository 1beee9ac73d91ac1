"""The virtual bench: equal to the sweep without disturbances, and with a complete truth.

All data here are synthetic.
"""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import coverage

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.calibration import Fit, fit
from bowstring.data import synthetic
from bowstring.data.measurements import STANDARD_GRAVITY, read_measurements
from bowstring.data.registration import fit_model
from bowstring.data.rigid import Rigid
from bowstring.data.synthetic import STUDY, Bench, check_table, read_truth, set_up, simulate, write
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import Robot
from bowstring.statics import rod
from objects import STUDY_BY_NAME, all_sides, bench, refused, workbook
from shell import Shell

MASSES = np.linspace(0, 8, 17)
CLEAN: dict[str, Any] = {"noise": 0.0, "unload": False}
PLACE = Rigid.from_rotation_vector([0.3, -0.2, 1.0], [0.5, -0.1, 0.2])


@pytest.fixture(scope="module")
def study(robot: bs.Robot) -> Bench:
    return set_up(robot, **STUDY)


# -- without disturbances it equals the sweep ------------------------------------------------------

ONE = [[0.001 * i, None, None] for i in range(5)]
OTHERS = [[None, 1.0, 0.0]] * 5
THREE = np.outer(np.linspace(0, 3e-3, 6), [1, -1, -1, -2, 2, -2, -2, -2, 1])


@pytest.mark.parametrize(
    ("name", "loads", "tensions", "displacements"),
    [
        ("amouri2019", {"tensions": all_sides()}, all_sides(), None),
        (
            "amouri2019",
            {"masses": MASSES, "tendon": 2},
            np.outer(MASSES * STANDARD_GRAVITY, [0, 1, 0]),
            None,
        ),
        ("amouri2019", {"masses": MASSES, "g": 1.62}, np.outer(1.62 * MASSES, [1, 0, 0]), None),
        ("crl-ftdcr-v4", {"displacements": THREE}, None, THREE),
        ("amouri2019", {"tensions": OTHERS, "displacements": ONE}, OTHERS, ONE),
    ],
    ids=["tensions", "masses", "another gravity", "three segments", "mixed"],
)
def test_an_undisturbed_bench_is_the_sweep(
    name: str, loads: dict[str, Any], tensions: Any, displacements: Any
) -> None:
    robot = bs.load_robot(name)
    found = simulate(robot, **bench(**loads, **CLEAN))
    sweep = bs.sweep(robot, tensions, load=bs.Load(displacements=displacements))
    np.testing.assert_array_equal(found.tip, sweep.tip_position)
    for given, kept in ((tensions, found.tensions), (displacements, found.displacements)):
        expected = np.full_like(kept, np.nan) if given is None else np.array(given, float)
        np.testing.assert_array_equal(kept, expected)
    assert found.source == "synthetic" and found.sigma is None
    assert set(found.group) == {""} and set(found.repeat) == {1} and not found.tool.any()


@pytest.mark.parametrize(
    "loads",
    [
        {"masses": MASSES, "friction": 0.1, "repeats": 8},
        {"displacements": np.outer(np.linspace(0, 0.03, 130), [1, -0.5, -0.5])},
    ],
)
def test_progress_changes_no_number(robot: bs.Robot, loads: dict[str, Any]) -> None:
    reported: list[float] = []
    made = set_up(robot, **bench(**loads), progress=reported.append)
    assert len(made.points) > 250 and reported == [100 * k / len(made.points) for k in range(3)]
    without = set_up(robot, **bench(**loads))
    np.testing.assert_array_equal(made.points, without.points)
    np.testing.assert_array_equal(made.tip_rotation, without.tip_rotation)
    assert made.truth == without.truth


def test_a_load_without_solution_is_named_with_progress(robot: bs.Robot) -> None:
    loads = bench(masses=[*np.linspace(0, 8, 150), 1e6], friction=0.1, unload=False)
    with pytest.raises(NoSolutionError, match="1 of 151 loads") as plain:
        set_up(robot, **loads)
    with pytest.raises(NoSolutionError) as reported:
        set_up(robot, **loads, progress=lambda share: None)
    assert str(reported.value) == str(plain.value)


def test_order_of_the_rows(robot: bs.Robot) -> None:
    found = simulate(robot, **bench(masses=[0, 1, 2], repeats=2))
    one_way = [0, 1, 2, 1, 0]
    np.testing.assert_allclose(found.tensions[:, 0] / STANDARD_GRAVITY, one_way * 2)
    assert found.group.tolist() == (["loading"] * 3 + ["unloading"] * 2) * 2
    assert found.repeat.tolist() == [1] * 5 + [2] * 5
    assert len(simulate(robot, **bench(masses=[3]))) == 1
    assert [len(part) for part in simulate(robot, **bench(masses=MASSES)).split().values()] == [
        17,
        16,
    ]


def test_friction_follows_the_path(robot: bs.Robot) -> None:
    """The whole path, with all repeats, is one sweep with its history."""
    made = set_up(robot, **bench(masses=MASSES, friction=0.1, repeats=2, noise=0.0))
    with_friction = robot.with_({"segments.0.tendons.friction": 0.1})
    expected = bs.sweep(with_friction, made.tensions)
    np.testing.assert_array_equal(made.measure().tip, expected.tip_position)
    up, down = made.points[5], made.points[32 - 5]
    assert made.tensions[5, 0] == made.tensions[27, 0]
    assert np.linalg.norm(up - down) > 3e-3  # the same load, another pose
    gap = np.linalg.norm(made.points[:17] - made.points[16:33][::-1], axis=1)
    assert made.hysteresis == pytest.approx(gap.max()) and gap.max() > 0.015
    assert set_up(robot, **bench(masses=MASSES, unload=False)).hysteresis is None
    without = set_up(robot, **bench(masses=MASSES)).hysteresis
    assert without is not None and without < 1e-9
    # a robot whose file has friction keeps it, or loses it on request
    assert set_up(with_friction, **bench(masses=MASSES)).hysteresis == pytest.approx(
        made.hysteresis
    )
    smooth = set_up(with_friction, **bench(masses=MASSES, friction=0.0)).hysteresis
    assert smooth is not None and smooth < 1e-9


# -- disturbances ----------------------------------------------------------------------------------


def test_rows_with_a_period_let_the_robot_relax(robot: bs.Robot, tmp_path: Path) -> None:
    relaxes = {
        "segments.0.backbone.relaxation": 0.2,
        "segments.0.backbone.relaxation_time": 30.0,
    }
    tensions = np.outer(np.linspace(0.0, 40.0, 90), [1.0, 0.0, 0.0])
    given = {"tensions": tensions, "actual": relaxes, "period": 10.0, "noise": 0.0}
    made = set_up(robot, **bench(**given))
    time = 10.0 * np.arange(len(made))
    assert made.time == pytest.approx(time)
    path = np.concatenate([tensions, tensions[-2::-1]])
    direct = bs.sweep(robot.with_(relaxes), path, times=time).tip_position
    assert made.tip_position == pytest.approx(direct, abs=1e-12)
    pieces = set_up(robot, **bench(**given), progress=lambda share: None)
    assert pieces.tip_position == pytest.approx(direct, abs=1e-12)
    assert made.hysteresis is not None and made.hysteresis > 1e-3
    table, _ = write(made.measure(), tmp_path / "relaxing.csv")
    assert read_measurements(table, robot).time == pytest.approx(time)
    assert made.truth["loads"]["period_s"] == 10.0
    with pytest.raises(InputError, match=r"relaxation or creep.*give the loads a period"):
        set_up(robot, **bench(**{**given, "period": None}))
    refused("period is -1", lambda: set_up(robot, **bench(**{**given, "period": -1.0})))


def test_noise_has_the_stated_size(study: Bench) -> None:
    rng = np.random.default_rng(2)
    noise = np.concatenate([study.measure(rng).tip - study.points for _ in range(100)])
    assert len(noise) == 9900
    np.testing.assert_allclose(noise.std(axis=0), 0.02e-3, rtol=0.03)  # of each coordinate
    np.testing.assert_allclose(noise.mean(axis=0), 0.0, atol=4 * 0.02e-3 / math.sqrt(len(noise)))
    apart = np.corrcoef(noise.T)[np.triu_indices(3, 1)]
    assert np.abs(apart).max() < 4 / math.sqrt(len(noise))
    found = study.measure()
    assert found.sigma is not None and set(found.sigma) == {0.02e-3}


def test_a_seed_gives_the_same_bench(robot: bs.Robot, study: Bench) -> None:
    np.testing.assert_array_equal(study.measure(7).points, simulate(robot, seed=7, **STUDY).points)
    assert (study.measure(7).points != study.measure(8).points).all()
    assert (study.measure(None).points != study.measure(None).points).all()
    rng = np.random.default_rng(7)
    np.testing.assert_array_equal(study.measure(rng).points, study.measure(7).points)
    assert (study.measure(rng).points != study.measure(7).points).all()  # the generator advances
    seeds = [study.measure(s).truth for s in (7, None, rng)]
    assert [truth and truth["seed"] for truth in seeds] == [7, None, None]


def test_the_base_is_tilted_and_shifted(robot: bs.Robot) -> None:
    tilt, towards, shift = math.radians(0.3), math.radians(40), [1e-3, -2e-3, 3e-3]
    where = {"tilt": tilt, "tilt_towards": towards, "shift": shift}
    made = set_up(robot, **bench(tensions=all_sides(), **CLEAN, **where))
    back = made.frame.inverse()
    np.testing.assert_allclose(back.translation, shift, atol=1e-12)
    x, y, z = back.rotation[:, 2]
    assert math.atan2(math.hypot(x, y), z) == pytest.approx(tilt, rel=1e-9)
    assert math.atan2(y, x) == pytest.approx(towards, rel=1e-9)
    assert made.truth["tilt_rad"] == pytest.approx(tilt)
    assert made.truth["tilt_towards_rad"] == pytest.approx(towards)
    tips = bs.sweep(robot, all_sides()).tip_position
    np.testing.assert_allclose(made.points, back.apply(tips), atol=1e-15)
    placed = set_up(robot, **bench(tensions=all_sides(), base=PLACE, **CLEAN))
    np.testing.assert_allclose(placed.points, PLACE.apply(tips), atol=1e-15)
    np.testing.assert_allclose(placed.frame.apply(placed.points), tips, atol=1e-15)


def test_a_misplaced_marker(robot: bs.Robot) -> None:
    tool, error = [0.0, 0.0, 8e-3], [1e-3, -2e-3, 0.5e-3]
    made = set_up(
        robot, **bench(tensions=all_sides(), tool=tool, tool_error=error, base=PLACE, **CLEAN)
    )
    assert made.measure().tool.tolist() == tool
    tips = bs.sweep(robot, all_sides())
    found = fit_model(made.points, tips.tip_position, tips.tip_rotation)
    assert found.offset is not None
    np.testing.assert_allclose(found.offset, np.add(tool, error), atol=1e-10)
    np.testing.assert_allclose(made.truth["actual_tool_m"], np.add(tool, error))


def test_the_actual_robot_differs(robot: bs.Robot) -> None:
    path = "segments.0.backbone.E"
    made = set_up(robot, **bench(masses=MASSES, actual={path: "+5 %"}, **CLEAN))
    stiff = robot.with_({path: 1.05 * 35e9})
    assert made.robot is robot and made.actual.hash == stiff.hash != robot.hash
    expected = bs.sweep(stiff, made.tensions).tip_position
    np.testing.assert_array_equal(made.points, expected)
    assert made.truth["differences"] == [{"path": path, "nominal": 35e9, "actual": 1.05 * 35e9}]
    several = {
        "segments[0].disks.clamped_length": "3 mm",
        "segments.*.tendons.pitch_radius": "-1%",
        "segments.0.backbone.G": "13 GPa",
        "gravity": "0 0 -9.81",
    }
    made = set_up(robot, **bench(masses=MASSES, actual=several, friction=0.2, **CLEAN))
    found = {d["path"]: (d["nominal"], d["actual"]) for d in made.truth["differences"]}
    assert found.pop("segments.0.tendons.pitch_radius") == (0.029, pytest.approx(0.029 * 0.99))
    assert found == {
        "gravity.2": (0.0, -9.81),
        "segments.0.backbone.G": (None, 13e9),
        "segments.0.backbone.nu": (0.3, None),
        "segments.0.disks.clamped_length": (0.0, 0.003),
        "segments.0.tendons.friction": (0.0, 0.2),
    }


def test_gravity_rotates_with_the_base_or_stays_vertical(robot: bs.Robot) -> None:
    options = {**CLEAN, "tilt": math.radians(0.3), "gravity": (0, 0, -9.81), "masses": MASSES}
    turning = set_up(robot, **bench(**options))
    plumb = set_up(robot, **bench(gravity_frame="measuring", **options))
    tips = bs.sweep(robot, turning.tensions, load=bs.Load(gravity=(0, 0, -9.81))).tip_position
    np.testing.assert_array_equal(turning.tip_position, tips)
    # tilted towards x, it bends towards x
    felt = 9.81 * np.array([math.sin(math.radians(0.3)), 0, -math.cos(math.radians(0.3))])
    np.testing.assert_allclose(plumb.truth["gravity_in_base_m_per_s2"], felt, atol=1e-15)
    aslant = bs.sweep(robot, turning.tensions, load=bs.Load(gravity=felt)).tip_position
    np.testing.assert_allclose(plumb.tip_position, aslant, atol=1e-12)
    # more than the noise: not negligible
    assert plumb.tip_position[0, 0] - tips[0, 0] == pytest.approx(0.408e-3, abs=1e-6)


def test_disturbances_that_no_model_has(robot: bs.Robot) -> None:
    force, drift = [0.0, 0.05, 0.0], np.array([0.0, 0.4e-3, 0.0])
    tensions = all_sides()
    pushed = set_up(robot, **bench(tensions=tensions, tip_force=force, **CLEAN))
    expected = bs.sweep(robot, tensions, load=bs.Load(tip_force=force)).tip_position
    np.testing.assert_array_equal(pushed.points, expected)
    moved = set_up(robot, **bench(tensions=tensions, drift=drift, base=PLACE, **CLEAN))
    still = set_up(robot, **bench(tensions=tensions, base=PLACE, **CLEAN))
    ramp = np.outer(np.linspace(0, 1, 20), drift)
    np.testing.assert_allclose(moved.points - still.points, ramp, atol=1e-15)
    assert pushed.truth["disturbances"] == {"tip_force_N": force, "drift_m": [0, 0, 0]}
    assert moved.truth["disturbances"]["drift_m"] == drift.tolist()


@pytest.mark.parametrize(
    "disturbance",
    [
        {},
        {"tip_force": [0.0, 0.05, 0.0]},
        {"drift": [0.0, 0.4e-3, 0.0]},
        {"actual": {"segments.0.disks.clamped_length": "1 mm"}},
        {"tool_error": [0.0, 2e-3, 0.0]},
    ],
    ids=lambda options: next(iter(options), "none"),
)
def test_a_disturbance_stays_after_registration(
    robot: bs.Robot, disturbance: dict[str, Any]
) -> None:
    """Registered residuals are noise without a disturbance, and are not with one."""
    predicted = bs.sweep(robot, all_sides(100)).tip_position
    data = simulate(
        robot,
        seed=5,
        **bench(tensions=all_sides(100), unload=False, tilt=math.radians(0.3), **disturbance),
    )
    found = fit_model(data.tip, predicted, sigma=data.sigma)
    chi = float((found.residual**2).sum()) / (0.02e-3) ** 2 / (300 - 6)
    if disturbance:
        assert chi > 2.0
    else:
        assert chi == pytest.approx(1.0, abs=4 * math.sqrt(2 / 294))


def calibrated(robot: bs.Robot, rows: Floats | None = None, **disturbance: Any) -> Fit:
    """Fit to the study's bench with a softer backbone, a displaced base and a disturbance."""
    E, *base = coverage.TRUTH[[0, 2, 3, 4, 5, 6, 7]]
    place = Rigid.from_rotation_vector(np.radians(base[3:]), 1e-3 * np.array(base[:3]))
    study = {k: v for k, v in STUDY_BY_NAME.items() if k != "tilt"} | disturbance
    made = set_up(robot, **bench(**study, base=place, actual={coverage.NAMES[0]: 1e9 * E}))
    known = robot.with_({"gravity": STUDY_BY_NAME["gravity"]})
    return fit(known, made.measure(3), coverage.NAMES, loss="linear", rows=rows)


def test_loading_alone_hardly_separates_friction_and_stiffness(robot: bs.Robot) -> None:
    both, alone = calibrated(robot), calibrated(robot, np.arange(99) % 33 < 17)
    assert alone.correlation[0, 1] == pytest.approx(-0.956, abs=0.02)
    assert both.correlation[0, 1] == pytest.approx(-0.2, abs=0.15)


@pytest.mark.parametrize(
    ("disturbance", "variance", "biased"),
    [
        ({"drift": [0, 0.2e-3, 0]}, 4.1, False),
        ({"tip_force": [0.05, 0, 0]}, 30, True),
        # these two are hidden: a fitted frame compensates them, or stiffness and friction do
        ({"tip_force": [0, 0.01, 0]}, 1.0, False),
        ({"gravity_frame": "measuring"}, 1.15, True),
    ],
    ids=str,
)
def test_calibrated_residuals_reveal_disturbances(
    disturbance: dict[str, Any], variance: float, biased: bool, robot: bs.Robot
) -> None:
    """Residual variance over that of noise, and a stiffness wrong by many standard errors."""
    plain, found = calibrated(robot), calibrated(robot, **disturbance)
    chi = [float((each.residuals**2).sum()) / 0.02e-3**2 / (297 - 8) for each in (plain, found)]
    assert chi == pytest.approx([1.0, variance], rel=0.15)
    error = (found.estimates[0].value - coverage.TRUTH[0]) / plain.estimates[0].standard_error
    assert abs(error) > 15 if biased else abs(error) < 3


def test_full_fits_to_a_few_benches() -> None:
    """`python -m benchmarks.coverage` makes 300; docs/verification/calibration.md has shares."""
    for found in coverage.fits(3, "soft_l1"):
        values = np.array([e.value for e in found.estimates])
        errors = np.array([e.standard_error for e in found.estimates])
        assert (np.abs(values - coverage.TRUTH) < 5 * errors).all()
        assert found.excess == pytest.approx(1.0, abs=0.17)  # 4 / sqrt(2 x 289)
        assert found.message == "Converged."


def test_noise_is_drawn_without_solving_again(
    study: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rod, "sweep", pytest.fail)
    rng = np.random.default_rng(0)
    assert len({study.measure(rng).tip[0, 0] for _ in range(400)}) == 400


def test_the_study(robot: bs.Robot, study: Bench) -> None:
    truth = study.truth
    assert truth["loads"]["masses_kg"] == [0.5 * i for i in range(17)]
    assert (len(study), truth["loads"]["repeats"], truth["noise_m"]) == (99, 3, 0.02e-3)
    (friction,) = truth["differences"]
    assert friction == {"path": "segments.0.tendons.friction", "nominal": 0.0, "actual": 0.1}
    assert truth["tilt_rad"] == pytest.approx(math.radians(0.3))
    assert truth["gravity_in_base_m_per_s2"] == [0, 0, -9.81]


# -- the label and the truth -----------------------------------------------------------------------


def rebuilt(truth: dict[str, Any]) -> Floats:
    """Rebuild the data of a bench of masses from its truth alone."""
    actual = Robot.model_validate(truth["actual_robot"])
    loads = truth["loads"]
    way = [*loads["masses_kg"], *loads["masses_kg"][-2::-1]] if loads["unload"] else [
        *loads["masses_kg"]
    ]  # fmt: skip
    tensions = np.zeros((len(way) * loads["repeats"], len(actual.tendons.angle_rad)))
    tensions[:, loads["tendon"] - 1] = loads["g_m_per_s2"] * np.tile(way, loads["repeats"])
    found = bs.sweep(
        actual,
        tensions,
        load=bs.Load(
            gravity=truth["gravity_in_base_m_per_s2"],
            tip_force=truth["disturbances"]["tip_force_N"],
        ),
        model=bs.RodModel(truth["theory"]),
    )
    base = Rigid(truth["base"]["rotation"], truth["base"]["translation_m"])
    points = base.apply(found.tip_position + found.tip_rotation @ truth["actual_tool_m"])
    points = points + np.outer(np.linspace(0, 1, len(points)), truth["disturbances"]["drift_m"])
    np.testing.assert_allclose(points, truth["rows"]["point_m"], atol=1e-12)
    noise = np.random.default_rng(truth["seed"]).standard_normal(points.shape)
    return np.asarray(points + truth["noise_m"] * noise)


def test_the_truth_is_complete(robot: bs.Robot, tmp_path: Path) -> None:
    data = simulate(
        robot,
        seed=4,
        **bench(
            **{
                **STUDY_BY_NAME,
                "actual": {"segments.0.backbone.E": "-3 %"},
                "gravity_frame": "measuring",
                "tilt_towards": 0.7,
                "shift": [1e-3, 0, 2e-3],
                "tool": [0, 0, 8e-3],
                "tool_error": [1e-3, 0, 0],
                "tip_force": [0, 0.02, 0],
                "drift": [0, 1e-4, 0],
                "theory": "kirchhoff",
            }
        ),
    )
    table, _ = write(data, tmp_path / "bench.csv")
    truth = read_truth(table)
    np.testing.assert_allclose(rebuilt(truth), data.tip, atol=1e-12)
    assert truth["robot_hash"] == robot.hash and truth["source"] == "synthetic"
    frame = Rigid(truth["frame"]["rotation"], truth["frame"]["translation_m"])
    seen = set_up(
        robot,
        **bench(masses=[0], tilt=STUDY_BY_NAME["tilt"], tilt_towards=0.7, shift=[1e-3, 0, 2e-3]),
    )
    np.testing.assert_allclose(frame.rotation, seen.frame.rotation, atol=1e-15)


def test_label_and_truth_survive_the_file(study: Bench, tmp_path: Path) -> None:
    made = study.measure(1)
    table, truth = write(made, tmp_path / "bench.csv")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["bench.csv", "bench.truth.json"]
    found = read_measurements(table, study.robot)
    assert found.source == "synthetic" and found.name == made.name and not found.issues
    np.testing.assert_allclose(found.points, made.points, atol=1e-12)
    np.testing.assert_allclose(found.tensions, made.tensions, rtol=1e-15)
    assert found.group.tolist() == made.group.tolist()
    assert found.repeat.tolist() == made.repeat.tolist()
    np.testing.assert_allclose(found.sigma, made.sigma)  # type: ignore[arg-type]
    content = read_truth(table)
    data = content.pop("data")
    assert data["sha256"] == found.sha256 and data["file"] == "bench.csv"
    assert content == json.loads(json.dumps(made.truth))
    assert json.loads(truth.read_text())["source"] == "synthetic"
    # the table alone contains the truth as well, in a comment
    (line,) = (x for x in table.read_text().splitlines() if x.startswith("# truth: "))
    short = json.loads(line.removeprefix("# truth: "))
    assert short == {k: v for k, v in content.items() if k not in ("rows", "actual_robot")}
    text = table.read_text()
    assert text.startswith("# source: synthetic\n") and "nothing here was measured" in text


def test_the_label_survives_other_programs(study: Bench, tmp_path: Path) -> None:
    """Comments may be dropped, and rows omitted: each row is labelled."""
    table, _ = write(study.measure(1), tmp_path / "bench.csv")
    rows = [x for x in table.read_text().splitlines() if not x.startswith("#")]
    bare = tmp_path / "bare.csv"
    bare.write_text("\n".join([rows[0], *rows[40:50]]) + "\n")
    assert read_measurements(bare).source == "synthetic"
    book = workbook(tmp_path / "bench.xlsx", (row.split(",") for row in rows))
    assert read_measurements(book).source == "synthetic"


def test_label_and_truth_of_a_part(study: Bench) -> None:
    part = study.measure(1).split()["unloading"]
    assert part.source == "synthetic" and part.truth is not None and part.truth["seed"] == 1


def test_noise_free_data_are_labelled(robot: bs.Robot, tmp_path: Path) -> None:
    table, _ = write(simulate(robot, **bench(masses=MASSES, **CLEAN)), tmp_path / "a.csv")
    assert "# There is no noise.\n" in table.read_text()
    assert read_measurements(table).sigma is None


def test_a_bench_is_replaced_and_nothing_else(study: Bench, tmp_path: Path) -> None:
    file = tmp_path / "bench.csv"
    write(study.measure(1), file)
    write(study.measure(2), file)
    assert read_truth(file)["seed"] == 2
    for place, text in (
        (file, "# source: measured\ntension_1_N,tip_x_mm\n"),
        (tmp_path / "bench.truth.json", '{"mine": 1}'),
    ):
        kept = place.read_bytes()
        place.write_text(text)
        with pytest.raises(InputError, match=f"{place.name} is there and was not made by a"):
            write(study.measure(3), file)
        assert place.read_text() == text
        place.write_bytes(kept)
    assert read_truth(file)["seed"] == 2
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("former", [True, False])
@pytest.mark.parametrize("failing", ["the truth", "the table"])
def test_a_bench_is_written_atomically(
    failing: str, former: bool, study: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if former:
        write(study.measure(1), tmp_path / "bench.csv")
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir()}
    write_text, move = Path.write_text, os.replace

    def no_text(self: Path, *arguments: Any) -> int:
        write_text(self, "{")
        raise OSError(28, "No space left on device")

    def no_table(old: Path, new: Path) -> None:
        if Path(new) == tmp_path / "bench.csv":
            raise OSError(28, "No space left on device")
        move(old, new)

    with monkeypatch.context() as patch:
        if failing == "the truth":
            patch.setattr(Path, "write_text", no_text)
        else:
            patch.setattr(os, "replace", no_table)
        with pytest.raises(InputError, match=r"cannot write the bench to .*: No space left on"):
            write(study.measure(2), tmp_path / "bench.csv")
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before
    assert not former or read_truth(tmp_path / "bench.csv")["seed"] == 1


def test_the_truth_of_another_table(study: Bench, tmp_path: Path) -> None:
    file, truth = write(study.measure(1), tmp_path / "bench.csv")
    file.write_text(file.read_text().replace("loading", "Loading"))
    refused(r"truth of another table than .*, or it was changed", lambda: read_truth(file))
    content = json.loads(truth.read_text())
    for text, says in (
        ("{", "is no JSON"),
        ("[]", "is no truth of a virtual bench"),
        (json.dumps({**content, "schema_version": 9}), "has schema_version 9, this version"),
    ):
        truth.write_text(text)
        refused(says, lambda: read_truth(file))
    os.remove(truth)
    refused(r"bench\.truth\.json cannot be read: No such file", lambda: read_truth(file))


def test_measured_data_have_no_truth(tmp_path: Path) -> None:
    found = read_measurements(Path(__file__).parents[1] / "examples" / "bench.csv")
    with pytest.raises(InputError, match="is not of a virtual bench, it has no known truth"):
        write(found, tmp_path / "a.csv")


# -- bad input -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"masses": None}, "there is no load: give tensions or displacements"),
        ({"masses": []}, r"masses is \[\], it must be a list of numbers in kg"),
        ({"masses": "heavy"}, "masses is 'heavy', it must be a list of numbers in kg"),
        ({"masses": [0, -1]}, "masses: number 2 is -1 kg, it must be from 0 to"),
        ({"masses": [1e308]}, "masses: number 1 is 1e.308 kg"),
        ({"masses": [0, math.nan]}, "masses: number 2 is nan kg"),
        ({"tensions": [[1, 0, 0]]}, "masses are given, and tensions or displacements"),
        ({"masses": None, "tensions": [[1, 0]]}, r"tensions has shape \(1, 2\)"),
        ({"masses": None, "tensions": np.zeros((0, 3))}, "the table has no row"),
        ({"masses": None, "tensions": [[-1, 0, 0]]}, "tendon 1"),
        ({"masses": None, "displacements": [[math.inf, 0, 0]]}, "displacement"),
        ({"tendon": 4}, "tendon is 4, it must be a whole number from 1 to 3"),
        ({"tendon": 0}, "tendon is 0"),
        ({"g": 0}, "g is 0 m/s.2, it must be positive"),
        ({"repeats": 0}, "repeats is 0, it must be a whole number from 1"),
        ({"repeats": 1.5}, "repeats is 1.5"),
        ({"repeats": 100_000}, "33 loads 100000 times are 3300000 rows; up to 1000000"),
        ({"unload": 1}, "unload is 1, it must be True or False"),
        ({"noise": -1e-5}, "noise is -1e-05 m, it must be zero or more"),
        ({"noise": math.nan}, "noise is nan m, it must be a finite number"),
        ({"friction": -0.1}, "friction is -0.1, it must be zero or more"),
        ({"friction": 11}, "friction: got 11"),
        ({"actual": "E"}, "actual is 'E', it must be a mapping"),
        ({"actual": {"segments.0.backbone.Em": 1}}, "unknown field; did you mean E"),
        ({"actual": {"segments.1.length": "1 m"}}, "there is no 1 in segments"),
        ({"actual": {"segments.0.backbone.E": "5 %"}}, 'with its sign, as in "\\+5 %"'),
        ({"actual": {"segments.0.backbone.G": "+5 %"}}, "has no number there to take a share of"),
        ({"actual": {"segments.0.backbone": "+5 %"}}, "has no number there to take a share of"),
        ({"actual": {"segments.0.backbone.E": "-100 %"}}, "E: got 0"),
        ({"actual": {"segments.0.tendons.count": 4}}, "has 4 tendons and amouri2019 3"),
        ({"gravity": [0, 0]}, r"gravity has shape \(2,\), it must be \(3,\), in m/s.2"),
        ({"gravity_frame": "world"}, "gravity_frame is 'world', it must be \"base\""),
        ({"tilt": -0.1}, "tilt is -0.1 rad, it must be zero or more"),
        ({"tilt": 4.0}, "tilt is 4 rad, it must be up to pi"),
        ({"tilt_towards": "x"}, "tilt_towards is 'x', it must be a finite number"),
        ({"base": np.eye(4)}, "base is array.*, it must be a Rigid"),
        ({"base": PLACE, "tilt": 0.1}, "give either base, or tilt and shift"),
        ({"shift": [0, 0]}, r"shift has shape \(2,\)"),
        ({"tool": [0, 0, math.nan]}, "tool is .*, all must be finite numbers"),
        ({"shift": [0, 1e308, 0]}, "shift is 1e.308 m, it must be up to 1e.06 m"),
        ({"noise": 1e308}, "noise is 1e.308 m, it must be up to 1e.06 m"),
        ({"tool_error": 1}, r"tool_error has shape \(\)"),
        ({"tip_force": [1, 2]}, r"tip_force has shape \(2,\)"),
        ({"drift": "far"}, "drift is 'far', it must be numbers of shape"),
        ({"theory": "euler"}, "theory"),
    ],
)
def test_bad_input(robot: bs.Robot, options: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        set_up(robot, **bench(**{"masses": MASSES, **options}))
    assert "\n" not in str(caught.value)


def test_more_bad_input(robot: bs.Robot, study: Bench) -> None:
    with pytest.raises(InputError, match="robot is 'amouri2019', it must be a Robot"):
        set_up("amouri2019", **bench(masses=MASSES))  # type: ignore[arg-type]
    for seed in (-1, 1.5, "x", True):
        with pytest.raises(InputError, match=r"seed is .*, it must be a whole number from"):
            study.measure(seed)  # type: ignore[arg-type]
    with pytest.raises(NoSolutionError, match="1 of 3 loads have no solution; the first"):
        simulate(robot, **bench(tensions=[[1, 0, 0], [1e6, 0, 0]]))


def test_the_output_path_is_checked(tmp_path: Path) -> None:
    (tmp_path / "folder.csv").mkdir()
    for name, says in (
        ("bench.xlsx", "a table ends in .csv; name for example bench.csv"),
        ("nowhere/bench.csv", "nowhere does not exist"),
        ("folder.csv", "is no file"),
        ("a\0b.csv", "its name is not valid"),
    ):
        with pytest.raises(InputError, match=f"cannot write the bench to .*{says}"):
            check_table(tmp_path / name)


# -- the command -----------------------------------------------------------------------------------

COMMAND = ("bench", "simulate", "amouri2019", "--out", "bench.csv")
FULL = (
    *(*COMMAND, "--masses", "0:0.5:8", "--tendon", "1", "--repeats", "3", "--seed", "1"),
    *("--noise", "0.02 mm", "--friction", "0.1", "--tilt", "0.3 deg", "--gravity", "0,0,-9.81"),
)


def test_command(shell: Shell, study: Bench, here: Path) -> None:
    said = shell.json(*FULL)
    found = read_measurements(here / "bench.csv")
    made = study.measure(1)
    np.testing.assert_allclose(found.points, made.points, atol=1e-12)
    assert said["source"] == "synthetic" and said["rows"] == 99 and said["repeats"] == 3
    assert said["groups"] == {"loading": 51, "unloading": 48}
    assert said["hysteresis_m"] == pytest.approx(study.hysteresis)
    assert said["truth"].keys() == made.truth.keys()
    for name in ("seed", "differences", "loads", "actual_robot_hash", "noise_m"):
        assert said["truth"][name] == made.truth[name], name
    assert said["files"] == {
        "table": str(here / "bench.csv"),
        "truth": str(here / "bench.truth.json"),
    }
    assert said["robot"] == "amouri2019" and said["provenance"]["settings"]["seed"] == 1
    code, out, err = shell(*FULL)
    assert code == 0 and not err
    assert "amouri2019, virtual bench: synthetic, 99 rows" in out
    assert "Synthetic: not measured." in out
    assert shell.json("bench", "check", "bench.csv")["source"] == "synthetic"


def test_command_with_units(shell: Shell, here: Path) -> None:
    options = {
        "--displacements": '0:2 mm:0.006',
        "--tilt": "0.5 deg,90 deg",
        "--shift": "1 mm,0,0",
        "--tool": "0,0,8 mm",
        "--tool-error": "0,1 mm,0",
        "--tip-force": "0,50 mN,0",
        "--drift": "0,0,0.1 mm",
        "--actual": "segments.0.disks.clamped_length=3 mm",
        "--gravity": "0,0,-9.81 m/s^2",
        "--gravity-frame": "measuring",
        "--noise": "10 um",
        "--set": "segments.0.backbone.E=36 GPa",
    }  # fmt: skip
    truth = shell.json(*COMMAND, "--no-unload", *(x for pair in options.items() for x in pair))[
        "truth"
    ]
    assert truth["tilt_rad"] == pytest.approx(math.radians(0.5))
    assert truth["tilt_towards_rad"] == pytest.approx(math.pi / 2)
    assert truth["base"]["translation_m"] == [0.001, 0, 0]
    assert truth["tool_m"] == [0, 0, 0.008] and truth["actual_tool_m"] == [0, 0.001, 0.008]
    assert truth["disturbances"] == {"tip_force_N": [0, 0.05, 0], "drift_m": [0, 0, 0.0001]}
    assert truth["noise_m"] == 1e-5 and truth["seed"] == 0 and not truth["loads"]["unload"]
    (clamp,) = truth["differences"]
    assert clamp["actual"] == 0.003 and truth["loads"]["by"] == "tensions and displacements"
    found = read_measurements(here / "bench.csv")
    np.testing.assert_allclose(found.displacements[:, 0], [0, 0.002, 0.004, 0.006])
    assert (found.tensions[:, 1:] == 0).all() and found.tool.tolist() == [0, 0, 0.008]
    shell.json(*COMMAND, "--tensions", "10,20,5")
    assert read_measurements(here / "bench.csv").tensions[:, 0].tolist() == [10, 20, 5, 20, 10]
    relaxes = ("--actual", "segments.0.backbone.relaxation=0.2", "--period", "10 s")
    found = shell.json(*COMMAND, "--tensions", "0:10:40", *relaxes)
    assert found["truth"]["loads"]["period_s"] == 10.0
    shell.json(*COMMAND, "--masses", "0:100 g:0.3")
    masses = json.loads((here / "bench.truth.json").read_text())["loads"]["masses_kg"]
    assert masses == [0, 0.1, 0.2, 0.3]


def test_command_without_a_solution(shell: Shell, here: Path) -> None:
    code, out, err = shell(*COMMAND, "--tensions", "10,1e6")
    assert (code, out) == (1, "") and "loads have no solution" in err
    assert not list(here.iterdir())


def test_measured_data_are_never_replaced(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "bench.csv").write_text("mass_1_kg\n1\n")
    monkeypatch.setattr(synthetic, "set_up", pytest.fail)  # it is reported before any work
    assert "--out: cannot write the bench to" in shell.error(*COMMAND, "--masses", "1")
    assert (here / "bench.csv").read_text() == "mass_1_kg\n1\n"
