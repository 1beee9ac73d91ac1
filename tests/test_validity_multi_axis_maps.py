"""Maps over more than two axes: slices, figure, data set, and the command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.shell import Shell

import bowstring as bs
from bowstring import jobs
from bowstring.errors import InputError
from bowstring.jobs import Job, Variable
from bowstring.validity import multi_axis_maps
from bowstring.validity.loading import Loading
from bowstring.validity.map_job import map_job
from bowstring.validity.maps import validity_map
from bowstring.validity.multi_axis_maps import ValidityGrid, _kinds, read_grid, validity_grid

ROBOT = bs.load_robot("amouri2019")
FORCE = "cc_from_force"
AXES = [
    "tension=0:80 N:9",
    "clamped_length=0:6 mm:5",
    "disks.count=7:11:3",
    "tip_force.x=-0.02:0.02:3",
]
PATHS = ["tension", "clamped_length", "disks.count", "tip_force.x"]


@pytest.fixture(scope="module")
def found() -> ValidityGrid:
    return validity_grid(ROBOT, AXES, load=bs.Load(tip_force=[0.0, 0.01, 0.0]))


def test_a_slice_is_the_map_computed_directly(found: ValidityGrid) -> None:
    robot = ROBOT.with_({"segments.0.disks.count": 11})
    direct = validity_map(robot, AXES[:2], load=bs.Load(tip_force=[0.02, 0.01, 0.0]))
    view = found.slice({"disks.count": 11, "tip_force.x": "0.02 N"})
    for name, value in direct.value.items():
        np.testing.assert_allclose(view.value[name], value, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(found.value[name][:, :, 2, 2].T, value, rtol=1e-7, atol=1e-12)
        assert (view.cause[name] == direct.cause[name]).all()
    lines = [view.contour[FORCE], direct.contour[FORCE]]
    assert len(lines[0]) == len(lines[1]) > 0
    np.testing.assert_allclose(lines[0][0], lines[1][0])
    assert [(axis.path, value) for axis, value in view.fixed] == [
        ("segments.0.disks.count", 11.0),
        ("tip_force.x", 0.02),
    ]


def test_a_slice_lies_between_the_points_too(found: ValidityGrid) -> None:
    """At one tension the metric stays the error at this tension."""
    view = found.slice({"disks.count": 9, "tip_force.x": 0.005}, tension="37 N")
    robot = ROBOT.with_({"segments.0.disks.clamped_length": "3 mm"})
    load = bs.Load(tip_force=[0.005, 0.01, 0.0])
    direct = validity_map(robot, ["tension=0:37 N:2"], load=load)
    assert view.metric == "error"
    assert view.value[FORCE][2] == pytest.approx(direct.value[FORCE][1], rel=1e-9)
    assert "tension of the sweep 37 N" in view.figure().get_suptitle()


def test_gravity_and_numbers_of_all_segments_are_fixed() -> None:
    robot = bs.load_robot("crl-ftdcr-v4")
    E = robot.segments[0].backbone.E / 1e9
    axes = [f"segments.*.backbone.E={E}:{2 * E} GPa:2", "gravity.z=-9:9:3", "tension=0:2 N:3"]
    view = validity_grid(robot, axes).slice({"gravity.z": 9.0, "E": f"{2 * E} GPa"})
    same = {f"segments.{k}.backbone.E": 2e9 * E for k in range(3)}
    gravity = [*robot.gravity[:2], 9.0]
    direct = validity_map(robot.with_(same), axes[2:], load=bs.Load(gravity=gravity))
    np.testing.assert_allclose(view.value[FORCE], direct.value[FORCE], rtol=1e-9)


@pytest.mark.parametrize(
    ("at", "message"),
    [
        ({"tension": 40.0}, "leaves 3 axes"),
        (dict.fromkeys(PATHS, 0.0), "must be a whole number from 7 to 11"),
        ({"E": 1.0}, "must be one of the axes"),
        ({"tension": 40.0, "disks.count": 8.5}, "must be a whole number from 7 to 11"),
        ({"tension": "90 N", "disks.count": 9}, "is 90 N; must be 0 to 80 N"),
        ({"tension": "9 mm", "disks.count": 9}, "not a unit of force"),
        ({"count": 9, "disks.count": 9}, "two values"),
        ({"tension": float("nan"), "disks.count": 9}, "finite"),
    ],
)
def test_bad_slices_are_refused(
    found: ValidityGrid, at: dict[str, float | str], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        found.slice(at)


def test_bars_have_the_share_of_points_outside(found: ValidityGrid) -> None:
    kinds = _kinds(found, FORCE)
    value = found.value[FORCE]
    assert ((kinds.of >= 0) == (value > 0.01)).all()
    view = found.slice({"disks.count": 9, "tip_force.x": 0.0})
    outside = view.value[FORCE] > 0.01
    assert outside.any() and found.step == 1
    drawn = np.array(kinds.causes)[kinds.of[:, :, 1, 1].T[outside]]
    assert (drawn == view.cause[FORCE][outside]).all()


def test_causes_of_a_large_map_are_those_of_the_nearest_point() -> None:
    large = validity_grid(ROBOT, ["tension=0:80 N:21", "clamped_length=0:6 mm:13", AXES[2]])
    large = replace(large, cause={FORCE: large.cause[FORCE][::2, ::2, ::2]}, step=2)
    kinds = _kinds(large, FORCE)
    here, coarse = kinds.of[::2, ::2, ::2], large.cause[FORCE]
    outside = here >= 0
    assert outside.any() and (np.array(kinds.causes)[here[outside]] == coarse[outside]).all()


def test_the_figure_has_parallel_coordinates_and_slices(found: ValidityGrid) -> None:
    figure = found.figure()
    assert len(figure.axes) == 2 * (1 + 3)
    words = [text.get_text() for text in figure.axes[0].texts]
    assert {"clamped length (mm)", "number of disks", "1 %", "80"} <= set(words)
    titles = [panel.get_title() for panel in figure.axes[1:4]]
    assert titles == ["number of disks 7", "number of disks 9", "number of disks 11"]
    assert "Slices at tip force along x 0 N" in figure.legends[0].get_title().get_text()


def test_a_map_of_limits_has_a_figure(tmp_path: Path) -> None:
    axes = ["E=30:40 GPa:2", "pitch_radius=20:30 mm:2", "clamped_length=0:6 mm:2"]
    limits = validity_grid(ROBOT, axes, metric="valid_to", loading=Loading(80.0))
    assert limits.save(tmp_path / "map.svg").exists()
    assert "up to" in limits.described()[1]


@pytest.mark.slow
@pytest.mark.usefixtures("coarse")
def test_a_region_without_equilibrium_is_drawn(tmp_path: Path) -> None:
    upright = ROBOT.with_({"gravity": [0.0, 0.0, -9.81]})
    axes = ["E=0.5:6 GPa:4", "clamped_length=0:2 mm:2", "nu=0.2:0.4:2"]
    soft = validity_grid(upright, axes, loading=Loading(20.0))
    assert not soft.solved[0].any() and soft.solved[-1].all()
    assert "4 of 16 points: not solved" in " ".join(soft.described())
    kinds = _kinds(soft, FORCE)
    assert ((kinds.of == len(kinds.colours) - 1) == ~soft.solved).all()
    assert soft.save(tmp_path / "map.png").exists()


def test_a_stored_map_is_the_same(tmp_path: Path) -> None:
    axes = AXES[:3]
    store = jobs.run(map_job(ROBOT, axes, block=17), tmp_path / "blocks")
    stored, direct = read_grid(store), validity_grid(ROBOT, axes)
    for name, value in direct.value.items():
        np.testing.assert_allclose(stored.value[name], value, rtol=1e-9, atol=1e-12)
    file = direct.save(tmp_path / "map.nc")
    with xr.open_dataset(file) as data:
        np.testing.assert_array_equal(data[FORCE].values, direct.value[FORCE])
        assert data.axis_2.attrs == {"units": "m", "long_name": "segments.0.disks.clamped_length"}


def test_what_is_no_map_or_too_large_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = Job(lambda i, n: {"x": np.zeros(n)}, {"a": 3}, {"x": Variable("m", "x")}, {}, 3)
    with pytest.raises(InputError, match="is no map"):
        read_grid(jobs.run(other, tmp_path / "other"))
    with pytest.raises(InputError, match=r"at most 20000 are computed at once.*--store"):
        validity_grid(ROBOT, ["tension=0:80 N:51", "E=30:40 GPa:20", "nu=0:0.4:20"])
    monkeypatch.setattr(multi_axis_maps, "MOST_DRAWN", 10)
    with pytest.raises(InputError, match="a figure has at most"):
        multi_axis_maps.check_drawn(map_job(ROBOT, AXES[:3]))


def test_the_command_maps_three_axes(shell: Shell, tmp_path: Path) -> None:
    over = [text for axis in AXES[:3] for text in ("--over", axis)]
    file = tmp_path / "map.png"
    code, out, _ = shell("map", "amouri2019", *over, "--out", str(file))
    assert code == 0 and file.read_bytes()[:4] == b"\x89PNG" and "of 135 points" in out
    content = shell.json("map", "amouri2019", *over, "--out", str(tmp_path / "map.nc"))
    with xr.open_dataset(tmp_path / "map.nc") as data:
        np.testing.assert_allclose(100.0 * data[FORCE].values, content["maps"][1]["values"])


def test_slack_is_kept_over_three_axes() -> None:
    elastic = bs.load_robot("amouri2019").with_({"segments.0.tendons.axial_stiffness": 3e4})
    axes = ["bend=10:90 deg:3", "pretension=0.5:40 N:2", "E=30:40 GPa:2"]
    grid = bs.validity_grid(elastic, axes)
    assert grid.slack is not None and 0 < grid.slack.sum() < grid.slack.size
    assert f"{grid.slack.sum()} of 12 points: a tendon is slack." in grid.described()
    cut = grid.slice(bend="90 deg", E="35 GPa")
    assert cut.to_dict()["max_tension_N"] is None


def test_slices_do_not_depend_on_the_order_of_the_axes() -> None:
    """Clamped lengths of 120 mm fit three disks, but not the nine of the robot file."""
    robot = bs.load_robot("amouri2019")
    axes = ["tension=0:80 N:3", "disks.count=3:5:3", "clamped_length=0:120 mm:4"]
    grid = bs.validity_grid(robot, axes)
    values = {"count": 3, "clamped_length": "120 mm"}
    one = grid.slice(values).value["cc_from_force"]
    other = grid.slice(dict(reversed(values.items()))).value["cc_from_force"]
    np.testing.assert_array_equal(one, other)
    grid.figure()


def test_an_undefined_error_is_counted_over_three_axes(tmp_path: Path) -> None:
    """With six disks no arc has the tendon lengths at 400 N."""
    robot = ROBOT.with_({"segments.0.disks.count": 6})
    axes = ["tension=200:400 N:2", "E=34:36 GPa:2", "nu=0.2:0.3:2"]
    grid = validity_grid(robot, axes, tolerance=0.05)
    without = grid.undefined["cc_from_lengths"]
    assert without.sum() == 4 and without[1].all() and not grid.undefined[FORCE].any()
    said = grid.described()
    assert "from lengths holds to 5 % of length at 4 of 8 points" in said[0]
    assert "from lengths is not defined at 4 of 8 points: no arc" in said[1]
    kinds = _kinds(grid, "cc_from_lengths")
    assert ((kinds.of == len(kinds.colours) - 1) == without).all()
    words = [text.get_text() for text in grid.figure().legends[0].get_texts()]
    assert "constant curvature not defined" in words
    assert grid.to_dict()["maps"][0]["defined"] == (~without).tolist()
    store = jobs.run(map_job(robot, axes, tolerance=0.05, block=3), tmp_path / "blocks")
    assert read_grid(store).described() == said
    for file in (store.save(tmp_path / "a.nc"), grid.save(tmp_path / "b.nc")):
        with xr.open_dataset(file) as data:
            assert (data.cc_from_lengths_defined.values == ~without).all()
