"""The campaign of killed commands: its trials and its checks."""

from __future__ import annotations

import os
from pathlib import Path
from random import Random

import pytest

if os.name == "nt":
    pytest.skip("POSIX signals", allow_module_level=True)

from campaign import kills

DRAWING = next(command for command in kills.COMMANDS if command.output == "disk.svg")


@pytest.mark.slow
@pytest.mark.parametrize("signal", ["KILL", "TERM twice"])
def test_a_command_is_stopped(signal: str, tmp_path: Path) -> None:
    def fits(number: int) -> bool:
        random = Random(f"0:{number}")
        return (random.choice(kills.COMMANDS), random.choice([*kills.SIGNALS])) == (DRAWING, signal)

    number = next(filter(fits, range(10_000)))
    (tmp_path / "disk.svg").write_text("<dc:title>Bowstring</dc:title></svg>")
    what, wrong = kills.trial(number, tmp_path, {"disk.svg": 1.0}, 0)
    assert what.startswith(f"disk.svg {signal}, exit ") and wrong == ""


@pytest.mark.slow
def test_incomplete_results_are_detected(tmp_path: Path) -> None:
    def judge(name: str, code: int, replaces: bool = False, said: str = "Stopped: all.") -> None:
        kills._judge(DRAWING, name, code, said, tmp_path, replaces)

    judge("TERM", kills.STOPPED)
    with pytest.raises(AssertionError, match="the exit code"):
        judge("TERM", 1)
    with pytest.raises(AssertionError, match="no word"):
        judge("INT", kills.STOPPED, said="")
    with pytest.raises(AssertionError, match="the result is lost"):
        judge("KILL", -9, replaces=True)
    (tmp_path / "disk.svg").write_text("<svg> half of")
    with pytest.raises(AssertionError):
        judge("KILL", -9)
    (tmp_path / "disk.svg").unlink()
    left = tmp_path / ".disk.svg-0123456789ab.bowstring"
    left.mkdir()
    with pytest.raises(AssertionError, match="is left"):
        judge("TERM", kills.STOPPED)
    judge("KILL", -9)  # the next command removes it
    assert not left.exists()
