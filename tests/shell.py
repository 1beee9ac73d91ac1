"""Commands as a user enters them: in this process, or in one of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from pydantic import TypeAdapter

from bowstring.cli import main
from bowstring.cli.schemas import COMMANDS


@cache
def adapter(command: str) -> TypeAdapter[Any]:
    """What checks the JSON of a command."""
    return TypeAdapter(COMMANDS[command])


class Shell:
    """Runs a command in this process and captures its output."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *arguments: str) -> tuple[int, str, str]:
        code = main.run(arguments)
        return (code, *self.capsys.readouterr())

    def json(self, *arguments: str, code: int = 0) -> Any:
        """Return stdout as JSON: a single line that its schema allows."""
        got, out, err = self(*arguments, "--json")
        assert got == code, err
        assert out.count("\n") == 1
        command = " ".join(arguments[: 2 if arguments[0] in ("bench", "data") else 1])
        of_ik = ["--residual" if "--residual" in arguments else "--path"]
        for flag in ("--errors", "--store", *(of_ik if arguments[0] == "ik" else [])):
            if flag in arguments:
                command += f" {flag}"
        if arguments[0] == "map" and arguments.count("--over") > 2 and "--store" not in arguments:
            command += 3 * " --over"
        if command == "export":
            out_file = arguments[arguments.index("--out") + 1] if "--out" in arguments else ""
            ending = Path(out_file).suffix.replace("urdf", "xml")
            command += " --out " + (ending if ending in (".xml", ".json") else ".step")
        if command in COMMANDS:
            adapter(command).validate_json(out, strict=True)
        return json.loads(out, parse_constant=pytest.fail)  # NaN and Infinity are not JSON

    def error(self, *arguments: str) -> str:
        """Return the error sentence of a command that must reject its input."""
        code, out, err = self(*arguments)
        assert (code, out) == (2, ""), (out, err)
        assert err.startswith("Error: ") and err.count("\n") == 1, err
        assert "Traceback" not in err
        return err.removeprefix("Error: ").strip()


def refuses(shell: Shell, folder: Path, says: str | tuple[str, ...], *arguments: str) -> None:
    """Check that a command in the working folder rejects its input, and changes no file.

    One file exists: ``mine/notes.txt``.
    """
    mine = folder / "mine" / "notes.txt"
    mine.parent.mkdir()
    mine.write_text("keep me")
    words = 2 if arguments[0] in ("bench", "data") else 1
    for given in (arguments, (*arguments[:words], "--json", *arguments[words:])):
        said = shell.error(*given)
        assert all(part in said for part in ((says,) if isinstance(says, str) else says)), said
    assert [p for p in folder.rglob("*") if p.is_file()] == [mine]
    assert mine.read_text() == "keep me"


def process(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bowstring", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        **options,
    )


def on_terminal(*arguments: str, typed: str = "", **environment: str) -> tuple[str, int]:
    """The output of a command to a terminal on which a text is typed, and its exit code."""
    pty = pytest.importorskip("pty", reason="POSIX terminals")
    master, slave = pty.openpty()
    inherited = {k: v for k, v in os.environ.items() if k not in ("NO_COLOR", "FORCE_COLOR")}
    with subprocess.Popen(
        [sys.executable, "-m", "bowstring", *arguments],
        stdin=slave,
        stdout=slave,
        stderr=slave,
        env={**inherited, "TERM": "xterm-256color", **environment},
    ) as child:
        os.close(slave)
        os.write(master, typed.encode())
        text = b"".join(iter(lambda: read_terminal(master), b""))
        child.wait(60)
    os.close(master)
    return text.decode(), child.returncode


def read_terminal(master: int) -> bytes:
    """Some output of a terminal; none after its end."""
    try:
        return os.read(master, 65536)
    except OSError:  # raised on Linux when the other end is closed
        return b""
