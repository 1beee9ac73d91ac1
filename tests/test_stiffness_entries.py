"""Entries of stiffness matrices as axes, parameters and overrides, and messages on such robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bowstring as bs
from bowstring.calibration import Data, fit
from bowstring.constant_curvature import RobotArcs
from bowstring.dynamics.run_file import read_run
from bowstring.errors import InputError
from bowstring.robot.designs import Designs
from bowstring.robot.paths import find, full_paths
from bowstring.robot.writer import to_yaml
from bowstring.statics.design_sweeps import sweep_designs
from bowstring.uncertainty import SaltelliDesign, read_distributions
from bowstring.validity.loading import Loading
from bowstring.validity.maps import validity_map
from bowstring.validity.sentences import described
from bowstring.validity.spread import validity_spread
from objects import PLAIN_STIFFNESS, coupled_robot
from shell import Shell

LENGTHS, FORCE = "cc_from_lengths", "cc_from_force"
MATRIX = PLAIN_STIFFNESS.copy()
MATRIX[1, 2] = MATRIX[2, 1] = 0.02
MATRIX[0, 3] = MATRIX[3, 0] = 1.5
FIELD = "segments.0.backbone.stiffness"


def entered(row: int, column: int, value: float) -> np.ndarray:
    matrix = MATRIX.copy()
    matrix[row, column] = matrix[column, row] = value
    return matrix


ROBOT = coupled_robot(MATRIX)
PLAIN = coupled_robot(np.diag(MATRIX.diagonal()))
GRAVITY = bs.Load(gravity=[1.0, 0.5, -9.81])


# -- maps --------------------------------------------------------------------------------------


def test_a_map_of_coupled_sections_has_no_straight_spans_among_its_causes() -> None:
    """A continuous tendon does not run beside coupled sections."""
    found = validity_map(ROBOT, ["tension=0:8 N:5"], load=GRAVITY)
    assert np.isfinite(found.value[FORCE]).all()
    causes = {str(cause) for effects in found.cause.values() for cause in effects}
    assert "straight_spans" not in causes and "gravity" in causes
    quiet = validity_map(ROBOT, ["tension=0:8 N:5"], tolerance=1e-4)
    says = "beside coupled strains of the backbone this effect is not examined"
    assert says in described(quiet)[-1]
    grid = bs.validity_grid(
        ROBOT,
        ["tension=0:8 N:3", "pitch_radius=15:20 mm:2", "tip_force.z=0:0.1 N:2"],
        tolerance=1e-4,
    )
    assert says in grid.described()[-1]
    # without couplings the effect is examined
    plain = validity_map(PLAIN, ["tension=0:8 N:5"], tolerance=1e-4)
    assert "straight_spans" in plain.cause[FORCE] and says not in " ".join(described(plain))


def test_the_workspace_of_coupled_sections_is_mapped(shell: Shell, tmp_path: Path) -> None:
    found = bs.workspace_map(ROBOT, 8.0, poses=32, tolerance=1e-4)
    assert found.solved.all() and "straight_spans" not in found.cause[FORCE]
    i = int(np.argmax(found.tensions.sum(axis=1)))
    tip = bs.solve(ROBOT, found.tensions[i]).tip.position
    assert found.tip[i] == pytest.approx(tip, abs=1e-9)
    says = "beside coupled strains of the backbone this effect is not examined"
    assert says in " ".join(found.described())
    (tmp_path / "coupled.yaml").write_text(to_yaml(ROBOT))
    flags = ("--errors", "--poses", "16", "--out", str(tmp_path / "map.svg"))
    assert len(shell.json("reach", str(tmp_path / "coupled.yaml"), *flags)["tip_position_m"]) == 16
    flags = ("--over", "tension=0:8 N:3", "--out", str(tmp_path / "map.svg"))
    assert shell.json("map", str(tmp_path / "coupled.yaml"), *flags)["axes"][0]["path"] == "tension"


@pytest.mark.parametrize(
    ("row", "column", "ends"),
    [(0, 0, (0.05, 0.08)), (1, 2, (0.0, 0.04)), (3, 3, (600.0, 900.0)), (0, 1, (-0.02, 0.02))],
)
def test_a_map_over_an_entry_is_that_of_robots_written_out(
    row: int, column: int, ends: tuple[float, float]
) -> None:
    tensions, top = np.array([4.0, 8.0]), 8.0
    axes = ["tension=4:8 N:2", f"stiffness.{row}.{column}={ends[0]}:{ends[1]}:3"]
    found = validity_map(ROBOT, axes, load=GRAVITY, loading=Loading(points=5))
    assert found.axes[1].path == f"{FIELD}.{row}.{column}" and top == found.axes[0].stop
    for i, value in enumerate(np.linspace(*ends, 3)):
        one = coupled_robot(entered(row, column, value))
        for k, tension in enumerate(tensions):
            command = [tension, 0.0, 0.0]
            exact = bs.solve(one, command, load=GRAVITY).raise_for_status()
            for name, arcs in (
                (FORCE, RobotArcs.from_tensions(one, np.array([command]))),
                (LENGTHS, RobotArcs.from_lengths(one, exact.tendon_lengths[None])),
            ):
                error = np.linalg.norm(arcs.tip.position[0] - exact.tip.position) / one.length
                assert found.value[name][i, k] == pytest.approx(error, rel=1e-5)
    assert found.axes[1].own_value(ROBOT) == MATRIX[row, column]
    assert f"row {row + 1}, column {column + 1}" in found.label(1)
    assert found.figure().axes[-1].get_ylabel() or found.figure()


def test_designs_of_several_matrices_are_single_robots() -> None:
    """Also with loads of their own, displacements, and an axis that ends all couplings."""
    entries = np.array([0.0, 0.02, 0.0, -0.03])

    designs = Designs(PLAIN, {f"{FIELD}.1.2": entries, "gravity.0": [0.0, 1.0, 2.0, 3.0]})
    assert designs.robot_at(1).segments[0].backbone.stiffness[2][1] == 0.02
    for array in ("sections", "disks", "holes"):
        for i in range(4):
            one = Designs(designs.robot_at(i), {"segments.0.length": [0.4]})
            assert getattr(designs, array)[i] == pytest.approx(getattr(one, array)[0], rel=1e-14)
    forces = np.array([[0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1], [0.1, 0.1, 0]])
    tensions = np.outer([2.0, 6.0], [1.0, 0.5, 0.0])
    found = sweep_designs(designs, tensions, load=bs.Load(tip_force=forces))
    for i in range(4):
        for k in range(2):
            one = bs.solve(
                designs.robot_at(i), tensions[k], load=bs.Load(tip_force=forces[i])
            ).raise_for_status()
            assert found.tip_position[i, k] == pytest.approx(one.tip.position, abs=1e-9)
            assert found.status[i, k] == "converged"
    moved = np.outer([0.2, 1.0], [5e-3, -2e-3, -2e-3])
    found = sweep_designs(designs, displacements=moved)
    for i in range(4):
        one = bs.solve(designs.robot_at(i), load=bs.Load(displacements=moved[1]))
        apart = np.linalg.norm(found.tip_position[i, 1] - one.tip.position)
        assert apart < 1e-5 * one.robot.length  # of one element and of two
        assert found.tensions[i, 1] == pytest.approx(one.tensions, rel=1e-3, abs=1e-3)


def test_a_path_keeps_the_indices_that_it_gives() -> None:
    """In a robot of two segments the end of a path means one entry in each."""
    two = coupled_robot(MATRIX, segments=2)
    name, targets = find(two, "stiffness.0.3", ())
    assert name == "segments.*.backbone.stiffness.0.3" and len(targets) == 2
    assert full_paths(two, name) == list(targets)
    places = {"count": None, "positions": [0.1, 0.25, 0.4]}
    listed = two.with_({f"segments.*.disks.{key}": value for key, value in places.items()})
    assert find(listed, "positions.1", ())[0] == "segments.*.disks.positions.1"


# -- overrides and fits ------------------------------------------------------------------------


def test_an_entry_sets_the_mirrored_one() -> None:
    changed = ROBOT.with_({f"{FIELD}.4.5": 100.0, "segments[0].backbone.stiffness[1][2]": 0.01})
    matrix = np.array(changed.segments[0].backbone.stiffness)
    expected = MATRIX.copy()
    expected[4, 5] = expected[5, 4] = 100.0
    expected[1, 2] = expected[2, 1] = 0.01
    assert (matrix == expected).all()
    with pytest.raises(InputError, match=r"got 0\.01 in row 2, column 3, but 0\.02 in row 3"):
        ROBOT.with_({f"{FIELD}.1.2": 0.01, f"{FIELD}.2.1": 0.02})
    with pytest.raises(InputError, match="not positive definite"):
        ROBOT.with_({f"{FIELD}.1.2": 0.07})


def test_a_fit_finds_a_coupling_and_a_stiffness() -> None:
    tensions = np.concatenate([np.outer(np.linspace(1, 8, 6), each) for each in np.eye(3)])
    tips = bs.solve_batch(ROBOT, tensions).tip_position
    names = [f"{FIELD}.1.2", f"{FIELD}.0.0"]
    guess = ROBOT.with_({names[0]: 0.0, names[1]: 0.07})
    found = fit(guess, Data(points=tips, tensions=tensions), names)
    assert found.converged and not found.not_identifiable
    assert found[names[0]].value == pytest.approx(0.02, rel=1e-3)
    assert found[names[1]].value == pytest.approx(0.06, rel=1e-3)


# -- what is refused, and what is written ------------------------------------------------------


def test_a_motion_has_files_but_no_surface_with_stress(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "coupled.yaml").write_text(to_yaml(ROBOT))
    run = ("simulate", str(tmp_path / "coupled.yaml"), "--tension", "1,0,0", "--rise", "0.01")
    run += ("--hold", "0.01")
    says = shell.error(*run, "--vtk", str(tmp_path / "series"))
    assert "surface needs shape" in says and "--out run.nc" in says
    assert not (tmp_path / "series").exists()
    assert shell(*run, "--out", str(tmp_path / "run.csv"))[0] == 0
    assert "\nt_s,tip_x_mm" in (tmp_path / "run.csv").read_text()
    assert shell(*run, "--out", str(tmp_path / "run.nc"))[0] == 0
    written = read_run(tmp_path / "run.nc")
    assert np.isfinite(written.strain).all() and np.isnan(written.von_mises).all()


def test_advice_is_on_numbers_that_the_robot_has() -> None:
    with pytest.raises(InputError, match=r"write for example length, disks.clamped_length"):
        validity_map(ROBOT, ["xyzzy=1:2"])
    with pytest.raises(InputError, match=r"as segments\.0\.length"):
        fit(ROBOT, Data(points=np.zeros((4, 3)), tensions=np.zeros((4, 3))), ["xyzzy"])
    with pytest.raises(InputError, match="entry of a stiffness matrix, which takes no distrib"):
        read_distributions({"stiffness.0.0": {"normal": {"sd": 0.01}}}, ROBOT)
    assumed = bs.validity.spread.assumed_distributions(ROBOT)  # type: ignore[attr-defined]
    assert assumed.paths == ("segments.0.tendons.pitch_radius",)
    design = SaltelliDesign(assumed, 32)
    assert validity_spread(ROBOT, design, loading=Loading(8.0, 5)).limit.size
