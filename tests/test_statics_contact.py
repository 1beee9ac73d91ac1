"""Tip on a plane: closed forms, an independent shooting method, Coulomb friction, the command."""

from __future__ import annotations

import pickle
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq, fsolve
from scipy.special import ellipe, ellipk

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.errors import InputError, NoSolutionError
from objects import refused
from shell import Shell
from shooting import Shooting

ROBOT = bs.load_robot("amouri2019")
ROD = ROBOT.with_({"segments.0.disks.mass": "0 g"})
LENGTH = ROBOT.length
BENDING = float(ROBOT.bending_stiffness[0])
FORCE = BENDING / LENGTH**2
WEIGHT = float(ROD.mass_per_length[0])
FINE = bs.RodModel("kirchhoff", elements=8)
WALL = bs.Plane([0.15, 0, 0], [-1, 0, 0])
FREE = [0.0, 0.0, 0.0]


def pose(contact: bs.ContactSolution) -> Floats:
    solution = contact.raise_for_status().solution
    return solution.tip.position


def split(contact: bs.ContactSolution) -> tuple[float, Floats]:
    """Normal force and friction force."""
    normal = np.array(contact.plane.normal)
    return contact.normal_force, contact.force - contact.normal_force * normal


def is_contact(contact: bs.ContactSolution) -> None:
    """Hold a contact to its conditions."""
    tip, (normal, tangential) = pose(contact), split(contact)
    plane, scale = contact.plane, max(FORCE, float(np.linalg.norm(contact.force)))
    assert contact.residual <= 1e-9
    assert plane.gap(tip) == pytest.approx(contact.gap, abs=1e-12)
    assert np.linalg.norm(tangential) <= plane.friction * normal + 1e-9 * scale
    if contact.state == "separated":
        assert contact.gap >= -1e-9 * LENGTH and not contact.force.any()
        return
    assert normal > 0 and abs(contact.gap) <= 1e-9 * LENGTH
    if contact.state == "sliding":
        assert np.linalg.norm(tangential) == pytest.approx(
            plane.friction * normal, abs=1e-9 * scale
        )


# --------------------------------------------------------------------------------------
# Without friction
# --------------------------------------------------------------------------------------


def test_a_propped_cantilever() -> None:
    gravity = np.array([-0.1, 0.0, 0.0])  # deflection of 4e-4 of the length without the support
    load, plane = bs.Load(FREE, gravity=gravity), bs.Plane([0, 0, 0], [2, 0, 0])
    contact = bs.solve_contact(ROD, load=load, model=FINE, plane=plane)
    is_contact(contact)
    total = WEIGHT * LENGTH * 0.1
    assert contact.normal_force == pytest.approx(3 / 8 * total, rel=1e-6)
    assert contact.stable is True and contact.state == "sliding"
    solution = contact.solution
    x, z = solution.disk_positions[:, 0], solution.disk_positions[:, 2] / LENGTH
    sag = -total * LENGTH**3 / (48 * BENDING) * (3 * z**2 - 5 * z**3 + 2 * z**4)
    np.testing.assert_allclose(x, sag, atol=1e-6 * np.abs(sag).max())
    assert contact.disks_beyond == tuple(np.flatnonzero(x[:-1] < -1e-6 * LENGTH) + 1) != ()
    assert "act" in contact.warnings()[0]


def test_a_rod_that_buckles_under_a_plane() -> None:
    height = 0.9
    modulus = brentq(lambda m: 2 * ellipe(m) / ellipk(m) - 1 - height, 1e-6, 0.9)
    plane = bs.Plane([0, 0, height * LENGTH], [0, 0, -1])
    contact = bs.solve_contact(ROBOT, FREE, model=FINE, plane=plane)
    is_contact(contact)
    assert contact.normal_force == pytest.approx(ellipk(modulus) ** 2 * FORCE, rel=1e-6)
    across = 2 * np.sqrt(modulus) / ellipk(modulus) * LENGTH
    assert np.linalg.norm(pose(contact)[:2]) == pytest.approx(across, rel=1e-6)


@pytest.mark.parametrize(
    ("pull", "point", "normal"),
    [
        ((-1000.0, 0.0), (-0.2, 0, 0), (1, 0, 0.1)),
        ((100.0, -60.0), (-0.2, 0, 0.4), (0.6, 0, -1)),
        ((3000.0, -500.0), (0.15, 0, 0), (-1, 0, 0.3)),
    ],
)
def test_large_deflection_against_shooting(
    pull: tuple[float, float], point: tuple[float, ...], normal: tuple[float, ...]
) -> None:
    gravity = [pull[0], 0.0, pull[1]]
    plane = bs.Plane(point, normal)
    load = bs.Load(FREE, gravity=gravity)
    contact = bs.solve_contact(ROD, load=load, model=FINE, plane=plane)
    is_contact(contact)
    solution = contact.solution
    tilt = np.arctan2(solution.disk_rotations[:, 0, 2], solution.disk_rotations[:, 2, 2])
    assert np.abs(tilt).max() > 0.3  # far from small
    at_tip = bs.PointLoad(arc_length=LENGTH, force=contact.force)
    force = contact.force + WEIGHT * LENGTH * np.array(gravity)
    near = [*force, 0.0, BENDING * tilt[0] * 9 / LENGTH, 0.0]
    exact = Shooting(ROD, solution, [at_tip]).solve(near)[0]
    np.testing.assert_allclose(solution.disk_positions, exact, atol=1e-8 * LENGTH)


def test_objectivity() -> None:
    turn = np.array([[-0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), -0.5, 0], [0, 0, 1]])
    weight, point, normal = np.array([-1.0, 2.0, -4.0]), np.array([0.2, 0.02, 0]), [-1, 0.3, -0.2]
    for friction in (0.0, 0.3):
        rows = [np.array([60.0, 5.0, 0.0]), np.array([40.0, 20.0, 0.0])]
        here, there = (
            bs.sweep_contact(
                ROBOT,
                np.roll(rows, shift, axis=1),
                load=bs.Load(gravity=axes @ weight, tip_force=axes @ [0, 0.1, 0]),
                plane=bs.Plane(axes @ point, axes @ normal, friction),
            )
            for axes, shift in ((np.eye(3), 0), (turn, 1))
        )
        for a, b in zip(here, there, strict=True):
            assert a.state == b.state != "separated"
            np.testing.assert_allclose(pose(b), turn @ pose(a), atol=1e-8 * LENGTH)
            np.testing.assert_allclose(b.force, turn @ a.force, atol=1e-6 * FORCE)


def test_a_tip_that_does_not_reach_the_plane_is_that_of_solve() -> None:
    contact = bs.solve_contact(ROBOT, [20, 0, 0], plane=WALL)
    is_contact(contact)
    assert (contact.state, contact.stable, contact.point) == ("separated", True, None)
    free = bs.solve(ROBOT, [20, 0, 0])
    np.testing.assert_allclose(pose(contact), free.tip.position, atol=1e-12)
    assert contact.gap == pytest.approx(0.15 - free.tip.position[0], abs=1e-12)
    assert "mm from the plane" in contact.message


def test_the_contact_force_is_a_dead_tip_force() -> None:
    dead = bs.Load([40, 0, 0], gravity=[0, 1, -9.81], tip_force=[0, 0, -0.2])
    contact = bs.solve_contact(ROBOT, load=dead, plane=WALL)
    again = bs.solve(ROBOT, load=dead.replace(tip_force=contact.force + dead.tip_force))
    assert again.tip is not None and again.stable
    np.testing.assert_allclose(pose(contact), again.tip.position, atol=1e-9 * LENGTH)


def test_displacement_control() -> None:
    commands = [0.015, -0.004, -0.02]
    free = bs.solve(ROBOT, load=bs.Load(displacements=commands))
    plane = bs.Plane([0.8 * free.tip.position[0], 0, 0], [-1, 0, 0])
    for friction in (0.0, 0.3):
        plane = bs.Plane(plane.point, plane.normal, friction)
        contact = bs.solve_contact(ROBOT, load=bs.Load(displacements=commands), plane=plane)
        is_contact(contact)
        assert contact.state == "sliding"
        tensions = contact.solution.tensions
        assert tensions[0] > free.tensions[0]
        held = np.flatnonzero(tensions > 0)
        found = contact.solution.displacements()
        np.testing.assert_allclose(found[held], np.array(commands)[held], atol=1e-12)


def test_stability_is_not_claimed_where_it_is_not_proven() -> None:
    load = bs.Load([40, 0, 0], tip_moment=[0, 0.05, 0])
    with pytest.warns(bs.errors.StabilityWarning, match="not known to be stable"):
        contact = bs.solve_contact(ROBOT, load=load, plane=WALL).raise_for_status()
    assert contact.stable is None
    rough = bs.Plane(WALL.point, WALL.normal, 0.2)
    assert bs.solve_contact(ROBOT, [40, 0, 0], plane=rough).stable is None


def test_a_contact_needs_few_solves(monkeypatch: pytest.MonkeyPatch) -> None:
    from bowstring.statics import contact_problem as contact

    solves, plain = [], contact.ContactProblem.at
    monkeypatch.setattr(
        contact.ContactProblem, "at", lambda *args: solves.append(args) or plain(*args)
    )
    assert bs.solve_contact(ROBOT, [40, 0, 0], plane=WALL).converged
    assert len(solves) <= 7


# --------------------------------------------------------------------------------------
# With friction
# --------------------------------------------------------------------------------------


def rough_path(friction: float, rows: Any, **options: Any) -> tuple[bs.ContactSolution, ...]:
    plane = bs.Plane(WALL.point, WALL.normal, friction)
    found = bs.sweep_contact(ROBOT, rows, plane=plane, **options)
    for each in found:
        is_contact(each)
    return found


CYCLE = [
    *([t, 0, 0] for t in (36, 38, 40)),
    *([40, t, 0] for t in (0.5, 1, 2, 4, 8, 7, 6, 4, 2, 0)),
    *([40, 0, t] for t in (0.5, 1, 2, 4, 8, 4, 0)),
]


@pytest.mark.parametrize("friction", [0.02, 0.2, 0.6])
def test_friction_opposes_the_slip_and_dissipates(friction: float) -> None:
    rows = rough_path(friction, CYCLE)
    lost, states = 0.0, set()
    for before, after in pairwise(rows):
        slip, (normal, tangential) = pose(after) - pose(before), split(after)
        states.add(after.state)
        lost -= float(tangential @ slip)
        assert tangential @ slip <= 1e-12
        if after.state == "sticking":
            assert np.linalg.norm(slip) <= 1e-9 * LENGTH
        elif np.linalg.norm(slip) > 1e-6 * LENGTH:
            along = slip / np.linalg.norm(slip)
            np.testing.assert_allclose(tangential, -friction * normal * along, atol=1e-4 * FORCE)
    assert lost > 0 and "sliding" in states
    assert "sticking" in states or friction < 0.1


def test_a_pulled_cantilever_sticks_slides_and_sticks_again() -> None:
    """Small deflections: the support holds 3/8 of the weight, its friction a transverse force."""
    gravity, friction = np.array([-0.01, 0.0, 0.0]), 0.4
    plane = bs.Plane([0, 0, 0], [1, 0, 0], friction)
    limit = friction * 3 / 8 * WEIGHT * LENGTH * 0.01
    shares = np.array([0.0, 0.5, 0.95, 1.5, 2.0, 1.5, 0.1, -1.0, 0.9])
    #: where the tip is: it sticks while the force is within the limit of that of the last slip
    at = [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 0.0, 0.0]
    force = np.outer(shares * limit, [0, 1, 0])
    load = bs.Load(np.zeros((9, 3)), gravity=gravity, tip_force=force)
    rows = bs.sweep_contact(ROD, load=load, model=FINE, plane=plane)
    unit = limit * LENGTH**3 / (3 * BENDING)
    np.testing.assert_allclose([pose(row)[1] / unit for row in rows], at, atol=1e-4)
    states = [row.state for row in rows[1:]]
    stick, slide = "sticking", "sliding"
    assert states == [stick, stick, slide, slide, stick, stick, slide, stick]


def test_much_friction_pins_the_tip() -> None:
    rows = [[40, 0, 0], [40, 2, 0], [40, 8, 0], [40, 5, 3]]
    found = rough_path(5.0, rows)
    anchor = found[0].point
    for row, contact in zip(rows[1:], found[1:], strict=True):
        assert contact.state == "sticking"
        assert np.linalg.norm(pose(contact) - anchor) <= 1e-9 * LENGTH

        def misses(force: Floats, row: list[int] = row) -> Floats:
            solution = bs.solve(ROBOT, load=bs.Load(row, tip_force=force))
            assert solution.tip is not None
            return (solution.tip.position - anchor) / LENGTH

        pinned = fsolve(misses, contact.force + 0.01 * FORCE, xtol=1e-13)
        np.testing.assert_allclose(contact.force, pinned, atol=1e-4 * FORCE)


def test_a_tip_pushed_straight_at_the_plane_sticks_where_it_touched() -> None:
    """The plane takes what exceeds the tip force at which the free tip reaches it."""
    plane = bs.Plane(WALL.point, WALL.normal, 0.01)
    push = 1.5 * FORCE

    def free(force: float) -> Floats:
        tip = bs.solve(ROBOT, load=bs.Load(FREE, tip_force=[force, 0, 0])).tip
        return tip.position

    reached = brentq(lambda force: plane.gap(free(force)), 0, push, xtol=1e-13)
    contact = bs.solve_contact(ROBOT, load=bs.Load(FREE, tip_force=[push, 0, 0]), plane=plane)
    is_contact(contact)
    assert contact.state == "sticking" and contact.point is not None
    np.testing.assert_allclose(contact.point, free(reached), atol=1e-9 * LENGTH)
    np.testing.assert_allclose(contact.force, [reached - push, 0, 0], atol=1e-4 * FORCE)


def test_no_friction_is_the_limit_of_little_friction() -> None:
    for row in ([40, 0, 0], [60, 8, 3]):
        rough = rough_path(1e-7, [row])[0]
        smooth = bs.solve_contact(ROBOT, row, plane=WALL)
        is_contact(smooth)
        np.testing.assert_allclose(rough.force, smooth.force, atol=1e-5 * FORCE)
        np.testing.assert_allclose(pose(rough), pose(smooth), atol=1e-5 * LENGTH)


def test_finer_steps_change_little_and_rows_continue_calls() -> None:
    coarse = rough_path(0.3, [[40, 0, 0], [40, 8, 0]])
    fine = rough_path(0.3, [[40, 0, 0], *([40, t, 0] for t in np.linspace(0, 8, 17))])
    assert np.linalg.norm(pose(coarse[-1]) - pose(fine[-1])) < 0.002 * LENGTH
    again = bs.solve_contact(ROBOT, [40, 8, 0], plane=coarse[0].plane, previous=coarse[0])
    np.testing.assert_allclose(again.force, coarse[-1].force, atol=1e-9 * FORCE)


def test_a_tip_that_leaves_the_plane_forgets_its_place() -> None:
    rows = rough_path(0.3, [[40, 0, 0], [10, 0, 0], [40, 0, 0]])
    assert [row.state == "separated" for row in rows] == [False, True, False]
    np.testing.assert_allclose(rows[2].force, rows[0].force, atol=1e-5 * FORCE)


def test_a_row_without_a_solution_does_not_end_the_path() -> None:
    rows = bs.sweep_contact(
        ROBOT,
        load=bs.Load(displacements=[[0.01, -0.01, -0.01], [0.2, 0.2, 0.2], [0.02, -0.01, -0.02]]),
        plane=bs.Plane([0.1, 0, 0], [-1, 0, 0], 0.1),
    )
    assert [row.converged for row in rows] == [True, False, True]
    bad = rows[1]
    assert bad.solution is None and bad.state is None and np.isnan(bad.force).all()
    with pytest.raises(NoSolutionError, match="smaller steps"):
        bad.raise_for_status()
    with pytest.raises(InputError, match="did not converge"):
        bs.solve_contact(ROBOT, FREE, plane=bad.plane, previous=bad)


@pytest.mark.parametrize("name", bs.robot_names())
def test_random_planes(name: str) -> None:
    """The contact conditions hold on planes between the free tip and the home pose."""
    rng, robot = np.random.default_rng(5), bs.load_robot(name)
    scale = float(np.min(robot.bending_stiffness)) / robot.length**2
    home, tested = np.array([0, 0, robot.length]), 0
    while tested < 12:
        tensions = rng.uniform(0, 15, robot.core.tendon_count) * scale * (rng.random() < 0.7)
        load = bs.Load(tensions, gravity=rng.normal(size=3) * 3)
        free = bs.solve(robot, load=load)
        if free.tip is None:
            continue
        back = home - free.tip.position
        normal = back / np.linalg.norm(back) + 0.4 * rng.normal(size=3)
        point = home - rng.uniform(0.1, 0.9) * back
        plane = bs.Plane(point, normal, rng.choice([0.0, 0.1, 0.3]))
        if plane.gap([0, 0, 0]) < 0 or plane.gap(home) < 0 or plane.gap(free.tip.position) > 0:
            continue
        contact = bs.solve_contact(robot, load=load, plane=plane)
        assert contact.converged and contact.state != "separated"
        assert contact.residual <= 1e-9 and abs(contact.gap) <= 1e-9 * robot.length
        assert contact.stable is (True if plane.friction == 0 else None)
        tested += 1


# --------------------------------------------------------------------------------------
# Derivatives, copies, errors
# --------------------------------------------------------------------------------------


@pytest.mark.parametrize("by_displacement", [False, True])
def test_compliance_against_differences(by_displacement: bool) -> None:
    from bowstring.statics.contact_problem import ContactProblem

    load = bs.Load([30, 5, 0])
    if by_displacement:
        load = bs.Load(displacements=[0.015, -0.004, -0.02])
    problem = ContactProblem(ROBOT, load, bs.RodModel(elements=2), WALL, None)
    force = np.array([0.1, -0.05, 0.2]) * FORCE
    here = problem.at(1.0, force)
    assert here is not None
    exact = problem.compliance(here.core)
    for i, step in enumerate(1e-4 * FORCE * np.eye(3)):
        ends = [problem.at(1.0, force + sign * step) for sign in (1, -1)]
        assert ends[0] is not None and ends[1] is not None and exact is not None
        difference = (ends[0].tip - ends[1].tip) / (2e-4 * FORCE)
        np.testing.assert_allclose(exact[:, i], difference, atol=2e-6 * np.abs(exact).max())


def test_a_copy_is_the_same() -> None:
    for contact in rough_path(0.3, [[40, 0, 0], [40, 2, 0]]):
        copy = pickle.loads(pickle.dumps(contact))
        assert copy.state == contact.state and copy.plane == contact.plane
        np.testing.assert_allclose(pose(copy), pose(contact), atol=1e-10 * LENGTH)
        rows = [each.to_dict() for each in (contact, copy)]
        assert rows[0]["force_N"] == rows[1]["force_N"]
        solution = contact.solution
        end = solution.to_dataset()["position"].values[0, -1]
        np.testing.assert_allclose(end, pose(contact), atol=1e-9 * LENGTH)
        assert solution.limits() == ((), ())


def test_a_plane() -> None:
    plane = bs.Plane(np.array([1, 2, 3]), [0, 0, -1e200], friction=1)
    assert plane == bs.Plane((1, 2, 3), (0, 0, -1), 1.0) and plane.normal == (0.0, 0.0, -1.0)
    np.testing.assert_allclose(plane.gap([[0, 0, 0], [0, 0, 5]]), [3, -2])
    for normal in ([0, 0, -1], [1, 2, 3], [-1, 1e-9, -1e-12]):
        axes = bs.Plane(FREE, normal).axes
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (([0, 0, 0], [0, 0, 0]), "normal is zero"),
        (([0, np.nan, 0], [0, 0, 1]), "point is .* finite"),
        (([0, 0, 0], [np.inf, 0, 1]), "normal is .* finite"),
        (([0, 0], [0, 0, 1]), r"point has shape \(2,\)"),
        (([0, 0, 0], "up"), "normal is 'up'"),
        (([0, 0, 0], [0, 0, 1], -0.1), "friction is -0.1, it must be zero or more"),
        (([0, 0, 0], [0, 0, 1], np.nan), "friction is nan"),
    ],
)
def test_wrong_planes(values: tuple[Any, ...], message: str) -> None:
    refused(message, lambda: bs.Plane(*values))


def test_wrong_arguments() -> None:
    sticky = ROBOT.with_({"segments.0.tendons.friction": 0.1})
    rough = bs.Plane([0, 0, 0.6], [0, 0, -1], 0.1)
    touching = bs.solve_contact(ROBOT, [40, 0, 0], plane=WALL)
    other = ROBOT.with_({"segments.0.length": "640 mm"})
    cases: list[tuple[bs.Robot, Any, dict[str, Any], str]] = [
        (ROBOT, [40, 0, 0], {"plane": 3}, "must be a bowstring.Plane"),
        (ROBOT, [40, 0], {"plane": WALL}, "tensions has 2 numbers"),
        (ROBOT, None, {"plane": WALL}, "tensions is None"),
        (ROBOT, [40, 0, 0], {"plane": bs.Plane([0.1, 0, 0], [1, 0, 0])}, "100 mm beyond the plane"),
        (ROBOT, [40, 0, 0], {"plane": rough}, "home pose of amouri2019 reaches 41 mm beyond"),
        (sticky, [40, 0, 0], {"plane": WALL}, "have friction"),
        (ROBOT, [40, 0, 0], {"plane": WALL, "previous": 1}, "must be a bowstring.ContactSolution"),
        (ROBOT, [40, 0, 0], {"plane": rough, "previous": touching}, "another plane"),
        (other, [40, 0, 0], {"plane": WALL, "previous": touching}, "another robot"),
        (
            ROBOT,
            [40, 0, 0],
            {"plane": WALL, "model": bs.RodModel(tendon_path="continuous")},
            "continuous",
        ),
    ]
    for robot, tensions, options, message in cases:
        with pytest.raises(InputError, match=message):
            bs.solve_contact(robot, tensions, **options)
    refused("one row for each load", lambda: bs.sweep_contact(ROBOT, [40, 0, 0], plane=WALL))
    with pytest.raises(InputError, match=r"gravity has shape .* 2 rows"):
        load = bs.Load(np.zeros((2, 3)), gravity=np.zeros((3, 3)))
        bs.sweep_contact(ROBOT, load=load, plane=WALL)


# --------------------------------------------------------------------------------------
# The command
# --------------------------------------------------------------------------------------

PRESSED = ("solve", "amouri2019", "--tension", "40,0,0")


def test_the_command(shell: Shell) -> None:
    expected = bs.solve_contact(ROBOT, [40, 0, 0], plane=WALL)
    found = shell.json(*PRESSED, "--plane", "150 mm,0,0:-2,0,0")
    assert found["contact"] == expected.to_dict()
    assert found["stable"] is True
    assert found["provenance"]["settings"]["plane_normal"] == [-1, 0, 0]
    rough = shell.json(*PRESSED, "--plane", "150 mm,0,0:-2,0,0", "--plane-friction", "0.3")
    assert rough["contact"]["force_N"][2] == pytest.approx(0.3 * rough["contact"]["normal_force_N"])
    assert rough["stable"] is None and "not determined" in rough["message"]
    assert shell.json(*PRESSED)["contact"] is None
    code, out, _ = shell(*PRESSED, "--plane", "150 mm,0,0:-1,0,0")
    assert code == 0 and expected.message in out
    bowed = ("--tension", "0,0,0", "--disk-force", "5:20,0,0")
    beyond = shell.json("solve", "amouri2019", *bowed, "--plane", "20 mm,0,0:-1,0,0")
    assert beyond["warnings"][0].endswith("are beyond the plane, which acts on the tip only")
    assert beyond["contact"]["disks_beyond"]


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--plane", "0.15,0,0:0,0,0"), "--plane: normal is zero"),
        (("--plane", "0.15,0,0"), '--plane: got "0.15,0,0"; must be a point'),
        (("--plane", "0.15,0:1,0,0"), "--plane: got 2 numbers"),
        (("--plane", "nan,0,0:1,0,0"), '--plane: got "nan"'),
        (("--plane", "150,0,0:-1,0,0"), "--plane: got 150 without a unit"),
        (("--plane", "0.15,0,0:1,0,0"), "--plane: the base of amouri2019 is 150 mm beyond"),
        (
            ("--plane", "1,0,0:-1,0,0", "--plane-friction", "-1"),
            "--plane-friction: got -1; must be 0 or more",
        ),
        (("--plane-friction", "0.1"), "--plane-friction: there is no plane"),
        (
            ("--plane", "1,0,0:-1,0,0", "--save-history", "h.json"),
            "--save-history: a contact is not continued",
        ),
    ],
)
def test_wrong_flags(shell: Shell, flags: tuple[str, ...], message: str) -> None:
    code, out, err = shell(*PRESSED, *flags)
    assert (code, out) == (2, "")
    assert message in err and err.count("\n") == 1


def test_point_loads_and_forces_per_length_count() -> None:
    """They act in a contact as they do without one."""
    loads = [bs.PointLoad(force=[0.2, 0.1, 0], point=[0, 0, 0.03]), bs.PointLoad(4, [0, 0.3, 0])]
    far, wall = (bs.Plane([x, 0, 0], [-1, 0, 0]) for x in (2.0, 0.06))
    for given in ({"point_loads": loads}, {"line_forces": [0, 0.4, 0]}):
        load = bs.Load([20, 0, 0], **given)
        free = bs.solve_contact(ROBOT, load=load, plane=far)
        assert free.state == "separated"
        assert np.abs(pose(free) - bs.solve(ROBOT, load=load).tip.position).max() < 1e-9
        first = bs.solve_contact(ROBOT, load=load, plane=wall)
        assert first.state == "sliding" and first.stable
        same = bs.solve(ROBOT, load=load.replace(tip_force=first.force))
        assert np.abs(same.tip.position - pose(first)).max() < 1e-9
        rows = bs.sweep_contact(ROBOT, [[10, 0, 0], [20, 0, 0]], load=bs.Load(**given), plane=wall)
        assert np.abs(pose(rows[-1]) - pose(first)).max() < 1e-8
    follower = bs.PointLoad(force=[0.3, 0, 0], follower=True)
    pushed = bs.solve_contact(ROBOT, [20, 0, 0], load=bs.Load(point_loads=follower), plane=wall)
    assert pushed.converged and pushed.stable is None
    with pytest.raises(InputError, match="same disks and points"):
        load = bs.Load([20, 0, 0], point_loads=loads)
        bs.solve_contact(ROBOT, load=load, plane=wall, previous=pushed)
