"""Commands as a user gives them: in this process, or in one of their own."""

from __future__ import annotations

import json
import subprocess
import sys
from typing import Any

import pytest

from bowstring import cli


class Shell:
    """Runs a command in this process and keeps what it wrote."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, *arguments: str) -> tuple[int, str, str]:
        code = cli.run(arguments)
        return (code, *self.capsys.readouterr())

    def json(self, *arguments: str, code: int = 0) -> Any:
        """Stdout as JSON, which must be one line and all of it."""
        got, out, err = self(*arguments, "--json")
        assert got == code, err
        assert out.count("\n") == 1
        return json.loads(out, parse_constant=pytest.fail)  # NaN and Infinity are not JSON

    def error(self, *arguments: str) -> str:
        """The sentence of a command that must refuse its input."""
        code, out, err = self(*arguments)
        assert (code, out) == (2, ""), (out, err)
        assert err.startswith("Error: ") and err.count("\n") == 1, err
        assert "Traceback" not in err
        return err.removeprefix("Error: ").strip()


def process(*arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "bowstring", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        **options,
    )
