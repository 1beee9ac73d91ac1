"""Command ik: a tip by both models, and paths of tips."""

from __future__ import annotations

import csv
import errno
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from tests.shell import Shell

import bowstring as bs
from bowstring.viz import style


def write_tips(file: Path, tips: np.ndarray, unit: str = "mm", extra: str = "") -> Path:
    factor = 1e3 if unit == "mm" else 1.0
    rows = [",".join(f"{factor * x:.9g}" for x in tip) for tip in tips]
    header = f"tip_x_{unit},tip_y_{unit},tip_z_{unit}"
    file.write_text("\n".join([header, *rows]) + "\n" + extra)
    return file


def circle(count: int) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, count)
    return np.stack([0.1 * np.cos(angle), 0.1 * np.sin(angle), np.full(count, 0.37)], axis=-1)


def table(file: Path) -> list[dict[str, str]]:
    """Rows of the commands of a path."""
    with file.open() as stream:
        assert stream.readline().startswith("# commands by Bowstring")
        return list(csv.DictReader(stream))


def column(rows: list[dict[str, str]], *names: str) -> np.ndarray:
    found = np.array([[float(row[name]) for name in names] for row in rows])
    return found[:, 0] if len(names) == 1 else found


def test_a_tip_by_physics(shell: Shell) -> None:
    found = shell.json("ik", "rao2021", "--tip", "120 mm,0.05,0.36")
    assert found["model"] == "physics"
    assert found["status"] == "reached" and found["stable"] is True
    tension = ",".join(map(repr, found["tensions_N"]))
    tip = shell.json("solve", "rao2021", "--tension", tension)["tip"]["position_m"]
    np.testing.assert_allclose(tip, [0.12, 0.05, 0.36], atol=1e-8)
    displacement = bs.solve(bs.load_robot("rao2021"), found["tensions_N"]).displacements()
    np.testing.assert_allclose(found["displacements_m"], displacement, atol=1e-12)


def test_a_tip_with_a_load_and_limits(shell: Shell) -> None:
    options = ["--gravity", "0,0,-9.81", "--tip-force", "0.05,0,0", "--max-tension", "12 N"]
    options += ["--min-tension", "0.5,0.5,0.5,1,1,1", "--theory", "kirchhoff", "--elements", "2"]
    found = shell.json("ik", "rao2021", "--tip", "0.1,0,0.37", *options)
    assert found["status"] == "reached" and found["elements"] == 2
    assert min(found["tensions_N"]) >= 0.5 and max(found["tensions_N"]) <= 12.0


def test_an_unreachable_tip_names_the_limit(shell: Shell) -> None:
    code, out, _ = shell(
        *("ik", "amouri2019", "--tip", "0.31,0,0.527"),
        *("--max-tension", "30 N"),
    )
    assert code == 0 and "the largest tension of tendon 1 (30 N) and" in " ".join(out.split())


def test_a_direction_by_constant_curvature(shell: Shell) -> None:
    wanted = ("--tip", "0.04,0.02,0.17", "--direction", "0,0,1")
    found = shell.json("ik", "crl-ftdcr-v4", *wanted, "--model", "cc")
    assert found["status"] == "reached" and found["direction_error_rad"] < 1e-5


@pytest.mark.parametrize("model", ["physics", "cc"])
def test_a_path(shell: Shell, tmp_path: Path, model: str) -> None:
    tips = circle(60)
    file = write_tips(tmp_path / "tips.csv", tips)
    out = tmp_path / "commands.csv"
    found = shell.json("ik", "rao2021", "--path", str(file), "--out", str(out), "--model", model)
    assert found["count"] == found["reached"] == 60 and found["restarted"] == 0
    assert found["files"] == [str(out), str(tmp_path / "commands.png")]
    assert (tmp_path / "commands.png").stat().st_size > 10_000
    rows = table(out)
    robot = bs.load_robot("rao2021")
    tensions = [f"tension_{i}_N" for i in range(1, 7)]
    landed = bs.sweep(robot, column(rows, *tensions)).tip_position
    miss = np.linalg.norm(landed - tips, axis=1)
    if model == "physics":
        assert miss.max() < 1e-6
    # where constant curvature's commands lead
    other = bs.sweep(robot, column(rows, *(f"other_{name}" for name in tensions))).tip_position
    tips_there = column(rows, *(f"other_tip_{axis}_mm" for axis in "xyz"))
    np.testing.assert_allclose(1e3 * other, tips_there, atol=1e-4)
    mean = np.linalg.norm(other - tips, axis=1).mean()
    assert found["constant_curvature_mean_miss_m"] == pytest.approx(mean, rel=1e-6)
    assert mean > 1e-3
    # again, over its own files
    assert shell("ik", "rao2021", "--path", str(file), "--out", str(out))[0] == 0


def test_a_table_that_is_written_is_named_where_its_figure_fails(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, out = write_tips(tmp_path / "tips.csv", circle(3)), tmp_path / "c.csv"
    arguments = ("ik", "rao2021", "--path", str(file), "--out", str(out))
    only = f"of the files only {out} is written"

    full = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr(style, "save", full)
    assert shell.error(*arguments).endswith(f"No space left on device; {only}")

    monkeypatch.setattr(style, "save", Mock(side_effect=KeyboardInterrupt))
    assert shell(*arguments) == (130, "", f"Stopped: {only}.\n")
    assert out.exists() and not out.with_suffix(".png").exists()


def test_a_path_with_directions_in_metres(shell: Shell, tmp_path: Path) -> None:
    robot = bs.load_robot("crl-ftdcr-v4")
    tensions = np.linspace([1.0, 0, 0, 2, 0, 0, 0, 3, 0], [0, 2.0, 0, 0, 3, 0, 1, 0, 2], 12)
    poses = bs.sweep(robot, tensions)
    both = np.concatenate([poses.tip_position, poses.tip_rotation[..., 2]], axis=1)
    rows = [",".join(map(repr, row)) for row in both.tolist()]
    names = "tip_x_m,tip_y_m,tip_z_m,direction_x,direction_y,direction_z"
    file = tmp_path / "tips.csv"
    file.write_text("# wanted\n" + "\n".join([names, *rows]))
    out = str(tmp_path / "c.csv")
    found = shell.json("ik", robot.name, "--path", str(file), "--out", out)
    assert found["reached"] == 12


def test_the_table_has_the_distance_of_the_nearest_tip(shell: Shell, tmp_path: Path) -> None:
    # off the surface that one segment reaches; the first row is on it
    on = bs.solve(bs.load_robot("amouri2019"), [20, 0, 0]).tip.position
    tips = on + np.outer([0.0, -0.01, -0.02], [0.0, 0.0, 1.0])
    file, out = write_tips(tmp_path / "tips.csv", tips), tmp_path / "c.csv"
    arguments = ("ik", "amouri2019", "--path", str(file), "--out", str(out))
    found = shell.json(*arguments)
    rows = table(out)
    assert [row["status"] for row in rows] == ["reached", "unreachable", "unreachable"]
    distance = column(rows, "distance_mm")
    nearest = column(rows, "nearest_distance_mm")
    assert distance[0] == nearest[0] < 1e-3
    shell.json(*arguments, "--distance-margin", "0")  # the nearest tips are those without a margin
    np.testing.assert_allclose(nearest[1:], column(table(out), "distance_mm")[1:], rtol=1e-3)
    assert (nearest[1:] < distance[1:] - 0.1).all()
    assert found["max_nearest_distance_m"] == pytest.approx(1e-3 * nearest.max(), rel=1e-8)


def test_jumps_are_pointed_out(shell: Shell, tmp_path: Path) -> None:
    file = write_tips(tmp_path / "tips.csv", circle(60)[[0, 1, 30, 31]])
    _, _, err = shell("ik", "rao2021", "--path", str(file), "--out", str(tmp_path / "c.csv"))
    assert "row 3 is 2" in err and "jumps" in err


def test_limits_of_displacement(shell: Shell) -> None:
    arguments = ["ik", "amouri2019", "--tip", "0.3,0,0.53"]
    found = shell.json(*arguments, "--displacement-limits", "-50 mm,20 mm")
    assert found["status"] == "unreachable"
    assert {"tendon": 1, "limit": "largest", "of": "displacement"} in found["binding"]
    assert found["displacements_m"][0] == pytest.approx(0.02, abs=1e-7)


def test_jumps_of_tensions_are_pointed_out(shell: Shell, tmp_path: Path) -> None:
    """A circle on which the least tensions change from one set of tendons to another."""
    path = Path(__file__).parents[1] / "examples" / "tip_path.csv"
    out = tmp_path / "c.csv"
    arguments = ("--out", str(out))
    _, said, err = shell("ik", "rao2021", "--path", str(path), *arguments)
    assert not err and "Largest change of a tension from row to row: 0.0" in said
    file = write_tips(tmp_path / "tips.csv", circle(1000))
    found = shell.json("ik", "rao2021", "--path", str(file), *arguments)
    _, _, err = shell("ik", "rao2021", "--path", str(file), *arguments)
    if found["max_tension_change_N"] > 0.25:  # whether it does is the solver's choice
        start = "the tensions may jump there" if found["restarted"] else "--min-tension"
        assert start in err
    else:
        assert not err
    tensions = column(table(out), *(f"tension_{i}_N" for i in range(1, 7)))
    changes = np.abs(np.diff(tensions, axis=0))
    assert found["max_tension_change_N"] == pytest.approx(changes.max(), abs=1e-6)
