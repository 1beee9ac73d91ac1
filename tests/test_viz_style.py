"""Style of all figures: text of files is no formula, and a figure that fails fails alone."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import NoReturn

import pytest
from matplotlib.figure import Figure

from bowstring.cli.output import figure_file
from bowstring.errors import FigureWarning, InputError
from bowstring.viz.style import figure_style, log_ticks, save_figure, save_figures, subplots, svg
from shell import Shell

NAMES = (r"$\frac{1}{0$", r"$x^2$", r"5 $ and 6 $", r"\$", r"$\alpha$ {")


def named(name: str) -> Figure:
    figure, (axes,) = subplots(1, 2.0)
    axes.plot([1.0, 2.0], [1.0, 2.0], label=name)
    axes.set(title=name, xlabel=name)
    axes.set_yticks([1.0, 2.0], [name, "two"])
    axes.annotate(name, (1.0, 1.0))
    axes.legend()
    return figure


def fails(*_: object, **__: object) -> NoReturn:
    raise ValueError("there is no such font")


@pytest.mark.parametrize("name", NAMES)
def test_names_are_drawn_literally(name: str) -> None:
    with figure_style():
        text = svg("named", named(name))
    assert re.findall(r"<text[^>]*>(.*?)</text>", text, re.DOTALL).count(name) == 5


def test_powers_of_ten_are_no_formulas() -> None:
    with figure_style():
        figure, (wide, narrow) = subplots(2, 4.0)
        for axes, low in ((wide, 1e-4), (narrow, 0.15)):
            axes.plot([1.0, 2.0], [low, 1.0])
            axes.set_yscale("log")
            log_ticks(axes.yaxis)
        figure.draw_without_rendering()
        labels = [text.get_text() for text in wide.get_yticklabels()]
        assert {"10\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT FOUR}", "10\N{SUPERSCRIPT ZERO}"} <= {
            *labels
        }
        minor = [text.get_text() for text in narrow.get_yticklabels(minor=True)]
        times = "2\N{MULTIPLICATION SIGN}10\N{SUPERSCRIPT MINUS}\N{SUPERSCRIPT ONE}"
        assert times in minor
        assert not re.search(r"[$\\{}]", "".join([*labels, *minor]))


@pytest.mark.parametrize(
    "arguments",
    [
        ("map", "--over", "E=30 GPa:40 GPa:2", "--points", "2"),
        ("control", "--poses", "4"),
        ("reach", "--poses", "4"),
        ("branches", "--tension", "1,0,0"),
        ("export", "--drawing", "disk.svg"),
    ],
)
def test_commands_draw_such_names(shell: Shell, here: Path, arguments: tuple[str, ...]) -> None:
    command, *flags = arguments
    code, _, err = shell(command, "amouri2019", "--set", f"name={NAMES[0]}", *flags)
    assert (code, err) == (0, "")


# -- figures that fail -------------------------------------------------------------------------


def test_other_figures_are_saved(tmp_path: Path) -> None:
    def save(stem: str, figure: Figure) -> None:
        if stem == "unsaved":
            fails()
        save_figure(figure, tmp_path / stem, (".png",))

    drawings = [(stem, partial(named, stem)) for stem in ("first", "unsaved", "last")]
    drawings.insert(1, ("undrawn", fails))
    with figure_style(), pytest.warns(FigureWarning) as warned:
        saved = save_figures(drawings, save, lambda share: None)
    assert saved == ["first", "last"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["first.png", "last.png"]
    assert [re.findall(r"figure \w+|\(.*\)", str(w.message)) for w in warned] == [
        [f"figure {stem}", "(ValueError: there is no such font)"] for stem in ("undrawn", "unsaved")
    ]


def test_results_are_printed_without_their_figure(
    shell: Shell, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bowstring.validity.map_result._curves", fails)
    with pytest.warns(FigureWarning, match="the figure is left out"):
        found = shell.json("map", "amouri2019", "--over", "E=30 GPa:40 GPa:2", "--points", "2")
    assert found["file"] is None and found["text"]
    assert list(here.iterdir()) == []


def test_a_file_that_cannot_be_written_is_an_error() -> None:
    def refused() -> Path:
        raise InputError("the folder does not exist")

    with pytest.raises(InputError, match="the folder does not exist"):
        figure_file(refused)
