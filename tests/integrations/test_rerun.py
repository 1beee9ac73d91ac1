"""Recordings for Rerun, read back by its own reader."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bowstring import load_robot
from bowstring.errors import InputError
from bowstring.integrations.rerun import write_rerun
from bowstring.statics import fields
from made_frames import made_frames
from shell import Shell

ROBOT = load_robot("amouri2019")
TIMES = np.array([0.0, 0.1, 0.25])
CALL = ("simulate", "amouri2019", "--tension", "40,0,0", "--rise", "0.02", "--hold", "0")


def rows(file: Path, path: str, column: str) -> dict[float, Any]:
    """Values of a component by time in s."""
    from rerun.chunk import RrdReader

    found = {}
    for chunk in RrdReader(file).stream().to_chunks():
        if chunk.entity_path != path or chunk.is_static:
            continue
        batch = chunk.to_record_batch()
        (name,) = (n for n in batch.schema.names if n.endswith(f":{column}"))
        times = batch["time"].cast("int64").to_numpy() / 1e9
        found.update(zip(times.tolist(), batch[name].to_pylist(), strict=True))
    return found


def test_the_recording_has_the_poses_of_the_run(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun", exc_type=ImportError)
    data = fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES), {})
    seen: list[float] = []
    file = write_rerun(
        ROBOT, data, tmp_path / "run.rrd", progress=lambda what, done: seen.append(done)
    )
    assert seen[-1] == 1.0
    centres = rows(file, "/robot/disks", "centers")
    assert list(centres) == pytest.approx(TIMES)
    for k, given in enumerate(centres.values()):
        np.testing.assert_allclose(given, data["disk_position"][k], atol=1e-6)
    tip = rows(file, "/tip_m/x", "scalars")
    np.testing.assert_allclose([v[0] for v in tip.values()], data["position"][:, -1, 0])
    strips = rows(file, "/robot/tendons", "strips")
    assert [len(strip) for strip in strips.values()] == [len(ROBOT.tendons.segment)] * 3
    write_rerun(ROBOT, data, file)  # replaces it
    assert [p.name for p in tmp_path.iterdir()] == ["run.rrd"]


def test_the_command_writes_it(shell: Shell, tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the extra rerun", exc_type=ImportError)
    out = tmp_path / "run.rrd"
    found = shell.json(*CALL, "--out", str(out))
    assert found["files"]["rerun"] == str(out)
    assert rows(out, "/tip_m/z", "scalars")[0.02][0] == pytest.approx(
        found["tip_position_m"][-1][2]
    )


def test_what_cannot_be_written_is_refused(shell: Shell, tmp_path: Path) -> None:
    mine = tmp_path / "mine.rrd"
    mine.write_text("mine")
    assert "mine.rrd" in shell.error(*CALL, "--out", str(mine))
    assert mine.read_text() == "mine"
    data = fields.to_dataset(ROBOT, made_frames(ROBOT, TIMES), {})
    with pytest.raises(InputError, match="of another robot"):
        write_rerun(load_robot("rao2021"), data, tmp_path / "run.rrd")


def test_without_the_extra_the_cure_is_said(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    said = shell.error(*CALL, "--out", str(tmp_path / "run.rrd"))
    assert "pip install 'bowstring[rerun]'" in said and not list(tmp_path.iterdir())
