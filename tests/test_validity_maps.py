"""Maps of validity: sweeps of designs, contour, causes, states, and the command."""

from __future__ import annotations

import gc
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import bowstring as bs
from bowstring import jobs
from bowstring.constant_curvature import RobotArcs
from bowstring.errors import InputError
from bowstring.jobs import Job
from bowstring.robot.designs import Designs
from bowstring.robot.paths import find, full_paths
from bowstring.robot.writer import to_yaml
from bowstring.statics.design_sweeps import DesignSweep, sweep_designs
from bowstring.validity import design_space, limit_search, workspace
from bowstring.validity.axes import Axis, axes_of, read_axis
from bowstring.validity.contour import contours
from bowstring.validity.effects import Rods
from bowstring.validity.errors import LABELS, Ramps, displacement_per_bend
from bowstring.validity.loading import Loading
from bowstring.validity.map_job import map_job
from bowstring.validity.map_result import STATES
from bowstring.validity.maps import validity_map
from bowstring.validity.multi_axis_maps import compute_grid
from bowstring.validity.sentences import described
from objects import legend_of
from shell import Shell
from stages import Stages

ROBOT = bs.load_robot("amouri2019")
TENSIONS = np.outer(np.linspace(0.0, 80.0, 9), [1.0, 0.0, 0.0])
LENGTHS, FORCE = "cc_from_lengths", "cc_from_force"
COUNT = "segments.0.disks.count"


# -- many robots -------------------------------------------------------------------------------


def test_density_and_drilled_holes_follow_the_design() -> None:
    robot = ROBOT.with_(
        {"segments.0.disks.density": "1200 kg/m^3", "segments.0.disks.hole_diameter": "2 mm"}
    )
    designs = Designs(
        robot, {"segments.0.disks.thickness": [2e-3, 4e-3], "pitch_radius": [0.02, 0.029]}
    )
    for i in range(2):
        own = designs.robot_at(i).disks
        found = designs.disks[i].reshape(-1, 6)
        np.testing.assert_allclose(found[:, 2], own.mass_kg, rtol=1e-13)
        np.testing.assert_allclose(found[:, 3:5], own.inertia_kg_m2, rtol=1e-13)


def test_designs_that_buckle_go_on_from_their_last_pose() -> None:
    """Under its own weight the softest robots have no equilibrium near the straight pose."""
    gravity = bs.Load(gravity=[0.0, 0.0, -9.81])
    designs = Designs(ROBOT, {"segments.0.backbone.E": np.linspace(2e9, 35e9, 12)})
    found = sweep_designs(designs, TENSIONS, load=gravity)
    for i in range(12):
        one = bs.sweep(designs.robot_at(i), TENSIONS, load=gravity, disks=False)
        assert (found.converged[i] == one.converged).all()
        both = np.linalg.norm(found.tip_position[i] - one.tip_position, axis=1)
        assert np.nanmax(both, initial=0.0) < 1e-8


@pytest.mark.parametrize("name", ["amouri2019", "crl-ftdcr-v4"])
def test_arcs_of_designs_are_those_of_each_robot(name: str) -> None:
    robot = bs.load_robot(name)
    count = len(robot.tendons.segment)
    scale = np.array([0.9, 1.0, 1.1])
    designs = Designs(robot, {"segments.*.backbone.E": scale * robot.segments[0].backbone.E})
    rng = np.random.default_rng(4)
    tensions = rng.uniform(0.0, 2.0, (3, 4, count))
    found = sweep_designs(designs, tensions)
    assert found.converged.all()
    for i in range(3):
        one = designs.robot_at(i)
        lengths = found.tendon_lengths[i]
        for law, arcs in (
            ("linear", RobotArcs.from_tensions(one, tensions[i])),
            ("arm", RobotArcs.from_tensions(one, tensions[i], "arm")),
            ("lengths", RobotArcs.from_lengths(one, lengths)),
            ("chords", RobotArcs.from_lengths(one, lengths, "chord")),
        ):
            commands = tensions if law in ("linear", "arm") else found.tendon_lengths
            tips = robot.core.arc_tips(designs, law, commands.reshape(-1, count))
            np.testing.assert_allclose(tips.reshape(3, 4, 3)[i], arcs.tip.position, atol=1e-12)


def test_paths_of_numbers() -> None:
    assert full_paths(ROBOT, "E") == ["segments.0.backbone.E"]
    crl = bs.load_robot("crl-ftdcr-v4")
    assert len(full_paths(crl, "segments.*.backbone.E")) == 3
    lists = bs.load_robot("rao2021")
    every = full_paths(lists, "segments.*.tendons.*.compliance")
    assert len(every) == 6 and full_paths(lists, "segments.*.tendons.compliance") == every
    for path in ("segments.0.tendons.compliance", "segments.0.tendons.*.compliance"):
        assert find(lists, path, ()) == ("segments.0.tendons.*.compliance", tuple(every[:3]))
    with pytest.raises(
        InputError, match=r"not unique; write .*backbone.density or .*disks.density"
    ):
        full_paths(
            ROBOT.with_(
                {"segments.0.disks.density": 1200, "segments.0.disks.hole_diameter": 0.002}
            ),
            "density",
        )
    with pytest.raises(InputError, match="has no number"):
        full_paths(ROBOT, "youngs")


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"segments.0.disks.count": [3, 4]}, "changes the number of disks"),
        ({"segments.0.backbone.E": [1.0, -5.0]}, "must lie between"),
        ({"segments.0.backbone.E": [1e9, float("nan")]}, "not finite"),
        ({"segments.0.disks.clamped_length": [0.0, 0.08]}, "would clamp all"),
        ({"E": [1e9, 2e9], "pitch_radius": [0.02]}, "different length"),
        ({"E": []}, "different length|shape"),
    ],
)
def test_bad_designs_are_refused(values: dict[str, list[float]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Designs(ROBOT, values)


# -- contour -----------------------------------------------------------------------------------


def test_the_contour_of_a_circle_is_a_circle() -> None:
    x = y = np.linspace(-1.0, 1.0, 9)
    calls = []

    def at(points: np.ndarray) -> list[np.ndarray]:
        calls.append(len(points))
        return [np.hypot(points[:, 0], points[:, 1] - 0.1)]

    grid = np.hypot(x[None, :], y[:, None] - 0.1)
    (lines,) = contours(x, y, [grid], 0.6, at).lines
    assert len(lines) == 1
    radius = np.hypot(lines[0][:, 0], lines[0][:, 1] - 0.1)
    assert np.abs(radius - 0.6).max() < 1e-3
    assert sum(calls) < 129 * 129 / 3  # far fewer points than a dense grid


def test_a_function_without_values_somewhere_has_a_contour_elsewhere() -> None:
    x = y = np.linspace(0.0, 1.0, 9)

    def of(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.where(u > 0.8, np.nan, u + 0.1 * v)

    def at(points: np.ndarray) -> list[np.ndarray]:
        return [of(points[:, 0], points[:, 1])]

    (lines,) = contours(x, y, [of(x[None, :], y[:, None] + 0 * x[None, :])], 0.5, at).lines
    assert len(lines) == 1
    assert np.abs(lines[0][:, 0] + 0.1 * lines[0][:, 1] - 0.5).max() < 1e-9


# -- maps --------------------------------------------------------------------------------------


def test_the_crossing_of_the_study() -> None:
    found = validity_map(ROBOT, ["tension=0:80 N:9"])
    assert found.contour[LENGTHS] == []
    (line,) = found.contour[FORCE]
    assert line[0, 0] == pytest.approx(56.09, abs=0.02)
    assert (found.cause[FORCE][1:] == "straight_spans").all()
    assert "from 0 to 56.1 N" in described(found)[1]


def test_values_are_those_of_the_study() -> None:
    robot = ROBOT.with_({"segments.0.disks.clamped_length": "3 mm"})
    comparisons = Stages(robot, max_tension=80.0).comparisons
    found = validity_map(
        ROBOT, [Axis("segments.0.disks.clamped_length", 0.0, 3e-3, 2)], metric="mean_error"
    )
    for name in (LENGTHS, FORCE):
        mean = comparisons[name].mean / robot.length
        assert found.value[name][1] == pytest.approx(mean, rel=1e-6)


@pytest.mark.slow
def test_the_contour_is_that_of_verdicts() -> None:
    """Within 1 % of the axes around 50 points of the line, verdicts over 401 loads differ."""
    top, wide = 8e-3, 0.6
    axes = ["segments.0.disks.clamped_length=0:8 mm:9", "tip_force.x=-0.3:0.3 N:9"]
    found = validity_map(ROBOT, axes, loading=Loading(80.0))
    points = np.concatenate(found.contour[FORCE])
    inside = (points[:, 0] > 0.02 * top) & (np.abs(points[:, 1]) < 0.28)
    chosen = np.random.default_rng(5).choice(points[inside], 50, replace=False)
    for clamp, force in chosen:
        around = [(np.cos(a), np.sin(a)) for a in np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)]
        holds = [valid(clamp + 0.01 * top * u, force + 0.01 * wide * v) for u, v in around]
        assert any(holds) and not all(holds), (clamp, force)


def valid(clamp: float, force: float) -> bool:
    """Whether the error is at most 1 % at each of the 401 loads of a verdict."""
    robot = ROBOT.with_({"segments.0.disks.clamped_length": clamp})
    tensions = np.outer(np.linspace(0.0, 80.0, 401), [1.0, 0.0, 0.0])
    arcs = RobotArcs.from_tensions(robot, tensions).tip.position
    sweep = bs.sweep(robot, tensions, load=bs.Load(tip_force=[force, 0.0, 0.0]), disks=False)
    return bool(np.linalg.norm(arcs - sweep.tip_position, axis=1).max() <= 0.01 * robot.length)


def test_the_validity_limit_of_a_map_is_that_of_the_tension_axis() -> None:
    axis = "segments.0.disks.count=5:12"
    limits = validity_map(ROBOT, [axis], metric="valid_to", loading=Loading(80.0)).value[FORCE]
    for i, count in enumerate(range(5, 13)):
        robot = ROBOT.with_({"segments.0.disks.count": count})
        lines = validity_map(robot, ["tension=0:80 N:41"]).contour[FORCE]
        expected = lines[0][0, 0] if lines else 80.0
        assert limits[i] == pytest.approx(expected, rel=2e-3)


def test_regions_without_equilibrium_and_with_two_are_named() -> None:
    """Upright, a soft robot buckles, and a slightly stiffer one has more than one stable pose."""
    upright = ROBOT.with_({"gravity": [0.0, 0.0, -9.81]})
    soft = validity_map(upright, ["segments.0.backbone.E=0.5:6 GPa:6"], loading=Loading(20.0))
    assert STATES[soft.state[0]] == "not solved" and not soft.unsolved[1:].any()
    assert "1 of 6 points: not solved (at 0.5 GPa)" in " ".join(described(soft))
    pushed = upright.with_({"segments.0.backbone.E": "2 GPa"})
    found = validity_map(pushed, ["tip_force.x=0.8:1 N:3"], loading=Loading(20.0))
    assert 1 in found.state and STATES[1] in " ".join(described(found))


def test_a_dataset_has_labels_and_units() -> None:
    found = validity_map(ROBOT, ["tension=0:80 N:5", "E=30:40 GPa:3"])
    data = found.to_dataset()
    assert data[FORCE].dims == ("axis_2", "axis_1") and data[FORCE].shape == (3, 5)
    assert data["axis_2"].attrs == {"units": "Pa", "long_name": "segments.0.backbone.E"}
    assert "simulated" in data.attrs["source"]
    assert (data.attrs["metric"], data.attrs["max_tension_N"]) == ("error", 80.0)
    assert data.attrs["gravity_m_per_s2"] == data.attrs["tip_force_N"] == [0.0, 0.0, 0.0]
    assert data.attrs["shares"] == [1.0, 0.0, 0.0] and data.attrs["loads"] == 17
    causes = data[f"{FORCE}_cause"].sel(cause_axis_1=80.0)
    assert (causes == "straight_spans").all() and causes.dims == ("cause_axis_2",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing=0:1", "has no number"),
        ("tension", "write PATH=from:to:n"),
        ("tension=0:80 N:1", "must be 2 to"),
        ("tension=5:5 N", "axis tension: its ends must be two different"),
        ("tension=-5:5 N", "can only pull"),
        ("tension=0:80 m", "not a unit of force"),
        ("tension=0:80 N:many", "whole number"),
        ("segments.0.disks.count=2.5:7", "whole numbers"),
        ("tension=0:80 N:100000000", "must be 2 to"),
        ("pitch_radus=20:30 mm", "did you mean pitch_radius"),
        ("young=20:30 GPa", "did you mean E"),
        ("gravity.w=0:1", r"did you mean gravity\.z"),
        ("E=20:50", 'write "20:50 GPa" if that is meant'),
        ("E=20:inf GPa", 'got "inf GPa", which is not a number'),
        ("E=-5:5 GPa", "got -5 GPa; must lie between"),
        ("tendons.count=3:5", "keeps the number of tendons"),
    ],
)
def test_bad_axes_are_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        axes_of(ROBOT, [text])


def coupled() -> bs.Robot:
    stiffness = np.diag([0.44, 0.44, 0.34, 1e4, 1e4, 4e5])
    stiffness[1, 2] = stiffness[2, 1] = 0.1
    removed = dict.fromkeys(("E", "nu", "density", "diameter"))
    changes = {**removed, "stiffness": stiffness.tolist(), "mass_per_length": 0.02}
    return ROBOT.with_({f"segments.0.backbone.{name}": v for name, v in changes.items()})


CLAMPED = ROBOT.with_({"segments.0.disks.clamped_length": "10 mm"})
MAX_CLAMPED = r"axis segments\.0\.disks\.count at 80: "


@pytest.mark.parametrize(
    ("robot", "over", "options", "message"),
    [
        (CLAMPED, ["disks.count=1:80:3"], {}, f"^{MAX_CLAMPED}.*clamped_length: got 10 mm"),
        (CLAMPED, ["E=50:60 GPa", "disks.count=1:80:3"], {}, f"^{MAX_CLAMPED}"),
        (CLAMPED, ["E=50:60 GPa", "length=10 mm:700 mm"], {}, r"^axis \S*length at 10 mm: "),
        (
            CLAMPED,
            ["disks.count=5:40:3", "disks.clamped_length=1:20 mm"],
            {},
            r"^axes segments\.0\.disks\.count at 40 and \S*clamped_length at 20 mm: ",
        ),
        (
            ROBOT,
            ["disks.count=1:100000:3"],
            {},
            r"^axis \S* at 100000: amouri2019 .* at most 10000",
        ),
        (ROBOT.with_({COUNT: 10_001}), ["E=50:60 GPa"], {}, "^amouri2019 has 10001 disks"),
        ("amouri2019", ["E=1:2 GPa"], {}, "robot is 'amouri2019', it must be a Robot"),
        (ROBOT, ["gravity.z=0:1", "gravity.2=0:1"], {}, "two axes are"),
        (ROBOT, ["E=1:2 GPa", "backbone.E=1:2 GPa"], {}, "two axes are"),
        (
            bs.load_robot("crl-ftdcr-v4"),
            ["segments.0.backbone.E=50:60 GPa", "E=50:60 GPa"],
            {},
            r"both have segments\.0\.backbone\.E",
        ),
        # positive definite up to sqrt(0.44 * 0.34) = 0.387
        (
            coupled(),
            ["stiffness.1.2=0:0.388"],
            {},
            "0.388 gives a matrix that is not positive definite.*smaller range",
        ),
        (
            coupled(),
            ["stiffness.1.2=0:0.1", "stiffness.2.1=0:0.1"],
            {},
            "are the same entry of the symmetric stiffness matrix",
        ),
        (ROBOT, ["tension=0:80 N", "bend=0:90 deg"], {}, "one of them"),
        (ROBOT, ["tension=0:40 N", "hole_clearance=0:2 mm"], {}, "changes nothing"),
        (ROBOT, ["bend=-10:90 deg"], {}, "negative bend"),
        (ROBOT, ["bend=0:90"], {}, "0:90 deg"),
        (ROBOT, ["bend=0:90 deg"], {"metric": "valid_to"}, "sweep of the bend"),
        (ROBOT, ["bend=0:90 deg"], {"loading": Loading(50.0)}, "leave it out with bend"),
        (ROBOT, ["tension=0:80 N"], {"models": ["cc_from_displacements"]}, "axis bend"),
        (ROBOT, ["pretension=0:20 N"], {}, "add an axis bend"),
        (ROBOT, ["E=1:2 GPa"], {"metric": "mean"}, "metric"),
        (ROBOT, ["E=1:2 GPa"], {"models": ["cc_from_nothing"]}, "models"),
    ],
)
def test_maps_that_are_refused(
    robot: bs.Robot,
    over: list[str],
    options: dict[str, Any],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(design_space, "follow", lambda *_: pytest.fail("work began"))
    for function in (validity_map, bs.validity_grid):
        with pytest.raises(InputError, match=message):
            function(robot, over, **options)


def test_an_entry_of_a_matrix_is_an_axis_up_to_its_bound() -> None:
    (axis,) = axes_of(coupled(), ["stiffness.1.2=0:0.386"])
    assert axis.values[-1] == pytest.approx(0.386)


def test_the_name_of_a_robot_is_no_robot() -> None:
    for make in (bs.workspace_map, bs.validity_spread):
        with pytest.raises(InputError, match="robot is 'amouri2019', it must be a Robot"):
            make("amouri2019", {})  # type: ignore[operator]


def test_set_takes_the_end_of_a_path_as_an_axis_does(shell: Shell, tmp_path: Path) -> None:
    solve = ("--tension", "40,0,0", "--set")
    short = shell.json("solve", "amouri2019", *solve, "E=40 GPa")
    whole = shell.json("solve", "amouri2019", *solve, "segments.0.backbone.E=40 GPa")
    assert short["tip"] == whole["tip"]
    file = tmp_path / "coupled.yaml"
    file.write_text(to_yaml(coupled()))
    assert shell.json("solve", str(file), *solve, "stiffness.1.2=0")["tip"]["position_m"][
        1
    ] == pytest.approx(0.0, abs=1e-9)
    assert "--set" in shell.error("solve", "amouri2019", *solve, "youngs=40 GPa")


def test_a_wide_range_of_disks_has_few_points() -> None:
    assert len(read_axis("disks.count=3:5000", ROBOT).values) == 41
    assert len(read_axis("disks.count=3:20", ROBOT).values) == 18


def test_listed_disks_have_no_axis_and_the_map_says_so() -> None:
    listed = ROBOT.with_({"segments.0.disks.positions": np.linspace(0.1, 0.641, 6)})
    found = validity_map(listed, loading=Loading(40.0, 5))
    assert [axis.path for axis in found.axes] == ["tension"]
    assert "lists the positions of its disks" in described(found)[0]
    given = validity_map(listed, ["tension=0:40 N:5"])
    assert "positions" not in described(given)[0]


# -- where constant curvature is not defined ----------------------------------------------------


WOUND = ROBOT.with_({"segments.0.disks.count": 6})
"""Above 300 N its tendon lengths ask for an arc of more than a full turn, which there is not."""
NOT_DEFINED = STATES.index("constant curvature not defined")


def test_lengths_of_more_than_a_full_turn_have_no_arc() -> None:
    lengths = bs.sweep(WOUND, np.outer([300.0, 350.0], [1.0, 0.0, 0.0])).tendon_lengths
    assert RobotArcs.from_lengths(WOUND, lengths[0]).theta < 2.0 * np.pi
    with pytest.raises(InputError, match="more than a full turn"):
        RobotArcs.from_lengths(WOUND, lengths[1])


def test_an_undefined_error_is_a_state_of_its_own() -> None:
    found = validity_map(WOUND, ["tension=200:400 N:5"], tolerance=0.05)
    assert np.isnan(found.value[LENGTHS][3:]).all() and np.isfinite(found.value[FORCE]).all()
    assert found.state.tolist() == [0, 0, 0, NOT_DEFINED, NOT_DEFINED]
    assert found.undefined[LENGTHS].tolist() == [False] * 3 + [True] * 2
    assert not found.undefined[FORCE].any()
    said = described(found)
    assert "from lengths holds to 5 % of length from 200 to 317 N" in said[0]
    assert "from lengths is not defined at 2 of 5 points (from 350 to 400 N): no arc" in said[1]
    content = found.to_dict()
    assert content["states"][3] == "constant curvature not defined"
    assert content["maps"][0]["defined"] == [True] * 3 + [False] * 2
    data = found.to_dataset()
    assert data[f"{LENGTHS}_defined"].values.tolist() == [1, 1, 1, 0, 0]
    assert "from lengths: not defined" in legend_of(found.figure().axes[0])


@pytest.mark.parametrize("metric", ["largest_error", "mean_error", "valid_to"])
def test_an_error_that_is_undefined_at_a_load_does_not_hold(metric: str) -> None:
    """A sweep to 400 N passes loads without an arc, also where all errors are within 50 %."""
    axis = "E=33:37 GPa:3"
    found = validity_map(WOUND, [axis], metric=metric, tolerance=0.5, loading=Loading(400.0))
    assert (found.state == NOT_DEFINED).all() and found.undefined[LENGTHS].all()
    if metric == "valid_to":
        assert (found.value[LENGTHS] < 350.0).all() and (found.value[FORCE] == 400.0).all()
        return
    assert np.isnan(found.value[LENGTHS]).all()
    assert "from lengths holds" not in " ".join(described(found))
    assert "from force holds to 50 % of length everywhere" in " ".join(described(found))


def test_a_region_without_an_arc_is_not_white() -> None:
    axes = ["tension=200:400 N:5", "E=34:36 GPa:2"]
    found = validity_map(WOUND, axes, tolerance=0.05, models=[LENGTHS])
    figure = found.figure()
    assert "constant curvature not defined" in key_of(figure)
    (panel,) = figure.axes
    drawn = [c for c in panel.collections if c.get_hatch() == "xxxx"]
    assert len(drawn) == 1 and drawn[0].get_facecolor()[0, 3] == 1.0
    edges = np.concatenate([path.vertices for path in drawn[0].get_paths()])
    assert 300.0 < edges[:, 0].min() < 312.0 and edges[:, 0].max() == 400.0
    assert "from lengths is not defined at 4 of 10 points" in " ".join(described(found))


def test_between_a_value_and_none_the_map_is_not_white() -> None:
    """Between two numbers of disks the hatched region reaches the one that has an error."""
    found = validity_map(ROBOT, ["tension=300:320 N:3", "disks.count=5:7"], models=[LENGTHS])
    assert found.undefined[LENGTHS].any() and not found.undefined[LENGTHS][-1].any()
    (panel,) = found.figure().axes
    drawn = next(c for c in panel.collections if c.get_hatch() == "xxxx")
    last = np.flatnonzero(found.undefined[LENGTHS].any(axis=1)).max()
    top = found.axes[1].values[last + 1]
    edges = np.concatenate([path.vertices for path in drawn.get_paths()])
    assert edges[:, 1].max() == pytest.approx(top, abs=0.01)


# -- sweeps that are not solved to their end ---------------------------------------------------


LOST = [
    (["E=0.01:0.1 GPa:2"], 80.0),  # at every point, at the first load above zero
    (["pitch_radius=20:29 mm:2"], 4000.0),  # at every point, half way
    (["tension=400:2000 N:3"], None),  # at some points
    (["tension=600:1800 N:2", "pitch_radius=20:29 mm:2"], None),
    (["length=500:900 mm:2", "gravity.z=-9.81:9.81:2"], 1200.0),
]
SWEPT = ("largest_error", "mean_error", "valid_to")


def solved_loads(space: design_space.DesignSpace, points: np.ndarray) -> list[np.ndarray]:
    """Tensions of each sweep up to its first load without equilibrium, by single robots."""
    out = []
    for point in points:
        changes, top, loads = {}, space.max_tension, {"gravity": np.zeros(3), "tip_force": None}
        for axis, value in zip(space.axes, point, strict=True):
            name, _, along = axis.path.partition(".")
            if name == "tension":
                top = value
            elif name in loads:
                loads[name] = value * np.eye(3)["xyz".index(along)]
            else:
                changes[axis.path] = value
        tensions = np.linspace(0.0, top, space.loads)
        found = bs.sweep(
            ROBOT.with_(changes), tensions[:, None] * space.shares, load=bs.Load(**loads)
        )
        out.append(tensions[: np.argmin([*found.converged, False])])
    return out


@pytest.mark.usefixtures("coarse")
@pytest.mark.parametrize(
    ("over", "top", "metric"),
    [
        pytest.param(over, top, metric, marks=[pytest.mark.slow] * (len(over) > 1))
        for over, top in LOST
        for metric in (("error",) if over[0].startswith("tension") else SWEPT)
    ],
)
def test_a_sweep_that_is_not_solved_to_its_end_never_holds(
    over: list[str], top: float | None, metric: str
) -> None:
    found = validity_map(ROBOT, over, metric=metric, tolerance=0.5, loading=Loading(top, 7))
    grid = np.meshgrid(*[axis.values for axis in found.axes], indexing="xy")
    points = np.stack([values.ravel() for values in grid], axis=1)
    loads = solved_loads(found.settings.space, points)
    whole = np.reshape([len(one) == 7 for one in loads], found.shape)
    ends = np.reshape([one[-1] for one in loads], found.shape)
    np.testing.assert_allclose(found.solved_to, ends)
    content = found.to_dict()
    said = " ".join(described(found))
    for own in content["maps"]:
        value, defined = np.array(own["values"], dtype=float), np.array(own["defined"])
        if metric == "valid_to":
            assert not (value > ends).any() and not np.isnan(value[defined]).any()
            assert whole[defined & (value == ends)].all()  # others end where they are solved
            continue
        assert np.isnan(value[~whole]).all() and not defined[~whole].any()
        assert not np.isnan(value[defined]).any()
        for low, high in own["ranges"] if len(found.axes) == 1 else []:
            inside = (found.axes[0].values >= low) & (found.axes[0].values <= high)
            assert whole[inside].all()
        if not defined.any():
            assert f"curvature {LABELS[own['name']]} holds" not in said
    if metric != "valid_to":
        assert (found.unsolved == ~whole).all()
        assert f"{(~whole).sum()} of {whole.size} points: not solved" in said
        job = compute_grid(
            map_job(ROBOT, over, metric=metric, tolerance=0.5, loading=Loading(top, 7))
        )
        order = tuple(reversed(range(whole.ndim)))
        assert (job.solved.transpose(order) == whole).all()
        for name in found.value:
            assert (job.defined[name].transpose(order) == found.defined[name]).all()
        held = sum(int((found.value[name] <= 0.5).sum()) for name in found.value)
        shown = [
            int(s.split(" of length at ")[1].split()[0])
            for s in job.described()[:4]
            if " of length at " in s
        ]
        assert sum(shown) == held
        assert f"{(~whole).sum()} of {whole.size} points: not solved" in " ".join(job.described())


def test_where_the_solver_gave_up_is_not_without_equilibrium(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A load at which only an unstable equilibrium was found has no stable one, as far as known."""
    over = ["E=0.01:0.1 GPa:2"]
    gave_up = validity_map(ROBOT, over, loading=Loading(80.0, 5))
    assert {STATES[i] for i in gave_up.state} == {"not solved"}
    assert "2 of 2 points: not solved" in " ".join(described(gave_up))
    assert "no stable equilibrium" not in " ".join(described(gave_up))
    assert "not solved" in legend_of(gave_up.figure().axes[0])
    solve = limit_search.sweep_designs

    def unstable(*arguments: Any, **options: Any) -> DesignSweep:
        found = solve(*arguments, **options)
        return replace(found, status=np.where(found.converged, found.status, "unstable"))

    monkeypatch.setattr(limit_search, "sweep_designs", unstable)
    lost = validity_map(ROBOT, over, loading=Loading(80.0, 5))
    assert {STATES[i] for i in lost.state} == {"no stable equilibrium"}
    assert "2 of 2 points: no stable equilibrium" in " ".join(described(lost))
    assert "no stable equilibrium" in legend_of(lost.figure().axes[0])


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_a_limit_before_the_end_of_what_is_solved_counts_as_solved() -> None:
    """Loads beyond 1000 N, which are not solved, do not matter to a limit of 56 N."""
    options: dict[str, Any] = {"metric": "valid_to", "loading": Loading(1600.0, 33)}
    found = validity_map(ROBOT, ["E=34:36 GPa:2"], models=[FORCE], **options)
    assert not found.unsolved.any() and found.defined[FORCE].all()
    assert (found.solved_to < 1600.0).all()
    assert found.value[FORCE] == pytest.approx(56.09, rel=0.1)
    wide = validity_map(ROBOT, ["E=34:36 GPa:2"], models=[FORCE], tolerance=0.9, **options)
    assert wide.unsolved.all() and not wide.defined[FORCE].any()
    np.testing.assert_array_equal(wide.value[FORCE], wide.solved_to)
    assert "has its last solved load as limit" in " ".join(described(wide))


def test_poses_that_are_not_solved_are_counted_by_why() -> None:
    found = bs.workspace_map(ROBOT, 1500.0, poses=64, models=[FORCE])
    assert (found.unknown == (~found.solved & found.gave_up)).all() and found.unknown.any()
    content = found.to_dict()
    assert content["not_solved"] == found.unknown.sum()
    assert content["without_equilibrium"] + content["not_solved"] == (~found.solved).sum()
    assert f"At {found.unknown.sum()} of the others the solver gave up" in found.described()[1]
    assert f"{found.unknown.sum()} of 64 poses: not solved" in found.figure().get_suptitle()


# -- sentences ----------------------------------------------------------------------------------


def test_all_ranges_of_the_robot_as_it_is_are_named() -> None:
    """The curve from force comes back within 1 % from 860 to 930 N, between two points."""
    wide = "tension=0:1200 N:7"
    found = validity_map(ROBOT, [wide, "disks.count=9:10:2"], models=[FORCE])
    ranges = found.ranges[FORCE]
    assert len(ranges) == 2 and ranges[0] == pytest.approx([0.0, 56.1], abs=0.1)
    for tension in (*ranges[1] + [1.0, -1.0], ranges[1].mean()):
        assert single_error(tension) <= 0.01
    for tension in (*ranges[1] + [-1.0, 1.0], 100.0, 700.0, 1000.0):
        assert single_error(tension) > 0.01
    said = " ".join(described(found))
    assert f"from 0 to 56.1 N and from {ranges[1][0]:.0f} to {ranges[1][1]:.0f} N" in said
    line = validity_map(ROBOT, [wide], models=[FORCE])
    np.testing.assert_allclose(line.ranges[FORCE], ranges, rtol=2e-3)
    assert len(line.value[FORCE]) == 7  # as asked


def single_error(tension: float) -> float:
    """Error of the linear law over the length, by one solve."""
    tip = bs.sweep(ROBOT, np.outer(np.linspace(0.0, tension, 9), [1.0, 0.0, 0.0])).tip_position[-1]
    arc = RobotArcs.from_tensions(ROBOT, np.array([[tension, 0.0, 0.0]])).tip.position[0]
    return float(np.linalg.norm(arc - tip)) / ROBOT.length


def test_a_curve_goes_through_its_marks() -> None:
    found = validity_map(ROBOT, ["tension=0:400 N:3"], models=[FORCE])
    (panel,) = found.figure().axes
    curve, *others = panel.lines
    marks = [one.get_xydata()[0] for one in others if one.get_marker() == "D"]
    assert len(marks) == len(found.contour[FORCE]) > 0
    x, y = curve.get_data()
    for at, percent in marks:
        assert np.interp(at, x, y) == pytest.approx(percent)
    for at in (30.0, 110.0, 333.0):  # between the points that were asked for
        assert np.interp(at, x, y) == pytest.approx(100.0 * single_error(at), abs=0.02)


def test_a_map_that_is_solved_at_one_point_says_so() -> None:
    found = validity_map(ROBOT, ["tension=0:1e9 N:2"], loading=Loading(None, 5), models=[FORCE])
    said = " ".join(described(found))
    assert "at 0 N, the only point with a value" in said
    assert "1 of 2 points: not solved (at 1000000000 N): the solver gave up beyond 0 N" in said


@pytest.mark.usefixtures("coarse")
def test_a_map_that_is_solved_in_a_part_names_their_number() -> None:
    axes = ["tension=0:1e9 N:2", "E=30:40 GPa:2"]
    found = validity_map(ROBOT, axes, loading=Loading(None, 5), models=[LENGTHS])
    assert "at the 2 of 4 points that have a value" in described(found)[0]


def test_limits_below_the_first_load_are_not_stated() -> None:
    """At 1e9 N there is no equilibrium; at a first load of 250 N the error is far outside."""
    far = Loading(1e9, 3)
    none = validity_map(ROBOT, ["E=30:40 GPa:2"], metric="valid_to", loading=far, models=[FORCE])
    assert np.isnan(none.value[FORCE]).all()
    said = " ".join(described(none))
    assert "no validity limit" in said and "smaller largest tension" in said
    assert "holds" not in said
    coarse = Loading(500.0, 3)
    below = validity_map(
        ROBOT, ["E=30:40 GPa:2"], metric="valid_to", loading=coarse, models=[FORCE]
    )
    assert "from force holds to 1 % of length up to less than 250 N" in described(below)[0]
    assert "not resolved" in described(below)[-1]


def test_whole_numbers_are_not_interpolated() -> None:
    found = validity_map(ROBOT, ["disks.count=3:20"], loading=Loading(80.0))
    assert "holds to 1 % of length from 4 disks on" in described(found)[0]
    assert found.contour[LENGTHS] == []
    assert "from lengths: 1 % from 4 disks on" in legend_of(found.figure().axes[0])


def test_the_side_that_holds_is_named() -> None:
    found = validity_map(ROBOT, ["gravity.z=-9.81:9.81"], loading=Loading(80.0))
    for name, words in ((LENGTHS, "from -4.85 to 6.09 m/s^2"), (FORCE, "from 1.48 to 4.2 m/s^2")):
        (ends,) = found.ranges[name]
        middle = validity_map(ROBOT, [f"gravity.z={ends.mean()}:{ends[1] + 0.1}:2"], models=[name])
        assert middle.value[name][0] < 0.01 < middle.value[name][1]
        assert f"{words};" in " ".join(described(found))


def test_the_crossing_of_the_robot_as_it_is() -> None:
    found = validity_map(ROBOT, ["tension=0:80 N:9", "disks.count=7:11:3"])
    assert "part of the map: at the robot's own 9 disks from 0 to 56.1 N" in described(found)[1]
    assert found.ranges[FORCE][0] == pytest.approx([0.0, 56.09], abs=0.05)
    other = validity_map(ROBOT, ["tension=0:80 N:9", "disks.count=10:12"])
    assert other.along is None and "robot's own" not in " ".join(described(other))


def test_bends_with_slack_ask_for_a_pretension() -> None:
    found = validity_map(ROBOT, ["bend=10:90 deg:3", "friction=0:0.3:3"])
    assert (found.state == 3).mean() > 0.5
    said = " ".join(described(found))
    assert "give the tendons a pretension" in said
    assert "tendons run straight between the disks: with commanded bends" in said


def test_friction_has_a_colour_of_its_own() -> None:
    """Also for the colour-blind: seen with two cones it is far from straight spans, as seen."""
    from matplotlib.colors import to_rgb

    from bowstring.validity.figures import CAUSES
    from bowstring.viz.style import LIGHT

    deuteranopia = np.array([[0.625, 0.375, 0.0], [0.7, 0.3, 0.0], [0.0, 0.3, 0.7]])
    friction, spans = (np.array(to_rgb(LIGHT[CAUSES[k]])) for k in ("friction", "straight_spans"))
    assert np.linalg.norm(friction - spans) > 0.8
    assert np.linalg.norm(deuteranopia @ (friction - spans)) > 0.8
    assert list(CAUSES.values()).count(CAUSES["friction"]) == 1


@pytest.mark.parametrize("over", [["tilt=0:180 deg:3"], None])
def test_gravity_of_the_load_is_that_of_the_robot(over: list[str] | None) -> None:
    """The default end of the sweep too: upright, 60 N bend this robot by 80 degrees, not 80 N."""
    upright = [0.0, 0.0, -9.81]
    options: dict[str, Any] = {"models": [LENGTHS], "loading": Loading(None, 5)}
    one = validity_map(ROBOT, over, load=bs.Load(gravity=upright), **options)
    other = validity_map(ROBOT.with_({"gravity": upright}), over, **options)
    assert one.max_tension == other.max_tension != validity_map(ROBOT, ["E=1:2 GPa:2"]).max_tension
    np.testing.assert_allclose(one.value[LENGTHS], other.value[LENGTHS], atol=1e-12)
    if over is not None:
        end = f"The error is the largest of 5 loads from 0 to {one.max_tension:g} N of tendon 1."
        assert end in described(one)
        grid = bs.validity_grid(ROBOT, over, load=bs.Load(gravity=upright), **options)
        assert end in grid.described()


# -- figures -----------------------------------------------------------------------------------


def key_of(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_a_curve_names_its_tendon_and_its_crossing() -> None:
    found = validity_map(ROBOT, ["tension=0:80 N:9"], loading=Loading(80.0, tendon=2))
    (panel,) = found.figure().axes
    assert panel.get_xlabel() == "tension of tendon 2 (N)"
    assert found.to_dict()["axes"][0]["label"] == "tension of tendon 2"
    assert "from force: 1 % at 56.1 N" in legend_of(panel)
    assert not panel.texts  # nothing that could cover a curve


def test_a_map_of_limits_has_the_range_of_the_sweep() -> None:
    axes = ["E=30:40 GPa:3", "clamped_length=0:3 mm:3"]
    found = validity_map(ROBOT, axes, metric="valid_to", loading=Loading(70.0))
    figure = found.figure()
    bars = [panel for panel in figure.axes if "holds up to (N)" in panel.get_ylabel()]
    assert len(bars) == 2
    for bar in bars:
        assert bar.get_ylim() == (0.0, 70.0)
    assert "holds to the end, 70 N" in key_of(figure)


def test_the_colours_of_a_map_end_at_its_line() -> None:
    """The number of disks is not refined, and its cells would step across the line."""
    found = validity_map(ROBOT, ["tension=0:80 N:9", "disks.count=5:12"], models=[FORCE])
    (panel,) = found.figure().axes
    clips = [c.get_clip_path() for c in panel.collections if c.get_clip_path() is not None]
    line = found.contour[FORCE][0]
    edges = [clip.get_fully_transformed_path().vertices for clip in clips]
    drawn = panel.transData.transform(line)
    near = min(
        max(float(np.linalg.norm(edge - point, axis=1).min()) for point in drawn) for edge in edges
    )
    assert near < 1.0  # pixels


def test_labels_of_lines_lie_apart() -> None:
    """All lines run close to each other at the left edge of this range."""
    found = validity_map(ROBOT, ["tension=0:300 N:7", "disks.count=8:20:4"], models=[FORCE])
    figure = found.figure()
    figure.draw_without_rendering()
    (panel,) = figure.axes
    boxes = [text.get_window_extent() for text in panel.texts]
    assert boxes and not any(
        one.overlaps(other) for i, one in enumerate(boxes) for other in boxes[:i]
    )


def test_a_start_takes_the_unit_of_the_end() -> None:
    axis = read_axis("E=20:50 GPa:4", ROBOT)
    assert (axis.start, axis.stop, axis.path) == (20e9, 50e9, "segments.0.backbone.E")
    assert axis.label == "Young's modulus (GPa)"


# -- the command -------------------------------------------------------------------------------


def test_the_command_writes_numbers_and_a_figure(shell: Shell, tmp_path: Path) -> None:
    file, figure = tmp_path / "map.nc", tmp_path / "map.png"
    axes = ("--over", "tension=0:80 N:5", "--over", "E=30:40 GPa:3")
    content = shell.json("map", "amouri2019", *axes, "--out", str(file))
    with xr.open_dataset(file) as data:
        shown = next(m for m in content["maps"] if m["name"] == FORCE)
        np.testing.assert_allclose(100.0 * data[FORCE].values, shown["values"])
        assert data[f"{FORCE}_cause"].values.tolist() == shown["causes"]
        assert data.attrs["metric"] == "error"
    code, out, _ = shell("map", "amouri2019", *axes[:2], "--out", str(figure))
    assert code == 0 and figure.read_bytes()[:4] == b"\x89PNG"
    assert "from 0 to 56.1 N" in out and str(figure) in out


@pytest.mark.parametrize("more", [(), ("--over", "gravity.z=-1:1:2")], ids=["map", "grid"])
def test_the_unit_of_an_axis_is_that_of_its_values(
    shell: Shell, tmp_path: Path, more: tuple[str, ...]
) -> None:
    axes = ("--over", "bend=0:30 deg:2", "--over", "clamped_length=0:2 mm:3", *more)
    out = ("--models", LENGTHS, "--points", "3", "--out", str(tmp_path / "map.nc"))
    bend, clamps, *_ = shell.json("map", "amouri2019", *axes, *out)["axes"]
    assert (bend["label"], bend["unit"]) == ("commanded bend", "rad")
    assert bend["values"] == pytest.approx([0.0, np.radians(30.0)])
    assert (clamps["label"], clamps["unit"]) == ("clamped length", "m")
    assert clamps["values"] == pytest.approx([0.0, 0.001, 0.002])


def test_a_range_beyond_what_the_robot_carries_is_warned_of_at_once(
    shell: Shell, tmp_path: Path
) -> None:
    out = ("--points", "5", "--models", FORCE, "--out", str(tmp_path / "map.svg"))
    said = shell("map", "amouri2019", "--over", "tension=0:3 kN:2", *out)[2]
    reached = float(said.split("solved up to about ")[1].split()[0])
    whole = bs.sweep(ROBOT, np.outer(np.linspace(0.0, 3000.0, 65), [1.0, 0.0, 0.0])).converged
    assert reached == pytest.approx(3000.0 * (np.argmin(whole) - 1) / 64, abs=100.0)
    assert "of 3000 N, and loads beyond take long; give a smaller range" in said
    assert shell("map", "amouri2019", "--over", "tension=0:80 N:2", *out)[2] == ""


# -- the workspace -----------------------------------------------------------------------------


def test_the_workspace_has_the_errors_of_each_pose(tmp_path: Path) -> None:
    found = bs.workspace_map(ROBOT, 40.0, poses=64)
    for i in (1, 17, 63):
        one = bs.solve(ROBOT, found.tensions[i])
        arc = RobotArcs.from_tensions(ROBOT, found.tensions[i]).tip.position
        np.testing.assert_allclose(found.tip[i], one.tip.position, atol=1e-9)
        assert found.error[FORCE][i] == pytest.approx(np.linalg.norm(arc - one.tip.position))
    assert found.tensions.max() < 40.0 and found.share_valid(LENGTHS) == 1.0
    assert found.save(tmp_path / "map.svg").exists()


def test_the_workspace_has_tensions_and_theory_of_its_own() -> None:
    model = bs.RodModel("kirchhoff")
    most = [40.0, 20.0, 10.0]
    found = bs.workspace_map(ROBOT, most, poses=64, models=[FORCE], model=model)
    assert (found.tensions.max(axis=0) > 0.9 * np.array(most)).all()
    assert (found.tensions <= most).all() and "10 to 40 N in each" in found.described()[0]
    tip = bs.solve(ROBOT, found.tensions[17], model=model).tip.position
    np.testing.assert_allclose(found.tip[17], tip, atol=1e-9)
    assert "shear" not in found.cause[FORCE]


def test_the_command_has_as_many_poses_as_asked_for(shell: Shell, tmp_path: Path) -> None:
    args = ("reach", "amouri2019", "--errors", "--max-tension", "40", "--poses")
    content = shell.json(*args, "33", "--out", str(tmp_path / "map.svg"))
    assert len(content["tip_position_m"]) == len(content["tensions_N"]) == 33
    assert content["provenance"]["settings"]["poses"] == 33
    (one,) = shell.json(*args, "1", "--out", str(tmp_path / "map.svg"))["tip_position_m"]
    assert one == pytest.approx([0.0, 0.0, 0.641])


def test_a_workspace_that_holds_everywhere_says_so_instead_of_causes() -> None:
    found = bs.workspace_map(ROBOT, 20.0, poses=64, models=[FORCE])
    figure = found.figure()
    figure.draw_without_rendering()
    errors, causes = figure.axes[:2]
    assert [text.get_text() for text in causes.texts] == ["holds to 1 % at all poses"]
    assert not any(len(c.get_offsets()) for c in causes.collections)
    assert causes.get_position().width == pytest.approx(errors.get_position().width, abs=1e-3)


def test_hexagons_of_the_workspace_lie_within_the_figure() -> None:
    found = bs.workspace_map(ROBOT, 80.0, poses=256, models=[FORCE])
    figure = found.figure()
    figure.draw_without_rendering()
    for panel in figure.axes[:2]:
        (cells,) = panel.collections
        inside = panel.get_window_extent()
        shape = cells.get_paths()[0].vertices  # of the first hexagon, about its centre
        reach = np.abs(panel.transData.transform(shape) - panel.transData.transform((0, 0)))
        places = panel.transData.transform(cells.get_offsets())
        low, high = places.min(axis=0) - reach.max(axis=0), places.max(axis=0) + reach.max(axis=0)
        assert (low >= (inside.x0, inside.y0)).all() and (high <= (inside.x1, inside.y1)).all()


def test_poses_without_a_result_are_counted(tmp_path: Path) -> None:
    found = bs.workspace_map(ROBOT, 400.0, poses=256)
    without = found.undefined(LENGTHS)
    assert 0 < without.sum() < 128 and not found.undefined(FORCE).any()
    said = " ".join(found.described())
    assert f"from lengths is not defined at {without.sum()} of 256 poses: no arc" in said
    error = found.error[LENGTHS][~without] / ROBOT.length
    assert found.share_valid(LENGTHS) == pytest.approx((error <= 0.01).sum() / 256)
    content = found.to_dict()
    assert content["errors"][0]["not_defined"] == without.sum()
    assert {"constant curvature not defined", "holds to 1 %"} <= set(key_of(found.figure()))
    # the second half of the poses has no equilibrium
    tip = np.where(np.arange(256)[:, None] < 128, found.tip, np.nan)
    error = {name: np.where(np.arange(256) < 128, e, np.nan) for name, e in found.error.items()}
    half = replace(found, tip=tip, error=error)
    assert "128 of 256 poses" in half.described()[0] and "other 128" in half.described()[0]
    assert half.to_dict()["without_equilibrium"] == 128
    assert half.undefined(LENGTHS).sum() == without[:128].sum()
    assert "128 of 256 poses: no stable equilibrium" in half.figure().get_suptitle()


def test_the_workspace_has_the_causes_of_a_map() -> None:
    """In gravity; the causes at poses of one tendon are those of a map over its tension."""
    robot = ROBOT.with_({"gravity": [1.0, 0.0, 0.0], "segments.0.disks.clamped_length": "3 mm"})
    poses = bs.workspace_map(robot, 80.0, poses=64)
    i = int(np.argmax(poses.tensions[:, 0] - 2.0 * poses.tensions[:, 1:].sum(axis=1)))
    shares = {k + 1: float(t / poses.tensions[i].max()) for k, t in enumerate(poses.tensions[i])}
    loading = Loading(80.0, tendon={k: share for k, share in shares.items() if share})
    end = poses.tensions[i].max()
    line = validity_map(robot, [f"tension={0.5 * end}:{end}:2"], loading=loading)
    for name in (LENGTHS, FORCE):
        assert line.value[name][-1] * robot.length == pytest.approx(poses.error[name][i], rel=1e-6)
        assert line.cause[name][-1] == poses.cause[name][i] != ""
    assert "main cause of the error: gravity" in " ".join(poses.described())


def test_poses_without_an_equilibrium_are_not_solved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """A pose without one takes as long as several with one."""
    solved: list[int] = []
    real = workspace._poses

    def poses(rods: Any, tensions: Any) -> Any:
        solved.append(len(tensions))
        return real(rods, tensions)

    monkeypatch.setattr(workspace, "_poses", poses)
    found = bs.workspace_map(ROBOT, 1500.0, poses=64, models=[FORCE])
    assert solved[0] == 64 and set(solved[1:]) == {int(found.solved.sum())} != {64}
    assert np.isfinite(found.error[FORCE][found.solved]).all()
    assert np.isnan(found.error[FORCE][~found.solved]).all()


def test_second_equilibria_of_the_workspace_are_those_of_its_branches() -> None:
    """Upright and pushed aside, the robot has a second stable pose at some tensions."""
    load = bs.Load(tip_force=[0.9, 0.0, 0.0], gravity=[0.0, 0.0, -9.81])
    robot = ROBOT.with_({"gravity": [0.0, 0.0, -9.81], "segments.0.backbone.E": "2 GPa"})
    found = bs.workspace_map(robot, 20.0, poses=64, models=[FORCE], load=load)
    two = np.flatnonzero(found.two_equilibria)
    assert two.size and f"{two.size} of them ha" in found.described()[1]
    assert found.to_dict()["two_equilibria"] == found.two_equilibria.tolist()
    light = bs.Load(gravity=[0.0, 0.0, 0.0])
    for i in [*two, 20, 40]:
        pull = load.replace(tensions=found.tensions[i])
        diagram = bs.branch_diagram(robot, load=pull, start=light)
        stable = sum(diagram.branches[b].stable[k] is True for b, k in diagram.equilibria())
        assert stable == (2 if i in two else 1)
    assert "pose: two equilibria, the robot may snap through" in key_of(found.figure())


def test_progress_of_the_workspace_is_that_of_its_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """A part may have room for more poses than there are."""
    robot = ROBOT.with_({"gravity": [1.0, 0.0, 0.0]})
    for part, poses in ((16384, 32), (24, 32)):
        monkeypatch.setattr(workspace, "_PART", part)
        shares: list[float] = []
        bs.workspace_map(
            robot, 40.0, poses=poses, progress=lambda _, at, own=shares: own.append(at)
        )
        assert shares == sorted(shares) and shares[-1] == 1.0
        assert max(shares[:-1]) < 0.99 and len(set(shares)) == len(shares)


@pytest.mark.parametrize("error", [0.0, 0.2])
def test_rings_of_second_equilibria_are_seen_on_every_colour(error: float) -> None:
    """The ring is dark, with a bright edge on both sides."""
    found = bs.workspace_map(ROBOT, 40.0, poses=64, models=[FORCE])
    same = {FORCE: np.full(64, error * ROBOT.length)}
    ringed = replace(found, error=same, two_equilibria=np.arange(64) == 40)
    shown = []
    for each in (replace(ringed, two_equilibria=np.zeros(64, bool)), ringed):
        figure = each.figure()
        figure.set_dpi(200)
        canvas = FigureCanvasAgg(figure)
        canvas.draw()
        image = np.asarray(canvas.buffer_rgba())[..., :3] / 255.0
        panel = figure.axes[0]
        x, y = panel.transData.transform(1e3 * found.tip[40, :2])
        row, column = image.shape[0] - 1 - round(y), round(x)
        shown.append(image[row - 12 : row + 13, column - 12 : column + 13])
    before, after = shown
    changed = np.abs(after - before).max(axis=-1) > 0.1
    light = after.min(axis=-1)
    ground = before[12, 12].max()
    assert (light[changed] < 0.35).sum() > 20
    if ground < 0.9:
        assert (light[changed] > 0.9).sum() > 20


def test_holes_with_planes_have_a_colour() -> None:
    robot = ROBOT.with_({"segments.0.disks.hole_length": "10 mm"})
    found = validity_map(robot, ["tension=0:80 N:3", "E=30:40 GPa:2"], models=[FORCE])
    cause = {FORCE: np.full_like(found.cause[FORCE], "hole_planes")}
    label = "mainly entry and exit planes of the holes"
    assert label in key_of(replace(found, cause=cause).figure())
    poses = bs.workspace_map(robot, 80.0, poses=64, models=[FORCE])
    cause = {FORCE: np.full(64, "hole_planes")}
    assert label in key_of(replace(poses, cause=cause, tolerance=1e-5).figure())


# -- beyond the largest load -------------------------------------------------------------------


def beyond(robots: Designs, top: float) -> tuple[Rods, np.ndarray]:
    ends = np.linspace(0.1, 1.0, len(robots)) * top
    ramps = ends[:, None, None] * np.linspace(0.0, 1.0, 9)[:, None] * [1.0, 0.0, 0.0]
    return Rods(robots, bs.RodModel(), bs.Load(gravity=[0.3, 0.0, -9.81])), ramps


@pytest.mark.parametrize("top", [80.0, 4000.0])
def test_loads_up_to_the_last_equilibrium_are_those_of_a_whole_ramp(top: float) -> None:
    robots = Designs(ROBOT, {"segments.0.backbone.E": np.linspace(20e9, 60e9, 12)})
    rods, ramps = beyond(robots, top)
    found = limit_search.solve_ramps(rods, ramps)
    whole = sweep_designs(rods.designs, ramps, load=rods.load)
    assert (found.converged == whole.converged).all()
    assert found.converged.all() == (top == 80.0)
    for name in ("tip_position", "tendon_lengths", "tip_error"):
        own = getattr(found, name.removesuffix("_position"))
        # a robot beside others in lanes differs by rounding
        np.testing.assert_allclose(own, getattr(whole, name), rtol=1e-6, atol=1e-11)


def test_few_loads_without_equilibrium_are_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two of each ramp: its first one without equilibrium, and its end."""
    robots = Designs(ROBOT, {"segments.0.backbone.E": np.linspace(30e9, 40e9, 8)})
    rods, ramps = beyond(robots, 8000.0)
    ramps[:] = ramps[-1]
    failed = []

    def counted(designs: Designs, tensions: np.ndarray, **options: Any) -> DesignSweep:
        found = sweep_designs(designs, tensions, **options)
        if options["model"].elements is None:
            failed.append((~found.converged).sum())
        return found

    monkeypatch.setattr(limit_search, "sweep_designs", counted)
    found = limit_search.solve_ramps(rods, ramps)
    assert (~found.converged).sum() > 6 * len(robots)
    assert sum(failed) <= 3 * len(robots)


# -- in blocks ---------------------------------------------------------------------------------


def test_a_map_in_blocks_is_the_same_map(tmp_path: Path) -> None:
    axes = ["E=30:40 GPa:4", "pitch_radius=20:30 mm:5", "gravity.z=-2:2:3"]
    job = map_job(ROBOT, axes, loading=Loading(60.0), block=7)
    store = jobs.run(job, tmp_path / "blocks")
    with xr.open_dataset(store.save(tmp_path / "map.nc")) as data:
        assert dict(data.sizes) == {"axis_1": 4, "axis_2": 5, "axis_3": 3}
        plane = validity_map(
            ROBOT, axes[:2], loading=Loading(60.0), load=bs.Load(gravity=[0.0, 0.0, 2.0])
        )
        found = data[FORCE].sel(axis_3=2.0).values.T
        np.testing.assert_allclose(found, plane.value[FORCE], rtol=1e-7)
        assert data.axis_2.attrs["units"] == "m" and (data.solved == 1).all()


def test_the_command_computes_in_blocks(shell: Shell, tmp_path: Path) -> None:
    axes = ("E=30:40 GPa:4", "nu=0:0.4:3", "length=0.6:0.7:2")
    over = [text for axis in axes for text in ("--over", axis)]
    args = ("map", "amouri2019", *over, "--store", str(tmp_path / "blocks"))
    for _ in range(2):  # the second time all blocks are there
        content = shell.json(*args, "--out", str(tmp_path / "map.nc"))
        assert (content["points"], content["blocks"]) == (24, 24)
        assert "from force holds to 1 % of length at " in content["text"][1]
    said = shell(*args, "--out", str(tmp_path / "map.nc"))[1]
    assert said.splitlines()[: len(content["text"])] == content["text"]
    to_file = ("--out", str(tmp_path / "other.nc"))
    assert "tolerance" in shell.error(*args, *to_file, "--tolerance", "2 %")
    figure = tmp_path / "map.png"
    assert shell.json(*args, "--out", str(figure))["file"] == str(figure)
    assert figure.read_bytes()[:4] == b"\x89PNG"
    assert "must end in" in shell.error(*args, "--out", str(tmp_path / "map.txt"))
    many = ["--over", "E=1:2 GPa:1001", "--over", "nu=0:0.4:1001", "--over", "length=1:2:1001"]
    too = shell.error("map", "amouri2019", *many, "--store", str(tmp_path / "other"))
    assert "at most" in too and not (tmp_path / "other").exists()


def test_many_points_in_memory_are_warned_of(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bowstring.cli.map._MANY", 5)
    args = ("map", "amouri2019", "--over", "E=30:40 GPa:3", "--points", "3")
    out = ("--out", str(tmp_path / "map.png"))
    assert shell(*args, *out)[2] == ""
    warned = shell(*args, "--over", "nu=0:0.4:2", *out)[2]
    (line,) = warned.splitlines()
    assert line.startswith("Warning: 6 points are computed in memory") and "--store DIR" in line


def test_ctrl_c_names_the_blocks_that_are_kept(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    compute, done = Job.compute, []

    def stopping(job: Job, number: int) -> bytes:
        if len(done) == 2:
            raise KeyboardInterrupt
        done.append(number)
        return compute(job, number)

    folder, file = tmp_path / "blocks", tmp_path / "map.nc"
    axes = ("--over", "E=30:40 GPa:3", "--over", "nu=0:0.4:2")
    args = ("map", "amouri2019", *axes, "--store", str(folder), "--out", str(file))
    monkeypatch.setattr(Job, "compute", stopping)
    code, out, err = shell(*args)
    assert (code, out) == (130, "") and not file.exists()
    assert f"2 of 6 blocks are kept in {folder}" in err and "same command" in err
    assert done == [0, 1]
    monkeypatch.setattr(Job, "compute", compute)
    found = shell.json(*args)
    assert found["blocks"] == 6 and file.exists()


def test_an_address_without_a_port_is_refused_at_once(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("distributed")
    args = ("map", "amouri2019", "--over", "E=30:40 GPa:3", "--store", str(tmp_path / "blocks"))
    began = time.monotonic()
    said = shell.error(*args, "--out", str(tmp_path / "map.nc"), "--dask", "nonsense")
    gc.collect()  # a Client of this address would wait for 20 s when it is deleted
    assert "cannot connect" in said and time.monotonic() - began < 5.0
    assert not (tmp_path / "blocks").exists()


# -- friction and commanded bends ----------------------------------------------------------------


ELASTIC = ROBOT.with_(
    {"segments.0.tendons.axial_stiffness": 3e4, "segments.0.tendons.pretension": 5.0}
)


def test_a_map_over_friction_follows_paths() -> None:
    found = validity_map(ROBOT, ["tension=20:80 N:3", "friction=0:0.3:3"], loading=Loading(None, 9))
    for i, friction in enumerate((0.0, 0.15, 0.3)):
        for k, top in enumerate((20.0, 50.0, 80.0)):
            tensions = np.outer(np.linspace(0.0, top, 9), [1.0, 0.0, 0.0])
            path = bs.sweep(ROBOT.with_({"segments.0.tendons.friction": friction}), tensions)
            arc = RobotArcs.from_tensions(ROBOT, tensions[-1]).tip.position
            error = np.linalg.norm(arc - path.tip_position[-1]) / ROBOT.length
            assert found.value[FORCE][i, k] == pytest.approx(error, abs=1e-9)
    assert found.cause[LENGTHS][2, 2] == "friction"
    assert found.cause[FORCE][0, 2] == "straight_spans"
    assert set(np.unique(found.state)) == {0}


@pytest.mark.parametrize("friction", [False, True], ids=["free", "friction"])
@pytest.mark.parametrize(
    ("make", "metric"),
    [(validity_map, "valid_to"), (bs.validity_grid, "largest_error")],  # neither refines a line
    ids=["map", "grid"],
)
def test_causes_need_no_rod_twice(
    make: Callable[..., object], metric: str, friction: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With friction, straight spans need the tips of the whole rods too, which maps leave out."""
    solved: Counter[tuple[object, ...]] = Counter()
    follow = design_space.follow

    def counted(rods: Rods, ramp: np.ndarray, shares: np.ndarray) -> Ramps:
        if ramp.shape[1] > 1:  # no search of a second equilibrium
            tendons, disks = rods.designs.arrays.tendons, rods.designs.arrays.disks
            rubs, clamps = (np.any(a) for a in (tendons.friction, disks.clamped_length_m))
            solved[rods.model, rods.load.gravity is None, bool(rubs), bool(clamps)] += len(ramp)
        return follow(rods, ramp, shares)

    monkeypatch.setattr(design_space, "follow", counted)
    robot = ROBOT.with_({"gravity": [0.0, 0.0, -1.0]})
    axis = "friction=0.1:0.2:2" if friction else "clamped_length=1:2 mm:2"
    make(robot, [axis], loading=Loading(20.0, 5), metric=metric, models=[FORCE])
    assert len(solved) == 6  # whole, and without each of five effects
    assert solved.total() == 2 * (7 if friction else 6)


def test_an_error_below_numerical_resolution_has_no_cause() -> None:
    rough = ELASTIC.with_({"segments.0.tendons.friction": 0.1})
    found = validity_map(rough, ["bend=0:60 deg:3", "pretension=1:20 N:5"])
    assert 0.0 < found.value[LENGTHS][:, 0].max() < 1e-12
    assert (found.cause[LENGTHS][:, 0] == "").all()
    assert (found.cause["cc_from_displacements"][:, 0] != "").any()


def test_commanded_bends_are_displacements_of_all_tendons() -> None:
    """With stretch and slack the tip misses the commanded arc; stiff taut tendons meet it."""
    found = validity_map(ELASTIC, ["bend=10:90 deg:3", "pretension=5:40 N:2"])
    assert list(found.value) == ["cc_from_displacements", LENGTHS]
    radius = ELASTIC.tendons.pitch_radius_m[0]
    angles = ELASTIC.tendons.angle_rad
    for i, pretension in enumerate((5.0, 40.0)):
        robot = ELASTIC.with_({"segments.0.tendons.pretension": pretension})
        for k, bend in enumerate(np.radians([10.0, 50.0, 90.0])):
            displacements = bend * radius * np.cos(angles - angles[0])
            ramp = np.linspace(0.0, 1.0, 17)[:, None] * displacements
            path = bs.sweep(robot, load=bs.Load(displacements=ramp))
            arc = RobotArcs.from_lengths(robot, robot.length - displacements).tip.position
            error = np.linalg.norm(arc - path.tip_position[-1]) / robot.length
            assert found.value["cc_from_displacements"][i, k] == pytest.approx(error, abs=1e-9)
            slack = (path.slack_lengths[-1] > 1e-9).any()
            assert STATES[found.state[i, k]] == ("a tendon is slack" if slack else "solved")
    assert {STATES[i] for i in np.unique(found.state)} == {"solved", "a tendon is slack"}
    assert found.cause["cc_from_displacements"][0, 2] == "tendon_stretch"


def test_bends_of_two_segments_have_the_direction_of_the_linear_law() -> None:
    robot = bs.load_robot("rao2021")
    designs = Designs(robot, {"segments.0.length": [robot.segments[0].length]})
    shares = np.zeros(6)
    shares[4] = 1.0
    per_bend = displacement_per_bend(designs, shares)[0]
    straight = robot.disks.station_m[robot.tendons.end_disk]
    arcs = RobotArcs.from_lengths(robot, straight - per_bend)
    assert arcs.theta.sum() == pytest.approx(1.0)
    by_force = RobotArcs.from_tensions(robot, 0.1 * shares)
    np.testing.assert_allclose(arcs.phi, by_force.phi)


def test_bends_of_robots_of_different_length() -> None:
    for over in ("length=641:100 mm:3", "length=100:641 mm:3"):
        with pytest.raises(InputError, match="bend of 900 deg shortens tendon 1"):
            validity_map(ROBOT, ["bend=0:900 deg:3", over])
    balanced = Loading(None, 5, {1: 1.0, 2: 1.0, 3: 1.0})
    with pytest.raises(InputError, match="balance each other"):
        validity_map(ROBOT, ["bend=0:60 deg:3"], loading=balanced)
    found = validity_map(ROBOT, ["bend=0:90 deg:3", "segments.0.length=641:200 mm:3"])
    assert np.isfinite(found.value["cc_from_displacements"]).all()


def test_the_main_cause_is_that_of_points_above_the_tolerance() -> None:
    """Shear and extension make most of the tiny error at no bend, and little beyond."""
    few = ELASTIC.with_({"segments.0.disks.count": 4, "segments.0.tendons.pretension": 20.0})
    found = validity_map(few, ["bend=0:120 deg:4"])
    assert found.cause["cc_from_displacements"][0] == "shear_extension"
    assert "shear and extension" not in described(found)[0]


def test_a_map_of_bends_has_no_largest_tension() -> None:
    found = validity_map(ELASTIC, ["bend=10:60 deg:3"])
    assert found.to_dict()["max_tension_N"] is None
    assert "bend" in found.to_dataset()[LENGTHS].attrs["long_name"]
