"""Fields of bricks: of a bar that is stretched and rotated, and of one with a large bend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bowstring as bs
from bowstring import simulate
from bowstring.fem import BrickRun, sweep
from bowstring.fem.fields import VOIGT, strain_in_base
from bowstring.statics import rod
from fem_robots import COARSE, needs_ccx, small_robot
from test_fem_vtk import YOUNG, stretched

STRAIN = 1e-4


def turned(turn: np.ndarray) -> BrickRun:
    """A uniform axial strain of 1e-4, then a rotation: stress rotates with it, strain does not."""
    run = stretched(STRAIN)
    (state,) = run.states
    place = (run.mesh.nodes + state.displacement) @ turn.T
    tensor = turn @ state.stress[..., VOIGT] @ turn.T
    stress = tensor[..., (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)]
    run.states[0] = replace(state, displacement=place - run.mesh.nodes, stress=stress)
    return run


@pytest.mark.parametrize("angle", [0.0, 30.0, 90.0, 180.0])
def test_a_rotation_keeps_energy_and_rotates_strain_and_stress(angle: float) -> None:
    run = turned(Rotation.from_euler("yx", [angle, 20.0], degrees=True).as_matrix())
    free = small_robot().length - 1.5 * 3e-3  # two disks of 3 mm, the half of one beyond
    expected = 0.5 * YOUNG * STRAIN**2 * np.pi / 4 * 0.005**2 * free
    energy = run.to_dataset().elastic_energy.item()
    assert energy == pytest.approx(expected, rel=0.02)  # of 4 bricks around
    # a material with uniaxial strain under uniaxial stress
    strain = strain_in_base(run.mesh, run.states[0])
    np.testing.assert_allclose(YOUNG * strain, run.states[0].stress, atol=1e-6 * YOUNG * STRAIN)


@needs_ccx
@pytest.mark.usefixtures("own_cache")
def test_energy_at_a_large_bend_matches_the_rod() -> None:
    """Bent by 65 degrees, where the axes of stress differ much from those of the straight robot."""
    robot = small_robot(**{"segments.0.backbone.E": "5 GPa"})
    run = sweep(robot, [[40.0, 0.0, 0.0]], settings=COARSE).raise_for_status()
    by_rod = rod.solve(robot, [40.0, 0.0, 0.0], model=bs.RodModel(elements=4))
    assert by_rod.tip is not None and by_rod.tip.rotation[2, 2] < 0.5
    theirs = by_rod.to_dataset(9).elastic_energy.item()
    assert run.to_dataset().elastic_energy.item() == pytest.approx(theirs, rel=0.06)  # coarse
    # stress and strain have the same axes: Hooke's law holds directly, except for large strain
    (state,) = run.states
    strain = strain_in_base(run.mesh, state)
    young, poisson = 5e9, 0.3
    sphere = strain[..., :3].sum(axis=-1, keepdims=True) * [1, 1, 1, 0, 0, 0]
    law = young / (1 + poisson) * (strain + poisson / (1 - 2 * poisson) * sphere)
    np.testing.assert_allclose(state.stress, law, atol=0.15 * np.abs(law).max())


def test_gravity_of_the_run_overrides_that_of_the_robot() -> None:
    run = stretched(STRAIN)
    assert run.to_dataset().gravity_energy.item() == 0.0
    again = stretched(STRAIN)
    again.settings["gravity"] = [0.0, 0.0, -9.8]
    straight = simulate(
        small_robot(), [0.0, 0.0, 0.0], 0.01, load=bs.Load(gravity=[0.0, 0.0, -9.8])
    )
    theirs = straight.to_dataset().gravity_energy[0].item()
    assert again.to_dataset().gravity_energy.item() == pytest.approx(theirs, rel=2e-3)


def test_displacements_match_the_rod() -> None:
    """The compliance of tendon and transmission is included."""
    drive = {
        "segments.0.tendons.compliance": "0.1 mm/N",
        "segments.0.tendons.axial_stiffness": "20 kN",
        "segments.0.tendons.free_length": "300 mm",
    }
    soft, stiff = small_robot(**drive), small_robot()
    displacements = {}
    for name, robot in (("soft", soft), ("stiff", stiff)):
        run = stretched(STRAIN)
        run.robot, run.wanted_tensions = robot, np.array([[20.0, 0.0, 5.0]])
        by_rod = rod.solve(robot, [20.0, 0.0, 5.0]).to_dataset(3)
        displacements[name] = (
            run.to_dataset().tendon_displacement.to_numpy()[0],
            by_rod.tendon_displacement.to_numpy()[0],
        )
    ours, theirs = (displacements["soft"][k] - displacements["stiff"][k] for k in (0, 1))
    assert ours[0] > 2e-3
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12)


def test_with_pretension_displacements_are_unknown() -> None:
    """The home pose differs then, and bricks have not computed it."""
    run = stretched(STRAIN)
    run.robot = small_robot(**{"segments.0.tendons.pretension": "2 N"})
    assert np.isnan(run.to_dataset().tendon_displacement).all()
