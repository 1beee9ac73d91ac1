"""The playground is opened as a file, or the command says how to build it."""

from __future__ import annotations

import webbrowser
from pathlib import Path

import pytest

from bowstring.cli import playground
from bowstring.cli.main import run


@pytest.mark.parametrize("shown", [True, False])
def test_it_opens_the_file(
    shown: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = tmp_path / "page.html"
    page.write_text("<!doctype html>")
    opened: list[str] = []
    monkeypatch.setattr(playground, "PAGE", page)
    monkeypatch.setattr(webbrowser, "open", lambda address: opened.append(address) or shown)
    assert run(["playground"]) == 0
    assert opened == [page.as_uri()]
    said = "is open in the browser" if shown else "open this file in a browser"
    assert str(page) in (out := capsys.readouterr().out) and said in out


def test_where_it_is_not_built_it_says_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(playground, "PAGE", tmp_path / "page.html")
    assert run(["playground"]) == 2
    error = capsys.readouterr().err
    assert "make playground" in error and error.count("\n") == 1
