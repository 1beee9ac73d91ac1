"""Statics from Python, against independent references, conservation laws and invalid input."""

import copy
import doctest
import itertools
import json
import math
import pickle
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import bowstring as bs
from bowstring.dynamics.simulation import simulate
from bowstring.errors import InputError, NoSolutionError, StabilityWarning
from bowstring.statics.messages import of_solution
from objects import objects
from shooting import Shooting

ROBOT = bs.load_robot("amouri2019")
# Tension of tendon 1 in N, tip x and z in mm: Kirchhoff, then Cosserat; by shooting.
SWEEP = np.array(
    [
        [0, 0, 641, 0, 641],
        [5, 27.77888727, 640.19672805, 27.778686, 640.19207],
        [10, 55.56058998, 637.77806013, 55.559787, 637.768778],
        [15, 83.23698196, 633.73650122, 83.235182, 633.722664],
        [20, 110.69858358, 628.07244855, 110.695401, 628.054156],
        [25, 137.83517404, 620.79437947, 137.830235, 620.771763],
        [30, 164.53642754, 611.91898962, 164.529372, 611.892213],
        [35, 190.69256893, 601.4712786, 190.683053, 601.440532],
        [40, 216.19504466, 589.48458062, 216.182744, 589.450082],
        [45, 240.93720393, 576.00053785, 240.921814, 575.96253],
        [50, 264.81498521, 561.06901489, 264.796226, 561.027763],
        [55, 287.72760257, 544.74795294, 287.705216, 544.703743],
        [60, 309.57822647, 527.10316305, 309.551981, 527.0563],
        [65, 330.2746531, 508.20805811, 330.244344, 508.15886],
        [70, 349.72995672, 488.14332398, 349.695406, 488.092125],
        [75, 367.86311886, 466.99653059, 367.824177, 466.943675],
        [80, 384.59962882, 444.86168461, 384.556175, 444.807525],
    ]
)
UP = (0, 0, -9.81)
# Tension of tendon 1, gravity, tip force; tip in mm: Kirchhoff, Cosserat (None: not known).
CASES = [
    (40, None, (0, 1, 0), (213.2847328, 80.8790081, 583.962985), (213.27286, 80.87176, 583.92931)),
    (80, None, (-1, 0, 0), (348.7254904, 0, 483.7078543), (348.68959, 0, 483.64498)),
    (40, UP, (0, 0, 0), (239.0139242, 0, 578.1474897), (238.99937, 0, 578.11313)),
    (0, UP, (0, 0, 0), (0, 0, 641), None),
]
# Clamped length 3 mm: tension, tip x and z in mm; accurate to 0.02 mm.
CLAMPED = np.array(
    [
        [10, 53.49688, 638.0112],
        [20, 106.66313, 629.01839],
        [30, 158.71661, 614.03657],
        [40, 208.86976, 593.1932],
        [50, 256.34712, 566.73054],
        [60, 300.40342, 535.00532],
    ]
)
# P L^2 / E I; sideways and axial displacement over length; slope in rad; by elliptic integrals.
ELASTICA = [
    (0.5, 0.1621435757, 0.0159189625, 0.2445336471),
    (1, 0.3017207738, 0.0564332363, 0.4613519497),
    (2, 0.4934574804, 0.1606417208, 0.7817498316),
    (3, 0.6032534411, 0.2544201846, 0.9860169467),
    (5, 0.7137915236, 0.3876283607, 1.215368118),
    (10, 0.8106090249, 0.5549955978, 1.430285539),
    (15, 0.8477156743, 0.6352857804, 1.501840154),
]


@pytest.fixture(scope="module")
def bare(robot):
    """A rod: without tension and gravity, disks have no effect."""
    return robot.with_({"segments.0.disks.count": 16})


def tip_mm(solution):
    return 1e3 * solution.raise_for_status().tip.position


def distance(a, b):
    return np.linalg.norm(np.subtract(a, b), axis=-1)


# --- against independent references ------------------------------------------------------


def test_sweep_of_the_study(robot):
    tensions = np.outer(SWEEP[:, 0], [1, 0, 0])
    zero = np.zeros(17)
    for theory, x, z in (("kirchhoff", 1, 2), ("cosserat", 3, 4)):
        expected = np.stack([SWEEP[:, x], zero, SWEEP[:, z]], axis=1)
        for warm in (True, False):
            found = bs.sweep(
                robot, tensions, warm=warm, model=bs.RodModel(theory)
            ).raise_for_status()
            assert distance(1e3 * found.tip_position, expected).max() < 0.0011
            assert found.stable == [True] * 17
            assert found.residual.max() <= 1e-10
    expected = np.stack([SWEEP[:, 1], zero, SWEEP[:, 2]], axis=1)
    fine = bs.sweep(robot, tensions, model=bs.RodModel("kirchhoff", elements=4))
    assert distance(1e3 * fine.tip_position, expected).max() < 1e-5


@pytest.mark.parametrize(("force", "gravity", "tip_force", "kirchhoff", "cosserat"), CASES)
def test_load_cases(robot, force, gravity, tip_force, kirchhoff, cosserat):
    load, thin = (
        bs.Load([force, 0, 0], gravity=gravity, tip_force=tip_force),
        bs.RodModel("kirchhoff"),
    )
    assert distance(tip_mm(bs.solve(robot, load=load, model=thin)), kirchhoff) < 0.002
    fine = bs.solve(robot, load=load, model=thin.replace(elements=8))
    assert distance(tip_mm(fine), kirchhoff) < 1e-6
    if cosserat is not None:
        assert distance(tip_mm(bs.solve(robot, load=load)), cosserat) < 0.002


@pytest.mark.parametrize(
    ("tension", "load"),
    [(40, bs.Load(tip_force=(0, 1, 0))), (20, bs.Load(gravity=(0, 0, 9.81)))],
)
def test_order_of_convergence(robot, tension, load):
    """Twice the elements give a sixteenth of the error, also with the weight of the backbone."""
    models = [bs.RodModel("kirchhoff", elements=e) for e in (1, 2, 4, 8)]
    tips = [tip_mm(bs.solve(robot, [tension, 0, 0], load=load, model=model)) for model in models]
    steps = [distance(a, b) for a, b in itertools.pairwise(tips)]
    orders = [math.log2(a / b) for a, b in itertools.pairwise(steps)]
    assert all(3.6 < order < 4.4 for order in orders), orders


def test_continuous_tendon_is_the_limit_of_many_disks(robot):
    """Its closed form is an arc with theta = F r l / (E I); n disks have an error of order n^-2."""
    tension, r, length = 40.0, robot.tendons.pitch_radius_m[0], robot.length
    theta = tension * r * length / robot.bending_stiffness[0]
    closed = 1e3 * length / theta * np.array([1 - math.cos(theta), 0, math.sin(theta)])
    own = bs.solve(robot, [tension, 0, 0], model=bs.RodModel("kirchhoff", tendon_path="continuous"))
    assert distance(tip_mm(own), closed) < 1e-9
    missed = []
    for n in (9, 18, 36, 72, 144):
        denser = robot.with_({"segments.0.disks.count": n})
        found = bs.solve(denser, [tension, 0, 0], model=bs.RodModel("kirchhoff"))
        missed.append(distance(tip_mm(found), closed))
    orders = [math.log2(a / b) for a, b in itertools.pairwise(missed)]
    assert missed[0] > 3 and missed[-1] < 0.02
    assert all(abs(order - 2) < 0.1 for order in orders), orders


def test_clamped_length(robot):
    clamped = robot.with_({"segments.0.disks.clamped_length": "3 mm"})
    found = bs.sweep(clamped, np.outer(CLAMPED[:, 0], [1, 0, 0])).raise_for_status()
    assert distance(1e3 * found.tip_position[:, [0, 2]], CLAMPED[:, 1:]).max() < 0.03


@pytest.mark.parametrize(
    ("tension", "g", "density"),
    [
        (60.0, 0.0, 1800.0),
        (40.0, 9.81, 0.0),  # disks have weight, the backbone has none
        (40.0, 9.81, 1800.0),
        (20.0, -9.81, 1800.0),
    ],
)
def test_against_shooting(robot, tension, g, density):
    robot = robot.with_({"segments.0.backbone.density": density})
    load, model = bs.Load([tension, 0, 0], gravity=(0, 0, -g)), bs.RodModel("kirchhoff")
    fine = bs.solve(robot, load=load, model=model.replace(elements=8))
    exact = Shooting(robot, fine, []).solve()[0]
    assert distance(1e3 * fine.disk_positions, 1e3 * exact).max() < 1e-6
    plain = bs.solve(robot, load=load, model=model)
    assert distance(tip_mm(plain), tip_mm(fine)) < 0.006


def test_elastica(robot, bare):
    unit = robot.bending_stiffness[0] / robot.length**2
    for load, sideways, axial, slope in ELASTICA:
        push = bs.Load([0, 0, 0], tip_force=(load * unit, 0, 0))
        found = bs.solve(bare, load=push, model=bs.RodModel("kirchhoff", elements=8))
        found.raise_for_status()
        x, y, z = found.tip.position / robot.length
        rotation = found.tip.rotation
        assert abs(x - sideways) < 1e-9
        assert abs(1 - z - axial) < 1e-9
        assert abs(math.atan2(rotation[0, 2], rotation[2, 2]) - slope) < 1e-9
        assert abs(y) < 1e-12


@pytest.mark.parametrize("theta", [0.5, math.pi, 2 * math.pi, 3 * math.pi, 4 * math.pi])
def test_roll_up_by_a_moment(robot, bare, theta):
    moment = theta * robot.bending_stiffness[0] / robot.length
    found = bs.solve(
        bare, [0, 0, 0], load=bs.Load(tip_moment=(0, moment, 0)), model=bs.RodModel("kirchhoff")
    )
    assert found.converged
    x, y, z = found.tip.position / robot.length
    assert abs(z - math.sin(theta) / theta) < 1e-12
    assert abs(x - (1 - math.cos(theta)) / theta) < 1e-12
    assert abs(y) < 1e-12
    if theta < 3:
        assert found.raise_for_status().stable is True
        return
    # a dead moment makes a rod unstable that it has rotated by half a turn
    assert not found.stable and "stable" in found.message
    with pytest.warns(StabilityWarning):
        found.raise_for_status()


@pytest.mark.parametrize("ratio", [1.01, 1.1, 1.5, 2.0, 5.0])
def test_buckling_finds_the_bent_branch(robot, bare, ratio):
    euler = math.pi**2 * robot.bending_stiffness[0] / (4 * robot.length**2)

    def pushed(share, **elements):
        load = bs.Load([0, 0, 0], tip_force=(0, 0, -share * euler))
        return bs.solve(bare, load=load, model=bs.RodModel("kirchhoff", **elements))

    below = pushed(0.99)
    assert below.stable and below.message == "A stable equilibrium."
    assert tip_mm(below) == pytest.approx([0, 0, 641], abs=1e-9)
    above = pushed(ratio, elements=2).raise_for_status()
    assert above.stable is True
    assert "buckled" in above.message and "one of several stable branches" in above.message
    # the elastica: K(k) = (pi / 2) sqrt(P / P_euler)
    target = math.pi / 2 * math.sqrt(ratio)
    m = brentq(lambda m: ellipk(m) - target, 0.0, 1.0 - 1e-9, xtol=1e-15)
    x, y, z = above.tip.position / robot.length
    assert math.hypot(x, y) == pytest.approx(2 * math.sqrt(m) / target, abs=1e-6)
    assert z == pytest.approx(2 * ellipe(m) / target - 1, abs=1e-6)


# --- conservation laws --------------------------------------------------------------------


def test_jacobians_need_a_solution_and_straight_spans(robot):
    with pytest.raises(NoSolutionError):
        bs.jacobians(bs.solve(robot, [2e4, 2e4, 2e4]))
    with pytest.raises(InputError, match='solve with tendon_path="straight"'):
        bs.jacobians(bs.solve(robot, [40, 0, 0], model=bs.RodModel(tendon_path="continuous")))


def test_frames_and_centerline_agree(rao):
    s = bs.solve(rao, [4, 0, 0, 0, 2, 0]).raise_for_status()
    eye = s.disk_rotations @ s.disk_rotations.transpose(0, 2, 1)
    assert np.abs(eye - np.eye(3)).max() < 1e-14
    assert np.array_equal(s.disk_positions[-1], s.tip.position)
    assert np.array_equal(s.disk_rotations[-1], s.tip.rotation)
    line = s.centerline(5)
    assert line.shape == (101, 3)
    assert np.array_equal(line[0], np.zeros(3))
    assert np.abs(line[5::5] - s.disk_positions).max() < 3e-15  # rounding


def test_gravity_is_the_robots_own_unless_given(robot):
    suspended = robot.with_({"gravity": [0, 0, 9.81]})
    own = bs.solve(suspended, [40, 0, 0])
    assert np.array_equal(own.load.gravity, [0, 0, 9.81])
    given = bs.solve(robot, [40, 0, 0], load=bs.Load(gravity=[0, 0, 9.81]))
    assert np.array_equal(own.tip.position, given.tip.position)
    off = bs.solve(suspended, [40, 0, 0], load=bs.Load(gravity=(0, 0, 0)))
    assert np.array_equal(off.tip.position, bs.solve(robot, [40, 0, 0]).tip.position)


@settings(max_examples=50, deadline=None)
@given(
    st.lists(st.floats(0, 80), min_size=3, max_size=3),
    st.lists(st.floats(-1, 1), min_size=3, max_size=3),
    st.sampled_from(["kirchhoff", "cosserat"]),
    st.booleans(),
)
def test_moderate_loads_converge(tensions, force, theory, twist):
    load = bs.Load(tensions, tip_force=force, gravity=UP)
    s = bs.solve(ROBOT, load=load, model=bs.RodModel(theory, twist=twist))
    assert s.converged and s.stable and s.residual <= 1e-10
    assert np.isfinite(s.disk_positions).all()


# --- many loads --------------------------------------------------------------------------


def test_sweep_and_batch_equal_solves(rao):
    rng = np.random.default_rng(1)
    tensions = rng.uniform(0, 3, (70, 6))
    force = rng.uniform(-0.05, 0.05, (70, 3))
    given = {
        "load": bs.Load(tensions, gravity=UP, tip_force=force),
        "model": bs.RodModel("kirchhoff", elements=4),
    }
    cold = bs.sweep(rao, warm=False, **given)
    batch = bs.solve_batch(rao, **given)
    two = bs.solve_batch(rao, threads=2, disks=False, **given)
    warm = bs.sweep(rao, **given)
    assert two.disk_positions is None and two.disk_rotations is None
    for i in range(70):
        load = bs.Load(tensions[i], gravity=UP, tip_force=force[i])
        one = bs.solve(rao, load=load, model=given["model"])
        for many in (cold, batch):
            assert many.status[i] == one.status and many.stable[i] == one.stable
            assert many.iterations[i] == one.iterations and many.residual[i] == one.residual
            assert many.message(i) == one.message
            assert np.array_equal(many.disk_positions[i], one.disk_positions)
            assert np.array_equal(many.disk_rotations[i], one.disk_rotations)
            assert np.array_equal(many.tendon_lengths[i], one.tendon_lengths)
        assert np.array_equal(two.tip_position[i], one.tip.position)
        assert np.array_equal(two.tip_rotation[i], one.tip.rotation)
        assert np.allclose(warm.tip_position[i], one.tip.position, atol=1e-9)
    assert two.residual.shape == (70,)
    assert repr(cold) == "<Sweep of rao2021: 70 of 70 loads converged>"


def test_no_loads_at_all(robot):
    for found in (bs.sweep(robot, np.zeros((0, 3))), bs.solve_batch(robot, np.zeros((0, 3)))):
        assert len(found) == 0 and found.disk_rotations.shape == (0, 9, 3, 3)
        found.raise_for_status()


def test_input_arrays_of_any_kind(robot):
    expected = bs.solve(robot, [8.0, 0.0, 4.0]).tip.position
    table = np.array([[8, 0, 4], [0, 0, 0], [1, 2, 3]])
    for tensions in ((8, 0, 4), table[0], np.float32([8, 0, 4]), np.array([4.0, 0, 8])[::-1]):
        assert np.array_equal(bs.solve(robot, tensions).tip.position, expected)
    for tensions in (table, table.tolist(), np.asfortranarray(table), table.astype(np.float32)):
        assert np.array_equal(bs.sweep(robot, tensions).tip_position[0], expected)
    rows = ((0, 0, 0), (0, 0, 1), (0, 0, 2))
    tuples, array = (
        bs.sweep(robot, np.ones((3, 3)), load=bs.Load(tip_force=f)) for f in (rows, np.array(rows))
    )
    assert np.array_equal(tuples.tip_position, array.tip_position)


def test_a_solution_cannot_be_changed_through_its_arrays(robot):
    s = bs.solve(robot, [80, 0, 0])
    position = s.tip.position
    position *= 1e3
    assert s.tip.position[0] < 1
    tensions = np.array([[80.0, 0, 0]])
    found = bs.sweep(robot, tensions)
    tensions[:] = 0
    assert found.tensions[0, 0] == 80


# --- failures ----------------------------------------------------------------------------


def test_the_studys_modulus_as_printed_gives_a_warning(robot):
    soft = robot.with_({"segments.0.backbone.E": 35e6})
    s = bs.solve(soft, [80, 0, 0])
    assert not s.converged and s.status != "converged"
    assert s.tip is None and s.disk_positions is None and s.disk_rotations is None
    assert s.tendon_lengths is None and s.centerline() is None
    with pytest.raises(NoSolutionError) as error:
        s.raise_for_status()
    text = str(error.value)
    assert text.startswith("amouri2019: No equilibrium") and "Young's modulus" in text
    assert "%" in text or "collide" in text
    content = json.loads(json.dumps(s.to_dict(), allow_nan=False))
    assert content["tip"] is None and content["disks"] is None
    assert content["tensions_N"] == [80, 0, 0]


def test_failed_rows_are_nan_and_flagged(robot):
    tensions = [[10, 0, 0], [2e4, 2e4, 2e4], [20, 0, 0]]
    for found in (bs.sweep(robot, tensions), bs.solve_batch(robot, tensions)):
        assert found.converged.tolist() == [True, False, True]
        assert found.status[1] != "converged"
        for name in ("tip_position", "tip_rotation", "tendon_lengths", "disk_positions"):
            values = getattr(found, name)
            assert np.isnan(values[1]).all() and np.isfinite(values[[0, 2]]).all()
        with pytest.raises(NoSolutionError, match=r"1 of 3 loads .* first is row 2: No equil"):
            found.raise_for_status()


MESSAGES = {
    ("no_equilibrium", 0): "the base and disk 1 collide",
    ("no_equilibrium", 3): "disks 3 and 4 collide",
    ("unstable", None): "four attempts to leave it",
    ("max_iterations", None): "12.5 % of the load converged",
}


def ended(status, collision, residual):
    return SimpleNamespace(
        status=status,
        stable=None,
        left_unstable=False,
        fraction=0.125,
        collision=collision,
        residual=residual,
        iterations=50,
    )


@pytest.mark.parametrize(("case", "part"), MESSAGES.items())
def test_messages(case, part):
    text = of_solution(ended(case[0], case[1], 1e-3))
    assert part in text and text.endswith(".") and "nan" not in text


@pytest.mark.parametrize("residual", [float("nan"), float("inf")])
def test_the_message_of_no_solution_makes_no_false_promise(residual):
    text = of_solution(ended("max_iterations", None, residual))
    assert "An actuated tendon" in text and "at its limit" in text and "Lower the load" in text
    assert not any(word in text for word in ("sweep", "elements", "residual", "nan", "inf "))


@pytest.mark.parametrize("moment", [None, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
def test_a_moment_is_blamed_only_where_there_is_one(moment):
    found = ended("converged", None, 1e-12)
    found.tip_moment, found.disk_moments, found.point_loads = moment, None, None
    text = of_solution(found)
    blamed = moment is not None and any(moment)
    assert ("a dead moment has no potential" in text) == blamed
    assert "too few elements to decide" in text


# --- the interface -----------------------------------------------------------------------


def test_contract_of_the_command_line(robot):
    s = bs.solve(robot, [80, 0, 0], load=bs.Load(tip_force=(0, 1, 0)))
    content = json.loads(json.dumps(s.to_dict(), allow_nan=False))
    keys = "status stable iterations residual error_estimate elements theory tip disks slack "
    keys += "tendon_lengths_m tensions_N displacements_m slack_m span_tensions_N undetermined "
    assert set(content) == set(f"{keys} length_residual_m".split())
    assert content["status"] == "converged" and content["theory"] == "cosserat"
    assert len(content["disks"]) == 9 and content["disks"][-1] == content["tip"]
    assert content["tip"]["position_m"] == s.tip.position.tolist()
    assert content["tip"]["rotation"] == s.tip.rotation.tolist()
    assert content["tendon_lengths_m"] == s.tendon_lengths.tolist()


def test_import_is_lazy():
    code = (
        "import sys, bowstring as bs; "
        "heavy = {'numpy', 'pydantic', 'pandas', 'matplotlib', 'bowstring._core'}; "
        "assert not heavy & set(sys.modules), heavy & set(sys.modules); "
        "assert 'solve' in dir(bs); bs.solve; "
        "assert not {'pandas', 'matplotlib', 'scipy'} & set(sys.modules); "
        "print(bs.__version__)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert re.fullmatch(r"\d+\.\d+\.\d+\S*\n", done.stdout)
    with pytest.raises(AttributeError, match="no attribute 'slove'"):
        _ = bs.slove


def test_examples_in_the_documentation():
    from bowstring.statics import rod

    result = doctest.testmod(rod)
    assert result.attempted >= 6 and result.failed == 0


def test_message_mentions_a_coarse_mesh() -> None:
    robot = bs.load_robot("amouri2019").with_({"segments.0.disks.count": 3})
    strong = bs.solve(robot, [60, 0, 0], model=bs.RodModel(elements=1))
    assert strong.converged
    assert "Discretisation error: the tip by up to" in strong.message
    assert "(1 element per module). Leave the number of elements out" in strong.message
    fine = bs.solve(robot, [60, 0, 0], model=bs.RodModel(elements=8))
    assert fine.message == "A stable equilibrium."
    error = np.linalg.norm(strong.tip.position - fine.tip.position)
    assert error > 1e-4 * robot.length
    assert error <= strong.error_estimate.tip <= 30 * error
    chosen = bs.solve(robot, [60, 0, 0])
    assert chosen.model.elements > 1 and chosen.message == "A stable equilibrium."
    assert bs.solve(bs.load_robot("amouri2019"), [80, 0, 0]).message == "A stable equilibrium."


# -- stability under a moment, which has no potential -------------------------------------------


def test_a_negligible_moment_does_not_hide_a_failure() -> None:
    found = bs.solve(ROBOT, [1000.0] * 3, load=bs.Load(tip_moment=[1e-6, 0, 0]))
    assert not bs.solve(ROBOT, [1000.0] * 3).converged
    assert not found.converged and found.tip is None
    with pytest.raises(NoSolutionError):
        found.raise_for_status()


def test_a_negligible_moment_does_not_hide_buckling() -> None:
    buckled, found = (
        bs.solve(ROBOT, [700.0] * 3, load=load, model=bs.RodModel(elements=8))
        for load in (bs.Load(), bs.Load(tip_moment=[1e-12, 0, 0]))
    )
    assert buckled.stable and "buckled" in buckled.message
    assert found.converged and found.stable and "buckled" in found.message
    assert np.linalg.norm(found.tip.position - buckled.tip.position) < 1e-6
    # and one that stays straight is reported as unstable
    assert np.linalg.norm(found.tip.position[:2]) > 0.01


@pytest.mark.parametrize("tension", [800.0, 1000.0])
@pytest.mark.parametrize("moment", [[1e-12, 0, 0], [0, 0, 1e-12]])
def test_a_moment_below_all_tolerances_is_ignored(tension: float, moment: list[float]) -> None:
    without, found = (
        bs.solve(ROBOT, [tension] * 3, load=bs.Load(tip_moment=m)) for m in ([0, 0, 0], moment)
    )
    assert not without.converged
    assert (found.status, found.message) == (without.status, without.message)


@pytest.mark.parametrize("moment", [[0.5, 0, 0], [0, 1.0, 0.01], [0, 0, 0.05]])
def test_small_motions_under_a_moment_decay(moment: list[float]) -> None:
    found = bs.solve(ROBOT, [5.0, 0, 0], load=bs.Load(tip_moment=moment)).raise_for_status()
    assert found.stable is True and found.message.startswith("A stable equilibrium.")


@pytest.mark.parametrize("damping", [0.02, 0.1])
def test_a_moment_along_a_round_backbone_causes_flutter(damping: float) -> None:
    """Nikolai's paradox; the growth rate is compared with a motion."""
    moment = [0, 0, 0.5]
    found = bs.solve(ROBOT, [0.0] * 3, load=bs.Load(tip_moment=moment))
    assert found.converged and found.stable is None and "damped" in found.message
    with pytest.warns(StabilityWarning, match="whether it is stable is not known"):
        found.raise_for_status()
    with pytest.warns(StabilityWarning, match="a dead moment may let small oscillations"):
        rate = 2 * damping * 2 * np.pi * 2.27
        load = {"tip_moment": moment, "tip_force": [0, 0, 0], "initial_tip_force": [1e-3, 0, 0]}
        steps = {"mass_damping": rate, "spectral_radius": 1.0, "dt": 2e-3, "points": 0}
        run = simulate(ROBOT, [0.0] * 3, 6.0, **objects(**load, **steps))
    aside = np.linalg.norm(run.tip_position[:, :2], axis=1)
    grows = aside[450:].max() > aside[150:300].max()
    assert grows == (damping < 0.05)


def test_stability_of_a_massless_robot_is_unknown() -> None:
    light = {"segments.0.disks.mass": "0 kg", "segments.0.backbone.density": "0 kg/m^3"}
    for moment, stable in ((0.5, None), (0.01, True)):
        load = bs.Load([0.0] * 3, tip_moment=[0, 0, moment])
        assert bs.solve(ROBOT.with_(light), load=load).stable is stable


def test_errors_name_argument_index_value_and_rule(robot):
    with pytest.raises(InputError) as error:
        bs.solve(robot, [1, -2, 3])
    found = error.value
    assert (found.argument, found.index, found.value) == ("tensions", 1, "-2 N")
    assert found.rule == "zero or more: a tendon can only pull"


def test_the_load_of_a_solution_reproduces_it(robot):
    for load in (
        bs.Load([40, 5, 0], gravity=(0, 0, -9.81), tip_moment=(0, 0, 0.01)),
        bs.Load([np.nan, 5, 0], [0.02, np.nan, np.nan]),
    ):
        model = bs.RodModel("kirchhoff", elements=2)
        found = bs.solve(robot, load=load, model=model)
        again = bs.solve(robot, load=found.load, model=found.model)
        assert np.array_equal(again.tip.position, found.tip.position)
        assert found.model == model and hash(found.model) == hash(model)
        assert pickle.loads(pickle.dumps(model)) == model


def test_pickle_and_copy(robot):
    s = bs.solve(
        robot,
        [80, 3, 0],
        load=bs.Load(gravity=UP, tip_force=(0, 1, 0)),
        model=bs.RodModel("kirchhoff", elements=2),
    )
    for other in (pickle.loads(pickle.dumps(s)), copy.deepcopy(s)):
        assert np.array_equal(other.tip.position, s.tip.position)
        assert other.to_dict() == s.to_dict() and other.model.elements == 2
