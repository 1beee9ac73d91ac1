"""The solid against closed forms, and its pose against the solver's."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest

import bowstring as bs
from bowstring.cad.solid import check_cad, make_solid, plain_name
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.disk import drilled_disk
from bowstring.robot.sizes import sizes_of
from objects import refused

bd = pytest.importorskip("build123d", exc_type=ImportError)
pytestmark = pytest.mark.cad

TUBE = {
    "segments.0.backbone.inner_diameter": "3 mm",
    "segments.0.disks.clamped_length": "3 mm",
}
ODD = {  # two holes of three on one side: no symmetry
    "segments.0.tendons": [
        {"angle": "0 deg", "pitch_radius": "29 mm", "diameter": "1.5 mm"},
        {"angle": "50 deg", "pitch_radius": "20 mm"},
        {"angle": "-1 rad", "pitch_radius": "12 mm"},
    ],
    "segments.0.disks.hole_diameter": "4 mm",
    "segments.0.disks.density": "1200 kg/m^3",
}
LOADS = {
    "amouri2019": [60, 0, 20],
    "rao2021": [1, 0, 0.5, 0, 2, 0],
    "crl-ftdcr-v4": [2, *[0.5] * 8],
}


@pytest.fixture(scope="module")
def plain():
    return make_solid(bs.load_robot("amouri2019"))


@pytest.fixture(scope="module", params=[("amouri2019", {}), ("amouri2019", TUBE), ("rao2021", {})])
def bent(request):
    """A pose, and its solid."""
    name, changes = request.param
    solution = bs.solve(bs.load_robot(name, changes), tensions=LOADS[name])
    return solution, make_solid(solution.robot, solution)


def of_kind(solid, kind):
    return [part for part in solid.parts if part.kind == kind]


# -- straight ----------------------------------------------------------------------------------


def test_parts_of_the_straight_robot(plain):
    assert [part.name for part in plain.parts] == [
        "base",
        "backbone",
        *(f"disk_{i}" for i in range(1, 10)),
        *(f"tendon_{i}" for i in (1, 2, 3)),
    ]
    assert not plain.posed
    volume = {
        "backbone": math.pi * 0.0025**2 * 0.641,
        "disk_4": math.pi * 0.003 * (0.032**2 - 0.0025**2 - 3 * 0.001**2),
        "tendon_2": math.pi * 0.0005**2 * 0.641,
        "base": math.pi * 0.006 * (0.040**2 - 3 * 0.001**2),
    }
    for name, expected in volume.items():
        assert plain[name].volume_m3 == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(plain["backbone"].centre_m, [0, 0, 0.3205], atol=1e-15)
    np.testing.assert_allclose(plain["base"].centre_m, [0, 0, -0.003], atol=1e-15)
    np.testing.assert_allclose(plain["disk_9"].centre_m, [0, 0, 0.641], atol=1e-15)
    hole = 0.029 * np.array([math.cos(math.tau / 3), math.sin(math.tau / 3)])
    np.testing.assert_allclose(plain["tendon_2"].centre_m, [*hole, 0.3205], atol=1e-15)
    assert plain["backbone"].mass_kg == pytest.approx(1800 * volume["backbone"], rel=1e-12)
    assert plain["disk_1"].mass_kg == 0.02 and plain["tendon_1"].mass_kg is None
    with pytest.raises(KeyError):
        plain["disk_10"]


@pytest.mark.parametrize("name", bs.robot_names())
def test_parts_are_valid_and_do_not_overlap(name):
    solid = make_solid(bs.load_robot(name))
    assert all(part.shape.is_valid for part in solid.parts)
    disk = solid["disk_1"].shape
    for part in solid.parts:
        if part.kind in ("tendon", "backbone"):
            common = disk.intersect(part.shape)
            assert not common or sum(s.volume for s in common.solids()) < 1e-9


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("amouri2019", {"segments.0.disks.density": 1200, "segments.0.disks.hole_diameter": 0.005}),
        ("amouri2019", ODD),
        (
            "crl-ftdcr-v4",
            {
                "segments.0.disks.density": 1200,
                "segments.0.disks.hole_diameter": 0.0008,
                "segments.1.backbone.diameter": 0.0015,
            },
        ),
    ],
)
def test_mass_and_inertia_of_the_solid_are_those_of_the_closed_form(name, changes):
    robot = bs.load_robot(name, changes)
    solid, checked = make_solid(robot), 0
    for d, part in enumerate(of_kind(solid, "disk")):
        segment = robot.segments[robot.disks.segment[d]]
        density = segment.disks.density
        if density is None:
            continue
        checked += 1
        volume, centre = part.volume_m3, part.centre_m - [0, 0, robot.disks.station_m[d]]
        mass = density * volume
        # about the centre of the disk, as in the closed form
        moments = density * part.inertia_m5 + mass * (
            centre @ centre * np.eye(3) - np.outer(centre, centre)
        )
        assert robot.disks.mass_kg[d] == pytest.approx(mass, rel=1e-9)
        across, axial = robot.disks.inertia_kg_m2[d]
        assert across == pytest.approx((moments[0, 0] + moments[1, 1]) / 2, rel=1e-9)
        assert axial == pytest.approx(moments[2, 2], rel=1e-9)
    assert checked >= 9


def test_the_solid_includes_terms_omitted_in_the_closed_form():
    robot = bs.load_robot("amouri2019", ODD)
    part = make_solid(robot)["disk_1"]
    off = np.hypot(*part.centre_m[:2])
    holes = robot.holes(0)
    expected = np.hypot(*(0.002**2 * holes.sum(axis=0))) / (0.032**2 - 0.0025**2 - 3 * 0.002**2)
    assert off == pytest.approx(expected, rel=1e-9) and off > 1e-4


# -- bent --------------------------------------------------------------------------------------


def test_the_backbone_ends_at_the_tip(bent):
    solution, solid = bent
    rods = of_kind(solid, "backbone")
    end = min(
        (face for face in rods[-1].shape.faces() if face.is_planar),
        key=lambda face: np.linalg.norm(
            np.array(tuple(face.center())) - 1e3 * solution.tip.position
        ),
    )
    np.testing.assert_allclose(
        np.array(tuple(end.center())) / 1e3, solution.tip.position, atol=1e-12
    )
    normal = np.array(tuple(end.normal_at(end.center())))
    np.testing.assert_allclose(normal, solution.tip.rotation[:, 2], atol=1e-9)
    rod = solution.robot.segments[-1].backbone
    area = math.pi / 4 * (rod.diameter**2 - rod.inner_diameter**2)
    assert end.area / 1e6 == pytest.approx(area, rel=1e-9)


def test_the_backbone_runs_through_frames_between_those_it_was_made_of(bent):
    solution, solid = bent
    data = solution.to_dataset(points=18).isel(time=0)
    robot = solution.robot
    module, points = data["module"].to_numpy(), data["position"].to_numpy()
    rods = of_kind(solid, "backbone")
    for k, d in ((0, 1), (len(rods) - 1, len(robot.disks.station_m) - 1)):
        skin = rods[k].shape.shell()
        for p in points[module == d + 1][1:-1]:
            inside = (
                robot.segments[k].backbone.inner_diameter or robot.segments[k].backbone.diameter
            )
            away = skin.distance_to(bd.Vertex(*(1e3 * p))) / 1e3
            assert away == pytest.approx(inside / 2, abs=2e-9)


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
@pytest.mark.parametrize("elements", [1, 8])
def test_volume_of_a_bent_backbone_is_its_section_times_its_length(theory, elements):
    robot = bs.load_robot("amouri2019", TUBE)
    solution = bs.solve(robot, tensions=[80, 0, 0], model=bs.RodModel(theory, elements=elements))

    def chords(points: int) -> float:
        line = solution.centerline(points)
        return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())

    length = (4 * chords(512) - chords(256)) / 3  # chords of an arc: second-order error
    area = math.pi / 4 * (0.005**2 - 0.003**2)
    part = make_solid(robot, solution)["backbone"]
    assert part.volume_m3 == pytest.approx(area * length, rel=1e-7)
    if theory == "cosserat":
        assert part.volume_m3 < area * 0.641 * (1 - 1e-4)  # it is compressed


def test_disks_have_the_poses_of_the_solver(bent):
    solution, solid = bent
    robot, sizes = solution.robot, solid.sizes
    for d, part in enumerate(of_kind(solid, "disk")):
        position, rotation = solution.disk_positions[d], solution.disk_rotations[d]
        np.testing.assert_allclose(part.centre_m, position, atol=1e-12)
        k = robot.disks.segment[d]
        places = robot.holes(k)
        found = []
        for face in part.shape.faces().filter_by(bd.GeomType.CYLINDER):
            axis = np.array(tuple(face.axis_of_rotation.direction))
            np.testing.assert_allclose(np.abs(axis @ rotation[:, 2]), 1.0, atol=1e-12)
            if face.radius == pytest.approx(0.5e3 * sizes.hole_m[k], rel=1e-9):
                origin = np.array(tuple(face.axis_of_rotation.position)) / 1e3 - position
                found.append((rotation.T @ origin)[:2])
        assert len(found) == len(places)
        for place in places:
            assert min(np.linalg.norm(place - other) for other in found) < 1e-12


def test_tendons_run_straight_from_hole_to_hole(bent):
    solution, solid = bent
    lengths = solution.tendon_lengths
    for i, part in enumerate(of_kind(solid, "tendon")):
        area = math.pi / 4 * solid.sizes.tendon_m[i] ** 2
        assert part.volume_m3 == pytest.approx(area * lengths[i], rel=1e-9)
        path = solid.tendon_paths[i]
        spans = np.linalg.norm(np.diff(path, axis=0), axis=1)
        assert spans.sum() == pytest.approx(lengths[i], rel=1e-12)
        # a point on the line between two holes is inside, one radius deep
        middle = 1e3 * 0.5 * (path[1] + path[2])
        away = part.shape.shell().distance_to(bd.Vertex(*middle))
        assert away == pytest.approx(0.5e3 * solid.sizes.tendon_m[i], rel=1e-6)
        assert part.shape.is_inside(tuple(middle))


@pytest.mark.parametrize("name", bs.robot_names())
def test_bent_parts_are_valid(name):
    robot = bs.load_robot(name)
    solid = make_solid(robot, bs.solve(robot, tensions=LOADS[name]))
    assert solid.posed
    for part in solid.parts:
        assert part.shape.is_valid and part.volume_m3 > 0, part.name


def test_a_solved_straight_pose_is_the_straight_solid(plain):
    robot = plain.robot
    solved = make_solid(robot, bs.solve(robot, tensions=[0, 0, 0]))
    for one, other in zip(plain.parts, solved.parts, strict=True):
        assert one.volume_m3 == pytest.approx(other.volume_m3, rel=1e-8)
        np.testing.assert_allclose(one.centre_m, other.centre_m, atol=1e-9)


def test_one_time_of_a_run_is_a_pose():
    robot = bs.load_robot("amouri2019")
    run = bs.simulate(robot, bs.dynamics.ramp([40, 0, 0], rise=0.1), duration=0.1)
    data = run.to_dataset()
    tip = data["disk_position"].to_numpy()[-1, -1]
    solid = make_solid(robot, data.isel(time=[-1]))
    np.testing.assert_allclose(solid["disk_9"].centre_m, tip, atol=1e-12)
    refused("output times; choose one", lambda: make_solid(robot, data))
    refused("another robot", lambda: make_solid(bs.load_robot("rao2021"), data.isel(time=[-1])))


def test_description_of_the_loads_of_a_pose():
    robot = bs.load_robot("amouri2019")
    assert make_solid(robot).load == ""

    def said(robot, tensions, **load):
        return make_solid(robot, bs.solve(robot, tensions, load=bs.Load(**load))).load

    assert said(robot, [60, 0, 0]) == "tendon 1 at 60 N"
    assert said(robot, [1.2345, 5, 5]) == "tendon 1 at 1.23 N, tendons 2 and 3 at 5 N"
    down = {"gravity": [0, 0, -9.8], "tip_force": [0.1, 0, 0]}
    assert said(robot, [0, 0, 0], **down) == "no tension, with gravity and a load at the tip"
    assert said(bs.load_robot("rao2021"), [0.1, 0.2, 0.3, 0.4, 0, 0]) == "tensions up to 0.4 N"
    run = bs.simulate(robot, bs.dynamics.ramp([40, 0, 0], rise=0.05), duration=0.05)
    last = make_solid(robot, run.to_dataset().isel(time=[-1]))
    assert last.load == "tendon 1 at 40 N, at 0.05 s"


# -- sizes and bad input ------------------------------------------------------------------------


def test_given_sizes_are_used_and_missing_ones_named():
    robot = bs.load_robot(
        "amouri2019",
        {"segments.0.disks.hole_diameter": "4 mm", "segments.0.tendons.diameter": "1.2 mm"},
    )
    sizes = sizes_of(robot)
    assert sizes.hole_m.tolist() == [0.004] and sizes.tendon_m.tolist() == [0.0012] * 3
    assert [size.field for size in sizes.assumed] == ["radius of the base", "thickness of the base"]
    sizes = sizes_of(bs.load_robot("amouri2019"))
    assert (
        str(sizes.assumed[0]) == "segments[0].disks.hole_diameter = 2 mm, twice the thickest tendon"
    )
    assert len(sizes.assumed) == 4
    # a list of tendons: each without its own size
    sizes = sizes_of(bs.load_robot("amouri2019", ODD))
    assert [size.field for size in sizes.assumed][:2] == [
        "segments[0].tendons[1].diameter",
        "segments[0].tendons[2].diameter",
    ]
    assert sizes.tendon_m.tolist() == [0.0015, 0.001, 0.001]


def test_assumed_sizes_fit_a_crowded_disk():
    robot = bs.load_robot("amouri2019", {"segments.0.tendons.pitch_radius": "31.9 mm"})
    sizes = sizes_of(robot)
    assert sizes.hole_m[0] == pytest.approx(0.8 * 0.2e-3)
    assert sizes.tendon_m.max() < sizes.hole_m[0]
    assert make_solid(robot)["disk_1"].shape.is_valid


def test_impossible_solids_are_refused():
    flat = bs.load_robot("amouri2019", {"segments.0.disks.thickness": "0 mm"})
    refused(r"segments\[0\].disks.thickness is 0 mm, which makes no", lambda: make_solid(flat))
    thick = bs.load_robot("amouri2019", {"segments.0.tendons.diameter": "6 mm"})
    with pytest.raises(
        InputError, match=r"do not hold holes for a tendon of 6 mm: wider than 6 mm"
    ):
        make_solid(thick)
    robot = bs.load_robot("amouri2019")
    refused("robot is 'amouri2019', it must be a Robot", lambda: make_solid("amouri2019"))
    refused("pose is 3, it must be a solution", lambda: make_solid(robot, 3))
    failed = bs.solve(robot, tensions=[1e6, 0, 0])
    assert not failed.converged
    with pytest.raises(NoSolutionError):
        make_solid(robot, failed)


def test_a_bent_wall_that_is_too_thin_is_refused():
    robot = bs.load_robot("amouri2019", {"segments.0.backbone.inner_diameter": "4.999 mm"})
    make_solid(robot)
    with pytest.raises(InputError, match="backbone makes no sound solid in this pose: its wall"):
        make_solid(robot, bs.solve(robot, [0.01, 0, 0]))


def test_without_the_extra_there_is_a_sentence(monkeypatch):
    monkeypatch.setitem(sys.modules, "build123d", None)
    refused(r"solids need .* pip install 'bowstring\[cad\]'$", check_cad)
    # sizes, masses and drawings work without the extra
    robot = bs.load_robot("amouri2019", ODD)
    assert sizes_of(robot).hole_m[0] == 0.004
    mass = drilled_disk(1200, 0.032, 0.003, 0.005, robot.holes(0), 0.004).mass
    assert robot.disks.mass_kg[0] == mass


def test_names_are_plain_letters():
    assert plain_name("Röbot 机 nº 2") == "Robot_no_2"
    assert plain_name("机") == "robot"


def test_without_opengl_there_is_another_sentence(monkeypatch):
    said = "libGL.so.1: cannot open shared object file: No such file or directory"

    class Finder:
        """Replaces the loader as if the library were missing."""

        @staticmethod
        def find_spec(name, *_):
            if name == "build123d":
                raise ImportError(said)

    monkeypatch.delitem(sys.modules, "build123d")
    monkeypatch.setattr(sys, "meta_path", [Finder, *sys.meta_path])
    refused(r"\(libGL.*\); install .* apt-get install libgl1", check_cad)
