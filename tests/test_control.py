"""Where a robot lands when constant curvature commands it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar
from tests.shell import Shell

import bowstring as bs
from bowstring.aliases import Floats
from bowstring.errors import InputError, NoSolutionError
from bowstring.validity.control_commands import BY_ARCS, Commander

AMOURI, RAO = bs.load_robot("amouri2019"), bs.load_robot("rao2021")


def _commander(robot: bs.Robot, most: float = 1e3, **load: Any) -> Commander:
    tendons = robot.core.tendon_count
    least, largest = np.zeros(tendons), np.full(tendons, most)
    return Commander(robot, bs.Load(**load), bs.RodModel(), least, largest)


def _arc(bend: Floats, length: float, s: Floats) -> tuple[Floats, Floats]:
    """Points (n, 3) and rotations (n, 3, 3) of one arc, in closed form."""
    theta, phi = np.hypot(*bend), np.arctan2(bend[1], bend[0])
    angle = theta * s / length
    across, along = length / theta * (1 - np.cos(angle)), length / theta * np.sin(angle)
    points = np.stack([across * np.cos(phi), across * np.sin(phi), along], axis=-1)
    x, z = np.array([np.cos(phi), np.sin(phi), 0.0]), np.array([0.0, 0.0, 1.0])
    y = np.cross(z, x)
    basis = np.stack([x, y, z], axis=-1)
    turn = [
        basis @ [[np.cos(a), 0, np.sin(a)], [0, 1, 0], [-np.sin(a), 0, np.cos(a)]] @ basis.T
        for a in angle
    ]
    return points, np.array(turn)


BENDS = np.array([[[0.6, 0.3]], [[-0.4, 0.9]], [[0.1, -1.2]]])


def test_tensions_are_those_of_the_linear_law() -> None:
    """The sum of moments r x T is that which bends the backbone to the arc; no tendon pulls more
    than it must, so that one of three is slack."""
    tensions = _commander(AMOURI).command("tensions", BENDS)
    holes = AMOURI.tendons.mean_hole_m[0][:, :2]
    bend = tensions @ holes * AMOURI.length / AMOURI.bending_stiffness[0]
    np.testing.assert_allclose(bend, BENDS[:, 0], atol=1e-9)
    assert (tensions >= 0).all() and (tensions.min(axis=1) < 1e-9).all()


def test_displacements_are_those_of_arcs_and_of_chords() -> None:
    commander, length = _commander(AMOURI), AMOURI.length
    holes = np.pad(AMOURI.tendons.mean_hole_m[0], ((0, 0), (0, 1)))
    curves = commander.command("displacements", BENDS)
    # r theta cos(phi - angle of the hole)
    np.testing.assert_allclose(curves, BENDS[:, 0] @ holes[:, :2].T, atol=1e-12)
    chords = commander.command("displacements_chord", BENDS)
    stations = np.concatenate([[0.0], AMOURI.disks.station_m])
    for bend, found in zip(BENDS[:, 0], chords, strict=True):
        points, turn = _arc(bend, length, stations)
        guides = points[:, None] + np.einsum("kij,tj->kti", turn, holes)
        spans = np.linalg.norm(np.diff(guides, axis=0), axis=-1).sum(axis=0)
        np.testing.assert_allclose(found, stations[-1] - spans, atol=1e-9)


def test_the_mean_lever_arm_bends_to_the_arc() -> None:
    commander = _commander(AMOURI)
    tensions = commander.command("tensions_arm", BENDS)
    arcs = bs.constant_curvature.RobotArcs.from_tensions(AMOURI, tensions, "arm")
    np.testing.assert_allclose(arcs.arc.bend[:, 0, :2], BENDS[:, 0], atol=1e-8)


@pytest.mark.parametrize("robot", [AMOURI, RAO], ids=["amouri2019", "rao2021"])
def test_landings_are_equilibria_and_the_exact_inverse_lands(robot: bs.Robot) -> None:
    load = bs.Load(gravity=[0.0, 0.0, -9.81], tip_force=[0.02, 0.0, -0.05])
    found = bs.control_errors(robot, poses=12, corrections=1, load=load)
    assert found.distance("physics").max() < 1e-6 * robot.length
    commander = _commander(robot, gravity=load.gravity, tip_force=load.tip_force)
    commander.most = found.max_tension
    bends = commander.bends_to(found.wanted)
    for name in BY_ARCS:
        if name == "tensions_calibrated":
            continue
        commands = commander.command(name, bends)
        kind = "displacements" if name.startswith("displacements") else "tensions"
        for row, tip in zip(commands, found.landed[name][0], strict=True):
            if kind == "displacements":
                path = load.replace(displacements=np.outer(np.linspace(0.1, 1, 10), row))
                end = bs.sweep(robot, load=path).tip_position[-1]
            else:
                end = bs.solve(robot, row, load=load).tip.position
            assert np.linalg.norm(end - tip) < 1e-5 * robot.length


def test_more_disks_make_displacements_exact() -> None:
    """Without load a rod without shear and extension is an arc in the limit of many disks, and the
    error of curves beside spans is of second order in the distance of the disks."""
    errors = []
    for count in (8, 16, 32):
        robot = AMOURI.with_({"segments.0.disks.count": count})
        found = bs.control_errors(
            robot,
            poses=40,
            corrections=0,
            commands=["displacements"],
            model=bs.RodModel("kirchhoff"),
        )
        errors.append(found.summary("displacements")[0].rms)
    ratios = np.divide(errors[:-1], errors[1:])
    assert ((ratios > 3.5) & (ratios < 4.5)).all()


def test_calibration_has_the_least_mean_squared_distance() -> None:
    load = bs.Load(tip_force=[0.0, 0.0, -0.5])
    found = bs.control_errors(AMOURI, poses=32, corrections=0, load=load)
    commander = _commander(AMOURI, float(found.max_tension[0]), tip_force=load.tip_force)
    plain = commander.command("tensions", commander.bends_to(found.wanted))
    free = commander.command("tensions", commander.bends_to(found.wanted))

    def squared(scale: float) -> float:
        tips = commander.land("tensions", np.minimum(scale * free, found.max_tension))
        return float(((tips - found.wanted) ** 2).sum())

    best = minimize_scalar(squared, bounds=(0.5, 1.5), method="bounded", options={"xatol": 1e-8})
    assert plain.max() < found.max_tension.max()
    assert found.scale == pytest.approx(best.x, abs=1e-4)
    kept = found.summary("tensions_calibrated")[0].rms
    assert kept < 0.5 * found.summary("tensions")[0].rms


def test_corrections_close_in_on_the_wanted_tip() -> None:
    found = bs.control_errors(RAO, poses=64, corrections=3)
    for name in found.landed:
        if name != "physics":
            means = [row.mean for row in found.summary(name)]
            assert means[3] < 0.02 * means[0], name
    assert found.with_tolerance("50 %").summary("tensions")[0].valid == 1.0
    with pytest.raises(InputError, match="tolerance"):
        found.with_tolerance(2.0)


def test_a_calibrated_stiffness_is_found_beyond_three_times_and_is_one_without_tensions() -> None:
    tentacle = bs.load_robot(Path(__file__).parents[1] / "examples" / "tentacle.yaml")
    found = bs.control_errors(tentacle, poses=8, corrections=0)
    assert found.scale is not None and 5 < found.scale < 10
    kept, plain = (found.summary(name)[0].mean for name in ("tensions_calibrated", "tensions"))
    assert kept < 0.2 * plain
    # the one wanted tip is that of the straight robot, which takes no tension
    assert bs.control_errors(AMOURI, poses=1, corrections=0).scale == 1.0


def test_a_displacement_lands_beyond_an_unstable_equilibrium_on_the_way() -> None:
    robot = AMOURI.with_({"segments.0.disks.count": 2})
    bends = np.array([[[0.1, 0.03]], [[0.286, 0.089]], [[0.8, 0.4]]])
    commander = _commander(robot)
    commands = commander.command("displacements_chord", bends)
    for row, tip in zip(commands, commander.land("displacements_chord", commands), strict=True):
        single = bs.solve(robot, load=bs.Load(displacements=row))
        assert single.converged
        assert np.linalg.norm(single.tip.position - tip) < 1e-5 * robot.length


def test_commands_without_an_equilibrium_are_counted_and_not_named_the_nearest() -> None:
    """Two disks: most tensions buckle the backbone, for which the lever-arm law has no arc."""
    robot = AMOURI.with_({"segments.0.disks.count": 2})
    found = bs.control_errors(robot, poses=32, corrections=0)
    rows = {name: found.summary(name)[0] for name in found.landed}
    lost = {name: row.without_equilibrium for name, row in rows.items()}
    assert lost["tensions_arm"] > 0.1 * len(found.wanted)
    text = "\n".join(found.described())
    says = "Tensions by the mean lever arm: no stable equilibrium is found for "
    assert f"{says}{lost['tensions_arm']:g} " in text
    assert "tensions by the mean lever arm land nearest" not in text
    assert "displacements along chords land nearest" not in text


@pytest.mark.parametrize("tendons", [1, 2])
def test_figure_of_a_robot_that_bends_in_a_plane(tendons: int, tmp_path: Path) -> None:
    robot = AMOURI.with_({"segments.0.tendons.count": tendons})
    found = bs.control_errors(robot, poses=8, corrections=1)
    assert np.abs(found.wanted[:, 1]).max() < 1e-9
    assert found.save(tmp_path / "plane.png").stat().st_size > 10_000
    panel = found.figure().subfigs[0].axes[0]
    low, high = panel.get_ylim()
    assert high - low > 0.2 * np.ptp(panel.get_xlim())


def test_shares_of_the_load() -> None:
    load = bs.Load(gravity=[0.0, 0.0, 0.0], tip_force=[0.3, 0.0, 0.0])
    found = bs.control_errors(AMOURI, 60.0, poses=32, corrections=0, load=load)
    bare = bs.control_errors(AMOURI, 60.0, poses=32, corrections=0)
    assert not len(bare.load_shares) and not bare.by_load
    assert found.load_shares.tolist() == [0.0, 0.25, 0.5, 0.75, 1.0]
    for name, rows in found.by_load.items():
        none, whole = bare.summary(name)[0], found.summary(name)[0]
        assert rows[0] == pytest.approx([none.mean, none.largest], abs=1e-9)
        assert rows[-1] == pytest.approx([whole.mean, whole.largest], abs=1e-12)
    arm = found.by_load["tensions_arm"][:, 0]
    assert (np.diff(arm) > 0).all() and arm[-1] > 10 * arm[0]


def test_shares_of_point_loads_are_those_of_the_same_tip_force() -> None:
    force = [0.2, 0.0, -0.1]
    by_tip = bs.control_errors(
        AMOURI, 60.0, poses=8, corrections=0, commands=["tensions"], load=bs.Load(tip_force=force)
    )
    load = bs.Load(point_loads=[bs.PointLoad(force=force)])
    found = bs.control_errors(
        AMOURI, 60.0, poses=8, corrections=0, commands=["tensions"], load=load
    )
    expected = by_tip.by_load["tensions"]
    np.testing.assert_allclose(found.by_load["tensions"], expected, rtol=1e-6)


def test_tendons_in_the_body_take_tensions_only() -> None:
    tentacle = bs.load_robot(Path(__file__).parents[1] / "examples" / "tentacle.yaml")
    found = bs.control_errors(tentacle, poses=4, corrections=1)
    assert "physics" not in found.landed and "displacements" not in found.landed
    assert found.to_dict()["seconds_per_command"]["physics"] is None
    with pytest.raises(InputError, match="takes no commands displacements"):
        bs.control_errors(tentacle, poses=4, commands=["displacements"])


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"max_tension": 0.0}, "above 0 N"),
        ({"max_tension": "x"}, "max_tension is 'x'"),
        ({"max_tension": [1.0, np.nan, 2.0]}, "above 0 N"),
        ({"max_tension": [1.0, 2.0]}, "3 numbers above 0 N"),
        ({"poses": 0}, "poses"),
        ({"corrections": -1}, "corrections"),
        ({"commands": ["spline"]}, "commands"),
        ({"commands": []}, "names in a list"),
        ({"commands": "tensions"}, "names in a list"),
        ({"load": bs.Load([1, 0, 0])}, "leave it out"),
        ({"load": bs.Load(tip_force=[0, np.nan, 0])}, "tip force"),
        ({"load": bs.Load(tip_force=[[0, 0, 1], [0, 1, 0]])}, "3 numbers"),
    ],
)
def test_bad_input_is_refused(given: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        bs.control_errors(AMOURI, **{"poses": 4, **given})


def test_without_equilibria_there_is_no_result() -> None:
    with pytest.raises(NoSolutionError, match="smaller dead loads"):
        bs.control_errors(AMOURI, poses=4, load=bs.Load(tip_force=[1e6, 0.0, 0.0]))


def test_command(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "control.svg"
    flags = ["--poses", "8", "--corrections", "1", "--tip-force", "0,0,-0.1", "--out", str(file)]
    found = shell.json("control", "rao2021", *flags)
    assert file.read_text().startswith("<?xml")
    names = [each["name"] for each in found["commands"]]
    assert names == [*BY_ARCS, "physics"]
    assert len(found["by_load"]) == len(names)
    code, text, _ = shell("control", "rao2021", *flags)
    assert code == 0 and "displacements along chords" in text and "simulated" in text
    assert "--poses: got 0" in shell.error("control", "rao2021", "--poses", "0")


def test_table_of_many_corrections_has_the_first_and_the_last(shell: Shell, tmp_path: Path) -> None:
    flags = ["--poses", "4", "--corrections", "20", "--commands", "tensions"]
    code, text, _ = shell("control", *flags, "--out", str(tmp_path / "many.svg"))
    assert code == 0
    head = text.splitlines()[0]
    assert [f"after {k}" in head for k in (1, 2, 3, 4, 20)] == [True, True, True, False, True]
