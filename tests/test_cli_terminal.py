"""Completion, --quiet, colours and progress bars of the terminal."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bowstring.cli import completion, main, output
from bowstring.data import datasets, mapping
from bowstring.robot.reader import robot_names
from shell import Shell, on_terminal, process, read_terminal

pty = pytest.importorskip("pty", reason="POSIX terminals")

SOLVE = ("solve", "amouri2019", "--tension", "1,0,0")
DOUBTFUL = (*SOLVE, "--set", "segments.0.disks.thickness=100 mm")
BENCH = ("bench", "simulate", "amouri2019", "--masses", "0:1:3", "--out", "bench.csv")
TABLE = Path(__file__).parents[1] / "examples" / "bench.csv"
ESCAPE = "\x1b"


# -- completion --------------------------------------------------------------------------------


@pytest.fixture
def complete(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[str]]:
    """The completions that bash offers for the last word of a line."""

    def offered(line: str) -> list[str]:
        monkeypatch.setenv("_BOWSTRING_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(line.count(" ")))
        with pytest.raises(SystemExit) as ended:
            main.run([])
        out, err = shell.capsys.readouterr()
        assert (ended.value.code, err) == (0, "")
        return str(out).split()

    return offered


@pytest.mark.parametrize(
    ("line", "offers"),
    [
        ("bowstring s", ["schema", "solve", "study", "suite", "simulate"]),
        ("bowstring bench ", ["check", "simulate"]),
        ("bowstring study --to", ["--tolerance"]),
        ("bowstring study --qu", ["--quiet"]),
        ("bowstring solve am", ["amouri2019"]),
        ("bowstring study --theory ", ["cosserat", "kirchhoff"]),
        ("bowstring solve amouri2019 --elements ", ["1", "2", "4", "8"]),
        ("bowstring fit amouri2019 --model a", ["arc"]),
        ("bowstring fit amouri2019 --parameter hole_a", ["hole_angle"]),
        ("bowstring fit amouri2019 --data tamm-spring --part ", ["bending"]),
        ("bowstring fit amouri2019 --part tr", ["train"]),
        ("bowstring suite --only tamm", ["tamm-spring"]),
        ("bowstring bench check table.csv --robot rao", ["rao2021"]),
        ("bowstring bench check table.csv --mapping tamm", ["tamm-spring"]),
        ("bowstring export amouri2019 --out arm.g", ["arm.glb", "arm.gltf"]),
        ("bowstring export amouri2019 --out ../arm.g", ["../arm.glb", "../arm.gltf"]),
        ("bowstring simulate amouri2019 --out arm.g", ["arm.gif", "arm.glb"]),
        # names of files, which the shell completes
        ("bowstring export amouri2019 --out arm", []),
        ("bowstring export amouri2019 --out ../", []),
        ("bowstring study --measurements ", []),
    ],
)
def test_completion(complete: Callable[[str], list[str]], line: str, offers: list[str]) -> None:
    assert complete(line) == offers


def test_completion_of_robot_files(complete: Callable[[str], list[str]], here: Path) -> None:
    for name in ("mine.yaml", "mine.yml", "notes.txt"):
        Path(name).touch()
    assert complete("bowstring solve ") == [*robot_names(), "mine.yaml", "mine.yml"]
    assert complete("bowstring solve ./m") == ["./mine.yaml", "./mine.yml"]
    assert complete("bowstring solve nowhere/") == []


def test_completion_offers_available_values(complete: Callable[[str], list[str]]) -> None:
    assert complete("bowstring data get ") == datasets.available()
    for name, parts in completion.DATA_SETS.items():
        assert parts == datasets.describe(name).parts
    assert set(mapping.mapping_names()) <= set(complete("bowstring bench check t --mapping "))


@pytest.mark.parametrize("name", ["zsh", "fish", "powershell"])
def test_completion_in_other_shells(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """The script that registers the completion, and the completions that it receives."""
    monkeypatch.setenv("_TYPER_COMPLETE_ARGS", "bowstring solve am")
    monkeypatch.setenv("_TYPER_COMPLETE_FISH_ACTION", "get-args")
    monkeypatch.setenv("_TYPER_COMPLETE_WORD_TO_COMPLETE", "am")
    for action, offered in (("source", "_BOWSTRING_COMPLETE"), ("complete", "amouri2019")):
        monkeypatch.setenv("_BOWSTRING_COMPLETE", f"{action}_{name}")
        with pytest.raises(SystemExit) as ended:
            main.run([])
        out, err = shell.capsys.readouterr()
        assert (ended.value.code, err) == (0, "")
        assert offered in out


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_completion_in_bash_itself(tmp_path: Path) -> None:
    program = tmp_path / "bowstring"
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m bowstring "$@"\n')
    program.chmod(0o755)
    done = subprocess.run(
        [
            "bash",
            "--norc",
            "-c",
            'eval "$(_BOWSTRING_COMPLETE=source_bash bowstring)"; complete -p bowstring;'
            "COMP_WORDS=(bowstring solve rao); COMP_CWORD=2; _bowstring_completion bowstring;"
            'echo "${COMPREPLY[@]}"',
        ],
        env={**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines() == [
        "complete -o default -F _bowstring_completion bowstring",
        "rao2021",
    ], done.stderr


@pytest.mark.parametrize("line", ["bowstring st", "bowstring solve am", "bowstring data get "])
def test_completion_loads_no_heavy_library(line: str) -> None:
    code = (
        "import sys\n"
        "from bowstring.cli import main\n"
        "try: main.run([])\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'pandas', 'matplotlib', 'pint', 'rich', 'jinja2'}\n"
        "sys.exit(repr(heavy & set(sys.modules)) if heavy & set(sys.modules) else 0)\n"
    )
    asked = {"_BOWSTRING_COMPLETE": "complete_bash", "COMP_WORDS": line}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, **asked, "COMP_CWORD": str(line.count(" "))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and done.stdout.strip(), done.stderr


# -- quiet ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("flag", ["--quiet", "-q"])
def test_quiet_keeps_results_and_errors(shell: Shell, flag: str) -> None:
    code, out, err = shell(*DOUBTFUL)
    assert code == 0 and err.startswith("Warning: ")
    assert shell(*DOUBTFUL, flag) == (0, out, "")
    assert shell(flag, *DOUBTFUL) == (0, out, "")
    assert shell.json(*DOUBTFUL, flag)["warnings"]
    assert shell(*DOUBTFUL)[2] == err  # nothing else is written
    assert "--tension: got" in shell.error("solve", "amouri2019", "--tension", "1,0", flag)


@pytest.mark.parametrize("place", range(4))
def test_a_command_of_a_group_is_quiet_wherever_the_flag_stands(shell: Shell, place: int) -> None:
    check = ["bench", "check", str(TABLE), "--robot", "amouri2019", *DOUBTFUL[-2:]]
    assert shell(*check)[2].startswith("Warning: ")
    code, _, err = shell(*check[:place], "-q", *check[place:])
    assert (code, err) == (0, "")


def test_an_unstable_equilibrium_is_a_warning_in_one_line() -> None:
    twisted = ("solve", "amouri2019", "--tension", "0,0,0", "--tip-moment", "0,0,0.5")
    err = process(*twisted).stderr
    assert err.startswith("Warning: amouri2019: An equilibrium; whether it is stable is not known")
    assert err.count("\n") == 1
    assert process(*twisted, "--quiet").stderr == ""


def test_every_command_can_be_quiet(shell: Shell) -> None:
    commands = [["bench", "check"], ["bench", "simulate"], ["data", "list"], ["data", "get"]]
    for listed in shell("--help")[1].partition("Commands:\n")[2].splitlines():
        if (name := listed.split()[0]) not in ("bench", "data") and listed[2] != " ":
            commands.append([name])
    assert len(commands) == 25
    for command in commands:
        assert "-q, --quiet" in shell(*command, "--help")[1], command


# -- colours -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("environment", "styled"),
    [
        ({}, True),
        ({"NO_COLOR": ""}, True),  # as if it were not set
        ({"NO_COLOR": "1"}, False),
        ({"NO_COLOR": "1", "FORCE_COLOR": "1"}, False),
        ({"TERM": "dumb"}, False),
    ],
)
def test_colours_on_a_terminal(environment: dict[str, str], styled: bool) -> None:
    text, _ = on_terminal("robots", **environment)
    assert "amouri2019" in text and (ESCAPE in text) == styled


@pytest.mark.parametrize(
    ("environment", "styled"),
    [({}, False), ({"FORCE_COLOR": "1"}, True), ({"FORCE_COLOR": "1", "NO_COLOR": "1"}, False)],
)
def test_colours_in_a_pipe(
    shell: Shell, monkeypatch: pytest.MonkeyPatch, environment: dict[str, str], styled: bool
) -> None:
    for name in ("NO_COLOR", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("TERM", "xterm")
    _, out, _ = shell("robots")
    assert (ESCAPE in out) == styled
    assert ESCAPE not in shell("robots", "--json")[1]


@pytest.mark.parametrize(
    "arguments", [("--version",), ("--help",), ("study", "--help"), ("study", "--tolerance", "2")]
)
def test_texts_and_errors_have_no_colour(arguments: tuple[str, ...]) -> None:
    assert ESCAPE not in on_terminal(*arguments)[0]


def test_installing_completion_obeys_no_color(tmp_path: Path) -> None:
    """This output is from typer, in green."""
    here = {"HOME": str(tmp_path), "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    assert ESCAPE in on_terminal("--install-completion", "bash", **here)[0]
    text, _ = on_terminal("--install-completion", "bash", NO_COLOR="1", **here)
    assert "completion installed in" in text and ESCAPE not in text
    assert "complete -o default" in (tmp_path / ".bash_completions/bowstring.sh").read_text()


# -- progress ------------------------------------------------------------------------------------


class Terminal:
    """A pseudo-terminal in place of stderr, with its other end."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        self.stream = os.fdopen(self.slave, "w")

    def sees(self, work: Callable[[], object]) -> str:
        """The output of some work to stderr."""
        with contextlib.redirect_stderr(self.stream):
            work()
        self.stream.close()
        return b"".join(iter(lambda: read_terminal(self.master), b"")).decode()


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    """A terminal where a bar is drawn before the work begins."""
    made, begin = Terminal(), output._Bar.__init__

    def drawn(bar: Any, what: str) -> None:
        begin(bar, what)
        while not bar._drawn:
            time.sleep(0.001)

    monkeypatch.setattr(output._Bar, "__init__", drawn)
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(output, "_BAR_AFTER", 0.0)
    yield made
    os.close(made.master)


def visible(text: str) -> list[str]:
    """The visible lines of a terminal, where \\r overwrites a line."""
    lines = []
    for line in text.split("\n"):
        shown = ""
        for part in line.split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return lines


def test_a_line_of_progress() -> None:
    line = output.progress_line("dynamics", 0.25, 2.0, 3.0)
    assert line == f"[{'#' * 6}{'.' * 18}]  25 %  0:03 elapsed, 0:05 left  dynamics"
    line = output.progress_line("dynamics", 0.25, 3600.0, 4000.0)
    assert line.endswith("25 %  1:06:40 elapsed, 2:53:20 left  dynamics")
    # the time left decreases between two reports, and not below zero
    assert "0:00 left" in output.progress_line("dynamics", 0.9, 9.0, 30.0)
    assert "100 %" in output.progress_line("done", 1.01, 9.0, 9.0)


def test_a_progress_line_without_a_fraction() -> None:
    lines = {output.progress_line("modes", 0.0, 0.0, 0.1 * k + 0.05) for k in range(60)}
    assert all(re.fullmatch(r"\[\.*###\.*\]   -    0:0\d elapsed  modes", line) for line in lines)
    assert len({line[:26] for line in lines}) == 22
    assert len({len(line) for line in lines}) == 1


def test_a_line_shows_no_control_characters() -> None:
    assert ESCAPE not in output.progress_line(f"{ESCAPE}[2J", 0.5, 1.0, 1.0)


@pytest.fixture
def public_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A public data set of one file, in a folder of the user."""
    content = b"x\n1\n"
    file = datasets.DataFile("a.csv", hashlib.sha256(content).hexdigest(), "a.csv", "a")
    made = replace(datasets.describe("sorosim-rods"), name="made-up", files=(file,))
    monkeypatch.setitem(datasets._SETS, "made-up", made)
    monkeypatch.setenv("BOWSTRING_DATA", str(tmp_path))
    (tmp_path / "made-up").mkdir()
    (tmp_path / "made-up" / "a.csv").write_bytes(content)


@pytest.mark.usefixtures("public_set")
@pytest.mark.parametrize(
    ("arguments", "what"),
    [
        (BENCH, "equilibria"),
        (("bench", "check", "table.csv"), "table"),
        (("modes", "amouri2019", "--count", "2"), "modes"),
        (
            ("fit", "amouri2019", "--measurements", "table.csv", "--parameter", "gain"),
            "measurements",
        ),
        (("data", "get", "made-up"), "made-up"),
        (("data", "get", "made-up", "--out", "copy"), "made-up"),
    ],
)
def test_a_bar_is_drawn_and_removed(
    terminal: Terminal, here: Path, arguments: tuple[str, ...], what: str
) -> None:
    Path("table.csv").write_text(
        "tension_1_N,tension_2_N,tension_3_N,tip_x_mm,tip_y_mm,tip_z_mm\n"
        "10,0,0,54.9,0,637\n20,0,0,108,0,627\n40,0,0,207,0,589\n"
    )
    codes = []
    text = terminal.sees(lambda: codes.append(main.run(arguments)))
    assert codes == [0]
    assert what in text and " elapsed" in text and ESCAPE not in text
    assert visible(text) == [""]


@pytest.mark.parametrize("how", ["--quiet", "dumb", "pipe"])
def test_no_bar(terminal: Terminal, here: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    if how == "dumb":
        monkeypatch.setenv("TERM", "dumb")
    if how == "pipe":
        monkeypatch.setattr(terminal.stream, "isatty", lambda: False)
    arguments = [*BENCH, *(["--quiet"] if how == "--quiet" else [])]
    assert terminal.sees(lambda: main.run(arguments)) == ""
    assert Path("bench.csv").is_file()


def test_a_warning_within_work_has_a_line_of_its_own(terminal: Terminal) -> None:
    def work() -> None:
        with output.progress_bar("work"):
            output.say("Warning", "look.")
            time.sleep(0.3)

    text = terminal.sees(work)
    assert "elapsed" in text.partition("Warning")[0] and "elapsed" in text.partition("look.")[2]
    assert visible(text) == ["Warning: look.", ""]


def test_a_bar_fits_its_terminal(terminal: Terminal) -> None:
    import fcntl
    import struct
    import termios

    fcntl.ioctl(terminal.slave, termios.TIOCSWINSZ, struct.pack("HHHH", 5, 30, 0, 0))

    def work() -> None:
        with output.progress_bar("work"):
            pass

    assert max(map(len, terminal.sees(work).split("\r"))) == 29


def test_ctrl_c_removes_the_bar(tmp_path: Path) -> None:
    master, slave = pty.openpty()
    out = tmp_path / "bench.csv"
    long = ("--tensions", "0:0.01:80", "--friction", "0.1", "--repeats", "20", "--out", str(out))
    with subprocess.Popen(
        [sys.executable, "-m", "bowstring", "bench", "simulate", "amouri2019", *long],
        stdout=slave,
        stderr=slave,
        env={**os.environ, "TERM": "xterm"},
    ) as child:
        os.close(slave)
        text = b""
        while b"equilibria" not in text:
            more = read_terminal(master)
            assert more, text
            text += more
        child.send_signal(signal.SIGINT)
        text += b"".join(iter(lambda: read_terminal(master), b""))
        code = child.wait(60)
    os.close(master)
    lines = [line for line in visible(text.decode()) if line]
    assert (code, lines) == (130, ["Stopped: nothing was written."])
    assert not list(tmp_path.iterdir())
