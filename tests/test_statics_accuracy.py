"""Discretisation error stated by solutions, against closed forms and finer elements."""

import math

import numpy as np
import pytest

import bowstring as bs
from bowstring.errors import InputError
from bowstring.statics.messages import discretisation
from objects import objects

SOFT = {
    "segments.0.disks.mass": "1e-6 g",
    "segments.0.backbone.E": "5 MPa",
    "segments.0.backbone.diameter": "20 mm",
}
LIGHT = {"segments.0.disks.mass": "1e-6 g"}
ELEMENTS = (None, 1, 2, 4, 8)


def study(**fields: object) -> bs.Robot:
    return bs.load_robot("amouri2019", {f"segments.0.{k}": v for k, v in fields.items()})


# --- own weight ----------------------------------------------------------------------------


@pytest.mark.parametrize("disks", [1, 9])
@pytest.mark.parametrize("elements", ELEMENTS)
def test_extension_under_own_weight(disks: int, elements: int | None) -> None:
    robot = bs.load_robot("amouri2019", {**SOFT, "segments.0.disks.count": disks})
    suspended = bs.solve(
        robot, [0, 0, 0], load=bs.Load(gravity=[0, 0, 9.81]), model=bs.RodModel(elements=elements)
    )
    young, density = 5e6, 1800.0
    stretch = density * 9.81 * robot.length**2 / (2 * young)
    assert suspended.tip.position[2] - robot.length == pytest.approx(stretch, rel=1e-6)


def heavy_beam(weight: float) -> float:
    """First frequency of an upright cantilever, over sqrt(EI / (m L^4)) in rad/s.

    `weight` is w L^3 / EI, negative where it is suspended; by Ritz with polynomials.

    """
    powers = range(2, 12)
    stiffness, mass = (np.zeros((10, 10)) for _ in range(2))
    for i, p in enumerate(powers):
        for j, q in enumerate(powers):
            bend = p * (p - 1) * q * (q - 1) / (p + q - 3)
            # compression w (L - x) times the slopes
            slope = p * q * (1 / (p + q - 1) - 1 / (p + q))
            stiffness[i, j] = bend - weight * slope
            mass[i, j] = 1 / (p + q + 1)
    inverse = np.linalg.inv(np.linalg.cholesky(mass))
    return math.sqrt(np.linalg.eigvalsh(inverse @ stiffness @ inverse.T)[0])


#: w L^3 / EI at which an upright cantilever buckles under its own weight (Greenhill 1881).
GREENHILL = 7.8373


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9, -0.9])
@pytest.mark.parametrize("elements", [None, 1, 4])
@pytest.mark.slow
def test_modes_of_a_beam_under_its_own_weight(share: float, elements: int | None) -> None:
    robot = bs.load_robot("amouri2019", LIGHT)
    bending, mass = robot.bending_stiffness[0], robot.mass_per_length[0]
    gravity = share * GREENHILL * bending / (mass * robot.length**3)
    found = bs.modes(
        robot,
        count=2,
        load=bs.Load(gravity=[0, 0, -gravity]),
        model=bs.RodModel("kirchhoff", elements=elements),
    )
    unit = math.sqrt(bending / (mass * robot.length**4)) / (2 * math.pi)
    exact = heavy_beam(share * GREENHILL) * unit
    assert found.frequency_hz == pytest.approx([exact, exact], rel=1e-3)


def test_axial_mode_of_a_light_robot() -> None:
    robot = bs.load_robot("amouri2019", {**SOFT, "segments.0.backbone.diameter": "40 mm"})
    modes = bs.modes(robot, count=40)
    axial = [f for f, kind in zip(modes.frequency_hz, modes.kind, strict=True) if kind == "axial"]
    exact = math.sqrt(5e6 / 1800.0) / (4 * robot.length)
    # linear between disks: (pi / 2 / 9)^2 / 24 too high
    assert axial[0] == pytest.approx(exact, rel=2e-3)


@pytest.mark.parametrize("theory", ["kirchhoff", "cosserat"])
def test_a_motion_starts_where_statics_is(theory: str) -> None:
    robot = bs.load_robot("amouri2019", {**SOFT, "segments.0.backbone.E": "30 MPa"})
    load = {"gravity": [1.0, 0.0, 9.81], "theory": theory}
    rest = bs.solve(robot, [5, 0, 0], **objects(**load))
    run = bs.simulate(robot, [5, 0, 0], 0.0, **objects(**load, initial_tensions=[5, 0, 0]))
    assert np.linalg.norm(run.tip_position[0] - rest.tip.position) < 2e-5 * robot.length


# --- choice of elements --------------------------------------------------------------------


@pytest.mark.parametrize("elements", [None, 8])
def test_buckling_between_disks(elements: int | None) -> None:
    robot = study(**{"disks.count": 3})
    critical = math.pi**2 * robot.bending_stiffness[0] / (robot.length / 3) ** 2
    below, above = (
        bs.solve(
            robot, [share * critical / 3] * 3, model=bs.RodModel("kirchhoff", elements=elements)
        )
        for share in (0.999, 1.001)
    )
    assert below.stable is True and "buckled" not in below.message
    assert "buckled" in above.message


def test_few_elements_do_not_report_a_buckled_column_as_stable() -> None:
    robot = study(**{"disks.count": 3})
    critical = math.pi**2 * robot.bending_stiffness[0] / (robot.length / 3) ** 2
    found = bs.solve(robot, [1.02 * critical / 3] * 3, model=bs.RodModel("kirchhoff", elements=1))
    assert found.stable is None


def test_error_near_buckling_is_estimated() -> None:
    robot = study(**{"disks.count": 3})
    load = {"tip_force": [0.2, 0, 0]}
    coarse, fine, chosen = (
        bs.solve(robot, [60] * 3, **objects(**load, elements=elements)) for elements in (1, 8, None)
    )
    error = np.linalg.norm(coarse.tip.position - fine.tip.position)
    assert error > 3e-3
    assert error <= coarse.error_estimate.tip <= 30 * error
    assert "Discretisation error" in coarse.message
    error = np.linalg.norm(chosen.tip.position - fine.tip.position)
    assert error < 1e-5 * robot.length and chosen.message == "A stable equilibrium."


def test_unreachable_tolerances_are_reported() -> None:
    found = bs.solve(bs.load_robot("amouri2019"), [650, 600, 600])
    assert found.model.elements == 8
    assert "Discretisation error: the tip by up to" in found.message


def test_tensions_of_three_taut_tendons() -> None:
    robot = study(**{"disks.count": 3})
    displacements = [2e-4, 1e-4, 1e-4]
    coarse, fine, chosen = (
        bs.solve(
            robot, load=bs.Load(displacements=displacements), model=bs.RodModel(elements=elements)
        )
        for elements in (1, 8, None)
    )
    error = np.abs(coarse.tensions - fine.tensions).max()
    assert error <= coarse.error_estimate.tension <= 30 * error
    assert np.abs(chosen.tensions - fine.tensions).max() < 1e-4 * fine.tensions.max()


@pytest.mark.parametrize("by_displacement", [True, False])
def test_error_estimates_with_friction_cover_the_error(by_displacement: bool) -> None:
    there_and_back = np.r_[np.linspace(0, 1, 8), np.linspace(0.9, 0.1, 6)]
    for seed in range(6):
        rng = np.random.default_rng(seed)
        robot = study(
            **{"tendons.friction": rng.uniform(0.1, 0.5), "tendons.compliance": "1e-5 m/N"}
        )
        most = rng.uniform(0.001, 0.012, 3) if by_displacement else rng.uniform(5, 90, 3)
        given = {"displacements" if by_displacement else "tensions": np.outer(there_and_back, most)}
        coarse, fine = (
            bs.sweep(robot, **objects(**given, elements=elements)) for elements in (1, 8)
        )
        # beyond that the coarse rod may take another branch
        known = np.cumprod(coarse.converged & fine.converged).astype(bool)
        error = np.linalg.norm(coarse.tip_position - fine.tip_position, axis=1)[known]
        stated = coarse.tip_error[known] + fine.tip_error[known]
        assert (error <= stated + 1e-12).all()
        assert known.sum() > 8


def test_a_plain_robot_keeps_one_element() -> None:
    robot = bs.load_robot("amouri2019")
    assert bs.solve(robot, [80, 0, 0]).model.elements == 1
    assert bs.solve(robot, load=bs.Load(displacements=[0.02, -0.03, -0.03])).model.elements == 1


def test_sweep_and_batch_carry_the_estimate() -> None:
    robot = study(**{"disks.count": 4})
    tensions = np.random.default_rng(0).uniform(0, 60, (60, 3))
    batch = bs.solve_batch(robot, tensions)
    path = bs.sweep(robot, np.outer(np.linspace(0, 60, 40), [1, 0.3, 0]))
    for found in (batch, path):
        assert found.converged.all()
        assert (found.tip_error <= 1e-5 * robot.length).all()
        fine = bs.solve_batch(robot, found.tensions, model=bs.RodModel(elements=8))
        error = np.linalg.norm(found.tip_position - fine.tip_position, axis=1)
        rest = fine.tip_error
        assert (error <= found.tip_error + rest).all()


def test_a_path_adds_elements_as_needed() -> None:
    robot = study(**{"disks.count": 3, "tendons.friction": 0.1})
    displacements = np.outer(np.linspace(0, 0.06, 7), [1, -1, -1])
    path = bs.sweep(robot, load=bs.Load(displacements=displacements))
    fine = bs.sweep(robot, load=bs.Load(displacements=displacements), model=bs.RodModel(elements=8))
    error = np.linalg.norm(path.tip_position - fine.tip_position, axis=1)
    assert path.converged.all()
    assert (error <= path.tip_error + fine.tip_error + 1e-9).all()
    # its history can be continued; only a path with other fixed elements rejects it
    on = bs.solve(robot, history=path.history(), load=bs.Load(displacements=[0.061, -0.06, -0.06]))
    assert on.converged
    fixed = bs.solve(
        robot, load=bs.Load(displacements=[0.01, -0.01, -0.01]), model=bs.RodModel(elements=2)
    ).history()
    with pytest.raises(InputError, match="made with elements 2"):
        bs.solve(
            robot,
            history=fixed,
            load=bs.Load(displacements=[0.02, -0.01, -0.01]),
            model=bs.RodModel(elements=1),
        )


def test_elements_and_estimate_are_in_the_json() -> None:
    content = bs.solve(bs.load_robot("amouri2019"), [80, 0, 0]).to_dict()
    assert content["elements"] == 1
    assert 1e-7 < content["error_estimate"]["tip_m"] < 6.41e-6
    assert content["error_estimate"]["tension_N"] == 0


def test_a_path_on_another_branch_says_so() -> None:
    said = discretisation((0.004, 0.0), np.array([10.0]), 0.3, 8, path=True)
    assert "another branch" in said and "4 mm" in said
    assert "another branch" not in discretisation((0.002, 0.0), np.array([10.0]), 0.3, 8, path=True)
