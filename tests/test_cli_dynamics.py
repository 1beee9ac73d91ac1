"""`bowstring simulate` and `bowstring modes`: their contract and their files."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

import bowstring as bs
from bowstring.dynamics.load_table import read_actuation, read_base_motion
from bowstring.dynamics.run_file import read_run
from bowstring.errors import InputError
from shell import Shell

SIMULATE = ("simulate", "amouri2019")
DISPLACED = (*SIMULATE, "--tension", "80,0,0")
SHORT = (*DISPLACED, "--rise", "0.1", "--hold", "0.1")
SOUND = (
    "status steps error_estimate t_s tip_position_m real_time_factor message files robot warnings "
    "provenance"
)


# -- simulate ----------------------------------------------------------------------------------


def test_simulate(shell: Shell, robot: bs.Robot) -> None:
    found = shell.json(*DISPLACED, "--rise", "1", "--hold", "0.5", "--mass-damping", "0.5 1/s")
    assert set(found) == set(SOUND.split())
    assert found["status"] == "converged" and found["steps"] > 50
    assert found["real_time_factor"] > 0
    assert 1e-5 < found["error_estimate"]["tip_m"] < 2e-3
    assert found["t_s"] == [k / 100 for k in range(151)]
    expected = bs.simulate(
        robot, bs.dynamics.ramp([80, 0, 0], 1.0), 1.5, integrator=bs.Integrator(mass_damping=0.5)
    )
    np.testing.assert_allclose(found["tip_position_m"], expected.tip_position, atol=1e-12)
    settings = found["provenance"]["settings"]
    assert settings["mass_damping_per_s"] == 0.5 and settings["theory"] == "cosserat"
    assert settings["tensions_N"] == {"times_s": [0, 1], "values": [[0, 0, 0], [80, 0, 0]]}
    assert found["provenance"]["robot_hash"] == robot.hash


def test_coarse_steps_are_reported(shell: Shell) -> None:
    arguments = (*DISPLACED, "--rise", "1", "--hold", "0.5", "--dt", "50 ms")
    assert "give a smaller dt" in shell.json(*arguments)["message"]
    _, shown, _ = shell(*arguments)
    words = " ".join(shown.split())
    assert "The time steps cause a tip error of" in words and "give a smaller dt" in words


@pytest.mark.parametrize("flags", [["--dt", "20 ms"], ["--every", "2 ms"], ["--every", "3 ms"]])
def test_times_are_every_hundredth_whatever_the_step(shell: Shell, flags: list[str]) -> None:
    arguments = (*DISPLACED, "--rise", "1", "--hold", "0.105")
    found = shell.json(*arguments, *flags)
    assert found["t_s"] == [
        *(k / 100 for k in range(111)),
        1.105,
    ]  # as people write them
    assert np.shape(found["tip_position_m"]) == (112, 3)
    rarer = shell.json(*arguments, "--every", "0.35")["t_s"]
    assert rarer == [0, 0.35, 0.7, 1.05, 1.105]


def test_rise_from_tensions(shell: Shell) -> None:
    """Without --rise 0 the tensions rise from those at the start, without a jump."""
    flags = ["--from", "80,0,0", "--rise", "0.2", "--hold", "0.1"]
    tip = np.array(shell.json(*DISPLACED, *flags)["tip_position_m"])
    np.testing.assert_allclose(tip, tip[:1].repeat(len(tip), axis=0), atol=1e-6)


def test_table(shell: Shell, tmp_path: Path) -> None:
    """The same motion as from flags, with columns in any order and any unit."""
    path = tmp_path / "tensions.csv"
    path.write_text(
        "\ufeff# made by hand\ntension_3_N, tension_1_mN ,t_ms,tension_2_N\n"
        "0,0,0,0\n\n0,80e3,100,0\n0,80000,200,0\n",
        encoding="utf-8",
    )
    found = shell.json(*SIMULATE, "--table", str(path))
    expected = shell.json(*SHORT)
    assert found["t_s"] == expected["t_s"]
    np.testing.assert_allclose(found["tip_position_m"], expected["tip_position_m"], atol=1e-6)


def test_a_table_in_another_unit_is_doubted(shell: Shell, tmp_path: Path) -> None:
    """The sentence of bench check; 1e-4 s of motion are enough."""
    file = tmp_path / "load.csv"
    file.write_text("t_s,tension_1_N,tension_2_N,tension_3_N\n0,5000,0,0\n1e-4,5000,0,0\n")
    _, _, err = shell("simulate", "amouri2019", "--table", str(file), "--from", "0,0,0")
    assert "--table: By the linear law 5000 N, the largest tension, would wind amouri2019" in err
    assert "check the unit of the tensions" in err


def test_table_may_jump(tmp_path: Path, robot: bs.Robot) -> None:
    path = tmp_path / "tensions.csv"
    path.write_text("t_s,tension_1_N,tension_2_N,tension_3_N\n0,5,0,0\n1,5,0,0\n1,8,0,0\n2,8,0,0\n")
    table = read_actuation(path, robot)["tensions"]
    assert table.at(1.0, before=True)[0] == 5 and table.at(1.0)[0] == 8


def test_files(shell: Shell, tmp_path: Path, robot: bs.Robot) -> None:
    """The terminal names the files, which have the numbers of the JSON."""
    out, vtk, gif = tmp_path / "run.nc", tmp_path / "series", tmp_path / "run.gif"
    glb = tmp_path / "run.glb"
    flags = ["--out", str(out), "--vtk", str(vtk), "--out", str(gif), "--out", str(glb)]
    arguments = (*DISPLACED, "--rise", "0.05", "--hold", "0.05", *flags)
    code, text, err = shell(*arguments)
    assert code == 0 and not err
    written = f"Run: {out}\nVTK series: {vtk / 'run.pvd'}\nAnimation: {gif}\nglTF file: {glb}\n"
    assert written in text
    assert "amouri2019, rod model (Cosserat): converged, 0.1 s in" in text
    found = shell.json(*arguments)  # replaces them
    files = {"run": out, "vtk": vtk / "run.pvd", "animation": gif, "glb": glb}
    expected = {name: str(file) for name, file in files.items()}
    assert found["files"] == {**expected, "rerun": None}
    data = read_run(out)
    assert data.attrs["status"] == "converged" and data.attrs["robot_hash"] == robot.hash
    tip = data["disk_position"].isel(disk=-1)
    np.testing.assert_allclose(found["tip_position_m"], tip, atol=1e-12)
    assert gif.read_bytes().startswith(b"GIF8") and glb.read_bytes().startswith(b"glTF")
    assert len(list(vtk.glob("*.vtu"))) == 3 * 11


def test_a_run_that_is_written_is_named_where_another_file_fails(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = Mock(side_effect=InputError("cannot write it: No space left on device"))
    monkeypatch.setattr("bowstring.integrations.gltf.write_glb", full)
    out = tmp_path / "run.nc"
    files = ("--out", str(out), "--out", str(tmp_path / "run.glb"))
    said = shell.error(*DISPLACED, "--rise", "0.02", "--hold", "0.02", *files)
    assert said.endswith(f"No space left on device; {out} is written, the glTF file is not")
    assert out.exists()


def test_a_table_has_a_row_for_each_output_time(shell: Shell, tmp_path: Path) -> None:
    out, nc = tmp_path / "run.csv", tmp_path / "run.nc"
    arguments = (*DISPLACED, "--rise", "0.05", "--hold", "0.05", "--every", "0.02")
    for _ in range(2):  # the second replaces the first
        found = shell.json(*arguments, "--out", str(out))
    assert found["files"]["run"] == str(out)
    first, header, *rows = out.read_text(encoding="utf-8").splitlines()
    assert first.startswith("# simulated by Bowstring")
    assert first.endswith("amouri2019, converged at 0.1 s")
    columns = dict(zip(header.split(","), np.loadtxt(rows, delimiter=",").T, strict=True))
    assert columns.keys() == {
        "t_s",
        *(f"tip_{axis}_mm" for axis in "xyz"),
        *(f"{what}" for i in (1, 2, 3) for what in (f"tension_{i}_N", f"displacement_{i}_mm")),
    }
    shell.json(*arguments, "--out", str(nc))
    data = read_run(nc)
    assert columns["t_s"].tolist() == [0, 0.02, 0.04, 0.06, 0.08, 0.1]
    tip = 1e3 * data["disk_position"].to_numpy()[:, -1]
    for k, axis in enumerate("xyz"):
        np.testing.assert_allclose(columns[f"tip_{axis}_mm"], tip[:, k], atol=1e-5)
    for i in (1, 2, 3):
        tension = data["tension"].to_numpy()[:, i - 1]
        np.testing.assert_allclose(columns[f"tension_{i}_N"], tension, rtol=1e-8, atol=1e-8)
        displacement = 1e3 * data["tendon_displacement"].to_numpy()[:, i - 1]
        np.testing.assert_allclose(columns[f"displacement_{i}_mm"], displacement, atol=1e-6)
    assert columns["displacement_1_mm"][-1] != 0 and columns["tension_1_N"][-1] > 0
    out.write_text(header)  # somebody else's
    assert "existing files are not overwritten" in shell.error(*arguments, "--out", str(out))


def test_every_flag_has_its_effect(shell: Shell) -> None:
    plain = shell.json(*SHORT)
    for flags in (
        ["--theory", "kirchhoff"],
        ["--gravity", "0,0,-9.81"],
        ["--tip-force", "0,0.1 N,0"],
        ["--tip-moment", "0,0,10 N mm"],
        ["--mass-damping", "5/s"],
        ["--material-damping", "1 ms"],
        ["--modal-damping", "5 %"],
        ["--spectral-radius", "0.2"],
        ["--dt", "5 ms"],
        ["--tolerance", "0.1 mm"],
        ["--elements", "2"],
        ["--set", "segments.0.disks.mass=40 g"],
    ):
        other = shell.json(*SHORT, *flags)
        assert other["t_s"] == plain["t_s"]
        assert other["tip_position_m"] != plain["tip_position_m"], flags


@pytest.mark.parametrize("as_json", [False, True])
def test_a_run_that_stops_early(shell: Shell, tmp_path: Path, as_json: bool) -> None:
    """Both the message and the file say what was reached, when the run ended and why."""
    out = tmp_path / "run.nc"
    arguments = [*SIMULATE, "--tension", "1e4,0,0", "--rise", "0.1", "--out", str(out)]
    code, text, err = shell(*arguments, *(["--json"] if as_json else []))
    assert code == 1
    data = read_run(out)
    assert data.attrs["status"] == "collision" and data.attrs["reason"]
    end = float(data["time"][-1])
    assert f"Error: amouri2019: stopped at {end:.6g} s: {data.attrs['reason']}\n" == err
    if as_json:
        found = json.loads(text)
        assert found["status"] == "collision" and data.attrs["reason"] in found["message"]
        assert found["t_s"][-1] == end and len(found["tip_position_m"]) == len(found["t_s"])
    else:
        assert f"collision, {end:.6g} s" in text


def test_a_jump_without_a_following_step(shell: Shell, tmp_path: Path) -> None:
    """The start is output once, with numbers, in JSON and in the file."""
    out = tmp_path / "run.nc"
    arguments = [*SIMULATE, "--tension", "1e9,0,0", "--rise", "0", "--out", str(out)]
    code, text, err = shell(*arguments, "--json")
    assert code == 1 and err.startswith("Error: amouri2019: stopped at 0 s: even the shortest")
    assert err.count("\n") == 1
    found = json.loads(text)
    assert found["status"] == "step_failed" and found["t_s"] == [0]
    np.testing.assert_allclose(found["tip_position_m"], [[0, 0, 0.641]], atol=1e-12)
    assert read_run(out)["time"].values.tolist() == [0]


def test_no_equilibrium_at_the_start(shell: Shell) -> None:
    arguments = [*DISPLACED, "--gravity", "0,0,-981000"]
    code, out, err = shell(*arguments)
    assert (code, out) == (1, "") and "no equilibrium to start from" in err
    found = shell.json(*arguments, code=1)
    assert set(found) == set(SOUND.split())
    assert found["status"] == "no_equilibrium" and found["message"] in err
    sound = shell.json(*SHORT)["provenance"]["settings"]
    settings = found["provenance"]["settings"]
    assert list(settings) == list(sound) and settings["duration_s"] == 2
    assert settings["gravity_m_per_s2"] == [0, 0, -981000]
    damped = shell.json(*arguments, "--modal-damping", "1 %", code=1)
    assert damped["status"] == "no_equilibrium"
    assert list(damped["provenance"]["settings"]) == list(sound)
    assert damped["provenance"]["settings"]["mass_damping_per_s"] is None
    assert found["t_s"] == found["tip_position_m"] == []


def test_a_binary_table(shell: Shell, tmp_path: Path) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(b"\xff\xfe\x00\x9c")
    assert "is not text in UTF-8" in shell.error(*SIMULATE, "--table", str(path))


# -- motion of the base ------------------------------------------------------------------------

REST = (*SIMULATE, "--from", "40,0,0", "--tension", "40,0,0", "--rise", "0", "--hold", "0.2")


def test_base_motion(shell: Shell, tmp_path: Path, robot: bs.Robot) -> None:
    """The motion of Python's `BaseMotion`, columns in any order and unit; stored."""
    times = np.linspace(0.0, 0.25, 26)
    share = np.clip(times / 0.2, 0, 1) ** 3
    positions, rotations = np.outer(share, [0.02, -0.01, 0.0]), np.outer(share, [0.1, 0.2, -0.3])
    path, out = tmp_path / "base.csv", tmp_path / "run.nc"
    lines = ["rotation_z_deg,position_x_mm,position_y_m,position_z_m,t_ms,rotation_x_rad,"]
    lines[0] += "rotation_y_rad"
    for t, p, r in zip(times, positions, rotations, strict=True):
        row = [np.degrees(r[2]), 1e3 * p[0], p[1], p[2], 1e3 * t, r[0], r[1]]
        lines.append(",".join(f"{float(value):.17g}" for value in row))
    path.write_text("# an arm\n" + "\n".join(lines) + "\n")
    gravity = ("--gravity", "0,0,-9.81", "--base-motion", str(path))
    found = shell.json(*REST, *gravity, "--out", str(out))
    base = bs.BaseMotion(times, positions, rotations)
    expected = bs.simulate(
        robot, bs.dynamics.ramp([40, 0, 0], 0), 0.2,
        load=bs.Load(base=base, gravity=[0, 0, -9.81]), start=bs.Start(bs.Load([40, 0, 0])),
    )  # fmt: skip
    np.testing.assert_allclose(found["tip_position_m"], expected.tip_position, atol=1e-9)
    still = shell.json(*REST, *gravity[:2])
    moved = np.subtract(found["tip_position_m"], still["tip_position_m"])
    assert np.abs(moved).max() > 5e-3
    stored = json.loads(read_run(out).attrs["settings"])["base"]
    for known in (stored, found["provenance"]["settings"]["base"]):
        again = bs.BaseMotion.of_dict(known)
        np.testing.assert_allclose(again.times, times, atol=1e-15)
        np.testing.assert_allclose(again.positions, positions, atol=1e-15)
        np.testing.assert_allclose(again.rotations, rotations, atol=1e-15)


def test_a_base_that_only_turns(tmp_path: Path) -> None:
    path = tmp_path / "base.csv"
    path.write_text(TURN + "0,0,0,0\n0.5,0,90,0\n1,0,180,0\n")
    base = read_base_motion(path)
    assert base.positions is None
    np.testing.assert_allclose(base.rotations, np.outer([0, 0.5, 1], [0, np.pi, 0]))


TURN = "t_s,rotation_x_deg,rotation_y_deg,rotation_z_deg\n"


# -- stopped by the user -----------------------------------------------------------------------

LONG = (*DISPLACED, "--dt", "20 us", "--hold", "100")


@pytest.mark.skipif(os.name == "nt", reason="POSIX signals")
@pytest.mark.parametrize(("number", "code"), [("SIGINT", 130), ("SIGTERM", 130), ("SIGKILL", -9)])
@pytest.mark.slow
def test_a_killed_run_leaves_its_file(tmp_path: Path, number: str, code: int) -> None:
    out = tmp_path / "run.nc"
    with subprocess.Popen(
        [sys.executable, "-m", "bowstring", *LONG, "--out", str(out), "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as child:
        deadline = time.monotonic() + 60
        while not (out.is_file() and out.stat().st_size > 3_000_000):  # more than one chunk
            assert child.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
        child.send_signal(getattr(signal, number))
        text, err = child.communicate(timeout=60)
    assert child.returncode == code
    data = read_run(out)
    end = float(data["time"][-1])
    assert 0 < end < 101 and data.attrs["complete_to_s"] == end
    if number == "SIGKILL":
        assert data.attrs["status"] == "running"
        return
    assert data.attrs["status"] == "interrupted"
    assert err.startswith("Stopped: at ") and err.count("\n") == 1
    assert err.endswith(f" s of 101 s; {out} holds the run up to there.\n")
    found = json.loads(text)
    assert found["status"] == "interrupted" and found["t_s"][-1] == end


@pytest.mark.parametrize("importing", [False, True])
def test_stopped_while_pictures_are_drawn(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, importing: bool
) -> None:
    def stopped(*_: object, **__: object) -> None:
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            if importing:  # as a compiled module raises it
                raise ImportError("initialization failed") from error
            raise

    monkeypatch.setattr("bowstring.viz.animation.animate", stopped)
    out = tmp_path / "run.nc"
    code, text, err = shell(*SHORT, "--out", str(out), "--out", str(tmp_path / "run.gif"))
    assert (code, text) == (130, "")
    says = "Stopped: the motion was complete; "
    assert err == f"{says}{out} is written, the animation is not.\n"
    assert read_run(out).attrs["status"] == "converged"
    assert list(tmp_path.iterdir()) == [out]
    out.unlink()
    flags = ["--out", str(tmp_path / "run.gif")]
    assert shell(*SHORT, *flags) == (130, "", f"{says}the animation is not written.\n")
    table = tmp_path / "run.csv"
    written = f"{says}{table} is written, the animation is not.\n"
    assert shell(*SHORT, "--out", str(table), *flags) == (130, "", written)
    assert list(tmp_path.iterdir()) == [table] and table.stat().st_size > 1000


def test_stopped_in_the_middle_of_an_import(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        try:
            if stopped:
                raise KeyboardInterrupt
        finally:
            raise ImportError("initialization failed")

    monkeypatch.setattr("bowstring.dynamics.simulation.simulate", fails)
    stopped = True
    assert shell(*SHORT) == (130, "", "Stopped: nothing was written.\n")
    stopped = False  # an error of the program itself
    assert shell(*SHORT)[0] == 70


def test_stopped_while_the_result_is_printed(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By then there is a file, or nothing, and the message says which."""

    monkeypatch.setattr("bowstring.cli.output.write", Mock(side_effect=KeyboardInterrupt))
    out = tmp_path / "run.nc"
    for file in (out, tmp_path / "run.csv"):
        says = f"the result is not printed whole; {file} is written.\n"
        for flags in ([], ["--json"]):
            assert shell(*SHORT, "--out", str(file), *flags) == (130, "", f"Stopped: {says}")
    says = "the result is not printed whole; nothing is kept.\n"
    assert shell(*SHORT) == (130, "", f"Stopped: {says}")


# -- modes -------------------------------------------------------------------------------------


def test_modes(shell: Shell, robot: bs.Robot) -> None:
    found = shell.json("modes", "amouri2019")
    assert found["status"] == "converged" and len(found["modes"]) == 6
    frequencies = [mode["frequency_hz"] for mode in found["modes"]]
    assert frequencies == sorted(frequencies)
    assert frequencies[0] == pytest.approx(2.2804, rel=1e-3)
    assert {mode["kind"] for mode in found["modes"]} == {"bending", "torsion"}
    assert np.shape(found["modes"][0]["displacement"]) == (9, 3)
    assert len(found["disks"]) == 9 and found["tensions_N"] == [0, 0, 0]
    assert found["provenance"]["robot_hash"] == robot.hash
    code, text, err = shell("modes", "amouri2019")
    assert code == 0 and not err and "2.2802   bending" in text


def test_modes_flags(shell: Shell) -> None:
    plain = shell.json("modes", "amouri2019", "--count", "3")["modes"]
    assert len(plain) == 3
    for flags in (
        ["--tension", "40 N,0,0"],
        ["--gravity", "0,0,-9.81"],
        ["--tip-force", "0,0,1"],
        ["--elements", "2"],
        ["--theory", "kirchhoff"],
        ["--set", "segments.0.disks.mass=40 g"],
    ):
        other = shell.json("modes", "amouri2019", "--count", "3", *flags)["modes"]
        assert other[0]["frequency_hz"] != plain[0]["frequency_hz"], flags


@pytest.mark.slow
def test_mode_pictures(shell: Shell, tmp_path: Path) -> None:
    """Each mode as PNG, PDF and SVG; a second run replaces them, and keeps files of the user."""
    folder = tmp_path / "modes"
    arguments = ["modes", "amouri2019", "--tension", "20,0,0", "--out", str(folder)]
    code, text, err = shell(*arguments, "--count", "5")
    assert code == 0 and not err and text.endswith(f"Pictures: {folder}\n")
    svg = (folder / "mode_05.svg").read_text()
    assert "Mode 5: " in svg and " Hz, torsion" in svg and "deg at the largest rotation" in svg
    assert "mm at the largest displacement" in (folder / "mode_01.svg").read_text()
    found = shell.json(*arguments, "--count", "1")
    assert found["folder"] == str(folder)
    names = ["mode_01.pdf", "mode_01.png", "mode_01.svg", "modes.json"]
    assert sorted(p.name for p in folder.iterdir()) == names
    kept: dict[str, Any] = json.loads((folder / "modes.json").read_text())
    assert kept.pop("files") == names and set(kept.pop("sha256")) == set(names[:-1])
    assert kept == {key: value for key, value in found.items() if key != "folder"}
    (folder / "notes.txt").write_text("keep me")
    assert "it also holds notes.txt" in shell.error(*arguments)


def test_modes_without_equilibrium(shell: Shell) -> None:
    arguments = ["modes", "amouri2019", "--gravity", "0,0,-981000"]
    code, out, err = shell(*arguments)
    assert (code, out) == (1, "") and "no stable equilibrium" in err
    found = shell.json(*arguments, code=1)
    assert found["status"] == "no_equilibrium" and found["modes"] == []
