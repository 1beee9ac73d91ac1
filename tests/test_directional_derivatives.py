"""Derivatives along directions: against differences of solutions, and against theory."""

from __future__ import annotations

import itertools
import re
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.errors import InputError, NoSolutionError
from bowstring.robot.model import with_tendons
from bowstring.robot.paths import full_paths, numbers_of
from bowstring.statics.differentiation import QUANTITIES, DirectionalDerivatives, Rates

AMOURI, RAO = bs.load_robot("amouri2019"), bs.load_robot("rao2021")

#: A dead moment has no potential, so that stability is not always known.
pytestmark = pytest.mark.filterwarnings("ignore::bowstring.errors.StabilityWarning")

NUMBERS = (
    "segments.*.backbone.E",
    "segments.0.backbone.nu",
    "segments.0.backbone.diameter",
    "segments.0.length",
    "pitch_radius",
    "segments.0.disks.clamped_length",
)


def case(seed: int) -> tuple[bs.Solution, dict[str, Any]]:
    """Random equilibrium and direction."""
    rng = np.random.default_rng([21, seed])
    robot = bs.load_robot(("amouri2019", "rao2021", "crl-ftdcr-v4")[seed % 3])
    segments = range(len(robot.segments))
    robot = robot.with_(
        {
            "segments.*.backbone.nu": rng.uniform(0.1, 0.45),
            "segments.*.disks.clamped_length": rng.uniform(1e-3, 3e-3),
            **{
                f"segments.{k}.{path}": size * rng.uniform(0.8, 1.25)
                for k in segments
                for path, size in (
                    ("length", robot.segments[k].length),
                    ("backbone.E", robot.segments[k].backbone.E),
                )
            },
        }
    )
    count, disks = len(robot.tendons.end_disk), len(robot.disks.station_m)
    moment = robot.bending_stiffness.min() / robot.length
    arm = robot.tendons.pitch_radius_m.mean()
    force = moment / robot.length
    # tensions are in proportion to the bend of each segment
    tensions = 0.8 * moment / arm * rng.uniform(0.15, 1.0, count) * rng.integers(0, 2, count)
    load = bs.Load(
        tensions,
        gravity=rng.normal(size=3) * 5.0,
        tip_force=0.4 * force * rng.normal(size=3),
        tip_moment=0.1 * moment * rng.normal(size=3),
    )
    if seed % 4 == 1:
        load = load.replace(disk_forces=0.1 * force * rng.normal(size=(disks, 3)))
    if seed % 5 == 2:
        point = bs.PointLoad(
            disk=disks // 2,
            point=(0.01, 0.0, 0.0),
            force=0.2 * force * rng.normal(size=3),
            follower=bool(seed % 2),
        )
        load = load.replace(point_loads=point)
    model = bs.RodModel(elements=int(rng.choice([1, 1, 2, 4])))
    direction = {
        "gravity": rng.normal(size=3) * 3.0,
        "tip_force": force * rng.normal(size=3),
        "tip_moment": moment * rng.normal(size=3),
    }
    if seed % 2:  # displacements of a pose at hand, so that they do not conflict
        at_hand = bs.solve(robot, load=load, model=model).raise_for_status().displacements()
        # tendons without tension are let out further, so that they are slack
        at_hand = at_hand - 0.1 * arm * (tensions == 0.0)
        load = load.replace(tensions=None, displacements=at_hand)
        direction["displacements"] = 0.05 * arm * rng.normal(size=count)
    else:
        direction["tensions"] = np.where(tensions > 0.0, rng.normal(size=count), 0.0)
    for name in rng.choice(NUMBERS, 2, replace=False):
        size = {"segments.0.length": 0.3, "pitch_radius": arm, "segments.*.backbone.E": 1e10}
        direction[name] = size.get(name, 1e-3) * rng.normal()
    return bs.solve(robot, load=load, model=model).raise_for_status(), direction


VECTORS = ("gravity", "tip_force", "tip_moment", "tensions", "displacements")


def moved(solution: bs.Solution, direction: dict[str, Any], s: float) -> bs.Solution:
    """Solve at a place on the line."""
    robot, load, known = solution.robot, solution.load, dict(numbers_of(solution.robot))
    changes, numbers = {}, {}
    for name, rate in direction.items():
        if name not in VECTORS:
            numbers |= {path: known[path] + s * rate for path in full_paths(robot, name)}
        else:
            changes[name] = np.asarray(getattr(load, name)) + s * np.asarray(rate)
    other = robot.with_(numbers) if numbers else robot
    found = bs.solve(other, load=load.replace(**changes), model=solution.model)
    assert found.converged
    return found


def row(found: bs.Solution | Rates) -> Floats:
    """Position of the tip, lengths and positions of the disks."""
    tip = found.tip.position if isinstance(found, bs.Solution) else found.tip_position
    lengths = found.tendon_lengths if isinstance(found, bs.Solution) else found.lengths
    return np.concatenate([tip, lengths, found.disk_positions.ravel()])


def differenced(
    solution: bs.Solution, direction: dict[str, Any], of: Any, step: float
) -> tuple[Floats, float]:
    """Central difference with two extrapolations, and its relative error."""
    for _ in range(8):
        slopes = []
        for h in (step, step / 2, step / 4):
            up, down = (of(moved(solution, direction, s * h)) for s in (1, -1))
            slopes.append((up - down) / (2 * h))
        first = [(4 * b - a) / 3 for a, b in pairwise(slopes)]
        error = np.abs(first[1] - first[0]).max() / np.abs(first[1]).max()
        if error < 3e-8:  # larger where a tendon becomes slack within the step
            break
        step *= 0.4
    return (16 * first[1] - first[0]) / 15, error


def step_of(robot: bs.Robot, found: DirectionalDerivatives) -> float:
    """Step that moves the tip by at most 1 % of the length or a rotation of 0.01."""
    sizes = (found.first.tip_rotation, found.first.tip_position / robot.length)
    return 0.01 / max(np.linalg.norm(size) for size in sizes)


def check_cases(seeds: range) -> None:
    """First derivatives equal differences of solutions to 1e-7."""
    by_displacement = slack = 0
    for seed in seeds:
        solution, direction = case(seed)
        found = bs.directional_derivatives(solution, direction)
        expected, _ = differenced(solution, direction, row, step_of(solution.robot, found))
        error = np.abs(row(found.first) - expected).max() / np.abs(expected).max()
        assert error < 1e-7, (seed, error)
        assert found.relative_error < 1e-6
        by_displacement += "displacements" in direction
        slack += bool(solution.slack)
    # so that both are tried
    assert by_displacement > 0.3 * len(seeds)
    assert slack > 0.2 * len(seeds)


def test_random_cases_equal_differences() -> None:
    check_cases(range(40))


@pytest.mark.slow
def test_many_random_cases_equal_differences() -> None:
    """With the 40 above they show a fault in one of 100 cases with a probability of 95 %."""
    check_cases(range(40, 300))


def test_second_derivatives_equal_differences_of_first_ones() -> None:
    for seed in range(12):
        solution, direction = case(seed)
        found = bs.directional_derivatives(solution, direction)
        step = step_of(solution.robot, found)

        def of(near: bs.Solution) -> Floats:
            first = bs.directional_derivatives(near, direction).first  # noqa: B023
            return np.concatenate([row(first), 1e-3 * first.tensions])

        expected, error = differenced(solution, direction, of, step)
        own = np.concatenate([row(found.second), 1e-3 * found.second.tensions])
        assert np.abs(own - expected).max() < max(1e-5, 10 * error) * np.abs(expected).max(), seed
        # of the rotation: that from the equilibrium to the moved tip
        at = [moved(solution, direction, s * step).tip.rotation for s in (1, 0, -1)]
        turned = [Rotation.from_matrix(r @ at[1].T).as_rotvec() for r in at]
        expected = (turned[0] + turned[2]) / step**2
        size = np.abs(found.second.tip_rotation).max()
        assert np.abs(found.second.tip_rotation - expected).max() < 1e-2 * size


def test_tensions_and_tip_loads_equal_the_elimination() -> None:
    """Where `jacobians` has the derivatives by its own equations, both agree."""
    robot = bs.load_robot("crl-ftdcr-v4")
    load = bs.Load([1, 0, 2, 0, 1, 0, 0.5, 0, 1], tip_force=[0.02, 0, 0.01])
    solution = bs.solve(robot, load=load)
    expected = bs.jacobians(solution)
    found = bs.derivatives(solution, by=["tensions", "tip_force", "tip_moment"])
    for of in ("tip_position", "tip_rotation", "lengths"):
        for by in ("tension", "tip_force", "tip_moment"):
            own = found[of, by if by.startswith("tip") else "tensions"]
            other = getattr(expected, f"{of}_by_{by}")
            np.testing.assert_allclose(own, other, rtol=0, atol=1e-10 * np.abs(other).max())
    for k in range(3):
        path = f"segments.{k}.backbone.E"
        own = bs.derivatives(solution, by=[path])["tip_position", path]
        other = expected.tip_position_by_stiffness[:, k]
        size = robot.segments[k].backbone.E
        np.testing.assert_allclose(own * size, other, rtol=0, atol=1e-9 * np.abs(other).max())


GROWING = itertools.count(1)
ELASTIC = {"axial_stiffness": 20e3, "free_length": 0.3, "compliance": 1e-5, "pretension": 2.0}


@pytest.mark.parametrize(
    ("robot", "displacements"),
    [
        (AMOURI, bs.solve(AMOURI, [20, 5, 3]).displacements()),
        (AMOURI, [0.02, -0.03, -0.03]),  # two are slack
        (with_tendons(AMOURI, ELASTIC), [0.02, -0.005, -0.03]),
        (RAO, bs.solve(RAO, [1, 0.5, 0.4, 0.5, 0.8, 0.6]).displacements()),
    ],
)
def test_displacements_equal_the_jacobian(robot: bs.Robot, displacements: Any) -> None:
    bent = bs.solve(robot, load=bs.Load(displacements=displacements)).raise_for_status()
    expected = bs.displacement_jacobian(bent)
    found = bs.derivatives(bent)
    assert (expected.tip_position_by_displacement[:, bent.tensions == 0] == 0).all()
    for of in ("tip_position", "tip_rotation", "tensions", "lengths"):
        other = getattr(expected, f"{of}_by_displacement")
        own = found[of, "displacements"]
        np.testing.assert_allclose(own, other, rtol=0, atol=1e-8 * np.abs(other).max())


def loaded() -> bs.Solution:
    # nu given, so that the shear modulus changes with E
    robot = RAO.with_({"segments.*.backbone.nu": 0.3})
    load = bs.Load(
        [30, 0, 12, 0, 6, 0],
        gravity=[0, 0, 0],
        tip_force=[0.1, 0.3, -0.2],
        tip_moment=[0.0, 0.01, 0.02],
    )
    return bs.solve(robot, load=load, model=bs.RodModel(elements=2))


def test_stiffness_and_loads_in_proportion_keep_the_shape() -> None:
    solution = loaded()
    load, robot = solution.load, solution.robot
    loads = {name: getattr(load, name) for name in ("tensions", "tip_force", "tip_moment")}
    young = robot.segments[0].backbone.E
    found = bs.directional_derivatives(solution, {**loads, "segments.*.backbone.E": young})
    for rates, bound in ((found.first, 1e-10), (found.second, 1e-7)):
        assert np.abs(rates.disk_positions).max() < bound * robot.length
        assert np.abs(rates.tip_rotation).max() < bound
        assert np.abs(rates.lengths).max() < bound * robot.length
    # the energy is in proportion to the stiffness
    energy = float(solution.to_dataset().elastic_energy.squeeze())
    assert found.first.elastic_energy == pytest.approx(energy, rel=1e-3)
    assert abs(found.second.elastic_energy) < 1e-6 * energy


def test_the_work_of_the_loads_is_the_change_of_energy() -> None:
    solution = loaded()
    load = solution.load
    found = bs.directional_derivatives(
        solution,
        {"tensions": [1, 0, -0.5, 2, 0, 1], "tip_force": [0.1, 0, 0.2], "tip_moment": [0, 1e-2, 0]},
    ).first
    work = (
        load.tip_force @ found.tip_position
        + load.tip_moment @ found.tip_rotation
        - load.tensions @ found.lengths
    )
    assert found.elastic_energy == pytest.approx(work, rel=1e-9)


def test_the_unloaded_robot_grows_with_its_segment() -> None:
    robot = AMOURI.with_({"gravity": [0, 0, 0]})
    path = "segments.0.length"
    by = bs.derivatives(bs.solve(robot, [0, 0, 0]), by=[path])
    np.testing.assert_allclose(by["tip_position", path], [0, 0, 1], atol=1e-10)
    np.testing.assert_allclose(by["lengths", path], [1, 1, 1], atol=1e-10)
    # disks in equal distances
    rise = np.arange(1, 10) / 9
    np.testing.assert_allclose(by["disk_positions", path][:, 2], rise, atol=1e-10)


def test_functions_of_neighbours() -> None:
    """Frequencies and stress in proportion to the stiffness, at a constant shape."""
    solution = loaded()
    load, robot = solution.load, solution.robot
    load = load.replace(tip_moment=None)  # as it has no potential
    solution = bs.solve(robot, load=load, model=solution.model)
    path = "segments.*.backbone.E"
    found = bs.derivatives(
        solution,
        by=["tensions", "tip_force", path],
        functions={
            "stress": lambda near: float(near.to_dataset().von_mises_max.squeeze()),
            "frequency": lambda near: (
                bs.modes(near.robot, load=near.load, model=near.model, count=3).frequency_hz
            ),
        },
    )
    young = robot.segments[0].backbone.E
    frequency = bs.modes(robot, load=load, model=solution.model, count=3).frequency_hz
    stress = float(solution.to_dataset().von_mises_max.squeeze())
    for of, value, power in (("frequency", frequency, 0.5), ("stress", stress, 1.0)):
        total = (
            found[of, "tensions"] @ load.tensions
            + found[of, "tip_force"] @ load.tip_force
            + found[of, path] * young
        )
        np.testing.assert_allclose(total, power * value, rtol=1e-6)


def test_a_just_taut_tendon_has_two_derivatives() -> None:
    robot = AMOURI.with_({"gravity": [0, 0, 0]})
    home = bs.solve(robot, load=bs.Load(displacements=[0, 0, 0]))
    sides = []
    for side in (1, -1):
        found = bs.directional_derivatives(home, {"displacements": [side, side, 0]})
        assert found.just_taut == (1, 2, 3)
        h = 1e-5
        near = bs.solve(robot, load=bs.Load(displacements=[side * h, side * h, 0]))
        expected = (near.tip.position - home.tip.position) / h
        size = max(np.abs(expected).max(), 1e-3)
        np.testing.assert_allclose(found.first.tip_position, expected, atol=2e-3 * size)
        np.testing.assert_allclose(found.first.tensions, near.tensions / h, rtol=2e-3, atol=1)
        sides.append(found.first.tensions)
    assert (sides[0] > 0).any()
    assert (sides[1] == 0).all()  # all of them let out, or slack


def test_a_number_at_its_limit_has_a_one_sided_derivative() -> None:
    robot = bs.load_robot("amouri2019")
    path = "segments.0.disks.clamped_length"
    assert robot.segments[0].disks.clamped_length == 0
    solution = bs.solve(robot, [40, 0, 0], model=bs.RodModel(elements=1))
    found = bs.derivatives(solution, by=[path])["tip_position", path]
    h = 1e-6
    near = bs.solve(robot.with_({path: h}), [40, 0, 0], model=bs.RodModel(elements=1))
    expected = (near.tip.position - solution.tip.position) / h
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(
    ("direction", "said"),
    [
        ({}, "the direction is zero; give the change of at least one number"),
        ({"tensions": [0, 0, 0]}, "the direction is zero"),
        ({"tensions": [1, 0]}, "tensions is .*, it must be finite numbers of shape (3,)"),
        ({"tip_force": [np.nan, 0, 0]}, "tip_force is .*, it must be finite numbers of shape (3,)"),
        ({"tensoins": 1.0}, 'amouri2019 has no number "tensoins"; did you mean'),
        ({"segments.0.disks.count": 1.0}, "no derivative by segments.0.disks.count: it is a whole"),
        ({"friction": 0.1}, "no derivative by friction: with friction"),
        ({"gravity.z": 1.0}, "gravity is a vector of the load: write gravity"),
        ({"displacements": [1, 0, 0]}, "tendon 1 has a given tension, so that displacements"),
        ([1, 2], "direction is .*, it must be a mapping"),
        ({"angles": [1, 0, 0]}, 'no number "angles"'),
    ],
)
def test_wrong_directions_are_refused(direction: Any, said: str) -> None:
    solution = bs.solve(AMOURI, [40, 0, 0])
    pattern = re.escape(said).replace(r"\.\*", ".*")
    with pytest.raises(InputError, match=pattern):
        bs.directional_derivatives(solution, direction)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"by": "tensions"}, "by is 'tensions', it must be a list"),
        ({"by": 3}, "it must be a list of variables"),
        ({"by": iter(["tip_force"])}, "it must be a list of variables"),
        ({"by": ["displacements"]}, "every tendon has a given tension"),
        ({"functions": {"lengths": lambda near: 0.0}}, "functions has lengths, which is a result"),
        ({"functions": {"of": lambda near: "x"}}, "must return a number or an array"),
        ({"functions": {"of": lambda near: None}}, "must return a number or an array"),
        (
            {"functions": {"of": lambda near: np.zeros(next(GROWING))}},
            r"of has shape \(1,\) at one solution and \(2,\)",
        ),
        ({"solution": 3}, "solution is 3, it must be one made by"),
        (
            {"solution": bs.solve(with_tendons(AMOURI, {"friction": 0.1}), [40, 0, 0])},
            "friction",
        ),
        (
            {"solution": bs.solve(AMOURI, [4, 0, 0], model=bs.RodModel(tendon_path="continuous"))},
            "continuous",
        ),
    ],
)
def test_wrong_arguments_are_refused(given: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        bs.derivatives(**{"solution": bs.solve(AMOURI, [40, 0, 0]), **given})


def test_unknown_results_and_missing_solutions_are_refused() -> None:
    solution = bs.solve(AMOURI, [40, 0, 0])
    found = bs.derivatives(solution, by=["tip_force"])
    with pytest.raises(InputError, match="the variable must be one of tip_force"):
        found["lengths", "tensions"]
    assert {of for of, _ in found.values} == set(QUANTITIES)
    with pytest.raises(NoSolutionError):
        bs.derivatives(bs.solve(AMOURI, [1e6, 0, 0]))
    with pytest.raises(NoSolutionError):  # not a ZeroDivisionError
        bs.directional_derivatives(solution, {"tensions": [5e-324, 0, 0]})


def checked(solution: bs.Solution, path: str, side: int = 0) -> float:
    """Error of a derivative against differences of solutions."""
    direction = {path: dict(numbers_of(solution.robot))[path] or 1.0}
    found = bs.directional_derivatives(solution, direction)
    assert found.relative_error < 1e-7

    def numbers(s: float) -> Floats:
        near = solution if s == 0.0 else moved(solution, direction, s)
        return np.concatenate([row(near), 1e-3 * near.tensions])

    step = 2e-3
    if side == 0:
        slopes = [(numbers(h) - numbers(-h)) / (2 * h) for h in (step, step / 2)]
        expected = (4 * slopes[1] - slopes[0]) / 3
    else:
        slopes = [(numbers(h) - numbers(0.0)) / h for h in (step, step / 2, step / 4)]
        halves = [2 * b - a for a, b in pairwise(slopes)]
        expected = (4 * halves[1] - halves[0]) / 3
    own = np.concatenate([row(found.first), 1e-3 * found.first.tensions])
    return float(np.abs(own - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize(
    "path",
    [
        "segments.0.tendons.pretension",
        "segments.0.tendons.turns",
        "segments.0.tendons.end_pitch_radius",
        "segments.0.tendons.axial_stiffness",
        "segments.0.length",
        "segments.0.backbone.rest_bend",
    ],
)
def test_displacements_keep_to_the_home_pose(path: str) -> None:
    """Numbers that change the home pose, with elastic tendons that are not parallel."""
    elastic = {"pretension": 2.0, "axial_stiffness": 3e4, "turns": 0.3, "end_pitch_radius": 0.02}
    robot = with_tendons(AMOURI.with_({"segments.0.backbone.rest_bend": 0.5}), elastic)
    bent = bs.solve(robot, [14, 6, 4], model=bs.RodModel(elements=2))
    held = bs.Load(displacements=bent.displacements())
    assert checked(bs.solve(robot, load=held, model=bent.model), path) < 1e-6


def test_the_home_pose_at_no_pretension() -> None:
    robot = bs.load_robot("rao2021")
    model = bs.RodModel(elements=2)
    bent = bs.solve(robot, [8, 1, 3, 2, 6, 4], model=model)
    solution = bs.solve(robot, load=bs.Load(displacements=bent.displacements()), model=model)
    # the home pose is differentiated, not solved to a tolerance
    assert checked(solution, "segments.0.tendons.0.pretension", side=1) < 5e-8


def test_a_point_load_that_leaves_a_disk_is_refused() -> None:
    robot = bs.load_robot("amouri2019")
    for arc_length in (robot.length, robot.length / 9):
        touch = bs.PointLoad(arc_length=arc_length, force=[0.1, 0, 0])
        solution = bs.solve(robot, [0, 0, 0], load=bs.Load(point_loads=touch))
        with pytest.raises(InputError, match="a point load at an arc length comes to a disk"):
            bs.directional_derivatives(solution, {"segments.0.length": 1.0})
        bs.directional_derivatives(solution, {"tensions": [1, 0, 0], "segments.0.backbone.E": 1e8})


def test_the_inertia_of_a_payload_has_no_effect() -> None:
    robot = bs.load_robot("amouri2019").model_dump(mode="json", exclude_none=True)
    payload = {"mass": 0.1, "centre": [0.02, 0.0, 0.0], "inertia": [0.0, 0.0, 0.0]}
    robot = bs.Robot.model_validate({**robot, "payloads": [payload]})
    solution = bs.solve(robot, [14, 6, 0], load=bs.Load(gravity=[0, 0, -9.81]))
    equal = {f"payloads.0.inertia.{q}": 1e-5 for q in range(3)}
    found = bs.directional_derivatives(solution, equal)
    assert np.abs(found.first.tip_position).max() < 1e-7  # rounding, m per 1e-5 kg m^2
    with pytest.raises(InputError, match="the largest moment of inertia"):
        bs.directional_derivatives(solution, {"payloads.0.inertia.0": 1e-5})
