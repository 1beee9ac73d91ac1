"""Every benchmark runs in its smallest form, so that none breaks where nobody runs it."""

from __future__ import annotations

import ast
import json
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import calibration, cases, displacement, model_choice, ramp, run

import bowstring as bs
from bowstring.calibration.observations import Data, commands
from bowstring.calibration.parameters import Unknowns
from bowstring.calibration.tip_model import TipModel
from bowstring.data.synthetic import STUDY

ROOT = Path(__file__).parents[1]
Small = Callable[..., str]


def made_recording(name: str) -> Data:
    """Rows that stand in for the measured ones of `benchmarks.calibration`: train, val or both."""
    time = np.arange(32.0)[{"train": slice(24), "val": slice(24, 32), "keypoints": slice(32)}[name]]
    there_and_back = np.abs((time + 8.0) % 16.0 - 8.0)
    phase = 2.0 * np.pi * (there_and_back[:, None] / 8.0 + np.arange(9) / 3.0)
    displacements = 2e-3 * np.sin(phase) + 1e-3
    group = np.array([f"pair{i}_same" for i in range(4)])[(time // 2 % 4).astype(int)]
    group[(time < 4) | (time > 28)] = "all3_same"
    one = time % 8 >= 6
    displacements[one, 1:], group[one] = -1e-3, "one tendon"
    data = Data(np.zeros((len(time), 3)), displacements=displacements, group=group, time=time)
    of = Unknowns(calibration.ELASTIC, calibration.EIGHT, calibration.START)
    tips = TipModel(of, commands(data, calibration.ELASTIC), calibration.ROD).predict(of.start)
    noise = np.random.default_rng(5).normal(0.0, 1e-3, (32, 3))[time.astype(int)]
    return replace(data, points=tips.point + noise)


_FEW = {**STUDY, "loads": replace(STUDY["loads"], masses=(0.0, 2.0, 4.0, 6.0), repeats=2)}
#: Module, arguments, smaller values of its constants, and a pattern of what it prints.
SMALL: dict[str, tuple[str, tuple[str, ...], dict[str, Any], str]] = {
    "coverage": ("coverage", ("2",), {"STUDY": _FEW}, "called not noise: "),
    "memories": ("memories", ("1",), {}, r"relaxation: \{.*\} of 1"),
    "motions": ("motions", ("--count", "2"), {"PERIODS": 3}, "hard .*%"),
    "paths": ("campaign.paths", ("6",), {}, "friction: 1 paths, .*tip .* covered"),
    "sensors": ("sensors", ("2", "6"), {}, r"all +all +2 "),
    "predictive": ("predictive", (), {"SECONDS": 0.1}, "constant curvature .*True"),
}
#: The same, with fits that take seconds.
SLOW: dict[str, tuple[str, tuple[str, ...], dict[str, Any], str]] = {
    "calibration": (
        "calibration",
        (),
        {
            "read": made_recording,
            "ABLATION": {"+ compliance": calibration.ABLATION["+ compliance"]},
            "WITHOUT": calibration.EIGHT,
            "CHOSEN": calibration.EIGHT,
            "FINALS": {
                name: calibration.FINALS[name]
                for name in ("PCC with gains", "physics, eight parameters")
            },
        },
        r"Fitted on all of train.*(?s:.*)one tendon +\d+ rows",
    ),
    "coverage, slack": ("coverage", ("2", "slack"), {}, "one tendon: 2 synthetic tables"),
    "validity chart": ("campaign.validity_chart", ("collapse", "40"), {}, "of all .*40 robots"),
    "memories, begun": ("memories", ("1", "--begun"), {}, "initial state fitted: "),
    "model_choice": (
        "model_choice",
        ("1",),
        {"TRUTH": {"none": model_choice.TRUTH["none"]}, "ROWS": (20,)},
        "tensions, none: memory",
    ),
}
OURS: dict[str, dict[str, Any]] = {
    "ours": {"BATCH": 34, "ROBOTS": 8, "MAPPED": 100, "TARGETS": 20, "RUNS": 1},
    "ours_displacement": {},
    "ours_ramp": {"CONVERGED": {"dt": 2e-3}, "RUNS": 1},
}
PEERS = sorted({*run.PEERS.values(), *run.DISPLACEMENT_PEERS.values(), *run.RAMP_PEERS.values()})
_LIBRARY = {"pyelastica": "elastica"}
"""Modules of peers that are not called as the peer."""


#: Pages of docs/verification whose figures are printed by hand.
PAGES = ["benchmarks", "calibration", "campaigns", "finite-elements", "suite"]


@pytest.mark.parametrize("page", PAGES)
def test_figures_on_pages_carry_their_commit(page: str) -> None:
    text = (ROOT / "docs" / "verification" / f"{page}.md").read_text("utf-8")
    assert re.search(r"\bcommits?\s`[0-9a-f]{8}`", text)


def test_scripts_use_what_the_package_has() -> None:
    """Names in branches that no small form reaches, such as those of exceptions."""
    folders = ("benchmarks", "campaign", "examples", "packaging", "paper")
    missing = [
        f"{path.relative_to(ROOT)}: bs.{node.attr}"
        for folder in folders
        for path in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name)
        if node.value.id == "bs" and not hasattr(bs, node.attr)
    ]
    assert not missing


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Small:
    """Run the benchmark of a module with other constants; what it prints."""

    def once(call: Callable[[], object], *_: object, **__: object) -> float:
        call()
        return 1.0

    def main(name: str, *arguments: str, **constants: Any) -> str:
        module = import_module(name if name.startswith("campaign") else f"benchmarks.{name}")
        for each in (module, cases, displacement, ramp):
            if hasattr(each, "median_ms"):
                monkeypatch.setattr(each, "median_ms", once)
        for constant, value in constants.items():
            monkeypatch.setattr(module, constant, value)
        monkeypatch.setattr(sys, "argv", [name, *arguments])
        capsys.readouterr()
        module.main()
        return capsys.readouterr().out

    return main


@pytest.mark.parametrize(
    "case", [*SMALL, *(pytest.param(name, marks=pytest.mark.slow) for name in SLOW)]
)
def test_a_benchmark_runs(small: Small, case: str) -> None:
    name, arguments, constants, says = {**SMALL, **SLOW}[case]
    if name == "predictive":
        pytest.importorskip("osqp", exc_type=ImportError)
    assert re.search(says, small(name, *arguments, **constants))


def test_the_tables_of_make_bench(
    small: Small,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """Our own measurements run, and the tables take them; peers stand in as copies of ours."""
    reports = {name: json.loads(small(name, **OURS[name])) for name in OURS}
    for report in reports.values():
        assert not [each["note"] for each in report["results"] if each["note"]]

    def solver(_venv: str, module: str) -> Any:
        if "pyelastica" in module:
            return {"failed": "not installed"}
        kind = next((kind for kind in ("displacement", "ramp") if kind in module), "")
        return json.loads(json.dumps(reports[f"ours_{kind}" if kind else "ours"]))

    monkeypatch.setattr(run, "run_solver", solver)
    monkeypatch.setattr(run, "ROOT", tmp_path)
    run.main()
    printed = capsys.readouterr().out
    for title in ("Static solve", "Displacement control: time", "Motion of amouri2019"):
        assert title in printed
    assert printed.count("target and measured") == 3
    assert "no solution" not in printed
    written = json.loads((tmp_path / "target" / "bench.json").read_text())
    assert {"solvers", "displacement", "ramp"} <= written.keys()


@pytest.mark.parametrize("name", PEERS)
def test_a_peer_runs(small: Small, name: str) -> None:
    """The coarsest setting of each other solver that is installed."""
    peer = name.partition("_")[0]
    library = _LIBRARY.get(peer, peer)
    pytest.importorskip(library, reason=f"needs {library}", exc_type=ImportError)
    module = import_module(f"benchmarks.peers.{name}")
    given = {}
    if hasattr(module, "SETTINGS"):
        setting = next(iter(module.SETTINGS))
        given["SETTINGS"] = {setting: module.SETTINGS[setting]}
    report = json.loads(small(f"peers.{name}", **given).splitlines()[-1])
    # the coarsest setting does not solve every load
    assert [each for each in report["results"] if not each["note"]]
