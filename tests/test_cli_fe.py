"""The command fe."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import xarray as xr

from fem_robots import needs_ccx
from shell import Shell, refuses

ROBOT = """
segments:
  - length: 140 mm
    backbone: {diameter: 5 mm, E: 35 GPa, nu: 0.3, density: 1800 kg/m^3}
    disks: {count: 2, mass: 20 g, radius: 32 mm, thickness: 3 mm, clamped_length: 3 mm}
    tendons: {count: 3, pitch_radius: 29 mm}
"""


@pytest.fixture(autouse=True)
def with_robot(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(here / "cache"))
    (here / "small.yaml").write_text(ROBOT)


FE = ("fe", "small.yaml", "--tension", "40,0,10", "--mesh", "2,4,1")


@needs_ccx
def test_a_sweep_beside_the_rod(shell: Shell, here: Path) -> None:
    found = shell.json(*FE, "--loads", "0:20:40", "--out", "out")
    assert found["status"] == "converged"
    assert [row["tensions_N"] for row in found["loads"]] == [[0, 0, 0], [20, 0, 5], [40, 0, 10]]
    assert found["loads"][0]["difference_mm"] == pytest.approx(0, abs=1e-9)
    for row in found["loads"][1:]:
        assert 0 < row["difference_mm"] < 0.6  # of 15 mm; a coarse mesh
        assert row["rod_tip_position_m"][0] > row["tip"]["position_m"][0]
    assert found["span_error"] < 1e-3
    assert found["limit"] is None
    assert found["provenance"]["settings"]["calculix_version"].startswith("2.")
    assert Path(found["folder"]) == here / "out"
    written = json.loads((here / "out" / "fe.json").read_text())
    assert written["loads"] == found["loads"]
    files = {p.relative_to(here / "out").as_posix() for p in (here / "out").rglob("*.*")}
    assert files == set(written["files"])
    assert {"fe.nc", "tip.png", "stress.png", "vtk/run.pvd"} <= files
    with xr.open_dataset(here / "out" / "fe.nc") as data:
        assert data.attrs["data_origin"] == "simulated by finite elements"
        assert "complete_to_s" not in data.attrs  # the time axis counts loads
    code, out, err = shell(*FE, "--loads", "0:20:40", "--out", "out")
    assert (code, err) == (0, "")
    assert "2 steps from the cache" in out and "span forces are the tensions" in out


@needs_ccx
def test_a_motion(shell: Shell) -> None:
    found = shell.json(*FE, "--dynamic", "--rise", "50 ms")
    (row,) = found["loads"]
    assert row["t_s"] == pytest.approx(0.05)
    assert 0 < row["difference_mm"] < 0.6
    assert row["rod_middle_stress_Pa"] is None


@needs_ccx
def test_a_study_gives_a_limit_and_its_error(shell: Shell) -> None:
    found = shell.json(*FE, "--loads", "40", "--study")
    assert len(found["limit"]["error_mm"]) == 1
    assert {r["name"] for r in found["limit"]["refinements"]} == {
        "bricks along a module",
        "bricks around",
        "stiffness of disks",
    }
    assert found["limit"]["difference_mm"][0] < found["loads"][0]["difference_mm"]


@needs_ccx
def test_a_failed_load_prints_the_loads_before_it(shell: Shell) -> None:
    arguments = ("fe", "small.yaml", "--tension", "1e5,0,0", "--mesh", "2,4,1")
    code, out, err = shell(*arguments, "--loads", "40,1e5", "--json")
    assert code == 1
    found = json.loads(out)
    assert found["status"] == "diverged" and len(found["loads"]) == 1
    assert "stopped at" in err and "1 of 2 are kept" in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--mesh", "2,4"), "--mesh: got 2,4; write three whole numbers"),
        (("--mesh", "3,4,1"), "--mesh: the mesh has 3 bricks a module; must be an even number"),
        (("--stiffness", "1"), "--stiffness: disks are 1 times as stiff"),
        (("--dynamic", "--rise", "1e9"), "rise and hold are 1e+09 s, which is more than"),
        (("--dynamic", "--rise", "1e-9"), "--rise: got 1e-09 s; must be 1e-06 s or more"),
        (("--keep", "small.yaml/a"), "--keep: cannot write the files of CalculiX to small.yaml/a"),
        (("--out", "small.yaml"), "--out: cannot write the finite elements to"),
        (("--tension", "0,0,0"), "--tension: got no tension at all"),
        (("--rise", "1"), "--rise is for --dynamic"),
        (("--dynamic", "--loads", "0:1:2"), "--loads is for statics"),
        (("--dynamic", "--tip-force", "1,0,0"), "--tip-force is for statics"),
        (("--mass-damping", "1"), "--mass-damping is for --dynamic"),
        (("--study", "--tip-force", "1,0,0"), "--study is for tensions alone"),
        (("--loads", "0:-1:-2"), "--loads: got -2 N; must be 0 or more"),
        (
            ("--set", "segments.0.disks.clamped_length=0"),
            'for a glued disk add --set segments.0.disks.clamped_length="3 mm"',
        ),
        (("--set", "segments.0.tendons.friction=0.1"), "have friction, which"),
    ],
)
def test_wrong_input_is_named(shell: Shell, arguments: tuple[str, ...], says: str) -> None:
    assert says in shell.error(*FE, *arguments)


def test_foreign_folders_are_not_changed(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (here / "sub").mkdir()
    (here / "sub" / "other").mkdir()
    monkeypatch.chdir(here / "sub")
    command = ("fe", str(here / "small.yaml"), "--tension", "40,0,0")
    said = "no finite elements of Bowstring"
    refuses(shell, here / "sub", said, *command, "--out", "mine")
    assert "not an empty folder" in shell.error(*command, "--keep", "mine")
