"""The draft of the paper: its numbers match the program, its references and figures exist."""

from __future__ import annotations

import re
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import pytest

from bowstring.study.study import Study

PAPER = Path(__file__).parents[1] / "paper"
TEXT = (PAPER / "paper.md").read_text("utf-8")
BODY = re.sub(r"<!--.*?-->", "", TEXT.split("---\n", 2)[2], flags=re.DOTALL)
FLAT = " ".join(BODY.split())


def test_length_is_within_the_journals_limits() -> None:
    assert 250 <= len(BODY.split()) <= 1000


def test_each_reference_is_in_the_list_and_cited() -> None:
    listed = set(
        re.findall(r"^@\w+\{(\w+),", (PAPER / "paper.bib").read_text("utf-8"), re.MULTILINE)
    )
    assert len(listed) >= 5 and set(re.findall(r"@(\w+)", BODY)) == listed


def test_figures_are_there_and_small() -> None:
    shown = re.findall(r"\]\((\w+\.png)\)", BODY)
    assert len(shown) == 3
    for name in shown:
        assert 10_000 < (PAPER / name).stat().st_size < 200_000, name
    labels = set(re.findall(r"\\label\{(.*?)\}", BODY))
    assert set(re.findall(r"\\autoref\{(.*?)\}", BODY)) == labels and len(labels) == 3


@pytest.fixture(scope="module")
def figures() -> ModuleType:
    spec = spec_from_file_location("paper_figures", PAPER / "figures.py")
    assert spec and spec.loader
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_its_numbers_match_the_program(paper: Study, figures: ModuleType) -> None:
    measured = list(figures.distances())
    said = dict(line.split(": ") for line in figures.numbers(paper, measured) if ": " in line)
    means = {name: said[name].split(" mm")[0] for name in ("cc_from_lengths", "cc_from_force")}
    assert f"off by {means['cc_from_lengths']} mm on average" in FLAT
    percent = said["cc_from_force"].split(", ")[1]
    assert f"off by {means['cc_from_force']} mm ({percent} of length) on average" in FLAT
    corrected = said["cc_from_force_arm"].split(" mm")[0]
    assert f"leaves {corrected} mm" in FLAT
    holds = next(m for m in paper.verdict.meanings if m.name == "cc_from_force").valid_to
    assert f"1 % of length at {holds:.1f} N" in FLAT
    assert f"from force by {said['transverse tip force 1 N'].split(', ')[1]}" in FLAT
    assert f"upright robot by {said['gravity, upright'].split(', ')[1]}" in FLAT
    assert paper.claim is not None
    assert f"below {paper.claim.mean_mm:g} mm ({paper.claim.mean_percent:g} % of" in FLAT
    worst = {label: apart.max() for label, apart, _ in measured}
    assert "within 0.0011 mm with default elements and within 1e-5 mm with four" in FLAT
    assert max(v for label, v in worst.items() if "default" in label) < 0.00115
    assert max(v for label, v in worst.items() if "4 elements" in label) < 1e-5
    force, apart, bar = figures.finite_elements()[-1]
    assert f"{apart:g} ± {bar:g} mm at {force:g} N" in FLAT


@pytest.mark.slow
def test_the_script_draws(tmp_path: Path) -> None:
    subprocess.run([sys.executable, PAPER / "figures.py", "--out", tmp_path], check=True)
    drawn = {each.name for each in tmp_path.iterdir()}
    assert drawn == {each.name for each in PAPER.glob("*.png")}
