"""Control characters of file names, labels and units are written to no terminal and no file."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml

import bowstring as bs
from bowstring.cli import main
from bowstring.data.measurements import read_measurements
from bowstring.errors import InputError
from bowstring.robot.writer import to_yaml
from bowstring.units import printable
from shell import Shell

ROOT = Path(__file__).parents[1]
RED, BELL = "\x1b[31m", "\x07"
EVIL = f"te{RED}st{BELL}\x9b"  # ESC, BEL, and CSI of one character
CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f]")


@pytest.fixture
def table(tmp_path: Path) -> str:
    """A small synthetic table whose file name and labels are not printable."""
    rows = (ROOT / "examples" / "bench.csv").read_text("utf-8").splitlines(keepends=True)
    path = tmp_path / f"{EVIL}.csv"
    path.write_text("".join(rows[:17]).replace("loading", f"lo{RED}ad"), "utf-8")
    return str(path)


def test_printed_text_has_no_control_characters(shell: Shell, table: str) -> None:
    code, out, err = shell("bench", "check", table, "--robot", "amouri2019")
    assert code == 0 and not CONTROL.search(out + err)
    assert r"te\x1b[31mst\x07\x9b: synthetic" in out and r"lo\x1b[31mad 12" in out


def test_errors_have_no_control_characters(shell: Shell, table: str, tmp_path: Path) -> None:
    text = Path(table).read_text("utf-8")
    bad = tmp_path / "unit.csv"
    bad.write_text(re.sub("tip_(.)_mm", rf"tip_\1_{RED}mm", text), "utf-8")
    assert "is not a unit" in (error := shell.error("bench", "check", str(bad)))
    assert not CONTROL.search(error) and r"tip_x_\x1b[31mmm" in error
    Path(table).write_text("tension_1_N,tip_x_mm\n", "utf-8")
    assert not CONTROL.search(shell.error("bench", "check", table))


def test_a_terminal_keeps_its_styles(
    table: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    assert main.run(["bench", "check", table]) == 0
    out = capsys.readouterr().out
    assert r"te\x1b[31mst\x07\x9b: synthetic" in out
    assert RED not in out and BELL not in out and "\x1b[1m" in out  # headings are bold


def test_a_calibrated_robot_is_read_back(shell: Shell, table: str, tmp_path: Path) -> None:
    out = tmp_path / "fitted"
    name = "segments.0.backbone.E"
    command = ("fit", "amouri2019", "--measurements", table, "--parameter", name)
    code, said, err = shell(*command, "--out", str(out))
    assert code == 0 and not CONTROL.search(said + err)
    for file in out.iterdir():
        if file.suffix in (".yaml", ".json"):
            assert not CONTROL.search(file.read_text("utf-8")), file
    assert "te\\x1b[31mst" in (out / "robot.yaml").read_text("utf-8")
    known, found = bs.load_robot("amouri2019"), bs.load_robot(out / "robot.yaml")
    assert found.segments[0].backbone.E != known.segments[0].backbone.E
    assert found.name == known.name


@pytest.mark.parametrize("c", [*map(chr, range(32)), "\x7f", "\x85", "\x9b", "\u2028", "\udcff"])
def test_a_robot_file_with_any_comment_is_read_back(c: str, tmp_path: Path) -> None:
    robot, path = bs.load_robot("amouri2019"), tmp_path / "robot.yaml"
    path.write_text(to_yaml(robot, f"from a{c}name: b"), "utf-8")
    assert bs.load_robot(path).hash == robot.hash
    yaml.safe_load(path.read_text("utf-8"))


def test_a_robot_file_may_have_such_a_name(tmp_path: Path) -> None:
    path = tmp_path / f"{EVIL}.yaml"
    path.write_text((ROOT / "examples" / "my_robot.yaml").read_text("utf-8"), "utf-8")
    bs.load_robot(path)
    path.write_text(re.sub("(?m)^name:.*$", "", path.read_text("utf-8")), "utf-8")
    assert bs.load_robot(path).name == r"te\x1b[31mst\x07\x9b"
    path.write_text("segments: 1", "utf-8")
    with pytest.raises(InputError) as caught:
        bs.load_robot(path)
    assert not CONTROL.search(str(caught.value))


def test_names_of_measurements_are_printable(table: str) -> None:
    data = read_measurements(table)
    assert data.name.isprintable() and all(label.isprintable() for label in data.group)


def test_printable_text_is_unchanged() -> None:
    for text in ("", "plain", "Größe µm 中文 😀", "two\nlines\tand a tab"):
        assert printable(text) is text or printable(text) == text
